# SPDX-License-Identifier: MIT
"""Pictures beyond onset: the bifurcation diagram, limit cycles, their Floquet multipliers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from pipedyn.bifurcation.branches import CycleBranch
from pipedyn.bifurcation.cycles import LimitCycle
from pipedyn.bifurcation.diagram import BifurcationDiagram
from pipedyn.bifurcation.equilibrium_branch import BranchPoint, EquilibriumBranch
from pipedyn.bifurcation.events import CycleEvent, nontrivial
from pipedyn.plot.interpolation import finer
from pipedyn.plot.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_LABEL,
    TIP_LABEL,
    TIP_RATE_LABEL,
    VERMILION,
    axes_or_new,
    check_type,
    checked_coordinate,
    coordinate_label,
    cycled_styles,
    open_marker,
)
from pipedyn.util import check
from pipedyn.util.check import Array

MARKS: dict[str, dict[str, Any]] = {
    "fold": {"marker": "<", "color": VERMILION},
    "pitchfork": {"marker": "s", "color": GREEN},
    "branch point": {"marker": "D", "color": GREEN},
    "hopf": {"marker": "o", "color": ORANGE},
    "period doubling": {"marker": "^", "color": PURPLE},
    "torus": {"marker": "h", "color": PURPLE},
    "infinite period": {"marker": "X", "color": VERMILION},
    "end": {"marker": "|", "color": BLUE},
}
"""Look of each bifurcation."""

STABLE: dict[str, Any] = {"linestyle": "-", "linewidth": 1.4}
UNSTABLE: dict[str, Any] = {"linestyle": (0, (4, 2)), "linewidth": 1.0}

OUTSIDE = 1e-6
"""A modulus is outside the unit circle if it exceeds 1 by more: the default error of a cycle."""


def bifurcation_diagram(
    diagram: BifurcationDiagram,
    coordinate: Literal["tip"] | int = "tip",
    ax: Axes | None = None,
) -> Axes:
    """Transverse position of the free end against flow speed.

    Equilibria are black. Cycles are blue: their highest and lowest positions, and those of their
    mirror images. Stable branches are solid, unstable ones dashed. Grey dots are the turning
    points of motions from many initial states; each marker is a bifurcation.

    Args:
        diagram: the diagram to show.
        coordinate: "tip", or the index of a coordinate, counted from 0. With an index only
            equilibria are shown; use it where the free end is held.
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check_type("diagram", diagram, BifurcationDiagram)
    index = checked_coordinate(coordinate, diagram.model.coordinates)
    ax = axes_or_new(ax, 6.4, 4.2)
    used: dict[str, Line2D] = {}

    if diagram.motions and index is None:
        turns = [(one.speed, one.turnings) for one in diagram.motions if one.turnings.size]
        x = np.concatenate([np.full(values.size, u) for u, values in turns] or [np.zeros(0)])
        y = np.concatenate([values for _, values in turns] or [np.zeros(0)])
        dots: dict[str, Any] = {"marker": ".", "linestyle": "none", "color": "0.55"}
        small: dict[str, Any] = {
            "markersize": 2.6,
            "markeredgewidth": 0.0,
            "zorder": 1.0,
            "gid": "motions",
        }
        ax.plot(x, y, rasterized=x.size > 20_000, **dots, **small)  # keeps vector files small
        used["turning points of late motion"] = Line2D([], [], markersize=4.0, **dots)
    for branch in diagram.equilibria:
        heights = branch.tips[:, 0] if index is None else branch.q[:, index]
        _line(ax, branch, heights, branch.points, BLACK, "equilibrium", used)
    for cycles in diagram.cycles if index is None else ():
        for heights in _extremes(cycles):
            _line(ax, cycles, heights, cycles.events, BLUE, "cycle", used)
    for kind, u, height in _bifurcations(diagram, index):
        look = {**MARKS[kind], "linestyle": "none", "markersize": 5.0}
        look |= {"markeredgecolor": "white", "markeredgewidth": 0.6}
        ax.plot([u], [height], zorder=4.0, **look)
        used[kind.replace("hopf", "Hopf")] = Line2D([], [], **look)
    failed = sorted({failure.value for failure in diagram.failures})
    if failed:
        look = {"marker": "x", "linestyle": "none", "color": VERMILION, "markersize": 4.0}
        ax.plot(failed, [0.02] * len(failed), transform=ax.get_xaxis_transform(), **look)
        used["failed"] = Line2D([], [], **look)
    ax.set_xlim(float(diagram.speeds[0]), float(diagram.speeds[-1]))
    ax.set_xlabel(SPEED_LABEL)
    ax.set_ylabel(coordinate_label(index))
    ax.legend(used.values(), used.keys(), loc="best")
    return ax


def _extremes(cycles: CycleBranch) -> list[Array]:
    """Highest and lowest positions along a branch, and those of its mirror image."""
    own = [cycles.highest, cycles.highest - 2.0 * cycles.amplitudes]
    return [*own, *(-heights for heights in own)] if cycles.mirrored else own


def _line(
    ax: Axes,
    branch: EquilibriumBranch | CycleBranch,
    heights: Array,
    events: Sequence[BranchPoint | CycleEvent],
    colour: str,
    name: str,
    used: dict[str, Line2D],
) -> None:
    """A branch in stable and unstable pieces.

    A step between neighbouring points is as stable as the one it starts from; from a bifurcation it
    is as stable as the next.
    """
    speeds, stable = branch.speeds, branch.stable
    if speeds.size > 1:
        special = np.isin(speeds.round(6), np.round([event.speed for event in events], 6))
        stable = np.where(special[:-1], stable[1:], stable[:-1])
    ends = [0, *(np.flatnonzero(np.diff(stable)) + 1), stable.size]
    for start, stop in pairwise(ends):
        good = bool(stable[start])
        look = {"color": colour, **(STABLE if good else UNSTABLE)}
        part = slice(start, stop + 1)
        ax.plot(speeds[part], heights[part], zorder=2.0 + good, **look)
        label = f"{name}, {'stable' if good else 'unstable'}"
        used.setdefault(label, Line2D([], [], **look))


def _bifurcations(
    diagram: BifurcationDiagram, index: int | None
) -> Iterator[tuple[str, float, float]]:
    """Kind, speed and height of each bifurcation to mark."""
    for branch in diagram.equilibria:
        for point in branch.points:
            height = point.tip[0] if index is None else point.q[index]
            yield point.kind, point.speed, float(height)
    for cycles in diagram.cycles if index is None else ():
        for event in cycles.events:
            if event.kind in MARKS and event.kind != "hopf":
                apart = np.abs(cycles.speeds - event.speed)
                nearest = int(np.argmin(apart + np.abs(cycles.amplitudes - event.amplitude)))
                for heights in _extremes(cycles):
                    yield event.kind, event.speed, float(heights[nearest])


def orbit(cycles: LimitCycle | Sequence[LimitCycle], ax: Axes | None = None) -> Axes:
    """Limit cycles in the phase plane: the free end's transverse position against its velocity.

    Args:
        cycles: one limit cycle or several. Unstable ones are dashed.
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError: for no cycle, or fewer than 8 samples of one.
        TypeError: for bad arguments.
    """
    shown = _checked_cycles(cycles)
    curves = []
    for i, cycle in enumerate(shown):
        t, q, rates = np.asarray(cycle.t), np.asarray(cycle.q), np.asarray(cycle.qdot)
        if len(q) < 8:
            raise ValueError(f"cycles[{i}] must have at least 8 samples, got {len(q)}")
        velocity = cycle.model.tip_velocities(q.T, rates.T)[:, 0]
        fine = finer(t)
        x = CubicHermiteSpline(t, cycle.model.tips(q.T)[:, 0], velocity)(fine)
        curves.append((x, CubicSpline(t, velocity)(fine)))
    ax = axes_or_new(ax, 4.8, 4.2)
    for cycle, look, (x, velocity) in zip(shown, cycled_styles(len(shown)), curves, strict=True):
        closed = np.append(np.arange(x.size), 0)
        speed = getattr(cycle, "u", None)
        label = "" if speed is None else f"$u = {speed:.6g}$, "
        label += "stable" if cycle.stable else "unstable"
        line = {"color": look["color"], **(STABLE if cycle.stable else UNSTABLE)}
        ax.plot(x[closed], velocity[closed], label=label, **line)
    ax.set_xlabel(TIP_LABEL)
    ax.set_ylabel(TIP_RATE_LABEL)
    ax.legend(loc="best")
    return ax


def multipliers(cycles: LimitCycle | CycleBranch, ax: Axes | None = None) -> Axes:
    """Floquet multipliers beside the unit circle.

    The trivial multiplier is a ring at 1. Multipliers outside the circle, which make a cycle
    unstable, are crosses; those inside are dots. For a branch, colour shows the flow speed.

    Args:
        cycles: a limit cycle or a branch of them.
        ax: where to draw; new Axes where not given.

    Raises:
        TypeError: for bad arguments.
    """
    if isinstance(cycles, CycleBranch):
        rows, speeds = cycles.multipliers, cycles.speeds
    else:
        (cycle,) = _checked_cycles(cycles)
        rows, speeds = np.asarray(cycle.multipliers, dtype=np.complex128)[None], None
    ax = axes_or_new(ax, 4.4, 4.2)
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    circle = np.cos(angle), np.sin(angle)
    ax.fill(*circle, color="0.95", zorder=0.2)
    ax.plot(*circle, color="0.4", linewidth=0.8, zorder=0.5)
    ax.axhline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    ax.axvline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    others = np.array([nontrivial(row) for row in rows])
    flat = others.ravel()
    outside = np.abs(flat) > 1.0 + OUTSIDE
    for chosen, marker, size, plain in ((~outside, "o", 16, BLUE), (outside, "X", 30, VERMILION)):
        if not chosen.any():
            continue
        look: dict[str, Any] = {"color": plain}
        if speeds is not None:
            colours = np.repeat(speeds, others.shape[1])[chosen]
            ends = {"vmin": float(speeds.min()), "vmax": float(speeds.max()) + 1e-12}
            look = {"c": colours, "cmap": "viridis", **ends}
        points = flat.real[chosen], flat.imag[chosen]
        shown = ax.scatter(*points, marker=marker, s=size, zorder=3.0, **look)
    if speeds is not None and flat.size and ax.figure is not None:
        ax.figure.colorbar(shown, ax=ax, label=SPEED_LABEL)
    ring = open_marker(7.0, SKY, markerfacecolor="none", markeredgewidth=1.4, zorder=2.5)
    ax.plot([1.0], [0.0], **ring)
    ax.margins(0.08)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel(r"Re $\rho$")
    ax.set_ylabel(r"Im $\rho$")
    return ax


def _checked_cycles(cycles: Any) -> list[Any]:
    """The argument as a list, if it is a limit cycle or several."""
    several = list(cycles) if isinstance(cycles, list | tuple) else [cycles]
    if not several:
        raise ValueError("cycles must hold at least one, got none")
    for cycle in several:
        if not all(hasattr(cycle, name) for name in ("t", "q", "qdot", "multipliers", "stable")):
            raise TypeError(f"cycles must be limit cycles, got {check.shown(cycle)}")
    return several
