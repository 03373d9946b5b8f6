# SPDX-License-Identifier: MIT
"""Motion as curves: displacement over time, and displacement against velocity."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from scipy.interpolate import CubicHermiteSpline

from pipedyn.motion.ensemble import Ensemble
from pipedyn.motion.simulate import Motion
from pipedyn.plot.interpolation import checked_motions, finer, last_cycle, refuse_coarse, tip_of
from pipedyn.plot.style import (
    TIME_LABEL,
    TIP_LABEL,
    TIP_RATE_LABEL,
    axes_or_new,
    cycled_styles,
    motion_title,
    open_marker,
)
from pipedyn.util import check

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
    shown = checked_motions(motions)
    curves = [_signal(motions, i, motion, "tip", False) for i, motion in enumerate(shown)]
    ax = axes_or_new(ax, 6.4, 3.2)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    for (label, look), curve in zip(_looks(shown), curves, strict=True):
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
    shown = checked_motions(motions)
    which: Any = coordinate
    if isinstance(coordinate, str):
        which = check.choice("coordinate", coordinate, ("tip",))
    else:
        least = min(motion.model.coordinates for motion in shown)
        which = check.count("coordinate", coordinate, low=0, high=least - 1)
    curves = [_signal(motions, i, motion, which, True) for i, motion in enumerate(shown)]
    ax = axes_or_new(ax, 4.8, 4.2)
    for (label, look), motion, curve in zip(_looks(shown), shown, curves, strict=True):
        t, cycle = finer(curve.x), last_cycle(motion)
        last = t
        if cycle is not None:
            last = np.linspace(*cycle, 401)
            thin = {"color": look["color"], "linewidth": 0.6, "alpha": 0.5, "zorder": 2.0}
            for part in (t[t <= cycle[0]], t[t >= cycle[1]]):
                ax.plot(curve(part), curve(part, 1), **thin)
        ax.plot(curve(last), curve(last, 1), label=label, linewidth=1.6, **look)
        ax.plot(curve(t[0]), curve(t[0], 1), **open_marker(4.5, look["color"], zorder=3.0))
    if which == "tip":
        ax.set_xlabel(TIP_LABEL)
        ax.set_ylabel(TIP_RATE_LABEL)
    else:
        ax.set_xlabel(f"coordinate $q_{{{which}}}$, counted from 0")
        ax.set_ylabel(rf"its rate $\dot q_{{{which}}}$  $(1/T)$")
    _legend(ax, shown)
    return ax


def _signal(
    given: Any, i: int, motion: Motion, which: Literal["tip"] | int, rates_shown: bool
) -> CubicHermiteSpline:
    """The free end or a coordinate as a function of time; refuses samples too far apart."""
    if which == "tip":
        tip = tip_of(motion)
        t, position, velocity = tip.x, tip(tip.x)[:, 0], tip(tip.x, 1)[:, 0]
    else:
        t, position, velocity = motion.t, motion.q[:, which], motion.qdot[:, which]
    name = "motions" if isinstance(given, Motion) else f"motions[{i}]"
    refuse_coarse(name, t, position, velocity, rates_shown=rates_shown)
    return CubicHermiteSpline(t, position, velocity)


def _looks(motions: Sequence[Motion]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Label and style of each motion: the speed, and the model where speeds are the same."""
    labels = [f"$u = {motion.u:.6g}$" for motion in motions]
    if len(set(labels)) < len(labels):
        sizes = [f"{type(m.model).__name__}, {m.model.dof} d.o.f." for m in motions]
        labels = [f"{label}, {size}" for label, size in zip(labels, sizes, strict=True)]
    if len(set(labels)) < len(labels):
        labels = [f"{i}: {label}" for i, label in enumerate(labels)]
    yield from zip(labels, cycled_styles(len(motions)), strict=True)


def _legend(ax: Axes, motions: Sequence[Motion]) -> None:
    if len(motions) == 1:
        ax.set_title(motion_title(motions[0]))
    elif len(motions) <= MOST_NAMED:
        ax.legend(loc="best")
