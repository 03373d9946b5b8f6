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

import numpy as np

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.records import Stretch
from pipedyn.attraction.regions import COARSE_CURVE, FINE_CURVE, PHASES, Region
from pipedyn.equilibrium.equilibria import Statics
from pipedyn.linear.neutral import decays
from pipedyn.models.base import Model
from pipedyn.motion.sampling import maxima, turning_points
from pipedyn.motion.vector_field import Excitation
from pipedyn.orbits.floquet_coordinates import floquet_coordinates, modal_coordinates
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util.check import Array
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed

TURNING_PERIODS, SAMPLES_AN_INTERVAL = 4, 32
"""Periods of a cycle of which the turning points are told, and samples in each interval of its
mesh."""

SAME_ATTRACTOR = 3e-3
"""Distance up to which two motions are on the same attractor: either is known to 1e-3."""

FARTHEST = 0.1
"""How far an equilibrium may be from where it is looked for, in rad or in a coordinate."""


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
    """Equilibria within `FARTHEST` of positions p, (integrated,) each, at a flow speed."""
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
        region = replace(region, floquet=modal_coordinates(motion, rest, u, region.units))
    end = Attractor(u, -1, "rest", 0, motion.tip(rest[:, None]), rest)
    return Solution(end, region, stable, growth=float(values.real.max()))


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
