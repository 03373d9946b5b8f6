# SPDX-License-Identifier: MIT
"""Pictures of the linear analysis: eigenvalues against flow speed, and mode shapes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator

from pipedyn.linear.loci import RootLoci
from pipedyn.linear.modes import Modes
from pipedyn.linear.neutral import grows, growth
from pipedyn.plot import common
from pipedyn.plot.arrange import (
    FULL_TURN,
    keep_within,
    legend_below,
    small_letters,
    write_beside,
)
from pipedyn.plot.units import (
    ARC,
    FLOW_SPEED,
    GROWTH,
    IMAGINARY_OMEGA,
    OSCILLATION,
    REAL_OMEGA,
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

DOT_GAP = 6.0
"""Least distance of two dots in points, so that the curve below remains visible between them."""

DASH = 7.0, 6.0
"""Lengths of dashes and of the gaps between them in points; round ends make dashes longer."""

FINE_POINTS = 400
"""Number of points of a smooth curve: in a column of print they are 0.01 inches apart."""

ONSET = common.open_marker(4.5, marker="D", markeredgewidth=0.9, zorder=4.0)
"""Look of the marker of an onset."""

MARK: dict[str, Any] = {"color": "0.25", "marker": ".", "markersize": 3.5, "linestyle": "none"}
MARK |= {"zorder": 3.5}
"""Look of the places at which flow speeds are written."""


def root_loci(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    highest: float | None = None,
    *,
    plane: Literal["lambda", "omega"] = "lambda",
    numbers: bool = True,
    speeds: bool = False,
    bar: bool = True,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Branches of eigenvalues in the upper half of the complex plane, coloured by flow speed.

    A diamond marks each onset. Branches of motions across the plane of a bent rest are dashed.
    Between the samples, the sum and the product of each pair are
    interpolated, which are smooth also where the pair becomes real. The lower half plane is the
    mirror image and is not shown. A pair that has become real is shown as two curves on the real
    axis.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots at equal steps of the flow
            speed, where these would not overlap.
        highest: flow speed at the end of the colours; the highest of the loci if not given.
        plane: "lambda", or "omega" for the plane of complex frequencies omega = -i lambda, as in
            Paidoussis' book: Re omega to the right, Im omega upwards, unstable below 0.
        numbers: whether to write the number of its mode next to each branch.
        speeds: whether to write flow speeds, at round values, along the branches.
        bar: whether to add a colour bar; a later `colour_bar` replaces it.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given. The first collection serves `colour_bar`.

    Example:
        >>> grid = np.linspace(0.0, 8.0, 81)
        >>> exact = pp.root_loci(pp.Continuum(pp.Pipe(0.2)), grid, count=3)
        >>> ax = plot.root_loci(pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), grid, count=3), exact)
        >>> ax = plot.root_loci(exact, plane="omega", speeds=True)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    axes = (GROWTH, OSCILLATION)
    if check.choice("plane", plane, ("lambda", "omega")) == "omega":
        axes = (REAL_OMEGA, IMAGINARY_OMEGA)
    for name, given in (("numbers", numbers), ("speeds", speeds), ("bar", bar)):
        check.flag(name, given)
    ax, view = _checked_axes(loci, benchmark, units, ax, *axes)
    end = float(loci.speeds[-1])
    if highest is not None:
        end = check.real("highest", highest, low=0.0, open_low=True)
    rate, turn = view.one(GROWTH), 1.0 if plane == "lambda" else -1.0j
    smooth, unit = _smooth_branches(loci), view.one(FLOW_SPEED)
    branches = branches_of(smooth)
    norm = Normalize(0.0, unit * (end or 1.0))
    places = turn * rate * branches
    look = "viridis", norm, math.inf, across_of(smooth)
    _coloured(ax, places.real, places.imag, unit * smooth.speeds[:, None], *look)
    _mark_onsets(ax, growth(branches), places)
    (ax.axvline if plane == "lambda" else ax.axhline)(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.autoscale_view()
    if benchmark is not None:
        exact = turn * rate * branches_of(benchmark)[:: dot_stride(benchmark)]
        _draw_dots(ax, exact)
    upper = turn * rate * smooth.eigenvalues
    if numbers:
        _number_modes(ax, upper, loci.modes)
    if speeds:
        for value in MaxNLocator(5).tick_values(0.0, unit * loci.speeds[-1]):
            i = int(np.abs(unit * smooth.speeds - value).argmin())
            if not unit * loci.speeds[0] < value <= unit * loci.speeds[-1]:
                continue
            ax.plot(upper[i].real, upper[i].imag, **MARK)
            for place in upper[i][np.isfinite(upper[i])]:
                _write_number(ax, f"{value:g}", place[None], color="0.25", needed=False)
    if bar:
        common.colour_bar(view.label(FLOW_SPEED), ax=ax)
    return ax


def frequencies(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    largest: float | None = None,
    *,
    numbers: bool = True,
    bar: bool = True,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """|Im lambda| against flow speed, with the real part as a colour that diverges from zero.

    Unstable parts of branches have a black outline; a diamond marks each onset. Curves between
    samples are those of `plot.root_loci`.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots.
        largest: |Re lambda| at the ends of the colours, which are linear up to 1 and logarithmic
            beyond; the largest of the loci if not given.
        numbers: whether to write the number of its mode next to each branch.
        bar: whether to add a colour bar; a later `colour_bar` replaces it.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given. The first collection serves `colour_bar`.

    Example:
        >>> loci = pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), np.linspace(0.0, 8.0, 81), count=3)
        >>> ax = plot.frequencies(loci)

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    ax, view = _checked_axes(loci, benchmark, units, ax, FLOW_SPEED, ROOT_FREQUENCY)
    for name, given in (("numbers", numbers), ("bar", bar)):
        check.flag(name, given)
    smooth = _smooth_branches(loci)
    branches = branches_of(smooth)
    if largest is None:
        largest = float(np.nanmax(np.abs(branches.real), initial=0.0))
    largest = check.real("largest", largest, low=0.0)
    rate, end = view.one(GROWTH), view.one(GROWTH) * max(largest, 2.0)
    norm = SymLogNorm(rate, vmin=-end, vmax=end)
    speeds, height = view.one(FLOW_SPEED) * smooth.speeds[:, None], view.one(ROOT_FREQUENCY)
    heights, real = height * branches.imag, growth(branches)
    _coloured(ax, speeds, heights, rate * real, "RdBu_r", norm, 0.0, across_of(smooth))
    _mark_onsets(ax, real, speeds + 1j * heights)
    ax.autoscale_view()
    if benchmark is not None:
        stride = dot_stride(benchmark)
        places = view.one(FLOW_SPEED) * benchmark.speeds[::stride, None]
        exact = places + 1j * height * branches_of(benchmark).imag[::stride]
        _draw_dots(ax, exact)
    upper = speeds + 1j * height * np.abs(smooth.eigenvalues.imag)
    if numbers:
        _number_modes(ax, upper.astype(np.complex128), loci.modes)
    if bar:
        common.colour_bar(view.label(GROWTH), ax=ax)
    return ax


def _checked_axes(
    loci: Any, benchmark: Any, units: Units, ax: Any, x: Measure, y: Measure
) -> tuple[Axes, View]:
    """Checks arguments of both pictures of eigenvalues; returns the Axes and the units."""
    check.instance("loci", loci, RootLoci)
    check.instance("benchmark", benchmark, RootLoci | None, "of type RootLoci")
    view = View(units, loci.pipe)
    ax = view.axes(ax, (4.8, 4.2), x, y)
    if not loci.complete:
        note = ax.set_title(loci.missing, loc="right", size=small_letters())
        keep_within(ax, note, share=1.0)
    return ax, view


def _smooth_branches(loci: RootLoci) -> RootLoci:
    """Branches at so many speeds that their polygons look smooth, by modified Akima splines.

    A pair meets on the real axis with vertical tangents, where neither root has a slope. The sum
    and the product of the pair do, so that these are interpolated. A root whose partner is not
    known, or is not its conjugate since it has met one of another pair, is interpolated itself, and
    so is one with hysteresis, which meets no conjugate. Where a pair changes into one of which it
    has one root only, a straight line leads from this root.
    """
    steps = loci.speeds.size - 1
    parts = math.ceil(FINE_POINTS / steps) if steps > 0 else 1
    speeds = np.interp(np.arange(steps * parts + 1) / parts, np.arange(steps + 1), loci.speeds)
    one, other = loci.eigenvalues, loci.partners
    single = np.isnan(other)
    other = np.where(single, one, other)
    shape = speeds.size, one.shape[1]
    values, partners = np.full((2, *shape), complex(math.nan, math.nan))
    known = loci.converged & np.isfinite(one)
    paired = (other == one.conj()) | ((one.imag == 0.0) & (other.imag == 0.0))
    paired &= ~single & (loci.pipe.hysteresis == 0.0)
    # The real roots of a pair that meet are at equal distances from where they do. It moves there
    # at about the rate of the step before, or behind, on which the pair is complex.
    mean, gap = 0.5 * (one + other).real, 0.5 * np.abs((one - other).real)
    changed = np.zeros(one.shape, dtype=bool)
    real = one.imag == 0.0
    turned = real[1:] != real[:-1]
    moved = np.pad(np.diff(mean, axis=0), ((1, 1), (0, 0)))
    beside = np.where(real[1:], moved[:-2], moved[2:])
    off = np.minimum(np.abs(moved[1:-1]), np.abs(moved[1:-1] - beside))
    off = off > 0.5 * np.maximum(gap[1:], gap[:-1])
    changed[1:] = turned & off & paired[1:] & paired[:-1] & known[1:] & known[:-1]
    kinds = np.where(known, 1 + paired + 2 * np.cumsum(changed, axis=0), 0)
    for k in range(shape[1]):
        for row in np.flatnonzero(changed[:, k]).tolist():
            ends = np.array([[one[i, k], other[i, k]] for i in (row - 1, row)])
            nearest = [
                at[np.abs(at - far[0]).argmin()] for at, far in zip(ends, ends[::-1], strict=True)
            ]
            start, stop = (at.real + 1j * abs(at.imag) for at in nearest)
            between = slice((row - 1) * parts, row * parts + 1)
            values[between, k] = np.linspace(start, stop, parts + 1)
        for begin, end in common.runs(kinds[:, k]):
            if not known[begin, k]:
                continue
            alone = not paired[begin, k]
            if alone:  # from the pair before to the pair behind
                begin -= int(begin > 0 and known[begin - 1, k])
                end += int(end <= steps and known[min(end, steps), k])
            some, rest = one[begin:end, k], other[begin:end, k]
            inside = slice(begin * parts, (end - 1) * parts + 1)
            both = np.column_stack([some, rest] if alone else [0.5 * (some + rest), some * rest])
            parts_of = np.hstack([both.real, np.abs(both.imag)])
            if end - begin > 1:
                curve = Akima1DInterpolator(loci.speeds[begin:end], parts_of, method="makima")
                parts_of = curve(speeds[inside])
            first, second = (parts_of[:, :2] + 1j * parts_of[:, 2:] * alone).T
            if not alone:
                apart = np.sqrt((first.real**2 - second.real).astype(complex))
                first, second = first + apart, first - apart
            values[inside, k], partners[inside, k] = first, second
            values[inside, k][::parts], partners[inside, k][::parts] = some, rest
    # Between two samples that do not grow, a curve that swings over the axis is no onset.
    for curves, samples in ((values, one), (partners, other)):
        stays = np.zeros(shape, dtype=bool)
        stays[:-1] = np.repeat((np.maximum(samples[:-1].real, samples[1:].real) <= 0.0), parts, 0)
        np.minimum(curves.real, 0.0, out=curves.real, where=stays)
    partners[partners == values] = math.nan  # where the partner is not known
    if steps > 0:  # a decaying partner at one sample only is no curve
        partners[_without_neighbours(np.isfinite(partners)) & (partners.real <= 0.0)] = math.nan
    found = {"eigenvalues": values, "partners": partners, "converged": np.isfinite(values)}
    return replace(loci, speeds=speeds, errors=np.zeros(shape), **found)


def _without_neighbours(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which known entries of each column have no known entry before and behind them."""
    around = np.pad(known, ((1, 1), (0, 0)))
    return np.asarray(known & ~around[:-2] & ~around[2:])


def _draw_dots(ax: Axes, places: NDArray[np.complex128]) -> None:
    """Draws dots, leaving out those that are closer to others than `DOT_GAP`."""
    kept: list[tuple[complex, complex]] = []
    for place, shown in zip(places.T.ravel(), _on_paper(ax, places.T.ravel()), strict=True):
        if np.isfinite(shown) and all(abs(shown - near) >= DOT_GAP for near, _ in kept):
            kept.append((complex(shown), complex(place)))
    dots = np.array([place for _, place in kept], dtype=np.complex128)
    ax.plot(dots.real, dots.imag, **DOT)


def _on_paper(ax: Axes, places: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Places in points (1/72 inch) on the figure from places in data, x + i y."""
    flat = ax.transData.transform(np.column_stack([places.real.ravel(), places.imag.ravel()]))
    found = (flat[:, 0] + 1j * flat[:, 1]) * 72.0 / ax.figure.dpi
    return np.asarray(found.reshape(places.shape))


def _number_modes(ax: Axes, curves: NDArray[np.complex128], numbers: NDArray[np.int64]) -> None:
    """Writes the number of each curve, a column of places, as close to its start as it fits."""
    for curve, number in zip(curves.T, numbers.tolist(), strict=True):
        points = curve[np.isfinite(curve)]
        if points.size and number:
            chosen = np.linspace(0, points.size - 1, 24).astype(int)
            _write_number(ax, str(number), points[chosen], weight="bold")


def _write_number(ax: Axes, text: str, places: NDArray[np.complex128], **look: Any) -> None:
    """Writes a text beside one of some places, x + i y in the data."""
    at = np.column_stack([places.real, places.imag]).repeat(len(FULL_TURN), axis=0)
    sides = np.tile(FULL_TURN, (places.size, 1))
    look |= {"size": small_letters(), "zorder": 5.0, "annotation_clip": True}
    write_beside(ax, text, at, sides, **look)


def _coloured(
    ax: Axes,
    x: Array,
    y: Array,
    values: Array,
    colours: str,
    norm: Normalize,
    outlined: float,
    across: NDArray[np.bool_] | None,
) -> None:
    """Draws branches, the columns of x and y, in segments coloured by the mean of their values.

    Segments with the largest values are on top: of two roots with the same frequency the less
    stable one is visible. Values above `outlined` get a black outline, others a thin grey one. A
    point without neighbours on its branch, as at the only speed, is a disc. Columns of motions
    `across` the plane of a bent rest are dashed, as a legend says.
    """
    gaps = None
    if across is not None:
        on_paper = _on_paper_fitted(ax, x, y)
        steps = np.nan_to_num(np.abs(np.diff(on_paper, axis=0)))
        gaps = ((np.cumsum(steps, axis=0) - 0.5 * steps) % sum(DASH) > DASH[0]) & across
        for words, line in (("in the plane of rest", "-"), ("across it", "--")):
            ax.plot([], [], color="0.35", linewidth=2.0, linestyle=line, label=words)
        legend_below(ax)
    segments, means = pieces(x, y, values, gaps)
    points = np.stack(np.broadcast_arrays(x, y, values), axis=-1)
    alone = points[_without_neighbours(np.isfinite(points).all(axis=-1))]
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
    if alone.size:
        edges = np.where(alone[:, 2] > outlined, "black", "0.35").tolist()
        disc: dict[str, Any] = {"cmap": colours, "norm": norm, "edgecolors": edges, "zorder": 2.3}
        ax.scatter(alone[:, 0], alone[:, 1], s=20.0, c=alone[:, 2], linewidths=0.9, **disc)


def _mark_onsets(ax: Axes, real: Array, places: NDArray[np.complex128]) -> None:
    """Draws diamonds where real parts become positive, by linear interpolation along branches."""
    i, j = np.nonzero((real[:-1] <= 0.0) & (real[1:] > 0.0))
    part = real[i, j] / (real[i, j] - real[i + 1, j])
    onsets = places[i, j] + part * (places[i + 1, j] - places[i, j])
    ax.plot(onsets.real, onsets.imag, **ONSET)


def _on_paper_fitted(ax: Axes, x: Array, y: Array) -> NDArray[np.complex128]:
    """Places in points on the figure once its limits fit the columns of x and y, x + i y."""
    places = np.asarray(x + 1j * y)
    known = places[np.isfinite(places)]
    ax.update_datalim(np.column_stack([known.real, known.imag]))
    ax.autoscale_view()
    return _on_paper(ax, places)


def pieces(
    x: Array, y: Array, values: Array, gaps: NDArray[np.bool_] | None = None
) -> tuple[Array, Array]:
    """Segments of the columns of x and y, (k, 2, 2), and the means of their values, (k,).

    Segments in `gaps`, with a row for each pair of neighbouring points, are left out.
    """
    points = np.stack(np.broadcast_arrays(x, y, values), axis=-1)
    both = np.stack([points[:-1], points[1:]], axis=-2)
    kept = np.isfinite(both).all(axis=(-2, -1))
    segments = both[kept if gaps is None else kept & ~gaps]
    return segments[:, :, :2], segments[:, :, 2].mean(axis=1)


def across_of(loci: RootLoci) -> NDArray[np.bool_] | None:
    """Which columns of `branches_of` are motions across the plane of a bent rest, None if none."""
    if loci.across is None:
        return None
    return np.tile(loci.across, 2)[np.isfinite(_both_roots(loci)).any(axis=0)]


def branches_of(loci: RootLoci) -> NDArray[np.complex128]:
    """Upper roots, then their partners if real, as columns; NaN for points that are not drawn."""
    roots = _both_roots(loci)
    roots = roots[:, np.isfinite(roots).any(axis=0)]
    return np.asarray(roots.real + 1j * np.abs(roots.imag))


def _both_roots(loci: RootLoci) -> NDArray[np.complex128]:
    """Upper roots, then their partners if real, as columns, some of which may be NaN alone."""
    on_axis = loci.eigenvalues.imag == 0.0
    real = on_axis.copy()
    # Both roots are shown on steps that lead to the real axis or away from it.
    real[1:] |= on_axis[:-1]
    real[:-1] |= on_axis[1:]
    nothing = complex(math.nan, math.nan)
    upper = np.where(loci.converged, loci.eigenvalues, nothing)
    return np.column_stack([upper, np.where(loci.converged & real, loci.partners, nothing)])


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
    modes: Modes,
    count: int = 4,
    *,
    legend: bool = True,
    units: Units = "nondimensional",
    ax: Axes | None = None,
) -> Axes:
    """Mode shapes, as transverse displacement: real part solid, imaginary part dashed.

    If the modes are those of a pipe that is not the same in all directions, in three dimensions,
    the legend tells those across the plane z = 0, whose displacement is along z.

    Args:
        modes: the modes to show.
        count: number of modes shown, in the order of `modes`, from 1 to 1000, besides later ones
            that grow; if there are more modes, the title gives their number.
        legend: whether to add a legend, with the eigenvalue of each mode.
        units: "nondimensional", or "si" if the pipe has scales.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> ax = plot.mode_shapes(pp.modes(pp.Chain(pp.Pipe(0.2), 10), 4.0, count=3))

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check.instance("modes", modes, Modes)
    count = check.count("count", count, high=1000)
    check.flag("legend", legend)
    view = View(units, modes.shapes[0].model.pipe if modes.shapes else None)
    ax = view.axes(ax, (6.4, 4.2), ARC, Measure("displacement / largest value"))
    s = np.linspace(0.0, 1.0, 401)
    values = np.array([shape.eigenvalue for shape in modes.shapes], dtype=np.complex128)
    shown = np.flatnonzero((np.arange(values.size) < count) | grows(np.nan_to_num(values)))
    for i, which in enumerate(shown):
        displacement, value = modes.shapes[which](s), view.one(GROWTH) * values[which]
        across = modes.across is not None and bool(modes.across[which])
        displacement = displacement.reshape(-1, s.size)[int(across)]
        colour = common.CURVE_STYLES[i % len(common.CURVE_STYLES)]["color"]
        look: dict[str, Any] = {"color": colour, "linewidth": 1.0 + 0.4 * (i % 3)}
        label = rf"$\lambda = {value.real:.3g} {value.imag:+.3g}\,\mathrm{{i}}${' 1/s' * view.si}"
        label += ", across" if across else ""
        at = view.one(ARC) * s
        ax.plot(at, displacement.real, label=label, **look)
        ax.plot(at, displacement.imag, linestyle="--", **look)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.set(xlim=(0.0, view.one(ARC)), title=view.speed(modes.speed, 6))
    if len(modes.shapes) > shown.size:
        ax.set_title(f"{view.speed(modes.speed, 6)}, {shown.size} of {len(modes.shapes)} modes")
    if modes.shapes and legend:
        for word, line in (("real part", "-"), ("imaginary part", "--")):
            ax.plot([], [], color="0.4", linestyle=line, label=word)
        legend_below(ax)
    return ax
