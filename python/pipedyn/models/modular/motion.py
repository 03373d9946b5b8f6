# SPDX-License-Identifier: MIT
"""Motion of a scene: forces and accelerations with their derivatives, custom modules included.

Integrators advance the angles of the segments: redundant coordinates that follow from these meet
every clamp and joint to rounding, at any time. Guides and pins are met by a projection P of each
state, and

    y' = f(P(y)) - return_rate (y - P(y)),

so that an integrator's errors off the constraints decay. Recorded is P(y): nothing is left to grow.
Without modules in Python all of it is compiled (cpp/pipedyn/modular/scene.hpp).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import sparse

from pipedyn import _core
from pipedyn.models.modular.custom import CustomForces
from pipedyn.models.modular.enforcement import Enforce, Group
from pipedyn.models.modular.layout import Layout
from pipedyn.models.modular.linearisation import Tree, factored, matrix
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.threads import one_thread


class SceneMotion:
    """Equations of motion, in redundant coordinates and in the angles.

    Args:
        core: the compiled scene.
        layout: where its parts are.
        customs: modules of the user's own.
        enforce: a dense recursion that finds the accelerations; None for the core's.
    """

    def __init__(
        self, core: _core.Scene, layout: Layout, customs: CustomForces, enforce: Enforce | None
    ) -> None:
        self.core, self.layout = core, layout
        self.customs, self.enforce = customs, enforce
        self.compiled = not customs and enforce is None
        """Whether nothing of the motion is computed in Python."""

    # --------------------------------------------------------------------- redundant coordinates

    def rhs(self, t: float, y: Any, u: Any) -> Array:
        """Rates of redundant states [q, q'], shape (6 n,) or (6 n, k)."""
        if self.compiled:
            return self.core.rhs(t, y, u)
        size = self.core.coordinates
        y = check.doubles("y", y, "an array of real numbers")
        self.core.power(y, u)  # checks both
        if self.enforce is None:
            return self.core.rhs(t, y, u, self.customs.force(y[:size], y[size:]))
        rates = np.concatenate([y[size:], np.empty_like(y[:size])])
        speeds = np.broadcast_to(np.asarray(u, dtype=np.float64), y.shape[1:])
        for j in np.ndindex(y.shape[1:]):
            state = y[(slice(None), *j)].copy()
            rates[(slice(size, None), *j)] = self.enforced(self.enforce, state, float(speeds[j]))
        return rates

    def enforced(self, enforce: Enforce, y: Array, u: float) -> Array:
        """Accelerations of one state by a dense recursion, shape (3 n,)."""
        size = self.core.coordinates
        mass = matrix(self.core.operators()["mass"], size, size).toarray()
        force = self.core.forces(y, u) + self.customs.force(y[:size], y[size:])
        return enforce(mass, force, self.groups(y))

    def groups(self, y: Array) -> list[Group]:
        """A_r and b_r of each constraint at a state."""
        _, triplets, wanted, group = self.core.constraints(y)
        rows = matrix(triplets, wanted.size, self.core.coordinates).toarray()
        return [(rows[group == r], wanted[group == r]) for r in np.unique(group)]

    def energy(self, y: Any) -> float | Array:
        """Energy of redundant states [q, q'], a number or shape (k,)."""
        energy = self.core.energy(y)
        if not self.customs:
            return energy
        return energy + self.customs.energy(np.split(np.asarray(y, dtype=np.float64), 2)[0])

    def power(self, y: Any, u: Any) -> tuple[float | Array, ...]:
        """Power of flow, joints, drag, and of what terms and custom modules do besides."""
        flow, joints, drag, others = self.core.power(y, u)
        if self.customs:
            others = others + self.customs.work(*np.split(np.asarray(y, dtype=np.float64), 2))
        return flow, joints, drag, others

    def forces(self, y: Array, u: float) -> tuple[Array, Any, Any]:
        """Forces of all modules at a state, (3 n,), and their derivatives by q and q', sparse."""
        size = self.core.coordinates
        force = np.array(self.core.forces(y, u))
        by_q, by_rate = (matrix(of, size, size) for of in self.core.force_derivatives(y, u))
        for custom in self.customs.each:
            at = custom.index
            q, rates, places = y[at], y[size + at], (at.repeat(at.size), np.tile(at, at.size))
            force[at] += custom.force(q, rates)
            by_q = by_q + matrix((*places, custom.by_q(q, rates).ravel()), size, size)
            by_rate = by_rate + matrix((*places, custom.by_qdot(q, rates).ravel()), size, size)
        return force, by_q, by_rate

    def acceleration_jacobian(self, y: Array, u: float) -> Array:
        """Derivative of q'' by the state, (3 n, 6 n), from M q'' + A^T mu = f, A q'' = b."""
        core, size = self.core, self.core.coordinates
        _, triplets, wanted, _ = core.constraints(y)
        chosen = self.layout.independent_rows
        ties = matrix(triplets, wanted.size, size)[chosen]
        whole = sparse.block_array(
            [[matrix(core.operators()["mass"], size, size), ties.T], [ties, None]], format="coo"
        )
        # Rows and unknowns from the clamp to the tip, each multiplier after the last node it ties.
        last = np.maximum.reduceat(ties.indices, ties.indptr[:-1]) // 3
        order = np.argsort(np.concatenate([np.arange(size) // 3, last]), kind="stable")
        place = np.argsort(order)
        solve = factored(order.size, place[whole.row], place[whole.col], whole.data)
        force, by_q, by_rate = self.forces(y, u)
        with one_thread(1):
            right = np.concatenate([force, wanted[chosen]])[order, None]
            found = solve(right, False)[place, 0]
            multipliers = np.zeros(wanted.size)
            multipliers[chosen] = found[size:]
            rows, *places, values = core.hessians(y[:size])
            by_q = by_q - matrix((*places, values * multipliers[rows]), size, size)
            of_q, of_rate = acceleration_derivatives(core, y, found[:size])
            right = sparse.block_array([[by_q, by_rate], [-of_q[chosen], -of_rate[chosen]]])
            result: Array = solve(right.toarray()[order], False)[place[:size]]
        return result

    # ------------------------------------------------------------------------------------- angles

    def rhs_and_power(self, t: float, y: Array, u: Any) -> Array:
        """Rates of [theta, theta', work done], shape (2 n + 1,) or (2 n + 1, k)."""
        if self.compiled:
            return self.core.angle_rates(t, y, u)
        n = self.layout.size
        met = np.concatenate(self.projected(y[:n], y[n : 2 * n]))
        state = self.core.from_angles(met[:n], met[n:])
        turning = np.cumsum(self.rhs(t, state, u)[3 * n + 2 :: 3], axis=0)
        rates = np.empty_like(y)
        off = self.core.return_rate * (y[: 2 * n] - met)
        rates[: 2 * n] = np.concatenate([met[n:], turning]) - off
        rates[2 * n] = sum(self.power(state, u))
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

    def jacobian(self, y: Array, u: float) -> Array:
        """Derivative of the angles' rates by [theta, theta'], shape (2 n, 2 n).

        Exact without guides and pins; with them the projection's own curvature is left out, which
        an implicit integrator does not miss.
        """
        n, layout = self.layout.size, self.layout
        theta, omega = self.projected(y[:n], y[n : 2 * n])
        by_state = self.acceleration_jacobian(self.core.from_angles(theta, omega), u)
        by_q, by_qdot = np.split(np.cumsum(by_state[2::3], axis=0), 2, axis=1)
        joints = np.eye(n) - np.eye(n, k=-1)
        by_angle = Tree(layout.lengths, theta).spread(joints)
        by_rate = Tree(layout.lengths * omega, theta + 0.5 * math.pi).spread(joints)
        by_rate[2::3] = 0.0  # the joints' rates do not depend on the angles
        whole = np.zeros((2 * n, 2 * n))
        whole[:n, n:] = np.eye(n)
        whole[n:, :n] = by_q @ by_angle + by_qdot @ by_rate
        whole[n:, n:] = by_qdot @ by_angle
        if layout.holding:
            rows = layout.rows(theta).T
            away = np.linalg.pinv(rows, rcond=1e-9) @ rows
            onto = np.kron(np.eye(2), np.eye(n) - away)
            whole = whole @ onto - self.core.return_rate * np.kron(np.eye(2), away)
        return whole


def acceleration_derivatives(core: _core.Scene, y: Array, acceleration: Array) -> tuple[Any, Any]:
    """Derivatives of A q'' - b by q and by q', with q'' held, sparse, (rows of A, 3 n) each.

    With g's second derivatives H_i, b_i = -q'.H_i q'. Of third derivatives there are those by a
    joint's angle alone, which are the first ones negated.
    """
    size = core.coordinates
    q, rates = y[:size], y[size:]
    _, triplets, wanted, _ = core.constraints(y)
    rows, i, k, values = core.hessians(q)
    in_joints = np.where(np.arange(size) % 3 == 2, rates**2, 0.0)
    of_q = matrix((rows, k, values * acceleration[i]), wanted.size, size)
    of_q = of_q - matrix(triplets, wanted.size, size) @ sparse.diags_array(in_joints)
    return of_q, matrix((rows, k, 2.0 * values * rates[i]), wanted.size, size)
