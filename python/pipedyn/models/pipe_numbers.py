# SPDX-License-Identifier: MIT
"""A pipe's numbers by name: its own, those of its terms and of the spring at its root.

What moves in the plane of two of them is the small motion about the straight pipe: numbers without
a part in it are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.models.supports import RootSpring
from pipedyn.models.terms import Term
from pipedyn.util import check
from pipedyn.util.units import SPEED, Unit


@dataclass(frozen=True)
class PipeNumber:
    """One number of a pipe: where it stands, and in which range it may lie."""

    name: str  # as users say it
    attribute: str
    term: int | None  # its place among the terms
    rule: dict[str, Any]  # what `check.real` asks of it

    def of(self, pipe: Pipe) -> float:
        """The value that the number has of a pipe."""
        holder: Any = pipe if self.term is None else pipe.terms[self.term]
        if self.name == "root.stiffness":
            holder = pipe.root
        return float(getattr(holder, self.attribute))

    def changed(self, pipe: Pipe, value: float) -> Pipe:
        """The pipe with another value."""
        if self.name == "root.stiffness":
            return replace(pipe, root=RootSpring(value))
        if self.term is None:
            own: dict[str, Any] = {self.attribute: value}
            return replace(pipe, **own)
        terms = list(pipe.terms)
        terms[self.term] = replace(terms[self.term], **{self.attribute: value})
        return replace(pipe, terms=tuple(terms))


def pipe_numbers(pipe: Pipe, motions: bool = False) -> dict[str, PipeNumber]:
    """The numbers with a part in small motions, or in motions of finite amplitude, by name.

    A term's is "terms[0].mass", and "PointMass.mass" where the pipe has one such term.
    """
    found = {
        name: PipeNumber(name, name, None, one.rule)
        for name, one in OWN_NUMBERS.items()
        if one.flow in ("", pipe.flow) and not (one.not_large if motions else one.not_small)
    }
    if isinstance(pipe.root, RootSpring):
        rule = fields(RootSpring)[0].metadata["range"]
        found["root.stiffness"] = PipeNumber("root.stiffness", "stiffness", None, rule)
    laws = [term.law for term in pipe.terms]
    for i, term in enumerate(pipe.terms):
        if not (motions or term.is_felt_by_small_motions):
            continue
        for item in fields(term):
            if item.name == "at":
                continue
            rule = item.metadata["range"]
            number = PipeNumber(f"terms[{i}].{item.name}", item.name, i, rule)
            found[number.name] = number
            if laws.count(term.law) == 1:
                found[f"{type(term).__name__}.{item.name}"] = number
    return found


def unit_of_number(name: str, pipe: Pipe) -> Unit | None:
    """The SI unit of a number of a pipe, or of u; None where it has none."""
    if name == "u":
        return SPEED
    if name in OWN_NUMBERS:
        return OWN_NUMBERS[name].unit
    number = pipe_numbers(pipe, motions=True).get(name)
    holder: Any = pipe.root if name == "root.stiffness" else None
    if number is not None and number.term is not None:
        holder = pipe.terms[number.term]
    if number is None or not isinstance(holder, Term | RootSpring):
        return None
    (item,) = (item for item in fields(holder) if item.name == number.attribute)
    mass, length, time = item.metadata["powers"]
    # Masses are counted per length.
    powers = zip(("kg", "m", "s"), (mass, length - mass, time), strict=True)
    text = " ".join(f"{unit}^{power}" if power != 1 else unit for unit, power in powers if power)
    if not text:
        return None

    def scale(scales: Any) -> Any:
        return scales.mass**mass * scales.length**length * scales.time**time

    return Unit(text, scale)


def checked_number(
    argument: str,
    name: Any,
    pipe: Pipe,
    motions: bool = False,
    others: tuple[str, ...] = ("u",),
) -> PipeNumber:
    """The number of a pipe that an argument names, which may be others, too.

    Raises:
        ValueError: if the pipe has none of that name, or small motions do not know it, or motions
            of finite amplitude where these are meant.
        TypeError: for what is no word.
    """
    every = pipe_numbers(pipe, motions)
    own = OWN_NUMBERS.get(name) if isinstance(name, str) else None
    if motions and own is not None and own.not_large:
        raise ValueError(
            f"{argument} must be a number with which the pipe can be set in motion, got {name!r}: "
            f"{own.not_large}"
        )
    if not motions and own is not None and own.not_small:
        raise ValueError(
            f"{argument} must have a part in small motions about the straight pipe, got "
            f"{name!r}: {own.not_small}"
        )
    return every[check.choice(argument, name, (*others, *every))]
