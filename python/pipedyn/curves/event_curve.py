# SPDX-License-Identifier: MIT
"""One event of cycles followed in two numbers, both ways, with the named points on its curve."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import Point, Segment, sign_changes
from pipedyn.curves.event_onset import Onset
from pipedyn.curves.event_plane import EVENTS, EventPlane
from pipedyn.curves.event_problem import EventProblem, Followed, event_angle
from pipedyn.cycles.limit_cycle import amplitude_of
from pipedyn.linear.eigenproblem import Complex
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.floquet import UNIT, crossing_event, nontrivial, orbit_multipliers
from pipedyn.orbits.orbit_continuation import FINE, breaking_part, onward
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, resolved_orbit
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.later import scipy
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import track
from pipedyn.util.result import Result

LONGEST = 0.08
"""Longest step: a share of the second number's range, of the frequency or of the speed, or a change
of the free end's amplitude in L. Cubics through the points have no corners that a page shows."""

MOST_STEPS = 300
"""Of a curve, either way: at the longest step twenty-four times across the window."""

NEAR_END, NEARBY = 0.01, 0.1
"""Amplitude in L, or sine of a torus's angle, below which a curve has all but reached the point at
which these are 0, and below which it is said to lead there if Newton's method fails on the way."""


@saved_as(
    "CycleCurve", shapes={"S": "x y frequency amplitude multiplier unstable opens onset orbits"}
)
class CycleCurve(Result):
    """An event of cycles, point by point along the curve.

    Attributes:
        kind: "fold", "pitchfork" (which breaks the mirror symmetry of cycles), "period doubling" or
            "torus".
        x, y: the two numbers, shape (S,).
        frequency: of the cycle, angular, in 1 / T, shape (S,); of a forced motion that of the
            forcing.
        amplitude: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        multiplier: on the unit circle, shape (S,): 1, -1 at a period doubling; of a torus that of
            the pair with the positive imaginary part.
        unstable: number of other multipliers outside the unit circle, shape (S,): where it is 0
            a stable cycle meets the curve.
        opens: at a fold 1 where its two cycles exist at flow speeds (frequencies of the forcing)
            above, -1 where below; 0 at others, shape (S,).
        onset: flow speed at which the flutter of the straight pipe sets in from which the branch of
            cycles comes, shape (S,), followed from the branch's own beginning as the other number
            changes; of a branch that does not begin at flutter the lowest speed at which the pipe
            becomes unstable, followed likewise. NaN beyond the fold at which that curve turns back
            over the other number, if it bounds the stable region nowhere, and of forced motions.
        ends: why it ends at its first and last point: "range" (it leaves the window), "closed",
            a kind of `CyclePoint`, "points" or "not converged".
        orbits: the solutions of the collocation equations.
    """

    kind: Followed
    x: Array = field(repr=False)
    y: Array = field(repr=False)
    frequency: Array = field(repr=False)
    amplitude: Array = field(repr=False)
    multiplier: Complex = field(repr=False)
    unstable: NDArray[np.int_] = field(repr=False)
    opens: NDArray[np.int_] = field(repr=False)
    onset: Array = field(repr=False)
    ends: tuple[str, str]
    orbits: tuple[PeriodicOrbit, ...] = field(repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.x)


@saved_as("CyclePoint")
class CyclePoint(Result):
    """Where a curve of an event meets a second condition.

    Multipliers are those over a period, of a cycle that is its own mirror image those over half a
    period and the reflection.

    Attributes:
        kind: "cusp" (two curves of folds meet); "Bautin" (a curve of folds ends where the
            criticality of flutter changes: the amplitude falls to 0); "Hopf" (the same with drag,
            or of another curve that ends at an onset); "degenerate pitchfork",
            "degenerate period doubling" (the same, where folds meet these curves); "1:1 resonance"
            and "1:2 resonance" (two multipliers 1, two -1: curves of tori end), "1:3 resonance",
            "1:4 resonance"; or the names of the two events that happen at once, as "fold-torus".
        x, y: the two numbers.
        frequency: of the cycle.
        amplitude: of the cycle; 0 at an onset.
    """

    kind: str
    x: float
    y: float
    frequency: float
    amplitude: float


Step = Segment[EventProblem]


@dataclass(frozen=True)
class _Place:
    """A point of a curve."""

    z: Array = field(repr=False)
    second: float
    own: float
    orbit: PeriodicOrbit
    amplitude: float
    rest: Complex  # multipliers, or their roots, beside those of the event
    opens: int
    vanishing: dict[str, float]  # size of what falls to 0 where the curve may end, by its name
    unstable: int  # number of these multipliers outside the unit circle


def _growth(rest: Complex) -> Array:
    """Logarithms of moduli relative to 1 + UNIT, falling."""
    return np.sort(np.log(np.maximum(np.abs(rest), 1e-300) / (1.0 + UNIT)))[::-1]


class EventFollower:
    """A curve in the making."""

    def __init__(
        self, plane: EventPlane, kind: Followed, shown: bool, onset: Onset | None = None
    ) -> None:
        self.plane, self.kind, self.shown, self.onset = plane, kind, shown, onset
        self.points, self.failures = list[CyclePoint](), list[str]()
        self.how = replace(FINE, longest=LONGEST, tolerance=1e-6, stagnation=1e-5)

    def start(self, orbit: PeriodicOrbit) -> tuple[EventProblem, Point]:
        """The event near an orbit, at the number that its branch has."""
        motion, value = self.plane.family.at(self.plane.value), self.plane.value
        orbit = resolved_orbit(
            *(motion, orbit.states, orbit.frequency, orbit.u, orbit.symmetric), self.how.defect
        )
        tail = [value]
        if self.kind == "torus":
            tail.insert(0, event_angle(orbit_multipliers(motion, orbit)[1]))
        problem = EventProblem(self.plane.family, self.kind, orbit, np.array(tail), self.how)
        z = problem.fixed(problem.origin, value)
        found = problem.orbit(z)
        if abs(found.frequency / orbit.frequency - 1.0) > 0.02:
            raise NewtonFailed("Newton's method left the neighbourhood of the event")
        problem = problem.about(z)
        growing = np.append(np.zeros(z.size - 1), 1.0)
        return problem, problem.point(z, growing)

    def lies_on(self, curve: CycleCurve, start: tuple[EventProblem, Point]) -> bool:
        """Whether a curve passes an event."""
        if curve.kind != self.kind:
            return False
        problem, point = start
        here = self.place(problem, point)
        second, own = (curve.y, curve.x) if self.plane.own_first else (curve.x, curve.y)
        near = (second[:-1] - here.second) * (second[1:] - here.second) <= 0.0
        for i in np.flatnonzero(near).tolist():
            for one in (curve.orbits[i], curve.orbits[i + 1]):
                apart = abs(one.frequency / here.orbit.frequency - 1.0)
                if apart < 0.05 and abs(own[i] / here.own - 1.0) < 0.05:
                    share = (here.second - second[i]) / ((second[i + 1] - second[i]) or 1.0)
                    guess = own[i] + share * (own[i + 1] - own[i])
                    step = abs(own[i + 1] - own[i])
                    if abs(guess - here.own) < 0.1 * step + 1e-3 * here.own:
                        return True
        return False

    def run(self, start: tuple[EventProblem, Point]) -> CycleCurve:
        """Both ways from the event."""
        problem, point = start
        ahead, last = self._one_way(problem, point)
        back, first = list[_Place](), last
        if last != "closed":
            back, first = self._one_way(problem, Point(point.z, -point.tangent))
        places = back[:0:-1] + ahead
        x, y = (
            np.array(of)
            for of in zip(*(self.plane.places(p.second, p.own) for p in places), strict=True)
        )
        second = np.array([place.second for place in places])
        turns = {"fold": 1.0, "pitchfork": 1.0, "period doubling": -1.0}
        multiplier = np.array(
            [
                self._multiplier(place) if self.kind == "torus" else turns[self.kind]
                for place in places
            ],
            dtype=complex,
        )
        return CycleCurve(
            kind=self.kind,
            x=x,
            y=y,
            frequency=np.array([place.orbit.frequency * self.plane.order for place in places]),
            amplitude=np.array([place.amplitude for place in places]),
            multiplier=multiplier,
            unstable=np.array([place.unstable for place in places]),
            opens=np.array([place.opens for place in places]),
            onset=np.full(len(places), math.nan)
            if self.onset is None
            else self.onset.along(second),
            ends=(first, last),
            orbits=tuple(place.orbit for place in places),
        )

    def _multiplier(self, place: _Place) -> complex:
        root = complex(np.exp(1j * place.z[-2]))
        value = root**2 if place.orbit.symmetric else root
        return complex(value.real, abs(value.imag))

    def place(self, problem: EventProblem, point: Point) -> _Place:
        """What is known of a point."""
        orbit, second = problem.orbit(point.z), float(point.z[-1])
        motion = self.plane.family.at(second)
        own = orbit.frequency * self.plane.order if self.plane.forced else orbit.u
        opens = problem.opens(point.z) if self.kind == "fold" else 0
        rest = self._rest(motion, orbit, point.z)
        amplitude = amplitude_of(motion, orbit)[0]
        vanishing = {
            name: float(np.linalg.norm(odd)) for name, odd in self._odd(problem, point.z).items()
        }
        unstable = int(np.count_nonzero(_growth(rest) > 0.0))
        return _Place(point.z, second, own, orbit, amplitude, rest, opens, vanishing, unstable)

    def _rest(self, motion: VectorField, orbit: PeriodicOrbit, z: Array) -> Complex:
        """Multipliers, or of a cycle with a mirror their roots, without those of the event."""
        _, roots, _ = orbit_multipliers(motion, orbit)
        rest = roots if self.plane.forced else nontrivial(roots)
        gone: dict[str, list[complex]] = {"fold": [1.0], "torus": []}
        if self.kind == "torus":
            gone["torus"] = [np.exp(1j * z[-2]), np.exp(-1j * z[-2])]
        for value in gone.get(self.kind, [-1.0]):
            rest = np.delete(rest, int(np.argmin(np.abs(rest - value))))
        return rest

    # ------------------------------------------------------------------------------- one way

    def _one_way(self, problem: EventProblem, point: Point) -> tuple[list[_Place], str]:
        """From a point until the curve leaves the window, ends or cannot be followed."""
        begin = self.place(problem, point)
        places = [begin]
        steps = onward(problem, point, 0.25 * self.how.longest)
        try:
            for step in track(islice(steps, MOST_STEPS), None, self.kind, self.shown):
                problem = step.problem
                ended = self._ending(step)
                if ended is not None:
                    return self._ended(places, ended)
                if len(places) > 3 and (last := self._closing(step, begin)):
                    return [*places, *self._passed(step, places[-1], last), begin], "closed"
                cut = self._cut(step)
                if cut is step.begin:
                    return places, "range"
                end = cut or step.end
                part = replace(step, end=end)
                here = self.place(step.problem, end)
                places += [*self._passed(part, places[-1], here), here]
                if cut is not None:
                    return places, "range"
                if (ended := self._near_end(places, NEAR_END)) is not None:
                    return self._ended(places, ended)
        except NewtonFailed as reason:
            if (ended := self._near_end(places, NEARBY)) is not None:
                return self._ended(places, ended)
            if (last := self._at_edge(problem, places[-1])) is not None:
                return ([*places, last] if last is not places[-1] else places), "range"
            self._failed(places[-1], str(reason))
            return places, "not converged"
        self._failed(places[-1], f"it takes more than {MOST_STEPS} steps")
        return places, "points"

    def _at_edge(self, problem: EventProblem, place: _Place) -> _Place | None:
        """The point on an edge beyond which there are no pipes, if the last one is beside it."""
        second = self.plane.ranges[1 if self.plane.own_first else 0]
        edge = min(second, key=lambda value: abs(value - place.second))
        if abs(edge - place.second) > 0.01 * self.plane.family.width:
            return None
        if abs(edge - place.second) < 1e-9 * self.plane.family.width:
            return place
        try:
            problem = problem.about(place.z)
            z = problem.fixed(place.z, edge)
            return self.place(problem, Point(z, z))
        except NewtonFailed:
            return None

    def _ended(self, places: list[_Place], end: tuple[_Place, str]) -> tuple[list[_Place], str]:
        """Places with the named point at which the curve ends."""
        self.points.append(self._named(end[1], end[0]))
        return [*places, end[0]], end[1]

    def _failed(self, place: _Place, reason: str) -> None:
        x, y = self.plane.places(place.second, place.own)
        self.failures.append(
            f"the {self.kind} was not followed beyond ({x:.6g}, {y:.6g}): {reason}"
        )

    def _own_of(self, step: Step, z: Array) -> float:
        orbit = step.problem.orbit(z)
        return orbit.frequency * self.plane.order if self.plane.forced else orbit.u

    def _cut(self, step: Step) -> Point | None:
        """The point at which a step leaves the window, None where it does not."""
        first, last = self.plane.ranges
        second, own = (last, first) if self.plane.own_first else (first, last)
        places, cuts = {-1: (1.0, second)}, list[Array]()
        places[-1 - step.problem.tail.size] = float(self.plane.order), own
        for index, (factor, (low, high)) in places.items():
            begin, end = (factor * float(p.z[index]) for p in (step.begin, step.end))
            if low <= end <= high:
                continue
            edge = low if end < low else high
            if (begin - edge) * (end - edge) >= 0.0:
                return step.begin  # on the edge
            cuts.append(step.where(edge / factor, index))
        if not cuts:
            return None
        z = min(cuts, key=step.reach)
        return step.problem.point(z, step.begin.tangent)

    def _closing(self, step: Step, begin: _Place) -> _Place | None:
        """The first point again, if a step passes it."""
        low, high = sorted((step.begin.p, step.end.p))
        if not low <= begin.second <= high:
            return None
        own = [self._own_of(step, p.z) for p in (step.begin, step.end)]
        if min(abs(value / begin.own - 1.0) for value in own) > 0.1:
            return None
        try:
            found = step.where(begin.second)
        except NewtonFailed:
            return None
        here = self.place(step.problem, Point(found, step.end.tangent))
        same = abs(here.own / begin.own - 1.0) < 1e-6
        same = same and abs(here.orbit.frequency / begin.orbit.frequency - 1.0) < 1e-6
        return here if same and abs(here.amplitude / begin.amplitude - 1.0) < 1e-4 else None

    # --------------------------------------------------------------------------- named points

    def _odd(self, problem: EventProblem, z: Array) -> dict[str, Array]:
        """What is odd in the distance from a point at which the curve ends, by the point's name.

        That is the amplitude, what breaks a symmetry, the sine of the angle of a torus.
        """
        if self.kind == "torus":
            angle = float(z[-2])
            name = "1:2 resonance" if round(angle / math.pi) % 2 else "1:1 resonance"
            return {name: np.array([math.sin(angle)])}
        orbit, kinds = problem.orbit(z), dict[str, str]()
        if not self.plane.forced:
            drag = self.plane.family.at(float(z[-1])).model.pipe.drag
            kinds["hopf"] = "Hopf" if drag or self.kind != "fold" else "Bautin"
        if not orbit.symmetric and self.kind == "fold":
            kinds["period doubling"] = "degenerate period doubling"
            if problem.motion.is_odd(orbit.u):
                kinds["pitchfork"] = "degenerate pitchfork"
        return {name: breaking_part(orbit, kind) for kind, name in kinds.items()}

    def _ending(self, step: Step) -> tuple[_Place, str] | None:
        """Where a step passes the point at which the curve ends, and its kind."""
        problem = step.problem
        begin, end = (self._odd(problem, point.z) for point in (step.begin, step.end))
        for name in begin.keys() & end.keys():
            here, there = begin[name], end[name]
            if float(np.sum(here * there)) >= 0.0:
                continue
            before, after = float(np.linalg.norm(here)), float(np.linalg.norm(there))
            meeting = step.length * before / (before + after)
            near = [step.begin, *(step.at(share * meeting) for share in (0.4, 0.7))]
            return self._limit([self.place(problem, point) for point in near], name), name
        return None

    def _limit(self, places: list[_Place], name: str) -> _Place:
        """Where what falls to 0 at three places is 0: the numbers change with its square.

        Those of a fold change with drag with the amplitude itself.
        """
        power = 1 if name == "Hopf" else 2
        sizes = np.array([place.vanishing[name] for place in places]) ** power
        second, own = (
            float(np.polyval(np.polyfit(sizes / sizes[0], values, 2), 0.0))
            for values in ([p.second for p in places], [p.own for p in places])
        )
        last = places[-1]
        # Beside an edge beyond which there are no pipes it may lie beyond.
        low, high = self.plane.ranges[1 if self.plane.own_first else 0]
        second = min(max(second, low), high)
        orbit = last.orbit if self.plane.forced else replace(last.orbit, u=own)
        amplitude = 0.0 if name in ("Bautin", "Hopf") else last.amplitude
        return replace(last, second=second, own=own, orbit=orbit, amplitude=amplitude)

    def _near_end(self, places: list[_Place], within: float) -> tuple[_Place, str] | None:
        """The end to which the last three places lead, if what falls to 0 is that small."""
        if len(places) < 3:
            return None
        for name, size in places[-1].vanishing.items():
            sizes = [place.vanishing.get(name, 0.0) for place in places[-3:]]
            falling = sizes[0] > sizes[1] > sizes[2]
            measure = places[-1].amplitude if name in ("Bautin", "Hopf") else size
            if falling and measure < within and sizes[2] < 0.8 * sizes[0]:
                return self._limit(places[-3:], name), name
        return None

    def _passed(self, step: Step, before: _Place, after: _Place) -> Iterator[_Place]:
        """The places of named points that a step passes."""
        found = list[tuple[float, str]]()
        if self.kind == "fold" and before.opens * after.opens < 0:
            found += [(s, "cusp") for s in self._cusps(step)]
        if self.kind == "torus":
            for name, angle in (
                ("1:3 resonance", 2.0 * math.pi / 3.0),
                ("1:4 resonance", math.pi / 2),
            ):
                found += [(s, name) for s in self._resonances(step, angle)]
        if before.unstable != after.unstable:
            found += self._others(step, before, after)
        for s, name in sorted(found):
            place = self.place(step.problem, step.at(s))
            self.points.append(self._named(name, place))
            opens = 0 if name == "cusp" else place.opens
            yield replace(place, opens=opens, unstable=min(before.unstable, after.unstable))

    def _named(self, name: str, place: _Place) -> CyclePoint:
        x, y = self.plane.places(place.second, place.own)
        return CyclePoint(name, x, y, place.orbit.frequency * self.plane.order, place.amplitude)

    def _cusps(self, step: Step) -> Iterator[float]:
        """Arc lengths at which both numbers turn back at once."""

        def turning(s: float) -> Array:
            return np.array([step.at(s).tangent[-1]])

        if step.slopes[0] * step.slopes[1] < 0.0:
            for low, high in sign_changes(turning, 0.0, step.length, 1e-4 * step.length):
                yield 0.5 * (low + high)

    def _resonances(self, step: Step, angle: float) -> Iterator[float]:
        """Arc lengths at which the angle of a torus passes a value or its opposite."""

        def cosine(s: float) -> float:
            return math.cos(step.at(s).z[-2]) - math.cos(angle)

        if cosine(0.0) * cosine(step.length) < 0.0:
            yield float(scipy.optimize.brentq(cosine, 0.0, step.length, xtol=1e-8 * step.length))

    def _others(self, step: Step, before: _Place, after: _Place) -> Iterable[tuple[float, str]]:
        """Where other multipliers pass the unit circle, and what happens then."""

        @cache
        def rest(s: float) -> Complex:
            point = step.at(s)
            orbit = step.problem.orbit(point.z)
            return self._rest(self.plane.family.at(point.p), orbit, point.z)

        mirrored = after.orbit.symmetric
        known = {0.0: before.rest, step.length: after.rest}
        for low, high in sign_changes(
            lambda s: _growth(known[s] if s in known else rest(s)),
            *(0.0, step.length, 1e-4 * step.length),
        ):
            values = rest(high)
            kind, _ = crossing_event(values, mirrored, trivial=False)
            # Three multipliers that meet split by the cube root of their error.
            nearest = complex(values[int(np.argmin(np.abs(np.log(np.abs(values)))))])
            own = -1.0 if self.kind in ("pitchfork", "period doubling") else 1.0
            if self.kind != "torus" and abs(nearest - own) < 0.1:
                kind = self.kind
            pair = sorted((self.kind, kind), key=EVENTS.index)
            same: dict[str, str] = {
                "fold": "1:1 resonance",
                "pitchfork": "1:2 resonance",
                "torus": "double torus",
            }
            name = same.get(kind, "1:2 resonance") if pair[0] == pair[1] else "-".join(pair)
            yield 0.5 * (low + high), name
