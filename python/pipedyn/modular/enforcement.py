# SPDX-License-Identifier: MIT
"""Dense recursions that enforce constraints group by group, for any scene.

Free modules obey M q'' = f; constraints A_r q'' = b_r, r = 1 .. R, enter in groups, in any order.
Two recursions give the accelerations. Both are O(n^3) and serve to read, compare and teach the
method; motions find the same accelerations in O(n), see cpp/pipedyn/modular/scene.hpp.

Orthonormal basis. C_0 = I; S_r spans the null space of A_r C_{r-1}, and C_r = C_{r-1} S_r. Then
q'' = p + C_R a with any p that meets the constraints (kept by the same recursion), and
C_R^T (M q'' - f) = 0.

Udwadia-Kalaba. With P_0 = M^-1 and q''_0 = M^-1 f, each group corrects the accelerations and
compliance that the groups before it left,

    G = P A_r^T (A_r P A_r^T)^+,   q'' <- q'' + G (b_r - A_r q''),   P <- P - G A_r P,

which is the Kalman filter's update for a measurement without noise. The angles phi_j have no
inertia and M^-1 does not exist, but any multiple of sum A_r^T A_r may be added to M, and of
sum A_r^T b_r to f: where the constraints are met the equations stay the same. The sum is regular
unless a direction that the constraints leave has no inertia.

Source: Orsino (2017) for the recursion; Udwadia and Kalaba (1992); Udwadia and Wanichanon (2013)
for the singular mass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import PipedynError

RANK = 1e-10
"""Singular values of a group below this share of its rows' size are redundant: rounding leaves some
1e-16 of such a row in each group."""

Group = tuple[Array, Array]
"""A group of m constraints: A_r, shape (m, N), and b_r, shape (m,)."""

Enforce = Callable[[Array, Array, Sequence[Group]], Array]
"""A function that returns accelerations, (N,), from M, (N, N), positive semidefinite, f, groups."""


@saved_as("Mechanism")
class Mechanism(PipedynError):
    """The scene can move in some direction without inertia."""


def projection(groups: Sequence[Group], size: int) -> tuple[Array, Array]:
    """C_R, shape (N, dof), and p, shape (N,): what the constraints leave free, group by group.

    The columns of C_R are orthonormal. To p, which meets the constraints, each group adds the
    smallest possible correction.
    """
    basis, particular = np.eye(size), np.zeros(size)
    for rows, wanted in groups:
        left, values, right = np.linalg.svd(rows @ basis)
        rank = _rank(values, rows)
        missing = left[:, :rank].T @ (wanted - rows @ particular)
        particular = particular + basis @ (right[:rank].T @ (missing / values[:rank]))
        basis = basis @ right[rank:].T
    return basis, particular


def by_orthonormal_basis(mass: Array, force: Array, groups: Sequence[Group]) -> Array:
    """Accelerations q'', shape (N,), by the recursive orthonormal basis.

    Raises `Mechanism` where a direction that is left free has no inertia.
    """
    basis, particular = projection(groups, force.size)
    reduced = basis.T @ mass @ basis
    try:
        factor = np.linalg.cholesky(reduced)
    except np.linalg.LinAlgError:
        raise Mechanism("a direction that the constraints leave free has no inertia") from None
    rest = np.linalg.solve(factor, basis.T @ (force - mass @ particular))
    return particular + basis @ np.linalg.solve(factor.T, rest)


def by_udwadia_kalaba(mass: Array, force: Array, groups: Sequence[Group]) -> Array:
    """Accelerations q'', shape (N,), by the recursive Udwadia-Kalaba equation.

    Raises `Mechanism` where a direction that is left free has no inertia.
    """
    every, all_wanted = (np.concatenate(of) for of in zip(*groups, strict=True))
    own = np.diag(mass)
    inertia = float(np.median(own[own > 0.0]))  # so that no part is lost in rounding
    mass, force = mass + inertia * every.T @ every, force + inertia * every.T @ all_wanted
    scale = 1.0 / np.sqrt(np.diag(mass))
    values, vectors = np.linalg.eigh(scale[:, None] * mass * scale)
    if values[0] <= RANK:
        raise Mechanism("a direction that the constraints leave free has no inertia")
    vectors *= scale[:, None]
    compliance = (vectors / values) @ vectors.T
    stiffest = float(np.abs(compliance).max())
    accelerations: Array = compliance @ force
    for rows, wanted in groups:
        spread = compliance @ rows.T
        gain = spread @ _pseudo_inverse(rows @ spread, stiffest * float(np.sum(rows**2)))
        accelerations = accelerations + gain @ (wanted - rows @ accelerations)
        compliance = compliance - gain @ spread.T
        compliance = 0.5 * (compliance + compliance.T)
    return accelerations


def _rank(values: Array, rows: Array) -> int:
    """Number of singular values of a group that are not redundant."""
    size = float(np.linalg.norm(rows, axis=1).max(initial=0.0))
    return int(np.sum(values > RANK * size))


def _pseudo_inverse(matrix: Array, size: float) -> Array:
    """Pseudo-inverse of a symmetric matrix, whose eigenvalues below RANK times size count as 0."""
    values, vectors = np.linalg.eigh(matrix)
    good = values > RANK * size
    return vectors[:, good] @ (vectors[:, good] / values[good]).T


Enforcement = Literal["orthonormal", "udwadia-kalaba"]

ENFORCEMENTS: dict[Enforcement, Enforce] = {
    "orthonormal": by_orthonormal_basis,
    "udwadia-kalaba": by_udwadia_kalaba,
}
"""The dense recursions by name; by default the core finds accelerations of the first in O(n)."""
