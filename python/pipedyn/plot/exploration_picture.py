# SPDX-License-Identifier: MIT
"""The picture of an `Exploration`: three Axes whose curves follow its numbers.

Axes, ticks and labels are drawn once and kept as pixels. At each change only the curves are drawn
over these, which takes a thirtieth of the time. The pipe moves in the browser, as an animated SVG
on top of the pixels.
"""

from __future__ import annotations

import io
import math
import zlib
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox
from PIL import Image

from pipedyn.linear.neutral import grows
from pipedyn.models.scales import scales_at
from pipedyn.plot import common, units
from pipedyn.plot.common import rounded_up
from pipedyn.plot.linear import branches_of, pieces
from pipedyn.plot.motion import clamp_and_gravity, flow_ends
from pipedyn.plot.stability_map import STABLE
from pipedyn.plot.units import Measure
from pipedyn.util.check import Array

CYCLES = 3
"""Number of cycles of the mode in a film."""

PICTURE_WIDTH, PICTURE_HEIGHT, PICTURE_DPI = 9.6, 3.7, 110
"""Size of the picture in inches, and pixels an inch; it is as wide as the page of a notebook."""

LEFT, WIDE, BOTTOM, HIGH = (0.065, 0.385, 0.745), (0.245, 0.275, 0.245), 0.13, 0.73
"""Left edges, widths, lower edge and height of the three Axes, in shares of the picture."""

ABOVE = 0.882
"""Lower edge of the colour bar, in shares of the picture; Axes below it can be redrawn alone."""

REAL_REACH = 0.35
"""Limit of the axis of real parts, both ways, as a share of that of frequencies. Strongly damped
roots lie far outside and do not matter."""

ENVELOPE = 9
"""Number of shapes behind the moving pipe, from the cycle with the largest motion."""


PLACE_X = Measure("$x / L$", "$x$ (m)", units.TRANSVERSE.unit)
PLACE_Y = Measure("$y / L$", "$y$ (m)", units.AXIAL.unit)


class ExplorationPicture:
    """Root loci, stability boundary and moving pipe of an exploration.

    Args:
        exploration: the exploration whose numbers are shown.

    Attributes:
        figure: the figure of matplotlib, which `update` brings up to date.
    """

    def __init__(self, exploration: Any) -> None:
        self._of = exploration
        with common.style():
            self._build()
        self._background: Any = None  # pixels of all that does not change
        self._backgrounds: dict[tuple[int, float], Any] = {}  # pixels of Axes, by index and state
        self._shown: dict[str, Any] = {}

    def _build(self) -> None:
        of = self._of
        self.figure = Figure(figsize=(PICTURE_WIDTH, PICTURE_HEIGHT), dpi=PICTURE_DPI)
        self._canvas: Any = FigureCanvasAgg(self.figure)  # its methods have no types
        places = zip(LEFT, WIDE, strict=True)
        self.axes: tuple[Axes, ...] = tuple(
            self.figure.add_axes((left, BOTTOM, wide, HIGH)) for left, wide in places
        )
        loci, speeds, _ = self.axes
        view = of.view
        highest = of.slider("u").high * float(self._speed(of.values["beta"]))
        norm = Normalize(0.0, highest)
        # The first Axes show root loci, coloured by the flow speed, and roots at the speed set.
        loci.set(xlabel=view.label(units.GROWTH), ylabel=view.label(units.OSCILLATION))
        loci.axvline(0.0, color="0.4", linewidth=0.6, zorder=0.5)
        loci.yaxis.set_label_coords(-0.17, 0.5)
        loci.tick_params(top=False, right=False)
        loci.locator_params(nbins=5)  # each tick takes half a millisecond
        self.branches = LineCollection([], cmap="viridis", norm=norm, linewidths=1.8, zorder=2.0)
        loci.add_collection(self.branches, autolim=False)
        (self.roots,) = loci.plot([], [], **common.open_marker(6.0, zorder=4.0))
        red = common.open_marker(6.0, zorder=4.0, markerfacecolor=common.VERMILION)
        (self.growing_roots,) = loci.plot([], [], **red)
        bar = self.figure.add_axes((LEFT[0], ABOVE, WIDE[0], 0.02))
        colours = ScalarMappable(norm, "viridis")
        self.figure.colorbar(colours, cax=bar, orientation="horizontal")
        bar.xaxis.set_ticks_position("top")
        bar.tick_params(length=2.0, pad=1.0)
        speed = view.label(Measure("flow speed $u$", units.FLOW_SPEED.si_label))
        bar.set_title(f"root loci, {speed} as colour", pad=13.0)
        # The second Axes show the map of critical speeds.
        slider, shown = of.slider(of.against), units.of_number(of.against, of.model.pipe)
        ends = view.one(shown) * np.array([slider.low, slider.high])
        if of.against == "beta" and view.si:  # the unit of speed depends on beta
            curve = self._speed(of.curve.values) * of.curve.speeds
            highest = max(highest, 1.2 * float(np.max(curve, initial=0.0, where=curve < np.inf)))
        speeds.set(xlim=ends, ylim=(0.0, highest), xlabel=view.label(shown), ylabel=speed)
        speeds.set_title("green: stable; ring: this pipe", pad=20.0)
        speeds.yaxis.set_label_coords(-0.13, 0.5)
        self.stable = PolyCollection([], facecolors=STABLE, edgecolors="none", zorder=0.2)
        self.stable.set_antialiased(False)  # neighbours share edges
        speeds.add_collection(self.stable, autolim=False)
        (self.onset,) = speeds.plot([], [], color="0.35", linewidth=1.0, zorder=2.0)
        dashed: dict[str, Any] = {"color": common.BLUE, "linestyle": "--", "linewidth": 1.0}
        (self.regained,) = speeds.plot([], [], label="buckled below", **dashed)
        dot: dict[str, Any] = {"linestyle": "none", "markersize": 2.8, "zorder": 2.5}
        black, blue = dot | {"color": common.BLACK}, dot | {"color": common.BLUE}
        (self.flutter,) = speeds.plot([], [], marker="o", label="flutter", **black)
        (self.divergence,) = speeds.plot([], [], marker="s", label="divergence", **blue)
        (self.place,) = speeds.plot([], [], **common.open_marker(6.0, zorder=4.0, clip_on=False))
        handles = (self.flutter, self.divergence, self.regained)
        look: dict[str, Any] = {
            "frameon": False,
            "handlelength": 1.6,
            "columnspacing": 1.2,
            "borderpad": 0.0,
        }
        above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.01), "ncols": 3}
        speeds.legend(handles=handles, **above, **look)
        # The third Axes show shapes of the pipe.
        (self.pipe,) = self.axes[2].plot([], [], color=common.BLACK, linewidth=2.6, zorder=2.5)
        self.envelope = LineCollection([], colors="0.75", linewidths=0.8, zorder=1.8)

    @property
    def _moving(self) -> tuple[Artist, ...]:
        """Artists that are drawn at each change, the lowest first; not the pipe itself."""
        return (
            *(self.branches, self.roots, self.growing_roots),
            *(self.stable, self.onset, self.regained, self.flutter, self.divergence, self.place),
            self.envelope,
        )

    def _speed(self, beta: Any) -> Any:
        """Value shown for a flow speed u = 1, at one mass ratio or several."""
        scales = self._of.view.scales
        si = self._of.view.si and scales is not None
        return scales_at(beta, scales).speed if si and scales is not None else np.ones_like(beta)

    @property
    def _speeds_shown(self) -> Any:
        """Values shown for a flow speed u = 1, at each value of the curve."""
        betas = np.full_like(self._of.curve.values, self._of.values["beta"])
        return self._speed(self._of.curve.values if self._of.against == "beta" else betas)

    # ------------------------------------------------------------------------------- artists

    def update(self) -> None:
        """Gives all artists the data of the current state of the exploration."""
        of, shown, rate = self._of, self._shown, self._of.view.one(units.GROWTH)
        one = float(self._speed(of.values["beta"]))
        if shown.get("loci") is not of.loci:
            shown["loci"] = of.loci
            branches, colour = rate * branches_of(of.loci), one * of.loci.speeds[:, None]
            segments, colours = pieces(branches.real, branches.imag, colour)
            self.branches.set_segments(list(segments))
            self.branches.set_array(colours)
            self._limit(branches)
        if shown.get("modes") is not of.modes:
            shown["modes"] = of.modes
            values = np.array([mode.eigenvalue for mode in of.modes], dtype=np.complex128)
            growing = grows(values)
            values *= rate
            self.roots.set_data(values.real[~growing], values.imag[~growing])
            self.growing_roots.set_data(values.real[growing], values.imag[growing])
            self._film()
        if shown.get("curve") is not of.curve or shown.get("speed") != one:
            shown["curve"], shown["speed"] = of.curve, one
            self._map()
        self.place.set_data([self._across * of.values[of.against]], [one * of.values["u"]])
        self.place.set_markerfacecolor(common.VERMILION if of.unstable else "white")

    def _limit(self, branches: Any) -> None:
        """Sets the limits for the branches to round numbers, so that they rarely change."""
        imag = branches.imag[np.isfinite(branches.imag)]
        top = rounded_up(1.02 * float(np.max(imag, initial=1e-3)))
        if self._shown.get("top") != top:
            self._shown["top"] = top
            self.axes[0].set(xlim=(-REAL_REACH * top, REAL_REACH * top), ylim=(0.0, top))
            self._redraw(0, top)

    @property
    def _across(self) -> float:
        """Value shown for a 1 of the number against which critical speeds are drawn."""
        return self._of.view.one(units.of_number(self._of.against, self._of.model.pipe))

    def _map(self) -> None:
        of, one = self._of, self._speeds_shown
        values, ranges = self._across * of.curve.values, of.stable_speeds
        speeds, highest = one * of.curve.speeds, self.axes[1].get_ylim()[1]
        low, high = one * ranges[:, 0], np.minimum(one * ranges[:, 1], 2.0 * highest)
        corners = [(values[:-1], low[:-1]), (values[1:], low[1:])]
        corners += [(values[1:], high[1:]), (values[:-1], high[:-1])]
        quads = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)
        self.stable.set_verts(list(quads[np.isfinite(quads).all(axis=(1, 2))]))
        # A crossing is no boundary of stability if the pipe is unstable below it, too.
        lost = [one if one and not one.unstable_before else None for one in of.curve.critical]
        kinds = np.array([None if one is None else one.kind for one in lost])
        known = np.array([one is not None for one in lost])
        self.onset.set_data(values, np.where(known, speeds, math.nan))
        self.regained.set_data(
            values, np.where((low > 0.0) & (known | np.isinf(ranges[:, 1])), low, math.nan)
        )
        for kind, line in ("flutter", self.flutter), ("divergence", self.divergence):
            line.set_data(values[kinds == kind], speeds[kinds == kind])

    def _film(self) -> None:
        of = self._of
        shapes = of.view.one(units.TRANSVERSE) * of.film.shapes
        if self._shown.get("weight") != (sign := float(np.sign(of.values["gamma"]))):
            self._shown["weight"] = sign
            self._surround(sign)
        places = np.linspace(0, len(shapes) // CYCLES, ENVELOPE).astype(int)
        self.envelope.set_segments(list(shapes[-1 - places if of.unstable else places]))
        self.pipe.set_data(*shapes[0].T)

    def _surround(self, weight: float) -> None:
        """Draws clamp and gravity of a pipe that hangs (1), stands (-1) or has no weight (0)."""
        ax = self.axes[2]
        with common.style():
            ax.clear()
            view = self._of.view
            one = view.one(units.TRANSVERSE)
            reach = one * np.array([[-0.34, 0.0], [0.34, 1.0]])  # corners that hold every film
            clamp_and_gravity(ax, weight, reach, one)
            xlabel, ylabel = map(view.label, (PLACE_X, PLACE_Y))
            ax.set(title="linear motion, least stable mode", xlabel=xlabel, ylabel=ylabel)
            ax.yaxis.set_label_coords(-0.2, 0.5)
        ax.add_collection(self.envelope, autolim=False)
        ax.add_line(self.pipe)
        self._redraw(2, weight)

    # -------------------------------------------------------------------------------- pixels

    def _redraw(self, index: int, key: float) -> None:
        """Draws one of the Axes anew, without moving artists, and keeps its pixels for reuse."""
        if self._background is None:
            return
        left = 0.0 if index == 0 else LEFT[index] - 0.06
        right = 1.0 if index == 2 else LEFT[index + 1] - 0.06
        part = Bbox([[left, 0.0], [right, ABOVE - 0.01 if index == 0 else 1.0]])
        self._canvas.restore_region(self._background)
        if (index, key) in self._backgrounds:
            self._canvas.restore_region(self._backgrounds[index, key])
        else:
            blank = Rectangle(part.p0, part.width, part.height, color="white")
            blank.set_transform(self.figure.transFigure)
            blank.set_figure(self.figure)
            self.figure.draw_artist(blank)
            self._still(self.axes[index])
            place = part.transformed(self.figure.transFigure)
            self._backgrounds[index, key] = self._canvas.copy_from_bbox(place)
        self._background = self._canvas.copy_from_bbox(self.figure.bbox)

    def _still(self, drawn: Axes | None = None) -> None:
        """Draws the figure, or one of its Axes, without the artists that move."""
        hidden = (*self._moving, self.pipe)
        for artist in hidden:
            artist.set_visible(False)
        with common.style():
            if drawn is None:
                self._canvas.draw()
            else:
                self.figure.draw_artist(drawn)
        for artist in hidden:
            artist.set_visible(True)

    def png(self) -> bytes:
        """The current picture as the bytes of a PNG file, without the moving pipe."""
        self.update()
        if self._background is None:
            self._still()
            self._background = self._canvas.copy_from_bbox(self.figure.bbox)
            gravity, now = self._of.slider("gamma"), self._shown["weight"]
            signs = {float(np.sign(one)) for one in (gravity.low, gravity.high)} - {now}
            for sign in (*signs, now):  # draws both, so that a change of sign is as quick as others
                self._surround(sign)
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            self.figure.draw_artist(artist)
        pixels = Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB")
        file = io.BytesIO()
        pixels.save(file, "png", compress_level=1, compress_type=zlib.Z_RLE)  # the quickest
        return file.getvalue()

    def overlay(self) -> str:
        """The moving pipe as an SVG that fits the pixels exactly.

        Browsers animate it as an image of its own, but not all do so as a part of a page.
        """
        self.update()
        of, film = self._of, self._of.film
        width, height = 10.0 * PICTURE_WIDTH * PICTURE_DPI, 10.0 * PICTURE_HEIGHT * PICTURE_DPI
        one = of.view.one(units.TRANSVERSE)
        shapes = one * film.shapes
        points = _polylines(self._pixels(shapes))
        arrows = np.array([flow_ends(of.model.pipe, shape, one) for shape in shapes])
        tips = _polylines(self._pixels(arrows))
        timing = f'dur="{film.seconds:g}s" repeatCount="indefinite"'
        line = "fill:none;stroke-linecap:round;stroke-linejoin:round"
        moving = [
            f'<polyline points="{points[0]}" style="{line};stroke:{common.BLACK};stroke-width:38">'
            f'<animate attributeName="points" values="{";".join(points)}" {timing}/></polyline>'
        ]
        if of.values["u"]:
            look = f"{line};stroke:{common.VERMILION};stroke-width:25"
            moving.append(
                f'<polyline points="{tips[0]}" style="{look}" marker-end="url(#flow)">'
                f'<animate attributeName="points" values="{";".join(tips)}" {timing}/></polyline>'
            )
        head = (
            '<marker id="flow" viewBox="0 0 10 10" refX="5" refY="5" markerWidth="5" '
            'markerHeight="5" orient="auto"><path d="M0,0 L10,5 L0,10 z" '
            f'fill="{common.VERMILION}"/></marker>'
        )
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
            f'width="{width / 10.0:g}" height="{height / 10.0:g}">'
            f"<defs>{head}</defs>{''.join(moving)}</svg>"
        )

    def _pixels(self, places: Array) -> Array:
        """Points (..., 2) of the third Axes, in tenths of a pixel from the upper left corner."""
        flat = self.axes[2].transData.transform(places.reshape(-1, 2))
        flat[:, 1] = PICTURE_HEIGHT * PICTURE_DPI - flat[:, 1]
        result: Array = 10.0 * flat.reshape(places.shape)
        return result


def _polylines(places: Array) -> list[str]:
    """Texts of k polylines of an SVG, in whole numbers, from points of shape (k, points, 2)."""
    return [
        " ".join(map(str, one))
        for one in places.round().astype(int).reshape(len(places), -1).tolist()
    ]
