# SPDX-License-Identifier: MIT
"""Stability boundaries in the plane of two numbers, and maps of several pipes' boundaries."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import cycle, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from numpy.typing import NDArray

from pipedyn.bifurcation.boundary import Boundary, BoundaryCurve
from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.plot import common, units
from pipedyn.util import check
from pipedyn.util.check import Array

MARKERS = {
    "Bautin": "D",
    "Hopf-pitchfork": "s",
    "double Hopf": "o",
    "Bogdanov-Takens": "^",
    "double divergence": "X",
    "degenerate pitchfork": "v",
}

LOOKS: dict[tuple[str, str], dict[str, Any]] = {
    ("flutter", "supercritical"): {"color": common.BLACK, "linewidth": 1.6},
    ("flutter", "subcritical"): {"color": common.VERMILION, "linewidth": 1.6},
    ("flutter", ""): {"color": common.BLACK, "linewidth": 0.7},
    ("divergence", "supercritical"): {"color": common.BLUE, "linewidth": 1.6},
    ("divergence", "subcritical"): {"color": common.PURPLE, "linewidth": 1.6},
    ("divergence", ""): {"color": common.BLUE, "linewidth": 0.7},
}
DASHES = {"supercritical": "-", "subcritical": (0, (4, 1.5)), "": "-"}

BESIDE = "other roots unstable"

STABLE = "#DCEBDD"
PER_STEP = 8
"""Pieces in which a step of a curve is drawn."""

COLUMNS = 500
"""Of the shading, either way: its steps are hidden by the curves."""


def boundary(found: Boundary, ax: Axes | None = None) -> Axes:
    """Boundaries of stability, the stable region shaded.

    Curves are solid where what emerges attracts, dashed where it repels, thin where other roots are
    unstable or the criticality was not computed. The legend names organising points. Further axes
    are in SI units where the pipe's numbers come from them.

    Args:
        found: what `pipedyn.boundary` answered.
        ax: where to draw; new Axes where not given.

    Example:
        >>> window = {"gamma": (-20.0, 0.0), "u": (0.0, 5.0)}
        >>> found = pp.boundary(pp.Chain(pp.Pipe(0.2, damping=0.01), 2), "gamma", "u", window)
        >>> ax = plot.boundary(found)

    Raises:
        TypeError: for bad arguments.
    """
    common.check_type("found", found, Boundary)
    shown = [units.of_number(name, found.model.pipe) for name in found.names]
    ax = common.axes(ax, (6.4, 4.8), xlabel=shown[0].label, ylabel=shown[1].label)
    (left, right), (low, high) = found.ranges
    shade = np.zeros((COLUMNS, COLUMNS, 4))
    shade[_stable(found)] = to_rgba(STABLE)
    within = (left, right, low, high)
    ax.imshow(shade, origin="lower", extent=within, aspect="auto", zorder=0.2, label="_shade")
    named = set[str]()

    def new(label: str) -> str:
        shown = "_" if label in named else label
        named.add(label)
        return shown

    for curve in found.curves:
        places = _dense(curve, found)
        kinds = _of_pieces(curve.criticality, curve, found, places)
        others = _of_pieces(curve.unstable > 0, curve, found, places)
        differ = (kinds[:-1] != kinds[1:]) | (others[:-1] != others[1:])
        changes = [0, *(np.flatnonzero(differ) + 1), kinds.size]
        for first, last in pairwise(changes):
            look = curve.kind, str(kinds[first])
            beside = BESIDE if others[first] and not look[1] else ""
            label = new(", ".join(word for word in (*look, beside) if word))
            part = places[first : last + 1]
            ax.plot(*part.T, linestyle=DASHES[look[1]], label=label, **LOOKS[look])
    for point in found.points:
        mark = common.open_marker(5.5, marker=MARKERS[point.kind], zorder=4.0)
        ax.plot(point.x, point.y, label=new(point.kind), **mark)
    ax.set(xlim=(left, right), ylim=(low, high))
    if not found.curves:
        where = "stable" if shade[..., 3].any() else "unstable"
        sentence = f"No boundary lies in the window: all is {where}."
        ax.text(0.5, 0.5, sentence, transform=ax.transAxes, ha="center")
    else:
        common.legend_below(ax)
    units.second_axis(ax, "x", shown[0], found.model.pipe)
    units.second_axis(ax, "y", shown[1], found.model.pipe)
    return ax


def _dense(curve: BoundaryCurve, found: Boundary) -> Array:
    """Points of cubics through a curve's points with its directions there, (k, 2)."""
    low, high = np.array(found.ranges).T
    size = high - low
    at = (np.column_stack([curve.x, curve.y]) - low) / size
    t = (np.arange(PER_STEP) / PER_STEP)[:, None, None]
    a, b, s = at[:-1], at[1:], 1.0 - t
    length = np.linalg.norm(b - a, axis=1, keepdims=True)
    slopes = length * curve.slopes[:-1], length * curve.slopes[1:]
    straight = a * s**2 * (1.0 + 2.0 * t) + b * t**2 * (3.0 - 2.0 * t)
    between = straight + s * t * (s * slopes[0] - t * slopes[1])
    shares = np.concatenate([between.transpose(1, 0, 2).reshape(-1, 2), at[-1:]])
    result: Array = low + size * shares
    return result


def _of_pieces(
    values: NDArray[Any], curve: BoundaryCurve, found: Boundary, places: Array
) -> NDArray[Any]:
    """What holds at points of a curve on each piece of `_dense`; it changes at organising points.

    In one step all of them change at the same piece.
    """
    low, high = np.array(found.ranges).T
    marks = np.array([[point.x, point.y] for point in found.points]).reshape(-1, 2)
    middles = 0.5 * (places[:-1] + places[1:])
    pieces = np.repeat(values[:-1], PER_STEP)
    for k in np.flatnonzero(values[:-1] != values[1:]):
        own = slice(PER_STEP * k, PER_STEP * (k + 1))
        away = np.abs((middles[own, None] - marks) / (high - low)).max(axis=2)
        nearest = np.unravel_index(np.argmin(away), away.shape)[0] if len(marks) else PER_STEP // 2
        pieces[own][int(nearest) :] = values[k + 1]
    return pieces


def _stable(found: Boundary) -> NDArray[np.bool_]:
    """Where no root is unstable, rows from the lowest y on, from the curves' counts.

    On the way up through a column each curve says how many roots are unstable beyond it; only where
    none is met, or they disagree, the eigenvalues do.
    """
    (left, right), (low, high) = found.ranges
    middles = (np.arange(COLUMNS) + 0.5) / COLUMNS
    columns, rows = left + (right - left) * middles, low + (high - low) * middles
    stable = np.zeros((COLUMNS, COLUMNS), dtype=np.bool_)
    met: list[list[tuple[float, int, int]]] = [[] for _ in columns]
    for curve in found.curves:
        places = _dense(curve, found)
        others = _of_pieces(curve.unstable, curve, found, places)
        change = _of_pieces(curve.change, curve, found, places)
        sides = others[:, None] + np.maximum(np.stack([change, -change], axis=1), 0)
        for (x, y), (to_x, to_y), (on_left, on_right) in zip(
            places[:-1], places[1:], sides, strict=True
        ):
            first, last = np.searchsorted(columns, sorted((x, to_x)))
            for k in range(first, last):
                height = y + (columns[k] - x) / (to_x - x) * (to_y - y)
                counts = (on_right, on_left) if to_x > x else (on_left, on_right)
                met[k].append((float(height), int(counts[0]), int(counts[1])))
    known: int | None = None
    for k, crossed in enumerate(met):
        crossed.sort()
        if not crossed:
            if known is None:
                known = found.unstable(float(columns[k]), float(rows[COLUMNS // 2]))
            stable[:, k] = known == 0
            continue
        known = None
        if any((a[2] == 0) != (b[1] == 0) for a, b in pairwise(crossed)):
            # So near to where curves cross that their pieces do not tell which is the lower.
            heights = [low, *(height for height, *_ in crossed), high]
            for bottom, top in pairwise(np.clip(heights, low, high).tolist()):
                count = found.unstable(float(columns[k]), 0.5 * (bottom + top))
                stable[(rows > bottom) & (rows < top), k] = count == 0
            continue
        stable[rows < crossed[0][0], k] = crossed[0][1] == 0
        for (height, _, count), (until, *_) in pairwise([*crossed, (math.inf, 0, 0)]):
            stable[(rows > height) & (rows < until), k] = count == 0
    return stable


# --------------------------------------------------------------------- boundaries of several pipes


def stability_map(
    boundaries: Mapping[str, Boundary],
    highest: float | None = None,
    marked: CriticalSpeed | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Where pipes lose or regain stability: boundaries of several, flow speed against mass ratio.

    Args:
        boundaries: by label, with "beta" for x and "u" for y; parts on which other roots are
            unstable are left out.
        highest: end of the axis of speed.
        marked: a critical speed to mark, at its pipe's beta.
        ax: where to draw; new Axes where not given.

    Example:
        >>> window = {"beta": (0.1, 0.9), "u": (0.0, 15.0)}
        >>> found = pp.boundary(pp.Chain(pp.Pipe(0.2), 4), "beta", "u", window, criticality=False)
        >>> ax = plot.stability_map({"chain, n = 4": found})

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    common.check_mapping("boundaries", boundaries, Boundary)
    for label, one in boundaries.items():
        if one.names != ("beta", "u"):
            raise ValueError(f"boundaries[{label!r}] must be over ('beta', 'u'), got {one.names!r}")
    if highest is not None:
        highest = check.real("highest", highest, low=0.0, open_low=True)
    if marked is not None:
        common.check_type("marked", marked, CriticalSpeed)
    ax = common.axes(ax, (6.4, 4.8), xlabel=common.BETA_LABEL, ylabel=common.SPEED_LABEL)
    drawn = False
    for (label, found), look in zip(boundaries.items(), cycle(common.CURVE_STYLES), strict=False):
        lines = [part for curve in found.curves for part in parts_of_stability(curve, found)]
        drawn = drawn or bool(lines)
        if not lines:
            ax.plot([], [], linewidth=1.5, label=f"{label}: no boundary", **look)
        for line, kind in lines:
            ax.plot(*line.T, linewidth=1.5, label=label, **look)
            label = "_" + label.lstrip("_")
            if kind == "divergence":
                middle = line[line.shape[0] // 2]
                centred = {"color": look["color"], "ha": "center", "fontsize": 7.0}
                ax.annotate("divergence", middle, (0, 3), textcoords="offset points", **centred)
    if marked is not None and (highest is None or marked.speed <= highest):
        place = rf"$\beta = {marked.pipe.beta:g}$, $\gamma = {marked.pipe.gamma:g}$"
        ring = common.open_marker(7.0, markerfacecolor="none", markeredgewidth=1.2, zorder=4.0)
        label = f"{place}: $u_c = {marked.speed:.4g}$"
        ax.plot(marked.pipe.beta, marked.speed, clip_on=False, label=label, **ring)
    ax.set_ylim(0.0, highest)
    if not drawn:
        common.notice("There is no stability boundary above $u = 0$.", ax)
    if ax.get_legend_handles_labels()[0]:  # a mark above the highest speed has none
        ax.legend()
    return ax


def parts_of_stability(curve: BoundaryCurve, found: Boundary) -> Iterator[tuple[Array, str]]:
    """Parts of a curve on which no other root is unstable, (k, 2) each, with its kind."""
    places = _dense(curve, found)
    pieces = np.repeat(np.maximum(curve.unstable[:-1], curve.unstable[1:]) == 0, PER_STEP)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], pieces.view(np.int8), [0]])))
    for first, last in edges.reshape(-1, 2):
        yield places[first : last + 1], curve.kind
