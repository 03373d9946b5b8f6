# SPDX-License-Identifier: MIT
"""Forces on a pipe at rest, in the plane of its loads or in space, and the rests nearby."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem, Point
from pipedyn.linear.rest import BranchOfRest
from pipedyn.models.base import BALANCED, Model
from pipedyn.models.space import SpatialModel
from pipedyn.motion.vector_field import VectorField
from pipedyn.util.check import Array, Complex
from pipedyn.util.newton import NewtonFailed, newton

BUCKLED = (0.5, 1.5, 3.0)
"""Largest angles, in rad, of starts in the shapes in which a pipe buckles. With these starts and
one upside down, the search misses 2 of 84 elastica of 15 pinned pipes under a dead load;
without them it misses 40."""

DISTINCT = 1e-6
"""Largest difference of a coordinate, relative to 1 plus the largest coordinate, up to which two
solutions are the same equilibrium. In 11 searches of five models, solutions for one equilibrium
differed by 7e-16 at most, and different equilibria by 0.1 at least."""

SOLVED = 1e-8
"""Length of a step of Newton's method after which the error, of the order of its square, is small
enough."""

FORCE_STEP = 1e-5
"""Change of a coordinate over which forces are compared, so that their slopes have ten digits."""

NEARER = 0.95
"""Share of the way to a pitchfork that is taken twice along a branch that meets it. From there its
speed, whose difference falls as the square of the way left, is extrapolated; at the pitchfork
itself the equations are singular."""

TOWARDS_FORK = 8
"""Number of times that a step is about halved towards a pitchfork, before that extrapolation."""

ALONG = np.linspace(0.0, 1.0, 201)
"""Arc lengths s, in lengths of the pipe, at which shapes are compared."""


class Statics(BranchOfRest):
    """The search for equilibria of a model, by the accelerations of a pipe at rest.

    In three dimensions configurations are those of the planar model, and their stability that of
    all small motions, in the plane and across it.
    """

    def __init__(self, model: Model, within: Model | None = None) -> None:
        super().__init__(model, within)
        self.motion = VectorField(self.within)
        # Forces are affine in the square of the speed: balanced at two speeds, they are at all.
        still = max(self.within.unbalanced(0.0), self.within.unbalanced(1.0))
        self.always_rests = still <= BALANCED

    def eigenvalues(self, x: Array, u: float) -> Complex:
        """Eigenvalues of small motions about an equilibrium, those across its plane included.

        If a turn about the axis changes nothing, the eigenvalue 0 of that turn is left out.
        """
        found = super().eigenvalues(x, u)
        turns = self.model.axisymmetric and not self.straight(x)
        return np.delete(found, np.abs(found).argmin()) if turns else found

    def mirrors(self, u: float) -> list[Array]:
        """Signs of coordinates, (integrated,) each, that make an equilibrium of every other one."""
        return [-np.ones(self.size)] if self.motion.is_odd(u) else []

    def turned_alike(self, xs: Array) -> NDArray[np.bool_]:
        """Which rows of xs are turned about the axis from the row before, shape (k,)."""
        images = np.zeros(len(xs), dtype=bool)
        if self.model.axisymmetric:
            images[1:] = np.abs(xs[1:] + xs[:-1]).max(axis=1) <= DISTINCT
        return images

    @staticmethod
    def steps(slopes: Array, residuals: Array) -> Array:
        """Newton's steps, (k, integrated); not finite where a residual is not finite.

        slopes: derivatives of the residuals, (k, integrated, integrated).
        """
        try:
            found = np.linalg.solve(slopes, -residuals[:, :, None])
        except np.linalg.LinAlgError:  # the shortest step of those that a free turn leaves
            found = np.linalg.pinv(slopes, 1e-13) @ -residuals[:, :, None]
        return np.asarray(found[:, :, 0])

    def at_rest(self, rest: Array, x: Array, p: float) -> tuple[Array, Array]:
        """Equations x = rest of a straight pipe, regular also where other branches leave it."""
        return x - rest, np.eye(self.size, self.size + 1)

    def solved(self, x: Array, u: float) -> Array:
        """The equilibrium near a configuration; raises `NewtonFailed` if none is found."""
        # Steps are limited to 0.05 of 1 rad plus the size of x, so that they lead to an equilibrium
        # near the start: at 0.1 a bent pipe in a guide became straight. 100 of them can reach
        # hundreds of rad.
        control = Control(longest=math.inf, longest_change=0.05, iterations=100)
        problem = DenseProblem(self.equations, self.size, 1.0, control)
        found = problem.fixed(np.append(x, u), u)[:-1]
        if self.unbalanced(found, u) > BALANCED:
            raise NewtonFailed("forces are left")
        return found

    def balanced(self, x: Array, u: float, **rules: Any) -> Array:
        """The equilibrium to which Newton's method leads from x; `rules` are those of `newton`.

        Here Newton's method balances forces, whose derivative is the stiffness. Accelerations,
        which the search for all equilibria brings to 0 from many starts at once, are less linear,
        as the inverse of the mass changes with the configuration. Steps are measured by their
        angles.

        Raises:
            NewtonFailed: if Newton's method leads to no equilibrium.
        """
        if self.unbalanced(x, u) <= BALANCED:
            return x
        slopes = self.angles(np.eye(self.size)).T

        def correction(x: Array) -> tuple[Array, float]:
            step = self.step_to_balance(x, u)
            return step, rms_along(slopes @ step)

        def moved(x: Array, step: Array, share: float) -> Array:
            there = self.within.onto_constraints(x + share * step, np.zeros_like(x))[0]
            if not np.isfinite(there).all():
                raise NewtonFailed("constraints cannot be met")
            return there

        found = newton(x, correction, moved, tolerance=SOLVED, stagnation=100.0 * SOLVED, **rules)
        if self.unbalanced(found, u) > BALANCED:
            raise NewtonFailed("forces are left")
        return found

    def step_to_balance(self, x: Array, u: float) -> Array:
        """Step of Newton's method for the forces at x in directions that constraints allow."""
        free, (mass, _, stiffness) = self.within.free_directions(x), self.matrices(x, u, 0)
        force = mass @ (free.T @ self.accelerations(x[None], u)[0])
        return np.asarray(free @ np.linalg.solve(stiffness, force))

    def buckled(self, rest: Array, u: float) -> Iterator[Array]:
        """Starts in the shapes in which the pipe buckles, if a rest is statically unstable.

        If the root is a hinge, the pipe at rest turned upside down is another start.
        """
        if self.whole_turn is not None:
            yield rest + 0.5 * self.whole_turn
        free, (mass, _, stiffness) = self.within.free_directions(rest), self.matrices(rest, u, 0)
        values, vectors = np.linalg.eig(np.linalg.solve(mass, stiffness))
        static = (values.real < 0.0) & (np.abs(values.imag) <= 1e-9 * np.abs(values).max())
        for shape in (free @ vectors[:, static].real).T:
            most = float(np.abs(self.angles(shape[None])).max())
            for size in BUCKLED:
                bent = rest + size / most * shape
                yield self.within.onto_constraints(bent, np.zeros_like(bent))[0]

    def resembling(self, other: Statics, x: Array) -> Array:
        """The configuration of this model with the shape that x has in another basis."""

        def of(plane: int, s: Array) -> Array:
            return np.reshape(other.within.deflection(x, s, 1), (-1, s.size))[plane]

        return np.asarray(self.within.bent(*(partial(of, k) for k in range(self.axes))))

    @property
    def axes(self) -> int:
        """Number of axes across the straight pipe along which configurations may bend."""
        return self.within.dimensions - 1

    def angles(self, xs: Array) -> Array:
        """Angles of the pipe at arc lengths `ALONG`, (k, points), for rows xs, (k, integrated).

        In space they are those about z and about x, (k, 2 points), times sqrt(2), so that their
        root mean square is that of the whole angle.
        """
        found = self.within.deflection(xs.T, ALONG, 1).reshape(self.axes * ALONG.size, -1)
        return math.sqrt(self.axes) * np.asarray(found).T

    @cached_property
    def whole_turn(self) -> Array | None:
        """Change of x by a whole turn about a hinge at the root; None if a force resists turns.

        It is None in space, too, where coordinates end at half a turn.
        """
        if self.within.pipe.root_stiffness or self.axes == 2:
            return None
        turn = self.within.sampled(lambda s: np.full_like(s, 2.0 * math.pi))
        both = self.to_user(np.stack([self.resting, self.resting + turn]))
        energies = self.model.energy(np.concatenate([both, np.zeros_like(both)], axis=1).T)
        return turn if np.ptp(energies) <= 1e-9 * (1.0 + abs(self.within.pipe.gamma)) else None

    @cached_property
    def turns_freely(self) -> bool:
        """Whether no force opposes a turn about a hinge, so that all angles are alike."""
        turn = self.whole_turn
        aside = None if turn is None else self.resting + 0.1 * turn
        return aside is not None and max(self.unbalanced(aside, u) for u in (0.0, 1.0)) <= BALANCED

    def unwound(self, x: Array) -> Array:
        """The configuration x without whole turns about a hinge at the root, or without any."""
        turn = self.whole_turn
        if turn is None:
            return x
        if self.turns_freely:
            return x - turn * float(x @ turn) / float(turn @ turn)
        # A mean angle of pi or -pi becomes -pi, as rounding may not tell them apart.
        return x - turn * math.floor(float(x @ turn) / float(turn @ turn) + 0.5 + 1e-9)

    def straightened(self, x: Array) -> Array:
        """The configuration nearest to x among the rest and, on a hinge, its half turns.

        If the pipe at rest is straight, each of them is its own mirror image.
        """
        if self.whole_turn is None:
            return self.resting
        half = 0.5 * self.whole_turn
        return self.resting + half * round(float((x - self.resting) @ half) / float(half @ half))

    def straight(self, x: Array) -> bool:
        """Whether a configuration is that of a straight pipe, which is its own mirror image."""
        return not self.resting.any() and self.rms(x - self.straightened(x)) < 1e-9

    def fork_speed(self, rest: Array, u: float) -> float | None:
        """Speed of the pitchfork of a straight pipe nearest to u, or None if none is near.

        Its square is an eigenvalue, as the Jacobian at rest is affine in the square of the speed.
        """
        if not self.always_rests:
            return None
        slope = self.jacobian(rest, 1.0) - self.jacobian(rest, 0.0)
        squares = _core.general_values(self.jacobian(rest, 0.0), -slope)  # infinite without flux
        real = (squares.real > 0.0) & (np.abs(squares.imag) <= 1e-9 * np.abs(squares))
        found = np.sqrt(squares.real[real])
        near = found[np.abs(found - u) < 0.02 * (1.0 + u)]
        return min(near.tolist(), key=lambda p: abs(p - u), default=None)

    def meeting(
        self, step: BranchStep[DenseProblem], farthest: float
    ) -> tuple[Point, float] | None:
        """The pitchfork at which a branch meets its mirror image on a step, None if it does not.

        Then the next point lies on the mirror image, or Newton's method leads to the straight pipe.

        Args:
            step: the step.
            farthest: largest root mean square of what is mirrored, at the ends of such a step.

        Returns:
            The pitchfork, and the arc length up to which the step lies on the branch.
        """
        a, b, rest = step.begin.z, step.end.z, np.append(self.straightened(step.begin.x), 0.0)
        # Beside a stop on one side branches leave the straight pipe, too, though unlike each other.
        for signs in self.mirrors(step.begin.p) or [-np.ones(self.size)]:
            mirrored = np.append(signs < 0.0, False)
            x, y = ((z - rest)[mirrored] for z in (a, b))
            before, beyond = self.rms(x), self.rms(y)
            landed = beyond < 1e-9
            if before >= 1e-9 and max(before, beyond) <= farthest and (landed or x @ y < 0.0):
                fork = self.fork_on(step, mirrored)
                until = 0.0 if landed else 0.98 * step.length * before / (before + beyond)
                return None if fork is None else (Point(fork, step.begin.tangent), until)
        return None

    def fork_on(self, step: BranchStep[DenseProblem], mirrored: NDArray[np.bool_]) -> Array | None:
        """Unknowns z, (integrated + 1,), where a branch meets its mirror image, if they are known.

        mirrored: which entries of z have the opposite sign in the mirror image.
        """
        rest = self.straightened(step.begin.x)
        speed = None if self.resting.any() else self.fork_speed(rest, step.begin.p)
        return None if speed is None else np.append(rest, speed)


class StaticsInSpace(Statics):
    """The search for equilibria of a model in three dimensions that leave the plane of its loads.

    Configurations are those of the model itself.
    """

    def __init__(self, model: Model) -> None:
        super().__init__(model, model)

    def matrices(self, x: Array, u: float, plane: int) -> tuple[Array, Array, Array]:
        """(M, C, K) of small motions about an equilibrium, divided by its mass matrix: M = 1."""
        free = self.within.free_directions(x)
        slopes = self.within.motion_jacobian(np.append(x, 0.0 * x), u)[self.size :]
        stiffness, damping = (-free.T @ part @ free for part in np.split(slopes, 2, axis=1))
        return np.eye(len(stiffness)), damping, stiffness

    def forces(self, x: Array, u: float) -> Array:
        """Unbalanced forces, (integrated,), those that a missed support would need included."""
        return self._all_forces(x[None], u)[0]

    def _all_forces(self, xs: Array, u: float) -> Array:
        assert isinstance(self.within, SpatialModel)
        return self.within.inertia(xs.T, self.accelerations(xs, u).T).T

    def step_to_balance(self, x: Array, u: float) -> Array:
        """Step of Newton's method for the forces, whose derivative is a central difference."""
        free = self.within.free_directions(x)
        either = np.concatenate([x + FORCE_STEP * free.T, x - FORCE_STEP * free.T])
        ahead, behind = np.split(self._all_forces(either, u) @ free, 2)
        slopes = (ahead - behind).T / (2.0 * FORCE_STEP)
        return np.asarray(-free @ np.linalg.solve(slopes, free.T @ self.forces(x, u)))

    def mirrors(self, u: float) -> list[Array]:
        """Signs of coordinates for the images in the plane z = 0, in x = 0, and in the axis."""
        x, z = np.repeat(np.eye(2), self.size // 2, axis=1)
        return [x - z, z - x, -x - z] if self.motion.is_odd(u) else [x - z]

    def unwound(self, x: Array) -> Array:
        """The configuration x by tangents that are turned by half a turn at most."""
        return self.within._alike(np.zeros(2 * self.size), np.append(x, 0.0 * x))[: self.size]

    def fork_on(self, step: BranchStep[DenseProblem], mirrored: NDArray[np.bool_]) -> Array:
        """Unknowns z where a branch meets its image in a plane or in the axis, as for `Statics`.

        At the distance d from there, of what is mirrored, all else differs by the order of d^2.
        """
        problem, here, beyond, way = step.problem, step.begin, step.end, 0.0
        x = here.z[mirrored]
        for _ in range(TOWARDS_FORK):  # the branch may be no longer than a step
            apart = problem.product(here.tangent, beyond.z - here.z)
            middle = problem.at(here, 0.45 * apart)
            same = float(middle.z[mirrored] @ x) > 0.0
            here, beyond = (middle, beyond) if same else (here, middle)
        for share in (NEARER, NEARER, 1.0):
            away, by = here.z[mirrored], here.tangent[mirrored]
            way = -float(away @ away) / float(away @ by)
            if share < 1.0:
                here = problem.at(here, share * way)
        fork = here.z + 0.5 * way * here.tangent
        fork[mirrored] = 0.0
        return fork


def leaves_planes(model: Model) -> bool:
    """Whether a model may rest out of the plane z = 0, which its loads or springs set apart."""
    return model.dimensions == 3 and not model.axisymmetric


def from_start(model: Model, name: str, start: Any) -> Array:
    """Coordinates p, (integrated,), of a start at rest that is the argument `name`.

    The start consists of coordinates or is a function theta(s).

    Raises:
        ValueError: also if it lies in none of the planes in which the model may rest.
    """
    given = model.bent(start) if callable(start) else start
    try:
        p, _ = np.split(np.asarray(model.initial_state(given, None)), 2)
    except (ValueError, TypeError) as error:
        raise type(error)(str(error).replace("q0", name, 1)) from error
    if not leaves_planes(model):
        model.into_plane(name, p)
    return p


def statics_of(model: Model, p: Array) -> tuple[Statics, Array]:
    """The search for equilibria near a configuration p, (integrated,), and its coordinates there.

    It is that in a plane unless p lies in none and the model may rest there.
    """
    if leaves_planes(model) and not model.lies_in_plane(p):
        return StaticsInSpace(model), p
    return Statics(model), model.nearest_in_plane(p)


def rms_along(angles: Array) -> Any:
    """Root mean square along the pipe of angles at the arc lengths `ALONG`, (..., points)."""
    return np.sqrt(np.mean(angles**2, axis=-1))
