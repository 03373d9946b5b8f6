# SPDX-License-Identifier: MIT
"""Checks of arguments. Each error message names the argument, the rule and the value given."""

from __future__ import annotations

import math
import operator
import reprlib
import sys
from collections.abc import Collection, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipedyn.util.hints import did_you_mean

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

Word = TypeVar("Word", bound=str)

NOT_NUMBERS = (bool, np.bool_, np.timedelta64)
"""Types that Python or numpy registers as numbers, but that arguments must not have."""

LONGEST = 1_000_000_000
"""Largest number of entries of one argument or result: as float64 they take 8 GB."""

_BRIEF = reprlib.Repr()
_BRIEF.maxlist = _BRIEF.maxtuple = _BRIEF.maxset = _BRIEF.maxfrozenset = _BRIEF.maxdict = 20
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = 120


def shown(value: object) -> str:
    """A value as text on one line, short enough for an error message."""
    if said := getattr(type(value), "_as_argument", None):
        return str(said(value))
    try:
        text = " ".join(_BRIEF.repr(value).split())
    except Exception:  # an int with more digits than Python prints, or a repr that fails
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "..."


def is_quantity(value: Any) -> bool:
    """Whether the value is a `pint.Quantity`, told without importing pint."""
    return hasattr(value, "dimensionality") and callable(getattr(value, "to", None))


def has_quantity(value: Any) -> bool:
    """Whether the value is a `pint.Quantity` or a list or array with one."""
    objects = isinstance(value, np.ndarray) and value.dtype.kind == "O" and value.ndim > 0
    listed = isinstance(value, list | tuple) or objects
    return is_quantity(value) or (listed and any(map(is_quantity, value)))


def in_unit(name: str, value: Any, unit: str) -> Any:
    """Numbers in a unit from quantities of pint, one or a list of them; other values unchanged."""
    if not has_quantity(value):
        return value
    if not is_quantity(value):
        return [in_unit(f"{name}[{i}]", one, unit) for i, one in enumerate(value)]
    try:
        return value.to(unit).magnitude
    except Exception as error:  # of pint: another dimension, or an offset unit such as degC
        raise ValueError(
            f"{name} must be a quantity that converts to {unit}, got {shown(value)}"
        ) from error


def real(
    name: str,
    value: Any,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    open_high: bool = False,
    unit: str = "",
) -> float:
    """The value as a float, refused unless it is a finite real number in an interval.

    With a unit, the value may be a `pint.Quantity`, which is converted to it.
    """
    if unit:
        value = in_unit(name, value, unit)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    # `type` is much faster than `isinstance` of an abstract class.
    if type(value) is not float and not _is_real(value):
        raise TypeError(f"{name} must be a real number{_plain(value)}, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    below = number <= low if open_low else number < low
    above = number >= high if open_high else number > high
    if not math.isfinite(number) or below or above:
        raise ValueError(f"{name} must {_rule(low, high, open_low, open_high)}, got {shown(value)}")
    return number + 0.0  # -0.0 becomes 0.0


def _plain(value: Any) -> str:
    """What to do with a quantity of pint where its unit is not known; empty for other values."""
    if not has_quantity(value):
        return ""
    known = "speed_from_si, time_from_si and length_from_si of a Pipe convert quantities of pint"
    return f" ({known}; frequencies are numbers in rad/s, for which pint takes Hz)"


def _rule(low: float, high: float, open_low: bool, open_high: bool) -> str:
    if low == -math.inf and high == math.inf:
        return "be finite"
    if high == math.inf:
        sign = ">" if open_low else ">="
        return f"be finite and {sign} {low:g}"
    left, right = "(" if open_low else "[", ")" if open_high else "]"
    return f"lie in {left}{low:g}, {high:g}{right}"


def count(name: str, value: Any, *, low: int = 1, high: int | None = None) -> int:
    """The value, refused unless it is an integer in an interval and no boolean or float."""
    known = type(value) is int  # an abstract class takes far longer
    if not known and (isinstance(value, NOT_NUMBERS) or not isinstance(value, Integral)):
        raise TypeError(f"{name} must be a whole number, got {shown(value)}")
    number = operator.index(value)
    if number < low or (high is not None and number > high):
        rule = f"at least {low}" if high is None else f"from {low} to {high}"
        raise ValueError(f"{name} must be {rule}, got {shown(value)}")
    return number


def how_many(number: int, thing: str) -> str:
    """A number of things in words, as "1 root" or "2 roots"."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def flag(name: str, value: Any) -> bool:
    """The value, refused unless it is True or False."""
    return bool(instance(name, value, bool | np.bool_, "True or False"))


def executor(name: str, value: Any) -> None:
    """Raises TypeError unless the value is None or has `submit`, as an `Executor` does."""
    submits = callable(getattr(value, "submit", None)) and not isinstance(value, type)
    if value is not None and not submits:
        raise TypeError(f"{name} must be a concurrent.futures.Executor, got {shown(value)}")


def instance(name: str, value: Any, kinds: Any, said: str = "") -> Any:
    """The value, refused unless it is of one of some types; `said` names these in words."""
    if not isinstance(value, kinds):
        raise TypeError(f"{name} must be {said or f'of type {kinds.__name__}'}, got {shown(value)}")
    return value


def choice(name: str, value: Any, options: Collection[Word]) -> Word:
    """The value, refused unless it is one of a few words."""
    is_word = isinstance(value, str)
    if is_word and value in options:
        plain = type(value) is str
        return value if plain else next(option for option in options if option == value)
    listed = ", ".join(repr(option) for option in options)
    if not is_word:
        raise TypeError(f"{name} must be one of {listed}, got {shown(value)}")
    hint = did_you_mean(value, options)
    raise ValueError(f"{name} must be one of {listed}, got {shown(value)}{hint}")


def array(
    name: str,
    value: Any,
    *,
    size: int | tuple[int, ...] | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    open_high: bool = False,
    longest: int = 1_000_000,
) -> Array:
    """A read-only copy of the value as an array, shape (k,), of finite numbers in an interval.

    `size` is the number of entries, or a tuple of the numbers that are allowed, ascending.
    """
    raw = numbers(name, value, "an array of real numbers", longest=longest)
    if raw.ndim != 1:
        came = f"shape {raw.shape}" if raw.ndim else f"the number {shown(value)}"
        raise ValueError(f"{name} must be one-dimensional, as a list of numbers is, got {came}")
    sizes = size if isinstance(size, tuple) else (size,)
    if size is not None and raw.size not in sizes:
        many = " or ".join(map(str, dict.fromkeys(sizes)))
        raise ValueError(f"{name} must have {many} entries, got {raw.size}")
    if raw.size < 1:
        raise ValueError(f"{name} must have from 1 to {longest} entries, got 0")
    with np.errstate(over="ignore"):  # longer floats may become infinite, which is refused below
        values = np.array(raw, dtype=np.float64)
    good = (values > low if open_low else values >= low) & np.isfinite(values)
    good &= values < high if open_high else values <= high
    entries(name, values, good, _rule(low, high, open_low, open_high))
    values.flags.writeable = False
    return values


def window(
    names: tuple[str, str], ranges: Any, rules: tuple[dict[str, Any], dict[str, Any]]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges (low, high) of two named numbers; `real` checks their ends by the rule of each."""
    if not isinstance(ranges, Mapping):
        raise TypeError(f"ranges must map x and y to (low, high), got {shown(ranges)}")
    if set(ranges) != set(names):
        raise ValueError(f"ranges must have {names[0]!r} and {names[1]!r}, got {list(ranges)}")
    first, second = (
        interval(f"ranges[{name!r}]", ranges[name], **rule)
        for name, rule in zip(names, rules, strict=True)
    )
    return first, second


def interval(name: str, value: Any, **rule: Any) -> tuple[float, float]:
    """The value as a range (low, high); `real` checks both ends by a rule."""
    low, high = (real(name, float(end), **rule) for end in array(name, value, size=2))
    if not high - low > 1e-9 * (1.0 + abs(high)):
        raise ValueError(f"{name} must be (low, high), got ({low:g}, {high:g})")
    return low, high


def entries(name: str, values: NDArray[Any], good: NDArray[np.bool_], rule: str) -> None:
    """Raises ValueError for the first entry that is not good; the message gives its index."""
    if not good.all():
        where = tuple(np.argwhere(~good)[0].tolist())
        index = where[0] if len(where) == 1 else where
        raise ValueError(f"{name} must {rule}, got {values[where]} at index {index}")


def numbers(
    name: str, value: Any, what: str, *, kinds: str = "iuf", longest: int = 1_000_000
) -> NDArray[Any]:
    """The value as a numpy array of any shape; an array is returned as it is, without a copy.

    Masked entries, booleans among numbers and more than `longest` entries are refused; infinite
    numbers and NaN are not.
    """

    def wrong() -> TypeError:
        return TypeError(f"{name} must be {what}{_plain(value)}, got {shown(value)}")

    if is_quantity(value):  # numpy would drop its unit
        raise wrong()
    masks = sys.modules.get("numpy.ma")  # loading it takes 8 ms, and without it no array is masked
    too_long = isinstance(value, range) and bool(value[longest:])
    try:  # a range, which takes no memory, may be endless
        listed = np.array(value if isinstance(value, list | tuple) else (), dtype=object)
        refused = (*NOT_NUMBERS, type(masks.masked)) if masks else NOT_NUMBERS
        if any(isinstance(part, refused) for part in listed.flat):
            raise TypeError  # numpy would convert them to numbers
        raw = np.asarray(None if too_long else value)
    except (ValueError, TypeError, OverflowError, MemoryError):  # lists that are uneven or endless
        raise wrong() from None
    if too_long or raw.size > longest:
        raise ValueError(f"{name} must have at most {longest} entries, got {shown(value)}")
    if masks and masks.is_masked(value):
        hidden = np.count_nonzero(masks.getmaskarray(value))
        raise ValueError(f"{name} must not be masked, got {hidden} masked of {raw.size} entries")
    if raw.dtype.kind == "O" and all(_is_real(part) for part in raw.flat):
        parts = [real(name, part) for part in raw.flat]  # fractions, whole numbers beyond 64 bits
        raw = np.array(parts, dtype=np.float64).reshape(raw.shape)
    if raw.dtype.kind not in kinds:
        raise wrong()
    return raw


def doubles(name: str, value: Any, what: str) -> Array:
    """Numbers of any shape, finite or not, as a contiguous float64 array, which the core needs."""
    raw = numbers(name, value, what, longest=LONGEST)
    with np.errstate(over="ignore"):  # longer floats may become infinite, which is refused later
        return np.asarray(raw, dtype=np.float64, order="C")


def _is_real(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, NOT_NUMBERS)
