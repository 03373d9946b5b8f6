# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.bifurcation.arcs import Birth
from pipedyn.bifurcation.branches import (
    Asked,
    CycleBranch,
    Failed,
    Traced,
    births,
    same_cycle,
    traced,
)
from pipedyn.bifurcation.brute_force import (
    RECURRENCE,
    SAMPLES_A_TIME,
    Attractor,
    Plan,
    attractors,
    initial_bends,
)
from pipedyn.bifurcation.continuation import Lost, solve
from pipedyn.bifurcation.equilibria import (
    EquilibriumBranch,
    Rest,
    checked_size,
    equilibria,
    equilibrium_branch,
)
from pipedyn.bifurcation.fourier import Elsewhere
from pipedyn.bifurcation.limit_cycle import LARGEST_CYCLE, NoCycle, amplitude_of, cycle_from
from pipedyn.bifurcation.mesh import orbit_of
from pipedyn.bifurcation.vector_field import Field
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.motion.simulate import LARGEST_SAMPLES
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.parallel import parallel
from pipedyn.util.progress import track
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

MOST_MOTIONS = 100_000
"""Of one call."""

MOST_LED = 12
"""Cycles, at most, that motions end on and that are followed from there."""

BEYOND = 1.5
"""Share of the highest speed up to which onsets are followed: their cycles may come back."""

ELSEWHERE = -1
"""Index of a failure that is at none of the speeds asked for."""


@result
class BifurcationDiagram:
    """What a pipe does over the flow speed.

    Attributes:
        speeds: u asked for, shape (S,).
        equilibria: branches over the range of these, the straight pipe's first, mirror images
            included.
        cycles: branches of cycles within these speeds, those from onsets of flutter first, each
            followed by those that leave it; of two that are mirror images one.
        motions: where motions from a batch of starts end; empty where they were not asked for.
        failures: points that failed, with what they raised, by speed; `value` is the flow speed and
            `index` its place among `speeds`, -1 where a branch failed at none of these.
        model: the model.
    """

    speeds: Array
    equilibria: tuple[EquilibriumBranch, ...]
    cycles: tuple[CycleBranch, ...]
    motions: tuple[Attractor, ...] = field(repr=False)
    failures: tuple[Failure, ...]
    model: Model

    def at(self, u: float) -> tuple[Attractor, ...]:
        """Where motions end at the speed nearest to u >= 0.

        Raises:
            ValueError, TypeError: for what is no such number.
        """
        u = check.real("u", u, low=0.0)
        if not self.motions:
            return ()
        nearest = min(self.motions, key=lambda one: abs(one.speed - u)).speed
        return tuple(one for one in self.motions if one.speed == nearest)


def bifurcation_diagram(
    model: Model,
    speeds: ArrayLike,
    *,
    cycles: int = 100,
    brute_force: int = 0,
    transient: float = 100.0,
    duration: float = 40.0,
    exponents: bool = False,
    rtol: float = 1e-6,
    seed: int = 0,
    executor: Executor | None = None,
    progress: bool = False,
) -> BifurcationDiagram:
    """Equilibria and cycles over a range of flow speeds and, on request, where motions end.

    Equilibria are followed by arc length, so that their folds lie wherever they are, and so are the
    cycles from each onset of flutter of the straight pipe and of bent ones, from onsets up to
    1.5 times the highest speed given, and a quarter beyond both the speeds and the onset, since
    they may come back. Cycles that leave cycles at
    pitchforks and period doublings within the speeds are followed as well, two generations of them;
    what leaves at a torus is no cycle. Motions are integrated at the speeds given. Where one ends
    on a cycle that no onset leads to, that is followed both ways; without `brute_force` motions
    look for one at the first, the middle and the last speed, if no cycle and no stable equilibrium
    is known there.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        cycles: number of steps along each branch of cycles at most; 0 for no cycles. Models of more
            than 100 degrees of freedom have to be asked for none.
        brute_force: number of initial states for each speed; 0 for none.
        transient: time in T after which motions count as arrived.
        duration: time over which they are then recorded.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed.
        rtol: relative tolerance of the motions, and of cycles at the speeds given.
        seed: of the initial states; the first is always a slight bend.
        executor: a `concurrent.futures.Executor`; its tasks are branches of cycles and batches of
            motions.
        progress: show progress on stderr.

    Returns:
        BifurcationDiagram; what fails is recorded in `failures` and the rest is kept.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    model = checked_size(model)
    at = checked_speeds(speeds)
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
    plan = Plan(
        check.real("transient", transient, low=0.0, high=1e6),
        check.real("duration", duration, low=1.0, high=1e4),
        check.real("rtol", rtol, low=1e-12, high=1e-2),
        check.flag("exponents", exponents),
    )
    if count and plan.samples * model.coordinates > LARGEST_SAMPLES:
        raise ValueError(
            f"duration must ask for at most {LARGEST_SAMPLES} numbers a motion, at "
            f"{SAMPLES_A_TIME} samples a unit of time, got {plan.samples * model.coordinates}"
        )
    seed = check.count("seed", seed, low=0)
    check.executor("executor", executor)
    shown = check.flag("progress", progress)

    failures: list[Failure] = []
    branches = equilibrium_branches(model, at, failures, shown)
    found = _Cycles(model, Asked(at, plan.rtol, steps), failures)
    if steps:
        found.born(branches, executor, shown)
    motions: tuple[Attractor, ...] = ()
    if count:
        starts = initial_bends(model, count, seed)
        motions, failed = attractors(model, at, starts, plan, executor, shown)
        failures += failed
    if steps:
        found.from_motions(motions)
        found.where_none(branches)
    failures.sort(key=lambda failure: failure.value)
    return BifurcationDiagram(at, branches, tuple(found.branches), motions, tuple(failures), model)


def seeds(speeds: Array) -> list[int]:
    """Where to look for what lies on no branch: the first, the middle and the last speed."""
    return sorted({0, speeds.size // 2, speeds.size - 1})


def checked_speeds(speeds: Any) -> Array:
    """The argument, if it is a row of increasing flow speeds."""
    at = check.array("speeds", speeds, low=0.0, high=LARGEST_SPEED, longest=100_000)
    if at.size < 2 or np.any(np.diff(at) <= 0.0):
        raise ValueError("speeds must be at least 2 and strictly increasing")
    return at


# --------------------------------------------------------------------------------------- equilibria


def equilibrium_branches(
    model: Model, speeds: Array, failures: list[Failure], shown: bool = False
) -> tuple[EquilibriumBranch, ...]:
    """Branches through the equilibria at the first, the middle and the last speed, each once.

    Args:
        model: the model.
        speeds: increasing flow speeds.
        failures: takes what could not be followed.
        shown: show progress.
    """
    rest = Rest(model)
    ends = float(speeds[0]), float(speeds[-1])
    branches: list[EquilibriumBranch] = []
    places = seeds(speeds)
    for i in track(places, len(places), "equilibria", shown):
        u = float(speeds[i])
        try:
            found = equilibria(model, u)
        except PipedynError as error:
            failures.append(Failure(i, u, error))
            continue
        for x in _moving(rest, found.q):
            with one_thread(model.dof):
                if any(_lies_on(rest, branch, x, u) for branch in branches):
                    continue
            try:
                branch = equilibrium_branch(model, x, u, ends)
            except PipedynError as error:
                failures.append(Failure(i, u, error))
                continue
            branches.append(branch)
            image = _mirrored(rest, branch)
            if image is not None:
                branches.append(image)
    return tuple(branches)


def _moving(rest: Rest, q: Array) -> Array:
    """What integrators advance, (k, moving), of coordinates that users see, (k, coordinates)."""
    return np.array([rest.from_start("q", row) for row in q])


def _lies_on(rest: Rest, branch: EquilibriumBranch, x: Array, u: float) -> bool:
    """Whether an equilibrium at a speed is one of a branch's."""
    near = 1e-5 * (1.0 + float(np.abs(x).max()))
    return any(float(np.abs(other - x).max()) < near for other in _passing(rest, branch, u))


def _passing(rest: Rest, branch: EquilibriumBranch, u: float) -> Iterator[Array]:
    """Equilibria of a branch at a speed."""
    xs = _moving(rest, branch.q)
    for (a, u_a), (b, u_b) in pairwise(zip(xs, branch.speeds, strict=True)):
        if min(u_a, u_b) <= u <= max(u_a, u_b):
            share = (u - u_a) / (u_b - u_a) if u_a != u_b else 0.0
            try:
                yield solve(rest, a + share * (b - a), u)[0]
            except Lost:
                continue


def _mirrored(rest: Rest, branch: EquilibriumBranch) -> EquilibriumBranch | None:
    """The mirror image, None where it is the branch itself or no branch of equilibria."""
    xs = _moving(rest, branch.q)
    middle = len(xs) // 2
    x, u = -xs[middle], float(branch.speeds[middle])
    try:
        if rest.unbalanced(x, u) > 1e-8 or _lies_on(rest, branch, x, u):
            return None
    except ValueError:
        return None
    q = rest.recorded(-xs)

    def image(given: Array) -> tuple[Array, Array]:
        turned = rest.recorded(-_moving(rest, given[None]))
        return turned[0], rest.model.tips(turned.T)[0]

    points = []
    for point in branch.points:
        turned, tip = image(point.q)
        points.append(replace(point, q=turned, tip=tip))
    return replace(branch, q=q, tips=rest.model.tips(q.T), points=tuple(points))


# ------------------------------------------------------------------------------------------- cycles


class _Cycles:
    """Branches of cycles in the making, each once.

    Args:
        model: the model.
        asked: what is asked of every branch.
        failures: takes what could not be followed.
    """

    def __init__(self, model: Model, asked: Asked, failures: list[Failure]) -> None:
        self.model, self.asked, self.failures = model, asked, failures
        self.found: list[Traced] = []

    @property
    def branches(self) -> list[CycleBranch]:
        return [one.branch for one in self.found if one.branch is not None]

    def fail(self, u: float, error: Exception) -> None:
        at = np.flatnonzero(self.asked.speeds == u)
        self.failures.append(Failure(int(at[0]) if at.size else ELSEWHERE, u, error))

    def add(self, answer: tuple[list[Traced], tuple[Failed, ...]]) -> None:
        """Takes the branches of one beginning."""
        branches, failed = answer
        for u, error in failed:
            self.fail(u, error)
        for one in branches:
            if not any(one.retraces(other) for other in self.found):
                self.found.append(one)

    def born(
        self, equilibria: tuple[EquilibriumBranch, ...], executor: Executor | None, shown: bool
    ) -> None:
        """From the onsets of flutter."""
        begun: list[Birth] = []
        with one_thread(self.model.dof):
            for birth in births(self.model, equilibria, BEYOND * float(self.asked.speeds[-1])):
                if isinstance(birth, Birth):
                    begun.append(birth)
                else:
                    self.fail(*birth)
        self.asked = replace(self.asked, onsets=tuple(birth.speed for birth in begun))
        jobs = [partial(traced, self.model, birth, self.asked) for birth in begun]
        answers = parallel(jobs, executor, label="cycles", progress=shown)
        for birth, answer in zip(begun, answers, strict=True):
            if isinstance(answer, Exception):
                self.fail(birth.speed, answer)
            else:
                self.add(answer)

    def through(self, u: float, state: Array) -> None:
        """Through the cycle at one of the speeds that a motion from a state ends on."""
        motion = Field(self.model)
        try:
            with one_thread(motion.size):
                course, _ = cycle_from(motion, u, state)
                amplitude, _ = amplitude_of(motion, course)
                orbit = orbit_of(motion, course)
        except Elsewhere as reason:
            self.fail(u, NoCycle(f"the cycle at u = {u:g} was not followed: {reason}", u))
            return
        except PipedynError as error:
            self.fail(u, error)
            return
        known = (cycle for branch in self.branches for cycle in branch.at(u))
        if not any(same_cycle(cycle, orbit.frequency, amplitude) for cycle in known):
            self.add(traced(self.model, orbit, self.asked))

    def from_motions(self, motions: tuple[Attractor, ...]) -> None:
        """Through cycles on which motions end and that lie on no branch."""
        left = MOST_LED
        for one in motions:
            if one.ending != "periodic" or one.speed == 0.0:
                continue
            half = 0.5 * float(np.ptp(one.turnings))
            known = [c for branch in self.branches for c in branch.at(one.speed)]
            if any(abs(c.amplitude / half - 1.0) < RECURRENCE for c in known):
                continue
            if left == 0:
                told = f"motions end on more than {MOST_LED} cycles that lie on no branch"
                self.fail(one.speed, NotConverged(told))
                return
            left -= 1
            self.through(one.speed, _state(self.model, one.end))

    def where_none(self, equilibria: tuple[EquilibriumBranch, ...]) -> None:
        """Through cycles at speeds at which no cycle and no stable equilibrium is known."""
        for i in seeds(self.asked.speeds):
            u = float(self.asked.speeds[i])
            if any(branch.passes(u) for branch in self.branches) or u == 0.0:
                continue
            if any(_rests(branch, u) for branch in equilibria):
                continue
            (bend,) = initial_bends(self.model, 1, 0)
            self.through(u, _state(self.model, self.model.start(bend, None)))


def _rests(branch: EquilibriumBranch, u: float) -> bool:
    """Whether a branch has stable equilibria at a speed."""
    for (a, b), (good, after) in zip(pairwise(branch.speeds), pairwise(branch.stable), strict=True):
        if not min(a, b) <= u <= max(a, b) or not (good or after):
            continue
        stable_end, other = (a, b) if good else (b, a)
        changes = [p.speed for p in branch.points if min(a, b) <= p.speed <= max(a, b)]
        end = min(changes, key=lambda p: abs(p - stable_end), default=other)
        if (good and after) or min(stable_end, end) <= u < max(stable_end, end):
            return True
    return False


def _state(model: Model, y: ArrayLike) -> Array:
    """[q, q'] of what integrators advance."""
    whole = np.asarray(y, dtype=np.float64)[None]
    half = model.moving
    q, qdot = model.recorded(whole[:, :half], whole[:, half : 2 * half])
    return np.concatenate([q[0], qdot[0]])
