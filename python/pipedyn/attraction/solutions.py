# SPDX-License-Identifier: MIT
"""Equilibria, cycles and irregular motions that are known at a flow, with what they attract.

An equilibrium attracts if its eigenvalues decay, a cycle if its Floquet multipliers, but for the
trivial one, lie within the unit circle. The region of either reaches a quarter of the way to
anything else that is known: to an unstable cycle, for one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pipedyn.attraction.records import Stretch, maxima, turning_points
from pipedyn.attraction.regions import COARSE_CURVE, FINE_CURVE, PHASES, Excitation, Region
from pipedyn.equilibrium.equilibria import Statics
from pipedyn.linear.neutral import decays
from pipedyn.models.base import Model
from pipedyn.motion.lyapunov import LyapunovExponent
from pipedyn.motion.vector_field import ForcedField, VectorField
from pipedyn.orbits.collocation import solved
from pipedyn.orbits.floquet import LARGEST_ERROR, nontrivial, orbit_multipliers
from pipedyn.orbits.floquet_coordinates import floquet_coordinates
from pipedyn.orbits.orbit_continuation import COARSE, FINE
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, interpolated, refined, resolved_orbit
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import Result
from pipedyn.util.units import LENGTH

TURNING_PERIODS, SAMPLES_AN_INTERVAL = 4, 32
"""Periods of a cycle of which the turning points are told, and samples in each interval of its
mesh."""

SAME_ATTRACTOR = 3e-3
"""Distance up to which two motions are on the same attractor: either is known to 1e-3."""

NEWTON_STEPS = 5
"""Steps of Newton's method from a motion's last period after which no cycle is near: it took one to
three to those of seven pipes."""

FARTHEST = 0.1
"""How far an equilibrium may be from where it is looked for, in rad or in a coordinate."""

REST_EXTENT = 1e-5
"""Extent of an orbit, in rad or in coordinates of a reduced model, below which it is at rest."""

ROUGHLY, CLOSELY = 1e-3, 1e-6
"""Shares of its range up to which rounds of an orbit are the same, on its first mesh and when it is
known: near a period doubling motions go twice round for long, and what is solved for from them may
be the cycle that is run through once."""

LARGEST_CYCLE = 100
"""Degrees of freedom of a cycle that is solved for. An undamped chain of 20 takes 0.06 s, of 40
0.4, of 100 seven, half of it for the multipliers."""

MIXED, NARROWER = 256, 20
"""Mixtures of modes that are tried about rest, and amplitudes: from 0.5 rad down to 6e-4."""

Ending = Literal[
    "rest", "periodic", "quasi-periodic", "chaotic", "irregular", "unsettled", "failed"
]


@saved_as("Attractor", shapes={"K": "turnings", "n": "end"}, added=("reason",))
class Attractor(Result, units={"turnings": LENGTH, "period": None}):
    """Where one motion ends.

    Attributes:
        speed: u.
        start: number of the start of the motion, counted from 0. It is -1 for an attractor of a
            bifurcation diagram on which no motion from the starts ended, but one that began beside
            a cycle at a neighbouring speed.
        ending: "rest"; "periodic", of motions that reach a cycle; "quasi-periodic", where the
            largest Lyapunov exponent is not above 0 beyond its spread and averages over the record
            converge as they do on a torus only; "chaotic", where the exponent is above 0 by more
            than three times its spread; "irregular" where exponents are not asked for; "unsettled",
            where none of these was shown, for the `reason`; or "failed".
        period: maxima of the tip's transverse position in a period, 0 unless "periodic".
        turnings: transverse position of the tip where its velocity changes sign, in order, over
            four periods of a cycle and the time recorded of others, shape (K,); at rest the
            position itself.
        end: [p, p'] on it, shape (2 integrated,), empty where it failed.
        exponent: the largest Lyapunov exponent, if asked for and the motion is irregular; of one
            motion for all at a speed whose turning points are spread alike.
        reason: why the motion is "unsettled"; empty otherwise.
    """

    speed: float
    start: int
    ending: Ending
    period: int
    turnings: Array = field(repr=False)
    end: Array = field(repr=False)
    exponent: LyapunovExponent | None = None
    reason: str = ""

    @property
    def name(self) -> str:
        """The ending in words, with the maxima in a period or the exponent of chaos."""
        if self.ending == "periodic":
            return f"periodic, {self.period} maxim{'um' if self.period == 1 else 'a'}"
        if self.ending == "chaotic" and self.exponent is not None:
            return f"chaotic, exponent {self.exponent.value:.2g}"
        return self.ending


@dataclass(frozen=True, eq=False)
class Solution:
    """An equilibrium, a cycle or an irregular motion.

    Attributes:
        attractor: what it is, as an end of motions; of no start.
        region: around it; of an irregular motion, around many of its states, with twice the largest
            distance of those of the later half of a record from the others as radius.
        attracts: whether motions from nearby are known to come to it; of irregular ones False.
        period: in T; 0 at rest, NaN where irregular.
        growth: at rest, the largest real part of an eigenvalue; else NaN.
        orbit: of a cycle that was solved for.
    """

    attractor: Attractor
    region: Region
    attracts: bool
    period: float = 0.0
    growth: float = math.nan
    orbit: PeriodicOrbit | None = field(default=None, repr=False)

    @property
    def settles(self) -> bool:
        """Whether motions from elsewhere end on it: not where multipliers say that it repels."""
        repels = not self.attracts and (self.orbit is not None or self.period == 0.0)
        return not repels

    @property
    def near(self) -> float:
        """Distance up to which a motion is on it."""
        if math.isnan(self.period):
            return self.region.radius
        return min(self.region.radius, SAME_ATTRACTOR)

    def holds(self, one: Attractor, period: float) -> bool:
        """Whether a motion that was seen to repeat after a time ended on it.

        Beside a cycle that attracts a motion may repeat to the accuracy of its record after two
        periods before it does after one; beside one that does not, it is on a cycle that has left
        that at a period doubling.
        """
        if one.ending != self.attractor.ending:
            return False
        times = max(round(period / self.period), 1) if self.attracts and self.period else 1
        if abs(period - times * self.period) > 0.01 * period:
            return False
        return bool(np.isfinite(self.region.distances(one.end[None], self.near))[0])

    def is_mirror_image(self, other: Solution, shifts: bool) -> bool:
        """Whether the other is its image in the axis, half a period later if the drive shifts."""
        if other.attractor.ending != self.attractor.ending:
            return False
        points = self.region.mirrored(shifts).points
        points = points[:: max(len(points) // 200, 1)]
        within = np.isfinite(other.region.distances(points, other.near))
        return bool(np.mean(within) > 0.9)

    def mirrored(self, shifts: bool) -> Solution:
        """The solution's mirror image in the axis of the pipe, which is a solution as well.

        shifts: whether what drives the motion becomes its own mirror image half a period later.
        """
        one, region = self.attractor, self.region.mirrored(shifts)
        end = -one.end
        if shifts:  # when a period begins
            end = region.points[np.argmax(region.points[:, -2]), : end.size].copy()
        image, orbit = replace(one, end=end, turnings=-one.turnings), self.orbit
        if orbit is not None:
            orbit = replace(orbit, starts=-orbit.starts, rates=-orbit.rates, closing=None)
        orbit = None if shifts else orbit
        return replace(self, attractor=image, region=region, orbit=orbit)

    def kept_apart(self, distance: float) -> Solution:
        """Itself with a region that leaves out something else that is known so far away."""
        if math.isnan(self.period):
            return self
        return replace(self, region=self.region.kept_apart(distance))


def kept_apart(solutions: Sequence[Solution]) -> list[Solution]:
    """Solutions whose regions leave out all others, if they attract."""
    found: list[Solution] = []
    for one in solutions:
        apart = [one.region.apart(o.region) for o in solutions if one.attracts and o is not one]
        found.append(one.kept_apart(min(apart, default=math.inf)))
    return found


# ----------------------------------------------------------------------------------------- rest


def equilibria_near(model: Model, places: Iterable[Array], u: float) -> list[Solution]:
    """Equilibria within `FARTHEST` of positions p, (integrated,) each, at a flow speed, each once."""
    found: list[Solution] = []
    statics = Statics(model)
    for place in places:
        try:
            p = statics.solved(place, u)
        except NewtonFailed:
            continue
        known = (np.abs(one.region.points[0, : p.size] - p).max() for one in found)
        if np.abs(p - place).max() <= FARTHEST and min(known, default=math.inf) >= 1e-5:
            found.append(equilibrium(statics, p, u))
    return found


def equilibrium(statics: Statics, p: Array, u: float) -> Solution:
    """The solution of an equilibrium at p."""
    values = statics.eigenvalues(p, u)
    stable, rest = bool(decays(values).all()), np.append(p, np.zeros_like(p))
    region = replace(Region.about_rest(p, values), turn=statics.whole_turn)
    motion = statics.motion
    if stable and not motion.constrained:
        factorised()
        region = replace(region, basin=_basin_of_rest(motion, rest, motion.jacobian(rest, u), u))
    end = Attractor(u, -1, "rest", 0, motion.tip(rest[:, None]), rest)
    return Solution(end, region, stable, growth=float(values.real.max()))


def _basin_of_rest(motion: VectorField, rest: Array, slopes: Array, u: float) -> Array | None:
    """`Region.basin` of a stable equilibrium, from where motions come to rest.

    There V, the sum of the modes' squared velocities, falls at least half as fast as linear theory
    says. That is asked of each mode at some phases and of mixtures, all at one V; what nonlinear
    forces change grows with a higher power of the distance, so that it holds nearer too.
    """
    values, vectors = np.linalg.eig(slopes)
    vectors = vectors * np.abs(values).min() / np.linalg.norm(vectors[motion.half :], axis=0)
    try:
        rows = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:  # of eigenvalues that meet
        return None
    rows = np.concatenate([rows.real, rows.imag])
    random, count = np.random.default_rng(0), values.size
    phases = np.exp(0.25j * math.pi * np.arange(8))
    alone = np.einsum("ik,p->ikp", vectors, phases).reshape(count, -1).real
    mixed = (vectors @ (random.normal(size=(count, MIXED, 2)) @ np.array([1.0, 1.0j]))).real
    away = np.concatenate([alone, mixed], axis=1)
    sizes = np.linalg.norm(rows @ away, axis=0)
    away = (away / sizes)[:, sizes > 1e-9]  # the phases of a real eigenvalue have zeros
    by_linear = 2.0 * np.sum((rows @ away) * (rows @ slopes @ away), axis=0)
    for radius in 0.5 * 0.7 ** np.arange(NARROWER):
        rates = motion(np.ascontiguousarray(rest[:, None] + radius * away), u) / radius
        if (2.0 * np.sum((rows @ away) * (rows @ rates), axis=0) <= 0.5 * by_linear).all():
            return np.asarray(rows / radius)
    return None


# --------------------------------------------------------------------------------------- cycles


def around(
    model: Model, drive: Excitation, t: Array, states: Array, unit: float, period: float
) -> Region:
    """The region around states [p, p'] of a motion, which are not taken for points of a curve.

    Args:
        model: the model.
        drive: what drives the motion.
        t: time of each state since the beginning of a period of the drive, (k,).
        states: if the motion is driven at PHASES times in each period, (k, 2 integrated).
        unit: time by which rates are multiplied.
        period: of the motion.
    """
    points = np.concatenate([states, drive.phases(t)], axis=1)
    driven, turn = bool(drive.period), Statics(model).whole_turn
    return Region(points, unit, period, turn=turn, driven=driven)


def cycle(model: Model, drive: Excitation, orbit: PeriodicOrbit, stable: bool) -> Solution:
    """The solution of an orbit, during which a drive has a whole number of periods."""
    field, period = drive.field(model), 2.0 * math.pi / orbit.frequency
    t = np.linspace(
        0.0, TURNING_PERIODS * period, TURNING_PERIODS * SAMPLES_AN_INTERVAL * len(orbit.starts) + 1
    )
    states = orbit.states(orbit.frequency * t).T
    q, qdot = model.to_user(*np.split(states, 2, axis=1))
    x, velocity = model.tips(q.T)[:, 0], model.tip_velocities(q.T, qdot.T)[:, 0]
    turnings, _ = turning_points(t, x, velocity)
    count = max(round((maxima(turnings).size + 1) / TURNING_PERIODS), 1)
    end = Attractor(drive.mean, -1, "periodic", count, turnings, states[-1].copy())
    unit = period / (2.0 * math.pi * count)
    if drive.period:
        count = round(period / drive.period) * PHASES
        times = np.linspace(0.0, period, count, endpoint=False)
        states = orbit.states(orbit.frequency * times).T
        region = around(model, drive, times, states, unit, period)
        return Solution(end, region, stable, period, orbit=orbit)
    mesh = orbit.edges
    if orbit.symmetric:
        mesh = np.append(mesh, orbit.span + mesh[1:])
    # Of what is unstable nothing but its distance from others is asked for.
    finest = FINE_CURVE if stable else COARSE_CURVE
    region = Region.about_cycle(lambda phase: orbit.states(phase).T, unit, period, mesh, finest)
    region = replace(region, turn=Statics(model).whole_turn)
    if stable and not field.constrained:
        region = replace(region, floquet=floquet_coordinates(field, orbit, region.units))
    return Solution(end, region, stable, period, orbit=orbit)


def by_record(
    model: Model, drive: Excitation, end: Attractor, stretch: Stretch, period: float
) -> Solution:
    """The solution that a motion is on at the end of a stretch, of which that alone is known.

    period: after which the motion repeats; 0 at rest.
    """
    statics, last = Statics(model), float(stretch.t[-1])
    span = period or drive.period  # driven motions rest over each period of the drive
    unit = span / (2.0 * math.pi * max(end.period, 1))
    if drive.period:
        step = drive.period / PHASES
        times = np.asarray(step * np.arange(round(span / step)), dtype=np.float64)
        at = np.searchsorted(stretch.t, last - span + times - 1e-9)
        region = around(model, drive, times, stretch.states[at], unit, span)
    elif not period:
        place = end.end[: stretch.states.shape[1] // 2]
        region = Region.about_rest(place, statics.eigenvalues(place, drive.mean))
    else:
        curve = scipy.interpolate.CubicSpline(stretch.t, stretch.states)

        def states(phase: Array) -> Array:
            return np.asarray(curve(last - period + 0.5 / math.pi * period * phase))

        region = Region.about_cycle(states, unit, period)
    return Solution(end, replace(region, turn=statics.whole_turn), False, period)


def irregular(model: Model, drive: Excitation, end: Attractor, stretch: Stretch) -> Solution:
    """The solution of a motion that does not repeat, by its record."""
    count = max(maxima(stretch.turnings).size, 1)
    unit = float(stretch.t[-1]) / (2.0 * math.pi * count)
    every = round(drive.period / PHASES / float(stretch.t[1] - stretch.t[0])) or 1
    times, states = stretch.t[::every], stretch.states[::every]
    region = around(model, drive, times, states, unit, 2.0 * math.pi * unit)
    half = len(states) // 2
    first = replace(region, points=region.points[:half])
    apart = float(first.distances(region.points[half:], math.inf).max())
    region = replace(region, radius=max(2.0 * apart, SAME_ATTRACTOR))
    return Solution(end, region, False, math.nan)


def last_period(
    model: Model, drive: Excitation, stretch: Stretch, farthest: float
) -> tuple[VectorField, PeriodicOrbit]:
    """An orbit through the last period of a motion, and the vector field that it is an orbit of.

    Args:
        model: the model.
        drive: what drives it; times of the stretch are since the beginning of one of its periods.
        stretch: what the motion did.
        farthest: distance, see `Stretch.recurrence`, to which it must come back.

    Raises:
        NewtonFailed: if it does not.
    """
    back, first, last, turns = stretch.recurrence(drive.period)
    if not back <= farthest:
        raise NewtonFailed("the motion does not come back to an earlier state")
    motion = drive.field(model, turns)
    begin, end = np.searchsorted(stretch.t, [first, last])
    some = slice(max(int(begin) - 2, 0), int(end) + 3)
    t, states, frequency = stretch.t[some], stretch.states[some], 2.0 * math.pi / (last - first)
    along = motion.along(frequency * (t - first), frequency)
    # With constraints f gives another rate of p than p'.
    rates = along(np.ascontiguousarray(states.T), drive.mean)[motion.half :].T
    rates = np.concatenate([states[:, motion.half :], rates], axis=1)
    spline = scipy.interpolate.CubicHermiteSpline(t, states, rates)

    def through(phase: Array) -> Array:
        return np.ascontiguousarray(spline(first + phase / frequency).T)

    return motion, resolved_orbit(motion, through, frequency, drive.mean, False, COARSE.defect)


def solved_cycle(
    model: Model, drive: Excitation, stretch: Stretch, farthest: float
) -> tuple[PeriodicOrbit, bool]:
    """The cycle near the last period of a motion, and whether its multipliers say that it attracts.

    Arguments and errors are those of `last_period`; `NewtonFailed` is raised also where no cycle is
    found near the motion's last period or its multipliers are not known.
    """
    if model.dof > LARGEST_CYCLE:
        raise NewtonFailed(f"no cycle is solved for with more than {LARGEST_CYCLE} freedoms")
    motion, guess = last_period(model, drive, stretch, farthest)
    orbit = solved(motion, guess, COARSE.tolerance, iterations=NEWTON_STEPS)
    if orbit.size < REST_EXTENT:
        raise NewtonFailed("the motion comes to rest")
    for within in (ROUGHLY, CLOSELY):
        motion, once = run_through_once(model, drive, motion, orbit, within)
        if once is orbit and within == CLOSELY:
            break
        orbit = resolved_orbit(motion, once.states, once.frequency, drive.mean, False, FINE.defect)
        orbit = solved(motion, orbit, FINE.tolerance, iterations=NEWTON_STEPS)
    if model.pipe.has_kinks and model.kinks_known:  # multipliers need a mesh that ends at these
        twice = np.full(len(orbit.starts), 2)
        orbit = solved(motion, refined(motion, orbit, twice, at_kinks=True), FINE.tolerance)
    multipliers, _, error = orbit_multipliers(motion, orbit, FINE.stagnation)
    if not error <= LARGEST_ERROR:
        raise NewtonFailed(f"its multipliers are known to {error:.1e} only")
    others = multipliers if drive.period else nontrivial(multipliers)
    return orbit, float(np.abs(others).max(initial=0.0)) < 1.0 - error


def run_through_once(
    model: Model, drive: Excitation, motion: VectorField, orbit: PeriodicOrbit, within: float
) -> tuple[VectorField, PeriodicOrbit]:
    """An orbit that is run through several times as one that is so once, with its vector field.

    Args:
        model: the model.
        drive: what drives it.
        motion: the vector field of the orbit.
        orbit: not solved for anew.
        within: share of its range up to which states of several rounds count as the same.
    """
    phases = np.linspace(0.0, 2.0 * math.pi, 17)
    order = motion.order if isinstance(motion, ForcedField) else 0
    across = motion.tip(orbit.states(np.linspace(0.0, 2.0 * math.pi, 8 * len(orbit.starts) + 1)))
    most = int(np.count_nonzero((across[1:-1] >= across[:-2]) & (across[1:-1] > across[2:]))) + 1

    def is_run_through(times: int) -> bool:
        if order % times:
            return False
        apart = orbit.states(phases + 2.0 * math.pi / times) - orbit.states(phases)
        return bool(np.abs(apart).max() <= within * np.ptp(orbit.starts))

    times = next(filter(is_run_through, range(order or most, 1, -1)), 1)
    if times == 1:
        return motion, orbit
    if order:
        motion = drive.field(model, order // times)

    def once(phase: Array) -> Array:
        return orbit.states(phase / times)

    edges = np.linspace(0.0, 2.0 * math.pi, len(orbit.starts) + 1)
    return motion, interpolated(motion, once, edges, times * orbit.frequency, orbit.u)
