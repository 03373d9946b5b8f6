# SPDX-License-Identifier: MIT
"""Crossings of the imaginary axis by the roots of a pipe whose rest bends with the flow speed.

The rest is followed from u = 0. Flutter is a change of the number of growing pairs along it. A
fold, where the rest turns back and the pipe snaps away, is a divergence: the search ends there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from pipedyn.continuation.arclength import BranchStep, DenseProblem
from pipedyn.continuation.tracer import special_points
from pipedyn.linear.following import GrowthTest, matched
from pipedyn.linear.neutral import beyond_rounding, decays, rounding
from pipedyn.linear.rest import SAME_REST, SHORTER_STEPS, BranchOfRest, lost_rest
from pipedyn.linear.sensitivity import (
    LEAST_BETA,
    Crossing,
    Derivatives,
    Sensitivity,
    of_each,
)
from pipedyn.models.base import Model
from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed

STEPS_OF_NUMBERS = {"beta": 1e-3, "gamma": 1e-2, "damping": 1e-4, "alpha": 1e-2, "hysteresis": 1e-3}
STEPS_OF_NUMBERS |= {"rotary_inertia": 1e-5}
"""Steps of differences of fourth order by a pipe's numbers, in units of 1 plus the size of gamma
and 1 of the others: roots then move by some 1e-3 of their size, whose fourth power is rounding."""

CENTRAL: tuple[tuple[int, float], ...] = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))
ONE_SIDED = ((0, -25 / 12), (1, 4.0), (2, -3.0), (3, 4 / 3), (4, -1 / 4))
"""Weights of values at whole steps in first derivatives of fourth order."""


MEET = 1e-3
"""Distance of two roots, over 1 + |lambda|, within which they meet: rounding moves both by its
square root, and so leaves them some 2e-4 apart where they are located."""

MEETING = 1e-6
"""Error of a crossing, over 1 + its speed, beyond which Newton's method has found none."""

SMALL_SPEED = 1e-3
"""Speed below which a root that grows, and that is on the axis without flow, grows from u = 0 on:
if the flow moves it by 1e-9 of the speed, rounding hides its growth up to some 1e-4."""

EPS = float(np.finfo(float).eps)

TOO_NEAR = "another branch of rests meets it, or is too near to be told apart"

OUT_OF_PLANE = " across"
"""End of the names of crossings whose motions are across the plane of rest."""


class RootsFollowed:
    """Roots of small motions along the branch of rests, each with the number of its mode.

    Modes are counted at rest from the lowest; from one rest to the next a root keeps its number if
    it is the nearest one.

    Attributes:
        values: the roots, shape (k,).
        modes: number of the mode of each, from 1, shape (k,).
    """

    def __init__(self, values: Complex) -> None:
        order = np.lexsort((-values.imag, np.abs(values).round(9)))
        self.values, self.modes = values[order], np.arange(values.size) // 2 + 1

    def move(self, values: Complex) -> None:
        """Follows the roots to the next rest."""
        found = matched(self.values, values)
        self.values, self.modes = values[found[found >= 0]], self.modes[found >= 0]

    def mode_of(self, values: Complex, root: complex) -> int:
        """Mode of that one of the roots at a rest nearby which is nearest to a value.

        It is the higher mode of two whose roots meet there.
        """
        apart = np.abs(values - root)
        close = np.flatnonzero(apart <= max(apart.min(), MEET * (1.0 + abs(root))))
        return int(self.modes[np.isin(matched(self.values, values), close)].max(initial=0))


@dataclass(frozen=True)
class CrossingOfRest:
    """A crossing on the branch of rests, with the rest at which it occurs."""

    crossing: Crossing
    rests: BranchOfRest = field(repr=False)
    rest: Array = field(repr=False)

    def with_sensitivity(self) -> Crossing:
        """The crossing with derivatives in which the rest changes with the pipe's numbers."""
        if self.crossing.speed == 0.0:
            return self.crossing
        try:
            folds = self.crossing.kind == "divergence" and not self.crossing.across
            by = self._by_fold() if folds else self._by_root()
        except (NewtonFailed, np.linalg.LinAlgError):
            return self.crossing
        return replace(self.crossing, sensitivity=by)

    def _numbers(self) -> list[str]:
        """Numbers by which derivatives exist."""
        return [
            name for name in STEPS_OF_NUMBERS if name != "beta" or self._pipe.beta >= LEAST_BETA
        ]

    @property
    def _pipe(self) -> Pipe:
        return self.rests.model.pipe

    def _by_number(self, name: str, value: Callable[[BranchOfRest], Any]) -> Any:
        """Derivative of a function of the branch of a pipe by one of the pipe's numbers."""
        pipe, now = self._pipe, float(getattr(self._pipe, name))
        low, high = OWN_NUMBERS[name].bounds
        step = STEPS_OF_NUMBERS[name] * (1.0 + abs(now) if name == "gamma" else 1.0)
        room = min(now - low, high - now)
        if name == "beta":
            step = min(step, 0.2 * room)
        weights = CENTRAL if room >= 2.0 * step else ONE_SIDED
        total = 0.0
        for k, weight in weights:
            moved: dict[str, Any] = {name: now + k * step}
            there = self.rests.model.with_pipe(replace(pipe, **moved))
            total = total + weight * value(BranchOfRest(there))
        return total / step

    def _by_root(self) -> Sensitivity:
        """Derivatives du/dp = -Re lambda_p / Re lambda_u along Re lambda(u; p) = 0."""
        u, root = self.crossing.speed, 1j * self.crossing.frequency
        at = partial(root_at, near=self.rest, root=root, plane=int(self.crossing.across or 0))
        slope = slope_of_root(partial(at, self.rests), u)
        speed: dict[str, Any] = {"beta": None}
        frequency: dict[str, Any] = {"beta": None}
        for name in self._numbers():
            change = self._by_number(name, lambda there: at(there, u=u)[0])
            speed[name] = -change.real / slope.real
            frequency[name] = change.imag + slope.imag * speed[name]
        return Sensitivity(Derivatives(**speed), Derivatives(**frequency))

    def _by_fold(self) -> Sensitivity:
        """Derivatives du/dp = -w . G_p / w . G_u at a fold, with the left null vector w of G_x."""
        u, x = self.crossing.speed, self.rest
        left, *_ = np.linalg.svd(self.rests.jacobian(x, u))
        null, (_, by) = left[:, -1], self.rests.equations(x, u)
        speed: dict[str, Any] = {"beta": None}
        for name in self._numbers():
            pushed = self._by_number(name, lambda there: there.accelerations(x[None], u)[0])
            speed[name] = -float(null @ pushed) / float(null @ by[:, -1])
        still: dict[str, Any] = {k: None if one is None else 0.0 for k, one in speed.items()}
        return Sensitivity(Derivatives(**speed), Derivatives(**still))


def root_at(
    rests: BranchOfRest, u: float, near: Array, root: complex, plane: int
) -> tuple[complex, Array]:
    """The root nearest to a value about the rest at a speed, and that rest, which lies near one.

    The root is that of a motion in the plane of rest, or across it where `plane` is 1. For a real
    value it is an eigenvalue of the stiffness, which passes 0 with a root.
    """
    rest = rests.branch.fixed(np.append(near, u), u)[:-1]
    if root.imag:
        values = rests.roots(rest, u, plane)
    else:  # of the stiffness, since roots may be double at 0
        values = np.linalg.eigvals(rests.matrices(rest, u, plane)[2].real).astype(complex)
    return complex(values[np.argmin(np.abs(values - root))]), rest


def slope_of_root(at: Callable[[float], tuple[complex, Array]], u: float) -> complex:
    """Derivative of a root, as a function of the speed, by that speed, with that of the rest."""
    step = 1e-3 * (1.0 + u)
    weights = CENTRAL if u >= 2.0 * step else ONE_SIDED
    return complex(np.sum([weight * at(u + k * step)[0] for k, weight in weights]) / step)


class SearchOfRest:
    """A search for the crossings of a pipe along its rest.

    Args:
        model: the model, whose rest follows the speed.
        max_speed: flow speed at which the search ends.
        until_unstable: whether the search ends at the first crossing that destabilises.
        counted: number of lowest roots that count, the others being no roots of the pipe.
    """

    def __init__(
        self, model: Model, max_speed: float, until_unstable: bool, counted: int | None = None
    ) -> None:
        self.rests, self.counted = BranchOfRest(model), counted
        self.max_speed, self.until_unstable = max_speed, until_unstable
        self.found: list[CrossingOfRest] = []
        self.roots: list[RootsFollowed] = []  # in the plane of rest, and across it
        self.tests: list[GrowthTest | None] = []  # of the last step
        self.reached = 0.0

    def run(self) -> tuple[CrossingOfRest, ...]:
        """The crossings, in order of speed.

        Raises:
            NotConverged: if the rest is lost before the end of the search, with the crossings below
                that speed.
        """
        speeds = np.zeros(0)
        for share in SHORTER_STEPS:
            self.found, self.roots, self.reached = [], [], 0.0
            reason = self.rests.following(self.max_speed, self._note, share=share)
            flutters = all(one.crossing.kind == "flutter" for one in self.found)
            if flutters and reason in ("range", "found"):
                break
            longer, speeds = speeds, of_each((one.crossing for one in self.found), "speed")
            same = longer.size == speeds.size > 0
            if same and np.abs(longer - speeds).max() < SAME_REST:
                break
        if reason not in ("range", "found"):
            known = tuple(one.crossing for one in self.found)
            last = self.found[-1].crossing.speed if reason == "fold" else self.reached
            raise NotConverged(lost_rest(reason, last, self.max_speed), known)
        return tuple(self.found)

    def _values(self, x: Array, u: float, plane: int) -> Complex:
        """The roots that count about a rest, in its plane or across it."""
        values = self.rests.roots(x, u, plane)
        if self.counted is None:
            return values
        few = self.counted // len(self.rests.planes)
        return values[np.argsort(np.abs(values), kind="stable")[:few]]

    def _note(self, step: BranchStep[DenseProblem]) -> str | None:
        """Keeps the crossings on a step; returns why the search ends there."""
        begin, end, ds = step.begin, step.end, step.length
        planes = self.rests.planes
        if not self.roots:
            self.roots = [RootsFollowed(self._values(begin.x, begin.p, k)) for k in planes]
            self.tests = [None for _ in planes]
        tests = [self._test(step, k) for k in planes]

        def growing(s: float) -> int:
            return sum(test.positive(s) for test in tests)

        found, count = special_points(step, 1e-12, tests), growing(0.0)
        turns = [s for name, s, _ in found if name == "fold"]
        for name, before, beyond in found:
            beside = any(abs(before - turn) <= 1e-3 * ds for turn in turns)
            if name == "divergence" and beside:
                continue  # the real root that passes 0 at the fold
            if turns and before > turns[0]:
                break
            if name == "divergence" and self.rests.rms(end.x - self.rests.resting) > 1e-9:
                return TOO_NEAR
            plane = int(name.endswith(OUT_OF_PLANE))
            change = tests[plane].positive(beyond) - tests[plane].positive(before)
            counts = count, count + change
            if name == "fold":  # where a real root passes 0
                ahead = growing(max(before - 1e-3 * ds, 0.0))
                if ahead != count:  # on another branch, to which the step has led
                    return TOO_NEAR
                counts = ahead, max(growing(ds), ahead + 1)
            count = counts[1]
            self.found.append(self._crossing(step, before, beyond, name, counts, plane))
            if self.until_unstable and self.found[-1].crossing.destabilising:
                return "found"
            if name == "fold":
                return "fold"
        self.tests[:], self.reached = tests, end.p
        for roots, plane in zip(self.roots, planes, strict=True):
            roots.move(self._values(end.x, end.p, plane))
        return None

    def _test(self, step: BranchStep[DenseProblem], plane: int) -> GrowthTest:
        """The test function of roots that start to grow, in the plane of rest or across it."""

        def kind(before: float, beyond: float) -> str:
            flutters = (growth.positive(beyond) - growth.positive(before)) % 2 == 0
            return ("flutter" if flutters else "divergence") + OUT_OF_PLANE * plane

        growth = GrowthTest(
            step,
            1e-12 * (1.0 + step.length),
            lambda point: self._values(point.x, abs(point.p), plane),
            kind,
            before=self.tests[plane],
        )
        return growth

    def _crossing(
        self,
        step: BranchStep[DenseProblem],
        before: float,
        beyond: float,
        name: str,
        counts: tuple[int, int],
        plane: int,
    ) -> CrossingOfRest:
        """The crossing between two arc lengths."""
        point = step.at(0.5 * (before + beyond))
        rest, u, error = point.x, point.p, abs(step.at(beyond).p - step.at(before).p)
        values, root = self._values(rest, u, plane), 0j
        meets = False
        flutters, mode = name.startswith("flutter"), self.roots[plane].mode_of(values, root)
        if flutters:
            # Of the pairs that grow on one side, the one that grows least does not on the other.
            side = step.at(beyond if counts[1] > counts[0] else before)
            there = self._values(side.x, side.p, plane)
            grown = np.where(there.imag > 0.0, beyond_rounding(there), 0.0)
            passing = there[np.argmin(np.where(grown > 0.0, grown, np.inf))]
            mode = self.roots[plane].mode_of(there, complex(passing))
            pairs = values[values.imag > 0.0]
            root = complex(pairs[np.argmin(np.abs(pairs - passing))])
            # Roots that meet go with the square root of the distance in speed, and have no slope.
            apart = np.sort(np.abs(there[there.imag > 0.0] - passing))[1:2].min(initial=np.inf)
            meets = bool(apart <= MEET * (1.0 + abs(passing)))
            if meets:
                root, error = complex(0.0, passing.imag), max(error, 0.25 * float(apart) ** 2)
        if (flutters or plane) and not meets:
            rest, u, root, error = self._polished(rest, u, root, error, plane)
        made = Crossing(
            speed=u,
            frequency=root.imag,
            kind="flutter" if flutters else "divergence",
            unstable_before=counts[0],
            unstable_after=counts[1],
            error=error,
            mode=mode,
            vouched=self.counted,
            across=None if len(self.rests.planes) == 1 else bool(plane),
        )
        return CrossingOfRest(made, self.rests, rest)

    def _polished(
        self, rest: Array, u: float, root: complex, error: float, plane: int
    ) -> tuple[Array, float, complex, float]:
        """A flutter by Newton's method for Re lambda = 0, with the error of its speed.

        A divergence across the plane of rest is found by an eigenvalue of the stiffness instead.
        """
        located = rest, u, complex(0.0, root.imag), error
        try:
            at = partial(root_at, self.rests, plane=plane)
            if root.imag and u < SMALL_SPEED:
                values = self.rests.roots(at(0.0, rest, root)[1], 0.0, plane)
                if not decays(values)[np.argmin(np.abs(values - root))]:
                    return rest, 0.0, complex(0.0, root.imag), 0.0  # from the smallest flow on
            slope = slope_of_root(partial(at, near=rest, root=root), u)
            root = root if root.imag else at(u, rest, root)[0]
            for _ in range(4):
                moved = -root.real / slope.real
                if not abs(moved) <= 1e-3 * (1.0 + u):
                    break
                u += moved
                root, rest = at(u, rest, root)
                if abs(moved) <= 1e-14 * (1.0 + u):
                    break
            lost = EPS * float(np.linalg.norm(self.rests.matrices(rest, u, plane)[2]))
            if root.imag:
                values = self.rests.roots(rest, u, plane)
                lost = float(rounding(values)[np.argmin(np.abs(values - root))])
            error = (abs(root.real) + lost) / abs(slope.real)
        except NewtonFailed:
            return located  # next to a fold: as located on the branch
        # Where two pairs meet on the axis, as at beta = 0, roots have no slope.
        return (rest, u, complex(0.0, root.imag), error) if error < MEETING * (1.0 + u) else located
