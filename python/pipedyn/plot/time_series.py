# SPDX-License-Identifier: MIT
"""Motion as curves: displacement over time, and displacement against velocity."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicHermiteSpline, PPoly

from pipedyn.motion.simulate import Ensemble, Motion
from pipedyn.plot import common
from pipedyn.plot.interpolation import (
    checked_motions,
    finer,
    first_component,
    last_cycle,
    refuse_coarse,
    tip_of,
)


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
    ax = common.axes(ax, (6.4, 3.2), xlabel=common.TIME_LABEL, ylabel=common.TIP_LABEL)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    for _, curve, label, look in shown:
        t = finer(curve.x)
        ax.plot(t, curve(t), label=label, linewidth=1.0, **look)
    ax.margins(x=0.0)
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
    index, xlabel = common.coordinate_axis(coordinate, least)
    shown = _signals(named, index, rates_shown=True)
    rate = common.TIP_RATE_LABEL if index is None else rf"its rate $\dot q_{{{index}}}$  $(1/T)$"
    ax = common.axes(ax, (4.8, 4.2), xlabel=xlabel, ylabel=rate)
    for motion, curve, label, look in shown:
        last = t = finer(curve.x)
        if (ends := last_cycle(motion)) is not None:
            last = np.linspace(*ends, 401)
            thin = {"color": look["color"], "linewidth": 0.6, "alpha": 0.5, "zorder": 2.0}
            for part in (t[t <= ends[0]], t[t >= ends[1]]):
                ax.plot(curve(part), curve(part, 1), **thin)
        ax.plot(curve(last), curve(last, 1), label=label, linewidth=1.6, **look)
        ax.plot(curve(t[0]), curve(t[0], 1), **common.open_marker(4.5, look["color"], zorder=3.0))
    _legend(ax, shown)
    return ax


Signal = tuple[Motion, PPoly, str, dict[str, Any]]
"""A motion, the free end or a coordinate as a function of time, label and style of the curve."""


def _signals(named: dict[str, Motion], index: int | None, rates_shown: bool) -> list[Signal]:
    """What is shown of each motion; refuses samples too far apart.

    A label is the speed, and the model where speeds are the same.
    """
    curves = []
    for name, motion in named.items():
        if index is None:
            curve = first_component(tip_of(motion))
        else:
            curve = CubicHermiteSpline(motion.t, motion.q[:, index], motion.qdot[:, index])
        refuse_coarse(name, curve, rates_shown=rates_shown)
        curves.append(curve)
    motions = list(named.values())
    labels = [f"$u = {motion.u:.6g}$" for motion in motions]
    if len(set(labels)) < len(labels):
        models = [motion.model for motion in motions]
        labels = [
            f"{i}: {label}, {type(model).__name__}, {model.dof} d.o.f."
            for i, (label, model) in enumerate(zip(labels, models, strict=True))
        ]
    return list(zip(motions, curves, labels, cycle(common.CURVE_STYLES), strict=False))


def _legend(ax: Axes, shown: Sequence[Signal]) -> None:
    """Names of several curves; of more than 12 a legend would cover most of the axes' height."""
    if len(shown) == 1:
        ax.set_title(common.motion_title(shown[0][0]))
    elif len(shown) <= 12:
        ax.legend()
