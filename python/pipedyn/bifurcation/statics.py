# SPDX-License-Identifier: MIT
"""Forces on a pipe at rest in the flow, and small motions about its equilibria.

At rest the flow acts with a u^2 and with nothing else, so forces are affine in u^2 at any
configuration. Their derivative is exact: the operators' stiffness and flux.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.linalg

from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import Model, Operators
from pipedyn.util.check import Array

BALANCED = 1e-8
"""Force that may be left at an equilibrium, in units of 1 + |gamma| + a u^2: in 11 searches of five
models Newton's method left 6e-16 at most."""


class Statics:
    """Forces at rest and their derivatives, in the coordinates that integrators advance.

    With guides and pins the equations are those of accelerations along what these allow plus, for
    what they forbid, the rates with which the motion returns to them: as many as unknowns, and zero
    together at an equilibrium that meets the constraints.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.size = model.moving
        self.motion = VectorField(model)
        self._last: tuple[bytes, Operators] | None = None
        self.resting = np.array(model.resting(), dtype=np.float64)

    def accelerations(self, x: Array, u: float) -> tuple[Array, Array]:
        """Rates and accelerations of [x, 0], (moving,) each; rates are 0 but where guides are."""
        y = np.concatenate([x, np.zeros(self.size)])
        rates, turning = np.split(self.motion(y[:, None], u)[:, 0], 2)
        return rates, turning

    def residual(self, x: Array, p: float) -> Array:
        """Forces, or for scenes accelerations and returns to the guides, shape (moving,)."""
        rates, turning = self.accelerations(x, abs(p))
        if self.motion.constrained:
            total: Array = rates + turning
            return total
        forces: Array = self.operators(x).mass @ turning
        return forces

    def operators(self, x: Array) -> Operators:
        """About a configuration; the last are kept: forces and their derivative both use them."""
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self.model.operators(x)
        return self._last[1]

    def jacobian(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by x, (moving, moving)."""
        if not self.motion.constrained:
            ops = self.operators(x)
            slope: Array = -ops.stiffness - ops.centrifugal * p**2 * ops.flux
            return slope
        whole = self.model.motion_jacobian(np.concatenate([x, np.zeros(self.size)]), abs(p))
        joined: Array = whole[self.size :, : self.size] + whole[: self.size, : self.size]
        return joined

    def by_parameter(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by the speed: forces are affine in its square."""
        slope: Array = 2.0 * p * (self.residual(x, 1.0) - self.residual(x, 0.0))
        return slope

    def unbalanced(self, x: Array, u: float) -> float:
        """Largest force left, in units of 1 + |gamma| + a u^2, and how far guides are missed."""
        rates, turning = self.accelerations(x, u)
        missed = float(np.abs(rates).max())
        if not missed < 1e-9:  # `operators` takes no configuration that misses a guide
            return math.inf
        along = self.model.free_directions(x).T @ turning if self.motion.constrained else turning
        pipe = self.model.pipe
        size = 1.0 + abs(pipe.gamma) + pipe.centrifugal * u**2
        return float(np.abs(self.operators(x).mass @ along).max()) / size + missed

    def eigenvalues(self, x: Array, u: float) -> Complex:
        """Of small motions about an equilibrium, shape (2 dof,)."""
        mass, velocity, stiffness = self.operators(x).at(u)
        n = len(mass)
        half = scipy.linalg.solve_triangular(np.linalg.cholesky(mass), np.eye(n), lower=True)
        companion = np.zeros((2 * n, 2 * n))
        companion[:n, n:] = np.eye(n)
        companion[n:, :n], companion[n:, n:] = -half @ stiffness @ half.T, -half @ velocity @ half.T
        found: Complex = scipy.linalg.eigvals(companion)
        return found

    def growth(self, x: Array, u: float) -> Array:
        """Real parts of the eigenvalues beyond rounding, the largest first."""
        return growth_among(self.eigenvalues(x, u))

    def recorded(self, xs: Array) -> Array:
        """Coordinates that users see, (k, coordinates), of (k, moving)."""
        return self.model.recorded(xs, np.zeros_like(xs))[0]

    def from_start(self, name: str, start: Any) -> Array:
        """The argument as [x], from coordinates or an angle theta(s)."""
        given = self.model.bent(start) if callable(start) else start
        try:
            return np.array(self.model.start(given, None)[: self.size])
        except (ValueError, TypeError) as error:
            raise type(error)(str(error).replace("q0", name, 1)) from error

    def rms(self, x: Array) -> float:
        """Size of a difference of configurations."""
        return float(np.linalg.norm(x)) / math.sqrt(self.size)

    def straight(self, x: Array) -> bool:
        """Whether a configuration is that of the straight pipe, its own mirror image."""
        return not self.resting.any() and self.rms(x) < 1e-9

    def rests(self, u: float) -> bool:
        """Whether the configuration at rest is an equilibrium."""
        return self.unbalanced(self.resting, u) <= BALANCED


def growth_among(eigenvalues: Complex) -> Array:
    """Real parts beyond rounding, the largest first: positive those that count as unstable."""
    beyond: Array = np.sort(eigenvalues.real - rounding(eigenvalues))[::-1]
    return beyond


def rounding(eigenvalues: Complex) -> float:
    """Real part up to which an eigenvalue counts as neutral."""
    largest = float(np.abs(eigenvalues).max())
    return 1e-10 + min(4.0 * float(np.finfo(float).eps) * largest**2, 1e-6)
