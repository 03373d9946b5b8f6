# SPDX-License-Identifier: MIT
"""Equations of points in a plane of two numbers at which an eigenvalue lies on the axis.

P(lambda; x, y) = K + lambda C + lambda^2 M is the pencil of small motions, x and y are two numbers
of the pipe. With two real borders b and c, P(i omega; x, y) v + b g = 0 and c^T v = 1 define one
number g, which vanishes where P is singular and nowhere else nearby. The derivative of g by any
number p of the matrices is exactly

    g_p = -w^T P_p v,      w^T P + h c^T = 0,  w^T b = 1.

Flutter is Re g = Im g / omega = 0: without hysteresis Re g is even in omega and Im g odd,
so that these equations stay smooth where the frequency falls to 0 (Bogdanov-Takens). Divergence is
g = 0 at omega = 0. The borders are the real parts of v and w at an earlier point of the curve.

If a load bends the pipe, its coordinates q at rest are unknowns, too, and its equilibrium adds as
many equations. Curves then stay smooth where the rest turns back in a fold, a divergence.

Source: Govaerts (2000), Numerical methods for bifurcations of dynamical equilibria, ch. 3 and 4.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import Control, DenseProblem, Point
from pipedyn.linear.plane import Matrices, Plane
from pipedyn.linear.sensitivity import CrossingKind
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotResolved
from pipedyn.util.newton import NewtonFailed

LEAST = 1e-5
"""Share of the unit of frequency below which Im g / omega is replaced by its limit at omega = 0,
as the two differ by the square of the share. Derivatives are then taken at this share."""

LEAST_SQUARE = 1e-6
"""Square of a double root below which the equations are evaluated at this value and extrapolated
linearly from there: the equations divide by the root, which falls to 0."""

NEWTON_LIMIT = 20.0
"""Largest unknown that Newton's method may reach: share of the window, or units of frequency."""

LONGEST_NULL_VECTOR = 3.0
"""Length of v or w beyond which borders are renewed. The length is 1 over the cosine of the angle
to the border; next to a curve a renewed real border makes it the square root of 2 at most."""

Borders = tuple[Array, Array]
"""The left border b and the right border c, real vectors of unit length, shape (n,) each."""


class AxisProblem(DenseProblem):
    """Equations of points (x, y) at which an eigenvalue lies on the imaginary axis.

    The unknowns are (*q, [omega,] y), with the coordinates q of a bent pipe at rest, and the
    continuation parameter is x; omega is in units of frequency, x and y are shares of the window.

    Args:
        plane: gives the matrices at each point of the window.
        control: how steps along a curve are taken.
        unit: unit of frequency; it has no effect if no frequency is among the unknowns.
    """

    kind: CrossingKind = "flutter"
    unknowns = 2

    def __init__(self, plane: Plane, control: Control, unit: float = 1.0) -> None:
        # Lengths are measured in the window scaled to a unit square; a unit of frequency, or 1 rad
        # of all coordinates at rest, is as long as a side of the square.
        super().__init__(self._equations, self.unknowns, math.sqrt(self.unknowns), control)
        rest = np.full(plane.rest_size, 1.0 / (self.unknowns * max(plane.rest_size, 1)))
        self.weights = np.append(rest, self.weights)
        self.plane, self.unit = plane, unit
        self._borders: Borders | None = None

    def place(self, z: Array) -> Array:
        """Values (x, y) of the two numbers at unknowns z."""
        return self.plane.window.place(z[[-1, -2]])

    def with_rest(self, z: Array) -> Array:
        """Values (x, y, *q) at unknowns z, with the coordinates of a bent pipe at rest."""
        return np.append(self.place(z), z[: self.plane.rest_size])

    def frequency(self, z: Array) -> float:
        """Angular frequency of the pair on the axis, in 1 / T; 0 at a divergence."""
        return float(z[-3] * self.unit) if self.kind == "flutter" else 0.0

    def check(self, z: Array) -> None:
        """Raises NewtonFailed if z is far from the window, or the plane has no matrices there."""
        if not (np.abs(z) < NEWTON_LIMIT).all():
            raise NewtonFailed("Newton's method left the window")
        if not self.plane.defined(self.place(z)):
            raise NewtonFailed("a number left its range")

    def on_other(self, plane: Plane) -> AxisProblem:
        """Equations of the same kind with the matrices of another plane, as for a larger basis."""
        return type(self)(plane, self.control, self.unit)

    def _equations(self, x: Array, p: float) -> tuple[Array, Array]:
        """Residuals, those of the rest first, with their derivatives by all unknowns and x."""
        z, rest = np.append(x, p), self.plane.rest_size
        try:
            directions, matrices, changes, balance, by = self.plane.varied(self.with_rest(z))
        except (ValueError, NotResolved) as error:  # the pipe is bent too sharply
            raise NewtonFailed(f"there is no such rest: {error}") from error
        residual, derivative = self._conditions(z, matrices, changes)
        own = derivative.shape[1] - len(changes)
        rows = derivative[:, own:] @ directions
        rows = np.hstack([rows[:, :rest], derivative[:, :own], rows[:, rest:]])
        resting = np.hstack([by[:, :rest], np.zeros((rest, own)), by[:, rest:]])
        return np.append(balance, residual), np.vstack([resting, rows])

    def _conditions(
        self, z: Array, matrices: Matrices, changes: list[Matrices]
    ) -> tuple[Array, Array]:
        """Residuals of the eigenvalue, with derivatives by omega, if any, and in directions.

        The changes are derivatives of the matrices in these directions.
        """
        raise NotImplementedError

    def change(self, point: Point) -> int:
        """Number of unstable roots on the left of the curve minus the number on its right."""
        z, omega = point.z, self.frequency(point.z)
        right, up = point.tangent[[-1, -2]]
        if self.plane.across is False and not omega and self.kind == "divergence":
            return 1 if self.plane.turns_back(self.with_rest(z)) @ [-up, right] > 0.0 else -1
        (mass, damping, stiffness), *by = self.plane.matrices(self.with_rest(z))
        whole = stiffness + 1j * omega * damping - omega**2 * mass
        _, v, w, _ = self._null_vectors(whole if omega else stiffness.real)

        slope_x, slope_y = self.plane.window.size * self._slopes(omega, v, w, by)
        leftwards = right * slope_y - up * slope_x
        down = complex(w @ (damping @ v) + 2j * omega * (w @ (mass @ v)))
        sizes = float(np.linalg.norm(w) * np.linalg.norm(damping) * np.linalg.norm(v))
        if not omega and abs(down) <= 1e-9 * sizes:
            # Zero is a double root. Then lambda^2 passes 0 instead of lambda, and half of the
            # second derivative of g by lambda replaces the first derivative.
            down = complex(w @ (mass @ v)) + gyroscopic_mass(stiffness.real, damping, v, w)
        return (2 if self.kind == "flutter" else 1) * (1 if (leftwards / down).real > 0.0 else -1)

    def _slopes(
        self, omega: float, v: NDArray[Any], w: NDArray[Any], changes: list[Matrices]
    ) -> Complex:
        """Derivatives of g in some directions, from those of the matrices."""
        return np.array(
            [-(w @ (k @ v + 1j * omega * (c @ v) - omega**2 * (m @ v))) for m, c, k in changes],
            dtype=np.complex128,
        )

    def starting_at(self, z: Array) -> Point:
        """The solution z as a point of the curve; its unit tangent may point either way."""
        _, derivative = self._equations(z[:-1], float(z[-1]))
        tangent = np.linalg.svd(derivative)[2][-1]
        return Point(z, tangent / self.length(tangent))

    def renew(self) -> None:
        """Forgets the borders, as is needed before a point far from the last one is solved for."""
        self._borders = None

    def _null_vectors(
        self, matrix: NDArray[Any]
    ) -> tuple[complex, NDArray[Any], NDArray[Any], NDArray[Any]]:
        """The number g, the vectors v and w, shape (n,), and the bordered matrix (n + 1, n + 1).

        Borders that have become too oblique for the matrix, (n, n), are renewed for the next call.
        """
        n = len(matrix)
        if not np.isfinite(matrix).all():
            raise ValueError("matrices are not finite")
        count_factorisations()
        if self._borders is None:
            left, _, right = np.linalg.svd(matrix)
            self._borders = self._between(left[:, -1], right[-1])
        whole = _bordered(matrix, *self._borders)
        last = np.zeros((1, n + 1, 1))  # numpy 1 takes one axis less for a stack of vectors
        last[0, n] = 1.0
        v, w = np.linalg.solve(np.stack([whole, whole.T]), last)[..., 0]
        if max(np.linalg.norm(v[:n]), np.linalg.norm(w[:n])) > LONGEST_NULL_VECTOR:
            self._borders = self._between(w[:n], v[:n])
        return v[n], v[:n], w[:n], whole

    def _between(self, left: NDArray[Any], right: NDArray[Any]) -> Borders:
        """Borders near the left and the right null vector of a matrix, shape (n,) each."""
        return _largest_real(left), _largest_real(right)


def gyroscopic_mass(stiffness: Array, damping: Array, v: NDArray[Any], w: NDArray[Any]) -> float:
    """Mass that gyroscopic forces add to the mass w @ M @ v of a mode that has no stiffness.

    v and w, shape (n,), are the right and left null vectors of the stiffness, shape (n, n).
    """
    bordered = _bordered(stiffness, w, v)
    turned = np.linalg.solve(bordered, np.append(-(damping @ v), 0.0))[:-1]
    turned_left = np.linalg.solve(bordered.T, np.append(-(w @ damping), 0.0))[:-1]
    return 0.5 * float(turned_left @ damping @ v + w @ damping @ turned)


def _bordered(matrix: NDArray[Any], left: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """A matrix, (n, n), with the column `left`, the row `right` and 0 added, (n + 1, n + 1)."""
    n = len(matrix)
    whole = np.zeros((n + 1, n + 1), dtype=matrix.dtype)
    whole[:n, :n], whole[:n, n], whole[n, :n] = matrix, left, right
    return whole


def _largest_real(v: NDArray[Any]) -> Array:
    """The real part of a vector at the phase at which it is longest, scaled to unit length."""
    if np.iscomplexobj(v):
        v = (v * np.exp(-0.5j * np.angle(np.sum(v * v)))).real
    unit: Array = v / np.linalg.norm(v)
    return unit


class FlutterProblem(AxisProblem):
    """Equations of flutter, a pair on the axis: z = (omega / unit, y, x), shares of the window."""

    def _conditions(
        self, z: Array, matrices: Matrices, changes: list[Matrices]
    ) -> tuple[Array, Array]:
        share = max(float(z[-3]), LEAST)
        omega = self.unit * share
        m, c, k = matrices
        g, v, w, _ = self._null_vectors(k + 1j * omega * c - omega**2 * m)
        by_frequency = -self.unit * complex(w @ (1j * (c @ v) - 2.0 * omega * (m @ v)))
        slopes = np.append(by_frequency, self._slopes(omega, v, w, changes))
        derivative = np.stack([slopes.real, slopes.imag / share])
        derivative[1, 0] -= g.imag / share**2
        if z[-3] >= LEAST:
            return np.array([g.real, g.imag / share]), derivative
        g, v, w, _ = self._null_vectors(k.real)
        return np.array([g.real, -self.unit * float((w @ (c @ v)).real)]), derivative


class DivergenceProblem(AxisProblem):
    """Equations of divergence, a real eigenvalue 0: z = (y, x) as shares of the window."""

    kind: CrossingKind = "divergence"
    unknowns = 1

    def _conditions(
        self, z: Array, matrices: Matrices, changes: list[Matrices]
    ) -> tuple[Array, Array]:
        g, v, w, _ = self._null_vectors(matrices[2].real)
        return np.array([g.real]), self._slopes(0.0, v, w, changes).real[None]


class CoupledModeProblem(AxisProblem):
    """Equations of coupled-mode flutter of a conservative pipe, where two pairs meet.

    The unknowns are z = (s / unit, y, x), where s = -lambda^2 is a double root. As
    P(lambda)^T = P(-lambda), g is a real function of s if both sides have the same border b, and
    the equations are g = 0 and dg/ds = 0. Where s > 0 the pairs meet on the axis at the frequency
    sqrt(s) and leave it; where s < 0 two growing real roots meet and become a growing pair.
    """

    def frequency(self, z: Array) -> float:
        """Angular frequency of the pairs that meet on the axis; 0 where real roots meet."""
        return math.sqrt(max(float(z[-3]) * self.unit, 0.0))

    def root(self, z: Array) -> complex:
        """The double root above the real axis or, if double roots are real, the growing one."""
        return cmath.sqrt(-float(z[-3]) * self.unit)

    def change(self, point: Point) -> int:
        """Number of unstable roots on the left of the curve minus the number on its right.

        The difference is 0 where real roots meet: as many are unstable before as after they meet.
        """
        if point.z[-3] <= 0.0:
            return 0
        _, derivative = self._equations(point.z[:-1], point.p)
        right, up = point.tangent[[-1, -2]]
        leftwards = right * derivative[0, 1] - up * derivative[0, 2]
        # The two roots s near a double root are real where g and its second derivative by s have
        # opposite signs.
        return 2 if leftwards * derivative[1, 0] > 0.0 else -2

    def _conditions(
        self, z: Array, matrices: Matrices, changes: list[Matrices]
    ) -> tuple[Array, Array]:
        s = self.unit * float(z[-3])
        moved = math.copysign(max(abs(s), LEAST_SQUARE), s)
        root = cmath.sqrt(-moved)
        # P and its derivatives by y and x, and the derivatives of these by lambda.
        each = (matrices, *changes)
        whole, *slopes = (k.real + root * c + root**2 * m for m, c, k in each)
        turned, *mixed = (c + 2.0 * root * m for m, c, _ in each)
        g, v, w, bordered = self._null_vectors(whole if moved > 0.0 else whole.real)
        v_turned = np.linalg.solve(bordered, np.append(-(turned @ v), 0.0))[:-1]
        w_turned = np.linalg.solve(bordered.T, np.append(-(w @ turned), 0.0))[:-1]
        first, second = [], []  # derivatives of g by lambda, y and x, and of these by lambda
        for by, mixed_by in zip([turned, *slopes], [2.0 * matrices[0], *mixed], strict=True):
            first.append(-(w @ by @ v))
            second.append(-(w_turned @ by @ v + w @ mixed_by @ v + w @ by @ v_turned))
        # Derivatives by lambda are converted to derivatives by s with ds = -2 lambda dlambda.
        by_s = -0.5 / root
        slope, bend = by_s * first[0], by_s**2 * (second[0] + 2.0 * by_s * first[0])
        off, unit = s - moved, self.unit
        residual = np.array([g + off * slope, unit * (slope + off * bend)])
        derivative = np.array(
            [
                [unit * slope, *first[1:]],
                [unit**2 * bend, *(unit * by_s * one for one in second[1:])],
            ]
        )
        return residual.real, derivative.real

    def _between(self, left: NDArray[Any], right: NDArray[Any]) -> Borders:
        """A border between the directions of both null vectors, which serves on both sides."""
        a, b = super()._between(left, right)
        border = _largest_real(a + (b if a @ b >= 0.0 else -b))
        return border, border
