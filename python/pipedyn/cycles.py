# SPDX-License-Identifier: MIT
"""Limit cycles, stable or not, as periodic boundary-value problems.

One period is a trigonometric polynomial through N states at equal phases, which meets y' = f(y, u)
there (Fourier collocation); Newton's method with the analytic Jacobian finds it together with its
frequency. The velocities are eliminated, p' = omega dp/dphi, so that the unknowns are the N
positions. A cycle of an odd system mostly is its own mirror image half a period later: then half
of a period and odd harmonics describe it. N is doubled until amplitude and frequency stand still;
where f is analytic they do so faster than any power of N, under drag, |v| v, like one.

The modes of a chain that are far faster than its cycle hardly take part in it, so that a shooting
method would spend its steps on nothing: here they cost nothing but the size of the matrix.

Floquet multipliers come from the variational equation along the cycle, by a Magnus method of sixth
order (Blanes, Casas and Ros 2000), whose exponentials take fast modes in long steps. It shares
nothing with the collocation but the cycle, so the trivial multiplier checks both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.blas import one_thread
from pipedyn.critical import crossings
from pipedyn.field import Field
from pipedyn.hopf import Hopf, hopf
from pipedyn.modal import LARGEST_SPEED
from pipedyn.model import Model, NotConverged, PipedynError
from pipedyn.modular.moving import SceneMotion
from pipedyn.motion import Motion, MotionStopped, checked_model_in_motion, simulate
from pipedyn.pencil import Complex

LARGEST_CYCLE = 100
"""Degrees of freedom. A chain of 20 takes half a second, of 40 five, of 60 half a minute, nearly
all for the multipliers, whose steps the fastest mode sets."""

LARGEST_SYSTEM = 6000
"""Unknowns of a Newton step: 0.3 GB."""

MOST_POINTS = 1024
"""Phases in a half or whole period."""

TRIVIAL = 1e-6
"""How far the trivial multiplier may be from 1."""

LOCAL, MOST_STEPS, MOST_HALVINGS = 1e-8, 10_000, 20
"""Of the variational equation: error of one step, most steps of one length and halvings of one."""

LARGEST_RETRY = 500
"""Unknowns up to which a branch that is lost with few phases is followed with more."""

MOST_ONSETS = 4
"""Onsets of flutter that are tried, the nearest first."""

LONGEST_TURN = 6.0
"""Radians that the fastest mode turns in one step at most: beyond some 30 the commutators grow."""

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
        orbit, how = _found(motion, u, start)
        return _finished(motion, orbit, rtol, samples, how)


# ------------------------------------------------------------------------ phases and the equations


class Phases:
    """Equal phases and the trigonometric polynomials through values at them.

    Args:
        count: number of phases.
        half: whether they span half a period, of which the other half is the mirror image; then
            the count is even, else odd.
    """

    def __init__(self, count: int, half: bool) -> None:
        self.count = count if half else count | 1
        self.half = half
        self.span = math.pi if half else 2.0 * math.pi
        self.at: Array = self.span / self.count * np.arange(float(self.count))
        self.harmonics = np.arange(1, count, 2) if half else np.arange(self.count // 2 + 1)

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients of cosines and sines from values, shape (2 harmonics, count)."""
        table = self._table(self.at, 0).T * (2.0 / self.count)
        if not self.half:
            table[0] *= 0.5
        return table

    def _table(self, phase: Array, order: int) -> Array:
        """Cosines and sines, or their derivatives, shape (k, 2 harmonics)."""
        angle = np.outer(phase, self.harmonics) + 0.5 * math.pi * order
        power = self.harmonics.astype(np.float64) ** order
        return np.concatenate([power * np.cos(angle), power * np.sin(angle)], axis=1)

    def between(self, phase: Array, order: int = 0) -> Array:
        """Values, or derivatives by the phase, from values at the phases, shape (k, count)."""
        table: Array = self._table(phase, order) @ self._coefficients
        return table

    @cached_property
    def first(self) -> Array:
        """Derivative by the phase, shape (count, count)."""
        return self.between(self.at, 1)

    @cached_property
    def second(self) -> Array:
        """Second derivative by the phase, shape (count, count)."""
        return self.between(self.at, 2)


@dataclass(frozen=True)
class Orbit:
    """A periodic motion by its values at the phases.

    Attributes:
        phases: where.
        z: positions p, or with constraints whole states, shape (phases, width).
        frequency: omega.
        u: flow speed.
        coarser: the same cycle on half as many phases, where it was solved there.
    """

    phases: Phases
    z: Array
    frequency: float
    u: float
    coarser: Orbit | None = None

    def states(self, phase: Array | None = None) -> Array:
        """[p, p'] at the phases, or at others, shape (2 moving, k)."""
        values = self.z if phase is None else self.phases.between(phase) @ self.z
        return np.ascontiguousarray(values.T)

    def on(self, count: int) -> Orbit:
        """The same with another number of phases."""
        phases = Phases(count, self.phases.half)
        return Orbit(phases, self.phases.between(phases.at) @ self.z, self.frequency, self.u)

    @property
    def size(self) -> float:
        """Root mean square of what moves."""
        centre = 0.0 if self.phases.half else self.z.mean(axis=0)
        return float(np.sqrt(np.mean(np.sum((self.z - centre) ** 2, axis=1))))


class Elsewhere(Exception):
    """Newton's method that did not end on a cycle: the reason."""


class Equations:
    """The collocation equations of one model on given phases.

    With constraints by projection (`Field.tied`) the rate of p is not p' off the constraints, so
    that whole states are the unknowns; else the positions alone.

    Args:
        motion: the model's.
        phases: where the equations are met.
    """

    def __init__(self, motion: Field, phases: Phases) -> None:
        self.motion, self.phases = motion, phases
        self.width = motion.size if motion.tied else motion.half
        self.unknowns = phases.count * self.width
        if self.unknowns > LARGEST_SYSTEM:
            raise Elsewhere(f"more than {LARGEST_SYSTEM} unknowns are needed")

    def states(self, orbit: Orbit, phase: Array | None = None) -> Array:
        """[p, p'], shape (2 moving, k)."""
        values = orbit.states(phase)
        if self.motion.tied:
            return values
        at = orbit.phases.at if phase is None else phase
        rates = orbit.frequency * (orbit.phases.between(at, 1) @ orbit.z)
        return np.concatenate([values, rates.T])

    def residual(self, orbit: Orbit, phase: Array | None = None) -> Array:
        """What of dy/dt - f(y) the unknowns decide, shape (k, width)."""
        at = orbit.phases.at if phase is None else phase
        rates = self.motion(self.states(orbit, at), orbit.u)
        if self.motion.tied:
            return orbit.frequency * (orbit.phases.between(at, 1) @ orbit.z) - rates.T
        second = orbit.phases.between(at, 2)
        return orbit.frequency**2 * (second @ orbit.z) - rates[self.motion.half :].T

    def step(
        self, orbit: Orbit, turning: Array, row: Array | None, missed: float
    ) -> tuple[Array, float, float]:
        """Newton's step (dz, domega, du).

        Args:
            orbit: where it starts.
            turning: a direction across which the step goes, which fixes the phase; z's shape.
            row: a linear condition on (z, omega, u) that takes the place of a fixed speed.
            missed: by how much the condition is to change.
        """
        motion, phases, half = self.motion, self.phases, self.motion.half
        count, width, omega = phases.count, self.width, orbit.frequency
        y = self.states(orbit)
        jacobians = motion.jacobians(y, orbit.u)
        free = 1 if row is None else 2
        whole = np.zeros((self.unknowns + free, self.unknowns + free))
        blocks = np.zeros((count, width, count, width))
        own = np.arange(width)
        if motion.tied:
            blocks[:, own, :, own] += omega * phases.first
            for j, jacobian in enumerate(jacobians):
                blocks[j, :, j, :] -= jacobian
            by_frequency = phases.first @ orbit.z
        else:
            blocks[:, own, :, own] += omega**2 * phases.second
            for j, jacobian in enumerate(jacobians):
                by_rate = omega * jacobian[half:, half:]
                blocks[j] -= by_rate[:, None, :] * phases.first[j][None, :, None]
                blocks[j, :, j, :] -= jacobian[half:, :half]
            rates = phases.first @ orbit.z
            by_frequency = 2.0 * omega * (phases.second @ orbit.z)
            for j, jacobian in enumerate(jacobians):
                by_frequency[j] -= jacobian[half:, half:] @ rates[j]
        n = self.unknowns
        whole[:n, :n] = blocks.reshape(n, n)
        whole[:n, n] = by_frequency.ravel()
        whole[n, :n] = turning.ravel()
        right = np.zeros(n + free)
        right[:n] = -self.residual(orbit).ravel()
        if row is not None:
            by_speed = motion.by_speed(y, orbit.u)[-width:]
            whole[:n, n + 1] = -by_speed.T.ravel()
            whole[n + 1] = row
            right[n + 1] = missed
        try:
            found = scipy.linalg.solve(whole, right, overwrite_a=True, check_finite=False)
        except (np.linalg.LinAlgError, ValueError, scipy.linalg.LinAlgWarning) as error:
            raise Elsewhere("Newton's method met a singular matrix") from error
        if not np.isfinite(found).all():
            raise Elsewhere("Newton's method left finite numbers")
        return found[:n].reshape(count, width), float(found[n]), float(found[n + 1 :].sum())

    def solve(
        self, orbit: Orbit, tolerance: float = 1e-9, row: Array | None = None, value: float = 0.0
    ) -> Orbit:
        """The cycle near an orbit, by Newton's method.

        Args:
            orbit: where to begin.
            tolerance: the last step, relative; one that shrinks no more may end at 1e3 times that.
            row: coefficients of (z, omega, u) in a condition; the speed is fixed without.
            value: what the condition's sum is to be.

        Raises:
            Elsewhere: if it is lost.
        """
        size, omega = orbit.size, orbit.frequency
        turning = self.phases.first @ orbit.z
        turning = turning / np.linalg.norm(turning)
        last = math.inf
        for _ in range(25):
            missed = 0.0
            if row is not None:
                missed = value - float(row @ np.append(orbit.z, [orbit.frequency, orbit.u]))
            with np.errstate(over="raise", invalid="raise"):
                try:
                    dz, domega, du = self.step(orbit, turning, row, missed)
                except (FloatingPointError, ValueError) as error:
                    raise Elsewhere("Newton's method left finite numbers") from error
            moved = float(np.sqrt(np.mean(np.sum(dz**2, axis=1)))) / orbit.size
            moved = max(moved, abs(domega) / orbit.frequency, abs(du) / orbit.u)
            share = min(1.0, 0.5 / moved) if moved > 0.0 else 1.0
            orbit = Orbit(
                *(self.phases, orbit.z + share * dz, orbit.frequency + share * domega),
                orbit.u + share * du,
            )
            if not 0.1 * omega < orbit.frequency < 10.0 * omega or orbit.u <= 0.0:
                raise Elsewhere("Newton's method left the neighbourhood of its start")
            if orbit.size < 0.03 * size:
                raise Elsewhere("it shrank to rest")
            if orbit.size > 30.0 * size:
                raise Elsewhere("Newton's method left the neighbourhood of its start")
            if moved <= tolerance or (last < 1e3 * tolerance and moved >= 0.5 * last):
                return orbit
            last = moved
        raise Elsewhere("Newton's method did not converge")


# ----------------------------------------------------------------------------- where it begins


def _found(motion: Field, u: float, start: Any) -> tuple[Orbit, str]:
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


def is_odd(motion: Field, u: float) -> bool:
    """Whether the mirror image of every motion is one."""
    if motion.resting().any():
        return False
    k = np.arange(1.0, motion.size + 1.0)
    y = 0.3 * np.stack([np.sin(k), np.cos(2.0 * k), np.sin(3.0 * k + 1.0)], axis=1)
    rates = motion(np.concatenate([y, -y], axis=1), u)
    ahead, behind = rates[:, :3], rates[:, 3:]
    return bool(np.abs(ahead + behind).max() <= 1e-9 * np.abs(ahead).max())


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


def _ring(motion: Field, onset: Hopf, amplitude: float, u: float, count: int = 16) -> Orbit:
    """The critical mode with an amplitude of the free end."""
    half = is_odd(motion, u)
    phases = Phases(count if half else 2 * count + 1, half)
    width = motion.size if motion.tied else motion.half
    turn = np.exp(1j * phases.at)[:, None]
    z = motion.resting()[:width] + amplitude * (onset.mode[:width] * turn).real
    omega = onset.frequency + onset.frequency_law * (u - onset.speed)
    return Orbit(phases, z, omega if omega > 0.3 * onset.frequency else onset.frequency, u)


def _leapt(motion: Field, onset: Hopf, u: float) -> Orbit:
    """From the law at the onset to the speed at once."""
    amplitude = onset.amplitude(u)
    if amplitude > 0.6:
        raise Elsewhere("the onset is too far")
    ring = _ring(motion, onset, amplitude, u)
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
    reason = Elsewhere(f"the cycle born at u = {onset.speed:.6g} does not come to u = {u:g}")
    for count in (16, 48):
        if count > 16 and count * motion.half > LARGEST_RETRY:
            break
        try:
            for last, here in pairwise(_branch(motion, onset, steps, count)):
                if (last.u - u) * (here.u - u) <= 0.0 and here.u != last.u:
                    share = (u - last.u) / (here.u - last.u)
                    guess = Orbit(
                        here.phases,
                        last.z + share * (here.z - last.z),
                        last.frequency + share * (here.frequency - last.frequency),
                        u,
                    )
                    return _confirmed(motion, Equations(motion, here.phases).solve(guess))
                if not 0.2 * min(u, onset.speed) < here.u < 3.0 * max(u, onset.speed):
                    break
        except Elsewhere as told:
            reason = told
    raise reason


def _branch(motion: Field, onset: Hopf, steps: int, count: int) -> Iterator[Orbit]:
    """Cycles from the onset on, by pseudo-arclength continuation."""
    found: list[Orbit] = []
    for amplitude in (0.02, 0.05):
        share = amplitude ** (1.0 / onset.exponent) / onset.amplitude_law
        ring = _ring(motion, onset, amplitude, onset.speed + share, count)
        rest = motion.resting()[: ring.z.shape[1]]
        along = np.append((ring.z - rest).ravel(), [0.0, 0.0])
        value = float(along @ np.append(ring.z, [0.0, 0.0]))
        found.append(Equations(motion, ring.phases).solve(ring, row=along, value=value))
        yield found[-1]
    # Distances in the free end's amplitude, and in speed and frequency relative to the onset's.
    unit = found[-1].size / 0.05
    weights = np.append(
        np.full(ring.z.size, 1.0 / (ring.phases.count * unit**2)),
        [onset.frequency**-2, onset.speed**-2],
    )
    length = 0.05
    begun = motion.evaluations
    for _ in range(steps):
        if motion.evaluations > begun + SEARCH:
            raise Elsewhere(f"the cycle born at u = {onset.speed:.6g} was not followed to the end")
        last, here = found[-2], found[-1]
        ahead, now = (np.append(o.z, [o.frequency, o.u]) for o in (last, here))
        secant = now - ahead
        secant = secant / math.sqrt(float(weights @ secant**2))
        while True:
            there = now + length * secant
            z, omega, speed = there[:-2].reshape(here.z.shape), float(there[-2]), float(there[-1])
            guess = Orbit(here.phases, z, omega, speed)
            row = weights * secant
            try:
                if guess.u <= 0.0 or guess.frequency <= 0.0:
                    raise Elsewhere("the branch left positive speeds")
                solved = Equations(motion, guess.phases).solve(
                    guess, 1e-7, row=row, value=float(row @ there)
                )
                break
            except Elsewhere:
                length *= 0.4
                if length < 1e-4:
                    raise
        found.append(solved)
        yield solved
        length = min(1.3 * length, 0.15)


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


def _finished(motion: Field, orbit: Orbit, rtol: float, samples: int, how: str) -> LimitCycle:
    """The cycle, refined until its amplitude and frequency stand still and its check holds."""
    # Under drag two answers may agree by chance: believed is no more than the fourth power of N.
    kinks = motion.model.pipe.drag > 0.0
    measured, error, last = _amplitude(motion, orbit), math.inf, math.inf if kinks else 0.0
    if orbit.coarser is not None:
        last = _apart(orbit.coarser, _amplitude(motion, orbit.coarser), orbit, measured)
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
            sharper = _amplitude(motion, finer)
            moved = _apart(orbit, measured, finer, sharper)
            error, last = max(moved, last / 16.0), moved
            orbit, measured = finer, sharper
        if math.isinf(error):
            raise NoCycle(f"no limit cycle at u = {orbit.u:g}: {reason}", orbit.u)
        result = _described(motion, orbit, error, samples, how)
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


def _amplitude(motion: Field, orbit: Orbit) -> tuple[float, float]:
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


def _described(motion: Field, orbit: Orbit, error: float, samples: int, how: str) -> LimitCycle:
    equations = Equations(motion, orbit.phases)
    amplitude, first = _amplitude(motion, orbit)
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


def floquet(motion: Field, orbit: Orbit) -> tuple[Complex, float]:
    """Floquet multipliers, the largest modulus first, shape (2 dof,), and the steps' summed error.

    Args:
        motion: the model's.
        orbit: the cycle.
    """
    tangent = _tangent(motion, orbit)
    through, error = _monodromy(motion, orbit)
    if not np.isfinite(through).all():
        return np.full(2 * motion.model.dof, np.nan + 0j), math.inf
    if tangent is not None:
        through = tangent.T @ through @ tangent
    values = np.linalg.eigvals(through)
    if orbit.phases.half:
        values = values**2
    order = np.lexsort((-values.imag, -np.abs(values)))
    return values[order].astype(np.complex128), error


def _tangent(motion: Field, orbit: Orbit) -> Array | None:
    """An orthonormal basis of the perturbations that meet the constraints, where there are any."""
    if not motion.tied:
        return None
    half, h = motion.half, 1e-5
    y = Equations(motion, orbit.phases).states(orbit, np.zeros(1))
    moves = h * np.eye(motion.size)
    scene = motion.model.motion
    assert isinstance(scene, SceneMotion)
    ahead, behind = (
        np.concatenate(scene.projected((y + s * moves)[:half], (y + s * moves)[half:]))
        for s in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * motion.model.dof])


def _monodromy(motion: Field, orbit: Orbit) -> tuple[Array, float]:
    """Fundamental matrix over the phases' span; with a mirror, followed by the reflection.

    Each step is halved until the product of its halves does what it does itself, so that short
    steps are taken only where drag's derivative has kinks.
    """
    span, omega, half = orbit.phases.span, orbit.frequency, motion.half
    along = _jacobians_along(motion, orbit)
    first = along(np.zeros(1))[0]
    # Rates in units in which the fastest mode turns at about the rate of its coordinates: without,
    # the squarings of the exponential would lose digits to the matrix's lopsidedness.
    ratio = math.sqrt(max(float(np.abs(first[half:, :half]).max()), 1.0))
    by, back = np.ones(motion.size), np.ones(motion.size)
    by[half:], back[half:] = 1.0 / ratio, ratio
    turns = float(np.abs(np.linalg.eigvals(first)).max()) * span / omega
    steps = max(16, math.ceil(turns / LONGEST_TURN))

    def factors(starts: Array, length: float) -> Array:
        found = np.empty((starts.size, motion.size, motion.size))
        nodes = length * (0.5 + math.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]))
        for i in range(0, starts.size, 64):
            rates = along((starts[i : i + 64, None] + nodes).ravel()) * np.outer(by, back)
            rates = rates.reshape(-1, 3, motion.size, motion.size)
            with np.errstate(over="ignore", invalid="ignore"):  # steps too long: NaN tells
                found[i : i + 64] = scipy.linalg.expm(_magnus(length / omega, rates))
        return found

    length = span / steps
    starts = length * np.arange(float(steps))
    whole = factors(starts, length)
    done: list[tuple[float, Array]] = []
    error = 0.0
    for level in range(MOST_HALVINGS + 1):
        length *= 0.5
        starts = (starts[:, None] + length * np.arange(2.0)).ravel()
        parts = factors(starts, length)
        products = parts[1::2] @ parts[0::2]
        told = np.abs(products - whole).max(axis=(1, 2)) / (1.0 + np.abs(whole).max(axis=(1, 2)))
        good = told <= LOCAL
        if level == MOST_HALVINGS or 2 * np.sum(~good) > MOST_STEPS:
            good[:] = True
        done += [(starts[2 * i], products[i]) for i in np.flatnonzero(good)]
        error += float(told[good].sum())
        again = np.repeat(~good, 2)
        starts, whole = starts[again], parts[again]
        if starts.size == 0:
            break
    through = np.eye(motion.size)
    for _, product in sorted(done, key=lambda pair: pair[0]):
        through = product @ through
    through = through * np.outer(back, by)
    # What halving leaves: less than a quarter at a kink, a 64th where f is smooth.
    error /= 4.0 if motion.model.pipe.drag else 32.0
    return -through if orbit.phases.half else through, error


def _jacobians_along(motion: Field, orbit: Orbit) -> Callable[[Array], Array]:
    """df/dy at phases, shape (k,) to (k, 2 moving, 2 moving).

    Where f is smooth this is a trigonometric polynomial as the cycle is, of the period of the
    phases' span even if the cycle's is twice that, and few Jacobians tell it all.
    """
    equations = Equations(motion, orbit.phases)

    def exact(phase: Array) -> Array:
        return motion.jacobians(equations.states(orbit, phase), orbit.u)

    if motion.model.pipe.drag:
        return exact
    span, count = orbit.phases.span, 2 * orbit.phases.count
    at: Array = span / count * np.arange(float(count))
    samples = exact(at)
    waves = np.fft.rfft(samples.reshape(count, -1), axis=0) / count
    waves[1:] *= 2.0
    if count % 2 == 0:
        waves[-1] *= 0.5
    size = np.abs(samples).max(axis=0)
    weight = (np.abs(waves) / (size + 1e-6 * size.max()).ravel()).max(axis=1)
    waves = waves[: int(np.flatnonzero(weight > 1e-12).max(initial=0)) + 1]
    numbers = 2.0 * math.pi / span * np.arange(len(waves))

    def between(phase: Array) -> Array:
        angle = np.outer(phase, numbers)
        values = np.cos(angle) @ waves.real - np.sin(angle) @ waves.imag
        return values.reshape(-1, motion.size, motion.size)

    probe: Array = at[::7] + 0.43 * span / count
    missed = np.abs(between(probe) - exact(probe)).max(axis=0)
    return between if (missed <= 1e-9 * size + 1e-12 * size.max()).all() else exact


def _magnus(h: float, a: Array) -> Array:
    """Exponents of the steps, (k, N, N), from the matrices at three Gauss points, (k, 3, N, N)."""
    one = h * a[:, 1]
    two = math.sqrt(15.0) / 3.0 * h * (a[:, 2] - a[:, 0])
    three = 10.0 / 3.0 * h * (a[:, 2] - 2.0 * a[:, 1] + a[:, 0])

    def across(x: Array, y: Array) -> Array:
        return x @ y - y @ x

    first = across(one, two)
    second = -across(one, 2.0 * three + first) / 60.0
    exponents: Array = (
        one + three / 12.0 + across(-20.0 * one - three + first, two + second) / 240.0
    )
    return exponents
