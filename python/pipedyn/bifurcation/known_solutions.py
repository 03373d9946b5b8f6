# SPDX-License-Identifier: MIT
"""Equilibria and cycles that are known at a speed, and the regions that stable ones attract.

These reach a quarter of the way to anything else that is known: to an unstable cycle, for one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipedyn.bifurcation.capture import COARSE, FINE, Region
from pipedyn.bifurcation.equilibria import Statics
from pipedyn.bifurcation.floquet_coordinates import floquet_coordinates
from pipedyn.bifurcation.periodic_orbit import PeriodicOrbit
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.neutral import decays
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed, newton

PERIODS = 4
"""Periods of a cycle that are recorded: three show that it repeats, with less than one at the ends
of which maxima are left out."""

MIXED, NARROWER = 256, 20
"""Mixtures of modes that are tried about rest, and amplitudes: from 0.5 rad down to 6e-4."""


@dataclass(frozen=True, eq=False)
class KnownSolution:
    """An equilibrium or a cycle at a speed, with the region around it that it attracts if stable.

    Attributes:
        stable: whether eigenvalues or Floquet multipliers say so.
        region: about it.
        orbit: of a cycle.
        sign: -1 for the mirror image of the orbit.
    """

    stable: bool
    region: Region
    orbit: PeriodicOrbit | None = field(default=None, repr=False)
    sign: float = 1.0

    @staticmethod
    def cycle(
        motion: VectorField, stable: bool, orbit: PeriodicOrbit, sign: float = 1.0
    ) -> KnownSolution:
        """That of an orbit."""
        mesh = orbit.edges
        if orbit.symmetric:
            mesh = np.append(mesh, orbit.span + mesh[1:])
        region = Region.about_cycle(
            lambda phase: sign * orbit.states(phase).T,
            orbit.frequency,
            mesh,
            FINE if stable else COARSE,  # nothing but its distance from others is asked for
        )
        if stable:
            coordinates = floquet_coordinates(motion, orbit, region.units, sign)
            region = replace(region, floquet=coordinates)
        return KnownSolution(stable, region, orbit, sign)

    def recorded(self, samples: int) -> tuple[Array, Array]:
        """Times, with so many in a unit of time, and states, (2 moving, k), of some periods."""
        if self.orbit is None:
            return np.linspace(0.0, 1.0, 9), np.repeat(self.region.points.T, 9, axis=1)
        period = self.region.period
        count = PERIODS * max(128, math.ceil(samples * period)) + 1
        t = np.linspace(0.0, PERIODS * period, count)
        return t, self.sign * self.orbit.states(self.orbit.frequency * t)


def kept_apart(solutions: Sequence[KnownSolution]) -> list[KnownSolution]:
    """The same, with regions of stable ones that leave out all others."""
    found: list[KnownSolution] = []
    for one in solutions:
        region = one.region
        for other in solutions if one.stable else ():
            if other is not one:
                region = region.kept_apart(region.apart(other.region))
        found.append(replace(one, region=region))
    return found


def at_rest(
    motion: VectorField, guesses: Iterable[Array], u: float, farthest: float = 0.1
) -> list[KnownSolution]:
    """Equilibria near positions p at a speed, each once, with their stability."""
    found: list[KnownSolution] = []
    half, statics = motion.half, Statics(motion.model)

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
            np.abs(one.region.points - rest).max() < 1e-5 for one in found
        ):
            continue
        factorised()
        slopes = motion.jacobian(rest, u)
        values = statics.eigenvalues(p, u)
        stable = bool(decays(values).all())
        region = Region.about_rest(p, values)
        if stable:
            region = replace(region, basin=_basin(motion, rest, slopes, u))
        found.append(KnownSolution(stable, region))
    return found


def _basin(motion: VectorField, rest: Array, slopes: Array, u: float) -> Array | None:
    """`Region.basin` of a stable equilibrium, from where motions come to rest.

    There V, the sum of the modes' squared velocities, falls at least half as fast as linear theory
    says. That is asked of each mode at some phases and of mixtures, all at one V; what nonlinear
    forces change grows with a higher power of the distance, so that it holds nearer too.
    """
    values, vectors = np.linalg.eig(slopes)
    vectors = vectors * np.abs(values).min() / np.linalg.norm(vectors[motion.half :], axis=0)
    try:
        rows = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:  # of eigenvalues that meet
        return None
    rows = np.concatenate([rows.real, rows.imag])
    random, count = np.random.default_rng(0), values.size
    phases = np.exp(0.25j * math.pi * np.arange(8))
    alone = np.einsum("ik,p->ikp", vectors, phases).reshape(count, -1).real
    mixed = (vectors @ (random.normal(size=(count, MIXED, 2)) @ np.array([1.0, 1.0j]))).real
    away = np.concatenate([alone, mixed], axis=1)
    sizes = np.linalg.norm(rows @ away, axis=0)
    away = (away / sizes)[:, sizes > 1e-9]  # the phases of a real eigenvalue have zeros
    by_linear = 2.0 * np.sum((rows @ away) * (rows @ slopes @ away), axis=0)
    for radius in 0.5 * 0.7 ** np.arange(NARROWER):
        rates = motion(np.ascontiguousarray(rest[:, None] + radius * away), u) / radius
        if (2.0 * np.sum((rows @ away) * (rows @ rates), axis=0) <= 0.5 * by_linear).all():
            return np.asarray(rows / radius)
    return None
