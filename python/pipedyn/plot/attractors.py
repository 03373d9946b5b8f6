# SPDX-License-Identifier: MIT
"""Pictures of attractors: their basins, Poincare sections and spectra."""

from __future__ import annotations

from itertools import cycle
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from pipedyn.attraction.attractors import Attractors, Basin
from pipedyn.diagram import BifurcationDiagram
from pipedyn.motion.simulate import simulate
from pipedyn.plot import common
from pipedyn.plot.motion import Film, animate
from pipedyn.plot.units import AMPLITUDE, ELAPSED, GROWTH, OMEGA, TIP, Measure, Units, View, rate
from pipedyn.util import check

FILLS = ("#0072B2", "#F0E442", "#56B4E9", "#8C3B00", "#009E73", "#E9C6DA", "#333333", "#E69F00")
"""Colours of basins. Neighbours in the row differ in lightness, so that they do in grey."""

UNSETTLED, FAILED = "0.75", "#FFFFFF"

SHAPES = ("o", "s", "^", "D", "v", "P", "X", "h")
"""Of attractors at rest, and of sections."""

SMALLEST_VIEW = 0.05
"""Share of the largest value that a section's axes span at least: a cycle's points are points."""

FILMED = 10.0
"""Time in a film of an irregular motion: some twenty swings of flutter."""

LOWEST_LINE = 1e-5
"""Part of its highest line below which a spectrum is not shown: what motions err."""


def basins(found: Attractors, *, units: Units = "nondimensional", ax: Axes | None = None) -> Axes:
    """Basins of attraction: which attractor each start of a plane ends on.

    Each attractor has a colour and in the legend its share of the starts. A white marker shows an
    equilibrium that lies in the plane. Starts whose motions did not settle are grey, failed ones
    white. Coordinates are the model's, counted from 0.

    Args:
        found: attractors from a `StartPlane` of at least 2 values along both axes.
        units: "nondimensional", or "si" where the pipe has scales.
        ax: where to draw; new Axes where not given.

    Example:
        >>> angles = np.linspace(-1.0, 1.0, 5)
        >>> model = pp.Chain(pp.Pipe(0.2, -30.0), 2)
        >>> found = pp.attractors(model, 4.1, pp.StartPlane(angles, angles))
        >>> ax = plot.basins(found)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    common.check_type("found", found, Attractors)
    plane = found.plane
    if plane is None or min(plane.shape) < 2:
        rule = "found must come from a StartPlane of at least 2 values along both axes"
        raise ValueError(f"{rule}, got {len(found.starts)} starts of another kind")
    view = View(units, found.model.pipe)
    entries = [_state_entry(found, index, "initial ") for index in plane.indices]
    xlabel, ylabel = map(view.label, entries)
    x, y = (view.one(of) * at for of, at in zip(entries, (plane.x, plane.y), strict=True))
    ax = common.axes(ax, (6.4, 4.6), xlabel=xlabel, ylabel=ylabel)
    colours = [fill for fill, _ in zip(cycle(FILLS), found.basins, strict=False)]
    shades = ListedColormap([FAILED, UNSETTLED, *colours])
    steps = BoundaryNorm(np.arange(-2.5, len(colours) + 0.5), shades.N)
    ends = found.ends.reshape(plane.shape)
    ax.pcolormesh(x, y, ends, cmap=shades, norm=steps, rasterized=True)
    shown = [
        Patch(
            facecolor=colour, edgecolor="0.3", label=f"{_name(found, k, view)}, {_percent(basin)}"
        )
        for k, (colour, basin) in enumerate(zip(colours, found.basins, strict=True))
    ]
    for share, colour, word in (
        (found.unsettled, UNSETTLED, "not settled"),
        (found.failed, FAILED, "failed"),
    ):
        if share.count:
            label = f"{word}, {100.0 * share.value:.3g} %"
            shown.append(Patch(facecolor=colour, edgecolor="0.3", label=label))
    for k, basin in enumerate(found.basins):
        if basin.ending == "rest":
            end = np.append(basin.motion.q[-1], basin.motion.qdot[-1])[list(plane.indices)]
            end = end * list(map(view.one, entries))
            inside = x[0] <= end[0] <= x[-1] and y[0] <= end[1] <= y[-1]
            if inside:
                look = common.open_marker(6.0, marker=SHAPES[k % len(SHAPES)], zorder=3.0)
                ax.plot(*end, gid=f"rest {k}", **look)
    common.legend_below(ax, {str(patch.get_label()): patch for patch in shown})
    ax.set_title(f"{view.speed(found.u, 6)}, {found.model.pipe.flow}")
    view.second_axes(ax, *entries)
    return ax


def poincare_section(
    found: Attractors | Basin,
    coordinate: Literal["tip"] | int = "tip",
    *,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Poincare sections of attractors: states at which the free end is at a maximum.

    A cycle has as many points as maxima in a period, a torus lines, chaos a cloud. Shown is one
    coordinate against the rate of the last, or of the one given; of "tip", the maximum itself
    against that rate. Where a pump or the base drives the pipe, sections are stroboscopic: states
    when a period of that begins.

    Args:
        found: attractors, or one of the basins. Those at rest have no section.
        coordinate: "tip" for the free end's transverse position, or the index of a coordinate,
            counted from 0.
        units: "nondimensional", or "si" where the pipe has scales.
        ax: where to draw; new Axes where not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.poincare_section(found)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    some, model, names = _shown_basins(found, units)
    index, xlabel = common.coordinate_axis(coordinate, model.coordinates)
    last = model.coordinates - 1 if index is None else index
    view = View(units, model.pipe)
    across = TIP if index is None else Measure(xlabel)
    driven = any(basin.motion.base or not isinstance(basin.motion.u, float) for basin in some)
    place = "once a period" if driven else "at a maximum of the free end"
    shown = rate(last, "", f" {place}")
    labels = {"xlabel": view.label(across), "ylabel": view.label(shown)}
    ax = common.axes(ax, (4.8, 4.2), **labels)
    looks = zip(cycle(SHAPES), cycle(common.CURVE_STYLES), strict=False)
    drawn = 0
    for basin, name, (marker, style) in zip(some, names, looks, strict=False):
        if not len(basin.section):
            continue
        q, qdot = np.split(basin.section, 2, axis=1)
        x = model.tips(q.T)[:, 0] if index is None else q[:, index]
        few = basin.ending == "periodic"
        look: dict[str, Any] = {"linestyle": "none", "marker": marker, "color": style["color"]}
        look |= {"label": name, "markersize": 5.0 if few else 2.0, "markeredgewidth": 0.0}
        ax.plot(view.one(across) * x, view.one(shown) * qdot[:, last], **look)
        drawn += 1
    if drawn:
        common.legend_below(ax)
        ax.margins(0.08)
        for place, limits in (
            (ax.dataLim.intervalx, ax.set_xlim),
            (ax.dataLim.intervaly, ax.set_ylim),
        ):
            least = SMALLEST_VIEW * float(np.abs(place).max())
            if np.ptp(place) < least:
                limits(place.mean() - least, place.mean() + least)
        view.second_axes(ax, across, shown)
    else:
        ax.text(0.5, 0.5, "all are at rest", transform=ax.transAxes, ha="center", va="center")
    return ax


def spectrum(
    found: Attractors | Basin, *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Amplitude of the free end's transverse motion by frequency, of each attractor that moves.

    Lines of a cycle are drawn as stems at its harmonics. The upper axis is in Hz if the pipe's
    numbers come from SI units.

    Args:
        found: attractors, or one of the basins.
        units: "nondimensional", or "si" where the pipe has scales.
        ax: where to draw; new Axes where not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.spectrum(found)

    Raises:
        TypeError: for bad arguments.
    """
    some, model, names = _shown_basins(found, units)
    view = View(units, model.pipe)
    labels = {"xlabel": view.label(OMEGA), "ylabel": view.label(AMPLITUDE)}
    ax = common.axes(ax, (6.4, 3.6), **labels)
    highest, last = 0.0, 0.0
    for basin, name, style in zip(some, names, cycle(common.CURVE_STYLES), strict=False):
        omega = view.one(OMEGA) * basin.frequencies[1:]  # without its mean
        height = view.one(AMPLITUDE) * basin.spectrum[1:]
        if not height.size:
            continue
        large = height > LOWEST_LINE * height.max()
        highest = max(highest, float(height.max()))
        last = max(last, float(omega[large][-1]))
        if basin.ending == "periodic":
            stem: dict[str, Any] = {"color": style["color"], "linewidth": 1.0}
            ax.vlines(omega[large], LOWEST_LINE * height.max(), height[large], **stem)
            look: dict[str, Any] = {"marker": "o", "markersize": 3.5, "linestyle": "none"}
            ax.plot(omega[large], height[large], color=style["color"], label=name, **look)
        else:
            ax.plot(omega, np.maximum(height, 1e-300), label=name, linewidth=0.7, **style)
    if highest:
        ax.set_yscale("log")
        ax.set(xlim=(0.0, 1.05 * last), ylim=(LOWEST_LINE * highest, 3.0 * highest))
        common.legend_below(ax)
        view.second_axes(ax, OMEGA)
    else:
        ax.text(0.5, 0.5, "all are at rest", transform=ax.transAxes, ha="center", va="center")
    return ax


def films(
    found: Attractors | BifurcationDiagram,
    speed: float | None = None,
    *,
    fps: float = 25.0,
    units: Units = "nondimensional",
) -> dict[str, Film]:
    """Films of the attractors that move, by name, each on a figure of its own.

    Of a diagram they are the stable cycles at a speed, and the irregular motions there, which go on
    for `FILMED` from where they ended.

    Args:
        found: attractors, or a diagram.
        speed: flow speed, one of the diagram's.
        fps: frames a second, as of `animate`.
        units: "nondimensional", or "si" where the pipe has scales.

    Example:
        >>> diagram = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0])
        >>> for name, film in plot.films(diagram, 4.0, fps=5.0).items():
        ...     film.save(f"{name}.gif")

    Raises:
        ValueError, TypeError: for bad arguments, and what `animate` refuses.
    """
    how: dict[str, Any] = {"fps": fps, "units": units}
    if isinstance(found, Attractors):
        moving = [k for k, basin in enumerate(found.basins) if basin.ending != "rest"]
        view = View(units, found.model.pipe)
        return {_name(found, k, view): animate(found.basins[k], **how) for k in moving}
    diagram: BifurcationDiagram = common.check_type("found", found, BifurcationDiagram)
    speed = check.real("speed", speed, low=0.0)
    if not np.isclose(diagram.speeds, speed, rtol=1e-12, atol=0.0).any():
        raise ValueError(f"speed must be one of the diagram's speeds, got {speed:g}")
    cycles = [one for branch in diagram.cycles for one in branch.at(speed) if one.stable]
    made = {f"cycle {k}": animate(one, **how) for k, one in enumerate(cycles)}
    ends = (one for one in diagram.motions if np.isclose(one.speed, speed, rtol=1e-12))
    for one in ends:
        if one.ending not in ("rest", "periodic", "failed"):
            q, qdot = np.split(one.end, 2)
            motion = simulate(diagram.model, speed, FILMED, q, qdot)
            made[f"motion from start {one.start}"] = animate(motion, span=(0.0, FILMED), **how)
    return made


def _shown_basins(found: Any, units: Units) -> tuple[list[Basin], Any, list[str]]:
    """Basins of the argument, their model and names."""
    if isinstance(found, Basin):
        view = View(units, found.motion.model.pipe)
        return [found], found.motion.model, [_kind(found, view)]
    common.check_type("found", found, Attractors)
    view = View(units, found.model.pipe)
    names = [_name(found, k, view) for k in range(len(found))]
    return list(found.basins), found.model, names


def _kind(basin: Basin, view: View) -> str:
    """What the attractor is, in words."""
    if basin.ending == "rest":
        return "rest"
    if basin.ending == "periodic":
        unit = " s" if view.si else ""
        return f"cycle, period {basin.period * view.one(ELAPSED):.4g}{unit}"
    exponent = basin.attractor.exponent
    if exponent is None:
        return basin.ending
    value, spread = (view.one(GROWTH) * of for of in (exponent.value, exponent.spread))
    unit = " 1/s" if view.si else ""
    return f"{basin.ending}, exponent {value:.2g} $\\pm$ {spread:.1g}{unit}"


def _name(found: Attractors, k: int, view: View) -> str:
    """Number and kind, and of whose mirror image it is."""
    basin = found.basins[k]
    image = f", mirror image of {basin.mirror_image}" if 0 <= basin.mirror_image < k else ""
    return f"{k}: {_kind(basin, view)}{image}"


def _percent(basin: Basin) -> str:
    return f"{100.0 * basin.share.value:.3g} %"


def _state_entry(found: Attractors, index: int, before: str) -> Measure:
    """Of an entry of the state [q, q']."""
    half = found.model.coordinates
    if index < half:
        return Measure(f"{before}coordinate $q_{{{index}}}$")
    return rate(index - half, before)
