# SPDX-License-Identifier: MIT
"""Where eigenvalues pass through the imaginary axis as the flow speed grows.

Each step of a followed sweep (see `pipedyn.follow`) gives a cubic for the real part of every branch.
The step is believed where no extremum of the cubic lies closer to the axis than the cubic's own
error, and halved elsewhere; so a branch that touches the axis between two samples, or passes it twice,
is found. Each passage is then polished by Newton's method with d lambda / du on the model itself.

Without damping and without fluid mass (beta = 0), lambda^2 is real: branches lie on the axis until
two of them meet (flutter) or one reaches zero (divergence), and lambda^2 is followed instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from pipedyn._check import Array
from pipedyn.follow import LONGEST_STEP, STUCK, Indices, Sample, Step, march, sample
from pipedyn.galerkin import Galerkin
from pipedyn.model import Model, NotConverged
from pipedyn.spectrum import (
    BandPencil,
    Complex,
    DensePencil,
    Eigenpairs,
    Pencil,
    lowest,
    pencil_of,
)

ROUNDING = 1e-13
"""Relative error that an eigenvalue may have before its real part's sign is doubted."""

HIGH_DAMPING = 0.3
"""Untrusted roots with Re < -0.3 |lambda| at both ends of a step are not worth refining."""


@dataclass(frozen=True)
class Passage:
    """One passage of a root, or a conjugate pair, through the imaginary axis.

    Attributes:
        speed: u.
        value: i times the frequency there; 0 for divergence.
        change: by how many the number of unstable roots grows.
        mode: branch, counted from rest by frequency, from 1.
        error: of the speed, absolute.
        pair: eigenvalue with both vectors; None where two branches meet on the axis or at u = 0+.
        slope: d lambda / du; None where pair is.
    """

    speed: float
    value: complex
    change: int
    mode: int
    error: float
    pair: Eigenpairs | None
    slope: complex | None


@dataclass(frozen=True)
class Sweep:
    """Passages found up to `reached`, and the counts of unstable roots that frame them."""

    unstable_at_rest: int
    passages: tuple[Passage, ...]
    unstable_at_end: int
    reached: float


class _Untracked(Exception):
    """A root outside the followed set became unstable: more must be followed."""


def sweep(
    model: Model, max_speed: float, until: Callable[[Passage], bool] | None = None, trusted: int | None = None
) -> Sweep:
    """All passages up to max_speed, or up to the first that `until` accepts.

    Args:
        model: chain or reduced model.
        max_speed: end of the search.
        until: stops the search after a passage.
        trusted: how many modes, counted from rest, are looked at; all without.
    """
    pencil, followed = _pencil_for(model, max_speed)
    while True:
        hunt = _Hunt(pencil, max_speed, followed, trusted)
        try:
            return hunt.run(until)
        except _Untracked:
            assert followed is not None
            followed = 2 * followed
            if followed > pencil.dof // 3:
                pencil, followed = DensePencil(model), None


def _pencil_for(model: Model, max_speed: float) -> tuple[Pencil, int | None]:
    """The pencil, and for a long chain how many modes to follow.

    A mode of wave number k meets the flow only where k is comparable to u; with modes up to k = pi u
    and twelve more there is room, and a root beyond that turns unstable is noticed.
    """
    pencil = pencil_of(model)
    if isinstance(pencil, BandPencil):
        followed = 12 + math.ceil(max_speed)
        if followed <= pencil.dof // 4 and max_speed < pencil.dof / 4:
            return pencil, followed
        pencil = DensePencil(model)
    return pencil, None


class _Hunt:
    """One sweep from rest."""

    def __init__(self, pencil: Pencil, max_speed: float, followed: int | None, trusted: int | None):
        self.pencil = pencil
        self.max_speed = max_speed
        self.followed = followed
        self.limit = trusted if trusted is not None else pencil.dof
        self.free = pencil.velocity_free(1.0)
        self.modes: Indices = np.zeros(0, dtype=np.intp)
        # Legendre's highest third is not the pipe's and heavily damped: matched, but not followed.
        legendre = isinstance(pencil.model, Galerkin) and pencil.model.basis == "legendre"
        certain = pencil.dof if followed is None else followed
        if legendre:
            certain = max(1, (2 * certain) // 3)
        self.wanted = certain if self.free else 2 * certain

    def take(self, u: float) -> Sample:
        """The sample at u; of lambda^2 where lambda enters only so."""
        count = None if self.followed is None else 2 * self.followed + 16
        if not self.free:
            return sample(self.pencil, u, count)
        pairs = lowest(self.pencil, u, count, left=True)
        values = pairs.values
        pairs = pairs.take((values.real > 0.0) | ((values.real == 0.0) & (values.imag > 0.0)))
        slopes = 2.0 * pairs.values * self.pencil.slopes(u, pairs)
        squares = replace(pairs, values=pairs.values**2)
        squares.values.imag[pairs.values.real == 0.0] = 0.0
        squares.values.imag[pairs.values.imag == 0.0] = 0.0
        return Sample(u, squares, np.where(np.isfinite(slopes), slopes, 0.0))

    def run(self, until: Callable[[Passage], bool] | None) -> Sweep:
        count = max(1, math.ceil(self.max_speed / LONGEST_STEP))
        speeds = np.linspace(0.0, self.max_speed, count + 1)
        passages: list[Passage] = []
        first = self.take(0.0)
        self.modes = (np.arange(first.values.size) + 1) if self.free else modes_at_rest(first.values, self.pencil)
        at_rest = unstable = self.unstable(first)
        reached = 0.0
        for step in march(self.take, first, speeds[1:], self.wanted, self.sure):
            for passage in self.passages(step):
                passages.append(passage)
                if until is not None and until(passage):
                    return Sweep(at_rest, tuple(passages), unstable + passage.change, passage.speed)
                unstable += passage.change
            self.modes = self.moved(step)
            reached = step.right.u
            if unstable != self.unstable(step.right):
                raise NotConverged(
                    f"{self.unstable(step.right)} unstable roots at u = {reached:g}, where the "
                    f"passages found account for {unstable}",
                    Sweep(at_rest, tuple(passages), unstable, step.left.u),
                )
        return Sweep(at_rest, tuple(passages), unstable, reached)

    def moved(self, step: Step) -> Indices:
        """Mode of each root of the step's right sample; 0 for those that came from outside."""
        modes = np.zeros(step.right.values.size, dtype=np.intp)
        there = step.onto >= 0
        modes[step.onto[there]] = self.modes[there]
        if self.followed is not None and not self.free:
            loose = (modes == 0) | (modes > self.followed)
            if bool((step.right.values.real[loose] > 0.0).any()):
                raise _Untracked
        return modes

    def unstable(self, at: Sample) -> int:
        """Number of unstable roots among the trusted."""
        mine = (self.modes >= 1) & (self.modes <= self.limit) & (np.abs(at.values) >= STUCK)
        if at.u == 0.0:
            values = at.values if not self.free else np.sqrt(at.values)
            return int(np.sum(values.real[mine] > STUCK))
        if self.free:
            roots = np.sqrt(at.values[mine])
            complex_roots = at.values.imag[mine] != 0.0
            return int(np.sum(complex_roots | (roots.real > STUCK)))
        return int(np.sum(at.values.real[mine] > 0.0))

    def rows(self, step: Step) -> Indices:
        """Roots to look at: one of each conjugate pair, trusted, not heavily damped throughout."""
        a, b = step.left.values, step.right.values[step.onto]
        mine = (self.modes >= 1) & (self.modes <= self.limit) & (step.onto >= 0)
        mine &= (a.imag > 0.0) | (a.imag == 0.0)
        resting = (np.abs(a) < STUCK) & (np.abs(b) < STUCK)
        mine &= ~resting
        if not self.free:
            damped = (a.real < -HIGH_DAMPING * np.abs(a)) & (b.real < -HIGH_DAMPING * np.abs(b))
            mine &= ~(damped & (self.modes > self.wanted // 2))
        return np.flatnonzero(mine)

    def sure(self, step: Step) -> bool:
        """Whether the step tells all passages in it."""
        roots = self.rows(step)
        if self.free:
            return _kinds_agree(step, roots)
        meeting = roots[step.meets[roots] >= 0]
        return _scan(self.start(step), step, roots[step.meets[roots] < 0]) is not None and all(
            _meets_off_axis(step, int(i)) for i in meeting
        )

    def start(self, step: Step) -> Array:
        """Real parts on the step's left; exactly 0 at rest without damping."""
        if step.left.u == 0.0 and self.pencil.velocity_free(0.0):
            on_axis = step.left.values.imag != 0.0
            return np.where(on_axis, 0.0, step.left.values.real)
        return step.left.values.real

    def passages(self, step: Step) -> list[Passage]:
        """Passages within a step, in order of speed."""
        roots = self.rows(step)
        if self.free:
            found = self._free_passages(step, roots)
            return sorted(found, key=lambda passage: passage.speed)
        found = []
        single = roots[step.meets[roots] < 0]
        start = self.start(step)
        if step.left.u == 0.0:
            leaving = single[(start[single] == 0.0) & (step.left.slopes.real[single] > 0.0)]
            for root in leaving[np.argsort(self.modes[leaving])]:
                value = complex(0.0, step.left.values.imag[root])
                found.append(Passage(0.0, value, 2, int(self.modes[root]), 0.0, None, None))
        for root, t, rising in _scan(start, step, single) or _ends(start, step, single):
            found.append(self._polish(step, root, t, rising))
        for i in roots[step.meets[roots] >= 0]:
            before, after = _unstable_of(step, int(i))
            if before != after and i < step.meets[i]:
                speed = 0.5 * (step.left.u + step.right.u)
                value = complex(0.0, abs(step.left.values[i].imag))
                found.append(Passage(speed, value, after - before, int(self.modes[i]), step.length, None, None))
        return sorted(found, key=lambda passage: passage.speed)

    def _polish(self, step: Step, root: int, t: float, rising: bool) -> Passage:
        """A passage to rounding, by Newton's method on the model itself."""
        pencil = self.pencil
        real = step.left.values[root].imag == 0.0
        u = step.left.u + t * step.length
        guess = complex(step.hermite(np.array([root]), np.array([t]))[0, 0])
        vector = step.left.pairs.right[:, root]
        slack = 1e-9 * (1.0 + u) + 0.1 * step.length
        last = math.inf
        for _ in range(12):
            pair = pencil.refine(u, guess, vector)
            slope = complex(pencil.slopes(u, pair)[0])
            value = complex(pair.values[0])
            change = -value.real / slope.real
            if not (math.isfinite(change) and step.left.u - slack <= u + change <= step.right.u + slack):
                break
            u, vector = max(u + change, 0.0), pair.right[:, 0]
            guess = value + slope * change
            if abs(change) <= 4e-16 * u or abs(change) >= last:
                break
            last = abs(change)
        pair = pencil.refine(u, guess, vector)
        slope = complex(pencil.slopes(u, pair)[0])
        value = complex(pair.values[0])
        residual = pair.residuals[0] * (abs(value) ** 2 + 1.0) + ROUNDING * abs(value)
        if not pair.converged[0] or (slope.real > 0.0) != rising or abs(value.real) > 1e-6 * (1.0 + abs(value)):
            u = self._bisect(step, root)
            near = self._nearest(u, step, root)
            pair, slope = near.pairs, complex(near.slopes[0])
            value = complex(pair.values[0])
        assert pair.left is not None
        derivative = abs(complex(pencil.derivative(u, pair.values, pair.right, pair.left)[0]))
        rest = pencil.residuals(u, pair.values, pair.right)[0]
        size = abs(value) ** 2 * float(np.linalg.norm(pencil.mass(pair.right)))
        size += abs(value) * float(np.linalg.norm(pencil.damped(u, pair.right)))
        size += 1.0 + abs(self.pencil.pipe.gamma) + pencil.centrifugal * u**2
        uncertain = (rest + np.finfo(float).eps) * size / derivative + abs(value.real)
        error = float(uncertain / abs(slope.real)) if slope.real else residual
        change_of_count = (1 if real else 2) * (1 if rising else -1)
        frequency = 0.0 if real else abs(value.imag)
        return Passage(
            u, complex(0.0, frequency), change_of_count, int(self.modes[root]), error, pair, slope
        )

    def _nearest(self, u: float, step: Step, root: int) -> Sample:
        """The root's own eigenvalue at a speed within the step."""
        at = sample(self.pencil, u, None if self.followed is None else 2 * self.followed + 16)
        t = np.array([(u - step.left.u) / step.length])
        where = int(np.argmin(np.abs(at.values - step.hermite(np.array([root]), t)[0, 0])))
        return Sample(u, at.pairs.take([where]), at.slopes[[where]])

    def _bisect(self, step: Step, root: int) -> float:
        def real_part(u: float) -> float:
            return float(self._nearest(u, step, root).values[0].real)

        low, high = real_part(step.left.u), real_part(step.right.u)
        if low * high >= 0.0:
            return step.left.u if abs(low) < abs(high) else step.right.u
        return float(brentq(real_part, step.left.u, step.right.u, xtol=1e-14, rtol=1e-14))

    def _free_passages(self, step: Step, roots: Indices) -> list[Passage]:
        """lambda^2 through zero, and pairs of lambda^2 that meet and turn complex, or back."""
        found = []
        a, b = step.left.values, step.right.values
        for i in roots:
            j = int(step.onto[i])
            before, after = a[i], b[j]
            if before.imag == 0.0 and after.imag == 0.0:
                if (before.real > 0.0) != (after.real > 0.0):
                    speed, error = self._root_of(step, int(i), lambda v: float(v[0].real), 1)
                    change = 1 if after.real > 0.0 else -1
                    mode = int(self.modes[i])
                    found.append(Passage(speed, 0j, change, mode, error, None, None))
            elif (before.imag == 0.0) != (after.imag == 0.0) and (before.imag == 0.0 or before.imag > 0.0):
                if before.imag == 0.0 and after.imag < 0.0:
                    continue  # counted with its twin
                k = int(step.meets[i])
                if k < 0:
                    continue
                centre = 0.5 * (a[i] + a[k])
                if centre.real >= 0.0:
                    continue  # both unstable before and after
                speed, error = self._root_of(
                    step, int(i), lambda v: float(((v[0] - v[1]) ** 2).real), 2
                )
                middle = self._closest(speed, step, int(i), 2)
                value = 1j * math.sqrt(max(-float(np.mean(middle).real), 0.0))
                mode = int(max(self.modes[i], self.modes[k]))
                found.append(Passage(speed, value, 2 if after.imag else -2, mode, error, None, None))
        return found

    def _closest(self, u: float, step: Step, i: int, count: int) -> Complex:
        """The eigenvalue lambda^2 (or the two that meet) nearest to where the step has them."""
        t = (u - step.left.u) / step.length
        a, b = step.left.values, step.right.values
        k = int(step.meets[i]) if count == 2 else i
        centre = 0.5 * ((1.0 - t) * (a[i] + a[k]) + t * (b[step.onto[i]] + b[step.onto[k]]))
        values = self.take(u).values
        return values[np.argsort(np.abs(values - centre))[:count]]

    def _root_of(
        self, step: Step, i: int, measure: Callable[[Complex], float], count: int
    ) -> tuple[float, float]:
        tolerance = 4e-16 * (1.0 + step.right.u)
        speed = brentq(
            lambda u: measure(self._closest(u, step, i, count)),
            *(step.left.u, step.right.u),
            xtol=tolerance,
            rtol=8.9e-16,
        )
        # Rounding of lambda^2 enters through its slope, or that of the squared difference.
        spread = 1e-6 * step.length
        high, low = (measure(self._closest(u, step, i, count)) for u in (speed + spread, speed - spread))
        slope = abs(high - low) / (2.0 * spread)
        size = float(np.abs(self._closest(speed, step, i, count)).max()) ** count
        return float(speed), tolerance + 1e-14 * size / slope if slope > 0.0 else step.length


def modes_at_rest(values: Complex, pencil: Pencil) -> Indices:
    """Mode of each root of the pipe at rest, from 1, by the square of its undamped frequency.

    Conjugates share a mode; so do two real roots with 1/a + 1/b = -delta, which is exact for
    opposite roots of an undamped buckled pipe and for overdamped modes without gravity.
    """
    modes = np.zeros(values.size, dtype=np.intp)
    groups: list[tuple[float, list[int]]] = []
    real = [i for i in range(values.size) if values[i].imag == 0.0]
    for i in np.flatnonzero(values.imag > 0.0):
        twin = np.flatnonzero(values == values[i].conj())
        groups.append((float(np.abs(values[i]) ** 2), [int(i), *map(int, twin[:1])]))
    while real:
        i = real.pop(0)
        if not real:
            groups.append((float(values[i].real ** 2), [i]))
            break
        inverse = -pencil.pipe.damping - (1.0 / values[i].real if values[i].real else 0.0)
        misfit = [abs((1.0 / values[k].real if values[k].real else 0.0) - inverse) for k in real]
        k = real.pop(int(np.argmin(misfit)))
        groups.append((float((values[i] * values[k]).real), [i, k]))
    for mode, (_, members) in enumerate(sorted(groups, key=lambda group: group[0]), start=1):
        modes[members] = mode
    return modes


def _cubic(start: Array, step: Step, roots: Indices) -> tuple[Array, Array, Array, Array, Array]:
    """Real part of each branch: value and slope at t = 0, the two higher coefficients, the end."""
    onto = step.onto[roots]
    a, b = start[roots], step.right.values[onto].real
    da, db = step.left.slopes[roots].real * step.length, step.right.slopes[onto].real * step.length
    return a, da, 3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db, b


def _scan(start: Array, step: Step, roots: Indices) -> list[tuple[int, float, bool]] | None:
    """(root, t, rising) of every sign change of the real parts' cubics; None where unsure."""
    if roots.size == 0:
        return []
    a, c1, c2, c3, b = _cubic(start, step, roots)
    size = np.maximum(np.abs(step.left.values[roots]), np.abs(step.right.values[step.onto[roots]]))
    band = 2.0 * step.error[roots] + ROUNDING * size
    inside = []
    disc = np.sqrt(np.maximum(c2**2 - 3.0 * c1 * c3, 0.0))
    sign = np.where(c2 >= 0.0, 1.0, -1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = -c1 / (c2 + sign * disc), -(c2 + sign * disc) / (3.0 * c3)
    for t in (first, second):
        t = np.where((t > 0.0) & (t < 1.0) & (c2**2 > 3.0 * c1 * c3), t, np.nan)
        value = a + t * (c1 + t * (c2 + t * c3))
        if bool((np.abs(value) <= band).any()):
            return None
        inside.append((t, value))
    up = (a > 0.0) | ((a == 0.0) & (c1 > 0.0))
    changes = up != (b >= 0.0)
    for _, value in inside:
        changes |= ~np.isnan(value) & (up != (value > 0.0))
    found = []
    for r in np.flatnonzero(changes):
        points = sorted((t[r], value[r]) for t, value in inside if not np.isnan(t[r]))
        found += _sign_changes(int(roots[r]), bool(up[r]), (a[r], c1[r], c2[r], c3[r]), [*points, (1.0, b[r])])
    return found


def _sign_changes(
    root: int, up: bool, c: tuple[float, float, float, float], points: list[tuple[float, float]]
) -> list[tuple[int, float, bool]]:
    def cubic(t: float) -> float:
        return c[0] + t * (c[1] + t * (c[2] + t * c[3]))

    found, left = [], 0.0
    for t, value in points:
        now = value >= 0.0
        if now != up:
            low = left
            if cubic(low) == 0.0:  # on the axis at rest: start just off it
                low = 1e-12 + left
            same = (cubic(low) > 0.0) == (cubic(t) > 0.0)
            where = t if same else float(brentq(cubic, low, t, xtol=1e-15))
            found.append((root, where, now))
        up, left = now, t
    return found


def _ends(start: Array, step: Step, roots: Indices) -> list[tuple[int, float, bool]]:
    """What a shortest step tells: the sign at either end."""
    a, c1, _, _, b = _cubic(start, step, roots)
    up = (a > 0.0) | ((a == 0.0) & (c1 > 0.0))
    changes = np.flatnonzero(up != (b >= 0.0))
    return [(int(roots[r]), 0.5, bool(b[r] >= 0.0)) for r in changes]


def _meets_off_axis(step: Step, i: int) -> bool:
    """Whether a pair that meets on the real axis within the step stays on one side of zero."""
    k = int(step.meets[i])
    a, b = step.left.values, step.right.values
    da, db = step.left.slopes, step.right.slopes
    j, m = step.onto[i], step.onto[k]
    t = np.linspace(0.0, 1.0, 17)
    weight = t * t * (3.0 - 2.0 * t)
    total = (1.0 - weight) * (a[i] + a[k]).real + weight * (b[j] + b[m]).real
    total += step.length * t * (1.0 - t) * (
        (1.0 - t) * (da[i] + da[k]).real - t * (db[j] + db[m]).real
    )
    reach = max(abs((a[i] - a[k]).real), abs((b[j] - b[m]).real))
    return bool((total + reach < 0.0).all() or (total - reach > 0.0).all())


def _unstable_of(step: Step, i: int) -> tuple[int, int]:
    k = int(step.meets[i])
    before = sum(step.left.values[r].real > 0.0 for r in (i, k))
    after = sum(step.right.values[step.onto[r]].real > 0.0 for r in (i, k))
    return int(before), int(after)


def _kinds_agree(step: Step, roots: Indices) -> bool:
    """For lambda^2: each root stays real or complex, or meets a known partner in between."""
    before = step.left.values[roots].imag == 0.0
    after = step.right.values[step.onto[roots]].imag == 0.0
    return bool(np.all((before == after) | (step.meets[roots] >= 0)))
