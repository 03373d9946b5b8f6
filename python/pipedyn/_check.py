# SPDX-License-Identifier: MIT
"""Checks of arguments: one sentence that names the argument, the rule and what came."""

from __future__ import annotations

import math
import operator
from collections.abc import Collection
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def shown(value: object) -> str:
    """What came, short enough for a message."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def real(
    name: str,
    value: Any,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    open_high: bool = False,
) -> float:
    """A finite real number in an interval, as a float."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        raise TypeError(f"{name} must be a real number, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    below = number <= low if open_low else number < low
    above = number >= high if open_high else number > high
    if not math.isfinite(number) or below or above:
        raise ValueError(f"{name} must {_rule(low, high, open_low, open_high)}, got {shown(value)}")
    return number


def _rule(low: float, high: float, open_low: bool, open_high: bool) -> str:
    if low == -math.inf and high == math.inf:
        return "be finite"
    if high == math.inf:
        sign = ">" if open_low else ">="
        return f"be finite and {sign} {low:g}"
    left, right = "(" if open_low else "[", ")" if open_high else "]"
    return f"lie in {left}{low:g}, {high:g}{right}"


def count(name: str, value: Any, *, low: int = 1, high: int | None = None) -> int:
    """A whole number in an interval; booleans and floats do not count."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, Integral):
        raise TypeError(f"{name} must be a whole number, got {shown(value)}")
    number = operator.index(value)
    if number < low or (high is not None and number > high):
        rule = f"at least {low}" if high is None else f"from {low} to {high}"
        raise ValueError(f"{name} must be {rule}, got {shown(value)}")
    return number


def flag(name: str, value: Any) -> bool:
    """True or False, nothing that only looks like it."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def choice(name: str, value: Any, options: Collection[str]) -> str:
    """One of a few words."""
    listed = ", ".join(repr(option) for option in options)
    if not isinstance(value, str):
        raise TypeError(f"{name} must be one of {listed}, got {shown(value)}")
    if value not in options:
        raise ValueError(f"{name} must be one of {listed}, got {shown(value)}")
    return value


def array(
    name: str,
    value: Any,
    *,
    size: int | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    longest: int = 1_000_000,
) -> Array:
    """A one-dimensional array of finite numbers in an interval, as a read-only copy."""
    try:
        raw = np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise TypeError(f"{name} must be an array of real numbers: {error}") from error
    if raw.dtype.kind not in "iuf":
        raise TypeError(f"{name} must be an array of real numbers, got {shown(value)}")
    if isinstance(value, list | tuple) and any(
        isinstance(v, bool | np.bool_) for v in value[:1000]
    ):
        raise TypeError(f"{name} must be an array of real numbers, got {shown(value)}")
    if raw.ndim != 1:
        raise ValueError(f"{name} must be one-dimensional, got shape {raw.shape}")
    if size is not None and raw.size != size:
        raise ValueError(f"{name} must have {size} entries, got {raw.size}")
    if not 1 <= raw.size <= longest:
        raise ValueError(f"{name} must have from 1 to {longest} entries, got {raw.size}")
    numbers = np.array(raw, dtype=np.float64)
    below = numbers <= low if open_low else numbers < low
    bad = ~np.isfinite(numbers) | below | (numbers > high)
    if bad.any():
        where = int(np.argmax(bad))
        rule = _rule(low, high, open_low, False)
        raise ValueError(f"{name} must {rule}, got {numbers[where]!r} at index {where}")
    numbers.flags.writeable = False
    return numbers
