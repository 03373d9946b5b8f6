# SPDX-License-Identifier: MIT
"""Labels, colours, print settings, axes, markers and checks of arguments for all pictures."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from itertools import pairwise
from typing import Any, Literal, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.ticker import AutoLocator, SymmetricalLogLocator
from numpy.typing import NDArray

from pipedyn.plot import arrange
from pipedyn.util import check

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
    {"color": ORANGE, "linestyle": (0, (7, 2))},
)


def style(column: Literal["single"] | None = None) -> AbstractContextManager[None]:
    """Settings of matplotlib for a printed page, in force in a `with` block.

    Args:
        column: "single" for pictures as wide as one column of a journal with two: new figures are
            3.4 inches wide and 2.6 inches high, and letters have 7 points. Without it letters have
            8 points, and figures keep their sizes.

    Example:
        >>> with plot.style(column="single"):
        ...     ax = plot.notice("seven points high")
        >>> ax.figure.get_size_inches()
        array([3.4, 2.6])

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    single = column is not None and check.choice("column", column, ("single",)) == "single"
    size, small = (7.0, 6.5) if single else (8.0, 7.5)
    settings: dict[Any, Any] = {
        "font.size": size,
        "axes.titlesize": size,
        "axes.titley": 1.0,  # nothing lies above the axes, so titles need not be moved
        "axes.labelsize": size,
        "legend.fontsize": small,
        "xtick.labelsize": small,
        "ytick.labelsize": small,
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
    if single:
        settings["figure.figsize"] = (3.4, 2.6)
    return matplotlib.rc_context(settings)


def colour_bar(label: str, *, ax: Axes | NDArray[Any] | None = None) -> Axes | None:
    """A colour bar next to one or several Axes, for the first collection that they show.

    It replaces the bars that these Axes have, which must show the same range of values.

    Args:
        label: label of the bar.
        ax: the Axes, or an array of them in one figure; the current Axes of pyplot if not given.

    Returns:
        The Axes of the bar; None if the given Axes show no collection.

    Example:
        >>> ax = plot.root_loci(pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), [0.0, 4.0, 8.0]))
        >>> bar = plot.colour_bar(plot.SPEED_LABEL, ax=ax)

    Raises:
        ValueError, TypeError: for bad arguments.
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
    norms: list[Any] = [one.norm for one in shown if one.norm.scaled()]
    ranges = [(norm.vmin, norm.vmax) for norm in norms]
    for one in ranges:
        if not np.allclose(one, ranges[0], rtol=1e-9, atol=0.0):
            raise ValueError(
                "ax must hold collections whose colours have one range of values, got "
                f"{ranges[0][0]:g} to {ranges[0][1]:g} and {one[0]:g} to {one[1]:g}"
            )
    for one in shown:
        if one.colorbar is not None:  # of a picture that brought its own
            one.colorbar.remove()
    look: dict[str, Any] = {"ax": every, "pad": 0.01, "aspect": 40}
    if len(every) == 1:  # in any layout then, this bar follows its Axes
        look = {"cax": every[0].inset_axes((1.01, 0.0, 0.025, 1.0))}
    if isinstance(shown[0].norm, SymLogNorm):
        subs = (1.0, 3.0) if abs(shown[0].norm.vmax or 0.0) < 10.0 else (1.0,)  # else they collide
        look["ticks"] = SymmetricalLogLocator(base=10, linthresh=1.0, subs=subs)
        look["format"] = "{x:g}"
    bar = every[0].figure.colorbar(shown[0], label=label, **look)
    bar.minorticks_off()
    arrange.keep_within(bar.ax)
    return cast("Axes", bar.ax)


def axes(ax: Any, size: tuple[float, float], *, in_space: bool = False, **labels: str) -> Axes:
    """The given Axes, or those of a new figure of pyplot with a size in inches, with labels set.

    The new figure has the size in the settings of matplotlib if `style` or the user set one there.
    Raises ValueError for Axes in a plane for a picture in space, or the other way round.
    """
    if ax is None:
        import matplotlib.pyplot as plt  # selects how figures are shown, so only if needed

        usual, given = (
            one["figure.figsize"] for one in (matplotlib.rcParamsDefault, matplotlib.rcParams)
        )
        figure = plt.figure(figsize=size if given == usual else given)
        ax = figure.add_subplot(projection="3d" if in_space else None)
    chosen: Axes = check.instance("ax", ax, Axes)
    if (chosen.name == "3d") != in_space:
        rule = "have" if in_space else "not have"
        raise ValueError(f"ax must {rule} projection='3d' for this picture, got {check.shown(ax)}")
    chosen.set(**labels)
    arrange.keep_within(chosen)
    for axis in (chosen.xaxis, chosen.yaxis):
        if isinstance(locator := axis.get_major_locator(), AutoLocator):
            locator.set_params(steps=[1, 2, 5, 10])  # steps of 2.5 have longer labels
    return chosen


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
    write(ax, text)
    return ax


def write(ax: Axes, text: str) -> None:
    """Writes a sentence in the middle of Axes, in as many lines as their width requires."""
    place: dict[str, Any] = {"transform": ax.transAxes, "ha": "center", "va": "center"}
    arrange.keep_within(ax, ax.text(0.5, 0.5, text, **place))


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
