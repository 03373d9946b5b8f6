# SPDX-License-Identifier: MIT
"""Measured error and cost of chains and reduced models of growing size, for one reference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field, fields
from itertools import pairwise
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.accuracy.convergence import (
    GROUPS,
    ConvergenceLaw,
    ModelFamily,
    checked_families,
    fitted_law,
)
from pipedyn.accuracy.quantities import MARGIN, Answer, Quantity, QuantityName, checked_quantity
from pipedyn.models.pipe import Pipe, checked_pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.counters import clock, counted, limited
from pipedyn.util.errors import NotConverged
from pipedyn.util.parallel import track
from pipedyn.util.result import Result, TableResult
from pipedyn.util.table import Table

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
            "limit_cycle" (u, rtol=1e-8: amplitude and frequency).
        families: what to measure: spring rules ("consistent", "midpoint", "rayleigh", "uniform",
            "frequency"), bases ("beam", "legendre"), Richardson's extrapolation from chains of n
            and 2 n ("consistent pair", ...), or "chain", "reduced" or "pair" for all of a kind.
        sizes: number of segments or functions, or several in increasing order, for all families; or
            a mapping from the words for families to their sizes. If not given, an answer that takes
            more than 10 s of processor time is given up.
        repeats: how often each answer is timed; the shortest time counts.
        progress: whether to show progress on stderr.
        **conditions: conditions of the quantity.

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
        NoCrossing, NoCycle, NotConverged: if the continuous pipe has no answer, or if no answer
            that the next larger model confirms is found in half a minute.
        ValueError, TypeError: for bad arguments.
    """
    pipe = checked_pipe(pipe)
    asked = checked_quantity(quantity, conditions).prepared(pipe)
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
        measured(pipe, asked, family, size, reference, repeats, patience)
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


def measured(
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
            models = family.models(pipe, size)
            dof = sum(model.dof for model in models)
            if models[0].dof < quantity.least:
                raise ValueError(f"size must be at least {quantity.least} here, got {size}")
            with counted() as counters, limited(patience):
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
