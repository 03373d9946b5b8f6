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

from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.orbits.periodic_orbit import integrals
from pipedyn.util.check import Array
from pipedyn.util.counters import check_time

AT_ONCE = 2e9
"""Number of multiplications, a second of work, after which the time limit is looked at."""


@cache
def _magnus_weights(parts: int) -> tuple[Array, Array]:
    """Weights of the stages in b0 and b1 of each part of an interval of length 1, (parts, s)."""
    ends = np.linspace(0.0, 1.0, parts + 1)
    single, double = integrals(ends, 1), integrals(ends, 2)
    # Integration by parts: int (t - middle) p dt is h / 2 times the sum of the integral of p at
    # both ends, less the integral of that integral.
    first = 0.5 * (single[1:] + single[:-1]) - parts * np.diff(double, axis=0)
    return np.diff(single, axis=0), first


def interval_maps(rows: Array, durations: Array, units: Array, parts: NDArray[np.int_]) -> Array:
    """Maps of changes of a state [p, p'] over intervals, in units of the state, (M, n, n).

    Args:
        rows: derivatives of p'' by the state at the stages of each interval, (M, s, n / 2, n).
        durations: durations of the intervals, (M,).
        units: units of the state, (n,): those of p are all 1, and those of p' are all equal.
        parts: number of parts into which each interval is divided, (M,).
    """
    counts, which = np.unique(parts, return_inverse=True)
    weights = zip(*map(_magnus_weights, counts.tolist()), strict=True)
    zeroth, first = (np.concatenate(of) for of in weights)
    begins = (np.cumsum(counts) - counts)[which]
    work = 10.0 * float(parts.max()) * rows.shape[3] ** 3
    pieces = range(0, len(rows), max(1, int(AT_ONCE / work)))
    maps = []
    for begin, end in pairwise([*pieces, len(rows)]):
        check_time()
        own = slice(begin, end)
        divided = parts[own].tolist(), begins[own].tolist()
        maps.append(
            _core.interval_maps(
                rows[own], durations[own], *divided, float(units[-1]), zeroth, first
            )
        )
    return np.concatenate(maps) if len(maps) > 1 else maps[0]


def exponentials(exponents: Array) -> Array:
    """Exponentials of a stack of matrices, (..., n, n).

    If they overflow, they are infinite or NaN.
    """
    return _core.exponentials(exponents)
