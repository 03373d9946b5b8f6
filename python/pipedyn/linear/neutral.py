# SPDX-License-Identifier: MIT
"""Eigenvalues of lambda^2 M + lambda C + K by dense matrices, and which are on the imaginary axis.

The one rule: an eigenvalue counts as on the axis if its real part is no larger than what rounding
of the matrix that it was computed from may have made of it. `cpp/pipedyn/linear/neutral.hpp` says
how large that is, for the core, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.linear.eigenproblem import Complex
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

SHIFT: float = _core.SHIFT
"""Eigenvalues are computed about this, here and in the core; it is one of no pipe but by chance."""


def shifted(mass: Array, damping: Array, stiffness: NDArray[Any]) -> NDArray[Any]:
    """SHIFT^2 M + SHIFT C + K."""
    result: NDArray[Any] = stiffness + SHIFT * damping + SHIFT**2 * mass
    return result


def companion(mass: Array, damping: Array, stiffness: NDArray[Any]) -> NDArray[Any]:
    """The matrix with eigenvalues 1 / (lambda - SHIFT) and vectors (x, (lambda - SHIFT) x)."""
    n = len(mass)
    factorised()
    right = np.hstack([damping + 2.0 * SHIFT * mass, mass])
    solved = -np.linalg.solve(shifted(mass, damping, stiffness), right)
    result = np.zeros((2 * n, 2 * n), dtype=solved.dtype)
    result[:n], result[n:, :n] = solved, np.eye(n)
    return result


def eigenvalues_of(mass: Array, damping: Array, stiffness: NDArray[Any]) -> Complex:
    """Eigenvalues of lambda^2 M + lambda C + K that doubles hold, (2n,) or fewer."""
    inverse = np.linalg.eigvals(companion(mass, damping, stiffness)).astype(complex)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = SHIFT + 1.0 / inverse
    return np.asarray(found[np.isfinite(found)], dtype=complex)


def rounding(values: Complex) -> Array:
    """How far rounding may have moved each eigenvalue.

    Args:
        values: the eigenvalues of one matrix about `SHIFT`, (k,), or a row for each, (rows, k).
    """
    rows = np.atleast_2d(values).astype(np.complex128)
    return np.array([_core.rounding(row) for row in rows]).reshape(np.shape(values))


def beyond_rounding(values: Complex) -> Array:
    """Real parts of eigenvalues less `rounding`, with its argument: > 0 of those that grow."""
    return np.asarray(values.real - rounding(values))


def grows(values: Complex) -> NDArray[np.bool_]:
    """Which eigenvalues have a real part above 0 by more than `rounding`, with its argument."""
    return values.real > rounding(values)


def decays(values: Complex) -> NDArray[np.bool_]:
    """Which eigenvalues have a real part below 0 by more than `rounding`, with its argument."""
    return values.real < -rounding(values)


def growth(values: Complex) -> Array:
    """Real parts of eigenvalues, 0 of those on the axis, with the argument of `rounding`."""
    return np.where(np.abs(values.real) <= rounding(values), 0.0, values.real)
