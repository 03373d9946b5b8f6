# SPDX-License-Identifier: MIT
"""What a periodic orbit is: amplitude, frequency and Floquet multipliers, and how well it is known.

An orbit is refined until amplitude and frequency converge and the trivial multiplier is 1. Mesh
intervals are short where the motion asks for it; modes that decay far faster than the cycle turns
need no shorter ones, as Radau's method is L-stable.

The multipliers are those of the variational equation along the cycle. It is solved by the same
collocation (`collocation.through`), on another mesh: fine enough for the modes that are fast and do
not decay at once, and then on meshes twice as fine. No monodromy matrix is formed: the multipliers
mu are those of the pencil L + mu R, so that neither modes that decay at once nor multipliers of a
thousand cost digits of the trivial one.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import field

import numpy as np
import scipy.linalg
from scipy.optimize import linear_sum_assignment

from pipedyn.bifurcation.collocation import residual, solved, through
from pipedyn.bifurcation.events import nontrivial
from pipedyn.bifurcation.periodic_orbit import PeriodicOrbit, refined
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.motion.simulate import Trajectory
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result

MOST_INTERVALS = 2000
"""Intervals of a mesh: beyond, one Newton step of a chain of 20 segments takes some seconds."""

CHECKS = 3
"""Meshes on which the multipliers are asked for, each for a hundredth of the defect of the last: by
the third that is 1e-7 of rtol, where rounding is all that is left."""

TRIVIAL, SHARE_OF_NEXT = 1e-6, 0.01
"""How far the trivial multiplier may be from 1: the tolerance to which users ask for cycles or, if
that is more, this share of the distance from 1 of the next multiplier. What moves the one moves the
other about as far, and up to a hundredth the next one's side of 1 is certain."""

TOLERANCE, MOST_HALVINGS, MOST = 1e-7, 4, 4000
"""Error of a multiplier, relative if above 1: a tenth of what the trivial one may be off. Halvings
of mesh intervals to get there: one mostly does. Mesh intervals: 2 GB for 100 segments."""

TURN = 4.0
"""Largest |lambda| h of an interval, for modes that persist: the error is 3e-8, at half 5e-13."""


@result
class LimitCycle(Trajectory):
    """One period of a periodic motion.

    Attributes:
        amplitude: half the peak-to-peak transverse motion of the free end, in L.
        frequency: angular, in 1 / T.
        period: in T.
        multipliers: Floquet multipliers, complex, shape (2 dof,), the largest modulus first; the
            trivial one, 1, among them.
        stable: whether all others are smaller than 1 in modulus.
        t: times from 0, where the free end is farthest to positive x, to the period, shape (S,).
        q, qdot: coordinates and rates, shape (S, coordinates).
        u: flow speed.
        model: the model.
        error: of amplitude and frequency, relative, estimated by refinement: what the last
            halving of mesh intervals changed.
        multiplier_error: distance of the trivial multiplier from 1, or what halving the mesh
            intervals changes in the worst, relative if above 1, or rounding, whichever is most.
        residual: largest |dy/dt - f(y)| half-way between the stages at which the equations were
            solved, relative to the largest |f|, of the accelerations.
        symmetric: whether the second half of the period was taken as the mirror image of the first.
        phases: number of states solved for.
        evaluations: right-hand sides and Jacobians.
        method: how it was found.
        orbit: the solution of the collocation equations, from which other searches set out.
    """

    amplitude: float
    frequency: float
    period: float
    multipliers: Complex = field(repr=False)
    stable: bool
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    qdot: Array = field(repr=False)
    u: float
    model: Model
    error: float
    multiplier_error: float
    residual: float
    symmetric: bool
    phases: int
    evaluations: int
    method: str
    orbit: PeriodicOrbit = field(repr=False, compare=False)

    @property
    def tip(self) -> Array:
        """Position (x, y) of the free end, shape (S, 2)."""
        return self.model.tips(self.q.T)

    @property
    def others(self) -> Complex:
        """Multipliers without the trivial one, shape (2 dof - 1,)."""
        return nontrivial(self.multipliers)


class NoCycle(PipedynError):
    """No limit cycle was found.

    Attributes:
        u: flow speed.
    """

    def __init__(self, message: str, u: float) -> None:
        super().__init__(message, u)
        self.u = u


def finished(
    motion: VectorField, orbit: PeriodicOrbit, rtol: float, samples: int, how: str
) -> LimitCycle:
    """The cycle, refined until its amplitude and frequency converge and its multipliers are right.

    Raises:
        NotConverged: if the tolerance is out of reach; `result` holds what was reached.
    """
    # Defects with which the first answer mostly meets rtol: the mesh follows the kinks of drag.
    largest = rtol * (1e-1 if motion.model.pipe.drag else 1e-3)
    tolerance = min(1e-7, 1e-2 * rtol)
    for _ in range(CHECKS):
        orbit, error, reason = _refined(motion, orbit, largest, rtol, tolerance)
        try:
            result = described(motion, orbit, error, samples, how)
        except NewtonFailed as failure:
            raise NotConverged(f"the cycle at u = {orbit.u:g} fails its check: {failure}") from None
        if error > rtol:
            raise NotConverged(
                f"the cycle at u = {orbit.u:g} is known to {error:.1e} only: {reason}", result
            )
        if result.multiplier_error <= max(rtol, _allowed(result.others)):
            return result
        largest *= 0.01  # the multipliers need a finer mesh
    raise NotConverged(
        f"the cycle at u = {orbit.u:g} fails its check: its Floquet multipliers, one of which "
        f"should be 1, are known to {result.multiplier_error:.1e} only",
        result,
    )


def _allowed(others: Complex) -> float:
    """Error of the trivial multiplier that the nearest of the others accounts for.

    A change of the equations by eps moves a multiplier by eps / d if another lies d away.
    """
    apart = float(np.abs(others - 1.0).min(initial=1.0))
    return max(TRIVIAL, min(SHARE_OF_NEXT * apart, TRIVIAL / apart))


def _refined(
    motion: VectorField, orbit: PeriodicOrbit, largest: float, rtol: float, tolerance: float
) -> tuple[PeriodicOrbit, float, str]:
    """The orbit on a finer mesh, what the last refinement changed, and why it went no further.

    Refined are the intervals with a large defect, and all of them where there is none, until what
    is left of the defects is rounding, which halving does not lessen.
    """
    # Under drag two answers may agree by chance: an error falls by the fourth power of h at most.
    measured, error, worst = amplitude_of(motion, orbit)[0], math.inf, math.inf
    last = math.inf if motion.model.pipe.drag else 0.0
    while True:
        defects = orbit.defects()
        coarse, coarsest, worst = defects > largest, worst, float(defects.max())
        if error <= 0.5 * rtol and (not coarse.any() or worst > 0.5 * coarsest):
            return orbit, error, ""
        if not coarse.any():
            coarse[:] = True
        if len(orbit.starts) + np.count_nonzero(coarse) > MOST_INTERVALS:
            return orbit, error, f"that takes more than {MOST_INTERVALS} mesh intervals"
        try:
            finer = solved(motion, refined(motion, orbit, 1 + coarse, turning=True), tolerance)
        except NewtonFailed as failure:
            return orbit, error, str(failure)
        before, measured = measured, amplitude_of(motion, finer)[0]
        change = max(abs(measured / before - 1.0), abs(finer.frequency / orbit.frequency - 1.0))
        change = max(change, 1e-13)  # answers of ever finer meshes differ by some 3e-14
        error, last = max(change, last / 16.0), change
        orbit = finer


def amplitude_of(motion: VectorField, orbit: PeriodicOrbit) -> tuple[float, float]:
    """Half the free end's peak-to-peak motion, and the phase of its greatest displacement."""
    count = 2048  # fine enough for the polynomial that then goes through the extremes
    apart = 2.0 * math.pi / count
    across = motion.tip(orbit.states(apart * np.arange(float(count))))
    greatest, where = _peak(across)
    least, _ = _peak(-across)
    return 0.5 * (greatest + least), apart * where


def _peak(values: Array) -> tuple[float, float]:
    """Maximum of a periodic function and its place, by the polynomial through five samples."""
    i = int(np.argmax(values))
    near = values[np.arange(i - 2, i + 3) % values.size]
    line = np.polynomial.Polynomial.fit(np.arange(-2.0, 3.0), near, 4)
    turns = line.deriv().roots()
    inner = turns.real[(np.abs(turns.imag) < 1e-9) & (np.abs(turns.real) <= 1.0)]
    if inner.size == 0:
        return float(values[i]), float(i)
    heights = line(inner)
    return float(heights.max()), i + float(inner[int(np.argmax(heights))])


def on_branch(
    motion: VectorField, orbit: PeriodicOrbit, error: float, samples: int, how: str
) -> LimitCycle:
    """The cycle of an orbit on a branch: its error is given, its multipliers are checked."""
    result = described(motion, orbit, error, samples, how)
    if result.multiplier_error <= 1e-4:  # a tenth of what ends a branch
        return result
    with suppress(NewtonFailed):  # where neighbours diverge fast a finer mesh is needed
        finer = refined(motion, orbit, np.full(len(orbit.starts), 2), turning=True)
        better = described(motion, solved(motion, finer, 1e-9), result.error, samples, how)
        return min(result, better, key=lambda cycle: cycle.multiplier_error)
    return result


def described(
    motion: VectorField, orbit: PeriodicOrbit, error: float, samples: int, how: str
) -> LimitCycle:
    """The cycle of an orbit on its mesh; raises `NewtonFailed` as `floquet` does."""
    amplitude, first = amplitude_of(motion, orbit)
    period = 2.0 * math.pi / orbit.frequency
    t = np.linspace(0.0, period, samples)
    y = orbit.states(first + orbit.frequency * t)
    q, qdot = motion.model.recorded(y[: motion.half].T.copy(), y[motion.half :].T.copy())
    multipliers, _, change = floquet(motion, orbit)
    # Rounding of eigenvalues of matrices of so many rows leaves about as much.
    change = max(change, multipliers.size * float(np.finfo(float).eps))
    others = np.abs(nontrivial(multipliers))
    return LimitCycle(
        amplitude=amplitude,
        frequency=orbit.frequency,
        period=period,
        multipliers=multipliers,
        stable=bool(others.max(initial=0.0) < 1.0),
        t=t,
        q=np.ascontiguousarray(q),
        qdot=np.ascontiguousarray(qdot),
        u=orbit.u,
        model=motion.model,
        error=error,
        multiplier_error=max(float(np.abs(multipliers - 1.0).min()), change),
        residual=residual(motion, orbit),
        symmetric=orbit.symmetric,
        phases=orbit.rates.shape[0] * orbit.rates.shape[1],
        evaluations=motion.evaluations,
        method=f"collocation, {how}",
        orbit=orbit,
    )


# ------------------------------------------------------------------------ Floquet multipliers


def floquet(motion: VectorField, orbit: PeriodicOrbit) -> tuple[Complex, Complex, float]:
    """Floquet multipliers, the largest modulus first, their roots and the error of the worst.

    Of an orbit with a mirror the roots are the eigenvalues over half a period, reflected. The
    multipliers, shape (2 dof,), are their squares: the trivial one is 1 either way, and a
    perturbation that breaks the mirror symmetry and neither grows nor decays has the root -1.
    Without a mirror the roots are the multipliers.

    Raises:
        NewtonFailed: if they overflow.
    """
    # Halving leaves 2^-15 of the error where f is smooth, and 2^-3 across kinks of drag at phases
    # that are not known; of both some more is allowed for.
    some = motion.model.drag_velocities(*np.split(orbit.states(np.zeros(1)), 2))
    left = 0.25 if motion.model.pipe.drag and not some.size else 1e-3
    orbit = _fine_enough(motion, orbit)
    roots, error = _eigenvalues(motion, orbit), math.inf
    values = roots**2 if orbit.symmetric else roots
    for _ in range(MOST_HALVINGS):
        if error <= TOLERANCE or 2 * len(orbit.starts) > MOST:
            break
        orbit = refined(motion, orbit, np.full(len(orbit.starts), 2))
        coarser, roots = values, _eigenvalues(motion, orbit)
        values = roots**2 if orbit.symmetric else roots
        moved = np.abs(coarser[:, None] - values) / np.maximum(np.abs(values), 1.0)
        last, error = error, left * float(moved[linear_sum_assignment(moved)].max())
        if error > 0.5 * last:  # two that meet at 1, as at a Hopf point, have half the digits
            break
    # Rounded, as the moduli of a pair differ by rounding.
    sizes = np.log(np.maximum(np.abs(values), 1e-300)).round(11)
    order = np.lexsort((-values.imag, -sizes))
    return values[order].astype(np.complex128), roots[order], error


def _eigenvalues(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    """The roots of the multipliers on a given mesh."""
    factorised()
    with np.errstate(over="raise", invalid="raise"):
        try:
            left, right = through(motion, orbit)
            if motion.constrained:
                allowed = _constrained_directions(motion, orbit.starts[0])
                values = np.linalg.eigvals(-allowed.T @ np.linalg.solve(right, left @ allowed))
            else:
                values = scipy.linalg.eigvals(left, -right)
            if not (np.abs(values) < 1e150).all():  # its square is finite
                raise FloatingPointError
        except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
            raise NewtonFailed("its Floquet multipliers overflow") from error
    found: Complex = orbit.mirror * np.asarray(values, dtype=np.complex128)
    return found


def _fine_enough(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit:
    """The same on a mesh that is fine enough for every mode that persists.

    One that decays by more than exp(-25) over the span ends below 1e-11 of its size.
    """
    some = np.ascontiguousarray(orbit.starts[:: len(orbit.starts) // 4].T)
    factorised(some.shape[1])
    rates = np.linalg.eigvals(motion.jacobians(some, orbit.u))
    persist = rates.real > -25.0 * orbit.frequency / orbit.span
    turns = orbit.durations * np.abs(rates[persist]).max(initial=0.0)
    parts = np.ceil(np.maximum(turns / TURN, 1.0)).astype(int)
    return refined(motion, orbit, parts) if 2 * parts.sum() <= MOST else orbit


def _constrained_directions(motion: VectorField, y: Array) -> Array:
    """An orthonormal basis of the perturbations of a state that meet the constraints."""
    h = 1e-5
    moves = h * np.eye(y.size)
    ahead, behind = (
        np.concatenate(motion.model.motion.projected(*np.split(y[:, None] + sign * moves, 2)))
        for sign in (1.0, -1.0)
    )
    vectors, _, _ = np.linalg.svd((ahead - behind) / (2.0 * h))
    return np.asarray(vectors[:, : 2 * motion.model.dof])
