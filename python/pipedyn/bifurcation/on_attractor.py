# SPDX-License-Identifier: MIT
"""What a motion does on an attractor: its record there, and the region around that it attracts."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from pipedyn.bifurcation.brute_force import Attractor, turning_points
from pipedyn.bifurcation.capture import (
    PHASES,
    Excitation,
    Region,
    attracting,
)
from pipedyn.bifurcation.equilibria import Statics, searched
from pipedyn.bifurcation.motion_options import SAMPLES_A_TIME, MotionOptions
from pipedyn.models.base import Model, NotConverged
from pipedyn.motion.simulate import Motion, simulate
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

SAME = 3e-3
"""Distance up to which two motions have ended on the same attractor: both are known to 1e-3."""

CLOSED = 1e-3
"""Distance between the ends of a period of a cycle: those of brute force repeat as well as that."""

TOLERANCE = 1e-9
"""Relative tolerance of the motions that are recorded."""

MOST_PERIODS = 48
"""Of the drive that are recorded, and of which one up to a third may be that of a motion."""

PERIODS, SAMPLES = 16, 256
"""Periods of a cycle that are recorded, and samples between two of its maxima."""

IRREGULAR = 5.0
"""Time recorded of an irregular motion, in durations: some hundred points of its section."""

MOST_SAMPLES = 2**16
"""Of a motion that is recorded."""


@dataclass(frozen=True, eq=False)
class Record:
    """A motion on an attractor, with what `Basin` tells of it."""

    motion: Motion
    period: float
    amplitude: float
    section: Array
    frequencies: Array
    spectrum: Array


@dataclass(frozen=True, eq=False)
class Found:
    """An attractor.

    Attributes:
        attractor: where a motion ended on it.
        region: around it; of an irregular one, many of its states, with the largest distance
            between those of the first half of a record and of the second as radius.
        attracts: whether motions from all trials in the region come nearer.
        growth: at rest, the largest real part of an eigenvalue; else NaN.
    """

    attractor: Attractor
    region: Region
    attracts: bool
    growth: float = math.nan

    @property
    def near(self) -> float:
        """Distance up to which a motion is on it."""
        if self.attractor.ending == "irregular":
            return self.region.radius
        return min(self.region.radius, SAME)

    def holds(self, one: Attractor) -> bool:
        """Whether a motion ended on it; if irregular, it may have reached a cycle since."""
        irregular = one.ending == "irregular" and self.attracts
        if one.ending != self.attractor.ending and not irregular:
            return False
        return bool(np.isfinite(self.region.distances(one.end[None], self.near))[0])

    def is_mirror_image(self, other: Found, shifts: bool) -> bool:
        """Whether the other is its image in the axis."""
        if other.attractor.ending != self.attractor.ending:
            return False
        points = self.region.mirrored(shifts).points
        points = points[:: max(len(points) // 200, 1)]
        within = np.isfinite(other.region.distances(points, other.near))
        return bool(np.mean(within) > 0.9)

    def mirrored(self, shifts: bool) -> Found:
        """Its image in the axis."""
        one, region = self.attractor, self.region.mirrored(shifts)
        end = -one.end
        if shifts:  # when a period begins
            end = region.points[np.argmax(region.points[:, -2]), : end.size]
        image = replace(one, end=end, turnings=-one.turnings)
        return replace(self, attractor=image, region=region)

    def kept_apart(self, distance: float) -> Found:
        """The same, with its region, if another attractor is so far away."""
        if self.attractor.ending == "irregular":
            return self
        return replace(self, region=self.region.kept_apart(distance))


class Recorder:
    """Records motions on attractors of a model."""

    def __init__(self, model: Model, drive: Excitation, options: MotionOptions) -> None:
        self.model, self.drive, self.options = model, drive, options
        self.statics = Statics(model)
        self.records: dict[tuple[str, bytes], Record] = {}

    def stable_equilibria(self) -> Iterator[Found]:
        """Those that are found."""
        if not isinstance(u := self.drive.u, float) or self.drive.period:
            return
        try:
            known = searched(self.model, u, (), counted=False)
        except NotConverged:
            return
        for q in known.q[known.stable]:
            end = np.asarray(self.model.start(q, None))
            height = self.model.tips(q[:, None])[:, 0]
            found = self.found(Attractor(u, -1, "rest", 0, height, end))
            if found.attracts:
                yield found

    def found(self, one: Attractor) -> Found:
        """The attractor that a motion ends on, with the region that it attracts."""
        growth = math.nan
        if one.ending == "rest":
            region, growth = self.about_rest(one.end)
        elif self.drive.period:
            return self.driven(one)
        else:
            record = self.record(one)
            if one.ending == "periodic" and not self.closes(record):
                one = replace(one, ending="irregular", period=0)
                record = self.record(one)
            # The motion went on: it is now on what it has only approached.
            one = replace(one, end=states_of(record.motion, record.motion.t[-1:])[0])
            self.records[key_of(one)] = record
            if one.ending == "irregular":
                return Found(one, self.cloud(record, record.motion.t), False)
            region = self.about_cycle(record)
        tried = self.attracting(region)
        return Found(one, tried or region, tried is not None, growth)

    def attracting(self, region: Region) -> Region | None:
        """The region with a radius from which all trials come nearer; None if there is none."""
        options = self.options
        return attracting(self.model, self.drive, region, options.transient, options.rtol)

    def driven(self, one: Attractor) -> Found:
        """The same of driven motions that move."""
        record = self.record(one)
        period = record.period
        if math.isnan(period):
            one = replace(one, ending="irregular", period=0)
            record = self.record(one)
        one = replace(one, end=states_of(record.motion, record.motion.t[-1:])[0])
        self.records[key_of(one)] = record
        step = self.drive.period / PHASES
        if one.ending == "irregular":
            times = step * np.arange(0.0, math.floor(record.motion.t[-1] / step))
            return Found(one, self.cloud(record, times), False)
        times = step * np.arange(0.0, round(period / step))
        region = self.region(states_of(record.motion, times), self.unit(record), period, times)
        tried = self.attracting(region)
        return Found(one, tried or region, tried is not None)

    def closes(self, record: Record) -> bool:
        """Whether a motion is after a period where it was."""
        if math.isnan(record.period):
            return False
        ends = states_of(record.motion, np.array([0.0, record.period]))
        first = self.region(ends[:1], self.unit(record), 1.0, np.zeros(1))
        [apart] = first.distances(ends[1:], math.inf)
        return bool(apart < CLOSED)

    def unit(self, record: Record) -> float:
        """Time in which a motion turns by one radian, from one maximum or period to the next."""
        return float(record.motion.t[-1]) / (2.0 * math.pi * max(len(record.section), 1))

    def about_rest(self, end: Array) -> tuple[Region, float]:
        """Of a motion that ends at rest, with the largest real part of an eigenvalue."""
        place = np.split(end, 2)[0]
        if self.drive.period:  # which does not move what is straight
            unit = self.drive.period / (2.0 * math.pi)
            times = self.drive.period / PHASES * np.arange(0.0, PHASES)
            points = np.tile(np.append(place, np.zeros_like(place)), (PHASES, 1))
            return self.region(points, unit, self.drive.period, times), math.nan
        assert isinstance(self.drive.u, float)
        with suppress(NewtonFailed):  # in contact with a stop, for which Newton is not made
            place = self.statics.solved(place, self.drive.u)
        values = self.statics.eigenvalues(place, self.drive.u)
        region = replace(Region.about_rest(place, values), turn=self.statics._turn)
        return region, float(values.real.max())

    def about_cycle(self, record: Record) -> Region:
        """Of a cycle, with units of a motion from one maximum to the next."""
        motion, period = record.motion, record.period

        def states(phase: Array) -> Array:
            return states_of(motion, 0.5 / math.pi * period * phase)

        region = Region.about_cycle(states, 2.0 * math.pi / period)
        return replace(region, unit=self.unit(record), turn=self.statics._turn)

    def cloud(self, record: Record, times: Array) -> Region:
        """States of an irregular motion, and how far those of one half are from the others."""
        states, unit = states_of(record.motion, times), self.unit(record)
        whole = self.region(states, unit, 2.0 * math.pi * unit, times)
        half = len(states) // 2
        apart = replace(whole, points=whole.points[:half]).distances(whole.points[half:], math.inf)
        return replace(whole, radius=max(2.0 * float(apart.max()), SAME))

    def region(self, points: Array, unit: float, period: float, times: Array) -> Region:
        """Around states [p, p'] at times, which tell the phases of the drive."""
        driven = self.drive.period > 0.0
        points = np.concatenate([points, self.drive.phases(times)], axis=1)
        return Region(points, unit, period, turn=self.statics._turn, driven=driven)

    # ------------------------------------------------------------------------------------- records

    def record(self, one: Attractor) -> Record:
        """Of the motion from where another one ended."""
        key = key_of(one)
        if key not in self.records:
            start = self.model.recorded(*(part[None] for part in np.split(one.end, 2)))
            of = {"rest": self.at_rest, "periodic": self.on_cycle}.get(one.ending, self.irregular)
            self.records[key] = of(one, *(part[0] for part in start))
        return self.records[key]

    def at_rest(self, one: Attractor, q: Array, qdot: Array) -> Record:
        """Of a motion at rest."""
        none = np.zeros(0)
        motion = self.motion(q, qdot, 1.0, 101)
        return Record(motion, 0.0, 0.0, np.empty((0, 2 * q.size)), none, none)

    def on_cycle(self, one: Attractor, q: Array, qdot: Array) -> Record:
        """Of a cycle with some maxima a period, after a time in which the motion comes nearer."""
        settled = self.motion(q, qdot, self.options.duration, 2)
        if self.drive.period:
            return self.on_driven_cycle(settled)
        times, _ = maxima(settled, 0.25 * self.options.duration)
        whole = (times.size - 1) // one.period
        if whole < 1:
            settled = self.motion(q, qdot, 4.0 * self.options.duration, 2)
            times, _ = maxima(settled, 0.0)
            whole = (times.size - 1) // one.period
        if whole < 1:
            return self.irregular(one, q, qdot)
        period = float(times[-1] - times[-1 - whole * one.period]) / whole
        count = min(PERIODS * SAMPLES * one.period, MOST_SAMPLES)
        motion = self.motion(settled.q[-1], settled.qdot[-1], PERIODS * period, count + 1)
        frequencies, spectrum = lines(motion.t[:-1], motion.tip[:-1, 0], whole=True)
        _, section = maxima(motion, 0.0)
        # A line every frequency / PERIODS: those between harmonics are 0 but for errors.
        harmonics = slice(0, None, PERIODS)
        return Record(
            *(motion, period, amplitude(motion), section),
            *(frequencies[harmonics], spectrum[harmonics]),
        )

    def on_driven_cycle(self, settled: Motion) -> Record:
        """Of a driven motion after some time; its period is NaN if none of the drive's is one."""
        q, qdot, drive = settled.q[-1], settled.qdot[-1], self.drive.period
        motion = self.motion(q, qdot, MOST_PERIODS * drive, 2)
        begins = states_of(motion, drive * np.arange(MOST_PERIODS + 0.0))
        first = Region(begins[:1], drive / (2.0 * math.pi), drive, turn=self.statics._turn)
        missed = first.distances(begins, math.inf)
        ways = range(1, MOST_PERIODS // 3 + 1)
        repeats = next((k for k in ways if missed[::k].max() < CLOSED), 0)
        period = repeats * drive if repeats else math.nan
        whole = MOST_PERIODS // max(repeats, 1) * max(repeats, 1)
        motion = self.motion(q, qdot, whole * drive, whole * SAMPLES // 2 + 1)
        section = self.begins(motion)
        frequencies, spectrum = lines(motion.t[:-1], motion.tip[:-1, 0], whole=True)
        every = slice(0, None, round(motion.t[-1] / period) if repeats else 1)
        return Record(
            *(motion, period, amplitude(motion), section, frequencies[every], spectrum[every])
        )

    def begins(self, motion: Motion) -> Array:
        """States [q, q'] when periods of the drive begin, (K, 2 coordinates)."""
        assert motion.dense is not None
        count = math.floor(motion.t[-1] / self.drive.period + 1e-6)
        return np.ascontiguousarray(motion.dense(self.drive.period * np.arange(count)).T)

    def irregular(self, one: Attractor, q: Array, qdot: Array) -> Record:
        """Of a motion that does not repeat."""
        time = IRREGULAR * self.options.duration
        count = min(math.ceil(time * SAMPLES_A_TIME), MOST_SAMPLES)
        motion = self.motion(q, qdot, time, count + 1)
        section = self.begins(motion) if self.drive.period else maxima(motion, 0.0)[1]
        found = lines(motion.t[:-1], motion.tip[:-1, 0], whole=False)
        return Record(motion, math.nan, amplitude(motion), section, *found)

    def motion(self, q: Array, qdot: Array, duration: float, samples: int) -> Motion:
        """From a state, with dense output."""
        return simulate(
            *(self.model, self.drive.u, duration, q, qdot),
            samples=samples,
            base=self.drive.base,
            rtol=TOLERANCE,
            dense=True,
        )


def key_of(one: Attractor) -> tuple[str, bytes]:
    """By which the record of the motion from where another ended is found again."""
    return one.ending, one.end.tobytes()


def states_of(motion: Motion, t: Array) -> Array:
    """States [p, p'] of a recorded motion, (k, 2 moving), at times."""
    assert motion.dense is not None
    return motion.dense._integrated(t)


def amplitude(motion: Motion) -> float:
    """Half the peak-to-peak of the free end."""
    x, rate = motion.tip[:, 0], motion.tip_velocity[:, 0]
    turnings, _ = turning_points(motion.t, x, rate)
    return 0.5 * float(np.ptp(turnings)) if turnings.size else 0.0


def maxima(motion: Motion, since: float) -> tuple[Array, Array]:
    """Times at which the free end is at a maximum, and states [q, q'], (K, 2 coordinates)."""
    dense, model, half = motion.dense, motion.model, motion.model.coordinates
    assert dense is not None

    def velocity(t: Array) -> Array:
        states = dense(t)
        return np.asarray(model.tip_velocities(states[:half], states[half:])[:, 0])

    end = float(dense.t[-1])
    t = np.linspace(since, end, math.ceil((end - since) * SAMPLES_A_TIME) + 1)
    values = velocity(t)
    falls = np.flatnonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))
    if not falls.size:
        return np.empty(0), np.empty((0, 2 * half))
    low, high = t[falls], t[falls + 1]
    for _ in range(50):  # bisection, to rounding
        middle = 0.5 * (low + high)
        above = velocity(middle) > 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high, np.ascontiguousarray(dense(high).T)


def lines(t: Array, x: Array, *, whole: bool) -> tuple[Array, Array]:
    """Angular frequencies and amplitudes of evenly spaced samples of x.

    Of a whole number of periods, or else through Hann's window.
    """
    window = np.ones(x.size) if whole else np.hanning(x.size + 1)[:-1]
    found = np.asarray(np.abs(np.fft.rfft((x - x.mean()) * window)) * 2.0 / window.sum())
    return np.asarray(2.0 * math.pi * np.fft.rfftfreq(x.size, float(t[1] - t[0]))), found
