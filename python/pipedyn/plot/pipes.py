# SPDX-License-Identifier: MIT
"""Motion as the pipe itself: its shapes over a cycle, and a film.

The model's y grows along the straight pipe from the clamp, downward if it hangs: then the axis of
the picture is turned, and gravity points down the page. A pipe with gamma < 0 stands, so its y
grows up the page, and gravity points down again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import ArrayLike

from pipedyn.motion.simulate import Motion
from pipedyn.plot.interpolation import (
    checked_motion,
    checked_span,
    coordinates_at,
    refuse_coarse_tip,
    upward_passages,
)
from pipedyn.plot.style import BLACK, BLUE, VERMILION, axes_or_new, check_axes
from pipedyn.util import check
from pipedyn.util.check import Array

MOST_SHAPES = 1000
MOST_FRAMES = 2000
FEWEST_FRAMES = 8
"""Frames of a cycle below which a film shows another motion than the pipe's."""

CYCLE_SECONDS, FILM_SECONDS = 2.5, 8.0
"""How long a film takes for a cycle, or for all of a motion that has none, if it has no speed."""

POINTS = np.linspace(0.0, 1.0, 241)
"""Arc lengths of a drawn shape: joints of chains with up to 6, and 8, 10, 12 ... equal segments."""

ARROW = 0.14
"""Length of the arrow that shows the flow, in L."""


def snapshots(
    motion: Motion,
    span: ArrayLike | None = None,
    count: int = 16,
    ax: Axes | None = None,
) -> Axes:
    """The pipe's shapes at equal time steps on one picture, the latest darkest.

    The arrow at the free end of the latest shape shows the flow, out of the pipe or into it; the
    one beside the clamp gravity, if there is any.

    Args:
        motion: what to show.
        span: start and end in T; where not given the last cycle, from a passage of the free end
            through its middle to the next that is alike, or all of a motion that has none.
        count: number of shapes, from 2 to 1000; both ends of the span are among them, of a cycle
            that ends where it began only the end.
        ax: where to draw; a new figure's where not given. The first collection, the shapes, serves
            `colour_bar`.

    Raises:
        ValueError: for a span that does not lie in the motion's times, a count out of range, or a
            motion with fewer than 3 samples, or so few that what lies between is a guess.
        TypeError: for what is no motion, span or whole number.
    """
    motion = checked_motion(motion)
    start, end, cycle = checked_span(span, motion)
    count = check.count("count", count, low=2, high=MOST_SHAPES)
    refuse_coarse_tip("motion", motion, (start, end))
    ax = axes_or_new(ax, 4.4, 5.0)
    times = np.linspace(start, end, count + 1)[1:] if cycle else np.linspace(start, end, count)
    shapes = _shapes(motion, times)
    lines = LineCollection(
        list(shapes),
        cmap=ListedColormap([(1.0 - a, 1.0 - 0.9 * a, 1.0 - 0.75 * a) for a in _shades(256)]),
        linewidths=[1.1] * (count - 1) + [2.4],
        zorder=2.0,
        capstyle="round",
    )
    lines.set_array(times)
    lines.set_gid("shapes")
    ax.add_collection(lines)
    _stage(ax, motion, shapes)
    flow = _flow_arrow(ax, motion)
    if flow is not None:
        flow.set_positions(*_flow(motion, shapes[-1]))
    what = f"a cycle of {end - start:.4g}" if cycle else rf"$\tau =$ {start:.4g} to {end:.4g}"
    ax.set_title(f"{_heading(motion)}\n{count} shapes, {what} $T$")
    return ax


def animate(
    motion: Motion,
    path: str | os.PathLike[str] | None = None,
    *,
    fps: float = 25.0,
    speed: float | None = None,
    span: ArrayLike | None = None,
    ax: Axes | None = None,
) -> FuncAnimation:
    """A film of the pipe with the path of its free end, frames evenly spaced in time.

    In a notebook `IPython.display.HTML(film.to_jshtml())` shows it.

    Args:
        motion: what to show.
        path: a file to write, ending in .gif; none is written where not given.
        fps: frames a second, from 1 to 50, the most that a GIF can show.
        speed: time that passes in a second of the film, in T. Where not given, a cycle takes 2.5
            seconds, and all of a motion without cycles 8.
        span: start and end in T; the last cycle, shown without end, or all of a motion that has
            none, where not given.
        ax: where to draw; that of a figure without a window where not given.

    Returns:
        The film. Keep it as long as it is to be shown.

    Raises:
        ValueError: for a span that does not lie in the motion's times; for a film of one frame, of
            more than 2000, or with fewer than 8 in a cycle; for a path that is no .gif in a folder
            that exists; for a motion with fewer than 3 samples, or so few that what lies between
            is a guess.
        TypeError: for what is no motion, number, span or path.
    """
    motion = checked_motion(motion)
    start, end, cycle = checked_span(span, motion)
    target = _checked_path(path)
    fps = check.real("fps", fps, low=1.0, high=50.0)
    if speed is not None:
        speed = check.real("speed", speed, low=0.0, open_low=True)
    if ax is not None:
        check_axes(ax)
    refuse_coarse_tip("motion", motion, (start, end))
    swing = end - start if cycle else _cycle_within(motion, start, end)
    frames = _frames(end - start, swing, fps, speed)
    if ax is None:
        figure = Figure(figsize=(4.0, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        ax = figure.subplots()
    else:
        root = ax.figure
        figure = root if isinstance(root, Figure) else root.figure

    times = np.linspace(start, end, frames, endpoint=not cycle)
    shapes = _shapes(motion, times)
    dots = max(1, math.ceil(400 / frames))
    fine = np.linspace(start, end, dots * (frames - (not cycle)) + 1)
    path_of_tip = motion.model.tips(coordinates_at(motion, fine).T)
    (trace,) = ax.plot([], [], color=BLUE, linewidth=0.9, zorder=1.8, gid="trace")
    (pipe,) = ax.plot([], [], color=BLACK, linewidth=2.6, zorder=2.0, gid="pipe")
    _stage(ax, motion, shapes)
    flow = _flow_arrow(ax, motion)
    heading = _heading(motion)

    def show(frame: int) -> Sequence[Any]:
        pipe.set_data(*shapes[frame].T)
        # Of a film that is shown without end the whole path is there from the start.
        trace.set_data(*path_of_tip[: None if cycle else dots * frame + 1].T)
        if flow is not None:
            flow.set_positions(*_flow(motion, shapes[frame]))
        title = ax.set_title(f"{heading}\n" + rf"$\tau = {times[frame]:.{_digits(times)}f}\,T$")
        return [pipe, trace, title]

    show(0)
    film = FuncAnimation(figure, show, frames=frames, interval=1000.0 / fps, blit=False)
    if target is not None:
        film.save(target, writer=PillowWriter(fps=fps))  # type: ignore[arg-type]
    return film


def _checked_path(path: Any) -> Path | None:
    if path is None:
        return None
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise TypeError(f"path must be a path of a file, got {check.shown(path)}")
    target = Path(path)
    if target.suffix.lower() != ".gif" or not target.parent.is_dir():
        raise ValueError(
            f"path must end with .gif and lie in a folder that exists, got {check.shown(path)}"
        )
    return target


def _cycle_within(motion: Motion, start: float, end: float) -> float | None:
    """How long a cycle lasts, of those in a span; None if there is none."""
    lasting = np.diff(upward_passages(motion, start, end))
    return float(np.median(lasting)) if lasting.size else None


def _frames(lasting: float, swing: float | None, fps: float, speed: float | None) -> int:
    """Number of frames of a film, refused where it would mislead or never end."""
    if speed is None:
        speed = lasting / FILM_SECONDS if swing is None else swing / CYCLE_SECONDS
    wanted = lasting / speed * fps
    if not wanted <= MOST_FRAMES:
        raise ValueError(
            f"span, fps and speed must ask for at most {MOST_FRAMES} frames, got {wanted:.4g}: "
            f"{lasting:.4g} T at {speed:.4g} T a second, {fps:g} frames a second"
        )
    if swing is not None and swing / speed * fps < (1.0 - 1e-9) * FEWEST_FRAMES:
        raise ValueError(
            f"speed must leave at least {FEWEST_FRAMES} frames to a cycle of {swing:.4g} T: at "
            f"{fps:g} frames a second at most {swing * fps / FEWEST_FRAMES:.4g}, got {speed:.4g}"
        )
    if round(wanted) < 2:
        raise ValueError(
            f"speed must leave at least 2 frames to {lasting:.4g} T, got {speed:.4g} T a second"
        )
    return round(wanted)


def _shades(count: int) -> Array:
    """From light to dark, none as light as the page."""
    return np.linspace(0.22, 1.0, count)


def _shapes(motion: Motion, times: Array) -> Array:
    """The pipe at some times, shape (len(times), points, 2)."""
    return np.stack([motion.model.shape(q, POINTS) for q in coordinates_at(motion, times)])


def _heading(motion: Motion) -> str:
    return f"$u = {motion.u:.4g}$, {motion.model.pipe.flow}"


def _digits(times: Array) -> int:
    """Decimals that tell neighbouring times apart."""
    return max(0, -math.floor(math.log10(times[1] - times[0])))


def _stage(ax: Axes, motion: Motion, shapes: Array) -> None:
    """Equal axes that hold the shapes and what the flow does at their ends; clamp and gravity."""
    gamma = motion.model.pipe.gamma
    wide = max(0.36, float(np.abs(shapes[..., 0]).max()) + ARROW + 0.06)
    low = min(-0.12, float(shapes[..., 1].min()) - ARROW - 0.06)
    high = float(shapes[..., 1].max()) + ARROW + 0.06
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlim(-wide, wide)
    ax.set_ylim(*((low, high) if gamma < 0.0 else (high, low)))
    wall = Rectangle((-0.1, -0.06), 0.2, 0.06, facecolor="0.92", edgecolor="0.35", hatch="////")
    wall.set_gid("clamp")
    wall.set_zorder(1.5)
    ax.add_patch(wall)
    ax.plot([-0.1, 0.1], [0.0, 0.0], color=BLACK, linewidth=1.4, zorder=1.6)
    ax.axvline(0.0, color="0.6", linewidth=0.6, linestyle=(0, (6, 4)), zorder=0.5)
    if gamma != 0.0:
        at, length = -wide + 0.1, math.copysign(0.16, gamma)
        start = -0.06 if gamma > 0.0 else 0.1
        arrow = _arrow(ax, BLACK, "gravity")
        arrow.set_positions((at, start), (at, start + length))
        ax.text(at + 0.03, start + 0.5 * length, "$g$", va="center")
    ax.set_xlabel("transverse $x$  $(L)$")
    ax.set_ylabel("along the straight pipe $y$  $(L)$")


def _arrow(ax: Axes, colour: str, gid: str) -> FancyArrowPatch:
    arrow = FancyArrowPatch(
        (0.0, 0.0),
        (0.0, 1.0),
        arrowstyle="-|>",
        mutation_scale=11.0,
        color=colour,
        linewidth=1.8,
        shrinkA=0.0,
        shrinkB=0.0,
        zorder=3.0,
        gid=gid,
    )
    ax.add_patch(arrow)
    return arrow


def _flow_arrow(ax: Axes, motion: Motion) -> FancyArrowPatch | None:
    return _arrow(ax, VERMILION, "flow") if motion.u > 0.0 else None


def _flow(motion: Motion, shape: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Tail and head of the arrow at the free end: out of it, or into it."""
    step = shape[-1] - shape[-2]
    along = step / np.linalg.norm(step)
    near, far = shape[-1] + 0.02 * along, shape[-1] + ARROW * along
    ends = (near, far) if motion.model.pipe.flow == "ejecting" else (far, near)
    (ax, ay), (bx, by) = ends
    return (float(ax), float(ay)), (float(bx), float(by))
