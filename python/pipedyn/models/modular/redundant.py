# SPDX-License-Identifier: MIT
"""The modular method in redundant coordinates: M q'' = f of the modules, A q'' = b of constraints.

q = (x_j, y_j, phi_j), j = 1 .. n: node j at r_j = (x_j, y_j), x across and y down from the clamp,
and the angle of joint j; r_0 = (0, base). Each module writes its inertia and forces in these and
knows of no other and of no constraint; joint angles have no inertia. The dense recursions of the
method and the operators of small motions take this form; motions themselves do not need it, see
cpp/pipedyn/modular/scene.hpp.

Source: Orsino and Di Giulio, eqs. (2)-(6) and (9)-(11); Orsino (2016).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipedyn import _core
from pipedyn.models.modular.custom import CustomForces
from pipedyn.models.modular.layout import Layout
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array


class RedundantForm:
    """Inertia, forces and constraints of a scene, at any redundant state.

    Args:
        pipe: the pipe, without the effects that no module brings.
        layout: where the parts are.
        core: the compiled scene.
        customs: modules of the user's own.
    """

    def __init__(
        self, pipe: Pipe, layout: Layout, core: _core.Scene, customs: CustomForces
    ) -> None:
        self.layout, self.customs = layout, customs
        self._core, self._pipe = core, pipe
        self._here = sparse.eye_array(layout.size, format="csr")
        self._before = sparse.eye_array(layout.size, k=-1, format="csr")
        """Nodes at the ends of each segment, (n, n): of values at nodes those at its own and those
        at the one before; node 0 is left out."""

    def _between(self, share: Array, segment: NDArray[np.intp] | slice = slice(None)) -> Any:
        """Values on segments, a share of their length from the clamped side, by those at nodes."""
        before = sparse.diags_array(1.0 - share) @ self._before[segment]
        return before + sparse.diags_array(share) @ self._here[segment]

    @property
    def _last(self) -> Any:
        return self._here[-1:]

    # ------------------------------------------------------------------------------------- modules

    @cached_property
    def mass(self) -> Any:
        """M, sparse, (3 n, 3 n).

        A segment has the kinetic energy m (|r*'|^2 + (eta / l)^2 |r_j' - r_{j-1}'|^2) / 2, with the
        masses on it, r* = (1 - chi) r_{j-1} + chi r_j.
        """
        mass, chi, eta = self._core.bodies().T
        center, step = self._between(chi), self._here - self._before
        turning = sparse.diags_array(mass * (eta / self.layout.lengths) ** 2)
        nodes = center.T @ sparse.diags_array(mass) @ center + step.T @ turning @ step
        row, coordinate, weight = self.layout.inertia.T
        rows = sparse.coo_array(
            (weight, (row.astype(int), coordinate.astype(int))),
            shape=(row.size, 3 * self.layout.size),
        )
        return in_nodes(nodes) + rows.T @ rows

    @cached_property
    def velocity(self) -> Any:
        """Derivative of minus the flow's forces by the rates, for U = 1, sparse, (3 n, 3 n).

        They are -sqrt(beta) U r_j' on r_{j-1} and sqrt(beta) U r_{j-1}' on r_j for each segment,
        and -sqrt(beta) U r_n' on the end.
        """
        nodes = self._before.T @ self._here - self._here.T @ self._before
        return math.sqrt(self._pipe.beta) * in_nodes(nodes + self._last.T @ self._last)

    @cached_property
    def flux(self) -> Any:
        """The same by the coordinates, for a U^2 = 1, of -a U^2 (r_n - r_{n-1}) / l_n."""
        tangent = (self._last - self._before[-1:]) / self.layout.lengths[-1]
        return in_nodes(self._last.T @ tangent) * self.layout.has_flow

    def forces(self, y: Array, u: float) -> Array:
        """Forces of all modules at a state [q, q'], shape (3 n,).

        Besides the flow's: weights; -k (phi - psi) - c phi' of joints, psi the rest angle;
        -kappa l |v| v n at a segment's drag point, v = n . r', n = (t_y, -t_x); those of terms and
        custom modules.
        """
        layout, pipe, lengths = self.layout, self._pipe, self.layout.lengths
        q, rates = np.split(y, 2)
        along, velocities = np.diff(layout.nodes(q), axis=0), rates.reshape(-1, 3)[:, :2]

        mass, chi, _ = self._core.bodies().T
        on_nodes = self._between(chi).T @ np.outer(mass, [0.0, pipe.gamma])
        point = self._between(layout.drag_points)
        normal = _across(along) / lengths[:, None]
        v = np.sum(normal * (point @ velocities), axis=1)
        on_nodes -= point.T @ (normal * (pipe.drag * lengths * np.abs(v) * v)[:, None])
        place, _, answers = self._terms(q, rates)
        on_nodes += place.T @ answers[:, :2]
        on_nodes[-1] -= pipe.centrifugal * u**2 * along[-1] / lengths[-1]

        total: Array = self.customs.force(q, rates) - pipe.direction * u * (self.velocity @ rates)
        total[0::3] += on_nodes[:, 0]
        total[1::3] += on_nodes[:, 1]
        total[2::3] += layout.rest_moments - layout.springs * q[2::3]
        total[2::3] -= layout.joint_damping(pipe) * rates[2::3]
        return total

    def resistances(self, q: Array) -> tuple[Any, Any]:
        """Derivatives of minus the forces at rest by q and q', without springs and flow, sparse."""
        by_q, by_rate = self.customs.derivatives(q, np.zeros_like(q))
        joints = np.kron(self.layout.joint_damping(self._pipe), [0.0, 0.0, 1.0])
        by_rate = by_rate - sparse.diags_array(joints)
        place, turning, answers = self._terms(q, np.zeros_like(q))
        if answers.size:
            at = sparse.kron(place, np.eye(2, 3), format="csr")
            by_position, by_velocity, by_angle = (
                _blocks(answers[:, i:k]) for i, k in ((2, 6), (6, 10), (10, 12))
            )
            by_q = by_q + at.T @ (by_position @ at + by_angle @ turning)
            by_rate = by_rate + at.T @ by_velocity @ at
        return -by_q, -by_rate

    def _terms(self, q: Array, rates: Array) -> tuple[Any, Any, Array]:
        """Where the terms act: values there by those at nodes, and theta of the segment by q.

        Third, the answers of the laws as of the core's `loads`, times the weights.
        """
        segment, arm, weight = self._core.places().T
        j = segment.astype(np.intp)
        share, nodes = arm / self.layout.lengths[j], self.layout.nodes(q)
        place, step = self._between(share, j), (self._here - self._before)[j]
        along = nodes[j + 1] - nodes[j]
        length = np.hypot(*along.T)
        by_x, by_y = _across(along).T / length**2
        turning = sparse.diags_array(by_x) @ sparse.kron(step, [[1.0, 0.0, 0.0]])
        turning = turning + sparse.diags_array(by_y) @ sparse.kron(step, [[0.0, 1.0, 0.0]])
        velocities = place @ rates.reshape(-1, 3)[:, :2]
        stations = [nodes[j] + share[:, None] * along, along / length[:, None], velocities]
        answers = self._core.loads(np.column_stack([*stations, turning @ rates]))
        return place, turning, weight[:, None] * answers

    # --------------------------------------------------------------------------------- constraints

    def constraints(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Residuals g(q), their rates A q' and b = A q'' of all constraints, shape (2 n + c,) each.

        Two rows a joint, from the clamp on, then one for each coordinate that guides and pins hold.
        With a = r_j - r_{j-1} and d = (r_{j-1} - r_{j-2}) / l_{j-1}, or (0, 1) at the clamp, a
        joint has g = (a . d - l_j cos phi_j, a x d - l_j sin phi_j). For rates (3 n, k) the last
        two have k columns: A q' is A where these are the identity.
        """
        layout, columns = self.layout, rates.reshape(rates.shape[0], -1)
        (a, d), (a_rate, d_rate) = self._directions(q[:, None], 0), self._directions(columns, 1)
        phi, turning = q[2::3, None], columns[2::3]
        sine, cosine = (layout.lengths[:, None] * of for of in (np.sin(phi), np.cos(phi)))
        residual = _listed(
            *(_dot(a, d) - cosine, _cross(a, d) - sine),
            (q[layout.held] - layout.held_values)[:, None],
        )
        drift = _listed(
            _dot(a_rate, d) + _dot(a, d_rate) + sine * turning,
            _cross(a_rate, d) + _cross(a, d_rate) - cosine * turning,
            columns[layout.held],
        )
        wanted = _listed(
            -2.0 * _dot(a_rate, d_rate) - cosine * turning**2,
            -2.0 * _cross(a_rate, d_rate) - sine * turning**2,
            np.zeros((layout.held.size, columns.shape[1])),
        )
        shape = (-1, *rates.shape[1:])
        return residual[:, 0], drift.reshape(shape), wanted.reshape(shape)

    def _directions(self, columns: Array, order: int) -> tuple[Array, Array]:
        """The vectors a and d of each joint, shape (n, 2, k), or their rates (order 1)."""
        a = np.diff(self.layout.nodes(columns, order), axis=0)
        d = np.zeros_like(a)
        d[0, 1] = 1.0 - order
        d[1:] = a[:-1] / self.layout.lengths[:-1, None, None]
        return a, d


def in_nodes(matrix: Any) -> Any:
    """A sparse matrix (n, n) for x and y of the nodes alike, (3 n, 3 n)."""
    return sparse.kron(matrix, np.diag([1.0, 1.0, 0.0]), format="csr")


def _blocks(rows: Array) -> Any:
    """A sparse matrix with the matrices (2, k) of each row on its diagonal."""
    count = rows.shape[0]
    blocks = rows.reshape(count, 2, -1)
    return sparse.bsr_array((blocks, np.arange(count), np.arange(count + 1)))


def _across(along: Array) -> Array:
    """Vectors l n = (l t_y, -l t_x) of l t, each a row."""
    across: Array = along[:, ::-1] * [1.0, -1.0]
    return across


def _dot(a: Array, d: Array) -> Array:
    product: Array = a[:, 0] * d[:, 0] + a[:, 1] * d[:, 1]
    return product


def _cross(a: Array, d: Array) -> Array:
    product: Array = a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]
    return product


def _listed(first: Array, second: Array, held: Array) -> Array:
    """Rows of joints, (n, k) each, one after the other, then those of what is held."""
    joints = np.stack([first, second], axis=1).reshape(2 * first.shape[0], -1)
    return np.concatenate([joints, held])
