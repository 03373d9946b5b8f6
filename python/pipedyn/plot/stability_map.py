# SPDX-License-Identifier: MIT
"""Stability maps: boundaries over a parameter, joined round the tips of their folds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes

from pipedyn import _core
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

    Crossings at neighbouring parameters are joined, and those of one parameter round the tip of a
    fold, by cubics whose slopes come from the sensitivities by beta.

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


def _boundary_lines(curve: StabilityCurve) -> list[tuple[Array, str]]:
    """Stability boundaries as polylines (parameter, speed), each of shape (k, 2), and kinds.

    A boundary has the stable side on its right: it runs to larger parameters through crossings that
    destabilise, to smaller ones through the others. Between two neighbouring parameters each
    crossing from which one sets out is joined with one at which one arrives, at the tip of a fold
    of the same parameter, so that all these steps together are short and turn little.
    """
    failed = {failure.index for failure in curve.failures}
    taken = [i for i in np.argsort(curve.values) if i not in failed]
    points = [(k, c) for k, i in enumerate(taken) for c in boundaries(curve.crossings[i])]
    scale = max((c.speed for _, c in points), default=0.0) or 1.0  # to 1, which beta spans
    column = np.array([k for k, _ in points], dtype=np.intp)
    # Places and directions in this plane are complex numbers.
    at = curve.values[taken][column] + 1j / scale * np.array([c.speed for _, c in points])
    rightwards = np.array([c.destabilising for _, c in points], dtype=np.bool_)
    kinds = np.array([c.kind for _, c in points])
    # Where no slope is known the tangent is 0, with which a cubic is a straight line.
    known = [None if c.sensitivity is None else c.sensitivity.speed.beta for _, c in points]
    angles = np.arctan(np.array(known, dtype=np.float64) / scale)
    tangents = np.where(rightwards, 1.0, -1.0) * np.nan_to_num(np.exp(1j * angles))
    following: dict[int, int] = {}
    for k in range(len(taken) - 1):
        origins = np.flatnonzero(column == np.where(rightwards, k, k + 1))
        targets = np.flatnonzero(column == np.where(rightwards, k + 1, k))
        steps = at[targets] - at[origins, None]
        ahead = (steps * (tangents[targets] + tangents[origins, None]).conj()).real
        possible = (kinds[targets] == kinds[origins, None]) & (ahead >= 0.0)
        # A step counts once if it goes straight on, three times if it turns by 90 degrees twice;
        # what is impossible costs more than all others.
        cost = np.where(possible, 3.0 * np.abs(steps) - ahead, 1e3)
        pairs = enumerate(_core.assignment(cost))
        following |= {
            int(origins[i]): int(targets[j]) for i, j in pairs if j >= 0 and possible[i, j]
        }
    t = np.arange(1.0, 17.0) / 16.0  # along a cubic
    s = 1.0 - t
    lines: list[tuple[Array, str]] = []
    ends = set(range(at.size)) - set(following.values())
    for first in (*ends, *(following.keys() - ends)):  # closed ones have no end: they come last
        here, line = first, [at[[first]]]
        while here in following:
            there = following.pop(here)
            straight = at[here] * s**2 * (1.0 + 2.0 * t) + at[there] * t**2 * (3.0 - 2.0 * t)
            slopes = np.abs(at[there] - at[here]) * tangents[[here, there]]
            line.append(straight + s * t * (s * slopes[0] - t * slopes[1]))
            here = there
        if first in ends or len(line) > 1:
            places = np.concatenate(line)
            polyline = np.column_stack([places.real, scale * places.imag])
            lines.append((polyline, points[first][1].kind))
    return lines
