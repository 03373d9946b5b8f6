# SPDX-License-Identifier: MIT
"""Motion in time: integration of a model's equations of motion, and an audit of its energy.

The state y = [q, q', W] is integrated, where W' is the power of flow, joints and drag. The audit
|E(t) - E(0) - W(t)| is therefore an error of the order of the integrator and does not depend on the
samples.

Many motions of one model advance together in batches, and each takes steps of its own. The
right-hand sides of a batch are computed together in the processor's vectors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent import futures
from contextlib import nullcontext, suppress
from contextvars import copy_context
from dataclasses import field, replace
from functools import partial
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.models.base import ROWS, Configurations, Model
from pipedyn.models.drive import (
    LARGEST_SPEED,
    TRIED,
    Base,
    Drive,
    DriveFailed,
    Force,
    InputUnits,
    Speed,
    Supply,
)
from pipedyn.models.scales import beyond
from pipedyn.modular.assembly import Assembly
from pipedyn.motion.constant_head import ConstantHead
from pipedyn.motion.events import (
    DenseOutput,
    Event,
    EventFunction,
    Occurrences,
    Recorder,
    checked_events,
)
from pipedyn.motion.integrator import (
    CORE,
    METHODS,
    MOST_CALLS,
    Callback,
    Method,
    Observer,
    Outcome,
    Task,
    choose_method,
    fastest_rates,
    integrate,
    runs_unlocked,
)
from pipedyn.motion.sampling import A_CYCLE, A_TURN, FEWEST, FINEST, INVISIBLE, MOST_NUMBERS, coarse
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import TookTooLong
from pipedyn.util.errors import PipedynError, UnusualPipe, resolved, warn_caller
from pipedyn.util.parallel import Returned, parallel
from pipedyn.util.result import (
    Result,
    TableResult,
    Unit,
    Units,
    join_tables,
    states_over_time,
)

Start: TypeAlias = ArrayLike | Callable[[Array], ArrayLike]
"""The angle theta(s) of the bent pipe, or coordinates; some functions also take states."""

OneTask = TypeVar("OneTask", bound=Task)

LARGEST_SAMPLES = 100_000_000
"""Largest number of values in the samples of a motion: 0.8 GB each for q and q'."""

LARGEST_ENSEMBLE = 1_000_000
"""Largest number of members of an ensemble: each takes a kilobyte before anything is computed."""

BATCH = 32
"""Largest number of members in a batch, a multiple of VECTOR. Measured, larger batches hardly
reduce the cost of a member."""

LOOKS = 4
"""Number of times that the samples of a motion are looked at: they may not show it."""

COORDINATES_AT_ONCE = 16_000
"""Number of coordinates in the states whose energies are computed at once: the processor's caches
hold them."""

VECTOR = 8
"""Number of members that the core's vectors hold: twice as many batches of half as many members
take longer, by up to 1.7 times with AVX-512 and not with AVX2."""


class Trajectory(Configurations):
    """States of a model at S times; base class of motions, limit cycles and forced motions."""

    t: Array
    qdot: Array
    u: Speed

    @property
    def y(self) -> Array:
        """States [q, q'] at the times, shape (2 coordinates, S)."""
        return np.concatenate([self.q, self.qdot], axis=1).T

    @property
    def tip_velocity(self) -> Array:
        """Velocity (x', y') of the free end in L / T, shape (S, 2); or (x', y', z'), (S, 3)."""
        if not self.t.size:
            return np.empty((0, self.model.dimensions))
        return self.model.tip_velocities(self.q.T, self.qdot.T)

    def _unit(self, name: str) -> Unit | None:
        if name.startswith("qdot") and isinstance(self.model, Assembly):
            return None  # redundant coordinates are lengths and angles, so rates have no one unit
        of_results: Any = super()
        return of_results._unit(name)

    def _columns(self) -> dict[str, Any]:
        tips = self.model.tips(self.q.T) if self.t.size else np.empty((0, self.model.dimensions))
        return states_over_time(self.t, self.q, self.qdot, tips, self.curvature)


@saved_as("Motion")
class Motion(Trajectory, TableResult):
    """One motion, sampled at S times.

    Attributes:
        t: times in T, shape (S,).
        q, qdot: coordinates and their rates, shape (S, coordinates).
        tip: position (x, y) of the free end from the base in L, shape (S, 2); in three dimensions
            (x, y, z), shape (S, 3).
        energy: energy in the frame of the base, in EI / L, shape (S,).
        audit: largest |E(t) - E(0) - work of flow, joints, drag and base|, relative to the largest
            of |E| and the kinetic energy: 0 up to errors of the integrator. It is NaN for motions
            that were integrated without the work (those that stopped in the computation of a
            diagram or an exponent), and for motions that were not computed.
        u: flow speed as it was given: a number, a function of time or a `Supply`.
        flow_speed: flow speed at the times, shape (S,).
        method: name of the integrator.
        evaluations: number of right-hand sides that were evaluated.
        model: the model that moves.
        events: times and states of each of the events asked for.
        dense: states at any time; None if they were not asked for.
        base: motion of the base as it was given, None at rest.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=5)
        >>> motion = pp.simulate(chain, 6.0, 20.0, lambda s: 0.1 * s)
        >>> motion
        Motion(t=<801, 0 to 20>, u=6, model=Chain(Pipe(beta=0.2), n=5, springs='consistent'))
        >>> round(float(np.abs(motion.tip[:, 0]).max()), 3), motion.audit < 1e-5
        (0.393, True)
    """

    t: Array
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    tip: Array = field(repr=False)
    energy: Array = field(repr=False)
    audit: float = field(repr=False)
    u: Speed
    flow_speed: Array = field(repr=False)
    method: str = field(repr=False)
    evaluations: int = field(repr=False)
    model: Model
    events: tuple[Occurrences, ...] = field(repr=False, default=())
    dense: DenseOutput | None = field(default=None, repr=False)
    base: Base | None = field(default=None, repr=False)

    @property
    def reached(self) -> str:
        """The time that the motion reached, in words for an error message."""
        return f"at t = {self.t[-1]:g}" if self.t.size else "before its first sample"

    def _columns(self) -> dict[str, Any]:
        return {
            **super()._columns(),
            "energy": self.energy,
            "flow_speed": self.flow_speed,
        }


@saved_as("MotionStopped")
class MotionStopped(PipedynError):
    """An integration could not go on.

    Attributes:
        motion: the motion up to its last sample before it stopped.
    """

    def __init__(self, message: str, motion: Motion) -> None:
        super().__init__(message, motion)
        self.motion = motion


@saved_as("MemberFailure")
class MemberFailure(Result):
    """A member of an ensemble whose motion stopped, or was not computed.

    Attributes:
        index: index of the member.
        error: the exception with the reason and the motion up to its last sample. If the member was
            not computed, because its worker died or a law of its model raised an exception,
            `error.__cause__` is the exception of the worker or the law.
    """

    index: int
    error: MotionStopped


@saved_as("Ensemble")
class Ensemble(TableResult):
    """Motions of many members.

    Attributes:
        motions: the motion of each member, in order. The motion of a member that failed ends at its
            last sample before it stopped, and has no samples if it was not computed.
        failures: the members that stopped early or were not computed.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=5)
        >>> found = pp.simulate_many(chain, [4.0, 6.0], 20.0, lambda s: 0.1 * s)
        >>> [round(float(np.ptp(one.tip[-40:, 0])), 3) for one in found.motions]
        [0.0, 0.782]
    """

    motions: tuple[Motion, ...]
    failures: tuple[MemberFailure, ...]

    def __len__(self) -> int:
        return len(self.motions)

    def _columns(self) -> dict[str, Any]:
        tables = [one._columns() for one in self.motions]
        return join_tables(tables, member=range(len(tables)))

    def _scales(self) -> Any:
        """SI scales of the first pipe that has any."""
        return next(filter(None, (one._scales() for one in self.motions)), None)

    def _scales_of_rows(self, scales: Any) -> Any:
        """SI scales for the rows of the table, from the pipe of each member."""
        each = [one.model.pipe.scales or (math.nan,) * len(scales) for one in self.motions]
        rows = np.repeat(each, [one.t.size for one in self.motions], axis=0)
        return type(scales)(*rows.T)


def simulate(
    model: Model,
    u: Speed,
    duration: float,
    q0: Start | None = None,
    qdot0: ArrayLike | None = None,
    *,
    samples: int | None = None,
    times: ArrayLike | None = None,
    t0: float = 0.0,
    base: Base | None = None,
    force: Force | Sequence[Force] | None = None,
    rtol: float = 1e-6,
    atol: float | None = None,
    method: Method = "auto",
    max_step: float = math.inf,
    events: Event | EventFunction | Sequence[Event | EventFunction] = (),
    dense: bool = False,
    most: float = MOST_CALLS,
    callback: Callback | None = None,
    units: Units = "nondimensional",
    progress: bool = False,
) -> Motion:
    """The motion from an initial state, geometrically exact.

    Args:
        model: chain, reduced model or assembly.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L: a number, a `Pulsation`, or a function of the
            time to a number. The function must be smooth, as its derivative acts as well: it
            accelerates the fluid in the pipe. The derivative is taken from nine values 0.002 T
            apart (less in a shorter motion), in [t0, t0 + duration]; these are not needed if a pair
            of functions, u(t) and its derivative, is given. With a `Supply`, at constant head, the
            speed follows from the motion.
        duration: duration of the motion in T, from 1e-12 to 1e9.
        q0: initial coordinates, shape (dof,), or for an assembly angles (n,) or redundant
            coordinates (3 n,); or the angle theta(s) of the bent pipe, a function of arc lengths
            (p,) to (p,), so that different models start alike. If not given, the pipe is slightly
            bent, theta(s) = 0.05 s^2, and in three dimensions also across that plane. To continue a
            motion, give `motion.q[-1]` and `motion.qdot[-1]`; to start on a cycle, give
            `cycle.q[0]` and `cycle.qdot[0]`.
        qdot0: initial rates, of the shape of q0; 0 if not given.
        samples: number of evenly spaced samples, both ends included, at least 2. If not given, 40
            in a unit of time, which is about two cycles of flutter, but at least 501. Methods of
            the core then take 2 to 128 times as many if the free end oscillates so fast that cubics
            through the samples would miss 5 % of its displacement or 25 % of its velocity.
        times: times of the samples, if `samples` is not given; increasing, in [t0, t0 + duration].
        t0: time at the start, in [-1e9, 1e9].
        base: the motion of the base: a `Harmonic`; a smooth function of the time to its place (X,
            Y) in L, whose two derivatives are computed as the derivative of u is; or a triple of
            functions to place, velocity and acceleration. In three dimensions places are (X, Y, Z).
            The base carries the clamp and all rigid
            supports: guides, pins and an end fixed axially (`Stretching`). The base does not turn,
            and coordinates are relative to it. Springs, dampers and the fluid around the pipe
            belong to the ground. If not given, the base is at rest.
        force: a `Force` of your own, at one place or all along the pipe, or a list of them.
        rtol: relative tolerance of the error of each step, in [1e-13, 0.1]. "radau" is
            cheapest at 2e-5, and replaces looser tolerances by that.
        atol: absolute tolerance, > 0; rtol / 100 if not given.
        method: "auto" chooses by measured cost, see `choose_method`; "radau" (implicit, eight
            stages, order 15) or "dop853" (explicit, order 8), both in the core; or a method of
            `scipy.integrate.solve_ivp`: "scipy:DOP853" and, with the analytic Jacobian,
            "scipy:Radau", "scipy:BDF" and "scipy:LSODA".
        max_step: longest step, > 0, at least 1e-9 of the duration.
        events: one or several `Event` or functions g(t, q, qdot) to a number, with q and qdot of
            shape (coordinates,). An event takes place when g becomes 0: the signs of g at the ends
            of each quarter of a step are compared, and the root is found to rounding in the
            polynomial that interpolates the step. Only methods of the core give this polynomial,
            which dense output needs as well.
        dense: whether to keep the states at any time, as `motion.dense(t)`. They take 16 or more
            numbers for each step and coordinate.
        most: largest number of right-hand sides, >= 1. Explicit methods need at least 1.5 in the
            time 1 / |lambda| of the fastest mode; a motion that would therefore exceed `most` is
            stopped after 400. A motion by "radau" is stopped after 20,000 if with its present step
            size it would take a hundred times `most`.
        callback: function called with the t, q and qdot that the motion has reached, first after
            some hundred right-hand sides, then every 0.05 s or later; if it returns True, the
            motion ends there.
        units: "si" if u is given in m/s, duration, times, t0 and max_step in s, and functions of
            time in these units, a base's in m; the pipe must have scales. Drives that have a
            `from_si` must come from it. States, events, `Event` functions and the returned motion
            stay nondimensional (see `in_si`). Quantities of pint are converted whatever `units`
            says.
        progress: whether to show progress on stderr.

    Returns:
        Motion with samples of the states, the energy and its audit.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), 5)
        >>> back = pp.Event(lambda t, q, qdot: q[-1], direction=-1, terminal=True)
        >>> motion = pp.simulate(chain, 4.0, 5.0, lambda s: 0.1 * s, events=back)
        >>> float(motion.events[0].t[0]) < 5.0
        True

        A hose, with speed and time in SI units, and its flow rate:

        >>> hose = pp.Pipe.from_tube(
        ...     length=0.5, outer_diameter=12e-3, inner_diameter=8e-3, youngs_modulus=3e6,
        ...     density=1150.0, fluid_density=998.0,
        ... )
        >>> motion = pp.simulate(pp.Chain(hose, 8), 9.0, 2.0, lambda s: 0.1 * s, units="si")
        >>> found = motion.in_si()
        >>> round(float(found.t[-1]), 3), round(float(found.flow_rate_l_min[0]), 2)
        (2.0, 27.14)

    Raises:
        MotionStopped: if the step tends to 0, the state or its rate is no longer finite, the
            motion takes more than `most` right-hand sides, or a function of time fails during the
            motion; the exception holds the motion up to its last sample.
        ValueError, TypeError: for bad arguments.

    Source: `rhs` of the models for the equations; Hairer, Norsett and Wanner, Solving Ordinary
    Differential Equations I, II.6, for "dop853"; Hairer and Wanner, II, IV.8, for "radau".
    """
    given = InputUnits(units, checked_model_in_motion(model).pipe)
    u = given.speed("u", u)
    duration, times, t0, max_step = given.times(
        simulate, duration=duration, times=times, t0=t0, max_step=max_step
    )
    with given.explained():
        task = checked_task(
            *(model, u, duration, q0, qdot0, samples, times, rtol, atol, method, most),
            t0=t0,
            max_step=max_step,
            base=given.base(base),
            forces=given.force(force),
        )
    looked_for, kept = checked_events(events), check.flag("dense", dense)
    recorder = None
    if looked_for or kept:
        if task.method not in CORE:
            name = "events" if looked_for else "dense"
            raise ValueError(
                f"{name} must come with a method of the core, {', '.join(map(repr, CORE))}: "
                f"scipy's hand over no polynomial of a step, got method {task.method!r}"
            )
        recorder = Recorder(task.model, looked_for, task.t0, task.start, kept)
    check.instance("callback", callback, Callable | None, "a function")
    observer = Observer(recorder, callback)
    shown = check.flag("progress", progress)
    if samples is None and times is None and task.method in CORE:
        task, outcome = integrated_as_shown(task, shown, observer)
        [(motion, why)] = assembled([task], [outcome])
    else:
        [(motion, why)] = motions_of([task], shown, observer)
    if recorder is not None:
        until = math.inf if observer.end is None else observer.end
        motion = replace(motion, events=recorder.occurrences(), dense=recorder.output(until))
    if why is not None:
        raise MotionStopped(f"the motion stopped {motion.reached}: {why}", motion)
    return motion


def simulate_many(
    models: Model | Sequence[Model],
    speeds: Speed | ArrayLike | Sequence[Speed],
    duration: float,
    q0: Start | Sequence[Start] | None = None,
    qdot0: ArrayLike | Sequence[ArrayLike] | None = None,
    *,
    samples: int | None = None,
    times: ArrayLike | None = None,
    base: Base | None = None,
    force: Force | Sequence[Force] | None = None,
    rtol: float = 1e-6,
    atol: float | None = None,
    method: Method = "auto",
    most: float = MOST_CALLS,
    executor: futures.Executor | None = None,
    units: Units = "nondimensional",
    progress: bool = False,
) -> Ensemble:
    """Motions of many members, which may differ in model, flow speed and initial state.

    An argument that is given once holds for all members; an argument that is given k times has a
    value for each member. If the method is "dop853", members with the same model object are
    integrated in batches, on all cores. The motion of a member depends on the method, which "auto"
    chooses by the number of members; other members change its rates only by a thousandth of `rtol`.

    Args:
        models: one model or k.
        speeds: flow speed >= 0, a number or shape (k,); or a speed that varies, as for `simulate`,
            or a list of k such speeds.
        duration: duration of the motions in T, from 1e-12 to 1e9.
        q0: initial coordinates (dof,) or an angle theta(s), as for `simulate`; or k of them, e.g.
            shape (k, dof). If not given, all start slightly bent.
        qdot0: initial rates, shape (dof,) or k of them; 0 if not given.
        samples: number of evenly spaced samples, as for `simulate`.
        times: times of the samples, if `samples` is not given.
        base: the motion of the base, common to all members, as for `simulate`.
        force: a `Force` or a list of them, common to all members, as for `simulate`.
        rtol: relative tolerance of the error of each member's steps.
        atol: absolute tolerance; rtol / 100 if not given.
        method: as for `simulate`.
        most: largest number of right-hand sides of each member, as for `simulate`.
        executor: a `concurrent.futures.Executor` that takes the batches, instead of the threads of
            this process. Members for which the executor returns nothing fail, because a worker died
            or the executor is broken or shut down. With a pool of processes, `speeds`, `base` and
            functions of `force` must not be lambdas, as the workers call them; `q0` is called in
            this process.
        units: as for `simulate`: with "si" speeds, duration and times are in SI for the pipe of
            each member.
        progress: whether to show progress on stderr.

    Returns:
        Ensemble. A member that stops early or is not computed is reported in `failures`; all other
        members are kept.

    Example:
        >>> model = pp.Chain(pp.Pipe(0.2), 10)
        >>> found = pp.simulate_many(model, np.linspace(4.0, 6.0, 5), 2.0, lambda s: 0.1 * s)
        >>> len(found), found.failures
        (5, ())

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    chosen = list(models) if isinstance(models, Sequence) else [models]
    for i, model in enumerate(chosen):
        checked_model_in_motion(model, f"models[{i}]" if isinstance(models, Sequence) else "models")
    at = _speeds(speeds)
    starts, rates = _each("q0", q0), _each("qdot0", qdot0)
    given: dict[str, Any] = {"models": chosen, "speeds": at, "q0": starts, "qdot0": rates}
    asked = {id(model): InputUnits(units, model.pipe) for model in chosen}
    members = max(len(values) for values in given.values())
    for name, values in given.items():
        if len(values) not in (1, members):
            raise ValueError(
                f"{name} must be one or as many as the others, {members}, got {len(values)}"
            )
    if members > LARGEST_ENSEMBLE:
        raise ValueError(f"speeds must ask for at most {LARGEST_ENSEMBLE} members, got {members}")
    check.executor("executor", executor)
    shown = check.flag("progress", progress)
    members_of: dict[int, list[int]] = {}  # indices of members, by the identity of the model
    for i in range(members):
        members_of.setdefault(id(chosen[i % len(chosen)]), []).append(i)
    tasks: list[Task] = []
    for i in range(members):
        model, u, q, qdot = (values[i % len(values)] for values in given.values())
        same, own = members_of[id(model)], asked[id(model)]
        try:
            u = own.speed("speeds", u)
            if i > same[0]:
                with own.explained():
                    task = with_speed(
                        replace(tasks[same[0]], start=checked_start(model, q, qdot)), u
                    )
            else:
                lasting, at_times = own.times(simulate_many, duration=duration, times=times)
                options = (samples, at_times, rtol, atol, method, most)
                with own.explained():
                    task = checked_task(
                        *(model, u, lasting, q, qdot, *options),
                        base=own.base(base),
                        forces=own.force(force),
                        members=len(same),
                    )
        except (ValueError, TypeError) as error:
            raise type(error)(f"{error} (member {i})") from error
        tasks.append(task)
    if sum(task.times.size * task.model.coordinates for task in tasks) > LARGEST_SAMPLES:
        raise ValueError(f"samples must ask for at most {LARGEST_SAMPLES} numbers in all members")
    motions, failures = list[Motion](), list[MemberFailure]()
    answers = outcomes_in_batches(tasks, motions_of, executor, shown)
    for i, answer in enumerate(answers):
        if isinstance(answer, Exception):
            motion = _without_samples(tasks[i])
            message = f"member {i} was not computed: {type(answer).__name__}: {answer}"
        else:
            motion, why = answer
            message = "" if why is None else f"member {i} stopped {motion.reached}: {why}"
        motions.append(motion)
        if message:
            stopped = MotionStopped(message, motion)
            stopped.__cause__ = answer if isinstance(answer, Exception) else None
            failures.append(MemberFailure(i, stopped))
    return Ensemble(tuple(motions), tuple(failures))


def in_batches(
    tasks: Sequence[OneTask],
    work: Callable[[Sequence[OneTask], bool, Observer], list[Returned]],
    members: int = BATCH,
    note: Callable[[list[int], list[Returned]], None] = lambda *_: None,
) -> list[Returned]:
    """Answers of `outcomes_in_batches`; raises the first exception among them, if any."""
    found = list[Returned]()
    for answer in outcomes_in_batches(tasks, work, members=members, note=note):
        if isinstance(answer, Exception):
            raise answer
        found.append(answer)
    return found


def outcomes_in_batches(
    tasks: Sequence[OneTask],
    work: Callable[[Sequence[OneTask], bool, Observer], list[Returned]],
    executor: futures.Executor | None = None,
    shown: bool = False,
    members: int = BATCH,
    note: Callable[[list[int], list[Returned]], None] = lambda *_: None,
) -> list[Returned | Exception]:
    """The answer of `work` for each task, in batches of one model, on threads if they are faster.

    If a batch fails or the executor returns nothing for it, all its tasks have the exception as
    their answer. `members` is the size of a batch if the method advances several tasks at once.
    `note` is given the indices of the tasks of each batch and their answers as soon as it has them.
    """
    members_of: dict[tuple[object, ...], list[int]] = {}  # by model, forcing and method
    for i, task in enumerate(tasks):
        drive = 0 if isinstance(task.u, float) and not task.drive else id(task.u)
        key = (id(task.model), drive, task.method)
        members_of.setdefault(key, []).append(i)
    blocks = []
    for same in members_of.values():
        explicit = tasks[same[0]].method == "dop853"
        least = 2 if len(same) > VECTOR else 1  # two batches can use two threads
        count = max(math.ceil(len(same) / members), least) if explicit else len(same)
        blocks += [part.tolist() for part in np.array_split(same, count)]
    observer = Observer()
    jobs = [partial(work, [tasks[i] for i in block], False, observer) for block in blocks]
    own = executor is None and len(jobs) > 1 and all(map(runs_unlocked, tasks))
    if own:  # each job runs in the context of the caller, so that its counts are added there
        jobs = [partial(copy_context().run, job) for job in jobs]
    found: dict[int, Returned | Exception] = {}
    with futures.ThreadPoolExecutor(os.cpu_count()) if own else nullcontext(executor) as pool:
        try:
            answers = parallel(jobs, pool, label="batches", progress=shown)
            for block, answer in zip(blocks, answers, strict=True):
                if isinstance(answer, TookTooLong):  # must end the whole computation of the caller
                    raise answer
                if isinstance(answer, Exception):
                    found |= dict.fromkeys(block, answer)
                else:
                    found |= zip(block, answer, strict=True)
                    note(block, answer)
        except BaseException:
            observer.end = -math.inf  # stops the threads of the pool
            if own and pool is not None:
                pool.shutdown(cancel_futures=True)
            raise
    return [found[i] for i in range(len(tasks))]


def _speeds(given: Any) -> list[Any]:
    """The argument `speeds` as a list: the flow speed of each member, or one speed for all."""
    if check.is_quantity(given):
        return list(given) if np.ndim(given.magnitude) else [given]
    if check.has_quantity(given):
        return list(given)
    if _varies(given):
        return [given]
    if isinstance(given, list) and any(map(_varies, given)):
        return given
    at = np.atleast_1d(check.numbers("speeds", given, "a number or an array of real numbers"))
    return check.array("speeds", at, low=0.0, high=LARGEST_SPEED).tolist()


def _varies(u: Any) -> bool:
    """Whether a flow speed varies: whether it is a function, a pair of functions or a `Supply`."""
    pair = isinstance(u, tuple) and any(map(callable, u))
    return pair or callable(u) or isinstance(u, Supply)


def _each(name: str, given: Any) -> list[Any]:
    """An argument that is given once or for each member, as a list of 1 or k values."""
    several = isinstance(given, Sequence) and not isinstance(given, str)
    several = several and all(callable(one) or np.ndim(one) == 1 for one in given)
    if isinstance(given, np.ndarray):
        several = given.ndim == 2
    if several and not len(given):
        raise ValueError(f"{name} must not be empty, got {check.shown(given)}")
    return list(given) if several else [given]


def motions_of(
    tasks: Sequence[Task], shown: bool, observer: Observer
) -> list[tuple[Motion, str | None]]:
    """Motion of each member of a batch, and the reason why it stopped early, or None."""
    return assembled(tasks, integrate(tasks, shown, observer))


class _UntilCoarse(Observer):
    """Ends a motion as soon as its samples are too far apart to show its free end."""

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.task, self.coarse = task, False
        self.ends = np.empty((2 * task.model.dimensions, 0))
        self.next_look = task.times.size // LOOKS

    def look(self, rows: Array) -> bool:
        """Whether samples of the motion so far, shape (S, size of a state), are too far apart."""
        self.next_look = len(rows) + self.task.times.size // LOOKS
        seen = self.ends[:, : len(rows)]
        new = _ends_of(self.task.model, rows[seen.shape[1] :])
        self.ends = np.concatenate([seen, new], axis=1)
        return _too_coarse(self.task.times[: len(rows)], self.ends)

    def ended(self, states: Array, samples: Array) -> Iterable[int]:
        if samples[0] >= self.next_look:
            self.coarse = self.coarse or self.look(states[0, : samples[0]])
        return [0] if self.coarse else []


def integrated_as_shown(task: Task, shown: bool, observer: Observer) -> tuple[Task, Outcome]:
    """A task and its outcome, with the fewest samples that show the motion of the free end.

    The motion is integrated with the samples asked for. If these do not show it, it is integrated
    again with the finest ones; so it is at once if its steps are observed, which is as much work.
    """
    if observer.recorder is None and observer.callback is None:
        until = _UntilCoarse(task)
        [outcome] = integrate([task], shown, until)
        if not until.coarse and not until.look(outcome[0][1:]):
            return task, outcome
        observer = Observer()
    finely = finely_sampled(task)
    [(rows, calls, why)] = integrate([finely], shown, observer)
    every = finely.finer
    while every > 1:
        kept = rows[1::every]
        if not _too_coarse(finely.times[::every][: len(kept)], _ends_of(task.model, kept)):
            break
        every //= 2
    rows = np.concatenate([rows[:1], rows[1::every]])
    return replace(finely, times=finely.times[::every], finer=1), (rows, calls, why)


def _ends_of(model: Model, rows: Array) -> Array:
    """Positions and velocities of the free end, (2 dimensions, S), in states of rows (S, ...)."""
    size = model.integrated
    q, qdot = model.to_user(rows[:, :size], rows[:, size : 2 * size])
    return model._free_ends(q.T, qdot.T)


def _too_coarse(t: Array, ends: Array) -> bool:
    """Whether samples at times (S,) of positions and velocities of the free end miss it.

    Positions and velocities have the shape (2 dimensions, S).
    """
    if len(t) < 3:
        return True
    late = len(t) - len(t) // 4
    at, velocity = (half.T for half in np.split(ends, 2))
    return (
        coarse(t, at, velocity, rates_shown=True)
        or any(
            coarse(t, at[:, i], velocity[:, i], rates_shown=True) for i in (0, 2)[: at.shape[1] - 1]
        )
        or coarse(t[late:], at[late:], velocity[late:], INVISIBLE)
    )


def finely_sampled(task: Task) -> Task:
    """The task with more samples, a power of 2 for each one that is asked for.

    They resolve rotation at the angular velocity of the start, and the fastest of the modes whose
    loss factor in bending is at most 1.
    """
    model, intervals, damping = task.model, task.times.size - 1, task.model.pipe.damping
    fastest, _ = fastest_rates(model)
    fastest = min(fastest, 1.0 / damping if damping else math.inf)
    turning = model.largest_angle(task.start[model.integrated : 2 * model.integrated])
    interval = float(np.ptp(task.times)) / intervals / (2.0 * math.pi)
    wanted = min(A_CYCLE * fastest * interval, FINEST)
    room = max(MOST_NUMBERS // (intervals * len(task.start)), 1)
    finer = int(min(max(wanted, A_TURN * turning * interval, FEWEST), room))
    finer = 1 << (finer.bit_length() - 1)
    times = np.linspace(task.times[0], task.times[-1], finer * intervals + 1)
    times[::finer] = task.times  # the times asked for, without rounding errors
    return replace(task, times=times, finer=finer)


def _with_drive(task: Task, outcome: Outcome) -> tuple[Array, int, str | None, Array]:
    """The outcome, cut before the first sample at which a function of time fails, and its drive.

    The drive has a row of u and of the drive's rows (`ROWS`) for the start and each sample, shape
    (1 + S, 1 + ROWS); numbers of forces may follow in each row.
    """
    rows, calls, why = outcome
    if task.drive is None:
        return rows, calls, why, np.tile([task.flow(0.0)[0], *(0.0,) * ROWS], (len(rows), 1))
    values = [task.drive(task.t0)]
    for t in task.times[: len(rows) - 1].tolist():
        try:
            values.append(task.drive(t))
        except DriveFailed as failed:
            why = str(failed)
            break
    return rows[: len(values)], calls, why, np.array(values)


def assembled(
    tasks: Sequence[Task], outcomes: Sequence[Outcome]
) -> list[tuple[Motion, str | None]]:
    """Motions from the outcomes of tasks of one model, with the reasons why they stopped early.

    They have energies, audits and free ends.
    """
    model, size = tasks[0].model, tasks[0].model.integrated
    driven = list(map(_with_drive, tasks, outcomes))
    rows = driven[0][0] if len(driven) == 1 else np.concatenate([rows for rows, *_ in driven])
    q, qdot = model.to_user(rows[:, :size], rows[:, size : 2 * size])
    moves = None
    if tasks[0].base is not None:
        every = np.concatenate([values[:, 2 : 1 + ROWS].T for *_, values in driven], axis=1)
        moves = np.concatenate([every[:6].reshape(3, 2, -1), every[6:, None]], axis=1)
        moves = moves[:, : model.dimensions]
    energy, kinetic = _energies(model, q, qdot, moves)
    supplied = rows[:, 2 * size] if rows.shape[1] > 2 * size else np.full(len(rows), math.nan)
    motions, start = [], 0
    for task, (own, evaluations, why, values) in zip(tasks, driven, strict=True):
        of = slice(start + 1, start + len(own))
        scale = float(max(np.abs(energy[of]).max(initial=0.0), kinetic[of].max(initial=0.0)))
        missed = energy[of] - energy[start] - supplied[of]
        motion = Motion(
            t=task.times[: len(own) - 1],
            q=q[of],
            qdot=qdot[of],
            # Positions exclude the start, which may be too bent for the model to compute.
            tip=resolved("tips", partial(model._free_ends, q[of].T, qdot[of].T), True)[
                : model.dimensions
            ].T,
            energy=energy[of],
            audit=float(np.abs(missed).max(initial=0.0)) / scale if scale else 0.0,
            u=task.u,
            flow_speed=own[1:, -1] if task.constant_head else values[1:, 0],
            method=task.method,
            evaluations=evaluations,
            model=model.with_applied(()),
            base=task.base,
        )
        motions.append((motion, why))
        start += len(own)
    return motions


def _energies(model: Model, q: Array, qdot: Array, moves: Array | None) -> Array:
    """Energies of states, and their kinetic energies, shape (2, S).

    q and qdot have the shape (S, coordinates). moves: place, velocity and acceleration of the base,
    (3, dimensions, S), if it moves.
    """
    found, few = [np.empty((2, 0))], math.ceil(COORDINATES_AT_ONCE / model.coordinates)
    for first in range(0, len(q), few):
        of = slice(first, first + few)
        states = np.concatenate([q[of].T, qdot[of].T])
        drive = model._drive(states, None, None if moves is None else moves[:, :, of])
        states = model._integrated_state(states)
        energy = np.asarray(model.core.energy(states, drive, refuses=False))
        states[model.integrated :] = 0.0  # the same configurations at rest
        still = np.asarray(model.core.energy(states, drive, refuses=False))
        found.append(np.stack([energy, energy - still]))
    return np.concatenate(found, axis=1)


def _without_samples(task: Task) -> Motion:
    """A motion without samples, for a task that was not computed; it calls no law of the model."""
    none = np.zeros(0)
    coordinates = np.zeros((0, task.model.coordinates))
    ends = np.zeros((0, task.model.dimensions))
    return Motion(
        *(none, coordinates, coordinates, ends, none, math.nan, task.u, none, task.method, 0),
        model=task.model,
        base=task.base,
    )


# ------------------------------------------------------------------------- starts and arguments


def slight_bend(s: Array) -> Array:
    """The angle theta(s) from which motions start if no start is given."""
    return 0.05 * s**2


def slight_bend_across(s: Array) -> Array:
    """The angle a_z(s) that motions in three dimensions have besides `slight_bend` at the start.

    The pipe then does not lie in a plane, so that no motion is missed that leaves it.
    """
    return 0.02 * s * (1.0 - s)


def modal_bend(parts: ArrayLike) -> Callable[[Array], Array]:
    """The angle theta(s) = sum of parts[k] sin((k + 1/2) pi s), with m amplitudes (m,) in rad."""

    def bend(s: Array) -> Array:
        waves = np.arange(0.5, np.size(parts))
        return np.asarray(parts @ np.sin(np.outer(waves, math.pi * s)))

    return bend


def initial_bends(model: Model, count: int, seed: int) -> list[Array]:
    """Initial coordinates: first a slight bend, then random combinations of three bent shapes.

    Amplitudes range from a hundredth of a radian to some radians.
    """
    random = np.random.default_rng(seed)
    found = [slightly_bent(model)]
    planes = model.dimensions - 1
    while len(found) < count:
        parts = random.uniform(-1.0, 1.0, (planes, 3)) * np.array([2.0, 1.0, 0.5])
        parts *= 10.0 ** random.uniform(-1.5, 0.0)
        for halved in 0.5 ** np.arange(6):
            with suppress(PipedynError):  # guides and pins may not allow a large bend
                found.append(model.bent(*(modal_bend(halved * part) for part in parts)))
                break
    return found


def slightly_bent(model: Model) -> Array:
    """Coordinates at which motions start if no start is given."""
    bends = slight_bend, slight_bend_across
    return np.asarray(model.bent(*bends[: model.dimensions - 1]))


def checked_model_in_motion(
    model: Any,
    name: str = "model",
    largest: float = math.inf,
    purpose: str = "",
    *,
    symmetric: bool = False,
) -> Model:
    """The argument, refused unless it has equations of motion and at most `largest` dof.

    `symmetric`: whether models in three dimensions are refused that turns about the axis change.
    """
    if not isinstance(model, Model):
        raise TypeError(
            f"{name} must be a Chain, a Galerkin model or an Assembly (of a Continuum, take "
            f"Continuum.frozen(m)), got {check.shown(model)}"
        )
    model.require_large_motions(name)
    if symmetric and model.dimensions == 3 and not model.pipe.symmetric_about_axis:
        raise ValueError(
            f"{name} must be the same in all directions across its axis for {purpose}, without a "
            f"load or jet across it and with terms alike in x and z, got {check.shown(model)}: ask "
            "limit_cycle and simulate"
        )
    if model.dof > largest:
        many = f"{largest} degrees of freedom for {purpose}"
        raise ValueError(f"{name} must have at most {many}, got {model.dof}")
    if model.pipe.hysteresis:
        instead = (
            "it does not act on what is at rest, so ask the pipe without it, and "
            "eigenvalues(model.about(q), u) with it for small motions about what is found"
            if purpose == "equilibria"
            else "a loss factor has no equation of motion; damping=pipe.equivalent_damping("
            "critical_speed(model).frequency) loses as much at the onset of flutter"
        )
        raise ValueError(
            f"{name} must be a pipe without hysteresis, got {model.pipe.hysteresis:g}: {instead}"
        )
    return model


def checked_task(
    model: Any,
    u: Any,
    duration: Any,
    q0: Any,
    qdot0: Any,
    samples: Any = None,
    times: Any = None,
    rtol: Any = 1e-6,
    atol: Any = None,
    method: Any = "auto",
    most: Any = MOST_CALLS,
    *,
    t0: Any = 0.0,
    max_step: Any = math.inf,
    base: Any = None,
    forces: tuple[Force, ...] = (),
    members: int = 1,
) -> Task:
    """The task for arguments of `simulate`; "auto" is replaced by a method for all members."""
    model = checked_model_in_motion(model)
    duration = check.real("duration", duration, low=1e-12, high=1e9)
    t0 = check.real("t0", t0, low=-1e9, high=1e9)
    if t0 + duration - t0 < 0.5 * duration:
        raise ValueError(f"duration must be felt at t0 = {t0:g}, got {duration:g}")
    end = t0 + duration
    if base is not None:
        model.require_base()
    if max_step != math.inf:
        max_step = check.real("max_step", max_step, low=0.0, open_low=True)
        if max_step < (least := 1e-9 * duration):
            raise ValueError(
                f"max_step must be at least {least:g}, 1e-9 of the duration, got {max_step:g}"
            )
    if forces:  # so that no step passes over a hundredth of the motion, as checks do not
        max_step = min(max_step, duration / TRIED)
    longest = LARGEST_SAMPLES // model.coordinates
    if samples is not None and times is not None:
        raise ValueError(
            "samples or times must be given, a number of even ones or the times themselves, not "
            f"both, got {check.shown(samples)} and {check.shown(times)}"
        )
    if times is None:
        if samples is None:
            samples = min(max(501, math.ceil(40.0 * duration) + 1), longest)
        at = np.linspace(t0, end, check.count("samples", samples, low=2, high=longest))
    else:
        at = check.array("times", times, low=t0, high=end, longest=longest)
        if np.any(np.diff(at) <= 0.0):
            raise ValueError("times must be strictly increasing")
    start = checked_start(model, q0, qdot0)
    rtol = check.real("rtol", rtol, low=1e-13, high=0.1)
    atol = 0.01 * rtol if atol is None else atol
    atol = check.real("atol", atol, low=0.0, high=1.0, open_low=True)
    most = check.real("most", most, low=1.0, high=1e18)
    method = check.choice("method", method, METHODS)
    if method == "auto":
        method = choose_method(model, members, dense=isinstance(u, Supply))
    steady = Task(*(model, 0.0, at, start, rtol, atol, method, t0, end, most, max_step), base=base)
    return with_speed(replace(steady, forces=forces) if forces else steady, u)


def with_speed(task: Task, u: Any) -> Task:
    """The task at another flow speed, which may vary and is checked."""
    rest = task.base is None and not task.forces
    if rest and not _varies(u):
        u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
        return replace(task, u=u, drive=None, constant_head=None)
    if not isinstance(u, Supply):
        if task.drive is not None and task.u is u:
            return task
        drive = _drive_of(task, u)
        model = task.model.with_applied(drive.forces.laws)
        return replace(task, u=u, model=model, drive=drive, constant_head=None)
    driven = None if rest else _drive_of(task, 0.0)
    model = task.model if driven is None else task.model.with_applied(driven.forces.laws)
    head = ConstantHead(model, u)
    start = np.append(task.start[: 2 * model.integrated + 1], head.start)
    return replace(task, u=u, model=model, start=start, drive=driven, constant_head=head)


def _drive_of(task: Task, u: Any) -> Drive:
    return Drive(u, task.base, task.t0, task.end, task.forces, task.model.dimensions)


def checked_start(model: Model, q0: Any, qdot0: Any) -> Array:
    """The state [p, p', 0], shape (2 integrated + 1,), from the arguments `q0` and `qdot0`."""
    if q0 is None:
        q0 = slightly_bent(model)
    if not callable(q0):
        check.numbers("q0", q0, "an angle theta(s) or coordinates")
        state = model.initial_state(q0, qdot0)
        return np.append(state, 0.0) if qdot0 is not None else _with_work(model, state)
    try:
        bent = model.bent(q0)
    except (ValueError, TypeError) as error:
        rule = "q0 must make angles, shape (p,), of arc lengths, shape (p,)"
        raise type(error)(f"{rule}: {error}") from error
    return _with_work(model, model.initial_state(bent, qdot0))


def _with_work(model: Model, state: Array) -> Array:
    """A start and the work done, 0; warns of a pipe that is coiled up as by angles in degrees."""
    angle = model.largest_angle(state[: model.integrated])
    for far in beyond("the largest angle of q0", angle, (0.0, math.pi), " rad"):
        warn_caller(UnusualPipe, f"{far}: in rad, not in degrees?", __name__)
    return np.append(state, 0.0)


def state_of(model: Model, name: str, start: Any, kinds: str) -> Array:
    """The state [p, p'], shape (2 integrated,), of a start; messages name the `kinds` of starts.

    A start is a trajectory, whose last state is taken; an angle theta(s) or coordinates, with rates
    of 0; or a state.
    """
    if isinstance(start, Trajectory):
        check_coordinates(model, name, start)
        return np.array(start.model.initial_state(start.q[-1], start.qdot[-1]))
    if callable(start):
        return np.array(model.initial_state(model.bent(start), None))
    check.numbers(name, start, kinds)
    given = check.array(name, start, low=-1e6, high=1e6)
    sizes = sorted({model.integrated, model.coordinates})
    if given.size in sizes:
        return np.array(model.initial_state(given, None))
    if given.size in [2 * size for size in sizes]:
        return np.array(model.initial_state(*np.split(given, 2)))
    many = " or ".join(map(str, sizes))
    raise ValueError(
        f"{name} must have {many} entries, or for a state twice as many, got {given.size}"
    )


def check_coordinates(model: Model, name: str, given: Trajectory) -> None:
    """Raises ValueError for a trajectory whose coordinates are not of the model's kind."""
    if given.model.coordinate_kind != model.coordinate_kind:
        raise ValueError(
            f"{name} must be a {type(given).__name__} in the model's coordinates, "
            f"{model.coordinate_kind}, got {given.model.coordinate_kind}"
        )
