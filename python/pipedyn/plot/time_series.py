# SPDX-License-Identifier: MIT
"""Motion as curves: displacement over time, and displacement against velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicHermiteSpline

from pipedyn.motion.simulate import Ensemble, Motion
from pipedyn.plot.interpolation import (
    checked_motions,
    finer,
    last_cycle,
    refuse_coarse,
    tip_of,
    transverse,
)
from pipedyn.plot.style import (
    TIME_LABEL,
    TIP_LABEL,
    TIP_RATE_LABEL,
    axes_or_new,
    checked_coordinate,
    coordinate_label,
    cycled_styles,
    motion_title,
    open_marker,
)

MOST_NAMED = 12
"""Motions beyond which there is no legend: 13 rows would cover most of the axes' height."""


def time_history(motions: Motion | Sequence[Motion] | Ensemble, ax: Axes | None = None) -> Axes:
    """Transverse displacement of the free end over time.

    Args:
        motions: one, several or an ensemble. Between samples, cubics through positions and
            velocities are shown.
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError: for fewer than 3 samples, or samples too far apart to interpolate.
        TypeError: for bad arguments.
    """
    shown = _signals(checked_motions(motions), None, rates_shown=False)
    ax = axes_or_new(ax, 6.4, 3.2)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    for _, curve, label, look in shown:
        t = finer(curve.x)
        ax.plot(t, curve(t), label=label, linewidth=1.0, **look)
    ax.margins(x=0.0)
    ax.set_xlabel(TIME_LABEL)
    ax.set_ylabel(TIP_LABEL)
    _legend(ax, shown)
    return ax


def phase_portrait(
    motions: Motion | Sequence[Motion] | Ensemble,
    coordinate: Literal["tip"] | int = "tip",
    ax: Axes | None = None,
) -> Axes:
    """Displacement against velocity. A ring marks the start; the last cycle is a thicker line.

    Args:
        motions: one, several or an ensemble.
        coordinate: "tip" for the free end's transverse displacement, or the index of a coordinate,
            counted from 0.
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError: for fewer than 3 samples, samples too far apart to interpolate, or an index
            that a model does not have.
        TypeError: for bad arguments.
    """
    named = checked_motions(motions)
    least = min(motion.model.coordinates for motion in named.values())
    index = checked_coordinate(coordinate, least)
    shown = _signals(named, index, rates_shown=True)
    ax = axes_or_new(ax, 4.8, 4.2)
    for motion, curve, label, look in shown:
        t, cycle = finer(curve.x), last_cycle(motion)
        last = t
        if cycle is not None:
            last = np.linspace(*cycle, 401)
            thin = {"color": look["color"], "linewidth": 0.6, "alpha": 0.5, "zorder": 2.0}
            for part in (t[t <= cycle[0]], t[t >= cycle[1]]):
                ax.plot(curve(part), curve(part, 1), **thin)
        ax.plot(curve(last), curve(last, 1), label=label, linewidth=1.6, **look)
        ax.plot(curve(t[0]), curve(t[0], 1), **open_marker(4.5, look["color"], zorder=3.0))
    ax.set_xlabel(coordinate_label(index))
    rate = TIP_RATE_LABEL if index is None else rf"its rate $\dot q_{{{index}}}$  $(1/T)$"
    ax.set_ylabel(rate)
    _legend(ax, shown)
    return ax


Signal = tuple[Motion, CubicHermiteSpline, str, dict[str, Any]]
"""A motion, the free end or a coordinate as a function of time, label and style of the curve."""


def _signals(named: Mapping[str, Motion], index: int | None, rates_shown: bool) -> list[Signal]:
    """What is shown of each motion; refuses samples too far apart.

    A label is the speed, and the model where speeds are the same.
    """
    curves = []
    for name, motion in named.items():
        if index is None:
            curve = transverse(tip_of(motion))
        else:
            curve = CubicHermiteSpline(motion.t, motion.q[:, index], motion.qdot[:, index])
        refuse_coarse(name, curve, rates_shown=rates_shown)
        curves.append(curve)
    motions = list(named.values())
    labels = [f"$u = {motion.u:.6g}$" for motion in motions]
    if len(set(labels)) < len(labels):
        sizes = [f"{type(m.model).__name__}, {m.model.dof} d.o.f." for m in motions]
        labels = [f"{label}, {size}" for label, size in zip(labels, sizes, strict=True)]
    if len(set(labels)) < len(labels):
        labels = [f"{i}: {label}" for i, label in enumerate(labels)]
    return list(zip(motions, curves, labels, cycled_styles(len(motions)), strict=True))


def _legend(ax: Axes, shown: Sequence[Signal]) -> None:
    if len(shown) == 1:
        ax.set_title(motion_title(shown[0][0]))
    elif len(shown) <= MOST_NAMED:
        ax.legend(loc="best")
