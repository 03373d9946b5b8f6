# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria and cycles over the flow speed, and where motions end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.arclength import Lost, solve
from pipedyn.blas import one_thread
from pipedyn.equilibria import (
    EquilibriumBranch,
    Rest,
    checked_size,
    equilibria,
    equilibrium_branch,
)
from pipedyn.modal import LARGEST_SPEED
from pipedyn.model import Model, PipedynError
from pipedyn.motion import LARGEST_SAMPLES
from pipedyn.progress import track
from pipedyn.sections import SAMPLES_A_TIME, Ended, Plan, bends, endings
from pipedyn.stability import Failure

Complex = NDArray[np.complex128]

UNIT = 1e-6
"""By how much the modulus of a multiplier may exceed 1 on a stable cycle."""

HALVINGS = 10
"""Times that an interval of speeds is halved around an event."""

NEAR_FOLD = 0.2
"""Distance of a multiplier from 1 below which a branch that ends there ends in a fold."""

MOST_MOTIONS = 100_000


EventKind = Literal[
    "fold", "pitchfork", "period doubling", "torus", "hopf", "infinite period", "end"
]

SLOW = 0.5
"""Share of a branch's highest frequency below which, still falling, it falls towards 0."""


class Cycle(Protocol):
    """What is needed of a limit cycle."""

    @property
    def amplitude(self) -> float:
        """Half the peak-to-peak transverse motion of the free end."""

    @property
    def frequency(self) -> float:
        """Angular, in 1 / T."""

    @property
    def multipliers(self) -> Any:
        """Floquet multipliers, the trivial one among them."""

    @property
    def stable(self) -> bool:
        """Whether motions nearby approach it."""


class Finder(Protocol):
    """How a cycle is found."""

    def __call__(self, model: Model, u: float, *, start: Any) -> Cycle:
        """A cycle of a model at a speed, from one nearby or None; PipedynError if there is none."""


@dataclass(frozen=True)
class CycleEvent:
    """Where the stability of a branch of cycles changes, or the branch ends.

    Attributes:
        kind: "fold" (the branch ends: it turns back), "pitchfork" (a multiplier passes 1 and the
            branch goes on: the cycle loses or regains its symmetry), "period doubling" (a
            multiplier passes -1), "torus" (a pair passes the unit circle), "hopf" (the cycle
            shrinks to nothing), "infinite period" (the frequency falls towards 0, as where a cycle
            meets an equilibrium) or "end" (no cycle was found beyond, for no reason seen here).
        speed: u.
        error: half the interval of speeds that is known to hold it.
        multiplier: the one that passes, or comes closest to 1 at an end.
    """

    kind: EventKind
    speed: float
    error: float
    multiplier: complex


@dataclass(frozen=True)
class CycleBranch:
    """Cycles followed over the flow speed.

    Attributes:
        speeds: u, shape (S,).
        amplitudes: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        frequencies: angular, in 1 / T, shape (S,).
        stable: shape (S,).
        multipliers: Floquet multipliers, the largest first, the trivial one among them, shape
            (S, n).
        events: in order of speed.
        cycles: the cycles themselves.
    """

    speeds: Array
    amplitudes: Array
    frequencies: Array
    stable: NDArray[np.bool_] = field(repr=False)
    multipliers: Complex = field(repr=False)
    events: tuple[CycleEvent, ...]
    cycles: tuple[Cycle, ...] = field(repr=False)

    def __len__(self) -> int:
        return len(self.speeds)


@dataclass(frozen=True)
class BifurcationDiagram:
    """What a pipe does over the flow speed.

    Attributes:
        speeds: u asked for, shape (S,).
        equilibria: branches over the range of these, the straight pipe's first, mirror images
            included.
        cycles: branches of cycles.
        motions: where motions from a batch of starts end; empty where they were not asked for.
        failures: points that failed, with what they raised; `index` is that of the speed.
        model: the model.
    """

    speeds: Array
    equilibria: tuple[EquilibriumBranch, ...]
    cycles: tuple[CycleBranch, ...]
    motions: tuple[Ended, ...] = field(repr=False)
    failures: tuple[Failure, ...]
    model: Model

    def at(self, u: float) -> tuple[Ended, ...]:
        """Where motions end at the speed nearest to u."""
        if not self.motions:
            return ()
        nearest = min(self.motions, key=lambda one: abs(one.speed - u)).speed
        return tuple(one for one in self.motions if one.speed == nearest)


def bifurcation_diagram(
    model: Model,
    speeds: ArrayLike,
    *,
    brute_force: int = 0,
    transient: float = 100.0,
    duration: float = 40.0,
    exponents: bool = False,
    rtol: float = 1e-6,
    seed: int = 0,
    executor: Executor | None = None,
    progress: bool = False,
) -> BifurcationDiagram:
    """Equilibria over a range of flow speeds and, on request, where motions end.

    Equilibria are followed by arc length, so that their folds lie wherever they are; motions are
    integrated at the speeds given.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        speeds: flow speeds, increasing, at least 2, shape (S,).
        brute_force: number of initial states for each speed; 0 for none.
        transient: time in T after which motions count as arrived.
        duration: time over which they are then recorded.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed.
        rtol: relative tolerance of the motions.
        seed: of the initial states; the first is always a slight bend.
        executor: a `concurrent.futures.Executor`; batches of motions are its tasks.
        progress: show progress on stderr.

    Returns:
        BifurcationDiagram; what fails is recorded in `failures` and the rest is kept.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    model = checked_size(model)
    at = checked_speeds(speeds)
    count = _check.count("brute_force", brute_force, low=0, high=10_000)
    if count * at.size > MOST_MOTIONS:
        raise ValueError(
            f"brute_force must ask for at most {MOST_MOTIONS} motions, got {count * at.size}"
        )
    plan = Plan(
        _check.real("transient", transient, low=0.0, high=1e6),
        _check.real("duration", duration, low=1.0, high=1e4),
        _check.real("rtol", rtol, low=1e-12, high=1e-2),
        _check.flag("exponents", exponents),
    )
    if count and plan.samples * model.coordinates > LARGEST_SAMPLES:
        raise ValueError(
            f"duration must ask for at most {LARGEST_SAMPLES} numbers a motion, at "
            f"{SAMPLES_A_TIME} samples a unit of time, got {plan.samples * model.coordinates}"
        )
    seed = _check.count("seed", seed, low=0)
    _check.executor("executor", executor)
    shown = _check.flag("progress", progress)

    failures: list[Failure] = []
    branches = equilibrium_branches(model, at, failures, shown)
    motions: tuple[Ended, ...] = ()
    if count:
        starts = bends(model, count, seed)
        motions, failed = endings(model, at, starts, plan, executor, shown)
        failures += failed
    failures.sort(key=lambda failure: failure.index)
    return BifurcationDiagram(at, branches, (), motions, tuple(failures), model)


def checked_speeds(speeds: Any) -> Array:
    """The argument, if it is a row of increasing flow speeds."""
    at = _check.array("speeds", speeds, low=0.0, high=LARGEST_SPEED, longest=100_000)
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
    seeds = sorted({0, speeds.size // 2, speeds.size - 1})
    for i in track(seeds, len(seeds), "equilibria", shown):
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


def cycle_branch(
    model: Model,
    speeds: Iterable[float],
    find: Finder,
    start: Any = None,
) -> CycleBranch | None:
    """A branch of cycles, followed through speeds in the order given, until none is found.

    Args:
        model: the model.
        speeds: flow speeds, rising or falling.
        find: a cycle at a speed from one nearby.
        start: what the first is found from.

    Returns:
        CycleBranch in order of speed, None where there is no cycle at the first speed at all.
    """
    found: list[tuple[float, Cycle]] = []
    events: list[CycleEvent] = []
    for u in map(float, speeds):
        if not found:
            try:
                found.append((u, find(model, u, start=start)))
            except PipedynError:
                return None
            continue
        missing = _advanced(model, found, events, u, find)
        if missing is not None:
            events.append(_ending(found, missing))
            break
    if not found:
        return None
    found.sort(key=lambda one: one[0])
    events.sort(key=lambda event: event.speed)
    cycles = tuple(cycle for _, cycle in found)
    return CycleBranch(
        speeds=np.array([u for u, _ in found]),
        amplitudes=np.array([cycle.amplitude for cycle in cycles]),
        frequencies=np.array([cycle.frequency for cycle in cycles]),
        stable=np.array([bool(cycle.stable) for cycle in cycles]),
        multipliers=np.array([_ordered(cycle.multipliers) for cycle in cycles]),
        events=tuple(events),
        cycles=cycles,
    )


def _ordered(multipliers: Any) -> Complex:
    given = np.asarray(multipliers, dtype=np.complex128)
    return given[np.argsort(-np.abs(given), kind="stable")]


def nontrivial(multipliers: Any) -> Complex:
    """All multipliers but the one nearest to 1."""
    given = _ordered(multipliers)
    return np.delete(given, int(np.argmin(np.abs(given - 1.0))))


def _outside(cycle: Cycle) -> int:
    return int(np.count_nonzero(np.abs(nontrivial(cycle.multipliers)) > 1.0 + UNIT))


def _changes(
    model: Model, a: tuple[float, Cycle], b: tuple[float, Cycle], find: Finder
) -> tuple[list[CycleEvent], list[tuple[float, Cycle]]]:
    """Passages of multipliers through the unit circle between two cycles, and those beside them."""
    if _outside(a[1]) == _outside(b[1]):
        return [], []
    low, high = a, b
    for _ in range(HALVINGS):
        u = 0.5 * (low[0] + high[0])
        try:
            middle = find(model, u, start=low[1])
        except PipedynError:
            break
        if _outside(middle) == _outside(low[1]):
            low = (u, middle)
        else:
            high = (u, middle)
    event = CycleEvent(
        *_passing_through(low[1], high[1], abs(high[0] - low[0]), 0.5 * (low[0] + high[0]))
    )
    beside = [one for one in (low, high) if one[0] not in (a[0], b[0])]
    if high[0] == b[0]:
        return [event], beside
    more, others = _changes(model, high, b, find)  # another event in the same interval
    return [event, *more], [*beside, *others]


def _passing_through(
    a: Cycle, b: Cycle, width: float, u: float
) -> tuple[EventKind, float, float, complex]:
    both = np.concatenate([nontrivial(a.multipliers), nontrivial(b.multipliers)])
    nearest = complex(both[int(np.argmin(np.abs(np.abs(both) - 1.0)))])
    kind: EventKind = "torus"
    if abs(nearest.imag) < 1e-3 * abs(nearest):
        kind = "pitchfork" if nearest.real > 0.0 else "period doubling"
    return kind, u, 0.5 * width, nearest


def _advanced(
    model: Model,
    found: list[tuple[float, Cycle]],
    events: list[CycleEvent],
    u: float,
    find: Finder,
) -> float | None:
    """Takes a branch on to a speed, in smaller steps where one is too long.

    A speed without a cycle is asked again from nearer by, until the step is a sixteenth; then the
    end of the branch is halved down to.

    Returns:
        None, or a speed without a cycle close to where the branch ends.
    """
    whole = abs(u - found[-1][0])
    step, missing = whole, None
    while True:
        last, previous = found[-1]
        target = u if step >= abs(u - last) else last + math.copysign(step, u - last)
        try:
            cycle = find(model, target, start=previous)
        except PipedynError:
            missing, step = target, 0.5 * abs(target - last)
            if step < whole / 2**HALVINGS:
                return missing
            continue
        told, between = _changes(model, found[-1], (target, cycle), find)
        events += told
        found += [*between, (target, cycle)]
        if target == u:
            return None
        if missing is not None and step < whole / 16.0:
            step = 0.5 * abs(missing - target)
            if step < whole / 2**HALVINGS:
                return missing


def _ending(found: list[tuple[float, Cycle]], missing: float) -> CycleEvent:
    """Why a branch ends before a speed that has no cycle."""
    last = found[-1]
    sizes = np.array([cycle.amplitude for _, cycle in found])
    others = nontrivial(last[1].multipliers)
    nearest = complex(others[int(np.argmin(np.abs(others - 1.0)))])
    pace = np.array([cycle.frequency for _, cycle in found])
    kind: EventKind = "end"
    if sizes[-1] < 0.05 * sizes.max():
        kind = "hopf"
    elif abs(nearest - 1.0) < NEAR_FOLD:
        kind = "fold"
    elif pace[-1] < SLOW * pace.max() and np.all(np.diff(pace[-3:]) < 0.0):
        kind = "infinite period"
    speed, error = 0.5 * (last[0] + missing), 0.5 * abs(missing - last[0])
    return CycleEvent(kind, speed, error, nearest)
