# SPDX-License-Identifier: MIT
"""The continuous pipe: reduced models of growing size, until an answer converges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from numbers import Real
from typing import Any, Generic, Literal, TypeAlias, TypeVar

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
"""Smallest and largest basis: as measured, 16 functions give the four lowest modes to 2e-12 at u =
5 and to 3e-10 at u = 9 with gamma = 10; 300 functions give the 113 modes that cross the axis below
u = 20 if a heavy mass nearly pins the free end."""

TOLERANCE = 1e-10
"""Default relative distance below which two answers count as equal."""

FUNCTIONS_A_JOINT, MOST_A_JOINT = 4, 8
"""Additions to the smallest and largest basis for each joint between panels: a panel needs four
functions, see basis.hpp, and the lowest modes of fifty equal spans needed ten to reach 1e-10."""


@dataclass(frozen=True)
class Converged(Generic[Reply]):
    """A converged answer: its value at the larger of the last two sizes of the basis.

    Its error is the relative change from the smaller size, which is a bound if convergence is
    exponential; the error is 0 for a model of one size.
    """

    value: Reply
    size: int
    error: float


@saved_as("Continuum")
class Continuum(OfPipe):
    """The continuous pipe (the partial differential equation), for linear questions.

    Legendre reduced models of growing size compute the answers, each about its own rest if a load
    bends the pipe. `pipedyn.eigenvalues`, `modes`,
    `root_loci`, `crossings`, `critical_speed` and `stability_curve` accept it like any other model
    and report size and error if their results have fields for them.

    Args:
        pipe: the pipe, with its terms.
        dimensions: 2 for small motions in the plane in which a load bends the pipe; 3 for those
            across that plane as well.

    Example:
        >>> pipe = pp.Continuum(pp.Pipe(0.2))
        >>> round(pp.critical_speed(pipe).speed, 9)
        5.591404378
        >>> pipe.frozen(12)
        Galerkin(Pipe(beta=0.2), m=12, basis='legendre')
        >>> level = pp.Pipe(0.2, gamma=10.0, inclination=np.pi / 2)
        >>> found = pp.critical_speed(pp.Continuum(level, dimensions=3))
        >>> round(found.speed, 6), found.across
        (5.779702, True)

    Raises:
        TypeError: for an argument that is not a pipe.
        ValueError: for other dimensions than 2 and 3.

    Source: Gregory and Paidoussis (1966).
    """

    def __init__(self, pipe: Pipe, dimensions: Literal[2, 3] = 2) -> None:
        super().__init__(pipe)
        self._dimensions: Any = check.count("dimensions", dimensions, low=2, high=3)
        if dimensions != 2:
            # A small model refuses pipes that have no equations in three dimensions.
            self.frozen(basis_joints(pipe).size + 2)

    def archived(self) -> dict[str, Any]:
        """Fields that a file stores: the constructor's arguments."""
        return super().archived() | ({} if self._dimensions == 2 else {"dimensions": 3})

    @property
    def dimensions(self) -> Literal[2, 3]:
        """Number of dimensions in which the pipe moves, 2 or 3."""
        return self._dimensions

    @property
    def planar(self) -> Continuum:
        """The continuous pipe that moves in the plane z = 0."""
        return self if self._dimensions == 2 else Continuum(self._pipe)

    @property
    def planes(self) -> tuple[Continuum, ...]:
        """The continuous pipes of the planes z = 0 and x = 0; empty if it is planar or bent."""
        if self._dimensions == 2 or not self._pipe.rests_straight:
            return ()
        return self.planar, Continuum(self._pipe.across())

    def with_pipe(self, pipe: Pipe) -> Continuum:
        """A `Continuum` with another pipe; raises the errors of `Continuum`."""
        return Continuum(pipe, self._dimensions)

    def __repr__(self) -> str:
        return f"Continuum({self._pipe!r}{', dimensions=3' if self._dimensions == 3 else ''})"

    def frozen(self, m: int) -> Any:
        """The reduced model with m Legendre functions, in each plane; as for `Galerkin`."""
        return Galerkin(self._pipe, m, "legendre", dimensions=self._dimensions)

    def converge(
        self,
        question: Callable[[Galerkin], Reply],
        distance: Callable[[Reply, Reply], float],
        tolerance: float = TOLERANCE,
        smallest: int = SMALLEST,
        largest: int = LARGEST,
    ) -> Converged[Reply]:
        """The answer to a question from a basis that grows until the answer converges.

        Args:
            question: function of a reduced model, called with models of growing size.
            distance: relative distance between two answers; infinite if they differ in kind.
            tolerance: distance between the last two answers below which they count as equal, > 0.
            smallest: first size, from 1 to 1992.
            largest: last size, up to 2000, or one step above the first. Supports and terms inside
                the pipe, and jumps of its stiffness or mass, add for each joint between panels four
                functions to the first size and eight to the last.

        Raises:
            NotConverged: if the answer has not converged at the last size; carries the last answer.
            ValueError, TypeError: for arguments out of range or of a wrong type.
        """
        for name, given in (("question", question), ("distance", distance)):
            check.instance(name, given, Callable, "a function")
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

    The arguments are those of `Continuum.converge`, but the question is a function of a model and
    the next larger model (None after the last). It returns the answers for both, or None for the
    larger, which is then asked separately. If it returns None for the smaller, the basis grows
    faster. If the second last model has no answer, the last is not asked, as two must agree.
    """
    tolerance = check.real("tolerance", tolerance, low=0.0, open_low=True)
    smallest = check.count("smallest", smallest, high=LARGEST_BASIS - 8)
    largest = check.count("largest", largest, high=LARGEST_BASIS)
    inner = basis_joints(model.pipe).size
    size = smallest = min(smallest + FUNCTIONS_A_JOINT * inner, LARGEST_BASIS - 8)
    largest = min(largest + MOST_A_JOINT * inner, LARGEST_BASIS)
    last = max(largest, smallest + 8)
    asked, more, error = model.frozen(size), 0, np.inf
    answers: list[tuple[Reply, int]] = []

    def following(share: int) -> int:
        """The next size, larger by 1 / share; the last if the rest is less than this step."""
        step = max(8, 2 * (inner + 1), size // share)
        return last if last - (size + step) < step else size + step

    while True:
        more += 1  # so that every panel gets more functions than before
        next_size = following(4)
        larger = None if size == last else enriched(model.frozen(next_size), more)
        if larger is not None or not answers or answers[-1][0] is not None:
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
                answers[-1][0],
            )
        asked, answers = larger, [(answer, asked.dof)]
        if answer is None and following(2) > next_size:
            next_size = following(2)
            asked = enriched(model.frozen(next_size), more)
        size = next_size


def checked_model(model: Any) -> AnyModel:
    """The model, or of a straight pipe in three dimensions its `planar` model; else a TypeError.

    The small motions of a straight pipe in three dimensions are those of the planar model in two
    planes, so that both models have the same answers. About a bent rest, or if terms differ in x
    and z, small motions across the plane z = 0 differ, so that the model itself is asked.
    """
    if not isinstance(model, OfPipe):  # which both are; an abstract class takes ten times as long
        instead = ": take Continuum(pipe), or Chain(pipe, n)" if isinstance(model, Pipe) else ""
        raise TypeError(f"model must be a Model or a Continuum, got {check.shown(model)}{instead}")
    asked: Any = model
    if model.dimensions == 2 or model.rests_bent or not model.pipe.symmetric_about_axis:
        return asked
    return asked.planar


def converged_answer(
    model: AnyModel,
    speeds: tuple[float, ...],
    question: Callable[[Any], Reply],
    distance: Callable[[Reply, Reply], float],
    **growth: Any,
) -> Converged[Reply]:
    """The answer of any model to a question about flow speeds.

    The other arguments are those of `Continuum.converge`.

    Raises:
        ValueError: if the linearised configuration of the model is no equilibrium at a speed.
    """
    if isinstance(model, Continuum):
        return model.converge(question, distance, **growth)
    model.require_equilibrium(*speeds)
    return Converged(question(model), model.dof, 0.0)


def relative(a: NDArray[Any], b: NDArray[Any], errors: NDArray[Any] | float = 0.0) -> float:
    """Largest relative distance of two arrays' entries; infinite if their shapes differ.

    Each distance is divided by the larger of the entry's size and 1. Before that the absolute
    errors of both arrays together are subtracted from it.
    """
    if a.shape != b.shape or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return np.inf
    apart = np.maximum(np.abs(a - b) - errors, 0.0)
    return float(np.max(apart / np.maximum(np.abs(b), 1.0), initial=0.0))
