# SPDX-License-Identifier: MIT
"""Motion of a scene: its rates, energy and power with their derivatives, custom modules included.

Integrators advance the angles of the segments: redundant coordinates that follow from these meet
every clamp and joint to rounding, at any time. Guides and pins are met by a projection P of each
state, and

    y' = f(P(y)) - return_rate (y - P(y)),

so that an integrator's errors off the constraints decay. Recorded is P(y): nothing is left to grow.
All but custom modules' functions is compiled (cpp/pipedyn/modular/scene.hpp).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipedyn.models.modular.enforcement import Enforce, Group
from pipedyn.models.modular.layout import coordinates_by_angles, nodes_by_angles
from pipedyn.models.modular.redundant import RedundantForm
from pipedyn.util import check
from pipedyn.util.check import Array

REDUNDANT, SMALLEST = 1e-12, 1e-20
"""Of the small system of rows: singular values below which guides and pins say one thing twice, and
a diagonal that is none against the largest, where rounding is all that is left of a row.

As in the core; rounding leaves some 1e-16, and 1e-32 of what is squared.
"""


class SceneMotion:
    """Equations of motion, in redundant coordinates and in the angles.

    Args:
        form: the scene in redundant coordinates.
        enforce: a dense recursion that finds the accelerations from `form`; None for the core's.
    """

    def __init__(self, form: RedundantForm, enforce: Enforce | None) -> None:
        self.form, self.enforce = form, enforce
        self.core, self.layout, self.customs = form.core, form.layout, form.customs
        self.is_compiled = not form.customs and enforce is None

    # --------------------------------------------------------------------- redundant coordinates

    def rhs(self, t: float, y: Any, u: Any) -> Array:
        """Rates of redundant states [q, q'], shape (6 n,) or (6 n, k)."""
        if self.is_compiled:
            return self.core.rhs(t, y, u)
        size = self.core.coordinates
        y = check.doubles("y", y, "an array of real numbers")
        self.core.power(y, u)  # checks both
        if self.enforce is None:
            return self.core.rhs(t, y, u, self._moments(*self._places(y)))
        rates = np.concatenate([y[size:], np.empty_like(y[:size])])
        speeds = np.broadcast_to(np.asarray(u, dtype=np.float64), y.shape[1:])
        for j in np.ndindex(y.shape[1:]):
            state = y[(slice(None), *j)].copy()
            rates[(slice(size, None), *j)] = self.enforced(self.enforce, state, float(speeds[j]))
        return rates

    def enforced(self, enforce: Enforce, y: Array, u: float) -> Array:
        """Accelerations of one state by a dense recursion, shape (3 n,)."""
        return enforce(self.form.mass, self.form.forces(y, u), self.groups(y))

    def groups(self, y: Array) -> list[Group]:
        """A_r and b_r of each constraint at a state, as given."""
        q, rates = np.split(y, 2)
        _, matrix, _ = self.form.constraints(q, np.eye(q.size))
        _, _, wanted = self.form.constraints(q, rates)
        return [(matrix[rows], wanted[rows]) for rows in self.layout.group_rows]

    def _places(self, y: Any) -> tuple[Array, Array]:
        """Coordinates and rates at the angles of redundant states and the rates of these."""
        q, rates = np.split(np.asarray(y, dtype=np.float64), 2)
        angles = (np.cumsum(of[2::3], axis=0) for of in (q, rates))
        place, moving = np.split(self.core.from_angles(*angles), 2)
        return place, moving

    def _moments(self, q: Array, rates: Array) -> Array:
        """Moments of custom modules on the segments, shape (n,) or (n, k)."""
        theta, forces = np.cumsum(q[2::3], axis=0), self.customs.force(q, rates)
        return self.layout.moments(theta, forces.reshape(len(forces), -1)).reshape(theta.shape)

    def energy(self, y: Any) -> float | Array:
        """Energy of redundant states [q, q'], a number or shape (k,)."""
        energy = self.core.energy(y)
        return energy + self.customs.energy(self._places(y)[0]) if self.customs else energy

    def power(self, y: Any, u: Any) -> tuple[float | Array, ...]:
        """Power of flow, joints, drag, and of what terms and custom modules do besides."""
        flow, joints, drag, others = self.core.power(y, u)
        if self.customs:
            others = others + self.customs.work(*self._places(y))
        return flow, joints, drag, others

    # ------------------------------------------------------------------------------------- angles

    def rhs_and_power(self, t: float, y: Array, u: Any) -> Array:
        """Rates of [theta, theta', work done], shape (2 n + 1,) or (2 n + 1, k)."""
        if self.is_compiled:
            return self.core.rhs_and_power(t, y, u)
        n, size = self.layout.size, self.core.coordinates
        met = np.concatenate(self.projected(y[:n], y[n : 2 * n]))
        state = self.core.from_angles(met[:n], met[n:])
        rates = self.core.rhs_and_power(t, y, u, self._moments(state[:size], state[size:]))
        if self.enforce is not None:
            turning = np.cumsum(self.rhs(t, state, u)[size + 2 :: 3], axis=0)
            rates[n : 2 * n] = turning - self.core.return_rate * (y[n : 2 * n] - met[n:])
        rates[2 * n] += self.customs.work(state[:size], state[size:])
        return rates

    def states(self, theta: Array, omega: Array) -> Array:
        """Redundant states of angles and rates, (6 n, k) from (n, k) each."""
        return self.core.from_angles(*self.projected(theta, omega))

    def projected(self, theta: Array, omega: Array) -> tuple[Array, Array]:
        """Angles and rates that meet guides and pins, close to those given; NaN without any."""
        if not self.layout.holding:
            return theta, omega
        columns = (self.layout.size, -1)
        *met, missed = self.core.project(theta.reshape(columns), omega.reshape(columns))
        for of in met:
            of[:, missed > self.core.met] = np.nan
        return met[0].reshape(theta.shape), met[1].reshape(theta.shape)

    def accelerations_by_state(self, y: Array, u: float) -> tuple[Array, Array]:
        """Derivatives by [theta, theta'] of theta'', shape (n, 2 n), and of q'', (3 n, 2 n).

        With the force along each row of weights (see the core) as a load that is held, the chain's
        own derivative lacks what this load's moments and the rows themselves change by.
        """
        core, lengths, n = self.core, self.layout.lengths, self.layout.size
        theta, omega = np.split(y, 2)

        def moments(force: Array) -> Array:
            return self.layout.moments(theta, force[:, None])[:, 0]

        force = self.customs.force(*np.split(core.from_angles(theta, omega), 2))
        accelerations, multipliers = core.reactions(y, u, moments(force))
        rows, compliance = core.weights, core.compliance
        force = force + rows.T @ multipliers
        by_state = core.jacobian(y, u, moments(force))[n:]
        every = np.repeat(theta[:, None], max(2 * n, len(rows)), axis=1)
        if self.customs or rows.size:
            change = self.form.moments_by_state(theta, omega, force)
            by_state = by_state + core.solve(every[:, : 2 * n], change)
        q_by_angle = coordinates_by_angles(lengths, theta)
        across, inward = theta + 0.5 * math.pi, theta + math.pi
        drift = np.hstack(
            [
                nodes_by_angles(lengths * accelerations, across)
                + nodes_by_angles(lengths * omega**2, inward),
                2.0 * nodes_by_angles(lengths * omega, across),
            ]
        )
        if rows.size:
            by_angle = rows @ q_by_angle
            response = core.solve(every[:, : len(rows)], by_angle.T)
            system = by_angle @ response
            missing = by_angle @ by_state + rows @ drift
            size = np.diag(system) + np.abs(compliance)
            size = 1.0 / np.sqrt(np.maximum(size, SMALLEST * size.max()))
            system += np.diag(compliance)
            inverse = np.linalg.pinv(size[:, None] * system * size, REDUNDANT)
            by_state = by_state - (response * size) @ (inverse @ (size[:, None] * missing))
        return by_state, drift + q_by_angle @ by_state

    def jacobian(self, y: Array, u: float) -> Array:
        """Derivative of the angles' rates by [theta, theta'], (2 n, 2 n), or (k, ...) of k states.

        Exact without guides and pins; with them the projection's own curvature is left out, which
        an implicit integrator does not miss.
        """
        n, layout = self.layout.size, self.layout
        if self.is_compiled and not layout.holding:
            return self.core.chain.jacobian(0.0, y, u)
        if y.ndim == 2:
            return np.array([self.jacobian(column, u) for column in y.T.copy()])
        met = np.concatenate(self.projected(y[:n], y[n : 2 * n]))
        whole = np.eye(2 * n, k=n)
        whole[n:] = self.accelerations_by_state(met, u)[0]
        if layout.holding:
            rows = layout.rows(met[:n]).T
            away = np.linalg.pinv(rows, rcond=1e-9) @ rows
            onto = np.kron(np.eye(2), np.eye(n) - away)
            whole = whole @ onto - self.core.return_rate * np.kron(np.eye(2), away)
        return whole
