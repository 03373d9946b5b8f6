# SPDX-License-Identifier: MIT
"""Power iteration for the largest stretch of a linear map, by products with vectors alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipedyn.util.check import Array


def largest_stretch(times: Callable[[Array], Array], start: Array, iterations: int = 40) -> float:
    """|A x| / |x| in the last of some products x <- A x, which `times` computes; 0 if A x vanishes.

    For a symmetric A the value tends from below to the largest magnitude of an eigenvalue. If the
    second largest magnitude is less than two thirds of the largest, the error after 40 products is
    due to rounding only.
    """
    x, stretch = start, 0.0
    for _ in range(iterations):
        x = times(x / np.linalg.norm(x))
        stretch = float(np.linalg.norm(x))
        if stretch == 0.0:
            break
    return stretch
