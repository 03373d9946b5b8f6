# SPDX-License-Identifier: MIT
"""Onset of flutter at which a branch of cycles begins, as a function of the second number."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np
import scipy

from pipedyn.continuation.arclength import Control
from pipedyn.curves.boundary import Boundary, BoundaryCurve, bounded, checked_window
from pipedyn.curves.event_plane import EventPlane
from pipedyn.equilibrium.axis_problems import AxisProblem, DivergenceProblem, FlutterProblem
from pipedyn.linear.modes import largest_speed
from pipedyn.linear.plane import Window
from pipedyn.util.check import Array
from pipedyn.util.errors import PipedynError
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
        self._curve: BoundaryCurve | None = None
        second, name = plane.ranges[plane.second], plane.names[plane.second]
        speeds = plane.ranges[1 - plane.second]
        top = min(max(speeds[1], fastest), largest_speed(plane.model))
        ranges = {name: second, "u": (min(speeds[0] or math.inf, 0.1 * top), top)}
        if name in ("beta", "root.stiffness") and second[0] == 0.0:
            ranges[name] = (FROM_0 * second[1], second[1])
        try:
            for one in map(plane.at, ranges[name]):
                if one.model.pipe.thrust_across or one.resting().any():
                    raise ValueError(f"the straight pipe does not rest, got {one.model!r}")
            # A number without effect on small motions has a level boundary.
            self.window = checked_window(plane.model, plane.names, ranges, motions=True)
            self.found = bounded(plane.model, self.window, None, False, True, plane.names)
        except (PipedynError, ValueError) as error:
            self.failures.append(f"the onset of flutter was not followed over {name}: {error}")
            return
        lowest = math.inf
        for curve in self.found.curves:
            s, at = _splines(curve, self.window)
            bounds = _monotone_parts(s, at[plane.second])
            for here in _places_of_value(at[plane.second], self._share(plane.value), s[0], s[-1]):
                place = self.window.place(np.array([at[0](here), at[1](here)]))
                speed = float(place[1 - plane.second])
                k = min(int(np.searchsorted(s, here, "right")) - 1, len(curve) - 2)
                if math.isnan(begin):
                    wanted = speed < lowest and curve.unstable[k : k + 2].min() == 0
                else:
                    wanted = curve.kind == "flutter" and abs(speed / begin - 1.0) < SAME_ONSET
                if wanted:
                    lowest, self._curve = speed, curve
                    i = min(int(np.searchsorted(bounds, here, "right")), bounds.size - 1)
                    self._ends = bounds[i - 1], bounds[i]

    def _share(self, value: float) -> float:
        """A value of the second number as a share of its range."""
        second = self.plane.second
        return float((value - self.window.low[second]) / self.window.size[second])

    def along(self, values: Array) -> Array:
        """Flow speed of the onset at values of the second number, shape (k,); NaN for no onset."""
        speeds = np.full(values.size, math.nan)
        if self._curve is None or self.found is None:
            return speeds
        curve, second = self._curve, self.plane.second
        s, at = _splines(curve, self.window)
        unit = float(curve.frequency.max()) or 1.0
        of: type[AxisProblem] = FlutterProblem if curve.kind == "flutter" else DivergenceProblem
        problem = of(self.found._plane, Control(longest=1.0), unit)
        for i, share in enumerate(map(self._share, values.tolist())):
            for here in _places_of_value(at[second], share, *self._ends)[:1]:
                z = np.array([at[1](here), at[0](here)])
                if curve.kind == "flutter":
                    z = np.append(np.interp(here, s, curve.frequency) / unit, z)
                problem.renew()
                with suppress(NewtonFailed):
                    z = problem.fixed(z, share, -1 - second)
                    speeds[i] = problem.place(z)[1 - second]
        return speeds


def _splines(curve: BoundaryCurve, window: Window) -> tuple[Array, list[Any]]:
    """Arc lengths of a curve's points, and cubic splines of x and y over the arc length.

    Arc lengths, x and y are in shares of the window.
    """
    at = (np.column_stack([curve.x, curve.y]) - window.low) / window.size
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
