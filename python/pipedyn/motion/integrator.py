# SPDX-License-Identifier: MIT
"""Integrators of the core and of scipy: they are chosen, run and stopped here."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipedyn import _core
from pipedyn.models.base import LARGEST_ANGLE, Model
from pipedyn.models.drive import Base, Drive, DriveFailed, Force, Speed
from pipedyn.motion.constant_head import ConstantHead
from pipedyn.motion.events import Recorder
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import check_time, count_factorisations, count_right_hand_sides
from pipedyn.util.errors import NotResolved
from pipedyn.util.parallel import track
from pipedyn.util.power_iteration import largest_stretch

NOT_FINITE = "the state or its rate is no longer finite"
"""Why a motion stops if numbers overflow, or a bend is too sharp for a quadrature to resolve."""

CORE = ("dop853", "radau")
"""Methods that are compiled in the core."""

Method = Literal[
    "auto", "dop853", "radau", "scipy:DOP853", "scipy:Radau", "scipy:BDF", "scipy:LSODA"
]
METHODS: tuple[Method, ...] = get_args(Method)
"""All methods: those of the core and those of `scipy.integrate.solve_ivp`."""

EARLY_ENDS = {"not finite": NOT_FINITE, "vanishing": "its step size tends to 0"}
"""Reason why a motion in the core stopped before its end, for each value of `Member.progress`."""

AHEAD = 0.0, 0.125, 0.25, 0.5, 1.0, 2.0
"""Times ahead of the last state, in samples, at which states that are not resolved are searched."""

FORECAST = 400
"""Number of right-hand sides after which the number still needed is estimated. The estimate itself
takes 40 to 120."""

CALLS, JACOBIAN_CALLS = 20_000, 20
"""Number of right-hand sides between two checks of progress, which makes the cost of a check
negligible; and the number that a Jacobian with its factorisation counts as."""

LEAST_STEP = 2e-5
"""Least time that a right-hand side must cover on average, as a share of the time scale of the
fastest mode. Methods that make progress cover 0.02 and more; if less than LEAST_STEP is covered,
the step size tends to 0."""

CALLS_A_RATE = 1.5
"""Least number of right-hand sides of an explicit method in the time 1 / |lambda| of the fastest
mode: measured at rtol 1e-6, 1.6 with damping to 16 without."""

STAGES, MOST_EXCESS = 8, 100.0
"""Number of right-hand sides in an iteration of an implicit step; and the multiple of the allowed
number of right-hand sides at which a motion is given up, if it would need more than that at its
present step size. Steps grow when fast modes decay: measured, up to 50 times."""

MOST_CALLS = 1e8
"""Default of the largest number of right-hand sides of a motion. They take minutes with few
segments and an hour with 1000."""

BATCHED, BATCH_DECAY = 8, 2.0
"""Number of members from which explicit steps of a batch are cheaper than implicit steps of one
member after the other, for models of any size; and the ratio of fastest decay to highest frequency
above which implicit steps are cheaper nevertheless. Both are measured, see `choose_method`."""

LARGEST_IMPLICIT = 1000
"""Largest number of degrees of freedom for which methods with dense factorisations are chosen. Four
complex factorisations of 2,001 unknowns take 256 MB and about 15 s on one core, extrapolated from
1.8 s measured with half as many unknowns."""

LEAST_FLOW = 1e-9
"""Flow speed at constant head below which a motion ends, since its flow is about to reverse."""

LARGEST_KEPT = 100_000_000
"""Largest number of values that dense output and events may hold: 0.8 GB."""

CALL_AGAIN = 0.05
"""Least time in seconds between two calls of the callback of a motion."""


@saved_as("Stopped")
class Stopped(Exception):
    """An integration stopped early; the message gives the reason."""


def _too_many_calls(most: float) -> str:
    """Message for a motion that needs more right-hand sides than `most`."""
    return f"it needs more than {most:g} right-hand sides: give `simulate` more as `most=`"


@dataclass(frozen=True)
class Task:
    """A motion to be integrated."""

    model: Model
    u: Speed
    times: Array  # times of the samples, shape (S,)
    start: Array  # [p, p'], or [p, p', 0] with the work W; or [p, p', 0, u] at constant head
    rtol: float
    atol: float | Array  # one number for all entries of a state, or one for each entry
    method: str  # one of METHODS, but not "auto"
    t0: float = 0.0
    end: float = 0.0  # time at which the motion ends at the latest
    most: float = MOST_CALLS
    max_step: float = math.inf
    drive: Drive | None = None  # forcing if the flow speed changes or the base moves
    base: Base | None = None  # motion of the base, as it was given
    forces: tuple[Force, ...] = ()  # which act on the model, see `Model.with_applied`
    constant_head: ConstantHead | None = None  # equations if u is the last entry of the state
    finer: int = 1  # number of computed samples for each sample that was asked for
    farthest: float = LARGEST_ANGLE  # largest coordinate at which the motion goes on

    def flow(self, t: float) -> tuple[Any, ...]:
        """The flow speed at a time and, if the motion is forced, the forcing, see `Drive`.

        The speed is given as 0 if it is part of the state.
        """
        if self.drive is None:
            return (0.0 if self.constant_head else self.u,)
        u, *others = self.drive(t)
        return (u, np.array(others)) if any(others) else (u,)

    def rates(self, t: float, y: Array) -> Array:
        """Rates of a state [p, p'], [p, p', W] or [p, p', W, u] at time t."""
        u, *drive = self.flow(t)
        if self.constant_head is not None:
            return self.constant_head.rates(y, *drive)
        return self.model.motion_rates(y, u, drive[0] if drive else None, t)

    def jacobian(self, t: float, y: Array, u: float, drive: Array | None = None) -> Array:
        """Derivative of the rates by the state at a flow speed and forcing.

        The column of W is 0, since no rate depends on the work. The row of W is left 0, since
        Newton's method does not need it.
        """
        size = 2 * self.model.integrated
        others = np.flatnonzero(np.arange(y.size) != size)
        if self.constant_head is not None:
            slopes = self.constant_head.jacobian(y[others], drive)
        else:
            slopes = self.model.motion_jacobian(y[others], u, drive)
        whole = np.zeros((y.size, y.size))
        whole[np.ix_(others, others)] = slopes
        return whole


Callback: TypeAlias = Callable[[float, Array, Array], object]
"""A function of time, coordinates and rates; if it returns True, the motion ends there."""

Outcome: TypeAlias = tuple[Array, int, str | None]
"""Start and samples of a motion, shape (1 + S, size of a state), the number of right-hand sides
evaluated, and the reason why the motion stopped early, or None."""


class Monitor:
    """Stops a task that needs too many right-hand sides, and counts the calls by scipy.

    Attributes:
        calls, jacobians, factorisations: numbers of right-hand sides, Jacobians, factorisations.
        overflowed: whether a state was not finite; its rates are NaN, which shortens the step.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.calls = self.jacobians = self.factorisations = 0
        self.next_check, self.reached = CALLS if task.method == "radau" else FORECAST, -math.inf
        self.overflowed = False

    def rates(self, t: float, y: Array) -> Array:
        """Rates of a state of the task; raises `Stopped` if too many calls are needed."""
        if self.calls >= self.next_check:
            self.check(t)
        if self.calls >= self.task.most:
            raise Stopped(_too_many_calls(self.task.most))
        self.calls += 1
        try:
            found = self.task.rates(t, y)
        except ValueError:
            found = np.full(y.shape, np.nan)
        self.overflowed |= not np.isfinite(found).all()
        return found

    def jacobian(self, t: float, y: Array) -> Array:
        """Derivative of the rates by the state; the row of W is 0."""
        self.jacobians += 1
        self.factorisations += 1
        self.next_check -= JACOBIAN_CALLS
        flow = self.task.flow(t)
        try:
            return self.task.jacobian(t, y, *flow)
        except ValueError:
            self.overflowed = True
            return np.zeros((y.size, y.size))

    @cached_property
    def fastest(self) -> tuple[float, float]:
        """Highest frequency and fastest decay at rest, computed for the first check of progress."""
        return fastest_rates(self.task.model)

    def check(self, t: float) -> None:
        """Raises `Stopped` if the task needs too many calls or its steps vanish."""
        check_time()
        task, fastest = self.task, max(self.fastest)
        remaining, least, needed, why = float(task.times[-1]) - t, LEAST_STEP, 0.0, ""
        if task.method.lower().endswith("dop853"):
            needed = CALLS_A_RATE * fastest * remaining
            why = f"its fastest mode has |lambda| = {fastest:.2g}"
        elif task.method == "radau":
            least /= STAGES
            covered = t - max(self.reached, task.t0)
            ahead = CALLS * remaining / max(covered, 1e-300)
            needed = ahead if ahead > MOST_EXCESS * task.most else 0.0
            why = f"its steps follow modes up to |lambda| = {fastest:.2g}"
        if self.calls + needed > task.most:
            raise Stopped(
                f"it needs {needed:.1g} right-hand sides or more and may take {task.most:g}"
                f" at most: {why}"
            )
        rotation = float(np.abs(task.start).max())
        speed = task.flow(t)[0] if task.constant_head is None else task.constant_head.largest_speed
        rate = sum(self.fastest) + speed**2 + rotation + 1.0
        if t - self.reached < least * CALLS / rate:
            raise Stopped("its step size tends to 0")
        self.next_check, self.reached = self.calls + CALLS, t


class Observer:
    """Follows a motion while it is integrated: passes steps to a recorder and calls a callback.

    Args:
        recorder: recorder of events and dense output; None if neither is asked for.
        callback: function of a time and of q and q' at that time, shape (coordinates,) each; if it
            returns True, the motion ends there.
    """

    def __init__(self, recorder: Recorder | None = None, callback: Callback | None = None) -> None:
        self.recorder, self.callback = recorder, callback
        self.end: float | None = None
        """Time at which an event or the callback ended the motion, None if neither did."""
        self.stretch = CALLS
        """Largest number of right-hand sides of a member between two calls of `ended`."""
        self._called = -math.inf

    def ended(self, states: Array, samples: Array) -> Iterable[int]:
        """Indices of the members of a batch whose motions may end, judging by their samples.

        states has the shape (members, S, rows); its first samples[j] rows of member j are computed.
        """
        return ()

    def steps(self, ends: ArrayLike, coefficients: ArrayLike) -> None:
        """Passes steps of the motion to the recorder, in the form that `Recorder.add` takes."""
        if self.recorder is not None:
            self.end = self.recorder.add(np.array(ends), np.array(coefficients))
            if self.recorder.kept > LARGEST_KEPT:
                many = f"more than {LARGEST_KEPT:.0e} numbers"
                raise Stopped(f"its dense output and events would take {many}")

    def call(self, task: Task, t: float, state: Array) -> None:
        """Calls the callback, if the last call was CALL_AGAIN seconds ago or more."""
        if self.callback is None or self.end is not None:
            return
        if time.monotonic() < self._called + CALL_AGAIN:
            return
        size = task.model.integrated
        q, rates = task.model.to_user(state[None, :size], state[None, size : 2 * size])
        if self.callback(t, q[0], rates[0]):
            self.end = t
        self._called = time.monotonic()


def integrate(tasks: Sequence[Task], shown: bool, observer: Observer) -> list[Outcome]:
    """Outcome of each task. Several tasks must have the same model and a method of the core."""
    of_task = _in_core if tasks[0].method in CORE else _of_one
    found = of_task(tasks, shown, observer)
    return [_while_resolved(task, one) for task, one in zip(tasks, found, strict=True)]


def _while_resolved(task: Task, outcome: Outcome) -> Outcome:
    """The outcome, cut before the first state whose coordinates are too large, with the reason."""
    rows, evaluations, why = outcome
    coordinates = rows[1:, : task.model.integrated]
    if max(coordinates.max(initial=0.0), -coordinates.min(initial=0.0)) <= task.farthest:
        return outcome if why != NOT_FINITE else (rows, evaluations, why + _unresolved(task, rows))
    beyond = np.abs(coordinates).max(axis=1) > task.farthest
    return rows[: int(np.argmax(beyond)) + 1], evaluations, _wound_up(task)


def _unresolved(task: Task, rows: Array) -> str:
    """What the model says of the first state ahead of the last one that it does not resolve.

    The motion is extrapolated over two samples. The result is empty if all states are resolved.
    """
    model, size = task.model, task.model.integrated
    times = np.append(task.t0, task.times)[: len(rows) + 1][-2:]
    q, rates = rows[-1, :size], rows[-1, size : 2 * size]
    for share in AHEAD if size == model.coordinates else ():
        try:
            model.equations.rhs(0.0, np.append(q + share * np.diff(times) * rates, rates), 0.0)
        except NotResolved as error:
            return f": {'ahead of it, ' * (share > 0.0)}{str(error).partition(' because ')[2]}"
    return ""


def _wound_up(task: Task) -> str:
    """Message for a motion whose coordinates grow beyond the limit of its task."""
    return f"its coordinates grow beyond {task.farthest:g}"


def _of_one(tasks: Sequence[Task], shown: bool, observer: Observer) -> list[Outcome]:
    """Outcome of one task by a method of scipy."""
    [task] = tasks
    monitor = Monitor(task)
    samples = track(_by_scipy(task, monitor), task.times.size, "motion", shown)
    rows, why = [task.start], None
    try:
        for row, t in zip(samples, task.times, strict=True):
            rows.append(row)
            observer.call(task, float(t), row)
            if observer.end is not None:
                break
    except DriveFailed as failed:
        why = str(failed)
    except Stopped as stopped:
        why = NOT_FINITE if monitor.overflowed else str(stopped)
    count_right_hand_sides(monitor.calls + monitor.jacobians)
    count_factorisations(monitor.factorisations)
    return [(np.array(rows), monitor.calls, why)]


def _in_core(tasks: Sequence[Task], shown: bool, observer: Observer) -> list[Outcome]:
    """Outcome of each task by a method of the core; each task takes steps of its own."""
    first, members = tasks[0], len(tasks)
    model = first.model
    u: object = np.zeros(members) if first.constant_head else np.array([task.u for task in tasks])
    if first.drive is not None:
        u = first.drive if first.drive.numbers is None else first.drive.numbers
    start = np.stack([task.start for task in tasks], axis=1)
    rtol = np.array([task.rtol for task in tasks])
    atol = np.empty_like(start)
    for j, task in enumerate(tasks):
        atol[:, j] = task.atol
    motion = _core.Integrator(
        *(model.core, u, start, first.t0, rtol, atol, first.most, first.max_step),
        None if first.method == "dop853" else first.jacobian,
        None if first.constant_head is None else first.constant_head.core,
        _stops(first),
    )
    monitors = [Monitor(task) for task in tasks]
    times, count = first.times, first.times.size
    if observer.recorder is not None and times[-1] < first.end:
        times = np.append(times, first.end)  # events are searched up to the end of the motion
    every = np.empty((1 + members * times.size, len(start)))  # the start before all samples
    states = every[1:].reshape(members, times.size, -1)
    whys: list[str | None] = [None] * members
    left = set[int]()  # members whose motion the observer has ended

    def reached() -> Iterator[int]:
        """Yields the index of each sample once all members have it or have ended, if `shown`."""
        done, finished, allowed = 0, False, min(FORECAST, observer.stretch)
        while not finished and observer.end is None:
            follows = observer.recorder is not None
            try:
                finished, ends, steps = motion.advance(times, states, allowed, follows)
                observer.steps(ends, steps)
            except (Stopped, DriveFailed) as stopped:
                whys[:] = [str(stopped)] * members
                return
            check_time()
            now = motion.members
            samples = np.array([member.samples for member in now])
            for j in observer.ended(states, samples):
                motion.stop(j)
                left.add(j)
            going = [j for j, member in enumerate(now) if member.progress == "going"]
            going = [j for j in going if j not in left]
            last = np.abs(states[np.arange(members), samples - 1, : model.integrated]).max(axis=1)
            for j in going:
                if samples[j] and last[j] > first.farthest:
                    whys[j] = _wound_up(first)
                    motion.stop(j)
            going = [j for j in going if whys[j] is None]
            if going:
                slowest = min(going, key=lambda j: now[j].time)
                at, monitor = now[slowest].time, monitors[slowest]
                monitor.calls = now[slowest].evaluations
                try:
                    if monitor.calls >= monitor.next_check:
                        monitor.check(at)
                except Stopped as stopped:
                    whys[slowest] = str(stopped)
                    motion.stop(slowest)
                else:
                    observer.call(first, at, motion.state(slowest))
                allowed = max(1, min(monitor.next_check - monitor.calls, observer.stretch))
            until = min((now[j].samples for j in going), default=count)
            until = min(until, count) // first.finer
            if shown:
                yield from range(done, until)
            done = until

    for _ in track(reached(), count // first.finer, "motion", shown):
        pass
    answers: list[Outcome] = []
    for j, member in enumerate(motion.members):
        why, samples = whys[j] or EARLY_ENDS.get(member.progress), min(member.samples, count)
        if why is not None and first.constant_head is not None and motion.state(j)[-1] < LEAST_FLOW:
            why = "its flow stops and would turn back"
        if member.progress == "spent" and j not in left:
            why = why or _too_many_calls(first.most)
        if observer.end is not None:
            samples, why = int(np.searchsorted(times[:samples], observer.end, "right")), None
        if members == 1:  # without a copy
            every[0], rows = start[:, j], every[: 1 + samples]
        else:
            rows = np.concatenate([start[None, :, j], states[j, :samples]])
        answers.append((rows, member.evaluations, why))
    count_right_hand_sides(sum(calls for _, calls, _ in answers))
    return answers


def _stops(task: Task) -> tuple[Array, Array, Array] | None:
    """Stops whose contacts are looked for in each step, as `Model.stop_places` gives them.

    There are none of them, but forces are looked at between the stages, where it is not known where
    slopes jump: if the base moves, and in modules written in Python. None is returned if no slope
    jumps.
    """
    stops = any(term.kinks for term in task.model.pipe.terms)
    if stops and task.base is None and not task.model.calls_python:
        return task.model.stop_places()
    nowhere = np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)
    return nowhere if stops or task.model.calls_python else None


def runs_unlocked(task: Task) -> bool:
    """Whether the right-hand sides of a task run without Python and its interpreter lock."""
    unlocked = task.drive is None or task.drive.numbers is not None
    if task.constant_head is not None and task.method == "radau":  # its Jacobian is in Python
        return False
    return unlocked and not task.model.calls_python and task.method in CORE


def _by_scipy(task: Task, monitor: Monitor) -> Iterator[Array]:
    """Yields the states at the times of a task, integrated by scipy."""
    kind = getattr(scipy.integrate, task.method.removeprefix("scipy:"))
    options: dict[str, Any] = {"rtol": task.rtol, "atol": task.atol, "max_step": task.max_step}
    if kind is not scipy.integrate.DOP853:
        options["jac"] = monitor.jacobian
    solver = kind(monitor.rates, task.t0, task.start, task.times[-1], **options)
    between: Callable[[float], Array] | None = None
    for t in task.times:
        while solver.t < t:
            with warnings.catch_warnings(), np.errstate(over="ignore", invalid="ignore"):
                warnings.simplefilter("ignore", UserWarning)  # the exception has the same message
                try:
                    message = solver.step()
                except ValueError as error:  # a factorisation raises it for numbers not finite
                    raise Stopped(str(error)) from error
            monitor.factorisations = max(monitor.jacobians, solver.nlu)
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise Stopped(message or NOT_FINITE)
            between = solver.dense_output()  # DOP853 evaluates three right-hand sides for it
        row = task.start if between is None else between(t)
        if not np.isfinite(row).all():
            raise Stopped(NOT_FINITE)
        yield row


# ------------------------------------------------------------------------- choice of the method


def choose_method(model: Model, members: int = 1, dense: bool = False) -> str:
    """The integrator of the core that is cheapest at equal error, for a number of members.

    One motion takes implicit steps, whose stages fill the processor's vectors: implicit steps need
    not resolve fast modes that have decayed, and cost no more if they must resolve all modes.
    Measured with chains of 3 to 100 segments, reduced models of 2 to 12 functions of both bases and
    scenes with modules in Python, damping 0 to 0.1 with and without drag, starts smooth or not,
    rtol 1e-3 to 1e-10, explicit steps cost 0.85 to 800 times as much at equal largest error of q,
    and without damping mostly 1.2 to 4 times. If decay is slow, explicit steps are taken for
    members of a chain or scene that advance together and so fill the vectors by themselves.
    Measured with 8 to 64 members of 4 to 40 segments, the method chosen costs at most 1.9 times the
    cheaper one; for reduced models, 1.4 times. Few segments have short implicit steps, so that two
    members of 2 to 4 segments and three of 5 are enough: at equal error explicit steps cost 0.5 to
    0.95 times as much. `tests/benchmark_simulate.py` repeats the measurement.

    `dense` means that implicit steps would factorise full Jacobians, as they do at constant head.
    """
    if (dense or model.calls_python) and model.integrated > LARGEST_IMPLICIT:
        return "dop853"
    enough = min(BATCHED, max(2, model.integrated - 2))
    if members < enough or isinstance(model.core, _core.Galerkin):
        return "radau"
    if not (model.pipe.damping or model.resisted):
        return "dop853"
    fastest, decay = fastest_rates(model)
    return "radau" if decay > BATCH_DECAY * fastest else "dop853"


@lru_cache(maxsize=8)
def fastest_rates(model: Model) -> tuple[float, float]:
    """Highest frequency and fastest decay rate of velocities, at rest without flow, to a few %."""
    pipe = replace(model.pipe, drag=0.0)
    frequency = math.sqrt(_strongest(model.with_pipe(replace(pipe, damping=0.0)), 0))
    if not model.resisted:
        return frequency, pipe.damping * frequency**2
    return frequency, _strongest(model.with_pipe(pipe), model.integrated)


def _strongest(model: Model, first: int) -> float:
    """Largest ratio of accelerations to coordinates (first = 0) or velocities, by power iteration.

    first is the index in the state of the first entry that is varied.
    """
    size = model.integrated
    rest = np.concatenate([model.resting(), np.zeros(size)])

    def accelerations(moved: Array | float) -> Array:
        state = rest.copy()
        state[first : first + size] += moved
        return model.motion_rates(state, 0.0)[size:]

    at_rest = accelerations(0.0)

    def response(moved: Array) -> Array:
        small = 1e-6 / float(np.abs(moved).max())  # makes the response linear
        return (accelerations(small * moved) - at_rest) / small

    start = np.cos(math.pi * np.arange(size)) * np.linspace(1.0, 1.5, size)
    return largest_stretch(response, start)
