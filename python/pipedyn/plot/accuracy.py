# SPDX-License-Identifier: MIT
"""Pictures of accuracy: error against size, and error against cost with the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, ScalarFormatter

from pipedyn.accuracy.convergence import ConvergenceLaw, convergence_law, own_error, relative_errors
from pipedyn.accuracy.trade import COSTS, Trade, TradeRow
from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.models.galerkin import BASES
from pipedyn.plot.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    axes_or_new,
    check_mapping,
    check_type,
    notice,
    open_marker,
)
from pipedyn.util import check

FAMILY_STYLES: dict[str, dict[str, Any]] = {
    "rayleigh": {"color": VERMILION, "marker": "X", "linestyle": "-"},
    "uniform": {"color": ORANGE, "marker": "s", "linestyle": "--"},
    "frequency": {"color": PURPLE, "marker": "v", "linestyle": ":"},
    "consistent": {"color": BLUE, "marker": "o", "linestyle": "-"},
    "midpoint": {"color": SKY, "marker": "D", "linestyle": "--"},
    "beam": {"color": GREEN, "marker": "^", "linestyle": "-."},
    "legendre": {"color": BLACK, "marker": "P", "linestyle": ":"},
}
"""Look of each spring rule and basis."""

COST_LABELS = {
    "seconds": "processor time of an answer (s)",
    "dof": "degrees of freedom",
    "right_hand_sides": "evaluations of the right-hand side",
    "factorisations": "matrix factorisations",
}

ERROR_LABELS = {
    "critical_speed": "relative error of the critical speed",
    "frequencies": "largest relative error of an eigenvalue",
    "root_loci": "largest relative error of a root on the branches",
    "motion": "largest error of the free end / its largest displacement",
    "limit_cycle": "relative error of the cycle's amplitude and frequency",
}


def convergence(
    families: Mapping[str, Sequence[CriticalSpeed]],
    exact: CriticalSpeed,
    ax: Axes | None = None,
) -> Axes:
    """Error of the critical speed against degrees of freedom, with fitted orders.

    A model that loses stability in another way than the continuous pipe (divergence for flutter)
    shows as an open marker and is not fitted.

    Args:
        families: critical speeds of models of growing size under the name of their spring rule or
            basis.
        exact: critical speed of the continuous pipe.
        ax: where to draw; new Axes where not given.

    Raises:
        TypeError: for bad arguments.
    """
    check_mapping("families", families, Sequence)
    for name, found in families.items():
        for i, critical in enumerate(found):
            check_type(f"families[{name!r}][{i}]", critical, CriticalSpeed)
    check_type("exact", exact, CriticalSpeed)
    families = {name: found for name, found in families.items() if found}
    error_label = r"relative error of the critical speed, $|u_c / u_{c,\mathrm{exact}} - 1|$"
    ax = axes_or_new(ax, (6.4, 5.2), xlabel="degrees of freedom $n$, $m$", ylabel=error_label)
    if exact.speed == 0.0:
        return notice("The critical speed is 0: there is nothing to converge to.", ax)
    if not families:  # nothing positive is there that logarithmic axes could show
        return notice("No model has an answer to show.", ax)
    floor = max(own_error(found, exact) for found in families.values())
    least, largest, others = 1.0, 2.0, False
    for name, found in families.items():
        sizes, errors, same_kind = relative_errors(found, exact)
        shown = np.maximum(np.abs(errors), floor)
        look = _look(name, markersize=4.5)
        fitted = convergence_law(found, exact)
        kind = "reduced" if name in BASES else "chain"
        named = "rayleigh (the paper's)" if name == "rayleigh" else name
        label = f"{kind}, {named}: {_law(fitted)}"
        ax.plot(sizes[same_kind], shown[same_kind], label=label, **look)
        look |= {"linestyle": "none", "markerfacecolor": "none"}
        ax.plot(sizes[~same_kind], shown[~same_kind], **look)
        if fitted.law == "flat":
            limit = abs(fitted.limit)
            ax.axhline(limit, color=look["color"], linewidth=0.7, zorder=0.8)
            beside: dict[str, Any] = {"transform": ax.get_yaxis_transform(), "va": "center"}
            ax.text(1.01, limit, _percent(fitted.limit), color=look["color"], **beside)
        least, largest = min([least, *shown]), max([largest, *shown])
        others = others or not same_kind.all()
    if others:
        ring = open_marker(4.5, "0.3", markerfacecolor="none")
        ax.plot([], [], label=f"open: no {exact.kind}, not fitted", **ring)
    ax.set_xscale("log", base=2)
    ax.set_yscale("log")
    if least <= floor:
        text = "error of the compared speeds themselves; smaller differences are shown at its edge"
        _floor(ax, 0.1 * floor, floor, text, (0.02, 0.3 * floor), va="center", clip_on=True)
    ax.xaxis.set_major_formatter(ScalarFormatter())
    ax.grid(True, color="0.9", linewidth=0.5, zorder=0.2)
    _legend_on_top(ax, 0.1 * least, 1.5 * largest)
    return ax


def trade(found: Trade, cost: str = "seconds", ax: Axes | None = None) -> Axes:
    """Error against cost, log-log: each family a line, and the Pareto front as a grey band.

    Where the reference is not accurate enough to measure a model's error, an open marker with an
    arrow shows a bound, ten times the reference's own error. The order of convergence of each
    family stands in the legend.

    Args:
        found: what was measured.
        cost: "seconds", "dof", "right_hand_sides" or "factorisations".
        ax: where to draw; new Axes where not given.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check_type("found", found, Trade)
    cost = check.choice("cost", cost, COSTS)
    ylabel = ERROR_LABELS[found.quantity.name]
    ax = axes_or_new(ax, (6.4, 4.8), xlabel=COST_LABELS[cost], ylabel=ylabel)
    points: list[tuple[float, float]] = []
    for family, order in found.orders().items():
        rows = [row for row in found.of(family) if _shown(row, cost)]
        if rows:
            points += _draw(ax, rows, cost, f"{family}: {_law(order, sign='-')}")
    if not points:
        return notice("No model has an answer to show.", ax)
    front = [(float(getattr(r, cost)), r.error) for r in found.pareto(cost) if _shown(r, cost)]
    if front:  # empty where the most accurate model has no such cost
        band: dict[str, Any] = {"color": "0.75", "linewidth": 6.0, "solid_capstyle": "round"}
        ax.plot(*zip(*front, strict=True), zorder=0.9, label="Pareto front", **band)
    ax.set_xscale("log")
    ax.set_yscale("log")
    floor = found.reference.error
    _floor(ax, 0.0, floor, "error of the reference itself", (0.99, floor), ha="right", va="top")
    costs, errors = zip(*points, strict=True)
    ax.set_ylim(min(0.3 * min(errors), 0.5 * floor), 3.0 * max(errors))
    if max(costs) < 10.0 * min(costs):  # at least a decade, or no tick is a round number
        middle = math.sqrt(max(costs) * min(costs))
        ax.set_xlim(middle / 4.0, middle * 4.0)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0), numticks=12))
    ax.tick_params(axis="x", which="minor", labelsize=6.0)
    ax.grid(True, color="0.9", linewidth=0.5, zorder=0.1)
    ax.legend(fontsize=7.0, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    return ax


def _look(family: str, **more: Any) -> dict[str, Any]:
    """Look of a family; a pair has its rule's colour, and a smaller marker on a dotted line."""
    rule = family.removesuffix(" pair")
    look = {"linewidth": 1.1, "markersize": 5.0, **FAMILY_STYLES.get(rule, {"color": "0.4"})}
    if rule != family:
        look |= {"linestyle": (0, (1, 1.5)), "markersize": 3.5}
    return look | more


def _law(fitted: ConvergenceLaw, sign: str = "+") -> str:
    """The law by which errors fall, for a legend; sign "-" for errors without theirs."""
    if fitted.law == "power":
        return f"order {fitted.rate:.2f}"
    if fitted.law == "exponential":
        return f"÷ {fitted.rate:.1f} per d.o.f."
    if fitted.law == "flat":
        return f"tends to {_percent(fitted.limit, sign)}"
    return "no clear order"


def _percent(part: float, sign: str = "+") -> str:
    """A fraction in percent; sign "+" shows a plus as well."""
    return f"{100.0 * part:{sign}.2f} %".replace("-", "\u2212")


def _floor(
    ax: Axes, low: float, high: float, text: str, at: tuple[float, float], **look: Any
) -> None:
    """A grey band of errors too small to be measured, and its text."""
    ax.axhspan(low, high, color="0.93", zorder=0.2)
    ax.text(*at, text, fontsize=6.5, color="0.35", transform=ax.get_yaxis_transform(), **look)


def _shown(row: TradeRow, cost: str) -> bool:
    """Whether a row has an error and a cost that logarithmic axes can show."""
    return getattr(row, cost) > 0.0 and 0.0 < row.error < math.inf


def _draw(ax: Axes, rows: Sequence[TradeRow], cost: str, label: str) -> list[tuple[float, float]]:
    """One family, bounds open and with an arrow downwards; returns its points."""
    look = _look(rows[0].family)
    points = [(float(getattr(row, cost)), row.error) for row in rows]
    resolved = [i for i, row in enumerate(rows) if row.resolved]
    filled = {"markevery": resolved} if resolved else {"marker": ""}
    ax.plot(*zip(*points, strict=True), label=label, **look | filled)
    bare = look | {"linestyle": "none", "markerfacecolor": "white", "zorder": 2.5}
    arrow = {"arrowstyle": "<|-", "color": look["color"], "lw": 0.8, "shrinkB": 3}
    for point, row in zip(points, rows, strict=True):
        if not row.resolved:
            ax.plot(*point, **bare)
            ax.annotate("", point, (0, -14), textcoords="offset points", arrowprops=arrow)
    return points


def _legend_on_top(ax: Axes, low: float, high: float) -> None:
    """A legend inside logarithmic axes, above the range from low to high."""
    share = 0.0
    look = {"fontsize": 7.0, "handlelength": 2.5, "handletextpad": 0.6, "columnspacing": 1.0}
    for columns in (2, 1) if ax.get_legend_handles_labels()[0] else ():
        legend = ax.legend(loc="upper center", ncols=columns, framealpha=1.0, **look)
        taken, whole = legend.get_window_extent(), ax.get_window_extent()
        share = min(0.6, 1.25 * taken.height / whole.height)  # it stands off the frame
        if taken.width < whole.width:
            break
    ax.set_ylim(low, low * (high / low) ** (1.0 / (1.0 - share)))
    decades = np.arange(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
    ax.set_yticks((10.0**decades)[:: -math.ceil(decades.size / 20)])
    ax.minorticks_off()
