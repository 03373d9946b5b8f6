# SPDX-License-Identifier: MIT
"""References: answers of the continuous pipe whose own error is known.

Reduced models grow until two answers agree; by how much they differ bounds the error of the last.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.accuracy.families import Family
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pencil import Vectors
from pipedyn.models.pipe import Pipe
from pipedyn.util.counters import TookTooLong, clock, limited
from pipedyn.util.result import result

EPS = float(np.finfo(float).eps)

LEAST_ERROR = 1e-14
"""Least error that a reference is given: rounding of an eigenvalue or of a quadrature."""

FEWEST, ENOUGH = 16, 40
"""Legendre functions with which a critical speed is searched, from and to: 16 resolve the flutter
of most pipes to 1e-8, and a search with 40 costs as much as the continuous pipe's."""

STEP = 8
"""By how many functions a linear reference grows: some 7 decades of its error."""

ALIKE = 1e-5
"""By how much eight functions more may move an onset, relative: more is another onset."""

MOST_STEPS = 12
"""Of Newton's method; a good guess takes two."""

FARTHEST = 3.0
"""Factor by which the speed may leave its guess."""


@dataclass(frozen=True)
class Onset:
    """An eigenvalue on the imaginary axis.

    Attributes:
        speed: u.
        frequency: angular, in 1 / T.
        error: of the speed, absolute, by residual and rounding.
    """

    speed: float
    frequency: float
    error: float


@result
class Answer:
    """What a model answered.

    Attributes:
        values: numbers, real or complex, of a shape that the quantity sets.
        kind: what must agree besides numbers, as that a loss of stability is flutter.
        error: the solver's own, relative.
        onset: of a critical speed by flutter, where it is looked for in another model.
        damping: delta of the pipe whose roots these are: those that cluster at -1 / delta are not
            distinguished.
        others: roots beyond those asked for, of which one may be the counterpart of a root that
            another model counts among them; of the values' shape but for the last axis.
    """

    values: NDArray[Any]
    kind: str = ""
    error: float = 0.0
    onset: Onset | None = None
    damping: float = 0.0
    others: NDArray[Any] | None = None

    @property
    def candidates(self) -> NDArray[Any]:
        """All roots, those asked for first."""
        if self.others is None:
            return self.values
        return np.concatenate([self.values, self.others], axis=-1)


@dataclass(frozen=True)
class Reference:
    """The continuous pipe's answer.

    Attributes:
        answer: the numbers.
        error: bound on their error, relative: by what the last growth of the model moved them.
        source: which model gave it.
        family: of the models that it grew from, if it did.
    """

    answer: Answer = field(repr=False)
    error: float
    source: str
    family: str = ""


def wave_number(pipe: Pipe, u: float, value: complex) -> float:
    """Largest wave number of motions ~ exp(a s + value tau), in 1 / L."""
    thrust = pipe.centrifugal * u**2 - 0.5 * pipe.gamma
    coriolis = 2.0 * math.sqrt(pipe.beta) * pipe.direction * u * value
    elastic = 1.0 + pipe.damping * value
    return float(np.abs(np.roots([elastic, 0.0, thrust, coriolis, value**2])).max(initial=0.0))


def onset_near(model: Model, speed: float, frequency: float) -> Onset | None:
    """The crossing into flutter next to a speed and a frequency; None where Newton's method fails.

    Args:
        model: any.
        speed: guess of u, > 0.
        frequency: guess of the frequency there.
    """
    problem = eigenproblem(model)
    u, value = speed, complex(0.0, frequency)
    vector: Vectors | None = None
    last = math.inf
    for _ in range(MOST_STEPS):
        pair = problem.refine(u, value, vector)
        assert pair.left is not None
        found = problem.assessed(u, pair)
        slope = complex(found.slopes[0])
        value = complex(pair.values[0])
        if not (slope.real > 0.0 and pair.converged[0]):
            return None
        change = -value.real / slope.real
        if abs(change) <= 1e-14 * u or abs(change) >= last < 1e-9 * u:
            uncertain = float(found.uncertain[0]) + abs(value.real)
            return Onset(u, abs(value.imag), uncertain / slope.real)
        u, value, vector = u + change, value + slope * change, pair.right[:, 0]
        if not speed / FARTHEST < u < speed * FARTHEST or value.imag <= 0.0:
            return None
        last = abs(change)
    return None


def onset_reference(
    pipe: Pipe, more: int, ask: Callable[[Model], Answer], tolerance: float
) -> Reference | None:
    """A critical speed searched in a reduced model, its onset then tracked into larger ones.

    A third of the cost of two searches. None where no onset can be tracked.

    Args:
        pipe: the pipe.
        more: functions that it takes beside, for its terms.
        ask: a model for its critical speed.
        tolerance: bound on the error.
    """
    size = FEWEST + more
    while size <= ENOUGH + more:
        try:
            before = ask(Galerkin(pipe, size, "legendre")).onset
        except PipedynError:
            return None
        if before is None:
            return None
        larger = max(size + STEP, math.ceil(0.8 * before.speed))
        for step in (STEP, 2 * STEP):
            model = Galerkin(pipe, size + step, "legendre")
            onset = onset_near(model, before.speed, before.frequency)
            moved = math.inf if onset is None else abs(onset.speed - before.speed) / onset.speed
            if onset is None or moved > ALIKE:
                break
            error = moved + (before.error + onset.error) / onset.speed + EPS
            if error <= tolerance or step > STEP:
                return Reference(
                    Answer(np.array([onset.speed]), "flutter", error, onset),
                    error,
                    f"search with {size} Legendre functions, tracked to {size + step}",
                )
            before = onset
        size = larger
    return None


def grown_reference(
    pipe: Pipe,
    family: Family,
    sizes: Sequence[int],
    asks: tuple[Callable[[Model], Answer], Callable[[Model], Answer]],
    distance: Callable[[Answer, Answer], float],
    tolerance: float,
    order: float = math.inf,
    seconds: float = math.inf,
) -> Reference:
    """The answer of the first of some models that is as near to the one before as is asked for.

    Args:
        pipe: the pipe.
        family: of the models.
        sizes: of them, growing.
        asks: ask the models by turns.
        distance: of two answers, relative.
        tolerance: bound on the error.
        order: power of the size with which the errors fall at the least: what the last step moved
            may then be less than what remains. Infinite where they fall exponentially.
        seconds: of processor time after which no larger model is asked.

    Raises:
        NotConverged: if the second model has no answer in this time.
        PipedynError: if one of the first two models fails.
    """
    answers: list[Answer] = []
    failed, error = "", math.inf
    end = clock() + seconds if seconds < math.inf else math.inf
    for i, size in enumerate(sizes):
        try:
            with limited(end - clock()) if end < math.inf else nullcontext():
                answers.append(asks[i % 2](family.make(pipe, size)))
        except (TookTooLong, PipedynError) as failure:
            if i < 2 and isinstance(failure, PipedynError):
                raise
            if i < 2:
                raise NotConverged(
                    f"the continuous pipe's answer is not known: of reduced models, the one of "
                    f"{size} {family.name} functions was not done in {seconds:g} s"
                ) from None
            failed = f", as that of {size} failed"
            break
        if i > 0:
            left = max(1.0, 1.0 / ((size / sizes[i - 1]) ** order - 1.0))
            error = left * distance(answers[-2], answers[-1]) + answers[-1].error
        if error <= tolerance:
            break
    return Reference(
        answers[-1],
        max(error, LEAST_ERROR),
        f"Galerkin, {sizes[len(answers) - 1]} {family.name} functions{failed}",
        family.name,
    )
