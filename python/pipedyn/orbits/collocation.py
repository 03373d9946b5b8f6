# SPDX-License-Identifier: MIT
"""Periodic orbits as solutions of collocation equations: a Radau IIA method on a mesh.

The stages are eliminated interval by interval, which leaves y(k+1) = T(k) y(k) + g(k). Products of
the T carry a state through runs of intervals over which no digits are lost; between runs orthogonal
transformations eliminate the states in pairs down to L y(0) + R y(end) = c (Wright 1992), so that
large multipliers cost no digits either. The cost is linear in the number of intervals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from pipedyn import _core
from pipedyn.continuation.arclength import Continuation, Control, Solver
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.periodic_orbit import (
    BETWEEN,
    ONCE,
    ORBIT_STAGES,
    PROBES,
    RATES_BETWEEN,
    STAGE_NODES,
    TWICE,
    PeriodicOrbit,
    interpolated,
    stage_phases,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed

LOSS = 1e5
"""Largest entry of a product of intervals' maps: its rounding error is then 1e-11."""

WEIGHTS = STAGE_NODES, ONCE, TWICE
"""Nodes and weights of the method, in the form that the core takes."""

# -------------------------------------------------------------------------------- one interval


def _condense(
    motion: VectorField, orbit: PeriodicOrbit, speed_varies: bool
) -> tuple[Array, Array, Array]:
    """Derivatives of each interval's stages and of the state at its end, and units of the state.

    Derivatives are taken by the state at the interval's beginning, a share of the residual, the
    frequency and the speed. Those of the stages' rates have shape (M, s integrated, 2 integrated +
    3), those of the state at the end (M, 2 integrated, 2 integrated + 3). The latter are in the
    units of the state, (2 integrated,); the residual contains the difference between this state and
    the one at the beginning of the next interval. Derivatives by the speed are 0 if it does not
    vary.
    """
    half, u = motion.half, orbit.u
    motion = _along_stages(motion, orbit)
    y = orbit.stage_columns()
    by_frequency = motion.by_frequency(y, u)[half:] if motion.forced else None
    linearised = motion.linearised(y, u)
    units = _units(linearised[0, 2:])
    count_factorisations(len(orbit.starts))
    given = orbit.durations, orbit.starts, orbit.rates, linearised, by_frequency, speed_varies
    by_rates, ends = _core.condense(*given, orbit.frequency, WEIGHTS, orbit.mirror_sign, units)
    return by_rates, ends, units


# -------------------------------------------------------------------------------- all intervals


def map_products(maps: Array) -> tuple[Array, list[int]]:
    """Products of the maps of intervals, in runs over which no digits are lost.

    maps: [T | r], (M, n, n + k), of x -> T x + r over each interval. Returns the products [P | R],
    (M, n, n + k), from the beginning of the interval's run up to the interval's end, and the first
    interval of each run. A run ends where entries grow so large that digits would be lost.
    """
    return _core.map_products(maps, LOSS)


def _reduce_runs(whole: Array, begins: list[int]) -> tuple[Array, Array, Array, list[list[Array]]]:
    """L, R and C of L x(begin) + R x(end) = C over all intervals, from their `map_products` maps.

    For each level of the pairwise elimination of runs, also the triangles T, and L, R and C, of the
    eliminated states x, with T x = C - L x(begin) - R x(end).
    """
    n, between = whole.shape[1], list[list[Array]]()
    relations = whole[[*(k - 1 for k in begins[1:]), -1]]
    if len(relations) == 1:
        return -relations[0, :, :n], np.eye(n), relations[0, :, n:], between
    eye = np.zeros_like(relations[:, :, :n]) + np.eye(n)
    relations = np.concatenate([-relations[:, :, :n], eye, relations[:, :, n:]], axis=2)
    while len(relations) > 1:
        even = 2 * (len(relations) // 2)
        a, b = relations[0:even:2], relations[1:even:2]
        count_factorisations(even // 2)
        middle = np.concatenate([a[:, :, n : 2 * n], b[:, :, :n]], axis=1)
        q, triangles = np.linalg.qr(middle, mode="complete")
        of_a, of_b = (q[:, part].transpose(0, 2, 1) for part in (slice(n), slice(n, None)))
        first, last = of_a @ a[:, :, :n], of_b @ b[:, :, n : 2 * n]
        known = of_a @ a[:, :, 2 * n :] + of_b @ b[:, :, 2 * n :]
        turned = np.concatenate([first, last, known], axis=2)[:, n:]
        between.append([part[:, :n] for part in (triangles, first, last, known)])
        relations = np.concatenate([turned, relations[even:]])
    return relations[0, :, :n], relations[0, :, n : 2 * n], relations[0, :, 2 * n :], between


def span_maps(maps: Array) -> tuple[Array, Array]:
    """L and R, (n, n) each, of L x(0) + R x(span) = 0, from maps of intervals, (M, n, n).

    R is the identity if no digits are lost.
    """
    first, last, _, _ = _reduce_runs(*map_products(maps))
    return first, last


class Linearised:
    """The collocation equations about an orbit, with all but its first state eliminated.

    Args:
        phase: row and value of the condition row @ unknowns = value that fixes the phase or, for a
            forced motion, the speed.
        speed_varies: whether the speed is an unknown.
    """

    def __init__(
        self,
        motion: VectorField,
        orbit: PeriodicOrbit,
        phase: tuple[Array, float],
        speed_varies: bool = False,
    ) -> None:
        self.orbit, self._phase = orbit, phase
        n, mirror = motion.size, orbit.mirror_sign
        self._rates, ends, self._units = _condense(motion, orbit, speed_varies)
        if orbit.forced:  # the parameter is the last unknown
            for part in (self._rates, ends):
                part[..., [n + 1, n + 2]] = part[..., [n + 2, n + 1]]
        self._products, begins = map_products(ends)
        self._first, self._last, self._right, self._between = _reduce_runs(self._products, begins)
        self._runs = np.repeat(np.arange(len(begins)), np.diff([*begins, len(ends)]))
        self._matrix = np.zeros((n + 2, n + 2))
        self._matrix[:n, :n] = self._first + mirror * self._last
        self._matrix[:n, n:] = -self._right[:, 1:]
        if orbit.forced:
            self._matrix[n, n] = 1.0
        else:
            across = motion(orbit.starts[:1].T, orbit.u)[:, 0] * self._units
            self._matrix[n, :n] = across / math.sqrt(across @ across)

    def __call__(self, row: Array, gap: float, share: float) -> Array:
        """The change of the unknowns, in the order of `packed`, as `arclength.Solver` describes.

        The conditions on the phase and on row @ change involve all unknowns, so three solutions
        that meet simpler conditions on (y(0), omega, u) are combined.
        """
        phase, value = self._phase
        shift = share * (value - float(phase @ self.orbit.packed()))
        n = self._units.size
        matrix, right = self._matrix.copy(), np.zeros((n + 2, 3))
        last = matrix[n + 1]
        last[:n], last[n:] = row[:n] * self._units, row[-2:]
        length = math.sqrt(last @ last)
        last /= length
        right[:n, 0] = self._right[:, 0] * share
        right[n, 1], right[n + 1, 2] = 1.0, 1.0 / length
        count_factorisations()
        known = np.linalg.solve(matrix, right)
        acting = np.concatenate([[[share, 0.0, 0.0]], known[n:]])
        ends = np.stack([known[:n], self.orbit.mirror_sign * known[:n]])
        found = self._restored(ends, acting)
        conditions = np.stack([phase @ found, row @ found])
        shares = np.linalg.solve(conditions[:, 1:], [shift, gap] - conditions[:, 0])
        return np.asarray(found @ [1.0, *shares])

    @property
    def closing(self) -> tuple[Array, Array]:
        """L and R, (n, n) each, of L y(0) + R y(span) = 0 for the linearised equations.

        The frequency and the speed are fixed, and the matrices are in units of the state.
        """
        return self._first, self._last

    def neutral(self, root: float = -1.0) -> Array:
        """The change at fixed speed that minimises the error of dy(span) = root * mirror * dy(0).

        With the root -1 the error is 0 where an orbit loses its symmetry or doubles its period.
        """
        factor = root * self.orbit.mirror_sign
        y = np.linalg.svd(self._first + factor * self._last)[2][-1]
        ends = np.stack([y, factor * y])
        return self._restored(ends[..., None], np.zeros((3, 1)))[:, 0]

    def _restored(self, ends: Array, factors: Array) -> Array:
        """All unknowns, from states at both ends, (2, n, k), and factors of the loads, (3, k).

        The loads are the residual, a change of the frequency and a change of the speed.
        """
        for triangles, first, last, right in reversed(self._between):
            pairs = len(triangles)
            known = right @ factors - (first @ ends[:pairs] + last @ ends[1 : pairs + 1])
            more = np.empty((len(ends) + pairs, *ends.shape[1:]))
            more[0 : 2 * pairs + 1 : 2] = ends[: pairs + 1]
            more[1 : 2 * pairs : 2] = np.linalg.solve(triangles, known)
            more[2 * pairs + 1 :] = ends[pairs + 1 :]
            ends = more
        count, n, columns = len(self._products), self._units.size, factors.shape[1]
        acting = np.broadcast_to(factors, (count, *factors.shape))
        later = self._products @ np.concatenate([ends[self._runs], acting], axis=1)
        given = np.empty((count, n + 3, columns))
        given[0, :n], given[1:, :n], given[:, n:] = ends[0], later[:-1], factors
        given[:, :n] *= self._units[:, None]
        rates = self._rates @ given
        return np.concatenate(
            [given[:, :n].reshape(-1, columns), rates.reshape(-1, columns), factors[1:]]
        )


def state_units(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Units of the state in which positions and rates of its fastest mode are equally large."""
    first = motion.along(orbit.edges[:1], orbit.frequency)
    return _units(first.jacobian(orbit.starts[0], orbit.u))


def _units(jacobian: Array) -> Array:
    """Units of the state, (2 integrated,), from the derivatives of the rates at one state."""
    half = len(jacobian) // 2
    units = np.ones(2 * half)
    units[half:] = math.sqrt(max(float(np.abs(jacobian[half:, :half]).max()), 1.0))
    return units


def stage_derivatives(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Derivatives of the accelerations at the stages, shape (M, s, integrated, 2 integrated)."""
    motion = _along_stages(motion, orbit)
    rows = motion.jacobians(orbit.stage_columns(), orbit.u)[:, motion.half :]
    return rows.reshape(*orbit.rates.shape, motion.size)


def _along_stages(motion: VectorField, orbit: PeriodicOrbit) -> VectorField:
    """The vector field at the phases of the stages."""
    if not motion.forced:
        return motion
    return motion.along(stage_phases(orbit.edges).ravel(), orbit.frequency)


def collocation_maps(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Array, Array]:
    """Maps of a change of state over each interval, (M, n, n), in units of the state, (n,)."""
    _, ends, units = _condense(motion, orbit, False)
    return ends[:, :, : motion.size], units


def interval_derivatives(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Derivatives of the accelerations at the stages by the state where an interval begins.

    Their shape is (M, s, integrated, 2 integrated); they are taken along solutions of the
    collocation equations.
    """
    by_rates, _, _ = _condense(motion, orbit, False)
    return by_rates[..., : motion.size].reshape(*orbit.rates.shape, motion.size)


# ----------------------------------------------------------------------------- Newton's method


@saved_as("OrbitControl")
@dataclass(frozen=True)
class OrbitControl(Control):
    """Control of the steps along branches of orbits.

    Orbits are costly, so a tangent may turn by 37 degrees in a step.
    """

    shortest: float = 1e-4
    turn: float = math.acos(0.8)
    patience: int | None = 3  # a good start takes 2 to 4 iterations
    longest_change: float = 0.5
    defect: float = math.inf  # largest defect of an orbit that is allowed


@saved_as("OrbitProblem")
class OrbitProblem(Continuation):
    """The collocation equations on one mesh, for continuation from near an orbit.

    Arc lengths are measured by the amplitude of the free end in L, or in the `reach` of a vector
    field, and by relative changes of frequency and speed. `unit` is the root mean square of the
    positions p for each unit of the free end's amplitude, measured on the orbit unless given. If
    the speed does not vary, only `fixed` is solved.
    """

    def __init__(
        self,
        motion: VectorField,
        start: PeriodicOrbit,
        control: Control,
        unit: float | None = None,
        speed_varies: bool = True,
    ) -> None:
        super().__init__(np.zeros(start.starts.size + start.rates.size + 2), control)
        self.motion, self.start = motion, start
        self._speed_varies = speed_varies and not motion.forced
        self.unit = _unit_of(motion, start) if unit is None else unit
        by_state = self.weights[: start.starts.size].reshape(start.starts.shape)
        by_state[:, : motion.half] = np.diff(start.edges)[:, None] / (start.span * self.unit**2)
        self.weights[-2:] = start.frequency**-2, start.u**-2 if start.u > 0.0 else 1.0
        if start.forced:
            self.weights[-2:] = self.weights[:-3:-1]
            row = np.zeros_like(self.weights)
            row[-2] = 1.0
            self._phase = row, start.u
            return
        # The smallest change has no part along the motion, which is a mere shift of the phase.
        row = np.zeros_like(self.weights)
        rates = motion(np.ascontiguousarray(start.starts.T), start.u).T
        row[: rates.size] = self.weights[: rates.size] * rates.ravel()
        self._phase = row, float(row @ start.packed())

    def archived(self) -> dict[str, Any]:
        """The values that a file keeps, by name."""
        varies = {"speed_varies": self._speed_varies}
        parts = {"motion": self.motion, "start": self.start, "control": self.control}
        return {**parts, "unit": self.unit, **varies}

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Self:
        """The equations with the fields that a file kept."""
        motion, start, unit = fields["motion"], fields["start"], fields["unit"]
        if (start.half, start.forced) != (motion.half, motion.forced):
            raise ValueError("start must be an orbit of the motion")
        check.real("unit", unit, low=0.0, open_low=True)
        return cls(**fields)

    @property
    def origin(self) -> Array:
        """Vector of unknowns of the orbit `start`."""
        return self.start.packed()

    def about(self, z: Array, edges: Array | None = None) -> Self:
        """The equations that start from unknowns z, on another mesh if its edges are given."""
        return type(self)(self.motion, self.remeshed(z, edges), self.control, self.unit)

    def remeshed(self, z: Array, edges: Array | None) -> PeriodicOrbit:
        """The orbit with unknowns z, on another mesh if its edges are given."""
        orbit = self.orbit(z)
        if edges is None:
            return orbit
        if self.motion.model.pipe.has_kinks:  # polynomials do not follow them
            return interpolated(self.motion, orbit.states, edges, orbit.frequency, orbit.u)
        return orbit.on_mesh(edges)

    def orbit(self, z: Array) -> PeriodicOrbit:
        """The orbit with unknowns z."""
        return self.start.unpacked(z)

    def linearised(self, z: Array) -> Solver:
        """The equations linearised about unknowns z."""
        return self.about_orbit(self.orbit(z))

    def about_orbit(self, orbit: PeriodicOrbit) -> Linearised:
        """The equations of an orbit, linearised about it."""
        return Linearised(self.motion, orbit, self._phase, self._speed_varies)

    def relative(self, z: Array, step: Array) -> float:
        """Size of a step relative to the orbit's own size, its frequency and its speed."""
        orbit = self.orbit(z)
        moved = step[: orbit.starts.size].reshape(orbit.starts.shape)[:, : orbit.half]
        size = float(np.abs(moved).max()) / orbit.size
        last = (orbit.u, orbit.frequency) if orbit.forced else (orbit.frequency, orbit.u)
        pairs = zip(step[-2:].tolist(), last, strict=True)
        return max(size, *(abs(change) / (abs(value) or 1.0) for change, value in pairs))

    def check(self, z: Array) -> None:
        """Raises NewtonFailed if z is an equilibrium or far from the start."""
        orbit = self.orbit(z)
        size, turn = orbit.size / self.start.size, orbit.frequency / self.start.frequency
        if size < 0.03:
            raise NewtonFailed("Newton's method takes the amplitude below 3 % of its start's")
        if size > 30.0 or not 0.1 < turn < 10.0 or orbit.u < 0.0:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")


def _unit_of(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """The `unit` of an `OrbitProblem` on an orbit."""
    states = orbit.states(PROBES)
    positions, across = states[: motion.half], motion.tip(states)
    centred = positions - positions.mean(axis=1, keepdims=True)
    size = math.sqrt(float(np.mean(np.sum(centred**2, axis=0))))
    # The free end may be held, so its motion may be 0.
    return motion.reach * size / max(0.5 * float(np.ptp(across)), 0.01 * size)


def solved(
    motion: VectorField,
    orbit: PeriodicOrbit,
    tolerance: float,
    iterations: int = OrbitControl.iterations,
    hopeless: float = math.inf,
) -> PeriodicOrbit:
    """The periodic orbit near another at its speed, on its mesh; NewtonFailed if none is found.

    iterations: number of Newton steps after which the search fails.
    hopeless: as for `newton`.
    """
    control = OrbitControl(
        longest=math.inf,
        tolerance=tolerance,
        stagnation=1e3 * tolerance,
        iterations=iterations,
        patience=None,
    )
    problem = OrbitProblem(motion, orbit, control, unit=1.0, speed_varies=False)
    problem.hopeless = hopeless
    z = orbit.packed()
    return problem.orbit(problem.fixed(z, float(z[-1])))


def residual(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """Largest relative |dy/dt - f(y)| of the accelerations, half-way between the stages."""
    phase = orbit.edges[:-1, None] + np.diff(orbit.edges)[:, None] * BETWEEN
    motion = motion.along(phase.ravel(), orbit.frequency)
    true = motion(orbit.states(phase.ravel()), orbit.u)[motion.half :]
    true = true.reshape(motion.half, -1, ORBIT_STAGES)
    given = (RATES_BETWEEN @ orbit.rates).transpose(2, 0, 1)
    return float(np.abs(given - true).max() / np.abs(true).max())
