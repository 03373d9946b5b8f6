# SPDX-License-Identifier: MIT
"""Pictures of nonlinear results: bifurcation diagrams, limit cycles and Floquet multipliers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from pipedyn.cycles.branches import CycleBranch
from pipedyn.cycles.limit_cycle import LimitCycle
from pipedyn.diagram import BifurcationDiagram
from pipedyn.equilibrium.equilibria import EquilibriumBranch
from pipedyn.equilibrium.rotating_motion import RotatingBranch
from pipedyn.orbits.floquet import beyond_circle, nontrivial
from pipedyn.plot import common
from pipedyn.plot.arrange import legend_below
from pipedyn.plot.units import FLOW_SPEED, Units, View, of_coordinate
from pipedyn.util import check
from pipedyn.util.check import Array

MARKS: dict[str, dict[str, Any]] = {
    "fold": {"marker": "<", "color": common.VERMILION},
    "pitchfork": {"marker": "s", "color": common.GREEN},
    "branch point": {"marker": "D", "color": common.GREEN},
    "hopf": {"marker": "o", "color": common.ORANGE},
    "period doubling": {"marker": "^", "color": common.PURPLE},
    "torus": {"marker": "h", "color": common.PURPLE},
    "grazing": {"marker": "v", "color": common.VERMILION},
    "infinite period": {"marker": "*", "color": common.SKY, "markersize": 8.0},
    "end": {"marker": "P", "color": common.BLUE},
}
"""Look of the marker of each kind of bifurcation."""

A_STEP = 12
"""Number of straight pieces drawn between two points of a branch, enough to show no corners."""

FARTHEST = 5.0
"""Modulus of a multiplier up to which the picture is as wide as the multipliers are far."""

STABILITY_STYLES: dict[str, dict[str, Any]] = {
    "stable": {"linestyle": "-", "linewidth": 1.4, "zorder": 3.0},
    "unstable": {"linestyle": (0, (4, 2)), "linewidth": 1.0, "zorder": 2.0},
}
"""Look of stable and of unstable branches and cycles."""


def bifurcation_diagram(
    diagram: BifurcationDiagram,
    coordinate: Literal["tip"] | int = "tip",
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Transverse position of the free end against flow speed.

    Equilibria are black and thin. Cycles are blue; curves show the highest and lowest positions of
    cycles and of their mirror images. In three dimensions circular motions are green, at plus and
    minus their radius, and positions of other cycles are those along the direction in which the
    free end moves farthest. Stable branches are solid, unstable ones dashed. Grey dots are the
    turning points of motions from many initial states, and markers are bifurcations.

    Args:
        diagram: the diagram to show.
        coordinate: "tip", or the index of a coordinate, counted from 0. With an index only
            equilibria are shown; use an index if the free end is held by a support.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0, 5.0])
        >>> ax = plot.bifurcation_diagram(found)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check.instance("diagram", diagram, BifurcationDiagram)
    index, shown = of_coordinate(coordinate, diagram.model.coordinates)
    view = View(units, diagram.model.pipe)
    ax = view.axes(ax, (6.4, 4.2), FLOW_SPEED, shown)
    one = np.array([view.one(FLOW_SPEED), view.one(shown)])
    for branch in diagram.equilibria:
        heights = branch.tips[:, 0] if index is None else branch.q[:, index]
        at = [float(p.tip[0] if index is None else p.q[index]) for p in branch.points]
        _draw_branch(ax, branch, heights, at, "equilibrium", common.BLACK, one)
    for cycles in diagram.cycles if index is None else ():
        lowest = cycles.highest - 2.0 * cycles.amplitudes
        nearest = [
            int(np.argmin(abs(cycles.speeds - e.speed) + abs(cycles.amplitudes - e.amplitude)))
            for e in cycles.events
        ]
        mirror_image = (-cycles.highest, -lowest) if cycles.mirrored else ()
        for heights in (cycles.highest, lowest, *mirror_image):
            _draw_branch(ax, cycles, heights, heights[nearest], "cycle", common.BLUE, one)
    for circles in diagram.rotating if index is None else ():
        at = [float(np.hypot(*point.tip[::2])) for point in circles.points]
        for side in (1.0, -1.0):
            heights, marks = side * circles.radii, [side * radius for radius in at]
            _draw_branch(ax, circles, heights, marks, "circular motion", common.GREEN, one)
    if failed := sorted({failure.value for failure in diagram.failures}):
        cross = common.open_marker(5.0, common.VERMILION, marker="x", zorder=5.0)
        cross["transform"] = ax.get_xaxis_transform()
        ax.plot(one[0] * np.array(failed), np.full(len(failed), 0.02), label="failed", **cross)
    if diagram.motions and index is None:
        x = np.concatenate([np.full(one.turnings.size, one.speed) for one in diagram.motions])
        y = np.concatenate([one.turnings for one in diagram.motions])
        look: dict[str, Any] = {"marker": ".", "color": "0.6", "markersize": 5.0, "gid": "motions"}
        look |= {"linestyle": "none", "markeredgewidth": 0.0, "zorder": 1.0}
        look["rasterized"] = x.size > 20_000  # keeps vector files small
        ax.plot(one[0] * x, one[1] * y, label="turning points of motions", **look)
    if index is not None and (diagram.cycles or diagram.motions):
        ax.plot([], [], " ", label="cycles and motions are not shown")
    seen = diagram.motions and index is None
    rim = 0.01 * np.ptp(diagram.speeds) if seen else 0.0  # shows whole dots at the ends
    ax.set_xlim(one[0] * (diagram.speeds[0] - rim), one[0] * (diagram.speeds[-1] + rim))
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _draw_branch(
    ax: Axes,
    branch: EquilibriumBranch | CycleBranch | RotatingBranch,
    heights: Array,
    at: Sequence[float],
    name: str,
    colour: str,
    one: Array,
) -> None:
    """Draws a branch in stable and unstable pieces, and its bifurcations at the heights `at`.

    `one` holds the values shown for a nondimensional 1 of speed and height. A step between two
    points has the stability of the first point or, if that is a bifurcation, of the second.
    """
    events: Any = branch.events if isinstance(branch, CycleBranch) else branch.points
    speeds, stable = branch.speeds, branch.stable
    if speeds.size > 1:
        near = [1e-6 + getattr(event, "error", 0.0) for event in events]
        apart = np.abs(speeds[:, None] - [event.speed for event in events])
        special = (apart <= near).any(axis=1)
        stable = np.where(special[:-1], stable[1:], stable[:-1])
    draw_pieces(
        ax,
        one * smooth(speeds, heights),
        stable,
        colour,
        {w: f"{name}, {w}" for w in STABILITY_STYLES},
        width=0.6 if name == "equilibrium" else 1.0,
    )
    for event, height in zip(events, at, strict=True):
        if (name, event.kind) != ("cycle", "hopf"):
            mark_event(ax, event.kind, one * [event.speed, height])


def draw_pieces(
    ax: Axes, curve: Array, stable: Any, colour: str, labels: Mapping[str, str], width: float = 1.0
) -> None:
    """Draws a curve on finer steps; stable parts are solid and unstable parts dashed.

    Args:
        ax: the Axes.
        curve: points with `A_STEP` pieces a step, shape (A_STEP steps + 1, 2).
        stable: whether each step is stable, shape (steps,).
        colour: colour of the curve.
        labels: entries of the legend for "stable" and "unstable" pieces.
        width: factor of the width of the curve.
    """
    for start, stop in common.runs(np.asarray(stable)):
        word = "stable" if stable[start] else "unstable"
        part = curve[start * A_STEP : stop * A_STEP + 1]
        look = {"color": colour, "label": labels[word], **STABILITY_STYLES[word]}
        ax.plot(*part.T, **look | {"linewidth": width * look["linewidth"]})


def mark_event(ax: Axes, kind: str, place: Any) -> None:
    """Draws the marker of an event of a branch at (x, y)."""
    look = {"linestyle": "none", "markersize": 5.0, "zorder": 4.0, **MARKS[kind]}
    look |= {"markeredgecolor": "white", "markeredgewidth": 0.6}
    ax.plot(*place, label=kind.replace("hopf", "Hopf"), **look)


def smooth(*columns: Array) -> Array:
    """A smooth curve through k points of a branch, with `A_STEP` pieces a step.

    The curve consists of cubics between points, which are scaled by their ranges. At each point its
    tangent is that of the parabola over the chord lengths through this point and its neighbours. In
    Bezier's form, a cubic's inner points lie on the tangents at its ends, a third of its chord away
    or, if that is less, half of the chord projected on the tangent. Hence no cubic runs past
    its ends where a branch leaves another at an angle.

    Args:
        columns: numbers of the points, each of shape (k,): coordinates in the plane, and any other
            numbers that tell points apart where the curve in the plane has a cusp.

    Returns:
        The columns on finer steps, shape (A_STEP (k - 1) + 1, number of columns).
    """
    points = np.stack(columns, axis=1)
    if not points.size:
        return points
    ranges = np.ptp(points, axis=0) + 1e-12 * np.abs(points).max(axis=0) + 1e-300
    steps = np.diff(points / ranges, axis=0)
    places = np.append(0.0, np.cumsum(np.maximum(np.linalg.norm(steps, axis=1), 1e-12)))
    if places.size < 3 or not places[-1] > 1e-9:
        return np.repeat(points, A_STEP, axis=0)[: (len(points) - 1) * A_STEP + 1]
    tangents = np.gradient(points / ranges, places, axis=0, edge_order=2)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True) + 1e-300
    chords = np.diff(places)[:, None]
    begin, end = (
        ranges * along * np.clip(1.5 * (along * steps).sum(axis=1)[:, None], 0.0, chords) / 3.0
        for along in (tangents[:-1], tangents[1:])
    )
    corners = np.stack([points[:-1], points[:-1] + begin, points[1:] - end, points[1:]])
    at = np.arange((places.size - 1) * A_STEP + 1) / A_STEP
    found: Array = scipy.interpolate.BPoly(corners, np.arange(places.size))(at)
    found[::A_STEP] = points  # removes rounding errors at the points
    return found


def multipliers(
    cycles: LimitCycle | CycleBranch,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Floquet multipliers and the unit circle.

    The trivial multiplier is a ring at 1. Multipliers outside the circle, which make a cycle
    unstable, are crosses; multipliers inside it are dots. For a branch, colour shows the flow
    speed. If a multiplier is larger than 5, only the neighbourhood of the circle is shown, and the
    title says how large the largest is.

    Args:
        cycles: a limit cycle or a branch of limit cycles.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether a legend explains the markers.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> ax = plot.multipliers(pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 2), 4.0))

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("cycles", cycles, LimitCycle | CycleBranch, "limit cycles")
    first = cycles if isinstance(cycles, LimitCycle) else next(iter(cycles.cycles), None)
    view = View(units, None if first is None else first.model.pipe)
    ax = common.axes(ax, (4.4, 4.2), xlabel=r"Re $\rho$", ylabel=r"Im $\rho$")
    circle: dict[str, Any] = {"facecolor": "0.95", "edgecolor": "0.4", "linewidth": 0.8}
    ax.add_patch(Circle((0.0, 0.0), 1.0, zorder=0.2, **circle))
    ax.axhline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    ax.axvline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    values = np.array([nontrivial(row) for row in np.atleast_2d(cycles.multipliers)])
    outside = beyond_circle(values) > 0.0
    speeds = None
    if isinstance(cycles, CycleBranch):
        speeds = np.broadcast_to(view.one(FLOW_SPEED) * cycles.speeds[:, None], values.shape)
    looks = (
        (~outside, "o", 16, common.BLUE, "inside the circle"),
        (outside, "X", 30, common.VERMILION, "outside: unstable"),
    )
    named: dict[str, Any] = {}
    for chosen, marker, size, plain, words in looks:
        if not chosen.any():
            continue
        look: dict[str, Any] = {"color": plain}
        if speeds is not None:
            ends = {"vmin": float(speeds.min()), "vmax": float(speeds.max()) + 1e-12}
            look = {"c": speeds[chosen], "cmap": "viridis", **ends}
            plain = "0.3"  # colours show speeds
        points = values[chosen]
        ax.scatter(points.real, points.imag, marker=marker, s=size, zorder=3.0, **look)
        entry: dict[str, Any] = {"linestyle": "none", "markersize": math.sqrt(size)}
        entry |= {"color": plain, "marker": marker, "markeredgewidth": 0.0}
        named[words] = Line2D([], [], **entry)
    if speeds is not None:
        common.colour_bar(view.label(FLOW_SPEED), ax=ax)
    ring = {"markerfacecolor": "none", "markeredgewidth": 1.4, "zorder": 3.5}
    look = common.open_marker(7.0, common.SKY, **ring)
    (named["trivial, 1"],) = ax.plot([1.0], [0.0], **look)
    ax.margins(0.08)
    near = (farthest := float(np.abs(values).max(initial=0.0))) <= FARTHEST
    ax.set_aspect("equal", adjustable="datalim" if near else "box")
    if not near:
        ax.set(xlim=(-FARTHEST, FARTHEST), ylim=(-FARTHEST, FARTHEST))
        ax.set_title(f"not all are shown: up to {farthest:.3g}")
    if check.flag("legend", legend):
        legend_below(ax, named)
    return ax
