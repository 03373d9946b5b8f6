# SPDX-License-Identifier: MIT
"""Motion as shapes of the pipe: snapshots over a cycle, and an animation.

The model's y axis points along the straight pipe, away from the clamp. For a hanging pipe the
picture's axis is inverted, for a standing one (gamma < 0) it is not. Gravity points down the page
in both.
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
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle
from numpy.typing import ArrayLike

from pipedyn.motion.simulate import Motion
from pipedyn.plot import common
from pipedyn.plot.interpolation import coordinates_at, last_cycle, shown_part
from pipedyn.util import check
from pipedyn.util.check import Array

ARROW = 0.14
"""Length of the arrow that shows the flow, in L: it widens the picture by a seventh at most."""


def snapshots(
    motion: Motion,
    span: ArrayLike | None = None,
    count: int = 16,
    ax: Axes | None = None,
) -> Axes:
    """Shapes of the pipe at equal time steps in one picture, the latest darkest.

    The arrow at the free end of the latest shape shows the flow, out of the pipe or into it. The
    arrow next to the clamp shows gravity, if there is any.

    Args:
        motion: what to show.
        span: start and end in T; where not given the last cycle, or all of a motion without one.
            A cycle lasts from one upward crossing of the free end's middle position to the next
            in the same state.
        count: number of shapes, from 2 to 1000. Both ends of a span are among them, but only the
            end of a cycle, where it is as at the start.
        ax: where to draw; new Axes where not given. The first collection, the shapes, serves
            `colour_bar`.

    Raises:
        ValueError: for a span outside the motion's times, a count out of range, fewer than 3
            samples, or samples too far apart to interpolate.
        TypeError: for bad arguments.
    """
    motion, start, end, cycle = shown_part(motion, span)
    count = check.count("count", count, low=2, high=1000)  # more than pixels can separate
    ax = common.axes(ax, (4.4, 5.0))
    times = np.linspace(start, end, count + 1)[1:] if cycle else np.linspace(start, end, count)
    shapes = _shapes(motion, times)
    darkness = np.linspace(0.22, 1.0, 256)  # no shape is as light as the page
    lines = LineCollection(
        list(shapes),
        cmap=ListedColormap(1.0 - darkness[:, None] * [1.0, 0.9, 0.75]),
        linewidths=[1.1] * (count - 1) + [2.4],
        array=times,
        capstyle="round",
        zorder=2.0,
        gid="shapes",
    )
    ax.add_collection(lines)
    _surroundings(ax, motion, shapes, shapes[-1])
    what = f"a cycle of {end - start:.4g}" if cycle else rf"$\tau =$ {start:.4g} to {end:.4g}"
    ax.set_title(f"{common.motion_title(motion)}\n{count} shapes, {what} $T$")
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
    """An animation of the pipe with the path of its free end, frames at equal time steps.

    In a notebook `IPython.display.HTML(animation.to_jshtml())` shows it.

    Args:
        motion: what to show.
        path: a file to write, ending in .gif; none is written where not given.
        fps: frames a second, from 1 to 50, the most that a GIF can show.
        speed: time that passes in a second of the animation, in T. Where not given, a cycle takes
            2.5 seconds, and all of a motion without cycles 8.
        span: start and end in T; where not given the last cycle, which repeats without end, or all
            of a motion without one.
        ax: where to draw; that of a figure without a window where not given.

    Returns:
        The animation. Keep a reference to it as long as it is shown.

    Raises:
        ValueError: for a span outside the motion's times; for fewer than 2 or more than 2000
            frames, or fewer than 8 in a cycle; for a path that is no .gif in a folder that exists;
            for fewer than 3 samples, or samples too far apart to interpolate.
        TypeError: for bad arguments.
    """
    motion, start, end, cycle = shown_part(motion, span)
    path = _checked_path(path)
    fps = check.real("fps", fps, low=1.0, high=50.0)
    if speed is not None:
        speed = check.real("speed", speed, low=0.0, open_low=True)
    begin, finish = (start, end) if cycle else last_cycle(motion) or (0.0, 0.0)
    frames = _frames(end - start, finish - begin, fps, speed)
    own = ax is None
    if ax is None:
        ax = Figure(figsize=(4.0, 4.6), layout="constrained").subplots()
    figure = common.axes(ax, (4.0, 4.6)).figure.figure

    times = np.linspace(start, end, frames, endpoint=not cycle)
    shapes = _shapes(motion, times)
    dots = max(1, math.ceil(400 / frames))
    fine = np.linspace(start, end, dots * (frames - (not cycle)) + 1)
    path_of_tip = motion.model.tips(coordinates_at(motion, fine).T)
    (trace,) = ax.plot([], [], color=common.BLUE, linewidth=0.9, zorder=1.8, gid="trace")
    (pipe,) = ax.plot([], [], color=common.BLACK, linewidth=2.6, zorder=2.0, gid="pipe")
    flow = _surroundings(ax, motion, shapes, shapes[0])
    digits = max(0, -math.floor(math.log10(times[1] - times[0])))  # neighbouring times differ

    def show(frame: int) -> Sequence[Any]:
        pipe.set_data(*shapes[frame].T)
        # A cycle repeats, so its whole path is there from the start.
        trace.set_data(*path_of_tip[: None if cycle else dots * frame + 1].T)
        if flow is not None:
            flow.set_positions(*_flow_ends(motion, shapes[frame]))
        now = rf"$\tau = {times[frame]:.{digits}f}\,T$"
        text = ax.set_title(f"{common.motion_title(motion)}\n{now}")
        return [pipe, trace, text]

    show(0)
    if own:  # laid out once: every frame is then as large as the first, and quicker
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
    animation = FuncAnimation(figure, show, frames=frames, interval=1000.0 / fps, blit=False)
    if path is not None:
        animation.save(path, writer=PillowWriter(fps=fps))  # type: ignore[arg-type]
    return animation


def _checked_path(path: Any) -> Path | None:
    """The path of a file that can be written; None where none is asked for."""
    if path is None:
        return None
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise TypeError(f"path must be a path of a file, got {check.shown(path)}")
    target = Path(path)
    if target.suffix.lower() != ".gif" or not target.parent.is_dir():
        came = check.shown(path)
        raise ValueError(f"path must end with .gif and lie in a folder that exists, got {came}")
    return target


def _frames(duration: float, period: float, fps: float, speed: float | None) -> int:
    """Number of frames of an animation; refuses too many, and too few to show the motion.

    The period is 0 for a motion without cycles. Without a speed a cycle takes 2.5 s, slow enough to
    follow by eye. With fewer than 2 frames a cycle would run backwards; 8 show the shapes between.
    """
    if speed is None:
        speed = period / 2.5 or duration / 8.0
    wanted = duration / speed * fps
    if not wanted <= 2000.0:
        raise ValueError(
            f"span, fps and speed must ask for at most 2000 frames, got {wanted:.4g}: "
            f"{duration:.4g} T at {speed:.4g} T a second, {fps:g} frames a second"
        )
    if 0.0 < period / speed * fps < 8.0 * (1.0 - 1e-9):  # rounding
        raise ValueError(
            f"speed must leave at least 8 frames to a cycle of {period:.4g} T: at {fps:g} frames a "
            f"second at most {period * fps / 8.0:.4g}, got {speed:.4g}"
        )
    if round(wanted) < 2:
        raise ValueError(
            f"speed must leave at least 2 frames to {duration:.4g} T, got {speed:.4g} T a second"
        )
    return round(wanted)


def _shapes(motion: Motion, times: Array) -> Array:
    """The pipe at some times, shape (len(times), points, 2)."""
    s = np.linspace(0.0, 1.0, 241)  # holds the joints of chains of 1 to 6, 8, 10 ... segments
    return np.stack([motion.model.shape(q, s) for q in coordinates_at(motion, times)])


def _surroundings(ax: Axes, motion: Motion, shapes: Array, shape: Array) -> FancyArrowPatch | None:
    """Clamp, gravity, and axes of equal scale with room for all shapes and the flow's arrow.

    Returns the arrow, at one shape; None without flow.
    """
    gamma = motion.model.pipe.gamma
    wide = max(0.36, float(np.abs(shapes[..., 0]).max()) + ARROW + 0.06)
    low = min(-0.12, float(shapes[..., 1].min()) - ARROW - 0.06)
    high = float(shapes[..., 1].max()) + ARROW + 0.06
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(-wide, wide), ylim=(low, high) if gamma < 0.0 else (high, low))
    ax.set(xlabel="transverse $x$  $(L)$", ylabel="along the straight pipe $y$  $(L)$")
    hatched: dict[str, Any] = {"facecolor": "0.92", "edgecolor": "0.35", "hatch": "////"}
    ax.add_patch(Rectangle((-0.1, -0.06), 0.2, 0.06, zorder=1.5, gid="clamp", **hatched))
    ax.plot([-0.1, 0.1], [0.0, 0.0], color=common.BLACK, linewidth=1.4, zorder=1.6)
    ax.axvline(0.0, color="0.6", linewidth=0.6, linestyle=(0, (6, 4)), zorder=0.5)
    if gamma != 0.0:
        at, length = -wide + 0.1, math.copysign(0.16, gamma)
        start = -0.06 if gamma > 0.0 else 0.1
        _arrow(ax, common.BLACK, "gravity", ((at, start), (at, start + length)))
        ax.text(at + 0.03, start + 0.5 * length, "$g$", va="center")
    if motion.u == 0.0:
        return None
    return _arrow(ax, common.VERMILION, "flow", _flow_ends(motion, shape))


def _arrow(ax: Axes, colour: str, gid: str, ends: tuple[Any, Any]) -> FancyArrowPatch:
    look: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 11.0, "linewidth": 1.8}
    arrow = FancyArrowPatch(*ends, color=colour, shrinkA=0, shrinkB=0, zorder=3, gid=gid, **look)
    ax.add_patch(arrow)
    return arrow


def _flow_ends(motion: Motion, shape: Array) -> tuple[Any, Any]:
    """Tail and head of the arrow at the free end: out of it, or into it."""
    step = shape[-1] - shape[-2]
    along = step / np.linalg.norm(step)
    near, far = (tuple(map(float, shape[-1] + length * along)) for length in (0.02, ARROW))
    return (near, far) if motion.model.pipe.flow == "ejecting" else (far, near)
