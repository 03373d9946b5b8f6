# SPDX-License-Identifier: MIT
"""Forces, energies and derivatives of a user's own modules, in redundant coordinates."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.models.modular.parts import Custom, Function
from pipedyn.util.check import Array

COMPLEX_STEP = 1e-30
"""A complex step has no difference that cancels; its square must vanish beside any number."""

STRIDE = 1e-3
"""Step of the differences of a complex-step gradient: of order 4, they err by some 1e-12."""

TRIAL_STEP, AGREEMENT = 1e-5, 1e-4
"""Step of the differences that check derivatives, and how closely these must agree.

The differences err by some 1e-10; a wrong derivative seldom agrees to four digits.
"""

TRIAL_SIZES = (1e-3, -0.03, 0.03, -0.3, 0.3, -1.0, 1.0)
"""Displacements at which functions are checked, in L and rad: both sides of a wall show there."""


class CustomForce:
    """One module of the user's own in a scene.

    Args:
        module: its description.
    """

    def __init__(self, module: Custom) -> None:
        self.module = module
        self.index = module.index

    def energy(self, q: Array) -> float:
        """Potential energy at redundant coordinates, shape (3 n,)."""
        if self.module.energy is None:
            return 0.0
        return float(self._call("energy", (), q[self.index]))

    def force(self, q: Array, qdot: Array) -> Array:
        """Generalized force on the coordinates it touches, shape (k,)."""
        at = q[self.index]
        if self.module.force is not None:
            force: Array = self._call("force", at.shape, at, qdot[self.index])
            return force
        return -self._gradient(at)

    def work(self, q: Array, qdot: Array) -> float:
        """Rate at which the force does more than its energy loses."""
        if self.module.force is None:
            return 0.0
        work = float(self.force(q, qdot) @ qdot[self.index])
        if self.module.energy is not None:
            work += float(self._gradient(q[self.index]) @ qdot[self.index])
        return work

    def by_q(self, q: Array, qdot: Array) -> Array:
        """Derivative of the force by the coordinates, shape (k, k)."""
        at, rates = q[self.index], qdot[self.index]
        if self.module.force_by_q is not None:
            given: Array = self._call("force_by_q", (at.size, at.size), at, rates)
            return given
        if self.module.force is not None:
            return self._stepped("force", at.shape, lambda z: (z, rates), at)
        return -_fourth_order(self._gradient, at)

    def by_qdot(self, q: Array, qdot: Array) -> Array:
        """Derivative of the force by the rates, shape (k, k)."""
        at, rates = q[self.index], qdot[self.index]
        if self.module.force_by_qdot is not None:
            given: Array = self._call("force_by_qdot", (at.size, at.size), at, rates)
            return given
        if self.module.force is None:
            return np.zeros((at.size, at.size))
        return self._stepped("force", at.shape, lambda z: (at, z), rates)

    def _gradient(self, at: Array) -> Array:
        if self.module.energy is None:
            return np.zeros(at.size)
        return self._stepped("energy", (), lambda z: (z,), at)

    def _stepped(self, name: str, shape: tuple[int, ...], arguments: Function, at: Array) -> Array:
        """Derivative by complex step, shape (*shape, k)."""
        columns = []
        for i in range(at.size):
            moved = at.astype(np.complex128)
            moved[i] += 1j * COMPLEX_STEP
            columns.append(self._call(name, shape, *arguments(moved), kind="c").imag)
        derivative: Array = np.stack(columns, axis=-1) / COMPLEX_STEP
        return derivative

    def _call(
        self, name: str, shape: tuple[int, ...], *arguments: NDArray[Any], kind: str = "f"
    ) -> Any:
        whose = f"{name} of {self.module.name}"
        function: Function = getattr(self.module, name)
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
        """Calls every function and compares derivatives with differences.

        Args:
            q: redundant coordinates near which the scene will be, shape (3 n,).

        Raises:
            ValueError, TypeError: for what returns another shape, or no finite numbers, or
                derivatives that are not those of the function.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)  # an imaginary part lost
            for size in TRIAL_SIZES:
                self._validate_at(q, size)

    def _validate_at(self, q: Array, size: float) -> None:
        """The same at one displacement, all coordinates displaced differently."""
        at = q + size * np.cos(1.0 + np.arange(q.size))
        rates = 0.1 * np.sin(1.0 + np.arange(q.size))
        energy, force = self.energy(at), self.force(at, rates)
        if not (np.isfinite(force).all() and np.isfinite(energy)):
            if size == TRIAL_SIZES[0]:
                raise ValueError(f"{self.module.name} must give finite forces and energies")
            return  # a place that it is not made for
        if self.module.energy is not None:
            measured = self._differences(lambda p: np.array(self.energy(p)), at)
            rule = "energy of {} must have its gradient by complex step"
            self._compare(rule, self._gradient(at[self.index]), measured, energy)
        largest = float(np.abs(force).max(initial=0.0))
        for name, given, measured in (
            ("force_by_q", self.by_q, self._differences(lambda p: self.force(p, rates), at)),
            ("force_by_qdot", self.by_qdot, self._differences(partial(self.force, at), rates)),
        ):
            rule = name + " of {} must be the force's derivative"
            self._compare(rule, given(at, rates), measured, largest)

    def _differences(self, function: Function, at: Array) -> Array:
        columns = []
        for i in self.index:
            step = np.zeros(at.size)
            step[i] = TRIAL_STEP
            columns.append((function(at + step) - function(at - step)) / (2.0 * TRIAL_STEP))
        return np.stack(columns, axis=-1)

    def _compare(self, rule: str, given: Array, measured: Array, size: float) -> None:
        if not np.isfinite(measured).all():
            return
        size = abs(size) + float(np.abs(measured).max(initial=0.0))
        if not np.abs(given - measured).max(initial=0.0) <= AGREEMENT * size + 1e-8:
            raise ValueError(
                f"{rule.format(self.module.name)}, by differences "
                f"{np.array2string(measured, precision=4)}, got "
                f"{np.array2string(given, precision=4)} (functions that are not analytic, such as "
                "abs, have no complex step)"
            )


def _fourth_order(function: Function, at: Array) -> Array:
    columns = []
    for i in range(at.size):
        step = STRIDE * (1.0 + abs(at[i])) * np.eye(at.size)[i]
        near = function(at + step) - function(at - step)
        far = function(at + 2.0 * step) - function(at - 2.0 * step)
        columns.append((8.0 * near - far) / (12.0 * step[i]))
    return np.stack(columns, axis=-1)


class CustomForces:
    """All modules of the user's own in a scene, at one state or at k.

    Args:
        modules: their descriptions.
        straight: redundant coordinates of the straight pipe, where their energy counts as 0.
    """

    def __init__(self, modules: Sequence[Custom], straight: Array) -> None:
        self.each = tuple(CustomForce(module) for module in modules)
        self._straight = straight

    def __bool__(self) -> bool:
        return bool(self.each)

    def force(self, q: Array, qdot: Array) -> Array:
        """Generalized forces, shape (3 n,) or (3 n, k), at states of that shape."""
        total = np.zeros(q.shape)
        for column, place, rates in zip(*map(_columns, (total, q, qdot)), strict=True):
            for custom in self.each:
                column[custom.index] += custom.force(place, rates)
        return total

    def energy(self, q: Array) -> float | Array:
        """Potential energy, a number or shape (k,)."""
        sums = [sum(custom.energy(place) for custom in self.each) for place in _columns(q)]
        return _number_or_array(np.array(sums) - self._straight_energy, q)

    @cached_property
    def _straight_energy(self) -> float:
        return sum(custom.energy(self._straight) for custom in self.each)

    def work(self, q: Array, qdot: Array) -> float | Array:
        """Power of the forces beyond what their energy loses, a number or shape (k,)."""
        states = zip(_columns(q), _columns(qdot), strict=True)
        sums = [sum(custom.work(place, rates) for custom in self.each) for place, rates in states]
        return _number_or_array(np.array(sums), q)


def _columns(states: Array) -> Array:
    """Views of the columns of (3 n,) or (3 n, k), as rows."""
    return np.atleast_2d(states.T)


def _number_or_array(values: Array, states: Array) -> float | Array:
    return float(values[0]) if states.ndim == 1 else values
