# SPDX-License-Identifier: MIT
"""Search for all parametric regions in a range of frequencies, whose edges are then followed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np

from pipedyn.continuation.arclength import Point, Segment
from pipedyn.continuation.tracer import Tracer, between_folds
from pipedyn.forced.combinations import FewModes, Growth
from pipedyn.forced.parametric_edge import OUTWARD, SHARES, THINNEST, Edge, RegionKind
from pipedyn.forced.pulsating import Hill
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

SHARP = 2e-3
"""Length of a step below which the least amplitude of the region is solved for at once: the edges
of a thin region turn back there within a much shorter length."""

LOWEST_AMPLITUDE = 1e-6
"""Least amplitude of a region, relative to the largest amplitude, below which it counts as 0."""

THIN = 1e-3
"""Width of a region, relative to its frequency, below which edges are looked for from outside of
it."""

SAMPLED = 5
"""Number of amplitudes at which regions are looked for; edges are followed to the others."""


class RegionEdges:
    """The known edges of a region at A amplitudes, and its least amplitude.

    Attributes:
        kind: kind of the region.
        edges: lowest and highest frequency w at each amplitude, shape (A, 2); NaN where unknown.
        nus: nu of the motions on these edges, shape (A, 2).
        bottom: least amplitude, with its w and nu, shape (3,); NaN where it lies outside the range
            in which edges were followed.
        followed: frequencies w of the edges, or saddles between both edges, that were followed, for
            each amplitude.
    """

    def __init__(self, kind: RegionKind, count: int) -> None:
        self.kind = kind
        self.edges, self.nus = np.full((2, count, 2), math.nan)
        self.bottom = np.full(3, math.nan)
        self.followed: list[list[float]] = [[] for _ in range(count)]

    def add(self, index: int, frequency: float, nu: float) -> None:
        """Widens the region to an edge with a frequency and nu at the amplitude with an index."""
        low, high = self.edges[index]
        for side, further in enumerate((not frequency > low, not frequency < high)):
            if further:
                self.edges[index, side], self.nus[index, side] = frequency, nu

    def join(self, other: RegionEdges) -> None:
        """Adds the known edges of the same region, found from another edge."""
        for index, side in np.argwhere(np.isfinite(other.edges)).tolist():
            self.add(index, *(float(x[index, side]) for x in (other.edges, other.nus)))
        if not other.bottom[0] >= self.bottom[0] and np.isfinite(other.bottom[0]):
            self.bottom = other.bottom

    def within(self, other: RegionEdges) -> bool:
        """Whether the other is the same region.

        The regions are of one kind, and their least amplitudes agree or all known edges of this one
        do.
        """
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
        """Whether the region overlaps a range of frequencies, or its least amplitude lies in it."""
        known = self.edges[np.isfinite(self.edges).any(axis=1)]
        lower, upper = np.nanmin(known, axis=1), np.nanmax(known, axis=1)
        inside = bool(((lower <= high) & (upper >= low)).any())
        return inside or (known.size > 0 and low <= self.bottom[1] <= high)


@dataclass(frozen=True)
class RegionSearch:
    """Search for the regions of a pulsating pipe in a range of frequencies.

    Attributes:
        hill: Hill's equations of the pipe.
        amplitudes: amplitudes of the pulsation, rising, shape (A,).
        low, high: range of frequencies of the pulsation.
    """

    hill: Hill
    amplitudes: Array
    low: float
    high: float

    def around(self, amplitude: float) -> tuple[float, float]:
        """Range of frequencies in which regions are looked for at an amplitude.

        It is wider than the range asked for, as a region may have its least amplitude in the
        latter. Its middle moves with the mean of u^2, which grows with the square of the amplitude.
        """
        share = min(0.03 + amplitude**2, 0.25)
        return self.low * (1.0 - share), self.high * (1.0 + share)

    def edge(self, kind: RegionKind, frequency: float, centre: bool = False) -> Edge:
        """Equations of an edge near a frequency, with as many harmonics as they need there."""
        few = self.hill.fewer(self.low, frequency)
        return Edge(few, kind, frequency, float(self.amplitudes[-1]), centre)

    def passed(self, step: Segment[Edge]) -> Iterator[tuple[int, Array]]:
        """Indices of the amplitudes asked for that a step passes, with the unknowns there.

        The amplitude must not turn back within the step.
        """
        ways = (self.amplitudes - step.begin.p) * (self.amplitudes - step.end.p)
        for index in np.flatnonzero(ways <= 0.0).tolist():
            yield index, step.where(float(self.amplitudes[index]))

    # ------------------------------------------------------------------------------- one region

    def followed(
        self,
        kind: RegionKind,
        start: tuple[float, float, float],
        outward: int = 0,
        centre: bool = False,
    ) -> RegionEdges:
        """The region that an edge bounds, followed from `start`: a frequency, nu and amplitude.

        `outward`: as for `Edge.near`. With `centre` the saddle between both edges is followed, from
        which they follow in a pipe that is conservative or has real H.

        Raises:
            NewtonFailed: if no edge or saddle is there, or the saddle is lost on the way.
        """
        edge, found = self.edge(kind, start[0], centre), RegionEdges(kind, self.amplitudes.size)
        z = edge.near(*start, outward)
        for way in (-1.0, 1.0):
            (_BothEdges if centre else _OneEdge)(self, edge, found, way).run(z)
        if centre and np.isnan(found.bottom[0]):
            raise NewtonFailed("the saddle was lost on the way to its least amplitude")
        return found

    def corner(self, kind: RegionKind, frequency: float, nu: float) -> Array:
        """Amplitude 0, w and nu where both edges of a region meet, near a frequency and nu."""
        centre = self.edge(kind, frequency, True)
        return centre.place(centre.started(frequency, nu, 0.0))

    def put(self, found: RegionEdges, index: int, centre: Edge, z: Array) -> None:
        """Adds both edges about a saddle z at an amplitude.

        It adds none where the region is too thin or ends with a multiplier at 1 or -1.
        """
        ends = []
        for guess in centre.ends(z):
            edge = self.edge("combination", centre.scale)
            end = edge.started(*centre.place(guess)[[1, 2, 0]].tolist())
            if edge.is_on_axis(end):
                return
            ends.append(edge.place(end)[1:].tolist())
        if ends and ends[0][0] < centre.scale * z[0] < ends[1][0]:
            for end in ends:
                found.add(index, *end)

    # ------------------------------------------------------------------------------ all regions

    def samples(self) -> list[int]:
        """Indices of the amplitudes at which regions are looked for, the largest first."""
        count = self.amplitudes.size
        return np.unique(np.linspace(0, count - 1, min(count, SAMPLED)).astype(int))[::-1].tolist()

    def combinations(self) -> list[RegionEdges]:
        """Combination regions, found by the multipliers of a few modes at each amplitude.

        Each region is followed to the other amplitudes from one interval of growth. Regions may
        meet or part on the way, so that its edges are those of the interval that it leads to.
        """
        found = list[RegionEdges]()
        grown = list[tuple[int, Growth]]()
        for index, amplitude in reversed(list(enumerate(self.amplitudes.tolist()))):
            few = FewModes(self.hill, amplitude, self.low, self.high)
            for growth in few.unstable(*self.around(amplitude)):
                low, high = growth
                if low.axis and low.axis == high.axis:  # a subharmonic or harmonic region
                    continue
                if high.outside.frequency < (1.0 + 0.3 * THINNEST) * low.outside.frequency:
                    continue
                grown.append((index, growth))
                if not any(_leads_to(one, index, growth) for one in found):
                    found += self._combination(growth, index)
        for index, growth in grown:
            for one in found:
                if _leads_to(one, index, growth):
                    self._bound(one, index, growth)
        return _merged(found)

    def _combination(self, growth: Growth, index: int) -> list[RegionEdges]:
        """The regions that an interval of frequencies belongs to, in which motions grow.

        If the interval ends with a multiplier at 1 or -1, it may do so at this amplitude only, and
        this edge is not followed to others.
        """
        amplitude = float(self.amplitudes[index])
        middle, nu = (
            0.5 * sum(getattr(end.inside, name) for end in growth) for name in ("frequency", "nu")
        )
        if not any(end.axis for end in growth) and (self.hill.is_hermitian or self.hill.is_real):
            with suppress(NewtonFailed):
                return [self.followed("combination", (middle, nu, amplitude), centre=True)]
        found = list[RegionEdges]()
        for way, end in zip((-1, 1), growth, strict=True):
            if end.bounded and not end.axis:
                start = end.inside.frequency, end.inside.nu, amplitude
                with suppress(NewtonFailed):
                    found.append(self.followed("combination", start, way))
        if all(end.axis for end in growth):
            found.append(RegionEdges("combination", self.amplitudes.size))
            found[0].followed[index].append(middle)
        return _merged(found)

    def _bound(self, region: RegionEdges, index: int, growth: Growth) -> None:
        """Sets the edges of a region to those of an interval of growth, where they are others."""
        bounded = [end.bounded for end in growth]
        ends = np.where(bounded, [end.outside.frequency for end in growth], region.edges[index])
        width = growth[1].outside.frequency - growth[0].outside.frequency
        gaps = np.nan_to_num(np.abs(region.edges[index] - ends), nan=width)
        if not (gaps[bounded] > max(0.1 * width, 3e-5 * ends[0])).any():
            return
        for side, end in enumerate(growth):
            if not end.bounded:
                continue
            kind: RegionKind = "combination"
            if end.axis:
                kind = "harmonic" if end.axis > 0 else "subharmonic"
            w, nu, way = end.inside.frequency, end.inside.nu, 2 * side - 1
            edge = self.edge(kind, w)
            region.edges[index, side] = region.nus[index, side] = math.nan
            with suppress(NewtonFailed):
                z = edge.near(w, nu, float(self.amplitudes[index]), 0 if end.axis else way)
                region.edges[index, side], region.nus[index, side] = edge.place(z)[1:]

    def on_axis(self, kind: RegionKind, share: float) -> list[RegionEdges]:
        """Subharmonic or harmonic regions, where a real multiplier lies beyond -1 or 1."""
        curves = list[RegionEdges]()
        roots: list[Array] = [np.empty(0) for _ in self.amplitudes]
        for index in self.samples():
            amplitude = float(self.amplitudes[index])
            at = self.hill.edges(share, amplitude)
            apart = np.diff(at, prepend=0.0, append=math.inf)
            roots[index] = at = at[np.minimum(apart[:-1], apart[1:]) > THINNEST * at]
            # Edges near the range are followed, and one more on each side, as a region may contain
            # the whole range.
            first, last = np.searchsorted(at, self.around(amplitude))
            for w in at[max(first - 1, 0) : last + 1].tolist():
                if any(abs(x - w) < 1e-6 * w for one in curves for x in one.followed[index]):
                    continue
                with suppress(NewtonFailed):
                    curves.append(self.followed(kind, (w, share * w, amplitude)))
        for index, at in enumerate(roots):
            every = [x for region in curves for x in region.followed[index]]
            if not every:
                continue
            at = at if at.size else np.sort(every)
            first, last = np.searchsorted(at, [0.99999 * min(every), 1.00001 * max(every)])
            within = self._unstable(share, float(self.amplitudes[index]), at, first, last)
            for region in curves:
                points = region.followed[index]
                region.edges[index] = region.nus[index] = math.nan
                for low, high in within:
                    if any(low * (1.0 - 1e-6) <= x <= high * (1.0 + 1e-6) for x in points):
                        region.add(index, low, share * low)
                        region.add(index, high, share * high)
        return _merged(curves)

    def _unstable(
        self, share: float, amplitude: float, roots: Array, first: int, last: int
    ) -> list[tuple[float, float]]:
        """Unstable intervals between the roots from index `first` to `last`.

        Neighbouring unstable intervals are joined, also beyond these indices.
        """
        sign = 1.0 if share == 0.0 else -1.0

        @cache
        def seen_to_grow(i: int) -> bool:
            """Whether multipliers between root i - 1 and root i say that motions grow."""
            if not 0 < i < roots.size:
                return False
            low, high = roots[i - 1 : i + 1]
            # The test is next to both roots: in the middle two multipliers beyond 1 or -1 may have
            # met and left the real axis.
            for part in (0.002, 0.998):
                values, _ = self.hill.pipe.multipliers(amplitude, low + part * (high - low))
                real = np.abs(values.imag) < 1e-9
                if not (sign * values[real]).real.max(initial=0.0) > 1.0 + 1e-9:
                    return False
            return True

        def grows(i: int) -> bool:
            """Whether motions grow between root i - 1 and root i.

            They do in a thin interval, unless they do on both sides of it.
            """
            thin = 0 < i < roots.size and roots[i] - roots[i - 1] < 1e-4 * roots[i - 1]
            if thin and not (seen_to_grow(i - 1) and seen_to_grow(i + 1)):
                return True
            return seen_to_grow(i)

        lower, upper = first, last
        while grows(lower):
            lower -= 1
        while grows(upper):
            upper += 1
        ends = [float(roots[i]) for i in range(lower, upper) if grows(i) != grows(i + 1)]
        return list(zip(ends[::2], ends[1::2], strict=True))


class _EdgeTracer(Tracer[Edge]):
    """Tracer of an edge one way, which adds the points found to a region.

    The edge ends below the least amplitude that is followed, above the largest amplitude, where it
    leads far outside the range of frequencies, and where a combination edge reaches the real axis:
    beyond, the region is subharmonic or harmonic.

    Args:
        search: the search for regions.
        edge: equations of the edge.
        found: the region, to which the points found are added.
        way: 1 to higher amplitudes first, -1 to lower ones.
    """

    def __init__(self, search: RegionSearch, edge: Edge, found: RegionEdges, way: float) -> None:
        super().__init__(most=400)
        self.search, self.edge, self.found, self.way = search, edge, found, way
        share = 0.1 if search.hill.is_hermitian or search.hill.is_real else LOWEST_AMPLITUDE
        self.largest = float(search.amplitudes[-1])
        self.lowest = share * self.largest  # amplitude below which the edge is taken to lead to 0

    def run(self, z: Array) -> None:
        """Follows the edge from unknowns z; raises NewtonFailed if it has no tangent there."""
        if self.way < 0.0 or z[-1] != self.largest:
            self.edge.renew(z)
            start = self.edge.point(z, np.append(np.zeros(z.size - 1), self.way))
            self.one_way(self.edge.segments(start, 0.02))

    def is_over(self, point: Point) -> bool:
        """Whether the edge ends at a point."""
        within = self.lowest < point.p <= self.largest
        near = 0.2 * self.search.low < self.edge.scale * point.z[0] < 5.0 * self.search.high
        return not (within and near)


class _OneEdge(_EdgeTracer):
    """Tracer of an edge that bounds a region, to each amplitude asked for."""

    sharp = SHARP

    def note(self, step: Segment[Edge]) -> str | None:
        """Adds the edge at the amplitudes on a step, and the least amplitude."""
        edge, end = self.edge, step.end
        first, *turned = between_folds(step, 1e-6)
        if edge.is_on_axis(end.z):
            return "axis"
        for index, at in self.search.passed(first):
            _, w, nu = edge.place(at).tolist()
            self.found.add(index, w, nu)
            self.found.followed[index].append(w)
        # Beyond the least amplitude is the region's other edge, which has its own start.
        if self.way < 0.0 and (turned or step.length < self.sharp):
            self.sharp = 0.1 * step.length
            with suppress(NewtonFailed):
                bottom = edge.bottom(first.end.z)
                if turned or 0.0 < end.p - bottom[0] < 0.05 * end.p:
                    self.found.bottom = bottom
                    asked = self.search.amplitudes
                    if not ((bottom[0] < asked) & (asked < end.p)).any():
                        return "fold"
        if turned:
            return "fold"
        if end.p <= self.lowest:
            # In a conservative pipe both edges of a region end in a corner at amplitude 0.
            _, frequency, nu = edge.place(end.z - end.p / end.tangent[-1] * end.tangent).tolist()
            self.found.bottom = self.search.corner(edge.kind, frequency, nu)
        return None


class _BothEdges(_EdgeTracer):
    """Tracer of the saddle between the two edges of a combination region."""

    def note(self, step: Segment[Edge]) -> None:
        """Adds both edges at the amplitudes on a step."""
        search, edge, found = self.search, self.edge, self.found
        for index, at in search.passed(step):
            found.followed[index].append(float(edge.place(at)[1]))
            search.put(found, index, edge, at)
        if step.end.p <= self.lowest:
            found.bottom = search.corner(edge.kind, *edge.place(step.end.z)[1:].tolist())


def _leads_to(region: RegionEdges, index: int, growth: Growth) -> bool:
    """Whether a region was followed into an interval of growth at the amplitude with an index."""
    low, high = (end.outside.frequency for end in growth)
    error = 3e-5 * low + 1e-3 * (high - low)  # of the ends, which few modes misplace
    return any(low - error <= w <= high + error for w in region.followed[index])


def _merged(parts: list[RegionEdges]) -> list[RegionEdges]:
    """Regions in which parts that belong to one region are joined."""
    found = list[RegionEdges]()
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
) -> list[RegionEdges]:
    """All regions of some kinds that touch a range of frequencies, by rising frequency."""
    search, found = RegionSearch(hill, amplitudes, low, high), list[RegionEdges]()
    for kind, share in SHARES.items():
        if kind in kinds:
            found += search.combinations() if share is None else search.on_axis(kind, share)
    touching = [one for one in found if one.touches(low, high)]
    return sorted(touching, key=lambda one: float(np.nanmin([one.bottom[1], *one.edges.flat])))


def again(hill: Hill, old: RegionEdges, amplitudes: Array, low: float) -> RegionEdges:
    """A known region computed again by other equations, such as those of a larger truncation.

    Raises:
        NewtonFailed: if an edge is not found again.
    """
    search, found = RegionSearch(hill, amplitudes, low, low), RegionEdges(old.kind, amplitudes.size)
    meets = old.kind == "combination" and (hill.is_hermitian or hill.is_real)
    for index, amplitude in enumerate(amplitudes.tolist()):
        ends = old.edges[index]
        if not np.isfinite(ends).all():
            continue
        turns = old.nus[index] / ends
        on_axis = (turns == 0.0) | (turns == 0.5)
        thin = ends[1] - ends[0] < THIN * ends[0]
        if meets and not on_axis.any():
            with suppress(NewtonFailed):
                middle, nu = ends.mean(), old.nus[index].mean()
                centre = search.edge(old.kind, middle, True)
                search.put(found, index, centre, centre.started(middle, nu, amplitude))
                # The middle of a wide region may be far from its saddle, and lead to none or to
                # that of another region.
                moved = np.abs(found.edges[index] - ends)
                if thin or (moved < 0.3 * (ends[1] - ends[0])).all():
                    continue
        # From outside of a thin region, the start may lead to the edge of its neighbour.
        for shift in (OUTWARD, 0.0) if thin else (0.0,):
            for side, way in enumerate((-1.0, 1.0)):
                frequency, nu = float(ends[side]), float(old.nus[index, side])
                kind = ("subharmonic" if nu > 0.0 else "harmonic") if on_axis[side] else old.kind
                edge = search.edge(kind, frequency)
                z = edge.started(frequency * (1.0 + way * shift), nu, amplitude)
                if edge.is_on_axis(z):
                    raise NewtonFailed("two multipliers meet on the real axis")
                found.edges[index, side], found.nus[index, side] = edge.place(z)[1:]
            wider = np.diff(found.edges[index])[0] - np.diff(ends)[0]
            if abs(wider) <= 0.5 * np.diff(ends)[0] + 2e-5 * ends[0]:
                break
        else:
            raise NewtonFailed("an edge led to that of another region")
    found.bottom = old.bottom.copy()
    amplitude, frequency, nu = old.bottom.tolist()
    if amplitude == 0.0:
        found.bottom = search.corner(old.kind, frequency, nu)
    elif amplitude > 0.0:
        edge = search.edge(old.kind, frequency)
        found.bottom = edge.bottom(edge.unknowns(frequency, nu, amplitude))
    return found


def apart(one: RegionEdges, other: RegionEdges) -> float:
    """Largest relative difference of two regions' edges and least amplitudes."""
    pairs = [(one.edges, other.edges), (one.bottom[:1], other.bottom[:1])]
    moved = [np.abs(a - b) / np.maximum(np.abs(b), 1e-3) for a, b in pairs]
    return float(np.nanmax(np.concatenate([part.ravel() for part in moved]), initial=0.0))
