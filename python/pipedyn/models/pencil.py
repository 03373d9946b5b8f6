# SPDX-License-Identifier: MIT
"""P(lambda) = lambda^2 M + lambda C + K of each model: what multiplies and solves with it.

All is in a model's elastic coordinates, where the elastic stiffness is the identity. Small models
are dense matrices; long chains and scenes multiply and solve in O(n).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from pipedyn.models.pipe import Pipe
from pipedyn.util.band import band_solver
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

if TYPE_CHECKING:
    from pipedyn.models.base import Model
    from pipedyn.models.chain import Chain

Vectors = NDArray[Any]

Product = Callable[[Vectors], Vectors]
"""Takes and gives (dof, r)."""

LONGEST_DENSE = 64
"""Chains and scenes up to this size are dense: measured, both ways take equal time near there."""


class Pencil:
    """P(lambda, u) = lambda^2 M + lambda (u V + D) + K + a u^2 A, in elastic coordinates.

    V = s (gyroscopic + end_flux) and A = flux.

    Attributes:
        mass: product with M.
        velocity: with V.
        damping: with D: delta times the elastic stiffness, and what else damps.
        stiffness: with K.
        flux: with A.
        factor: solve(rows, adjoint=False) with P(value, u), or its conjugate transpose, from the
            value and u.
        is_long: whether products and solves are O(dof), and no matrices are there.
    """

    is_long = True
    mass: Product
    velocity: Product
    damping: Product
    stiffness: Product
    flux: Product
    factor: Callable[[complex, float], Callable[..., Vectors]]

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pipe = model.pipe
        self.dof = model.dof
        self.is_damped = model.pipe.damping != 0.0 or model.resisted
        self.direction = self.pipe.direction
        self.centrifugal = self.pipe.centrifugal

    def gravity(self, x: Vectors) -> Vectors:
        """dK/dgamma x; K is linear in gamma."""
        return self._derivative("gamma", "stiffness", x)

    def by_damping(self, x: Vectors) -> Vectors:
        """dD/ddelta x; D is linear in delta."""
        return self._derivative("damping", "damping", x)

    def _derivative(self, number: str, product: str, x: Vectors) -> Vectors:
        """Of a product linear in a number of the pipe: by a step that keeps it in its range."""
        value = getattr(self.pipe, number)
        step = 1.0 if value < 1.0 else -1.0
        pipe: Pipe = replace(self.pipe, **{number: value + step})
        other = type(self)(self.model.with_pipe(pipe))
        result: Vectors = step * (getattr(other, product)(x) - getattr(self, product)(x))
        return result


class DensePencil(Pencil):
    """Matrices; O(dof^3)."""

    is_long = False

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        self.operators = ops = model.elastic_operators()
        self.V: Array = self.direction * (ops.gyroscopic + ops.end_flux)
        self.mass, self.velocity = partial(np.matmul, ops.mass), partial(np.matmul, self.V)
        self.damping, self.flux = partial(np.matmul, ops.damping), partial(np.matmul, ops.flux)
        self.stiffness = partial(np.matmul, ops.stiffness)

    def matrices(self, u: float) -> tuple[Array, Array, Array]:
        """(M, C, K) at speed u, each of shape (dof, dof)."""
        ops = self.operators
        stiffness = ops.stiffness + self.centrifugal * u**2 * ops.flux
        return ops.mass, u * self.V + ops.damping, stiffness

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        mass, velocity, stiffness = self.matrices(u)
        return lu_solver(value**2 * mass + value * velocity + stiffness)


def lu_solver(matrix: Vectors) -> Callable[..., Vectors]:
    """solve(rows, adjoint=False); of a singular matrix, with one that differs in rounding."""
    lu, pivots, _ = lapack.zgetrf(matrix.astype(np.complex128))
    factorised()
    exact = np.flatnonzero(np.diag(lu) == 0.0)
    lu[exact, exact] = np.finfo(float).eps

    def solve(rows: Vectors, adjoint: bool = False) -> Vectors:
        solution: Vectors = lapack.zgetrs(lu, pivots, rows, trans=2 if adjoint else 0)[0]
        return solution

    return solve


class ChainPencil(Pencil):
    """A long chain: running sums take joint angles to segments, P is a band matrix.

    Args:
        model: the chain.
        core: the chain that multiplies and solves, with springs of its own; the model's if None.
    """

    def __init__(self, model: Chain, core: Any = None) -> None:
        super().__init__(model)
        self.core = model.core if core is None else core
        self.resisted = model.resisted
        self.scale = model.elastic_scale[:, None]
        self.share = model.elastic_share[:, None]
        self.mass = partial(self._rows, self.core.mass_times)
        self.flux = partial(self._rows, self.core.flux_times)

    def _rows(self, product: Callable[[Array], Array], x: Vectors) -> Vectors:
        """A product in the angles, taken to elastic coordinates; complex columns as real pairs."""
        angles = np.ascontiguousarray(np.cumsum(self.scale * x, axis=0))
        if np.iscomplexobj(angles):
            rows: Vectors = product(angles.view(np.float64)).view(np.complex128)
        else:
            rows = product(angles)
        result: Vectors = self.scale * np.cumsum(rows[::-1], axis=0)[::-1]
        return result

    def velocity(self, x: Vectors) -> Vectors:
        return self.direction * self._rows(self.core.velocity_times, x)

    def damping(self, x: Vectors) -> Vectors:
        result: Vectors = self.pipe.damping * self.by_damping(x)
        return result + self._rows(self.core.terms_damping_times, x) if self.resisted else result

    def by_damping(self, x: Vectors) -> Vectors:
        result: Vectors = self.share * x  # the springs'
        return result

    def stiffness(self, x: Vectors) -> Vectors:
        result = self.by_damping(x)
        if self.pipe.terms:
            result = result + self._rows(self.core.terms_stiffness_times, x)
        return result + self.pipe.gamma * self.gravity(x) if self.pipe.gamma else result

    def gravity(self, x: Vectors) -> Vectors:
        return self._rows(self.core.gravity_times, x)

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        width, band = self.core.band_width, self.core.band(complex(value), u)
        solve_band = band_solver(band.real if np.imag(value) == 0.0 else band, width, width)

        def solve(rows: Vectors, adjoint: bool = False) -> Vectors:
            loads = rows / self.scale
            extended = np.zeros((4 * self.dof, rows.shape[1]), dtype=loads.dtype, order="F")
            if adjoint:
                extended[0::4] = loads
                angles = solve_band(extended, True)
                dual: Vectors = np.diff(angles[2::4], axis=0, prepend=0.0) / self.scale
                return dual
            extended[2::4] = loads
            extended[2:-4:4] -= loads[1:]
            joint_angles: Vectors = solve_band(extended, False)[0::4] / self.scale
            return joint_angles

        return solve
