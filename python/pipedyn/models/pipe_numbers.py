# SPDX-License-Identifier: MIT
"""Numbers of a pipe by name: its own, those of its terms and of the spring at its root.

Linear questions use small motions about the straight pipe: numbers that do not enter these motions
are refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

from pipedyn.models.pipe import DEFAULTS, OWN_NUMBERS, Pipe
from pipedyn.models.scales import given_fields
from pipedyn.models.supports import RootSpring
from pipedyn.util import check
from pipedyn.util.result import SPEED, Unit


@dataclass(frozen=True)
class PipeNumber:
    """One number of a pipe: its name, its place in the pipe's fields and its range."""

    name: str  # name for users
    attribute: str
    term: int | None  # index among the terms
    rule: dict[str, Any]  # arguments of `check.real`

    def holder(self, pipe: Pipe) -> Any:
        """What has the number: the pipe, the spring at its root or one of its terms."""
        if self.name.startswith("root."):
            return pipe.root
        return pipe if self.term is None else pipe.terms[self.term]

    def of(self, pipe: Pipe) -> float:
        """The value of the number in a pipe."""
        return float(getattr(self.holder(pipe), self.attribute))

    def changed(self, pipe: Pipe, value: float) -> Pipe:
        """A copy of the pipe with another value of the number."""
        if self.name.startswith("root."):
            spring = pipe.root if isinstance(pipe.root, RootSpring) else RootSpring(value)
            return replace(pipe, root=replace(spring, **{self.attribute: value}))
        if self.term is None:
            changed = object.__new__(Pipe)  # a third of the time of `replace`
            vars(changed).update({name: vars(pipe)[name] for name in DEFAULTS})
            vars(changed)[self.attribute] = value
            changed.__post_init__()
            return changed
        terms = list(pipe.terms)
        terms[self.term] = replace(terms[self.term], **{self.attribute: value})
        return replace(pipe, terms=tuple(terms))


def pipe_numbers(pipe: Pipe, motions: bool = False) -> dict[str, PipeNumber]:
    """Numbers that enter small motions, or motions of finite amplitude, by name.

    The number of a term is named "terms[0].mass", and also "PointMass.mass" if the pipe has only
    one term of that kind.
    """
    found = {
        name: PipeNumber(name, name, None, one.rule)
        for name, one in OWN_NUMBERS.items()
        if one.flow in ("", pipe.flow) and not one.excluded(motions)
    }
    if isinstance(pipe.root, RootSpring):
        for item, _ in given_fields(pipe.root):
            number = PipeNumber(f"root.{item.name}", item.name, None, item.metadata["range"])
            found[number.name] = number
    laws = [term.law for term in pipe.terms]
    for i, term in enumerate(pipe.terms):
        if not (motions or term.is_felt_by_small_motions):
            continue
        for item, _ in given_fields(term):
            if item.name == "at":
                continue
            rule = item.metadata["range"]
            number = PipeNumber(f"terms[{i}].{item.name}", item.name, i, rule)
            found[number.name] = number
            if laws.count(term.law) == 1:
                found[f"{type(term).__name__}.{item.name}"] = number
    return found


def unit_of_number(name: str, pipe: Pipe) -> Unit | None:
    """The SI unit of a pipe's number or of u; None if there is none."""
    if name == "u":
        return SPEED
    if name in OWN_NUMBERS:
        return OWN_NUMBERS[name].unit
    number = pipe_numbers(pipe, motions=True).get(name)
    if number is None:
        return None
    holder = number.holder(pipe)
    (item,) = (one for one in fields(holder) if one.name == number.attribute)
    mass, length, time = item.metadata["powers"]
    root = math.sqrt(getattr(holder, item.metadata.get("root_of") or "", 1.0))
    # `Scales` counts masses per length, and N is kg m/s^2.
    newtons = mass if time < 0 else 0
    of_units = newtons, mass - newtons, time + 2 * newtons, length - mass - newtons
    powers = sorted(zip(("N", "kg", "s", "m"), of_units, strict=True), key=lambda one: one[1] < 0)
    text = " ".join(f"{unit}^{power}" if power != 1 else unit for unit, power in powers if power)
    if not text:
        return None

    def scale(scales: Any) -> Any:
        return scales.mass**mass * scales.length**length * scales.time**time / root

    return Unit(text, scale)


def checked_number(
    argument: str,
    name: Any,
    pipe: Pipe,
    motions: bool = False,
    others: tuple[str, ...] = ("u",),
) -> PipeNumber:
    """The number of a pipe that an argument names, which may also name other quantities.

    Raises:
        ValueError: if the pipe has no number of that name, or if the number does not enter small
            motions, or motions of finite amplitude if these are meant.
        TypeError: for an argument that is not a string.
    """
    every = pipe_numbers(pipe, motions)
    own = OWN_NUMBERS.get(name) if isinstance(name, str) else None
    if own is not None and (reason := own.excluded(motions)):
        rule = "have a part in small motions about the straight pipe"
        if motions:
            rule = "be a number with which the pipe can be set in motion"
        raise ValueError(f"{argument} must {rule}, got {name!r}: {reason}")
    return every[check.choice(argument, name, (*others, *every))]
