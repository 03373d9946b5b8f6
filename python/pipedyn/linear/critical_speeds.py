# SPDX-License-Identifier: MIT
"""Critical speeds of one model for many values of its pipe's numbers, as arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent import futures
from dataclasses import field
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.linear.critical_speed import (
    CriticalPointIfAny,
    checked_end,
    first_losses,
    only_answer,
    unstable_at_rest,
)
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.continuum import AnyModel, checked_model
from pipedyn.models.pipe_numbers import checked_number, pipe_numbers
from pipedyn.models.scales import scales_at
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import warn_of_plane
from pipedyn.util.parallel import batches, outcome_of, parallel
from pipedyn.util.result import SPEED, TableResult

PIPES_IN_A_TASK = 1024
"""Largest number of pipes in a call of the core, which is a task of an executor: of ten segments a
task then takes some 0.4 s, the client of a cluster 3 % of that, and their models a few MB."""

LEAST_TASKS = 64
"""Least number of tasks of an executor that has enough pipes for them, so that hundreds of pipes
already make use of several workers."""

MOST_PIPES = 100_000_000
"""Largest number of pipes in one call; the result takes some 60 bytes for each."""


@saved_as("CriticalSpeeds", added=("across",))
class CriticalSpeeds(TableResult, units=dict.fromkeys(("speeds", "errors", "max_speed"), SPEED)):
    """Critical speeds of one model for many values of its pipe's numbers.

    Arrays have the shape to which the given values broadcast, here called S.

    Attributes:
        model: the model whose pipe's numbers were varied.
        numbers: values of the numbers by their names, each of shape S.
        speeds: critical speeds, shape S; NaN where there is none, or the point failed.
        frequencies: their angular frequencies, shape S; NaN likewise.
        errors: absolute errors of the speeds, shape S; NaN likewise.
        modes: numbers of the modes that lose stability, shape S; 0 likewise.
        divergent: whether stability is lost by divergence, not by flutter, shape S.
        unstable_before: numbers of unstable roots below the critical speed, shape S. Where there is
            no critical speed, the number of roots that grow at rest.
        failures: the points that failed, with their exceptions. The index of a point is that in
            arrays made flat, such as `speeds.flat`, and its value that of the first number. A pipe
            that does not lose stability up to `max_speed` is no failure.
        max_speed: flow speed at which the searches ended.
        across: of a model in three dimensions whose pipe is bent by a load or has terms that differ
            in x and z, whether the motions that lose stability are across the plane z = 0, shape S;
            None for other models.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=10)
        >>> numbers = {"beta": [[0.2], [0.4]], "gamma": [0.0, 10.0, 50.0]}
        >>> found = pp.critical_speeds(chain, numbers)
        >>> found.speeds.round(3)
        array([[ 5.486,  6.247,  9.215],
               [ 8.453,  8.873, 10.584]])
    """

    model: AnyModel
    numbers: dict[str, Array] = field(repr=False)
    speeds: Array
    frequencies: Array
    errors: Array = field(repr=False)
    modes: NDArray[np.int64] = field(repr=False)
    divergent: NDArray[np.bool_] = field(repr=False)
    unstable_before: NDArray[np.int64] = field(repr=False)
    failures: tuple[Failure, ...]
    max_speed: float
    across: NDArray[np.bool_] | None = field(default=None, repr=False)

    def _shown(self) -> dict[str, Any]:
        return {"model": self.model, "numbers": tuple(self.numbers)} | super()._shown()

    def _columns(self) -> dict[str, Any]:
        failed = {one.index: str(one.error) for one in self.failures}
        kinds = np.where(self.divergent, "divergence", "flutter")
        columns = {
            **self.numbers,
            "speed": self.speeds,
            "frequency": self.frequencies,
            "kind": np.where(np.isnan(self.speeds), "", kinds),
            "mode": self.modes,
            "unstable_before": self.unstable_before,
            "error": self.errors,
        }
        if self.across is not None:
            columns["across"] = self.across
        flat = {name: values.ravel() for name, values in columns.items()}
        return flat | {"failure": [failed.get(i, "") for i in range(self.speeds.size)]}

    def _scales(self) -> Any:
        """SI scales of the pipe; if beta varies, on which the unit of speed depends, of each."""
        scales = self.model.pipe.scales
        if scales is None or "beta" not in self.numbers:
            return scales
        return scales_at(self.numbers["beta"], scales)

    def _scales_of_rows(self, scales: Any) -> Any:
        return type(scales)(*map(np.ravel, scales))


Answers: TypeAlias = tuple[Array, dict[int, Exception]]
"""A row of quantities of each of some pipes, and the exceptions of those that failed, by row."""

ROW_LENGTH = 8
"""Number of quantities: speed, frequency, error of the speed, mode, whether the pipe diverges,
whether the motion is across the plane of rest, whether a load bends the pipe at rest, and number of
unstable roots below the speed."""


def critical_speeds(
    model: AnyModel,
    numbers: Mapping[str, ArrayLike],
    max_speed: float = 100.0,
    executor: futures.Executor | None = None,
    progress: bool = False,
) -> CriticalSpeeds:
    """Critical speeds of one model for many values of its pipe's numbers.

    This is `critical_speed` for maps of up to a hundred million pipes: the answers are arrays, and
    sensitivities are left out. Pipes are searched in batches, which the core shares among the
    processors that the process may use; with an executor, batches are its tasks. Neither changes
    the answers. Neighbouring chains share a part of their searches, as in `stability_curve`.

    Args:
        model: chain, reduced model or `Continuum` with the numbers that do not vary. Springs,
            masses and lengths of segments remain as they are.
        numbers: values by the names of the pipe's numbers: "beta", "gamma", "damping", ...,
            "root.stiffness" and those of terms, such as "terms[0].mass", or "PointMass.mass" of the
            only term of that kind. Values are broadcast against each other as by numpy.
        max_speed: end of each search, in sqrt(EI / mu_f) / L.
        executor: a `concurrent.futures.Executor` that computes the batches. Pipes of a batch
            without an answer, because a worker died or the executor is broken or shut down, fail.
        progress: whether to show progress on stderr.

    Returns:
        CriticalSpeeds; a pipe that fails is recorded in `failures` and the others are kept.

    Example:
        >>> pipe = pp.Pipe(0.2, terms=[pp.PointMass(at=1.0, mass=0.1)])
        >>> found = pp.critical_speeds(pp.Chain(pipe, n=10), {"PointMass.mass": [0.0, 0.1, 0.2]})
        >>> found.speeds.round(3)
        array([5.486, 4.147, 3.35 ])
        >>> found.modes
        array([2, 2, 2])

    Raises:
        ValueError, TypeError: for arguments out of range or of a wrong type, or values that do not
            broadcast.
    """
    checked_model(model)  # whose answer depends on the numbers
    end = checked_end(max_speed, model)
    check.executor("executor", executor)
    check.flag("progress", progress)
    values = _checked_values(model, numbers)
    shape = next(iter(values.values())).shape
    points = np.stack([one.ravel() for one in values.values()], axis=-1)
    least = LEAST_TASKS if executor is not None or progress else 1
    parts = batches(len(points), PIPES_IN_A_TASK, least)
    jobs = [partial(_answers, model, tuple(values), points[part], end) for part in parts]
    rows = np.full((len(points), ROW_LENGTH), math.nan)
    failures = []
    done = parallel(jobs, executor, label="critical speeds", progress=progress)
    for part, answers in zip(parts, done, strict=True):
        if isinstance(answers, Exception):
            failed = dict.fromkeys(range(len(part)), answers)
        else:
            rows[part], failed = answers
        for k, error in failed.items():
            failures.append(Failure(part[k], float(points[part[k], 0]), error))
    speeds, frequencies, errors, *others = rows.T.reshape(ROW_LENGTH, *shape).copy()
    others = [np.nan_to_num(one).astype(np.int64) for one in others]
    modes, divergent, across, bent, unstable = others
    if model.dimensions == 2 and bent.any():
        warn_of_plane(__name__)
    return CriticalSpeeds(
        model,
        values,
        speeds,
        frequencies,
        errors,
        modes,
        divergent.astype(np.bool_),
        unstable,
        tuple(failures),
        end,
        across.astype(np.bool_) if model.dimensions == 3 else None,
    )


def _checked_values(model: AnyModel, numbers: Any) -> dict[str, Array]:
    """The values of each number, in its range, in their common shape."""
    if not isinstance(numbers, Mapping) or not numbers:
        raise TypeError(
            f"numbers must map names of the pipe's numbers to values, got {check.shown(numbers)}"
        )
    given = {}
    for name, values in numbers.items():
        argument = f"numbers[{name!r}]"
        number = checked_number("numbers", name, model.pipe, others=())
        raw = check.numbers(argument, values, "an array of real numbers", longest=MOST_PIPES)
        flat = check.array(argument, raw.ravel(), longest=MOST_PIPES, **number.rule)
        given[name] = flat.reshape(raw.shape)
    try:
        shape = np.broadcast_shapes(*(one.shape for one in given.values()))
    except ValueError:
        shapes = ", ".join(f"{one.shape} of {name!r}" for name, one in given.items())
        raise ValueError(
            f"numbers must broadcast against each other, got shapes {shapes}; numpy.ix_ gives all "
            "combinations"
        ) from None
    if math.prod(shape) > MOST_PIPES:
        raise ValueError(f"numbers must make at most {MOST_PIPES} pipes, got shape {shape}")
    return {name: np.broadcast_to(one, shape) for name, one in given.items()}


def _answers(model: AnyModel, names: Sequence[str], points: Array, max_speed: float) -> Answers:
    """Answers for the pipes with these numbers, shape (rows, numbers), in one call of the core."""
    known = pipe_numbers(model.pipe)
    numbers = [known[name] for name in names]

    def model_at(values: list[float]) -> AnyModel:
        pipe = model.pipe
        for number, value in zip(numbers, values, strict=True):
            pipe = number.changed(pipe, value)
        return checked_model(model.with_pipe(pipe))

    outcomes: list[Any] = [outcome_of(model_at, row) for row in points.tolist()]
    made = [i for i, one in enumerate(outcomes) if not isinstance(one, Exception)]
    models = [outcomes[i] for i in made]
    points_found = first_losses(models, max_speed, sensitive=False)
    for i, model_there, point in zip(made, models, points_found, strict=True):
        outcomes[i] = outcome_of(_quantities, model_there, point)
    failed = {i: one for i, one in enumerate(outcomes) if isinstance(one, Exception)}
    rows = [[math.nan] * ROW_LENGTH if i in failed else one for i, one in enumerate(outcomes)]
    return np.array(rows), failed


def _quantities(model: AnyModel, point: CriticalPointIfAny | Exception) -> list[float]:
    """The quantities of a pipe from its critical point; raises the exception of one that failed."""
    critical, crossings = only_answer([point])
    bent = not model.pipe.rests_straight
    if critical is None:
        return [math.nan] * (ROW_LENGTH - 2) + [bent, unstable_at_rest(model, crossings)]
    diverges, across = critical.kind == "divergence", bool(critical.across)
    found = [critical.speed, critical.frequency, critical.error, critical.mode, diverges, across]
    return [*found, bent, critical.unstable_before]
