# SPDX-License-Identifier: MIT
"""Limit cycles, stable or not, as periodic boundary-value problems.

What is found on few panels (`course`, `panels`), from an onset (`pursuit`), a motion or another
cycle, is refined there until amplitude and frequency stand still. Panels are short where the motion
asks for it, and Radau's method takes modes that decay far faster than the cycle turns in its steps.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import field, replace
from typing import Any, TypeAlias

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pipedyn.bifurcation.arcs import Birth
from pipedyn.bifurcation.brute_force import LONGEST_PERIOD
from pipedyn.bifurcation.collocation import residual, solved
from pipedyn.bifurcation.floquet import floquet
from pipedyn.bifurcation.fourier import Elsewhere, Equations, Orbit, is_odd
from pipedyn.bifurcation.hopf import Hopf, hopf, with_drag
from pipedyn.bifurcation.mesh import MOST, Course, course_of, divided, drawn
from pipedyn.bifurcation.pursuit import pursued
from pipedyn.bifurcation.vector_field import Field
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.galerkin import Galerkin
from pipedyn.motion.simulate import (
    Motion,
    MotionStopped,
    Start,
    Trajectory,
    checked_model_in_motion,
    simulate,
    state_of,
)
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

LARGEST_CYCLE = 100
"""Degrees of freedom. An undamped chain of 20 takes 0.8 s, of 40 ten, of 60 a minute, nearly all
for the multipliers, whose panels the fastest mode that lives on sets."""

ROUGH, ROUGH_ACROSS_KINKS = 1e-3, 1e-1
"""Roughness of panels beside rtol, where f is smooth and under drag."""

FIRST_ROUGH, FIRST_STEP = 1e-3, 1e-5
"""Roughness of panels and last step of Newton's method where a cycle is looked for."""

LIGHT = 0.2
"""Damping beside sqrt(beta) u with which an aspirating pipe's onset is at about 0.6 u: one third of
what the flow gives its first mode, 2 sqrt(beta) u, against delta omega^2 / 2."""

SETTLED = 0.01
"""How far beside its size a cycle may be from a simulated motion that is on its way to it."""

CHECKS = 3
"""Times that the panels are refined for the sake of the multipliers, and once at least."""

BELIEVED = 1e-4
"""Error of the multipliers of a cycle on a branch beyond which it is solved for more sharply."""

TRIVIAL = 1e-6
"""How far the trivial multiplier may be from 1."""

MOST_ONSETS = 4
"""Onsets of flutter that are tried, the nearest first."""

PEAKS = 2048
"""Phases among which the free end's extremes are found, before a parabola goes through them."""

FEW, PATIENT = 6, 6
"""Degrees of freedom up to which motions are cheap, and by how much they are then given more time:
beside a fold of cycles a motion takes long to settle."""

CHUNK, LONGEST_CHUNK, SEARCH = 4.0, 32.0, 300_000
"""Time after which a simulated motion is looked at, doubled where it comes back to no state, up to
two of the longest periods; right-hand sides after which a search ends."""

PURSUIT = 100_000
"""The same of a search along a branch, where each comes with a Jacobian."""

TURNS = LONGEST_PERIOD
"""Returns of the free end, at most, that a simulated motion's period may have."""


@result
class LimitCycle(Trajectory):
    """One period of a periodic motion.

    Attributes:
        amplitude: half the peak-to-peak transverse motion of the free end, in L.
        frequency: angular, in 1 / T.
        period: in T.
        multipliers: Floquet multipliers, complex, shape (2 dof,), the largest modulus first; the
            trivial one, 1, among them.
        stable: whether all others are smaller than 1 in modulus.
        t: times from 0, where the free end is farthest to positive x, to the period, shape (S,).
        q, qdot: coordinates and rates, shape (S, coordinates).
        u: flow speed.
        model: the model.
        error: of amplitude and frequency, relative, estimated by refinement: what the last
            halving of panels changed.
        multiplier_error: distance of the trivial multiplier from 1, or what halving the panels
            tells of the worst, relative if above 1, where that is more.
        residual: largest |dy/dt - f(y)| half-way between the stages at which the equations were
            solved, relative to the largest |f|, of the accelerations.
        symmetric: whether the second half of the period was taken as the mirror image of the first.
        phases: number of states solved for.
        evaluations: right-hand sides and Jacobians.
        method: how it was found.
    """

    amplitude: float
    frequency: float
    period: float
    multipliers: Complex = field(repr=False)
    stable: bool
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    u: float
    model: Model
    error: float
    multiplier_error: float
    residual: float
    symmetric: bool
    phases: int
    evaluations: int
    method: str

    @property
    def tip(self) -> Array:
        """Position (x, y) of the free end, shape (S, 2)."""
        return self.model.tips(self.q.T)

    @property
    def others(self) -> Complex:
        """Multipliers without the trivial one, shape (2 dof - 1,)."""
        return np.delete(self.multipliers, int(np.argmin(np.abs(self.multipliers - 1.0))))


class NoCycle(PipedynError):
    """No limit cycle was found.

    Attributes:
        u: flow speed.
    """

    def __init__(self, message: str, u: float) -> None:
        super().__init__(message, u)
        self.u = u


CycleStart: TypeAlias = "LimitCycle | Hopf | Motion | Start | None"
"""Where the search for a cycle begins."""

KINDS = "a LimitCycle, a Hopf, a Motion, an angle theta(s), coordinates or a state [q, q']"
"""What a start may be."""


def limit_cycle(
    model: Model,
    u: float,
    start: CycleStart = None,
    *,
    rtol: float = 1e-6,
    samples: int = 257,
) -> LimitCycle:
    """A periodic motion at a constant flow speed, stable or unstable, with its Floquet multipliers.

    Args:
        model: chain, reduced model or scene, up to 100 degrees of freedom.
        u: flow speed > 0, in sqrt(EI / mu_f) / L.
        start: where to begin: a `LimitCycle` of the same model or one with as many coordinates (at
            another speed, or of another pipe); a `Hopf` of the model, whose cycle is followed to u;
            a `Motion` that ends near the cycle; or what a simulation sets out from, as for
            `lyapunov_exponent`: an angle theta(s) or coordinates (at rest), or a state [q, q'],
            shape (2 coordinates,). Where not given, the cycles born at the model's flutter onsets
            are followed to u, the nearest onset first; where that leads nowhere and rest is
            unstable, a simulation from near rest; and of pipes with drag that are unstable without
            an onset, the cycle of a damped pipe, whose damping is taken away. What is found so may
            be unstable, as `stable` says: then a `Motion` or a state leads to what motions end on.
        rtol: relative tolerance of amplitude and frequency, in [1e-10, 1e-2].
        samples: number of states that are given, from the start of the period to its end.

    Returns:
        LimitCycle.

    Raises:
        NoCycle: if rest is stable and no cycle comes from an onset, or the search ends elsewhere:
            at rest, in motion without a period, or with no motion at all; the message says which,
            and at which speed the cycle of an onset turns back.
        NotConverged: if a cycle was found, but not to the tolerance; `result` holds it.
        ValueError, TypeError: for bad arguments.

    Source: see the module's head.
    """
    model = checked_model_in_motion(model)
    if model.dof > LARGEST_CYCLE:
        raise ValueError(
            f"model must have at most {LARGEST_CYCLE} degrees of freedom for limit_cycle, "
            f"got {model.dof}"
        )
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED, open_low=True)
    rtol = check.real("rtol", rtol, low=1e-10, high=1e-2)
    samples = check.count("samples", samples, low=9, high=100_000)
    motion = Field(model)
    with one_thread(motion.size):
        course, how = cycle_from(motion, u, start)
        return finished(motion, course, rtol, samples, how)


# ----------------------------------------------------------------------------- where it begins


def cycle_from(motion: Field, u: float, start: Any) -> tuple[Course, str]:
    """A cycle on few panels, and how it was found."""
    if start is None:
        return _unguided(motion, u)
    if isinstance(start, LimitCycle):
        return _from_cycle(motion, u, start), "from a cycle"
    if isinstance(start, Hopf):
        return _from_onset(motion, u, start)
    if isinstance(start, Motion):
        same = start.model.coordinates == motion.model.coordinates
        if not same:
            raise ValueError(
                f"start must be a motion of {motion.model.coordinates} coordinates, got "
                f"{start.model.coordinates}"
            )
        guess = _from_motion(motion, u, start)
        if guess is None:
            raise NoCycle("the motion to start from comes back to no state it had before", u)
        return _improved(motion, guess, u), "from a motion"
    y = state_of(motion.model, "start", start, KINDS)
    q, qdot = motion.model.recorded(y[None, : motion.half], y[None, motion.half :])
    return _simulated(motion, u, q[0], qdot[0]), "simulation"


def _keeps_volumes(model: Model) -> bool:
    """Whether forces depend on the configuration alone (Liouville's theorem)."""
    pipe = model.pipe
    return pipe.beta == pipe.damping == pipe.drag == 0.0 and not model.resisted


def _unguided(motion: Field, u: float) -> tuple[Course, str]:
    """From the onsets of flutter, the nearest first, then by simulation."""
    model, told = motion.model, list[str]()
    try:
        model.require_equilibrium(u)
        passages = [c for c in crossings(model, 1.5 * u) if c.kind == "flutter" and c.speed > 0.0]
        unstable = _unstable(motion, u)
    except (NotConverged, ValueError):
        passages, unstable = [], True
    born: list[Hopf] = []
    for crossing in sorted(passages, key=lambda c: abs(c.speed - u))[:MOST_ONSETS]:
        try:
            onset = hopf(model, crossing)
        except (PipedynError, ValueError):  # two that meet lie off the axis by a root of rounding
            continue
        born.append(onset)
        if _may_reach(onset, u):
            with suppress(Elsewhere):
                return _leapt(motion, onset, u), f"from the onset at u = {onset.speed:.6g}"
    for onset in born:
        if _may_reach(onset, u) or onset.criticality == "subcritical":
            try:
                found = pursued(motion, birth_of(motion, onset), u, PURSUIT)
                return found, f"followed from the onset at u = {onset.speed:.6g}"
            except Elsewhere as reason:
                told.append(str(reason))
    if unstable and not _keeps_volumes(model):
        return _far(motion, u, told, not passages)
    if unstable:
        raise NoCycle(
            f"at u = {u:g} no force depends on velocities, so that volumes in state space last: no "
            "cycle attracts, and none comes from an onset",
            u,
        )
    first = min((c.speed for c in passages if c.destabilising), default=math.nan)
    where = f": flutter sets in at u = {first:.6g}" if first > u else ""
    why = f" ({'; '.join(told)})" if told else ""
    raise NoCycle(
        f"the pipe rests stably at u = {u:g}{where}, and no cycle comes from an onset{why}; "
        "one far from rest may be found with start=",
        u,
    )


def _may_reach(onset: Hopf, u: float) -> bool:
    """Whether the cycles next to an onset begin on the side of a speed, or turn."""
    return onset.amplitude_law * (u - onset.speed) > 0.0 or onset.fold is not None


def _from_onset(motion: Field, u: float, onset: Hopf) -> tuple[Course, str]:
    """The cycle of the user's onset."""
    mode, rest = onset.mode, onset.rest
    own = onset.model.moving == motion.half and onset.model.coordinates == motion.model.coordinates
    if own:
        linear = with_drag(motion.model, 0.0).jacobian(rest, onset.speed)
        missed = linear @ mode - 1j * onset.frequency * mode
        own = float(np.abs(missed).max()) < 1e-5 * onset.frequency * float(np.abs(mode).max())
    if not own:
        raise ValueError(f"start must be an onset of the model, got one of {onset.model!r}")
    how = f"from the onset at u = {onset.speed:.6g}"
    with suppress(Elsewhere):
        return _leapt(motion, onset, u), how
    try:
        return pursued(motion, birth_of(motion, onset), u, PURSUIT), f"followed {how}"
    except Elsewhere as reason:
        raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None


def _far(motion: Field, u: float, told: list[str], alone: bool) -> tuple[Course, str]:
    """Where no onset leads: by simulation or, under drag alone, from a damped pipe's cycle.

    All modes of a pipe under drag alone grow, about as fast: a chain's motions are cheap and come
    to a cycle that attracts, if late; a reduced model's are dear.
    """
    pipe = motion.model.pipe
    bounded = alone and pipe.drag > 0.0 and pipe.damping == 0.0
    if bounded and isinstance(motion.model, Galerkin):
        try:
            return _undamped(motion, u), "followed from a damped pipe's"
        except Elsewhere as reason:
            told.append(str(reason))
    try:
        limit = 2 * SEARCH if bounded else SEARCH
        return _simulated(motion, u, *_nudged(motion, u), limit), "simulation"
    except NoCycle as reason:
        told.insert(0, str(reason))
    if bounded and not isinstance(motion.model, Galerkin):
        try:
            return _undamped(motion, u), "followed from a damped pipe's"
        except Elsewhere as reason:
            told.append(str(reason))
    raise NoCycle("; ".join(dict.fromkeys(told)), u)


def _undamped(motion: Field, u: float) -> Course:
    """From the cycle of the same pipe with damping, which is taken away.

    An aspirating pipe without damping has no onset: it is unstable from u = 0 on.
    """
    pipe = motion.model.pipe
    damping = LIGHT * math.sqrt(pipe.beta) * u

    def damped(share: float) -> Field:
        return Field(motion.model.with_pipe(replace(pipe, damping=share * damping)))

    share, step = 1.0, 0.25
    here = damped(share)
    try:
        passages = [c for c in crossings(here.model, u) if c.destabilising and c.kind == "flutter"]
        onset = hopf(here.model, max(passages, key=lambda c: c.speed))
    except (PipedynError, ValueError) as reason:
        raise Elsewhere(f"with damping of {damping:.2g} no onset is found") from reason
    course = pursued(here, birth_of(here, onset), u, PURSUIT)
    while share > 0.0:
        here = damped(max(share - step, 0.0))
        try:
            course = solved(here, course, FIRST_STEP)
            share, step = max(share - step, 0.0), 1.5 * step
        except Elsewhere:
            step *= 0.5
            if step < 0.01:
                raise
    motion.evaluations += here.evaluations
    return course


def _unstable(motion: Field, u: float) -> bool:
    factorised()
    values = np.linalg.eigvals(motion.jacobian(motion.resting(), u))
    return bool(values.real.max() > 1e-9 * (1.0 + float(np.abs(values).max())))


def _leapt(motion: Field, onset: Hopf, u: float) -> Course:
    """From the amplitude equation at the onset to the speed at once."""
    try:
        amplitude, omega = onset.amplitude(u), onset.pace(u)
    except ValueError:
        raise Elsewhere("the amplitude equation has no cycle there") from None
    if not 0.0 < amplitude <= 0.6:
        raise Elsewhere("the onset is too near or too far")
    omega = omega if omega > 0.3 * onset.frequency else onset.frequency
    ring = birth_of(motion, onset).ring(motion, amplitude, u, omega)
    coarse = course_of(motion, Equations(motion, ring.phases).solve(ring), FIRST_ROUGH)
    finer = solved(motion, coarse, FIRST_STEP)
    if abs(finer.size / coarse.size - 1.0) > 0.1:  # too few phases have solutions of their own
        raise Elsewhere("what was found does not stand a refinement")
    return finer


def birth_of(motion: Field, onset: Hopf) -> Birth:
    """Where the cycles of a flutter come from."""
    return Birth(onset.rest, onset.mode, onset.speed, onset.frequency)


def _from_cycle(motion: Field, u: float, start: LimitCycle) -> Course:
    size = motion.model.coordinates
    if start.model.coordinates != size or start.model.moving != motion.half:
        raise ValueError(
            f"start must be a cycle of {size} coordinates, got {start.model.coordinates}"
        )
    if type(start.model) is not type(motion.model):
        raise ValueError(
            f"start must be a cycle of a {type(motion.model).__name__}, whose coordinates it has, "
            f"got one of a {type(start.model).__name__}"
        )
    p = _integrated(motion, start.q, start.qdot)
    return _improved(motion, _resampled(motion, u, start.t, p, start.period, 1e-6), u)


def _integrated(motion: Field, q: Array, qdot: Array) -> Array:
    """[p, p'] of coordinates and rates, shape (S, 2 moving)."""
    if motion.model.coordinates == motion.half:
        return np.concatenate([q, qdot], axis=1)
    return np.array([motion.model.start(*pair) for pair in zip(q, qdot, strict=True)])


def _resampled(
    motion: Field, u: float, t: Array, p: Array, period: float, likeness: float
) -> Course:
    """A course through samples that span at least one period from t[0] on."""
    rates = motion(np.ascontiguousarray(p.T), u)
    # Constraints by projection: p' is not the rate of p there.
    slopes = np.concatenate([p[:, motion.half :], rates[motion.half :].T], axis=1)
    spline = CubicHermiteSpline(t, p, slopes)
    odd = False
    if is_odd(motion, u):
        probe = t[0] + period * np.arange(32) / 64.0
        here, later = spline(probe), spline(probe + 0.5 * period)
        far = np.abs(here + later).max(axis=0) > likeness * np.abs(here).max(axis=0)
        odd = not far[: motion.half].any()
    omega = 2.0 * math.pi / period

    def states(phase: Array) -> Array:
        return np.ascontiguousarray(spline(t[0] + phase / omega).T)

    return drawn(motion, states, omega, u, odd, FIRST_ROUGH)


def _improved(motion: Field, guess: Course, u: float) -> Course:
    try:
        return solved(motion, guess, FIRST_STEP)
    except Elsewhere as reason:
        raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None


def _nudged(motion: Field, u: float) -> tuple[Array, Array]:
    """A state near rest, in the direction that grows fastest."""
    rest = motion.resting()
    factorised()
    values, vectors = np.linalg.eig(motion.jacobian(rest, u))
    mode = vectors[:, int(np.argmax(values.real))]
    across = mode[: motion.half]
    grown = (mode / across[int(np.argmax(np.abs(across)))]).real
    y = rest + 0.1 * grown
    q, qdot = motion.model.recorded(y[None, : motion.half], y[None, motion.half :])
    return q[0], qdot[0]


def _simulated(motion: Field, u: float, q0: Array, qdot0: Array, limit: int = SEARCH) -> Course:
    """From where a motion settles."""
    model = motion.model
    reason = "the motion comes back to no state it had before"
    first = motion.resting()
    q_rest = model.recorded(first[None, : motion.half], first[None, motion.half :])[0][0]
    evaluations, time, passed, chunk = 0, 0.0, None, CHUNK
    limit *= PATIENT if model.dof <= FEW else 1
    while evaluations < limit:
        try:
            samples = math.ceil(250 * chunk) + 1
            going = simulate(model, u, chunk, q0, qdot0, rtol=1e-6, samples=samples, most=limit)
        except MotionStopped as stopped:
            raise NoCycle(
                f"no limit cycle at u = {u:g} from there: after a time of {time:g}, {stopped}", u
            ) from None
        time += chunk
        evaluations += going.evaluations
        motion.evaluations += going.evaluations
        q0, qdot0 = going.q[-1], going.qdot[-1]
        half = samples // 2
        moves = float(np.ptp(going.q[half:], axis=0).max())
        if moves < 1e-4 and moves <= 1.01 * float(np.ptp(going.q[:half], axis=0).max()):
            where = "rest" if np.abs(q0 - q_rest).max() < 1e-2 else "a bent pipe at rest"
            raise NoCycle(f"no limit cycle at u = {u:g} from there: the motion ends in {where}", u)
        guess = _from_motion(motion, u, going)
        if guess is None:
            chunk = min(2.0 * chunk, LONGEST_CHUNK)
            continue
        try:
            found = solved(motion, guess, FIRST_STEP)
        except Elsewhere as told:
            reason = str(told)
            continue
        # One far from the motion may be any, and one that repels a motion only passes by.
        away = float(np.abs(found.starts - guess.starts)[:, : motion.half].max())
        reason = "the motion does not settle"
        if away < SETTLED * found.size:
            if passed is not None and abs(found.frequency / passed.frequency - 1.0) < 1e-6:
                continue
            try:
                multipliers, _ = floquet(motion, found)
            except Elsewhere as told:
                reason = str(told)
                continue
            if np.count_nonzero(np.abs(multipliers) > 1.0 + 1e-3) == 0:
                return found
            passed = found
    if passed is not None:
        return passed
    raise NoCycle(f"no limit cycle at u = {u:g} from there: {reason}", u)


def _from_motion(motion: Field, u: float, going: Motion) -> Course | None:
    """The last period of a motion; None if it does not come back to within a tenth of its size."""
    p = _integrated(motion, going.q, going.qdot)
    t, tip = going.t, going.tip[:, 0]
    if t.size < 16:
        return None
    across = tip - 0.5 * (tip[t.size // 2 :].max() + tip[t.size // 2 :].min())
    up = np.flatnonzero((across[:-1] < 0.0) & (across[1:] >= 0.0))
    if up.size < 2:
        return None
    half = motion.half
    rates = motion(np.ascontiguousarray(p.T), u)[half:].T
    spline = CubicHermiteSpline(t, p, np.concatenate([p[:, half:], rates], axis=1))
    times = t[up] - across[up] * (t[up + 1] - t[up]) / (across[up + 1] - across[up])
    states = spline(times)
    last = states[-1]
    scale = np.ptp(p[t.size // 2 :], axis=0)
    scale = np.maximum(scale, 1e-3 * scale.max())
    back = np.abs((states[:-1] - last) / scale).max(axis=1)[::-1][:TURNS]
    close = np.flatnonzero(back <= max(2.0 * float(back.min()), 0.01))
    turns = int(close[0])
    if back[turns] > 0.1:
        return None
    period = float(times[-1] - times[-2 - turns])
    begin = int(np.searchsorted(t, times[-2 - turns], side="right")) - 1
    at = np.concatenate([[times[-2 - turns]], t[begin + 1 :]])
    return _resampled(motion, u, at, spline(at), period, 0.02)


# --------------------------------------------------------------------------------- what it is


def finished(
    motion: Field, found: Orbit | Course, rtol: float, samples: int, how: str
) -> LimitCycle:
    """The cycle, refined until its amplitude and frequency stand still and its check holds."""
    course = course_of(motion, found, FIRST_ROUGH) if isinstance(found, Orbit) else found
    rough = rtol * (ROUGH_ACROSS_KINKS if motion.model.pipe.drag else ROUGH)
    tolerance = min(1e-7, 1e-2 * rtol)
    for attempt in range(CHECKS):
        course, error, reason = _refined(motion, course, rough, rtol, tolerance)
        try:
            result = _described(motion, course, error, samples, how)
        except Elsewhere as told:
            raise NotConverged(f"the cycle at u = {found.u:g} fails its check: {told}") from None
        if error > rtol:
            raise NotConverged(
                f"the cycle at u = {found.u:g} is known to {error:.1e} only: {reason}", result
            )
        if result.multiplier_error <= max(TRIVIAL, rtol):
            break
        if attempt + 1 == CHECKS:
            raise NotConverged(
                f"the cycle at u = {found.u:g} fails its check: its Floquet multipliers, one of "
                f"which should be 1, are known to {result.multiplier_error:.1e} only",
                result,
            )
        rough *= 0.01  # the multipliers ask for more
    return result


def _refined(
    motion: Field, course: Course, rough: float, rtol: float, tolerance: float
) -> tuple[Course, float, str]:
    """The course on finer panels, what their last refinement changed, and why it went no further.

    Refined are the panels that are rough, and all of them where none is, until what is rough on
    them is rounding, which halving does not lessen.
    """
    # Under drag two answers may agree by chance: believed is no more than the fourth power of h.
    measured, error = amplitude_of(motion, course), math.inf
    last = math.inf if motion.model.pipe.drag else 0.0
    roughest = math.inf
    while True:
        roughness = course.roughness()
        coarse, before, roughest = roughness > rough, roughest, float(roughness.max())
        if error <= 0.5 * rtol and (not coarse.any() or roughest > 0.5 * before):
            return course, error, ""
        if not coarse.any():
            coarse[:] = True
        if len(course.starts) + coarse.sum() > MOST:
            return course, error, f"that takes more than {MOST} panels"
        try:
            finer = solved(motion, divided(motion, course, 1 + coarse, turning=True), tolerance)
        except Elsewhere as told:
            return course, error, str(told)
        sharper = amplitude_of(motion, finer)
        moved = _apart(course, measured, finer, sharper)
        error, last = max(moved, last / 16.0), moved
        course, measured = finer, sharper


def _apart(a: Course, peak: tuple[float, float], b: Course, other: tuple[float, float]) -> float:
    """Relative difference of two cycles' amplitudes and frequencies."""
    moved = abs(other[0] / peak[0] - 1.0)
    return max(moved, abs(b.frequency / a.frequency - 1.0), 1e-14)


def amplitude_of(motion: Field, found: Orbit | Course) -> tuple[float, float]:
    """Half the free end's peak-to-peak motion, and the phase of its greatest displacement."""
    course = course_of(motion, found, FIRST_ROUGH) if isinstance(found, Orbit) else found
    phase: Array = 2.0 * math.pi / PEAKS * np.arange(float(PEAKS))
    across = motion.tip(course.states(phase))
    greatest, where = _peak(across)
    least, _ = _peak(-across)
    return 0.5 * (greatest + least), 2.0 * math.pi / PEAKS * where


def _peak(values: Array) -> tuple[float, float]:
    """Maximum of a periodic function and its place, by the polynomial through five samples."""
    i = int(np.argmax(values))
    near = values[np.arange(i - 2, i + 3) % values.size]
    line = np.polynomial.Polynomial.fit(np.arange(-2.0, 3.0), near, 4)
    turns = line.deriv().roots()
    inner = turns.real[(np.abs(turns.imag) < 1e-9) & (np.abs(turns.real) <= 1.0)]
    if inner.size == 0:
        return float(values[i]), float(i)
    heights = line(inner)
    return float(heights.max()), i + float(inner[int(np.argmax(heights))])


def described(motion: Field, orbit: Orbit, error: float, samples: int, how: str) -> LimitCycle:
    """What an orbit is, with its multipliers, as found; the error is not checked here."""
    rough = 1e-6 * (ROUGH_ACROSS_KINKS if motion.model.pipe.drag else 1e-1 * ROUGH)
    course = course_of(motion, orbit, rough)
    result = _described(motion, course, error, samples, how)
    if result.multiplier_error <= BELIEVED:
        return result
    with suppress(Elsewhere):  # a cycle whose neighbours part fast has to be known better
        better = _described(motion, solved(motion, course, 1e-9), error, samples, how)
        return min(result, better, key=lambda cycle: cycle.multiplier_error)
    return result


def _described(motion: Field, course: Course, error: float, samples: int, how: str) -> LimitCycle:
    amplitude, first = amplitude_of(motion, course)
    period = 2.0 * math.pi / course.frequency
    t = np.linspace(0.0, period, samples)
    y = course.states(first + course.frequency * t)
    q, qdot = motion.model.recorded(y[: motion.half].T.copy(), y[motion.half :].T.copy())
    multipliers, unsettled = floquet(motion, course)
    trivial = int(np.argmin(np.abs(multipliers - 1.0)))
    others = np.abs(np.delete(multipliers, trivial))
    return LimitCycle(
        amplitude=amplitude,
        frequency=course.frequency,
        period=period,
        multipliers=multipliers,
        stable=bool(others.max(initial=0.0) < 1.0),
        t=t,
        q=np.ascontiguousarray(q),
        qdot=np.ascontiguousarray(qdot),
        u=course.u,
        model=motion.model,
        error=error,
        multiplier_error=max(float(np.abs(multipliers[trivial] - 1.0)), unsettled),
        residual=residual(motion, course),
        symmetric=course.half,
        phases=course.pushes.shape[0] * course.pushes.shape[1],
        evaluations=motion.evaluations,
        method=f"collocation, {how}",
    )
