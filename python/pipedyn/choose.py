# SPDX-License-Identifier: MIT
"""The cheapest model that is good enough, its error measured and not promised.

Few models are tried. What is known of a family's error (an order, or exponential decay) predicts
the size that a tolerance takes. Linear questions have looks, which tell a model's error at a tenth
of its cost, and cost what their degrees of freedom do: families whose size is too large beside the
best are not measured. Of motions and cycles each size is measured, and a family is left where not
even its least cost so far can beat what was found by as much as WORTH.
"""

from __future__ import annotations

import html
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from pipedyn import _check
from pipedyn.families import FAMILIES, Family, checked_families, expected_size
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

FINEST = 1e-8
"""Error that is told where the budget alone counts."""

LESS = 0.93
"""Share of a size below which a smaller one is worth a measurement."""

DECADES = 0.8
"""Decades by which a Legendre function more lowers the error, before two sizes have told."""

STEEP = 1.2
"""The same where a step too long does no harm."""

LOOKS, TRIES, MEASURED = 25, 4, 2
"""For a linear question: sizes of a family looked at, and measured after; families measured."""

LONG = 80
"""Size from which a linear answer is not measured before a smaller one has told its price."""


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
    asks for. For linear questions the whole search takes 2 to 11 times as long as an answer of the
    model chosen (96 searches on 8 random pipes: tests/benchmark_choose.py). The reference of a
    motion or a cycle is itself several of larger models: 10 to 20 times, and 100 times for an
    aspirating pipe under drag alone.

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
    search = _Search(pipe, asked, reference, families, repeats)
    steady = None
    if tolerance is not None:
        row = search.cheapest(tolerance, budget)
        demand = f"an error of {tolerance:g}" + (f" in {budget:g} s" if budget is not None else "")
    else:
        assert budget is not None
        row = search.sharpest(budget)
        demand = f"a time of {budget:g} s"
    if row is None:
        raise search.refusal(demand)
    if tolerance is not None:
        steady = search.is_steady(row, tolerance)
    return Choice(
        model=FAMILIES[row.family].models(pipe, row.size)[-1],
        row=row,
        tolerance=tolerance,
        budget=budget,
        reference=reference,
        steady=steady,
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
        self.looks: dict[tuple[str, int], float] = {}
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
        find = self._looked_up if self.quantity.is_linear else self._tried_out
        best = find(tolerance)
        return None if best is not None and budget is not None and best.seconds > budget else best

    def is_steady(self, row: TradeRow, tolerance: float) -> bool:
        """Whether the next larger size meets the tolerance too."""
        family = FAMILIES[row.family]
        return self._look(family, family.beyond(row.size)) <= tolerance

    @cached_property
    def _wave(self) -> float | None:
        return self.quantity.wave(self.pipe, self.reference.answer)

    def _expected(self, family: Family, tolerance: float) -> float:
        """About the size that the tolerance takes."""
        if self._wave is None:
            return float(_first(family, tolerance, self.quantity))
        return max(expected_size(family, self._wave, tolerance), float(self.quantity.least))

    def _look(self, family: Family, size: int) -> float:
        """Bound on a model's error, from a look where there is one, else measured."""
        key = (family.name, size)
        if key not in self.looks:
            told = None
            if key not in self.rows and not family.paired:
                try:
                    model = family.models(self.pipe, size)[0]
                    told = self.quantity.look(model, self.reference.answer)
                except (PipedynError, ValueError, np.linalg.LinAlgError):
                    told = math.inf
            if told is None:
                return self.bound(self.measure(family, size))
            self.looks[key] = told + self.reference.error
        return self.looks[key]

    def _looked_up(self, tolerance: float) -> TradeRow | None:
        """For a linear question: sizes by looks, then measurements of the smallest."""
        expected = {family: self._expected(family, tolerance) for family in self.families}
        sizes: list[tuple[int, Family, int]] = []
        room = math.inf
        for family in sorted(self.families, key=lambda one: one.dof(1) * expected[one]):
            size = self._least(family, expected[family], tolerance, room)
            if size is not None:
                dof = family.dof(size)
                sizes.append((dof, family, size))
                room = min(room, self.quantity.room(dof))
        best: TradeRow | None = None
        for rank, (dof, family, size) in enumerate(sorted(sizes, key=lambda one: one[0])):
            if best is not None and (rank >= MEASURED or dof > self.quantity.room(best.dof)):
                self.left[family.name] = f"an error of {tolerance:g} takes size {size}"
                continue
            row = self._confirmed(family, size, tolerance)
            if row is not None and (best is None or row.seconds < best.seconds):
                best = row
        if best is not None and not self.quantity.is_even and best.size < LONG:
            other = self.measure(FAMILIES[best.family], best.size + 1)
            if self.bound(other) <= tolerance and other.seconds < best.seconds:
                best = other
        return best

    def _least(self, family: Family, expected: float, tolerance: float, room: float) -> int | None:
        """The smallest size that looks to meet a tolerance, of those that have room."""
        most = min(self._largest(family), int(min(room, 1e9)) // family.dof(1))
        least = self.quantity.least
        if most < least or (expected > 3.0 * most and family.order < math.inf):
            about = f", and {expected:.0f} are expected" if math.isfinite(expected) else ""
            self.left[family.name] = f"more than size {most} is needed{about}"
            return None
        size = math.ceil(min(max(expected, least), most))
        if self._look(family, size) <= tolerance:
            for _ in range(LOOKS):
                smaller = _scaled(family, size, self._look(family, size), tolerance)
                smaller = max(min(smaller, size - 1), least)
                if smaller >= size or self._look(family, smaller) > tolerance:
                    break
                size = smaller
            return size
        for _ in range(LOOKS):
            if size >= most:
                break
            larger = _scaled(family, size, self._look(family, size), tolerance)
            size = min(max(larger, size + 1), most)
            if self._look(family, size) <= tolerance:
                return size
        error = self._look(family, size)
        self.left[family.name] = f"size {size} has an error of {error:.1e} still"
        return None

    def _confirmed(self, family: Family, size: int, tolerance: float) -> TradeRow | None:
        """The first size from one that looks good at which the measured error is."""
        for _ in range(TRIES):
            if size > self._largest(family):
                break
            if size > LONG:
                tested = self.measure(family, min(size // 2, 2 * LONG))
                price = _price([tested], size, 1.5)
                if price > PATIENCE:
                    self.left[family.name] = f"size {size} would take some {price:.0f} s"
                    return None
            row = self.measure(family, size)
            if self.bound(row) <= tolerance:
                return row
            size = max(size + 1, math.ceil(1.1 * size))
        self.left[family.name] = self._hopeless(family, [row])
        return None

    def _tried_out(self, tolerance: float) -> TradeRow | None:
        """For motions and cycles: every size is measured, the reference's family first."""
        best: TradeRow | None = None
        for family in sorted(self.families, key=lambda one: one.name not in self.reference.source):
            row = self._smallest(family, tolerance, best)
            if row is not None and (best is None or row.seconds < best.seconds):
                best = row
        return best

    def _smallest(self, family: Family, tolerance: float, best: TradeRow | None) -> TradeRow | None:
        """The smallest model of a family that meets the tolerance, unless it cannot win."""
        limit = PATIENCE if best is None else min(PATIENCE, WORTH * best.seconds)
        size = self._start(family, tolerance)
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

    def _start(self, family: Family, tolerance: float) -> int:
        """Where to begin: a little below what is expected, as larger models are dearer."""
        expected = self._expected(family, tolerance)
        least = _first(family, tolerance, self.quantity)
        return max(least, min(int(0.7 * expected), 3 * least)) if math.isfinite(expected) else least

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
        return (*found, *self._unmeasured())

    def _unmeasured(self) -> Iterator[Tried]:
        """Families that were left before any measurement."""
        measured_ones = {name for name, _ in self.rows}
        return (Tried(n, None, why) for n, why in self.left.items() if n not in measured_ones)

    def refusal(self, demand: str) -> NoModel:
        """What to raise where nothing meets the demand."""
        if not self.rows:  # what looked best, to tell how far it is
            family = self.families[0]
            first = family.name, _first(family, 0.1, self.quantity)
            name, size = min(self.looks, key=self.looks.__getitem__, default=first)
            self.measure(FAMILIES[name], size)
        good = [row for row in self.rows.values() if math.isfinite(self.bound(row))]
        nearest = min(good, key=self.bound, default=None)
        told = tuple(
            Tried(name, row, self.left.get(name, "")) for (name, _), row in self.rows.items()
        )
        told += tuple(self._unmeasured())
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


def _scaled(family: Family, size: int, error: float, tolerance: float) -> int:
    """A neighbouring size that would have an error just below the tolerance."""
    if family.order == math.inf:
        if error <= tolerance:
            return size - 1
        decades = math.log10(min(error, 1.0) / tolerance)
        return size + min(max(math.ceil(decades / STEEP), 1), 6)
    share = math.sqrt(10.0)
    if math.isfinite(error):
        share = (max(error, 1e-16) / (0.9 * tolerance)) ** (1.0 / max(family.order, 1.0))
    return math.ceil(size * min(max(share, 1.0 / 3.0), 3.0))


def _next_size(family: Family, size: int) -> int:
    return size + 2 if family.order == math.inf else size + max(1, size // 2)


def _shrunk(family: Family, row: TradeRow, tolerance: float) -> int:
    """A smaller size that may do as well."""
    if family.order == math.inf:
        return row.size - 1
    share: float = (row.error / (0.9 * tolerance)) ** (1.0 / max(family.order, 1.0))
    return min(row.size - 1, max(1, math.ceil(row.size * share)))
