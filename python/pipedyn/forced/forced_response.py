# SPDX-License-Identifier: MIT
"""Periodic motions of finite amplitude of a pipe that a base, a force or a flow drives.

They are found by collocation, as limit cycles are, but with the period given and no condition on
the phase, and are followed in the frequency past folds. With a base that moves across the pipe or
a force, a branch begins near the linear response. In a pulsating flow, and if the base moves along
a straight pipe, rest is a motion, too; other motions branch off it on the edges of parametric
regions, with the period of the forcing (harmonic) or twice that (subharmonic).

In three dimensions motions in the plane z = 0 or x = 0 are solved for by the same equations, whose
derivatives do not couple this plane with motions across it. Where one of the latter passes the unit
circle on the real axis, a branch of motions that leave the plane begins. From motions that lie in
no plane, branches of motions with less symmetry or twice the period begin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import field, replace
from functools import partial
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.attraction.motion_ends import Case, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.continuation.arclength import Point
from pipedyn.continuation.tracer import Tracer, between_folds, special_points
from pipedyn.cycles.limit_cycle import (
    PeriodicMotion,
    amplitude_across,
    amplitude_of,
    as_symmetric,
    one_period,
    refined_until,
)
from pipedyn.forced.parametric_search import regions
from pipedyn.forced.pulsating import Hill, PulsatingPipe, ShakenPipe, require_motion
from pipedyn.linear.frequency_response import base_solution, checked_range, harmonic_solution
from pipedyn.linear.modes import largest_speed
from pipedyn.linear.rest import at_rest
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model
from pipedyn.models.drive import (
    Force,
    Harmonic,
    Pulsation,
    checked_periodic_force,
    require_steady,
    steady_speed,
)
from pipedyn.models.space import SpatialModel
from pipedyn.motion.simulate import checked_model_in_motion
from pipedyn.motion.vector_field import Excitation, ForcedField
from pipedyn.orbits.collocation import Linearised, OrbitProblem, residual
from pipedyn.orbits.floquet import (
    CircleTest,
    EventKind,
    all_multipliers,
    beyond_circle,
    circle_margin,
    multipliers_by_plane,
    orbit_multipliers,
    uncoupled,
)
from pipedyn.orbits.orbit_continuation import (
    FINE,
    FIRST_AMPLITUDE,
    NEAR_FOLD,
    BranchStart,
    Grazing,
    Step,
    from_branch_point,
    from_orbit,
    meeting,
    orbit_at,
    solved_anew,
    steps_past_grazing,
)
from pipedyn.orbits.periodic_orbit import (
    PeriodicOrbit,
    coarsest_mesh,
    divided,
    stage_phases,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_work
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import Progress, one_thread, share_of_way
from pipedyn.util.result import Result, TableResult, join_tables

FORCED_DOF = 60
"""Largest number of degrees of freedom: with 20 of them a motion takes some 0.1 s, and a branch has
some 50 motions."""

MOST_STEPS = 400
"""Largest number of steps along a branch. The longest steps are 0.15 in amplitude or in the
relative frequency."""

SETTLING = 10
"""Number of periods after which a motion from rest is recorded for as many periods; if it comes
nearer to a motion that repeats, it is followed for 160 of them."""

REACH = 10.0
"""Amplitude by which steps are measured, as a multiple of that of the first motion of a moving base
or a force. It is 1 L at most, as resonances that a stop or a fixed end bends over may be small."""

FORCE_HARMONICS = 16
"""Number of harmonics of a force in the linear response from which Newton's method starts."""

HARMONICS = 8
"""Number of harmonics in Hill's equations for the motions in which branches leave rest."""


# -------------------------------------------------------------------------------------- results

BranchKind = Literal["base", "force", "subharmonic", "harmonic", "out of plane", "offshoot"]

FROM_REST = ("subharmonic", "harmonic")
"""Kinds of branches that leave rest."""


@saved_as("ForcedMotion", added=("amplitude_across", "across"))
class ForcedMotion(PeriodicMotion):
    """One period of a periodic motion under a periodic forcing.

    Attributes:
        amplitude: half the peak-to-peak transverse motion of the free end relative to the base,
            in L; in three dimensions along the direction in which it moves farthest.
        frequency: angular frequency of the forcing, in 1 / T.
        period: period of the motion, in T: one of the forcing, or two if it is subharmonic.
        multipliers: Floquet multipliers over this period, complex, shape (2 dof,), the largest
            modulus first.
        stable: whether no multiplier's modulus exceeds 1 by more than 1e-6 or three times its
            error. Without damping they have the modulus 1: nearby motions neither grow nor decay.
            In three dimensions a multiplier is 1 if the forcing is along the axis, that of the
            motion turned about the axis.
        t: times from a crest of the forcing to the period, shape (S,).
        q, qdot: coordinates and rates, shape (S, coordinates).
        u: flow speed, or the pulsation.
        error: relative error of the amplitude, estimated by refinement.
        residual: largest |dy/dt - f(y)| half-way between the stages at which the equations were
            solved, relative to the largest |f|, of the accelerations.
        model: the model.
        orbit: the solution of the collocation equations.
        amplitude_across: half the peak-to-peak motion of the free end across the direction of
            `amplitude` and the axis, in L: 0 for motions in a plane.
        across: those multipliers, shape (dof,), whose perturbations leave the plane of a motion in
            the plane z = 0 or x = 0 of three dimensions; None for other motions.
    """

    u: float | Pulsation
    amplitude_across: float = 0.0
    across: Complex | None = field(default=None, repr=False)


@saved_as("ForcedEvent", added=("across",))
class ForcedEvent(Result):
    """Event at which a branch of forced motions changes.

    Attributes:
        kind: "fold", where the frequency turns back; "pitchfork", "period doubling" or "torus",
            where a multiplier passes the unit circle; "branch point", where one passes 1 along
            motions that lie in no plane; "grazing", where the motion begins or ceases
            to touch a stop; or "end", where the branch left its range, came to rest or to the plane
            from which it came, or was lost, as the branch's `failure` says.
        frequency: angular frequency of the forcing, in 1 / T.
        amplitude: amplitude of the free end, in L.
        across: whether the multiplier belongs to perturbations that leave the plane of the motion.
    """

    kind: EventKind
    frequency: float
    amplitude: float
    across: bool = False


@saved_as("ForcedBranch", added=("amplitude_across", "azimuth"))
class ForcedBranch(TableResult):
    """Motions along one branch, in the order in which it was followed, with those at its events.

    Attributes:
        kind: "base" with a moving base, "force" with a force; "subharmonic" or "harmonic" for a
            branch that leaves rest, in a pulsating flow or with a base that moves along the pipe;
            "out of plane" for a branch of motions in three dimensions that leave the plane of
            another branch; "offshoot" for one of motions in no plane that leave another branch of
            such motions where it loses its symmetry or doubles its period.
        frequency: angular frequency of the forcing, in 1 / T, shape (P,).
        amplitude: half the peak-to-peak transverse motion of the free end relative to the base, in
            L, shape (P,).
        largest: modulus of the largest multiplier, shape (P,); 1 at events and in rest.
        stable: whether that modulus is at most 1 within its error, as for a `ForcedMotion`, and
            False at events, shape (P,).
        events: events, in the order in which the branch meets them.
        failure: where the branch was lost, and why; None where it left its range, came to rest or
            to the plane from which it came.
        amplitude_across: in three dimensions half the peak-to-peak motion of the free end across
            the direction of `amplitude`, in L, shape (P,); None in a plane.
        azimuth: angle from x towards z, in rad, by which the motions of `at` are turned from those
            that were solved for, in the plane z = 0.
    """

    kind: BranchKind
    frequency: Array = field(repr=False)
    amplitude: Array = field(repr=False)
    largest: Array = field(repr=False)
    stable: NDArray[np.bool_] = field(repr=False)
    events: tuple[ForcedEvent, ...]
    failure: NotConverged | None
    steps: tuple[Step, ...] = field(repr=False, compare=False)
    motion: ForcedField = field(repr=False, compare=False)
    amplitude_across: Array | None = field(default=None, repr=False)
    azimuth: float = field(default=0.0, repr=False)

    def at(self, frequency: float, rtol: float = 1e-6, samples: int = 257) -> list[ForcedMotion]:
        """Motions of the branch at a frequency of the forcing.

        Their amplitudes are computed to the relative tolerance `rtol`, their states at `samples`
        times.
        """
        omega = check.real("frequency", frequency, low=0.0, open_low=True) / self.motion.order
        found = list[ForcedMotion]()
        with one_thread(self.motion.size):
            for step in self.steps:
                # A step is taken to turn at most a tenth of its range beyond its cubic.
                passed = [step.guess(s, -1) for s in np.linspace(0.0, step.length, 9).tolist()]
                if abs(omega - 0.5 * (max(passed) + min(passed))) > 0.6 * np.ptp(passed):
                    continue
                try:
                    for part in between_folds(step, 1e-4) if np.prod(step.slopes) < 0.0 else [step]:
                        ahead = part.end.p - omega
                        if ahead != 0.0 and (part.begin.p - omega) * ahead <= 0.0:
                            orbit = step.problem.orbit(part.where(omega))
                            given = orbit, rtol, samples, self.azimuth
                            found.append(_refined_motion(self.motion, *given))
                except NewtonFailed as reason:
                    raise NotConverged(
                        f"no motion was found at a frequency of {frequency:g} though the "
                        f"{self.kind} branch passes it: {reason}"
                    ) from None
        return found

    def _columns(self) -> dict[str, Any]:
        across = self.amplitude_across
        return {
            "frequency": self.frequency,
            "amplitude": self.amplitude,
            **({} if across is None else {"amplitude_across": across}),
            "largest": self.largest,
            "stable": self.stable,
        }


@saved_as("ForcedResponse", added=("frequencies",))
class ForcedResponse(TableResult):
    """Periodic motions over the frequency of the forcing.

    Attributes:
        branches: branches, each followed from one end. If the branch of a moving base or a force
            was lost on the way from the lowest frequency, another one begins at the highest. In
            three dimensions each is followed by those that leave its plane and by offshoots. No
            branch is followed from these in turn, nor from an event "torus" or "branch point", nor
            from a "pitchfork" or "period doubling" of motions that stay in their plane or precess.
        forcing: amplitude and direction of the base's motion, or mean and amplitude of the flow's,
            or the force.
        u: flow speed, in a pulsating flow its mean.
        model: the model.
        evaluations: number of right-hand sides and Jacobians.
        frequencies: range of the forcing's angular frequency that was asked for, in 1 / T, shape
            (2,); None in a result of an older version.
    """

    branches: tuple[ForcedBranch, ...]
    forcing: Pulsation | Harmonic | Force
    u: float
    model: Model
    evaluations: int
    frequencies: Array | None = field(default=None, repr=False)

    @property
    def failures(self) -> tuple[Failure, ...]:
        """Branches that were lost: their index, the frequency at which they were lost, and why."""
        return tuple(
            Failure(i, float(branch.frequency[-1]), branch.failure)
            for i, branch in enumerate(self.branches)
            if branch.failure is not None
        )

    def at(self, frequency: float, rtol: float = 1e-6, samples: int = 257) -> list[ForcedMotion]:
        """Motions at a frequency of the forcing, the largest first.

        If there are `failures`, there may be more motions.

        Args:
            frequency: angular frequency, in 1 / T, within the range in which branches are followed.
            rtol: relative tolerance of the amplitude, in [1e-10, 1e-2].
            samples: number of states of each motion, from the start of the period to its end.

        Raises:
            NotConverged: if a motion does not meet the tolerance, or there is none and a branch was
                lost.
            ValueError, TypeError: for bad arguments.
        """
        rtol = check.real("rtol", rtol, low=1e-10, high=1e-2)
        samples = check.count("samples", samples, low=9, high=100_000)
        found = [one for branch in self.branches for one in branch.at(frequency, rtol, samples)]
        if not found and self.failures:
            why = "; ".join(str(failure.error) for failure in self.failures)
            raise NotConverged(f"no motion is known at a frequency of {frequency:g}: {why}")
        return sorted(found, key=lambda one: -one.amplitude)

    def _columns(self) -> dict[str, Any]:
        tables = [one._columns() for one in self.branches]
        kinds = [one.kind for one in self.branches]
        return join_tables(tables, branch=range(len(kinds)), kind=kinds)


def forced_response(
    model: Model,
    u: float | Pulsation,
    *,
    base: Harmonic | None = None,
    force: Force | None = None,
    frequencies: ArrayLike | None = None,
    progress: bool = False,
) -> ForcedResponse:
    """Periodic motions of finite amplitude over the frequency of the forcing, stable or not.

    Args:
        model: chain, reduced model or scene, up to 60 degrees of freedom. In three dimensions
            motions of a base or force in the plane z = 0 or x = 0 are followed in this plane, with
            their stability also across it, and then the branches that leave the plane. Motions that
            lie in no plane have offshoots, where they lose their symmetry or double their period.
        u: flow speed >= 0; or a `Pulsation`, whose mean and amplitude stay while its frequency
            varies. Then motions branch off from rest at the edges of parametric regions, and the
            pipe must be stable at the mean speed.
        base: a `Harmonic` motion of the base, whose amplitude stays while its frequency varies.
            Along "y" it leaves a straight pipe at rest, as a pulsating flow does.
        force: a `Force` with a frequency, which varies while the force stays the same function of
            its phase. Of base, force and a pulsating flow one must be given.
        frequencies: range (low, high) of the forcing's angular frequency, low > 0, or several
            frequencies in increasing order, of which the first and last are the range. Default: 1 %
            about the frequency of base, force or pulsation.
        progress: show progress on stderr.

    Returns:
        ForcedResponse; `at(frequency)` gives the motions at one frequency, with their error. A
        branch that is lost is named in `failures`, and the part of it that was found is kept.

    Example:
        >>> model = pp.Galerkin(pp.Pipe(0.2, damping=0.002), 4)
        >>> shaken = pp.Harmonic(0.02, frequency=13.5, direction="x")
        >>> found = pp.forced_response(model, 5.0, base=shaken, frequencies=(13.0, 14.0))
        >>> len(found.branches)
        1
        >>> push = pp.Force(at=0.5, frequency=13.5, amplitude=0.5)
        >>> found = pp.forced_response(model, 5.0, force=push)
        >>> [round(motion.amplitude, 3) for motion in found.at(13.5)]
        [0.06]

        A hose that is shaken in a plane may whirl where its motion in the plane is unstable:

        >>> model = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.002), 2, dimensions=3)
        >>> shaken = pp.Harmonic(0.01, frequency=5.0)
        >>> found = pp.forced_response(model, 0.1, base=shaken)
        >>> [(one.stable, round(one.amplitude_across, 3)) for one in found.at(5.0)]
        [(False, 0.0), (True, 0.07)]

    Raises:
        NotConverged: if no motion of a moving base or a force is found at either end of the range,
            neither from the linear response nor by motions from rest that are left to settle.
        ValueError, TypeError: for bad arguments.

    Source: Doedel, Keller and Kernevez (1991), as for `limit_cycle`; Nayfeh and Mook (1979),
    Nonlinear oscillations, for typical responses.
    """
    model = checked_model_in_motion(model, largest=FORCED_DOF, purpose="forced_response")
    forcing = _checked_forcing(u, base, force, model.dimensions)
    mean = forcing.mean if isinstance(forcing, Pulsation) else u
    speed = steady_speed("u", mean, high=largest_speed(model))
    if frequencies is None:
        assert forcing.frequency is not None
        low, high = 0.99 * forcing.frequency, 1.01 * forcing.frequency
    else:
        low, high = checked_range(frequencies)
        if low == 0.0:
            raise ValueError(f"frequencies must have low > 0, got {check.shown(frequencies)}")
    shown = check.flag("progress", progress)
    branches = list[ForcedBranch]()
    model = at_rest(model, speed)
    model.require_equilibrium(speed)
    driving, azimuth = forcing, 0.0
    if model.axisymmetric and not isinstance(driving, Pulsation):
        driving, azimuth = driving.in_plane()
    if isinstance(driving, Pulsation):
        require_motion(model)
        starts = _from_rest(model, speed, driving, low, high)
    elif model.rests_bent or not _is_axial(ForcedField(model, driving, 1)):
        starts = _from_base(model, speed, driving, low, high)
    elif isinstance(driving, Harmonic):
        starts = _from_rest(model, speed, driving, low, high)
    else:
        raise ValueError(
            "force must act across the straight pipe, which a force along it leaves at rest"
        )
    with one_thread(2 * model.integrated):
        for begun in starts:
            if begun.is_end_of(branches):
                continue  # the branch was followed to here from the region's other edge
            branches.append(begun.branch(shown))
            for leaving in begun.offshoots():
                if not leaving.is_end_of(branches):
                    branches.append(leaving.branch(shown))
    branches = [replace(branch, azimuth=azimuth) for branch in branches]
    return ForcedResponse(
        branches=tuple(branches),
        forcing=forcing,
        u=speed,
        model=model,
        evaluations=sum(one.motion.evaluations for one in branches),
        frequencies=np.array([low, high]),
    )


def _is_axial(motion: ForcedField) -> bool:
    """Whether a straight pipe stays at rest under the forcing: whether this is along its axis."""
    forces = motion.along(np.linspace(0.0, 2.0 * math.pi, 17), 1.0)(
        np.zeros((motion.size, 17)), 0.0
    )
    return not forces.any()


def _checked_forcing(
    u: Any, base: Any, force: Any, dimensions: int
) -> Pulsation | Harmonic | Force:
    """The forcing that the arguments describe; raises ValueError or TypeError if they are bad."""
    if isinstance(u, Pulsation):
        for name, given in (("base", base), ("force", force)):
            if given is not None:
                raise ValueError(f"{name} must not be given where the flow pulsates")
        if u.amplitude == 0.0 or abs(u.amplitude) == 1.0:
            raise ValueError(f"u.amplitude must be between 0 and 1, got {u.amplitude!r}")
        return replace(u, amplitude=abs(u.amplitude))
    require_steady("u", u)
    if force is not None:
        if base is not None:
            raise ValueError("force must not be given where the base moves")
        return checked_periodic_force(force, dimensions)
    if not isinstance(base, Harmonic):
        raise TypeError(
            f"base must be a Harmonic or u a Pulsation, got {check.shown(base)}; or give a force"
        )
    base.require_dimensions(dimensions)
    if base.amplitude == 0.0:
        raise ValueError("base must move, got an amplitude of 0")
    return base


# ----------------------------------------------------------------------------------- beginnings


def _from_base(
    model: Model, u: float, forcing: Harmonic | Force, low: float, high: float
) -> Iterator[_ForcedTracer]:
    """Beginnings of branches of a moving base or a force: at the lowest, maybe the highest end.

    The second is needed if the first branch, which the caller follows, was lost.

    Raises:
        NotConverged: if no motion is found at either.
    """
    failed = list[str]()
    kind: BranchKind = "base" if isinstance(forcing, Harmonic) else "force"
    for frequency, way in ((low, 1.0), (high, -1.0)):
        motion = ForcedField(model, replace(forcing, frequency=frequency), 1)
        try:
            orbit = _first_motion(motion, u)
            motion.reach = min(1.0, REACH * amplitude_of(motion, orbit)[0])
            (start,) = from_orbit(motion, orbit, (way,))
        except NewtonFailed as reason:
            failed.append(f"at a frequency of {frequency:g} {reason}")
            continue
        begun = _ForcedTracer(kind, motion, start, (low, high))
        yield begun
        if begun.lost is None:
            return
    if len(failed) == 2:
        raise NotConverged(
            f"no periodic motion was found to begin with: {'; '.join(failed)}. Give other "
            "frequencies, that begin or end far from resonances, or a smaller amplitude of "
            f"{kind}; simulate shows whether motions repeat at all"
        )


def _first_motion(motion: ForcedField, u: float) -> PeriodicOrbit:
    """A periodic motion at the frequency of a moving base or a force.

    Newton's method starts from the linear response; where that fails, from the linear response to a
    small amplitude of the forcing, which then grows; and at last from where a motion from rest
    ends.

    Raises:
        NewtonFailed: if none of these leads to a motion.
    """
    whole, model, w = motion.forcing, motion.model, motion.forcing.frequency
    assert not isinstance(whole, Pulsation)
    assert w is not None
    harmonics = _linear_response(motion, u, w)
    rest = np.append(motion.resting()[: model.integrated], np.zeros(model.integrated))
    symmetric = motion.is_odd(u)

    def linear(share: float, phase: Array) -> Array:
        states = np.repeat(rest[:, None], phase.size, axis=1)
        for order, answer in harmonics.items():
            mode = share * whole.amplitude * np.concatenate([answer, 1j * order * w * answer])
            states += (mode[:, None] * np.exp(1j * order * phase)).real
        return states

    def grown(shares: list[float]) -> PeriodicOrbit:
        """The motion for the last share of the amplitude, by way of those for the others."""
        states: Callable[[Array], Array] = partial(linear, shares[0])
        for share in shares:
            weaker = copy(motion)  # which counts its evaluations as the motion's
            weaker.forcing = replace(whole, amplitude=share * whole.amplitude)
            weaker.base = weaker.forcing if isinstance(weaker.forcing, Harmonic) else None
            for _ in range(4):  # its own harmonics may be higher than those of the states
                orbit = solved_anew(weaker, states, w, u, symmetric, FINE)
                states = orbit.states
                if orbit.defects().max() <= FINE.defect:
                    break
        return orbit

    for shares in ([1.0], np.geomspace(0.02, 1.0, 10).tolist()):
        with suppress(NewtonFailed):
            return grown(shares)
    return _settled(motion, u)


def _linear_response(motion: ForcedField, u: float, w: float) -> dict[int, Complex]:
    """Complex coordinates p of small motions at multiples of a frequency, for an amplitude of 1."""
    model, forcing = motion.model, motion.forcing
    if isinstance(forcing, Harmonic):
        vector = forcing.vector / forcing.amplitude
        return {1: model.by_coordinates() @ base_solution(model, u, w, vector)}
    phases = np.linspace(0.0, 2.0 * math.pi, 4 * FORCE_HARMONICS, endpoint=False)
    series = np.fft.rfft(motion.force_numbers(phases), axis=1) / phases.size
    series[:, 1:] *= 2.0
    found = {}
    for order in range(FORCE_HARMONICS + 1):
        if np.abs(series[:, order]).max() > 1e-12 * np.abs(series).max():
            answer = harmonic_solution(model, u, order * w, series[:, order])
            found[order] = model.by_coordinates() @ answer
    return found


def _settled(motion: ForcedField, u: float) -> PeriodicOrbit:
    """The periodic motion on which a motion from rest ends.

    Raises:
        NewtonFailed: if it does not repeat with the period of the forcing, or stops.
    """
    model, forcing = motion.model, motion.forcing
    if isinstance(forcing, Harmonic):
        drive, name = Excitation(u, forcing), "base"
    else:
        assert isinstance(forcing, Force)
        drive, name = Excitation(u, force=forcing), "force"
    time = SETTLING * drive.period
    options = MotionOptions(drive.whole(time), drive.whole(max(time, 1.0)), exponents=False)
    begun = Case(model, drive, starts={0: motion.resting()})
    with count_work() as work:
        [case] = motion_ends(model, [begun], options)
    motion.evaluations += work.right_hand_sides
    number, end = case.ends[0]
    orbit = case.solutions[number].orbit if number >= 0 else None
    frequency = 2.0 * math.pi / drive.period
    if orbit is None or not math.isclose(orbit.frequency, frequency, rel_tol=1e-6):
        why = end if isinstance(end, Exception) else f"it was not found to repeat with the {name}"
        raise NewtonFailed(f"a motion from rest leads to none: {why}")
    return as_symmetric(motion, orbit)


def _from_rest(
    model: Model, mean: float, forcing: Pulsation | Harmonic, low: float, high: float
) -> Iterator[_ForcedTracer]:
    """Beginnings of branches from rest, on edges of parametric regions.

    In three dimensions they lie in the plane z = 0, which stands for all planes through the axis;
    if terms differ in x and z, also in the plane x = 0.
    """
    flows, amplitude = isinstance(forcing, Pulsation), abs(forcing.amplitude)
    planes = model.planes[: 1 if model.axisymmetric else 2] or (model,)
    kinds: tuple[tuple[BranchKind, int], ...] = (("subharmonic", 2), ("harmonic", 1))
    for which, plane in enumerate(planes):
        if flows:
            pipe = PulsatingPipe.of(plane.elastic_operators(), mean)
        else:
            pipe = ShakenPipe.shaken(plane, mean)
        pipe.require_stable(high, "mean" if flows else "u")
        hill = Hill(pipe, HARMONICS)
        for kind, order in kinds:
            rests = hill.edges(0.5 * (order - 1), amplitude, high)
            for region in regions(hill, np.array([amplitude]), low, high, (kind,)):
                ends = region.edges[0][np.isfinite(region.edges[0])]
                window = 0.9 * min(low, ends.min()), 1.1 * max(high, ends.max())
                for edge in ends.tolist():
                    motion = ForcedField(model, replace(forcing, frequency=edge), order)
                    start = _leaving_rest(motion, mean, which)
                    yield _ForcedTracer(kind, motion, start, window, rests)


def _leaving_rest(motion: ForcedField, mean: float, which: int) -> BranchStart:
    """First step from rest, towards the motion that neither grows nor decays on an edge.

    Args:
        motion: equations of motion at the edge.
        mean: mean flow speed.
        which: 0 for motions in the plane z = 0, and 1 in three dimensions for those across it.
    """
    coarse = coarsest_mesh(motion.is_odd(mean))
    edges = divided(coarse, np.full(coarse.size - 1, 3))
    states = np.zeros((edges.size - 1, motion.size))
    rates = np.zeros((*stage_phases(edges).shape, motion.half))
    assert motion.forcing.frequency is not None
    w = motion.forcing.frequency / motion.order
    rest = PeriodicOrbit(edges, states, rates, w, mean, True)
    plane = uncoupled(motion, rest)[which]
    towards = Linearised(motion, rest, (0.0 * rest.packed(), 0.0)).neutral(1.0, plane)
    small = rest.unpacked(rest.packed() + 1e-6 * towards)
    scale = 1e-6 * FIRST_AMPLITUDE / max(amplitude_of(motion, small)[0], 1e-300)
    return BranchStart(rest, scale * towards, (0.98 * w, 1.02 * w))


# -------------------------------------------------------------------------- following branches


class _ForcedPoint(NamedTuple):
    """A point of a branch; at events and in rest its multiplier is 1 and it is not stable."""

    frequency: float
    amplitude: float
    largest: float = 1.0
    stable: bool = False
    across: float = 0.0


def _point_of_orbit(motion: ForcedField, orbit: PeriodicOrbit) -> _ForcedPoint:
    multipliers, _, error = orbit_multipliers(motion, orbit)
    amplitude, largest = amplitude_of(motion, orbit)[0], float(np.abs(multipliers).max())
    stable = not (beyond_circle(multipliers, error) > 0.0).any()
    across = amplitude_across(motion, orbit)
    return _ForcedPoint(motion.order * orbit.frequency, amplitude, largest, stable, across)


class _Passing(NamedTuple):
    """An event on a step: where, its kind, the root that passes, and whether it is across.

    A root is across if its perturbations leave the plane of the motion.
    """

    s: float
    kind: EventKind
    root: complex = 1.0
    across: bool = False


def _events_on(step: Step, motion: ForcedField) -> Iterator[_Passing]:
    """Events of the motions on a step, each after the arc length right beyond it.

    Without damping other multipliers lie on the unit circle, and one that leaves it gradually as
    the amplitude grows makes no event. Folds are found by the tangent. Motions in the plane z = 0
    of three dimensions have two tests, of multipliers in it and across it.
    """
    passings, known = dict[tuple[str, float], _Passing](), dict[bytes, Any]()

    def multipliers(point: Point) -> tuple[list[tuple[Complex, Complex]], float]:
        key = point.z.tobytes()
        if key not in known:
            known[key] = multipliers_by_plane(motion, step.problem.orbit(point.z))
        return known[key]

    def test_of(which: int) -> CircleTest:
        """The test of multipliers in the plane (0) or across it (1)."""

        def values(point: Point) -> Array:
            return beyond_circle(multipliers(point)[0][which][0], error)

        def roots(s: float) -> Complex:
            return multipliers(step.at(s))[0][which][1]

        def name(before: float, beyond: float) -> str:
            outside = max(before, beyond, key=test.positive)
            passing = test.positive(outside) - 1
            ends = [abs(test.at(s)[passing] + margin) for s in (0.0, step.length)]
            if min(ends) <= margin and test.at(outside)[passing] < margin:
                return ""
            kind = test.kind(before, beyond)
            root = complex(roots(beyond)[passing])
            if kind == "fold" and which == 1:  # the tangent lies in the plane: it shows no such one
                kind = "pitchfork"
            elif kind == "fold" and motion.model.dimensions == 3 and len(tests) == 1:
                kind = "branch point"  # away from folds
            passings[kind, beyond] = _Passing(beyond, kind, root, which == 1)
            return "" if kind == "fold" else kind

        test = CircleTest(step, 1e-3 * step.length, values, name, {}, NEAR_FOLD, roots=roots)
        return test

    (first, before), (last, after) = map(multipliers, (step.begin, step.end))
    error = max(before, after)
    margin = math.log1p(circle_margin(error))
    tests = [test_of(which) for which in range(min(len(first), len(last)))]
    for kind, _, s in special_points(step, 1e-4, tests):
        yield passings.get((kind, s)) or _Passing(s, cast(EventKind, kind))


class _ForcedTracer(Tracer[OrbitProblem]):
    """Tracer of the branch from a start, until its frequency leaves its window or it rests.

    Args:
        kind: kind of the branch.
        motion: equations of motion along the branch.
        start: the motion at which the branch begins, with its first step.
        window: range of forcing frequencies within which the branch is followed.
        rests: forcing frequencies at which branches of this kind meet rest or other branches,
            rising, shape (E,).
        meets: kinds of meetings with these, as for `breaking_part`.
    """

    def __init__(
        self,
        kind: BranchKind,
        motion: ForcedField,
        start: BranchStart,
        window: tuple[float, float],
        rests: ArrayLike = (),
        meets: Sequence[str] = ("hopf",),
    ) -> None:
        super().__init__(most=MOST_STEPS)
        self.kind, self.motion, self.start, self.window = kind, motion, start, window
        self.rests, self.meets = np.array(rests), meets
        self.from_rest, self.leaves = kind in FROM_REST, kind not in ("base", "force")
        self.points, self.events = list[_ForcedPoint](), list[ForcedEvent]()
        self.steps = list[Step]()
        self.forks = list[tuple[_Passing, PeriodicOrbit]]()
        self.lost: NotConverged | None = None
        if not self.leaves:
            self.points.append(_point_of_orbit(motion, start.orbit))
        else:
            self._joins(start.orbit)

    def is_end_of(self, branches: Iterable[ForcedBranch]) -> bool:
        """Whether a branch of the same kind ended where this one begins."""
        near, first = 1e-6 if self.from_rest else 1e-3, self.points[0]
        return any(
            one.kind == self.kind
            and one.failure is None
            and abs(one.frequency[-1] / first.frequency - 1.0) < near
            and abs(one.amplitude[-1] - first.amplitude) < near
            for one in branches
        )

    def offshoots(self) -> Iterator[_ForcedTracer]:
        """Branches that leave this one at its forks."""
        met = [self.motion.order * orbit.frequency for _, orbit in self.forks]
        for passing, orbit in self.forks:
            motion, start = _leaving(self.motion, orbit, passing)
            kind: BranchKind = "out of plane" if passing.across else "offshoot"
            meets: Sequence[str] = (passing.kind,)
            if passing.across:  # rest in either plane shows that motions may be in either plane
                own = "z" if uncoupled(self.motion, orbit)[0][0] == 0 else "x"
                meets = ("z", "x") if _is_axial(self.motion) else (own,)
            yield _ForcedTracer(kind, motion, start, self.window, met, meets)

    def branch(self, shown: bool) -> ForcedBranch:
        """The branch, after it was followed."""
        followed = steps_past_grazing(self.motion, self.start, FINE, self._grazes)
        first = self.motion.order * self.start.orbit.frequency

        def share(step: Step) -> float:
            return share_of_way(first, self.motion.order * step.end.p, *self.window)

        with Progress("forced response", shown) as progress:
            _, end, reason = self.one_way(progress.steps(followed, share))
        last = self.points[-1]
        if end in ("points", "not converged"):
            self.lost = NotConverged(
                f"the {self.kind} branch was lost at a frequency of {last.frequency:.6g}, "
                f"amplitude {last.amplitude:.4g}: {reason}"
            )
        self.events.append(ForcedEvent("end", last.frequency, last.amplitude))
        frequency, amplitude, largest, stable, across = map(
            np.array, zip(*self.points, strict=True)
        )
        return ForcedBranch(
            kind=self.kind,
            frequency=frequency,
            amplitude=amplitude,
            largest=largest,
            stable=stable,
            events=tuple(self.events),
            failure=self.lost,
            steps=tuple(self.steps),
            motion=self.motion,
            amplitude_across=across if self.motion.model.dimensions == 3 else None,
        )

    def note(self, step: Step) -> str | None:
        """Keeps a step, its events and the motion at its end; returns why the branch ends."""
        order = self.motion.order
        met = None
        if self.leaves and self.steps:  # a branch that leaves rest or others may come back to them
            tries = (meeting(step, kind, self.rests / order, 1e-3) for kind in self.meets)
            met = next((one for one in tries if one is not None), None)
        if met is not None:
            if self.from_rest and not met.known:
                raise NewtonFailed(
                    f"it passes through rest near {order * met.last.end.p:.6g}, where no motion "
                    "leaves rest"
                )
            step = met.whole
        if self.steps or not self.leaves:
            for passing in _events_on(step, self.motion):
                orbit = orbit_at(step, passing.s)
                event = self._event(passing.kind, orbit, passing.across)
                across = amplitude_across(self.motion, orbit)
                point = _ForcedPoint(event.frequency, event.amplitude, across=across)
                self.points.append(point)
                # Where a turn about the axis changes nothing, the root of that turn is 1, too, and
                # motions that leave the plane without another symmetry precess.
                turns, back = self.motion.axisymmetric, passing.root.real < 0.0
                forks = back or not turns
                if not passing.across:
                    forks = back and not turns and self.motion.model.dimensions == 3
                    forks = forks and len(uncoupled(self.motion, orbit)) == 1
                if forks and passing.kind != "torus":
                    self.forks.append((passing, orbit))
        self.steps.append(step)
        self.points.append(_point_of_orbit(self.motion, orbit_at(step, step.length)))
        if met is not None:
            self.steps.append(met.last)
            self._joins(met.last.problem.orbit(met.last.end.z))
            return "joined"
        return None

    def is_over(self, point: Point) -> bool:
        """Whether the frequency of the forcing leaves the window."""
        low, high = self.window
        return not low <= self.motion.order * point.p <= high

    def _joins(self, orbit: PeriodicOrbit) -> None:
        """Keeps a point of rest, or one at which motions come to the plane or another branch."""
        amplitude = 0.0 if self.from_rest else amplitude_of(self.motion, orbit)[0]
        across = amplitude_across(self.motion, orbit) if self.kind == "offshoot" else 0.0
        frequency = self.motion.order * orbit.frequency
        self.points.append(_ForcedPoint(frequency, amplitude, across=across))

    def _event(self, kind: EventKind, orbit: PeriodicOrbit, across: bool = False) -> ForcedEvent:
        """Keeps the event at an orbit."""
        amplitude, frequency = amplitude_of(self.motion, orbit)[0], orbit.frequency
        self.events.append(ForcedEvent(kind, self.motion.order * frequency, amplitude, across))
        return self.events[-1]

    def _grazes(self, grazing: Grazing) -> None:
        """Keeps the event at which the motion begins or ceases to touch a stop."""
        self._event("grazing", grazing.middle)


def _leaving(
    motion: ForcedField, orbit: PeriodicOrbit, passing: _Passing
) -> tuple[ForcedField, BranchStart]:
    """First step away from the branch of an orbit, at which a root is near 1 or -1.

    The motions have the symmetry and the period of the orbit if the root is 1. If it is -1, they
    are not symmetric or, if the orbit is not either, have twice its period.
    """
    root, orders = math.copysign(1.0, passing.root.real), motion
    if root < 0.0 and not orbit.symmetric:
        orders = motion.of_order(2 * motion.order)
        orders.reach = motion.reach
    among = uncoupled(motion, orbit)[int(passing.across)]
    return orders, from_branch_point(motion, orbit, root, among)


def _refined_motion(
    motion: ForcedField, orbit: PeriodicOrbit, rtol: float, samples: int, azimuth: float
) -> ForcedMotion:
    """The forced motion of an orbit whose mesh is refined until the amplitude converges to rtol.

    In three dimensions it is turned about the axis by an azimuth.

    Raises:
        NotConverged: if the amplitude is not known to rtol; its `result` has the motion.
    """
    orbit, (amplitude, _), error, reason = refined_until(motion, orbit, rtol, FINE.tolerance)
    parts, unsure = multipliers_by_plane(motion, orbit)
    multipliers, _ = all_multipliers(parts)
    t, q, qdot = one_period(motion, orbit, samples)
    if isinstance(motion.model, SpatialModel) and azimuth:
        q, qdot = (motion.model.turned(of.T, azimuth).T.copy() for of in (q, qdot))
    found = ForcedMotion(
        amplitude=amplitude,
        frequency=motion.order * orbit.frequency,
        period=float(t[-1]),
        multipliers=multipliers,
        stable=not (beyond_circle(multipliers, unsure) > 0.0).any(),
        t=t,
        q=q,
        qdot=qdot,
        u=motion.flow(orbit.u, orbit.frequency),
        error=error,
        residual=residual(motion, orbit),
        model=motion.model.with_applied(()),
        orbit=orbit,
        amplitude_across=amplitude_across(motion, orbit),
        across=parts[1][0] if len(parts) == 2 else None,
    )
    if error > rtol:
        raise NotConverged(f"the motion is known to {error:.1e} only: {reason}", found)
    return found
