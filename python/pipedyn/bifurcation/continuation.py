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
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.linalg import LinAlgError
from scipy.optimize import brentq

from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed, newton

FLAT = 0.3
"""Share of a step's steepest slope dp/ds below which there may be two folds within it: a cubic
through the ends misjudges the slope between them by less, as tangents turn by `Control.turn`."""

HALVINGS = 8
"""Of a step on which Newton's method at a fixed parameter fails: its ends are then 256 times nearer
to each other."""


class LinearisedEquations(Protocol):
    """G_z at a point, factorised."""

    def correction(self, row: Array, gap: float) -> Array:
        """The dz with G_z dz = -G and row @ dz = gap."""

    def tangent(self, row: Array) -> Array:
        """The dz with G_z dz = 0 and row @ dz = 1."""


class Problem(Protocol):
    """n equations in n unknowns x and a parameter p, z = (x, p)."""

    weights: Array
    """Of squares in the length of a change, shape (n + 1,)."""

    def linearised(self, z: Array) -> LinearisedEquations:
        """The equations about a point."""

    def relative(self, z: Array, step: Array) -> float:
        """Size of a step of Newton's method beside that of the solution."""

    def check(self, z: Array) -> None:
        """Raises NewtonFailed for what is not to be followed."""


@dataclass(frozen=True)
class Control:
    """How steps are taken.

    Attributes:
        longest: step.
        shortest: step at which a branch that cannot be continued is given up.
        turn: angle between neighbouring tangents, rad: a step that turns further is shortened.
        shorten: factor by which it is.
        tolerance: relative size of Newton's last step.
        stagnation: the same where rounding keeps steps from getting shorter.
        iterations: of Newton's method.
        patience: steps of Newton's method in a row that are no shorter than half the one before,
            after which a shorter step along the branch is cheaper.
        longest_change: relative size beyond which a step of Newton's method is shortened.
        farthest: step of Newton's method, beside that along the branch, with which it is given up.
        quick: iterations up to which the next step is made longer.
        fresh: whether tangents are computed from the equations about the very point, and not about
            the last iterate before it.
    """

    longest: float
    shortest: float = 1e-7
    turn: float = 0.35
    shorten: float = 0.5
    tolerance: float = 1e-12
    stagnation: float = 1e-8
    iterations: int = 12
    patience: int | None = None
    longest_change: float = math.inf
    farthest: float = 4.0
    quick: int = 4
    fresh: bool = True


@dataclass(frozen=True)
class Point:
    """A solution on a branch.

    Attributes:
        z: unknowns and parameter, shape (n + 1,).
        tangent: of unit length, shape (n + 1,).
        iterations: that Newton's method took.
    """

    z: Array
    tangent: Array
    iterations: int = 0

    @property
    def x(self) -> Array:
        """Unknowns, shape (n,)."""
        return self.z[:-1]

    @property
    def p(self) -> float:
        """Parameter."""
        return float(self.z[-1])


class Continuation:
    """A branch of solutions.

    Args:
        problem: the equations.
        control: how steps are taken.
    """

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

    def _unit(self, equations: LinearisedEquations, row: Array) -> Array:
        try:
            tangent = equations.tangent(row)
        except (LinAlgError, ValueError) as error:
            raise NewtonFailed(f"the branch has no tangent: {error}") from error
        length = self.length(tangent)
        if not math.isfinite(length) or length == 0.0:
            raise NewtonFailed("the branch has no tangent")
        return tangent / length

    def at(self, start: Point, ds: float, guess: Array | None = None) -> Point:
        """The point at arc length ds from another, measured along its tangent.

        Args:
            start: the other.
            ds: the length.
            guess: where Newton's method begins; on the tangent where not given.
        """
        z = start.z + ds * start.tangent if guess is None else guess
        row = self.problem.weights * start.tangent
        return self._solved(
            z, row, float(row @ start.z) + ds, self.control.farthest * abs(ds) + 1e-6
        )

    def corrected(self, start: Point) -> Point:
        """The point nearest to one that misses the equations, across its tangent."""
        row = self.problem.weights * start.tangent
        return self._solved(start.z, row, float(row @ start.z), math.inf)

    def fixed(self, guess: Array, p: float) -> Point:
        """The point at a value of the parameter."""
        row = np.zeros(guess.size)
        row[-1] = 1.0
        return self._solved(np.append(guess[:-1], p), row, p, math.inf)

    def _solved(self, z: Array, row: Array, value: float, longest: float) -> Point:
        last: LinearisedEquations | None = None

        def correction(here: Array) -> tuple[Array, float]:
            nonlocal last
            last = self.problem.linearised(here)
            step = last.correction(row, value - float(row @ here))
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
        equations = self.problem.linearised(found.state) if control.fresh else last
        return Point(found.state, self._unit(equations, row), found.iterations)

    def next(self, start: Point, step: float) -> tuple[Segment, float]:
        """The step to the next point, at most so long, and the length to try after it.

        Raises:
            NewtonFailed: if not even the shortest step finds one.
        """
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
            step *= control.shorten
            if step < control.shortest:
                raise reason
        gentle = found.iterations <= control.quick and straight > math.cos(0.5 * control.turn)
        return Segment(self, start, found), min(step * (1.5 if gentle else 1.0), control.longest)


@dataclass(frozen=True)
class Segment:
    """What lies between two neighbouring points of a branch, any point of which can be solved for.

    Attributes:
        branch: the continuation.
        begin, end: the points.
    """

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

    def guess(self, s: float) -> Array:
        """The cubic through both ends with their tangents, at an arc length."""
        length = self.length
        share = s / length
        onward = self.end.tangent / self.branch.product(self.begin.tangent, self.end.tangent)
        moved = self.end.z - self.begin.z
        bend = self.begin.tangent - moved / length
        other = onward - moved / length
        inner = share * (1.0 - share) * length
        cubic: Array = inner * ((1.0 - share) * bend - share * other)
        return self.begin.z + share * moved + cubic

    def at(self, s: float) -> Point:
        """The point at an arc length."""
        return self.branch.at(self.begin, s, self.guess(s))

    def slope(self, s: float) -> float:
        """Derivative of the parameter by arc length."""
        return float(self.at(s).tangent[-1])

    def part(self, begin: Point, end: Point) -> Segment:
        """What lies between two of its points."""
        return replace(self, begin=begin, end=end)

    def where(self, p: float) -> Point:
        """The point at a value of the parameter between those at the ends."""
        part = self
        for _ in range(HALVINGS):
            try:
                return part.landing(p)
            except NewtonFailed:
                middle = part.at(0.5 * part.length)
            before = (middle.p - p) * (part.begin.p - p) <= 0.0
            part = part.part(part.begin, middle) if before else part.part(middle, part.end)
        return part.landing(p)

    def landing(self, p: float) -> Point:
        """The same by one run of Newton's method."""
        ends = self.begin.p - p, self.end.p - p
        if 0.0 in ends:
            s = self.length * float(ends[0] != 0.0)
        else:
            s = float(brentq(lambda s: self.guess(s)[-1] - p, 0.0, self.length))
        found = self.branch.fixed(self.guess(s), p)
        if not -0.5 * self.length <= self.reach(found.z) <= 1.5 * self.length:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        onward = self.branch.product(self.begin.tangent, found.tangent) > 0.0
        return found if onward else replace(found, tangent=-found.tangent)


def folds(segment: Segment, rtol: float) -> list[float]:
    """Arc lengths within a segment at which the parameter turns back: none, one or two.

    Args:
        segment: the segment.
        rtol: tolerance beside the length of the segment.
    """
    first, last = segment.slopes
    length = segment.length
    known = {0.0: first, length: last}

    def slope(s: float) -> float:
        if s not in known:
            known[s] = segment.slope(s)
        return known[s]

    brackets = []
    if first * last < 0.0:
        brackets = [(0.0, length)]
    elif first * last > 0.0:
        # Where the cubic with the ends' parameters and slopes is flattest.
        mean = (segment.end.p - segment.begin.p) / length
        bend = 6.0 * (0.5 * (first + last) - mean)
        share = 0.5 - 0.5 * (last - first) / bend if bend else 0.0
        flattest = first + share * (last - first - bend * (1.0 - share))
        steepest = max(first, last, key=abs)
        if 0.0 < share < 1.0 and flattest / steepest < FLAT:
            middle = share * length
            if slope(middle) * first < 0.0:
                brackets = [(0.0, middle), (middle, length)]
    return [float(brentq(slope, *pair, xtol=rtol * length)) for pair in brackets]


def change(
    segment: Segment, low: float, high: float, count: Callable[[Point], int]
) -> tuple[Point, float]:
    """Where a whole number first differs from its value at a lower arc length, by bisection.

    Args:
        segment: the segment.
        low: arc length before the change.
        high: arc length beyond it.
        count: the number.

    Returns:
        The point just beyond the change and its arc length.
    """
    first = count(segment.at(low))
    width = 1e-10 * (1.0 + high)
    beyond = segment.at(high)
    while high - low > width:
        middle, point = _within(segment, low, high)
        if point is None:
            break
        if count(point) == first:
            low = middle
        else:
            high, beyond = middle, point
    return beyond, high


def _within(segment: Segment, low: float, high: float) -> tuple[float, Point | None]:
    """A point between two arc lengths; None if there is a branch point in its way."""
    for share in (0.5, 0.37, 0.66):
        middle = low + share * (high - low)
        try:
            return middle, segment.at(middle)
        except NewtonFailed:
            continue
    return low, None


# ----------------------------------------------------------------------------- dense equations


class Equations(Protocol):
    """n equations in n unknowns and a parameter, with dense derivatives."""

    def residual(self, x: Array, p: float) -> Array:
        """G, shape (n,)."""

    def jacobian(self, x: Array, p: float) -> Array:
        """G_x, shape (n, n)."""

    def by_parameter(self, x: Array, p: float) -> Array:
        """G_p, shape (n,)."""


class DenseProblem:
    """Equations whose bordered matrix is dense.

    Args:
        equations: the equations.
        size: their number.
        scale: change of the parameter that counts like a change by 1 of every unknown.
    """

    def __init__(self, equations: Equations, size: int, scale: float) -> None:
        self.equations = equations
        self.weights = np.append(np.full(size, 1.0 / size), scale**-2)

    def linearised(self, z: Array) -> _Bordered:
        """The equations about a point."""
        return _Bordered(self.equations, z)

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step beside 1 and that of the point."""
        lengths = [math.sqrt(float((self.weights * v) @ v)) for v in (step, z)]
        return lengths[0] / (1.0 + lengths[1])

    def check(self, z: Array) -> None:
        """Every point may be followed."""


class _Bordered:
    """The bordered matrix of dense equations about a point."""

    def __init__(self, equations: Equations, z: Array) -> None:
        x, p = z[:-1], float(z[-1])
        self.equations, self.x, self.p = equations, x, p
        self.derivative = np.column_stack([equations.jacobian(x, p), equations.by_parameter(x, p)])

    def correction(self, row: Array, gap: float) -> Array:
        """The dz with G_z dz = -G and row @ dz = gap."""
        missed = -self.equations.residual(self.x, self.p)
        return _dense_solution(np.vstack([self.derivative, row]), np.append(missed, gap))

    def tangent(self, row: Array) -> Array:
        """The dz with G_z dz = 0 and row @ dz = 1."""
        right = np.append(np.zeros(self.x.size), 1.0)
        return _dense_solution(np.vstack([self.derivative, row]), right)


def solve(equations: Equations, x: Array, p: float) -> Array:
    """A solution at a given parameter by Newton's method.

    Args:
        equations: the equations.
        x: where to begin, shape (n,).
        p: the parameter.

    Raises:
        NewtonFailed: if none is found from there.
    """

    def correction(x: Array) -> tuple[Array, float]:
        step = -_dense_solution(equations.jacobian(x, p), equations.residual(x, p))
        return step, float(np.abs(step).max())

    control = Control(longest=math.inf)
    found = newton(
        x,
        correction,
        tolerance=control.tolerance,
        stagnation=control.stagnation,
        longest=0.5,
        iterations=60,  # those that are shortened to half a radian go 30 rad, five turns
        scale=lambda x: 1.0 + float(np.abs(x).max()),
    )
    return found.state


def _dense_solution(matrix: Array, right: Array) -> Array:
    """Of linear equations, which numpy would not refuse for what is not finite."""
    if not np.isfinite(matrix).all():
        raise ValueError("derivatives are not finite")
    factorised()
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
