# SPDX-License-Identifier: MIT
"""Small motions of a scene about a configuration at rest.

The chain's own operators, in the angles of the segments, are compiled. Added are the inertia of
custom modules, the derivatives of their forces, and the change of moments by forces at rest, those
of guides and pins among them, as the segments turn. Guides and pins enforce B dtheta = 0, which an
orthonormal basis Z of all other directions satisfies.

In elastic coordinates zeta the angles of the joints are phi = scale * Z zeta, and the elastic
stiffness is the identity. Springs enter in phi, in which stiff springs do not hide soft ones.
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
    """Operators of small motions about a configuration, and the bases that they use.

    Args:
        form: the scene in redundant coordinates.
        theta: angles of the segments, which meet guides and pins, shape (n,).

    Attributes:
        basis: orthonormal basis, (n, dof), of segments' angles that guides and pins allow.
        elastic: orthonormal basis, (n, dof), of the chain's elastic coordinates that they allow.
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
        """Loads on the chain's elastic coordinates, (n, r), by forces of shape (3 n, r)."""
        moments = self.layout.moments(self.theta, forces)
        return self.scale * np.cumsum(moments[::-1], axis=0)[::-1]

    def unbalanced(self, u: float) -> Array:
        """Unbalanced force at rest in elastic coordinates, shape (dof, 1); 0 at an equilibrium."""
        return self.elastic.gathered(self._elastic_loads(self.form.forces(self.still, u)[:, None]))

    def joint_angles(self, zeta: NDArray[Any]) -> NDArray[Any]:
        """Angles of the joints, shape (n, r), of elastic coordinates, shape (dof, r)."""
        result: NDArray[Any] = self.scale * real_columns(self.elastic.spread, zeta)
        return result

    def operators(self) -> Operators:
        """Operators in the degrees of freedom of `basis`."""
        return self._operators(np.diff(self.basis.spread(np.eye(self.dof)), axis=0, prepend=0.0))

    def elastic_operators(self) -> Operators:
        """Operators in elastic coordinates."""
        return self._operators(self.joint_angles(np.eye(self.dof)))

    def _operators(self, joints: Array) -> Operators:
        """Operators in coordinates whose unit vectors turn joints by columns of (n, dof)."""
        form, layout, theta, n = self.form, self.layout, self.theta, self.theta.size
        chain, angles = form.unsprung.operators(theta), np.cumsum(joints, axis=0)

        sizes = np.linalg.norm(angles, axis=0)

        def of_angles(matrix: Array) -> Array:
            """A matrix of the segments' angles in the coordinates, without what is rounding."""
            made = angles.T @ matrix @ angles
            # Constraints may take away a part wholly, such as a damper at a guide. What rounding
            # leaves of it is removed, and so is any asymmetry of a symmetric or skew matrix.
            lost = 4.0 * np.finfo(float).eps * np.abs(matrix).max() * np.outer(sizes, sizes)
            parts = 0.5 * (made + made.T), 0.5 * (made - made.T)
            symmetric, skew = (np.where(np.abs(part) <= lost, 0.0, part) for part in parts)
            return symmetric + skew

        def of_joints(values: Array) -> Array:
            """A diagonal matrix of the joints in the coordinates."""
            every = np.vstack([joints, -angles[-1:]])[: values.size]
            return every.T @ (values[:, None] * every)

        compliance = form.core.compliance
        inert = compliance != 0.0
        rows = layout.moments(theta, form.core.weights[inert].T)
        # Moments of forces that keep their direction change as the segments turn.
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
        """Forces of guides and pins at rest, and derivatives by a u^2 and by s u': (3, 3 n)."""
        force = self.form.forces(self.still, 0.0)
        faster = np.zeros(ROWS)
        faster[0] = self.form.pipe.direction
        push = self.form.forces(self.still, 0.0, faster) - force
        end = 0.0 if self.layout.guided else self.theta[-1]
        thrust, end = np.zeros_like(force), end + self.form.pipe.jet_angle
        thrust[-3:-1] = -np.sin(end), -np.cos(end)
        loads = self._elastic_loads(np.stack([force, thrust, push], axis=1))
        # The rows are independent, so that no singular value is rounding and none is cut off.
        multipliers, *_ = np.linalg.lstsq(self.rows, loads, rcond=0.0)
        return -(self.held @ multipliers).T
