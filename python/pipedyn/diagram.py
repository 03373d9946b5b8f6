# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

import math
import sys
from concurrent import futures
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.from_motion import LARGEST_CYCLE
from pipedyn.attraction.motion_ends import Case, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.attraction.solutions import (
    Solution,
    circular_solution,
    cycle,
    equilibria_near,
    with_separate_regions,
)
from pipedyn.cycles.branches import (
    BEYOND,
    BranchOptions,
    CycleBranch,
    Failed,
    Traced,
    branch_in_space,
    hopf_points,
    same_cycle,
    traced,
)
from pipedyn.cycles.limit_cycle import (
    LimitCycle,
    NoCycle,
    amplitude_of,
    as_symmetric,
    cycle_from,
)
from pipedyn.equilibrium.equilibria import (
    EQUILIBRIA_DOF,
    EquilibriumBranch,
    equilibrium_branch,
    offshoots,
    searched,
)
from pipedyn.equilibrium.hopf import HopfPoint
from pipedyn.equilibrium.rotating_motion import RotatingBranch, rotating_branch
from pipedyn.equilibrium.statics import from_start, leaves_planes
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model
from pipedyn.models.drive import LARGEST_SPEED, InputUnits, require_steady
from pipedyn.motion.simulate import checked_model_in_motion, initial_bends, slight_bend
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import clock
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread, parallel, progress_visible, track
from pipedyn.util.result import TableResult, Units, join_tables

MOST_MOTIONS = 100_000
"""Largest number of motions of one call: an hour at 30 ms each."""

STEPS_AHEAD = 8
"""Number of steps along a branch of cycles after which the steps grow no more: near an onset they
are short."""

SPARSE = 4
"""Number of speeds for each one at which motions are integrated first: cycles to which these
motions lead are followed to the other speeds, where motions then end sooner and also begin beside
the nearest of them. This number was chosen; others were not measured."""

FORKS = "pitchfork", "branch point"
"""Kinds of points at which branches of equilibria may leave another one, and end."""

SAME_BRANCH_POINT = 1e-3
"""Largest sum of the differences in speed and in coordinates up to which two points at which
branches of equilibria meet are the same: next to a stop such a point is known to 1e-5."""

NEAR_BRANCH = 0.1
"""Largest relative difference of speeds at which motions begin beside the nearest cycle of a branch
that has none at a speed: an attractor that is born where a branch ends or is lost attracts few of
the other starts."""


@saved_as("BifurcationDiagram", added=("rotating",))
class BifurcationDiagram(TableResult):
    """Equilibria, cycles and ends of motions of a pipe over the flow speed.

    Attributes:
        speeds: flow speeds u as given, shape (S,).
        equilibria: branches of equilibria over the range of the speeds, the straight pipe's first,
            mirror images included.
        cycles: branches of cycles within these speeds, those from onsets of flutter first, each
            followed by the branches that leave it; only one of two mirror images.
        motions: ends of motions from a batch of starts; empty if they were not asked for. Only a
            motion that began beside a cycle at a neighbouring speed reached an attractor with the
            start -1.
        failures: points that failed, with the errors, by speed; `value` is the flow speed and
            `index` its place among `speeds`, -1 if a branch failed between them.
        model: the model.
        rotating: branches of circular motions from onsets of flutter, for a model in three
            dimensions that is the same in all directions.

    Example:
        >>> found = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0, 5.0])
        >>> [(event.kind, round(event.speed, 3)) for event in found.cycles[0].events]
        [('hopf', 3.593)]
        >>> [round(cycle.amplitude, 3) for cycle in found.cycles[0].at(4.0)]
        [0.546]
    """

    speeds: Array
    equilibria: tuple[EquilibriumBranch, ...]
    cycles: tuple[CycleBranch, ...]
    motions: tuple[Attractor, ...]
    failures: tuple[Failure, ...]
    model: Model
    rotating: tuple[RotatingBranch, ...] = ()

    def at(self, u: float) -> tuple[Attractor, ...]:
        """Ends of motions at the speed nearest to u >= 0; raises ValueError or TypeError."""
        u = check.real("u", u, low=0.0)
        if not self.motions:
            return ()
        nearest = min(self.motions, key=lambda one: abs(one.speed - u)).speed
        return tuple(one for one in self.motions if one.speed == nearest)

    def _columns(self) -> dict[str, Any]:
        names = "speed", "amplitude", "highest", "frequency", "stable"
        still = (np.zeros_like(one.speeds) for one in self.equilibria)
        tables = [
            (one.speeds, zero, one.tips[:, 0], zero, one.stable)
            for one, zero in zip(self.equilibria, still, strict=True)
        ] + [
            (one.speeds, one.amplitudes, one.highest, one.frequencies, one.stable)
            for one in self.cycles
        ]
        tables += [
            (one.speeds, one.radii, one.radii, one.frequencies, one.stable) for one in self.rotating
        ]
        kinds = ["equilibrium"] * len(self.equilibria) + ["cycle"] * len(self.cycles)
        kinds += ["rotating"] * len(self.rotating)
        branches = [dict(zip(names, table, strict=True)) for table in tables]
        return join_tables(branches, branch=range(len(kinds)), kind=kinds)


def bifurcation_diagram(
    model: Model,
    speeds: ArrayLike,
    *,
    cycles: int = 100,
    brute_force: int = 0,
    transient: float = 100.0,
    duration: float = 40.0,
    exponents: bool = True,
    rtol: float = 1e-6,
    seed: int = 0,
    executor: futures.Executor | None = None,
    units: Units = "nondimensional",
    progress: bool = False,
) -> BifurcationDiagram:
    """Equilibria and cycles over a range of flow speeds and, on request, ends of motions.

    Equilibria and the cycles from each onset of flutter of straight and bent pipes, up to 1.5 times
    the highest speed given, are followed by arc length, past folds. Cycles are followed up to a
    quarter beyond both the speeds and the onset, because they may come back. Cycles that leave
    these at pitchforks and period doublings within the speeds are followed as well, for two
    generations, if the branch that they leave spans a twentieth of the range of speeds, or the
    least gap between speeds if that is smaller; no cycles leave at a torus. Motions are integrated
    at the speeds given. If a motion ends on a cycle to which no onset leads, that cycle is followed
    both ways. Without `brute_force`, motions look for a cycle at the first, the middle and the last
    speed, if no cycle and no stable equilibrium is known there. Equilibria are searched without the
    count by which `equilibria` completes them, so that some that are coiled up may be missing.

    In three dimensions, if the pipe is the same in all directions, cycles are planar ones, with the
    stability of motions across their plane, and circular motions are followed from the onsets of
    the straight pipe (`rotating`). Motions that are neither are not followed over the speed; those
    on which motions end are among `motions`. Otherwise, as where a load bends the pipe, equilibria
    that leave the plane z = 0 are followed from the points at which a real eigenvalue of others
    passes 0, and from those found at the first, the middle and the last speed; cycles that leave it
    are followed as others are.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        cycles: largest number of steps along each branch of cycles; 0 for no cycles. Models of more
            than 100 degrees of freedom have to be given 0.
        brute_force: number of initial states for each speed; 0 for none.
        transient: time in T that is left out before motions are recorded. A motion that has reached
            a known equilibrium or cycle ends earlier, see `attractors`. After 0.4 of this time,
            irregular motions at one speed whose turning points are spread alike continue as one
            motion, as long as it stays irregular.
        duration: time in T over which motions are then recorded; a motion that still comes nearer
            to a solution is followed for up to eight times the sum of both times.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed, which
            tells chaos from quasi-periodic motion; without it they are "irregular".
        rtol: relative tolerance of cycles at the speeds given, and of the steps of motions,
            relative to the motion's size.
        seed: seed of the initial states; the first state is always a slight bend.
        executor: a `concurrent.futures.Executor`; its tasks are branches of cycles and batches of
            motions. Tasks fail if it does not return them, because a worker died or it is broken or
            shut down.
        units: "si" if the speeds are given in m/s, transient and duration in s, and the pipe has
            scales; times not given keep their values in T.
        progress: show progress on stderr, after a forecast of the time, from the first steps along
            the branches of cycles and some of the motions. For chains of two to four segments and
            six functions, at 40 speeds, it was 0.7 to 1.2 times the time taken with four starts,
            and without starts 0.3 to 1.3 times, as it misses branches that leave others.

    Returns:
        BifurcationDiagram; failures are recorded in `failures` and the rest is kept.

    Example:
        >>> model = pp.Chain(pp.Pipe(0.2), 2)
        >>> found = pp.bifurcation_diagram(model, [3.0, 4.0, 5.0])
        >>> [(branch.origin, round(branch.onset, 4)) for branch in found.cycles]
        [('hopf', 3.5927)]

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    model = checked_model_in_motion(model, largest=EQUILIBRIA_DOF, purpose="bifurcation_diagram")
    require_steady("speeds", speeds)
    given_in = InputUnits(units, model.pipe)
    transient, duration = given_in.times(
        bifurcation_diagram, transient=transient, duration=duration
    )
    speeds = given_in.speed("speeds", speeds)
    with given_in.explained():
        at = check.array("speeds", speeds, low=0.0, high=LARGEST_SPEED, longest=100_000)
    if at.size < 2 or np.any(np.diff(at) <= 0.0):
        raise ValueError("speeds must be at least 2 and strictly increasing")
    steps = check.count("cycles", cycles, low=0, high=10_000)
    if steps and model.dof > LARGEST_CYCLE:
        raise ValueError(
            f"cycles must be 0 for more than {LARGEST_CYCLE} degrees of freedom, got {steps}"
        )
    count = check.count("brute_force", brute_force, low=0, high=10_000)
    if count * at.size > MOST_MOTIONS:
        raise ValueError(
            f"brute_force must ask for at most {MOST_MOTIONS} motions, got {count * at.size}"
        )
    given = transient, duration, rtol, exponents, seed, executor, progress
    with given_in.explained():
        of_motions = MotionOptions.checked(*given)
    if count:
        of_motions.require_room(model)
    starts = initial_bends(model, count, of_motions.seed) if count else []
    failed, shown = list[Failed](), of_motions.shown
    begun = clock()
    branches = equilibrium_branches(model, at, failed, shown)
    steps_shown = shown and executor is None  # other processes write over one another
    options = BranchOptions(at, of_motions.rtol, steps, shown=steps_shown)
    if shown and progress_visible():
        seconds = clock() - begun + _seconds_left(model, branches, options, starts, of_motions)
        print(f"bifurcation diagram: about {seconds:.2g} s on one thread", file=sys.stderr)
    found = _Cycles(model, options, failed)
    if steps:
        found.from_onsets(branches, executor, shown and not steps_shown)
    rotating = found.rotating() if steps else ()
    motions: tuple[Attractor, ...] = ()
    for some in _sparse_first(at) if starts else ():
        cases = _cases(model, some, branches, found.in_space, rotating, starts)
        ended, reached = motions_at(model, cases, of_motions, failed)
        if steps:
            for one in reached:  # cycles that motions led to may lie on no branch
                if one.orbit is not None and one.attracts and one.orbit.u > 0.0:
                    found.through(one.orbit.u, one.orbit)
        motions = (*motions, *ended)
    motions = tuple(sorted(motions, key=lambda one: (one.speed, one.start)))
    if steps:
        for u in sorted(seeds(at)):
            passed = (b.speeds.min() <= u <= b.speeds.max() for b in found.branches)
            rests = (bool(b.stable[b.speeds == u].any()) for b in branches)
            if u > 0.0 and not any(rests) and not any(passed):
                found.through(u, found.model.bent(slight_bend))
    cycle_branches = tuple(found.in_space)
    failed.sort(key=lambda one: one[0])
    places = {u: place for place, u in enumerate(at.tolist())}
    failures = tuple(Failure(places.get(u, -1), u, error) for u, error in failed)
    return BifurcationDiagram(at, branches, cycle_branches, motions, failures, model, rotating)


def _seconds_left(
    model: Model,
    equilibria: tuple[EquilibriumBranch, ...],
    options: BranchOptions,
    starts: list[Array],
    of_motions: MotionOptions,
) -> float:
    """Time in s that the cycles and motions of a diagram take, from the times of some of them."""
    at, seconds, begun = options.speeds, 0.0, clock()
    first = _Cycles(model, replace(options, most=min(options.most, STEPS_AHEAD), shown=False), [])
    if options.most:
        first.from_onsets(equilibria, None, False)
        walked = [one.speeds for one in first.branches if len(one) > 1]
        left = 0.0
        for u in walked:
            rest, step = BEYOND * at[-1] - u[-1], max(abs(u[-1] - u[-2]), 1e-3 * at[-1])
            left += min(max(rest / step, 0.0), options.most - first.options.most)
        seconds += (clock() - begun) * (1.0 + left / max(sum(map(len, walked)), 1))
    if starts:
        begun = clock()
        some = at[np.linspace(0.0, at.size - 1.0, min(at.size, 6)).astype(int)]
        cases = _cases(model, some, equilibria, first.in_space, (), starts[:2])
        motions_at(model, cases, replace(of_motions, executor=None, shown=False), [])
        seconds += (clock() - begun) * at.size / some.size * len(starts) / len(starts[:2])
    return seconds


def seeds(speeds: Array) -> list[float]:
    """Speeds at which solutions on no branch are looked for: the middle, first and last one."""
    return [float(speeds[i]) for i in dict.fromkeys([speeds.size // 2, 0, speeds.size - 1])]


# --------------------------------------------------------------------------------------- equilibria


def equilibrium_branches(
    model: Model, speeds: Array, failed: list[Failed], shown: bool
) -> tuple[EquilibriumBranch, ...]:
    """Branches through the equilibria at three of the speeds, each once, and their offshoots."""
    ends, marks = (float(speeds[0]), float(speeds[-1])), seeds(speeds)
    branches, starts, done = list[EquilibriumBranch](), list[tuple[float, Array]](), 0
    for u in track(marks, len(marks), "equilibria", shown):
        try:
            starts += [(u, q) for q in searched(model, u, (), counted=False).q]
        except PipedynError as error:
            failed.append((u, error))
    # Offshoots of branches in the plane of a load lead to most equilibria out of it.
    starts.sort(key=lambda start: not model.lies_in_plane(from_start(model, "q0", start[1])))
    for u, q in starts:
        # Branches have points at both ends and at the speed at which they began.
        passing = np.concatenate([q[None] + math.inf, *(b.q[b.speeds == u] for b in branches)])
        if np.abs(passing - q).max(axis=1).min() < 1e-5 * (1.0 + np.abs(q).max()):
            continue
        try:
            branches.append(equilibrium_branch(model, q, u, ends))
        except PipedynError as error:
            failed.append((u, error))
        while leaves_planes(model) and done < len(branches):
            add_offshoots(branches, branches[done], marks, ends, failed)
            done += 1
    return tuple(branches)


def add_offshoots(
    branches: list[EquilibriumBranch],
    branch: EquilibriumBranch,
    marks: list[float],
    ends: tuple[float, float],
    failed: list[Failed],
) -> None:
    """Adds the branches of equilibria that leave one of them out of the plane of a load."""
    for point in (one for one in branch.points if one.kind in FORKS):
        met = (b.points[k] for b in branches for k in (0, -1) if b.ends[k] in FORKS)
        apart = (abs(one.speed - point.speed) + np.abs(one.q - point.q).max() for one in met)
        if min(apart, default=math.inf) < SAME_BRANCH_POINT:
            continue
        try:
            branches += offshoots(branch.model, point, ends, marks)
        except (NewtonFailed, PipedynError) as reason:
            report = f"the equilibria that leave others at u = {point.speed:g} were not followed: "
            failed.append((point.speed, NotConverged(f"{report}{reason}")))


# ------------------------------------------------------------------------------------------ motions


def _sparse_first(speeds: Array) -> list[Array]:
    """Some of the speeds, then the others, at which cycles that the first lead to are known."""
    if speeds.size <= SPARSE:
        return [speeds]
    first = np.zeros(speeds.size, dtype=bool)
    first[SPARSE // 2 :: SPARSE] = True
    return [speeds[first], speeds[~first]]


def _cases(
    model: Model,
    speeds: Array,
    equilibria: tuple[EquilibriumBranch, ...],
    cycles: list[CycleBranch],
    rotating: tuple[RotatingBranch, ...],
    starts: list[Array],
) -> list[Case]:
    """A case for each speed, with the equilibria and the cycles that branches have there.

    Beside the starts that are given, motions begin beside cycles of branches nearby; these starts
    have negative numbers.
    """
    cases, states = list[Case](), [np.asarray(model.initial_state(q, None)) for q in starts]
    moving = [some for b in cycles if (some := [one for one in b.cycles if one.moves])]
    with one_thread(model.dof):
        for u in speeds.tolist():
            passing = [_branch_coordinates(branch, u) for branch in equilibria]
            q = np.concatenate([np.empty((0, model.coordinates)), *passing])
            guesses = model.from_user(q, np.zeros_like(q))[:, : model.integrated]
            drive, found = Excitation(u), equilibria_near(model, guesses, u)
            for branch in cycles:
                for one in branch.at(u):
                    found.append(cycle(model, drive, one.orbit, one.stable))
                    found += [found[-1].mirrored(False)] if branch.mirrored else []
            for circles in rotating:
                for circle in circles.at(u):
                    found.append(
                        circular_solution(model, np.append(circle.q, [circle.frequency, u]))
                    )
                    found.append(found[-1].mirrored(False))
            nearest = (min(some, key=lambda one: abs(one.u - u)) for some in moving)
            near = (one for one in nearest if 0.0 < abs(one.u - u) <= NEAR_BRANCH * u)
            begins = dict(enumerate(states))
            begins |= {-1 - k: _start_near(model, one) for k, one in enumerate(near)}
            cases.append(Case(model, drive, with_separate_regions(found), begins))
    return cases


def motions_at(
    model: Model, cases: list[Case], options: MotionOptions, failed: list[Failed]
) -> tuple[tuple[Attractor, ...], list[Solution]]:
    """Ends of motions at each speed, and the solutions that they lead to.

    Motions whose starts have negative numbers, beside cycles of branches nearby, only count if no
    other motion ends on their attractor, as ends with the start -1.
    """
    found, reached = list[Attractor](), list[Solution]()
    for case in motion_ends(model, cases, options, "brute force"):
        u, known = case.drive.mean, {number for k, (number, _) in case.ends.items() if k >= 0}
        reached += [case.solutions[number] for number in sorted(known) if number >= 0]
        for k, (number, end) in sorted(case.ends.items()):
            if k < 0:
                one = case.solutions[number] if number >= 0 and number not in known else None
                # Those that are known to repel are no ends of motions from elsewhere.
                if one and (one.attracts or (one.orbit is None and one.period != 0.0)):
                    known.add(number)
                    found.append(replace(one.attractor, start=-1))
                continue
            if isinstance(end, Exception):
                failed.append((u, end))
                end = Attractor(u, k, "failed", 0, np.zeros(0), np.zeros(0))
            found.append(end)
    return tuple(found), reached


def _start_near(model: Model, one: LimitCycle) -> Array:
    """A start a hundredth away from a cycle, maybe unstable: a state [p, p'], (2 integrated,).

    In three dimensions it is away from the plane of a cycle as well.
    """
    p, rates = np.split(np.asarray(model.initial_state(one.q[0], one.qdot[0])), 2)
    if one.across is not None:
        rates = rates + 0.01 * model.quarter_turn(rates)
    return np.concatenate(model.onto_constraints(1.01 * p, rates))


def _branch_coordinates(branch: EquilibriumBranch, u: float) -> Array:
    """Coordinates where a branch passes a speed, by linear interpolation, (k, coordinates)."""
    before, after = branch.speeds[:-1], branch.speeds[1:]
    within = np.flatnonzero((before - u) * (after - u) <= 0.0)
    step = after[within] - before[within]
    share = np.divide(u - before[within], step, out=np.zeros_like(step), where=step != 0.0)
    q: Array = branch.q[within] + share[:, None] * (branch.q[within + 1] - branch.q[within])
    return q


# ------------------------------------------------------------------------------------------- cycles


class _Cycles:
    """The branches of cycles found so far, each once.

    Cycles of a pipe in three dimensions that is the same in all directions are those of its planar
    model, and circular motions.
    """

    def __init__(self, whole: Model, options: BranchOptions, failed: list[Failed]) -> None:
        self.model: Model = whole.planar if whole.axisymmetric else whole
        self.whole, self.options, self.failed = whole, options, failed
        self.onsets: list[HopfPoint] = []
        self.found: list[Traced] = []
        self._spatial: list[CycleBranch | None] = []  # one of each branch, in three dimensions

    @property
    def branches(self) -> list[CycleBranch]:
        return [one.branch for one in self.found if one.branch is not None]

    def add(self, found: list[Traced], failed: list[Failed]) -> None:
        """Adds the branches of one beginning, and their failures."""
        self.failed += failed
        for one in found:
            known = one.repeats(self.branches, self.options.speeds)
            if not known and not any(one.is_reverse(other) for other in self.found):
                self.found.append(one)

    def from_onsets(
        self,
        equilibria: tuple[EquilibriumBranch, ...],
        executor: futures.Executor | None,
        shown: bool,
    ) -> None:
        """Follows the branches of cycles that begin at onsets of flutter."""
        highest = 1.5 * float(self.options.speeds[-1])  # cycles from onsets beyond may come back
        with one_thread(self.model.dof):
            if self.model is not self.whole:
                shown_once = list[Failed]()  # failures of the same branches in three dimensions
                equilibria = equilibrium_branches(
                    self.model, self.options.speeds, shown_once, False
                )
            onsets = self.onsets = hopf_points(self.model, equilibria, highest, self.failed)
        self.options = replace(self.options, onsets=tuple(point.speed for point in onsets))
        jobs = [partial(self._traced, point) for point in onsets]
        answers = parallel(jobs, executor, label="cycles", progress=shown)
        for point, answer in zip(onsets, answers, strict=True):
            if isinstance(answer, Exception):
                self.failed.append((point.speed, answer))
            else:
                self.add(*answer)

    def rotating(self) -> tuple[RotatingBranch, ...]:
        """Branches of circular motions from the onsets of the straight pipe."""
        branches, at = list[RotatingBranch](), self.options.speeds
        for onset in self.onsets if self.whole.axisymmetric else ():
            if onset.rest.any():
                continue
            try:
                with one_thread(2 * self.whole.dof):
                    one = rotating_branch(self.whole, onset, (float(at[0]), float(at[-1])), at)
                if one is None:
                    continue
            except NewtonFailed as reason:
                report = f"the circular motions from u = {onset.speed:g} were not followed: "
                self.failed.append((onset.speed, NotConverged(f"{report}{reason}")))
                continue
            if one.end == "not converged":
                report = f"the circular motions were not followed beyond u = {one.speeds[-1]:g}"
                self.failed.append((float(one.speeds[-1]), NotConverged(report)))
            branches.append(one)
        return tuple(branches)

    @property
    def in_space(self) -> list[CycleBranch]:
        """The branches of the whole model, in three dimensions with the stability across a plane.

        Each is computed once.
        """
        if self.model is self.whole:
            return self.branches
        with one_thread(self.whole.dof):
            for one in self.branches[len(self._spatial) :]:
                self._spatial.append(branch_in_space(self.whole, one, self.failed))
        return [made for made in self._spatial if made is not None]

    def _traced(self, begin: HopfPoint | PeriodicOrbit) -> tuple[list[Traced], list[Failed]]:
        """Branches from an onset, or through an orbit, except parts that are already known."""
        if isinstance(begin, HopfPoint) and self._ends_at(begin):
            return [], []
        return traced(self.model, begin, replace(self.options, known=tuple(self.branches)))

    def _ends_at(self, point: HopfPoint) -> bool:
        """Whether a branch of cycles ends at an onset."""
        ends = (one.end for one in self.found)
        return any(end.kind == "hopf" and end.speed == point.speed for end in ends if end)

    def through(self, u: float, begin: PeriodicOrbit | Array) -> None:
        """Follows the branch through a cycle, or through the one on which a motion ends.

        begin: the cycle, or coordinates at rest at which the motion begins.
        """
        motion = VectorField(self.model)
        try:
            with one_thread(motion.size):
                if isinstance(begin, PeriodicOrbit):
                    orbit = as_symmetric(motion, begin.in_plane(motion.model))
                else:
                    orbit, _ = cycle_from(motion, u, begin)
                amplitude, _ = amplitude_of(motion, orbit)
            known = (cycle for branch in self.branches for cycle in branch.at(u))
            if not any(same_cycle(cycle, orbit.frequency, amplitude) for cycle in known):
                self.add(*self._traced(orbit))
        except NewtonFailed as reason:
            report = f"the cycle at u = {u:g} was not followed: {reason}"
            self.failed.append((u, NoCycle(report, u)))
        except PipedynError as error:
            self.failed.append((u, error))
