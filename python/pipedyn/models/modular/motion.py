# SPDX-License-Identifier: MIT
"""A scene's motion as integrators take it: in the angles of the segments.

Redundant coordinates that follow from the angles meet every clamp and joint to rounding, at any
time. Guides and pins are met by a projection P of each state, and

    y' = f(P(y)) - return_rate (y - P(y)),

so that what an integrator's errors leave beside the constraints decays. Recorded is P(y): nothing
is left to grow. Without modules in Python all of it is compiled (cpp/pipedyn/modular/scene.hpp).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pipedyn import _core
from pipedyn.models.modular.custom import CustomForces
from pipedyn.models.modular.layout import Layout
from pipedyn.util.check import Array


class SceneMotion:
    """Equations of motion in the angles.

    Args:
        core: the compiled scene.
        layout: where its parts are.
        customs: modules of the user's own.
        accelerations: dy/dt of redundant states (6 n,) or (6 n, k) at a flow speed; None where
            the core's will do.
    """

    def __init__(
        self,
        core: _core.Scene,
        layout: Layout,
        customs: CustomForces,
        accelerations: Callable[[Array, Any], Array] | None,
    ) -> None:
        self.core, self.layout = core, layout
        self.customs, self.accelerations = customs, accelerations

    def rhs_and_power(self, t: float, y: Array, u: Any) -> Array:
        """Rates of [theta, theta', work done], shape (2 n + 1,) or (2 n + 1, k)."""
        if self.accelerations is None:
            return self.core.angle_rates(t, y, u)
        n = self.layout.size
        theta, omega = y[:n], y[n : 2 * n]
        met_theta, met_omega = self.projected(theta, omega)
        state = self.core.from_angles(met_theta, met_omega)
        turning = np.cumsum(self.accelerations(state, u)[3 * n + 2 :: 3], axis=0)
        rates = np.empty_like(y)
        rates[:n], rates[n : 2 * n] = met_omega, turning
        if self.layout.held:
            rates[:n] -= self.core.return_rate * (theta - met_theta)
            rates[n : 2 * n] -= self.core.return_rate * (omega - met_omega)
        rates[2 * n] = sum(self.power(state, u))
        return rates

    def energy(self, y: Any) -> float | Array:
        """Energy of redundant states [q, q'], a number or shape (k,)."""
        energy = self.core.energy(y)
        if not self.customs:
            return energy
        return energy + self.customs.energy(
            np.asarray(y, dtype=np.float64)[: self.core.coordinates]
        )

    def power(self, y: Any, u: Any) -> tuple[float | Array, ...]:
        """Power of flow, joints, drag, and of what terms and custom modules do besides."""
        flow, joints, drag, others = self.core.power(y, u)
        if self.customs:
            q, rates = np.split(np.asarray(y, dtype=np.float64), 2)
            others = others + self.customs.work(q, rates)
        return flow, joints, drag, others

    def states(self, theta: Array, omega: Array) -> Array:
        """Redundant states of angles and rates, (6 n, k) from (n, k) each."""
        return self.core.from_angles(*self.projected(theta, omega))

    def projected(self, theta: Array, omega: Array) -> tuple[Array, Array]:
        """Angles and rates that meet guides and pins, close to those given; NaN without any."""
        if not self.layout.held:
            return theta, omega
        shape = theta.shape
        n = self.layout.size
        met = self.core.project(theta.reshape(n, -1), omega.reshape(n, -1))
        return met[0].reshape(shape), met[1].reshape(shape)

    def jacobian(
        self, y: Array, u: float, accelerations_by: Callable[[Array, float], Array]
    ) -> Array:
        """Derivative of the angles' rates by [theta, theta'], shape (2 n, 2 n).

        Exact without guides and pins; with them the projection's own curvature is left out, which
        an implicit integrator does not miss.
        """
        n = self.layout.size
        theta, omega = self.projected(y[:n], y[n : 2 * n])
        by_state = accelerations_by(self.core.from_angles(theta, omega), u)
        turning = np.cumsum(by_state[2::3], axis=0)
        lengths = self.layout.lengths
        reached = np.tri(n)
        sine, cosine = np.sin(theta) * lengths, np.cos(theta) * lengths
        by_angle, by_rate = np.zeros((3 * n, n)), np.zeros((3 * n, n))
        by_angle[0::3], by_angle[1::3] = reached * cosine, -reached * sine
        by_angle[2::3] = np.eye(n) - np.eye(n, k=-1)
        by_rate[0::3], by_rate[1::3] = -reached * sine * omega, -reached * cosine * omega
        whole = np.zeros((2 * n, 2 * n))
        whole[:n, n:] = np.eye(n)
        whole[n:, :n] = turning[:, : 3 * n] @ by_angle + turning[:, 3 * n :] @ by_rate
        whole[n:, n:] = turning[:, 3 * n :] @ by_angle
        if self.layout.held:
            rows = self.layout.rows(theta)
            away = np.linalg.pinv(rows, rcond=1e-9) @ rows
            onto = np.kron(np.eye(2), np.eye(n) - away)
            whole = whole @ onto - self.core.return_rate * np.kron(np.eye(2), away)
        return whole
