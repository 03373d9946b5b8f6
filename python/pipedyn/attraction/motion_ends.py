# SPDX-License-Identifier: MIT
"""Ends of motions, from many starts, at one flow or several, as attractors that are shown.

Motions are integrated in batches and examined after ever longer stretches. A motion that has
reached a known solution ends. A motion that comes to rest, or back to an earlier state, shows where
to look for an equilibrium or a cycle: that is solved for, and if its eigenvalues or multipliers say
that it attracts, it is known from then on. A motion that neither rests nor repeats after the
transient is followed on as long as it comes nearer to something; otherwise it is chaotic if its
exponent is positive, quasi-periodic if averages converge as they do only on a torus, or unsettled,
with the reason. Irregular motions at one flow that cannot be told apart go on as one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

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
    WatchedTask,
    watched_outcomes,
)
from pipedyn.attraction.solutions import (
    Solution,
    by_record,
    cycle,
    equilibrium,
    irregular,
    kept_apart,
)
from pipedyn.equilibrium.equilibria import Statics
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.galerkin import Galerkin
from pipedyn.motion.integrator import Outcome, Task
from pipedyn.motion.lyapunov import LyapunovExponent, exponents_together
from pipedyn.motion.simulate import (
    BATCH,
    LARGEST_SAMPLES,
    MotionStopped,
    assembled,
    checked_task,
    in_batches,
)
from pipedyn.motion.vector_field import Excitation
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread, parallel

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

TOGETHER = 1024
"""Largest number of motions of one batch, after which progress is shown."""

JOINED = 0.25
"""Share of the transient after which motions from several starts at one flow go on as one, if they
are irregular and their turning points were spread alike at two consecutive looks. If that motion
does not stay irregular, the others go on from their own states."""

FAR_BACK = 0.1
"""Distance to an earlier state, relative to the motion's size, below which a cycle is solved for
after the transient; before that it is `MotionOptions.back`."""

FOLLOWED = 8.0
"""Factor of the sum of transient and record for which a motion is followed that comes nearer to
something all the time: if its distance falls by a factor e in each of them, it has fallen to 3e-4
by then."""

RECORDED = 5.0
"""Time over which an irregular motion is recorded, in durations: some hundred cycles or more."""

LONGER = 1.0, 2.0, 4.0
"""Factors of the usual time for which a motion is recorded and its exponent measured, one after the
other, until the exponent or averages over the record show what the motion is."""

TORUS = 1e-8
"""Largest relative tolerance of these records, whose averages may converge to that."""

WOUND = 1e3
"""Size of coordinates, in rad or of a reduced model, beyond which a motion winds up: it turns ever
faster and needs ever more steps until numbers overflow."""

HALVINGS = 5
"""Number of times that a region is halved if trial motions do not all come nearer."""


def motion_ends(
    model: Model, cases: Sequence[Case], options: MotionOptions, label: str = ""
) -> tuple[list[dict[int, MotionEnd]], list[Case]]:
    """Ends of motions from the starts of each case, and the cases with the solutions found.

    Motions of a case are computed together, and those of several cases in one batch.

    Args:
        model: the model.
        cases: flows, with the solutions that are known and the starts at each.
        options: how motions are computed.
        label: label of the progress on stderr.
    """
    most = min(TOGETHER, LARGEST_SAMPLES // (options.samples * model.coordinates))
    if options.executor is not None:  # otherwise batches are filled up and spread over threads
        most = min(BATCH, most)
    size = max(most // max((len(case.starts) for case in cases), default=1), 1)
    parts = [list(cases[i : i + size]) for i in range(0, len(cases), size)]
    jobs = [partial(_ends_of, model, part, replace(options, executor=None)) for part in parts]
    answers = parallel(jobs, options.executor, label=label, progress=options.shown)
    found: list[dict[int, MotionEnd]] = []
    known: list[Case] = []
    for part, answer in zip(parts, answers, strict=True):
        if isinstance(answer, Exception):
            found += [dict.fromkeys(case.starts, (STOPPED, answer)) for case in part]
            known += part
        else:
            found += answer[0]
            known += answer[1]
    return found, known


def _ends_of(
    model: Model, cases: list[Case], options: MotionOptions
) -> tuple[list[dict[int, MotionEnd]], list[Case]]:
    """Ends of the motions of one batch, by case."""
    engine, runs = _Engine(model, options), list[_Run]()
    with one_thread(model.dof):
        for case in cases:
            for k, start in case.starts.items():
                if start.ndim == 1:
                    start = np.asarray(model.initial_state(start, None))
                runs.append(_Run(case, k, start.ravel()))
        engine.finish(runs)
    ends = [{run.start: engine.answers[run] for run in runs if run.case is one} for one in cases]
    return ends, cases


@dataclass(eq=False)
class Case:
    """A flow, the solutions that are known there, and the starts of motions.

    Attributes:
        starts: coordinates at rest, or p and p' in rows, (2, integrated), by number.
    """

    model: Model
    drive: Excitation
    solutions: Sequence[Solution] = ()
    starts: dict[int, Array] = field(default_factory=dict)

    @cached_property
    def odd(self) -> bool:
        """Whether the mirror image of every motion is a motion."""
        return self.drive.is_odd(self.model)

    @property
    def attracting(self) -> list[int]:
        """Numbers of the solutions that motions may reach."""
        return [k for k, one in enumerate(self.solutions) if one.attracts]

    def holding(self, state: Array, period: float) -> int:
        """Number of the solution on which a motion has ended, NOWHERE if it is unknown.

        Args:
            state: the last state [p, p'] of the motion, (2 integrated,).
            period: time after which the motion was seen to repeat, 0 at rest, NaN if irregular.
        """
        held = (k for k, known in enumerate(self.solutions) if known.holds(state, period))
        return next(held, NOWHERE)

    def learn(self, one: Solution) -> int:
        """Adds a solution, and its mirror image if there is one; returns the solution's number.

        If a known solution holds its last state, the number is that of the known one.
        """
        shifts, numbers = self.drive.shifts, list[int]()
        images = [one]
        if self.odd and not one.is_mirror_image(one, shifts):
            images.append(one.mirrored(shifts))
        for new in images:
            number = self.holding(new.attractor.end, new.period)
            if number == NOWHERE:
                number = len(self.solutions)
                self.solutions = kept_apart([*self.solutions, new])
            numbers.append(number)
        return numbers[0]


def spread_alike(a: Array, b: Array) -> bool:
    """Whether two sets of values may have one distribution.

    A Kolmogorov-Smirnov test decides at 99 %; a set of less than two values never passes.
    """
    if min(a.size, b.size) < 2:
        return False
    a, b = np.sort(a), np.sort(b)
    both = np.concatenate([a, b])
    shares = (np.searchsorted(x, both, side="right") / x.size for x in (a, b))
    apart = float(np.abs(next(shares) - next(shares)).max())
    return apart < 1.63 * math.sqrt(1.0 / a.size + 1.0 / b.size)


@dataclass(eq=False)
class _Run:
    """A motion under way, with its present state and its last stretch."""

    case: Case
    start: int
    state: Array  # [p, p']
    approach: Approach = field(default_factory=Approach)  # approach to a known solution
    like: _Run | None = None  # motion whose turning points were spread alike at the last look
    alone: bool = False  # whether it does not join another
    record: Stretch = field(init=False)
    size: float = field(init=False)  # range of the motion, in [LEAST_SIZE, 1]
    rate_size: float = field(init=False)  # largest rate, at least the size

    def __post_init__(self) -> None:
        self.resized(*np.abs(np.split(self.state, 2)).max(axis=1).tolist())

    @property
    def comes_nearer(self) -> bool:
        """Whether the motion comes nearer to a known solution, to rest or to a cycle."""
        return self.is_near or self.record.trend in ("rest", "settling")

    @property
    def is_near(self) -> bool:
        """Whether the motion ended its last stretch in the region of a known solution."""
        return self.approach.region != NOWHERE

    def resized(self, span: float, fastest: float) -> None:
        """Sets the sizes by the range of its tip or coordinates and its largest rate."""
        self.size = min(max(span, LEAST_SIZE), 1.0)
        self.rate_size = max(fastest, self.size)


class _Engine:
    """The motions of one batch, and the ends of those that have ended."""

    def __init__(self, model: Model, options: MotionOptions) -> None:
        self.model, self.options, self.elapsed = model, options, 0.0
        self.joined: list[tuple[_Run, _Run, float]] = []  # a motion, the one joined, and when
        self.answers: dict[_Run, MotionEnd] = {}
        self.statics = Statics(model)
        smooth = isinstance(model, (Chain, Galerkin)) and not model.pipe.has_kinks
        self.tolerance = options.rtol * (1.0 if smooth else ACROSS_KINKS)

    # ----------------------------------------------------------------------------- integration

    def advance(self, runs: list[_Run], rtol: float, before: float, recorded: float) -> list[_Run]:
        """Integrates for a time, then records for another; returns the motions that have not ended.

        If motions are driven, both times are whole periods of the drive. rtol: relative tolerance.
        """
        if not runs:
            return []
        drive = runs[0].case.drive
        count = self.options.samples_of(recorded)
        if drive.period:  # states are compared at PHASES times in each period
            whole = PHASES * round(recorded / drive.period)
            count = whole * max(math.ceil((count - 1) / whole), 1) + 1
        samples = before + np.linspace(0.0, recorded, count)
        p, rates = np.split(runs[0].state, 2)
        first = checked_task(
            *(self.model, drive.u, before + recorded, p, rates),
            times=samples,
            rtol=rtol,
            base=drive.base,
            members=len(runs),
            most=self.options.most,
        )
        of_all = WatchedTask(**vars(first))
        rules = {case: self.judged(case, recorded, count) for case in {run.case for run in runs}}
        tasks = [
            replace(
                of_all,
                farthest=WOUND,
                u=first.u if first.drive else run.case.drive.mean,
                start=run.state,
                **rules[run.case],
                approach=run.approach,
                atol=first.rtol * np.repeat([run.size, run.rate_size], run.state.size // 2),
            )
            for run in runs
        ]
        # Each thread takes a batch; in larger batches a member of a chain's batch costs less.
        members = BATCH if self.model.linear_cost else BATCH // 2
        found = in_batches(tasks, watched_outcomes, members=members)
        for run, task, (outcome, label, approach) in zip(runs, tasks, found, strict=True):
            run.approach = approach
            if outcome[2] is not None:
                self.answers[run] = STOPPED, self.stopped(run, task, outcome)
            elif label != NOWHERE:
                self.ends(run, run.case.attracting[label])
        self.elapsed += before + recorded
        going = [i for i, run in enumerate(runs) if run not in self.answers]
        if not going:
            return []
        rows = np.concatenate([found[i][0][0][1:] for i in going])
        q, qdot = self.model.to_user(*np.split(rows, 2, axis=1))
        x, velocity = self.model.tips(q.T)[:, 0], self.model.tip_velocities(q.T, qdot.T)[:, 0]
        for k, i in enumerate(going):
            part, last = slice(k * count, (k + 1) * count), (k + 1) * count - 1
            runs[i].state = self.model.from_user(q[last, None], qdot[last, None])[0]
            runs[i].resized(float(np.ptp(x[part])), float(np.abs(velocity[part]).max()))
            motion = samples - before, rows[part], x[part], velocity[part]
            runs[i].record = Stretch(*motion, max(self.options.rtol, rtol), drive.period)
        return [runs[i] for i in going]

    def judged(self, case: Case, recorded: float, count: int) -> dict[str, Any]:
        """Fields of a task that tell whether a motion has reached a known solution."""
        regions = tuple(case.solutions[k].region for k in case.attracting)
        if not regions:
            return {}
        sample, drive = recorded / (count - 1), case.drive.period
        periods = [region.period for region in regions]
        longest = max(periods)
        step = min(max(min(periods) / SAMPLES_A_PERIOD, longest / LONGEST_BLOCK), recorded)
        step = drive / PHASES if drive else step
        every = max(round(step / sample), 1)
        block = np.arange(math.ceil(longest / (every * sample) - 1e-6))
        return {"regions": regions, "every": every, "phases": case.drive.phases(step * block)}

    def stopped(self, run: _Run, task: Task, outcome: Outcome) -> MotionStopped:
        """The error of a motion that stopped, with its start and the time since the start."""
        [(motion, _)] = assembled([task], [outcome])
        reached = self.elapsed + float(motion.t[-1] if motion.t.size else 0.0)
        report = f"the motion from start {run.start} stopped after t = {reached:g}: {outcome[2]}"
        return MotionStopped(report, motion)

    def ends(self, run: _Run, number: int) -> None:
        """Notes that a motion ends on a solution of its case."""
        end = run.case.solutions[number].attractor
        self.answers[run] = number, replace(end, start=run.start)

    # -------------------------------------------------------------------- results of a stretch

    def explain(self, runs: list[_Run]) -> list[Case]:
        """Solves for what motions show; returns cases in which an attracting solution is new.

        Before the transient is over a cycle is solved for from the motion that has come nearest to
        an earlier state, if that is very near; afterwards from each, and from farther away.
        """
        new, late = list[Case](), self.elapsed > self.options.transient
        back = FAR_BACK if late else self.options.back
        for case in dict.fromkeys(run.case for run in runs):
            before, u = len(case.attracting), case.drive.mean
            tries = list[_Run]()
            for run in (run for run in runs if run.case is case):
                if run.record.trend != "rest":
                    tries.append(run)
                elif not case.drive.period:
                    place = np.split(run.state, 2)[0]
                    with suppress(NewtonFailed):  # e.g. where a slow motion passes no equilibrium
                        case.learn(equilibrium(self.statics, self.statics.solved(place, u), u))
            tries.sort(key=lambda run: run.record.recurrence[0])
            for run in tries if late else tries[:1]:
                self.solve_for_cycle(run, back)
            if len(case.attracting) > before:
                new.append(case)
        return new

    def solve_for_cycle(self, run: _Run, back: float) -> None:
        """Solves for the cycle near the end of a motion, which ends if it is on that cycle.

        back: largest distance to an earlier state, as for `solved_cycle`.
        """
        case = run.case
        with suppress(NewtonFailed):
            orbit, stable = solved_cycle(self.model, case.drive, run.record, back)
            number = case.learn(cycle(self.model, case.drive, orbit, stable))
            known = case.solutions[number]
            if stable and np.isfinite(known.region.distances(run.state[None], known.near)):
                self.ends(run, number)

    def joining(self, irregular: list[_Run], twice: bool) -> list[_Run]:
        """The irregular motions that from now on go on as another motion of their case.

        twice: whether turning points must be spread alike at two consecutive looks, see `JOINED`.
        """
        first = list[_Run]()  # motions with which the others are compared
        before = len(self.joined)
        for run in irregular:
            others = [one for one in first if one.case is run.case and not run.alone]
            turnings, last = run.record.turnings, run.like
            alike = (one for one in others if spread_alike(one.record.turnings, turnings))
            run.like = next(alike, None)
            if run.like is None:
                first.append(run)
            elif not twice or (
                run.like is last and self.elapsed >= JOINED * self.options.transient
            ):
                self.joined.append((run, run.like, self.elapsed))
        return [run for run, _, _ in self.joined[before:]]

    def finish(self, runs: list[_Run]) -> None:
        """Follows motions until they end."""
        options, drive = self.options, runs[0].case.drive
        longest = max(FIRST_LOOK, 0.5 * options.duration)
        while runs:
            stretch = drive.whole(min(max(FIRST_LOOK, 0.5 * self.elapsed), longest))
            if self.elapsed + stretch > options.transient:
                break
            runs = self.advance(runs, max(self.tolerance, ROUGH_TOLERANCE), 0.0, stretch)
            # The other motions will soon have reached the solution that they come nearer to.
            unknown = [run for run in runs if not run.is_near]
            self.explain(unknown)
            joined = self.joining([run for run in unknown if run.record.trend == "irregular"], True)
            runs = [run for run in runs if run not in self.answers and run not in joined]
        self.after_transient(runs)
        followed, self.joined = self.joined, []
        again: list[tuple[_Run, float]] = []
        # In reverse order: the motion that another joined may itself have joined a third one later,
        # and go on by itself.
        for run, other, since in reversed(followed):
            number, end = self.answers.get(other, (NOWHERE, None))
            if isinstance(end, Attractor) and end.ending not in ("rest", "periodic"):
                self.answers[run] = number, replace(end, start=run.start)
            else:
                run.alone = True
                again.append((run, since))
        for since in sorted({since for _, since in again}):
            self.elapsed = since
            self.finish([run for run, at in again if at == since])

    # ----------------------------------------------------------------------- after the transient

    def after_transient(self, runs: list[_Run]) -> None:
        """Records motions, follows further those that come nearer to something, names the others.

        Of motions of a case whose turning points are spread alike the first is recorded for longer,
        if exponents are asked for, and named.
        """
        options, duration = self.options, self.options.duration
        while runs:
            before, drive = max(options.transient - self.elapsed, 0.0), runs[0].case.drive
            last = FOLLOWED * (options.transient + duration)
            over = self.elapsed + before + duration >= last
            left, runs = self.recorded(runs, over, self.tolerance, before, duration)
            joined = self.joining(left, False)
            left = [run for run in left if run not in joined]
            for times in LONGER:
                if options.exponents:
                    length = drive.whole(RECORDED * times * duration)
                    left, on = self.recorded(left, over, min(self.tolerance, TORUS), 0.0, length)
                    runs += on
                left = self.named(left, times)

    def recorded(
        self, runs: list[_Run], over: bool, *record: float
    ) -> tuple[list[_Run], list[_Run]]:
        """Motions to be named, and motions that go on, after a record of motions.

        Motions go on that come nearer to something or may come to a solution that is new.

        Args:
            runs: the motions.
            over: whether no motion may go on.
            record: tolerance, time before the record and time recorded, as for `advance`.
        """
        runs = self.advance(runs, *record)
        new = self.explain([run for run in runs if over or not run.is_near])
        left, on = list[_Run](), list[_Run]()
        for run in runs:
            if run in self.answers or self.is_on_known(run, over):
                continue
            if (run.case in new or run.comes_nearer) and not over:
                on.append(run)
            else:
                left.append(run)
        return left, on

    def is_on_known(self, run: _Run, over: bool) -> bool:
        """Whether a motion ends at rest or on a cycle, as its record shows.

        Rest or cycle may be unstable, and the cycle may be one that cannot be solved for. A motion
        beside an unstable equilibrium, however near, is given time to leave it. A motion that
        creeps far from any equilibrium does not rest.
        """
        case, drive = run.case, run.case.drive
        rests = run.record.trend == "rest"
        period = 0.0 if rests else run.record.period
        if not rests and not period:
            return False
        number = case.holding(run.state, period)
        if number == NOWHERE and rests and not drive.period:
            return False
        if number == NOWHERE:
            seen = by_record(self.model, drive, run.state, run.record, period)
            number = case.learn(self.attracted(case, seen))
        known = case.solutions[number]
        left = float(np.abs(run.state - known.attractor.end).max())
        if rests and not known.attracts and left > 0.0 and not over:
            return False
        self.ends(run, number)
        return True

    def attracted(self, case: Case, one: Solution) -> Solution:
        """A solution, with the region that it attracts found by motions from beside it.

        The motions begin in all directions. This serves solutions whose eigenvalues or multipliers
        are not known.
        """
        for halved in range(HALVINGS + 1):
            region = replace(one.region, radius=one.region.radius * 0.5**halved)
            tried = replace(one, region=region, attracts=True)
            trial, engine = Case(self.model, case.drive, [tried]), _Engine(self.model, self.options)
            beside = region.beside(self.model)
            runs = [_Run(trial, k, state) for k, state in enumerate(beside)]
            stretch = case.drive.whole(max(FIRST_LOOK, 0.25 * self.options.transient))
            while runs and engine.elapsed < self.options.transient:
                runs = engine.advance(runs, engine.tolerance, 0.0, stretch)
            if not runs and all(number == 0 for number, _ in engine.answers.values()):
                return tried
        return one

    def named(self, some: list[_Run], times: float) -> list[_Run]:
        """Names motions by exponents and records; returns those that need longer records.

        times: factor of the usual time over which an exponent is measured.
        """
        for run in (run for run in some if run.comes_nearer):
            why = f"it still comes nearer to rest or a cycle after t = {self.elapsed:g}"
            self.name(run, "unsettled", reason=why)
        some = [run for run in some if not run.comes_nearer]
        states = [(run.case.drive, run.state) for run in some]
        duration, doubtful = times * self.options.duration, list[_Run]()
        exponents = exponents_of(self.model, states, replace(self.options, duration=duration))
        for run, exponent in zip(some, exponents, strict=True):
            if exponent is None:
                self.name(run, "irregular")
            elif isinstance(exponent, MotionStopped):
                why = f"its largest Lyapunov exponent is not known: {exponent}"
                self.name(run, "unsettled", reason=why)
            elif exponent.chaotic:
                self.name(run, "chaotic", exponent)
            elif exponent.value <= exponent.spread and run.record.averages_converge():
                self.name(run, "quasi-periodic", exponent)
            elif times < LONGER[-1]:
                doubtful.append(run)
            else:
                why = (
                    f"neither its largest Lyapunov exponent, {exponent.value:.2g} with a spread of "
                    f"{exponent.spread:.2g}, shows chaos, nor do averages over a time of "
                    f"{run.record.t[-1]:g} show a torus"
                )
                self.name(run, "unsettled", exponent, why)
        return doubtful

    def name(
        self,
        run: _Run,
        ending: Ending,
        exponent: LyapunovExponent | None = None,
        reason: str = "",
    ) -> None:
        """Names the ending of a motion from its record."""
        drive, turnings, number = run.case.drive, run.record.turnings, NOWHERE
        end = Attractor(drive.mean, run.start, ending, 0, turnings, run.state, exponent, reason)
        if ending != "unsettled":
            number = run.case.learn(irregular(self.model, drive, end, run.record))
        self.answers[run] = number, end


def exponents_of(
    model: Model, states: Sequence[tuple[Excitation, Array]], options: MotionOptions
) -> list[LyapunovExponent | MotionStopped] | list[None]:
    """Largest Lyapunov exponents, if asked for, of motions that go on from states [p, p'].

    Driven motions all have the same drive, and begin together with a period of it.
    """
    if not options.exponents or not states:
        return [None] * len(states)
    drive, _ = states[0]
    return exponents_together(
        *(model, [one.u for one, _ in states], [state for _, state in states]),
        *(2.0 * options.duration, 10.0),
        interval=drive.whole(0.5),
        base=drive.base,
        driven=bool(drive.period),
    )
