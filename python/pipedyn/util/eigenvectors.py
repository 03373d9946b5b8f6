# SPDX-License-Identifier: MIT
"""Eigenvalues with left and right vectors by LAPACK's dgeev, beside which other threads run.

`scipy.linalg.eig` calls the same routine but holds the interpreter's lock, so that eigenproblems
in several threads wait for one another; `numpy.linalg.eig` does not, but has no left vectors.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_lapack

from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

Complex = NDArray[np.complex128]


def _routine(name: str, arguments: int) -> Any:
    """A routine of LAPACK that takes addresses; ctypes lets go of the lock while it runs."""
    capsule = cython_lapack.__pyx_capi__[name]
    name_of = ctypes.pythonapi.PyCapsule_GetName
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    address_of = ctypes.pythonapi.PyCapsule_GetPointer
    address_of.restype, address_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)
    return kind(address_of(capsule, name_of(capsule)))


_dgeev = _routine("dgeev", 14)


def eigenvectors(matrix: Array) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues (n,), left vectors y with y^H A = mu y^H and right ones, both (n, n), by columns.

    Raises:
        numpy.linalg.LinAlgError: if the iteration does not converge.
    """
    factorised()
    n = len(matrix)
    a = np.array(matrix, dtype=np.float64, order="F")
    real, imaginary = np.empty(n), np.empty(n)
    left, right = np.empty((n, n), order="F"), np.empty((n, n), order="F")
    both, rows, info = np.array(b"V"), np.array(n, np.intc), np.array(0, np.intc)

    def call(work: Array, size: int) -> None:
        length = np.array(size, np.intc)
        given = (both, both, rows, a, rows, real, imaginary, left, rows, right, rows)
        _dgeev(*(part.ctypes.data for part in (*given, work, length, info)))

    best = np.empty(1)
    call(best, -1)  # asks for the best size of its workspace
    call(np.empty(int(best[0])), int(best[0]))
    if info:
        raise np.linalg.LinAlgError("eigenvalues did not converge")
    values = real + 1j * imaginary
    return values, _complex(imaginary, left), _complex(imaginary, right)


def _complex(imaginary: Array, vectors: Array) -> Complex:
    """Columns j and j + 1 of a conjugate pair hold real and imaginary part of one vector."""
    result = vectors.astype(np.complex128)
    upper = np.flatnonzero(imaginary > 0.0)
    result.imag[:, upper] = vectors[:, upper + 1]
    result[:, upper + 1] = result[:, upper].conj()
    return result
