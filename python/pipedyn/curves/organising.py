# SPDX-License-Identifier: MIT
"""Changes along a curve of flutter or divergence: numbers of other unstable roots, criticality.

Where the number of other unstable roots changes, another root lies on the axis. The step in which
this happens is narrowed down, and Newton's method then solves for both conditions together. Where
the coefficient that decides the criticality changes its sign, its root along the curve is found.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Control, Point
from pipedyn.continuation.tracer import TestFunction
from pipedyn.curves.boundary_curves import CurveStart, TracedCurve, is_fold
from pipedyn.equilibrium.axis_problems import (
    AxisProblem,
    CoupledModeProblem,
    DivergenceProblem,
    FlutterProblem,
)
from pipedyn.equilibrium.hopf import onset_coefficients, static_cubic
from pipedyn.equilibrium.normal_form import NoHopf
from pipedyn.linear.neutral import beyond_rounding
from pipedyn.linear.plane import Plane
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed, newton
from pipedyn.util.result import Result

PointKind = Literal[
    "Bautin",
    "Hopf-pitchfork",
    "fold-Hopf",
    "cusp",
    "double Hopf",
    "Bogdanov-Takens",
    "double divergence",
    "degenerate pitchfork",
]

BRACKET = 1e-7
"""Share of a step to which a change of the number of unstable roots is narrowed down before
Newton's method solves for the double point."""

ROUNDING_STEP = 1e-6
"""Length up to which a step of Newton's method is taken for rounding if it does not get shorter.
For a pair of high frequency whose growth hardly changes (omega 258 and growth within 1e-4) rounding
leaves steps of 1e-7."""

OWN = 1e-3
"""Distance of an eigenvalue from the root on the axis up to which both are the same, relative to 1
plus the frequency."""

STATIC = 1e-4
"""Imaginary part up to which a root on the axis counts as 0. A double root 0 scatters by the square
root of rounding; the largest scatter met was 3e-6."""

AT_EDGE = 1e-4
"""Distance, as a share of the window, from an edge without damping within which no point counts as
an organising point: on that edge all roots lie on the axis."""

SECOND_RANK = 1e-4
"""Second smallest singular value of K, whose elastic stiffnesses are 1, up to which K may lack
two ranks; Newton's method then decides."""

CROSSED = 1e-9
"""Largest stiffness of the two modes of a double divergence that counts as 0."""

NEARBY = 0.1
"""Distance from the start, in shares of the window, beyond which a solution is rejected."""


@saved_as("OrganisingPoint")
class OrganisingPoint(Result):
    """Point of the plane at which two conditions hold at once, which organises motions nearby.

    Points with two roots on the axis are solved for to about 1e-9. Points at which the criticality
    changes are as precise as the differences that give it: by measurement, to 1e-6 of the window.

    Attributes:
        kind: "Bautin" (the criticality of flutter changes, l1 = 0), "Hopf-pitchfork" (flutter and
            divergence at once; "fold-Hopf" if the divergence is a fold of a bent rest), "cusp" (two
            curves of folds meet, beyond which the rest does not turn back), "double Hopf" (two
            pairs on the axis), "Bogdanov-Takens" (the frequency of flutter falls to 0 on a
            divergence: zero is a double root with one mode),
            "double divergence" (two curves of divergence cross, as where buckling modes exchange:
            zero is a double root with two modes, and no flutter begins there) or "degenerate
            pitchfork" (the criticality of divergence changes; mirror symmetry leaves no cusp but
            this).
        x, y: values of the two numbers.
        frequencies: angular frequencies of the pairs on the axis, the lowest first.
        unstable: number of unstable roots other than those on the axis.
    """

    kind: PointKind
    x: float
    y: float
    frequencies: tuple[float, ...]
    unstable: int


def other_roots(plane: Plane, problem: AxisProblem, z: Array) -> tuple[Complex, Array]:
    """Eigenvalues at a point of a curve except those on the axis, and their growth, (k,) each.

    Growth is the real part minus its rounding; eigenvalues that grow most come first.
    """
    found = plane.eigenvalues(problem.with_rest(z))
    growth = beyond_rounding(found)
    omega = problem.frequency(z)
    # Zero is a double root where lambda and -lambda are both roots.
    pair = problem.kind == "flutter" or plane.conservative_at(problem.with_rest(z))
    for value in (1j * omega, -1j * omega) if pair else (0j,):
        k = int(np.argmin(np.abs(found - value)))
        if abs(found[k] - value) <= OWN * (1.0 + omega):  # else its mode does not count
            found, growth = np.delete(found, k), np.delete(growth, k)
    order = np.argsort(-growth, kind="stable")
    return found[order], growth[order]


def unstable_counts(plane: Plane, curve: TracedCurve) -> NDArray[np.int_]:
    """Number of unstable roots other than those on the axis at each point of a curve, (S,)."""
    counts = [others_unstable(plane, curve.problem, point.z) for point in curve.points]
    if curve.problem.kind == "flutter" and not plane.conservative:
        # At an end without damping and flow all roots lie on the axis, and at one at which the pipe
        # rests straight a pair in each plane: the number right before the end is taken.
        for end, before in ((0, 1), (-1, -2)):
            at = curve.problem.with_rest(curve.points[end].z)
            if plane.conservative_at(at) or plane.straight_near(curve.points[end].z[[-1, -2]]):
                counts[end] = counts[before]
    return np.array(counts)


def others_unstable(plane: Plane, problem: AxisProblem, z: Array) -> int:
    """Number of unstable roots other than those on the axis at a point of a curve."""
    if isinstance(problem, CoupledModeProblem):
        found, root = plane.eigenvalues(problem.with_rest(z)), problem.root(z)
        growth = beyond_rounding(found)
        for value in (root, root, -root, -root):
            k = np.argmin(np.abs(found - value))
            found, growth = np.delete(found, k), np.delete(growth, k)
        return _unstable(growth) + (2 if z[-3] < 0.0 else 0)
    if problem.kind == "divergence":
        static = plane.static_stiffnesses(problem.with_rest(z))
        if static is not None:
            return int(np.count_nonzero(np.delete(static, np.argmin(np.abs(static))) < 0.0))
    return _unstable(other_roots(plane, problem, z)[1])


def _unstable(growth: Array) -> int:
    return int(np.count_nonzero(growth > 0.0))


@dataclass(frozen=True)
class DoublePoint:
    """Point at which two roots lie on the axis at once.

    Attributes:
        roots: angular frequencies of the two roots, rising; 0 for a real root.
        at: the point (y, x), as shares of the window.
        unstable: number of other roots that are unstable.
        modes: number of modes to which two roots 0 belong: 2 where K lacks two ranks, else 1.
        fold: whether the real root is that of a fold of a bent rest.
    """

    roots: tuple[float, float]
    at: Array
    unstable: int
    modes: int = 1
    fold: bool = False

    def starts(self) -> Iterator[CurveStart]:
        """Starts of the curves on which the point lies.

        A double divergence and a cusp have none, as the curves there are known.
        """
        if self.modes == 2 or (self.fold and not any(self.roots)):
            return
        if not any(self.roots):
            yield CurveStart(np.array([0.0, *self.at]))
        for omega in set(self.roots):
            yield CurveStart(np.array([omega, *self.at] if omega else self.at))

    def solved(self, plane: Plane, control: Control) -> DoublePoint:
        """The double point nearby, solved for by Newton's method.

        Raises:
            NewtonFailed: if none is found.
        """
        low, high = self.roots
        if self.modes == 2:
            z = _two_modes(plane, self.at)
            roots = 0.0, 0.0
        elif not high:
            flutter = FlutterProblem(plane, control, 1.0)
            z = flutter.fixed(np.array([0.0, *self.at]), 0.0, 0)
            roots = 0.0, 0.0
        else:
            first = (FlutterProblem if low else DivergenceProblem)(plane, control, low)
            start = [1.0, 1.0, *self.at] if low else [1.0, *self.at]
            z = _both_conditions([FlutterProblem(plane, control, high), first], np.array(start))
            roots = (low * float(z[1]) if low else 0.0), high * float(z[0])
        if np.abs(z[-2:] - self.at).max() > NEARBY:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return replace(self, roots=(min(roots), max(roots)), at=z[-2:])

    def point(self, plane: Plane) -> OrganisingPoint:
        """The point as a result for users."""
        x, y = plane.window.place(self.at[::-1])
        low, high = self.roots
        kind: PointKind = "double Hopf" if low else "Hopf-pitchfork" if high else "Bogdanov-Takens"
        if self.modes == 2:
            kind = "double divergence"
        elif self.fold:
            kind = "fold-Hopf" if high else "cusp"
        frequencies = tuple(root for root in self.roots if root)
        return OrganisingPoint(kind, float(x), float(y), frequencies, self.unstable)


def double_points(
    plane: Plane, curve: TracedCurve
) -> Iterator[tuple[tuple[int, float] | None, DoublePoint] | str]:
    """Points along a curve at which another root lies on the axis.

    Each point comes with the pair (index of its step, arc length from the beginning of the step),
    or with None at an end of the curve. A sentence replaces a point that was not solved for.
    """
    for k, end in ((0, curve.ends[0]), (-1, curve.ends[1])):
        if end == "Bogdanov-Takens":
            z = curve.points[k].z
            others = others_unstable(plane, curve.problem, z)
            yield None, DoublePoint((0.0, 0.0), z[-2:], others)
        elif end == "cusp":
            z = curve.points[k].z
            others = others_unstable(plane, curve.problem, z)
            yield None, DoublePoint((0.0, 0.0), z[-2:], others, fold=True)
    counts = curve.counts
    if plane.conservative:
        if curve.problem.kind != "divergence":
            return  # pairs of a conservative pipe lie on the axis all along the curve
        # Gyroscopic forces may stabilise roots; eigenvalues of K show where another root passes 0.
        stiffness = [_beside(plane, curve.problem, point.z) for point in curve.points]
        counts = np.array([np.count_nonzero(one < 0.0) for one in stiffness])
    for k, (step, (before, after)) in enumerate(zip(curve.steps(), pairwise(counts), strict=True)):
        if before == after:
            continue
        try:
            for s, guess in _approximate_points(step, plane):
                bent = plane.rest_size > 0
                one = guess if bent else guess.solved(plane, curve.problem.control)
                is_special = plane.straight_near if bent else plane.conservative_near
                if one.modes == 2 or not is_special(one.at[::-1], AT_EDGE):
                    yield (k, s), one
        except NewtonFailed as error:
            x, y = curve.problem.place(step.begin.z)
            yield (
                f"on the curve of {curve.problem.kind} beyond ({x:.6g}, {y:.6g}) the number of "
                f"other unstable roots changes from {before} to {after}; the organising point "
                f"between was not solved for: {error}"
            )


def separate(plane: Plane, curve: TracedCurve, places: list[tuple[int, float, int]]) -> None:
    """Marks double points on a curve, and adds points so that each step has one at most.

    Args:
        plane: gives the matrices at each point of the window.
        curve: the curve, which gets the marks and further points.
        places: for each double point the step, the arc length in it, and the point's number.
    """
    places.sort()
    steps = [step for step, *_ in places]
    for i in range(len(places) - 1, 0, -1):
        (before, left, _), (step, right, _) = places[i - 1 : i + 1]
        if before != step:
            continue
        with suppress(NewtonFailed):
            curve.problem.renew()
            part = BranchStep(curve.problem, *curve.points[step : step + 2])
            point = part.at(0.5 * (left + right))
            curve.points.insert(step + 1, point)
            count = others_unstable(plane, curve.problem, point.z)
            curve.counts = np.insert(curve.counts, step + 1, count)
            steps[i:] = [one + 1 for one in steps[i:]]
    curve.marks = [(step, number) for step, (*_, number) in zip(steps, places, strict=True)]


def _beside(plane: Plane, problem: AxisProblem, z: Array) -> Array:
    """Eigenvalues of the symmetric part of K at a point of divergence, without the one near 0."""
    stiffness = plane.at(problem.with_rest(z))[2].real
    values = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))
    return np.delete(values, np.argmin(np.abs(values)))


def _approximate_points(
    step: BranchStep[AxisProblem], plane: Plane
) -> Iterator[tuple[float, DoublePoint]]:
    """Approximate double points on a step of a curve, each after the arc length beyond it."""
    problem = step.problem

    def growth(point: Point) -> Array:
        """Growth of the other roots; in a conservative pipe minus the other stiffnesses."""
        if plane.conservative:
            return -_beside(plane, problem, point.z)
        return other_roots(plane, problem, point.z)[1]

    test = TestFunction(step, BRACKET * step.length, growth)
    for before, beyond in test.changes(0.0, step.length):
        z = step.at(beyond).z
        if plane.conservative_near(z[[-1, -2]], AT_EDGE) and not plane.conservative:
            continue
        found, grown = other_roots(plane, problem, z)
        least = min(_unstable(grown), _unstable(other_roots(plane, problem, step.at(before).z)[1]))
        # If two eigenvalues of a symmetric K pass 0 at once, K lacks two ranks.
        if plane.conservative or (
            problem.kind == "divergence" and _lacks_two_ranks(plane, problem, z)
        ):
            yield beyond, DoublePoint((0.0, 0.0), z[-2:], least, modes=2)
            continue
        passing = abs(float(found[np.argmin(np.abs(grown))].imag))
        low, high = sorted((passing if passing > STATIC else 0.0, problem.frequency(z)))
        yield beyond, DoublePoint((low, high), z[-2:], least, fold=high > 0.0 and is_fold(problem))


def _lacks_two_ranks(plane: Plane, problem: AxisProblem, z: Array) -> bool:
    """Whether two modes seem to have no stiffness at a point of divergence."""
    each = (one.at(problem.with_rest(z))[2].real for one in plane.planes)
    sizes = np.concatenate([np.linalg.svd(one, compute_uv=False) for one in each])
    return bool(np.count_nonzero(sizes <= SECOND_RANK) > 1)


def _two_modes(plane: Plane, at: Array) -> Array:
    """The point (y, x), in shares of the window, at which K lacks two ranks.

    With the left and right singular vectors W and V of the two smallest singular values of K, the
    block W^T K V has four entries, which are 0 at this point. Their derivative by any number p of
    the matrices is W^T K_p V. These are four equations in two unknowns. They have a solution if
    curves cross because of a symmetry, or because two modes belong to separate stiffnesses:
    Newton's steps solve them by least squares.

    Raises:
        NewtonFailed: if no point with this property is found nearby.
    """
    largest = np.inf

    def correction(here: Array) -> tuple[Array, float]:
        nonlocal largest
        (_, _, stiffness), *changes = plane.matrices(plane.window.place(here[::-1]))
        left, sizes, right = np.linalg.svd(stiffness.real)
        largest = float(sizes[-2])
        by_x, by_y = (
            size * (left[:, -2:].T @ one[2].real @ right[-2:].T).ravel()
            for size, one in zip(plane.window.size, changes, strict=True)
        )
        block = np.diag(sizes[-2:]).ravel()
        step = np.linalg.lstsq(np.column_stack([by_y, by_x]), -block, rcond=None)[0]
        return step, float(np.abs(step).max())

    found = newton(at, correction, tolerance=1e-13, stagnation=1e-10)
    if largest > CROSSED:
        raise NewtonFailed("curves of divergence come close, but do not cross")
    return found


def _both_conditions(pair: list[AxisProblem], z: Array) -> Array:
    """Solution of two problems' equations at one point of the window, by Newton's method.

    The unknowns z are the frequency of the first problem, the frequency of the second problem if
    its kind is flutter, and (y, x).
    """
    columns = [[0, -2, -1], [1, -2, -1] if z.size == 4 else [-2, -1]]

    def correction(here: Array) -> tuple[Array, float]:
        rows, residuals = [], []
        for problem, own in zip(pair, columns, strict=True):
            part = here[own]
            residual, derivative = problem.equations(part[:-1], float(part[-1]))
            block = np.zeros((residual.size, here.size))
            block[:, own] = derivative
            rows.append(block)
            residuals.append(residual)
        matrix, right = np.concatenate(rows), -np.concatenate(residuals)
        step = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
        return step, float(np.abs(step).max())

    def check(here: Array) -> None:
        for problem, own in zip(pair, columns, strict=True):
            problem.check(here[own])

    return newton(z, correction, tolerance=1e-13, stagnation=ROUNDING_STEP, check=check)


# ------------------------------------------------------------------------------------ criticality


def coefficients(plane: Plane, problem: AxisProblem, z: Array) -> tuple[float, float]:
    """The cubic coefficient at a point of a curve, and the coefficient that decides criticality.

    The second number is the mean of drag or, without drag, the cubic coefficient. It is negative
    where the motion or shape that emerges attracts. Both are NaN where they are not known, and at
    divergences of a bent pipe.
    """
    at, omega = problem.place(z), problem.frequency(z)
    if plane.rest_size and problem.kind == "divergence":
        return np.nan, np.nan
    if isinstance(problem, CoupledModeProblem) or (problem.kind == "flutter" and omega < 1e-4):
        return np.nan, np.nan
    model, u = plane.model_at(at), plane.speed_at(at)
    pipe = model.pipe
    if pipe.hysteresis:  # replaced by the equivalent viscous damping at this frequency
        damping = pipe.equivalent_damping(omega) if omega else pipe.damping
        model = model.with_pipe(replace(pipe, hysteresis=0.0, damping=damping))
    with suppress(NotConverged, NoHopf, ValueError, np.linalg.LinAlgError):
        if problem.kind == "divergence":
            cubic = static_cubic(model, u)
            return cubic, cubic
        rest = np.zeros(2 * model.integrated)
        rest[: plane.rest_size] = plane.nearest_rest(at)
        form, drag, _ = onset_coefficients(model, u, omega, rest)
        return form.lyapunov, drag.real if drag else form.lyapunov
    return np.nan, np.nan


def changes_of_criticality(
    plane: Plane, curve: TracedCurve
) -> Iterator[tuple[int, OrganisingPoint] | str]:
    """Points along a curve at which the criticality changes and no other root is unstable.

    Each point comes after the index of the step in which it lies. A sentence replaces a point that
    was not solved for.

    The criticality is computed with `plane`, whose basis may be smaller than the basis of the
    curve, as differences lose digits in a larger basis.
    """
    leading, problem = curve.values[:, 1], curve.problem
    kind: PointKind = "Bautin" if problem.kind == "flutter" else "degenerate pitchfork"

    def decisive(point: Point) -> float:
        found = coefficients(plane, problem, point.z)[1]
        if np.isnan(found):
            raise NewtonFailed("the criticality is not known all along the step")
        return found

    for k, step in enumerate(curve.steps()):
        ends = leading[k : k + 2]
        if curve.counts[k : k + 2].any() or not ends[0] * ends[1] < 0.0:
            continue
        test = TestFunction(step, 1e-11 * step.length, decisive)
        try:
            for before, beyond in test.changes(0.0, step.length):
                middle = step.at(0.5 * (before + beyond))
                # The coefficient passes through infinity where two pairs meet.
                infinite = abs(decisive(middle)) > 1e-3 * np.abs(ends).max()
                if infinite or plane.conservative_near(middle.z[[-1, -2]], AT_EDGE):
                    continue
                x, y = problem.place(middle.z)
                omega = problem.frequency(middle.z)
                yield k, OrganisingPoint(kind, float(x), float(y), (omega,) if omega else (), 0)
                break  # rounding may lead to several zeros near a single one
        except (NewtonFailed, ValueError) as error:
            x, y = problem.place(step.begin.z)
            yield (
                f"a point of kind {kind} near ({x:.6g}, {y:.6g}), where the criticality "
                f"changes, was not solved for: {error}"
            )
