# SPDX-License-Identifier: MIT
"""Regions of amplitude and frequency in which a pulsating flow makes the straight pipe unstable.

On an edge Hill's equations H(w, nu, amplitude) q = 0 have a solution with real nu: a multiplier
exp(2 pi i nu / w) is on the unit circle. It is -1 on the edges of subharmonic regions, 1 of
harmonic ones, and any other of combination regions. At one amplitude the first two kinds are all
real eigenvalues w of H, which is a polynomial in w; combination regions are where a multiplier off
the real axis is larger than 1. Each edge found is followed in the amplitude, down to where it turns
back, the least amplitude of its region, and up to where the region ends.

The function f that is followed is the determinant of G, 2 x 2, with [H, B; C^H, 0] [Q; G] = [0; 1].
Of a pipe that is conservative, or has neither damping nor a Coriolis force, combination regions
begin where two multipliers meet; there f is real and its derivative by nu vanishes too. Between its
edges f has a saddle, which is regular however thin the region is: it is followed in their place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.bifurcation.combinations import FewModes, Growth
from pipedyn.bifurcation.continuation import (
    Continuation,
    Control,
    Point,
    Segment,
    Solver,
    folds,
)
from pipedyn.bifurcation.pulsating import Hill, pulsating_pipe, require_motion
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.frequency_response import checked_range
from pipedyn.models.base import Model, NotConverged
from pipedyn.models.continuum import AnyModel, checked_model
from pipedyn.models.drive import require_steady
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed, newton
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

RegionKind = Literal["subharmonic", "harmonic", "combination"]
SHARES: dict[RegionKind, float | None] = {"subharmonic": 0.5, "harmonic": 0.0, "combination": None}
"""nu / w of the edges' motions."""

CONTROL = Control(longest=0.15, shortest=1e-9, tolerance=1e-11, stagnation=1e-8, turn=0.5)
"""Steps along an edge, in shares of its frequency and of the largest amplitude."""

STARTING = replace(CONTROL, iterations=40)
"""The same where Newton's method halves the distance to a thin region."""

SHARP = 2e-3
"""Length of a step below which the least amplitude is looked for at once: a thin region's edges
turn there within much less."""

LEAST = 1e-6
"""Share of the largest amplitude below which a least amplitude counts as 0."""

SAMPLES = 5
"""Amplitudes at which regions are looked for; each edge found is followed to the others."""

THINNEST = 1e-6
"""Width of a region, relative to its frequency, below which it is left out."""

SIZES = (12, 16, 22, 30, 40)
"""Functions or modes, one after the other, until edges converge."""

TOLERANCE = 1e-7
"""Relative change of the edges from one of these to the next at which they count as converged."""


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
        self._lu = scipy.linalg.lu_factor(np.block([[h, b], [c.conj().T, np.zeros((2, 2))]]))
        last = np.eye(n + 2, 2, -n)
        q, w = (scipy.linalg.lu_solve(self._lu, last, trans) for trans in (0, 2))
        self.q, self.g, self.w = q[:n], q[n:], w[:n]

    def changed(self, h: Complex) -> Changed:
        """By a derivative of H."""
        right = h @ self.q
        return Changed(right, h.conj().T @ self.w, -self.w.conj().T @ right)

    def second(self, one: Changed, other: Changed, h: Complex) -> Complex:
        """Second derivative of G, where H has this one."""
        last = np.zeros((2, 2))
        both = np.concatenate([np.hstack([other.right, one.right]), np.hstack([last, last])])
        solved = scipy.linalg.lu_solve(self._lu, both)[:-2]
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


@result
class ParametricRegion:
    """A region of amplitude and frequency in which the straight pipe is unstable.

    Attributes:
        kind: "subharmonic", where motions grow that turn over from one period to the next (the
            principal region of a mode and its like); "harmonic", where they come back after each
            period; or "combination", of two modes with frequencies of their own.
        amplitude: those asked for, shape (A,).
        edges: lowest and highest frequency of the region at each, shape (A, 2); NaN below the
            threshold, where the region is thinner than 1e-6 of its frequency, in place of an edge
            that lies far outside the range of frequencies, and where one was not found again beside
            a region of another kind that meets it. Where regions of a kind overlap
            these are the edges of the union, for each of them; one that is nowhere apart from
            another is not listed for itself. Regions of different kinds may lie within each other.
        threshold: least amplitude of the region; 0 of modes without damping, NaN where an edge
            leads outside the range before.
        threshold_frequency: frequency at which it has that.
        error: largest change of an edge from the truncation before the last, relative.
    """

    kind: RegionKind
    amplitude: Array = field(repr=False)
    edges: Array
    threshold: float
    threshold_frequency: float
    error: float


def parametric_regions(
    model: AnyModel,
    mean: float,
    amplitudes: ArrayLike,
    frequencies: ArrayLike,
) -> tuple[ParametricRegion, ...]:
    """Regions in which a pulsation u = mean (1 + amplitude cos(frequency tau)) is unstable.

    Args:
        model: chain or reduced model, scene, or `Continuum`.
        mean: mean flow speed > 0, at which the pipe is stable, in sqrt(EI / mu_f) / L.
        amplitudes: relative, increasing, each in (0, 1), shape (A,); or one.
        frequencies: range (low, high) of the pulsation, 0 < low < high <= 20 low, in 1 / T, or
            more in increasing order, from the first to the last.

    Returns:
        The regions that touch the range at one of the amplitudes, or whose threshold lies in it,
        by rising frequency. Edges are roots of Hill's determinant, to 1e-7, and may lie outside
        the range. Left out are instabilities of less than 1e-5 a period of a damped pipe, regions
        thinner than 1e-6 of their frequency, and combinations of modes whose frequencies are
        beyond high + 4 low.

    Example:
        >>> pipe = pp.Pipe(0.2, 10.0)
        >>> (region,) = pp.parametric_regions(pp.Continuum(pipe), 5.5, 0.2, (27.0, 37.0))
        >>> region.kind, region.edges.round(3)
        ('subharmonic', array([[27.431, 36.23 ]]))

    Raises:
        NotConverged: if edges do not converge as functions and harmonics are added.
        ValueError, TypeError: for bad arguments, and for a pipe that is unstable at the mean.

    Source: Paidoussis and Issid (1974); Bolotin (1964), The dynamic stability of elastic systems,
    for Hill's determinant.
    """
    checked_model(model)
    require_motion(model)
    require_steady("mean", mean)
    mean = check.real("mean", mean, low=0.0, high=100.0, open_low=True)
    given = check.numbers("amplitudes", amplitudes, "a number or an array of real numbers")
    mu = check.array("amplitudes", np.atleast_1d(given), open_low=True, low=0.0)
    if not (mu < 1.0).all():
        raise ValueError(
            f"amplitudes must be below 1, beyond which the flow reverses, got {mu.max():g}"
        )
    if (np.diff(mu) <= 0.0).any():
        raise ValueError("amplitudes must be strictly increasing")
    low, high = checked_range("frequencies", frequencies)
    if not low > 0.0 or high > 20.0 * low:
        raise ValueError(
            f"frequencies must have 0 < low and high <= 20 low, got {check.shown(frequencies)}"
        )
    if isinstance(model, Model):
        model.require_equilibrium(mean)
    return _converged(model, mean, mu, (low, high))


def _converged(
    model: AnyModel, mean: float, mu: Array, window: tuple[float, float]
) -> tuple[ParametricRegion, ...]:
    """The regions, by ever more functions and harmonics."""
    # A flow that pulsates by 0.6 needs ten more than the frequencies alone: with fewer its growing
    # motions are not there at all, however often they are looked for.
    many = math.ceil(window[1] / window[0]) + 4 + math.ceil(12.0 * mu[-1])
    last: list[Region] | None = None
    for size in SIZES:
        pipe = pulsating_pipe(model, mean, size)
        with one_thread(pipe.size):
            if last is None:
                pipe.require_stable(window[1])
                found = regions(Hill(pipe, many), mu, *window)
            else:
                hill = Hill(pipe, many)
                try:
                    found = [again(hill, region, mu, window[0]) for region in last]
                except NewtonFailed as reason:
                    raise NotConverged(
                        "edges of parametric regions were not found again with more functions and "
                        f"harmonics: {reason}"
                    ) from None
        error = math.inf if last is None else max(map(apart, last, found), default=0.0)
        if error <= TOLERANCE:
            for one in found:
                one.edges[np.diff(one.edges)[:, 0] < 0.3 * THINNEST * one.edges[:, 1]] = math.nan
            return tuple(
                ParametricRegion(
                    kind=one.kind,
                    amplitude=mu,
                    edges=one.edges,
                    threshold=float(one.bottom[0]),
                    threshold_frequency=float(one.bottom[1]),
                    error=error,
                )
                for one in found
            )
        last = found
        many += 2
    raise NotConverged(f"edges of parametric regions still move by {error:.1e}")


# --------------------------------------------------------------------------- following an edge


class Region:
    """A region, or what is known of it from one edge.

    Attributes:
        edges, nus: lowest and highest w, with their nu, at each amplitude, (A, 2).
        bottom: least amplitude, its w and nu; NaN where that lies outside the range followed.
    """

    def __init__(self, kind: RegionKind, count: int) -> None:
        self.kind = kind
        self.edges, self.nus = np.full((2, count, 2), math.nan)
        self.bottom = np.full(3, math.nan)

    def add(self, index: int, frequency: float, nu: float) -> None:
        """Takes in what an edge is at an amplitude."""
        low, high = self.edges[index]
        for side, further in enumerate((not frequency > low, not frequency < high)):
            if further:
                self.edges[index, side], self.nus[index, side] = frequency, nu

    def has(self, index: int, frequency: float) -> bool:
        """Whether a frequency lies in it or on an edge."""
        low, high = self.edges[index] * [1.0 - 1e-6, 1.0 + 1e-6]
        return bool(low <= frequency <= high)

    def join(self, other: Region) -> None:
        """Takes in another edge of the same region."""
        for index, side in np.argwhere(np.isfinite(other.edges)).tolist():
            self.add(index, *(float(x[index, side]) for x in (other.edges, other.nus)))
        if not other.bottom[0] >= self.bottom[0] and np.isfinite(other.bottom[0]):
            self.bottom = other.bottom

    def within(self, other: Region) -> bool:
        """Whether both are one region: by its least amplitude, or as far as this one is known."""
        if self.kind != other.kind:
            return False
        bottoms = self.bottom[:2], other.bottom[:2]
        known = np.isfinite(self.edges[:, 0])
        gaps = np.abs(self.edges[known] - other.edges[known])
        return bool(
            np.abs(bottoms[0] - bottoms[1]).max() <= 1e-6 * (1.0 + abs(bottoms[0][1]))
            or (known.any() and (gaps <= 1e-9 * self.edges[known]).all())
        )

    def touches(self, low: float, high: float) -> bool:
        """Whether it has to do with a range of frequencies."""
        known = self.edges[np.isfinite(self.edges).any(axis=1)]
        lower, upper = np.nanmin(known, axis=1), np.nanmax(known, axis=1)
        inside = bool(((lower <= high) & (upper >= low)).any())
        return inside or (known.size > 0 and low <= self.bottom[1] <= high)


@dataclass(frozen=True)
class Search:
    """What regions are looked for in.

    Attributes:
        hill: the equations.
        amplitudes: shape (A,).
        low, high: range of frequencies.
    """

    hill: Hill
    amplitudes: Array
    low: float
    high: float

    def around(self, amplitude: float) -> tuple[float, float]:
        """Where regions are looked for, as their least amplitude may lie in the range.

        The mean of u^2, by which a region's middle moves, grows with the square of the amplitude.
        """
        share = min(0.03 + amplitude**2, 0.25)
        return self.low * (1.0 - share), self.high * (1.0 + share)

    def edge(self, kind: RegionKind, frequency: float, centre: bool = False) -> Edge:
        """For edges near a frequency."""
        few = self.hill.fewer(self.low, frequency)
        return Edge(few, kind, frequency, float(self.amplitudes[-1]), centre)

    def along(self, edge: Edge, z: Array, way: float) -> Iterator[Segment[Edge]]:
        """Steps from an edge, first to higher or lower amplitudes.

        They end below 0.1 or, of damped pipes, `LEAST` of the largest amplitude, beyond that, and
        where the edge leads far outside the range of frequencies.
        """
        largest = float(self.amplitudes[-1])
        if way > 0.0 and z[-1] == largest:
            return
        edge.renew(z)
        for step in edge.steps(edge.point(z, np.append(np.zeros(z.size - 1), way))):
            yield step
            frequency = edge.scale * step.end.z[0]
            if not self.lowest(edge) < step.end.p <= largest or not self.is_near(frequency):
                return
            if edge.is_on_axis(step.end.z):  # the region becomes subharmonic or harmonic
                return

    def lowest(self, edge: Edge) -> float:
        """Amplitude below which an edge leads to amplitude 0."""
        share = 0.1 if self.hill.is_hermitian or self.hill.is_real else LEAST
        return share * float(self.amplitudes[-1])

    def is_near(self, frequency: float) -> bool:
        """Whether an edge is followed there."""
        return 0.2 * self.low < frequency < 5.0 * self.high

    def passed(self, step: Segment[Edge]) -> Iterator[tuple[int, Array]]:
        """Amplitudes asked for within a step on which the amplitude does not turn back."""
        ways = (self.amplitudes - step.begin.p) * (self.amplitudes - step.end.p)
        for index in np.flatnonzero(ways <= 0.0).tolist():
            yield index, step.where(float(self.amplitudes[index]))

    # ------------------------------------------------------------------------------- one region

    def followed(
        self, kind: RegionKind, start: tuple[float, float, float], outward: int = 0
    ) -> tuple[Region, list[list[float]]]:
        """From the edge at a frequency, nu and amplitude, and its w at each amplitude asked for.

        Raises:
            NewtonFailed: if no edge is there.
        """
        edge, found = self.edge(kind, start[0]), Region(kind, self.amplitudes.size)
        points: list[list[float]] = [[] for _ in self.amplitudes]

        def add(index: int, z: Array) -> None:
            _, w, nu = edge.place(z).tolist()
            found.add(index, w, nu)
            points[index].append(w)

        z = edge.near(*start, outward)
        for way in (-1.0, 1.0):
            sharp = SHARP
            for step in self.along(edge, z, way):
                end = step.end
                turns = folds(step, 1e-6)[:1]
                if not turns and step.length < sharp and end.tangent[-1] < 0.0:
                    sharp = 0.1 * step.length
                    with suppress(NewtonFailed):
                        bottom = edge.bottom(end.z)
                        if 0.0 < end.p - bottom[0] < 0.05 * end.p:
                            found.bottom = bottom
                            self.down(edge, end, add, bottom)
                            break
                if edge.is_on_axis(end.z):
                    break
                for part in step.parts(turns)[: 1 if turns else None]:
                    for index, at in self.passed(part):
                        add(index, at)
                if turns:  # the other edge of the region, which is followed for itself
                    if way < 0.0:
                        with suppress(NewtonFailed):
                            found.bottom = edge.bottom(step.at(turns[0]).z)
                    break
                if end.p <= self.lowest(edge):
                    # Both edges of a conservative pipe's region lead to a corner at amplitude 0.
                    at = edge.place(end.z - end.p / end.tangent[-1] * end.tangent)
                    resonance = self.hill.pipe.resonance(kind, float(at[1]))
                    found.bottom = np.array([0.0, resonance, at[2]])
        return found, points

    def down(
        self, edge: Edge, end: Point, add: Callable[[int, Array], None], bottom: Array
    ) -> None:
        """Takes in what an edge is between a point and a least amplitude nearby."""
        turn = edge.unknowns(*bottom[[1, 2, 0]].tolist())
        ways = (self.amplitudes - bottom[0]) / (end.p - bottom[0])
        for index in np.flatnonzero((ways > 0.0) & (ways < 1.0)).tolist():
            guess = turn + math.sqrt(ways[index]) * (end.z - turn)
            with suppress(NewtonFailed):
                add(index, edge.fixed(guess, float(self.amplitudes[index])))

    def meeting(self, start: tuple[float, float, float]) -> Region:
        """The combination region about a frequency, nu and amplitude, of a pipe without damping.

        Raises:
            NewtonFailed: if none is there.
        """
        edge = self.edge("combination", start[0], True)
        found = Region("combination", self.amplitudes.size)
        z = edge.near(*start)
        for way in (-1.0, 1.0):
            for step in self.along(edge, z, way):
                for index, at in self.passed(step):
                    self.put(found, index, edge, at)
                if step.end.p <= self.lowest(edge):
                    edge.renew(step.end.z)
                    found.bottom = edge.place(edge.fixed(step.end.z, 0.0))
        return found

    def put(self, found: Region, index: int, centre: Edge, z: Array) -> None:
        """Takes in both edges about a centre, if the region is not too thin there."""
        ends = []
        for guess in centre.ends(z):
            edge = self.edge("combination", centre.scale)
            _, w, nu = edge.place(edge.started(*centre.place(guess)[[1, 2, 0]].tolist()))
            ends.append((float(w), float(nu)))
        if ends and ends[0][0] < centre.scale * z[0] < ends[1][0]:
            for end in ends:
                found.add(index, *end)

    # ------------------------------------------------------------------------------ all regions

    def samples(self) -> list[int]:
        """Amplitudes at which regions are looked for, the largest first."""
        count = self.amplitudes.size
        return np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(int))[::-1].tolist()

    def combinations(self) -> list[Region]:
        """Combination regions."""
        found = list[Region]()
        for index in self.samples():
            amplitude = float(self.amplitudes[index])
            few = FewModes(self.hill, amplitude, self.low, self.high)
            for growth in few.unstable(*self.around(amplitude)):
                middle, width = 0.5 * sum(growth.inside), float(np.diff(growth.outside)[0])
                axis = growth.axis
                if axis[0] and axis[0] == axis[1]:  # a subharmonic or harmonic region
                    continue
                if width < 0.3 * THINNEST * middle or any(o.has(index, middle) for o in found):
                    continue
                with suppress(NewtonFailed):
                    found.append(self._combination(growth, amplitude))
        return _joined(found)

    def _combination(self, growth: Growth, amplitude: float) -> Region:
        """The region of an interval in which motions grow at an amplitude.

        One that ends with a multiplier at 1 or -1 does so at this amplitude, maybe at no other.
        """
        circle = growth.axis == (0, 0)
        if circle and (self.hill.is_hermitian or self.hill.is_real):
            with suppress(NewtonFailed):
                middle, nu = 0.5 * sum(growth.inside), 0.5 * sum(growth.nus)
                return self.meeting((middle, nu, amplitude))
        found = Region("combination", self.amplitudes.size)
        index = int(np.searchsorted(self.amplitudes, amplitude))
        for side, (w, axis) in enumerate(zip(growth.inside, growth.axis, strict=True)):
            if not growth.bounded[side]:
                continue
            if axis:
                edge = self.edge("harmonic" if axis > 0 else "subharmonic", w)
                _, frequency, nu = edge.place(edge.near(w, 0.0, amplitude)).tolist()
                found.edges[index, side], found.nus[index, side] = frequency, nu
                continue
            way = 2 * side - 1
            try:
                part, _ = self.followed("combination", (w, growth.nus[side], amplitude), way)
            except NewtonFailed:
                ends = growth.outside[side] * (1.0 + 1e-3 * way), 0.5 * sum(growth.inside)
                part = Region("combination", self.amplitudes.size)
                part.add(index, *self.bisected(amplitude, *ends))
            if circle:
                found.join(part)
            else:
                values = part.edges[index], part.nus[index]
                found.edges[index, side], found.nus[index, side] = (x[side] for x in values)
                found.bottom = part.bottom
        return found

    def bisected(self, amplitude: float, outside: float, inside: float) -> tuple[float, float]:
        """An edge and its nu, by multipliers off the real axis, where Newton's method fails.

        It does where a combination region touches another one on the real axis.
        """

        def largest(frequency: float) -> complex:
            values, _ = self.hill.pipe.multipliers(amplitude, frequency)
            off = values[np.abs(values.imag) > 1e-9 * np.abs(values)]
            return complex(max(off.tolist(), key=abs, default=0.0))

        if abs(largest(outside)) > 1.0 + 1e-8 or abs(largest(inside)) <= 1.0 + 1e-8:
            raise NewtonFailed("there is no edge between these frequencies")
        while abs(outside - inside) > 1e-9 * inside:
            middle = 0.5 * (outside + inside)
            if abs(largest(middle)) > 1.0 + 1e-8:
                inside = middle
            else:
                outside = middle
        return inside, abs(float(np.angle(largest(inside)))) / (2.0 * math.pi) * inside

    def on_axis(self, kind: RegionKind, share: float) -> list[Region]:
        """Subharmonic or harmonic regions: multipliers beyond 1 or -1 on the real axis."""
        curves = list[tuple[Region, list[list[float]]]]()
        roots: list[Array] = [np.empty(0) for _ in self.amplitudes]
        for index in self.samples():
            amplitude = float(self.amplitudes[index])
            at = self.hill.edges(share, amplitude)
            apart = np.diff(at, prepend=0.0, append=math.inf)
            roots[index] = at = at[np.minimum(apart[:-1], apart[1:]) > THINNEST * at]
            # Those near the range, and one on each side, of a region that contains it.
            first, last = np.searchsorted(at, self.around(amplitude))
            for w in at[max(first - 1, 0) : last + 1].tolist():
                if any(abs(x - w) < 1e-6 * w for _, points in curves for x in points[index]):
                    continue
                with suppress(NewtonFailed):
                    curves.append(self.followed(kind, (w, share * w, amplitude)))
        for index, at in enumerate(roots):
            every = [x for _, points in curves for x in points[index]]
            if not every:
                continue
            at = at if at.size else np.sort(every)
            first, last = np.searchsorted(at, [0.99999 * min(every), 1.00001 * max(every)])
            within = self._unstable(share, float(self.amplitudes[index]), at, first, last)
            for region, points in curves:
                region.edges[index] = region.nus[index] = math.nan
                for low, high in within:
                    if any(low * (1.0 - 1e-6) <= x <= high * (1.0 + 1e-6) for x in points[index]):
                        region.add(index, low, share * low)
                        region.add(index, high, share * high)
        return _joined([region for region, _ in curves])

    def _unstable(
        self, share: float, amplitude: float, roots: Array, first: int, last: int
    ) -> list[tuple[float, float]]:
        """Intervals between some of these roots that are unstable, each as long as it can be."""
        sign = 1.0 if share == 0.0 else -1.0

        @cache
        def grows(i: int) -> bool:
            """Between a root and that before."""
            if not 0 < i < roots.size:
                return False
            low, high = roots[i - 1 : i + 1]
            if high - low < 1e-4 * low and not (grows(i - 1) and grows(i + 1)):
                return True
            # Next to both: between, two that are beyond it may meet and leave the real axis.
            for part in (0.02, 0.98):
                values, _ = self.hill.pipe.multipliers(amplitude, low + part * (high - low))
                real = np.abs(values.imag) < 1e-9
                if not (sign * values[real]).real.max(initial=0.0) > 1.0 + 1e-9:
                    return False
            return True

        found, begin = list[tuple[float, float]](), None
        i = first
        while grows(i):
            i -= 1
        while i < last or (begin is not None and i < roots.size):
            ahead = grows(i + 1)
            if ahead and begin is None:
                begin = float(roots[i])
            elif not ahead and begin is not None:
                found.append((begin, float(roots[i])))
                begin = None
            i += 1
        return found


def _joined(parts: list[Region]) -> list[Region]:
    """Regions from what is known of them."""
    found = list[Region]()
    for part in parts:
        same = [one for one in found if part.within(one) or one.within(part)]
        for one in same[:1]:
            one.join(part)
        found += [] if same else [part]
    return found


def regions(
    hill: Hill,
    amplitudes: Array,
    low: float,
    high: float,
    kinds: Collection[str] = tuple(SHARES),
) -> list[Region]:
    """All regions that touch a range of frequencies, by rising frequency."""
    search, found = Search(hill, amplitudes, low, high), list[Region]()
    for kind, share in SHARES.items():
        if kind in kinds:
            found += search.combinations() if share is None else search.on_axis(kind, share)
    touching = [one for one in found if one.touches(low, high)]
    return sorted(touching, key=lambda one: float(np.nanmin([one.bottom[1], *one.edges.flat])))


def again(hill: Hill, region: Region, amplitudes: Array, low: float) -> Region:
    """The same region by other equations; raises `NewtonFailed` where it has no such edge."""
    search, found = Search(hill, amplitudes, low, low), Region(region.kind, amplitudes.size)
    meets = region.kind == "combination" and (hill.is_hermitian or hill.is_real)
    for index, amplitude in enumerate(amplitudes.tolist()):
        ends = region.edges[index]
        if not np.isfinite(ends).all():
            continue
        turns = region.nus[index] / ends
        on_axis = (turns == 0.0) | (turns == 0.5)
        if meets and not on_axis.any():
            with suppress(NewtonFailed):
                middle, nu = ends.mean(), region.nus[index].mean()
                centre = search.edge(region.kind, middle, True)
                search.put(found, index, centre, centre.started(middle, nu, amplitude))
                continue
        for side, way in enumerate((-1.0, 1.0)):
            frequency, nu = float(ends[side]), float(region.nus[index, side])
            shift = 3e-4 if ends[1] - ends[0] < 1e-3 * frequency else 0.0
            kind = ("subharmonic" if nu > 0.0 else "harmonic") if on_axis[side] else region.kind
            edge = search.edge(kind, frequency)
            try:
                z = edge.place(edge.started(frequency * (1.0 + way * shift), nu, amplitude))
                if edge.is_on_axis(edge.unknowns(*z[[1, 2, 0]].tolist())):
                    raise NewtonFailed("two multipliers meet on the real axis")
                found.edges[index, side], found.nus[index, side] = z[1:]
            except NewtonFailed:
                if edge.share is not None:
                    raise
                between = frequency * (1.0 + 1e-3 * way), float(ends.mean())
                place = search.bisected(amplitude, *between)
                found.edges[index, side], found.nus[index, side] = place
    found.bottom = region.bottom.copy()
    amplitude, frequency, nu = region.bottom.tolist()
    if amplitude == 0.0 and meets:
        centre = search.edge(region.kind, frequency, True)
        found.bottom = centre.place(centre.started(frequency, nu, 0.0))
    elif amplitude == 0.0:
        found.bottom[1] = hill.pipe.resonance(region.kind, frequency)
    elif amplitude > 0.0:
        edge = search.edge(region.kind, frequency)
        found.bottom = edge.bottom(edge.unknowns(frequency, nu, amplitude))
    return found


def apart(one: Region, other: Region) -> float:
    """Largest change of an edge and of the least amplitude, relative."""
    pairs = [(one.edges, other.edges), (one.bottom[:1], other.bottom[:1])]
    moved = [np.abs(a - b) / np.maximum(np.abs(b), 1e-3) for a, b in pairs]
    return float(np.nanmax(np.concatenate([part.ravel() for part in moved]), initial=0.0))
