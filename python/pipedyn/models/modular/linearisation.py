# SPDX-License-Identifier: MIT
"""Small motions of a scene about a configuration at rest.

Where every segment hangs on its clamp or joint, all displacements follow from the joint angles phi:
theta = cumsum(phi), dr_j = dr_{j-1} + l_j n_j dtheta_j. With T that map, (x, y, phi) = T dphi, the
modules' matrices in redundant coordinates give

    T^T (lambda^2 M + lambda C + K) T + geometric stiffness,

the last diagonal in dtheta: l_j t_j . S_j, S_j the force at rest on all nodes from j on, that of
the closing constraints (guides and pins) included. These, B dphi = 0, are met by a basis Z of
reflections. In elastic coordinates, phi = scale * Z zeta with Z^T Z = 1, the elastic stiffness
stays the identity. Products are O(n (c + 1)) with c coordinates held. Solved is the sparse
system of (phi, theta, x, y) with a multiplier (moment of a joint, forces beyond a node, force of a
guide or pin) for each of their kinematic equations, segment after segment: a band of a few
diagonals unless a custom module ties far nodes together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from pipedyn.models.base import Operators
from pipedyn.models.chain import elastic_scale
from pipedyn.models.pencil import Pencil
from pipedyn.util.band import Rows, band_solver
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.power_iteration import largest_stretch

if TYPE_CHECKING:
    from pipedyn.models.modular.assembly import Assembly

WIDEST_BAND = 60
"""Diagonals up to which a band solver is used, beyond it a sparse one.

Scenes have 14, with guides and pins up to 18; only a custom module between far nodes makes them
more.
"""


def matrix(triplets: Any, rows: int, columns: int) -> Any:
    """A sparse matrix by rows from (rows, columns, values); what meets adds up."""
    row, column, values = triplets
    return sparse.coo_array((values, (row, column)), shape=(rows, columns)).tocsr()


class Reflections:
    """An orthonormal basis Z of what is orthogonal to the columns of b, as Householder reflections.

    Args:
        b: shape (n, c), of full rank.
    """

    def __init__(self, b: Array) -> None:
        self.count = b.shape[1]
        if self.count:
            (self.packed, self.tau), _ = scipy.linalg.qr(b, mode="raw")

    def _product(self, x: Rows, transposed: str) -> Rows:
        kind = np.complex128 if np.iscomplexobj(x) else np.float64
        pairs = np.ascontiguousarray(x, dtype=kind).view(np.float64)  # of a complex column two
        work = 64 * max(1, pairs.shape[1])  # blocks of LAPACK's usual size
        product, _, _ = scipy.linalg.lapack.dormqr(
            "L", transposed, self.packed, self.tau, pairs, work
        )
        result: Rows = np.ascontiguousarray(product).view(kind)
        return result

    def spread(self, x: Rows) -> Rows:
        """Z x, shape (n, r), from (n - c, r)."""
        if self.count == 0:
            return x
        return self._product(np.pad(x, ((self.count, 0), (0, 0))), "N")

    def gather(self, x: Rows) -> Rows:
        """Z^T x, shape (n - c, r), from (n, r)."""
        return self._product(x, "T")[self.count :] if self.count else x


def _beyond(rows: Rows) -> Rows:
    """Sum of each row and all after it."""
    return np.cumsum(rows[::-1], axis=0)[::-1]


class Tree:
    """Displacements by joint angles about a configuration.

    Args:
        lengths: of the segments, shape (n,).
        theta: angles of the segments from the axis, shape (n,), or (n, r): one a column.
    """

    def __init__(self, lengths: Array, theta: Array) -> None:
        columns = theta.reshape(lengths.size, -1)
        self.across = lengths[:, None] * np.cos(columns)  # l n_x = l t_y
        self.along = lengths[:, None] * np.sin(columns)  # l t_x = -l n_y

    def spread(self, phi: Rows) -> Rows:
        """T phi, shape (3 n, r)."""
        theta = np.cumsum(phi, axis=0)
        rows = np.empty((3 * phi.shape[0], phi.shape[1]), dtype=phi.dtype)
        rows[0::3] = np.cumsum(self.across * theta, axis=0)
        rows[1::3] = -np.cumsum(self.along * theta, axis=0)
        rows[2::3] = phi
        return rows

    def moments(self, rows: Rows) -> Rows:
        """Moments on the segments, shape (n, r), of forces on the coordinates, shape (3 n, r)."""
        moments, joints = self.gather_angles(rows), rows[2::3]
        moments += joints
        moments[:-1] -= joints[1:]
        return moments

    def gather_angles(self, rows: Rows) -> Rows:
        """The same of forces on nodes alone."""
        moments: Rows = self.across * _beyond(rows[0::3]) - self.along * _beyond(rows[1::3])
        return moments

    def gather(self, rows: Rows) -> Rows:
        """T^T rows, shape (n, r)."""
        result: Rows = _beyond(self.gather_angles(rows)) + rows[2::3]
        return result

    def stiffening(self, force: Array) -> Array:
        """Geometric stiffness in dtheta of forces on nodes, shape (n, 1) from (3 n, 1)."""
        stiffness: Array = self.along * _beyond(force[0::3]) + self.across * _beyond(force[1::3])
        return stiffness


class ScenePencil(Pencil):
    """P(lambda) of small motions about a configuration, in elastic coordinates zeta, shape (dof,).

    Args:
        model: the scene.
        theta: angles of the segments that meet guides and pins, shape (n,); the scene's reference
            where not given.
    """

    def __init__(self, model: Assembly, theta: Array | None = None) -> None:
        super().__init__(model)
        theta = model.reference if theta is None else theta
        motion = model.motion
        layout, core = motion.layout, motion.core
        size = core.coordinates
        self.tree = tree = Tree(layout.lengths, theta)
        self.springs = layout.springs
        self.scale = elastic_scale(self.springs)[:, None]
        still = core.from_angles(theta, np.zeros_like(theta))
        form = motion.form
        force, (stiffness, damping) = form.forces(still, 0.0), form.resistances(still[:size])
        # In redundant coordinates; the stiffness without the torsional springs.
        self.parts = {
            "mass": form.mass,
            "velocity": form.velocity,
            "gyroscopic": 0.5 * (form.velocity - form.velocity.T),
            "end_flux": 0.5 * (form.velocity + form.velocity.T),
            "damping": damping,
            "stiffness": stiffness,
            "flux": form.flux,
        }
        thrust = np.zeros(size)  # derivative of the force by a u^2
        if layout.has_flow:
            thrust[-3:-1] = -np.sin(theta[-1]), -np.cos(theta[-1])

        self.held = layout.held[layout.independent]
        held = layout.unit_loads[:, layout.independent]
        rows = self.scale * tree.gather(held)
        self.basis = Reflections(rows)
        # The same for the angles theta: coordinates of the operators that users see.
        self.angle_basis = Reflections(tree.gather_angles(held))
        residuals, stiffening = [], []
        for of in (force[:, None], thrust[:, None]):
            loads = self.scale * tree.gather(of)
            multipliers = -np.linalg.lstsq(rows, loads)[0] if self.held.size else np.zeros((0, 1))
            residuals.append(self.basis.gather(loads))
            stiffening.append(tree.stiffening(of + held @ multipliers))
        self.residual, self.residual_by_thrust = residuals
        self.stiffening, self.stiffening_by_thrust = stiffening
        self.mass, self.damping, self.flux = (
            partial(self.product, name) for name in ("mass", "damping", "flux")
        )

    def unbalanced(self, u: float) -> Array:
        """Force at rest that nothing balances, shape (dof, 1); 0 at an equilibrium."""
        return self.residual + self.centrifugal * u**2 * self.residual_by_thrust

    def joint_angles(self, zeta: Rows) -> Rows:
        """Phi, shape (n, r)."""
        result: Rows = self.scale * self.basis.spread(zeta)
        return result

    def product(self, name: str, zeta: Rows) -> Rows:
        """One of the operators times zeta, by its name; of the stiffness all but the springs."""
        phi = self.joint_angles(zeta)
        rows = self.parts[name] @ self.tree.spread(phi)
        result: Rows = self.basis.gather(self.scale * self.tree.gather(rows))
        if name in ("stiffness", "flux"):
            geometric = self.stiffening if name == "stiffness" else self.stiffening_by_thrust
            moments = _beyond(geometric * np.cumsum(phi, axis=0))
            result = result + self.basis.gather(self.scale * moments)
        return result

    def velocity(self, x: Rows) -> Rows:
        return self.direction * self.product("velocity", x)

    def stiffness(self, x: Rows) -> Rows:
        elastic = self.springs[:, None] * self.scale**2
        springs = self.basis.gather(elastic * self.basis.spread(x))
        result: Rows = springs + self.product("stiffness", x)
        return result

    @cached_property
    def added(self) -> float:
        """Norm of what K has besides the torsional springs, to some ten per cent."""
        start = np.cos(np.arange(1.0, self.dof + 1.0))[:, None]
        return largest_stretch(partial(self.product, "stiffness"), start, 12)

    def operators(self, zeta: Array) -> Operators:
        """Dense matrices in coordinates of which zeta, shape (dof, dof), are the columns."""
        mass, gyroscopic, end_flux, damping, flux = (
            zeta.T @ self.product(name, zeta)
            for name in ("mass", "gyroscopic", "end_flux", "damping", "flux")
        )
        return Operators(
            *(0.5 * (mass + mass.T), 0.5 * (gyroscopic - gyroscopic.T)),
            *(0.5 * (end_flux + end_flux.T), damping, zeta.T @ self.stiffness(zeta), flux),
            *(self.direction, self.centrifugal),
        )

    def factor(self, value: complex, u: float) -> Callable[..., Rows]:
        places, row, column, data = self._system
        constant, mass, velocity, damping, stiffness, flux = data
        entries = constant + value**2 * mass + value * (u * velocity + damping) + stiffness
        entries = entries + self.centrifugal * u**2 * flux
        if np.imag(value) == 0.0:
            entries = entries.real
        solve_sparse = factored(places.size, row, column, entries)
        phi = places[: self.scale.size]

        def solve(rows: Rows, adjoint: bool = False) -> Rows:
            loads = self.basis.spread(rows) / self.scale
            right = np.zeros((places.size, loads.shape[1]), dtype=np.result_type(loads, entries))
            right[phi] = loads
            return self.basis.gather(solve_sparse(right, adjoint)[phi] / self.scale)

        return solve

    @cached_property
    def _system(self) -> tuple[NDArray[np.intp], NDArray[Any], NDArray[Any], Array]:
        """The sparse system: places of the unknowns, and rows, columns and values of its entries.

        The unknowns (phi, theta, x, y) obey the balance of virtual work with the kinematics G = 0
        (angles, nodes along x and y, what is held) as constraints, [P G^T; G 0]; the equations are
        listed as the unknowns are, one kind after the other, and both take their places segment
        after segment. Values: of what no operator changes, mass, velocity, damping, stiffness and
        flux, a row each.
        """
        n, tree, parts = self.scale.size, self.tree, self.parts
        one = sparse.eye_array(n)
        step = one - sparse.eye_array(n, k=-1)  # from a node or segment to the next
        across, along = (sparse.diags_array(of[:, 0]) for of in (tree.across, tree.along))
        node, axis = np.divmod(self.held, 3)
        place = np.arange(node.size), node
        held = [sparse.coo_array((1.0 * (axis == a), place), (node.size, n)) for a in (0, 1)]
        kinematics = sparse.block_array(
            [
                [-one, step, None, None],
                [None, -across, step, None],
                [None, along, None, step],
                [None, None, *held],
            ]
        )
        constant = sparse.block_array([[None, kinematics.T], [kinematics, None]])
        size, at = constant.shape[0], np.arange(n)
        coordinates = np.stack([2 * n + at, 3 * n + at, at], axis=1).ravel()  # x, y, phi
        unknowns = matrix((np.arange(3 * n), coordinates, np.ones(3 * n)), 3 * n, size)
        in_joints = sparse.diags_array(np.kron(self.springs, [0.0, 0.0, 1.0]))

        def geometric(stiffening: Array) -> Any:
            return matrix((n + at, n + at, stiffening[:, 0]), size, size)

        matrices = [constant] + [
            unknowns.T @ of @ unknowns + more
            for of, more in (
                (parts["mass"], 0),
                (self.direction * parts["velocity"], 0),
                (parts["damping"], 0),
                (parts["stiffness"] + in_joints, geometric(self.stiffening)),
                (parts["flux"], geometric(self.stiffening_by_thrust)),
            )
        ]
        # Of each segment: moment of the joint, phi, theta, forces, x, y, and what is held.
        order = np.r_[np.repeat([1, 2, 5, 6, 0, 3, 4], n), np.full(node.size, 7)]
        places = np.empty(size, dtype=np.intp)
        places[np.lexsort((order, np.r_[np.tile(at, 7), node]))] = np.arange(size)
        # One list of entries serves all.
        entries = [sparse.coo_array(of) for of in matrices]
        keys = [places[of.col] * size + places[of.row] for of in entries]
        pattern = np.unique(np.concatenate(keys))
        data = np.zeros((len(keys), pattern.size))
        for values, key, of in zip(data, keys, entries, strict=True):
            values[np.searchsorted(pattern, key)] = of.data
        column, row = np.divmod(pattern, size)
        return places, row, column, data


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

    def solve(rows: Rows, adjoint: bool) -> Rows:
        if data.dtype.kind == "f" and np.iscomplexobj(rows):
            return solve(rows.real, adjoint) + 1j * solve(rows.imag, adjoint)
        right = np.ascontiguousarray(rows, dtype=data.dtype)
        solution: Rows = factors.solve(right, trans="H" if adjoint else "N")
        return solution

    return solve
