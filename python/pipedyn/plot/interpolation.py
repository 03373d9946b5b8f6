# SPDX-License-Identifier: MIT
"""A motion between its samples: cubics through positions and velocities; its last cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from pipedyn.models.modular import Assembly
from pipedyn.motion.simulate import Ensemble, Motion
from pipedyn.plot.style import check_type
from pipedyn.util import check
from pipedyn.util.check import Array

COARSE, COARSE_RATE = 0.05, 0.25
"""By how much every other sample may miss those left out: of the range of positions, and of the
largest velocity. Six samples a cycle meet this. A sine is then known to 0.4 % from all samples."""

INVISIBLE = 1e-4
"""Positions in L that differ by less look the same: a twentieth of a pixel at 100 dpi."""

AT_REST = 1e-6
"""A free end that moves by less, in L, has no cycle to show: its motion is error of integration."""

ROUNDING = 1e-9
"""A point that moves by less, in L, is held: its velocity is rounding in the constraints."""

SMALLEST_SWING = 0.1
"""A swing of the free end smaller than this part of its late range is a ripple, not a cycle."""

SAME_STATE = 0.03
"""Difference of heights in L, and of velocities in the largest velocity, below which a state counts
as the same: a curve that misses its start by less looks closed."""

MOST_CROSSINGS = 50
"""Crossings of the middle that one cycle may hold; motion that repeats later is hardly periodic."""

EVERY = slice(None)
"""All samples."""

POINTS = 4000
"""Points of a curve through fewer samples: two for each pixel of a picture 2000 pixels wide."""


def checked_motion(motion: Any, name: str = "motion") -> Motion:
    """The argument, if it is a motion with samples to draw."""
    check_type(name, motion, Motion)
    checked: Motion = motion
    if checked.t.size < 3:
        raise ValueError(f"{name} must have at least 3 samples, got {checked.t.size}")
    return checked


def checked_motions(motions: Any) -> dict[str, Motion]:
    """A motion, several or those of an ensemble, under the names of the argument."""
    if isinstance(motions, Motion):
        return {"motions": checked_motion(motions, "motions")}
    several = motions.motions if isinstance(motions, Ensemble) else motions
    if not isinstance(several, Sequence) or isinstance(several, str):
        raise TypeError(
            f"motions must be a Motion, several of them or an Ensemble, got {check.shown(motions)}"
        )
    if not several:
        raise ValueError("motions must hold at least one, got none")
    names = [f"motions[{i}]" for i in range(len(several))]
    return {name: checked_motion(one, name) for name, one in zip(names, several, strict=True)}


def tip_of(motion: Motion, part: slice = EVERY) -> CubicHermiteSpline:
    """Position (x, y) of the free end at any time between two samples."""
    velocity = motion.model.tip_velocities(motion.q[part].T, motion.qdot[part].T)
    return CubicHermiteSpline(motion.t[part], motion.tip[part], velocity)


def observed_point(motion: Motion, part: slice = EVERY) -> CubicHermiteSpline:
    """Position (x, y) of the point from which cycles are found: the free end, unless it is held.

    Then it is the node of the scene with the largest transverse motion.
    """
    if not isinstance(motion.model, Assembly) or np.ptp(motion.tip[:, 0]) > ROUNDING:
        return tip_of(motion, part)
    x = 3 * int(np.argmax(np.ptp(motion.q[:, 0::3], axis=0)))
    own = slice(x, x + 2)
    return CubicHermiteSpline(motion.t[part], motion.q[part, own], motion.qdot[part, own])


def transverse(point: CubicHermiteSpline) -> CubicHermiteSpline:
    """The transverse position alone."""
    return CubicHermiteSpline(point.x, point(point.x)[:, 0], point(point.x, 1)[:, 0])


def coordinates_at(motion: Motion, times: Array) -> Array:
    """Coordinates at times within the motion's, shape (len(times), coordinates)."""
    part = _around(motion, float(times.min()), float(times.max()))
    return np.asarray(CubicHermiteSpline(motion.t[part], motion.q[part], motion.qdot[part])(times))


def _around(motion: Motion, start: float, end: float) -> slice:
    """The samples that hold a span, two more on either side where there are."""
    first = int(np.searchsorted(motion.t, start, side="right")) - 3
    stop = int(np.searchsorted(motion.t, end, side="left")) + 3
    return slice(max(first, 0), stop)


def refuse_coarse(
    name: str, curve: CubicHermiteSpline, *, invisible: float = 0.0, rates_shown: bool = False
) -> None:
    """Refuse samples too far apart to interpolate.

    Args:
        name: of the argument that is refused.
        curve: through positions and velocities at three samples or more.
        invisible: an error of positions that does not matter.
        rates_shown: whether velocities are shown, too.

    Raises:
        ValueError: if a cubic through every other sample misses those between.
    """
    t, positions, velocities = curve.x, curve(curve.x), curve(curve.x, 1)
    if np.ptp(positions, axis=0).max() < ROUNDING:
        return
    kept = slice(0, None, 2) if t.size % 2 else slice(0, -1, 2)
    left = slice(1, 2 * t[kept].size - 1, 2)
    every_other = CubicHermiteSpline(t[kept], positions[kept], velocities[kept])
    missed = np.abs(every_other(t[left]) - positions[left]).max()
    missed_rate = np.abs(every_other(t[left], 1) - velocities[left]).max()
    # One sample a cycle always finds the same position: only the velocities show that it is wrong.
    missed = max(missed, 0.125 * missed_rate * np.diff(t[kept]).max())
    lost = missed > max(invisible, COARSE * np.ptp(positions, axis=0).max())
    if lost or (rates_shown and missed_rate > COARSE_RATE * np.abs(velocities).max()):
        raise ValueError(
            f"{name} must be sampled at least six times a cycle of the fastest visible motion, got "
            f"samples {np.diff(t).max():.3g} T apart"
        )


def upward_crossings(motion: Motion, start: float, end: float) -> Array:
    """Times in a span at which the free end (or `observed_point`) crosses its middle to the right.

    The middle is the median of its transverse position in the last quarter of the span. A crossing
    counts if the point swings by a tenth of its late range before the next that counts.
    """
    x = transverse(observed_point(motion, _around(motion, start, end)))
    late = x(np.linspace(end - 0.25 * (end - start), end, POINTS))
    crossings = np.asarray(x.solve(float(np.median(late)), extrapolate=False))
    crossings = crossings[(crossings >= start) & (crossings <= end)]  # drops NaN: a piece at rest
    crossings = crossings[x(crossings, 1) > 0.0]
    counted: list[float] = []
    low, high = math.inf, -math.inf
    at = x(x.x)
    stops = np.append(np.searchsorted(x.x, crossings), x.x.size)
    for i in reversed(range(crossings.size)):
        between = at[stops[i] : stops[i + 1]]
        low, high = between.min(initial=low), between.max(initial=high)
        if not counted or high - low > SMALLEST_SWING * np.ptp(late):
            counted.append(float(crossings[i]))
            low, high = math.inf, -math.inf
    return np.array(counted[::-1])


def last_cycle(motion: Motion) -> tuple[float, float] | None:
    """Start and end of the last whole cycle, or None if there is none.

    It ends at the last upward crossing, and starts at the latest earlier one with the same height
    and velocity. Where there is none, as in growing motion, it starts at the crossing before.
    """
    begin, finish = float(motion.t[0]), float(motion.t[-1])
    late = motion.t >= finish - 0.25 * (finish - begin)
    crossings = upward_crossings(motion, begin, finish)
    tip = observed_point(motion)
    if np.ptp(tip(motion.t[late])[:, 0]) < AT_REST or crossings.size < 2:
        return None
    crossings = crossings[-MOST_CROSSINGS - 1 :]
    fastest = np.abs(tip(motion.t[late], 1)).max()
    states = np.column_stack([tip(crossings)[:, 1], tip(crossings, 1) / fastest])
    alike = np.flatnonzero(np.abs(states[:-1] - states[-1]).max(axis=1) < SAME_STATE)
    start = crossings[alike[-1]] if alike.size else crossings[-2]
    return float(start), float(crossings[-1])


def shown_part(motion: Any, span: Any) -> tuple[Motion, float, float, bool]:
    """The motion, start and end of what is shown, and whether that is the last cycle.

    Raises:
        ValueError: for a span outside the motion's times, or samples too far apart.
        TypeError: for bad arguments.
    """
    motion = checked_motion(motion)
    begin, finish = float(motion.t[0]), float(motion.t[-1])
    cycle = last_cycle(motion) if span is None else None
    start, end = (begin, finish) if cycle is None else cycle
    if span is not None:
        start, end = (float(time) for time in check.array("span", span, size=2))
    if not begin <= start < end <= finish:
        raise ValueError(
            f"span must be a start and a later end within the motion's times, "
            f"[{begin:g}, {finish:g}], got {check.shown(span)}"
        )
    refuse_coarse("motion", tip_of(motion, _around(motion, start, end)), invisible=INVISIBLE)
    return motion, start, end, cycle is not None


def finer(t: Array) -> Array:
    """Times between which straight lines look like the curve, the samples among them."""
    parts = min(8, -(-POINTS // t.size))
    steps = np.arange(parts) / parts
    return np.append((t[:-1, None] + np.diff(t)[:, None] * steps).ravel(), t[-1])
