# SPDX-License-Identifier: MIT
"""Search for all parametric regions in a range of frequencies, whose edges are then followed."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np

from pipedyn.continuation.arclength import BranchStep, Point
from pipedyn.continuation.tracer import Tracer, between_folds
from pipedyn.forced.combinations import FewModes, Growth
from pipedyn.forced.parametric_edge import OUTWARD, SHARES, THINNEST, Edge, RegionKind
from pipedyn.forced.pulsating import Hill
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import track

SHARP = 2e-3
"""Length of a step below which the least amplitude of the region is solved for at once: the edges
of a thin region turn back there within a much shorter length."""

LOWEST_AMPLITUDE = 1e-6
"""Least amplitude of a region, relative to the largest amplitude, below which it counts as 0."""

THIN = 1e-3
"""Width of a region, relative to its frequency, below which edges are looked for from outside of
it."""

SAMPLED = 5
"""Number of amplitudes at which regions are looked for; they are followed to the others."""

SAME_EDGE = 1e-6
"""Relative distance of frequencies up to which an edge that was followed is a known one."""

FARTHEST_START = 4e-3
"""Relative distance up to which an edge or a saddle belongs to the place where it is looked for."""

FARTHEST_END = 4.0
"""Factor by which a range is widened at most, a quarter at a time, until the edges of all regions
that touch it lie in it."""


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

    def join(self, other: RegionEdges) -> None:
        """Adds the known edges of the same region, found from another edge."""
        missing = np.isnan(self.edges)
        self.edges[missing], self.nus[missing] = other.edges[missing], other.nus[missing]
        if not other.bottom[0] >= self.bottom[0] and np.isfinite(other.bottom[0]):
            self.bottom = other.bottom

    def away(self, index: int, interval: Iterable[float]) -> float:
        """Relative distance from an interval to which the region was followed.

        It is infinite if the region was not followed to the amplitude with this index. An end of
        the interval may be NaN if the interval goes on.
        """
        (low, high), w = interval, np.array(self.followed[index])
        away = np.fmax(np.fmax(low / w - 1.0, w / high - 1.0), 0.0)
        return float(np.min(away, initial=math.inf))

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
        progress: whether to show progress on stderr.
    """

    hill: Hill
    amplitudes: Array
    low: float
    high: float
    progress: bool = False

    @property
    def meets(self) -> bool:
        """Whether multipliers of combination regions meet on the unit circle."""
        return self.hill.is_hermitian or self.hill.is_real

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

    # ------------------------------------------------------------------------------- one region

    def followed(
        self, kind: RegionKind, start: tuple[float, float, float], centre: bool = False
    ) -> RegionEdges:
        """The region that an edge bounds, followed from `start`: a frequency, nu and amplitude.

        With `centre` the saddle between both edges is followed.

        Raises:
            NewtonFailed: if no edge or saddle is there, or the saddle is lost on the way.
        """
        edge, found = self.edge(kind, start[0], centre), RegionEdges(kind, self.amplitudes.size)
        z = edge.started(*start)
        if edge.is_on_axis(z) or np.abs(edge.unknowns(*start) - z).max() >= FARTHEST_START:
            raise NewtonFailed("Newton's method left the neighbourhood of its start")
        for way in (-1.0, 1.0):
            (_BothEdges if centre else _OneEdge)(self, edge, found, way).run(z)
        if centre and np.isnan(found.bottom[0]):
            raise NewtonFailed("the saddle was lost on the way to its least amplitude")
        return found

    def corner(self, kind: RegionKind, frequency: float, nu: float) -> Array:
        """Amplitude 0, w and nu where both edges of a region meet, near a frequency and nu."""
        centre = self.edge(kind, frequency, True)
        return centre.place(centre.started(frequency, nu, 0.0))

    def sides(
        self, ends: Array, nus: Array, kinds: Sequence[RegionKind], amplitude: float
    ) -> Array:
        """Edges of a region at an amplitude, with w and nu in rows, shape (2, 2).

        They are NaN where the region is too thin.

        Args:
            ends: approximate frequencies w of the edges, (2,); NaN for an edge not to be found.
            nus: approximate nu of the motions on the edges, (2,).
            kinds: kinds of the edges.
            amplitude: the amplitude.

        Raises:
            NewtonFailed: if no edges are found that are about as far apart as the given ones.
        """
        width = ends[1] - ends[0]
        for starts in self._starts(ends, nus, kinds, amplitude):
            found = np.full((2, 2), math.nan)
            with suppress(NewtonFailed):
                for side in np.flatnonzero(np.isfinite(starts[0])).tolist():
                    w, nu = starts[:, side].tolist()
                    edge = self.edge(kinds[side], w)
                    z = edge.started(w, nu, amplitude)
                    if edge.is_on_axis(z):
                        raise NewtonFailed("two multipliers meet on the real axis")
                    found[:, side] = edge.place(z)[1:]
                wider = np.abs(found[0, 1] - found[0, 0] - width)
                moved = np.abs(found[0] - ends)
                astray = (wider > 0.5 * width + 2e-5 * ends) | (moved > 0.5 * width + 1e-3 * ends)
                if not astray.any():
                    return found
        raise NewtonFailed("edges lead to those of another region")

    def _starts(
        self, ends: Array, nus: Array, kinds: Sequence[RegionKind], amplitude: float
    ) -> Iterator[Array]:
        """Starts of Newton's method for `sides`, with w and nu in rows, (2, 2), the best first.

        Where multipliers meet, edges lie about a saddle. Otherwise, from inside of a thin region
        Newton's method leads to either edge, and from outside maybe to the edge of a neighbour.
        """
        thin = ends[1] - ends[0] < THIN * ends[0]
        if self.meets and set(kinds) == {"combination"} and np.isfinite(ends).all():
            with suppress(NewtonFailed):
                centre = self.edge("combination", float(ends.mean()), True)
                z = centre.started(centre.scale, float(nus.mean()), amplitude)
                found = [centre.place(end)[1:] for end in centre.ends(z)]
                if found:
                    yield np.stack(found, axis=1)
                elif thin:
                    yield np.full((2, 2), math.nan)
        for shift in (OUTWARD, 0.0) if thin else (0.0, OUTWARD):
            yield np.stack([ends * [1.0 - shift, 1.0 + shift], nus])

    # ------------------------------------------------------------------------------ all regions

    def samples(self) -> list[int]:
        """Indices of the amplitudes at which regions are looked for, the largest first."""
        count = self.amplitudes.size
        return np.unique(np.linspace(0, count - 1, min(count, SAMPLED)).astype(int))[::-1].tolist()

    def combinations(self) -> list[RegionEdges]:
        """Combination regions, found by the multipliers of a few modes at some amplitudes.

        Each region is followed to the other amplitudes from one interval in which motions grow. As
        regions may meet or part on the way, its edges are those of the intervals that it leads to.
        """
        found, grown = list[RegionEdges](), list[tuple[int, Array]]()
        sampled = self.samples()
        every = dict.fromkeys([*sampled, *range(self.amplitudes.size)])
        for index in track(every, len(every), "combination regions", self.progress):
            if index not in sampled and not any(one.followed[index] for one in found):
                continue
            amplitude = float(self.amplitudes[index])
            for growth in self._growth(amplitude):
                kinds = [end.kind for end in growth]
                ends, nus = (
                    np.array([getattr(end.inside, name) for end in growth])
                    for name in ("frequency", "nu")
                )
                ends[[not end.bounded for end in growth]] = math.nan
                with suppress(NewtonFailed):
                    sides = self.sides(ends, nus, kinds, amplitude)
                    if np.isnan(sides).all():
                        continue
                    grown.append((index, sides))
                    if all(one.away(index, sides[0]) > SAME_EDGE for one in found):
                        found += self._combination(index, sides, kinds)
        for index, sides in grown:
            for one in found:
                if one.away(index, sides[0]) <= SAME_EDGE:
                    one.edges[index], one.nus[index] = sides
        return _merged(found)

    def _growth(self, amplitude: float) -> list[Growth]:
        """Intervals of frequencies in which motions grow that belong to combination regions.

        An end is not bounded only where it is far outside of the range.
        """
        few = FewModes(self.hill, amplitude, self.low, self.high)
        first, last = low, high = self.around(amplitude)
        seen = few.scanned(low, high)
        while True:
            found = [
                (a, b)
                for a, b in few.unstable(seen)
                if a.outside.frequency <= last and b.outside.frequency >= first
            ]
            if not all(a.bounded for a, _ in found) and low > first / FARTHEST_END:
                seen, low = few.scanned(0.8 * low, low) + seen, 0.8 * low
            elif not all(b.bounded for _, b in found) and high < FARTHEST_END * last:
                seen, high = seen + few.scanned(high, 1.25 * high), 1.25 * high
            else:
                break
        # Between two multipliers that leave the real axis and return to it, on one side of 0, a
        # region is subharmonic or harmonic.
        return [(a, b) for a, b in found if not a.axis or a.axis != b.axis]

    def _combination(
        self, index: int, sides: Array, kinds: Sequence[RegionKind]
    ) -> list[RegionEdges]:
        """The regions that an interval belongs to in which motions grow, with edges `sides`.

        If the interval ends with a multiplier at 1 or -1, it may do so at this amplitude only, and
        this edge is not followed to others.
        """
        amplitude = float(self.amplitudes[index])
        middle, nu = np.nanmean(sides, axis=1).tolist()
        if self.meets and set(kinds) == {"combination"}:
            with suppress(NewtonFailed):
                return [self.followed("combination", (middle, nu, amplitude), centre=True)]
        found = list[RegionEdges]()
        for kind, (w, nu) in zip(kinds, sides.T.tolist(), strict=True):
            if kind == "combination" and not math.isnan(w):
                with suppress(NewtonFailed):
                    found.append(self.followed(kind, (w, nu, amplitude)))
        if not found:
            found.append(RegionEdges("combination", self.amplitudes.size))
            found[0].followed[index].append(middle)
        return found

    def on_axis(self, kind: RegionKind, share: float) -> list[RegionEdges]:
        """Subharmonic or harmonic regions, where a real multiplier lies beyond -1 or 1."""
        curves = list[RegionEdges]()
        roots: list[Array] = [np.empty(0) for _ in self.amplitudes]
        sampled = self.samples()
        for index in track(sampled, len(sampled), f"{kind} regions", self.progress):
            amplitude = float(self.amplitudes[index])
            at = self.hill.edges(share, amplitude, self.high)
            apart = np.diff(at, prepend=0.0, append=math.inf)
            roots[index] = at = at[np.minimum(apart[:-1], apart[1:]) > THINNEST * at]
            # Edges near the range are followed, and one more on each side, as a region may contain
            # the whole range.
            first, last = np.searchsorted(at, self.around(amplitude))
            for w in at[max(first - 1, 0) : last + 1].tolist():
                if any(one.away(index, (w, w)) <= SAME_EDGE for one in curves):
                    continue
                with suppress(NewtonFailed):
                    curves.append(self.followed(kind, (w, share * w, amplitude)))
        for index, at in enumerate(roots):
            every = [w for region in curves for w in region.followed[index]]
            if not every:
                continue
            at = at if at.size else np.sort(every)
            ends = np.searchsorted(at, [0.99999 * min(every), 1.00001 * max(every)])
            within = self._unstable(share, float(self.amplitudes[index]), at, *ends.tolist())
            for region in curves:
                for interval in within:
                    if region.away(index, interval) <= SAME_EDGE:
                        region.edges[index] = interval
                region.nus[index] = share * region.edges[index]
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
            # Between two roots a real multiplier lies on one side of 1 or -1; whether it is neutral
            # is not asked here. The test is next to both roots: in the middle two multipliers
            # beyond 1 or -1 may have met and left the real axis.
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
        share = 0.1 if search.meets else LOWEST_AMPLITUDE
        self.largest = float(search.amplitudes[-1])
        self.lowest = share * self.largest  # amplitude below which the edge is taken to lead to 0

    def run(self, z: Array) -> None:
        """Follows the edge from unknowns z; raises NewtonFailed if it has no tangent there."""
        if self.way < 0.0 or z[-1] != self.largest:
            self.edge.renew(z)
            start = self.edge.point(z, np.append(np.zeros(z.size - 1), self.way))
            self.one_way(self.edge.steps(start, 0.02))

    def passes(self, step: BranchStep[Edge]) -> None:
        """Notes the edge at the amplitudes asked for on a step, in which none turns back."""
        asked = self.search.amplitudes
        for index in np.flatnonzero((asked - step.begin.p) * (asked - step.end.p) <= 0.0).tolist():
            at = step.where(float(asked[index]))
            self.found.followed[index].append(float(self.edge.scale * at[0]))

    def is_over(self, point: Point) -> bool:
        """Whether the edge ends at a point."""
        within = self.lowest < point.p <= self.largest
        near = 0.2 * self.search.low < self.edge.scale * point.z[0] < 5.0 * self.search.high
        return not (within and near)


class _OneEdge(_EdgeTracer):
    """Tracer of an edge that bounds a region, to each amplitude asked for."""

    sharp = SHARP

    def note(self, step: BranchStep[Edge]) -> str | None:
        """Adds the edge at the amplitudes on a step, and the least amplitude."""
        edge, end = self.edge, step.end
        first, *turned = between_folds(step, 1e-6)
        if edge.is_on_axis(end.z):
            return "axis"
        self.passes(first)
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

    def note(self, step: BranchStep[Edge]) -> None:
        """Adds both edges at the amplitudes on a step."""
        self.passes(step)
        if step.end.p <= self.lowest:
            place = self.edge.place(step.end.z)[1:].tolist()
            self.found.bottom = self.search.corner(self.edge.kind, *place)


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
    progress: bool = False,
) -> list[RegionEdges]:
    """All regions of some kinds that touch a range of frequencies, by rising frequency."""
    search = RegionSearch(hill, amplitudes, low, high, progress)
    found = list[RegionEdges]()
    for kind, share in SHARES.items():
        if kind in kinds:
            found += search.combinations() if share is None else search.on_axis(kind, share)
    touching = [one for one in found if one.touches(low, high)]
    return sorted(touching, key=lambda one: float(np.nanmin([one.bottom[1], *one.edges.flat])))


def recompute(hill: Hill, old: RegionEdges, amplitudes: Array, low: float) -> RegionEdges:
    """A known region computed again by other equations, such as those of a larger truncation.

    Raises:
        NewtonFailed: if an edge is not found again.
    """
    search, found = RegionSearch(hill, amplitudes, low, low), RegionEdges(old.kind, amplitudes.size)
    for index, amplitude in enumerate(amplitudes.tolist()):
        ends = old.edges[index]
        if not np.isfinite(ends).all():
            continue
        axis: dict[float, RegionKind] = {0.0: "harmonic", 0.5: "subharmonic"}
        kinds = [axis.get(turns, old.kind) for turns in (old.nus[index] / ends).tolist()]
        found.edges[index], found.nus[index] = search.sides(ends, old.nus[index], kinds, amplitude)
    found.bottom = old.bottom.copy()
    amplitude, frequency, nu = old.bottom.tolist()
    if amplitude == 0.0:
        found.bottom = search.corner(old.kind, frequency, nu)
    elif amplitude > 0.0:
        edge = search.edge(old.kind, frequency)
        found.bottom = edge.bottom(edge.unknowns(frequency, nu, amplitude))
    return found


def region_change(one: RegionEdges, other: RegionEdges) -> float:
    """Largest relative difference of two regions' edges and least amplitudes."""
    pairs = [(one.edges, other.edges), (one.bottom[:1], other.bottom[:1])]
    moved = [np.abs(a - b) / np.maximum(np.abs(b), 1e-3) for a, b in pairs]
    return float(np.nanmax(np.concatenate([part.ravel() for part in moved]), initial=0.0))
