# SPDX-License-Identifier: MIT
"""Pictures of the linear analysis: eigenvalues against flow speed, and mode shapes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, SymLogNorm
from numpy.typing import ArrayLike, NDArray

from pipedyn.linear.modes import Modes, RootLoci
from pipedyn.plot.style import (
    BLACK,
    BLUE,
    FREQUENCY_LABEL,
    GREEN,
    IMAGINARY_LABEL,
    ORANGE,
    PURPLE,
    REAL_LABEL,
    SKY,
    SPEED_LABEL,
    VERMILION,
    axes_or_new,
    check_type,
    open_marker,
)
from pipedyn.util import check
from pipedyn.util.check import Array

NEUTRAL = 1e-9
"""Real parts up to this are rounding of undamped motion: the lowest roots, up to 1e4, are right to
1e-13 of their size."""

DOTS = 18
"""Steps between the dots of a benchmark branch: 19 dots of 2.2 points leave the curve visible
between them in a panel two inches wide."""


def root_loci(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    highest: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Branches in the upper half of the complex plane, flow speed as colour.

    The lower half is their mirror image. A pair that has become real shows as two curves on the
    real axis.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots.
        highest: speed at the end of the colours; that of the loci where not given.
        ax: where to draw; new Axes where not given. The first collection serves `colour_bar`.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    ax = _checked(loci, benchmark, ax)
    end = float(loci.speeds[-1])
    if highest is not None:
        end = check.real("highest", highest, low=0.0, open_low=True)
    norm = Normalize(0.0, end or 1.0)
    middle = 0.5 * (loci.speeds[1:] + loci.speeds[:-1])
    for branch in _branches(loci):
        segments, exists = _segments(branch.real, branch.imag)
        _coloured(ax, segments, middle[exists], "viridis", norm)
    if benchmark is not None:
        for branch in _branches(benchmark):
            _dots(ax, benchmark, branch.real, branch.imag)
    ax.axvline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.autoscale_view()
    ax.set_xlabel(REAL_LABEL)
    ax.set_ylabel(IMAGINARY_LABEL)
    return ax


def frequencies(
    loci: RootLoci,
    benchmark: RootLoci | None = None,
    largest: float | None = None,
    ax: Axes | None = None,
) -> Axes:
    """|Im lambda| against flow speed, the real part as a diverging colour centred on zero.

    Unstable parts have a black outline beside their colour; a diamond marks each onset.

    Args:
        loci: branches of the model.
        benchmark: branches of the continuous pipe, shown as black dots.
        largest: |Re lambda| at the ends of the colours, linear within 1 and logarithmic beyond;
            that of the loci where not given.
        ax: where to draw; new Axes where not given. The first collection serves `colour_bar`.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    ax = _checked(loci, benchmark, ax)
    branches = _branches(loci)
    if largest is None:
        largest = max((float(abs(x)) for x in np.ravel(branches).real if x == x), default=0.0)
    largest = check.real("largest", largest, low=0.0)
    norm = SymLogNorm(1.0, vmin=-max(largest, 2.0), vmax=max(largest, 2.0))
    pieces, means = [], []
    for branch in branches:
        segments, exists = _segments(loci.speeds, branch.imag)
        pieces += segments
        means.append((0.5 * (branch.real[1:] + branch.real[:-1]))[exists])
    real = np.concatenate(means)
    order = np.argsort(real)  # of two roots with one frequency, the less stable is on top
    pieces, real = [pieces[i] for i in order], real[order]
    unstable = real > NEUTRAL
    outline = np.where(unstable, "black", "0.35").tolist()
    _coloured(ax, pieces, real, "RdBu_r", norm, outline, np.where(unstable, 4.2, 2.6).tolist())
    for branch in branches:
        onsets = _onsets(loci.speeds, branch)
        ax.plot(*onsets, **open_marker(4.5, marker="D", markeredgewidth=0.9, zorder=4.0))
    if benchmark is not None:
        for branch in _branches(benchmark):
            _dots(ax, benchmark, benchmark.speeds, branch.imag)
    ax.autoscale_view()
    ax.set_xlabel(SPEED_LABEL)
    ax.set_ylabel(FREQUENCY_LABEL)
    return ax


def _checked(loci: Any, benchmark: Any, ax: Any) -> Axes:
    """The Axes to draw on, once the arguments of both pictures of eigenvalues are checked."""
    check_type("loci", loci, RootLoci)
    if benchmark is not None:
        check_type("benchmark", benchmark, RootLoci)
    return axes_or_new(ax, 4.8, 4.2)


def _coloured(
    ax: Axes,
    segments: list[Array],
    values: Array,
    colours: str,
    norm: Normalize,
    outline: ArrayLike = "0.35",
    widths: ArrayLike = 2.6,
) -> None:
    """Segments coloured by their values, over an outline of their own colours and widths."""
    lines = LineCollection(segments, cmap=colours, norm=norm, linewidths=2.0, zorder=2.2)
    lines.set_array(values)
    border: Any = {"colors": outline, "linewidths": widths}
    for collection in (lines, LineCollection(segments, zorder=2.1, **border)):
        collection.set_capstyle("round")
        ax.add_collection(collection)


def _branches(loci: RootLoci) -> list[NDArray[np.complex128]]:
    """Upper roots, then the partners where they are real; NaN where there is nothing to draw."""
    nothing = complex(math.nan, math.nan)
    upper = np.where(loci.converged, loci.eigenvalues, nothing)
    upper = upper.real + 1j * np.abs(upper.imag)
    on_axis = loci.eigenvalues.imag == 0.0
    real = on_axis.copy()
    # The step that leads to the real axis is shown for both roots.
    real[1:] |= on_axis[:-1]
    real[:-1] |= on_axis[1:]
    partners = np.where(loci.converged & real, loci.partners, nothing)
    partners = partners.real + 1j * np.abs(partners.imag)
    columns = [*upper.T, *(column for column in partners.T if np.isfinite(column).any())]
    return [np.asarray(column) for column in columns]


def _segments(x: Array, y: Array) -> tuple[list[Array], NDArray[np.bool_]]:
    """Segments between neighbouring points, each of shape (2, 2), and which of them exist."""
    points = np.stack([x, y], axis=-1)
    both = np.stack([points[:-1], points[1:]], axis=1)
    exists = np.asarray(np.isfinite(both).all(axis=(1, 2)))
    return list(both[exists]), exists


def _onsets(speeds: Array, branch: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Speed and |Im| where the real part becomes positive, by linear interpolation."""
    real = branch.real
    with np.errstate(invalid="ignore"):
        at = np.flatnonzero((real[:-1] <= NEUTRAL) & (real[1:] > NEUTRAL))
    part = real[at] / (real[at] - real[at + 1])
    return (
        speeds[at] + part * (speeds[at + 1] - speeds[at]),
        branch.imag[at] + part * (branch.imag[at + 1] - branch.imag[at]),
    )


def dot_stride(loci: RootLoci) -> int:
    """Number of speeds from one dot of a benchmark to the next."""
    check_type("loci", loci, RootLoci)
    return max(1, round((loci.speeds.size - 1) / DOTS))


def _dots(ax: Axes, benchmark: RootLoci, x: Array, y: Array) -> None:
    """A benchmark's branch as dots."""
    every = slice(None, None, dot_stride(benchmark))
    ax.plot(x[every], y[every], "o", markersize=2.2, color="black", markeredgewidth=0.0, zorder=3.0)


def mode_shapes(modes: Modes, ax: Axes | None = None) -> Axes:
    """Transverse displacement along the pipe: real part solid, imaginary part dashed.

    Args:
        modes: two curves for each eigenvalue that is not the lower of a conjugate pair.
        ax: where to draw; new Axes where not given.

    Raises:
        TypeError: for bad arguments.
    """
    check_type("modes", modes, Modes)
    ax = axes_or_new(ax, 6.4, 4.2)
    s = np.linspace(0.0, 1.0, 401)
    upper = [shape for shape in modes.shapes if shape.eigenvalue.imag >= 0.0]
    colours = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
    for i, shape in enumerate(upper):
        displacement = shape(s)
        colour, width = colours[i % len(colours)], 1.0 + 0.4 * (i % 3)
        value = shape.eigenvalue
        label = rf"$\lambda = {value.real:.3g} {value.imag:+.4g}\,\mathrm{{i}}$"
        ax.plot(s, displacement.real, label=label, color=colour, linewidth=width)
        ax.plot(s, displacement.imag, linestyle="--", color=colour, linewidth=width)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(-1.08, 1.08)
    ax.set_xlabel("arc length $s / L$ from the clamp")
    ax.set_ylabel("displacement (largest = 1); Re solid, Im dashed")
    ax.set_title(rf"$u = {modes.speed:g}$")
    if upper:
        ax.legend(loc="best")
    return ax
