# SPDX-License-Identifier: MIT
"""Onset of flutter at which a branch of cycles begins, as a function of the second number."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipedyn.continuation.arclength import Control
from pipedyn.curves.boundary import Boundary, BoundaryCurve, boundary
from pipedyn.curves.event_plane import EventPlane
from pipedyn.equilibrium.axis_problems import AxisProblem, DivergenceProblem, FlutterProblem
from pipedyn.linear.critical_speed import critical_speed
from pipedyn.linear.modes import largest_speed
from pipedyn.models.pipe_numbers import checked_number
from pipedyn.util.check import Array
from pipedyn.util.errors import PipedynError
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed

FROM_0 = 1e-3
"""Lower end of a number's range, as a share of its upper end, for the boundary of stability if the
range begins at 0, where matrices have no derivative by the number, as by beta."""

SAME_ONSET = 1e-4
"""Relative difference of speed up to which a boundary is taken to pass the onset of a branch:
cubics through the boundary's points are far more precise, and two onsets are farther apart."""


class Onset:
    """Boundary of stability of the straight pipe, with the onset of a branch of cycles on it.

    Args:
        plane: plane of an event of cycles, not of forced motions.
        begin: flow speed of the flutter at which the branch begins; NaN if it begins elsewhere.
        fastest: flow speed up to which onsets are of interest.
    """

    def __init__(self, plane: EventPlane, begin: float, fastest: float) -> None:
        self.plane, self.failures = plane, list[str]()
        self.found: Boundary | None = None
        self._flat = math.nan
        self._curve: BoundaryCurve | None = None
        second = plane.ranges[1 if plane.own_first else 0]
        name = plane.names[1 if plane.own_first else 0]
        speeds = plane.ranges[0 if plane.own_first else 1]
        top = min(max(speeds[1], fastest), largest_speed(plane.model))
        ranges = {name: second, "u": (min(speeds[0] or math.inf, 0.1 * top), top)}
        if name in ("beta", "root.stiffness") and second[0] == 0.0:
            ranges[name] = (FROM_0 * second[1], second[1])
        try:
            self._find(name, ranges, begin)
        except (PipedynError, ValueError) as error:
            self.failures.append(f"the onset of flutter was not followed over {name}: {error}")

    def _find(self, name: str, ranges: dict[str, tuple[float, float]], begin: float) -> None:
        plane = self.plane
        try:
            checked_number("x", name, plane.model.pipe)
        except ValueError:  # the number has no effect on small motions
            ends = [critical_speed(plane.family.at(end).model) for end in ranges[name]]
            if not math.isclose(ends[0].speed, ends[1].speed, rel_tol=1e-9):
                raise
            self._flat = ends[0].speed
            self.found = _level(plane, name, ranges, ends[0].speed, ends[0].frequency)
            return
        words: dict[str, Any] = {"criticality": False, "only_stability": True}
        self.found = boundary(plane.model, *plane.names, ranges, **words)
        lowest = math.inf
        for curve in self.found.curves:
            s, at = _splines(curve, self.found)
            bounds = _monotone_parts(s, at[self._second])
            for here in _places_of_value(at[self._second], self._share(plane.value), s[0], s[-1]):
                speed = self._speed(at, here)
                k = min(int(np.searchsorted(s, here, "right")) - 1, len(curve) - 2)
                if math.isnan(begin):
                    wanted = speed < lowest and curve.unstable[k : k + 2].min() == 0
                else:
                    wanted = curve.kind == "flutter" and abs(speed / begin - 1.0) < SAME_ONSET
                if wanted:
                    lowest, self._curve = speed, curve
                    i = min(int(np.searchsorted(bounds, here, "right")), bounds.size - 1)
                    self._ends = bounds[i - 1], bounds[i]

    @property
    def _second(self) -> int:
        """Index of the second number, 0 where it is x and 1 where it is y."""
        return 1 if self.plane.own_first else 0

    def _share(self, value: float) -> float:
        assert self.found is not None
        low, high = self.found.ranges[self._second]
        return (value - low) / (high - low)

    def _speed(self, at: list[Any], s: float) -> float:
        assert self.found is not None
        low, high = self.found.ranges[1 - self._second]
        return low + (high - low) * float(at[1 - self._second](s))

    def along(self, values: Array) -> Array:
        """Flow speed of the onset at values of the second number, shape (k,); NaN for no onset."""
        if self._curve is None or self.found is None:
            return np.full(values.size, self._flat)
        curve, found = self._curve, self.found
        s, at = _splines(curve, found)
        (left, right), unit = self._ends, float(curve.frequency.max()) or 1.0
        plane, control = found._plane, Control(longest=1.0)
        of: type[AxisProblem] = FlutterProblem if curve.kind == "flutter" else DivergenceProblem
        problem = of(plane, control, unit)
        speeds = np.full(values.size, math.nan)
        for i, value in enumerate(values.tolist()):
            share = self._share(value)
            for here in _places_of_value(at[self._second], share, left, right)[:1]:
                z = np.array([at[1](here), at[0](here)])
                if curve.kind == "flutter":
                    z = np.append(np.interp(here, s, curve.frequency) / unit, z)
                problem.renew()
                try:
                    z = problem.fixed(z, share, -1 - self._second)
                except NewtonFailed:
                    continue
                speeds[i] = problem.place(z)[1 - self._second]
        return speeds


def _splines(curve: BoundaryCurve, found: Boundary) -> tuple[Array, list[Any]]:
    """Arc lengths of a curve's points, and cubic splines of x and y over the arc length.

    Arc lengths, x and y are in shares of the window.
    """
    low, high = np.array(found.ranges).T
    at = (np.column_stack([curve.x, curve.y]) - low) / (high - low)
    steps = np.linalg.norm(np.diff(at, axis=0), axis=1)
    s = np.append(0.0, np.cumsum(np.maximum(steps, 1e-12)))
    make = scipy.interpolate.CubicHermiteSpline
    return s, [make(s, at[:, i], curve.slopes[:, i]) for i in (0, 1)]


def _places_of_value(spline: Any, value: float, left: float, right: float) -> list[float]:
    """Arguments from `left` to `right` at which a cubic spline has a given value.

    If there are none, `left` and `right` count if the spline has the value there up to rounding.
    """
    found = np.atleast_1d(spline.solve(value, extrapolate=False))
    inside = [float(s) for s in found if left <= s <= right]
    return inside or [s for s in (left, right) if abs(spline(s) - value) < 1e-9]


def _monotone_parts(s: Array, second: Any) -> Array:
    """Arc lengths that divide a curve into parts on which the second number is monotone."""
    turns = np.atleast_1d(second.derivative().roots(extrapolate=False))
    return np.unique(np.concatenate([s[:1], s[-1:], turns[np.isfinite(turns)]]))


def _level(
    plane: EventPlane,
    name: str,
    ranges: dict[str, tuple[float, float]],
    speed: float,
    frequency: float,
) -> Boundary:
    """Boundary over a number without effect on small motions: the critical speed is constant."""
    ends, twice, passing = np.array(ranges[name]), np.ones(2), 2 if frequency else 1
    at, along = [ends, speed * twice], np.array([[1.0, 0.0], [1.0, 0.0]])
    if plane.own_first:
        at, along = at[::-1], along[:, ::-1]
    curve = BoundaryCurve(
        kind="flutter" if frequency else "divergence",
        x=at[0],
        y=at[1],
        frequency=frequency * twice,
        unstable=np.zeros(2, dtype=int),
        change=np.full(2, -passing if plane.own_first else passing),  # unstable at higher speeds
        lyapunov=math.nan * twice,
        criticality=np.array(["", ""]),
        error=0.0,
        ends=("range", "range"),
        slopes=along,
        organising=np.zeros((0, 2), dtype=int),
    )
    return Boundary(
        names=plane.names,
        ranges=(ranges[plane.names[0]], ranges[plane.names[1]]),
        curves=(curve,),
        points=(),
        u=None,
        model=plane.model,
        size=plane.model.dof,
        failures=(),
    )
