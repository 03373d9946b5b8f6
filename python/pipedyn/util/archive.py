# SPDX-License-Identifier: MIT
"""Results and models in files that later versions of the package can read.

A file is an .npz archive of numpy: one member for each array, and "header", a JSON text. The header
holds the versions of the format and of the package, and a table of objects. Each object is stored
as its fields and the name that `saved_as` gave to its class; a model is stored as its numbers, an
exception as its arguments. Objects refer to earlier ones by their index in the table. Nothing in a
file is ever run as code.

A file may be damaged or come from anywhere. Loading it therefore takes no more memory than its size
allows and reads each array once. Constructors check the numbers; fields of results are checked
against their types.
"""

from __future__ import annotations

import builtins
import dataclasses
import inspect
import json
import math
import os
import sys
import types
import zipfile
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import (
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    overload,
)

import numpy as np
from numpy.lib import format as npy

from pipedyn.util import check
from pipedyn.util.files import replacing

FORMAT = 1
"""Version of the format; a file with a later version is refused."""

HEADER = ("format", "package", "root", "objects")
"""Keys of a header."""

DTYPE_KINDS = "biufcU"
"""Kinds of numbers and texts that arrays in files hold, as numpy names them."""

DEFLATED = 1032
"""Largest ratio of a member's size to its compressed size: deflate encodes a match, which has at
most 258 bytes, in no less than two bits."""

LARGEST_HEADER, HEADER_SHARE = 10_000_000, 30
"""Largest length of a header in characters: LARGEST_HEADER, plus HEADER_SHARE for each byte of the
file. Scenes have the longest headers, 20 characters for each byte of the file. A character takes up
to 20 bytes of memory."""

TOO_MUCH = f"its objects are made of more than {check.LONGEST} numbers"
"""Reason to refuse a file. Many objects may share one array, and each object reads its entries, so
a small file could take forever to load."""

FORMER_NAMES = {
    "bifurcation.continuation.Point": "PointOnBranch",
    "bifurcation.continuation.Segment": "StepAlongBranch",
    "models.profile._Series": "ChebyshevSeries",
    "modular.Mechanism": "PipedynError",
}
"""Present names of classes that had another name in older files. Older files may also have the path
of a module before the name of a class. An entry of this table is never removed."""

Kind = TypeVar("Kind", bound=type)
Thing = TypeVar("Thing")


@dataclasses.dataclass(frozen=True)
class _Entry:
    """A class that files can hold, with the arguments that `saved_as` got for it."""

    kind: type
    name: str
    former: Mapping[str, str]
    added: Collection[str]

    def field(self, name: str) -> str:
        """Present name of a field; names of models' fields began with _ in older files."""
        plain = name if dataclasses.is_dataclass(self.kind) else name.removeprefix("_")
        return self.former.get(plain, plain)


_BY_NAME: dict[str, _Entry] = {}
_BY_CLASS: dict[type, _Entry] = {}


def saved_as(
    name: str,
    *,
    former: Mapping[str, str] | None = None,
    added: Collection[str] = (),
) -> Callable[[Kind], Kind]:
    """Gives a class its name in files, which stays the same when the class moves or is renamed.

    The class must be a dataclass, a named tuple or an exception, or have a method `archived` that
    returns its fields by name. A class method `restored` makes an object from these fields; if
    there is none, the constructor does.

    Args:
        name: a word that no other class has; if it changes, `FORMER_NAMES` must list the old one.
        former: present names of renamed fields, by their former names.
        added: fields that older files may lack, which then get their default; files must have all
            other fields.
    """

    def registered(kind: Kind) -> Kind:
        of = _BY_NAME[name].kind if name in _BY_NAME else kind
        # An import that was interrupted runs a module again, with the same classes.
        same_place = (of.__module__, of.__qualname__) == (kind.__module__, kind.__qualname__)
        if not same_place or name in FORMER_NAMES:
            raise ValueError(f"name must be that of one class alone, got {name!r} once more")
        _BY_NAME[name] = _BY_CLASS[kind] = _Entry(kind, name, former or {}, added)
        return kind

    return registered


def todays_name(name: str) -> str:
    """The name that a class has in new files, by its name in a file of any version."""
    return FORMER_NAMES.get(name, name.rpartition(".")[2])


def _entry(name: str, base: type) -> _Entry:
    """The class that a file names, refused if it is no subclass of `base`.

    Exceptions are accepted only if `base` is Exception, and named tuples only if it is tuple.
    """
    today = todays_name(name)
    if today not in _BY_NAME:
        package = sys.modules["pipedyn"]
        classes = [one for one in package.__all__ if one[0].isupper()]
        for public in sorted(classes, key=lambda one: one != today):
            getattr(package, public)  # imports its module, which registers the classes in it
            if today in _BY_NAME:
                break
    found = _BY_NAME.get(today)
    if found is None:
        raise ValueError(f"it has a {check.shown(name)}, which this version does not know")
    others = {Exception, tuple} - {base}
    if not issubclass(found.kind, base) or issubclass(found.kind, tuple(others)):
        raise ValueError(f"it has a {name} where `save` does not write one")
    return found


class Saved:
    """Base class of results, models and pipes, which can be written to files."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the object to a file, from which `load` restores it.

        Args:
            path: path of the file, ending in .npz. An existing file is replaced once the new one is
                complete, and stays as it was if the new one cannot be written.

        Example:
            >>> pp.critical_speed(pp.Chain(pp.Pipe(0.2), 10)).save("critical.npz")
            >>> round(pp.load("critical.npz").speed, 4)
            5.4857

        Raises:
            ValueError: if the object holds a Python function or an object of another package; the
                message says where (`to_csv` can still write the table of a `TableResult`). Also if
                the path does not end in .npz, or its folder does not exist.
            OSError: if the file cannot be written.
        """
        place = _checked(path)
        if not place.parent.is_dir():
            given = check.shown(str(place))
            raise ValueError(f"path must lie in a folder that exists, got {given}")
        writer, name = _Writer(), type(self).__name__
        try:
            root = writer.encoded(self, name)
        except RecursionError:
            raise ValueError(f"{name} cannot be saved: it is nested too deeply") from None
        except ValueError as error:
            if hasattr(self, "to_csv"):
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
            except ValueError as error:  # `load` would refuse the new file
                raise ValueError(f"{name} cannot be saved: {error}") from None


class _Writer:
    """Collects the objects and arrays of one file before it is written."""

    def __init__(self) -> None:
        self.objects: list[Any] = []
        self.arrays: dict[str, Any] = {}
        self._read = 0  # entries of arrays that are read when the file is loaded
        # Places of objects by their ids; objects stay alive, so that no other one gets the same id.
        self._places: dict[int, tuple[int, Any]] = {}

    def encoded(self, value: Any, where: str) -> Any:
        """The JSON form of a value; `where` says in errors which value cannot be saved."""
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, bool | int | str):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else {"number": repr(value)}
        if isinstance(value, complex):
            return {"complex": [self.encoded(x, where) for x in (value.real, value.imag)]}
        if isinstance(value, list | tuple):
            parts = [self.encoded(one, f"{where}[{i}]") for i, one in enumerate(value)]
            if isinstance(value, list):
                return parts
            entry = _BY_CLASS.get(type(value))
            return {"tuple": parts} if entry is None else {"named": entry.name, "parts": parts}
        if isinstance(value, dict):
            pairs = [
                [self.encoded(key, where), self.encoded(one, f"{where}[{key!r}]")]
                for key, one in value.items()
            ]
            return {"dict": pairs}
        if id(value) not in self._places:
            made = self._object(value, where)
            self._places[id(value)] = len(self.objects), value
            self.objects.append(made)
        if isinstance(value, np.ndarray):
            self._read += value.size
            if self._read > check.LONGEST:
                raise ValueError(f"{where} cannot be saved: {TOO_MUCH}")
        return {"object": self._places[id(value)][0]}

    def _object(self, value: Any, where: str) -> dict[str, Any]:
        if isinstance(value, np.ndarray):
            if value.dtype.kind not in DTYPE_KINDS:
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
            fields = {k: self.encoded(v, f"{where}.{k}") for k, v in _fields(value).items()}
            return {"class": name, "fields": fields}
        kind = "a Python function" if callable(value) else f"a {type(value).__name__}"
        raise ValueError(f"{where} cannot be saved: it is {kind}")


def _fields(value: Any) -> dict[str, Any]:
    """Fields of an object that a file stores, by name."""
    if hasattr(value, "archived"):
        return dict(value.archived())
    return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}


class _Members:
    """The arrays of a file; each can be read once, after its size has been checked.

    Args:
        archive: the open file.
        size: size of the file in bytes.
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
        most = 4 * (LARGEST_HEADER + HEADER_SHARE * size)  # numpy has four bytes a character
        if self._unread["header.npy"].file_size > most:
            raise ValueError(f"its header is longer than the {most} bytes that it may have")

    def array(self, name: str) -> np.ndarray[Any, Any]:
        """Reads the array of a member, which cannot be read again."""
        entry = self._unread.pop(f"{name}.npy", None)
        if entry is None:
            raise ValueError(f"it has no array {check.shown(name)}, or more than once")
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name} is compressed otherwise than `save` does")
        if entry.file_size > DEFLATED * entry.compress_size:
            raise ValueError(f"{name} is longer than what it is compressed to can be")
        with self._archive.open(entry) as member:
            described = npy.read_magic(member) == (1, 0)
            shape, _, dtype = npy.read_array_header_1_0(member)
            if not described or dtype.kind not in DTYPE_KINDS or min(shape, default=0) < 0:
                raise ValueError(f"{name} is described otherwise than `save` does")
            if math.prod(shape) > check.LONGEST:
                raise ValueError(f"{name} has more than {check.LONGEST} entries")
            if member.tell() + math.prod(shape) * dtype.itemsize != entry.file_size:
                raise ValueError(f"{name} is not as long as its shape says")
            member.seek(0)
            values = npy.read_array(member, allow_pickle=False)
            member.read()  # at its end zipfile checks the checksum
        return values.astype(dtype.newbyteorder("="), copy=False)

    def require_read(self) -> None:
        """Raises ValueError if a member of the file was not read."""
        if self._unread:
            raise ValueError(f"nothing has its member {check.shown(next(iter(self._unread)))}")


class _Reader:
    """Restores the objects of one file in the order of its table."""

    def __init__(self, objects: Iterable[Any], arrays: Callable[[str], Any]) -> None:
        self._arrays = arrays
        self._read = 0  # entries of arrays that objects have read so far
        self._made: list[Any] = []
        for one in objects:
            self._made.append(self._object(one))

    def decoded(self, value: Any) -> Any:
        """The value whose JSON form, as `_Writer.encoded` makes it, is given."""
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"its header has the number {value}, which is not finite")
        if isinstance(value, list):
            return [self.decoded(one) for one in value]
        if not isinstance(value, dict):
            return value
        match list(value.items()):
            case [("object", int(place))] if place is not True and 0 <= place < len(self._made):
                made = self._made[place]
                self._read += made.size if isinstance(made, np.ndarray) else 0
                if self._read > check.LONGEST:
                    raise ValueError(TOO_MUCH)
                return made
            case [("number", "inf" | "-inf" | "nan" as text)]:
                return float(text)
            case [("complex", [real, imag])]:
                return complex(self.decoded(real), self.decoded(imag))
            case [("tuple", list(parts))]:
                return tuple(self.decoded(one) for one in parts)
            case [("named", str(name)), ("parts", list(parts))]:
                kind = _entry(name, tuple).kind
                made = kind(*(self.decoded(one) for one in parts))
                check_types(kind, made._asdict())
                return made
            case [("dict", list(pairs))]:
                return {self.decoded(key): self.decoded(one) for key, one in pairs}
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
                values = {entry.field(k): self.decoded(v) for k, v in fields.items()}
                if len(values) == len(fields):
                    return _rebuild(entry, values)
        raise ValueError(f"it has {check.shown(value)}, which `save` does not write")

    def _error(self, name: str, args: tuple[Any, ...]) -> Exception:
        kind = getattr(builtins, name, None)
        if not (isinstance(kind, type) and issubclass(kind, Exception)):
            kind = _entry(name, Exception).kind
            if "__init__" in vars(kind):
                check_types(kind, inspect.signature(kind).bind(*args).arguments)
        return kind(*args)


def _rebuild(entry: _Entry, values: dict[str, Any]) -> Any:
    """An object with the given values of its fields, whose types are checked."""
    check_types(entry.kind, values)
    make = getattr(entry.kind, "restored", None)
    made = entry.kind(**values) if make is None else make(dict(values))
    lacking = [one for one in _fields(made) if one not in values and one not in entry.added]
    if lacking:
        raise ValueError(f"{lacking[0]} of {entry.name} is missing")
    return made


@overload
def load(path: str | os.PathLike[str]) -> Any: ...


@overload
def load(path: str | os.PathLike[str], kind: type[Thing]) -> Thing: ...


def load(path: str | os.PathLike[str], kind: type[Any] = object) -> Any:
    """Loads a result, a model or a pipe from a file that its method `save` wrote.

    A loaded result or pipe equals the saved one. A loaded model has the same numbers and gives the
    same answers as the saved one, but two models compare equal only if they are the same object.

    Args:
        path: path of the file.
        kind: class of the object that the file must hold, which type checkers then know; any class
            if not given.

    Returns:
        The result, model or pipe.

    Example:
        >>> pp.Pipe(0.2, 10.0).save("pipe.npz")
        >>> pp.load("pipe.npz", pp.Pipe)
        Pipe(beta=0.2, gamma=10)

    Raises:
        TypeError: if the file holds something of another kind.
        ValueError: if the file was not written by `save`, or was written by a later version.
        OSError: if the file cannot be read.
    """
    place = _checked(path)
    check.instance("kind", kind, type, "a class")
    try:
        with place.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = _Members(archive, os.fstat(file.fileno()).st_size)
            header = _header(members.array("header"))
            thing = _Reader(header["objects"], members.array).decoded(header["root"])
            members.require_read()
        if not isinstance(thing, Saved):
            raise ValueError(f"it has no result, model or pipe, but {check.shown(thing)}")
    except (zipfile.BadZipFile, EOFError) as error:
        raise ValueError(f"{place} cannot be loaded: it is no file of pipedyn") from error
    except OSError:
        raise
    except Exception as error:  # any other failure is caused by a damaged or foreign file
        said = str(error) or type(error).__name__
        said += " is missing" if isinstance(error, KeyError) else ""
        raise ValueError(f"{place} cannot be loaded: {said}") from error
    if not isinstance(thing, kind):
        raise TypeError(f"{place} holds a {type(thing).__name__}, not a {kind.__name__}")
    return thing


def _header(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    """The header by its keys, refused if one lacks or if a later version of the format wrote it."""
    if values.shape != () or values.dtype.kind != "U":
        raise ValueError("its header is no text")
    try:
        header = json.loads(str(values), object_pairs_hook=_named_once)
    except json.JSONDecodeError as error:
        raise ValueError(f"its header is no JSON: {error}") from error
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
    return header


def _named_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of the header, refused if it names something twice."""
    if len(found := dict(pairs)) < len(pairs):
        raise ValueError("its header names something twice")
    return found


def _checked(path: str | os.PathLike[str]) -> Path:
    check.instance("path", path, str | os.PathLike, "a path")
    place = Path(path)
    if place.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {check.shown(str(place))}")
    return place


LARGEST_WHOLE = 2**63
"""Whole numbers in fields are smaller than this in magnitude, so that 64 bits hold them."""


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
