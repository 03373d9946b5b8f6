# SPDX-License-Identifier: MIT
"""Solutions of g(x, p) = 0 followed by pseudo-arclength, so that folds in p are no obstacle.

From a solution z = (x, p) with unit tangent t the next lies on the plane <t, Z - z> = ds: Newton's
method solves [g_x, g_p; t^T W] dZ = -[g; <t, Z - z> - ds], which stays regular at a fold. Lengths
are |x|^2 / n + (p / scale)^2, so that a step means the same whatever the size of the model.

Source: Keller (1977), Numerical solution of bifurcation and nonlinear eigenvalue problems.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.linalg import LinAlgError
from scipy.optimize import brentq

from pipedyn.models.base import PipedynError
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

MOST_TURN = 0.35
"""Angle between neighbouring tangents, rad: a step that turns further is halved."""

SMALLEST = 1e-7
"""Step at which a path that cannot be continued is given up."""

NEWTON = 12
"""Iterations of Newton's method for one point; it takes 2 to 4 where the step is right."""

SETTLED = 1e-12
"""Last step of Newton's method beside the size of the solution, where rounding allows it."""


class Lost(PipedynError):
    """A point of a path that Newton's method did not find."""


class Problem(Protocol):
    """n equations in n unknowns and a parameter."""

    def residual(self, x: Array, p: float) -> Array:
        """g, shape (n,)."""

    def jacobian(self, x: Array, p: float) -> Array:
        """g_x, shape (n, n)."""

    def by_parameter(self, x: Array, p: float) -> Array:
        """g_p, shape (n,)."""


@dataclass(frozen=True)
class Point:
    """A solution on a path.

    Attributes:
        x: unknowns, shape (n,).
        p: parameter.
        tangent: of the path in (x, p), of unit length in the path's metric, shape (n + 1,).
        iterations: that Newton's method took.
    """

    x: Array
    p: float
    tangent: Array
    iterations: int = 0


def solve(problem: Problem, x: Array, p: float, largest_step: float = 0.5) -> tuple[Array, float]:
    """A solution at a given parameter by Newton's method.

    Args:
        problem: the equations.
        x: where to begin, shape (n,).
        p: the parameter.
        largest_step: of an entry of x; longer steps are shortened.

    Returns:
        The solution and the largest entry of Newton's last step, which measures its error.

    Raises:
        Lost: if none is found from there.
    """
    last = math.inf
    for _ in range(60):
        try:
            move = -_solved(problem.jacobian(x, p), problem.residual(x, p))
        except (LinAlgError, ValueError) as error:
            raise Lost(f"no solution at {p:g}: {error}") from error
        step = float(np.abs(move).max())
        if not math.isfinite(step):
            break
        x = x + move * min(1.0, largest_step / max(step, 1e-300))
        size = 1.0 + float(np.abs(x).max())
        if step <= SETTLED * size or (step <= 1e-8 * size and step >= 0.5 * last):
            return x, step
        last = step
    raise Lost(f"no solution at {p:g} was found from there")


class Path:
    """A path of solutions.

    Args:
        problem: the equations.
        scale: change of the parameter that counts like one rad of every coordinate.
    """

    def __init__(self, problem: Problem, scale: float) -> None:
        self.problem, self.scale = problem, scale

    def length(self, z: Array) -> float:
        """Of a difference of two points (x, p)."""
        return math.sqrt(self.product(z, z))

    def product(self, a: Array, b: Array) -> float:
        """Of two differences, in the path's metric."""
        return float(a[:-1] @ b[:-1]) / (a.size - 1) + float(a[-1] * b[-1]) / self.scale**2

    def at(self, x: Array, p: float, towards: Array) -> Point:
        """The point with its tangent on the side of a direction (x, p)."""
        tangent = self._tangent(x, p, towards)
        return Point(x, p, tangent)

    def heading(self, x: Array, p: float, sign: float) -> Point:
        """The point with its tangent towards growing (1) or falling (-1) parameter."""
        direction = np.zeros(x.size + 1)
        direction[-1] = sign
        return self.at(x, p, direction)

    def leaving(self, x: Array, p: float, towards: Array, distance: float) -> Point:
        """A point at a distance from a branch point, in the direction of a null vector (n,)."""
        tangent = np.append(towards, 0.0)
        tangent /= self.length(tangent)
        return self.stepped(Point(x, p, tangent), distance)

    def stepped(self, start: Point, ds: float) -> Point:
        """The point at arc length ds, measured along the tangent.

        Raises:
            Lost: if Newton's method does not settle.
        """
        n = start.x.size
        z = np.append(start.x, start.p)
        row = np.append(start.tangent[:-1] / n, start.tangent[-1] / self.scale**2)
        offset = float(row @ z) + ds
        z = z + ds * start.tangent
        last = math.inf
        for iteration in range(1, NEWTON + 1):
            x, p = z[:-1], float(z[-1])
            g = np.append(self.problem.residual(x, p), row @ z - offset)
            try:
                move = -_solved(self._bordered(x, p, row), g)
            except (LinAlgError, ValueError) as error:
                raise Lost(f"the path was lost at {p:g}: {error}") from error
            z = z + move
            step = self.length(move)
            size = 1.0 + self.length(z)
            if not math.isfinite(step) or step > 4.0 * abs(ds) + 1e-6:
                break
            if step <= SETTLED * size or (step <= 1e-8 * size and step >= 0.5 * last):
                x, p = z[:-1].copy(), float(z[-1])
                return Point(x, p, self._tangent(x, p, start.tangent), iteration)
            last = step
        raise Lost(f"the path was lost near {start.p:g}")

    def _bordered(self, x: Array, p: float, row: Array) -> Array:
        n = x.size
        whole = np.empty((n + 1, n + 1))
        whole[:n, :n] = self.problem.jacobian(x, p)
        whole[:n, n] = self.problem.by_parameter(x, p)
        whole[n] = row
        return whole

    def _tangent(self, x: Array, p: float, towards: Array) -> Array:
        n = x.size
        row = np.append(towards[:-1] / n, towards[-1] / self.scale**2)
        right = np.zeros(n + 1)
        right[n] = 1.0
        try:
            tangent = _solved(self._bordered(x, p, row), right)
        except (LinAlgError, ValueError) as error:
            raise Lost(f"the path has no direction at {p:g}: {error}") from error
        length = self.length(tangent)
        if not math.isfinite(length):
            raise Lost(f"the path has no direction at {p:g}")
        return tangent / length

    def following(self, start: Point, step: float, longest: float) -> tuple[Point, float, float]:
        """The next point, the step that led there and the step to try after it.

        Raises:
            Lost: if not even the smallest step finds one.
        """
        while True:
            try:
                found = self.stepped(start, step)
            except Lost:
                found = None
            if found is not None:
                turn = self.product(start.tangent, found.tangent)
                if turn >= math.cos(MOST_TURN):
                    break
            step *= 0.5
            if step < SMALLEST:
                raise Lost(f"the path could not be followed beyond {start.p:g}")
        change = 1.5 if found.iterations <= 4 and turn > math.cos(0.5 * MOST_TURN) else 1.0
        return found, step, min(step * change, longest)

    def turning(self, a: Point, ds: float) -> tuple[Point, float]:
        """The point, at most ds from a, at which the parameter turns, and its arc length."""
        along = brentq(lambda s: self.stepped(a, s).tangent[-1], 0.0, ds, xtol=1e-13, rtol=1e-13)
        return self.stepped(a, float(along)), float(along)

    def change(
        self, a: Point, low: float, high: float, count: Callable[[Point], int]
    ) -> tuple[Point, float]:
        """Where a whole number first differs from its value at a lower arc length, by bisection.

        Args:
            a: where arc length counts from.
            low: arc length before the change.
            high: arc length beyond it.
            count: the number.

        Returns:
            The point just beyond the change and its arc length from a.
        """
        first = count(self.stepped(a, low))
        width = 1e-10 * (1.0 + high)
        beyond = self.stepped(a, high)
        while high - low > width:
            middle, point = self._within(a, low, high)
            if point is None:
                break
            if count(point) == first:
                low = middle
            else:
                high, beyond = middle, point
        return beyond, high

    def _within(self, a: Point, low: float, high: float) -> tuple[float, Point | None]:
        """A point between two arc lengths; None if there is a branch point in its way."""
        for share in (0.5, 0.37, 0.66):
            middle = low + share * (high - low)
            try:
                return middle, self.stepped(a, middle)
            except Lost:
                continue
        return low, None

    def landing(self, a: Point, ds: float, p: float) -> tuple[Point, float]:
        """The point, at most ds from a, at which the parameter has a value, and its arc length."""
        along = brentq(lambda s: self.stepped(a, s).p - p, 0.0, ds, xtol=1e-13, rtol=1e-13)
        return self.stepped(a, float(along)), float(along)


def _solved(matrix: Array, right: Array) -> Array:
    """Solution of linear equations, which numpy would not refuse for what is not finite."""
    if not np.isfinite(matrix).all():
        raise ValueError("its derivatives left finite numbers")
    factorised()
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
