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
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.eigenproblem import Complex, Eigenpairs, Eigenproblem
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.pencil import ChainPencil, Pencil, Vectors, lu_solver
from pipedyn.util.check import Array

MOVED = 4.321
"""c: any number serves that is not small and, negated, no root of the pipe."""


def sweeping_problem(model: Model, dense: bool | None = None) -> Eigenproblem:
    """The model's eigenproblem, deflated where a root stays at zero at every speed."""
    pencil = model.pencil(dense)
    if isinstance(model, Chain) and loose_joints(model).size:
        return Deflated(pencil, model)
    return Eigenproblem(pencil)


def loose_joints(chain: Chain) -> NDArray[np.intp]:
    """Free joints beyond which nothing, spring, gravity or term, resists a turn of the chain."""
    free = np.flatnonzero((chain.springs == 0.0) & (chain.pipe.gamma == 0.0))
    if chain.pipe.terms and free.size:
        held = np.flatnonzero(chain.resistances[:, [0, 1, 2, 6]].any(axis=1))
        free = free[free > held.max(initial=-1)]
    return free


class Deflated(Eigenproblem):
    """The problem of a chain with a free joint, without gravity, its root at zero taken away."""

    spectrum = None  # the chain's own has that root

    def __init__(self, pencil: Pencil, chain: Chain) -> None:
        super().__init__(pencil)
        self.chain = chain
        self.squared = super().velocity_free(1.0)
        self.free = loose_joints(chain)
        # Where no thrust ever acts each free joint has a null vector of its own.
        self.turned = self.free if self.centrifugal == 0.0 else self.free[:1]
        damped = bool(chain.resistances[self.free[0] :, 3:6].any())
        # Without fluid mass nothing but inertia holds the free joint: zero is double.
        self.doubled = self.pipe.beta == 0.0 and not self.squared and not damped
        self.known: tuple[float, Array, Array, Array, Array] | None = None

    def deflating(self, u: float) -> tuple[Array, Array, Array, Array]:
        """X, V, and what is added at speed u: A_C V^T to C and A_K V^T to K; each (dof, r).

        Beyond the free joint nearest to the clamp the chain turns as one straight line by phi = 1;
        below it springs, and terms if there are any, balance the thrust. A spring added to the
        joint pulls with its stiffness, which is the load to solve for.
        """
        if self.known is None or self.known[0] != u:
            turned = self.turned
            loads = np.zeros((self.dof, turned.size))
            loads[turned, np.arange(turned.size)] = 1.0 / self.chain.elastic_scale[turned]
            x = self.braced.factor(0.0, u)(loads)
            dual = x @ np.linalg.inv(x.T @ x)
            inertia = MOVED * self.mass(x)
            if self.squared:
                self.known = u, x, dual, np.zeros_like(x), inertia
            else:
                self.known = u, x, dual, inertia, MOVED * super().damped(u, x)
        return self.known[1:]

    def damped(self, u: float, x: Vectors) -> Vectors:
        _, dual, added, _ = self.deflating(u)
        result: Vectors = super().damped(u, x) + added @ (dual.T @ x)
        return result

    def stiffened(self, u: float, x: Vectors) -> Vectors:
        _, dual, _, added = self.deflating(u)
        result: Vectors = super().stiffened(u, x) + added @ (dual.T @ x)
        return result

    def static(self) -> Eigenproblem:
        if not self.doubled:
            return self
        # P(lambda) X(a u^2 / (1 + delta lambda)) = lambda^2 M X: damping moves no crossing.
        undamped = self.model.with_pipe(replace(self.pipe, damping=0.0))
        return sweeping_problem(undamped, not self.is_long)

    def velocity_free(self, u: float) -> bool:
        """The same at every speed, lest the deflation change at rest."""
        return self.squared

    def genuine(self, values: Complex, free: bool) -> NDArray[np.bool_]:
        """All but those that were moved, and the second zero where it is double."""
        away = np.abs(values**2 + MOVED) if free else np.abs(values + MOVED)
        moved = np.argsort(away, kind="stable")[: self.turned.size * (2 if free else 1)]
        mine = np.ones(values.size, dtype=np.bool_)
        mine[moved[away[moved] < 1e-3]] = False
        if self.doubled:
            mine[np.argsort(np.abs(values), kind="stable")[: self.turned.size]] = False
        return mine

    def by_speed(self, u: float, values: Complex, x: Vectors) -> Complex:
        """By central differences, to 1e-9."""
        h = 1e-5 * (1.0 + u)
        change = values * (self.damped(u + h, x) - self.damped(u - h, x))
        result: Complex = change + self.stiffened(u + h, x) - self.stiffened(u - h, x)
        return result / (2.0 * h)

    def original(self, u: float, pairs: Eigenpairs) -> Eigenpairs | None:
        if (pairs.values == 0.0).any():
            return None  # zero is double there: no derivative by gravity or the free spring
        x, dual, _, _ = self.deflating(u)
        factor = pairs.values**2 if self.squared else pairs.values
        right = pairs.right * factor + MOVED * (x @ (dual.T @ pairs.right))
        return replace(pairs, right=right / np.linalg.norm(right, axis=0))

    def dense(self) -> Eigenproblem:
        return Deflated(self.chain.pencil(dense=True), self.chain)

    def matrices(self, u: float) -> tuple[Array, Array, Array]:
        _, dual, to_velocity, to_stiffness = self.deflating(u)
        mass, velocity, stiffness = super().matrices(u)
        return mass, velocity + to_velocity @ dual.T, stiffness + to_stiffness @ dual.T

    @cached_property
    def braced(self) -> ChainPencil:
        """The chain with its free joints braced by springs."""
        braces = np.zeros(self.dof)
        braces[self.free] = 1.0 / self.chain.elastic_scale[self.free] ** 2
        return ChainPencil(self.chain, self.chain.braced(braces))

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        """As for any; in O(n) the band of P would be singular at lambda = 0.

        Solved is that of the braced chain, and the difference, of low rank, is added by Woodbury's
        formula.
        """
        if not self.is_long:
            mass, velocity, stiffness = self.matrices(u)
            return lu_solver(value**2 * mass + value * velocity + stiffness)
        solve_braced = self.braced.factor(value, u)
        _, dual, to_velocity, to_stiffness = self.deflating(u)
        brace = np.zeros((self.dof, self.free.size))
        brace[self.free, np.arange(self.free.size)] = 1.0
        by_braces = -(1.0 + self.pipe.damping * value) * brace
        left = np.hstack([by_braces, value * to_velocity + to_stiffness])
        right = np.hstack([brace, dual])
        ways = {}
        for adjoint, (outer, inner) in ((False, (left, right)), (True, (right, left))):
            through = solve_braced(outer, adjoint)
            small = np.eye(outer.shape[1]) + inner.conj().T @ through
            if np.linalg.matrix_rank(small) < small.shape[0]:  # as a singular P is in `lu_solver`
                small = small + np.finfo(float).eps * np.eye(outer.shape[1])
            ways[adjoint] = through, np.linalg.inv(small), inner

        def solve(rows: Vectors, adjoint: bool = False) -> Vectors:
            through, small, inner = ways[adjoint]
            solution = solve_braced(rows, adjoint)
            result: Vectors = solution - through @ (small @ (inner.conj().T @ solution))
            return result

        return solve
