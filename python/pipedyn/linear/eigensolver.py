# SPDX-License-Identifier: MIT
"""Eigenvalues of P(lambda) = lambda^2 M + lambda C + K at any size, each with a checked residual.

All is done in a model's elastic coordinates, where the elastic stiffness is the identity, and on
the inverse problem about a real shift sigma: with lambda = sigma + 1/mu, C_s = C + 2 sigma M and
K_s = P(sigma),

    mu [x; y] = [-K_s^-1 (C_s x + M y); x],

so the lowest eigenvalues are the largest mu and survive rounding, and a singular K does no harm.
Small problems are solved dense, long ones by Arnoldi iteration, where M and C act through running
sums and K_s is a band matrix: O(n) a step. Of a chain that gives only starts: its roots are
corrected, and its vectors found, by recursion along it (cpp/pipedyn/linear/chain_spectrum.hpp),
which holds those of any segments to rounding.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from pipedyn import _core
from pipedyn.linear.eigenproblem import Complex, Eigenpairs, Eigenproblem, unit
from pipedyn.models.base import DENSE_LIMIT
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

SHIFTS = (0.97, 2.31, 0.41)
"""Positive, where stable pipes have no eigenvalue; tried in turn until every residual passes."""

DENSE_RESCUE, RESTARTS = 1000, 30
"""Where Arnoldi iteration does not end after so many restarts (eigenvalues that coincide, or a
cluster at -1 / delta), chains up to this size are solved dense; after a few it ends where it does.
"""


class Clustered(Exception):
    """Eigenvalues too close together for a Krylov space."""


def lowest(
    problem: Eigenproblem, u: float, count: int | None = None, left: bool = False, high: bool = True
) -> Eigenpairs:
    """The `count` eigenvalues of least magnitude (all without count), with their residuals.

    By recursion along a chain, where that finds all of them.

    Pairs that fail the check are refined once; those that fail still are in the result, and its
    `converged` says which. Without `high`, modes so high that rounding explains any residual are
    left as they are.
    """
    total = 2 * problem.dof
    count = total if count is None else min(count, total)
    if problem.is_long and count > problem.dof // 2:
        if problem.dof > DENSE_LIMIT:
            raise ValueError(
                f"count must be at most dof / 2 = {problem.dof // 2} for a long chain, got {count}"
            )
        problem = problem.dense()
    if problem.spectrum is not None:
        found = problem.spectrum.lowest(u, count, True)
        pairs = None if found is None else Eigenpairs.of_chain(*found)
        if pairs is not None and bool(pairs.converged.all()):
            return pairs
        if problem.dof > DENSE_LIMIT:
            return pairs or _nothing(problem.dof, count, left)
        inverse = _by_inverse(problem.dense(), u, count, left, high)
        recursion = -1 if pairs is None else np.count_nonzero(pairs.converged)
        if pairs is None or recursion < np.count_nonzero(inverse.converged):
            return inverse
        return pairs
    return _by_inverse(problem, u, count, left, high)


def _by_inverse(
    problem: Eigenproblem, u: float, count: int, left: bool, high: bool
) -> Eigenpairs:
    best: Eigenpairs | None = None
    for shift in SHIFTS:
        try:
            pairs = _about(problem, u, count, left, high, shift)
        except Clustered:
            return _by_inverse(problem.dense(), u, count, left, high)
        if pairs is None:
            continue
        if best is None or pairs.residuals.max(initial=0.0) < best.residuals.max():
            best = pairs
        if bool((pairs.converged if high else pairs.passable).all()):
            break
    return best or _nothing(problem.dof, count, left)


def _nothing(dof: int, count: int, left: bool) -> Eigenpairs:
    """Pairs of which none was found."""
    values, vectors = np.full(count, np.nan + 0j), np.zeros((dof, count), dtype=np.complex128)
    return Eigenpairs(values, vectors, vectors if left else None, np.full(count, np.inf))


def _about(
    problem: Eigenproblem, u: float, count: int, left: bool, high: bool, shift: float
) -> Eigenpairs | None:
    free = problem.velocity_free(u)
    asked = min(count + 6, 2 * problem.dof)
    while True:
        if problem.is_long:
            mu, right = arnoldi(problem, u, shift, free, -(-asked // 2) if free else asked)
            dual = None
        else:
            factorised(2)
            p = problem.at(u)
            assert isinstance(p, _core.DenseOperator)
            mu, right, dual = p.inverse(shift, free, left)
            dual = dual if left else None
        if mu.size == 0:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            if free:
                # lambda^2 is real or one of a conjugate pair; each vector serves both signs.
                roots = np.sqrt(shift**2 + 1.0 / mu)
                values = np.concatenate([roots, -roots])
                right = np.hstack([right, right])
                dual = None if dual is None else np.hstack([dual, dual])
            else:
                values = shift + 1.0 / mu
        if problem.is_long and not free:  # conjugates agree only to rounding there
            real, upper = values.imag == 0.0, values.imag > 0.0
            values = np.concatenate([values[real], values[upper], values[upper].conj()])
            right = np.hstack([right[:, real], right[:, upper], right[:, upper].conj()])
        mine = problem.genuine(values, free)
        values, right = values[mine], right[:, mine]
        dual = None if dual is None else dual[:, mine]
        order = np.lexsort((-values.imag, values.real, np.abs(values)))
        if not problem.is_long or values.size >= 2 * problem.dof:
            break
        # All eigenvalues within `radius` of the shift are here, so all below radius - shift are.
        gap = shift**2 if free else shift
        radius = float(np.abs(1.0 / mu).max()) - gap
        radius = np.sqrt(max(radius, 0.0)) if free else radius
        if values.size >= count and np.abs(values[order[count - 1]]) <= radius:
            break
        if asked >= problem.dof:
            break
        asked = min(2 * asked, problem.dof)
    order = order[:count]
    values, right = values[order], right[:, order]
    none = ~np.isfinite(values)
    if none.any():
        values[none], right[:, none] = complex(np.nan, np.nan), 0.0
    pairs = Eigenpairs(values, right, None, problem.residuals(u, values, right))
    pairs.residuals[none] = np.inf
    if dual is not None:
        pairs = Eigenpairs(values, right, dual[:, order], pairs.residuals)
    return _refined(problem, u, pairs, left, high)


def _refined(
    problem: Eigenproblem, u: float, pairs: Eigenpairs, left: bool, high: bool
) -> Eigenpairs:
    """Pairs that failed, or lack left vectors, refined one by one (conjugates together)."""
    todo = ~(pairs.converged if high else pairs.passable) | (left and pairs.left is None)
    if not todo.any():
        return pairs
    values, right, residuals = pairs.values.copy(), pairs.right.copy(), pairs.residuals.copy()
    lefts = np.zeros_like(right) if pairs.left is None else pairs.left.copy()
    for i in np.flatnonzero(todo & (values.imag >= 0.0)):
        if not np.isfinite(values[i]):
            continue
        other = np.flatnonzero(pairs.values == np.conj(pairs.values[i]))
        better = problem.refine(u, complex(values[i]), right[:, i])
        near = abs(better.values[0] - values[i]) <= 1e-3 * abs(values[i]) + 1e-6
        if not near or better.left is None:
            continue
        same = values[i].imag == 0.0
        if better.residuals[0] <= residuals[i] or better.converged[0]:
            values[i] = better.values[0].real if same else better.values[0]
            right[:, i], residuals[i] = better.right[:, 0], better.residuals[0]
        lefts[:, i] = better.left[:, 0]
        if not same and other.size:
            j = other[0]
            values[j], residuals[j] = np.conj(values[i]), residuals[i]
            right[:, j], lefts[:, j] = right[:, i].conj(), lefts[:, i].conj()
    return Eigenpairs(values, right, lefts if left else None, residuals)


def arnoldi(
    problem: Eigenproblem, u: float, shift: float, free: bool, count: int
) -> tuple[Complex, Complex]:
    """The `count` largest |mu| of the inverse problem with x, O(dof) a step; none if that fails.

    Raises:
        Clustered: if the iteration does not end and the problem can be solved dense.
    """
    n = problem.dof
    solve = problem.factor(shift, u)

    def step(v: Array) -> Array:
        x = v[:n].reshape(-1, 1)
        if free:
            return -solve(problem.mass(x))[:, 0]
        y = v[n:].reshape(-1, 1)
        rows = problem.mass(2.0 * shift * x + y) + problem.damped(u, x)
        return np.concatenate([-solve(rows)[:, 0], v[:n]])

    size = n if free else 2 * n
    start = np.concatenate([np.linspace(1.0, 0.0, n, endpoint=False), np.zeros(size - n)])
    operator = LinearOperator((size, size), matvec=step, dtype=np.float64)
    ncv = min(size, max(2 * count + 1, 20))
    options = {"v0": start, "tol": 0.0, "ncv": ncv}
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
    found = mu if np.isfinite(mu).all() else mu[:0]
    return found, unit(vectors[:n])
