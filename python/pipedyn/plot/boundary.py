# SPDX-License-Identifier: MIT
"""Maps of stability: boundaries over a parameter, joined round their folds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise, product
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from scipy.optimize import linear_sum_assignment

from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.linear.sensitivity import Crossing
from pipedyn.linear.stability_curve import StabilityCurve
from pipedyn.plot.style import (
    BETA_LABEL,
    SPEED_LABEL,
    check_axes,
    check_mapping,
    check_type,
    cycled_styles,
    notice,
)
from pipedyn.util import check
from pipedyn.util.check import Array


def stability_map(
    ax: Axes,
    curves: Mapping[str, StabilityCurve],
    highest: float | None = None,
    marked: CriticalSpeed | None = None,
) -> Axes:
    """Boundaries of stability: flow speed against a parameter, folds included.

    Passages at neighbouring parameters are joined where frequency and sense of passage agree, and
    the ends of two that vanish together are joined round the nose of the fold, a parabola through
    both with the slopes that their sensitivities by beta tell.

    Args:
        ax: where to draw.
        curves: stability curves by label, made over beta with a `max_speed`, so that they hold
            every passage.
        highest: end of the axis of speed.
        marked: a critical speed to mark, at its pipe's beta.
    """
    check_axes(ax)
    check_mapping("curves", curves)
    for label, curve in curves.items():
        check_type(f"curves[{label!r}]", curve, StabilityCurve)
    if highest is not None:
        highest = check.real("highest", highest, low=0.0, open_low=True)
    if marked is not None:
        check_type("marked", marked, CriticalSpeed)
    tallest = 0.0
    for (label, curve), look in zip(curves.items(), cycled_styles(len(curves)), strict=True):
        strands = _strands(curve)
        tallest = max([tallest, *(float(strand[:, 1].max()) for strand, _ in strands)])
        if not strands:
            ax.plot([], [], linewidth=1.5, label=f"{label}: none here", **look)
        for strand, kind in strands:
            ax.plot(strand[:, 0], strand[:, 1], linewidth=1.5, label=label, **look)
            label = "_" + label.lstrip("_")
            if kind == "divergence":
                ax.annotate(
                    "divergence",
                    strand[strand.shape[0] // 2],
                    xytext=(0, 3),
                    textcoords="offset points",
                    color=look["color"],
                    ha="center",
                    fontsize=7.0,
                )
    if marked is not None and (highest is None or marked.speed <= highest):
        place = rf"$\beta = {marked.pipe.beta:g}$, $\gamma = {marked.pipe.gamma:g}$"
        ax.plot(
            marked.pipe.beta,
            marked.speed,
            linestyle="none",
            marker="o",
            markersize=7.0,
            markerfacecolor="none",
            markeredgecolor="black",
            markeredgewidth=1.2,
            clip_on=False,
            zorder=4.0,
            label=f"{place}: $u_c = {marked.speed:.4g}$",
        )
    ax.set_ylim(0.0, highest)
    if tallest == 0.0:
        notice(ax, "There is no boundary of stability above $u = 0$.")
    ax.set_xlabel(BETA_LABEL)
    ax.set_ylabel(SPEED_LABEL)
    if ax.get_legend_handles_labels()[0]:  # a mark above the highest speed has none
        ax.legend(loc="best")
    return ax


def boundaries(found: Iterable[Crossing]) -> list[Crossing]:
    """Passages at which the pipe gains or loses stability altogether."""
    if not np.iterable(found):
        raise TypeError(f"found must be passages in a sequence, got {check.shown(found)}")
    passages = list(found)
    for i, passage in enumerate(passages):
        check_type(f"found[{i}]", passage, Crossing)
    return [c for c in passages if min(c.unstable_before, c.unstable_after) == 0]


Node = tuple[int, int]
End = tuple[Node, Literal["left", "right"]]


def _strands(curve: StabilityCurve) -> list[tuple[Array, str]]:
    """Boundaries of stability as polylines (parameter, speed), each of shape (k, 2), and kinds."""
    failed = {failure.index for failure in curve.failures}
    taken = [i for i in np.argsort(curve.values) if i not in failed]
    values = curve.values[taken]
    columns = [boundaries(curve.crossings[i]) for i in taken]
    tall = max([c.speed for column in columns for c in column], default=0.0) or 1.0
    edges: dict[End, tuple[End, Array]] = {}

    def join(a: End, b: End, points: Array) -> None:
        edges[a], edges[b] = (b, points), (a, points[::-1])

    for i, (left, right) in enumerate(pairwise(columns)):
        step = float(values[i + 1] - values[i])
        matched = _matched(left, right, step, tall)
        for j, k in matched:
            bow = _bow((values[i], left[j]), (values[i + 1], right[k]), tall)
            join(((i, j), "right"), ((i + 1, k), "left"), bow)
        loose = [j for j in range(len(left)) if j not in {j for j, _ in matched}]
        for j, k, points in _noses(values[i], left, loose, step):
            join(((i, j), "right"), ((i, k), "right"), points)
        loose = [k for k in range(len(right)) if k not in {k for _, k in matched}]
        for j, k, points in _noses(values[i + 1], right, loose, -step):
            join(((i + 1, j), "left"), ((i + 1, k), "left"), points)
    nodes = {(i, j): c for i, column in enumerate(columns) for j, c in enumerate(column)}
    places = {node: np.array([values[node[0]], c.speed]) for node, c in nodes.items()}
    return [(points, nodes[first].kind) for first, points in _walked(places, edges)]


def _walked(
    nodes: dict[Node, Array], edges: dict[End, tuple[End, Array]]
) -> list[tuple[Node, Array]]:
    """Chains of edges with the node that each starts from, open ones first."""
    unseen = set(nodes)
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    ends: list[End] = [*product(nodes, sides)]
    strands = []
    for node, side in sorted(ends, key=lambda end: end in edges):
        if node not in unseen:
            continue
        first, strand = node, [nodes[node][None]]
        unseen.discard(node)
        end: End = (node, _other(side))
        while end in edges:
            (node, side), points = edges[end]
            strand.append(points[1:])
            if node not in unseen:
                break
            unseen.discard(node)
            end = (node, _other(side))
        strands.append((first, np.concatenate(strand)))
    return strands


def _other(side: Literal["left", "right"]) -> Literal["left", "right"]:
    return "left" if side == "right" else "right"


FARTHEST = 0.15
"""Passages that disagree by more, as a part of the highest speed, do not continue one another."""


def _matched(
    left: list[Crossing], right: list[Crossing], step: float, tall: float
) -> list[tuple[int, int]]:
    """Which passage of the right column continues which of the left; tall: the highest speed.

    Along a branch the sense of passage changes at the nose of a fold only.
    """
    cost = np.full((len(left), len(right)), 1e3)
    for (j, a), (k, b) in product(enumerate(left), enumerate(right)):
        if a.kind != b.kind or a.destabilising != b.destabilising:
            continue
        scale = 0.2 / (1.0 + max(a.frequency, b.frequency))
        plain = abs(a.speed - b.speed) / tall + scale * abs(a.frequency - b.frequency)
        (ua, wa), (ub, wb) = _slopes(a), _slopes(b)
        speeds = a.speed - b.speed + 0.5 * step * (ua + ub)
        tuned = a.frequency - b.frequency + 0.5 * step * (wa + wb)
        cost[j, k] = min(plain, abs(speeds) / tall + scale * abs(tuned))
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(j), int(k)) for j, k in pairs if cost[j, k] < FARTHEST]


def _slopes(crossing: Crossing) -> tuple[float, float]:
    """d(speed)/dbeta and d(frequency)/dbeta; 0 where there is no sensitivity."""
    known = crossing.sensitivity
    if known is None or known.speed.beta is None or known.frequency.beta is None:
        return 0.0, 0.0
    return known.speed.beta, known.frequency.beta


def _bow(a: tuple[float, Crossing], b: tuple[float, Crossing], tall: float) -> Array:
    """Hermite cubic by arc length between two passages, shape (k, 2)."""
    ends = np.array([[x, crossing.speed] for x, crossing in (a, b)])
    stretch = np.array([tall, 1.0])  # beta spans 1
    p, q = ends * stretch
    chord = q - p
    if any(crossing.sensitivity is None for _, crossing in (a, b)):
        return ends
    tangents = [np.array([1.0, _slopes(crossing)[0]]) * stretch for _, crossing in (a, b)]
    d, e = (t / np.linalg.norm(t) * np.linalg.norm(chord) for t in tangents)
    t = np.linspace(0.0, 1.0, 9)[:, None]
    points = p + chord * t * t * (3 - 2 * t) + d * t * (1 - t) ** 2 - e * t * t * (1 - t)
    return np.asarray(points / stretch)


def _noses(
    value: float, column: list[Crossing], loose: list[int], step: float
) -> list[tuple[int, int, Array]]:
    """Neighbouring passages that end together before the next column, and the way round."""
    found = []
    order = sorted(loose, key=lambda j: column[j].speed)
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
