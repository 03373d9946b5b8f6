# SPDX-License-Identifier: MIT
"""P(lambda, u) x = 0 of any model: residuals, conditions, slopes and refinement of its eigenpairs.

The products come from `model.pencil()`; all is done in elastic coordinates, where the elastic
stiffness is the identity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.pencil import DensePencil, Pencil, Vectors
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

Complex = NDArray[np.complex128]

EPS = float(np.finfo(np.float64).eps)

TOLERANCE = 1e-10
"""Largest relative residual |P x| / (|lambda^2 M x| + |lambda C x| + k |x|) of a good pair, k = 1 +
|gamma| + a u^2 with what terms add being the size of the elastic stiffness matrix: measured, the
twelve lowest pairs of 25 models at four speeds have 8e-12 at most. To it comes the rounding of M x,
eps |lambda|^2, which limits high modes."""

LARGEST_RESIDUAL = 1e-4
"""Relative residual beyond which a pair is wrong, however high the mode: refined, those of 300
segments with damping 1e-3 (1e-5, 0.99 before) and of 200 Legendre functions (4e-5) pass."""

SLOW = 30.0
"""|lambda| of a chain's root up to which joint angles hold its vectors: they lose eps |lambda|^2,
which is 2e-13 here."""

SLOW_GROWTH = 1e-8
"""Rounding of Re lambda up to which it is left as it is: what grows slower doubles in 1e8 T."""


@dataclass(frozen=True)
class Assessment:
    """How good pairs are, and how they move; each of shape (r,).

    Attributes:
        residuals: relative.
        uncertain: how far residual and rounding may have moved each eigenvalue.
        slopes: d lambda / du.
        by_left, by_right: y^H (dP/dlambda) x and x^H (dP/dlambda) x.
    """

    residuals: Array
    uncertain: Array
    slopes: Complex
    by_left: Complex
    by_right: Complex

    def take(self, which: Any) -> Assessment:
        """Of some of the pairs."""
        return Assessment(*(getattr(self, one.name)[which] for one in fields(self)))


@dataclass(frozen=True)
class Eigenpairs:
    """Eigenvalues with vectors, sorted by |lambda|, of conjugates the upper first.

    Attributes:
        values: lambda, complex, shape (r,).
        right: x in elastic coordinates, shape (dof, r).
        left: y with y^H P = 0, shape (dof, r), or None where not asked for.
        residuals: relative residuals, shape (r,); `converged` says which are good.
        assessment: what else is known of a chain's pairs, or None.
    """

    values: Complex
    right: Complex
    left: Complex | None
    residuals: Array
    assessment: Assessment | None = None

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Which pairs passed the check of their residual, shape (r,)."""
        return self.passable & (self.residuals <= LARGEST_RESIDUAL)

    @property
    def passable(self) -> NDArray[np.bool_]:
        """The same with all that rounding explains: enough of high modes where low ones count."""
        return self.residuals <= TOLERANCE + EPS * np.abs(self.values) ** 2

    def take(self, which: Any) -> Eigenpairs:
        """Some of the pairs."""
        left = None if self.left is None else self.left[:, which]
        found = None if self.assessment is None else self.assessment.take(which)
        return Eigenpairs(
            self.values[which], self.right[:, which], left, self.residuals[which], found
        )

    @classmethod
    def of_chain(cls, values: Complex, right: Complex, left: Complex, *found: Any) -> Eigenpairs:
        """From what the core's `ChainSpectrum` gives."""
        return cls(values, right, left, found[0], Assessment(*found))


class Eigenproblem:
    """P(lambda, u) x = 0 of one model.

    Args:
        pencil: the model's.
    """

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.model, self.pipe, self.dof = pencil.model, pencil.pipe, pencil.dof
        self.mass, self.velocity = pencil.mass, pencil.velocity
        self.stiffness, self.flux = pencil.stiffness, pencil.flux
        self.is_damped, self.is_long = pencil.is_damped, pencil.is_long
        self.centrifugal = pencil.centrifugal
        self.latest: tuple[float, _core.Operator] | None = None

    @cached_property
    def spectrum(self) -> _core.ChainSpectrum | None:
        """The roots of a chain by recursion along it; None of any other model."""
        if not isinstance(self.model, Chain):
            return None
        return _core.ChainSpectrum(self.model.core, self.model.elastic_scale)

    @property
    def rows(self) -> int:
        """Rows of the largest matrix that a solve hands to LAPACK; a band has none to speak of."""
        return 1 if self.is_long else 2 * self.dof

    def damped(self, u: float, x: Vectors) -> Vectors:
        """(u V + D) x."""
        result = self.velocity(x) * u
        return result + self.pencil.damping(x) if self.is_damped else result

    def stiffened(self, u: float, x: Vectors) -> Vectors:
        """(K + a u^2 A) x."""
        result: Vectors = self.stiffness(x) + self.centrifugal * u**2 * self.flux(x)
        return result

    def matrices(self, u: float) -> tuple[Array, Array, Array]:
        """(M, C, K) at speed u of a model in matrices, each of shape (dof, dof)."""
        assert isinstance(self.pencil, DensePencil)
        return self.pencil.matrices(u)

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        """solve(rows, adjoint=False) with P(value, u), or its conjugate transpose."""
        return self.pencil.factor(value, u)

    @cached_property
    def is_conservative(self) -> bool:
        """Whether eigenvalues come in fours, lambda, -lambda and conjugates, at every speed.

        No damping, gyroscopic forces only and symmetric stiffness: ends that do no work.
        """
        if self.is_damped:
            return False
        angles = np.arange(1.0, self.dof + 1.0)
        x, y = np.cos(angles)[:, None], np.sin(2.0 * angles)[:, None]

        def differ(product: Callable[[Vectors], Vectors], sign: float) -> bool:
            one, other = float((x.T @ product(y))[0, 0]), float((y.T @ product(x))[0, 0])
            size = float(np.abs(x * product(y)).sum()) + self.dof  # springs have stiffness 1
            return abs(one - sign * other) > 1e-11 * size

        return not (
            differ(self.velocity, -1.0) or differ(self.stiffness, 1.0) or (differ(self.flux, 1.0))
        )

    @cached_property
    def zero_tolerance(self) -> float:
        """|lambda| below which a root counts as zero.

        A double zero scatters by the square root of rounding, the triple one of a free joint by its
        cube root; damping slows all that is near zero.
        """
        least = 1e-4 if (self.model.elastic_share == 0.0).any() else 1e-6
        return least / max(1.0, self.pipe.damping)

    def velocity_free(self, u: float) -> bool:
        """Whether P holds lambda only as lambda^2: no damping, and no flow or no fluid mass."""
        return not self.is_damped and (u == 0.0 or self.pipe.beta == 0.0)

    def dense(self) -> Eigenproblem:
        """The same problem in matrices."""
        return type(self)(self.model.pencil(dense=True))

    def original(self, u: float, pairs: Eigenpairs) -> Eigenpairs | None:
        """Pairs of the model itself, where it is deflated; None where they have no slope."""
        return pairs

    def static(self) -> Eigenproblem:
        """The problem whose stiffness is singular where a real root passes zero, and only there."""
        return self

    def genuine(self, values: Complex, free: bool) -> Any:
        """Which eigenvalues of the inverse problem are the model's: all, unless it is deflated."""
        return slice(None)

    def size(self, u: float) -> float:
        """Size of the stiffness matrix, elastic stiffness being 1."""
        return 1.0 + abs(self.pipe.gamma) + self.centrifugal * u**2 + self.model.term_stiffness

    def by_speed(self, u: float, values: Complex, x: Vectors) -> Complex:
        """(dP/du) x of each pair, shape (dof, r)."""
        result: Complex = values * self.velocity(x) + 2.0 * self.centrifugal * u * self.flux(x)
        return result

    def at(self, u: float) -> _core.Operator:
        """P at a speed as the core takes it; kept until another is asked for."""
        if self.latest is None or self.latest[0] != u:
            if self.is_long:
                made: _core.Operator = _core.LongOperator(
                    lambda x: (self.mass(x), self.damped(u, x), self.stiffened(u, x)),
                    partial(self._solved, u),
                    self.dof,
                    self.size(u),
                )
            else:
                made = _core.DenseOperator(*self.matrices(u), self.size(u))
            self.latest = u, made
        return self.latest[1]

    def _solved(self, u: float, value: complex, x: Vectors, y: Vectors) -> tuple[Vectors, Vectors]:
        """P^-1 x and P^-H y."""
        solve = self.factor(value, u)
        return solve(x), solve(y, adjoint=True)

    def assessed(self, u: float, pairs: Eigenpairs) -> Assessment:
        """What is known of pairs with left vectors."""
        if pairs.assessment is not None:
            return pairs.assessment
        by_speed = self.by_speed(u, pairs.values, pairs.right)
        return Assessment(
            *self.at(u).assess(pairs.values, pairs.right, pairs.left, pairs.residuals, by_speed)
        )

    def residuals(self, u: float, values: Complex, x: Vectors) -> Array:
        """Relative residual of each pair, shape (r,)."""
        result: Array = self.at(u).assess(values, x)[0]
        return result

    def improved(
        self, u: float, pairs: Eigenpairs, found: Assessment, uncertain: Array
    ) -> tuple[Complex, Array]:
        """Eigenvalues and how far each may be off, with Re lambda by its energy balance if better.

        That is so where rounding hides a slow growth, as in high modes without damping, and at rest
        where damping is all there is.
        """
        values = pairs.values
        hidden = (values.imag != 0.0) & (np.abs(values.real) < 1e3 * uncertain) & pairs.converged
        if u > 0.0:
            hidden &= uncertain > SLOW_GROWTH
        if self.spectrum is not None:
            hidden &= np.abs(values) <= SLOW
        if pairs.left is None or not hidden.any():
            return values, uncertain
        # Near a double root vectors are worse than values: there y^H P' x is far below x^H P' x.
        hidden &= np.abs(found.by_left) > 0.1 * np.abs(found.by_right)
        which = np.flatnonzero(hidden)
        own = values[which], pairs.right[:, which], pairs.left[:, which]
        growth, error = self.at(u).growth(*own)
        better = error < uncertain[which]
        values, uncertain = values.copy(), uncertain.copy()
        values.real[which[better]] = growth[better] + 0.0  # -0 is 0
        uncertain[which[better]] = error[better]
        return values, uncertain

    def refine(
        self, u: float, value: complex, x: Vectors | None = None, steps: int = 6
    ) -> Eigenpairs:
        """The pair next to a good guess, by Newton's method or two-sided Rayleigh quotients."""
        if self.spectrum is not None:
            return Eigenpairs.of_chain(*self.spectrum.near(u, value, steps))
        seed = np.linspace(1.0, 0.5, self.dof)[:, None]
        start = seed if x is None else x
        value, right, left, residual, taken = self.at(u).refine(value, start, seed, steps)
        if not self.is_long:
            factorised(taken)
        return Eigenpairs(np.array([value]), right, left, np.array([residual]))

    def null_pair(self, u: float, right: Vectors, left: Vectors) -> Eigenpairs:
        """Singular vectors of K(u) to its least singular value: its null vectors, if any."""
        solve = self.factor(0.0, u)
        for _ in range(3):
            left = unit(solve(right, adjoint=True))
            right = unit(solve(left))
        values = np.zeros(1, dtype=np.complex128)
        right, left = right.astype(np.complex128), left.astype(np.complex128)
        return Eigenpairs(values, right, left, self.residuals(u, values, right))


def eigenproblem(model: Model, dense: bool | None = None) -> Eigenproblem:
    """The model's eigenproblem; `dense` as for `Model.pencil`."""
    return Eigenproblem(model.pencil(dense))


def unit(x: Vectors) -> Vectors:
    """Each column divided by its length."""
    with np.errstate(all="ignore"):
        result: Vectors = x / np.linalg.norm(x, axis=0)
    return result
