# SPDX-License-Identifier: MIT
"""Small motions of a scene about a configuration at rest.

The chain's own operators, in the angles of the segments, are compiled. Here the inertia of custom
modules and the derivatives of their forces are added, and the change of the moments of the forces
at rest, including those of guides and pins, as the segments turn. Guides and pins enforce
B dtheta = 0; the columns of an orthonormal basis Z span all dtheta that satisfy this.

In elastic coordinates zeta the angles of the joints are phi = scale * Z zeta, and the elastic
stiffness is the identity. Springs are added in phi, so that the rounding of stiff springs does not
hide soft ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Operators, operators_from
from pipedyn.models.chain import elastic_scale
from pipedyn.models.chain_supports import rest_moments
from pipedyn.models.pencil import real_columns
from pipedyn.modular.motion import SceneMotion
from pipedyn.util.check import Array


class SmallMotions:
    """Operators of small motions about a configuration, and the bases that they use.

    Args:
        motion: the equations of motion of the scene.
        theta: angles of the segments, which meet guides and pins, shape (n,).

    Attributes:
        basis: orthonormal basis, (n, dof), of segments' angles that guides and pins allow.
        elastic: orthonormal basis, (n, dof), of the chain's elastic coordinates that they allow.
    """

    def __init__(self, motion: SceneMotion, theta: Array) -> None:
        self.motion, self.layout, self.theta = motion, motion.layout, theta
        chain = motion.core.chain
        self.joints = chain.joints
        self.scale = elastic_scale(self.joints[: theta.size, 0])
        rows = self.layout.independent_rows(theta)
        self.basis = _core.Complement(rows)
        self.elastic = _core.Complement(self._elastic_loads(rows))
        self.dof = theta.size - rows.shape[1]
        self.custom_moments, self.custom_by_state = motion.custom_moments(
            np.append(theta, 0.0 * theta)
        )
        self.moments = rest_moments(chain, theta, self.layout.lengths, motion.pipe)
        self.moments[:, 0] += self.custom_moments

    def _elastic_loads(self, moments: Array) -> Array:
        """Loads on the chain's elastic coordinates, (n, r), from moments on segments, (n, r)."""
        return self.scale[:, None] * np.cumsum(moments[::-1], axis=0)[::-1]

    def unbalanced(self, u: float) -> Array:
        """Unbalanced force at rest, in elastic coordinates, (dof, 1); it is 0 at an equilibrium."""
        moments = self.moments @ [[1.0], [self.motion.pipe.alpha * u**2], [0.0]]
        return self.elastic.gathered(self._elastic_loads(moments))

    def joint_angles(self, zeta: NDArray[Any]) -> NDArray[Any]:
        """Angles of the joints, shape (n, r), for elastic coordinates, shape (dof, r)."""
        result: NDArray[Any] = self.scale[:, None] * real_columns(self.elastic.spread, zeta)
        return result

    def operators(self) -> Operators:
        """Operators in the degrees of freedom of `basis`."""
        return self._operators(np.diff(self.basis.spread(np.eye(self.dof)), axis=0, prepend=0.0))

    def elastic_operators(self) -> Operators:
        """Operators in elastic coordinates."""
        return self._operators(self.joint_angles(np.eye(self.dof)))

    def _operators(self, joints: Array) -> Operators:
        """Operators in coordinates whose unit vectors turn the joints by the columns of `joints`.

        The shape of `joints` is (n, dof).
        """
        motion, n, angles = self.motion, self.theta.size, np.cumsum(joints, axis=0)
        unheld = operators_from(motion.unsprung.operators(self.theta), motion.pipe)
        chain = motion.held.bent(unheld, self.theta, self.moments, self.scale)
        sizes = np.linalg.norm(angles, axis=0)

        def of_angles(matrix: Array) -> Array:
            """A matrix of the segments' angles in the coordinates; rounding errors are set to 0."""
            made = angles.T @ matrix @ angles
            # Constraints may cancel an effect, for example of a damper at a guide. Its rounding
            # error is set to 0, and so is that in the asymmetry of a symmetric or skew matrix.
            lost = 4.0 * np.finfo(float).eps * np.abs(matrix).max() * np.outer(sizes, sizes)
            parts = 0.5 * (made + made.T), 0.5 * (made - made.T)
            symmetric, skew = (np.where(np.abs(part) <= lost, 0.0, part) for part in parts)
            return symmetric + skew

        def of_joints(values: Array) -> Array:
            """A diagonal matrix of the joints' angles in the coordinates."""
            every = np.vstack([joints, -angles[-1:]])[: values.size]
            return every.T @ (values[:, None] * every)

        compliance = motion.core.compliance
        inert = compliance != 0.0
        rows = self.layout.moments(self.theta, motion.core.weights[inert].T)
        by_angles, by_rates = np.hsplit(self.custom_by_state, [n])
        stiffness, damping, _ = self.joints.T
        return Operators(
            mass=of_angles(chain.mass + (rows / compliance[inert]) @ rows.T),
            gyroscopic=of_angles(chain.gyroscopic),
            end_flux=of_angles(chain.end_flux),
            damping=of_angles(chain.damping - by_rates) + of_joints(damping),
            stiffness=of_angles(chain.stiffness - by_angles) + of_joints(stiffness),
            flux=self.layout.has_flow * of_angles(chain.flux),
            unsteady=of_angles(chain.unsteady),
            direction=chain.direction,
            centrifugal=chain.centrifugal,
        )
