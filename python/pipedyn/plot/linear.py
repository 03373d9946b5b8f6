# SPDX-License-Identifier: MIT
"""Pictures of the linear analysis: eigenvalues against flow speed, and mode shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import Normalize, SymLogNorm
from numpy.typing import NDArray

from pipedyn.linear.loci import RootLoci
from pipedyn.linear.modes import Modes
from pipedyn.linear.neutral import growth
from pipedyn.plot import common
from pipedyn.plot.units import (
    ARC,
    FLOW_SPEED,
    GROWTH,
    OSCILLATION,
    ROOT_FREQUENCY,
    Measure,
    Units,
    View,
)
from pipedyn.util import check
from pipedyn.util.check import Array

DOT: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 2.2, "linestyle": "none"}
DOT |= {"markeredgewidth": 0.0, "zorder": 3.0}
"""Look of the branches of a benchmark."""

ONSET = common.open_marker(4.5, marker="D", markeredgewidth=0.9, zorder=4.0)
"""Look of the marker of an onset."""


def root_loci(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    highest: float | None = None,
    *,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Branches of eigenvalues in the upper half of the complex plane, coloured by flow speed.

    A diamond marks each onset. The lower half plane is the mirror image and is not shown. A pair
    that has become real is shown as two curves on the real axis.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots.
        highest: flow speed at the end of the colours; the highest of the loci if not given.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given. The first collection serves `colour_bar`.

    Example:
        >>> speeds = np.linspace(0.0, 8.0, 81)
        >>> exact = pp.root_loci(pp.Continuum(pp.Pipe(0.2)), speeds, count=3)
        >>> ax = plot.root_loci(pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), speeds, count=3), exact)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    ax, view = _checked_axes(loci, benchmark, units, ax, GROWTH, OSCILLATION)
    end = float(loci.speeds[-1])
    if highest is not None:
        end = check.real("highest", highest, low=0.0, open_low=True)
    rate = view.one(GROWTH)
    branches = rate * branches_of(loci)
    norm = Normalize(0.0, view.one(FLOW_SPEED) * (end or 1.0))
    speeds = view.one(FLOW_SPEED) * loci.speeds[:, None]
    _coloured(ax, branches.real, branches.imag, speeds, "viridis", norm)
    _mark_onsets(ax, growth(branches / rate), branches)
    if benchmark is not None:
        exact = rate * branches_of(benchmark)[:: dot_stride(benchmark)]
        ax.plot(exact.real, exact.imag, **DOT)
    ax.axvline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.autoscale_view()
    return ax


def frequencies(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    largest: float | None = None,
    *,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """|Im lambda| against flow speed, with the real part as a colour that diverges from zero.

    Unstable parts of branches have a black outline; a diamond marks each onset.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots.
        largest: |Re lambda| at the ends of the colours, which are linear up to 1 and logarithmic
            beyond; the largest of the loci if not given.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given. The first collection serves `colour_bar`.

    Example:
        >>> loci = pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), np.linspace(0.0, 8.0, 81), count=3)
        >>> ax = plot.frequencies(loci)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    ax, view = _checked_axes(loci, benchmark, units, ax, FLOW_SPEED, ROOT_FREQUENCY)
    branches = branches_of(loci)
    if largest is None:
        largest = float(np.nanmax(np.abs(branches.real), initial=0.0))
    largest = check.real("largest", largest, low=0.0)
    rate, end = view.one(GROWTH), view.one(GROWTH) * max(largest, 2.0)
    norm = SymLogNorm(rate, vmin=-end, vmax=end)
    speeds, height = view.one(FLOW_SPEED) * loci.speeds[:, None], view.one(ROOT_FREQUENCY)
    heights, real = height * branches.imag, growth(branches)
    _coloured(ax, speeds, heights, rate * real, "RdBu_r", norm, outlined=0.0)
    _mark_onsets(ax, real, speeds + 1j * heights)
    if benchmark is not None:
        stride = dot_stride(benchmark)
        places = view.one(FLOW_SPEED) * benchmark.speeds[::stride]
        ax.plot(places, height * branches_of(benchmark).imag[::stride], **DOT)
    ax.autoscale_view()
    return ax


def _checked_axes(
    loci: Any, benchmark: Any, units: Units, ax: Any, x: Measure, y: Measure
) -> tuple[Axes, View]:
    """Checks arguments of both pictures of eigenvalues; returns the Axes and the units."""
    check.instance("loci", loci, RootLoci)
    check.instance("benchmark", benchmark, RootLoci | None, "of type RootLoci")
    view = View(units, loci.pipe)
    return view.axes(ax, (4.8, 4.2), x, y), view


def _coloured(
    ax: Axes,
    x: Array,
    y: Array,
    values: Array,
    colours: str,
    norm: Normalize,
    outlined: float = math.inf,
) -> None:
    """Draws branches, the columns of x and y, in segments coloured by the mean of their values.

    Segments with the largest values are on top: of two roots with the same frequency the less
    stable one is visible. Values above `outlined` get a black outline, others a thin grey one.
    """
    segments, means = pieces(x, y, values)
    order = np.argsort(means, kind="stable")
    ends, means = list(segments[order]), means[order]
    outline = np.where(means > outlined, "black", "0.35").tolist()
    widths = np.where(means > outlined, 4.2, 2.6).tolist()
    coloured: dict[str, Any] = {"array": means, "cmap": colours, "norm": norm, "linewidths": 2.0}
    below: dict[str, Any] = {"edgecolors": outline, "facecolors": "none", "linewidths": widths}
    lines = LineCollection(ends, capstyle="round", zorder=2.2, **coloured)
    ax.add_collection(lines)
    outlines = PathCollection(lines.get_paths(), capstyle="round", zorder=2.1, **below)
    ax.add_collection(outlines, autolim=False)


def _mark_onsets(ax: Axes, real: Array, places: NDArray[np.complex128]) -> None:
    """Draws diamonds where real parts become positive, by linear interpolation along branches."""
    i, j = np.nonzero((real[:-1] <= 0.0) & (real[1:] > 0.0))
    part = real[i, j] / (real[i, j] - real[i + 1, j])
    onsets = places[i, j] + part * (places[i + 1, j] - places[i, j])
    ax.plot(onsets.real, onsets.imag, **ONSET)


def pieces(x: Array, y: Array, values: Array) -> tuple[Array, Array]:
    """Segments of the columns of x and y, (k, 2, 2), and the means of their values, (k,)."""
    points = np.stack(np.broadcast_arrays(x, y, values), axis=-1)
    both = np.stack([points[:-1], points[1:]], axis=-2)
    segments = both[np.isfinite(both).all(axis=(-2, -1))]
    return segments[:, :, :2], segments[:, :, 2].mean(axis=1)


def branches_of(loci: RootLoci) -> NDArray[np.complex128]:
    """Upper roots, then their partners if real, as columns; NaN for points that are not drawn."""
    on_axis = loci.eigenvalues.imag == 0.0
    real = on_axis.copy()
    # Both roots are shown on steps that lead to the real axis or away from it.
    real[1:] |= on_axis[:-1]
    real[:-1] |= on_axis[1:]
    nothing = complex(math.nan, math.nan)
    upper = np.where(loci.converged, loci.eigenvalues, nothing)
    roots = np.column_stack([upper, np.where(loci.converged & real, loci.partners, nothing)])
    roots = roots[:, np.isfinite(roots).any(axis=0)]
    return np.asarray(roots.real + 1j * np.abs(roots.imag))


def dot_stride(loci: RootLoci) -> int:
    """Number of speeds from one dot of a benchmark to the next, so that curves remain visible.

    Example:
        >>> loci = pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), np.linspace(0.0, 8.0, 161), count=3)
        >>> plot.dot_stride(loci) >= 1
        True
    """
    check.instance("loci", loci, RootLoci)
    # 19 dots of 2.2 points leave the curve visible between them in a panel two inches wide.
    return max(1, round((loci.speeds.size - 1) / 18))


def mode_shapes(
    modes: Modes, count: int = 4, *, units: Units = "nondimensional", ax: Axes | None = None
) -> Axes:
    """Mode shapes, as transverse displacement: real part solid, imaginary part dashed.

    Args:
        modes: the modes to show.
        count: largest number of modes shown, in the order of `modes`, from 1 to 1000; if there are
            more modes, the title gives their number.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> ax = plot.mode_shapes(pp.modes(pp.Chain(pp.Pipe(0.2), 10), 4.0, count=3))

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check.instance("modes", modes, Modes)
    count = check.count("count", count, high=1000)
    view = View(units, modes.shapes[0].model.pipe if modes.shapes else None)
    ax = view.axes(ax, (6.4, 4.2), ARC, Measure("displacement (largest: 1)"))
    s = np.linspace(0.0, 1.0, 401)
    for i, shape in enumerate(modes.shapes[:count]):
        displacement, value = shape(s), view.one(GROWTH) * shape.eigenvalue
        colour = common.CURVE_STYLES[i % len(common.CURVE_STYLES)]["color"]
        look: dict[str, Any] = {"color": colour, "linewidth": 1.0 + 0.4 * (i % 3)}
        label = rf"$\lambda = {value.real:.3g} {value.imag:+.4g}\,\mathrm{{i}}${' 1/s' * view.si}"
        at = view.one(ARC) * s
        ax.plot(at, displacement.real, label=label, **look)
        ax.plot(at, displacement.imag, linestyle="--", **look)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.set(xlim=(0.0, view.one(ARC)), ylim=(-1.08, 1.08), title=view.speed(modes.speed, 6))
    if len(modes.shapes) > count:
        ax.set_title(f"{view.speed(modes.speed, 6)}, {count} of {len(modes.shapes)} modes")
    if modes.shapes:
        for word, line in (("real part", "-"), ("imaginary part", "--")):
            ax.plot([], [], color="0.4", linestyle=line, label=word)
        common.legend_below(ax)
    return ax
