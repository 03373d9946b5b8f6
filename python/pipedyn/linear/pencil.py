# SPDX-License-Identifier: MIT
"""P(lambda) = lambda^2 M + lambda C + K as what multiplies and solves with it, at any size.

All is done in a model's elastic coordinates, where the elastic stiffness is the identity. Small
models are dense matrices; long chains and scenes multiply and solve in O(n).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from pipedyn.linear.special.stiff_roots import FastPair, FastRoots, is_fast, is_spread
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.modular import Assembly
from pipedyn.models.pipe import Pipe
from pipedyn.util.band import band_solver
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.eigenvectors import eigenvectors

Complex = NDArray[np.complex128]
Vectors = NDArray[Any]

TOLERANCE = 1e-10
"""Largest relative residual |P x| / (|lambda^2 M x| + |lambda C x| + k |x|) of a good pair, with
k = 1 + |gamma| + a u^2 the size of the elastic stiffness matrix, with what terms add; to it
comes the rounding of M x, eps |lambda|^2, which is what limits high modes."""

WORTHLESS = 1e-4
"""Relative residual of a pair that rounding does not excuse, however high the mode: refined, those
of 300 segments with damping 1e-3 (1e-5, 0.99 before) and of 200 Legendre functions (4e-5) pass."""

DENSE_RESCUE, PATIENCE = 1000, 30
"""Where Arnoldi iteration does not end after so many restarts (eigenvalues that coincide, or crowd
at -1 / delta), chains up to this size are solved dense; it ends after a few where it does."""


@dataclass(frozen=True)
class Eigenpairs:
    """Eigenvalues with vectors, sorted by |lambda|, of conjugates the upper first.

    Attributes:
        values: lambda, complex, shape (r,).
        right: x in elastic coordinates, shape (dof, r).
        left: y with y^H P = 0, shape (dof, r), or None where not asked for.
        residuals: relative residuals, shape (r,); `converged` says which are good.
    """

    values: Complex
    right: Complex
    left: Complex | None
    residuals: Array

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Which pairs passed the check of their residual, shape (r,)."""
        return self.passable & (self.residuals <= WORTHLESS)

    @property
    def passable(self) -> NDArray[np.bool_]:
        """The same with all that rounding excuses: enough of high modes where low ones count."""
        return self.residuals <= TOLERANCE + np.finfo(float).eps * np.abs(self.values) ** 2

    def take(self, which: Any) -> Eigenpairs:
        """Some of the pairs."""
        left = None if self.left is None else self.left[:, which]
        return Eigenpairs(self.values[which], self.right[:, which], left, self.residuals[which])


class Crowded(Exception):
    """Eigenvalues too close together for a Krylov space."""


class Pencil(ABC):
    """P(lambda, u) = lambda^2 M + lambda (u V + D) + K + a u^2 A, in elastic coordinates.

    V = s (gyroscopic + end_flux) and A = flux. Each product takes and gives (dof, r).

    Attributes:
        fast: where they can be told, the roots that elastic coordinates cannot hold, or None.
    """

    fast: FastRoots | None = None

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pipe = model.pipe
        self.dof = model.dof
        self.is_damped = model.pipe.damping != 0.0 or model.resisted
        self.direction = self.pipe.direction
        self.centrifugal = self.pipe.centrifugal

    @abstractmethod
    def mass(self, x: Vectors) -> Vectors:
        """M x."""

    @abstractmethod
    def velocity(self, x: Vectors) -> Vectors:
        """V x."""

    @abstractmethod
    def damping(self, x: Vectors) -> Vectors:
        """D x."""

    @abstractmethod
    def stiffness(self, x: Vectors) -> Vectors:
        """K x."""

    @abstractmethod
    def gravity(self, x: Vectors) -> Vectors:
        """dK/dgamma x."""

    @abstractmethod
    def by_damping(self, x: Vectors) -> Vectors:
        """dD/ddelta x."""

    @abstractmethod
    def flux(self, x: Vectors) -> Vectors:
        """A x."""

    @abstractmethod
    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        """solve(rows, adjoint=False) with P(value, u), or its conjugate transpose."""

    @abstractmethod
    def inverse(self, u: float, shift: float, free: bool, count: int | None, left: bool) -> Any:
        """mu, x and y (or None) of the inverse problem, all or the `count` largest |mu|.

        `free` says that no term in the velocity is there; then mu = 1 / (lambda^2 - shift^2).
        """

    def damped(self, u: float, x: Vectors) -> Vectors:
        """(u V + D) x."""
        result = self.velocity(x) * u
        return result + self.damping(x) if self.is_damped else result

    def stiffened(self, u: float, x: Vectors) -> Vectors:
        """(K + a u^2 A) x."""
        result: Vectors = self.stiffness(x) + self.centrifugal * u**2 * self.flux(x)
        return result

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

    @property
    def stuck(self) -> float:
        """|lambda| below which a root counts as zero.

        A double zero scatters by the root of rounding, the triple one of a free joint by its cube
        root; damping slows all that is near zero.
        """
        least = 1e-4 if (self.model.elastic_share == 0.0).any() else 1e-6
        return least / max(1.0, self.pipe.damping)

    def velocity_free(self, u: float) -> bool:
        """Whether P holds lambda only as lambda^2: no damping, and no flow or no fluid mass."""
        return not self.is_damped and (u == 0.0 or self.pipe.beta == 0.0)

    def dense(self) -> DensePencil:
        """The same problem in matrices."""
        return DensePencil(self.model)

    def original(self, u: float, pairs: Eigenpairs) -> Eigenpairs | None:
        """Pairs of the model itself, where it is deflated; None where they have no slope."""
        return pairs

    def static(self) -> Pencil:
        """The pencil whose stiffness is singular where a real root passes zero, and only there."""
        return self

    def genuine(self, values: Complex, free: bool) -> NDArray[np.bool_]:
        """Which eigenvalues of the inverse problem are the model's: all, unless it is deflated."""
        return np.ones(values.size, dtype=np.bool_)

    def size(self, u: float) -> float:
        """Size of the stiffness matrix, elastic stiffness being 1."""
        return 1.0 + abs(self.pipe.gamma) + self.centrifugal * u**2 + self.model.fitted_size

    def residuals(self, u: float, values: Complex, x: Vectors) -> Array:
        """Relative residual of each pair, shape (r,)."""
        inertia, velocity = values**2 * self.mass(x), values * self.damped(u, x)
        rest = np.linalg.norm(inertia + velocity + self.stiffened(u, x), axis=0)
        size = np.linalg.norm(inertia, axis=0) + np.linalg.norm(velocity, axis=0)
        result: Array = rest / (size + self.size(u) * np.linalg.norm(x, axis=0))
        self.tell(u, values, result, lambda pair: pair.residual)
        return result

    def tell(self, u: float, values: Complex, result: Any, of: Callable[[FastPair], Any]) -> None:
        """Puts what is known of the fast roots in the place of a result for all, shape (r,)."""
        if self.fast is not None:
            for i in np.flatnonzero(is_fast(values)):
                result[i] = of(self.fast.at(u, complex(values[i])))

    def derivative(self, u: float, values: Complex, x: Vectors, y: Vectors) -> Complex:
        """y^H (dP/dlambda) x of each pair, shape (r,)."""
        result: Complex = np.sum(
            y.conj() * (2.0 * values * self.mass(x) + self.damped(u, x)), axis=0
        )
        return result

    def uncertainties(self, u: float, pairs: Eigenpairs) -> Array:
        """How far residual and rounding may have moved each eigenvalue, shape (r,)."""
        assert pairs.left is not None
        size = np.abs(pairs.values) ** 2 * np.linalg.norm(self.mass(pairs.right), axis=0)
        size += np.abs(pairs.values) * np.linalg.norm(self.damped(u, pairs.right), axis=0)
        size += self.size(u)
        derivative = np.abs(self.derivative(u, pairs.values, pairs.right, pairs.left))
        lost = np.finfo(float).eps * (size + self.formed(u, pairs))
        with np.errstate(divide="ignore", invalid="ignore"):
            result: Array = (pairs.residuals * size + lost) / derivative
        result[~np.isfinite(result)] = np.inf
        self.tell(u, pairs.values, result, lambda pair: pair.uncertain)
        return result

    def formed(self, u: float, pairs: Eigenpairs) -> Any:
        """What rounding of the matrices themselves may hide, in eps: no residual shows it."""
        return 0.0

    def slopes(self, u: float, pairs: Eigenpairs) -> Complex:
        """D lambda / du of each pair, shape (r,)."""
        assert pairs.left is not None
        by_speed = pairs.values * self.velocity(pairs.right)
        by_speed = by_speed + 2.0 * self.centrifugal * u * self.flux(pairs.right)
        change = np.sum(pairs.left.conj() * by_speed, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            result: Complex = -change / self.derivative(u, pairs.values, pairs.right, pairs.left)
        self.tell(u, pairs.values, result, lambda pair: pair.slope)
        return result

    def refine(
        self, u: float, value: complex, x: Vectors | None = None, steps: int = 6
    ) -> Eigenpairs:
        """The pair nearest to a good guess, by two-sided Rayleigh quotient iteration."""
        seed = np.linspace(1.0, 0.5, self.dof, dtype=np.complex128)
        right = (seed if x is None else x.astype(np.complex128)).reshape(-1, 1)
        left = seed.reshape(-1, 1)
        best: Eigenpairs | None = None
        for _ in range(steps):
            solve = self.factor(value, u)
            right, left = unit(solve(right)), unit(solve(left, adjoint=True))
            if not (np.isfinite(right).all() and np.isfinite(left).all()):
                break
            values = np.array([value])
            rest = values**2 * self.mass(right) + values * self.damped(u, right)
            rest = rest + self.stiffened(u, right)
            derivative = self.derivative(u, values, right, left)[0]
            if derivative == 0.0:
                break
            correction = np.sum(left.conj() * rest) / derivative
            value = complex(value - correction)
            values = np.array([value])
            pair = Eigenpairs(values, right, left, self.residuals(u, values, right))
            if best is not None and pair.residuals[0] >= best.residuals[0]:
                break
            best = pair
            if abs(correction) <= 4e-16 * abs(value):
                break
        if best is None:
            values = np.array([value], dtype=np.complex128)
            return Eigenpairs(values, right, left, np.array([np.inf]))
        return best

    def null_pair(self, u: float, right: Vectors, left: Vectors) -> Eigenpairs:
        """Singular vectors of K(u) to its least singular value: its null vectors, if any."""
        solve = self.factor(0.0, u)
        for _ in range(3):
            left = unit(solve(right, adjoint=True))
            right = unit(solve(left))
        values = np.zeros(1, dtype=np.complex128)
        right, left = right.astype(np.complex128), left.astype(np.complex128)
        return Eigenpairs(values, right, left, self.residuals(u, values, right))


def unit(x: Vectors) -> Vectors:
    """Each column divided by its length."""
    with np.errstate(all="ignore"):
        result: Vectors = x / np.linalg.norm(x, axis=0)
    return result


class DensePencil(Pencil):
    """Matrices; O(dof^3)."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        ops = model.elastic_operators()
        self.M, self.D, self.K = ops.mass, ops.damping, ops.stiffness
        self.V = ops.direction * (ops.gyroscopic + ops.end_flux)
        self.A = ops.flux
        if isinstance(model, Chain) and is_spread(model):
            self.fast = FastRoots(model)

    def mass(self, x: Vectors) -> Vectors:
        return self.M @ x

    def velocity(self, x: Vectors) -> Vectors:
        return self.V @ x

    def damping(self, x: Vectors) -> Vectors:
        return self.D @ x

    def stiffness(self, x: Vectors) -> Vectors:
        return self.K @ x

    def gravity(self, x: Vectors) -> Vectors:
        other, step = _stepped(self.pipe, "gamma")
        heavier = self.model.with_pipe(other).elastic_operators().stiffness
        result: Vectors = step * (heavier @ x - self.K @ x)
        return result

    def by_damping(self, x: Vectors) -> Vectors:
        other, step = _stepped(self.pipe, "damping")
        slower = self.model.with_pipe(other).elastic_operators().damping
        result: Vectors = step * (slower @ x - self.D @ x)
        return result

    def flux(self, x: Vectors) -> Vectors:
        return self.A @ x

    def matrices(self, u: float) -> tuple[Array, Array]:
        """(C, K) at speed u, each of shape (dof, dof)."""
        return u * self.V + self.D, self.K + self.centrifugal * u**2 * self.A

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        velocity, stiffness = self.matrices(u)
        matrix = value**2 * self.M + value * velocity + stiffness
        lu, pivots, _ = lapack.zgetrf(matrix.astype(np.complex128))
        factorised()
        exact = np.flatnonzero(np.diag(lu) == 0.0)  # singular: LU of one that differs in rounding
        lu[exact, exact] = np.finfo(float).eps

        def solve(rows: Vectors, adjoint: bool = False) -> Vectors:
            solution: Vectors = lapack.zgetrs(lu, pivots, rows, trans=2 if adjoint else 0)[0]
            return solution

        return solve

    def inverse(self, u: float, shift: float, free: bool, count: int | None, left: bool) -> Any:
        n = self.dof
        damped, stiffness = self.matrices(u)
        shifted = shift**2 * self.M + shift * damped + stiffness
        lu, pivots, singular = lapack.dgetrf(shifted)
        factorised()
        if singular:
            return None
        if free:
            step = -lapack.dgetrs(lu, pivots, self.M)[0]
        else:
            both = np.hstack([damped + 2.0 * shift * self.M, self.M])
            step = np.zeros((2 * n, 2 * n))
            step[:n] = -lapack.dgetrs(lu, pivots, both)[0]
            step[n:, :n] = np.eye(n)
        if not np.isfinite(step).all():
            return None
        if not left:
            factorised()
            mu, vectors = np.linalg.eig(step)
            return mu.astype(np.complex128), vectors[:n].astype(np.complex128), None
        mu, lefts, vectors = eigenvectors(step)
        dual = lapack.dgetrs(lu, pivots, np.hstack([lefts[:n].real, lefts[:n].imag]), trans=1)[0]
        return mu, vectors[:n].astype(np.complex128), dual[:, : mu.size] + 1j * dual[:, mu.size :]

    def formed(self, u: float, pairs: Eigenpairs) -> Any:
        assert pairs.left is not None
        right, size = np.abs(pairs.right), np.abs(pairs.values)
        velocity, stiffness = (np.abs(matrix) @ right for matrix in self.matrices(u))
        rows = size**2 * (np.abs(self.M) @ right) + size * velocity + stiffness
        return np.sum(np.abs(pairs.left) * rows, axis=0)

    def sharpened(
        self, u: float, values: Complex, right: Complex, left: Complex | None, free: bool
    ) -> tuple[Complex, Complex, Complex | None]:
        """All roots of the inverse problem, with the fast ones from the whole problem."""
        if self.fast is None:
            return values, right, left
        kept, rough = self.fast.starts(u, values, free)
        values = np.concatenate([values[kept], rough])
        lost = np.zeros((self.dof, rough.size))
        right = np.hstack([right[:, kept], lost])
        left = None if left is None else np.hstack([left[:, kept], lost])
        for i, fast in self.fast.polished(u, values, free).items():
            twin = np.flatnonzero(values == values[i].conj())[:1]
            pair = self._elastic(fast)
            for j, found in ((twin, np.conj), ([i], np.asarray)):
                values[j], right[:, j] = found(pair.values), found(pair.right)
                if left is not None and pair.left is not None:
                    left[:, j] = found(pair.left)
        return values, right, left

    def refine(
        self, u: float, value: complex, x: Vectors | None = None, steps: int = 6
    ) -> Eigenpairs:
        if self.fast is None or not is_fast(value):
            return super().refine(u, value, x, steps)
        return self._elastic(self.fast.near(u, value, 1.0))

    def _elastic(self, pair: FastPair) -> Eigenpairs:
        """Vectors in elastic coordinates, as good as these can hold them."""
        assert isinstance(self.model, Chain)
        scale = self.model.elastic_scale
        right = unit((pair.right[0::4] / scale)[:, None])
        left = unit((np.diff(pair.left[2::4], prepend=0.0) / scale)[:, None])
        return Eigenpairs(np.array([pair.value]), right, left, np.array([pair.residual]))


class SparsePencil(Pencil):
    """What is too long for matrices: every product and solve is O(dof)."""

    def inverse(self, u: float, shift: float, free: bool, count: int | None, left: bool) -> Any:
        n = self.dof
        solve = self.factor(shift, u)

        def step(v: Array) -> Array:
            x = v[:n].reshape(-1, 1)
            if free:
                return -solve(self.mass(x))[:, 0]
            y = v[n:].reshape(-1, 1)
            rows = self.mass(2.0 * shift * x + y) + self.damped(u, x)
            return np.concatenate([-solve(rows)[:, 0], v[:n]])

        size = n if free else 2 * n
        assert count is not None
        start = np.concatenate([np.linspace(1.0, 0.0, n, endpoint=False), np.zeros(size - n)])
        operator = LinearOperator((size, size), matvec=step, dtype=np.float64)
        ncv = min(size, max(2 * count + 1, 20))
        options = {"v0": start, "tol": 0.0, "ncv": ncv}
        if n <= DENSE_RESCUE:
            options["maxiter"] = PATIENCE
        try:
            mu, vectors = eigs(operator, k=count, which="LM", **options)
        except ArpackError as error:
            if n <= DENSE_RESCUE:
                raise Crowded from error
            mu = getattr(error, "eigenvalues", np.zeros(0))
            if mu.size == 0:
                return None
            vectors = error.eigenvectors
        if not np.isfinite(mu).all():
            return None
        return mu, vectors[:n], None


class BandPencil(SparsePencil):
    """A long chain."""

    def __init__(self, model: Chain) -> None:
        super().__init__(model)
        self.core = model.core
        self.resisted = model.resisted
        self.scale = model.elastic_scale[:, None]
        self.elastic = model.elastic_share[:, None]

    def _rows(self, product: Callable[[Array], Array], x: Vectors) -> Vectors:
        """A product in the angles, taken to elastic coordinates; complex columns as real pairs."""
        angles = np.ascontiguousarray(np.cumsum(self.scale * x, axis=0))
        if np.iscomplexobj(angles):
            rows: Vectors = product(angles.view(np.float64)).view(np.complex128)
        else:
            rows = product(angles)
        result: Vectors = self.scale * np.cumsum(rows[::-1], axis=0)[::-1]
        return result

    def mass(self, x: Vectors) -> Vectors:
        return self._rows(self.core.mass_times, x)

    def velocity(self, x: Vectors) -> Vectors:
        return self.direction * self._rows(self.core.velocity_times, x)

    def damping(self, x: Vectors) -> Vectors:
        result: Vectors = self.pipe.damping * self.by_damping(x)
        return result + self._rows(self.core.terms_damping_times, x) if self.resisted else result

    def by_damping(self, x: Vectors) -> Vectors:
        result: Vectors = self.elastic * x
        return result

    def stiffness(self, x: Vectors) -> Vectors:
        result: Vectors = self.elastic * x
        if self.pipe.terms:
            result = result + self._rows(self.core.terms_stiffness_times, x)
        return result + self.pipe.gamma * self.gravity(x) if self.pipe.gamma else result

    def gravity(self, x: Vectors) -> Vectors:
        return self._rows(self.core.gravity_times, x)

    def flux(self, x: Vectors) -> Vectors:
        return self._rows(self.core.flux_times, x)

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        width, band = self.core.band_width, self.core.band(complex(value), u)
        solve_band = band_solver(band.real if np.imag(value) == 0.0 else band, width, width)

        def solve(rows: Vectors, adjoint: bool = False) -> Vectors:
            loads = rows / self.scale
            extended = np.zeros((4 * self.dof, rows.shape[1]), dtype=loads.dtype, order="F")
            if adjoint:
                extended[0::4] = loads
                angles = solve_band(extended, True)
                dual: Vectors = np.diff(angles[2::4], axis=0, prepend=0.0) / self.scale
                return dual
            extended[2::4] = loads
            extended[2:-4:4] -= loads[1:]
            joint_angles: Vectors = solve_band(extended, False)[0::4] / self.scale
            return joint_angles

        return solve


class ScenePencil(SparsePencil):
    """A long scene."""

    model: Assembly

    def __init__(self, model: Assembly) -> None:
        super().__init__(model)
        self.linear = model.linear

    def mass(self, x: Vectors) -> Vectors:
        return self.linear.mass(x)

    def velocity(self, x: Vectors) -> Vectors:
        return self.direction * (self.linear.gyroscopic(x) + self.linear.end_flux(x))

    def damping(self, x: Vectors) -> Vectors:
        return self.linear.damping(x)

    def stiffness(self, x: Vectors) -> Vectors:
        return self.linear.stiffness(x)

    def gravity(self, x: Vectors) -> Vectors:
        other, step = _stepped(self.pipe, "gamma")
        heavier = self.model.with_pipe(other).linear.stiffness(x)
        return step * (heavier - self.linear.stiffness(x))

    def by_damping(self, x: Vectors) -> Vectors:
        other, step = _stepped(self.pipe, "damping")
        slower = self.model.with_pipe(other).linear.damping(x)
        return step * (slower - self.linear.damping(x))

    def flux(self, x: Vectors) -> Vectors:
        return self.linear.flux(x)

    def factor(self, value: complex, u: float) -> Callable[..., Vectors]:
        return self.linear.factor(value, u)


def _stepped(pipe: Pipe, name: str) -> tuple[Pipe, float]:
    """The pipe with one number changed by a step of 1 or -1, which keeps it in its range."""
    value = getattr(pipe, name)
    step = 1.0 if value < 1.0 else -1.0
    return replace(pipe, **{name: value + step}), step
