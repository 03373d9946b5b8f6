# SPDX-License-Identifier: MIT
"""Axes for the tests of pictures, in figures that no window shows."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def axes(layout: str | None = None, **options: Any) -> Axes:
    figure = Figure(layout=layout, **options)
    FigureCanvasAgg(figure)
    return figure.subplots()


def legend_of(ax: Axes) -> list[str]:
    """Texts of the legend."""
    return [text.get_text() for text in ax.get_legend().get_texts()]
