# SPDX-License-Identifier: MIT
"""Floquet coordinates about a stable cycle: distances of a state along each Floquet vector.

They are the products of the adjoint solutions of the variational equation with the difference of a
state from the cycle. To first order they do not change with a shift along the cycle, and the
modulus of each decays at its own constant rate, whereas distances swing between the axes of an
ellipse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipedyn.linear.eigenproblem import Complex
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import interval_derivatives
from pipedyn.orbits.floquet import parts_for
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, both_integrals, refined
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.later import scipy

POINTS = 256
"""Least number of points on a period: a state is compared with a point so near that the rows change
by a hundredth on the way to it."""

ACCURACY = 1e-4
"""Error allowed for the multipliers: rates of decay need no more accuracy."""

PHASE_STEP = 1e-4
"""Change of phase over which the second derivatives of a cycle are taken."""

GONE = 1e-3
"""Multiplier over the orbit, or over half of a symmetric one, below which a coordinate is left
out."""

MOST_COORDINATES = 8
"""Largest number of coordinates, those that decay most slowly: the others soon vanish beside them.
With this number, the coordinates about a cycle of 50 segments take 2 MB."""


@dataclass(frozen=True, eq=False)
class FloquetCoordinates:
    """Floquet coordinates about a cycle, without the shift and those that vanish in a period.

    Attributes:
        points: states [p, p'] on the cycle, (K, 2 integrated).
        rates: first and second derivatives of these states in time, (2, K, 2 integrated).
        rows: rows whose products with the difference of a state from the cycle are the coordinates,
            but for their sign if the second half of a cycle mirrors the first, (K or K / 2, k, 2
            integrated).
        decay: rates at which the moduli decay, in 1 / T, (k,).
        units: units of the states in which the nearest point is looked for, (2 integrated,).
    """

    points: Array
    rates: Array
    rows: Complex
    decay: Array
    units: Array

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        return scipy.spatial.cKDTree(self.points * self.units)

    def mirrored(self) -> FloquetCoordinates:
        """The coordinates about the mirror image of the cycle."""
        return replace(self, points=-self.points, rates=-self.rates)

    def __call__(self, states: Array) -> Complex:
        """The coordinates, (N, k), of states, (N, 2 integrated)."""
        _, near = self._tree.query(states * self.units)
        away, (once, twice) = states - self.points[near], self.rates[:, near]
        # The difference, to third order in the time by which the state is ahead of the point.
        along = once * self.units**2
        ahead = np.sum(along * away, axis=1, keepdims=True)
        ahead /= np.maximum(np.sum(along * once, axis=1, keepdims=True), 1e-300)  # 0 at rest
        away = away - ahead * once - 0.5 * ahead**2 * twice
        return np.asarray(np.einsum("nki,ni->nk", self.rows[near % len(self.rows)], away))


def modal_coordinates(
    motion: VectorField, rest: Array, u: float, units: Array
) -> FloquetCoordinates | None:
    """Floquet coordinates about a stable equilibrium, which are its modal coordinates.

    Args:
        motion: the vector field.
        rest: the equilibrium, a state [p, p'], shape (2 integrated,).
        u: flow speed.
        units: see `FloquetCoordinates`; eigenvectors have length 1 in them.

    Returns:
        The coordinates, or None if two eigenvectors coincide.
    """
    factorised()
    values, vectors = np.linalg.eig(motion.jacobian(rest, u))
    kept = np.argsort(-values.real)[:MOST_COORDINATES]
    try:
        rows = np.linalg.inv(vectors / np.linalg.norm(vectors * units[:, None], axis=0))[kept]
    except np.linalg.LinAlgError:
        return None
    rates = np.zeros((2, 1, rest.size))
    return FloquetCoordinates(rest[None], rates, rows[None], -values.real[kept], units)


def floquet_coordinates(
    motion: VectorField, orbit: PeriodicOrbit, units: Array
) -> FloquetCoordinates | None:
    """The Floquet coordinates about a stable orbit; None if they cannot be computed.

    They cannot be computed if fast modes need a finer mesh than twice the orbit's, or if two
    Floquet vectors coincide.

    Args:
        motion: vector field of the orbit.
        orbit: the orbit.
        units: see `FloquetCoordinates`; eigenvectors have length 1 in them.
    """
    parts = parts_for(motion, orbit, ACCURACY)
    if parts.sum() > 2 * parts.size:
        return None
    if (parts > 1).any():
        orbit = refined(motion, orbit, parts)
    count = len(orbit.starts)
    places = math.ceil(0.5 * POINTS / count if orbit.symmetric else POINTS / count)
    maps, ends = _maps_to(motion, orbit, np.arange(places) / places)
    whole = np.eye(motion.size)
    begins = []
    for one in ends:
        begins.append(whole)
        whole = one @ whole
    factorised()
    values, vectors = np.linalg.eig(orbit.mirror * whole)
    vectors = vectors / np.linalg.norm(vectors * units[:, None], axis=0)
    moduli = np.abs(values)
    moduli[np.abs(values - 1.0).argmin()] = 0.0  # the trivial one
    kept = np.argsort(-moduli)[:MOST_COORDINATES]
    kept = kept[moduli[kept] > GONE]
    if not kept.size or moduli[kept[0]] >= 1.0:
        return None
    try:
        rows = np.linalg.inv(vectors)[kept]
        parts_of_rows = np.concatenate([rows.real, rows.imag]).T
        to_here = maps @ np.array(begins)[:, None]  # maps from phase 0
        found = np.linalg.solve(to_here.swapaxes(2, 3), parts_of_rows)
    except np.linalg.LinAlgError:
        return None
    here = found[..., : kept.size] + 1j * found[..., kept.size :]
    shares = orbit.edges[:-1, None] + np.diff(orbit.edges)[:, None] * np.arange(places) / places
    sizes = moduli[kept] ** (shares / orbit.span)[..., None]
    rows = (sizes[..., None] * here.swapaxes(2, 3)).reshape(-1, *rows.shape)
    _, states = orbit.sampled(places)
    on = np.ascontiguousarray(states[:, :-1])
    once, step = motion(on, orbit.u), PHASE_STEP / orbit.frequency
    change = motion(on + step * once, orbit.u) - motion(on - step * once, orbit.u)
    points, rates = on.T, np.stack([once.T, 0.5 / step * change.T])
    if orbit.symmetric:
        points, rates = np.concatenate([points, -points]), np.concatenate([rates, -rates], axis=1)
    decay = -np.log(moduli[kept]) * orbit.frequency / orbit.span
    return FloquetCoordinates(points, rates, rows, decay, units)


def _maps_to(motion: VectorField, orbit: PeriodicOrbit, places: Array) -> tuple[Array, Array]:
    """Maps of changes of state from the beginning of each interval to places in it and its end.

    Their shapes are (M, k, n, n) and (M, n, n).
    """
    h, half, n = orbit.durations[:, None, None, None], orbit.half, motion.size
    rates = interval_derivatives(motion, orbit)
    places = np.append(places, 1.0)
    once, twice = both_integrals(places)
    maps = np.zeros((len(orbit.starts), places.size, n, n))
    maps[:] = np.eye(n)
    maps[:, :, np.arange(half), half + np.arange(half)] = h[..., 0] * places[:, None]
    maps[:, :, :half] += h**2 * np.einsum("ks,msij->mkij", twice, rates)
    maps[:, :, half:] += h * np.einsum("ks,msij->mkij", once, rates)
    return maps[:, :-1], maps[:, -1]
