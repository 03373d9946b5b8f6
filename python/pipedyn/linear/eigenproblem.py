# SPDX-License-Identifier: MIT
"""The eigenproblem P(lambda, u) x = 0 of any model, which the core solves (`cpp/pipedyn/linear`).

The pencil of the model gives the products of its matrices with vectors, in elastic coordinates, in
which the elastic stiffness is the identity. Chains and straight models in Legendre curvatures are
solved by elimination along the pipe, other models by their matrices.

With hysteresis, EI becomes EI (1 + i mu) for roots above the real axis, all of which the core
finds, and the conjugate of that for roots below. Hysteresis acts only on oscillation, so growing
real roots are those of the pipe without it. Decaying real roots are not counted: mu turns them into
a pair close to the axis, or moves them below it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.pencil import Pencil, Vectors
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.parallel import one_thread


class Eigenproblem:
    """The eigenproblem P(lambda, u) x = 0 of one model.

    Args:
        pencil: pencil of the model.

    Attributes:
        rows: size of the problem for the choice of threads: number of rows of its largest matrix.
        is_damped: whether anything but the flow in the pipe acts by velocities; a damper at a
            support does not.
        zero_tolerance: |lambda| below which a root counts as zero.
    """

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.model = pencil.model
        self.pipe, self.dof = pencil.pipe, pencil.dof
        self.is_long = pencil.is_long
        # Elimination along the pipe does not gain from threads and seldom falls back on matrices.
        self.rows = 1 if self.is_long else 2 * self.dof
        self.is_damped = pencil.is_damped
        if self.is_damped and not (self.pipe.damping or self.pipe.hysteresis):
            x, y = self._columns
            power = np.concatenate([x, y], axis=1).T @ pencil.damping(x)
            self.is_damped = float(np.abs(power).max()) > pencil.lost_power
        # Rounding scatters a double zero root by the square root of its size, and the triple zero
        # root of a joint without stiffness by the cube root. Damping makes all roots near zero
        # smaller.
        least = 1e-4 if pencil.turns_freely else 1e-6
        self.zero_tolerance = least / max(1.0, self.pipe.damping)

    @cached_property
    def is_conservative(self) -> bool:
        """Whether eigenvalues come in fours, lambda, -lambda and conjugates, at every speed.

        They do if nothing damps, forces by velocity are gyroscopic and the stiffness is symmetric,
        as in a pipe on whose ends the flow does no work.
        """
        if not self._may_be_conservative:
            return False
        x, y = self._columns

        def differ(product: Callable[[Vectors], Vectors], sign: float, unit: float = 1.0) -> bool:
            one, other = float((x.T @ product(y))[0, 0]), float((y.T @ product(x))[0, 0])
            size = float(np.abs(x * product(y)).sum()) + unit * self.dof
            return abs(one - sign * other) > 1e-11 * size

        of = self.pencil  # springs have unit stiffness
        thrust = self.pipe.alpha != 0.0 and differ(of.flux, 1.0)
        resisted = self.is_damped and differ(of.damping, -1.0, 0.0)
        return not (thrust or resisted or differ(of.velocity, -1.0) or differ(of.stiffness, 1.0))

    @property
    def _may_be_conservative(self) -> bool:
        """Whether no damping is known; forces by velocity of a flow outside may be gyroscopic."""
        damped = self.is_damped and not self.pipe.fed_at_rest
        return not (damped or self.pipe.damping or self.pipe.hysteresis or self.pencil.end_moves)

    @property
    def _columns(self) -> tuple[Array, Array]:
        """Two vectors, (dof, 1) each, on which products show the symmetry of matrices."""
        angles = np.arange(1.0, self.dof + 1.0)[:, None]
        return np.cos(angles), np.sin(2.0 * angles)

    def grows_statically(self, values: Complex) -> NDArray[np.bool_]:
        """Which eigenvalues are real and positive, so that motions grow without oscillating."""
        return (values.imag == 0.0) & (values.real > self.zero_tolerance)

    def velocity_free(self, u: float) -> bool:
        """Whether P depends on lambda^2 only: no damping, and no flow or no mass of fluid."""
        return not self.is_damped and (u == 0.0 or self.pipe.beta == 0.0)

    def spectrum(self) -> _core.Eigenproblem:
        """The core's form of the problem, made anew at each call, since nothing is kept here."""
        pipe, damped = self.pipe, self.is_damped
        conservative = self._may_be_conservative and self.is_conservative
        squared, free_at_rest = not damped and pipe.beta == 0.0, not damped
        traits = (
            self.dof,
            pipe.damping,
            self.zero_tolerance,
            damped,
            conservative,
            squared,
            free_at_rest,
            pipe.hysteresis,
        )
        # The norm of the stiffness at rest; the elastic part has norm 1.
        size = 1.0 + abs(pipe.gamma) + self.model.varied_stiffness
        spectrum = self.pencil.spectrum(traits, size)
        if pipe.hysteresis:
            spectrum.set_without_loss(self.static.spectrum())
        return spectrum

    @cached_property
    def static(self) -> Eigenproblem:
        """The eigenproblem of the pipe without hysteresis, whose growing real roots count."""
        return Eigenproblem(self.pencil.with_pipe(replace(self.pipe, hysteresis=0.0)))

    @cached_property
    def planes(self) -> tuple[Eigenproblem, ...]:
        """Eigenproblems of motions in the plane of a bent rest and across it, or this one alone."""
        each = self.pencil.planes()
        return (self,) if len(each) == 1 else tuple(map(Eigenproblem, each))

    def is_across(self, pairs: _core.Pairs) -> NDArray[np.bool_]:
        """Which pairs move across the plane of a bent rest, (k,)."""
        return np.asarray(pairs.right[self.dof // len(self.planes) :].any(axis=0))

    def lowest(self, u: float, count: int, left: bool = False) -> _core.Pairs:
        """The `count` eigenpairs of least |lambda|, sorted, or all of them, converged or not.

        Motions in the plane of a bent rest and across it are solved apart, as a root of one may be
        close to a root of the other.
        """
        if len(self.planes) > 1:
            each = [one.lowest(u, min(count, 2 * one.dof), left) for one in self.planes]
            return _of_both_planes(each, count)
        spectrum = self.spectrum()
        with one_thread(self.rows):
            found = spectrum.lowest(u, count, left, high=True)
            if self.pipe.hysteresis:
                most = 2 * self.dof
                while 2 * np.sum(found.values.imag > 0.0) < count and found.values.size < most:
                    asked = min(found.values.size + count, most)
                    found = spectrum.lowest(u, asked, left, high=True)
                still = self.static.lowest(u, min(count, most), left)
                grows = np.flatnonzero(self.grows_statically(still.values))
                found = _with_conjugates(found, select_pairs(still, grows), count)
        count_factorisations(spectrum.factorisations())
        return found

    def errors(self, u: float, pairs: _core.Pairs) -> Array:
        """Bounds on the errors of the eigenvalues of pairs that have left vectors, shape (k,)."""
        still = (pairs.values.imag == 0.0) & (self.pipe.hysteresis > 0.0)
        errors = np.empty(still.size)
        for problem, which in ((self, ~still), (self.static if still.any() else self, still)):
            some = select_pairs(pairs, np.flatnonzero(which))
            problem.spectrum().assess(u, some)
            errors[which] = some.uncertain
        return errors


def select_pairs(pairs: _core.Pairs, which: NDArray[np.intp]) -> _core.Pairs:
    """The pairs with the indices `which`."""
    right, left = (of[:, which] if of.size else of for of in (pairs.right, pairs.left))
    return _core.Pairs(pairs.values[which], right, left, pairs.residuals[which])


def _of_both_planes(each: list[_core.Pairs], count: int) -> _core.Pairs:
    """The `count` lowest of the pairs of two planes, with vectors in the coordinates of both."""
    values, residuals = (
        np.concatenate([getattr(one, name) for one in each]) for name in ("values", "residuals")
    )
    right, left = (
        scipy.linalg.block_diag(*(getattr(one, side) for one in each)) for side in ("right", "left")
    )
    order = np.argsort(np.abs(values), kind="stable")[:count]
    return select_pairs(_core.Pairs(values, right, left, residuals), order)


def _with_conjugates(hysteretic: _core.Pairs, grows: _core.Pairs, count: int) -> _core.Pairs:
    """The lowest of the roots above the real axis, their conjugates and growing real roots."""
    oscillates = ~(hysteretic.values.imag <= 0.0)  # also true for NaN, a root not found
    growing = np.flatnonzero(hysteretic.values.real > 0.0)
    for value in grows.values if growing.size else ():
        # The nearest growing root is the same motion, changed by the loss factor.
        oscillates[growing[np.abs(hysteretic.values[growing] - value).argmin()]] = False
    above = select_pairs(hysteretic, np.flatnonzero(oscillates))
    values = np.concatenate([above.values, above.values.conj(), grows.values])
    places = np.lexsort((-values.imag, values.real, np.abs(values)))[:count]
    sizes = above.values.size, grows.values.size  # left vectors may be known of some alone
    none = np.zeros((0, 0), dtype=np.complex128)
    right, left = (
        np.hstack([a, a.conj(), b] if (a.shape[1], b.shape[1]) == sizes else [none])
        for a, b in ((above.right, grows.right), (above.left, grows.left))
    )
    residuals = np.concatenate([above.residuals, above.residuals, grows.residuals])
    return select_pairs(_core.Pairs(values, right, left, residuals), places)


def eigenproblem(model: Model) -> Eigenproblem:
    """The eigenproblem of small motions of a model."""
    return Eigenproblem(model.pencil())
