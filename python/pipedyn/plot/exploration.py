# SPDX-License-Identifier: MIT
"""The state behind `plot.explore`: a pipe whose numbers can be set, and the answers for it.

This module needs no notebook. The answers are those of public functions: `root_loci`, `modes` and
`critical_speed` of a chain, and `stability_curve` against one of the numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pipedyn.linear.critical_speed import (
    CriticalSpeed,
    NoCrossing,
    critical_speed,
    crossings,
    stability_losses,
    stable_speeds,
)
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.modes import ModeShape, RootLoci, modes, root_loci
from pipedyn.linear.neutral import grows, growth
from pipedyn.linear.stability_curve import StabilityCurve, stability_curve
from pipedyn.models.chain import Chain
from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.models.pipe_numbers import PipeNumber, checked_number, pipe_numbers
from pipedyn.plot.common import rounded_up
from pipedyn.plot.exploration_picture import CYCLES, ExplorationPicture
from pipedyn.plot.units import Units, View
from pipedyn.util import check
from pipedyn.util.check import Array

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

FRAMES = 16
"""Number of frames in each cycle of the mode in a film. Straight lines between frames differ from
the motion by 2 % of the amplitude."""

SWING, STEEPEST = 0.25, 0.7
"""Largest displacement in a film, in L, and largest slope. A linear mode has no amplitude of its
own, so it is scaled until it meets one of them."""


@dataclass(frozen=True)
class Slider:
    """A number that is set by a slider.

    Attributes:
        name: "u", "segments", or the name of a number of the pipe.
        low, high: the range of the number.
    """

    name: str
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class ModeFilm:
    """The linear motion of one mode.

    Attributes:
        shapes: centrelines, x transverse and y along the straight pipe, shape (frames, points, 2).
        duration: time from the first frame to the last, in T.
    """

    shapes: Array
    duration: float


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
        sliders: numbers that can be set: "u", "beta", "gamma", "damping", "segments", the stiffness
            of a spring at the root, numbers of the terms, and all other numbers of the pipe that
            have no default or are not at their default.
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
        if pipe.jet_angle:
            raise ValueError(
                "pipe must rest straight: its small motions about that are shown, got "
                f"jet_angle = {pipe.jet_angle:g}"
            )
        self._pipe, self._springs = pipe, springs
        model = Chain(pipe, n, springs=springs)
        given = _checked_ranges(ranges, pipe)
        self._numbers = _turnable(pipe, given)
        own = {name: number.of(pipe) for name, number in self._numbers.items()}
        self.critical = _loss(model)
        if u is None:
            u = 4.0 if self.critical is None else 1.05 * self.critical.speed
        u = check.real("u", u, low=0.0, high=1e3)
        always = {name: own[name] for name in ALWAYS if name in own}
        self.values: dict[str, float] = {"u": u, **always, "segments": float(n)} | own
        self.sliders = tuple(self._slider(name, given) for name in self.values)
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
        slider = self.slider(name)
        if name == "segments":
            value = check.count(name, value, low=round(slider.low), high=round(slider.high))
        value = check.real(name, value, low=slider.low, high=slider.high)
        if value == self.values[name]:
            return
        values = self.values | {name: value}
        if name != "u":
            pipe = self._pipe
            for turned, number in self._numbers.items():
                if values[turned] != number.of(self._pipe):
                    pipe = number.changed(pipe, values[turned])
            model = Chain(pipe, round(values["segments"]), springs=self._springs)
            critical = _loss(model)
            curve = self.curve if name == self.against else self._curve_of(model)
            self.model, self.critical, self.curve = model, critical, curve
        self.values = values
        # Answers are computed again when they are used; two of them do not depend on u.
        for one in ("modes", "film", *(("loci", "stable_speeds") if name != "u" else ())):
            self.__dict__.pop(one, None)

    def slider(self, name: str) -> Slider:
        """The slider of a name; raises ValueError or TypeError if there is none."""
        check.choice("name", name, tuple(one.name for one in self.sliders))
        return next(one for one in self.sliders if one.name == name)

    def _slider(self, name: str, given: Mapping[str, tuple[float, float]]) -> Slider:
        value = self.values[name]
        if name in given:
            low, high = given[name]
            if not low <= value <= high:
                raise ValueError(
                    f"ranges[{name!r}] must hold the value at first, {value:g}, got "
                    f"({low:g}, {high:g})"
                )
            return Slider(name, low, high)
        if name == "u":
            critical = self.critical
            lost = 4.0 if critical is None or critical.unstable_before else 1.2 * critical.speed
            return Slider(name, 0.0, rounded_up(1.4 * max(value, lost)))
        if name == "segments":
            return Slider(name, 1.0, MOST_SEGMENTS)
        rule = self._numbers[name].rule
        usual = OWN_NUMBERS[name].slider if name in OWN_NUMBERS else None
        low, high = usual or (0.0, 0.0 if value else 1.0)
        if value > high:
            high = rounded_up(2.0 * value)
        elif value < low:
            low = -rounded_up(-2.0 * value)
        below, above = rule.get("low", -math.inf), rule.get("high", math.inf)
        high = min(high, 0.999 if name == "beta" else above)
        return Slider(name, max(low, below), high)

    # ------------------------------------------------------------------------------- answers

    @cached_property
    def loci(self) -> RootLoci:
        """Branches of eigenvalues up to the end of the slider of u."""
        return root_loci(self.model, np.linspace(0.0, self.slider("u").high, LOCI_SPEEDS))

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
    def film(self) -> ModeFilm:
        """Linear motion of the least stable mode over three cycles.

        The motion grows or decays as the mode does, by a factor exp(3) if the mode does not
        oscillate. The motion is scaled so that the largest displacement is 0.25 L or the largest
        slope 0.7. Transverse displacements are those of the mode; the position along the pipe
        follows from its constant length.
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
        return ModeFilm(np.stack([across, down], axis=-1), duration)

    @property
    def report(self) -> tuple[str, str]:
        """Two sentences: on stability at the flow speed, and on the range of stable speeds."""
        value = self.least_stable.eigenvalue
        kind = "flutter" if value.imag else "divergence"
        state = f"unstable, {kind} grows" if self.unstable else "stable"
        pair = f" ± {value.imag:.4g}i" if value.imag else ""
        now = f"u = {self._said(self.values['u'])}: {state}"
        return f"{now}. Least stable mode: λ = {value.real:.3g}{pair}.", self._stability()

    def _said(self, u: float) -> str:
        """A flow speed in words, also in m/s if the pipe has scales."""
        pipe = self.model.pipe
        return f"{u:.4g} ({pipe.speed_si(u):.3g} m/s)" if pipe.scales else f"{u:.4g}"

    def _stability(self) -> str:
        """A sentence on the flow speeds at which the pipe is stable, and how it loses stability."""
        lost, end = self.critical, MAX_SPEED
        if lost is None and stable_speeds(self.model, (), end):
            return f"No loss of stability up to u = {end:g}."
        if lost is None or lost.stable_from is None:
            end = MAX_SPEED if lost is None else self.slider("u").high
            ranges = stable_speeds(self.model, crossings(self.model, end), end)
            parts = [f"from u = {self._said(low)} to {self._said(high)}" for low, high in ranges]
            if not parts:
                return f"Unstable at every flow speed up to u = {self._said(end)}."
            return f"Up to u = {self._said(end)} stable only {' and '.join(parts)}."
        begins = f"{lost.kind} begins at u = {self._said(lost.speed)}, mode {lost.mode}"
        if lost.stable_from:
            begins = f"stable from u = {self._said(lost.stable_from)} on; {begins}"
        if lost.frequency:
            begins += f", frequency {lost.frequency:.4g}"
            if self.model.pipe.scales:
                begins += f" ({lost.in_si().frequency:.3g} Hz)"
        return f"{begins[0].upper()}{begins[1:]}."

    # ---------------------------------------------------------------------- stability curve

    def _curve_of(self, model: Chain) -> StabilityCurve:
        slider = self.slider(self.against)
        number = self._numbers[self.against]
        points = next(points for most, points in FINENESS if model.lengths.size <= most)
        values = np.linspace(slider.low, slider.high, points)
        return stability_curve(
            lambda value: model.with_pipe(number.changed(model.pipe, value)), values
        )

    @cached_property
    def stable_speeds(self) -> Array:
        """Ends of the lowest range of stable speeds at each value of the curve, shape (S, 2).

        The lower end is 0, except for a pipe that is buckled without flow and that the flow
        straightens. The upper end is infinite if stability is not lost up to u = 100. Both are NaN
        if there is no stable range up to the end of the slider of u, or if the point failed.
        """
        curve, end = self.curve, self.slider("u").high
        found, again = np.full((curve.values.size, 2), np.nan), list[int]()
        never_lost = np.isfinite(curve.no_loss_up_to)
        for i, critical in enumerate(curve.critical):
            if critical is not None and critical.stable_from is not None:
                found[i] = critical.stable_from, critical.speed
            elif critical is not None or never_lost[i]:
                again.append(i)
        number = self._numbers[self.against]
        pipes = [number.changed(self.model.pipe, float(curve.values[i])) for i in again]
        models = [self.model.with_pipe(pipe) for pipe in pipes]
        for i, model, answer in zip(again, models, stability_losses(models, end), strict=True):
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


def _loss(model: Chain) -> CriticalSpeed | None:
    try:
        return critical_speed(model, MAX_SPEED)
    except NoCrossing:
        return None


def _checked_ranges(ranges: Any, pipe: Pipe) -> dict[str, tuple[float, float]]:
    """Checks the argument `ranges`: each range must lie within the values its number may have."""
    if ranges is None:
        return {}
    check.instance("ranges", ranges, Mapping)
    own = {"u": {"low": 0.0, "high": 1e3}, "segments": {"low": 1.0, "high": float(MOST_SEGMENTS)}}
    found = {}
    for name in ranges:
        if name not in own:
            own[name] = checked_number("a name in ranges", name, pipe, others=tuple(own)).rule
        found[name] = check.interval(f"ranges[{name!r}]", ranges[name], **own[name])
    return found


def _turnable(pipe: Pipe, given: Mapping[str, Any]) -> dict[str, PipeNumber]:
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
        if name in given or name in ALWAYS or not usual:
            found[name] = number
    return found
