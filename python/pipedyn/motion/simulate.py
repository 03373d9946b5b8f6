# SPDX-License-Identifier: MIT
"""Motion in time: what scipy's integrators make of a model's right-hand side, and its audit.

Integrated is y = [q, q', W] with W' the power of flow, joints and drag, so that the audit
|E(t) - E(0) - W(t)| has the integrator's own order and does not depend on the samples.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.integrate
from numpy.typing import ArrayLike
from scipy.integrate import ode

from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, PipedynError
from pipedyn.models.chain import Chain
from pipedyn.models.continuum import Continuum
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import evaluated, factorised, in_time
from pipedyn.util.progress import track

COMPILED = ("dop853", "lsoda")
"""scipy.integrate.ode's integrators that serve."""

EXPLICIT = ("dop853", "DOP853")
"""Methods whose steps stability holds to the time of the fastest mode."""

METHODS = ("auto", *COMPILED, "DOP853", "Radau", "BDF", "LSODA")
"""Small letters: compiled; the others: `scipy.integrate.solve_ivp`'s, in Python."""

Start: TypeAlias = ArrayLike | Callable[[Array], ArrayLike]
"""The angle theta(s) of the bent pipe, or coordinates; a search for motion takes states as well."""

CALLS, LEAST_STEP = 20_000, 2e-5
"""Right-hand sides after which a motion must have come further than this share of the time of its
fastest mode with each."""

FORECAST = 400
"""Right-hand sides after which it is asked how many more it takes: that costs some 40 to 120."""

CALLS_A_RATE = 1.5
"""Right-hand sides of an explicit method in the time 1 / |lambda| of the fastest mode, at least:
measured 1.6 with damping to 16 without at rtol 1e-6."""

MOST_CALLS = 1e8
"""Right-hand sides that a motion may take: minutes with few segments, an hour with a thousand."""

JACOBIANS = 1000
"""Jacobians after which the same is asked of an implicit integrator."""

CHAIN_WORTH, SEGMENTS = 0.025, 16
"""Fastest decay beside the highest frequency of a chain, for each digit asked for, from which
implicit steps pay; of more segments in proportion to these. So chosen is within 1.5 of the cheaper
of both with 5 to 24 segments at damping 0.001 to 0.1, rtol 1e-3 to 1e-9 and 41 or 51 samples."""

REDUCED_WORTH = 40.0
"""|lambda| of the fastest mode of other models, for each digit, from which they do."""

LARGEST_IMPLICIT = 2000
"""Degrees of freedom beyond which dense factorisations are not chosen."""

SAMPLES_A_TIME = 40
"""Samples in a unit of time where the user asks for no number."""

LARGEST_SAMPLES = 100_000_000
"""Numbers that a motion's samples may hold: 0.8 GB each for q and q'."""


@dataclass(frozen=True)
class Motion:
    """One motion, sampled.

    Attributes:
        t: times in T, shape (S,).
        q, qdot: coordinates and their rates, shape (S, coordinates).
        tip: position (x, y) of the free end in L, shape (S, 2).
        energy: in EI / L, shape (S,).
        audit: largest |E(t) - E(0) - work of flow, joints and drag|, relative to the largest of |E|
            and the kinetic energy: 0 but for the integrator's errors.
        u: flow speed.
        method: the integrator.
        evaluations: right-hand sides that it took; of a batch, those of the whole batch.
        model: the model.
    """

    t: Array
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    tip: Array = field(repr=False)
    energy: Array = field(repr=False)
    audit: float
    u: float
    method: str
    evaluations: int
    model: Model

    @property
    def reached(self) -> str:
        """How far it came, in words."""
        return f"at t = {self.t[-1]:g}" if self.t.size else "before its first sample"

    @property
    def y(self) -> Array:
        """States [q, q'] at the times, shape (2 coordinates, S)."""
        return np.concatenate([self.q, self.qdot], axis=1).T

    @property
    def tip_velocity(self) -> Array:
        """Velocity (x', y') of the free end at the times, in L / T, shape (S, 2)."""
        return self.model.tip_velocities(self.q.T, self.qdot.T)


class MotionStopped(PipedynError):
    """An integration that could not go on.

    Attributes:
        motion: up to the last sample before.
    """

    def __init__(self, message: str, motion: Motion) -> None:
        super().__init__(message, motion)
        self.motion = motion


@dataclass(frozen=True)
class Task:
    """A checked question: one state or, in the columns, several.

    Attributes:
        model: the model.
        u: flow speed, or one of each state, shape (k,).
        times: of the samples, the first the start, shape (S,).
        start: [p, p', 0] of the coordinates p that are integrated, shape (2 moving + 1,) or
            (2 moving + 1, k).
        rtol, atol: tolerances of each state's error in a step.
        method: of METHODS, not "auto".
        most: right-hand sides at most.
    """

    model: Model
    u: float | Array
    times: Array
    start: Array
    rtol: float
    atol: float
    method: str
    most: float = MOST_CALLS


class Stopped(Exception):
    """Why an integration ended early."""


def simulate(
    model: Model,
    u: float,
    duration: float,
    q0: Start,
    qdot0: ArrayLike | None = None,
    *,
    samples: int | None = None,
    times: ArrayLike | None = None,
    rtol: float = 1e-6,
    atol: float | None = None,
    method: str = "auto",
    most: float = MOST_CALLS,
    progress: bool = False,
) -> Motion:
    """The motion from an initial state at a constant flow speed, exact in the amplitude.

    Args:
        model: chain, reduced model or assembly.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        duration: in T, from 1e-12 to 1e9.
        q0: initial coordinates, shape (dof,), of an assembly angles (n,) or redundant coordinates
            (3 n,); or the angle theta(s) of the bent pipe, a function of arc lengths (p,) to (p,),
            so that different models start alike. A motion goes on with `motion.q[-1]` and
            `motion.qdot[-1]`, a cycle with `cycle.q[0]` and `cycle.qdot[0]`.
        qdot0: initial rates, of the shape of q0; at rest where not given.
        samples: number of evenly spaced samples, both ends included, at least 2; where not given,
            40 a unit of time, of which flutter's cycle takes about a half, but at least 501.
        times: samples at these times instead, increasing, in [0, duration].
        rtol: relative tolerance of the error of each step, in [1e-13, 0.1].
        atol: absolute tolerance, > 0; rtol / 100 where not given.
        method: "auto" chooses by measured cost, see `choose_method`; compiled "dop853" (explicit,
            order 8) and "lsoda" (implicit where it pays); or one of `scipy.integrate.solve_ivp`:
            "DOP853", "Radau", "BDF", "LSODA". Implicit ones use the analytic Jacobian.
        most: right-hand sides that it may take, >= 1, at 1 to 3 us each up to 60 segments. Explicit
            methods take 1.5 or more in the time 1 / |lambda| of the fastest mode; a motion that
            would exceed `most` at that pace is refused after 400.
        progress: show progress on stderr.

    Returns:
        Motion.

    Raises:
        MotionStopped: if the step shrinks to nothing, the state leaves finite numbers or it takes
            more than `most` right-hand sides; it carries the motion up to there.
        ValueError, TypeError: for bad arguments.

    Source: `rhs` of the models for the equations; scipy for their integration.
    """
    task = checked_task(
        *(model, u, duration, q0, qdot0),
        samples=samples,
        times=times,
        rtol=rtol,
        atol=atol,
        method=method,
        most=most,
    )
    return moved(task, check.flag("progress", progress))


def moved(task: Task, shown: bool = False) -> Motion:
    """The motion of a task of one state.

    Args:
        task: the task.
        shown: show progress on stderr.

    Raises:
        MotionStopped: as `simulate`.
    """
    rows, evaluations, why = integrate(task, shown)
    motion = motion_of(task, rows, evaluations)
    if why is not None:
        raise MotionStopped(f"the motion stopped {motion.reached}: {why}", motion)
    return motion


def checked_model_in_motion(model: Any, name: str = "model") -> Model:
    """The argument, if it is a model that moves."""
    if isinstance(model, Continuum) or not isinstance(model, Model):
        raise TypeError(
            f"{name} must be a Chain, a Galerkin model or an Assembly, got {check.shown(model)}"
            + ("; take Continuum.frozen(m)" if isinstance(model, Continuum) else "")
        )
    return model


def checked_task(
    model: Any,
    u: Any,
    duration: Any,
    q0: Any,
    qdot0: Any,
    *,
    samples: Any,
    rtol: Any,
    times: Any = None,
    atol: Any = None,
    method: Any = "auto",
    most: Any = MOST_CALLS,
) -> Task:
    """The arguments of `simulate`, checked, with the method chosen."""
    model = checked_model_in_motion(model)
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    duration = check.real("duration", duration, low=1e-12, high=1e9)
    longest = LARGEST_SAMPLES // model.coordinates
    if times is None:
        if samples is None:
            samples = min(max(501, math.ceil(SAMPLES_A_TIME * duration) + 1), longest)
        at = np.linspace(0.0, duration, check.count("samples", samples, low=2, high=longest))
    else:
        at = check.array("times", times, low=0.0, high=duration, longest=longest)
        if np.any(np.diff(at) <= 0.0):
            raise ValueError("times must be strictly increasing")
    if not callable(q0):
        check.numbers("q0", q0, "an angle theta(s) or coordinates")
    start = np.append(model.start(model.bent(q0) if callable(q0) else q0, qdot0), 0.0)
    rtol = check.real("rtol", rtol, low=1e-13, high=0.1)
    if atol is None:
        atol = 0.01 * rtol
    atol = check.real("atol", atol, low=0.0, high=1.0, open_low=True)
    most = check.real("most", most, low=1.0, high=1e18)
    method = check.choice("method", method, METHODS)
    if method == "auto":
        method = choose_method(model, rtol)
    return Task(model, u, at, start, rtol, atol, method, most)


def state_of(model: Model, name: str, start: Any, kinds: str) -> Array:
    """[p, p'], shape (2 moving,), of a start that may be a state.

    Args:
        model: the model.
        name: of the argument.
        start: an angle theta(s) or coordinates, at rest, or a state [q, q'].
        kinds: what the argument may be, for the message.
    """
    if callable(start):
        return np.array(model.start(model.bent(start), None))
    check.numbers(name, start, kinds)
    given = check.array(name, start, low=-1e6, high=1e6)
    sizes = sorted({model.moving, model.coordinates})
    if given.size in sizes:
        return np.array(model.start(given, None))
    if given.size in [2 * size for size in sizes]:
        return np.array(model.start(*np.split(given, 2)))
    many = " or ".join(map(str, sizes))
    raise ValueError(
        f"{name} must have {many} entries, or for a state twice as many, got {given.size}"
    )


class _Count:
    """A right-hand side that counts its calls, and answers NaN where it can answer nothing.

    Compiled integrators do not survive an exception from here: NaN makes them shorten the step and
    give up. A state that is not finite is remembered, an interruption raised after.
    """

    def __init__(self, task: Task) -> None:
        self.calls = self.jacobians = self.factorisations = 0
        self.overflowed = False
        self.interruption: BaseException | None = None
        self.checked, self.reached = FORECAST, -math.inf
        self.task = task
        self.f: Callable[[float, Array, Any], Array] = task.model.motion.rhs_and_power
        self.u = task.u
        self.shape = task.start.shape

    def remember(self, error: BaseException) -> None:
        """What an integrator must not see: a state that is not finite, or an interruption."""
        if isinstance(error, ValueError):
            self.overflowed = True
            return
        # The user's, most likely; one that comes while the core computes is wrapped.
        wrapped = isinstance(error, SystemError) and error.__cause__
        self.interruption = wrapped or error

    def one(self, t: float, y: Array) -> Array:
        try:
            if self.calls == self.checked:
                self.check(t)
            if self.calls >= self.task.most and self.interruption is None:
                told = f"it needs more right-hand sides than {self.task.most:g}, its most"
                self.interruption = Stopped(told)
            if self.interruption is None:
                self.calls += 1
                return self.f(t, y, self.u)
        except BaseException as error:
            self.remember(error)
        return np.full(self.shape, np.nan)

    @cached_property
    def rates(self) -> tuple[float, float]:
        """Highest frequency and fastest decay at rest; only long motions come to ask."""
        return highest_frequency(self.task.model), fastest_decay(self.task.model)

    @cached_property
    def least(self) -> float:
        """Time that so many calls must cover, by the fastest of modes, flow and its own turning."""
        turning = float(np.abs(self.task.start).max())
        fastest = sum(self.rates) + float(np.max(self.task.u)) ** 2 + turning + 1.0
        return LEAST_STEP * CALLS / fastest

    def check(self, t: float) -> None:
        """Whether it can come to its end, and whether the last calls came anywhere."""
        in_time()
        task = self.task
        ahead = CALLS_A_RATE * max(self.rates) * (float(task.times[-1]) - t)
        if task.method in EXPLICIT and self.calls + ahead > task.most:
            self.interruption = Stopped(
                f"it needs {ahead:.1g} right-hand sides or more and may take {task.most:g}"
                f" at most: its fastest mode has |lambda| = {max(self.rates):.2g}"
            )
        elif t - self.reached < self.least:
            self.interruption = Stopped("its step shrank to nothing beside its fastest mode's time")
        self.checked, self.reached = self.calls + CALLS, t

    def many(self, t: float, y: Array) -> Array:
        return self.one(t, y.reshape(self.shape)).ravel()

    def jacobian(self, t: float, y: Array) -> Array:
        """Of [q, q', W]. W acts on nothing, and the Newton iteration does without its row."""
        whole = np.zeros((y.size, y.size))
        try:
            self.jacobians += 1
            self.factorisations += 1  # LSODA factorises each
            if self.jacobians % JACOBIANS == 0:
                self.check(t)
            if self.interruption is None:
                whole[:-1, :-1] = self.task.model.motion_jacobian(y[:-1], float(self.task.u))
        except BaseException as error:
            self.remember(error)
        return whole


def integrate(task: Task, shown: bool = False) -> tuple[Array, int, str | None]:
    """States at the samples, (S, *start.shape), right-hand sides, and why it stopped early."""
    count = _Count(task)
    rhs = count.one if task.start.ndim == 1 else count.many
    route = _compiled if task.method in COMPILED else _stepped
    rows: list[Array] = []
    why = None
    try:
        for row in track(route(task, count, rhs), task.times.size, "motion", shown):
            rows.append(row.reshape(task.start.shape))  # noqa: PERF401 -- kept if it stops
    except Stopped as stopped:
        cause = count.interruption
        if isinstance(cause, Stopped):
            why = str(cause)
        elif cause is not None:
            raise cause from None
        else:
            why = "the state left finite numbers" if count.overflowed else str(stopped)
    states = task.start[0].size
    evaluated(states * (count.calls + count.jacobians))
    factorised(count.factorisations)
    return np.array(rows).reshape(-1, *task.start.shape), count.calls, why


def _compiled(task: Task, count: _Count, rhs: Callable[[float, Array], Array]) -> Iterator[Array]:
    explicit = task.method == "dop853"
    solver = ode(rhs) if explicit else ode(rhs, count.jacobian)
    options = {} if explicit else {"with_jacobian": True}
    solver.set_integrator(
        task.method, rtol=task.rtol, atol=task.atol, nsteps=1_000_000_000, **options
    )
    solver.set_initial_value(task.start.ravel(), 0.0)
    if explicit:
        # Its test for stiffness ends runs whose steps are held by stability, which is no failure.
        solver._integrator.iwork[3] = -1
    for t in task.times:
        if t > solver.t:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # said by the exception
                solver.integrate(t)
            if not (solver.successful() and np.isfinite(solver.y).all()):
                raise Stopped("its step shrank to nothing")
        yield solver.y.copy()


def _stepped(task: Task, count: _Count, rhs: Callable[[float, Array], Array]) -> Iterator[Array]:
    kind = getattr(scipy.integrate, task.method)
    implicit = {} if task.method == "DOP853" else {"jac": count.jacobian}
    waiting = iter(task.times)
    t = next(waiting)
    if t == 0.0:
        yield task.start
        t = next(waiting, None)
    if t is None:
        return
    end = float(task.times[-1])
    solver = kind(rhs, 0.0, task.start, end, rtol=task.rtol, atol=task.atol, **implicit)
    while t is not None:
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # of a step that shrinks to nothing
                message = solver.step()
            count.factorisations = solver.nlu
        except ValueError as error:  # a factorisation refuses what is not finite
            raise Stopped(str(error)) from error
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise Stopped(message or "the state left finite numbers")
        between = solver.dense_output()  # DOP853 asks for three more right-hand sides, or gets NaN
        while t is not None and t <= solver.t:
            row = between(t)
            if not np.isfinite(row).all():
                raise Stopped("the state left finite numbers")
            yield row
            t = next(waiting, None)


def motion_of(task: Task, rows: Array, evaluations: int) -> Motion:
    """The motion of a task of one state from its samples (S, 2 dof + 1)."""
    model, size = task.model, task.model.moving

    def recorded(samples: Array) -> tuple[Array, Array, Array]:
        q, qdot = model.recorded(samples[:, :size], samples[:, size : 2 * size])
        return q, qdot, np.ascontiguousarray(np.concatenate([q, qdot], axis=1).T)

    if not len(rows):  # it stopped before the first sample
        nothing, none = np.zeros((0, model.coordinates)), np.zeros(0)
        return Motion(
            *(none, nothing, nothing, np.zeros((0, 2)), none, 0.0, float(task.u)),
            *(task.method, evaluations, model),
        )
    t = task.times[: len(rows)]
    q, qdot, states = recorded(rows)
    work = rows[:, 2 * size]
    energy = np.asarray(model.energy(states))
    at_rest = states.copy()
    at_rest[model.coordinates :] = 0.0
    kinetic = energy - np.asarray(model.energy(at_rest))
    first = float(np.asarray(model.energy(recorded(task.start[None])[2]))[0])
    scale = max(float(np.abs(energy).max(initial=0.0)), float(kinetic.max(initial=0.0)))
    miss = float(np.abs(energy - first - work).max(initial=0.0))
    return Motion(
        t=t,
        q=q,
        qdot=qdot,
        tip=model.tips(q.T),
        energy=energy,
        audit=miss / scale if scale else 0.0,
        u=float(task.u),
        method=task.method,
        evaluations=evaluations,
        model=model,
    )


def choose_method(model: Model, rtol: float) -> str:
    """The integrator that measured cheapest: "dop853" unless damping makes the motion stiff.

    The fastest mode holds an explicit method to some 2 |lambda| right-hand sides a unit of time.
    "lsoda" leaves it out of account where it decays at once, at the cost of Jacobians and
    factorisations, which weigh less beside the dearer right-hand side of a reduced model. Undamped
    it follows every mode and costs more (tests/benchmark_simulate.py prints the comparison).

    Args:
        model: chain or reduced model.
        rtol: relative tolerance.
    """
    if not (model.pipe.damping or model.resisted) or model.moving > LARGEST_IMPLICIT:
        return "dop853"
    fastest, decay, digits = highest_frequency(model), fastest_decay(model), -math.log10(rtol)
    if isinstance(model, Chain):
        share = CHAIN_WORTH * digits * max(1.0, model.moving / SEGMENTS)
        return "lsoda" if decay > share * fastest else "dop853"
    stiff = max(fastest, decay) > REDUCED_WORTH * digits
    return "lsoda" if stiff and 0.5 * decay > 0.1 * fastest else "dop853"


def highest_frequency(model: Model) -> float:
    """Angular frequency of the fastest mode at rest, to some per cent, by power iteration."""
    return math.sqrt(_strongest(model.with_pipe(replace(model.pipe, damping=0.0, drag=0.0)), 0))


def fastest_decay(model: Model) -> float:
    """Rate at which the quickest decay of velocities goes, at rest, likewise."""
    if not model.resisted:
        return model.pipe.damping * highest_frequency(model) ** 2
    return _strongest(model.with_pipe(replace(model.pipe, drag=0.0)), model.moving)


def _strongest(model: Model, first: int) -> float:
    """Size of the accelerations that answer coordinates (first 0) or velocities, by iteration."""
    size = model.moving
    rest = np.concatenate([model.resting(), np.zeros(size + 1)])
    still = model.motion.rhs_and_power(0.0, rest, 0.0)[size:-1]
    moved = np.cos(math.pi * np.arange(size)) * np.linspace(1.0, 1.5, size)
    strongest = 0.0
    for _ in range(40):
        largest = float(np.abs(moved).max())
        if largest == 0.0:
            break
        moved *= 1e-6 / largest
        state = rest.copy()
        state[first : first + size] += moved
        answer = model.motion.rhs_and_power(0.0, state, 0.0)[size:-1] - still
        strongest = float(np.linalg.norm(answer) / np.linalg.norm(moved))
        moved = answer
    return strongest
