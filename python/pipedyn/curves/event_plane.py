# SPDX-License-Identifier: MIT
"""Plane of two numbers in which an event of cycles is followed: names, ranges and motions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from pipedyn.cycles.branches import CycleBranch, CycleEvent
from pipedyn.cycles.limit_cycle import amplitude_of
from pipedyn.forced.forced_response import ForcedBranch, ForcedEvent
from pipedyn.linear.modes import largest_speed
from pipedyn.models.base import Model
from pipedyn.models.drive import Pulsation
from pipedyn.models.pipe_numbers import PipeNumber, checked_number
from pipedyn.motion.vector_field import ForcedField, VectorField
from pipedyn.orbits.orbit_continuation import FINE, orbit_at
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, resolved_orbit
from pipedyn.util import check
from pipedyn.util.check import Array

Followed = Literal["fold", "pitchfork", "period doubling", "torus"]
"""Events that are followed in two parameters."""

EVENTS: tuple[Followed, ...] = get_args(Followed)
"""Kinds of events that are followed, in the order in which they are named together."""

FORCINGS = "amplitude", "u"
"""Numbers of a forced motion other than its frequency that are not numbers of the pipe."""


def checked_branch_events(
    branch: CycleBranch | ForcedBranch, events: Any
) -> list[CycleEvent | ForcedEvent]:
    """The events of a branch that a user gave, as a list.

    Raises:
        ValueError, TypeError: if one is not an event of this branch, or of a kind that is not
            followed.
    """
    kind = CycleEvent if isinstance(branch, CycleBranch) else ForcedEvent
    given = [events] if isinstance(events, CycleEvent | ForcedEvent) else events
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        raise TypeError(f"events must be one or more events, got {check.shown(events)}")
    for event in given:
        check.instance("events", event, kind, f"{kind.__name__}s")
        if event.kind not in EVENTS:
            raise ValueError(f"events must be of kind {', '.join(EVENTS)}, got {event.kind!r}")
        if event not in branch.events:
            raise ValueError(f"events must be the branch's, got {check.shown(event)}")
    return list(given)


@dataclass(frozen=True)
class EventPlane:
    """Plane of the branch parameter and a second number, with the equations of motion in it.

    Attributes:
        make: function that returns the equations at a value of the second number; it raises
            ValueError where there are none.
        names: names of x and y.
        model: the model of the branch.
        value: the second number's value on the branch.
        ranges: ranges of x and y.
        forced: whether motions are forced; then the branch parameter is the frequency, else u.
        order: number of periods of the forcing in one period of the motion, 1 for cycles.
    """

    make: Callable[[float], VectorField]
    names: tuple[str, str]
    model: Model
    value: float
    ranges: tuple[tuple[float, float], tuple[float, float]]
    forced: bool = False
    order: int = 1
    _motions: dict[float, VectorField] = field(default_factory=dict)

    @cached_property
    def second(self) -> int:
        """Index of the second number, 0 where it is x and 1 where it is y."""
        return int(self.names[0] == ("frequency" if self.forced else "u"))

    @property
    def width(self) -> float:
        """Width of the second number's range.

        A change by this width is as long as a change of the free end's position by L.
        """
        low, high = self.ranges[self.second]
        return high - low

    @property
    def is_speed(self) -> bool:
        """Whether the second number is the flow speed of a forced motion."""
        return self.forced and self.names[self.second] == "u"

    def at(self, value: float) -> VectorField:
        """Equations of motion at a value of the second number; ValueError where there are none."""
        if value not in self._motions:
            self._motions[value] = self.make(value)
        return self._motions[value]

    def places(self, second: float, own: float) -> tuple[float, float]:
        """Values (x, y) at values of the second number and of the branch parameter."""
        return (own, second) if self.second else (second, own)

    def evaluations(self) -> int:
        """Number of right-hand sides and Jacobians computed so far."""
        return sum(motion.evaluations for motion in self._motions.values())


def plane_of(branch: CycleBranch | ForcedBranch, x: Any, y: Any, given: Any) -> EventPlane:
    """The plane of a branch, with names of x and y and with ranges that a user gave.

    Raises:
        ValueError, TypeError: unless exactly one of x and y names the branch parameter and the
            other one a number, and for bad ranges.
    """
    for argument, value in (("x", x), ("y", y)):
        check.instance(argument, value, str, "a name")
    own = "u" if isinstance(branch, CycleBranch) else "frequency"
    if (x == own) == (y == own):
        raise ValueError(
            f"x or y must be {own!r}, and the other not, got {check.shown(x)} and {check.shown(y)}"
        )
    names, place = (x, y), int(x == own)
    name = names[place]
    based = branch.motion if isinstance(branch, ForcedBranch) else None
    forced, order = based is not None, 1 if based is None else based.order
    model = branch.cycles[0].model if isinstance(branch, CycleBranch) else branch.motion.model
    others: tuple[str, ...] = (own, *FORCINGS) if forced else (own,)
    number: PipeNumber | None = None
    if not forced or name not in FORCINGS:
        number = checked_number("xy"[place], name, model.pipe, True, others)
    rule: dict[str, Any] = {"low": 0.0, "high": largest_speed(model)}
    if name == "amplitude":
        rule = {"low": 0.0}
    elif number is not None:
        rule = dict(number.rule)
    varies: dict[str, Any] = {"low": 0.0, "open_low": forced}
    if not forced:
        varies["high"] = largest_speed(model)
    ranges = check.window(names, given, (rule, varies) if place == 0 else (varies, rule))

    def make(value: float) -> VectorField:
        varied = model if number is None else model.with_pipe(number.changed(model.pipe, value))
        if based is None:
            return VectorField(varied)
        forcing = based.forcing
        if name == "amplitude":
            forcing = replace(forcing, amplitude=value)
        return ForcedField(varied, forcing, order)

    if number is not None:
        value = number.of(model.pipe)
    elif isinstance(branch, ForcedBranch):
        forcing = branch.motion.forcing
        value = forcing.amplitude
        if name == "u":
            constant = branch.steps[0].problem.start.u
            value = forcing.mean if isinstance(forcing, Pulsation) else constant
    for end in ranges[place]:
        try:
            make(end)
        except ValueError as error:
            raise ValueError(f"ranges[{name!r}] must be a range of pipes: {error}") from None
    return EventPlane(make, names, model, value, ranges, forced, order)


def orbit_at_event(
    branch: CycleBranch | ForcedBranch, event: Any, motion: VectorField
) -> PeriodicOrbit:
    """An orbit near the orbit at an event, from the nearest known orbit of the branch.

    At a symmetry-breaking pitchfork an orbit without the symmetry is made its own mirror image. At
    a period doubling at which the branch begins or ends, the orbit gets half the period.
    """
    orbit = _nearest_orbit(branch, event)
    begins = ends = False
    if isinstance(event, CycleEvent) and isinstance(branch, CycleBranch):
        begins = event.kind == branch.origin and event.speed == branch.onset
        ends = event.multiplier == 1.0  # the multiplier is -1 at a doubling that the branch passes

    def mean(sign: float, turns: int, symmetric: bool) -> PeriodicOrbit:
        """The mean of the orbit and of `sign` times the orbit half a period later."""

        def states(phase: Array) -> Array:
            early, late = (np.mod(phase / turns + s, 2.0 * math.pi) for s in (0.0, math.pi))
            return 0.5 * (orbit.states(early) + sign * orbit.states(late))

        u = orbit.u if orbit.forced else event.speed
        return resolved_orbit(motion, states, turns * orbit.frequency, u, symmetric, FINE.defect)

    if event.kind == "pitchfork" and not orbit.symmetric:
        return mean(-1.0, 1, True)
    if event.kind == "period doubling" and (begins or ends):
        return mean(1.0, 2, False)
    return orbit


def _nearest_orbit(branch: CycleBranch | ForcedBranch, event: Any) -> PeriodicOrbit:
    """The known orbit of the branch that is nearest to an event.

    The distance is the sum of relative differences of the branch parameter and of the amplitude.
    """
    if isinstance(branch, CycleBranch):
        apart = np.abs(branch.speeds / event.speed - 1.0)
        apart += np.abs(branch.amplitudes / event.amplitude - 1.0)
        return branch.cycles[int(np.argmin(apart))].orbit
    motion, distance = branch.motion, math.inf
    nearest = branch.steps[0], 0.0
    for step in branch.steps:
        low, high = sorted((step.begin.p, step.end.p))
        margin = 0.5 * (high - low) + 1e-3 * high
        if not low - margin <= event.frequency / motion.order <= high + margin:
            continue
        for s in np.linspace(0.0, step.length, 17).tolist():
            orbit = step.problem.orbit(step.guess(s))
            away = abs(motion.order * orbit.frequency / event.frequency - 1.0)
            away += abs(amplitude_of(motion, orbit)[0] / event.amplitude - 1.0)
            if away < distance:
                nearest, distance = (step, s), away
    return orbit_at(*nearest)
