# SPDX-License-Identifier: MIT
"""The law by which the error of a family of models falls as they grow."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.util.check import Array
from pipedyn.util.result import result


@result
class ConvergenceLaw:
    """How the error of a family's critical speed falls as its models grow.

    Attributes:
        law: "power" (error ~ size^-rate), "exponential" (error ~ rate^-size), "flat" (it ends at
            `limit`), or "unknown" (no law fits, or too few sizes).
        rate: order, or factor by which the error falls with each degree of freedom; NaN for the
            other laws.
        limit: for "flat" the signed relative error at infinite size, extrapolated; else NaN.
        spread: by how much the limit moves without the smallest of the sizes; else NaN.
        sizes: the sizes used, shape (k,).
    """

    law: Literal["power", "exponential", "flat", "unknown"]
    rate: float
    limit: float
    spread: float
    sizes: Array


def relative_errors(
    found: Iterable[CriticalSpeed], exact: CriticalSpeed
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Sizes, signed errors of the speed relative to the exact, and whether the kind is the same."""
    results = sorted(found, key=lambda result: result.size)
    sizes = np.array([result.size for result in results], dtype=np.float64)
    speeds = np.array([result.speed for result in results])
    same_kind = np.array([result.kind == exact.kind for result in results], dtype=np.bool_)
    with np.errstate(divide="ignore", invalid="ignore"):
        return sizes, (speeds - exact.speed) / exact.speed, same_kind


def convergence_law(found: Sequence[CriticalSpeed], exact: CriticalSpeed) -> ConvergenceLaw:
    """The law of critical speeds of models of one family; rounding is not fitted."""
    sizes, errors, same_kind = relative_errors(found, exact)
    good = same_kind & np.isfinite(errors)
    good[good] &= np.abs(errors[good]) > 30.0 * own_error(found, exact)
    return fitted_law(sizes[good], errors[good])


def fitted_law(sizes: Array, errors: Array) -> ConvergenceLaw:
    """The law by which relative errors (k,) fall with increasing sizes (k,), far above rounding."""
    unknown = ConvergenceLaw("unknown", math.nan, math.nan, math.nan, sizes)
    if sizes.size < 4:
        return unknown
    # An error that lasts: c_0 of c_0 + c_1 / n + c_2 / n^2 + ..., if it converges.
    count = min(5, sizes.size)
    limits = []
    for k in (count, count - 1):
        powers = (1.0 / sizes[-k:])[:, None] ** np.arange(k)
        limits.append(float(np.linalg.solve(powers, errors[-k:])[0]))
    spread = abs(limits[0] - limits[1])
    near = abs(limits[0]) < 2.0 * abs(errors[-1])  # fast decay is extrapolated to anything
    if near and abs(limits[0]) > max(0.3 * abs(errors[-1]), 5.0 * spread):
        return ConvergenceLaw("flat", math.nan, limits[0], spread, sizes[-5:])
    last = sizes >= min(sizes[-1] / 2.0, sizes[-4])
    sizes, logs = sizes[last], np.log(np.abs(errors[last]))
    power, power_misfit = _line(np.log(sizes), logs)
    exponential, misfit = _line(sizes, logs)
    if min(power_misfit, misfit) > 0.1 * float(np.ptp(logs)):
        return replace(unknown, sizes=sizes)
    # The families' orders are 1 to 4: what falls faster than the eighth power is no power.
    if (misfit < power_misfit or -power > 8.0) and exponential < -math.log(2.0):
        return ConvergenceLaw("exponential", math.exp(-exponential), math.nan, math.nan, sizes)
    return ConvergenceLaw("power", -power, math.nan, math.nan, sizes)


def own_error(found: Iterable[CriticalSpeed], exact: CriticalSpeed) -> float:
    """Relative error that the speeds compared have of their own."""
    own = max((result.error for result in found), default=0.0)
    eps = float(np.finfo(float).eps)
    return (exact.error + own) / exact.speed + eps if exact.speed > 0.0 else eps


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and root mean square misfit of a straight line."""
    slope, start = np.polyfit(x, y, 1)
    return float(slope), float(np.sqrt(np.mean((start + slope * x - y) ** 2)))
