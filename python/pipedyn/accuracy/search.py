# SPDX-License-Identifier: MIT
"""How the cheapest model that meets a tolerance is found with few measurements.

What is known of a family's error (an order, or exponential decay) predicts the size that a
tolerance takes; errors found on the way correct it. Linear questions have looks, which tell a
model's error at a tenth of its cost, and cost what their degrees of freedom do: families whose size
is too large beside the best are not measured. Of motions and cycles each size is measured, and a
family is left where its next size would not cost less than WORTH of what was found. For a budget
the size is sought that comes as near to the reference as can be told, and below it what the budget
pays for; a family is left where its law, or a look, has no smaller an error in as much time.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from pipedyn.accuracy.families import FAMILIES, RULES, Family, expected_size
from pipedyn.accuracy.quantities import Quantity, Reference
from pipedyn.accuracy.trade import SHARPER, TradeRow, measured
from pipedyn.models.base import PipedynError
from pipedyn.models.pipe import Pipe

WORTH = 0.7
"""Share of the best cost so far that another family must promise to be looked at further."""

LARGEST = {"legendre": 60, "beam": 400}
"""Functions; chains are tried up to what the quantity can be asked of."""

PATIENCE = 60.0
"""Seconds: a model that would take longer for an answer is not tried, or given up."""

LESS = 0.93
"""Share of a size below which a smaller one is worth a look or a measurement."""

AIM = 0.8
"""Share of a tolerance that a predicted size should reach."""

DECADES = 0.9
"""Decades by which a Legendre function more lowers the error, before two sizes have told."""

TELLING = 0.5
"""Error above which a model tells nothing of how the errors fall."""

FALLING = 0.3
"""Share of a family's order below which its errors do not fall as they should."""

NEAR = 0.7
"""Share of an expected size with which a nonlinear answer may do; larger models are dearer."""

CHEAP = 12
"""Size up to which a nonlinear answer of any family may be measured to learn its price."""

STEPS, TRIES, MEASURED = 25, 4, 2
"""Sizes of a family that are asked for its error; for a linear question those measured after, and
families measured."""

WITHIN, MARGIN = 6, 1.5
"""Sizes of a family that are timed for a budget; by how much a time may be wrong, as predicted or
as measured once."""

FULL, FULL_OF_DECADES, CLOSE = 0.7, 0.9, 0.1
"""Shares of a budget that are as good as all of it, where errors fall by powers and by decades, and
share of a size within which the largest that a budget pays for is known."""

NEARBY = (8, 16, 32)
"""Sizes that tell where a family's errors tend to, where there are no looks."""

LONG = 80
"""Size from which a linear answer is not measured before a smaller one has told its price."""


def predicted(family: Family, known: Mapping[int, float], aim: float) -> float:
    """The size at which a family's error falls to an aim, by its law through what is known.

    Args:
        family: its order is believed until two sizes have told another.
        known: errors by sizes.
        aim: relative error.

    Returns:
        A size, at most three times the nearest known or six functions beyond it; infinite where
        the errors do not fall, and the next size to learn from where none tells anything.
    """
    largest = max(known)
    telling = [(size, max(error, 1e-16)) for size, error in known.items() if error <= TELLING]
    if not telling:
        return largest + max(2, largest // 2)
    near = sorted(telling, key=lambda one: abs(math.log(one[1] / aim)))[:2]
    exponential = family.order == math.inf
    steepness = DECADES if exponential else family.order
    sizes = [float(size) if exponential else math.log10(size) for size, _ in near]
    decades = [-math.log10(error) for _, error in near]
    if len(near) > 1:
        told = (decades[1] - decades[0]) / (sizes[1] - sizes[0])
        least = FALLING * steepness
        if not exponential and len(telling) > 3 and told < max(least, FALLING):
            return math.inf
        steepness = min(max(told, least), 1.5 * steepness or math.inf)
    if steepness <= 0.0:
        return 2.0 * largest
    step = (-math.log10(aim) - decades[0]) / steepness
    size = near[0][0]
    return size + min(step, 6.0) if exponential else size * 10.0 ** min(step, math.log10(3.0))


def price(known: Mapping[int, float], size: int, growth: float) -> float:
    """Seconds of an answer: growing with the size as they have, and as `growth` at the least."""
    near = sorted(known, key=lambda one: abs(math.log(one / size)))[:2]
    if not near:
        return 0.0
    if len(near) > 1:
        told = math.log(known[near[0]] / known[near[1]]) / math.log(near[0] / near[1])
        growth = min(max(0.7 * told, growth), 3.0)
    seconds: float = known[near[0]] * (size / near[0]) ** growth
    return seconds


class Search:
    """Models of one pipe asked so far, each once.

    Attributes:
        rows: what was measured, by family and size.
        looks: errors that were looked up.
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
        self.wave = quantity.wave(pipe, reference.answer)
        self.has_look = quantity.has_look(reference.answer)
        self.rows: dict[tuple[str, int], TradeRow] = {}
        self.looks = {
            (reference.family, size): error + reference.error for size, error in reference.grown
        }
        self.left: dict[str, str] = {}

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
        """Of the true error; infinite where the model failed."""
        known = row.error + self.reference.error
        return known if math.isfinite(known) else math.inf

    def error(self, family: Family, size: int) -> float:
        """Bound on a model's error: by a look, infinite if that misses, or else measured."""
        key = (family.name, size)
        if key not in self.looks:
            told = None
            if key not in self.rows and not family.paired:
                try:
                    model = family.models(self.pipe, size)[0]
                    told = self.quantity.look(model, self.reference.answer)
                except (PipedynError, ValueError, np.linalg.LinAlgError):
                    told = None
                if told is None and self.has_look:
                    told = math.inf
            if told is None:
                return self.bound(self.measure(family, size))
            self.looks[key] = told + self.reference.error
        return self.looks[key]

    def surely(self, family: Family, size: int) -> float:
        """Bound on a model's error; what a look missed is measured, as a search may find it."""
        error = self.error(family, size)
        if math.isfinite(error) or size > LONG:
            return error
        return self.bound(self.measure(family, size))

    def is_steady(self, row: TradeRow, tolerance: float) -> bool:
        """Whether the next larger size meets the tolerance too."""
        family = FAMILIES[row.family]
        return self.surely(family, family.beyond(row.size)) <= tolerance

    # ------------------------------------------------------------------------- for a tolerance

    def cheapest(self, tolerance: float) -> TradeRow | None:
        """The cheapest row that meets a tolerance."""
        expected = {family: self._expected(family, tolerance) for family in self.families}
        order = sorted(expected, key=self._turn(expected))
        ask = self._look_up if self.has_look else self._try_out
        ask({family: expected[family] for family in order}, tolerance)
        good = [row for row in self.rows.values() if self.bound(row) <= tolerance]
        return min(good, key=lambda row: row.seconds, default=None)

    def _turn(self, expected: Mapping[Family, float]) -> Callable[[Family], tuple[float, ...]]:
        """In which order families are asked: those of which something is known, then the small."""
        first = self.reference.family

        def turn(family: Family) -> tuple[float, ...]:
            return family.name != first, family.order == 0.0, family.dof(1) * expected[family]

        return turn

    def _expected(self, family: Family, tolerance: float) -> float:
        """About the size that the tolerance takes; of nonlinear questions the least that may do."""
        if family.name == self.reference.family:
            return predicted(family, dict(self.reference.grown), AIM * tolerance)
        if self.quantity.is_spoilt(self.pipe, family.name):
            return math.inf
        wave = math.pi if self.wave is None else self.wave
        share = 1.0 if self.has_look else NEAR
        return max(share * expected_size(family, wave, tolerance), float(self.quantity.least))

    def _largest(self, family: Family) -> int:
        most = self.quantity.most
        return min(LARGEST.get(family.name, most), most // 2 if family.paired else most)

    def _smallest(
        self, family: Family, expected: float, tolerance: float, room: float, limit: float
    ) -> int | None:
        """The smallest size that meets the tolerance, unless others do so for less.

        Args:
            family: the family.
            expected: about the size that it takes.
            tolerance: relative error.
            room: degrees of freedom that it may have.
            limit: seconds that an answer may take.
        """
        most, least = self._largest(family), self.quantity.least
        if most < least or expected > 3.0 * most:
            about = f", and {expected:.0f} are expected" if math.isfinite(expected) else ""
            self.left[family.name] = f"more than size {most} is needed{about}"
            return None
        known = dict(self.reference.grown) if family.name == self.reference.family else {}
        wanted = min(max(expected, least), most)
        size = math.ceil(wanted if known or self.has_look else min(wanted, CHEAP))
        good, bad = None, least - 1
        for _ in range(STEPS):
            why = self._dearer(family, max(size, math.ceil(min(wanted, most))), room, limit)
            if why:
                self.left[family.name] = why
                break
            known[size] = self.error(family, size)
            if known[size] <= tolerance:
                good = size
            else:
                bad = size
            wanted = predicted(family, known, AIM * tolerance)
            last = most if good is None else good - 1
            if wanted == math.inf or bad >= last:
                break
            if known[size] == math.inf and limit < PATIENCE:
                break  # To fail may cost more than the answers that others gave.
            size = min(max(math.ceil(wanted), bad + 1), last)
            if good is not None and size > LESS * good:
                break
        if good is None and bad >= least and self.surely(family, bad) <= tolerance:
            good = bad
        if good is None and family.name not in self.left:
            self.left[family.name] = f"size {bad} has an error of {known[bad]:.1e} still"
        return good

    def _dearer(self, family: Family, size: int, room: float, limit: float) -> str:
        """Why a size costs more than others; empty where it may not."""
        if family.dof(size) > room:
            return f"size {size} is needed"
        seconds = price(self._seconds(family), size, self.quantity.growth)
        return f"size {size} would take some {1e3 * seconds:.3g} ms" if seconds > limit else ""

    def _look_up(self, expected: Mapping[Family, float], tolerance: float) -> None:
        """For a linear question: sizes by looks, then measurements of the smallest."""
        sizes: list[tuple[int, Family, int]] = []
        room = math.inf
        for family, about in expected.items():
            size = self._smallest(family, about, tolerance, room, math.inf)
            if size is not None:
                sizes.append((family.dof(size), family, size))
                room = min(room, self.quantity.room(family.dof(size)))
        best: TradeRow | None = None
        for rank, (dof, family, size) in enumerate(sorted(sizes, key=lambda one: one[0])):
            if best is not None and (rank >= MEASURED or dof > self.quantity.room(best.dof)):
                self.left[family.name] = f"an error of {tolerance:g} takes size {size}"
                continue
            best = self._confirmed(family, size, tolerance) or best
        if best is not None and len(sizes) == 1 and not self.quantity.is_even and best.size < LONG:
            self.measure(FAMILIES[best.family], best.size + 1)

    def _confirmed(self, family: Family, size: int, tolerance: float) -> TradeRow | None:
        """The first size from one that looks good at which the measured error is."""
        for _ in range(TRIES):
            if size > self._largest(family):
                break
            if size > LONG and self.quantity.is_linear:
                tested = self.measure(family, min(size // 2, 2 * LONG))
                seconds = price({tested.size: tested.seconds}, size, 1.5)
                if seconds > PATIENCE:
                    self.left[family.name] = f"size {size} would take some {seconds:.0f} s"
                    return None
            row = self.measure(family, size)
            if self.bound(row) <= tolerance:
                return row
            size = max(size + 1, math.ceil(1.1 * size))
        self.left[family.name] = f"size {row.size} has an error of {row.error:.1e} still"
        return None

    def _try_out(self, expected: Mapping[Family, float], tolerance: float) -> None:
        """For motions and cycles: every size that may pay is measured."""
        room, limit = math.inf, PATIENCE
        for family, about in expected.items():
            size = self._smallest(family, about, tolerance, room, limit)
            row = None if size is None else self._confirmed(family, size, tolerance)
            if row is not None:
                room = min(room, self.quantity.room(row.dof))
                limit = min(limit, WORTH * row.seconds)

    def _seconds(self, family: Family) -> dict[int, float]:
        """Times by sizes of models of a family's kind: chains of all rules cost alike."""
        alike = RULES if family.name in RULES else (family.name,)
        return {
            size: row.seconds
            for (name, size), row in self.rows.items()
            if name in alike and row.failure is None
        }

    # ---------------------------------------------------------------------------- for a budget

    def sharpest(self, budget: float) -> TradeRow | None:
        """The row of least error within a budget; none sharper than the reference is looked for."""
        aim = max(SHARPER * self.reference.error, self.quantity.floor)
        expected = {family: self._expected(family, aim) for family in self.families}
        best: TradeRow | None = None
        for family in sorted(expected, key=self._turn(expected)):
            best = self._sharper(family, budget, aim, best)
        return best

    def _sharper(
        self, family: Family, budget: float, aim: float, best: TradeRow | None
    ) -> TradeRow | None:
        """The sharper of the best row so far and one family's best within the budget.

        Args:
            family: the family.
            budget: seconds.
            aim: error below which models are not told apart.
            best: of other families.
        """
        most, least = self._largest(family), max(1, self.quantity.least)
        afford = self._affordable(family, budget, most)
        wanted = self._expected(family, aim)
        why = self._outdone(family, afford, aim, best)
        if most < least or why:
            self.left[family.name] = why or f"more than size {most} is needed"
            return best
        start = min(wanted, most, afford / MARGIN if afford < most else CHEAP)
        low, high, size = least - 1, most + 1, max(math.ceil(start), least)
        full = FULL_OF_DECADES if family.order == math.inf else FULL
        for _ in range(WITHIN):
            row = self._timed(family, size, budget)
            if row.failure is None and row.seconds > budget:
                high = size
            else:
                low = size
                if best is None or self.bound(row) < self.bound(best):
                    best = row
                if row.error <= aim or row.seconds > full * budget:
                    break
            if high - low <= max(1, CLOSE * low):
                break
            afford = max(self._affordable(family, budget, most), low)
            if best is not None and self._outdone(family, afford, aim, best):
                break
            size = self._between(family, size, budget, low, high, wanted)
            if price(self._prices(family), family.dof(size), self._growth) > PATIENCE:
                break
        if best is None or best.family != family.name:
            tried = max(size for name, size in self.rows if name == family.name)
            self.left[family.name] = told_of(self.rows[family.name, tried])
        return best

    def _between(
        self, family: Family, size: int, budget: float, low: int, high: int, wanted: float
    ) -> int:
        """The next size to time: within the budget by the last time, inside what is known."""
        seconds = self.rows[family.name, size].seconds
        share = 0.9 * budget / seconds if seconds > 0.0 else 4.0
        known = self._seconds(family)
        told = self._growth
        if len(known) > 1:
            (a, first), (b, last) = sorted(known.items())[-2:]
            told = max(math.log(last / first) / math.log(b / a), told)
        guess = size * min(max(share ** (1.0 / told), 0.25), 4.0)
        if family.order == math.inf:
            guess = min(guess, max(wanted, size + 1))
        return int(min(max(math.floor(guess), low + 1), high - 1))

    def _outdone(self, family: Family, afford: float, aim: float, best: TradeRow | None) -> str:
        """Why a family cannot be sharper than the best so far within the budget; empty if it may.

        Args:
            family: the family.
            afford: its largest size that the budget may pay for.
            aim: error below which models are not told apart.
            best: the best row so far.
        """
        if afford < max(1, self.quantity.least):
            return "its smallest would take longer"
        if best is None or best.family == family.name:
            return ""
        if best.error <= aim:
            return f"no less of an error than {best.family}'s could be told"
        needs = self._expected(family, self.bound(best))
        size = min(afford, self._largest(family))
        if needs <= size and self.has_look and not family.paired:
            size = max(math.floor(size), 1)
            error = self.error(family, size)
            if error < self.bound(best):
                return ""
            return f"size {size}, the most that the time allows, has an error of {error:.1e}"
        if math.isinf(needs):
            return "its errors do not become as small"
        return "" if needs <= size else f"size {needs:.0f} or so is needed for as small an error"

    def _affordable(self, family: Family, budget: float, most: int) -> float:
        """The largest size that a budget may pay for; infinite where nothing is known of prices."""
        known = self._prices(family)
        if not known:
            return math.inf
        dear, growth = MARGIN * min(budget, PATIENCE), self._growth
        sizes = range(1, most + 1)
        return float(bisect_right(sizes, dear, key=lambda n: price(known, family.dof(n), growth)))

    @property
    def _growth(self) -> float:
        return max(self.quantity.growth, 1.0)

    def _prices(self, family: Family) -> dict[int, float]:
        """Times by degrees of freedom: linear answers of all families cost about alike."""
        if not self.has_look:
            return {family.dof(size): one for size, one in self._seconds(family).items()}
        return {row.dof: row.seconds for row in self.rows.values() if row.failure is None}

    def _timed(self, family: Family, size: int, budget: float) -> TradeRow:
        """A row; what is a little over the budget is timed once more, as times scatter."""
        row = self.measure(family, size)
        if budget < row.seconds < MARGIN * budget:
            row = min(row, self._measured(family, size), key=lambda one: one.seconds)
            self.rows[family.name, size] = row
        return row

    # ------------------------------------------------------------------------- where none is found

    def nearest(self, tolerance: float | None) -> TradeRow:
        """The row that comes nearest to a tolerance, or to a time where it is met.

        Of families that were left unseen the largest models are looked at; a row that only a look
        has told has no time.
        """
        for family in () if tolerance is None else self.families:
            if not any(family.name == name for name, _ in (*self.rows, *self.looks)):
                self._look_far(family)
        names = {family.name for family in self.families}  # the reference's may not be among them
        rows = list(self.rows.values())
        rows += [
            self._unmeasured(name, size)
            for name, size in self.looks
            if name in names and (name, size) not in self.rows
        ]
        good = [row for row in rows if tolerance is None or self.bound(row) <= tolerance]
        timed = [row for row in good if not math.isnan(row.seconds)]
        if timed:
            return min(timed, key=lambda row: row.seconds)
        row = min(good or rows, key=self.bound)
        if math.isnan(row.seconds) and row.size <= LONG:
            return self.measure(FAMILIES[row.family], row.size)
        return row

    def _unmeasured(self, name: str, size: int) -> TradeRow:
        error = self.looks[name, size] - self.reference.error
        dof = FAMILIES[name].dof(size)
        return TradeRow(name, size, dof, error, True, math.nan, math.nan, 0, 0)

    def _look_far(self, family: Family) -> None:
        """Errors of a family's large models, and the limit that they tend to if it is not zero."""
        most = self._largest(family)
        far = self.has_look and not family.paired
        sizes = [most // 4, most // 2, most] if far else [size for size in NEARBY if size <= most]
        errors = [self.error(family, max(size, self.quantity.least)) for size in sizes]
        limit = limit_of(errors)
        if limit > 0.5 * errors[-1]:
            self.left[family.name] = f"its errors tend to {limit:.2g}: it has another limit"


def limit_of(errors: Sequence[float]) -> float:
    """What the errors of three sizes, each twice the last, tend to (Aitken); 0 if not told."""
    if len(errors) < 3 or not np.isfinite(errors).all():
        return 0.0
    a, b, c = errors[-3:]
    first, last = a - b, b - c
    if not 0.0 < last < first:
        return 0.0
    return max(c - last**2 / (first - last), 0.0)


def told_of(row: TradeRow) -> str:
    """A row in words."""
    if row.failure is not None:
        return f"size {row.size} failed: {row.failure}"
    return f"size {row.size} has an error of {row.error:.1e} and takes {1e3 * row.seconds:.3g} ms"
