# SPDX-License-Identifier: MIT
"""Brute force over the flow speed: where motions from many starts end.

Of each late motion the section x' = 0 of the free end is kept: its turning points. At rest there
is none, a cycle leaves a few values, a torus or chaos many.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pipedyn.linear.stability_curve import Failure
from pipedyn.models.base import Model, PipedynError
from pipedyn.motion.ensemble import BATCH, simulate_many
from pipedyn.motion.lyapunov import LyapunovExponent, exponent_from
from pipedyn.motion.simulate import LARGEST_SAMPLES, Motion
from pipedyn.util.check import Array
from pipedyn.util.parallel import parallel

Ending = Literal["rest", "periodic", "settling", "irregular", "failed"]

STILL = 1e-5
"""Range of the tip, in L, below which it is at rest."""

AGAIN = 1e-3
"""By how much maxima of a cycle may differ from those a period before, beside the range."""

LONGEST_PERIOD = 16
"""Maxima in a period beyond which a motion counts as irregular."""

SAMPLES_A_TIME = 100
"""Samples in a unit of time: cubics through them know a maximum of flutter to 1e-6."""


@dataclass(frozen=True)
class Ended:
    """Where one motion ended.

    Attributes:
        speed: u.
        start: which of the initial states, counted from 0.
        ending: "rest", "periodic", "settling" (its range still falls), "irregular" (a torus, chaos,
            or a transient that has not ended) or "failed".
        period: maxima of the tip's transverse position in a period, 0 but for "periodic".
        turnings: transverse position of the tip where its velocity changes sign, in order, shape
            (K,); at rest the position itself.
        end: [p, p'] at the end, shape (2 moving,), empty where it failed.
        exponent: the largest Lyapunov exponent, where it was asked for and the motion is irregular.
    """

    speed: float
    start: int
    ending: Ending
    period: int
    turnings: Array = field(repr=False)
    end: Array = field(repr=False)
    exponent: LyapunovExponent | None = None


@dataclass(frozen=True)
class Plan:
    """What is asked of every motion.

    Attributes:
        transient, duration: time left out, and time recorded.
        rtol: of the integration.
        exponents: whether irregular motions are asked for their exponent.
    """

    transient: float
    duration: float
    rtol: float
    exponents: bool

    @property
    def samples(self) -> int:
        """Of each motion."""
        return max(math.ceil(self.duration * SAMPLES_A_TIME), 100) + 1


def bends(model: Model, count: int, seed: int) -> list[Array]:
    """Initial coordinates, the first a slight bend, the others mixtures of three shapes.

    Amplitudes range from a hundredth of a radian to some radians.
    """
    random = np.random.default_rng(seed)
    found = [model.bent(lambda s: 0.05 * s**2)]
    while len(found) < count:
        parts = random.uniform(-1.0, 1.0, 3) * np.array([2.0, 1.0, 0.5])
        parts *= 10.0 ** random.uniform(-1.5, 0.0)
        for _ in range(6):

            def bend(s: Array, parts: Array = parts) -> Array:
                modes = np.array([1.0, 3.0, 5.0])[:, None] * (0.5 * math.pi * s)
                return np.asarray(parts @ np.sin(modes))

            try:
                found.append(model.bent(bend))
                break
            except PipedynError:  # guides and pins that such a bend cannot meet
                parts = 0.5 * parts
    return found[:count]


def endings(
    model: Model,
    speeds: Array,
    starts: list[Array],
    plan: Plan,
    executor: Executor | None,
    shown: bool,
) -> tuple[tuple[Ended, ...], tuple[Failure, ...]]:
    """Where motions end, from each start at each speed, and the members that failed."""
    members = [(float(u), k) for u in speeds for k in range(len(starts))]
    most = min(BATCH, max(LARGEST_SAMPLES // (plan.samples * model.coordinates), 1))
    parts = [
        [members[i] for i in part]
        for part in np.array_split(np.arange(len(members)), math.ceil(len(members) / most))
    ]
    ended: list[Ended] = []
    failures: list[Failure] = []
    jobs = [partial(_ended, model, part, starts, plan) for part in parts]
    answers = parallel(jobs, executor, label="brute force", progress=shown)
    for part, answer in zip(parts, answers, strict=True):
        if isinstance(answer, Exception):
            answer = [(_failed(u, k), answer) for u, k in part]
        for one, error in answer:
            if error is not None:
                failures.append(_failure(speeds, one, error))
            ended.append(one)
    if plan.exponents:
        asked = [i for i, one in enumerate(ended) if one.ending == "irregular"]
        exponents = [partial(_exponent, model, ended[i].speed, ended[i].end, plan) for i in asked]
        found = parallel(exponents, executor, label="exponents", progress=shown)
        for i, exponent in zip(asked, found, strict=True):
            if isinstance(exponent, Exception):
                failures.append(_failure(speeds, ended[i], exponent))
            else:
                ended[i] = replace(ended[i], exponent=exponent)
    return tuple(ended), tuple(failures)


def _failed(u: float, k: int) -> Ended:
    nothing = np.zeros(0)
    return Ended(u, k, "failed", 0, nothing, nothing)


def _failure(speeds: Array, one: Ended, error: Exception) -> Failure:
    return Failure(int(np.searchsorted(speeds, one.speed)), one.speed, error)


def _exponent(model: Model, u: float, state: Array, plan: Plan) -> LyapunovExponent:
    """Of an irregular motion, from where it ended."""
    return exponent_from(model, u, state, 2.0 * plan.duration, 20.0)


def _ended(
    model: Model, members: list[tuple[float, int]], starts: list[Array], plan: Plan
) -> list[tuple[Ended, Exception | None]]:
    """One batch: what each did and why it stopped early."""
    ensemble = simulate_many(
        model,
        [u for u, _ in members],
        plan.transient + plan.duration,
        [starts[k] for _, k in members],
        times=plan.transient + np.linspace(0.0, plan.duration, plan.samples),
        rtol=plan.rtol,
    )
    errors = {failure.index: failure.error for failure in ensemble.failures}
    return list(_told(members, ensemble.motions, errors))


def _told(
    members: list[tuple[float, int]],
    motions: Iterable[Motion],
    errors: Mapping[int, Exception],
) -> Iterator[tuple[Ended, Exception | None]]:
    for i, ((u, k), motion) in enumerate(zip(members, motions, strict=True)):
        if i in errors:
            yield _failed(u, k), errors[i]
            continue
        x, velocity = motion.tip[:, 0], motion.tip_velocity[:, 0]
        turnings = turning_points(motion.t, x, velocity)
        ending, period = ending_of(x, turnings)
        if ending == "rest":
            turnings = x[-1:].copy()
        state = motion.model.start(motion.q[-1], motion.qdot[-1])
        yield Ended(u, k, ending, period, turnings, np.asarray(state)), None


def turning_points(t: Array, x: Array, velocity: Array) -> Array:
    """Values of x where its velocity changes sign, in order, of the cubics through samples."""
    curve = CubicHermiteSpline(t, x, velocity)
    at = curve.derivative().roots(discontinuity=False, extrapolate=False)
    turnings: Array = curve(at[np.isfinite(at)])
    return turnings


def ending_of(x: Array, turnings: Array) -> tuple[Ending, int]:
    """What kind of motion the samples of the tip and its turning points tell, and its period."""
    quarters = [float(np.ptp(part)) for part in np.array_split(x, 4)]
    if quarters[-1] < STILL:
        return "rest", 0
    highs = turnings[1:-1][(turnings[1:-1] > turnings[:-2]) & (turnings[1:-1] > turnings[2:])]
    near = AGAIN * quarters[-1]
    for period in range(1, min(LONGEST_PERIOD, highs.size // 3) + 1):
        if np.abs(highs[period:] - highs[:-period]).max() < near:
            return "periodic", period
    falling = all(b < a for a, b in pairwise(quarters))
    if falling and quarters[-1] < 0.8 * quarters[0]:
        return "settling", 0
    return "irregular", 0
