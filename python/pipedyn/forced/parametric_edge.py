# SPDX-License-Identifier: MIT
"""Edges of parametric regions as roots of a determinant, followed in the amplitude.

H is the matrix of Hill's equations. The function f that vanishes on an edge is the determinant of
G, 2 x 2, with [H, B; C^H, 0] [Q; G] = [0; 1]. In a pipe that is conservative, or has neither
damping nor a Coriolis force, combination regions begin where two multipliers meet; there f is real
and its derivative by nu vanishes too. Between the region's edges f has a saddle, which is regular
however thin the region is: it is followed in place of the edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import scipy

from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem, Point
from pipedyn.forced.pulsating import Hill
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed, newton

RegionKind = Literal["subharmonic", "harmonic", "combination"]
SHARES: dict[RegionKind, float | None] = {"subharmonic": 0.5, "harmonic": 0.0, "combination": None}
"""Ratio nu / w of the motions on the edges of each kind of region; None where it varies."""

CONTROL = Control(longest=0.15, shortest=1e-9, tolerance=1e-11, stagnation=1e-8, turn=0.5)
"""Control of steps along an edge, relative to its frequency and the largest amplitude."""

STARTING = replace(CONTROL, iterations=40)
"""Control of Newton's method at the start of an edge. It takes more iterations than along the edge,
since beside a thin region each of them only halves the distance."""

BORDERINGS = 3
"""Number of bordered equations whose null vectors lead from any borders to good ones: each is a
step of inverse iteration."""

OUTWARD = 3e-4
"""Share of its frequency by which the start of an edge is moved away from the region."""

THINNEST = 1e-6
"""Width of a region, relative to its frequency, below which the region is left out."""


class Bordered:
    """Solutions of [H, B; C^H, 0] [Q; G] = [0; 1] and [H, B; C^H, 0]^H [W; .] = [0; 1].

    Q and W have two columns, and G is 2 x 2.
    """

    def __init__(self, h: Complex, b: Complex, c: Complex) -> None:
        n = len(h)
        count_factorisations()
        whole = np.zeros((n + 2, n + 2), dtype=np.result_type(h, b, c), order="F")
        whole[:n, :n], whole[:n, n:], whole[n:, :n] = h, b, c.conj().T
        self._lu = scipy.linalg.lu_factor(whole, overwrite_a=True, check_finite=False)
        last = np.eye(n + 2, 2, -n)
        q, w = (self._solved(last, trans) for trans in (0, 2))
        self.q, self.g, self.w = q[:n], q[n:], w[:n]

    def _solved(self, right: Array | Complex, trans: int = 0) -> Complex:
        return np.asarray(scipy.linalg.lu_solve(self._lu, right, trans, check_finite=False))

    def by_left(self, h: Complex) -> Complex:
        """Product W^H H' with a derivative h of H, shape (2, n); that of G is -W^H H' Q."""
        return np.asarray(self.w.conj().T @ h)

    def changes(self, by: list[Complex]) -> list[Complex]:
        """Derivatives of -Q, each (n, 2), where H has the derivatives `by`."""
        right = np.hstack([h @ self.q for h in by])
        return np.hsplit(self._solved(np.pad(right, ((0, 2), (0, 0))))[:-2], len(by))


def det_derivative(a: Complex, b: Complex) -> complex:
    """Derivative of det a, 2 x 2, in the direction b, which is twice det a where b is a."""
    return complex(a[0, 0] * b[1, 1] + a[1, 1] * b[0, 0] - a[0, 1] * b[1, 0] - a[1, 0] * b[0, 1])


class Edge(DenseProblem):
    """Equations of an edge of a region.

    The unknowns z are w / scale, on combination edges also nu / scale, and the amplitude. On the
    edge H is singular and f = det G vanishes. B and C have two columns, as two motions come close
    to solutions where a region is thin or two regions cross.

    Args:
        hill: Hill's equations of the pipe.
        kind: kind of the region.
        scale: unit of frequency.
        largest: unit of amplitude in the length of a step along the edge.
        centre: whether to follow the point between both edges, at which f does not change with w
            (and nu), in place of an edge. It is a saddle of f in combination regions of multipliers
            that meet on the unit circle.
    """

    def __init__(
        self, hill: Hill, kind: RegionKind, scale: float, largest: float, centre: bool = False
    ) -> None:
        self.hill, self.kind, self.scale = hill, kind, scale
        share = SHARES[kind]
        super().__init__(self._equations, 2 if share is None else 1, largest, CONTROL)
        self.share, self.centre, self.largest = share, centre, largest
        self._of = hill.polynomial(share)
        self._border: tuple[Complex, Complex] | None = None
        self._last: BranchStep[Edge] | None = None
        self.meeting = share is None and (hill.is_hermitian or hill.is_real)

    def _numbers(self, z: Array) -> list[float]:
        """Arguments of the polynomial H: frequency, nu if it is unknown, and amplitude."""
        return [*(self.scale * z[:-1]).tolist(), float(z[-1])]

    def _bordered(self, z: Array) -> Bordered:
        """The bordered equations at unknowns z."""
        h = self._of(*self._numbers(z))
        if self._border is None:
            any_two = np.linalg.qr(np.cos(np.outer(np.arange(len(h)), [1.0, 2.0])))[0]
            self._border = any_two, any_two
            for _ in range(BORDERINGS):
                self._renew(Bordered(h, *self._border))
        return Bordered(h, *self._border)

    def derivatives(self, z: Array, *rows: int) -> tuple[complex, Complex, Complex]:
        """The function f with its first and second derivatives by the n + 1 unknowns.

        First derivatives have the shape (n + 1,). Second derivatives are those by each unknown in
        `rows` and by each of all, shape (len(rows), n + 1).
        """
        at, numbers = self._bordered(z), self._numbers(z)
        by = [self._of.by((i,), *numbers) for i in range(z.size)]
        left, right = [at.by_left(h) for h in by], at.changes(by) if rows else []
        g = [-part @ at.q for part in left]
        first = np.array([det_derivative(at.g, one) for one in g])
        second = np.zeros((z.size, z.size), dtype=np.complex128)
        for i, j in {(min(i, j), max(i, j)) for i in rows for j in range(z.size)}:
            bend = at.by_left(self._of.by((i, j), *numbers)) @ at.q
            both = left[i] @ right[j] + left[j] @ right[i] - bend
            second[i, j] = second[j, i] = det_derivative(g[i], g[j]) + det_derivative(at.g, both)
        units = np.append(np.full(z.size - 1, self.scale), 1.0)  # of the numbers in the unknowns
        second = (units[:, None] * second * units)[list(rows)]
        return 0.5 * det_derivative(at.g, at.g), units * first, second

    def _equations(self, x: Array, p: float) -> tuple[Array, Array]:
        """Functions that vanish on the edge, shape (n,), and their derivatives, (n, n + 1)."""
        z = np.append(x, p)
        count = z.size - 1
        if self.centre:
            _, by, second = self.derivatives(z, *range(count))
            return by[:count].real, second.real
        if self.meeting:
            f, by, second = self.derivatives(z, 1)
            return np.array([f.real, by[1].real]), np.stack([by.real, second[0].real])
        f, by, _ = self.derivatives(z)
        return np.array([f.real, f.imag])[:count], np.stack([by.real, by.imag])[:count]

    def renew(self, z: Array) -> None:
        """Makes borders of the null vectors at z, for the steps from there."""
        self._renew(self._bordered(z))

    def _renew(self, at: Bordered) -> None:
        b, c = np.linalg.qr(at.w)[0], np.linalg.qr(at.q)[0]
        self._border = (c if self.hill.is_hermitian and self.meeting else b), c

    def ends(self, z: Array) -> list[Array]:
        """Approximate unknowns of both edges about a centre z; none if the region is too thin."""
        f, _, second = self.derivatives(z, 0, 1)
        (ww, wn, _), (_, nn, _) = second.real.tolist()
        square = -2.0 * f.real / (ww - wn**2 / nn)
        if not square > (0.4 * THINNEST * z[0]) ** 2:
            return []
        half = math.sqrt(square)
        return [z + np.array([way, -way * wn / nn, 0.0]) for way in (-half, half)]

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step, which is relative as unknowns are of the order of 1."""
        return self.length(step)

    def check(self, z: Array) -> None:
        """Raises NewtonFailed at unknowns far from the start."""
        if not 0.05 < z[0] < 20.0 or not abs(z[-1]) < 2.0 * self.largest:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")

    def unknowns(self, frequency: float, nu: float, amplitude: float) -> Array:
        """Unknowns z at a frequency w, nu and amplitude."""
        z = np.array([frequency / self.scale, nu / self.scale, amplitude])
        return z if self.share is None else z[[0, 2]]

    def place(self, z: Array) -> Array:
        """Amplitude, w and nu at unknowns z, shape (3,)."""
        nu = float(z[1]) if self.share is None else self.share * float(z[0])
        return np.array([z[-1], self.scale * z[0], self.scale * nu])

    def started(self, frequency: float, nu: float, amplitude: float) -> Array:
        """Unknowns of the edge near a frequency and nu, at a given amplitude."""
        self.control = STARTING
        try:
            z = self.fixed(self.unknowns(frequency, nu, amplitude), amplitude)
            self.renew(z)
            return self.fixed(z, amplitude)
        finally:
            self.control = CONTROL

    def is_on_axis(self, z: Array) -> bool:
        """Whether a multiplier and its conjugate meet at 1 or -1, on a combination edge."""
        return self.share is None and not 1e-5 < z[1] / z[0] < 0.5 - 1e-5

    def bottom(self, z: Array) -> Array:
        """Amplitude, w and nu where the amplitude is least: there the region's two edges meet.

        At this point f does not change to first order with w, and with nu where it is unknown and f
        is real. Where f is complex, its derivatives by w and nu have the same phase.
        """

        def correction(here: Array) -> tuple[Array, float]:
            f, by, second = self.derivatives(here, *range(z.size - 1))
            if self.share is None and not self.meeting:
                values = [f.real, f.imag, (by[0].conj() * by[1]).imag]
                turn = (second[0].conj() * by[1] + by[0].conj() * second[1]).imag
                changes = np.stack([by.real, by.imag, turn])
            else:
                values = [f.real, *by[:-1].real]
                changes = np.vstack([by.real, second.real])
            step = np.linalg.solve(changes, -np.array(values))
            return step, self.relative(here, step)

        self.renew(z)
        found = newton(z, correction, tolerance=1e-11, stagnation=1e-8, check=self.check)
        return self.place(found)

    def next(
        self, start: Point, step: float, ahead: Callable[[float], Array] | None = None
    ) -> tuple[BranchStep[Edge], float]:
        """The step to the next point with borders of its own, and the length to try after it.

        Newton's method begins on the cubic through the step before, if that led to `start`.
        """
        self.renew(start.z)
        ahead = self._last.ahead if self._last and self._last.end is start else ahead
        # Below amplitude 0 the edge goes on as its own mirror image: no step may lead there.
        most = max(0.4 * start.p / self.largest, 1e-9)
        self._last, following = super().next(start, min(step, most), ahead)
        return self._last, following
