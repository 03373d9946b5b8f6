# SPDX-License-Identifier: MIT
"""Propagation of small changes of a state along an orbit, by Magnus' series of fourth order.

Over a part of length h about its middle,

    y' = J(t) y,   y(h) = exp(b0 - [b0, b1]) y(0),   b0 = int J dt,   b1 = int (t - h / 2) J dt / h,

with an error of h^5 for each part. The exponential is exact where J does not change, so parts may
be as long as many turns of a fast mode, which methods for differential equations must resolve. J is
taken from the stages of a collocation's intervals, as the polynomial through them.

Source: Blanes, Casas, Oteo and Ros (2009), The Magnus expansion and some of its applications.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipedyn.orbits.periodic_orbit import ORBIT_STAGES, integrals
from pipedyn.util.check import Array
from pipedyn.util.counters import check_time

CACHED = 14_000
"""Largest number of entries in a stack of matrices: nine stacks of this size fit into 1 MB of
cache."""

DEGREE, LARGEST_NORM = 16, 0.78
"""Degree of Taylor's polynomial, and the norm up to which it gives exp to rounding, as
0.78^17 / 17! = 4e-17 (Al-Mohy and Higham 2010, theta_16)."""

_TAYLOR = np.array([1.0 / math.factorial(k) for k in range(DEGREE + 1)])

_SUMS = np.zeros((4, 4))
"""Coefficients of A, A^2, A^3 and A^4 in the four sums of a polynomial in A^4, which also have a
constant term."""
_SUMS[:, :3] = _TAYLOR[1:].reshape(4, 4)[:, :3]
_SUMS[3, 3] = _TAYLOR[DEGREE]


@cache
def _magnus_weights(parts: int) -> tuple[Array, Array]:
    """Weights of the stages in b0 and b1 of each part of an interval of length 1, (parts, s)."""
    ends = np.linspace(0.0, 1.0, parts + 1)
    single, double = integrals(ends, 1), integrals(ends, 2)
    # Integration by parts: int (t - middle) p dt is h / 2 times the sum of the integral of p at
    # both ends, less the integral of that integral.
    first = 0.5 * (single[1:] + single[:-1]) - parts * np.diff(double, axis=0)
    return np.diff(single, axis=0), first


@np.errstate(over="ignore", invalid="ignore")
def interval_maps(rows: Array, durations: Array, units: Array, parts: NDArray[np.int_]) -> Array:
    """Maps of changes of a state [p, p'] over intervals, in units of the state, (M, n, n).

    Args:
        rows: derivatives of p'' by the state at the stages of each interval, (M, s, n / 2, n).
        durations: durations of the intervals, (M,).
        units: units of the state, (n,): those of p are all 1, and those of p' are all equal.
        parts: number of parts into which each interval is divided, (M,).
    """
    half, size = rows.shape[2:]
    maps = np.empty((len(rows), size, size))
    for count in np.unique(parts).tolist():
        piece = max(1, CACHED // (count * size**2))
        same = np.flatnonzero(parts == count)
        for some in np.split(same, range(piece, same.size, piece)):
            check_time()
            weights = np.stack(_magnus_weights(count)).reshape(2 * count, ORBIT_STAGES)
            scaled = rows[some].reshape(some.size, ORBIT_STAGES, -1) * durations[some, None, None]
            both = (weights @ scaled).reshape(some.size, 2, count, half, size)
            both *= units / units[half:, None]
            step = durations[some, None, None, None] / count * units[-1]
            exponents = _exponents(both[:, 0], both[:, 1], step)
            factors = exponentials(exponents.reshape(-1, size, size)).reshape(exponents.shape)
            whole = factors[:, 0]
            for k in range(1, count):
                whole = factors[:, k] @ whole
            maps[some] = whole
    return maps


def _exponents(b0: Array, b1: Array, step: Array) -> Array:
    """b0 - [b0, b1] from the lower halves of b0 and b1, (..., n / 2, n).

    The upper half of b0 only maps p' to p, by the factor `step`; that of b1 is 0.
    """
    half, size = b0.shape[-2:]
    made = np.empty((*b0.shape[:-2], size, size))
    top, bottom = made[..., :half, :], made[..., half:, :]
    np.multiply(-step, b1, out=top)
    np.einsum("...ii->...i", top[..., half:])[...] += step[..., 0]
    np.subtract(b0, b0[..., half:] @ b1, out=bottom)
    bottom += b1[..., half:] @ b0
    bottom[..., half:] += step * b1[..., :half]
    return made


def exponentials(exponents: Array) -> Array:
    """Exponentials of a stack of matrices, (..., n, n), by Taylor's polynomial and squarings.

    If they overflow, they are infinite or NaN. `scipy.linalg.expm`, which takes one matrix after
    the other, needs four times as long for n = 6, and as long for n from 20 to 40.
    """
    if len(exponents) > 1 and exponents.size > CACHED:
        return np.concatenate([exponentials(half) for half in np.array_split(exponents, 2)])
    square = exponents @ exponents
    powers = np.stack([exponents, square, square @ exponents, square @ square])
    sizes = np.abs(powers[2:]).sum(axis=-2).reshape(2, -1).max(axis=1) ** [1.0 / 3.0, 0.25]
    if not np.isfinite(sizes).all():
        return np.full_like(exponents, math.nan)
    halvings = max(0, math.ceil(math.log2(max(*sizes, 1e-300) / LARGEST_NORM)))
    shrunk = 0.5 ** (halvings * np.arange(1.0, 5.0))
    sums = ((_SUMS * shrunk) @ powers.reshape(4, -1)).reshape(powers.shape)
    np.einsum("k...ii->...ik", sums)[...] += _TAYLOR[:DEGREE:4]
    fourth, made = shrunk[3] * powers[3], sums[3]
    for rest in sums[2::-1]:
        made = made @ fourth + rest
    for _ in range(halvings):
        made = made @ made
    return np.asarray(made)
