# SPDX-License-Identifier: MIT
"""Eigenvalues of lambda^2 M + lambda C + K by dense matrices, and which lie on the imaginary axis.

One rule decides: an eigenvalue counts as on the axis if the magnitude of its real part is no larger
than the error that rounding of its matrix may cause. `cpp/pipedyn/linear/neutral.hpp` computes this
error, for the core as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations

SHIFT: float = _core.SHIFT
"""Shift about which eigenvalues are computed, here and in the core; only by chance it is an
eigenvalue."""


def shifted(mass: Array, damping: Array, stiffness: NDArray[Any]) -> NDArray[Any]:
    """The matrix SHIFT^2 M + SHIFT C + K, shape (n, n)."""
    result: NDArray[Any] = stiffness + SHIFT * damping + SHIFT**2 * mass
    return result


def companion(mass: Array, damping: Array, stiffness: NDArray[Any]) -> NDArray[Any]:
    """Matrix (2n, 2n) with eigenvalues 1 / (lambda - SHIFT), vectors (x, (lambda - SHIFT) x)."""
    n = len(mass)
    count_factorisations()
    right = np.hstack([damping + 2.0 * SHIFT * mass, mass])
    solved = -np.linalg.solve(shifted(mass, damping, stiffness), right)
    result = np.zeros((2 * n, 2 * n), dtype=solved.dtype)
    result[:n], result[n:, :n] = solved, np.eye(n)
    return result


def eigenvalues_of(mass: Array, damping: Array, stiffness: NDArray[Any]) -> Complex:
    """Finite eigenvalues of lambda^2 M + lambda C + K, shape (2n,) or fewer.

    A complex K has hysteresis, which acts on oscillation alone. The eigenvalues then are those
    above the real axis, their conjugates, and the growing real ones without the imaginary part of
    K, instead of the growing ones into which hysteresis turns these.
    """
    inverse = np.linalg.eigvals(companion(mass, damping, stiffness)).astype(complex)
    with np.errstate(divide="ignore", invalid="ignore"):
        every = SHIFT + 1.0 / inverse
    found: Complex = np.asarray(every[np.isfinite(every)], dtype=complex)
    if not np.iscomplexobj(stiffness):
        return found
    still = eigenvalues_of(mass, damping, stiffness.real)
    static = still[(np.abs(still.imag) < 1e-9) & (still.real > 0.0)]
    for value in static:
        apart = np.where(found.real > 0.0, np.abs(found - value), np.inf)
        if np.isfinite(apart).any():
            found = np.delete(found, int(np.argmin(apart)))
    above = found[found.imag > 1e-9]
    return np.concatenate([above, above.conj(), static])


def rounding(values: Complex) -> Array:
    """Bound on the error of each eigenvalue by rounding, of the shape of the values.

    Args:
        values: the eigenvalues of one matrix about `SHIFT`, (k,), or of several, (rows, k).
    """
    rows = np.atleast_2d(values).astype(np.complex128)
    return np.array([_core.rounding(row) for row in rows]).reshape(np.shape(values))


def beyond_rounding(values: Complex) -> Array:
    """Real parts of eigenvalues less their `rounding`, with the same argument; > 0 if they grow."""
    return np.asarray(values.real - rounding(values))


def grows(values: Complex) -> NDArray[np.bool_]:
    """Which eigenvalues have a real part above `rounding`; values: as for `rounding`."""
    return values.real > rounding(values)


def decays(values: Complex) -> NDArray[np.bool_]:
    """Which eigenvalues have a real part below minus `rounding`; values: as for `rounding`."""
    return values.real < -rounding(values)


def growth(values: Complex) -> Array:
    """Real parts of eigenvalues, 0 for those on the axis; values: as for `rounding`."""
    return np.where(np.abs(values.real) <= rounding(values), 0.0, values.real)
