# SPDX-License-Identifier: MIT
"""Picture of curves of folds, pitchforks, period doublings and tori of cycles over two numbers."""

from __future__ import annotations

from itertools import cycle as repeated
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from pipedyn.curves.boundary import Boundary
from pipedyn.curves.cycle_boundary import CycleBoundary
from pipedyn.plot import common
from pipedyn.plot.bifurcation import A_STEP, draw_pieces, smooth
from pipedyn.plot.stability_map import parts_of_stability
from pipedyn.plot.units import PlaneView, Units
from pipedyn.util import check
from pipedyn.util.check import Array

COLOURS = {
    "fold": common.VERMILION,
    "pitchfork": common.GREEN,
    "period doubling": common.PURPLE,
    "torus": common.BLUE,
}

POINT_MARKS = ("o", "v", "D", "s", "^", "p", "h", "P", "X", "*")
"""Markers of named points; each kind of point in a picture gets one."""


def cycle_boundary(
    found: CycleBoundary, *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Curves of events of cycles in the plane of two numbers, and regions of rest beside flutter.

    Curves are solid if a stable cycle meets them, and dashed if all cycles nearby are unstable. The
    straight pipe becomes unstable at black curves. The shaded region lies between a fold from which
    stable cycles lead to higher speeds and the next higher speed at which the straight pipe loses
    stability. In this region both rest and large flutter are stable, and a push of the pipe decides
    between them. Markers are named points.

    Args:
        found: the result of `pipedyn.cycle_boundary`.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.3]).cycles
        >>> folds = [event for event in branch.events if event.kind == "fold"]
        >>> window = {"beta": (0.04, 0.1), "u": (2.0, 5.0)}
        >>> ax = plot.cycle_boundary(pp.cycle_boundary(branch, folds, "beta", "u", window))

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("found", found, CycleBoundary)
    plane = PlaneView(units, found.model.pipe, found.names)
    ax = plane.axes(ax, (6.4, 4.8), *plane.quantities)
    across = found.names[0] == "u"  # the flow speed is on the x axis
    for curve in found.curves:
        # A curve in the plane may have a cusp, where frequency and amplitude go on smoothly.
        x, y, *_ = smooth(curve.x, curve.y, curve.frequency, curve.amplitude).T
        steady = np.maximum(curve.unstable[:-1], curve.unstable[1:]) == 0
        labels = {"stable": f"{curve.kind} of a stable cycle"}
        labels["unstable"] = f"{curve.kind} of unstable cycles"
        draw_pieces(ax, plane.at(x, y).T, steady, COLOURS[curve.kind], labels)
        if found.onsets is None or curve.kind != "fold":
            continue
        second, speed = (y, x) if across else (x, y)
        onset = np.interp(np.arange(len(x)) / A_STEP, np.arange(curve.onset.size), curve.onset)
        shade = ax.fill_betweenx if across else ax.fill_between
        place = np.arange(len(x) - 1) // A_STEP
        opens = np.where(curve.opens[:-1] != 0, curve.opens[:-1], curve.opens[1:])
        both = np.append(((opens > 0) & steady)[place], False)
        both[1:] |= both[:-1]
        until = _stable_until(found.onsets, second, speed, across)
        both &= np.isfinite(until) & ~(speed >= onset)
        if both.any():
            look: dict[str, Any] = {"color": common.ORANGE, "alpha": 0.25, "linewidth": 0.0}
            look |= {"zorder": 0.5, "label": "rest and flutter both stable"}
            along, bottom = plane.at(x, y)[:: -1 if across else 1]
            top = plane.at(until, y)[0] if across else plane.at(x, until)[1]
            shade(along, bottom, top, where=both, **look)
    black: dict[str, Any] = {"color": common.BLACK, "linewidth": 1.4, "zorder": 2.5}
    if found.onsets is not None:
        for bound in found.onsets.curves:
            for places, *_ in parts_of_stability(bound, found.onsets):
                ax.plot(*plane.at(*places.T), label="the straight pipe becomes unstable", **black)
    kinds = dict.fromkeys(point.kind for point in found.points)
    for kind, marker in zip(kinds, repeated(POINT_MARKS), strict=False):
        same = [point for point in found.points if point.kind == kind]
        look = common.open_marker(5.5, marker=marker, zorder=4.0)
        at = plane.at([p.x for p in same], [p.y for p in same])
        ax.plot(*at, clip_on=False, label=kind, **look)
    xlim, ylim = plane.limits(found.ranges)
    ax.set(xlim=xlim, ylim=ylim)
    common.legend_below(ax)
    plane.second_axes(ax, *plane.quantities)
    return ax


def _stable_until(onsets: Boundary, second: Array, speed: Array, across: bool) -> Array:
    """Next higher speeds at which the straight pipe loses stability, at values of the other number.

    The speeds lie on the lowest bound of stability above the given speeds. They are NaN if the pipe
    is stable above that bound and hence unstable at the given speed.
    """
    near = 1e-9 * float(np.ptp(onsets.ranges[1 if across else 0]))  # allows for rounding at edges
    lowest, stable = np.full(speed.size, np.inf), np.zeros(speed.size, dtype=np.bool_)
    for bound in onsets.curves:
        own = np.column_stack([bound.x, bound.y])
        for places, *_ in parts_of_stability(bound, onsets):
            middle = places[len(places) // 2]
            nearest = int(
                np.argmin(np.abs((own - middle) / np.ptp(onsets.ranges, axis=1)).sum(axis=1))
            )
            at, speeds = places.T[:: -1 if across else 1]
            for i in np.flatnonzero(np.diff(at)).tolist():
                low, high = sorted((at[i], at[i + 1]))
                inside = np.flatnonzero((second >= low - near) & (second <= high + near))
                share = (second[inside] - at[i]) / (at[i + 1] - at[i])
                height = speeds[i] + share * (speeds[i + 1] - speeds[i])
                first = (height > speed[inside]) & (height < lowest[inside])
                lowest[inside[first]] = height[first]
                # change > 0: more roots are unstable on the left, above a piece to larger x.
                below = (bound.change[nearest] > 0) == (at[i + 1] > at[i])
                stable[inside[first]] = below != across
    return np.where(stable, lowest, np.nan)
