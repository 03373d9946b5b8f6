# SPDX-License-Identifier: MIT
"""How many samples show a motion: cubics through positions and velocities must follow it."""

from __future__ import annotations

import numpy as np

from pipedyn.util.check import Array
from pipedyn.util.later import scipy

LEAST_MOTION = 1e-9
"""A point that moves by less, in L, is held: its velocity is rounding in the constraints."""

INVISIBLE = 1e-4
"""In L: a twentieth of a pixel of a picture of the pipe at 100 dots an inch."""

FEWEST, FINEST = 4, 128
"""Parts into which the times between a motion's default samples are divided, powers of 2."""

A_CYCLE = 12.0
"""Samples of the finest a cycle of the fastest mode: twice as many as are needed, since large
motion is faster than small."""

A_TURN = 384.0
"""Samples of the finest a turn of the fastest part of the pipe at the start: a whirling pipe cracks
like a whip, and of 20 segments without damping the free end then needs more than 80."""

MOST_NUMBERS = 16_000_000
"""Numbers that these samples may hold, 128 MB; where that is too few they are less fine."""


def coarse(
    times: Array,
    positions: Array,
    velocities: Array,
    invisible: float = 0.0,
    *,
    rates_shown: bool = False,
) -> bool:
    """Whether samples are too far apart: a cubic through every other sample misses the others.

    It may miss them by 5 % of the range of positions or by `invisible`, and by 25 % of the largest
    velocity if velocities are shown. Six samples a cycle meet this; a sine is then known to 0.4 %
    from all samples.

    Args:
        times: shape (S,).
        positions: shape (S,) or (S, 2).
        velocities: shape of positions.
        invisible: distance that no picture shows.
        rates_shown: whether velocities are to be right as well.
    """
    kept = times.size - 1 + times.size % 2  # ends with a sample that is kept
    t, positions, velocities = times[:kept], positions[:kept], velocities[:kept]
    if t.size < 3 or np.ptp(positions, axis=0).max() < LEAST_MOTION:
        return False
    every_other = scipy.interpolate.CubicHermiteSpline(t[::2], positions[::2], velocities[::2])
    missed = np.abs(every_other(t) - positions).max()
    missed_rate = np.abs(every_other(t, 1) - velocities).max()
    # One sample a cycle always finds the same position: only the velocities show that it is wrong.
    missed = max(missed, 0.125 * missed_rate * np.diff(t[::2]).max())
    lost = bool(missed > max(invisible, 0.05 * np.ptp(positions, axis=0).max()))
    return lost or (rates_shown and bool(missed_rate > 0.25 * np.abs(velocities).max()))
