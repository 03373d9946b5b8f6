# SPDX-License-Identifier: MIT
"""Branches of cycles over the flow speed, from their beginnings, past folds, with their events.

A branch is followed by arc length (`orbit_continuation.followed`), with Floquet multipliers at
every point within the speeds. A fold is a point where the tangent turns back; where the number of
multipliers outside the unit circle changes, the step is narrowed down to the event, and the
multiplier that passes the circle names it. Cycles that leave a branch at pitchforks and period
doublings are followed in turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import Point
from pipedyn.continuation.tracer import Tracer, special_points
from pipedyn.cycles.limit_cycle import (
    ON_BRANCH,
    LimitCycle,
    NoCycle,
    amplitude_of,
    converged_cycle,
    cycle_on_mesh,
    in_space,
    limit_cycle,
    on_branch,
)
from pipedyn.equilibrium.equilibria import BranchPoint, EquilibriumBranch
from pipedyn.equilibrium.hopf import HopfPoint, hopf_point
from pipedyn.equilibrium.statics import statics_of
from pipedyn.linear.critical_speed import crossings
from pipedyn.linear.sensitivity import Crossing
from pipedyn.models.base import BALANCED, Model
from pipedyn.motion.sampling import farthest_direction
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import OrbitProblem
from pipedyn.orbits.floquet import (
    LARGEST_ERROR,
    CircleTest,
    EventKind,
    beyond_circle,
    nontrivial,
    orbit_multipliers,
    uncoupled,
)
from pipedyn.orbits.orbit_continuation import (
    FINE,
    GRAZES,
    NEAR_FOLD,
    BranchStart,
    Grazing,
    Meeting,
    Step,
    both_ways,
    breaking_part,
    from_branch_point,
    from_hopf,
    meeting,
    orbit_at,
    steps_past_grazing,
)
from pipedyn.orbits.periodic_orbit import PROBES, PeriodicOrbit
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.newton import NewtonFailed, zero_between
from pipedyn.util.parallel import Progress, one_thread, share_of_way
from pipedyn.util.result import SPEED, Result, TableResult

Failed = tuple[float, Exception]
"""A flow speed and the exception that was raised there."""

SAME_CYCLE = 1e-4
"""Relative difference below which two cycles, or the speeds of two events, are the same: orbits on
a coarse mesh (`orbit_continuation.COARSE`) were measured to err by 4e-6 at most."""

UNSURE = 4
"""Number of steps, from the first cycle with unsure multipliers on, after which a branch ends:
these steps show whether its period grows without end, as it does where multipliers are too far
apart to be known."""

VERTICAL, STEEP = 3e-5, 1e-3
"""Relative change of the speed while the frequency falls by a factor e, over three steps. Below the
first value, at less than half the largest frequency, a branch ends with an infinite period: the
speed converges exponentially to a limit. Below the second, a branch that cannot be followed ends
so."""

SAMPLES_A_CYCLE = 65
"""Number of states kept of each cycle: measured, cubics through them err by 1.5e-6 at most in five
cycles."""

BEYOND, MOST_BEYOND, INTERVALS_BEYOND = 1.25, 40, 100
"""Factor by which a branch may go beyond both the speeds and its beginning, since it may come back;
largest number of consecutive steps out there; and number of mesh intervals beyond which an orbit is
too costly there. Measured on seven pipes, branches came back six times from up to 1.22 times as
far, after 10 steps and with 21 intervals at most, and once from 2.3 times as far, after 32
steps."""

RESOLVED_RANGE, NARROW, WINDING = 0.05, 0.05, 24
"""Share of the range of speeds that a branch has to span so that branches that leave it are
followed, or the least gap of the speeds if that is smaller; the share of this within which a
winding branch, for example one near a homoclinic orbit, is followed no further; and the number of
steps after which it ends. Speeds that are closer together ask for narrower branches."""

PLACE_OUT_OF_PLANE = 1e-6
"""Relative error of a speed at which cycles begin to leave their plane."""

GENERATIONS = 2
"""Number of generations of cycles that leave cycles that are followed: all of the first, then those
that leave stable ones, since their number may grow without end (a cascade of period doublings)."""

Origin = Literal["hopf", "pitchfork", "period doubling", "branch point", "motion"]


@saved_as("CycleEvent")
class CycleEvent(Result, units={"error": SPEED}):
    """Event at which the stability of a branch of cycles changes, or the branch turns or ends.

    Attributes:
        kind: "fold" (the branch turns back), "pitchfork" (a cycle that is its own mirror image
            meets two that are not), "period doubling" (it meets one of twice its period: a
            multiplier passes -1), "torus" (a pair passes the unit circle), "grazing" (it begins or
            ceases to touch a stop), "hopf" (its amplitude falls to 0), "infinite period" (the
            frequency falls towards 0, as where a cycle meets an equilibrium), "branch point" (in
            three dimensions, motions across the plane of the cycle begin or cease to grow, or ones
            that are not, half a period later, their mirror images in the plane z = 0; those that
            leave there are followed unless the pipe is the same in all directions, where they
            precess) or "end" (it was not followed further).
        speed: u.
        error: half the length of the interval of speeds that is known to contain the event.
        multiplier: the multiplier that passes, on the unit circle: 1 at a fold and a pitchfork, and
            where the branch begins, ends or grazes; -1 at a doubling.
        amplitude: amplitude of the cycle.
    """

    kind: EventKind
    speed: float
    error: float
    multiplier: complex
    amplitude: float

    def same(self, other: CycleEvent) -> bool:
        """Whether two branches meet in one event; raises TypeError if `other` is no event."""
        check.instance("other", other, CycleEvent, "a CycleEvent")
        apart = abs(self.speed - other.speed)
        near = SAME_CYCLE * self.speed + 3.0 * (self.error + other.error)
        equal = abs(self.amplitude - other.amplitude) <= 0.1 * self.amplitude
        return self.kind == other.kind and apart <= near and equal


@saved_as("CycleBranch")
class CycleBranch(TableResult):
    """Cycles along a branch, which may turn in the flow speed, in order from its beginning.

    The first row is the bifurcation at which it begins, if that lies within the speeds, and the
    last one a Hopf point if it ends there. At a bifurcation the multiplier that passes the unit
    circle does not count as unstable.

    Attributes:
        speeds: u, shape (S,).
        amplitudes: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        highest: largest transverse position of the free end in L, shape (S,); the smallest lies two
            amplitudes below. In three dimensions both are along the direction in which the free
            end moves farthest.
        frequencies: angular frequencies, in 1 / T, shape (S,).
        stable: whether each cycle is stable, shape (S,).
        multipliers: Floquet multipliers, the largest first, the trivial one among them, shape
            (S, n).
        events: events, in order along the branch.
        cycles: the cycles themselves; those at the speeds given meet the tolerance of
            `limit_cycle` or are listed as failures, those between some 1e-5. At a Hopf point
            the cycle has no amplitude, and multipliers as the pipe at rest after a period.
        mirrored: whether the mirror images of its cycles are other cycles; they are not listed.
        origin: beginning of the branch: "hopf" (at an equilibrium), "pitchfork", "period
            doubling" or "branch point" (of a branch of cycles), or "motion" (a motion ended on one
            of its cycles, and the branch was followed both ways from it; it is listed from the end
            at lower speeds).
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
        """The cycles at one of the speeds given that are not at rest, in order along the branch."""
        u = check.real("u", u, low=0.0)
        near = (one for one in self.cycles if math.isclose(one.u, u, rel_tol=1e-12))
        return tuple(one for one in near if one.moves)

    def _columns(self) -> dict[str, Any]:
        return {
            "speed": self.speeds,
            "amplitude": self.amplitudes,
            "highest": self.highest,
            "frequency": self.frequencies,
            "stable": self.stable,
        }


@dataclass(frozen=True)
class BranchOptions:
    """Options with which branches are followed."""

    speeds: Array  # speeds at which cycles are solved for, increasing
    rtol: float  # relative tolerance of the cycles there
    most: int  # largest number of steps along one branch
    onsets: tuple[float, ...] = ()  # speeds of flutter onsets, where a branch may end
    shown: bool = False  # whether steps are counted on stderr
    known: tuple[CycleBranch, ...] = ()  # a branch that meets one of these repeats it from there

    @property
    def finest(self) -> float:
        """Least range of speeds that is resolved: their smallest gap, or a share of their range."""
        return float(min(np.diff(self.speeds).min(), RESOLVED_RANGE * np.ptp(self.speeds)))

    def holds(self, u: float) -> bool:
        """Whether a speed lies within those given."""
        low, high = float(self.speeds[0]), float(self.speeds[-1])
        near = 1e-9 * (1.0 + high)
        return low - near <= u <= high + near


@dataclass(frozen=True)
class Traced:
    """A branch that was followed, with the events at its two ends."""

    branch: CycleBranch | None  # its part within the speeds given, if any
    begin: CycleEvent | None  # wherever its beginning is; None where the branch goes on
    end: CycleEvent | None

    def spans(self, speeds: float) -> bool:
        """Whether its cycles span at least a given range of speeds."""
        return self.branch is not None and bool(np.ptp(self.branch.speeds) >= speeds)

    def is_reverse(self, other: Traced) -> bool:
        """Whether it is another branch followed in the opposite direction."""
        pairs = ((self.end, other.begin), (self.begin, other.end))
        return all(a is not None and b is not None and a.same(b) for a, b in pairs)

    def repeats(self, others: Sequence[CycleBranch], speeds: Array) -> bool:
        """Whether all its cycles at the speeds given lie on other branches."""
        cycles = () if self.branch is None else self.branch.cycles
        there = [is_on_any(others, cycle) for cycle in cycles if cycle.u in speeds]
        return bool(there) and all(there)


def hopf_points(
    model: Model, branches: tuple[EquilibriumBranch, ...], highest: float, failed: list[Failed]
) -> list[HopfPoint]:
    """Hopf points of equilibria up to a speed, one for each pair of mirror images.

    If the straight pipe is an equilibrium, all its onsets count, on branches followed or not.
    """
    motion = VectorField(model)
    points: list[Crossing | BranchPoint] = []
    if model.unbalanced(highest) <= BALANCED:
        try:
            points += [c for c in crossings(model, highest) if c.kind == "flutter"]
        except PipedynError as error:
            failed.append((highest, error))
    points += [p for b in branches if b.q.any() for p in b.points if p.kind == "hopf"]
    found: list[HopfPoint] = []
    for new in points:
        same = (np.isclose((p.speed, p.frequency), (new.speed, new.frequency), 1e-6) for p in found)
        if new.speed > 0.0 and not any(map(np.all, same)):
            try:
                found.append(hopf_point(motion, new))
            except (PipedynError, ValueError) as error:
                failed.append((new.speed, error))
    return found


def traced(
    model: Model, begin: HopfPoint | PeriodicOrbit, options: BranchOptions
) -> tuple[list[Traced], list[Failed]]:
    """The branch of cycles from an onset, or both ways through a cycle, and its offshoots.

    The offshoots leave it at pitchforks and period doublings. The second list holds speeds that
    failed, with the errors. Models have up to 100 degrees of freedom.
    """
    motion = VectorField(model)
    found: list[Traced] = []
    failed: list[Failed] = []

    def trace(
        starts: list[BranchStart], begin: CycleEvent | None, generations: int, fastest: float = 0.0
    ) -> None:
        """Follows one way from an event or both ways from a cycle, then the offshoots."""
        ways: list[_Follower] = []
        siblings = (one.branch for one in found if one.branch is not None)
        its = replace(options, known=(*options.known, *siblings))
        for start in starts:
            ways.append(_Follower(motion, start, begin, its, failed, fastest))
            ways[-1].run()
            if ways[-1].closed:
                ways = ways[-1:]
                break
        found.append(_as_one_branch(ways))
        if not found[-1].spans(options.finest):
            return
        fastest = max([fastest, *(cycle.frequency for way in ways for cycle in way.cycles)])
        for event, orbit, stable in [fork for way in ways for fork in way.forks]:
            ends = (end for other in found for end in (other.begin, other.end))
            if any(end is not None and event.same(end) for end in ends):
                continue
            if generations == GENERATIONS or (stable and generations > 0):
                root = 1.0 if event.kind == "branch point" else -1.0
                start = from_branch_point(motion, orbit, root)
                trace([start], event, generations - 1, fastest)

    with one_thread(motion.size):
        if isinstance(begin, PeriodicOrbit):
            trace(both_ways(motion, begin), None, GENERATIONS)
        else:
            onset = CycleEvent("hopf", begin.speed, 1e-6, 1.0 + 0j, 0.0)
            trace([from_hopf(motion, begin)], onset, GENERATIONS)
        return found, failed


def branch_in_space(model: Model, branch: CycleBranch, failed: list[Failed]) -> CycleBranch | None:
    """The branch of a planar model as one of the model in three dimensions.

    Where motions across the plane begin or cease to grow there is an event. Cycles whose
    multipliers in space are not known are left out, and kept in `failed`.
    """
    motion = VectorField(model)
    found, events = list[LimitCycle](), dict[int, CycleEvent]()
    last: LimitCycle | None = None  # the planar cycle of the last one that was found
    for plane in branch.cycles:
        try:
            cycle = in_space(motion, plane)
        except NotConverged as error:
            failed.append((plane.u, error))
            continue
        pair = [*found[-1:], cycle]
        leaving = {_leaves_plane(one) > 0.0 for one in pair if one.moves}
        if last is not None and len(leaving) == 2:
            events[len(found)], between = _out_of_plane(motion, last, pair)
            found.append(between)
        found.append(cycle)
        last = plane
    if not found:
        return None
    speeds = np.array([one.u for one in found])
    places = {int(np.abs(speeds - one.speed).argmin()): one for one in branch.events}
    every = sorted([*places.items(), *events.items()], key=lambda place: place[0])
    return replace(branch, **_columns_of(found), events=tuple(event for _, event in every))


def _columns_of(cycles: Sequence[LimitCycle]) -> dict[str, Any]:
    """The fields of a branch that are those of its cycles."""
    # A cycle at a Hopf point is at rest: its direction is that of the nearest one that moves.
    moving = [k for k, cycle in enumerate(cycles) if cycle.moves] or [0]
    seen = (cycles[min(moving, key=lambda j: abs(j - k))] for k in range(len(cycles)))
    directions = [farthest_direction(cycle.tip) for cycle in seen]
    tips = [cycle.tip[0] for cycle in cycles]
    return {
        "speeds": np.array([cycle.u for cycle in cycles]),
        "amplitudes": np.array([cycle.amplitude for cycle in cycles]),
        "highest": np.array([np.dot(*pair) for pair in zip(tips, directions, strict=True)]),
        "frequencies": np.array([cycle.frequency for cycle in cycles]),
        "stable": np.array([cycle.stable for cycle in cycles]),
        "multipliers": np.array([cycle.multipliers for cycle in cycles]),
        "cycles": tuple(cycles),
    }


def _leaves_plane(cycle: LimitCycle) -> float:
    """Logarithm of the largest multiplier across the plane but for the turn, as `beyond_circle`."""
    assert cycle.across is not None
    return float(beyond_circle(nontrivial(cycle.across), cycle.multiplier_error).max())


def _out_of_plane(
    motion: VectorField, plane: LimitCycle, pair: list[LimitCycle]
) -> tuple[CycleEvent, LimitCycle]:
    """The event where motions across the plane of cycles begin or cease to grow, and its cycle.

    Args:
        motion: the vector field in three dimensions.
        plane: a planar cycle nearby.
        pair: two neighbouring cycles of the branch, in three dimensions.
    """
    known = {one.u: one for one in pair}
    low, high = min(known), max(known)

    def growth(u: float) -> float:
        if u not in known:
            found = limit_cycle(motion.model.planar, u, plane, samples=SAMPLES_A_CYCLE)
            known[u] = in_space(motion, found)
        return _leaves_plane(known[u])

    speed, error = 0.5 * (low + high), 0.5 * (high - low)
    near = PLACE_OUT_OF_PLANE * high
    with suppress(PipedynError):  # else it is known to lie between the two
        if error > near:
            speed, error = zero_between(growth, low, high, near), near
    at = max((one for one in known.values() if _leaves_plane(one) <= 0.0), key=_leaves_plane)
    assert at.across is not None
    passing = complex(nontrivial(at.across)[0])
    kind: EventKind = "torus"
    if abs(passing.imag) < 1e-3:
        kind = "branch point" if passing.real > 0.0 else "period doubling"
    return CycleEvent(kind, speed, error, passing / abs(passing), at.amplitude), at


def _as_one_branch(ways: list[_Follower]) -> Traced:
    """The branch that was followed one way, or both ways from the same cycle."""
    way = ways[-1]
    cycles, events, begin = way.cycles, way.events, way.begin
    if len(ways) == 2:
        cycles = ways[0].cycles[:0:-1] + cycles
        events = ways[0].events[::-1] + events
        begin = ways[0].end
    cycles = [cycle for cycle in cycles if way.options.holds(cycle.u)]
    if all(cycle is way.first for cycle in cycles):
        return Traced(None, begin, way.end)
    branch = CycleBranch(
        **_columns_of(cycles),
        events=tuple(event for event in events if way.options.holds(event.speed)),
        mirrored=not cycles[0].symmetric and way.motion.is_odd(cycles[0].u),
        origin=cast(Origin, way.begin.kind) if way.begin is not None else "motion",
        onset=way.onset,
    )
    return Traced(branch, begin, way.end)


CycleOnStep = tuple[float, LimitCycle, CycleEvent | None]
"""A cycle on a step: arc length from the beginning of the step, cycle, and event there, if any."""


class _Follower(Tracer[OrbitProblem]):
    """A branch being followed, one way from a start, and from an event if it begins at one."""

    def __init__(
        self,
        motion: VectorField,
        start: BranchStart,
        begin: CycleEvent | None,
        options: BranchOptions,
        failed: list[Failed],
        fastest: float = 0.0,
    ) -> None:
        super().__init__(most=options.most)
        self.motion, self.start, self.begin, self.options = motion, start, begin, options
        self.failed, self.fastest = failed, fastest
        self.onset, self.events = math.nan, list[CycleEvent]()
        self.how = f"followed from a motion at u = {start.orbit.u:.6g}"
        if begin is not None:
            self.onset, self.events = begin.speed, [begin]
            where = "onset" if begin.kind == "hopf" else begin.kind
            self.how = f"followed from the {where} at u = {begin.speed:.6g}"
        self.cycles: list[LimitCycle] = []
        self.forks: list[tuple[CycleEvent, PeriodicOrbit, bool]] = []
        self.end: CycleEvent | None = None
        self.closed = False
        self.repeats = False  # whether it goes on as a branch that is known
        self.here = start.orbit  # last orbit up to which it was followed
        self.last: LimitCycle | None = None  # the cycle there, if it is known and kept
        self.first: LimitCycle | None = None  # the cycle at the event at which it begins
        self.passed, self.frequencies = list[float](), list[float]()
        self.beyond = self.unsure = 0  # steps in a row outside the speeds, and with unsure cycles

    def run(self) -> None:
        """Follows the branch until it ends, is far from the speeds or has used all its steps."""
        with Progress(f"cycles {self.how}", self.options.shown) as progress:
            _, end, reason = self.one_way(progress.steps(self._steps(), self._share_done))
        if end == "points":
            reason = "its steps ran out; cycles= allows more"
        elif end != "not converged":
            return
        frequencies = self.frequencies
        falling = len(frequencies) > 3 and frequencies[-1] < frequencies[-3]
        slow = falling and frequencies[-1] < 0.5 * max(frequencies)
        if slow or _steepness(self.passed, frequencies) < STEEP:
            self._ends("infinite period", self.here)
            return
        self._ends("end", self.here)
        self._fails(self.here, reason)

    def note(self, step: Step) -> str | None:
        """Keeps the cycles and events of a step, and returns why the branch ends there, or None.

        Outside the given speeds multipliers are not computed.
        """
        speeds = self.options.speeds
        met = self._met(step)
        if met is not None:
            step = met[1].whole
        here = self.here = orbit_at(step, step.length)
        self.frequencies.append(here.frequency)
        self.passed.append(here.u)
        low, high = sorted((step.begin.p, here.u))
        if self.unsure:
            self.unsure += 1
        elif low <= speeds[-1] and high >= speeds[0]:
            self.last, self.beyond = self._noted(step), 0
            self.unsure = int(self.last.multiplier_error > LARGEST_ERROR)
        else:
            self.last, self.beyond = None, self.beyond + 1
        if met is not None:
            kind, meets = met
            if self.last is not None:
                self._take(self._at_speeds(meets.last, meets.last))
                if kind == "hopf":
                    with suppress(NewtonFailed):  # where no equilibrium is found
                        self._take([(0.0, self._bifurcating(self._still(meets)), None)])
            self._ends(kind, replace(here, u=meets.last.end.p), meets.error)
            return kind
        return self._is_left()

    @property
    def _range(self) -> tuple[float, float]:
        """Range of flow speeds in which the branch is followed."""
        speeds, first = self.options.speeds, self.start.orbit.u
        lowest = min(float(speeds[speeds > 0.0][0]), first) / BEYOND
        return lowest, max(float(speeds[-1]), first) * BEYOND

    def _share_done(self, step: Step) -> float:
        """Share of the way to the end of that range that the branch has covered after a step."""
        return share_of_way(self.start.orbit.u, step.end.p, *self._range)

    def _is_left(self) -> str | None:
        """Why the branch is followed no further than to its last orbit; None if it goes on."""
        here, last, passed = self.here, self.last, self.passed
        unknown = "" if last is None else f"known to {last.multiplier_error:.1e} only"
        slow = self.frequencies[-1] < 0.5 * max(self.fastest, *self.frequencies)
        if slow and _steepness(passed, self.frequencies) < VERTICAL:
            self._ends("infinite period", here, abs(passed[-1] - passed[-2]))
            if not self.cycles and unknown:
                self._fails(here, f"its multipliers are {unknown}")
            return "infinite period"
        if self.unsure == UNSURE and unknown:
            raise NewtonFailed(f"its multipliers are {unknown}")
        lowest, highest = self._range
        if self.closed or self.repeats or not lowest < here.u < highest:
            return "range"
        if len(passed) > WINDING and self._winds(passed[-WINDING:]):
            width = max(passed[-WINDING:]) - min(passed[-WINDING:])
            self._ends("end", here)
            self._fails(
                here,
                f"for {WINDING} steps it has wound within {width:.1e} of the speed: speeds closer "
                "together show more",
            )
            return "end"
        if self.beyond == MOST_BEYOND:
            raise NewtonFailed(f"after {self.beyond} steps it has not come back")
        if last is None and here.edges.size > INTERVALS_BEYOND:
            raise NewtonFailed(f"beyond the speeds it takes {here.edges.size} intervals")
        return None

    def _winds(self, passed: list[float]) -> bool:
        """Whether the branch stays near one speed, between those given."""
        low, high = min(passed), max(passed)
        given = self.options.speeds
        between = not ((given >= low) & (given <= high)).any()
        return between and high - low < NARROW * self.options.finest

    def _steps(self) -> Iterator[Step]:
        """Steps along the branch, past places where its cycles begin or cease to touch a stop.

        From an event, the steps begin at the first orbit; cycles on the way to it are kept.
        """
        steps = steps_past_grazing(self.motion, self.start, FINE, self._grazes)
        if self.begin is None:
            self.last = self._finished(self.here)
            if self.last is not None:
                self._take([(0.0, self.last, None)])
        else:
            self.first = self._bifurcating(self.start.orbit)
            self._take([(0.0, self.first, None)])
            first = next(steps)
            self._take(self._at_speeds(first, self._leaving(first)))
        yield from steps

    def _still(self, meets: Meeting) -> PeriodicOrbit:
        """The equilibrium at which the branch ends, as an orbit without amplitude."""
        orbit = orbit_at(meets.last, meets.last.length)
        mean, rest = orbit.states(PROBES)[: orbit.half].mean(axis=1), np.zeros(2 * orbit.half)
        statics, x = statics_of(self.motion.model, 0.0 * mean if orbit.symmetric else mean)
        if not orbit.symmetric:
            x = statics.solved(x, orbit.u)
            rest[: orbit.half] = statics.whole(x)
        values = statics.eigenvalues(x, orbit.u)
        at = np.argmin(np.abs(values - 1j * orbit.frequency))
        return PeriodicOrbit(
            orbit.edges,
            rest + np.zeros_like(orbit.starts),
            np.zeros_like(orbit.rates),
            float(values[at].imag),
            orbit.u,
        )

    def _bifurcating(self, orbit: PeriodicOrbit) -> LimitCycle:
        """The cycle at a bifurcation, at rest at a Hopf point.

        The multiplier that passes the unit circle there does not count as unstable.
        """
        given = self.motion, orbit, FINE.defect, SAMPLES_A_CYCLE, self.how, ON_BRANCH
        with np.errstate(divide="ignore", invalid="ignore"):  # of the residual at rest
            cycle = cycle_on_mesh(*given)
        beyond = beyond_circle(cycle.others, cycle.multiplier_error)
        others = np.delete(beyond, np.argmin(np.abs(beyond)))
        residual = cycle.residual if cycle.moves else 0.0
        return replace(cycle, stable=not (others > 0.0).any(), residual=residual)

    def _grazes(self, grazing: Grazing) -> None:
        """Keeps the event at which cycles begin or cease to touch a stop.

        The next step does not begin where the last one ended.
        """
        self._note("grazing", grazing.middle, grazing.error)
        self.last = None
        speeds = self.options.speeds
        for u in speeds[np.abs(speeds - grazing.middle.u) < grazing.error].tolist():
            self.failed.append((u, NoCycle(f"no cycle at u = {u:g}: it {GRAZES} there", u)))

    def _fails(self, here: PeriodicOrbit, reason: str) -> None:
        """Keeps a failure beyond an orbit."""
        where = f"u = {here.u:g}"
        if not self.options.holds(here.u):
            where += ", outside the speeds given, from where they might come back"
        report = f"the cycles {self.how} were not followed beyond {where}: {reason}"
        self.failed.append((here.u, NotConverged(report)))

    def _ends(self, kind: EventKind, orbit: PeriodicOrbit, error: float = 0.0) -> None:
        """Keeps the event at the orbit where the branch ends or ("end") is not followed further."""
        self._note(kind, orbit, error)
        self.end = self.events[-1] if kind != "end" else None

    def _note(self, kind: EventKind, orbit: PeriodicOrbit, error: float) -> None:
        """Keeps an event at an orbit at which no multiplier passes the unit circle."""
        size = 0.0 if kind == "hopf" else amplitude_of(self.motion, orbit)[0]
        self.events.append(CycleEvent(kind, orbit.u, error, 1.0 + 0j, size))

    def _finished(self, orbit: PeriodicOrbit) -> LimitCycle | None:
        """The cycle of the orbit at one of the speeds given; None if there is none.

        A cycle that does not meet the tolerance counts as a failure, and is kept as well as it is
        known.
        """
        try:
            given = self.motion, orbit, self.options.rtol, SAMPLES_A_CYCLE, self.how
            return converged_cycle(*given, solved_to=FINE.tolerance)
        except NotConverged as error:
            self.failed.append((orbit.u, error))
            reached: LimitCycle | None = error.result
            return reached

    def _met(self, step: Step) -> tuple[EventKind, Meeting] | None:
        """The meeting with an equilibrium, or with cycles of more symmetry, within a step."""
        begin = orbit_at(step, 0.0)
        kinds: list[EventKind] = ["hopf"] if begin.symmetric else ["hopf", "period doubling"]
        if not begin.symmetric and self.motion.is_odd(begin.u):
            kinds.append("pitchfork")
        onsets = np.array([onset for onset in self.options.onsets if onset != self.onset])
        tries: list[tuple[EventKind, str]] = [(kind, kind) for kind in kinds]
        if self.begin is not None and self.begin.kind == "branch point":
            parts = (part for part in ("z", "x", "image") if _breaks(begin, part))
            tries += [("branch point", part) for part in parts]
        for kind, part in tries:
            known = onsets if kind == "hopf" else np.empty(0)
            if (met := meeting(step, part, known, 0.01)) is not None:
                return kind, met
        return None

    def _noted(self, step: Step) -> LimitCycle:
        """Keeps the cycles and events on a step; returns the cycle at its end."""
        length = step.length
        first = self._cycle(orbit_at(step, 0.0)) if self.last is None else self.last
        last = self._cycle(orbit_at(step, length))
        found: list[CycleOnStep] = [(0.0, first, None)] if self.last is None else []
        found.append((length, last, None))
        if max(first.multiplier_error, last.multiplier_error) <= LARGEST_ERROR:
            ends = {0.0: beyond_circle(first.others), length: beyond_circle(last.others)}

            cycle_at = cache(lambda s: self._cycle(orbit_at(step, s)))

            def values(point: Point) -> Array:
                return self._growth(step.problem.orbit(point.z))

            def roots(s: float) -> Complex:
                cycle = cycle_at(s)
                if not cycle.symmetric:
                    return cycle.others
                return nontrivial(orbit_multipliers(self.motion, cycle.orbit)[1])

            test = CircleTest(step, 3e-5 * length, values, "", ends, NEAR_FOLD, roots=roots)
            # The error of a fold's speed is the square of that of its location in arc length.
            turns = list[float]()
            for name, before, s in special_points(step, 1e-5, [test]):
                cycle = cycle_at(s)
                if name == "fold":
                    turns.append(s)
                    error = max(abs(step.at(s + 1e-3 * length).p - cycle.u), 1e-9)
                    event = CycleEvent("fold", cycle.u, error, 1.0 + 0j, cycle.amplitude)
                else:
                    low, high = step.at(before).p, cycle.u
                    speed, error = 0.5 * (low + high), 0.5 * abs(low - high)
                    kind, passing = cast(EventKind, name), test.multipliers[s]
                    event = CycleEvent(kind, speed, error, passing, cycle.amplitude)
                    leaves = event.kind != "torus"
                    if event.kind == "branch point":  # where the cycle has a symmetry to lose
                        leaves = len(uncoupled(self.motion, cycle.orbit)) == 2
                        leaves |= not _breaks(cycle.orbit, "image")
                    if leaves and self.options.holds(event.speed):
                        stable = cycle.stable or not test.positive(before)
                        self.forks.append((event, cycle.orbit, stable))
                found.append((s, cycle, event))
            for part in step.parts(turns):
                found += self._at_speeds(step, part)
        known = self.options.known
        if repeated := [s for s, one, _ in found if is_on_any(known, one)]:
            self.repeats = True
            found = [one for one in found if one[0] < min(repeated)]
        self._take(found)
        return last

    def _cycle(self, orbit: PeriodicOrbit) -> LimitCycle:
        """The cycle of an orbit on the branch."""
        return on_branch(self.motion, orbit, FINE.defect, SAMPLES_A_CYCLE, self.how)

    def _growth(self, orbit: PeriodicOrbit) -> Array:
        """Logarithms of the moduli of all nontrivial multipliers, as `beyond_circle` gives them."""
        # `_cycle` may refine the mesh: with its multipliers, a pitchfork at which a branch begins
        # was not found near an infinite period.
        if not self.motion.model.pipe.has_kinks:
            found, _, error = orbit_multipliers(self.motion, orbit, ON_BRANCH)
            if error <= ON_BRANCH:
                return beyond_circle(nontrivial(found))
        return beyond_circle(self._cycle(orbit).others)

    def _take(self, found: Iterable[CycleOnStep]) -> None:
        """Keeps events on a step, and cycles known well enough, in order along the branch."""
        for _, cycle, event in sorted(found, key=lambda place: place[0]):
            if cycle.multiplier_error <= LARGEST_ERROR:
                self.cycles.append(cycle)
            if event is not None:
                self.events.append(event)

    def _at_speeds(self, step: Step, part: Step) -> Iterator[CycleOnStep]:
        """The cycles at the given speeds on a part of a step, without its beginning."""
        low, high = sorted((part.begin.p, part.end.p))
        speeds = self.options.speeds
        for u in speeds[(speeds >= low) & (speeds <= high) & (speeds != part.begin.p)].tolist():
            try:
                z = part.where(u)
            except NewtonFailed as reason:
                self.failed.append((u, NoCycle(f"no cycle at u = {u:g}: {reason}", u)))
                continue
            cycle = self._finished(step.problem.orbit(z))
            if cycle is not None:
                yield step.reach(z), cycle, None
                self.closed = self.closed or self._is_first(cycle)

    def _leaving(self, first: Step) -> Step:
        """The first step, made so that the speed changes with the square of the amplitude."""
        if self.motion.model.pipe.has_kinks:  # with drag the speed changes linearly
            return first
        return replace(first, begin=first.problem.starting(first.begin.z, self.start.towards))

    def _is_first(self, cycle: LimitCycle) -> bool:
        """Whether a cycle is the first one of the branch, which is then closed."""
        first = self.start.orbit
        if self.begin is not None or cycle.u != first.u or len(self.cycles) < 4:
            return False
        return same_cycle(cycle, first.frequency, amplitude_of(self.motion, first)[0])


def _breaks(orbit: PeriodicOrbit, kind: str) -> bool:
    """Whether an orbit has the part of `breaking_part` beyond the error of orbits on branches."""
    return float(np.abs(breaking_part(orbit, kind)).max()) > 1e-6 * orbit.size


def _steepness(speeds: list[float], frequencies: list[float]) -> float:
    """Relative change of the speed while the frequency falls by a factor e, over three steps.

    It is infinite if the frequency does not fall in each step, or there are fewer steps.
    """
    if len(speeds) < 4:
        return math.inf
    falls = -np.diff(np.log(frequencies[-4:]))
    if not (falls > 0.0).all():
        return math.inf
    return float(np.abs(np.diff(speeds[-4:])).sum() / (speeds[-1] * falls.sum()))


def is_on_any(branches: Sequence[CycleBranch], cycle: LimitCycle) -> bool:
    """Whether one of the branches contains the cycle at its speed."""
    return any(
        one.symmetric == cycle.symmetric and same_cycle(one, cycle.frequency, cycle.amplitude)
        for branch in branches
        for one in branch.at(cycle.u)
    )


def same_cycle(cycle: LimitCycle, frequency: float, amplitude: float) -> bool:
    """Whether a cycle has a given frequency and amplitude, up to `SAME_CYCLE`."""
    apart = max(abs(cycle.frequency / frequency - 1.0), abs(cycle.amplitude / amplitude - 1.0))
    return apart < SAME_CYCLE
