# SPDX-License-Identifier: MIT
"""P(lambda; x, y) = lambda^2 M + lambda C + K over two numbers of a pipe, with its derivatives.

The numbers are the flow speed or any that `pipe_numbers` names. M, C, K are polynomials of the
speed, and affine in each other number, of beta in its square root: then all follows exactly from
the matrices at the corners of the window. Whether they are is tried at a point inside. Where they
are not, as in a root spring's stiffness of a chain, in series with that of the first joint, each
point has matrices of its own and derivatives are differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.eigenproblem import Complex, eigenproblem
from pipedyn.models.base import Model, Operators
from pipedyn.models.pipe_numbers import PipeNumber
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

AFFINE = 1e-12
"""Distance of the matrices at a point inside from the affine ones, relative to the largest entry,
up to which it is rounding: measured, 2e-15 at most of those that are affine."""

STEP = 0.01
"""Of differences, relative to the number: sixth order leaves 1e-12."""

SHIFT = 0.7390851332151607
"""The eigenvalues nearest to this are computed best; it is no eigenvalue of any pipe but by
chance."""

Matrices = tuple[Array, Array, NDArray[Any]]
"""M, C, K, (dof, dof) each; K is complex with hysteresis."""


@dataclass(frozen=True)
class Window:
    """Two numbers, or the flow speed (None), and the ranges in which they are looked at."""

    numbers: tuple[PipeNumber | None, PipeNumber | None]
    low: Array
    size: Array

    def place(self, share: Array) -> Array:
        """(x, y) from shares of the ranges."""
        return self.low + self.size * share


class Plane:
    """The matrices of one model over a window.

    Args:
        model: about the straight pipe.
        window: the two numbers.
        speed: the flow speed, where it is neither.

    Attributes:
        conservative: whether nothing damps and no end does work.
        exact: whether matrices are affine in the numbers.
    """

    def __init__(self, model: Model, window: Window, speed: float | None) -> None:
        self.model, self.window, self.speed = model, window, speed
        self.dof = model.dof
        self.lossy = bool(model.pipe.hysteresis) or any(
            number is not None and number.name == "hysteresis" for number in window.numbers
        )
        middle = self.model_at(window.place(np.array([0.5, 0.5])))
        self.conservative = eigenproblem(middle).is_conservative
        self.scale = np.asarray(middle.from_elastic(np.eye(self.dof)), dtype=np.float64)
        self._sides = [0.0] if self.speed_index == 0 else [0.0, 1.0]
        self._tops = [0.0] if self.speed_index == 1 else [0.0, 1.0]
        self._corners = np.array(
            [self._parts(window.place(np.array(at))) for at in product(self._sides, self._tops)]
        )
        inside = window.place(np.array([0.37, 0.61]))
        by_corners = self._from_corners(np.outer(*self._weights(inside)[:2]).ravel())[0]
        own = self._parts(inside)
        sizes = np.abs(own).max(axis=(1, 2), keepdims=True)
        self.exact = bool((np.abs(own - by_corners) <= AFFINE * (sizes + 1e-300)).all())

    @cached_property
    def speed_index(self) -> int | None:
        """Which of the two is the flow speed."""
        return next((i for i, number in enumerate(self.window.numbers) if number is None), None)

    def speed_at(self, at: Array) -> float:
        """The flow speed at (x, y)."""
        if self.speed_index is not None:
            return float(at[self.speed_index])
        assert self.speed is not None
        return self.speed

    def model_at(self, at: Array) -> Model:
        """The model at (x, y)."""
        pipe = self.model.pipe
        for number, value in zip(self.window.numbers, at.tolist(), strict=True):
            if number is not None:
                pipe = number.changed(pipe, value)
        return self.model.with_pipe(pipe)

    def _parts(self, at: Array) -> Array:
        """M; C without flow, and by u; K without flow, and by u^2; the loss: (6, dof, dof)."""
        of: Operators = self.model_at(at).operators()
        flow = of.direction * (of.gyroscopic + of.end_flux)
        loss = np.zeros_like(of.mass) if of.loss is None else of.loss
        parts = (of.mass, of.damping, flow, of.stiffness, of.centrifugal * of.flux, loss)
        return self.scale.T @ np.array(parts) @ self.scale

    def _weights(self, at: Array) -> tuple[Array, Array, Array, Array]:
        """Shares of the corners by x and y at a point, and their derivatives by x and y."""
        shares, slopes = [], []
        for i, number in enumerate(self.window.numbers):
            low, size = self.window.low[i], self.window.size[i]
            if number is None:
                share, slope = 0.0, 0.0
            elif number.name == "beta":
                roots = math.sqrt(low), math.sqrt(low + size)
                share = (math.sqrt(at[i]) - roots[0]) / (roots[1] - roots[0])
                slope = 0.5 / math.sqrt(at[i]) / (roots[1] - roots[0])
            else:
                share, slope = (at[i] - low) / size, 1.0 / size
            one = number is None
            shares.append(np.array([1.0] if one else [1.0 - share, share]))
            slopes.append(np.array([0.0] if one else [-slope, slope]))
        return shares[0], shares[1], slopes[0], slopes[1]

    def _from_corners(self, *weights: Array) -> Array:
        """Sums of the corners' parts, (k, 6, dof, dof), by weights, each of all corners."""
        flat = self._corners.reshape(len(self._corners), -1)
        return (np.array(weights) @ flat).reshape(-1, *self._corners.shape[1:])

    def _all_parts(self, at: Array) -> Array:
        """Parts at a point, and their derivatives by x and y: (3, 6, dof, dof)."""
        if self.exact:
            x, y, along_x, along_y = self._weights(at)
            pairs = (x, y), (along_x, y), (x, along_y)
            return self._from_corners(*(np.outer(*pair).ravel() for pair in pairs))
        return np.array([self._parts(at), self._differences(at, 0), self._differences(at, 1)])

    def _differences(self, at: Array, index: int) -> Array:
        if self.window.numbers[index] is None:
            return np.zeros((6, self.dof, self.dof))
        step = np.zeros(2)
        step[index] = h = STEP * abs(at[index]) / 3.0 or STEP * self.window.size[index]
        weights = (45.0, -9.0, 1.0)
        total = sum(
            weight * (self._parts(at + k * step) - self._parts(at - k * step))
            for k, weight in enumerate(weights, 1)
        )
        return np.asarray(total / (60.0 * h))

    def matrices(self, at: Array) -> tuple[Matrices, Matrices, Matrices]:
        """M, C, K at (x, y), with their derivatives by x and by y."""
        parts = self._all_parts(at)
        u = self.speed_at(at)
        found = [self._joined(one, u) for one in parts]
        if self.speed_index is not None:
            _, _, by_u, _, by_square, _ = parts[0]
            mass, stiffness = np.zeros_like(by_u), 2.0 * u * by_square
            found[1 + self.speed_index] = mass, by_u, stiffness
        return found[0], found[1], found[2]

    def _joined(self, parts: Array, u: float) -> Matrices:
        mass, damping, flow, stiffness, flux, loss = parts
        still: NDArray[Any] = stiffness + u**2 * flux
        return mass, damping + u * flow, still + 1j * loss if self.lossy else still

    def at(self, at: Array) -> Matrices:
        """M, C, K at (x, y)."""
        if not self.exact:
            return self._joined(self._parts(at), self.speed_at(at))
        weights = np.outer(*self._weights(at)[:2]).ravel()
        return self._joined(self._from_corners(weights)[0], self.speed_at(at))

    # ----------------------------------------------------------------------------- eigenvalues

    def eigenvalues(self, at: Array) -> Complex:
        """Those of the pipe's own modes, by |lambda|.

        With hysteresis those above the real axis with their conjugates, and growing real roots.
        """
        mass, damping, stiffness = self.at(at)
        found = _quadratic(mass, damping, stiffness)
        if self.lossy:
            above = found[found.imag > 1e-9]
            still = _quadratic(mass, damping, stiffness.real)
            grows = still[(np.abs(still.imag) < 1e-9) & (still.real > 0.0)]
            found = np.concatenate([above, above.conj(), grows])
        # Of functions that many more would replace, the highest are not the pipe's.
        return found[np.argsort(np.abs(found))][: 2 * self.model.resolved_modes]

    def unstable(self, at: Array) -> int:
        """Number of eigenvalues with positive real part, beyond rounding."""
        found = self.eigenvalues(at)
        return int(np.count_nonzero(found.real > 1e-8 * (1.0 + np.abs(found))))

    def static_roots(self, at: Array, index: int) -> list[float]:
        """Where K is singular on the line through (x, y) along x or y, within the window.

        K is affine in the square of the speed and in the others, so that these are eigenvalues.
        """
        low, high = (self.window.low[index], self.window.low[index] + self.window.size[index])
        if not self.exact:
            return []
        ends = []
        for value in (low, high):
            there = at.copy()
            there[index] = value
            ends.append(self.at(there)[2].real)
        begin, change = ends[0], ends[1] - ends[0]
        if np.abs(change).max() <= 1e-13 * np.abs(begin).max():
            return []
        # K0 + s (K1 - K0) = 0, 1 / s being eigenvalues of -K0^-1 (K1 - K0); shifted off the ends.
        shift = 0.5 * 0.7390851332151607
        factorised()
        inverse = np.linalg.eigvals(np.linalg.solve(begin + shift * change, -change))
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = shift + 1.0 / inverse
        real = (np.abs(shares.imag) <= 1e-7 * (1.0 + np.abs(shares))) & np.isfinite(shares)
        s = np.sort(shares.real[real & (shares.real >= 0.0) & (shares.real <= 1.0)])
        if self.window.numbers[index] is None:
            return [float(root) for root in np.sqrt(low**2 + s * (high**2 - low**2))]
        return [float(root) for root in low + s * (high - low)]

    def sections(self, at: Array, index: int) -> list[tuple[float, float]]:
        """Where pairs pass the axis on the line through (x, y) along x or y: value and frequency.

        Roughly: Newton's method goes on from these. The eigenvalues are followed from sample to
        sample with their derivatives; between two samples one has passed the axis where its real
        part changes its sign, or may have passed twice where tangents from both ends meet beyond
        the axis: such steps are halved.
        """
        low, size = self.window.low[index], self.window.size[index]

        def sample(share: float) -> tuple[float, Complex, Complex]:
            there = at.copy()
            there[index] = low + share * size
            values, slopes = self._moving(there, index)
            above = (values.imag > 1e-6) & (np.abs(values.real) < 2.0 + 2.0 * np.abs(values.imag))
            return share, values[above], slopes[above] * size

        shares = np.linspace(0.0, 1.0, 17)
        samples = [sample(float(share)) for share in shares]
        found: list[tuple[float, float]] = []
        waiting = list(pairwise(samples))[::-1]
        while waiting:
            a, b = waiting.pop()
            guesses, doubtful = _passed(a, b)
            if doubtful and b[0] - a[0] > 1.0 / 2048.0:
                middle = sample(0.5 * (a[0] + b[0]))
                waiting += [(middle, b), (a, middle)]
            else:
                found += guesses
        return [(float(low + share * size), frequency) for share, frequency in found]

    def _moving(self, at: Array, index: int) -> tuple[Complex, Complex]:
        """Eigenvalues and their derivatives by x or y."""
        matrices = self.matrices(at)
        (m, c, k), (m_p, c_p, k_p) = matrices[0], matrices[1 + index]
        values, right, left = _quadratic_vectors(m, c, k)
        keep = np.argsort(np.abs(values))[: 2 * self.model.resolved_modes]
        values, x, y = values[keep], right[:, keep], left[:, keep]

        def form(matrix: NDArray[Any]) -> Complex:
            return np.asarray(np.einsum("ij,ij->j", y.conj(), matrix @ x))

        moved = values**2 * form(m_p) + values * form(c_p) + form(k_p)
        down = 2.0 * values * form(m) + form(c)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = -moved / down
        return values, np.nan_to_num(slopes)


Sample = tuple[float, Complex, Complex]


def _passed(a: Sample, b: Sample) -> tuple[list[tuple[float, float]], bool]:
    """What passes the axis between two samples, and whether this is in doubt."""
    (s, one, slope), (t, other, slope_there) = a, b
    h = t - s
    if not one.size or not other.size:
        return [], False
    ahead, back = one + h * slope, other - h * slope_there
    cost = np.abs(ahead[:, None] - other) + np.abs(one[:, None] - back)
    found: list[tuple[float, float]] = []
    doubtful = False
    taken = set()
    for i in range(one.size):
        j = int(np.argmin(cost[i]))
        near = abs(one[i].real) < 4.0 * h * abs(slope[i]) + 1e-3 or (
            one[i].real * other[j].real <= 0.0
        )
        if not near:
            continue
        off = cost[i, j] > 0.3 * (1e-6 + abs(one[i].real) + abs(other[j].real))
        first, last = one[i].real, other[j].real
        rise, fall = h * slope[i].real, h * slope_there[j].real
        if first * last < 0.0:
            share = first / (first - last)
            mean = one[i] + share * (other[j] - one[i])
            found.append((s + share * h, float(mean.imag)))
            doubtful |= (off and cost[i, j] > 0.1 * abs(one[i])) or j in taken
            taken.add(j)
        else:
            sign = 1.0 if first < 0.0 else -1.0
            rising, falling = sign * rise, sign * fall
            if rising > 0.0 and falling < 0.0:
                # Tangents from both ends meet at this height.
                share = (sign * (last - first) - falling) / (rising - falling)
                height = sign * first + np.clip(share, 0.0, 1.0) * rising
                doubtful |= bool(height > 0.0)
            doubtful |= bool(off and cost[i, j] > 0.5 * abs(one[i].real))
    return found, doubtful


def _quadratic(
    mass: Array, damping: Array, stiffness: NDArray[Any], vectors: Callable[..., Any] | None = None
) -> Any:
    """Eigenvalues of lambda^2 M + lambda C + K, by the inverse problem about `SHIFT`."""
    n = len(mass)
    shifted = stiffness + SHIFT * damping + SHIFT**2 * mass
    factorised()
    right = np.hstack([damping + 2.0 * SHIFT * mass, mass])
    companion = np.zeros((2 * n, 2 * n), dtype=shifted.dtype)
    companion[:n] = -np.linalg.solve(shifted, right)
    companion[n:, :n] = np.eye(n)
    # 1 / (lambda - SHIFT), of the vectors (x, (lambda - SHIFT) x).
    if vectors is not None:
        return vectors(companion)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = SHIFT + 1.0 / np.linalg.eigvals(companion).astype(complex)
    return found[np.isfinite(found)]


def _quadratic_vectors(
    mass: Array, damping: Array, stiffness: NDArray[Any]
) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues with right and left eigenvectors, y^H P(lambda) = 0."""
    n = len(mass)
    inverse, columns = _quadratic(mass, damping, stiffness, np.linalg.eig)
    adjoint, rows = _quadratic(mass.T, damping.T, stiffness.T, np.linalg.eig)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = SHIFT + 1.0 / inverse.astype(complex)
        others = SHIFT + 1.0 / adjoint.astype(complex)
    good = np.isfinite(values)
    values, columns = values[good], columns[:, good]
    # P(lambda)^T has the same eigenvalues, and its vectors are the left ones, conjugate.
    same = np.argmin(np.abs(others[None, :] - values[:, None]), axis=1)
    return values, columns[:n], rows[:n, same].conj()
