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

TURN = 4.0
"""|lambda| h of an interval at most, for modes that persist: its error is 3e-8, of a half 5e-13."""


def floquet(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Complex, float]:
    """Floquet multipliers, the largest modulus first, shape (2 dof,), and the error of the worst.

    Raises:
        NewtonFailed: if they leave finite numbers.
    """
    # Halving leaves 2^-15 of the error where f is smooth, and 2^-3 across kinks of drag at phases
    # that are not known; of both some more is allowed for.
    some = motion.model.drag_velocities(*np.split(orbit.states(np.zeros(1)), 2))
    left = 0.25 if motion.model.pipe.drag and not some.size else 1e-3
    orbit = _fine_enough(motion, orbit)
    values, error = _multipliers(motion, orbit), math.inf
    for _ in range(MOST_HALVINGS):
        if error <= TOLERANCE or 2 * len(orbit.starts) > MOST:
            break
        orbit = refined(motion, orbit, np.full(len(orbit.starts), 2))
        coarser, values = values, _multipliers(motion, orbit)
        moved = np.abs(coarser[:, None] - values) / np.maximum(np.abs(values), 1.0)
        last, error = error, left * float(moved[linear_sum_assignment(moved)].max())
        if error > 0.5 * last:  # two that meet at 1, as at a Hopf point, have half the digits
            break
    # Rounded, as the moduli of a pair differ by rounding.
    sizes = np.log(np.maximum(np.abs(values), 1e-300)).round(11)
    order = np.lexsort((-values.imag, -sizes))
    return values[order].astype(np.complex128), error


def multiplier_roots(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    """The multipliers or, of an orbit with a mirror, eigenvalues over half a period, reflected.

    The multipliers are the squares of these: the trivial one is 1 either way, and a perturbation
    that breaks the mirror symmetry and neither grows nor decays has -1.
    """
    return _eigenvalues(motion, _fine_enough(motion, orbit))


def _multipliers(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    values = _eigenvalues(motion, orbit)
    return values**2 if orbit.symmetric else values


def _eigenvalues(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    """`multiplier_roots` on a given mesh."""
    factorised()
    with np.errstate(over="raise", invalid="raise"):
        try:
            left, right = through(motion, orbit)
            if motion.scene is not None and motion.constrained:
                allowed = _allowed(motion.scene, orbit.starts[0], motion.model.dof)
                values = np.linalg.eigvals(-allowed.T @ np.linalg.solve(right, left @ allowed))
            else:
                values = scipy.linalg.eigvals(left, -right)
            if not (np.abs(values) < 1e150).all():  # its square is finite
                raise FloatingPointError
        except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
            raise NewtonFailed("its Floquet multipliers left finite numbers") from error
    found: Complex = orbit.mirror * np.asarray(values, dtype=np.complex128)
    return found


def _fine_enough(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The same on a mesh that is fine enough for every mode that persists.

    A mode that decays by more than exp(-25) in a period ends below 1e-11 of its size.
    """
    some = np.ascontiguousarray(orbit.starts[:: len(orbit.starts) // 4].T)
    factorised(some.shape[1])
    rates = np.linalg.eigvals(motion.jacobians(some, orbit.u))
    persist = rates.real > -25.0 * orbit.frequency / orbit.span
    turns = orbit.durations * np.abs(rates[persist]).max(initial=0.0)
    parts = np.ceil(np.maximum(turns / TURN, 1.0)).astype(int)
    return refined(motion, orbit, parts) if 2 * parts.sum() <= MOST else orbit


def _allowed(scene: SceneMotion, y: Array, dof: int) -> Array:
    """An orthonormal basis of the perturbations of a state that meet the constraints."""
    h = 1e-5
    moves = h * np.eye(y.size)
    ahead, behind = (
        np.concatenate(scene.projected(*np.split(y[:, None] + sign * moves, 2)))
        for sign in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * dof])
