# SPDX-License-Identifier: MIT
"""Pictures of the linear analysis: eigenvalues, mode shapes, convergence of the critical speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter
from numpy.typing import NDArray

from pipedyn.accuracy.convergence import own_error, relative_errors, trend
from pipedyn.linear.critical_speed import CriticalSpeed
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
    check_axes,
    check_mapping,
    check_type,
    law_label,
    notice,
    percent,
)
from pipedyn.util import check
from pipedyn.util.check import Array

NEUTRAL = 1e-9
"""Real parts up to this are rounding of undamped motion."""

FAMILY_STYLES: dict[str, dict[str, Any]] = {
    "rayleigh": {"color": VERMILION, "marker": "X", "linestyle": "-"},
    "uniform": {"color": ORANGE, "marker": "s", "linestyle": "--"},
    "frequency": {"color": PURPLE, "marker": "v", "linestyle": ":"},
    "consistent": {"color": BLUE, "marker": "o", "linestyle": "-"},
    "midpoint": {"color": SKY, "marker": "D", "linestyle": "--"},
    "beam": {"color": GREEN, "marker": "^", "linestyle": "-."},
    "legendre": {"color": BLACK, "marker": "P", "linestyle": ":"},
}
"""Look of each spring rule and basis in `convergence`."""


def _check_loci(ax: Any, loci: Any, benchmark: Any) -> None:
    check_axes(ax)
    check_type("loci", loci, RootLoci)
    if benchmark is not None:
        check_type("benchmark", benchmark, RootLoci)


# ---------------------------------------------------------------------------------- eigenvalues


def root_loci(
    ax: Axes, loci: RootLoci, benchmark: RootLoci | None = None, highest: float | None = None
) -> Axes:
    """Branches in the upper half of the complex plane, flow speed as colour.

    The lower half is their mirror image. A pair that has turned real shows as two curves on the
    real axis.

    Args:
        ax: where to draw; its first collection serves `Figure.colorbar`.
        loci: branches of the model.
        benchmark: branches of the continuous pipe, drawn as black dots.
        highest: speed at the end of the colours; that of the loci where not given.
    """
    _check_loci(ax, loci, benchmark)
    end = float(loci.speeds[-1])
    if highest is not None:
        end = check.real("highest", highest, low=0.0, open_low=True)
    norm = Normalize(0.0, end or 1.0)
    middle = 0.5 * (loci.speeds[1:] + loci.speeds[:-1])
    for branch in _branches(loci):
        segments, there = _segments(branch.real, branch.imag)
        lines = LineCollection(segments, cmap="viridis", norm=norm, linewidths=2.0, zorder=2.2)
        lines.set_array(middle[there])
        outline = LineCollection(segments, colors="0.35", linewidths=2.6, zorder=2.1)
        for collection in (lines, outline):
            collection.set_capstyle("round")
            ax.add_collection(collection)
    if benchmark is not None:
        for branch in _branches(benchmark):
            dots = branch[:: dot_stride(benchmark)]
            ax.plot(dots.real, dots.imag, **_dots())
    ax.axvline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.autoscale_view()
    ax.set_xlabel(REAL_LABEL)
    ax.set_ylabel(IMAGINARY_LABEL)
    return ax


def frequencies(
    ax: Axes, loci: RootLoci, benchmark: RootLoci | None = None, largest: float | None = None
) -> Axes:
    """|Im lambda| against flow speed, the real part as a diverging colour centred on zero.

    What is unstable has a black outline beside its colour; a diamond marks each onset.

    Args:
        ax: where to draw; its first collection serves `Figure.colorbar`.
        loci: branches of the model.
        benchmark: branches of the continuous pipe, drawn as black dots.
        largest: |Re lambda| at the ends of the colours, linear within 1 and logarithmic beyond;
            that of the loci where not given.
    """
    _check_loci(ax, loci, benchmark)
    branches = _branches(loci)
    if largest is None:
        largest = max((float(abs(x)) for x in np.ravel(branches).real if x == x), default=0.0)
    largest = check.real("largest", largest, low=0.0)
    norm = SymLogNorm(1.0, vmin=-max(largest, 2.0), vmax=max(largest, 2.0))
    pieces, means = [], []
    for branch in branches:
        segments, there = _segments(loci.speeds, branch.imag)
        pieces += segments
        means.append((0.5 * (branch.real[1:] + branch.real[:-1]))[there])
    real = np.concatenate(means)
    order = np.argsort(real)  # of two roots with one frequency, the less stable is on top
    pieces, real = [pieces[i] for i in order], real[order]
    unstable = real > NEUTRAL
    lines = LineCollection(pieces, cmap="RdBu_r", norm=norm, linewidths=2.0, zorder=2.2)
    lines.set_array(real)
    outline = LineCollection(
        pieces,
        colors=np.where(unstable, "black", "0.35").tolist(),
        linewidths=np.where(unstable, 4.2, 2.6).tolist(),
        zorder=2.1,
    )
    for collection in (lines, outline):
        collection.set_capstyle("round")
        ax.add_collection(collection)
    for branch in branches:
        ax.plot(
            *_onsets(loci.speeds, branch),
            linestyle="none",
            marker="D",
            markersize=4.5,
            markerfacecolor="white",
            markeredgecolor="black",
            markeredgewidth=0.9,
            zorder=4.0,
        )
    if benchmark is not None:
        every = dot_stride(benchmark)
        for branch in _branches(benchmark):
            ax.plot(benchmark.speeds[::every], branch.imag[::every], **_dots())
    ax.autoscale_view()
    ax.set_xlabel(SPEED_LABEL)
    ax.set_ylabel(FREQUENCY_LABEL)
    return ax


def _branches(loci: RootLoci) -> list[NDArray[np.complex128]]:
    """Upper roots, then the partners where they are real; NaN where there is nothing to draw."""
    nothing = complex(math.nan, math.nan)
    upper = np.where(loci.converged, loci.eigenvalues, nothing)
    upper = upper.real + 1j * np.abs(upper.imag)
    real = np.zeros(upper.shape, dtype=np.bool_)
    real[:] = loci.eigenvalues.imag == 0.0
    # The step that leads to the real axis is drawn for both roots.
    real[1:] |= loci.eigenvalues.imag[:-1] == 0.0
    real[:-1] |= loci.eigenvalues.imag[1:] == 0.0
    partners = np.where(loci.converged & real, loci.partners, nothing)
    partners = partners.real + 1j * np.abs(partners.imag)
    columns = [*upper.T, *(column for column in partners.T if np.isfinite(column).any())]
    return [np.asarray(column) for column in columns]


def _segments(x: Array, y: Array) -> tuple[list[Array], NDArray[np.bool_]]:
    """Line segments between neighbouring points, each of shape (2, 2), and which have both ends."""
    points = np.stack([x, y], axis=-1)
    both = np.stack([points[:-1], points[1:]], axis=1)
    there = np.array([bool(np.isfinite(segment).all()) for segment in both], dtype=np.bool_)
    return list(both[there]), there


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
    """Every how many speeds of a benchmark there is a dot."""
    check_type("loci", loci, RootLoci)
    return max(1, round((loci.speeds.size - 1) / 18))


def _dots() -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": "o",
        "markersize": 2.2,
        "markerfacecolor": "black",
        "markeredgewidth": 0.0,
        "zorder": 3.0,
    }


def mode_shapes(ax: Axes, modes: Modes) -> Axes:
    """Transverse displacement along the pipe: real part solid, imaginary part dashed.

    Args:
        ax: where to draw.
        modes: one curve pair for each eigenvalue that is not the lower of a conjugate pair.
    """
    check_axes(ax)
    check_type("modes", modes, Modes)
    s = np.linspace(0.0, 1.0, 401)
    upper = [shape for shape in modes.shapes if shape.eigenvalue.imag >= 0.0]
    colours = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
    for i, shape in enumerate(upper):
        displacement = shape(s)
        look: dict[str, Any] = {
            "color": colours[i % len(colours)],
            "linewidth": 1.0 + 0.4 * (i % 3),
        }
        value = shape.eigenvalue
        label = rf"$\lambda = {value.real:.3g} {value.imag:+.4g}\,\mathrm{{i}}$"
        ax.plot(s, displacement.real, label=label, **look)
        ax.plot(s, displacement.imag, linestyle="--", **look)
    ax.axhline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(-1.08, 1.08)
    ax.set_xlabel("arc length $s / L$ from the clamp")
    ax.set_ylabel("displacement (largest = 1); Re solid, Im dashed")
    ax.set_title(rf"$u = {modes.speed:g}$")
    if upper:
        ax.legend(loc="best")
    return ax


# ---------------------------------------------------------------------------------- convergence


def convergence(
    ax: Axes, families: Mapping[str, Sequence[CriticalSpeed]], exact: CriticalSpeed
) -> Axes:
    """Error of the critical speed against degrees of freedom, with fitted orders.

    A model that loses stability in another way than the continuous pipe (divergence for flutter)
    shows as an open marker and is not fitted.

    Args:
        ax: where to draw.
        families: critical speeds of models of growing size under the name of their spring rule or
            basis.
        exact: critical speed of the continuous pipe.
    """
    check_axes(ax)
    check_mapping("families", families)
    for name, found in families.items():
        check_type(f"families[{name!r}]", found, Sequence)
        for i, critical in enumerate(found):
            check_type(f"families[{name!r}][{i}]", critical, CriticalSpeed)
    check_type("exact", exact, CriticalSpeed)
    families = {name: found for name, found in families.items() if found}
    ax.set_xlabel("degrees of freedom $n$, $m$")
    ax.set_ylabel(r"relative error of the critical speed, $|u_c / u_{c,\mathrm{exact}} - 1|$")
    if exact.speed == 0.0:
        return notice(ax, "The critical speed is 0: nothing converges to it.")
    floor = max((own_error(found, exact) for found in families.values()), default=1e-15)
    least, largest, all_alike = 1.0, 2.0, True
    for name, found in families.items():
        sizes, errors, alike = relative_errors(found, exact)
        shown = np.maximum(np.abs(errors), floor)
        look = {"linewidth": 1.1, "markersize": 4.5, **FAMILY_STYLES.get(name, {"color": "0.4"})}
        fitted = trend(found, exact)
        label = f"{_family(name)}: {law_label(fitted)}"
        ax.plot(sizes[alike], shown[alike], label=label, **look)
        look |= {"linestyle": "none", "markerfacecolor": "none"}
        ax.plot(sizes[~alike], shown[~alike], **look)
        if fitted.law == "flat":
            ax.axhline(abs(fitted.limit), color=look["color"], linewidth=0.7, zorder=0.8)
            ax.annotate(
                percent(fitted.limit),
                (1.0, abs(fitted.limit)),
                xytext=(3, 0),
                xycoords=ax.get_yaxis_transform(),
                textcoords="offset points",
                color=look["color"],
                va="center",
            )
        least, largest = min([least, *shown]), max([largest, *shown])
        all_alike = all_alike and bool(alike.all())
    if not all_alike:
        label = f"open: no {exact.kind}, not fitted"
        ax.plot([], [], "o", color="0.3", markersize=4.5, markerfacecolor="none", label=label)
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    if least <= floor:
        ax.axhspan(0.1 * floor, floor, color="0.9", zorder=0.3)
        ax.text(
            0.02,
            0.3 * floor,
            "own error of the speeds compared; smaller distances stand at its edge",
            transform=ax.get_yaxis_transform(),
            fontsize=6.5,
            color="0.35",
            va="center",
            clip_on=True,
        )
    ax.xaxis.set_major_formatter(ScalarFormatter())
    ax.grid(True, which="major", color="0.9", linewidth=0.5, zorder=0.2)
    _legend_on_top(ax, 0.1 * least, 1.5 * largest)
    return ax


def _legend_on_top(ax: Axes, low: float, high: float) -> None:
    """A legend inside logarithmic axes, above the range from low to high, whatever the layout."""
    handles, _ = ax.get_legend_handles_labels()
    size = min(
        7.0, FontProperties(size=matplotlib.rcParams["legend.fontsize"]).get_size_in_points()
    )
    box = ax.get_window_extent()
    dots = getattr(ax.get_figure(), "dpi", 100.0)
    width, height = 72.0 * box.width / dots, 72.0 * box.height / dots
    columns = 2 if width > 44.0 * size else 1
    rows = math.ceil(len(handles) / columns)
    share = min(0.6, (1.5 * rows + 2.5) * size / height) if rows else 0.0
    ax.set_ylim(low, low * (high / low) ** (1.0 / (1.0 - share)))
    decades = np.arange(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
    step = math.ceil(decades.size / 20)
    ax.yaxis.set_major_locator(FixedLocator((10.0**decades)[::-step].tolist()))
    ax.yaxis.set_minor_locator(NullLocator())
    if handles:
        ax.legend(
            loc="upper center",
            ncols=columns,
            fontsize=size,
            handlelength=2.5,
            handletextpad=0.6,
            columnspacing=1.0,
            framealpha=1.0,
        )


def _family(name: str) -> str:
    kind = "reduced" if name in ("beam", "legendre") else "chain"
    return f"{kind}, {name}" + (" (the paper's)" if name == "rayleigh" else "")
