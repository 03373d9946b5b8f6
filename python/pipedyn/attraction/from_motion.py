# SPDX-License-Identifier: MIT
"""The cycle near the last period of a motion that comes back to an earlier state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipedyn.attraction.records import Stretch
from pipedyn.models.base import Model
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.orbits.collocation import solved
from pipedyn.orbits.floquet import LARGEST_ERROR, circle_margin, nontrivial, orbit_multipliers
from pipedyn.orbits.orbit_continuation import COARSE, FINE, solved_anew
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, interpolated, refined
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

WHILE_NEAR = 5, 0.05
"""Number of Newton steps from a motion's last period after which no cycle is taken to be near: the
search took one to three steps for the cycles of seven pipes. Second, size of a slow step, relative
to the cycle, beyond which none is: on the way to 486 cycles of random pipes slow steps were at most
0.024, and of 146 searches in vain, mostly from chaotic motions, this ends most in two steps. At
a first step beyond four times this size `newton` ends at once, as 9 of 31 such searches do; the
first step towards each of 43 cycles was at most 0.046."""

NEARLY_PLANAR = 0.1
"""Share of a motion across a plane up to which a cycle in that plane is looked for."""

LARGEST_CHANGE = 0.3
"""Largest change of a motion in a period, relative to its size, with which a cycle of that period
is taken to be near. Chaotic motions change by 0.47 or more while one state of theirs comes back; of
31 motions near cycles of five pipes, all but one changed by less than 0.05."""

REST_EXTENT = 1e-5
"""Peak-to-peak value of an orbit, in rad or in coordinates of a reduced model, below which it is at
rest."""

ROUGHLY, CLOSELY = 1e-3, 1e-6
"""Shares of its range up to which rounds of an orbit count as the same, on its first mesh and when
it is known: near a period doubling motions repeat only after two rounds for long, and the orbit
solved for from them may be the cycle of one round, run through twice."""

WEIGHTS: Array = np.array([(-1.0) ** j * math.comb(7, j) for j in range(8)])
"""Weights of the polynomial through eight evenly spaced samples, in the barycentric form."""

LARGEST_CYCLE = 100
"""Largest number of degrees of freedom of a cycle that is solved for. An undamped chain of 20 takes
0.05 s, of 40 0.3 s, of 100 four seconds, half of it for the multipliers."""


def last_period(stretch: Stretch, farthest: float) -> tuple[Callable[[Array], Array], float]:
    """States of the last period of a motion as a function of phases, and the period's frequency.

    Args:
        stretch: the last stretch of the motion.
        farthest: largest distance from the earlier state, relative to the motion's size.

    Raises:
        NewtonFailed: if the motion stays farther away, or comes back in one state only.
    """
    back, first, last, _ = stretch.recurrence
    if not back <= farthest or stretch.last_change > LARGEST_CHANGE:
        raise NewtonFailed("the motion does not come back to an earlier state")
    begin, end = np.searchsorted(stretch.t, [first, last])
    some = slice(max(int(begin) - 8, 0), int(end) + 9)
    times, samples = stretch.t[some], stretch.states[some]
    frequency = 2.0 * math.pi / (last - first)

    def states(phase: Array) -> Array:
        t = first + phase / frequency
        at = np.clip(np.searchsorted(times, t) - 4, 0, len(times) - 8)[:, None] + np.arange(8)
        away = t[:, None] - times[at]
        shares = WEIGHTS / np.where(away == 0.0, 1e-100, away)
        shares /= shares.sum(axis=1, keepdims=True)
        return np.ascontiguousarray(np.matmul(shares[:, None], samples[at])[:, 0].T)

    return states, frequency


def solved_cycle(
    model: Model, drive: Excitation, stretch: Stretch, farthest: float
) -> tuple[PeriodicOrbit, bool]:
    """The cycle near the last period of a motion, and whether its multipliers say that it attracts.

    Args:
        model: the model.
        drive: what drives the motion, from the beginning of a period on.
        stretch: as for `last_period`.
        farthest: as for `last_period`.

    Raises:
        NewtonFailed: as `last_period` does; if no cycle is found near the motion's last period; or
            if its multipliers are not known.
    """
    motion, u = drive.field(model, stretch.recurrence[3]), drive.mean
    flat = motion.mirrored_in_z and drive.force is None
    if flat and (planar := _planar(model, stretch)) is not None:
        orbit, _ = solved_cycle(model.planar, drive, planar, farthest)
        times = round(2.0 * math.pi / (orbit.frequency * drive.period)) if drive.period else 1
        return _with_stability(model, drive, drive.field(model, times), orbit.in_space(model))
    if motion.axisymmetric and not motion.forced:
        raise NewtonFailed("no cycle is solved for that is neither planar nor circular")
    if model.dof > LARGEST_CYCLE:
        raise NewtonFailed(f"no cycle is solved for with more than {LARGEST_CYCLE} freedoms")
    states, frequency = last_period(stretch, farthest)
    orbit = solved_anew(motion, states, frequency, u, False, COARSE, *WHILE_NEAR, from_samples=True)
    if orbit.size < REST_EXTENT:
        raise NewtonFailed("the motion comes to rest")
    for within in (ROUGHLY, CLOSELY):
        motion, once = run_through_once(motion, orbit, within)
        if once is orbit and within == CLOSELY:
            break
        frequency = once.frequency
        orbit = solved_anew(motion, once.states, frequency, u, False, FINE, *WHILE_NEAR)
    if model.pipe.has_kinks and model.kinks_known:  # multipliers need a mesh with points at kinks
        twice = np.full(len(orbit.starts), 2)
        orbit = solved(motion, refined(motion, orbit, twice, at_kinks=True), FINE.tolerance)
    return _with_stability(model, drive, motion, orbit)


def _with_stability(
    model: Model, drive: Excitation, motion: VectorField, orbit: PeriodicOrbit
) -> tuple[PeriodicOrbit, bool]:
    """The orbit, and whether all multipliers but those of shifts and turns are in the circle."""
    others, _, error = orbit_multipliers(motion, orbit, FINE.stagnation)
    if not error <= LARGEST_ERROR:
        raise NewtonFailed(f"its multipliers are known to {error:.1e} only")
    for _ in range((not drive.period) + motion.axisymmetric):
        others = nontrivial(others)
    return orbit, float(np.abs(others).max(initial=0.0)) < 1.0 - circle_margin(error)


def _planar(model: Model, stretch: Stretch) -> Stretch | None:
    """The stretch in the plane z = 0, if the motion in three dimensions nearly lies in it."""
    columns = np.tile(model.from_plane(np.ones(model.planar.integrated)) > 0.0, 2)
    spans = np.ptp(stretch.states[stretch.t.size // 2 :], axis=0)
    if spans[~columns].max() > NEARLY_PLANAR * spans[columns].max():
        return None
    return replace(stretch, states=np.ascontiguousarray(stretch.states[:, columns]))


def run_through_once(
    motion: VectorField, orbit: PeriodicOrbit, within: float
) -> tuple[VectorField, PeriodicOrbit]:
    """One round of an orbit that consists of several equal rounds, with its vector field.

    Args:
        motion: the vector field of the orbit.
        orbit: orbit; the result is interpolated from it, not solved for.
        within: share of its range up to which states of several rounds count as the same.
    """
    order = motion.order if motion.forced else 0
    phases = np.linspace(0.0, 2.0 * math.pi, 8 * len(orbit.starts) + 1)
    _, across, _ = motion.end_across(orbit.states(phases))
    most = int(np.count_nonzero((across[1:-1] >= across[:-2]) & (across[1:-1] > across[2:]))) + 1
    phases, times = np.linspace(0.0, 2.0 * math.pi, 17), order or most
    largest = within * np.ptp(orbit.starts)
    while times > 1:
        apart = orbit.states(phases + 2.0 * math.pi / times) - orbit.states(phases)
        if order % times == 0 and np.abs(apart).max() <= largest:
            break
        times -= 1
    if times <= 1:
        return motion, orbit
    motion = motion.of_order(order // times)

    def once(phase: Array) -> Array:
        return orbit.states(phase / times)

    edges = np.linspace(0.0, 2.0 * math.pi, len(orbit.starts) + 1)
    return motion, interpolated(motion, once, edges, times * orbit.frequency, orbit.u)
