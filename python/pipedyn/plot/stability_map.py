# SPDX-License-Identifier: MIT
"""Stability maps: boundaries over a parameter, joined round the tips of their folds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import cycle, pairwise, product

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import BPoly, CubicHermiteSpline
from scipy.optimize import linear_sum_assignment

from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.linear.sensitivity import Crossing
from pipedyn.linear.stability_curve import StabilityCurve
from pipedyn.plot import common
from pipedyn.util import check
from pipedyn.util.check import Array


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
    common.check_mapping("curves", curves, StabilityCurve)
    if highest is not None:
        highest = check.real("highest", highest, low=0.0, open_low=True)
    if marked is not None:
        common.check_type("marked", marked, CriticalSpeed)
    ax = common.axes(ax, (6.4, 4.8), xlabel=common.BETA_LABEL, ylabel=common.SPEED_LABEL)
    largest = 0.0
    for (label, curve), look in zip(curves.items(), cycle(common.CURVE_STYLES), strict=False):
        lines = _boundary_lines(curve)
        largest = max([largest, *(float(line[:, 1].max()) for line, _ in lines)])
        if not lines:
            ax.plot([], [], linewidth=1.5, label=f"{label}: no boundary", **look)
        for line, kind in lines:
            ax.plot(line[:, 0], line[:, 1], linewidth=1.5, label=label, **look)
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
    if largest == 0.0:
        common.notice("There is no stability boundary above $u = 0$.", ax)
    if ax.get_legend_handles_labels()[0]:  # a mark above the highest speed has none
        ax.legend()
    return ax


def boundaries(found: Iterable[Crossing]) -> list[Crossing]:
    """The crossings at which the pipe loses its stability or regains it.

    At the others it is unstable before and after.
    """
    if not np.iterable(found):
        raise TypeError(f"found must be crossings in a sequence, got {check.shown(found)}")
    crossings = list(found)
    for i, crossing in enumerate(crossings):
        common.check_type(f"found[{i}]", crossing, Crossing)
    return [c for c in crossings if min(c.unstable_before, c.unstable_after) == 0]


@dataclass(eq=False)
class _Point:
    """A crossing at (parameter, speed), and what continues its boundary left (-1) and right (1).

    That is another point, the side of it, and the curve from here to there, shape (k, 2).
    """

    at: Array
    crossing: Crossing
    joined: dict[int, tuple[_Point, int, Array]] = field(default_factory=dict)

    def join(self, side: int, other: _Point, other_side: int, curve: Array) -> None:
        """Continue the boundary to another point."""
        self.joined[side] = other, other_side, curve
        other.joined[other_side] = self, side, curve[::-1]

    @property
    def slopes(self) -> tuple[float, float]:
        """d(speed)/dbeta and d(frequency)/dbeta; 0 where there is no sensitivity."""
        known = self.crossing.sensitivity
        if known is None or known.speed.beta is None or known.frequency.beta is None:
            return 0.0, 0.0
        return known.speed.beta, known.frequency.beta


def _boundary_lines(curve: StabilityCurve) -> list[tuple[Array, str]]:
    """Stability boundaries as polylines (parameter, speed), each of shape (k, 2), and kinds."""
    failed = {failure.index for failure in curve.failures}
    taken = [i for i in np.argsort(curve.values) if i not in failed]
    columns = [
        [_Point(np.array([curve.values[i], c.speed]), c) for c in boundaries(curve.crossings[i])]
        for i in taken
    ]
    points = [point for column in columns for point in column]
    scale = max((point.crossing.speed for point in points), default=0.0) or 1.0
    for (left, right), step in zip(pairwise(columns), np.diff(curve.values[taken]), strict=True):
        for a, b in _pairs(left, right, step, scale):
            a.join(1, b, -1, _arc(a, b, scale))
        for column, side in ((left, 1), (right, -1)):
            _join_folds([point for point in column if side not in point.joined], side, step)
    lines: list[tuple[Array, str]] = []
    seen = set()
    open_first = sorted(product(points, (-1, 1)), key=lambda start: start[1] in start[0].joined)
    for first, side in open_first:
        if first in seen:
            continue
        point, line = first, [first.at[None]]
        while point not in seen and -side in point.joined:
            seen.add(point)
            point, side, arc = point.joined[-side]
            line.append(arc[1:])
        seen.add(point)
        lines.append((np.concatenate(line), first.crossing.kind))
    return lines


def _pairs(
    left: list[_Point], right: list[_Point], step: float, scale: float
) -> list[tuple[_Point, _Point]]:
    """Which crossing of the right column continues which of the left, at the least total distance.

    The distance of two is that of their speeds, in the highest speed, and a fifth of that of their
    frequencies, relative. Values as they are, or extrapolated along the slopes: the smaller counts.
    Direction along a branch changes only at the tip of a fold.
    """
    cost = np.full((len(left), len(right)), math.inf)
    for (j, p), (k, q) in product(enumerate(left), enumerate(right)):
        a, b = p.crossing, q.crossing
        if a.kind != b.kind or a.destabilising != b.destabilising:
            continue
        weight = 0.2 / (1.0 + max(a.frequency, b.frequency))
        plain = abs(a.speed - b.speed) / scale + weight * abs(a.frequency - b.frequency)
        (ua, wa), (ub, wb) = p.slopes, q.slopes
        speeds = a.speed - b.speed + 0.5 * step * (ua + ub)
        frequencies = a.frequency - b.frequency + 0.5 * step * (wa + wb)
        cost[j, k] = min(plain, abs(speeds) / scale + weight * abs(frequencies))
    # A distance is at most 1.2, so the least sum holds no 1000 that it can avoid.
    assigned = zip(*linear_sum_assignment(np.minimum(cost, 1e3)), strict=True)
    # Neighbours were at most 0.062 apart on eight maps, ejecting, gravity -10 to 100, with and
    # without damping.
    return [(left[j], right[k]) for j, k in assigned if cost[j, k] < 0.15]


def _arc(a: _Point, b: _Point, scale: float) -> Array:
    """Hermite cubic by arc length between two crossings, shape (k, 2); beta spans 1."""
    ends = np.array([a.at, b.at])
    if a.crossing.sensitivity is None or b.crossing.sensitivity is None:
        return ends
    tangents = np.array([[1.0, a.slopes[0]], [1.0, b.slopes[0]]])
    stretch = np.array([scale, 1.0])
    length = np.linalg.norm((b.at - a.at) * stretch)
    tangents *= length / np.linalg.norm(tangents * stretch, axis=1, keepdims=True)
    return np.asarray(CubicHermiteSpline([0.0, 1.0], ends, tangents)(np.linspace(0.0, 1.0, 9)))


def _join_folds(single: list[_Point], side: int, step: float) -> None:
    """Join neighbours of a column that end together before the next column on a side."""
    order = sorted(single, key=lambda point: point.crossing.speed)
    while len(order) > 1:
        nearest = int(np.argmin(np.diff([point.crossing.speed for point in order])))
        p, q = order.pop(nearest), order.pop(nearest)
        a, b, (slope_a, _), (slope_b, _) = p.crossing, q.crossing, p.slopes, q.slopes
        if a.kind != b.kind or a.destabilising == b.destabilising or slope_a == slope_b:
            continue
        # A parabola's tangents meet twice as far off as its vertex.
        reach = (b.speed - a.speed) / (slope_a - slope_b)
        if reach * side <= 0.0:
            continue
        reach = math.copysign(min(abs(reach), 2.0 * step), side)
        corner = 0.5 * (a.speed + b.speed + reach * (slope_a + slope_b))
        control = np.array([p.at[0] + reach, min(max(corner, a.speed), b.speed)])
        parabola = BPoly(np.array([p.at, control, q.at])[:, None], [0.0, 1.0])
        p.join(side, q, side, parabola(np.linspace(0.0, 1.0, 17)))
