# SPDX-License-Identifier: MIT
"""Where a pipe rests, and small motions about a rest that bends with the flow speed.

A jet, gravity or another load across the straight pipe bends it. Linear questions about such a pipe
are asked of one rest: that to which the pipe comes as its loads, and then the flow, grow slowly
from zero. It is solved anew at each speed and continued from the last one, until the branch of
equilibria turns back.

The flow acts on a pipe at rest only through a u^2, a being the end coefficient, so that forces are
affine in u^2 at any configuration. Their derivatives are exact, from stiffness and flux operators.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem, Point
from pipedyn.continuation.tracer import Tracer, folds
from pipedyn.linear.neutral import beyond_rounding, eigenvalues_of, grows
from pipedyn.models.base import Model, Operators
from pipedyn.models.continuum import AnyModel
from pipedyn.models.pipe import Pipe
from pipedyn.models.terms import PointMass, Term
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_right_hand_sides
from pipedyn.util.errors import NotConverged, NotResolved
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread

AnyKind = TypeVar("AnyKind", bound=AnyModel)

LONGEST_STEP_OF_REST = 0.1
"""Longest step along the branch of rests: in rad, as the root mean square over the coordinates, and
in units of twice the flow speed. Within a step roots are followed by their distances."""

MOST_RESTS = 20_000
"""Most steps along the branch of rests."""

GROWING, SHORTER_STEPS = (0.1, 0.01, 0.002), (1.0, 0.2, 0.04)
"""Longest steps in which loads grow from zero, in the same measure and as a share of the loads; and
shares of the longest step in which the speed grows. Shorter steps are taken where the others lead
to a rest that buckles or turns back, until two agree: a pipe that buckles, to one side because of a
small load across, has another branch nearby onto which a step may jump. Next to Euler's load, with
steps of 0.04 a load across of 1e-6 is enough to tell which way the pipe buckles."""

SAME_REST = 1e-6
"""Largest difference of rests, or of speeds, that steps of different lengths find."""

LONGEST_CHANGE = 0.25
"""Size beyond which a step of Newton's method is shortened."""


STEPS_OF_REST = Control(longest=LONGEST_STEP_OF_REST, longest_change=LONGEST_CHANGE)
"""Settings of steps along the branch of rests."""


class BranchOfRest:
    """Accelerations of a pipe at rest and their derivatives, in the integrated coordinates.

    In directions that guides and pins forbid, accelerations lead back to configurations that meet
    the constraints: all are zero only at an equilibrium that meets the constraints.

    Args:
        model: the model.
        within: the model in whose coordinates the rest is solved for; by default that of the plane
            in which the pipe rests.
    """

    def __init__(self, model: Model, within: Model | None = None) -> None:
        self.model = model
        self.within: Model = model.planar if within is None else within
        self.size = self.within.integrated
        self.planes = range(1 if self.within is model else model.dimensions - 1)
        self.resting = np.array(self.within.resting(), dtype=np.float64)
        self.branch = DenseProblem(self.equations, self.size, 2.0, STEPS_OF_REST)
        self._about: tuple[Array, Operators] | None = None  # operators about the last configuration
        self._still: Array | None = None  # the rest without flow

    def accelerations(self, xs: Array, u: float | Array) -> Array:
        """Accelerations from rest at configurations xs, (k, integrated), at one speed or k speeds.

        They are NaN where the pipe is bent too sharply.
        """
        count_right_hand_sides(len(xs))
        y = np.concatenate([xs.T, np.zeros_like(xs.T)])
        return self.within.motion_rates(y, u)[self.size :].T

    def jacobian(self, x: Array, p: float) -> Array:
        """Derivative of accelerations by x, (integrated, integrated), or one for each row of x."""
        whole = self.within.motion_jacobian(np.concatenate([x.T, np.zeros_like(x.T)]), abs(p))
        return whole[..., self.size :, : self.size]

    def equations(self, x: Array, p: float) -> tuple[Array, Array]:
        """Accelerations, (integrated,), with derivatives by x and p, (integrated, integrated + 1).

        They are evaluated as affine functions of the square of the speed.
        """
        at_zero, at_one = self.accelerations(np.stack([x, x]), np.array([0.0, 1.0]))
        by_square = at_one - at_zero
        derivative = np.column_stack([self.jacobian(x, p), 2.0 * p * by_square])
        return at_zero + p**2 * by_square, derivative

    def unbalanced(self, x: Array, u: float) -> float:
        """Largest force that is not balanced at x, in units of 1 + |gamma| + a u^2.

        It is infinite where x does not meet the constraints.
        """
        pipe = self.model.pipe
        size = 1.0 + abs(pipe.gamma) + pipe.alpha * u**2
        try:
            force = self.forces(x, u)
        except ValueError:  # x misses a guide or pin
            return math.inf
        return float(np.abs(force).max()) / size

    def forces(self, x: Array, u: float) -> Array:
        """Unbalanced forces in the directions that constraints leave free, (dof,)."""
        free, of = self.within.free_directions(x), self.within.operators(x)
        return of.mass @ (free.T @ self.accelerations(x[None], u)[0])

    def eigenvalues(self, x: Array, u: float) -> Complex:
        """Eigenvalues of small motions about an equilibrium, shape (2 dof,)."""
        return np.concatenate([self.roots(x, u, plane) for plane in self.planes])

    def roots(self, x: Array, u: float, plane: int) -> Complex:
        """Eigenvalues of motions in the plane of rest (0) or, in three dimensions, across (1)."""
        return eigenvalues_of(*self.matrices(x, u, plane))

    def matrices(self, x: Array, u: float, plane: int) -> tuple[Array, Array, NDArray[Any]]:
        """(M, C, K) of small motions about an equilibrium in the plane of rest, or across it."""
        if not plane:
            return self.within.operators(x).at(u)
        if self._about is None or not np.array_equal(self._about[0], x):
            self._about = x, self.model.operators(self.whole(x))
        own = slice(self.within.dof, None)
        mass, damping, stiffness = self._about[1].at(u)
        return mass[own, own], damping[own, own], stiffness[own, own]

    def growth(self, x: Array, u: float) -> Array:
        """Real parts of the eigenvalues minus their rounding, (2 dof,), the largest first."""
        return np.sort(beyond_rounding(self.eigenvalues(x, u)))[::-1]

    def to_user(self, xs: Array) -> Array:
        """Users' coordinates, (k, coordinates), of integrated coordinates xs, (k, integrated)."""
        xs = self.whole(xs.T).T
        return self.model.to_user(xs, np.zeros_like(xs))[0]

    def whole(self, x: Array) -> Array:
        """Coordinates of the model, (integrated, ...), of a configuration or several, x."""
        return x if self.within is self.model else self.model.from_plane(x)

    def about(self, x: Array) -> Model:
        """The model linearised about a configuration x."""
        return self.model.about(self.to_user(x[None])[0])

    def rms(self, x: Array) -> float:
        """Root mean square over the coordinates of a difference x of configurations."""
        return float(np.linalg.norm(x)) / math.sqrt(self.size)

    # ----------------------------------------------------------- the rest that follows the speed

    def without_flow(self) -> Array:
        """The rest at u = 0 to which the pipe comes as gravity and all loads grow from zero.

        Raises:
            NotConverged: if no such rest is found.
        """
        if self._still is None:
            straight = not self.accelerations(self.resting[None], 0.0).any()
            self._still = self.resting if straight else self._loaded()
        return self._still

    def _loaded(self) -> Array:
        """The rest without flow of a pipe that its loads bend."""
        light = BranchOfRest(self.model.with_pipe(_unloaded(self.model.pipe)))

        def equations(x: Array, share: float) -> tuple[Array, Array]:
            free, loaded = (one.accelerations(x[None], 0.0)[0] for one in (light, self))
            slopes = (1.0 - share) * light.jacobian(x, 0.0) + share * self.jacobian(x, 0.0)
            by_share = loaded - free
            return free + share * by_share, np.column_stack([slopes, by_share])

        start = np.append(self.resting, 0.0), np.append(0.0 * self.resting, 1.0)
        points, end, why = list[Point](), "not converged", ""
        for longest in GROWING:
            growing = DenseProblem(equations, self.size, 1.0, Control(longest=longest))
            tracer = Tracer[DenseProblem]([(-1, -1.0, 1.0)], MOST_RESTS)
            try:
                first = growing.point(*start)
                steps = growing.steps(first, 0.5 * longest)
                points, end, why = tracer.one_way(steps, growing, first)
            except NewtonFailed as error:
                points, end, why = [], "not converged", str(error)
            if end == "range" and points[-1].p > 0.5 and not self._buckles(points[-1].x, 0.0):
                break
        if end != "range" or not points[-1].p > 0.5:
            raise NotConverged(
                "no rest without flow was found to which the pipe comes as its loads grow"
                f"{why and ': '}{why}; choose one with about(q), q of equilibria(model, 0)"
            )
        return points[-1].x

    def _buckles(self, x: Array, u: float) -> bool:
        """Whether a root grows in the plane of rest without oscillation, as past a fold."""
        values = self.roots(x, u, 0)
        return bool((grows(values) & (values.imag == 0.0)).any())

    def following(
        self,
        end: float,
        note: Callable[[BranchStep[DenseProblem]], str | None],
        marks: Iterable[float] = (),
        share: float = 1.0,
    ) -> str:
        """Follows the rest from u = 0 up to a speed, step by step, until `note` returns a reason.

        A step ends at each of the speeds `marks`, and is at most the share of the longest one.
        Returns that reason, "range" at the end, or a sentence that says why no next rest was found.
        """
        x, longest = self.without_flow(), share * LONGEST_STEP_OF_REST
        control = replace(self.branch.control, longest=longest)
        branch = DenseProblem(self.equations, self.size, 2.0, control)
        try:
            start = branch.point(np.append(x, 0.0), np.append(0.0 * x, 1.0))
            steps = branch.steps(start, 0.5 * longest, [(-1, mark) for mark in marks])
            _, reason, why = _RestTracer(end, note).one_way(steps, branch, start)
        except NewtonFailed as error:
            reason, why = "not converged", str(error)
        return why or reason

    def towards(self, u: float) -> tuple[Point, str]:
        """The rest that follows from that without flow, at a speed or where it ends before.

        Second comes "range" at that speed, "fold" where the branch turns back, or a sentence that
        says why it was not followed.
        """
        still = self.without_flow()
        last = [Point(np.append(still, 0.0), np.append(0.0 * still, 1.0))]

        def note(step: BranchStep[DenseProblem]) -> str | None:
            turns = folds(step, 1e-12)
            last[:] = [step.at(turns[0][0]) if turns else step.end]
            return "fold" if turns else None

        if u == 0.0:
            return last[0], "range"
        for share in SHORTER_STEPS:
            before = last[0].z
            reason = self.following(u, note, share=share)
            if reason == "range" and not self._buckles(last[0].x, u):
                break
            same = share < 1.0 and np.abs(last[0].z - before).max() < SAME_REST
            if same and reason != "range":  # else steps of two lengths may jump alike
                break
        return last[0], reason

    def at(self, u: float) -> Array:
        """The rest at a flow speed that follows from that without flow, shape (integrated,).

        Raises:
            NotConverged: if the branch turns back before that speed, or is lost.
        """
        last, reason = self.towards(u)
        if reason != "range":
            raise NotConverged(lost_rest(reason, last.p, u))
        return last.x


def _unloaded(pipe: Pipe) -> Pipe:
    """The pipe without gravity and loads, but with a point of no mass at the place of each."""
    terms = list[Term]()
    for term in pipe.terms:
        if not (term.axial_load or term.load_across):
            terms.append(term)
        elif term.place is not None:
            terms.append(PointMass(term.place, 0.0))
    return replace(pipe, gamma=0.0, terms=tuple(terms))


class _RestTracer(Tracer[DenseProblem]):
    """Tracer of the rest that follows the speed, which passes its steps to a function."""

    def __init__(self, end: float, noted: Callable[[BranchStep[DenseProblem]], str | None]) -> None:
        failing = NewtonFailed, NotResolved  # in space at a rest to which only a plane leads
        super().__init__([(-1, 0.0, end)], MOST_RESTS, failing)
        self.noted = noted

    def note(self, step: BranchStep[DenseProblem]) -> str | None:
        """What the function says of a step."""
        return self.noted(step)


def lost_rest(reason: str, speed: float, u: float) -> str:
    """Why there is no rest at a speed that follows from that without flow."""
    turned = f"it turns back at u = {speed:.6g}"
    if reason != "fold":
        turned = f"it is not followed beyond u = {speed:.6g} ({reason})"
    return (
        f"the rest that follows from that without flow does not reach u = {u:g}: {turned}; "
        f"equilibria(model, {u:g}) finds others, about which about(q) linearises"
    )


def rest_follows(model: AnyModel) -> bool:
    """Whether a load bends the pipe, and the model is about no configuration of the user's own."""
    if model.pipe.rests_straight:  # asked first, since small searches take few other calls
        return False
    return not model.rests_bent


def at_rest(model: AnyKind, u: float) -> AnyKind:
    """The model about the rest that follows the flow speed, if its pipe is bent by a load.

    Other models, and the continuous pipe, whose reduced models are to be asked for theirs, are
    returned as they are.

    Raises:
        NotConverged: if no rest follows from that without flow up to the speed.
    """
    if not rest_follows(model) or not isinstance(model, Model):
        return model
    rest = BranchOfRest(model)
    with one_thread(model.dof):
        return rest.about(rest.at(u))  # type: ignore[return-value]
