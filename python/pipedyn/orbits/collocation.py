# SPDX-License-Identifier: MIT
"""Periodic orbits as solutions of collocation equations: a Radau IIA method on a mesh.

The core eliminates the stages interval by interval and then all states but the first, as
motion/collocation.hpp says. The cost is linear in the number of intervals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.continuation.arclength import EVERY, Continuation, Control, Solver
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.periodic_orbit import (
    BETWEEN,
    METHOD,
    ORBIT_STAGES,
    PROBES,
    RATES_BETWEEN,
    PeriodicOrbit,
    interpolated,
    stage_phases,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed

NONE: Array = np.empty(0)

LOSS = 1e5
"""Largest entry of a product of intervals' maps: its rounding error is then 1e-11."""


def condensed(
    motion: VectorField, orbit: PeriodicOrbit, speed_varies: bool = False, of_states: bool = False
) -> _core.LinearisedOrbit:
    """The collocation equations linearised about an orbit, with all but its first state eliminated.

    Derivatives by the speed are 0 if it does not vary; with `of_states` only those by the state are
    computed.
    """
    motion = _along_stages(motion, orbit)
    by_frequency = None
    if motion.forced and not of_states:
        by_frequency = motion.by_frequency(orbit.stage_columns(), orbit.u)[motion.half :]
    count_factorisations(len(orbit.starts))
    speeds, drive = motion.driven_at(orbit.u, orbit.rates.shape[0] * orbit.rates.shape[1])
    return _core.LinearisedOrbit(
        *(motion.model.core, orbit.durations, orbit.starts, orbit.rates, METHOD, orbit.frequency),
        *(orbit.mirror_sign, speeds, drive),
        by_frequency=by_frequency,
        speed_varies=speed_varies,
        of_states=of_states,
        forced=orbit.forced,
        most=LOSS,
    )


class Linearised:
    """The collocation equations about an orbit, with all but its first state eliminated.

    Args:
        phase: row and value of the condition row @ unknowns = value that fixes the phase or, for a
            forced motion, the speed.
        speed_varies: whether the speed is an unknown.
        azimuth: row that is 0 on unknowns of orbits that are not turned about the axis of a pipe in
            three dimensions, if such turns change nothing; by default the orbit's change by a turn.
    """

    def __init__(
        self,
        motion: VectorField,
        orbit: PeriodicOrbit,
        phase: tuple[Array, float],
        speed_varies: bool = False,
        azimuth: Array | None = None,
    ) -> None:
        self._motion, self.orbit, self._phase = motion, orbit, phase
        self._equations = condensed(motion, orbit, speed_varies)
        self._turned, self._turn = turn_of(motion, orbit), NONE
        if self._turned.any():
            self._turn = self._unit(self._turned[: motion.size])
        self._azimuth = self._turned if azimuth is None else azimuth

    def __call__(self, row: Array, gap: float, share: float) -> Array:
        """The change of the unknowns, in the order of `packed`, as `arclength.Solver` describes."""
        step, turn, azimuth = self._change(row, gap, share), self._turned, self._azimuth
        if not self._turn.size:
            return step
        # A turn about the axis and a change along the branch are added, so that azimuth @ z = 0.
        ahead = self._change(row, 1.0, 0.0)
        missing = -float(azimuth @ (step + share * self.orbit.packed()))
        slopes = np.array([[row @ ahead, row @ turn], [azimuth @ ahead, azimuth @ turn]])
        along, about = np.linalg.solve(slopes, [0.0, missing])
        return np.asarray(step + along * ahead + about * turn)

    def _change(self, row: Array, gap: float, share: float) -> Array:
        """The change for which the first state is not turned about the axis."""
        phase, value = self._phase
        shift = share * (value - float(phase @ self.orbit.packed())) if share else 0.0
        count_factorisations()
        return self._equations.change(phase, shift, row, gap, share, self._turn)

    def _unit(self, change: Array) -> Array:
        """Change of a state, (n,), in units of the state and of unit length."""
        scaled = change / _units(len(change) // 2, self._equations.unit)
        return np.asarray(scaled / np.linalg.norm(scaled))

    @property
    def _shift(self) -> Array:
        """Change of the first state by a shift of the phase; empty if the motion is forced."""
        first = self.orbit.starts[0]
        if self._motion.forced:
            return NONE
        return self._unit(self._motion(first[:, None].copy(), self.orbit.u)[:, 0])

    @property
    def closing(self) -> tuple[Array, Array]:
        """L and R, (n, n) each, of L y(0) + R y(span) = 0 for the linearised equations.

        The frequency and the speed are fixed, and the matrices are in units of the state.
        """
        return self._equations.span.first, self._equations.span.last

    def neutral(self, root: float = -1.0, among: slice | NDArray[np.intp] = EVERY) -> Array:
        """The change at fixed speed that minimises the error of dy(span) = root * mirror * dy(0).

        With the root -1 the error is 0 where an orbit loses its symmetry or doubles its period. A
        turn about the axis and, of motions that are not forced, a shift of the phase are left out.
        among: entries of dy(0) that change.
        """
        factor = root * self.orbit.mirror_sign
        first, last = self.closing
        left, y = first + factor * last, np.zeros(len(first))
        for same in (self._turn, self._shift) if root == 1.0 else ():
            if same.size:
                left = left + np.outer(same, same)
        y[among] = np.linalg.svd(left[:, among])[2][-1]
        ends = np.concatenate([y, factor * y])[:, None]
        return self._equations.restored(ends, np.zeros((3, 1)))[:, 0]


def turn_of(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Change of an orbit's unknowns by a turn about the axis; empty where that makes no orbit."""
    if not motion.axisymmetric:
        return NONE
    turn, (p, v) = motion.model.quarter_turn, np.split(orbit.starts.T, 2)
    starts = np.concatenate([turn(p), turn(v)]).T
    rates = np.moveaxis(turn(np.moveaxis(orbit.rates, 2, 0)), 0, 2)
    return np.concatenate([starts.ravel(), rates.ravel(), [0.0, 0.0]])


def state_units(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Units of the state in which positions and rates of its fastest mode are equally large."""
    first = motion.along(orbit.edges[:1], orbit.frequency)
    half = motion.half
    slopes = first.jacobian(orbit.starts[0], orbit.u)[half:, :half]
    return _units(half, math.sqrt(max(float(np.abs(slopes).max()), 1.0)))


def _units(half: int, unit: float) -> Array:
    """Units of the state, (2 half,): those of positions are 1, those of rates are given."""
    return np.repeat([1.0, unit], half)


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
    equations = condensed(motion, orbit, of_states=True)
    return equations.maps, _units(motion.half, equations.unit)


# ----------------------------------------------------------------------------- Newton's method

ORBIT_GAP = 1e-6
"""Largest gap between the end of an orbit and its beginning, relative to its states, beyond which
it precesses: those that do not had gaps of 1e-8 at most."""


@saved_as("OrbitControl", added=("corner",))
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
        self._last = NONE, start  # unknowns of the last orbit that was asked for, and this orbit
        self._speed_varies = speed_varies and not motion.forced
        self.unit = _unit_of(motion, start) if unit is None else unit
        by_state = self.weights[: start.starts.size].reshape(start.starts.shape)
        lengths = start.edges[1:] - start.edges[:-1]
        by_state[:, : motion.half] = lengths[:, None] / (start.span * self.unit**2)
        self.weights[-2:] = start.frequency**-2, start.u**-2 if start.u > 0.0 else 1.0
        if start.forced:
            self.weights[-2:] = self.weights[:-3:-1]

    @cached_property
    def _phase(self) -> tuple[Array, float]:
        """Row and value of the condition that fixes the phase or, for a forced motion, the speed.

        The smallest change has no part along the motion, which is a mere shift of the phase.
        """
        z, start = self.start.packed(), self.start
        row = np.zeros_like(z)
        if start.forced:
            row[-2] = 1.0
            return row, start.u
        rates = self.motion(np.ascontiguousarray(start.starts.T), start.u).T
        row[: rates.size] = self.weights[: rates.size] * rates.ravel()
        return row, float(row @ z)

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
        return interpolated(self.motion, orbit.states, edges, orbit.frequency, orbit.u)

    def transferred(self, z: Array, edges: Array) -> Array:
        """The unknowns of z on another mesh."""
        others = z[self.start.starts.size + self.start.rates.size + 2 :]
        return np.concatenate([self.remeshed(z, edges).packed(), others])

    def orbit(self, z: Array) -> PeriodicOrbit:
        """The orbit with unknowns z."""
        if z is not self._last[0]:
            self._last = z, self.start.unpacked(z)
        return self._last[1]

    def linearised(self, z: Array) -> Solver:
        """The equations linearised about unknowns z."""
        return self.about_orbit(self.orbit(z))

    def about_orbit(self, orbit: PeriodicOrbit) -> Linearised:
        """The equations of an orbit, linearised about it."""
        given = self._phase, self._speed_varies, self._azimuth
        return Linearised(self.motion, orbit, *given)

    @cached_property
    def _azimuth(self) -> Array:
        """Row that is 0 on orbits not turned about the axis: the mean of z for x, and the reverse.

        So orbits keep symmetries that the start has, such as that to the plane z = 0.
        """
        row = turn_of(self.motion, self.start)
        return self.weights[: row.size] * row

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
    positions, (_, across, _) = states[: motion.half], motion.end_across(states)
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
    farthest: float = math.inf,
) -> PeriodicOrbit:
    """The periodic orbit near another at its speed, on its mesh; NewtonFailed if none is found.

    iterations: number of Newton steps after which the search fails.
    hopeless, farthest: as for `newton`.
    """
    control = OrbitControl(
        longest=math.inf,
        tolerance=tolerance,
        stagnation=1e3 * tolerance,
        iterations=iterations,
        patience=None,
    )
    problem = OrbitProblem(motion, orbit, control, unit=1.0, speed_varies=False)
    problem.hopeless, problem.farthest = hopeless, farthest
    z = orbit.packed()
    found = problem.orbit(problem.fixed(z, float(z[-1])))
    if motion.axisymmetric:  # Newton's method leaves out turns, so that the end may be turned
        end, begin = found.states(found.span * np.array([1.0 - 1e-9, 1.0])).T
        if np.abs(end - begin).max() > ORBIT_GAP * np.abs(begin).max():
            raise NewtonFailed("the motion precesses: it repeats only when turned about the axis")
    return found


def residual(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """Largest relative |dy/dt - f(y)| of the accelerations, half-way between the stages."""
    phase = orbit.edges[:-1, None] + np.diff(orbit.edges)[:, None] * BETWEEN
    motion = motion.along(phase.ravel(), orbit.frequency)
    true = motion(orbit.states(phase.ravel()), orbit.u)[motion.half :]
    true = true.reshape(motion.half, -1, ORBIT_STAGES)
    given = (RATES_BETWEEN @ orbit.rates).transpose(2, 0, 1)
    return float(np.abs(given - true).max() / np.abs(true).max())
