# SPDX-License-Identifier: MIT
"""Pictures of motions: curves over time, phase portraits, shapes of the pipe, and animations.

The y axis of a model points along the straight pipe, away from the clamp. In pictures it points
down for a hanging pipe and up for a standing one (gamma < 0), so that gravity always points down
the page. Between samples pictures show cubics through positions and velocities.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, TypeAlias

import numpy as np
import scipy
from matplotlib import rc_context, rcParams
from matplotlib.animation import (
    FFMpegWriter,
    FuncAnimation,
    HTMLWriter,
    PillowWriter,
    adjusted_figsize,
)
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.image import imread
from matplotlib.patches import FancyArrowPatch, Rectangle
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import ArrayLike

from pipedyn.attraction.attractors import Attractors, Basin
from pipedyn.cycles.limit_cycle import LimitCycle
from pipedyn.models.pipe import Pipe
from pipedyn.motion.sampling import INVISIBLE, LEAST_MOTION, coarse
from pipedyn.motion.simulate import Ensemble, Motion
from pipedyn.plot import common
from pipedyn.plot.arrange import legend_below
from pipedyn.plot.bifurcation import STABILITY_STYLES
from pipedyn.plot.units import (
    ACROSS,
    AXIAL,
    ELAPSED,
    TIP,
    TIP_ACROSS,
    TIP_RATE,
    TRANSVERSE,
    Units,
    View,
    of_coordinate,
    rate,
)
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.files import replacing
from pipedyn.util.parallel import Progress

Sampled: TypeAlias = Motion | LimitCycle
Shown: TypeAlias = Sampled | Basin
"""Results that are shown as motions; for a basin, the motion on which its starts end is shown."""


def time_history(
    motions: Shown | Sequence[Shown] | Attractors | Ensemble,
    *,
    start: float | None = None,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Transverse displacement of the free end over time; of `Pipe.tip_place` if the end is held.

    In three dimensions this is the displacement along x. Samples too far apart for a curve are
    shown as dots. The title says where a mean cycle has fewer than ten samples.

    Args:
        motions: one or several motions, limit cycles or basins, attractors, or an ensemble, whose
            failed members are left out. Between samples, cubics through positions and velocities
            are shown.
        start: time from which motions are shown, in T, or in s with units="si", to leave out a
            transient; all if not given.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether several motions have a legend.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 5), 6.0, 5.0, lambda s: 0.1 * s)
        >>> ax = plot.time_history(motion)

    Raises:
        ValueError: for fewer than 3 samples from `start` on.
        TypeError: for bad arguments.
    """
    chosen, failed = checked_motions(motions, start, units)
    legend = check.flag("legend", legend)
    shown = signals(chosen, None, units, rates_shown=False)
    ax = shown[0].view.axes(ax, (6.4, 3.2), ELAPSED, TIP)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    for one in shown:
        t = one.times()
        ax.plot(one.view.one(ELAPSED) * t, one.values(t), **{"linewidth": 1.0} | one.drawn())
    ax.margins(x=0.0)
    explain(ax, shown, failed, *_rest(ax, shown, "y"), legend=legend)
    return ax


def phase_portrait(
    motions: Shown | Sequence[Shown] | Attractors | Ensemble,
    coordinate: Literal["tip", "path"] | int = "tip",
    *,
    start: float | None = None,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Displacement against velocity; a ring marks the start, and a closed last cycle is thicker.

    With coordinate="path" it shows the path of the free end of pipes that move in three dimensions,
    seen from above: z against x. A planar motion is a line there, and a whirling one a circle.

    Unstable limit cycles are dashed. Samples too far apart for a curve are shown as dots. The title
    says where a mean cycle has fewer than ten samples.

    Args:
        motions: one or several motions, limit cycles or basins, attractors, or an ensemble, whose
            failed members are left out.
        coordinate: "tip" for the transverse displacement x of the free end, or of `Pipe.tip_place`
            if the end is held; "path"; or the index of a coordinate, counted from 0.
        start: time from which motions are shown, in T, or in s with units="si", to leave out a
            transient; all if not given.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether several motions have a legend.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 5), 6.0, 5.0, lambda s: 0.1 * s)
        >>> ax = plot.phase_portrait(motion)

    Raises:
        ValueError: for fewer than 3 samples from `start` on, for an index that a model does not
            have, or for the path of a model that moves in a plane.
        TypeError: for bad arguments.
    """
    chosen, failed = checked_motions(motions, start, units)
    legend = check.flag("legend", legend)
    least = min(motion.model.coordinates for motion in chosen)
    index, across = of_coordinate(coordinate, least, ("tip", "path"))
    path = isinstance(coordinate, str) and coordinate == "path"
    if path and any(motion.model.dimensions == 2 for motion in chosen):
        rule = "coordinate must not be 'path' for a model that moves in a plane"
        raise ValueError(f"{rule}, as one without dimensions=3 does")
    shown = signals(chosen, index, units, rates_shown=not path, path=path)
    upward = TIP_ACROSS if path else TIP_RATE if index is None else rate(index, "its ")
    ax = shown[0].view.axes(ax, (4.8, 4.2), across, upward)
    for one in shown:
        t, look = one.times(), one.drawn()
        ends = None if one.dotted else repeated_cycle(one.motion)
        thin = {"linewidth": 0.5, "zorder": 2.0}
        if ends is not None:
            last = np.linspace(*ends, 401)
            ax.plot(*one.point(last), **{"linewidth": 1.6} | look)
            look = {"color": look["color"]}
            thin["alpha"] = 0.5
        for part in (t,) if ends is None else (t[t <= ends[0]], t[t >= ends[1]]):
            ax.plot(*one.point(part), **look | thin)
        if (start is None or not one.moves) and not one.dotted:
            ring = common.open_marker(4.5, look["color"], zorder=3.0)
            ax.plot(*one.point(t[0]), **ring)
    ax.locator_params(axis="x", nbins=SIGNED_TICKS)
    explain(ax, shown, failed, *_rest(ax, shown, "xy"), legend=legend)
    if path:
        half = 1.08 * max(
            float(np.abs(ax.dataLim.extents).max()), SMALLEST_VIEW * shown[0].view.one(TIP)
        )
        up = (half, -half) if shown[0].motion.model.pipe.gamma < 0.0 else (-half, half)
        ax.set(xlim=(-half, half), ylim=up, aspect="equal")
    return ax


def _rest(ax: Axes, shown: Sequence[Signal], names: str) -> list[str]:
    """Lines of a title about what rests; widens the axes of these names if nothing moves."""
    if not (resting := sum(not one.moves for one in shown)):
        return []
    if resting == len(shown):
        widen(ax, names, 1.0)
    end = shown[0].view.end if shown[0].index is None else "the coordinate"
    spatial = shown[0].index is None and any(one.motion.model.dimensions == 3 for one in shown)
    along = " along $x$" if spatial and shown[0].across is None else ""
    words = f"{end} is at rest{along}"
    return [words if len(shown) == 1 else f"{words}: {resting} of {len(shown)} motions"]


SMALLEST_VIEW = 0.05
"""Least half-width of axes on which something rests or recurs, as a share of the largest value.
Without it the few points of a cycle would be magnified until rounding shows."""


def widen(ax: Axes, names: str, largest: float = 0.0) -> None:
    """Widens axes, "x", "y" or "xy", to `SMALLEST_VIEW` of the largest value seen or given."""
    for name in names:
        seen = getattr(ax.dataLim, f"interval{name}")
        half = SMALLEST_VIEW * max(float(np.abs(seen).max()), largest)
        if np.ptp(seen) < half:
            ax.set(**{f"{name}lim": (seen.mean() - half, seen.mean() + half)})


Cubics: TypeAlias = "scipy.interpolate.CubicHermiteSpline"

SIGNED_TICKS = 4
"""Largest number of intervals between ticks of an x axis: labels with signs then do not meet in a
panel of two columns."""

ENOUGH_A_CYCLE = 10.0
"""Number of samples in a mean cycle below which a picture has a note."""

SMALLEST_SWING = 0.02
"""Share of the range below which a motion between two turning points is hardly seen."""


class Signal:
    """The free end or a coordinate of a motion as a function of time, and how it is drawn.

    Args:
        motion: the motion.
        index: index of the coordinate; None for the transverse displacement of the free end.
        units: units of the picture.
        rates_shown: whether velocities are shown.
        path: whether the path of the free end, z against x, is shown.

    Attributes:
        dotted: whether samples are too far apart for a curve, so that dots show them.
        a_cycle: number of samples in a mean cycle, which is twice the mean time between turning
            points; infinite where nothing swings.
        few: whether that number is below `ENOUGH_A_CYCLE`.
    """

    def __init__(
        self, motion: Sampled, index: int | None, units: Units, rates_shown: bool, path: bool
    ) -> None:
        self.motion, self.index, self.view = motion, index, View(units, motion.model.pipe)
        shown = (motion.tip, motion.tip_velocity) if index is None else (motion.q, motion.qdot)
        columns = [0, 2] if path else [index or 0]
        at, velocity = (values[:, columns] for values in shown)
        curves = [
            scipy.interpolate.CubicHermiteSpline(motion.t, *one)
            for one in zip(at.T, velocity.T, strict=True)
        ]
        self.curve, self.across = curves[0], curves[1] if path else None
        interval, widths = float(np.diff(motion.t).max()), np.ptp(at, axis=0)
        # Samples once a cycle are all at the same position.
        self.moves = bool(max(widths.max(), interval * np.abs(velocity).max()) > LEAST_MOTION)
        self.dotted = any(is_coarse(one, rates_shown=rates_shown) for one in curves)
        widest = curves[int(np.argmax(widths))]
        turns = widest.derivative().roots(extrapolate=False)
        turns = turns[np.isfinite(turns)]  # NaN is given for pieces at rest
        large = np.abs(np.diff(widest(turns))) > SMALLEST_SWING * widths.max()
        swings = np.diff(turns)[large] if self.moves else turns[:0]
        self.a_cycle = 2.0 * float(swings.mean()) / interval if swings.size else math.inf
        self.few = self.a_cycle < ENOUGH_A_CYCLE
        self.label = self.view.speed(motion.u, 6)
        self.look: dict[str, Any] = {}

    def times(self) -> Array:
        """Times at which straight lines look like the motion; those of the samples for dots."""
        if self.dotted:
            return self.curve.x
        t = self.curve.x
        parts = min(8, math.ceil(max(DRAWN_POINTS / t.size, DRAWN_A_CYCLE / self.a_cycle)))
        return np.interp(np.arange((t.size - 1) * parts + 1) / parts, np.arange(t.size), t)

    def drawn(self) -> dict[str, Any]:
        """Label and look of its curve or dots."""
        if not self.dotted:
            return {"label": self.label} | self.look
        dots = {"linestyle": "none", "marker": ".", "markersize": 2.0}
        return {"label": f"{self.label}, samples", "color": self.look["color"], **dots}

    def values(self, t: Array, derivative: int = 0) -> Array:
        """Values, or a derivative, at times t (in T), in the units shown."""
        unit = self.view.one(TIP) if self.index is None else 1.0
        return np.asarray(unit / self.view.one(ELAPSED) ** derivative * self.curve(t, derivative))

    def point(self, t: Array) -> tuple[Array, Array]:
        """Coordinates in a phase portrait at times t (in T), in the units shown."""
        across = self.across and np.asarray(self.view.one(TIP) * self.across(t))
        return self.values(t), self.values(t, 1) if across is None else across


def signals(
    motions: Sequence[Sampled],
    index: int | None,
    units: Units,
    *,
    rates_shown: bool,
    path: bool = False,
) -> list[Signal]:
    """The curve to draw for each motion.

    Labels give the flow speed, and also the model if several motions have the same speed. Those of
    limit cycles say whether they are stable; unstable ones are dashed.
    """
    shown = [Signal(one, index, units, rates_shown, path) for one in motions]
    alike, widths = len({one.label for one in shown}) < len(shown), (1.6, 1.0, 2.2)
    for i, (one, look) in enumerate(zip(shown, cycle(common.CURVE_STYLES), strict=False)):
        again = {"linewidth": 2.0} if i >= len(common.CURVE_STYLES) else {}
        one.look, model = look | again, one.motion.model
        if alike:
            one.label = f"{i}: {one.label}, {type(model).__name__}, {model.dof} d.o.f."
        if word := _steadiness(one.motion):
            one.label += f", {word}"
            one.look = STABILITY_STYLES[word] | {"color": look["color"], "linewidth": widths[i % 3]}
    return shown


def explain(
    ax: Axes, shown: Sequence[Signal], failed: Sequence[int] = (), *more: str, legend: bool = True
) -> None:
    """Adds a legend for several motions, if wanted, and a title.

    The title has the speed of a single motion, lines of `more`, and notes of members left out and
    of too few samples. More than 12 motions get no legend, as it would be as high as the Axes, but
    their number in the title.
    """
    title = []
    if len(shown) == 1:
        title.append(_title(shown[0].motion, shown[0].view))
    elif legend and len(shown) <= 12:
        legend_below(ax)
    elif legend:
        title.append(f"{len(shown)} motions")
    title += more
    if failed:
        which = ", ".join(map(str, failed[:6])) + (", ..." if len(failed) > 6 else "")
        title.append(f"{check.how_many(len(failed), 'member')} left out after failure: {which}")
    for count, note in (
        (sum(one.few for one in shown), "fewer than ten samples a cycle"),
        (sum(one.dotted for one in shown), "samples, too far apart for a curve"),
    ):
        if count:
            title.append(note if len(shown) == 1 else f"{note}: {count} of {len(shown)} motions")
    if title:
        ax.set_title("\n".join(title))


def _title(motion: Sampled, view: View) -> str:
    """Title of a picture: flow speed and direction, and whether a limit cycle is stable."""
    words = view.speed(motion.u), motion.model.pipe.flow, _steadiness(motion)
    return ", ".join(filter(None, words))


def _steadiness(motion: Sampled) -> str:
    """Whether a limit cycle is stable, in a word; empty for other motions."""
    return {None: "", True: "stable", False: "unstable"}[getattr(motion, "stable", None)]


# ------------------------------------------------------------------------------- shapes of the pipe


Side: TypeAlias = Literal["side", "front", "above", "space"]
"""From where a pipe is seen."""

SIDES: dict[Side, tuple[int, ...]] = {"side": (0, 1), "front": (2, 1), "above": (0, 2)}
SIDES["space"] = 0, 2, 1
"""Coordinates, of (x, y, z), along the axes of a picture."""

OF_SHAPES = TRANSVERSE, AXIAL, ACROSS
"""What axes of a picture show of shapes, for x, y and z."""


def seen(points: Array, view: Side) -> Array:
    """Points in a plane or in space, shape (..., 2 or 3), as coordinates on the axes of a view."""
    return points[..., list(SIDES[view])]


def _checked_side(view: Any, motion: Sampled) -> Side:
    side: Side = check.choice("view", view, tuple(SIDES))
    if side != "side" and motion.model.dimensions == 2:
        rule = "view must be 'side' for a model that moves in a plane; dimensions=3 makes others"
        raise ValueError(f"{rule}, got {check.shown(view)}")
    return side


ARROW = 0.14
"""Length of the arrow of the flow in L; the arrow widens the picture by at most a seventh."""


def snapshots(
    motion: Shown,
    span: ArrayLike | None = None,
    count: int = 16,
    *,
    view: Side = "side",
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Shapes of the pipe at equal time steps in one picture, the latest darkest.

    The arrow at the end of the latest shape shows the flow, out of the pipe or into it. The arrow
    next to the clamp shows gravity, if there is any. A pair of lines along the axis shows a support
    in which the pipe slides.

    Args:
        motion: a motion, a limit cycle, or a basin, whose attracting motion is shown.
        span: start and end, in T, or in s with units="si"; if not given, the last cycle or swing,
            or all of a motion without any. Both last from one upward crossing of the middle
            position by the free end to another; that of a cycle is in the same state, and the cycle
            before was the same.
        count: number of shapes, from 2 to 1000. The shapes include both ends of a span, but only
            the end of a cycle, whose start looks the same.
        view: "side" (x, y), or for a model in three dimensions "front" (z, y), "above" (x, z) or
            "space", a picture in perspective.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on, three-dimensional ones for "space"; new ones if not given. The first
            collection, the shapes, serves `colour_bar`.

    Example:
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 5), 6.0, 5.0, lambda s: 0.1 * s)
        >>> ax = plot.snapshots(motion, span=(4.0, 5.0))

    Raises:
        ValueError: for a span outside the times of the motion, a count out of range, fewer than 3
            samples, samples too far apart to interpolate, or another view than "side" of a model
            that moves in a plane.
        TypeError: for bad arguments.
    """
    motion, start, end, kind, scale = shown_part(motion, span, units)
    view = _checked_side(view, motion)
    count = check.count("count", count, low=2, high=1000)  # more than can be distinguished
    ax = common.axes(ax, (4.4, 5.0), in_space=view == "space")
    cycle = kind == "cycle"
    times = np.linspace(start, end, count + cycle)[int(cycle) :]
    shapes = scale.one(TRANSVERSE) * _shapes_at(motion, times)
    darkness = np.linspace(0.22, 1.0, 256)  # no shape is as light as the page
    lines = (Line3DCollection if view == "space" else LineCollection)(
        list(seen(shapes, view)),
        cmap=ListedColormap(1.0 - darkness[:, None] * [1.0, 0.9, 0.75]),
        linewidths=[1.1] * (count - 1) + [2.4],
        array=scale.one(ELAPSED) * times,
        capstyle="round",
        zorder=2.0,
        gid="shapes",
    )
    ax.add_collection(lines, autolim=False)
    _surroundings(ax, motion, shapes, shapes[-1], scale, view)
    start, end = scale.one(ELAPSED) * start, scale.one(ELAPSED) * end
    # Long titles break at spaces.
    name, unit = ("t", "\N{NO-BREAK SPACE}s") if scale.si else (r"\tau", "")
    ends = f"{end - start:.4g}$" if kind else f"{start:.4g}$ to {end:.4g}"
    what = f"a {kind} of ${name}={ends}" if kind else f"${name}={ends}"
    ax.set_title(f"{_title(motion, scale)}\n{count} shapes, {what}{unit}")
    return ax


NO_LIMIT = 1e6
"""Size of a player in MB up to which matplotlib leaves out no frame."""


class Film(FuncAnimation):
    """An animation that plays in a notebook; `save` chooses the format by the file's extension."""

    fps = 25.0
    repeats = False
    frames = 0
    progress = False
    moving: Sequence[Artist] = ()
    """What changes from frame to frame; in files all else is drawn once."""

    def __repr__(self) -> str:
        seconds = f"{self.frames / self.fps:.3g} s"
        return f"Film({self.frames} frames, {self.fps:g} a second, {seconds})"

    def save(self, filename: Any, *args: Any, **options: Any) -> None:
        """Writes a file: .gif, .mp4 (by ffmpeg), or .html, a page with a player.

        Raises:
            ValueError, TypeError: for another extension, a folder that does not exist, or .mp4 if
                ffmpeg is not found.
            OSError: if the file cannot be written; an existing file then stays as it was.
        """
        if args or "writer" in options:
            with Progress("film", self.progress) as progress:

                def drawn(frame: int, _: Any) -> None:
                    progress.to((frame + 1) / self.frames, f"{frame + 1}/{self.frames}")

                options.setdefault("progress_callback", drawn)
                super().save(filename, *args, **options)
            return
        path = _checked_path(filename)
        kind = path.suffix.lower()
        with (
            TemporaryDirectory() as folder,
            replacing(path) as beside,
            self._still_drawn_once(kind != ".gif", **options),
        ):
            chosen: Any = FFMpegWriter if kind == ".mp4" else PillowWriter
            given: dict[str, Any] = {"fps": self.fps}
            target = beside
            if kind == ".html":
                chosen, target = HTMLWriter, Path(folder, "film.html")
                given |= {"embed_frames": True, "embed_limit": NO_LIMIT, **self._player}
            writer = chosen(**given)
            try:
                self.save(target, writer=writer, **options)
            finally:  # a writer that fails leaves its folder of frames
                if folder_of_frames := getattr(writer, "_tmpdir", None):
                    folder_of_frames.cleanup()
            if target is not beside:
                page = target.read_text(encoding="utf-8")
                beside.write_text(f'<!DOCTYPE html><meta charset="utf-8">{page}', encoding="utf-8")

    def to_jshtml(self, *args: Any, **options: Any) -> str:
        """A player with all frames as HTML."""
        options = self._player | options
        with rc_context({"animation.embed_limit": NO_LIMIT}), self._still_drawn_once(even=True):
            return str(super().to_jshtml(*args, **options))

    @property
    def _player(self) -> dict[str, Any]:
        """How a player begins."""
        return {"default_mode": "loop" if self.repeats else "once"}

    @contextmanager
    def _still_drawn_once(
        self, even: bool, dpi: Any = None, savefig_kwargs: Any = None, **_: Any
    ) -> Iterator[None]:
        """Has all that does not move replaced by one picture of it, drawn as the frames will be.

        even: whether the frames will have even numbers of dots, as videos and players have.
        """
        figure: Figure = self._fig  # type: ignore[attr-defined]
        raw = io.BytesIO()
        still = [one for one in _not_holding(self.moving, figure) if one.get_visible()]
        spaces: list[Any] = [ax for ax in figure.axes if getattr(ax, "_axis3don", False)]
        layout, picture = figure.get_layout_engine(), None
        size: Any = figure.get_size_inches()
        dots = rcParams["savefig.dpi"] if dpi is None else dpi
        try:
            if even:
                dots = figure.dpi if dots == "figure" else dots
                of_video: Any = adjusted_figsize  # its stub lacks an argument
                figure.set_size_inches(*of_video(*(size * dots).astype(int) / dots, dots, 2))
            for one in self.moving:
                one.set_visible(False)
            with rc_context({"savefig.bbox": None}):  # whole frames, as matplotlib draws them
                figure.savefig(raw, **{"dpi": dots, **(savefig_kwargs or {}), "format": "png"})
            figure.set_size_inches(size)
            for one in self.moving:
                one.set_visible(True)
            for one in still:
                one.set_visible(False)
            for ax in spaces:
                ax.set_axis_off()
            raw.seek(0)
            # Colours in bytes are drawn faster than those in floats.
            picture = figure.figimage(np.rint(255.0 * imread(raw)).astype(np.uint8), zorder=-1.0)
            with rc_context({"figure.autolayout": False, "figure.constrained_layout.use": False}):
                figure.set_layout_engine(None)  # with "none" each frame would be drawn twice
            yield
        finally:
            if picture is not None:
                picture.remove()
            figure.set_size_inches(size)
            figure.set_layout_engine(layout)
            for one in (*still, *self.moving):
                one.set_visible(True)
            for ax in spaces:
                ax.set_axis_on()

    def _repr_html_(self) -> str:
        return self.to_jshtml()


def animate(
    motion: Shown,
    path: str | os.PathLike[str] | None = None,
    *,
    fps: float = 25.0,
    speed: float | None = None,
    span: ArrayLike | None = None,
    dpi: float | None = None,
    progress: bool = False,
    view: Side = "side",
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Film:
    """An animation of the pipe with the path of its free end, with frames at equal time steps.

    The animation plays in a notebook if it is the last value of a cell; `film.save(path)` writes it
    to a file.

    Args:
        motion: a motion; a limit cycle, as from `branch.at(u)` for a branch of a diagram; or a
            basin of `attractors`, whose attracting motion is shown.
        path: a file to write, ending in .gif, .mp4 (by ffmpeg, which must be installed) or .html (a
            page with a player); if not given, no file is written.
        fps: frames a second, from 1 to 50, the most that a GIF can show.
        speed: time of the motion, in T, or in s with units="si", that is shown in a second of the
            animation; with units="si", 1 is real time. If not given, a cycle or swing takes 2.5
            seconds, and all of a motion without swings 8 seconds.
        span: start and end, in T, or in s with units="si"; if not given, the last cycle, which
            repeats without end; the last swing of a motion that grows or is chaotic, once; or all
            of a motion without swings.
        dpi: dots an inch in the file, from 10 to 1000; those of the figure if not given.
        progress: whether to show on stderr how many frames of the file are drawn.
        view: "side" (x, y), or for a model in three dimensions "front" (z, y), "above" (x, z) or
            "space", a picture in perspective.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on, three-dimensional ones for "space"; if not given, those of a new figure
            without a window.

    Returns:
        The animation. Keep a reference to the animation as long as it is shown.

    Example:
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 10), 6.0, 0.4, lambda s: 0.1 * s)
        >>> film = plot.animate(motion, "flutter.gif", fps=5.0, speed=0.2)

    Raises:
        ValueError: for a span outside the times of the motion; for fewer than 2 or more than 2000
            frames, or fewer than 8 in a cycle; for a path with another ending, in a folder that
            does not exist, or to .mp4 if ffmpeg is not found; for fewer than 3 samples, or samples
            too far apart to interpolate; for another view than "side" of a model that moves in a
            plane.
        TypeError: for bad arguments.
    """
    motion, start, end, kind, scale = shown_part(motion, span, units)
    view = _checked_side(view, motion)
    if path is not None:
        path = _checked_path(path)
    fps = check.real("fps", fps, low=1.0, high=50.0)
    options = {} if dpi is None else {"dpi": check.real("dpi", dpi, low=10.0, high=1000.0)}
    shown = check.flag("progress", progress)
    if speed is not None:
        speed = check.real("speed", speed, low=0.0, open_low=True)
    cycle, swing = kind == "cycle", last_swing(motion)
    begin, finish = (start, end) if kind else swing[:2] if swing else (0.0, 0.0)
    unit = scale.one(ELAPSED)
    frames = _frames(unit * (end - start), unit * (finish - begin), fps, speed, scale.time_unit)
    own = ax is None
    if ax is None:
        none: Any = "none"  # whatever the settings of matplotlib say
        ax = Figure(figsize=(4.0, 4.6), layout=none).add_subplot(
            projection="3d" if view == "space" else None
        )
    figure = common.axes(ax, (4.0, 4.6), in_space=view == "space").figure.figure

    one = scale.one(TRANSVERSE)
    times = np.linspace(start, end, frames, endpoint=not cycle)
    shapes = one * _shapes_at(motion, times)
    dots = max(1, math.ceil(400 / frames))
    fine = np.linspace(start, end, dots * (frames - (not cycle)) + 1)
    path_of_tip = seen(one * motion.model.tips(coordinates_at(motion, fine).T), view)
    nothing = path_of_tip[:0].T
    (trace,) = ax.plot(*nothing, color=common.BLUE, linewidth=0.9, zorder=1.8, gid="trace")
    (pipe,) = ax.plot(*nothing, color=common.BLACK, linewidth=2.6, zorder=2.0, gid="pipe")
    flow = _surroundings(ax, motion, shapes, shapes[0], scale, view)

    def move(line: Any, points: Array) -> None:
        (line.set_data_3d if view == "space" else line.set_data)(*points.T)

    times *= unit
    digits = max(0, -math.floor(math.log10(times[1] - times[0])))  # neighbouring times differ

    def show(frame: int) -> Sequence[Any]:
        move(pipe, seen(shapes[frame], view))
        # A cycle repeats, so its whole path is shown from the start.
        move(trace, path_of_tip[: None if cycle else dots * frame + 1])
        if flow is not None:
            flow.set_positions(*seen(flow_ends(motion.model.pipe, shapes[frame], one), view))
        now = f"{times[frame]:.{digits}f}"
        # As mathematics, the digits would take 3 ms more in each frame.
        text.set_text(f"$t$ = {now} s" if scale.si else rf"$\tau$ = {now}")
        return [pipe, trace, text]

    title = ax.set_title(f"{_title(motion, scale)}\n ")
    place: dict[str, Any] = {"transform": title.get_transform(), "ha": "center", "va": "baseline"}
    text = Axes.text(ax, 0.5, 1.0, "", **place, fontsize=title.get_fontsize(), gid="time")
    show(0)
    figure.draw_without_rendering()
    text.set_position(title.get_position())
    if own:  # one layout for all frames: they are then equally large
        figure.subplots_adjust(*ax.get_position(original=True).extents)
    film = Film(figure, show, frames=frames, interval=1000.0 / fps, blit=False)
    film.fps, film.repeats, film.frames, film.progress = fps, cycle, frames, shown
    film.moving = [one for one in (trace, pipe, flow, text) if one is not None]
    if path is not None:
        film.save(path, **options)
    return film


def _not_holding(moving: Sequence[Artist], whole: Artist) -> Iterator[Artist]:
    """Parts of a figure, as large as they come without what moves."""
    for part in whole.get_children():
        if isinstance(part, Axes | SubFigure) and part.findobj(lambda one: one in moving):
            yield from _not_holding(moving, part)
        elif part not in moving:
            yield part


def _checked_path(path: Any) -> Path:
    """The path of a film, refused if no film can be written there."""
    if not isinstance(path, str | os.PathLike) or isinstance(os.fspath(path), bytes):
        raise TypeError(f"path must be a path of a file, got {check.shown(path)}")
    target = Path(path)
    kinds = (".gif", ".mp4", ".html")
    if target.suffix.lower() not in kinds or not target.parent.is_dir():
        rule = "path must end with .gif, .mp4 or .html and lie in a folder that exists"
        raise ValueError(f"{rule}, got {check.shown(path)}")
    if target.suffix.lower() == ".mp4" and not FFMpegWriter.isAvailable():
        rule = "path must end with .gif or .html, since ffmpeg, which writes .mp4, is not installed"
        raise ValueError(f"{rule}, got {check.shown(path)}")
    return target


def _frames(duration: float, period: float, fps: float, speed: float | None, unit: str) -> int:
    """Number of frames of an animation; refuses too many, and too few to show the motion.

    The duration and the period are in `unit`, "T" or "s".

    The period is 0 for a motion without cycles. Without a speed a cycle takes 2.5 s, slow enough to
    follow by eye. With fewer than 2 frames a cycle would seem to run backwards; 8 frames also show
    the shapes between its ends.
    """
    if speed is None:
        speed = period / 2.5 or duration / 8.0
    wanted = duration / speed * fps
    if not wanted <= 2000.0:
        raise ValueError(
            f"span, fps and speed must ask for at most 2000 frames, got {wanted:.4g}: "
            f"{duration:.4g} {unit} at {speed:.4g} {unit} a second, {fps:g} frames a second"
        )
    if 0.0 < period / speed * fps < 8.0 * (1.0 - 1e-9):  # rounding
        raise ValueError(
            f"speed must leave at least 8 frames to a cycle of {period:.4g} {unit}: at {fps:g} "
            f"frames a second at most {period * fps / 8.0:.4g}, got {speed:.4g}"
        )
    if round(wanted) < 2:
        raise ValueError(
            f"speed must leave at least 2 frames to {duration:.4g} {unit}, got {speed:.4g} {unit} "
            "a second"
        )
    return round(wanted)


def _shapes_at(motion: Sampled, times: Array) -> Array:
    """Shapes of the pipe at some times, shape (len(times), points, dimensions)."""
    s = np.linspace(0.0, 1.0, 241)  # contains the joints of chains of 1 to 6, 8, 10 ... segments
    return np.stack([motion.model.shape(q, s) for q in coordinates_at(motion, times)])


def _surroundings(
    ax: Axes, motion: Sampled, shapes: Array, shape: Array, scale: View, view: Side
) -> FancyArrowPatch | None:
    """Draws supports, gravity and flow, and sets axes of equal scale with room for all shapes.

    Returns the arrow of the flow at the free end of `shape`; None if there is no flow.
    """
    pipe, one = motion.model.pipe, scale.one(TRANSVERSE)
    weight = pipe.gamma * np.array([*pipe.down, 0.0])
    if view in ("above", "space"):
        _around_the_axis(ax, weight, shapes, scale, view)
    else:
        columns = list(SIDES[view])
        clamp_and_gravity(ax, tuple(weight[columns].tolist()), seen(shapes, view), scale)
        ax.set_xlabel(scale.label(OF_SHAPES[columns[0]]))
    for s in (*pipe.supports, *(1.0,) * pipe.end_held):  # as long as the way on which it slides
        y = shapes[:, round(s * (shapes.shape[1] - 1)), 1]
        ends = y.min() - 0.03 * one, y.max() + 0.03 * one
        for x in (-0.04 * one, 0.04 * one):
            ax.plot([x, x], ends, color=common.BLACK, linewidth=1.4, zorder=1.6, gid="support")
    if motion.u == 0.0:
        return None
    return _arrow(ax, common.VERMILION, "flow", seen(flow_ends(pipe, shape, one), view))


def _around_the_axis(ax: Any, weight: Array, shapes: Array, scale: View, view: Side) -> None:
    """Draws what a view from above or in space shows besides shapes (..., 3), with equal scales."""
    one = scale.one(TRANSVERSE)
    columns = SIDES[view]
    room = (ARROW + 0.06) * one
    wide = max(0.36 * one, float(np.abs(shapes[..., ::2]).max()) + room)
    low, high = min(-0.12 * one, float(shapes[..., 1].min())), float(shapes[..., 1].max()) + room
    ends = {0: (-wide, wide), 1: (low, high), 2: (-wide, wide)}
    # So x, y and z stay right-handed, with gravity into the page or down it.
    inverted = 2 if weight[1] < 0.0 else 1
    ends[inverted] = ends[inverted][::-1]
    for name, column in zip("xyz", columns, strict=False):
        label = scale.label(OF_SHAPES[column])
        short = label[label.index("$") :]  # long ones have no room in space
        shown = {"lim": ends[column], "label": label if view == "above" else short}
        ax.set(**{f"{name}{key}": value for key, value in shown.items()})
    ax.locator_params(nbins=SIGNED_TICKS)
    point: dict[str, Any] = {"color": common.BLACK, "marker": "s", "markersize": 5.0}
    ax.plot(*np.zeros((len(columns), 1)), **point, linestyle="none", zorder=2.5, gid="clamp")
    dashed: dict[str, Any] = {"color": "0.6", "linewidth": 0.6, "linestyle": (0, (6, 4))}
    if view == "above":
        ax.set_aspect("equal", adjustable="box")
        ax.axhline(0.0, **dashed, zorder=0.5)
        ax.axvline(0.0, **dashed, zorder=0.5)
        return
    ax.set_box_aspect((2.0 * wide, 2.0 * wide, high - low), zoom=0.82)
    far = float(f"{0.7 * wide:.1g}")
    ax.set(xticks=(-far, far), yticks=(-far, far))
    ax.tick_params(pad=-2.0, labelsize="small")
    ax.tick_params(axis="z", pad=2.0)
    for axis, pad in ((ax.xaxis, -7.0), (ax.yaxis, -3.0), (ax.zaxis, 2.0)):
        axis.labelpad = pad
    ax.plot([0.0, 0.0], [0.0, 0.0], [0.0, high], **dashed)
    if weight.any():
        tail = np.array([-0.8 * wide, 0.8 * ends[2][0], 0.0])
        head = tail + 0.3 * one / np.linalg.norm(weight) * weight[list(columns)]
        _arrow(ax, common.BLACK, "gravity", (tail, head))
        ax.text(*(0.5 * (tail + head)), "  $g$", va="center")


def clamp_and_gravity(ax: Axes, weight: tuple[float, float], shapes: Array, view: View) -> None:
    """Draws clamp and gravity, and sets axes of equal scale with room for shapes and an arrow.

    The weight has components (x, y); the shapes, of shape (..., 2), are in the units shown.
    """
    one = view.one(TRANSVERSE)
    ax.set(xlabel=view.label(TRANSVERSE), ylabel=view.label(AXIAL))
    room = (ARROW + 0.06) * one
    low = min(-0.12 * one, float(shapes[..., 1].min()) - room)
    high = float(shapes[..., 1].max()) + room
    # In narrow axes labels of ticks would lie on one another.
    place = ax.get_position(original=True).transformed(ax.figure.transSubfigure)
    wide = 0.5 * (high - low) * place.width / place.height
    wide = max(0.36 * one, wide, float(np.abs(shapes[..., 0]).max()) + room)
    ax.locator_params(axis="x", nbins=SIGNED_TICKS)
    ax.set_aspect("equal", adjustable="box")
    ax.set(xlim=(-wide, wide), ylim=(low, high) if weight[1] < 0.0 else (high, low))
    hatched: dict[str, Any] = {"facecolor": "0.92", "edgecolor": "0.35", "hatch": "////"}
    corner, width, height = (-0.1 * one, -0.06 * one), 0.2 * one, 0.06 * one
    ax.add_patch(Rectangle(corner, width, height, zorder=1.5, gid="clamp", **hatched))
    ax.plot([-0.1 * one, 0.1 * one], [0.0, 0.0], color=common.BLACK, linewidth=1.4, zorder=1.6)
    ax.axvline(0.0, color="0.6", linewidth=0.6, linestyle=(0, (6, 4)), zorder=0.5)
    if any(weight):
        across, down = (0.16 * one * part / math.hypot(*weight) for part in weight)
        at = -min(wide - 0.1 * one - 0.4 * abs(across), 0.34 * one)  # middle of the arrow
        start = (-0.06 if weight[1] >= 0.0 else 0.1) * one
        ends = (at - 0.5 * across, start), (at + 0.5 * across, start + down)
        _arrow(ax, common.BLACK, "gravity", ends)
        # To the right of a vertical arrow, and on the other side of one that points at the clamp.
        turned = math.copysign(0.45, across * down or 1.0)
        aside = (-0.45 * abs(down), turned * abs(across)) if across else (0.0, 0.0)
        beside: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
        beside |= {"xytext": (0, 0), "ha": "center"} if across else {"xytext": (6, 0)}
        ax.annotate("$g$", (at + aside[0], start + 0.5 * down + aside[1]), **beside)


class _Arrow(FancyArrowPatch):
    """An arrow between two points in a plane or, on three-dimensional axes, in space."""

    def set_positions(self, tail: Any, head: Any) -> None:
        self._ends = np.array([tail, head])
        if len(tail) == 2:
            super().set_positions(tail, head)

    def do_3d_projection(self) -> float:
        """Places the arrow on the page; returns how near it is, by which matplotlib sorts."""
        axes: Any = self.axes
        x, y, depth = proj3d.proj_transform(*self._ends.T, axes.M)
        super().set_positions((x[0], y[0]), (x[1], y[1]))
        return float(np.min(depth))


def _arrow(ax: Axes, colour: str, gid: str, ends: Any) -> FancyArrowPatch:
    look: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 11.0, "linewidth": 1.8}
    look |= {"color": colour, "shrinkA": 0, "shrinkB": 0, "zorder": 3, "gid": gid}
    arrow = _Arrow(tuple(ends[0][:2]), tuple(ends[1][:2]), **look)
    arrow.set_positions(*ends)
    ax.add_patch(arrow)
    return arrow


def flow_ends(pipe: Pipe, shape: Array, one: float) -> Array:
    """Tail and head of the arrow of the flow at the free end; `one` is the length of the pipe."""
    step = shape[-1] - shape[-2]
    along = step / np.linalg.norm(step)
    cos, sin = math.cos(angle := pipe.jet_angle), math.sin(angle)
    along[:2] = cos * along[0] + sin * along[1], cos * along[1] - sin * along[0]
    near, far = (shape[-1] + length * along for length in (0.02 * one, ARROW * one))
    return np.array([near, far] if pipe.flow == "ejecting" else [far, near])


# ---------------------------------------------------------------------------------- between samples


DRAWN_POINTS = 4000
"""Desired number of points of a curve: two for each pixel of a picture 2000 pixels wide."""

DRAWN_A_CYCLE = 64.0
"""Desired number of points in a mean cycle, which then shows no corners in a phase portrait."""


def checked_motion(
    motion: Any, name: str = "motion", start: Any = None, units: Any = "nondimensional"
) -> Sampled:
    """The motion to draw, from a time in some units on, for a motion, a limit cycle or a basin."""
    if isinstance(motion, Basin):
        motion = motion.motion
    if not isinstance(motion, LimitCycle):
        check.instance(name, motion, Motion)
    checked: Sampled = motion
    if checked.t.size < 3:
        raise ValueError(
            f"{name} must have at least 3 samples, got {checked.t.size}: compute it with more "
            "`samples=`"
        )
    if start is None:
        return checked
    view = View(units, checked.model.pipe)
    t = view.one(ELAPSED) * checked.t
    first = int(np.searchsorted(t, check.real("start", start)))
    if checked.t.size - first < 3:
        raise ValueError(
            f"start must leave at least 3 samples of {name}, whose third last is at "
            f"{t[-3]:g} {view.time_unit}, got {start:g}"
        )
    return _part(checked, slice(first, None))


def _part(motion: Sampled, held: slice) -> Sampled:
    """Some samples of a motion."""
    names = {"t", "q", "qdot", "tip", "energy", "flow_speed"} & vars(motion).keys()
    return replace(motion, **{name: getattr(motion, name)[held] for name in names})


def checked_motions(
    motions: Any, start: Any, units: Any, name: str = "motions", others: str = ""
) -> tuple[list[Sampled], list[int]]:
    """Motions of the argument `name`, from the time `start` on, which is in some units.

    The second value holds the indices of members of an ensemble that failed and are left out.
    `others` names what else the argument may be.
    """
    if isinstance(motions, Motion | LimitCycle | Basin):
        return [checked_motion(motions, name, start, units)], []
    several: Any = motions.basins if isinstance(motions, Attractors) else motions
    failures = {}
    if isinstance(motions, Ensemble):
        several, failures = motions.motions, {one.index: one.error for one in motions.failures}
    if not isinstance(several, Sequence) or isinstance(several, str):
        kinds = f"{others or 'Attractors, '}a Motion, several of them or an Ensemble"
        raise TypeError(f"{name} must be {kinds}, got {check.shown(motions)}")
    if not several:
        raise ValueError(f"{name} must hold at least one, got none")
    if len(failures) == len(several):
        first = next(iter(failures.values()))
        raise ValueError(f"{name} must have a member that did not fail, the first: {first}")
    chosen = [
        checked_motion(one, f"{name}[{i}]", start, units)
        for i, one in enumerate(several)
        if i not in failures
    ]
    return chosen, list(failures)


def tip_path_of(motion: Sampled) -> Cubics:
    """Position (x, y) of the free end as a function of time."""
    return scipy.interpolate.CubicHermiteSpline(motion.t, motion.tip, motion.tip_velocity)


def coordinates_at(motion: Sampled, times: Array) -> Array:
    """Coordinates at some times of a motion, shape (len(times), coordinates)."""
    return np.asarray(scipy.interpolate.CubicHermiteSpline(motion.t, motion.q, motion.qdot)(times))


def is_coarse(
    curve: scipy.interpolate.PPoly, *, invisible: float = 0.0, rates_shown: bool = False
) -> bool:
    """Whether samples are too far apart for a curve through them, as `coarse` judges it."""
    return coarse(curve.x, curve(curve.x), curve(curve.x, 1), invisible, rates_shown=rates_shown)


def refuse_coarse(name: str, t: Array, found: bool) -> None:
    """Raises ValueError if the samples of a motion were found too far apart for a curve."""
    if found:
        raise ValueError(
            f"{name} must be sampled at least six times a cycle of the fastest visible motion, got "
            f"samples {np.diff(t).max():.3g} T apart: compute it with more `samples=`"
        )


def last_swing(motion: Sampled) -> tuple[float, float, bool] | None:
    """Start and end of the last cycle or swing, and whether it is a cycle; None if there is none.

    It ends at the last crossing, at which the position of the free end rises through its median
    over the last quarter of the time. A cycle starts at the latest earlier crossing with the same
    state to 3 %, and the cycle before is the same: a chaotic motion comes near an earlier state by
    chance. If there is none, as in a growing motion too, a swing starts at the crossing before the
    last one. If the free end is held by a support, the coordinate that moves most is taken instead.
    """
    curve = tip_path_of(motion)
    if np.ptp(motion.tip[:, 0]) <= LEAST_MOTION:
        order = np.argsort(-np.ptp(motion.q, axis=0))
        position, velocity = motion.q[:, order], motion.qdot[:, order]
        curve = scipy.interpolate.CubicHermiteSpline(motion.t, position, velocity)
    late = np.linspace(motion.t[-1] - 0.25 * np.ptp(motion.t), motion.t[-1], DRAWN_POINTS)
    x = scipy.interpolate.PPoly(curve.c[..., 0], curve.x)
    if np.ptp(x(late)) < 1e-6:  # the pipe is at rest up to errors of integration
        return None
    crossings = x.solve(float(np.median(x(late))), extrapolate=False)
    crossings = crossings[x(crossings, 1) > 0.0]  # also removes NaN, given for pieces at rest
    between = np.split(x(motion.t), np.searchsorted(motion.t, crossings))[1:]
    swings = np.array([np.ptp(part) if part.size else 0.0 for part in between])
    swings[-1:] = math.inf
    # Smaller swings are not cycles. A motion without a period in 51 crossings counts as aperiodic.
    crossings = crossings[swings > 0.1 * np.ptp(x(late))][-51:]
    if crossings.size < 2:
        return None
    rates = curve(crossings, 1) / np.abs(curve(late, 1)).max()
    states = np.column_stack([curve(crossings)[:, 1:], rates])
    same = np.flatnonzero(np.abs(states[:-1] - states[-1]).max(axis=1) < 0.03)
    end = float(crossings[-1])
    for start in crossings[same[-1:]]:
        if 2.0 * start - end >= motion.t[0]:
            times = np.linspace(start, end, 201)
            now, before = (coordinates_at(motion, times - past) for past in (0.0, end - start))
            if np.abs(now - before).max() < 0.03 * np.ptp(now):
                return float(start), end, True
    return float(crossings[-2]), end, False


def repeated_cycle(motion: Sampled) -> tuple[float, float] | None:
    """Start and end of a limit cycle, or of the last cycle; None where there is none."""
    if isinstance(motion, LimitCycle):
        return float(motion.t[0]), float(motion.t[-1])
    found = last_swing(motion)
    return found[:2] if found and found[2] else None


def shown_part(motion: Any, span: Any, units: Any) -> tuple[Sampled, float, float, str, View]:
    """Samples around the part to show, its start and end in T, and "cycle" or "swing" if it is one.

    The last value converts to the units, those of the given span too.
    """
    closed = isinstance(motion, LimitCycle)
    motion = checked_motion(motion)
    view = View(units, motion.model.pipe)
    begin, finish = float(motion.t[0]), float(motion.t[-1])
    found = None
    if span is None:
        found = (begin, finish, True) if closed else last_swing(motion)
    start, end, cycle = found or (begin, finish, False)
    kind = ("cycle" if cycle else "swing") if found else ""
    if span is not None:
        unit = view.one(ELAPSED)
        first, last = map(float, check.array("span", span, size=2))
        if not unit * begin <= first < last <= unit * finish:
            raise ValueError(
                "span must be a start and a later end within the motion's times, "
                f"[{unit * begin:g}, {unit * finish:g}] {view.time_unit}, got {check.shown(span)}"
            )
        start, end = max(first / unit, begin), min(last / unit, finish)  # rounding
    # The samples that enclose the span are kept, with two more on either side if there are any.
    low = max(int(np.searchsorted(motion.t, start, side="right")) - 3, 0)
    held = slice(low, int(np.searchsorted(motion.t, end, side="left")) + 3)
    shown = _part(motion, held)
    refuse_coarse("motion", shown.t, is_coarse(tip_path_of(shown), invisible=INVISIBLE))
    return shown, start, end, kind, view
