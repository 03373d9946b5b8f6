# SPDX-License-Identifier: MIT
"""Equilibria, cycles and irregular motions known at a flow, with the regions that they attract.

An equilibrium attracts if its eigenvalues have negative real parts, a cycle if its nontrivial
Floquet multipliers lie within the unit circle. The region of either extends a quarter of the way to
any other known solution, such as an unstable cycle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.records import Stretch
from pipedyn.attraction.regions import FLOOR, PHASE_STEP, PHASES, Region, aligned
from pipedyn.equilibrium.rotating_motion import motion_at, rotating_slopes
from pipedyn.equilibrium.statics import Statics, statics_of
from pipedyn.linear.neutral import decays
from pipedyn.models.base import Model
from pipedyn.motion.sampling import maxima, turning_points
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.orbits.floquet_coordinates import (
    POINTS,
    floquet_coordinates,
    modal_coordinates,
    point_phases,
)
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

TURNING_PERIODS, SAMPLES_AN_INTERVAL = 4, 32
"""Number of periods of a cycle whose turning points are listed, and number of samples in each
interval of its mesh."""

SAME_ATTRACTOR = 3e-3
"""Distance up to which two motions are on the same attractor: each is known to 1e-3."""

REGION_SHARE = 0.25
"""Largest share of the way to any other known solution that a region extends."""

LONGEST_PERIOD = 2.0
"""Largest period that is assumed for equilibria about which nothing oscillates."""

EVERY_FOURTH = 4
"""Number of samples of a record of which one is compared with the others, to see how far the states
of an irregular motion lie apart: some ten in a period are as far away as all are."""

LARGEST_DISTANCE = 0.1
"""Largest distance of an equilibrium from the place where it is looked for, in rad or in a
coordinate."""


@dataclass(frozen=True, eq=False)
class Solution:
    """An equilibrium, a cycle or an irregular motion.

    Attributes:
        attractor: the solution as an end of motions; its start is -1.
        region: region around the solution. For an irregular motion it lies around many of its
            states, and its radius is twice the largest distance of the states of the later half of
            a record from the others.
        attracts: whether motions from nearby are known to come to it; False for irregular ones.
        period: period in T; 0 at rest, NaN for irregular motions.
        growth: largest real part of an eigenvalue of an equilibrium; NaN for other solutions.
        orbit: orbit of a cycle that was solved for.
        scatter: distance from the region's points within which a motion on the solution lies, if
            that is known from a record only.
    """

    attractor: Attractor
    region: Region
    attracts: bool
    period: float = 0.0
    growth: float = math.nan
    orbit: PeriodicOrbit | None = field(default=None, repr=False)
    scatter: float = 0.0

    def contains(self, states: Array) -> NDArray[np.bool_]:
        """Whether states, (k, 2 integrated), are so near that they count as on the solution."""
        near = max(min(self.region.radius, SAME_ATTRACTOR), self.scatter)
        return np.isfinite(self.region.distances(states, near))

    def holds(self, state: Array, period: float) -> bool:
        """Whether the solution is the end of a motion that was seen to repeat after a period.

        Beside an attracting cycle a motion may repeat to the accuracy of its record after two
        periods before it does so after one; beside a cycle that does not attract, it is on a cycle
        that branches off from it at a period doubling.

        Args:
            state: the last state [p, p'] of the motion, (2 integrated,).
            period: the period, 0 if the motion rests, NaN if it is irregular.
        """
        if math.isnan(period) != math.isnan(self.period):
            return False
        times = max(round(period / self.period), 1) if self.attracts and self.period else 1
        if abs(period - times * self.period) > 0.01 * period:
            return False
        return bool(self.contains(state[None]))

    def is_mirror_image(self, other: Solution, shifts: bool) -> bool:
        """Whether the other is its image in the axis, half a period later if `shifts` is true."""
        if other.attractor.ending != self.attractor.ending:
            return False
        points = self.region.mirrored(shifts).points
        return bool(np.mean(other.contains(points[:: max(len(points) // 200, 1)])) > 0.9)

    def mirrored(self, shifts: bool) -> Solution:
        """The mirror image of the solution in the axis of the pipe, which is a solution as well.

        shifts: whether the drive becomes its own mirror image half a period later.
        """
        one, region, orbit = self.attractor, self.region.mirrored(shifts), self.orbit
        signs = np.tile(region.signs, 2)
        end, turnings = signs * one.end, one.turnings
        if not (region.signs > 0.0).any():  # in three dimensions the image is from z to -z
            turnings = -turnings
        if shifts:  # state at the beginning of a period of the drive
            end = region.points[np.argmax(region.points[:, -2]), : end.size].copy()
            orbit = None
        elif orbit is not None:
            orbit = replace(orbit, starts=signs * orbit.starts, rates=region.signs * orbit.rates)
        image = replace(one, end=end, turnings=turnings)
        return replace(self, attractor=image, region=region, orbit=orbit)


def with_separate_regions(solutions: Sequence[Solution], known: int = 0) -> list[Solution]:
    """Solutions, with regions that leave out all other solutions, except around irregular ones.

    A region extends over the share REGION_SHARE of the way there at most. Around a solution that
    does not attract, which serves to recognise motions that repeat, it leaves out others that
    repeat and extends no farther than SAME_ATTRACTOR. As a cycle may cross or touch another in the
    state space, a radius of ten times FLOOR is always left.

    Args:
        solutions: the solutions.
        known: number of solutions, from the first on, whose regions leave out one another already.
    """
    found: list[Solution] = []
    for k, one in enumerate(solutions):
        region = one.region
        if not math.isnan(one.period):
            radius = region.radius if one.attracts else min(region.radius, SAME_ATTRACTOR)
            for other in solutions[known if k < known else 0 :]:
                if other is not one and (one.attracts or not math.isnan(other.period)):
                    apart = region.distances(other.region.points, radius / REGION_SHARE).min()
                    radius = min(radius, REGION_SHARE * float(apart))
            region = region.within(max(radius, 10.0 * FLOOR))
        found.append(replace(one, region=region))
    return found


def symmetries(motion: VectorField) -> dict[str, Any]:
    """Changes of a state that change no motion, as arguments of `Region`."""
    model = motion.model
    if model.dimensions == 2:
        return {"turn": Statics(model).whole_turn, "signs": -np.ones(motion.half)}
    signs = model.from_plane(np.ones(model.planar.integrated))
    return {"axisymmetric": motion.axisymmetric, "signs": 2.0 * signs - 1.0}


# ----------------------------------------------------------------------------------------- rest


def equilibria_near(model: Model, places: Iterable[Array], u: float) -> list[Solution]:
    """Equilibria within `LARGEST_DISTANCE` of positions p, (integrated,) each, at a flow speed."""
    found: list[Solution] = []
    for statics, place in (statics_of(model, p) for p in places):
        with suppress(NewtonFailed):  # e.g. where a slow motion passes no equilibrium
            p = statics.solved(place, u)
            whole = statics.whole(p)
            known = (np.abs(one.region.points[0, : whole.size] - whole).max() for one in found)
            if np.abs(p - place).max() <= LARGEST_DISTANCE and min(known, default=1.0) >= 1e-5:
                found.append(_equilibrium(statics, p, u))
    return found


def _equilibrium(statics: Statics, p: Array, u: float) -> Solution:
    """The solution of an equilibrium at p."""
    model, values = statics.model, statics.eigenvalues(p, u)
    motion, p = VectorField(model), statics.whole(p)
    stable, rest = bool(decays(values).all()), np.append(p, np.zeros_like(p))
    oscillating = np.abs(values[values.imag != 0.0])
    omega = oscillating.min() if oscillating.size else np.abs(values).min()
    unit = 1.0 / max(float(omega), 1e-3)
    period = min(2.0 * math.pi * unit, LONGEST_PERIOD)
    region = Region(rest[None], unit, period, **symmetries(motion))
    if not p.any():  # turns leave the distance from the axis the same
        region = replace(region, axisymmetric=False)
    if stable and not motion.constrained:
        with suppress(LinAlgError):
            slopes = motion.jacobian(rest, u)
            trivial = int(model.axisymmetric and bool(p.any()))
            region = replace(region, floquet=modal_coordinates(slopes, region.units, trivial))
    end = Attractor(u, -1, "rest", 0, motion.end(rest[:, None])[0], rest)
    return Solution(end, region, stable, growth=float(values.real.max()))


# --------------------------------------------------------------------------------------- cycles


def around_cycle(
    model: Model,
    drive: Excitation,
    states: Callable[[Array], Array],
    period: float,
    count: int,
    phases: Array,
) -> Region:
    """The region around a cycle whose states, (2 integrated, k), are a function of phase, (k,).

    Args:
        model: the model.
        drive: what drives motions on the cycle.
        states: the function; if motions are driven, phase 0 is the beginning of a period of the
            drive.
        period: period of the cycle.
        count: number of maxima of the tip's transverse position in a period.
        phases: phases of the points, from 0 on, (M,), if motions are not driven.
    """
    step, omega, same = PHASE_STEP, 2.0 * math.pi / period, symmetries(drive.field(model))
    unit = period / (2.0 * math.pi * count)
    if drive.period:
        t = np.linspace(0.0, period, round(period / drive.period) * PHASES, endpoint=False)
        points = np.concatenate([states(omega * t).T, drive.phases(t)], axis=1)
        return Region(points, unit, period, driven=True, **same)
    before, on, after = (states(phases + shift).T for shift in (-step, 0.0, step))
    if model.axisymmetric:
        before, on, after = (aligned(one, unit) for one in (before, on, after))
        before, after = (
            np.where(np.sum(one * on, axis=1, keepdims=True) < 0.0, -one, one)
            for one in (before, after)
        )
    once, twice = 0.5 * (after - before), before + after - 2.0 * on
    rates = np.stack([once * omega / step, twice * (omega / step) ** 2])
    return Region(on, unit, period, rates=rates, **same)


def cycle(model: Model, drive: Excitation, orbit: PeriodicOrbit, stable: bool) -> Solution:
    """The solution of an orbit whose period is a whole number of periods of the drive."""
    field, period = drive.field(model), 2.0 * math.pi / orbit.frequency
    samples = SAMPLES_AN_INTERVAL * len(orbit.starts)
    states = orbit.states(np.linspace(0.0, 2.0 * math.pi, samples, endpoint=False))
    t = np.linspace(0.0, TURNING_PERIODS * period, TURNING_PERIODS * samples + 1)
    _, across, velocity = field.end_across(states)
    turnings = turning_points(t, *(np.resize(values, t.size) for values in (across, velocity)))
    count = max(round((maxima(turnings).size + 1) / TURNING_PERIODS), 1)
    end = Attractor(drive.mean, -1, "periodic", count, turnings, states[:, 0].copy())
    region = around_cycle(model, drive, orbit.states, period, count, point_phases(orbit))
    if stable and not field.constrained and not drive.period:
        with suppress(LinAlgError):
            region = replace(region, floquet=floquet_coordinates(field, orbit, region.units))
    return Solution(end, region, stable, period, orbit=orbit)


def circular_solution(model: Model, z: Array) -> Solution:
    """The solution of a circular motion z = (q, W, u) of a pipe in three dimensions."""
    one = motion_at(model, z)
    period, state = 2.0 * math.pi / abs(one.frequency), np.concatenate([one.q, one.qdot])
    turnings = one.radius * np.tile([1.0, -1.0], TURNING_PERIODS)
    end = Attractor(one.u, -1, "rotating", 1, turnings, state)
    same = symmetries(VectorField(model))
    region = Region(state[None], 1.0 / abs(one.frequency), period, **same)
    if one.stable and model.integrated == model.dof:
        with suppress(LinAlgError):
            coordinates = modal_coordinates(rotating_slopes(model, z), region.units, 1)
            region = replace(region, floquet=coordinates)
    return Solution(end, region, one.stable, period)


def by_record(
    model: Model, drive: Excitation, state: Array, stretch: Stretch, period: float
) -> Solution:
    """The cycle, or the rest of a driven pipe, that the last stretch of a motion shows.

    Args:
        model: the model.
        drive: what drives the motion.
        state: last state [p, p'] of the motion.
        stretch: the last stretch.
        period: period after which the motion repeats; 0 at rest.
    """
    count = round((maxima(stretch.turnings).size + 1) * period / float(stretch.t[-1]))
    end = Attractor(drive.mean, -1, "periodic", max(count, 1), stretch.turnings, state)
    if not period:
        end = replace(end, ending="rest", period=0, turnings=stretch.x[-1:].copy())
    span, last = period or drive.period, float(stretch.t[-1])
    curve = scipy.interpolate.CubicSpline(stretch.t, stretch.states)

    def states(phase: Array) -> Array:
        return np.asarray(curve(last - span + 0.5 / math.pi * span * phase).T)

    points = max(POINTS, int(np.count_nonzero(stretch.t > last - span)))
    phases = np.linspace(0.0, 2.0 * math.pi, points, endpoint=False)
    region = around_cycle(model, drive, states, span, max(end.period, 1), phases)
    on = record_points(drive, stretch)
    two = on[-round(2.0 * span / last * len(on)) :]
    scatter = min(2.0 * float(region.distances(two, math.inf).max()), region.radius)
    return Solution(end, region, False, period, scatter=scatter)


def record_points(drive: Excitation, stretch: Stretch) -> Array:
    """States of a record; those of a driven motion at `PHASES` times a period, with its phases."""
    every = round(drive.period / PHASES / float(stretch.t[1] - stretch.t[0])) or 1
    return np.concatenate([stretch.states[::every], drive.phases(stretch.t[::every])], axis=1)


def irregular_motion(model: Model, drive: Excitation, end: Attractor, stretch: Stretch) -> Solution:
    """The solution of a motion that does not repeat, computed from its record."""
    count = max(maxima(stretch.turnings).size, 1)
    unit = float(stretch.t[-1]) / (2.0 * math.pi * count)
    points, same = record_points(drive, stretch), symmetries(drive.field(model))
    region = Region(points, unit, 2.0 * math.pi * unit, driven=bool(drive.period), **same)
    half = len(points) // 2
    first = replace(region, points=region.points[:half])
    apart = float(first.distances(region.points[half::EVERY_FOURTH], math.inf).max())
    region = replace(region, radius=max(2.0 * apart, SAME_ATTRACTOR))
    return Solution(end, region, False, math.nan, scatter=region.radius)
