# SPDX-License-Identifier: MIT
"""Continuation of periodic orbits in the flow speed, past folds.

A branch begins at a Hopf point, at an orbit that loses its symmetry or doubles its period, or at
any orbit. The mesh is refined and coarsened on the way. Every function that solves for an orbit
raises `NewtonFailed` if there is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice, product
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import EVERY, BranchStep, Point
from pipedyn.continuation.tracer import between_folds, reason_of
from pipedyn.equilibrium.hopf import Hopf, HopfPoint
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import OrbitControl, OrbitProblem, solved
from pipedyn.orbits.periodic_orbit import (
    COARSEST,
    MOST_CYCLE_INTERVALS,
    PROBES,
    PeriodicOrbit,
    coarsest_mesh,
    divided,
    refined,
    resolved_orbit,
    stage_phases,
    stop_contacts,
)
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed, zero_between

FIRST_AMPLITUDE, LEAST_AMPLITUDE, LARGEST_AMPLITUDE = 0.01, 1e-4, 0.3
"""Amplitude in L of the free end after a branch's first step, the least that is tried, and the
largest on the way to a speed: the normal form holds to a per cent or better at the first, to a
tenth at the largest, and rounding is far below the least."""

MOST_ON_BRANCH = 250
"""Largest number of mesh intervals of an orbit on a branch: 2,000 stages, with which each orbit
takes seconds."""

MOST_EVALUATIONS = 100_000
"""Number of right-hand sides and Jacobians after which no more steps are taken on the way to a
speed: they alone take 1 s for a chain of 20 segments, half a minute for one of 100."""

MOST_ON_THE_WAY, TOO_LONG = 60, "it takes too many steps"
"""Largest number of steps on the way to a speed, the longest of which change the amplitude by up to
18 L together; and why a branch is given up after the last, or after `MOST_EVALUATIONS`."""

FINE = OrbitControl(0.15, tolerance=1e-8, stagnation=1e-5, defect=1e-4, patience=2)
"""Control for diagrams: amplitudes are good to 1e-9 and multipliers to 1e-8, under drag to some
2e-5 and 5e-5."""

COARSE = OrbitControl(0.3, tolerance=3e-4, stagnation=1e-2, defect=1e-3)
"""Control for the search for a cycle: orbits are near enough for Newton's method on the finer
meshes that follow. A last step of the size of the tolerance leaves an error of its square, some
1e-7."""

PAST_STOP, GRAZING, MOST_CONTACTS, MOST_GRAZES = 3e-4, 3e-2, 3, 8
"""Distance beyond a grazed stop at which a branch goes on, relative to its parameter; distance from
the stop within which its orbits come before, relative to their size; number of extrema near the
stop that are tried; and largest number of times that a branch may graze."""

SYMMETRY_ROUNDING = 1e-9
"""Share of an orbit's size below which the part that breaks a symmetry is rounding: the last steps
of Newton's method are 1e-8 at most, and leave an error of their square."""

NEAR_FOLD = 0.02
"""Share of a step around a fold in which the multiplier of the fold is too near to the trivial one:
measured at five folds, both are 1e-5 from 1 at the fold; at this distance the former is 9e-4 to 0.1
from 1, the latter 3e-5 at most."""

Step = BranchStep[OrbitProblem]
"""A step along a branch of orbits."""


def orbit_at(step: Step, s: float) -> PeriodicOrbit:
    """The orbit at an arc length from the beginning of a step."""
    return step.problem.orbit(step.at(s).z)


def solved_anew(
    motion: VectorField,
    states: Callable[[Array], Array],
    frequency: float,
    u: float,
    symmetric: bool,
    how: OrbitControl,
    iterations: int = OrbitControl.iterations,
    hopeless: float = math.inf,
    from_samples: bool = False,
) -> PeriodicOrbit:
    """The periodic orbit near states at a speed, on as coarse a mesh as resolves it.

    The states [p, p'] are a function of phases, (k,), to (2 integrated, k). `iterations` and
    `hopeless` are as for `solved`, which a first step of four times that ends as well;
    `from_samples` is as for `interpolated`.
    """
    guess = resolved_orbit(motion, states, frequency, u, symmetric, how.defect, from_samples)
    if len(guess.starts) > MOST_CYCLE_INTERVALS:
        raise NewtonFailed(f"more than {MOST_CYCLE_INTERVALS} mesh intervals are needed")
    return solved(motion, guess, how.tolerance, iterations, hopeless, 4.0 * hopeless)


# --------------------------------------------------------------------------------- beginnings


@dataclass(frozen=True)
class BranchStart:
    """The beginning of a branch."""

    orbit: PeriodicOrbit  # equilibrium or orbit from which the branch sets out
    towards: Array = field(repr=False)  # direction and length of the first step
    speeds: tuple[float, float] = (0.0, math.inf)  # speeds between which the first step ends


def from_hopf(
    motion: VectorField,
    point: HopfPoint,
    amplitude: float = FIRST_AMPLITUDE,
    u: float | None = None,
) -> BranchStart:
    """The start of a branch at a Hopf point, with a first step to an amplitude of the free end.

    The step ends at a speed within 1e-3, relative, of the Hopf point's or, if another speed u is
    given, up to half as far again as u.
    """
    edges = coarsest_mesh(not point.rest.any() and motion.is_odd(point.speed))
    turn = np.exp(1j * stage_phases(edges))[..., None]
    starts = (point.mode * np.exp(1j * edges[:-1])[:, None]).real
    # Accelerations are those of the mode, not those of the forces, which differ much at large
    # amplitudes.
    rates = (1j * point.frequency * point.mode[motion.half :] * turn).real
    still = point.rest + np.zeros_like(starts), np.zeros_like(rates)
    base = PeriodicOrbit(edges, *still, point.frequency, point.speed)
    mode = np.concatenate([starts.ravel(), rates.ravel(), [0.0, 0.0]])
    ends = [0.999 * point.speed, 1.001 * point.speed]
    if u is not None:
        ends.append(point.speed + 1.5 * (u - point.speed))
    return BranchStart(base, amplitude * mode, (min(ends), max(ends)))


def from_branch_point(
    motion: VectorField,
    orbit: PeriodicOrbit,
    root: float = -1.0,
    among: slice | NDArray[np.intp] = EVERY,
) -> BranchStart:
    """The start of the branch that leaves an orbit in its neutral direction.

    With the root -1 the branch loses the symmetry of this orbit or, if it has none, doubles its
    period; with the root 1 it keeps both, and leaves a plane or another symmetry. among: entries
    of the first state that change.
    """
    equations = OrbitProblem(motion, orbit, FINE).about_orbit(orbit)
    direction = equations.neutral(root, among)
    if root < 0.0:  # in the second half it has the opposite sign, relative to the orbit's motion
        direction, orbit = orbit.unpacked(direction).doubled(-1.0).packed(), orbit.doubled()
    length = OrbitProblem(motion, orbit, FINE).length(direction)
    return BranchStart(orbit, FIRST_AMPLITUDE / length * direction)


def both_ways(motion: VectorField, orbit: PeriodicOrbit) -> list[BranchStart]:
    """Starts of the branch through an orbit, towards lower and towards higher speed."""
    states, frequency = orbit.states, orbit.frequency
    orbit = solved_anew(motion, states, frequency, orbit.u, orbit.symmetric, FINE)
    return from_orbit(motion, orbit, (-1.0, 1.0))


def from_orbit(
    motion: VectorField, orbit: PeriodicOrbit, ways: Sequence[float]
) -> list[BranchStart]:
    """Starts from an orbit on its own mesh: its parameter grows if a way is > 0, else it falls."""
    z = orbit.packed()
    growing = np.append(np.zeros(z.size - 1), 1.0)
    tangent = OrbitProblem(motion, orbit, FINE).point(z, growing).tangent
    return [BranchStart(orbit, math.copysign(0.2 * FINE.longest, way) * tangent) for way in ways]


GRAZES = "grazes a stop, or a velocity of 0 at which drag has a kink,"
"""What an orbit does where it begins or ceases to pass a kink of the forces."""


@dataclass(frozen=True)
class Grazing:
    """A place where orbits begin or cease to touch a stop, with the way on for their branch.

    Attributes:
        start: start of the branch on the other side.
        middle: the last orbit before, with its parameter replaced by the mean of its own and that
            of the first orbit beyond.
        error: error of the mean parameter.
    """

    start: BranchStart
    middle: PeriodicOrbit
    error: float


def _with_parameter(orbit: PeriodicOrbit, p: float) -> PeriodicOrbit:
    """An orbit with another value of its branch's parameter: its frequency if it is forced."""
    return replace(orbit, frequency=p) if orbit.forced else replace(orbit, u=p)


def past_grazing(motion: VectorField, last: Step) -> Grazing | None:
    """The grazing beyond the end of a step, if the orbit there touches or nearly touches a stop.

    There the branch turns within a distance in which no mesh that spans both sides resolves it: the
    orbit on the other side is solved for at a parameter nearby, on a mesh with a point at the stop.

    Raises:
        NewtonFailed: if there is a stop, and no orbit is found beyond it.
    """
    here = orbit_at(last, last.length)
    contacts, before = (stop_contacts(motion, one) for one in (here, orbit_at(last, 0.0)))
    near = np.flatnonzero(np.abs(contacts.beyond) <= GRAZING * here.size)
    if not near.size:
        return None
    p, way = last.end.p, math.copysign(1.0, last.slopes[1])
    nearest = near[np.argsort(np.abs(contacts.beyond[near]))][:MOST_CONTACTS]
    # The step may have gone a little beyond the stop; the branch goes on to the side opposite to
    # that from which the step came.
    crosses = (contacts.beyond[nearest] > 0.0) == (contacts.crossings == before.crossings)
    changes = dict.fromkeys((contacts.outward[nearest] != crosses).tolist())  # each is tried once
    for larger, share in product(changes, (way * PAST_STOP, -way * PAST_STOP)):
        beyond = _with_parameter(here, p * (1.0 + share))
        try:
            orbit = beside_kink(motion, beyond, 1.0 if larger else -1.0)
        except NewtonFailed:
            continue
        passed = stop_contacts(motion, orbit).crossings != before.crossings
        if passed and abs(orbit.size / here.size - 1.0) <= 0.05:
            (start,) = from_orbit(motion, orbit, (share,))
            middle = _with_parameter(here, p * (1.0 + 0.5 * share))
            return Grazing(start, middle, 0.5 * abs(share) * p)
    raise NewtonFailed(f"it {GRAZES} there, and no orbit was found beyond")


def beside_kink(motion: VectorField, orbit: PeriodicOrbit, way: float) -> PeriodicOrbit:
    """The larger orbit at the parameter of a given one, or the smaller one if way < 0.

    It is solved for from increasing changes of the size, on meshes with a point wherever a force
    begins; raises NewtonFailed if none leads to an orbit.
    """
    reason, mean = NewtonFailed(""), np.zeros((2 * orbit.half, 1))
    if not orbit.symmetric:
        mean = orbit.states(PROBES).mean(axis=1, keepdims=True)
    for share in (1e-3, 3e-3, 1e-2):

        def states(phase: Array, factor: float = 1.0 + way * share) -> Array:
            return np.asarray(mean + factor * (orbit.states(phase) - mean))

        guess = resolved_orbit(
            motion, states, orbit.frequency, orbit.u, orbit.symmetric, FINE.defect
        )
        try:
            for _ in range(4):
                once = np.ones(len(guess.starts), dtype=np.int_)
                guess = solved(motion, refined(motion, guess, once, at_kinks=True), FINE.tolerance)
            return guess
        except NewtonFailed as failure:
            reason = failure
    raise reason


def _first_step(motion: VectorField, start: BranchStart, how: OrbitControl) -> Step:
    """The first step of a branch, shortened until its orbit is resolved and within the speeds."""
    begin, towards = start.orbit.packed(), start.towards
    low, high = start.speeds
    while True:
        # With this small start the orbits on the way may be from 0.15 % to 150 % of the first one.
        problem = OrbitProblem(motion, start.orbit.unpacked(begin + 0.05 * towards), how)
        length = problem.length(towards)
        try:
            end = problem.at(problem.starting(begin, towards), length)
            is_resolved = (problem.orbit(end.z).defects() <= COARSE.defect).all()
            if (low <= end.p <= high and is_resolved) or length <= LEAST_AMPLITUDE:
                return BranchStep(problem, problem.starting(begin, end.z - begin), end)
        except NewtonFailed:
            if length <= LEAST_AMPLITUDE:
                raise
        towards = 0.3 * towards


def breaking_part(orbit: PeriodicOrbit, kind: str) -> Array:
    """The part of an orbit that vanishes where its branch meets another, (k, integrated).

    The other branch is of equilibria ("hopf"), of orbits that are their own mirror images
    ("pitchfork"), of orbits with half the period ("period doubling") or, in three dimensions, of
    orbits in the plane z = 0 ("z") or x = 0 ("x"), or of those that half a period later are their
    mirror images in the plane z = 0 ("image").
    """
    p = orbit.states(PROBES)[: orbit.half].T
    if kind == "hopf":
        return p if orbit.symmetric else p - p.mean(axis=0)
    if kind in ("x", "z"):
        return np.split(p, 2, axis=1)[int(kind == "z")]
    later = np.roll(p, -PROBES.size // 2, axis=0)
    if kind == "image":
        return 0.5 * (p - later * np.repeat([1.0, -1.0], orbit.half // 2))
    return 0.5 * (p + later if kind == "pitchfork" else p - later)


@dataclass(frozen=True)
class Meeting:
    """A point where a branch of orbits ends on equilibria or on another branch of orbits.

    Two solutions meet there, which no corrector tells apart, so the point is not solved for.

    Attributes:
        whole: the step up to an orbit near the meeting.
        last: the step from that orbit to the meeting.
        error: error of the parameter at the meeting.
        known: whether the parameter is one at which branches are known to begin.
    """

    whole: Step
    last: Step
    error: float
    known: bool


def meeting(step: Step, kind: str, beginnings: Array, within: float) -> Meeting | None:
    """The meeting on a step, if the part of the orbits that vanishes at it changes its sign.

    By symmetry the parameter changes with the square of this part.

    Args:
        step: step whose orbits beyond the meeting are the opposites of those before.
        kind: kind of the meeting, see `breaking_part`.
        beginnings: parameters at which branches are known to leave the other one, shape (k,). If
            one of them is near enough to the extrapolated parameter, it is taken.
        within: largest relative difference of the two.

    Raises:
        NewtonFailed: if the step ends on orbits of the other branch, in which the part that breaks
            their symmetry is only rounding.
    """

    def part(z: Array) -> Array:
        return breaking_part(step.problem.orbit(z), kind)

    first, end = part(step.begin.z), part(step.end.z)
    if float(np.abs(end).max()) < SYMMETRY_ROUNDING * step.problem.orbit(step.end.z).size:
        raise NewtonFailed("a step went over to orbits of more symmetry")
    if not np.sum(first * end) < 0.0:
        return None

    def left(s: float) -> float:
        """Remaining share of the part that vanishes, by a cubic through the ends of the step."""
        return float(np.sum(first * part(step.guess(s))) / np.sum(first * first))

    def where(share: float, low: float, high: float) -> float:
        """Arc length at which a given share of the part remains."""
        if not (left(low) > share) or not (left(high) < share):
            raise NewtonFailed("it comes near to orbits of more symmetry, and the step is too long")
        return zero_between(lambda s: left(s) - share, low, high)

    def with_left(share: float) -> Point:
        return step.at(where(share, 0.0, where(0.0, 0.0, step.length)))

    points = step.begin, with_left(0.4), with_left(0.1)
    small = points[2]
    squares = [float(np.sum(part(one.z) ** 2)) for one in points]
    rough, p = (
        small.p + squares[2] * (small.p - one.p) / (square - squares[2])
        for one, square in zip(points[:2], squares[:2], strict=True)
    )
    error, known = abs(p - rough) + 1e-9, False
    if beginnings.size:
        nearest = float(beginnings[np.argmin(np.abs(beginnings - p))])
        if abs(nearest - p) <= within * p:
            p, error, known = nearest, 1e-6, True
    through = where(0.0, step.reach(small.z), step.length)
    z, beside = step.guess(through), 1e-3 * step.length
    onward = step.guess(through + beside) - step.guess(through - beside)
    if onward[-1] * small.tangent[-1] < 0.0:  # e.g. where the opposite of an orbit is one, too
        onward[-1] = 0.0
    z[-1] = p
    problem = step.problem.about(small.z)
    last = BranchStep(problem, small, problem.starting(z, onward))
    return Meeting(replace(step, end=small), last, error, known)


AnyOrbitProblem = TypeVar("AnyOrbitProblem", bound=OrbitProblem)


# -------------------------------------------------------------------------- following branches


def branch_steps(motion: VectorField, start: BranchStart, how: OrbitControl) -> Iterator[Step]:
    """Steps along a branch of orbits, past folds, in an endless iterator."""
    step = _first_step(motion, start, how)
    yield step
    yield from steps_from(step.problem, step.end, 1.5 * min(0.2 * how.longest, step.length))


def steps_past_grazing(
    motion: VectorField, start: BranchStart, how: OrbitControl, note: Callable[[Grazing], None]
) -> Iterator[Step]:
    """Steps along a branch of orbits, past places where they begin or cease to touch a stop.

    note: is called with each of these places, before the first step beyond it.
    """
    for _ in range(MOST_GRAZES + 1):
        last: Step | None = None
        try:
            for last in branch_steps(motion, start, how):
                yield last
        except NewtonFailed:
            grazing = None if last is None else past_grazing(motion, last)
            if grazing is None:
                raise
            note(grazing)
            start = grazing.start
    raise NewtonFailed(f"its orbits graze stops more than {MOST_GRAZES} times")


def steps_from(
    problem: AnyOrbitProblem, point: Point, length: float
) -> Iterator[BranchStep[AnyOrbitProblem]]:
    """Endless steps from a solution onwards, the first of at most a given length.

    The mesh is adapted: `defect` of the problem's control is the largest defect allowed.
    """
    defect, tangent = cast(OrbitControl, problem.control).defect, point.tangent
    problem, ahead = problem.about(point.z), cast("Callable[[float], Array] | None", None)
    while True:
        here = problem.start
        # An interval twice as long has some 2^8 times the defect. The mesh is changed only if that
        # saves at least a quarter of the intervals.
        if np.count_nonzero(here.defects() <= 1e-3 * defect) > 2 * COARSEST:
            edges = resolved_orbit(
                *(problem.motion, here.states, here.frequency, here.u, here.symmetric), defect
            ).edges
            if edges.size < 0.75 * here.edges.size:
                (problem, tangent), ahead = _on_mesh(problem, tangent, edges), None
        while True:
            if ahead is not None:  # the orbit ahead shows what mesh the step needs
                there = ahead(length)
                guess = problem.orbit(there)
                coarse = (guess.defects() > defect) & (guess.u >= 0.0)
                edges = divided(problem.start.edges, 1 + coarse)
                if coarse.any() and edges.size <= MOST_ON_BRANCH:
                    (problem, tangent), ahead = _on_mesh_to(problem, tangent, there, length, edges)
            begin = problem.starting(problem.origin, tangent)
            step, following = problem.next(begin, length, ahead)
            defects = problem.orbit(step.end.z).defects()
            if defects.max() <= defect:
                break
            edges = divided(problem.start.edges, 1 + (defects > defect))
            if edges.size > MOST_ON_BRANCH:
                raise NewtonFailed(f"more than {MOST_ON_BRANCH} mesh intervals are needed")
            length = step.length
            (problem, tangent), ahead = _on_mesh_to(problem, tangent, step.end.z, length, edges)
        yield step
        problem, tangent = problem.about(step.end.z), step.end.tangent
        length, ahead = following, step.ahead


def _on_mesh(
    problem: AnyOrbitProblem, tangent: Array, edges: Array
) -> tuple[AnyOrbitProblem, Array]:
    """The problem about its start, transferred to another mesh, with the tangent there.

    Neither is solved for on the new mesh: the next step corrects both, and its guess is as near
    either way.
    """
    z, beside = problem.origin, 1e-4
    here, moved = problem.about(z, edges), problem.transferred(z + beside * tangent, edges)
    return here, (moved - here.origin) / beside


def _on_mesh_to(
    problem: AnyOrbitProblem, tangent: Array, there: Array, length: float, edges: Array
) -> tuple[tuple[AnyOrbitProblem, Array], Callable[[float], Array]]:
    """The problem on another mesh, with the parabola that gives a guess for the next point.

    there: the guess at an arc length on the old mesh.
    """
    there = problem.transferred(there, edges)
    finer, tangent = _on_mesh(problem, tangent, edges)
    z, slope = finer.origin, tangent
    bend = ((there - z) / length - slope) / length
    return (finer, tangent), lambda s: z + s * (slope + s * bend)


def _soon_beyond(step: Step, u: float) -> PeriodicOrbit | None:
    """The orbit at a speed that the predictor beyond a step reaches within the longest next step.

    None is returned if it does not, or if Newton's method does not converge fast from there: it may
    then lead to an orbit of another branch, or to one of a mesh that is too coarse.
    """
    longest = min(1.5 * step.length, COARSE.longest)
    if (step.end.p - u) * (step.ahead(longest)[-1] - u) > 0.0:
        return None
    s = zero_between(lambda s: float(step.ahead(s)[-1]) - u, 0.0, longest)
    motion, guess = step.problem.motion, replace(step.problem.orbit(step.ahead(s)), u=u)
    guess = refined(motion, guess, 1 + (guess.defects() > COARSE.defect))
    with suppress(NewtonFailed):
        return solved(motion, guess, COARSE.tolerance, iterations=3, hopeless=COARSE.tolerance)
    return None


def orbit_at_speed(motion: VectorField, point: Hopf, u: float) -> PeriodicOrbit:
    """The orbit at a speed on the branch from a Hopf point; NewtonFailed says why if none."""
    amplitude = FIRST_AMPLITUDE
    with suppress(ValueError):  # one step may do, within the range of the amplitude equation
        amplitude = min(1.05 * point.amplitude(u) or FIRST_AMPLITUDE, LARGEST_AMPLITUDE)
    last_evaluation = motion.evaluations + MOST_EVALUATIONS
    turns, here, reason = list[float](), point.speed, TOO_LONG
    steps = branch_steps(motion, from_hopf(motion, point, amplitude, u), COARSE)
    try:
        for step in islice(steps, MOST_ON_THE_WAY):
            first, last = step.slopes
            # The branch turns back before the speed, or just beyond it.
            turned = first * last < 0.0 and first * (u - here) > 0.0
            parts = between_folds(step, 1e-3) if turned else [step]
            turns += [part.begin.p for part in parts[1:]]
            for part in parts:
                if (part.begin.p - u) * (part.end.p - u) <= 0.0:
                    return step.problem.orbit(part.where(u))
            here = step.end.p
            before, after = (breaking_part(orbit_at(step, s), "hopf") for s in (0.0, step.length))
            if np.sum(before * after) < 0.0:
                reason = f"its amplitude falls to 0 near u = {here:.6g}"
                break
            if not 0.5 * min(u, point.speed) < here < 1.5 * max(u, point.speed):
                reason = f"it leads to u = {here:.6g}"
                break
            if motion.evaluations > last_evaluation:
                break
            if (orbit := _soon_beyond(step, u)) is not None:
                return orbit
    except NewtonFailed as error:
        reason = f"it could not be followed beyond u = {here:.6g}: {reason_of(error)}"
    report = f"does not reach u = {u:g}: {reason}"
    turn = min(turns, key=lambda turn: abs(turn - u), default=None)
    if turn is not None and (turn < point.speed) == (u < point.speed):
        report = f"reaches {'down' if u < turn else 'up'} to u = {turn:.6g} only"
    raise NewtonFailed(f"the cycle of the Hopf point at u = {point.speed:.6g} {report}")
