# SPDX-License-Identifier: MIT
"""Results and models in files that outlive the program that wrote them.

A file is an .npz archive of numpy: one member for each array, and "header", a JSON text. That has
the version of the format and of the package, and the table of objects. An object is a class by the
name that `saved_as` gives it, with its fields, a model with its numbers, or an exception with its
arguments; objects refer to those before them by their places. Nothing in a file is ever run.

A file may be damaged or come from anywhere. So no more memory is taken than its size allows, each
array is read once, and numbers are checked as the constructors do, or against the types and shapes
that fields of results have.
"""

from __future__ import annotations

import builtins
import dataclasses
import inspect
import json
import math
import os
import re
import sys
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from pipedyn.util import check
from pipedyn.util.fields import check_shapes, check_signs, check_types
from pipedyn.util.files import replacing

FORMAT = 1
"""Version of the format; a file of a later one is refused."""

HEADER = ("format", "package", "root", "objects")
"""What a header has."""

DEFLATED = 1032
"""Bytes that a byte of a compressed member can stand for: a match of deflate, the longest of which
has 258 bytes, takes two bits."""

LARGEST_HEADER, HEADER_SHARE = 10_000_000, 30
"""Characters that a header may have, and how many more for each byte of the file. Those of scenes,
the longest, have 20 for each byte. A character takes up to 20 bytes of memory."""

DESCRIPTION = re.compile(
    r"\{'descr': '([<>|=][biufcU][1-9]\d*)', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d+, )*(?:\d+,?)?)\), \} *\n"
)
"""How `numpy.save` describes an array."""

TOO_MUCH = f"its objects are made of more than {check.LONGEST} numbers"
"""Why objects that share arrays, for each of which these are gone through, may be too many."""

FORMER_NAMES = {
    "accuracy.choose.Tried": "Tried",
    "accuracy.convergence.ConvergenceLaw": "ConvergenceLaw",
    "accuracy.quantities.CriticalSpeedOf": "CriticalSpeedOf",
    "accuracy.quantities.Frequencies": "Frequencies",
    "accuracy.quantities.LimitCycleAt": "LimitCycleAt",
    "accuracy.quantities.MotionOf": "MotionOf",
    "accuracy.quantities.RootLociOver": "RootLociOver",
    "accuracy.reference.Answer": "Answer",
    "bifurcation.collocation.OrbitControl": "OrbitControl",
    "bifurcation.collocation.OrbitProblem": "OrbitProblem",
    "bifurcation.continuation.Point": "PointOnBranch",
    "bifurcation.continuation.Segment": "StepAlongBranch",
    "bifurcation.follow.Branch": "Branch",
    "bifurcation.follow.MarkedPoint": "MarkedPoint",
    "bifurcation.forced_response.ForcedField": "ForcedField",
    "bifurcation.hopf.HopfPoint": "HopfPoint",
    "bifurcation.periodic_orbit.Closing": "Closing",
    "bifurcation.periodic_orbit.PeriodicOrbit": "PeriodicOrbit",
    "models.drive.DriveFailed": "DriveFailed",
    "models.profile._Series": "ChebyshevSeries",
    "modular.Assembly": "Assembly",
    "modular.Clamp": "Clamp",
    "modular.Custom": "Custom",
    "modular.Drag": "Drag",
    "modular.Guide": "Guide",
    "modular.InternalFlow": "InternalFlow",
    "modular.Joint": "Joint",
    "modular.Mechanism": "Mechanism",
    "modular.Pin": "Pin",
    "modular.Segment": "Segment",
    "modular.TorsionalSpring": "TorsionalSpring",
    "motion.integrator.Stopped": "Stopped",
    "util.counters.TookTooLong": "TookTooLong",
    "util.newton.NewtonFailed": "NewtonFailed",
}
"""Names that files have of before a class got another one; a name that is here stays for ever."""

Kind = TypeVar("Kind", bound=type)


@dataclasses.dataclass(frozen=True)
class _Entry:
    """What files know of a class, see `saved_as`."""

    kind: type
    name: str
    former: Mapping[str, str]
    added: Collection[str]
    shapes: Mapping[str, str]


_BY_NAME: dict[str, _Entry] = {}
_BY_CLASS: dict[type, _Entry] = {}


def saved_as(
    name: str,
    *,
    former: Mapping[str, str] | None = None,
    added: Collection[str] = (),
    shapes: Mapping[str, str] | None = None,
) -> Callable[[Kind], Kind]:
    """Gives a class its name in files, which stays when the class moves or is called otherwise.

    Classes whose objects files keep are dataclasses, named tuples, exceptions, or have a method
    `archived`, which gives their fields by name. A class method `restored` takes these, else the
    constructor does.

    Args:
        name: a word that no other class has; a new one needs the old one in `FORMER_NAMES`.
        former: of fields that were renamed, today's names by the former.
        added: fields that older files do not have, which get their default; others must be there.
        shapes: of arrays and tuples in fields, as for `check_shapes`.
    """

    def registered(kind: Kind) -> Kind:
        if name in _BY_NAME or name in FORMER_NAMES:
            raise ValueError(f"name must be that of one class alone, got {name!r} once more")
        _BY_NAME[name] = _BY_CLASS[kind] = _Entry(kind, name, former or {}, added, shapes or {})
        return kind

    return registered


def _entry(name: str, base: type) -> _Entry:
    """What files call so: a class that is a `base`, an object if neither an error nor a tuple."""
    found = _BY_NAME.get(FORMER_NAMES.get(name, name))
    if found is None:
        raise ValueError(f"it has a {check.shown(name)}, which this version does not know")
    others = {Exception, tuple} - {base}
    if not issubclass(found.kind, base) or issubclass(found.kind, tuple(others)):
        raise ValueError(f"it has a {name} where `save` does not write one")
    return found


class Saved:
    """What can be written to a file and loaded from it."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it to a file, from which `load` makes it again.

        Args:
            path: of the file, ending in .npz; an existing one is replaced once the new one is
                whole, and stays as it was if it cannot be written.

        Example:
            >>> pp.critical_speed(pp.Chain(pp.Pipe(0.2), 10)).save("critical.npz")
            >>> round(pp.load("critical.npz").speed, 4)
            5.4857

        Raises:
            ValueError: for what holds a Python function or an object of another package, of which
                the message says where it is (`to_csv` writes the table of a result that is one);
                for a path that does not end in .npz, or in a folder that is not there.
            OSError: where the file cannot be written.
        """
        save(self, path)


class _Writer:
    """Objects and arrays of one file."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self.arrays: dict[str, Any] = {}
        self._places: dict[int, int] = {}
        self._work = 0
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
        entry = _BY_CLASS.get(type(value))
        return {"tuple": parts} if entry is None else {"named": entry.name, "parts": parts}

    def _object(self, value: Any, where: str) -> dict[str, Any]:
        if isinstance(value, np.ndarray):
            if value.dtype.kind not in "biufcU":
                raise ValueError(f"{where} cannot be saved: it holds Python objects")
            member = f"array{len(self.arrays)}"
            self.arrays[member] = value
            return {"array": member}
        entry = _BY_CLASS.get(type(value))
        name = None if entry is None else entry.name
        if isinstance(value, Exception):
            args = value.args
            if name is None and getattr(builtins, type(value).__name__, None) is type(value):
                name = type(value).__name__
            elif name is None:
                name, args = "PipedynError", (f"{type(value).__name__}: {value}",)
            return {"error": name, "args": self.encoded(args, f"{where}.args")}
        if name is not None:
            kept = _fields(value)
            self._work += _work(type(value), kept)
            if self._work > check.LONGEST:
                raise ValueError(f"{where} cannot be saved: {TOO_MUCH}")
            fields = {field: self.encoded(one, f"{where}.{field}") for field, one in kept.items()}
            return {"parts" if hasattr(value, "archived") else "class": name, "fields": fields}
        kind = "a Python function" if callable(value) else f"a {type(value).__name__}"
        raise ValueError(f"{where} cannot be saved: it is {kind}")


def _work(kind: type, fields: Mapping[str, Any]) -> int:
    """How many numbers are gone through to make an object: none where it takes them as they are."""
    if not hasattr(kind, "restored") and not hasattr(kind, "archived"):
        return 0
    held = [
        part for one in fields.values() for part in (one, *getattr(one, "__dict__", {}).values())
    ]
    return sum(part.size for part in held if isinstance(part, np.ndarray))


def _fields(value: Any) -> dict[str, Any]:
    """What a file keeps of an object, by name."""
    if hasattr(value, "archived"):
        return dict(value.archived())
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


class _Members:
    """The arrays of a file, each of which is read once, and none before its size is judged.

    Args:
        archive: the open file.
        size: of the file, in bytes.
    """

    def __init__(self, archive: zipfile.ZipFile, size: int) -> None:
        self._archive = archive
        self._unread = {one.filename: one for one in archive.infolist()}
        if len(self._unread) < len(archive.infolist()):
            raise ValueError("two of its members have one name")
        if sum(one.compress_size for one in archive.infolist()) > size:
            raise ValueError("its members are longer than the file")
        if "header.npy" not in self._unread:
            raise zipfile.BadZipFile
        most = 4 * (LARGEST_HEADER + HEADER_SHARE * size)  # numpy takes four bytes a character
        if self._unread["header.npy"].file_size > most:
            raise ValueError(f"its header is longer than the {most} bytes that it may have")

    def array(self, name: str) -> np.ndarray[Any, Any]:
        """The array of a member, which is not read again."""
        entry = self._unread.pop(f"{name}.npy", None)
        if entry is None:
            raise ValueError(f"it has no array {check.shown(name)}, or more than once")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name} is compressed otherwise than `save` does")
        if entry.file_size > DEFLATED * entry.compress_size:
            raise ValueError(f"{name} is longer than what it is compressed to can be")
        with self._archive.open(entry) as file:
            start = file.read(10)
            text = file.read(int.from_bytes(start[8:], "little")).decode("latin-1")
            described = DESCRIPTION.fullmatch(text)
            if start[:8] != b"\x93NUMPY\x01\x00" or described is None:
                raise ValueError(f"{name} is described otherwise than `save` does")
            dtype = np.dtype(described[1])
            shape = tuple(int(size) for size in described[3].split(",") if size.strip())
            if math.prod(shape) > check.LONGEST:
                raise ValueError(f"{name} has more than {check.LONGEST} entries")
            length = math.prod(shape) * dtype.itemsize
            if len(start) + len(text) + length != entry.file_size:
                raise ValueError(f"{name} is not as long as its shape says")
            raw, filled = bytearray(length), 0
            while filled < length and (part := file.read(min(2**20, length - filled))):
                raw[filled : filled + len(part)] = part
                filled += len(part)
            if filled < length or file.read(1):  # which also compares checksums
                raise ValueError(f"{name} is not as long as it says")
        if dtype.kind == "b" and raw.strip(b"\x00\x01"):
            raise ValueError(f"{name} has what is neither true nor false")
        order: Any = "F" if described[2] == "True" else "C"
        values = np.ndarray(shape, dtype, raw, order=order)
        return values.astype(dtype.newbyteorder("="), copy=False)

    def require_read(self) -> None:
        """Raises ValueError where a member was not read."""
        if self._unread:
            raise ValueError(f"nothing has its member {check.shown(next(iter(self._unread)))}")


class _Reader:
    """The objects of one file."""

    def __init__(self, objects: Iterable[Any], arrays: Callable[[str], Any]) -> None:
        self._arrays = arrays
        self._work = 0
        self._made: list[Any] = []
        for one in objects:
            self._made.append(self._object(one))

    def decoded(self, value: Any) -> Any:
        """The value that JSON holds."""
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError("it has a number that overflows")
        if isinstance(value, list):
            return [self.decoded(one) for one in value]
        if not isinstance(value, dict):
            return value
        match list(value.items()):
            case [("object", int(place))] if place is not True and 0 <= place < len(self._made):
                return self._made[place]
            case [("number", "inf" | "-inf" | "nan" as text)]:
                return float(text)
            case [("complex", [real, imag])]:
                parts = self.decoded(real), self.decoded(imag)
                if all(isinstance(part, float) for part in parts):
                    return complex(*parts)
            case [("tuple", list(parts))]:
                return tuple(self.decoded(one) for one in parts)
            case [("named", str(name)), ("parts", list(parts))]:
                kind = _entry(name, tuple).kind
                made = kind(*(self.decoded(one) for one in parts))
                check_types(kind, made._asdict())
                return made
            case [("dict", list(pairs))]:
                found = {self.decoded(key): self.decoded(one) for key, one in pairs}
                if len(found) == len(pairs):
                    return found
        raise ValueError(f"it has {check.shown(value)}, which `save` does not write")

    def _object(self, value: Any) -> Any:
        match list(value.items()) if isinstance(value, dict) else value:
            case [("array", str(name))]:
                return self._arrays(name)
            case [("error", str(name)), ("args", args)]:
                given = self.decoded(args)
                if isinstance(given, tuple):
                    return self._error(name, given)
            case [("class" | "parts", str(name)), ("fields", dict(fields))]:
                entry = _entry(name, object)
                values = {entry.former.get(k, k): self.decoded(v) for k, v in fields.items()}
                self._work += _work(entry.kind, values)
                if self._work > check.LONGEST:
                    raise ValueError(TOO_MUCH)
                if len(values) == len(fields):
                    return _made(entry, values)
        raise ValueError(f"it has {check.shown(value)}, which `save` does not write")

    def _error(self, name: str, args: tuple[Any, ...]) -> Exception:
        kind = getattr(builtins, name, None)
        if not (isinstance(kind, type) and issubclass(kind, Exception)):
            kind = _entry(name, Exception).kind
            if "__init__" in vars(kind):
                check_types(kind, inspect.signature(kind).bind(*args).arguments)
        made = kind(*args)
        if len(made.args) != len(args):
            raise ValueError(f"{name} must have {len(made.args)} arguments, got {len(args)}")
        return made


def _made(entry: _Entry, values: dict[str, Any]) -> Any:
    """An object with these values of its fields, if these are what they can be."""
    check_types(entry.kind, values)
    check_signs(entry.kind, values)
    make = getattr(entry.kind, "restored", None)
    made = entry.kind(**values) if make is None else make(dict(values))
    lacking = [one for one in _fields(made) if one not in values and one not in entry.added]
    if lacking:
        raise ValueError(f"{lacking[0]} of {entry.name} is missing")
    check_shapes(entry.name, made, entry.shapes)
    return made


def save(thing: Any, path: str | os.PathLike[str]) -> None:
    """Writes a result, a model or a pipe to a file; see `Saved`."""
    place = _checked(path)
    if not place.parent.is_dir():
        raise ValueError(f"path must lie in a folder that exists, got {check.shown(str(place))}")
    writer = _Writer()
    try:
        root = writer.encoded(thing, type(thing).__name__)
    except RecursionError:
        raise ValueError(
            f"{type(thing).__name__} cannot be saved: it is nested too deeply"
        ) from None
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
    with replacing(place) as beside:
        with beside.open("wb") as file:
            np.savez_compressed(file, header=np.array(json.dumps(header)), **writer.arrays)
        try:
            with zipfile.ZipFile(beside) as archive:
                _Members(archive, beside.stat().st_size)
        except ValueError as error:  # it would not be loaded
            raise ValueError(f"{type(thing).__name__} cannot be saved: {error}") from None


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
        with place.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = _Members(archive, os.fstat(file.fileno()).st_size)
            header = _header(members.array("header"))
            thing = _Reader(header["objects"], members.array).decoded(header["root"])
            members.require_read()
        if not isinstance(thing, Saved):
            raise ValueError(f"it has no result, model or pipe, but {check.shown(thing)}")
        return thing
    except (zipfile.BadZipFile, EOFError) as error:
        raise ValueError(f"{place} cannot be loaded: it is no file of pipedyn") from error
    except OSError:
        raise
    except Exception as error:  # whatever it is, it is the file's fault
        said = str(error) or type(error).__name__
        said += " is missing" if isinstance(error, KeyError) else ""
        raise ValueError(f"{place} cannot be loaded: {said}") from error


def _header(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    """What the header says, if it has all that `save` writes, and nothing else."""
    if values.shape != () or values.dtype.kind != "U":
        raise ValueError("its header is no text")
    header = json.loads(str(values), object_pairs_hook=_without_repetition, parse_constant=_refused)
    lacking = [one for one in HEADER if not isinstance(header, dict) or one not in header]
    if lacking:
        raise ValueError(f"its header has no {lacking[0]!r}, which `save` writes")
    version = header["format"]
    if type(version) is not int or version < 1:
        raise ValueError(f"its format must be a whole number >= 1, got {check.shown(version)}")
    if version > FORMAT:
        raise ValueError(
            f"it was written by pipedyn {str(header['package'])[:20]}, this is "
            f"{sys.modules['pipedyn'].__version__}"
        )
    if len(header) > len(HEADER) or not isinstance(header["objects"], list):
        raise ValueError("its header is not as `save` writes it")
    return header


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("its header names something twice")
    return found


def _refused(constant: str) -> NoReturn:
    raise ValueError(f"its header has {constant}, which is no number of JSON")


def _checked(path: str | os.PathLike[str]) -> Path:
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a path, got {check.shown(path)}")
    place = Path(path)
    if place.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {check.shown(str(place))}")
    return place
