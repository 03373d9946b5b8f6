# SPDX-License-Identifier: MIT
"""Every change of the number of unstable roots of P(lambda, u), found without the package.

P = lambda^2 M + lambda (u G + D) + K0 + u^2 K2, and i L besides where a material loses energy by
hysteresis. Three programs, by what the matrices are:

- Divergence: det(K0 + u^2 K2) = 0 is an eigenproblem in u^2.
- Flutter of a few functions with damping: all u at which two roots add up to zero, from one
  eigenproblem in u (the bialternate product; Guckenheimer, Myers and Sturmfels 1997).
- Else samples of all roots with their derivatives, close enough that cubics through two samples
  say what each root near the axis does between. Without dissipation the order of the frequencies
  on the axis and of the signs of their energies (Krein) tells which pairs can meet.

The number of unstable roots between all changes is then taken from all roots there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import linalg

Array = np.ndarray[Any, Any]

LARGEST_BIALTERNATE = 6
"""Degrees of freedom up to which the bialternate product is formed: a pencil of 132 rows."""

LARGEST_SAMPLED = 24
"""Degrees of freedom up to which all roots are sampled; beyond, those of the lowest modes, and the
whole system says where exactly the changes are, and counts."""

NARROW = 1e-7
"""Ranges of unstable speeds below this share of the speed are not looked for."""

MOST_SAMPLES = 4000

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

    on_axis: of a system of which roots stay on the axis, the sign of the energy of those that are
    there, and 0 of the others; None of other systems.
    """

    speed: float
    value: Array
    slope: Array
    error: Array
    on_axis: Array | None

    def faint(self, share: float = 1.0) -> Array:
        """Which roots are so close to the axis that rounding hides their side."""
        if self.on_axis is not None:
            return np.zeros(self.value.size, dtype=bool)
        return np.abs(self.value.real) <= share * self.error

    def unstable(self) -> tuple[int, int]:
        """How many grow, at least and at most."""
        weight, faint = np.where(self.value.imag == 0.0, 1, 2), self.faint()
        grows = (self.value.real > 0.0) & ~faint
        if self.on_axis is not None:
            grows &= self.on_axis == 0
        least = int(np.sum(weight[grows]))
        return least, least + int(np.sum(weight[faint]))

    def near(self, step: float) -> Array:
        """Which roots off the axis may reach it within a step of the speed."""
        near = ~(np.abs(self.value.real) > 2.0 * step * np.abs(self.slope) + self.error)
        near &= self.value.imag > 0.0
        return near if self.on_axis is None else near & (self.on_axis == 0)


@dataclass(frozen=True, eq=False)
class System:
    """The matrices, real and of one size; `loss`, L, is None without hysteresis.

    G = gyro + end, the first skew. M, end, D, K0 and L are symmetric, `thrust`, K2, where no energy
    passes an end.
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

    @property
    def stays_on_axis(self) -> bool:
        """Whether roots stay on the axis until two meet."""
        return self.is_lossless or self.is_circulatory

    def at(self, u: float) -> tuple[Array, Array, Array]:
        """M, C and K."""
        k = self.still + u * u * self.thrust
        return (
            self.mass,
            u * self.flow + self.damping,
            k if self.loss is None else k + 1j * self.loss,
        )

    def roots(self, u: float) -> Roots:
        """All roots at a speed, kept."""
        if u not in self.samples:
            self.samples[u] = _roots(self, u)
        return self.samples[u]

    def without_loss(self) -> System:
        return replace(self, loss=None, samples={})

    def unstable(self, u: float) -> tuple[int, int]:
        """Number of unstable roots, at least and at most.

        With a loss that of pairs that oscillate, and of the real roots without it.
        """
        least, most = self.roots(u).unstable()
        if self.loss is None:
            return least, most
        still = self.without_loss().roots(u).value
        real = int(np.sum((still.imag == 0.0) & (still.real > 0.0)))
        return least + real, most + real

    def lowest(self, count: int) -> System:
        """The same in its `count` lowest modes at rest."""
        least = float(linalg.eigvalsh(self.still, subset_by_index=[0, 0])[0])
        shifted = self.still + max(0.0, 1.0 - least) * np.eye(self.size)
        modes = linalg.eigh(self.mass, shifted)[1][:, ::-1][:, :count]
        return projected(self, modes)


def projected(system: System, basis: Array) -> System:
    """The system in other coordinates or fewer; symmetric and skew parts stay so."""

    def of(matrix: Array | None, sign: float = 1.0) -> Array | None:
        if matrix is None:
            return None
        made = basis.T @ matrix @ basis
        return 0.5 * (made + sign * made.T) if sign else made

    signs = {"gyro": -1.0, "thrust": 1.0 if system.is_closed else 0.0}
    names = ("mass", "gyro", "end", "damping", "still", "thrust", "loss")
    return System(*(of(getattr(system, name), signs.get(name, 1.0)) for name in names))


def _roots(system: System, u: float) -> Roots:
    """By the companion matrix of the problem in mu = 1 / (lambda - shift), and Rayleigh's quotient.

    Low roots then keep their digits beside high ones.
    """
    m, c, k = system.at(u)
    n, shift, lossy = len(m), 2.9 + 0.7 * u, system.loss is not None
    factors = linalg.lu_factor(shift * shift * m + shift * c + k)
    step = np.zeros((2 * n, 2 * n), dtype=factors[0].dtype)
    step[:n] = -linalg.lu_solve(factors, np.hstack([c + 2.0 * shift * m, m]))
    step[n:, :n] = np.eye(n)
    mu, left, right = linalg.eig(step, left=True)
    with np.errstate(all="ignore"):
        value = shift + 1.0 / mu
        # With a loss only roots above the axis are roots; else those below are conjugate to them.
        kept = value.imag > 1e-13 * np.abs(value) if lossy else value.imag >= 0.0
        kept &= np.isfinite(value)
        # Vectors are known the less, the closer their roots lie and the less normal the problem.
        gaps = np.abs(mu - mu[:, None]) + np.where(np.eye(2 * n), np.inf, 0.0)
        value, left, right = value[kept], left[:, kept], right[:, kept]
        turned = np.abs(np.sum(left.conj() * right, axis=0)) * gaps.min(axis=1)[kept]
        # The 2-norm is at most the root of the product of the 1-norm and the infinity norm.
        norm = math.sqrt(np.linalg.norm(step, 1) * np.linalg.norm(step, np.inf))
        turned = 4.0 * EPSILON * norm / turned
        x, y = right[n:], linalg.lu_solve(factors, left[:n].conj(), trans=1)
        x, y = x / np.linalg.norm(x, axis=0), y / np.linalg.norm(y, axis=0)
        products = [np.sum(y * (one @ x), axis=0) for one in (m, c, k, system.flow, system.thrust)]
        ym, yc, yk, by_flow, by_thrust = products
        for _ in range(2):
            move = (value * (value * ym + yc) + yk) / (2.0 * value * ym + yc)
            move = np.where((value.imag == 0.0) & (not lossy), move.real, move)
            value = value - np.where(np.abs(move) < 1e-3 * np.abs(value), move, 0.0)
        by_value = 2.0 * value * ym + yc
        slope = -(value * by_flow + 2.0 * u * by_thrust) / by_value
        size, ax = np.abs(value), np.abs(x)
        terms = size * (size * (np.abs(m) @ ax) + np.abs(c) @ ax) + np.abs(k) @ ax
        error = 8.0 * EPSILON * np.sum(np.abs(y) * terms, axis=0) / np.abs(by_value)
        rho, of_rho = _growth(system, u, value.imag, x, turned)
        better = (value.imag > 0.0) & (of_rho < error)
        better &= np.abs(rho - value.real) < 10.0 * error + of_rho
    value, error = np.where(better, rho + 1j * value.imag, value), np.where(better, of_rho, error)
    on_axis = None
    if system.is_circulatory:  # lambda^2 is real but for rounding
        square = value**2
        near = np.abs(square.imag) <= 1e-8 * np.abs(square)
        on_axis = np.where(near & (square.real < 0.0), 1, 0)
    elif system.is_lossless:
        # x^H P x = 0 is a quadratic in omega, with real solutions where lambda is on the axis;
        # the derivative by omega has the sign of the energy.
        a, b, e = (np.sum(x.conj() * (one @ x), axis=0).real for one in (m, 1j * c, k))
        on = b * b + 4.0 * a * e > -1e-12 * (b * b + 4.0 * np.abs(a * e))
        on_axis = np.where(on & (value.imag > 0.0), np.sign(2.0 * a * value.imag - b), 0).astype(
            int
        )
    order = np.argsort(value.imag, kind="stable")
    signs = None if on_axis is None else on_axis[order]
    return Roots(u, value[order], slope[order], error[order], signs)


def _growth(system: System, u: float, w: Array, x: Array, turned: Array) -> tuple[Array, Array]:
    """Real parts of roots with imaginary parts w, and their errors.

    From the imaginary part of x^H P x = 0: of what dissipates and follows alone, not as a small
    difference of what is large.
    """
    lost, skew = system.damping + u * system.end, 0.5 * (system.thrust - system.thrust.T)
    a, g, d, f = (
        np.sum(x.conj() * (one @ x), axis=0) for one in (system.mass, system.gyro, lost, skew)
    )
    fed, below = d.real * w + u * u * f.imag, 2.0 * a.real * w + u * g.imag
    parts = [(w, lost), (u * u, skew)]
    if system.loss is not None:
        fed = fed + np.sum(x.conj() * (system.loss @ x), axis=0).real
        parts.append((1.0, system.loss))
    # A turned vector, and rounding of the damping matrix; others have no more than their ranks.
    error = 4.0 * EPSILON * w * np.abs(system.damping).max()
    for factor, one in parts:
        moved = np.linalg.norm(one @ x, axis=0) + turned * np.abs(one).max()
        error = error + 2.0 * turned * factor * moved
    return -fed / below, error / np.abs(below)


# ------------------------------------------------------------------------------------ divergence


def divergences(system: System, end: float) -> list[Change]:
    """Speeds in (0, end] at which K is singular, from one eigenproblem in u^2."""
    still, thrust = system.still, system.thrust
    if not thrust.any():
        return []
    squares = np.zeros(0)
    with np.errstate(divide="ignore"):
        # K0 + s K2 with s = s0 + t: K(s0)^-1 K2 x = -x / t.
        for shift in (-1.0, -100.0, -1e4, -1e6) if system.is_closed else ():
            try:
                squares = shift - 1.0 / linalg.eigh(thrust, still + shift * thrust)[0]
                break
            except linalg.LinAlgError:  # K(s0) is not positive definite
                continue
        else:
            shift = -0.937
            values = linalg.eigvals(linalg.solve(still + shift * thrust, thrust))
            near = values[(values != 0.0) & (np.abs(values.imag) <= 1e-7 * np.abs(values))]
            squares = (shift - 1.0 / near).real
    found = []
    for u in np.sqrt(squares[(squares > 0.0) & (squares < 1.02 * end * end)]).tolist():
        error = math.inf
        for _ in range(3):  # Newton's method with the vectors of the singular value nearest 0
            left, sizes, right = np.linalg.svd(still + u * u * thrust)
            slope = 2.0 * u * float(left[:, -1] @ thrust @ right[-1])
            terms = np.abs(left[:, -1]) @ (np.abs(still) + u * u * np.abs(thrust))
            error = 4.0 * EPSILON * float(terms @ np.abs(right[-1])) / max(abs(slope), 1e-300)
            if not sizes[-1] < 1e-3 * abs(slope) * u:
                break
            u -= float(sizes[-1]) / slope
        if 0.0 < u <= end:
            found.append(Change(u, 0.0, min(error, 1e-6 * u)))
    return sorted(found, key=lambda one: one.speed)


# --------------------------------------------------------------------------------------- flutter


def flutter_at(system: System, u: float, frequency: float) -> Change | None:
    """The crossing next to a guess, by Newton's method with vectors of inverse iteration."""
    x, y = np.random.default_rng(system.size).standard_normal((2, system.size)) + 0j
    start, du = (u, frequency), math.inf
    for _ in range(12):
        m, c, k = system.at(u)
        value = 1j * frequency
        dynamic = value * value * m + value * c + k
        off_zero = EPSILON * np.abs(dynamic).max() * np.eye(system.size)  # where it is singular
        factors = linalg.lu_factor(dynamic + off_zero)
        for _ in range(3):
            x, y = linalg.lu_solve(factors, x), linalg.lu_solve(factors, y, trans=2)
            x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
        by_value = y.conj() @ (2.0 * value * m @ x + c @ x)
        off = -(y.conj() @ dynamic @ x) / by_value
        slope = -(y.conj() @ (value * system.flow @ x + 2.0 * u * system.thrust @ x)) / by_value
        if slope.real == 0.0 or not np.isfinite(off + slope):
            return None
        du = float(-off.real / slope.real)
        u, frequency = u + du, frequency + float(off.imag + slope.imag * du)
        if not (abs(u - start[0]) < 0.1 * start[0] and frequency > 1e-3 * start[1]):
            return None
        if abs(du) <= 1e-13 * u:
            break
    terms = frequency * (frequency * np.abs(m) + np.abs(c)) + np.abs(k)
    rounding = 8.0 * EPSILON * float(np.abs(y) @ terms @ np.abs(x))
    return Change(u, frequency, rounding / abs(by_value * slope.real) + abs(du))


def meeting_at(system: System, u: float, frequency: float) -> Change | None:
    """Where two roots of a lossless system meet on the axis, next to a guess.

    There the Hermitian K + i omega C - omega^2 M has an eigenvalue that is 0, and so is its
    derivative by omega: Newton's method for both, with derivatives by perturbation.
    """
    start = u
    for _ in range(20):
        m, c, k = system.at(u)
        theta, vectors = linalg.eigh(k + 1j * frequency * c - frequency**2 * m)
        i = int(np.argmin(np.abs(theta)))
        v, adjoint = vectors[:, i], vectors.conj().T
        by = adjoint @ (1j * (c @ v) - 2.0 * frequency * (m @ v))
        by_u = adjoint @ (1j * frequency * (system.gyro @ v) + 2.0 * u * (system.thrust @ v))
        others = np.array([1.0 / (theta[i] - t) if j != i else 0.0 for j, t in enumerate(theta)])
        twice = 2.0 * float(np.sum(np.abs(by) ** 2 * others) - (v.conj() @ m @ v).real)
        mixed = 2.0 * float(np.sum((by.conj() * by_u).real * others))
        mixed += float((1j * (v.conj() @ system.gyro @ v)).real)
        jacobian = np.array([[by[i].real, by_u[i].real], [twice, mixed]])
        step = np.linalg.lstsq(jacobian, [theta[i], by[i].real], rcond=None)[0].tolist()
        frequency, u = frequency - step[0], u - step[1]
        if not (abs(u - start) < 0.1 * start and frequency > 0.0):
            return None
        if abs(step[1]) < 1e-12 * u:
            return Change(u, frequency, 1e-11 * u)
    return None


def _meeting(system: System, low: float, high: float) -> Change:
    """Where two roots meet on the axis, by halving a step in which the count changes."""
    before = system.unstable(low)
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if system.unstable(middle) == before else (low, middle)
    roots = system.roots(max((low, high), key=system.unstable))
    off = roots.value[(roots.on_axis == 0) & (roots.value.real > 0.0) & (roots.value.imag > 0.0)]
    frequency = float(off[np.argmin(off.real)].imag) if off.size else 0.0
    return Change(high, frequency, 1e-11 * high)


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


def _bialternate(a: Array) -> Array:
    """2 A (x) I: its eigenvalues are the sums of two eigenvalues of A."""
    p, q = np.triu_indices(len(a), 1)
    one = np.eye(len(a))

    def minor(row: Array, column: Array, other: Array, rest: Array) -> Array:
        return a[row[:, None], column] * one[other[:, None], rest]

    return minor(p, p, q, q) - minor(p, q, q, p) + minor(q, q, p, p) - minor(q, p, p, q)


def bialternate_flutter(system: System, end: float) -> list[Change]:
    """All speeds in (0, end] at which two roots are i omega and -i omega."""
    n = system.size
    half = linalg.solve_triangular(linalg.cholesky(system.mass, lower=True), np.eye(n), lower=True)
    zero, parts = np.zeros((n, n)), []
    for c, k in ((system.damping, system.still), (system.flow, zero), (zero, system.thrust)):
        a = np.block([[zero, zero], [-half @ k @ half.T, -half @ c @ half.T]])
        a[:n, n:] = zero if parts else np.eye(n)
        parts.append(_bialternate(a))
    # (B0 + u B1 + u^2 B2) z = 0, in 1 / (u - shift).
    shift, rows = -0.731 * end, len(parts[0])
    factors = linalg.lu_factor(parts[0] + shift * parts[1] + shift**2 * parts[2])
    step = np.zeros((2 * rows, 2 * rows))
    step[:rows] = -linalg.lu_solve(
        factors, np.hstack([parts[1] + 2.0 * shift * parts[2], parts[2]])
    )
    step[rows:, :rows] = np.eye(rows)
    values = linalg.eigvals(step)
    speeds = shift + 1.0 / values[np.abs(values) > 0.5 / (end - shift)]
    near = (np.abs(speeds.imag) <= 1e-6 * np.abs(speeds)) & (speeds.real > 0.0)
    found: list[Change] = []
    for u in speeds.real[near & (speeds.real <= 1.001 * end)].tolist():
        value = system.roots(u).value
        on = (value.imag > 0.0) & (np.abs(value.real) < 1e-4 * (1.0 + np.abs(value)))
        for frequency in value.imag[on].tolist():
            one = flutter_at(system, u, frequency)
            if one and one.speed <= end and not any(_same(one, other) for other in found):
                found.append(one)
    return found


def _same(a: Change, b: Change) -> bool:
    slack = 1e-10 * a.speed + a.error + b.error
    near = abs(a.frequency - b.frequency) <= 1e-6 * (1.0 + a.frequency)
    return near and abs(a.speed - b.speed) <= slack


# --------------------------------------------------------------------------------------- samples

SHARES = np.linspace(0.0, 1.0, 17)


def _cubic(ends: tuple[float, float], slopes: tuple[float, float], h: float) -> tuple[Array, float]:
    """Values of Hermite's cubic at `SHARES`, and how far the trapezoid rule misses, its bound."""
    t, (a, b), (at_a, at_b) = SHARES, ends, slopes
    value = (1 + 2 * t) * (1 - t) ** 2 * a + t * t * (3 - 2 * t) * b
    value += h * (t * (1 - t) ** 2 * at_a - t * t * (1 - t) * at_b)
    return value, abs(b - a - 0.5 * h * (at_a + at_b))


def _crossing_share(a: Roots, p: int, b: Roots, q: int) -> float | None:
    """Share of a step at which a root crosses the axis, NaN if it does not; None if not known."""
    ends = float(a.value[p].real), float(b.value[q].real)
    if a.faint(4.0)[p] and b.faint(4.0)[q]:
        return ends[0] / (ends[0] - ends[1]) if ends[0] * ends[1] < 0.0 else math.nan
    slopes = float(a.slope[p].real), float(b.slope[q].real)
    value, missed = _cubic(ends, slopes, b.speed - a.speed)
    missed += a.error[p] + b.error[q]
    clear = np.abs(value) > missed
    turns = np.count_nonzero(np.diff(np.sign(value[clear])))
    if clear.all() and turns == 0:
        return math.nan
    if turns != 1 or not (clear[0] and clear[-1]) or missed > 0.2 * abs(ends[1] - ends[0]):
        return None
    unclear = np.flatnonzero(~clear)
    low, high = (max(unclear.min() - 1, 0), unclear.max() + 1) if unclear.size else (0, SHARES.size)
    sign = math.copysign(1.0, ends[1])
    if np.any(sign * np.diff(value)[low:high] <= 0.0):
        return None
    return float(np.interp(0.0, sign * value, SHARES))


def _across(a: Roots, b: Roots) -> list[tuple[float, float, bool]] | None:
    """Guesses of speed and frequency of all crossings between two samples; None if not known.

    And whether there must be one, as rounding does not hide the sides of the root.
    """
    h, guesses = b.speed - a.speed, []
    above_a, above_b = (np.flatnonzero(one.value.imag > 0.0) for one in (a, b))
    near_a, near_b = a.near(h)[above_a], b.near(h)[above_b]
    if not (near_a.any() or near_b.any()):
        return []
    if not (above_a.size and above_b.size):
        return None
    # Roots belong together if half a step along each of their tangents leads to one place.
    ahead, behind = a.value[above_a] + 0.5 * h * a.slope[above_a], b.value[above_b]
    apart = np.abs(ahead[:, None] - (behind - 0.5 * h * b.slope[above_b]))
    apart[~np.isfinite(apart)] = np.inf
    to_b, to_a = apart.argmin(axis=1), apart.argmin(axis=0)
    pairs = {(i, to_b[i]) for i in np.flatnonzero(near_a)}
    pairs |= {(to_a[j], j) for j in np.flatnonzero(near_b)}
    for i, j in sorted(pairs):
        p, q = above_a[i], above_b[j]
        sure = not (a.faint(4.0)[p] and b.faint(4.0)[q])
        if sure:
            others = np.concatenate([np.delete(apart[i], j), np.delete(apart[:, j], i), [np.inf]])
            if to_b[i] != j or to_a[j] != i or not others.min() > 3.0 * apart[i, j]:
                return None
        share = _crossing_share(a, p, b, q)
        if share is None:
            return None
        if share == share:
            frequency = (1.0 - share) * a.value[p].imag + share * b.value[q].imag
            guesses.append((a.speed + share * h, float(frequency), sure))
    return guesses


def _none_meets(a: Roots, b: Roots, any_pair: bool) -> bool:
    """Whether no roots meet on the axis, and none comes back, between two samples.

    any_pair: whether any neighbours can meet, as those of a circulatory system, or only two whose
    energies have opposite signs.
    """
    h = b.speed - a.speed
    if a.unstable() != b.unstable() or a.near(h).any() or b.near(h).any():
        return False
    on_a, on_b = np.flatnonzero(a.on_axis), np.flatnonzero(b.on_axis)
    if not np.array_equal(a.on_axis[on_a], b.on_axis[on_b]):
        return False
    for i, j in zip(pairwise(on_a), pairwise(on_b), strict=True):
        if any_pair or a.on_axis[i[0]] != a.on_axis[i[1]]:
            both = ((a, list(i)), (b, list(j)))
            gaps, slopes = (
                tuple(float(np.diff(getattr(of, name)[at].imag)[0]) for of, at in both)
                for name in ("value", "slope")
            )
            value, missed = _cubic(gaps, slopes, h)
            if not np.all(value > missed):
                return False
    return True


def sampled_flutter(system: System, stops: list[float]) -> list[Change]:
    """All flutter between stops, among them all divergences, from samples as close as needed."""
    found: list[Change] = []
    steps: list[tuple[float, float]] = []
    for low, high in pairwise(stops):
        # At a divergence itself nothing can be counted.
        low, high = low * (1.0 + NARROW), high * (1.0 - NARROW)
        if high - low > 2.0 * NARROW * high:
            count = max(1, math.ceil((high - low) / max(0.5, stops[-1] / 20.0)))
            steps += pairwise(np.linspace(low, high, count + 1).tolist())
    work = 0
    while steps:
        low, high = steps.pop()
        work += 1
        if work > MOST_SAMPLES:
            raise Unsure("too many samples")
        a, b, narrow = system.roots(low), system.roots(high), high - low <= NARROW * high
        if system.stays_on_axis:
            if narrow and a.unstable() != b.unstable():
                found.append(_meeting(system, low, high))
            if narrow or _none_meets(a, b, system.is_circulatory):
                continue
        else:
            guesses = _across(a, b)
            if narrow and guesses is None:
                guesses = []
                if a.unstable() != b.unstable():
                    value = a.value[a.value.imag > 0.0]
                    frequency = float(value[np.argmin(np.abs(value.real))].imag)
                    found.append(
                        flutter_at(system, high, frequency) or Change(high, frequency, high - low)
                    )
            slack, missed = 0.01 * (high - low), guesses is None
            crossed = []
            for speed, frequency, sure in guesses or ():
                one = flutter_at(system, speed, frequency)
                if one and low - slack <= one.speed <= high + slack:
                    crossed.append(one)
                else:
                    missed |= sure
            if not missed:
                found += crossed
                continue
            if narrow:
                raise Unsure(f"no crossing between u = {low!r} and {high!r}")
        steps += [(low, 0.5 * (low + high)), (0.5 * (low + high), high)]
    return found


# -------------------------------------------------------------------------------------- together


def all_changes(system: System, end: float, modes: float = 0.0) -> Answer:
    """Every change up to a speed, with counts; raises `Unsure`.

    modes: how many of a large system may matter, if more than the flow reaches.
    """
    whole, most = system, max(LARGEST_SAMPLED, 12 + math.ceil(max(1.1 * end, modes)))
    if system.size > most:
        system = system.lowest(most)
    # Roots on the axis at rest leave it with a power of the speed.
    at_rest = system.stays_on_axis or system.damping.any() or system.loss is not None
    first = start = 0.0 if at_rest else 0.01
    own = [one.speed for one in divergences(system, end)]
    if system.is_closed and linalg.eigvalsh(system.still, subset_by_index=[0, 0])[0] > 0.0:
        start = own[0] if own else end
    if system.size > LARGEST_BIALTERNATE or system.loss is not None or system.stays_on_axis:
        flutter = sampled_flutter(system, sorted({start, end, *(u for u in own if u > start)}))
    else:
        flutter = bialternate_flutter(system, end)
    if whole is not system:
        exact = [in_other(whole, one) for one in flutter]
        if None in exact:
            raise Unsure(f"changes of {system.size} modes are none of all: {flutter}")
        flutter = [one for one in exact if one and one.speed <= end]
    return counted(whole, [*divergences(whole, end), *flutter], first, end)


def counted(system: System, changes: list[Change], start: float, end: float) -> Answer:
    """The changes in order with the number of unstable roots between them."""
    changes = sorted(changes, key=lambda one: one.speed)
    counts: list[tuple[int, int]] = []
    for low, high in pairwise([start, *(one.speed for one in changes), end]):
        if high - low <= 1e-9 * high and counts:
            counts.append(counts[-1])  # too short to be looked at: as if nothing changed yet
            continue
        middle = 0.5 * (low + high) if low else min(0.5 * high, 0.01)
        if system.loss is not None and low and not counts[0][0]:
            # Far beyond a loss of stability a growing pair and a real root may be one motion.
            middle = min(middle, low * (1.0 + 5e-4))
        counts.append(system.unstable(middle))
    for one, before, after in zip(changes, counts[:-1], counts[1:], strict=True):
        # A pair changes the count by two, four roots by four.
        together = sum(abs(one.speed - c.speed) <= 2e-9 * one.speed for c in changes)
        step = max(after[0] - before[1], before[0] - after[1])
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
    gyro, end, thrust = ops.gyroscopic, of_rank(ops.end_flux, 1), ops.centrifugal * ops.flux
    damping = ops.damping if resisted else 0.0 * ops.damping
    skew = 0.5 * (thrust - thrust.T)
    # The force that follows the end has rank two, and what flows through it one, but for rounding.
    end, thrust = (0.0 * end, thrust - skew) if closed else (end, thrust - skew + of_rank(skew, 2))
    sign, straight = ops.direction, np.eye(len(thrust))
    made = System(ops.mass, sign * gyro, sign * end, damping, ops.stiffness, thrust, loss)
    return projected(made, straight)
