# SPDX-License-Identifier: MIT
"""The picture of a trade: error against cost, with the models that no other beats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from pipedyn.accuracy.trade import COSTS, Trade, TradeRow
from pipedyn.plot.linear import FAMILY_STYLES
from pipedyn.plot.style import axes_or_new, check_type, law_label, notice
from pipedyn.util import check

COST_LABELS = {
    "seconds": "time of an answer (s)",
    "dof": "degrees of freedom",
    "right_hand_sides": "right-hand sides",
    "factorisations": "factorisations",
}

ERROR_LABELS = {
    "critical_speed": "relative error of the critical speed",
    "frequencies": "largest relative error of an eigenvalue",
    "root_loci": "largest relative error of a root on the branches",
    "motion": "largest error of the free end / its largest excursion",
    "limit_cycle": "relative error of the cycle's amplitude and frequency",
}


def trade(found: Trade, cost: str = "seconds", ax: Axes | None = None) -> Axes:
    """Error against cost, log-log, each family a line, with the front of those that none beats.

    A model closer to the reference than the reference can tell stands at ten times the reference's
    own error, open, with an arrow: its error is at most that. The order by which a family's error
    falls with its size stands in the legend.

    Args:
        found: what was measured.
        cost: "seconds", "dof", "right_hand_sides" or "factorisations".
        ax: where to draw; a new figure where not given.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    check_type("found", found, Trade)
    cost = check.choice("cost", cost, COSTS)
    ax = axes_or_new(ax, 6.4, 4.8)
    ax.set_xlabel(COST_LABELS[cost])
    ax.set_ylabel(ERROR_LABELS[found.quantity.name])
    orders = found.orders()
    shown: list[TradeRow] = []
    for family in found.families:
        rows = [row for row in found.of(family) if _place(row, cost)]
        if rows:
            _draw(ax, rows, cost, f"{family}: {law_label(orders[family], sign='-')}")
            shown += rows
    if not shown:
        return notice(ax, "No model has an answer to show.")
    front = [place for row in found.pareto(cost) if (place := _place(row, cost))]
    if front:  # the best of all may have no such cost
        band: dict[str, Any] = {"color": "0.75", "linewidth": 6.0, "solid_capstyle": "round"}
        label = "none is better at less cost"
        ax.plot(*zip(*front, strict=True), zorder=0.9, label=label, **band)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.axhspan(0.0, found.reference.error, color="0.93", zorder=0.2)
    _frame(ax, shown, cost, found.reference.error)
    ax.legend(fontsize=7.0, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    return ax


def _place(row: TradeRow, cost: str) -> tuple[float, float] | tuple[()]:
    """Where a row stands; nowhere if it failed or has no such cost."""
    at = float(getattr(row, cost))
    return (at, row.error) if at > 0.0 and 0.0 < row.error < math.inf else ()


def _draw(ax: Axes, rows: Sequence[TradeRow], cost: str, label: str) -> None:
    """One family, bounds open and with an arrow downwards."""
    look = _look(rows[0].family)
    x, y = zip(*(_place(row, cost) for row in rows), strict=True)
    told = [i for i, row in enumerate(rows) if row.resolved]
    filled = look | {"markevery": told} if told else look | {"marker": ""}
    ax.plot(x, y, label=label, **filled)
    bounds = [i for i, row in enumerate(rows) if not row.resolved]
    if bounds:
        open_look = look | {"linestyle": "none", "markerfacecolor": "white", "zorder": 2.5}
        ax.plot(np.array(x)[bounds], np.array(y)[bounds], **open_look)
        for i in bounds:
            ax.annotate(
                "",
                (x[i], y[i]),
                xytext=(0, -14),
                textcoords="offset points",
                arrowprops={"arrowstyle": "<|-", "color": look["color"], "lw": 0.8, "shrinkB": 3},
            )


def _look(family: str) -> dict[str, Any]:
    """Of a family; a pair has its rule's colour, and a smaller marker on a dotted line."""
    rule = family.removesuffix(" pair")
    look = {"linewidth": 1.1, "markersize": 5.0, **FAMILY_STYLES.get(rule, {"color": "0.4"})}
    if rule != family:
        look |= {"linestyle": (0, (1, 1.5)), "markersize": 3.5}
    return look


def _frame(ax: Axes, rows: Sequence[TradeRow], cost: str, floor: float) -> None:
    """Limits around what is shown, and a tick at each decade."""
    errors = [row.error for row in rows]
    ax.set_ylim(min(0.3 * min(errors), 0.5 * floor), 3.0 * max(errors))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(numticks=12))
    costs = [float(getattr(row, cost)) for row in rows]
    if max(costs) < 10.0 * min(costs):  # at least a decade, or no tick is a round number
        middle = math.sqrt(max(costs) * min(costs))
        ax.set_xlim(middle / 4.0, middle * 4.0)
    ax.yaxis.set_minor_formatter(NullFormatter())
    ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0), numticks=12))
    ax.tick_params(axis="x", which="minor", labelsize=6.0)
    ax.text(
        0.99,
        floor,
        "the reference's own error",
        transform=ax.get_yaxis_transform(),
        fontsize=6.5,
        color="0.35",
        ha="right",
        va="top",
    )
    ax.grid(True, which="major", color="0.9", linewidth=0.5, zorder=0.1)
