# SPDX-License-Identifier: MIT
"""Motion of a scene: rates, energy, power and derivatives, custom modules included.

Integrators advance the angles of the segments. Redundant coordinates that follow from the angles
meet every clamp and joint to rounding, at any time. The distance of a state from guides and pins
decays in its motion, so that an integrator's errors do not grow. The state shown to users is
projected onto guides and pins. All but the functions of custom modules is compiled
(cpp/pipedyn/modular/scene.hpp).
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from pipedyn.models.chain_supports import ChainSupports
from pipedyn.modular.enforcement import Enforce, Group
from pipedyn.modular.layout import coordinates_by_angles, nodes_by_angles
from pipedyn.modular.redundant import RedundantForm
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.errors import resolved


class SceneMotion:
    """Equations of motion of a scene, in redundant coordinates and in the segments' angles.

    Args:
        form: the scene in redundant coordinates.
        enforce: a dense recursion that finds the accelerations from `form`; None for the core's
            method.
    """

    def __init__(self, form: RedundantForm, enforce: Enforce | None) -> None:
        self.form, self.enforce = form, enforce
        self.core, self.layout, self.customs = form.core, form.layout, form.customs
        self.is_compiled = not form.customs and enforce is None
        self.held = ChainSupports(form.core, form.layout.independent_rows)

    # --------------------------------------------------------------------- redundant coordinates

    def rhs(
        self, t: float, y: Any, u: Any, drive: Array | None = None, refuses: bool = True
    ) -> Array:
        """Rates of redundant states [q, q'], shape (6 n,) or (6 n, k), under forcing `drive`.

        Raises NotResolved, if `refuses`, where they are not finite.
        """
        if self.is_compiled:
            return self.core.redundant_rhs(t, y, u, drive=drive, refuses=refuses)
        if not refuses:
            return self._rates(t, y, u, drive)
        return resolved("rhs", lambda: self._rates(t, y, u, drive), np.ndim(y) == 2)

    def _rates(self, t: float, y: Any, u: Any, drive: Array | None) -> Array:
        """Rates of redundant states of a scene with custom modules or a dense recursion."""
        size = self.core.coordinates
        y = check.doubles("y", y, "an array of real numbers")
        self.core.redundant_power(y, u, drive, refuses=False)  # checks the arguments
        if self.enforce is None:
            moments = self._moments(*self._places(y))
            return self.core.redundant_rhs(t, y, u, moments, drive, refuses=False)
        rates = np.concatenate([y[size:], np.empty_like(y[:size])])
        speeds = np.broadcast_to(np.asarray(u, dtype=np.float64), y.shape[1:])
        for j in np.ndindex(y.shape[1:]):
            own = None if drive is None else drive[(slice(None), *j)]
            state = y[(slice(None), *j)].copy()
            enforced = self.enforced(self.enforce, state, float(speeds[j]), own)
            rates[(slice(size, None), *j)] = enforced
        return rates

    def enforced(self, enforce: Enforce, y: Array, u: float, drive: Array | None = None) -> Array:
        """Accelerations q'' of one redundant state by a dense recursion, shape (3 n,)."""
        mass = self.form.mass(np.split(y, 2)[0])
        return enforce(mass, self.form.forces(y, u, drive), self.groups(y))

    def groups(self, y: Array) -> list[Group]:
        """The pair A_r and b_r of each constraint at a state, in the order given."""
        q, rates = np.split(y, 2)
        _, matrix, _ = self.form.constraints(q, np.eye(q.size))
        _, _, wanted = self.form.constraints(q, rates)
        return [(matrix[rows], wanted[rows]) for rows in self.layout.group_rows]

    def _places(self, y: Any) -> tuple[Array, Array]:
        """Coordinates and rates, (3 n, ...) each, recomputed from angles in redundant states."""
        q, rates = np.split(np.asarray(y, dtype=np.float64), 2)
        angles = (np.cumsum(of[2::3], axis=0) for of in (q, rates))
        place, moving = np.split(self.core.from_angles(*angles), 2)
        return place, moving

    def _moments(self, q: Array, rates: Array) -> Array:
        """Moments of the custom modules on the segments, shape (n,) or (n, k)."""
        theta, forces = np.cumsum(q[2::3], axis=0), self.customs.force(q, rates)
        return self.layout.moments(theta, forces.reshape(len(forces), -1)).reshape(theta.shape)

    def energy(self, y: Any, drive: Array | None = None, refuses: bool = True) -> float | Array:
        """Energy of redundant states [q, q'], a number or shape (k,); NotResolved as in `rhs`."""
        energy = self.core.redundant_energy(y, drive, refuses)
        if not self.customs:
            return energy
        own = functools.partial(self.customs.energy, self._places(y)[0])
        return energy + (resolved("energy", own, np.ndim(y) == 2) if refuses else own())

    def power(self, y: Any, u: Any, drive: Array | None = None) -> tuple[float | Array, ...]:
        """Powers of flow, joints, drag, other parts (terms and custom modules) and base."""
        flow, joints, drag, others, base = self.core.redundant_power(y, u, drive)
        if self.customs:
            own = functools.partial(self.customs.work, *self._places(y))
            others = others + resolved("power", own, np.ndim(y) == 2)
        return flow, joints, drag, others, base

    # ------------------------------------------------------------------------------------- angles

    def rhs_and_power(self, t: float, y: Array, u: Any, drive: Array | None = None) -> Array:
        """Rates of states [theta, theta', work done], shape (2 n + 1,) or (2 n + 1, k)."""
        if self.is_compiled:
            return self.core.rhs_and_power(t, y, u, drive=drive)
        n, size = self.layout.size, self.core.coordinates
        state = self.core.from_angles(y[:n], y[n : 2 * n])
        q, moving = np.split(state, 2)
        moments = self._moments(q, moving)
        rates = self.core.rhs_and_power(t, y, u, moments, drive)
        if self.enforce is not None:  # the return to guides and pins stays
            other = self._rates(t, state, u, drive) - self.core.redundant_rhs(
                t, state, u, moments, drive, refuses=False
            )
            rates[n : 2 * n] += np.cumsum(other[size + 2 :: 3], axis=0)
        rates[2 * n] += self.customs.work(q, moving)
        return rates

    def states(self, theta: Array, omega: Array) -> Array:
        """Redundant states, (6 n, k), from angles and rates, (n, k) each, projected onto guides."""
        return self.core.from_angles(*self.held.onto_constraints(theta, omega))

    def jacobian(
        self, y: Array, u: float | Array, returns: bool = True, drive: Array | None = None
    ) -> Array:
        """Derivative of the angles' rates by [theta, theta'], (2 n, 2 n), or (k, ...) of k states.

        Args:
            y: states, shape (2 n,) or (2 n, k).
            u: flow speed, for k states also one each, (k,).
            returns: whether to differentiate the rates of `rhs_and_power`, which return to guides
                and pins; if not, those of the angles in `rhs`.
            drive: forcing of the states, (ROWS,) or (ROWS, k).
        """
        if not self.customs:
            return self.core.derivative(y, u, returns=returns, drive=drive)
        if y.ndim == 2:
            each = [None] * y.shape[1] if drive is None else drive.T.copy()
            speeds = np.broadcast_to(u, y.shape[1:]).tolist()
            columns = zip(y.T.copy(), speeds, each, strict=True)
            return np.array([self.jacobian(one, own, returns, by) for one, own, by in columns])
        theta, omega = np.split(y, 2)
        force = self.customs.force(*np.split(self.core.from_angles(theta, omega), 2))
        moments = self.layout.moments(theta, force[:, None])[:, 0]
        change = self.form.moments_by_state(theta, omega, force)
        return self.core.derivative(y, u, moments, change, returns, drive)

    def accelerations_by_state(self, y: Array, u: float, drive: Array | None = None) -> Array:
        """Derivative of the accelerations q'' in `rhs` by [theta, theta'], shape (3 n, 2 n)."""
        lengths, n = self.layout.lengths, self.layout.size
        theta, omega = np.split(y, 2)
        rates = self.rhs(0.0, self.core.from_angles(theta, omega), u, drive, refuses=False)
        turning = np.cumsum(rates[3 * n + 2 :: 3])
        across, inward = theta + 0.5 * math.pi, theta + math.pi
        drift = np.hstack(
            [
                nodes_by_angles(lengths * turning, across)
                + nodes_by_angles(lengths * omega**2, inward),
                2.0 * nodes_by_angles(lengths * omega, across),
            ]
        )
        return drift + (
            coordinates_by_angles(lengths, theta) @ self.jacobian(y, u, False, drive)[n:]
        )
