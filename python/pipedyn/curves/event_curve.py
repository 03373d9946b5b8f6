# SPDX-License-Identifier: MIT
"""Curve of one event of cycles in the plane of two numbers, with the named points on it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Point
from pipedyn.continuation.tracer import TestFunction, Tracer, special_points
from pipedyn.curves.event_onset import Onset
from pipedyn.curves.event_plane import EVENTS, EventPlane, Followed
from pipedyn.curves.event_problem import EventProblem, event_angle
from pipedyn.cycles.limit_cycle import amplitude_of
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.floquet import CircleTest, beyond_circle, nontrivial, orbit_multipliers
from pipedyn.orbits.orbit_continuation import FINE, breaking_part, steps_from
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, resolved_orbit
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import Progress, share_of_way
from pipedyn.util.result import Result

LONGEST_EVENT_STEP = 0.08
"""Longest step, as a share of the second number's range, of the frequency or of the speed, or as a
change of the free end's amplitude in L. Cubics through the points then have no visible corners."""

MOST_EVENT_STEPS = 300
"""Most steps of a curve, either way: the longest cross the window 24 times."""

LEADING_TO_END = 0.1
"""Amplitude in L, or sine of a torus's angle, below which a curve is taken to lead to the point at
which this quantity is 0, if Newton's method fails on the way."""


@saved_as("CycleCurve")
class CycleCurve(Result):
    """An event of cycles, point by point along the curve.

    Attributes:
        kind: "fold", "pitchfork" (which breaks the mirror symmetry of cycles), "period doubling" or
            "torus".
        x, y: values of the two numbers, shape (S,).
        frequency: angular frequency of the cycle or, for a forced motion, of the forcing, in 1 / T,
            shape (S,).
        amplitude: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        multiplier: multiplier on the unit circle that makes the event, shape (S,): 1, or -1 at a
            period doubling; for a torus, the one of the pair with positive imaginary part.
        unstable: number of other multipliers outside the unit circle, shape (S,): where it is 0
            a stable cycle meets the curve.
        opens: at a fold, 1 where its two cycles exist at flow speeds (or frequencies of the
            forcing) above it, and -1 where they exist below; 0 at other events, shape (S,).
        onset: flow speed of the flutter of the straight pipe from which the branch of cycles comes,
            shape (S,), followed from the beginning of the branch as the other number changes. If
            the branch does not begin at flutter, it is the lowest speed at which the pipe becomes
            unstable, followed likewise. It is NaN for forced motions, beyond the fold at which the
            curve of onsets turns back over the other number, and if that curve bounds the stable
            region nowhere.
        ends: why the curve ends at its first and last point: "range" (it leaves the window),
            "closed", a kind of `CyclePoint`, "points" (it has too many) or "not converged" (no next
            point was found).
        orbits: solutions of the collocation equations, one for each point.
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
    """Point of an event's curve at which a second condition holds.

    Multipliers act over a period; for a cycle that is its own mirror image, they act over half a
    period followed by the reflection.

    Attributes:
        kind: "cusp" (two curves of folds meet); "Bautin" (a curve of folds ends where the
            criticality of flutter changes: the amplitude falls to 0); "Hopf" (the amplitude falls
            to 0 at an onset, on a curve of folds with drag or on a curve of other events);
            "degenerate pitchfork", "degenerate period doubling" (a curve of folds ends where it
            meets curves of these events); "1:1 resonance" and "1:2 resonance" (two multipliers are
            1 or two are -1: curves of tori end); "1:3 resonance", "1:4 resonance"; or the names of
            two events that happen at once, such as "fold-torus".
        x, y: values of the two numbers.
        frequency: angular frequency of the cycle or, for a forced motion, of the forcing.
        amplitude: amplitude of the cycle, in L; 0 at an onset.
    """

    kind: str
    x: float
    y: float
    frequency: float
    amplitude: float


EventStep = BranchStep[EventProblem]


@dataclass(frozen=True)
class _Cycle:
    """A cycle at the event, as a point of its curve.

    Attributes:
        z: unknowns of the `EventProblem`.
        second: value of the second parameter.
        own: value of the branch parameter: the flow speed or the frequency of the forcing.
        orbit: the cycle.
        amplitude: amplitude of the cycle, in L.
        rest: multipliers, or their roots, without those of the event.
        opens: as in `CycleCurve`.
        vanishing: sizes of quantities that are 0 where the curve may end, by that point's name.
        unstable: number of the multipliers in `rest` that are outside the unit circle.
    """

    z: Array = field(repr=False)
    second: float
    own: float
    orbit: PeriodicOrbit
    amplitude: float
    rest: Complex
    opens: int
    vanishing: dict[str, float]
    unstable: int


class EventFollower(Tracer[EventProblem]):
    """Tracer of the curve of one event.

    Args:
        plane: the plane of two numbers.
        kind: kind of the event.
        shown: whether progress is shown.
        onset: onset of the branch of cycles, None for forced motions.
    """

    near_limit = 0.01

    def __init__(
        self, plane: EventPlane, kind: Followed, shown: bool, onset: Onset | None = None
    ) -> None:
        second, (low, high) = plane.ranges[plane.second], plane.ranges[1 - plane.second]
        self.own = -3 if kind == "torus" else -2  # index of the branch parameter in z
        limits = [(-1, *second), (self.own, low / plane.order, high / plane.order)]
        super().__init__(limits, MOST_EVENT_STEPS)
        self.plane, self.kind, self.shown, self.onset = plane, kind, shown, onset
        self.points, self.failures = list[CyclePoint](), list[str]()
        self.places = list[_Cycle]()  # points in the direction that is followed
        self.steps = list[EventStep]()  # steps either way
        self.how = replace(FINE, longest=LONGEST_EVENT_STEP, tolerance=1e-6, stagnation=1e-5)

    def start(self, orbit: PeriodicOrbit) -> tuple[EventProblem, Point]:
        """The event near an orbit, with its equations, at the branch's value of the second number.

        Raises:
            NewtonFailed: if the event is not found.
        """
        motion, value = self.plane.at(self.plane.value), self.plane.value
        orbit = resolved_orbit(
            *(motion, orbit.states, orbit.frequency, orbit.u, orbit.symmetric), self.how.defect
        )
        extra = [value]
        if self.kind == "torus":
            extra.insert(0, event_angle(orbit_multipliers(motion, orbit)[1]))
        problem = EventProblem(self.plane, self.kind, orbit, np.array(extra), self.how)
        z = problem.fixed(problem.origin, value)
        found = problem.orbit(z)
        if abs(found.frequency / orbit.frequency - 1.0) > 0.02:
            raise NewtonFailed("Newton's method left the neighbourhood of the event")
        problem = problem.about(z)
        growing = np.append(np.zeros(z.size - 1), 1.0)
        return problem, problem.point(z, growing)

    def holds(self, place: _Cycle) -> bool:
        """Whether the curve that was followed passes through a cycle at the event."""
        return any(self._found_on(step, place) is not None for step in self.steps)

    def run(self, start: tuple[EventProblem, Point]) -> CycleCurve:
        """The curve of the event, followed both ways from a start."""
        problem, point = start
        ahead, last = self._one_way(problem, point)
        back, first = list[_Cycle](), last
        if last != "closed":
            back, first = self._one_way(problem, Point(point.z, -point.tangent))
        places = back[:0:-1] + ahead
        x, y = np.array([self.plane.places(place.second, place.own) for place in places]).T
        second = np.array([place.second for place in places])
        return CycleCurve(
            kind=self.kind,
            x=x,
            y=y,
            frequency=np.array([place.orbit.frequency * self.plane.order for place in places]),
            amplitude=np.array([place.amplitude for place in places]),
            multiplier=np.array([self._multiplier(place) for place in places]),
            unstable=np.array([place.unstable for place in places]),
            opens=np.array([place.opens for place in places]),
            onset=np.full(len(places), math.nan)
            if self.onset is None
            else self.onset.along(second),
            ends=(first, last),
            orbits=tuple(place.orbit for place in places),
        )

    def _multiplier(self, place: _Cycle) -> complex:
        """The multiplier that makes the event, with a positive imaginary part."""
        if self.kind != "torus":
            return complex(-1.0 if self.kind == "period doubling" else 1.0)
        root = complex(np.exp(1j * place.z[-2]))
        value = root**2 if place.orbit.symmetric else root
        return complex(value.real, abs(value.imag))

    def place(self, problem: EventProblem, point: Point) -> _Cycle:
        """A point of the curve, with its amplitude, other multipliers and further quantities."""
        orbit, second = problem.orbit(point.z), float(point.z[-1])
        motion = self.plane.at(second)
        own = orbit.frequency * self.plane.order if self.plane.forced else orbit.u
        opens = problem.opens(point.z) if self.kind == "fold" else 0
        rest = self.rest(motion, orbit, point.z)
        amplitude = amplitude_of(motion, orbit)[0]
        vanishing = {
            name: float(np.linalg.norm(odd)) for name, odd in self._odd(problem, point.z).items()
        }
        unstable = int(np.count_nonzero(beyond_circle(rest) > 0.0))
        return _Cycle(point.z, second, own, orbit, amplitude, rest, opens, vanishing, unstable)

    def rest(self, motion: VectorField, orbit: PeriodicOrbit, z: Array) -> Complex:
        """Multipliers without those of the event.

        For a cycle that is its own mirror image, the roots over half a period replace multipliers.
        """
        _, roots, _ = orbit_multipliers(motion, orbit)
        rest = roots if self.plane.forced else nontrivial(roots)
        gone = {"fold": [1.0], "torus": [np.exp(1j * z[-2]), np.exp(-1j * z[-2])]}
        for value in gone.get(self.kind, [-1.0]):
            rest = np.delete(rest, int(np.argmin(np.abs(rest - value))))
        return rest

    # ------------------------------------------------------------------------------- one way

    def _one_way(self, problem: EventProblem, point: Point) -> tuple[list[_Cycle], str]:
        """Points of the curve from a given one to its end, and why it ends there."""
        places = self.places = [self.place(problem, point)]
        steps = steps_from(problem, point, 0.25 * self.how.longest)
        begin = self.plane.places(places[0].second, places[0].own)

        def share(step: EventStep) -> float:
            here = self.plane.places(step.end.p, float(step.end.z[self.own]) * self.plane.order)
            ways = zip(begin, here, self.plane.ranges, strict=True)
            return max(share_of_way(first, value, *ends) for first, value, ends in ways)

        with Progress(f"{self.kind} in the plane", self.shown) as progress:
            _, end, reason = self.one_way(progress.steps(steps, share), problem, point)
        if end == "not converged" and (name := self._near_end()) is not None:
            return places, name
        if end in ("points", "not converged"):
            self._failed(places[-1], reason)
        return places, end

    def note(self, step: EventStep) -> str | None:
        """Keeps the end of a step and the named points on it; returns why the curve ends."""
        places = self.places
        if (name := self._ending(step)) is not None:
            return name
        self.steps.append(step)
        if len(places) > 3 and (last := self._found_on(step, places[0])):
            places += [*self._passed(step, places[-1], last), places[0]]
            return "closed"
        here = self.place(step.problem, step.end)
        places += [*self._passed(step, places[-1], here), here]
        return None

    def _failed(self, place: _Cycle, reason: str) -> None:
        x, y = self.plane.places(place.second, place.own)
        self.failures.append(
            f"the {self.kind} was not followed beyond ({x:.6g}, {y:.6g}): {reason}"
        )

    def _found_on(self, step: EventStep, place: _Cycle) -> _Cycle | None:
        """A point of the curve, computed again on a step that passes it; else None."""
        low, high = sorted((step.begin.p, step.end.p))
        if not low <= place.second <= high:
            return None
        own = [self.plane.order * p.z[self.own] for p in (step.begin, step.end)]
        if min(abs(value / place.own - 1.0) for value in own) > 0.1:
            return None
        try:
            found = step.where(place.second)
        except NewtonFailed:
            return None
        here = self.place(step.problem, Point(found, step.end.tangent))
        same = abs(here.own / place.own - 1.0) < 1e-6
        same = same and abs(here.orbit.frequency / place.orbit.frequency - 1.0) < 1e-6
        return here if same and abs(here.amplitude / place.amplitude - 1.0) < 1e-4 else None

    # --------------------------------------------------------------------------- named points

    def _odd(self, problem: EventProblem, z: Array) -> dict[str, Array]:
        """Quantities that change sign at an end of the curve, by the name of that point.

        Each is an odd function of the distance from that point: the cycle itself, whose amplitude
        falls to 0, the part of the cycle that breaks a symmetry, or the sine of a torus's angle.
        """
        if self.kind == "torus":
            angle = float(z[-2])
            name = "1:2 resonance" if round(angle / math.pi) % 2 else "1:1 resonance"
            return {name: np.array([math.sin(angle)])}
        orbit, kinds = problem.orbit(z), dict[str, str]()
        if not self.plane.forced:
            drag = self.plane.at(float(z[-1])).model.pipe.drag
            kinds["hopf"] = "Hopf" if drag or self.kind != "fold" else "Bautin"
        if not orbit.symmetric and self.kind == "fold":
            kinds["period doubling"] = "degenerate period doubling"
            if problem.motion.is_odd(orbit.u):
                kinds["pitchfork"] = "degenerate pitchfork"
        return {name: breaking_part(orbit, kind) for kind, name in kinds.items()}

    def _ending(self, step: EventStep) -> str | None:
        """Kind of the point at which the curve ends, if a step passes it; the point is kept."""
        problem = step.problem
        begin, end = (self._odd(problem, point.z) for point in (step.begin, step.end))
        for name in begin.keys() & end.keys():
            here, there = begin[name], end[name]
            if float(np.sum(here * there)) >= 0.0:
                continue
            before, after = float(np.linalg.norm(here)), float(np.linalg.norm(there))
            meeting = step.length * before / (before + after)
            near = [step.begin, *(step.at(share * meeting) for share in (0.4, 0.7))]
            return self._ends_at([self.place(problem, point) for point in near], name)
        return None

    def _ends_at(self, near: list[_Cycle], name: str) -> str:
        """Keeps the named end of the curve, extrapolated from three points; returns its name."""
        self.places.append(self._limit(near, name))
        self.points.append(self._named(name, self.places[-1]))
        return name

    def _limit(self, places: list[_Cycle], name: str) -> _Cycle:
        """The point at which a quantity is 0, extrapolated from three points at which it falls.

        The two numbers are extrapolated as functions of the square of this quantity; at a point
        named "Hopf", as functions of the quantity itself.
        """
        power = 1 if name == "Hopf" else 2
        sizes = np.array([place.vanishing[name] for place in places]) ** power
        second, own = (
            float(np.polyval(np.polyfit(sizes / sizes[0], values, 2), 0.0))
            for values in ([p.second for p in places], [p.own for p in places])
        )
        last = places[-1]
        # An extrapolated point may lie beyond an edge of the window, where there may be no pipes.
        low, high = self.plane.ranges[self.plane.second]
        second = min(max(second, low), high)
        orbit = last.orbit if self.plane.forced else replace(last.orbit, u=own)
        amplitude = 0.0 if name in ("Bautin", "Hopf") else last.amplitude
        return replace(last, second=second, own=own, orbit=orbit, amplitude=amplitude)

    def _near_end(self) -> str | None:
        """Name of the end to which the last three points lead; None if they lead to no end.

        The quantity that falls to 0 at this end is below `LEADING_TO_END`. The end is kept.
        """
        near = self.places[-3:]
        for name, size in near[-1].vanishing.items() if len(near) == 3 else ():
            sizes = [place.vanishing.get(name, 0.0) for place in near]
            falling = sizes[0] > sizes[1] > sizes[2]
            measure = near[-1].amplitude if name in ("Bautin", "Hopf") else size
            if falling and measure < LEADING_TO_END and sizes[2] < 0.8 * sizes[0]:
                return self._ends_at(near, name)
        return None

    def _passed(self, step: EventStep, before: _Cycle, after: _Cycle) -> Iterator[_Cycle]:
        """Points of the curve at named points that a step passes; the named points are kept."""
        tests = list[TestFunction]()
        if self.kind == "torus":
            # The angle passes 120 or 90 degrees, or minus that.
            for name, cosine in (("1:3 resonance", -0.5), ("1:4 resonance", 0.0)):

                def apart(point: Point, cosine: float = cosine) -> float:
                    return math.cos(point.z[-2]) - cosine

                tests.append(TestFunction(step, 1e-8 * step.length, apart, name))
        place_at = cache(lambda s: self.place(step.problem, step.at(s)))
        if before.unstable != after.unstable:
            known = {0.0: beyond_circle(before.rest), step.length: beyond_circle(after.rest)}

            def values(point: Point) -> Array:
                motion, orbit = self.plane.at(point.p), step.problem.orbit(point.z)
                return beyond_circle(self.rest(motion, orbit, point.z))

            def two_events(before: float, beyond: float) -> str:
                return self._two_events(others.kind(before, beyond), place_at(beyond))

            given = step, 1e-6 * step.length, values, two_events, known
            tests.append(others := CircleTest(*given, roots=lambda s: place_at(s).rest))
        # At a cusp both parameters turn back.
        cusps = self.kind == "fold" and before.opens * after.opens < 0
        for found, _, s in special_points(step, 1e-6 if cusps else 0.0, tests):
            place, name = place_at(s), "cusp" if found == "fold" else found
            self.points.append(self._named(name, place))
            opens = 0 if name == "cusp" else place.opens
            yield replace(place, opens=opens, unstable=min(before.unstable, after.unstable))

    def _two_events(self, second: str, place: _Cycle) -> str:
        """Name of a point at which a second event happens at once."""
        own, values = self.kind, place.rest
        # Where three multipliers meet, errors move them by the cube root of their size.
        nearest = complex(values[int(np.argmin(np.abs(np.log(np.abs(values)))))])
        root = -1.0 if own in ("pitchfork", "period doubling") else 1.0
        if own != "torus" and abs(nearest - root) < 0.1:
            second = own
        if second != own:
            return "-".join(sorted((own, second), key=list[str](EVENTS).index))
        same = {"fold": "1:1 resonance", "torus": "double torus"}
        return same.get(own, "1:2 resonance")

    def _named(self, name: str, place: _Cycle) -> CyclePoint:
        x, y = self.plane.places(place.second, place.own)
        return CyclePoint(name, x, y, place.orbit.frequency * self.plane.order, place.amplitude)
