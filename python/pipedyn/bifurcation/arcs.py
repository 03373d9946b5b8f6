# SPDX-License-Identifier: MIT
"""Arcs of cycles: from an orbit in a direction, by pseudo-arclength, past folds.

An arc sets out from an onset of flutter, from where a cycle loses its symmetry or doubles its
period, or from any cycle. It takes more phases where they are needed. Each point comes with the
arc's tangent, which tells the direction to the next and whether the flow speed turns back.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from pipedyn.bifurcation.fourier import Elsewhere, Equations, Orbit, Phases, is_odd
from pipedyn.bifurcation.vector_field import Field
from pipedyn.linear.eigenproblem import Complex
from pipedyn.util.check import Array

MOST_UNKNOWNS = 1000
"""Up to which an arc goes on with more phases."""

SMOOTH, SMOOTH_ACROSS_KINKS = 1e-6, 3e-5
"""Share of the last harmonics beyond which an arc takes more phases; with drag it falls slowly."""

SMALL, FIRST, LONGEST, SHORTEST = 0.01, 0.03, 0.15, 1e-4
"""Lengths in L of the free end, and relative in speed and frequency: of an arc's first cycle from
what it leaves, of its first step after that, its longest and its shortest."""

STRAIGHT = 0.8
"""Cosine of the angle that the tangent turns, below which a step is made shorter."""

FLAT = 0.3
"""Share of a step's steepest slope in the speed below which there may be two folds within it."""

Breaking = Literal["pitchfork", "period doubling"]


@dataclass(frozen=True)
class Birth:
    """A pair on the axis, from which small cycles come.

    Attributes:
        rest: the equilibrium, shape (2 moving,).
        mode: complex, of unit displacement of the free end, shape (2 moving,).
        speed, frequency: of the pair.
    """

    rest: Array = field(repr=False)
    mode: Complex = field(repr=False)
    speed: float
    frequency: float

    def ring(
        self, motion: Field, amplitude: float, u: float, frequency: float, count: int = 16
    ) -> Orbit:
        """The mode with an amplitude of the free end, on `count` phases in half a period."""
        half = not self.rest.any() and is_odd(motion, u)
        phases = Phases(count if half else 2 * count + 1, half)
        width = motion.size if motion.tied else motion.half
        turn = np.exp(1j * phases.at)[:, None]
        z = self.rest[:width] + amplitude * (self.mode[:width] * turn).real
        return Orbit(phases, z, frequency, u)


@dataclass(frozen=True)
class Start:
    """Where an arc sets out.

    Attributes:
        orbit: its first cycle.
        towards: direction in (z, omega, u), shape (unknowns + 2,); its length, if that is less
            than `FIRST`, is that of the first step.
        base: what it leaves, an equilibrium or a cycle before its change, on the orbit's phases.
    """

    orbit: Orbit
    towards: Array = field(repr=False)
    base: Orbit | None = None


def from_birth(motion: Field, birth: Birth) -> Start:
    """At a small amplitude or, where the speed is by then more than 1e-3 off, less.

    Raises:
        Elsewhere: if there is no small cycle.
    """
    amplitude = SMALL
    small = _small(motion, birth, amplitude)
    while abs(small.u - birth.speed) > 1e-3 * birth.speed and amplitude > 1e-4:
        amplitude *= 0.3
        small = _small(motion, birth, amplitude)
    still = np.zeros_like(small.z) + birth.rest[: small.z.shape[1]]
    return _beside(Orbit(small.phases, still, small.frequency, birth.speed), small)


def _small(motion: Field, birth: Birth, amplitude: float) -> Orbit:
    """The cycle of a small amplitude, at whatever speed."""
    ring = birth.ring(motion, amplitude, birth.speed, birth.frequency)
    rest = birth.rest[: ring.z.shape[1]]
    row = np.append((ring.z - rest).ravel(), [0.0, 0.0])
    return Equations(motion, ring.phases).solve(ring, row=row, value=float(row @ packed(ring)))


def from_change(motion: Field, orbit: Orbit, kind: Breaking) -> Start:
    """From where a cycle loses its symmetry or doubles its period, in its neutral direction.

    Args:
        motion: the model's.
        orbit: the cycle there; without a mirror symmetry it can only double its period.
        kind: what happens.

    Raises:
        Elsewhere: if there is no such cycle beside it.
    """
    base = unbroken(orbit, kind)
    mode = broken(base, Equations(motion, base.phases).neutral(base), kind)
    towards = np.append(mode, [0.0, 0.0])
    weights = metric(motion, base, unit_of(motion, base))
    row = weights * towards / math.sqrt(weights @ towards**2)
    size = SMALL / float(row @ towards)
    while True:
        guess = unpacked(packed(base) + size * towards, base)
        try:
            found = Equations(motion, base.phases).solve(guess, row=row, value=row @ packed(guess))
            return _beside(base, found)
        except Elsewhere:
            size *= 0.4
            if size * float(row @ towards) < SHORTEST:
                raise


def unbroken(orbit: Orbit, kind: Breaking) -> Orbit:
    """A cycle on the phases of what breaks from it: whole periods, or two."""
    share = 1 if kind == "pitchfork" else 2
    phases = Phases(2 * orbit.phases.count + 1, half=False)
    z = orbit.phases.between(orbit.z, share * phases.at)
    return Orbit(phases, z, orbit.frequency / share, orbit.u)


def broken(orbit: Orbit, z: Array, kind: Breaking) -> Array:
    """The part of values on an orbit's phases by which they differ from an unbroken cycle's."""
    odd = orbit.phases.odd(z)
    return odd if kind == "period doubling" else z - odd


def from_orbit(motion: Field, orbit: Orbit, sign: float) -> Start:
    """From any cycle towards growing (1) or falling (-1) speed.

    Raises:
        Elsewhere: if the equations do not tell where that is.
    """
    by_speed = np.zeros(orbit.z.size + 2)
    by_speed[-1] = 1.0 / orbit.u
    return Start(orbit, sign * Equations(motion, orbit.phases).tangent(orbit, by_speed))


def _beside(base: Orbit, orbit: Orbit) -> Start:
    return Start(orbit, packed(orbit) - packed(base), base)


@dataclass(frozen=True)
class Step:
    """A step of an arc, any point of which can be solved for.

    Attributes:
        begin, end: cycles on the same phases.
        row: weights of (z, omega, u) in the length along the step.
        length: of the step.
        slopes: derivative of the speed by the length at both ends.
        onward: tangent at the end, shape (unknowns + 2,).
    """

    motion: Field = field(repr=False)
    begin: Orbit
    end: Orbit
    row: Array = field(repr=False)
    length: float
    slopes: tuple[float, float]
    onward: Array = field(repr=False)

    def at(self, s: float) -> Orbit:
        """The cycle at a length from the step's beginning.

        Raises:
            Elsewhere: if Newton's method does not settle.
        """
        share = s / self.length
        first, last = packed(self.begin), packed(self.end)
        value = float(self.row @ first) + s
        guess = unpacked(first + share * (last - first), self.begin)
        equations = Equations(self.motion, self.begin.phases)
        return equations.solve(guess, row=self.row, value=value)

    def slope(self, s: float) -> float:
        """Derivative of the speed by the length, at a length from the step's beginning."""
        orbit = self.at(s)
        return float(Equations(self.motion, orbit.phases).tangent(orbit, self.row)[-1])

    def landing(self, u: float) -> Orbit:
        """The cycle at a speed between those of the ends.

        Raises:
            Elsewhere: if Newton's method does not settle.
        """
        first, last = packed(self.begin), packed(self.end)
        share = (u - self.begin.u) / (self.end.u - self.begin.u)
        guess = replace(unpacked(first + share * (last - first), self.begin), u=u)
        found = Equations(self.motion, guess.phases).solve(guess)
        if not -0.5 * self.length <= self.reach(found) <= 1.5 * self.length:
            raise Elsewhere("Newton's method left the neighbourhood of its start")
        return found

    def reach(self, orbit: Orbit) -> float:
        """Length from the step's beginning at which an orbit lies."""
        return float(self.row @ (packed(orbit) - packed(self.begin)))

    def part(self, begin: Orbit, end: Orbit) -> Step:
        """What lies between two of its points."""
        length = self.reach(end) - self.reach(begin)
        return replace(self, begin=begin, end=end, length=length)


def turns(step: Step) -> list[float]:
    """Lengths within a step at which the speed turns back, none, one or two.

    Raises:
        Elsewhere: if a cycle within the step is lost.
    """
    first, last = step.slopes
    brackets = []
    if first * last < 0.0:
        brackets = [(0.0, step.length)]
    elif first * last > 0.0:
        # Where the cubic with the ends' speeds and slopes is flattest.
        mean = (step.end.u - step.begin.u) / step.length
        bend = 6.0 * (0.5 * (first + last) - mean)
        share = 0.5 - 0.5 * (last - first) / bend if bend else 0.0
        flattest = first + share * (last - first - bend * (1.0 - share))
        steepest = max(first, last, key=abs)
        if 0.0 < share < 1.0 and flattest / steepest < FLAT:
            middle = share * step.length
            if step.slope(middle) * first < 0.0:
                brackets = [(0.0, middle), (middle, step.length)]
    return [float(brentq(step.slope, *pair, xtol=1e-5 * step.length)) for pair in brackets]


def packed(orbit: Orbit) -> Array:
    """(z, omega, u), shape (unknowns + 2,)."""
    return np.append(orbit.z, [orbit.frequency, orbit.u])


def unpacked(values: Array, like: Orbit) -> Orbit:
    """The orbit of (z, omega, u)."""
    z = values[:-2].reshape(like.z.shape)
    return Orbit(like.phases, z, float(values[-2]), float(values[-1]))


def unit_of(motion: Field, orbit: Orbit) -> float:
    """Size of an orbit for each L of its free end's amplitude."""
    across = motion.tip(Equations(motion, orbit.phases).states(orbit))
    swing = float(np.abs(across).max()) if orbit.phases.half else 0.5 * float(np.ptp(across))
    return orbit.size / max(swing, 0.01 * orbit.size)  # a free end may be held


def metric(motion: Field, orbit: Orbit, unit: float) -> Array:
    """Weights of squares of (z, omega, u): in L of the free end, relative in the last two."""
    by_state = np.full(orbit.z.size, 1.0 / (orbit.phases.count * unit**2))
    return np.append(by_state, [orbit.frequency**-2, orbit.u**-2])


def arc(motion: Field, start: Start) -> Iterator[Step]:
    """Steps along an arc of cycles, past folds, without end.

    Args:
        motion: the model's.
        start: where it sets out.

    Raises:
        Elsewhere: where it cannot be followed.
    """
    here, towards = start.orbit, start.towards
    unit = unit_of(motion, here)
    smooth = SMOOTH_ACROSS_KINKS if motion.model.pipe.drag else SMOOTH
    length = min(FIRST, _length(metric(motion, here, unit), towards))
    while True:
        step = _stepped(motion, here, towards, metric(motion, here, unit), length)
        if step.end.last_share > smooth:
            count = 2 * (here.phases.count // 2) * 2
            if (count + 1) * here.z.shape[1] > MOST_UNKNOWNS:
                raise Elsewhere(f"more than {here.phases.count} phases are needed")
            finer, dz = here.on(count), unpacked(towards, here).on(count).z
            equations = Equations(motion, finer.phases)
            here = equations.solve(finer, 1e-8)
            row = metric(motion, here, unit) * np.append(dz, towards[-2:])
            towards = equations.tangent(here, row)
            continue
        yield step
        here, towards = step.end, step.onward
        length = min(1.5 * step.length, LONGEST)


def _length(weights: Array, change: Array) -> float:
    return math.sqrt(float(weights @ change**2))


def _stepped(motion: Field, here: Orbit, towards: Array, weights: Array, length: float) -> Step:
    """A step of at most some length that does not turn too far."""
    along = towards / _length(weights, towards)
    row = weights * along
    equations = Equations(motion, here.phases)
    while True:
        reason = Elsewhere("the step turned too far")
        guess = unpacked(packed(here) + length * along, here)
        try:
            if guess.u <= 0.0 or guess.frequency <= 0.0:
                raise Elsewhere("the branch left positive speeds")
            value = float(row @ packed(here)) + length
            found = equations.solve(guess, 1e-8, row=row, value=value)
            onward = equations.tangent(found, row)
            stretched = _length(weights, packed(found) - packed(here)) / length
            if max(stretched, _length(weights, onward)) <= 1.0 / STRAIGHT or length <= SHORTEST:
                slopes = float(along[-1]), float(onward[-1])
                return Step(motion, here, found, row, length, slopes, onward)
        except Elsewhere as error:
            reason = error
        length *= 0.4
        if length < SHORTEST:
            raise reason
