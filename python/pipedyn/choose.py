# SPDX-License-Identifier: MIT
"""The cheapest model that is good enough, its error measured and not promised.

How it is searched for: `search`.
"""

from __future__ import annotations

import html
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pipedyn import _check
from pipedyn.families import FAMILIES, checked_families
from pipedyn.model import Model, PipedynError, checked_pipe
from pipedyn.pipe import Pipe
from pipedyn.quantity import Quantity, Reference, checked_quantity
from pipedyn.search import Search
from pipedyn.trade import SHARPER, TradeRow

DEFAULT = ("legendre", "beam", "consistent", "midpoint")
"""Families to choose among where none are named: of chains those whose error falls fastest."""

FINEST = 1e-8
"""Error that is told where the budget alone counts."""


@dataclass(frozen=True)
class Tried:
    """A model that was measured, or a family that was left, and why it was not chosen.

    Attributes:
        family: its name.
        row: what was measured last of it; None where nothing was.
        why: why it lost; empty for the one chosen.
    """

    family: str
    row: TradeRow | None
    why: str


@dataclass(frozen=True)
class Choice:
    """The model chosen.

    Attributes:
        model: the model; of a pair the larger one.
        row: its measured error and cost.
        tolerance: asked for, relative; None where a budget was.
        budget: asked for, in seconds an answer; None where a tolerance was.
        reference: what errors were measured against, and its own error.
        steady: whether the next larger size meets the tolerance as well; if not, the model meets it
            by a change of sign of its error, which holds for this pipe and this question only. None
            where no tolerance was asked for.
        tried: every model that was measured and every family that was left, with the reasons.
        seconds: that the search took, with the reference.
        quantity: what was asked.
    """

    model: Model
    row: TradeRow
    tolerance: float | None
    budget: float | None
    reference: Reference
    steady: bool | None
    tried: tuple[Tried, ...] = field(repr=False)
    seconds: float
    quantity: Quantity

    @property
    def error(self) -> float:
        """Bound on the relative error: what was measured, and the reference's own."""
        return self.row.error + self.reference.error

    @property
    def cost(self) -> float:
        """Seconds of one answer, as measured."""
        return self.row.seconds

    @property
    def family(self) -> str:
        """Name of the family."""
        return self.row.family

    @property
    def size(self) -> int:
        """Segments or functions."""
        return self.row.size

    def __str__(self) -> str:
        return "\n".join([f"{self.model!r}", *self._told()])

    def _told(self) -> list[str]:
        lines = [
            f"error {self.error:.1e} (reference: {self.reference.source}, "
            f"{self.reference.error:.1e}), {1e3 * self.cost:.3g} ms an answer",
        ]
        if self.steady is False:
            lines.append("small by luck: the next larger size misses the tolerance")
        lines += [f"  {one.family}: {one.why}" for one in self.tried if one.why]
        return lines

    def _repr_html_(self) -> str:
        first, *others = [html.escape(line) for line in [repr(self.model), *self._told()]]
        return f"<b>{first}</b><br>" + "<br>".join(others)


class NoModel(PipedynError):
    """No model meets the demand.

    Attributes:
        tried: what was tried, with the reasons.
        nearest: the measured row that comes nearest; None where every model failed.
    """

    def __init__(self, message: str, tried: tuple[Tried, ...], nearest: TradeRow | None) -> None:
        super().__init__(message, tried, nearest)
        self.tried, self.nearest = tried, nearest

    def __str__(self) -> str:
        return str(self.args[0])


def choose(
    pipe: Pipe,
    quantity: str,
    tolerance: float | None = None,
    budget: float | None = None,
    among: Any = None,
    *,
    repeats: int = 1,
    **conditions: Any,
) -> Choice:
    """The cheapest model that meets a tolerance, or the most accurate one within a budget.

    The error is measured, for this pipe and this question, against an answer of the continuous pipe
    that is known ten times as well. A motion or cycle is integrated as sharply as the tolerance
    asks for. The whole search takes, in answers of the model chosen, 3 to 9 for linear questions
    (96 searches on 8 random pipes: tests/benchmark_choose.py), 4 to 9 for cycles, of chains to 18,
    and some 10 for motions, to 25 where an answer takes a few milliseconds. For motions of an
    aspirating pipe under drag alone the reference is dear: 13 to 29.

    Args:
        pipe: the pipe.
        quantity: what is asked, with its conditions as further arguments: as for `trade`.
        tolerance: largest relative error, in [1e-10, 0.5].
        budget: largest time of an answer in seconds, > 0. With a tolerance too, both must be met.
        among: families, as for `trade`; where not given the reduced models and the chains of second
            order.
        repeats: how often each answer is timed; the least counts.
        **conditions: of the quantity.

    Returns:
        Choice. Where its `steady` is False it is small by luck: it meets the tolerance by a change
        of sign of its error, and a little larger one of its family does not.

    Raises:
        NoModel: if none meets the demand; it says what came nearest.
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no such answer.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    asked = checked_quantity(quantity, conditions)
    if tolerance is None and budget is None:
        raise ValueError("tolerance or budget must be given")
    if tolerance is not None:
        tolerance = _check.real("tolerance", tolerance, low=1e-10, high=0.5)
    if budget is not None:
        budget = _check.real("budget", budget, low=0.0, high=1e6, open_low=True)
    families = checked_families("among", among, DEFAULT)
    repeats = _check.count("repeats", repeats, high=1000)
    begun = time.perf_counter()
    if tolerance is not None:
        asked = asked.sharpened(tolerance)
    asked = asked.prepared(pipe)
    reference = asked.reference(pipe, (FINEST if tolerance is None else tolerance) / SHARPER)
    if tolerance is not None and reference.error > tolerance:
        raise NoModel(
            f"no model can be shown to meet an error of {tolerance:g}: the continuous pipe's "
            f"answer ({reference.source}) is known to {reference.error:.1e}",
            (),
            None,
        )
    search = Search(pipe, asked, reference, families, repeats)
    steady = None
    if tolerance is not None:
        row = search.cheapest(tolerance)
        demand = f"an error of {tolerance:g}" + (f" in {budget:g} s" if budget is not None else "")
    else:
        assert budget is not None
        row = search.sharpest(budget)
        demand = f"a time of {budget:g} s"
    if row is None or (budget is not None and row.seconds > budget):
        raise _refusal(search, demand)
    if tolerance is not None:
        steady = search.is_steady(row, tolerance)
    return Choice(
        model=FAMILIES[row.family].models(pipe, row.size)[-1],
        row=row,
        tolerance=tolerance,
        budget=budget,
        reference=reference,
        steady=steady,
        tried=_told(search, row),
        seconds=time.perf_counter() - begun,
        quantity=asked,
    )


def _told(search: Search, chosen: TradeRow) -> tuple[Tried, ...]:
    """Every row, and why it was not chosen."""
    last = {name: row for (name, _), row in search.rows.items()}
    found = []
    for (name, _), row in search.rows.items():
        why = f"size {row.size} has an error of {row.error:.1e} and takes {_ms(row)}"
        if row is chosen:
            why = ""
        elif row.failure is not None:
            why = f"size {row.size} failed: {row.failure}"
        elif row is last[name]:
            why = search.left.get(name, why)
        found.append(Tried(name, row, why))
    return (*found, *_unmeasured(search))


def _unmeasured(search: Search) -> Iterator[Tried]:
    """Families that were left before any measurement."""
    names = {name for name, _ in search.rows}
    return (Tried(name, None, why) for name, why in search.left.items() if name not in names)


def _refusal(search: Search, demand: str) -> NoModel:
    """What to raise where nothing meets the demand."""
    if not search.rows:  # what looked best, to tell how far it is
        first = search.families[0].name, search.quantity.least + 4
        name, size = min(search.looks, key=search.looks.__getitem__, default=first)
        search.measure(FAMILIES[name], size)
    rows = search.rows.values()
    nearest = min(rows, key=search.bound)
    told = tuple(Tried(row.family, row, search.left.get(row.family, "")) for row in rows)
    told += tuple(_unmeasured(search))
    if math.isinf(search.bound(nearest)):
        why = nearest.failure or "its answer is of another kind than the continuous pipe's"
        return NoModel(f"no model meets {demand}: {why}", told, None)
    return NoModel(
        f"no model meets {demand}: the nearest, {nearest.family} of size {nearest.size}, has "
        f"an error of {search.bound(nearest):.1e} (the reference's {search.reference.error:.1e} "
        f"in it) and takes {_ms(nearest)}",
        told,
        nearest,
    )


def _ms(row: TradeRow) -> str:
    return f"{1e3 * row.seconds:.3g} ms"
