# SPDX-License-Identifier: MIT
"""Forces, energies and derivatives of a user's own modules, in redundant coordinates."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.models.base import COMPLEX_STEP
from pipedyn.modular.layout import Layout
from pipedyn.modular.parts import Custom, UserLaw
from pipedyn.util.check import Array

GRADIENT_STEP = 1e-3
"""Step of differences, of order 4, of a complex-step gradient; their error is some 1e-12."""

TRIAL_STEP, AGREEMENT = 1e-5, 1e-4
"""Step of the differences that check derivatives, and the largest relative difference accepted.

The differences have an error of some 1e-10; a wrong derivative seldom agrees to four digits.
"""

TRIAL_SIZES = (1e-3, -0.03, 0.03, -0.3, 0.3, -1.0, 1.0)
"""Displacements, in L and rad, at which functions are checked, on both sides of any wall."""


class CustomForce:
    """A module written by the user, as functions of the k coordinates that it touches.

    Args:
        module: description of the module.
    """

    def __init__(self, module: Custom) -> None:
        self.module = module
        self.index = module.index

    def energy(self, q: Array) -> float:
        """Potential energy of the module at q, shape (k,)."""
        return 0.0 if self.module.energy is None else float(self._call("energy", (), q))

    def force(self, q: Array, qdot: Array) -> Array:
        """Generalized force of the module, shape (k,)."""
        if self.module.force is None:
            return -self._gradient(q)
        return self._call("force", q.shape, q, qdot)

    def work(self, q: Array, qdot: Array) -> float:
        """Power of the part of the force that does not come from the potential energy."""
        if self.module.force is None:
            return 0.0
        return float((self.force(q, qdot) + self._gradient(q)) @ qdot)

    def by_q(self, q: Array, qdot: Array) -> Array:
        """Derivative of the force by the coordinates, shape (k, k), a row for each force."""
        if self.module.force_by_q is not None:
            return np.array(self._call("force_by_q", (q.size, q.size), q, qdot))
        if self.module.force is None:
            return -_differences(self._gradient, q, GRADIENT_STEP * (1.0 + np.abs(q)))
        return self._complex_step("force", q.shape, lambda z: (z, qdot), q)

    def by_qdot(self, q: Array, qdot: Array) -> Array:
        """Derivative of the force by the rates, shape (k, k), a row for each force."""
        if self.module.force is None:
            return np.zeros((q.size, q.size))
        if self.module.force_by_qdot is not None:
            return np.array(self._call("force_by_qdot", (q.size, q.size), q, qdot))
        return self._complex_step("force", q.shape, lambda z: (q, z), qdot)

    def _gradient(self, q: Array) -> Array:
        """Gradient of the potential energy, shape (k,)."""
        if self.module.energy is None:
            return np.zeros(q.size)
        return self._complex_step("energy", (), lambda z: (z,), q)

    def _complex_step(
        self, name: str, shape: tuple[int, ...], arguments: UserLaw, at: Array
    ) -> Array:
        """Derivative, (*shape, k), of a function by one of its arguments, by complex step."""
        columns = []
        for i in range(at.size):
            moved = at.astype(np.complex128)
            moved[i] += 1j * COMPLEX_STEP
            columns.append(self._call(name, shape, *arguments(moved), kind="c").imag)
        return np.stack(columns, axis=-1) / COMPLEX_STEP

    def _call(
        self, name: str, shape: tuple[int, ...], *arguments: NDArray[Any], kind: str = "f"
    ) -> Any:
        whose = f"{name} of {self.module.name}"
        function: UserLaw = getattr(self.module, name)
        try:
            answer = np.asarray(function(*arguments))
        except (TypeError, ValueError, AttributeError, np.exceptions.ComplexWarning) as error:
            if kind == "f":
                raise
            raise ValueError(
                f"{whose} must accept complex arrays where its derivative is not given: {error}"
            ) from error
        if answer.shape != shape:
            raise ValueError(f"{whose} must return shape {shape}, got {answer.shape}")
        if answer.dtype.kind not in "iufc"[: 3 + (kind == "c")]:
            raise TypeError(f"{whose} must return real numbers, got {answer.dtype}")
        return answer.astype(np.complex128 if kind == "c" else np.float64)

    def validate(self, q: Array) -> None:
        """Calls every function near q and compares derivatives with differences.

        Raises ValueError or TypeError for a function that returns another shape or numbers that
        are not finite, or for derivatives that are not those of the function.
        """
        rates = 0.1 * np.sin(1.0 + self.index)
        with warnings.catch_warnings():
            # The warning says that a function lost the imaginary part.
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            for size in TRIAL_SIZES:
                self._validate_at(
                    q + size * np.cos(1.0 + self.index), rates, size == TRIAL_SIZES[0]
                )

    def _validate_at(self, q: Array, rates: Array, must_be_finite: bool) -> None:
        energy, force = self.energy(q), self.force(q, rates)
        if not (np.isfinite(force).all() and np.isfinite(energy)):
            if must_be_finite:
                raise ValueError(f"{self.module.name} must give finite forces and energies")
            return  # the module need not be defined at this displacement
        name, by = self.module.name, "must be the force's derivative"
        if self.module.energy is not None:
            rule = f"energy of {name} must have its gradient by complex step"
            self._compare(rule, self._gradient(q), self.energy, q, energy)
        largest = float(np.abs(force).max())
        rule = f"force_by_q of {name} {by}"
        self._compare(rule, self.by_q(q, rates), lambda z: self.force(z, rates), q, largest)
        rule = f"force_by_qdot of {name} {by}"
        self._compare(rule, self.by_qdot(q, rates), lambda z: self.force(q, z), rates, largest)

    def _compare(self, rule: str, given: Array, function: UserLaw, at: Array, size: float) -> None:
        """Raises ValueError unless a derivative agrees with differences of the function."""
        measured = _differences(function, at, np.full(at.size, TRIAL_STEP))
        if not np.isfinite(measured).all():
            return
        size = abs(size) + float(np.abs(measured).max(initial=0.0))
        if not np.abs(given - measured).max(initial=0.0) <= AGREEMENT * size + 1e-8:
            raise ValueError(
                f"{rule}, by differences "
                f"{np.array2string(measured, precision=4)}, got "
                f"{np.array2string(given, precision=4)} (functions that are not analytic, such as "
                "abs, have no complex step)"
            )


def _differences(function: UserLaw, at: Array, steps: Array) -> Array:
    """Derivative of a function by central differences of order 4, shape (..., k)."""
    columns = []
    for step in np.diag(steps):
        near = function(at + step) - function(at - step)
        far = function(at + 2.0 * step) - function(at - 2.0 * step)
        columns.append((8.0 * near - far) / (12.0 * step.sum()))
    return np.stack(columns, axis=-1)


class CustomForces:
    """All custom modules of a scene, which the compiled scene calls.

    Methods take redundant states [q, q'], a column for each, shape (6 n, k).

    Args:
        layout: the parts of the scene and their places.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout, self.each = layout, tuple(CustomForce(module) for module in layout.customs)

    def __bool__(self) -> bool:
        return bool(self.each)

    def moments(self, states: Array) -> Array:
        """Moments of the modules on the segments, shape (n, k)."""
        theta = np.cumsum(states[: len(states) // 2][2::3], axis=0)
        return self.layout.moments(theta, self._forces(states))

    def _forces(self, states: Array) -> Array:
        """Generalized forces, shape (3 n, k)."""
        positions, velocities = np.split(states, 2)
        total = np.zeros(positions.shape)
        with np.errstate(all="ignore"):
            for forces, q, qdot in zip(total.T, positions.T, velocities.T, strict=True):
                for custom in self.each:
                    forces[custom.index] += custom.force(q[custom.index], qdot[custom.index])
        return total

    def slopes(self, states: Array) -> Array:
        """Derivatives of `moments` by one state [theta, theta'], shape (n, 2 n)."""
        layout, n = self.layout, self.layout.size
        on_nodes = self._forces(states)  # first, so that what a user's function raises is seen
        q, rates = np.split(states[:, 0], 2)
        theta, omega = np.cumsum(q[2::3]), np.cumsum(rates[2::3])
        along = layout.lengths * np.exp(1j * theta)
        swinging, turning = map(layout.nodes_by_angles, (-omega * along, 1j * along))
        turning[2::3] = np.eye(n) - np.eye(n, k=-1)
        by_q, by_rates = np.hstack([turning, 0.0 * turning]), np.hstack([swinging, turning])
        forces = np.zeros((3 * n, 2 * n))
        for custom in self.each:
            at = custom.index
            forces[at] += custom.by_q(q[at], rates[at]) @ by_q[at]
            forces[at] += custom.by_qdot(q[at], rates[at]) @ by_rates[at]
        change = layout.moments(theta, forces)
        # Forces on nodes keep their direction, so that their moments change as the segments turn.
        on_nodes[2::3] = 0.0
        change[:, :n] += np.diag(layout.moments(theta + 0.5 * math.pi, on_nodes)[:, 0])
        return change

    def resist(self, q: Array, qdot: Array) -> bool:
        """Whether a force depends on rates at one state."""
        return any(one.by_qdot(q[one.index], qdot[one.index]).any() for one in self.each)

    def energy(self, states: Array) -> Array:
        """Potential energy of all modules, shape (k,); 0 on the straight pipe."""
        return self._sum(CustomForce.energy, states[: len(states) // 2]) - self._straight_energy

    @cached_property
    def _straight_energy(self) -> Array:
        """Potential energy that the user's functions give on the straight pipe, shape (1,)."""
        straight = np.zeros((3 * self.layout.size, 1))
        straight[1::3, 0] = np.cumsum(np.append(self.layout.base, self.layout.lengths))[1:]
        return self._sum(CustomForce.energy, straight)

    def work(self, states: Array) -> Array:
        """Power of the forces that do not come from a potential energy, shape (k,)."""
        return self._sum(CustomForce.work, *np.split(states, 2))

    def _sum(self, function: Callable[..., float], *rows: Array) -> Array:
        """Sum over the modules of a function of their coordinates or rates, (3 n, k): (k,)."""
        totals = np.zeros(rows[0].shape[1])
        with np.errstate(all="ignore"):
            for k, state in enumerate(zip(*(of.T for of in rows), strict=True)):
                for custom in self.each:
                    totals[k] += function(custom, *(row[custom.index] for row in state))
        return totals
