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
from pipedyn.models.modular.linearisation import matrix
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
        self.core, self._pipe = core, pipe

    # ------------------------------------------------------------------------------------- modules

    @cached_property
    def mass(self) -> Any:
        """M, sparse, (3 n, 3 n).

        A segment has the kinetic energy m (|r*'|^2 + (eta / l)^2 |r_j' - r_{j-1}'|^2) / 2, with the
        masses on it, r* = (1 - chi) r_{j-1} + chi r_j.
        """
        mass, chi, eta = self.core.bodies().T
        turning = (eta / self.layout.lengths) ** 2
        own = mass * (chi**2 + turning)
        own[:-1] += (mass * ((1.0 - chi) ** 2 + turning))[1:]
        between = (mass * (chi * (1.0 - chi) - turning))[1:]
        nodes = in_nodes(own, between, between)
        if not self.customs:
            return nodes
        rows = sparse.csr_array(self.layout.inertia)
        return nodes + rows.T @ rows

    @cached_property
    def velocity(self) -> Any:
        """Derivative of minus the flow's forces by the rates, for U = 1, sparse, (3 n, 3 n).

        They are -sqrt(beta) U r_j' on r_{j-1} and sqrt(beta) U r_{j-1}' on r_j for each segment,
        and -sqrt(beta) U r_n' on the end.
        """
        coriolis = np.full(self.layout.size, math.sqrt(self._pipe.beta))
        end = np.append(np.zeros(self.layout.size - 1), coriolis[-1])
        return in_nodes(end, coriolis[1:], -coriolis[1:])

    @cached_property
    def flux(self) -> Any:
        """The same by the coordinates, for a U^2 = 1, of -a U^2 (r_n - r_{n-1}) / l_n."""
        end = np.zeros(self.layout.size)
        end[-1] = self.layout.has_flow / self.layout.lengths[-1]
        return in_nodes(end, 0.0 * end[1:], -end[1:])

    def forces(self, y: Array, u: float) -> Array:
        """Forces of all modules at a state [q, q'], shape (3 n,).

        Besides the flow's: weights; -k (phi - psi) - c phi' of joints, psi the rest angle;
        -kappa l |v| v n at a segment's drag point, v = n . r', n = (t_y, -t_x); those of terms and
        custom modules.
        """
        layout, pipe, lengths = self.layout, self._pipe, self.layout.lengths
        q, rates = np.split(y, 2)
        along, velocities = np.diff(layout.nodes(q), axis=0), layout.nodes(rates, order=1)
        on_nodes = np.zeros_like(velocities)

        def add(share: Array, loads: Array, segment: NDArray[np.intp]) -> None:
            np.add.at(on_nodes, segment, (1.0 - share)[:, None] * loads)
            np.add.at(on_nodes, segment + 1, share[:, None] * loads)

        every = np.arange(layout.size)
        mass, chi, _ = self.core.bodies().T
        add(chi, np.outer(mass, [0.0, pipe.gamma]), every)
        point, normal = layout.drag_points, _across(along) / lengths[:, None]
        v = np.sum(normal * _between(velocities, point, every), axis=1)
        add(point, normal * (-pipe.drag * lengths * np.abs(v) * v)[:, None], every)
        segment, share, _, answers = self._terms(q, rates)
        add(share, answers[:, :2], segment)
        on_nodes[-1] -= pipe.centrifugal * u**2 * along[-1] / lengths[-1]

        total: Array = self.customs.force(q, rates) - pipe.direction * u * (self.velocity @ rates)
        total[0::3] += on_nodes[1:, 0]
        total[1::3] += on_nodes[1:, 1]
        total[2::3] += layout.rest_moments - layout.springs * q[2::3]
        total[2::3] -= layout.joint_damping(pipe) * rates[2::3]
        return total

    def resistances(self, q: Array) -> tuple[Any, Any]:
        """Derivatives of minus the forces at rest by q and q', without springs and flow, sparse."""
        still = np.zeros_like(q)
        by_q, by_rate = self.customs.derivatives(q, still)
        segment, share, turning, answers = self._terms(q, still)
        if segment.size:
            # By x and y of the nodes at both ends of the segment, of which node 0 stays.
            coordinates = 3 * segment[:, None] + np.array([-3, -2, 0, 1], dtype=np.intp)
            shares = np.stack([1.0 - share, share], axis=1)
            at = np.einsum("kn,ij->kinj", shares, np.eye(2)).reshape(-1, 2, 4)
            position, velocity = (answers[:, i : i + 4].reshape(-1, 2, 2) for i in (2, 6))
            turns = np.stack([-turning, turning], axis=1).reshape(-1, 1, 4)
            by_place = position @ at + answers[:, 10:, None] * turns
            by_q = by_q + self._placed(coordinates, at.transpose(0, 2, 1) @ by_place)
            by_rate = by_rate + self._placed(coordinates, at.transpose(0, 2, 1) @ velocity @ at)
        joints = np.kron(self.layout.joint_damping(self._pipe), [0.0, 0.0, 1.0])
        return -by_q, sparse.diags_array(joints) - by_rate

    def _terms(self, q: Array, rates: Array) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """Of the places where terms act: segment, share of its length, and turning.

        Turning is the derivative of the segment's angle by the difference of its ends, shape (k,
        2). Fourth, the answers of the laws as of the core's `loads`, times the weights.
        """
        place, arm, weight = self.core.places().T
        j = place.astype(np.intp)
        share = arm / self.layout.lengths[j]
        nodes, velocities = self.layout.nodes(q), self.layout.nodes(rates, order=1)
        along = nodes[j + 1] - nodes[j]
        length = np.hypot(*along.T)[:, None]
        turning = _across(along) / length**2
        rate = np.sum(turning * (velocities[j + 1] - velocities[j]), axis=1)
        where, moving = _between(nodes, share, j), _between(velocities, share, j)
        answers = self.core.loads(np.column_stack([where, along / length, moving, rate]))
        return j, share, turning, weight[:, None] * answers

    def _placed(self, coordinates: NDArray[np.intp], blocks: Array) -> Any:
        """A sparse matrix (3 n, 3 n) of blocks (k, m, m) at coordinates (k, m), none below 0."""
        rows, columns = np.broadcast_arrays(coordinates[:, :, None], coordinates[:, None, :])
        kept = (rows >= 0) & (columns >= 0)
        size = self.core.coordinates
        return matrix((rows[kept], columns[kept], blocks[kept]), size, size)

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
        # Of vectors x + i y, conj(a) d = a . d + i a x d.
        bend = layout.lengths[:, None] * np.exp(1j * q[2::3, None])
        turning = columns[2::3]
        residual = _listed(np.conj(a) * d - bend, (q[layout.held] - layout.held_values)[:, None])
        drift = _listed(
            np.conj(a_rate) * d + np.conj(a) * d_rate - 1j * bend * turning, columns[layout.held]
        )
        wanted = _listed(
            -2.0 * np.conj(a_rate) * d_rate - bend * turning**2,
            np.zeros((layout.held.size, columns.shape[1])),
        )
        shape = (-1, *rates.shape[1:])
        return residual[:, 0], drift.reshape(shape), wanted.reshape(shape)

    def _directions(self, columns: Array, order: int) -> tuple[NDArray[Any], NDArray[Any]]:
        """The vectors a and d of each joint, x + i y, shape (n, k), or their rates (order 1)."""
        x, y = np.moveaxis(self.layout.nodes(columns, order), 1, 0)
        a = np.diff(x + 1j * y, axis=0)
        d = a / self.layout.lengths[:, None]
        return a, np.concatenate([np.full_like(d[:1], 1j * (1.0 - order)), d[:-1]])


def in_nodes(own: Array, after: Array, before: Array) -> Any:
    """A sparse matrix (3 n, 3 n) for x and y of nodes alike, by a node itself and its neighbours.

    Of shape (n,), and (n - 1,) by the node after and the one before.
    """
    diagonals = [np.kron(of, [1.0, 1.0, 0.0]) for of in (own, after, before)]
    return sparse.diags_array(diagonals, offsets=[0, 3, -3]).tocsr()


def _between(values: Array, share: Array, segment: NDArray[np.intp]) -> Array:
    """Values on segments, a share of their length from the clamped side, of those at nodes."""
    before = values[segment]
    between: Array = before + share[:, None] * (values[segment + 1] - before)
    return between


def _across(along: Array) -> Array:
    """Vectors l n = (l t_y, -l t_x) of l t, each a row."""
    across: Array = along[:, ::-1] * [1.0, -1.0]
    return across


def _listed(of_joints: NDArray[Any], held: Array) -> Array:
    """Two rows of each joint, real and imaginary part of (n, k), then those of what is held."""
    joints = np.stack([of_joints.real, of_joints.imag], axis=1).reshape(-1, held.shape[1])
    return np.concatenate([joints, held])
