# SPDX-License-Identifier: MIT
"""The tracer of branches: it takes steps along a branch, ends it, and finds special points on it.

One tracer follows branches of equilibria, cycles and forced motions, curves in the plane of two
numbers, and branches of a user's own equations. A special point is a zero of a test function: a
fold, a branch point, a point with a multiplier on the unit circle, or one at which any function
passes a value.

Source: for test functions Kuznetsov, Elements of Applied Bifurcation Theory, ch. 10.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, Generic, Literal, cast

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import ArrayLike

from pipedyn.continuation.arclength import BranchStep, Equations, Point
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed, zero_between

FLAT = 0.3
"""Share of the steeper slope dp/ds at the ends of a step. If a cubic through both has a smaller
slope between them, there may be two folds on the step: the error of the cubic's slope is less than
this share, as tangents turn by `Control.turn` at most."""

ONE_FOLD = 1e-3
"""Share of a step within which changes of the sign of dp/ds cancel in pairs: next to a fold, errors
of tangents may change it several times."""

BranchEnd = Literal["range", "closed", "points", "not converged"]
"""Why a branch ends: it reaches a limit, it returns to its beginning, it has the largest number of
points asked for, or no next point was found."""


# ------------------------------------------------------------------------------ special points


@dataclass
class TestFunction:
    """A function along a step of a branch, whose zeros are special points.

    The function may have several values: a special point lies where the number of positive values
    changes.

    Attributes:
        step: the step.
        tolerance: arc length to which zeros are located.
        values: function of a point of the branch: a number, or numbers in falling order, (k,).
        name: name of the special points, or a function that names one from the arc lengths right
            before and right beyond it. A point with an empty name is left out.
        known: values that are known already, by arc length.
        beside_folds: share of the step on either side of a fold in which zeros are not looked for.
    """

    step: BranchStep[Any]
    tolerance: float
    values: Callable[[Point], ArrayLike]
    name: str | Callable[[float, float], str] = ""
    known: dict[float, Array] = field(default_factory=dict)
    beside_folds: float = 0.0

    def at(self, s: float) -> Array:
        """Values at an arc length from the beginning of the step, computed once, shape (k,)."""
        if s not in self.known:
            self.known[s] = np.atleast_1d(self.values(self.step.at(s)))
        return self.known[s]

    def _value(self, which: int, s: float) -> float:
        return float(self.at(s)[which])

    def positive(self, s: float) -> int:
        """Number of positive values at an arc length."""
        return int(np.count_nonzero(self.at(s) > 0.0))

    def named(self, before: float, beyond: float) -> str:
        """Name of the special point between two arc lengths."""
        return self.name if isinstance(self.name, str) else self.name(before, beyond)

    def changes(self, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Arc lengths right before and right beyond each zero between low and high, in order.

        A value that passes 0 is a continuous function of the arc length unless other values pass 0
        with it.
        """
        for _ in range(8):  # at most six zeros on one step have been met
            first, last = self.positive(low), self.positive(high)
            if first == last:
                return
            passing = first - (last < first)
            value = partial(self._value, passing)
            root = zero_between(value, low, high, self.tolerance)
            changes, sides = (value(low) > 0.0, value(high) > 0.0), (False, False)
            width = 0.5 * self.tolerance  # doubled where rounding hides the change
            while sides != changes:
                width *= 2.0
                before, beyond = max(low, root - width), min(root + width, high)
                sides = value(before) > 0.0, value(beyond) > 0.0
            yield before, beyond
            low = beyond


def folds(step: BranchStep[Equations], rtol: float) -> list[tuple[float, float]]:
    """Arc lengths right before and right beyond each fold on a step, which has two folds at most.

    Folds are located to `rtol` times the length of the step: the slope dp/ds of the parameter
    passes 0 there.
    """
    first, last = step.slopes
    length = step.length
    ends = [0.0, length]
    if first * last > 0.0:
        # A cubic has the parameter's values and slopes at the ends. Its slope is smallest at
        # `share` of the step.
        mean = (step.end.p - step.begin.p) / length
        bend = 6.0 * (0.5 * (first + last) - mean)
        share = 0.5 - 0.5 * (last - first) / bend if bend else 0.0
        flattest = first + share * (last - first - bend * (1.0 - share))
        if 0.0 < share < 1.0 and flattest / max(first, last, key=abs) < FLAT:
            ends.insert(1, share * length)
    slope = TestFunction(step, rtol * length, lambda point: point.tangent[-1])
    found = list[tuple[float, float]]()
    for before, beyond in (each for pair in pairwise(ends) for each in slope.changes(*pair)):
        if found and before - found[-1][1] < ONE_FOLD * length:
            found.pop()
        else:
            found.append((before, beyond))
    return found


def between_folds(step: BranchStep[Equations], rtol: float) -> list[BranchStep[Equations]]:
    """Parts of a step on which the parameter does not turn back.

    Folds are located to `rtol` times the length of the step.
    """
    return step.parts([beyond for _, beyond in folds(step, rtol)])


def special_points(
    step: BranchStep[Equations],
    fold_rtol: float,
    tests: Iterable[TestFunction],
    until: float | None = None,
) -> list[tuple[str, float, float]]:
    """Special points on a step in order: name, and arc lengths right before and right beyond it.

    Args:
        step: the step.
        fold_rtol: share of the step's length to which folds are located, which are listed as
            "fold". If it is 0, folds are not looked for.
        tests: test functions on the step.
        until: arc length up to which zeros of tests are looked for; the whole step if not given.
    """
    length = step.length if until is None else until
    found = [("fold", *pair) for pair in folds(step, fold_rtol)] if fold_rtol else []
    turns = [beyond for *_, beyond in found]
    for test in tests:
        near = test.beside_folds * step.length
        ends = [0.0, *(s + side for s in turns if near for side in (-near, near)), length]
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            if low < high:
                found += [(test.named(*pair), *pair) for pair in test.changes(low, high)]
    return sorted((one for one in found if one[0]), key=lambda one: one[2])


# --------------------------------------------------------------------------- along the branch


class Tracer(Generic[Equations]):
    """Follows a branch step by step until it ends, and says why it ends.

    Each step is passed to `note`, which the tracer of a kind of branch overrides.

    Args:
        limits: triples (index of an entry of z, its least value, its largest value); the branch
            ends at these values.
        most: largest number of steps either way.
        failing: exceptions that end a branch; a user's equations may raise exceptions of any type.
    """

    near_limit = 1e-4
    """Distance from a limit, as a share of the range, within which the point at the limit is solved
    for if no step can be taken. If nothing is defined beyond the limit, steps that would end there
    are shortened down to `Control.shortest`."""

    def __init__(
        self,
        limits: Iterable[tuple[int, float, float]] = (),
        most: int = 1000,
        failing: type[Exception] | tuple[type[Exception], ...] = NewtonFailed,
    ) -> None:
        self.limits, self.most, self.failing = list(limits), most, failing

    def note(self, step: BranchStep[Equations]) -> str | None:
        """Records a step, and returns why the branch ends with it, or None if it goes on.

        A NewtonFailed that it raises also ends the branch, as one that was not followed further.
        """
        return None

    def one_way(
        self,
        steps: Iterator[BranchStep[Equations]],
        problem: Equations | None = None,
        begin: Point | None = None,
    ) -> tuple[list[Point], str, str]:
        """Points of a branch, why it ends, and a sentence why it was not followed further.

        The sentence is empty if the branch was followed to its end.

        Args:
            steps: steps along the branch; it raises NewtonFailed if none can be taken.
            problem: the equations at the beginning, if they are known before the first step.
            begin: the point at the beginning, if it is known; it is the first point returned.
        """
        points = [] if begin is None else [begin]
        if begin is not None and self.is_over(begin):
            return points, "range", ""
        try:
            for count, step in enumerate(self._within_limits(steps, problem, begin), 1):
                closes = begin is not None and count > 1 and passes_through(step, begin.z)
                step = replace(step, end=points[0]) if closes else step
                end = self.note(step)
                points.append(step.end)
                if closes or end is not None:
                    return points, end or "closed", ""
                if self.is_over(step.end):
                    break
                if count == self.most:
                    return points, "points", f"it takes more than {self.most} steps"
        except self.failing as error:
            return points, "not converged", reason_of(error)
        return points, "range", ""

    def both_ways(
        self, problem: Equations, start: Point, step: float
    ) -> tuple[list[Point], tuple[BranchEnd, BranchEnd], tuple[str, str]]:
        """Points of the branch through a point, why it ends at either end, and sentences.

        The sentences say why it was not followed further, as for `one_way`.

        Args:
            problem: the equations.
            start: a solution with its tangent, within the limits.
            step: length of the first step.
        """
        ahead, last, why_last = self.one_way(problem.steps(start, step), problem, start)
        if last == "closed":
            return ahead, ("closed", "closed"), ("", "")
        turned = Point(start.z, -start.tangent)
        back, first, why_first = self.one_way(problem.steps(turned, step), problem, turned)
        before = [Point(point.z, -point.tangent) for point in back[:0:-1]]
        ends = cast("tuple[BranchEnd, BranchEnd]", (first, last))
        return before + ahead, ends, (why_first, why_last)

    def is_over(self, point: Point) -> bool:
        """Whether the branch leaves the range of a limited entry of z at a point."""
        return any(
            (point.z[i] <= low and point.tangent[i] < 0.0)
            or (point.z[i] >= high and point.tangent[i] > 0.0)
            for i, low, high in self.limits
        )

    def _within_limits(
        self,
        steps: Iterator[BranchStep[Equations]],
        problem: Equations | None,
        begin: Point | None,
    ) -> Iterator[BranchStep[Equations]]:
        """Steps up to the first limit.

        If no step can be taken and a limit is right ahead, the last step leads to this limit.
        """
        marks = [(i, value) for i, *ends in self.limits for value in ends]
        try:
            for step in steps:
                within = step.up_to(marks)
                yield within
                if within is not step:
                    return
                problem, begin = step.problem, step.end
        except self.failing:
            if problem is None or begin is None or not (edge := self._at_edge(problem, begin)):
                raise
            yield BranchStep(problem, begin, edge)

    def _at_edge(self, problem: Equations, point: Point) -> Point | None:
        """The point at a limit that is right ahead, within `near_limit`; None if there is none.

        The equations may not be defined beyond the limit.
        """
        for i, low, high in self.limits:
            edge, slope = (high if point.tangent[i] > 0.0 else low), float(point.tangent[i])
            gap = edge - float(point.z[i])
            if gap * slope > 0.0 and abs(gap) <= self.near_limit * (high - low) < math.inf:
                away = gap / slope
                try:
                    z = problem.fixed(point.z + away * point.tangent, edge, i)
                    if problem.length(z - point.z) <= 2.0 * away:
                        return problem.point(z, point.tangent)
                except self.failing:
                    continue
        return None


def reason_of(error: Exception) -> str:
    """Message of an exception and of its cause, with type names other than NewtonFailed's."""
    text = str(error) if isinstance(error, NewtonFailed) else f"{type(error).__name__}: {error}"
    cause = error.__cause__
    known = cause is None or isinstance(cause, LinAlgError | FloatingPointError | NewtonFailed)
    if known or str(cause) in text:
        return text
    return f"{text} ({type(cause).__name__}: {cause})"


AT_END = 1e-6
"""Distance from an end of a step, as a share of its length, that counts as rounding."""


def passes_through(step: BranchStep[Equations], z: Array, after: float = AT_END) -> bool:
    """Whether a solution z lies on a step, beyond the share `after` of its length."""
    if z.size != step.begin.z.size:  # z is an orbit on another mesh
        return False
    s, length, problem = step.reach(z), step.length, step.problem
    ahead = after * length < s <= length * (1.0 + AT_END)
    if ahead and problem.length(step.guess(s) - z) <= 0.1 * length:
        with suppress(NewtonFailed):
            there = problem.at(step.begin, s, step.guess(s)).z
            return problem.length(there - z) <= 1e-6 * (1.0 + problem.length(z))
    return False
