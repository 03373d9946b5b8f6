# SPDX-License-Identifier: MIT
"""Labels, colours, print settings, axes, markers and checks of arguments for all pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from itertools import pairwise, product
from typing import Any, Literal, cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text
from matplotlib.ticker import AutoLocator, SymmetricalLogLocator
from matplotlib.transforms import Bbox, ScaledTranslation, blended_transform_factory
from numpy.typing import NDArray

from pipedyn.util import check

# Formulas have no spaces, because a label too long for the height of Axes breaks at spaces.
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
    look: dict[str, Any] = {"pad": 0.01, "aspect": 40}
    if isinstance(shown[0].norm, SymLogNorm):
        look["ticks"] = SymmetricalLogLocator(base=10, linthresh=1.0, subs=(1.0, 3.0))
        look["format"] = "{x:g}"
    beside = every if len(every) > 1 else every[0]  # tight layout knows a bar beside one
    bar = every[0].figure.colorbar(shown[0], ax=beside, label=label, **look)
    bar.minorticks_off()
    if len(every) == 1:
        wrap(bar.ax.yaxis.label, _room(every[0]))
    return cast("Axes", bar.ax)


BESIDE, BELOW = 0.6, 1.0
"""Width beside Axes for ticks and label, and height below for these and a legend, in inches."""

LINE_HEIGHT = 1.2 / 72.0
"""Height of a line of letters, in inches for a point of their size."""

POINTS_AN_INCH = 3.2
"""Largest size of a legend's letters, in points for an inch of height of the part of the figure."""


def axes(ax: Any, size: tuple[float, float], **labels: str) -> Axes:
    """The given Axes, or those of a new figure of pyplot with a size in inches, with labels set.

    The new figure has the size in the settings of matplotlib if `style` or the user set one there.
    A figure without a layout engine gets one, since artists beside the Axes would be cut off.
    """
    if ax is None:
        import matplotlib.pyplot as plt  # selects how figures are shown, so only if needed

        usual, given = (
            one["figure.figsize"] for one in (matplotlib.rcParamsDefault, matplotlib.rcParams)
        )
        ax = plt.subplots(figsize=size if given == usual else given, layout="constrained")[1]
    chosen: Axes = check.instance("ax", ax, Axes)
    placed = chosen.get_subplotspec() is not None  # layout engines leave other Axes alone
    if placed and isinstance(chosen.figure, Figure) and chosen.figure.get_layout_engine() is None:
        with suppress(RuntimeError):  # a colour bar was placed without a layout engine
            chosen.figure.set_layout_engine("constrained")
    set_labels(chosen, **labels)
    for axis in (chosen.xaxis, chosen.yaxis):
        if isinstance(locator := axis.get_major_locator(), AutoLocator):
            locator.set_params(steps=[1, 2, 5, 10])  # steps of 2.5 have longer labels
    chosen.title.set_wrap(True)
    return chosen


def set_labels(ax: Axes, **labels: str) -> None:
    """Sets labels of Axes, in as many lines as their width and height require."""
    ax.set(**labels)
    for axis in (ax.xaxis, ax.yaxis):
        wrap(axis.label, _room(ax))


def _room(ax: Axes) -> NDArray[Any]:
    """Width and height, in pixels, that Axes are likely to have with ticks, labels and legend."""
    cell = np.array(cell_size(ax))
    return np.maximum(cell - np.array([BESIDE, BELOW]) * ax.figure.dpi, 0.5 * cell)


def cell_size(ax: Axes) -> tuple[float, float]:
    """Width and height, in pixels, of the part of the figure for the Axes and what is beside it."""
    wide, high = ax.figure.bbox.size
    if (spec := ax.get_subplotspec()) is not None:
        for one in {spec, spec.get_topmost_subplotspec()}:  # Axes with a colour bar lie in two
            grid: Any = one.get_gridspec()
            across, down = grid.get_width_ratios(), grid.get_height_ratios()
            wide *= np.sum(across[one.colspan.start : one.colspan.stop]) / np.sum(across)
            high *= np.sum(down[one.rowspan.start : one.rowspan.stop]) / np.sum(down)
    return wide, high


def wrap(label: Text, room: NDArray[Any]) -> None:
    """Breaks a label at spaces into lines of similar length, within width and height in pixels."""
    words, upright = label.get_text().split(" "), int(label.get_rotation() == 90.0)

    def lines(room: float) -> list[str]:
        found = words[:1]
        for word in words[1:]:
            label.set_text(f"{found[-1]} {word}")
            fits = label.get_window_extent().size[upright] <= room
            found[-1:] = [label.get_text()] if fits else [found[-1], word]
        return found

    found = shorter = lines(length := room[upright])
    while 1 < len(found) == len(shorter) < len(words):
        found, length = shorter, 0.9 * length
        shorter = lines(length)
    label.set_text("\n".join(found))


def legend_below(ax: Axes, named: Mapping[str, Any] | None = None) -> None:
    """Adds a legend below or inside the Axes, of artists by name, or of all that have a label.

    Without such artists there is no legend. It stands below if it takes at most a fifth of the
    height that the figure has for these Axes; its letters get smaller for that, down to six points.
    A larger legend stands inside, where it covers nothing. If there is no such place, it stands
    below, too, with letters of five points if it takes more than 0.3 of the height with those of
    six. It has as many columns, up to four, as fit the width.
    """
    if named is None:
        named = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    if not named:
        return
    figure, spec = ax.figure, ax.get_subplotspec()
    alone = spec is not None and spec.get_gridspec().ncols == 1
    wide, high = cell_size(ax)
    wide = 0.95 * wide if alone else wide - BESIDE * figure.dpi
    middle = blended_transform_factory(
        figure.transSubfigure if alone else ax.transAxes, ax.transAxes
    )
    letters = ax.xaxis.label.get_fontproperties().get_size_in_points()
    breaks = ax.get_xlabel().count("\n") * letters * LINE_HEIGHT
    below = ScaledTranslation(0.0, -0.42 - breaks, figure.dpi_scale_trans)  # for ticks and label
    look: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "frameon": False}
    look |= {"bbox_transform": middle + below, "columnspacing": 1.2}
    usual = FontProperties(size=matplotlib.rcParams["legend.fontsize"]).get_size_in_points()
    usual = min(usual, max(6.0, POINTS_AN_INCH * high / figure.dpi))
    sizes = [*np.arange(usual, 6.0, -1.0), min(usual, 6.0)]

    def fits_below(sizes: Sequence[float], share: float) -> bool:
        for size, columns in product(sizes, (4, 3, 2, 1)):
            legend = ax.legend(named.values(), named, fontsize=size, ncols=columns, **look)
            box = legend.get_window_extent()
            if box.width <= wide and box.height <= share * high:
                return True
        return False

    if not fits_below(sizes, 0.2) and not _fits_inside(ax, named, sizes):
        fits_below(sizes, 0.3) or fits_below([5.0], math.inf)


def _fits_inside(ax: Axes, named: Mapping[str, Any], sizes: Sequence[float]) -> bool:
    """Adds a legend inside the Axes, and returns whether it covers nothing there.

    Other Axes in the figure may later get labels and legends that make these Axes smaller.
    """
    ax.legend([], [])
    ax.figure.figure.draw_without_rendering()  # gives the Axes their place
    frame: Any = ax.get_window_extent()
    smaller, covers = shrinks(ax), obstacles(ax)
    for size, columns in product(sizes, (1, 2)):
        legend = ax.legend(named.values(), named, fontsize=size, ncols=columns, loc="lower left")
        box = frame.min + (legend.get_window_extent().get_points() - frame.min) / smaller
        room = frame.min + frame.max - box.sum(axis=0)  # between two opposite corners
        if (room < 0.0).any():
            continue
        for place, shares in INSIDE.items():
            there = Bbox(box + room * shares)
            if not covers(there):
                legend.set_loc(place)
                return True
    return False


def shrinks(ax: Axes) -> Any:
    """Shares of their width and height to which Axes may shrink, by others in the figure."""
    if len(ax.figure.figure.axes) == 1:
        return np.ones(2)
    return np.minimum(_room(ax) / np.array(ax.get_window_extent().size), 1.0)


def obstacles(ax: Axes) -> Callable[[Bbox], bool]:
    """A function that tells whether anything drawn on Axes lies in a box, in pixels."""
    curves = [line.get_transform().transform_path(line.get_path()) for line in ax.lines]
    others = [one.get_window_extent() for one in (*ax.patches, *ax.collections, *ax.texts)]

    def covers(box: Bbox) -> bool:
        crossed = any(curve.intersects_bbox(box, filled=False) for curve in curves)
        return crossed or bool(box.count_overlaps(others))

    return covers


INSIDE: dict[Any, tuple[float, float]] = {"upper right": (1.0, 1.0), "upper left": (0.0, 1.0)}
INSIDE |= {"lower right": (1.0, 0.0), "lower left": (0.0, 0.0), "center right": (1.0, 0.5)}
INSIDE |= {"center left": (0.0, 0.5), "upper center": (0.5, 1.0), "lower center": (0.5, 0.0)}
"""Places of a legend inside Axes, and how far they are from the lower left corner, as shares of the
width and the height that the legend leaves."""


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
    wrap(ax.text(0.5, 0.5, text, **place), 0.8 * _room(ax))


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
