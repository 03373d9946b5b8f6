# SPDX-License-Identifier: MIT
"""Pictures of driven pipes: frequency responses, and regions of instability of pulsating flow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from pipedyn.forced.forced_response import ForcedResponse
from pipedyn.forced.parametric_regions import ParametricRegion, ParametricRegions
from pipedyn.linear.frequency_response import FrequencyResponse
from pipedyn.plot import common
from pipedyn.plot.bifurcation import draw_pieces, mark_event, smooth
from pipedyn.plot.units import AMPLITUDE, OMEGA, PER_FORCE, PER_MOMENT, Measure, Units, View
from pipedyn.util import check

REGION_STYLES: dict[str, dict[str, Any]] = {
    "subharmonic": {"color": common.BLUE, "linestyle": "-", "hatch": None},
    "harmonic": {"color": common.ORANGE, "linestyle": (0, (5, 1.5)), "hatch": "///"},
    "combination": {"color": common.GREEN, "linestyle": (0, (1, 1.2)), "hatch": "..."},
}


def frequency_response(
    response: FrequencyResponse,
    phase: bool = False,
    *,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Magnitude of the response over the frequency, on a logarithmic scale, or its phase.

    A ring marks each resonance, and a bar its half-power width. A triangle at the upper end marks a
    resonance of infinite height.

    Args:
        response: the response to show.
        phase: whether to show the phase in degrees, from -180 to 180, instead of the magnitude.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.frequency_response(pp.Chain(pp.Pipe(0.2), 10), 4.0, np.arange(1.0, 60.0))
        >>> ax = plot.frequency_response(found)

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("response", response, FrequencyResponse)
    shows_phase = check.flag("phase", phase)
    moved = "free end" if response.output == 1.0 else f"place $s = {response.output:g}$"
    driven = "base" if isinstance(response.input, str) else response.input[0]
    view = View(units, response.model.pipe)
    size = Measure(f"|displacement of the {moved} / {driven}|")
    if driven != "base":
        size = Measure(size.label, size.label, PER_FORCE if driven == "force" else PER_MOMENT)
    ax = view.axes(ax, (6.4, 4.2), OMEGA, Measure("phase (degrees)") if shows_phase else size)
    per, one = view.one(OMEGA), view.one(size)
    order = np.argsort(response.frequencies)
    at, values = per * response.frequencies[order], response.response[order]
    finite = np.isfinite(values)
    if shows_phase:
        angles = np.degrees(np.angle(np.where(finite, values, math.nan)))
        angles[1:][np.abs(np.diff(angles)) > 180.0] = math.nan  # breaks the line at a jump
        ax.plot(at, angles, color=common.BLACK, linewidth=1.2)
        ax.set(ylim=(-185.0, 185.0), yticks=np.arange(-180.0, 181.0, 90.0))
    else:
        sizes = one * np.where(finite, np.abs(values), math.nan)
        sizes[sizes == 0.0] = math.nan
        heights = [one * r.height for r in response.resonances if r.height < math.inf]
        ax.plot(at, sizes, color=common.BLACK, linewidth=1.2)
        ax.set_yscale("log")
        # Frequencies are dense at peaks, so the typical size comes from evenly spaced frequencies.
        evenly = np.interp(np.linspace(at[0], at[-1], 201), at, sizes)
        typical = float(np.nanmedian(evenly)) if np.isfinite(evenly).any() else 1.0
        ax.set_ylim(bottom=max(np.nanmin(sizes, initial=typical), 1e-3 * typical))
        infinite = [per * r.frequency for r in response.resonances if r.height == math.inf]
        if infinite:  # samples next to an infinite peak are cut off by the upper limit
            ax.set_ylim(top=1e3 * typical)
            look = common.open_marker(6.0, marker="^", zorder=4.0, clip_on=False)
            of_axes = ax.get_xaxis_transform()
            ax.plot(infinite, np.ones(len(infinite)), transform=of_axes, **look)
        for peak in response.resonances:
            if peak.height < math.inf and math.isfinite(peak.width):
                level = math.sqrt(0.5) * one * peak.height
                ends = _level_crossings(at, sizes, per * peak.frequency, level)
                ax.plot(ends, [level, level], color=common.VERMILION, linewidth=1.6)
        peaks = [per * r.frequency for r in response.resonances if r.height < math.inf]
        ax.plot(peaks, heights, **common.open_marker(4.5, zorder=4.0))
    if at[0] < at[-1]:
        ax.set_xlim(float(at[0]), float(at[-1]))
    stable = "" if response.stable else ", unstable: the response is not reached"
    ax.set_title(f"{view.speed(response.u)}{stable}")
    return ax


def _level_crossings(at: Any, sizes: Any, frequency: float, level: float) -> list[float]:
    """Two frequencies, below and above a peak, at which a response crosses a level."""
    above = sizes > level
    k = int(np.argmin(np.abs(at - frequency)))
    left = k - int(np.argmin(above[: k + 1][::-1]))
    right = k + int(np.argmin(above[k:]))
    pairs = [left, left + 1], [right, right - 1]
    return [float(np.interp(level, sizes[pair], at[pair])) for pair in pairs]


def parametric_regions(
    regions: Sequence[ParametricRegion], *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Regions of amplitude over frequency in which a pulsating flow makes the pipe unstable.

    Kinds differ in colour, line and hatching; a ring marks the least amplitude of each region.

    Args:
        regions: the regions to show, with amplitudes that are close enough for a curve.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> model = pp.Galerkin(pp.Pipe(0.2, 10.0), 4)
        >>> regions = pp.parametric_regions(model, 5.5, [0.15, 0.2], (27.0, 37.0))
        >>> ax = plot.parametric_regions(regions)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    said = "those of parametric_regions or a list"
    check.instance("regions", regions, (list, tuple, ParametricRegions), said)
    for i, one in enumerate(regions):
        check.instance(f"regions[{i}]", one, ParametricRegion)
    pipe = regions.model.pipe if isinstance(regions, ParametricRegions) else None
    view = View(units, regions[0].pipe if regions else pipe)
    pulsation = Measure(r"frequency of the pulsation $\omega$", OMEGA.words, OMEGA.unit)
    ax = view.axes(ax, (6.4, 4.2), pulsation, Measure(r"amplitude $\mu$ of the pulsation"))
    per = view.one(OMEGA)
    for region in regions:
        look = REGION_STYLES[region.kind]
        inside = np.isfinite(region.edges).all(axis=1)
        amplitude, edges = region.amplitude[inside], per * region.edges[inside]
        if math.isfinite(region.threshold):
            amplitude = np.append(region.threshold, amplitude)
            edges = np.vstack([np.full(2, per * region.threshold_frequency), edges])
        fill = {"facecolor": look["color"], "alpha": 0.25, "hatch": look["hatch"]}
        fill |= {"linewidth": 0.0, "label": region.kind}
        line = {"color": look["color"], "linestyle": look["linestyle"], "linewidth": 1.2}
        if math.isfinite(region.threshold):  # the outline goes down one side and up the other
            around = np.append(edges[:0:-1, 0], edges[:, 1]), np.append(amplitude[:0:-1], amplitude)
            outline = smooth(*around)
            ax.fill(*outline.T, **fill)
            ax.plot(*outline.T, **line)
            ring = common.open_marker(4.5, edge=look["color"], zorder=4.0, clip_on=False)
            ax.plot([per * region.threshold_frequency], [region.threshold], **ring)
        else:
            ax.fill_betweenx(amplitude, *edges.T, **fill)
            for side in edges.T:
                ax.plot(*smooth(side, amplitude).T, **line)
    ax.set_ylim(bottom=0.0)
    common.legend_below(ax)
    return ax


def forced_response(
    response: ForcedResponse, *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Amplitude of periodic motions over the frequency.

    Stable motions are solid curves, unstable ones dashed. Markers show folds and other events.

    Args:
        response: the response to show.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> model = pp.Galerkin(pp.Pipe(0.2, damping=0.002), 4)
        >>> shaken = pp.Harmonic(0.02, frequency=13.5, direction="x")
        >>> found = pp.forced_response(model, 5.0, base=shaken, frequencies=(13.0, 14.0))
        >>> ax = plot.forced_response(found)

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("response", response, ForcedResponse)
    view = View(units, response.model.pipe)
    ax = view.axes(ax, (6.4, 4.2), OMEGA, AMPLITUDE)
    per, one = view.one(OMEGA), view.one(AMPLITUDE)
    for branch, look in zip(response.branches, cycle(common.CURVE_STYLES), strict=False):
        curve = smooth(per * branch.frequency, one * branch.amplitude)
        steady = branch.stable[:-1] | branch.stable[1:]  # a step to an event is stable up to it
        labels = {word: f"{branch.kind}, {word}" for word in ("stable", "unstable")}
        draw_pieces(ax, curve, steady, look["color"], labels)
        for event in branch.events:
            if event.kind != "end":
                mark_event(ax, event.kind, [per * event.frequency, one * event.amplitude])
    ax.set_ylim(bottom=0.0)
    common.legend_below(ax)
    return ax
