# SPDX-License-Identifier: MIT
"""P(lambda, u) x = 0 of any model, for the core, which solves it: see `cpp/pipedyn/linear`.

The products come from `model.pencil()`; all is done in elastic coordinates, where the elastic
stiffness is the identity. Chains and straight models in Legendre curvatures are solved by
elimination along the pipe, others by their matrices.

With hysteresis EI is EI (1 + i mu) for roots above the real axis, of which the core has all, and
conjugate for those below. On the axis nothing oscillates, and nothing is lost: a growing real root
is that of the pipe without hysteresis. A real root that decays is none of the pipe's, where mu
makes it a pair close to the axis, or takes it below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.pencil import Pencil, Vectors
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.threads import one_thread

Complex = NDArray[np.complex128]


class Eigenproblem:
    """P(lambda, u) x = 0 of one model.

    Args:
        pencil: the model's.
    """

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.model, self.pipe, self.dof = pencil.model, pencil.pipe, pencil.dof
        self.is_long = pencil.is_long

    @property
    def rows(self) -> int:
        """Rows by which threads are chosen: those of the companion matrix, one of a recursion.

        A recursion gains nothing by threads, and seldom falls back on matrices.
        """
        return 1 if self.is_long else 2 * self.dof

    @cached_property
    def is_damped(self) -> bool:
        """Whether anything but the flow takes energy: a damper at a support does not."""
        if not self.pencil.is_damped or self.pipe.damping or self.pipe.hysteresis:
            return self.pencil.is_damped
        x = np.cos(np.arange(1.0, self.dof + 1.0))[:, None]
        return abs((x.T @ self.pencil.damping(x))[0, 0]) > self.pencil.lost_power

    @cached_property
    def is_conservative(self) -> bool:
        """Whether eigenvalues come in fours, lambda, -lambda and conjugates, at every speed.

        No damping, gyroscopic forces only and symmetric stiffness: ends that do no work.
        """
        if self.is_damped or self.pencil.end_moves:
            return False
        angles = np.arange(1.0, self.dof + 1.0)
        x, y = np.cos(angles)[:, None], np.sin(2.0 * angles)[:, None]

        def differ(product: Callable[[Vectors], Vectors], sign: float) -> bool:
            one, other = float((x.T @ product(y))[0, 0]), float((y.T @ product(x))[0, 0])
            size = float(np.abs(x * product(y)).sum()) + self.dof  # springs have stiffness 1
            return abs(one - sign * other) > 1e-11 * size

        of = self.pencil
        thrust = of.centrifugal != 0.0 and differ(of.flux, 1.0)
        return not (thrust or differ(of.velocity, -1.0) or differ(of.stiffness, 1.0))

    @cached_property
    def zero_tolerance(self) -> float:
        """|lambda| below which a root counts as zero.

        A double zero scatters by the square root of rounding, the triple one of a free joint by its
        cube root; damping slows all that is near zero.
        """
        least = 1e-4 if (self.model.elastic_share == 0.0).any() else 1e-6
        return least / max(1.0, self.pipe.damping)

    def grows_statically(self, values: Complex) -> NDArray[np.bool_]:
        """Which eigenvalues are real and positive: of motions that grow without oscillating."""
        return (values.imag == 0.0) & (values.real > self.zero_tolerance)

    def velocity_free(self, u: float) -> bool:
        """Whether P holds lambda only as lambda^2: no damping, and no flow or no fluid mass."""
        return not self.is_damped and (u == 0.0 or self.pipe.beta == 0.0)

    def spectrum(self) -> _core.Eigenproblem:
        """For the core: what it computes is the same from call to call, but not kept here."""
        traits = _core.Traits(
            dof=self.dof,
            delta=self.pipe.damping,
            zero=self.zero_tolerance,
            damped=self.is_damped,
            conservative=self.is_conservative,
            squared=self.velocity_free(1.0),
            free_at_rest=self.velocity_free(0.0),
            loss=self.pipe.hysteresis,
        )
        # Of the stiffness at rest, elastic stiffness being 1.
        size = 1.0 + abs(self.pipe.gamma) + self.model.term_stiffness(self.pencil)
        spectrum = self.pencil.spectrum(traits, size)
        if self.pipe.hysteresis:
            spectrum.set_without_loss(self.static.spectrum())
        return spectrum

    @cached_property
    def static(self) -> Eigenproblem:
        """Of the same without hysteresis, which has the real roots."""
        return Eigenproblem(self.pencil.with_pipe(replace(self.pipe, hysteresis=0.0)))

    def lowest(self, u: float, count: int, left: bool = False) -> _core.Pairs:
        """The `count` eigenpairs of least |lambda|, sorted, or all there are, good or not."""
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
                found = _with_conjugates(found, _taken(still, grows), count)
        factorised(spectrum.factorisations())
        return found

    def errors(self, u: float, pairs: _core.Pairs) -> Array:
        """How far the eigenvalues of pairs with left vectors may be off."""
        still = (pairs.values.imag == 0.0) & (self.pipe.hysteresis > 0.0)
        errors = np.empty(still.size)
        for problem, which in ((self, ~still), (self.static if still.any() else self, still)):
            some = _taken(pairs, np.flatnonzero(which))
            problem.spectrum().assess(u, some)
            errors[which] = some.uncertain
        return errors


def _taken(pairs: _core.Pairs, which: NDArray[np.intp]) -> _core.Pairs:
    """Some of the pairs."""
    right, left = (of[:, which] if of.size else of for of in (pairs.right, pairs.left))
    return _core.Pairs(pairs.values[which], right, left, pairs.residuals[which])


def _with_conjugates(hysteretic: _core.Pairs, grows: _core.Pairs, count: int) -> _core.Pairs:
    """Roots above the real axis with their conjugates, and growing ones on it, the lowest first."""
    oscillates = ~(hysteretic.values.imag <= 0.0)  # with those not found
    growing = np.flatnonzero(hysteretic.values.real > 0.0)
    for value in grows.values if growing.size else ():
        # Of the growing roots the nearest is what a loss factor makes of it: the same motion.
        oscillates[growing[np.abs(hysteretic.values[growing] - value).argmin()]] = False
    above = _taken(hysteretic, np.flatnonzero(oscillates))
    values = np.concatenate([above.values, above.values.conj(), grows.values])
    places = np.lexsort((-values.imag, values.real, np.abs(values)))[:count]
    right, left = (
        np.hstack([a, a.conj(), b]) if len(a) and len(b) else np.zeros((0, 0), dtype=np.complex128)
        for a, b in ((above.right, grows.right), (above.left, grows.left))
    )
    residuals = np.concatenate([above.residuals, above.residuals, grows.residuals])
    return _taken(_core.Pairs(values, right, left, residuals), places)


def eigenproblem(model: Model) -> Eigenproblem:
    """The model's eigenproblem."""
    return Eigenproblem(model.pencil())
