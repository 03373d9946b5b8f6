# SPDX-License-Identifier: MIT
"""Pseudo-arclength continuation: branches of solutions of G(x, p) = 0, past folds in p.

`tracer.Tracer` follows them, be they equilibria, cycles, boundaries or a user's own equations.

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
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed, newton

EVERY = slice(None)

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


@saved_as("PointOnBranch", shapes={"n": "z tangent"})
@dataclass(frozen=True)
class Point:
    """A solution on a branch: unknowns and parameter with a tangent of unit length, (n + 1,)."""

    z: Array
    tangent: Array
    kept: Any = field(default=None, repr=False, compare=False)  # see `Continuation.kept`

    @property
    def x(self) -> Array:
        """Unknowns, shape (n,)."""
        return self.z[:-1]

    @property
    def p(self) -> float:
        """Parameter."""
        return float(self.z[-1])


Equations = TypeVar("Equations", bound="Continuation")


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

    def check(self, z: Array) -> None:  # noqa: B027
        """Raises NewtonFailed for what is not to be followed: nothing unless a problem says."""

    def kept(self, equations: Solver, step: float) -> Any:
        """What is worth keeping of the equations about a solution; nothing unless a problem says.

        They are those about the last iterate, which Newton's last step, of this size, has left.
        """
        return None

    def product(self, a: Array, b: Array) -> float:
        """Inner product of two changes of the unknowns."""
        return float((self.weights * a) @ b)

    def length(self, change: Array) -> float:
        """Length of a change of the unknowns."""
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
        z, equations, kept = self._solved(z, row, float(row @ start.z) + ds)
        return Point(z, self._unit(equations, row), kept)

    def fixed(self, guess: Array, p: float, index: int = -1) -> Array:
        """The solution z at a value of the parameter, or of another entry of z."""
        return self.fixed_and_kept(guess, p, index)[0]

    def fixed_and_kept(self, guess: Array, p: float, index: int = -1) -> tuple[Array, Any]:
        """The solution at a value of the parameter, and what is `kept` of the equations there."""
        row, start = np.zeros(guess.size), guess.copy()
        row[index], start[index] = 1.0, p
        found, _, kept = self._solved(start, row, p)
        z = found.copy()
        z[index] = p  # to the bit
        return z, kept

    def _solved(self, z: Array, row: Array, value: float) -> tuple[Array, Solver, Any]:
        """The solution with row @ z = value, the equations about the last iterate, and `kept`."""
        last: Solver | None = None
        size = math.inf

        def correction(here: Array) -> tuple[Array, float]:
            nonlocal last, size
            last = self.linearised(here)
            step = last(row, value - float(row @ here), 1.0)
            size = self.relative(here, step)
            return step, size

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
        return found, last, self.kept(last, size)

    def next(
        self: Equations, start: Point, step: float, ahead: Callable[[float], Array] | None = None
    ) -> tuple[Segment[Equations], float]:
        """The step to the next point, at most so long, and the length to try after it.

        Newton's method begins at what `ahead` gives for an arc length, on the tangent without it.
        """
        control = self.control
        while True:
            reason = NewtonFailed("it turns too sharply")
            try:
                found = self.at(start, step, ahead(step) if ahead is not None else None)
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

    def segments(
        self: Equations, start: Point, step: float, marks: Iterable[tuple[int, float]] = ()
    ) -> Iterator[Segment[Equations]]:
        """Steps along the branch, without end; NewtonFailed where none can be taken.

        A step ends where an entry of z passes one of the marks, pairs of its index and a value.
        """
        while True:
            segment, step = self.next(start, step)
            segment = segment.up_to(marks)
            yield segment
            start = segment.end


@saved_as("StepAlongBranch", shapes={"n": "begin.z end.z problem.weights"})
@dataclass(frozen=True)
class Segment(Generic[Equations]):
    """What lies between two neighbouring points of a branch; any point there can be solved for."""

    problem: Equations
    begin: Point
    end: Point

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Segment[Equations]:
        """The segment of which a file kept this, if it is one of equations."""
        if not isinstance(fields["problem"], Continuation):
            raise TypeError(f"problem must be equations, got {check.shown(fields['problem'])}")
        return cls(**fields)

    @property
    def length(self) -> float:
        """Arc length along the tangent at the beginning."""
        return self.reach(self.end.z)

    def ahead(self, s: float) -> Array:
        """About the solution at an arc length beyond the end, along the tangent there."""
        share = self.problem.product(self.begin.tangent, self.end.tangent)
        # Through the ends: from points that lie close together it would lead anywhere.
        return self._on_cubic(self.length + share * s, 0.0, self.length)

    @property
    def slopes(self) -> tuple[float, float]:
        """Derivative of the parameter by arc length at both ends."""
        return float(self.begin.tangent[-1]), float(self.end.tangent[-1])

    def reach(self, z: Array) -> float:
        """Arc length at which a point lies."""
        return self.problem.product(self.begin.tangent, z - self.begin.z)

    @cached_property
    def _known(self) -> dict[float, tuple[Point, Array]]:
        """Points by arc length with their derivative by it: the ends and those solved for."""
        onward = self._derivative(self.end)
        return {0.0: (self.begin, self.begin.tangent), self.length: (self.end, onward)}

    def _derivative(self, point: Point) -> Array:
        return point.tangent / self.problem.product(self.begin.tangent, point.tangent)

    def guess(self, s: float, index: int | slice = EVERY) -> Array:
        """About the solution at an arc length, on the cubic through the nearest known points.

        These have their tangents, so that the cubic is Hermite's. index: of z, if not all is asked.
        """
        places = sorted(self._known)
        i = min(max(bisect_left(places, s), 1), len(places) - 1)
        return self._on_cubic(s, places[i - 1], places[i], index)

    def _on_cubic(self, s: float, low: float, high: float, index: int | slice = EVERY) -> Array:
        """About the solution at an arc length, on the cubic through two of the known points."""
        h, x = high - low, (s - low) / (high - low)
        (a, first), (b, last) = self._known[low], self._known[high]
        before, u, v = a.z[index], h * first[index], h * last[index]
        gap = b.z[index] - before
        found: Array = before + x * (u + x * (3.0 * gap - 2.0 * u - v + x * (u + v - 2.0 * gap)))
        return found

    def at(self, s: float) -> Point:
        """The point at an arc length."""
        if s not in self._known:
            found = self.problem.at(self.begin, s, self.guess(s))
            self._known[s] = found, self._derivative(found)
        return self._known[s][0]

    def up_to(self, marks: Iterable[tuple[int, float]]) -> Segment[Equations]:
        """The part up to where an entry of z passes one of the marks first; itself if none does."""
        z, end = self.begin.z, self.end.z
        passed = [(i, v) for i, v in marks if (v - z[i]) * (end[i] - v) > 0.0]
        if not passed:
            return self
        cut = min((self.where(v, i) for i, v in passed), key=self.reach)
        return replace(self, end=self.problem.point(cut, self.begin.tangent))

    def miss(self, z: Array) -> float:
        """Distance of a point from the solution at the same arc length."""
        s = self.reach(z)
        return self.problem.length(self.problem.at(self.begin, s, self.guess(s)).z - z)

    def parts(self, lengths: list[float]) -> list[Segment[Equations]]:
        """The segments into which points at these arc lengths divide it."""
        points = [self.begin, *map(self.at, lengths), self.end]
        return [replace(self, begin=a, end=b) for a, b in pairwise(points)]

    def where(self, p: float, index: int = -1) -> Array:
        """The solution at a value of the parameter, or another entry, between those at the ends."""
        return self.where_and_kept(p, index)[0]

    def where_and_kept(self, p: float, index: int = -1) -> tuple[Array, Any]:
        """The solution where the parameter has a value, and what is `kept` of the equations."""
        ends = {0.0: self.begin.z[index], self.length: self.end.z[index]}

        def apart(s: float) -> float:
            return float(ends[s] if s in ends else self.guess(s, index)) - p

        s = scipy.optimize.brentq(apart, 0.0, self.length)
        found, kept = self.problem.fixed_and_kept(self.guess(s), p, index)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return found, kept


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
