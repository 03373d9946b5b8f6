# SPDX-License-Identifier: MIT
"""Search for curves of flutter and divergence in a window of two numbers, and their continuation.

Curves are found where they meet lines across the window, including its edges. On lines along the
flow speed the search for crossings finds these places; on lines along other numbers eigenvalues are
followed. The continuous pipe is solved in larger bases until points of its curves converge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Control, Point
from pipedyn.continuation.tracer import AT_END, TestFunction, Tracer, passes_through
from pipedyn.curves.bent_plane import BentPlane
from pipedyn.equilibrium.axis_problems import (
    AxisProblem,
    CoupledModeProblem,
    DivergenceProblem,
    FlutterProblem,
)
from pipedyn.linear.critical_speed import count_resolved, stability_losses
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.neutral import grows
from pipedyn.linear.plane import ON_EDGE, Plane, Window
from pipedyn.models.continuum import FUNCTIONS_A_JOINT, LARGEST, AnyModel, Continuum
from pipedyn.models.galerkin import Galerkin, basis_joints, enriched
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import outcome_of, track

LONGEST_STEP, LARGEST_TURN = 0.04, 0.18
"""Longest step, as a share of the window's sides, and largest angle, in rad, between neighbouring
tangents: cubics through the points with their tangents then have no visible corners."""

MOST_BOUNDARY_POINTS = 1500
"""Most points of a curve, either way: with the longest step they cross the window forty times."""

LINES_OF_SPEED, LINES = 7, 3
"""Numbers of lines across the window, including its edges, on which curves are looked for: lines
along the flow speed, and lines along another number, which take ten times as long."""

ON_SHEET, POINTS_A_CHECK = 1e-3, 6
"""Share of a step to which the end of a curve on one sheet of equilibria is found, and number of
points after which the curve is checked to lie on it."""

FIRST_CLIMB, MOST_CLIMBS = 0.04, 12
"""Limits of a path uphill to a closed curve: length of the first step, as a share of the window,
and largest number of steps: paths that reach a curve take two to eight."""


@dataclass(frozen=True)
class CurveStart:
    """Start of a curve: unknowns near one of its points, or exactly at one.

    Attributes:
        z: ([frequency,] y, x), y and x as shares of the window. In a conservative plane the square
            of the frequency, which is negative for real roots, replaces the frequency.
        kept: index of the entry of z that keeps its value while the others are solved for; None
            where z is a solution.
        plane: index among the planes of a bent pipe in three dimensions: 1 for motions across.
    """

    z: Array
    kept: int | None = None
    plane: int = 0


@dataclass
class TracedCurve:
    """A curve point by point, with the equations that its points satisfy.

    Attributes:
        problem: the equations.
        points: the points in order.
        ends: why the curve ends at its first and last point, as in `BoundaryCurve`.
        error: error of the points, as in `BoundaryCurve`.
        counts: number of unstable roots other than those on the axis at each point, (S,).
        marks: for each organising point on the curve the index of the step in which it lies, and
            its number among all that were found.
        values: results of `organising.coefficients` at each point, shape (S, 2).
    """

    problem: AxisProblem
    points: list[Point]
    ends: tuple[str, str]
    error: float = 0.0
    counts: NDArray[np.int_] = field(default_factory=lambda: np.empty(0, dtype=int))
    marks: list[tuple[int, int]] = field(default_factory=list)
    values: Array = field(default_factory=lambda: np.empty((0, 2)))

    def steps(self) -> Iterator[BranchStep[AxisProblem]]:
        """Steps along the curve between neighbouring points."""
        for a, b in pairwise(self.points):
            self.problem.renew()
            yield BranchStep(self.problem, a, b)

    def places(self) -> Array:
        """(x, y) of each point, shape (S, 2)."""
        return np.array([self.problem.place(point.z) for point in self.points])

    def start(self) -> CurveStart:
        """Start near the middle of the curve, from which it can be traced in another plane."""
        point, plane = self.points[len(self.points) // 2], self.problem.plane
        z = np.append(self.problem.unit * point.z[plane.rest_size : -2], point.z[-2:])
        kept = max((-1, -2), key=lambda i: abs(point.tangent[i]))
        return CurveStart(z, kept, int(bool(plane.across)))

    def holds(self, z: Array) -> bool:
        """Whether a solution z of the same equations lies on the curve."""
        return any(passes_through(step, z, -AT_END) for step in self.steps())


class CurveTracer:
    """Tracer of curves in one plane, which follows each curve once.

    Args:
        plane: gives the matrices at each point of the window.
        starts: starts of curves; their largest frequency is the unit of frequencies.
        wanted: whether the curve through a solution z of a problem is to be followed.
    """

    def __init__(
        self,
        plane: Plane,
        starts: list[CurveStart],
        wanted: Callable[[AxisProblem, Array], bool] = lambda problem, z: True,
    ) -> None:
        self.plane, self.wanted = plane, wanted
        self.unit = max([1.0, *(abs(float(one.z[0])) for one in starts if one.z.size == 3)])
        # Derivatives are exact: after a step of Newton's method as short as the tolerance, the
        # error is of the order of the tolerance squared.
        self.control = Control(LONGEST_STEP, shortest=1e-6, turn=LARGEST_TURN, tolerance=1e-7)
        self.curves: list[TracedCurve] = []

    def trace(self, starts: Iterable[CurveStart]) -> list[TracedCurve]:
        """Curves from these starts, without curves that are already known."""
        before = len(self.curves)
        for start in starts:
            # A start is a guess and may lead nowhere: a curve that is missed is noticed when
            # numbers of unstable roots are compared.
            with suppress(NewtonFailed):
                self._trace(start)
        return self.curves[before:]

    def _trace(self, start: CurveStart) -> None:
        of: type[AxisProblem] = DivergenceProblem
        z, kept, plane = start.z, start.kept, self.plane.planes[start.plane]
        flutters, meeting = z.size == 3, plane.conservative
        if flutters:
            of = CoupledModeProblem if meeting else FlutterProblem
            z = z / [self.unit, 1.0, 1.0]
        problem = of(plane, self.control, self.unit)
        if plane.rest_size:
            z = np.append(plane.nearest_rest(problem.place(z)), z)
            kept = -3 if kept is None and flutters and not z[-3] else kept or -1
        if kept is not None:
            z = problem.fixed(z, float(z[kept]), kept)
        inside = bool((z[-2:] >= -ON_EDGE).all() and (z[-2:] <= 1.0 + ON_EDGE).all())
        inside &= not flutters or meeting or z[-3] >= -ON_EDGE
        known = (
            one
            for one in self.curves
            if one.problem.kind == problem.kind and one.problem.plane is plane
        )
        if flutters and not meeting and plane.conservative_near(z[[-1, -2]], ON_EDGE):
            return  # all roots lie on the axis, on no curve of their own
        if not inside or any(one.holds(z) for one in known) or not self.wanted(problem, z):
            return
        buckles = problem.kind == "divergence" and plane.straight_near(z[[-1, -2]])
        if buckles or not plane.follows(problem.with_rest(z)):
            return  # a straight pipe buckles in no such way beside, or it does not come to the rest
        z[-2:] = plane.window.on_edges(z[-2:])
        begin, limits = problem.starting_at(z), [(-1, 0.0, 1.0), (-2, 0.0, 1.0)]
        if flutters and not meeting:
            limits.append((-3, 0.0, math.inf))
        tracer = OnSheet(limits, MOST_BOUNDARY_POINTS)
        points, why, _ = tracer.both_ways(problem, begin, 0.3 * LONGEST_STEP)
        ends: tuple[str, str] = why
        if plane.rest_size:
            points, ends = on_sheet(problem, points, why, begin)
        if len(points) == 1:
            return  # it touches the window in a corner
        edged = ((point, plane.window.on_edges(point.z[-2:])) for point in points)
        points = [replace(point, z=np.append(point.z[:-2], within)) for point, within in edged]
        first, last = (
            "Bogdanov-Takens" if end == "range" and limits[2:] and point.z[-3] <= 0.0 else end
            for end, point in zip(ends, (points[0], points[-1]), strict=True)
        )
        self.curves.append(TracedCurve(problem, points, (first, last)))


class OnSheet(Tracer[AxisProblem]):
    """Tracer of curves, which end where a bent rest turns back: beyond, the pipe does not rest."""

    def note(self, step: BranchStep[AxisProblem]) -> str | None:
        """Says "fold" or "cusp" of a step to another sheet of equilibria."""
        problem, end = step.problem, step.end
        if not problem.plane.rest_size:
            return None
        if turn_along(problem, step.begin)(end) >= 0.0:
            return None
        return "cusp" if is_fold(problem) else "fold"


def is_fold(problem: AxisProblem) -> bool:
    """Whether a curve consists of folds of a bent rest."""
    return problem.kind == "divergence" and problem.plane.across is False


def turn_along(problem: AxisProblem, begin: Point) -> Callable[[Point], float]:
    """A function along a curve, positive where it begins, that passes 0 where the rest turns back.

    Along a curve of folds it is the direction of the curve beside that at its beginning, which
    turns round in a cusp.
    """
    if is_fold(problem):
        return lambda point: float(begin.tangent[-2:] @ point.tangent[-2:])
    plane: Any = problem.plane
    sign = np.sign(plane.turning(problem.with_rest(begin.z)))  # -1 if the pipe buckles at rest
    return lambda point: float(sign * plane.turning(problem.with_rest(point.z)))


def on_sheet(
    problem: AxisProblem, points: list[Point], ends: tuple[str, str], begin: Point
) -> tuple[list[Point], tuple[str, str]]:
    """The part of a curve round a point where the pipe comes to the rest, and why it ends there.

    Whether it does is asked of some points, and beside the first at which it does not.
    """

    def follows(point: Point) -> bool:
        return problem.plane.follows(problem.with_rest(point.z))

    whole, why = list[Point](), list[str]()
    start = next(i for i, point in enumerate(points) if point.z is begin.z)
    back = [Point(point.z, -point.tangent) for point in points[start::-1]]
    ways: list[tuple[list[Point], str]] = [(back, ends[0]), (points[start:], ends[1])]
    for way, end in ways:
        problem.renew()
        last, turn = len(way) - 1, turn_along(problem, way[-2 if len(way) > 1 else -1])
        if turn(way[-1]) < 0.0:
            step = BranchStep(problem, *way[-2:])
            test = TestFunction(step, 1e-9 * step.length, turn)
            way[-1] = step.at(next(test.changes(0.0, step.length))[0])
            last -= 1  # a rest that turns back is known to the root of rounding only
        checked = [*range(POINTS_A_CHECK, last, POINTS_A_CHECK), last]
        bad = next((k for k in checked if not follows(way[k])), 0)
        if bad:
            good = max((k for k in checked if k < bad), default=0)
            while bad - good > 1:
                middle = (good + bad) // 2
                good, bad = (middle, bad) if follows(way[middle]) else (good, middle)
            step = BranchStep(problem, way[good], way[bad])
            low, high = 0.0, step.length
            while high - low > ON_SHEET * step.length:
                half = 0.5 * (low + high)
                low, high = (half, high) if follows(step.at(half)) else (low, half)
            way, end = [*way[: good + 1], *([step.at(low)] if low else [])], "fold"
        before = [Point(point.z, -point.tangent) for point in whole[:0:-1]]
        whole, why = before + way, [*why, end]
    return whole, (why[0], why[1])


def not_followed(plane: Plane, curves: list[TracedCurve]) -> Iterator[str]:
    """Sentences that say which curves were not followed to their ends."""
    for curve in curves:
        for end, point in zip(curve.ends, (curve.points[0], curve.points[-1]), strict=True):
            if end in ("points", "not converged"):
                x, y = curve.problem.place(point.z)
                reason = "too many points" if end == "points" else "no next point was found"
                if plane.conservative_near(point.z[[-1, -2]], 2.0 * LONGEST_STEP):
                    reason = "without damping and flow, as beyond, all roots lie on the axis"
                yield (
                    f"a curve of {curve.problem.kind} was not followed beyond "
                    f"({x:.6g}, {y:.6g}): {reason}"
                )


def first_plane(model: AnyModel, window: Window, speed: float | None) -> Plane:
    """The plane in which curves are found first.

    The continuous pipe is replaced by a reduced model whose basis is large enough for the window's
    highest speed.
    """
    if not isinstance(model, Continuum):
        return (BentPlane if bent_in(model.pipe, window) else Plane)(model, window, speed)
    fastest = speed or 0.0
    for number, low, size in zip(window.numbers, window.low, window.size, strict=True):
        if number is None:
            fastest = float(low + size)
    joints = basis_joints(model.pipe).size
    size = max(16, math.ceil(0.8 * fastest) + 4) + FUNCTIONS_A_JOINT * joints
    return basis_plane(model.frozen(size), window, speed)


def bent_in(pipe: Pipe, window: Window) -> bool:
    """Whether a load bends the pipe somewhere in the window."""
    corners = (window.place(np.array(share)) for share in product((0, 1), (0, 1)))
    return not all(window.pipe(pipe, at).rests_straight for at in corners)


def basis_plane(model: Galerkin, window: Window, speed: float | None) -> Plane:
    """The plane of a reduced model of the continuous pipe; only its resolved modes count."""
    if bent_in(model.pipe, window):
        return BentPlane(model, window, speed, model.planar.resolved_modes)
    return Plane(model, window, speed, count_resolved(model, eigenproblem(model).spectrum()))


def line_starts(
    plane: Plane, only_stability: bool = False, shown: bool = False
) -> tuple[list[CurveStart], list[str]]:
    """Starts of curves, found on lines across the window, and sentences about what failed.

    Most starts lie where a line meets a curve. Others lie where a path uphill meets a curve; it
    begins where a pair comes near to the axis on a line. Three of the lines along the flow speed
    are used for paths uphill. With `only_stability` these begin only where no other pair is
    unstable.
    """
    window = plane.window
    found, failures = list[CurveStart](), list[str]()
    extremes = list[tuple[Plane, int, Array, float, complex]]()

    def on(line: Array, along: int, value: float) -> Array:
        """The point (x, y) of a line along x (0) or y (1) at which that number has a value."""
        return np.where([along == 0, along == 1], value, line)

    def add(along: int, line: Array, value: float, frequency: float, across: bool | None) -> None:
        x, y = (on(line, along, value) - window.low) / window.size
        z = np.array([frequency, y, x] if frequency else [y, x])
        own = int(bool(across and plane.rest_size))  # straight pipes have one for all motions
        found.append(CurveStart(z, -2 if along == 0 else -1, own))

    for along in (1, 0):
        by_speed = plane.speed_index == along
        low, size = float(window.low[along]), float(window.size[along])
        across = plane.lines(1 - along, LINES_OF_SPEED if by_speed else LINES)
        lines = [np.full(2, value) for value in across]
        answers: Iterable[Any] = [()] * len(lines)
        if by_speed and isinstance(plane, BentPlane):
            answers = (outcome_of(plane.along_speed, line) for line in lines)
        elif by_speed:
            every = stability_losses([plane.model_at(line) for line in lines], low + size)
            answers = [one if isinstance(one, Exception) else one[1] for one in every]
        label = f"lines along {'xy'[along]}"
        searched_lines = track(zip(lines, answers, strict=True), len(lines), label, shown)
        for k, (line, answer) in enumerate(searched_lines):
            if isinstance(answer, Exception):
                failures.append(f"crossings at {line[1 - along]:.6g}: {answer}")
                answer = getattr(answer, "result", None) or ()
            for crossing in answer:
                if crossing.speed < max(low, 1e-9):
                    continue
                frequency = crossing.frequency
                if plane.conservative:
                    meets = crossing.kind == "flutter"
                    frequency = plane.meeting(on(line, along, crossing.speed)) if meets else 0.0
                if frequency or plane.rest_size:
                    add(along, line, crossing.speed, frequency, crossing.across)
            # Without flow only damping moves roots.
            searched = k % (LINES_OF_SPEED // 2) == 0 if by_speed else plane.speed_at(line) > 0.0
            for one in plane.planes:
                for value in one.static_roots(line, along):
                    add(along, line, value, 0.0, one.across)
                if searched and not plane.conservative:
                    passing, others = one.sections(line, along, halved=not by_speed)
                    extremes += [(one, along, line, *extreme) for extreme in others]
                    for share, root in () if by_speed else passing:
                        add(along, line, low + size * share, root.imag, one.across)
    for one, along, at, share, root in track(extremes, len(extremes), "paths uphill", shown):
        z = (at - window.low) / window.size
        z[along] = share
        start = flutter_start(one, z, root, only_stability)
        if start is not None:
            found.append(start)
    return found, failures


def flutter_start(plane: Plane, z: Array, root: complex, only_stability: bool) -> CurveStart | None:
    """Start on a curve of flutter, reached along a path on which a pair's real part tends to 0.

    The path begins at shares z = (x, y) of the window, where the real part of `root` has an extreme
    on a line. Inside a closed curve that no line meets, the real part has an extreme in the plane
    with the opposite sign, to which the path leads if nothing else lies between. A quasi-Newton
    method with exact derivatives of eigenvalues takes the steps. The answer is None if the path
    ends at an extreme before the pair reaches the axis.
    """
    uphill = -np.sign(root.real)
    begin, slope, found = z, np.zeros(2, dtype=np.complex128), list[CurveStart]()

    def distance(steps: Array) -> tuple[float, Array]:
        """Distance of the pair from the axis and its slopes, at z in units of the first step."""
        nonlocal begin, root, slope
        z = steps * FIRST_CLIMB
        values, slopes = plane.pairs(plane.window.place(z))
        if not values.size or plane.conservative_near(z, FIRST_CLIMB):
            raise StopIteration  # all pairs lie on the axis on that edge
        k = int(np.argmin(np.abs(values - root - slope @ (z - begin))))
        there = complex(values[k])
        if only_stability and np.delete(grows(values), k).any():
            raise StopIteration
        if there.real * root.real <= 0.0:
            share = root.real / (root.real - there.real)
            x, y = begin + share * (z - begin)
            kept = -2 if abs(slope[0].real) > abs(slope[1].real) else -1
            passing = np.array([(root + share * (there - root)).imag, y, x])
            found.append(CurveStart(passing, kept, int(bool(plane.across))))
            raise StopIteration
        begin, root, slope = z, there, slopes[:, k]
        return -uphill * there.real, -uphill * FIRST_CLIMB * slope.real

    with suppress(StopIteration):
        scipy.optimize.minimize(
            *(distance, z / FIRST_CLIMB),
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0 / FIRST_CLIMB)] * 2,
            options={"maxfun": MOST_CLIMBS},
        )
    return found[0] if found else None


def larger_plane(model: Continuum, plane: Plane, number: int, moved: float) -> Plane:
    """The plane of the continuous pipe in a larger basis.

    Args:
        model: the continuous pipe.
        plane: the plane of the last basis.
        number: number of the larger basis, from 1.
        moved: distance by which a point of a curve moved in the last basis.

    Raises:
        NotConverged: if no larger basis is allowed.
    """
    inner, size = basis_joints(model.pipe).size, plane.model.planar.dof
    if number > 1 and size >= LARGEST + FUNCTIONS_A_JOINT * inner:
        raise NotConverged(
            f"curves of the continuous pipe do not converge: a point still moves by {moved:.1e}"
        )
    size += max(8, inner + 1, size // 4)
    return basis_plane(enriched(model.frozen(size), number), plane.window, plane.speed)


def distance_in(plane: Plane, curve: TracedCurve) -> float:
    """Largest distance of some points of a curve from the same points in another plane.

    It is relative to their numbers or 1, and infinite if one of the points does not exist there.
    """
    index, last = int(bool(curve.problem.plane.across)), len(curve.points) - 1
    problem = curve.problem.on_other(plane.planes[index])
    largest = 0.0
    for k in np.unique(np.linspace(0, last, 3 + last // 8, dtype=int)):
        point, here = curve.points[k], curve.problem.place(curve.points[k].z)
        own = slice(curve.problem.plane.rest_size, None)
        rest = problem.plane.nearest_rest(here)
        z = np.append(rest, point.z[own])
        moved = Point(z, np.append(0.0 * rest, point.tangent[own]))
        try:
            there = problem.place(problem.at(moved, 0.0).z)
        except NewtonFailed:
            return math.inf
        largest = max(largest, float((np.abs(here - there) / np.maximum(1.0, np.abs(here))).max()))
    return largest
