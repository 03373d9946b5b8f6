# SPDX-License-Identifier: MIT
"""A motion between its samples: cubics through positions and velocities; its last cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from pipedyn.bifurcation.cycles import LimitCycle
from pipedyn.motion.simulate import Ensemble, Motion
from pipedyn.plot import common
from pipedyn.util import check
from pipedyn.util.check import Array

ROUNDING = 1e-9
"""A point that moves by less, in L, is held: its velocity is rounding in the constraints."""

POINTS = 4000
"""Points of a curve through fewer samples: two for each pixel of a picture 2000 pixels wide."""


def checked_motion(motion: Any, name: str = "motion") -> Motion:
    """The argument, if it is a motion with samples to draw."""
    checked: Motion = common.check_type(name, motion, Motion)
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
    return {f"motions[{i}]": checked_motion(m, f"motions[{i}]") for i, m in enumerate(several)}


def tip_of(motion: Motion | LimitCycle) -> CubicHermiteSpline:
    """Position (x, y) of the free end at any time between two samples."""
    return CubicHermiteSpline(motion.t, motion.tip, motion.tip_velocity)


def first_component(curve: CubicHermiteSpline) -> PPoly:
    """Of a position (x, y) the transverse one alone."""
    return PPoly(curve.c[..., 0], curve.x)


def coordinates_at(motion: Motion, times: Array) -> Array:
    """Coordinates at times within the motion's, shape (len(times), coordinates)."""
    return np.asarray(CubicHermiteSpline(motion.t, motion.q, motion.qdot)(times))


def _observed(motion: Motion) -> CubicHermiteSpline:
    """What cycles are found from: the position of the free end.

    Where that is held, it is all coordinates, the one that moves most first.
    """
    if np.ptp(motion.tip[:, 0]) > ROUNDING:
        return tip_of(motion)
    order = np.argsort(-np.ptp(motion.q, axis=0))
    return CubicHermiteSpline(motion.t, motion.q[:, order], motion.qdot[:, order])


def refuse_coarse(
    name: str, curve: PPoly, *, invisible: float = 0.0, rates_shown: bool = False
) -> None:
    """Refuse samples too far apart: a cubic through every other sample misses the others.

    It may miss them by 5 % of the range of positions or by `invisible`, and by 25 % of the largest
    velocity if velocities are shown. Six samples a cycle meet this; a sine is then known to 0.4 %
    from all samples.
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
    lost = missed > max(invisible, 0.05 * np.ptp(positions, axis=0).max())
    if lost or (rates_shown and missed_rate > 0.25 * np.abs(velocities).max()):
        raise ValueError(
            f"{name} must be sampled at least six times a cycle of the fastest visible motion, got "
            f"samples {np.diff(t).max():.3g} T apart"
        )


def last_cycle(motion: Motion) -> tuple[float, float] | None:
    """Start and end of the last whole cycle, or None if there is none.

    It ends at the last upward crossing, and starts at the latest earlier one with the same state:
    a curve that misses its start by 3 % looks closed. Where there is none, as in growing motion, it
    starts at the crossing before.
    """
    late = motion.t[motion.t >= motion.t[-1] - 0.25 * np.ptp(motion.t)]
    observed = _observed(motion)
    if np.ptp(observed(late)[:, 0]) < 1e-6:  # at rest but for errors of integration
        return None
    crossings = _upward_crossings(first_component(observed))[-51:]  # of more, none is periodic
    if crossings.size < 2:
        return None
    rates = observed(crossings, 1) / np.abs(observed(late, 1)).max()
    states = np.column_stack([observed(crossings)[:, 1:], rates])
    same = np.flatnonzero(np.abs(states[:-1] - states[-1]).max(axis=1) < 0.03)
    return float(crossings[same[-1] if same.size else -2]), float(crossings[-1])


def _upward_crossings(x: PPoly) -> Array:
    """Times at which a curve rises through its middle, its median in the last quarter of time.

    A crossing counts if the curve swings by a tenth of its late range before the next one, as does
    the last: a smaller swing is a ripple, not a cycle.
    """
    t = x.x
    late = x(np.linspace(t[-1] - 0.25 * (t[-1] - t[0]), t[-1], POINTS))
    crossings = np.asarray(x.solve(float(np.median(late)), extrapolate=False))
    crossings = crossings[x(crossings, 1) > 0.0]  # drops NaN, too: a piece at rest
    between = np.split(x(t), np.searchsorted(t, crossings))[1:]
    swings = np.array([np.ptp(part) if part.size else 0.0 for part in between])
    swings[-1:] = math.inf
    return np.asarray(crossings[swings > 0.1 * np.ptp(late)])


def shown_part(motion: Any, span: Any) -> tuple[Motion, float, float, bool]:
    """The samples of what is shown, its start and end, and whether that is the last cycle."""
    motion = checked_motion(motion)
    begin, finish = float(motion.t[0]), float(motion.t[-1])
    cycle = last_cycle(motion) if span is None else None
    start, end = cycle or (begin, finish)
    if span is not None:
        start, end = map(float, check.array("span", span, size=2))
    if not begin <= start < end <= finish:
        raise ValueError(
            f"span must be a start and a later end within the motion's times, "
            f"[{begin:g}, {finish:g}], got {check.shown(span)}"
        )
    # The samples that hold the span, two more on either side where there are.
    first = max(int(np.searchsorted(motion.t, start, side="right")) - 3, 0)
    held = slice(first, int(np.searchsorted(motion.t, end, side="left")) + 3)
    names = ("t", "q", "qdot", "tip", "energy")
    shown = replace(motion, **{name: getattr(motion, name)[held] for name in names})
    refuse_coarse("motion", tip_of(shown), invisible=1e-4)  # L: a twentieth of a pixel at 100 dpi
    return shown, start, end, cycle is not None


def finer(t: Array) -> Array:
    """Times between which straight lines look like the curve, the samples among them."""
    parts = min(8, -(-POINTS // t.size))
    return np.interp(np.arange((t.size - 1) * parts + 1) / parts, np.arange(t.size), t)
