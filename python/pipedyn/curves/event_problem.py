# SPDX-License-Identifier: MIT
"""Equations of a periodic orbit at an event, for continuation in two parameters.

The collocation equations G(z) = 0 of an orbit z = (states, rates, omega, u) have one equation less
than unknowns: their solutions form a branch, with the unit tangent t. A second parameter x adds an
unknown, and the event adds a condition:

    fold              the component of t along u is 0;
    root rho          the smallest singular value of A = L + rho R is 0, where L y(0) + R y(span) =
                      0 holds for solutions y of the linearised equations: after the span a
                      perturbation is multiplied by rho;
    torus             the condition of a root rho = e^(i theta) with theta unknown, which is two
                      real equations.

Each is a minimally extended system (Govaerts 2000, Numerical methods for bifurcations of dynamical
equilibria, sec. 4 and 7; for cycles Doedel, Govaerts and Kuznetsov 2003): with the left and right
singular vectors w and v of A near a point, w* A v is the scalar that the bordered system defines,
and w* dA v is its derivative. The vectors t, v and w follow from the linear equations that Newton's
method for the orbit solves anyway. Every change of the orbit is a combination of the solutions of
[G_z; <t, .>] for the right-hand sides -G, t and -G_x: the condition is differentiated along these
only, by differences of the condition itself. No second derivatives of the forces are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Self

import numpy as np

from pipedyn.continuation.arclength import Control, Solver
from pipedyn.curves.event_plane import EVENTS, EventPlane, Followed
from pipedyn.orbits.collocation import Linearised, OrbitProblem
from pipedyn.orbits.periodic_orbit import PeriodicOrbit
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed

SHORT = {kind: 1e-4 if kind == "fold" else 1e-6 for kind in EVENTS}
"""Step of differences of conditions by the kind of the event, relative to the orbit's size or the
parameter's range. Each step of Newton's method is shorter than the last by about this factor.
Conditions have an error of some 1e-12. That of a fold, the slope of the speed along the branch,
hardly changes near a Bautin point: there shorter steps leave tangents wrong by tens of percent. The
multipliers at other events change too much for steps as long."""


class EventProblem(OrbitProblem):
    """Equations of a periodic orbit at an event.

    The unknowns are z = (orbit, theta, x), where x is the second parameter and theta, the angle of
    the multipliers' roots, is an unknown of a torus only.

    Args:
        plane: the plane of the branch parameter and x.
        kind: kind of the event.
        start: an orbit near the event.
        extra: values at the start of the unknowns other than the orbit: x, or theta and x.
        control: how steps along the curve are taken.
        unit: root mean square of the positions for each L of the free end's amplitude, as in
            `OrbitProblem`; by default its value at the start.
    """

    def __init__(
        self,
        plane: EventPlane,
        kind: Followed,
        start: PeriodicOrbit,
        extra: Array,
        control: Control,
        unit: float | None = None,
    ) -> None:
        try:
            motion = plane.at(float(extra[-1]))
        except ValueError as error:
            raise NewtonFailed(str(error)) from None
        super().__init__(motion, start, control, unit)
        self.plane, self.kind, self.extra = plane, kind, extra
        self._of_orbit = slice(self.weights.size)
        if plane.is_speed:  # x replaces the orbit's own speed, which has no length of its own
            self.weights[-2] = 0.0
        ends = [plane.width**-2] if extra.size == 1 else [1.0, plane.width**-2]
        self.weights = np.append(self.weights, ends)

    @property
    def origin(self) -> Array:
        """Unknowns z at the start."""
        return np.append(self.start.packed(), self.extra)

    def about(self, z: Array, edges: Array | None = None) -> Self:
        """Equations of the same event that start at z, on another mesh if its edges are given."""
        extra = z[self.weights.size - self.extra.size :]
        orbit = self.remeshed(z, edges)
        return type(self)(self.plane, self.kind, orbit, extra, self.control, self.unit)

    def orbit(self, z: Array) -> PeriodicOrbit:
        """The orbit at unknowns z."""
        orbit = self.start.unpacked(z[self._of_orbit])
        return replace(orbit, u=float(z[-1])) if self.plane.is_speed else orbit

    def relative(self, z: Array, step: Array) -> float:
        """Largest size of a step's parts relative to the orbit, 1 rad or the parameter's range."""
        rest = step[self.weights.size - self.extra.size :].copy()
        rest[-1] /= self.plane.width
        of_orbit = super().relative(z, step[self._of_orbit])
        return max(of_orbit, float(np.abs(rest).max()))

    def check(self, z: Array) -> None:
        """Raises NewtonFailed if z is no orbit near the start, or has no equations of motion."""
        super().check(z)
        try:
            self.plane.at(float(z[-1]))
        except ValueError as error:
            raise NewtonFailed(str(error)) from None

    # ------------------------------------------------------------------- the extended equations

    def linearised(self, z: Array) -> Solver:
        """Solver of the equations with the event's condition, linearised about unknowns z."""
        orbit, x, width = self.orbit(z), float(z[-1]), self.plane.width
        angle = float(z[-2]) if self.kind == "torus" else None
        count = self.weights[self._of_orbit].size
        equations = self._equations(orbit, x)
        tangent, row = self._tangent(equations, orbit)
        newton = equations(row, 0.0, 1.0)
        by_x = SHORT[self.kind] * width
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
            h = SHORT[self.kind] * self._size(orbit) / max(self.length_of_orbit(change), 1e-300)
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
            count_factorisations()
            along, by, *angles = np.linalg.solve(system / sizes[:, None], right / sizes)
            return np.concatenate([share * newton + along * tangent + by * with_x, angles, [by]])

        return solved

    def opens(self, z: Array) -> int:
        """Side of a fold on which its cycles exist.

        It is 1 if they exist at speeds (or frequencies) above the fold and -1 if below.
        """
        orbit, x = self.orbit(z), float(z[-1])
        equations = self._equations(orbit, x)
        tangent, row = self._tangent(equations, orbit)
        h = SHORT["fold"] * self._size(orbit)
        there = self._equations(self._shifted(orbit, h * tangent, 0.0), x)
        # The slope of the speed along the branch is 0 at the fold; its change beyond the fold has
        # the sign that is looked for.
        change = there(row, 1.0, 0.0)[-1] - tangent[-1]
        return 1 if change > 0.0 else -1

    def _tangent(self, equations: Linearised, orbit: PeriodicOrbit) -> tuple[Array, Array]:
        """Unit tangent of the branch at a fixed second parameter, and its row of inner products."""
        weights = self.weights[self._of_orbit]
        # The tangent is not orthogonal to this direction, as size, frequency or speed change along
        # a branch.
        generic = orbit.packed() / self._size(orbit)
        generic[-2:] = 0.3 * orbit.packed()[-2], 0.2 * orbit.packed()[-1]
        tangent = equations(weights * generic, self.length_of_orbit(generic), 0.0)
        tangent /= self.length_of_orbit(tangent)
        return tangent, weights * tangent

    def length_of_orbit(self, change: Array) -> float:
        """Length of a change of the orbit's unknowns."""
        return math.sqrt(float((self.weights[self._of_orbit] * change) @ change))

    def _size(self, orbit: PeriodicOrbit) -> float:
        """Length of an orbit's deviation from its mean, which falls to 0 with its amplitude.

        The mean is 0 if the orbit is its own mirror image.
        """
        swing = np.zeros(self.weights[self._of_orbit].size)
        mean = 0.0 if orbit.symmetric else np.diff(orbit.edges) / orbit.span @ orbit.starts
        swing[: orbit.starts.size] = (orbit.starts - mean).ravel()
        return max(self.length_of_orbit(swing), 1e-300)

    def _shifted(self, orbit: PeriodicOrbit, change: Array, more: float) -> PeriodicOrbit:
        """The orbit after a change of its unknowns and, by `more`, of the second parameter."""
        moved = orbit.unpacked(orbit.packed() + change)
        return replace(moved, u=orbit.u + more) if self.plane.is_speed else moved

    def _equations(self, orbit: PeriodicOrbit, x: float) -> Linearised:
        """The collocation equations, linearised about an orbit, at a second parameter x."""
        phase = (self._phase[0], orbit.u) if orbit.forced else self._phase
        motion = self.plane.at(x)
        return Linearised(motion, orbit, phase, not motion.forced)

    def _measure(
        self,
        equations: Linearised,
        orbit: PeriodicOrbit,
        row: Array,
        angle: float | None,
        turn: complex = 1.0,
    ) -> Callable[[Linearised, PeriodicOrbit], Array]:
        """The event's condition as a function of equations and of an orbit near the given one.

        The function is 0 at the event and has the shape (1,), or (2,) for a torus. With `turn` = 1j
        it is the derivative of the condition by the angle of a torus.
        """
        if self.kind == "fold":
            scale, size = float(orbit.packed()[-1]), float(np.sum(orbit.rates**2))

            def slope(near: Linearised, other: PeriodicOrbit) -> Array:
                # Towards a Hopf point the slope falls to 0 with the amplitude: the quotient of both
                # is 0 at folds only.
                small = float(np.sum(other.rates * orbit.rates)) / size
                return np.array([near(row, 1.0, 0.0)[-1] / (scale * small)])

            return slope
        factor = -1.0 if angle is None else complex(np.exp(1j * angle))
        first, last = equations.closing
        count_factorisations()
        left, _, right = np.linalg.svd(first + orbit.mirror_sign * factor * last)
        w, v = left[:, -1].conj(), right[-1].conj()

        def singular(near: Linearised, other: PeriodicOrbit) -> Array:
            first, last = near.closing
            if turn != 1.0:
                first = 0.0 * first
            value = w @ (first + turn * other.mirror_sign * factor * last) @ v
            return np.array([value.real] if angle is None else [value.real, value.imag])

        return singular


def event_angle(roots: Complex) -> float:
    """Angle, in (0, pi), of the pair of multipliers' roots nearest to the unit circle."""
    pairs = roots[roots.imag > 1e-3 * np.abs(roots)]
    if pairs.size == 0:
        raise NewtonFailed("no pair of multipliers lies near the unit circle")
    return float(np.angle(pairs[np.argmin(np.abs(np.log(np.abs(pairs))))]))
