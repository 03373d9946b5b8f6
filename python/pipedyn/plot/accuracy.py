# SPDX-License-Identifier: MIT
"""Pictures of accuracy: error against size, and error against cost with the Pareto front."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import (
    EngFormatter,
    LogFormatterSciNotation,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
    ScalarFormatter,
)
from numpy.typing import NDArray

from pipedyn.accuracy.choose import COSTS, Trade, TradeRow
from pipedyn.accuracy.convergence import ConvergenceLaw, convergence_law, relative_errors
from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.models.galerkin import BASES
from pipedyn.plot import common
from pipedyn.plot.arrange import legend_below
from pipedyn.plot.units import Units, View
from pipedyn.util import check
from pipedyn.util.check import Array

FAMILY_STYLES: dict[str, dict[str, Any]] = {
    "rayleigh": {"color": common.VERMILION, "marker": "X", "linestyle": "-"},
    "uniform": {"color": common.ORANGE, "marker": "s", "linestyle": "--"},
    "frequency": {"color": common.PURPLE, "marker": "v", "linestyle": ":"},
    "consistent": {"color": common.BLUE, "marker": "o", "linestyle": "-"},
    "midpoint": {"color": common.SKY, "marker": "D", "linestyle": "--"},
    "beam": {"color": common.GREEN, "marker": "^", "linestyle": "-."},
    "legendre": {"color": common.BLACK, "marker": "P", "linestyle": ":"},
}
"""Look of the curve of each spring rule and basis."""

COST_LABELS = {
    "seconds": "processor time of an answer",
    "dof": "degrees of freedom",
    "right_hand_sides": "evaluations of the right-hand side",
    "factorisations": "matrix factorisations",
}

ERROR_LABELS = {
    "critical_speed": "relative error of critical speed",
    "frequencies": "largest relative error of an eigenvalue",
    "root_loci": "largest relative error of a root on the branches",
    "motion": "largest error of the free end / its largest displacement",
    "limit_cycle": "relative error of the cycle's amplitude and frequency",
}


def convergence(
    families: Mapping[str, Sequence[CriticalSpeed]],
    exact: CriticalSpeed,
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Error of the critical speed against degrees of freedom, with fitted orders.

    A model that loses stability in another way than the continuous pipe (divergence instead of
    flutter) is shown by an open marker and not fitted.

    Args:
        families: critical speeds of models of growing size, by the name of their spring rule or
            basis.
        exact: critical speed of the continuous pipe.
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> pipe = pp.Pipe(0.2)
        >>> chains = [pp.critical_speed(pp.Chain(pipe, n)) for n in (5, 10, 20)]
        >>> ax = plot.convergence({"consistent": chains}, pp.critical_speed(pp.Continuum(pipe)))

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("families", families, Mapping)
    for name, found in families.items():
        check.instance("the names of families", name, str)
        check.instance(f"families[{name!r}]", found, Sequence)
        for i, critical in enumerate(found):
            check.instance(f"families[{name!r}][{i}]", critical, CriticalSpeed)
    check.instance("exact", exact, CriticalSpeed)
    legend = check.flag("legend", legend)
    families = {name: found for name, found in families.items() if found}
    View(units, exact.pipe)
    ylabel = r"relative error of critical speed"
    ax = common.axes(ax, (6.4, 5.2), xlabel="degrees of freedom $n$, $m$", ylabel=ylabel)
    if exact.speed == 0.0:
        return common.notice("The critical speed is 0: there is nothing to converge to.", ax=ax)
    if not families:  # without a positive number logarithmic axes have no range
        return common.notice("No model has an answer to show.", ax=ax)
    floor = max(relative_errors(found, exact)[-1] for found in families.values())
    every, others = list[float](), False
    for name, found in families.items():
        sizes, errors, same_kind, _ = relative_errors(found, exact)
        shown = np.maximum(np.abs(errors), floor)
        fitted = convergence_law(found, exact)
        kind = "reduced" if name in BASES else "chain"
        label = f"{kind}, {name}: {_law(name, fitted)}"
        colour = _draw(ax, name, sizes, shown, same_kind, label)
        if fitted.law == "flat":
            limit, place = abs(fitted.limit), ax.get_yaxis_transform()
            ax.axhline(limit, color=colour, linewidth=0.7, zorder=0.8)
            ax.text(1.01, limit, _signed(fitted.limit), color=colour, va="center", transform=place)
        every, others = [*every, *shown[shown > 0.0]], others or not same_kind.all()
    if others:
        ring = common.open_marker(4.5, "0.3", markerfacecolor="none")
        ax.plot([], [], label=f"open: no {exact.kind}, not fitted", **ring)
    ax.set_xscale("log", base=2)
    ax.xaxis.set_major_formatter(ScalarFormatter())
    low, high = min(every, default=1.0), max(every, default=2.0)
    _finish(ax, low, high, floor, shaded=low <= floor)
    if legend:
        legend_below(ax)
    return ax


def trade(
    found: Trade,
    cost: str = "seconds",
    *,
    units: Units = "nondimensional",
    legend: bool = True,
    ax: Axes | None = None,
) -> Axes:
    """Error against cost on logarithmic axes, with a line for each family and the Pareto front.

    The grey band is the Pareto front. If the reference is not accurate enough to measure the error
    of a model, an open marker with an arrow shows a bound on the error. The legend gives the order
    of convergence of each family.

    Args:
        found: the measurement to show.
        cost: "seconds", "dof", "right_hand_sides" or "factorisations".
        units: "nondimensional", or "si" if the pipe has scales.
        legend: whether to add a legend, below the Axes or inside.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> ax = plot.trade(pp.trade(pp.Pipe(0.2), "critical_speed", sizes=[4, 8, 16], repeats=1))

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check.instance("found", found, Trade)
    cost, legend = check.choice("cost", cost, COSTS), check.flag("legend", legend)
    View(units, found.pipe)
    ylabel = ERROR_LABELS[found.quantity.name]
    ax = common.axes(ax, (6.4, 4.8), xlabel=COST_LABELS[cost], ylabel=ylabel)
    costs, errors, measured = _points(found.rows, cost)
    if not costs.size:
        return common.notice("No model has an answer to show.", ax=ax)
    for family, order in found.orders().items():
        x, y, resolved = _points(found.of(family), cost)
        if x.size:
            label = f"{family}: {_law(family, order, sign='-')}"
            colour = _draw(ax, family, x, y, resolved > 0.0, label)
            arrow = {"arrowstyle": "<|-", "color": colour, "lw": 0.8, "shrinkB": 3}
            for point in np.stack([x, y], axis=1)[resolved == 0.0]:
                ax.annotate("", point, (0, -14), textcoords="offset points", arrowprops=arrow)
    x, y, _ = _points(found.pareto(cost), cost)
    if x.size:  # empty if the rows on the front have a cost of 0
        band: dict[str, Any] = {"color": "0.75", "linewidth": 6.0, "solid_capstyle": "round"}
        band |= {"marker": "o", "markersize": 10.0}  # to be seen around a single point
        ax.plot(x, y, zorder=0.9, label="Pareto front", **band)
    ax.set_xscale("log")
    if costs.max() < 10.0 * costs.min():  # less than a decade may contain no round number
        middle = math.sqrt(costs.max() * costs.min())
        ax.set_xlim(middle / 4.0, middle * 4.0)
    round_ticks(ax.xaxis)
    ax.xaxis.set_major_formatter(
        EngFormatter("s" if cost == "seconds" else "", sep="\N{THIN SPACE}")
    )
    low, high = float(errors.min()), float(errors.max())
    if not measured.all():  # arrows take a fifth of the height of small Axes
        low /= 2.0 * (high / low) ** 0.25
    _finish(ax, low, high, found.reference.error, shaded=True)
    if legend:
        legend_below(ax)
    return ax


def round_ticks(axis: Axis) -> None:
    """Sets ticks at round numbers of a logarithmic axis with its final limits, however short."""
    low, high = axis.get_view_interval()
    decades = math.log10(high / low)
    if decades < 0.5:  # maybe without any of the round numbers of the others
        axis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 5, 10]))
    else:
        subs = {1.0: (1.0, 2.0, 3.0, 5.0, 7.0), 1.3: (1.0, 2.0, 5.0), 2.6: (1.0, 3.0)}
        found = next((one for most, one in subs.items() if decades < most), (1.0,))
        axis.set_major_locator(LogLocator(subs=found))
    if decades < 0.5 or (decades < 2.6 and 1e-4 < low < high < 1e5):  # short labels
        axis.set_major_formatter("{x:g}")
    else:  # labels all ticks
        axis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(math.inf, math.inf)))
    axis.set_minor_formatter(NullFormatter())


def _draw(ax: Axes, family: str, x: Array, y: Array, filled: NDArray[np.bool_], label: str) -> str:
    """Draws a family as a line with filled and open markers, and returns its colour.

    A pair of models has the colour of its spring rule, and smaller markers on a dotted line.
    """
    rule = family.removesuffix(" pair")
    look = {"linewidth": 1.1, "markersize": 5.0, **FAMILY_STYLES.get(rule, {"color": "0.4"})}
    if rule != family:
        look |= {"linestyle": (0, (1, 1.5)), "markersize": 3.5}
    ax.plot(x, y, label=label, markevery=filled.tolist(), **look)
    look |= {"linestyle": "none", "markerfacecolor": "white", "zorder": 2.5}
    ax.plot(x[~filled], y[~filled], **look)
    return str(look["color"])


def _law(family: str, fitted: ConvergenceLaw, sign: str = "+") -> str:
    """The law by which errors fall, in words for a legend; with sign "-" plus signs are omitted."""
    if fitted.law == "power":
        return f"order {fitted.rate:.2f}"
    if fitted.law == "exponential":
        return f"factor {fitted.rate:.2g} per {'function' if family in BASES else 'segment'}"
    if fitted.law == "flat":
        return f"tends to {_signed(fitted.limit, sign)}"
    return "no clear order"


def _signed(part: float, sign: str = "+") -> str:
    """A fraction in percent; with sign "+" positive numbers have a plus sign."""
    return f"{100.0 * part:{sign}.2f} %".replace("-", "\u2212")


def _points(rows: Sequence[TradeRow], cost: str) -> Array:
    """Costs, errors, and whether errors are resolved, of rows that log axes can show, (3, k)."""
    values = [(getattr(row, cost), row.error, row.resolved) for row in rows]
    table = np.array(values, dtype=np.float64).reshape(-1, 3)
    shown = (table[:, 0] > 0.0) & (table[:, 1] > 0.0) & np.isfinite(table[:, 1])
    return np.asarray(table[shown].T)


def _finish(ax: Axes, low: float, high: float, floor: float, *, shaded: bool) -> None:
    """Makes the axis of errors logarithmic and adds a grid.

    The axis shows errors from `low` to `high`, and the error of the reference, `floor`, if it is
    near. A grey band shows the errors that are too small to be measured, if it is asked for.
    """
    low = min(low, 0.5 * floor) if floor > 0.1 * low else low
    room = 1.2 * (high / low) ** 0.03
    low, high = low / room, high * room
    if shaded and floor > low:
        grey: dict[str, Any] = {"facecolor": "0.93", "edgecolor": "0.7", "zorder": 0.2}
        ax.axhspan(1e-300, floor, label="below the error of the reference", **grey)
    ax.set_yscale("log")
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylim(low, high)
    round_ticks(ax.yaxis)
    ax.grid(True, color="0.9", linewidth=0.5, zorder=0.1)
