# SPDX-License-Identifier: MIT
"""Small motions of a scene about a configuration at rest.

The chain's own operators, in the angles of the segments, are compiled. To these come the inertia of
custom modules, the derivatives of their forces, and what forces at rest, those of guides and pins
among them, change by as the segments turn. Guides and pins hold B dtheta = 0, which an orthonormal
basis Z of all other directions meets.

In elastic coordinates zeta the angles of the joints are phi = scale * Z zeta, and the elastic
stiffness is the identity. Springs enter in phi, where stiff ones hide no others.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Operators
from pipedyn.models.chain import elastic_scale
from pipedyn.models.drive import ROWS
from pipedyn.models.pencil import real_columns
from pipedyn.modular.redundant import RedundantForm
from pipedyn.util.check import Array


class SmallMotions:
    """Operators about a configuration, and what they stand on.

    Args:
        form: the scene in redundant coordinates.
        theta: angles of the segments that meet guides and pins, shape (n,).

    Attributes:
        basis: orthonormal, of the angles of the segments by the degrees of freedom, (n, dof).
        elastic: the same of the chain's elastic coordinates.
    """

    def __init__(self, form: RedundantForm, theta: Array) -> None:
        self.form, self.layout, self.theta = form, form.layout, theta
        self.still = form.core.from_angles(theta, np.zeros_like(theta))
        self.scale = elastic_scale(form.joints[: theta.size, 0])[:, None]
        self.held = self.layout.unit_loads[:, self.layout.independent]
        self.basis = _core.Complement(self.layout.moments(theta, self.held))
        self.rows = self._elastic_loads(self.held)
        self.elastic = _core.Complement(self.rows)
        self.dof = theta.size - self.held.shape[1]

    def _elastic_loads(self, forces: Array) -> Array:
        """Loads on the joints in units of the elastic coordinates, of forces (3 n, r)."""
        moments = self.layout.moments(self.theta, forces)
        return self.scale * np.cumsum(moments[::-1], axis=0)[::-1]

    def unbalanced(self, u: float) -> Array:
        """Force at rest that nothing balances, shape (dof, 1); 0 at an equilibrium."""
        return self.elastic.gathered(self._elastic_loads(self.form.forces(self.still, u)[:, None]))

    def joint_angles(self, zeta: NDArray[Any]) -> NDArray[Any]:
        """Phi, shape (n, r), of elastic coordinates."""
        result: NDArray[Any] = self.scale * real_columns(self.elastic.spread, zeta)
        return result

    def operators(self) -> Operators:
        """In the degrees of freedom of `basis`."""
        return self._operators(np.diff(self.basis.spread(np.eye(self.dof)), axis=0, prepend=0.0))

    def elastic_operators(self) -> Operators:
        """In elastic coordinates."""
        return self._operators(self.joint_angles(np.eye(self.dof)))

    def _operators(self, joints: Array) -> Operators:
        """In coordinates by which the angles of the joints are `joints`, shape (n, dof)."""
        form, layout, theta, n = self.form, self.layout, self.theta, self.theta.size
        chain, angles = form.unsprung.operators(theta), np.cumsum(joints, axis=0)

        sizes = np.linalg.norm(angles, axis=0)

        def of_angles(matrix: Array) -> Array:
            made = angles.T @ matrix @ angles
            # What rounding leaves of a part that constraints take away whole, as of a damper at a
            # guide, is none of it, nor is it where the matrix is symmetric or skew.
            lost = 4.0 * np.finfo(float).eps * np.abs(matrix).max() * np.outer(sizes, sizes)
            parts = 0.5 * (made + made.T), 0.5 * (made - made.T)
            symmetric, skew = (np.where(np.abs(part) <= lost, 0.0, part) for part in parts)
            return symmetric + skew

        def of_joints(values: Array) -> Array:
            every = np.vstack([joints, -angles[-1:]])[: values.size]
            return every.T @ (values[:, None] * every)

        compliance = form.core.compliance
        inert = compliance != 0.0
        rows = layout.moments(theta, form.core.weights[inert].T)
        # Forces that stay change their moments as the segments turn.
        reaction, by_thrust, by_push = self._reactions()
        own = form.customs.force(*np.split(self.still, 2))
        by_state = form.moments_by_state(theta, np.zeros(n), own + reaction)
        turned, pushed = layout.moments(theta + 0.5 * math.pi, np.stack([by_thrust, by_push], 1)).T
        return Operators(
            mass=of_angles(chain.mass + (rows / compliance[inert]) @ rows.T),
            gyroscopic=of_angles(chain.gyroscopic),
            end_flux=of_angles(chain.end_flux),
            damping=of_angles(chain.damping - by_state[:, n:]) + of_joints(form.joints[:, 1]),
            stiffness=of_angles(chain.stiffness - by_state[:, :n]) + of_joints(form.joints[:, 0]),
            flux=layout.has_flow * of_angles(chain.flux - np.diag(turned)),
            unsteady=of_angles(chain.unsteady - np.diag(pushed)),
            direction=form.pipe.direction,
            centrifugal=form.pipe.alpha,
        )

    def _reactions(self) -> Array:
        """Forces of guides and pins at rest, their derivatives by a u^2 and by s u', (3, 3 n)."""
        force = self.form.forces(self.still, 0.0)
        faster = np.zeros(ROWS)
        faster[0] = self.form.pipe.direction
        push = self.form.forces(self.still, 0.0, faster) - force
        end = 0.0 if self.layout.guided else self.theta[-1]
        thrust, end = np.zeros_like(force), end + self.form.pipe.jet_angle
        thrust[-3:-1] = -np.sin(end), -np.cos(end)
        loads = self._elastic_loads(np.stack([force, thrust, push], axis=1))
        # The rows are independent, so that no singular value is rounding: none is cut off.
        multipliers, *_ = np.linalg.lstsq(self.rows, loads, rcond=0.0)
        return -(self.held @ multipliers).T
