# SPDX-License-Identifier: MIT
"""Edges of parametric regions as roots of a determinant, followed in the amplitude.

The function f that is followed is the determinant of G, 2 x 2, with [H, B; C^H, 0] [Q; G] = [0; 1].
Of a pipe that is conservative, or has neither damping nor a Coriolis force, combination regions
begin where two multipliers meet; there f is real and its derivative by nu vanishes too. Between its
edges f has a saddle, which is regular however thin the region is: it is followed in their place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pipedyn.continuation.arclength import (
    Continuation,
    Control,
    Point,
    Segment,
    Solver,
)
from pipedyn.forced.pulsating import Hill
from pipedyn.linear.eigenproblem import Complex
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed, newton

RegionKind = Literal["subharmonic", "harmonic", "combination"]
SHARES: dict[RegionKind, float | None] = {"subharmonic": 0.5, "harmonic": 0.0, "combination": None}
"""nu / w of the edges' motions."""

CONTROL = Control(longest=0.15, shortest=1e-9, tolerance=1e-11, stagnation=1e-8, turn=0.5)
"""Steps along an edge, in shares of its frequency and of the largest amplitude."""

STARTING = replace(CONTROL, iterations=40)
"""The same where Newton's method halves the distance to a thin region."""

THINNEST = 1e-6
"""Width of a region, relative to its frequency, below which it is left out."""


@dataclass(frozen=True)
class Changed:
    """What a change H' of H does: H' Q, H'^H W and G' = -W^H H' Q."""

    right: Complex
    left: Complex
    g: Complex


class Bordered:
    """[H, B; C^H, 0] [Q; G] = [0; 1] and [H, B; C^H, 0]^H [W; .] = [0; 1] with two columns each."""

    def __init__(self, h: Complex, b: Complex, c: Complex) -> None:
        n = len(h)
        factorised()
        whole = np.zeros((n + 2, n + 2), dtype=np.result_type(h, b, c), order="F")
        whole[:n, :n], whole[:n, n:], whole[n:, :n] = h, b, c.conj().T
        if not np.isfinite(whole).all():
            raise ValueError("Hill's equations are not finite")
        self._lu = scipy.linalg.lu_factor(whole, overwrite_a=True, check_finite=False)
        last = np.eye(n + 2, 2, -n)
        q, w = (self._solved(last, trans) for trans in (0, 2))
        self.q, self.g, self.w = q[:n], q[n:], w[:n]

    def _solved(self, right: Array | Complex, trans: int = 0) -> Complex:
        return np.asarray(scipy.linalg.lu_solve(self._lu, right, trans, check_finite=False))

    def changed(self, h: Complex) -> Changed:
        """By a derivative of H."""
        right = h @ self.q
        return Changed(right, h.conj().T @ self.w, -self.w.conj().T @ right)

    def second(self, one: Changed, other: Changed, h: Complex) -> Complex:
        """Second derivative of G, where H has this one."""
        last = np.zeros((2, 2))
        both = np.concatenate([np.hstack([other.right, one.right]), np.hstack([last, last])])
        solved = self._solved(both)[:-2]
        found = one.left.conj().T @ solved[:, :2] + other.left.conj().T @ solved[:, 2:]
        return np.asarray(found - self.w.conj().T @ (h @ self.q))


def mixed(a: Complex, b: Complex) -> complex:
    """Derivative of det a, 2 x 2, in the direction of b: twice det a if this is a."""
    return complex(a[0, 0] * b[1, 1] + a[1, 1] * b[0, 0] - a[0, 1] * b[1, 0] - a[1, 0] * b[0, 1])


class Edge(Continuation):
    """An edge of a region: unknowns w / scale, of combinations also nu / scale, and the amplitude.

    f = det G vanishes with H, where [H, B; C^H, 0] [Q; G] = [0; 1] with two columns in B and C, as
    two motions come close to solutions where a region is thin or two regions cross.

    Args:
        hill: the equations.
        kind: of the region.
        scale: frequency.
        largest: amplitude, which a step along the edge is measured by.
        centre: whether not an edge but the middle between both is meant, of a combination region
            of multipliers that meet on the circle: there f has a saddle, however thin the region.
    """

    def __init__(
        self, hill: Hill, kind: RegionKind, scale: float, largest: float, centre: bool = False
    ) -> None:
        self.hill, self.kind, self.scale = hill, kind, scale
        share = SHARES[kind]
        size = 2 if share is None else 1
        super().__init__(np.append(np.full(size, 1.0 / size), largest**-2), CONTROL)
        self.share, self.centre = share, centre
        self._of = hill.polynomial(share)
        self.largest = largest
        self._border: tuple[Complex, Complex] | None = None
        self.meeting = share is None and (hill.is_hermitian or hill.is_real)

    def _numbers(self, z: Array) -> list[float]:
        """Of the polynomial: frequency, nu of combinations, amplitude."""
        return [*(self.scale * z[:-1]).tolist(), float(z[-1])]

    def _by(self, z: Array, *which: int) -> Complex:
        """Derivative of H by unknowns."""
        scale = self.scale ** np.count_nonzero(np.array(which) < z.size - 1)
        return np.asarray(scale * self._of.by(which, *self._numbers(z)))

    def _bordered(self, z: Array) -> Bordered:
        """The bordered equations at a point."""
        h = self._of(*self._numbers(z))
        if self._border is None:
            left, _, right = np.linalg.svd(h)
            c = right[-2:].conj().T
            self._border = c if self.hill.is_hermitian and self.meeting else left[:, -2:], c
        return Bordered(h, *self._border)

    def derivatives(self, z: Array, *rows: int) -> tuple[complex, Complex, Complex]:
        """f, its derivatives by unknowns, (n + 1,), and second ones by some and all of them."""
        at = self._bordered(z)
        first = [at.changed(self._by(z, i)) for i in range(z.size)]
        by = np.array([mixed(at.g, one.g) for one in first])
        second = np.empty((len(rows), z.size), dtype=np.complex128)
        for k, i in enumerate(rows):
            for j in range(z.size):
                both = at.second(first[i], first[j], self._by(z, i, j))
                second[k, j] = mixed(first[i].g, first[j].g) + mixed(at.g, both)
        return 0.5 * mixed(at.g, at.g), by, second

    def residual(self, z: Array) -> tuple[Array, Array]:
        """What vanishes on the edge, shape (n,), and its derivative, (n, n + 1)."""
        if self.centre:
            _, by, second = self.derivatives(z, 0, 1)
            return by[:2].real, second.real
        if self.meeting:
            f, by, second = self.derivatives(z, 1)
            return np.array([f.real, by[1].real]), np.stack([by.real, second[0].real])
        f, by, _ = self.derivatives(z)
        count = z.size - 1
        return np.array([f.real, f.imag])[:count], np.stack([by.real, by.imag])[:count]

    def renew(self, z: Array) -> None:
        """Takes the null vectors at an edge for the border of the steps from there."""
        at = self._bordered(z)
        b, c = np.linalg.qr(at.w)[0], np.linalg.qr(at.q)[0]
        self._border = (c if self.hill.is_hermitian and self.meeting else b), c

    def ends(self, z: Array) -> list[Array]:
        """From a centre to about where both edges are; none where a region is too thin."""
        f, _, second = self.derivatives(z, 0, 1)
        (ww, wn, _), (_, nn, _) = second.real.tolist()
        square = -2.0 * f.real / (ww - wn**2 / nn)
        if not square > (0.4 * THINNEST * z[0]) ** 2:
            return []
        half = math.sqrt(square)
        return [z + np.array([way, -way * wn / nn, 0.0]) for way in (-half, half)]

    def linearised(self, z: Array) -> Solver:
        """The equations about unknowns."""
        residual, derivative = self.residual(z)

        def change(row: Array, gap: float, share: float) -> Array:
            return np.asarray(
                np.linalg.solve(np.vstack([derivative, row]), np.append(-share * residual, gap))
            )

        return change

    def relative(self, z: Array, step: Array) -> float:
        """Length of a step: unknowns are of the order of 1."""
        return self.length(step)

    def check(self, z: Array) -> None:
        """Raises NewtonFailed far from the start."""
        if not 0.05 < z[0] < 20.0 or not abs(z[-1]) < 2.0 * self.largest:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")

    def unknowns(self, frequency: float, nu: float, amplitude: float) -> Array:
        """Of the numbers of an edge."""
        z = np.array([frequency / self.scale, nu / self.scale, amplitude])
        return z if self.share is None else z[[0, 2]]

    def place(self, z: Array) -> Array:
        """Amplitude, w and nu of unknowns."""
        nu = float(z[1]) if self.share is None else self.share * float(z[0])
        return np.array([z[-1], self.scale * z[0], self.scale * nu])

    def started(self, frequency: float, nu: float, amplitude: float) -> Array:
        """Unknowns of the edge near a frequency at an amplitude."""
        self.control = STARTING
        try:
            z = self.fixed(self.unknowns(frequency, nu, amplitude), amplitude)
            self.renew(z)
            return self.fixed(z, amplitude)
        finally:
            self.control = CONTROL

    def is_on_axis(self, z: Array) -> bool:
        """Whether of a combination region a multiplier and its conjugate meet, at 1 or -1."""
        return self.share is None and not 1e-5 < z[1] / z[0] < 0.5 - 1e-5

    def near(self, frequency: float, nu: float, amplitude: float, outward: int = 0) -> Array:
        """Unknowns of an edge near a frequency.

        Few modes misplace combination regions. From outside, where f is much like the square of the
        distance from the region, Newton's method gets to the edge on that side, from inside to any.
        """
        for shift in (3e-4, 1e-3, 0.0) if outward else (0.0,):
            self._border = None
            with suppress(NewtonFailed):
                z = self.started(frequency * (1.0 + outward * shift), nu, amplitude)
                moved = np.abs(self.unknowns(frequency, nu, amplitude) - z).max()
                if not self.is_on_axis(z) and moved < (
                    4e-3 if self.share is not None or self.meeting else 2e-2
                ):
                    return z
        raise NewtonFailed("Newton's method left the neighbourhood of its start")

    def bottom(self, z: Array) -> Array:
        """Amplitude, w and nu where the amplitude is least: there the edge's two sides meet.

        That is where f does not change at first order with w, and with nu, or not more than along
        one direction of these.
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

        for _ in range(2):
            self.renew(z)
            z = newton(z, correction, tolerance=1e-11, stagnation=1e-8, check=self.check)
        return self.place(z)

    def steps(self, point: Point) -> Iterator[Segment[Edge]]:
        """Steps along an edge; ends where none can be taken."""
        length = 0.02
        for _ in range(400):
            self.renew(point.z)
            # The edge goes on with amplitudes below 0, its mirror image: no step may lead there.
            length = min(length, max(0.4 * point.p / self.largest, 1e-9))
            try:
                segment, length = self.next(point, length)
            except NewtonFailed:
                return
            yield segment
            point = segment.end
