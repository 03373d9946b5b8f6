# SPDX-License-Identifier: MIT
"""How the cheapest model that meets a tolerance is found with few measurements.

What is known of a family's error (an order, or exponential decay) predicts the size that a
tolerance takes; errors found on the way correct it. Linear questions have looks, which tell a
model's error at a tenth of its cost, and cost what their degrees of freedom do: families whose size
is too large beside the best are not measured. Of motions and cycles each size is measured, and a
family is left where its next size would not cost less than WORTH of what was found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pipedyn.families import FAMILIES, RULES, Family, expected_size
from pipedyn.model import PipedynError
from pipedyn.pipe import Pipe
from pipedyn.quantity import Quantity, Reference
from pipedyn.trade import TradeRow, measured

WORTH = 0.7
"""Share of the best cost so far that another family must promise to be looked at further."""

LARGEST = {"legendre": 60, "beam": 400}
"""Functions; chains are tried up to what the quantity can be asked of."""

PATIENCE = 60.0
"""Seconds: a model that would take longer for an answer is not tried."""

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
            self.rows[key] = measured(
                *(self.pipe, self.quantity, family, size, self.reference, self.repeats)
            )
        return self.rows[key]

    def bound(self, row: TradeRow) -> float:
        """Of the true error; infinite where the model failed."""
        known = row.error + self.reference.error
        return known if math.isfinite(known) else math.inf

    def error(self, family: Family, size: int) -> float:
        """Bound on a model's error, from a look where there is one, else measured."""
        key = (family.name, size)
        if key not in self.looks:
            told = None
            if key not in self.rows and not family.paired:
                try:
                    model = family.models(self.pipe, size)[0]
                    told = self.quantity.look(model, self.reference.answer)
                except (PipedynError, ValueError, np.linalg.LinAlgError):
                    told = None
                if told is None and self.has_look and size > LONG:
                    told = math.inf
            if told is None:  # a look may miss what a search finds
                return self.bound(self.measure(family, size))
            self.looks[key] = told + self.reference.error
        return self.looks[key]

    def is_steady(self, row: TradeRow, tolerance: float) -> bool:
        """Whether the next larger size meets the tolerance too."""
        family = FAMILIES[row.family]
        return self.error(family, family.beyond(row.size)) <= tolerance

    # ------------------------------------------------------------------------- for a tolerance

    def cheapest(self, tolerance: float) -> TradeRow | None:
        """The cheapest row that meets a tolerance."""
        expected = {family: self._expected(family, tolerance) for family in self.families}
        first = self.reference.family

        def turn(family: Family) -> tuple[bool, bool, float]:
            stalls = family.order == 0.0
            return family.name != first, stalls, family.dof(1) * expected[family]

        ask = self._look_up if self.has_look else self._try_out
        ask({family: expected[family] for family in sorted(expected, key=turn)}, tolerance)
        good = [row for row in self.rows.values() if self.bound(row) <= tolerance]
        return min(good, key=lambda row: row.seconds, default=None)

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
        size = max(2, self.quantity.least)
        while size <= self._largest(family):
            row = self.measure(family, size)
            if row.failure is None and row.seconds > budget:
                self.left[family.name] = f"size {size} takes {1e3 * row.seconds:.3g} ms"
                break
            if row.failure is None and (best is None or self.bound(row) < self.bound(best)):
                best = row
            if best is not None and not best.resolved:
                break
            step = 2 if family.order == math.inf else max(1, size // 2)
            if price(self._seconds(family), size + step, self.quantity.growth) > 2.0 * budget:
                step = max(1, step // 2)
            size += step
        return best
