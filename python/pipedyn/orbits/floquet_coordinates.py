# SPDX-License-Identifier: MIT
"""Floquet coordinates about a stable cycle: distances of a state along each Floquet vector.

They are the products of the adjoint solutions of the variational equation with the difference of a
state from the cycle. To first order they do not change with a shift along the cycle, and the
modulus of each decays at its own constant rate, whereas distances swing between the axes of an
ellipse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import condensed
from pipedyn.orbits.floquet import fast_turns, parts_for
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, integrals
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations

POINTS = 256
"""Least number of points on a cycle: a state is compared with a point so near that Floquet vectors
change by a hundredth on the way to it."""

PLACES = 6
"""Least number of points in an interval of the mesh of a cycle: with three points, states on a
cycle of 21 maxima were up to 5e-3 from the curve through the points."""

ACCURACY = 1e-4
"""Error allowed for the multipliers: rates of decay need no more accuracy."""

LEAST_MULTIPLIER = 1e-3
"""Multiplier over the orbit, or over half of a symmetric one, below which a coordinate is left
out."""

MOST_COORDINATES = 8
"""Largest number of coordinates, those that decay most slowly: the others soon vanish beside them.
With this number, the coordinates about a cycle of 50 segments take 2 MB."""


@dataclass(frozen=True, eq=False)
class FloquetCoordinates:
    """Floquet coordinates about a cycle, without the shift and those that vanish in a period.

    Attributes:
        rows: rows whose products with the difference of a state from each of the K points at
            `point_phases` are the coordinates, but for their sign if the second half of a cycle
            mirrors the first, (K or K / 2, k, 2 integrated).
        decay: rates at which the moduli decay, in 1 / T, (k,).
    """

    rows: Complex
    decay: Array


def modal_coordinates(slopes: Array, units: Array, trivial: int = 0) -> FloquetCoordinates:
    """Floquet coordinates about a stable equilibrium, which are its modal coordinates.

    Args:
        slopes: the derivative of the rates by the state, in the frame in which it is at rest.
        units: units of the states, (2 integrated,), in which eigenvectors have length 1.
        trivial: number of eigenvalues nearest to 0 that are left out, those of turns.

    Raises:
        LinAlgError: if two eigenvectors coincide.
    """
    count_factorisations()
    values, vectors = np.linalg.eig(slopes)
    others = np.argsort(np.abs(values))[trivial:]
    kept = others[np.argsort(-values[others].real)][:MOST_COORDINATES]
    rows = np.linalg.inv(vectors / np.linalg.norm(vectors * units[:, None], axis=0))[kept]
    return FloquetCoordinates(rows[None], -values.real[kept])


def floquet_coordinates(
    motion: VectorField, orbit: PeriodicOrbit, units: Array
) -> FloquetCoordinates:
    """The Floquet coordinates about a stable orbit.

    Args:
        motion: vector field of the orbit.
        orbit: the orbit.
        units: units of the states, (2 integrated,), in which eigenvectors have length 1.

    Raises:
        LinAlgError: if fast modes need a finer mesh than the orbit's, no coordinate decays slowly
            enough, or two Floquet vectors coincide.
    """
    if (parts_for(fast_turns(motion, orbit), ACCURACY) > 1).any():
        raise np.linalg.LinAlgError("fast modes need a finer mesh")
    phases = point_phases(orbit)
    within = phases[phases < orbit.span].reshape(len(orbit.starts), -1, 1)
    places = within.shape[1]
    maps, ends = _maps_to(motion, orbit, np.arange(places) / places)
    whole = np.eye(motion.size)
    begins = []
    for one in ends:
        begins.append(whole)
        whole = one @ whole
    count_factorisations()
    values, vectors = np.linalg.eig(orbit.mirror_sign * whole)
    vectors = vectors / np.linalg.norm(vectors * units[:, None], axis=0)
    moduli = np.abs(values)
    trivial = 2 if motion.model.axisymmetric else 1
    moduli[np.argsort(np.abs(values - 1.0))[:trivial]] = 0.0
    kept = np.argsort(-moduli)[:MOST_COORDINATES]
    kept = kept[moduli[kept] > LEAST_MULTIPLIER]
    if not kept.size or moduli[kept[0]] >= 1.0:
        raise np.linalg.LinAlgError("no coordinate decays slowly")
    rows = np.linalg.inv(vectors)[kept]
    parts_of_rows = np.concatenate([rows.real, rows.imag]).T
    to_here = maps @ np.array(begins)[:, None]  # maps from phase 0
    found = np.linalg.solve(to_here.swapaxes(2, 3), parts_of_rows)
    here = found[..., : kept.size] + 1j * found[..., kept.size :]
    sizes = moduli[kept] ** (within / orbit.span)
    rows = (sizes[..., None] * here.swapaxes(2, 3)).reshape(-1, *rows.shape)
    decay = -np.log(moduli[kept]) * orbit.frequency / orbit.span
    return FloquetCoordinates(rows, decay)


def point_phases(orbit: PeriodicOrbit) -> Array:
    """Phases of points on a whole cycle, equally spaced in each interval of its mesh."""
    places = math.ceil((0.5 if orbit.symmetric else 1.0) * POINTS / len(orbit.starts))
    places = max(places, PLACES)
    return orbit.sampled(places, whole=True)[0][:-1]


def _maps_to(motion: VectorField, orbit: PeriodicOrbit, places: Array) -> tuple[Array, Array]:
    """Maps of changes of state from the beginning of each interval to places in it and its end.

    Their shapes are (M, k, n, n) and (M, n, n).
    """
    h, half, n = orbit.durations[:, None, None, None], orbit.half, motion.size
    # Derivatives of the accelerations at the stages by the state where the interval begins.
    rates = condensed(motion, orbit, of_states=True).by_rates.reshape(*orbit.rates.shape, n)
    places = np.append(places, 1.0)
    single, double = integrals(places, 1), integrals(places, 2)
    maps = np.zeros((len(orbit.starts), places.size, n, n))
    maps[:] = np.eye(n)
    maps[:, :, np.arange(half), half + np.arange(half)] = h[..., 0] * places[:, None]
    maps[:, :, :half] += h**2 * np.einsum("ks,msij->mkij", double, rates)
    maps[:, :, half:] += h * np.einsum("ks,msij->mkij", single, rates)
    return maps[:, :-1], maps[:, -1]
