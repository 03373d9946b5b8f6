# SPDX-License-Identifier: MIT
"""The largest Lyapunov exponent, the rate at which neighbouring motions diverge or converge.

A motion is integrated together with a neighbour. Their small difference is brought back to its
first length at short intervals; the sum of the logarithms of its growth, divided by the time, tends
to the exponent.

Source: Benettin, Galgani, Giorgilli and Strelcyn (1980). The standard error comes from means over
blocks of time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from pipedyn.models.base import Model
from pipedyn.models.drive import Base, Force, InputUnits, Pulsation, require_steady, steady_speed
from pipedyn.models.pipe import Pipe
from pipedyn.motion.integrator import Observer, Task, integrate
from pipedyn.motion.simulate import (
    BATCH,
    MotionStopped,
    Start,
    Trajectory,
    assembled,
    checked_model_in_motion,
    checked_task,
    in_batches,
    slight_bend,
    state_of,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged
from pipedyn.util.parallel import track
from pipedyn.util.result import RATE, TableResult, Units

APART, CLOSE = 1e-5, 1e-6
"""Distance of neighbours, in the norm of the state, at the start of each interval: APART where the
motions of an ensemble are classified, CLOSE in `lyapunov_exponent`. Each motion takes steps of its
own, and the square of the distance changes the growth as well. With step errors of 1e-3 times APART
the growth over an interval changes by 1e-4 or less: measured on four pipes, by 2e-5 over the first
four intervals. With step errors of 1e-6 times CLOSE the exponents of seven pipes at rest and on
cycles changed by 1e-7 or less, relative to the exponents of the variational equation."""

PARTED = 1e4
"""Factor by which the distance of neighbours may grow or shrink in an interval: beyond it they are
no longer close, or rounding shows. The interval is then shortened."""

BEYOND_DOUBT = 4.0
"""Number of spreads above 0 at which a motion is surely chaotic and is integrated no further. It is
larger than in `chaotic`, because the exponent is tested several times during the motion."""

MOST_INTERVALS = 10_000_000
"""Largest number of intervals of a motion, as the growth in each is stored: 80 MB."""


@saved_as("LyapunovExponent")
class LyapunovExponent(
    TableResult, units=dict.fromkeys(("value", "spread", "blocks", "history"), RATE)
):
    """The largest Lyapunov exponent of a motion, with its statistical error.

    Attributes:
        value: the exponent in 1 / T; 0 on a limit cycle, the largest real part of an eigenvalue
            if the motion comes to rest, above 0 if it is chaotic.
        spread: standard error of the value, the largest of three estimates: from the means over
            blocks, from the means of the two halves, and from the oscillation of the length of the
            difference v. A value within a few spreads of 0 counts as 0.
        blocks: means of the growth rate over the blocks, shape (blocks,).
        t: times since the transient at which intervals end, shape (S,).
        history: the exponent computed from the time up to each of the times t, shape (S,).
        duration: time over which growth was measured.
        end: state [p, p'] at the end, shape (2 integrated,), from which the motion may continue.
        pipe: the pipe of the model.
    """

    value: float
    spread: float
    blocks: Array = field(repr=False)
    t: Array = field(repr=False)
    history: Array = field(repr=False)
    duration: float
    end: Array = field(repr=False)
    pipe: Pipe | None = field(default=None, repr=False)

    @property
    def chaotic(self) -> bool:
        """Whether the value is above 0 by more than three times its spread."""
        return self.value > 3.0 * self.spread

    def _columns(self) -> dict[str, Any]:
        return {"t": self.t, "history": self.history}


def lyapunov_exponent(
    model: Model,
    u: float,
    start: Trajectory | Start | None = None,
    *,
    duration: float = 200.0,
    transient: float = 100.0,
    blocks: int = 10,
    interval: float = 0.5,
    units: Units = "nondimensional",
    progress: bool = False,
) -> LyapunovExponent:
    """The largest Lyapunov exponent of the motion from a start, after its transient.

    Args:
        model: chain, reduced model or scene. Directions that guides and pins forbid count as
            decaying at rate 10.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        start: a `LimitCycle`, on which the motion begins; a `Motion`, at whose end it begins; the
            angle theta(s) of the bent pipe or coordinates, from which it begins at rest; or a state
            [q, q'], shape (2 coordinates,). If not given, the pipe is bent a little.
        duration: time in T over which growth is measured, after the transient.
        transient: time in T before the duration, in which the motion approaches its attractor, and
            the difference turns to the direction of fastest growth.
        blocks: number of parts of the duration, from whose means the spread comes, at least 4.
        interval: time in T after which the difference is brought back to its first length; it is
            shortened to divide a block, or if the difference changes too much within it.
        units: "si" if u is given in m/s and the times duration, transient and interval in s. The
            pipe must have scales, and the times not given keep their values in T.
        progress: whether to show progress on stderr.

    Returns:
        LyapunovExponent with its value and spread.

    Example:
        >>> model = pp.Chain(pp.Pipe(0.2), 2)
        >>> found = pp.lyapunov_exponent(model, 4.0, duration=40.0, transient=20.0)
        >>> found.chaotic  # it is a cycle
        False

    Raises:
        NotConverged: if the integration stops, or differences change too fast to be followed.
        ValueError, TypeError: for bad arguments.
    """
    model = checked_model_in_motion(model)
    given = InputUnits(units, model.pipe)
    require_steady("u", u)
    u = given.speed("u", u)
    duration, transient, interval = given.times(
        lyapunov_exponent, duration=duration, transient=transient, interval=interval
    )
    kinds = "a LimitCycle, a Motion, an angle theta(s), coordinates or a state [q, q']"
    with given.explained():
        u = steady_speed("u", u)
        duration = check.real("duration", duration, low=1e-3, high=1e6)
        transient = check.real("transient", transient, low=0.0, high=1e6)
        interval = check.real("interval", interval, low=1e-6, high=1e3)
    state = state_of(model, "start", slight_bend if start is None else start, kinds)
    blocks = check.count("blocks", blocks, low=4, high=10_000)
    shown = check.flag("progress", progress)
    if (duration + transient) / min(interval, duration / blocks) > MOST_INTERVALS:
        raise ValueError(f"interval must cut the time into at most {MOST_INTERVALS} parts")
    [found] = exponents_together(
        *(model, [u], [state], duration, transient, blocks, interval), alone=True, shown=shown
    )
    if isinstance(found, MotionStopped):
        raise NotConverged(str(found))
    return found


def _any_direction(size: int) -> Array:
    """A vector of unit length that is parallel to no eigenvector of a system, shape (size,)."""
    direction = np.cos(np.arange(size) + 0.5)
    return np.asarray(direction / np.linalg.norm(direction))


def _from_growth(
    growth: Array, step: float, blocks: int, end: Array, pipe: Pipe | None
) -> LyapunovExponent:
    """The exponent from the logarithms of a difference's growth in each interval, shape (S,)."""
    each, duration = growth.size // blocks, step * growth.size
    t = step * np.arange(1.0, growth.size + 1.0)
    means = growth.reshape(blocks, each).mean(axis=1) / step
    value = float(means.mean())
    standard = float(means.std(ddof=1)) / math.sqrt(blocks)
    half = blocks // 2
    drift = 0.5 * abs(float(means[:half].mean() - means[-half:].mean()))
    # The length of the difference oscillates with the motion, and its phase at the end is random.
    oscillation = float(np.ptp(np.cumsum(growth) - value * t)) / duration
    return LyapunovExponent(
        value=value,
        spread=max(standard, drift, oscillation),
        blocks=means,
        t=t,
        history=np.cumsum(growth) / t,
        duration=duration,
        end=end,
        pipe=pipe,
    )


def pooled(before: LyapunovExponent, later: LyapunovExponent) -> LyapunovExponent:
    """The exponent over two times of the same motion, with the later one's intervals and blocks."""
    both = [np.diff(one.history * one.t, prepend=0.0) for one in (before, later)]
    step, blocks = float(later.t[0]), later.blocks.size
    return _from_growth(np.concatenate(both), step, blocks, later.end, later.pipe)


@dataclass(frozen=True)
class _PairTask(Task):
    """A motion that is integrated together with a neighbour, or whose states are known.

    Attributes:
        path: states at the start of each interval and at the end, shape (S + 1, 2 integrated).
    """

    path: Array | None = None


def exponents_together(
    model: Model,
    speeds: Sequence[float | Pulsation],
    paths: Sequence[Array],
    duration: float,
    transient: float,
    blocks: int = 10,
    interval: float = 0.5,
    base: Base | None = None,
    forces: tuple[Force, ...] = (),
    driven: bool = False,
    alone: bool = False,
    shown: bool = False,
) -> list[LyapunovExponent | MotionStopped]:
    """The largest exponents of motions, computed as one ensemble.

    Each of the paths is the state [p, p'] at which a motion starts, (2 integrated,), or states that
    are known, an interval apart, shape (S + 1, 2 integrated). Only the neighbours of motions with
    known states are integrated, beside the last of these; where they are few, first the transient
    is shortened, then the duration.

    If the flow pulsates, the base moves or forces act (`driven`), all motions have the same forcing
    and begin at the start of a period. The interval must be a multiple of that period, and the
    duration is rounded up to whole intervals, as with known states.

    Each motion is followed together with a neighbour. Those of an ensemble end early if the
    exponent over the later half of their time so far is above 0 by BEYOND_DOUBT spreads; this
    exponent is then the answer. With `alone`, for a single motion that is not driven, it goes on to
    its end and is computed with smaller errors.

    Raises:
        NotConverged: with `alone`, if the difference changes too fast to be followed.
    """
    apart, error = (CLOSE, 1e-6 * CLOSE) if alone else (APART, 1e-3 * APART)
    each, known = max(math.ceil(duration / blocks / interval), 1), paths[0].ndim == 2
    if known:
        each = min(each, (len(paths[0]) - 1) // blocks)
        most = math.ceil(transient / interval) + blocks * each + 1
        paths = [path[-most:] for path in paths]
        transient = interval * (len(paths[0]) - 1 - blocks * each)
    step = interval if driven or known else duration / blocks / each
    starts = [np.atleast_2d(path)[0] for path in paths]
    p, rates = np.split(starts[0], 2)
    first = checked_task(
        *(model, speeds[0], step, p, rates),
        times=[step],
        rtol=error,
        atol=error,
        base=base,
        forces=forces,
        # One member takes implicit steps, which follow a difference that decays with a hundredth
        # of the error of explicit ones.
        members=1 if alone else (1 if known else 2) * len(paths),
    )
    pair = _PairTask(**vars(first))
    tasks = [
        replace(pair, u=u, start=y, path=path if known else None)
        for u, y, path in zip(speeds, starts, paths, strict=True)
    ]
    # All intervals of a batch are one job: a job for each of them takes twice as long.
    measured = partial(
        _measured,
        apart=apart,
        transient=transient,
        blocks=blocks,
        each=each,
        alone=alone,
        progress=shown,
    )
    return [found for (found,) in in_batches(tasks, measured, members=BATCH // 2)]


def _measured(
    tasks: Sequence[_PairTask],
    shown: bool,
    observer: Observer,
    apart: float,
    transient: float,
    blocks: int,
    each: int,
    alone: bool,
    progress: bool,
) -> list[tuple[LyapunovExponent | MotionStopped]]:
    """The largest exponents of the motions of a batch, each from its own start.

    Each is in a tuple, since an exception by itself would be the failure of the whole batch.

    Args:
        tasks: motions over one interval.
        shown: as for `integrate`.
        observer: as for `integrate`.
        apart: distance of neighbours at the start of each interval.
        transient: time before the exponent is measured.
        blocks: number of blocks.
        each: number of intervals in a block.
        alone: as for `exponents_together`.
        progress: whether to count intervals on stderr.
    """
    model, step, size = tasks[0].model, float(tasks[0].times[0]), tasks[0].start.size
    before = math.ceil(transient / step - 1e-9)
    followed = 2 if tasks[0].path is None else 1  # number of motions that are integrated
    here = np.array([task.start for task in tasks])
    beside = [np.split(y + apart * _any_direction(size), 2) for y in here]
    away = np.array([np.concatenate(model.onto_constraints(*pair)) for pair in beside]) - here
    away *= apart / np.linalg.norm(away, axis=1, keepdims=True)
    growth = np.zeros((before + blocks * each, len(tasks)))
    answers = dict[int, LyapunovExponent | MotionStopped]()
    for i in track(range(len(growth)), len(growth), "exponent", progress):
        going = [k for k in range(len(tasks)) if k not in answers]
        if not going:
            break
        starts = [(k, y) for k in going for y in (here[k], here[k] + away[k])[-followed:]]
        pairs = [replace(tasks[k], start=y) for k, y in starts]
        outcomes = integrate(pairs, shown, observer)
        for place, k in enumerate(going):
            both, path = slice(followed * place, followed * (place + 1)), tasks[k].path
            for task, outcome in zip(pairs[both], outcomes[both], strict=True):
                if outcome[2] is not None:
                    [(motion, why)] = assembled([task], [outcome])
                    answers[k] = MotionStopped(f"the motion stopped: {why}", motion)
            if k in answers:
                continue
            one, other = (outcomes[both][end][0][-1, :size] for end in (0, -1))
            if path is not None:
                one = path[i + 1]
            one = model._alike(np.zeros(size), one)  # with the fewest turns
            other = model._alike(one, other)
            here[k], distance = one, float(np.linalg.norm(other - one))
            if alone and not apart / PARTED < distance < apart * PARTED:
                if len(growth) > 0.25 * MOST_INTERVALS:
                    raise NotConverged("neighbouring motions part or meet in no time")
                shorter = [replace(task, times=0.25 * task.times) for task in tasks]
                given = shorter, shown, observer, apart, transient, blocks, 4 * each
                return _measured(*given, alone, progress)
            growth[i, k] = math.log(distance / apart)
            away[k] = (other - one) * (apart / distance)
            half = (i + 1) // (2 * blocks) * blocks
            if half and not alone and (i + 1) % (2 * blocks) == 0:
                late = _from_growth(growth[i + 1 - half : i + 1, k], step, blocks, one, model.pipe)
                if late.value > BEYOND_DOUBT * late.spread:
                    answers[k] = late
    return [
        (answers.get(k) or _from_growth(growth[before:, k], step, blocks, here[k], model.pipe),)
        for k in range(len(tasks))
    ]
