# SPDX-License-Identifier: MIT
"""All parametric regions in a range of frequencies: where they are looked for, and followed."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np

from pipedyn.continuation.arclength import (
    Point,
    Segment,
    folds,
)
from pipedyn.forced.combinations import FewModes, Growth
from pipedyn.forced.parametric_edge import (
    SHARES,
    THINNEST,
    Edge,
    RegionKind,
)
from pipedyn.forced.pulsating import Hill
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

SHARP = 2e-3
"""Length of a step below which the least amplitude is looked for at once: a thin region's edges
turn there within much less."""

LEAST = 1e-6
"""Share of the largest amplitude below which a least amplitude counts as 0."""

SAMPLES = 5
"""Amplitudes at which regions are looked for; each edge found is followed to the others."""


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
