# SPDX-License-Identifier: MIT
"""The modular method in redundant coordinates: M q'' = f of the modules, A q'' = b of constraints.

The coordinates are q = (x_j, y_j, phi_j), j = 1 .. n: the position r_j = (x_j, y_j) of node j, x
across and y down from the clamp, and the angle of joint j; r_0 = (0, base). Each module has its
inertia and forces in these coordinates, independently of other modules and of constraints; joint
angles have no inertia. The dense recursions of the method and the operators of small motions use
this form; motions themselves do not need it, see cpp/pipedyn/modular/scene.hpp.

Source: Orsino and Di Giulio, eqs. (2)-(6) and (9)-(11); Orsino (2016).
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.drive import ROWS
from pipedyn.models.pipe import Pipe
from pipedyn.modular.custom import CustomForces
from pipedyn.modular.layout import Layout, coordinates_by_angles, nodes_by_angles
from pipedyn.util.check import Array


class RedundantForm:
    """Inertia, forces and constraints of a scene, at any redundant state.

    Args:
        pipe: the pipe, without effects of modules that the scene does not have.
        layout: the parts of the scene and their places.
        core: the compiled scene.
        customs: custom modules of the scene.
    """

    def __init__(
        self, pipe: Pipe, layout: Layout, core: _core.Scene, customs: CustomForces
    ) -> None:
        self.layout, self.customs = layout, customs
        self.core, self.pipe = core, pipe

    @cached_property
    def unsprung(self) -> _core.Chain:
        """The compiled chain without springs and dampers at its joints, for linear operators."""
        return self.layout.compiled(self.pipe, sprung=False).chain

    @cached_property
    def joints(self) -> Array:
        """Stiffness, damping, rest moment of each joint, a root's spring in series, (joints, 3)."""
        return self.core.chain.joints

    # ------------------------------------------------------------------------------------- modules

    def mass(self, q: Array) -> Array:
        """Mass matrix M, shape (3 n, 3 n), at coordinates q, shape (3 n,).

        A segment, with the masses on it, has the kinetic energy m (|r*'|^2 + (eta / l)^2 |r_j' -
        r_{j-1}'|^2) / 2, where r* = (1 - chi) r_{j-1} + chi r_j. Mass m_n that moves only across
        the segment has m_n (a^2 + a b + b^2) / 6, where a = n . r_{j-1}', b = n . r_j'.
        """
        *_, across = self.core.bodies().T
        if not across.any():
            return self._plain_mass
        normals = _across(np.diff(self.layout.nodes(q), axis=0)) / self.layout.lengths[:, None]
        own = np.einsum("j,ja,jb->jab", across / 6.0, normals, normals)
        nodes = np.zeros((across.size + 1, 3, across.size + 1, 3))
        j = np.arange(across.size)
        for k, i, factor in ((j, j, 2.0), (j, j + 1, 1.0), (j + 1, j, 1.0), (j + 1, j + 1, 2.0)):
            nodes[k, :2, i, :2] += factor * own
        size = 3 * across.size
        return self._plain_mass + nodes[1:, :, 1:, :].reshape(size, size)

    @cached_property
    def _plain_mass(self) -> Array:
        """Mass matrix without the mass that moves only across segments."""
        mass, chi, eta, _ = self.core.bodies().T
        turning = (eta / self.layout.lengths) ** 2
        own = mass * (chi**2 + turning)
        own[:-1] += (mass * ((1.0 - chi) ** 2 + turning))[1:]
        between = (mass * (chi * (1.0 - chi) - turning))[1:]
        coupled = np.diag(np.kron(between, [1.0, 1.0, 0.0]), 3)
        nodes = np.diag(np.kron(own, [1.0, 1.0, 0.0])) + coupled + coupled.T
        return nodes + self.layout.inertia.T @ self.layout.inertia

    def forces(self, y: Array, u: float, drive: Array | None = None) -> Array:
        """Forces of all modules at a state [q, q'], shape (3 n,).

        The flow exerts, for each segment, -sqrt(beta) U r_j' on node j - 1 and sqrt(beta) U
        r_{j-1}' on node j, -sqrt(beta) U' l t in the middle of the segment, and on the free end
        -share sqrt(beta) U r_n' - a U^2 (cos jet_angle t + sin jet_angle n), n = (t_y, -t_x).
        Segments have their weights, less the mass times the acceleration of the base. Joints have
        -k (phi - psi) - c phi', where psi is the rest angle. Drag is -kappa l |v| v n at a
        segment's drag point, v = n . r'. Terms and custom modules add theirs. The forcing `drive`,
        (ROWS,), see `pipedyn.models.drive`, has U' and the motion of the base, on which inflow,
        drag and terms depend.
        """
        rate, *moves = np.zeros(ROWS) if drive is None else drive
        place, speed, acceleration = np.reshape(moves, (3, 2))
        layout, pipe, lengths = self.layout, self.pipe, self.layout.lengths
        q, rates = np.split(y, 2)
        along, velocities = np.diff(layout.nodes(q), axis=0), layout.nodes(rates, order=1)
        on_nodes = np.zeros_like(velocities)

        def add(share: Array, loads: Array, segment: NDArray[np.intp]) -> None:
            """Adds loads at shares of segments' lengths to the nodes at both ends."""
            np.add.at(on_nodes, segment, (1.0 - share)[:, None] * loads)
            np.add.at(on_nodes, segment + 1, share[:, None] * loads)

        every = np.arange(layout.size)
        mass, chi, _, across_alone = self.core.bodies().T
        add(chi, np.outer(mass, [0.0, pipe.gamma] - acceleration), every)
        add(np.full(layout.size, 0.5), -math.sqrt(pipe.beta) * pipe.direction * rate * along, every)
        point, normal = layout.drag_points, _across(along) / lengths[:, None]
        v = np.sum(normal * (_between(velocities, point, every) + speed), axis=1)
        add(point, normal * (-pipe.drag * lengths * np.abs(v) * v)[:, None], every)
        add(
            np.full(layout.size, 0.5),
            normal * (-across_alone * (normal @ acceleration))[:, None],
            every,
        )
        share, loads, segment = self._terms(q, rates, place, speed)
        add(share, loads[:, :2], segment)
        turning = (normal / lengths[:, None])[segment] * loads[:, 2:]
        np.add.at(on_nodes, segment, -turning)  # a couple acts as two opposite forces on the nodes
        np.add.at(on_nodes, segment + 1, turning)
        momentum = math.sqrt(pipe.beta) * pipe.direction * u * velocities
        on_nodes[:-1] -= momentum[1:]
        on_nodes[1:] += momentum[:-1]
        on_nodes[-1] -= pipe.inflow_share * momentum[-1]
        lacking = (1.0 - pipe.inflow_share) * math.sqrt(pipe.beta) * pipe.direction * u
        on_nodes[-1] += lacking * speed
        end = np.array([0.0, 1.0]) if layout.guided else along[-1] / lengths[-1]
        jet = math.cos(pipe.jet_angle) * end + math.sin(pipe.jet_angle) * _across(end[None])[0]
        on_nodes[-1] -= pipe.alpha * u**2 * jet

        total = self.customs.force(q, rates)
        total[0::3] += on_nodes[1:, 0]
        total[1::3] += on_nodes[1:, 1]
        n = layout.size
        spring, damping, rest = self.joints.T
        total[2::3] += rest[:n] - spring[:n] * q[2::3] - damping[:n] * rates[2::3]
        if layout.guided:  # acts on the last segment's angle, the sum of the joints'
            total[2::3] -= spring[n] * q[2::3].sum() + damping[n] * rates[2::3].sum()
        return total

    def moments_by_state(self, theta: Array, omega: Array, force: Array) -> Array:
        """Derivative by [theta, theta'] of the moments of a force on the segments, shape (n, 2 n).

        The force, shape (3 n,), is the sum of those of the custom modules and of constant loads.
        """
        n, layout = theta.size, self.layout
        change = np.zeros((n, 2 * n))
        if self.customs:
            q, rates = np.split(self.core.from_angles(theta, omega), 2)
            by_q, by_rate = self.customs.derivatives(q, rates)
            turning = coordinates_by_angles(layout.lengths, theta)
            swinging = nodes_by_angles(layout.lengths * omega, theta + 0.5 * math.pi)
            change = layout.moments(
                theta, np.hstack([by_q @ turning + by_rate @ swinging, by_rate @ turning])
            )
        on_nodes = force[:, None].copy()
        on_nodes[2::3] = 0.0
        change[:, :n] += np.diag(layout.moments(theta + 0.5 * math.pi, on_nodes)[:, 0])
        return change

    def _terms(
        self, q: Array, rates: Array, base: Array, speed: Array
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """Share of the segment's length, load and segment at each of the k places of terms.

        Loads, shape (k, 3), are two forces and a couple. `base` and `speed` are position and
        velocity of the base, shape (2,) each.
        """
        place, arm, weight = self.core.chain.places().T
        j = place.astype(np.intp)
        share = arm / self.layout.lengths[j]
        nodes, velocities = self.layout.nodes(q), self.layout.nodes(rates, order=1)
        along = nodes[j + 1] - nodes[j]
        length = np.hypot(*along.T)[:, None]
        turning = velocities[j + 1] - velocities[j]
        rate = np.sum(_across(along) / length**2 * turning, axis=1)
        where, moving = _between(nodes, share, j), _between(velocities, share, j)
        angle = np.cumsum(q[2::3])[j]
        stations = np.column_stack([where + base, angle, along / length, moving + speed, rate])
        return share, weight[:, None] * self.core.chain.loads(stations), j

    # --------------------------------------------------------------------------------- constraints

    def constraints(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Residuals g(q), their rates A q' and b = A q'' of all constraints, shape (2 n + c,) each.

        Each joint, from the clamp on, has two rows, and each coordinate that guides and pins hold
        has one after these. With a = r_j - r_{j-1} and d = (r_{j-1} - r_{j-2}) / l_{j-1}, or (0, 1)
        at the clamp, a joint has g = (a . d - l_j cos phi_j, a x d - l_j sin phi_j). For rates
        (3 n, k) the last two results have k columns; A q' is A itself if the rates are the
        identity.
        """
        layout, columns = self.layout, rates.reshape(rates.shape[0], -1)
        (a, d), (a_rate, d_rate) = self._directions(q[:, None], 0), self._directions(columns, 1)
        # For vectors written x + i y, conj(a) d = a . d + i a x d.
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
        """Vectors a and d of each joint as x + i y, shape (n, k), or their rates (order 1)."""
        x, y = np.moveaxis(self.layout.nodes(columns, order), 1, 0)
        a = np.diff(x + 1j * y, axis=0)
        d = a / self.layout.lengths[:, None]
        return a, np.concatenate([np.full_like(d[:1], 1j * (1.0 - order)), d[:-1]])


def _between(values: Array, share: Array, segment: NDArray[np.intp]) -> Array:
    """Values at shares of segments' lengths from the clamped side, interpolated from nodes."""
    before = values[segment]
    return before + share[:, None] * (values[segment + 1] - before)


def _across(along: Array) -> Array:
    """Vectors l n = (l t_y, -l t_x) normal to vectors l t, each a row."""
    return along[:, ::-1] * [1.0, -1.0]


def _listed(of_joints: NDArray[Any], held: Array) -> Array:
    """Real and imaginary rows of each joint, from (n, k), followed by rows of held coordinates."""
    joints = np.stack([of_joints.real, of_joints.imag], axis=1).reshape(-1, held.shape[1])
    return np.concatenate([joints, held])
