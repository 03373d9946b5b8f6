# SPDX-License-Identifier: MIT
"""Labels, colours, print settings, axes, markers and checks of arguments for all pictures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from itertools import pairwise, product
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import SymmetricalLogLocator
from matplotlib.transforms import ScaledTranslation, blended_transform_factory
from numpy.typing import NDArray

from pipedyn.util import check

# Formulas have no spaces, because a label longer than the height of a picture breaks at a space.
SPEED_LABEL = r"flow speed $u=VL\,(\mu_f/EI)^{1/2}$"
REAL_LABEL = r"Re $\lambda$"
IMAGINARY_LABEL = r"Im $\lambda$"
FREQUENCY_LABEL = r"|Im $\lambda$|"
TIME_LABEL = r"time $\tau=(t/L^2)\,[EI/(\mu_p+\mu_f)]^{1/2}$"
TIP_LABEL = "free end $x/L$"
TIP_RATE_LABEL = r"velocity of the free end $\mathrm{d}x/L\mathrm{d}\tau$"
BETA_LABEL = r"mass ratio $\beta=\mu_f/(\mu_p+\mu_f)$"

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
    """Settings of matplotlib for a printed page, in force in a `with` block.

    Example:
        >>> with plot.style():
        ...     ax = plot.notice("eight points high")
    """
    settings: dict[Any, Any] = {
        "font.size": 8.0,
        "axes.titlesize": 8.0,
        "axes.titley": 1.0,  # nothing lies above the axes, so titles need not be moved
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


def colour_bar(label: str, *, ax: Axes | NDArray[Any] | None = None) -> Axes | None:
    """A colour bar next to one or several Axes, for the first collection that they show.

    It replaces the bars that these Axes have.

    Args:
        label: label of the bar.
        ax: the Axes, or an array of them in one figure; the current Axes of pyplot if not given.

    Returns:
        The Axes of the bar; None if the given Axes show no collection.

    Example:
        >>> ax = plot.root_loci(pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), [0.0, 4.0, 8.0]))
        >>> bar = plot.colour_bar(plot.SPEED_LABEL, ax=ax)

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("label", label, str)
    if ax is None:
        import matplotlib.pyplot as plt  # selects how figures are shown, so only if needed

        ax = plt.gca()
    every: list[Any] = list(ax.flat) if isinstance(ax, np.ndarray) and ax.size else [ax]
    for one in every:
        check.instance("ax", one, Axes)
    shown = [one.collections[0] for one in every if one.collections]
    if not shown:
        return None
    for one in shown:
        if one.colorbar is not None:  # of a picture that brought its own
            one.colorbar.remove()
    look: dict[str, Any] = {"pad": 0.01, "aspect": 40}
    if isinstance(shown[0].norm, SymLogNorm):
        look["ticks"] = SymmetricalLogLocator(base=10, linthresh=1.0, subs=(1.0, 3.0))
        look["format"] = "{x:g}"
    at = every if len(every) > 1 else every[0]  # tight layouts know bars of one Axes only
    bar = every[0].figure.colorbar(shown[0], ax=at, label=label, **look)
    bar.minorticks_off()
    return cast("Axes", bar.ax)


def axes(ax: Any, size: tuple[float, float], **labels: str) -> Axes:
    """The given Axes, or those of a new figure of pyplot with a size in inches, with labels set.

    A figure without a layout engine gets one, since artists beside the Axes would be cut off.
    """
    if ax is None:
        import matplotlib.pyplot as plt  # selects how figures are shown, so only if needed

        ax = plt.subplots(figsize=size, layout="constrained")[1]
    chosen: Axes = check.instance("ax", ax, Axes)
    if isinstance(chosen.figure, Figure) and chosen.figure.get_layout_engine() is None:
        with suppress(RuntimeError):  # a colour bar was placed without a layout engine
            chosen.figure.set_layout_engine("constrained")
    chosen.set(**labels)
    chosen.yaxis.label.set_wrap(True)
    return chosen


def legend_below(ax: Axes, named: Mapping[str, Any] | None = None) -> None:
    """Adds a legend below the Axes, of artists by name, or of all artists that have a label.

    Without such artists there is no legend. The legend has as many columns, up to four, as fit the
    width of the figure. If it would take more than a fifth of the height of the figure, its letters
    get smaller, down to six points.
    """
    if named is None:
        named = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    if not named:
        return
    spec = ax.get_subplotspec()
    alone = spec is not None and spec.get_gridspec().ncols == 1
    middle = blended_transform_factory(
        ax.figure.transSubfigure if alone else ax.transAxes, ax.transAxes
    )
    below = ScaledTranslation(0.0, -0.42, ax.figure.dpi_scale_trans)  # inches, for ticks and label
    look: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "frameon": False}
    look |= {"bbox_transform": middle + below, "columnspacing": 1.2}
    usual = FontProperties(size=matplotlib.rcParams["legend.fontsize"]).get_size_in_points()
    wide, high = ax.figure.bbox.size
    for size, columns in product([*np.arange(usual, 6.0, -0.5), min(usual, 6.0)], (4, 3, 2, 1)):
        legend = ax.legend(named.values(), named, fontsize=size, ncols=columns, **look)
        box = legend.get_window_extent()
        if box.width <= 0.95 * wide and (box.height <= 0.2 * high or size <= 6.0):
            return


def runs(values: NDArray[Any]) -> list[tuple[int, int]]:
    """Begin and end of each run of equal entries; the end is the index after the last one."""
    if not values.size:
        return []
    return list(pairwise([0, *(np.flatnonzero(values[1:] != values[:-1]) + 1), values.size]))


def notice(text: str, *, ax: Axes | None = None) -> Axes:
    """Draws a sentence in place of a picture.

    Args:
        text: the sentence.
        ax: Axes to draw on; new ones if not given.

    Example:
        >>> ax = plot.notice("nothing was computed")

    Raises:
        TypeError: for bad arguments.
    """
    check.instance("text", text, str)
    ax = axes(ax, (6.4, 4.8))
    ax.set(xticks=[], yticks=[])
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", wrap=True)
    return ax


def open_marker(size: float, edge: str = BLACK, **more: Any) -> dict[str, Any]:
    """Look of a white marker with an edge and no line; a ring unless `more` has another marker."""
    look = {"linestyle": "none", "marker": "o", "markersize": size, "markerfacecolor": "white"}
    return look | {"markeredgecolor": edge} | more


def rounded_up(value: float) -> float:
    """The value rounded up to 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    steps = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return next(step for step in steps if step * power >= value * (1.0 - 1e-12)) * power
