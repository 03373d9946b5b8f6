# SPDX-License-Identifier: MIT
"""Pseudo-arclength continuation: branches of solutions of G(x, p) = 0, past folds in p.

`tracer.Tracer` follows branches of equilibria and of cycles, boundaries of stability and branches
of a user's own equations by this method.

From a solution z = (x, p) with unit tangent t the predictor is z + ds t; the corrector is Newton's
method for Z with the condition <t, Z - z> = ds, which stays regular at a fold. The inner product is
weighted: <a, b> = sum of weights a b. A subclass of `Continuation` inherits all this and solves its
own bordered linear equations [G_z; row] dz = [-G; gap], whose matrices are dense (equilibria) or
almost block diagonal (periodic orbits). Functions that solve for a point raise `NewtonFailed` where
they find none.

Source: Keller (1977), Numerical solution of bifurcation and nonlinear eigenvalue problems.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed, newton, zero_between

EVERY = slice(None)

Solver = Callable[[Array, float, float], Array]
"""Function that solves the equations linearised about a point, with G_z, shape (n, n + 1). For
arguments (row, gap, share) it returns the dz, shape (n + 1,), with G_z dz = -share G and
row @ dz = gap: Newton's step if share is 1, and a tangent if share is 0."""


@dataclass(frozen=True)
class Control:
    """Settings of steps along a branch and of Newton's method.

    `Continuation.relative` gives the sizes of Newton's steps.
    """

    longest: float  # longest step along the branch
    shortest: float = 1e-7  # length of a step below which the branch is given up
    turn: float = 0.35  # largest angle between neighbouring tangents, rad; else the step is halved
    corner: float = 0.0  # length of a step below which tangents may turn by up to a right angle
    tolerance: float = 1e-12  # size of a Newton step that ends the iteration
    stagnation: float = 1e-8  # size that suffices where rounding keeps steps from shrinking
    iterations: int = 15  # largest number of Newton steps
    patience: int | None = None  # number of slow Newton steps in a row that ends it
    longest_change: float = math.inf  # size beyond which a Newton step is shortened


@saved_as("PointOnBranch")
@dataclass(frozen=True)
class Point:
    """A solution z = (x, p) on a branch, with its tangent of unit length, shape (n + 1,) each."""

    z: Array
    tangent: Array

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Point:
        """The point with the fields that a file kept, which has one more in version 0.2."""
        return cls(fields["z"], fields["tangent"])

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

    hopeless = math.inf
    """Size of a slow Newton step beyond which Newton's method fails at once. It is no field of
    `Control`, since saved results of earlier versions hold a control without it."""

    farthest = math.inf
    """Size of a first Newton step beyond which Newton's method fails."""

    def __init__(self, weights: Array, control: Control) -> None:
        self.weights, self.control = weights, control

    @abstractmethod
    def linearised(self, z: Array) -> Solver:
        """Solver of the equations linearised about a point z."""

    @abstractmethod
    def relative(self, z: Array, step: Array) -> float:
        """Size of a step of Newton's method at z, relative to the size of the solution."""

    def check(self, z: Array) -> None:  # noqa: B027
        """Raises NewtonFailed at a z that is not to be followed; a subclass may override it.

        This method accepts every z.
        """

    def product(self, a: Array, b: Array) -> float:
        """Inner product of two changes of the unknowns."""
        return float((self.weights * a) @ b)

    def length(self, change: Array) -> float:
        """Length of a change of the unknowns."""
        return math.sqrt(self.product(change, change))

    def point(self, z: Array, towards: Array) -> Point:
        """The solution z with that unit tangent which has a positive product with `towards`."""
        row = self.weights * towards / self.length(towards)
        return Point(z, self._unit(self.linearised(z), row))

    def starting(self, z: Array, direction: Array) -> Point:
        """The solution z with a given tangent, such as a null vector at a branch point."""
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
        """The point at arc length ds from another one, measured along the tangent of that one.

        Newton's method begins at the guess or, if none is given, on the tangent. With ds = 0 it
        corrects a start that does not satisfy the equations.
        """
        z = start.z + ds * start.tangent if guess is None else guess
        row = self.weights * start.tangent
        z, equations = self._solved(z, row, float(row @ start.z) + ds)
        return Point(z, self._unit(equations, row))

    def fixed(self, guess: Array, p: float, index: int = -1) -> Array:
        """The solution z at which the parameter, or the entry `index` of z, has the value p."""
        row, start = np.zeros(guess.size), guess.copy()
        row[index], start[index] = 1.0, p
        z = self._solved(start, row, p)[0].copy()
        z[index] = p  # exactly, without rounding
        return z

    def _solved(self, z: Array, row: Array, value: float) -> tuple[Array, Solver]:
        """The solution with row @ z = value.

        Second comes the solver of the equations linearised about the last iterate but one.
        """
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
            hopeless=self.hopeless,
            farthest=self.farthest,
            check=self.check,
        )
        assert last is not None
        return found, last

    def next(
        self: Equations, start: Point, step: float, ahead: Callable[[float], Array] | None = None
    ) -> tuple[BranchStep[Equations], float]:
        """The step to the next point, not longer than `step`, and the length to try after it.

        Newton's method begins at `ahead(ds)` for the arc length ds or, without `ahead`, on the
        tangent.
        """
        control = self.control
        while True:
            reason = NewtonFailed("it turns too sharply")
            try:
                found = self.at(start, step, ahead(step) if ahead is not None else None)
                straight = self.product(start.tangent, found.tangent)
                straight = min(straight, step / self.length(found.z - start.z))
                if straight >= (math.cos(control.turn) if step >= control.corner else 0.0):
                    break
            except NewtonFailed as error:
                reason = error
            step *= 0.5
            if step < control.shortest:
                raise reason
        longer = 1.5 if straight > math.cos(0.5 * control.turn) else 1.0
        return BranchStep(self, start, found), min(longer * step, control.longest)

    def steps(
        self: Equations, start: Point, step: float, marks: Iterable[tuple[int, float]] = ()
    ) -> Iterator[BranchStep[Equations]]:
        """Endless sequence of steps along the branch; NewtonFailed if none can be taken.

        A step ends where an entry of z passes one of the marks, pairs of its index and a value.
        """
        while True:
            taken, step = self.next(start, step)
            taken = taken.up_to(marks)
            yield taken
            start = taken.end


@saved_as("StepAlongBranch")
@dataclass(frozen=True)
class BranchStep(Generic[Equations]):
    """Part of a branch between two neighbouring points; any point on it can be solved for."""

    problem: Equations
    begin: Point
    end: Point

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> BranchStep[Equations]:
        """The step with fields from a file; TypeError if `problem` is no `Continuation`."""
        check.instance("problem", fields["problem"], Continuation, "equations")
        return cls(**fields)

    @property
    def length(self) -> float:
        """Arc length of the step, measured along the tangent at its beginning."""
        return self.reach(self.end.z)

    def ahead(self, s: float) -> Array:
        """Predictor, shape (n + 1,), at an arc length s beyond the end.

        It lies on the cubic through both ends; s is measured along the tangent at the end.
        """
        share = self.problem.product(self.begin.tangent, self.end.tangent)
        # The cubic goes through the ends: through points that lie close together, extrapolation
        # would be inaccurate.
        return self._on_cubic(self.length + share * s, 0.0, self.length)

    @property
    def slopes(self) -> tuple[float, float]:
        """Derivatives of the parameter by arc length at the beginning and at the end."""
        return float(self.begin.tangent[-1]), float(self.end.tangent[-1])

    def reach(self, z: Array) -> float:
        """Arc length from the beginning to a point z, along the tangent at the beginning."""
        return self.problem.product(self.begin.tangent, z - self.begin.z)

    @cached_property
    def _known(self) -> dict[float, tuple[Point, Array]]:
        """Points that are known, by arc length, with their derivatives by arc length.

        They are the ends and the points solved for so far.
        """
        onward = self._derivative(self.end)
        return {0.0: (self.begin, self.begin.tangent), self.length: (self.end, onward)}

    def _derivative(self, point: Point) -> Array:
        return point.tangent / self.problem.product(self.begin.tangent, point.tangent)

    def guess(self, s: float, index: int | slice = EVERY) -> Array:
        """Approximate solution at an arc length, on the cubic through the nearest known points.

        The cubic is Hermite's, as tangents are known there. `index`: the entries of z to compute.
        """
        places = sorted(self._known)
        i = min(max(bisect_left(places, s), 1), len(places) - 1)
        return self._on_cubic(s, places[i - 1], places[i], index)

    def _on_cubic(self, s: float, low: float, high: float, index: int | slice = EVERY) -> Array:
        """Approximate solution at an arc length, on the cubic through two known points."""
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

    def up_to(self, marks: Iterable[tuple[int, float]]) -> BranchStep[Equations]:
        """The part up to the first place where an entry of z passes one of the marks.

        `marks` are pairs (index of the entry, value). If none is passed, it is the whole step.
        """
        z, end = self.begin.z, self.end.z
        passed = [(i, v) for i, v in marks if (v - z[i]) * (end[i] - v) > 0.0]
        if not passed:
            return self
        cut = min((self.where(v, i) for i, v in passed), key=self.reach)
        return replace(self, end=self.problem.point(cut, self.begin.tangent))

    def parts(self, lengths: list[float]) -> list[BranchStep[Equations]]:
        """The steps into which points at these arc lengths divide this one."""
        points = [self.begin, *map(self.at, lengths), self.end]
        return [replace(self, begin=a, end=b) for a, b in pairwise(points)]

    def where(self, p: float, index: int = -1) -> Array:
        """The solution at which the entry `index` of z is p, between its values at the ends."""
        ends = {0.0: self.begin.z[index], self.length: self.end.z[index]}

        def apart(s: float) -> float:
            return float(ends[s] if s in ends else self.guess(s, index)) - p

        s = zero_between(apart, 0.0, self.length)
        found = self.problem.fixed(self.guess(s), p, index)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return found


# ----------------------------------------------------------------------------- dense equations


class DenseProblem(Continuation):
    """n equations in n unknowns and a parameter, with dense derivatives.

    Args:
        equations: function of x and p that returns the residual G, shape (n,), and its derivatives
            [G_x, G_p], shape (n, n + 1).
        size: n.
        scale: change of the parameter that is as long as a change of every entry of x by 1.
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
        """Solver of the equations linearised about a point z, by a dense factorisation."""
        residual, derivative = self.equations(z[:-1], float(z[-1]))

        def change(row: Array, gap: float, share: float) -> Array:
            matrix = np.vstack([derivative, row])
            count_factorisations()
            return np.asarray(np.linalg.solve(matrix, np.append(-share * residual, gap)))

        return change

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step relative to 1 plus the length of z."""
        return self.length(step) / (1.0 + self.length(z))
