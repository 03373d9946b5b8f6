# SPDX-License-Identifier: MIT
"""P(lambda) = lambda^2 M + lambda C + K of each model: products of its parts with vectors.

All vectors are in a model's elastic coordinates, where the elastic stiffness is the identity.
Chains and straight models in Legendre functions multiply segment by segment or panel by panel,
other models by dense matrices. A loss factor mu adds i mu dD/ddelta to K for Im lambda > 0; the
core adds it, and no product below contains it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial, partialmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.power_iteration import largest_stretch

Vectors = NDArray[Any]

Product = Callable[[Vectors], Vectors]
"""A product: takes vectors of shape (dof, r) and returns the same shape."""


class Pencil:
    """P(lambda, u) = lambda^2 M + lambda (u V + D) + K + a u^2 A, in elastic coordinates.

    V = s (gyroscopic + end_flux) and A = flux.

    Attributes:
        mass: product with M.
        velocity: product with V.
        damping: product with D, which is delta times the elastic stiffness and all other damping.
        stiffness: product with K.
        flux: product with A.
        gravity: product with dK/dgamma; K is linear in gamma.
        is_long: whether a few roots are found faster than all, in O(dof).
        end_moves: whether the flow is certain to do work at an end of the pipe.
        lost_power: bound below which x^T D x is rounding, for x of order 1.
    """

    is_long = True
    end_moves = False
    lost_power = 1e-25  # square of displacements that are rounding
    mass: Product
    velocity: Product
    damping: Product
    stiffness: Product
    flux: Product
    gravity: Product

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pipe = model.pipe
        self.dof = model.dof
        self.is_damped = any((self.pipe.damping, self.pipe.hysteresis, model.resisted))

    def spectrum(self, traits: _core.Traits, size: float) -> _core.Eigenproblem:
        """The core's solver for eigenvalues; size: the norm of K at rest."""
        raise NotImplementedError

    def with_pipe(self, pipe: Pipe) -> Pencil:
        """The pencil of the same model with another pipe."""
        raise NotImplementedError

    def elastic(self, x: Vectors) -> Vectors:
        """Product with the elastic stiffness, the identity except at joints without spring."""
        result: Vectors = self.model.elastic_share[:, None] * x
        return result

    def term_stiffness(self) -> float:
        """Norm of K without its elastic part; 0 for a uniform pipe without terms.

        It is estimated from four products to 3 %, as measured: the lowest modes feel most of it.
        """
        if not self.model.is_varied:
            return 0.0
        start = np.cos(np.arange(1.0, self.dof + 1.0))[:, None]
        return largest_stretch(lambda x: self.stiffness(x) - self.elastic(x), start, 4)

    def by_damping(self, x: Vectors) -> Vectors:
        """Product with dD/ddelta; D is linear in delta."""
        return self.elastic(x)

    def by_springs(self, value: complex) -> Any:
        """Derivative of k_j + value c_j, with its loss, by each joint's spring k_j, shape (n,)."""
        return 1.0 + self._lost(value)

    def _lost(self, value: complex) -> complex:
        """Addition by damping to a unit elastic stiffness; without loss at lambda = value = 0."""
        return self.pipe.damping * value + (1j * self.pipe.hysteresis if value else 0.0)

    def forms(self, x: Vectors, y: Vectors) -> _core.Forms:
        """Forms y^H A x with these products A, for vectors of one root, shape (dof, 1)."""
        of = (self.mass, self.velocity, self.damping, self.flux, self.gravity, self.by_damping)
        return _core.Forms(*(complex(np.sum(y.conj() * product(x))) for product in of))


class DensePencil(Pencil):
    """A pencil by dense matrices; O(dof^3)."""

    is_long = False

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        ops = model.elastic_operators()
        velocity = ops.direction * (ops.gyroscopic + ops.end_flux)
        self.matrices = ops.mass, velocity, ops.damping, ops.stiffness, ops.flux
        self.mass, self.velocity, self.damping, self.stiffness, self.flux = (
            partial(np.matmul, matrix) for matrix in self.matrices
        )

    def term_stiffness(self) -> float:
        exact = np.linalg.norm(self.matrices[3] - np.eye(self.dof), 2)
        return float(exact) if self.model.is_varied else 0.0

    def with_pipe(self, pipe: Pipe) -> DensePencil:
        return DensePencil(self.model.with_pipe(pipe))

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """dK/dgamma and dD/ddelta; K and D are linear in these."""
        heavier, more = self.model._stepped("gamma")
        moved, step = heavier._stepped("damping")
        ops = moved.elastic_operators()  # K does not depend on delta, nor D on gamma
        _, _, damping, stiffness, _ = self.matrices
        return more * (ops.stiffness - stiffness), step * (ops.damping - damping)

    def gravity(self, x: Vectors) -> Vectors:
        return self._slopes[0] @ x

    def by_damping(self, x: Vectors) -> Vectors:
        return self._slopes[1] @ x

    def spectrum(self, traits: _core.Traits, size: float) -> _core.Eigenproblem:
        loss = np.zeros((0, 0))
        if traits.loss:
            loss = traits.loss * self.by_damping(np.eye(self.dof))
        rounding = self.model.matrix_rounding
        return _core.Eigenproblem(traits, (*self.matrices, loss), self.pipe.alpha, size, rounding)


class PartsPencil(Pencil):
    """A pencil whose core object multiplies with each part of P."""

    def _product(self, x: Array, **part: float) -> Array:
        """Product of real x with the sum of the core's parts, each times the factor of its name."""
        raise NotImplementedError

    def _times(self, x: Vectors, **part: float) -> Vectors:
        return real_columns(lambda z: self._product(z, **part), x)

    # Partial methods, since partial functions of self would be a cycle for the garbage collector.
    mass = partialmethod(_times, mass=1.0)
    velocity = partialmethod(_times, velocity=1.0)
    damping = partialmethod(_times, damping=1.0)
    stiffness = partialmethod(_times, stiffness=1.0)
    flux = partialmethod(_times, flux=1.0)
    gravity = partialmethod(_times, gravity=1.0)
    by_damping = partialmethod(_times, by_damping=1.0)


def real_columns(product: Product, x: Vectors) -> Vectors:
    """A real product with complex columns, applied to their real and imaginary parts."""
    kind = np.complex128 if np.iscomplexobj(x) else np.float64
    columns = np.ascontiguousarray(x, dtype=kind)
    result: Vectors = product(columns.view(np.float64)).view(columns.dtype)
    return result
