# SPDX-License-Identifier: MIT
"""Cycles as trigonometric polynomials, and the equations that make a motion of one.

One period goes through N states at equal phases and meets y' = f(y, u) there (Fourier collocation);
Newton's method with the analytic Jacobian finds it together with its frequency. The velocities are
eliminated, p' = omega dp/dphi, so that the unknowns are the N positions. A cycle of an odd system
mostly is its own mirror image half a period later: then half of a period and odd harmonics
describe it. An arc of cycles goes on by pseudo-arclength, on more phases where they are needed.
The matrices are dense, for cycles of few harmonics: `panels` refines them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from pipedyn._check import Array
from pipedyn.effort import factorised
from pipedyn.field import Field
from pipedyn.pencil import Complex

LARGEST_SYSTEM = 6000
"""Unknowns of a Newton step: 0.3 GB."""

MOST_UNKNOWNS = 1600
"""Up to which an arc goes on with more phases."""

SMOOTH, SMOOTH_ACROSS_KINKS = 1e-6, 3e-5
"""Share of the last harmonics beyond which an arc takes more phases; with drag it falls slowly."""

FIRST, LONGEST, SHORTEST = 0.03, 0.15, 1e-4
"""Steps of an arc: in L of the free end, and relative in speed and frequency."""

STRAIGHT = 0.8
"""Cosine of the angle between steps below which one is made shorter."""


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

    def weights(self, z: Array) -> Array:
        """Size of each harmonic of values at the phases, shape (harmonics,)."""
        parts = self._coefficients @ z
        sizes = np.hypot(parts[: self.harmonics.size], parts[self.harmonics.size :])
        total: Array = np.linalg.norm(sizes, axis=1)
        return total if self.half else total[1:]

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
    """

    phases: Phases
    z: Array
    frequency: float
    u: float

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

    @property
    def last_share(self) -> float:
        """Size of the last eighth of the harmonics beside the largest: what more would add."""
        waves = self.phases.weights(self.z)
        return float(waves[-max(waves.size // 8, 2) :].max() / waves.max())


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
        factorised()
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


def is_odd(motion: Field, u: float) -> bool:
    """Whether the mirror image of every motion is one."""
    if motion.resting().any():
        return False
    k = np.arange(1.0, motion.size + 1.0)
    y = 0.3 * np.stack([np.sin(k), np.cos(2.0 * k), np.sin(3.0 * k + 1.0)], axis=1)
    rates = motion(np.concatenate([y, -y], axis=1), u)
    ahead, behind = rates[:, :3], rates[:, 3:]
    return bool(np.abs(ahead + behind).max() <= 1e-9 * np.abs(ahead).max())


# ------------------------------------------------------------------------------- arcs of cycles


@dataclass(frozen=True)
class Birth:
    """A pair on the axis, from which small cycles come.

    Attributes:
        rest: the equilibrium, shape (2 moving,).
        mode: complex, of unit displacement of the free end, shape (2 moving,).
        speed, frequency: of the pair.
    """

    rest: Array = field(repr=False)
    mode: Complex = field(repr=False)
    speed: float
    frequency: float

    def ring(
        self, motion: Field, amplitude: float, u: float, frequency: float, count: int = 16
    ) -> Orbit:
        """The mode with an amplitude of the free end, on `count` phases in half a period."""
        half = not self.rest.any() and is_odd(motion, u)
        phases = Phases(count if half else 2 * count + 1, half)
        width = motion.size if motion.tied else motion.half
        turn = np.exp(1j * phases.at)[:, None]
        z = self.rest[:width] + amplitude * (self.mode[:width] * turn).real
        return Orbit(phases, z, frequency, u)


@dataclass(frozen=True)
class Step:
    """A step of an arc, any point of which can be solved for.

    Attributes:
        begin, end: cycles on the same phases.
        along: direction in (z, omega, u), of unit length.
        row: the same with the weights of each entry.
        length: of the step.
    """

    motion: Field = field(repr=False)
    begin: Orbit
    end: Orbit
    along: Array = field(repr=False)
    row: Array = field(repr=False)
    length: float

    def at(self, s: float) -> Orbit:
        """The cycle at a length from the step's beginning.

        Raises:
            Elsewhere: if Newton's method does not settle.
        """
        share = s / self.length
        first, last = packed(self.begin), packed(self.end)
        value = float(self.row @ first) + s
        guess = unpacked(first + share * (last - first), self.begin)
        equations = Equations(self.motion, self.begin.phases)
        return equations.solve(guess, row=self.row, value=value)

    def landing(self, u: float) -> Orbit:
        """The cycle at a speed between those of the ends.

        Raises:
            Elsewhere: if Newton's method does not settle.
        """
        first, last = packed(self.begin), packed(self.end)
        share = (u - self.begin.u) / (self.end.u - self.begin.u)
        guess = replace(unpacked(first + share * (last - first), self.begin), u=u)
        found = Equations(self.motion, guess.phases).solve(guess)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise Elsewhere("Newton's method left the neighbourhood of its start")
        return found

    def reach(self, orbit: Orbit) -> float:
        """Length from the step's beginning at which an orbit lies."""
        return float(self.row @ (packed(orbit) - packed(self.begin)))

    def part(self, begin: Orbit, end: Orbit) -> Step:
        """What lies between two of its points."""
        length = self.reach(end) - self.reach(begin)
        return replace(self, begin=begin, end=end, length=length)


def packed(orbit: Orbit) -> Array:
    """(z, omega, u), shape (unknowns + 2,)."""
    return np.append(orbit.z, [orbit.frequency, orbit.u])


def unpacked(values: Array, like: Orbit) -> Orbit:
    """The orbit of (z, omega, u)."""
    z = values[:-2].reshape(like.z.shape)
    return Orbit(like.phases, z, float(values[-2]), float(values[-1]))


def arc(motion: Field, birth: Birth) -> Iterator[Step]:
    """Steps along the cycles that are born at an onset, past folds, without end.

    Args:
        motion: the model's.
        birth: where it begins; the first step doubles an amplitude of 0.01 or, where the speed is
            by then more than 1e-3 from the onset, less.

    Raises:
        Elsewhere: where it cannot be followed.
    """
    amplitude = 0.01
    small = _small(motion, birth, amplitude)
    while abs(small.u - birth.speed) > 1e-3 * birth.speed and amplitude > 1e-4:
        amplitude *= 0.3
        small = _small(motion, birth, amplitude)
    here = _small(motion, birth, 2.0 * amplitude)
    unit = 0.5 * here.size / amplitude
    length = FIRST
    smooth = SMOOTH_ACROSS_KINKS if motion.model.pipe.drag else SMOOTH
    last, first = small, True
    while True:
        weights = np.append(
            np.full(here.z.size, 1.0 / (here.phases.count * unit**2)),
            [birth.frequency**-2, birth.speed**-2],
        )
        along = packed(here) - packed(last)
        covered = math.sqrt(float(weights @ along**2))
        along = along / covered
        row = weights * along
        if first:
            yield Step(motion, last, here, along, row, covered)
            first = False
        while True:
            guess = unpacked(packed(here) + length * along, here)
            try:
                if guess.u <= 0.0 or guess.frequency <= 0.0:
                    raise Elsewhere("the branch left positive speeds")
                value = float(row @ packed(here)) + length
                found = Equations(motion, guess.phases).solve(guess, 1e-8, row=row, value=value)
                moved = packed(found) - packed(here)
                bent = length / math.sqrt(float(weights @ moved**2)) < STRAIGHT
                if bent and length > SHORTEST:
                    raise Elsewhere("the step turned too far")
                break
            except Elsewhere:
                length *= 0.4
                if length < SHORTEST:
                    raise
        if found.last_share > smooth:
            count = 2 * (here.phases.count // 2) * 2
            if (count + 1) * here.z.shape[1] > MOST_UNKNOWNS:
                raise Elsewhere(f"more than {here.phases.count} phases are needed")
            last, here = last.on(count), here.on(count)
            here = Equations(motion, here.phases).solve(here, 1e-8)
            continue
        yield Step(motion, here, found, along, row, length)
        last, here = here, found
        length = min(1.3 * length, LONGEST)


def _small(motion: Field, birth: Birth, amplitude: float) -> Orbit:
    """The cycle of a small amplitude, at whatever speed."""
    ring = birth.ring(motion, amplitude, birth.speed, birth.frequency)
    rest = birth.rest[: ring.z.shape[1]]
    row = np.append((ring.z - rest).ravel(), [0.0, 0.0])
    return Equations(motion, ring.phases).solve(ring, row=row, value=float(row @ packed(ring)))
