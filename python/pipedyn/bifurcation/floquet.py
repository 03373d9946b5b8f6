# SPDX-License-Identifier: MIT
"""Floquet multipliers of a cycle: the variational equation along it.

It is solved by the same collocation (`collocation.through`) as the cycle, on another mesh: fine
enough for the modes that are fast and do not decay at once, and then on meshes twice as fine. No
monodromy matrix is formed: the multipliers mu are those of the pencil L + mu R, so that neither
modes that decay at once nor multipliers of a thousand cost digits of the trivial one.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

from pipedyn.bifurcation.collocation import through
from pipedyn.bifurcation.periodic_orbit import PeriodicOrbit, refined
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.modular.motion import SceneMotion
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed

TOLERANCE, MOST_HALVINGS, MOST = 1e-7, 4, 4000
"""Error of a multiplier, relative if above 1: a tenth of what the trivial one may be off; halvings
of mesh intervals to come there, of which one mostly does, and intervals: 2 GB for 100 segments."""

LARGEST = 1e150
"""Modulus of a multiplier, whose square is finite still."""

TURN = 4.0
"""|lambda| h of an interval at most, for modes that persist: its error is 3e-8, of a half 5e-13."""

PERSISTS = 25.0
"""Decrements over a cycle with which a mode persists: with more it ends below 1e-11 of its size."""

LEFT, LEFT_ACROSS_KINKS = 1e-3, 0.25
"""Share of the error that halving leaves at most: 2^-15 where f is smooth, 2^-3 across kinks."""


def floquet(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Complex, float]:
    """Floquet multipliers, the largest modulus first, shape (2 dof,), and the error of the worst.

    Args:
        motion: the model's.
        orbit: the periodic orbit.

    Raises:
        NewtonFailed: if they leave finite numbers.
    """
    left = LEFT_ACROSS_KINKS if motion.hidden_kinks else LEFT
    orbit = shortened(motion, orbit)
    values, error = _multipliers(motion, orbit), math.inf
    for _ in range(MOST_HALVINGS):
        if error <= TOLERANCE or 2 * len(orbit.starts) > MOST:
            break
        orbit = refined(motion, orbit, np.full(len(orbit.starts), 2))
        coarser, values = values, _multipliers(motion, orbit)
        last, error = error, left * _apart(coarser, values)
        if error > 0.5 * last:  # two that meet at 1, as at a Hopf point, have half the digits
            break
    # Rounded, as the moduli of a pair differ by rounding.
    sizes = np.log(np.maximum(np.abs(values), 1e-300)).round(11)
    order = np.lexsort((-values.imag, -sizes))
    return values[order].astype(np.complex128), error


def _multipliers(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    values = returns(motion, orbit)
    return values**2 if orbit.symmetric else values


def returns(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    """Eigenvalues over the span, with a mirror of half a period followed by the reflection.

    These are the multipliers, or with a mirror their roots: the trivial one is 1 either way, and a
    perturbation that breaks the mirror symmetry and neither grows nor decays has -1.

    Args:
        motion: the model's.
        orbit: the periodic orbit, on a mesh that is fine enough for modes that persist.

    Raises:
        NewtonFailed: if they are beyond LARGEST, as where R is singular to rounding.
    """
    factorised()
    with np.errstate(over="raise", invalid="raise"):
        try:
            left, right = through(motion, orbit)
            tangent = _tangent(motion, orbit)
            if tangent is None:
                values = scipy.linalg.eigvals(left, -right)
            else:
                values = np.linalg.eigvals(-tangent.T @ np.linalg.solve(right, left @ tangent))
        except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
            raise NewtonFailed("its Floquet multipliers left finite numbers") from error
    if not (np.abs(values) < LARGEST).all():
        raise NewtonFailed("its Floquet multipliers left finite numbers")
    found: Complex = orbit.mirror * np.asarray(values, dtype=np.complex128)
    return found


def shortened(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The same on a mesh that is fine enough for every mode that persists."""
    some = np.ascontiguousarray(orbit.starts[:: len(orbit.starts) // 4].T)
    factorised(some.shape[1])
    rates = np.linalg.eigvals(motion.jacobians(some, orbit.u))
    persist = rates.real > -PERSISTS * orbit.frequency / orbit.span
    turns = orbit.durations * np.abs(rates[persist]).max(initial=0.0)
    parts = np.ceil(np.maximum(turns / TURN, 1.0)).astype(int)
    return refined(motion, orbit, parts) if 2 * parts.sum() <= MOST else orbit


def _apart(a: Complex, b: Complex) -> float:
    """Largest difference of two sets of multipliers, relative to those above 1."""
    moved = np.abs(a[:, None] - b) / np.maximum(np.abs(b), 1.0)
    return float(moved[linear_sum_assignment(moved)].max())


def _tangent(motion: VectorField, orbit: PeriodicOrbit) -> Array | None:
    """An orthonormal basis of the perturbations that meet the constraints, where there are any."""
    if not motion.constrained:
        return None
    half, h = motion.half, 1e-5
    y = orbit.starts[0][:, None]
    moves = h * np.eye(motion.size)
    scene = motion.model.motion
    assert isinstance(scene, SceneMotion)
    ahead, behind = (
        np.concatenate(scene.projected((y + s * moves)[:half], (y + s * moves)[half:]))
        for s in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * motion.model.dof])
