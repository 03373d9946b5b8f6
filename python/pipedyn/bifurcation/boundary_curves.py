# SPDX-License-Identifier: MIT
"""Curves of flutter and divergence in a window of two numbers: where they begin, and followed.

They start where lines across the window, its edges among them, meet them: along the flow speed
from the search for crossings, along other numbers from eigenvalues that are followed. A curve of
the continuous pipe is solved again in larger bases until its points stay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipedyn.bifurcation.axis_problems import AxisProblem, DivergenceProblem, FlutterProblem
from pipedyn.bifurcation.continuation import Control, Point, Segment, path
from pipedyn.linear.critical_speed import losses, resolved
from pipedyn.linear.plane import ON_EDGE, Plane, Window
from pipedyn.models.base import NotConverged
from pipedyn.models.continuum import FUNCTIONS_A_JOINT, LARGEST, AnyModel, Continuum
from pipedyn.models.galerkin import Galerkin, basis_joints, enriched
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

LONGEST, TURN = 0.04, 0.18
"""Longest step, as a share of the window's sides, and angle between neighbouring tangents, rad:
cubics through the points with their tangents have no corners that a page shows."""

MOST_POINTS = 1500
"""Of a curve, either way: at the longest step forty times across the window."""

LINES_OF_SPEED, LINES = 7, 3
"""Lines across the window, its edges with them, on which curves are looked for: of those along the
flow speed and of others, which take ten times as long."""

AGREED = 2e-10
"""Distance of a point of the continuous pipe from that of the basis before, relative to its
numbers or 1, at which it counts as converged: convergence is exponential, so that the next is
nearer than that."""

ROUNDED = 1e-6
"""The same where larger bases do not make it smaller: rounding, of pairs of high frequency that
hardly move. At omega 900 with a growth of 1e-3 it is 1e-8."""

SAME = 1e-7
"""Distance in shares of the window below which two solutions are one."""


Start = tuple[Array, int | None]
"""([omega,] y, x), y and x as shares of the window, and which of them is kept where the others are
solved for; None where it is a solution."""


@dataclass
class Traced:
    """A curve with what solves for more points of it."""

    problem: AxisProblem
    points: list[Point]
    ends: tuple[str, str]
    error: float = 0.0

    def segments(self) -> Iterator[Segment[AxisProblem]]:
        """What lies between neighbouring points."""
        for a, b in pairwise(self.points):
            self.problem.renew()
            yield Segment(self.problem, a, b)

    def some(self) -> Traced:
        """A few of its points, the first and last among them."""
        which = np.unique(
            np.linspace(0, len(self.points) - 1, 3 + len(self.points) // 8, dtype=int)
        )
        return replace(self, points=[self.points[k] for k in which])

    def places(self) -> Array:
        """(x, y) of each point, shape (S, 2)."""
        return np.array([self.problem.place(point.z) for point in self.points])

    def holds(self, z: Array) -> bool:
        """Whether a solution lies on the curve."""
        away = np.array([self.problem.length(point.z - z) for point in self.points])
        k = int(np.argmin(away))
        if away[k] > LONGEST:
            return False
        self.problem.renew()
        for a, b in pairwise(self.points[max(0, k - 1) : k + 2]):
            segment = Segment(self.problem, a, b)
            s, length = segment.reach(z), segment.length
            if -0.01 * length <= s <= 1.01 * length:
                with suppress(NewtonFailed):
                    found = self.problem.at(a, s, segment.guess(s))
                    if self.problem.length(found.z - z) <= 100.0 * SAME:
                        return True
        return bool(away[k] <= 100.0 * SAME)


class Tracer:
    """Follows curves on one plane, each once.

    Args:
        plane: the matrices.
        starts: near points on curves, from which it finds the unit of frequencies.
        wanted: of a problem and a solution z, whether its curve is to be followed.
    """

    def __init__(
        self,
        plane: Plane,
        starts: list[Start],
        wanted: Callable[[AxisProblem, Array], bool] = lambda problem, z: True,
    ) -> None:
        self.plane, self.wanted = plane, wanted
        self.unit = max([1.0, *(float(z[0]) for z, _ in starts if z.size == 3)])
        # Derivatives are exact: a step that short leaves an error of its square.
        self.control = Control(LONGEST, shortest=1e-6, turn=TURN, tolerance=SAME)
        self.curves: list[Traced] = []

    def trace(self, starts: list[Start]) -> list[Traced]:
        """The curves through points near those given, but those that are known."""
        before = len(self.curves)
        for z, held in starts:
            # As of a guess: a curve that is missed shows where counts are compared.
            with suppress(NewtonFailed):
                self._trace(z, held)
        return self.curves[before:]

    def _trace(self, start: Array, held: int | None) -> None:
        problem: AxisProblem
        if start.size == 3:
            problem = FlutterProblem(self.plane, self.control, self.unit)
            z = start / [self.unit, 1.0, 1.0]
        else:
            problem, z = DivergenceProblem(self.plane, self.control), start
        if held is not None:
            z = problem.fixed(z, float(z[held]), held)
        inside = bool((z >= -ON_EDGE).all() and (z[-2:] <= 1.0 + ON_EDGE).all())
        known = (one for one in self.curves if one.problem.kind == problem.kind)
        if not inside or any(one.holds(z) for one in known) or not self.wanted(problem, z):
            return
        z[-2:] = self.plane.window.on_edges(z[-2:])
        limits = [(-1, 0.0, 1.0), (-2, 0.0, 1.0)]
        if z.size == 3:
            limits.append((0, 0.0, math.inf))
        points, ends, _ = path(problem, problem.starting_at(z), limits, 0.3 * LONGEST, MOST_POINTS)
        if len(points) == 1:
            return  # it touches the window in a corner
        points = [_on_edges(problem, point) for point in points]
        first, last = (
            "Bogdanov-Takens" if end == "range" and point.z.size == 3 and point.z[0] <= 0.0 else end
            for end, point in zip(ends, (points[0], points[-1]), strict=True)
        )
        self.curves.append(Traced(problem, points, (first, last)))

    def failures(self) -> Iterator[str]:
        """Which curves were not followed to their ends, in sentences."""
        for curve in self.curves:
            for end, point in zip(curve.ends, (curve.points[0], curve.points[-1]), strict=True):
                if end in ("points", "not converged"):
                    x, y = curve.problem.place(point.z)
                    reason = "too many points" if end == "points" else "no next point was found"
                    if self.plane.conservative_near(point.z[[-1, -2]], 2.0 * LONGEST):
                        reason = "without damping and flow, as beyond, all roots lie on the axis"
                    yield (
                        f"a curve of {curve.problem.kind} was not followed beyond "
                        f"({x:.6g}, {y:.6g}): {reason}"
                    )


def first_plane(model: AnyModel, window: Window, speed: float | None) -> Plane:
    """What is looked at first: of the continuous pipe a basis for its highest speed."""
    if not isinstance(model, Continuum):
        return Plane(model, window, speed)
    fastest = speed or 0.0
    for number, low, size in zip(window.numbers, window.low, window.size, strict=True):
        if number is None:
            fastest = float(low + size)
    joints = basis_joints(model.pipe).size
    size = max(16, math.ceil(0.8 * fastest) + 4) + FUNCTIONS_A_JOINT * joints
    return basis_plane(model.frozen(size), window, speed)


def basis_plane(model: Galerkin, window: Window, speed: float | None) -> Plane:
    """Of a basis of the continuous pipe, whose own modes count."""
    return Plane(model, window, speed, resolved(model))


def line_starts(plane: Plane) -> tuple[list[Start], list[str]]:
    """Near points on curves where lines across the window meet them, and what failed."""
    window = plane.window
    found: list[Start] = []
    failures: list[str] = []

    def add(along: int, fixed: float, value: float, frequency: float) -> None:
        share = (value - window.low[along]) / window.size[along]
        x, y = (share, fixed) if along == 0 else (fixed, share)
        z = np.array([frequency, y, x] if frequency else [y, x])
        found.append((z, -2 if along == 0 else -1))

    for along in (1, 0):
        by_speed = plane.speed_index == along
        lines = np.linspace(0.0, 1.0, LINES_OF_SPEED if by_speed else LINES).tolist()
        places = [window.place(np.array([s, s])) for s in lines]
        for at, s in zip(places, lines, strict=True):
            for value in plane.static_roots(at, along):
                add(along, s, value, 0.0)
        if plane.conservative:
            continue
        if by_speed:
            end = float(window.low[along] + window.size[along])
            answers = losses([plane.model_at(at) for at in places], end)
            for s, answer in zip(lines, answers, strict=True):
                if isinstance(answer, Exception):
                    failures.append(f"crossings at a share of {s:.3g} of the window: {answer}")
                    continue
                for crossing in answer[1]:
                    if crossing.speed >= max(window.low[along], 1e-9) and crossing.frequency:
                        add(along, s, crossing.speed, crossing.frequency)
        else:
            for at, s in zip(places, lines, strict=True):
                if plane.speed_at(at) > 0.0:  # else nothing but damping acts
                    for value, frequency in plane.sections(at, along):
                        add(along, s, value, frequency)
    return found, failures


def converged(
    model: Continuum, plane: Plane, curves: list[Traced]
) -> tuple[Plane, list[Traced | None]]:
    """Curves of the continuous pipe in a basis that is large enough for all.

    Some points of each say which: it grows until they do not move, or by rounding alone. A curve
    that larger bases do not have is None.

    Raises:
        NotConverged: if points of a curve still move in the largest basis.
    """
    inner = basis_joints(model.pipe).size
    some: list[Traced | None] = [curve.some() for curve in curves]
    moves = [math.inf] * len(curves)
    more = 0
    while True:
        size, more = plane.dof, more + 1
        size += max(8, inner + 1, size // 4)
        plane = basis_plane(enriched(model.frozen(size), more), plane.window, plane.speed)
        going = False
        for i, one in enumerate(some):
            if one is None:
                continue
            try:
                moved = _moved(one, plane)
            except NewtonFailed:
                some[i] = None if more > 1 else one
                going |= more == 1
                continue
            before, moves[i], some[i] = moves[i], _distance(one, moved), moved
            going |= not (moves[i] <= AGREED or 0.3 * before <= moves[i] <= ROUNDED)
        if not going:
            break
        if size >= LARGEST + FUNCTIONS_A_JOINT * inner:
            raise NotConverged(
                f"curves of the continuous pipe do not converge: a point still moves by "
                f"{max(moves):.1e}"
            )
    every: list[Traced | None] = []
    for curve, one, error in zip(curves, some, moves, strict=True):
        every.append(None)
        if one is not None:
            with suppress(NewtonFailed):
                every[-1] = replace(_moved(curve, plane), error=error)
    return plane, every


def _distance(one: Traced, other: Traced) -> float:
    """Largest distance of points of two curves, relative to their numbers or 1."""
    a, b = one.places(), other.places()
    return float((np.abs(a - b) / np.maximum(1.0, np.abs(a))).max())


def _moved(curve: Traced, plane: Plane) -> Traced:
    """A curve with its points solved for with other matrices."""
    problem = curve.problem.on_other(plane)
    last = len(curve.points) - 1
    points: list[Point] = []
    for k, point in enumerate(curve.points):
        end = {0: curve.ends[0], last: curve.ends[1]}.get(k)
        if end == "closed" and k == last:
            points.append(points[0])
            continue
        edge = _edge(point.z) if end in ("range", "Bogdanov-Takens") else None
        if edge is None:
            points.append(problem.at(point, 0.0))
        else:
            z = problem.fixed(point.z, float(point.z[edge]), edge)
            points.append(_on_edges(problem, problem.point(z, point.tangent)))
    return Traced(problem, points, curve.ends)


def _on_edges(problem: AxisProblem, point: Point) -> Point:
    """A point whose shares are exactly 0 or 1 where it is on an edge but for rounding."""
    within = problem.plane.window.on_edges(point.z[-2:])
    return replace(point, z=np.append(point.z[:-2], within))


def _edge(z: Array) -> int | None:
    """Which entry of z lies on the window's edge, or is a frequency of 0."""
    for index in (-1, -2):
        if z[index] in (0.0, 1.0):
            return index
    return 0 if z.size == 3 and z[0] == 0.0 else None
