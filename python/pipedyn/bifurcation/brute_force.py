# SPDX-License-Identifier: MIT
"""Brute force over the flow speed: where motions from many starts end.

After the transient the section x' = 0 of the free end is kept: its turning points. At rest there
is none, a cycle leaves a few values, a torus or chaos many.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np
import scipy

from pipedyn.models.base import Model, PipedynError
from pipedyn.motion.lyapunov import LyapunovExponent, lyapunov_exponent
from pipedyn.motion.simulate import BATCH, LARGEST_SAMPLES, modal_bend, simulate_many, slight_bend
from pipedyn.util.check import Array
from pipedyn.util.parallel import parallel
from pipedyn.util.result import result

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

SAMPLES_A_TIME = 100
"""Samples in a unit of time: cubics through them give a maximum of flutter to 1e-6."""


@result
class Attractor:
    """Where one motion ends.

    Attributes:
        speed: u.
        start: which of the initial states, counted from 0.
        ending: "rest", "periodic" (maxima repeat to the accuracy with which they are known, or
            converge geometrically to such), "settling" (it still approaches rest or a cycle),
            "irregular" (a torus, chaos, or a transient that still lasts) or "failed".
        period: maxima of the tip's transverse position in a period, 0 unless "periodic".
        turnings: transverse position of the tip where its velocity changes sign, in order, shape
            (K,); at rest the position itself.
        end: [p, p'] at the end, shape (2 moving,), empty where it failed.
        exponent: the largest Lyapunov exponent, if asked for and the motion is irregular.
    """

    speed: float
    start: int
    ending: Ending
    period: int
    turnings: Array = field(repr=False)
    end: Array = field(repr=False)
    exponent: LyapunovExponent | None = None


@dataclass(frozen=True)
class MotionOptions:
    """How motions are computed, and whether the exponents of irregular ones are."""

    transient: float  # time left out
    duration: float  # time recorded
    rtol: float
    exponents: bool

    @property
    def samples(self) -> int:
        """Of each motion."""
        return max(math.ceil(self.duration * SAMPLES_A_TIME), 100) + 1


def initial_bends(model: Model, count: int, seed: int) -> list[Array]:
    """Initial coordinates, the first a slight bend, the others mixtures of three shapes.

    Amplitudes range from a hundredth of a radian to some radians.
    """
    random = np.random.default_rng(seed)
    found = [model.bent(slight_bend)]
    while len(found) < count:
        parts = random.uniform(-1.0, 1.0, 3) * np.array([2.0, 1.0, 0.5])
        parts *= 10.0 ** random.uniform(-1.5, 0.0)
        for halved in 0.5 ** np.arange(6):
            with suppress(PipedynError):  # guides and pins that such a bend cannot meet
                found.append(model.bent(modal_bend(halved * parts)))
                break
    return found


def attractors(
    model: Model,
    speeds: Array,
    starts: list[Array],
    options: MotionOptions,
    failed: list[Failed],
    executor: Executor | None,
    shown: bool,
) -> tuple[Attractor, ...]:
    """Where motions end, from each start at each speed."""
    members = [(float(u), k) for u in speeds for k in range(len(starts))]
    most = min(BATCH, max(LARGEST_SAMPLES // (options.samples * model.coordinates), 1))
    indices = np.array_split(np.arange(len(members)), math.ceil(len(members) / most))
    parts = [[members[i] for i in part] for part in indices]
    found: list[Attractor] = []
    jobs = [partial(_batch, model, part, starts, options) for part in parts]
    answers = parallel(jobs, executor, label="brute force", progress=shown)
    for part, answer in zip(parts, answers, strict=True):
        if isinstance(answer, Exception):
            answer = [answer] * len(part)
        for (u, k), one in zip(part, answer, strict=True):
            if isinstance(one, Exception):
                failed.append((u, one))
                one = Attractor(u, k, "failed", 0, np.zeros(0), np.zeros(0))
            found.append(one)
    if options.exponents:
        irregular = [i for i, one in enumerate(found) if one.ending == "irregular"]
        measured = partial(
            lyapunov_exponent, model, duration=2.0 * options.duration, transient=20.0
        )
        exponents = [partial(measured, found[i].speed, found[i].end) for i in irregular]
        results = parallel(exponents, executor, label="exponents", progress=shown)
        for i, exponent in zip(irregular, results, strict=True):
            if isinstance(exponent, Exception):
                failed.append((found[i].speed, exponent))
            else:
                found[i] = replace(found[i], exponent=exponent)
    return tuple(found)


def _batch(
    model: Model, members: list[tuple[float, int]], starts: list[Array], options: MotionOptions
) -> list[Attractor | Exception]:
    """Where each member of one batch ends, or why it stopped early."""
    ensemble = simulate_many(
        model,
        [u for u, _ in members],
        options.transient + options.duration,
        [starts[k] for _, k in members],
        times=options.transient + np.linspace(0.0, options.duration, options.samples),
        rtol=options.rtol,
    )
    answers: list[Attractor | Exception] = []
    errors = {failure.index: failure.error for failure in ensemble.failures}
    for i, ((u, k), motion) in enumerate(zip(members, ensemble.motions, strict=True)):
        if i in errors:
            answers.append(errors[i])
            continue
        x = motion.tip[:, 0]
        turnings, error = turning_points(motion.t, x, motion.tip_velocity[:, 0])
        # Errors of an integrator's steps add up over the ten or more that a period takes.
        error += 10.0 * options.rtol * float(np.ptp(x))
        ending, period = ending_of(x, turnings, error)
        if ending == "rest":
            turnings = x[-1:].copy()
        end = np.asarray(model.start(motion.q[-1], motion.qdot[-1]))
        answers.append(Attractor(u, k, ending, period, turnings, end))
    return answers


def turning_points(t: Array, x: Array, velocity: Array) -> tuple[Array, float]:
    """Values of x where its velocity changes sign, in order, and by how much two may err together.

    Those of the cubics through samples. Cubics through every second sample err 16 times as much
    where x is smooth, and 8 times across the kinks of drag, so that a quarter of their difference
    bounds the errors of two values.
    """
    spline = scipy.interpolate.CubicHermiteSpline
    curve, coarse = (spline(t[::k], x[::k], velocity[::k]) for k in (1, 2))
    at = curve.derivative().roots(discontinuity=False, extrapolate=False)
    at = at[np.isfinite(at)]
    turnings: Array = curve(at)
    return turnings, 0.25 * float(np.abs(coarse(at) - turnings).max(initial=0.0))


def ending_of(x: Array, turnings: Array, error: float) -> tuple[Ending, int]:
    """What kind of motion the samples x of the tip and its turning points show, and its period.

    Two turning points may differ by the error although the motion repeats.
    """
    quarters = [float(np.ptp(part)) for part in np.array_split(x, 4)]
    if quarters[-1] < AT_REST:
        return "rest", 0
    highs = turnings[1:-1][(turnings[1:-1] > turnings[:-2]) & (turnings[1:-1] > turnings[2:])]
    near = RECURRENCE * quarters[-1]
    approaching = all(b < a for a, b in pairwise(quarters)) and quarters[-1] < 0.8 * quarters[0]
    for period in range(1, min(LONGEST_PERIOD, highs.size // 3) + 1):
        change = np.abs(highs[period:] - highs[:-period])
        recurs = bool(change.max() < near)
        if recurs and change.max() <= error:
            return "periodic", period
        if change.size < 4 * period:
            continue
        # A Floquet multiplier that still acts shrinks the changes by a constant factor. Near a
        # torus they may shrink for a while as well, but not twice as much in each quarter.
        parts = [max(float(part.max()), error) for part in np.array_split(change, 4)]
        converges = all(b <= max(0.5 * a, error) for a, b in pairwise(parts))
        if recurs and converges:
            return "periodic", period
        approaching |= converges or (recurs and all(b < a for a, b in pairwise(parts)))
    return ("settling" if approaching else "irregular"), 0
