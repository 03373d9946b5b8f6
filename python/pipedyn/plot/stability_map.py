# SPDX-License-Identifier: MIT
"""Pictures of the plane of two numbers: stability boundaries of pipes, and events of cycles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import cycle, groupby, pairwise
from typing import Any

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patheffects import withTickedStroke
from numpy.typing import NDArray

from pipedyn.curves.boundary import Boundary, BoundaryCurve
from pipedyn.curves.cycle_boundary import CycleBoundary
from pipedyn.plot import common
from pipedyn.plot.arrange import legend_below, write_beside
from pipedyn.plot.bifurcation import A_STEP, draw_pieces, smooth
from pipedyn.plot.units import FLOW_SPEED, OF_A_NUMBER, PlaneView, Units, View, of_number
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged

ORGANISING_MARKERS = {
    "Bautin": "D",
    "Hopf-pitchfork": "s",
    "fold-Hopf": "P",
    "cusp": "*",
    "double Hopf": "o",
    "Bogdanov-Takens": "^",
    "double divergence": "X",
    "degenerate pitchfork": "v",
}

KIND_COLOURS = {
    "flutter": (common.BLACK, common.VERMILION),
    "divergence": (common.BLUE, common.PURPLE),
    "flutter across": (common.GREEN, common.ORANGE),
    "divergence across": (common.SKY, common.PURPLE),
}
"""Colours of curves, and of their subcritical parts, which are dashed."""

OTHERS_UNSTABLE = "other roots unstable"

STABLE = "#DCEBDD"
UNSEARCHED: dict[str, Any] = {"facecolor": "none", "edgecolor": "0.75", "hatch": "////"}
UNSEARCHED |= {"linewidth": 0.0, "label": "not searched"}
PER_STEP = 8
"""Number of straight pieces in which each step of a curve is drawn."""

COLUMNS = 500
"""Numbers of rows and columns of the shading, so that its steps are hidden by the curves."""


def boundary(
    found: Boundary, *, units: Units = "nondimensional", legend: bool = True, ax: Axes | None = None
) -> Axes:
    """Boundaries of stability in the plane of two numbers; the stable region is shaded.

    Curves are solid if the bifurcation is supercritical, dashed if it is subcritical, thin if the
    criticality was not computed, and dotted and pale if other roots are unstable. The legend names
    organising points.

    Args:
        found: the result of `pipedyn.boundary`.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> window = {"gamma": (-20.0, 0.0), "u": (0.0, 5.0)}
        >>> found = pp.boundary(pp.Chain(pp.Pipe(0.2, damping=0.01), 2), "gamma", "u", window)
        >>> ax = plot.boundary(found)

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("found", found, Boundary)
    plane = PlaneView(units, found.model.pipe, found.names)
    ax = plane.axes(ax, (6.4, 4.8), *plane.quantities)
    (left, right), (low, high) = plane.limits(found.ranges)
    stable = _stable(found)
    (x, y), row, column, searched = _pixels(found, plane)
    shade = np.zeros((COLUMNS, COLUMNS, 4))
    shade[stable[row, column] & searched] = to_rgba(STABLE)
    if (stable[row, column] & searched).any():
        ax.fill([], [], facecolor=STABLE, label="stable")
    within = (left, right, low, high)
    ax.imshow(shade, origin="lower", extent=within, aspect="auto", zorder=0.2, label="_shade")
    for curve in found.curves:
        places, of, _ = _dense(curve, found)
        kinds, others = curve.criticality[of], curve.unstable[of] > 0
        for first, last in common.runs(np.char.add(kinds, others.astype(str))):
            kind, subcritical = str(kinds[first]), bool(kinds[first] == "subcritical")
            beside = OTHERS_UNSTABLE if others[first] and not kind else ""
            name = curve.kind + " across" * bool(curve.across)
            label = ", ".join(word for word in (name, kind, beside) if word)
            look: dict[str, Any] = {"color": KIND_COLOURS[name][subcritical], "label": label}
            dotted = (0, (1.0, 1.5)) if beside else "-"
            look |= {"linestyle": (0, (1.6, 0.8)) if subcritical else dotted}
            look |= {"linewidth": 1.6 if kind else 0.7, "alpha": 0.5 if others[first] else 1.0}
            ax.plot(*plane.at(*places[first : last + 1].T), **look)
    for point in found.points:
        mark = common.open_marker(5.5, marker=ORGANISING_MARKERS[point.kind], zorder=4.0)
        ax.plot(*plane.at(point.x, point.y), label=point.kind, **mark)
    if not searched.all():
        hatch = ax.contourf(x, y, searched, [-0.5, 0.5], colors="none", hatches=["////"])
        hatch.set(edgecolor=UNSEARCHED["edgecolor"], linewidth=0.0)
        ax.fill([], [], **UNSEARCHED)
    if found.failures:
        ax.plot([], [], " ", label=f"{check.how_many(len(found.failures), 'curve')} with failures")
    ax.set(xlim=(left, right), ylim=(low, high))
    if not found.curves:
        common.write(ax, _why_nothing({_stability(found)}))
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _dense(curve: BoundaryCurve, found: Boundary) -> tuple[Array, NDArray[np.int_], Array]:
    """Divides a curve in k straight pieces, on cubics through its points and tangents.

    Between two points, criticality and counts of unstable roots change at an organising point,
    which is then an end of pieces. If no organising point is known between them, e.g. if the
    criticality passes through infinity, they change in the middle of the step.

    Returns:
        Ends of the pieces, (k + 1, 2); for each piece the index of the point whose values hold on
        it, (k,); and whether it is known where in its step the counts change, (k,).
    """
    low, high = np.array(found.ranges).T
    at = (np.column_stack([curve.x, curve.y]) - low) / (high - low)
    steps = np.maximum(np.linalg.norm(np.diff(at, axis=0), axis=1), 1e-12)
    along = np.append(0.0, np.cumsum(steps))
    cubics = scipy.interpolate.CubicHermiteSpline(along, at, curve.slopes)
    shares = np.arange(PER_STEP) / PER_STEP
    step, share = np.repeat(np.arange(steps.size), PER_STEP), np.tile(shares, steps.size)
    places, change = cubics(along[step] + share * steps[step]), np.full(steps.size, 0.5)
    within, which = curve.organising.T
    points = [found.points[i] for i in which]
    marks = (np.array([[one.x, one.y] for one in points]).reshape(-1, 2) - low) / (high - low)
    for k, mark in zip(within, marks, strict=True):
        straight = at[k + 1] - at[k]
        reached = np.vstack([places[step == k], at[k + 1]]) @ straight
        change[k] = np.interp(mark @ straight, reached, [*shares, 1.0])
    order = np.argsort(np.concatenate([step + share, within + change[within]]), kind="stable")
    step, share = np.append(step, within)[order], np.append(share, change[within])[order]
    ends = np.concatenate([np.concatenate([places, marks])[order], at[-1:]])
    same = (np.diff(curve.unstable) == 0) & (np.diff(curve.change) == 0)
    known = same | (np.bincount(within, minlength=steps.size) == 1)
    return low + (high - low) * ends, step + (share >= change[step]), known[step]


def _pixels(found: Boundary, plane: PlaneView) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Positions of pixels of the Axes, rows and columns in `_stable`, and whether in the window."""
    middles = (np.arange(COLUMNS) + 0.5) / COLUMNS
    (left, right), (low, high) = plane.limits(found.ranges)
    at = np.array(np.meshgrid(left + (right - left) * middles, low + (high - low) * middles))
    least, most = np.array(found.ranges).T[:, :, None, None]
    share = (at / plane.units(*at) - least) / (most - least)
    column, row = np.clip((share * COLUMNS).astype(int), 0, COLUMNS - 1)
    return at, row, column, ((share >= 0.0) & (share <= 1.0)).all(axis=0)


def _stable(found: Boundary) -> NDArray[np.bool_]:
    """Whether no root is unstable, in rows by increasing y, (COLUMNS, COLUMNS).

    Neighbouring columns that cross the same curves in the same order cross the same regions between
    these; a curve counts as several, one for each arc on which x only grows or only falls, since it
    may cross itself. A region ends where two curves come closer than a row. Eigenvalues are counted
    once in each region, in the column in which it is highest.
    """
    (left, right), (low, high) = found.ranges
    middles = (np.arange(COLUMNS) + 0.5) / COLUMNS
    columns, rows = left + (right - left) * middles, low + (high - low) * middles
    crossed: list[list[tuple[float, int, int]]] = [[] for _ in columns]
    walls = np.zeros(COLUMNS + 1, dtype=np.int_)  # curves between each column and the one before
    for number, curve in enumerate(found.curves):
        places, *_ = _dense(curve, found)
        begins = np.searchsorted(columns, places[:, 0])
        walls[begins[0]] += begins.min() == begins.max()
        arcs = np.cumsum(np.diff(np.sign(np.diff(places[:, 0])), prepend=0.0) != 0.0).tolist()
        ends = pairwise(zip(*places.T, begins, strict=True))
        for arc, ((x, y, begin), (to_x, to_y, end)) in zip(arcs, ends, strict=True):
            for k in range(*sorted((begin, end))):
                height = y + (columns[k] - x) / (to_x - x) * (to_y - y)
                crossed[k].append((float(np.clip(height, low, high)), number, arc))
    walls = np.cumsum(walls)
    stable = np.zeros((COLUMNS, COLUMNS), dtype=np.bool_)
    orders = [(walls[k], *(of for _, *of in sorted(one))) for k, one in enumerate(crossed)]
    for _, group in groupby(range(COLUMNS), key=orders.__getitem__):
        alike = list(group)
        heights = np.array([[low, *sorted(at for at, *_ in crossed[k]), high] for k in alike]).T
        for bottom, top in pairwise(heights):
            seen = top - bottom > (high - low) / COLUMNS
            for first, last in common.runs(seen):
                k = first + int(np.argmax((top - bottom)[first:last]))
                at = float(columns[alike[k]]), float(0.5 * (bottom[k] + top[k]))
                if seen[k] and _unstable_at(found, *at) == 0:
                    part = slice(first, last)
                    inside = (rows[:, None] > bottom[part]) & (rows[:, None] < top[part])
                    stable[:, alike[part]] |= inside
    return stable


# --------------------------------------------------------------------- boundaries of several pipes


def stability_map(
    boundaries: Mapping[str, Boundary],
    highest: float | None = None,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Speeds at which several pipes lose or regain stability, against a number.

    Ticks on boundaries point to the unstable side. Words at a curve of divergence tell whether the
    flow buckles the pipe above it or the weight does below it, where they cover nothing. Parts of
    boundaries on which other roots are unstable are left out; if no part is left, the legend says
    whether the pipe is stable at the speeds searched. Pipes are in the order of gamma. The x axis
    shows the range searched.

    Args:
        boundaries: boundaries by their labels, with the same number for x and "u" for y.
        highest: end of the axis of speed, nondimensional.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> window = {"beta": (0.1, 0.9), "u": (0.0, 15.0)}
        >>> found = pp.boundary(pp.Chain(pp.Pipe(0.2), 4), "beta", "u", window, criticality=False)
        >>> ax = plot.stability_map({"chain, n = 4": found})

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    if not isinstance(boundaries, Mapping):
        raise TypeError(
            "boundaries must map labels to boundaries, as {'chain': found} does, got "
            f"{check.shown(boundaries)}"
        )
    names = list(dict.fromkeys(_number_swept(label, one) for label, one in boundaries.items()))
    if len(names) > 1:
        raise ValueError(f"boundaries must be over one number, got {', '.join(names)}")
    if highest is not None:
        highest = check.real("highest", highest, low=0.0, open_low=True)
    every, name = list(boundaries.items()), names[0] if names else "beta"
    if name != "gamma":
        every.sort(key=lambda item: item[1].model.pipe.gamma)
    pipe = every[0][1].model.pipe if every else None
    view = View(units, pipe)
    shown = OF_A_NUMBER[name] if pipe is None else of_number(name, pipe)
    ax = view.axes(ax, (6.4, 4.8), shown, FLOW_SPEED)
    states, searched, reach = list[str](), list[float](), 0.0  # states: of pipes without a boundary
    for (label, found), look in zip(every, cycle(common.CURVE_STYLES), strict=False):
        plane = PlaneView(units, found.model.pipe, found.names)
        parts = [part for curve in found.curves for part in parts_of_stability(curve, found)]
        across, (_, end) = plane.limits(found.ranges)
        searched, reach = [*searched, *across.tolist()], max(reach, float(end))
        note = ""
        if not parts:
            states.append(_stability(found))
            # The SI unit of speed depends on the mass ratio, so the range is nondimensional.
            said = View("nondimensional", None) if name == "beta" else plane
            low, high = (said.speed(float(end)) for end in found.ranges[1])
            note = f": {states[-1]} from {low} to {high}"
        elif highest is not None and min(part[0][:, 1].min() for part in parts) >= highest:
            note = f": no boundary up to {plane.speed(highest)}"
        if found.failures:
            note += f" ({check.how_many(len(found.failures), 'curve')} with failures)"
        ax.plot([], [], linewidth=1.5, label=f"{label}{note}", **look)
        written = set[bool]()  # words are written once above and once below, at the longest parts
        for line, kind, left in sorted(parts, key=lambda part: -np.ptp(part[0][:, 0])):
            ticks = withTickedStroke(angle=90.0 if left else -90.0, **TICKS)
            at = plane.at(*line.T).T
            ax.plot(*at.T, linewidth=1.3, path_effects=[ticks], **look)
            middle = line.shape[0] // 2
            upper = (np.diff(at[:, 0]) > 0.0) == left  # where the unstable side is above
            above = bool(upper[middle - 1])
            if kind == "divergence" and above not in written:
                written.add(above)
                gamma = line[middle, 0] if name == "gamma" else found.model.pipe.gamma
                _write_divergence(ax, at[1:][upper == above], above, gamma < 0.0, look["color"])
    drawn = len(states) < len(every)
    end = min(1.1 * ax.dataLim.y1, reach) if drawn else reach
    if highest is not None:
        end = view.one(FLOW_SPEED) * highest
    ax.set_ylim(0.0, end if end > 0.0 else None)
    if searched:
        ax.set_xlim(min(searched), max(searched))
    if boundaries:
        _unsearched(ax, units, list(boundaries.values()))
    if drawn:
        ticks = withTickedStroke(angle=-90.0, **TICKS)
        ax.plot([], [], color="0.3", path_effects=[ticks], label="ticks: unstable side")
    else:
        common.write(ax, _why_nothing({*states}))
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _stability(found: Boundary) -> str:
    """Stability, in words, of a pipe that has no boundary in the window."""
    if found.failures:
        return "no boundary known"
    count = _unstable_at(found, *np.mean(found.ranges, axis=1).tolist())
    return "unstable" if count else "stable"


def _unstable_at(found: Boundary, x: float, y: float) -> int:
    """Number of unstable roots at a point; 1 where a bent rest has snapped away."""
    try:
        return found.unstable(x, y)
    except NotConverged:
        return 1


def _why_nothing(states: set[str]) -> str:
    """A sentence that says why a map has no boundary, from the stability of its pipes."""
    if not states or not states <= {"stable", "unstable"}:
        return "No stability boundary was computed."
    all_is = f": all is {next(iter(states))}" if len(states) == 1 else ""
    return f"No boundary lies in the window{all_is}."


def _unsearched(ax: Axes, units: Units, found: list[Boundary]) -> None:
    """Hatches speeds above the searched ones; in SI their limit depends on beta, as the unit."""
    highest = ax.get_ylim()[1]
    ends = list[Array]()
    for one in found:
        (left, right), (_, end) = one.ranges
        plane = PlaneView(units, one.model.pipe, one.names)
        ends.append(plane.at(np.linspace(left, right, 200), np.full(200, end)))
    beta, lowest = ends[0][0], np.min([end for _, end in ends], axis=0)
    if (lowest < (1.0 - 1e-9) * highest).any():
        ax.fill_between(beta, lowest, highest, lowest < highest, interpolate=True, **UNSEARCHED)
        ax.set_ylim(0.0, highest)


TICKS: dict[str, Any] = {"spacing": 8.0, "length": 0.5, "linewidth": 0.7}
TICKS["dashes"] = {"dash_offset": 0.0, "dash_list": None}
"""Look of the ticks on the unstable sides of boundaries."""


def _number_swept(label: Any, one: Any) -> str:
    """Name of the number on the x axis of a boundary; raises TypeError or ValueError."""
    check.instance("the names of boundaries", label, str)
    found: Boundary = check.instance(f"boundaries[{label!r}]", one, Boundary)
    if found.names[1] != "u":
        raise ValueError(f"boundaries[{label!r}] must have 'u' for y, got {found.names!r}")
    return found.names[0]


def _write_divergence(ax: Axes, at: Array, above: bool, standing: bool, colour: str) -> None:
    """Writes words at one of k points of a curve of divergence, which say where the pipe buckles.

    The words are on that side, or on the other side if there is room only there.
    """
    words = "buckled by its weight below" if standing else "divergence below"
    words = "divergence above" if above else words
    shares = sorted(np.linspace(0.05, 0.95, 25), key=lambda share: abs(share - 0.5))
    places = at[(np.array(shares) * len(at)).astype(int)]
    sides = np.array([[0, 1], [0, -1]])[:: 1 if above else -1].repeat(len(places), axis=0)
    look: dict[str, Any] = {"needed": False, "gap": 6.0, "color": colour, "fontsize": 7.0}
    write_beside(ax, words, np.tile(places, (2, 1)), sides, **look)


def parts_of_stability(curve: BoundaryCurve, found: Boundary) -> Iterator[tuple[Array, str, bool]]:
    """Yields the parts of a curve on which no other root is unstable, as points of shape (k, 2).

    Each part comes with its kind, and with whether the pipe is unstable on the left of the curve.
    """
    places, of, certain = _dense(curve, found)
    sides = np.where(certain & (curve.unstable[of] == 0), np.sign(curve.change[of]), 0)
    for first, last in common.runs(sides):
        if sides[first]:
            yield places[first : last + 1], curve.kind, bool(sides[first] > 0)


# ------------------------------------------------------------------------------ events of cycles


EVENT_COLOURS = {
    "fold": common.VERMILION,
    "pitchfork": common.GREEN,
    "period doubling": common.PURPLE,
    "torus": common.BLUE,
}

POINT_MARKS = ("o", "v", "D", "s", "^", "p", "h", "P", "X", "*")
"""Markers of named points; each kind of point in a picture gets one."""


def cycle_boundary(
    found: CycleBoundary,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
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
        legend: whether to add a legend, below the Axes or inside.
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
        draw_pieces(ax, plane.at(x, y).T, steady, EVENT_COLOURS[curve.kind], labels)
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
            look: dict[str, Any] = {"color": common.ORANGE, "alpha": 0.5, "linewidth": 0.0}
            look |= {"zorder": 0.5, "label": "rest and flutter both stable"}
            along, bottom = plane.at(x, y)[:: -1 if across else 1]
            top = plane.at(until, y)[0] if across else plane.at(x, until)[1]
            shade(along, bottom, top, where=both, **look)
    black: dict[str, Any] = {"color": common.BLACK, "linewidth": 0.8, "zorder": 2.5}
    if found.onsets is not None:
        for bound in found.onsets.curves:
            for places, *_ in parts_of_stability(bound, found.onsets):
                ax.plot(*plane.at(*places.T), label="the straight pipe becomes unstable", **black)
    kinds = dict.fromkeys(point.kind for point in found.points)
    for kind, marker in zip(kinds, cycle(POINT_MARKS), strict=False):
        same = [point for point in found.points if point.kind == kind]
        look = common.open_marker(5.5, marker=marker, zorder=4.0)
        at = plane.at([p.x for p in same], [p.y for p in same])
        ax.plot(*at, clip_on=False, label=kind, **look)
    xlim, ylim = plane.limits(found.ranges)
    ax.set(xlim=xlim, ylim=ylim)
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _stable_until(onsets: Boundary, second: Array, speed: Array, across: bool) -> Array:
    """Next higher speeds at which the straight pipe loses stability, at values of the other number.

    The speeds lie on the lowest bound of stability above the given speeds. They are NaN if the pipe
    is stable above that bound and hence unstable at the given speed.
    """
    near = 1e-9 * float(np.ptp(onsets.ranges[1 if across else 0]))  # allows for rounding at edges
    lowest, stable = np.full(speed.size, np.inf), np.zeros(speed.size, dtype=np.bool_)
    for bound in onsets.curves:
        for places, _, left in parts_of_stability(bound, onsets):
            at, speeds = places.T[:: -1 if across else 1]
            for i in np.flatnonzero(np.diff(at)).tolist():
                low, high = sorted((at[i], at[i + 1]))
                inside = np.flatnonzero((second >= low - near) & (second <= high + near))
                share = (second[inside] - at[i]) / (at[i + 1] - at[i])
                height = speeds[i] + share * (speeds[i + 1] - speeds[i])
                first = (height > speed[inside]) & (height < lowest[inside])
                lowest[inside[first]] = height[first]
                # An unstable side on the left lies above a piece to larger values.
                stable[inside[first]] = (left == (at[i + 1] > at[i])) != across
    return np.where(stable, lowest, np.nan)
