# SPDX-License-Identifier: MIT
"""Single roots followed along the flow speed, from any speed on, forwards and backwards.

The core follows modes from rest (`cpp/pipedyn/linear/tracking.hpp`). Under strong damping a growing
root may come from a cluster of overdamped roots, in which it has no number. It is followed here
from a speed at which it grows: among all roots at the next speed, the one continues it to which the
slopes d lambda / du at both speeds lead. Where two may do so, the step is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import InitVar, dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.continuation.tracer import TestFunction
from pipedyn.linear.eigenproblem import eigenproblem, select_pairs
from pipedyn.linear.neutral import beyond_rounding
from pipedyn.models.base import Model
from pipedyn.util.check import Array, Complex

ROOTS_APART = 0.25
"""Largest distance of a continuation from where slopes lead, over that of the next best one."""

ROOT_JUMP = 0.1
"""Largest change of a root in a step, beyond what slopes lead to, over 1 + |lambda|: as in the
core."""

HALVINGS = 18
"""Number of times that a step is halved: roots that meet are then 1e-3 apart."""

SWAP_HALVINGS = 12
"""Number of times that a step is halved where one root starts to grow and another ceases to."""

MOST_INSERTED = 600
"""Largest number of speeds added between those asked for, with all roots at each."""


@dataclass(frozen=True)
class Roots:
    """Roots of a model at one speed, shape (r,), with d lambda / du and bounds on their errors.

    Of a model in three dimensions, `across` tells which are of motions across the plane of rest.

    With hysteresis they are those that oscillate, in the upper half plane, and the real roots of
    the pipe without it.
    """

    values: Complex
    slopes: Complex
    errors: Array
    across: NDArray[np.bool_]


class RootFollower:
    """Roots of one model, followed from one speed to another.

    Args:
        model: the model, of which all roots are computed at each speed.
    """

    def __init__(self, model: Model) -> None:
        self._problem = eigenproblem(model)
        self._known: dict[float, Roots] = {}
        self._left = MOST_INSERTED

    def at(self, u: float) -> Roots:
        """All roots at a flow speed."""
        if u not in self._known:
            one, found = self._problem, []
            for problem in (one, one.static) if one.pipe.hysteresis else (one,):
                pairs = problem.lowest(u, 2 * problem.dof, left=True)
                kept = pairs.converged
                if one.pipe.hysteresis:
                    kept &= pairs.values.imag > 0.0 if problem is one else pairs.values.imag == 0.0
                pairs = select_pairs(pairs, np.flatnonzero(kept))
                problem.spectrum().assess(u, pairs)
                slopes, across = np.nan_to_num(pairs.slopes), problem.is_across(pairs)
                found.append((pairs.values, slopes, pairs.uncertain, across))
            self._known[u] = Roots(*map(np.concatenate, zip(*found, strict=True)))
        return self._known[u]

    def next(self, u: float, root: int, to: float, upper: bool, halvings: int = HALVINGS) -> int:
        """Index of the root at speed `to` that continues a root at speed u; -1 if none is known.

        Of two roots after a meeting it is the upper one, or the greater real one, if `upper`.
        """
        here, there, half = self.at(u), self.at(to), 0.5 * (to - u)
        if not there.values.size:
            return -1
        value, middle = here.values[root], u + half
        # Slopes lead from both ends to the middle of the step.
        behind, ahead = there.values - half * there.slopes, here.values + half * here.slopes
        apart = np.abs(behind - ahead[root])
        best = int(apart.argmin())
        others = np.append(np.delete(apart, best), np.delete(np.abs(ahead - behind[best]), root))
        if apart[best] < min(
            ROOTS_APART * others.min(initial=np.inf), ROOT_JUMP * (1.0 + abs(value))
        ):
            return best
        if halvings > 0:
            if middle not in self._known:
                if self._left == 0:
                    return -1
                self._left -= 1
            root = self.next(u, root, middle, upper, halvings - 1)
            return root if root < 0 else self.next(middle, root, to, upper, halvings - 1)
        moves = np.abs(there.values - value)
        if moves.min() > ROOT_JUMP * (1.0 + abs(value)):
            return -1
        sign = 1.0 if upper else -1.0
        of = there.values
        close = np.flatnonzero(moves <= 2.0 * moves.min()).tolist()
        return max(close, key=lambda j: (sign * of[j].imag, sign * of[j].real))

    def between(self, u: float, v: float, halvings: int = 4) -> list[float]:
        """Speeds between two, at which roots that decay at both may grow, as their slopes tell."""
        step = v - u
        here, there = self.at(u), self.at(v)
        rises = (here.values.real <= 0.0) & (here.values.real + step * here.slopes.real > 0.0)
        falls = (there.values.real <= 0.0) & (there.values.real - step * there.slopes.real > 0.0)
        if halvings == 0 or not (rises.any() and falls.any()):
            return []
        middle = 0.5 * (u + v)
        parts = self.between(u, middle, halvings - 1), self.between(middle, v, halvings - 1)
        return [*parts[0], middle, *parts[1]]

    def branch(
        self, speeds: list[float], row: int, root: int, ends: Callable[[Complex], NDArray[np.bool_]]
    ) -> tuple[Complex, Complex, Array]:
        """A root followed from the speed in a row of `speeds` to all others.

        Args:
            speeds: flow speeds, increasing, of length S.
            row: row of the speed at which the root is known.
            root: index of the root there.
            ends: tells beyond which roots the branch is not followed.

        Returns:
            The root, the other root of its pair, and bounds on the errors of both, each of shape
            (S,). Roots that are not known are NaN. With hysteresis real roots are no pairs.
        """
        values, partners = np.full((2, len(speeds)), complex(np.nan, np.nan))
        errors = np.zeros(len(speeds))

        def walk(into: Complex, row: int, root: int, step: int, upper: bool) -> None:
            while True:
                roots = self.at(speeds[row])
                into[row] = value = roots.values[root]
                errors[row] = max(errors[row], roots.errors[root])
                row += step
                if not 0 <= row < len(speeds) or ends(value).any() or np.isfinite(into[row]):
                    return
                root = self.next(speeds[row - step], root, speeds[row], upper)
                if root < 0:
                    return

        for step in (1, -1):
            walk(values, row, root, step, True)
        pairs = np.flatnonzero(np.isfinite(values) & (values.imag != 0.0))
        partners[pairs] = values[pairs].conj()
        if not self._problem.pipe.hysteresis:
            for k in pairs.tolist():  # where the pair becomes real
                for step in (1, -1):
                    other = int(np.abs(self.at(speeds[k]).values - partners[k]).argmin())
                    if 0 <= k + step < len(speeds) and values[k + step].imag == 0.0:
                        walk(partners, k, other, step, False)
        return values, partners, np.where(np.isfinite(values), errors, np.inf)


def matched(values: Complex, others: Complex) -> NDArray[np.intp]:
    """Indices of the other roots that continue each of the values, or -1 where there are fewer."""
    apart = np.abs(values[:, None] - others)
    nearest = apart.argmin(axis=1)
    if values.size == others.size == len(set(nearest.tolist())):  # as is most often the case
        return nearest
    cost = np.zeros((max(apart.shape), max(apart.shape)))  # of those beyond, all are alike
    cost[: values.size, : others.size] = apart / (1.0 + np.abs(values[:, None]))
    columns = np.array(_core.assignment(cost)[: values.size])
    return np.where(columns < others.size, columns, -1)


@dataclass
class GrowthTest(TestFunction):
    """Test function of roots that start or cease to grow along a step of a branch.

    `values` gives the roots at a point, complex and in any order. Each root is followed by itself,
    because the number of growing roots is the same at both ends of a step on which one root starts
    to grow and another ceases to. A root may also change twice within a step. The step is halved
    where both may be so: where one root starts and another ceases to grow, and where the mean slope
    of a root before the step leads to the other sign of its growth at the end.

    Attributes:
        before: the test function of the step before, if there is one; it is not kept.
        roots: roots that are known, by arc length, in the order of those at its beginning.
    """

    before: InitVar[GrowthTest | None] = None
    roots: dict[float, Complex] = field(default_factory=dict)

    def __post_init__(self, before: GrowthTest | None) -> None:
        if before is not None:
            self.roots[0.0] = before._roots_at(before.step.length)
            self._slopes = before._slopes_between(0.0, before.step.length)
        else:
            self._slopes = np.zeros(self._roots_at(0.0).size)

    def _roots_at(self, s: float) -> Complex:
        """Roots at an arc length from the beginning of the step, computed once, shape (k,)."""
        if s not in self.roots:
            found = np.asarray(self.values(self.step.at(s)), dtype=complex)
            if self.roots:
                near = self.roots[min(self.roots, key=lambda known: abs(known - s))]
                found = found[matched(near, found)] if near.size == found.size else found
            self.roots[s] = found
        return self.roots[s]

    def _growth(self, s: float) -> Array:
        """Real parts of the roots less their rounding, in the order of the roots, (k,)."""
        if s not in self.known:
            self.known[s] = beyond_rounding(self._roots_at(s))
        return self.known[s]

    def _slopes_between(self, low: float, high: float) -> Array:
        """Mean slopes of the growth of each root between two arc lengths; 0 if roots are lost."""
        first, last = self._growth(low), self._growth(high)
        return (last - first) / (high - low) if first.size == last.size else 0.0 * last

    def at(self, s: float) -> Array:
        """Real parts of the roots less their rounding, the largest first, shape (k,)."""
        return np.sort(self._growth(s))[::-1]

    def changes(self, low: float, high: float) -> Iterator[tuple[float, float]]:
        """Arc lengths right before and right beyond each change between low and high, in order."""
        for ends in pairwise([low, *self._between(low, high, self._slopes, SWAP_HALVINGS), high]):
            yield from super().changes(*ends)

    def _between(self, low: float, high: float, slopes: Array, halvings: int) -> list[float]:
        """Arc lengths between which changes of different roots lie, where they may hide each other.

        slopes: of the growth of each root before `low`.
        """
        first, last = self._growth(low), self._growth(high)
        if halvings == 0 or not first.size == last.size == slopes.size:
            return []
        grew, grows, led = first > 0.0, last > 0.0, first + slopes * (high - low) > 0.0
        swapped = (grew & ~grows).any() and (grows & ~grew).any()
        if not swapped and not ((grew == grows) & (led != grew)).any():
            return []
        middle = 0.5 * (low + high)
        onward = self._slopes_between(low, middle)
        return [
            *self._between(low, middle, slopes, halvings - 1),
            middle,
            *self._between(middle, high, onward, halvings - 1),
        ]
