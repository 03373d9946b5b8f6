# SPDX-License-Identifier: MIT
"""Checks that the values of fields have the types and shapes that their class states."""

from __future__ import annotations

import dataclasses
import re
import types
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from pipedyn.util import check

LARGEST_WHOLE = 2**63
"""Whole numbers in fields are smaller than this in magnitude, so that 64 bits hold them."""

SIZES = ("coordinates", "dof", "integrated")
"""Words in shapes that stand for attributes of the field `model`, if the model has them."""

TERM = re.compile(r"(\d*)([A-Za-z]*)([+-]\d+)?")
"""Pattern of a size in a shape: a number, or a word, which may have a factor and a number added."""


def check_types(kind: type, values: Mapping[str, Any]) -> None:
    """Raises TypeError for a value that does not have the annotated type of its field.

    Args:
        kind: a class; if it has no fields, the arguments of its constructor count as fields.
        values: values of some or all fields, by name.
    """
    for name, hint in _hints(kind).items():
        if name in values and not fits(values[name], hint):
            said = hint.__name__ if isinstance(hint, type) else str(hint)
            if get_origin(hint) is Literal:
                said = f"one of {', '.join(map(repr, get_args(hint)))}"
            raise TypeError(
                f"{name} of {kind.__name__} must be {said}, got {check.shown(values[name])}"
            )


@cache
def _hints(kind: Any) -> dict[str, Any]:
    has_fields = dataclasses.is_dataclass(kind) or hasattr(kind, "_fields")
    return get_type_hints(kind if has_fields else kind.__init__)


def fits(value: Any, hint: Any) -> bool:
    """Whether a value has an annotated type; True for annotations that cannot be checked."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(fits(value, part) for part in parts)
    if origin is Literal:
        return value in parts
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        each = parts[:1] * len(value) if parts[1:] == (...,) else parts
        return len(value) == len(each) and all(map(fits, value, each))
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and _holds(value.dtype, *get_args(parts[1]))
    if origin is Callable:
        return callable(value)
    kind = origin or hint
    if kind in (bool, int, float, complex):
        return _is_number(value, kind)
    said = isinstance(kind, type) and kind is not Any and not getattr(kind, "_is_protocol", False)
    return isinstance(value, kind) if said else True


def _is_number(value: Any, kind: type) -> bool:
    """Whether a value is a number of a kind; int counts as float, and float as complex."""
    if isinstance(value, bool) or kind is bool:
        return kind is bool and isinstance(value, bool)
    if isinstance(value, int):
        return abs(value) < LARGEST_WHOLE
    return isinstance(value, kind) or (kind is complex and isinstance(value, float))


def _holds(dtype: np.dtype[Any], scalar: Any) -> bool:
    """Whether entries of an array have a scalar type; integers may have any number of bits."""
    if scalar is Any:
        return dtype.kind in "biufc"
    wanted = np.dtype(scalar)
    return dtype.kind == wanted.kind and (dtype.kind not in "fc" or dtype == wanted)


def check_shapes(name: str, thing: Any, shapes: Mapping[str, str]) -> None:
    """Raises ValueError if the sizes of arrays or tuples do not agree with their shapes.

    Args:
        name: name of the object in the error message.
        thing: the object that has the fields.
        shapes: names of fields by their shape, both separated by spaces. A name may refer to an
            attribute of a field, as "orbit.starts" does. A shape consists of sizes. Each is a
            number or a word, and a word has the same value in all shapes; "2S" is twice S, and
            "S+1" is S plus one. Fields that are None or a number are not checked.
    """
    model = getattr(thing, "model", None)
    known = {size: getattr(model, size) for size in SIZES if hasattr(model, size)}
    for shape, names in shapes.items():
        wanted = shape.split()
        for field in names.split():
            value = thing
            for part in field.split("."):
                value = getattr(value, part, None)
            if value is None or isinstance(value, int | float):
                continue
            sizes = value.shape if isinstance(value, np.ndarray) else (len(value),)
            if len(sizes) != len(wanted) or not all(
                _is_term(size, term, known) for size, term in zip(sizes, wanted, strict=True)
            ):
                shown = f"({', '.join(wanted)})"
                raise ValueError(f"{field} of {name} must have shape {shown}, got {sizes}")


def _is_term(size: int, term: str, known: dict[str, int]) -> bool:
    """Whether a size fits a term of a shape; a word that is not in `known` gets a value there."""
    found = TERM.fullmatch(term)
    assert found, term
    times, word, more = found.groups()
    if not word:
        return size == int(times)
    value, left = divmod(size - int(more or 0), int(times or 1))
    return left == 0 and known.setdefault(word, value) == value
