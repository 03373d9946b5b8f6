# SPDX-License-Identifier: MIT
"""Integrators: the core's and scipy's, which of them serves a model best, and why one stopped."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.modular.motion import SceneMotion
from pipedyn.util.check import Array
from pipedyn.util.counters import evaluated, factorised, in_time
from pipedyn.util.parallel import track
from pipedyn.util.power_iteration import largest_stretch

NOT_FINITE = "the state or its rate is no longer finite"
"""Why a motion stops: its numbers overflowed, or a bend is beyond what a quadrature resolves."""

COMPILED = ("scipy:dop853", "scipy:lsoda")
"""scipy.integrate.ode's integrators that serve."""

CORE = ("dop853", "radau")
"""The core's own."""

METHODS = ("auto", *CORE, *COMPILED, "scipy:DOP853", "scipy:Radau", "scipy:BDF", "scipy:LSODA")
"""The core's, and scipy's: in small letters compiled, the others `scipy.integrate.solve_ivp`'s."""

ENDS = {2: NOT_FINITE, 3: "its step size tends to 0"}
"""Why a motion of the core's ended that did not reach its end."""

FORECAST = 400
"""Right-hand sides after which the number of those to come is estimated, which costs 40 to 120."""

CALLS, JACOBIAN_CALLS = 20_000, 20
"""Right-hand sides between two checks of progress, and for how many of them a Jacobian with its
factorisation counts. A check costs nothing compared with so many."""

LEAST_STEP = 2e-5
"""Share of the fastest mode's time that each right-hand side must cover: methods that go on cover
0.02 and more; of those that do not, the step size tends to 0."""

CALLS_A_RATE = 1.5
"""Right-hand sides of an explicit method in the time 1 / |lambda| of the fastest mode, at least:
measured 1.6 with damping to 16 without at rtol 1e-6."""

MOST_CALLS = 1e8
"""Right-hand sides that a motion may take: minutes with few segments, an hour with a thousand."""

CHAIN_DECAY, CHAIN_SEGMENTS = 0.025, 16
"""Fastest decay, relative to the highest frequency of a chain and for each digit asked for, from
which implicit steps pay; beyond so many segments, in proportion to their number. The choice then
costs at most 1.5 times the cheaper of both, measured with 5 to 24 segments at damping 0.001 to 0.1,
rtol 1e-3 to 1e-9 and 41 or 51 samples."""

REDUCED_RATE = 40.0
"""|lambda| of the fastest mode of other models, for each digit, from which implicit steps pay:
measured likewise."""

LARGEST_IMPLICIT = 2000
"""Degrees of freedom beyond which dense factorisations are not chosen: one of 4,001 unknowns takes
128 MB and, measured, 4 s on one core."""


class Stopped(Exception):
    """Why an integration stopped early."""


@dataclass(frozen=True)
class Task:
    """An integration to be done."""

    model: Model
    u: float
    times: Array  # of the samples, shape (S,)
    start: Array  # [p, p', 0] of what is integrated, shape (2 moving + 1,)
    rtol: float
    atol: float
    method: str  # of METHODS, not "auto"
    most: float = MOST_CALLS


Motions: TypeAlias = tuple[Array, int, str | None]
"""States of a motion, right-hand sides that it took, and why it stopped early."""


class Guarded:
    """Rates and Jacobian of y' = f(t, y) for scipy, which count their calls and never raise.

    Compiled integrators do not survive an exception: NaN makes them shorten the step and give up.
    A state that is not finite is remembered, any other exception is kept for `reason`. `arguments`
    go to `rates` after t and y.
    """

    def __init__(
        self,
        rates: Callable[..., Array],
        jacobian: Callable[[float, Array], Array],
        shape: tuple[int, ...],
        arguments: tuple[Any, ...] = (),
        most: float = MOST_CALLS,
    ) -> None:
        self._rates, self._jacobian = rates, jacobian
        self.shape, self.arguments, self.most = shape, arguments, most
        self.calls = self.jacobians = self.factorisations = 0
        self.next_check: float = math.inf
        self.overflowed = False
        self.interruption: BaseException | None = None

    def check(self, t: float) -> None:
        """Raises what ends the integration; called where `calls` has come to `next_check`."""

    def _keep(self, error: BaseException) -> None:
        if isinstance(error, ValueError):
            self.overflowed = True
            return
        # The user's, most likely; one that comes while the core computes is wrapped.
        wrapped = isinstance(error, SystemError) and error.__cause__
        self.interruption = wrapped or error

    def rates(self, t: float, y: Array) -> Array:
        """f, of the state's shape."""
        try:
            if self.interruption is None:
                if self.calls >= self.next_check:
                    self.check(t)
                if self.calls >= self.most:
                    raise Stopped(f"it needs more than {self.most:g} right-hand sides")
                self.calls += 1
                return self._rates(t, y, *self.arguments)
        except BaseException as error:
            self._keep(error)
        return np.full(self.shape, np.nan)

    def jacobian(self, t: float, y: Array) -> Array:
        """df/dy, which integrators factorise each time."""
        try:
            self.jacobians += 1
            self.factorisations += 1
            self.next_check -= JACOBIAN_CALLS
            if self.interruption is None:
                return self._jacobian(t, y)
        except BaseException as error:
            self._keep(error)
        return np.zeros((y.size, y.size))

    def reason(self, stopped: Stopped) -> str:
        """Why an integration stopped; what is neither its own nor a number's is raised again."""
        cause = self.interruption
        if isinstance(cause, Stopped):
            return str(cause)
        if cause is not None:
            raise cause from None
        return NOT_FINITE if self.overflowed else str(stopped)


class Watched(Guarded):
    """The right-hand side of a task, which is checked now and then for progress."""

    def __init__(self, task: Task) -> None:
        super().__init__(
            *(task.model.motion.rhs_and_power, self._slopes, task.start.shape, (task.u,), task.most)
        )
        self.task = task
        explicit = task.method.lower().endswith("dop853")
        self.next_check, self.reached = FORECAST if explicit else CALLS, -math.inf

    def _slopes(self, t: float, y: Array) -> Array:
        """Of [q, q', W]. W acts on nothing, and the Newton iteration does without its row."""
        whole = np.zeros((y.size, y.size))
        whole[:-1, :-1] = self.task.model.motion_jacobian(y[:-1], self.task.u)
        return whole

    @cached_property
    def fastest(self) -> tuple[float, float]:
        """Highest frequency and fastest decay at rest, which only long motions need."""
        return fastest_rates(self.task.model)

    def check(self, t: float) -> None:
        """Raises what stops an integration that needs too many calls or whose steps vanish."""
        in_time()
        task, fastest = self.task, max(self.fastest)
        ahead = CALLS_A_RATE * fastest * (float(task.times[-1]) - t)
        if task.method.lower().endswith("dop853") and self.calls + ahead > task.most:
            raise Stopped(
                f"it needs {ahead:.1g} right-hand sides or more and may take {task.most:g}"
                f" at most: its fastest mode has |lambda| = {fastest:.2g}"
            )
        rotation = float(np.abs(task.start).max())
        rate = sum(self.fastest) + task.u**2 + rotation + 1.0
        if t - self.reached < LEAST_STEP * CALLS / rate:
            raise Stopped("its step size tends to 0")
        self.next_check, self.reached = self.calls + CALLS, t


def integrate(tasks: Sequence[Task], shown: bool = False) -> list[Motions]:
    """States of each task, right-hand sides taken, and why it stopped early.

    Shape of the states, the start and then the samples that were reached: (1 + S, 2 moving + 1).
    Several tasks have one model and one method of the core.
    """
    if tasks[0].method in CORE:
        return _in_core(tasks, shown)
    [task] = tasks
    guarded = Watched(task)
    if task.method in COMPILED:
        advanced = compiled(guarded, task.start, task.method, task.rtol, task.atol)
        samples: Iterator[Array] = map(advanced, task.times)
    else:
        samples = _python_samples(task, guarded)
    rows, why = [task.start], None
    try:
        for row in track(samples, task.times.size, "motion", shown):
            rows.append(row)  # noqa: PERF402 -- kept if it stops
    except Stopped as stopped:
        why = guarded.reason(stopped)
    evaluated(guarded.calls + guarded.jacobians)
    factorised(guarded.factorisations)
    return [(np.array(rows), guarded.calls, why)]


def _in_core(tasks: Sequence[Task], shown: bool) -> list[Motions]:
    """By one of the core's methods, each task with steps of its own."""
    first, members = tasks[0], len(tasks)
    u = np.array([task.u for task in tasks])
    start = np.stack([task.start for task in tasks], axis=1)
    options = (u, start, 0.0, first.rtol, first.atol, first.most)
    rates = _rates(first.model, u)
    motion: _core.Integrator
    if first.method == "dop853":
        motion = _core.Dop853(rates, *options)
    else:
        motion = _core.Radau(rates, _jacobian(first.model, u), *options)
    watched = [Watched(task) for task in tasks]
    states = np.empty((members, first.times.size, len(start)))
    whys: list[str | None] = [None] * members

    def reached() -> Iterator[int]:
        """The samples that all members have, or will not have, one by one."""
        done, finished, allowed = 0, False, FORECAST
        while not finished:
            finished = motion.advance(first.times, states, allowed)
            in_time()
            going = [j for j, member in enumerate(motion.members) if member[3] == 0]
            slowest = min(going, key=lambda j: motion.members[j][0], default=None)
            if slowest is not None:
                time, _, calls, _ = motion.members[slowest]
                watch = watched[slowest]
                watch.calls = calls
                try:
                    if calls >= watch.next_check:
                        watch.check(time)
                except Stopped as stopped:
                    whys[slowest] = str(stopped)
                    motion.stop(slowest)
                allowed = CALLS
            until = min((motion.members[j][1] for j in going), default=first.times.size)
            yield from range(done, until)
            done = until

    for _ in track(reached(), first.times.size, "motion", shown):
        pass
    answers: list[Motions] = []
    for j, (_, samples, calls, end) in enumerate(motion.members):
        spent = f"it needs more than {first.most:g} right-hand sides" if end == 4 else None
        rows = np.concatenate([start[None, :, j], states[j, :samples]])
        answers.append((rows, calls, whys[j] or ENDS.get(end, spent)))
    evaluated(sum(calls for _, calls, _ in answers))
    return answers


def _rates(model: Model, u: Array) -> object:
    """What the core integrates: a compiled model, or a function of t, states and their members."""
    motion = model.motion
    if isinstance(motion, SceneMotion) and motion.is_compiled:
        return motion.core
    if isinstance(motion, (_core.Chain, _core.Galerkin)):
        return motion
    return lambda t, y, which: motion.rhs_and_power(t[0], y, u[which])


def _jacobian(model: Model, u: Array) -> Callable[[float, Array, int], Array]:
    """Of [q, q', W] by t, a state and its member; W acts on nothing, and its own row is left out."""

    def slopes(t: float, y: Array, member: int) -> Array:
        whole = np.zeros((y.size, y.size))
        whole[:-1, :-1] = model.motion_jacobian(y[:-1], u[member])
        return whole

    return slopes


def state_after(
    rates: Callable[[Array], Array],
    start: Array,
    t: float,
    rtol: float,
    atol: float,
    jacobian: Callable[[Array], Array] | None = None,
) -> Array:
    """The state at a time of y' = rates(y) from a start at time 0, by implicit steps with df/dy.

    Without that by explicit ones. `rates` takes states (n, k) at once. Raises `Stopped`.
    """

    def columns(t: Array, y: Array, which: list[int]) -> Array:
        return rates(y)

    options = (np.zeros(1), start[:, None], 0.0, rtol, atol, MOST_CALLS)
    motion: _core.Integrator
    if jacobian is None:
        motion = _core.Dop853(columns, *options)
    else:
        motion = _core.Radau(columns, lambda t, y, member: jacobian(y), *options)
    state = np.empty((1, 1, start.size))
    while not motion.advance(np.array([t]), state, CALLS):
        in_time()
    if motion.members[0][3] != 1:
        raise Stopped(ENDS.get(motion.members[0][3], "it takes too many steps"))
    return state[0, 0]


def compiled(
    guarded: Guarded, start: Array, method: str, rtol: float, atol: float
) -> Callable[[float], Array]:
    """States at growing times from a start at time 0, by one of the compiled methods.

    The function that is returned raises `Stopped` where the integrator fails.
    """
    explicit = method == "scipy:dop853"
    jacobians = () if explicit else (guarded.jacobian,)
    solver = scipy.integrate.ode(guarded.rates, *jacobians)
    options = {} if explicit else {"with_jacobian": True}
    # Its own limit of steps is beyond MOST_CALLS.
    solver.set_integrator(
        method.removeprefix("scipy:"), rtol=rtol, atol=atol, nsteps=1_000_000_000, **options
    )
    solver.set_initial_value(start, 0.0)
    if explicit:
        # Its test for stiffness ends runs whose steps are held by stability, which is no failure.
        solver._integrator.iwork[3] = -1

    def advanced(t: float) -> Array:
        if t > solver.t:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # said by the exception
                solver.integrate(t)
            if not (solver.successful() and np.isfinite(solver.y).all()):
                raise Stopped("its step size tends to 0")
        return np.array(solver.y)

    return advanced


def _python_samples(task: Task, guarded: Guarded) -> Iterator[Array]:
    kind = getattr(scipy.integrate, task.method.removeprefix("scipy:"))
    implicit = {} if task.method == "scipy:DOP853" else {"jac": guarded.jacobian}
    end = float(task.times[-1])
    solver = kind(guarded.rates, 0.0, task.start, end, rtol=task.rtol, atol=task.atol, **implicit)
    between: Callable[[float], Array] | None = None
    for t in task.times:
        while solver.t < t:
            try:
                with np.errstate(over="ignore", invalid="ignore"):  # of a step that tends to 0
                    message = solver.step()
                guarded.factorisations = solver.nlu
            except ValueError as error:  # a factorisation refuses what is not finite
                raise Stopped(str(error)) from error
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise Stopped(message or NOT_FINITE)
            between = solver.dense_output()  # of DOP853 from three right-hand sides, or NaN
        row = task.start if between is None else between(t)
        if not np.isfinite(row).all():
            raise Stopped(NOT_FINITE)
        yield row


# ----------------------------------------------------------------------------- which one serves


def choose_method(model: Model, rtol: float) -> str:
    """The integrator that measured cheapest: "dop853" unless damping makes the motion stiff.

    The fastest mode holds an explicit method to some 2 |lambda| right-hand sides a unit of time.
    "scipy:lsoda" leaves it out of account where it decays at once, at the cost of Jacobians and
    factorisations, which weigh less where a right-hand side costs more, as in a reduced model.
    Undamped it follows every mode and costs more (see tests/benchmark_simulate.py).
    """
    if not (model.pipe.damping or model.resisted) or model.moving > LARGEST_IMPLICIT:
        return "dop853"
    (fastest, decay), digits = fastest_rates(model), -math.log10(rtol)
    if model.linear_cost:  # a Jacobian takes dof times as much
        share = CHAIN_DECAY * digits * max(1.0, model.moving / CHAIN_SEGMENTS)
        return "scipy:lsoda" if decay > share * fastest else "dop853"
    stiff = max(fastest, decay) > REDUCED_RATE * digits
    return "scipy:lsoda" if stiff and 0.5 * decay > 0.1 * fastest else "dop853"


def fastest_rates(model: Model) -> tuple[float, float]:
    """Highest frequency and fastest decay of velocities at rest, to some per cent."""
    pipe = replace(model.pipe, drag=0.0)
    frequency = math.sqrt(_strongest(model.with_pipe(replace(pipe, damping=0.0)), 0))
    if not model.resisted:
        return frequency, pipe.damping * frequency**2
    return frequency, _strongest(model.with_pipe(pipe), model.moving)


def _strongest(model: Model, first: int) -> float:
    """Largest ratio of accelerations to coordinates (first 0) or velocities, by iteration."""
    size = model.moving
    rest = np.concatenate([model.resting(), np.zeros(size + 1)])

    def accelerations(moved: Array | float) -> Array:
        state = rest.copy()
        state[first : first + size] += moved
        return model.motion.rhs_and_power(0.0, state, 0.0)[size:-1]

    at_rest = accelerations(0.0)

    def response(moved: Array) -> Array:
        small = 1e-6 / float(np.abs(moved).max())  # so that motion is linear
        return (accelerations(small * moved) - at_rest) / small

    start = np.cos(math.pi * np.arange(size)) * np.linspace(1.0, 1.5, size)
    return largest_stretch(response, start)
