# SPDX-License-Identifier: MIT
"""Base classes of results: frozen dataclasses with comparison, repr, files, tables and SI units."""

from __future__ import annotations

import csv
import dataclasses
import html
import inspect
import io
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import (
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
    cast,
    dataclass_transform,
    overload,
)

import numpy as np

from pipedyn.util import check
from pipedyn.util.archive import Saved
from pipedyn.util.files import replacing


class Unit(NamedTuple):
    """An SI unit and a function that gives the value of a nondimensional 1 from `Scales`."""

    name: str
    scale: Callable[[Any], Any]


SPEED = Unit("m/s", lambda scales: scales.speed)
FREQUENCY = Unit("Hz", lambda scales: 1.0 / (2.0 * math.pi * scales.time))
"""Unit of angular frequencies, which are shown as frequencies in Hz."""
TIME = Unit("s", lambda scales: scales.time)
RATE = Unit("1/s", lambda scales: 1.0 / scales.time)
LENGTH = Unit("m", lambda scales: scales.length)
VELOCITY = Unit("m/s", lambda scales: scales.length / scales.time)
"""Unit of velocities of points of the pipe; the unit of flow speeds is `SPEED`."""
POWER = Unit("W", lambda scales: scales.mass * scales.length**3 / scales.time**3)
ENERGY = Unit("J", lambda scales: scales.mass * scales.length**3 / scales.time**2)
CURVATURE = Unit("1/m", lambda scales: 1.0 / scales.length)

UNIT_OF: MappingProxyType[str, Unit] = MappingProxyType(
    {
        **dict.fromkeys(("speed", "speeds", "flow_speed", "u"), SPEED),
        **dict.fromkeys(("frequency", "frequencies", "threshold_frequency"), FREQUENCY),
        **dict.fromkeys(("t", "period", "duration"), TIME),
        **dict.fromkeys(("eigenvalue", "eigenvalues", "partners", "poles"), RATE),
        **dict.fromkeys(("growth_rate", "qdot"), RATE),
        **dict.fromkeys(
            ("tip", "tips", "amplitude", "amplitude_across", "amplitudes", "highest"), LENGTH
        ),
        "energy": ENERGY,
        "tip_velocity": VELOCITY,
        "curvature": CURVATURE,
    }
)
"""Units of numbers and arrays in results and of columns of tables, by name. A class of results may
state other units."""


class OfTube(NamedTuple):
    """A quantity in SI that follows from a number of a result, if the pipe is a tube."""

    name: str
    unit: Unit
    source: Unit  # unit of the numbers that it follows from
    sources: tuple[str, ...]  # their names; the first that the result has counts

    def column(self, name: str, unit: Unit | None, scales: Any) -> dict[str, Any]:
        """Heading of a column beside that with a name and unit, and its factor; none if unknown."""
        if name not in self.sources or unit is not self.source or not self.is_known(scales):
            return {}
        return {f"{self.name.removesuffix('_l_min')} ({self.unit.name})": self.unit.scale(scales)}

    def is_known(self, scales: Any) -> bool:
        """Whether scales, of one pipe or of each row, have the tube's numbers."""
        return scales is not None and bool(np.isfinite(self.unit.scale(scales)).any())


_FLOW_RATE = Unit("m3/s", lambda scales: scales.flow_rate)
_LITRES = Unit("l/min", lambda scales: 6e4 * scales.flow_rate)
_ONE, _SEVERAL = ("flow_speed", "speed", "u"), ("speeds",)

OF_TUBES = (
    OfTube("flow_rate", _FLOW_RATE, SPEED, _ONE),
    OfTube("flow_rate_l_min", _LITRES, SPEED, _ONE),
    OfTube("flow_rates", _FLOW_RATE, SPEED, _SEVERAL),
    OfTube("flow_rates_l_min", _LITRES, SPEED, _SEVERAL),
    OfTube("wall_stress", Unit("Pa", lambda scales: scales.wall_stress), CURVATURE, ("curvature",)),
)

OF_PHASES = {"phase_speeds": "m/s", "phase_flow_rates": "m3/s"}
"""SI units of what follows from a flow speed for each phase of a mixture, in the last axis."""


def speed_in_si(u: float, scales: Any, digits: int) -> str:
    """A flow speed in m/s, and of a tube in l/min, as text in brackets; empty without scales."""
    units = (SPEED, _LITRES) if scales is not None else ()
    known = [unit for unit in units if math.isfinite(unit.scale(scales))]
    shown = ", ".join(f"{u * unit.scale(scales):.{digits}g} {unit.name}" for unit in known)
    return f" ({shown})" if shown else ""


@dataclass(frozen=True)
class Table:
    """A table with a title, and notes below; `numbers` aligns all columns but the first right."""

    title: str
    headings: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    numbers: bool = False
    notes: Sequence[str] = ()

    def text(self) -> str:
        """The table as lines of text for a terminal."""
        widths = [max(map(len, column)) for column in zip(self.headings, *self.rows, strict=True)]
        set_flush = str.rjust if self.numbers else str.ljust
        lines = []
        for cells in (self.headings, *self.rows):
            others = map(set_flush, cells[1:], widths[1:])
            lines.append("  ".join([cells[0].ljust(widths[0]), *others]).rstrip())
        return "\n".join([self.title, *lines, *self.notes])

    def html(self) -> str:
        """The table as HTML for a notebook."""
        title = html.escape(self.title).replace("\n", "<br>")
        body = "".join(_line(cells, "td") for cells in self.rows)
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return (
            f"<table><caption>{title}</caption><thead>{_line(self.headings, 'th')}</thead>"
            f"<tbody>{body}</tbody></table>{notes}"
        )


def _line(cells: tuple[str, ...], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"


Units = Literal["nondimensional", "si"]

SHOWN, WIDTH, TABLE_ROWS = 6, 100, 20
"""Largest numbers of array entries and of characters a line in a `repr`, and of rows of a table in
a notebook."""

NUMBERS = float, int, complex, np.ndarray
"""Types of values that may have an SI unit."""


@dataclass_transform(frozen_default=True, field_specifiers=(dataclasses.field,))
class Result(Saved):
    """Base class of results; each class derived from it becomes a frozen dataclass.

    Two results are equal if they have the same class and equal numbers. NaN, which stands for a
    missing number, equals NaN. Fields with compare=False are not compared.
    """

    _units: ClassVar[Mapping[str, Unit | None]] = MappingProxyType({})

    def __init_subclass__(cls, units: Mapping[str, Unit | None] | None = None) -> None:
        """Makes the class a dataclass; `units` gives units of fields that differ from `UNIT_OF`."""
        super().__init_subclass__()
        cls._units = {**cls._units, **(units or {})}
        dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)

    @classmethod
    def _made(cls, **values: Any) -> Self:
        """A result from values of all its fields, in a third of the constructor's time."""
        made = object.__new__(cls)
        object.__setattr__(made, "__dict__", values)
        return made

    def __eq__(self, other: object) -> Any:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or same(_compared(self), _compared(other))

    def __hash__(self) -> int:
        """Hash of the class and of the words and numbers in the fields, without NaN and arrays."""
        kinds = (str, int, float, complex)
        return hash((type(self), *(v for v in _compared(self) if isinstance(v, kinds) and v == v)))

    def __getstate__(self) -> dict[str, Any]:
        """Values of the fields, without cached properties, which can be computed again."""
        names = (field.name for field in dataclasses.fields(self))  # type: ignore[arg-type]
        return {name: getattr(self, name) for name in names}

    def __repr__(self) -> str:
        start, shown = f"{type(self).__name__}(", self._shown().items()
        for short in False, True:
            line = start + ", ".join(f"{name}={_short(one, short)}" for name, one in shown) + ")"
            if len(line) <= WIDTH:
                return line
        lines = [start]
        for name, one in shown:
            part = f"{name}={_short(one)}, "
            if len(part) >= WIDTH - 4:
                part = f"{name}={_short(one, True)}, "
            if len(lines[-1]) + len(part) > WIDTH + 1:
                lines.append("    ")
            lines[-1] += part
        return "\n".join(line.rstrip() for line in lines).removesuffix(",") + ")"

    def _shown(self) -> dict[str, Any]:
        """The fields that a `repr` shows, by name: all that are not at their default."""
        shown = {}
        for one in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, one.name)
            if one.repr and not same(value, one.default):
                shown[one.name] = value
        return shown

    def _repr_html_(self) -> str:
        return self._table().html()

    def _table(self) -> Table:
        """The table that a notebook shows for the result."""
        scales = self._scales()
        si = SI(self, scales, pipe=self._pipe()) if scales is not None else None
        units = si.units if si is not None else {}
        rows = []
        for name, value in self._shown().items():
            numbers = [] if si is None else [si._text(name) if name in units else ""]
            rows.append((name, _short(value), *numbers))
            of_tube = (one.name for one in OF_TUBES if name in one.sources and one.name in units)
            rows += [(one, "", si._text(one)) for one in of_tube if si is not None]
            if name in (*_ONE, *_SEVERAL) and si is not None:
                rows += [(one, "", si._text(one)) for one in OF_PHASES if one in units]
        headings = ("", "value", "SI") if si is not None else ("", "value")
        return Table(type(self).__name__, headings, rows)

    # ------------------------------------------------------------------------------------ SI units

    def in_si(self, pipe: Any = None) -> Self:
        """The result in SI units: speeds in m/s, frequencies in Hz, lengths in m, rates in 1/s.

        A frequency in Hz is an angular frequency over 2 pi; `Pipe.frequency_si` gives rad/s.

        For a pipe made with `Pipe.from_tube` there are more names. Beside a flow speed there are
        `flow_rate` (m^3/s) and `flow_rate_l_min` (l/min), beside `speeds` the same in the plural.
        Beside a `curvature` there is `wall_stress` (Pa), the largest bending stress E D_o / 2 times
        the curvature, at the outside of the bend. It leaves out stresses by pressure, weight,
        thrust and viscosity of the wall, and what clamps and flattening of the section add.

        For a pipe with phases, the flow speed is the mean by mass, sum M_k V_k / sum M_k with the
        mass M_k per length and the speed V_k of each phase, and the flow rate is that of all phases
        together. Beside a flow speed or `speeds` there are `phase_speeds` (m/s) and
        `phase_flow_rates` (m^3/s), one for each phase in the last axis.

        Args:
            pipe: the pipe, if the result holds neither the pipe nor its model.

        Returns:
            SI: an object with the names of the result's numbers that have a unit, and of results
            in its fields. To type checkers it is a result of the same kind, as those names have
            the same types.

        Raises:
            ValueError: if the pipe has no scales or is not known, or if no number of the result has
                a unit that the pipe alone gives.
            TypeError: if `pipe` is not a pipe.

        Example:
            >>> hose = pp.Pipe.from_si(
            ...     length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.032
            ... )
            >>> found = pp.critical_speed(pp.Chain(hose, 20)).in_si()
            >>> round(found.speed, 3), round(found.frequency, 3)
            (6.612, 2.006)
        """
        made = SI(self, self._known_scales(pipe), pipe=pipe or self._pipe())
        if made._is_empty():
            raise ValueError(
                f"{type(self).__name__} has no numbers to convert: they have no unit, are in SI "
                "units already, or have units that depend on more than the pipe"
            )
        return cast(Self, made)

    @property
    def units(self) -> dict[str, str]:
        """SI units of the numbers that `in_si` gives, by the names of the numbers.

        Example:
            >>> pp.modes(pp.Chain(pp.Pipe(0.2), 2), 1.0).units
            {'speed': 'm/s', 'eigenvalues': '1/s'}
        """
        return SI(self, self._scales(), pipe=self._pipe()).units

    def _known_scales(self, pipe: Any) -> Any:
        """Scales of the given pipe, or else of the result's own; refused if there are none."""
        if pipe is not None and not hasattr(pipe, "scales"):
            raise TypeError(f"pipe must be a Pipe, got {check.shown(pipe)}")
        scales = self._scales() if pipe is None else pipe.scales
        if scales is None and pipe is None and self._pipe() is None:
            raise ValueError(
                f"pipe must be given: {type(self).__name__} does not hold its pipe; if it is a "
                "part of a result that does, take the part of the whole's in_si()"
            )
        if scales is None:
            raise ValueError("numbers in SI need a pipe made with Pipe.from_si or Pipe.from_tube")
        return scales

    def _pipe(self) -> Any:
        """The pipe that the result belongs to; None if it is not known."""
        model = getattr(self, "model", None)
        pipe = getattr(self, "pipe", None) or getattr(model, "pipe", None)
        if pipe is not None:
            return pipe
        for _, within in _results_within(self):
            if (pipe := within._pipe()) is not None:
                return pipe
        return None

    def _scales(self) -> Any:
        """SI values of the nondimensional units; None if the pipe or its scales are not known."""
        return getattr(self._pipe(), "scales", None)

    def _scales_within(self, one: Result, scales: Any) -> Any:
        """Scales of a result in a field: its own if it knows them, else the given ones."""
        own = one._scales()
        if own is None and one._pipe() is not None and self._scales() is not None:
            return type(scales)(*[math.nan] * len(scales))  # another pipe, without scales
        return scales if own is None else own

    def _unit(self, name: str) -> Unit | None:
        """The SI unit of a field or a column."""
        name = re.sub(r"_(\d+|[xy])$", "", name)
        return self._units[name] if name in self._units else UNIT_OF.get(name)

    def _units_within(self, name: str) -> dict[str, Unit | None]:
        """Units of numbers of the results in a field, if those results do not know the units."""
        return {}


class Deferred:
    """A field of a class of results whose value may be given as a partial function.

    The function is called when the field is first read, and its value is kept in its place.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __get__(self, one: Any, kind: Any = None) -> Any:
        if one is None:
            raise AttributeError(self.name)
        value = vars(one)[self.name]
        if isinstance(value, partial):
            value = vars(one)[self.name] = value()
        return value

    def __set__(self, one: Any, value: Any) -> None:
        vars(one)[self.name] = value


class TableResult(Result):
    """A result that can be shown as a table with named columns."""

    def _columns(self) -> dict[str, Any]:
        """Columns by their names, each of shape (rows,)."""
        raise NotImplementedError

    def _scales_of_rows(self, scales: Any) -> Any:
        """Scales of each row of the table; in this class the scales of the result, for all rows."""
        return scales

    def columns(self, units: Units = "nondimensional", pipe: Any = None) -> dict[str, Any]:
        """The table as arrays by the names of its columns, each of shape (rows,).

        In SI the table of a tube also has flow rates next to flow speeds and wall stresses next to
        curvatures.

        Args:
            units: "nondimensional", or "si" for SI units, which the names of columns then state.
            pipe: the pipe, if units are SI and the result does not hold it.

        Raises:
            ValueError, TypeError: for other units, or if the pipe has no scales.

        Example:
            >>> curve = pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), 5), [0.1, 0.2])
            >>> list(curve.columns())
            ['value', 'speed', 'frequency', 'kind', 'failure']
        """
        columns = {name: np.asarray(values) for name, values in self._columns().items()}
        if check.choice("units", units, ("nondimensional", "si")) == "nondimensional":
            return columns
        scales = self._scales_of_rows(self._known_scales(pipe))
        made = {}
        for name, values in columns.items():
            unit = self._unit(name)
            if unit is None:
                made[name] = values
            else:
                made[f"{name} ({unit.name})"] = values * unit.scale(scales)
            for one in OF_TUBES:
                for heading, scale in one.column(name, unit, scales).items():
                    made[heading] = values * scale
        return made

    def to_dataframe(self, units: Units = "nondimensional", pipe: Any = None) -> Any:
        """The table as a pandas DataFrame.

        Args:
            units: as for `columns`.
            pipe: as for `columns`.

        Raises:
            ImportError: if pandas is not installed.
            ValueError, TypeError: as `columns`.
        """
        columns = self.columns(units, pipe)
        try:
            import pandas
        except ImportError as error:
            raise ImportError("to_dataframe needs pandas: pip install pandas") from error
        return pandas.DataFrame(columns)

    def to_csv(
        self,
        path: str | os.PathLike[str] | None = None,
        units: Units = "nondimensional",
        pipe: Any = None,
    ) -> str:
        """The table as comma-separated values, which are also written to a file if one is named.

        Args:
            path: path of the file; an existing one is replaced once the new one is complete.
            units: as for `columns`.
            pipe: as for `columns`.

        Raises:
            OSError: if the file cannot be written.
            ValueError, TypeError: as `columns`, and if `path` is not a path.
        """
        check.instance("path", path, str | os.PathLike | None, "a file's name")
        columns = self.columns(units, pipe)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        if path is not None:
            with replacing(path) as beside:
                beside.write_text(text.getvalue(), encoding="utf-8", newline="")
        return text.getvalue()

    def _table(self) -> Table:
        columns = self.columns("si" if self._scales() is not None else "nondimensional")
        shown = zip(*(values[:TABLE_ROWS].tolist() for values in columns.values()), strict=True)
        rows = [tuple(one if isinstance(one, str) else _short(one) for one in row) for row in shown]
        count = len(next(iter(columns.values()), ()))
        notes = [f"{count - TABLE_ROWS} more rows"] if count > TABLE_ROWS else []
        title = repr(self)
        if list(columns) != list(self.columns()):
            title += "\nThese numbers are nondimensional, those of the table in SI units."
        return Table(title, tuple(columns), rows, notes=notes)


Member = TypeVar("Member", bound=Result)


class ResultSequence(TableResult, Sequence[Member]):
    """A sequence of results, which has a length, indices and iteration like a tuple of them."""

    def _members(self) -> tuple[Member, ...]:
        """The results in order."""
        raise NotImplementedError

    def __len__(self) -> int:
        return len(self._members())

    @overload
    def __getitem__(self, index: int) -> Member: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Member, ...]: ...

    def __getitem__(self, index: Any) -> Any:
        return self._members()[index]


class SI:
    """Numbers of a result in SI units, under the names that they have in the result.

    Numbers without a unit, or with a unit that depends on the model, are left out.
    """

    def __init__(
        self,
        result: Result,
        scales: Any,
        known: dict[str, Unit | None] | None = None,
        pipe: Any = None,
    ) -> None:
        self._result, self._scales, self._known = result, scales, known or {}
        self._pipe = pipe

    @property
    def units(self) -> dict[str, str]:
        """SI units of the numbers, by the names of the numbers."""
        found = {}
        for name in _names_of_numbers(self._result):
            unit = self._unit(name)
            if unit is not None:
                found[name] = unit.name
        for one in OF_TUBES:
            if one.is_known(self._scales) and self._source(one) in found:
                found[one.name] = one.unit.name
        return found | {name: unit for name, unit in OF_PHASES.items() if self._of_phases(name)}

    def _of_phases(self, name: str) -> list[Any]:
        """Numbers in SI that one of `OF_PHASES` names, an array; none in a list if unknown.

        Where scales are those of other pipes, as along a sweep, there may be other phases.
        """
        pipe = self._pipe
        if not getattr(pipe, "phases", ()) or pipe.scales is not self._scales:
            return []
        source = self._source(OF_TUBES[0]) or self._source(OF_TUBES[2])
        if source is None:
            return []
        scale = pipe.phase_units[[*OF_PHASES].index(name)]
        return [np.multiply.outer(getattr(self._result, source), scale)]

    def _unit(self, name: str) -> Unit | None:
        return self._known.get(name) or self._result._unit(name)

    def _source(self, one: OfTube) -> str | None:
        """Name of the result's number from which a quantity of a tube follows."""
        for name in one.sources:
            value = getattr(self._result, name, None)
            if isinstance(value, NUMBERS) and self._unit(name) is one.source:
                return name
        return None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        for one in OF_TUBES:
            source = self._source(one) if one.name == name else None
            if source is not None and one.is_known(self._scales):
                return getattr(self._result, source) * np.asarray(one.unit.scale(self._scales))[()]
            if source is not None:
                wall = " with a uniform wall" if one.source is CURVATURE else ""
                raise AttributeError(f"{name} needs a pipe made with Pipe.from_tube{wall}")
        if name in OF_PHASES:
            if found := self._of_phases(name):
                return found[0]
            raise AttributeError(f"{name} needs a flow speed in one pipe made with phases")
        value, unit = getattr(self._result, name), self._unit(name)
        if inspect.ismethod(value):
            own = type(self._result).__name__
            asked = ', with units="si"' if "units" in inspect.signature(value).parameters else ""
            raise AttributeError(
                f"what in_si() gives has no {name}: call {name} of the {own} itself{asked}"
            )
        if unit is not None and isinstance(value, NUMBERS):
            scale = np.asarray(unit.scale(self._scales))  # one number, or one for each point
            return value * (scale if scale.ndim else scale.item())
        if value is None and unit is not None:
            return None
        if isinstance(value, Result):
            return self._within(name, value)
        if isinstance(value, tuple) and (not value or any(isinstance(v, Result) for v in value)):
            return tuple(one if one is None else self._within(name, one) for one in value)
        raise AttributeError(f"{name} of {type(self._result).__name__} has no value in SI units")

    def _within(self, name: str, one: Result) -> SI:
        scales = self._result._scales_within(one, self._scales)
        return SI(one, scales, self._result._units_within(name), one._pipe() or self._pipe)

    def _text(self, name: str) -> str:
        return f"{_short(getattr(self, name))} {self.units[name]}"

    def __getitem__(self, index: int) -> SI:
        """A result of the sequence in SI units, by its index."""
        of_sequence: Any = self._result
        return self._within("", of_sequence[index])

    def __dir__(self) -> list[str]:
        return ["units", *self.units, *(name for name, _ in _results_within(self._result))]

    def _is_empty(self) -> bool:
        within = _results_within(self._result)
        own = any(map(self._unit, _names_of_numbers(self._result)))  # until the first, as some cost
        return not own and all(self._within(*one)._is_empty() for one in within)

    def _shown(self) -> list[str]:
        """Numbers with their units, then results in fields, in full if there are no numbers."""
        numbers = [f"{name}={self._text(name)}" for name in self.units]
        within = []
        for name, first in _results_within(self._result):
            if self._within(name, first)._is_empty():
                continue
            value = getattr(self._result, name)
            short = _short(value) if value is not first else f"<{type(value).__name__}>"
            full = value is first and not numbers
            within.append(f"{name}={getattr(self, name) if full else short}")
        return numbers + within

    def __repr__(self) -> str:
        return f"{type(self._result).__name__} in SI({', '.join(self._shown())})"

    def _as_argument(self) -> str:
        """Words for the error message if this object is given in place of the result itself."""
        own = type(self._result).__name__
        return f'in_si() of a {own}: pass the {own} itself, and units="si" for SI in pictures'


def _names_of_numbers(one: Result) -> Iterator[str]:
    """Names of the fields and properties of a result that are numbers."""
    kinds = [kind for kind in type(one).__mro__ if kind is not Result]
    own = [name for kind in kinds for name, of in vars(kind).items() if isinstance(of, property)]
    fields = [field.name for field in dataclasses.fields(one)]  # type: ignore[arg-type]
    public = (name for name in dict.fromkeys(fields + own) if not name.startswith("_"))
    return (name for name in public if isinstance(getattr(one, name), NUMBERS))


def _results_within(one: Result) -> list[tuple[str, Result]]:
    """Names of fields that hold a result or a tuple of results, with the first of these."""
    found = []
    for field in dataclasses.fields(one):  # type: ignore[arg-type]
        value = getattr(one, field.name)
        parts = value if isinstance(value, tuple) else (value,)
        if within := [part for part in parts if isinstance(part, Result)]:
            found.append((field.name, within[0]))
    return found


# ------------------------------------------------------------------------------------- short texts


def _short(value: Any, without_parts: bool = False) -> str:
    """A value as a short text; `without_parts` shows what stands in its parentheses as "..."."""
    if isinstance(value, np.ndarray):
        return _short_array(value) if value.ndim else _short(value.item())
    if isinstance(value, bool | np.bool_ | str | type(None)):
        return repr(value) if isinstance(value, str) else str(value)
    if isinstance(value, float | complex | np.inexact):
        return f"{value:.7g}"
    if isinstance(value, tuple | list) and len(value) > 0:
        if len(value) <= SHOWN and not any(isinstance(one, Result) for one in value):
            parts = ", ".join(_short(one, without_parts) for one in value)
            return f"({parts})" if len(value) > 1 else f"({parts},)"
        kinds = list(dict.fromkeys(type(one).__name__ for one in value if one is not None))
        error = getattr(value[0], "error", None)
        why = f", the first: {check.shown(error)}" if isinstance(error, Exception) else ""
        return f"<{len(value)} {' or '.join(kinds)}{why}>"
    if not without_parts or isinstance(value, Result):
        return repr(value)
    if isinstance(value, Exception):
        return check.shown(value)
    return re.sub(r"(?s)\(.+\)", "(...)", repr(value))


def _short_array(values: np.ndarray[Any, Any]) -> str:
    if values.size <= SHOWN and values.ndim == 1:
        return f"[{', '.join(map(_short, values.tolist()))}]"
    shape = " x ".join(map(str, values.shape))
    if values.dtype.kind not in "iuf" or not values.size or not np.isfinite(values).any():
        return f"<{shape}>"
    return f"<{shape}, {np.nanmin(values):.4g} to {np.nanmax(values):.4g}>"


# ---------------------------------------------------------------------------------------- equality


def _compared(one: Any) -> list[Any]:
    return [getattr(one, field.name) for field in dataclasses.fields(one) if field.compare]


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal. Objects without a method `__eq__` are compared by state."""
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


def join_tables(tables: Sequence[dict[str, Any]], **names: Sequence[Any]) -> dict[str, Any]:
    """One table from several with the same columns; `names` adds columns with a value per table."""
    sizes = [len(next(iter(one.values()))) for one in tables]
    columns = {name: np.repeat(np.asarray(values), sizes) for name, values in names.items()}
    for name in tables[0] if tables else ():
        columns[name] = np.concatenate([np.asarray(one[name]) for one in tables])
    return columns


def numbered_columns(name: str, values: Any) -> dict[str, Any]:
    """Columns of an array of shape (rows, k), named name_0, name_1 and so on."""
    return {f"{name}_{index}": column for index, column in enumerate(np.asarray(values).T)}


def states_over_time(
    t: Any, q: Any, qdot: Any, tip: Any = None, curvature: Any = None
) -> dict[str, Any]:
    """Columns of a motion's table: time, free end, curvature, coordinates and their rates."""
    end = {}
    if tip is not None:
        end = {f"tip_{axis}": x for axis, x in zip("xyz", tip.T, strict=False)}
        end["curvature"] = curvature
    return {"t": t, **end, **numbered_columns("q", q), **numbered_columns("qdot", qdot)}
