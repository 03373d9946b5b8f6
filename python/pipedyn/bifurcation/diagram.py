# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.bifurcation.branches import (
    BranchOptions,
    CycleBranch,
    Failed,
    Traced,
    hopf_points,
    same_cycle,
    traced,
)
from pipedyn.bifurcation.brute_force import (
    RECURRENCE,
    SAMPLES_A_TIME,
    Attractor,
    MotionOptions,
    attractors,
    initial_bends,
)
from pipedyn.bifurcation.cycles import NoCycle, amplitude_of
from pipedyn.bifurcation.equilibria import checked_size, equilibria
from pipedyn.bifurcation.equilibrium_branch import (
    EquilibriumBranch,
    equilibrium_branch,
    integrated,
    is_stable_at,
    lies_on,
    mirror_image,
)
from pipedyn.bifurcation.hopf import HopfPoint
from pipedyn.bifurcation.limit_cycle import LARGEST_CYCLE, cycle_from
from pipedyn.bifurcation.statics import Statics
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.motion.simulate import LARGEST_SAMPLES, slight_bend
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import parallel
from pipedyn.util.progress import track
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

MOST_MOTIONS = 100_000
"""Of one call: an hour at 30 ms each."""

MOST_FROM_MOTIONS = 12
"""Cycles, at most, that motions end on and that are followed from there: a second or more each."""

BEYOND = 1.5
"""Share of the highest speed up to which onsets are followed: their cycles may come back."""

NO_INDEX = -1
"""Index of a failure that is at none of the speeds given."""


@result
class BifurcationDiagram:
    """What a pipe does over the flow speed.

    Attributes:
        speeds: u as given, shape (S,).
        equilibria: branches over the range of these, the straight pipe's first, mirror images
            included.
        cycles: branches of cycles within these speeds, those from onsets of flutter first, each
            followed by those that leave it; of two that are mirror images one.
        motions: where motions from a batch of starts end; empty where they were not wanted.
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
    cycles from each onset of flutter of the straight pipe and of bent ones. Onsets count up to 1.5
    times the highest speed given. Their cycles are followed up to a quarter beyond both the speeds
    and the onset, since they may come back. Cycles that leave cycles at pitchforks and period
    doublings within the speeds are followed as well, two generations of them; what leaves at a
    torus is no cycle. Motions are integrated at the speeds given. Where one ends on a cycle that no
    onset leads to, that is followed both ways. Without `brute_force` motions look for one at the
    first, the middle and the last speed, if no cycle and no stable equilibrium is known there.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        cycles: number of steps along each branch of cycles at most; 0 for no cycles. Models of more
            than 100 degrees of freedom have to be given 0.
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
    options = MotionOptions(
        check.real("transient", transient, low=0.0, high=1e6),
        check.real("duration", duration, low=1.0, high=1e4),
        check.real("rtol", rtol, low=1e-12, high=1e-2),
        check.flag("exponents", exponents),
    )
    if count and options.samples * model.coordinates > LARGEST_SAMPLES:
        raise ValueError(
            f"duration must ask for at most {LARGEST_SAMPLES} numbers a motion, at "
            f"{SAMPLES_A_TIME} samples a unit of time, got {options.samples * model.coordinates}"
        )
    seed = check.count("seed", seed, low=0)
    check.executor("executor", executor)
    shown = check.flag("progress", progress)

    failures: list[Failure] = []
    branches = equilibrium_branches(model, at, failures, shown)
    found = _Cycles(model, BranchOptions(at, options.rtol, steps), failures)
    if steps:
        found.from_onsets(branches, executor, shown)
    motions: tuple[Attractor, ...] = ()
    if count:
        starts = initial_bends(model, count, seed)
        motions, failed = attractors(model, at, starts, options, executor, shown)
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
    statics = Statics(model)
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
        for x in integrated(statics, found.q):
            with one_thread(model.dof):
                if any(lies_on(statics, branch, x, u) for branch in branches):
                    continue
            try:
                branch = equilibrium_branch(model, x, u, ends)
            except PipedynError as error:
                failures.append(Failure(i, u, error))
                continue
            branches.append(branch)
            image = mirror_image(statics, branch)
            if image is not None:
                branches.append(image)
    return tuple(branches)


# ------------------------------------------------------------------------------------------- cycles


class _Cycles:
    """Branches of cycles that were found so far, each once.

    Args:
        model: the model.
        options: how branches are followed.
        failures: takes what could not be followed.
    """

    def __init__(self, model: Model, options: BranchOptions, failures: list[Failure]) -> None:
        self.model, self.options, self.failures = model, options, failures
        self.found: list[Traced] = []

    @property
    def branches(self) -> list[CycleBranch]:
        return [one.branch for one in self.found if one.branch is not None]

    def fail(self, u: float, error: Exception) -> None:
        at = np.flatnonzero(self.options.speeds == u)
        self.failures.append(Failure(int(at[0]) if at.size else NO_INDEX, u, error))

    def add(self, answer: tuple[list[Traced], tuple[Failed, ...]]) -> None:
        """Takes the branches of one beginning."""
        branches, failed = answer
        for u, error in failed:
            self.fail(u, error)
        for one in branches:
            if not any(one.retraces(other) for other in self.found):
                self.found.append(one)

    def from_onsets(
        self, equilibria: tuple[EquilibriumBranch, ...], executor: Executor | None, shown: bool
    ) -> None:
        """From the onsets of flutter."""
        begun: list[HopfPoint] = []
        with one_thread(self.model.dof):
            highest = BEYOND * float(self.options.speeds[-1])
            for point in hopf_points(self.model, equilibria, highest):
                if isinstance(point, HopfPoint):
                    begun.append(point)
                else:
                    self.fail(*point)
        self.options = replace(self.options, onsets=tuple(point.speed for point in begun))
        jobs = [partial(traced, self.model, point, self.options) for point in begun]
        answers = parallel(jobs, executor, label="cycles", progress=shown)
        for point, answer in zip(begun, answers, strict=True):
            if isinstance(answer, Exception):
                self.fail(point.speed, answer)
            else:
                self.add(answer)

    def through(self, u: float, state: Array) -> None:
        """Through the cycle that a motion from a state, or from coordinates at rest, ends on."""
        motion = VectorField(self.model)
        try:
            with one_thread(motion.size):
                orbit, _ = cycle_from(motion, u, state)
                amplitude, _ = amplitude_of(motion, orbit)
        except NewtonFailed as reason:
            self.fail(u, NoCycle(f"the cycle at u = {u:g} was not followed: {reason}", u))
            return
        except PipedynError as error:
            self.fail(u, error)
            return
        known = (cycle for branch in self.branches for cycle in branch.at(u))
        if not any(same_cycle(cycle, orbit.frequency, amplitude) for cycle in known):
            self.add(traced(self.model, orbit, self.options))

    def from_motions(self, motions: tuple[Attractor, ...]) -> None:
        """Through cycles on which motions end and that lie on no branch."""
        left = MOST_FROM_MOTIONS
        for one in motions:
            if one.ending != "periodic" or one.speed == 0.0:
                continue
            half = 0.5 * float(np.ptp(one.turnings))
            known = [c for branch in self.branches for c in branch.at(one.speed)]
            if any(abs(c.amplitude / half - 1.0) < RECURRENCE for c in known):
                continue
            if left == 0:
                many = f"motions end on more than {MOST_FROM_MOTIONS} cycles that lie on no branch"
                self.fail(one.speed, NotConverged(many))
                return
            left -= 1
            self.through(one.speed, one.end)

    def where_none(self, equilibria: tuple[EquilibriumBranch, ...]) -> None:
        """Through cycles at speeds at which no cycle and no stable equilibrium is known."""
        for i in seeds(self.options.speeds):
            u = float(self.options.speeds[i])
            if any(branch.passes(u) for branch in self.branches) or u == 0.0:
                continue
            if any(is_stable_at(branch, u) for branch in equilibria):
                continue
            self.through(u, self.model.bent(slight_bend))
