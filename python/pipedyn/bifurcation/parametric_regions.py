# SPDX-License-Identifier: MIT
"""Regions of amplitude and frequency in which a pulsating flow makes the straight pipe unstable.

On an edge Hill's equations H(w, nu, amplitude) q = 0 have a solution with real nu: a multiplier
exp(2 pi i nu / w) is on the unit circle. It is -1 on the edges of subharmonic regions, 1 of
harmonic ones, and any other of combination regions. At one amplitude the first two kinds are all
real eigenvalues w of H, which is a polynomial in w; combination regions are where a multiplier off
the real axis is larger than 1. Each edge found is followed in the amplitude, down to where it turns
back, the least amplitude of its region, and up to where the region ends.

The function g that is followed vanishes with H's least singular value: [H, b; c^H, 0] [q; g] =
[0; 1]. Of a conservative pipe combination regions begin where two multipliers meet; there g is real
and its derivative by nu vanishes too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.bifurcation.continuation import (
    Continuation,
    Control,
    Point,
    Segment,
    Solver,
    folds,
)
from pipedyn.bifurcation.magnus import exponentials
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
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

RegionKind = Literal["subharmonic", "harmonic", "combination"]
SHARES: dict[RegionKind, float | None] = {"subharmonic": 0.5, "harmonic": 0.0, "combination": None}
"""nu / w of the edges' motions."""

CONTROL = Control(longest=0.15, shortest=1e-9, tolerance=1e-11, stagnation=1e-8, turn=0.5)
"""Steps along an edge, in shares of its frequency and of the largest amplitude."""

GROWS = 1e-5
"""By how much a multiplier is larger than 1 where a motion grows: they are computed to less."""

GAUSS = np.array([-0.5, 0.5]) / math.sqrt(3.0)
"""Places of two nodes of Gauss-Legendre quadrature about the middle of an interval of length 1."""

LEAST = 1e-6
"""Share of the largest amplitude below which a least amplitude counts as 0."""

CLOSE = 0.1
"""Distance of two multipliers below which they may meet nearby."""

SAMPLES = 5
"""Amplitudes at which regions are looked for; each edge found is followed to the others."""

THINNEST = 1e-6
"""Width of a region, relative to its frequency, below which it is left out."""

SIZES = (12, 16, 22, 30, 40)
"""Functions or modes, one after the other, until edges converge."""

TOLERANCE = 1e-7
"""Relative change of the edges from one of these to the next at which they count as converged."""


Solve = Callable[[Complex], Complex]


class Edge(Continuation):
    """An edge of a region: unknowns w / scale, of combinations also nu / scale, and the amplitude.

    Args:
        hill: the equations.
        kind: of the region.
        scale: frequency.
        largest: amplitude, which a step along the edge is measured by.
    """

    def __init__(self, hill: Hill, kind: RegionKind, scale: float, largest: float) -> None:
        self.hill, self.kind, self.scale = hill, kind, scale
        share = SHARES[kind]
        size = 2 if share is None else 1
        super().__init__(np.append(np.full(size, 1.0 / size), largest**-2), CONTROL)
        self.share = share
        self._of = hill.polynomial(share)
        self.largest = largest
        self._border: tuple[Complex, Complex] | None = None
        self._paired = share is None and hill.is_hermitian

    def _numbers(self, z: Array) -> list[float]:
        """Of the polynomial: frequency, nu of combinations, amplitude."""
        return [*(self.scale * z[:-1]).tolist(), float(z[-1])]

    def _by(self, z: Array, *which: int) -> Complex:
        """Derivative of H by unknowns."""
        scale = self.scale ** np.count_nonzero(np.array(which) < z.size - 1)
        return np.asarray(scale * self._of.by(which, *self._numbers(z)))

    def _bordered(self, z: Array) -> tuple[complex, Complex, Complex, Solve]:
        """The function g with vectors q and w, which are H's null vectors where g is 0.

        Also what solves the bordered equations for q's change by a change of H q.
        """
        h = self._of(*self._numbers(z))
        n = len(h)
        if self._border is None:
            left, _, right = np.linalg.svd(h)
            c = right[-1].conj()
            self._border = c if self._paired else left[:, -1], c
        b, c = self._border
        bordered = np.block([[h, b[:, None]], [c.conj()[None], np.zeros((1, 1))]])
        last = np.append(np.zeros(n), 1.0)
        factorised()
        lu = scipy.linalg.lu_factor(bordered)
        q, w = (scipy.linalg.lu_solve(lu, last, trans) for trans in (0, 2))

        def solve(right: Complex) -> Complex:
            return np.asarray(scipy.linalg.lu_solve(lu, np.append(right, 0.0))[:n])

        return complex(q[n]), q[:n], w[:n], solve

    def residual(self, z: Array) -> tuple[Array, Array]:
        """What vanishes on the edge, shape (n,), and its derivative, (n, n + 1)."""
        g, q, w, solve = self._bordered(z)
        changes = [self._by(z, i) @ q for i in range(z.size)]
        by = -np.array([np.vdot(w, change) for change in changes])
        if not self._paired:
            count = z.size - 1
            return np.array([g.real, g.imag])[:count], np.stack([by.real, by.imag])[:count]
        # With w = q, as H and its border are Hermitian: dq = -solve(dH q), twice in each.
        slope = self._by(z, 1) @ q
        second = [
            2.0 * np.vdot(slope, solve(change)).real - np.vdot(q, self._by(z, 1, i) @ q).real
            for i, change in enumerate(changes)
        ]
        return np.array([g.real, by[1].real]), np.stack([by.real, second])

    def renew(self, z: Array) -> None:
        """Takes the null vectors at an edge for the border of the steps from there."""
        _, q, w, _ = self._bordered(z)
        b, c = w / np.linalg.norm(w), q / np.linalg.norm(q)
        self._border = (c, c) if self._paired else (b, c)

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
        z = self.fixed(self.unknowns(frequency, nu, amplitude), amplitude)
        self.renew(z)
        return self.fixed(z, amplitude)

    def near(self, frequency: float, nu: float, amplitude: float) -> Array:
        """Unknowns of an edge that is no further than a thousandth from there.

        Multipliers of few modes misplace a combination region by some 1e-4, and Newton's method
        may find no edge from outside it.
        """
        for shift in (0.0, 3e-4, -3e-4) if self.share is None else (0.0,):
            self._border = None
            with suppress(NewtonFailed):
                z = self.started(frequency * (1.0 + shift), nu, amplitude)
                moved = np.abs(self.place(z)[1:] - [frequency, nu]).max()
                if moved < (4e-3 if self.share is None else 1e-4) * frequency:
                    return z
        raise NewtonFailed("Newton's method left the neighbourhood of its start")

    def bottom(self, z: Array) -> Array:
        """Amplitude, w and nu where the amplitude is least, near an edge."""
        row = np.zeros(z.size)
        row[0] = 1.0

        def slope(here: Array) -> float:
            derivative = self.residual(here)[1]
            return float(np.linalg.solve(derivative[:, 1:], -derivative[:, 0])[-1])

        at = float(z[0])
        z, _ = self._solved(z, row, at)
        self.renew(z)
        last, before = slope(z), at
        at *= 1.0 + 1e-4
        for _ in range(12):
            z, _ = self._solved(z, row, at)
            here = slope(z)
            if here == last:
                break
            step = here * (at - before) / (here - last)
            before, last = at, here
            at -= step
            if abs(step) < 1e-10:
                return self.place(z)
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
            threshold. Where an edge leads far outside the range of frequencies, the one that is
            known comes first and NaN in place of the other.
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
        the range. Instabilities of less than 1e-5 a period are left out.

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
    many = math.ceil(window[1] / window[0]) + 4
    last: list[Region] | None = None
    for size in SIZES:
        pipe = pulsating_pipe(model, mean, size)
        with one_thread(pipe.size):
            if last is None:
                pipe.require_stable(window[1])
                found = regions(Hill(pipe, many), mu, *window)
            else:
                hill = Hill(pipe, many)
                found = [again(hill, region, mu, window[0]) for region in last]
        error = math.inf if last is None else max(map(apart, last, found), default=0.0)
        if error <= TOLERANCE:
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
    """A region as its edges were followed.

    Attributes:
        edges, nus: lowest and highest w, with their nu, at each amplitude, (A, 2).
        bottom: least amplitude, its w and nu; NaN where an edge was lost before.
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
        """Whether an edge is one of its own."""
        return bool((np.abs(self.edges[index] - frequency) < 1e-6 * frequency).any())

    def nearest(self, index: int, frequency: float, nu: float) -> tuple[float, float]:
        """From a frequency and nu to the nearest edge at an amplitude."""
        ways = self.edges[index] - frequency
        side = int(np.nanargmin(np.abs(ways)))
        return float(ways[side]), float(self.nus[index, side]) - nu

    def join(self, other: Region) -> None:
        """Takes in another edge of the same region."""
        for index, side in np.argwhere(np.isfinite(other.edges)).tolist():
            self.add(index, *(float(x[index, side]) for x in (other.edges, other.nus)))

    def touches(self, low: float, high: float) -> bool:
        """Whether it has to do with a range of frequencies."""
        ends = self.edges[np.isfinite(self.edges).all(axis=1)]
        inside = (ends[:, 0] <= high) & (ends[:, 1] >= low)
        return bool(inside.any() or low <= self.bottom[1] <= high)


def followed(
    hill: Hill,
    kind: RegionKind,
    start: tuple[float, float, float],
    amplitudes: Array,
    window: tuple[float, float],
) -> Region:
    """The edge through a frequency and nu at an amplitude, `start`; NewtonFailed if none is there.

    It ends beyond the largest amplitude, at amplitude 0, or outside the window of frequencies.
    """
    frequency, _, amplitude = start
    largest = float(amplitudes[-1])
    edge, found = Edge(hill, kind, frequency, largest), Region(kind, amplitudes.size)
    z = edge.near(*start)
    down = np.append(np.zeros(z.size - 1), -1.0)
    low = (0.1 if hill.is_hermitian else LEAST) * largest
    for towards in (down, -down)[: 1 if amplitude == largest else 2]:
        edge.renew(z)
        end = edge.point(z, towards)
        for step in edge.steps(end):
            turns = folds(step, 1e-6)
            for part in step.parts(turns):
                for index in np.flatnonzero(
                    (amplitudes - part.begin.p) * (amplitudes - part.end.p) <= 0.0
                ).tolist():
                    at = edge.place(part.where(float(amplitudes[index])))
                    found.add(index, at[1], at[2])
            for s in turns:
                with suppress(NewtonFailed):
                    turn = edge.bottom(step.at(s).z)
                    if not turn[0] >= found.bottom[0]:
                        found.bottom = turn
            end = step.end
            if not low < end.p <= largest or not window[0] < edge.scale * end.z[0] < window[1]:
                break
        if towards is down and end.p <= low:
            # Both edges of a conservative pipe's region lead to a corner at amplitude 0.
            at = edge.place(end.z - end.p / end.tangent[-1] * end.tangent)
            found.bottom = np.array([0.0, hill.pipe.resonance(kind, float(at[1])), at[2]])
    return found


def again(hill: Hill, region: Region, amplitudes: Array, low: float) -> Region:
    """The same region by other equations; raises `NewtonFailed` where it has no such edge."""
    found = Region(region.kind, amplitudes.size)
    for index, side in np.argwhere(np.isfinite(region.edges)).tolist():
        frequency, nu = (float(x[index, side]) for x in (region.edges, region.nus))
        edge = Edge(hill.fewer(low, frequency), region.kind, frequency, float(amplitudes[-1]))
        z = edge.place(edge.started(frequency, nu, float(amplitudes[index])))
        found.edges[index, side], found.nus[index, side] = z[1:]
    found.bottom = region.bottom.copy()
    amplitude, frequency, nu = region.bottom.tolist()
    if amplitude == 0.0:
        found.bottom[1] = hill.pipe.resonance(region.kind, frequency)
    elif amplitude > 0.0:
        edge = Edge(hill.fewer(low, frequency), region.kind, frequency, float(amplitudes[-1]))
        found.bottom = edge.bottom(edge.unknowns(frequency, nu, amplitude))
    return found


def apart(one: Region, other: Region) -> float:
    """Largest change of an edge and of the least amplitude, relative."""
    pairs = [(one.edges, other.edges), (one.bottom[:1], other.bottom[:1])]
    moved = [np.abs(a - b) / np.maximum(np.abs(b), 1e-3) for a, b in pairs]
    return float(np.nanmax(np.concatenate([part.ravel() for part in moved]), initial=0.0))


# -------------------------------------------------------------------------------- finding edges


def regions(
    hill: Hill,
    amplitudes: Array,
    low: float,
    high: float,
    kinds: Collection[str] = tuple(SHARES),
) -> list[Region]:
    """All regions that touch a range of frequencies, by rising frequency."""
    found = list[Region]()
    window = 0.2 * low, 5.0 * high
    count = amplitudes.size
    for index in np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(int))[::-1]:
        amplitude = float(amplitudes[index])
        for kind, share in SHARES.items():
            if kind not in kinds:
                continue
            if share is None and index < (count - 1) // 2:
                continue
            if share is None:
                starts = combinations(hill, amplitude, low, high)
            else:
                at = hill.edges(share, amplitude)
                apart = np.diff(at, prepend=0.0, append=math.inf)
                wide = np.minimum(apart[:-1], apart[1:]) > THINNEST * at
                at = at[wide]
                # Those near the range, and one on each side, of a region that contains it.
                first, last = np.searchsorted(at, [0.8 * low, 1.25 * high])
                starts = [(w, share * w) for w in at[max(first - 1, 0) : last + 1].tolist()]
            last, moved = 0.0, (0.0, 0.0)
            for frequency, nu in starts:
                if any(one.kind == kind and one.has(index, frequency) for one in found):
                    continue
                # By how much the other edge of a region was off is a better guess than nothing.
                off = moved if frequency - last < 0.02 * frequency else (0.0, 0.0)
                begin, last = (frequency + off[0], nu + off[1], amplitude), frequency
                with suppress(NewtonFailed):
                    few = hill.fewer(low, frequency)
                    new = followed(few, kind, begin, amplitudes, window)
                    moved = new.nearest(index, frequency, nu)
                    same = [one for one in found if _same(one, new)]
                    for one in same[:1]:
                        one.join(new)
                    found += [] if same else [new]
    touching = [one for one in found if one.touches(low, high)]
    for one in touching:
        thin = np.diff(one.edges)[:, 0] < THINNEST * one.edges[:, 0]
        one.edges[thin, 1] = math.nan  # the other was lost
    return sorted(touching, key=lambda one: float(np.nanmin([one.bottom[1], *one.edges.flat])))


def _same(one: Region, other: Region) -> bool:
    """Whether two edges meet in one least amplitude."""
    if one.kind != other.kind:
        return False
    bottoms = one.bottom[:2], other.bottom[:2]
    return bool(np.abs(bottoms[0] - bottoms[1]).max() <= 1e-6 * (1.0 + abs(bottoms[0][1])))


def combinations(
    hill: Hill, amplitude: float, low: float, high: float
) -> list[tuple[float, float]]:
    """Edges of combination regions at an amplitude, w and nu, near enough for Newton's method.

    A motion grows there whose multiplier is off the real axis. It is looked for on a grid, denser
    near (omega_i + omega_j) / k and (omega_i - omega_j) / k, and where on this grid a multiplier is
    largest or two come nearest to each other.
    """
    few = FewModes(hill, amplitude, 3.0 * high)
    omega = few.frequencies
    i, j = np.triu_indices(omega.size, 1)
    seeds = np.concatenate([omega[i] + omega[j], omega[j] - omega[i]])
    # Without damping regions are narrow, of high order, too, and rounding tells them from none.
    sharp = hill.is_hermitian
    seeds = (seeds[:, None] / np.arange(1.0, 5.0 if sharp else 3.0)).ravel()
    seeds = seeds[(seeds > 0.8 * low) & (seeds < 1.25 * high)]
    beside = amplitude * np.linspace(-0.1, 0.1, 5) if sharp else np.zeros(1)
    near = (seeds[:, None] * (1.0 + beside)).ravel()
    at = np.unique(np.concatenate([np.linspace(0.8 * low, 1.25 * high, 97), near]))
    seen = few.largest(at)
    for _ in range(3):  # to a five hundredth of the grid's step
        growth, between = seen[:, 0], seen[:, 2]
        rise = growth[1:-1] - np.maximum(growth[:-2], growth[2:])
        peak = rise > np.maximum(0.01 * np.abs(growth[1:-1]), 2.0 * GROWS)
        dip = (between[1:-1] < np.minimum(between[:-2], between[2:])) & (between[1:-1] < CLOSE)
        extreme = (peak | dip if sharp else peak) & (growth[1:-1] < GROWS)
        change = np.diff(growth > GROWS)
        cells = change | np.append(extreme, False) | np.append(False, extreme)
        left, step = at[:-1][cells], np.diff(at)[cells]
        more = (left[:, None] + step[:, None] * np.arange(1.0, 8.0) / 8.0).ravel()
        at, order = np.unique(np.concatenate([at, more]), return_index=True)
        seen = np.concatenate([seen, few.largest(more)])[order]
    grows = seen[:, 0] > GROWS
    ends = np.flatnonzero(np.diff(grows))
    outside, inside = at[ends + grows[:-1][ends]], at[ends + grows[1:][ends]]
    nu = seen[ends + grows[1:][ends], 1]
    for _ in range(12):  # so near that both edges of a thin region are found
        middle = 0.5 * (outside + inside)
        there = few.largest(middle)
        grown = there[:, 0] > GROWS
        nu = np.where(grown, there[:, 1], nu)
        outside, inside = np.where(grown, outside, middle), np.where(grown, middle, inside)
    kept = (low * 0.8 < inside) & (inside < high * 1.25)
    return list(zip(inside[kept].tolist(), nu[kept].tolist(), strict=True))


class FewModes:
    """The lowest modes of a pulsating pipe, at one amplitude: multipliers at many frequencies.

    The equations y' = A y of states are projected on the eigenvectors of their mean, from the left
    and from the right, so that the modes are coupled by what changes in time only.
    """

    def __init__(self, hill: Hill, amplitude: float, highest: float) -> None:
        pipe, self._parts = hill.pipe, 96 if hill.is_hermitian else 32
        square = pipe.mean**2 * (1.0 + 0.5 * amplitude**2)
        values, right = np.linalg.eig(pipe.companion(pipe.mean, square))
        order = np.argsort(np.abs(values) + 1e9 * (values.imag <= 0.0))
        turning = int(np.count_nonzero(values.imag > 0.0))
        count = int(np.count_nonzero((values.imag > 0.0) & (np.abs(values) < highest)))
        kept = order[: min(max(count + 3, 6), 10, turning)]
        left = np.linalg.inv(right)[kept].T
        self.frequencies = np.sort(values.imag[kept])
        self.amplitude, self.mean = amplitude, pipe.mean
        # Of a pair x + i y with x' = Re, y' = Im of what the mode's amplitude does.
        right, left = right[:, kept], 2.0 * left
        basis = np.concatenate([right.real, right.imag], axis=1)
        rows = np.concatenate([left.real, -left.imag], axis=1)
        rows = rows @ np.linalg.inv(basis.T @ rows)
        self.parts = rows.T @ pipe.companions() @ basis

    def largest(self, frequencies: Array) -> Array:
        """Of multipliers off the real axis at each frequency, shape (F, 3).

        Growth of the largest, its nu, and the distance of the two that are nearest to each other.
        """
        count = self._parts
        found = np.full((frequencies.size, 3), [-1.0, 0.0, 2.0])
        phases = 2.0 * math.pi * (np.arange(count) + 0.5 + GAUSS[:, None]) / count
        speed = self.mean * (1.0 + self.amplitude * np.cos(phases))
        rate = -self.mean * self.amplitude * np.sin(phases)
        powers = speed[..., None] ** np.arange(3)
        still = np.tensordot(powers, self.parts[:3], 1)
        moving = rate[..., None, None] * self.parts[3]
        for k, w in enumerate(frequencies.tolist()):
            first, second = (2.0 * math.pi / (w * count)) * (still + w * moving)
            turned = second @ first - first @ second
            factors = exponentials(0.5 * (first + second) + math.sqrt(3.0) / 12.0 * turned)
            while len(factors) > 1:
                even = factors[1::2] @ factors[: len(factors) // 2 * 2 : 2]
                factors = np.concatenate([even, factors[len(factors) // 2 * 2 :]])
            values = np.linalg.eigvals(factors[0])
            upper = values[values.imag > 1e-4 * np.abs(values)]
            if upper.size == 0:
                continue
            best = upper[int(np.argmax(np.abs(upper)))]
            between = np.abs(upper[:, None] - upper) + np.diag(np.full(upper.size, 2.0))
            nu = float(np.angle(best)) / (2.0 * math.pi) * w
            found[k] = abs(best) - 1.0, nu, between.min()
        return found
