# SPDX-License-Identifier: MIT
"""scipy's integrators: which serves a model best, and right-hand sides that never raise."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from pipedyn.models.base import Model
from pipedyn.util.check import Array
from pipedyn.util.counters import evaluated, factorised, in_time
from pipedyn.util.parallel import track
from pipedyn.util.power_iteration import largest_stretch

NOT_FINITE = "the state or its rate is no longer finite"
"""Why a motion stops: its numbers overflowed, or a bend is beyond what a quadrature resolves."""

COMPILED = ("dop853", "lsoda")
"""scipy.integrate.ode's integrators that serve."""

METHODS = ("auto", *COMPILED, "DOP853", "Radau", "BDF", "LSODA")
"""Small letters: compiled; the others: `scipy.integrate.solve_ivp`'s, in Python."""

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
    """An integration to be done, of one state or, in the columns, of several."""

    model: Model
    u: float | Array  # flow speed, or one of each state, shape (k,)
    times: Array  # of the samples, shape (S,)
    start: Array  # [p, p', 0] of what is integrated, shape (2 moving + 1,) or (2 moving + 1, k)
    rtol: float
    atol: float
    method: str  # of METHODS, not "auto"
    most: float = MOST_CALLS


class Guarded:
    """Rates and Jacobian of y' = f(t, y), which count their calls and never raise.

    Compiled integrators do not survive an exception: NaN makes them shorten the step and give up.
    A state that is not finite is remembered, any other exception is kept for `reason`. States have
    the given shape, (N,) or (N, k); `arguments` go to `rates` after t and y.
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
        """f, of the states' shape."""
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
        self.next_check, self.reached = FORECAST, -math.inf

    def _slopes(self, t: float, y: Array) -> Array:
        """Of [q, q', W]. W acts on nothing, and the Newton iteration does without its row."""
        whole = np.zeros((y.size, y.size))
        whole[:-1, :-1] = self.task.model.motion_jacobian(y[:-1], float(self.task.u))
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
        if task.method.lower() == "dop853" and self.calls + ahead > task.most:
            raise Stopped(
                f"it needs {ahead:.1g} right-hand sides or more and may take {task.most:g}"
                f" at most: its fastest mode has |lambda| = {fastest:.2g}"
            )
        rotation = float(np.abs(task.start).max())
        rate = sum(self.fastest) + float(np.max(task.u)) ** 2 + rotation + 1.0
        if t - self.reached < LEAST_STEP * CALLS / rate:
            raise Stopped("its step size tends to 0")
        self.next_check, self.reached = self.calls + CALLS, t


def integrate(task: Task, shown: bool = False) -> tuple[Array, int, str | None]:
    """States (the start, then the samples), right-hand sides taken, and why it stopped early.

    Shape of the states: (1 + S, *start.shape), with as many samples S as were reached.
    """
    guarded = Watched(task)
    if task.method in COMPILED:
        advanced = compiled(guarded, task.start, task.method, task.rtol, task.atol)
        samples: Iterator[Array] = map(advanced, task.times)
    else:
        samples = _python_samples(task, guarded)
    rows, why = [task.start], None
    try:
        for row in track(samples, task.times.size, "motion", shown):
            rows.append(row.reshape(task.start.shape))  # noqa: PERF401 -- kept if it stops
    except Stopped as stopped:
        why = guarded.reason(stopped)
    evaluated(task.start[0].size * (guarded.calls + guarded.jacobians))
    factorised(guarded.factorisations)
    return np.array(rows), guarded.calls, why


def compiled(
    guarded: Guarded, start: Array, method: str, rtol: float, atol: float
) -> Callable[[float], Array]:
    """States at growing times from a start at time 0, by one of the compiled methods.

    The function that is returned raises `Stopped` where the integrator fails.
    """

    def flat_rates(t: float, y: Array) -> Array:
        return guarded.rates(t, y.reshape(guarded.shape)).ravel()

    rhs = guarded.rates if len(guarded.shape) == 1 else flat_rates
    explicit = method == "dop853"
    solver = scipy.integrate.ode(rhs) if explicit else scipy.integrate.ode(rhs, guarded.jacobian)
    options = {} if explicit else {"with_jacobian": True}
    # Its own limit of steps is beyond MOST_CALLS.
    solver.set_integrator(method, rtol=rtol, atol=atol, nsteps=1_000_000_000, **options)
    solver.set_initial_value(start.ravel(), 0.0)
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
    kind = getattr(scipy.integrate, task.method)
    implicit = {} if task.method == "DOP853" else {"jac": guarded.jacobian}
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
    "lsoda" leaves it out of account where it decays at once, at the cost of Jacobians and
    factorisations, which weigh less where a right-hand side costs more, as in a reduced model.
    Undamped it follows every mode and costs more (see tests/benchmark_simulate.py).
    """
    if not (model.pipe.damping or model.resisted) or model.moving > LARGEST_IMPLICIT:
        return "dop853"
    (fastest, decay), digits = fastest_rates(model), -math.log10(rtol)
    if model.linear_cost:  # a Jacobian takes dof times as much
        share = CHAIN_DECAY * digits * max(1.0, model.moving / CHAIN_SEGMENTS)
        return "lsoda" if decay > share * fastest else "dop853"
    stiff = max(fastest, decay) > REDUCED_RATE * digits
    return "lsoda" if stiff and 0.5 * decay > 0.1 * fastest else "dop853"


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
