# SPDX-License-Identifier: MIT
"""The cheapest model that is good enough, its error measured and not promised.

The search: in each family a ladder of sizes, then bisection.

The families of fastest convergence come first. A ladder goes up, to twice the size at the most, to
the first one that serves. A size that fails does not end it, as errors need not fall
monotonically. Between the last size that fails and the first that serves, bisection finds two
neighbours. The size measured next is extrapolated from the last by the family's order.

The ladder of the first family starts at a small size. That of each further one starts at as many
degrees of freedom as the best model so far, and ends where its order of convergence shows that it
would cost more. Every error and every time is measured.

For a budget the same ladder finds the largest size that the budget pays for.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.accuracy.convergence import FAMILIES, ModelFamily, checked_families, fitted_law
from pipedyn.accuracy.quantities import LONGEST_REFERENCE, RTOL, Quantity, checked_quantity
from pipedyn.accuracy.reference import MARGIN, Answer
from pipedyn.accuracy.trade import TradeRow, measured
from pipedyn.models.base import Model, PipedynError, checked_pipe
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.later import html
from pipedyn.util.result import Result

CANDIDATES = ("legendre", "beam", "consistent", "midpoint")
"""Families to choose among where none are named: of chains those whose error falls fastest."""

FINEST_ERROR = RTOL
"""Error down to which models are distinguished where the budget alone counts: that to which motions
and cycles are then solved."""

LADDER_START = 4
"""Size at which the first ladder starts: the linear answers of fewer cost no less."""

PATIENCE = 2.0 * LONGEST_REFERENCE
"""Seconds: a model that would take longer for an answer is not tried, or given up. What the largest
chain of `convergence.DOUBLED` takes for a limit cycle is a tenth of it."""

GAIN = 0.7
"""Share of the best time that another family must promise to be asked further, and of a budget to
which it is spent: times of one answer scatter by as much."""


@saved_as("Tried")
class Tried(Result):
    """A family: what was measured last of it, if anything, and why it was not chosen."""

    family: str
    row: TradeRow | None
    why: str


@saved_as("Choice")
class Choice(Result):
    """The model chosen.

    Attributes:
        models: the model, or the pair from whose answers the answer is extrapolated.
        row: its measured error and cost.
        tolerance: asked for, relative; None where a budget was.
        budget: asked for, in seconds an answer; None where a tolerance was.
        reference: what errors were measured against, and its own error.
        steady: whether the next larger size meets the tolerance as well; if not, the model meets it
            by a change of sign of its error, which holds for this pipe and this question only. None
            where no tolerance was asked for.
        tried: a line for each family, with the reason why it was not chosen.
        seconds: that the search took, with the reference.
        quantity: what was asked.
    """

    models: tuple[Model, ...]
    row: TradeRow
    tolerance: float | None
    budget: float | None
    reference: Answer
    steady: bool | None
    tried: tuple[Tried, ...] = field(repr=False)
    seconds: float
    quantity: Quantity

    @property
    def model(self) -> Model:
        """The model; of a pair the larger one, whose own answer is worse than `answer`."""
        return self.models[-1]

    @property
    def answer(self) -> NDArray[Any]:
        """What was answered when it was measured, of a pair the extrapolated value.

        A critical speed, shape (1,); eigenvalues, shape (K,), or of each speed, shape (S, K); the
        free end's positions, shape (S, 2); amplitude and frequency of a cycle, shape (2,).
        """
        assert self.row.values is not None
        return self.row.values

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

    def _shown(self) -> list[tuple[str, Any]]:
        names = "models", "error", "cost", "tolerance", "budget", "steady", "quantity"
        pairs = ((name, getattr(self, name)) for name in names)
        return [(name, value) for name, value in pairs if value is not None]

    def __str__(self) -> str:
        return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        sizes = " and ".join(str(model.dof) for model in self.models)
        pair = f", extrapolated from n = {sizes}" if len(self.models) > 1 else ""
        lines = [
            f"{self.model!r}{pair}",
            f"error {self.error:.1e} (reference: {self.reference.source}, "
            f"{self.reference.error:.1e}), {1e3 * self.cost:.3g} ms an answer",
        ]
        if self.steady is False:
            lines.append("its error changes sign here: the next larger size misses the tolerance")
        lines += [f"  {one.family}: {one.why}" for one in self.tried if one.why]
        return lines

    def _repr_html_(self) -> str:
        first, *others = map(html.escape, self._lines())
        return f"<b>{first}</b><br>" + "<br>".join(others)


@saved_as("NoModel")
class NoModel(PipedynError):
    """No model meets the demand.

    Attributes:
        tried: what was tried, with the reasons.
        nearest: the row that comes nearest; None where every model failed.
    """

    def __init__(self, message: str, tried: tuple[Tried, ...], nearest: TradeRow | None) -> None:
        super().__init__(message, tried, nearest)
        self.tried, self.nearest = tried, nearest


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
    that is known ten times as well. Where no rtol is given a motion is integrated with a hundredth
    of the tolerance, a cycle with a tenth. Families are asked one after the other, and a further
    one only as long as it promises to be 30 % cheaper than the best so far: times of one answer
    scatter by as much. What a search costs in answers of the model chosen:
    tests/benchmark_choose.py.

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
        Choice. Where its `steady` is False the model meets the tolerance by a change of sign of its
        error, and a little larger one of its family does not.

    Example:
        >>> pipe = pp.Pipe(0.2)
        >>> found = pp.choose(pipe, "critical_speed", tolerance=1e-3)
        >>> type(found.model).__name__, found.error <= 1e-3
        ('Galerkin', True)

    Raises:
        NoModel: if none meets the demand; it says what came nearest.
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no such answer, or none is
            found in half a minute.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    if tolerance is None and budget is None:
        raise ValueError("tolerance or budget must be given")
    if tolerance is not None:
        tolerance = check.real("tolerance", tolerance, low=1e-10, high=0.5)
    if budget is not None:
        budget = check.real("budget", budget, low=0.0, high=1e6, open_low=True)
    asked = checked_quantity(quantity, conditions, tolerance)
    families = checked_families("among", among, CANDIDATES)
    repeats = check.count("repeats", repeats, high=1000)
    start = time.perf_counter()
    asked = asked.prepared(pipe)
    reference = asked.reference(pipe, (FINEST_ERROR if tolerance is None else tolerance) / MARGIN)
    if tolerance is not None and reference.error > tolerance:
        known = f"answer ({reference.source}) is known to {reference.error:.1e}"
        reason = f"no model can be shown to meet an error of {tolerance:g}: the continuous pipe's"
        raise NoModel(f"{reason} {known}", (), None)
    fastest_first = sorted(families, key=lambda family: -family.order)
    search = ModelSearch(pipe, asked, reference, fastest_first, repeats)
    if tolerance is not None:
        row = search.cheapest(tolerance)
        demand = f"an error of {tolerance:g}" + (f" in {budget:g} s" if budget is not None else "")
    else:
        assert budget is not None
        row = search.most_accurate(budget)
        demand = f"a time of {budget:g} s"
    if row is None or (budget is not None and not row.seconds <= budget):
        raise _refusal(search, row or search.nearest(tolerance), demand)
    return Choice(
        models=FAMILIES[row.family].models(pipe, row.size),
        row=row,
        tolerance=tolerance,
        budget=budget,
        reference=reference,
        steady=None if tolerance is None else search.is_robust(row, tolerance),
        tried=_tried(search, row),
        seconds=time.perf_counter() - start,
        quantity=asked,
    )


def _tried(search: ModelSearch, chosen: TradeRow | None) -> tuple[Tried, ...]:
    """A line for each family: its row that was measured last, and why it was not chosen."""
    last = {name: row for (name, _), row in search.rows.items()}
    if chosen is not None:
        last[chosen.family] = chosen
    found = []
    for family in search.families:
        row, reason = last.get(family.name), search.reasons.get(family.name, "")
        why = ", and ".join(part for part in (row_in_words(row) if row else "", reason) if part)
        found.append(Tried(family.name, row, "" if row is not None and row is chosen else why))
    return tuple(found)


def _refusal(search: ModelSearch, nearest: TradeRow | None, demand: str) -> NoModel:
    """What to raise where nothing meets the demand."""
    tried = _tried(search, None)
    if nearest is None or math.isinf(search.bound(nearest)):
        why = "; ".join(f"{one.family}: {one.why}" for one in tried)
        return NoModel(f"no model meets {demand}: {why}", tried, None)
    reason = search.reasons.get(nearest.family, "")
    return NoModel(
        f"no model meets {demand}: the nearest, {nearest.family} of size {nearest.size}, has "
        f"an error of {search.bound(nearest):.1e} (the reference's {search.reference.error:.1e} "
        f"in it) and takes {1e3 * nearest.seconds:.3g} ms" + (f"; {reason}" if reason else ""),
        tried,
        nearest,
    )


# ---------------------------------------------------------------------------------- the search


@dataclass
class ModelSearch:
    """Models of one pipe asked so far, each once: `rows`, by family and size.

    `reasons` says, by a family's name, why no more of its sizes were asked, where its errors and
    times alone do not say it.
    """

    pipe: Pipe
    quantity: Quantity
    reference: Answer
    families: list[ModelFamily]  # of fastest convergence first
    repeats: int
    rows: dict[tuple[str, int], TradeRow] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)

    def cheapest(self, tolerance: float) -> TradeRow | None:
        """The row of least time among the smallest of each family that meet a tolerance."""
        best: TradeRow | None = None

        def serves(row: TradeRow) -> bool:
            return self.bound(row) <= tolerance

        for family in self.families:
            dof, limit, patience = family.dof(LADDER_START), PATIENCE, PATIENCE
            if best is not None:
                dof, limit = math.ceil(GAIN * best.dof), GAIN * best.seconds
                # An answer of twice the time would not become the best, though times scatter.
                patience = min(2.0 * best.seconds, PATIENCE)
            row = self._climb(family, dof, serves, tolerance, limit, patience)
            if row is not None and (best is None or row.seconds < best.seconds):
                best = row
        return best

    def most_accurate(self, budget: float) -> TradeRow | None:
        """The row of least error within a budget, down to what the reference resolves."""
        aim = max(MARGIN * self.reference.error, self.quantity.floor)

        def is_enough(row: TradeRow) -> bool:
            return row.seconds > budget or row.error <= aim

        for family in self.families:
            best = self._within(budget)
            if best is not None and not best.resolved:
                self.reasons[family.name] = "the reference does not resolve a smaller error"
                continue
            dof = family.dof(LADDER_START) if best is None else best.dof
            error = math.inf if best is None else self.bound(best)
            self._climb(family, dof, is_enough, error, GAIN * budget, PATIENCE)
        return self._within(budget)

    def _within(self, budget: float) -> TradeRow | None:
        good = [row for row in self.rows.values() if row.failure is None and row.seconds <= budget]
        return min(good, key=self.bound, default=None)

    def is_robust(self, row: TradeRow, tolerance: float) -> bool:
        """Whether the next larger size meets the tolerance too."""
        family = FAMILIES[row.family]
        larger = self._measure(family, family.beyond(row.size), PATIENCE)
        return self.bound(larger) <= tolerance

    def nearest(self, tolerance: float | None) -> TradeRow | None:
        """The row that comes nearest to a tolerance, or to a time where it is met."""
        rows = [row for row in self.rows.values() if row.failure is None]
        good = [row for row in rows if tolerance is None or self.bound(row) <= tolerance]
        if good:
            return min(good, key=lambda row: row.seconds)
        return min(rows, key=self.bound, default=None)

    def bound(self, row: TradeRow) -> float:
        """Bound on the true error; infinite where the model failed."""
        bound = row.error + self.reference.error
        return bound if math.isfinite(bound) else math.inf

    def _measure(self, family: ModelFamily, size: int, patience: float) -> TradeRow:
        """The row of one model."""
        key = (family.name, size)
        if key not in self.rows:
            given = (self.reference, self.repeats, patience)
            self.rows[key] = measured(self.pipe, self.quantity, family, size, *given)
        return self.rows[key]

    def _climb(
        self,
        family: ModelFamily,
        dof: int,
        serves: Callable[[TradeRow], bool],
        target: float,
        limit: float,
        patience: float,
    ) -> TradeRow | None:
        """The row of the smallest size of a family that serves, while the next smaller does not.

        Sizes go up from a number of degrees of freedom until `serves` holds or no size in `limit`
        seconds of an answer can bring the error down to `target`: then None. An answer is given up
        after `patience` seconds.
        """
        least, most = max(1, self.quantity.least), self.quantity.most
        more = family.for_terms(self.pipe)
        largest = min((family.largest or most) + more, most // 2 if family.paired else most)
        self.reasons[family.name] = self.quantity.excluded(self.pipe, family.name)
        if self.reasons[family.name]:
            return None
        bad, good, cuts = min(least, largest) - 1, largest + 1, 0
        size = min(max(dof // family.dof(1), least) + more, largest)
        while good - bad > 1:
            row = self._measure(family, size, patience)
            bad, good = (bad, size) if serves(row) else (size, good)
            if good > largest:
                if self._is_hopeless(family, row, largest, target, limit):
                    return None
                size = min(max(self._needed(family, row, target) or largest, bad + 1), 2 * bad)
                size = min(size, largest)
            else:
                failed = self.rows.get((family.name, bad))
                if failed is not None and failed.seconds >= limit:
                    return None
                # Of errors that fall by a law two guesses are enough.
                guess = self._needed(family, row, target) if cuts < 3 else None
                size = min(max(guess or (bad + good) // 2, bad + 1), good - 1)
                cuts += 1
        return self.rows.get((family.name, good))

    def _needed(self, family: ModelFamily, row: TradeRow, target: float) -> int | None:
        """The size at which the error meets a target as it falls by the family's order from a row.

        None where no power law holds. The paper's springs have order 2 up to their other limit.
        """
        error = self.bound(row)
        if math.inf in (error, target, family.order):
            return None
        return math.ceil(row.size * math.pow(error / target, 1.0 / (family.order or 2.0)))

    def _is_hopeless(
        self, family: ModelFamily, row: TradeRow, most: int, target: float, limit: float
    ) -> bool:
        """Whether no larger size of a family is worth asking after one that does not serve."""
        error, needed = self.bound(row), self._needed(family, row, target) or row.size
        # An answer's time grows at the least with the size, at the most with its cube.
        if error > target and row.seconds * needed / row.size > limit:
            return True
        if 8.0 * row.seconds > PATIENCE:
            self.reasons[family.name] = "one of twice the size would take more than a minute"
            return True
        known = {r.size: self.bound(r) for r in self.rows.values() if r.family == family.name}
        known = {size: bound for size, bound in known.items() if bound < math.inf}
        if len(known) < 4 or error == math.inf:
            return False
        law = fitted_law(np.array([*known], dtype=np.float64), np.array([*known.values()]))
        if family.order == 0.0 and law.law == "flat" and abs(law.limit) - law.spread > target:
            self.reasons[family.name] = (
                f"larger ones tend to an error of {abs(law.limit):.3g}: it has another limit"
            )
        elif needed > most:
            self.reasons[family.name] = f"none up to {most} would serve, as its errors fall"
        return bool(self.reasons[family.name])


def row_in_words(row: TradeRow) -> str:
    """A row in words."""
    if row.failure is not None:
        return f"size {row.size} failed: {row.failure}"
    return f"size {row.size} has an error of {row.error:.1e} and takes {1e3 * row.seconds:.3g} ms"
