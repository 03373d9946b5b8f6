# SPDX-License-Identifier: MIT
"""Cycles as trigonometric polynomials, and the equations that make a motion of one.

One period goes through N states at equal phases and meets y' = f(y, u) there (Fourier collocation);
Newton's method with the analytic Jacobian finds it together with its frequency. The velocities are
eliminated, p' = omega dp/dphi, so that the unknowns are the N positions. A cycle of an odd system
mostly is its own mirror image half a period later: then half of a period and odd harmonics
describe it. The matrices are dense, for cycles of few harmonics: `panels` refines them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import lapack

from pipedyn.bifurcation.vector_field import Field
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

LARGEST_SYSTEM = 6000
"""Unknowns of a Newton step: 0.3 GB."""

CHORD = 1e-3
"""Relative step of Newton's method below which the next takes the same derivatives."""


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
        turn = np.exp(1j * phase)[:, None]
        waves = np.repeat(turn**2 if self.half else turn, self.harmonics.size, axis=1)
        waves[:, :1] = turn ** self.harmonics[0]
        waves = np.cumprod(waves, axis=1) * (1j * self.harmonics) ** order
        return np.concatenate([waves.real, waves.imag], axis=1)

    def weights(self, z: Array) -> Array:
        """Size of each harmonic of values at the phases, shape (harmonics,)."""
        parts = self._coefficients @ z
        sizes = np.hypot(parts[: self.harmonics.size], parts[self.harmonics.size :])
        total: Array = np.linalg.norm(sizes, axis=1)
        return total if self.half else total[1:]

    def odd(self, z: Array) -> Array:
        """What odd harmonics make of values at the phases: it changes its sign half a turn on."""
        own = np.tile(self.harmonics % 2 == 1, 2)
        part: Array = self._table(self.at, 0)[:, own] @ (self._coefficients[own] @ z)
        return part

    def between(self, z: Array, phase: Array | None, order: int = 0) -> Array:
        """Values at phases, or derivatives by the phase, from values at the own ones.

        Args:
            z: values at the own phases, shape (count, width).
            phase: where, shape (k,); the own ones where not given.
            order: of the derivative, 0, 1 or 2.

        Returns:
            Shape (k, width).
        """
        if phase is None:
            values: Array = z if order == 0 else (self.first, self.second)[order - 1] @ z
            return values
        values = self._table(phase, order) @ (self._coefficients @ z)
        return values

    @cached_property
    def first(self) -> Array:
        """Derivative by the phase, shape (count, count)."""
        matrix: Array = self._table(self.at, 1) @ self._coefficients
        return matrix

    @cached_property
    def second(self) -> Array:
        """Second derivative by the phase, shape (count, count)."""
        matrix: Array = self._table(self.at, 2) @ self._coefficients
        return matrix


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
        return np.ascontiguousarray(self.phases.between(self.z, phase).T)

    def on(self, count: int) -> Orbit:
        """The same with another number of phases."""
        phases = Phases(count, self.phases.half)
        return Orbit(phases, self.phases.between(self.z, phases.at), self.frequency, self.u)

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
        rates = orbit.frequency * orbit.phases.between(orbit.z, phase, 1)
        return np.concatenate([values, rates.T])

    def residual(self, orbit: Orbit, phase: Array | None = None) -> Array:
        """What of dy/dt - f(y) the unknowns decide, shape (k, width)."""
        rates = self.motion(self.states(orbit, phase), orbit.u)
        turned = [orbit.phases.between(orbit.z, phase, order) for order in (1, 2)]
        if self.motion.tied:
            return orbit.frequency * turned[0] - rates.T
        return orbit.frequency**2 * turned[1] - rates[self.motion.half :].T

    def _matrix(self, orbit: Orbit, turning: Array, row: Array | None) -> Array:
        """Derivatives by (z, omega), with a row by (z, omega, u), of all equations."""
        motion, phases, half = self.motion, self.phases, self.motion.half
        count, width, omega = phases.count, self.width, orbit.frequency
        y = self.states(orbit)
        jacobians = motion.jacobians(y, orbit.u)
        free = 1 if row is None else 2
        n = self.unknowns
        whole = np.zeros((n + free, n + free))
        rows = whole[:n].reshape(count, width, n + free)[:, :, :n]
        one = np.eye(width)[:, None]
        if motion.tied:
            for j, jacobian in enumerate(jacobians):
                block = (omega * phases.first[j])[:, None] * one
                block[:, j] -= jacobian
                rows[j] = block.reshape(width, n)
            by_frequency = phases.first @ orbit.z
        else:
            rates = phases.first @ orbit.z
            by_frequency = 2.0 * omega * (phases.second @ orbit.z)
            for j, jacobian in enumerate(jacobians):
                by_rate = jacobian[half:, half:]
                block = (omega**2 * phases.second[j])[:, None] * one
                block -= (omega * phases.first[j])[:, None] * by_rate[:, None]
                block[:, j] -= jacobian[half:, :half]
                rows[j] = block.reshape(width, n)
                by_frequency[j] -= by_rate @ rates[j]
        whole[:n, n] = by_frequency.ravel()
        whole[n, :n] = turning.ravel()
        if row is not None:
            by_speed = motion.by_speed(y, orbit.u)[-width:]
            whole[:n, n + 1] = -by_speed.T.ravel()
            whole[n + 1] = row
        return whole

    def _turning(self, orbit: Orbit) -> Array:
        """The direction in which the phase of an orbit moves, of unit length."""
        rates = self.phases.first @ orbit.z
        turning: Array = rates / np.linalg.norm(rates)
        return turning

    def tangent(self, orbit: Orbit, row: Array) -> Array:
        """Derivative of (z, omega, u) along the cycles' arc by a linear function of them.

        Args:
            orbit: a cycle.
            row: coefficients of the function.

        Raises:
            Elsewhere: if the equations do not tell it.
        """
        right = np.zeros(self.unknowns + 2)
        right[-1] = 1.0
        factors = _factored(self._matrix(orbit, self._turning(orbit), row))
        tangent: Array = scipy.linalg.lu_solve(factors, right)
        return tangent

    def neutral(self, orbit: Orbit) -> Array:
        """The change of z at one speed that changes the residual least, of unit length, z's shape.

        Raises:
            Elsewhere: if the equations do not tell it.
        """
        factors = _factored(self._matrix(orbit, self._turning(orbit), None))
        change = np.cos(np.arange(self.unknowns + 1) ** 2)  # in no direction of the system's own
        for _ in range(4):
            change = scipy.linalg.lu_solve(factors, change, trans=1)
            change = scipy.linalg.lu_solve(factors, change / np.linalg.norm(change))
        dz: Array = change[: self.unknowns].reshape(self.phases.count, self.width)
        return dz / np.linalg.norm(dz)

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
        size, omega, n = orbit.size, orbit.frequency, self.unknowns
        turning = self._turning(orbit)  # steps go across it, which fixes the phase
        right = np.zeros(n + (1 if row is None else 2))
        last, factors = math.inf, None
        for _ in range(25):
            with np.errstate(over="raise", invalid="raise"):
                try:
                    if factors is None:
                        factors = _factored(self._matrix(orbit, turning, row))
                    right[:n] = -self.residual(orbit).ravel()
                    if row is not None:
                        right[-1] = value - float(
                            row @ np.append(orbit.z, [orbit.frequency, orbit.u])
                        )
                    change = scipy.linalg.lu_solve(factors, right)
                except (FloatingPointError, ValueError) as error:
                    raise Elsewhere("Newton's method left finite numbers") from error
            dz, domega = change[:n].reshape(orbit.z.shape), float(change[n])
            du = 0.0 if row is None else float(change[-1])
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
            if moved > CHORD or moved > 0.1 * last:
                factors = None
            last = moved
        raise Elsewhere("Newton's method did not converge")


Factors: TypeAlias = "tuple[Array, NDArray[np.int32]]"


def _factored(whole: Array) -> Factors:
    """LU factors of a matrix."""
    if not np.isfinite(whole).all():
        raise Elsewhere("Newton's method left finite numbers")
    factorised()
    lu, pivots, singular = lapack.dgetrf(whole, overwrite_a=True)
    if singular:
        raise Elsewhere("Newton's method met a singular matrix")
    return lu, pivots


def is_odd(motion: Field, u: float) -> bool:
    """Whether the mirror image of every motion is one."""
    if motion.resting().any():
        return False
    k = np.arange(1.0, motion.size + 1.0)
    y = 0.3 * np.stack([np.sin(k), np.cos(2.0 * k), np.sin(3.0 * k + 1.0)], axis=1)
    rates = motion(np.concatenate([y, -y], axis=1), u)
    ahead, behind = rates[:, :3], rates[:, 3:]
    return bool(np.abs(ahead + behind).max() <= 1e-9 * np.abs(ahead).max())
