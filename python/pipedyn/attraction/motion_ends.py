# SPDX-License-Identifier: MIT
"""Ends of motions, from many starts, at one flow or several, as attractors that are shown.

Motions are integrated in batches and examined after ever longer stretches, by the rules in the
docstring of `attractors`. What they show is solved for: an equilibrium where a motion comes to
rest, a cycle where it comes back to an earlier state. If its eigenvalues or multipliers say that it
attracts, other motions end as soon as they reach it. Irregular motions at one flow that cannot be
told apart go on as one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from pipedyn.attraction.attractor import Attractor, Ending
from pipedyn.attraction.from_motion import solved_cycle
from pipedyn.attraction.motion_options import FIRST_LOOK, MotionOptions
from pipedyn.attraction.records import Stretch
from pipedyn.attraction.regions import (
    LONGEST_BLOCK,
    NOWHERE,
    PHASES,
    SAMPLES_A_PERIOD,
    STOPPED,
    Approach,
    ApproachTask,
    approach_outcomes,
)
from pipedyn.attraction.solutions import (
    Solution,
    by_record,
    circular_solution,
    cycle,
    equilibria_near,
    irregular_motion,
    with_separate_regions,
)
from pipedyn.equilibrium.rotating_motion import rotation_near
from pipedyn.models.base import Model, loses_energy
from pipedyn.models.chain import Chain
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.space import SpatialModel
from pipedyn.motion.integrator import Outcome, Task
from pipedyn.motion.lyapunov import LyapunovExponent, exponents_together, pooled
from pipedyn.motion.sampling import farthest_direction
from pipedyn.motion.simulate import (
    BATCH,
    LARGEST_SAMPLES,
    MotionStopped,
    assembled,
    checked_task,
    in_batches,
)
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import Progress, one_thread, parallel

MotionEnd = tuple[int, Attractor | Exception]
"""End of a motion: the number of a solution of its case, NOWHERE or STOPPED, and the attractor or
the error."""

ACROSS_KINKS = 0.1
"""Factor of rtol in the integration of motions where drag, stops or a scene's modules may have
kinks. Turnings are compared to 10 rtol of the range; over ten periods of 36 cycles, from just above
the onset to 1.5 times its speed, motions missed 0.06 of that at most without drag, but once 0.6 of
it; with drag they missed all of it at rtol, and at rtol / 10 a tenth of it, once 0.6."""

LEAST_SIZE = 1.0 / 64.0
"""Least size of a motion in the errors of its steps, which are rtol of its size where a coordinate
is smaller than the size: with rtol of each coordinate the small coordinates of fast modes, which
nobody sees, ask for 1.5 times as many right-hand sides, measured with six functions, and the tip
then errs by 1e-9 after some time instead of 1e-7."""

ROUGH_TOLERANCE = 1e-4
"""Least tolerance before the transient is over: the tip then errs by 1e-5 after some time, less
than the distance of motions that end on different solutions, in half as many right-hand sides."""

MOTIONS_A_BATCH = 1024
"""Largest number of motions of one batch, after which progress is shown."""

JOIN_SHARE = 0.4
"""Share of the transient after which motions from several starts at one flow go on as one, if they
are irregular and their turning points are spread alike. If that motion does not stay irregular, the
others go on from their own states."""

FEWEST_TURNINGS = 20
"""Least number of turning points of a motion whose distribution is compared with another one's. Of
fewer, even points without overlap may pass as one distribution."""

LATE_RECURRENCE = 0.1
"""Distance to an earlier state, relative to the motion's size, below which a cycle is solved for
after the transient; before that it is `MotionOptions.recurrence`."""

LONGEST_FACTOR = 8.0
"""Factor of the sum of transient and record for which a motion is followed that comes nearer to
something all the time: if its distance falls by a factor e in each of them, it has fallen to 3e-4
by then."""

RECORD_FACTOR = 5.0
"""Time over which an irregular motion is recorded, in durations: some hundred cycles or more."""

UNTIL_SETTLED = 10.0
"""Time in which the difference of neighbours turns to the direction of fastest growth, before an
exponent is measured: along the record of a motion, unless that is too short."""

RECORD_PARTS = 4
"""Largest number of parts, each of `RECORD_FACTOR` durations, in which an irregular motion is
recorded and its exponent measured, until the exponent or averages over the record show what it
is."""

TORUS_TOLERANCE = 1e-8
"""Largest relative tolerance of these records, whose averages may converge to that."""

LARGEST_COORDINATE = 1e3
"""Size of coordinates, in rad or of a reduced model, beyond which a motion winds up: it turns ever
faster and needs ever more steps until numbers overflow."""


def motion_ends(
    model: Model, cases: Sequence[Case], options: MotionOptions, label: str = ""
) -> list[Case]:
    """The cases, with the ends of the motions from their starts and the solutions found.

    Motions of a case are computed together, and those of several cases in one batch.

    Args:
        model: the model.
        cases: flows, with the solutions that are known and the starts at each.
        options: how motions are computed.
        label: label of the progress on stderr.
    """
    most = min(MOTIONS_A_BATCH, LARGEST_SAMPLES // (options.samples * model.coordinates))
    if options.executor is not None:  # otherwise batches are filled up and spread over threads
        most = min(BATCH, most)
    size = max(most // max((len(case.starts) for case in cases), default=1), 1)
    parts = [list(cases[i : i + size]) for i in range(0, len(cases), size)]
    found: list[Case] = []
    with Progress(label, options.shown and bool(cases)) as progress:

        def share(of_batch: float) -> None:
            progress.to((len(found) + of_batch * min(size, len(cases) - len(found))) / len(cases))

        near = progress.shown and options.executor is None  # tasks elsewhere report at their end
        given = replace(options, executor=None), share if near else None
        jobs = [partial(_batch_ends, model, part, *given) for part in parts]
        for part, answer in zip(parts, parallel(jobs, options.executor), strict=True):
            if isinstance(answer, Exception):
                for case in part:
                    case.ends = dict.fromkeys(case.starts, (STOPPED, answer))
            found += part if isinstance(answer, Exception) else answer
            share(0.0)
    return found


def _batch_ends(
    model: Model,
    cases: list[Case],
    options: MotionOptions,
    report: Callable[[float], None] | None,
) -> list[Case]:
    """The cases of one batch, with the ends of their motions.

    `report` is told the share that is done whenever motions have gone on: 1 for each motion that
    has ended, and for the others how much they have behind them of what an irregular one takes:
    transient, record and, for its exponent, a longer record.
    """
    records = 1.0 + RECORD_FACTOR * options.exponents
    longest = options.transient + records * options.duration
    runs = [_Run(case, k, start) for case in cases for k, start in case.starts.items()]

    def looked(elapsed: float) -> None:
        share = min(elapsed / longest, 1.0)
        if report is not None:
            report(sum(1.0 if run.ended else share for run in runs) / len(runs))

    with one_thread(model.dof):
        _Engine(model, options, looked).finish(runs)
    return cases


@dataclass(eq=False)
class Case:
    """A flow, the solutions that are known there, and the starts and ends of motions.

    Attributes:
        solutions: the solutions, whose regions leave out one another.
        starts: states [p, p'], (2 integrated,) each, by number.
        ends: ends of the motions, by the number of the start.
    """

    model: Model
    drive: Excitation
    solutions: Sequence[Solution] = ()
    starts: dict[int, Array] = field(default_factory=dict)
    ends: dict[int, MotionEnd] = field(default_factory=dict)

    @cached_property
    def motion(self) -> VectorField:
        """The vector field."""
        return self.drive.field(self.model)

    @cached_property
    def odd(self) -> bool:
        """Whether the mirror image of every motion is a motion; in space from z to -z."""
        return self.drive.is_odd(self.model)

    @property
    def attracting(self) -> list[int]:
        """Numbers of the solutions that motions may reach."""
        return [k for k, one in enumerate(self.solutions) if one.attracts]

    def number_at(self, state: Array, period: float) -> int:
        """Number of the solution on which a motion has ended, NOWHERE if it is unknown.

        state, period: last state and period of the motion, as for `Solution.holds`.
        """
        held = (k for k, known in enumerate(self.solutions) if known.holds(state, period))
        return next(held, NOWHERE)

    def learn(self, one: Solution) -> int:
        """Adds a solution, and its mirror image if there is one; returns the solution's number.

        If a known solution holds its last state, the number is that of the known one.
        """
        shifts, numbers = self.drive.shifts(self.model), list[int]()
        images = [one]
        if self.odd and not one.is_mirror_image(one, shifts):
            images.append(one.mirrored(shifts))
        for new in images:
            number = self.number_at(new.attractor.end, new.period)
            if number == NOWHERE:
                number = len(self.solutions)
                self.solutions = with_separate_regions([*self.solutions, new], number)
            numbers.append(number)
        return numbers[0]


def one_distribution(a: Array, b: Array) -> bool:
    """Whether two sets of values may have one distribution.

    A Kolmogorov-Smirnov test decides at 99 %, on the values and on their magnitudes: two sets about
    0, one of them much wider than the other, differ little in their values. Sets of few values
    never pass.
    """
    if min(a.size, b.size) < FEWEST_TURNINGS:
        return False

    def apart(a: Array, b: Array) -> float:
        both = np.concatenate([a, b])
        shares = [np.searchsorted(np.sort(x), both, side="right") / x.size for x in (a, b)]
        return float(np.abs(shares[0] - shares[1]).max())

    largest = max(apart(a, b), apart(np.abs(a), np.abs(b)))
    return largest < 1.63 * math.sqrt(1.0 / a.size + 1.0 / b.size)


@dataclass(eq=False)
class _Run:
    """A motion under way, with its present state and its last stretch."""

    case: Case
    start: int
    state: Array  # [p, p']
    approach: Approach = field(default_factory=Approach)  # approach to a known solution
    leader: _Run | None = None  # motion that it joined
    join_time: float = math.inf  # time from which it goes on as that motion, if it ever does
    record: Stretch = field(init=False)  # all parts of the last record, joined
    latest: Stretch = field(init=False)  # its last part
    direction: Array = field(init=False)  # in which the tip moves farthest in the record
    exponent: LyapunovExponent | None = None  # measured along the record
    tried: float = math.inf  # distance to an earlier state when a cycle was last solved for
    sizes: Array = field(init=False)  # sizes of positions and rates, for the errors of steps

    def __post_init__(self) -> None:
        self.set_sizes(*np.abs(np.split(self.state, 2)).max(axis=1).tolist())

    @property
    def ended(self) -> bool:
        """Whether the end of the motion is known."""
        return self.start in self.case.ends

    @property
    def comes_nearer(self) -> bool:
        """Whether the motion comes nearer to a known solution, to rest or to a cycle."""
        return self.is_near or self.latest.trend in ("rest", "settling")

    @property
    def is_near(self) -> bool:
        """Whether the motion ended its last stretch in the region of a known solution."""
        return self.approach.region != NOWHERE

    def set_sizes(self, span: float, fastest: float) -> None:
        """Sets the sizes by the range of its tip or coordinates and its largest rate."""
        size = min(max(span, LEAST_SIZE), 1.0)
        self.sizes = np.repeat([size, max(fastest, size)], self.state.size // 2)

    def end(self, number: int) -> None:
        """Notes that the motion ends on a solution of its case."""
        attractor = self.case.solutions[number].attractor
        self.case.ends[self.start] = number, replace(attractor, start=self.start)


class _Engine:
    """Follows the motions of one batch until they end."""

    def __init__(
        self, model: Model, options: MotionOptions, looked: Callable[[float], None] = lambda _: None
    ) -> None:
        self.model, self.options, self.elapsed = model, options, 0.0
        self.looked = looked  # called with the elapsed time whenever motions have gone on
        smooth = isinstance(model, (Chain, Galerkin)) and not model.pipe.has_kinks
        self.tolerance = options.rtol * (1.0 if smooth else ACROSS_KINKS)

    # ----------------------------------------------------------------------------- integration

    def advance(
        self, runs: list[_Run], rtol: float, before: float, length: float, on: bool = False
    ) -> list[_Run]:
        """Integrates for a time, then records for another; returns the motions that have not ended.

        If motions are driven, both times are whole periods of the drive.

        Args:
            runs: motions that have not ended.
            rtol: relative tolerance.
            before: time before the record.
            length: time that is recorded.
            on: whether it prolongs the last record, which had the same length.
        """
        if not runs:
            return []
        drive = runs[0].case.drive
        count = self.options.samples_of(length)
        if drive.period:  # states are compared at PHASES times in each period
            whole = PHASES * round(length / drive.period)
            count = whole * max(math.ceil((count - 1) / whole), 1) + 1
        samples = before + np.linspace(0.0, length, count)
        p, rates = np.split(runs[0].state, 2)
        first = checked_task(
            *(self.model, drive.u, before + length, p, rates),
            times=samples,
            rtol=rtol,
            base=drive.base,
            forces=drive.forces,
            members=len(runs),
            most=self.options.most,
        )
        first = ApproachTask(**vars(replace(first, farthest=LARGEST_COORDINATE)))
        shared = {case: _in_case(first, case, length) for case in {run.case for run in runs}}
        tasks = [
            replace(shared[run.case], start=run.state, approach=run.approach, atol=rtol * run.sizes)
            for run in runs
        ]
        # Each thread takes a batch; in larger batches a member of a chain's batch costs less.
        members = BATCH if self.model.linear_cost else BATCH // 2
        done = 0

        def note(some: list[int], answers: list[tuple[Outcome, Approach]]) -> None:
            nonlocal done
            for i, (outcome, approach) in zip(some, answers, strict=True):
                run = runs[i]
                run.approach = approach
                if outcome[2] is not None:
                    run.case.ends[run.start] = STOPPED, self.error(run, tasks[i], outcome)
                elif approach.reached:
                    run.end(run.case.attracting[approach.region])
            done += len(some)
            self.looked(self.elapsed + (before + length) * done / len(tasks))

        found = in_batches(tasks, approach_outcomes, members, note)
        self.elapsed += before + length
        going = [i for i, run in enumerate(runs) if not run.ended]
        if not going:
            return []
        rows = np.concatenate([found[i][0][0][1:] for i in going])
        q, qdot = self.model.to_user(*np.split(rows, 2, axis=1))
        tips, velocities = self.model.tips(q.T), self.model.tip_velocities(q.T, qdot.T)
        for k, i in enumerate(going):
            run, part, last = runs[i], slice(k * count, (k + 1) * count), (k + 1) * count - 1
            run.state = self.model.from_user(q[last, None], qdot[last, None])[0]
            sampled = samples - before, rows[part], tips[part], velocities[part]
            given = run.case, max(self.options.rtol, rtol), *sampled
            farthest = farthest_direction(tips[part][count // 2 :])
            run.latest = _seen_along(farthest, *given)
            if on:
                # The plane of a motion may turn: along its record's direction it may seem to rest.
                run.record = run.record.joined(_seen_along(run.direction, *given))
            else:
                run.record, run.direction = run.latest, farthest
            extent, fastest = np.ptp(run.latest.x), np.abs(run.latest.velocity).max()
            run.set_sizes(float(extent), float(fastest))
        return [runs[i] for i in going]

    def error(self, run: _Run, task: Task, outcome: Outcome) -> MotionStopped:
        """The error of a motion that stopped, with its start and the time since the start."""
        [(motion, _)] = assembled([task], [outcome])
        reached = self.elapsed + float(motion.t[-1] if motion.t.size else 0.0)
        report = f"the motion from start {run.start} stopped after t = {reached:g}: {outcome[2]}"
        return MotionStopped(report, motion)

    # -------------------------------------------------------------------- results of a stretch

    def solve(self, runs: list[_Run]) -> None:
        """Solves for the equilibria and cycles that motions show, on which they may end.

        Before the transient is over a cycle is solved for from the motion that has come nearest to
        an earlier state, if that is very near; afterwards from each, and from farther away. After
        a try, an irregular motion must come back twice as near before the next one.
        """
        late = self.elapsed > self.options.transient
        farthest = LATE_RECURRENCE if late else self.options.recurrence
        for case in dict.fromkeys(run.case for run in runs):
            own = [run for run in runs if run.case is case]
            if not case.drive.period:
                rests = [run.state for run in own if run.latest.trend == "rest"]
                places = [np.split(state, 2)[0] for state in rests]
                for one in equilibria_near(self.model, places, case.drive.mean):
                    case.learn(one)
            tries = [run for run in own if run.latest.trend != "rest"]
            tries.sort(key=lambda run: run.record.recurrence[0])
            for run in tries if late else tries[:1]:
                back = run.record.recurrence[0]
                if run.latest.trend == "irregular" and back > 0.5 * run.tried:
                    continue
                run.tried = back if back <= farthest else run.tried
                with suppress(NewtonFailed):
                    one = self.solved(run, farthest)
                    number = case.learn(one)
                    if one.attracts and case.solutions[number].contains(run.state[None]):
                        run.end(number)

    def solved(self, run: _Run, farthest: float) -> Solution:
        """The circular motion or the cycle that a motion shows; NewtonFailed if there is none."""
        drive = run.case.drive
        if self.model.axisymmetric and not drive.period:
            with suppress(NewtonFailed):
                return circular_solution(
                    self.model, rotation_near(self.model, run.state, drive.mean)
                )
        return cycle(self.model, drive, *solved_cycle(self.model, drive, run.record, farthest))

    def join(self, irregular: list[_Run]) -> list[_Run]:
        """The irregular motions that from now on go on as another one of their case.

        Each motion joins one other at most: if that does not stay irregular, it goes on by itself.
        """
        joining, others = list[_Run](), list[_Run]()
        for run in irregular:
            if not loses_energy(self.model, run.case.drive.mean):
                continue
            same = [one for one in others if one.case is run.case and run.leader is None]
            alike = (one for one in same if self.look_alike(one.record, run.record))
            leader = next(alike, None)
            if leader is None:
                others.append(run)
            else:
                run.leader, run.join_time = leader, self.elapsed
                joining.append(run)
        return joining

    def look_alike(self, one: Stretch, other: Stretch) -> bool:
        """Whether turning points, and in space turns about the axis, may have one distribution."""
        turn = self.model.dimensions == 2 or one_distribution(one.turns, other.turns)
        return turn and one_distribution(one.turnings, other.turnings)

    def finish(self, every: list[_Run]) -> None:
        """Follows motions until they end."""
        options, drive, runs = self.options, every[0].case.drive, every
        longest = max(FIRST_LOOK, 0.5 * options.duration)
        while runs:
            length = drive.whole(min(max(FIRST_LOOK, 0.5 * self.elapsed), longest))
            if self.elapsed + length > options.transient:
                break
            runs = self.advance(runs, max(self.tolerance, ROUGH_TOLERANCE), 0.0, length)
            # The other motions will soon have reached the solution that they come nearer to.
            self.solve([run for run in runs if not run.is_near])
            runs = [run for run in runs if not run.ended]
            if self.elapsed >= JOIN_SHARE * options.transient:
                far = [run for run in runs if not run.is_near]
                joining = self.join([run for run in far if run.latest.trend == "irregular"])
                runs = [run for run in runs if run not in joining]
        self.finish_late(runs)
        again = list[_Run]()
        # The last to join comes first: a motion that another joined may itself have joined a third
        # one later, and go on by itself.
        joined = [run for run in every if not run.ended]
        for run in sorted(joined, key=lambda run: run.join_time, reverse=True):
            leader = run.leader.start if run.leader else run.start
            number, end = run.case.ends.get(leader, (NOWHERE, None))
            if isinstance(end, Attractor) and not end.repeats:
                run.case.ends[run.start] = number, replace(end, start=run.start)
            else:
                again.append(run)
        for time in sorted({run.join_time for run in again}):
            self.elapsed = time
            self.finish([run for run in again if run.join_time == time])

    # ----------------------------------------------------------------------- after the transient

    def finish_late(self, runs: list[_Run]) -> None:
        """Records motions, follows further those that come nearer to something, names the others.

        Of motions of a case whose turning points are spread alike the first is recorded for longer,
        if exponents are asked for, and named.
        """
        options, duration = self.options, self.options.duration
        last = LONGEST_FACTOR * (options.transient + duration)
        while runs:
            before, drive = max(options.transient - self.elapsed, 0.0), runs[0].case.drive
            over = self.elapsed + before + duration >= last
            left, runs = self.classify(self.advance(runs, self.tolerance, before, duration), over)
            joining = self.join(left)
            left = [run for run in left if run not in joining]
            length = drive.whole(RECORD_FACTOR * duration)
            for part in range(RECORD_PARTS):
                if options.exponents:
                    given = min(self.tolerance, TORUS_TOLERANCE), 0.0, length, part > 0
                    left, on = self.classify(self.advance(left, *given), over)
                    runs += on
                left = self.name(left, part)

    def classify(self, runs: list[_Run], over: bool) -> tuple[list[_Run], list[_Run]]:
        """Motions to be named, and motions that go on, after a record of motions.

        Motions go on that come nearer to something, unless the time for this is `over`.
        """
        self.solve([run for run in runs if over or not run.is_near])
        going = [run for run in runs if not run.ended and not self.is_on_known(run, over)]
        nearer = [run for run in going if run.comes_nearer and not over]
        return [run for run in going if run not in nearer], nearer

    def is_on_known(self, run: _Run, over: bool) -> bool:
        """Whether a motion ends at rest or on a cycle, as its record shows.

        Rest or cycle may be unstable, and the cycle may be one that cannot be solved for. A motion
        beside an unstable equilibrium, however near, is given time to leave it. A motion that
        creeps far from any equilibrium does not rest.
        """
        case, drive = run.case, run.case.drive
        rests = run.latest.trend == "rest"
        period = 0.0 if rests else run.latest.period or run.record.period
        if not rests and not period:
            return False
        number = case.number_at(run.state, period)
        if number == NOWHERE and rests and not drive.period:
            return False
        if number == NOWHERE:
            seen = by_record(self.model, drive, run.state, run.record, period)
            number = case.learn(self.by_trials(case, seen))
        known = case.solutions[number]
        left = float(np.abs(run.state - known.attractor.end).max())
        if rests and not known.attracts and left > 0.0 and not over:
            return False
        run.end(number)
        return True

    def by_trials(self, case: Case, one: Solution) -> Solution:
        """A solution whose eigenvalues or multipliers are not known, tested whether it attracts.

        It does if all motions from states beside it, in all directions, come to it.
        """
        trial = Case(self.model, case.drive, [replace(one, attracts=True)])
        engine, states = _Engine(self.model, self.options), one.region.states_beside(self.model)
        runs = [_Run(trial, k, state) for k, state in enumerate(states)]
        length = case.drive.whole(max(FIRST_LOOK, 0.25 * self.options.transient))
        while runs and engine.elapsed < self.options.transient:
            runs = engine.advance(runs, engine.tolerance, 0.0, length)
        attracts = not runs and all(number == 0 for number, _ in trial.ends.values())
        return replace(one, attracts=attracts)

    def name(self, runs: list[_Run], part: int) -> list[_Run]:
        """Names motions by exponents and records; returns those that need longer records.

        part: number of the last part of the record. The exponent is that of all parts, but for the
            first if there are several, as the motion may not have settled in it.
        """
        exponents: dict[_Run, LyapunovExponent | MotionStopped] = {}
        irregular = [run for run in runs if not run.comes_nearer]
        duration = (2.0 if part == 0 else 4.0) * self.options.duration
        if self.options.exponents and irregular:
            drive, t = irregular[0].case.drive, irregular[0].latest.t
            every = round(drive.whole(0.5) / float(t[1]))
            long = float(t[-1]) >= UNTIL_SETTLED + duration
            measured = exponents_together(
                self.model,
                [run.case.drive.u for run in irregular],
                [
                    run.latest.states[(t.size - 1) % every :: every] if long else run.state
                    for run in irregular
                ],
                duration,
                UNTIL_SETTLED,
                interval=every * float(t[1]),
                base=drive.base,
                forces=drive.forces,
                driven=bool(drive.period),
            )
            for run, found in zip(irregular, measured, strict=True):
                exponents[run] = found
                if isinstance(found, LyapunovExponent):
                    if part > 1 and run.exponent is not None:
                        exponents[run] = found = pooled(run.exponent, found)
                    run.exponent = found
        doubtful = list[_Run]()
        for run in runs:
            exponent, drive = exponents.get(run), run.case.drive
            ending: Ending = "unsettled"
            why = ""
            # Differences that grow in proportion to the time, as between motions on a torus that go
            # round or turn about the axis at different rates, pretend to this exponent.
            turns, shear, largest = run.case.motion.axisymmetric, 0.0, 0.0
            if isinstance(exponent, LyapunovExponent):
                shear = math.log(exponent.duration) / exponent.duration
                # Rates of turning about the axis differ by little, with hardly any spread.
                largest = shear if turns else min(exponent.spread, shear)
            if isinstance(exponent, MotionStopped):
                why = f"its largest Lyapunov exponent is not known: {exponent}"
                exponent = None
            elif run.comes_nearer:
                why = f"it still comes nearer to rest or a cycle after t = {self.elapsed:g}"
            elif exponent is None:
                ending = "irregular"
            elif exponent.chaotic and exponent.value > shear * turns:
                ending = "chaotic"
            elif exponent.value <= largest and run.record.averages_converge():
                ending = "quasi-periodic"
            elif part + 1 < RECORD_PARTS:
                doubtful.append(run)
                continue
            else:
                why = (
                    f"neither its largest Lyapunov exponent, {exponent.value:.2g} with a spread of "
                    f"{exponent.spread:.2g}, shows chaos, nor do averages over a time of "
                    f"{run.record.t[-1]:g} show a torus"
                )
            turnings = run.record.turnings
            end = Attractor(drive.mean, run.start, ending, 0, turnings, run.state, exponent, why)
            number = NOWHERE
            if not why:
                number = run.case.learn(irregular_motion(self.model, drive, end, run.record))
            run.case.ends[run.start] = number, end
        return doubtful


def _seen_along(
    direction: Array, case: Case, rtol: float, t: Array, states: Array, tips: Array, rates: Array
) -> Stretch:
    """A stretch of a motion, with positions and rates of the free end in a direction.

    If a turn about the axis changes nothing, states are turned so that the direction is x.
    """
    turns = case.motion.axisymmetric
    if isinstance(case.model, SpatialModel) and turns:
        angle = math.atan2(direction[2], direction[0])
        states = np.ascontiguousarray(case.model.turned(states.T, -angle).T)
    return Stretch(t, states, tips @ direction, rates @ direction, rtol, case.drive.period, turns)


def _in_case(task: ApproachTask, case: Case, length: float) -> ApproachTask:
    """A task of a motion that is recorded for a time, with the flow and the regions of its case."""
    if not task.drive:
        task = replace(task, u=case.drive.mean)
    regions = tuple(case.solutions[k].region for k in case.attracting)
    if not regions:
        return task
    periods, drive = [region.period for region in regions], case.drive.period
    longest, sample = max(periods), length / (task.times.size - 1)
    step = drive / PHASES or max(min(periods) / SAMPLES_A_PERIOD, longest / LONGEST_BLOCK)
    every = max(round(step / sample), 1)
    block = np.arange(math.ceil(longest / (every * sample) - 1e-6))
    return replace(task, regions=regions, every=every, phases=case.drive.phases(step * block))
