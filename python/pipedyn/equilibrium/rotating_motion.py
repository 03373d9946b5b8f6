# SPDX-License-Identifier: MIT
"""Circular motion of a pipe that flutters in three dimensions, as an equilibrium that rotates.

In a frame that rotates about the axis of the straight pipe with the angular velocity W of the
motion the pipe is at rest: q(t) = R(W t) q_0. With the quarter turn J, q' = W J q and q'' = -W^2 q,
so that the accelerations of the model satisfy

    accelerations(q, W J q; u) + W^2 q = 0.

The plane in which the last coordinate lies is free; it is fixed by a_z = 0 there. Small changes of
the state obey the constant matrix Df - W J, whose eigenvalues are the exponents of the motion. One
of them is 0, since a rotated motion is a motion.

Source: relative equilibria, Golubitsky, Stewart and Schaeffer, Singularities and Groups in
Bifurcation Theory II, ch. XVI.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import field
from functools import partial
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem, Point
from pipedyn.continuation.tracer import Tracer, special_points
from pipedyn.equilibrium.equilibria import BranchPoint, Change
from pipedyn.equilibrium.hopf import HopfPoint, hopf
from pipedyn.linear.following import GrowthTest
from pipedyn.linear.neutral import growth
from pipedyn.linear.sensitivity import of_each
from pipedyn.models.base import Model
from pipedyn.models.drive import steady_speed
from pipedyn.models.space import SpatialModel
from pipedyn.motion.simulate import checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import LENGTH, RATE, Result, TableResult

FIRST_RADIUS = 1e-3
"""Largest angle of the first motion that is solved for, in rad: terms of higher degree change its
speed by a millionth."""

LONGEST_BRANCH = 400
"""Largest number of steps along the branch of circular motions."""

ROTATES = 0.1
"""Largest share of the rates of a state that is no rotation where a circular motion is near, and
largest relative distance of its shape."""

ROTATING_STEPS = Control(longest=0.2, shortest=1e-9, corner=1e-6)
"""How steps along the branch are taken, which has a corner where the pipe meets a stop."""


@saved_as("RotatingMotion")
class RotatingMotion(Result, units={"radius": LENGTH, "height": LENGTH, "exponents": RATE}):
    """A circular motion: a bent shape that rotates about the axis of the straight pipe.

    Attributes:
        u: flow speed.
        frequency: angular velocity W, in 1 / T; the shape turns from x towards z.
        radius: distance of the free end from the axis, in L.
        height: y of the free end, in L.
        exponents: growth rates of small changes in the frame that rotates, by falling real parts,
            complex, shape (2 dof - 1,). That of the motion turned about the axis, which is 0, is
            left out.
        q: coordinates of the shape at one time, shape (dof,).
        model: the model.

    Example:
        >>> found = pp.rotating_motion(pp.Chain(pp.Pipe(0.2), n=10, dimensions=3), 6.0)
        >>> round(found.radius, 4), round(found.frequency, 3), found.stable
        (0.22, 14.336, True)
    """

    u: float
    frequency: float
    radius: float
    height: float
    exponents: Complex = field(repr=False)
    q: Array = field(repr=False)
    model: Model

    @property
    def stable(self) -> bool:
        """Whether all exponents have negative real parts, so that the motion attracts."""
        return bool(growth(self.exponents).max() < 0.0)

    @property
    def qdot(self) -> Array:
        """Rates of the coordinates at the time of `q`, shape (dof,)."""
        return self.frequency * self.model.quarter_turn(self.q)

    def _shown(self) -> dict[str, Any]:
        return super()._shown() | {"stable": self.stable}


@saved_as("RotatingBranch")
class RotatingBranch(TableResult):
    """Circular motions along a branch that begins at an onset of flutter, in order.

    Attributes:
        motions: the motions; among them are one at each speed asked for that the branch passes,
            and one at each point of `points`.
        points: points at which the branch turns back in the flow speed or its stability changes:
            "fold", "branch point" (a real exponent passes 0) or "hopf" (a pair passes the axis, so
            that the circle begins to pulsate).
        onset: flow speed at which it begins.
        end: why the branch ends: "range" (of speeds), "points" (it has too many) or "not converged"
            (no next motion was found, as where a reduced model does not resolve the motion).

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=4, dimensions=3)
        >>> (branch,) = pp.bifurcation_diagram(chain, [5.0, 6.0]).rotating
        >>> round(branch.onset, 3), [round(one.radius, 3) for one in branch.at(6.0)]
        (4.949, [0.313])
    """

    motions: tuple[RotatingMotion, ...] = field(repr=False)
    points: tuple[BranchPoint, ...]
    onset: float
    end: str

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def speeds(self) -> Array:
        """Flow speed u, shape (S,)."""
        return of_each(self.motions, "u")

    @property
    def radii(self) -> Array:
        """Distance of the free end from the axis in L, shape (S,)."""
        return of_each(self.motions, "radius")

    @property
    def frequencies(self) -> Array:
        """Angular velocity in 1 / T, shape (S,)."""
        return of_each(self.motions, "frequency")

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each motion is stable, shape (S,)."""
        return np.array([one.stable for one in self.motions])

    def at(self, u: float) -> tuple[RotatingMotion, ...]:
        """The motions at one of the speeds asked for, in order along the branch."""
        u = check.real("u", u, low=0.0)
        return tuple(one for one in self.motions if math.isclose(one.u, u, rel_tol=1e-12))

    def _columns(self) -> dict[str, Any]:
        return {
            "speed": self.speeds,
            "radius": self.radii,
            "height": of_each(self.motions, "height"),
            "frequency": self.frequencies,
            "stable": self.stable,
        }


def rotating_motion(model: Model, u: float) -> RotatingMotion:
    """The circular motion of a pipe in three dimensions at a flow speed.

    It is followed from the critical speed, where it emerges, through growing radius to the first
    such motion at the speed asked for.

    Args:
        model: model in three dimensions, up to 200 degrees of freedom.
        u: flow speed > 0.

    Returns:
        RotatingMotion. The mirrored motion, which turns the other way, exists as well.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.5), n=10, dimensions=3)
        >>> pp.rotating_motion(chain, 9.5).stable
        False

    Raises:
        NotConverged: if the branch of circular motions does not reach the speed.
        NoHopf, NoCrossing: if stability is not lost by flutter.
        ValueError, TypeError: for bad arguments, such as a model that moves in a plane.

    Source: see the module's docstring.
    """
    checked_model_in_motion(model, largest=200, purpose="rotating_motion", symmetric=True)
    check.instance("model", model, Model, "a model in three dimensions")
    model.quarter_turn(np.zeros(model.integrated))  # refuses planar models
    u = steady_speed("u", u, open_low=True)
    with one_thread(2 * model.integrated):
        onset = hopf(model.planar)
        tracer = _RotatingTracer(model, onset, (0.0, math.inf), until=u)
        *_, why = tracer.followed()
        if not tracer.over:
            raise NotConverged(
                f"no circular motion was found at u = {u:g}: the branch that emerges at u = "
                f"{onset.speed:.6g} was not followed so far, as {why}"
            )
        return motion_at(model, tracer.path[-1])


def rotating_branch(
    model: Model, onset: HopfPoint, speeds: tuple[float, float], marks: Iterable[float]
) -> RotatingBranch | None:
    """The circular motions that emerge at an onset of flutter of the straight pipe.

    The result is None if none lie between the speeds.

    Args:
        model: model in three dimensions, the same in all directions.
        onset: the onset of its planar model.
        speeds: flow speeds between which the branch is followed.
        marks: flow speeds at which motions are wanted.

    Raises:
        NewtonFailed: if no circular motion is found beside the onset.
    """
    low, high = speeds  # a branch that begins below may turn back before it comes to them
    within = (low if low <= onset.speed else 0.0, high)
    tracer = _RotatingTracer(model, onset, within, marks)
    _, end, why = tracer.followed()
    if not tracer.path:
        if why:
            raise NewtonFailed(why)
        return None
    if end == "range" and not any(low <= z[-1] <= high for z in tracer.path):
        return None
    motions = tuple(motion_at(model, z) for z in tracer.path)
    return RotatingBranch(motions, tuple(tracer.changes), onset.speed, end)


class _RotatingTracer(Tracer[DenseProblem]):
    """Tracer of the circular motions that emerge at an onset of flutter.

    Attributes:
        path: solutions (q, W, u) at the ends of steps and where stability changes, in order; or
            the one at the speed `until`, if that is given.
        over: whether the branch has reached that speed.
        changes: points at which the stability changes or the branch turns back.
    """

    def __init__(
        self,
        model: Model,
        onset: HopfPoint,
        speeds: tuple[float, float],
        marks: Iterable[float] = (),
        until: float | None = None,
    ) -> None:
        super().__init__([(-1, *speeds)], LONGEST_BRANCH)
        self.model, self.onset, self.until = model, onset, until
        self.marks = [(-1, mark) for mark in marks]
        self.path, self.over, self.changes = list[Array](), False, list[BranchPoint]()
        self.test: GrowthTest | None = None  # of the last step

    def followed(self) -> tuple[list[Point], str, str]:
        """Follows the branch; returns its points, why it ends, and a sentence on that."""
        model, onset, size = self.model, self.onset, self.model.integrated
        mode = onset.mode[: size // 2]
        mode = mode / mode[-1]
        mode *= FIRST_RADIUS / np.abs(mode).max()
        guess = np.concatenate([mode.real, mode.imag, [onset.frequency, onset.speed]])
        problem = DenseProblem(partial(_equations, model), size + 1, 1.0, ROTATING_STEPS)
        last = size // 2 - 1
        outward = np.zeros(size + 2)
        outward[last] = 1.0
        try:
            start = problem.point(problem.fixed(guess, float(guess[last]), last), outward)
        except NewtonFailed as failed:
            return [], "not converged", str(failed)
        if self.until is None and not self.is_over(start):
            self.path.append(start.z)
        steps = problem.steps(start, FIRST_RADIUS, self.marks)
        return self.one_way(steps, problem, start)

    def note(self, step: BranchStep[DenseProblem]) -> str | None:
        """Keeps the end of a step and changes on it, or the motion at the speed `until`."""
        if self.until is not None:
            self.over = (step.begin.p - self.until) * (step.end.p - self.until) <= 0.0
            self.path = [step.where(self.until)] if self.over else []
            return "range" if self.over else None

        def kind(before: float, s: float) -> Change:
            odd = (test.positive(s) - test.positive(before)) % 2
            return "branch point" if odd else "hopf"

        # At a fold a real exponent passes 0, which is one change and listed once.
        self.test = test = GrowthTest(
            step, 1e-8 * step.length, self._roots, kind, beside_folds=1e-3, before=self.test
        )
        for name, _, s in special_points(step, 1e-8, [test]):
            z = step.at(s).z
            self.path.append(z)
            self.changes.append(self._point(cast(Change, name), z))
        self.path.append(step.end.z)
        return None

    def _roots(self, point: Point) -> Complex:
        """The exponents of the motion at a point."""
        return exponents_of(self.model, point.z)

    def _point(self, kind: Change, z: Array) -> BranchPoint:
        q, frequency = z[: self.model.integrated], 0.0
        if kind == "hopf":
            found = exponents_of(self.model, z)
            oscillating = found[found.imag > 1e-6]
            frequency = float(oscillating[np.abs(oscillating.real).argmin()].imag)
        return BranchPoint(kind, float(z[-1]), frequency, q, self.model.tip(q))


def _equations(model: Model, x: Array, u: float) -> tuple[Array, Array]:
    """Residual of a circular motion x = [q, W], and its derivatives by x and u."""
    size = model.integrated
    q, w = x[:size], float(x[size])
    turned = model.quarter_turn(q)
    found = model.motion_linearised(np.concatenate([q, w * turned])[:, None], u)[0]
    rates, by_speed, by_state = found[0, size:], found[1, size:], found[2 + size :]
    by_rate = by_state[:, size:]
    turn = model.quarter_turn(np.eye(size))
    slopes = by_state[:, :size] + w * (by_rate @ turn) + w**2 * np.eye(size)
    phase = np.zeros(size + 2)
    phase[size - 1] = 1.0
    whole = np.column_stack([slopes, by_rate @ turned + 2.0 * w * q, by_speed])
    return np.append(rates + w**2 * q, q[-1]), np.vstack([whole, phase])


def rotation_near(model: Model, state: Array, u: float) -> Array:
    """The circular motion (q, W, u) near a state [q, q'] at a flow speed.

    Raises:
        NewtonFailed: if the state does not rotate or Newton's method leads far away.
    """
    assert isinstance(model, SpatialModel)
    q, rates = np.split(state, 2)
    turned = model.quarter_turn(q)
    w = float(turned @ rates) / max(float(q @ q), 1e-300)
    if np.linalg.norm(rates - w * turned) > ROTATES * np.linalg.norm(rates):
        raise NewtonFailed("the motion is not circular")
    last = model.integrated - 1
    q = model.turned(q, -math.atan2(q[last], q[last // 2]))
    problem = DenseProblem(partial(_equations, model), q.size + 1, 1.0, ROTATING_STEPS)
    found = problem.fixed(np.concatenate([q, [w, u]]), u)
    if np.linalg.norm(found[: q.size] - q) > ROTATES * np.linalg.norm(q):
        raise NewtonFailed("no circular motion is near")
    return found


def rotating_slopes(model: Model, z: Array) -> Array:
    """Derivative of the rates by the state in the frame of a motion z = (q, W, u)."""
    size = model.integrated
    q, w, u = z[:size], float(z[size]), float(z[size + 1])
    state = np.concatenate([q, w * model.quarter_turn(q)])
    turn = np.kron(np.eye(2), model.quarter_turn(np.eye(size)))
    free = model.free_states(state)  # without changes that supports forbid
    return np.asarray(free.T @ (model.motion_jacobian(state, u) - w * turn) @ free)


def exponents_of(model: Model, z: Array) -> Complex:
    """Growth rates of small changes of a motion z = (q, W, u), without that of a turn."""
    found = np.linalg.eigvals(rotating_slopes(model, z)).astype(complex)
    found = np.delete(found, np.abs(found).argmin())
    return found[np.lexsort((-found.imag, -found.real))]


def motion_at(model: Model, z: Array) -> RotatingMotion:
    """The circular motion of a solution z = (q, W, u)."""
    size = model.integrated
    x, y, across = model.tip(z[:size])
    return RotatingMotion(
        u=float(z[size + 1]),
        frequency=float(z[size]),
        radius=float(np.hypot(x, across)),
        height=float(y),
        exponents=exponents_of(model, z),
        q=z[:size],
        model=model,
    )
