# SPDX-License-Identifier: MIT
"""Periodic orbits as solutions of collocation equations: a Radau IIA method on a mesh.

The stages are eliminated interval by interval, which leaves y(k+1) = T(k) y(k) + g(k); orthogonal
transformations then eliminate the states in pairs down to L y(0) + R y(end) = c (Wright 1992). No
product of the T is formed, so that neither modes that decay at once nor large multipliers cost
digits. The cost is linear in the number of intervals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipedyn.bifurcation.continuation import Continuation, Control
from pipedyn.bifurcation.periodic_orbit import (
    NODES,
    ONCE,
    PROBES,
    STAGES,
    TWICE,
    PeriodicOrbit,
    integrals,
)
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed

# -------------------------------------------------------------------------------- one interval


def _condensed(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Array, Array]:
    """Derivatives of each interval's stages and of the state at its end.

    By the state at its beginning, a share of the residual, the frequency and the speed: of the
    stages' rates, shape (M, s, width, 2 moving + 3), and of the state, (M, 2 moving, 2 moving + 3).
    """
    count, _, width = orbit.rates.shape
    piece = max(1, 500_000 // (STAGES * width) ** 2)  # intervals whose 4 MB a cache holds
    parts = []
    for i in range(0, count, piece):
        some = slice(i, i + piece)
        edges = orbit.edges[i : i + piece + 1]
        part = replace(orbit, edges=edges, starts=orbit.starts[some], rates=orbit.rates[some])
        parts.append(_eliminated(motion, part))
    rates, ends = (np.concatenate(part) for part in zip(*parts, strict=True))
    return rates, ends


def _eliminated(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Array, Array]:
    """`_condensed` of a few intervals."""
    count, _, width = orbit.rates.shape
    size, u, twice = motion.size, orbit.u, orbit.twice
    y = np.ascontiguousarray(orbit.stages().reshape(-1, size).T)
    missed = motion(y, u)[-width:].T.reshape(orbit.rates.shape) - orbit.rates
    by_speed = motion.by_speed(y, u)[-width:].T.reshape(orbit.rates.shape)
    rows = motion.jacobians(y, u)[:, -width:].reshape(count, STAGES, width, size)
    # Derivatives at fixed rates: of the stages by time, and of f there by the first state.
    h, lag = orbit.durations[:, None, None], NODES[:, None]
    by_start = rows.copy()
    by_start[..., twice : 2 * twice] += (h * lag)[..., None] * rows[..., :twice]
    by_time = np.zeros((count, STAGES, size))
    by_time[..., :twice] = lag * orbit.starts[:, None, twice : 2 * twice]
    by_time[..., :twice] += 2.0 * h * (TWICE @ orbit.rates[..., :twice])
    by_time[..., twice:] = ONCE @ orbit.rates
    by_frequency = -h / orbit.frequency * by_time
    forced = np.stack([missed, np.zeros_like(missed), by_speed], axis=-1)
    forced[..., 1] = (rows @ by_frequency[..., None])[..., 0]
    right = np.concatenate([by_start, forced], axis=-1)

    def spread(block: Array, weights: Array) -> Array:
        return block[:, :, :, None, :] * weights[:, None, :, None]

    matrix = spread(-h[..., None] * rows[..., twice:], ONCE)
    if twice:
        matrix += spread(-(h[..., None] ** 2) * rows[..., :twice], TWICE)
    matrix = matrix.reshape(count, STAGES * width, STAGES * width)
    matrix += np.eye(STAGES * width)
    factorised(count)
    found = np.linalg.solve(matrix, right.reshape(count, STAGES * width, size + 3))
    found = found.reshape(count, STAGES, width, size + 3)
    ends = np.zeros((count, size, size + 3))
    ends[..., :size] = np.eye(size)
    ends[:, :twice, twice : 2 * twice] += h * np.eye(twice)
    ends[..., size + 1] = by_frequency[:, -1]
    ends[:, twice:] += h * np.tensordot(ONCE[-1], found, (0, 1))
    ends[:, :twice] += h**2 * np.tensordot(TWICE[-1], found[:, :, :twice], (0, 1))
    return found, ends


# -------------------------------------------------------------------------------- all intervals


def _collapsed(ends: Array, right: Array, units: Array) -> tuple[Array, list[list[Array]]]:
    """[L | R | C] of L x(begin) + R x(end) = C over all intervals, in units of the state, (n, .).

    For each doubling of the intervals also triangles T, L, R and C of the states x between, in
    T x = C - L x(begin) - R x(end).
    """
    n, between = units.size, []
    through = ends[:, :, :n] * units / units[:, None]
    eye = np.zeros_like(through) + np.eye(n)
    relations = np.concatenate([-through, eye, right / units[:, None]], axis=2)
    while len(relations) > 1:
        even = 2 * (len(relations) // 2)
        a, b = relations[0:even:2], relations[1:even:2]
        factorised(even // 2)
        middle = np.concatenate([a[:, :, n : 2 * n], b[:, :, :n]], axis=1)
        q, triangles = np.linalg.qr(middle, mode="complete")
        of_a, of_b = (q[:, part].transpose(0, 2, 1) for part in (slice(n), slice(n, None)))
        first, last = of_a @ a[:, :, :n], of_b @ b[:, :, n : 2 * n]
        known = of_a @ a[:, :, 2 * n :] + of_b @ b[:, :, 2 * n :]
        turned = np.concatenate([first, last, known], axis=2)[:, n:]
        between.append([part[:, :n] for part in (triangles, first, last, known)])
        relations = np.concatenate([turned, relations[even:]])
    return relations[0], between


class Linearised:
    """The collocation equations about an orbit, with all but its first state eliminated.

    Args:
        phase: row and value of the condition row @ unknowns = value that fixes the phase.
    """

    def __init__(
        self, motion: VectorField, orbit: PeriodicOrbit, phase: tuple[Array, float]
    ) -> None:
        self.orbit, self._phase = orbit, phase
        n, mirror = motion.size, orbit.mirror
        self._units = _units(motion, orbit)
        self._rates, ends = _condensed(motion, orbit)
        right = ends[:, :, n:].copy()
        right[:, :, 0] += orbit.stages()[:, -1]
        right[:, :, 0] -= np.concatenate([orbit.starts[1:], mirror * orbit.starts[:1]])
        whole, self._between = _collapsed(ends, right, self._units)
        self._first, self._last, self._right = np.split(whole, [n, 2 * n], axis=1)
        across = motion(orbit.starts[:1].T, orbit.u)[:, 0] * self._units
        self._matrix = np.zeros((n + 2, n + 2))
        self._matrix[:n, :n] = self._first + mirror * self._last
        self._matrix[:n, n:] = -self._right[:, 1:]
        self._matrix[n, :n] = across / np.linalg.norm(across)

    def __call__(self, row: Array, gap: float, share: float) -> Array:
        """See `continuation.Solver`; shape and order are those of `packed`.

        The conditions on the phase and on row @ change hold on all unknowns, so three solutions
        that meet simpler ones on (y(0), omega, u) are combined.
        """
        phase, value = self._phase
        shift = share * (value - float(phase @ self.orbit.packed()))
        n = self._units.size
        matrix, right = self._matrix.copy(), np.zeros((n + 2, 3))
        matrix[n + 1] = np.append(row[:n] * self._units, row[-2:])
        length = float(np.linalg.norm(matrix[n + 1]))
        matrix[n + 1] /= length
        right[:n, 0] = self._right[:, 0] * share
        right[n, 1], right[n + 1, 2] = 1.0, 1.0 / length
        factorised()
        known = np.linalg.solve(matrix, right)
        ends = np.stack([known[:n], self.orbit.mirror * known[:n]])
        found = self._restored(ends, np.concatenate([[[share, 0.0, 0.0]], known[n:]]))
        rows = np.stack([phase, row]) @ found
        shares = np.linalg.solve(rows[:, 1:], np.array([shift, gap]) - rows[:, 0])
        return found[:, 0] + found[:, 1:] @ shares

    def neutral(self) -> Array:
        """The change at one speed that comes nearest to dy(span) = -mirror * dy(0).

        It meets this exactly where an orbit loses its symmetry or doubles its period.
        """
        opposite = self._first - self.orbit.mirror * self._last
        y = np.linalg.svd(opposite)[2][-1]
        ends = np.stack([y, -self.orbit.mirror * y])
        return self._restored(ends[..., None], np.zeros((3, 1)))[:, 0]

    def _restored(self, ends: Array, factors: Array) -> Array:
        """All unknowns, from states at both ends, (2, n, k), and factors of what acts, (3, k).

        What acts is the residual, a change of the frequency and one of the speed.
        """
        for triangles, first, last, right in reversed(self._between):
            pairs = len(triangles)
            known = right @ factors - (first @ ends[:pairs] + last @ ends[1 : pairs + 1])
            more = np.empty((len(ends) + pairs, *ends.shape[1:]))
            more[0 : 2 * pairs + 1 : 2] = ends[: pairs + 1]
            more[1 : 2 * pairs : 2] = np.linalg.solve(triangles, known)
            more[2 * pairs + 1 :] = ends[pairs + 1 :]
            ends = more
        starts = ends[:-1] * self._units[:, None]
        acting = np.broadcast_to(factors, (len(starts), *factors.shape))
        rates = self._rates @ np.concatenate([starts, acting], axis=1)[:, None]
        columns = factors.shape[1]
        return np.concatenate(
            [starts.reshape(-1, columns), rates.reshape(-1, columns), factors[1:]]
        )


def _units(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Units of the state in which positions and rates of its fastest mode are equally large."""
    stiffest = motion.jacobian(orbit.starts[0], orbit.u)[motion.half :, : motion.half]
    units = np.ones(motion.size)
    units[motion.half :] = math.sqrt(max(float(np.abs(stiffest).max()), 1.0))
    return units


def through(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Array, Array]:
    """L and R of L y(0) + R y(span) = 0 for small changes along an orbit, (2 moving,) * 2 each."""
    units = _units(motion, orbit)
    _, ends = _condensed(motion, orbit)
    whole, _ = _collapsed(ends, ends[:, :, :0], units)
    return whole[:, : motion.size] / units, whole[:, motion.size :] / units


# ----------------------------------------------------------------------------- Newton's method


@dataclass(frozen=True)
class OrbitControl(Control):
    """The same for orbits, which are costly: a tangent that turns by 37 degrees will do."""

    shortest: float = 1e-4
    turn: float = math.acos(0.8)
    patience: int | None = 3  # a good start takes 2 to 4 iterations
    longest_change: float = 0.5
    defect: float = math.inf  # the largest of an orbit


class OrbitProblem(Continuation):
    """The collocation equations on one mesh, for continuation from near an orbit.

    Lengths are measured in L of the free end, and relative in frequency and speed; `unit` is the
    root mean square of the positions p for each L of the free end's amplitude, on the orbit unless
    it is given.
    """

    def __init__(
        self,
        motion: VectorField,
        start: PeriodicOrbit,
        control: Control,
        unit: float | None = None,
    ) -> None:
        super().__init__(np.zeros(start.starts.size + start.rates.size + 2), control)
        self.motion, self.start = motion, start
        self.unit = _unit_of(motion, start) if unit is None else unit
        by_state = self.weights[: start.starts.size].reshape(start.starts.shape)
        by_state[:, : motion.half] = np.diff(start.edges)[:, None] / (start.span * self.unit**2)
        self.weights[-2:] = start.frequency**-2, start.u**-2
        # The least change: none of it along the motion, which is a mere shift of the phase.
        row = np.zeros_like(self.weights)
        rates = motion(np.ascontiguousarray(start.starts.T), start.u).T
        row[: rates.size] = self.weights[: rates.size] * rates.ravel()
        self._phase = row, float(row @ start.packed())

    def orbit(self, z: Array) -> PeriodicOrbit:
        """The orbit of unknowns."""
        return self.start.unpacked(z)

    def linearised(self, z: Array) -> Linearised:
        """The equations about unknowns."""
        return Linearised(self.motion, self.orbit(z), self._phase)

    def relative(self, z: Array, step: Array) -> float:
        """Size of a step relative to the orbit's own size, its frequency and its speed."""
        orbit = self.orbit(z)
        moved = step[: orbit.starts.size].reshape(orbit.starts.shape)[:, : orbit.half]
        sizes = float(np.abs(moved).max()), abs(float(step[-2])), abs(float(step[-1]))
        return max(sizes[0] / orbit.size, sizes[1] / orbit.frequency, sizes[2] / orbit.u)

    def check(self, z: Array) -> None:
        """Raises NewtonFailed for what is no orbit near the start: an equilibrium, or far away."""
        orbit = self.orbit(z)
        size, turn = orbit.size / self.start.size, orbit.frequency / self.start.frequency
        if size < 0.03:
            raise NewtonFailed("Newton's method takes the amplitude below 3 % of its start's")
        if size > 30.0 or not 0.1 < turn < 10.0 or orbit.u <= 0.0:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")


def _unit_of(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """The unit of `OrbitProblem` on an orbit."""
    states = orbit.states(PROBES)
    positions, across = states[: motion.half], motion.tip(states)
    centred = positions - positions.mean(axis=1, keepdims=True)
    size = math.sqrt(float(np.mean(np.sum(centred**2, axis=0))))
    return size / max(0.5 * float(np.ptp(across)), 0.01 * size)  # a free end may be held


def solved(motion: VectorField, orbit: PeriodicOrbit, tolerance: float) -> PeriodicOrbit:
    """The periodic orbit near another at its speed, on its mesh; NewtonFailed if none is found."""
    control = OrbitControl(math.inf, tolerance=tolerance, stagnation=1e3 * tolerance, patience=None)
    problem = OrbitProblem(motion, orbit, control, unit=1.0)
    return problem.orbit(problem.fixed(orbit.packed(), orbit.u))


def residual(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """Largest |dy/dt - f(y)| half-way between the stages, of the accelerations, relative."""
    share = np.concatenate([[0.0], NODES])
    share = 0.5 * (share[:-1] + share[1:])
    given = (integrals(share, 0) @ orbit.rates)[:, :, -motion.half :]
    phase = orbit.edges[:-1, None] + np.diff(orbit.edges)[:, None] * share
    true = motion(orbit.states(phase.ravel()), orbit.u)[motion.half :]
    return float(np.abs(given.reshape(true.T.shape) - true.T).max() / np.abs(true).max())
