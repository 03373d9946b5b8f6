# SPDX-License-Identifier: MIT
"""Boundaries of stability of a pipe at rest in the plane of two of its numbers.

Curves of flutter and of divergence are found where they meet the window's edges or lines across it,
and are followed by arc length past folds (`continuation.tracer`) until they leave the window or
close. The continuous pipe is solved in larger bases until points of its curves converge.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import Point
from pipedyn.curves.boundary_curves import (
    CurveStart,
    CurveTracer,
    TracedCurve,
    basis_plane,
    bent_in,
    distance_in,
    first_plane,
    is_fold,
    larger_plane,
    line_starts,
    not_followed,
)
from pipedyn.curves.in_plane import InPlane
from pipedyn.curves.organising import (
    DoublePoint,
    OrganisingPoint,
    changes_of_criticality,
    coefficients,
    double_points,
    others_unstable,
    separate,
    unstable_counts,
)
from pipedyn.equilibrium.axis_problems import AxisProblem, CoupledModeProblem
from pipedyn.linear.modes import largest_speed
from pipedyn.linear.plane import Plane, Window
from pipedyn.linear.sensitivity import CrossingKind
from pipedyn.models.base import Model
from pipedyn.models.continuum import AnyModel, Continuum, checked_model
from pipedyn.models.pipe_numbers import PipeNumber, checked_number
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import warn_of_plane
from pipedyn.util.parallel import one_thread, track
from pipedyn.util.result import Result

AGREED = 2e-10
"""Distance between a point in two successive bases of the continuous pipe up to which it is
converged, relative to its numbers or 1: convergence is exponential, so the error is smaller."""

ROUNDED = 1e-6
"""Distance between a point in two successive bases up to which it counts as converged if larger
bases do not reduce the distance. The distance then is due to rounding, in pairs of high frequency
whose growth hardly changes: at omega 900 with a growth of 1e-3 it is 1e-8."""

LARGEST_MODEL = 500
"""Most degrees of freedom of a model, as dense matrices are factorised at every point."""


@saved_as("BoundaryCurve", added=("across",))
class BoundaryCurve(Result):
    """A curve of flutter or of divergence, point by point along its arc length.

    Attributes:
        kind: "flutter" (a pair of roots passes the imaginary axis; in undamped pipes whose ends do
            no work, two pairs meet on it and leave it, which is coupled-mode flutter) or
            "divergence" (a real root passes 0).
        x, y: values of the two numbers, shape (S,).
        frequency: angular frequency of the pair, in 1 / T, shape (S,). It is 0 for divergence, and
            where two growing real roots meet and become a growing pair, which `crossings` counts as
            coupled-mode flutter, too.
        unstable: number of unstable roots other than those on the axis, shape (S,): where it is 0
            the curve bounds the region in which the pipe is stable. At an end "Bogdanov-Takens",
            where zero is a double root, and at one at which a bent pipe is straight, so that both
            planes have the same roots, `unstable` and `change` have their values right before it.
        change: number of unstable roots on the left of the curve minus that on its right, shape
            (S,): 2 or -2 for flutter; 1 or -1 for divergence, which changes at a Bogdanov-Takens
            point; and 0 where real roots meet. At a fold of a bent rest, the side on which there is
            no such rest counts as that with one more.
        lyapunov: first Lyapunov coefficient of flutter, as in `Hopf`; for divergence the
            coefficient c of z' = sigma z + c z^3, z being the largest angle; shape (S,). It is NaN
            where other roots are unstable, at divergences of bent pipes, or if it was not asked
            for.
        criticality: "supercritical" where the motion or shape that emerges attracts, "subcritical"
            where it repels, or "" where the criticality is not known, shape (S,). With drag, the
            drag decides, as for `Hopf`.
        error: for `Continuum` the largest distance of some points of the curve from the same points
            in the last smaller basis, relative to their numbers or 1; 0 for other models.
        ends: why the curve ends at its first and last point: "range" (it leaves the window),
            "closed", "Bogdanov-Takens" (its frequency falls to 0), "fold" (a bent pipe does not
            come to rest beyond), "cusp" (two curves of folds meet), "points" (it has too many) or
            "not converged" (no next point was found).
        slopes: direction (dx, dy) along the curve, of unit length in shares of the window, shape
            (S, 2).
        across: of a model in three dimensions whose pipe is bent by a load, whether the motions on
            the axis are across the plane z = 0, or in it; None for other models.
        organising: organising points on the curve, as rows (k, i): `Boundary.points[i]` lies
            between the curve's points k and k + 1. Where `unstable`, `change` or `criticality`
            differ at these points, they change there. There is at most one between two points.
    """

    kind: CrossingKind
    x: Array = field(repr=False)
    y: Array = field(repr=False)
    frequency: Array = field(repr=False)
    unstable: NDArray[np.int_] = field(repr=False)
    change: NDArray[np.int_] = field(repr=False)
    lyapunov: Array = field(repr=False)
    criticality: NDArray[np.str_] = field(repr=False)
    error: float = field(repr=False)
    ends: tuple[str, str]
    slopes: Array = field(repr=False)
    organising: NDArray[np.int_] = field(repr=False)
    across: bool | None = None

    def __len__(self) -> int:
        return len(self.x)

    @property
    def sides(self) -> NDArray[np.int_]:
        """Number of unstable roots on the left and on the right of the curve, shape (S, 2)."""
        left, right = np.maximum(self.change, 0), np.maximum(-self.change, 0)
        return self.unstable[:, None] + np.stack([left, right], axis=1)


@saved_as("Boundary")
class Boundary(InPlane):
    """Curves on which eigenvalues lie on the imaginary axis, in a window of two numbers.

    Attributes:
        names: names of x and y.
        ranges: ranges of x and y, ((low, high), (low, high)).
        curves: the curves; curves of flutter come first.
        points: organising points on curves; points at which no other roots are unstable come first.
        u: flow speed if it is neither x nor y, else None.
        model: the model.
        size: degrees of freedom of the model that was solved.
        failures: sentences that say which curves were not followed to their ends, and which counts
            of unstable roots do not agree.
    """

    _along = ("frequency", "unstable", "criticality")

    curves: tuple[BoundaryCurve, ...]
    points: tuple[OrganisingPoint, ...]
    u: float | None
    model: AnyModel
    size: int
    failures: tuple[str, ...]

    def unstable(self, x: float, y: float) -> int:
        """Number of unstable roots at a point of the window, counted among the eigenvalues.

        Example:
            >>> window = {"gamma": (-20.0, 0.0), "u": (0.0, 5.0)}
            >>> model = pp.Chain(pp.Pipe(0.2, damping=0.01), 2)
            >>> found = pp.boundary(model, "gamma", "u", window, criticality=False)
            >>> found.unstable(-5.0, 1.0), found.unstable(-20.0, 1.0)
            (0, 1)

        Raises:
            ValueError, TypeError: for a point outside the window.
            NotConverged: if a bent pipe does not come to rest there, as beyond a fold.
        """
        (left, right), (low, high) = self.ranges
        at = np.array(
            [check.real("x", x, low=left, high=right), check.real("y", y, low=low, high=high)]
        )
        plane = self._plane
        with one_thread(2 * plane.dof):
            return plane.unstable(at)

    @cached_property
    def _plane(self) -> Plane:
        ranges = dict(zip(self.names, self.ranges, strict=True))
        motions = "hysteresis" not in self.names  # which enters small motions only
        of = checked_window(self.model, self.names, ranges, motions)
        model = self.model
        if isinstance(model, Continuum):
            return basis_plane(model.frozen(self.size // (model.dimensions - 1)), of, self.u)
        return first_plane(model, of, self.u)


def boundary(
    model: AnyModel,
    x: str,
    y: str,
    ranges: Mapping[str, tuple[float, float]],
    *,
    u: float | None = None,
    criticality: bool = True,
    only_stability: bool = False,
    progress: bool = False,
) -> Boundary:
    """Boundaries of stability in the plane of two of a pipe's numbers, with organising points.

    Curves of flutter and divergence are found where they meet the window's edges and lines across
    it, and are followed past folds. Numbers of unstable roots are compared between the ends of
    curves round the window's edges, so that `failures` tells of a lost curve that meets them. A
    closed curve of flutter may meet no line. So if a pair comes near to the axis on a line and
    turns back, its real part is followed uphill until the pair passes the axis or comes no nearer.
    A closed curve is missed if it lies between all lines and no uphill path leads to it; no search
    by samples can exclude that. If you expect such a curve, use a smaller window.

    If a load bends the pipe, its rest is solved for at every point, as for `critical_speed`: it is
    that to which the pipe comes as its loads, and then the flow, grow from zero. Curves of folds,
    at which it turns back and the pipe snaps away, are divergences in the plane of rest. A model
    made with `dimensions=3` has curves across that plane, too, and a planar one brings the warning
    `FluttersAcross`. Counts round the edges are not compared for bent pipes. If two folds lie
    between neighbouring samples of a line along another number than the flow speed, so that the
    pipe does not come to rest between them, both are missed there.

    Args:
        model: chain, reduced model, scene of up to 500 degrees of freedom, or `Continuum`, whose
            points are solved in larger bases until they move by less than 1e-9.
        x: name of a number of the pipe: "u", "beta", "gamma", "alpha", "damping", "hysteresis",
            "inflow_share" (aspirating), "root.stiffness" of a `RootSpring`, or a number of a term
            such as "PointMass.mass" or, if there are several such terms, "terms[0].mass". Its value
            in the model's pipe has no effect.
        y: name of another number.
        ranges: (low, high) of both numbers, by name.
        u: the flow speed, if it is neither x nor y.
        criticality: whether to compute on which side motions emerge, and where this changes; this
            takes most of the time.
        only_stability: whether to leave out curves on which other roots are unstable; then numbers
            of unstable roots at the edges are not compared.
        progress: whether to show progress on stderr: of the lines that are searched, of the curves
            that are followed from there and of their criticality.

    Returns:
        Boundary.

    Example:
        >>> pipe = pp.Pipe(0.2, damping=0.005)
        >>> window = {"gamma": (-60.0, 0.0), "u": (0.0, 4.0)}
        >>> found = pp.boundary(pp.Galerkin(pipe, 2, "beam"), "gamma", "u", window)
        >>> point = next(p for p in found.points if p.kind == "Hopf-pitchfork")
        >>> round(point.x, 4), round(point.y, 4)
        (-46.0015, 2.2458)

    Raises:
        NotConverged: if curves of the continuous pipe do not converge as the basis grows.
        ValueError: for a number that the pipe does not have or that has no part in small motions,
            or a range outside the allowed one; for a model about a configuration of `about`.
        TypeError: for arguments of other types than a model, a name or a number.

    Source: Govaerts (2000), Numerical methods for bifurcations of dynamical equilibria; for the
    organising points Kuznetsov, Elements of Applied Bifurcation Theory, ch. 8. The criticality of
    flutter is computed as in `hopf`.
    """
    given, model = model, checked_model(model)
    if isinstance(model, Model) and model.dof > LARGEST_MODEL:
        raise ValueError(
            f"model must have at most {LARGEST_MODEL} degrees of freedom, got {model.dof}"
        )
    window = checked_window(model, (x, y), ranges)
    if model.rests_bent:
        raise ValueError(
            "model must not be about a configuration, as the rest is solved for at every point: "
            f"that which follows from the pipe without loads and flow, got {model!r}"
        )
    if bent_in(model.pipe, window):
        model = given  # which may move across the plane of rest
        if model.dimensions == 2:
            warn_of_plane(__name__)
    asked = check.flag("criticality", criticality)
    if asked and (reason := model.pipe.no_motion):
        raise ValueError(f"criticality must be False for {model.pipe!r}: {reason}")
    only = check.flag("only_stability", only_stability)
    shown = check.flag("progress", progress)
    by_speed = None in window.numbers
    if by_speed and u is not None:
        raise ValueError(f"u must not be given where it is x or y, got {check.shown(u)}")
    if not by_speed:
        if u is None:
            raise ValueError(f'u must be given where neither x nor y is "u", got {x!r} and {y!r}')
        u = check.real("u", u, low=0.0, high=largest_speed(model))
    return boundaries_in(model, window, u, asked, only, (x, y), shown)[0]


def checked_window(
    model: AnyModel, names: tuple[Any, Any], ranges: Any, motions: bool = False
) -> Window:
    """The window of two numbers in these ranges; ValueError or TypeError for bad arguments.

    The numbers must enter small motions or, with `motions`, motions of finite amplitude.
    """
    numbers: list[PipeNumber | None] = []
    for argument, name in zip(("x", "y"), names, strict=True):
        own = isinstance(name, str) and name == "u"
        numbers.append(None if own else checked_number(argument, name, model.pipe, motions))
    places = [None if one is None else (one.term, one.attribute) for one in numbers]
    if places[0] == places[1]:
        raise ValueError(f"x and y must be two numbers, got {names[0]!r} and {names[1]!r}")
    rules: list[dict[str, Any]] = []
    for name, number in zip(names, numbers, strict=True):
        rule = {"low": 0.0, "high": largest_speed(model)} if number is None else dict(number.rule)
        if isinstance(name, str) and name.startswith("root."):
            rule["open_low"] = True
        rules.append(rule)
    bounds = check.window(names, ranges, (rules[0], rules[1]))
    if "beta" in names and bounds[names.index("beta")][0] == 0.0:
        raise ValueError(
            "ranges['beta'] must lie in (0, 1), got 0: curves are followed by derivatives, and the "
            "Coriolis force, which grows with the root of beta, has none at 0"
        )
    low_, high_ = np.array(bounds).T
    return Window((numbers[0], numbers[1]), low_, high_ - low_)


def boundaries_in(
    model: AnyModel,
    window: Window,
    u: float | None,
    criticality: bool,
    only_stability: bool,
    names: tuple[str, str],
    shown: bool,
) -> tuple[Boundary, list[TracedCurve]]:
    """The boundaries in a checked window, and their curves as they were traced.

    The other arguments are those of `boundary`, checked, too.

    For the continuous pipe the basis grows until sampled points of the curves do not move any more,
    or move by rounding only.

    Raises:
        NotConverged: if points of a curve still move in the largest basis.
    """
    with one_thread(2 * getattr(model, "dof", 64)):
        coarse = plane = first_plane(model, window, u)
        starts, on_lines = line_starts(coarse, only_stability, shown)
        before, moved, larger = math.inf, 0.0, 0
        while True:
            smaller, failures = plane, on_lines.copy()
            if isinstance(model, Continuum):
                larger += 1
                plane = larger_plane(model, smaller, larger, moved)
            curves, found = _all_curves(plane, starts, only_stability, failures, shown)
            if plane is not smaller:
                for curve in curves:
                    curve.error = distance_in(smaller, curve)
                before, moved = moved or math.inf, max((one.error for one in curves), default=0.0)
            if moved <= AGREED or 0.3 * before <= moved <= ROUNDED:
                break
            starts = [curve.start() for curve in curves]
        by_speed = plane.speed_index is not None
        middle = window.place(np.full(2, 0.5))
        if plane.conservative and not by_speed and plane.static_stiffnesses(middle) is None:
            failures.append(
                "coupled-mode flutter, where two pairs of an undamped pipe meet on the axis, was "
                "not looked for: it is found along the flow speed, which is held here; see "
                "`crossings`"
            )
        unfinished = [*not_followed(plane, curves)]
        failures += unfinished
        points = [one.point(plane) for one in found]
        for curve in curves:
            curve.values = np.full((len(curve.points), 2), np.nan)
        bounds = [(curve, k) for curve in curves for k in np.flatnonzero(curve.counts == 0)]
        for curve, k in track(bounds, len(bounds), "criticality", shown) if criticality else ():
            curve.values[k] = coefficients(coarse, curve.problem, curve.points[k].z)
        ends = track(curves, len(curves), "changes of criticality", shown) if criticality else ()
        for curve in ends:
            for change in changes_of_criticality(coarse, curve):
                if isinstance(change, str):
                    failures.append(change)
                else:
                    curve.marks.append((change[0], len(points)))
                    points.append(change[1])
    known = sorted(enumerate(points), key=lambda of: (of[1].unstable, of[1].kind, of[1].x))
    numbers = {i: number for number, (i, _) in enumerate(known)}
    results = [_boundary_curve(curve, numbers) for curve in curves]
    low, high = window.low, window.low + window.size
    if not (plane.conservative or only_stability or unfinished or plane.rest_size):
        failures += _disagreements(results, plane)
    result = Boundary(
        names=names,
        ranges=((float(low[0]), float(high[0])), (float(low[1]), float(high[1]))),
        curves=tuple(sorted(results, key=lambda c: (c.kind != "flutter", -len(c)))),
        points=tuple(one for _, one in known),
        u=u,
        model=model,
        size=plane.model.dof,
        failures=tuple(failures),
    )
    return result, curves


def _all_curves(
    plane: Plane,
    starts: list[CurveStart],
    only_stability: bool,
    failures: list[str],
    shown: bool,
) -> tuple[list[TracedCurve], list[DoublePoint]]:
    """Curves from these starts and from the double points on curves, and these points.

    Sentences about what failed are added to `failures`.
    """

    def wanted(problem: AxisProblem, z: Array) -> bool:
        return not only_stability or others_unstable(plane, problem, z) == 0

    tracer, found = CurveTracer(plane, starts, wanted), list[DoublePoint]()
    while starts:
        label = f"curves, {check.how_many(plane.dof, 'degree')} of freedom"
        new, starts = tracer.trace(track(starts, len(starts), label, shown)), []
        for curve in track(new, len(new), "double points", shown):
            curve.counts, places = unstable_counts(plane, curve), []
            for place in double_points(plane, curve):
                if isinstance(place, str):
                    failures.append(place)
                    continue
                where, one = place
                i = next((i for i, other in enumerate(found) if _equal(one, other)), len(found))
                if where is not None:
                    places.append((*where, i))
                if i == len(found):
                    found.append(one)
                    starts += one.starts()
            separate(plane, curve, places)
    return tracer.curves, found


def _equal(one: DoublePoint, other: DoublePoint) -> bool:
    """Whether two double points are the same, judged by frequencies and places."""
    near = np.allclose(one.roots, other.roots, rtol=1e-6, atol=1e-6)
    return near and float(np.abs(one.at - other.at).max()) < 1e-6


def _disagreements(curves: list[BoundaryCurve], plane: Plane) -> Iterator[str]:
    """Sentences about neighbouring ends of curves whose numbers of unstable roots do not agree.

    Along the window's edges, the number of unstable roots after one end must be equal to the number
    before the next. Numbers are not compared next to an end at which all roots lie on the axis.
    """
    window = plane.window
    ends = []
    for curve in curves:
        for k, end in ((0, curve.ends[0]), (-1, curve.ends[1])):
            if end != "range":
                continue
            at = np.array([curve.x[k], curve.y[k]])
            x, y = (at - window.low) / window.size
            # A place on the edges is measured counter-clockwise from the lower left corner; with it
            # comes the direction in which the edge is walked there.
            places = {y: (x, (1, 0)), 1.0 - x: (1.0 + y, (0, 1))}
            places |= {1.0 - y: (3.0 - x, (-1, 0)), x: (4.0 - y, (0, -1))}
            place, (right, up) = places[min(places, key=abs)]
            leftwards = curve.slopes[k] @ [up, -right] > 0.0
            ahead, behind = curve.sides[k].tolist()
            before, after = (behind, ahead) if leftwards else (ahead, behind)
            ends.append((place, before, after, at))
    ends.sort(key=lambda end: end[0])
    for one, other in zip(ends, ends[1:] + ends[:1], strict=True):
        if one[2] != other[1] and not any(plane.conservative_at(end[3]) for end in (one, other)):
            yield (
                f"on the window's edge between ({one[3][0]:.6g}, {one[3][1]:.6g}) and "
                f"({other[3][0]:.6g}, {other[3][1]:.6g}), where curves end, a curve is missing: "
                f"{one[2]} roots are unstable next to the first and {other[1]} next to the second"
            )


def _points_of_change(curve: TracedCurve) -> list[Point]:
    """Points at which the change of the number of unstable roots across the curve is computed.

    On a curve of flutter, or of folds of a bent rest, one point is enough, as the side is the same
    all along the curve.
    """
    varies = curve.problem.kind == "divergence" and not is_fold(curve.problem)
    if varies or isinstance(curve.problem, CoupledModeProblem):
        return curve.points
    # The point lies away from the ends, at which the frequency may be 0.
    return [curve.points[len(curve.points) // 2]]


def _boundary_curve(curve: TracedCurve, numbers: dict[int, int]) -> BoundaryCurve:
    """A traced curve as a result for users.

    `numbers` maps numbers of organising points in the curve's marks to those in `Boundary.points`.
    """
    problem, points = curve.problem, curve.points
    places = curve.places()
    slopes = np.array([point.tangent[[-1, -2]] for point in points])
    words = np.array(["", "supercritical", "subcritical"])
    leading = curve.values[:, 1]
    changes = [problem.change(point) for point in _points_of_change(curve)]
    organising = [(step, numbers[i]) for step, i in sorted(curve.marks) if i in numbers]
    which = np.where(np.isnan(leading), 0, np.where(leading < 0.0, 1, 2))
    return BoundaryCurve(
        kind=problem.kind,
        x=places[:, 0],
        y=places[:, 1],
        frequency=np.array([problem.frequency(point.z) for point in points]),
        unstable=curve.counts,
        change=np.resize(changes, len(points)),
        lyapunov=curve.values[:, 0],
        criticality=words[which],
        error=curve.error,
        ends=curve.ends,
        slopes=slopes / np.linalg.norm(slopes, axis=1, keepdims=True),
        organising=np.array(organising, dtype=int).reshape(-1, 2),
        across=problem.plane.across if problem.plane.model.dimensions == 3 else None,
    )
