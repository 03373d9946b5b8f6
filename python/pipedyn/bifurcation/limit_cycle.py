# SPDX-License-Identifier: MIT
"""Limit cycles, stable or not, as periodic boundary-value problems: where the search begins.

A cycle is found on a coarse mesh, from a Hopf point, a motion or another cycle, and refined there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pipedyn.bifurcation.brute_force import LONGEST_PERIOD
from pipedyn.bifurcation.collocation import solved
from pipedyn.bifurcation.cycles import LimitCycle, NoCycle, finished
from pipedyn.bifurcation.floquet import floquet
from pipedyn.bifurcation.hopf import Hopf, hopf, with_drag
from pipedyn.bifurcation.orbit_continuation import HopfPoint, continued
from pipedyn.bifurcation.periodic_orbit import PeriodicOrbit, resolved
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.galerkin import Galerkin
from pipedyn.motion.simulate import (
    Motion,
    MotionStopped,
    Start,
    checked_model_in_motion,
    simulate,
    state_of,
)
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.threads import one_thread

LARGEST_CYCLE = 100
"""Degrees of freedom. An undamped chain of 20 takes 0.8 s, of 40 ten, of 60 a minute, nearly all
for the multipliers, whose mesh the fastest mode that persists decides."""

FIRST_DEFECT, FIRST_STEP = 1e-3, 1e-5
"""Largest defect of the orbit and last step of Newton's method where a cycle is looked for: near
enough for Newton's method on the finer mesh."""

LIGHT = 0.2
"""Damping beside sqrt(beta) u with which an aspirating pipe's onset is at about 0.6 u: one third of
what the flow gives its first mode, 2 sqrt(beta) u, against delta omega^2 / 2."""

NEAR = 0.01
"""How far beside its size a cycle may be from a simulated motion that is on its way to it."""

MOST_ONSETS = 4
"""Onsets of flutter that are tried, the nearest first."""

FEW, PATIENT = 6, 6
"""Degrees of freedom up to which motions are cheap, and by how much they are then given more time:
beside a fold of cycles a motion takes long to converge."""

CHUNK, LONGEST_CHUNK, SEARCH = 4.0, 32.0, 300_000
"""Time after which a simulated motion is looked at, doubled where it comes back to no state, up to
two of the longest periods; right-hand sides after which a search ends."""

MOST_EVALUATIONS = 100_000
"""Right-hand sides after which a search along a branch ends, where each comes with a Jacobian."""


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
            shape (2 coordinates,). Where not given, the cycles of the model's flutter onsets are
            followed to u, the nearest onset first; where that leads nowhere and rest is
            unstable, a simulation from near rest; and of pipes with drag that are unstable without
            an onset, the cycle of a damped pipe, whose damping is taken away. What is found so may
            be unstable, as `stable` says: then a `Motion` or a state leads to what motions end on.
        rtol: relative tolerance of amplitude and frequency, in [1e-10, 1e-2].
        samples: number of states that are given, from the start of the period to its end.

    Returns:
        LimitCycle.

    Raises:
        NoCycle: if rest is stable and no cycle comes from an onset, or the search ends
            at rest, in motion without a period, or with no motion at all; the message says which,
            and at which speed the cycle of an onset turns back.
        NotConverged: if a cycle was found, but not to the tolerance; `result` holds it.
        ValueError, TypeError: for bad arguments.

    Source: Doedel, Keller and Kernevez (1991), Numerical analysis and control of bifurcation
    problems (II), for periodic orbits by collocation.
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
    motion = VectorField(model)
    with one_thread(motion.size):
        orbit, how = cycle_from(motion, u, start)
        return finished(motion, orbit, rtol, samples, how)


# ----------------------------------------------------------------------------- where it begins


def cycle_from(motion: VectorField, u: float, start: Any) -> tuple[PeriodicOrbit, str]:
    """A cycle on a coarse mesh, and how it was found."""
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
    return _simulated(motion, u, y), "simulation"


def _keeps_volumes(model: Model) -> bool:
    """Whether forces depend on the configuration alone (Liouville's theorem)."""
    pipe = model.pipe
    return pipe.beta == pipe.damping == pipe.drag == 0.0 and not model.resisted


def _unguided(motion: VectorField, u: float) -> tuple[PeriodicOrbit, str]:
    """From the onsets of flutter, the nearest first, then by simulation."""
    model, reasons = motion.model, list[str]()
    try:
        model.require_equilibrium(u)
        onsets = [c for c in crossings(model, 1.5 * u) if c.kind == "flutter" and c.speed > 0.0]
        unstable = _unstable(motion, u)
    except (NotConverged, ValueError):
        onsets, unstable = [], True
    points: list[Hopf] = []
    for crossing in sorted(onsets, key=lambda c: abs(c.speed - u))[:MOST_ONSETS]:
        try:
            onset = hopf(model, crossing)
        except (PipedynError, ValueError):  # two that meet lie off the axis by a root of rounding
            continue
        points.append(onset)
        if _may_reach(onset, u):
            with suppress(NewtonFailed):
                found = _from_normal_form(motion, onset, u)
                return found, f"from the onset at u = {onset.speed:.6g}"
    for onset in points:
        if _may_reach(onset, u) or onset.criticality == "subcritical":
            try:
                found = continued(motion, hopf_point(onset), u, MOST_EVALUATIONS)
                return found, f"followed from the onset at u = {onset.speed:.6g}"
            except NewtonFailed as reason:
                reasons.append(str(reason))
    if unstable and not _keeps_volumes(model):
        return _far(motion, u, reasons, not onsets)
    if unstable:
        raise NoCycle(
            f"at u = {u:g} no force depends on velocities, so that volumes in state space last: no "
            "cycle attracts, and none comes from an onset",
            u,
        )
    first = min((c.speed for c in onsets if c.destabilising), default=math.nan)
    where = f": flutter sets in at u = {first:.6g}" if first > u else ""
    why = f" ({'; '.join(reasons)})" if reasons else ""
    raise NoCycle(
        f"the pipe rests stably at u = {u:g}{where}, and no cycle comes from an onset{why}; "
        "one far from rest may be found with start=",
        u,
    )


def _may_reach(onset: Hopf, u: float) -> bool:
    """Whether the cycles next to an onset begin on the side of a speed, or turn."""
    return onset.amplitude_law * (u - onset.speed) > 0.0 or onset.fold is not None


def _from_onset(motion: VectorField, u: float, onset: Hopf) -> tuple[PeriodicOrbit, str]:
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
    with suppress(NewtonFailed):
        return _from_normal_form(motion, onset, u), how
    try:
        return continued(motion, hopf_point(onset), u, MOST_EVALUATIONS), f"followed {how}"
    except NewtonFailed as reason:
        raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None


def _far(
    motion: VectorField, u: float, reasons: list[str], alone: bool
) -> tuple[PeriodicOrbit, str]:
    """Where no onset leads: by simulation or, under drag alone, from a damped pipe's cycle.

    All modes of a pipe under drag alone grow, about as fast: a chain's motions are cheap and come
    to a cycle that attracts, if late; a reduced model's are costly.
    """
    pipe = motion.model.pipe
    bounded = alone and pipe.drag > 0.0 and pipe.damping == 0.0
    by_damping = "followed from a damped pipe's"
    ways: list[tuple[str, Callable[[], PeriodicOrbit]]] = [
        (
            "simulation",
            lambda: _simulated(motion, u, _near_rest(motion, u), SEARCH * (2 if bounded else 1)),
        )
    ]
    if bounded:
        first = 0 if isinstance(motion.model, Galerkin) else 1
        ways.insert(first, (by_damping, lambda: _undamped(motion, u)))
    failed = []
    for how, search in ways:
        try:
            return search(), how
        except (NewtonFailed, NoCycle) as reason:
            failed.append(str(reason))
    raise NoCycle("; ".join(dict.fromkeys([*failed, *reasons])), u)


def _undamped(motion: VectorField, u: float) -> PeriodicOrbit:
    """From the cycle of the same pipe with damping, which is taken away.

    An aspirating pipe without damping has no onset: it is unstable from u = 0 on.
    """
    pipe = motion.model.pipe
    damping = LIGHT * math.sqrt(pipe.beta) * u

    def damped(share: float) -> VectorField:
        return VectorField(motion.model.with_pipe(replace(pipe, damping=share * damping)))

    share, step = 1.0, 0.25
    here = damped(share)
    try:
        onsets = [c for c in crossings(here.model, u) if c.destabilising and c.kind == "flutter"]
        onset = hopf(here.model, max(onsets, key=lambda c: c.speed))
    except (PipedynError, ValueError) as reason:
        raise NewtonFailed(f"with damping of {damping:.2g} no onset is found") from reason
    orbit = continued(here, hopf_point(onset), u, MOST_EVALUATIONS)
    while share > 0.0:
        here = damped(max(share - step, 0.0))
        try:
            orbit = solved(here, orbit, FIRST_STEP)
            share, step = max(share - step, 0.0), 1.5 * step
        except NewtonFailed:
            step *= 0.5
            if step < 0.01:
                raise
    motion.evaluations += here.evaluations
    return orbit


def _unstable(motion: VectorField, u: float) -> bool:
    factorised()
    values = np.linalg.eigvals(motion.jacobian(motion.resting(), u))
    return bool(values.real.max() > 1e-9 * (1.0 + float(np.abs(values).max())))


def _from_normal_form(motion: VectorField, onset: Hopf, u: float) -> PeriodicOrbit:
    """From the amplitude equation at the Hopf point to the speed at once."""
    try:
        amplitude, omega = onset.amplitude(u), onset.pace(u)
    except ValueError:
        raise NewtonFailed("the amplitude equation has no cycle there") from None
    if not 0.0 < amplitude <= 0.6:
        raise NewtonFailed("the Hopf point is too near or too far")
    omega = omega if omega > 0.3 * onset.frequency else onset.frequency
    start = hopf_point(onset).orbit(motion, amplitude, u, omega)
    return _on_suitable_mesh(motion, solved(motion, start, FIRST_STEP))


def _on_suitable_mesh(motion: VectorField, coarse: PeriodicOrbit) -> PeriodicOrbit:
    """The same cycle where the mesh is not too coarse for it.

    Raises:
        NewtonFailed: if it is but a solution of the equations on a mesh that is too coarse.
    """
    orbit = resolved(
        *(motion, coarse.states, coarse.frequency, coarse.u, coarse.symmetric), FIRST_DEFECT
    )
    finer = solved(motion, orbit, FIRST_STEP)
    if abs(finer.size / coarse.size - 1.0) > 0.1:
        raise NewtonFailed("what was found does not stand a refinement")
    return finer


def hopf_point(onset: Hopf) -> HopfPoint:
    """Where the cycles of a flutter come from."""
    return HopfPoint(onset.rest, onset.mode, onset.speed, onset.frequency)


def _from_cycle(motion: VectorField, u: float, start: LimitCycle) -> PeriodicOrbit:
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


def _integrated(motion: VectorField, q: Array, qdot: Array) -> Array:
    """[p, p'] of coordinates and rates, shape (S, 2 moving)."""
    if motion.model.coordinates == motion.half:
        return np.concatenate([q, qdot], axis=1)
    return np.array([motion.model.start(*pair) for pair in zip(q, qdot, strict=True)])


def _resampled(
    motion: VectorField, u: float, t: Array, p: Array, period: float, likeness: float
) -> PeriodicOrbit:
    """An orbit through samples that span at least one period from t[0] on."""
    spline = _spline(motion, u, t, p)
    odd = False
    if motion.is_odd(u):
        probe = t[0] + period * np.arange(32) / 64.0
        here, later = spline(probe), spline(probe + 0.5 * period)
        far = np.abs(here + later).max(axis=0) > likeness * np.abs(here).max(axis=0)
        odd = not far[: motion.half].any()
    omega = 2.0 * math.pi / period

    def states(phase: Array) -> Array:
        return np.ascontiguousarray(spline(t[0] + phase / omega).T)

    return resolved(motion, states, omega, u, odd, FIRST_DEFECT)


def _spline(motion: VectorField, u: float, t: Array, p: Array) -> CubicHermiteSpline:
    """[p, p'] over time; with constraints by projection f's own rate of p is not p'."""
    rates = motion(np.ascontiguousarray(p.T), u)[motion.half :].T
    return CubicHermiteSpline(t, p, np.concatenate([p[:, motion.half :], rates], axis=1))


def _improved(motion: VectorField, guess: PeriodicOrbit, u: float) -> PeriodicOrbit:
    try:
        return solved(motion, guess, FIRST_STEP)
    except NewtonFailed as reason:
        raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None


def _near_rest(motion: VectorField, u: float) -> Array:
    """A state [p, p'] near rest, in the direction that grows fastest."""
    rest = motion.resting()
    factorised()
    values, vectors = np.linalg.eig(motion.jacobian(rest, u))
    mode = vectors[:, int(np.argmax(values.real))]
    across = mode[: motion.half]
    grown = (mode / across[int(np.argmax(np.abs(across)))]).real
    near: Array = rest + 0.1 * grown
    return near


def _simulated(motion: VectorField, u: float, start: Array, limit: int = SEARCH) -> PeriodicOrbit:
    """The cycle on which the motion from a state [p, p'] ends."""
    model = motion.model
    reason = "the motion comes back to no state it had before"
    states = np.stack([start, motion.resting()])
    (q0, q_rest), (qdot0, _) = model.recorded(states[:, : motion.half], states[:, motion.half :])
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
        except NewtonFailed as failure:
            reason = str(failure)
            continue
        # One far from the motion may be any, and one that repels a motion only passes by.
        away = float(np.abs(found.starts - guess.starts)[:, : motion.half].max())
        reason = "the motion does not converge"
        if away < NEAR * found.size:
            if passed is not None and abs(found.frequency / passed.frequency - 1.0) < 1e-6:
                continue
            try:
                multipliers, _ = floquet(motion, found)
            except NewtonFailed as failure:
                reason = str(failure)
                continue
            if np.count_nonzero(np.abs(multipliers) > 1.0 + 1e-3) == 0:
                return found
            passed = found
    if passed is not None:
        return passed
    raise NoCycle(f"no limit cycle at u = {u:g} from there: {reason}", u)


def _from_motion(motion: VectorField, u: float, going: Motion) -> PeriodicOrbit | None:
    """The last period of a motion; None if it does not come back to within a tenth of its size."""
    p = _integrated(motion, going.q, going.qdot)
    t, tip = going.t, going.tip[:, 0]
    if t.size < 16:
        return None
    across = tip - 0.5 * (tip[t.size // 2 :].max() + tip[t.size // 2 :].min())
    up = np.flatnonzero((across[:-1] < 0.0) & (across[1:] >= 0.0))
    if up.size < 2:
        return None
    spline = _spline(motion, u, t, p)
    times = t[up] - across[up] * (t[up + 1] - t[up]) / (across[up + 1] - across[up])
    states = spline(times)
    last = states[-1]
    scale = np.ptp(p[t.size // 2 :], axis=0)
    scale = np.maximum(scale, 1e-3 * scale.max())
    back = np.abs((states[:-1] - last) / scale).max(axis=1)[::-1][:LONGEST_PERIOD]
    close = np.flatnonzero(back <= max(2.0 * float(back.min()), 0.01))
    turns = int(close[0])
    if back[turns] > 0.1:
        return None
    period = float(times[-1] - times[-2 - turns])
    begin = int(np.searchsorted(t, times[-2 - turns], side="right")) - 1
    at = np.concatenate([[times[-2 - turns]], t[begin + 1 :]])
    return _resampled(motion, u, at, spline(at), period, 0.02)
