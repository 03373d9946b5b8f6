# SPDX-License-Identifier: MIT
"""Chains whose stiffness is singular at every speed: the root that stays at zero, taken away.

Needed for a free joint that nothing holds. Without it the double zero of a divergence scatters by
the square root of rounding, and crossings at rest and at the divergence are lost.

Without gravity det K(u) is the product of the springs. With a free joint (k_j = 0) lambda = 0 is an
eigenvalue at every speed, unless a term of the pipe resists what is beyond the joint. A real root
that passes it makes a double zero there, which scatters by the square root of rounding. The null
vectors X(u) of K are known, so with V^T X = I the pencil

    P(lambda) (I + c/lambda X V^T) = P(lambda) + c (lambda M X + C X) V^T

has the same eigenvalues, but -c in place of each that stays at zero, and -c is left out. Without a
term in the velocity the same is done for lambda^2, and c M X V^T is added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np

from pipedyn import _core
from pipedyn.linear.eigenproblem import Complex, Eigenproblem, eigenproblem
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.pencil import DensePencil, Vectors
from pipedyn.util.check import Array

MOVED = 4.321
"""c: any number serves that is not small and, negated, no root of the pipe."""


def sweeping_problem(model: Model, dense: bool | None = None) -> Eigenproblem:
    """The model's eigenproblem, deflated where a root stays at zero at every speed."""
    problem = eigenproblem(model, dense)
    if problem.model.loose_joints.size:
        return Deflated(cast(Chain, problem.model))
    return problem


class Deflated(Eigenproblem):
    """The problem of a chain with a free joint, without gravity, its root at zero taken away.

    In matrices, at any size.
    """

    def __init__(self, chain: Chain) -> None:
        self.pencil: DensePencil = DensePencil(chain)
        super().__init__(self.pencil)
        self.chain = chain
        self.squared = super().velocity_free(1.0)
        self.free = chain.loose_joints
        # Where no thrust ever acts each free joint has a null vector of its own.
        self.turned = self.free if self.centrifugal == 0.0 else self.free[:1]
        damped = self.pencil.operators.damping[self.free[0], self.free[0]] != 0.0
        # Without fluid mass nothing but inertia holds the free joint: zero is double.
        self.doubled = self.pipe.beta == 0.0 and not self.squared and not damped
        self.latest: tuple[float, Vectors, Vectors, Vectors, Vectors] | None = None

    def deflating(self, u: float) -> tuple[Vectors, Vectors, Vectors, Vectors]:
        """X, V, and what is added at speed u: A_C V^T to C and A_K V^T to K; each (dof, r).

        Beyond the free joint nearest to the clamp the chain turns as one straight line by phi = 1;
        below it springs, and terms if there are any, balance the thrust. A spring added to the
        joint pulls with its stiffness, which is the load to solve for.
        """
        latest = self.latest
        if latest is None or latest[0] != u:
            turned = self.turned
            loads = np.zeros((self.dof, turned.size))
            loads[turned, np.arange(turned.size)] = 1.0 / self.chain.elastic_scale[turned]
            mass, velocity, braced = self.pencil.matrices(u)
            braced[self.free, self.free] += 1.0
            x = np.linalg.solve(braced, loads)
            dual = x @ np.linalg.inv(x.T @ x)
            inertia = MOVED * mass @ x
            if self.squared:
                latest = u, x, dual, np.zeros_like(x), inertia
            else:
                latest = u, x, dual, inertia, MOVED * velocity @ x
            self.latest = latest
        return latest[1:]

    def velocity_free(self, u: float) -> bool:
        """The same at every speed, lest the deflation change at rest."""
        return self.squared

    def spectrum(self) -> _core.Eigenproblem:
        statics = None
        if self.doubled:
            # P(lambda) X(a u^2 / (1 + delta lambda)) = lambda^2 M X: damping moves no crossing.
            undamped = self.chain.with_pipe(replace(self.pipe, damping=0.0))
            statics = Deflated(undamped).spectrum()
        return _core.Eigenproblem(**self.known, amend=self.amended, statics=statics)

    def amended(
        self, u: float, values: Complex, right: Complex, left: Complex, squared: bool
    ) -> tuple[Vectors, Vectors, Vectors]:
        """All but the roots that were moved, and the second zero where it is double."""
        away = np.abs(values**2 + MOVED) if squared else np.abs(values + MOVED)
        moved = np.argsort(away, kind="stable")[: self.turned.size * (2 if squared else 1)]
        mine = np.ones(values.size, dtype=np.bool_)
        mine[moved[away[moved] < 1e-3]] = False
        if self.doubled:
            mine[np.argsort(np.abs(values), kind="stable")[: self.turned.size]] = False
        right, left = (x[:, mine] if x.size else x for x in (right, left))
        return values[mine], right, left

    def original(self, u: float, value: complex, x: Vectors) -> Vectors | None:
        if value == 0.0:
            return None  # zero is double there: no derivative by gravity or the free spring
        turned, dual, _, _ = self.deflating(u)
        right = x * (value**2 if self.squared else value) + MOVED * (turned @ (dual.T @ x))
        result: Vectors = right / np.linalg.norm(right, axis=0)
        return result

    @property
    def operators(self) -> Callable[[float], _core.DenseOperator]:
        def at(u: float) -> _core.DenseOperator:
            h = 1e-5 * (1.0 + u)  # central differences, to 1e-9
            after, before = self.matrices(u + h)[1:], self.matrices(u - h)[1:]
            rates = [(a - b) / (2.0 * h) for a, b in zip(after, before, strict=True)]
            return _core.DenseOperator((*self.matrices(u), *rates), self.size(u))

        return at

    def matrices(self, u: float) -> tuple[Array, Array, Array]:
        """(M, C, K) at speed u, each of shape (dof, dof)."""
        _, dual, to_velocity, to_stiffness = self.deflating(u)
        mass, velocity, stiffness = self.pencil.matrices(u)
        return mass, velocity + to_velocity @ dual.T, stiffness + to_stiffness @ dual.T
