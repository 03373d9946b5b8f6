# SPDX-License-Identifier: MIT
"""P(lambda; x, y) = lambda^2 M + lambda C + K over two numbers of a pipe, with its derivatives.

The numbers are the flow speed or any that `pipe_numbers` names. M, C and K are polynomials of the
speed, and affine in most other numbers and in the square root of beta. The stiffness k of a chain's
root lies in series with k_1 of the first joint, so that the matrices are polynomials of k / (k_1 +
k), the share of the angle at the joint; for the root of a reduced model they are polynomials of 1 /
sqrt(k). Interpolation from the matrices at a few nodes, including the corners of the window, is
then exact at all points. A point inside serves as a test. If the test fails, matrices are computed
at each point, and derivatives are differences.
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

from pipedyn.linear.neutral import SHIFT, companion, eigenvalues_of, grows, shifted
from pipedyn.models.base import COMPLEX_STEP, Model, Operators
from pipedyn.models.chain import Chain
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.models.pipe_numbers import PipeNumber
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations

AFFINE = 1e-12
"""Largest distance of the matrices at a point inside from the interpolated ones, relative to the
largest entry, that counts as rounding: as measured, it is 2e-15 at most if they agree."""

SYMMETRIC = 1e-10
"""Largest relative difference of entries equal by symmetry that counts as rounding."""

RELATIVE_STEP = 1e-5
"""Half-width of differences, relative to the number: rounding and terms of third order leave errors
of some 1e-10."""

ON_EDGE = 1e-9
"""Distance from an edge, as a share of the window, that counts as rounding."""

SAMPLES, SHORTEST_STEP = 16, 1.0 / 1024.0
"""Number of steps in which eigenvalues are followed on a line across the window, and the least
step, as a share of the line, after halving."""

FAR = 2.0
"""Real part, less the magnitude of the imaginary part, beyond which a root is ignored on a line: it
does not cross the axis within a step."""

POLYNOMIALS = {
    k: np.linalg.inv(np.vander(np.linspace(0.0, 1.0, k), increasing=True)) for k in (1, 2, 3)
}
"""Matrices from values at k evenly spaced nodes in [0, 1] to coefficients of a polynomial."""

Matrices = tuple[Array, Array, NDArray[Any]]
"""The matrices M, C, K, shape (dof, dof) each; K is complex with hysteresis."""


@dataclass(frozen=True)
class Window:
    """Two numbers (None is the flow speed), with the lower ends and sizes of their ranges."""

    numbers: tuple[PipeNumber | None, PipeNumber | None]
    low: Array
    size: Array

    def place(self, share: Array) -> Array:
        """The point (x, y) at shares of the ranges, shape (2,)."""
        return self.low + self.size * share

    def pipe(self, pipe: Pipe, at: Array) -> Pipe:
        """A pipe with the numbers (x, y)."""
        for number, value in zip(self.numbers, at.tolist(), strict=True):
            if number is not None:
                pipe = number.changed(pipe, value)
        return pipe

    def on_edges(self, share: Array, distance: float = ON_EDGE) -> Array:
        """Shares of the ranges; those within a distance of an edge are moved onto it."""
        edges = share.clip(0.0, 1.0).round()
        return np.where(np.abs(share - edges) <= distance, edges, share)


@dataclass(frozen=True)
class Scale:
    """A function s of a number between two values, in which the matrices are polynomials."""

    low: float
    high: float
    count: int = 2  # number of nodes, at which matrices are computed
    of: Callable[[Any], Any] = lambda value: value
    back: Callable[[Any], Any] = lambda s: s
    least: float = -math.inf  # the number must exceed this value
    affine: bool = True  # whether K is affine in s

    def spaced(self, count: int) -> Array:
        """Numbers from `low` to `high`, evenly spaced in s, shape (count,)."""
        between = np.linspace(self.of(self.low), self.of(self.high), count)[1:-1]
        return np.array([self.low, *self.back(between), self.high])

    @property
    def nodes(self) -> Array:
        """Values of the number at the nodes of interpolation, evenly spaced in s."""
        return self.spaced(max(self.count, 2))[: self.count]

    def weights(self, value: float) -> tuple[Array, Array]:
        """Weights of the k nodes, (k,), in the interpolating polynomial, and their derivatives."""
        low, high = self.of(self.low), self.of(self.high)
        s = (self.of(value + 1j * COMPLEX_STEP) - low) / (high - low)
        found = np.array([1.0, s, s * s])[: self.count] @ POLYNOMIALS[self.count]
        return found.real, found.imag / COMPLEX_STEP


def _scale(number: PipeNumber | None, low: float, high: float, model: Model) -> Scale:
    """The scale in which a model's matrices are polynomials of a number between two values."""
    if number is None:
        return Scale(low, high, 1)  # `Plane.matrices` has the polynomials of the speed
    if number.name == "beta":
        return Scale(low, high, of=np.sqrt, back=np.square, least=0.0)
    if number.name == "root.stiffness" and isinstance(model, Chain):
        # Damping and loss of the first joint are proportional to the square of its share of the
        # angle: three nodes are needed.
        joint = float(model.springs[0])
        share, back = (lambda k: k / (joint + k)), (lambda s: joint * s / (1.0 - s))
        return Scale(low, high, 3, share, back, -0.5 * joint)
    if number.name == "root.stiffness" and isinstance(model, Galerkin):
        # Functions, so that the root's rotation is proportional to 1 / sqrt(k).
        return Scale(low, high, 3, lambda k: k**-0.5, lambda t: t**-2.0, 0.0, affine=False)
    return Scale(low, high)


class Plane:
    """Matrices and eigenvalues of one model over a window of two numbers.

    Args:
        model: the model, about the straight pipe.
        window: the two numbers with their ranges.
        speed: flow speed, if it is none of the two numbers.
        modes: number of lowest modes whose eigenvalues count; all by default.

    Attributes:
        conservative: whether the system is conservative, see `conservative_at`, inside the window.
        exact: whether the matrices are polynomials in the scales of the numbers.
    """

    rest_size = 0
    """Number of coordinates at rest among the unknowns of a curve, of a bent pipe."""

    across: bool | None = None
    """Whether motions are across the plane in which the pipe rests bent; None of straight pipes."""

    def __init__(
        self, model: Model, window: Window, speed: float | None, modes: int | None = None
    ) -> None:
        self.model, self.window, self.speed = model, window, speed
        self.modes = model.dof if modes is None else modes
        self.hysteretic = bool(model.pipe.hysteresis) or any(
            number is not None and number.name == "hysteresis" for number in window.numbers
        )
        self._scales = [
            _scale(number, low, low + length, model)
            for number, low, length in zip(
                window.numbers, window.low.tolist(), window.size.tolist(), strict=True
            )
        ]
        self._prepare()

    def _prepare(self) -> None:
        """Computes the matrices at the nodes, and tests their interpolation."""
        window, self.dof = self.window, self.model.dof
        middle = self.model_at(window.place(np.array([0.5, 0.5])))
        self.scale = np.asarray(middle.from_elastic(np.eye(self.dof)), dtype=np.float64)
        nodes = product(*(one.nodes for one in self._scales))
        self._nodes = np.array([self._parts(np.array(at)) for at in nodes])
        inside = window.place(np.array([0.37, 0.61]))
        by_nodes = self._from_nodes(np.outer(*self._weights(inside)[:2]).ravel())[0]
        own = self._parts(inside)
        sizes = np.abs(own).max(axis=(1, 2), keepdims=True)
        self.exact = bool((np.abs(own - by_nodes) <= AFFINE * (sizes + 1e-300)).all())
        self.conservative = self.conservative_at(inside)

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The plane itself or, of a bent pipe in space, one for motions in each direction."""
        return (self,)

    def nearest_rest(self, at: Array) -> Array:
        """Coordinates at rest, (rest_size,), of the pipe with numbers (x, y): of a bent one."""
        return np.empty(0)

    def turns_back(self, at: Array) -> Array:
        """Direction in which a bent rest ceases to exist at a fold; see `BentPlane`."""
        raise NotImplementedError

    def follows(self, at: Array) -> bool:
        """Whether the rest at (x, y, *q) is that which follows from the pipe without loads."""
        return True

    @cached_property
    def speed_index(self) -> int | None:
        """Index, 0 or 1, of the flow speed among the two numbers; None if it is neither."""
        return next((i for i, number in enumerate(self.window.numbers) if number is None), None)

    def speed_at(self, at: Array) -> float:
        """Flow speed at the point (x, y)."""
        if self.speed_index is not None:
            return float(at[self.speed_index])
        assert self.speed is not None
        return self.speed

    def straight_near(self, share: Array, distance: float = ON_EDGE) -> bool:
        """Whether a pipe that is bent elsewhere is straight at shares, or on an edge that close."""
        at = self.window.place(self.window.on_edges(share, distance))
        return bool(self.rest_size) and self.model_at(at).pipe.rests_straight

    def conservative_near(self, share: Array, distance: float) -> bool:
        """Whether the system is conservative at shares of the window, or on an edge that close."""
        return self.conservative_at(self.window.place(self.window.on_edges(share, distance)))

    def conservative_at(self, at: Array) -> bool:
        """Whether eigenvalues come in fours, lambda, -lambda and conjugates, at (x, y).

        They do if nothing damps, forces proportional to velocities are gyroscopic and K is
        symmetric, as in a pipe without damping on whose ends the flow does no work.
        """
        _, damping, stiffness = self.at(at)
        if np.iscomplexobj(stiffness) and stiffness.imag.any():
            return False
        return _differ_little(damping, -damping.T) and _differ_little(stiffness, stiffness.T)

    def model_at(self, at: Array) -> Model:
        """The model whose pipe has the numbers (x, y)."""
        window = self.window
        share = (at - window.low) / window.size
        within = window.on_edges(share)
        at = np.where(within == share, at, window.place(within))
        return self.model.with_pipe(window.pipe(self.model.pipe, at))

    def _parts(self, at: Array) -> Array:
        """Parts (6, dof, dof): M; C without flow, per u; K without flow, per u^2; loss."""
        of: Operators = self.model_at(at).operators()
        flow = of.direction * (of.gyroscopic + of.end_flux)
        loss = np.zeros_like(of.mass) if of.loss is None else of.loss
        parts = (of.mass, of.damping, flow, of.stiffness, of.centrifugal * of.flux, loss)
        return self.scale.T @ np.array(parts) @ self.scale

    def _weights(self, at: Array) -> tuple[Array, Array, Array, Array]:
        """Weights of the nodes along x and along y at a point, and derivatives of both."""
        (x, along_x), (y, along_y) = (
            one.weights(value) for one, value in zip(self._scales, at.tolist(), strict=True)
        )
        return x, y, along_x, along_y

    def _from_nodes(self, *weights: Array) -> Array:
        """Sums of the parts at the nodes, (k, 6, dof, dof), with each of k arrays of weights."""
        flat = self._nodes.reshape(len(self._nodes), -1)
        return (np.array(weights) @ flat).reshape(-1, *self._nodes.shape[1:])

    def defined(self, at: Array) -> bool:
        """Whether matrices exist at (x, y), a point that may lie outside the window."""
        return all(value > one.least for one, value in zip(self._scales, at.tolist(), strict=True))

    def _all_parts(self, at: Array) -> Array:
        """Parts of the matrices at a point, and their derivatives by x and y: (3, 6, dof, dof)."""
        if self.exact:
            x, y, along_x, along_y = self._weights(at)
            pairs = (x, y), (along_x, y), (x, along_y)
            return self._from_nodes(*(np.outer(*pair).ravel() for pair in pairs))
        return np.array([self._parts(at), self._differences(at, 0), self._differences(at, 1)])

    def _differences(self, at: Array, index: int) -> Array:
        """Derivative of the parts by x or y, from two points within the number's range."""
        number = self.window.numbers[index]
        if number is None:
            return np.zeros((6, self.dof, self.dof))
        h = RELATIVE_STEP * (abs(at[index]) or self.window.size[index])
        behind, ahead = at.copy(), at.copy()
        behind[index] = max(at[index] - h, number.rule.get("low", -math.inf))
        ahead[index] = min(at[index] + h, number.rule.get("high", math.inf))
        change = self._parts(ahead) - self._parts(behind)
        return np.asarray(change / (ahead[index] - behind[index]))

    def matrices(self, at: Array) -> tuple[Matrices, Matrices, Matrices]:
        """The matrices M, C, K at (x, y), and their derivatives by x and by y."""
        parts, u = self._all_parts(at), self.speed_at(at)
        found = [self._joined(one, u) for one in parts]
        if self.speed_index is not None:
            mass, _, flow, _, flux, _ = parts[0]
            found[1 + self.speed_index] = np.zeros_like(mass), flow, 2.0 * u * flux
        return found[0], found[1], found[2]

    def varied(self, at: Array) -> tuple[Array, Matrices, list[Matrices], Array, Array]:
        """The matrices at a point (x, y, *q) and their derivatives in some directions of (q, y, x).

        x and y are shares of the window in directions, (k, n + 2), n being `rest_size`: 0 for a
        straight pipe. The last results are the n forces at rest with derivatives, (n, n + 2).
        """
        matrices, *by = self.matrices(at)
        changes = [times(size, one) for size, one in zip(self.window.size, by, strict=True)]
        return np.eye(2), matrices, changes[::-1], np.empty(0), np.empty((0, 2))

    def _joined(self, parts: Array, u: float) -> Matrices:
        """M, C, K at a flow speed from their parts, or derivatives from those of the parts."""
        mass, damping, flow, stiffness, flux, loss = parts
        still: NDArray[Any] = stiffness + u**2 * flux
        return mass, damping + u * flow, still + 1j * loss if self.hysteretic else still

    def at(self, at: Array) -> Matrices:
        """The matrices M, C, K at (x, y)."""
        if not self.exact:
            return self._joined(self._parts(at), self.speed_at(at))
        weights = np.outer(*self._weights(at)[:2]).ravel()
        return self._joined(self._from_nodes(weights)[0], self.speed_at(at))

    # ----------------------------------------------------------------------------- eigenvalues

    def eigenvalues(self, at: Array) -> Complex:
        """Eigenvalues of the counted modes at (x, y), in order of |lambda|."""
        found = eigenvalues_of(*self.at(at))
        return found[np.argsort(np.abs(found))][: 2 * self.modes]

    def unstable(self, at: Array) -> int:
        """Number of eigenvalues whose real part is positive beyond rounding."""
        return int(np.count_nonzero(grows(self.eigenvalues(at))))

    def static_stiffnesses(self, at: Array) -> Array | None:
        """Eigenvalues of K if C vanishes and K is symmetric; None otherwise.

        The number of unstable roots is then that of negative eigenvalues of K. The roots themselves
        do not give it: rounding moves a double root 0 off the axis by its square root.
        """
        _, damping, stiffness = self.at(at)
        if damping.any() or not self.conservative_at(at):
            return None
        count_factorisations()
        return np.linalg.eigvalsh(0.5 * (stiffness.real + stiffness.real.T))

    def meeting(self, at: Array) -> float:
        """Real part of -lambda^2 midway between the two roots nearest to each other at (x, y)."""
        mass, damping, stiffness = self.at(at)
        values = eigenvalues_of(mass, damping, stiffness)
        values = values[np.argsort(np.abs(values))][: 2 * self.modes]
        values = values[
            (values.imag > 1e-6) | ((np.abs(values.imag) < 1e-6) & (values.real > 1e-6))
        ]
        apart = np.abs(values[:, None] - values) + np.diag(np.full(values.size, np.inf))
        i, j = np.unravel_index(np.argmin(apart), apart.shape)
        return float(-((0.5 * (values[i] + values[j])) ** 2).real)

    def static_roots(self, at: Array, index: int) -> list[float]:
        """Values of x (index 0) or y (1) at which K is singular on the line through (x, y).

        K is affine in the square of the speed and in the scales of most other numbers; for numbers
        in which it is not, it is interpolated between neighbouring samples. K0 + s (K1 - K0) is
        singular where 1 / (s - shift) is an eigenvalue of -(K0 + shift (K1 - K0))^-1 (K1 - K0).
        """
        low, high = self.window.low[index], self.window.low[index] + self.window.size[index]
        scale = self._scales[index]
        if self.window.numbers[index] is None:
            scale = Scale(low, high, of=np.square, back=np.sqrt)
        affine = scale.affine and (self.exact or self.window.numbers[index] is None)
        values = scale.spaced(2 if affine else 4 * SAMPLES + 1)
        there = np.tile(at, (values.size, 1))
        there[:, index] = values
        found, shift = [], 0.5 * SHIFT
        for (first, begin), (last, end) in pairwise(
            (scale.of(value), self.at(one)[2].real)
            for value, one in zip(values, there, strict=True)
        ):
            change = end - begin
            if np.abs(change).max() <= 1e-13 * np.abs(begin).max():
                continue
            count_factorisations()
            inverse = np.linalg.eigvals(np.linalg.solve(begin + shift * change, -change))
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = shift + 1.0 / inverse
            real = np.isfinite(shares) & (np.abs(shares.imag) <= 1e-7 * (1.0 + np.abs(shares)))
            s = np.sort(shares.real[real & (shares.real >= 0.0) & (shares.real <= 1.0)])
            found += [float(scale.back(root)) for root in first + s * (last - first)]
        return found

    def lines(self, index: int, number: int) -> Array:
        """Values of x (index 0) or y (1) of lines, evenly spaced in the scale of that number."""
        scale = self._scales[index]
        return (scale if scale.affine else Scale(scale.low, scale.high)).spaced(number)

    def sections(
        self, at: Array, index: int, halved: bool = True
    ) -> tuple[list[RootOnLine], list[RootOnLine]]:
        """Pairs that cross the imaginary axis on the line through (x, y) along x or y; extremes.

        Extremes are pairs whose real part comes nearest to the axis there, from either side,
        without crossing. Both are estimates for Newton's method.
        """
        return self._on_line(self.pairs, at, index, halved)

    def _on_line(
        self,
        values_at: Callable[[Array], tuple[Complex, Complex]],
        at: Array,
        index: int,
        halved: bool = True,
    ) -> tuple[list[RootOnLine], list[RootOnLine]]:
        """Values whose real part passes 0 on the line through (x, y) along x or y; extremes.

        Values, with derivatives as of `pairs`, are followed from sample to sample. Steps are halved
        in which one may have passed 0 unseen, unless `halved` is False.
        """
        low, size = self.window.low[index], self.window.size[index]

        def sample(share: float) -> Sample:
            there = at.copy()
            there[index] = low + share * size
            values, slopes = values_at(there)
            return share, values, slopes[index]

        samples = [sample(float(share)) for share in np.linspace(0.0, 1.0, SAMPLES + 1)]
        found: list[RootOnLine] = []
        extremes: list[RootOnLine] = []
        waiting = list(pairwise(samples))[::-1]
        while waiting:
            a, b = waiting.pop()
            passed, nearest, doubtful = _between(a, b)
            if halved and doubtful and b[0] - a[0] > SHORTEST_STEP:
                middle = sample(0.5 * (a[0] + b[0]))
                waiting += [(middle, b), (a, middle)]
            else:
                found += passed
                extremes += nearest
        return found, extremes

    def pairs(self, at: Array) -> tuple[Complex, Complex]:
        """The k eigenvalues above the real axis and near the imaginary one, and their slopes.

        Slopes are derivatives by shares of the window along x and y, shape (2, k).
        """
        found = self.matrices(at)
        inverse, vectors = np.linalg.eig(companion(*found[0]))
        n = self.dof
        # Rows of the inverse of the companion matrix' eigenvectors are its left eigenvectors. Their
        # product with the inverse of P(SHIFT) gives those of P(lambda).
        rows = np.linalg.inv(vectors)[:, :n] @ np.linalg.inv(shifted(*found[0]))
        with np.errstate(divide="ignore", invalid="ignore"):
            values = SHIFT + 1.0 / inverse.astype(complex)
        sizes = np.where(np.isfinite(values), np.abs(values), np.inf)
        keep = np.argsort(sizes)[: min(2 * self.modes, np.count_nonzero(np.isfinite(sizes)))]
        values, x, y = values[keep], vectors[:n, keep], rows[keep]
        above = (values.imag > 1e-6) & (np.abs(values.real) < FAR + np.abs(values.imag))
        values, x, y = values[above], x[:, above], y[above]
        # Products with the left and right vectors, of M, C and K and of their changes by x and y.
        (m, c, _), *changes = np.sum(y.T * (np.array(found) @ x), axis=2)
        moved = np.array([values**2 * m_p + values * c_p + k_p for m_p, c_p, k_p in changes])
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = -moved / (2.0 * values * m + c)
        by_shares = self.window.size[:, None] * np.nan_to_num(slopes)
        return np.asarray(values, dtype=complex), by_shares


Sample = tuple[float, Complex, Complex]
"""Share of a line, eigenvalues above the real axis there, and their derivatives by the share."""

RootOnLine = tuple[float, complex]
"""Share of a line, and an eigenvalue there."""


def _between(a: Sample, b: Sample) -> tuple[list[RootOnLine], list[RootOnLine], bool]:
    """Roots that cross the imaginary axis between two samples, extremes, and whether to halve.

    Extremes are roots whose real part comes nearest to 0 without crossing. A step is to be halved
    if more roots may cross: a cubic with the values and slopes at both ends differs from the
    straight line between them by less than its tangents miss the other end. A root whose real part
    at both ends is larger than that has not crossed the axis twice. If the numbers of roots differ,
    one has left the real axis.
    """
    (s, one, slope), (t, other, slope_there) = a, b
    passed: list[RootOnLine] = []
    extremes: list[RootOnLine] = []
    doubtful = one.size != other.size
    if not one.size or not other.size:
        return passed, extremes, doubtful
    ahead, back = one + (t - s) * slope, other - (t - s) * slope_there
    misses = np.abs(ahead[:, None] - other) + np.abs(one[:, None] - back)
    for i, j in enumerate(np.argmin(misses, axis=1).tolist()):
        ends, rates = (one[i].real, other[j].real), (slope[i].real, slope_there[j].real)
        crosses = ends[0] * ends[1] < 0.0
        doubtful |= misses[i, j] > (sum(map(abs, ends)) if crosses else min(map(abs, ends)))
        turns = ends[0] * ends[1] > 0.0 and ends[0] * rates[0] < 0.0 < ends[0] * rates[1]
        if crosses or turns:
            first, last = ends if crosses else rates
            share = first / (first - last)
            place = s + share * (t - s), complex(one[i] + share * (other[j] - one[i]))
            (passed if crosses else extremes).append(place)
    return passed, extremes, bool(doubtful)


def times(size: float, matrices: Matrices) -> Matrices:
    """The matrices multiplied by a number."""
    mass, damping, stiffness = matrices
    return size * mass, size * damping, size * stiffness


def _differ_little(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """Whether two matrices agree up to rounding."""
    return float(np.abs(one - other).max()) <= SYMMETRIC * float(np.abs(one).max())
