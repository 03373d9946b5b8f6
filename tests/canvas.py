# SPDX-License-Identifier: MIT
"""Axes for the tests of pictures, in figures that no window shows, and measures of overlaps."""

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.text import Text


def axes(layout: str | None = None, **options: Any) -> Axes:
    figure = Figure(layout=layout, **options)
    FigureCanvasAgg(figure)
    return figure.subplots()


def all_axes(figure: Figure) -> list[Axes]:
    """Axes of a figure, followed by their colour bars."""
    return [*figure.axes, *(bar for ax in figure.axes for bar in ax.child_axes)]


def legend_of(ax: Axes) -> list[str]:
    """Texts of the legend."""
    return [text.get_text() for text in ax.get_legend().get_texts()]


def _texts(ax: Axes) -> list[Text]:
    """Title, labels, numbers at ticks and words that are seen."""
    found = [ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts]
    for axis in (ax.xaxis, ax.yaxis):
        low, high = sorted(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if low <= tick.get_loc() <= high:
                found += [tick.label1, tick.label2]
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def _curves(ax: Axes) -> tuple[list[Path], Any]:
    """Lines and outlines of collections, and places of markers, shape (k, 2), in pixels."""
    paths, places = [], [np.empty((0, 2))]
    for line in ax.lines:
        path = line.get_transform().transform_path(line.get_path())
        if line.get_linestyle() == "None":
            places.append(np.asarray(path.vertices))
        else:
            paths.append(path)
    for one in ax.collections:
        offsets: Any = one.get_offsets()
        if np.any(offsets):
            places.append(one.get_offset_transform().transform(offsets))
        else:
            paths += [one.get_transform().transform_path(path) for path in one.get_paths()]
    return paths, np.concatenate(places)


def overlaps(figure: Figure) -> list[str]:
    """What covers curves in the Axes, or other texts, in a figure that was drawn."""
    found, boxes = list[str](), list[tuple[Any, Any]]()
    for ax in all_axes(figure):
        texts: list[Artist] = [*_texts(ax)]
        if (legend := ax.get_legend()) is not None:
            texts.append(legend)
        (curves, places), frame = _curves(ax), ax.get_window_extent()
        for one in texts:
            box = one.get_window_extent()
            boxes.append((one, box))
            if frame.overlaps(box.padded(-1.0)):
                covers = any(curve.intersects_bbox(box, filled=False) for curve in curves)
                covers |= bool(box.count_contains(places))
                found += [f"{one} of {ax} covers a curve"] * covers
    for (one, box), (other, beside) in combinations(boxes, 2):
        # The title of a film keeps a line free for the time.
        free = isinstance(one, Text) and one.get_text().endswith("\n ")
        if box.padded(-0.5).overlaps(beside.padded(-0.5)) and not free:
            found.append(f"{one} covers {other}")
    return found


def small_letters(figure: Figure) -> list[str]:
    """Texts with letters below six points."""
    legends = [ax.get_legend() for ax in figure.axes]
    texts = [text for ax in all_axes(figure) for text in _texts(ax)]
    texts += [text for legend in legends if legend is not None for text in legend.get_texts()]
    return [text.get_text() for text in texts if text.get_size() < 6.0]
