# SPDX-License-Identifier: MIT
"""Band matrices, factored by LAPACK."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from pipedyn.util.counters import factorised

Rows = NDArray[Any]


def band_solver(band: Rows, below: int, above: int) -> Callable[[Rows, bool], Rows]:
    """solve(rows, adjoint) with a real or complex band matrix, or its conjugate transpose.

    Entry (i, j) stands at [below + above + i - j, j], shape (2 below + above + 1, n), with so many
    diagonals below and above the main one. Band and rows may be overwritten. An exactly singular
    matrix gets the LU factors of one that differs in rounding.
    """
    factorised()
    real = not np.iscomplexobj(band)
    factorise = lapack.dgbtrf if real else lapack.zgbtrf
    substitute = lapack.dgbtrs if real else lapack.zgbtrs
    lu, pivots, singular = factorise(band, kl=below, ku=above, overwrite_ab=True)
    if singular > 0:
        pivot = lu[below + above]
        pivot[pivot == 0.0] = np.finfo(float).eps

    def solve(rows: Rows, adjoint: bool) -> Rows:
        if real and np.iscomplexobj(rows):
            return solve(rows.real, adjoint) + 1j * solve(rows.imag, adjoint)
        right = np.asarray(rows, dtype=lu.dtype, order="F")
        how = {"trans": 2 if adjoint else 0, "overwrite_b": True}
        return substitute(lu, below, above, right, pivots, **how)[0]

    return solve
