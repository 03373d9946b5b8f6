# SPDX-License-Identifier: MIT
"""Branches of cycles over the flow speed: from where they begin, past folds, with their events.

A branch is followed by arc length (`orbit_continuation.followed`), within the speeds with Floquet
multipliers at every point. Folds are where the tangent turns back; where the number of multipliers
outside the unit circle changes, the step is narrowed down to the event, and the multiplier that
passes names it. Cycles that leave a branch at pitchforks and period doublings are followed in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipedyn.bifurcation.collocation import solved
from pipedyn.bifurcation.continuation import Point, Segment, folds
from pipedyn.bifurcation.cycles import LimitCycle, NoCycle, amplitude_of, finished, on_branch
from pipedyn.bifurcation.equilibrium_branch import EquilibriumBranch
from pipedyn.bifurcation.events import SAME, CycleEvent, EventKind, crossing_event, excess, outside
from pipedyn.bifurcation.floquet import multiplier_roots
from pipedyn.bifurcation.hopf import HopfPoint, hopf_point
from pipedyn.bifurcation.orbit_continuation import (
    FINE,
    BranchStart,
    Breaking,
    OrbitStep,
    breaking_part,
    followed,
    from_branch_point,
    from_hopf,
    from_orbit,
)
from pipedyn.bifurcation.periodic_orbit import PeriodicOrbit
from pipedyn.bifurcation.statics import Statics
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

NARROW = 1e-4
"""Share of a step to which an event is known."""

FOLD = 1e-5
"""Share of a step to which the place of a fold is known; its speed is so to the square of that."""

BESIDE = 0.02
"""Share of a step around a fold in which its multiplier is too near to the trivial one."""

MOST_CROSSINGS = 6
"""Multipliers that cross the unit circle on one step: more at once have not been met, and each
costs some ten orbits."""

SLOW = 0.5
"""Share of a branch's highest frequency below which, still falling, it falls towards 0."""

DOUBTFUL = 1e-3
"""Error of the multipliers beyond which a cycle on a branch is left out, and the branch ends."""

SAMPLES = 65
"""States kept of each cycle."""

BEYOND, MOST_BEYOND, INTERVALS_BEYOND = 1.25, 40, 100
"""Factor by which a branch may leave both the speeds and its beginning, since it may come back,
steps out there in a row, and mesh intervals beyond which an orbit is too costly there."""

GENERATIONS = 2
"""Of cycles that leave cycles, all those that leave first, then those that leave stable ones."""

Origin = Literal["hopf", "pitchfork", "period doubling", "motion"]
ORIGINS: dict[str, Origin] = {str(name): name for name in get_args(Origin)}


@result
class CycleBranch:
    """Cycles along a branch, which may turn in the flow speed, in order from where it begins.

    Attributes:
        speeds: u, shape (S,).
        amplitudes: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        highest: largest transverse position of the free end in L, shape (S,); the smallest lies two
            amplitudes below.
        frequencies: angular, in 1 / T, shape (S,).
        stable: shape (S,).
        multipliers: Floquet multipliers, the largest first, the trivial one among them, shape
            (S, n).
        events: in order along the branch.
        cycles: the cycles themselves; those at the speeds given meet the tolerance of
            `limit_cycle` or are listed as failures, those between some 1e-5.
        mirrored: whether the mirror images of its cycles are other cycles; they are not listed.
        origin: where it begins: "hopf" (at an equilibrium), "pitchfork" or "period doubling" (of a
            branch of cycles), or "motion": a motion ended on it, from where it was followed both
            ways, and it is listed from its end on the side of lower speeds.
        onset: flow speed at which it begins, NaN if that is unknown.
    """

    speeds: Array
    amplitudes: Array
    highest: Array = field(repr=False)
    frequencies: Array
    stable: NDArray[np.bool_] = field(repr=False)
    multipliers: Complex = field(repr=False)
    events: tuple[CycleEvent, ...]
    cycles: tuple[LimitCycle, ...] = field(repr=False)
    mirrored: bool = False
    origin: Origin = "hopf"
    onset: float = math.nan

    def __len__(self) -> int:
        return len(self.speeds)

    def at(self, u: float) -> tuple[LimitCycle, ...]:
        """The cycles at one of the speeds given, in order along the branch."""
        u = check.real("u", u, low=0.0)
        return tuple(cycle for cycle in self.cycles if math.isclose(cycle.u, u, rel_tol=1e-12))

    def passes(self, u: float) -> bool:
        """Whether it has cycles on both sides of a speed, or at it."""
        u = check.real("u", u, low=0.0)
        return bool(self.speeds.min() <= u <= self.speeds.max())


Failed = tuple[float, Exception]
"""A flow speed and what was raised there."""


@dataclass(frozen=True)
class BranchOptions:
    """How branches are followed.

    Attributes:
        speeds: flow speeds at which cycles are solved for, increasing.
        rtol: relative tolerance of the cycles there.
        most: steps along one branch at most.
        onsets: speeds of all onsets of flutter, at one of which a branch may end.
    """

    speeds: Array
    rtol: float
    most: int
    onsets: tuple[float, ...] = ()

    def holds(self, u: float) -> bool:
        """Whether a speed lies within those given."""
        low, high = float(self.speeds[0]), float(self.speeds[-1])
        near = 1e-9 * (1.0 + high)
        return low - near <= u <= high + near


@dataclass(frozen=True)
class Traced:
    """A branch that was followed.

    Attributes:
        branch: what lies within the speeds given, if anything does.
        begin, end: events at which it begins and ends, wherever; None where it goes on.
    """

    branch: CycleBranch | None
    begin: CycleEvent | None
    end: CycleEvent | None

    def retraces(self, other: Traced) -> bool:
        """Whether it leads from where the other ends to where that begins."""
        return _same(self.end, other.begin) and _same(self.begin, other.end)


def _same(a: CycleEvent | None, b: CycleEvent | None) -> bool:
    return a is not None and b is not None and a.same(b)


def hopf_points(
    model: Model, branches: tuple[EquilibriumBranch, ...], highest: float
) -> Iterator[HopfPoint | Failed]:
    """Hopf points of equilibria, of mirror images one, or what fails.

    Args:
        model: the model.
        branches: of its equilibria; of pipes that rest as they are built all onsets count, on these
            or not.
        highest: flow speed up to which these are sought.
    """
    motion, statics = VectorField(model), Statics(model)
    points: list[tuple[float, float, Array]] = []
    if statics.rests(highest):
        try:
            points += [
                (c.speed, c.frequency, statics.resting)
                for c in crossings(model, highest)
                if c.kind == "flutter" and c.speed > 0.0
            ]
        except PipedynError as error:
            yield highest, error
    for branch in branches:
        for point in branch.points:
            if point.kind == "hopf" and point.speed > 0.0 and not branch.straight:
                points.append((point.speed, point.frequency, statics.from_start("q", point.q)))
    known: list[tuple[float, float]] = []
    for u, frequency, x in points:
        if any(np.allclose((u, frequency), other, rtol=1e-6) for other in known):
            continue
        known.append((u, frequency))
        try:
            yield hopf_point(motion, np.concatenate([x, np.zeros(motion.half)]), u, frequency)
        except (PipedynError, ValueError) as error:
            yield u, error


def traced(
    model: Model, begin: HopfPoint | PeriodicOrbit, options: BranchOptions
) -> tuple[list[Traced], tuple[Failed, ...]]:
    """The branch of cycles from an onset, or both ways through a cycle, and those that leave it.

    Args:
        model: chain, reduced model or scene, up to 100 degrees of freedom.
        begin: the onset or the cycle.
        options: how branches are followed.

    Returns:
        The branches and the speeds that failed.
    """
    motion = VectorField(model)
    failed: list[Failed] = []
    with one_thread(motion.size):
        event: CycleEvent | None = None
        u = begin.u if isinstance(begin, PeriodicOrbit) else begin.speed
        try:
            if isinstance(begin, PeriodicOrbit):
                starts = [from_orbit(motion, begin, sign) for sign in (-1.0, 1.0)]
            else:
                starts = [from_hopf(motion, begin)]
                event = CycleEvent("hopf", u, 1e-6, 1.0 + 0j, 0.0)
        except NewtonFailed as reason:
            return [], ((u, NoCycle(f"no cycle beside u = {u:g}: {reason}", u)),)
        found: list[Traced] = []
        _trace(motion, starts, event, options, found, failed, GENERATIONS)
        return found, tuple(failed)


def _trace(
    motion: VectorField,
    starts: list[BranchStart],
    begin: CycleEvent | None,
    options: BranchOptions,
    found: list[Traced],
    failed: list[Failed],
    generations: int,
) -> None:
    """A branch one way from an event or both ways from a cycle, and those that leave it."""
    ways: list[_Follower] = []
    for start in starts:
        ways.append(_Follower(motion, start, begin, options, failed))
        ways[-1].run()
        if ways[-1].closed:
            ways = ways[-1:]
            break
    found.append(_joined(ways))
    for event, orbit, stable in [fork for way in ways for fork in way.forks]:
        followed = generations == GENERATIONS or (stable and generations > 0)
        ends = (end for other in found for end in (other.begin, other.end))
        if not followed or any(_same(event, end) for end in ends):
            continue
        kind: Breaking = "pitchfork" if event.kind == "pitchfork" else "period doubling"
        try:
            leaving = [from_branch_point(motion, orbit, kind)]
        except NewtonFailed as reason:
            report = f"no cycles were found that leave the {kind} at u = {event.speed:g}: {reason}"
            failed.append((event.speed, NoCycle(report, event.speed)))
            continue
        _trace(motion, leaving, event, options, found, failed, generations - 1)


def _joined(ways: list[_Follower]) -> Traced:
    """What was followed one way, or both ways from the same cycle."""
    way = ways[-1]
    cycles, events, begin = way.cycles, way.events, way.begin
    if len(ways) == 2:
        cycles = ways[0].cycles[:0:-1] + cycles
        events = ways[0].events[::-1] + events
        begin = ways[0].end
    cycles = [cycle for cycle in cycles if way.options.holds(cycle.u)]
    if not cycles:
        return Traced(None, begin, way.end)
    branch = CycleBranch(
        speeds=np.array([cycle.u for cycle in cycles]),
        amplitudes=np.array([cycle.amplitude for cycle in cycles]),
        highest=np.array([float(cycle.tip[0, 0]) for cycle in cycles]),
        frequencies=np.array([cycle.frequency for cycle in cycles]),
        stable=np.array([cycle.stable for cycle in cycles]),
        multipliers=np.array([cycle.multipliers for cycle in cycles]),
        events=tuple(event for event in events if way.options.holds(event.speed)),
        cycles=tuple(cycles),
        mirrored=not cycles[0].symmetric and way.motion.is_odd(cycles[0].u),
        origin=way.origin,
        onset=way.onset,
    )
    return Traced(branch, begin, way.end)


@dataclass(frozen=True)
class _Place:
    """A point of a step.

    Attributes:
        length: from the step's beginning.
        point: the solution.
        cycle: with its multipliers.
        event: what happens there.
    """

    length: float
    point: Point
    cycle: LimitCycle
    event: CycleEvent | None = None


class _Follower:
    """A branch in the making, one way.

    Args:
        motion: the model's.
        start: where it sets out.
        begin: the event at which it begins, if that is known.
        options: how it is followed.
        failed: takes what fails.
    """

    def __init__(
        self,
        motion: VectorField,
        start: BranchStart,
        begin: CycleEvent | None,
        options: BranchOptions,
        failed: list[Failed],
    ) -> None:
        self.motion, self.start, self.begin, self.options = motion, start, begin, options
        self.failed = failed
        self.origin: Origin = "motion"
        self.onset = math.nan
        self.how = f"followed from a motion at u = {start.orbit.u:.6g}"
        if begin is not None:
            self.origin, self.onset = ORIGINS[begin.kind], begin.speed
            where = "onset" if begin.kind == "hopf" else begin.kind
            self.how = f"followed from the {where} at u = {begin.speed:.6g}"
        self.events = [] if begin is None else [begin]
        self.cycles: list[LimitCycle] = []
        self.forks: list[tuple[CycleEvent, PeriodicOrbit, bool]] = []
        self.pace: list[float] = []
        self.end: CycleEvent | None = None
        self.closed = False
        lowest = min(float(options.speeds[options.speeds > 0.0][0]), start.orbit.u)
        highest = max(float(options.speeds[-1]), start.orbit.u)
        self.far = lowest / BEYOND, highest * BEYOND

    def run(self) -> None:
        """Follows the branch until it ends, is far from the speeds or its steps run out.

        Beyond the speeds given multipliers are not computed.
        """
        here, last, beyond = self.start.orbit, None, 0
        try:
            for number, step in enumerate(followed(self.motion, self.start, FINE)):
                if number == 0:
                    last = self._first()
                if self._vanishes(step):
                    return
                here = step.end
                self.pace.append(here.frequency)
                low, high = sorted((step.begin.u, here.u))
                if low <= self.options.speeds[-1] and high >= self.options.speeds[0]:
                    last, beyond = self.noted(step, last), 0
                    if last.multiplier_error > DOUBTFUL:
                        raise NewtonFailed(
                            f"its multipliers are known to {last.multiplier_error:.1e} only"
                        )
                else:
                    last, beyond = None, beyond + 1
                far = not self.far[0] < here.u < self.far[1]
                if far or self.closed or self.end is not None:
                    return
                if number + 1 >= self.options.most or beyond == MOST_BEYOND:
                    raise NewtonFailed("its steps ran out")
                if last is None and here.edges.size > INTERVALS_BEYOND:
                    raise NewtonFailed(f"beyond the speeds it takes {here.edges.size} intervals")
        except NewtonFailed as reason:
            if self._slowing():
                self._ends("infinite period", here, 0.0)
            else:
                self._stopped(here, str(reason))

    def _first(self) -> LimitCycle | None:
        """Cycles at speeds given up to the branch's first; that itself if its speed is one."""
        base, first = self.start.base, self.start.orbit
        if base is None:
            cycle = self._finished(first.u, first)
            if cycle is not None:
                self.keep(cycle)
            return cycle
        low, high = sorted((base.u, first.u))
        speeds = self.options.speeds
        between = speeds[(speeds > low) & (speeds < high)]
        for u in sorted(map(float, between), key=lambda u: abs(u - base.u)):
            orbit = self._beside(base, u)
            if orbit is None:
                self._no_cycle(u, "Newton's method fell back to what the branch leaves")
            elif (cycle := self._finished(u, orbit)) is not None:
                self.keep(cycle)
        return None

    def _beside(self, base: PeriodicOrbit, u: float) -> PeriodicOrbit | None:
        """The orbit at a speed between that of what the branch leaves and that of its first."""
        first = self.start.orbit
        share = (u - base.u) / (first.u - base.u)
        along = first.packed() - base.packed()
        powers = (1.0, 0.5) if self.origin == "hopf" and self.motion.model.pipe.drag else (0.5,)
        for power in powers:
            guess = replace(first.unpacked(base.packed() + share**power * along), u=u)
            with suppress(NewtonFailed):
                found = solved(self.motion, guess, FINE.control.tolerance)
                if float(np.vdot(found.starts - base.starts, guess.starts - base.starts)) > 0.0:
                    return found
        return None

    def _no_cycle(self, u: float, reason: object) -> None:
        """Takes note of a speed at which no cycle was found."""
        self.failed.append((u, NoCycle(f"no cycle at u = {u:g}: {reason}", u)))

    def _finished(self, u: float, orbit: PeriodicOrbit) -> LimitCycle | None:
        """The cycle of the orbit at one of the speeds given; None where there is none.

        What fails to meet the tolerance is a failure, and kept for what it is.
        """
        try:
            return finished(self.motion, orbit, self.options.rtol, SAMPLES, self.how)
        except PipedynError as error:
            self.failed.append((u, error))
            if isinstance(error, NotConverged) and isinstance(error.result, LimitCycle):
                return error.result
        return None

    def _slowing(self) -> bool:
        """Whether the period seems to grow without bound."""
        pace = self.pace
        return len(pace) > 3 and pace[-1] < SLOW * max(pace) and pace[-1] < pace[-3]

    def described(self, orbit: PeriodicOrbit) -> LimitCycle:
        """The cycle of an orbit, with its multipliers."""
        return on_branch(self.motion, orbit, FINE.defect, SAMPLES, self.how)

    def keep(self, cycle: LimitCycle) -> None:
        """Takes a cycle whose multipliers can be believed."""
        if cycle.multiplier_error <= DOUBTFUL:
            self.cycles.append(cycle)

    def _ends(self, kind: EventKind, orbit: PeriodicOrbit, error: float) -> None:
        """Tells where the branch ends."""
        size = 0.0 if kind == "hopf" else amplitude_of(self.motion, orbit)[0]
        self.end = CycleEvent(kind, orbit.u, error, 1.0 + 0j, size)
        self.events.append(self.end)

    def _stopped(self, orbit: PeriodicOrbit, why: str) -> None:
        """Tells that the branch was not followed further."""
        size = amplitude_of(self.motion, orbit)[0]
        self.events.append(CycleEvent("end", orbit.u, 0.0, 1.0 + 0j, size))
        report = f"the cycles {self.how} were not followed beyond u = {orbit.u:g}: {why}"
        self.failed.append((orbit.u, NotConverged(report)))

    # ----------------------------------------------------------------------- how it may end

    def _vanishes(self, step: OrbitStep) -> bool:
        """Whether the branch goes over into what it leaves within a step, at rest or unbroken."""
        for kind in self._breakings(step.begin):
            here, there = (breaking_part(orbit, kind) for orbit in (step.begin, step.end))
            if float(np.sum(here * there)) >= 0.0:
                continue
            before, after = float(np.linalg.norm(here)), float(np.linalg.norm(there))
            if kind == "hopf":
                self._dies(step, before, after)
                return True
            # The speed is as the square of what vanishes.
            way = step.length * before / (before + after)
            beside = [step.at(0.6 * way), step.at(0.85 * way)]
            left = [float(np.sum(breaking_part(near, kind) ** 2)) for near in beside]
            near, size = beside[1], left[1]
            at = [
                near.u + size * (near.u - u) / (other - size)
                for u, other in ((step.begin.u, before**2), (beside[0].u, left[0]))
            ]
            self._ends(kind, replace(near, u=at[1]), abs(at[1] - at[0]) + 1e-9)
            return True
        return False

    def _breakings(self, orbit: PeriodicOrbit) -> Iterator[EventKind]:
        """At which events an orbit may meet what it breaks from."""
        yield "hopf"
        if not orbit.symmetric:
            yield "period doubling"
            if self.motion.is_odd(orbit.u):
                yield "pitchfork"

    def _dies(self, step: OrbitStep, before: float, after: float) -> None:
        """Tells at which onset a cycle shrinks to nothing."""
        u = step.begin.u + before / (before + after) * (step.end.u - step.begin.u)
        others = [onset for onset in self.options.onsets if onset != self.onset]
        near = min(others, key=lambda onset: abs(onset - u), default=math.inf)
        known = abs(near - u) < 0.01 * u
        error = 1e-6 if known else abs(step.begin.u - u)
        self._ends("hopf", replace(step.begin, u=near if known else u), error)

    # ---------------------------------------------------------------------- what lies on it

    def noted(self, step: OrbitStep, last: LimitCycle | None) -> LimitCycle:
        """Keeps what lies on a step and its events; the cycle at its end.

        Args:
            step: the step.
            last: the cycle at its beginning, if that is known and kept.
        """
        segment = step.segment
        if last is None:
            last = self.described(step.begin)
            self.keep(last)
        end = self._place(step, step.length, segment.end)
        if max(end.cycle.multiplier_error, last.multiplier_error) > DOUBTFUL:
            self.keep(end.cycle)
            return end.cycle
        low, beside = _Place(0.0, segment.begin, last), BESIDE * step.length
        places, ends = [end], [segment.begin]
        for length in folds(segment, FOLD):
            top = self._place(step, length)
            u, amplitude = top.cycle.u, top.cycle.amplitude
            error = max(abs(step.at(length + 1e-3 * step.length).u - u), 1e-9)
            event = CycleEvent("fold", u, error, 1.0 + 0j, amplitude)
            places.append(replace(top, event=event))
            ends.append(top.point)
            if length - beside > low.length:
                places += self._crossings(step, low, self._place(step, length - beside))
            low = self._place(step, min(length + beside, step.length))
        if low.length < step.length:
            places += self._crossings(step, low, end)
        for a, b in pairwise([*ends, segment.end]):
            places += self._at_speeds(step, segment.part(a, b))
        for place in sorted(places, key=lambda one: one.length):
            self.keep(place.cycle)
            if place.event is not None:
                self.events.append(place.event)
        return end.cycle

    def _place(self, step: OrbitStep, length: float, point: Point | None = None) -> _Place:
        """A point of a step, solved for where it is not given, and its cycle."""
        point = step.segment.at(length) if point is None else point
        return _Place(length, point, self.described(step.problem.orbit(point.z)))

    def _crossings(self, step: OrbitStep, low: _Place, high: _Place) -> Iterator[_Place]:
        """Where multipliers cross the unit circle between two places, but for folds.

        Those show in the tangent.
        """
        for _ in range(MOST_CROSSINGS):
            if outside(low.cycle.multipliers) == outside(high.cycle.multipliers):
                return
            before, low = self._narrowed(step, low, high)
            orbit = step.problem.orbit(low.point.z)
            roots = multiplier_roots(self.motion, orbit)
            kind, multiplier = crossing_event(roots, orbit.symmetric)
            if kind == "fold":
                continue
            a, b = before.cycle, low.cycle
            speed, error = 0.5 * (a.u + b.u), 0.5 * abs(a.u - b.u)
            event = CycleEvent(kind, speed, error, multiplier, 0.5 * (a.amplitude + b.amplitude))
            if kind != "torus" and self.options.holds(speed):
                self.forks.append((event, orbit, a.stable or b.stable))
            yield replace(low, event=event)

    def _narrowed(self, step: OrbitStep, low: _Place, high: _Place) -> tuple[_Place, _Place]:
        """Places right before and beyond the first crossing of a multiplier.

        The modulus that passes 1 is a smooth function of the length, unless others pass as well.
        """
        begin = outside(low.cycle.multipliers)
        passing = begin - (outside(high.cycle.multipliers) < begin)
        known = {place.length: place for place in (low, high)}

        def value(length: float) -> float:
            if length not in known:
                known[length] = self._place(step, length)
            return excess(known[length].cycle.multipliers, passing)

        brentq(value, low.length, high.length, xtol=NARROW * step.length)
        places = sorted(known.values(), key=lambda one: one.length)
        beyond = next(i for i, one in enumerate(places) if outside(one.cycle.multipliers) != begin)
        return places[beyond - 1], places[beyond]

    def _at_speeds(self, step: OrbitStep, part: Segment) -> Iterator[_Place]:
        """The cycles at the speeds given."""
        low, high = sorted((part.begin.p, part.end.p))
        speeds = self.options.speeds
        passed = (speeds >= low) & (speeds <= high) & (speeds != part.begin.p)
        if len(self.pace) == 1 and self.start.base is None:  # the first orbit is kept already
            passed &= ~np.isclose(speeds, self.start.orbit.u, rtol=1e-7, atol=0.0)
        for u in map(float, speeds[passed]):
            try:
                point = part.where(u)
            except NewtonFailed as reason:
                self._no_cycle(u, reason)
                continue
            cycle = self._finished(u, step.problem.orbit(point.z))
            if cycle is not None:
                yield _Place(step.segment.reach(point.z), point, cycle)
                self.closed = self.closed or self._is_first(cycle)

    def _is_first(self, cycle: LimitCycle) -> bool:
        """Whether a cycle is that from which the branch set out: it is closed."""
        first = self.start.orbit
        if self.begin is not None or cycle.u != first.u or len(self.cycles) < 4:
            return False
        return same_cycle(cycle, first.frequency, amplitude_of(self.motion, first)[0])


def same_cycle(cycle: LimitCycle, frequency: float, amplitude: float) -> bool:
    """Whether a cycle has a frequency and an amplitude."""
    apart = max(abs(cycle.frequency / frequency - 1.0), abs(cycle.amplitude / amplitude - 1.0))
    return apart < SAME
