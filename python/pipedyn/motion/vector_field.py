# SPDX-License-Identifier: MIT
"""A model's motion as a vector field dy/dt = f(y, u), with derivatives by state and speed."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.models.base import BASE_ROWS, ROWS, Model
from pipedyn.models.drive import TRIED, AppliedForces, Force, Harmonic, Pulsation, phase_times
from pipedyn.models.reduced_supports import STENCIL
from pipedyn.motion.sampling import farthest_direction
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import count_right_hand_sides

MOST_KNOWN = 64
"""Number of sets of phases for which the numbers of a force are kept, those of a few meshes."""


class VectorField:
    """The rates f(y, u) = dy/dt of the integrated state y = [p, p'], shape (2 integrated,)."""

    forced = False
    """Whether f also depends on time, as it does in a `ForcedField`."""

    order = 1
    """Number of forcing periods in the period of an orbit."""

    _frequency = 1.0  # frequency of the forcing; without forcing it has no effect

    reach = 1.0
    """Unit of the displacement of the free end in the size of steps along a branch, in L."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.half = model.integrated
        self.size = 2 * model.integrated
        self.constrained = model.integrated != model.dof
        """Whether guides and pins constrain the coordinates p."""
        self.evaluations = 0

    def archived(self) -> dict[str, Any]:
        """Attributes of the field, by name, that a file stores."""
        return {"model": self.model}

    def _count(self, states: int) -> None:
        """Counts evaluations of f at a number of states."""
        self.evaluations += states
        count_right_hand_sides(states)

    def _driven(self, u: Any) -> tuple[Any, Array | None]:
        """Flow speed, or speeds (k,) of k states, and the forcing, shape (ROWS, k), or None."""
        return u, None

    def __call__(self, y: Array, u: float | Array) -> Array:
        """Rates of k states in the columns, shape (2 integrated, k), at one flow speed or at k.

        If the field is forced, the states are at the k phases that were given to `along`.
        """
        self._count(y.shape[1])
        return self.model.motion_rates(y, *self._driven(u))

    def along(self, phases: Array, frequency: float) -> VectorField:
        """The field for states at phases of an orbit: the field itself, as f has no time in it."""
        return self

    def of_order(self, order: int) -> VectorField:
        """The field for orbits of `order` forcing periods: the field itself, as it has none."""
        return self

    def jacobian(self, y: Array, u: float) -> Array:
        """df/dy at one state, shape (2 integrated, 2 integrated)."""
        return self.jacobians(y[:, None], u)[0]

    def jacobians(self, y: Array, u: float) -> Array:
        """df/dy at k states in the columns, shape (k, 2 integrated, 2 integrated)."""
        self._count(y.shape[1])
        return self.model.motion_jacobian(y, *self._driven(u))

    def linearised(self, y: Array, u: float) -> Array:
        """f, df/du and df/dy at k states in the columns of y, shape (2 integrated, k).

        The result has the shape (k, 2 + 2 integrated, 2 integrated). In df/du the relative
        amplitude of a pulsating flow is kept constant.
        """
        self._count(2 * y.shape[1])
        return self.model.motion_linearised(y, *self._driven(u))

    def driven_at(self, u: float, states: int) -> tuple[Array, Array | None]:
        """Flow speeds and drive of so many states at which the core linearises f itself.

        Speeds have the shape (1,) or (states,), and the drive (ROWS, states), or it is None.
        """
        self._count(2 * states)
        speeds, drive = self._driven(u)
        return np.array(speeds, dtype=np.float64, ndmin=1), drive

    def jacobian_by_speed(self, y: Array, u: float, moved: Array) -> Array:
        """Derivative by u of df/dy along states with dy/du = moved, at u > 0.

        The result has the shape (2 integrated, 2 integrated). If the state does not change with u,
        central differences of second order are exact up to rounding.
        """
        weights, h = np.array([0.5]), 0.5 * u
        if moved.any():
            weights, h = STENCIL, min(u / 6.0, 0.01 / float(np.abs(moved).max()))
        total = np.zeros((self.size, self.size))
        for k, weight in enumerate(weights, 1):
            ahead = self.jacobian(y + k * h * moved, u + k * h)
            total += weight / h * (ahead - self.jacobian(y - k * h * moved, u - k * h))
        return total

    def kinks(self, y: Array) -> Array:
        """Functions that change sign where derivatives of f jump, at k states: (functions, k)."""
        (p, rates), (_, drive) = np.split(y, 2), self._driven(0.0)
        return self.model.kinks(p, rates, drive)

    def by_frequency(self, y: Array, u: float) -> Array:
        """df/dw by the frequency w of an orbit, at the k states; 0 if the motion is not forced."""
        return np.zeros_like(y)

    @property
    def axisymmetric(self) -> bool:
        """Whether every motion turned about the axis of the straight pipe is a motion."""
        return self.model.axisymmetric

    @property
    def mirrored_in_z(self) -> bool:
        """Whether, in three dimensions, the image of every motion from z to -z is a motion."""
        return self.model.dimensions == 3

    def is_odd(self, u: float) -> bool:
        """Whether the mirror image of every motion is a motion, tested at three states.

        In three dimensions the image is turned by 180 degrees about the axis. The mirror image of a
        forced motion is shifted by half a period of the orbit.
        """
        if self.resting().any():
            return False
        y, phases = self.some_states(), np.array([0.3, 1.1, 2.5])
        frequency = self._frequency / self.order
        ahead = self.along(phases, frequency)(y, u)
        behind = self.along(phases + math.pi, frequency)(-y, u)
        return bool(np.abs(ahead + behind).max() <= 1e-9 * np.abs(ahead).max())

    def some_states(self) -> Array:
        """Three states in which the pipe turns by 0.3 rad at most, shape (2 integrated, 3)."""
        k = np.arange(1.0, self.size + 1.0)
        y = np.stack([np.sin(k), np.cos(2.0 * k), np.sin(3.0 * k + 1.0)], axis=1)
        # The angles of many functions may add up to larger angles than some models accept.
        return 0.3 / max(self.model.largest_angle(y[: self.half]), 1.0) * y

    def resting(self) -> Array:
        """The state at rest about which the model is linearised, shape (2 integrated,)."""
        return np.concatenate([self.model.resting(), np.zeros(self.half)])

    def end(self, y: Array) -> Array:
        """Position (x, y) and velocity of the free end at the k states in the columns, (4, k).

        Raises:
            NotResolved: for states that the model does not resolve.
        """
        return self.model.end_motion(y)

    def end_across(self, y: Array) -> tuple[Array, Array, Array]:
        """Direction across the pipe in which the free end moves farthest over k states, (k,) each.

        The direction, a unit vector, is followed by the positions and the velocities along it.
        """
        tips, velocities = np.split(self.end(y), 2)
        direction = farthest_direction(tips.T)
        return direction, direction @ tips, direction @ velocities


@saved_as("ForcedField")
class ForcedField(VectorField):
    """Rates f(y, u) of a forced motion, along an orbit whose period has `order` forcing periods.

    The forcing is a pulsating flow with mean u, an oscillating base or a force; or such a flow and
    base at the same frequency, in which case `forcing` is the flow and `base` is the motion of the
    base.
    """

    forced = True

    def __init__(
        self,
        model: Model,
        forcing: Pulsation | Harmonic | Force,
        order: int,
        base: Harmonic | None = None,
    ) -> None:
        self._forces: AppliedForces | None = None  # the force with an amplitude of 1
        self._known = dict[bytes, Array]()  # its numbers, by phases
        if isinstance(forcing, Force):
            one = replace(forcing, amplitude=1.0)
            self._forces = AppliedForces([one], phase_times(one), model.dimensions)
            model = model.with_applied(self._forces.laws)
        super().__init__(model)
        self.forcing, self.order = forcing, order
        self.base = forcing if isinstance(forcing, Harmonic) else base
        if self.base is not None:
            self.base.require_dimensions(model.dimensions)
        self._root: ForcedField = self
        assert forcing.frequency is not None
        self._phases, self._frequency = np.zeros(1), forcing.frequency
        self._checked_at = forcing.frequency  # at which a force has its phases at the times given

    def archived(self) -> dict[str, Any]:
        """Attributes of the field, by name, that a file stores."""
        beside = {"base": self.base} if self.base not in (None, self.forcing) else {}
        return {**super().archived(), "forcing": self.forcing, "order": self.order, **beside}

    def along(self, phases: Array, frequency: float) -> ForcedField:
        """The field for k states at k phases of an orbit with the given frequency."""
        other = copy(self)
        other._phases, other._frequency = self.order * phases, self.order * frequency
        return other

    def of_order(self, order: int) -> ForcedField:
        """The field for orbits of `order` forcing periods."""
        return ForcedField(self.model, self.forcing, order, self.base)

    def _count(self, states: int) -> None:
        if self._root is self:
            super()._count(states)
        else:
            self._root._count(states)

    @property
    def axisymmetric(self) -> bool:
        """Whether every motion turned about the axis is a motion: none if the forcing is across."""
        return super().axisymmetric and not self._acts_along([0, 2])

    @property
    def mirrored_in_z(self) -> bool:
        """Whether the image of every motion is a motion: not if the forcing has a part along z."""
        return super().mirrored_in_z and not self._acts_along([2])

    def _acts_along(self, axes: list[int]) -> bool:
        """Whether the base moves, or the force acts, along some of the axes x, y and z."""
        if self._forces is None:
            return self.base is not None and bool(self.base.vector[axes].any())
        numbers = self.force_numbers(np.linspace(0.0, 2.0 * math.pi, TRIED))
        return bool(numbers.reshape(-1, 3, TRIED)[:, axes].any())

    def flow(self, u: float, frequency: float) -> float | Pulsation:
        """The flow along an orbit with the given frequency: a pulsation with mean u, or u."""
        if isinstance(self.forcing, Pulsation):
            return replace(self.forcing, frequency=self.order * frequency)
        return float(u)

    def _driven(self, u: Any) -> tuple[Any, Array | None]:
        flow, base, phases, w = self.forcing, self.base, self._phases, self._frequency
        drive, speeds = np.zeros((ROWS, phases.size)), np.full(phases.size, u)
        if isinstance(flow, Pulsation):
            drive[0] = -u * flow.amplitude * w * np.sin(phases)
            speeds = u * (1.0 + flow.amplitude * np.cos(phases))
        if base is not None:
            moves = np.outer(base.vector, np.exp(1j * phases))
            for order, rows in enumerate(BASE_ROWS):
                drive[rows] = ((1j * w) ** order * moves).real
        if isinstance(flow, Force):
            drive = np.concatenate([drive, flow.amplitude * self.force_numbers(phases)])
        return speeds, drive

    def force_numbers(self, phases: Array) -> Array:
        """Numbers of the force at k of its phases, for an amplitude of 1, shape (rows, k)."""
        assert self._forces is not None
        key = phases.tobytes()
        if key not in self._known:
            if len(self._known) > MOST_KNOWN:
                self._known.clear()
            times = np.mod(phases, 2.0 * math.pi) / self._checked_at
            self._known[key] = np.stack([self._forces(t) for t in times.tolist()], axis=1)
        return self._known[key]

    def by_frequency(self, y: Array, u: float) -> Array:
        """df/dw by the frequency w of the orbit; central differences are exact, f is quadratic."""
        ahead, behind, h = copy(self), copy(self), 0.5 * self._frequency
        ahead._frequency, behind._frequency = self._frequency + h, self._frequency - h
        return self.order * (ahead(y, u) - behind(y, u)) / (2.0 * h)


@dataclass(frozen=True)
class Excitation:
    """Excitation of motions from time 0 on: the flow and, for some motions, base or force.

    Attributes:
        u: flow speed, steady or pulsating.
        base: motion of the base, None at rest.
        force: a force with a frequency, or None; then the base is at rest.
    """

    u: float | Pulsation
    base: Harmonic | None = None
    force: Force | None = None

    @property
    def period(self) -> float:
        """Period of the excitation; 0 if it is steady."""
        driving = self.base or self.force or self.u
        if isinstance(driving, float):
            return 0.0
        assert driving.frequency is not None
        return 2.0 * math.pi / driving.frequency

    @property
    def forces(self) -> tuple[Force, ...]:
        """The force, or none."""
        return (self.force,) if self.force else ()

    @property
    def mean(self) -> float:
        """The flow speed, or the mean of a pulsating flow."""
        return self.u.mean if isinstance(self.u, Pulsation) else self.u

    def in_plane(self) -> tuple[Excitation, float]:
        """The excitation turned about the axis into the plane z = 0, as far as it lies in a plane.

        The second result is the angle of its own plane, from x towards z.
        """
        if self.base:
            base, angle = self.base.in_plane()
            return replace(self, base=base), angle
        if self.force:
            force, angle = self.force.in_plane()
            return replace(self, force=force), angle
        return self, 0.0

    def field(self, model: Model, order: int = 1) -> VectorField:
        """The vector field of a model; if forced, for orbits of `order` periods of the forcing."""
        if isinstance(self.u, Pulsation):
            return ForcedField(model, self.u, order, self.base)
        forcing = self.base or self.force
        return ForcedField(model, forcing, order) if forcing else VectorField(model)

    def is_odd(self, model: Model) -> bool:
        """Whether the mirror image of every motion is a motion, half a period later if `shifts`.

        In three dimensions it is the image from z to -z.
        """
        shifts, in_space = self.shifts(model), model.dimensions == 3
        moves = np.zeros(3) if self.base is None else self.base.vector
        otherwise = np.delete(moves, 2 if in_space else 0).any()
        if shifts and (otherwise or isinstance(self.u, Pulsation)):
            return False  # half a period later flow or base differ
        if in_space:
            return shifts or self.field(model).mirrored_in_z
        return (shifts or self.force is None) and VectorField(model).is_odd(self.mean)

    def shifts(self, model: Model) -> bool:
        """Whether the mirrored motion is half a period later, as for a base that moves across."""
        if self.base is not None:
            return bool(self.base.vector[2 if model.dimensions == 3 else 0])
        return model.dimensions == 2 and self.force is not None and self.force.function is None

    def whole(self, time: float) -> float:
        """The time, rounded up to whole periods of the excitation."""
        return math.ceil(time / self.period - 1e-9) * self.period if self.period else time

    def phases(self, t: ArrayLike) -> Array:
        """Cosine and sine of the phases at k times, shape (k, 2); (k, 0) if all is steady."""
        phase = 2.0 * math.pi * np.asarray(t, dtype=np.float64) / (self.period or 1.0)
        if not self.period:
            return np.empty((phase.size, 0))
        return np.stack([np.cos(phase), np.sin(phase)], axis=1)
