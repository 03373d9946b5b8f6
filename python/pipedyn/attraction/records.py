# SPDX-License-Identifier: MIT
"""What a stretch of a motion shows: rest, repetition, approach, or averages that converge.

The free end's turning points, where its transverse velocity changes sign, are those of cubics
through samples. At rest there is none, a cycle leaves a few values, a torus or chaos many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from pipedyn.motion.sampling import maxima, turning_points
from pipedyn.util.check import Array

AT_REST = 1e-5
"""Range of the tip, in L, below which it is at rest: ten times what rtol = 1e-6 lets it err."""

RECURRENCE = 1e-3
"""By how much maxima that still converge may differ from those a period before, relative to the
range: beyond, a record is too short to show that they do."""

GROWN = 1.5
"""Factor by which a change over two periods may exceed that over one where both are errors: of a
motion that drifts it is 2."""

FASTER, CONVERGED = 0.15, 1e-3
"""Share of their differences that weighted averages over twice the time may keep if they converge
faster than any power of it, as on a torus only: chaotic ones keep about 0.7. And what is left of
them then, relative to the spread of what is averaged."""

Trend = Literal["rest", "periodic", "settling", "irregular"]


@dataclass(frozen=True)
class Stretch:
    """What a motion did over some time.

    Attributes:
        t: times of evenly spaced samples, shape (S,).
        states: [p, p'], shape (S, 2 integrated).
        x: transverse positions of the tip, shape (S,).
        turnings: values of x where its velocity changes sign, in order, shape (K,).
        error: by how much two of these may err together.
        rtol: relative tolerance to which the motion was integrated.
        trend: "rest", "periodic" (maxima repeat to the error, or converge geometrically to such),
            "settling" (it still approaches rest or a cycle) or "irregular".
        maxima: of x in a period, 0 unless "periodic".
    """

    t: Array
    states: Array
    x: Array
    turnings: Array
    error: float
    rtol: float
    trend: Trend
    maxima: int

    @staticmethod
    def of(t: Array, states: Array, x: Array, velocity: Array, rtol: float) -> Stretch:
        """The stretch of a motion, with its turning points and trend.

        Args:
            t: times of samples, (S,).
            states: [p, p'] there, (S, 2 integrated).
            x: transverse position of the tip there, (S,).
            velocity: of the tip in x, (S,).
            rtol: relative tolerance to which the motion was integrated.
        """
        turnings, error = turning_points(t, x, velocity)
        # Errors of an integrator's steps add up over the ten or more that a period takes.
        error += 10.0 * rtol * float(np.ptp(x))
        return Stretch(t, states, x, turnings, error, rtol, *trend_of(x, turnings, error))

    def seems_settled(self) -> bool:
        """Whether it is at rest in the end, or three periods show no change that could be seen."""
        if self.trend == "rest":
            return True
        highs = maxima(self.turnings)
        periods = range(1, highs.size // 3 + 1)
        return any(_largest_change(highs[-3 * k :], k) <= self.error for k in periods)

    def recurrence(self, drive: float) -> tuple[float, float, float, int]:
        """How near the state comes back to an earlier one, relative to its size in the later half.

        Compared are the states at which the tip passes the middle of its range to positive x or, if
        the motion is driven, those whole periods of the drive apart.

        Args:
            drive: period of what drives the motion, 0 where all is steady.

        Returns:
            The distance, infinite where nothing is compared; the times at which the shortest period
            begins and ends whose distance is at most twice the least or 0.01; and how many
            passages, or periods of the drive, it holds.
        """
        times, passed = self._passages(drive)
        if times.size < 2:
            return math.inf, 0.0, 0.0, 0
        back = np.abs(passed[:-1] - passed[-1]).max(axis=1)[::-1]
        turns = int(np.flatnonzero(back <= max(2.0 * float(back.min()), 0.01))[0])
        return float(back[turns]), float(times[-2 - turns]), float(times[-1]), turns + 1

    def repeats(self, drive: float) -> float:
        """The period after which the motion repeats, as three of them show; 0 if none does.

        What two periods change may not be more than what one does: near a resonance a motion on a
        torus drifts by as little from one to the next, but on and on, and so does one that comes
        nearer to a cycle slowly. Several of such periods are none either.

        Args:
            drive: period of what drives the motion, 0 where all is steady.
        """
        times, passed = self._passages(drive)
        drifting = list[int]()
        for turns in range(1, (times.size - 1) // 3 + 1):
            if any(turns % some == 0 for some in drifting):
                continue
            once = float(np.abs(passed[turns:] - passed[:-turns]).max())
            if once < RECURRENCE:
                twice = float(np.abs(passed[2 * turns :] - passed[: -2 * turns]).max())
                if twice < max(GROWN * once, 30.0 * self.rtol):
                    last = times.size - 1
                    return float(times[last] - times[last % turns]) / (last // turns)
                drifting.append(turns)
        return 0.0

    def _passages(self, drive: float) -> tuple[Array, Array]:
        """Times, (k,), and states, (k, 2 integrated), that are compared.

        Each position and rate is in units of how far it ranges in the later half, or of a
        thousandth of how far the position or rate does that ranges farthest.
        """
        if drive:
            every = round(drive / float(self.t[1] - self.t[0]))
            at = np.arange(self.t.size - 1, -1, -every)[::-1]
            times, states = self.t[at], self.states[at]
        else:
            late = self.x[self.x.size // 2 :]
            across = self.x - 0.5 * (late.max() + late.min())
            at = 1 + np.flatnonzero((across[1:-2] < 0.0) & (across[2:-1] >= 0.0))
            nodes = at[:, None] + np.arange(-1, 3)
            rise = across[at + 1] - across[at]
            share = -across[at] / rise
            for _ in range(4):  # the root of the cubic through four samples
                share -= np.sum(_lagrange(share) * across[nodes], axis=1) / rise
            times = self.t[at] + share * (self.t[at + 1] - self.t[at])
            states = np.einsum("kn,kns->ks", _lagrange(share), self.states[nodes])
        scale = np.ptp(self.states[self.t.size // 2 :], axis=0).reshape(2, -1)
        scale = np.maximum(scale, 1e-3 * scale.max(axis=1, keepdims=True)).ravel()
        return (times, states / scale) if scale.all() else (times[:0], states[:0])

    def averages_converge(self) -> bool:
        """Whether averages over its time show that it is quasi-periodic, or periodic.

        Averages with a weight that is smooth and ends with all derivatives 0 converge faster than
        any power of the time on a torus, and like its square root where motion is chaotic.

        Source: Das, Saiki, Sander and Yorke (2017), Quantitative quasiperiodicity, Nonlinearity 30.
        """
        half = self.states.shape[1] // 2
        p = self.states[:, :half]
        observed = np.concatenate(
            [self.states, np.sin(p), p**2, self.states[:, half:] ** 2], axis=1
        )
        spread = observed.std(axis=0)
        observed = observed[:, spread > 1e-6 * spread.max()]
        observed = observed / observed.std(axis=0)

        def apart(parts: int) -> float:
            """Largest difference between averages over parts of equal length."""
            size = len(observed) // parts
            share = (np.arange(size) + 0.5) / size
            weight = np.exp(-1.0 / (share * (1.0 - share)))
            weight /= weight.sum()
            means = [weight @ observed[k * size : (k + 1) * size] for k in range(parts)]
            return float(np.ptp(means, axis=0).max())

        twice, once = apart(4), apart(2)
        return once <= CONVERGED and once <= FASTER * twice


def _lagrange(share: Array) -> Array:
    """Weights of evenly spaced samples 1 before to 2 beyond, at shares of the way, (k, 4)."""
    a, b, c, d = share + 1.0, share, share - 1.0, share - 2.0
    return np.stack([-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0], axis=1)


def trend_of(x: Array, turnings: Array, error: float) -> tuple[Trend, int]:
    """What kind of motion the samples x of the tip and its turning points show, and its period.

    Two turning points may differ by the error although the motion repeats.
    """
    quarters = [float(np.ptp(part)) for part in np.array_split(x, 4)]
    if quarters[-1] < AT_REST:
        return "rest", 0
    highs = maxima(turnings)
    near = RECURRENCE * quarters[-1]
    approaching = all(b < a for a, b in pairwise(quarters)) and quarters[-1] < 0.8 * quarters[0]
    for period in range(1, highs.size // 3 + 1):
        change = np.abs(highs[period:] - highs[:-period])
        recurs = bool(change.max() < near)
        if recurs and _drift(highs, period) <= error:
            return "periodic", period
        if change.size < 4 * period:
            continue
        # A Floquet multiplier that still acts shrinks the changes by a constant factor. Near a
        # torus they may shrink for a while as well, but not twice as much in each quarter. Where
        # one acts slowly, changes are too small to be seen from one period to the next.
        changes = (float(part.max()) for part in np.array_split(change, 4))
        drifts = (_drift(part, period) if recurs else 0.0 for part in np.array_split(highs, 4))
        parts = [max(*both, error) for both in zip(changes, drifts, strict=True)]
        converges = all(b <= max(0.5 * a, error) for a, b in pairwise(parts))
        if recurs and converges:
            return "periodic", period
        approaching |= converges or (recurs and all(b < a for a, b in pairwise(parts)))
    return ("settling" if approaching else "irregular"), 0


def _drift(highs: Array, period: int) -> float:
    """The largest difference of two maxima that lie whole periods apart."""
    return max(float(np.ptp(highs[k::period])) for k in range(min(period, highs.size)))


def _largest_change(highs: Array, period: int) -> float:
    return float(np.abs(highs[period:] - highs[:-period]).max())
