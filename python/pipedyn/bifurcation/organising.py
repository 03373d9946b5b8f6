# SPDX-License-Identifier: MIT
"""What changes along a curve of flutter or divergence: other roots, criticality.

Where the number of other unstable roots changes, another one lies on the axis; what a step along
the curve is narrowed down to is the start of Newton's method for both conditions together. Where
the cubic coefficient changes its sign its root along the curve is solved for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.bifurcation.axis_problems import AxisProblem, DivergenceProblem, FlutterProblem
from pipedyn.bifurcation.boundary_curves import Start, Traced
from pipedyn.bifurcation.continuation import Control, Segment, sign_changes
from pipedyn.bifurcation.hopf import NoHopf, onset_coefficients, static_cubic
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.plane import Plane
from pipedyn.models.base import NotConverged
from pipedyn.util.check import Array
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed, newton
from pipedyn.util.result import result

PointKind = Literal[
    "Bautin",
    "Hopf-pitchfork",
    "double Hopf",
    "Bogdanov-Takens",
    "degenerate pitchfork",
]

NEUTRAL = 1e-8
"""Real part up to which an eigenvalue is neutral, relative to 1 plus its size."""

NARROWED = 1e-7
"""Share of a step to which a change of the number of unstable roots is narrowed down, before
Newton's method solves for it."""

ROUNDING = 1e-6
"""Step of Newton's method that does not get shorter at which rounding is reached: of a pair of high
frequency that hardly moves, omega 258 and growth within 1e-4, it leaves 1e-7."""

STILL = 1e-4
"""Imaginary part up to which a root on the axis is 0: of a double 0 it scatters by the square root
of rounding, 3e-6 was met. And flow speed that counts as none."""

NEARBY = 0.1
"""Distance in shares of the window beyond which a solution is not the one that was looked for."""


@result
class OrganisingPoint:
    """Where two conditions meet, and with them what the pipe may do nearby.

    Points on the axis twice are solved for to 1e-9 or so; where the criticality changes they are as
    good as the differences that give it: measured, to 1e-6 of the window.

    Attributes:
        kind: "Bautin" (the criticality of flutter changes, l1 = 0), "Hopf-pitchfork" (flutter and
            divergence at once), "double Hopf" (two pairs on the axis), "Bogdanov-Takens" (the
            frequency of flutter falls to 0 on a divergence) or "degenerate pitchfork" (the
            criticality of divergence changes; mirror symmetry leaves no cusp but this).
        x, y: the two numbers.
        frequencies: of the pairs on the axis, the lowest first.
        unstable: number of unstable roots beside those on the axis.
    """

    kind: PointKind
    x: float
    y: float
    frequencies: tuple[float, ...]
    unstable: int


def other_roots(plane: Plane, problem: AxisProblem, z: Array) -> Complex:
    """The eigenvalues at a point of a curve but those on the axis, the largest real part first."""
    found = plane.eigenvalues(problem.place(z))
    omega = problem.frequency(z)
    pair = bool(omega) or problem.kind == "flutter" or plane.conservative  # zero may be double
    for value in (1j * omega, -1j * omega) if pair else (0j,):
        found = np.delete(found, np.argmin(np.abs(found - value)))
    return found[np.argsort(-(found.real - NEUTRAL * (1.0 + np.abs(found))), kind="stable")]


def counted(plane: Plane, curve: Traced) -> NDArray[np.int_]:
    """Number of unstable roots beside those on the axis at each point of a curve."""
    return np.array([others_unstable(plane, curve.problem, p.z) for p in curve.points])


def others_unstable(plane: Plane, problem: AxisProblem, z: Array) -> int:
    """Number of unstable roots beside those on the axis at a point of a curve."""
    return _unstable(other_roots(plane, problem, z))


def _unstable(roots: Complex) -> int:
    return int(np.count_nonzero(roots.real > NEUTRAL * (1.0 + np.abs(roots))))


@dataclass(frozen=True)
class Double:
    """Two roots on the axis at once: frequencies in rising order, 0 of a real root that is 0."""

    roots: tuple[float, float]
    at: Array  # (y, x) as shares of the window
    unstable: int

    def starts(self) -> Iterator[Start]:
        """The curves on which it lies."""
        if not any(self.roots):
            yield np.array([0.0, *self.at]), None
        for omega in set(self.roots):
            yield np.array([omega, *self.at] if omega else self.at), None

    def solved(self, plane: Plane, control: Control) -> Double:
        """The point nearby at which both conditions hold."""
        low, high = self.roots
        if not high:
            flutter = FlutterProblem(plane, control, 1.0)
            z = flutter.fixed(np.array([0.0, *self.at]), 0.0, 0)
            roots = 0.0, 0.0
        else:
            first = (
                FlutterProblem(plane, control, low) if low else DivergenceProblem(plane, control)
            )
            start = [1.0, 1.0, *self.at] if low else [1.0, *self.at]
            z = _newton([FlutterProblem(plane, control, high), first], np.array(start))
            roots = (low * float(z[1]) if low else 0.0), high * float(z[0])
        if np.abs(z[-2:] - self.at).max() > NEARBY:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        return Double((min(roots), max(roots)), z[-2:], self.unstable)

    def point(self, plane: Plane) -> OrganisingPoint:
        """For users."""
        x, y = plane.window.place(self.at[::-1])
        low, high = self.roots
        kind: PointKind = "double Hopf" if low else "Hopf-pitchfork" if high else "Bogdanov-Takens"
        frequencies = tuple(root for root in self.roots if root)
        return OrganisingPoint(kind, float(x), float(y), frequencies, self.unstable)


def doubles(plane: Plane, curve: Traced, counts: NDArray[np.int_]) -> Iterator[Double | str]:
    """Where another root lies on the axis along a curve; a sentence where it was not solved for."""
    for k, end in ((0, curve.ends[0]), (-1, curve.ends[1])):
        if end == "Bogdanov-Takens":
            z = curve.points[k].z
            yield Double((0.0, 0.0), z[-2:], others_unstable(plane, curve.problem, z))
    if plane.conservative:
        return  # its pairs lie on the axis everywhere
    for segment, before, after in zip(curve.segments(), counts[:-1], counts[1:], strict=True):
        if before == after:
            continue
        try:
            for guess in _on_segment(plane, segment):
                one = guess.solved(plane, curve.problem.control)
                # Without flow, and without damping, all roots lie on the axis.
                if plane.speed_at(plane.window.place(one.at[::-1])) > STILL:
                    yield one
        except NewtonFailed as error:
            x, y = curve.problem.place(segment.begin.z)
            yield f"another root on the axis near ({x:.6g}, {y:.6g}) was not solved for: {error}"


def _on_segment(plane: Plane, segment: Segment[AxisProblem]) -> Iterator[Double]:
    problem = segment.problem

    @cache
    def roots(s: float) -> Complex:
        return other_roots(plane, problem, segment.at(s).z)

    def growth(s: float) -> Array:
        found = roots(s)
        result: Array = found.real - NEUTRAL * (1.0 + np.abs(found))
        return result

    length = segment.length
    for before, beyond in sign_changes(growth, 0.0, length, NARROWED * length):
        found = roots(beyond)
        passing = abs(float(found[np.argmin(np.abs(growth(beyond)))].imag))
        z = segment.at(beyond).z
        pair = sorted((passing if passing > STILL else 0.0, problem.frequency(z)))
        least = min(_unstable(roots(before)), _unstable(found))
        yield Double((pair[0], pair[1]), z[-2:], least)


def _newton(pair: list[AxisProblem], z: Array) -> Array:
    """Both problems' equations, the first with z[0], of flutter the other with z[1], and (y, x)."""
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

    return newton(z, correction, tolerance=1e-13, stagnation=ROUNDING, check=check)


# ------------------------------------------------------------------------------------ criticality


def coefficients(plane: Plane, problem: AxisProblem, z: Array) -> tuple[float, float]:
    """The cubic coefficient at a point of a curve, and what decides the criticality.

    The latter is negative where what emerges attracts; NaN both where they are not known.
    """
    at, omega = problem.place(z), problem.frequency(z)
    if problem.kind == "flutter" and omega < 1e-4:
        return np.nan, np.nan
    model, u = plane.model_at(at), plane.speed_at(at)
    pipe = model.pipe
    if pipe.hysteresis:  # the same at this frequency
        damping = pipe.equivalent_damping(omega) if omega else pipe.damping
        model = model.with_pipe(replace(pipe, hysteresis=0.0, damping=damping))
    with suppress(NotConverged, NoHopf, ValueError, np.linalg.LinAlgError):
        if problem.kind == "divergence":
            cubic = static_cubic(model, u)
            return cubic, cubic
        form, drag = onset_coefficients(model, u, omega)
        return form.lyapunov, drag.real if drag else form.lyapunov
    return np.nan, np.nan


def changes_of_criticality(
    plane: Plane, curve: Traced, counts: NDArray[np.int_], leading: Array
) -> Iterator[OrganisingPoint]:
    """Where the criticality changes along a curve, at points where no other root is unstable.

    `plane` is of the model that says it, which may have a smaller basis than the curve: differences
    lose digits in a larger one.
    """
    for k, segment in enumerate(curve.segments()):
        if counts[k] or counts[k + 1] or not leading[k] * leading[k + 1] < 0.0:
            continue
        problem, length = segment.problem, segment.length

        def value(s: float, segment: Segment[AxisProblem] = segment) -> float:
            return coefficients(plane, segment.problem, segment.at(s).z)[1]

        with suppress(NewtonFailed, ValueError):  # not known within, or no change after all
            z = segment.at(scipy.optimize.brentq(value, 0.0, length, xtol=1e-11 * length)).z
            if abs(value(segment.reach(z))) > 1e-3 * min(abs(leading[k]), abs(leading[k + 1])):
                continue  # it passes through infinity, as where two pairs meet
            x, y = problem.place(z)
            omega = problem.frequency(z)
            kind: PointKind = "Bautin" if omega else "degenerate pitchfork"
            yield OrganisingPoint(kind, float(x), float(y), (omega,) if omega else (), 0)
