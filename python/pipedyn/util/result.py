# SPDX-License-Identifier: MIT
"""Result classes: frozen dataclasses that `==` and `hash` take though they hold arrays.

A plain dataclass compares tuples of its fields, and Python refuses the truth of an array.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, dataclass_transform

import numpy as np

Class = TypeVar("Class")


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
def result(cls: type[Class]) -> type[Class]:
    """Decorates a class like `dataclass(frozen=True)`; results of equal numbers are equal.

    NaN equals NaN, as what is missing in both; fields with compare=False do not count.
    """
    made = dataclasses.dataclass(frozen=True, eq=False)(cls)
    for name, method in (("__eq__", _equal), ("__hash__", _hash)):
        setattr(made, name, method)
    return made


def _compared(one: Any) -> list[Any]:
    return [getattr(one, field.name) for field in dataclasses.fields(one) if field.compare]


def _equal(one: Any, other: object) -> Any:
    if type(one) is not type(other):
        return NotImplemented
    return one is other or same(_compared(one), _compared(other))


def _hash(one: Any) -> int:
    """From the numbers, but NaN, and the words in a result, which equal results share."""
    kinds = (str, int, float, complex)
    return hash((type(one), *(v for v in _compared(one) if isinstance(v, kinds) and v == v)))


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal: numbers and arrays by entries, what pickles by its state."""
    if one is other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        inexact = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return np.array_equal(one, other, equal_nan=inexact)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, float | complex | np.inexact):
        return bool(one == other or (one != one and other != other))
    if isinstance(one, BaseException):
        return same(one.args, other.args)
    if dataclasses.is_dataclass(one):
        return same(_compared(one), _compared(other))
    if getattr(type(one), "__eq__", None) is object.__eq__ and not callable(one):
        return same(one.__getstate__(), other.__getstate__())
    return bool(one == other)
