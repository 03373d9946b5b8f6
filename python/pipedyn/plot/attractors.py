# SPDX-License-Identifier: MIT
"""Pictures of attractors and motions: basins, Poincare sections, spectra and films."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any, Literal

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pipedyn.attraction.attractors import Attractors, Basin, Share, section
from pipedyn.diagram import BifurcationDiagram
from pipedyn.models.drive import Harmonic, Pulsation
from pipedyn.motion.sampling import farthest_direction
from pipedyn.motion.simulate import Ensemble, Motion, simulate
from pipedyn.plot import common
from pipedyn.plot.arrange import legend_below
from pipedyn.plot.motion import (
    SIGNED_TICKS,
    Film,
    Side,
    Signal,
    animate,
    checked_motions,
    explain,
    refuse_coarse,
    signals,
    widen,
)
from pipedyn.plot.units import (
    AMPLITUDE,
    DENSITY,
    ELAPSED,
    GROWTH,
    OMEGA,
    Measure,
    Units,
    View,
    of_coordinate,
    rate,
)
from pipedyn.util import check

FILLS = ("#0072B2", "#F0E442", "#56B4E9", "#8C3B00", "#009E73", "#E9C6DA", "#333333", "#E69F00")
"""Colours of basins. Neighbours in this list differ in lightness, so that they differ in grey."""

UNSETTLED, FAILED = "0.75", "#FFFFFF"

SHAPES = ("o", "s", "^", "D", "v", "P", "X", "h")
"""Markers of attractors at rest, and of points in Poincare sections."""

FILMED = 10.0
"""Duration of the motion in a film of an irregular motion, in T: some twenty swings of flutter."""

LOWEST_LINE = 1e-5
"""Height, as a share of the highest line, below which a spectrum is not shown, because errors of
motions are as large."""

FEW_POINTS = 100
"""Number of points in a section of a motion up to which their markers are large."""

FEWEST_IN_SEGMENT, MOST_IN_SPECTRUM = 16, 2**21
"""Least number of samples in a segment of Welch's method, and largest number of samples to which a
motion with uneven samples is interpolated."""


def basins(
    found: Attractors,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Basins of attraction: the attractor on which the motion from each start of a plane ends.

    Each attractor has a colour, and the legend gives its share of the starts. A white marker, also
    in the legend, shows an equilibrium that lies in the plane. Starts whose motions end on an
    unstable equilibrium or cycle belong to no basin: crosses show them, over the colour of the
    nearest start of a basin. Starts whose motions did not settle are grey, and those whose motions
    failed are white. Coordinates are those of the model, counted from 0.

    Args:
        found: attractors from a `StartPlane` of at least 2 values along both axes.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether the basins have a legend.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> angles = np.linspace(-1.0, 1.0, 5)
        >>> model = pp.Chain(pp.Pipe(0.2, -30.0), 2)
        >>> found = pp.attractors(model, 4.1, pp.StartPlane(angles, angles))
        >>> ax = plot.basins(found)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check.instance("found", found, Attractors)
    plane = found.plane
    if plane is None or min(plane.shape) < 2:
        rule = "found must come from a StartPlane of at least 2 values along both axes"
        raise ValueError(f"{rule}, got {len(found.starts)} starts of another kind")
    legend = check.flag("legend", legend)
    view = View(units, found.model.pipe)
    entries = tuple(_state_entry(found, index, "initial ") for index in plane.indices)
    x, y = (view.one(of) * at for of, at in zip(entries, (plane.x, plane.y), strict=True))
    ax = view.axes(ax, (6.4, 4.6), *entries)
    colours = [fill for fill, _ in zip(cycle(FILLS), found.basins, strict=False)]
    shades = ListedColormap([FAILED, UNSETTLED, *colours])
    steps = BoundaryNorm(np.arange(-2.5, len(colours) + 0.5), shades.N)
    ends = found.ends.reshape(plane.shape)
    unstable = [
        k for k, one in enumerate(found.basins) if not one.attracts and one.attractor.repeats
    ]
    apart = np.isin(ends, unstable)
    shown = ends
    if not apart.all():
        _, nearest = scipy.ndimage.distance_transform_edt(apart, return_indices=True)
        shown = ends[tuple(nearest)]
    ax.pcolormesh(x, y, shown, cmap=shades, norm=steps, rasterized=True)
    named: dict[str, Any] = {}
    for k, (one, fill) in enumerate(zip(found.basins, colours, strict=True)):
        name, share = _name(found, k, view), one.share
        if k not in unstable:
            named[f"{name}, {_percent(share)}"] = Patch(facecolor=fill, edgecolor="0.3")
            continue
        rows, columns = np.nonzero(ends == k)
        cross: dict[str, Any] = {"marker": "x", "linestyle": "none", "zorder": 2.5}
        cross |= {"markersize": 5.0, "color": "white", "markeredgewidth": 1.6}
        (behind,) = ax.plot(x[columns], y[rows], **cross)
        behind.set(markersize=6.5, markeredgewidth=3.2, color="black", zorder=2.4)
        ax.plot(x[columns], y[rows], gid=f"unstable {k}", **cross)
        named[f"{name}, unstable, {check.how_many(share.count, 'start')}"] = behind
    for share, fill, words in (
        (found.unsettled, UNSETTLED, "not settled"),
        (found.failed, FAILED, "failed"),
    ):
        if share.count:
            named[f"{words}, {_percent(share)}"] = Patch(facecolor=fill, edgecolor="0.3")
    for k, basin in enumerate(found.basins):
        if basin.ending == "rest" and k not in unstable:
            end = np.append(basin.motion.q[-1], basin.motion.qdot[-1])[list(plane.indices)]
            end = end * list(map(view.one, entries))
            inside = x[0] <= end[0] <= x[-1] and y[0] <= end[1] <= y[-1]
            if inside:
                look = common.open_marker(6.0, marker=SHAPES[k % len(SHAPES)], zorder=3.0)
                (mark,) = ax.plot(*end, gid=f"rest {k}", **look)
                entry = f"{_name(found, k, view)}, {_percent(basin.share)}"
                named[entry] = (named[entry], mark)  # one over the other
    if legend:
        legend_below(ax, named)
    ax.set_title(f"{view.speed(found.u, 6)}, {found.model.pipe.flow}")
    return ax


def _percent(share: Share) -> str:
    return f"{100.0 * share.value:.3g} %"


def poincare_section(
    found: Attractors | Basin | Motion | Sequence[Motion] | Ensemble,
    coordinate: Literal["tip"] | int = "tip",
    *,
    start: float | None = None,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Poincare sections of attractors or motions: states at maxima of the free end's position.

    A cycle shows as many points as it has maxima in a period, a torus lines, and chaos a cloud. The
    picture shows a coordinate against its rate; for "tip" it shows the position of the free end
    against the rate of the last coordinate, and in three dimensions x against that of the last a_x.
    If a `Pulsation` of the flow or a `Harmonic` motion of the base drives the pipe, or the force of
    `attractors`, sections are stroboscopic: they hold the states at the beginnings of the periods
    of the drive. The title says which. Between samples of motions, states are those of quintic
    splines; the title says where a mean cycle has fewer than ten samples.

    Args:
        found: attractors; one of the basins; one or several motions; or an ensemble, whose failed
            members are left out. What rests has no section.
        coordinate: "tip" for the transverse position of the free end, or the index of a coordinate,
            counted from 0.
        start: time from which motions are shown, in T, or in s with units="si", to leave out a
            transient; all if not given. Attractors have none.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether attractors or several motions have a legend.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.poincare_section(found)
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 2), 4.0, 30.0, lambda s: 0.1 * s)
        >>> ax = plot.poincare_section(motion, start=20.0)

    Raises:
        ValueError: for motions of fewer than 3 samples from `start` on, or samples too far apart to
            interpolate; for an index that a model does not have; for a `start` of attractors.
        TypeError: for bad arguments.
    """
    given = _Given(found, start, units)
    legend = check.flag("legend", legend)
    index, across = of_coordinate(coordinate, min(model.coordinates for model in given.models))
    lasts = [model.coordinates // (model.dimensions - 1) - 1 for model in given.models]
    last = set(lasts) if index is None else {index}
    upward = rate(last.pop() if len(last) == 1 else r"\mathrm{last}")
    ax = given.view.axes(ax, (4.8, 4.2), across, upward)
    pairs = zip(given.shown, given.basins, strict=True)
    handles = dict[Any, Any]()
    periods = [of.drive_period if of else _drive_period(one.motion) for one, of in pairs]
    for one, basin, period, final, marker in zip(
        given.shown, given.basins, periods, lasts, cycle(SHAPES), strict=False
    ):
        points = _section_points(one, period) if basin is None else basin.section
        if not len(points):
            continue
        q, qdot = np.split(points, 2, axis=1)
        x = one.motion.model.tips(q.T)[:, 0] if index is None else q[:, index]
        rates = qdot[:, final if index is None else index]
        few = len(points) <= FEW_POINTS or (basin is not None and basin.attractor.repeats)
        look: dict[str, Any] = {"linestyle": "none", "marker": marker, "markeredgewidth": 0.0}
        look |= {"color": one.look["color"], "label": one.label}
        size = 5.0 if few else 2.0
        place = one.view.one(across) * x, one.view.one(upward) * rates
        ax.plot(*place, markersize=size, **look)
        handles[one.label] = Line2D([], [], markersize=5.0, **look)
    if handles:
        ax.margins(0.08)
        widen(ax, "xy")
        ax.locator_params(axis="x", nbins=SIGNED_TICKS)
    along = " along $x$" if any(model.dimensions == 3 for model in given.models) else ""
    where = {True: "once a period of the drive", False: f"at maxima of {given.view.end}{along}"}
    lines = dict.fromkeys(where[period > 0.0] for period in periods) if handles else ()
    given.explain(ax, handles, *lines, legend=legend)
    return ax


def spectrum(
    found: Attractors | Basin | Motion | Sequence[Motion] | Ensemble,
    *,
    start: float | None = None,
    segments: int = 8,
    decibels: bool = False,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Spectra of the transverse motion of the free end, of attractors or of motions.

    In three dimensions they are those of the displacement along x.

    The spectrum of an attractor is the amplitude over the frequency; that of a cycle is drawn as
    stems at its harmonics. The spectrum of a motion is its power spectral density by Welch's
    method: the mean over half-overlapping segments, each with Hann's window and without its mean,
    weighted by that window. The integral of the density over the frequencies shown is the mean
    square of the motion about its mean. Uneven samples are interpolated by cubics, at steps of the
    least distance between two. The title says where a mean cycle has fewer than ten samples.

    Frequencies are in Hz with units="si", and angular (omega T) otherwise.

    Args:
        found: attractors; one of the basins; one or several motions; or an ensemble, whose failed
            members are left out. What rests has no spectrum.
        start: time from which motions are shown, in T, or in s with units="si", to leave out a
            transient; all if not given. Attractors have none.
        segments: number of segments, for motions; fewer if a segment would have less than 16
            samples. More segments make a smoother curve, fewer a finer resolution.
        decibels: whether the ordinate is linear in decibels, 10 log10 of the density or 20 log10 of
            the amplitude; otherwise it is logarithmic.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether attractors or several motions have a legend.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.spectrum(found)
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 2), 4.0, 30.0, lambda s: 0.1 * s)
        >>> ax = plot.spectrum(motion, start=10.0, decibels=True)

    Raises:
        ValueError: for motions of fewer than 3 samples from `start` on, or samples too far apart to
            interpolate; for a `start` of attractors.
        TypeError: for bad arguments.

    Source: Welch (1967), The use of fast Fourier transform for the estimation of power spectra,
    IEEE Transactions on Audio and Electroacoustics 15, 70-73.
    """
    given = _Given(found, start, units)
    segments = check.count("segments", segments, high=10_000)
    decibels, legend = check.flag("decibels", decibels), check.flag("legend", legend)
    of_motions = any(basin is None for basin in given.basins)
    quantity, power = (DENSITY, 2) if of_motions else (AMPLITUDE, 1)
    ax = given.view.axes(ax, (6.4, 3.6), OMEGA, quantity)
    highest, last, drawn = 0.0, 0.0, list[Any]()
    for one, basin in zip(given.shown, given.basins, strict=True):
        if basin is None:
            omega, height = _density(one, segments)
        else:  # without the mean value at frequency 0
            omega, height = basin.frequencies[1:], basin.spectrum[1:]
        if not height.any():
            continue
        omega, height = one.view.one(OMEGA) * omega, one.view.one(quantity) * height
        highest = max(highest, float(height.max()))
        last = max(last, float(omega[height > LOWEST_LINE**power * height.max()][-1]))
        drawn.append((one, omega, height, basin is not None and basin.attractor.repeats))

    def ordinate(height: Any) -> Any:
        return 20.0 / power * np.log10(height) if decibels else height

    for one, omega, height, stems in drawn:
        if stems:
            tops = height > (floor := LOWEST_LINE * height.max())
            line: dict[str, Any] = {"color": one.look["color"], "linewidth": 1.0}
            ax.vlines(omega[tops], ordinate(floor), ordinate(height[tops]), **line)
            look: dict[str, Any] = {"marker": "o", "markersize": 3.5, "linestyle": "none"}
            look |= {"color": one.look["color"]}
            ax.plot(omega[tops], ordinate(height[tops]), label=one.label, **look)
        else:
            look = {"linewidth": 1.0 if of_motions else 0.7} | one.look
            ax.plot(omega, ordinate(np.maximum(height, 1e-300)), label=one.label, **look)
    if drawn:
        ax.set_yscale("linear" if decibels else "log")
        ends = ordinate(LOWEST_LINE**power * highest), ordinate(3.0 * highest)
        ax.set(xlim=(0.0, 1.05 * last), ylim=ends)
    if decibels:
        label = given.view.label(quantity)
        label = label.replace("(", "(dB re 1 ") if given.view.si else f"{label} (dB)"
        ax.set_ylabel(label)
    handles = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    given.explain(ax, handles, legend=legend)
    return ax


def films(
    found: Attractors | BifurcationDiagram,
    speed: float | None = None,
    *,
    fps: float = 25.0,
    view: Side = "side",
    units: Units = "nondimensional",
) -> dict[str, Film]:
    """Films, by name, of the attractors that are not at rest, each on a figure of its own.

    For a diagram, the films show the stable cycles and circular motions at a flow speed, and the
    irregular motions at that speed, which are continued from their ends for a time of 10 T.

    Args:
        found: attractors, or a diagram.
        speed: flow speed u, one of the diagram's; not used for attractors.
        fps: frames a second, as for `animate`.
        view: from where the pipe is seen, as for `animate`.
        units: "nondimensional", or "si" if the pipe has scales.

    Example:
        >>> diagram = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0])
        >>> for name, film in plot.films(diagram, 4.0, fps=4.0).items():
        ...     film.save(f"{name}.gif")

    Raises:
        ValueError, TypeError: for bad arguments, and for motions that `animate` refuses.
    """
    how: dict[str, Any] = {"fps": check.real("fps", fps, low=1.0, high=50.0), "units": units}
    how["view"] = view
    if isinstance(found, Attractors):
        moving = [k for k, basin in enumerate(found.basins) if basin.ending != "rest"]
        scale = View(units, found.model.pipe)
        return {_name(found, k, scale): animate(found.basins[k], **how) for k in moving}
    diagram: BifurcationDiagram = check.instance("found", found, BifurcationDiagram)
    speed = check.real("speed", speed, low=0.0)
    if not np.isclose(diagram.speeds, speed, rtol=1e-12, atol=0.0).any():
        raise ValueError(f"speed must be one of the diagram's speeds, got {speed:g}")
    cycles = [one for branch in diagram.cycles for one in branch.at(speed) if one.stable]
    made = {f"cycle {k}": animate(one, **how) for k, one in enumerate(cycles)}
    circles = [one for branch in diagram.rotating for one in branch.at(speed) if one.stable]
    begins = {f"circle {k}": np.append(one.q, one.qdot) for k, one in enumerate(circles)}
    for one in diagram.at(speed):
        if not (one.repeats or one.ending == "failed"):
            begins[f"motion from start {one.start}"] = one.end
    for name, state in begins.items():
        motion = simulate(diagram.model, speed, FILMED, *np.split(state, 2))
        span = View(units, motion.model.pipe).one(ELAPSED) * motion.t[[0, -1]]
        made[name] = animate(motion, span=span, **how)
    return made


def _drive_period(motion: Any) -> float:
    """Period of what drives a motion; 0 if that is steady or has no one period."""
    moving = [one for one in (motion.u, motion.base) if not isinstance(one, float | None)]
    if not all(isinstance(one, Pulsation | Harmonic) for one in moving):
        return 0.0
    known = {one.frequency for one in moving}
    return 2.0 * math.pi / known.pop() if len(known) == 1 else 0.0


def _section_points(one: Signal, drive: float) -> Any:
    """Poincare section of a motion, shape (K, 2 coordinates)."""
    states = one.motion.y.T
    if not one.moves:
        return states[:0]
    degree = min(5, len(states) - 1)
    spline = scipy.interpolate.make_interp_spline(one.motion.t, states, degree)

    def at(t: Any) -> Any:
        return np.ascontiguousarray(spline(t).T)

    direction = farthest_direction(one.motion.tip)
    return section(one.motion.model, at, one.motion.t, drive, direction)


def _density(one: Signal, segments: int) -> tuple[Any, Any]:
    """Angular frequencies and power spectral density over them; 0 for what rests."""
    t = one.curve.x
    size = min(round(np.ptp(t) / float(np.diff(t).min())) + 1, MOST_IN_SPECTRUM)
    t = np.linspace(t[0], t[-1], size)
    length = min(max(2 * size // (segments + 1), FEWEST_IN_SEGMENT), size)
    x = one.curve(t) * one.moves
    hann = scipy.signal.get_window("hann", length)

    def centred(parts: Any) -> Any:  # of the plain mean, the window would spread the rest
        return parts - np.average(parts, axis=-1, weights=hann)[..., None]

    rate = 1.0 / float(t[1] - t[0])
    hertz, density = scipy.signal.welch(x, rate, hann, detrend=centred)
    return 2.0 * math.pi * hertz[1:], density[1:] / (2.0 * math.pi)


class _Given:
    """What the argument `found` holds: motions, and the basins that they belong to.

    Attributes:
        shown: the motions, as signals with names.
        basins: the basin of each motion; None for motions that were given themselves.
        models: models of the motions, at least one.
        view: units of the picture.
    """

    def __init__(self, found: Any, start: Any, units: Units) -> None:
        self.failed, basins = list[int](), list[Basin]()
        if isinstance(found, Attractors | Basin):
            basins = [found] if isinstance(found, Basin) else list(found.basins)
            if start is not None:
                rule = "start must be None for attractors, whose records begin on them"
                raise ValueError(f"{rule}, got {check.shown(start)}")
            motions: list[Any] = [basin.motion for basin in basins]
        else:
            others = "Attractors, a Basin, "
            motions, self.failed = checked_motions(found, start, units, "found", others)
            for motion in motions:
                check.instance("found", motion, Motion, f"{others}a Motion or several")
        self.basins: list[Basin | None] = [*basins] or [None] * len(motions)
        self.models = [one.model for one in motions] or [found.model]
        self.view = View(units, self.models[0].pipe)
        self.shown = signals(motions, None, units, rates_shown=False)
        for one in self.shown[len(basins) :]:  # attractors bring their sections and spectra
            refuse_coarse("found", one.motion.t, one.dotted)
        for k, (one, basin) in enumerate(zip(self.shown, basins, strict=False)):
            named = isinstance(found, Attractors)
            one.label = _name(found, k, self.view) if named else _kind(basin, self.view)

    def explain(self, ax: Axes, handles: Any, *lines: str, legend: bool) -> None:
        """Adds a legend, a title with some lines, and words where nothing moves."""
        if not handles:
            words = "all are at rest" if self.shown[1:] else "at rest"
            words = words if self.shown else "no attractor was found"
            ax.text(0.5, 0.5, words, transform=ax.transAxes, ha="center", va="center")
        alone = len(self.shown) == 1 and self.basins[0] is None
        if legend and not alone and len(handles) <= 12:
            legend_below(ax, handles)
        shown = self.shown if None in self.basins else self.shown[:1]  # at the same speed
        explain(ax, shown, self.failed, *lines, legend=False)


def _kind(basin: Basin, view: View) -> str:
    """The kind of an attractor in words, with the period of a cycle or an exponent."""
    if basin.ending == "rest":
        return "rest"
    if basin.ending in ("periodic", "rotating"):
        unit, name = " s" if view.si else "", "cycle" if basin.ending == "periodic" else "circle"
        return f"{name}, period {basin.period * view.one(ELAPSED):.4g}{unit}"
    exponent = basin.attractor.exponent
    if exponent is None:
        return basin.ending
    value, spread = (view.one(GROWTH) * of for of in (exponent.value, exponent.spread))
    unit = " 1/s" if view.si else ""
    return f"{basin.ending}, exponent {value:.2g} $\\pm$ {spread:.1g}{unit}"


def _name(found: Attractors, k: int, view: View) -> str:
    """Name of an attractor: its number, its kind, and the attractor whose mirror image it is."""
    basin = found.basins[k]
    image = f", mirror image of {basin.mirror_image}" if 0 <= basin.mirror_image < k else ""
    return f"{k}: {_kind(basin, view)}{image}"


def _state_entry(found: Attractors, index: int, before: str) -> Measure:
    """The coordinate or rate at an index of the state [q, q']."""
    half = found.model.coordinates
    if index < half:
        return Measure(f"{before}coordinate $q_{{{index}}}$")
    return rate(index - half, before)
