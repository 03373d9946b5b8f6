# SPDX-License-Identifier: MIT
"""The continuous pipe: a reduced model grown until the answer asked for converges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipedyn.models.base import Model, OfPipe
from pipedyn.models.galerkin import LARGEST_BASIS, Galerkin, basis_joints, enriched
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.errors import NotConverged

Reply = TypeVar("Reply")

SMALLEST, LARGEST = 16, 400
"""Sizes between which the basis grows: measured, 16 functions hold the four lowest modes to 2e-12
at u = 5 and to 3e-10 at u = 9 with gamma = 10; 300 hold the 113 modes that cross the axis below
u = 20 where a heavy mass all but pins the free end."""

TOLERANCE = 1e-10
"""Relative distance at which two answers count as one, where no other is asked for."""

FUNCTIONS_A_JOINT, MOST_A_JOINT = 4, 8
"""By which the smallest and the largest are larger for each joint between panels: a panel needs
four, see basis.hpp, and ten were needed for the lowest modes of fifty equal spans to 1e-10."""


@dataclass(frozen=True)
class Converged(Generic[Reply]):
    """An answer that converged: its value at the larger of the last two sizes.

    Its error is the relative change from the size before, a bound where convergence is exponential;
    0 of a model of one size.
    """

    value: Reply
    size: int
    error: float


@saved_as("Continuum", former={"_pipe": "pipe"})
class Continuum(OfPipe):
    """The continuous pipe (the partial differential equation), for linear questions.

    It answers with Legendre reduced models of growing size: `pipedyn.eigenvalues`, `modes`,
    `root_loci`, `crossings`, `critical_speed` and `stability_curve` take it like any other model
    and report size and error where their results have a place for them.

    Args:
        pipe: the pipe, with its terms.

    Example:
        >>> pipe = pp.Continuum(pp.Pipe(0.2))
        >>> round(pp.critical_speed(pipe).speed, 9)
        5.591404378
        >>> pipe.frozen(12)
        Galerkin(Pipe(beta=0.2), m=12, basis='legendre')

    Raises:
        TypeError: for what is no pipe.
        ValueError: for a pipe that an inclined jet bends.

    Source: Gregory and Paidoussis (1966).
    """

    def __init__(self, pipe: Pipe) -> None:
        super().__init__(pipe)
        if pipe.thrust_across:
            raise ValueError(
                "Continuum answers linear questions about the straight pipe, which is no "
                f"equilibrium with jet_angle = {pipe.jet_angle:.6g}: ask equilibria, or "
                "equilibrium_branch for its onset, of a Chain or a Galerkin model; relevant, trade "
                "and choose of a motion or a limit cycle"
            )

    def with_pipe(self, pipe: Pipe) -> Continuum:
        """Another, of another pipe; raises as for `Continuum`."""
        return Continuum(pipe)

    def __repr__(self) -> str:
        return f"Continuum({self._pipe!r})"

    def frozen(self, m: int) -> Galerkin:
        """The reduced model with m Legendre functions; m and errors as for `Galerkin`."""
        return Galerkin(self._pipe, m, "legendre")

    def converge(
        self,
        question: Callable[[Galerkin], Reply],
        distance: Callable[[Reply, Reply], float],
        tolerance: float = TOLERANCE,
        smallest: int = SMALLEST,
        largest: int = LARGEST,
    ) -> Converged[Reply]:
        """The answer to a question, from a basis grown until it converges.

        Args:
            question: asked of reduced models of growing size.
            distance: relative distance between two answers; infinite where they differ in kind.
            tolerance: distance between the last two answers at which they count as one, > 0.
            smallest: first size, from 1 to 1992.
            largest: last size, up to 2000, or one step above the first. Supports and terms inside
                the pipe, and steps of its stiffness or mass, add four to the first and eight to
                the last for each joint that they make.

        Raises:
            NotConverged: if it has not converged at the last size; carries the last answer.
            ValueError, TypeError: for bad arguments.
        """
        for name, given in (("question", question), ("distance", distance)):
            if not callable(given):
                raise TypeError(f"{name} must be a function, got {check.shown(given)}")
        return converged_ahead(
            self, lambda one, _: (question(one), None), distance, tolerance, smallest, largest
        )


AnyModel: TypeAlias = Model | Continuum


def converged_ahead(
    model: Continuum,
    question: Callable[[Galerkin, Galerkin | None], tuple[Reply, Reply | None]],
    distance: Callable[[Reply, Reply], float],
    tolerance: float = TOLERANCE,
    smallest: int = SMALLEST,
    largest: int = LARGEST,
) -> Converged[Reply]:
    """Asks a question of reduced models of growing size until two answers agree.

    `Continuum.converge` says what the arguments are, but the question is asked of a model and the
    next larger one, None after the last. It answers for both, or with None for the larger, which is
    then asked itself. Where it answers None for the smaller the basis grows the faster.
    """
    tolerance = check.real("tolerance", tolerance, low=0.0, open_low=True)
    smallest = check.count("smallest", smallest, high=LARGEST_BASIS - 8)
    largest = check.count("largest", largest, high=LARGEST_BASIS)
    inner = basis_joints(model.pipe).size
    size = smallest = min(smallest + FUNCTIONS_A_JOINT * inner, LARGEST_BASIS - 8)
    largest = min(largest + MOST_A_JOINT * inner, LARGEST_BASIS)
    last = max(largest, smallest + 8)
    asked, more = model.frozen(size), 0
    answers: list[tuple[Reply, int]] = []

    def following(share: int) -> int:
        """The next size, larger by a share, or the last; no step is shorter than others."""
        step = max(8, 2 * (inner + 1), size // share)
        return last if last - (size + step) < step else size + step

    while True:
        more += 1  # so that every panel has more functions than before
        next_size = following(4)
        larger = None if size == last else enriched(model.frozen(next_size), more)
        answer, ahead = question(asked, larger)
        answers.append((answer, asked.dof))
        if larger is not None and ahead is not None:
            answers.append((ahead, larger.dof))
        for (one, _), (other, of_size) in pairwise(answers):
            error = distance(one, other)
            if not isinstance(error, Real):
                raise TypeError(f"distance must return a number, got {check.shown(error)}")
            if error <= tolerance:
                return Converged(other, of_size, error)
        if larger is None:
            raise NotConverged(
                f"the continuous pipe's answer still moves by {error:.1e} at {size} functions",
                answer,
            )
        asked, answers = larger, [(answer, asked.dof)]
        if answer is None and following(2) > next_size:
            next_size = following(2)
            asked = enriched(model.frozen(next_size), more)
        size = next_size


def checked_model(model: Any) -> AnyModel:
    """The argument, if it is a model."""
    if not isinstance(model, Model | Continuum):
        instead = ": take Continuum(pipe), or Chain(pipe, n)" if isinstance(model, Pipe) else ""
        raise TypeError(f"model must be a Model or a Continuum, got {check.shown(model)}{instead}")
    return model


def answered(
    model: AnyModel,
    speeds: tuple[float, ...],
    question: Callable[[Any], Reply],
    distance: Callable[[Reply, Reply], float],
    **growth: Any,
) -> Converged[Reply]:
    """A question about flow speeds, asked of any model; the rest as for `Continuum.converge`.

    Raises:
        ValueError: if the model cannot rest at a speed, where it is linearised.
    """
    if isinstance(model, Continuum):
        return model.converge(question, distance, **growth)
    model.require_equilibrium(*speeds)
    return Converged(question(model), model.dof, 0.0)


def relative(a: NDArray[Any], b: NDArray[Any], errors: NDArray[Any] | float = 0.0) -> float:
    """Largest distance of two arrays' entries, relative to the entry or 1; inf if shapes differ.

    Counted is what the errors of both together, absolute, do not explain.
    """
    if a.shape != b.shape or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return np.inf
    if a.size == 0:
        return 0.0
    apart = np.maximum(np.abs(a - b) - errors, 0.0)
    return float(np.max(apart / np.maximum(np.abs(b), 1.0)))
