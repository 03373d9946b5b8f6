# SPDX-License-Identifier: MIT
"""Periodic motions of finite amplitude of a pipe whose base oscillates or whose flow pulsates.

They are found by the collocation that limit cycles are, with the period given and no condition on
the phase, and followed in the frequency past folds. What a moving base does begins with the linear
response. In a pulsating flow rest is a motion, too; others branch off it on the edges of parametric
regions, with the period of the flow (harmonic) or twice that (subharmonic).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.bifurcation.collocation import OrbitProblem, residual, solved
from pipedyn.bifurcation.continuation import folds, sign_changes
from pipedyn.bifurcation.floquet import UNIT, EventKind, crossing_event, orbit_multipliers
from pipedyn.bifurcation.limit_cycle import Known, amplitude_of, refined_until
from pipedyn.bifurcation.orbit_continuation import (
    FINE,
    SMALL,
    BranchStart,
    Step,
    breaking_part,
    followed,
    orbit_at,
)
from pipedyn.bifurcation.parametric_regions import regions
from pipedyn.bifurcation.periodic_orbit import (
    PeriodicOrbit,
    coarsest_mesh,
    divided,
    resolved,
    stage_phases,
)
from pipedyn.bifurcation.pulsating import Hill, PulsatingPipe, require_motion
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.frequency_response import base_solution, checked_range
from pipedyn.linear.modes import largest_speed
from pipedyn.models.base import Model, NotConverged
from pipedyn.models.drive import ROWS, Harmonic, Pulsation, require_steady, steady_speed
from pipedyn.motion.simulate import Trajectory, checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import track
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

LARGEST = 60
"""Degrees of freedom: a motion takes some 0.1 s for 20 of them, and a branch has some 50."""

MOST_STEPS = 400
"""Steps along a branch, the longest of which are 0.15 in amplitude or in the frequency's share."""

UNKNOWN = 1e-3
"""Of multipliers whose error is not known, as they hardly converge: what is taken for it."""

HARMONICS = 8
"""Of Hill's equations, for the motions in which branches leave rest."""


class ForcedField(VectorField):
    """f(y, u) at phases of an orbit, during whose period the forcing has `order` periods.

    In a pulsating flow u is its mean.
    """

    forced = True

    def __init__(self, model: Model, forcing: Pulsation | Harmonic, order: int) -> None:
        super().__init__(model)
        self.forcing, self.order = forcing, order
        self._root: ForcedField = self
        self._phases, self._frequency = np.zeros(1), forcing.frequency

    def along(self, phases: Array, frequency: float) -> ForcedField:
        """The same of states at phases of an orbit with a frequency, one each."""
        other = copy(self)
        other._phases, other._frequency = self.order * phases, self.order * frequency
        return other

    def _count(self, states: int) -> None:
        if self._root is self:
            super()._count(states)
        else:
            self._root._count(states)

    def speed(self, orbit: PeriodicOrbit) -> float | Pulsation:
        """The flow's along an orbit."""
        if isinstance(self.forcing, Pulsation):
            return replace(self.forcing, frequency=self.order * orbit.frequency)
        return float(orbit.u)

    def _driven(self, u: float) -> tuple[float | Array, Array]:
        """Flow speeds and what else drives the states."""
        of, phases, w = self.forcing, self._phases, self._frequency
        drive = np.zeros((ROWS, phases.size))
        if isinstance(of, Pulsation):
            drive[0] = -u * of.amplitude * w * np.sin(phases)
            return u * (1.0 + of.amplitude * np.cos(phases)), drive
        row = 1 if of.direction == "x" else 2
        drive[row] = of.amplitude * np.cos(phases)
        drive[row + 2] = -of.amplitude * w * np.sin(phases)
        drive[row + 4] = -of.amplitude * w**2 * np.cos(phases)
        return u, drive

    def __call__(self, y: Array, u: float | Array) -> Array:
        """Rates of the states in the columns at the phases."""
        self._count(y.shape[1])
        speeds, drive = self._driven(float(u))
        return self.model.motion_rates(np.ascontiguousarray(y), speeds, drive)

    def jacobians(self, y: Array, u: float) -> Array:
        """df/dy of the states in the columns at the phases, (k, 2 moving, 2 moving)."""
        self._count(y.shape[1])
        speeds, drive = self._driven(u)
        return self.model.motion_jacobian(np.ascontiguousarray(y), speeds, drive)

    def by_frequency(self, y: Array, u: float) -> Array:
        """df/dw, w of the orbit: exact, as f is of second degree in it."""
        ahead, behind, h = copy(self), copy(self), 0.5 * self._frequency
        ahead._frequency, behind._frequency = self._frequency + h, self._frequency - h
        return self.order * (ahead(y, u) - behind(y, u)) / (2.0 * h)

    def is_odd(self, u: float) -> bool:
        """Whether the mirror image of a motion, half an orbit later, is a motion too."""
        if self.resting().any():
            return False
        y = self.some_states()
        phases, w = np.array([0.3, 1.1, 2.5]), self.forcing.frequency / self.order
        ahead = self.along(phases, w)(y, u)
        behind = self.along(phases + math.pi, w)(-y, u)
        return bool(np.abs(ahead + behind).max() <= 1e-9 * np.abs(ahead).max())


# -------------------------------------------------------------------------------------- results

BranchKind = Literal["base", "subharmonic", "harmonic"]


@result
class ForcedMotion(Trajectory):
    """One period of a periodic motion under a periodic forcing.

    Attributes:
        amplitude: half the peak-to-peak transverse motion of the free end relative to the base,
            in L.
        frequency: angular, of the forcing, in 1 / T.
        period: of the motion, in T: one of the forcing, or two if it is subharmonic.
        multipliers: Floquet multipliers over this period, complex, shape (2 dof,), the largest
            modulus first.
        stable: whether none exceeds 1 in modulus by more than 1e-6 or three times what it is known
            to. Of a pipe that nothing damps they have the modulus 1: motions nearby then neither
            grow nor decay.
        t: times from a crest of the forcing to the period, shape (S,).
        q, qdot: coordinates and rates, shape (S, coordinates).
        u: flow speed, or the pulsation.
        error: of the amplitude, relative, estimated by refinement.
        residual: largest |dy/dt - f(y)| half-way between the stages at which the equations were
            solved, relative to the largest |f|, of the accelerations.
        model: the model.
        orbit: the solution of the collocation equations.
    """

    amplitude: float
    frequency: float
    period: float
    multipliers: Complex = field(repr=False)
    stable: bool
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    u: float | Pulsation
    error: float
    residual: float
    model: Model = field(repr=False)
    orbit: PeriodicOrbit = field(repr=False, compare=False)

    @property
    def tip(self) -> Array:
        """Position (x, y) of the free end relative to the base, shape (S, 2)."""
        return self.model.tips(self.q.T)


@result
class ForcedEvent:
    """Where a branch changes.

    Attributes:
        kind: "fold", where the frequency turns back; "pitchfork", "period doubling" or "torus",
            where a multiplier passes the unit circle; or "end" where the branch was lost or left.
        frequency: angular, of the forcing.
        amplitude: of the free end, in L.
    """

    kind: EventKind
    frequency: float
    amplitude: float


@result
class ForcedBranch:
    """Motions along one branch, in the order in which it was followed.

    Its events are among them.

    Attributes:
        kind: "base"; or what leaves rest in a pulsating flow, "subharmonic" or "harmonic".
        frequency: angular, of the forcing, shape (P,).
        amplitude: half the peak-to-peak transverse motion of the free end relative to the base, in
            L, shape (P,).
        largest: modulus of the largest multiplier, shape (P,); 1 at events and in rest.
        stable: whether that is at most 1 but for what it is known to, as of a `ForcedMotion`, and
            False at events, shape (P,).
        events: in the order in which they are met.
    """

    kind: BranchKind
    frequency: Array = field(repr=False)
    amplitude: Array = field(repr=False)
    largest: Array = field(repr=False)
    stable: Any = field(repr=False)
    events: tuple[ForcedEvent, ...]
    steps: tuple[Step, ...] = field(repr=False, compare=False)
    motion: ForcedField = field(repr=False, compare=False)

    def at(self, frequency: float, rtol: float = 1e-6, samples: int = 257) -> list[ForcedMotion]:
        """The motions at a frequency of the forcing, to a relative tolerance of the amplitude."""
        omega = check.real("frequency", frequency, low=0.0, open_low=True) / self.motion.order
        found = list[ForcedMotion]()
        with one_thread(self.motion.size):
            for step in self.steps:
                for part in step.parts(folds(step, 1e-4) if np.prod(step.slopes) < 0.0 else []):
                    if (part.begin.p - omega) * (part.end.p - omega) <= 0.0 != part.end.p - omega:
                        orbit = step.problem.orbit(part.where(omega))
                        found.append(_described(self.motion, orbit, rtol, samples))
        return found


@result
class ForcedResponse:
    """Periodic motions over the frequency of the forcing.

    Attributes:
        branches: each followed from one end.
        forcing: amplitude and direction of the base's motion, or mean and amplitude of the flow's.
        u: flow speed, in a pulsating flow its mean.
        model: the model.
        evaluations: right-hand sides and Jacobians.
    """

    branches: tuple[ForcedBranch, ...]
    forcing: Pulsation | Harmonic
    u: float
    model: Model
    evaluations: int

    def at(self, frequency: float, rtol: float = 1e-6, samples: int = 257) -> list[ForcedMotion]:
        """The motions at a frequency of the forcing, the largest first.

        Args:
            frequency: angular, in 1 / T, within the range that branches were followed in.
            rtol: relative tolerance of the amplitude, in [1e-10, 1e-2].
            samples: number of states given, from the start of the period to its end.

        Raises:
            NotConverged: if a motion does not meet the tolerance.
            ValueError, TypeError: for bad arguments.
        """
        rtol = check.real("rtol", rtol, low=1e-10, high=1e-2)
        samples = check.count("samples", samples, low=9, high=100_000)
        found = [one for branch in self.branches for one in branch.at(frequency, rtol, samples)]
        return sorted(found, key=lambda one: -one.amplitude)


def forced_response(
    model: Model,
    u: float | Pulsation,
    *,
    base: Harmonic | None = None,
    frequencies: ArrayLike | None = None,
    progress: bool = False,
) -> ForcedResponse:
    """Periodic motions of finite amplitude over the frequency of the forcing, stable or not.

    Args:
        model: chain, reduced model or scene, up to 60 degrees of freedom.
        u: flow speed >= 0; or a `Pulsation`, whose mean and amplitude stay while its frequency
            varies. Its motions branch off rest on the edges of parametric regions, and the pipe
            must be stable at the mean speed.
        base: transverse motion of the base, whose amplitude stays while its frequency varies.
            Needed unless the flow pulsates, and not taken if it does.
        frequencies: range (low, high) of the forcing's angular frequency, low > 0, or more in
            increasing order, from the first to the last; where not given, near the frequency of
            base or pulsation.
        progress: show progress on stderr.

    Returns:
        ForcedResponse; `at(frequency)` gives the motions at one frequency, with their error.

    Raises:
        NotConverged: if no motion is found where the branch of a moving base begins.
        ValueError, TypeError: for bad arguments.

    Source: Doedel, Keller and Kernevez (1991), as for `limit_cycle`; Nayfeh and Mook (1979),
    Nonlinear oscillations, for what is to be expected.
    """
    model = checked_model_in_motion(model, largest=LARGEST, purpose="forced_response")
    forcing = _checked_forcing(u, base)
    mean = forcing.mean if isinstance(forcing, Pulsation) else u
    speed = steady_speed("u", mean, high=largest_speed(model))
    if frequencies is None:
        low, high = 0.99 * forcing.frequency, 1.01 * forcing.frequency
    else:
        low, high = checked_range("frequencies", frequencies)
        if low == 0.0:
            raise ValueError(f"frequencies must have low > 0, got {check.shown(frequencies)}")
    shown = check.flag("progress", progress)
    model.require_equilibrium(speed)
    if isinstance(forcing, Pulsation):
        require_motion(model)
        starts = _from_rest(model, speed, forcing, low, high)
    else:
        starts = _from_base(model, speed, forcing, low, high)
    branches = list[ForcedBranch]()
    with one_thread(2 * model.moving):
        for kind, motion, begin, window in starts:
            first = begin.orbit.frequency * motion.order
            if begin.orbit.size == 0.0 and any(_ends_at(one, first) for one in branches):
                continue  # from the other edge it was followed to here
            branches.append(_branch(kind, motion, begin, window, shown))
    return ForcedResponse(
        branches=tuple(branches),
        forcing=forcing,
        u=speed,
        model=model,
        evaluations=sum(one.motion.evaluations for one in branches),
    )


def _checked_forcing(u: Any, base: Any) -> Pulsation | Harmonic:
    if isinstance(u, Pulsation):
        if base is not None:
            raise ValueError("base must not be given where the flow pulsates")
        if u.amplitude == 0.0 or abs(u.amplitude) == 1.0:
            raise ValueError(f"u.amplitude must be between 0 and 1, got {u.amplitude!r}")
        return replace(u, amplitude=abs(u.amplitude))
    require_steady("u", u)
    if not isinstance(base, Harmonic):
        raise TypeError(f"base must be a Harmonic or u a Pulsation, got {check.shown(base)}")
    if base.direction != "x":
        raise ValueError("base must move along x: along y rest stays a motion, got direction='y'")
    if base.amplitude == 0.0:
        raise ValueError("base must move, got an amplitude of 0")
    return base


# ------------------------------------------------------------------------------ where it begins

Begin = tuple[BranchKind, ForcedField, BranchStart, tuple[float, float]]


def _from_base(
    model: Model, u: float, forcing: Harmonic, low: float, high: float
) -> Iterator[Begin]:
    """From the linear response at the lowest frequency."""
    begin = replace(forcing, frequency=low)
    motion = ForcedField(model, begin, 1)
    answer = model.by_coordinates() @ base_solution(model, u, low)
    rest = np.append(model.resting(), np.zeros(model.moving))
    orbit: PeriodicOrbit | None = None
    for share in (1.0, *np.geomspace(0.02, 1.0, 10)):  # at once, or else with growing amplitude
        motion.forcing = replace(begin, amplitude=float(share) * forcing.amplitude)
        amplitude = motion.forcing.amplitude
        try:
            if orbit is None:
                mode = amplitude * np.concatenate([answer, 1j * low * answer])

                def states(phase: Array, mode: Any = mode) -> Array:
                    return np.asarray(rest[:, None] + (mode[:, None] * np.exp(1j * phase)).real)

                orbit = resolved(motion, states, low, u, motion.is_odd(u), FINE.defect)
            orbit = solved(motion, orbit, FINE.tolerance)
            if share == 1.0:
                break
        except NewtonFailed:
            orbit = None if share == 1.0 else orbit
    if orbit is None or motion.forcing.amplitude != forcing.amplitude:
        raise NotConverged(f"no periodic motion was found at a frequency of {low:g}")
    z = orbit.packed()
    growing = np.append(np.zeros(z.size - 1), 1.0)
    tangent = OrbitProblem(motion, orbit, FINE).point(z, growing).tangent
    yield "base", motion, BranchStart(orbit, 0.2 * FINE.longest * tangent), (low, high)


def _from_rest(
    model: Model, mean: float, forcing: Pulsation, low: float, high: float
) -> Iterator[Begin]:
    """From rest, on the edges of parametric regions."""
    pipe = PulsatingPipe.of(model.elastic_operators(), mean)
    pipe.require_stable(high)
    hill = Hill(pipe, HARMONICS)
    kinds: tuple[tuple[BranchKind, int], ...] = (("subharmonic", 2), ("harmonic", 1))
    for kind, order in kinds:
        for region in regions(hill, np.array([forcing.amplitude]), low, high, (kind,)):
            ends = region.edges[0][np.isfinite(region.edges[0])]
            window = 0.9 * min(low, ends.min()), 1.1 * max(high, ends.max())
            for edge in ends.tolist():
                motion = ForcedField(model, replace(forcing, frequency=edge), order)
                yield kind, motion, _leaving_rest(motion, hill, edge, mean), window


def _leaving_rest(motion: ForcedField, hill: Hill, edge: float, mean: float) -> BranchStart:
    """In the motion that neither grows nor decays on an edge."""
    model, order, n = motion.model, motion.order, hill.pipe.size
    share = 0.5 if order == 2 else 0.0
    count = 2 * hill.many + (order == 1)
    amplitude = motion.forcing.amplitude
    h = hill.matrix(edge, share * edge, amplitude, count)
    parts = np.linalg.svd(h)[2][-1].conj().reshape(count, n)
    # A real motion has conjugate parts for opposite harmonics.
    options = [factor * parts for factor in (1.0, 1j)]
    parts = max((x + x[::-1].conj() for x in options), key=lambda x: float(np.abs(x).max()))
    turns = (np.arange(count) - hill.many + share) * order
    spread = model.by_coordinates() @ np.asarray(model.from_elastic(parts.T))
    w = edge / order

    def moved(phases: Array, power: int) -> Array:
        """Positions, or their derivatives by time, (k, moving)."""
        factors = (1j * turns * w) ** power * np.exp(1j * phases[..., None] * turns)
        return np.asarray((factors @ spread.T).real)

    coarse = coarsest_mesh(motion.is_odd(mean))
    edges = divided(coarse, np.full(coarse.size - 1, 3))
    starts = np.concatenate([moved(edges[:-1], 0), moved(edges[:-1], 1)], axis=1)
    rates = moved(stage_phases(edges), 2)
    states = moved(np.linspace(0.0, 2.0 * math.pi, 65), 0)
    tip = motion.tip(1e-6 * np.concatenate([states, states], axis=1).T) * 1e6
    base = PeriodicOrbit(edges, 0.0 * starts, 0.0 * rates, w, mean, True)
    towards = np.concatenate([starts.ravel(), rates.ravel(), [0.0, 0.0]])
    scale = SMALL / max(0.5 * float(np.ptp(tip)), 1e-300)
    return BranchStart(base, scale * towards, (0.98 * w, 1.02 * w))


# -------------------------------------------------------------------------------- following it


@dataclass(frozen=True)
class _Point:
    frequency: float
    amplitude: float
    largest: float = 1.0
    stable: bool = False


def unit_of(error: float) -> float:
    """By how much the modulus of a multiplier on the unit circle may be off, of their error."""
    return max(UNIT, min(3.0 * error, UNKNOWN))


def _point(motion: ForcedField, orbit: PeriodicOrbit) -> _Point:
    multipliers, _, error = orbit_multipliers(motion, orbit)
    amplitude, largest = amplitude_of(motion, orbit)[0], float(np.abs(multipliers).max())
    stable = largest <= 1.0 + unit_of(error)
    return _Point(motion.order * orbit.frequency, amplitude, largest, stable)


def _branch(
    kind: BranchKind,
    motion: ForcedField,
    begin: BranchStart,
    window: tuple[float, float],
    shown: bool,
) -> ForcedBranch:
    """What a start leads to, until the frequency leaves its window or the motion ends in rest."""
    points, events, steps = list[_Point](), list[ForcedEvent](), list[Step]()
    if kind == "base":
        points.append(_point(motion, begin.orbit))
    else:
        points.append(_Point(motion.order * begin.orbit.frequency, 0.0))
    try:
        for step in track(followed(motion, begin, FINE), MOST_STEPS, "forced response", shown):
            end = orbit_at(step, step.length)
            before, after = (breaking_part(orbit_at(step, s), "hopf") for s in (0.0, step.length))
            if kind != "base" and steps and np.sum(before * after) < 0.0:  # through rest
                share = np.linalg.norm(before) / np.linalg.norm(before - after)
                here = step.begin.p + float(share) * (step.end.p - step.begin.p)
                points.append(_Point(motion.order * here, 0.0))
                break
            found = _events(motion, step) if steps or kind == "base" else []
            points += [_Point(event.frequency, event.amplitude) for event in found]
            events += found
            steps.append(step)
            points.append(_point(motion, end))
            if not window[0] <= motion.order * end.frequency <= window[1]:
                break
            if len(steps) == MOST_STEPS:
                break
    except NewtonFailed:
        pass
    events.append(ForcedEvent("end", points[-1].frequency, points[-1].amplitude))
    frequency, amplitude, largest, stable = (
        np.array([getattr(point, name) for point in points])
        for name in ("frequency", "amplitude", "largest", "stable")
    )
    return ForcedBranch(
        kind=kind,
        frequency=frequency,
        amplitude=amplitude,
        largest=largest,
        stable=stable,
        events=tuple(events),
        steps=tuple(steps),
        motion=motion,
    )


def _events(motion: ForcedField, step: Step) -> list[ForcedEvent]:
    """Folds on a step and what multipliers do that pass the unit circle, along it."""
    found = list[tuple[float, EventKind]]()
    turns = folds(step, 1e-4)
    found += [(s, "fold") for s in turns]

    @cache
    def multipliers(s: float) -> tuple[Array, Complex, float]:
        """Logarithms of their moduli, falling, with their roots, and how far 1 is known."""
        values, roots, error = orbit_multipliers(motion, orbit_at(step, s))
        order = np.argsort(-np.abs(values), kind="stable")
        return np.log(np.maximum(np.abs(values[order]), 1e-300)), roots[order], unit_of(error)

    around = max(multipliers(s)[2] for s in (0.0, step.length))

    def growth(s: float) -> Array:
        return multipliers(s)[0] - around

    for low, high in sign_changes(growth, 0.0, step.length, 1e-3 * step.length):
        if any(low - 0.02 * step.length < s < high + 0.02 * step.length for s in turns):
            continue
        # The one that passes is the least of those outside: without damping others are on the
        # circle, and what leaves it little by little, as the amplitude grows, meets none.
        outside = max(low, high, key=lambda s: np.count_nonzero(growth(s) > 0.0))
        passing = np.count_nonzero(growth(outside) > 0.0) - 1
        neutral = any(abs(multipliers(s)[0][passing]) <= around for s in (0.0, step.length))
        if neutral and growth(outside)[passing] < around:
            continue
        root, symmetric = multipliers(outside)[1][passing], orbit_at(step, outside).symmetric
        kind, _ = crossing_event([root], symmetric, trivial=False)
        if kind != "fold":
            found.append((high, kind))
    made = list[ForcedEvent]()
    for s, kind in sorted(found):
        orbit = orbit_at(step, s)
        amplitude = amplitude_of(motion, orbit)[0]
        made.append(ForcedEvent(kind, motion.order * orbit.frequency, amplitude))
    return made


def _ends_at(branch: ForcedBranch, frequency: float) -> bool:
    """Whether a branch ended in rest at an edge."""
    at_rest = branch.amplitude[-1] == 0.0
    return bool(at_rest and abs(branch.frequency[-1] / frequency - 1.0) < 0.01)


def _described(
    motion: ForcedField, orbit: PeriodicOrbit, rtol: float, samples: int
) -> ForcedMotion:
    """A motion refined until its amplitude converges."""
    known: Known
    known, error, reason = refined_until(motion, orbit, 1e-3 * rtol, rtol, min(1e-7, 1e-2 * rtol))
    orbit = known.orbit
    multipliers, _, unsure = orbit_multipliers(motion, orbit)
    period = 2.0 * math.pi / orbit.frequency
    t = np.linspace(0.0, period, samples)
    y = orbit.states(orbit.frequency * t)
    q, qdot = motion.model.recorded(y[: motion.half].T.copy(), y[motion.half :].T.copy())
    found = ForcedMotion(
        amplitude=known.peak[0],
        frequency=motion.order * orbit.frequency,
        period=period,
        multipliers=multipliers,
        stable=bool(np.abs(multipliers).max() <= 1.0 + unit_of(unsure)),
        t=t,
        q=np.ascontiguousarray(q),
        qdot=np.ascontiguousarray(qdot),
        u=motion.speed(orbit),
        error=error,
        residual=residual(motion, orbit),
        model=motion.model,
        orbit=orbit,
    )
    if error > rtol:
        raise NotConverged(f"the motion is known to {error:.1e} only: {reason}", found)
    return found
