# SPDX-License-Identifier: MIT
"""Lines of labels, and free places for legends and words, found when a figure is drawn.

Only then are the sizes of Axes known, since labels and legends of all others change them. A figure
without a layout engine then gets a constrained layout, unless its user placed the Axes. What is
covered is measured in pixels of what the Axes show.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import matplotlib
import numpy as np
from matplotlib import layout_engine as engines
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.text import Annotation, Text
from matplotlib.transforms import ScaledTranslation
from numpy.typing import ArrayLike

from pipedyn.util.check import Array

POINTS_AN_INCH = 3.2
"""Largest size of a legend's letters, in points for an inch of height of the part of the figure."""

SMALLEST_LETTERS = 6.0
"""Smallest size of a legend's letters in points, if the settings of matplotlib are not smaller."""

LOW = 0.2
"""Share of the height of the part of the figure up to which a legend stands below the Axes even if
there is a free place inside."""

COMPACT: dict[str, Any] = {"handletextpad": 0.5, "columnspacing": 1.0, "labelspacing": 0.3}
"""Distances in legends, in sizes of letters."""

HANDLE = 14.0
"""Least length of lines in legends, in points, in which the longest dash and its gap are seen."""

CORNERS: dict[Any, tuple[float, float]] = {"upper right": (1.0, 1.0), "upper left": (0.0, 1.0)}
CORNERS |= {"lower right": (1.0, 0.0), "lower left": (0.0, 0.0)}
EDGES: dict[Any, tuple[float, float]] = {"center right": (1.0, 0.5), "center left": (0.0, 0.5)}
EDGES |= {"upper center": (0.5, 1.0), "lower center": (0.5, 0.0)}
"""Places inside Axes, as shares of their width and height, in the order in which they are tried."""

FULL_TURN = np.array(list(product((1, 0, -1), repeat=2)))[[1, 3, 7, 5, 0, 6, 2, 8]]
"""Sides on which words may stand beside a place, right first, shape (8, 2)."""

SPACES = re.compile(r" (?=(?:[^$]*\$[^$]*\$)*[^$]*$)")
"""Spaces outside of formulas, at which texts may break."""


def keep_within(ax: Axes, *sentences: Text, share: float = 0.8) -> None:
    """Breaks labels, title and some sentences of Axes to their size, when the figure is drawn.

    Sentences get a share of the width, all of it above the Axes.
    """
    of = _arranger(ax)
    of.labelled.append(ax)
    for text in sentences:
        text.set_in_layout(share == 1.0)  # inside, a single line would leave no room for the Axes
        of.sentences.append((ax, text, share))


def write_beside(
    ax: Axes,
    words: str,
    places: ArrayLike,
    sides: ArrayLike,
    *,
    gap: float = 4.0,
    needed: bool = True,
    **look: Any,
) -> None:
    """Writes words at the first of some places at which they cover nothing, when that is drawn.

    Args:
        ax: the Axes.
        words: what to write.
        places: places in the data, or in shares of the Axes with `xycoords="axes fraction"`, shape
            (k, 2).
        sides: sides of the places on which the words stand, of -1, 0 or 1 in x and y, shape (k, 2).
        gap: distance of the words from the place, in points.
        needed: whether words that have no free place stand where they cover the least.
        look: other arguments of `Axes.annotate`.
    """
    at = np.asarray(places, dtype=float)
    look = {"ha": "center", "va": "center", "textcoords": "offset points", **look}
    look["in_layout"] = False
    text = ax.annotate(words, at[0].tolist(), (0, 0), **look)
    _arranger(ax).words.append(_Words(ax, text, at, np.asarray(sides), gap, needed))


def write_inside(ax: Axes, words: str, **look: Any) -> None:
    """Writes words in a corner of Axes or, if they cover something there, elsewhere inside."""
    corners = np.array(list(CORNERS.values()))
    within = np.array([*product(np.linspace(0.05, 0.95, 19), repeat=2)])
    sides = np.vstack([1.0 - 2.0 * corners, np.zeros_like(within)])
    write_beside(ax, words, np.vstack([corners, within]), sides, xycoords="axes fraction", **look)


def legend_below(ax: Axes, named: Mapping[str, Any] | None = None) -> None:
    """Adds a legend below or inside the Axes, of artists by name, or of all that have a label.

    Without such artists there is no legend. It stands below if it takes at most a fifth of the
    height that the figure has for these Axes; its letters get smaller for that, down to six points.
    A larger legend stands inside, where it covers nothing when the figure is drawn. If there is no
    such place, it stands below. There it has as many columns, up to four, as fit the width.
    """
    if named is None:
        named = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    if named:
        usual = FontProperties(size=matplotlib.rcParams["legend.fontsize"]).get_size_in_points()
        usual = min(usual, max(SMALLEST_LETTERS, POINTS_AN_INCH * cell_size(ax)[1] / ax.figure.dpi))
        sizes = [*np.arange(usual, SMALLEST_LETTERS, -1.0), min(usual, SMALLEST_LETTERS)]
        made = _Legend(ax, _add(ax, named, usual, 1), named, sizes)
        made.change((usual, 1), inside=False)
        _arranger(ax).legends.append(made)


def small_letters() -> float:
    """Size of small letters in points, at least `SMALLEST_LETTERS`."""
    return max(SMALLEST_LETTERS, FontProperties(size="small").get_size_in_points())


def _add(
    ax: Axes, named: Mapping[str, Any], size: float, columns: int, before: Legend | None = None
) -> Legend:
    """Adds a legend, with the texts and the title of one before it if these were changed."""
    look: dict[str, Any] = {"fontsize": size, "ncols": columns, "frameon": False, **COMPACT}
    look["handlelength"] = max(2.0, HANDLE / size)
    texts = list(named)
    if before is not None:
        texts = [text.get_text().replace("\n", " ") for text in before.get_texts()]
        look["title"] = before.get_title().get_text() or None
    return ax.legend(named.values(), texts, loc="upper center", **look)


def _page(one: Artist) -> tuple[float, float]:
    """Width and height, in inches, of the figure that an artist is in."""
    figure: Any = one.figure
    wide, high = figure.figure.get_size_inches()
    return float(wide), float(high)


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


@dataclass
class _Words:
    """Words, with the arguments of `write_beside`."""

    ax: Axes
    text: Annotation
    places: Array
    sides: Array
    gap: float
    needed: bool

    def find(self, covered: _Covered) -> None:
        """Moves the words to a free place, or hides them."""
        self.text.set_visible(True)
        size = np.array(self.text.get_window_extent().size)
        in_data = self.text.xycoords == "data"
        to_pixels = self.ax.transData if in_data else self.ax.transAxes
        anchors = to_pixels.transform(self.places)
        k, centre = covered.place(size, anchors, self.sides, self.gap, self.needed)
        self.text.set_visible(k is not None)
        if k is not None:
            self.text.xy = tuple(self.places[k])
            self.text.xyann = tuple((centre - anchors[k]) * 72.0 / self.ax.figure.dpi)


@dataclass
class _Legend:
    """A legend whose place is found when its figure is drawn.

    Attributes:
        sizes: sizes that its letters may have.
        inside: sizes of letters and numbers of columns to try inside the Axes; empty if it stands
            below, and None before the figure is drawn.
        below: size of letters and number of columns below the Axes.
        place: place below, from the middle of the lower edge of the Axes, in inches.
        room: width below, in pixels.
        page: size of the figure, in inches, for which it was placed.
    """

    ax: Axes
    legend: Legend
    named: Mapping[str, Any]
    sizes: list[float]
    inside: list[tuple[float, int]] | None = None
    below: tuple[float, int] = (0.0, 0)
    place: tuple[float, float] | None = None
    room: float = 0.0
    page: tuple[float, float] = (0.0, 0.0)

    def takes_room(self) -> bool:
        """Whether a layout makes room for the legend: below Axes of the size that it fits."""
        return self.place is not None and self.page == _page(self.ax)

    def change(self, look: tuple[float, int], *, inside: bool) -> None:
        """Replaces the legend by one of another size, which takes no room in the layout yet."""
        self.legend = _add(self.ax, self.named, *look, self.legend)
        self.legend.set_frame_on(inside)
        vars(self.legend)["get_in_layout"] = self.takes_room
        self.place = None

    def find(self, covered: _Covered) -> bool:
        """Moves the legend to a free place inside; returns whether it has to stand below."""
        shares = CORNERS | EDGES
        at = np.array(list(shares.values()))
        corners = covered.low + at * (covered.high - covered.low)
        for look in (None, *(self.inside or ())):
            if look is not None:
                self.change(look, inside=True)
            size = np.array(self.legend.get_window_extent().size)
            k, _ = covered.place(size, corners, np.sign(1.0 - 2.0 * at), 3.0)
            if k is not None:
                self.legend.set_loc(list(shares)[k])
                return False
        self.inside = []
        self.change(self.below, inside=False)
        self._break(self.below[1])
        return True

    def hang(self, renderer: Any) -> bool:
        """Moves the legend to below the labels unless it is inside; returns whether it moved.

        It is in the middle of the Axes, or reaches under the labels of the y axis if it is wider.
        It takes room in the layout only from then on, as it would make the Axes narrower before.
        """
        ax, dpi = self.ax, self.ax.figure.dpi
        frame = ax.get_position(original=True).transformed(ax.figure.transSubfigure)
        under, beside = (axis.get_tightbbox(renderer) for axis in (ax.xaxis, ax.yaxis))
        room = frame.x1 - (frame.x0 if beside is None else beside.x0)
        room += 0.05 * dpi  # at other dots an inch letters have other widths
        page, wide = _page(ax), self.legend.get_window_extent().width
        if self.inside is None or page != self.page or wide > room:
            self.room, self.page = 0.98 * room, page
            self._choose()
        if self.inside:
            return False
        aside = min(0.0, 0.5 * (frame.width - self.legend.get_window_extent().width))
        below = 0.0 if under is None else min(0.0, under.y0 - ax.bbox.y0)
        place = round(aside / dpi, 2), round(below / dpi, 2)
        if place == self.place:
            return False
        self.place = place
        shift = ScaledTranslation(*place, ax.figure.dpi_scale_trans)
        self.legend.set_bbox_to_anchor((0.5, 0.0), ax.transAxes + shift)
        return True

    def _choose(self) -> None:
        """Chooses letters and columns for the width below, and whether to stay there.

        Of the smallest letters the lowest legend is chosen, in which long entries are broken.
        """
        found = dict[tuple[float, int], float]()
        # Without an engine nothing makes room below Axes.
        low = LOW * cell_size(self.ax)[1] if _arranger(self.ax).engine() is not None else 0.0
        for size, columns in product(self.sizes, (4, 3, 2, 1)):
            self.change((size, columns), inside=False)
            if size == self.sizes[-1]:
                self._break(columns)
            box = self.legend.get_window_extent()
            if box.width <= self.room or (size, columns) == (self.sizes[-1], 1):
                found[size, columns] = box.height
            if box.width <= self.room and box.height <= low and size != self.sizes[-1]:
                self.inside = []
                return
        smallest = [look for look in found if look[0] == self.sizes[-1]]
        self.below = min(smallest, key=found.__getitem__)
        stays = found[self.below] <= low
        self.inside = [] if stays else list(product(self.sizes, (1, 2, 3)))
        self.change(self.below if stays else self.inside[0], inside=not stays)
        if stays:
            self._break(self.below[1])

    def _break(self, columns: int) -> None:
        """Breaks entries of a legend that is too wide."""
        texts = self.legend.get_texts()
        for _ in range(3):  # the width is the sum of all columns
            if (over := self.legend.get_window_extent().width - self.room) > 0.0:
                longest = max(text.get_window_extent().width for text in texts)
                for text in texts:
                    wrap(text, longest - over / columns)


class _Covered:
    """What Axes show, in pixels, without images and without what has yet to find its place."""

    def __init__(self, ax: Axes, movable: list[Artist]) -> None:
        dpi = ax.figure.dpi
        self._point = dpi / 72.0
        self.low, self.high = ax.bbox.get_points() + np.array([[1.0], [-1.0]]) * self._point
        wide, high = (math.ceil(size) for size in ax.figure.figure.bbox.size)
        agg: Any = RendererAgg  # has no types
        renderer = agg(wide, high, dpi)
        ax.get_xlim(), ax.get_ylim()  # updates transforms to the data
        for one in (*ax.lines, *ax.patches, *ax.collections, *ax.texts, *ax.artists):
            if one not in movable:
                one.draw(renderer)
        self._drawn = np.asarray(renderer.buffer_rgba())[::-1, :, 3] > 0

    def place(
        self, size: Array, anchors: Array, sides: Array, gap: float, needed: bool = False
    ) -> tuple[int | None, Array]:
        """Index of the first free place for a box, and the box's centre; the place is then taken.

        The box stands on the given sides of the anchors, shape (k, 2), some points away. If it
        covers something at each of them, it stands where it covers the least if it is `needed`. The
        index is None for no place.
        """
        centres = anchors + sides * (0.5 * size + gap * self._point)
        lows, highs = centres - 0.5 * size, centres + 0.5 * size
        pad = self._point
        seen = (anchors > self.low - 2.0 * pad) & (anchors < self.high + 2.0 * pad)
        inside = (seen & (lows >= self.low) & (highs <= self.high)).all(axis=1)
        limits = np.array(self._drawn.shape)[::-1]
        x0, y0 = np.clip(np.floor(lows - pad), 0, limits).astype(int).T
        x1, y1 = np.clip(np.ceil(highs + pad), 0, limits).astype(int).T
        sums = np.pad(self._drawn.cumsum(0, dtype=np.int32).cumsum(1), ((1, 0), (1, 0)))
        covers = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
        k = int(np.argmin(np.where(inside, covers, np.inf)))
        if not inside[k] or (covers[k] and not needed):
            return None, centres[k]
        self._drawn[y0[k] : y1[k], x0[k] : x1[k]] = True
        return k, centres[k]


class _Arranger(Artist):
    """Arranges labels, legends and words of a figure before its Axes are drawn."""

    def __init__(self) -> None:
        super().__init__()
        self.set(in_layout=False, zorder=-math.inf)
        self.labelled, self.sentences = list[Axes](), list[tuple[Axes, Text, float]]()
        self.legends, self.words = list[_Legend](), list[_Words]()
        self.page, self.spaces = (0.0, 0.0), dict[str, float]()

    def draw(self, renderer: Any) -> None:
        """Arranges until nothing changes the layout any more."""
        figure: Any = self.figure
        whole = np.array_equal(figure.transFigure.transform((1.0, 1.0)), figure.bbox.size)
        if not self.get_visible() or not (whole or self.page == (0.0, 0.0)):
            return  # of a part that is saved all has its place
        self._forget()
        redraws, figure.stale_callback = figure.stale_callback, None  # what moves is drawn now
        resized, self.page = self.page != _page(figure), _page(figure)
        if figure.get_layout_engine() is None:  # else it was laid out
            self._lay_out()
        for _ in range(6):
            for ax in self.all_axes():
                locator = ax.get_axes_locator()
                ax.apply_aspect(locator and locator(ax, renderer))
            if not (self._break() or self._place(renderer) or resized):
                break
            resized = False
            self._lay_out()
        figure.stale_callback = redraws

    def _lay_out(self) -> None:
        """Has the Axes placed, if not by the user."""
        if (engine := self.engine()) is not None:
            figure: Any = self.figure
            engine.execute(figure)
            self.spaces = vars(figure.subplotpars).copy()

    def engine(self) -> engines.LayoutEngine | None:
        """What places the Axes: the figure's engine or else one of ours, if the user did not."""
        figure: Any = self.figure
        given, untouched = figure.get_layout_engine(), (vars(Figure().subplotpars), self.spaces)
        if given is not None or vars(figure.subplotpars) not in untouched:
            return None if isinstance(given, engines.PlaceHolderLayoutEngine) else given
        specs = [spec for ax in figure.axes if (spec := ax.get_subplotspec()) is not None]
        outer = [spec.get_topmost_subplotspec().get_gridspec() for spec in specs]
        if {edge for one in outer for edge in (one.left, one.bottom, one.right, one.top)} != {None}:
            return None
        grids = [spec.get_gridspec() for spec in specs]
        ratios = [r for one in grids for r in (*one.get_height_ratios(), *one.get_width_ratios())]
        # A constrained layout divides by the ratios, which are 0 beside a colour bar of the user's.
        constrained = min(ratios) > 0.0
        return engines.ConstrainedLayoutEngine() if constrained else engines.TightLayoutEngine()

    def all_axes(self) -> list[Any]:
        """All Axes of the figure, colour bars too."""
        return [one for ax in self.figure.axes for one in (ax, *ax.child_axes)]

    def _forget(self) -> None:
        """Forgets what was removed from the figure."""
        known = set(self.all_axes())
        self.labelled = [ax for ax in self.labelled if ax in known]
        self.sentences = [one for one in self.sentences if one[1].axes in known]
        self.legends = [one for one in self.legends if one.ax.get_legend() is one.legend]
        self.words = [one for one in self.words if one.text.axes in known]

    def _break(self) -> bool:
        """Breaks what is too long; returns whether anything was."""
        broken, cells = list[bool](), dict[Any, Axes]()
        if self.engine() is None:  # nothing makes room for more lines
            placed = (ax for ax in self.figure.axes if ax.get_subplotspec() is not None)
            cells = {one: ax for ax in placed for one in (ax, *ax.child_axes)}
        for ax in self.labelled:
            wide = ax.get_position(original=True).width * ax.figure.bbox.width  # at any aspect
            wide, high = cell_size(cells[ax]) if ax in cells else (wide, ax.bbox.height)
            rooms = {ax.xaxis.label: wide, ax.yaxis.label: high, ax.title: wide}
            broken += [wrap(text, room + 0.08 * ax.figure.dpi) for text, room in rooms.items()]
        broken += [wrap(text, share * ax.bbox.width) for ax, text, share in self.sentences]
        return any(broken)

    def _place(self, renderer: Any) -> bool:
        """Finds places; returns whether the layout has to follow."""
        moved = [one.hang(renderer) for one in self.legends]
        for ax in self.figure.axes:
            legends = [one for one in self.legends if one.ax is ax and one.inside]
            words = [one for one in self.words if one.ax is ax]
            if legends or words:
                covered = _Covered(ax, [one.text for one in words])
                moved += [one.find(covered) for one in legends]
                for one in words:
                    one.find(covered)
        return any(moved)


def _arranger(ax: Axes) -> _Arranger:
    """The arranger of the figure of Axes."""
    figure: Any = ax.figure.figure
    for one in figure.artists:
        if isinstance(one, _Arranger):
            return one
    made: _Arranger = figure.add_artist(_Arranger())
    return made


def wrap(text: Text, room: float) -> bool:
    """Breaks the lines of a text that are longer than some pixels; returns whether it did.

    Lines break at spaces into lines of similar length.
    """
    before, upright = text.get_text(), int(text.get_rotation() == 90.0)

    def length(words: str) -> float:
        text.set_text(words)
        return float(text.get_window_extent().size[upright])

    if not before or length(before) <= room:
        return False

    def lines(words: list[str], room: float) -> list[str]:
        found = words[:1]
        for word in words[1:]:
            longer = f"{found[-1]} {word}"
            found[-1:] = [longer] if length(longer) <= room else [found[-1], word]
        return found

    every = list[str]()
    for line in before.split("\n"):
        words, share = SPACES.split(line), room
        found = shorter = lines(words, share)
        while 1 < len(found) == len(shorter) < len(words):
            found, share = shorter, 0.9 * share
            shorter = lines(words, share)
        every += found
    text.set_text("\n".join(every))
    return text.get_text() != before
