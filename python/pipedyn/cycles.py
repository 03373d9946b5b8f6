# SPDX-License-Identifier: MIT
"""Limit cycles, stable or not, as periodic boundary-value problems.

One period is solved for at N equal phases at once (`collocation`). N is doubled until amplitude and
frequency stand still; where f is analytic they do so faster than any power of N, under drag, |v| v,
like one.

The modes of a chain that are far faster than its cycle hardly take part in it, so that a shooting
method would spend its steps on nothing: here they cost nothing but the size of the matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.arcs import Birth, arc, from_birth
from pipedyn.blas import one_thread
from pipedyn.collocation import Elsewhere, Equations, Orbit, Phases, is_odd
from pipedyn.critical import crossings
from pipedyn.field import Field
from pipedyn.floquet import floquet
from pipedyn.hopf import Hopf, hopf
from pipedyn.modal import LARGEST_SPEED
from pipedyn.model import Model, NotConverged, PipedynError
from pipedyn.motion import Motion, MotionStopped, checked_model_in_motion, simulate
from pipedyn.pencil import Complex

LARGEST_CYCLE = 100
"""Degrees of freedom. A chain of 20 takes half a second, of 40 five, of 60 half a minute, nearly
all for the multipliers, whose steps the fastest mode sets."""

MOST_POINTS = 1024
"""Phases in a half or whole period."""

TRIVIAL = 1e-6
"""How far the trivial multiplier may be from 1."""

MOST_ONSETS = 4
"""Onsets of flutter that are tried, the nearest first."""

PEAKS = 2048
"""Phases among which the free end's extremes are found, before a parabola goes through them."""

CHUNK, SEARCH = 4.0, 300_000
"""Time after which a simulated motion is looked at; right-hand sides after which a search ends."""

TURNS = 6
"""Returns of the free end, at most, that a simulated motion's period may have."""


@dataclass(frozen=True)
class LimitCycle:
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
            doubling of the phases changed.
        multiplier_error: distance of the trivial multiplier from 1, or the summed error of the
            variational equation's steps where that is more.
        residual: largest |dy/dt - f(y)| half-way between the phases at which the equations were
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
    def y(self) -> Array:
        """States [q, q'] at the times, shape (2 coordinates, S)."""
        return np.concatenate([self.q, self.qdot], axis=1).T

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


CycleStart: TypeAlias = "Motion | LimitCycle | ArrayLike | None"
"""Where the search for a cycle begins."""


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
        start: where to begin: a `Motion` that ends near the cycle, a `LimitCycle` of the same model
            or one with as many coordinates (at another speed, or of another pipe), or a state
            [q, q'], shape (2 coordinates,), from which a simulation sets out. Where not given, the
            cycles born at the model's flutter onsets are followed to u, the nearest onset first;
            where that leads nowhere and rest is unstable, a simulation from near rest.
        rtol: relative tolerance of amplitude and frequency, in [1e-10, 1e-2].
        samples: number of states that are given, from the start of the period to its end.

    Returns:
        LimitCycle.

    Raises:
        NoCycle: if rest is stable and no cycle comes from an onset, or the search ends elsewhere:
            at rest, in motion without a period, or with no motion at all; the message says which.
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
    u = _check.real("u", u, low=0.0, high=LARGEST_SPEED, open_low=True)
    rtol = _check.real("rtol", rtol, low=1e-10, high=1e-2)
    samples = _check.count("samples", samples, low=9, high=100_000)
    motion = Field(model)
    with one_thread(motion.size):
        orbit, how = orbit_from(motion, u, start)
        return finished(motion, orbit, rtol, samples, how)


# ----------------------------------------------------------------------------- where it begins


def orbit_from(motion: Field, u: float, start: Any) -> tuple[Orbit, str]:
    """A cycle on few phases, and how it was found."""
    if start is None:
        return _unguided(motion, u)
    if isinstance(start, LimitCycle):
        return _from_cycle(motion, u, start), "from a cycle"
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
    size = motion.model.coordinates
    y = _check.array("start", start, size=2 * size, low=-1e6, high=1e6)
    return _simulated(motion, u, y[:size], y[size:]), "simulation"


def _unguided(motion: Field, u: float) -> tuple[Orbit, str]:
    """From the onsets of flutter, the nearest first, then by simulation."""
    model, told = motion.model, []
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
        except PipedynError:
            continue
        born.append(onset)
        if onset.amplitude_law * (u - onset.speed) > 0.0:
            try:
                return _leapt(motion, onset, u), f"from the onset at u = {onset.speed:.6g}"
            except Elsewhere as reason:
                told.append(str(reason))
    for onset in born:
        beyond = onset.amplitude_law * (u - onset.speed) > 0.0
        if beyond or onset.criticality == "subcritical":
            try:
                return follow(motion, onset, u), f"followed from the onset at u = {onset.speed:.6g}"
            except Elsewhere as reason:
                told.append(str(reason))
    if unstable:
        q0, qdot0 = _nudged(motion, u)
        return _simulated(motion, u, q0, qdot0), "simulation"
    first = min((c.speed for c in passages if c.destabilising), default=math.nan)
    where = f": flutter sets in at u = {first:.6g}" if first > u else ""
    why = f" ({'; '.join(dict.fromkeys(told))})" if told else ""
    raise NoCycle(
        f"the pipe rests stably at u = {u:g}{where}, and no cycle comes from an onset{why}; "
        "one far from rest may be found with start=",
        u,
    )


def _unstable(motion: Field, u: float) -> bool:
    values = np.linalg.eigvals(motion.jacobian(motion.resting(), u))
    return bool(values.real.max() > 1e-9 * (1.0 + float(np.abs(values).max())))


def _leapt(motion: Field, onset: Hopf, u: float) -> Orbit:
    """From the law at the onset to the speed at once."""
    amplitude = onset.amplitude(u)
    if amplitude > 0.6:
        raise Elsewhere("the onset is too far")
    omega = onset.frequency + onset.frequency_law * (u - onset.speed)
    omega = omega if omega > 0.3 * onset.frequency else onset.frequency
    ring = birth_of(motion, onset).ring(motion, amplitude, u, omega)
    return _confirmed(motion, Equations(motion, ring.phases).solve(ring))


def _confirmed(motion: Field, coarse: Orbit) -> Orbit:
    """The same cycle on twice the phases: too few have solutions of their own."""
    finer = coarse.on(2 * (coarse.phases.count // 2) * 2)
    finer = Equations(motion, finer.phases).solve(finer)
    if abs(finer.size / coarse.size - 1.0) > 0.1:
        raise Elsewhere("what was found does not stand a doubling of the phases")
    return replace(finer, coarser=coarse)


def follow(motion: Field, onset: Hopf, u: float, steps: int = 60) -> Orbit:
    """The cycle that is born at an onset, followed past folds until it reaches a speed.

    Args:
        motion: the model's.
        onset: where it begins.
        u: where to end.
        steps: how many cycles are computed on the way at most.

    Raises:
        Elsewhere: if it does not come there.
    """
    begun = motion.evaluations
    for step in islice(arc(motion, from_birth(motion, birth_of(motion, onset))), steps):
        a, b = step.begin.u, step.end.u
        if (a - u) * (b - u) <= 0.0 and a != b:
            return _confirmed(motion, step.landing(u))
        if not 0.2 * min(u, onset.speed) < b < 3.0 * max(u, onset.speed):
            break
        if motion.evaluations > begun + SEARCH:
            break
    raise Elsewhere(f"the cycle born at u = {onset.speed:.6g} does not come to u = {u:g}")


def birth_of(motion: Field, onset: Hopf) -> Birth:
    """Where the cycles of a flutter come from."""
    return Birth(onset.rest, onset.mode, onset.speed, onset.frequency)


def _from_cycle(motion: Field, u: float, start: LimitCycle) -> Orbit:
    size = motion.model.coordinates
    if start.model.coordinates != size or start.model.moving != motion.half:
        raise ValueError(
            f"start must be a cycle of {size} coordinates, got {start.model.coordinates}"
        )
    p = _integrated(motion, start.q, start.qdot)
    count = max(16, start.phases // (2 if start.symmetric else 4))
    guess = _resampled(motion, u, start.t, p, start.period, count, 1e-6)
    return _improved(motion, guess, u)


def _integrated(motion: Field, q: Array, qdot: Array) -> Array:
    """[p, p'] of coordinates and rates, shape (S, 2 moving)."""
    if motion.model.coordinates == motion.half:
        return np.concatenate([q, qdot], axis=1)
    return np.array([motion.model.start(*pair) for pair in zip(q, qdot, strict=True)])


def _resampled(
    motion: Field, u: float, t: Array, p: Array, period: float, count: int, likeness: float
) -> Orbit:
    """An orbit through samples that span at least one period from t[0] on."""
    half = motion.half
    spline = CubicHermiteSpline(t, p[:, :half], p[:, half:])
    rates = CubicHermiteSpline(t, p[:, half:], motion(np.ascontiguousarray(p.T), u)[half:].T)
    odd = False
    if is_odd(motion, u):
        probe = t[0] + period * np.arange(32) / 64.0
        here, later = spline(probe), spline(probe + 0.5 * period)
        odd = float(np.abs(here + later).max()) <= likeness * float(np.abs(here).max())
    phases = Phases(count + count % 2 if odd else 2 * count + 1, odd)
    at = t[0] + period * phases.at / (2.0 * math.pi)
    z = spline(at) if not motion.tied else np.concatenate([spline(at), rates(at)], axis=1)
    return Orbit(phases, np.asarray(z), 2.0 * math.pi / period, u)


def _improved(motion: Field, guess: Orbit, u: float) -> Orbit:
    try:
        return Equations(motion, guess.phases).solve(guess)
    except Elsewhere as reason:
        raise NoCycle(f"no limit cycle at u = {u:g} from that start: {reason}", u) from None


def _nudged(motion: Field, u: float) -> tuple[Array, Array]:
    """A state near rest, in the direction that grows fastest."""
    rest = motion.resting()
    values, vectors = np.linalg.eig(motion.jacobian(rest, u))
    grown = vectors[:, int(np.argmax(values.real))].real
    grown = grown / float(np.abs(grown[: motion.half]).max())
    y = rest + 0.1 * grown
    q, qdot = motion.model.recorded(y[None, : motion.half], y[None, motion.half :])
    return q[0], qdot[0]


def _simulated(motion: Field, u: float, q0: Array, qdot0: Array) -> Orbit:
    """From where a motion settles."""
    model = motion.model
    reason = "the motion comes back to no state it had before"
    first = motion.resting()
    q_rest = model.recorded(first[None, : motion.half], first[None, motion.half :])[0][0]
    evaluations = 0
    while evaluations < SEARCH:
        try:
            going = simulate(model, u, CHUNK, q0, qdot0, rtol=1e-6, samples=1001)
        except MotionStopped as stopped:
            raise NoCycle(f"no limit cycle at u = {u:g} from there: {stopped}", u) from None
        evaluations += going.evaluations
        motion.evaluations += going.evaluations
        q0, qdot0 = going.q[-1], going.qdot[-1]
        moves = float(np.ptp(going.q[500:], axis=0).max())
        if moves < 1e-4 and moves <= 1.01 * float(np.ptp(going.q[:500], axis=0).max()):
            where = "rest" if np.abs(q0 - q_rest).max() < 1e-2 else "a bent pipe at rest"
            raise NoCycle(f"no limit cycle at u = {u:g} from there: the motion ends in {where}", u)
        guess = _from_motion(motion, u, going)
        if guess is None:
            continue
        try:
            found = Equations(motion, guess.phases).solve(guess)
        except Elsewhere as told:
            reason = str(told)
            continue
        # One far from the motion may be any, most likely one that repels.
        away = float(np.sqrt(np.mean(np.sum((found.z - guess.z) ** 2, axis=1))))
        if away < 0.05 * found.size:
            return found
        reason = "the motion does not settle"
    raise NoCycle(f"no limit cycle at u = {u:g} from there: {reason}", u)


def _from_motion(motion: Field, u: float, going: Motion) -> Orbit | None:
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
    return _resampled(motion, u, at, spline(at), period, 32 * (turns + 1), 0.02)


# --------------------------------------------------------------------------------- what it is


def finished(motion: Field, orbit: Orbit, rtol: float, samples: int, how: str) -> LimitCycle:
    """The cycle, refined until its amplitude and frequency stand still and its check holds."""
    # Under drag two answers may agree by chance: believed is no more than the fourth power of N.
    kinks = motion.model.pipe.drag > 0.0
    measured, error, last = amplitude_of(motion, orbit), math.inf, math.inf if kinks else 0.0
    if orbit.coarser is not None:
        last = _apart(orbit.coarser, amplitude_of(motion, orbit.coarser), orbit, measured)
        error = math.inf if kinks else last
    reason, target = Elsewhere(f"that takes more than {MOST_POINTS} phases"), 0.5 * rtol
    while True:
        while error > target:
            try:
                finer = orbit.on(2 * (orbit.phases.count // 2) * 2)
                if finer.phases.count > MOST_POINTS + 1:
                    break
                finer = Equations(motion, finer.phases).solve(finer, min(1e-9, 1e-2 * rtol))
            except Elsewhere as told:
                reason = told
                break
            sharper = amplitude_of(motion, finer)
            moved = _apart(orbit, measured, finer, sharper)
            error, last = max(moved, last / 16.0), moved
            orbit, measured = finer, sharper
        if math.isinf(error):
            raise NoCycle(f"no limit cycle at u = {orbit.u:g}: {reason}", orbit.u)
        result = described(motion, orbit, error, samples, how)
        if error > rtol:
            raise NotConverged(
                f"the cycle at u = {orbit.u:g} is known to {error:.1e} only: {reason}", result
            )
        if result.multiplier_error <= max(TRIVIAL, rtol):
            return result
        if error > target or target < 1e-3 * rtol:
            raise NotConverged(
                f"the cycle at u = {orbit.u:g} fails its check: its Floquet multipliers, one of "
                f"which should be 1, are known to {result.multiplier_error:.1e} only",
                result,
            )
        target *= 0.1  # the multipliers ask for more


def _apart(a: Orbit, peak: tuple[float, float], b: Orbit, other: tuple[float, float]) -> float:
    """Relative difference of two cycles' amplitudes and frequencies."""
    moved = abs(other[0] / peak[0] - 1.0)
    return max(moved, abs(b.frequency / a.frequency - 1.0), 1e-14)


def amplitude_of(motion: Field, orbit: Orbit) -> tuple[float, float]:
    """Half the free end's peak-to-peak motion, and the phase of its greatest displacement."""
    phase: Array = 2.0 * math.pi / PEAKS * np.arange(float(PEAKS))
    across = motion.tip(Equations(motion, orbit.phases).states(orbit, phase))
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
    equations = Equations(motion, orbit.phases)
    amplitude, first = amplitude_of(motion, orbit)
    period = 2.0 * math.pi / orbit.frequency
    t = np.linspace(0.0, period, samples)
    y = equations.states(orbit, first + orbit.frequency * t)
    q, qdot = motion.model.recorded(y[: motion.half].T.copy(), y[motion.half :].T.copy())
    middle: Array = orbit.phases.at + 0.5 * orbit.phases.span / orbit.phases.count
    missed = np.abs(equations.residual(orbit, middle)[:, -motion.half :]).max()
    largest = np.abs(motion(equations.states(orbit), orbit.u)[motion.half :]).max()
    multipliers, unsettled = floquet(motion, orbit)
    trivial = int(np.argmin(np.abs(multipliers - 1.0)))
    others = np.abs(np.delete(multipliers, trivial))
    return LimitCycle(
        amplitude=amplitude,
        frequency=orbit.frequency,
        period=period,
        multipliers=multipliers,
        stable=bool(others.max(initial=0.0) < 1.0),
        t=t,
        q=np.ascontiguousarray(q),
        qdot=np.ascontiguousarray(qdot),
        u=orbit.u,
        model=motion.model,
        error=error,
        multiplier_error=max(float(np.abs(multipliers[trivial] - 1.0)), unsettled),
        residual=float(missed / largest),
        symmetric=orbit.phases.half,
        phases=orbit.phases.count,
        evaluations=motion.evaluations,
        method=f"Fourier collocation, {how}",
    )
