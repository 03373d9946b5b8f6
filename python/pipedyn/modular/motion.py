# SPDX-License-Identifier: MIT
"""Motion of a scene: rates, energy, power and derivatives, custom modules included.

Integrators advance the angles of the segments. Redundant coordinates that follow from the angles
meet every clamp and joint to rounding, at any time. The distance of a state from guides and pins
decays in its motion, so that an integrator's errors do not grow. The state shown to users is
projected onto guides and pins. Everything but the functions of custom modules is compiled
(cpp/pipedyn/modular/scene.hpp).
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from pipedyn import _core
from pipedyn.models.pipe import Pipe
from pipedyn.modular.custom import CustomForces
from pipedyn.modular.layout import Layout
from pipedyn.util.check import Array
from pipedyn.util.errors import resolved


class SceneMotion:
    """Equations of motion of a scene, in redundant coordinates and in the segments' angles.

    Args:
        pipe: the pipe, without effects of modules that the scene does not have.
        layout: the parts of the scene and their places.
        core: the compiled scene.
        customs: custom modules of the scene.
    """

    def __init__(
        self, pipe: Pipe, layout: Layout, core: _core.Scene, customs: CustomForces
    ) -> None:
        self.pipe, self.layout, self.core, self.customs = pipe, layout, core, customs

    # --------------------------------------------------------------------- redundant coordinates

    def rhs(
        self, t: float, y: Any, u: Any, drive: Array | None = None, refuses: bool = True
    ) -> Array:
        """Rates of redundant states [q, q'], shape (6 n,) or (6 n, k), under forcing `drive`.

        Raises NotResolved if they are not finite, unless `refuses` is False.
        """
        with np.errstate(all="ignore"):
            moments = self._moments(*self._places(y)) if self.customs else None
        return self.core.redundant_rhs(t, y, u, moments, drive, refuses)

    def _places(self, y: Any) -> tuple[Array, Array]:
        """Coordinates and rates, (3 n, ...) each, computed from the angles in redundant states."""
        angles = np.split(self.core.angles(y), 2)
        place, moving = np.split(self.core.from_angles(*angles), 2)
        return place, moving

    def _moments(self, q: Array, rates: Array) -> Array:
        """Moments of the custom modules on the segments, shape (n,) or (n, k)."""
        theta, forces = np.cumsum(q[2::3], axis=0), self.customs.force(q, rates)
        return self.layout.moments(theta, forces.reshape(len(forces), -1)).reshape(theta.shape)

    def energy(self, y: Any, drive: Array | None = None, refuses: bool = True) -> float | Array:
        """Energy of redundant states [q, q'], a number or (k,); raises NotResolved like `rhs`."""
        energy = self.core.energy(self.core.angles(y), drive, refuses)
        if not self.customs:
            return energy
        own = functools.partial(self.customs.energy, self._places(y)[0])
        return energy + (resolved("energy", own, np.ndim(y) == 2) if refuses else own())

    def power(self, y: Any, u: Any, drive: Array | None = None) -> tuple[float | Array, ...]:
        """Powers of flow, joints, drag, others (terms and custom modules) and base."""
        flow, joints, drag, others, base = self.core.power(self.core.angles(y), u, drive)
        if self.customs:
            own = functools.partial(self.customs.work, *self._places(y))
            others = others + resolved("power", own, np.ndim(y) == 2)
        return flow, joints, drag, others, base

    # ------------------------------------------------------------------------------------- angles

    def rhs_and_power(self, t: float, y: Array, u: Any, drive: Array | None = None) -> Array:
        """Rates of states [theta, theta', work done], shape (2 n + 1,) or (2 n + 1, k)."""
        if not self.customs:
            return self.core.rhs_and_power(t, y, u, drive=drive)
        n = self.layout.size
        q, moving = np.split(self.core.from_angles(y[:n], y[n : 2 * n]), 2)
        rates = self.core.rhs_and_power(t, y, u, self._moments(q, moving), drive)
        rates[2 * n] += self.customs.work(q, moving)
        return rates

    def jacobian(
        self, y: Array, u: float | Array, returns: bool = True, drive: Array | None = None
    ) -> Array:
        """Derivative of the rates by [theta, theta'], (2 n, 2 n), or (k, 2 n, 2 n) for k states.

        Args:
            y: states, shape (2 n,) or (2 n, k).
            u: flow speed, a number or, for k states, shape (k,).
            returns: whether to differentiate the rates of `rhs_and_power`, under which states
                return to guides and pins; if not, the rates of the angles in `rhs`.
            drive: forcing of the states, (ROWS,) or (ROWS, k).
        """
        if not self.customs:
            return self.core.derivative(y, u, returns=returns, drive=drive)
        if y.ndim == 2:
            each = [None] * y.shape[1] if drive is None else drive.T.copy()
            speeds = np.broadcast_to(u, y.shape[1:]).tolist()
            columns = zip(y.T.copy(), speeds, each, strict=True)
            return np.array([self.jacobian(one, own, returns, by) for one, own, by in columns])
        return self.core.derivative(y, u, *self.custom_moments(y), returns, drive)

    def custom_moments(self, y: Array) -> tuple[Array, Array]:
        """Moments of custom modules on the segments, (n,), and their derivatives, (n, 2 n).

        The derivatives are by the state [theta, theta'], shape (2 n,).
        """
        n, layout = self.layout.size, self.layout
        theta, omega = np.split(y, 2)
        q, rates = np.split(self.core.from_angles(theta, omega), 2)
        force, turning = self.customs.force(q, rates), self._by_angles(theta, np.ones(n))
        swinging = self._nodes_by_angles(theta + 0.5 * math.pi, omega)
        q_by, rates_by = np.hstack([turning, 0.0 * turning]), np.hstack([swinging, turning])
        change = layout.moments(theta, self.customs.slopes(q, rates, q_by, rates_by))
        # Forces on nodes keep their direction, so that their moments change as the segments turn.
        on_nodes = force[:, None].copy()
        on_nodes[2::3] = 0.0
        change[:, :n] += np.diag(layout.moments(theta + 0.5 * math.pi, on_nodes)[:, 0])
        return layout.moments(theta, force[:, None])[:, 0], change

    def accelerations_by_state(self, y: Array, u: float, drive: Array | None = None) -> Array:
        """Derivative of the accelerations q'' in `rhs` by [theta, theta'], shape (3 n, 2 n)."""
        n = self.layout.size
        theta, omega = np.split(y, 2)
        rates = self.rhs(0.0, self.core.from_angles(theta, omega), u, drive, refuses=False)
        turning = np.cumsum(rates[3 * n + 2 :: 3])
        across, inward = theta + 0.5 * math.pi, theta + math.pi
        drift = np.hstack(
            [
                self._nodes_by_angles(across, turning) + self._nodes_by_angles(inward, omega**2),
                2.0 * self._nodes_by_angles(across, omega),
            ]
        )
        free = self.jacobian(y, u, False, drive)[n:]
        return drift + self._by_angles(theta, np.ones(n)) @ free

    def _by_angles(self, theta: Array, factors: Array) -> Array:
        """Derivatives of redundant coordinates by the angles theta times factors, (3 n, n)."""
        each = np.outer(theta, np.ones(theta.size))
        return self.core.from_angles(each, np.diag(factors))[3 * theta.size :]

    def _nodes_by_angles(self, theta: Array, factors: Array) -> Array:
        """The result of `_by_angles` for the nodes alone, with 0 for the angles of the joints."""
        found = self._by_angles(theta, factors)
        found[2::3] = 0.0
        return found
