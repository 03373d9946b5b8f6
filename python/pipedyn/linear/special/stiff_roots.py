# SPDX-License-Identifier: MIT
"""Stiff roots of chains whose segments differ by orders of magnitude, to rounding.

Needed where segments or springs differ by orders of magnitude (`is_spread`). Without it the highest
roots fail their residual check, or are wrong by eps |lambda|^2.

A short segment that spins between long ones turns its two joints by nearly opposite angles, and the
turn of a long neighbour, their difference, is lost in rounding: joint angles, which serve slow
motion, cannot hold a stiff one. Two things can:

- displacements w of the nodes, made orthonormal to the mass, in which stiff roots stand out as slow
  ones do in joint angles: they give all roots but the slowest roughly;
- the whole linear problem T(lambda) X = 0 with nothing eliminated (angles, displacements and forces
  side by side; see `band` in cpp/pipedyn/chain/chain.hpp), whose entries are no differences:
  Newton's method on it ends within what rounding its entries does to a root, eps |y|^T |T| |x|.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular
from scipy.sparse import dia_array

from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.util.band import band_solver
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed, newton

Complex = NDArray[np.complex128]
Vectors = NDArray[Any]

Iterate = tuple[complex, tuple[Complex, Complex] | None]
"""lambda and both vectors of T."""

SLOW = 30.0
"""|lambda| up to which joint angles serve: they lose eps |lambda|^2, which is 2e-13 here."""

SPREAD, UNEQUAL = 1e4, 10.0
"""A chain is treated here if its highest frequency exceeds the first, where joint angles lose eight
digits, and the second times n^2: equal segments have 3 n^2 by the estimate made, 7 n^2 in fact."""

STIFFER = 1e6
"""Factor between springs from which a chain is treated here, too: measured on random chains of 3 to
8 segments, joint angles lose roots by 5e-12 at 1e5, 5e-11 at 1e6, 3e-9 at 1e10."""

REACH = (1e-3, 0.1)
"""How far Newton's method may leave its start, relative: by the first, as rough roots are off by
less, or by a third of the distance to the next root, up to the second."""

ENTRY = 8.0 * float(np.finfo(float).eps)
"""Relative rounding of an entry of T, with room for what the products with it add."""


@dataclass(frozen=True)
class StiffPair:
    """A root with both vectors of T.

    Attributes:
        value: lambda.
        right, left: X and Y with T X = 0 and Y^H T = 0, each of shape (4 n,).
        residual: |Y|^T |T X| / (|Y|^T |T| |X|), |T| of the entries' terms.
        uncertain: how far residual and rounding may have moved lambda.
        slope: d lambda / du.
    """

    value: complex
    right: Complex
    left: Complex
    residual: float
    uncertain: float
    slope: complex

    @property
    def conjugate(self) -> StiffPair:
        """The pair of the conjugate root."""
        return StiffPair(
            *(self.value.conjugate(), self.right.conj(), self.left.conj()),
            *(self.residual, self.uncertain, self.slope.conjugate()),
        )


def is_stiff(values: Any) -> Any:
    """Which roots are beyond `SLOW`."""
    return np.isfinite(values) & (np.abs(values) > SLOW)


def is_spread(chain: Chain) -> bool:
    """Whether a chain is so unequal that joint angles do not serve all its roots.

    Its highest frequency is estimated by Rayleigh quotients, of motions in which one node is
    displaced or one segment turns.
    """
    length = chain.lengths
    if chain.approximates_pipe and not chain.pipe.terms and length.max() <= 2.0 * length.min():
        return False
    springs = np.append(chain.springs, [0.0, 0.0])
    masses, chi, eta = chain.core.bodies().T
    turn = 1.0 / np.append(length, np.inf)
    elastic = springs[:-2] * turn[:-1] ** 2 + springs[1:-1] * (turn[:-1] + turn[1:]) ** 2
    elastic += springs[2:] * turn[1:] ** 2
    before, _, after = node_shares(chain.resistances[:, :3], length)
    elastic += after + np.append(before[1:], 0.0)
    mass = masses * (chi**2 + (eta / length) ** 2)
    mass[:-1] += masses[1:] * ((1.0 - chi[1:]) ** 2 + (eta[1:] / length[1:]) ** 2)
    beyond = masses[::-1].cumsum()[::-1] - masses
    turned = length**2 * beyond + masses * ((chi * length) ** 2 + eta**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.maximum(elastic / mass, (springs[:-2] + springs[1:-1]) / turned)
    limit = max(SPREAD, UNEQUAL * length.size**2)
    held = chain.springs[chain.springs > 0.0]
    stiffer = held.size > 0 and held.max() > STIFFER * held.min()
    # Infinite, or NaN, where a node has no mass.
    return bool(squares.max() < np.inf and (stiffer or squares.max() > limit**2))


def node_shares(moments: Array, length: Array) -> tuple[Array, Array, Array]:
    """Sums of k (1 - x)^2, k (1 - x) x and k x^2 over each segment from those of k (x l)^p.

    They multiply displacements of the segment's two ends, k at the share x of its length l.
    `moments` are for p = 0, 1, 2, shape (n, 3).
    """
    zeroth, first, second = moments.T
    mixed = first / length - second / length**2
    return zeroth - first / length - mixed, mixed, second / length**2


def stiff_roots(model: Model) -> StiffRoots | None:
    """The stiff roots of a chain that has them, None of any other model."""
    return StiffRoots(model) if isinstance(model, Chain) and is_spread(model) else None


class StiffRoots:
    """Roots of one chain beyond what its joint angles can hold."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.n = chain.dof
        self.width = chain.core.band_width
        self.band: Callable[[complex, float], Complex] = chain.core.band
        """T at lambda and u, in LAPACK's storage."""
        self.known: dict[complex, StiffPair] = {}
        self.known_at = -1.0
        # Rows F of the springs and P of gravity, matrices of flow and terms, for a mass of one. The
        # kinetic energy is |B w|^2 / 2, two rows a segment. The QR factor of B, largest rows first
        # and with pivoting, is as good in its small rows as in its large ones.
        n, length = self.n, chain.lengths
        node, before = np.eye(n), np.eye(n, k=-1)
        step = node - before
        angle = step / length[:, None]
        masses, chi, eta = chain.core.bodies().T[:, :, None]
        centre = (1.0 - chi) * before + chi * node
        motion = np.vstack([np.sqrt(masses) * centre, np.sqrt(masses) * eta * angle])
        motion = motion[np.argsort(-np.abs(motion).max(axis=1), kind="stable")]
        triangle, order = qr(motion, mode="r", pivoting=True)[:2]
        triangle = triangle[:n]

        def rows(matrix: Array) -> Array:
            solved: Array = solve_triangular(triangle, matrix[:, order].T, trans=1).T
            return solved

        def both(matrix: Array) -> Array:
            return rows(rows(matrix).T).T

        def held(moments: Array) -> Array:
            near, mixed, far = (x[:, None] for x in node_shares(moments, length))
            across = before.T @ (mixed * node)
            return both(before.T @ (near * before) + across + across.T + node.T @ (far * node))

        beyond = masses[::-1].cumsum()[::-1, None] - masses
        moment = length[:, None] * (beyond + masses * chi)
        joints = angle - np.vstack([np.zeros(n), angle[:-1]])
        flow = np.eye(n, k=1) - before
        flow[-1, -1] = 1.0
        flow *= chain.pipe.direction * math.sqrt(chain.pipe.beta)
        thrust = -step.T @ angle
        thrust[-1] += angle[-1]
        self.spring_rows = rows(np.sqrt(chain.springs)[:, None] * joints)
        self.gravity_rows = rows(np.sqrt(moment) * angle)
        self.flow, self.thrust = both(flow), both(thrust)
        self.held, self.damping = np.zeros((2, n, n))
        if chain.pipe.terms:
            resistances = chain.resistances
            self.held = held(resistances[:, :3]) + both(angle.T @ (resistances[:, 6:] * angle))
            self.damping = held(resistances[:, 3:6])

    def rough(self, u: float, free: bool) -> Complex:
        """All roots by |lambda|, to eps times the greatest |lambda| (free: |lambda|^2)."""
        pipe, n = self.chain.pipe, self.n
        springs = self.spring_rows.T @ self.spring_rows
        stiffness = springs + self.held + pipe.centrifugal * u**2 * self.thrust
        if pipe.gamma:
            stiffness += pipe.gamma * (self.gravity_rows.T @ self.gravity_rows)
        if free:
            squares = np.linalg.eigvals(-stiffness).astype(np.complex128)
            roots = np.sqrt(squares)
            values = np.concatenate([roots, -roots])
        else:
            velocity = u * self.flow + pipe.damping * springs + self.damping
            unit = max(math.sqrt(np.abs(stiffness).max()), float(np.abs(velocity).max()))
            step = np.zeros((2 * n, 2 * n))
            step[:n, n:] = np.eye(n)
            step[n:] = np.hstack([-stiffness / unit**2, -velocity / unit])
            values = unit * np.linalg.eigvals(step).astype(np.complex128)
        result: Complex = values[np.argsort(np.abs(values), kind="stable")]
        return result

    def with_stiff_roots(
        self, u: float, values: Complex, right: Complex, left: Complex, free: bool
    ) -> tuple[Complex, Complex, Complex]:
        """All roots of the inverse problem, (r,), with the stiff ones from the whole problem.

        Vectors are in elastic coordinates, (n, r); `free` says that no term in the velocity is
        there, `left` has no columns where left vectors are not asked for.
        """
        kept, rough = self.starts(u, values, free)
        lefts = left.size > 0
        values = np.concatenate([values[kept], rough])
        lost = np.zeros((self.n, rough.size))
        right = np.hstack([right[:, kept], lost])
        left = np.hstack([left[:, kept], lost]) if lefts else left
        for i, pair in self.polished(u, values, free).items():
            conjugate = np.flatnonzero(values == values[i].conj())[:1]
            x, y = self.elastic(pair)
            for j, found in ((conjugate, np.conj), ([i], np.asarray)):
                values[j], right[:, j] = found(np.array([pair.value])), found(x)
                if lefts:
                    left[:, j] = found(y)
        return values, right, left

    def elastic(self, pair: StiffPair) -> tuple[Vectors, Vectors]:
        """Right and left vector in elastic coordinates, as good as these can hold them, (n, 1)."""
        scale = self.chain.elastic_scale
        right = (pair.right[0::4] / scale)[:, None]
        left = (np.diff(pair.left[2::4], prepend=0.0) / scale)[:, None]
        with np.errstate(all="ignore"):
            return right / np.linalg.norm(right, axis=0), left / np.linalg.norm(left, axis=0)

    def starts(self, u: float, values: Complex, free: bool) -> tuple[NDArray[np.intp], Complex]:
        """Which of the inverse problem's roots to keep, and the rough ones in place of the others.

        They part in the widest gap near the geometric mean of least and greatest |lambda|, where
        both routes are equally good.
        """
        order = np.argsort(np.abs(values), kind="stable")
        rough = self.rough(u, free)
        sizes = np.abs(rough)
        middle = max(math.sqrt(sizes[-1]), SLOW)
        below = np.concatenate([sizes[:1], sizes[:-1]])
        near = (sizes > max(0.1 * middle, SLOW)) & (below < 10.0 * middle)
        near[0] = sizes[0] > SLOW
        gaps = np.where(near, sizes / np.maximum(below, 1.0), 0.0)
        cut = int(np.argmax(gaps)) if near.any() else rough.size
        return order[:cut], rough[cut:]

    def derivative(self, value: complex, u: float) -> Complex:
        """dT/dlambda; T is a quadratic, of which a central difference is exact."""
        return (self.band(2.0 * value, u) - self.band(0.0, u)) / (2.0 * value)

    def at(
        self, u: float, value: complex, vectors: tuple[Complex, Complex] | None = None
    ) -> StiffPair:
        """Residual, uncertainty and slope at a root, as it is given, with vectors near its own."""
        if u != self.known_at:
            self.known, self.known_at = {}, u
        if value in self.known:
            return self.known[value]
        if value.imag < 0.0:
            return self.at(u, value.conjugate()).conjugate
        _, right, left = self._iterated(u, value, vectors)
        here = self.band(value, u)
        pulled = np.vdot(left, times(self.derivative(value, u), right))
        by_speed = 0.5 * (self.band(value, u + 1.0) - self.band(value, u - 1.0))
        weight = np.abs(left)
        # |T| of an entry whose terms cancel, as 1 + delta lambda may, would hide their rounding.
        terms = np.abs(self.band(abs(value), u)) + np.abs(self.band(1j * abs(value), u))
        with np.errstate(all="ignore"):
            rest = float(weight @ np.abs(times(here, right)))
            size = float(weight @ times(terms, np.abs(right)))
            uncertain = float((rest + ENTRY * size) / abs(pulled))
            slope = -complex(np.vdot(left, times(by_speed, right)) / pulled)
        if uncertain < abs(value):
            pair = StiffPair(value, right, left, rest / size, uncertain, slope)
        else:
            none = np.ones_like(right)
            pair = StiffPair(value, none, none, math.inf, math.inf, slope)
        self.known[value] = pair
        return pair

    def polished(self, u: float, values: Complex, free: bool) -> dict[int, StiffPair]:
        """The stiff ones among all roots, by their indices, of conjugates the upper only.

        Where Newton's method leaves `REACH`, or ends on another's root, the start remains, with
        the residual that it has.
        """
        pairs: dict[int, StiffPair] = {}
        for i in map(int, np.flatnonzero(is_stiff(values) & (values.imag >= 0.0))):
            start = complex(values[i])
            apart = np.abs(values - start)
            room = float(apart[apart > 0.0].min(initial=np.inf)) / abs(start)
            pair = self.near(u, start, max(REACH[0], min(room / 3.0, REACH[1])), free)
            for k, other in pairs.items():
                same = abs(pair.value - other.value) <= pair.uncertain + other.uncertain
                if same and abs(start - values[k]) > pair.uncertain + other.uncertain:
                    pair = self.at(u, start)
                    break
            pairs[i] = pair
        return pairs

    def near(self, u: float, start: complex, reach: float, free: bool = False) -> StiffPair:
        """The root next to a start and within a share of it, by Newton's method with both vectors.

        The start itself where it leads further away.
        """

        def correction(near: Iterate) -> tuple[Iterate, float]:
            change, right, left = self._iterated(u, *near)
            if start.imag == 0.0:
                change = complex(change.real)
            elif free and start.real == 0.0:
                change = 1j * change.imag
            value = near[0] + change
            if not abs(value - start) <= reach * abs(start):
                raise NewtonFailed("Newton's method left the root's neighbourhood", (start, None))
            return (value, (right, left)), abs(change)

        last: Iterate = start, None
        try:
            last = newton(
                *(last, correction, lambda before, moved, share: moved),
                tolerance=1e-13,
                slower=1.0,
                patience=1,
                iterations=8,  # two or three do from a good start
                scale=lambda near: abs(near[0]),
            ).state
        except NewtonFailed as failed:  # the last iterate before steps grew, or the start
            last = failed.state
        return self.at(u, *last)

    def _iterated(
        self, u: float, value: complex, vectors: tuple[Complex, Complex] | None = None
    ) -> tuple[complex, Complex, Complex]:
        """Newton's change of a value, X and Y after one inverse iteration at it."""
        rate, here = self.derivative(value, u), self.band(value, u)
        if vectors is None:
            seed = np.linspace(1.0, 0.5, 4 * self.n).astype(np.complex128)
            vectors = self._solved(here, np.ones(seed.size), seed, seed)
        x, y = map(normed, vectors)
        load = times(rate, x)
        dual = (rate[self.width :].conj() * by_rows(y, self.width)).sum(axis=0)
        right, left = map(normed, self._solved(here, np.abs(x), load, dual))
        pulled = np.vdot(left, times(rate, right))
        with np.errstate(all="ignore"):
            change = -complex(np.vdot(left, times(here, right)) / pulled)
        return change, right, left

    def _solved(
        self, band: Complex, sizes: Array, load: Complex, dual: Complex
    ) -> tuple[Complex, Complex]:
        """T^-1 load and T^-H dual, for unknowns of about these sizes.

        With these as units, and each equation's terms as its own, rounding of the factors is
        small compared with the terms of each equation, not only of the largest.
        """
        width = self.width
        columns = sizes + 1e-30  # none is zero; |x| <= 1
        rows = 1.0 / times(np.abs(band), columns)
        scaled = band.copy(order="F")
        scaled[width:] *= by_rows(rows, width) * columns
        solve = band_solver(scaled, width, width)
        right: Complex = solve((rows * load)[:, None], False)[:, 0]
        left: Complex = solve((columns * dual)[:, None], True)[:, 0]
        return columns * right, rows * left


def normed(x: Complex) -> Complex:
    """A vector divided by its largest entry."""
    with np.errstate(all="ignore"):
        result: Complex = x / np.abs(x).max()
    return result


def times(band: Vectors, x: Vectors) -> Vectors:
    """A band matrix in LAPACK's storage, times a vector."""
    width = (band.shape[0] - 1) // 3
    diagonals = band[width:], np.arange(width, -width - 1, -1)
    result: Vectors = dia_array(diagonals, shape=(x.size, x.size)) @ x
    return result


def by_rows(x: Vectors, width: int) -> Vectors:
    """Entries x_i at the places of a band matrix's entries (i, j), of so many diagonals a side."""
    return sliding_window_view(np.pad(x, width), 2 * width + 1).T
