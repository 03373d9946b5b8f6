# SPDX-License-Identifier: MIT
"""What is asked of a pipe, so that any model's answer can be held against the continuous pipe's.

A quantity asks a model, says how far an answer is from another, relative, and finds a reference: an
answer of the continuous pipe whose own error is known.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.continuum import AnyModel, Continuum
from pipedyn.critical import checked_end, critical_speed
from pipedyn.cycles import LARGEST_CYCLE, limit_cycle
from pipedyn.galerkin import Galerkin
from pipedyn.modal import CONTINUUM_SPEED, modes, root_loci
from pipedyn.model import Model, NotConverged
from pipedyn.motion import simulate
from pipedyn.pipe import Pipe

FIRST, MOST = 8, 20
"""Legendre functions of the first and the last nonlinear reference."""

FIRST_MODES, MOST_MODES = 8, 64
"""The same of beam modes, for pipes whose motion Legendre functions spoil."""


@dataclass(frozen=True)
class Answer:
    """What a model answered.

    Attributes:
        values: numbers, real or complex, of a shape that the quantity sets.
        kind: what must agree besides numbers, as that a loss of stability is flutter.
        error: the solver's own, relative.
    """

    values: NDArray[Any]
    kind: str = ""
    error: float = 0.0


@dataclass(frozen=True)
class Reference:
    """The continuous pipe's answer.

    Attributes:
        answer: the numbers.
        error: bound on their error, relative: what the last growth of the model moved.
        source: which model gave it.
    """

    answer: Answer = field(repr=False)
    error: float
    source: str


class Quantity(ABC):
    """A question to a pipe at given conditions."""

    name: ClassVar[str]

    least: int = 1
    """Degrees of freedom that a model must have to answer."""

    most: ClassVar[int] = 2000
    """Degrees of freedom beyond which models are not asked."""

    growth: ClassVar[float] = 0.0
    """Power of the size with which the cost of an answer grows at the least."""

    @abstractmethod
    def answer(self, model: AnyModel) -> Answer:
        """A model's answer."""

    @abstractmethod
    def distance(self, answer: Answer, other: Answer) -> float:
        """How far one is from another, relative to that; infinite where they differ in kind."""

    @abstractmethod
    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """The continuous pipe's answer, its error below a tolerance where that can be had."""

    def sharpened(self, tolerance: float) -> Quantity:
        """The same, solved so sharply that its own error is no part of a tolerance."""
        return self

    def prepared(self, pipe: Pipe) -> Quantity:
        """The same with what it takes from the pipe itself."""
        return self

    def extrapolated(self, coarse: Answer, fine: Answer, order: float) -> Answer:
        """Richardson's value from models of one and of twice the size."""
        if coarse.kind != fine.kind or coarse.values.shape != fine.values.shape:
            return replace(fine, values=np.full_like(fine.values, np.nan))
        share = 2.0**order - 1.0
        error = fine.error + (fine.error + coarse.error) / share
        return replace(
            fine, values=fine.values + (fine.values - coarse.values) / share, error=error
        )


def _relative(values: NDArray[Any], other: NDArray[Any]) -> float:
    """Largest relative difference of entries, infinite where there is none."""
    if values.shape != other.shape or not np.isfinite(values).all():
        return math.inf
    moved = np.abs(values - other)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(moved == 0.0, 0.0, moved / np.abs(other))
    return float(shares.max(initial=0.0))


def _apart(values: NDArray[Any], other: NDArray[Any]) -> float:
    """Largest difference of roots from those of another set, each with its own, relative.

    Roots smaller than 1 in 1 / T are held against 1.
    """
    cost = np.abs(other[:, None] - values[None, :]) / np.maximum(np.abs(other), 1.0)[:, None]
    if other.size > values.size or not np.isfinite(cost).all():
        return math.inf
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].max(initial=0.0))


# ------------------------------------------------------------------------------- linear questions


@dataclass(frozen=True)
class CriticalSpeedOf(Quantity):
    """The critical speed u_c, relative; infinitely wrong where flutter and divergence are mixed up.

    Attributes:
        max_speed: end of the search.
    """

    name: ClassVar[str] = "critical_speed"
    max_speed: float = 100.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "max_speed", checked_end(self.max_speed))

    def answer(self, model: AnyModel) -> Answer:
        found = critical_speed(model, self.max_speed)
        error = found.error / found.speed if found.speed else 0.0
        return Answer(np.array([found.speed]), found.kind, error)

    def distance(self, answer: Answer, other: Answer) -> float:
        return math.inf if answer.kind != other.kind else _relative(answer.values, other.values)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        found = self.answer(Continuum(pipe))
        return Reference(found, max(found.error, np.finfo(float).eps), "Continuum")


@dataclass(frozen=True)
class Frequencies(Quantity):
    """The eigenvalues of the lowest modes at one flow speed: each matched with its own.

    Attributes:
        u: flow speed.
        count: number of modes.
    """

    name: ClassVar[str] = "frequencies"
    u: float = 0.0
    count: int = 4

    def __post_init__(self) -> None:
        u = _check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "count", _check.count("count", self.count, high=100))

    @property
    def least(self) -> int:  # type: ignore[override]
        return self.count

    def answer(self, model: AnyModel) -> Answer:
        most = 2 * self.count
        if isinstance(model, Model):  # roots of equal size may change places at the end of the row
            most = min(most + 2, 2 * model.dof)
        found = modes(model, self.u, most)
        if not found.converged.all():
            raise NotConverged(f"eigenvalues at u = {self.u:g} failed their residual check", found)
        return Answer(found.eigenvalues, "", found.discretisation or 0.0)

    def distance(self, answer: Answer, other: Answer) -> float:
        return _apart(answer.values, other.values[: 2 * self.count])

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        found = self.answer(Continuum(pipe))
        return Reference(found, max(found.error, 1e-14), "Continuum")


@dataclass(frozen=True)
class RootLociOver(Quantity):
    """The branches of eigenvalues over a range of speeds: the largest error of a root on them.

    Attributes:
        speeds: flow speeds, increasing, shape (S,).
        count: number of branches.
    """

    name: ClassVar[str] = "root_loci"
    speeds: ArrayLike
    count: int = 4

    def __post_init__(self) -> None:
        at = _check.array("speeds", self.speeds, low=0.0, high=CONTINUUM_SPEED, longest=10_000)
        if np.any(np.diff(at) <= 0.0):
            raise ValueError("speeds must be strictly increasing")
        object.__setattr__(self, "speeds", at)
        object.__setattr__(self, "count", _check.count("count", self.count, high=100))

    @property
    def least(self) -> int:  # type: ignore[override]
        return self.count

    def answer(self, model: AnyModel) -> Answer:
        count = self.count  # of another model a branch beyond may be the one in question
        if isinstance(model, Model):
            count = min(self.count + 1, model.dof)
        loci = root_loci(model, self.speeds, count)
        if not loci.converged.all():
            raise NotConverged("eigenvalues on the branches failed their residual check", loci)
        return Answer(np.concatenate([loci.eigenvalues, loci.partners], axis=1))

    def distance(self, answer: Answer, other: Answer) -> float:
        rows = zip(answer.values, other.values, strict=True)
        return max(_apart(values, exact) for values, exact in rows)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        def asked(size: int) -> Answer:
            loci = root_loci(Galerkin(pipe, size, "legendre"), self.speeds, self.count)
            return Answer(np.concatenate([loci.eigenvalues, loci.partners], axis=1))

        assert isinstance(self.speeds, np.ndarray)
        first = max(16, 3 * self.count, math.ceil(float(self.speeds[-1])))
        sizes = [(first + 8 * i, "legendre") for i in range(5)]
        return _grown(self, pipe, sizes, lambda size, _: asked(size), tolerance)


# ---------------------------------------------------------------------------- nonlinear questions


Angle: TypeAlias = Callable[[Array], ArrayLike]

START = 0.05
"""Displacement of the free end, in L, with which a motion starts."""


@dataclass(frozen=True)
class MotionOf(Quantity):
    """The free end over a time: its largest distance from the reference, in the largest excursion.

    Attributes:
        u: flow speed.
        duration: in T.
        start: angle theta(s) of the bent pipe at rest that is let go; where not given, the motion
            sets out on the pipe's least damped mode, of 0.05 L at the free end, which excites no
            others, as a pipe let go does.
        samples: times at which the free end is compared.
        rtol: relative tolerance of the integration.
    """

    name: ClassVar[str] = "motion"
    most: ClassVar[int] = 1000
    growth: ClassVar[float] = 1.5
    u: float
    duration: float
    start: Angle | None = field(default=None, repr=False)
    samples: int = 201
    rtol: float = 1e-8
    rates: Angle | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        u = _check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        duration = _check.real("duration", self.duration, low=1e-6, high=1e6)
        if self.start is not None and not callable(self.start):
            raise TypeError(
                "start must be the angle theta(s) of the bent pipe, so that all models start "
                f"alike, got {_check.shown(self.start)}"
            )
        samples = _check.count("samples", self.samples, low=2, high=100_000)
        rtol = _check.real("rtol", self.rtol, low=1e-12, high=1e-2)
        for name, value in (("u", u), ("duration", duration), ("samples", samples), ("rtol", rtol)):
            object.__setattr__(self, name, value)

    def answer(self, model: AnyModel) -> Answer:
        assert isinstance(model, Model)
        assert self.start is not None
        motion = simulate(
            *(model, self.u, self.duration, self.start),
            qdot0=None if self.rates is None else model.bent(self.rates),
            samples=self.samples,
            rtol=self.rtol,
        )
        return Answer(motion.tip)

    def prepared(self, pipe: Pipe) -> MotionOf:
        if self.start is not None:
            return self
        found = modes(Continuum(pipe), self.u, 8)
        mode = found.shapes[int(np.argmax(found.eigenvalues.real))]
        q = START * mode.coordinates / mode(np.ones(1))[0]
        angle = partial(_slope, mode.model, q.real.copy())
        rates = partial(_slope, mode.model, (mode.eigenvalue * q).real)
        return replace(self, start=angle, rates=rates)

    def distance(self, answer: Answer, other: Answer) -> float:
        excursion = np.hypot(*(other.values - np.array([0.0, 1.0])).T).max()
        if not np.isfinite(answer.values).all():
            return math.inf
        return float(np.hypot(*(answer.values - other.values).T).max() / excursion)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        return _reference_of_motion(self, pipe, max(tolerance, 10.0 * self.rtol))

    def sharpened(self, tolerance: float) -> MotionOf:
        return replace(self, rtol=min(self.rtol, max(0.01 * tolerance, 1e-12)))


@dataclass(frozen=True)
class LimitCycleAt(Quantity):
    """Amplitude and frequency of the limit cycle: the larger relative error.

    Attributes:
        u: flow speed.
        rtol: relative tolerance of the cycle.
    """

    name: ClassVar[str] = "limit_cycle"
    most: ClassVar[int] = LARGEST_CYCLE
    growth: ClassVar[float] = 1.0
    u: float
    rtol: float = 1e-8

    def __post_init__(self) -> None:
        u = _check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED, open_low=True)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "rtol", _check.real("rtol", self.rtol, low=1e-10, high=1e-2))

    def answer(self, model: AnyModel) -> Answer:
        assert isinstance(model, Model)
        cycle = limit_cycle(model, self.u, rtol=self.rtol)
        return Answer(np.array([cycle.amplitude, cycle.frequency]), "", cycle.error)

    def distance(self, answer: Answer, other: Answer) -> float:
        return _relative(answer.values, other.values)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        return _reference_of_motion(self, pipe, max(tolerance, self.rtol))

    def sharpened(self, tolerance: float) -> LimitCycleAt:
        return replace(self, rtol=min(self.rtol, max(0.1 * tolerance, 1e-10)))


def _slope(model: Model, q: Array, s: Array) -> Array:
    """The angle of a reduced model at arc lengths."""
    assert isinstance(model, Galerkin)
    return model.functions(s, 1) @ q


def _reference_of_motion(quantity: Quantity, pipe: Pipe, tolerance: float) -> Reference:
    """From Legendre functions, but of an undamped aspirating pipe from beam modes.

    The highest Legendre functions of such a pipe grow many times faster than the pipe does.
    """
    if pipe.flow == "aspirating" and pipe.damping == 0.0 and pipe.beta > 0.0:
        sizes = [(FIRST_MODES * 2**i, "beam") for i in range(4)]
    else:
        sizes = [(size, "legendre") for size in range(FIRST, MOST + 1, 2)]
    sharp = quantity.sharpened(tolerance)
    return _grown(
        quantity,
        pipe,
        sizes,
        lambda size, basis: sharp.answer(Galerkin(pipe, size, basis)),
        tolerance,
    )


def _grown(
    quantity: Quantity,
    pipe: Pipe,
    sizes: list[tuple[int, str]],
    asked: Callable[[int, str], Answer],
    tolerance: float,
) -> Reference:
    """The answer of the first of some sizes that is as near to the one before as is asked for."""
    answers: list[Answer] = []
    for size, basis in sizes:
        answers.append(asked(size, basis))
        if len(answers) > 1:
            error = quantity.distance(answers[-2], answers[-1]) + answers[-1].error
            if error <= tolerance:
                break
    return Reference(answers[-1], max(error, 1e-14), f"Galerkin, {size} {basis} functions")


# --------------------------------------------------------------------------------- by their names

QUANTITIES: dict[str, type[Quantity]] = {
    kind.name: kind for kind in (CriticalSpeedOf, Frequencies, RootLociOver, MotionOf, LimitCycleAt)
}


def checked_quantity(quantity: Any, settings: dict[str, Any]) -> Quantity:
    """A quantity by its name, with its conditions.

    Raises:
        ValueError: for an unknown name.
        TypeError: for conditions that it does not take, or lacks; and as it says for what is wrong
            with them.
    """
    kind = QUANTITIES[_check.choice("quantity", quantity, tuple(QUANTITIES))]
    known = {one.name: one for one in fields(kind)}  # type: ignore[arg-type]
    listed = ", ".join(known)
    for name in settings:
        if name not in known:
            raise TypeError(f"{quantity!r} takes {listed}, got {_check.shown(name)}")
    signature = inspect.signature(kind)
    missing = [
        name
        for name, one in signature.parameters.items()
        if one.default is inspect.Parameter.empty and name not in settings
    ]
    if missing:
        raise TypeError(f"{quantity!r} takes {listed}, and lacks {', '.join(missing)}")
    return kind(**settings)
