# SPDX-License-Identifier: MIT
"""P(lambda) = lambda^2 M + lambda C + K of each model: products of its parts with vectors.

All vectors are in a model's elastic coordinates, where the elastic stiffness is the identity.
Chains and straight models in Legendre functions multiply segment by segment or panel by panel,
other models by dense matrices. A loss factor mu adds i mu dD/ddelta to K for Im lambda > 0; the
core adds it, and no product below contains it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partialmethod
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.power_iteration import largest_stretch

Vectors = NDArray[Any]

Traits: TypeAlias = tuple[int, float, float, bool, bool, bool, bool, float]
"""Properties of the pencil at every speed, in the order of `Traits` in linear/spectrum.hpp."""

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
        by_damping: product with dD/ddelta; D is linear in delta.
        is_long: whether a few roots are found faster than all, in O(dof).
        end_moves: whether the flow is certain to do work at an end of the pipe.
        lost_power: bound below which x^T D x is rounding, for x of order 1.
    """

    is_long = True
    end_moves = False
    lost_power = 1e-25  # square of displacements that are rounding

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pipe = model.pipe
        self.dof = model.dof
        self.is_damped = bool(self.pipe.damping or self.pipe.hysteresis or model.resisted)

    @property
    def turns_freely(self) -> bool:
        """Whether a joint, or the root of the pipe, has no spring."""
        return 0.0 in self.model.elastic_share

    def spectrum(self, traits: Traits, size: float) -> _core.Eigenproblem:
        """The core's solver for eigenvalues; size: the norm of K at rest."""
        raise NotImplementedError

    def _product(self, x: Array, part: str) -> Array:
        """Product of real x with the part of P of this name, one of the products above."""
        raise NotImplementedError

    def _times(self, x: Vectors, part: str) -> Vectors:
        return real_columns(lambda z: self._product(z, part), x)

    # Partial methods, since partial functions of self would be a cycle for the garbage collector.
    mass = partialmethod(_times, part="mass")
    velocity = partialmethod(_times, part="velocity")
    damping = partialmethod(_times, part="damping")
    stiffness = partialmethod(_times, part="stiffness")
    flux = partialmethod(_times, part="flux")
    gravity = partialmethod(_times, part="gravity")
    by_damping = partialmethod(_times, part="by_damping")

    def with_pipe(self, pipe: Pipe) -> Self:
        """The pencil of the same model with another pipe."""
        return type(self)(self.model.with_pipe(pipe))

    def planes(self) -> tuple[Pencil, ...]:
        """Pencils of motions in the plane in which the pipe rests bent, and across that plane.

        They are uncoupled, and only a model in three dimensions has both.
        """
        return (self,)

    def elastic(self, x: Vectors) -> Vectors:
        """Product with the elastic stiffness, the identity except at joints without spring."""
        result: Vectors = self.model.elastic_share[:, None] * x
        return result

    def term_stiffness(self) -> float:
        """Norm of K without its elastic part; for a pipe that is not uniform, or has terms.

        It is estimated from four products to 3 %, as measured: the lowest modes feel most of it.
        """
        start = np.cos(np.arange(1.0, self.dof + 1.0))[:, None]
        return largest_stretch(lambda x: self.stiffness(x) - self.elastic(x), start, 4)

    def by_springs(self, value: complex) -> Any:
        """Derivative of k_j + value c_j, with its loss, by each joint's spring k_j, shape (n,).

        Only a chain has it, whose forms have an entry for each spring.
        """
        raise NotImplementedError

    def forms(self, x: Vectors, y: Vectors) -> _core.Forms:
        """Forms y^H A x with these products A, for vectors of one root, shape (dof, 1)."""
        of = (self.mass, self.velocity, self.damping, self.flux, self.gravity, self.by_damping)
        return _core.Forms(*(complex(np.sum(y.conj() * product(x))) for product in of))


class DensePencil(Pencil):
    """A pencil by dense matrices; O(dof^3).

    Args:
        model: the model.
        plane: the elastic coordinates on which the pencil acts, all or those of one plane.
    """

    is_long = False

    def __init__(self, model: Model, plane: slice = slice(None)) -> None:
        super().__init__(model)
        self.plane = plane
        ops = model.elastic_operators()
        velocity = ops.direction * (ops.gyroscopic + ops.end_flux)
        self.matrices = {
            "mass": ops.mass[plane, plane],
            "velocity": velocity[plane, plane],
            "damping": ops.damping[plane, plane],
            "stiffness": ops.stiffness[plane, plane],
            "flux": ops.flux[plane, plane],
        }
        self.dof = len(self.matrices["mass"])

    def with_pipe(self, pipe: Pipe) -> DensePencil:
        return DensePencil(self.model.with_pipe(pipe), self.plane)

    def planes(self) -> tuple[Pencil, ...]:
        if self.model.dimensions == 2 or self.dof < self.model.dof:
            return (self,)
        half = self.dof // 2
        return tuple(DensePencil(self.model, of) for of in (slice(half), slice(half, None)))

    def term_stiffness(self) -> float:
        return float(np.linalg.norm(self.matrices["stiffness"] - np.eye(self.dof), 2))

    @cached_property
    def _slopes(self) -> dict[str, Array]:
        """dK/dgamma and dD/ddelta; K and D are linear in these."""
        heavier, more = self.model._stepped("gamma")
        plane = self.plane
        moved, step = heavier._stepped("damping")
        ops = moved.elastic_operators()  # K does not depend on delta, nor D on gamma
        return {
            "gravity": more * (ops.stiffness[plane, plane] - self.matrices["stiffness"]),
            "by_damping": step * (ops.damping[plane, plane] - self.matrices["damping"]),
        }

    def _product(self, x: Array, part: str) -> Array:
        matrices = self.matrices if part in self.matrices else self._slopes
        return np.asarray(matrices[part] @ x)

    def spectrum(self, traits: Traits, size: float) -> _core.Eigenproblem:
        mu = traits[-1]
        loss = mu * self._slopes["by_damping"] if mu else np.zeros((0, 0))
        matrices = *self.matrices.values(), loss
        rounding = self.model.matrix_rounding
        return _core.Eigenproblem(traits, matrices, self.pipe.alpha, size, rounding)


def real_columns(product: Product, x: Vectors) -> Vectors:
    """A product with real columns, applied to the real and imaginary parts of complex ones."""
    columns = np.ascontiguousarray(x, dtype=np.complex128 if x.dtype.kind == "c" else np.float64)
    result: Vectors = product(columns.view(np.float64)).view(columns.dtype)
    return result
