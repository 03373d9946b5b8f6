# SPDX-License-Identifier: MIT
"""The picture of an `Exploration`: root loci, stability boundary and the motion of a mode.

Matplotlib draws the picture again for each state, which takes a tenth of a second; the Axes are
kept, as making them takes as long again. The moving pipe is an animated SVG on top of the picture,
which the browser animates.
"""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine

from pipedyn.linear.neutral import grows
from pipedyn.plot import common, units
from pipedyn.plot.common import rounded_up
from pipedyn.plot.linear import root_loci
from pipedyn.plot.motion import clamp_and_gravity, flow_ends
from pipedyn.plot.stability_map import STABLE
from pipedyn.plot.units import Measure, PlaneView, Units
from pipedyn.util.check import Array

CYCLES = 3
"""Number of cycles of the mode in a film."""

CYCLE_SECONDS = 1.2
"""Time in seconds that a cycle takes on the screen, slow enough to follow by eye."""

PICTURE_WIDTH, PICTURE_HEIGHT, PICTURE_DPI = 9.6, 3.7, 110
"""Size of the picture in inches, and pixels an inch; it is as wide as the page of a notebook."""

LEFT, WIDE, BOTTOM, HIGH = (0.065, 0.385, 0.745), (0.245, 0.275, 0.245), 0.13, 0.73
"""Left edges, widths, lower edge and height of the three Axes, as shares of the picture."""

REAL_REACH = 0.35
"""Limit of the axis of real parts in both directions, as a share of the limit of frequencies.
Strongly damped roots lie far outside and are not of interest."""

DOTS = ("flutter", "o", common.BLACK), ("divergence", "s", common.BLUE)
"""Marker and colour of critical speeds by the kind of instability."""

ENVELOPE = 9
"""Number of shapes drawn behind the moving pipe, from the cycle with the largest motion."""

OVERLAY = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="{wide:g}" height="{high:g}" '
    'viewBox="0 0 {wide:g} {high:g}"><defs><marker id="flow" viewBox="0 0 10 10" refX="5" refY="5" '
    'markerWidth="5" markerHeight="5" orient="auto"><path d="M0,0 L10,5 L0,10 z" fill="{jet}"/>'
    '</marker></defs><g transform="scale(0.1)">{moving}</g></svg>'
)
POLYLINE = (
    '<polyline points="{first}" style="fill:none;stroke-linecap:round;stroke-linejoin:round;'
    '{look}"><animate attributeName="points" values="{every}" dur="{seconds:g}s" '
    'repeatCount="indefinite"/></polyline>'
)


class ExplorationPicture:
    """Root loci, stability boundary and moving pipe of an exploration.

    Args:
        exploration: the exploration whose numbers are shown.

    Attributes:
        figure: the figure of matplotlib without the moving pipe; `update` brings it up to date.
    """

    def __init__(self, exploration: Any) -> None:
        self._of, self._view = exploration, exploration.view
        self._units: Units = "si" if exploration.view.si else "nondimensional"
        with common.style():
            self.figure = Figure(figsize=(PICTURE_WIDTH, PICTURE_HEIGHT), dpi=PICTURE_DPI)
            self.figure.set_layout_engine(PlaceHolderLayoutEngine(True, True))  # none computes it
            self._canvas: Any = FigureCanvasAgg(self.figure)  # its methods have no types
            self.axes: tuple[Axes, ...] = tuple(
                self.figure.add_axes((left, BOTTOM, wide, HIGH))
                for left, wide in zip(LEFT, WIDE, strict=True)
            )
            # The highest speed shown stays the same when the mass ratio changes.
            self._highest = self._of.slider("u").high * self._view.one(units.FLOW_SPEED)
            self._colours = ScalarMappable(Normalize(0.0, self._highest), "viridis")
            bar = self.figure.add_axes((LEFT[0], 0.882, WIDE[0], 0.02))
            look: dict[str, Any] = {"orientation": "horizontal", "ticklocation": "top"}
            self.figure.colorbar(self._colours, cax=bar, **look)
            bar.tick_params(length=2.0, pad=1.0)
            bar.set_title(f"root loci, {self._speed_label} as colour", pad=13.0)
            for ax, left in zip(self.axes, (-0.17, -0.13, -0.2), strict=True):
                ax.yaxis.set_label_coords(left, 0.5)
            self.axes[0].tick_params(top=False, right=False)
            self.axes[0].locator_params(nbins=5)
        self._shown: dict[str, float] = {}

    def update(self) -> None:
        """Draws the picture for the present numbers, unless it is drawn already."""
        if self._shown == self._of.values:
            return
        self._shown = dict(self._of.values)
        self._view = PlaneView(self._units, self._of.model.pipe, (self._of.against, "u"))
        for ax in self.axes:
            for artist in (*ax.lines, *ax.collections, *ax.patches, *ax.texts):
                artist.remove()
        with common.style():
            self._draw_loci(self.axes[0])
            self._draw_map(self.axes[1], self._highest)
            self._draw_motion(self.axes[2])

    def _draw_loci(self, ax: Axes) -> None:
        """Draws root loci, coloured by the flow speed, and the roots at the present speed."""
        of, rate = self._of, self._view.one(units.GROWTH)
        highest = self._highest / self._view.one(units.FLOW_SPEED)
        root_loci(of.loci, highest=highest, units=self._units, ax=ax)
        values = np.array([mode.eigenvalue for mode in of.modes])
        growing = grows(values)
        ring = common.open_marker(6.0, zorder=4.0)
        for chosen, gid in ((~growing, "roots"), (growing, "growing roots")):
            roots = rate * values[chosen]
            ax.plot(roots.real, roots.imag, gid=gid, **ring)
            ring["markerfacecolor"] = common.VERMILION  # growing roots are filled
        top = rounded_up(1.02 * rate * float(np.nanmax(of.loci.eigenvalues.imag)))
        ax.set(xlim=(-REAL_REACH * top, REAL_REACH * top), ylim=(0.0, top))

    @property
    def _speed_label(self) -> str:
        return self._view.label(Measure("flow speed $u$", "flow speed", units.FLOW_SPEED.unit))

    def _draw_map(self, ax: Axes, highest: float) -> None:
        """Draws critical speeds against a number, and the speeds at which the pipe is stable."""
        of, view, (shown, _) = self._of, self._view, self._view.quantities
        values, speeds = view.at(of.curve.values, of.curve.speeds)
        low, high = (view.at(of.curve.values, ends)[1] for ends in of.stable_speeds.T)
        if of.against == "beta" and view.si:  # the unit of speed depends on beta
            largest = float(np.max(speeds, initial=0.0, where=speeds < np.inf))
            highest = max(highest, rounded_up(1.2 * largest))
        fill: dict[str, Any] = {"facecolor": STABLE, "linewidth": 0.0, "zorder": 0.2}
        ax.fill_between(values, low, np.minimum(high, 2.0 * highest), gid="stable", **fill)
        # A crossing is no boundary of stability if the pipe is unstable below it, too.
        kinds = np.array(
            [one.kind if one and not one.unstable_before else "" for one in of.curve.critical]
        )
        onset = np.where(kinds != "", speeds, math.nan)
        ax.plot(values, onset, color="0.35", linewidth=1.0, zorder=2.0, gid="onset")
        dot: dict[str, Any] = {"linestyle": "none", "markersize": 2.8, "zorder": 2.5}
        for kind, marker, colour in DOTS:
            chosen = kinds == kind
            ax.plot(values[chosen], speeds[chosen], marker, color=colour, label=kind, **dot)
        dashed: dict[str, Any] = {"color": common.BLUE, "linestyle": "--", "linewidth": 1.0}
        ax.plot(values, np.where(low > 0.0, low, math.nan), label="unstable below", **dashed)
        place = common.open_marker(6.0, zorder=4.0, clip_on=False, gid="place")
        place["markerfacecolor"] = common.VERMILION if of.unstable else "white"
        ax.plot(*view.at(of.values[of.against], of.values["u"]), **place)
        slider = of.slider(of.against)
        ends = view.one(shown) * np.array([slider.low, slider.high])
        ax.set(xlim=ends, ylim=(0.0, highest), xlabel=view.label(shown), ylabel=self._speed_label)
        ax.set_title("green: stable; ring: this pipe", pad=20.0)
        above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.01), "ncols": 3}
        above |= {"handlelength": 1.6, "columnspacing": 1.2, "borderpad": 0.0}
        ax.legend(frameon=False, **above)

    def _draw_motion(self, ax: Axes) -> None:
        """Draws clamp, gravity, and shapes of the pipe in the cycle with the largest motion."""
        of, one = self._of, self._view.one(units.TRANSVERSE)
        reach = one * np.array([[-0.34, 0.0], [0.34, 1.0]])  # opposite corners around all films
        clamp_and_gravity(ax, of.values["gamma"], reach, self._view)
        shapes = one * of.film.shapes
        places = np.linspace(0, len(shapes) // CYCLES, ENVELOPE).astype(int)
        shown = list(shapes[-1 - places if of.unstable else places])
        grey: dict[str, Any] = {"colors": "0.75", "linewidths": 0.8, "zorder": 1.8}
        ax.add_collection(LineCollection(shown, gid="envelope", **grey))
        ax.set_title("linear motion, least stable mode")
        ax.apply_aspect()  # sets the place of the moving pipe before the figure is drawn

    def png(self) -> bytes:
        """The picture as the bytes of a PNG file, without the moving pipe."""
        self.update()
        file = io.BytesIO()
        with common.style():
            self._canvas.print_png(file, pil_kwargs={"compress_level": 1})  # savefig draws twice
        return file.getvalue()

    def overlay(self) -> str:
        """The moving pipe as an SVG that fits the picture exactly.

        All browsers animate an SVG that is an image of its own, but some animate no SVG that is a
        part of a page.
        """
        self.update()
        of, one = self._of, self._view.one(units.TRANSVERSE)
        shapes = one * of.film.shapes
        moving = self._animated(shapes, f"stroke:{common.BLACK};stroke-width:38")
        if of.values["u"]:
            arrows = np.array([flow_ends(of.model.pipe, shape, one) for shape in shapes])
            look = f"stroke:{common.VERMILION};stroke-width:25;marker-end:url(#flow)"
            moving += self._animated(arrows, look)
        wide, high = self.figure.bbox.size
        return OVERLAY.format(wide=wide, high=high, jet=common.VERMILION, moving=moving)

    def _animated(self, places: Array, look: str) -> str:
        """A moving polyline, from points on the third Axes in each frame, (frames, points, 2)."""
        flat = self.axes[2].transData.transform(places.reshape(-1, 2))
        flat[:, 1] = self.figure.bbox.height - flat[:, 1]
        tenths = (10.0 * flat).round().astype(int).reshape(len(places), -1)  # tenths of a pixel
        frames = [" ".join(map(str, frame)) for frame in tenths.tolist()]
        every, seconds = ";".join(frames), CYCLES * CYCLE_SECONDS
        return POLYLINE.format(first=frames[0], every=every, look=look, seconds=seconds)
