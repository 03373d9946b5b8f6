# SPDX-License-Identifier: MIT
"""Stability maps: boundaries over a parameter, joined round the tips of their folds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise, product

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import linear_sum_assignment

from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.linear.sensitivity import Crossing
from pipedyn.linear.stability_curve import StabilityCurve
from pipedyn.plot.style import (
    BETA_LABEL,
    SPEED_LABEL,
    axes_or_new,
    check_mapping,
    check_type,
    cycled_styles,
    note,
    notice,
    open_marker,
)
from pipedyn.util import check
from pipedyn.util.check import Array

FARTHEST = 0.15
"""Crossings at a larger distance, as `_pairs` measures it, are not joined. Neighbours on a boundary
were at most 0.062 apart on eight maps, ejecting, gravity -10 to 100, with and without damping."""

FORBIDDEN = 1e3
"""Distance of two that do not fit: a sum of distances, each at most 1.2, always avoids it."""


def stability_map(
    curves: Mapping[str, StabilityCurve],
    highest: float | None = None,
    marked: CriticalSpeed | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Stability boundaries: flow speed against a parameter, folds included.

    Crossings at neighbouring parameters are joined if their frequency and direction agree. Two
    crossings that vanish together are joined by a parabola round the tip of their fold. Its slopes
    come from the sensitivities by beta.

    Args:
        curves: stability curves by label, made over beta with a `max_speed`, so that they hold
            every crossing.
        highest: end of the axis of speed.
        marked: a critical speed to mark, at its pipe's beta.
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check_mapping("curves", curves, StabilityCurve)
    if highest is not None:
        highest = check.real("highest", highest, low=0.0, open_low=True)
    if marked is not None:
        check_type("marked", marked, CriticalSpeed)
    ax = axes_or_new(ax, 6.4, 4.8)
    largest = 0.0
    for (label, curve), look in zip(curves.items(), cycled_styles(len(curves)), strict=True):
        lines = _boundary_lines(curve)
        largest = max([largest, *(float(line[:, 1].max()) for line, _ in lines)])
        if not lines:
            ax.plot([], [], linewidth=1.5, label=f"{label}: none here", **look)
        for line, kind in lines:
            ax.plot(line[:, 0], line[:, 1], linewidth=1.5, label=label, **look)
            label = "_" + label.lstrip("_")
            if kind == "divergence":
                middle = line[line.shape[0] // 2]
                centred = {"color": look["color"], "ha": "center", "fontsize": 7.0}
                note(ax, "divergence", middle, (0, 3), **centred)
    if marked is not None and (highest is None or marked.speed <= highest):
        place = rf"$\beta = {marked.pipe.beta:g}$, $\gamma = {marked.pipe.gamma:g}$"
        ring = open_marker(7.0, markerfacecolor="none", markeredgewidth=1.2, zorder=4.0)
        label = f"{place}: $u_c = {marked.speed:.4g}$"
        ax.plot(marked.pipe.beta, marked.speed, clip_on=False, label=label, **ring)
    ax.set_ylim(0.0, highest)
    if largest == 0.0:
        notice("There is no stability boundary above $u = 0$.", ax)
    ax.set_xlabel(BETA_LABEL)
    ax.set_ylabel(SPEED_LABEL)
    if ax.get_legend_handles_labels()[0]:  # a mark above the highest speed has none
        ax.legend(loc="best")
    return ax


def boundaries(found: Iterable[Crossing]) -> list[Crossing]:
    """The crossings at which the pipe loses its stability or regains it.

    At the others it is unstable before and after.
    """
    if not np.iterable(found):
        raise TypeError(f"found must be crossings in a sequence, got {check.shown(found)}")
    crossings = list(found)
    for i, crossing in enumerate(crossings):
        check_type(f"found[{i}]", crossing, Crossing)
    return [c for c in crossings if min(c.unstable_before, c.unstable_after) == 0]


Node = tuple[int, int]
"""A crossing: the index of its column, and its own in the column."""

End = tuple[Node, int]
"""A side of a crossing: -1 is left, 1 is right."""


def _boundary_lines(curve: StabilityCurve) -> list[tuple[Array, str]]:
    """Stability boundaries as polylines (parameter, speed), each of shape (k, 2), and kinds."""
    failed = {failure.index for failure in curve.failures}
    taken = [i for i in np.argsort(curve.values) if i not in failed]
    values = curve.values[taken]
    columns = [boundaries(curve.crossings[i]) for i in taken]
    scale = max([c.speed for column in columns for c in column], default=0.0) or 1.0
    edges: dict[End, tuple[End, Array]] = {}

    def join(a: End, b: End, points: Array) -> None:
        edges[a], edges[b] = (b, points), (a, points[::-1])

    for i, (left, right) in enumerate(pairwise(columns)):
        step = float(values[i + 1] - values[i])
        pairs = _pairs(left, right, step, scale)
        for j, k in pairs:
            arc = _hermite_arc((values[i], left[j]), (values[i + 1], right[k]), scale)
            join(((i, j), 1), ((i + 1, k), -1), arc)
        joined = [set(side) for side in zip(*pairs, strict=True)] or [set(), set()]
        for k, column, towards in ((i, left, 1), (i + 1, right, -1)):
            single = [j for j in range(len(column)) if j not in joined[k - i]]
            for a, b, points in _fold_tips(values[k], column, single, towards * step):
                join(((k, a), towards), ((k, b), towards), points)
    nodes = {(i, j): c for i, column in enumerate(columns) for j, c in enumerate(column)}
    places = {node: np.array([values[node[0]], c.speed]) for node, c in nodes.items()}
    return [(points, nodes[first].kind) for first, points in _traced(places, edges)]


def _traced(
    nodes: dict[Node, Array], edges: dict[End, tuple[End, Array]]
) -> list[tuple[Node, Array]]:
    """Polylines along the edges with the node that each starts from, open ones first."""
    unseen = set(nodes)
    ends: list[End] = [*product(nodes, (-1, 1))]
    lines = []
    for first, side in sorted(ends, key=lambda end: end in edges):
        if first not in unseen:
            continue
        node, line = first, [nodes[first][None]]
        unseen.discard(node)
        while (node, -side) in edges:
            (node, side), points = edges[node, -side]
            line.append(points[1:])
            if node not in unseen:
                break
            unseen.discard(node)
        lines.append((first, np.concatenate(line)))
    return lines


def _pairs(
    left: list[Crossing], right: list[Crossing], step: float, scale: float
) -> list[tuple[int, int]]:
    """Which crossing of the right column continues which of the left, at the least total distance.

    The distance of two is that of their speeds, in the highest speed, and a fifth of that of their
    frequencies, relative. Values as they are, or extrapolated along the slopes: the smaller counts.
    Direction along a branch changes only at the tip of a fold.
    """
    cost = np.full((len(left), len(right)), math.inf)
    for (j, a), (k, b) in product(enumerate(left), enumerate(right)):
        if a.kind != b.kind or a.destabilising != b.destabilising:
            continue
        weight = 0.2 / (1.0 + max(a.frequency, b.frequency))
        plain = abs(a.speed - b.speed) / scale + weight * abs(a.frequency - b.frequency)
        (ua, wa), (ub, wb) = _slopes(a), _slopes(b)
        speeds = a.speed - b.speed + 0.5 * step * (ua + ub)
        frequencies = a.frequency - b.frequency + 0.5 * step * (wa + wb)
        cost[j, k] = min(plain, abs(speeds) / scale + weight * abs(frequencies))
    assigned = zip(*linear_sum_assignment(np.minimum(cost, FORBIDDEN)), strict=True)
    return [(int(j), int(k)) for j, k in assigned if cost[j, k] < FARTHEST]


def _slopes(crossing: Crossing) -> tuple[float, float]:
    """d(speed)/dbeta and d(frequency)/dbeta; 0 where there is no sensitivity."""
    known = crossing.sensitivity
    if known is None or known.speed.beta is None or known.frequency.beta is None:
        return 0.0, 0.0
    return known.speed.beta, known.frequency.beta


def _hermite_arc(a: tuple[float, Crossing], b: tuple[float, Crossing], scale: float) -> Array:
    """Hermite cubic by arc length between two crossings, shape (k, 2)."""
    ends = np.array([[x, crossing.speed] for x, crossing in (a, b)])
    if any(crossing.sensitivity is None for _, crossing in (a, b)):
        return ends
    stretch = np.array([scale, 1.0])  # beta spans 1
    tangents = np.array([[1.0, _slopes(crossing)[0]] for _, crossing in (a, b)]) * stretch
    tangents *= (
        np.linalg.norm(np.diff(ends * stretch, axis=0)) / np.linalg.norm(tangents, axis=1)[:, None]
    )
    arc = CubicHermiteSpline([0.0, 1.0], ends * stretch, tangents)
    return np.asarray(arc(np.linspace(0.0, 1.0, 9)) / stretch)


def _fold_tips(
    value: float, column: list[Crossing], single: list[int], step: float
) -> list[tuple[int, int, Array]]:
    """Neighbouring crossings that end together before the next column, and the curve round both."""
    found = []
    order = sorted(single, key=lambda j: column[j].speed)
    while len(order) > 1:
        nearest = min(pairwise(order), key=lambda jk: column[jk[1]].speed - column[jk[0]].speed)
        a, b = (column[j] for j in nearest)
        order = [j for j in order if j not in nearest]
        (slope_a, _), (slope_b, _) = _slopes(a), _slopes(b)
        if a.kind != b.kind or a.destabilising == b.destabilising or slope_a == slope_b:
            continue
        # A parabola's tangents meet twice as far off as its vertex.
        reach = (b.speed - a.speed) / (slope_a - slope_b)
        if reach * step <= 0.0:
            continue
        reach = math.copysign(min(abs(reach), 2.0 * abs(step)), step)
        corner = 0.5 * (a.speed + b.speed + reach * (slope_a + slope_b))
        control = np.array([value + reach, min(max(corner, a.speed), b.speed)])
        t = np.linspace(0.0, 1.0, 17)[:, None]
        p, q = np.array([value, a.speed]), np.array([value, b.speed])
        points = p * (1 - t) ** 2 + 2.0 * control * t * (1 - t) + q * t * t
        found.append((*nearest, points))
    return found
