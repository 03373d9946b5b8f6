# SPDX-License-Identifier: MIT
"""Branches of cycles over the flow speed: from where they are born, past folds, with what changes.

A branch is followed by arc length (`collocation.arc`), with Floquet multipliers at every point.
Where their number outside the unit circle changes, or the branch turns, the step is halved down to
the change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.blas import one_thread
from pipedyn.collocation import Birth, Elsewhere, Equations, Orbit, Step, arc
from pipedyn.critical import crossings
from pipedyn.cycles import LimitCycle, NoCycle, described, finished
from pipedyn.equilibria import EquilibriumBranch, Rest
from pipedyn.field import Field
from pipedyn.hopf import tip_of, vectors
from pipedyn.model import Model, NotConverged, PipedynError
from pipedyn.pencil import Complex

UNIT = 1e-6
"""By how much the modulus of a multiplier may exceed 1 on a stable cycle."""

HALVINGS = 12
"""Times that a step is halved around an event."""

SLOW = 0.5
"""Share of a branch's highest frequency below which, still falling, it falls towards 0."""

TOLD = 1e-3
"""Error of the multipliers beyond which a cycle on a branch is left out."""

SAMPLES = 65
"""States kept of each cycle."""

EventKind = Literal[
    "fold", "pitchfork", "period doubling", "torus", "hopf", "infinite period", "end"
]


@dataclass(frozen=True)
class CycleEvent:
    """Where the stability of a branch of cycles changes, or the branch turns or ends.

    Attributes:
        kind: "fold" (the branch turns back), "pitchfork" (a multiplier passes 1 and the branch
            goes on: the cycle loses or regains its symmetry), "period doubling" (a multiplier
            passes -1), "torus" (a pair passes the unit circle), "hopf" (the cycle shrinks to
            nothing), "infinite period" (the frequency falls towards 0, as where a cycle meets an
            equilibrium) or "end" (it was not followed further).
        speed: u.
        error: half the interval of speeds that is known to hold it.
        multiplier: the one that passes, 1 where the branch begins or ends.
        amplitude: of the cycle.
    """

    kind: EventKind
    speed: float
    error: float
    multiplier: complex
    amplitude: float


@dataclass(frozen=True)
class CycleBranch:
    """Cycles along a branch, which may turn in the flow speed, in order from where it is born.

    Attributes:
        speeds: u, shape (S,).
        amplitudes: half the peak-to-peak transverse motion of the free end in L, shape (S,).
        frequencies: angular, in 1 / T, shape (S,).
        stable: shape (S,).
        multipliers: Floquet multipliers, the largest first, the trivial one among them, shape
            (S, n).
        events: in order along the branch.
        cycles: the cycles themselves; those at the speeds asked for meet the tolerance of
            `limit_cycle`, those between some 1e-5.
        onset: flow speed at which it is born.
    """

    speeds: Array
    amplitudes: Array
    frequencies: Array
    stable: NDArray[np.bool_] = field(repr=False)
    multipliers: Complex = field(repr=False)
    events: tuple[CycleEvent, ...]
    cycles: tuple[LimitCycle, ...] = field(repr=False)
    onset: float = math.nan

    def __len__(self) -> int:
        return len(self.speeds)

    def at(self, u: float) -> tuple[LimitCycle, ...]:
        """The cycles at one of the speeds asked for, in order along the branch."""
        u = _check.real("u", u, low=0.0)
        return tuple(cycle for cycle in self.cycles if math.isclose(cycle.u, u, rel_tol=1e-12))

    def retraces(self, other: CycleBranch) -> bool:
        """Whether it leads from where the other ends to where that begins.

        Raises:
            TypeError: for what is no branch of cycles.
        """
        if not isinstance(other, CycleBranch):
            raise TypeError(f"other must be a CycleBranch, got {_check.shown(other)}")
        return all(
            b.events[-1:] and b.events[-1].kind == "hopf" and b.events[-1].speed == onset != b.onset
            for b, onset in ((self, other.onset), (other, self.onset))
        )


Failed = tuple[float, Exception]
"""A flow speed and what was raised there."""


def births(
    model: Model, branches: tuple[EquilibriumBranch, ...], highest: float
) -> Iterator[Birth | Failed]:
    """Hopf points of equilibria, of mirror images one, or what fails.

    Args:
        model: the model.
        branches: of its equilibria; of pipes that rest as they are built all onsets count, on these
            or not.
        highest: flow speed up to which these are sought.
    """
    motion, rest = Field(model), Rest(model)
    points: list[tuple[float, float, Array]] = []
    if rest.rests(highest):
        try:
            points += [
                (c.speed, c.frequency, rest.resting)
                for c in crossings(model, highest)
                if c.kind == "flutter" and c.speed > 0.0
            ]
        except PipedynError as error:
            yield highest, error
    for branch in branches:
        for point in branch.points:
            if point.kind == "hopf" and point.speed > 0.0 and not branch.straight:
                points.append((point.speed, point.frequency, rest.from_start("q", point.q)))
    known: list[tuple[float, float]] = []
    for u, frequency, x in points:
        if any(np.allclose((u, frequency), other, rtol=1e-6) for other in known):
            continue
        known.append((u, frequency))
        try:
            yield born(motion, np.concatenate([x, np.zeros(motion.half)]), u, frequency)
        except (PipedynError, ValueError) as error:
            yield u, error


def born(motion: Field, rest: Array, u: float, frequency: float) -> Birth:
    """The pair on the axis at an equilibrium.

    Args:
        motion: the model's.
        rest: the equilibrium, shape (2 moving,).
        u: flow speed.
        frequency: of the pair.

    Raises:
        ValueError, PipedynError: if there is no such pair, or two, or the free end stands still.
    """
    mode, _ = vectors(motion.jacobian(rest, u), frequency)
    mode = mode / tip_of(motion, rest, mode)
    return Birth(rest, mode, u, frequency)


def cycle_branch(
    model: Model,
    birth: Birth,
    speeds: Array,
    ends: tuple[float, float],
    rtol: float,
    most: int,
    onsets: tuple[float, ...] = (),
) -> tuple[CycleBranch | None, tuple[Failed, ...]]:
    """Cycles from an onset on.

    Args:
        model: chain, reduced model or scene, up to 100 degrees of freedom.
        birth: the onset.
        speeds: flow speeds at which cycles are solved for, increasing.
        ends: lowest and highest speed; the branch ends where it leaves both these and the side of
            the onset.
        rtol: relative tolerance of the cycles at `speeds`.
        most: points along the arc at most.
        onsets: speeds of all onsets, at one of which it may end.

    Returns:
        CycleBranch, None if there is no cycle within the ends, and the speeds that failed.
    """
    motion = Field(model)
    failed: list[Failed] = []
    with one_thread(motion.size):
        branch = _Followed(motion, birth, speeds, ends, rtol, failed, onsets)
        branch.run(most)
        return branch.result(), tuple(failed)


class _Followed:
    """A branch in the making."""

    def __init__(
        self,
        motion: Field,
        birth: Birth,
        speeds: Array,
        ends: tuple[float, float],
        rtol: float,
        failed: list[Failed],
        onsets: tuple[float, ...],
    ) -> None:
        self.motion, self.birth, self.rtol, self.failed = motion, birth, rtol, failed
        self.ends, self.speeds = ends, speeds
        self.onsets = [u for u in onsets if u != birth.speed]
        self.how = f"followed from the onset at u = {birth.speed:.6g}"
        self.cycles: list[LimitCycle] = []
        self.events = [CycleEvent("hopf", birth.speed, 1e-6, 1.0 + 0j, 0.0)]

    def run(self, most: int) -> None:
        """Follows the branch until it ends, leaves the speeds or has as many points."""
        low, high = min(self.ends[0], self.birth.speed), max(self.ends[1], self.birth.speed)
        last: LimitCycle | None = None
        try:
            for number, step in enumerate(arc(self.motion, self.birth)):
                if last is None:
                    self._smallest(step)
                    last = self.described(step.begin)
                    self.keep(last)
                if float(np.sum(_moves(step.begin) * _moves(step.end))) < 0.0:
                    u = _vanishing(step, self.motion.model.pipe.drag > 0.0)
                    near = min(self.onsets, key=lambda onset: abs(onset - u), default=u)
                    self._ends("hopf", near if abs(near - u) < 0.01 * u else u, last)
                    return
                last = self.noted(step, last)
                if self._slowing() and last.multiplier_error > TOLD:
                    self._ends("infinite period", last.u, last)
                    return
                if not low <= step.end.u <= high:
                    return
                if number >= most:
                    self._ends("end", last.u, last)
                    return
        except Elsewhere as reason:
            if last is None:
                u = self.birth.speed
                self.failed.append((u, NoCycle(f"no cycle beside u = {u:g}: {reason}", u)))
                return
            if self._slowing():
                self._ends("infinite period", last.u, last)
                return
            self._ends("end", last.u, last)
            told = NotConverged(f"the cycles were not followed beyond u = {last.u:g}: {reason}")
            self.failed.append((last.u, told))

    def _smallest(self, step: Step) -> None:
        """Cycles at speeds asked for between the onset and the first step."""
        born, first = self.birth.speed, step.begin
        low, high = sorted((born, first.u))
        power = 1.0 if self.motion.model.pipe.drag else 0.5
        rest = self.birth.rest[: first.z.shape[1]]
        asked = self.speeds[(self.speeds > low) & (self.speeds < high)]
        for u in sorted(map(float, asked), key=lambda u: abs(u - born)):
            size = ((u - born) / (first.u - born)) ** power
            guess = replace(first, z=rest + size * (first.z - rest), u=u)
            try:
                orbit = Equations(self.motion, guess.phases).solve(guess)
                self.keep(finished(self.motion, orbit, self.rtol, SAMPLES, self.how))
            except Elsewhere as reason:
                self.failed.append((u, NoCycle(f"no cycle at u = {u:g}: {reason}", u)))
            except PipedynError as error:
                self.failed.append((u, error))

    def _slowing(self) -> bool:
        """Whether the period seems to grow without bound."""
        pace = np.array([cycle.frequency for cycle in self.cycles])
        return pace.size > 3 and bool(pace[-1] < SLOW * pace.max() and pace[-1] < pace[-3])

    def described(self, orbit: Orbit) -> LimitCycle:
        """The cycle of an orbit, with its multipliers."""
        return described(self.motion, orbit, orbit.last_share, SAMPLES, self.how)

    def keep(self, cycle: LimitCycle) -> None:
        """Takes a cycle whose multipliers can be believed."""
        if cycle.multiplier_error < TOLD:
            self.cycles.append(cycle)
        elif not self._slowing():
            told = (
                f"the multipliers at u = {cycle.u:g} are known to {cycle.multiplier_error:.1e} only"
            )
            self.failed.append((cycle.u, NotConverged(told, cycle)))

    def _ends(self, kind: EventKind, u: float, last: LimitCycle) -> None:
        error, size = abs(last.u - u), last.amplitude
        if kind == "hopf":
            error, size = (1e-6 if u in self.onsets else error), 0.0
        self.events.append(CycleEvent(kind, u, error, 1.0 + 0j, size))

    def noted(self, step: Step, last: LimitCycle) -> LimitCycle:
        """Keeps what lies on a step, and what changes there; the cycle at its end."""
        fold = turning(step)
        end = self.described(step.end)
        if max(end.multiplier_error, last.multiplier_error) > TOLD:
            self.keep(end)
            return end
        marked: list[tuple[float, LimitCycle, CycleEvent | None]] = [(step.length, end, None)]
        change = outside(end.multipliers) - outside(last.multipliers)
        if fold is None:
            parts = [step]
            marked += self._changes(step, 0.0, step.length, last, end)
        else:
            length, top, error = fold
            cycle = self.described(top)
            event = CycleEvent("fold", top.u, error, _nearest(cycle.multipliers), cycle.amplitude)
            marked.append((length, cycle, event))
            parts = [step.part(step.begin, top), step.part(top, step.end)]
            if abs(change) != 1:  # more than the fold's own
                for a, b in ((0.0, 0.95 * length), (1.05 * length, step.length)):
                    if b > a:
                        sides = [self.described(step.at(s)) for s in (a, b)]
                        marked += self._changes(step, a, b, *sides)
        for part in parts:
            marked += self._landed(step, part)
        for _, cycle, told in sorted(marked, key=lambda one: one[0]):
            self.keep(cycle)
            if told is not None and not self._known(told):
                self.events.append(told)
        return end

    def _known(self, event: CycleEvent) -> bool:
        """Whether a multiplier's passage through 1 is that of the fold just told."""
        last = self.events[-1]
        near = 1e-4 * (1.0 + event.speed)
        return (event.kind, last.kind) == ("pitchfork", "fold") and (
            abs(last.speed - event.speed) < near
        )

    def _changes(
        self, step: Step, low: float, high: float, a: LimitCycle, b: LimitCycle
    ) -> Iterator[tuple[float, LimitCycle, CycleEvent | None]]:
        """Passages of multipliers through the unit circle between two lengths."""
        end = outside(b.multipliers)
        for _ in range(6):
            begin = outside(a.multipliers)
            if begin == end:
                return
            top, beyond = high, b
            for _ in range(HALVINGS):
                middle = 0.5 * (low + top)
                cycle = self.described(step.at(middle))
                if outside(cycle.multipliers) == begin:
                    low, a = middle, cycle
                else:
                    top, beyond = middle, cycle
            yield 0.5 * (low + top), beyond, passage(a, beyond)
            low, a = top, beyond

    def _landed(
        self, step: Step, part: Step
    ) -> Iterator[tuple[float, LimitCycle, CycleEvent | None]]:
        """The cycles at the speeds asked for."""
        low, high = sorted((part.begin.u, part.end.u))
        for u in self.speeds[(self.speeds > low) & (self.speeds <= high)]:
            try:
                orbit = part.landing(float(u))
                cycle = finished(self.motion, orbit, self.rtol, SAMPLES, self.how)
            except Elsewhere as reason:
                self.failed.append((float(u), NoCycle(f"no cycle at u = {u:g}: {reason}", u)))
                continue
            except PipedynError as error:
                self.failed.append((float(u), error))
                continue
            yield step.reach(orbit), cycle, None

    def result(self) -> CycleBranch | None:
        """What lies within the speeds asked for."""
        low, high = self.ends
        near = 1e-9 * (1.0 + high)
        cycles = [c for c in self.cycles if low - near <= c.u <= high + near]
        if not cycles:
            return None
        return CycleBranch(
            speeds=np.array([cycle.u for cycle in cycles]),
            amplitudes=np.array([cycle.amplitude for cycle in cycles]),
            frequencies=np.array([cycle.frequency for cycle in cycles]),
            stable=np.array([cycle.stable for cycle in cycles]),
            multipliers=np.array([cycle.multipliers for cycle in cycles]),
            events=tuple(e for e in self.events if low - near <= e.speed <= high + near),
            cycles=tuple(cycles),
            onset=self.birth.speed,
        )


def _moves(orbit: Orbit) -> Array:
    """What moves of an orbit."""
    if orbit.phases.half:
        return orbit.z
    moving: Array = orbit.z - orbit.z.mean(axis=0)
    return moving


def _vanishing(step: Step, kinks: bool) -> float:
    """Speed at which a cycle has no size, somewhere within a step."""
    sizes = [float(np.linalg.norm(_moves(orbit))) for orbit in (step.begin, step.end)]
    a, b = sizes[0] ** (2 - kinks), sizes[1] ** (2 - kinks)
    share = a / (a + b) if kinks else math.sqrt(a) / (math.sqrt(a) + math.sqrt(b))
    return step.begin.u + share * (step.end.u - step.begin.u)


def turning(step: Step) -> tuple[float, Orbit, float] | None:
    """Length, cycle and error of the speed where it turns within a step; None where it does not."""
    near = 0.02 * step.length
    first = step.at(near).u - step.begin.u
    last = step.end.u - step.at(step.length - near).u
    if first * last >= 0.0:
        return None
    sign = math.copysign(1.0, first)
    found = minimize_scalar(
        lambda s: -sign * step.at(float(s)).u,
        bounds=(0.0, step.length),
        method="bounded",
        options={"xatol": 1e-4 * step.length},
    )
    length = float(found.x)
    top = step.at(length)
    beside = step.at(min(length + 1e-3 * step.length, step.length))
    return length, top, max(abs(beside.u - top.u), 1e-9)


def nontrivial(multipliers: ArrayLike) -> Complex:
    """All multipliers but the one nearest to 1."""
    given = np.asarray(multipliers, dtype=np.complex128)
    return np.delete(given, int(np.argmin(np.abs(given - 1.0))))


def outside(multipliers: ArrayLike) -> int:
    """Number of multipliers outside the unit circle, but for the trivial one."""
    return int(np.count_nonzero(np.abs(nontrivial(multipliers)) > 1.0 + UNIT))


def _nearest(multipliers: ArrayLike) -> complex:
    others = nontrivial(multipliers)
    return complex(others[int(np.argmin(np.abs(others - 1.0)))])


def passage(a: LimitCycle, b: LimitCycle) -> CycleEvent:
    """What happens between two neighbours of which one has more multipliers outside."""
    both = np.concatenate([nontrivial(a.multipliers), nontrivial(b.multipliers)])
    nearest = complex(both[int(np.argmin(np.abs(np.abs(both) - 1.0)))])
    kind: EventKind = "torus"
    if abs(nearest.imag) < 1e-3 * abs(nearest):
        kind = "pitchfork" if nearest.real > 0.0 else "period doubling"
    speed, error = 0.5 * (a.u + b.u), 0.5 * abs(a.u - b.u)
    return CycleEvent(kind, speed, error, nearest, 0.5 * (a.amplitude + b.amplitude))
