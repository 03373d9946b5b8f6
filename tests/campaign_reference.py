# SPDX-License-Identifier: MIT
"""Every change of the number of unstable roots of P(lambda, u), found without the package.

P = lambda^2 M + lambda (u G + D) + K0 + u^2 K2, and i L besides where a material loses energy by
hysteresis. Three programs, by what the matrices are:

- Divergence: det(K0 + u^2 K2) = 0 is an eigenproblem in u^2.
- Flutter of up to `LARGEST_BIALTERNATE` functions with damping: all u at which two roots add up to
  zero, from one eigenproblem in u (the bialternate product, Guckenheimer, Myers and Sturmfels 1997).
- Else samples of all roots with their derivatives, close enough that cubics through two samples
  say what each root near the axis does between; without dissipation the order of the frequencies
  and of the signs of their energies (Krein) tells which pairs can meet.

Counts of unstable roots between all changes are then taken from all roots there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from scipy import linalg

Array = np.ndarray[Any, Any]

LARGEST_BIALTERNATE = 6
"""Degrees of freedom up to which the bialternate product is formed: a pencil of 132 rows."""

LARGEST_SAMPLED = 60
"""Degrees of freedom up to which all roots are sampled; beyond, those of the lowest modes, and the
whole model says where exactly the changes are, and counts."""

NARROW = 1e-7
"""Ranges of unstable speeds below this share of the speed are not looked for."""

EPSILON = float(np.finfo(float).eps)


class Unsure(Exception):
    """The reference does not know the answer."""


@dataclass(frozen=True)
class Change:
    """A change of the number of unstable roots at a speed, known to an error.

    It is a divergence where the frequency is 0.
    """

    speed: float
    frequency: float
    error: float


@dataclass(frozen=True)
class Answer:
    """All changes; how many roots are unstable before the first and behind each, least and most."""

    changes: tuple[Change, ...]
    counts: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Roots:
    """Roots with Im lambda >= 0 at one speed, their derivatives by it, and rounding errors.

    Of a conservative system `sign` is that of the energy of those on the axis, 0 of those off it.
    """

    speed: float
    value: Array
    slope: Array
    error: Array
    sign: Array
    lossless: bool

    @property
    def unknown(self) -> Array:
        """Which roots are so close to the axis that rounding hides the side."""
        if self.lossless:
            return np.zeros(self.sign.size, dtype=bool)
        return np.abs(self.value.real) <= self.error

    @property
    def faint(self) -> Array:
        """Roots of which rounding spoils even how they move; whether they cross is not asked."""
        return np.abs(self.value.real) <= 30.0 * self.error

    def unstable(self) -> tuple[int, int]:
        """How many grow, at least and at most."""
        weight = np.where(self.value.imag == 0.0, 1, 2)
        grows = (self.value.real > 0.0) & (self.sign == 0)
        least = int(np.sum(weight[grows & ~self.unknown]))
        return least, least + int(np.sum(weight[self.unknown]))


@dataclass(frozen=True, eq=False)
class System:
    """The matrices, real and of one size; `loss` is None without hysteresis.

    G = gyro + end, the first skew; all but these and `thrust`, K2, are symmetric.
    """

    mass: Array
    gyro: Array
    end: Array
    damping: Array
    still: Array
    thrust: Array
    loss: Array | None = None
    samples: dict[float, Roots] = field(default_factory=dict)

    @property
    def size(self) -> int:
        return len(self.mass)

    @cached_property
    def flow(self) -> Array:
        """G."""
        return self.gyro + self.end

    def stiffness(self, u: float) -> Array:
        """K without the loss."""
        return self.still + u * u * self.thrust

    def at(self, u: float) -> tuple[Array, Array, Array]:
        """M, C and K."""
        k = self.stiffness(u)
        return self.mass, u * self.flow + self.damping, k if self.loss is None else k + 1j * self.loss

    def dynamic(self, value: complex, u: float) -> Array:
        """P(lambda, u)."""
        m, c, k = self.at(u)
        return value * value * m + value * c + k

    @cached_property
    def is_closed(self) -> bool:
        """Whether no energy passes an end: then the pipe is stable where K is positive definite."""
        return not self.end.any() and np.array_equal(self.thrust, self.thrust.T)

    @cached_property
    def is_lossless(self) -> bool:
        """Whether nothing dissipates, either: then roots come in fours."""
        return self.is_closed and self.loss is None and not self.damping.any()

    @cached_property
    def is_circulatory(self) -> bool:
        """Whether roots come as +-sqrt of the eigenvalues of -M^-1 K."""
        return self.loss is None and not self.damping.any() and not self.flow.any()

    def without_loss(self) -> System:
        return replace(self, loss=None, samples={})

    def lowest(self, count: int) -> System:
        """The same in its `count` lowest modes at rest."""
        least = float(linalg.eigvalsh(self.still, subset_by_index=[0, 0])[0])
        shifted = self.still + max(0.0, 1.0 - least) * np.eye(self.size)
        modes = linalg.eigh(self.mass, shifted)[1][:, ::-1][:, :count]
        every = (self.mass, self.gyro, self.end, self.damping, self.still, self.thrust, self.loss)
        made = [None if one is None else modes.T @ one @ modes for one in every]
        if self.is_closed:
            made[5] = 0.5 * (made[5] + made[5].T)
        return System(*made)

    def roots(self, u: float) -> Roots:
        """All roots at a speed, kept."""
        if u not in self.samples:
            self.samples[u] = _roots(self, u)
        return self.samples[u]

    def unstable(self, u: float) -> tuple[int, int]:
        """Number of unstable roots, at least and at most.

        With a loss, of pairs that oscillate, and of the real ones without it.
        """
        least, most = self.roots(u).unstable()
        if self.loss is not None:
            still = self.without_loss().roots(u)
            real = int(np.sum(still.value[still.value.imag == 0.0].real > 0.0))
            least, most = least + real, most + real
        return least, most


def _roots(system: System, u: float) -> Roots:
    """By the companion matrix of the problem in 1 / (lambda - shift), and a Rayleigh quotient."""
    m, c, k = system.at(u)
    n, shift = len(m), 2.9 + 0.7 * u
    moved = c + 2.0 * shift * m
    factors = linalg.lu_factor(shift * shift * m + shift * c + k)
    step = np.zeros((2 * n, 2 * n), dtype=factors[0].dtype)
    step[:n] = -linalg.lu_solve(factors, np.hstack([moved, m]))
    step[n:, :n] = np.eye(n)
    inverse, left, right = linalg.eig(step, left=True)
    x, y = right[n:], linalg.lu_solve(factors, left[:n].conj(), trans=1)
    with np.errstate(all="ignore"):
        x, y = x / np.linalg.norm(x, axis=0), y / np.linalg.norm(y, axis=0)
        value = shift + 1.0 / inverse
        kept = np.isfinite(value) & np.isfinite(x).all(axis=0) & np.isfinite(y).all(axis=0)
    # With a loss only roots above the axis are roots, without they are conjugate to those below.
    low = 0.0 if system.loss is None else 1e-13 * np.abs(value)
    kept &= value.imag > low if system.loss is not None else value.imag >= low
    value, x, y = value[kept], x[:, kept], y[:, kept]

    def form(*parts: tuple[Array, Array]) -> Array:
        return sum(factor * np.sum(y * (matrix @ x), axis=0) for factor, matrix in parts)

    for _ in range(2):
        by_value = form((2.0 * value, m), (np.ones_like(value), c))
        off = form((value**2, m), (value, c), (np.ones_like(value), k))
        with np.errstate(all="ignore"):
            move = off / by_value
        good = np.abs(move) < 1e-3 * np.abs(value)
        real = value.imag == 0.0
        value = np.where(good, np.where(real & (system.loss is None), (value - move).real, value - move), value)
    with np.errstate(all="ignore"):
        slope = -form((value, system.flow), (np.full_like(value, 2.0 * u), system.thrust)) / by_value
        size = np.abs(value)
        terms = size**2 * (np.abs(m) @ np.abs(x)) + size * (np.abs(c) @ np.abs(x)) + np.abs(k) @ np.abs(x)
        error = 8.0 * EPSILON * np.sum(np.abs(y) * terms, axis=0) / np.abs(by_value)
        # The imaginary part of x^H P x = 0 gives the real part of a root from what dissipates and
        # follows alone, not as a small difference of what is large.
        skew, conj = 0.5 * (system.thrust - system.thrust.T), x.conj()
        lost = system.damping + u * system.end
        a, g, d = (np.sum(conj * (one @ x), axis=0) for one in (m, system.gyro, lost))
        follows = np.sum(conj * (skew @ x), axis=0).imag * u * u
        if system.loss is not None:
            follows = follows + np.sum(conj * (system.loss @ x), axis=0).real
        w = value.imag
        below = 2.0 * a.real * w + u * g.imag
        rho = -(d.real * w + follows) / below
        rounding = u * w * np.abs(system.end).max() + u * u * np.abs(skew).max()
        rounding = 4.0 * EPSILON * (EPSILON * rounding + w * np.abs(system.damping).max())
        # Vectors are known the less, the closer their roots lie in the problem solved.
        mu = inverse[kept]
        gaps = np.abs(inverse - mu[:, None])
        gaps[gaps == 0.0] = np.inf
        skewness = 1.0 / np.abs(np.sum(left.conj() * right, axis=0))[kept]
        turned = 4.0 * EPSILON * np.linalg.norm(step, 2) * skewness / gaps.min(axis=1)
        moved = w * (np.linalg.norm(lost @ x, axis=0) + turned * np.abs(lost).max())
        moved += u * u * (np.linalg.norm(skew @ x, axis=0) + turned * np.abs(skew).max())
        if system.loss is not None:
            moved += np.linalg.norm(system.loss @ x, axis=0) + turned * np.abs(system.loss).max()
        of_rho = (2.0 * turned * moved + rounding) / np.abs(below)
        better = (w > 0.0) & (of_rho < error) & (np.abs(rho - value.real) < 10.0 * error + of_rho)
        value = np.where(better, rho + 1j * w, value)
        error = np.where(better, of_rho, error)
    sign = np.zeros(value.size, dtype=int)
    if system.is_circulatory:
        # lambda^2 is real but for rounding where the pair is on the axis
        square = value**2
        sign = np.where((np.abs(square.imag) <= 1e-8 * np.abs(square)) & (square.real < 0.0), 1, 0)
    elif system.is_lossless:
        # x^H P x = 0 is a quadratic in omega, with real roots where lambda is on the axis; their
        # distance is the derivative by omega, the sign of the energy.
        a, b, e = (np.sum(x.conj() * (one @ x), axis=0) for one in (m, 1j * c, k))
        a, b, e = a.real, b.real, e.real
        apart = b * b + 4.0 * a * e
        at = np.sign(2.0 * a * value.imag - b)
        sign = np.where(apart > -1e-12 * (b * b + 4.0 * np.abs(a * e)), at, 0).astype(int)
        sign[(value.imag == 0.0)] = 0
    order = np.argsort(value.imag, kind="stable")
    lossless = system.is_lossless or system.is_circulatory
    return Roots(u, value[order], slope[order], error[order], sign[order], lossless)


# ------------------------------------------------------------------------------------ divergence


def divergences(system: System, end: float) -> list[Change]:
    """Speeds in (0, end] at which K is singular, from one eigenproblem in u^2."""
    still, thrust = system.still, system.thrust
    if not thrust.any():
        return []
    # K0 + s K2 with s = s0 + t: (K(s0)^-1 K2) x = -x / t.
    found: list[float] = []
    for shift in (-1.0, -100.0, -1e4, -1e6) if system.is_closed else ():
        try:
            values = linalg.eigh(thrust, still + shift * thrust, eigvals_only=True)
        except linalg.LinAlgError:
            continue
        with np.errstate(divide="ignore"):
            found = (shift - 1.0 / values).tolist()
        break
    else:
        shift = -0.937
        values = linalg.eigvals(linalg.solve(still + shift * thrust, thrust))
        near = values[(values != 0.0) & (np.abs(values.imag) <= 1e-7 * np.abs(values))]
        with np.errstate(divide="ignore"):
            found = (shift - 1.0 / near).real.tolist()
    result = []
    for square in found:
        if not 0.0 < square < 1.02 * end * end:
            continue
        u = math.sqrt(square)
        error = math.inf
        for _ in range(3):  # Newton's method with the vectors of the singular value nearest 0
            left, size, right = np.linalg.svd(system.stiffness(u))
            x, y = right[-1], left[:, -1]
            slope = 2.0 * u * float(y @ thrust @ x)
            terms = np.abs(y) @ (np.abs(still) + u * u * np.abs(thrust)) @ np.abs(x)
            error = 4.0 * EPSILON * float(terms) / abs(slope) if slope else math.inf
            if not abs(size[-1]) < 1e-3 * abs(slope) * u:
                break
            u -= float(size[-1]) / slope
        if 0.0 < u <= end:
            result.append(Change(u, 0.0, min(error, 1e-6 * u)))
    return sorted(result, key=lambda one: one.speed)


# --------------------------------------------------------------------------------------- flutter


def flutter_at(system: System, u: float, frequency: float) -> Change | None:
    """The crossing next to a guess, by Newton's method for y^H P(i omega, u) x = 0."""
    if not frequency > 0.0:
        return None
    rng = np.random.default_rng(system.size)
    x, y = rng.standard_normal((2, system.size)) + 0j
    start, error = (u, frequency), math.inf
    for step in range(12):
        value = 1j * frequency
        factors = linalg.lu_factor(system.dynamic(value, u), check_finite=False)
        if not np.all(np.diag(factors[0])):
            u *= 1.0 + 1e-15
            continue
        for _ in range(3 if step < 2 else 2):
            x, y = linalg.lu_solve(factors, x), linalg.lu_solve(factors, y, trans=2)
            x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
        m, c, k = system.at(u)
        off = y.conj() @ (system.dynamic(value, u) @ x)
        by_u = y.conj() @ (value * system.flow @ x + 2.0 * u * system.thrust @ x)
        by_value = y.conj() @ (2.0 * value * m @ x + c @ x)
        ratio = -off / by_value  # change of lambda; the root must come to the axis
        slope = -by_u / by_value
        if slope.real == 0.0 or not np.isfinite(ratio + slope):
            return None
        du = -ratio.real / slope.real
        frequency, u = frequency + ratio.imag + slope.imag * du, u + du
        if not (abs(u - start[0]) < 0.1 * start[0] and frequency > 1e-3 * start[1]):
            return None
        if abs(du) <= 1e-13 * u:
            break
    terms = frequency**2 * np.abs(m) @ np.abs(x) + frequency * np.abs(c) @ np.abs(x)
    terms = np.abs(y) @ (terms + np.abs(k) @ np.abs(x))
    error = 8.0 * EPSILON * float(terms) / abs(by_value * slope.real)
    return Change(float(u), float(frequency), float(error + abs(du)))


def meeting_at(system: System, u: float, frequency: float) -> Change | None:
    """Where two roots of a lossless system meet on the axis, next to a guess.

    There the Hermitian K + i omega C - omega^2 M has an eigenvalue theta that is 0, and so is its
    derivative by omega: Newton's method for both, with derivatives by perturbation.
    """
    start = u
    for _ in range(20):
        m, c, k = system.at(u)
        theta, vectors = linalg.eigh(k + 1j * frequency * c - frequency**2 * m)
        of = int(np.argmin(np.abs(theta)))
        v, value = vectors[:, of], theta[of]
        by = vectors.conj().T @ (1j * (c @ v) - 2.0 * frequency * (m @ v))
        by_u = vectors.conj().T @ (1j * frequency * (system.gyro @ v) + 2.0 * u * (system.thrust @ v))
        with np.errstate(divide="ignore"):
            others = 1.0 / (value - theta)
        others[of] = 0.0
        twice = 2.0 * float(np.sum(np.abs(by) ** 2 * others)) - 2.0 * float((v.conj() @ m @ v).real)
        mixed = 2.0 * float(np.sum((by.conj() * by_u).real * others))
        mixed += float((1j * (v.conj() @ system.gyro @ v)).real)
        jacobian = np.array([[by[of].real, by_u[of].real], [twice, mixed]])
        try:
            step = np.linalg.solve(jacobian, [value, by[of].real])
        except np.linalg.LinAlgError:
            return None
        frequency, u = frequency - float(step[0]), u - float(step[1])
        if not (abs(u - start) < 0.1 * start and frequency > 0.0):
            return None
        if abs(step[1]) < 1e-12 * u:
            return Change(u, frequency, 1e-11 * u)
    return None


@cache
def _pairs(n: int) -> tuple[Array, Array]:
    return np.triu_indices(n, 1)


def _bialternate(a: Array) -> Array:
    """2 A (x) I: its eigenvalues are the sums of two eigenvalues of A."""
    p, q = _pairs(len(a))
    one = np.eye(len(a))

    def minor(row: Array, col: Array, other: Array, rest: Array) -> Array:
        return a[row[:, None], col] * one[other[:, None], rest]

    return minor(p, p, q, q) - minor(p, q, q, p) + minor(q, q, p, p) - minor(q, p, p, q)


def bialternate_flutter(system: System, end: float) -> list[Change]:
    """All speeds in (0, end] at which two roots are i omega and -i omega."""
    n = system.size
    parts = []
    lower = linalg.cholesky(system.mass, lower=True)

    def scaled(matrix: Array) -> Array:
        half = linalg.solve_triangular(lower, matrix, lower=True)
        return linalg.solve_triangular(lower, half.T, lower=True).T

    for k, c in ((system.still, system.damping), (0.0 * lower, system.flow), (system.thrust, 0.0 * lower)):
        a = np.zeros((2 * n, 2 * n))
        a[n:, :n], a[n:, n:] = -scaled(k), -scaled(c)
        if not parts:
            a[:n, n:] = np.eye(n)
        parts.append(_bialternate(a))
    # (B0 + u B1 + u^2 B2) z = 0, in 1 / (u - shift).
    shift = -0.731 * end
    b0 = parts[0] + shift * parts[1] + shift**2 * parts[2]
    b1 = parts[1] + 2.0 * shift * parts[2]
    factors, rows = linalg.lu_factor(b0), len(b0)
    step = np.zeros((2 * rows, 2 * rows))
    step[:rows] = -linalg.lu_solve(factors, np.hstack([b1, parts[2]]))
    step[rows:, :rows] = np.eye(rows)
    values = linalg.eigvals(step)
    speeds = shift + 1.0 / values[np.abs(values) > 0.5 / (end - shift)]
    near = (np.abs(speeds.imag) <= 1e-6 * np.abs(speeds)) & (speeds.real > 0.0)
    found: list[Change] = []
    for u in speeds[near & (speeds.real <= 1.001 * end)].real:
        roots = system.roots(float(u))
        on = np.flatnonzero((roots.value.imag > 0.0) & (np.abs(roots.value.real) < 1e-4 * (1.0 + np.abs(roots.value))))
        for i in on:
            one = flutter_at(system, float(u), float(roots.value[i].imag))
            if one and one.speed <= end and not any(_same(one, other) for other in found):
                found.append(one)
    return found


def _same(a: Change, b: Change) -> bool:
    return (
        abs(a.speed - b.speed) <= 1e-10 * a.speed + a.error + b.error
        and abs(a.frequency - b.frequency) <= 1e-6 * (1.0 + a.frequency)
    )


# --------------------------------------------------------------------------------------- samples

SHARES = np.linspace(0.0, 1.0, 17)


def _cubic(a: float, b: float, slope_a: float, slope_b: float, h: float) -> tuple[Array, float]:
    """Values of Hermite's cubic at `SHARES`, and by how much the trapezoid rule misses b - a."""
    t = SHARES
    value = (1 + 2 * t) * (1 - t) ** 2 * a + t * t * (3 - 2 * t) * b
    value += h * (t * (1 - t) ** 2 * slope_a - t * t * (1 - t) * slope_b)
    return value, abs(b - a - 0.5 * h * (slope_a + slope_b))


def _near(roots: Roots, h: float) -> Array:
    """Roots that may reach the axis within a step."""
    reach = 2.0 * h * np.abs(roots.slope) + roots.error
    return (roots.value.imag > 0.0) & (roots.sign == 0) & ~(np.abs(roots.value.real) > reach)


def _across(a: Roots, b: Roots) -> list[tuple[float, float]] | None:
    """Guesses of speed and frequency of all crossings between two samples; None if not known."""
    h = b.speed - a.speed
    near_a, near_b = np.flatnonzero(_near(a, h)), np.flatnonzero(_near(b, h))
    above_a, above_b = (np.flatnonzero(one.value.imag > 0.0) for one in (a, b))
    guesses: list[tuple[float, float]] = []
    if near_a.size + near_b.size == 0:
        pass
    elif above_a.size == 0 or above_b.size == 0:
        return None
    else:
        ahead = a.value[above_a] + 0.5 * h * a.slope[above_a]
        behind = b.value[above_b] - 0.5 * h * b.slope[above_b]
        apart = np.abs(ahead[:, None] - behind)
        apart[~np.isfinite(apart)] = np.inf
        to_b, to_a = apart.argmin(axis=1), apart.argmin(axis=0)
        pairs = {(i, to_b[i]) for i in np.flatnonzero(np.isin(above_a, near_a))}
        pairs |= {(to_a[j], j) for j in np.flatnonzero(np.isin(above_b, near_b))}
        for i, j in sorted(pairs):
            least, p, q = apart[i, j], above_a[i], above_b[j]
            if a.faint[p] and b.faint[q]:
                continue
            if to_b[i] != j or to_a[j] != i or not least < np.inf:
                return None
            others = np.concatenate([np.delete(apart[i], j), np.delete(apart[:, j], i), [np.inf]])
            if others.min() < 3.0 * least:
                return None
            value, missed = _cubic(
                *(a.value[p].real, b.value[q].real, a.slope[p].real, b.slope[q].real, h)
            )
            missed += a.error[p] + b.error[q]
            if np.all(np.abs(value) > missed) and (np.all(value > 0.0) or np.all(value < 0.0)):
                continue
            rises = np.diff(value) * np.sign(value[-1] - value[0])
            unclear = np.flatnonzero(np.abs(value) <= missed)
            low = max(0, unclear.min() - 1) if unclear.size else 0
            high = unclear.max() + 1 if unclear.size else rises.size
            signs = np.sign(value[np.abs(value) > missed])
            if not (value[0] * value[-1] < 0.0 and min(abs(value[0]), abs(value[-1])) > missed):
                return None
            if np.sum(np.diff(signs) != 0) != 1 or not np.all(rises[low:high] > 0.0):
                return None
            if missed > 0.2 * (np.abs(value[-1] - value[0])):
                return None
            share = float(np.interp(0.0, value[:: int(np.sign(value[-1]))], SHARES[:: int(np.sign(value[-1]))]))
            frequency = (1.0 - share) * a.value[p].imag + share * b.value[q].imag
            guesses.append((a.speed + share * h, float(frequency)))
    return guesses


def _parts_kept(a: Roots, b: Roots, every: bool) -> bool:
    """Whether the roots on the axis keep their order and cannot meet between two samples.

    every: whether any neighbours can meet, as those of a circulatory system, or only two whose
    energies have opposite signs.
    """
    h = b.speed - a.speed
    on_a, on_b = (np.flatnonzero((one.sign != 0) & (one.value.imag > 0.0)) for one in (a, b))
    if on_a.size != on_b.size or np.any(a.sign[on_a] != b.sign[on_b]):
        return False
    for k in range(on_a.size - 1):
        i, j = on_a[k : k + 2], on_b[k : k + 2]
        if not every and a.sign[i[0]] == a.sign[i[1]]:
            continue
        gaps = [float(np.diff(one)[0]) for one in (a.value[i].imag, b.value[j].imag)]
        slopes = [float(np.diff(one)[0]) for one in (a.slope[i].imag, b.slope[j].imag)]
        value, missed = _cubic(*gaps, *slopes, h)
        if not np.all(value > missed):
            return False
    return True


def sampled_flutter(system: System, stops: list[float]) -> list[Change]:
    """All flutter between stops, among them all divergences, from samples as close as needed."""
    found: list[Change] = []
    kept_on_axis = system.is_lossless or system.is_circulatory
    steps = []
    for low, high in zip(stops[:-1], stops[1:], strict=True):
        if high - low <= 4.0 * NARROW * high:
            continue
        count = max(1, math.ceil((high - low) / max(0.25, stops[-1] / 40.0)))
        edges = np.linspace(low, high, count + 1).tolist()
        # At a divergence itself nothing can be counted.
        edges[0], edges[-1] = edges[0] * (1.0 + NARROW), edges[-1] * (1.0 - NARROW)
        steps += list(zip(edges[:-1], edges[1:], strict=True))
    work = 0
    while steps:
        low, high = steps.pop()
        a, b = system.roots(low), system.roots(high)
        work += 1
        if work > 4000:
            raise Unsure("too many samples")
        narrow = high - low <= NARROW * high
        if kept_on_axis:
            if system.unstable(low) == system.unstable(high) or narrow:
                near = any(_near(one, high - low).any() for one in (a, b))
                if narrow or (not near and _parts_kept(a, b, system.is_circulatory)):
                    if system.unstable(low) != system.unstable(high):
                        found.append(_meeting(system, low, high))
                    continue
        else:
            guesses = _across(a, b)
            if guesses is not None or narrow:
                changes = [flutter_at(system, *guess) for guess in guesses or ()]
                slack = 0.01 * (high - low)
                if all(c is not None and low - slack <= c.speed <= high + slack for c in changes):
                    found += [c for c in changes if c is not None]
                    if narrow and guesses is None and system.unstable(low) != system.unstable(high):
                        found += _any_flutter(system, low, high)
                    continue
                if narrow:
                    raise Unsure(f"no crossing between u = {low!r} and {high!r}")
        middle = 0.5 * (low + high)
        steps += [(low, middle), (middle, high)]
    return found


def _any_flutter(system: System, low: float, high: float) -> list[Change]:
    """A crossing in a step too short to divide."""
    roots = system.roots(low)
    above = np.flatnonzero(roots.value.imag > 0.0)
    nearest = above[np.argmin(np.abs(roots.value[above].real))]
    return [Change(0.5 * (low + high), float(roots.value[nearest].imag), high - low)]


def _meeting(system: System, low: float, high: float) -> Change:
    """Where two roots meet on the axis, by halving."""
    before = system.unstable(low)
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if system.unstable(middle) == before:
            low = middle
        else:
            high = middle
    grown = system.roots(high if system.unstable(high) > before else low)
    off = np.flatnonzero((grown.sign == 0) & (grown.value.real > 0.0) & (grown.value.imag > 0.0))
    nearest = off[np.argmin(grown.value[off].real)] if off.size else None
    frequency = 0.0 if nearest is None else float(grown.value[nearest].imag)
    return Change(high, frequency, 1e-11 * high)


# -------------------------------------------------------------------------------------- together


def first_speed(system: System) -> float:
    """Where the search begins: at rest, or if roots are on the axis there just beyond it."""
    if system.is_lossless or system.is_circulatory:
        return 0.0
    return 0.0 if system.damping.any() or system.loss is not None else 0.01


def all_changes(system: System, end: float) -> Answer:
    """Every change up to a speed, with counts; raises `Unsure`."""
    whole = system
    if system.size > LARGEST_SAMPLED:
        system = system.lowest(min(system.size, max(LARGEST_SAMPLED, 12 + math.ceil(1.1 * end))))
    static, own = divergences(whole, end), [one.speed for one in divergences(system, end)]
    start = first_speed(system)
    if system.is_closed and linalg.eigvalsh(system.still, subset_by_index=[0, 0])[0] > 0.0:
        start = own[0] if own else end
    stops = sorted({start, *(u for u in own if u > start), end})
    if system.size <= LARGEST_BIALTERNATE and whole.loss is None and not (
        system.is_lossless or system.is_circulatory
    ):
        flutter = bialternate_flutter(system, end)
    else:
        flutter = sampled_flutter(system, stops)
    if whole is not system:
        exact = [in_other(whole, one) for one in flutter]
        if None in exact:
            raise Unsure(f"changes of {system.size} modes are none of all: {flutter}")
        flutter = [one for one in exact if one is not None and one.speed <= end]
    return _counted(whole, static, flutter, first_speed(system), end)


def in_other(system: System, change: Change) -> Change | None:
    """The flutter of another system, of more functions, next to that of one."""
    if not system.is_circulatory:
        at = meeting_at if system.is_lossless else flutter_at
        return at(system, change.speed, change.frequency)
    for share in (1e-9, 1e-7, 1e-5, 1e-4):
        low, high = ((1.0 + side * share) * change.speed for side in (-1.0, 1.0))
        if system.unstable(low) != system.unstable(high):
            return _meeting(system, low, high)
    return None


def _counted(
    system: System, static: list[Change], flutter: list[Change], start: float, end: float
) -> Answer:
    """The changes in order with the number of unstable roots between them."""
    changes = sorted([*static, *flutter], key=lambda one: one.speed)
    edges = [start, *(one.speed for one in changes), end]
    counts: list[tuple[int, int]] = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        if high - low <= 1e-9 * high and counts:
            counts.append(counts[-1])  # too short to be looked at: as if nothing changed yet
            continue
        middle = 0.5 * (low + high) if low else min(0.5 * high, 0.01)
        if system.loss is not None and low:  # far beyond a loss of stability it means little
            middle = min(middle, low * (1.0 + 5e-4))
        counts.append(system.unstable(middle))
    for i, one in enumerate(changes):  # a pair changes the count by two, four roots by four
        (least, most), (before, at_most) = counts[i + 1], counts[i]
        together = sum(abs(one.speed - c.speed) <= 2e-9 * one.speed for c in changes)
        step = max(least - at_most, before - most)
        if system.loss is None and step > together * (4 if system.is_lossless else 2):
            raise Unsure(f"counts {counts} do not fit changes {changes}")
    return Answer(tuple(changes), tuple(counts))


def of_rank(matrix: Array, rank: int) -> Array:
    """The matrix of this rank next to another."""
    left, size, right = np.linalg.svd(matrix)
    return (left[:, :rank] * size[:rank]) @ right[:rank]


def system_of(model: Any, closed: bool, resisted: bool) -> System:
    """The matrices of a model of the package, in its elastic coordinates.

    closed, resisted: whether no energy passes an end, and whether anything dissipates.
    """
    ops, pipe, loss = model.elastic_operators(), model.pipe, None
    if pipe.hysteresis:  # damping is proportional to what the material loses
        more = model.with_pipe(replace(pipe, damping=pipe.damping + 1.0)).elastic_operators()
        loss = pipe.hysteresis * (more.damping - ops.damping)
    gyro, end = ops.direction * ops.gyroscopic, ops.direction * ops.end_flux
    mass, damping, still = (0.5 * (of + of.T) for of in (ops.mass, ops.damping, ops.stiffness))
    gyro, end, thrust = 0.5 * (gyro - gyro.T), 0.5 * (end + end.T), ops.centrifugal * ops.flux
    if closed:  # but for rounding
        end, thrust = 0.0 * end, 0.5 * (thrust + thrust.T)
    else:  # of rank one, and in its skew part two, but for rounding
        skew = 0.5 * (thrust - thrust.T)
        end, thrust = of_rank(end, 1), thrust - skew + of_rank(skew, 2)
    return System(mass, gyro, end, damping if resisted else 0.0 * damping, still, thrust, loss)
