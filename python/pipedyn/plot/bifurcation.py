# SPDX-License-Identifier: MIT
"""Pictures beyond onset: the bifurcation diagram, a cycle's orbit, its Floquet multipliers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Literal, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from pipedyn.bifurcation.branches import CycleBranch
from pipedyn.bifurcation.diagram import BifurcationDiagram
from pipedyn.bifurcation.events import nontrivial
from pipedyn.models.base import Model
from pipedyn.plot.interpolation import finer
from pipedyn.plot.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_LABEL,
    VERMILION,
    axes_or_new,
    check_type,
    cycled_styles,
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
"""Look of each change of stability."""

MULTIPLIERS_SHOWN = 2000
"""Multipliers beyond which a branch's are thinned out."""


class Orbit(Protocol):
    """What pictures need of a limit cycle: one period of motion, and its multipliers."""

    @property
    def t(self) -> Array:
        """Times over one period, shape (S,)."""

    @property
    def q(self) -> Array:
        """Coordinates, shape (S, coordinates)."""

    @property
    def qdot(self) -> Array:
        """Their rates, shape (S, coordinates)."""

    @property
    def multipliers(self) -> ArrayLike:
        """Floquet multipliers, the trivial one among them."""

    @property
    def stable(self) -> bool:
        """Whether motions nearby approach it."""

    @property
    def model(self) -> Model:
        """The model."""


def bifurcation_diagram(
    diagram: BifurcationDiagram,
    coordinate: Literal["tip"] | int = "tip",
    ax: Axes | None = None,
) -> Axes:
    """Transverse position of the free end over the flow speed.

    Equilibria are black and cycles blue, of these the highest and the lowest position, with those
    of mirror images; what is stable is a solid line, what is not dashed. Grey dots are the turning
    points of motions from many starts, each mark a change of stability.

    Args:
        diagram: what to show.
        coordinate: "tip", or the index of a coordinate of the equilibria, counted from 0, which
            alone are then drawn: where the free end is held it tells nothing.
        ax: where to draw; a new figure's where not given.

    Raises:
        ValueError: for an index that the model does not have.
        TypeError: for what is no diagram, neither "tip" nor an index, or no Axes.
    """
    check_type("diagram", diagram, BifurcationDiagram)
    index: int | None = None
    if isinstance(coordinate, str):
        check.choice("coordinate", coordinate, ("tip",))
    else:
        index = check.count("coordinate", coordinate, low=0, high=diagram.model.coordinates - 1)
    ax = axes_or_new(ax, 6.4, 4.2)
    used: dict[str, Line2D] = {}

    if diagram.motions and index is None:
        turns = [(one.speed, one.turnings) for one in diagram.motions if one.turnings.size]
        x = np.concatenate([np.full(values.size, u) for u, values in turns] or [np.zeros(0)])
        y = np.concatenate([values for _, values in turns] or [np.zeros(0)])
        (dots,) = ax.plot(
            *(x, y, "."),
            markersize=2.6,
            color="0.55",
            markeredgewidth=0.0,
            zorder=1.0,
            rasterized=x.size > 20_000,
            gid="motions",
        )
        used["late motions turn here"] = Line2D([], [], **_dot(dots))
    for branch in diagram.equilibria:
        heights = branch.tips[:, 0] if index is None else branch.q[:, index]
        good = _between(branch.speeds, branch.stable, [point.speed for point in branch.points])
        _line(ax, branch.speeds, heights, good, BLACK, "equilibrium", used)
    for cycles in diagram.cycles if index is None else ():
        good = _between(cycles.speeds, cycles.stable, [event.speed for event in cycles.events])
        for heights in _extremes(cycles):
            _line(ax, cycles.speeds, heights, good, BLUE, "cycle", used)
    for kind, u, height in _changes(diagram, index):
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
    named = "free end $x$  $(L)$" if index is None else f"coordinate $q_{{{index}}}$, from 0"
    ax.set_ylabel(named)
    ax.legend(used.values(), used.keys(), loc="best")
    return ax


def _extremes(cycles: CycleBranch) -> list[Array]:
    """Highest and lowest positions along a branch, and those of its mirror image."""
    own = [cycles.highest, cycles.highest - 2.0 * cycles.amplitudes]
    return [*own, *(-heights for heights in own)] if cycles.mirrored else own


def _dot(dots: Line2D) -> dict[str, Any]:
    return {"marker": ".", "linestyle": "none", "color": dots.get_color(), "markersize": 4.0}


def _line(
    ax: Axes,
    speeds: Array,
    heights: Array,
    between: NDArray[np.bool_],
    colour: str,
    name: str,
    used: dict[str, Line2D],
) -> None:
    """A branch, in pieces that are stable or are not."""
    for part, good in _pieces(between):
        look: dict[str, Any] = {"color": colour, "linestyle": "-" if good else (0, (4, 2))}
        look["linewidth"] = 1.4 if good else 1.0
        ax.plot(speeds[part], heights[part], zorder=2.0 + good, **look)
        label = f"{name}, {'stable' if good else 'unstable'}"
        used.setdefault(label, Line2D([], [], **look))


def _between(
    speeds: Array, stable: NDArray[np.bool_], changes: Sequence[float]
) -> NDArray[np.bool_]:
    """Whether a branch is stable between neighbouring points, of which some are its changes."""
    changed = np.isin(speeds.round(6), np.round(changes, 6))
    return np.where(changed[:-1], stable[1:], stable[:-1]) if speeds.size > 1 else stable


def _pieces(between: NDArray[np.bool_]) -> Iterator[tuple[slice, bool]]:
    """Points of runs that are alike."""
    ends = np.flatnonzero(np.diff(between.astype(np.int8)))
    starts = [0, *(int(end) + 1 for end in ends)]
    stops = [*starts[1:], between.size]
    for start, stop in zip(starts, stops, strict=True):
        yield slice(start, stop + 1), bool(between[start])


def _changes(diagram: BifurcationDiagram, index: int | None) -> Iterator[tuple[str, float, float]]:
    """Kind, speed and height of each change of stability that has a mark."""
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


def orbit(cycles: Orbit | Sequence[Orbit], ax: Axes | None = None) -> Axes:
    """Cycles in phase space: the free end's transverse position against its velocity.

    Args:
        cycles: one limit cycle or several. Unstable ones are dashed.
        ax: where to draw; a new figure's where not given.

    Raises:
        ValueError: for none, or fewer than 8 samples of one.
        TypeError: for what is no limit cycle, or no Axes.
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
        dashed = "-" if cycle.stable else (0, (4, 2))
        around = np.append(np.arange(x.size), 0)  # one period ends where it began
        speed = getattr(cycle, "u", None)
        told = "" if speed is None else f"$u = {speed:.6g}$, "
        ax.plot(
            *(x[around], velocity[around]),
            color=look["color"],
            linestyle=dashed,
            linewidth=1.4,
            label=f"{told}{'stable' if cycle.stable else 'unstable'}",
        )
    ax.set_xlabel("free end $x$  $(L)$")
    ax.set_ylabel(r"its velocity $\dot x$  $(L/T)$")
    ax.legend(loc="best")
    return ax


def multipliers(cycles: Orbit | CycleBranch, ax: Axes | None = None) -> Axes:
    """Floquet multipliers beside the unit circle.

    The trivial multiplier is a ring at 1. Those outside the circle, by which a cycle is unstable,
    are crosses, those inside dots. Of a branch all are shown, the flow speed as colour.

    Args:
        cycles: a limit cycle or a branch of them.
        ax: where to draw; a new figure's where not given.

    Raises:
        TypeError: for what is neither, or no Axes.
    """
    if isinstance(cycles, CycleBranch):
        every = -(-cycles.multipliers.size // MULTIPLIERS_SHOWN)
        rows, speeds = cycles.multipliers[::every], cycles.speeds[::every]
    else:
        (cycle,) = _checked_cycles(cycles)
        rows, speeds = np.asarray(cycle.multipliers, dtype=np.complex128)[None], None
    ax = axes_or_new(ax, 4.4, 4.2)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.fill(np.cos(turn), np.sin(turn), color="0.95", zorder=0.2)
    ax.plot(np.cos(turn), np.sin(turn), color="0.4", linewidth=0.8, zorder=0.5)
    ax.axhline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    ax.axvline(0.0, color="0.8", linewidth=0.5, zorder=0.3)
    others = np.array([nontrivial(row) for row in rows])
    colours = None if speeds is None else np.repeat(speeds, others.shape[1])
    flat = others.ravel()
    outside = np.abs(flat) > 1.0 + 1e-6
    norm = None if colours is None else (float(colours.min()), float(colours.max()) + 1e-12)
    for chosen, marker, size, plain in ((~outside, "o", 16, BLUE), (outside, "X", 30, VERMILION)):
        if not chosen.any():
            continue
        look: dict[str, Any] = {"color": plain}
        if colours is not None and norm is not None:
            look = {"c": colours[chosen], "cmap": "viridis", "vmin": norm[0], "vmax": norm[1]}
        drawn = ax.scatter(
            *(flat.real[chosen], flat.imag[chosen]), marker=marker, s=size, zorder=3.0, **look
        )
    if colours is not None and flat.size and ax.figure is not None:
        ax.figure.colorbar(drawn, ax=ax, label=SPEED_LABEL)
    ax.plot(
        *([1.0], [0.0]),
        linestyle="none",
        marker="o",
        markersize=7.0,
        markerfacecolor="none",
        markeredgecolor=SKY,
        markeredgewidth=1.4,
        zorder=2.5,
    )
    ax.margins(0.08)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel(r"Re $\rho$")
    ax.set_ylabel(r"Im $\rho$")
    return ax


def _checked_cycles(cycles: Any) -> list[Any]:
    """The argument, if it is a limit cycle or several."""
    several = list(cycles) if isinstance(cycles, list | tuple) else [cycles]
    if not several:
        raise ValueError("cycles must hold at least one, got none")
    for cycle in several:
        if not all(hasattr(cycle, name) for name in ("t", "q", "qdot", "multipliers", "stable")):
            raise TypeError(f"cycles must be limit cycles, got {check.shown(cycle)}")
    return several
