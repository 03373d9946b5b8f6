# SPDX-License-Identifier: MIT
"""Pictures of driven pipes: frequency responses, and regions of instability of pulsating flow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from matplotlib.axes import Axes

from pipedyn.cycles.limit_cycle import amplitude_across, amplitude_of
from pipedyn.forced.forced_response import FROM_REST, ForcedBranch, ForcedResponse
from pipedyn.forced.parametric_regions import ParametricRegion, ParametricRegions
from pipedyn.linear.frequency_response import FrequencyResponse
from pipedyn.plot import common
from pipedyn.plot.accuracy import round_ticks
from pipedyn.plot.arrange import legend_below
from pipedyn.plot.bifurcation import draw_pieces, mark_event, smooth
from pipedyn.plot.units import AMPLITUDE, OMEGA, PER_FORCE, PER_MOMENT, Measure, Units, View
from pipedyn.util import check
from pipedyn.util.check import Array

REGION_STYLES: dict[str, dict[str, Any]] = {
    "subharmonic": {"color": common.BLUE, "linestyle": "-", "hatch": None},
    "harmonic": {"color": common.ORANGE, "linestyle": (0, (5, 1.5)), "hatch": "///"},
    "combination": {"color": common.GREEN, "linestyle": (0, (1, 1.2)), "hatch": "..."},
}

BRANCH_LOOKS = dict.fromkeys(("base", "force"), (common.BLACK, 1.0))
BRANCH_LOOKS["subharmonic"] = (common.BLUE, 1.0)
BRANCH_LOOKS["harmonic"] = (common.ORANGE, 2.0)
BRANCH_LOOKS["out of plane"] = BRANCH_LOOKS["offshoot"] = (common.GREEN, 1.5)
ACROSS_LOOK = (common.PURPLE, 0.6)
"""Colour of each kind of branch, and how wide its curve is, so that kinds differ in grey; and those
of the curve of the amplitude across."""

INNER = (1 / 3, 2 / 3)
"""Places within a step of a branch, as shares of its length, at which amplitudes are computed, so
that curves show no corners where steps are long."""


def frequency_response(
    response: FrequencyResponse,
    phase: bool = False,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Magnitude of the response over the frequency, on a logarithmic scale, or its phase.

    A ring marks each resonance, and a bar its half-power width. A triangle at the upper end marks a
    resonance of infinite height.

    Args:
        response: the response to show.
        phase: whether to show the phase in degrees, from -180 to 180, instead of the magnitude.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> found = pp.frequency_response(pp.Chain(pp.Pipe(0.2), 10), 4.0, np.arange(1.0, 60.0))
        >>> ax = plot.frequency_response(found)

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("response", response, FrequencyResponse)
    shows_phase = check.flag("phase", phase)
    moved = "free end" if response.output == 1.0 else f"place $s={response.output:g}$"
    driven = "base" if isinstance(response.input, str) else response.input[0]
    if response.direction == "z":
        moved += " along $z$"
    view = View(units, response.model.pipe)
    by = f"{driven} along $y$" if response.direction == "y" else driven
    size = Measure(f"|displacement of the {moved} / {by}|")
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
            label = "resonance of infinite height"
            ax.plot(infinite, np.ones(len(infinite)), label=label, transform=of_axes, **look)
        for peak in response.resonances:
            if peak.height < math.inf and math.isfinite(peak.width):
                level = math.sqrt(0.5) * one * peak.height
                ends = _level_crossings(at, sizes, per * peak.frequency, level)
                bar: dict[str, Any] = {"color": common.VERMILION, "linewidth": 1.6}
                ax.plot(ends, [level, level], label="half-power width", **bar)
        peaks = [per * r.frequency for r in response.resonances if r.height < math.inf]
        if peaks:
            ax.plot(peaks, heights, label="resonance", **common.open_marker(4.5, zorder=4.0))
        round_ticks(ax.yaxis)
    if at[0] < at[-1]:
        ax.set_xlim(float(at[0]), float(at[-1]))
    stable = "" if response.stable else ", unstable: the response is not reached"
    ax.set_title(f"{view.speed(response.u)}{stable}")
    if check.flag("legend", legend):
        legend_below(ax)
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
    regions: Sequence[ParametricRegion],
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Regions of amplitude over frequency in which a pulsating flow makes the pipe unstable.

    Kinds differ in colour, line and hatching; a ring marks the least amplitude of each region. The
    axes show the ranges of frequencies and amplitudes that `parametric_regions` was asked for; of a
    list of regions, all frequencies. A bar shows a region of which edges at one amplitude alone are
    known.

    Args:
        regions: the regions to show, with amplitudes that are close enough for a curve.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
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
    per, (low, high) = view.one(OMEGA), (-math.inf, math.inf)
    asked = [region.amplitude for region in regions]
    if isinstance(regions, ParametricRegions):
        low, high = per * regions.frequencies
        ax.set_xlim(low, high)
        asked += [] if regions.amplitudes is None else [regions.amplitudes]
    seen = False
    for region in regions:
        amplitude, edges = _outline(region)
        edges *= per
        if not ((edges[:, 0] <= high) & (edges[:, 1] >= low)).any():
            continue
        seen, look = True, REGION_STYLES[region.kind]
        fill = {"facecolor": look["color"], "alpha": 0.25, "hatch": look["hatch"]}
        fill |= {"linewidth": 0.0, "label": region.kind}
        line = {"color": look["color"], "linestyle": look["linestyle"], "linewidth": 1.2}
        if amplitude.size == 1:  # below the upper end of the axis
            ax.plot(edges[0], [amplitude[0]] * 2, color=line["color"], lw=5.0, label=region.kind)
            continue
        # The outline goes down one side and up the other.
        around = np.append(edges[::-1, 0], edges[:, 1]), np.append(amplitude[::-1], amplitude)
        ax.fill(*around, **fill)
        if math.isfinite(region.threshold):
            ax.plot(*around, **line)
            ring = common.open_marker(4.5, label="least amplitude", zorder=4.0, clip_on=False)
            if low <= edges[0, 0] <= high:
                ax.plot(edges[:1, 0], amplitude[:1], **ring)
        else:
            for side in edges.T:
                ax.plot(side, amplitude, **line)
    ax.set_ylim(0.0, max((float(mu[-1]) for mu in asked), default=None))
    if not seen:
        ax.text(0.5, 0.5, "no region to show", transform=ax.transAxes, ha="center", va="center")
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _outline(region: ParametricRegion) -> tuple[Array, Array]:
    """Amplitudes, (k,), and both edges there, (k, 2), close enough for smooth curves.

    The mean of the edges and the square of their distance are smooth functions of the square of the
    amplitude, of a small amplitude nearly linear, at the threshold, too, where the edges meet.
    """
    inside = np.isfinite(region.edges).all(axis=1) & ~(region.amplitude <= region.threshold)
    amplitude, edges = region.amplitude[inside], region.edges[inside]
    if math.isfinite(region.threshold):
        amplitude = np.append(region.threshold, amplitude)
        edges = np.vstack([np.full(2, region.threshold_frequency), edges])
    if amplitude.size < 2:
        return amplitude, edges
    known = np.column_stack([edges.mean(axis=1), np.diff(edges)[:, 0] ** 2])
    shares = np.linspace(0.0, 1.0, 101) ** 2  # the edges turn fastest at the threshold
    squares = amplitude**2
    finer = np.union1d(squares, squares[0] + np.ptp(squares) * shares)
    middle, square = scipy.interpolate.PchipInterpolator(squares, known)(finer).T
    half = 0.5 * np.sqrt(np.maximum(square, 0.0))
    return np.sqrt(finer), np.column_stack([middle - half, middle + half])


def forced_response(
    response: ForcedResponse,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Amplitude of periodic motions over the frequency.

    Stable motions are solid curves, unstable ones dashed, and branches of one kind look alike.
    Markers show folds and other events. Of motions out of a plane, in three dimensions, further
    curves show the amplitude across that along which the free end moves farthest. The axes show the
    range of frequencies that was asked for or, of branches that leave rest, all of these.

    Args:
        response: the response to show.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
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
    per, one, (low, high) = view.one(OMEGA), view.one(AMPLITUDE), (-math.inf, math.inf)
    from_rest = any(branch.kind in FROM_REST for branch in response.branches)
    if response.frequencies is not None and not from_rest:
        low, high = response.frequencies
        ax.set_xlim(per * low, per * high)
    for branch in response.branches:
        points, steady = _fine_curve(branch)
        curve = smooth(*(points * [per, one, one]).T)
        looks = [(str(branch.kind), BRANCH_LOOKS[branch.kind], curve[:, :2])]
        if points[:, 2].any():
            looks.append(("across", ACROSS_LOOK, curve[:, ::2]))
        for name, (colour, wider), drawn in looks:
            labels = {word: f"{name}, {word}" for word in ("stable", "unstable")}
            draw_pieces(ax, drawn, steady, colour, labels, wider)
        for event in branch.events:
            if event.kind != "end" and low <= event.frequency <= high:
                mark_event(ax, event.kind, [per * event.frequency, one * event.amplitude])
    ax.set_ylim(bottom=0.0)
    if check.flag("legend", legend):
        legend_below(ax)
    return ax


def _fine_curve(branch: ForcedBranch) -> tuple[Array, Array]:
    """Points on a branch, (k, 3), and whether each step is stable, (k - 1,).

    A point is a frequency with the amplitude of the motion, and that across it. Between two points
    of the branch lie further ones on the cubic of the step between them.
    """
    steady = branch.stable[:-1] | branch.stable[1:]  # a step to an event is stable up to it
    order = branch.motion.order
    between = {(order * step.begin.p, order * step.end.p): step for step in branch.steps}
    across = branch.amplitude_across
    if across is None:
        across = np.zeros(branch.frequency.size)
    points = [[branch.frequency[0], branch.amplitude[0], across[0]]]
    counts = []
    for k, ends in enumerate(pairwise(branch.frequency.tolist())):
        before = len(points)
        if (step := between.get(ends)) is not None:
            for share in INNER:
                orbit = step.problem.orbit(step.guess(share * step.length))
                sizes = (
                    amplitude_of(branch.motion, orbit)[0],
                    amplitude_across(branch.motion, orbit),
                )
                points.append([order * orbit.frequency, *sizes])
        points.append([ends[1], branch.amplitude[k + 1], across[k + 1]])
        counts.append(len(points) - before)
    return np.array(points), np.repeat(steady, counts)
