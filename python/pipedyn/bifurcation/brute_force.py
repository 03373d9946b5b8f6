# SPDX-License-Identifier: MIT
"""Brute force over the flow speed: where motions from many starts end.

After the transient the section x' = 0 of the free end is kept: its turning points. At rest there
is none, a cycle leaves a few values, a torus or chaos many. A motion ends before if it has reached
a stable equilibrium or cycle that is known, or is at rest or periodic and attracts what starts
beside it: then it would stay so. Irregular motions at one speed that cannot be told apart go on as
one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.bifurcation.capture import (
    NOWHERE,
    TRIED_NEARER,
    Approach,
    Region,
    WatchedTask,
    judged_step,
    watched,
)
from pipedyn.bifurcation.known_solutions import KnownSolution
from pipedyn.bifurcation.motion_options import FIRST_LOOK, SAMPLES_A_TIME, MotionOptions
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.galerkin import Galerkin
from pipedyn.motion.integrator import Outcome, Task, decays_fast, fastest_rates
from pipedyn.motion.lyapunov import LyapunovExponent, exponents_together
from pipedyn.motion.simulate import (
    BATCH,
    LARGEST_SAMPLES,
    MotionStopped,
    assembled,
    checked_task,
    in_batches,
)
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.parallel import parallel
from pipedyn.util.result import Result
from pipedyn.util.units import LENGTH

Failed = tuple[float, Exception]
"""A flow speed and what was raised there."""

Ending = Literal["rest", "periodic", "settling", "irregular", "failed"]

AT_REST = 1e-5
"""Range of the tip, in L, below which it is at rest: ten times what rtol = 1e-6 lets it err."""

RECURRENCE = 1e-3
"""By how much maxima that still converge may differ from those a period before, relative to the
range: beyond, a record is too short to show that they do."""

LONGEST_PERIOD = 16
"""Maxima in a period beyond which a motion counts as irregular: records hold some 50 to 100 maxima,
and three periods are needed to see one."""

ACROSS_KINKS = 0.1
"""Share of rtol that motions take where drag, stops or a scene's modules may have kinks. Turnings
are compared to 10 rtol of the range; over ten periods of 36 cycles, from just above the onset to
1.5 times its speed, motions missed 0.06 of that at most without drag, but 0.6 of it once; with
drag all of it at rtol, and a tenth of it, once 0.6, at rtol / 10."""

SHARE, LEAST_SIZE = 4.0, 1.0 / 64.0
"""Factor between the sizes of motions that are told apart, and the least. Steps of a motion err by
rtol of its size where a coordinate is smaller than that: at rtol of each coordinate the small ones
of fast modes, which nobody sees, ask for 1.5 times as many right-hand sides, measured with six
functions, and the tip then errs by 1e-9 after some time and not by 1e-7."""

TRANSIENT = 1e-4
"""Tolerance of explicit steps while a motion is on its way, if larger than rtol: the tip errs by
1e-5 after some time at it, less than motions differ that go to the same attractor, and right-hand
sides are half as many. What seems settled goes on at rtol, as does what is recorded."""

EXPLICIT = 4.0
"""Right-hand sides of implicit steps in the time 1 / |lambda| of the fastest mode beyond which
explicit ones in batches cost less: motions then excite fast modes, which implicit ones would leap.
Measured with six functions: at 5.6 explicit ones cost half as much while a motion is on its way,
and 1.1 times as much at rtol."""

LARGEST_DENSE = 100
"""Degrees of freedom up to which it is told beforehand, from the eigenvalues at rest, that fast
modes do not decay by a factor e until the first look: then steps are explicit from the start."""

JOINED = 0.25
"""Share of the transient after which motions from several starts at one speed go on as one, if they
are irregular and their turning points were spread alike at two looks one after the other. Where
that one does not stay irregular, the others go on from where they were."""

NUDGE = 0.01
"""How far beside a motion a neighbour begins, rad: as much as linear laws of its distance hold, and
a thousand times what turning points err."""

NEIGHBOUR = -1
"""Of a motion that begins beside a member of a batch and is none itself, for its number."""


@saved_as("Attractor", shapes={"K": "turnings", "n": "end"})
class Attractor(Result, units={"turnings": LENGTH, "period": None}):
    """Where one motion ends.

    Attributes:
        speed: u.
        start: which of the initial states, counted from 0.
        ending: "rest", "periodic" (maxima repeat to the accuracy with which they are known, or
            converge geometrically to such), "settling" (it still approaches rest or a cycle),
            "irregular" (a torus, chaos, or a transient that still lasts) or "failed".
        period: maxima of the tip's transverse position in a period, 0 unless "periodic".
        turnings: transverse position of the tip where its velocity changes sign, in order, over the
            time recorded, or less where it had settled, shape (K,); at rest the position itself.
        end: [p, p'] at the end, shape (2 moving,), empty where it failed.
        exponent: the largest Lyapunov exponent, if asked for and the motion is irregular; of one
            motion for all at a speed whose turning points are spread alike.
    """

    speed: float
    start: int
    ending: Ending
    period: int
    turnings: Array = field(repr=False)
    end: Array = field(repr=False)
    exponent: LyapunovExponent | None = None

    @property
    def name(self) -> str:
        """The ending in words, of irregular ones by their exponent.

        They are "chaotic" with an exponent above 0, "quasi-periodic" where that is 0 within its
        spread, and "irregular" where it is not known.
        """
        if self.ending == "periodic":
            return f"periodic, {self.period} maxim{'um' if self.period == 1 else 'a'}"
        if self.ending != "irregular" or self.exponent is None:
            return self.ending
        if self.exponent.chaotic:
            return f"chaotic, exponent {self.exponent.value:.2g}"
        return "quasi-periodic"


def attractors(
    model: Model,
    speeds: Array,
    starts: list[Array],
    options: MotionOptions,
    failed: list[Failed],
    known: Mapping[float, Sequence[KnownSolution]] = MappingProxyType({}),
) -> tuple[Attractor, ...]:
    """Where motions end, from each start at each speed, where some solutions may be known."""
    members = [(float(u), k) for u in speeds for k in range(len(starts))]
    most = max(LARGEST_SAMPLES // (options.samples * model.coordinates), 1)
    if options.executor is not None:  # else batches are filled up and spread over threads
        most = min(BATCH, most)
    together = len(starts) if len(starts) <= most else 1  # those of a speed, if they fit
    units = len(members) // together
    indices = np.array_split(np.arange(units), math.ceil(units / (most // together)))
    parts = [members[part[0] * together : (part[-1] + 1) * together] for part in indices]
    found: list[Attractor] = []
    sent = replace(options, executor=None)
    jobs = [
        partial(_batch, model, part, starts, sent, {u: known.get(u, ()) for u, _ in part})
        for part in parts
    ]
    answers = parallel(jobs, options.executor, label="brute force", progress=options.shown)
    for part, answer in zip(parts, answers, strict=True):
        if isinstance(answer, Exception):
            answer = [answer] * len(part)
        for (u, k), one in zip(part, answer, strict=True):
            if isinstance(one, Exception):
                failed.append((u, one))
                one = Attractor(u, k, "failed", 0, np.zeros(0), np.zeros(0))
            found.append(one)
    return with_exponents(model, found, options, failed) if options.exponents else tuple(found)


def with_exponents(
    model: Model, ended: Sequence[Attractor], options: MotionOptions, failed: list[Failed]
) -> tuple[Attractor, ...]:
    """The same with the exponents of irregular ones."""
    found, sent = list(ended), replace(options, executor=None)
    alike = _alike([i for i, one in enumerate(found) if one.ending == "irregular"], found)
    groups = [alike[i : i + BATCH // 2] for i in range(0, len(alike), BATCH // 2)]
    of = [[found[same[0]] for same in group] for group in groups]
    exponents = [partial(_exponents, model, some, sent) for some in of]
    results = parallel(exponents, options.executor, label="exponents", progress=options.shown)
    for group, answer in zip(groups, results, strict=True):
        each = [answer] * len(group) if isinstance(answer, Exception) else answer
        for same, exponent in zip(group, each, strict=True):
            if isinstance(exponent, Exception):
                failed.append((found[same[0]].speed, exponent))
                continue
            for i in same:
                found[i] = replace(found[i], exponent=exponent)
    return tuple(found)


def _alike(places: list[int], found: list[Attractor]) -> list[list[int]]:
    """Those at one speed together whose turning points are spread alike: they end on the same."""
    groups: list[list[int]] = []
    for i in places:
        for group in groups:
            one, other = found[group[0]], found[i]
            if one.speed == other.speed and spread_alike(one.turnings, other.turnings):
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def spread_alike(a: Array, b: Array) -> bool:
    """Unless a Kolmogorov-Smirnov test tells two sets of values apart with 99 % certainty."""
    if min(a.size, b.size) < 2:
        return False
    a, b = np.sort(a), np.sort(b)
    both = np.concatenate([a, b])
    shares = (np.searchsorted(x, both, side="right") / x.size for x in (a, b))
    apart = float(np.abs(next(shares) - next(shares)).max())
    return apart < 1.63 * math.sqrt(1.0 / a.size + 1.0 / b.size)


def _exponents(
    model: Model, irregular: list[Attractor], options: MotionOptions
) -> list[LyapunovExponent | MotionStopped]:
    """The largest exponents of irregular motions."""
    speeds, ends = [one.speed for one in irregular], [one.end for one in irregular]
    return exponents_together(model, speeds, ends, 2.0 * options.duration, 10.0)


@dataclass(eq=False)
class _Run:
    """A motion that goes on from a state."""

    member: int  # its number in its batch, or NEIGHBOUR
    speed: float
    start: int
    state: Array  # [p, p']
    settled: bool = False  # as its last record shows
    next_trial: float = 0.0  # time from which it may be tried for whether it attracts
    approach: Approach = field(default_factory=Approach)  # to a known solution
    like: _Run | None = None  # whose turning points were spread alike at the last look
    alone: bool = False  # whether it does not join another
    explicit: bool = False  # whether explicit steps cost less
    size: float = LEAST_SIZE  # of the motion, a power of SHARE
    rate_size: float = LEAST_SIZE  # and of its rates
    under_way: bool = True  # whether the tolerance may be TRANSIENT
    roughly: bool = False  # whether it was in the last record

    def resized(self, span: float, fastest: float) -> None:
        """Takes note of how far its tip or its coordinates range, and how fast they move."""
        self.size = min(size_of(span), 1.0)
        self.rate_size = max(size_of(fastest), self.size)


def size_of(span: float) -> float:
    """Of a motion, or its rates, that range so far: a power of SHARE, rounded down."""
    steps = math.floor(math.log(max(span, LEAST_SIZE)) / math.log(SHARE) + 1e-9)
    return float(SHARE**steps)


@dataclass(frozen=True)
class _Record:
    """What a motion did over some time."""

    x: Array  # transverse positions of the tip
    turnings: Array
    error: float  # of two turnings together
    ending: Ending
    period: int

    def seems_settled(self) -> bool:
        """Whether it is at rest in the end, or three periods show no change that could be seen."""
        if self.ending == "rest":
            return True
        highs = maxima(self.turnings)
        periods = range(1, min(LONGEST_PERIOD, highs.size // 3) + 1)
        return any(_largest_change(highs[-3 * k :], k) <= self.error for k in periods)

    def attracts(self, neighbour: _Record) -> bool:
        """Whether it has settled and a neighbour comes nearer, by a half in each quarter."""
        apart, error = np.abs(neighbour.x - self.x[-1]), AT_REST
        if self.ending == "periodic":
            own, highs = maxima(self.turnings), maxima(neighbour.turnings)
            if _largest_change(own, self.period) > self.error:
                return False
            apart = np.abs(highs[:, None] - own[-self.period :]).min(axis=1)
            error = self.error + neighbour.error
        elif self.ending != "rest":
            return False
        if apart.size < 8:
            return False
        quarters = [float(part.max()) for part in np.array_split(apart, 4)]
        if max(quarters[0], abs(neighbour.x[0] - self.x[0])) < 8.0 * error:  # shows nothing
            return False
        return all(b <= max(0.5 * a, error) for a, b in pairwise(quarters))


class _Batch:
    """The motions of one batch, and where those ended that have."""

    def __init__(
        self,
        model: Model,
        options: MotionOptions,
        known: Mapping[float, Sequence[KnownSolution]],
        bend: Array,
    ) -> None:
        self.model, self.options, self.elapsed = model, options, 0.0
        self.bend = bend  # towards which neighbours begin
        self.joined: list[tuple[_Run, _Run, float]] = []  # one, another, and since when
        self.answers: dict[int, Attractor | Exception] = {}
        self.known: dict[float, list[Attractor]] = {}
        self.regions: dict[float, tuple[Region, ...]] = {}  # of these
        for u, solutions in known.items():
            every = [(self.on_known(u, one), one.region) for one in solutions if one.stable]
            told = [(end, region) for end, region in every if end.ending in ("rest", "periodic")]
            self.known[u] = [end for end, _ in told]
            self.regions[u] = tuple(region for _, region in told)
        smooth = isinstance(model, (Chain, Galerkin)) and not model.pipe.has_kinks
        self.tolerance = options.rtol * (1.0 if smooth else ACROSS_KINKS)

    def advance(self, runs: list[_Run], before: float, recorded: float) -> list[_Record | None]:
        """Goes on for some time and then a time that is recorded; None of one that has ended."""
        if not runs:
            return []
        samples = before + np.linspace(0.0, recorded, self.options.samples_of(recorded))
        p, rates = np.split(runs[0].state, 2)
        first = checked_task(
            *(self.model, self.options.flow or runs[0].speed, before + recorded, p, rates),
            times=samples,
            rtol=self.tolerance,
            base=self.options.base,
            members=len(runs),
        )
        of_all = WatchedTask(**vars(first), nearer=TRIED_NEARER, kept=True)
        sample, judged = recorded / (samples.size - 1), dict[float, Any]()
        for u, regions in self.regions.items():
            step, longest = judged_step(regions, recorded)
            every = max(round(step / sample), 1)
            block = np.zeros((math.ceil(longest / (every * sample) - 1e-6), 0))
            judged[u] = {"regions": regions, "every": every, "phases": block}
        tasks = list[WatchedTask]()
        for run in runs:
            method = "dop853" if run.explicit else first.method
            run.roughly = run.under_way and method == "dop853" and first.rtol < TRANSIENT
            rtol = TRANSIENT if run.roughly else first.rtol
            task = replace(
                of_all,
                u=first.u if first.drive else run.speed,
                start=run.state,
                **({} if run.member == NEIGHBOUR else judged.get(run.speed, {})),
                approach=run.approach,
                method=method,
                rtol=rtol,
                atol=rtol * np.repeat([run.size, run.rate_size], run.state.size // 2),
            )
            tasks.append(task)
        # A thread takes some; the members of a chain's batch cost less the more they are.
        members = BATCH if self.model.linear_cost else BATCH // 2
        found = in_batches(tasks, watched, members=members)
        outcomes, records = [one.outcome for one in found], list[_Record | None]([None] * len(runs))
        for run, task, one in zip(runs, tasks, found, strict=True):
            run.approach = one.approach
            rate = one.outcome[1] / (before + recorded)
            run.explicit |= task.method == "radau" and rate > self.dearest
            if one.outcome[2] is not None:
                self.answers[run.member] = self.stopped(run, task, one.outcome)
            elif one.label != NOWHERE:
                end = self.known[run.speed][one.label]
                self.answers[run.member] = replace(end, start=run.start)
        going = [
            i for i, one in enumerate(found) if one.outcome[2] is None and one.label == NOWHERE
        ]
        if not going:
            return records
        rows = np.concatenate([outcomes[i][0][1:] for i in going])
        q, qdot, x, velocity = self.tip_of(rows)
        for k, i in enumerate(going):
            part, last = slice(k * samples.size, (k + 1) * samples.size), (k + 1) * samples.size - 1
            runs[i].state = self.model.integrated(q[last, None], qdot[last, None])[0]
            runs[i].resized(float(np.ptp(x[part])), float(np.abs(velocity[part]).max()))
            rtol = max(self.options.rtol, tasks[i].rtol)
            records[i] = _record(samples, x[part], velocity[part], rtol)
        return records

    @cached_property
    def dearest(self) -> float:
        """Right-hand sides of implicit steps in a unit of time beyond which explicit ones serve."""
        if decays_fast(self.model):
            return math.inf
        fastest, _ = fastest_rates(self.model)
        return EXPLICIT * fastest

    def modes(self, u: float) -> tuple[bool, float]:
        """Whether the fastest mode at rest hardly decays until the first look, and |lambda| of one.

        That is the mode that grows most or decays least.
        """
        if self.options.flow is not None or self.model.moving > LARGEST_DENSE:
            return False, 0.0
        rest = np.concatenate([self.model.resting(), np.zeros(self.model.moving)])
        factorised()
        values = np.linalg.eigvals(self.model.motion_jacobian(rest, u))
        fastest, last = values[np.abs(values).argmax()], values[values.real.argmax()]
        return bool(fastest.real > -1.0 / FIRST_LOOK), float(abs(last))

    def tip_of(self, states: Array) -> tuple[Array, Array, Array, Array]:
        """Coordinates and rates of states [p, p'], (k, 2 moving), and the tip's x and its rate."""
        q, qdot = self.model.recorded(*np.split(states, 2, axis=1))
        x, velocity = self.model.tips(q.T)[:, 0], self.model.tip_velocities(q.T, qdot.T)[:, 0]
        return q, qdot, x, velocity

    def on_known(self, u: float, solution: KnownSolution) -> Attractor:
        """Where a motion ends that a known solution attracts."""
        t, states = solution.recorded(SAMPLES_A_TIME)
        _, _, x, velocity = self.tip_of(states.T)
        end = np.ascontiguousarray(states[:, -1])
        return _attractor(u, -1, _record(t, x, velocity, self.options.rtol), end)

    def stopped(self, run: _Run, task: Task, outcome: Outcome) -> MotionStopped:
        """The error of a motion, by its start and the time since."""
        [motion] = assembled([task], [outcome])
        reached = self.elapsed + float(motion.t[-1] if motion.t.size else 0.0)
        report = f"the motion from start {run.start} stopped after t = {reached:g}: {outcome[2]}"
        return MotionStopped(report, motion)

    def going(self, runs: list[_Run]) -> list[_Run]:
        """Those that have not ended."""
        return [run for run in runs if run.member not in self.answers]

    def keep(self, run: _Run, record: _Record) -> None:
        """Where a motion ends, by its record."""
        self.answers[run.member] = _attractor(run.speed, run.start, record, run.state)

    def look(self, runs: list[_Run], stretch: float) -> list[_Run]:
        """Goes on for a stretch; returns the motions that have neither ended nor joined another."""
        tried = [run for run in runs if run.settled and self.elapsed >= run.next_trial]
        beside = [_neighbour(self.model, run, self.bend) for run in tried]
        others = [run for run in runs if run not in tried]
        irregular: list[tuple[_Run, _Record]] = []
        for run, record in zip(others, self.advance(others, 0.0, stretch), strict=True):
            settled = record is not None and record.seems_settled()
            run.settled = settled and not run.roughly
            run.under_way &= not settled
            unknown = run.approach.region == NOWHERE  # else it will soon have reached that
            if record is not None and record.ending == "irregular" and not settled and unknown:
                irregular.append((run, record))
        records = self.advance([*tried, *beside], 0.0, stretch)
        self.elapsed += stretch
        for run, own, other in zip(tried, records, records[len(tried) :], strict=False):
            run.next_trial = 2.0 * self.elapsed
            if own is not None and other is not None and own.attracts(other):
                self.keep(run, own)
        joined = self.joining(irregular)
        return [run for run in runs if run.member not in self.answers and run not in joined]

    def joining(self, irregular: list[tuple[_Run, _Record]]) -> list[_Run]:
        """Which irregular motions go on as another one at their speed."""
        first: list[tuple[_Run, _Record]] = []  # with which the others are compared
        joined: list[_Run] = []
        for run, record in irregular:
            same = (
                one
                for one, other in first
                if one.speed == run.speed and spread_alike(other.turnings, record.turnings)
            )
            before, run.like = run.like, None if run.alone else next(same, None)
            if run.like is None:
                first.append((run, record))
            elif run.like is before and self.elapsed >= JOINED * self.options.transient:
                joined.append(run)
                self.joined.append((run, run.like, self.elapsed))
        return joined

    def finish(self, runs: list[_Run]) -> None:
        """Follows motions to where they end."""
        # Motions with neighbours take no more samples than all at the end.
        stretch, longest = FIRST_LOOK, max(FIRST_LOOK, 0.5 * self.options.duration)
        if self.elapsed:
            stretch = min(max(FIRST_LOOK, 0.5 * self.elapsed), longest)
        while runs and self.elapsed + stretch <= self.options.transient:
            runs = self.look(runs, stretch)
            stretch = min(max(stretch, 0.5 * self.elapsed), longest)
        before = self.options.transient - self.elapsed
        for run in runs:
            run.under_way = False
        records = self.advance(runs, before, self.options.duration)
        for run, record in zip(runs, records, strict=True):
            if record is not None:
                self.keep(run, record)
        joined, self.joined = self.joined, []
        again: list[tuple[_Run, float]] = []
        for run, other, since in joined:
            end = self.answers[other.member]
            if isinstance(end, Attractor) and end.ending == "irregular":
                self.answers[run.member] = replace(end, start=run.start)
            else:
                run.alone = True
                again.append((run, since))
        for since in sorted({since for _, since in again}):
            self.elapsed = since
            self.finish([run for run, at in again if at == since])


def _batch(
    model: Model,
    members: list[tuple[float, int]],
    starts: list[Array],
    options: MotionOptions,
    known: Mapping[float, Sequence[KnownSolution]],
) -> list[Attractor | Exception]:
    """Where each member of one batch ends, or why it stopped early."""
    batch = _Batch(model, options, known, starts[-1])
    runs = [_Run(i, u, k, _state(model, starts[k])) for i, (u, k) in enumerate(members)]
    modes = {u: batch.modes(u) for u in {run.speed for run in runs}}
    for run in runs:
        run.explicit, frequency = modes[run.speed]
        span, fastest = np.abs(np.split(run.state, 2)).max(axis=1).tolist()
        run.resized(span, max(fastest, frequency * span))
    batch.finish(runs)
    return [batch.answers[i] for i in range(len(members))]


def _attractor(u: float, start: int, record: _Record, end: Array) -> Attractor:
    """Where a motion ends, by its record."""
    turnings = record.x[-1:].copy() if record.ending == "rest" else record.turnings
    return Attractor(u, start, record.ending, record.period, turnings, end)


def _state(model: Model, start: Array) -> Array:
    """[p, p'] of coordinates at rest, (coordinates,), or of p and p' in rows, (2, moving)."""
    return start.ravel() if start.ndim == 2 else np.asarray(model.start(start, None))


def _neighbour(model: Model, run: _Run, bend: Array) -> _Run:
    """A motion that sets out beside another, towards a bend."""
    p, rate = np.split(run.state, 2)
    towards, _ = np.split(_state(model, bend), 2)
    if not towards.any():
        towards = np.ones_like(towards)
    nudged = p + NUDGE * towards / float(np.abs(towards).max())
    state = np.concatenate(model.projected(nudged, rate))
    state = state if np.isfinite(state).all() else run.state
    beside = _Run(NEIGHBOUR, run.speed, run.start, state, under_way=False)
    beside.size, beside.rate_size = run.size, run.rate_size
    return beside


def _record(t: Array, x: Array, velocity: Array, rtol: float) -> _Record:
    turnings, error = turning_points(t, x, velocity)
    # Errors of an integrator's steps add up over the ten or more that a period takes.
    error += 10.0 * rtol * float(np.ptp(x))
    return _Record(x, turnings, error, *ending_of(x, turnings, error))


def turning_points(t: Array, x: Array, velocity: Array) -> tuple[Array, float]:
    """Values of x where its velocity changes sign, in order, and by how much two may err together.

    Those of the cubics through samples. Cubics through every second sample err 16 times as much
    where x is smooth, and 8 times across the kinks of forces, so that a quarter of their difference
    bounds the errors of two values.
    """
    cubics, coarse = _cubics(t, x, velocity), _cubics(t[::2], x[::2], velocity[::2])
    _, slope, bend, rest = cubics
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -(bend + np.copysign(np.sqrt(bend**2 - 3.0 * rest * slope), bend))
        since = np.stack([slope / root, root / (3.0 * rest)], axis=1)
        since.sort(axis=1)
        within = (since >= 0.0) & (since < np.diff(t)[:, None])
    place, since = np.nonzero(within)[0], since[within]
    turnings = _values(cubics, place, since)
    pair = np.minimum(place // 2, coarse.shape[1] - 1)
    missed = _values(coarse, pair, t[place] + since - t[2 * pair]) - turnings
    return turnings, 0.25 * float(np.abs(missed).max(initial=0.0))


def _cubics(t: Array, x: Array, velocity: Array) -> Array:
    """Coefficients of the cubics between samples by the time since each, (4, S - 1)."""
    step, first, last = np.diff(t), velocity[:-1], velocity[1:]
    mean = np.diff(x) / step
    bend, rest = (3.0 * mean - 2.0 * first - last) / step, (first + last - 2.0 * mean) / step**2
    return np.stack([x[:-1], first, bend, rest])


def _values(cubics: Array, place: NDArray[np.intp], since: Array) -> Array:
    a, b, c, d = cubics[:, place]
    return np.asarray(a + since * (b + since * (c + since * d)))


def ending_of(x: Array, turnings: Array, error: float) -> tuple[Ending, int]:
    """What kind of motion the samples x of the tip and its turning points show, and its period.

    Two turning points may differ by the error although the motion repeats.
    """
    quarters = [float(np.ptp(part)) for part in np.array_split(x, 4)]
    if quarters[-1] < AT_REST:
        return "rest", 0
    highs = maxima(turnings)
    near = RECURRENCE * quarters[-1]
    approaching = all(b < a for a, b in pairwise(quarters)) and quarters[-1] < 0.8 * quarters[0]
    for period in range(1, min(LONGEST_PERIOD, highs.size // 3) + 1):
        change = np.abs(highs[period:] - highs[:-period])
        recurs = bool(change.max() < near)
        if recurs and _drift(highs, period) <= error:
            return "periodic", period
        if change.size < 4 * period:
            continue
        # A Floquet multiplier that still acts shrinks the changes by a constant factor. Near a
        # torus they may shrink for a while as well, but not twice as much in each quarter. Where
        # one acts slowly, changes are too small to be seen from one period to the next.
        changes = (float(part.max()) for part in np.array_split(change, 4))
        drifts = (_drift(part, period) if recurs else 0.0 for part in np.array_split(highs, 4))
        parts = [max(*both, error) for both in zip(changes, drifts, strict=True)]
        converges = all(b <= max(0.5 * a, error) for a, b in pairwise(parts))
        if recurs and converges:
            return "periodic", period
        approaching |= converges or (recurs and all(b < a for a, b in pairwise(parts)))
    return ("settling" if approaching else "irregular"), 0


def maxima(turnings: Array) -> Array:
    """Those of the turning points that are maxima, but for the first and the last."""
    inner = turnings[1:-1]
    return np.asarray(inner[(inner > turnings[:-2]) & (inner > turnings[2:])])


def _drift(highs: Array, period: int) -> float:
    """By how much any two maxima differ that lie whole periods apart."""
    return max(float(np.ptp(highs[k::period])) for k in range(min(period, highs.size)))


def _largest_change(highs: Array, period: int) -> float:
    return float(np.abs(highs[period:] - highs[:-period]).max())
