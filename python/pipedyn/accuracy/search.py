# SPDX-License-Identifier: MIT
"""The search for the cheapest model: in each family a ladder of sizes, then bisection.

A ladder starts at the size that the family's order of convergence lets expect. Its next sizes
follow from the errors found, each step at least twice the one before, up to the largest model of
the family: a size that fails does not end it, as errors need not fall monotonically. Between the
last size that fails and the first that serves, bisection finds two neighbours.

Linear questions have estimates of a model's error, at a tenth of an answer's cost. No model is
chosen before its error was measured. Where a measurement contradicts the estimate, the family's
errors are measured from there on. Motions and cycles have no estimates: every size is measured, as
far as it may cost less than the best model so far.

For a budget the same ladder finds the largest size that the budget pays for.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping

import numpy as np

from pipedyn.accuracy.convergence import fitted_law
from pipedyn.accuracy.families import FAMILIES, RULES, Family, expected_size
from pipedyn.accuracy.quantities import Quantity
from pipedyn.accuracy.reference import Reference
from pipedyn.accuracy.trade import SHARPER, TradeRow, measured
from pipedyn.models.base import PipedynError
from pipedyn.models.pipe import Pipe

LARGEST = {"legendre": 60, "beam": 400}
"""Functions. 60 Legendre functions resolve waves of 120 / L; the quadrature of beam modes takes a
second from 400 on. Chains are tried up to the most that the quantity can be asked of."""

PATIENCE = 60.0
"""Seconds: a model that would take longer for an answer is not tried, or given up. A user waits
that long once."""

WORTH = 0.7
"""Share of the best cost so far that a model must promise to be measured: times of one answer
scatter by as much."""

TELLING = 0.5
"""Error above which a model is too coarse to tell how the errors fall."""

DECADES = 0.9
"""Decades by which one more Legendre function lowers the error: 0.8 to 1.1 for critical speeds
(tests/test_convergence.py)."""

CHEAP = 12
"""Size up to which a motion or a cycle is measured before any price is known: tenths of a second
at the most."""

NEIGHBOURS = 0.07
"""Relative distance of sizes at which bisection of motions and cycles ends: their costs then differ
by a tenth."""

COMPARED = 2
"""Linear models measured where several of about equal size serve: the cheapest of two."""

LONG = 80
"""Size from which a linear answer may take a second: a smaller one is timed before it, and one
whose estimate failed is not measured."""

SCATTER, SPENT, FULL = 1.5, 0.9, 0.7
"""For a budget: by how much a time may be wrong, as predicted or as measured once; the share of the
budget that a size should take; and the share that is as good as all of it."""


class _Stop(Exception):
    """The end of a family's ladder: its argument says why."""


def predicted(order: float, known: Mapping[int, float], target: float) -> float:
    """The size at which values that fall with the size come down to a target.

    Args:
        order: of their fall, a power of the size; infinite where they fall exponentially. Two
            known values correct it by up to a factor of two.
        known: values by sizes, infinite where they tell nothing.
        target: value, > 0.

    Returns:
        A size, at most three times the nearest known one or six functions beside it.
    """
    exponential = order == math.inf
    slope = DECADES if exponential else order
    decades = {n: math.log10(max(v, 1e-16) / target) for n, v in known.items() if v < math.inf}
    near = sorted(decades, key=lambda n: abs(decades[n]))[:2]
    if not near:
        return 1.5 * max(known)
    if len(near) > 1:
        a, b = near
        apart = a - b if exponential else math.log10(a / b)
        slope = min(max((decades[b] - decades[a]) / apart, 0.5 * slope), 2.0 * slope)
    size, farthest = near[0], 6.0 if exponential else math.log10(3.0)
    step = min(max(decades[size] / slope, -farthest), farthest)
    return size + step if exponential else size * 10.0**step


def ladder(
    value: Callable[[int], float],
    target: float,
    order: float,
    start: int,
    sizes: tuple[int, int],
    known: Mapping[int, float],
    apart: float = 0.0,
) -> int | None:
    """The smallest size of which the value lies within the target, and not that of the next less.

    Args:
        value: of a size.
        target: largest value that serves, > 0.
        order: of the values' fall, as for `predicted`.
        start: first size, where none is known.
        sizes: the least and the largest.
        known: values by sizes, known before.
        apart: relative distance from the next less at which a size is small enough.

    Returns:
        The size; None where none was found up to the largest.
    """
    least, most = sizes
    values = dict(known)
    good = min((n for n, one in values.items() if one <= target), default=most + 1)
    bad = max((n for n, one in values.items() if one > target and n < good), default=least - 1)
    rung, cuts = 1, 0
    while good - bad > max(1.0, apart * bad):
        size = math.ceil(predicted(order, values, target)) if values else start
        if good <= most and bad >= least:  # bisection, if predictions do not end it in three cuts
            size = (bad + good) // 2 if cuts > 2 else min(max(size, bad + 1), good - 1)
            cuts += 1
        elif values:
            size = max(size, bad + rung) if good > most else min(size, good - rung)
        size = min(max(size, least), most)
        values[size] = value(size)
        rung *= 2
        if values[size] <= target:
            good = size
        else:
            bad = size
    return good if good <= most else None


def price(known: Mapping[int, float], size: int, growth: float) -> float:
    """Seconds of an answer: growing with the size as they have, and as `growth` at the least."""
    near = sorted(known, key=lambda one: abs(math.log(one / size)))[:2]
    if not near:
        return 0.0
    if len(near) > 1:
        observed = math.log(known[near[0]] / known[near[1]]) / math.log(near[0] / near[1])
        growth = min(max(0.7 * observed, growth), 3.0)
    seconds: float = known[near[0]] * (size / near[0]) ** growth
    return seconds


def _check_fall(known: Mapping[int, float], tolerance: float, most: int) -> None:
    """Ends a ladder of measurements whose errors will not come down to the tolerance."""
    telling = sorted((n, error) for n, error in known.items() if error < math.inf)
    if len(telling) < 2:
        return
    (a, coarse), (b, fine) = telling[-2:]
    order = max(math.log(coarse / fine) / math.log(b / a), 0.0)
    if fine > tolerance and fine * (b / most) ** order > 2.0 * tolerance:
        raise _Stop(f"size {b} has an error of {fine:.1e}, and larger ones fall too slowly")


def _shortfall(known: Mapping[int, float]) -> str:
    """Why no size of a family serves, by its errors."""
    telling = {n: error for n, error in sorted(known.items()) if error < math.inf}
    if not telling:
        return f"size {max(known)} has no answer near the reference's"
    size = min(telling, key=telling.__getitem__)
    law = fitted_law(np.array([float(n) for n in telling]), np.array([*telling.values()]))
    text = f"size {size} has an error of {telling[size]:.1e} still"
    if law.law == "flat":
        text += f", and larger ones tend to {abs(law.limit):.2g}: it has another limit"
    return text


class Search:
    """Models of one pipe asked so far, each once.

    Attributes:
        rows: what was measured, by family and size.
        estimates: errors that were estimated, by family and size.
        left: families that were left, and why.
    """

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
        self.estimates = {
            (reference.family, size): error + reference.error
            for size, error in reference.smaller
            if FAMILIES[reference.family] in families
        }
        self.left: dict[str, str] = {}
        self._contradicted: set[str] = set()
        self._thorough = False

    def measure(self, family: Family, size: int) -> TradeRow:
        """The row of one model."""
        key = (family.name, size)
        if key not in self.rows:
            self.rows[key] = self._measured(family, size)
        return self.rows[key]

    def _measured(self, family: Family, size: int) -> TradeRow:
        return measured(
            *(self.pipe, self.quantity, family, size, self.reference, self.repeats, PATIENCE)
        )

    def bound(self, row: TradeRow) -> float:
        """Bound on the true error; infinite where the model failed."""
        bound = row.error + self.reference.error
        return bound if math.isfinite(bound) else math.inf

    def error(self, family: Family, size: int, thorough: bool = False) -> float:
        """Bound on a model's error: measured, or else estimated where the question allows.

        Args:
            family: the family.
            size: of the model.
            thorough: whether it is measured where no estimate is found; else it is infinite then.
        """
        key = (family.name, size)
        estimate = None if key in self.rows else self._estimate(family, size)
        missed = estimate == math.inf and thorough and size <= LONG
        return self.bound(self.measure(family, size)) if estimate is None or missed else estimate

    def _estimate(self, family: Family, size: int) -> float | None:
        """A model's error without measurement, infinite where it is not found; None if unasked."""
        key = (family.name, size)
        if family.name in self._contradicted:
            return None
        if key not in self.estimates and self._is_estimable(family):
            try:
                model = family.models(self.pipe, size)[0]
                found = self.quantity.estimate(model, self.reference.answer)
            except (PipedynError, ValueError, np.linalg.LinAlgError):
                found = None
            self.estimates[key] = math.inf if found is None else found + self.reference.error
        return self.estimates.get(key)

    def _is_estimable(self, family: Family) -> bool:
        estimable = self.reference.is_estimable and not family.paired
        return estimable and family.name not in self._contradicted

    def is_robust(self, row: TradeRow, tolerance: float) -> bool:
        """Whether the next larger size meets the tolerance too."""
        family = FAMILIES[row.family]
        return self.error(family, family.beyond(row.size), thorough=True) <= tolerance

    # ------------------------------------------------------------------------- for a tolerance

    def cheapest(self, tolerance: float) -> TradeRow | None:
        """The cheapest row that meets a tolerance; None only after a thorough search."""
        for self._thorough in (False, True):
            self._compare(tolerance)
            best = self._best(tolerance)
            if best is not None or not self.reference.is_estimable:
                break
        if best is not None and self.quantity.is_linear:
            family, size = FAMILIES[best.family], best.size - 1
            while size >= self._range(family)[0] and self.error(family, size) == math.inf:
                if self.error(family, size, thorough=True) > tolerance:
                    break
                size -= 1  # it serves, though its error could not be estimated
        return self._best(tolerance)

    def _best(self, tolerance: float) -> TradeRow | None:
        """The row of least time that meets a tolerance, or a smaller one of about that time."""
        good = [row for row in self.rows.values() if self.bound(row) <= tolerance]
        best = min(good, key=lambda row: row.seconds, default=None)
        if best is None:
            return None
        alike = (r for r in good if r.family == best.family and WORTH * r.seconds <= best.seconds)
        return min(alike, key=lambda row: row.size)

    def _compare(self, tolerance: float) -> None:
        """Measures the candidates of all families, the smallest first, as far as they may pay."""
        sizes: dict[Family, int] = {}
        room, compared = math.inf, 0
        for family in self._ordered(tolerance):
            self.left.pop(family.name, None)
            size = self._smallest(family, tolerance, room)
            if size is not None:
                sizes[family] = size
                room = min(room, self.quantity.comparable_dof(family.dof(size)))
        for family, size in sorted(sizes.items(), key=lambda one: one[0].dof(one[1])):
            best = self._best(tolerance)
            if best is not None and (family.name, size) not in self.rows:
                room = self.quantity.comparable_dof(best.dof)
                if compared >= COMPARED or family.dof(size) > room:
                    self.left[family.name] = f"size {size} may serve, and costs more"
                    continue
            try:
                self._check_price(family, size, PATIENCE)
            except _Stop as stop:
                self.left[family.name] = str(stop)
                continue
            compared += 1
            if self.bound(self.measure(family, size)) > tolerance:
                self._contradicted.add(family.name)
                self._compare(tolerance)  # without what was left because of this size
                return

    def _ordered(self, tolerance: float) -> list[Family]:
        """Families in the order of asking: those of which errors are known, then the small."""

        def turn(family: Family) -> tuple[bool, bool, float]:
            size = self._expected(family, tolerance)
            return family.name != self.reference.family, family.order == 0.0, family.dof(1) * size

        return sorted(self.families, key=turn)

    def _expected(self, family: Family, tolerance: float) -> float:
        """About the size that the tolerance takes."""
        size = expected_size(family, self.reference.wave_number, tolerance)
        return size + family.for_terms(self.pipe)

    def _range(self, family: Family) -> tuple[int, int]:
        """The least and the largest size of a family that may be asked."""
        least, most = max(1, self.quantity.least), self.quantity.most
        largest = LARGEST.get(family.name, most) + family.for_terms(self.pipe)
        most = min(largest, most // 2 if family.paired else most)
        why = self.quantity.excluded(self.pipe, family.name)
        if most < least:
            why = f"the question takes {least} degrees of freedom, models have up to {most}"
        if why:
            raise _Stop(why)
        return least, most

    def _smallest(self, family: Family, tolerance: float, room: float) -> int | None:
        """The smallest size found to meet the tolerance, with at most so many degrees of freedom.

        Where there is none, `left` says why.
        """
        estimable, known = self._is_estimable(family), self._known(family)
        best, limit = self._best(tolerance), PATIENCE
        if best is not None and best.family != family.name:
            limit = min(limit, WORTH * best.seconds)

        def value(size: int) -> float:
            if not estimable and (family.name, size) not in self.rows:
                self._check_price(family, size, limit)
                if family.order < math.inf:
                    _check_fall(known, tolerance, most)
            error = self.error(family, size, self._thorough)
            known[size] = error if error <= TELLING else math.inf
            return known[size]

        def climb() -> int | None:
            order = family.order or 2.0  # the paper's rule, until it comes near its own limit
            return ladder(value, tolerance, order, start, (least, most), known, apart)

        try:
            least, most = self._range(family)
            if room < math.inf:
                most = min(most, max(math.floor(room / family.dof(1)), least))
            expected = self._expected(family, tolerance)
            start = max(math.ceil(min(expected, most if estimable else CHEAP)), least)
            apart = 0.0 if self.quantity.is_linear else NEIGHBOURS
            found = climb()
            if found is None and self._thorough:
                size = least
                while size <= most and value(size) > tolerance:
                    size = max(size + 1, (5 * size) // 4)
                found = climb()
            if found is None:
                raise _Stop(_shortfall(known))
            return found
        except _Stop as stop:
            self.left[family.name] = str(stop)
            return min((n for n, error in known.items() if error <= tolerance), default=None)

    def _known(self, family: Family) -> dict[int, float]:
        """Errors by size, as far as they were found."""
        known = {n: error for (name, n), error in self.estimates.items() if name == family.name}
        if family.name in self._contradicted:
            known = {}
        known |= {n: self.bound(row) for (name, n), row in self.rows.items() if name == family.name}
        return {size: error for size, error in known.items() if error <= TELLING}

    def _check_price(self, family: Family, size: int, limit: float) -> None:
        """Ends a ladder where an answer would take longer than some seconds, by smaller ones'."""
        if (family.name, size) in self.rows:
            return
        dof = family.dof(size)
        if (
            self.quantity.is_linear
            and size > LONG
            and max(self._seconds(family), default=0) < dof // 4
        ):
            self.measure(family, min(size // 2, 2 * LONG))
        seconds = price(self._seconds(family), dof, self.quantity.growth)
        if seconds > limit:
            raise _Stop(f"size {size} would take some {1e3 * seconds:.3g} ms")

    def _seconds(self, family: Family) -> dict[int, float]:
        """Times by degrees of freedom: linear answers of all families cost about alike.

        Of motions and cycles chains of all rules do.
        """
        alike = RULES if family.name in RULES else (family.name,)
        return {
            row.dof: row.seconds
            for row in self.rows.values()
            if row.failure is None and (self.quantity.is_linear or row.family in alike)
        }

    # ---------------------------------------------------------------------------- for a budget

    def sharpest(self, budget: float) -> TradeRow | None:
        """The row of least error within a budget, down to what the reference can tell."""
        aim = max(SHARPER * self.reference.error, self.quantity.floor)
        for family in self._ordered(aim):
            try:
                self._spend(family, budget, aim)
            except _Stop as stop:
                self.left[family.name] = str(stop)
        return self._sharpest(budget)

    def _sharpest(self, budget: float) -> TradeRow | None:
        within = [row for row in self.rows.values() if row.seconds <= budget]
        good = [row for row in within if self.bound(row) < math.inf]
        return min(good, key=self.bound, default=None)

    def _spend(self, family: Family, budget: float, aim: float) -> None:
        """Measures a family up to the largest size within the budget, or one at the aim.

        Always ends with the reason why no other size is asked.
        """
        least, most = self._range(family)
        growth = self.quantity.growth
        known, dear = self._seconds(family), SCATTER * min(budget, PATIENCE)
        sizes = range(1, most + 1)
        last = bisect_right(sizes, dear, key=lambda n: price(known, family.dof(n), growth))
        if last < least:
            raise _Stop("its smallest would take longer")
        best = self._sharpest(budget)
        if best is not None and not best.resolved:
            raise _Stop(f"the reference cannot tell it from {best.family} of size {best.size}")
        if best is not None and self._is_estimable(family):
            error = self.error(family, last)
            if error >= self.bound(best):
                raise _Stop(f"size {last}, the most in this time, has an error of {error:.1e}")
        elif best is not None and self._expected(family, self.bound(best)) > last:
            raise _Stop(f"no smaller error is expected up to size {last}")

        def value(size: int) -> float:
            """Budget over cost, which falls below 1 where nearly all is spent."""
            self._check_price(family, size, PATIENCE)
            row = self.measure(family, size)
            if budget < row.seconds < SCATTER * budget:  # once more, as times scatter
                row = min(row, self._measured(family, size), key=lambda one: one.seconds)
                self.rows[family.name, size] = row
            if row.seconds <= budget and (row.error <= aim or row.seconds >= FULL * budget):
                raise _Stop(described(row))
            return SPENT * budget / row.seconds if row.failure is None else math.inf

        wanted = min(self._expected(family, aim), most)
        start = max(math.ceil(min(wanted, last / SCATTER if last < most else CHEAP)), least)
        ladder(value, 1.0, growth, start, (least, most), {}, 1.0 - SPENT)
        size = max(size for name, size in self.rows if name == family.name)
        raise _Stop(described(self.rows[family.name, size]))

    # ------------------------------------------------------------------------- where none is found

    def nearest(self, tolerance: float | None) -> TradeRow | None:
        """The row that comes nearest to a tolerance, or to a time where it is met.

        A row that is only estimated has no time. None where no family was asked.
        """
        rows = list(self.rows.values())
        for (name, size), error in self.estimates.items():
            if (name, size) not in self.rows and name not in self._contradicted:
                dof, own = FAMILIES[name].dof(size), error - self.reference.error
                rows.append(TradeRow(name, size, dof, own, True, math.nan, math.nan, 0, 0))
        good = [row for row in rows if tolerance is None or self.bound(row) <= tolerance]
        timed = [row for row in good if not math.isnan(row.seconds)]
        if timed:
            return min(timed, key=lambda row: row.seconds)
        row = min(good or rows, key=self.bound, default=None)
        if row is not None and math.isnan(row.seconds) and row.failure is None and row.size <= LONG:
            return self.measure(FAMILIES[row.family], row.size)
        return row


def described(row: TradeRow) -> str:
    """A row in words."""
    if row.failure is not None:
        return f"size {row.size} failed: {row.failure}"
    return f"size {row.size} has an error of {row.error:.1e} and takes {1e3 * row.seconds:.3g} ms"
