# SPDX-License-Identifier: MIT
"""Equilibria and cycles that are known at a speed, and whether a motion ends on one of them.

A stable one attracts whatever comes near. A motion is taken to end there once it is within a small
part of its size, has come nearer, and is much nearer to it than to anything else that is known: to
an unstable cycle beside it, for one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipedyn.bifurcation.periodic_orbit import PROBES, PeriodicOrbit, stage_phases
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed, newton

NEAR, NEARER, NEAREST = 0.02, 0.5, 1e-3
"""Share of a solution's size within which a motion ends on it if it is by this factor nearer in the
last quarter of a record than in the first; within the last it is enough that it comes nearer."""

ELSEWHERE = 5.0
"""How many times farther everything else that is known has to be."""

SMALL_REST = 0.5
"""Size of an equilibrium, in coordinates: `NEAR` of it is a hundredth of a radian."""

PERIODS = 4
"""Periods of a cycle that are recorded: three show that it repeats, with less than one at the ends
of which maxima are left out."""


@dataclass(frozen=True, eq=False)
class KnownSolution:
    """An equilibrium or a cycle at a speed."""

    stable: bool
    rest: Array | None = field(default=None, repr=False)  # state, (2 moving,)
    orbit: PeriodicOrbit | None = field(default=None, repr=False)
    sign: float = 1.0  # -1 for the mirror image of the orbit

    @property
    def size(self) -> float:
        """Root mean square of what positions of a cycle are from their mean."""
        if self.orbit is None:
            return SMALL_REST
        p = self.orbit.states(PROBES)[: self.orbit.half]
        return float(np.sqrt(np.sum(np.var(p, axis=1))))

    def distances(self, states: Array, rate: float) -> Array:
        """Of states [p, p'] in the columns, (2 moving, k), with rates in units of `rate`."""
        units = np.ones(len(states))
        units[len(states) // 2 :] = rate
        scaled = states / units[:, None]
        if self.orbit is None:
            assert self.rest is not None
            return np.asarray(np.linalg.norm(scaled - (self.rest / units)[:, None], axis=0))
        phases = stage_phases(self.orbit.edges).ravel()
        if self.orbit.symmetric:
            phases = np.append(phases, self.orbit.span + phases)
        probes = self.sign * self.orbit.states(phases) / units[:, None]
        # |a - b|^2 - |b|^2 without a table of differences.
        squares = np.sum(probes**2, axis=0)[:, None] - 2.0 * probes.T @ scaled
        phase = phases[np.argmin(squares, axis=0)]
        for _ in range(2):  # to the foot of the perpendicular, by the chord to a phase beside it
            here, beside = (
                self.sign * self.orbit.states(at) / units[:, None] for at in (phase, phase + 1e-4)
            )
            along = (beside - here) / 1e-4
            ahead = np.sum((scaled - here) * along, axis=0) / np.sum(along**2, axis=0)
            phase = phase + np.clip(ahead, -PROBES[1], PROBES[1])
        foot = self.sign * self.orbit.states(phase) / units[:, None]
        return np.asarray(np.linalg.norm(scaled - foot, axis=0))

    def recorded(self, samples: int) -> tuple[Array, Array]:
        """Times, with so many in a unit of time, and states, (2 moving, k), of some periods."""
        if self.orbit is None:
            assert self.rest is not None
            return np.linspace(0.0, 1.0, 9), np.repeat(self.rest[:, None], 9, axis=1)
        period = 2.0 * math.pi / self.orbit.frequency
        count = PERIODS * max(128, math.ceil(samples * period)) + 1
        t = np.linspace(0.0, PERIODS * period, count)
        return t, self.sign * self.orbit.states(self.orbit.frequency * t)


def approached(solutions: Sequence[KnownSolution], states: Array) -> int | None:
    """Which of the solutions a motion ends on, by some of its states in order, (2 moving, k)."""
    if not any(one.stable for one in solutions):
        return None
    p, rates = np.split(states, 2)
    spread, turning = (float(np.sqrt(np.sum(np.var(part, axis=1)))) for part in (p, rates))
    rate = turning / spread if spread > 0.0 and turning > 0.0 else 1.0
    quarters = np.array(
        [
            [float(part.max()) for part in np.array_split(one.distances(states, rate), 4)]
            for one in solutions
        ]
    )
    last = quarters[:, -1]
    place = int(np.argmin(last))
    one, first, near = solutions[place], float(quarters[place, 0]), float(last[place])
    others = np.delete(last, place)
    if not one.stable or (others < ELSEWHERE * near).any():
        return None
    allowed = NEAR if near <= NEARER * first else NEAREST if near < first else 0.0
    return place if near <= allowed * one.size else None


def at_rest(
    motion: VectorField, guesses: Iterable[Array], u: float, farthest: float = 0.1
) -> list[KnownSolution]:
    """Equilibria near positions p at a speed, each once, with their stability."""
    found: list[KnownSolution] = []
    half = motion.half

    def correction(p: Array) -> tuple[Array, float]:
        y = np.append(p, np.zeros(half))
        force = motion(y[:, None], u)[half:, 0]
        step = np.asarray(np.linalg.solve(-motion.jacobian(y, u)[half:, :half], force), float)
        return step, float(np.abs(step).max())

    for guess in guesses:
        try:
            p = newton(guess, correction, tolerance=1e-9, stagnation=1e-6, longest=farthest)
        except NewtonFailed:
            continue
        rest = np.append(p, np.zeros(half))
        if np.abs(p - guess).max() > farthest or any(
            one.rest is not None and np.abs(one.rest - rest).max() < 1e-5 for one in found
        ):
            continue
        factorised()
        values: Complex = np.linalg.eigvals(motion.jacobian(rest, u)).astype(np.complex128)
        # A margin, as weak damping and rounding of eigenvalues are not told apart.
        stable = float(values.real.max()) < -1e-9 * (1.0 + float(np.abs(values).max()))
        found.append(KnownSolution(stable, rest=rest))
    return found
