# SPDX-License-Identifier: MIT
"""When a motion has reached a known attractor: it is near, and comes nearer.

The distance of a state from an attractor is that from the nearest of many states on it, rates being
multiplied by a time of the attractor's own. A motion has reached it when its largest distance over
a period is within a radius and later, without having left that, at most half as large. What passes
a saddle or follows an unstable cycle beside the attractor does not come nearer; what is so near to
attract in all directions is tried with motions from beside each attractor, as far away as that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.models.base import Model
from pipedyn.models.drive import Harmonic, Pulsation
from pipedyn.motion.integrator import Observer, Outcome, Task, integrate
from pipedyn.motion.simulate import BATCH, checked_task, in_batches
from pipedyn.util.check import Array
from pipedyn.util.later import futures, scipy

Labels = NDArray[np.int_]
"""Of each motion the number of a region, or NOWHERE or STOPPED."""

NOWHERE, STOPPED = -1, -2

SPACING, FLOOR = 2e-4, 1e-4
"""Distance between neighbouring states on a cycle, by half of which distances err; and that within
which a state counts as on an attractor."""

SAMPLES, LONGEST_BLOCK = 6, 200
"""Samples in the shortest period of a region, and at most in a block, which spans the longest."""

PHASES = 12
"""Of a period of the drive, at which states are compared."""

LOOK = 200
"""Right-hand sides of a member between two looks, a sixth of the time of some ten periods: looks
take a fifth as long as the motions between them, measured with two segments."""

FIRST_STAGE = 8.0
"""Time after which those that go on are gathered into full batches; then after as much again."""

MEMBERS, LARGEST_BATCH = 128, 2**22
"""Of a batch, for whom one look does, and the numbers in its samples, 32 MB."""

NEARER = 0.5
"""Share of the largest distance in the first period within a region that shows that a motion comes
nearer."""

WIDEST, HALVINGS = 0.05, 5
"""Radius of a region that is tried first, root mean square in rad, and how often it is halved."""

TRIALS, TRIED_NEARER = 16, 0.05
"""Motions from beside an attractor, in directions drawn at random, that show that it attracts, and
how much nearer they must come."""


@dataclass(frozen=True)
class Excitation:
    """What drives the motions: the flow and, in some, the base, from time 0 on.

    Attributes:
        u: flow speed, steady or pulsating.
        base: the base's motion, None at rest.
    """

    u: float | Pulsation
    base: Harmonic | None = None

    @property
    def period(self) -> float:
        """After which it repeats; 0 where all is steady."""
        driving = self.base or self.u
        return 0.0 if isinstance(driving, float) else 2.0 * math.pi / driving.frequency

    @property
    def shifts(self) -> bool:
        """Whether it takes half a period until the mirror image of all that drives acts."""
        return self.base is not None and self.base.direction == "x"

    def whole(self, time: float) -> float:
        """The time, rounded up to whole periods."""
        return math.ceil(time / self.period - 1e-9) * self.period if self.period else time

    def phases(self, t: Array) -> Array:
        """Two columns that tell the phases at times apart, (k, 2); none where all is steady."""
        if not self.period:
            return np.empty((len(t), 0))
        phase = 2.0 * math.pi * np.asarray(t) / self.period
        return np.stack([np.cos(phase), np.sin(phase)], axis=1)


@dataclass(frozen=True, eq=False)
class Region:
    """States around an attractor from which motions come nearer to it.

    Attributes:
        points: states [p, p'] on it, dense along it, (M, 2 moving). Where motions are driven, those
            at PHASES times in each period of the drive, with `Excitation.phases`, so that states at
            other phases are far away.
        unit: time by which rates are multiplied, one over its angular frequency.
        period: of motions on it or, at rest, about it.
        radius: of the region, root mean square of p.
        turn: a whole turn about a hinge at the root, (moving,), after which all is as before.
        driven: whether points have phases.
    """

    points: Array
    unit: float
    period: float
    radius: float = WIDEST
    turn: Array | None = None
    driven: bool = False

    @cached_property
    def _steps(self) -> Array:
        return np.asarray(np.linalg.norm(np.diff(self._scaled(self.points), axis=0), axis=1))

    @property
    def length(self) -> float:
        """Of the way along the points."""
        return float(self._steps.sum())

    @cached_property
    def floor(self) -> float:
        """Distance within which a state counts as on the attractor."""
        if self.driven:
            return FLOOR
        return max(2.0 * float(self._steps.max(initial=0.0)), FLOOR)

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        return scipy.spatial.cKDTree(self._scaled(self._unwound(self.points)))

    @property
    def half(self) -> int:
        """Number of entries of p."""
        return self.points.shape[1] // 2 - self.driven

    def _scaled(self, states: Array) -> Array:
        units = np.repeat([1.0, self.unit], self.half) / math.sqrt(self.half)
        return states * np.append(units, np.ones(2 * self.driven))

    def _unwound(self, states: Array) -> Array:
        if self.turn is None:
            return states
        states, half = states.copy(), self.half
        turns = np.floor(states[:, :half] @ self.turn / float(self.turn @ self.turn) + 0.5)
        states[:, :half] -= turns[:, None] * self.turn
        return states

    def distances(self, states: Array, most: float | None = None) -> Array:
        """Of states, infinite beyond the most, which is the radius if not given.

        States are (k, 2 moving), if driven with phases, or else those when a period begins.
        """
        most = self.radius if most is None else most
        if states.shape[1] < self.points.shape[1]:
            states = np.concatenate([states, np.tile([1.0, 0.0], (len(states), 1))], axis=1)
        near = self._unwound(states)
        found, _ = self._tree.query(self._scaled(near), distance_upper_bound=most)
        if self.turn is not None:
            turn = np.zeros(near.shape[1])
            turn[: self.half] = self.turn
            for other in (near + turn, near - turn):
                beyond, _ = self._tree.query(self._scaled(other), distance_upper_bound=most)
                found = np.minimum(found, beyond)
        return np.asarray(found)

    def apart(self, other: Region) -> float:
        """Smallest distance from another, infinite if they are far apart."""
        most = 4.0 * max(self.radius, other.radius)
        return float(self.distances(other.points[:: max(len(other.points) // 2000, 1)], most).min())

    def mirrored(self, shifts: bool = False) -> Region:
        """That of the mirror image, which is half a period later if the drive shifts."""
        signs = -np.ones(self.points.shape[1])
        if not shifts:
            signs[2 * self.half :] = 1.0
        return replace(self, points=signs * self.points)

    def beside(self, model: Model, seed: int = 0) -> Array:
        """States nearly as far away as the radius, in directions drawn at random, (k, 2 moving)."""
        random = np.random.default_rng(seed)
        half, at = self.half, np.arange(len(self.points))
        if self.driven:  # when a period begins
            at = np.flatnonzero(self.points[:, -2] > 1.0 - 1e-9)
        on = self.points[random.choice(at, TRIALS), : 2 * half]
        away = random.normal(size=on.shape)
        away[:, half:] /= self.unit
        sizes = np.linalg.norm(away * np.repeat([1.0, self.unit], half), axis=1)
        away *= 0.9 * self.radius * math.sqrt(half) / sizes[:, None]
        moved = np.concatenate(model.projected((on + away)[:, :half].T, (on + away)[:, half:].T)).T
        met = np.isfinite(moved.sum(axis=1, keepdims=True))
        return np.where(met, moved, on)


class _Watch(Observer):
    """Ends the motions of a batch that have reached a region. Judged are blocks of samples."""

    def __init__(
        self, regions: Sequence[Region], members: int, phases: Array, nearer: float
    ) -> None:
        super().__init__()
        self.regions, self.phases, self.nearer, self.stretch = regions, phases, nearer, LOOK
        self.block = len(phases)
        self.labels = np.full(members, NOWHERE)
        self.judged = np.zeros(members, dtype=int)  # blocks
        self.inside = np.full(members, NOWHERE)  # the region in which the last block lies
        self.first = np.full(members, math.inf)  # the largest distance in the first such block

    def ended(self, states: Array, samples: Array) -> list[int]:
        """As of `Observer`."""
        found: list[int] = []
        span = np.arange(self.block)
        size = 2 * self.regions[0].half
        while True:
            going = (self.labels == NOWHERE) & (samples >= (self.judged + 1) * self.block)
            ready = np.flatnonzero(going)
            if not ready.size:
                return found
            places = self.judged[ready, None] * self.block + span
            found += self._judge(ready, states[ready[:, None], places, :size])
            self.judged[ready] += 1

    def _judge(self, members: Any, blocks: Array) -> list[int]:
        """Which of some members have reached a region with these blocks, (k, samples, rows)."""
        phases = np.broadcast_to(self.phases, (len(blocks), *self.phases.shape))
        blocks = np.concatenate([blocks, phases], axis=2)
        last = np.stack([region.distances(blocks[:, -1]) for region in self.regions])
        nearest, before = last.argmin(axis=0), self.inside[members]
        self.inside[members] = NOWHERE
        found: list[int] = []
        for k, region in enumerate(self.regions):
            some = np.flatnonzero((nearest == k) & np.isfinite(last[k]))
            if not some.size:
                continue
            rows = blocks[some]
            largest = region.distances(rows.reshape(-1, rows.shape[2])).reshape(rows.shape[:2])
            largest = largest.max(axis=1)
            some, largest = some[np.isfinite(largest)], largest[np.isfinite(largest)]
            at = members[some]
            new = before[some] != k
            self.first[at[new]] = largest[new]
            self.inside[at] = k
            near = np.where(new, 0.0, self.nearer * self.first[at])
            reached = largest <= np.maximum(near, region.floor)
            self.labels[at[reached]] = k
            found += at[reached].tolist()
        return found


def follow(
    model: Model,
    drive: Excitation,
    states: Array,
    regions: Sequence[Region],
    duration: float,
    rtol: float,
    executor: futures.Executor | None = None,
    shown: bool = False,
    nearer: float = NEARER,
) -> tuple[Labels, Array]:
    """Which region each motion reaches, and where it is then or at the end, (k, 2 moving).

    Args:
        model: the model.
        drive: what drives it.
        states: where motions start, (k, 2 moving).
        regions: that are known.
        duration: of the motions at most, after which they have reached NOWHERE.
        rtol: their tolerance.
        executor: of `simulate_many`.
        shown: whether progress is.
        nearer: share of its first distance within a region at which a motion has reached it.
    """
    labels, ends = np.full(len(states), NOWHERE), states.copy()
    periods = [region.period for region in regions] or [drive.period or duration]
    shortest, longest = min(periods), max(periods)
    step = min(max(shortest / SAMPLES, longest / LONGEST_BLOCK), duration)
    if drive.period:
        step = drive.period / PHASES
    block = math.ceil(longest / step - 1e-6)
    phases = drive.phases(step * np.arange(1.0, block + 1.0))
    elapsed, stage = 0.0, FIRST_STAGE
    while elapsed < duration - 1e-9 * step and (labels == NOWHERE).any():
        going = np.flatnonzero(labels == NOWHERE)
        count = block * max(round(min(stage, duration - elapsed) / (step * block)), 1)
        times = step * np.arange(1.0, count + 1.0)
        p, rates = np.split(ends[going[0]], 2)
        first = checked_task(
            *(model, drive.u, float(times[-1]), p, rates),
            times=times,
            rtol=rtol,
            base=drive.base,
            members=len(states),
        )
        tasks = [replace(first, start=np.append(ends[i], 0.0)) for i in going]
        together = max(min(MEMBERS, LARGEST_BATCH // (count * tasks[0].start.size)), BATCH)
        work = partial(_reached, regions, phases, nearer)
        answers = in_batches(tasks, work, executor, shown, together)
        labels[going] = [label for label, _ in answers]
        ends[going] = [end for _, end in answers]
        elapsed += float(times[-1])
        stage = elapsed
    return labels, ends


def _reached(
    regions: Sequence[Region],
    phases: Array,
    nearer: float,
    tasks: Sequence[Task],
    shown: bool,
    observer: Observer,
) -> list[tuple[int, Array]]:
    """Of each motion of a batch which region it reaches, and where it then is."""
    watch = _Watch(regions, len(tasks), phases, nearer)
    outcomes: list[Outcome] = integrate(tasks, shown, watch if regions else observer)
    answers = []
    for label, (rows, _, why) in zip(watch.labels.tolist(), outcomes, strict=True):
        answers.append((STOPPED if why is not None else label, rows[-1, :-1]))
    return answers


def attracting(
    model: Model, drive: Excitation, region: Region, duration: float, rtol: float
) -> Region | None:
    """The region with a radius from which all trials come nearer; None if there is none."""
    for halved in range(HALVINGS + 1):
        tried = replace(region, radius=region.radius * 0.5**halved)
        beside = tried.beside(model)
        labels, _ = follow(model, drive, beside, [tried], duration, rtol, nearer=TRIED_NEARER)
        if (labels == 0).all():
            return tried
    return None
