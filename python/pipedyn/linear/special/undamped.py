# SPDX-License-Identifier: MIT
"""Crossings of pipes without any term in the velocity: no damping, and no fluid mass (beta = 0).

Needed because all roots then lie on the imaginary axis, or symmetric about it. Without it Re lambda
of each is rounding, and flutter, where two roots meet without a slope d lambda / du, is refused.

lambda enters only as nu = lambda^2, which is tracked in its place. Real nu < 0 are roots on the
axis; it is left where two of them meet and turn complex (flutter; Beck's column) or one reaches
zero (divergence).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from pipedyn.linear.crossings import AxisCrossing, CrossingSearch, Flags
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.tracking import Indices, Sample, Step, pairs_at


class CirculatorySearch(CrossingSearch):
    """One sweep from rest, of nu = lambda^2."""

    def take(self, u: float) -> Sample:
        """Nu and d nu / du at a speed."""
        pairs = pairs_at(self.problem, u, self.count)
        values = pairs.values
        pairs = pairs.take((values.real > 0.0) | ((values.real == 0.0) & (values.imag > 0.0)))
        slopes = 2.0 * pairs.values * self.problem.assessed(u, pairs).slopes
        squares = replace(pairs, values=pairs.values**2)
        squares.values.imag[(pairs.values.real == 0.0) | (pairs.values.imag == 0.0)] = 0.0
        if u == 0.0:
            squares.values[np.abs(squares.values) < self.problem.zero_tolerance] = 0.0
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        none = np.zeros(squares.values.size)
        return Sample(u, squares, slopes, none, none, none.astype(np.int8))

    @property
    def wanted(self) -> int:
        """Roots to track with certainty: one nu a mode."""
        return self.certain

    def ranked(self, first: Sample) -> Indices:
        """Mode of each nu at rest, by frequency."""
        modes = np.empty(first.values.size, dtype=np.intp)
        modes[np.argsort(-first.values.real)] = np.arange(first.values.size) + 1
        return modes

    def states(self, at: Sample, onto: Indices, before: Flags) -> Flags:
        """Which nu stand for an unstable root: the complex and the positive."""
        values = at.values[onto]
        known = (np.abs(values) >= self.problem.zero_tolerance) | (values.imag != 0.0)
        states: Flags = np.where(known, (values.imag != 0.0) | (values.real > 0.0), before)
        return states

    def rows(self, step: Step) -> Indices:
        """The resolved roots; both of those that meet."""
        mine = (self.modes >= 1) & (self.modes <= self.resolved) & (step.onto >= 0)
        return np.flatnonzero(mine)

    def sure(self, step: Step) -> bool:
        """Whether each nu stays real or complex, or meets a partner of its own sign once."""
        a, b = step.left.values, step.right.values
        roots = self.rows(step)
        # Two that seem to pass zero in one step may have met below and parted above it.
        after = self.states(step.right, step.onto, self.unstable)
        real = (a.imag == 0.0) & (b[step.onto].imag == 0.0)
        if np.sum((real & (after != self.unstable))[roots]) > 1 and step.left.u > 0.0:
            return False
        for i in roots:
            k, j = int(step.meets[i]), int(step.onto[i])
            if a[i] == 0.0:  # a free joint at rest: nothing to meet
                continue
            if (a[i].imag == 0.0) == (b[j].imag == 0.0):
                if k >= 0:
                    return False
                continue
            if k < 0:
                return False
            ends = np.array([a[i].real, a[k].real, b[j].real, b[step.onto[k]].real])
            if not (ends > 0.0).all() and not (ends < 0.0).all():
                return False
        return True

    def crossings(self, step: Step) -> list[AxisCrossing]:
        """Crossings within a step."""
        found = []
        roots = self.rows(step)
        after = self.states(step.right, step.onto, self.unstable)
        for i in roots[self.unstable[roots] != after[roots]]:
            i, k = int(i), int(step.meets[i])
            mode, change = int(self.modes[i]), 1 if after[i] else -1
            if step.left.values[i] == 0.0:  # a free joint at rest
                side = step.right.values[step.onto[i]].imag
                if side >= 0.0:
                    found.append(AxisCrossing(0.0, 0j, 2 if side else 1, mode, 0.0))
            elif k < 0:
                divergence = self._divergence(step, 0.5, change, mode)
                if divergence is None:
                    speed, error = self._root_of(step, i, lambda nu: float(nu[0].real), 1)
                    divergence = AxisCrossing(speed, 0j, change, mode, error)
                found.append(replace(divergence, pair=None, slope=None))
            elif i < k:
                speed, error = self._root_of(
                    step, i, lambda nu: float(((nu[0] - nu[1]) ** 2).real), 2
                )
                centre = float(np.mean(self._closest(speed, step, i, 2)).real)
                value = complex(0.0, math.sqrt(max(-centre, 0.0)))
                mode = max(mode, int(self.modes[k]))
                found.append(AxisCrossing(speed, value, 2 * change, mode, error))
        return found

    def _closest(self, u: float, step: Step, i: int, count: int) -> Complex:
        """The nu (or the two that meet) nearest to where the step has them."""
        t = (u - step.left.u) / step.length
        a, b = step.left.values, step.right.values
        k = int(step.meets[i]) if count == 2 else i
        centre = 0.5 * ((1.0 - t) * (a[i] + a[k]) + t * (b[step.onto[i]] + b[step.onto[k]]))
        values = self.take(u).values
        return values[np.argsort(np.abs(values - centre))[:count]]

    def _root_of(
        self, step: Step, i: int, measure: Callable[[Complex], float], count: int
    ) -> tuple[float, float]:
        """Speed at which a measure of nu vanishes within the step, and its error."""
        if (
            measure(self._closest(step.left.u, step, i, count))
            * measure(self._closest(step.right.u, step, i, count))
            > 0.0
        ):  # a shortest step whose ends do not agree
            return 0.5 * (step.left.u + step.right.u), step.length
        tolerance = 4e-16 * (1.0 + step.right.u)
        speed = brentq(
            lambda u: measure(self._closest(u, step, i, count)),
            *(step.left.u, step.right.u),
            xtol=tolerance,
            rtol=8.9e-16,
        )
        # Rounding of nu enters through its slope, or that of the squared difference.
        spread = 1e-6 * step.length
        high, low = (
            measure(self._closest(u, step, i, count)) for u in (speed + spread, speed - spread)
        )
        slope = abs(high - low) / (2.0 * spread)
        size = float(np.abs(self._closest(speed, step, i, count)).max()) ** count
        return float(speed), tolerance + 1e-14 * size / slope if slope > 0.0 else step.length
