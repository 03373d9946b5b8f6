# SPDX-License-Identifier: MIT
"""P at one flow speed of a long scene, as the core asks for it.

M and C act through running sums and P(value) is a band matrix: O(n) a step. The lowest eigenpairs
come by Arnoldi iteration on the inverse problem about a real shift sigma: with
lambda = sigma + 1/mu, C_s = C + 2 sigma M and K_s = P(sigma),

    mu [x; y] = [-K_s^-1 (C_s x + M y); x].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from pipedyn import _core
from pipedyn.models.base import DENSE_LIMIT
from pipedyn.models.pencil import Vectors
from pipedyn.util.check import Array

if TYPE_CHECKING:
    from pipedyn.linear.eigenproblem import Complex, Eigenproblem

DENSE_RESCUE, RESTARTS = 1000, 30
"""Where Arnoldi iteration does not end after so many restarts (eigenvalues that coincide, or a
cluster at -1 / delta), scenes up to this size are solved dense; after a few it ends where it does.
"""


class Clustered(Exception):
    """Eigenvalues too close together for a Krylov space."""


@dataclass(frozen=True)
class AtSpeed:
    """P of a problem at one speed."""

    problem: Eigenproblem
    u: float

    def operator(self) -> _core.CalledOperator:
        """What the core calls."""
        calls = self.multiply, self.by_speed, self.factor, self.inverse
        return _core.CalledOperator(*calls, self.problem.dof, self.problem.size(self.u))

    def multiply(self, x: Vectors) -> tuple[Vectors, Vectors, Vectors]:
        """M x, C x and K x, each of shape (dof, r)."""
        of = self.problem
        return of.mass(x), of.damped(self.u, x), of.stiffened(self.u, x)

    def by_speed(self, values: Complex, x: Vectors) -> Vectors:
        """(dP/du) x of each pair, shape (dof, r)."""
        return self.problem.by_speed(self.u, values, x)

    def factor(self, value: complex) -> Callable[..., Vectors]:
        """solve(rows, adjoint=False) with P(value), or its conjugate transpose."""
        return self.problem.factor(value, self.u)

    def inverse(
        self, shift: float, free: bool, left: bool, count: int
    ) -> tuple[Complex, Complex, Complex]:
        """Mu, x and, where they are known, y of at least `count` roots.

        All, by matrices, where these are most or a Krylov space cannot tell them apart.
        """
        dof = self.problem.dof
        if count <= dof // 2 + 6 or dof > DENSE_LIMIT:
            try:
                mu, x = self.arnoldi(shift, free, -(-count // 2) if free else count)
            except Clustered:
                pass
            else:
                if not free:  # conjugates agree only to rounding
                    real, upper = mu.imag == 0.0, mu.imag > 0.0
                    mu = np.concatenate([mu[real], mu[upper], mu[upper].conj()])
                    x = np.hstack([x[:, real], x[:, upper], x[:, upper].conj()])
                return mu, x, np.zeros((dof, 0), dtype=np.complex128)
        dense = self.problem.dense().operators(self.u)
        assert isinstance(dense, _core.DenseOperator)
        return dense.inverse(shift, free, left)

    def arnoldi(self, shift: float, free: bool, count: int) -> tuple[Complex, Complex]:
        """The `count` largest |mu| with x, O(dof) a step; none if that fails.

        Raises:
            Clustered: if the iteration does not end and the problem can be solved dense.
        """
        problem, n = self.problem, self.problem.dof
        solve = self.factor(shift)

        def step(v: Array) -> Array:
            x = v[:n].reshape(-1, 1)
            if free:
                return -solve(problem.mass(x))[:, 0]
            y = v[n:].reshape(-1, 1)
            rows = problem.mass(2.0 * shift * x + y) + problem.damped(self.u, x)
            return np.concatenate([-solve(rows)[:, 0], v[:n]])

        size = n if free else 2 * n
        start = np.concatenate([np.linspace(1.0, 0.0, n, endpoint=False), np.zeros(size - n)])
        operator = LinearOperator((size, size), matvec=step, dtype=np.float64)
        options = {"v0": start, "tol": 0.0, "ncv": min(size, max(2 * count + 1, 20))}
        if n <= DENSE_RESCUE:
            options["maxiter"] = RESTARTS
        try:
            mu, vectors = eigs(operator, k=count, which="LM", **options)
        except ArpackError as error:
            if n <= DENSE_RESCUE:
                raise Clustered from error
            if not getattr(error, "eigenvalues", np.zeros(0)).size:
                return np.zeros(0, np.complex128), np.zeros((n, 0), np.complex128)
            mu, vectors = error.eigenvalues, error.eigenvectors
        x = vectors[:n] / np.linalg.norm(vectors[:n], axis=0)
        return (mu, x) if np.isfinite(mu).all() else (mu[:0], x[:, :0])
