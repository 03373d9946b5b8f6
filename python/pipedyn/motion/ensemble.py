# SPDX-License-Identifier: MIT
"""Many motions at once: members of one model advance together in one batch.

A batch costs one call a right-hand side for all its members, and the call goes through the
processor's vectors. The integrator's steps are common, and its error norm is a mean over the
batch: the tolerance is divided by the root of the number of members, so that each meets its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model
from pipedyn.motion.integrator import MOST_CALLS, Task, integrate
from pipedyn.motion.simulate import (
    LARGEST_SAMPLES,
    Motion,
    MotionStopped,
    Start,
    checked_model_in_motion,
    checked_task,
    motion_of,
)
from pipedyn.util import check
from pipedyn.util.parallel import parallel
from pipedyn.util.result import result

LARGEST_ENSEMBLE = 1_000_000
"""Members, each of which takes a kilobyte before anything is computed."""

BATCH = 64
"""Members of a batch: measured, the cost of a member falls little beyond."""


@result
class MemberFailure:
    """A member whose motion stopped.

    Attributes:
        index: of the member.
        error: why, with the motion up to there.
    """

    index: int
    error: MotionStopped


@result
class Ensemble:
    """Motions of many members.

    Attributes:
        motions: one a member, in order; of one that failed, up to where it stopped.
        failures: the members that stopped early.
    """

    motions: tuple[Motion, ...] = field(repr=False)
    failures: tuple[MemberFailure, ...]

    def __len__(self) -> int:
        return len(self.motions)


def simulate_many(
    models: Model | Sequence[Model],
    speeds: float | ArrayLike,
    duration: float,
    q0: Start | Sequence[Start],
    qdot0: ArrayLike | Sequence[ArrayLike] | None = None,
    *,
    samples: int | None = None,
    times: ArrayLike | None = None,
    rtol: float = 1e-6,
    atol: float | None = None,
    method: str = "auto",
    most: float = MOST_CALLS,
    executor: Executor | None = None,
    progress: bool = False,
) -> Ensemble:
    """Motions of many members, which may differ in model, flow speed and initial state.

    Whatever is given once holds for all members; what is given k times, for each its own. Members
    with the same model object are integrated in batches where the method is "dop853".

    Args:
        models: one model or k.
        speeds: flow speed >= 0, a number or shape (k,).
        duration: in T, from 1e-12 to 1e9.
        q0: initial coordinates (dof,) or an angle theta(s), as for `simulate`; or k of them, e.g.
            shape (k, dof).
        qdot0: initial rates, shape (dof,) or k of them; at rest where not given.
        samples: number of evenly spaced samples, as for `simulate`.
        times: samples at these times instead.
        rtol: relative tolerance of the error of each member's steps.
        atol: absolute tolerance; rtol / 100 where not given.
        method: as for `simulate`.
        most: right-hand sides that each batch may take, as for `simulate`.
        executor: a `concurrent.futures.Executor`; batches are its tasks.
        progress: show progress on stderr.

    Returns:
        Ensemble; a member that stops early is reported in `failures`, the others are kept.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    chosen = list(models) if isinstance(models, Sequence) else [models]
    for i, model in enumerate(chosen):
        checked_model_in_motion(model, f"models[{i}]" if isinstance(models, Sequence) else "models")
    at = np.atleast_1d(check.numbers("speeds", speeds, "a number or an array of real numbers"))
    if at.ndim != 1:
        raise ValueError(f"speeds must be a number or one-dimensional, got shape {at.shape}")
    at = check.array("speeds", at, low=0.0, high=LARGEST_SPEED)
    starts, rates = _each("q0", q0), _each("qdot0", qdot0)
    given: dict[str, Any] = {"models": chosen, "speeds": at, "q0": starts, "qdot0": rates}
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
    tasks = []
    methods: dict[int, str] = {}
    for i in range(members):
        model, u, start, rate = (values[i % len(values)] for values in given.values())
        try:
            task = checked_task(
                *(model, u.item(), duration, start, rate),
                *(samples, times, rtol, atol, methods.get(id(model), method), most),
            )
        except (ValueError, TypeError) as error:
            raise type(error)(f"{error} (member {i})") from error
        methods[id(model)] = task.method
        tasks.append(task)
    if sum(task.times.size * task.model.coordinates for task in tasks) > LARGEST_SAMPLES:
        raise ValueError(f"samples must ask for at most {LARGEST_SAMPLES} numbers in all members")
    blocks = _blocks(tasks)
    jobs = [partial(_motions, [tasks[i] for i in block]) for block in blocks]
    answers = parallel(jobs, executor, label="batches", progress=shown)
    motions: list[Any] = [None] * members
    failures = []
    for block, found in zip(blocks, answers, strict=True):
        if isinstance(found, Exception):
            found.add_note(f"in the motions of members {', '.join(map(str, block))}")
            raise found
        for i, (motion, why) in zip(block, found, strict=True):
            motions[i] = motion
            if why is not None:
                message = f"member {i} stopped {motion.reached}: {why}"
                failures.append(MemberFailure(i, MotionStopped(message, motion)))
    return Ensemble(tuple(motions), tuple(sorted(failures, key=lambda failure: failure.index)))


def _each(name: str, given: Any) -> list[Any]:
    """What is given for each member, or once: a list of k, or of 1."""
    if given is None or callable(given):
        return [given]
    if isinstance(given, Sequence) and not isinstance(given, str) and len(given):
        if all(callable(one) or np.ndim(one) == 1 for one in given):
            return list(given)
        return [given]
    if isinstance(given, np.ndarray) and given.ndim == 2:
        if not len(given):
            raise ValueError(f"{name} must not be empty, got shape {given.shape}")
        return list(given)
    return [given]


def _blocks(tasks: list[Task]) -> list[list[int]]:
    """Members to integrate together: of one model and an explicit method, up to BATCH."""
    groups: dict[tuple[int, str], list[int]] = {}
    for i, task in enumerate(tasks):
        groups.setdefault((id(task.model), task.method), []).append(i)
    blocks = []
    for (_, method), members in groups.items():
        parts = math.ceil(len(members) / BATCH) if method == "dop853" else len(members)
        blocks += [part.tolist() for part in np.array_split(np.array(members), parts)]
    return blocks


def _motions(tasks: list[Task]) -> list[tuple[Motion, str | None]]:
    """Motion of each member of a batch, and why it stopped early.

    A batch that stops is halved, unless it took all the right-hand sides that it may.
    """
    first, count = tasks[0], len(tasks)
    if count == 1:
        rows, evaluations, why = integrate(first)
        return [(motion_of(first, rows, evaluations), why)]
    together = replace(
        first,
        u=np.array([float(task.u) for task in tasks]),
        start=np.stack([task.start for task in tasks], axis=1),
        rtol=max(first.rtol / math.sqrt(count), 1e-14),
        atol=first.atol / math.sqrt(count),
    )
    rows, evaluations, why = integrate(together)
    if why is not None and evaluations < first.most:
        return _motions(tasks[: count // 2]) + _motions(tasks[count // 2 :])
    return [
        (motion_of(task, rows[:, :, j].copy(), evaluations), why) for j, task in enumerate(tasks)
    ]
