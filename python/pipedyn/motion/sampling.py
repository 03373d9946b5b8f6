# SPDX-License-Identifier: MIT
"""Samples of a motion: how many are needed to draw it, and the turning points of their cubics."""

from __future__ import annotations

import math

import numpy as np

from pipedyn.models.space import nearest_plane
from pipedyn.util.check import Array

ROUND = 0.95
"""Ratio of the axes of an ellipse above which a motion has no farthest direction."""

LEAST_MOTION = 1e-9
"""Motion of a point, in L, below which the point counts as held by a support: its velocity is then
the rounding error of the constraints."""

INVISIBLE = 1e-4
"""Distance in L that cannot be seen in a picture: a twentieth of a pixel at 100 dots an inch."""

FEWEST, FINEST = 4, 128
"""Least and largest number of parts into which times between default samples are divided."""

A_CYCLE = 12.0
"""Number of the finest samples in a cycle of the fastest mode: twice as many as small motion needs,
since large motion is faster than small motion."""

A_TURN = 384.0
"""Number of the finest samples in a turn of the part of the pipe that turns fastest at the start. A
whirling pipe cracks like a whip: without damping the free end of 20 segments needs more than 80."""

MOST_NUMBERS = 16_000_000
"""Largest number of values in the finest samples, 128 MB; longer motions have coarser samples."""


def farthest_direction(positions: Array) -> Array:
    """Direction across the pipe in which a point moves farthest from its mean, as a unit vector.

    Positions are (x, y), shape (S, 2), where it is (1, 0), or (x, y, z), shape (S, 3), where z is
    0 for motions in the plane z = 0, and for those that are nearly circular.
    """
    direction = np.eye(positions.shape[1])[0]
    if len(direction) == 2:
        return direction
    across = positions[:, ::2] - positions[:, ::2].mean(axis=0)
    azimuth = float(nearest_plane(*across.T))
    way = np.array([math.cos(azimuth), math.sin(azimuth)])
    if np.linalg.norm(across @ (-way[1], way[0])) < ROUND * np.linalg.norm(across @ way):
        direction[::2] = way
    return direction * np.sign(direction[np.abs(direction).argmax()])


def coarse(
    times: Array,
    positions: Array,
    velocities: Array,
    invisible: float = 0.0,
    *,
    rates_shown: bool = False,
) -> bool:
    """Whether samples are too far apart, so that cubics through every other one miss the rest.

    The cubics may miss positions by 5 % of their range or by `invisible`, and velocities, if these
    are shown, by 25 % of the largest one. Six samples in a cycle meet this; cubics through all
    samples then give a sine to 0.4 %.

    Args:
        times: times of the samples, shape (S,).
        positions: positions of a point, shape (S,) or (S, 2).
        velocities: velocities of the point, of the shape of the positions.
        invisible: distance by which the cubics may always miss, since it cannot be seen.
        rates_shown: whether velocities must be right as well.
    """
    kept = times.size - 1 + times.size % 2  # odd, so that the cubics end at the last sample
    t, positions, velocities = times[:kept], positions[:kept], velocities[:kept]
    if t.size < 3 or np.ptp(positions, axis=0).max() < LEAST_MOTION:
        return False
    t = t.reshape(-1, *[1] * (positions.ndim - 1))
    step, begin = t[2::2] - t[:-1:2], positions[:-1:2]
    share, mean = (t[1::2] - t[:-1:2]) / step, (positions[2::2] - begin) / step
    bend = 3.0 * mean - 2.0 * velocities[:-1:2] - velocities[2::2]
    rest = velocities[:-1:2] + velocities[2::2] - 2.0 * mean
    at = begin + step * share * (velocities[:-1:2] + share * (bend + share * rest))
    rate = velocities[:-1:2] + share * (2.0 * bend + 3.0 * share * rest)
    missed_rate = np.abs(rate - velocities[1::2]).max()
    # With one sample in a cycle all positions are the same, and only velocities show the motion.
    missed = max(np.abs(at - positions[1::2]).max(), 0.125 * missed_rate * step.max())
    lost = bool(missed > max(invisible, 0.05 * np.ptp(positions, axis=0).max()))
    return lost or (rates_shown and bool(missed_rate > 0.25 * np.abs(velocities).max()))


def turning_points(t: Array, x: Array, velocity: Array) -> Array:
    """Values of x at its turning points, in order: those of the cubics through the samples."""
    step, slope, last = np.diff(t), velocity[:-1], velocity[1:]
    mean = np.diff(x) / step
    bend, rest = (3.0 * mean - 2.0 * slope - last) / step, (slope + last - 2.0 * mean) / step**2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -(bend + np.copysign(np.sqrt(bend**2 - 3.0 * rest * slope), bend))
        roots = slope / root, root / (3.0 * rest)
        since = np.stack([np.minimum(*roots), np.maximum(*roots)], axis=1)
        within = (since >= 0.0) & (since < step[:, None])
    place, since = np.nonzero(within)[0], since[within]
    return np.asarray(
        x[place] + since * (slope[place] + since * (bend[place] + since * rest[place]))
    )


def maxima(turnings: Array) -> Array:
    """Maxima among turning points, without the first and the last turning point."""
    inner = turnings[1:-1]
    return np.asarray(inner[(inner > turnings[:-2]) & (inner > turnings[2:])])
