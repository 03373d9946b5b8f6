# SPDX-License-Identifier: MIT
"""Equations of a periodic orbit at an event, for continuation in two parameters.

The collocation equations G(z) = 0 of an orbit z = (states, rates, omega, u) leave one degree of
freedom: a branch with the unit tangent t. A second parameter x adds another one, and the event adds
a condition:

    fold              the component of t along u is 0;
    root rho          the smallest singular value of A = L + rho R is 0, where L y(0) + R y(span) =
                      0 holds for solutions y of the linearised equations: after the span a
                      perturbation is multiplied by rho;
    torus             as for a root rho = e^(i theta) with theta unknown, in two real equations.

Each is a minimally extended system (Govaerts 2000, Numerical methods for bifurcations of dynamical
equilibria, sec. 4 and 7; for cycles Doedel, Govaerts and Kuznetsov 2003): with the left and right
singular vectors w and v of A about a point, w* A v is the scalar of the system that they border,
and w* dA v is its derivative. The vectors t, v and w follow from the linear equations that Newton's
method on the orbit solves anyway. So do the changes that an orbit may undergo, which are the
solutions of [G_z; <t, .>] for -G, for t and for -G_x: the condition is differentiated along these
alone, by differences of the condition itself. It needs no second derivatives of the forces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Literal, Self

import numpy as np

from pipedyn.continuation.arclength import Control, Solver
from pipedyn.linear.eigenproblem import Complex
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import Linearised, OrbitProblem
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed

Followed = Literal["fold", "pitchfork", "period doubling", "torus"]
"""Events that are followed in two parameters."""

SHORT, LONG, SMALL_CYCLE = 1e-6, 1e-4, 0.05
"""Changes over which conditions are differentiated, relative to the orbit's size or the parameter's
range: this is about the factor by which each step of Newton's method is shorter than the last.
Conditions have an error of some 1e-12. Beside a Hopf point the condition of a fold changes with the
square of the amplitude; below the third number, an amplitude in L, rounding therefore demands a
change that grows from the first number up to the second."""


class Family:
    """Equations of motion over a second parameter.

    Args:
        make: makes the equations at a value of the parameter; raises ValueError where there are
            none.
        width: width of the parameter's range. A change of the parameter by it is as long as a
            change of the free end's position by L.
        is_speed: whether the parameter is the flow speed of a forced motion.
    """

    def __init__(
        self, make: Callable[[float], VectorField], width: float, is_speed: bool = False
    ) -> None:
        self.width, self.is_speed = width, is_speed
        self.at: Callable[[float], VectorField] = lru_cache(maxsize=64)(make)


class EventProblem(OrbitProblem):
    """Equations of a periodic orbit at an event.

    The unknowns are z = (orbit, theta of a torus, x), where x is the second parameter.

    Args:
        family: equations of motion over x.
        kind: kind of the event.
        start: an orbit near the event.
        extra: the unknowns beside the orbit, at the start: x, or theta and x.
        control: how steps along the curve are taken.
        unit: root mean square of the positions for each L of the free end's amplitude, as in
            `OrbitProblem`; that of the start where it is not given.
    """

    def __init__(
        self,
        family: Family,
        kind: Followed,
        start: PeriodicOrbit,
        extra: Array,
        control: Control,
        unit: float | None = None,
    ) -> None:
        try:
            motion = family.at(float(extra[-1]))
        except ValueError as error:
            raise NewtonFailed(str(error)) from None
        super().__init__(motion, start, control, unit)
        self.family, self.kind, self.extra = family, kind, extra
        self._of_orbit = slice(self.weights.size)
        if not start.forced:
            # All multiples of the start about its mean meet the condition on the phase, so that a
            # curve may pass through an amplitude of 0. This needs a correction, as sums over a mesh
            # do not make velocities exactly orthogonal to positions.
            row, size = self._phase[0], self._size(start)
            mean, swing = self._swing(start)
            row = row - (row @ swing) / size**2 * self.weights * swing
            self._phase = row, float(row @ mean)
        ends = [family.width**-2] if extra.size == 1 else [1.0, family.width**-2]
        self.weights = np.append(self.weights, ends)

    @property
    def origin(self) -> Array:
        """Unknowns z at the start."""
        return np.append(self.start.packed(), self.extra)

    def about(self, z: Array, edges: Array | None = None) -> Self:
        """These equations with a start at unknowns z, on another mesh if its edges are given."""
        extra = z[self.weights.size - self.extra.size :]
        orbit = self.remeshed(z, edges)
        return type(self)(self.family, self.kind, orbit, extra, self.control, self.unit)

    def orbit(self, z: Array) -> PeriodicOrbit:
        """The orbit at unknowns z."""
        orbit = self.start.unpacked(z[self._of_orbit])
        return replace(orbit, u=float(z[-1])) if self.family.is_speed else orbit

    def relative(self, z: Array, step: Array) -> float:
        """Size of a step relative to the orbit, 1 rad and the parameter's range."""
        rest = step[self.weights.size - self.extra.size :].copy()
        rest[-1] /= self.family.width
        of_orbit = super().relative(z, step[self._of_orbit])
        return max(of_orbit, float(np.abs(rest).max()))

    def check(self, z: Array) -> None:
        """Raises NewtonFailed at unknowns that are no orbit near the start, or without a motion."""
        super().check(z)
        try:
            self.family.at(float(z[-1]))
        except ValueError as error:
            raise NewtonFailed(str(error)) from None

    # ------------------------------------------------------------------- the extended equations

    def linearised(self, z: Array) -> Solver:
        """Solver of the equations with the event's condition, linearised about unknowns z."""
        orbit, x, width = self.orbit(z), float(z[-1]), self.family.width
        angle = float(z[-2]) if self.kind == "torus" else None
        count = self.weights[self._of_orbit].size
        equations = self._equations(orbit, x)
        tangent, row = self._tangent(equations, orbit)
        newton = equations(row, 0.0, 1.0)
        by_x = SHORT * width
        try:
            moved = self._equations(self._shifted(orbit, 0.0 * tangent, by_x), x + by_x)
        except ValueError:  # at the end of the parameter's range
            by_x = -by_x
            moved = self._equations(self._shifted(orbit, 0.0 * tangent, by_x), x + by_x)
        with_x = (moved(row, 0.0, 1.0) - newton) / by_x
        measure = self._measure(equations, orbit, row, angle)
        here = measure(equations, orbit)
        directions = [(newton, 0.0), (tangent, 0.0), (with_x, 1.0)]
        slopes = []
        for change, more in directions:
            h = self._difference(orbit) / max(self.length_of_orbit(change), 1e-300)
            h = min(h, 1.0) if more == 0.0 else math.copysign(min(h, abs(by_x)), by_x)
            there = self._shifted(orbit, h * change, h * more)
            after = measure(self._equations(there, x + h * more), there)
            slopes.append((after - here) / h)
        matrix = np.zeros((here.size + 1, here.size + 1))
        matrix[:-1, :2] = np.transpose(slopes[1:])
        if angle is not None:
            turned = self._measure(equations, orbit, row, angle, turn=1j)
            matrix[:-1, 2] = turned(equations, orbit)

        def solved(row: Array, gap: float, share: float) -> Array:
            of_orbit, more = row[:count], row[count:]
            system = matrix.copy()
            system[-1, :2] = of_orbit @ tangent, of_orbit @ with_x + more[-1]
            if angle is not None:
                system[-1, 2] = more[0]
            right = np.append(-share * (here + slopes[0]), gap - share * (of_orbit @ newton))
            sizes = np.abs(system).max(axis=1)
            if not np.isfinite(system).all() or not sizes.all():
                raise NewtonFailed("the event's condition has no derivative")
            factorised()
            along, by, *angles = np.linalg.solve(system / sizes[:, None], right / sizes)
            return np.concatenate([share * newton + along * tangent + by * with_x, angles, [by]])

        return solved

    def opens(self, z: Array) -> int:
        """Side of a fold on which its cycles exist.

        It is 1 where they exist at speeds (or frequencies) above the fold's and -1 where below.
        """
        orbit, x = self.orbit(z), float(z[-1])
        equations = self._equations(orbit, x)
        tangent, row = self._tangent(equations, orbit)
        h = self._difference(orbit)
        there = self._equations(self._shifted(orbit, h * tangent, 0.0), x)
        # The slope of the speed is 0 at the fold, and has the sign of its change beyond.
        change = there(row, 1.0, 0.0)[-1] - tangent[-1]
        return 1 if change > 0.0 else -1

    def _tangent(self, equations: Linearised, orbit: PeriodicOrbit) -> tuple[Array, Array]:
        """Unit tangent of the branch at a fixed second parameter, and its row of inner products."""
        weights = self.weights[self._of_orbit]
        # The tangent is not orthogonal to this: a branch changes in size, in frequency or in speed.
        generic = orbit.packed() / self._size(orbit)
        generic[-2:] = 0.3 * orbit.packed()[-2], 0.2 * orbit.packed()[-1]
        tangent = equations(weights * generic, self.length_of_orbit(generic), 0.0)
        tangent /= self.length_of_orbit(tangent)
        return tangent, weights * tangent

    def length_of_orbit(self, change: Array) -> float:
        """Length of a change of the orbit, without the other unknowns."""
        return math.sqrt(float((self.weights[self._of_orbit] * change) @ change))

    def _swing(self, orbit: PeriodicOrbit) -> tuple[Array, Array]:
        """The mean state of an orbit and its deviation from it, each with the orbit's unknowns.

        The mean is 0 if the orbit is its own mirror image.
        """
        mean, swing = np.zeros((2, self.weights[self._of_orbit].size))
        states = orbit.starts.size
        if not orbit.symmetric:
            share = np.diff(orbit.edges) / orbit.span
            mean[:states] = np.tile(share @ orbit.starts, len(orbit.starts))
        swing[:states] = orbit.starts.ravel() - mean[:states]
        return mean, swing

    def _size(self, orbit: PeriodicOrbit) -> float:
        """Length of an orbit's deviation from its mean, which falls to 0 with its amplitude."""
        return max(self.length_of_orbit(self._swing(orbit)[1]), 1e-300)

    def _difference(self, orbit: PeriodicOrbit) -> float:
        """Length of the change of an orbit over which the condition is differentiated."""
        size, more = self._size(orbit), 1.0
        if self.kind == "fold":
            more = min(max((SMALL_CYCLE / size) ** 2, 1.0), LONG / SHORT)
        return SHORT * more * size

    def _shifted(self, orbit: PeriodicOrbit, change: Array, more: float) -> PeriodicOrbit:
        """The orbit after a change of its unknowns and, by `more`, of the second parameter."""
        moved = orbit.unpacked(orbit.packed() + change)
        return replace(moved, u=orbit.u + more) if self.family.is_speed else moved

    def _equations(self, orbit: PeriodicOrbit, x: float) -> Linearised:
        """The collocation equations, linearised about an orbit, at a second parameter x."""
        phase = (self._phase[0], orbit.u) if orbit.forced else self._phase
        motion = self.family.at(x)
        return Linearised(motion, orbit, phase, not motion.forced)

    def _measure(
        self,
        equations: Linearised,
        orbit: PeriodicOrbit,
        row: Array,
        angle: float | None,
        turn: complex = 1.0,
    ) -> Callable[[Linearised, PeriodicOrbit], Array]:
        """The event's condition as a function of equations and an orbit near this one.

        It vanishes at the event and has the shape (1,), or (2,) for a torus. `turn` = 1j gives its
        derivative by the angle of a torus.
        """
        if self.kind == "fold":
            scale, size = float(orbit.packed()[-1]), float(np.sum(orbit.rates**2))

            def slope(near: Linearised, other: PeriodicOrbit) -> Array:
                # Towards a Hopf point the slope falls to 0 with the amplitude: divided by the
                # amplitude it is 0 at folds alone.
                small = float(np.sum(other.rates * orbit.rates)) / size
                return np.array([near(row, 1.0, 0.0)[-1] / (scale * small)])

            return slope
        factor = -1.0 if angle is None else complex(np.exp(1j * angle))
        first, last = equations.closing
        factorised()
        left, _, right = np.linalg.svd(first + orbit.mirror * factor * last)
        w, v = left[:, -1].conj(), right[-1].conj()

        def singular(near: Linearised, other: PeriodicOrbit) -> Array:
            first, last = near.closing
            if turn != 1.0:
                first = 0.0 * first
            value = w @ (first + turn * other.mirror * factor * last) @ v
            return np.array([value.real] if angle is None else [value.real, value.imag])

        return singular


def event_angle(roots: Complex) -> float:
    """Angle of the pair of multipliers' roots that is nearest to the unit circle, in (0, pi)."""
    pairs = roots[roots.imag > 1e-3 * np.abs(roots)]
    if pairs.size == 0:
        raise NewtonFailed("no pair of multipliers lies near the unit circle")
    return float(np.angle(pairs[np.argmin(np.abs(np.log(np.abs(pairs))))]))
