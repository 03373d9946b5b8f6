# SPDX-License-Identifier: MIT
"""Stability curves: critical speeds against any parameter."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from concurrent import futures
from dataclasses import field
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.linear.critical_speed import (
    CriticalPointIfAny,
    CriticalSpeed,
    NoCrossing,
    checked_end,
    critical_points,
    stability_losses,
)
from pipedyn.linear.sensitivity import Crossing, of_each
from pipedyn.models.continuum import AnyModel, checked_model
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import warn_of_plane
from pipedyn.util.parallel import NoCollection, Returned, batches, outcome_of, parallel
from pipedyn.util.result import SPEED, Result, TableResult

LARGEST_BATCH = 256
"""Largest number of models in one call: 256 of 40 segments take 0.3 s; from 16 on calls cost
little."""

BATCHES = 16
"""Least number of batches for an executor, so that several workers have equal shares."""


@saved_as("Failure")
class Failure(Result):
    """A point of a sweep that could not be computed.

    Attributes:
        index: index of the point in the sweep.
        value: value of the parameter at the point.
        error: the exception that was raised.
    """

    index: int
    value: float
    error: Exception


class SweptResult(TableResult):
    """Results at values of a parameter, of which some may have failed.

    A subclass has the results in the field that `_each` names, `failures` and `pipes`.

    Attributes:
        values: values of the parameter, shape (S,).
    """

    _each: ClassVar[str]
    _word: ClassVar[str]  # attribute of results that is a column of words
    _numbers: ClassVar[tuple[str, ...]] = ()  # attributes that are further columns

    values: Array

    @property
    def speeds(self) -> Array:
        """Critical speeds, at which stability is lost, shape (S,); NaN if there is none."""
        return self._of_each("speed")

    def _of_each(self, name: str) -> Array:
        """An attribute of the result at each value, shape (S,); NaN if there is none."""
        return of_each(getattr(self, self._each), name)

    def _columns(self) -> dict[str, Any]:
        own: Any = self
        failed = {one.index: str(one.error) for one in own.failures}
        words = [getattr(one, self._word, "") for one in getattr(self, self._each)]
        return {
            "value": self.values,
            "speed": self.speeds,
            "frequency": self._of_each("frequency"),
            self._word: words,
            **{name: self._of_each(name) for name in self._numbers},
            "failure": [failed.get(index, "") for index in range(len(self.values))],
        }

    def _known_pipes(self) -> list[Any]:
        """The pipe at each value, None if it is not known.

        For results that were saved without pipes (by version 0.2.0), their own pipes are used.
        """
        own: Any = self
        results = getattr(self, self._each)
        return list(own.pipes) or [None if one is None else one._pipe() for one in results]

    def _pipe(self) -> Any:
        return next((one for one in self._known_pipes() if one is not None), None)

    def _scales(self) -> Any:
        """SI scales at each point, as each may have a pipe of its own; None if no point has any."""
        each = [getattr(one, "scales", None) for one in self._known_pipes()]
        known = next((one for one in each if one is not None), None)
        if known is None:
            return None
        missing = (math.nan,) * len(known)
        return type(known)(*np.array([one or missing for one in each]).T)


@saved_as("StabilityCurve")
class StabilityCurve(SweptResult, units=dict.fromkeys(("no_loss_up_to", "max_speed"), SPEED)):
    """Critical speed, and every crossing, against a parameter.

    Attributes:
        values: values of the parameter, shape (S,).
        critical: CriticalSpeed at each value, None if there is none or the point failed.
        crossings: crossings at each value, up to the critical speed if no max_speed was given;
            empty if the point failed.
        failures: the points that failed, with the exceptions that they raised.
        max_speed: speed up to which all crossings were searched, None if it was not given.
        parameter: name of the parameter, which is the argument's name in the function that makes
            the models; empty if that has none.
        pipes: the pipe at each value, None if there is no model.

    Example:
        >>> curve = pp.stability_curve(lambda n: pp.Chain(pp.Pipe(0.2), round(n)), [5, 10, 20])
        >>> curve.speeds.round(3)
        array([5.174, 5.486, 5.565])
        >>> list(curve.columns())[:3]
        ['value', 'speed', 'frequency']
    """

    _each, _word = "critical", "kind"

    critical: tuple[CriticalSpeed | None, ...] = field(repr=False)
    crossings: tuple[tuple[Crossing, ...], ...] = field(repr=False)
    failures: tuple[Failure, ...]
    max_speed: float | None = None
    parameter: str = field(default="", repr=False)
    pipes: tuple[Pipe | None, ...] = field(default=(), repr=False)

    @property
    def no_loss_up_to(self) -> Array:
        """Flow speed up to which no loss of stability was found, shape (S,), NaN elsewhere.

        The pipe is stable up to that speed, unless it is buckled at rest.
        """
        failed = {one.index: one.error for one in self.failures}
        ends = np.full(len(self.values), math.nan)
        for index, one in enumerate(self.critical):
            error = failed.get(index)
            if isinstance(error, NoCrossing):
                ends[index] = error.max_speed
            elif one is None and error is None and self.max_speed is not None:
                ends[index] = self.max_speed
        return ends

    @property
    def frequencies(self) -> Array:
        """Critical frequencies, shape (S,), NaN if there is none."""
        return self._of_each("frequency")

    def _shown(self) -> dict[str, Any]:
        return {"values": self.values, "speeds": self.speeds} | super()._shown()


def stability_curve(
    make_model: Callable[[float], AnyModel],
    values: ArrayLike,
    max_speed: float | None = None,
    executor: futures.Executor | None = None,
    progress: bool = False,
) -> StabilityCurve:
    """Critical speed against any parameter.

    Each point has the answer of `critical_speed`. Neighbouring chains share a part of their
    searches: if two of them flutter by the same mode, and the real parts of their eigenvalues
    differ at lower speeds by at most a quarter of their size, then so do those of the chains
    between them. Of each of these all eigenvalues are computed at a speed next below its critical
    one, where none may be unstable. So many near values take less time each than a few.

    Args:
        make_model: function that makes the model at a value of the parameter. It is called in this
            process, so that it may be a lambda.
        values: values of the parameter, shape (S,).
        max_speed: speed up to which all crossings are collected; by default the search ends at the
            critical speed.
        executor: a `concurrent.futures.Executor` that computes the points in batches. Points
            without an answer, because a worker died or the executor is broken or shut down, fail.
        progress: whether to show progress on stderr.

    Returns:
        StabilityCurve; a point that fails is recorded in `failures` and the others are kept. A pipe
        that stays stable up to a given max_speed is no failure.

    Example:
        >>> curve = pp.stability_curve(lambda beta: pp.Continuum(pp.Pipe(beta)), [0.1, 0.2, 0.5])
        >>> curve.speeds.round(4)
        array([4.7499, 5.5914, 9.3224])

    Raises:
        ValueError, TypeError: for arguments out of range or of a wrong type.
    """
    if max_speed is not None:
        max_speed = checked_end(max_speed)
    solve = critical_points if max_speed is None else partial(stability_losses, max_speed=max_speed)
    at, pipes, answers, failures = sweep(make_model, values, solve, executor, progress)
    none: CriticalPointIfAny = (None, ())
    critical, found = zip(*(none if one is None else one for one in answers), strict=True)
    name = _name_of_argument(make_model)
    return StabilityCurve(at, critical, found, failures, max_speed, name, pipes)


def _name_of_argument(function: Callable[[float], Any]) -> str:
    """Name of a function's first argument, empty if Python does not know it."""
    try:
        return next(iter(inspect.signature(function).parameters), "")
    except ValueError:
        return ""


def sweep(
    make_model: Callable[[float], AnyModel],
    values: ArrayLike,
    solve: Callable[[Sequence[Any]], Sequence[Returned | Exception]],
    executor: futures.Executor | None,
    progress: bool,
    label: str = "stability curve",
    asked: str = __name__,
) -> tuple[Array, tuple[Pipe | None, ...], list[Returned | None], tuple[Failure, ...]]:
    """Results of `solve` for the models at values of a parameter, as for `stability_curve`.

    Returns the values, shape (S,); the pipes, None if there is no model; the results, None if the
    point failed; and the failures, in order. `solve` takes a batch of models and returns a result
    or an exception for each; it must pickle if the executor runs processes. Users called the module
    `asked`, which brings the warning `FluttersAcross`.
    """
    check.instance("make_model", make_model, Callable, "a function of the parameter")
    at = check.array("values", values, longest=100_000)
    check.executor("executor", executor)
    shown = check.flag("progress", progress)

    def model_at(value: float) -> AnyModel:
        return checked_model(make_model(value))

    outcomes: list[Any] = []
    # Within a batch Python does not look for garbage, which takes time among so many results.
    for part in batches(at.size, LARGEST_BATCH, 1):
        with NoCollection():
            outcomes += [outcome_of(model_at, float(at[i])) for i in part]
    pipes = tuple(None if isinstance(one, Exception) else one.pipe for one in outcomes)
    made = [i for i, one in enumerate(pipes) if one is not None]
    if any(outcomes[i].dimensions == 2 and not outcomes[i].pipe.rests_straight for i in made):
        warn_of_plane(__name__, asked)
    least = BATCHES if executor is not None or shown else 1
    parts = [[made[k] for k in part] for part in batches(len(made), LARGEST_BATCH, least)]
    jobs = [partial(solve, [outcomes[i] for i in batch]) for batch in parts]
    done = parallel(jobs, executor, label=label, progress=shown)
    for batch, solved in zip(parts, done, strict=True):
        answered = [solved] * len(batch) if isinstance(solved, Exception) else solved
        for i, one in zip(batch, answered, strict=True):
            outcomes[i] = one
    answers = [None if isinstance(one, Exception) else one for one in outcomes]
    errors = [(i, one) for i, one in enumerate(outcomes) if isinstance(one, Exception)]
    return at, pipes, answers, tuple(Failure(i, float(at[i]), error) for i, error in errors)
