# SPDX-License-Identifier: MIT
"""Families of models of one pipe, each growing with a size, and how their errors fall."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.continuum import FUNCTIONS_A_JOINT
from pipedyn.models.galerkin import LARGEST_BASIS, Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.util import check

RULES = {"consistent": 2.0, "midpoint": 2.0, "rayleigh": 0.0, "uniform": 1.0, "frequency": 1.0}
"""Spring rules and the order of their errors; the paper's tends to another limit."""


@dataclass(frozen=True)
class Family:
    """Models of one kind and growing size, named by a spring rule, that and "pair", or a basis.

    Attributes:
        order: of the error, n^-order; infinite where it falls exponentially, 0 where it stays.
        sizes: at which `trade` measures the family where none are given.
        largest: size, without terms, up to which a search goes; None where only the question sets
            a limit. 60 Legendre functions resolve waves of 120 / L; the quadrature of beam modes
            takes a second from 400 on.
    """

    name: str
    order: float
    sizes: tuple[int, ...]
    largest: int | None = None

    @property
    def paired(self) -> bool:
        """Whether the answer is extrapolated from the models of one and of twice the size."""
        return self.name.endswith(" pair")

    def make(self, pipe: Pipe, size: int) -> Model:
        """One model of a pipe."""
        word = self.name.removesuffix(" pair")
        return Chain(pipe, size, springs=word) if word in RULES else Galerkin(pipe, size, word)

    def models(self, pipe: Pipe, size: int) -> tuple[Model, ...]:
        """One model, or two, the second of twice the size."""
        members = (size, 2 * size) if self.paired else (size,)
        return tuple(self.make(pipe, member) for member in members)

    def dof(self, size: int) -> int:
        """Degrees of freedom of the model, or of the two."""
        return 3 * size if self.paired else size

    def for_terms(self, pipe: Pipe) -> int:
        """Functions that a Legendre basis takes on top, where terms divide the pipe into panels."""
        if self.order < math.inf or not pipe.terms:
            return 0
        return FUNCTIONS_A_JOINT * (Galerkin(pipe, LARGEST_BASIS, "legendre").panels - 1)

    def beyond(self, size: int) -> int:
        """The next size, at which an error that is small only by a change of sign is not."""
        return size + 1 if self.order == math.inf else math.ceil(1.2 * size + 0.5)


DOUBLED = (2, 4, 8, 16, 32, 64)
"""Sizes of chains: doubled, each pair but the last has its larger chain among them. A limit cycle
of 64 segments takes 6 s, of the largest pair 7, so that 128 would take more than `trade.LONGEST`.
Reduced models go up to where beam modes take 3 s of one, and two sizes beyond 12 Legendre
functions, which leave 8e-14 in a critical speed and 8e-9 in a cycle."""

FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        *(Family(rule, order, DOUBLED) for rule, order in RULES.items()),
        *(Family(f"{r} pair", 2.0 * order, DOUBLED[:-1]) for r, order in RULES.items() if order),
        Family("beam", 4.0, (2, 3, 4, 6, 8, 12, 16, 24), 400),
        Family("legendre", math.inf, (2, 4, 6, 8, 10, 12, 16), 60),
    )
}

GROUPS: dict[str, tuple[str, ...]] = {
    "chain": tuple(RULES),
    "pair": tuple(name for name in FAMILIES if name.endswith("pair")),
    "reduced": ("beam", "legendre"),
}
"""Words for several families."""


def checked_families(name: str, given: Any, default: Sequence[str]) -> tuple[Family, ...]:
    """Families by their names or the words for several, each once; the default where None is given.

    Raises ValueError or TypeError, naming the argument, for what is no such word.
    """
    words = default if given is None else [given] if isinstance(given, str) else given
    try:
        several = iter(() if isinstance(words, dict) else words)
    except TypeError:
        raise TypeError(f"{name} must be words, got {check.shown(given)}") from None
    found: dict[str, Family] = {}
    for word in several:
        one = check.choice(name, word, (*GROUPS, *FAMILIES))
        found |= {member: FAMILIES[member] for member in GROUPS.get(one, (one,))}
    if not found:
        raise ValueError(f"{name} must name at least one family, got {check.shown(given)}")
    return tuple(found.values())
