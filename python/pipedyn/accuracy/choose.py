# SPDX-License-Identifier: MIT
"""The cheapest model that is good enough, its error measured and not promised.

How it is searched for: `search`.
"""

from __future__ import annotations

import html
import math
import time
from dataclasses import field
from typing import Any

from numpy.typing import NDArray

from pipedyn.accuracy.families import FAMILIES, checked_families
from pipedyn.accuracy.quantities import Quantity, checked_quantity
from pipedyn.accuracy.reference import MARGIN, Reference
from pipedyn.accuracy.search import Search, described
from pipedyn.accuracy.trade import TradeRow
from pipedyn.models.base import Model, PipedynError, checked_pipe
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.result import result

DEFAULT = ("legendre", "beam", "consistent", "midpoint")
"""Families to choose among where none are named: of chains those whose error falls fastest."""

FINEST = 1e-8
"""Error down to which models are distinguished where the budget alone counts: few need more."""


@result
class Tried:
    """A family: what was measured last of it, if anything, and why it was not chosen."""

    family: str
    row: TradeRow | None
    why: str


@result
class Choice:
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
    reference: Reference
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

    Raises:
        NoModel: if none meets the demand; it says what came nearest.
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no such answer, or none is
            found in half a minute.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    asked = checked_quantity(quantity, conditions)
    if tolerance is None and budget is None:
        raise ValueError("tolerance or budget must be given")
    if tolerance is not None:
        tolerance = check.real("tolerance", tolerance, low=1e-10, high=0.5)
    if budget is not None:
        budget = check.real("budget", budget, low=0.0, high=1e6, open_low=True)
    families = checked_families("among", among, DEFAULT)
    repeats = check.count("repeats", repeats, high=1000)
    start = time.perf_counter()
    if tolerance is not None:
        asked = asked.solved_for(tolerance)
    asked = asked.prepared(pipe)
    reference = asked.reference(pipe, (FINEST if tolerance is None else tolerance) / MARGIN)
    if tolerance is not None and reference.error > tolerance:
        known = f"answer ({reference.source}) is known to {reference.error:.1e}"
        reason = f"no model can be shown to meet an error of {tolerance:g}: the continuous pipe's"
        raise NoModel(f"{reason} {known}", (), None)
    search = Search(pipe, asked, reference, families, repeats)
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


def _tried(search: Search, chosen: TradeRow | None) -> tuple[Tried, ...]:
    """A line for each family: its row that was measured last, and why it was not chosen."""
    last = {name: row for (name, _), row in search.rows.items()}
    if chosen is not None:
        last[chosen.family] = chosen
    found = []
    for family in search.families:
        row, reason = last.get(family.name), search.reasons.get(family.name, "")
        why = ", and ".join(part for part in (described(row) if row else "", reason) if part)
        found.append(Tried(family.name, row, "" if row is not None and row is chosen else why))
    return tuple(found)


def _refusal(search: Search, nearest: TradeRow | None, demand: str) -> NoModel:
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
