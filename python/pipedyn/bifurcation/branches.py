# SPDX-License-Identifier: MIT
"""Branches of cycles over the flow speed: from where they are born, past folds, with what changes.

A branch is followed by arc length (`arcs.arc`), within the speeds with Floquet multipliers at every
point. Folds are where the arc's tangent turns back; where the number of multipliers outside the
unit circle changes, the step is halved down to the change, and the multiplier that passes names it.
Cycles that leave a branch at pitchforks and period doublings are followed in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.bifurcation.arcs import (
    Birth,
    Breaking,
    Start,
    Step,
    arc,
    broken,
    from_birth,
    from_change,
    from_orbit,
    turns,
)
from pipedyn.bifurcation.equilibria import EquilibriumBranch, Rest
from pipedyn.bifurcation.events import SAME, CycleEvent, EventKind, excess, outside, passage
from pipedyn.bifurcation.floquet import returns, shortened
from pipedyn.bifurcation.fourier import Elsewhere, Equations, Orbit, is_odd
from pipedyn.bifurcation.hopf import tip_of
from pipedyn.bifurcation.limit_cycle import LimitCycle, NoCycle, amplitude_of, described, finished
from pipedyn.bifurcation.mesh import course_of
from pipedyn.bifurcation.normal_form import vectors
from pipedyn.bifurcation.vector_field import Field
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

NARROW = 1e-4
"""Share of a step to which an event is known."""

ROUGH = 1e-5
"""Roughness of the panels on which it is told which multiplier passes."""

BESIDE = 0.02
"""Share of a step around a fold in which its multiplier is not told from the trivial one."""

SLOW = 0.5
"""Share of a branch's highest frequency below which, still falling, it falls towards 0."""

TOLD = 1e-3
"""Error of the multipliers beyond which a cycle on a branch is left out, and the branch ends."""

SAMPLES = 65
"""States kept of each cycle."""

BEYOND, MOST_BEYOND, UNKNOWNS_BEYOND = 1.25, 40, 600
"""Factor by which a branch may leave both the speeds and its birth, since it may come back, steps
out there in a row, and unknowns beyond which a cycle of more than 128 phases is too dear there."""

GENERATIONS = 2
"""Of cycles that leave cycles, all those that leave first, then those that leave stable ones."""

Origin = Literal["hopf", "pitchfork", "period doubling", "motion"]


@result
class CycleBranch:
    """Cycles along a branch, which may turn in the flow speed, in order from where it is born.

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
        cycles: the cycles themselves; those at the speeds asked for meet the tolerance of
            `limit_cycle` or are listed as failures, those between some 1e-5.
        mirrored: whether the mirror images of its cycles are other cycles; they are not listed.
        origin: where it is born: "hopf" (at an equilibrium), "pitchfork" or "period doubling" (of a
            branch of cycles), or "motion": a motion ended on it, from where it was followed both
            ways, and it is listed from its end on the side of lower speeds.
        onset: flow speed at which it is born, NaN if that is unknown.
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
        """The cycles at one of the speeds asked for, in order along the branch."""
        u = check.real("u", u, low=0.0)
        return tuple(cycle for cycle in self.cycles if math.isclose(cycle.u, u, rel_tol=1e-12))

    def passes(self, u: float) -> bool:
        """Whether it has cycles on both sides of a speed, or at it."""
        u = check.real("u", u, low=0.0)
        return bool(self.speeds.min() <= u <= self.speeds.max())


Failed = tuple[float, Exception]
"""A flow speed and what was raised there."""


@dataclass(frozen=True)
class Asked:
    """What is asked of every branch.

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
        """Whether a speed lies within those asked for."""
        low, high = float(self.speeds[0]), float(self.speeds[-1])
        near = 1e-9 * (1.0 + high)
        return low - near <= u <= high + near


@dataclass(frozen=True)
class Traced:
    """A branch that was followed.

    Attributes:
        branch: what lies within the speeds asked for, if anything does.
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


def births(
    model: Model, branches: tuple[EquilibriumBranch, ...], highest: float
) -> Iterator[Birth | Failed]:
    """Hopf points of equilibria, of mirror images one, or what fails.

    Args:
        model: the model.
        branches: of its equilibria; of pipes that rest as they are built all onsets count, on these
            or not.
        highest: flow speed up to which these are sought.
    """
    motion, rest = Field(model), Rest(model)
    points: list[tuple[float, float, Array]] = []
    if rest.rests(highest):
        try:
            points += [
                (c.speed, c.frequency, rest.resting)
                for c in crossings(model, highest)
                if c.kind == "flutter" and c.speed > 0.0
            ]
        except PipedynError as error:
            yield highest, error
    for branch in branches:
        for point in branch.points:
            if point.kind == "hopf" and point.speed > 0.0 and not branch.straight:
                points.append((point.speed, point.frequency, rest.from_start("q", point.q)))
    known: list[tuple[float, float]] = []
    for u, frequency, x in points:
        if any(np.allclose((u, frequency), other, rtol=1e-6) for other in known):
            continue
        known.append((u, frequency))
        try:
            yield born(motion, np.concatenate([x, np.zeros(motion.half)]), u, frequency)
        except (PipedynError, ValueError) as error:
            yield u, error


def born(motion: Field, rest: Array, u: float, frequency: float) -> Birth:
    """The pair on the axis at an equilibrium.

    Args:
        motion: the model's.
        rest: the equilibrium, shape (2 moving,).
        u: flow speed.
        frequency: of the pair.

    Raises:
        ValueError, PipedynError: if there is no such pair, or two, or the free end stands still.
    """
    mode, _ = vectors(motion.jacobian(rest, u), frequency)
    mode = mode / tip_of(motion, rest, mode)
    return Birth(rest, mode, u, frequency)


def traced(
    model: Model, begin: Birth | Orbit, asked: Asked
) -> tuple[list[Traced], tuple[Failed, ...]]:
    """The branch of cycles from an onset, or both ways through a cycle, and those that leave it.

    Args:
        model: chain, reduced model or scene, up to 100 degrees of freedom.
        begin: the onset or the cycle.
        asked: what is asked of every branch.

    Returns:
        The branches and the speeds that failed.
    """
    motion = Field(model)
    failed: list[Failed] = []
    with one_thread(motion.size):
        event: CycleEvent | None = None
        u = begin.u if isinstance(begin, Orbit) else begin.speed
        try:
            if isinstance(begin, Orbit):
                starts = [from_orbit(motion, begin, sign) for sign in (-1.0, 1.0)]
            else:
                starts = [from_birth(motion, begin)]
                event = CycleEvent("hopf", u, 1e-6, 1.0 + 0j, 0.0)
        except Elsewhere as reason:
            return [], ((u, NoCycle(f"no cycle beside u = {u:g}: {reason}", u)),)
        found: list[Traced] = []
        _trace(motion, starts, event, asked, found, failed, GENERATIONS)
        return found, tuple(failed)


def _trace(
    motion: Field,
    starts: list[Start],
    begin: CycleEvent | None,
    asked: Asked,
    found: list[Traced],
    failed: list[Failed],
    generations: int,
) -> None:
    """A branch one way from an event or both ways from a cycle, and those that leave it."""
    ways: list[_Followed] = []
    for start in starts:
        ways.append(_Followed(motion, start, begin, asked, failed))
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
            leaving = [from_change(motion, orbit, kind)]
        except Elsewhere as reason:
            told = f"no cycles were found that leave the {kind} at u = {event.speed:g}: {reason}"
            failed.append((event.speed, NoCycle(told, event.speed)))
            continue
        _trace(motion, leaving, event, asked, found, failed, generations - 1)


def _joined(ways: list[_Followed]) -> Traced:
    """What was followed one way, or both ways from the same cycle."""
    way = ways[-1]
    cycles, events, begin = way.cycles, way.events, way.begin
    if len(ways) == 2:
        cycles = ways[0].cycles[:0:-1] + cycles
        events = ways[0].events[::-1] + events
        begin = ways[0].end
    cycles = [cycle for cycle in cycles if way.asked.holds(cycle.u)]
    if not cycles:
        return Traced(None, begin, way.end)
    branch = CycleBranch(
        speeds=np.array([cycle.u for cycle in cycles]),
        amplitudes=np.array([cycle.amplitude for cycle in cycles]),
        highest=np.array([float(cycle.tip[0, 0]) for cycle in cycles]),
        frequencies=np.array([cycle.frequency for cycle in cycles]),
        stable=np.array([cycle.stable for cycle in cycles]),
        multipliers=np.array([cycle.multipliers for cycle in cycles]),
        events=tuple(event for event in events if way.asked.holds(event.speed)),
        cycles=tuple(cycles),
        mirrored=not cycles[0].symmetric and is_odd(way.motion, cycles[0].u),
        origin=way.origin,
        onset=way.onset,
    )
    return Traced(branch, begin, way.end)


class _Followed:
    """A branch in the making, one way.

    Args:
        motion: the model's.
        start: where it sets out.
        begin: the event at which it is born, if that is known.
        asked: what is asked of it.
        failed: takes what fails.
    """

    def __init__(
        self,
        motion: Field,
        start: Start,
        begin: CycleEvent | None,
        asked: Asked,
        failed: list[Failed],
    ) -> None:
        self.motion, self.start, self.begin, self.asked = motion, start, begin, asked
        self.failed = failed
        self.origin: Origin = "motion"
        self.onset = math.nan
        told = f"a motion at u = {start.orbit.u:.6g}"
        if begin is not None:
            self.origin, self.onset = _origin(begin), begin.speed
            told = "onset" if begin.kind == "hopf" else begin.kind
            told = f"the {told} at u = {begin.speed:.6g}"
        self.how = f"followed from {told}"
        self.events = [] if begin is None else [begin]
        self.cycles: list[LimitCycle] = []
        self.forks: list[tuple[CycleEvent, Orbit, bool]] = []
        self.pace: list[float] = []
        self.end: CycleEvent | None = None
        self.closed = False
        lowest = min(float(asked.speeds[asked.speeds > 0.0][0]), start.orbit.u)
        highest = max(float(asked.speeds[-1]), start.orbit.u)
        self.far = lowest / BEYOND, highest * BEYOND

    def run(self) -> None:
        """Follows the branch until it ends, is far from the speeds or its steps run out.

        Beyond the speeds asked for nothing is told of it, so that multipliers are spared.
        """
        here, last, beyond = self.start.orbit, None, 0
        try:
            for number, step in enumerate(arc(self.motion, self.start)):
                if number == 0:
                    last = self._first()
                if self._vanishes(step):
                    return
                here = step.end
                self.pace.append(here.frequency)
                if self._asked_for(step):
                    last, beyond = self.noted(step, last), 0
                    if last.multiplier_error > TOLD:
                        raise Elsewhere(
                            f"its multipliers are known to {last.multiplier_error:.1e} only"
                        )
                else:
                    last, beyond = None, beyond + 1
                far = not self.far[0] < here.u < self.far[1]
                if far or self.closed or self.end is not None:
                    return
                if number + 1 >= self.asked.most or beyond == MOST_BEYOND:
                    raise Elsewhere("its steps ran out")
                if last is None and here.z.size > UNKNOWNS_BEYOND and here.phases.count > 128:
                    raise Elsewhere(f"beyond the speeds it takes {here.phases.count} phases")
        except Elsewhere as reason:
            if self._slowing():
                self._ends("infinite period", here, 0.0)
            else:
                self._stopped(here, str(reason))

    def _asked_for(self, step: Step) -> bool:
        """Whether a step comes to speeds asked for."""
        low, high = sorted((step.begin.u, step.end.u))
        return bool(low <= self.asked.speeds[-1] and high >= self.asked.speeds[0])

    def _first(self) -> LimitCycle | None:
        """Cycles at speeds asked for up to the first of the arc; that itself if it is one."""
        base, first = self.start.base, self.start.orbit
        if base is None:
            cycle = self._finished(first.u, lambda: first)
            if cycle is not None:
                self.keep(cycle)
            return cycle
        low, high = sorted((base.u, first.u))
        powers = (1.0, 0.5) if self.origin == "hopf" and self.motion.model.pipe.drag else (0.5,)
        asked = self.asked.speeds
        between = asked[(asked > low) & (asked < high)]
        for u in sorted(map(float, between), key=lambda u: abs(u - base.u)):

            def beside(u: float = u) -> Orbit:
                share = (u - base.u) / (first.u - base.u)
                guesses = [base.z + share**power * (first.z - base.z) for power in powers]
                for z in guesses:
                    found = _settled(self.motion, replace(first, z=z, u=u))
                    if found is not None and float(np.sum((found.z - base.z) * (z - base.z))) > 0.0:
                        return found
                raise Elsewhere("Newton's method fell back to what the branch leaves")

            cycle = self._finished(u, beside)
            if cycle is not None:
                self.keep(cycle)
        return None

    def _finished(self, u: float, orbit: Callable[[], Orbit]) -> LimitCycle | None:
        """The cycle at a speed asked for; None where there is none.

        What fails to meet the tolerance is told, and kept for what it is.
        """
        try:
            return finished(self.motion, orbit(), self.asked.rtol, SAMPLES, self.how)
        except Elsewhere as reason:
            self.failed.append((u, NoCycle(f"no cycle at u = {u:g}: {reason}", u)))
        except PipedynError as error:
            self.failed.append((u, error))
            if isinstance(error, NotConverged) and isinstance(error.result, LimitCycle):
                return error.result
        return None

    def _slowing(self) -> bool:
        """Whether the period seems to grow without bound."""
        pace = self.pace
        return len(pace) > 3 and pace[-1] < SLOW * max(pace) and pace[-1] < pace[-3]

    def described(self, orbit: Orbit) -> LimitCycle:
        """The cycle of an orbit, with its multipliers."""
        return described(self.motion, orbit, orbit.last_share, SAMPLES, self.how)

    def keep(self, cycle: LimitCycle) -> None:
        """Takes a cycle whose multipliers can be believed."""
        if cycle.multiplier_error <= TOLD:
            self.cycles.append(cycle)

    def _ends(self, kind: EventKind, orbit: Orbit, error: float) -> None:
        """Tells where the branch ends."""
        size = 0.0 if kind == "hopf" else amplitude_of(self.motion, orbit)[0]
        self.end = CycleEvent(kind, orbit.u, error, 1.0 + 0j, size)
        self.events.append(self.end)

    def _stopped(self, orbit: Orbit, why: str) -> None:
        """Tells that the branch was not followed further."""
        size = amplitude_of(self.motion, orbit)[0]
        self.events.append(CycleEvent("end", orbit.u, 0.0, 1.0 + 0j, size))
        told = f"the cycles {self.how} were not followed beyond u = {orbit.u:g}: {why}"
        self.failed.append((orbit.u, NotConverged(told)))

    # ----------------------------------------------------------------------- how it may end

    def _vanishes(self, step: Step) -> bool:
        """Whether the branch goes over into what it leaves within a step, at rest or unbroken."""
        for kind in self._breakings(step.begin):
            here, there = (_content(orbit, orbit.z, kind) for orbit in (step.begin, step.end))
            if float(np.sum(here * there)) >= 0.0:
                continue
            before, after = float(np.linalg.norm(here)), float(np.linalg.norm(there))
            if kind == "hopf":
                self._dies(step, before, after)
                return True
            # The speed is as the square of what vanishes.
            way = step.length * before / (before + after)
            beside = [step.at(0.6 * way), step.at(0.85 * way)]
            left = [float(np.sum(_content(near, near.z, kind) ** 2)) for near in beside]
            near, size = beside[1], left[1]
            at = [
                near.u + size * (near.u - u) / (other - size)
                for u, other in ((step.begin.u, before**2), (beside[0].u, left[0]))
            ]
            self._ends(kind, replace(near, u=at[1]), abs(at[1] - at[0]) + 1e-9)
            return True
        return False

    def _breakings(self, orbit: Orbit) -> Iterator[EventKind]:
        """At which events an orbit may meet what it breaks from."""
        yield "hopf"
        if not orbit.phases.half:
            yield "period doubling"
            if is_odd(self.motion, orbit.u):
                yield "pitchfork"

    def _dies(self, step: Step, before: float, after: float) -> None:
        """Tells at which onset a cycle shrinks to nothing."""
        u = step.begin.u + before / (before + after) * (step.end.u - step.begin.u)
        others = [onset for onset in self.asked.onsets if onset != self.onset]
        near = min(others, key=lambda onset: abs(onset - u), default=math.inf)
        known = abs(near - u) < 0.01 * u
        error = 1e-6 if known else abs(step.begin.u - u)
        self._ends("hopf", replace(step.begin, u=near if known else u), error)

    # ---------------------------------------------------------------------- what lies on it

    def noted(self, step: Step, last: LimitCycle | None) -> LimitCycle:
        """Keeps what lies on a step, and what changes there; the cycle at its end.

        Args:
            step: the step.
            last: the cycle at its beginning, if that is known and kept.
        """
        if last is None:
            last = self.described(step.begin)
            self.keep(last)
        end = self.described(step.end)
        if max(end.multiplier_error, last.multiplier_error) > TOLD:
            self.keep(end)
            return end
        marked: list[tuple[float, LimitCycle, CycleEvent | None]] = [(step.length, end, None)]
        lengths, orbits, low, before = [], [], 0.0, last
        for length in turns(step):
            top = step.at(length)
            cycle = self.described(top)
            lengths.append(length)
            orbits.append(top)
            marked.append((length, cycle, self._fold(step, length, cycle)))
            beside = BESIDE * step.length
            if length - beside > low:
                after = self.described(step.at(length - beside))
                marked += self._changes(step, low, length - beside, before, after)
            low = min(length + beside, step.length)
            before = self.described(step.at(low))
        if low < step.length:
            marked += self._changes(step, low, step.length, before, end)
        for a, b in pairwise([step.begin, *orbits, step.end]):
            marked += self._landed(step, step.part(a, b))
        for _, cycle, told in sorted(marked, key=lambda one: one[0]):
            self.keep(cycle)
            if told is not None:
                self.events.append(told)
        return end

    def _fold(self, step: Step, length: float, cycle: LimitCycle) -> CycleEvent:
        """Where the branch turns."""
        beside = step.at(length + 1e-3 * step.length)
        error = max(abs(beside.u - cycle.u), 1e-9)
        return CycleEvent("fold", cycle.u, error, 1.0 + 0j, cycle.amplitude)

    def _changes(
        self, step: Step, low: float, high: float, a: LimitCycle, b: LimitCycle
    ) -> Iterator[tuple[float, LimitCycle, CycleEvent | None]]:
        """Passages of multipliers through the unit circle between two lengths.

        One through 1 is that of a fold, which the tangent tells.
        """
        end = outside(b.multipliers)
        for _ in range(6):
            begin = outside(a.multipliers)
            if begin == end:
                return
            low, before, a, orbit = self._narrowed(step, low, high, a, b)
            course = shortened(self.motion, course_of(self.motion, orbit, ROUGH))
            kind, multiplier = passage(returns(self.motion, course), course.half)
            if kind == "fold":
                continue
            speed, error = 0.5 * (before.u + a.u), 0.5 * abs(before.u - a.u)
            size = 0.5 * (before.amplitude + a.amplitude)
            event = CycleEvent(kind, speed, error, multiplier, size)
            if kind != "torus" and self.asked.holds(speed):
                self.forks.append((event, orbit, before.stable or a.stable))
            yield low, a, event

    def _narrowed(
        self, step: Step, low: float, high: float, a: LimitCycle, b: LimitCycle
    ) -> tuple[float, LimitCycle, LimitCycle, Orbit]:
        """Where the number of multipliers outside the circle first differs from that at `low`.

        The modulus that passes 1 is a smooth function of the length, unless others pass as well:
        false position, with the end that stays put weighed down, or else halving.

        Returns:
            The length beyond the passage, the cycles on both sides and the orbit beyond.
        """
        begin = outside(a.multipliers)
        passing = begin - (outside(b.multipliers) < begin)
        orbit, stayed = step.end, -1
        sides = [excess(cycle.multipliers, passing) for cycle in (a, b)]
        for turn in range(40):
            if high - low <= NARROW * step.length:
                break
            share = 0.5 if turn % 4 == 3 else sides[0] / (sides[0] - sides[1])
            middle = low + min(max(share, 0.02), 0.98) * (high - low)
            found = step.at(middle)
            cycle = self.described(found)
            value = excess(cycle.multipliers, passing)
            before = outside(cycle.multipliers) == begin
            if before:
                low, a = middle, cycle
            else:
                high, b, orbit = middle, cycle, found
            stays = 1 if before else 0
            sides[1 - stays] = value
            sides[stays] *= 0.5 if stays == stayed else 1.0
            stayed = stays
        return high, a, b, orbit

    def _landed(
        self, step: Step, part: Step
    ) -> Iterator[tuple[float, LimitCycle, CycleEvent | None]]:
        """The cycles at the speeds asked for."""
        low, high = sorted((part.begin.u, part.end.u))
        speeds = self.asked.speeds
        passed = (speeds >= low) & (speeds <= high) & (speeds != part.begin.u)
        for u in map(float, speeds[passed]):
            places: list[Orbit] = []

            def landing(u: float = u, places: list[Orbit] = places) -> Orbit:
                places.append(part.landing(u))
                return places[0]

            cycle = self._finished(u, landing)
            if cycle is None:
                continue
            yield step.reach(places[0]), cycle, None
            self.closed = self.closed or self._is_first(cycle)

    def _is_first(self, cycle: LimitCycle) -> bool:
        """Whether a cycle is that from which the branch set out: it is closed."""
        first = self.start.orbit
        if self.begin is not None or cycle.u != first.u or len(self.cycles) < 4:
            return False
        return same_cycle(cycle, first.frequency, amplitude_of(self.motion, first)[0])


def _origin(begin: CycleEvent) -> Origin:
    origins: dict[str, Origin] = {
        "hopf": "hopf",
        "pitchfork": "pitchfork",
        "period doubling": "period doubling",
    }
    return origins[begin.kind]


def _settled(motion: Field, guess: Orbit) -> Orbit | None:
    """The cycle near a guess, None where Newton's method does not settle."""
    try:
        return Equations(motion, guess.phases).solve(guess)
    except Elsewhere:
        return None


def _content(orbit: Orbit, z: Array, kind: EventKind) -> Array:
    """What of an orbit vanishes where it meets what it breaks from."""
    if kind == "hopf":
        return z if orbit.phases.half else z - z.mean(axis=0)
    return broken(orbit, z, "pitchfork" if kind == "pitchfork" else "period doubling")


def same_cycle(cycle: LimitCycle, frequency: float, amplitude: float) -> bool:
    """Whether a cycle has a frequency and an amplitude."""
    apart = max(abs(cycle.frequency / frequency - 1.0), abs(cycle.amplitude / amplitude - 1.0))
    return apart < SAME
