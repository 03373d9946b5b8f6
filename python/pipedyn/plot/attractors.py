# SPDX-License-Identifier: MIT
"""Pictures of attractors: basins, Poincare sections, spectra and films."""

from __future__ import annotations

from collections.abc import Sequence
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
from pipedyn.plot.units import (
    AMPLITUDE,
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

SMALLEST_VIEW = 0.05
"""Least half-width of the axes of a section, as a share of the largest value. Without it the few
points of a cycle would be magnified until rounding shows."""

FILMED = 10.0
"""Duration of the motion in a film of an irregular motion, in T: some twenty swings of flutter."""

LOWEST_LINE = 1e-5
"""Height, as a share of the highest line, below which a spectrum is not shown, because errors of
motions are as large."""


def basins(found: Attractors, *, units: Units = "nondimensional", ax: Axes | None = None) -> Axes:
    """Basins of attraction: the attractor on which the motion from each start of a plane ends.

    Each attractor has a colour, and the legend gives its share of the starts. A white marker shows
    an equilibrium that lies in the plane. Starts whose motions did not settle are grey, and those
    whose motions failed are white. Coordinates are those of the model, counted from 0.

    Args:
        found: attractors from a `StartPlane` of at least 2 values along both axes.
        units: "nondimensional", or "si" if the pipe has scales.
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
    view = View(units, found.model.pipe)
    entries = tuple(_state_entry(found, index, "initial ") for index in plane.indices)
    x, y = (view.one(of) * at for of, at in zip(entries, (plane.x, plane.y), strict=True))
    ax = view.axes(ax, (6.4, 4.6), *entries)
    colours = [fill for fill, _ in zip(cycle(FILLS), found.basins, strict=False)]
    shades = ListedColormap([FAILED, UNSETTLED, *colours])
    steps = BoundaryNorm(np.arange(-2.5, len(colours) + 0.5), shades.N)
    ends = found.ends.reshape(plane.shape)
    ax.pcolormesh(x, y, ends, cmap=shades, norm=steps, rasterized=True)
    parts = [
        (one.share, fill, _name(found, k, view))
        for k, (one, fill) in enumerate(zip(found.basins, colours, strict=True))
    ]
    parts += [(found.unsettled, UNSETTLED, "not settled"), (found.failed, FAILED, "failed")]
    shown = {
        f"{words}, {100.0 * share.value:.3g} %": Patch(facecolor=fill, edgecolor="0.3")
        for share, fill, words in parts
        if share.count
    }
    for k, basin in enumerate(found.basins):
        if basin.ending == "rest":
            end = np.append(basin.motion.q[-1], basin.motion.qdot[-1])[list(plane.indices)]
            end = end * list(map(view.one, entries))
            inside = x[0] <= end[0] <= x[-1] and y[0] <= end[1] <= y[-1]
            if inside:
                look = common.open_marker(6.0, marker=SHAPES[k % len(SHAPES)], zorder=3.0)
                ax.plot(*end, gid=f"rest {k}", **look)
    common.legend_below(ax, shown)
    ax.set_title(f"{view.speed(found.u, 6)}, {found.model.pipe.flow}")
    return ax


def poincare_section(
    found: Attractors | Basin,
    coordinate: Literal["tip"] | int = "tip",
    *,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Poincare sections of attractors: states at which the free end is at a maximum.

    A cycle shows as many points as it has maxima in a period, a torus lines, and chaos a cloud. The
    picture shows a coordinate against its rate; for "tip" it shows the position of the free end
    against the rate of the last coordinate. If the flow or the base drives the pipe, sections are
    stroboscopic: they hold the states at the beginnings of the periods of the drive.

    Args:
        found: attractors, or one of the basins. Attractors at rest have no section.
        coordinate: "tip" for the transverse position of the free end, or the index of a coordinate,
            counted from 0.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.poincare_section(found)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    some, model, view, names = _shown_basins(found, units)
    index, across = of_coordinate(coordinate, model.coordinates)
    last = model.coordinates - 1 if index is None else index
    driven = any(basin.motion.base or not isinstance(basin.motion.u, float) for basin in some)
    place = "once a period" if driven else "at a maximum of the free end"
    shown = rate(last, "", f" {place}")
    ax = view.axes(ax, (4.8, 4.2), across, shown)
    looks = zip(cycle(SHAPES), cycle(common.CURVE_STYLES), strict=False)
    moving = False
    for basin, name, (marker, style) in zip(some, names, looks, strict=False):
        if not len(basin.section):
            continue
        moving = True
        q, qdot = np.split(basin.section, 2, axis=1)
        x = model.tips(q.T)[:, 0] if index is None else q[:, index]
        few = basin.ending == "periodic"
        look: dict[str, Any] = {"linestyle": "none", "marker": marker, "color": style["color"]}
        look |= {"label": name, "markersize": 5.0 if few else 2.0, "markeredgewidth": 0.0}
        ax.plot(view.one(across) * x, view.one(shown) * qdot[:, last], **look)
    if moving:
        common.legend_below(ax)
        ax.margins(0.08)
        for place, limits in (
            (ax.dataLim.intervalx, ax.set_xlim),
            (ax.dataLim.intervaly, ax.set_ylim),
        ):
            least = SMALLEST_VIEW * float(np.abs(place).max())
            if np.ptp(place) < least:
                limits(place.mean() - least, place.mean() + least)
    else:
        ax.text(0.5, 0.5, "all are at rest", transform=ax.transAxes, ha="center", va="center")
    return ax


def spectrum(
    found: Attractors | Basin, *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Spectra of the transverse motion of the free end, for each attractor that is not at rest.

    A spectrum is the amplitude over the frequency; the spectrum of a cycle is drawn as stems at its
    harmonics.

    Args:
        found: attractors, or one of the basins.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 3)
        >>> ax = plot.spectrum(found)

    Raises:
        TypeError: for bad arguments.
    """
    some, _, view, names = _shown_basins(found, units)
    ax = view.axes(ax, (6.4, 3.6), OMEGA, AMPLITUDE)
    highest, last = 0.0, 0.0
    for basin, name, style in zip(some, names, cycle(common.CURVE_STYLES), strict=False):
        omega = view.one(OMEGA) * basin.frequencies[1:]  # without the mean value at frequency 0
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
    """Films, by name, of the attractors that are not at rest, each on a figure of its own.

    For a diagram, the films show the stable cycles at a flow speed, and the irregular motions at
    that speed, which are continued from their ends for a time of 10 T.

    Args:
        found: attractors, or a diagram.
        speed: flow speed, one of the diagram's; not used for attractors.
        fps: frames a second, as for `animate`.
        units: "nondimensional", or "si" if the pipe has scales.

    Example:
        >>> diagram = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0])
        >>> for name, film in plot.films(diagram, 4.0, fps=4.0).items():
        ...     film.save(f"{name}.gif")

    Raises:
        ValueError, TypeError: for bad arguments, and for motions that `animate` refuses.
    """
    how: dict[str, Any] = {"fps": check.real("fps", fps, low=1.0, high=50.0), "units": units}
    if isinstance(found, Attractors):
        moving = [k for k, basin in enumerate(found.basins) if basin.ending != "rest"]
        view = View(units, found.model.pipe)
        return {_name(found, k, view): animate(found.basins[k], **how) for k in moving}
    diagram: BifurcationDiagram = check.instance("found", found, BifurcationDiagram)
    speed = check.real("speed", speed, low=0.0)
    if not np.isclose(diagram.speeds, speed, rtol=1e-12, atol=0.0).any():
        raise ValueError(f"speed must be one of the diagram's speeds, got {speed:g}")
    cycles = [one for branch in diagram.cycles for one in branch.at(speed) if one.stable]
    made = {f"cycle {k}": animate(one, **how) for k, one in enumerate(cycles)}
    for one in diagram.at(speed):
        if one.ending not in ("rest", "periodic", "failed"):
            q, qdot = np.split(one.end, 2)
            motion = simulate(diagram.model, speed, FILMED, q, qdot)
            made[f"motion from start {one.start}"] = animate(motion, span=(0.0, FILMED), **how)
    return made


def _shown_basins(found: Any, units: Units) -> tuple[Sequence[Basin], Any, View, list[str]]:
    """Basins in the argument `found`, their model, the units, and the names of the basins."""
    if isinstance(found, Basin):
        model = found.motion.model
        view = View(units, model.pipe)
        return [found], model, view, [_kind(found, view)]
    check.instance("found", found, Attractors)
    view = View(units, found.model.pipe)
    names = [_name(found, k, view) for k in range(len(found))]
    return found.basins, found.model, view, names


def _kind(basin: Basin, view: View) -> str:
    """The kind of an attractor in words, with the period of a cycle or an exponent."""
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
