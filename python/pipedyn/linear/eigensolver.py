# SPDX-License-Identifier: MIT
"""Eigenvalues of P(lambda) = lambda^2 M + lambda C + K at any size, each with a checked residual.

All is done in a model's elastic coordinates, where the elastic stiffness is the identity, and on
the inverse problem about a real shift sigma: with lambda = sigma + 1/mu, C_s = C + 2 sigma M and
K_s = P(sigma),

    mu [x; y] = [-K_s^-1 (C_s x + M y); x],

so the lowest eigenvalues are the largest mu and survive rounding, and a singular K does no harm.
Small problems are solved dense; where segments differ by orders of magnitude, joint angles cannot
hold the fast roots, which `special.stiff_roots` has. A long chain is solved by Arnoldi iteration,
where M and C act through running sums and K_s is a band matrix: O(n) a step.
"""

from __future__ import annotations

import numpy as np

from pipedyn.linear.pencil import (
    BandPencil,
    Crowded,
    DensePencil,
    Eigenpairs,
    Pencil,
    ScenePencil,
    SparsePencil,
    unit,
)
from pipedyn.models.base import DENSE_LIMIT, Model
from pipedyn.models.chain import Chain
from pipedyn.models.modular import Assembly

DENSE_CHAIN = 64
"""Chains up to this size are solved dense: measured, the two routes take equal time near there."""

SHIFTS = (0.97, 2.31, 0.41)
"""Tried in turn until every residual passes; an eigenvalue may lie on one of them by chance."""


def is_long(model: Model) -> bool:
    """Whether the model is solved in O(dof)."""
    return isinstance(model, Chain | Assembly) and model.dof > DENSE_CHAIN


def pencil_of(model: Model, dense: bool | None = None) -> Pencil:
    """The model's pencil: sparse for a long chain or scene, else dense matrices."""
    if dense is None:
        dense = not is_long(model)
    if dense:
        return DensePencil(model)
    if isinstance(model, Assembly):
        return ScenePencil(model)
    assert isinstance(model, Chain)
    return BandPencil(model)


def rows_of(pencil: Pencil) -> int:
    """Rows of the largest matrix that a solve hands to LAPACK; a band has none to speak of."""
    return 1 if isinstance(pencil, SparsePencil) else 2 * pencil.dof


def lowest(
    pencil: Pencil, u: float, count: int | None = None, left: bool = False, high: bool = True
) -> Eigenpairs:
    """The `count` eigenvalues of least magnitude (all without count), with their residuals.

    Pairs that fail the check are refined once; those that fail still are in the result, and its
    `converged` says which. Without `high`, modes so high that rounding excuses any residual are
    left as they are.
    """
    total = 2 * pencil.dof
    count = total if count is None else min(count, total)
    if isinstance(pencil, SparsePencil) and count > pencil.dof // 2:
        if pencil.dof > DENSE_LIMIT:
            raise ValueError(
                f"count must be at most dof / 2 = {pencil.dof // 2} for a long chain, got {count}"
            )
        pencil = pencil.dense()
    best: Eigenpairs | None = None
    for shift in SHIFTS:
        try:
            pairs = _about(pencil, u, count, left, high, shift)
        except Crowded:
            return lowest(pencil.dense(), u, count, left, high)
        if pairs is None:
            continue
        if best is None or pairs.residuals.max(initial=0.0) < best.residuals.max():
            best = pairs
        if bool((pairs.converged if high else pairs.passable).all()):
            break
    if best is None:
        empty = np.full(count, np.nan + 0j)
        vectors = np.zeros((pencil.dof, count), dtype=np.complex128)
        return Eigenpairs(empty, vectors, vectors if left else None, np.full(count, np.inf))
    return best


def _about(
    pencil: Pencil, u: float, count: int, left: bool, high: bool, shift: float
) -> Eigenpairs | None:
    free = pencil.velocity_free(u)
    asked = min(count + 6, 2 * pencil.dof)
    while True:
        found = pencil.inverse(u, shift, free, -(-asked // 2) if free else asked, left)
        if found is None:
            return None
        mu, right, dual = found
        with np.errstate(divide="ignore", invalid="ignore"):
            if free:
                # lambda^2 is real or one of a conjugate pair; each vector serves both signs.
                roots = np.sqrt(shift**2 + 1.0 / mu)
                values = np.concatenate([roots, -roots])
                right = np.hstack([right, right])
                dual = None if dual is None else np.hstack([dual, dual])
            else:
                values = shift + 1.0 / mu
        if isinstance(pencil, SparsePencil) and not free:  # conjugates agree only to rounding there
            real, upper = values.imag == 0.0, values.imag > 0.0
            values = np.concatenate([values[real], values[upper], values[upper].conj()])
            right = np.hstack([right[:, real], right[:, upper], right[:, upper].conj()])
        if isinstance(pencil, DensePencil):
            values, right, dual = pencil.sharpened(u, values, right, dual, free)
        mine = pencil.genuine(values, free)
        values, right = values[mine], right[:, mine]
        dual = None if dual is None else dual[:, mine]
        order = np.lexsort((-values.imag, values.real, np.abs(values)))
        if isinstance(pencil, DensePencil) or values.size >= 2 * pencil.dof:
            break
        # All eigenvalues within `radius` of the shift are here, so all below radius - shift are.
        gap = shift**2 if free else shift
        radius = float(np.abs(1.0 / mu).max()) - gap
        radius = np.sqrt(max(radius, 0.0)) if free else radius
        if values.size >= count and np.abs(values[order[count - 1]]) <= radius:
            break
        if asked >= pencil.dof:
            break
        asked = min(2 * asked, pencil.dof)
    order = order[:count]
    values, right = values[order], unit(right[:, order])
    none = ~np.isfinite(values)
    if none.any():
        values[none], right[:, none] = complex(np.nan, np.nan), 0.0
    pairs = Eigenpairs(values, right, None, pencil.residuals(u, values, right))
    pairs.residuals[none] = np.inf
    if dual is not None:
        pairs = Eigenpairs(values, right, unit(dual[:, order]), pairs.residuals)
    return _mended(pencil, u, pairs, left, high)


def _mended(pencil: Pencil, u: float, pairs: Eigenpairs, left: bool, high: bool) -> Eigenpairs:
    """Pairs that failed, or want left vectors, refined one by one (conjugates together)."""
    todo = ~(pairs.converged if high else pairs.passable) | (left and pairs.left is None)
    if not todo.any():
        return pairs
    values, right, residuals = pairs.values.copy(), pairs.right.copy(), pairs.residuals.copy()
    lefts = np.zeros_like(right) if pairs.left is None else pairs.left.copy()
    for i in np.flatnonzero(todo & (values.imag >= 0.0)):
        if not np.isfinite(values[i]):
            continue
        twin = np.flatnonzero(pairs.values == np.conj(pairs.values[i]))
        better = pencil.refine(u, complex(values[i]), right[:, i])
        near = abs(better.values[0] - values[i]) <= 1e-3 * abs(values[i]) + 1e-6
        if not near or better.left is None:
            continue
        same = values[i].imag == 0.0
        if better.residuals[0] <= residuals[i] or better.converged[0]:
            values[i] = better.values[0].real if same else better.values[0]
            right[:, i], residuals[i] = better.right[:, 0], better.residuals[0]
        lefts[:, i] = better.left[:, 0]
        if not same and twin.size:
            j = twin[0]
            values[j], residuals[j] = np.conj(values[i]), residuals[i]
            right[:, j], lefts[:, j] = right[:, i].conj(), lefts[:, i].conj()
    return Eigenpairs(values, right, lefts if left else None, residuals)
