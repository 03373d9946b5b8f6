# SPDX-License-Identifier: MIT
"""Continuation of periodic orbits in the flow speed, past folds.

A branch begins at a Hopf point, where an orbit loses its symmetry or doubles its period, or at any
orbit. The mesh is refined and coarsened on the way. Whatever solves for an orbit raises
`NewtonFailed` where there is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from pipedyn.bifurcation.collocation import OrbitProblem, control, solved
from pipedyn.bifurcation.continuation import Continuation, Control, Point, Segment, folds
from pipedyn.bifurcation.hopf import Hopf, HopfPoint
from pipedyn.bifurcation.periodic_orbit import (
    COARSEST,
    PeriodicOrbit,
    coarsest_mesh,
    divided,
    interpolated,
    resolved,
    stage_phases,
)
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed

SMALL, SMALLEST, LARGEST = 0.01, 1e-4, 0.3
"""Distance in L of the free end at which a branch's first orbit lies from what it leaves, the least
that is tried, and the largest on the way to a speed: the normal form holds at the first to a per
cent or better, at the last to a tenth, and rounding is far below the least."""

MOST_INTERVALS = 250
"""Mesh intervals of an orbit on a branch: 2,000 stages, with which orbits take seconds each."""

PROBES: Array = np.linspace(0.0, 2.0 * math.pi, 65)[:-1]
"""Phases at which orbits are compared: enough for the harmonics that matter for a sign."""

MOST_EVALUATIONS = 100_000
"""Right-hand sides and Jacobians after which no more steps are taken on the way to a speed: they
alone take 1 s of a chain of 20 segments, half a minute of one of 100."""


@dataclass(frozen=True)
class OrbitControl:
    """How branches of orbits are followed."""

    control: Control  # of steps, in L of the free end and relative in speed and frequency
    defect: float  # the largest of an orbit


FINE = OrbitControl(control(0.15, 1e-8), 1e-4)
"""For diagrams: amplitudes are then good to 1e-9 and multipliers to 1e-8, under drag to some 2e-5
and 5e-5."""

COARSE = OrbitControl(control(0.3, 1e-5), 1e-3)
"""On the way to a speed: the orbit there is solved for again on finer meshes."""


# ---------------------------------------------------------------------------- where it begins


@dataclass(frozen=True)
class BranchStart:
    """Where a branch begins."""

    orbit: PeriodicOrbit  # the first
    towards: Array = field(repr=False)  # a direction; from the base, if any, up to the first
    base: PeriodicOrbit | None = None  # what it leaves, at rest or periodic, on the same mesh


def from_hopf(
    motion: VectorField, point: HopfPoint, amplitude: float = SMALL, reach: float = math.inf
) -> BranchStart:
    """At an amplitude of the free end, or a smaller one where that has no orbit or is too far away.

    The orbit's speed may differ from the Hopf point's by 1e-3, relative, or by up to `reach` where
    that is finite, to the same side; and the coarsest mesh must resolve the orbit.
    """
    edges = coarsest_mesh(not point.rest.any() and motion.is_odd(point.speed))
    turn = np.exp(1j * stage_phases(edges))[..., None]
    starts = (point.mode * np.exp(1j * edges[:-1])[:, None]).real
    # Those of the mode and not of the forces, which at large amplitudes are far from them.
    rates = (1j * point.frequency * point.mode[-motion.width :] * turn).real
    still = point.rest + np.zeros_like(starts), np.zeros_like(rates)
    base = PeriodicOrbit(edges, *still, point.frequency, point.speed)

    def is_near(orbit: PeriodicOrbit) -> bool:
        away = orbit.u - point.speed
        near = abs(away) <= 1e-3 * point.speed or 0.0 < away / reach <= 1.0
        return near and bool((orbit.defects() <= COARSE.defect).all())

    mode = np.concatenate([starts.ravel(), rates.ravel(), [0.0, 0.0]])
    return _leaving(motion, base, amplitude * mode, is_near)


def from_branch_point(motion: VectorField, orbit: PeriodicOrbit) -> BranchStart:
    """From an orbit that loses its symmetry or, having none, doubles its period.

    It is left in its neutral direction.
    """
    equations = OrbitProblem(motion, orbit).linearised(orbit.packed())
    neutral = orbit.unpacked(np.append(equations.neutral()[:-2], [1.0, 0.0]))
    base = orbit.doubled()
    # After the first half the perturbation is the opposite of what the orbit itself does.
    halves = (
        np.concatenate([part, -orbit.mirror * part]).ravel()
        for part in (neutral.starts, neutral.rates)
    )
    direction = np.concatenate([*halves, [0.0, 0.0]])
    branch = Continuation(OrbitProblem(motion, base, unit_of(motion, base)), FINE.control)
    return _leaving(motion, base, SMALL / branch.length(direction) * direction)


def from_orbit(motion: VectorField, orbit: PeriodicOrbit, sign: float) -> BranchStart:
    """From any orbit towards growing (1) or falling (-1) speed."""
    like = orbit.frequency, orbit.u, orbit.symmetric
    orbit = resolved(motion, orbit.states, *like, FINE.defect)
    orbit = solved(motion, orbit, FINE.control.tolerance)
    branch = Continuation(OrbitProblem(motion, orbit, unit_of(motion, orbit)), FINE.control)
    towards = np.zeros(orbit.packed().size)
    towards[-1] = sign
    return BranchStart(orbit, branch.point(orbit.packed(), towards).tangent)


def _leaving(
    motion: VectorField,
    base: PeriodicOrbit,
    direction: Array,
    accepted: Callable[[PeriodicOrbit], bool] = lambda orbit: True,
) -> BranchStart:
    """The orbit at a distance from what it leaves, in a direction of that length.

    It is nearer where there is none or it is not accepted; raises NewtonFailed if there is none.
    """
    begin = base.packed()
    while True:
        like = base.unpacked(begin + direction)
        problem = OrbitProblem(motion, like, unit_of(motion, like))
        branch = Continuation(problem, FINE.control)
        length = branch.length(direction)
        try:
            z = branch.at(branch.starting(begin, direction), length).z
            if accepted(problem.orbit(z)) or length <= SMALLEST:
                return BranchStart(problem.orbit(z), z - begin, base)
        except NewtonFailed:
            if length <= SMALLEST:
                raise
        direction = 0.3 * direction


def unit_of(motion: VectorField, orbit: PeriodicOrbit) -> float:
    """Root mean square of the positions p for each L of the free end's amplitude."""
    states = orbit.states(PROBES)
    positions, across = states[: motion.half], motion.tip(states)
    centred = positions - positions.mean(axis=1, keepdims=True)
    size = math.sqrt(float(np.mean(np.sum(centred**2, axis=0))))
    return size / max(0.5 * float(np.ptp(across)), 0.01 * size)  # a free end may be held


def breaking_part(orbit: PeriodicOrbit, kind: str) -> Array:
    """The part of an orbit that vanishes where it meets what it leaves, at `PROBES`, (k, moving).

    That is an equilibrium ("hopf"), its own mirror image ("pitchfork") or an orbit of half the
    period ("period doubling").
    """
    p = orbit.states(PROBES)[: orbit.half].T
    later = np.roll(p, -PROBES.size // 2, axis=0)
    if kind == "hopf":
        return p if orbit.symmetric else p - p.mean(axis=0)
    return 0.5 * (p + later if kind == "pitchfork" else p - later)


# -------------------------------------------------------------------------------- following it


@dataclass(frozen=True)
class OrbitStep:
    """A step along a branch of orbits: the problem's unknowns on a segment between two of them."""

    segment: Segment
    problem: OrbitProblem

    @property
    def length(self) -> float:
        """Arc length."""
        return self.segment.length

    @property
    def begin(self) -> PeriodicOrbit:
        """The first orbit."""
        return self.problem.orbit(self.segment.begin.z)

    @property
    def end(self) -> PeriodicOrbit:
        """The last orbit."""
        return self.problem.orbit(self.segment.end.z)

    def at(self, s: float) -> PeriodicOrbit:
        """The orbit at an arc length from the first."""
        return self.problem.orbit(self.segment.at(s).z)


def followed(motion: VectorField, start: BranchStart, how: OrbitControl) -> Iterator[OrbitStep]:
    """Steps along a branch of orbits, past folds, without end.

    From what it leaves to its first orbit the branch is a step like any other.
    """
    here, towards = start.orbit, start.towards
    unit, largest = unit_of(motion, here), how.defect
    length = 0.2 * how.control.longest
    if start.base is not None:
        begin, end = start.base.packed(), here.packed()
        # So small a start lets the orbits on the way be anything from 0.15 % to 150 % of the first.
        problem = OrbitProblem(motion, here.unpacked(begin + 0.05 * towards), unit)
        branch = Continuation(problem, how.control)
        points = branch.starting(begin, towards), branch.point(end, towards)
        yield OrbitStep(Segment(branch, *points), problem)
        length = min(length, branch.length(towards))
    while True:
        problem = OrbitProblem(motion, here, unit)
        branch = Continuation(problem, how.control)
        segment, following = branch.next(branch.starting(here.packed(), towards), length)
        step = OrbitStep(segment, problem)
        coarse = step.end.defects() > largest
        if coarse.any():
            if here.edges.size + np.count_nonzero(coarse) > MOST_INTERVALS:
                raise NewtonFailed(f"more than {MOST_INTERVALS} mesh intervals are needed")
            edges = divided(here.edges, 1 + coarse)
            here, towards = _on_mesh(step, segment.begin, edges, how.control)
            length = segment.length
            continue
        yield step
        here, towards, length = step.end, segment.end.tangent, following
        # An interval twice as long has some 2^8 times the defect. A change of the mesh costs as
        # much as a step.
        if np.count_nonzero(here.defects() <= 1e-3 * largest) > 2 * COARSEST:
            edges = resolved(
                *(motion, here.states, here.frequency, here.u, here.symmetric), largest
            ).edges
            if edges.size < 0.75 * here.edges.size:
                here, towards = _on_mesh(step, segment.end, edges, how.control)


def _on_mesh(
    step: OrbitStep, point: Point, edges: Array, control: Control
) -> tuple[PeriodicOrbit, Array]:
    """A point's orbit and tangent on another mesh."""
    motion = step.problem.motion
    # The tangent there: any direction near it is good enough to find it by.
    here, moved = (
        interpolated(motion, orbit.states, edges, orbit.frequency, orbit.u)
        for orbit in map(step.problem.orbit, (point.z, point.z + 1e-4 * point.tangent))
    )
    problem = OrbitProblem(motion, here, step.problem.unit)
    towards = moved.packed() - here.packed()
    branch = Continuation(problem, control)
    found = branch.at(branch.point(problem.start.packed(), towards), 0.0)
    return problem.orbit(found.z), found.tangent


def continued(motion: VectorField, point: Hopf, u: float) -> PeriodicOrbit:
    """The orbit at a speed to which those of a Hopf point lead; NewtonFailed says why if none."""
    begun, stopped = motion.evaluations, "it takes too many steps"
    amplitude = SMALL
    with suppress(ValueError):  # one step may do, up to what the amplitude equation holds for
        amplitude = min(1.05 * point.amplitude(u) or SMALL, LARGEST)
    start = from_hopf(motion, point, amplitude, 1.5 * (u - point.speed) or math.inf)
    small = start.orbit.size * min(SMALL / amplitude, 1.0)
    here, turning = start.orbit, list[OrbitStep]()
    try:
        # Sixty of the longest steps change the amplitude by up to 18 L.
        for step in islice(followed(motion, start, COARSE), 60):
            if (step.begin.u - u) * (step.end.u - u) <= 0.0:
                return step.problem.orbit(step.segment.where(u))
            here, slopes = step.end, step.segment.slopes
            if slopes[0] * slopes[1] < 0.0 and slopes[0] * (u - step.begin.u) > 0.0:
                turning.append(step)  # turned back on its way there, or just beyond
            across = np.sum(breaking_part(step.begin, "hopf") * breaking_part(here, "hopf"))
            if here.size < 0.25 * small or across < 0.0:
                stopped = f"its amplitude falls to 0 near u = {here.u:.6g}"
                break
            if not 0.5 * min(u, point.speed) < here.u < 1.5 * max(u, point.speed):
                stopped = f"it leads to u = {here.u:.6g}"
                break
            if motion.evaluations > begun + MOST_EVALUATIONS:
                break
    except NewtonFailed as reason:
        stopped = f"it could not be followed beyond u = {here.u:.6g}: {reason}"
    report = f"does not reach u = {u:g}: {stopped}"
    turns = list[float]()
    for step in turning:
        with suppress(NewtonFailed):
            for s in folds(step.segment, 1e-3):
                part = replace(step.segment, end=step.segment.at(s))
                if (step.begin.u - u) * (part.end.p - u) <= 0.0:
                    return step.problem.orbit(part.where(u))
                turns.append(part.end.p)
    turn = min(turns, key=lambda turn: abs(turn - u), default=None)
    if turn is not None and (turn < point.speed) == (u < point.speed):
        report = f"reaches {'down' if u < turn else 'up'} to u = {turn:.6g} only"
    raise NewtonFailed(f"the cycle of the Hopf point at u = {point.speed:.6g} {report}")
