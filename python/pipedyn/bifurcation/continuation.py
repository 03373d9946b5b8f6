# SPDX-License-Identifier: MIT
"""Pseudo-arclength continuation: branches of solutions of G(x, p) = 0, past folds in p.

From a solution z = (x, p) with unit tangent t the predictor is z + ds t; the corrector is Newton's
method with the condition <t, Z - z> = ds, which stays regular at a fold. The product is weighted:
<a, b> = sum of weights a b. A problem inherits all this and solves its own bordered linear
equations [G_z; row] dz = [-G; gap], be their matrices dense (equilibria) or almost block diagonal
(periodic orbits). Whatever solves for a point raises `NewtonFailed` where there is none.

Source: Keller (1977), Numerical solution of bifurcation and nonlinear eigenvalue problems.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Generic, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed, newton

FLAT = 0.3
"""Share of a step's steepest slope dp/ds below which there may be two folds within it: a cubic
through the ends misjudges the slope between them by less, as tangents turn by `Control.turn`."""

Solver = Callable[[Array, float, float], Array]
"""G_z at a point, factorised. To row, gap and share it gives the dz with G_z dz = -share G and
row @ dz = gap: with share 1 Newton's step, with share 0 a tangent."""


@dataclass(frozen=True)
class Control:
    """How steps are taken: along the branch, and in Newton's method by `Continuation.relative`."""

    longest: float  # step along the branch
    shortest: float = 1e-7  # step at which a branch that cannot be continued is given up
    turn: float = 0.35  # angle between neighbouring tangents, rad; beyond, the step is halved
    tolerance: float = 1e-12  # size of Newton's last step
    stagnation: float = 1e-8  # the same where rounding keeps steps from getting shorter
    iterations: int = 15  # of Newton's method
    patience: int | None = None  # slow Newton steps in a row after which it is given up
    longest_change: float = math.inf  # size beyond which a Newton step is shortened


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


Problem = TypeVar("Problem", bound="Continuation")


class Continuation(ABC):
    """n equations in n unknowns x and a parameter p, z = (x, p), whose solutions are followed.

    Args:
        weights: of squares in the length of a change, shape (n + 1,).
        control: how steps are taken.
    """

    def __init__(self, weights: Array, control: Control) -> None:
        self.weights, self.control = weights, control

    @abstractmethod
    def linearised(self, z: Array) -> Solver:
        """The equations about a point."""

    @abstractmethod
    def relative(self, z: Array, step: Array) -> float:
        """Size of a step of Newton's method relative to that of the solution."""

    @abstractmethod
    def check(self, z: Array) -> None:
        """Raises NewtonFailed for what is not to be followed."""

    def product(self, a: Array, b: Array) -> float:
        """Of two changes."""
        return float((self.weights * a) @ b)

    def length(self, change: Array) -> float:
        """Of a change."""
        return math.sqrt(self.product(change, change))

    def point(self, z: Array, towards: Array) -> Point:
        """A solution with its tangent on the side of a direction."""
        row = self.weights * towards / self.length(towards)
        return Point(z, self._unit(self.linearised(z), row))

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
        row = self.weights * start.tangent
        z, equations = self._solved(z, row, float(row @ start.z) + ds)
        return Point(z, self._unit(equations, row))

    def fixed(self, guess: Array, p: float) -> Array:
        """Unknowns and parameter of the solution at a value of the parameter."""
        row = np.zeros(guess.size)
        row[-1] = 1.0
        z, _ = self._solved(np.append(guess[:-1], p), row, p)
        z[-1] = p  # to the bit
        return z

    def _solved(self, z: Array, row: Array, value: float) -> tuple[Array, Solver]:
        """The solution with row @ z = value, and the equations about the last iterate."""
        last: Solver | None = None

        def correction(here: Array) -> tuple[Array, float]:
            nonlocal last
            last = self.linearised(here)
            step = last(row, value - float(row @ here), 1.0)
            return step, self.relative(here, step)

        control = self.control
        self.check(z)
        found = newton(
            z,
            correction,
            tolerance=control.tolerance,
            stagnation=control.stagnation,
            longest=control.longest_change,
            iterations=control.iterations,
            patience=control.patience,
            check=self.check,
        )
        assert last is not None
        return found, last

    def next(
        self: Problem, start: Point, step: float, bend: Array | None = None
    ) -> tuple[Segment[Problem], float]:
        """The step to the next point, at most so long, and the length to try after it.

        Newton's method begins on the parabola with this bend, the tangent's derivative by arc
        length, if one is given.
        """
        control = self.control
        while True:
            reason = NewtonFailed("it turns too sharply")
            guess = None
            if bend is not None:
                guess = start.z + step * (start.tangent + 0.5 * step * bend)
            try:
                found = self.at(start, step, guess)
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
class Segment(Generic[Problem]):
    """What lies between two neighbouring points of a branch; any point there can be solved for."""

    problem: Problem
    begin: Point
    end: Point

    @property
    def length(self) -> float:
        """Arc length along the tangent at the beginning."""
        return self.reach(self.end.z)

    @property
    def bend(self) -> Array:
        """About the derivative of the tangent by arc length."""
        return (self.end.tangent - self.begin.tangent) / self.length

    @property
    def slopes(self) -> tuple[float, float]:
        """Derivative of the parameter by arc length at both ends."""
        return float(self.begin.tangent[-1]), float(self.end.tangent[-1])

    def reach(self, z: Array) -> float:
        """Arc length at which a point lies."""
        return self.problem.product(self.begin.tangent, z - self.begin.z)

    @cached_property
    def guess(self) -> scipy.interpolate.CubicHermiteSpline:
        """The cubic through both ends with their tangents, a function of arc length."""
        onward = self.end.tangent / self.problem.product(self.begin.tangent, self.end.tangent)
        ends, slopes = [self.begin.z, self.end.z], [self.begin.tangent, onward]
        return scipy.interpolate.CubicHermiteSpline([0.0, self.length], ends, slopes)

    def at(self, s: float) -> Point:
        """The point at an arc length."""
        ends = {0.0: self.begin, self.length: self.end}
        return ends.get(s) or self.problem.at(self.begin, s, self.guess(s))

    def parts(self, lengths: list[float]) -> list[Segment[Problem]]:
        """The segments into which points at these arc lengths divide it."""
        points = [self.begin, *map(self.at, lengths), self.end]
        return [replace(self, begin=a, end=b) for a, b in pairwise(points)]

    def where(self, p: float) -> Array:
        """The solution at a value of the parameter between those at the ends."""
        ends = {0.0: self.begin.p, self.length: self.end.p}
        s = scipy.optimize.brentq(lambda s: ends.get(s, self.guess(s)[-1]) - p, 0.0, self.length)
        found = self.problem.fixed(self.guess(s), p)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return found


def folds(segment: Segment[Problem], rtol: float) -> list[float]:
    """Arc lengths within a segment at which the parameter turns back: none, one or two.

    They are known to rtol times the length of the segment.
    """
    first, last = segment.slopes
    length = segment.length
    ends = [0.0, length]
    if first * last > 0.0:
        # Where the cubic with the ends' parameters and slopes is flattest.
        mean = (segment.end.p - segment.begin.p) / length
        bend = 6.0 * (0.5 * (first + last) - mean)
        share = 0.5 - 0.5 * (last - first) / bend if bend else 0.0
        flattest = first + share * (last - first - bend * (1.0 - share))
        if 0.0 < share < 1.0 and flattest / max(first, last, key=abs) < FLAT:
            ends.insert(1, share * length)

    @cache
    def slope(s: float) -> Array:
        return np.array([segment.at(s).tangent[-1]])

    changes = (sign_changes(slope, *pair, rtol * length) for pair in pairwise(ends))
    return [beyond for pairs in changes for _, beyond in pairs]


def sign_changes(
    values: Callable[[float], Array], low: float, high: float, tolerance: float
) -> Iterator[tuple[float, float]]:
    """Where the number of positive values changes: lengths right before and right beyond, in order.

    Values at an arc length are in falling order, so that the one that passes 0 is a continuous
    function of the length unless others pass with it; they are asked for repeatedly.
    """

    def count(s: float) -> int:
        return int(np.count_nonzero(values(s) > 0.0))

    for _ in range(8):  # six on one step are the most that have been met
        first, last = count(low), count(high)
        if first == last:
            return
        passing = first - (last < first)
        root = scipy.optimize.brentq(lambda s, i: values(s)[i], low, high, (passing,), tolerance)
        width = tolerance  # more where rounding hides the change
        while count(max(low, root - width)) == count(min(root + width, high)):
            width *= 2.0
        yield max(low, root - width), min(root + width, high)
        low = min(root + width, high)


# ----------------------------------------------------------------------------- dense equations


class DenseProblem(Continuation):
    """n equations in n unknowns and a parameter, with dense derivatives.

    Args:
        equations: of x and p gives the residual G, shape (n,), and [G_x, G_p], shape (n, n + 1).
        size: n.
        scale: change of the parameter that is as long as one of every x by 1.
        control: how steps are taken.
    """

    def __init__(
        self,
        equations: Callable[[Array, float], tuple[Array, Array]],
        size: int,
        scale: float,
        control: Control,
    ) -> None:
        super().__init__(np.append(np.full(size, 1.0 / size), scale**-2), control)
        self.equations = equations

    def linearised(self, z: Array) -> Solver:
        """The equations about a point."""
        residual, derivative = self.equations(z[:-1], float(z[-1]))

        def change(row: Array, gap: float, share: float) -> Array:
            matrix = np.vstack([derivative, row])
            if not np.isfinite(matrix).all():  # numpy would not refuse it
                raise ValueError("derivatives are not finite")
            factorised()
            return np.asarray(np.linalg.solve(matrix, np.append(-share * residual, gap)))

        return change

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step relative to 1 plus that of the point."""
        return self.length(step) / (1.0 + self.length(z))

    def check(self, z: Array) -> None:
        """Every point may be followed."""
