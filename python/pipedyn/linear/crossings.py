# SPDX-License-Identifier: MIT
"""Where eigenvalues pass through the imaginary axis as the flow speed grows.

Each step of a tracked sweep (see `tracking`) gives a cubic for the real part of a branch.
A step shows all crossings where no extremum of the cubic lies closer to the axis than the cubic's
own error, and is halved otherwise; so a branch that touches the axis between two samples, or passes
it twice, is found. Each crossing is then polished by Newton's method with d lambda / du on the
model.

A real part within rounding of zero has no sign: such a branch stays what it was, stable or not,
until its real part leaves the noise. `special.undamped` is for pipes without any term in the
velocity.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipedyn import _core
from pipedyn.linear.eigenproblem import EPS, Complex, Eigenpairs, Eigenproblem
from pipedyn.linear.tracking import (
    LONGEST_STEP,
    Cluster,
    Indices,
    Sample,
    Step,
    sample,
    tracked_steps,
)
from pipedyn.models.base import NotConverged
from pipedyn.util.newton import NewtonFailed, newton

Flags = NDArray[np.bool_]

Iterate = tuple[float, complex, Complex]
"""u, lambda and its right vector."""

LARGEST_ERROR = 1e-3
"""Relative error of a crossing's speed beyond which it is no result: three digits are wanted."""

LARGE_GRAVITY = 100.0
"""gamma beyond which weight sets the scale of flow speeds: measured at beta 0.05 to 0.8, critical
speeds are 1.6 to 1.9 times those without weight here, and grow about like gamma^(1/3) beyond."""


@dataclass(frozen=True)
class AxisCrossing:
    """One crossing of the imaginary axis by a root or a conjugate pair.

    Attributes:
        speed: u.
        value: i times the frequency there; 0 for divergence.
        change: by how many the number of unstable roots grows, a pair being two.
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
    pair: Eigenpairs | None = None
    slope: complex | None = None


@dataclass(frozen=True)
class Sweep:
    """Crossings in order of speed, and the number of unstable roots at rest."""

    unstable_at_rest: int
    crossings: tuple[AxisCrossing, ...]


class Untracked(Exception):
    """A root outside the tracked set became unstable: more must be tracked."""


class CrossingSearch:
    """One sweep from rest, for pipes with flow or damping.

    `tracked` modes are computed and tracked, of which the lowest `resolved` at rest are looked at;
    without, all. Where not all are tracked, `count` roots are computed: two a mode and 16 without.
    """

    def __init__(
        self,
        problem: Eigenproblem,
        max_speed: float,
        tracked: int | None = None,
        resolved: int | None = None,
        count: int | None = None,
    ) -> None:
        self.problem = problem
        self.max_speed = max_speed
        self.count = None if tracked is None else (count or 2 * tracked + 16)
        self.tracked = problem.dof if tracked is None else tracked
        self.resolved = self.tracked if resolved is None else resolved
        # Legendre's highest third is not the pipe's and heavily damped: matched, but not tracked.
        self.certain = min(self.tracked, problem.model.resolved_modes)
        self.modes: Indices = np.zeros(0, dtype=np.intp)
        self.unstable: Flags = np.zeros(0, dtype=np.bool_)
        self.scanned: tuple[Step, _core.Scan] | None = None

    def run(self, until: Callable[[AxisCrossing], bool] | None = None) -> Sweep:
        """All crossings up to max_speed, or up to the first that `until` accepts.

        Raises NotConverged if they do not account for the unstable roots, and Untracked.
        """
        longest = longest_step(self.problem.pipe.gamma)
        steps = max(1, math.ceil(self.max_speed / longest))
        speeds = np.linspace(0.0, self.max_speed, steps + 1).tolist()
        first = self.take(0.0)
        self.modes = self.ranked(first)
        every = np.arange(first.values.size)
        self.unstable = self.states(first, every, np.zeros(every.size, dtype=np.bool_))
        at_rest = unstable = self.count_unstable()
        crossings: list[AxisCrossing] = []
        tracked = np.arange(min(self.wanted, first.values.size))
        cluster = Cluster(self.problem.pipe.damping, 0.9, self.problem.zero_tolerance)
        tracking = tracked_steps(self.take, first, speeds[1:], tracked, cluster, self.sure, longest)
        for step in tracking:
            found = self.crossings(step)
            self.move(step)
            found += self._collapse(step, unstable + sum(crossing.change for crossing in found))
            for crossing in sorted(found, key=lambda crossing: crossing.speed):
                if crossing.error > LARGEST_ERROR * crossing.speed + 1e-12:
                    raise NotConverged(
                        f"a crossing near u = {crossing.speed:.6g} is known to "
                        f"{crossing.error:.1e} only: rounding hides the eigenvalue's real part",
                        Sweep(at_rest, tuple(crossings)),
                    )
                crossings.append(crossing)
                unstable += crossing.change
                if until is not None and until(crossing):
                    return Sweep(at_rest, tuple(crossings))
            if unstable != self.count_unstable():
                raise NotConverged(
                    f"{self.count_unstable()} unstable roots at u = {step.right.u:g}, where the "
                    f"crossings found account for {unstable}",
                    Sweep(at_rest, tuple(crossings)),
                )
        return Sweep(at_rest, tuple(crossings))

    @property
    def wanted(self) -> int:
        """Roots to track with certainty: two a mode."""
        return 2 * self.certain

    def ranked(self, first: Sample) -> Indices:
        """Mode of each root at rest, by frequency."""
        return modes_of_pairs(first.values, self.problem.pipe.damping)

    def take(self, u: float) -> Sample:
        """The sample at a speed; at rest zero is exact, and without damping the axis."""
        at = sample(self.problem, u, self.count)
        if u == 0.0:
            at.values[np.abs(at.values) < self.problem.zero_tolerance] = 0.0
        if u == 0.0 and not self.problem.is_damped:
            at.values.real[at.values.imag != 0.0] = 0.0
        return at

    def count_unstable(self) -> int:
        """Number of unstable roots among the resolved."""
        return int(
            np.count_nonzero(self.unstable & (self.modes >= 1) & (self.modes <= self.resolved))
        )

    def move(self, step: Step) -> None:
        """Take modes and states to the step's right sample; mode 0 for roots from outside."""
        there = step.onto >= 0
        onto = step.onto[there]
        before_modes = self.modes
        modes = np.zeros(step.right.values.size, dtype=np.intp)
        before = np.zeros(modes.size, dtype=np.bool_)
        modes[onto], before[onto] = self.modes[there], self.unstable[there]
        self.modes = modes
        self.unstable = self.states(step.right, np.arange(modes.size), before)
        if self.count is not None:
            if bool(step.lost(np.flatnonzero(there & (before_modes <= self.tracked))).any()):
                raise Untracked
            loose = self.unstable & ((modes == 0) | (modes > self.tracked))
            if loose.any():
                raise Untracked

    def states(self, at: Sample, onto: Indices, before: Flags) -> Flags:
        """Which roots are unstable: by the sign of Re lambda, or as before where it has none."""
        return _core.unstable(at, onto, before, self.problem.zero_tolerance)

    def scan(self, step: Step) -> _core.Scan:
        """What the step shows of the roots resolved; kept, as an accepted step is asked twice."""
        if self.scanned is None or self.scanned[0] is not step:
            conservative, zero = self.problem.is_conservative, self.problem.zero_tolerance
            known = (step, self.modes, self.unstable, self.resolved, self.certain)
            self.scanned = step, _core.scan(*known, zero, conservative)
        return self.scanned[1]

    def sure(self, step: Step) -> bool:
        """Whether the step shows all crossings in it."""
        scan = self.scan(step)
        met = scan.roots[step.meets[scan.roots] >= 0]
        return scan.clear and all(self._is_clear_meeting(step, int(i)) for i in met)

    def _is_clear_meeting(self, step: Step, i: int) -> bool:
        """Whether the signs before and after a meeting on the real axis show what passed zero."""
        if _meets_off_axis(step, i):
            return True
        if not self.problem.is_conservative:
            return False
        # An imaginary pair that turns into opposite real roots, or back: at zero.
        k, j = int(step.meets[i]), int(step.onto[i])
        a, b = step.left.values, step.right.values
        across = (a[i].imag == 0.0) != (b[j].imag == 0.0)
        opposite = abs((a[i] + a[k]).real) + abs((b[j] + b[int(step.onto[k])]).real)
        return bool(across and opposite < 1e-6 * (1.0 + abs(a[i]) + abs(b[j])))

    def crossings(self, step: Step) -> list[AxisCrossing]:
        """Crossings within a step."""
        scan = self.scan(step)
        roots, after = scan.roots, scan.after
        found = []
        for root in map(int, np.flatnonzero(scan.leaving)):
            value = complex(0.0, step.left.values[root].imag)
            change = 2 if value.imag or step.right.values[step.onto[root]].imag else 1
            error = 0.0
            if value and self.problem.is_damped:  # its damping is within rounding
                hidden = abs(step.left.values[root].real) + step.left.noise[root]
                error = float(hidden / step.left.slopes[root].real)
            found.append(AxisCrossing(0.0, value, change, int(self.modes[root]), error))
        met = step.meets[roots] >= 0
        scanned = scan.crossings
        if not scan.clear:  # a shortest step: the states at its ends
            turned = (self.unstable | scan.leaving)[roots] != after[roots]
            scanned = [(int(i), 0.5, bool(after[i])) for i in roots[turned & ~met]]
        for root, t, rising in scanned:
            meeting = self._meeting_on_axis(step, root, rising)
            found.append(meeting or self._polish(step, root, t, rising))
        for i in roots[met]:
            k = int(step.meets[i])
            change = int(after[i]) + int(after[k]) - int(self.unstable[i]) - int(self.unstable[k])
            if change and (i < k or k not in roots):
                odd = change % 2 != 0  # one real root of the two passes zero
                divergence = (
                    self._divergence(step, 0.5, change, int(self.modes[i])) if odd else None
                )
                value = 0j if odd else complex(0.0, abs(step.left.values[i].imag))
                middle = 0.5 * (step.left.u + step.right.u)
                met_there = AxisCrossing(middle, value, change, int(self.modes[i]), step.length)
                found.append(divergence or met_there)
        _refuse_equal(found)
        return found

    def _collapse(self, step: Step, expected: int) -> list[AxisCrossing]:
        """Three roots that pass zero as one (two free joints), which the matching cannot show."""
        change = self.count_unstable() - expected
        if change % 2 == 0:
            return []
        mode = int(self.modes[np.argmin(np.abs(step.right.values))])
        crossing = self._divergence(step, 0.5, change, mode)
        return [] if crossing is None else [crossing]

    def _divergence(self, step: Step, t: float, change: int, mode: int) -> AxisCrossing | None:
        """Where det K(u) changes sign within the step, near its fraction t; None if it does not."""
        problem = self.problem.static()
        expected = step.left.u + t * step.length
        for where in (t, 0.0, 1.0, 0.5):
            found = _singular_speed(
                *(problem, step, expected), near=step.left.u + where * step.length
            )
            if found is not None:
                break
        else:
            return None
        u, pair = found
        assert pair.left is not None
        h = 1e-5 * (1.0 + u)
        moved = problem.stiffened(u + h, pair.right) - problem.stiffened(u - h, pair.right)
        rate = moved / (2.0 * h)
        change_of_zero = abs(complex(np.sum(pair.left.conj() * rate)))
        uncertain = float(pair.residuals[0] + EPS) * problem.size(u)
        error = uncertain / change_of_zero if change_of_zero else math.inf
        error += 4e-16 * (1.0 + u)
        own = problem.original(u, pair)
        slope = None if own is None else complex(problem.assessed(u, own).slopes[0])
        return AxisCrossing(u, 0j, change, mode, error, own, slope)

    def _polish(self, step: Step, root: int, t: float, rising: bool) -> AxisCrossing:
        """A crossing to rounding, by Newton's method on the model itself."""
        problem = self.problem
        real = step.left.values[root].imag == 0.0
        if real:
            divergence = self._divergence(step, t, 1 if rising else -1, int(self.modes[root]))
            if divergence is not None:
                return divergence
        u = step.left.u + t * step.length
        slack = 1e-9 * (1.0 + u) + 0.1 * step.length

        def correction(near: Iterate) -> tuple[Iterate, float]:
            pair = problem.refine(*near)
            value, _, slope = self._improved(near[0], pair)
            change = -value.real / slope.real if slope.real else math.inf
            if not step.left.u - slack <= near[0] + change <= step.right.u + slack:
                raise NewtonFailed("Newton's method left the step", near)
            moved = max(near[0] + change, 0.0), value + slope * change, pair.right[:, 0]
            return moved, abs(change)

        last: Iterate = u, step.expected(root, u), step.left.pairs.right[:, root]
        try:
            last = newton(
                *(last, correction, lambda before, moved, share: moved),
                tolerance=4e-16,
                stagnation=math.inf,
                slower=1.0,
                iterations=12,
                scale=lambda near: near[0],
            ).state
        except NewtonFailed as failed:  # checked below against where the step predicts the root
            last = failed.state
        u, pair = last[0], problem.refine(*last)
        value, rounding, slope = self._improved(u, pair)
        tolerance = 1e-6 * (1.0 + abs(value))
        another = abs(value - step.expected(root, u)) > 4.0 * step.error[root] + tolerance
        if (slope.real > 0.0) != rising or another or abs(value.real) > tolerance:
            u = self._bisect(step, root)
            pair = self._nearest(u, step, root)
            value, rounding, slope = self._improved(u, pair)
        if not pair.converged[0]:
            raise NotConverged(
                f"the eigenvalue near {value:.6g} that passes the axis at u = {u:g} failed its "
                f"residual check with {pair.residuals[0]:.1e}"
            )
        uncertain = rounding + abs(value.real)
        error = uncertain / abs(slope.real) if slope.real else math.inf
        change = (1 if real else 2) * (1 if rising else -1)
        at = complex(0.0, 0.0 if real else abs(value.imag))
        own, mode = problem.original(u, pair), int(self.modes[root])
        return AxisCrossing(float(u), at, change, mode, error, own, slope)

    def _improved(self, u: float, pair: Eigenpairs) -> tuple[complex, float, complex]:
        """The eigenvalue of one pair, how far it may be off, and d lambda / du."""
        found = self.problem.assessed(u, pair)
        values, uncertain = self.problem.improved(u, pair, found, found.uncertain)
        return complex(values[0]), float(uncertain[0]), complex(found.slopes[0])

    def _meeting_on_axis(self, step: Step, root: int, rising: bool) -> AxisCrossing | None:
        """Where two pairs of a conservative system meet and leave the axis, or come back to it.

        There the square of their difference is real, smooth in u and passes zero.
        """
        off = (step.right.values[step.onto[root]] if rising else step.left.values[root]).imag
        if not (self.problem.is_conservative and off):
            return None

        def square(u: float) -> float:
            at = self.take(u)
            near = np.argsort(np.abs(at.values - step.expected(root, u)))
            one, other = at.values[near[:2]]
            return float(((one - other) ** 2).real)

        low, high = step.left.u, step.right.u
        if square(low) * square(high) > 0.0:
            return None
        tolerance = 4e-16 * (1.0 + high)
        u = float(brentq(square, low, high, xtol=tolerance, rtol=8.9e-16))
        near = self._nearest(u, step, root)
        spread = 0.1 * step.length
        slope = abs(square(u + spread) - square(u - spread)) / (2.0 * spread)
        frequency = abs(float(near.values[0].imag))
        error = 1e-14 * frequency**2 / slope if slope else step.length
        change = 2 if rising else -2
        mode = int(self.modes[root])
        return AxisCrossing(u, complex(0.0, frequency), change, mode, error + tolerance)

    def _nearest(self, u: float, step: Step, root: int) -> Eigenpairs:
        """The root's own eigenvalue at a speed within the step."""
        at = self.take(u)
        return at.pairs.take([int(np.argmin(np.abs(at.values - step.expected(root, u))))])

    def _bisect(self, step: Step, root: int) -> float:
        def real_part(u: float) -> float:
            return float(self._nearest(u, step, root).values[0].real)

        low, high = real_part(step.left.u), real_part(step.right.u)
        if low * high >= 0.0:
            return step.left.u if abs(low) < abs(high) else step.right.u
        return float(brentq(real_part, step.left.u, step.right.u, xtol=1e-14, rtol=1e-14))


def longest_step(gamma: float) -> float:
    """Longest step of a sweep.

    Near the free end of a heavy hanging pipe, where its weight no longer stretches it, lengths are
    in gamma^(-1/3) and flow speeds in gamma^(1/3).
    """
    return LONGEST_STEP * float(np.cbrt(1.0 + max(gamma, 0.0) / LARGE_GRAVITY))


def _refuse_equal(found: list[AxisCrossing]) -> None:
    """Raises where two real roots pass zero at one speed: they are one root, found twice."""
    static = sorted(crossing.speed for crossing in found if crossing.value == 0.0 < crossing.speed)
    for low, high in itertools.pairwise(static):
        if high - low <= 1e-11 * high:
            raise NotConverged(f"two divergences near u = {low:.9g} cannot be distinguished")


def _singular_speed(
    problem: Eigenproblem, step: Step, expected: float, near: float
) -> tuple[float, Eigenpairs] | None:
    """Speed nearest to the expected one at which K(u) is singular, with its null vectors.

    1 / (d^T K^-1 b) has the determinant's zeros, and no pole nearby if d and b are close to the
    null vectors: they are those of the least singular value at a speed near by.
    """
    seed = np.linspace(1.0, 0.5, problem.dof).reshape(-1, 1)
    start = problem.null_pair(near, seed, seed)
    assert start.left is not None
    dual, vector = start.left.real, start.right.real

    def determinant(u: float) -> float:
        return 1.0 / float((vector.T @ problem.factor(0.0, u)(dual)).real[0, 0])

    slack = 1e-9 * (1.0 + step.right.u) + 0.1 * step.length
    least, most = max(step.left.u - slack, 0.0), step.right.u + slack
    # Outwards from what is expected, so that of two zeros in a step each root finds its own.
    reach = 1e-5 * step.length + 1e-12
    while True:
        low, high = max(expected - reach, least), min(expected + reach, most)
        if determinant(low) * determinant(high) < 0.0:
            break
        if (low, high) == (least, most):
            return None
        reach *= 4.0
    u = float(brentq(determinant, low, high, xtol=4e-16 * (1.0 + high), rtol=8.9e-16))
    pair = problem.null_pair(u, vector, dual)
    return (u, pair) if pair.converged[0] else None


def _meets_off_axis(step: Step, i: int) -> bool:
    """Whether a pair that meets on the real axis within the step stays on one side of zero."""
    k = int(step.meets[i])
    a, b = step.left.values, step.right.values
    da, db = step.left.slopes, step.right.slopes
    j, m = step.onto[i], step.onto[k]
    t = np.linspace(0.0, 1.0, 17)
    weight = t * t * (3.0 - 2.0 * t)
    total = (1.0 - weight) * (a[i] + a[k]).real + weight * (b[j] + b[m]).real
    total += (
        step.length * t * (1.0 - t) * ((1.0 - t) * (da[i] + da[k]).real - t * (db[j] + db[m]).real)
    )
    reach = max(abs((a[i] - a[k]).real), abs((b[j] - b[m]).real))
    return bool((total + reach < 0.0).all() or (total - reach > 0.0).all())


def modes_of_pairs(values: Complex, damping: float) -> Indices:
    """Mode of each root, from 1, by the square of its undamped frequency at rest.

    Conjugates share a mode; so do two real roots with 1/a + 1/b = -delta, which is exact for
    opposite roots of an undamped buckled pipe and for overdamped modes without gravity.
    """
    modes = np.zeros(values.size, dtype=np.intp)
    groups: list[tuple[float, list[int]]] = []
    real = [i for i in range(values.size) if values[i].imag == 0.0]
    for i in map(int, np.flatnonzero(values.imag > 0.0)):
        other = np.flatnonzero(values == values[i].conj())
        groups.append((float(np.abs(values[i]) ** 2), [i, *map(int, other[:1])]))
    while real:
        i = real.pop(0)
        if not real:
            groups.append((float(values[i].real ** 2), [i]))
            break
        inverse = -damping - (1.0 / values[i].real if values[i].real else 0.0)
        misfit = [abs((1.0 / values[k].real if values[k].real else 0.0) - inverse) for k in real]
        k = real.pop(int(np.argmin(misfit)))
        groups.append((float((values[i] * values[k]).real), [i, k]))
    for mode, (_, members) in enumerate(sorted(groups, key=lambda group: group[0]), start=1):
        modes[members] = mode
    return modes
