# SPDX-License-Identifier: MIT
"""Events and dense output of a motion, from the polynomials that interpolate its steps."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import scipy

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.chain import SpatialChain
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.result import Result, TableResult, states_over_time

EventFunction: TypeAlias = Callable[[float, Array, Array], float]
"""A function g(t, q, qdot) of time, coordinates and their rates, shape (coordinates,) each."""

PARTS = 4
"""Number of parts of a step at whose ends the signs of event functions are compared. If stability
limits the steps of an explicit method, four parts cover one period of the fastest mode."""

ROOT_TRIALS = 10_000
"""Largest number of iterations for the root of an event function g. If g is flat, as q^9 is,
Brent's method takes up to the square of the 50 evaluations that bisection takes."""


@dataclass(frozen=True)
class Event:
    """An event of a motion, which takes place when a function g(t, q, qdot) becomes 0.

    Attributes:
        function: the function g.
        direction: above 0 if only zeros with increasing g count, below 0 if only zeros with
            decreasing g count, 0 if both count.
        terminal: whether the motion ends at the event; or the number of events after which the
            motion ends, 0 for never.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), 5)
        >>> passes = pp.Event(lambda t, q, qdot: q[-1], direction=1)
        >>> motion = pp.simulate(chain, 6.0, 5.0, lambda s: 0.1 * s, events=passes)
        >>> motion.events[0].t[:2].round(3)
        array([0.441, 0.918])
    """

    function: EventFunction
    direction: float = 0.0
    terminal: bool | int = False


@saved_as("Occurrences")
class Occurrences(TableResult):
    """Times and states at which an event took place.

    Attributes:
        t: times in T, shape (k,).
        q, qdot: coordinates and their rates at the times t, shape (k, coordinates).
    """

    t: Array
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)

    def _columns(self) -> dict[str, Any]:
        return states_over_time(self.t, self.q, self.qdot)


@saved_as("DenseOutput")
class DenseOutput(Result):
    """The states of a motion at any time, from polynomials that interpolate the integrator's steps.

    Attributes:
        t: times at which steps begin and end, shape (steps + 1,).
        coefficients: coefficients of the powers of x = (t - t_i) / (t_{i+1} - t_i) in each step,
            shape (steps, degree + 1, 2 integrated); of a chain in three dimensions the signs of its
            segments' charts follow as constants, 1 or -1.
        model: the model that moves.
    """

    t: Array
    coefficients: Array = field(repr=False)
    model: Model

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> DenseOutput:
        """The dense output with the given fields; raises ValueError unless the times ascend."""
        made = cls(**fields)
        if not np.all(np.diff(made.t) > 0.0):
            raise ValueError("t of DenseOutput must ascend")
        return made

    def __call__(self, t: Any) -> Array:
        """States [q, q'] at one time, shape (2 coordinates,), or at k times, (2 coordinates, k).

        Raises ValueError for times outside the motion.
        """
        at = check.array("t", np.atleast_1d(t), low=float(self.t[0]), high=float(self.t[-1]))
        step = np.clip(np.searchsorted(self.t, at, "right") - 1, 0, len(self.coefficients) - 1)
        y = powers(self.coefficients[step], (at - self.t[step]) / np.diff(self.t)[step])
        states = np.concatenate(_recorded(self.model, y), axis=1)
        return np.asarray(states[0] if np.ndim(t) == 0 else states.T)


def _recorded(model: Model, states: Array) -> tuple[Array, Array]:
    """Coordinates and rates for users, (k, coordinates) each, of k integrated states.

    The rows of `states` begin with [p, p']; they may end with the signs of charts.
    """
    size = model.integrated
    found = states[:, : 2 * size]
    if isinstance(model, SpatialChain) and states.shape[1] > 2 * size:
        found = _core.in_first_chart(found, states[:, -(size // 2) :])
    return model.to_user(*np.split(found, 2, axis=1))


def powers(coefficients: Array, x: Array) -> Array:
    """Values of k polynomials at x, shape (k,): shape (k, rows), by Horner's rule.

    coefficients has the shape (k, degree + 1, rows), with the constant coefficients first.
    """
    value = coefficients[:, -1]
    for i in range(coefficients.shape[1] - 2, -1, -1):
        value = value * x[:, None] + coefficients[:, i]
    return np.asarray(value)


def checked_events(given: Any) -> tuple[Event, ...]:
    """Events from the argument `events`: an event or function, or a tuple or list of these.

    A function may have the attributes `direction` and `terminal`, as in scipy's `solve_ivp`.
    """
    events = []
    for i, one in enumerate(given if isinstance(given, tuple | list) else [given]):
        name = f"events[{i}]"
        if not isinstance(one, Event) and callable(one):
            options = {key: getattr(one, key, 0) for key in ("direction", "terminal")}
            one = Event(one, **options)
        if not isinstance(one, Event):
            message = f"{name} must be an Event or a function g(t, q, qdot)"
            raise TypeError(f"{message}, got {check.shown(one)}")
        if not callable(one.function):
            raise TypeError(f"{name}.function must be a function, got {check.shown(one.function)}")
        _require_arguments(name, one.function)
        direction = check.real(f"{name}.direction", one.direction)
        terminal = one.terminal
        if not isinstance(terminal, bool | np.bool_):
            terminal = check.count(f"{name}.terminal", terminal, low=0)
        events.append(Event(one.function, direction, int(terminal)))
    return tuple(events)


def _require_arguments(name: str, function: Callable[..., Any]) -> None:
    """Raises TypeError for a function without arguments (t, q, qdot), if Python knows them."""
    try:
        arguments = inspect.signature(function)
    except ValueError:
        return
    try:
        arguments.bind(0.0, None, None)
    except TypeError:
        raise TypeError(
            f"{name} must be called as {name}(t, q, qdot), got a function of {arguments}"
        ) from None


class Recorder:
    """Finds events in the steps of one motion as they are taken, and keeps steps for dense output.

    Args:
        model: the model that moves.
        events: events to search for.
        t: time at which the motion starts.
        state: state [p, p', W] at which the motion starts, shape (2 integrated + 1,).
        dense: whether to keep the steps.
    """

    def __init__(
        self, model: Model, events: Sequence[Event], t: float, state: Array, dense: bool
    ) -> None:
        self.model, self.events, self.dense = model, events, dense
        q, qdot = self._recorded(state[None, : 2 * model.integrated])
        self._last = [self._value(i, t, q[0], qdot[0]) for i in range(len(events))]
        self._found: list[list[tuple[float, Array, Array]]] = [[] for _ in events]
        self._ends, self._steps = [np.array([t])], list[Array]()
        self.kept = 0
        """Number of values that dense output and events hold so far."""

    def _recorded(self, states: Array) -> tuple[Array, Array]:
        """Coordinates and rates, (k, coordinates) each, of integrated states in the k rows."""
        return _recorded(self.model, states)

    def _value(self, i: int, t: float, q: Array, qdot: Array) -> float:
        """Value of the function of event i, checked to be a finite number."""
        value = self.events[i].function(t, q, qdot)
        if isinstance(value, float) and math.isfinite(value):
            return value
        return check.real(f"events[{i}](t, q, qdot)", value)

    def add(self, ends: Array, coefficients: Array) -> float | None:
        """Takes k steps and returns the time of the first terminal event in them, or None.

        The steps are given by the times at their ends, shape (k + 1,), and by coefficients as in
        `DenseOutput`, which also have an entry for the work W.
        """
        if not len(coefficients):  # no step was accepted
            return None
        last = self._search(ends, coefficients) if self.events else None
        if self.dense:
            self._ends.append(ends[1:])
            size = 2 * self.model.integrated
            parts = [coefficients[:, :, :size]]
            if isinstance(self.model, SpatialChain):
                parts.append(coefficients[:, :, size + 1 :])
            self._steps.append(np.concatenate(parts, axis=2))
            self.kept += coefficients.size
        return last

    def _search(self, ends: Array, coefficients: Array) -> float | None:
        """Records the events in some steps up to the first terminal event and returns its time."""
        steps = np.repeat(np.arange(len(coefficients)), PARTS)
        x = np.tile(np.arange(1, PARTS + 1) / PARTS, len(coefficients))
        t = (ends[steps] + x * (ends[steps + 1] - ends[steps])).tolist()
        q, qdot = self._recorded(powers(coefficients[steps], x))
        for k in range(steps.size):
            found = []
            for i, event in enumerate(self.events):
                before, value = self._last[i], self._value(i, t[k], q[k], qdot[k])
                rises, falls = before < 0.0 <= value, before > 0.0 >= value
                if (rises and event.direction >= 0.0) or (falls and event.direction <= 0.0):
                    step = steps[k]
                    found.append(self._locate(i, ends[step : step + 2], coefficients[step], x[k]))
                self._last[i] = value
            for i, at, place, rates in sorted(found, key=lambda one: one[1]):
                self._found[i].append((at, place, rates))
                self.kept += 2 * place.size
                if len(self._found[i]) == self.events[i].terminal:
                    return at
        return None

    def _locate(
        self, i: int, ends: Array, coefficients: Array, high: float
    ) -> tuple[int, float, Array, Array]:
        """Index i, time, q and q' of an event i in the part of a step that ends at x = high."""

        def state(x: float) -> tuple[float, Array, Array]:
            q, qdot = self._recorded(powers(coefficients[None], np.array([x])))
            return float(ends[0] + x * (ends[1] - ends[0])), q[0], qdot[0]

        def value(x: float) -> float:
            return self._value(i, *state(x))

        low = high - 1.0 / PARTS
        x, after = high, value(high)
        if after != 0.0 and (value(low) > 0.0) == (after > 0.0):
            x = low  # the event lies at the joint of two steps, within rounding
        elif after != 0.0:
            x = scipy.optimize.brentq(value, low, high, xtol=1e-15, rtol=1e-15, maxiter=ROOT_TRIALS)
        return i, *state(x)

    def occurrences(self) -> tuple[Occurrences, ...]:
        """Times and states found for each event, in the order of the events."""
        c = self.model.coordinates
        return tuple(
            Occurrences(
                np.array([t for t, _, _ in each]),
                np.array([q for _, q, _ in each]).reshape(-1, c),
                np.array([rates for _, _, rates in each]).reshape(-1, c),
            )
            for each in self._found
        )

    def output(self, end: float) -> DenseOutput | None:
        """Dense output up to a given time; None if it was not asked for or no step was taken."""
        if not self._steps:
            return None
        t, coefficients = np.concatenate(self._ends), np.concatenate(self._steps)
        count = min(int(np.searchsorted(t, end)), len(coefficients))
        t, coefficients = t[: count + 1], coefficients[:count]
        if end < t[-1]:  # the last step contains the given time and is cut there
            share = (end - t[-2]) / (t[-1] - t[-2])
            coefficients[-1] *= share ** np.arange(coefficients.shape[1])[:, None]
            t[-1] = end
        return DenseOutput(t, coefficients, self.model)
