# SPDX-License-Identifier: MIT
"""Pictures of results. Every picture draws on a matplotlib Axes that it is given, and returns it.

Speed is shown by colours that grow in lightness, and every distinction made by colour is made a
second time by line style, marker or outline, so that pictures survive grey print.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from itertools import pairwise, product
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.critical import CriticalSpeed
from pipedyn.modal import Modes, RootLoci
from pipedyn.sensitivity import Crossing
from pipedyn.stability import StabilityCurve
from pipedyn.trade import Trend, own_error, relative_errors, trend

SPEED_LABEL = r"flow speed $u = V L \, (\mu_f / EI)^{1/2}$"
REAL_LABEL = r"Re $\lambda$  $(1/T)$"
IMAGINARY_LABEL = r"Im $\lambda$  $(1/T)$"
FREQUENCY_LABEL = r"|Im $\lambda$|  $(1/T)$"
BETA_LABEL = r"mass ratio $\beta = \mu_f / (\mu_p + \mu_f)$"

NEUTRAL = 1e-9
"""Real parts up to this are rounding of undamped motion."""

# The colours of Okabe and Ito, which remain distinct to colour-blind readers.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

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

CURVE_STYLES: tuple[dict[str, Any], ...] = (
    {"color": BLACK, "linestyle": "-"},
    {"color": BLUE, "linestyle": (0, (5, 1.5))},
    {"color": GREEN, "linestyle": (0, (6, 1.5, 1, 1.5))},
    {"color": VERMILION, "linestyle": (0, (1, 1.2))},
    {"color": PURPLE, "linestyle": (0, (3, 1, 1, 1, 1, 1))},
    {"color": ORANGE, "linestyle": (0, (8, 3))},
)


def style() -> AbstractContextManager[None]:
    """Settings for a page of print, in force within a with statement."""
    settings: dict[Any, Any] = {
        "font.size": 8.0,
        "axes.titlesize": 8.0,
        "axes.labelsize": 8.0,
        "legend.fontsize": 7.5,
        "xtick.labelsize": 7.5,
        "ytick.labelsize": 7.5,
        "axes.linewidth": 0.6,
        "xtick.direction": "in",
        "ytick.direction": "in",
        "xtick.top": True,
        "ytick.right": True,
        "legend.framealpha": 0.9,
        "legend.handlelength": 2.8,
        "pdf.fonttype": 42,
        "savefig.dpi": 200,
    }
    return matplotlib.rc_context(settings)


def panels(rows: int, columns: int, width: float, height: float) -> tuple[Figure, NDArray[Any]]:
    """An empty figure, width x height inches, and its Axes, shape (rows, columns), on one range."""
    rows = _check.count("rows", rows, high=100)
    columns = _check.count("columns", columns, high=100)
    width = _check.real("width", width, low=0.1, high=200.0)
    height = _check.real("height", height, low=0.1, high=200.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, axes


def colour_bar(figure: Figure, axes: NDArray[Any], label: str) -> None:
    """One colour bar beside the panels, of the first collection drawn in any of them."""
    _check_type("figure", figure, Figure)
    _check_type("axes", axes, np.ndarray)
    for ax in axes.flat:
        _check_type("axes", ax, Axes)
    _check_type("label", label, str)
    drawn = [ax.collections[0] for ax in axes.flat if ax.collections]
    if not drawn:
        return
    bar = figure.colorbar(drawn[0], ax=axes, label=label, pad=0.01, aspect=40)
    if isinstance(drawn[0].norm, SymLogNorm):
        end = float(drawn[0].norm.vmax or 1.0)
        decades = [10.0**k for k in range(math.floor(math.log10(end)) + 1)]
        steps = [a * b for a in decades for b in (1.0, 3.0) if a * b <= end]
        ticks = [-step for step in reversed(steps)] + [0.0, *steps]
        bar.set_ticks(ticks, labels=[f"{tick:g}".replace("-", "\u2212") for tick in ticks])
        bar.minorticks_off()


def _check_axes(ax: Any) -> None:
    _check_type("ax", ax, Axes)


def _check_type(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be of type {kind.__name__}, got {_check.shown(value)}")


def _check_mapping(name: str, value: Any) -> None:
    _check_type(name, value, Mapping)
    for key in value:
        _check_type(f"the names of {name}", key, str)


def _check_loci(ax: Any, loci: Any, benchmark: Any) -> None:
    _check_axes(ax)
    _check_type("loci", loci, RootLoci)
    if benchmark is not None:
        _check_type("benchmark", benchmark, RootLoci)


def notice(ax: Axes, text: str) -> Axes:
    """A sentence in place of a picture."""
    _check_axes(ax)
    _check_type("text", text, str)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", wrap=True)
    return ax


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
        end = _check.real("highest", highest, low=0.0, open_low=True)
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
    largest = _check.real("largest", largest, low=0.0)
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
    _check_type("loci", loci, RootLoci)
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
    _check_axes(ax)
    _check_type("modes", modes, Modes)
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
    _check_axes(ax)
    _check_mapping("families", families)
    for name, found in families.items():
        _check_type(f"families[{name!r}]", found, Sequence)
        for i, critical in enumerate(found):
            _check_type(f"families[{name!r}][{i}]", critical, CriticalSpeed)
    _check_type("exact", exact, CriticalSpeed)
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
        label = f"{_family(name)}: {_law(fitted)}"
        ax.plot(sizes[alike], shown[alike], label=label, **look)
        look |= {"linestyle": "none", "markerfacecolor": "none"}
        ax.plot(sizes[~alike], shown[~alike], **look)
        if fitted.law == "flat":
            ax.axhline(abs(fitted.limit), color=look["color"], linewidth=0.7, zorder=0.8)
            ax.annotate(
                _percent(fitted.limit),
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


def _law(fitted: Trend) -> str:
    if fitted.law == "power":
        return f"order {fitted.rate:.2f}"
    if fitted.law == "exponential":
        return f"÷ {fitted.rate:.1f} per d.o.f."
    if fitted.law == "flat":
        return f"tends to {_percent(fitted.limit)}"
    return "no clear order"


def _percent(part: float) -> str:
    return f"{100.0 * part:+.2f} %".replace("-", "\u2212")


# -------------------------------------------------------------------------------- stability map


def stability_map(
    ax: Axes,
    curves: Mapping[str, StabilityCurve],
    highest: float | None = None,
    marked: CriticalSpeed | None = None,
) -> Axes:
    """Boundaries of stability: flow speed against a parameter, folds included.

    Passages at neighbouring parameters are joined where frequency and sense of passage agree, and
    the ends of two that vanish together are joined round the nose of the fold, a parabola through
    both with the slopes that their sensitivities by beta tell.

    Args:
        ax: where to draw.
        curves: stability curves by label, made over beta with a `max_speed`, so that they hold
            every passage.
        highest: end of the axis of speed.
        marked: a critical speed to mark, at its pipe's beta.
    """
    _check_axes(ax)
    _check_mapping("curves", curves)
    for label, curve in curves.items():
        _check_type(f"curves[{label!r}]", curve, StabilityCurve)
    if highest is not None:
        highest = _check.real("highest", highest, low=0.0, open_low=True)
    if marked is not None:
        _check_type("marked", marked, CriticalSpeed)
    tallest = 0.0
    for (label, curve), look in zip(curves.items(), _cycled(len(curves)), strict=True):
        strands = _strands(curve)
        tallest = max([tallest, *(float(strand[:, 1].max()) for strand, _ in strands)])
        if not strands:
            ax.plot([], [], linewidth=1.5, label=f"{label}: none here", **look)
        for strand, kind in strands:
            ax.plot(strand[:, 0], strand[:, 1], linewidth=1.5, label=label, **look)
            label = "_" + label.lstrip("_")
            if kind == "divergence":
                ax.annotate(
                    "divergence",
                    strand[strand.shape[0] // 2],
                    xytext=(0, 3),
                    textcoords="offset points",
                    color=look["color"],
                    ha="center",
                    fontsize=7.0,
                )
    if marked is not None and (highest is None or marked.speed <= highest):
        place = rf"$\beta = {marked.pipe.beta:g}$, $\gamma = {marked.pipe.gamma:g}$"
        ax.plot(
            marked.pipe.beta,
            marked.speed,
            linestyle="none",
            marker="o",
            markersize=7.0,
            markerfacecolor="none",
            markeredgecolor="black",
            markeredgewidth=1.2,
            clip_on=False,
            zorder=4.0,
            label=f"{place}: $u_c = {marked.speed:.4g}$",
        )
    ax.set_ylim(0.0, highest)
    if tallest == 0.0:
        notice(ax, "There is no boundary of stability above $u = 0$.")
    ax.set_xlabel(BETA_LABEL)
    ax.set_ylabel(SPEED_LABEL)
    if curves or marked is not None:
        ax.legend(loc="best")
    return ax


def _cycled(count: int) -> list[dict[str, Any]]:
    return [CURVE_STYLES[i % len(CURVE_STYLES)] for i in range(count)]


def boundaries(found: Iterable[Crossing]) -> list[Crossing]:
    """Passages at which the pipe gains or loses stability altogether."""
    _check_type("found", found, Iterable)
    passages = list(found)
    for i, passage in enumerate(passages):
        _check_type(f"found[{i}]", passage, Crossing)
    return [c for c in passages if min(c.unstable_before, c.unstable_after) == 0]


Node = tuple[int, int]
End = tuple[Node, Literal["left", "right"]]


def _strands(curve: StabilityCurve) -> list[tuple[Array, str]]:
    """Boundaries of stability as polylines (parameter, speed), each of shape (k, 2), and kinds."""
    failed = {failure.index for failure in curve.failures}
    taken = [i for i in np.argsort(curve.values) if i not in failed]
    values = curve.values[taken]
    columns = [boundaries(curve.crossings[i]) for i in taken]
    tall = max([c.speed for column in columns for c in column], default=0.0) or 1.0
    edges: dict[End, tuple[End, Array]] = {}

    def join(a: End, b: End, points: Array) -> None:
        edges[a], edges[b] = (b, points), (a, points[::-1])

    for i, (left, right) in enumerate(pairwise(columns)):
        step = float(values[i + 1] - values[i])
        matched = _matched(left, right, step, tall)
        for j, k in matched:
            bow = _bow((values[i], left[j]), (values[i + 1], right[k]), tall)
            join(((i, j), "right"), ((i + 1, k), "left"), bow)
        loose = [j for j in range(len(left)) if j not in {j for j, _ in matched}]
        for j, k, points in _noses(values[i], left, loose, step):
            join(((i, j), "right"), ((i, k), "right"), points)
        loose = [k for k in range(len(right)) if k not in {k for _, k in matched}]
        for j, k, points in _noses(values[i + 1], right, loose, -step):
            join(((i + 1, j), "left"), ((i + 1, k), "left"), points)
    nodes = {(i, j): c for i, column in enumerate(columns) for j, c in enumerate(column)}
    places = {node: np.array([values[node[0]], c.speed]) for node, c in nodes.items()}
    return [(points, nodes[first].kind) for first, points in _walked(places, edges)]


def _walked(
    nodes: dict[Node, Array], edges: dict[End, tuple[End, Array]]
) -> list[tuple[Node, Array]]:
    """Chains of edges with the node that each starts from, open ones first."""
    unseen = set(nodes)
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    ends: list[End] = [*product(nodes, sides)]
    strands = []
    for node, side in sorted(ends, key=lambda end: end in edges):
        if node not in unseen:
            continue
        first, strand = node, [nodes[node][None]]
        unseen.discard(node)
        end: End = (node, _other(side))
        while end in edges:
            (node, side), points = edges[end]
            strand.append(points[1:])
            if node not in unseen:
                break
            unseen.discard(node)
            end = (node, _other(side))
        strands.append((first, np.concatenate(strand)))
    return strands


def _other(side: Literal["left", "right"]) -> Literal["left", "right"]:
    return "left" if side == "right" else "right"


FARTHEST = 0.15
"""Passages that disagree by more, as a part of the highest speed, do not continue one another."""


def _matched(
    left: list[Crossing], right: list[Crossing], step: float, tall: float
) -> list[tuple[int, int]]:
    """Which passage of the right column continues which of the left; tall: the highest speed.

    Along a branch the sense of passage changes at the nose of a fold only.
    """
    cost = np.full((len(left), len(right)), 1e3)
    for (j, a), (k, b) in product(enumerate(left), enumerate(right)):
        if a.kind != b.kind or a.destabilising != b.destabilising:
            continue
        scale = 0.2 / (1.0 + max(a.frequency, b.frequency))
        plain = abs(a.speed - b.speed) / tall + scale * abs(a.frequency - b.frequency)
        (ua, wa), (ub, wb) = _slopes(a), _slopes(b)
        speeds = a.speed - b.speed + 0.5 * step * (ua + ub)
        tuned = a.frequency - b.frequency + 0.5 * step * (wa + wb)
        cost[j, k] = min(plain, abs(speeds) / tall + scale * abs(tuned))
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return [(int(j), int(k)) for j, k in pairs if cost[j, k] < FARTHEST]


def _slopes(crossing: Crossing) -> tuple[float, float]:
    """d(speed)/dbeta and d(frequency)/dbeta; 0 where there is no sensitivity."""
    known = crossing.sensitivity
    if known is None or known.speed.beta is None or known.frequency.beta is None:
        return 0.0, 0.0
    return known.speed.beta, known.frequency.beta


def _bow(a: tuple[float, Crossing], b: tuple[float, Crossing], tall: float) -> Array:
    """Hermite cubic by arc length between two passages, shape (k, 2)."""
    ends = np.array([[x, crossing.speed] for x, crossing in (a, b)])
    stretch = np.array([tall, 1.0])  # beta spans 1
    p, q = ends * stretch
    chord = q - p
    if any(crossing.sensitivity is None for _, crossing in (a, b)):
        return ends
    tangents = [np.array([1.0, _slopes(crossing)[0]]) * stretch for _, crossing in (a, b)]
    d, e = (t / np.linalg.norm(t) * np.linalg.norm(chord) for t in tangents)
    t = np.linspace(0.0, 1.0, 9)[:, None]
    points = p + chord * t * t * (3 - 2 * t) + d * t * (1 - t) ** 2 - e * t * t * (1 - t)
    return np.asarray(points / stretch)


def _noses(
    value: float, column: list[Crossing], loose: list[int], step: float
) -> list[tuple[int, int, Array]]:
    """Neighbouring passages that end together before the next column, and the way round."""
    found = []
    order = sorted(loose, key=lambda j: column[j].speed)
    while len(order) > 1:
        nearest = min(pairwise(order), key=lambda jk: column[jk[1]].speed - column[jk[0]].speed)
        a, b = (column[j] for j in nearest)
        order = [j for j in order if j not in nearest]
        (slope_a, _), (slope_b, _) = _slopes(a), _slopes(b)
        if a.kind != b.kind or a.destabilising == b.destabilising or slope_a == slope_b:
            continue
        # A parabola's tangents meet twice as far off as its vertex.
        reach = (b.speed - a.speed) / (slope_a - slope_b)
        if reach * step <= 0.0:
            continue
        reach = math.copysign(min(abs(reach), 2.0 * abs(step)), step)
        corner = 0.5 * (a.speed + b.speed + reach * (slope_a + slope_b))
        control = np.array([value + reach, min(max(corner, a.speed), b.speed)])
        t = np.linspace(0.0, 1.0, 17)[:, None]
        p, q = np.array([value, a.speed]), np.array([value, b.speed])
        points = p * (1 - t) ** 2 + 2.0 * control * t * (1 - t) + q * t * t
        found.append((*nearest, points))
    return found


__all__ = [
    "Figure",
    "boundaries",
    "colour_bar",
    "convergence",
    "dot_stride",
    "frequencies",
    "mode_shapes",
    "notice",
    "panels",
    "root_loci",
    "stability_map",
    "style",
]
