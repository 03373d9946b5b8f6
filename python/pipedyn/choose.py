# SPDX-License-Identifier: MIT
"""The cheapest model that is good enough, its error measured and not promised.

Few models are tried. What is known of a family's error (an order, or exponential decay) predicts
the size that a tolerance takes; that size is then measured. A family is left where not even its
least cost so far can beat what was found by as much as WORTH.
"""

from __future__ import annotations

import html
import math
import time
from dataclasses import dataclass, field
from typing import Any

from pipedyn import _check
from pipedyn.families import FAMILIES, Family, checked_families
from pipedyn.model import Model, PipedynError, checked_pipe
from pipedyn.pipe import Pipe
from pipedyn.quantity import Quantity, Reference, checked_quantity
from pipedyn.trade import SHARPER, TradeRow, measured

DEFAULT = ("legendre", "beam", "consistent", "midpoint")
"""Families to choose among where none are named: of chains those whose error falls fastest."""

WORTH = 0.7
"""Share of the best cost so far that another family must promise to be looked at further."""

LARGEST = {"legendre": 60, "beam": 400}
"""Functions; chains are tried up to what the quantity can be asked of."""

PATIENCE = 60.0
"""Seconds: a model that would take longer for an answer is not tried."""

LESS = 0.93
"""Share of a size below which a smaller one is worth a measurement."""

DECADES = 0.8
"""Decades by which a Legendre function more lowers the error, before two sizes have told."""


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
        tried: every model that was measured and every family that was left, with the reasons.
        seconds: that the search took, with the reference.
        quantity: what was asked.
    """

    model: Model
    row: TradeRow
    tolerance: float | None
    budget: float | None
    reference: Reference
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
        Choice; its error was measured against the continuous pipe.

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
    sharp = tolerance if tolerance is not None else 1e-8
    asked = asked.sharpened(sharp).prepared(pipe)
    reference = asked.reference(pipe, sharp / SHARPER)
    search = _Search(pipe, asked, reference, families, repeats)
    if tolerance is not None:
        row = search.cheapest(tolerance, budget)
        demand = f"an error of {tolerance:g}" + (f" in {budget:g} s" if budget is not None else "")
    else:
        assert budget is not None
        row = search.sharpest(budget)
        demand = f"a time of {budget:g} s"
    if row is None:
        raise search.refusal(demand)
    return Choice(
        model=FAMILIES[row.family].models(pipe, row.size)[-1],
        row=row,
        tolerance=tolerance,
        budget=budget,
        reference=reference,
        tried=search.told(row),
        seconds=time.perf_counter() - begun,
        quantity=asked,
    )


class _Search:
    """Models measured so far, each once."""

    def __init__(
        self,
        pipe: Pipe,
        quantity: Quantity,
        reference: Reference,
        families: tuple[Family, ...],
        repeats: int,
    ) -> None:
        self.pipe, self.quantity, self.reference = pipe, quantity, reference
        self.families, self.repeats = families, repeats
        self.rows: dict[tuple[str, int], TradeRow] = {}
        self.left: dict[str, str] = {}

    def measure(self, family: Family, size: int) -> TradeRow:
        """The row of one model."""
        key = (family.name, size)
        if key not in self.rows:
            self.rows[key] = measured(
                *(self.pipe, self.quantity, family, size, self.reference, self.repeats)
            )
        return self.rows[key]

    def _largest(self, family: Family) -> int:
        most = self.quantity.most
        return min(LARGEST.get(family.name, most), most // 2 if family.paired else most)

    def bound(self, row: TradeRow) -> float:
        """Of the true error; infinite where the model failed."""
        known = row.error + self.reference.error
        return known if math.isfinite(known) else math.inf

    # ------------------------------------------------------------------------- for a tolerance

    def cheapest(self, tolerance: float, budget: float | None) -> TradeRow | None:
        """The cheapest row that meets a tolerance, and a budget where there is one."""
        best: TradeRow | None = None
        for family in self.families:
            row = self._smallest(family, tolerance, best)
            if row is not None and (best is None or row.seconds < best.seconds):
                best = row
        if best is not None and budget is not None and best.seconds > budget:
            return None
        return best

    def _smallest(self, family: Family, tolerance: float, best: TradeRow | None) -> TradeRow | None:
        """The smallest model of a family that meets the tolerance, unless it cannot win."""
        limit = PATIENCE if best is None else min(PATIENCE, WORTH * best.seconds)
        size = _first(family, tolerance, self.quantity)
        known: list[TradeRow] = []
        while True:
            row = self.measure(family, size)
            if row.failure is None:
                known.append(row)
            if self.bound(row) <= tolerance:
                break
            if row.seconds >= limit:
                self.left[family.name] = (
                    f"size {size} takes {_ms(row)} for an error of {row.error:.1e}, "
                    "and better ones take longer"
                )
                return None
            wanted = _predicted(family, known, tolerance, size)
            if wanted is None or wanted > self._largest(family):
                self.left[family.name] = self._hopeless(family, known)
                return None
            price = _price(known, wanted, self.quantity.growth)
            if price > limit:
                self.left[family.name] = (
                    f"an error of {tolerance:g} would take size {wanted}, some {1e3 * price:.3g} ms"
                )
                return None
            size = wanted
        return self._trimmed(family, row, tolerance)

    def _trimmed(self, family: Family, row: TradeRow, tolerance: float) -> TradeRow:
        """The cheapest that meets the tolerance still, down from one that does."""
        while True:
            size = _shrunk(family, row, tolerance)
            known = (family.name, size) in self.rows
            if known or size < self.quantity.least or size > LESS * row.size:
                return row
            smaller = self.measure(family, size)
            if self.bound(smaller) > tolerance or smaller.seconds >= row.seconds:
                return row
            row = smaller

    def _hopeless(self, family: Family, known: list[TradeRow]) -> str:
        if not known:
            failed = next(row for (name, _), row in self.rows.items() if name == family.name)
            return f"failed: {failed.failure}"
        last = known[-1]
        return f"size {last.size} has an error of {last.error:.1e}, which does not fall fast enough"

    # ---------------------------------------------------------------------------- for a budget

    def sharpest(self, budget: float) -> TradeRow | None:
        """The row of least error within a budget; of several at the reference's floor, cheapest."""
        found: list[TradeRow] = []
        for family in self.families:
            row = self._largest_within(family, budget)
            if row is not None:
                found.append(row)
        return min(found, key=lambda row: (self.bound(row), row.seconds), default=None)

    def _largest_within(self, family: Family, budget: float) -> TradeRow | None:
        """Of one family the best within the budget: sizes grow until time or error ends it."""
        best: TradeRow | None = None
        size, before = max(2, self.quantity.least), None
        while size <= self._largest(family):
            row = self.measure(family, size)
            if row.failure is None and row.seconds > budget:
                self.left[family.name] = f"size {size} takes {_ms(row)}"
                break
            if row.failure is None and (best is None or self.bound(row) < self.bound(best)):
                best = row
            if best is not None and not best.resolved:
                break
            step = _next_size(family, size)
            if before is not None and row.failure is None and before.seconds > 0.0:
                rise = max(row.seconds / before.seconds, 1.0)
                if row.seconds * rise > 2.0 * budget and step > size + 1:
                    step = size + max(1, (step - size) // 2)
            size, before = step, row if row.failure is None else before
        return best

    # ------------------------------------------------------------------------------ what is told

    def told(self, chosen: TradeRow) -> tuple[Tried, ...]:
        """Every row, and why it was not chosen."""
        last = {name: row for (name, _), row in self.rows.items()}
        found = []
        for (name, _), row in self.rows.items():
            if row is chosen:
                found.append(Tried(name, row, ""))
            elif row.failure is not None:
                found.append(Tried(name, row, f"size {row.size} failed: {row.failure}"))
            else:
                why = f"size {row.size} has an error of {row.error:.1e} and takes {_ms(row)}"
                if name in self.left and row is last[name]:
                    why = self.left[name]
                found.append(Tried(name, row, why))
        return tuple(found)

    def refusal(self, demand: str) -> NoModel:
        """What to raise where nothing meets the demand."""
        good = [row for row in self.rows.values() if math.isfinite(self.bound(row))]
        nearest = min(good, key=self.bound, default=None)
        told = tuple(
            Tried(name, row, self.left.get(name, "")) for (name, _), row in self.rows.items()
        )
        if nearest is None:
            failed = next(iter(self.rows.values()))
            return NoModel(f"no model meets {demand}: {failed.failure}", told, None)
        return NoModel(
            f"no model meets {demand}: the nearest, {nearest.family} of size {nearest.size}, has "
            f"an error of {self.bound(nearest):.1e} (the reference's {self.reference.error:.1e} "
            f"in it) and takes {_ms(nearest)}",
            told,
            nearest,
        )


def _ms(row: TradeRow) -> str:
    return f"{1e3 * row.seconds:.3g} ms"


def _first(family: Family, tolerance: float, quantity: Quantity) -> int:
    """Where to begin: a size that a tolerance takes at the least."""
    digits = -math.log10(tolerance)
    if family.name == "legendre":
        size = 4 + math.floor(0.5 * digits)
    elif family.name == "beam":
        size = 3
    else:
        size = 4
    return max(size, quantity.least + 2)


def _predicted(family: Family, known: list[TradeRow], tolerance: float, size: int) -> int | None:
    """The size that the tolerance takes, from what is known; None where nothing promises it."""
    if not known:
        return _next_size(family, size)
    last = known[-1]
    if not math.isfinite(last.error) or last.error > 0.5:
        return _next_size(family, size)
    aim = 0.7 * tolerance
    if family.order == math.inf:
        decades = DECADES
        if len(known) > 1 and known[-2].error > last.error and last.size > known[-2].size:
            told = math.log10(known[-2].error / last.error) / (last.size - known[-2].size)
            decades = max(told, 0.2)
        more = math.ceil(math.log10(last.error / aim) / decades)
        return size + min(max(more, 1), 6)
    order = family.order
    if len(known) > 1 and last.size > known[-2].size:
        told = math.log(known[-2].error / last.error) / math.log(last.size / known[-2].size)
        if told < 0.3 * max(order, 1.0):
            # It falls slowly, or not at all: luck at the smaller size, or another limit.
            return None if order == 0.0 or len(known) > 3 else 2 * size
        order = min(told, 1.5 * order) if order else told
    elif order == 0.0:
        return 2 * size
    ratio = (last.error / aim) ** (1.0 / order)
    most = 3.0 if len(known) == 1 else 16.0
    return max(size + 1, math.ceil(size * float(min(ratio, most))))


def _price(known: list[TradeRow], size: int, growth: float) -> float:
    """Seconds that a size would take: growing as smaller ones have, or as they do at the least."""
    if not known:
        return 0.0
    last = known[-1]
    if len(known) > 1 and last.size > known[-2].size:
        told = math.log(last.seconds / known[-2].seconds) / math.log(last.size / known[-2].size)
        growth = min(max(0.7 * told, growth), 3.0)
    price: float = last.seconds * (size / last.size) ** growth
    return price


def _next_size(family: Family, size: int) -> int:
    return size + 2 if family.order == math.inf else size + max(1, size // 2)


def _shrunk(family: Family, row: TradeRow, tolerance: float) -> int:
    """A smaller size that may do as well."""
    if family.order == math.inf:
        return row.size - 1
    share: float = (row.error / (0.9 * tolerance)) ** (1.0 / max(family.order, 1.0))
    return min(row.size - 1, max(1, math.ceil(row.size * share)))
