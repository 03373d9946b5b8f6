# SPDX-License-Identifier: MIT
"""Results and models in files that outlive the program that wrote them.

A file is an .npz archive of numpy: one member for each array, and "header", a JSON text. That has
the version of the format and of the package, and the table of objects. An object is a class by its
public name with its fields, a model with its numbers, or an exception with its arguments; objects
refer to one another by their places. Nothing in a file is ever run.
"""

from __future__ import annotations

import builtins
import dataclasses
import json
import math
import os
import sys
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from pipedyn.util import check

FORMAT = 1
"""Version of the format; a file of a later one is refused."""

HEADER = ("format", "package", "root", "objects")
"""What a header has."""


class _Writer:
    """Objects and arrays of one file."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self.arrays: dict[str, Any] = {}
        self._places: dict[int, int] = {}
        self._kept: list[Any] = []  # so that no other object takes the place of one in memory

    def encoded(self, value: Any, where: str) -> Any:
        """What JSON holds of a value, whose place is told if it cannot be saved."""
        if value is None or isinstance(value, bool | str):
            return value
        if isinstance(value, np.generic):
            return self.encoded(value.item(), where)
        if isinstance(value, int):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else {"number": repr(value)}
        if isinstance(value, complex):
            return {"complex": [self.encoded(x, where) for x in (value.real, value.imag)]}
        if isinstance(value, list):
            return [self.encoded(one, f"{where}[{i}]") for i, one in enumerate(value)]
        if isinstance(value, tuple):
            return self._tuple(value, where)
        if isinstance(value, dict):
            pairs = [
                [self.encoded(key, where), self.encoded(one, f"{where}[{key!r}]")]
                for key, one in value.items()
            ]
            return {"dict": pairs}
        if id(value) not in self._places:
            made = self._object(value, where)
            self._places[id(value)] = len(self.objects)
            self.objects.append(made)
            self._kept.append(value)
        return {"object": self._places[id(value)]}

    def _tuple(self, value: tuple[Any, ...], where: str) -> dict[str, Any]:
        parts = [self.encoded(one, f"{where}[{i}]") for i, one in enumerate(value)]
        if type(value) in _names():
            return {"named": _names()[type(value)], "parts": parts}
        return {"tuple": parts}

    def _object(self, value: Any, where: str) -> dict[str, Any]:
        if isinstance(value, np.ndarray):
            if value.dtype.kind not in "biufcU":
                raise ValueError(f"{where} cannot be saved: it holds Python objects")
            member = f"array{len(self.arrays)}"
            self.arrays[member] = value
            return {"array": member}
        name: str | None = _names().get(type(value))
        if isinstance(value, BaseException):
            args = value.args
            if name is None and getattr(builtins, type(value).__name__, None) is type(value):
                name = type(value).__name__
            elif name is None:
                name, args = "PipedynError", (f"{type(value).__name__}: {value}",)
            return {"error": name, "args": self.encoded(args, f"{where}.args")}
        if name is not None and hasattr(value, "archived"):
            return {"parts": name, "fields": self._each(value.archived(), where)}
        if name is not None and dataclasses.is_dataclass(value):
            fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init}
            return {"class": name, "fields": self._each(fields, where)}
        kind = "a Python function" if callable(value) else f"a {type(value).__name__}"
        raise ValueError(f"{where} cannot be saved: it is {kind}")

    def _each(self, fields: dict[str, Any], where: str) -> dict[str, Any]:
        return {name: self.encoded(one, f"{where}.{name}") for name, one in fields.items()}


class _Reader:
    """The objects of one file."""

    def __init__(self, objects: list[Any], arrays: Callable[[str], Any]) -> None:
        self._arrays = arrays
        self._made: list[Any] = []
        for one in objects:
            self._made.append(self._object(one))

    def decoded(self, value: Any) -> Any:
        """The value that JSON holds."""
        if isinstance(value, list):
            return [self.decoded(one) for one in value]
        if not isinstance(value, dict):
            return value
        if "object" in value:
            return self._made[value["object"]]
        if "number" in value:
            return float(value["number"])
        if "complex" in value:
            return complex(*(self.decoded(x) for x in value["complex"]))
        if "tuple" in value:
            return tuple(self.decoded(one) for one in value["tuple"])
        if "named" in value:
            return _class(value["named"])(*(self.decoded(one) for one in value["parts"]))
        return {self.decoded(key): self.decoded(one) for key, one in value["dict"]}

    def _object(self, value: dict[str, Any]) -> Any:
        if "array" in value:
            return self._arrays(value["array"])
        if "error" in value:
            kind = _class(value["error"], builtins)
            if not issubclass(kind, BaseException):
                raise ValueError(f"{value['error']} is no exception")
            return kind(*self.decoded(value["args"]))
        fields = {name: self.decoded(one) for name, one in value["fields"].items()}
        if "parts" in value:
            return _class(value["parts"]).restored(fields)
        return _class(value["class"])(**fields)


@cache
def _names() -> dict[type, str]:
    """The package's classes by the names in files: public ones have their public name."""
    package = sys.modules["pipedyn"]
    found = dict[type, str]()
    for name, module in list(sys.modules.items()):
        if name.startswith("pipedyn.") and "._core" not in name:
            own = (one for one in vars(module).values() if isinstance(one, type))
            short = name.removeprefix("pipedyn.")
            found |= {one: f"{short}.{one.__name__}" for one in own if one.__module__ == name}
    for prefix, public in (("modular.", package.modular), ("", package)):
        found |= {
            getattr(public, name): prefix + name
            for name in public.__all__
            if isinstance(getattr(public, name), type)
        }
    return found


@cache
def _classes() -> dict[str, type]:
    return {name: one for one, name in _names().items()}


def _class(name: str, other: Any = None) -> Any:
    found = _classes().get(name) or getattr(other, name, None)
    if not isinstance(found, type):
        raise ValueError(f"it has a {name}, which this version does not know")
    return found


def save(thing: Any, path: str | os.PathLike[str]) -> None:
    """Writes a result, a model or a pipe to a file; see `result.Saved`."""
    place = _checked(path)
    if not place.parent.is_dir():
        raise ValueError(f"path must lie in a folder that exists, got {check.shown(str(place))}")
    writer = _Writer()
    try:
        root = writer.encoded(thing, type(thing).__name__)
    except ValueError as error:
        if hasattr(thing, "to_csv"):
            raise ValueError(f"{error}; to_csv or to_dataframe writes its table") from None
        raise
    header = {
        "format": FORMAT,
        "package": sys.modules["pipedyn"].__version__,
        "root": root,
        "objects": writer.objects,
    }
    partial = place.with_name(place.name + ".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, header=np.array(json.dumps(header)), **writer.arrays)
    partial.replace(place)


def load(path: str | os.PathLike[str]) -> Any:
    """What `save` of a result, a model or a pipe wrote.

    A result or a pipe is equal to what was saved. A model has its numbers and answers as it does,
    but models are equal only if they are one object.

    Args:
        path: of the file.

    Returns:
        The result, model or pipe.

    Example:
        >>> pp.Pipe(0.2, 10.0).save("pipe.npz")
        >>> pp.load("pipe.npz")
        Pipe(beta=0.2, gamma=10)

    Raises:
        ValueError: for a file that `save` did not write, or a later version of the package.
        OSError: where the file cannot be read.
    """
    place = _checked(path)
    try:
        with zipfile.ZipFile(place) as members:
            if "header.npy" not in members.namelist():
                raise zipfile.BadZipFile
        with np.load(place, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            lacking = [one for one in HEADER if not isinstance(header, dict) or one not in header]
            if lacking:
                raise ValueError(f"its header has no {lacking[0]!r}, which `save` writes")
            if header["format"] > FORMAT:
                raise ValueError(
                    f"it was written by pipedyn {header['package']}, this is "
                    f"{sys.modules['pipedyn'].__version__}"
                )
            reader = _Reader(header["objects"], file.__getitem__)
            return reader.decoded(header["root"])
    except (zipfile.BadZipFile, EOFError) as error:
        raise ValueError(f"{place} cannot be loaded: it is no file of pipedyn") from error
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ValueError(f"{place} cannot be loaded: {error}") from error


def _checked(path: str | os.PathLike[str]) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a path, got {check.shown(path)}")
    place = Path(path)
    if place.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {check.shown(str(place))}")
    return place
