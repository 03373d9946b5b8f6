# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

import inspect
import math
import sys
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.motion_ends import Case, Failed, exponents_of, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.attraction.solutions import (
    cycle,
    equilibria_near,
    kept_apart,
)
from pipedyn.cycles.branches import (
    BEYOND,
    BranchOptions,
    CycleBranch,
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
from pipedyn.orbits.from_motion import LARGEST_CYCLE
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import clock, counted
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.later import futures
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import parallel, track, watched
from pipedyn.util.result import Result, TableResult, joined
from pipedyn.util.threads import one_thread

MOST_MOTIONS = 100_000
"""Of one call: an hour at 30 ms each."""

STEPS_AHEAD = 8
"""Along a branch of cycles, after which its steps grow no more: beside an onset they are short."""

SPARSE = 4
"""Speeds for each one at which motions are integrated first: cycles that these lead to are followed
to the others, where motions then end sooner. A choice: other numbers were not measured."""

NEAR_BRANCH = 0.1
"""Relative difference of speeds up to which motions begin beside the nearest cycle of a branch that
has none at a speed: what is born where a branch ends or is lost attracts few other starts."""

MOST_FROM_MOTIONS = 12
"""Cycles, at most, that motions end on and that are followed from there: a second or more each."""


@saved_as("BifurcationDiagram", shapes={"S": "speeds"})
class BifurcationDiagram(TableResult):
    """What a pipe does over the flow speed.

    Attributes:
        speeds: u as given, shape (S,).
        equilibria: branches over the range of these, the straight pipe's first, mirror images
            included.
        cycles: branches of cycles within these speeds, those from onsets of flutter first, each
            followed by those that leave it; of two that are mirror images one.
        motions: where motions from a batch of starts end; empty where they were not wanted. An
            attractor with the start -1 was reached by none of these, but by a motion that began
            beside a cycle at a neighbouring speed.
        failures: points that failed, with what they raised, by speed; `value` is the flow speed and
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
        """Where motions end at the speed nearest to u >= 0; raises ValueError or TypeError."""
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
    """Equilibria and cycles over a range of flow speeds and, on request, where motions end.

    Equilibria are followed by arc length, past folds, and so are the cycles from each onset of
    flutter of straight and bent pipes, up to 1.5 times the highest speed given. Cycles are followed
    up to a quarter beyond both the speeds and the onset, since they may come back. So are, for two
    generations, cycles that leave them at pitchforks and period doublings within the speeds, if the
    branch that they leave goes over a twentieth of the range of speeds, or over the least gap
    between these where that is smaller; what leaves at a torus is no cycle. Motions are integrated
    at the speeds given. Where one ends on a cycle that no onset leads to, that is followed both
    ways. Without `brute_force` motions look for one at the first, the middle and the last speed, if
    no cycle and no stable equilibrium is known there.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        cycles: number of steps along each branch of cycles at most; 0 for no cycles. Models of more
            than 100 degrees of freedom have to be given 0.
        brute_force: number of initial states for each speed; 0 for none.
        transient: time in T that is left out before motions are recorded. A motion that has reached
            a known equilibrium or cycle ends earlier; known is also what another has led to, see
            `attractors`. Irregular ones at one speed whose turning points are spread alike go on as
            one after a quarter of this time, as long as that stays irregular.
        duration: time over which they are then recorded; those that come nearer to something are
            followed for up to eight times as long as both.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed, by which
            chaos and quasi-periodic motion are told apart; without it they are "irregular".
        rtol: relative tolerance of cycles at the speeds given, and of the steps of motions that are
            recorded, relative to the motion's size. On the way there explicit steps take 1e-4 where
            rtol is less.
        seed: of the initial states; the first is always a slight bend.
        executor: a `concurrent.futures.Executor`; its tasks are branches of cycles and batches of
            motions. Those that it does not answer, since a worker died or it is broken or shut
            down, fail.
        progress: show progress on stderr, and before that what `diagram_cost` answers.

    Returns:
        BifurcationDiagram; what fails is recorded in `failures` and the rest is kept.

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
    branches, resting = equilibrium_branches(model, at, failed, shown)
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
        cases = _cases(model, some, branches, found.branches)
        ended, cases = motions_at(model, cases, asked.starts, asked.options, failed)
        if asked.steps:
            found.from_motions(cases)
        motions = (*motions, *ended)
    motions = tuple(sorted(motions, key=lambda one: (one.speed, one.start)))
    if asked.steps:
        for u in sorted(seeds(at)):
            passed = (b.speeds.min() <= u <= b.speeds.max() for b in found.branches)
            if u > 0.0 and u not in resting and not any(passed):
                found.through(u, model.bent(slight_bend))
    failed.sort(key=lambda one: one[0])
    places = {u: place for place, u in enumerate(at.tolist())}
    failures = tuple(Failure(places.get(u, -1), u, error) for u, error in failed)
    return BifurcationDiagram(at, branches, tuple(found.branches), motions, failures, model)


@saved_as("DiagramCost")
class DiagramCost(Result):
    """What a bifurcation diagram takes, as far as short pieces of its work foretell.

    Attributes:
        cycles: right-hand sides and Jacobians for the branches of cycles from onsets, at least:
            what their events take, and the branches that leave them, is not foreseen.
        motions: right-hand sides for the motions and, if asked for, their exponents, as if no cycle
            were known on which they end: with chains of two to four segments and six functions, at
            40 speeds with four starts, 1.1 to 3.3 times what the diagram took.
        seconds: for both and for the branches of equilibria, of one thread; of the same diagrams
            0.5 to 1 times what they took, as branches are not all foreseen.
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
    """What `bifurcation_diagram` takes with these arguments, from short pieces of its work.

    The pieces are the branches of equilibria, the first eight steps along the first branch of
    cycles, one cycle to the tolerance, and the motions from one or two starts at three or six of
    the speeds.

    Args:
        model: as for `bifurcation_diagram`.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        options: any others of its arguments; `executor` and `progress` change nothing.

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
    branches, _ = equilibrium_branches(asked.model, asked.speeds, [], False)
    return _cost(asked, branches, clock() - begun)


@dataclass(frozen=True)
class _Asked:
    """The arguments of `bifurcation_diagram`, checked."""

    model: Model
    speeds: Array
    steps: int  # along each branch of cycles
    starts: list[Array]  # of motions
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
    """The cost of a diagram; seconds: what its branches of equilibria have taken."""
    begun = clock()
    cycles, done = _cycles_cost(asked, branches) if asked.steps else (0.0, 0)
    seconds += (clock() - begun) * cycles / max(done, 1)
    motions, begun = 0.0, clock()
    if asked.starts:
        speeds = asked.speeds.size
        some = np.linspace(0.0, speeds - 1.0, min(speeds, 6 if speeds > 30 else 3)).astype(int)
        starts = asked.starts[: 2 if len(asked.starts) > 7 else 1]
        alone = replace(asked.options, executor=None, shown=False, exponents=False)
        cases = _cases(asked.model, asked.speeds[some], branches, [])
        with counted() as work:
            ended, cases = motions_at(asked.model, cases, starts, alone, [])
        share = speeds * len(asked.starts) / (some.size * len(starts))
        motions = share * work.right_hand_sides
        seconds += share * (clock() - begun)
        if asked.options.exponents:  # one at a speed
            begun = clock()
            first = [one for one in ended if one.start == 0 and one.ending == "irregular"]
            states = [(Excitation(one.speed), one.end) for one in first]
            with counted() as work:
                exponents_of(asked.model, states, asked.options)
            motions += speeds / some.size * work.right_hand_sides
            seconds += speeds / some.size * (clock() - begun)
    return DiagramCost(cycles, motions, seconds)


def _cycles_cost(asked: _Asked, branches: tuple[EquilibriumBranch, ...]) -> tuple[float, int]:
    """Right-hand sides and Jacobians for branches of cycles from the onsets, and of the pieces."""
    end = float(asked.speeds[-1])
    onsets = sorted(hopf_points(asked.model, branches, 1.5 * end, []), key=lambda one: one.speed)
    if not onsets:
        return 0.0, 0
    first = onsets[0]
    # Also where the speeds begin later: only within them are the multipliers computed.
    within = np.array([min(first.speed, float(asked.speeds[0])), max(first.speed, end)])
    most = min(asked.steps, STEPS_AHEAD)
    with counted() as work:
        found, _ = traced(asked.model, first, BranchOptions(within, asked.options.rtol, most))
    branch, done = found[0].branch, work.right_hand_sides
    if branch is None or len(branch) < 2 or not first.speed < end:
        return float(len(onsets) * done), done
    u, step = float(branch.speeds[-1]), abs(float(branch.speeds[-1] - branch.speeds[-2]))
    last = BEYOND * end  # as far as branches are followed
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
    """Where to look for what lies on no branch: the middle, the first and the last speed."""
    return [float(speeds[i]) for i in dict.fromkeys([speeds.size // 2, 0, speeds.size - 1])]


# --------------------------------------------------------------------------------------- equilibria


def equilibrium_branches(
    model: Model, speeds: Array, failed: list[Failed], shown: bool
) -> tuple[tuple[EquilibriumBranch, ...], set[float]]:
    """Branches through the equilibria at three of the speeds, each once.

    The second answer is at which of the three an equilibrium is stable.
    """
    ends = float(speeds[0]), float(speeds[-1])
    branches: list[EquilibriumBranch] = []
    stable = set[float]()
    for u in track(seeds(speeds), len(seeds(speeds)), "equilibria", shown):
        try:
            found = searched(model, u, (), counted=False)
        except PipedynError as error:
            failed.append((u, error))
            continue
        if found.stable.any():
            stable.add(u)
        for q in found.q:
            # Branches have points at both ends and at the speed at which they were begun.
            passing = np.concatenate([q[None] + math.inf, *(b.q[b.speeds == u] for b in branches)])
            if np.abs(passing - q).max(axis=1).min() < 1e-5 * (1.0 + np.abs(q).max()):
                continue
            try:
                branches.append(equilibrium_branch(model, q, u, ends))
            except PipedynError as error:
                failed.append((u, error))
    return tuple(branches), stable


# ------------------------------------------------------------------------------------------ motions


def _sparse_first(speeds: Array) -> list[Array]:
    """Some of the speeds, and then the others, where cycles that the first lead to are known."""
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
) -> list[Case]:
    """A case for each speed, with the equilibria and the cycles that branches have there."""
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
            cases.append(Case(model, drive, kept_apart(found), [_off(model, one) for one in near]))
    return cases


def motions_at(
    model: Model,
    cases: list[Case],
    starts: list[Array],
    options: MotionOptions,
    failed: list[Failed],
) -> tuple[tuple[Attractor, ...], list[Case]]:
    """Where motions from each start end at each speed, and what is known there then.

    Of those from cycles of branches nearby, with the start -1, only what no other ends on.
    """
    ends, cases = motion_ends(model, cases, starts, options, "brute force")
    found = list[Attractor]()
    for case, answers in zip(cases, ends, strict=True):
        u, known = case.drive.mean, set(case.reached)
        for k, (number, end) in enumerate(answers):
            if k >= len(starts):
                if number >= 0 and number not in known and case.solutions[number].settles:
                    known.add(number)
                    found.append(replace(case.solutions[number].attractor, start=-1))
                continue
            if isinstance(end, Exception):
                failed.append((u, end))
                end = Attractor(u, k, "failed", 0, np.zeros(0), np.zeros(0))
            found.append(end)
    return tuple(found), cases


def _off(model: Model, one: LimitCycle) -> Array:
    """A start a hundredth off a cycle, which may be unstable: rows p and p', (2, integrated)."""
    p, rates = np.split(np.asarray(model.initial_state(one.q[0], one.qdot[0])), 2)
    return np.stack(model.onto_constraints(1.01 * p, rates))


def _passing(branch: EquilibriumBranch, u: float) -> Array:
    """About the coordinates where a branch passes a speed, (k, coordinates)."""
    before, after = branch.speeds[:-1], branch.speeds[1:]
    within = np.flatnonzero((before - u) * (after - u) <= 0.0)
    step = after[within] - before[within]
    share = np.divide(u - before[within], step, out=np.zeros_like(step), where=step != 0.0)
    q: Array = branch.q[within] + share[:, None] * (branch.q[within + 1] - branch.q[within])
    return q


# ------------------------------------------------------------------------------------------- cycles


class _Cycles:
    """Branches of cycles that were found so far, each once."""

    def __init__(self, model: Model, options: BranchOptions, failed: list[Failed]) -> None:
        self.model, self.options, self.failed = model, options, failed
        self.found: list[Traced] = []

    @property
    def branches(self) -> list[CycleBranch]:
        return [one.branch for one in self.found if one.branch is not None]

    def add(self, found: list[Traced], failed: list[Failed]) -> None:
        """Takes the branches of one beginning, and what failed on them."""
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
        highest = 1.5 * float(self.options.speeds[-1])  # cycles from beyond may come back
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
        """What begins at an onset, or goes through an orbit, as far as no branch has it by then."""
        if isinstance(begin, HopfPoint) and self._ends_at(begin):
            return [], []
        return traced(self.model, begin, replace(self.options, known=tuple(self.branches)))

    def _ends_at(self, point: HopfPoint) -> bool:
        """Whether a branch of cycles ends at an onset."""
        ends = (one.end for one in self.found)
        return any(end.kind == "hopf" and end.speed == point.speed for end in ends if end)

    def through(self, u: float, begin: PeriodicOrbit | Array) -> None:
        """Through a cycle, or that which a motion from coordinates at rest ends on."""
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

    def from_motions(self, cases: list[Case]) -> None:
        """Through cycles that motions led to and that lie on no branch."""
        followed = 0
        for case in cases:
            u = case.drive.mean
            for one in (case.solutions[number] for number in case.reached if number >= 0):
                orbit = one.orbit if one.attracts and u > 0.0 else None
                if orbit is None:
                    continue
                known = len(self.found)
                if followed == MOST_FROM_MOTIONS:
                    many = f"motions end on more than {followed} cycles that lie on no branch"
                    self.failed.append((u, NotConverged(many)))
                    return
                self.through(u, orbit)
                followed += len(self.found) > known
