# SPDX-License-Identifier: MIT
"""Limit cycles, stable or not, as periodic boundary-value problems.

A cycle is found on a coarse mesh, from a Hopf point, a motion or another cycle. It is refined until
amplitude and frequency converge and the trivial multiplier is 1. Mesh intervals are short where the
motion changes fast; modes that decay within a small part of the period need no shorter ones, as
Radau's method is L-stable.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import field, replace
from typing import Any, TypeAlias

import numpy as np

from pipedyn.attraction.from_motion import (
    CLOSELY,
    LARGEST_CYCLE,
    ROUGHLY,
    last_period,
    run_through_once,
)
from pipedyn.attraction.motion_ends import LATE_RECURRENCE, Case, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.attraction.records import Stretch
from pipedyn.attraction.regions import NOWHERE
from pipedyn.equilibrium.hopf import Hopf, hopf, hopf_point
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.rest import at_rest
from pipedyn.linear.sensitivity import Crossing
from pipedyn.models.base import Model
from pipedyn.models.drive import steady_speed
from pipedyn.motion.sampling import farthest_direction
from pipedyn.motion.simulate import (
    Motion,
    Start,
    Trajectory,
    check_coordinates,
    checked_model_in_motion,
    slightly_bent,
    state_of,
)
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.orbits.collocation import residual, solved
from pipedyn.orbits.floquet import (
    MULTIPLIER_TOLERANCE,
    all_multipliers,
    beyond_circle,
    multipliers_by_plane,
    nontrivial,
)
from pipedyn.orbits.orbit_continuation import (
    COARSE,
    breaking_part,
    orbit_at_speed,
    solved_anew,
)
from pipedyn.orbits.periodic_orbit import (
    MOST_CYCLE_INTERVALS,
    PROBES,
    PeriodicOrbit,
    joined_in_pairs,
    refined,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_work
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.newton import NewtonFailed, zeros_between
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import TableResult

SEARCHED, SEEN = 60.0, 20.0
"""Time in T for which a motion is integrated in search of a cycle, and time for which it is then
recorded; a motion that comes nearer to something is followed for longer."""

SEARCH, SEARCH_FACTOR = 600_000, 3
"""Number of right-hand sides of that motion, from one look to the next, beyond which it is given
up, and the factor by which more are allowed up to 6 degrees of freedom, where they are cheap.
Motions that wind up without end turn ever faster."""

DEFECT_ROUNDING = 1e-11
"""Defect of an interval below which the defect may be rounding, so that only halving intervals
reduces it."""

SAMPLES_A_STAGE = 2
"""Number of samples for each stage of an orbit, between which its free end turns back once at
most."""

MULTIPLIER_MESHES = 3
"""Largest number of meshes on which the multipliers are computed, each for a hundredth of the
defect before: on the third it is 1e-7 of rtol, where only rounding is left."""

ON_BRANCH = 1e-5
"""Error of multipliers that is aimed at on a branch: under drag its orbits allow no less."""

TRIVIAL, SHARE_OF_NEXT = 1e-6, 0.01
"""Allowed distance of the trivial multiplier from 1: the tolerance to which users ask for cycles
or, if that is more, this share of the distance from 1 of the next multiplier. An error moves both
about as far, so that up to a hundredth the next one's side of 1 is certain."""

CycleStart: TypeAlias = "LimitCycle | Hopf | Motion | Start | None"
"""Start of the search for a cycle."""

KINDS = "a LimitCycle, a Hopf, a Motion, an angle theta(s), coordinates or a state [q, q']"
"""Kinds of starts, in words."""


class PeriodicMotion(Trajectory, TableResult):
    """One period of a motion that repeats; base class of limit cycles and forced motions."""

    amplitude: float
    frequency: float
    period: float
    multipliers: Complex = field(repr=False)
    stable: bool
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    model: Model
    error: float
    residual: float
    orbit: PeriodicOrbit = field(repr=False, compare=False)

    @property
    def tip(self) -> Array:
        """Position (x, y) of the free end from the base, (S, 2); or (x, y, z), (S, 3)."""
        return self.model.tips(self.q.T)


@saved_as("LimitCycle", added=("across",))
class LimitCycle(PeriodicMotion):
    """One period of a periodic motion.

    Attributes:
        amplitude: half the peak-to-peak transverse motion of the free end, in L.
        frequency: angular frequency, in 1 / T.
        period: period, in T.
        multipliers: Floquet multipliers, complex, shape (2 dof,), the largest modulus first, with
            the trivial one, 1. In three dimensions one more is 1, that of the cycle turned about
            the axis of the straight pipe, if the pipe is the same in all directions across it.
        stable: whether no nontrivial multiplier's modulus exceeds 1 by more than 1e-6 or three
            times its error.
        t: times from 0, where the free end is farthest to positive x, to the period, shape (S,).
        q, qdot: coordinates and rates, shape (S, coordinates).
        u: flow speed.
        model: the model.
        error: relative error of amplitude and frequency, estimated as their largest change, or that
            of a position, between two meshes, one of them with about half as many intervals.
        multiplier_error: the largest of: the distance of the trivial multiplier from 1; the change
            of the worst multiplier with shorter intervals, relative if above 1; and rounding.
        residual: largest |dy/dt - f(y)| half-way between the stages at which the equations were
            solved, relative to the largest |f|, of the accelerations.
        symmetric: whether the second half of the period was taken as the mirror image of the first.
        phases: number of states that were solved for.
        evaluations: number of right-hand sides and Jacobians.
        method: how the cycle was found.
        orbit: solution of the collocation equations, from which other searches start.
        across: of a cycle in the plane z = 0 or x = 0 of a model in three dimensions those
            multipliers, shape (dof,), whose perturbations leave that plane; None for other cycles.

    Example:
        >>> cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 4), 6.0)
        >>> round(cycle.amplitude, 4), round(cycle.period, 4), cycle.stable
        (0.4422, 0.4866, True)
    """

    u: float
    multiplier_error: float
    symmetric: bool
    phases: int
    evaluations: int
    method: str

    across: Complex | None = field(default=None, repr=False)

    @property
    def others(self) -> Complex:
        """Multipliers without the one that is 1 for every cycle, and without that of turns."""
        left = nontrivial(self.multipliers)
        return nontrivial(left) if self.model.axisymmetric else left

    @property
    def moves(self) -> bool:
        """Whether anything moves: a branch of cycles may begin or end at rest, at a Hopf point."""
        return bool(np.ptp(self.q, axis=0).any())


@saved_as("NoCycle")
class NoCycle(PipedynError):
    """No limit cycle was found.

    Attributes:
        u: flow speed.
    """

    def __init__(self, message: str, u: float) -> None:
        super().__init__(message, u)
        self.u = u


def limit_cycle(
    model: Model,
    u: float,
    start: CycleStart = None,
    *,
    rtol: float = 1e-6,
    samples: int = 257,
) -> LimitCycle:
    """A periodic motion at a constant flow speed, stable or unstable, with its Floquet multipliers.

    In three dimensions, if the pipe is the same in all directions, it is a cycle in the plane
    z = 0, that of `model.planar`, for which starts are given, with its multipliers also across the
    plane; `rotating_motion` finds circular motions. If a load bends the pipe, it is any cycle.

    Args:
        model: chain, reduced model or scene, up to 100 degrees of freedom.
        u: flow speed > 0, in sqrt(EI / mu_f) / L.
        start: where the search begins: a `LimitCycle` in the model's coordinates (at another speed,
            or of another pipe); a `Hopf` of the model, whose cycle is followed to u; a `Motion`
            that ends near the cycle; or the initial state of a simulation, as for
            `lyapunov_exponent`: an angle theta(s) or coordinates (at rest), or a state [q, q'],
            shape (2 coordinates,). If not given, the cycles of the model's flutter onsets are
            followed to u, the nearest onset first; if that leads nowhere and rest is unstable, a
            simulation starts from a slight bend; and for pipes with drag that are unstable without
            an onset, the search starts from the cycle of a damped pipe, whose damping is then left
            out. Such a cycle may be unstable (see `stable`); then a `Motion` or a state leads to
            the attractor.
        rtol: relative tolerance of amplitude and frequency, in [1e-10, 1e-2].
        samples: number of states that are given, from the start of the period to its end.

    Returns:
        LimitCycle.

    Example:
        >>> cycle = pp.limit_cycle(pp.Galerkin(pp.Pipe(0.2), 8, "legendre"), 6.0)
        >>> round(cycle.amplitude, 4), round(cycle.frequency, 3), cycle.stable
        (0.2766, 13.792, True)

    Raises:
        NoCycle: if rest is stable and no cycle comes from an onset, or the search ends
            at rest, in motion without a period, or with no motion at all; the message says which,
            and at which speed the cycle of an onset turns back.
        NotConverged: if a cycle was found, but not to the tolerance; `result` holds it.
        ValueError, TypeError: for bad arguments.

    Source: Doedel, Keller and Kernevez (1991), Numerical analysis and control of bifurcation
    problems (II), for periodic orbits by collocation.
    """
    model = checked_model_in_motion(model, largest=LARGEST_CYCLE, purpose="limit_cycle")
    u = steady_speed("u", u, open_low=True)
    rtol = check.real("rtol", rtol, low=1e-10, high=1e-2)
    samples = check.count("samples", samples, low=9, high=100_000)
    motion = VectorField(model)
    if model.axisymmetric:
        return in_space(motion, limit_cycle(model.planar, u, start, rtol=rtol, samples=samples))
    with one_thread(motion.size):
        orbit, how = cycle_from(motion, u, start)
        found = converged_cycle(motion, orbit, rtol, samples, how)
        _, once = run_through_once(motion, found.orbit, CLOSELY)
        return found if once is found.orbit else converged_cycle(motion, once, rtol, samples, how)


def in_space(motion: VectorField, plane: LimitCycle) -> LimitCycle:
    """The cycle of the planar model as one in three dimensions, with its multipliers there."""
    orbit = plane.orbit
    reasons = map(motion.model.beyond_reach, orbit.starts[:, : orbit.half])
    if why := next(filter(None, reasons), ""):
        what = f"the cycle of a plane at u = {plane.u:g} is none in space"
        raise NotConverged(f"{what}: {why}", plane)
    whole = orbit.in_space(motion.model)
    peak = plane.amplitude, amplitude_of(VectorField(plane.model), orbit)[1]
    with one_thread(motion.size):
        try:
            with np.errstate(divide="ignore", invalid="ignore"):  # of the residual at rest
                found = cycle_on_mesh(
                    *(motion, whole, plane.error, plane.t.size, plane.method), peak=peak
                )
        except NewtonFailed as failure:
            raise NotConverged(f"the cycle at u = {plane.u:g} fails its check: {failure}") from None
    assert found.across is not None
    leaves = (beyond_circle(nontrivial(found.across), found.multiplier_error) > 0.0).any()
    return replace(
        found,
        stable=plane.stable and not leaves,
        residual=plane.residual,
        evaluations=plane.evaluations + found.evaluations,
    )


# ---------------------------------------------------------------------------------- beginnings


def cycle_from(motion: VectorField, u: float, start: Any) -> tuple[PeriodicOrbit, str]:
    """A cycle on a coarse mesh, and how it was found."""
    model = motion.model
    reasons, quiet = list[str](), ""
    if isinstance(start, LimitCycle | Motion):
        check_coordinates(model, "start", start)
        if isinstance(start, LimitCycle) and not start.moves:
            raise ValueError("start must move, got a cycle without amplitude, at a Hopf point")
        try:
            return _near(motion, u, start)
        except NewtonFailed as reason:
            raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None
    if start is None:
        ways, quiet = _ways(motion, u)
    elif isinstance(start, Hopf):
        _check_own(motion, start)
        ways = [(motion, start)]
    else:
        ways = [(motion, state_of(model, "start", start, KINDS))]
    for own, begin in ways:
        try:
            if not isinstance(begin, Hopf | Crossing | None):
                state = state_of(model, "start", begin, KINDS)
                return _simulated(motion, u, state), "simulation"
            onset = begin if isinstance(begin, Hopf) else hopf(own.model, begin)
            leads = onset.amplitude_law * (u - onset.speed) > 0.0 or onset.fold is not None
            if leads or onset is start or onset.criticality == "subcritical":
                orbit = orbit_at_speed(own, onset, u)
                if own is motion:
                    return orbit, f"followed from the onset at u = {onset.speed:.6g}"
                motion.evaluations += own.evaluations
                return solved(motion, orbit, COARSE.tolerance), "followed from a damped pipe's"
        except (NewtonFailed, PipedynError, ValueError) as reason:
            reasons.append(str(reason))
    report = "; ".join(dict.fromkeys(reasons))
    if isinstance(start, Hopf):
        report = f"no limit cycle at u = {u:g} from that start: {report}"
    if quiet:
        why = f" ({report})" if report else ""
        report = (
            f"{quiet}, and no cycle comes from an onset{why}; one far from rest may be found with "
            "start="
        )
    raise NoCycle(report, u)


def _near(motion: VectorField, u: float, start: LimitCycle | Motion) -> tuple[PeriodicOrbit, str]:
    """The cycle near another one, or near the last period of a motion, and how it was found."""
    if isinstance(start, LimitCycle):
        orbit = start.orbit
        symmetric = orbit.symmetric and motion.is_odd(u)
        found = solved_anew(motion, orbit.states, orbit.frequency, u, symmetric, COARSE)
        return found, "from a cycle"
    y = motion.model.from_user(start.q, start.qdot)
    direction = farthest_direction(start.tip)
    x, velocity = start.tip @ direction, start.tip_velocity @ direction
    stretch = Stretch(start.t, y, x, velocity, 1e-6)
    states, frequency = last_period(stretch, LATE_RECURRENCE)
    found = solved_anew(motion, states, frequency, u, False, COARSE, from_samples=True)
    _, found = run_through_once(motion, found, ROUGHLY)
    return as_symmetric(motion, found), "from a motion"


def _ways(motion: VectorField, u: float) -> tuple[list[tuple[VectorField, Any]], str]:
    """Beginnings of the search for a cycle, in order, and why the pipe rests.

    Each is a vector field with a crossing at which its cycles emerge, None for that at the critical
    speed, or with a start of a motion. The sentence says why no motion from near rest ends on a
    cycle; it is empty if one may.
    """
    model = motion.model
    pipe, flutters, unstable = model.pipe, list[Crossing](), True
    with suppress(NotConverged, ValueError):
        at_rest(model, u).require_equilibrium(u)
        found = crossings(model, 1.5 * u)
        before = [c for c in found if c.speed < u]
        unstable = bool(before[-1].unstable_after if before else found.unstable_at_rest)
        flutters = [c for c in found if c.kind == "flutter" and c.speed > 0.0]
        flutters.sort(key=lambda c: abs(c.speed - u))
    ways: list[tuple[VectorField, Any]] = [(motion, one) for one in flutters[:4]]
    if not unstable:
        first = min((c.speed for c in flutters if c.destabilising), default=math.nan)
        where = f": flutter sets in at u = {first:.6g}" if first > u else ""
        return ways, f"the pipe rests stably at u = {u:g}{where}"
    if pipe.beta == pipe.damping == pipe.drag == 0.0 and not model.resisted:
        return ways, (
            f"at u = {u:g} no force depends on velocities, so that volumes in state space are "
            "conserved: no cycle attracts"
        )
    ways.append((motion, slightly_bent(model)))
    if not flutters and pipe.drag > 0.0 and pipe.damping == 0.0:
        # An aspirating pipe without damping has no onset: it is unstable from u = 0 on. As all its
        # modes grow about equally fast, motions take long to reach a cycle that attracts. A chain's
        # motions are cheap; those of other models cost more than following a damped pipe's cycle.
        # The flow feeds the first mode at the rate 2 sqrt(beta) u, and damping takes omega^2 / 2 =
        # 6 times its coefficient, so that flutter sets in at some 0.15 u. For nine of eleven pipes
        # the cycle without damping is then found; with an eighth of the damping branches are long,
        # and it is found for five.
        damped = replace(pipe, damping=0.05 * math.sqrt(pipe.beta) * u)
        way = VectorField(model.with_pipe(damped)), None
        ways.insert(1 if model.linear_cost else 0, way)
    return ways, ""


def _check_own(motion: VectorField, onset: Hopf) -> None:
    """Raises ValueError for an onset of another model."""
    own = onset.model.coordinate_kind == motion.model.coordinate_kind
    with suppress(PipedynError, ValueError):
        if own:
            hopf_point(motion, onset.crossing)
            return
    raise ValueError(f"start must be an onset of the model, got one of {onset.model!r}")


# ------------------------------------------------------------------------ cycles from motions


def _simulated(motion: VectorField, u: float, start: Array) -> PeriodicOrbit:
    """The cycle on which the motion from a state [p, p'] ends, or else one that it has passed."""
    model, none = motion.model, f"no limit cycle at u = {u:g} by simulation"
    most = SEARCH * (SEARCH_FACTOR if model.dof <= 6 else 1)
    near = LATE_RECURRENCE  # right-hand sides may be costly: a cycle is solved for early
    options = MotionOptions(SEARCHED, SEEN, exponents=False, most=most, recurrence=near)
    with count_work() as work:
        cases = [Case(model, Excitation(u), starts={0: start})]
        [case] = motion_ends(model, cases, options)
    number, end = case.ends[0]
    motion.evaluations += work.right_hand_sides
    if isinstance(end, Exception):
        raise NoCycle(f"{none}: {end}", u) from None
    solutions = list(case.solutions)
    if number != NOWHERE:
        solutions.append(case.solutions[number])  # the motion ends on this one, so it comes last
    orbits = [one.orbit for one in solutions if one.orbit is not None]
    if end.ending == "rest":
        away = np.abs(end.end - motion.resting()).max()
        raise NoCycle(f"{none}: it ends in {'rest' if away < 1e-2 else 'a bent pipe at rest'}", u)
    if not orbits:
        raise NoCycle(f"{none}: the motion does not come back to an earlier state", u)
    return as_symmetric(motion, orbits[-1])


def as_symmetric(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The orbit with its mirror symmetry imposed, if it has one up to rounding, else as it is.

    Asymmetry from rounding would be taken for a pitchfork where the branch is followed.
    """
    if not motion.is_odd(orbit.u):
        return orbit
    if np.abs(breaking_part(orbit, "pitchfork")).max() > 1e-6 * orbit.size:
        return orbit
    return solved_anew(motion, orbit.states, orbit.frequency, orbit.u, True, COARSE)


# -------------------------------------------------------------------- the cycle and its errors


def converged_cycle(
    motion: VectorField,
    orbit: PeriodicOrbit,
    rtol: float,
    samples: int,
    how: str,
    solved_to: float = math.inf,
) -> LimitCycle:
    """The cycle, refined until its amplitude and frequency converge and its multipliers are right.

    Args:
        motion: the vector field.
        orbit: orbit near the cycle.
        rtol: tolerance of amplitude and frequency.
        samples: number of states of the cycle that the result holds.
        how: how the cycle was found.
        solved_to: as for `refined_until`.

    Raises:
        NotConverged: if the tolerance is out of reach; `result` holds the cycle as far as it
            converged.
    """
    for k in range(MULTIPLIER_MESHES):
        orbit, peak, error, reason = refined_until(motion, orbit, rtol, solved_to, 0.01**k)
        try:
            result = cycle_on_mesh(motion, orbit, error, samples, how, peak=peak)
        except NewtonFailed as failure:
            raise NotConverged(f"the cycle at u = {orbit.u:g} fails its check: {failure}") from None
        if error > rtol:
            known_to = "on one mesh" if error == math.inf else f"to {error:.1e}"
            raise NotConverged(
                f"the cycle at u = {orbit.u:g} is known {known_to} only: {reason}", result
            )
        # A change of the equations by eps moves a multiplier by eps / d if another lies d away.
        apart = float(np.abs(result.others - 1.0).min(initial=1.0))
        allowed = max(TRIVIAL, min(SHARE_OF_NEXT * apart, TRIVIAL / apart))
        if result.multiplier_error <= max(rtol, allowed):
            return result
        solved_to = math.inf  # the multipliers need a finer mesh
    raise NotConverged(
        f"the cycle at u = {orbit.u:g} fails its check: its Floquet multipliers, one of which "
        f"should be 1, are known to {result.multiplier_error:.1e} only",
        result,
    )


def refined_until(
    motion: VectorField,
    orbit: PeriodicOrbit,
    rtol: float,
    solved_to: float = math.inf,
    finer: float = 1.0,
) -> tuple[PeriodicOrbit, tuple[float, float], float, str]:
    """The orbit on a mesh that is fine enough, its peak, its error, and why refinement failed.

    The peak is as `amplitude_of` gives it. The error is the largest change of amplitude, frequency
    and positions in the last refinement: each of them alone may be the same on both meshes by
    chance. The intervals with a large defect are refined, and all of them if there is none. Where
    forces are smooth, an error of half of rtol is enough. With kinks the remaining defects must be
    rounding as well: halving the intervals at best halves rounding, but reduces a resolved defect
    to an eighth, even at kinks.

    Args:
        motion: the vector field.
        orbit: orbit near the cycle.
        rtol: tolerance of amplitude and frequency.
        solved_to: tolerance with which the given orbit was solved for. If no less is asked for
            here, the orbit's own mesh may do, which one half as fine shows.
        finer: factor of the largest defect that is allowed, below 1 for a finer mesh.
    """
    smooth, tolerance = not motion.model.pipe.has_kinks, min(1e-7, 1e-2 * rtol)
    # Largest defect with which the first answer mostly meets rtol, as the mesh follows kinks.
    largest = finer * rtol * (1e-3 if smooth else 1e-1)
    peak, error, worst = amplitude_of(motion, orbit), math.inf, math.inf

    def change(other: PeriodicOrbit, amplitude: float) -> float:
        moved = np.abs(other.states(PROBES) - orbit.states(PROBES))[: orbit.half].max() / orbit.size
        turned = abs(other.frequency / orbit.frequency - 1.0)
        # Answers of ever finer meshes differ by some 3e-14.
        return max(float(moved), turned, abs(amplitude / peak[0] - 1.0), 1e-13)

    if solved_to <= tolerance and (coarser := joined_in_pairs(motion, orbit)):
        with suppress(NewtonFailed):
            coarser = solved(motion, coarser, tolerance)
            error = change(coarser, amplitude_of(motion, coarser)[0])
    # With kinks two answers may agree by chance: an error falls by at most the fourth power of h.
    last, most = 0.0 if smooth else math.inf, 2
    while True:
        defects = orbit.defects()
        coarse, coarsest, worst = defects > largest, worst, float(defects.max())
        if error <= 0.5 * rtol and (smooth or not coarse.any() or worst > 0.25 * coarsest):
            return orbit, peak, error, ""
        coarse |= not coarse.any()
        # Divided into p parts an interval has about p^-7 of its defect, or more where forces have
        # kinks.
        wanted = max(0.5 * largest, DEFECT_ROUNDING)
        parts = np.ceil((defects / wanted) ** (1.0 / 7.0)).astype(int)
        parts = np.where(coarse, np.clip(parts, 2, most), 1)
        if parts.sum() > MOST_CYCLE_INTERVALS:
            return orbit, peak, error, f"that takes more than {MOST_CYCLE_INTERVALS} mesh intervals"
        try:
            better = solved(motion, refined(motion, orbit, parts, at_kinks=True), tolerance)
        except NewtonFailed as failure:
            return orbit, peak, error, str(failure)
        farthest = amplitude_of(motion, better)
        error = change(better, farthest[0])
        orbit, peak, most = better, farthest, 4 if smooth else 2
        error, last = max(error, last / 16.0), error


def amplitude_of(motion: VectorField, orbit: PeriodicOrbit) -> tuple[float, float]:
    """Half the peak-to-peak transverse motion of the free end, and the phase of its largest x.

    In three dimensions x is along the direction in which the free end moves farthest.
    """
    return extent_along(motion, orbit, tip_direction(motion, orbit))


def amplitude_across(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """Half the peak-to-peak motion of the free end across the direction of `amplitude_of`."""
    if motion.model.dimensions == 2:
        return 0.0
    x, _, z = tip_direction(motion, orbit)
    return extent_along(motion, orbit, np.array([-z, 0.0, x]))[0]


def tip_direction(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Direction across the pipe in which the free end moves farthest, a unit vector."""
    if motion.model.dimensions == 2:
        return np.array([1.0, 0.0])
    return motion.end_across(orbit.states(PROBES))[0]


def extent_along(
    motion: VectorField, orbit: PeriodicOrbit, direction: Array
) -> tuple[float, float]:
    """Half the peak-to-peak motion of the free end along a direction, and the phase of its peak."""
    size = motion.model.dimensions
    # Samples are as close as the mesh requires: a period may have a dozen peaks.
    phases, y = orbit.sampled(SAMPLES_A_STAGE * orbit.rates.shape[1])
    tips, velocities = np.split(motion.end(y), 2)
    across, velocity = direction @ tips, direction @ velocities
    # Between two samples a peak rises by some thousandths at most: lower ones are left out.
    middle = 0.0 if orbit.symmetric else 0.5 * (across.max() + across.min())
    heights = np.abs(across - middle)
    turns = (velocity[:-1] > 0.0) != (velocity[1:] > 0.0)
    before = np.flatnonzero(turns & (heights[:-1] >= 0.9 * heights.max()))
    peaks = zeros_between(
        lambda phase: direction @ motion.end(orbit.states(phase))[size:],
        *(phases[before], phases[before + 1], velocity[before], velocity[before + 1]),
    )
    phases = np.append(phases, peaks)
    across = np.append(across, direction @ motion.end(orbit.states(peaks))[:size])
    if not orbit.symmetric:
        return 0.5 * float(np.ptp(across)), float(phases[np.argmax(across)])
    farthest = int(np.argmax(np.abs(across)))  # if to negative x, the mirror image comes later
    later = 0.0 if across[farthest] > 0.0 else orbit.span
    return float(np.abs(across[farthest])), float(phases[farthest]) + later


def one_period(
    motion: VectorField, orbit: PeriodicOrbit, samples: int, first: float = 0.0
) -> tuple[Array, Array, Array]:
    """Times over one period, (S,), and coordinates and rates of a user there, (S, coordinates).

    Time 0 has the phase `first`.
    """
    t = np.linspace(0.0, 2.0 * math.pi / orbit.frequency, samples)
    y = orbit.states(first + orbit.frequency * t)
    q, qdot = motion.model.to_user(y[: motion.half].T.copy(), y[motion.half :].T.copy())
    return t, np.ascontiguousarray(q), np.ascontiguousarray(qdot)


def on_branch(
    motion: VectorField, orbit: PeriodicOrbit, error: float, samples: int, how: str
) -> LimitCycle:
    """The cycle of an orbit on a branch: its error is given, its multipliers are checked.

    If forces have kinks, multipliers need a mesh with points at the kinks.
    """
    plain: LimitCycle | None = None

    def of(orbit: PeriodicOrbit) -> LimitCycle:
        return cycle_on_mesh(motion, orbit, error, samples, how, ON_BRANCH)

    if not (motion.model.pipe.has_kinks and motion.model.kinks_known):
        plain = of(orbit)
        if plain.multiplier_error <= 1e-4:  # a tenth of the error that ends a branch
            return plain
    with suppress(NewtonFailed):  # if motions nearby diverge fast a finer mesh is needed
        finer = refined(motion, orbit, np.full(len(orbit.starts), 2), at_kinks=True)
        better = of(solved(motion, finer, 1e-9, iterations=8))
        if plain is None or better.multiplier_error < plain.multiplier_error:
            return better
    return of(orbit) if plain is None else plain


def cycle_on_mesh(
    motion: VectorField,
    orbit: PeriodicOrbit,
    error: float,
    samples: int,
    how: str,
    tolerance: float = MULTIPLIER_TOLERANCE,
    peak: tuple[float, float] | None = None,
) -> LimitCycle:
    """The cycle of an orbit on its mesh; raises `NewtonFailed` as `multipliers_by_plane` does.

    peak: what `amplitude_of` gives, if it is known.
    """
    amplitude, first = peak or amplitude_of(motion, orbit)
    t, q, qdot = one_period(motion, orbit, samples, first)
    planes, change = multipliers_by_plane(motion, orbit, tolerance)
    multipliers, _ = all_multipliers(planes)
    # Rounding of the eigenvalues of matrices of this size leaves about as much.
    change = max(change, multipliers.size * float(np.finfo(float).eps))
    return LimitCycle(
        amplitude=amplitude,
        frequency=orbit.frequency,
        period=float(t[-1]),
        multipliers=multipliers,
        stable=not (beyond_circle(nontrivial(multipliers), change) > 0.0).any(),
        t=t,
        q=q,
        qdot=qdot,
        u=orbit.u,
        model=motion.model,
        error=error,
        multiplier_error=max(float(np.abs(multipliers - 1.0).min()), change),
        residual=residual(motion, orbit),
        symmetric=orbit.symmetric,
        phases=orbit.rates.shape[0] * orbit.rates.shape[1],
        evaluations=motion.evaluations,
        method=f"collocation, {how}",
        orbit=orbit,
        across=planes[1][0] if len(planes) == 2 else None,
    )
