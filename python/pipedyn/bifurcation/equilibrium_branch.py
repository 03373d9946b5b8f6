# SPDX-License-Identifier: MIT
"""A branch of equilibria over the flow speed, past folds, with what changes along it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import field, replace
from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.bifurcation.continuation import (
    Continuation,
    Control,
    DenseProblem,
    Equations,
    Point,
    Segment,
    folds,
    sign_changes,
    solve,
)
from pipedyn.bifurcation.equilibria import (
    BALANCED,
    FAR,
    LARGEST,
    Statics,
    pitchforks,
    rounding,
)
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged
from pipedyn.motion.simulate import Start, checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

Change = Literal["fold", "pitchfork", "branch point", "hopf"]

MOST_POINTS = 4000
"""Points of one branch: at the usual step those of 200 rad, three times as far as `FAR`."""

NEAR = 0.5
"""Root mean square of the coordinates, in rad, within which a start leads to an equilibrium: far
more than rounded numbers of an equilibrium are off by, and less than the way to another."""


@result
class BranchPoint:
    """Where the stability of a branch changes or the branch turns.

    Attributes:
        kind: "fold", "pitchfork" (branches leave the straight pipe as mirror images, which is how
            it diverges), "branch point" (another real eigenvalue passes 0) or "hopf" (flutter: a
            pair passes the axis).
        speed: u.
        frequency: angular, in 1 / T; 0 unless "hopf".
        q: the configuration, shape (coordinates,).
        tip: position (x, y) of the free end.
    """

    kind: Change
    speed: float
    frequency: float
    q: Array = field(repr=False)
    tip: Array


@result
class EquilibriumBranch:
    """A branch of equilibria, point by point along its arc length.

    Attributes:
        speeds: u, shape (S,).
        q: coordinates, shape (S, coordinates).
        stable: shape (S,).
        unstable: number of eigenvalues with positive real part, shape (S,).
        tips: position (x, y) of the free end in L, shape (S, 2).
        points: where it turns or stability changes, in order along the branch.
        ends: why it ends, at its first and its last point: "range" of speeds, "pitchfork" (it joins
            its mirror image on the straight pipe), "closed", "far" (a coordinate beyond 60 rad),
            "points" (their number ran out) or "not converged" (no next point was found).
        model: the model.
    """

    speeds: Array
    q: Array = field(repr=False)
    stable: NDArray[np.bool_] = field(repr=False)
    unstable: NDArray[np.int_] = field(repr=False)
    tips: Array = field(repr=False)
    points: tuple[BranchPoint, ...]
    ends: tuple[str, str]
    model: Model

    def __len__(self) -> int:
        return len(self.speeds)

    @property
    def folds(self) -> tuple[BranchPoint, ...]:
        """Where it turns back in the flow speed."""
        return tuple(point for point in self.points if point.kind == "fold")

    @property
    def straight(self) -> bool:
        """Whether its configuration, that of the straight pipe, is the same at every speed."""
        return not float(np.ptp(self.q, axis=0).max()) > 0.0


def equilibrium_branch(
    model: Model,
    q0: Start,
    u0: float,
    speeds: tuple[float, float],
    step: float = 0.05,
) -> EquilibriumBranch:
    """The branch of equilibria through a given one, followed in the flow speed past folds.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom; a point costs
            eigenvalues of a dense matrix, O(dof^3).
        q0: near the equilibrium, coordinates or an angle theta(s), as for `simulate`; Newton's
            method goes on from there, to at most half a radian away, as the root mean square over
            the coordinates.
        u0: its flow speed, within `speeds`.
        speeds: (lowest, highest) flow speed of the branch.
        step: longest step along the branch, in [1e-4, 1]: in rad, as the root mean square over
            the coordinates, and in tenths of the range of speeds.

    Returns:
        EquilibriumBranch, from the end that lies in the direction of falling speed at q0.

    Raises:
        NotConverged: if there is no equilibrium near q0, or none could be followed.
        ValueError, TypeError: for bad arguments.

    Source: Keller (1977) for the continuation.
    """
    model = checked_model_in_motion(model, largest=LARGEST, purpose="equilibria")
    statics = Statics(model)
    low, high = map(float, check.array("speeds", speeds, size=2, low=0.0, high=LARGEST_SPEED))
    if not high - low >= 1e-9 * (1.0 + high):
        raise ValueError(f"speeds must be (lowest, highest), got ({low:g}, {high:g})")
    u0 = check.real("u0", u0, low=low, high=high)
    step = check.real("step", step, low=1e-4, high=1.0)
    start = statics.from_start("q0", q0)
    with one_thread(model.dof):
        try:
            x = solve(statics, start, u0)
            if statics.unbalanced(x, u0) > BALANCED:
                raise NewtonFailed("forces are left")
        except NewtonFailed as error:
            raise NotConverged(f"no equilibrium was found near q0 at u = {u0:g}") from error
        away = statics.rms(x - start)
        if away > NEAR:
            raise NotConverged(
                f"no equilibrium was found near q0 at u = {u0:g}: Newton's method leads to one "
                f"that lies {away:.3g} rad away, more than {NEAR:g}"
            )
        equations: Equations = statics
        if statics.rms(x - statics.resting) < 1e-9 and statics.rests(0.0) and statics.rests(1.0):
            x, equations = statics.resting, _AtRest(statics.resting)
        problem = DenseProblem(equations, statics.size, 0.1 * (high - low))
        branch = Continuation(problem, Control(longest=step))
        try:
            down = branch.point(np.append(x, u0), np.append(np.zeros_like(x), -1.0))
        except NewtonFailed as error:
            raise NotConverged(f"the equilibrium at u = {u0:g} is a branch point") from error
        up = Point(down.z, -down.tangent)
        first, second = (_Way(statics, branch, point, (low, high)) for point in (down, up))
        ends = (first.run(), "closed")
        points, growth, changes = first.points, first.growth, first.changes
        if ends[0] != "closed":
            ends = (ends[0], second.run())
            points = points[:0:-1] + second.points
            growth = growth[:0:-1] + second.growth
            changes = changes[::-1] + second.changes
    q = statics.recorded(np.array([point.x for point in points]))
    unstable = np.array([np.count_nonzero(one > 0.0) for one in growth])
    return EquilibriumBranch(
        speeds=np.array([point.p for point in points]),
        q=q,
        stable=unstable == 0,
        unstable=unstable,
        tips=model.tips(q.T),
        points=tuple(changes),
        ends=ends,
        model=model,
    )


class _AtRest:
    """x = rest, as equations: the straight pipe's, regular also where other branches leave it."""

    def __init__(self, rest: Array) -> None:
        self.rest = rest

    def residual(self, x: Array, p: float) -> Array:
        return x - self.rest

    def jacobian(self, x: Array, p: float) -> Array:
        return np.eye(x.size)

    def by_parameter(self, x: Array, p: float) -> Array:
        return np.zeros(x.size)


class _Way:
    """A branch from one of its points on, one way."""

    def __init__(
        self, statics: Statics, branch: Continuation, start: Point, ends: tuple[float, float]
    ) -> None:
        self.statics, self.branch, self.ends = statics, branch, ends
        self.longest = branch.control.longest
        self.points, self.growth = [start], [statics.growth(start.x, abs(start.p))]
        self.changes: list[BranchPoint] = []

    def run(self) -> str:
        """Follows the branch, and says why it ends."""
        step = 0.2 * self.longest
        low, high = self.ends
        length = 0.0
        while len(self.points) < MOST_POINTS // 2:
            a = self.points[-1]
            if (a.p <= low and a.tangent[-1] < 0.0) or (a.p >= high and a.tangent[-1] > 0.0):
                return "range"
            try:
                segment, step = self.branch.next(a, step)
                end = segment.end.p
                if not low <= end <= high and a.p != (edge := min(max(end, low), high)):
                    point = self.branch.point(segment.where(edge), a.tangent)
                    segment = replace(segment, end=point)
                joined = self._record(segment)
            except NewtonFailed:
                return "not converged"
            if joined:
                return "pitchfork"
            found, ds = segment.end, segment.length
            length += ds
            if float(np.abs(found.x).max()) > FAR:
                return "far"
            start = self.points[0]
            back = self.branch.length(found.z - start.z) <= ds
            same_way = self.branch.product(found.tangent, start.tangent) > 0.9
            if length > 10.0 * self.longest and back and same_way:
                return "closed"
        return "points"

    def _record(self, segment: Segment) -> bool:
        """Keeps the end of a segment and what changes on it; whether it ends on the straight pipe.

        Undamped, an eigenvalue is the square root of the distance to a fold, so that by rounding
        the count of the unstable changes next to the fold: both are one change, listed once.
        """
        statics, a, b, ds = self.statics, segment.begin, segment.end, segment.length
        sizes = statics.rms(a.x), statics.rms(b.x)
        meeting, turns, until = None, list[float](), ds
        across = float(a.x @ b.x) < 0.0 and not (statics.resting.any() or statics.straight(a.x))
        if across and max(sizes) <= 2.0 * self.longest:  # a pitchfork leads onto its mirror image
            meeting = self._pitchfork(a.p)
        if meeting is None:
            turns = folds(segment, 1e-12)
        else:
            until = 0.98 * ds * sizes[0] / sum(sizes)

        @cache
        def growth(s: float) -> Array:
            if s == 0.0:
                return self.growth[-1]
            point = b if s == ds else segment.at(s)
            return statics.growth(point.x, abs(point.p))

        marked = [(turn, self._point("fold", segment.at(turn))) for turn in turns]
        for before, beyond in sign_changes(growth, 0.0, until, 1e-10 * (1.0 + until)):
            point = segment.at(beyond)
            if np.count_nonzero((growth(beyond) > 0.0) != (growth(before) > 0.0)) % 2 == 0:
                marked.append((beyond, self._point("hopf", point)))
            elif all(abs(beyond - turn) > 1e-3 * ds for turn in turns):
                kind: Change = "pitchfork" if statics.straight(point.x) else "branch point"
                marked.append((beyond, self._point(kind, point)))
        self.changes += [point for _, point in sorted(marked, key=lambda one: one[0])]
        self.growth.append(growth(until))
        if meeting is not None:
            b = Point(np.append(statics.resting, meeting), a.tangent)
            self.changes.append(self._point("pitchfork", b))
        self.points.append(b)
        return meeting is not None

    def _pitchfork(self, u: float) -> float | None:
        """Speed of the pitchfork of the straight pipe nearest to a speed, if one is near."""
        near = 0.02 * (1.0 + u)
        found = [p for p in pitchforks(self.statics, u + near) if abs(p - u) < near]
        return min(found, key=lambda p: abs(p - u), default=None)

    def _point(self, kind: Change, point: Point) -> BranchPoint:
        statics = self.statics
        frequency = 0.0
        if kind == "hopf":
            found = statics.eigenvalues(point.x, abs(point.p))
            oscillating = found[np.abs(found.imag) > 1e-6]
            if oscillating.size:
                crossing = np.argmin(np.abs(oscillating.real - rounding(found)))
                frequency = float(abs(oscillating[crossing].imag))
        speed = abs(point.p)
        if kind == "pitchfork":  # rounding in the count reaches further than in the roots of det K
            speed = self._pitchfork(speed) or speed
        q = statics.recorded(point.x[None])[0]
        return BranchPoint(kind, speed, frequency, q, statics.model.tips(q[:, None])[0])


def lies_on(statics: Statics, branch: EquilibriumBranch, x: Array, u: float) -> bool:
    """Whether an equilibrium at a speed is one of a branch's."""
    near = 1e-5 * (1.0 + float(np.abs(x).max()))
    xs = [statics.from_start("q", q) for q in branch.q]
    for (a, u_a), (b, u_b) in pairwise(zip(xs, branch.speeds, strict=True)):
        if min(u_a, u_b) <= u <= max(u_a, u_b):
            share = (u - u_a) / (u_b - u_a) if u_a != u_b else 0.0
            with suppress(NewtonFailed):
                if float(np.abs(solve(statics, a + share * (b - a), u) - x).max()) < near:
                    return True
    return False
