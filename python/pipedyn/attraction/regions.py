# SPDX-License-Identifier: MIT
"""Regions around known attractors, and how a motion is seen to have reached one.

The distance of a state from an attractor is measured to a curve through many states of the
attractor, with rates multiplied by a time scale of the attractor. Two observations show that a
motion has reached it. If Floquet coordinates about a cycle are known, or modal coordinates about an
equilibrium, each must fall at least half as fast as linear theory says, which is seen when its
square has lost a quarter; the effect of nonlinear forces grows with a higher power of the distance,
so that the motion goes on coming nearer. Otherwise the largest distance over a period must be
within a radius and, while the motion stays within it, fall to a small share of the distance in the
first period. A motion that passes a saddle or follows an unstable cycle beside the attractor does
neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.space import nearest_plane
from pipedyn.motion.integrator import Observer, Outcome, Task, integrate
from pipedyn.orbits.floquet_coordinates import FloquetCoordinates
from pipedyn.util.check import Array, Complex

NOWHERE, STOPPED = -1, -2

FLOOR = 1e-4
"""Distance within which a state counts as on an attractor."""

PHASE_STEP = 1e-4
"""Change of phase over which derivatives of a cycle are taken."""

SAMPLES_A_PERIOD, LONGEST_BLOCK = 6, 200
"""Number of samples in the shortest period of a region, and the most in a block, which spans the
longest period."""

PHASES = 12
"""Number of phases in a period of the drive at which states are compared."""

CALLS_A_LOOK = 400
"""Right-hand sides of a member between two looks, a third of the time of some ten periods. Looks at
a full batch every 200 right-hand sides took a fifth as long as the motions, with two segments."""

ARRIVAL_SHARE = 0.05
"""Share of the largest distance in the first period within a region at which a motion has reached
the attractor: a motion that leaves again never comes this near."""

DECAY_SHARE, ACTIVE_SHARE = 0.75, 0.01
"""Largest share of its square that a Floquet coordinate keeps when a motion is said to come nearer;
and the share of the sum of all squares below which a coordinate is ignored, as others drive it."""

LARGEST_RADIUS = 0.05
"""Radius of a region, root mean square in rad, if no other known solution is near."""

TRIALS = 16
"""Number of motions from beside an attractor, in directions drawn at random, that show that it
attracts."""


def aligned(states: Array, unit: float) -> Array:
    """States of a pipe in three dimensions, (k, 2 integrated), turned about its axis.

    In the result, the plane that is nearest to positions and rates is z = 0, to a sign. Rates are
    multiplied by the time `unit` and by a weight, without which circular motion has no such plane.
    """
    x, z, by_x, by_z = np.split(states, 4, axis=1)
    weight = math.sqrt(0.5) * unit
    azimuths = nearest_plane(np.hstack([x, weight * by_x]), np.hstack([z, weight * by_z]))
    turned = (np.exp(-1j * azimuths)[:, None] * (a + 1j * b) for a, b in ((x, z), (by_x, by_z)))
    return np.hstack([part for one in turned for part in (one.real, one.imag)])


@dataclass(frozen=True, eq=False)
class Region:
    """States around an attractor from which motions come nearer to it.

    Attributes:
        points: states [p, p'] on the attractor, dense along it, (M, 2 integrated). If motions are
            driven, these are states at PHASES times in each period of the drive, with
            `Excitation.phases` appended, so that states at other phases are far away.
        unit: time by which rates are multiplied: the inverse of the attractor's angular frequency.
        period: period of motions on the attractor or, at rest, about it.
        signs: signs of the entries of p in the mirror image of a motion, (integrated,).
        radius: radius of the region, root mean square of p.
        turn: change of p in a whole turn about a hinge at the root, (integrated,), which changes
            nothing.
        axisymmetric: whether a turn of states about the axis of the pipe changes nothing.
        driven: whether `points` contain phases of the drive.
        rates: first and second derivatives in time at the points, (2, M, 2 integrated), if these
            follow one another on a curve; else None.
        floquet: Floquet coordinates about a stable cycle, or modal coordinates about a stable
            equilibrium; None if they are not known.
    """

    points: Array
    unit: float
    period: float
    signs: Array
    radius: float = LARGEST_RADIUS
    turn: Array | None = None
    axisymmetric: bool = False
    driven: bool = False
    rates: Array | None = None
    floquet: FloquetCoordinates | None = None

    @cached_property
    def _reach(self) -> float:
        """Largest distance of a state on the curve from the nearest of the points."""
        if self.rates is None:
            return 0.0
        steps = np.diff(self.points * self.units, axis=0)
        return float(np.linalg.norm(steps, axis=1).max(initial=0.0))

    def __getstate__(self) -> dict[str, Any]:
        return {name: one for name, one in vars(self).items() if name != "_nearest"}

    @cached_property
    def _scaled(self) -> Array:
        """Points in the units of distances, of which one is nearest to any state."""
        points = self._without_turns(self.points)
        if self.turn is not None:  # the point nearest to a state may be a turn away
            turn = np.zeros(points.shape[1])
            turn[: self.half] = self.turn
            points = np.concatenate([points, points + turn, points - turn])
        if self.axisymmetric:  # half a turn leaves the plane of a state the same
            signs = np.repeat([-1.0, 1.0], [2 * self.half, 2 * self.driven])
            points = np.concatenate([points, signs * points])
        return points * self.units

    @cached_property
    def _nearest(self) -> _core.NearestPoint:
        if self.rates is None:
            return _core.NearestPoint(self._scaled)
        rates = np.tile(self.rates * self.units, (len(self._scaled) // len(self.points), 1))
        if self.axisymmetric:
            rates[:, len(self.points) :] *= -1.0
        return _core.NearestPoint(self._scaled, *rates)

    @property
    def half(self) -> int:
        """Number of entries of p."""
        return self.points.shape[1] // 2 - self.driven

    @cached_property
    def units(self) -> Array:
        """Factors by which states are multiplied for their distances."""
        units = np.repeat([1.0, self.unit], self.half) / math.sqrt(self.half)
        return np.append(units, np.ones(2 * self.driven))

    def _without_turns(self, states: Array) -> Array:
        if self.axisymmetric:
            own, phases = np.split(states, [2 * self.half], axis=1)
            return np.hstack([aligned(own, self.unit), phases])
        if self.turn is None:
            return states
        states, half = states.copy(), self.half
        turns = np.floor(states[:, :half] @ self.turn / float(self.turn @ self.turn) + 0.5)
        states[:, :half] -= turns[:, None] * self.turn
        return states

    def distances(self, states: Array, most: float | None = None) -> Array:
        """Distances of states, infinite where larger than `most`, by default the radius.

        States have shape (..., 2 integrated). If motions are driven, the phases of the drive are
        appended to the states; without phases, the states are those at the beginning of a period.
        """
        most = self.radius if most is None else most
        rows = states.reshape(-1, states.shape[-1])
        if rows.shape[1] < self.points.shape[1]:
            rows = np.concatenate([rows, np.tile([1.0, 0.0], (len(rows), 1))], axis=1)
        away, _ = self._differences(rows, most)
        found = np.linalg.norm(away, axis=1).reshape(states.shape[:-1])
        return np.where(found <= most, found, math.inf)

    def coordinates(self, states: Array) -> Complex:
        """The Floquet coordinates, (k, coordinates), of states, (k, 2 integrated)."""
        return self._coordinates(*self._differences(states, math.inf))

    def _coordinates(self, away: Array, near: NDArray[np.intp]) -> Complex:
        assert self.floquet is not None
        rows = self.floquet.rows
        return np.asarray(np.einsum("kci,ki->kc", rows[near % len(rows)], away / self.units))

    def of_blocks(self, blocks: Array) -> tuple[Array, Array]:
        """Largest distance of the states of k blocks, (k,), infinite where larger than the radius.

        Second come mean squares of Floquet coordinates over each block, (k, coordinates): 0 where
        the distance is infinite, and no coordinates if they are not known. blocks: states as for
        `distances`, with the phases of the drive, shape (k, S, 2 integrated).
        """
        count, each, _ = blocks.shape
        away, near = self._differences(blocks.reshape(-1, blocks.shape[2]), self.radius)
        largest = np.linalg.norm(away, axis=1).reshape(count, each).max(axis=1)
        largest[largest > self.radius] = math.inf
        within = np.isfinite(largest)
        squares = np.zeros((count, 0 if self.floquet is None else self.floquet.decay.size))
        if self.floquet is not None and within.any():
            every = np.repeat(within, each)
            found = self._coordinates(away[every], near[every])
            squares[within] = (np.abs(found) ** 2).reshape(-1, each, found.shape[1]).mean(axis=1)
        return largest, squares

    def _differences(self, states: Array, most: float) -> tuple[Array, NDArray[np.intp]]:
        """Scaled differences of states from the attractor, infinite if larger than `most`.

        Second come the numbers of the points nearest to the states. From a curve differences are of
        third order in the time by which states are ahead of these points.
        """
        scaled = self._without_turns(states) * self.units
        away, near = self._nearest(scaled, most + self._reach)
        return away, near % len(self.points)

    def within(self, radius: float) -> Region:
        """The region with another radius; it keeps what was computed of its points."""
        made = copy(self)
        made.__dict__["radius"] = radius
        return made

    def mirrored(self, shifts: bool = False) -> Region:
        """The region of the mirror image; it is half a period later if `shifts` is true."""
        of_phases = np.full(2 * self.driven, -1.0 if shifts else 1.0)
        signs = np.concatenate([self.signs, self.signs, of_phases])
        rates = None if self.rates is None else signs * self.rates
        floquet = self.floquet
        if floquet is not None:
            floquet = replace(floquet, rows=signs[: 2 * self.half] * floquet.rows)
        return replace(self, points=signs * self.points, rates=rates, floquet=floquet)

    def states_beside(self, model: Model) -> Array:
        """States nearly a radius away, in random directions, shape (k, 2 integrated).

        If motions are driven, the states are at the beginning of a period of the drive.
        """
        random, half = np.random.default_rng(0), self.half
        at = np.arange(0, len(self.points), PHASES if self.driven else 1)
        on = self.points[random.choice(at, TRIALS), : 2 * half]
        away = random.normal(size=on.shape)
        away *= 0.9 * self.radius / np.linalg.norm(away, axis=1, keepdims=True)
        beside = on + away / self.units[: 2 * half]
        moved = np.concatenate(model.onto_constraints(*np.split(beside.T, 2))).T
        met = np.isfinite(moved.sum(axis=1, keepdims=True))
        return np.where(met, moved, on)


@dataclass(frozen=True, eq=False)
class Approach:
    """Record of how a motion has come nearer to the attractor of a region.

    Attributes:
        region: number of the region in which the motion was before, or NOWHERE.
        first: its largest distance in its first period in the region.
        squares: mean squares over a period of its Floquet coordinates when they were last compared.
        since: time since that comparison.
        reached: whether the motion has reached the attractor.
    """

    region: int = NOWHERE
    first: float = math.inf
    squares: Array | None = None
    since: float = 0.0
    reached: bool = False

    def later(self, time: float, squares: Array, decay: Array) -> Approach:
        """The approach after a time; it is completed if Floquet coordinates fall as they must.

        They are compared when the slowest coordinate, falling at half its rate, would have fallen
        to `DECAY_SHARE`.
        """
        if self.squares is None:
            return replace(self, squares=squares, since=0.0)
        slowest = decay[self.squares >= ACTIVE_SHARE * self.squares.sum()].min()
        if (since := self.since + time) * slowest < -math.log(DECAY_SHARE):
            return replace(self, since=since)
        acting = squares >= ACTIVE_SHARE * squares.sum()
        fallen = bool((squares <= DECAY_SHARE * self.squares)[acting].all())
        return replace(self, squares=squares, since=0.0, reached=self.reached or fallen)


@dataclass(frozen=True)
class ApproachTask(Task):
    """A motion to be integrated until it has reached a region.

    Attributes:
        regions: regions that it may reach.
        every: number of samples of which one is compared with the regions.
        phases: `Excitation.phases` of the compared samples of a block.
        approach: how it came nearer to one of the regions before.
    """

    regions: tuple[Region, ...] = ()
    every: int = 1
    phases: Array = field(default_factory=lambda: np.zeros((1, 0)))
    approach: Approach = field(default_factory=Approach)


class Arrivals(Observer):
    """Ends motions of a batch that have reached a region, from blocks of their samples."""

    def __init__(self, tasks: Sequence[ApproachTask]) -> None:
        super().__init__()
        self.stretch = CALLS_A_LOOK
        self.tasks, self.rows = tasks, 2 * tasks[0].model.integrated
        self.blocks = np.zeros(len(tasks), dtype=int)  # number of blocks that were compared
        self.approaches = [task.approach for task in tasks]  # approaches up to the last block
        members_of: dict[tuple[Region, ...], list[int]] = {}
        for member, task in enumerate(tasks):
            members_of.setdefault(task.regions, []).append(member)
        self.groups = [np.array(some) for regions, some in members_of.items() if regions]

    def ended(self, states: Array, samples: Array) -> list[int]:
        """Members of the batch that have reached a region, as `Observer` requires."""
        for members in self.groups:
            task = self.tasks[members[0]]
            span = np.arange(len(task.phases)) * task.every
            size = span.size * task.every
            # A block is whole once its last sample is computed.
            whole = (samples[members] - 1 - span[-1]) // size + 1
            counts = np.maximum(whole - self.blocks[members], 0)
            if counts.any():
                numbers = [np.arange(end - k, end) for k, end in zip(counts, whole, strict=True)]
                ready = np.repeat(members, counts)
                places = np.concatenate(numbers)[:, None] * size + span
                self._compare(task, ready, states[ready[:, None], places, : self.rows])
                self.blocks[members] += counts
        return [member for member, one in enumerate(self.approaches) if one.reached]

    def _compare(self, task: ApproachTask, members: NDArray[np.intp], blocks: Array) -> None:
        """Notes how members, whose tasks have the same regions, have approached these.

        members: the member of each block, (k,); blocks of one member are in the order of time.
        blocks: compared samples, (k, samples, rows).
        """
        if task.phases.size:
            phases = np.broadcast_to(task.phases, (len(blocks), *task.phases.shape))
            blocks = np.concatenate([blocks, phases], axis=2)
        last = np.stack([region.distances(blocks[:, -1]) for region in task.regions])
        nearest = np.where(np.isfinite(last.min(axis=0)), last.argmin(axis=0), NOWHERE)
        time = (task.times[1] - task.times[0]) * blocks.shape[1] * task.every
        largest, squares = np.full(len(blocks), math.inf), [np.zeros(0)] * len(blocks)
        for k in set(nearest.tolist()) - {NOWHERE}:
            some = np.flatnonzero(nearest == k)
            largest[some], means = task.regions[k].of_blocks(blocks[some])
            for i, mean in zip(some.tolist(), means, strict=True):
                squares[i] = mean
        for i, (member, k) in enumerate(zip(members.tolist(), nearest.tolist(), strict=True)):
            before, distance = self.approaches[member], float(largest[i])
            if before.reached:
                continue
            approach, near = Approach(), FLOOR
            if distance < math.inf:
                approach = before if before.region == k else Approach(k, distance)
                if before.region == k:
                    near = max(near, ARRIVAL_SHARE * before.first)
                approach = replace(approach, reached=distance <= near)
                floquet = task.regions[k].floquet
                if floquet is not None:
                    approach = approach.later(time, squares[i], floquet.decay)
            self.approaches[member] = approach


def approach_outcomes(
    tasks: Sequence[ApproachTask], shown: bool, observer: Observer
) -> list[tuple[Outcome, Approach]]:
    """Outcomes of the motions of a batch, and their approaches to regions."""
    arrivals = Arrivals(tasks)
    outcomes = integrate(tasks, shown, arrivals if arrivals.groups else observer)
    return list(zip(outcomes, arrivals.approaches, strict=True))
