# SPDX-License-Identifier: MIT
"""Eigenvalues tracked along the flow speed: which at one speed is which at the next.

Two neighbouring samples are joined by cubic Hermite curves through eigenvalues and their slopes
d lambda / du, which left and right eigenvectors give. How far the two slopes disagree about the
middle of the step,

    e = |lambda_0 + lambda_0' h/2 - (lambda_1 - lambda_1' h/2)| = O(h^3),

measures how well a curve is known. A match is ambiguous where two curves pass within a few e of one
another; the step is then halved. A pair that meets on the real axis has no slope there, but its sum
and product run smoothly through the meeting, and are compared instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.linear.eigenproblem import EPS, Complex, Eigenpairs, Eigenproblem
from pipedyn.linear.eigensolver import SHIFTS, lowest
from pipedyn.models.base import NotConverged
from pipedyn.util.check import Array

LONGEST_STEP = 0.5
"""Steps in u above this are halved unseen, of a pipe without weight. Measured on 36 pipes of 10
segments up to u = 20: 69 matches a sweep; 96 with steps of 0.25, and 67 and 71 with 1 and 2, which
are ambiguous and halved anyway."""

SHORTEST_STEP = 1e-6
"""Relative to 1 + u; below it the best match is taken as it is. Roots that meet, like the square
root of the speed, are 1e-3 apart at this distance: four digits above their rounding of 1e-7."""

MOST_STEPS = 800
"""Steps tried, beyond four times those of the sweep, before roots are given up as too close: the
36 pipes of `LONGEST_STEP` take up to 2.7 times those, and 40 meetings 19 halvings each."""

ON_AXIS = 1e-10
"""Real parts of conservative systems below this share of |lambda| are rounding."""

JUMP = 0.1
"""A root that moves by more than this share of 1 + |lambda| in a shortest step is another one: at a
meeting each moves by 1e-3."""

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Cluster:
    """Overdamped roots of a Kelvin-Voigt pipe, which cluster at -1 / delta within `radius` / delta.

    They need not be distinguished, nor do roots below `zero`. Without damping there is no cluster.
    """

    delta: float
    radius: float = 0.5
    zero: float = 0.0

    def holds(self, values: Complex) -> NDArray[np.bool_]:
        """Which roots belong to the cluster."""
        result: NDArray[np.bool_] = np.abs(self.delta * values + 1.0) < self.radius
        return result


SLOPE_NOISE = 10.0
"""Rounding of Re d lambda / du, in that of lambda: measured on 80 segments with a tip mass, at most
7 at u = 0.003 and less beyond, 0.1 at u = 3."""


@dataclass(frozen=True)
class Sample:
    """The lowest eigenvalues at one speed with both vectors, and more of each, shape (r,).

    Attributes:
        slopes: d lambda / du.
        noise: how far rounding may have moved lambda.
        slope_noise: the same of the real part of a slope; beyond rest 0 where it does not matter,
            since lambda itself is no better known.
        signatures: Krein's, -1 or 1, on the imaginary axis of a conservative system, 0 elsewhere:
            two roots of one signature pass through each other and stay on the axis.
    """

    u: float
    pairs: Eigenpairs
    slopes: Complex
    noise: Array
    slope_noise: Array
    signatures: NDArray[np.int8]

    @property
    def values(self) -> Complex:
        """lambda, shape (r,)."""
        return self.pairs.values


@dataclass(frozen=True)
class Step:
    """Two neighbouring samples, and what is known of each root of `left`, shape (r,).

    Attributes:
        onto: the root of `right` that continues it, -1 where it left the sample.
        error: e.
        meets: the root that it meets on the real axis within the step, or -1.
    """

    left: Sample
    right: Sample
    onto: Indices
    error: Array
    meets: Indices

    @property
    def length(self) -> float:
        """Of the step, in u."""
        return self.right.u - self.left.u

    @property
    def shortest(self) -> bool:
        """Whether the step will not be halved again."""
        return self.length <= 2.0 * SHORTEST_STEP * (1.0 + self.right.u)

    def lost(self, roots: Indices) -> NDArray[np.bool_]:
        """Which roots have left the eigenvalues computed and were matched to others."""
        if not self.shortest:
            return np.zeros(roots.size, dtype=np.bool_)
        a, b = self.left.values[roots], self.right.values[self.onto[roots]]
        jump: NDArray[np.bool_] = np.abs(b - a) > JUMP * (1.0 + np.abs(a))
        return jump

    def expected(self, root: int, u: float) -> complex:
        """What the cubic of one root predicts at a speed within the step."""
        t, other = (u - self.left.u) / self.length, self.onto[root]
        ends = self.left.values[root] * (1.0 + 2.0 * t) * (1.0 - t) ** 2
        ends += self.right.values[other] * (3.0 - 2.0 * t) * t**2
        slopes = self.left.slopes[root] * (1.0 - t) - self.right.slopes[other] * t
        return complex(ends + self.length * t * (1.0 - t) * slopes)


def pairs_at(problem: Eigenproblem, u: float, count: int | None) -> Eigenpairs:
    """The `count` lowest eigenvalues (all without), with both vectors, if doubles hold them."""
    pairs = lowest(problem, u, count, left=True, high=False)
    if not np.isfinite(pairs.values).all():
        raise NotConverged(f"an eigenvalue at u = {u:g} is beyond double precision")
    return pairs


def sample(problem: Eigenproblem, u: float, count: int | None) -> Sample:
    """The `count` lowest eigenvalues (all without) at speed u, with slopes (0 if none)."""
    pairs = pairs_at(problem, u, count)
    found = problem.assessed(u, pairs)
    slopes = np.where(np.isfinite(found.slopes), found.slopes, 0.0)
    # Residuals and rounding of mu, taken to lambda; roots that meet scatter by its square root.
    size = np.abs(pairs.values)
    nearest = max(float(np.abs(pairs.values - SHIFTS[0]).min(initial=np.inf)), 1e-3)
    of_mu = 1e-14 * size + 40.0 * EPS * size**2 / nearest
    noise = np.maximum(of_mu, np.minimum(found.uncertain, 1e-7 * (1.0 + size)))
    slope_noise = np.zeros(noise.size)
    if not problem.is_conservative:
        values, less = problem.improved(u, pairs, found, noise)
        slope_noise = np.where((less < noise) | (u == 0.0), SLOPE_NOISE * noise, 0.0)
        noise, pairs = less, replace(pairs, values=values)
    signatures = np.zeros(pairs.values.size, dtype=np.int8)
    if problem.is_conservative:
        # Eigenvalues come in fours: what is on the axis is there exactly, and moves along it.
        near = np.abs(pairs.values.real) <= noise + ON_AXIS * np.abs(pairs.values)
        on_axis = near & (pairs.values.imag != 0.0)
        pairs.values.real[on_axis], slopes.real[on_axis] = 0.0, 0.0
        # The sign of x^H (2 omega M - i G) x, a mode's energy by its frequency.
        signatures[on_axis] = np.sign(found.by_right.imag[on_axis])
    return Sample(u, pairs, slopes, noise, slope_noise, signatures)


def tracked_steps(
    take: Callable[[float], Sample],
    first: Sample,
    speeds: Iterable[float],
    tracked: Indices,
    cluster: Cluster,
    sure: Callable[[Step], bool] = lambda step: True,
    longest: float = LONGEST_STEP,
) -> Iterator[Step]:
    """Steps from the first sample through increasing speeds, short enough to be unambiguous.

    `take` gives the sample at a speed. Of the first sample the roots `tracked` are tracked with
    certainty, the others matched as well as they can be. Longer steps than `longest` are halved, as
    are those that are not `sure` and not the shortest. Raises NotConverged where they are too many.
    """
    ahead = list(speeds)[::-1]
    trials = MOST_STEPS + 4 * len(ahead)
    if ahead:
        trials += math.ceil(4.0 * (ahead[0] - first.u) / longest)
    left = first
    stack: list[Sample] = []
    while ahead or stack:
        if not stack:
            stack.append(take(ahead.pop()))
        right = stack[-1]
        middle = 0.5 * (left.u + right.u)
        if right.u - left.u > longest * (1.0 + 1e-12):
            stack.append(take(middle))
            continue
        trials -= 1
        if trials < 0:
            raise NotConverged(f"eigenvalues near u = {left.u:.6g} are too close to be tracked")
        onto, error, meets, slopes, unambiguous = _core.match(
            left, right, tracked, cluster.delta, cluster.radius, cluster.zero
        )
        start = replace(left, slopes=slopes) if left.u == 0.0 else left
        step = Step(start, right, onto, error, meets)
        if not step.shortest and not (unambiguous and sure(step)):
            stack.append(take(middle))
            continue
        yield step
        tracked = step.onto[tracked]
        tracked = tracked[tracked >= 0]
        left = stack.pop()
