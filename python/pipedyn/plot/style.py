# SPDX-License-Identifier: MIT
"""What all pictures share: labels, colours, settings for print, panels, checks of arguments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipedyn.accuracy.convergence import Trend
from pipedyn.util import check

SPEED_LABEL = r"flow speed $u = V L \, (\mu_f / EI)^{1/2}$"
REAL_LABEL = r"Re $\lambda$  $(1/T)$"
IMAGINARY_LABEL = r"Im $\lambda$  $(1/T)$"
FREQUENCY_LABEL = r"|Im $\lambda$|  $(1/T)$"
TIME_LABEL = r"time $\tau$  $(T)$"
BETA_LABEL = r"mass ratio $\beta = \mu_f / (\mu_p + \mu_f)$"

# The colours of Okabe and Ito, which remain distinct to colour-blind readers.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

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
    rows = check.count("rows", rows, high=100)
    columns = check.count("columns", columns, high=100)
    width = check.real("width", width, low=0.1, high=200.0)
    height = check.real("height", height, low=0.1, high=200.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, axes


def colour_bar(figure: Figure, axes: NDArray[Any], label: str) -> None:
    """One colour bar beside the panels, of the first collection drawn in any of them."""
    check_type("figure", figure, Figure)
    check_type("axes", axes, np.ndarray)
    for ax in axes.flat:
        check_type("axes", ax, Axes)
    check_type("label", label, str)
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


def check_axes(ax: Any) -> None:
    """Refuse what is no Axes."""
    check_type("ax", ax, Axes)


def axes_or_new(ax: Any, width: float, height: float) -> Axes:
    """The Axes given, or those of a new figure of pyplot, width x height inches."""
    if ax is None:
        import matplotlib.pyplot as plt  # it chooses how figures are shown: only if need be

        return plt.subplots(figsize=(width, height), layout="constrained")[1]
    check_axes(ax)
    given: Axes = ax
    return given


def check_type(name: str, value: Any, kind: type) -> None:
    """Refuse what is not of a type."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be of type {kind.__name__}, got {check.shown(value)}")


def check_mapping(name: str, value: Any) -> None:
    """Refuse what is no mapping from words."""
    check_type(name, value, Mapping)
    for key in value:
        check_type(f"the names of {name}", key, str)


def notice(ax: Axes, text: str) -> Axes:
    """A sentence in place of a picture."""
    check_axes(ax)
    check_type("text", text, str)
    ax.set_xticks([])
    ax.set_yticks([])
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", wrap=True)
    return ax


def cycled_styles(count: int) -> list[dict[str, Any]]:
    """Looks of so many curves."""
    return [CURVE_STYLES[i % len(CURVE_STYLES)] for i in range(count)]


def law_label(fitted: Trend, sign: str = "+") -> str:
    """The law by which errors fall, in a legend's words; sign "-" for errors without theirs."""
    if fitted.law == "power":
        return f"order {fitted.rate:.2f}"
    if fitted.law == "exponential":
        return f"÷ {fitted.rate:.1f} per d.o.f."
    if fitted.law == "flat":
        return f"tends to {percent(fitted.limit, sign)}"
    return "no clear order"


def percent(part: float, sign: str = "+") -> str:
    """A share in percent; sign "+" shows a plus as well."""
    return f"{100.0 * part:{sign}.2f} %".replace("-", "\u2212")
