# SPDX-License-Identifier: MIT
"""Floquet multipliers of a cycle: the variational equation along it.

It is solved by a Magnus method of sixth order (Blanes, Casas and Ros 2000), whose exponentials take
fast modes in long steps. It shares nothing with the collocation but the cycle, so the trivial
multiplier checks both.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy.linalg

from pipedyn._check import Array
from pipedyn.collocation import Equations, Orbit
from pipedyn.field import Field
from pipedyn.modular.moving import SceneMotion
from pipedyn.pencil import Complex

LOCAL, MOST_STEPS, MOST_HALVINGS = 1e-8, 10_000, 20
"""Of the variational equation: error of one step, most steps of one length and halvings of one."""

LONGEST_TURN = 6.0
"""Radians that the fastest mode turns in one step at most: beyond some 30 the commutators grow."""

FEWEST, FEWEST_ACROSS_KINKS = 16, 128
"""Steps to begin with: a kink beside the end of one may lie out of sight of all its points."""


def floquet(motion: Field, orbit: Orbit) -> tuple[Complex, float]:
    """Floquet multipliers, the largest modulus first, shape (2 dof,), and the steps' summed error.

    Args:
        motion: the model's.
        orbit: the cycle.
    """
    values, error = returns(motion, orbit)
    if orbit.phases.half:
        values = values**2
    order = np.lexsort((-values.imag, -np.abs(values)))
    return values[order], error


def returns(motion: Field, orbit: Orbit) -> tuple[Complex, float]:
    """Eigenvalues over the phases' span, with a mirror of half a period followed by the reflection.

    These are the multipliers, or with a mirror their roots: the trivial one is 1 either way, and a
    perturbation that breaks the mirror symmetry and neither grows nor decays has -1.

    Args:
        motion: the model's.
        orbit: the cycle.
    """
    tangent = _tangent(motion, orbit)
    through, error = _monodromy(motion, orbit)
    if not np.isfinite(through).all():
        return np.full(2 * motion.model.dof, np.nan + 0j), math.inf
    if tangent is not None:
        through = tangent.T @ through @ tangent
    values: Complex = np.linalg.eigvals(through).astype(np.complex128)
    return values, error


def _tangent(motion: Field, orbit: Orbit) -> Array | None:
    """An orthonormal basis of the perturbations that meet the constraints, where there are any."""
    if not motion.tied:
        return None
    half, h = motion.half, 1e-5
    y = Equations(motion, orbit.phases).states(orbit, np.zeros(1))
    moves = h * np.eye(motion.size)
    scene = motion.model.motion
    assert isinstance(scene, SceneMotion)
    ahead, behind = (
        np.concatenate(scene.projected((y + s * moves)[:half], (y + s * moves)[half:]))
        for s in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * motion.model.dof])


def _monodromy(motion: Field, orbit: Orbit) -> tuple[Array, float]:
    """Fundamental matrix over the phases' span; with a mirror, followed by the reflection.

    Each step is halved until the product of its halves does what it does itself, so that short
    steps are taken only where drag's derivative has kinks.
    """
    span, omega, half = orbit.phases.span, orbit.frequency, motion.half
    along = _jacobians_along(motion, orbit)
    first = along(np.zeros(1))[0]
    # Rates in units in which the fastest mode turns at about the rate of its coordinates: without,
    # the squarings of the exponential would lose digits to the matrix's lopsidedness.
    ratio = math.sqrt(max(float(np.abs(first[half:, :half]).max()), 1.0))
    by, back = np.ones(motion.size), np.ones(motion.size)
    by[half:], back[half:] = 1.0 / ratio, ratio
    turns = float(np.abs(np.linalg.eigvals(first)).max()) * span / omega
    fewest = FEWEST_ACROSS_KINKS if motion.model.pipe.drag else FEWEST
    steps = max(fewest, math.ceil(turns / LONGEST_TURN))

    def factors(starts: Array, length: float) -> Array:
        found = np.empty((starts.size, motion.size, motion.size))
        nodes = length * (0.5 + math.sqrt(0.15) * np.array([-1.0, 0.0, 1.0]))
        for i in range(0, starts.size, 64):
            rates = along((starts[i : i + 64, None] + nodes).ravel()) * np.outer(by, back)
            rates = rates.reshape(-1, 3, motion.size, motion.size)
            with np.errstate(over="ignore", invalid="ignore"):  # steps too long: NaN tells
                found[i : i + 64] = scipy.linalg.expm(_magnus(length / omega, rates))
        return found

    length = span / steps
    starts = length * np.arange(float(steps))
    whole = factors(starts, length)
    done: list[tuple[float, Array]] = []
    error = 0.0
    for level in range(MOST_HALVINGS + 1):
        length *= 0.5
        starts = (starts[:, None] + length * np.arange(2.0)).ravel()
        parts = factors(starts, length)
        products = parts[1::2] @ parts[0::2]
        told = np.abs(products - whole).max(axis=(1, 2)) / (1.0 + np.abs(whole).max(axis=(1, 2)))
        good = told <= LOCAL
        if level == MOST_HALVINGS or 2 * np.sum(~good) > MOST_STEPS:
            good[:] = True
        done += [(starts[2 * i], products[i]) for i in np.flatnonzero(good)]
        error += float(told[good].sum())
        again = np.repeat(~good, 2)
        starts, whole = starts[again], parts[again]
        if starts.size == 0:
            break
    through = np.eye(motion.size)
    for _, product in sorted(done, key=lambda pair: pair[0]):
        through = product @ through
    through = through * np.outer(back, by)
    # What halving leaves: less than a quarter at a kink, a 64th where f is smooth.
    error /= 4.0 if motion.model.pipe.drag else 32.0
    return -through if orbit.phases.half else through, error


def _jacobians_along(motion: Field, orbit: Orbit) -> Callable[[Array], Array]:
    """df/dy at phases, shape (k,) to (k, 2 moving, 2 moving).

    Where f is smooth this is a trigonometric polynomial as the cycle is, of the period of the
    phases' span even if the cycle's is twice that, and few Jacobians tell it all.
    """
    equations = Equations(motion, orbit.phases)

    def exact(phase: Array) -> Array:
        return motion.jacobians(equations.states(orbit, phase), orbit.u)

    if motion.model.pipe.drag:
        return exact
    for share in (2, 4, 8):
        between = _interpolated(exact, orbit.phases.span, share * orbit.phases.count)
        if between is not None:
            return between
    return exact


def _interpolated(
    exact: Callable[[Array], Array], span: float, count: int
) -> Callable[[Array], Array] | None:
    """Trigonometric polynomials through values at equal phases; None where they miss others."""
    at: Array = span / count * np.arange(float(count))
    samples = exact(at)
    size = samples.shape[-1]
    waves = np.fft.rfft(samples.reshape(count, -1), axis=0) / count
    waves[1:] *= 2.0
    if count % 2 == 0:
        waves[-1] *= 0.5
    largest = np.abs(samples).max(axis=0)
    weight = (np.abs(waves) / (largest + 1e-6 * largest.max()).ravel()).max(axis=1)
    waves = waves[: int(np.flatnonzero(weight > 1e-12).max(initial=0)) + 1]
    numbers = 2.0 * math.pi / span * np.arange(len(waves))

    def between(phase: Array) -> Array:
        angle = np.outer(phase, numbers)
        values = np.cos(angle) @ waves.real - np.sin(angle) @ waves.imag
        return values.reshape(-1, size, size)

    probe: Array = at[::7] + 0.43 * span / count
    missed = np.abs(between(probe) - exact(probe)).max(axis=0)
    good = bool((missed <= 1e-9 * largest + 1e-12 * largest.max()).all())
    return between if good else None


def _magnus(h: float, a: Array) -> Array:
    """Exponents of the steps, (k, N, N), from the matrices at three Gauss points, (k, 3, N, N)."""
    one = h * a[:, 1]
    two = math.sqrt(15.0) / 3.0 * h * (a[:, 2] - a[:, 0])
    three = 10.0 / 3.0 * h * (a[:, 2] - 2.0 * a[:, 1] + a[:, 0])

    def across(x: Array, y: Array) -> Array:
        return x @ y - y @ x

    first = across(one, two)
    second = -across(one, 2.0 * three + first) / 60.0
    exponents: Array = (
        one + three / 12.0 + across(-20.0 * one - three + first, two + second) / 240.0
    )
    return exponents
