# SPDX-License-Identifier: MIT
"""Floquet multipliers of a cycle: the variational equation along it.

It is solved on panels (`panels.through`), other ones than the cycle was: short enough for the modes
that are fast and live on, and then halves of these. No monodromy matrix is formed: the multipliers
mu are those of the pencil L + mu R, so that neither modes that decay at once nor multipliers of a
thousand cost digits of the trivial one.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

from pipedyn.bifurcation.collocation import through
from pipedyn.bifurcation.fourier import Elsewhere
from pipedyn.bifurcation.mesh import Course, divided
from pipedyn.bifurcation.vector_field import Field
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.modular.motion import SceneMotion
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

SETTLED, MOST_HALVINGS, MOST = 1e-7, 4, 4000
"""Error of a multiplier, relative if above 1; halvings of the panels, and panels, to come there."""

LARGEST = 1e150
"""Modulus of a multiplier, whose square is finite still."""

TURN = 4.0
"""|lambda| h of a panel at most, for modes that live on: its error is 3e-8, of a half 5e-13."""

LIVES = 25.0
"""Decrements by which a mode has decayed so that it has no part in what a cycle leaves."""

LEFT, LEFT_ACROSS_KINKS = 1e-3, 0.25
"""Share of the error that halving leaves at most: 2^-15 where f is smooth, 2^-3 across kinks."""


def floquet(motion: Field, course: Course) -> tuple[Complex, float]:
    """Floquet multipliers, the largest modulus first, shape (2 dof,), and the error of the worst.

    Args:
        motion: the model's.
        course: the cycle.

    Raises:
        Elsewhere: if they leave finite numbers.
    """
    left = LEFT_ACROSS_KINKS if motion.hidden_kinks else LEFT
    course = shortened(motion, course)
    values, error = _multipliers(motion, course), math.inf
    for _ in range(MOST_HALVINGS):
        if error <= SETTLED or 2 * len(course.starts) > MOST:
            break
        course = divided(motion, course, np.full(len(course.starts), 2))
        coarser, values = values, _multipliers(motion, course)
        last, error = error, left * _apart(coarser, values)
        if error > 0.5 * last:  # two that meet at 1, as where a cycle is born, know half the digits
            break
    # Rounded, as the moduli of a pair differ by rounding.
    sizes = np.log(np.maximum(np.abs(values), 1e-300)).round(11)
    order = np.lexsort((-values.imag, -sizes))
    return values[order].astype(np.complex128), error


def _multipliers(motion: Field, course: Course) -> Complex:
    values = returns(motion, course)
    return values**2 if course.half else values


def returns(motion: Field, course: Course) -> Complex:
    """Eigenvalues over the span, with a mirror of half a period followed by the reflection.

    These are the multipliers, or with a mirror their roots: the trivial one is 1 either way, and a
    perturbation that breaks the mirror symmetry and neither grows nor decays has -1.

    Args:
        motion: the model's.
        course: the cycle, on panels that are short for what lives on.

    Raises:
        Elsewhere: if they are beyond LARGEST, as where R is singular to rounding.
    """
    factorised()
    with np.errstate(over="raise", invalid="raise"):
        try:
            left, right = through(motion, course)
            tangent = _tangent(motion, course)
            if tangent is None:
                values = scipy.linalg.eigvals(left, -right)
            else:
                values = np.linalg.eigvals(-tangent.T @ np.linalg.solve(right, left @ tangent))
        except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
            raise Elsewhere("its Floquet multipliers left finite numbers") from error
    if not (np.abs(values) < LARGEST).all():
        raise Elsewhere("its Floquet multipliers left finite numbers")
    found: Complex = course.mirror * np.asarray(values, dtype=np.complex128)
    return found


def shortened(motion: Field, course: Course) -> Course:
    """The same on panels that are short for every mode that lives on."""
    some = np.ascontiguousarray(course.starts[:: len(course.starts) // 4].T)
    factorised(some.shape[1])
    rates = np.linalg.eigvals(motion.jacobians(some, course.u))
    lives = rates.real > -LIVES * course.frequency / course.span
    turns = course.steps * np.abs(rates[lives]).max(initial=0.0)
    parts = np.ceil(np.maximum(turns / TURN, 1.0)).astype(int)
    return divided(motion, course, parts) if 2 * parts.sum() <= MOST else course


def _apart(a: Complex, b: Complex) -> float:
    """Largest difference of two sets of multipliers, relative to those above 1."""
    moved = np.abs(a[:, None] - b) / np.maximum(np.abs(b), 1.0)
    return float(moved[linear_sum_assignment(moved)].max())


def _tangent(motion: Field, course: Course) -> Array | None:
    """An orthonormal basis of the perturbations that meet the constraints, where there are any."""
    if not motion.tied:
        return None
    half, h = motion.half, 1e-5
    y = course.starts[0][:, None]
    moves = h * np.eye(motion.size)
    scene = motion.model.motion
    assert isinstance(scene, SceneMotion)
    ahead, behind = (
        np.concatenate(scene.projected((y + s * moves)[:half], (y + s * moves)[half:]))
        for s in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * motion.model.dof])
