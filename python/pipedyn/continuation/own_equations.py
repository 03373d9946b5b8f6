# SPDX-License-Identifier: MIT
"""Continuation of a user's own equations: a branch with its folds and the zeros of test functions.

The same `tracer.Tracer` follows every other branch in the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.continuation.arclength import BranchStep, Continuation, Control, DenseProblem, Point
from pipedyn.continuation.tracer import BranchEnd, TestFunction, Tracer, reason_of, special_points
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import Result, TableResult, numbered_columns


@saved_as("MarkedPoint")
class MarkedPoint(Result):
    """A fold of a branch, or a zero of a test function on it.

    Attributes:
        kind: "fold" (the parameter turns back) or the name of the test function.
        x: unknowns, shape (n,).
        p: parameter.
    """

    kind: str
    x: Array
    p: float


@saved_as("Branch")
class Branch(TableResult):
    """A branch of solutions, point by point along its arc length.

    Attributes:
        x: unknowns, shape (S, n).
        p: parameter, shape (S,).
        tangents: directions (x, p) of the branch, shape (S, n + 1).
        points: folds and zeros of test functions, in order along the branch.
        ends: why the branch ends at its first and last point: "range" (the end of the parameter's
            interval), "closed", "points" (the largest number is reached) or "not converged" (no
            next point was found).
        failures: sentences that say why the branch was not followed beyond an end of the last two
            kinds, with the message of an exception that the user's functions raised, and which
            folds and zeros of tests are not known.
    """

    x: Array = field(repr=False)
    p: Array = field(repr=False)
    tangents: Array = field(repr=False)
    points: tuple[MarkedPoint, ...]
    ends: tuple[BranchEnd, BranchEnd]
    failures: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.p)

    @property
    def folds(self) -> tuple[MarkedPoint, ...]:
        """Points at which the parameter turns back."""
        return tuple(point for point in self.points if point.kind == "fold")

    def _columns(self) -> dict[str, Any]:
        return {"p": self.p, **numbered_columns("x", self.x)}


def follow(
    problem: Continuation | Callable[[Array, float], ArrayLike],
    x0: ArrayLike,
    p0: float,
    interval: tuple[float, float],
    *,
    derivative: Callable[[Array, float], ArrayLike] | None = None,
    tests: Mapping[str, Callable[[Array, float], float]] | None = None,
    step: float = 0.05,
    scale: float = 1.0,
    points: int = 1000,
) -> Branch:
    """The branch of solutions of G(x, p) = 0 through a given solution, followed past folds.

    It applies the method of `equilibrium_branch`, `boundary` and the branches of cycles to a user's
    own equations.

    Args:
        problem: the equations G, a function of x, shape (n,), and p that returns n numbers; or a
            `Continuation`, which has its own solver and control of steps.
        x0: unknowns near a solution at p0, at which Newton's method starts, shape (n,). The
            solution may be a fold.
        p0: parameter of that solution, within the interval.
        interval: (lowest, highest) parameter.
        derivative: function of x and p that returns [G_x, G_p], shape (n, n + 1). It is compared
            with central differences at x0; if it is not given, central differences are used.
        tests: functions of x and p by name, whose zeros along the branch are solved for where they
            change sign; zeros at its ends count, too.
        step: longest step along the branch, in units of the scale and of the interval's length.
        scale: change of x, as the root mean square of its entries, that is as long as a change of
            p by the interval's length; `failures` says if it is more than 100 times larger or
            smaller than x.
        points: largest number of points either way, from 1 to 100,000.

    Returns:
        Branch, whose first end lies in the direction of falling p at x0 or, if x0 is a fold, in the
        direction in which the entry of x that changes most falls. If a user's function raises an
        exception on the way, the branch ends there: points found so far are kept, and `failures`
        names the cause. An exception that it raises at x0 is passed on.

    Example:
        >>> import numpy as np
        >>> def circle(x, p):
        ...     return x**2 + p**2 - 1.0
        >>> branch = pp.continuation.follow(circle, [1.0], 0.0, (-2.0, 2.0))
        >>> branch.ends, [round(point.p, 9) for point in branch.folds]
        (('closed', 'closed'), [1.0, -1.0])

    Raises:
        NotConverged: if no solution is found near x0, or no branch can be followed from it.
        ValueError, TypeError: for bad arguments, equations that do not give n numbers, and a
            derivative that differs from that of the equations.

    Source: Keller (1977).
    """
    low, high = map(float, check.array("interval", interval, size=2))
    if not high > low:
        raise ValueError(f"interval must be (lowest, highest), got ({low:g}, {high:g})")
    p0 = check.real("p0", p0, low=low, high=high)
    x = check.array("x0", x0)
    step = check.real("step", step, low=1e-6, high=1.0)
    scale = check.real("scale", scale, low=0.0, open_low=True)
    most = check.count("points", points, high=100_000)
    given = {} if tests is None else tests
    if not isinstance(given, Mapping) or not all(map(callable, given.values())):
        raise TypeError(f"tests must map names to functions, got {check.shown(tests)}")
    check.instance("derivative", derivative, Callable | None, "a function")
    said = "a function of x and p, or a Continuation"
    check.instance("problem", problem, Callable | Continuation, said)
    if isinstance(problem, Continuation):
        solver = problem
    else:
        equations = _UserEquations(problem, derivative, x, p0, scale, (low, high))
        control = Control(longest=step * scale)
        solver = DenseProblem(equations, x.size, (high - low) / scale, control)
    for name, function in given.items():
        _test_value(name, function, x, p0)
    try:
        start = _start(solver, np.append(x, p0), high - low)
    except NewtonFailed as error:
        hints = [] if solver is problem else _proportion(x[None], scale)
        reason = "; ".join([reason_of(error), *hints])
        raise NotConverged(
            f"no solution to follow was found near x0 at p = {p0:g}: {reason}"
        ) from error
    longest = 0.2 * solver.control.longest
    tracer = Tracer[Continuation]([(-1, low, high)], most, Exception)
    solutions, ends, reasons = tracer.both_ways(solver, start, longest)
    every = np.array([point.z for point in solutions])
    failures = [
        f"the branch was not followed beyond {_as_text(solutions[k].z)}: "
        + (f"it takes more than {most} points" if ends[k] == "points" else reasons[k])
        for k in (0, -1)
        if reasons[k]
    ]
    if solver is not problem:
        failures += _proportion(every[:, :-1], scale)
    marked, unknown = list[MarkedPoint](), dict[str, str]()
    for i, (a, b) in enumerate(pairwise(solutions)):
        taken, found = BranchStep(solver, a, b), list[tuple[float, str]]()
        # Rounding may hide a zero at an end; a closed branch ends at its first point.
        near = i == 0 and ends[0] != "closed", i == len(solutions) - 2
        for name, test in (("fold", None), *given.items()):
            try:
                found += [(s, str(name)) for s in _folds_or_zeros(taken, name, test, near)]
            except Exception as error:  # whatever the user's functions raise
                what = "folds" if test is None else f"zeros of tests[{str(name)!r}]"
                unknown.setdefault(
                    what,
                    f"{what} are not known from {_as_text(a.z)} to {_as_text(b.z)}, or further "
                    f"on: {reason_of(error)}",
                )
        for s, kind in sorted(found):
            z = taken.at(s).z
            marked.append(MarkedPoint(kind, z[:-1].copy(), float(z[-1])))
    failures += unknown.values()
    tangents = np.array([point.tangent for point in solutions])
    return Branch(
        every[:, :-1], every[:, -1], tangents, tuple(marked), ends, failures=tuple(failures)
    )


ON_FOLD = 1e-4
"""Largest difference between p0 and the parameter of a fold at which a branch starts, as a share of
the interval: Newton's method at p0 fails there, and the nearest point of the branch is taken."""


def _start(solver: Continuation, z: Array, width: float) -> Point:
    """The solution at the parameter of z or, at a fold, the nearest to z; with its tangent."""
    index = z.size - 1
    growing = np.append(np.zeros(index), 1.0)
    try:
        return solver.point(solver.fixed(z, float(z[-1])), growing)
    except NewtonFailed as error:
        reason = error
    try:
        # G_z has one null vector at a fold, found with any row that is not orthogonal to it.
        generic = np.cos(1.0 + np.arange(z.size)) / np.sqrt(solver.weights)
        found = solver.at(solver.point(z, generic), 0.0)
    except NewtonFailed:
        raise reason from None
    if (
        abs(found.p - float(z[-1])) > ON_FOLD * width
        or solver.length(found.z - z) > solver.control.longest
    ):
        raise reason
    most = int(np.argmax(np.abs(found.tangent[:-1])))
    return Point(found.z, math.copysign(1.0, found.tangent[most]) * found.tangent)


PROPORTION = 100.0
"""Factor between the size of x and the scale beyond which `failures` says so: steps are too short
by this factor, or so long that they pass over folds."""


def _proportion(xs: Array, scale: float) -> list[str]:
    """Sentences about a scale that is out of proportion to unknowns xs, shape (S, n)."""
    size = float(np.sqrt(np.mean(np.abs(xs).max(axis=0) ** 2)))
    if size == 0.0 or 1.0 / PROPORTION <= size / scale <= PROPORTION:
        return []
    effect = "folds may be passed over" if size < scale else "steps are short"
    return [f"scale is out of proportion: it is {scale:g}, and x is about {size:.1g}: {effect}"]


def _as_text(z: Array) -> str:
    x = np.array2string(z[:-1], precision=6, threshold=4, edgeitems=2, separator=", ")
    return f"p = {z[-1]:.6g}, x = {' '.join(x.split())}"


UserFunction = Callable[[Array, float], ArrayLike]


def _function_value(
    name: str, function: UserFunction, x: Array, p: float, shape: tuple[int, ...]
) -> Array:
    """Value of a user's function as an array; exceptions that it raises are passed on."""
    with np.errstate(all="ignore"):  # numbers that are not finite are refused here, by name
        came = function(x.copy(), p)
    found = check.doubles(name, came, "a function that gives numbers")
    if found.shape != shape:
        what = f"an array of shape {shape}" if shape else "a number"
        raise TypeError(f"{name} must give {what}, got {found.shape}")
    return found


class _UserEquations:
    """Equations G with their derivative, which is given or computed by central differences.

    Args:
        equations: G.
        derivative: function that returns [G_x, G_p], or None.
        x, p: unknowns and parameter at which both are called first.
        scale: change of x that is as long as a change of p by the interval's length.
        interval: (lowest, highest) p.

    Raises:
        ValueError, TypeError: for functions whose values do not have these shapes, and a derivative
            that differs from that of G.
    """

    def __init__(
        self,
        equations: UserFunction,
        derivative: UserFunction | None,
        x: Array,
        p: float,
        scale: float,
        interval: tuple[float, float],
    ) -> None:
        self.equations, self.derivative, self.size = equations, derivative, x.size
        self.interval = interval
        self.units = np.append(np.full(x.size, scale), interval[1] - interval[0])
        _function_value("problem", equations, x, p, (self.size,))
        if derivative is not None:
            came = _function_value("derivative", derivative, x, p, (self.size, self.size + 1))
            self._compare(came, np.append(x, p))

    def __call__(self, x: Array, p: float) -> tuple[Array, Array]:
        z = np.append(x, p)
        residual = self._at("problem", self.equations, z)
        if self.derivative is not None:
            return residual, self._at("derivative", self.derivative, z, self.size + 1)
        return residual, np.column_stack([self._difference(z, i) for i in range(z.size)])

    def _at(self, name: str, function: UserFunction, z: Array, *columns: int) -> Array:
        """Value of a user's function; NewtonFailed if it raises, or the value is not finite."""
        try:
            found = _function_value(name, function, z[:-1], float(z[-1]), (self.size, *columns))
        except Exception as error:  # whatever the user's function raises
            raised = (
                "" if str(error).startswith(name) else f"{name} raised {type(error).__name__}: "
            )
            raise NewtonFailed(f"{raised}{error}, at {_as_text(z)}") from error
        if not np.isfinite(found).all():
            wrong = found[~np.isfinite(found)][0]
            raise NewtonFailed(f"{name} gives {wrong:g} at {_as_text(z)}")
        return found

    def _difference(self, z: Array, i: int, times: float = 1.0) -> Array:
        """Derivative of G by the entry i of z, by differences over `times` the usual step.

        The differences are central, or one-sided at an end of the interval where G is not defined
        beyond it.
        """
        # The relative step is the cube root of rounding: errors of truncation and of rounding then
        # are about its square, 4e-11.
        unit = float(self.units[i])
        h = 6e-6 * times * unit * max(1.0, abs(z[i]) / unit) ** (1.0 / 3.0)

        def value(steps: float) -> Array:
            moved = z.copy()
            moved[i] += steps * h
            return self._at("problem", self.equations, moved)

        low, high = z[i] - self.interval[0], self.interval[1] - z[i]
        try:
            return (value(1.0) - value(-1.0)) / (2.0 * h)
        except NewtonFailed:  # G may not be defined beyond the interval
            if i < self.size or min(low, high) > 2.0 * h:
                raise
        side = 1.0 if low <= 2.0 * h else -1.0
        return (4.0 * value(side) - 3.0 * value(0.0) - value(2.0 * side)) / (2.0 * side * h)

    def _compare(self, came: Array, z: Array) -> None:
        """Raises ValueError if a derivative is farther from differences than their own error."""
        near, far = np.full((2, *came.shape), np.nan)
        for i in range(z.size):
            with suppress(NewtonFailed):
                near[:, i], far[:, i] = self._difference(z, i), self._difference(z, i, 10.0)
        sizes = np.nan_to_num(np.abs(near)) * self.units
        rounding = 1e-6 * sizes.max(axis=1, keepdims=True) / self.units
        allowed = 1e-3 * np.abs(near) + 10.0 * np.abs(near - far) + rounding
        wrong = np.argwhere(np.abs(came - near) > allowed)
        if wrong.size:
            i, j = wrong[0].tolist()
            by = f"x[{j}]" if j < self.size else "p"
            raise ValueError(
                f"derivative must be that of problem: of G[{i}] by {by} at x0 and p0 it gives "
                f"{came[i, j]:.6g}, and differences of problem {near[i, j]:.6g}"
            )


def _test_value(name: Any, test: Callable[[Array, float], float], x: Array, p: float) -> float:
    """Value of a user's test function; raises TypeError if it is not a number."""
    return float(_function_value(f"tests[{str(name)!r}]", test, x, p, ()).item())


def _folds_or_zeros(
    step: BranchStep[Continuation],
    name: Any,
    test: Callable[[Array, float], float] | None,
    near: tuple[bool, bool],
) -> list[float]:
    """Arc lengths on a step of its folds, or at which a user's test function is 0.

    A function is 0 where its sign changes and at an end of the step where its value is 0.

    Args:
        step: the step.
        name: name of the function.
        test: the function, or None if folds are looked for.
        near: whether values of the size of rounding count as 0 at the first and at the last point.
    """
    if test is None:
        return [beyond for *_, beyond in special_points(step, 1e-10, ())]

    def value(point: Point) -> float:
        found = _test_value(name, test, point.x, point.p)
        if not math.isfinite(found):
            raise NewtonFailed(f"it gives {found:g} at {_as_text(point.z)}")
        return found

    sign = TestFunction(step, 1e-13 * step.length, value)
    first, last = float(sign.at(0.0)[0]), float(sign.at(step.length)[0])
    if first * last < 0.0:
        return [beyond for _, beyond in sign.changes(0.0, step.length)]
    rounding = 1e-13 * max(abs(first), abs(last))
    begins = near[0] and abs(first) <= rounding and last != first
    ends = last == 0.0 or (near[1] and abs(last) < rounding)
    return [0.0] * begins + [step.length] * ends
