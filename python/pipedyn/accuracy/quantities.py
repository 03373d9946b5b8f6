# SPDX-License-Identifier: MIT
"""What is asked of a pipe, so that any model's answer can be held against the continuous pipe's.

A quantity gets an answer from a model, gives the relative distance of two answers, and finds a
reference: an answer of the continuous pipe whose own error is known.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.accuracy.convergence import FAMILIES
from pipedyn.accuracy.reference import LEAST_REFERENCE_ERROR, Answer
from pipedyn.attraction.solutions import LARGEST_CYCLE
from pipedyn.cycles.limit_cycle import limit_cycle
from pipedyn.linear.critical_speed import CriticalSpeed, checked_end, critical_speed
from pipedyn.linear.modes import CONTINUUM_SPEED, eigenvalues, modes, root_loci
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.continuum import AnyModel, Continuum
from pipedyn.models.drive import Base, Pulsation, Supply
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.motion.simulate import simulate
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import TookTooLong, clock, limited

LEGENDRE = FAMILIES["legendre"]

BEFORE_CLUSTER = 0.9
"""Share of 1 / delta up to which roots are compared: towards it they converge ever more slowly."""

FIRST_FUNCTIONS, MOST_FUNCTIONS = 6, 20
"""Fewest functions of the first nonlinear reference, and those of the last: 6 Legendre functions
give the critical speed of three pipes in four to 1 %, as measured; a cycle of 20 takes seconds."""

LONGEST_REFERENCE = 30.0
"""Seconds of processor time after which a nonlinear reference grows no more: cycles of 20 Legendre
functions take 1 s, motions of 20 beam modes 3, so that only what does not converge meets it."""

LEAST_TOLERANCE = 1e-10
"""Least change to which a basis grows, as for `Continuum`: rounding leaves less."""

RTOL, LOOSEST_RTOL = 1e-8, 1e-2
"""Relative tolerance of a motion or a cycle where none is given: it leaves errors of 2e-7. The
loosest, which leaves errors of a tenth or more."""


class Quantity(ABC):
    """A question to a pipe at given conditions."""

    name: ClassVar[str]

    least: int = 1
    """Degrees of freedom that a model must have to answer."""

    most: ClassVar[int] = 2000
    """Degrees of freedom beyond which models are not asked."""

    floor: float = 0.0
    """Error below which answers differ by how they were solved, not by their models."""

    def _set(self, **checked: Any) -> None:
        """Fields of the frozen class, after their check."""
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @abstractmethod
    def answer(self, model: Model) -> Answer:
        """A model's answer."""

    def distance(self, answer: Answer, other: Answer) -> float:
        """How far one is from another, relative to that; infinite where they differ in kind.

        By the largest difference of the numbers, each relative to its own.
        """
        values, exact = answer.values, other.values
        comparable = answer.kind == other.kind and values.shape == exact.shape
        if not (comparable and np.isfinite(values).all()):
            return math.inf
        moved = np.abs(values - exact)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(moved == 0.0, 0.0, moved / np.abs(exact))
        return float(shares.max(initial=0.0))

    @abstractmethod
    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """The continuous pipe's answer, its error below a tolerance where that can be had."""

    def excluded(self, pipe: Pipe, family: str) -> str:
        """Why a family's answers do not come near a pipe's as it grows; empty if they do."""
        return ""

    def solved_for(self, tolerance: float) -> Self:
        """The same question, with the solver's own error negligible in a tolerance."""
        return self

    def prepared(self, pipe: Pipe) -> Self:
        """The same question, with defaults that depend on the pipe."""
        return self

    def changed(self, conditions: dict[str, Any]) -> Self:
        """The same question at other conditions."""
        return replace(self, **conditions)  # type: ignore[type-var]

    def extrapolated(self, coarse: Answer, fine: Answer, order: float) -> Answer:
        """Richardson's value from models of one and of twice the size."""
        if coarse.kind != fine.kind or coarse.values.shape != fine.values.shape:
            return replace(fine, values=np.full_like(fine.values, np.nan), candidates=None)
        share = 2.0**order - 1.0
        error = fine.error + (fine.error + coarse.error) / share
        values = fine.values + (fine.values - coarse.values) / share
        return replace(fine, values=values, error=error, candidates=None)


# ------------------------------------------------------------------------------- linear questions


@saved_as("CriticalSpeedOf")
@dataclass(frozen=True)
class CriticalSpeedOf(Quantity):
    """The critical speed u_c; infinitely wrong where flutter and divergence are mixed up."""

    name: ClassVar[str] = "critical_speed"
    max_speed: float = 100.0

    def __post_init__(self) -> None:
        self._set(max_speed=checked_end(self.max_speed))

    def answer(self, model: AnyModel) -> Answer:
        """The speed, shape (1,), with the kind of instability."""
        return self._answer(critical_speed(model, self.max_speed))

    def _answer(self, found: CriticalSpeed) -> Answer:
        error = found.error / found.speed if found.speed else 0.0
        return Answer(np.array([found.speed]), found.kind, error)

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """`Continuum`'s own answer, as exact as it is whatever the tolerance."""
        found = critical_speed(Continuum(pipe), min(self.max_speed, CONTINUUM_SPEED))
        answer, source = self._answer(found), f"Continuum, {found.size} Legendre functions"
        return replace(answer, error=max(answer.error, LEAST_REFERENCE_ERROR), source=source)


class _Eigenvalues(Quantity):
    """Eigenvalues, each compared with its own; those that cluster at -1 / delta are left out."""

    highest: ClassVar[float] = math.inf
    """Share of 1 / delta up to which roots are compared."""

    count: int

    @property
    def least(self) -> int:  # type: ignore[override]
        """One mode for each of those asked for."""
        return self.count

    def compared(self, answer: Answer) -> NDArray[np.bool_]:
        """Which roots others are compared with."""
        scaled = answer.damping * answer.values
        return (np.abs(scaled + 1.0) > 0.5) & (np.abs(scaled) < self.highest)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest difference of a root from its own, relative to that or, where it is less, 1."""
        roots = answer.values if answer.candidates is None else answer.candidates
        both = np.atleast_2d(roots), np.atleast_2d(other.values)
        worst = 0.0
        for row, exact, mask in zip(*both, np.atleast_2d(self.compared(other)), strict=True):
            own = exact[mask][:, None]
            cost = np.abs(own - row) / np.maximum(np.abs(own), 1.0)
            if own.size > row.size or not np.isfinite(cost).all():
                return math.inf
            pairs = np.arange(own.size), _core.assignment(cost)
            worst = max(worst, float(cost[pairs].max(initial=0.0)))
        return worst

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """The continuous pipe's: its basis grows until these roots converge, whatever others do."""

        def change(before: Answer, answer: Answer) -> float:
            # Near a cluster convergence is slow: what is left may be as much as the last change.
            return 2.0 * self.distance(before, answer) + before.error + answer.error

        # 1e-6 costs no more than what is looser.
        least, first = min(max(tolerance, LEAST_TOLERANCE), 1e-6), max(16, 2 * self.count + 2)
        found = Continuum(pipe).converge(self.answer, change, least, first)
        source = f"Continuum, {found.size} Legendre functions"
        return replace(found.value, error=max(found.error, LEAST_REFERENCE_ERROR), source=source)


@saved_as("Frequencies")
@dataclass(frozen=True)
class Frequencies(_Eigenvalues):
    """The eigenvalues of the lowest modes at one flow speed.

    Of a pipe with damping delta, those up to 0.9 / delta: from 1 / delta on there is no next one,
    as infinitely many cluster there.
    """

    name: ClassVar[str] = "frequencies"
    highest: ClassVar[float] = BEFORE_CLUSTER
    u: float = 0.0
    count: int = 4

    def __post_init__(self) -> None:
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        self._set(u=u, count=check.count("count", self.count, high=100))

    def answer(self, model: Model) -> Answer:
        """The eigenvalues, shape (2 count,); NotConverged where all of them cluster."""
        # Roots of equal size may change places at the end of the row: two more are asked for.
        found = eigenvalues(model, self.u, min(2 * self.count + 2, 2 * model.dof))
        answer = Answer(found[: 2 * self.count], damping=model.pipe.damping, candidates=found)
        if not self.compared(answer).any():
            reason = f"no eigenvalue at u = {self.u:g} lies below those that cluster at -1 / delta"
            raise NotConverged(reason, answer)
        return answer


@saved_as("RootLociOver")
@dataclass(frozen=True)
class RootLociOver(_Eigenvalues):
    """Branches of eigenvalues over increasing flow speeds (S,): the largest error on them."""

    name: ClassVar[str] = "root_loci"
    speeds: ArrayLike
    count: int = 4

    def __post_init__(self) -> None:
        at = check.array("speeds", self.speeds, low=0.0, high=CONTINUUM_SPEED, longest=10_000)
        self._set(speeds=at, count=check.count("count", self.count, high=100))

    def answer(self, model: Model) -> Answer:
        """The branches of the upper half plane, then their partners, shape (S, 2 count)."""
        count = min(self.count + 1, model.dof)  # a branch beyond may be the one in question
        loci = root_loci(model, self.speeds, count)
        if not loci.converged.all():
            raise NotConverged("eigenvalues on the branches failed their residual check", loci)
        pairs = np.stack([loci.eigenvalues, loci.partners], axis=1)  # (S, 2, count)
        every, asked = (part.reshape(len(part), -1) for part in (pairs, pairs[..., : self.count]))
        return Answer(asked, damping=model.pipe.damping, candidates=every)


# ---------------------------------------------------------------------------- nonlinear questions


Angle: TypeAlias = Callable[[Array], ArrayLike]


class _Integrated(Quantity):
    """A motion or a cycle, integrated with a relative tolerance, rtol.

    For a tolerance of the answer a `share` of it is enough, but not below `least_rtol`. What is
    left is an error of `noise` times rtol.
    """

    least_rtol: ClassVar[float]
    share: ClassVar[float]
    noise: ClassVar[float]

    u: float
    rtol: float

    def __post_init__(self) -> None:
        rtol = check.real("rtol", self.rtol, low=self.least_rtol, high=LOOSEST_RTOL)
        self._set(u=self._checked_speed(), rtol=rtol)

    def _checked_speed(self) -> Any:
        return check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)

    def steady_speed(self, pipe: Pipe) -> float:
        """Flow speed of a pipe at rest."""
        return self.u

    @property
    def floor(self) -> float:  # type: ignore[override]
        """The integration's part."""
        return self.noise * self.rtol

    def solved_for(self, tolerance: float) -> Self:
        """With a share of the tolerance, but no looser than it is."""
        rtol = min(self.rtol, max(self.share * tolerance, self.least_rtol))
        return replace(self, rtol=rtol)  # type: ignore[type-var]

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """From Legendre functions, or from beam modes where those spoil the answer.

        Solved by turns with two tolerances: what the looser leaves is part of the difference.

        Raises:
            NotConverged: if the second model has no answer in half a minute.
            PipedynError: if one of the first two models fails.
        """
        tolerance = max(tolerance, self.rtol)
        family = FAMILIES["beam"] if self.excluded(pipe, "legendre") else LEGENDRE
        # With the kink of drag's |v| v errors fall like the third power of the size at the most;
        # a stop's, in time, costs less.
        # Where they do not fall exponentially the last step moves less than what remains.
        order = min(family.order, 3.0 if pipe.has_kinks else math.inf)
        # Waves get shorter with flow and weight, like 1 / sqrt(u^2 + |gamma|). With half a function
        # for each unit of that root the first two sizes of Legendre functions differ by 3e-7 to
        # 2e-5, as measured at u from 6 to 14.
        expected = FIRST_FUNCTIONS + math.ceil(
            0.5 * math.hypot(self.steady_speed(pipe), math.sqrt(abs(pipe.gamma)))
        )
        first, more = min(expected, MOST_FUNCTIONS - 2), family.for_terms(pipe)
        sizes = range(first + more, MOST_FUNCTIONS + more + 1, 2)
        asked = (self.solved_for(tolerance), self.solved_for(0.25 * tolerance))
        answers: list[Answer] = []
        failed, error, end = "", math.inf, clock() + LONGEST_REFERENCE
        for i, size in enumerate(sizes):
            try:
                with limited(end - clock()):
                    answers.append(asked[i % 2].answer(family.make(pipe, size)))
            except (TookTooLong, PipedynError) as failure:
                if i < 2 and isinstance(failure, PipedynError):
                    raise
                if i < 2:
                    raise NotConverged(
                        f"the continuous pipe's answer is not known: of reduced models, the one of "
                        f"{size} {family.name} functions was not done in {LONGEST_REFERENCE:g} s"
                    ) from None
                failed = f", as that of {size} failed"
                break
            if i > 0:
                left = max(1.0, 1.0 / ((size / sizes[i - 1]) ** order - 1.0))
                error = left * self.distance(answers[-2], answers[-1]) + answers[-1].error
            if error <= tolerance:
                break
        source = f"Galerkin, {sizes[len(answers) - 1]} {family.name} functions{failed}"
        error = max(error, LEAST_REFERENCE_ERROR)
        return replace(answers[-1], error=error, source=source, family=family.name)


@saved_as("MotionOf")
@dataclass(frozen=True)
class MotionOf(_Integrated):
    """The free end over a time: its largest distance from the reference, in the largest excursion.

    The pipe starts with angles theta(s) and rates dtheta/dt(s), at rest where only angles are
    given. Without a start it moves on its least damped mode, of 0.05 L at the free end, which
    excites no others, as a pipe let go does. The flow may pulsate or be fed at constant head, the
    base move.
    """

    name: ClassVar[str] = "motion"
    most: ClassVar[int] = 1000
    least_rtol: ClassVar[float] = 1e-12
    share: ClassVar[float] = 0.01
    noise: ClassVar[float] = 20.0
    u: float | Pulsation | Supply  # type: ignore[assignment]
    duration: float
    start: Angle | None = field(default=None, repr=False)
    samples: int = 201
    rtol: float = RTOL
    rates: Angle | None = field(default=None, repr=False)
    base: Base | None = None

    def _checked_speed(self) -> Any:
        return self.u if isinstance(self.u, Pulsation | Supply) else super()._checked_speed()

    def steady_speed(self, pipe: Pipe) -> float:
        """The mean of a flow that pulsates; that of a supply in the straight pipe."""
        if isinstance(self.u, Pulsation):
            return self.u.mean
        return self.u.speed(pipe) if isinstance(self.u, Supply) else self.u

    def __post_init__(self) -> None:
        super().__post_init__()
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
        self._set(duration=duration, samples=samples)

    def answer(self, model: Model) -> Answer:
        """The free end's positions, shape (samples, 2)."""
        assert self.start is not None
        q0, rates = model.bent(self.start), None
        if self.rates is not None:  # that supports allow
            p, _ = np.split(model.start(q0, None), 2)
            _, rates = model.projected(p, model.sampled(self.rates))
        motion = simulate(
            *(model, self.u, self.duration, q0),
            qdot0=rates,
            samples=self.samples,
            rtol=self.rtol,
            base=self.base,
        )
        return Answer(motion.tip + np.array([0.0, 1.0 - model.pipe.watched]))  # (0, 1) at rest

    def prepared(self, pipe: Pipe) -> MotionOf:
        """With its start: the least damped mode where none is given."""
        more = LEGENDRE.for_terms(pipe)
        if self.start is not None:
            straight = LEGENDRE.make(pipe, FIRST_FUNCTIONS + more)
            bends = [straight.bent(one) for one in (self.start, self.rates) if one is not None]
            if np.abs(bends).max() < 1e-12:  # rounding
                raise ValueError("start must bend the pipe: a straight one at rest does not move")
            return self
        # 24 functions have the mode and its neighbours exactly.
        unbent = replace(pipe, jet_angle=0.0)  # which is at rest, whatever the jet
        u = self.steady_speed(pipe)
        model = Galerkin(unbent, max(24, math.ceil(u)) + more, "legendre")
        found = modes(model, u, 8)
        growth = found.eigenvalues.real  # where all grow equally, the lowest
        mode = found.shapes[int(np.argmax(growth >= growth.max() - 0.2 * abs(growth.max())))]
        q = 0.05 * mode.coordinates / mode([pipe.watched])[0]  # 2 % of such a motion is nonlinear
        bend, rates = np.split(model.start(q.real, (mode.eigenvalue * q).real), 2)
        angle, turning = (partial(_angle_of, model, of.copy()) for of in (bend, rates))
        return replace(self, start=angle, rates=turning)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest distance of the free end, in the other's largest excursion."""
        excursion = np.hypot(*(other.values - np.array([0.0, 1.0])).T).max()
        if not np.isfinite(answer.values).all():
            return math.inf
        return float(np.hypot(*(answer.values - other.values).T).max() / excursion)

    def excluded(self, pipe: Pipe, family: str) -> str:
        """Legendre functions of an undamped aspirating pipe."""
        grows = pipe.flow == "aspirating" and pipe.damping == 0.0 and pipe.beta > 0.0
        spoilt = grows and family == "legendre"
        return "its highest functions grow many times faster than the pipe" if spoilt else ""


def _angle_of(model: Galerkin, q: Array, s: Array) -> Array:
    """The angle of a reduced model at arc lengths; a function of the module, so that it pickles."""
    return np.asarray(model.core.basis(s, 1) @ q)


@saved_as("LimitCycleAt")
@dataclass(frozen=True)
class LimitCycleAt(_Integrated):
    """Amplitude and frequency of the limit cycle: the larger relative error."""

    name: ClassVar[str] = "limit_cycle"
    most: ClassVar[int] = LARGEST_CYCLE
    least_rtol: ClassVar[float] = 1e-10
    share: ClassVar[float] = 0.1
    noise: ClassVar[float] = 10.0
    u: float
    rtol: float = RTOL

    def answer(self, model: Model) -> Answer:
        """Amplitude and frequency, shape (2,)."""
        cycle = limit_cycle(model, self.u, rtol=self.rtol)
        return Answer(np.array([cycle.amplitude, cycle.frequency]), "", cycle.error)


# --------------------------------------------------------------------------------- by their names

QUANTITIES: dict[str, type[Quantity]] = {
    kind.name: kind for kind in (CriticalSpeedOf, Frequencies, RootLociOver, MotionOf, LimitCycleAt)
}


def conditions_of(quantity: Any) -> dict[str, inspect.Parameter]:
    """What a quantity takes besides the pipe, by name."""
    kind = QUANTITIES[check.choice("quantity", quantity, tuple(QUANTITIES))]
    return dict(inspect.signature(kind).parameters)


def checked_quantity(
    quantity: Any, settings: dict[str, Any], tolerance: float | None = None
) -> Quantity:
    """A quantity by its name, with conditions; TypeError for those it does not take, or lacks.

    With a tolerance it is solved as well as that needs and as settings ask for.
    """
    known = conditions_of(quantity)
    for name in settings:
        if name not in known:
            raise TypeError(f"{quantity!r} takes {', '.join(known)}, got {check.shown(name)}")
    missing = [
        name
        for name, one in known.items()
        if one.default is inspect.Parameter.empty and name not in settings
    ]
    if missing:
        raise TypeError(f"{quantity!r} takes {', '.join(known)}, and lacks {', '.join(missing)}")
    if tolerance is None:
        return QUANTITIES[quantity](**settings)
    loosest = {"rtol": LOOSEST_RTOL} if "rtol" in known else {}
    return QUANTITIES[quantity](**loosest | settings).solved_for(tolerance)
