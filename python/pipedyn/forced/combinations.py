# SPDX-License-Identifier: MIT
"""Where a pulsating flow makes two modes of the straight pipe grow together, at one amplitude.

Two multipliers can leave the unit circle away from 1 and -1 only where they meet. So the phases of
a few modes' multipliers are followed over the frequency, and wherever two of them pass each other
the frequency at which they do is approached until a motion grows there, or it is known that none
does in more than the thinnest region. Of a conservative pipe only multipliers of opposite Krein
signature can leave the circle.

Source: Yakubovich and Starzhinskii (1975), Linear differential equations with periodic
coefficients, for the signature.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from pipedyn.forced.pulsating import Hill
from pipedyn.linear.eigenproblem import Complex
from pipedyn.orbits.magnus import exponentials
from pipedyn.util.check import Array

GROWS, GROWS_SHARP = 1e-5, 1e-7
"""By how much a multiplier is larger than 1 where a motion grows: of damped pipes, and of those
without damping, whose multipliers lie on the circle but for rounding."""

GAUSS = np.array([-0.5, 0.5]) / math.sqrt(3.0)
"""Places of two nodes of Gauss-Legendre quadrature about the middle of an interval of length 1."""

PERIOD_PARTS = 48
"""Parts of a period: they misplace regions by some 1e-5, which the roots do not depend on."""

PHASE_STEP = 0.15
"""Largest change of a multiplier's phase from one frequency to the next, rad."""

LARGEST_GAP = 0.6
"""Distance of two phases beyond which they do not pass each other from one to the next."""

CLOSEST_FREQUENCIES = 1e-8
"""Relative distance of frequencies at which the approach of a meeting of two phases ends."""


@dataclass(frozen=True)
class Multipliers:
    """Those off the real axis, at a frequency of the flow.

    Attributes:
        frequency: of the flow.
        values: shape (m,).
        right, left: eigenvectors, (n, m) and (m, n), with left @ right = 1.
        signs: Krein signatures of those of a conservative pipe, otherwise 0, (m,).
        growing: how many are larger than 1.
        real: of the largest on the real axis, its sign if that grows, otherwise 0.
    """

    frequency: float
    values: Complex
    right: Complex
    left: Complex
    signs: Array
    growing: int
    real: int

    @property
    def nu(self) -> float:
        """Frequency of the motion with the largest one."""
        if not self.values.size:
            return 0.0
        best = self.values[int(np.argmax(np.abs(self.values)))]
        return abs(float(np.angle(best))) / (2.0 * math.pi) * self.frequency


GrowthEnd = tuple[Multipliers, Multipliers]
"""Next to the end of an interval of frequencies, outside and inside of it."""


@dataclass(frozen=True)
class Growth:
    """An interval of frequencies in which motions grow, of few modes.

    Attributes:
        outside, inside: frequencies next to its lower and upper end.
        nus: of the motions that grow inside.
        axis: 0 where two multipliers meet on the unit circle there, 1 or -1 where it is one on the
            real axis that passes this.
        bounded: whether it ends there, or the search does.
    """

    outside: tuple[float, float]
    inside: tuple[float, float]
    nus: tuple[float, float]
    axis: tuple[int, int]
    bounded: tuple[bool, bool]


class FewModes:
    """The lowest modes of a pulsating pipe, at one amplitude: multipliers at many frequencies.

    The equations y' = A y of states are projected on the eigenvectors of their mean, from the left
    and from the right, so that the modes are coupled by what changes in time only.

    Args:
        hill: the equations.
        amplitude: of the pulsation.
        low, high: range of frequencies.
    """

    def __init__(self, hill: Hill, amplitude: float, low: float, high: float) -> None:
        pipe, reach = hill.pipe, hill.many * low
        highest = max(3.0 * high, reach)
        self.sharp = hill.is_hermitian or hill.is_real
        self._grows = GROWS_SHARP if self.sharp else GROWS
        square = pipe.mean**2 * (1.0 + 0.5 * amplitude**2)
        values, right = np.linalg.eig(pipe.companion(pipe.mean, square))
        order = np.argsort(np.abs(values) + 1e9 * (values.imag <= 0.0))
        turning = int(np.count_nonzero(values.imag > 0.0))
        count = int(np.count_nonzero((values.imag > 0.0) & (np.abs(values) < highest)))
        kept = order[: min(max(count + 3, 6), 10, turning)]
        left = np.linalg.inv(right)[kept].T
        # Motions of modes beyond Hill's harmonics are not looked for.
        self._seen = values.imag[kept] <= reach
        self.fastest = float(values.imag[kept][self._seen].max(initial=0.0))
        # Of a pair x + i y with x' = Re, y' = Im of what the mode's amplitude does.
        right, left = right[:, kept], 2.0 * left
        basis = np.concatenate([right.real, right.imag], axis=1)
        rows = np.concatenate([left.real, -left.imag], axis=1)
        rows = rows @ np.linalg.inv(basis.T @ rows)
        self._parts = rows.T @ pipe.companions() @ basis
        self._form: Array | None = None
        if hill.is_hermitian:
            form = np.kron([[0.0, 1.0], [-1.0, 0.0]], pipe.mass)
            self._form = basis.T @ form @ basis
        phases = 2.0 * math.pi * (np.arange(PERIOD_PARTS) + 0.5 + GAUSS[:, None]) / PERIOD_PARTS
        speed = pipe.mean * (1.0 + amplitude * np.cos(phases))
        rate = -pipe.mean * amplitude * np.sin(phases)
        self._still = np.tensordot(speed[..., None] ** np.arange(3), self._parts[:3], 1)
        self._moving = rate[..., None, None] * self._parts[3]

    def at(self, frequency: float) -> Multipliers:
        """Multipliers at a frequency of the flow."""
        rates = self._still + frequency * self._moving
        first, second = (2.0 * math.pi / (frequency * PERIOD_PARTS)) * rates
        turned = second @ first - first @ second
        factors = exponentials(0.5 * (first + second) + math.sqrt(3.0) / 12.0 * turned)
        while len(factors) > 1:
            even = factors[1::2] @ factors[: len(factors) // 2 * 2 : 2]
            factors = np.concatenate([even, factors[len(factors) // 2 * 2 :]])
        values, right = np.linalg.eig(factors[0])
        sizes = np.abs(values)
        real = np.flatnonzero(np.abs(values.imag) <= 1e-4 * sizes)
        largest = max(values[real].real.tolist(), key=abs, default=0.0)
        off = np.abs(values.imag) > 1e-4 * sizes
        weights = (np.abs(right.reshape(2, self._seen.size, -1)) ** 2).sum(axis=0)
        off &= self._seen[np.argmax(weights, axis=0)]
        left = np.linalg.inv(right)[off]
        values, right = values[off].astype(np.complex128), right[:, off]
        signs = np.zeros(values.size)
        if self._form is not None:
            signs = np.sign(np.einsum("im,ij,jm->m", right.conj(), 1j * self._form, right).real)
        return Multipliers(
            frequency=frequency,
            values=values,
            right=right,
            left=left,
            signs=signs,
            growing=int(np.count_nonzero(np.abs(values) > 1.0 + self._grows)),
            real=int(np.sign(largest)) if abs(largest) > 1.0 + self._grows else 0,
        )

    def unstable(self, low: float, high: float) -> list[Growth]:
        """Intervals of frequencies in which multipliers off the real axis are larger than 1."""
        turns = 2.0 * math.pi * self.fastest * (1.0 / low - 1.0 / high)
        every = np.linspace(1.0 / high, 1.0 / low, math.ceil(turns / PHASE_STEP) + 8)
        seen = [self.at(w) for w in (1.0 / every[::-1]).tolist()]
        seen = _sorted(seen + [one for a, b in pairwise(seen) for one in self._between(a, b)])
        seen = _sorted(seen + [one for a, b in pairwise(seen) for one in self._apart(a, b)])
        found = list[tuple[GrowthEnd, GrowthEnd]]()
        begin: GrowthEnd | None = None
        for a, b in pairwise(seen):
            if not a.growing and b.growing:
                begin = self._end(a, b)
            elif a.growing and not b.growing:
                found.append((begin or (seen[0], seen[0]), self._end(b, a)))
                begin = None
        if begin:
            found.append((begin, (seen[-1], seen[-1])))
        whole = list[tuple[GrowthEnd, GrowthEnd]]()
        for lower, upper in found:
            if whole and _axis(whole[-1][1]) and _axis(lower):
                ends = whole[-1][1][0].frequency, lower[0].frequency
                if all(one.real for one in seen if ends[0] <= one.frequency <= ends[1]):
                    lower = whole.pop()[0]  # between, both are on the real axis
            whole.append((lower, upper))
        back = seen[::-1]
        return [_growth_interval(self._beyond(a, back), self._beyond(b, seen)) for a, b in whole]

    def _beyond(self, end: GrowthEnd, seen: list[Multipliers]) -> tuple[GrowthEnd, int]:
        """The end of an interval of growth that goes on with multipliers on the real axis."""
        axis = _axis(end)
        if not axis:
            return end, 0
        way = 1.0 if seen[-1].frequency > seen[0].frequency else -1.0
        inside = end[0]
        for one in seen:
            if way * (one.frequency - inside.frequency) <= 0.0:
                continue
            if one.real != axis:
                outside = one
                break
            inside = one
        else:
            return (seen[-1], seen[-1]), axis
        for _ in range(20):
            middle = self.at(0.5 * (outside.frequency + inside.frequency))
            if middle.real == axis:
                inside = middle
            else:
                outside = middle
        return (outside, inside), axis

    def _end(self, outside: Multipliers, inside: Multipliers) -> GrowthEnd:
        """Frequencies near the end of an interval of growth, from both sides."""
        for _ in range(12):
            middle = self.at(0.5 * (outside.frequency + inside.frequency))
            if middle.growing:
                inside = middle
            else:
                outside = middle
        return outside, inside

    def _between(self, a: Multipliers, b: Multipliers) -> Iterator[Multipliers]:
        """Where motions grow between two frequencies at which none does."""
        if a.growing or b.growing:
            return
        onto = _same_multipliers(a, b)
        for i, j in combinations(np.flatnonzero(onto >= 0).tolist(), 2):
            if self._form is not None and a.signs[i] == a.signs[j]:
                continue
            # Nor of a conjugate pair, nor one whose conjugates are met as well.
            if a.values[i] == a.values[j].conj() or a.values[i].imag + a.values[j].imag < 0.0:
                continue
            gaps = _gap(a, i, j), _gap(b, int(onto[i]), int(onto[j]))
            if gaps[0] * gaps[1] < 0.0 and max(map(abs, gaps)) < LARGEST_GAP:
                yield from self._meeting(a, b, (i, j))

    def _apart(self, a: Multipliers, b: Multipliers) -> list[Multipliers]:
        """Between two frequencies at which other motions grow, as there may be none between."""
        if not (a.growing and b.growing) or abs(a.nu / a.frequency - b.nu / b.frequency) < 0.01:
            return []
        return [self.at(w) for w in np.linspace(a.frequency, b.frequency, 6)[1:-1].tolist()]

    def _meeting(
        self, a: Multipliers, b: Multipliers, pair: tuple[int, int]
    ) -> Iterator[Multipliers]:
        """Where two multipliers pass each other, if they grow there."""
        onto = _same_multipliers(a, b)
        other = int(onto[pair[0]]), int(onto[pair[1]])
        for _ in range(30):
            gaps = _gap(a, *pair), _gap(b, *other)
            width = b.frequency - a.frequency
            share = min(max(gaps[0] / (gaps[0] - gaps[1]), 0.02), 0.98)
            middle = self.at(a.frequency + share * width)
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


def _sorted(seen: list[Multipliers]) -> list[Multipliers]:
    """By rising frequency, each once."""
    return [one for _, one in sorted({one.frequency: one for one in seen}.items())]


def _axis(end: GrowthEnd) -> int:
    """Side of the real axis on which the largest multiplier ends there, 0 on the unit circle."""
    outside, inside = end
    best = inside.values[int(np.argmax(np.abs(inside.values)))]
    on_axis = abs(best) - 1.0 > abs(best.imag)
    return outside.real if on_axis and outside is not inside and best.real * outside.real > 0 else 0


def _growth_interval(low: tuple[GrowthEnd, int], high: tuple[GrowthEnd, int]) -> Growth:
    (below, first), (above, last) = low, high
    return Growth(
        outside=(below[0].frequency, above[0].frequency),
        inside=(below[1].frequency, above[1].frequency),
        nus=(below[1].nu, above[1].nu),
        axis=(first, last),
        bounded=(below[0] is not below[1], above[0] is not above[1]),
    )


def _gap(one: Multipliers, i: int, j: int) -> float:
    """By how much the phase of one is ahead of that of another, in (-pi, pi]."""
    return float(np.angle(one.values[i] * one.values[j].conj()))


def _same_multipliers(a: Multipliers, b: Multipliers) -> NDArray[np.int_]:
    """For each at a frequency which it is at another, by eigenvectors; -1 where it is none."""
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
