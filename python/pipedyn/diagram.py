# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

import inspect
import math
import sys
from concurrent import futures
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.from_motion import LARGEST_CYCLE
from pipedyn.attraction.motion_ends import Case, exponents_of, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.attraction.solutions import Solution, cycle, equilibria_near, kept_apart
from pipedyn.cycles.branches import (
    BEYOND,
    BranchOptions,
    CycleBranch,
    Failed,
    Traced,
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
    limit_cycle,
)
from pipedyn.equilibrium.equilibria import (
    EQUILIBRIA_DOF,
    EquilibriumBranch,
    equilibrium_branch,
    searched,
)
from pipedyn.equilibrium.hopf import HopfPoint
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model
from pipedyn.models.drive import LARGEST_SPEED, require_steady
from pipedyn.motion.simulate import checked_model_in_motion, initial_bends, slight_bend
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import clock, counted
from pipedyn.util.errors import PipedynError
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread, parallel, track, watched
from pipedyn.util.result import Result, TableResult, joined

MOST_MOTIONS = 100_000
"""Largest number of motions of one call: an hour at 30 ms each."""

STEPS_AHEAD = 8
"""Number of steps along a branch of cycles after which the steps grow no more: near an onset they
are short."""

SPARSE = 4
"""Number of speeds for each one at which motions are integrated first: cycles to which these
motions lead are followed to the other speeds, where motions then end sooner and also begin beside
the nearest of them. This number was chosen; others were not measured."""

NEAR_BRANCH = 0.1
"""Largest relative difference of speeds at which motions begin beside the nearest cycle of a branch
that has none at a speed: an attractor that is born where a branch ends or is lost attracts few of
the other starts."""


@saved_as("BifurcationDiagram")
class BifurcationDiagram(TableResult):
    """Equilibria, cycles and ends of motions of a pipe over the flow speed.

    Attributes:
        speeds: flow speeds u as given, shape (S,).
        equilibria: branches of equilibria over the range of the speeds, the straight pipe's first,
            mirror images included.
        cycles: branches of cycles within these speeds, those from onsets of flutter first, each
            followed by the branches that leave it; only one of two mirror images.
        motions: ends of motions from a batch of starts; empty if they were not asked for. An
            attractor with the start -1 was reached by none of these motions, but by one that began
            beside a cycle at a neighbouring speed.
        failures: points that failed, with the errors, by speed; `value` is the flow speed and
            `index` its place among `speeds`, -1 where a branch failed at none of these.
        model: the model.

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
        kinds = ["equilibrium"] * len(self.equilibria) + ["cycle"] * len(self.cycles)
        branches = [dict(zip(names, table, strict=True)) for table in tables]
        return joined(branches, branch=range(len(kinds)), kind=kinds)


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
    progress: bool = False,
) -> BifurcationDiagram:
    """Equilibria and cycles over a range of flow speeds and, on request, ends of motions.

    Equilibria are followed by arc length, past folds, and so are the cycles from each onset of
    flutter of straight and bent pipes, up to 1.5 times the highest speed given. Cycles are followed
    up to a quarter beyond both the speeds and the onset, since they may come back. Cycles that
    leave these at pitchforks and period doublings within the speeds are followed as well, for two
    generations, if the branch that they leave spans a twentieth of the range of speeds, or the
    least gap between speeds if that is smaller; no cycles leave at a torus. Motions are integrated
    at the speeds given. If a motion ends on a cycle to which no onset leads, that cycle is followed
    both ways. Without `brute_force`, motions look for a cycle at the first, the middle and the last
    speed, if no cycle and no stable equilibrium is known there.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        cycles: largest number of steps along each branch of cycles; 0 for no cycles. Models of more
            than 100 degrees of freedom have to be given 0.
        brute_force: number of initial states for each speed; 0 for none.
        transient: time in T that is left out before motions are recorded. A motion that has reached
            a known equilibrium or cycle ends earlier; those to which another motion has led are
            known as well, see `attractors`. Irregular motions at one speed whose turning points are
            spread alike go on as one after a quarter of this time, as long as that stays irregular.
        duration: time in T over which motions are then recorded; a motion that comes nearer to
            something is followed for up to eight times the sum of both times.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed, which
            tells chaos from quasi-periodic motion; without it they are "irregular".
        rtol: relative tolerance of cycles at the speeds given, and of the steps of motions,
            relative to the motion's size.
        seed: seed of the initial states; the first state is always a slight bend.
        executor: a `concurrent.futures.Executor`; its tasks are branches of cycles and batches of
            motions. Tasks fail if it does not return them, since a worker died or it is broken or
            shut down.
        progress: show progress on stderr, after the result of `diagram_cost`.

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
    asked = _asked(
        *(model, speeds, cycles, brute_force),
        MotionOptions.checked(transient, duration, rtol, exponents, seed, executor, progress),
    )
    model, at, failed, shown = asked.model, asked.speeds, list[Failed](), asked.options.shown
    begun = clock()
    branches = equilibrium_branches(model, at, failed, shown)
    if shown and watched():
        cost = _cost(asked, branches, clock() - begun)
        print(f"bifurcation diagram: {cost}", file=sys.stderr)
    steps_shown = shown and executor is None  # other processes write over one another
    options = BranchOptions(at, asked.options.rtol, asked.steps, shown=steps_shown)
    found = _Cycles(model, options, failed)
    if asked.steps:
        found.from_onsets(branches, executor, shown and not steps_shown)
    motions: tuple[Attractor, ...] = ()
    for some in _sparse_first(at) if asked.starts else ():
        cases = _cases(model, some, branches, found.branches, asked.starts)
        ended, reached = motions_at(model, cases, asked.options, failed)
        if asked.steps:
            for one in reached:  # cycles that motions led to may lie on no branch
                if one.orbit is not None and one.attracts and one.orbit.u > 0.0:
                    found.through(one.orbit.u, one.orbit)
        motions = (*motions, *ended)
    motions = tuple(sorted(motions, key=lambda one: (one.speed, one.start)))
    if asked.steps:
        for u in sorted(seeds(at)):
            passed = (b.speeds.min() <= u <= b.speeds.max() for b in found.branches)
            rests = (bool(b.stable[b.speeds == u].any()) for b in branches)
            if u > 0.0 and not any(rests) and not any(passed):
                found.through(u, model.bent(slight_bend))
    failed.sort(key=lambda one: one[0])
    places = {u: place for place, u in enumerate(at.tolist())}
    failures = tuple(Failure(places.get(u, -1), u, error) for u, error in failed)
    return BifurcationDiagram(at, branches, tuple(found.branches), motions, failures, model)


@saved_as("DiagramCost")
class DiagramCost(Result):
    """Cost of a bifurcation diagram, as far as short pieces of its work predict it.

    Attributes:
        cycles: least number of right-hand sides and Jacobians for the branches of cycles from
            onsets: the cost of their events, and of branches that leave them, is not predicted.
        motions: number of right-hand sides for the motions and, if asked for, their exponents, as
            if no cycle were known on which they end: with chains of two to four segments and six
            functions, at 40 speeds with four starts, it was 1.1 to 3.3 times the diagram's.
        seconds: time for both and for the branches of equilibria, on one thread; for the same
            diagrams it was 0.5 to 1 times the actual time, as not all branches are predicted.
    """

    cycles: float
    motions: float
    seconds: float

    def __str__(self) -> str:
        return (
            f"about {self.seconds:.2g} s on one thread (right-hand sides: {self.cycles:.2g} or "
            f"more for cycles, {self.motions:.2g} for motions)"
        )


def diagram_cost(model: Model, speeds: ArrayLike, **options: Any) -> DiagramCost:
    """Cost of `bifurcation_diagram` with these arguments, from short pieces of its work.

    The pieces are the branches of equilibria, the first eight steps along the first branch of
    cycles, one cycle to the tolerance, and the motions from one or two starts at three or six of
    the speeds.

    Args:
        model: as for `bifurcation_diagram`.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        options: any others of its arguments; `executor` and `progress` have no effect.

    Returns:
        DiagramCost.

    Raises:
        ValueError, TypeError: for bad arguments.

    Example:
        >>> import pipedyn as pp
        >>> model = pp.Galerkin(pp.Pipe(0.2), 4)
        >>> cost = pp.diagram_cost(model, [5.0, 6.0, 7.0], brute_force=10)
    """
    given = inspect.signature(bifurcation_diagram).bind(model, speeds, **options)
    given.apply_defaults()
    of_motions = given.kwargs
    steps, count = of_motions.pop("cycles"), of_motions.pop("brute_force")
    asked = _asked(model, speeds, steps, count, MotionOptions.checked(**of_motions))
    begun = clock()
    branches = equilibrium_branches(asked.model, asked.speeds, [], False)
    return _cost(asked, branches, clock() - begun)


@dataclass(frozen=True)
class _Asked:
    """The arguments of `bifurcation_diagram`, checked."""

    model: Model
    speeds: Array
    steps: int  # largest number along each branch of cycles
    starts: list[Array]  # initial states of motions
    options: MotionOptions


def _asked(
    model: Model, speeds: ArrayLike, cycles: int, brute_force: int, options: MotionOptions
) -> _Asked:
    model = checked_model_in_motion(model, largest=EQUILIBRIA_DOF, purpose="bifurcation_diagram")
    require_steady("speeds", speeds)
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
    if count:
        options.require_room(model)
    starts = initial_bends(model, count, options.seed) if count else []
    return _Asked(model, at, steps, starts, options)


def _cost(asked: _Asked, branches: tuple[EquilibriumBranch, ...], seconds: float) -> DiagramCost:
    """The cost of a diagram; seconds: time that its branches of equilibria have taken."""
    begun = clock()
    cycles, done = _cycles_cost(asked, branches) if asked.steps else (0.0, 0)
    seconds += (clock() - begun) * cycles / max(done, 1)
    motions, begun = 0.0, clock()
    if asked.starts:
        speeds = asked.speeds.size
        some = np.linspace(0.0, speeds - 1.0, min(speeds, 6 if speeds > 30 else 3)).astype(int)
        starts = asked.starts[: 2 if len(asked.starts) > 7 else 1]
        alone = replace(asked.options, executor=None, shown=False, exponents=False)
        cases = _cases(asked.model, asked.speeds[some], branches, [], starts)
        with counted() as work:
            ended, _ = motions_at(asked.model, cases, alone, [])
        share = speeds * len(asked.starts) / (some.size * len(starts))
        motions = share * work.right_hand_sides
        seconds += share * (clock() - begun)
        if asked.options.exponents:  # one exponent at each speed
            begun = clock()
            first = [one for one in ended if one.start == 0 and one.ending == "irregular"]
            states = [(Excitation(one.speed), one.end) for one in first]
            with counted() as work:
                exponents_of(asked.model, states, asked.options)
            motions += speeds / some.size * work.right_hand_sides
            seconds += speeds / some.size * (clock() - begun)
    return DiagramCost(cycles, motions, seconds)


def _cycles_cost(asked: _Asked, branches: tuple[EquilibriumBranch, ...]) -> tuple[float, int]:
    """Numbers of right-hand sides and Jacobians: those predicted for cycles, and those spent."""
    end = float(asked.speeds[-1])
    onsets = sorted(hopf_points(asked.model, branches, 1.5 * end, []), key=lambda one: one.speed)
    if not onsets:
        return 0.0, 0
    first = onsets[0]
    # The range includes the onset even if the speeds begin later: only within it are multipliers
    # computed.
    within = np.array([min(first.speed, float(asked.speeds[0])), max(first.speed, end)])
    most = min(asked.steps, STEPS_AHEAD)
    with counted() as work:
        found, _ = traced(asked.model, first, BranchOptions(within, asked.options.rtol, most))
    branch, done = found[0].branch, work.right_hand_sides
    if branch is None or len(branch) < 2 or not first.speed < end:
        return float(len(onsets) * done), done
    u, step = float(branch.speeds[-1]), abs(float(branch.speeds[-1] - branch.speeds[-2]))
    last = BEYOND * end  # speed up to which branches are followed
    steps = most + min(max(last - u, 0.0) / max(step, 1e-3 * end), asked.steps - most)
    with counted() as work, suppress(PipedynError):
        limit_cycle(asked.model, u, branch.cycles[-1], rtol=asked.options.rtol)
    total = 0.0
    for onset in onsets:
        share = max((last - onset.speed) / (last - first.speed), most / steps)
        solved = np.count_nonzero(asked.speeds > onset.speed)
        total += share * steps * done / most + float(solved) * work.right_hand_sides
    return total, done + work.right_hand_sides


def seeds(speeds: Array) -> list[float]:
    """Speeds at which solutions on no branch are looked for: the middle, first and last one."""
    return [float(speeds[i]) for i in dict.fromkeys([speeds.size // 2, 0, speeds.size - 1])]


# --------------------------------------------------------------------------------------- equilibria


def equilibrium_branches(
    model: Model, speeds: Array, failed: list[Failed], shown: bool
) -> tuple[EquilibriumBranch, ...]:
    """Branches through the equilibria at three of the speeds, each once."""
    ends = float(speeds[0]), float(speeds[-1])
    branches: list[EquilibriumBranch] = []
    for u in track(seeds(speeds), len(seeds(speeds)), "equilibria", shown):
        try:
            found = searched(model, u, (), counted=False)
        except PipedynError as error:
            failed.append((u, error))
            continue
        for q in found.q:
            # Branches have points at both ends and at the speed at which they began.
            passing = np.concatenate([q[None] + math.inf, *(b.q[b.speeds == u] for b in branches)])
            if np.abs(passing - q).max(axis=1).min() < 1e-5 * (1.0 + np.abs(q).max()):
                continue
            try:
                branches.append(equilibrium_branch(model, q, u, ends))
            except PipedynError as error:
                failed.append((u, error))
    return tuple(branches)


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
    starts: list[Array],
) -> list[Case]:
    """A case for each speed, with the equilibria and the cycles that branches have there.

    Beside the starts that are given, motions begin beside cycles of branches nearby; these starts
    have negative numbers.
    """
    cases = list[Case]()
    with one_thread(model.dof):
        for u in speeds.tolist():
            passing = [_passing(branch, u) for branch in equilibria]
            q = np.concatenate([np.empty((0, model.coordinates)), *passing])
            guesses = model.from_user(q, np.zeros_like(q))[:, : model.integrated]
            drive, found = Excitation(u), equilibria_near(model, guesses, u)
            for branch in cycles:
                for one in branch.at(u):
                    found.append(cycle(model, drive, one.orbit, one.stable))
                    found += [found[-1].mirrored(False)] if branch.mirrored else []
            nearest = (min(b.cycles, key=lambda one: abs(one.u - u)) for b in cycles)
            near = (one for one in nearest if 0.0 < abs(one.u - u) <= NEAR_BRANCH * u)
            begins = dict(enumerate(starts))
            begins |= {-1 - k: _off(model, one) for k, one in enumerate(near)}
            cases.append(Case(model, drive, kept_apart(found), begins))
    return cases


def motions_at(
    model: Model, cases: list[Case], options: MotionOptions, failed: list[Failed]
) -> tuple[tuple[Attractor, ...], list[Solution]]:
    """Ends of motions at each speed, and the solutions that they lead to.

    Motions whose starts have negative numbers, beside cycles of branches nearby, only count if no
    other motion ends on their attractor, as ends with the start -1.
    """
    ends, cases = motion_ends(model, cases, options, "brute force")
    found, reached = list[Attractor](), list[Solution]()
    for case, answers in zip(cases, ends, strict=True):
        u, known = case.drive.mean, {number for k, (number, _) in answers.items() if k >= 0}
        reached += [case.solutions[number] for number in sorted(known) if number >= 0]
        for k, (number, end) in sorted(answers.items()):
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


def _off(model: Model, one: LimitCycle) -> Array:
    """A start a hundredth away from a cycle, maybe unstable: rows p and p', (2, integrated)."""
    p, rates = np.split(np.asarray(model.initial_state(one.q[0], one.qdot[0])), 2)
    return np.stack(model.onto_constraints(1.01 * p, rates))


def _passing(branch: EquilibriumBranch, u: float) -> Array:
    """Coordinates where a branch passes a speed, by linear interpolation, (k, coordinates)."""
    before, after = branch.speeds[:-1], branch.speeds[1:]
    within = np.flatnonzero((before - u) * (after - u) <= 0.0)
    step = after[within] - before[within]
    share = np.divide(u - before[within], step, out=np.zeros_like(step), where=step != 0.0)
    q: Array = branch.q[within] + share[:, None] * (branch.q[within + 1] - branch.q[within])
    return q


# ------------------------------------------------------------------------------------------- cycles


class _Cycles:
    """The branches of cycles found so far, each once."""

    def __init__(self, model: Model, options: BranchOptions, failed: list[Failed]) -> None:
        self.model, self.options, self.failed = model, options, failed
        self.found: list[Traced] = []

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
            onsets = hopf_points(self.model, equilibria, highest, self.failed)
        self.options = replace(self.options, onsets=tuple(point.speed for point in onsets))
        jobs = [partial(self._traced, point) for point in onsets]
        answers = parallel(jobs, executor, label="cycles", progress=shown)
        for point, answer in zip(onsets, answers, strict=True):
            if isinstance(answer, Exception):
                self.failed.append((point.speed, answer))
            else:
                self.add(*answer)

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
                    orbit = as_symmetric(motion, begin)
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
