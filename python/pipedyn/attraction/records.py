# SPDX-License-Identifier: MIT
"""Stretches of motions, which show rest, repetition, approach, or averages that converge.

The free end's turning points, where its transverse velocity changes sign, are computed from cubics
through samples. A motion at rest has none, a cycle has a few values, a torus or chaos has many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from pipedyn.motion.sampling import turning_points
from pipedyn.util.check import Array

AT_REST = 1e-5
"""Range of the tip, in L, below which it is at rest: ten times its error with rtol = 1e-6."""

RECURRENCE = 1e-3
"""Largest difference, relative to the range, between maxima that still converge and those a period
before: if it is larger, a record is too short to show that they converge."""

DRIFT_FACTOR = 1.5
"""Factor by which a change over two periods may exceed a change over one period if both are errors:
for a motion that drifts the factor is 2."""

ERROR_FACTOR = 30.0
"""Change of states in two periods, relative to their ranges and to the tolerance of a step, that
errors of all their steps explain."""

AVERAGE_SHARE, AVERAGE_ERROR, EXACT_AVERAGE = 0.15, 1e-3, 1e-8
"""Largest share of their differences that weighted averages keep over twice the time if they
converge faster than any power of the time, as they do only on a torus: averages of chaotic motions
keep about 0.7. Second, the largest difference that may then be left, relative to the spread of the
averaged quantity. Third, the error of the motion itself, below which differences fall no more: they
were 1e-9 at most for circular motions in a pulsating flow."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A motion over some time, sampled.

    Attributes:
        t: times of evenly spaced samples, shape (S,).
        states: [p, p'], shape (S, 2 integrated).
        x: transverse positions of the tip, shape (S,).
        velocity: transverse velocities of the tip, shape (S,).
        rtol: relative tolerance to which the motion was integrated.
        drive: period of what drives the motion, 0 where all is steady.
        axisymmetric: whether a turn of states about the axis of the pipe changes nothing.
    """

    t: Array
    states: Array
    x: Array
    velocity: Array
    rtol: float
    drive: float = 0.0
    axisymmetric: bool = False

    def joined(self, later: Stretch) -> Stretch:
        """Joins the stretch with one that begins where it ends, with samples as far apart."""
        both: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(later, name)[1:]])
            for name in ("states", "x", "velocity")
        }
        return replace(self, t=np.append(self.t, self.t[-1] + later.t[1:]), **both)

    @cached_property
    def turnings(self) -> Array:
        """Values of x where its velocity changes sign, in order, shape (K,)."""
        return turning_points(self.t, self.x, self.velocity)

    @cached_property
    def turns(self) -> Array:
        """How fast the motion goes round the axis, from x to z: 1 if circular, as many as turnings.

        At some samples it is the sum of x z' - z x' over positions, relative to the largest. For a
        motion in three dimensions only.
        """
        x, z, by_x, by_z = np.split(self.states[:: len(self.t) // max(self.turnings.size, 1)], 4, 1)
        largest = np.linalg.norm([x, z], axis=(0, 2)) * np.linalg.norm([by_x, by_z], axis=(0, 2))
        return np.round(np.sum(x * by_z - z * by_x, axis=1) / largest.max(), 3)

    @cached_property
    def recurrence(self) -> tuple[float, float, float, int]:
        """Smallest distance of a state from an earlier one, relative to its size in the later half.

        The states compared are those at which the tip passes the middle of its range towards
        positive x or, if the motion is driven, those that are whole periods of the drive apart.

        Returns:
            The distance, infinite if no states are compared; the times at which the shortest period
            begins and ends whose distance is at most twice the least or 0.01; and the number of
            passages, or of periods of the drive, in that period.
        """
        times, passed = self._passages
        if times.size < 2:
            return math.inf, 0.0, 0.0, 0
        back = np.abs(passed[:-1] - passed[-1]).max(axis=1)[::-1]
        turns = int(np.flatnonzero(back <= max(2.0 * float(back.min()), 0.01))[0])
        return float(back[turns]), float(times[-2 - turns]), float(times[-1]), turns + 1

    @cached_property
    def last_change(self) -> float:
        """Largest change of the states in the last period of `recurrence`, as far as recorded.

        It is relative to the motion's size, like the distance of the one state that came back.
        """
        _, passed = self._passages
        turns = self.recurrence[3]
        return float(np.abs((passed[turns:] - passed[:-turns])[-turns:]).max())

    @cached_property
    def period(self) -> float:
        """Period after which the motion repeats, as three periods show; 0 if it does not repeat.

        Two periods may not change the state more than one does, nor two late ones: near a resonance
        a motion on a torus drifts by as little from one period to the next, but on and on, and so
        does a motion that comes nearer to a cycle slowly. Several periods of a drifting motion are
        no period either.
        """
        times, passed = self._passages
        drifting = list[int]()
        for turns in self._returns(RECURRENCE, (times.size - 1) // 3):
            if any(turns % some == 0 for some in drifting):
                continue
            if np.abs(passed[turns:] - passed[:-turns]).max() < RECURRENCE:
                # At first the end of a transient may change more than the drift.
                late = passed[len(passed) // 2 - turns :]
                if not self._drifts(passed, turns) and not self._drifts(late, turns):
                    last = times.size - 1
                    return float(times[last] - times[last % turns]) / (last // turns)
                drifting.append(turns)
        return 0.0

    def _drifts(self, passed: Array, turns: int) -> bool:
        """Whether twice a number of passages changes states by more than errors and once does."""
        once, twice = (np.abs(passed[k:] - passed[:-k]).max() for k in (turns, 2 * turns))
        return bool(twice >= max(DRIFT_FACTOR * once, ERROR_FACTOR * self.rtol))

    @cached_property
    def trend(self) -> Literal["rest", "periodic", "settling", "irregular"]:
        """Whether the motion rests, repeats, still comes nearer to rest or a cycle, or neither."""
        quarters = [float(np.ptp(part)) for part in np.array_split(self.x, 4)]
        if quarters[-1] < AT_REST:
            return "rest"
        if self.period:
            return "periodic"
        if quarters[-1] < 0.8 * quarters[0] and all(b < a for a, b in pairwise(quarters)):
            return "settling"
        _, passed = self._passages
        errors = ERROR_FACTOR * self.rtol
        # The last change is at most an eighth of the largest, or as small as these.
        largest = 0.125 * float(np.ptp(passed, axis=0).max(initial=0.0)) if len(passed) else 0.0
        for turns in self._returns(max(largest, RECURRENCE, errors), (len(passed) - 1) // 5):
            # A Floquet multiplier whose motion still decays shrinks the changes by a constant
            # factor. Near a torus the changes may shrink for a while as well, but not by a further
            # factor of 2 in each quarter. Small changes may shrink more slowly.
            change = np.abs(passed[turns:] - passed[:-turns]).max(axis=1)
            share = 1.0 if change.max() < RECURRENCE else 0.5
            quarter = np.cumsum([0, *((change.size + 3 - np.arange(3)) // 4)])
            parts = np.maximum(np.maximum.reduceat(change, quarter), errors)
            if (parts[1:] <= np.maximum(share * parts[:-1], errors)).all():
                return "settling"
        return "irregular"

    def _returns(self, within: float, most: int) -> list[int]:
        """Numbers of passages, up to `most`, before which the last state was within a distance."""
        _, passed = self._passages
        back = np.abs(passed[-1 - max(most, 0) : -1] - passed[-1:]).max(axis=1)[::-1]
        return (1 + np.flatnonzero(back <= within)).tolist()

    @cached_property
    def _passages(self) -> tuple[Array, Array]:
        """Times, (k,), and states, (k, 2 integrated), that are compared with one another.

        Each position and rate is divided by its range in the later half, or by a thousandth of the
        largest range of a position or rate if its own is smaller.
        """
        if self.drive:
            every = round(self.drive / float(self.t[1] - self.t[0]))
            at = np.arange(self.t.size - 1, -1, -every)[::-1]
            times, states = self.t[at], self.states[at]
        else:
            late = self.x[self.x.size // 2 :]
            across = self.x - 0.5 * (late.max() + late.min())
            at = 1 + np.flatnonzero((across[1:-2] < 0.0) & (across[2:-1] >= 0.0))
            nodes = at[:, None] + np.arange(-1, 3)
            rise = across[at + 1] - across[at]
            share = -across[at] / rise
            for _ in range(4):  # chord method for the root of the cubic through four samples
                share -= np.sum(_lagrange(share) * across[nodes], axis=1) / rise
            times = self.t[at] + share * (self.t[at + 1] - self.t[at])
            states = np.einsum("kn,kns->ks", _lagrange(share), self.states[nodes])
        scale = np.ptp(self.states[self.t.size // 2 :], axis=0).reshape(2, -1)
        scale = np.maximum(scale, 1e-3 * scale.max(axis=1, keepdims=True)).ravel()
        return (times, states / scale) if scale.all() else (times[:0], states[:0])

    def averages_converge(self) -> bool:
        """Whether averages over its time show that it is quasi-periodic, or periodic.

        On a torus, averages with a smooth weight all of whose derivatives are 0 at both ends
        converge faster than any power of the time; for a chaotic motion they converge like its
        square root.

        If turns about the axis change nothing, products that no turn changes are averaged: a planar
        or elliptic motion whose axes turn slowly is quasi-periodic, however long a turn takes.

        Source: Das, Saiki, Sander and Yorke (2017), Quantitative quasiperiodicity, Nonlinearity 30.
        """
        p, rates = np.split(self.states, 2, axis=1)
        observed = np.concatenate([self.states, np.sin(p), p**2, rates**2], axis=1)
        if self.axisymmetric:
            x, z = np.split(self.states.reshape(len(p), 2, 2, -1), 2, axis=2)
            across = (x + 1j * z).reshape(len(p), -1)
            products = across * across[:, p.shape[1] // 2 - 1, None].conj()
            observed = np.concatenate([products.real, products.imag, np.abs(across) ** 2], axis=1)
        spread = observed.std(axis=0)
        moving = spread > 1e-6 * spread.max()
        observed = observed[:, moving] / spread[moving]

        def apart(parts: int) -> float:
            """Largest difference between averages over parts of equal length."""
            size = len(observed) // parts
            share = (np.arange(size) + 0.5) / size
            weight = np.exp(-1.0 / (share * (1.0 - share)))
            weight /= weight.sum()
            means = [weight @ observed[k * size : (k + 1) * size] for k in range(parts)]
            return float(np.ptp(means, axis=0).max())

        twice, once = apart(4), apart(2)
        return once <= min(AVERAGE_ERROR, max(AVERAGE_SHARE * twice, EXACT_AVERAGE))


def _lagrange(share: Array) -> Array:
    """Lagrange weights, (k, 4), of samples at -1, 0, 1 and 2 for places `share`, (k,)."""
    a, b, c, d = share + 1.0, share, share - 1.0, share - 2.0
    return np.stack([-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0], axis=1)
