# SPDX-License-Identifier: MIT
"""Small motions of a scene about a configuration at rest.

Where every segment hangs on its clamp or joint, all displacements follow from the joint angles phi:
theta = cumsum(phi), dr_j = dr_{j-1} + l_j n_j dtheta_j. With T that map, (x, y, phi) = T dphi, the
modules' matrices in redundant coordinates give

    T^T (lambda^2 M + lambda C + K) T + geometric stiffness,

the last diagonal in dtheta: l_j t_j . S_j, S_j the force at rest on all nodes from j on, that of
the closing constraints (guides and pins) included. These, B dphi = 0, are met by a basis of
reflections, so that in elastic coordinates, phi = scale * Z zeta with Z^T Z = 1, the elastic
stiffness stays the identity. Products are O(n (c + 1)) with c coordinates held. Solved is the
sparse system of (phi, theta, x, y, forces f_x, f_y beyond a node, multipliers), segment after
segment: a band of a few diagonals unless a custom module ties far nodes together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pipedyn.models.base import Operators
from pipedyn.util.band import Rows, band_solver
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

Entries = list[tuple[Any, Any, Any]]
"""Rows, columns and values of a sparse matrix, in parts."""

WIDEST_BAND = 60
"""Diagonals up to which a band solver is used, beyond it a sparse one.

Scenes have 14, with guides and pins 16; only a custom module between far nodes makes them more.
"""

DEPENDENT = 1e-9
"""Guides and pins that depend on the others to this, well above rounding, are redundant."""


@dataclass(frozen=True)
class SceneMatrices:
    """What the modules are to small motions, in redundant coordinates; each (3 n, 3 n), sparse.

    Attributes:
        mass, gyroscopic, end_flux, damping, stiffness, flux: as in `Operators`; stiffness without
            the torsional springs, damping with everything but the flow.
        springs: torsional stiffness by joints, shape (n,).
        force: of modules at rest without flow, shape (3 n,).
        thrust: its derivative by a u^2, shape (3 n,).
        direction, centrifugal: s and a of the pipe.
    """

    mass: Any
    gyroscopic: Any
    end_flux: Any
    damping: Any
    stiffness: Any
    flux: Any
    springs: Array
    force: Array
    thrust: Array
    direction: float
    centrifugal: float


class Reflections:
    """An orthonormal basis Z of what is orthogonal to the columns of b, as Householder reflections.

    Args:
        b: shape (n, c), of full rank.
    """

    def __init__(self, b: Array) -> None:
        self.count = b.shape[1]
        if self.count == 0:
            return
        (packed, tau), _ = scipy.linalg.qr(b, mode="raw")
        self.vectors = np.tril(packed, -1)[:, : self.count]
        self.vectors[np.arange(self.count), np.arange(self.count)] = 1.0
        self.small = np.zeros((self.count, self.count))
        for i in range(self.count):
            self.small[i, i] = tau[i]
            across = self.vectors[:, :i].T @ self.vectors[:, i]
            self.small[:i, i] = -tau[i] * (self.small[:i, :i] @ across)

    def spread(self, x: Rows) -> Rows:
        """Z x, shape (n, r), from (n - c, r)."""
        if self.count == 0:
            return x
        full = np.concatenate([np.zeros((self.count, *x.shape[1:]), dtype=x.dtype), x])
        result: Rows = full - self.vectors @ (self.small @ (self.vectors.T @ full))
        return result

    def gather(self, x: Rows) -> Rows:
        """Z^T x, shape (n - c, r), from (n, r)."""
        if self.count == 0:
            return x
        result: Rows = x - self.vectors @ (self.small.T @ (self.vectors.T @ x))
        return result[self.count :]


def independent(columns: Array, tolerance: float = DEPENDENT) -> NDArray[np.intp]:
    """Which columns depend on none of the others chosen, by QR with pivoting."""
    if columns.shape[1] == 0:
        return np.zeros(0, dtype=np.intp)
    _, r, order = scipy.linalg.qr(columns, mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    rank = int(np.sum(size > tolerance * max(float(size[0]), 1e-300)))
    return np.sort(order[:rank]).astype(np.intp)


def _beyond(rows: Rows) -> Rows:
    """Sum of each row and all after it."""
    return np.cumsum(rows[::-1], axis=0)[::-1]


class Tree:
    """Displacements by joint angles about a configuration.

    Args:
        lengths: of the segments, shape (n,).
        theta: angles of the segments from the axis, shape (n,).
    """

    def __init__(self, lengths: Array, theta: Array) -> None:
        self.size = lengths.size
        self.across = (lengths * np.cos(theta))[:, None]  # l n_x = l t_y
        self.along = (lengths * np.sin(theta))[:, None]  # l t_x = -l n_y

    def spread(self, phi: Rows) -> Rows:
        """T phi, shape (3 n, r)."""
        theta = np.cumsum(phi, axis=0)
        rows = np.empty((3 * self.size, phi.shape[1]), dtype=phi.dtype)
        rows[0::3] = np.cumsum(self.across * theta, axis=0)
        rows[1::3] = -np.cumsum(self.along * theta, axis=0)
        rows[2::3] = phi
        return rows

    def gather_angles(self, rows: Rows) -> Rows:
        """Moments on the segments, shape (n, r), of forces on nodes, shape (3 n, r)."""
        moments: Rows = self.across * _beyond(rows[0::3]) - self.along * _beyond(rows[1::3])
        return moments

    def gather(self, rows: Rows) -> Rows:
        """T^T rows, shape (n, r)."""
        result: Rows = _beyond(self.gather_angles(rows)) + rows[2::3]
        return result

    def stiffening(self, force: Array) -> Array:
        """Geometric stiffness in dtheta of forces on nodes, shape (n, 1) from (3 n,)."""
        stiffness: Array = self.along[:, 0] * _beyond(force[0::3])
        return (stiffness + self.across[:, 0] * _beyond(force[1::3]))[:, None]


class Linear:
    """Operators of small motions, in elastic coordinates zeta, shape (dof,).

    Args:
        tree: displacements about the configuration.
        parts: what the modules are there.
        scale: joint angle of one elastic coordinate, shape (n,).
        given: redundant coordinates that guides and pins hold, shape (c,).
    """

    def __init__(
        self, tree: Tree, parts: SceneMatrices, scale: Array, given: NDArray[np.intp]
    ) -> None:
        self.tree, self.parts = tree, parts
        self.scale = scale[:, None]
        n = tree.size
        held = np.zeros((3 * n, given.size))
        held[given, np.arange(given.size)] = 1.0
        rows = self.scale * tree.gather(held)
        chosen = independent(rows)
        self.held, held, rows = given[chosen], held[:, chosen], rows[:, chosen]
        self.basis = Reflections(rows)
        # The same for the angles theta: coordinates of the operators that users see.
        moments = tree.gather_angles(held)
        self.angle_basis = Reflections(moments)
        self.dof = n - self.held.size
        self.elastic = (parts.springs * scale**2)[:, None]
        self.residuals, stiffening = [], []
        for force in (parts.force, parts.thrust):
            loads = self.scale[:, 0] * tree.gather(force[:, None])[:, 0]
            multipliers = -np.linalg.lstsq(rows, loads)[0] if chosen.size else np.zeros(0)
            self.residuals.append(self.basis.gather(loads))
            stiffening.append(tree.stiffening(force + held @ multipliers))
        self.stiffening, self.stiffening_by_thrust = stiffening
        self._factors: tuple[Any, ...] | None = None

    def unbalanced(self, u: float) -> Array:
        """Force at rest that nothing balances, shape (dof,); 0 at an equilibrium."""
        result: Array = self.residuals[0] + self.parts.centrifugal * u**2 * self.residuals[1]
        return result

    def joint_angles(self, zeta: Rows) -> Rows:
        """Phi, shape (n, r)."""
        result: Rows = self.scale * self.basis.spread(zeta)
        return result

    def _product(self, matrix: Any, zeta: Rows) -> Rows:
        rows = matrix @ self.tree.spread(self.joint_angles(zeta))
        return self.basis.gather(self.scale * self.tree.gather(rows))

    def _bending(self, stiffening: Array, zeta: Rows) -> Rows:
        theta = np.cumsum(self.joint_angles(zeta), axis=0)
        return self.basis.gather(self.scale * _beyond(stiffening * theta))

    def mass(self, zeta: Rows) -> Rows:
        """M zeta."""
        return self._product(self.parts.mass, zeta)

    def gyroscopic(self, zeta: Rows) -> Rows:
        """G zeta."""
        return self._product(self.parts.gyroscopic, zeta)

    def end_flux(self, zeta: Rows) -> Rows:
        """F zeta."""
        return self._product(self.parts.end_flux, zeta)

    def damping(self, zeta: Rows) -> Rows:
        """D zeta."""
        return self._product(self.parts.damping, zeta)

    def stiffness(self, zeta: Rows) -> Rows:
        """K zeta, torsional springs, other modules and forces at rest."""
        springs = self.basis.gather(self.elastic * self.basis.spread(zeta))
        result: Rows = springs + self._others(zeta)
        return result

    def _others(self, zeta: Rows) -> Rows:
        """What K zeta has beside the torsional springs."""
        modules = self._product(self.parts.stiffness, zeta)
        result: Rows = modules + self._bending(self.stiffening, zeta)
        return result

    @cached_property
    def added(self) -> float:
        """Norm of what K has beside the torsional springs, to some ten per cent."""
        zeta = np.cos(np.arange(1.0, self.dof + 1.0))[:, None]
        norm = 0.0
        for _ in range(12):
            zeta /= np.linalg.norm(zeta)
            zeta = self._others(zeta)
            norm = float(np.linalg.norm(zeta))
            if norm == 0.0:
                break
        return norm

    def flux(self, zeta: Rows) -> Rows:
        """A zeta."""
        result: Rows = self._product(self.parts.flux, zeta)
        return result + self._bending(self.stiffening_by_thrust, zeta)

    def operators(self, zeta: Array) -> Operators:
        """Dense matrices in coordinates of which zeta, shape (dof, dof), are the columns."""
        mass, gyroscopic, end_flux, damping, stiffness, flux = (
            zeta.T @ product(zeta)
            for product in (
                *(self.mass, self.gyroscopic, self.end_flux),
                *(self.damping, self.stiffness, self.flux),
            )
        )
        return Operators(
            *(0.5 * (mass + mass.T), 0.5 * (gyroscopic - gyroscopic.T)),
            *(0.5 * (end_flux + end_flux.T), damping, stiffness, flux),
            *(self.parts.direction, self.parts.centrifugal),
        )

    def factor(self, value: complex, u: float) -> Callable[..., Rows]:
        """solve(rows, adjoint=False) with P(value, u), or its conjugate transpose, O(n)."""
        if self._factors is None:
            self._factors = self._assembled()
        size, row, column, constant, mass, velocity, damping, stiffness, flux = self._factors
        data = constant + value**2 * mass + value * (u * velocity + damping) + stiffness
        data = data + self.parts.centrifugal * u**2 * flux
        if np.imag(value) == 0.0:
            data = data.real
        solve_sparse = factored(size, row, column, data)
        phi, moment = self._places[:, 0], self._places[:, 3]

        def solve(rows: Rows, adjoint: bool = False) -> Rows:
            loads = self.basis.spread(rows) / self.scale
            right = np.zeros((size, loads.shape[1]), dtype=np.result_type(loads, data))
            if adjoint:
                right[phi] = loads
                found = solve_sparse(right, True)[moment]
                dual = np.diff(found, axis=0, prepend=np.zeros((1, found.shape[1])))
                return self.basis.gather(dual / self.scale)
            right[moment] = loads
            right[moment[:-1]] -= loads[1:]
            return self.basis.gather(solve_sparse(right, False)[phi] / self.scale)

        return solve

    def _assembled(self) -> tuple[Any, ...]:
        """Rows and columns of the sparse system with the entries of each operator there."""
        n, parts, tree = self.tree.size, self.parts, self.tree
        # Unknowns phi, theta, x, y, f_x, f_y of each segment and the multipliers at its node; the
        # equations have the places: angle, node x, node y, moment, force x, force y, held.
        at_node = np.bincount(self.held // 3, minlength=n)
        first = 6 * np.arange(n) + np.concatenate([[0], np.cumsum(at_node)[:-1]])
        self._places = place = first[:, None] + np.arange(6)
        size = 6 * n + self.held.size
        angle, node_x, node_y, moment, force_x, force_y = place.T
        phi, theta, x, y, beyond_x, beyond_y = place.T
        one = np.ones(n)
        across, along = tree.across[:, 0], tree.along[:, 0]
        fixed: Entries = [
            (angle, theta, one),
            (angle[1:], theta[:-1], -one[1:]),
            (angle, phi, -one),
            *((row, c, one) for row, c in ((node_x, x), (node_y, y))),
            *((row[1:], c[:-1], -one[1:]) for row, c in ((node_x, x), (node_y, y))),
            (node_x, theta, -across),
            (node_y, theta, along),
            *((row, c, one) for row, c in ((force_x, beyond_x), (force_y, beyond_y))),
            *((row[:-1], c[1:], -one[1:]) for row, c in ((force_x, beyond_x), (force_y, beyond_y))),
            (moment, beyond_x, across),
            (moment, beyond_y, -along),
        ]
        for i in np.argsort(self.held, kind="stable"):
            j, axis = divmod(int(self.held[i]), 3)
            own = first[j] + 5 + at_node[j]
            at_node[j] -= 1
            fixed.append(([own], [place[j, 2 + axis]], [1.0]))
            fixed.append(([place[j, 4 + axis]], [own], [-1.0]))

        # Rows of nodes enter the force balance, those of joints two moments.
        row_x, row_y, row_phi = np.arange(3 * n).reshape(n, 3).T
        balance: Entries = [
            *((force_x, row_x, -one), (force_y, row_y, -one), (moment, row_phi, one)),
            (moment[:-1], row_phi[1:], -one[1:]),
        ]
        equations = _sparse(balance, size, 3 * n)
        unknowns = _sparse([(row_x, x, one), (row_y, y, one), (row_phi, phi, one)], 3 * n, size)
        springs = np.zeros(3 * n)
        springs[2::3] = parts.springs
        mass, velocity, damping, stiffness, flux = (
            equations @ of @ unknowns
            for of in (
                *(parts.mass, parts.direction * (parts.gyroscopic + parts.end_flux)),
                *(parts.damping, parts.stiffness + sparse.diags_array(springs), parts.flux),
            )
        )
        stiffness = stiffness + _sparse([(moment, theta, self.stiffening[:, 0])], size, size)
        flux = flux + _sparse([(moment, theta, self.stiffening_by_thrust[:, 0])], size, size)
        matrices = [
            sparse.coo_array(of)
            for of in (_sparse(fixed, size, size), mass, velocity, damping, stiffness, flux)
        ]
        # One list of places serves all operators.
        keys = [of.col.astype(np.int64) * size + of.row for of in matrices]
        pattern = np.unique(np.concatenate(keys))
        data = np.zeros((len(keys), pattern.size))
        for values, key, of in zip(data, keys, matrices, strict=True):
            values[np.searchsorted(pattern, key)] = of.data
        column, row = np.divmod(pattern, size)
        return (size, row, column, *data)


def _sparse(entries: Entries, rows: int, columns: int) -> Any:
    """A sparse matrix by rows; what meets adds up."""
    row, column, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    return sparse.coo_array((values, (row, column)), shape=(rows, columns)).tocsr()


def factored(
    size: int, row: NDArray[np.intp], column: NDArray[np.intp], data: NDArray[Any]
) -> Callable[[Rows, bool], Rows]:
    """solve(rows, adjoint) with a sparse matrix by columns; the rows may be overwritten."""
    below, above = int((row - column).max()), int((column - row).max())
    if below + above <= WIDEST_BAND:
        band = np.zeros((2 * below + above + 1, size), dtype=data.dtype, order="F")
        band[below + above + row - column, column] = data
        return band_solver(band, below, above)
    matrix = sparse.csc_array((data, (row, column)), shape=(size, size))
    factorised()
    try:
        factors = splu(matrix)
    except RuntimeError:  # exactly singular
        factors = splu(matrix + np.finfo(float).eps * sparse.eye_array(size, format="csc"))

    real = not np.iscomplexobj(data)

    def by_sparse(rows: Rows, adjoint: bool) -> Rows:
        if real and np.iscomplexobj(rows):
            return by_sparse(rows.real, adjoint) + 1j * by_sparse(rows.imag, adjoint)
        right = np.ascontiguousarray(rows, dtype=data.dtype)
        solution: Rows = factors.solve(right, trans="H" if adjoint else "N")
        return solution

    return by_sparse
