# SPDX-License-Identifier: MIT
"""Error and cost of chains and reduced models, and the cheapest model that meets a tolerance.

`trade` measures models of growing size and compares them with one reference. `choose` searches by
such measurements: in each family a search goes up a ladder of sizes and then bisects.

The families of fastest convergence come first. The ladder goes up until a size meets the tolerance,
with steps to at most twice the size. It goes on after a size that misses the tolerance, as errors
need not fall monotonically. Bisection between the last size that misses and the first that meets
the tolerance ends at two neighbours. Each size is extrapolated from the last one by the order of
the family.

The first ladder starts at a small size. Each further ladder starts at about the number of degrees
of freedom of the best model so far, and ends once the order of convergence shows that the family
would cost more.

For a budget of time the same ladder finds the largest size within the budget.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.accuracy.convergence import (
    FAMILIES,
    GROUPS,
    ConvergenceLaw,
    ModelFamily,
    checked_families,
    fitted_law,
)
from pipedyn.accuracy.quantities import (
    LONGEST_REFERENCE,
    MARGIN,
    RTOL,
    Answer,
    Quantity,
    QuantityName,
    checked_quantity,
)
from pipedyn.models.base import Model
from pipedyn.models.pipe import Pipe, checked_pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.counters import clock, count_work, time_limit
from pipedyn.util.errors import NotConverged, PipedynError, warn_of_plane
from pipedyn.util.parallel import track
from pipedyn.util.result import Result, Table, TableResult

LONGEST_ANSWER = 10.0
"""Time in seconds after which a measurement is not repeated; if no sizes were given, an answer that
takes longer than this is given up. Each of the 44 usual models then takes at most twice as long."""

Cost = Literal["seconds", "dof", "right_hand_sides", "factorisations"]
COSTS: tuple[Cost, ...] = get_args(Cost)
"""Measures of cost, which are attributes of a row."""

USUAL = ("consistent", "midpoint", "uniform", "rayleigh", "consistent pair", "beam", "legendre")
"""Families that are measured if none are named."""


@saved_as("TradeRow")
class TradeRow(Result):
    """The measurement of one model, or of a pair of models.

    Attributes:
        family: name of the family.
        size: number of segments or functions; for a pair those of the smaller model.
        dof: degrees of freedom; for a pair the sum of both models.
        error: relative error of the answer, compared with the reference; a bound on it if it is not
            resolved; NaN if the model failed.
        resolved: whether the error is at least ten times that of the reference.
        seconds: least processor time of an answer from new models, without the time to make these;
            for a failure the time until it was raised.
        spread: ratio of the longest to the shortest of the repeated times, minus 1.
        right_hand_sides, factorisations: numbers of both in one answer.
        failure: the exception that was raised; None if there was none.
        values: the numbers in the answer; None if it failed.
    """

    family: str
    size: int
    dof: int
    error: float
    resolved: bool
    seconds: float
    spread: float
    right_hand_sides: int
    factorisations: int
    failure: Exception | None = field(default=None, repr=False)
    values: NDArray[Any] | None = field(default=None, repr=False, compare=False)

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the row in a table, one for each column."""
        named = (self.family, str(self.size), str(self.dof))
        if self.failure is not None:
            return (*named, "failed", "", "", "", "")
        bound = "" if self.resolved else "<"
        return (
            *named,
            f"{bound}{self.error:.2e}",
            f"{self.seconds:.2e}",
            f"{100.0 * self.spread:.0f} %",
            str(self.right_hand_sides),
            str(self.factorisations),
        )


@saved_as("Trade")
class Trade(TableResult):
    """Error against cost of models of one pipe for one quantity.

    Attributes:
        pipe: the pipe.
        quantity: the question that was asked, with its conditions.
        reference: the answer of the continuous pipe, with a bound on its relative error.
        rows: one row for each model, family after family, by increasing size.
    """

    pipe: Pipe
    quantity: Quantity
    reference: Answer
    rows: tuple[TradeRow, ...] = field(repr=False)

    def of(self, family: str) -> tuple[TradeRow, ...]:
        """The rows of one family, by a name in `families`."""
        family = check.choice("family", family, self.families)
        return tuple(row for row in self.rows if row.family == family)

    @property
    def families(self) -> tuple[str, ...]:
        """Names of the measured families."""
        return tuple(dict.fromkeys(row.family for row in self.rows))

    @property
    def failures(self) -> tuple[TradeRow, ...]:
        """The rows that failed."""
        return tuple(row for row in self.rows if row.failure is not None)

    def pareto(self, cost: Cost = "seconds") -> tuple[TradeRow, ...]:
        """The Pareto front of error and cost, the cheapest row first.

        No row outside the front is better in both than a row on it.

        Args:
            cost: "seconds", "dof", "right_hand_sides" or "factorisations".

        Example:
            >>> found = pp.trade(pp.Pipe(0.2), "critical_speed", sizes=[4, 8], repeats=1)
            >>> front = found.pareto("dof")
            >>> [(row.dof, row.error < 1e-6) for row in front]
            [(4, False), (8, True)]
        """
        cost = check.choice("cost", cost, COSTS)
        good = [row for row in self.rows if math.isfinite(row.error)]
        front: list[TradeRow] = []
        for row in sorted(good, key=lambda row: (getattr(row, cost), row.error)):
            if not front or row.error < front[-1].error:
                front.append(row)
        return tuple(front)

    def orders(self) -> dict[str, ConvergenceLaw]:
        """Laws of the errors by family, fitted to the sizes up to which the errors fall."""
        return {family: self._order(family) for family in self.families}

    def _order(self, family: str) -> ConvergenceLaw:
        floor = self.quantity.floor
        rows = [row for row in self.of(family) if row.resolved and floor < row.error < math.inf]
        sizes = np.array([float(row.size) for row in rows])
        return fitted_law(sizes, np.array([row.error for row in rows]))

    def _table(self) -> Table:
        title = (
            f"{self.quantity} of {self.pipe}\n"
            f"reference: {self.reference.source}, error below {self.reference.error:.1e}"
        )
        headings = ("family", "size", "dof", "error", "seconds", "spread", "rhs", "factorisations")
        notes = [f"{row.family} {row.size} failed: {row.failure}" for row in self.failures]
        return Table(title, headings, [row.cells for row in self.rows], numbers=True, notes=notes)

    def __str__(self) -> str:
        return self._table().text()

    def _columns(self) -> dict[str, Any]:
        names = [one.name for one in fields(TradeRow) if one.name not in ("failure", "values")]
        columns = {name: [getattr(row, name) for row in self.rows] for name in names}
        failures = ["" if row.failure is None else str(row.failure) for row in self.rows]
        return columns | {"failure": failures}


def trade(
    pipe: Pipe,
    quantity: QuantityName,
    *,
    families: Any = None,
    sizes: Mapping[str, ArrayLike] | ArrayLike | None = None,
    repeats: int = 3,
    progress: bool = False,
    **conditions: Any,
) -> Trade:
    """Error against cost for chains and reduced models of growing size.

    Args:
        pipe: the pipe.
        quantity: name of the question, whose conditions are further arguments:
            "critical_speed" (max_speed=100: the lowest crossing that destabilises),
            "frequencies" (u=0, count=4: eigenvalues of the lowest modes, with damping delta those
            below 0.9 / delta),
            "root_loci" (speeds, count=4: branches of eigenvalues),
            "motion" (u, duration, start=theta(s), rates=dtheta/dt(s), samples=201, rtol=1e-8: the
            path of the free end, from the least damped mode if no start is given),
            "limit_cycle" (u, rtol=1e-8: amplitude and frequency). The first three also take
            dimensions=3, for motions across the plane in which a load bends the pipe as well.
        families: what to measure: spring rules ("consistent", "midpoint", "rayleigh", "uniform",
            "frequency"), bases ("beam", "legendre"), Richardson's extrapolation from chains of n
            and 2 n ("consistent pair", ...), or "chain", "reduced" or "pair" for all of a kind.
        sizes: number of segments or functions, or several in increasing order, for all families; or
            a mapping from the words for families to their sizes. If not given, an answer that takes
            more than 10 s of processor time is given up.
        repeats: how often each answer is timed; the shortest time counts.
        progress: whether to show progress on stderr.
        **conditions: conditions of the quantity; with units="si" speeds are in m/s and a duration
            in s, if the pipe has scales.

    Returns:
        Trade. If a model fails or is too small for the quantity, its row holds the exception.
        Errors less than ten times that of the reference are given as bounds (`resolved` is False).
        Counts of right-hand sides of a motion may differ from run to run by a step of the
        integrator, because of rounding.

    Example:
        >>> found = pp.trade(pp.Pipe(0.2), "critical_speed", sizes=[4, 8], repeats=1)
        >>> {row.size for row in found.rows}
        {8, 4}

    Raises:
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no answer, or if no two models
            confirm an answer within half a minute.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    asked = checked_quantity(quantity, conditions, pipe).prepared(pipe)
    if asked.sees_one_plane_of(pipe):
        warn_of_plane(__name__)
    chosen = checked_families("families", families, USUAL)
    wanted = _sizes(sizes, chosen, asked.least)
    every = [(family, size) for family in chosen for size in wanted[family.name]]
    repeats = check.count("repeats", repeats, high=1000)
    shown = check.flag("progress", progress)
    reference = asked.reference(pipe, 1e-12)
    if not reference.error < 1.0:
        raise NotConverged(
            f"the continuous pipe's answer is not known: {reference.source}, and the last step "
            f"moved it by {reference.error:.1e}",
            reference,
        )
    patience = math.inf if sizes is not None else LONGEST_ANSWER
    rows = [
        measure_model(pipe, asked, family, size, reference, repeats, patience)
        for family, size in track(every, len(every), "models", shown)
    ]
    return Trade(pipe, asked, reference, tuple(rows))


def _sizes(given: Any, families: Sequence[ModelFamily], least: int) -> dict[str, tuple[int, ...]]:
    """Sizes to measure by the names of families, from the argument `sizes`."""
    own = {one.name: tuple(size for size in one.sizes if size >= least) for one in families}
    if given is None:
        return own
    if not isinstance(given, Mapping):
        return dict.fromkeys(own, _increasing(given))
    checked_families("sizes", tuple(given), ())
    for word, sizes in given.items():
        own |= dict.fromkeys(GROUPS.get(word, (word,)), _increasing(sizes))
    return own


def _increasing(given: Any) -> tuple[int, ...]:
    raw = np.atleast_1d(check.numbers("sizes", given, "whole numbers", kinds="iu", longest=1000))
    sizes = tuple(int(size) for size in raw.flat)  # differences of unsigned integers would overflow
    if raw.ndim != 1 or not sizes or sizes[0] < 1 or any(b <= a for a, b in pairwise(sizes)):
        raise ValueError(
            f"sizes must be whole numbers from 1 on, increasing, got {check.shown(given)}"
        )
    return sizes


def measure_model(
    pipe: Pipe,
    quantity: Quantity,
    family: ModelFamily,
    size: int,
    reference: Answer,
    repeats: int,
    patience: float = math.inf,
) -> TradeRow:
    """Error and cost of one model, which fails if its answer takes more than `patience` seconds."""
    times: list[float] = []
    dof, begin = 0, clock()
    try:
        while len(times) < repeats and sum(times) < LONGEST_ANSWER:
            models = family.models(pipe, size, quantity.dimensions)
            dof = sum(model.dof for model in models)
            if models[0].dof < quantity.least:
                raise ValueError(f"size must be at least {quantity.least} here, got {size}")
            with count_work() as counters, time_limit(patience):
                start = clock()
                answers = [quantity.answer(model) for model in models]
                answer = answers[0]
                if family.paired:  # the order of a pair is twice that of one model
                    answer = quantity.extrapolated(answers[0], answers[1], 0.5 * family.order)
                times.append(clock() - start)
    except Exception as failure:
        taken = clock() - begin
        return TradeRow(family.name, size, dof, math.nan, False, taken, math.nan, 0, 0, failure)
    error = quantity.distance(answer, reference)
    return TradeRow(
        family=family.name,
        size=size,
        dof=dof,
        error=max(error, reference.error) if error < MARGIN * reference.error else error,
        resolved=error >= MARGIN * reference.error,
        seconds=min(times),
        spread=max(times) / min(times) - 1.0,
        right_hand_sides=counters.right_hand_sides,
        factorisations=counters.factorisations,
        values=answer.values,
    )


CANDIDATES = ("legendre", "beam", "consistent", "midpoint")
"""Families to choose among if none are named: reduced models, and chains of the highest order."""

FINEST_ERROR = RTOL
"""Least error that matters if only a budget is given: the tolerance to which motions and cycles are
then solved."""

LADDER_START = 4
"""Size at which the first ladder starts: linear answers of smaller models cost as much."""

PATIENCE = 2.0 * LONGEST_REFERENCE
"""Longest time of one answer in seconds; models that would take longer are not tried or are given
up. The limit cycle of the largest chain in `convergence.DOUBLED` takes a tenth of it."""

GAIN = 0.7
"""More models of a family are measured only if they may take less than this share of the best time
so far, or of the budget. Repeated times of one answer differ by as much."""


@saved_as("Tried")
class Tried(Result):
    """The last measurement of a family, if any, and the reason why the family was not chosen."""

    family: str
    row: TradeRow | None
    why: str


@saved_as("Choice")
class Choice(Result):
    """The model that `choose` found.

    Attributes:
        models: the model, or the two models from whose answers the answer is extrapolated.
        row: the measured error and cost of the model.
        tolerance: the relative error asked for; None if only a budget was given.
        budget: the time asked for, in seconds an answer; None if only a tolerance was given.
        reference: the answer with which models were compared, and a bound on its own error.
        steady: whether the next larger size meets the tolerance as well. If not, the model meets it
            because its error changes sign, which holds for this pipe and this question only. None
            if no tolerance was given.
        tried: an entry for each family, with the reason why it was not chosen.
        seconds: duration of the search, including the reference.
        quantity: the question that was asked.
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
        """The model; for a pair the larger one, whose own answer is worse than `answer`."""
        return self.models[-1]

    @property
    def answer(self) -> NDArray[Any]:
        """The answer of the model when it was measured; for a pair the extrapolated value.

        The answer is a critical speed, shape (1,); eigenvalues, shape (K,), or at S speeds, shape
        (S, K); positions of the free end, shape (S, 2); or amplitude and frequency of a cycle,
        shape (2,).
        """
        assert self.row.values is not None
        return self.row.values

    @property
    def error(self) -> float:
        """Bound on the relative error: the measured error plus that of the reference."""
        return self.row.error + self.reference.error

    @property
    def cost(self) -> float:
        """Measured time of one answer, in seconds."""
        return self.row.seconds

    @property
    def family(self) -> str:
        """Name of the family of the model."""
        return self.row.family

    @property
    def size(self) -> int:
        """Number of segments or functions; for a pair those of the smaller model."""
        return self.row.size

    def _shown(self) -> dict[str, Any]:
        names = "models", "error", "cost", "tolerance", "budget", "steady", "quantity"
        values = {name: getattr(self, name) for name in names}
        return {name: value for name, value in values.items() if value is not None}

    def _table(self) -> Table:
        sizes = " and ".join(str(model.dof) for model in self.models)
        pair = f", extrapolated from n = {sizes}" if len(self.models) > 1 else ""
        title = (
            f"{self.model!r}{pair}\nerror {self.error:.1e} (reference: {self.reference.source}, "
            f"{self.reference.error:.1e}), {1e3 * self.cost:.3g} ms an answer"
        )
        if self.steady is False:
            title += "\nits error changes sign here: the next larger size misses the tolerance"
        rows = [(one.family, one.why) for one in self.tried if one.why]
        return Table(title, ("family", "why it was not chosen"), rows)

    def __str__(self) -> str:
        return self._table().text()


@saved_as("NoModel")
class NoModel(PipedynError):
    """No model meets the tolerance or the budget.

    Attributes:
        tried: an entry for each family, with the reason why none of its models was chosen.
        nearest: the row nearest to the demand; None if every model failed.
    """

    def __init__(self, message: str, tried: tuple[Tried, ...], nearest: TradeRow | None) -> None:
        super().__init__(message, tried, nearest)
        self.tried, self.nearest = tried, nearest


def choose(
    pipe: Pipe,
    quantity: QuantityName,
    tolerance: float | None = None,
    budget: float | None = None,
    among: Any = None,
    *,
    repeats: int = 1,
    **conditions: Any,
) -> Choice:
    """The cheapest model that meets a tolerance, or the most accurate one within a budget.

    The error is measured, for this pipe and this question, against an answer of the continuous pipe
    whose own error is at most a tenth of the tolerance, if possible. If no rtol is given, a motion
    is integrated with a hundredth of the tolerance, and a cycle with a tenth. Families are measured
    one after the other; a further family is measured only if it may be 30 % cheaper than the best
    so far, because repeated times of one answer differ by as much. tests/benchmark_choose.py
    measures the cost of a search in answers of the model chosen.

    Args:
        pipe: the pipe.
        quantity: name of the question, as for `trade`.
        tolerance: largest relative error, in [1e-10, 0.5].
        budget: largest time of an answer in seconds, > 0. If both are given, both must be met.
        among: families, as for `trade`; if not given, the reduced models and the chains of second
            order.
        repeats: how often each answer is timed; the shortest time counts.
        **conditions: conditions of the quantity, as for `trade`.

    Returns:
        Choice. If its `steady` is False, the model meets the tolerance only because its error
        changes sign, and a slightly larger model of its family does not meet it.

    Example:
        >>> pipe = pp.Pipe(0.2)
        >>> found = pp.choose(pipe, "critical_speed", tolerance=1e-3)
        >>> type(found.model).__name__, found.error <= 1e-3
        ('Galerkin', True)

    Raises:
        NoModel: if no model meets the tolerance or the budget; the message names the nearest one.
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no answer, or none is found in
            half a minute.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    if tolerance is None and budget is None:
        raise ValueError("tolerance or budget must be given")
    if tolerance is not None:
        tolerance = check.real("tolerance", tolerance, low=1e-10, high=0.5)
    if budget is not None:
        budget = check.real("budget", budget, low=0.0, high=1e6, open_low=True)
    asked = checked_quantity(quantity, conditions, pipe, tolerance)
    if asked.sees_one_plane_of(pipe):
        warn_of_plane(__name__)
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
        models=FAMILIES[row.family].models(pipe, row.size, asked.dimensions),
        row=row,
        tolerance=tolerance,
        budget=budget,
        reference=reference,
        steady=None if tolerance is None else search.is_robust(row, tolerance),
        tried=_last_rows(search, row),
        seconds=time.perf_counter() - start,
        quantity=asked,
    )


def _last_rows(search: ModelSearch, chosen: TradeRow | None) -> tuple[Tried, ...]:
    """An entry for each family: its last measured row, and the reason why it was not chosen."""
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
    """The exception to raise if no model meets the demand."""
    tried = _last_rows(search, None)
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
    """A search among families of models of one pipe.

    Attributes:
        rows: measurements so far by family and size; each model is measured once.
        reasons: why no more sizes of a family were measured, by its name; empty if the errors and
            times of the family show the reason.
    """

    pipe: Pipe
    quantity: Quantity
    reference: Answer
    families: list[ModelFamily]  # the family of fastest convergence first
    repeats: int
    rows: dict[tuple[str, int], TradeRow] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)

    def cheapest(self, tolerance: float) -> TradeRow | None:
        """The fastest row among the smallest models of each family that meet a tolerance."""
        best: TradeRow | None = None

        def serves(row: TradeRow) -> bool:
            return self.bound(row) <= tolerance

        for family in self.families:
            dof, limit, patience = family.dof(LADDER_START), PATIENCE, PATIENCE
            if best is not None:
                dof, limit = math.ceil(GAIN * best.dof), GAIN * best.seconds
                # Times scatter, but an answer that takes twice the best time cannot be the best.
                patience = min(2.0 * best.seconds, PATIENCE)
            row = self._climb(family, dof, serves, tolerance, limit, patience)
            if row is not None and (best is None or row.seconds < best.seconds):
                best = row
        return best

    def most_accurate(self, budget: float) -> TradeRow | None:
        """The row of least error within a budget, down to errors that the reference resolves."""
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
        """Whether the next larger size in the family of a row meets the tolerance as well."""
        family = FAMILIES[row.family]
        larger = self._measure(family, family.beyond(row.size), PATIENCE)
        return self.bound(larger) <= tolerance

    def nearest(self, tolerance: float | None) -> TradeRow | None:
        """The most accurate row, or the fastest of those within the tolerance if there are any."""
        rows = [row for row in self.rows.values() if row.failure is None]
        good = [row for row in rows if tolerance is None or self.bound(row) <= tolerance]
        return min(good, key=lambda row: row.seconds, default=self._within(math.inf))

    def bound(self, row: TradeRow) -> float:
        """Bound on the true error of a row; infinite if the model failed."""
        bound = row.error + self.reference.error
        return bound if math.isfinite(bound) else math.inf

    def _measure(self, family: ModelFamily, size: int, patience: float) -> TradeRow:
        """The row of one model, which is measured unless it was measured before."""
        key = (family.name, size)
        if key not in self.rows:
            given = (self.reference, self.repeats, patience)
            self.rows[key] = measure_model(self.pipe, self.quantity, family, size, *given)
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
        """The row of a size of a family for which `serves` holds, but not for the size below it.

        Sizes go up from `dof` degrees of freedom until `serves` holds. The result is None if no
        size whose answer takes up to `limit` seconds can bring the error down to `target`. An
        answer is given up after `patience` seconds.
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
                # If errors follow a law, two or three guesses find the size; else bisection does.
                guess = self._needed(family, row, target) if cuts < 3 else None
                size = min(max(guess or (bad + good) // 2, bad + 1), good - 1)
                cuts += 1
        return self.rows.get((family.name, good))

    def _needed(self, family: ModelFamily, row: TradeRow, target: float) -> int | None:
        """The size at which the error meets a target, extrapolated from a row by a power law.

        The exponent is the order of the family; the result is None if no power law holds. The
        paper's springs converge with order 2 to a limit of their own.
        """
        error = self.bound(row)
        if math.inf in (error, target, family.order):
            return None
        return math.ceil(row.size * math.pow(error / target, 1.0 / (family.order or 2.0)))

    def _is_hopeless(
        self, family: ModelFamily, row: TradeRow, most: int, target: float, limit: float
    ) -> bool:
        """Whether no larger size of a family need be measured after a row that does not serve."""
        error, needed = self.bound(row), self._needed(family, row, target) or row.size
        # The time of an answer grows at least linearly and at most with the cube of the size.
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
    """Size, error and time of a row in words, or its failure."""
    if row.failure is not None:
        return f"size {row.size} failed: {row.failure}"
    return f"size {row.size} has an error of {row.error:.1e} and takes {1e3 * row.seconds:.3g} ms"
