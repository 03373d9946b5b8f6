# SPDX-License-Identifier: MIT
"""Quantities of a pipe for which answers of models are compared with the continuous pipe.

A quantity computes the answer of a model, the relative distance of two answers, and a reference:
the answer of the continuous pipe with a bound on its error. For a reference, reduced models of
growing size are solved until two answers agree; their difference bounds the error of the last one.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from pipedyn.accuracy.convergence import FAMILIES
from pipedyn.attraction.from_motion import LARGEST_CYCLE
from pipedyn.cycles.limit_cycle import limit_cycle
from pipedyn.linear.critical_speed import CriticalSpeed, checked_end, critical_speed
from pipedyn.linear.loci import root_loci
from pipedyn.linear.modes import CONTINUUM_SPEED, eigenvalues, modes
from pipedyn.models.base import Model
from pipedyn.models.continuum import AnyModel, Continuum, checked_model
from pipedyn.models.drive import Base, InputUnits, Pulsation, Supply
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.motion.simulate import simulate
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import TookTooLong, clock, time_limit
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.result import Result

LEGENDRE = FAMILIES["legendre"]

MARGIN = 10.0
"""Least ratio of an error to the error of the reference for which the error counts as resolved. An
error of this size is known to a tenth."""

LEAST_REFERENCE_ERROR = 1e-14
"""Least error stated for a reference: the rounding of an eigenvalue or of a quadrature."""

BEFORE_CLUSTER = 0.9
"""Share of 1 / delta up to which eigenvalues are compared; closer to -1 / delta they converge
slowly."""

FIRST_FUNCTIONS, MOST_FUNCTIONS = 6, 20
"""Least number of functions of the first model for a nonlinear reference, and that of the last one.
For three of four pipes measured, 6 Legendre functions give the critical speed to 1 %; the limit
cycle of 20 takes seconds."""

LONGEST_REFERENCE = 30.0
"""Processor time in seconds after which the models of a nonlinear reference grow no more. Cycles of
20 Legendre functions take 1 s and motions of 20 beam modes 3 s, so only references that do not
converge take this long."""

LEAST_TOLERANCE = 1e-10
"""Least tolerance to which a basis grows, as for `Continuum`; it is larger than rounding errors."""

RTOL, LOOSEST_RTOL = 1e-8, 1e-2
"""Relative tolerance of a motion or a cycle if none is given, which leaves errors of 2e-7, and the
loosest tolerance accepted, which leaves errors of a tenth or more."""


@saved_as("Answer")
class Answer(Result):
    """The answer of a model or, as a reference, of the continuous pipe.

    Attributes:
        values: the numbers, real or complex; their shape depends on the quantity.
        kind: a word that must agree as well as the numbers, e.g. "flutter" for a loss of stability.
        error: relative error of the solver; for a reference a bound on its error, from the change
            between the last two models.
        damping: delta if the values are roots; roots in the cluster at -1 / delta are not compared.
        candidates: all computed roots, if more were computed than asked for; None else. The roots
            of another model are searched among these, since they may include a surplus one.
        source: for a reference, the model that gave it.
        family: for a reference from models of growing size, the name of their family.
    """

    values: NDArray[Any] = field(repr=False)
    kind: str = ""
    error: float = 0.0
    damping: float = 0.0
    candidates: NDArray[Any] | None = field(default=None, repr=False)
    source: str = ""
    family: str = ""


class Quantity(ABC):
    """A question about a pipe under given conditions."""

    name: ClassVar[str]

    least: int = 1
    """Least number of degrees of freedom that a model needs to answer the question."""

    most: ClassVar[int] = 2000
    """Largest number of degrees of freedom of models that are measured."""

    floor: float = 0.0
    """Error below which answers differ by the solver's error, not by their models."""

    dimensions: Literal[2, 3] = 2
    """Dimensions in which models move: 3 for motions across the plane of a bent rest as well."""

    def sees_one_plane_of(self, pipe: Pipe) -> bool:
        """Whether the pipe sags and may lose stability across the plane that is asked of."""
        return not pipe.rests_straight and self.dimensions == 2 and self.name == "critical_speed"

    def _set(self, **checked: Any) -> None:
        """Sets fields of the frozen instance to values that have been checked."""
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @abstractmethod
    def answer(self, model: Model) -> Answer:
        """The answer of a model."""

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest relative difference of the numbers of two answers.

        The difference is infinite if the answers differ in kind or shape.
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
        """The answer of the continuous pipe, with an error below the tolerance if possible."""

    def excluded(self, pipe: Pipe, family: str) -> str:
        """Reason why answers of a family do not converge to those of the pipe; empty if they do."""
        return ""

    def solved_for(self, tolerance: float) -> Self:
        """A copy whose solver has errors that are negligible compared with a tolerance."""
        return self

    def prepared(self, pipe: Pipe) -> Self:
        """A copy with values for the defaults that depend on the pipe."""
        return self

    def extrapolated(self, coarse: Answer, fine: Answer, order: float) -> Answer:
        """Richardson's extrapolation, for errors n^-order, from models of sizes n and 2 n."""
        if coarse.kind != fine.kind or coarse.values.shape != fine.values.shape:
            return replace(fine, values=np.full_like(fine.values, np.nan), candidates=None)
        share = 2.0**order - 1.0
        error = fine.error + (fine.error + coarse.error) / share
        values = fine.values + (fine.values - coarse.values) / share
        return replace(fine, values=values, error=error, candidates=None)


# ------------------------------------------------------------------------------- linear questions


@saved_as("CriticalSpeedOf", added=("dimensions",))
@dataclass(frozen=True)
class CriticalSpeedOf(Quantity):
    """The critical speed u_c; the error is infinite if the kind of instability is wrong."""

    name: ClassVar[str] = "critical_speed"
    max_speed: float = 100.0
    dimensions: Literal[2, 3] = 2

    def __post_init__(self) -> None:
        check.count("dimensions", self.dimensions, low=2, high=3)
        self._set(max_speed=checked_end(self.max_speed))

    def answer(self, model: AnyModel) -> Answer:
        """The critical speed, shape (1,), with the kind of instability."""
        return self._answer(critical_speed(model, self.max_speed))

    def _answer(self, found: CriticalSpeed) -> Answer:
        error = found.error / found.speed if found.speed else 0.0
        return Answer(np.array([found.speed]), found.kind, error)

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """The critical speed of `Continuum`, whose accuracy does not depend on the tolerance."""
        model = Continuum(pipe, self.dimensions)
        found = critical_speed(model, min(self.max_speed, CONTINUUM_SPEED))
        answer, source = self._answer(found), f"Continuum, {found.size} Legendre functions"
        return replace(answer, error=max(answer.error, LEAST_REFERENCE_ERROR), source=source)


class _Eigenvalues(Quantity):
    """Eigenvalues, which are compared in pairs, without those in the cluster at -1 / delta."""

    highest: ClassVar[float] = math.inf
    """Share of 1 / delta up to which eigenvalues are compared."""

    count: int

    @property
    def least(self) -> int:  # type: ignore[override]
        """Least number of degrees of freedom: one for each mode asked for, in each plane."""
        return self.count * (self.dimensions - 1)

    def twice(self, model: Model) -> int:
        """How often each root counts: twice for a straight pipe that moves in two planes."""
        return model.dimensions - checked_model(model).dimensions + 1

    def compared(self, answer: Answer) -> NDArray[np.bool_]:
        """Whether each eigenvalue of a reference is compared; in the shape of its values."""
        scaled = answer.damping * answer.values
        return (np.abs(scaled + 1.0) > 0.5) & (np.abs(scaled) < self.highest)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest difference in the best pairing, relative to the larger of |root| and 1."""
        roots = answer.values if answer.candidates is None else answer.candidates
        both = np.atleast_2d(roots), np.atleast_2d(other.values)
        worst = 0.0
        for row, exact, mask in zip(*both, np.atleast_2d(self.compared(other)), strict=True):
            own = exact[mask][:, None]
            cost = np.abs(own - row) / np.maximum(np.abs(own), 1.0)
            if own.size > row.size or not np.isfinite(cost).all():
                return math.inf
            pairs = scipy.optimize.linear_sum_assignment(cost)
            worst = max(worst, float(cost[pairs].max(initial=0.0)))
        return worst

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """The roots of the continuous pipe; the basis grows until the compared roots converge."""

        def change(before: Answer, answer: Answer) -> float:
            # Near a cluster convergence is slow, and the error may be as large as the last change.
            return 2.0 * self.distance(before, answer) + before.error + answer.error

        # Tolerances looser than 1e-6 would not reduce the cost.
        least, first = min(max(tolerance, LEAST_TOLERANCE), 1e-6), max(16, 2 * self.count + 2)
        found = Continuum(pipe, self.dimensions).converge(self.answer, change, least, first)
        source = f"Continuum, {found.size} Legendre functions"
        return replace(found.value, error=max(found.error, LEAST_REFERENCE_ERROR), source=source)


@saved_as("Frequencies", added=("dimensions",))
@dataclass(frozen=True)
class Frequencies(_Eigenvalues):
    """The eigenvalues of the lowest modes at one flow speed.

    For a pipe with damping delta only eigenvalues with magnitudes up to 0.9 / delta are compared,
    since infinitely many cluster at -1 / delta.
    """

    name: ClassVar[str] = "frequencies"
    highest: ClassVar[float] = BEFORE_CLUSTER
    u: float = 0.0
    count: int = 4
    dimensions: Literal[2, 3] = 2

    def __post_init__(self) -> None:
        check.count("dimensions", self.dimensions, low=2, high=3)
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED)
        self._set(u=u, count=check.count("count", self.count, high=100))

    def answer(self, model: Model) -> Answer:
        """The eigenvalues, shape (2 count,); raises NotConverged if all lie in the cluster."""
        # Roots of equal magnitude may swap at the end of the list, so two more are computed.
        twice = self.twice(model)
        found = eigenvalues(model, self.u, min(2 * self.count + 2, 2 * model.dof // twice))
        if twice > 1:
            found = np.tile(found, 2)[np.argsort(np.abs(np.tile(found, 2)), kind="stable")]
        answer = Answer(found[: 2 * self.count], damping=model.pipe.damping, candidates=found)
        if not self.compared(answer).any():
            reason = f"no eigenvalue at u = {self.u:g} lies below those that cluster at -1 / delta"
            raise NotConverged(reason, answer)
        return answer


@saved_as("RootLociOver", added=("dimensions",))
@dataclass(frozen=True)
class RootLociOver(_Eigenvalues):
    """Branches of eigenvalues over increasing flow speeds, (S,); their largest error counts.

    They are those of the `count` lowest modes at rest and of all others that grow, as `root_loci`
    finds them.
    """

    name: ClassVar[str] = "root_loci"
    speeds: ArrayLike
    count: int = 4
    dimensions: Literal[2, 3] = 2

    def __post_init__(self) -> None:
        check.count("dimensions", self.dimensions, low=2, high=3)
        at = check.array("speeds", self.speeds, low=0.0, high=CONTINUUM_SPEED, longest=10_000)
        self._set(speeds=at, count=check.count("count", self.count, high=100))

    def answer(self, model: Model) -> Answer:
        """Branches in the upper half plane, then their partners, shape (S, 2 B)."""
        # One more, since models may order them differently.
        count = min(self.count + 1, model.dof // (model.dimensions - 1))
        loci = root_loci(model, self.speeds, count)
        if not (loci.converged | np.isnan(loci.eigenvalues)).all():
            raise NotConverged("eigenvalues on the branches failed their residual check", loci)
        pairs = np.stack([loci.eigenvalues, loci.partners], axis=1)  # (S, 2, count)
        if model.pipe.damping:  # roots that are not known count to those in the cluster
            pairs[np.isnan(pairs)] = -1.0 / model.pipe.damping
        grows = (loci.eigenvalues.real > loci.errors).any(axis=0)
        asked_for = pairs[..., (loci.modes != self.count + 1) | grows]
        every, asked = (
            np.tile(part.reshape(len(part), -1), self.twice(model)) for part in (pairs, asked_for)
        )
        return Answer(asked, damping=model.pipe.damping, candidates=every)


# ---------------------------------------------------------------------------- nonlinear questions


Angle: TypeAlias = Callable[[Array], ArrayLike]


class _Integrated(Quantity):
    """A motion or a cycle, which is integrated with a relative tolerance, rtol.

    If an answer must meet a tolerance, rtol is that tolerance times `share`, but at least
    `least_rtol`. The integration leaves an error of `noise` times rtol.
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
        """The flow speed in a pipe at rest."""
        return self.u

    @property
    def floor(self) -> float:  # type: ignore[override]
        """The part of the error that comes from the integration."""
        return self.noise * self.rtol

    def solved_for(self, tolerance: float) -> Self:
        """A copy whose rtol is a share of the tolerance, but not larger than the present rtol."""
        rtol = min(self.rtol, max(self.share * tolerance, self.least_rtol))
        return replace(self, rtol=rtol)  # type: ignore[type-var]

    def reference(self, pipe: Pipe, tolerance: float) -> Answer:
        """The answer of Legendre functions, or of beam modes if Legendre functions are excluded.

        Models of growing size are solved with two values of rtol in turn, so that the difference of
        two answers contains the error of the looser one.

        Raises:
            NotConverged: if the first two models have no answer in half a minute.
            PipedynError: if one of the first two models fails.
        """
        tolerance = max(tolerance, self.rtol)
        family = FAMILIES["beam"] if self.excluded(pipe, "legendre") else LEGENDRE
        # Because of the kink in the drag |v| v, errors fall at best with the third power of the
        # size; the kink in time by a stop matters less. If errors do not fall exponentially, the
        # last change of the answer may be less than the error that remains.
        order = min(family.order, 3.0 if pipe.has_kinks else math.inf)
        # Waves get shorter with flow and weight, like 1 / sqrt(u^2 + |gamma|). With half a function
        # for each unit of that root, answers of the first two sizes of Legendre functions differed
        # by 3e-7 to 2e-5 at u from 6 to 14.
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
                with time_limit(end - clock()):
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
    """The path of the free end over a given duration.

    The error is the largest distance from the reference, relative to its largest excursion. The
    pipe starts with angles theta(s) and rates dtheta/dt(s), or at rest if only angles are given.
    Without a start it moves in its least damped mode with 0.05 L at the free end; unlike a pipe
    that is released from rest, it then excites no other modes. The flow may pulsate or come from a
    supply at constant head, and the base may move.
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
        """The mean speed of a pulsating flow, or the speed of a supply in the straight pipe."""
        if isinstance(self.u, Pulsation):
            return self.u.mean
        return self.u.speed(pipe) if isinstance(self.u, Supply) else self.u

    def __post_init__(self) -> None:
        super().__post_init__()
        duration = check.real("duration", self.duration, low=1e-6, high=1e6)
        for name, given in (("start", self.start), ("rates", self.rates)):
            said = "a function of arc lengths s, so that all models start alike"
            check.instance(name, given, Callable | None, said)
        if self.rates is not None and self.start is None:
            raise ValueError("rates must come with a start")
        samples = check.count("samples", self.samples, low=2, high=100_000)
        self._set(duration=duration, samples=samples)

    def answer(self, model: Model) -> Answer:
        """Positions of the free end, shape (samples, 2)."""
        assert self.start is not None
        q0, rates = model.bent(self.start), None
        if self.rates is not None:  # rates are projected onto those that the supports allow
            p, _ = np.split(model.initial_state(q0, None), 2)
            _, rates = model.onto_constraints(p, model.sampled(self.rates))
        motion = simulate(
            *(model, self.u, self.duration, q0),
            qdot0=rates,
            samples=self.samples,
            rtol=self.rtol,
            base=self.base,
        )
        return Answer(motion.tip + np.array([0.0, 1.0 - model.pipe.tip_place]))  # (0, 1) at rest

    def prepared(self, pipe: Pipe) -> MotionOf:
        """A copy with a start, which is the least damped mode if none was given."""
        more = LEGENDRE.for_terms(pipe)
        if self.start is not None:
            straight = LEGENDRE.make(pipe, FIRST_FUNCTIONS + more)
            bends = [straight.bent(one) for one in (self.start, self.rates) if one is not None]
            if np.abs(bends).max() < 1e-12:  # rounding
                raise ValueError("start must bend the pipe: a straight one at rest does not move")
            return self
        # 24 functions resolve the mode and the modes next to it to rounding.
        terms = tuple(term for term in pipe.terms if not term.load_across)  # about a straight rest
        unbent = replace(pipe, jet_angle=0.0, inclination=0.0, terms=terms)
        u = self.steady_speed(pipe)
        model = Galerkin(unbent, max(24, math.ceil(u)) + more, "legendre")
        found = modes(model, u, 4)
        growth = found.eigenvalues.real[:4]  # if all grow equally, the lowest mode is taken
        mode = found.shapes[int(np.argmax(growth >= growth.max() - 0.2 * abs(growth.max())))]
        q = 0.05 * mode.coordinates / mode([pipe.tip_place])[0]  # 2 % of such a motion is nonlinear
        bend, rates = np.split(model.initial_state(q.real, (mode.eigenvalue * q).real), 2)
        angle, turning = (partial(_angle_of, model, of.copy()) for of in (bend, rates))
        return replace(self, start=angle, rates=turning)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest distance of the free ends, relative to the largest excursion of `other`."""
        excursion = np.hypot(*(other.values - np.array([0.0, 1.0])).T).max()
        return float(np.hypot(*(answer.values - other.values).T).max() / excursion)

    def excluded(self, pipe: Pipe, family: str) -> str:
        """Reason to exclude Legendre functions for an undamped aspirating pipe; else empty."""
        grows = pipe.flow == "aspirating" and pipe.damping == 0.0 and pipe.beta > 0.0
        spoilt = grows and family == "legendre"
        return "its highest functions grow many times faster than the pipe" if spoilt else ""


def _angle_of(model: Galerkin, q: Array, s: Array) -> Array:
    """Angle theta of a reduced model with coordinates q at arc lengths s.

    This function of the module, unlike a lambda, can be pickled.
    """
    return np.asarray(model.core.basis(s, 1) @ q)


@saved_as("LimitCycleAt")
@dataclass(frozen=True)
class LimitCycleAt(_Integrated):
    """Amplitude and frequency of the limit cycle; the larger of both relative errors counts."""

    name: ClassVar[str] = "limit_cycle"
    most: ClassVar[int] = LARGEST_CYCLE
    least_rtol: ClassVar[float] = 1e-10
    share: ClassVar[float] = 0.1
    noise: ClassVar[float] = 10.0
    u: float
    rtol: float = RTOL

    def answer(self, model: Model) -> Answer:
        """Amplitude and frequency of the limit cycle, shape (2,)."""
        cycle = limit_cycle(model, self.u, rtol=self.rtol)
        return Answer(np.array([cycle.amplitude, cycle.frequency]), "", cycle.error)


# --------------------------------------------------------------------------------- by their names

QuantityName = Literal["critical_speed", "frequencies", "root_loci", "motion", "limit_cycle"]

QUANTITIES: dict[str, type[Quantity]] = {
    kind.name: kind for kind in (CriticalSpeedOf, Frequencies, RootLociOver, MotionOf, LimitCycleAt)
}


def conditions_of(quantity: Any) -> dict[str, inspect.Parameter]:
    """Conditions that a quantity takes besides the pipe, by their names."""
    kind = QUANTITIES[check.choice("quantity", quantity, tuple(QUANTITIES))]
    return dict(inspect.signature(kind).parameters)


def checked_quantity(
    quantity: Any, conditions: dict[str, Any], pipe: Pipe, tolerance: float | None = None
) -> Quantity:
    """The quantity of a pipe with a given name and with its conditions, maybe in other `units`.

    Raises TypeError for a condition that the quantity does not take, or that it needs and is not
    given. If a tolerance is given, the solver is as accurate as both the tolerance and the
    conditions require.
    """
    known, settings = conditions_of(quantity), dict(conditions)
    given = InputUnits(settings.pop("units", "nondimensional"), pipe)
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
    for name in ("u", "speeds", "max_speed"):
        if name in settings:
            settings[name] = given.speed(name, settings[name])
    if "duration" in settings:
        [settings["duration"]] = given.times(checked_quantity, duration=settings["duration"])
    if "base" in settings:
        settings["base"] = given.base(settings["base"])
    with given.explained():
        if tolerance is None:
            return QUANTITIES[quantity](**settings)
        loosest = {"rtol": LOOSEST_RTOL} if "rtol" in known else {}
        return QUANTITIES[quantity](**loosest | settings).solved_for(tolerance)
