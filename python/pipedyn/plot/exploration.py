# SPDX-License-Identifier: MIT
"""`plot.explore`: a pipe whose numbers are set by sliders, the answers for it, and their picture.

Only `explore` needs a notebook. The answers of an `Exploration` are those of public functions:
`root_loci`, `modes` and `critical_speed` of a chain, and `stability_curve` against one of the
numbers. Matplotlib draws the picture again for each state, which takes a tenth of a second; the
Axes are kept, as making them takes as long again. The moving pipe is an animated SVG on top of the
picture, which the browser animates, also in a page without a kernel, where ipympl shows nothing. It
is written in 1 ms and has 7 kB; matplotlib takes 1.8 s for the frames of a film, of 160 kB.
"""

from __future__ import annotations

import html
import io
import math
import textwrap
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine

from pipedyn.linear.critical_speed import (
    CriticalSpeed,
    NoCrossing,
    critical_speed,
    crossings,
    stability_losses,
    stable_speeds,
)
from pipedyn.linear.loci import RootLoci, root_loci
from pipedyn.linear.modes import ModeShape, modes
from pipedyn.linear.neutral import grows, growth
from pipedyn.linear.reach import is_overdamped
from pipedyn.linear.stability_curve import StabilityCurve, stability_curve
from pipedyn.models.chain import Chain
from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.models.pipe_numbers import PipeNumber, checked_number, pipe_numbers
from pipedyn.plot import common, linear, units
from pipedyn.plot.arrange import write_inside
from pipedyn.plot.common import rounded_up
from pipedyn.plot.motion import clamp_and_gravity, flow_ends
from pipedyn.plot.stability_map import STABLE
from pipedyn.plot.units import Measure, PlaneView, Units, View
from pipedyn.util import check
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.result import speed_in_si

MOST_SEGMENTS = 20
"""Largest number of segments. With strong damping the stability curve of 40 segments takes over a
second, and that of 20 segments about 0.05 s."""

FINENESS = ((10, 25), (14, 17), (MOST_SEGMENTS, 11))
"""Pairs of a largest number of segments and the number of points of the stability curve up to it.
With strong damping and many segments a point takes long."""

MAX_SPEED = 100.0
"""Flow speed up to which a loss of stability is searched."""

LOCI_SPEEDS = 61
"""Number of flow speeds of the root loci; a step is then at most 4 pixels on most branches."""

EIGENVALUE_ROUNDING = 1e-9
"""Relative difference up to which real parts of eigenvalues count as equal."""

ALWAYS = ("beta", "gamma", "damping")
"""Numbers of the pipe that always have a slider; their sliders follow the slider of u."""

BENDING = ("inclination", "jet_angle")
"""Numbers of the pipe that have no slider, as they bend it."""

FRAMES = 16
"""Number of frames in each cycle of the mode in a film. Straight lines between frames differ from
the motion by 2 % of the amplitude."""

SWING, STEEPEST = 0.25, 0.7
"""Largest displacement in a film, in L, and largest slope. A linear mode has no amplitude of its
own, so it is scaled until it meets one of them."""

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


class Exploration:
    """A chain whose numbers can be set one by one, with the answers that `plot.explore` shows.

    Args:
        pipe: the pipe at first; it must be able to rest straight.
        n: number of segments at first, up to 20.
        u: flow speed at first; 1.05 times the critical speed if not given.
        springs: rule for the springs, as for `Chain`.
        against: the number against which critical speeds are drawn: "beta", "gamma", or any other
            number with a slider but "u" and "segments".
        ranges: ranges (low, high) of sliders by name, in place of the usual ones; a number of the
            pipe that is named here gets a slider.
        units: units of the picture, "nondimensional", or "si" if the pipe has scales. The numbers
            that are set and the answers are always nondimensional.

    Attributes:
        view: the units of the picture.
        sliders: range (low, high) of each number that can be set, by name: "u", "beta", "gamma",
            "damping", "segments", the stiffness of a spring at the root, numbers of the terms, and
            all other numbers of the pipe that have no default or are not at their default.
        values: present values of these numbers, by name.
        model: the chain with the present values.
        critical: critical speed of the model; None if there is none up to u = 100.
        curve: critical speeds against the number `against`, with the present values of all others.

    Example:
        >>> at_hand = plot.Exploration(pp.Pipe(0.2, terms=[pp.PointMass(1.0, 0.1)]), n=10)
        >>> list(at_hand.values)
        ['u', 'beta', 'gamma', 'damping', 'segments', 'PointMass.mass']
        >>> at_hand.set("PointMass.mass", 0.0)
        >>> round(at_hand.critical.speed, 3) == round(
        ...     pp.critical_speed(pp.Chain(pp.Pipe(0.2), 10)).speed, 3)
        True

    Raises:
        ValueError: for a number that the pipe lacks or that does not affect small motions, for a
            range or a value that is not allowed, or for a pipe that does not rest straight.
        TypeError: for bad arguments.
    """

    def __init__(
        self,
        pipe: Pipe,
        n: int = 10,
        u: float | None = None,
        *,
        springs: str = "consistent",
        against: str = "beta",
        ranges: Mapping[str, tuple[float, float]] | None = None,
        units: Units = "nondimensional",
    ) -> None:
        check.instance("pipe", pipe, Pipe)
        self.view = View(units, pipe)
        n = check.count("n", n, high=MOST_SEGMENTS)
        check.instance("springs", springs, str)
        if pipe.jet_angle or not pipe.rests_straight:
            raise ValueError(
                f"pipe must rest straight: its small motions about that are shown, got {pipe!r}"
            )
        self._pipe, self._springs = pipe, springs
        model = Chain(pipe, n, springs=springs)
        given = _checked_ranges(ranges, pipe)
        self._numbers = _slider_numbers(pipe, given)
        own = {name: number.of(pipe) for name, number in self._numbers.items()}
        self.critical = _critical_or_none(model)
        if u is None:
            u = 4.0 if self.critical is None else 1.05 * self.critical.speed
        u = check.real("u", u, low=0.0, high=1e3)
        always = {name: own[name] for name in ALWAYS if name in own}
        self.values: dict[str, float] = {"u": u, **always, "segments": float(n)} | own
        self.sliders = {name: self._slider(name, given) for name in self.values}
        self.against = check.choice("against", against, tuple(own))
        self.model, self.curve = model, self._curve_of(model)

    # ------------------------------------------------------------------------------- numbers

    def set(self, name: str, value: float) -> None:
        """Sets a number; all answers then belong to its new value.

        Args:
            name: name of one of the sliders.
            value: value in the range of the slider; a whole number for "segments".

        Example:
            >>> at_hand = plot.Exploration(pp.Pipe(0.2), n=6)
            >>> at_hand.set("gamma", 30.0)
            >>> round(at_hand.critical.speed, 3)
            8.244

        Raises:
            ValueError: for another name, or a value outside the range; nothing is changed then.
            TypeError: if `value` is not a number.
        """
        low, high = self.sliders[check.choice("name", name, tuple(self.sliders))]
        if name == "segments":
            value = check.count(name, value, low=round(low), high=round(high))
        value = check.real(name, value, low=low, high=high)
        if value == self.values[name]:
            return
        values = self.values | {name: value}
        if name != "u":
            pipe = self._pipe
            for turned, number in self._numbers.items():
                if values[turned] != number.of(self._pipe):
                    pipe = number.changed(pipe, values[turned])
            model = Chain(pipe, round(values["segments"]), springs=self._springs)
            critical = _critical_or_none(model)
            curve = self.curve if name == self.against else self._curve_of(model)
            self.model, self.critical, self.curve = model, critical, curve
        self.values = values
        # Answers are computed again when they are used; two of them do not depend on u.
        for one in ("modes", "film", *(("loci", "stable_speeds") if name != "u" else ())):
            self.__dict__.pop(one, None)

    def _slider(self, name: str, given: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
        """Range of the slider of a number: the one that is given, or a usual one."""
        value = self.values[name]
        if name in given:
            low, high = given[name]
            if not low <= value <= high:
                raise ValueError(
                    f"ranges[{name!r}] must hold the value at first, {value:g}, got "
                    f"({low:g}, {high:g})"
                )
            return low, high
        if name == "u":
            critical = self.critical
            lost = 4.0 if critical is None or critical.unstable_before else 1.2 * critical.speed
            return 0.0, rounded_up(1.4 * max(value, lost))
        if name == "segments":
            return 1.0, float(MOST_SEGMENTS)
        rule = self._numbers[name].rule
        usual = OWN_NUMBERS[name].slider if name in OWN_NUMBERS else None
        low, high = usual or (0.0, 0.0 if value else 1.0)
        if value > high:
            high = rounded_up(2.0 * value)
        elif value < low:
            low = -rounded_up(-2.0 * value)
        below, above = rule.get("low", -math.inf), rule.get("high", math.inf)
        high = min(high, 0.999 if name == "beta" else above)
        return max(low, below), high

    # ------------------------------------------------------------------------------- answers

    @cached_property
    def loci(self) -> RootLoci:
        """Branches of eigenvalues up to the end of the slider of u."""
        return root_loci(self.model, np.linspace(0.0, self.sliders["u"][1], LOCI_SPEEDS))

    @cached_property
    def modes(self) -> tuple[ModeShape, ...]:
        """Modes at the flow speed, real ones and the upper of each pair, lowest first."""
        found = modes(self.model, self.values["u"])
        shapes = zip(found.shapes, found.converged, strict=True)
        return tuple(one for one, good in shapes if good)

    @property
    def _roots(self) -> Complex:
        """Eigenvalues of the modes, shape (number of modes,)."""
        return np.array([one.eigenvalue for one in self.modes])

    @property
    def least_stable(self) -> ModeShape:
        """The mode with the largest real part, the lowest of equal ones."""
        roots = self._roots
        same = roots.real >= roots.real.max() - EIGENVALUE_ROUNDING * (1.0 + np.abs(roots))
        return self.modes[int(np.argmax(same))]

    @property
    def unstable(self) -> bool:
        """Whether a mode grows by more than rounding."""
        return bool(grows(self._roots).any())

    @cached_property
    def film(self) -> Array:
        """Linear motion of the least stable mode over three cycles, shape (frames, points, 2).

        The centrelines have x transverse and y along the straight pipe. The motion grows or decays
        as the mode does, by a factor exp(3) if the mode does not oscillate. The motion is scaled so
        that the largest displacement is 0.25 L or the largest slope 0.7. Transverse displacements
        are those of the mode; the position along the pipe follows from its constant length.
        """
        s = np.append(0.0, self.model.stations)  # segments are straight between joints
        shape, rate = self.least_stable, growth(self._roots).max()
        omega = shape.eigenvalue.imag
        duration = 3.0 / abs(rate) if rate else 1.0
        if omega:
            duration = CYCLES * 2.0 * math.pi / omega
        times = np.linspace(0.0, duration, CYCLES * FRAMES + 1)
        largest = duration if rate > 0.0 else 0.0
        factors = np.exp(rate * (times - largest) + 1j * omega * times)
        across = (factors[:, None] * shape(s)).real
        slopes = np.abs(np.diff(across, axis=1) / np.diff(s)).max()
        across *= min(SWING / np.abs(across).max(), STEEPEST / slopes)
        along = np.sqrt(np.diff(s) ** 2 - np.diff(across, axis=1) ** 2)
        down = np.concatenate([np.zeros((times.size, 1)), np.cumsum(along, axis=1)], axis=1)
        return np.stack([across, down], axis=-1)

    @property
    def report(self) -> tuple[str, str]:
        """Two sentences: on stability at the flow speed, and on the range of stable speeds."""
        value = self.least_stable.eigenvalue
        kind = "flutter" if value.imag else "divergence"
        state = f"unstable, {kind} grows" if self.unstable else "stable"
        pair = f" ± {value.imag:.4g}i" if value.imag else ""
        now = f"u = {self._text(self.values['u'])}: {state}"
        return f"{now}. Least stable mode: λ = {value.real:.3g}{pair}.", self._stability()

    def _text(self, u: float) -> str:
        """A flow speed in words, also in SI units if the pipe has scales."""
        return f"{u:.4g}{speed_in_si(u, self.model.pipe.scales, 3)}"

    def _stability(self) -> str:
        """A sentence on the flow speeds at which the pipe is stable, and how it loses stability."""
        lost = self.critical
        if lost is None or lost.stable_from is None:
            end = MAX_SPEED if lost is None else self.sliders["u"][1]
            try:
                ranges = stable_speeds(self.model, crossings(self.model, end), end)
            except NotConverged as failure:
                return f"Where it is stable is not known: {failure}."
            if lost is None and ranges == ((0.0, end),):
                return f"No loss of stability up to u = {end:g}."
            parts = [f"from u = {self._text(low)} to {self._text(high)}" for low, high in ranges]
            if not parts:
                return f"Unstable at every flow speed up to u = {self._text(end)}."
            return f"Up to u = {self._text(end)} stable only {' and '.join(parts)}."
        begins = f"{lost.kind} begins at u = {self._text(lost.speed)}"
        if not is_overdamped(self.model.pipe, lost.mode):
            begins += f", mode {lost.mode}"
        if lost.stable_from:
            begins = f"stable from u = {self._text(lost.stable_from)} on; {begins}"
        if lost.frequency:
            begins += f", frequency {lost.frequency:.4g}"
            if self.model.pipe.scales:
                begins += f" ({lost.in_si().frequency:.3g} Hz)"
        return f"{begins[0].upper()}{begins[1:]}."

    # ---------------------------------------------------------------------- stability curve

    def _curve_of(self, model: Chain) -> StabilityCurve:
        points = next(points for most, points in FINENESS if model.lengths.size <= most)
        values = np.linspace(*self.sliders[self.against], points)
        return stability_curve(lambda value: self._with_value(model, value), values)

    def _with_value(self, model: Chain, value: float) -> Chain:
        """A model with another value of the number against which the curve is drawn."""
        return model.with_pipe(self._numbers[self.against].changed(model.pipe, value))

    @cached_property
    def stable_speeds(self) -> Array:
        """Ends of the lowest range of stable speeds at each value of the curve, shape (S, 2).

        The lower end is 0, except for a pipe that is buckled without flow and that the flow
        straightens. The upper end is infinite if stability is not lost up to u = 100. Both are NaN
        if there is no stable range up to the end of the slider of u, or if the point failed.
        """
        curve, end = self.curve, self.sliders["u"][1]
        found, again = np.full((curve.values.size, 2), np.nan), dict[int, Chain]()
        never_lost = np.isfinite(curve.no_loss_up_to)
        for i, critical in enumerate(curve.critical):
            if critical is not None and critical.stable_from is not None:
                found[i] = critical.stable_from, critical.speed
            elif critical is not None or never_lost[i]:
                again[i] = self._with_value(self.model, float(curve.values[i]))
        answers = stability_losses(list(again.values()), end)
        for (i, model), answer in zip(again.items(), answers, strict=True):
            ranges = () if isinstance(answer, Exception) else stable_speeds(model, answer[1], end)
            if ranges:
                low, high = ranges[0]
                found[i] = low, math.inf if high == end and never_lost[i] else high
        return found

    # ------------------------------------------------------------------------------ pictures

    @cached_property
    def picture(self) -> ExplorationPicture:
        """The picture of the exploration, which follows the numbers."""
        return ExplorationPicture(self)


def _critical_or_none(model: Chain) -> CriticalSpeed | None:
    try:
        return critical_speed(model, MAX_SPEED)
    except (NoCrossing, NotConverged):
        return None


def _checked_ranges(ranges: Any, pipe: Pipe) -> dict[str, tuple[float, float]]:
    """Checks the argument `ranges`: each range must lie within the values its number may have."""
    if ranges is None:
        return {}
    check.instance("ranges", ranges, Mapping)
    own = {"u": {"low": 0.0, "high": 1e3}, "segments": {"low": 1.0, "high": float(MOST_SEGMENTS)}}
    found = {}
    for name in ranges:
        straight = name not in BENDING
        if name in own:
            found[name] = check.interval(f"ranges[{name!r}]", ranges[name], **own[name])
        else:
            number = checked_number("a name in ranges", name, pipe, others=tuple(own))
            found[name] = check.interval(f"ranges[{name!r}]", ranges[name], **number.rule)
            straight &= all(number.changed(pipe, end).rests_straight for end in found[name])
        if not straight:
            raise ValueError(
                f"ranges[{name!r}] must leave the pipe straight at rest, as its small motions "
                f"about that are shown, got {check.shown(ranges[name])}"
            )
    return found


def _slider_numbers(pipe: Pipe, given: Mapping[str, Any]) -> dict[str, PipeNumber]:
    """Numbers of the pipe that get a slider, by name; a number with two names gets one slider."""
    numbers, names = pipe_numbers(pipe), dict[str, str]()
    for name, number in numbers.items():
        if names.get(number.name) not in given:
            names[number.name] = name
    found = {}
    for name in names.values():
        number = numbers[name]
        holder = type(pipe if number.term is None else pipe.terms[number.term])
        usual = number.of(pipe) == getattr(holder, number.attribute, None)
        if name not in BENDING and (name in given or name in ALWAYS or not usual):
            found[name] = number
    return found


# ------------------------------------------------------------------------------------ the picture


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
            self._highest = self._of.sliders["u"][1] * self._view.one(units.FLOW_SPEED)
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
        look: dict[str, Any] = {"numbers": False, "bar": False, "units": self._units}
        linear.root_loci(of.loci, highest=highest, ax=ax, **look)
        ax.set_title("", loc="right")  # the colour bar is in its place
        if of.loci.missing:
            write_inside(ax, textwrap.fill(of.loci.missing, 20), size="small")
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
        ends = view.one(shown) * np.array(of.sliders[of.against])
        ax.set(xlim=ends, ylim=(0.0, highest), xlabel=view.label(shown), ylabel=self._speed_label)
        ax.set_title("green: stable; ring: this pipe", pad=20.0)
        above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.01), "ncols": 3}
        above |= {"handlelength": 1.6, "columnspacing": 1.2, "borderpad": 0.0}
        ax.legend(frameon=False, **above)

    def _draw_motion(self, ax: Axes) -> None:
        """Draws clamp, gravity, and shapes of the pipe in the cycle with the largest motion."""
        of, one = self._of, self._view.one(units.TRANSVERSE)
        reach = one * np.array([[-0.34, 0.0], [0.34, 1.0]])  # opposite corners around all films
        weight = of.values["gamma"] * of.model.pipe.down[1]
        clamp_and_gravity(ax, (0.0, weight), reach, self._view)
        shapes = one * of.film
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
        shapes = one * of.film
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


# ------------------------------------------------------------------------------------ the sliders


GREEK = dict(zip(["alpha", "beta", "gamma", "delta", "kappa", "mu", "psi"], "αβγδκμψ", strict=True))

LABELS = {
    "u": "flow speed u",
    "root.stiffness": "root stiffness",
    **{name: f"{one.label} {GREEK.get(one.ascii, one.ascii)}" for name, one in OWN_NUMBERS.items()},
}

SAME_PLACE = "1 / 1 / 2 / 2"
"""Cell of a grid in which the moving pipe lies on top of the pixels."""

STEPS = 300
"""Largest number of steps of a slider; a step is a round number."""


def explore(
    pipe: Pipe,
    n: int = 10,
    u: float | None = None,
    *,
    springs: str = "consistent",
    against: str = "beta",
    ranges: Mapping[str, tuple[float, float]] | None = None,
    units: Units = "nondimensional",
) -> Any:
    """Sliders for the numbers of a pipe in Jupyter; pictures change while a slider is moved.

    There are sliders for the flow speed, beta, gamma, damping, the number of segments, the
    stiffness of a spring at the root, each number of the pipe's terms, and every other number of
    the pipe that is not at its default. The first picture shows root loci of the chain up to the
    end of the slider of u, and its roots at u. The second shows the stability boundary, which is
    the critical speed against one of the numbers, and the present point. It shows no second range
    of stability above the critical speed, which `boundary` finds. The third picture shows the
    linear motion of the least stable mode, which grows or decays as the mode does. Its amplitude is
    chosen for the picture; `limit_cycle` computes the amplitude that flutter reaches.

    Args:
        pipe: the pipe at first; it must be able to rest straight.
        n: number of segments at first, up to 20.
        u: flow speed at first; 1.05 times the critical speed if not given.
        springs: rule for the springs, as for `Chain`.
        against: the number against which critical speeds are drawn; it must have a slider.
        ranges: ranges (low, high) of sliders by name, in place of the usual ones; a number of the
            pipe that is named here gets a slider.
        units: units of the pictures, "nondimensional", or "si" if the pipe has scales. Sliders show
            nondimensional numbers, and the sentences below the sliders both units.

    Returns:
        The widget, which Jupyter shows. Its attribute `exploration` is the `Exploration` with the
        present numbers, the model and its answers.

    Example:
        >>> plot.explore(pp.Pipe(0.2, gamma=10.0, damping=0.01))  # doctest: +SKIP

    Raises:
        ImportError: if ipywidgets, which is in the extra "notebook", is not installed.
        ValueError, TypeError: for bad arguments, as for `Exploration`.
    """
    try:
        import ipywidgets as widgets
    except ImportError as error:
        raise ImportError(
            'plot.explore needs ipywidgets, which the extra "notebook" brings: '
            "pip install pipedyn[notebook]"
        ) from error
    state = Exploration(pipe, n, u, springs=springs, against=against, ranges=ranges, units=units)
    cell = widgets.Layout(grid_area=SAME_PLACE, width="100%", margin="0")
    pixels = widgets.Image(format="png", layout=cell)
    moving = widgets.Image(format="svg+xml", layout=cell)
    text = widgets.HTML()

    def show(trouble: str = "") -> None:
        pixels.value, moving.value = state.picture.png(), state.picture.overlay().encode()
        text.value = _as_html(state, trouble)

    def follow(name: str, change: Mapping[str, Any]) -> None:
        try:
            state.set(name, change["new"])
            show()
        except (ValueError, PipedynError) as error:
            text.value = _as_html(state, f"No answer for {name} = {change['new']:g}: {error}")

    def control(name: str, low: float, high: float) -> Any:
        whole = name == "segments"
        made = (widgets.IntSlider if whole else widgets.FloatSlider)(
            int(state.values[name]) if whole else state.values[name],
            min=low,
            max=high,
            step=1 if whole else rounded_up((high - low) / STEPS),
            readout_format="d" if whole else ".4g",
            description=LABELS.get(name, name),
            style={"description_width": "105px"},
            layout=widgets.Layout(width="auto"),
        )
        made.observe(lambda change: follow(name, change), "value")
        return made

    show()
    columns = "repeat(auto-fill, minmax(270px, 1fr))"
    every = widgets.GridBox(
        [control(name, *ends) for name, ends in state.sliders.items()],
        layout=widgets.Layout(grid_template_columns=columns, width="100%"),
    )
    stack = widgets.GridBox([pixels, moving], layout=widgets.Layout(width="100%"))
    box = widgets.VBox([every, text, stack], layout=widgets.Layout(max_width="1060px"))
    box.exploration = state
    return box


def _as_html(state: Exploration, trouble: str) -> str:
    """The report of an exploration as HTML, with an error message if there is one."""
    now, then = (html.escape(one) for one in state.report)
    colour = common.VERMILION if state.unstable else common.GREEN
    said = f'<b style="color:{colour}">{now}</b><br>{then}'
    if trouble:
        said += f'<br><span style="color:{common.VERMILION}">{html.escape(trouble)}</span>'
    return f'<div style="line-height:1.35;padding:2px 0">{said}</div>'
