# SPDX-License-Identifier: MIT
"""Combination resonances of a pulsating flow: two modes that grow together, at one amplitude.

Two multipliers can leave the unit circle away from 1 and -1 only where they meet. So the phases of
the multipliers of a few modes are followed over the frequency. Wherever two phases pass each other,
the frequency at which they do is approached until a motion grows there, or until it is known that
motions grow at most in a region too thin to count.

Source: Yakubovich and Starzhinskii (1975), Linear differential equations with periodic
coefficients.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from pipedyn.forced.parametric_edge import RegionKind
from pipedyn.forced.pulsating import Hill
from pipedyn.orbits.floquet import beyond_circle
from pipedyn.orbits.magnus import exponentials
from pipedyn.util.check import Array, Complex

DAMPED_ERROR = 3e-6
"""Error of multipliers in damped pipes. Without damping they lie on the unit circle but for
rounding."""

GAUSS = np.array([-0.5, 0.5]) / math.sqrt(3.0)
"""Two nodes of Gauss-Legendre quadrature, from the middle of an interval of length 1, (2,)."""

PERIOD_PARTS = 48
"""Intervals of a period in the integration of the multipliers. They misplace regions by some 1e-5,
on which the edges, roots of Hill's determinant, do not depend."""

SCANNED_PHASE = 0.15
"""Largest change of a multiplier's phase from one frequency to the next where motions may grow, in
rad."""

WIDEST_STEP = 8
"""Number of steps of `SCANNED_PHASE` that are one where all motions decay fast."""

SURE_GROWTH = 8.0
"""Multiplier with which motions do not cease to grow within a step of `SCANNED_PHASE`: where two
modes grow like exp(sqrt(c^2 - p^2)), c would have to be larger than 27."""

LARGEST_GAP = 0.6
"""Largest distance of two phases, in rad, at which they may pass each other before the next
frequency."""

CLOSEST_FREQUENCIES = 1e-8
"""Relative distance of two frequencies at which the approach to a meeting of two phases ends."""


@dataclass(frozen=True)
class Multipliers:
    """Floquet multipliers off the real axis at a frequency of the flow.

    Attributes:
        frequency: frequency of the flow.
        values: the multipliers, shape (m,).
        right, left: their eigenvectors, (n, m) and (m, n), with left @ right = 1.
        growing: number of them with a modulus larger than 1.
        largest: largest modulus of these and of all real multipliers.
        real: sign of the largest multiplier on the real axis if its motion grows, otherwise 0.
    """

    frequency: float
    values: Complex
    right: Complex
    left: Complex
    growing: int
    largest: float
    real: int

    @property
    def nu(self) -> float:
        """Frequency nu of the motion with the largest multiplier, at most half of the flow's."""
        if not self.values.size:
            return 0.0
        best = self.values[int(np.argmax(np.abs(self.values)))]
        return abs(float(np.angle(best))) / (2.0 * math.pi) * self.frequency


@dataclass(frozen=True)
class GrowthEnd:
    """An end of an interval of frequencies in which motions of a few modes grow.

    Attributes:
        outside, inside: multipliers next to the end, on either side of it; where the interval goes
            on beyond the range of the search, both are those at the end of this range.
        axis: 0 where two multipliers meet on the unit circle at the end, 1 or -1 where a multiplier
            on the real axis passes this value there.
    """

    outside: Multipliers
    inside: Multipliers
    axis: int = 0

    @property
    def bounded(self) -> bool:
        """Whether the interval ends there."""
        return self.outside is not self.inside

    @property
    def kind(self) -> RegionKind:
        """Kind of the region's edge at this end."""
        if not self.axis:
            return "combination"
        return "harmonic" if self.axis > 0 else "subharmonic"


Growth = tuple[GrowthEnd, GrowthEnd]
"""Lower and upper end of an interval of frequencies in which motions grow."""


class FewModes:
    """Multipliers of the lowest modes of a pulsating pipe at one amplitude and many frequencies.

    The equations y' = A(t) y of states are projected on the left and right eigenvectors of the mean
    of A, so that only the part of A that changes in time couples the modes.

    Args:
        hill: Hill's equations of the pipe.
        amplitude: amplitude of the pulsation relative to the mean speed.
        low, high: range of frequencies of the pulsation.
    """

    def __init__(self, hill: Hill, amplitude: float, low: float, high: float) -> None:
        pipe, reach = hill.pipe, hill.many * low
        self.sharp = hill.is_hermitian or hill.is_real
        self._error = 0.0 if self.sharp else DAMPED_ERROR
        self._ends = dict[tuple[float, float, int], GrowthEnd]()
        square = pipe.mean**2 * (1.0 + 0.5 * amplitude**2)
        values, right = (of + 0j for of in np.linalg.eig(pipe.companion(pipe.mean, square)))
        # Two modes that do not oscillate, as where the mean square of the speed buckles the pipe,
        # are written as a complex one and its conjugate.
        real = np.flatnonzero(values.imag == 0.0)
        first, second = real[np.argsort(np.abs(values[real]))].reshape(-1, 2).T
        right[:, first] += 1j * right[:, second]
        right[:, second] = right[:, first].conj()
        values[first] += 1e-9j
        order = np.argsort(np.abs(values) + 1e9 * (values.imag <= 0.0))
        count = np.count_nonzero((values.imag > 0.0) & (np.abs(values) < max(3.0 * high, reach)))
        kept = order[: min(max(count + 3, 6), 10, values.size // 2)]
        left = np.linalg.inv(right)[kept].T
        # Motions are left out if the frequencies of their modes lie beyond Hill's harmonics.
        self._seen = values.imag[kept] <= reach
        self.fastest = float(values.imag[kept][self._seen].max(initial=0.0))
        # The complex amplitude of each mode is written as two real coordinates.
        basis = np.concatenate([right[:, kept].real, right[:, kept].imag], axis=1)
        rows = np.concatenate([left.real, -left.imag], axis=1)
        rows = rows @ np.linalg.inv(basis.T @ rows)
        self._parts = rows.T @ pipe.companions() @ basis
        phases = 2.0 * math.pi * (np.arange(PERIOD_PARTS) + 0.5 + GAUSS[:, None]) / PERIOD_PARTS
        speed = pipe.mean * (1.0 + amplitude * np.cos(phases))
        rate = -pipe.mean * amplitude * np.sin(phases)
        part = 2.0 * math.pi / PERIOD_PARTS
        first, second = part * np.tensordot(speed[..., None] ** np.arange(3), self._parts[:3], 1)
        before, after = part * rate[..., None, None] * self._parts[3]
        # Magnus' exponents are polynomials of second degree in 1 / frequency.
        turned = (
            _commutator(after, before),
            _commutator(second, before) + _commutator(after, first),
            _commutator(second, first),
        )
        self._exponents = math.sqrt(3.0) / 12.0 * np.stack(turned)
        self._exponents[:2] += 0.5 * np.stack([before + after, first + second])

    def at(self, frequencies: Array) -> list[Multipliers]:
        """Multipliers at frequencies of the flow, shape (F,), by Magnus' series to fourth order."""
        if not frequencies.size:
            return []
        values, right = np.linalg.eig(np.stack([self._map(w) for w in frequencies.tolist()]))
        left, sizes = np.linalg.inv(right), np.abs(values)
        on_axis = np.abs(values.imag) <= 1e-4 * sizes
        weights = (np.abs(right.reshape(sizes.shape[0], 2, self._seen.size, -1)) ** 2).sum(axis=1)
        off_axis = ~on_axis & self._seen[np.argmax(weights, axis=1)]
        found = list[Multipliers]()
        for i, w in enumerate(frequencies.tolist()):
            off = off_axis[i]
            largest = max(values[i, on_axis[i]].real.tolist(), key=abs, default=0.0)
            complex_ones = values[i, off].astype(np.complex128)
            growing = beyond_circle(complex_ones, self._error) > 0.0
            found.append(
                Multipliers(
                    frequency=w,
                    values=complex_ones,
                    right=right[i][:, off],
                    left=left[i][off],
                    growing=int(np.count_nonzero(growing)),
                    largest=float(sizes[i, off].max(initial=abs(largest))),
                    real=int(np.sign(largest) * (beyond_circle(largest, self._error) > 0.0)),
                )
            )
        return found

    def _map(self, frequency: float) -> Array:
        """The map of states over a period."""
        constant, slope, bend = self._exponents
        factors = exponentials(constant + slope / frequency + bend / frequency**2)
        while len(factors) > 1:
            even = factors[1::2] @ factors[: len(factors) // 2 * 2 : 2]
            factors = np.concatenate([even, factors[len(factors) // 2 * 2 :]])
        return np.asarray(factors[0])

    def may_grow(self, a: Multipliers, b: Multipliers) -> bool:
        """Whether motions may grow somewhere between two frequencies.

        Two modes decay like exp(-d) in a period where nothing couples them, like exp(-d + c) where
        they resonate best, and at least like exp(-d + sqrt(c^2 - p^2)) where their phases are 2 p
        away from this. So if c > d somewhere, they decay by less than exp(-p) where they are that
        far away. Between the nearer frequency and the resonance, the phase of a mode changes by at
        most p, half of what it changes between both frequencies; 2 p stands here to be safe.
        """
        phase = 2.0 * math.pi * self.fastest * (1.0 / a.frequency - 1.0 / b.frequency)
        return max(a.largest, b.largest) > math.exp(-phase)

    def scanned(self, low: float, high: float) -> list[Multipliers]:
        """Multipliers at frequencies between two, close enough to show where motions grow.

        They are close only where motions may grow.
        """
        turns = 2.0 * math.pi * self.fastest * (1.0 / low - 1.0 / high)
        every = 1.0 / np.linspace(1.0 / low, 1.0 / high, math.ceil(turns / SCANNED_PHASE) + 8)
        found = dict[int, Multipliers]()
        wanted = [*range(0, every.size - 1, WIDEST_STEP), every.size - 1]
        while wanted:
            found |= dict(zip(wanted, self.at(every[wanted]), strict=True))
            pairs = pairwise(sorted(found))
            wanted = [
                (i + j) // 2 for i, j in pairs if j > i + 1 and self.may_grow(found[i], found[j])
            ]
        seen = _sorted(list(found.values()))
        for _ in range(2):
            more = [w for a, b in pairwise(seen) if self.may_grow(a, b) for w in _finer(a, b)]
            seen = _sorted(seen + self.at(np.array(more)))
        open_pairs = [pair for pair in pairwise(seen) if self.may_grow(*pair)]
        return _sorted(seen + [one for pair in open_pairs for one in self._between(*pair)])

    def unstable(self, seen: list[Multipliers]) -> list[Growth]:
        """Intervals of frequencies in which multipliers off the real axis are larger than 1.

        `seen` has the multipliers by rising frequency.
        """
        found = list[Growth]()
        begin: GrowthEnd | None = None
        for a, b in pairwise(seen):
            if not a.growing and b.growing:
                begin = self._end(a, b)
            elif a.growing and not b.growing:
                found.append((begin or GrowthEnd(seen[0], seen[0]), self._end(b, a)))
                begin = None
        if begin:
            found.append((begin, GrowthEnd(seen[-1], seen[-1])))
        whole = list[Growth]()
        for lower, upper in found:
            if whole and _axis(whole[-1][1]) and _axis(lower):
                ends = whole[-1][1].outside.frequency, lower.outside.frequency
                if all(one.real for one in seen if ends[0] <= one.frequency <= ends[1]):
                    lower = whole.pop()[0]  # between them, two multipliers are on the real axis
            whole.append((lower, upper))
        return [(self._beyond(a, seen[::-1]), self._beyond(b, seen)) for a, b in whole]

    def _beyond(self, end: GrowthEnd, seen: list[Multipliers]) -> GrowthEnd:
        """The end of an interval of growth, which may go on with a multiplier on the real axis.

        `seen` has the multipliers in the order in which the interval is left.
        """
        axis, inside = _axis(end), end.outside
        if not axis:
            return end
        way = 1.0 if seen[-1].frequency > seen[0].frequency else -1.0
        for one in seen:
            if way * (one.frequency - inside.frequency) <= 0.0:
                continue
            if one.real != axis:
                return self._end(one, inside, 20, axis)
            inside = one
        return GrowthEnd(seen[-1], seen[-1], axis)

    def _end(
        self, outside: Multipliers, inside: Multipliers, halvings: int = 12, axis: int = 0
    ) -> GrowthEnd:
        """The end of an interval of growth, narrowed down by bisection.

        With an axis, 1 or -1, motions grow by a multiplier on the real axis with this sign. Ends
        are kept, as they are asked for again when the range of frequencies is widened.
        """
        between = outside.frequency, inside.frequency, axis
        if between in self._ends:
            return self._ends[between]
        for _ in range(halvings):
            (middle,) = self.at(np.array([0.5 * (outside.frequency + inside.frequency)]))
            if (middle.real == axis) if axis else middle.growing:
                inside = middle
            else:
                outside = middle
        self._ends[between] = GrowthEnd(outside, inside, axis)
        return self._ends[between]

    def _between(self, a: Multipliers, b: Multipliers) -> Iterator[Multipliers]:
        """Multipliers at frequencies where motions grow, between two at which no motion grows."""
        if a.growing or b.growing:
            return
        onto = _same_multipliers(a, b)
        for i, j in combinations(np.flatnonzero(onto >= 0).tolist(), 2):
            # A conjugate pair meets on the real axis, and only one of two conjugate meetings is
            # needed.
            if a.values[i] == a.values[j].conj() or a.values[i].imag + a.values[j].imag < 0.0:
                continue
            gaps = _gap(a, i, j), _gap(b, int(onto[i]), int(onto[j]))
            if gaps[0] * gaps[1] < 0.0 and max(map(abs, gaps)) < LARGEST_GAP:
                yield from self._meeting(a, b, (i, j))

    def _meeting(
        self, a: Multipliers, b: Multipliers, pair: tuple[int, int]
    ) -> Iterator[Multipliers]:
        """Multipliers around the frequency at which two pass each other, if motions grow there."""
        onto = _same_multipliers(a, b)
        other = int(onto[pair[0]]), int(onto[pair[1]])
        for _ in range(30):
            gaps = _gap(a, *pair), _gap(b, *other)
            width = b.frequency - a.frequency
            share = min(max(gaps[0] / (gaps[0] - gaps[1]), 0.02), 0.98)
            (middle,) = self.at(np.array([a.frequency + share * width]))
            if middle.growing:
                yield from (a, middle, b)
                return
            if width < CLOSEST_FREQUENCIES * b.frequency:
                return
            onto = _same_multipliers(a, middle)
            here = int(onto[pair[0]]), int(onto[pair[1]])
            if min(here) < 0:
                return
            if _gap(middle, *here) * gaps[0] > 0.0:
                a, pair = middle, here
            else:
                b, other = middle, here


def _finer(a: Multipliers, b: Multipliers) -> list[float]:
    """Frequencies between two, of which more has to be known.

    Different motions grow at the two, motions grow at one of them only, or multipliers leave the
    real axis between them. There may be frequencies between at which no motion grows, or other
    motions do, unless motions grow fast at both.
    """
    before, largest = np.abs(a.values), np.abs(b.values)
    if min(before.max(initial=0.0), largest.max(initial=0.0)) > SURE_GROWTH:
        return []
    alike = before.size == largest.size and (a.growing > 0) == (b.growing > 0)
    if alike and a.growing:
        onto = _same_multipliers(a, b)
        fastest = onto[int(np.argmax(before))]
        alike = fastest >= 0 and bool(largest[fastest] > 0.999999 * largest.max())
    if alike:
        return []
    return np.linspace(a.frequency, b.frequency, 6)[1:-1].tolist()


def _commutator(a: Array, b: Array) -> Array:
    """The commutator a b - b a of stacks of matrices."""
    return np.asarray(a @ b - b @ a)


def _sorted(seen: list[Multipliers]) -> list[Multipliers]:
    """Multipliers by rising frequency of the flow, with each frequency once."""
    return [one for _, one in sorted({one.frequency: one for one in seen}.items())]


def _axis(end: GrowthEnd) -> int:
    """Sign of the real multiplier with which an interval of growth goes on; 0 if it ends."""
    best = end.inside.values[int(np.argmax(np.abs(end.inside.values)))]
    on_axis = end.bounded and abs(best) - 1.0 > abs(best.imag)
    return end.outside.real if on_axis and best.real * end.outside.real > 0 else 0


def _gap(one: Multipliers, i: int, j: int) -> float:
    """Phase of multiplier i less that of multiplier j, in (-pi, pi]."""
    return float(np.angle(one.values[i] * one.values[j].conj()))


def _same_multipliers(a: Multipliers, b: Multipliers) -> NDArray[np.int_]:
    """Index in b of each multiplier of a, matched by eigenvectors, (m,); -1 where none matches."""
    onto = np.full(a.values.size, -1)
    if not a.values.size or not b.values.size:
        return onto
    alike = np.abs(a.left @ b.right)
    alike *= np.abs((b.left @ a.right).T)
    best = np.argmax(alike, axis=1)
    mutual = np.argmax(alike, axis=0)[best] == np.arange(a.values.size)
    sure = mutual & (alike[np.arange(a.values.size), best] > 0.5)
    onto[sure] = best[sure]
    return onto
