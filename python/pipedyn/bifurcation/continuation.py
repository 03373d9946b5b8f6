# SPDX-License-Identifier: MIT
"""Pseudo-arclength continuation: branches of solutions of G(x, p) = 0, past folds in p.

From a solution z = (x, p) with unit tangent t the predictor is z + ds t; the corrector is Newton's
method with the condition <t, Z - z> = ds, which stays regular at a fold. The product is weighted:
<a, b> = sum of weights a b. The problem solves its own bordered linear equations [G_z; row] dz =
[-G; gap], so that equilibria (dense matrices), periodic orbits (almost block diagonal ones) and any
other problem with one free parameter share this engine. Whatever solves for a point raises
`NewtonFailed` where there is none.

Source: Keller (1977), Numerical solution of bifurcation and nonlinear eigenvalue problems.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.linalg import LinAlgError
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed, newton

FLAT = 0.3
"""Share of a step's steepest slope dp/ds below which there may be two folds within it: a cubic
through the ends misjudges the slope between them by less, as tangents turn by `Control.turn`."""

Solver = Callable[[Array, float, float], Array]
"""G_z at a point, factorised. To row, gap and share it gives the dz with G_z dz = -share G and
row @ dz = gap: with share 1 Newton's step, with share 0 a tangent."""


class Problem(Protocol):
    """n equations in n unknowns x and a parameter p, z = (x, p)."""

    weights: Array
    """Of squares in the length of a change, shape (n + 1,)."""

    def linearised(self, z: Array) -> Solver:
        """The equations about a point."""

    def relative(self, z: Array, step: Array) -> float:
        """Size of a step of Newton's method relative to that of the solution."""

    def check(self, z: Array) -> None:
        """Raises NewtonFailed for what is not to be followed."""


@dataclass(frozen=True)
class Control:
    """How steps are taken, along the branch and in Newton's method.

    Lengths along the branch are those of the problem's weights, sizes of Newton's steps are its
    `relative`.
    """

    longest: float  # step along the branch
    shortest: float = 1e-7  # step at which a branch that cannot be continued is given up
    turn: float = 0.35  # angle between neighbouring tangents, rad; beyond, the step is halved
    tolerance: float = 1e-12  # size of Newton's last step
    stagnation: float = 1e-8  # the same where rounding keeps steps from getting shorter
    iterations: int = 15  # of Newton's method
    patience: int | None = None  # slow Newton steps in a row after which it is given up
    longest_change: float = math.inf  # size beyond which a Newton step is shortened
    farthest: float = 4.0  # length of a Newton step, in those along the branch, at which it fails
    fresh: bool = True  # tangents from the equations at the very point, not at the last iterate


@dataclass(frozen=True)
class Point:
    """A solution on a branch: unknowns and parameter with a tangent of unit length, (n + 1,)."""

    z: Array
    tangent: Array

    @property
    def x(self) -> Array:
        """Unknowns, shape (n,)."""
        return self.z[:-1]

    @property
    def p(self) -> float:
        """Parameter."""
        return float(self.z[-1])


class Continuation:
    """A branch of solutions of a problem."""

    def __init__(self, problem: Problem, control: Control) -> None:
        self.problem, self.control = problem, control

    def product(self, a: Array, b: Array) -> float:
        """Of two changes."""
        return float((self.problem.weights * a) @ b)

    def length(self, change: Array) -> float:
        """Of a change."""
        return math.sqrt(self.product(change, change))

    def point(self, z: Array, towards: Array) -> Point:
        """A solution with its tangent on the side of a direction."""
        row = self.problem.weights * towards
        return Point(z, self._unit(self.problem.linearised(z), row / self.length(towards)))

    def starting(self, z: Array, direction: Array) -> Point:
        """A point with a direction for its tangent, as at a branch point in a null direction."""
        return Point(z, direction / self.length(direction))

    def _unit(self, equations: Solver, row: Array) -> Array:
        try:
            tangent = equations(row, 1.0, 0.0)
        except (LinAlgError, ValueError) as error:
            raise NewtonFailed(f"the branch has no tangent: {error}") from error
        length = self.length(tangent)
        if not math.isfinite(length) or length == 0.0:
            raise NewtonFailed("the branch has no tangent")
        return tangent / length

    def at(self, start: Point, ds: float, guess: Array | None = None) -> Point:
        """The point at arc length ds from another, measured along its tangent.

        Newton's method begins at the guess, on the tangent where there is none. With ds = 0 a start
        that misses the equations is corrected.
        """
        z = start.z + ds * start.tangent if guess is None else guess
        row = self.problem.weights * start.tangent
        farthest = self.control.farthest * (abs(ds) + 1e-6)
        z, last = self._solved(z, row, float(row @ start.z) + ds, farthest)
        equations = self.problem.linearised(z) if self.control.fresh else last
        return Point(z, self._unit(equations, row))

    def fixed(self, guess: Array, p: float) -> Array:
        """Unknowns and parameter of the solution at a value of the parameter."""
        row = np.zeros(guess.size)
        row[-1] = 1.0
        z, _ = self._solved(np.append(guess[:-1], p), row, p, math.inf)
        return z

    def _solved(self, z: Array, row: Array, value: float, longest: float) -> tuple[Array, Solver]:
        """The solution with row @ z = value, and the equations about the last iterate."""
        last: Solver | None = None

        def correction(here: Array) -> tuple[Array, float]:
            nonlocal last
            last = self.problem.linearised(here)
            step = last(row, value - float(row @ here), 1.0)
            if self.length(step) > longest:
                raise NewtonFailed("Newton's method left the neighbourhood of its start")
            return step, self.problem.relative(here, step)

        control = self.control
        self.problem.check(z)
        found = newton(
            z,
            correction,
            tolerance=control.tolerance,
            stagnation=control.stagnation,
            longest=control.longest_change,
            iterations=control.iterations,
            patience=control.patience,
            check=self.problem.check,
        )
        assert last is not None
        return found, last

    def next(self, start: Point, step: float) -> tuple[Segment, float]:
        """The step to the next point, at most so long, and the length to try after it."""
        control = self.control
        while True:
            reason = NewtonFailed("it turns too sharply")
            try:
                found = self.at(start, step)
                straight = self.product(start.tangent, found.tangent)
                straight = min(straight, step / self.length(found.z - start.z))
                if straight >= math.cos(control.turn):
                    break
            except NewtonFailed as error:
                reason = error
            step *= 0.5
            if step < control.shortest:
                raise reason
        longer = 1.5 if straight > math.cos(0.5 * control.turn) else 1.0
        return Segment(self, start, found), min(longer * step, control.longest)


@dataclass(frozen=True)
class Segment:
    """What lies between two neighbouring points of a branch; any point there can be solved for."""

    branch: Continuation
    begin: Point
    end: Point

    @property
    def length(self) -> float:
        """Arc length along the tangent at the beginning."""
        return self.reach(self.end.z)

    @property
    def slopes(self) -> tuple[float, float]:
        """Derivative of the parameter by arc length at both ends."""
        return float(self.begin.tangent[-1]), float(self.end.tangent[-1])

    def reach(self, z: Array) -> float:
        """Arc length at which a point lies."""
        return self.branch.product(self.begin.tangent, z - self.begin.z)

    @cached_property
    def guess(self) -> CubicHermiteSpline:
        """The cubic through both ends with their tangents, a function of arc length."""
        onward = self.end.tangent / self.branch.product(self.begin.tangent, self.end.tangent)
        ends, slopes = [self.begin.z, self.end.z], [self.begin.tangent, onward]
        return CubicHermiteSpline([0.0, self.length], ends, slopes)

    def at(self, s: float) -> Point:
        """The point at an arc length."""
        return self.branch.at(self.begin, s, self.guess(s))

    def where(self, p: float) -> Array:
        """The solution at a value of the parameter between those at the ends."""
        part = self
        for _ in range(8):  # halvings, after which the ends are 256 times nearer to each other
            try:
                return part.landing(p)
            except NewtonFailed:
                middle = part.at(0.5 * part.length)
            if (middle.p - p) * (part.begin.p - p) <= 0.0:
                part = replace(part, end=middle)
            else:
                part = replace(part, begin=middle)
        return part.landing(p)

    def landing(self, p: float) -> Array:
        """The same by one run of Newton's method."""
        ends = self.begin.p - p, self.end.p - p
        if 0.0 in ends:
            s = self.length * float(ends[0] != 0.0)
        else:
            s = float(brentq(lambda s: self.guess(s)[-1] - p, 0.0, self.length))
        found = self.branch.fixed(self.guess(s), p)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return found


def folds(segment: Segment, rtol: float) -> list[float]:
    """Arc lengths within a segment at which the parameter turns back: none, one or two.

    They are known to rtol times the length of the segment.
    """
    first, last = segment.slopes
    length = segment.length
    known = {0.0: first, length: last}
    ends = [0.0, length]
    if first * last > 0.0:
        # Where the cubic with the ends' parameters and slopes is flattest.
        mean = (segment.end.p - segment.begin.p) / length
        bend = 6.0 * (0.5 * (first + last) - mean)
        share = 0.5 - 0.5 * (last - first) / bend if bend else 0.0
        flattest = first + share * (last - first - bend * (1.0 - share))
        steepest = max(first, last, key=abs)
        if 0.0 < share < 1.0 and flattest / steepest < FLAT:
            ends.insert(1, share * length)

    def slope(s: float) -> Array:
        if s not in known:
            known[s] = float(segment.at(s).tangent[-1])
        return np.array([known[s]])

    changes = (sign_changes(slope, *pair, rtol * length) for pair in pairwise(ends))
    return [beyond for pairs in changes for _, beyond in pairs]


def sign_changes(
    values: Callable[[float], Array], low: float, high: float, tolerance: float
) -> Iterator[tuple[float, float]]:
    """Where the number of positive values changes: lengths right before and right beyond, in order.

    Values at an arc length are in falling order, so that the one that passes 0 is a continuous
    function of the length unless others pass with it; they are asked for repeatedly.
    """
    tried: set[float] = set()

    def value(s: float, which: int) -> float:
        tried.add(s)
        return float(values(s)[which])

    def count(s: float) -> int:
        tried.add(s)
        return int(np.count_nonzero(values(s) > 0.0))

    for _ in range(8):  # six on one step are the most that have been met
        first, last = count(low), count(high)
        if first == last:
            return
        passing = first - (last < first)
        root = float(brentq(value, low, high, (passing,), xtol=tolerance))
        if value(root, passing) == 0.0:  # then the interval may still be wide
            tried |= {max(low, root - tolerance), min(root + tolerance, high)}
        lengths = sorted(s for s in tried if low <= s <= high)
        i = next(i for i, s in enumerate(lengths) if count(s) != first)
        yield lengths[i - 1], lengths[i]
        low = lengths[i]


# ----------------------------------------------------------------------------- dense equations


class DenseProblem:
    """n equations in n unknowns and a parameter, with dense derivatives.

    Args:
        equations: of x and p gives the residual G, shape (n,), and [G_x, G_p], shape (n, n + 1).
        size: n.
        scale: change of the parameter that is as long as one of every x by 1.
    """

    def __init__(
        self, equations: Callable[[Array, float], tuple[Array, Array]], size: int, scale: float
    ) -> None:
        self.equations = equations
        self.weights = np.append(np.full(size, 1.0 / size), scale**-2)

    def linearised(self, z: Array) -> Solver:
        """The equations about a point."""
        residual, derivative = self.equations(z[:-1], float(z[-1]))

        def change(row: Array, gap: float, share: float) -> Array:
            right = np.append(-share * residual, gap)
            return _dense_solution(np.vstack([derivative, row]), right)

        return change

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step relative to 1 plus that of the point."""
        lengths = [math.sqrt(float((self.weights * v) @ v)) for v in (step, z)]
        return lengths[0] / (1.0 + lengths[1])

    def check(self, z: Array) -> None:
        """Every point may be followed."""


def _dense_solution(matrix: Array, right: Array) -> Array:
    """Of linear equations, which numpy would not refuse for what is not finite."""
    if not np.isfinite(matrix).all():
        raise ValueError("derivatives are not finite")
    factorised()
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
