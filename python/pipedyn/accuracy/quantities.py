# SPDX-License-Identifier: MIT
"""What is asked of a pipe, so that any model's answer can be held against the continuous pipe's.

A quantity asks a model, says how far an answer is from another, relative, and finds a reference: an
answer of the continuous pipe whose own error is known.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from pipedyn.accuracy.families import FAMILIES, Family, expected_size
from pipedyn.accuracy.nearby import Onset, onset_near
from pipedyn.bifurcation.limit_cycle import LARGEST_CYCLE, limit_cycle
from pipedyn.linear.critical_speed import checked_end, critical_speed
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.eigensolver import lowest
from pipedyn.linear.modes import CONTINUUM_SPEED, modes, root_loci
from pipedyn.linear.special.weak_damping import is_faint
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.continuum import AnyModel, Continuum
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.motion.simulate import simulate
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import TookTooLong, clock, limited

EPS = float(np.finfo(float).eps)

BEFORE_CROWD = 0.9
"""Share of 1 / delta up to which there are only so many roots."""

GROWN = (0, 4, 10, 18, 28)
"""By how many functions eigenvalues' reference grows; slowly converge those of much damping."""

FEWEST, ENOUGH = 16, 40
"""Legendre functions with which a critical speed is searched, from and to."""

ALIKE = 1e-5
"""By how much eight functions more may move what a search found, relative."""

STEP = 8
"""By how many functions a linear reference grows."""

FIRST, MOST = 6, 20
"""Legendre functions of the first nonlinear reference at the least, and of the last."""

BEAM_MODES: tuple[int, ...] = (4, 6, 8, 11, 15, 20, 27)
"""Sizes of beam modes, for motions that Legendre functions spoil; 27 take ten seconds."""

LONGEST_REFERENCE = 30.0
"""Seconds of processor time after which a nonlinear reference grows no more."""

STARTING = 24
"""Legendre functions at the least for the mode from which a motion sets out."""


@dataclass(frozen=True)
class Answer:
    """What a model answered.

    Attributes:
        values: numbers, real or complex, of a shape that the quantity sets.
        kind: what must agree besides numbers, as that a loss of stability is flutter.
        error: the solver's own, relative.
        onset: of a critical speed by flutter, where it is looked for in another model.
        damping: delta of the pipe whose roots these are: those that crowd at -1 / delta are not
            told apart.
    """

    values: NDArray[Any]
    kind: str = ""
    error: float = 0.0
    onset: Onset | None = None
    damping: float = 0.0


@dataclass(frozen=True)
class Reference:
    """The continuous pipe's answer.

    Attributes:
        answer: the numbers.
        error: bound on their error, relative: by what the last growth of the model moved them.
        source: which model gave it.
        family: of the smaller models that it grew from.
        grown: their sizes and errors.
    """

    answer: Answer = field(repr=False)
    error: float
    source: str
    family: str = ""
    grown: tuple[tuple[int, float], ...] = field(default=(), repr=False)


class Quantity(ABC):
    """A question to a pipe at given conditions."""

    name: ClassVar[str]

    is_linear: ClassVar[bool] = True
    """Whether an answer's cost depends on little else than the degrees of freedom."""

    is_even: ClassVar[bool] = False
    """Whether neighbouring sizes cost alike; a search for passages may take three times as long."""

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

    def has_look(self, answer: Answer) -> bool:
        """Whether a look beside the reference's answer tells a model's error."""
        return False

    def look(self, model: AnyModel, answer: Answer) -> float | None:
        """A model's error from a look beside the reference's answer, far cheaper than its own.

        None where there is no such look, or it finds nothing.
        """
        return None

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        """Largest wave number that an answer takes, in 1 / L, where that is known."""
        return None

    def is_spoilt(self, pipe: Pipe, family: str) -> bool:
        """Whether a family's answers do not come near a pipe's as it grows."""
        return False

    @property
    def floor(self) -> float:
        """Error below which answers differ by how they were solved, not by their models."""
        return 0.0

    def room(self, dof: int) -> float:
        """Degrees of freedom beyond which other models' answers cost no less, but for some noise.

        Linear answers and cycles of few degrees of freedom cost alike, of many more always more.
        """
        return max(1.5 * dof, dof + 3.0)

    def sharpened(self, tolerance: float) -> Quantity:
        """The same, solved so sharply that its own error is no part of a tolerance."""
        return self

    def shared(self, answer: Answer) -> Answer:
        """What of an answer any model that can be asked has."""
        return answer

    def prepared(self, pipe: Pipe) -> Quantity:
        """The same with what it takes from the pipe itself."""
        return self

    def extrapolated(self, coarse: Answer, fine: Answer, order: float) -> Answer:
        """Richardson's value from models of one and of twice the size."""
        coarse, fine = self.shared(coarse), self.shared(fine)
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
    """Largest difference of roots of another set from some of these, each with its own, relative.

    Roots smaller than 1 in 1 / T are held against 1.
    """
    cost = np.abs(other[:, None] - values[None, :]) / np.maximum(np.abs(other), 1.0)[:, None]
    if other.size > values.size or not np.isfinite(cost).all():
        return math.inf
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].max(initial=0.0))


def _wave(pipe: Pipe, u: float, value: complex) -> float:
    """Largest wave number of motions ~ exp(a s + lambda tau)."""
    thrust = pipe.centrifugal * u**2 - 0.5 * pipe.gamma
    coriolis = 2.0 * math.sqrt(pipe.beta) * pipe.direction * u * value
    elastic = 1.0 + pipe.damping * value
    return float(np.abs(np.roots([elastic, 0.0, thrust, coriolis, value**2])).max(initial=0.0))


def _largest_wave(pipe: Pipe, u: float, values: NDArray[Any]) -> float | None:
    """Of the root farthest out; those that crowd at -1 / delta have no wave number to speak of."""
    telling = values[_outside(values, pipe.damping)]
    if telling.size == 0:
        return None
    return _wave(pipe, u, complex(telling[np.argmax(np.abs(telling))]))


def _outside(values: NDArray[Any], damping: float) -> NDArray[np.bool_]:
    """Which roots do not crowd at -1 / delta."""
    outside: NDArray[np.bool_] = np.abs(damping * values + 1.0) > 0.5
    return outside


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
        onset = None
        # With neither Coriolis force nor damping two frequencies meet: no root passes the axis.
        passes = model.pipe.beta > 0.0 or model.pipe.damping > 0.0
        if found.kind == "flutter" and found.speed and passes and not is_faint(model.pipe):
            onset = Onset(found.speed, found.frequency, found.error)
        return Answer(np.array([found.speed]), found.kind, error, onset)

    def distance(self, answer: Answer, other: Answer) -> float:
        return math.inf if answer.kind != other.kind else _relative(answer.values, other.values)

    def has_look(self, answer: Answer) -> bool:
        return answer.onset is not None

    def look(self, model: AnyModel, answer: Answer) -> float | None:
        if answer.onset is None or not isinstance(model, Model):
            return None
        onset = onset_near(model, answer.onset.speed, answer.onset.frequency)
        return None if onset is None else abs(onset.speed / answer.onset.speed - 1.0)

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        onset = answer.onset
        return None if onset is None else _wave(pipe, onset.speed, 1j * onset.frequency)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        followed = self._followed(pipe, tolerance)
        if followed is not None:
            return followed
        found = self.answer(Continuum(pipe))
        return Reference(found, max(found.error, EPS), "Continuum")

    def _followed(self, pipe: Pipe, tolerance: float) -> Reference | None:
        """Searched in a reduced model and followed into larger ones, where it hardly moves.

        A third of the cost of two searches.
        """
        size = FEWEST
        while size <= ENOUGH:
            try:
                answer = self.answer(Galerkin(pipe, size, "legendre"))
            except PipedynError:
                return None
            before = answer.onset
            if before is None:
                return None
            larger = max(size + STEP, math.ceil(0.8 * before.speed))
            for more in (STEP, 2 * STEP):
                model = Galerkin(pipe, size + more, "legendre")
                onset = onset_near(model, before.speed, before.frequency)
                if onset is None:
                    break
                moved = abs(onset.speed - before.speed) / onset.speed
                if moved > ALIKE:
                    break
                error = moved + (before.error + onset.error) / onset.speed + EPS
                found = Answer(np.array([onset.speed]), "flutter", error, onset)
                if error <= tolerance or more > STEP:
                    source = f"search with {size} Legendre functions, followed to {size + more}"
                    return Reference(found, error, source)
                before = onset
            size = larger
        return None


@dataclass(frozen=True)
class Frequencies(Quantity):
    """The eigenvalues of the lowest modes at one flow speed: each matched with its own.

    Of a pipe with damping delta, those up to 0.9 / delta: from 1 / delta on there is no next one,
    as infinitely many crowd there.

    Attributes:
        u: flow speed.
        count: number of modes.
    """

    name: ClassVar[str] = "frequencies"
    u: float = 0.0
    count: int = 4

    def __post_init__(self) -> None:
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "count", check.count("count", self.count, high=100))

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
        error = found.discretisation or 0.0
        return Answer(found.eigenvalues, error=error, damping=model.pipe.damping)

    def distance(self, answer: Answer, other: Answer) -> float:
        told = self._told(other)
        return _apart(answer.values, told) if told.size else math.inf

    def _told(self, answer: Answer) -> NDArray[Any]:
        """The lowest roots; of a damped pipe those below the endless crowd at -1 / delta."""
        values = answer.values[: 2 * self.count]
        below = answer.damping * np.abs(values) < BEFORE_CROWD
        told: NDArray[Any] = values[below & _outside(values, answer.damping)]
        return told

    def has_look(self, answer: Answer) -> bool:
        return True

    def look(self, model: AnyModel, answer: Answer) -> float | None:
        if not isinstance(model, Model):
            return None
        return self.distance(self._roots(model), answer)

    def _roots(self, model: Model) -> Answer:
        """Without the modes' shapes, which are the half of an answer."""
        found = lowest(eigenproblem(model), self.u, min(2 * self.count + 2, 2 * model.dof))
        return Answer(found.values, damping=model.pipe.damping)

    is_even: ClassVar[bool] = True

    def room(self, dof: int) -> float:
        return 0.5 * dof

    def shared(self, answer: Answer) -> Answer:
        return replace(answer, values=answer.values[: 2 * self.count])

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        return _largest_wave(pipe, self.u, answer.values[: 2 * self.count])

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        wave = _wave(pipe, self.u, 1j * (math.pi * (self.count + 0.5)) ** 2)
        expected = expected_size(FAMILIES["legendre"], wave, tolerance)
        if math.isfinite(expected):
            first = max(int(expected), self.count + 2)
            before: Answer | None = None
            for more in GROWN:
                model = Galerkin(pipe, first + more, "legendre")
                answer = self._roots(model)
                error = math.inf if before is None else self.distance(before, answer)
                if error <= tolerance:
                    source = f"Galerkin, {model.dof} Legendre functions"
                    return Reference(answer, max(error, 1e-14), source)
                before = answer
        answer = self.answer(Continuum(pipe))
        if self._told(answer).size == 0:
            raise NotConverged(
                f"no eigenvalue at u = {self.u:g} lies below those that crowd at -1 / delta", answer
            )
        return Reference(answer, max(answer.error, 1e-14), "Continuum")


@dataclass(frozen=True)
class RootLociOver(Quantity):
    """The branches of eigenvalues over a range of speeds: the largest error of a root on them.

    Attributes:
        speeds: flow speeds, increasing, shape (S,).
        count: number of branches.
    """

    name: ClassVar[str] = "root_loci"
    is_even: ClassVar[bool] = True
    speeds: ArrayLike
    count: int = 4

    def __post_init__(self) -> None:
        at = check.array("speeds", self.speeds, low=0.0, high=CONTINUUM_SPEED, longest=10_000)
        if np.any(np.diff(at) <= 0.0):
            raise ValueError("speeds must be strictly increasing")
        object.__setattr__(self, "speeds", at)
        object.__setattr__(self, "count", check.count("count", self.count, high=100))

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
        values = np.concatenate([loci.eigenvalues, loci.partners], axis=1)
        return Answer(values, damping=model.pipe.damping)

    def distance(self, answer: Answer, other: Answer) -> float:
        rows = zip(answer.values, other.values, strict=True)
        return max(_apart(values, exact[_outside(exact, other.damping)]) for values, exact in rows)

    def shared(self, answer: Answer) -> Answer:
        upper, lower = np.split(answer.values, 2, axis=1)
        mine = np.concatenate([upper[:, : self.count], lower[:, : self.count]], axis=1)
        return replace(answer, values=mine)

    def has_look(self, answer: Answer) -> bool:
        return True

    def look(self, model: AnyModel, answer: Answer) -> float | None:
        if not isinstance(model, Model):
            return None
        assert isinstance(self.speeds, np.ndarray)
        count = min(2 * self.count + 8, 2 * model.dof)
        rows = sorted({0, self.speeds.size // 2, self.speeds.size - 1})
        problem = eigenproblem(model)
        values = np.stack([lowest(problem, float(self.speeds[row]), count).values for row in rows])
        return self.distance(Answer(values), replace(answer, values=answer.values[rows]))

    def room(self, dof: int) -> float:
        return 0.5 * dof

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        assert isinstance(self.speeds, np.ndarray)
        return _largest_wave(pipe, float(self.speeds[-1]), answer.values[-1])

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        assert isinstance(self.speeds, np.ndarray)
        fastest = float(self.speeds[-1])
        wave = _wave(pipe, fastest, 1j * (math.pi * (self.count + 0.5)) ** 2)
        expected = max(expected_size(FAMILIES["legendre"], wave, tolerance), self.count + 2.0)
        first = int(min(expected, max(FEWEST, 3 * self.count, math.ceil(fastest))))
        for size in range(first, first + 5 * STEP, STEP):
            loci = root_loci(Galerkin(pipe, size, "legendre"), self.speeds, self.count)
            values = np.concatenate([loci.eigenvalues, loci.partners], axis=1)
            answer = Answer(values, damping=pipe.damping)
            problem = eigenproblem(Galerkin(pipe, size + STEP, "legendre"))
            every = np.stack([lowest(problem, float(u)).values for u in self.speeds])
            # Beside roots that crowd the larger may leave as much as it moved these at most.
            error = 2.0 * self.distance(Answer(every), answer)
            if error <= tolerance:
                break
        source = f"{size} Legendre functions, held against the roots of {size + STEP}"
        return Reference(answer, max(error, 1e-14), source)


# ---------------------------------------------------------------------------- nonlinear questions


Angle: TypeAlias = Callable[[Array], ArrayLike]

START = 0.05
"""Displacement of the free end, in L, with which a motion starts."""

STILL = 1e-12
"""Largest amplitude of a start that is rounding."""

RTOL = 1e-8
"""Relative tolerance of a motion or a cycle where no other is asked for."""

BEAM_ORDER, DRAG_ORDER = 4.0, 3.0
"""Powers of the size with which errors fall: of beam modes, and of functions under drag."""


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
        rtol: relative tolerance of the integration; where not given a hundredth of the tolerance
            asked for, or 1e-8 where none is.
        rates: dtheta/dt(s) of the start; none where not given, but of the mode those that it has.
    """

    name: ClassVar[str] = "motion"
    is_linear: ClassVar[bool] = False
    most: ClassVar[int] = 1000
    growth: ClassVar[float] = 1.5
    u: float
    duration: float
    start: Angle | None = field(default=None, repr=False)
    samples: int = 201
    rtol: float | None = None
    rates: Angle | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        duration = check.real("duration", self.duration, low=1e-6, high=1e6)
        for name, given in (("start", self.start), ("rates", self.rates)):
            if given is not None and not callable(given):
                raise TypeError(
                    f"{name} must be a function of arc lengths s, so that all models start alike, "
                    f"got {check.shown(given)}"
                )
        if self.rates is not None and self.start is None:
            raise ValueError("rates must come with a start")
        samples = check.count("samples", self.samples, low=2, high=100_000)
        rtol = _checked_rtol(self.rtol, 1e-12)
        for name, value in (("u", u), ("duration", duration), ("samples", samples), ("rtol", rtol)):
            object.__setattr__(self, name, value)

    def answer(self, model: AnyModel) -> Answer:
        assert isinstance(model, Model)
        assert self.start is not None
        assert self.rtol is not None
        motion = simulate(
            *(model, self.u, self.duration, self.start),
            qdot0=None if self.rates is None else model.bent(self.rates),
            samples=self.samples,
            rtol=self.rtol,
        )
        return Answer(motion.tip)

    @property
    def floor(self) -> float:
        return 20.0 * (self.rtol or RTOL)

    def prepared(self, pipe: Pipe) -> MotionOf:
        rtol = RTOL if self.rtol is None else self.rtol
        if self.start is not None:
            straight = Galerkin(pipe, FIRST, "legendre")
            sets_out = [straight.bent(one) for one in (self.start, self.rates) if one is not None]
            if np.abs(sets_out).max() < STILL:
                raise ValueError("start must bend the pipe, which does not move from where it is")
            return replace(self, rtol=rtol)
        size = max(STARTING, math.ceil(self.u))
        found = modes(Galerkin(pipe, size, "legendre"), self.u, 8)
        growth = found.eigenvalues.real  # all modes of an undamped pipe may grow alike: the lowest
        mode = found.shapes[int(np.argmax(growth >= growth.max() - 0.2 * abs(growth.max())))]
        q = START * mode.coordinates / mode(np.ones(1))[0]
        angle = partial(_slope, mode.model, q.real.copy())
        rates = partial(_slope, mode.model, (mode.eigenvalue * q).real)
        return replace(self, start=angle, rates=rates, rtol=rtol)

    def distance(self, answer: Answer, other: Answer) -> float:
        excursion = np.hypot(*(other.values - np.array([0.0, 1.0])).T).max()
        if not np.isfinite(answer.values).all():
            return math.inf
        return float(np.hypot(*(answer.values - other.values).T).max() / excursion)

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        return _second_wave(pipe, self.u)

    def is_spoilt(self, pipe: Pipe, family: str) -> bool:
        """The highest Legendre functions of such a pipe grow many times faster than it does."""
        grows = pipe.flow == "aspirating" and pipe.damping == 0.0 and pipe.beta > 0.0
        return grows and family == "legendre"

    def room(self, dof: int) -> float:
        return math.inf

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        assert self.rtol is not None
        return _reference_of_motion(self, pipe, self.u, max(tolerance, self.rtol))

    def sharpened(self, tolerance: float) -> MotionOf:
        return replace(self, rtol=_sharper(self.rtol, 0.01 * tolerance, 1e-12))


@dataclass(frozen=True)
class LimitCycleAt(Quantity):
    """Amplitude and frequency of the limit cycle: the larger relative error.

    Attributes:
        u: flow speed.
        rtol: relative tolerance of the cycle; where not given a tenth of the tolerance asked for,
            or 1e-8 where none is.
    """

    name: ClassVar[str] = "limit_cycle"
    is_linear: ClassVar[bool] = False
    most: ClassVar[int] = LARGEST_CYCLE
    growth: ClassVar[float] = 1.0
    u: float
    rtol: float | None = None

    def __post_init__(self) -> None:
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED, open_low=True)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "rtol", _checked_rtol(self.rtol, 1e-10))

    def answer(self, model: AnyModel) -> Answer:
        assert isinstance(model, Model)
        assert self.rtol is not None
        cycle = limit_cycle(model, self.u, rtol=self.rtol)
        return Answer(np.array([cycle.amplitude, cycle.frequency]), "", cycle.error)

    def distance(self, answer: Answer, other: Answer) -> float:
        return _relative(answer.values, other.values)

    def room(self, dof: int) -> float:
        return dof

    def wave(self, pipe: Pipe, answer: Answer) -> float | None:
        return _wave(pipe, self.u, 1j * float(answer.values[1]))

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        assert self.rtol is not None
        return _reference_of_motion(self, pipe, self.u, max(tolerance, self.rtol))

    @property
    def floor(self) -> float:
        return 10.0 * (self.rtol or RTOL)

    def prepared(self, pipe: Pipe) -> LimitCycleAt:
        return replace(self, rtol=RTOL if self.rtol is None else self.rtol)

    def sharpened(self, tolerance: float) -> LimitCycleAt:
        return replace(self, rtol=_sharper(self.rtol, 0.1 * tolerance, 1e-10))


def _checked_rtol(rtol: Any, least: float) -> float | None:
    return None if rtol is None else check.real("rtol", rtol, low=least, high=1e-2)


def _sharper(rtol: float | None, enough: float, least: float) -> float:
    return min(1e-2 if rtol is None else rtol, max(enough, least))


def _slope(model: Model, q: Array, s: Array) -> Array:
    """The angle of a reduced model at arc lengths."""
    assert isinstance(model, Galerkin)
    return model.functions(s, 1) @ q


def _second_wave(pipe: Pipe, u: float) -> float:
    """Largest wave number of what moves with the second mode's frequency."""
    return _wave(pipe, u, 1j * (1.5 * math.pi) ** 2)


def _reference_of_motion(quantity: Quantity, pipe: Pipe, u: float, tolerance: float) -> Reference:
    """From Legendre functions, or from beam modes where those spoil the answer.

    Solved by turns with two tolerances: what the looser leaves is part of the difference.
    """
    legendre, order = FAMILIES["legendre"], None if pipe.drag == 0.0 else DRAG_ORDER
    if quantity.is_spoilt(pipe, "legendre"):
        family, order, sizes = FAMILIES["beam"], BEAM_ORDER, BEAM_MODES
    else:
        expected = expected_size(legendre, _second_wave(pipe, u), tolerance)
        first = int(min(max(expected, FIRST), MOST - 2))
        family, sizes = legendre, tuple(range(first, MOST + 1, 2))
    askers = (quantity.sharpened(tolerance), quantity.sharpened(0.25 * tolerance))
    return _grown(pipe, family, sizes, askers, tolerance, order)


def _grown(
    pipe: Pipe,
    family: Family,
    sizes: Sequence[int],
    askers: tuple[Quantity, Quantity],
    tolerance: float,
    order: float | None,
) -> Reference:
    """The answer of the first of some models that is as near to the one before as is asked for.

    Args:
        pipe: the pipe.
        family: of the models.
        sizes: of them, growing.
        askers: ask the models by turns.
        tolerance: bound on the error.
        order: power of the size with which the errors fall at the least, None where exponentially:
            what the last step moved is then more than what is left.
    """
    answers: list[Answer] = []
    end, told = clock() + LONGEST_REFERENCE, ""
    for i, size in enumerate(sizes):
        try:
            with limited(end - clock()):
                answers.append(askers[i % 2].answer(family.make(pipe, size)))
        except (TookTooLong, PipedynError) as failure:
            if i < 2 and isinstance(failure, PipedynError):
                raise
            if i < 2:
                raise NotConverged(
                    f"the continuous pipe's answer is not known: of reduced models, the one of "
                    f"{size} {family.name} functions was not done in {LONGEST_REFERENCE:g} s"
                ) from None
            told, size = f", as that of {size} failed", sizes[i - 1]
            break
        if i == 0:
            continue
        left = 1.0
        if order is not None:
            left = max(1.0, 1.0 / ((size / sizes[i - 1]) ** order - 1.0))
        error = left * askers[0].distance(answers[-2], answers[-1]) + answers[-1].error
        if error <= tolerance:
            break
    source = f"Galerkin, {size} {family.name} functions{told}"
    errors = [askers[0].distance(smaller, answers[-1]) for smaller in answers[:-1]]
    grown = tuple(zip(sizes, errors, strict=False))
    return Reference(answers[-1], max(error, 1e-14), source, family.name, grown)


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
    kind = QUANTITIES[check.choice("quantity", quantity, tuple(QUANTITIES))]
    known = {one.name: one for one in fields(kind)}  # type: ignore[arg-type]
    listed = ", ".join(known)
    for name in settings:
        if name not in known:
            raise TypeError(f"{quantity!r} takes {listed}, got {check.shown(name)}")
    signature = inspect.signature(kind)
    missing = [
        name
        for name, one in signature.parameters.items()
        if one.default is inspect.Parameter.empty and name not in settings
    ]
    if missing:
        raise TypeError(f"{quantity!r} takes {listed}, and lacks {', '.join(missing)}")
    return kind(**settings)
