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
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from pipedyn.accuracy.families import FAMILIES, resolving_size
from pipedyn.accuracy.reference import (
    EPS,
    FEWEST,
    LEAST_ERROR,
    STEP,
    Answer,
    Onset,
    Reference,
    grown_reference,
    onset_reference,
    wave_number,
)
from pipedyn.bifurcation.limit_cycle import LARGEST_CYCLE, limit_cycle
from pipedyn.linear.critical_speed import checked_end, critical_speed
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.eigensolver import lowest
from pipedyn.linear.modes import CONTINUUM_SPEED, modes, root_loci
from pipedyn.linear.special.weak_damping import is_weakly_damped
from pipedyn.models.base import Model, NotConverged
from pipedyn.models.continuum import AnyModel, Continuum
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.motion.simulate import simulate
from pipedyn.util import check
from pipedyn.util.check import Array

LEGENDRE = FAMILIES["legendre"]

BEFORE_CLUSTER = 0.9
"""Share of 1 / delta up to which roots are compared: from 1 / delta on there is no next one."""

GROWN = (0, 4, 10, 18, 28)
"""By how many functions the reference of eigenvalues grows: fast at first, as most converge in one
step; those of much damping converge slowly."""

FIRST, MOST = 6, 20
"""Legendre functions of the first nonlinear reference at the least, and of the last: a cycle of 20
takes seconds."""

BEAM_MODES: tuple[int, ...] = (4, 6, 8, 11, 15, 20, 27)
"""Sizes of beam modes, for motions that Legendre functions spoil; 27 take ten seconds."""

BEAM_ORDER, DRAG_ORDER = 4.0, 3.0
"""Powers of the size with which errors fall: of beam modes, and of functions under drag, as |v| v
has a kink."""

LONGEST_REFERENCE = 30.0
"""Seconds of processor time after which a nonlinear reference grows no more: half of what a search
waits for one answer."""

STARTING = 24
"""Legendre functions at the least for the mode from which a motion starts: those of it and of its
neighbours are exact then."""

START = 0.05
"""Displacement of the free end, in L, with which a motion starts: 2 % of it is nonlinear."""

AT_REST = 1e-12
"""Largest amplitude of a start that is rounding."""

RTOL = 1e-8
"""Relative tolerance of a motion or a cycle where no other is asked for."""


class Quantity(ABC):
    """A question to a pipe at given conditions."""

    name: ClassVar[str]

    least: int = 1
    """Degrees of freedom that a model must have to answer."""

    most: ClassVar[int] = 2000
    """Degrees of freedom beyond which models are not asked."""

    @abstractmethod
    def answer(self, model: AnyModel) -> Answer:
        """A model's answer."""

    @abstractmethod
    def distance(self, answer: Answer, other: Answer) -> float:
        """How far one is from another, relative to that; infinite where they differ in kind."""

    @abstractmethod
    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """The continuous pipe's answer, its error below a tolerance where that can be had."""

    def excluded(self, pipe: Pipe, family: str) -> str:
        """Why a family's answers do not come near a pipe's as it grows; empty if they do."""
        return ""

    @property
    def floor(self) -> float:
        """Error below which answers differ by how they were solved, not by their models."""
        return 0.0

    def sharpened(self, tolerance: float) -> Self:
        """The same, solved so sharply that its own error is no part of a tolerance."""
        return self

    def prepared(self, pipe: Pipe) -> Self:
        """The same with what it takes from the pipe itself."""
        return self

    def extrapolated(self, coarse: Answer, fine: Answer, order: float) -> Answer:
        """Richardson's value from models of one and of twice the size."""
        if coarse.kind != fine.kind or coarse.values.shape != fine.values.shape:
            return replace(fine, values=np.full_like(fine.values, np.nan), others=None)
        share = 2.0**order - 1.0
        error = fine.error + (fine.error + coarse.error) / share
        values = fine.values + (fine.values - coarse.values) / share
        return replace(fine, values=values, error=error, others=None)


def _relative(values: NDArray[Any], other: NDArray[Any]) -> float:
    """Largest relative difference of entries, infinite where there is none."""
    if values.shape != other.shape or not np.isfinite(values).all():
        return math.inf
    moved = np.abs(values - other)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(moved == 0.0, 0.0, moved / np.abs(other))
    return float(shares.max(initial=0.0))


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
        """The speed, shape (1,), with the kind of instability."""
        found = critical_speed(model, self.max_speed)
        error = found.error / found.speed if found.speed else 0.0
        onset = None
        # With neither Coriolis force nor damping two frequencies meet: no root crosses the axis.
        crosses = model.pipe.beta > 0.0 or model.pipe.damping > 0.0
        if found.kind == "flutter" and found.speed and crosses and not is_weakly_damped(model.pipe):
            onset = Onset(found.speed, found.frequency, found.error)
        return Answer(np.array([found.speed]), found.kind, error, onset)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Relative difference of the speeds; infinite where the kinds differ."""
        return math.inf if answer.kind != other.kind else _relative(answer.values, other.values)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """An onset tracked into larger models, or else the continuous pipe's own answer."""
        tracked = onset_reference(pipe, LEGENDRE.for_terms(pipe), self.answer, tolerance)
        if tracked is not None:
            return tracked
        found = self.answer(Continuum(pipe))
        return Reference(found, max(found.error, EPS), "Continuum")


class _Roots(Quantity):
    """Eigenvalues, each held against its own; those that cluster at -1 / delta are left out."""

    count: int

    @property
    def least(self) -> int:  # type: ignore[override]
        """One mode for each of those asked for."""
        return self.count

    def _resolving(self, pipe: Pipe, u: float, tolerance: float) -> float:
        """Legendre functions that resolve the modes asked for, by their wave number."""
        wave = wave_number(pipe, u, 1j * (math.pi * (self.count + 0.5)) ** 2)
        size = max(resolving_size(wave, tolerance), self.count + 2.0)
        return size + LEGENDRE.for_terms(pipe)


def _outside(values: NDArray[Any], damping: float) -> NDArray[np.bool_]:
    """Which roots do not cluster at -1 / delta."""
    outside: NDArray[np.bool_] = np.abs(damping * values + 1.0) > 0.5
    return outside


def _apart(values: NDArray[Any], other: NDArray[Any]) -> float:
    """Largest difference of roots of another set from some of these, each with its own, relative.

    Roots smaller than 1 in 1 / T are held against 1.
    """
    cost = np.abs(other[:, None] - values[None, :]) / np.maximum(np.abs(other), 1.0)[:, None]
    if other.size > values.size or not np.isfinite(cost).all():
        return math.inf
    rows, columns = linear_sum_assignment(cost)
    return float(cost[rows, columns].max(initial=0.0))


@dataclass(frozen=True)
class Frequencies(_Roots):
    """The eigenvalues of the lowest modes at one flow speed: each matched with its own.

    Of a pipe with damping delta, those up to 0.9 / delta: from 1 / delta on there is no next one,
    as infinitely many cluster there.

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

    def answer(self, model: AnyModel) -> Answer:
        """The eigenvalues, shape (2 count,)."""
        most = 2 * self.count
        if isinstance(model, Model):  # roots of equal size may change places at the end of the row
            most = min(most + 2, 2 * model.dof)
        found = modes(model, self.u, most)
        if not found.converged.all():
            raise NotConverged(f"eigenvalues at u = {self.u:g} failed their residual check", found)
        return self._split(found.eigenvalues, model.pipe, found.discretisation or 0.0)

    def _split(self, values: NDArray[Any], pipe: Pipe, error: float = 0.0) -> Answer:
        asked, others = np.split(values, [2 * self.count])
        return Answer(asked, error=error, damping=pipe.damping, others=others)

    def _roots(self, model: AnyModel) -> Answer:
        """Without the modes' shapes, which are the half of an answer."""
        assert isinstance(model, Model)
        found = lowest(eigenproblem(model), self.u, min(2 * self.count + 2, 2 * model.dof))
        return self._split(found.values, model.pipe)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest distance of a root; infinite where none of the reference's is compared."""
        compared = self._compared(other)
        return _apart(answer.candidates, compared) if compared.size else math.inf

    def _compared(self, answer: Answer) -> NDArray[Any]:
        """The lowest roots; of a damped pipe those below the cluster at -1 / delta."""
        below = answer.damping * np.abs(answer.values) < BEFORE_CLUSTER
        compared: NDArray[Any] = answer.values[below & _outside(answer.values, answer.damping)]
        return compared

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """Legendre functions that resolve the modes, grown; or else the continuous pipe."""
        found, resolving = None, self._resolving(pipe, self.u, tolerance)
        if math.isfinite(resolving):
            sizes = [int(resolving) + more for more in GROWN]
            asks = (self._roots, self._roots)
            found = grown_reference(pipe, LEGENDRE, sizes, asks, self.distance, tolerance)
        if found is None or found.error > tolerance:
            answer = self.answer(Continuum(pipe))
            if self._compared(answer).size == 0:
                raise NotConverged(
                    f"no eigenvalue at u = {self.u:g} lies below those that cluster at -1 / delta",
                    answer,
                )
            found = Reference(answer, max(answer.error, LEAST_ERROR), "Continuum")
        return found


@dataclass(frozen=True)
class RootLociOver(_Roots):
    """The branches of eigenvalues over a range of speeds: the largest error of a root on them.

    Attributes:
        speeds: flow speeds, increasing, shape (S,).
        count: number of branches.
    """

    name: ClassVar[str] = "root_loci"
    speeds: ArrayLike
    count: int = 4

    def __post_init__(self) -> None:
        at = check.array("speeds", self.speeds, low=0.0, high=CONTINUUM_SPEED, longest=10_000)
        if np.any(np.diff(at) <= 0.0):
            raise ValueError("speeds must be strictly increasing")
        object.__setattr__(self, "speeds", at)
        object.__setattr__(self, "count", check.count("count", self.count, high=100))

    def answer(self, model: AnyModel) -> Answer:
        """The branches of the upper half plane, then their partners, shape (S, 2 count)."""
        count = self.count  # of another model a branch beyond may be the one in question
        if isinstance(model, Model):
            count = min(self.count + 1, model.dof)
        loci = root_loci(model, self.speeds, count)
        if not loci.converged.all():
            raise NotConverged("eigenvalues on the branches failed their residual check", loci)
        upper, lower = loci.eigenvalues, loci.partners
        asked, others = (
            np.concatenate([upper[:, part], lower[:, part]], axis=1)
            for part in (slice(self.count), slice(self.count, None))
        )
        return Answer(asked, damping=model.pipe.damping, others=others)

    def distance(self, answer: Answer, other: Answer) -> float:
        """Largest distance of a root at any speed."""
        rows = zip(answer.candidates, other.values, strict=True)
        return max(_apart(values, exact[_outside(exact, other.damping)]) for values, exact in rows)

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """The branches of a model, held against all roots of a larger one."""
        assert isinstance(self.speeds, np.ndarray)
        fastest = float(self.speeds[-1])
        resolving = self._resolving(pipe, fastest, tolerance)
        enough = max(FEWEST, 3 * self.count, math.ceil(fastest)) + LEGENDRE.for_terms(pipe)
        first = int(min(resolving, enough))
        for size in range(first, first + 5 * STEP, STEP):
            loci = root_loci(Galerkin(pipe, size, "legendre"), self.speeds, self.count)
            values = np.concatenate([loci.eigenvalues, loci.partners], axis=1)
            answer = Answer(values, damping=pipe.damping)
            problem = eigenproblem(Galerkin(pipe, size + STEP, "legendre"))
            every = np.stack([lowest(problem, float(u)).values for u in self.speeds])
            # Beside clustered roots the larger may leave as much as it moved these at most.
            error = 2.0 * self.distance(Answer(every), answer)
            if error <= tolerance:
                break
        source = f"{size} Legendre functions, held against the roots of {size + STEP}"
        return Reference(answer, max(error, LEAST_ERROR), source)


# ---------------------------------------------------------------------------- nonlinear questions


Angle: TypeAlias = Callable[[Array], ArrayLike]


class _Integrated(Quantity):
    """A motion or a cycle, integrated with a relative tolerance."""

    sharpest: ClassVar[float]
    """Least relative tolerance of the integration."""

    share: ClassVar[float]
    """Of a tolerance asked for, that the integration's is."""

    noise: ClassVar[float]
    """Error of an answer in relative tolerances of its integration."""

    u: float
    rtol: float | None

    def _check_numbers(self, least_speed_is_open: bool) -> None:
        u = check.real("u", self.u, low=0.0, high=CONTINUUM_SPEED, open_low=least_speed_is_open)
        object.__setattr__(self, "u", u)
        if self.rtol is not None:
            rtol = check.real("rtol", self.rtol, low=self.sharpest, high=1e-2)
            object.__setattr__(self, "rtol", rtol)

    @property
    def floor(self) -> float:
        """The integration's part."""
        return self.noise * (self.rtol or RTOL)

    def sharpened(self, tolerance: float) -> Self:
        """With a share of the tolerance, but no looser than it is."""
        loosest = 1e-2 if self.rtol is None else self.rtol
        rtol = min(loosest, max(self.share * tolerance, self.sharpest))
        return replace(self, rtol=rtol)  # type: ignore[type-var]

    def prepared(self, pipe: Pipe) -> Self:
        """With the relative tolerance that holds where none is given."""
        return replace(self, rtol=self.rtol or RTOL)  # type: ignore[type-var]

    def reference(self, pipe: Pipe, tolerance: float) -> Reference:
        """From Legendre functions, or from beam modes where those spoil the answer.

        Solved by turns with two tolerances: what the looser leaves is part of the difference.
        """
        assert self.rtol is not None
        tolerance = max(tolerance, self.rtol)
        family, order = LEGENDRE, math.inf if pipe.drag == 0.0 else DRAG_ORDER
        second_mode = 1j * (1.5 * math.pi) ** 2
        if self.excluded(pipe, "legendre"):
            family, order, sizes = FAMILIES["beam"], BEAM_ORDER, BEAM_MODES
        else:
            expected = resolving_size(wave_number(pipe, self.u, second_mode), tolerance)
            first, more = int(min(max(expected, FIRST), MOST - 2)), family.for_terms(pipe)
            sizes = tuple(range(first + more, MOST + more + 1, 2))
        asks = (self.sharpened(tolerance).answer, self.sharpened(0.25 * tolerance).answer)
        return grown_reference(
            *(pipe, family, sizes, asks, self.distance, tolerance, order, LONGEST_REFERENCE)
        )


@dataclass(frozen=True)
class MotionOf(_Integrated):
    """The free end over a time: its largest distance from the reference, in the largest excursion.

    Attributes:
        u: flow speed.
        duration: in T.
        start: angle theta(s) of the bent pipe at rest that is let go; where not given, the motion
            starts on the pipe's least damped mode, of 0.05 L at the free end, which excites no
            others, as a pipe let go does.
        samples: times at which the free end is compared.
        rtol: relative tolerance of the integration; where not given a hundredth of the tolerance
            asked for, or 1e-8 where none is.
        rates: dtheta/dt(s) of the start; none where not given, but of the mode those that it has.
    """

    name: ClassVar[str] = "motion"
    most: ClassVar[int] = 1000
    sharpest: ClassVar[float] = 1e-12
    share: ClassVar[float] = 0.01
    noise: ClassVar[float] = 20.0
    u: float
    duration: float
    start: Angle | None = field(default=None, repr=False)
    samples: int = 201
    rtol: float | None = None
    rates: Angle | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self._check_numbers(least_speed_is_open=False)
        duration = check.real("duration", self.duration, low=1e-6, high=1e6)
        for name, given in (("start", self.start), ("rates", self.rates)):
            if given is not None and not callable(given):
                raise TypeError(
                    f"{name} must be a function of arc lengths s, so that all models start alike, "
                    f"got {check.shown(given)}"
                )
        if self.rates is not None and self.start is None:
            raise ValueError("rates must come with a start")
        object.__setattr__(self, "duration", duration)
        samples = check.count("samples", self.samples, low=2, high=100_000)
        object.__setattr__(self, "samples", samples)

    def answer(self, model: AnyModel) -> Answer:
        """The free end's positions, shape (samples, 2)."""
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

    def prepared(self, pipe: Pipe) -> MotionOf:
        """With its start: the least damped mode where none is given."""
        asked = super().prepared(pipe)
        if self.start is not None:
            straight = LEGENDRE.make(pipe, FIRST + LEGENDRE.for_terms(pipe))
            bends = [straight.bent(one) for one in (self.start, self.rates) if one is not None]
            if np.abs(bends).max() < AT_REST:
                raise ValueError("start must bend the pipe, which does not move from where it is")
            return asked
        size = max(STARTING, math.ceil(self.u)) + LEGENDRE.for_terms(pipe)
        found = modes(Galerkin(pipe, size, "legendre"), self.u, 8)
        growth = found.eigenvalues.real  # all modes of an undamped pipe may grow alike: the lowest
        mode = found.shapes[int(np.argmax(growth >= growth.max() - 0.2 * abs(growth.max())))]
        q = START * mode.coordinates / mode(np.ones(1))[0]
        angle = partial(_slope, mode.model, q.real.copy())
        rates = partial(_slope, mode.model, (mode.eigenvalue * q).real)
        return replace(asked, start=angle, rates=rates)

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


def _slope(model: Model, q: Array, s: Array) -> Array:
    """The angle of a reduced model at arc lengths."""
    assert isinstance(model, Galerkin)
    return model.functions(s, 1) @ q


@dataclass(frozen=True)
class LimitCycleAt(_Integrated):
    """Amplitude and frequency of the limit cycle: the larger relative error.

    Attributes:
        u: flow speed.
        rtol: relative tolerance of the cycle; where not given a tenth of the tolerance asked for,
            or 1e-8 where none is.
    """

    name: ClassVar[str] = "limit_cycle"
    most: ClassVar[int] = LARGEST_CYCLE
    sharpest: ClassVar[float] = 1e-10
    share: ClassVar[float] = 0.1
    noise: ClassVar[float] = 10.0
    u: float
    rtol: float | None = None

    def __post_init__(self) -> None:
        self._check_numbers(least_speed_is_open=True)

    def answer(self, model: AnyModel) -> Answer:
        """Amplitude and frequency, shape (2,)."""
        assert isinstance(model, Model)
        assert self.rtol is not None
        cycle = limit_cycle(model, self.u, rtol=self.rtol)
        return Answer(np.array([cycle.amplitude, cycle.frequency]), "", cycle.error)

    def distance(self, answer: Answer, other: Answer) -> float:
        """The larger relative difference of the two."""
        return _relative(answer.values, other.values)


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
