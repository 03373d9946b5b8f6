# SPDX-License-Identifier: MIT
"""Configurations at which a pipe rests in the flow, all of them at one speed.

At rest the flow acts with a u^2 and with nothing else, so forces are affine in u^2 at any
configuration. Their derivative is exact: the operators' stiffness and flux.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import field
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import root

from pipedyn.bifurcation.continuation import solve
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged, Operators, PipedynError
from pipedyn.motion.simulate import Start, checked_model_in_motion, modal_bend
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

BALANCED = 1e-8
"""Force that may be left at an equilibrium, in units of 1 + |gamma| + a u^2: in 11 searches of five
models Newton's method left 6e-16 at most."""

LARGEST = 500
"""Degrees of freedom up to which equilibria are searched: a search in a chain of 100 takes 0.4 s,
of 250 four, of 500 half a minute, as factorisations are dense."""

DISTINCT = 1e-6
"""Change of coordinates, relative to 1 plus the largest, from which two equilibria differ. In 11
searches of five models solutions for one equilibrium differed by 7e-16 at most, and two equilibria
by 0.1 at least."""

FAR = 60.0
"""Coordinate beyond which a branch is not followed: ten turns."""

SIZES = (0.5, 1.5, 3.0, 5.0, 9.0)
"""Angles, in rad, of the bends from which equilibria are searched. In 66 searches, of pipes with 2
to 8 degrees of freedom under a weight up to 180, they led to all equilibria on the branches that
leave the straight pipe as speed or weight grows, and in four searches to 2 to 8 more."""


@result
class Equilibria:
    """Equilibria at one flow speed, the straight one first, the others from the least bent on.

    Attributes:
        q: coordinates, shape (k, coordinates).
        stable: whether no eigenvalue of the linearisation has a positive real part, shape (k,).
        growth: largest real part of an eigenvalue, in 1 / T, shape (k,).
        tips: position (x, y) of the free end in L, shape (k, 2).
        residuals: largest force left, in units of 1 + |gamma| + a u^2, shape (k,).
        u: flow speed.
        model: the model.
    """

    q: Array = field(repr=False)
    stable: NDArray[np.bool_]
    growth: Array
    tips: Array
    residuals: Array = field(repr=False)
    u: float
    model: Model

    def __len__(self) -> int:
        return len(self.stable)


def equilibria(model: Model, u: float, starts: Sequence[Start] = ()) -> Equilibria:
    """Equilibria at a flow speed, stable or not, mirror images included.

    The search takes Newton's method from bent starts: half a radian to one and a half turns, in all
    mixtures of the first three modes of bending. No method finds all for certain; `starts` adds
    others.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        starts: further starts, coordinates each or angles theta(s), as for `simulate`.

    Returns:
        Equilibria. Those of an undamped pipe without flow are stable where they oscillate.

    Raises:
        NotConverged: if not a single one is found.
        ValueError, TypeError: for bad arguments.
    """
    model = checked_model_in_motion(model, largest=LARGEST, purpose="equilibria")
    statics = Statics(model)
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if isinstance(starts, str) or not isinstance(starts, Sequence):
        raise TypeError(f"starts must be a sequence of starts, got {check.shown(starts)}")
    own = [statics.from_start(f"starts[{i}]", start) for i, start in enumerate(starts)]
    with one_thread(model.dof):
        found: list[Array] = []
        for x in _solutions(statics, u, own):
            size = float(np.abs(x).max())
            for image in (x, -x):
                new = all(np.abs(image - one).max() >= DISTINCT * (1.0 + size) for one in found)
                with suppress(ValueError, PipedynError):
                    if new and size <= FAR and statics.unbalanced(image, u) <= BALANCED:
                        found.append(image + 0.0)
        if not found:
            raise NotConverged(f"no equilibrium was found at u = {u:g}")

        def place(x: Array) -> tuple[float, float]:
            tip = model.tips(statics.recorded(x[None]).T)[0, 0]
            return round(statics.rms(x - statics.resting), 6), -float(tip)

        found.sort(key=place)  # a mirror image next to its original, to the right first
        values = [statics.eigenvalues(x, u) for x in found]
        residuals = np.array([statics.unbalanced(x, u) for x in found])
    q = statics.recorded(np.array(found))
    return Equilibria(
        q=q,
        stable=np.array([not (one.real > rounding(one)).any() for one in values]),
        growth=np.array([float(one.real.max()) for one in values]),
        tips=model.tips(q.T),
        residuals=residuals,
        u=u,
        model=model,
    )


# --------------------------------------------------------------------------------- forces at rest


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
        self._operators = lru_cache(1)(lambda key: model.operators(np.frombuffer(key)))
        self.resting = np.array(model.resting(), dtype=np.float64)

    def accelerations(self, x: Array, u: float) -> tuple[Array, Array]:
        """Rates and accelerations of [x, 0], (moving,) each; rates are 0 but where guides are."""
        y = np.concatenate([x, np.zeros(self.size)])
        rates = self.motion(y[:, None], u)[:, 0]
        return rates[: self.size], rates[self.size :]

    def residual(self, x: Array, p: float) -> Array:
        """Forces, or for scenes accelerations and returns to the guides, shape (moving,)."""
        rates, turning = self.accelerations(x, abs(p))
        if self.motion.constrained:
            return rates + turning
        return self.operators(x).mass @ turning

    def operators(self, x: Array) -> Operators:
        """About a configuration; the last are kept: forces and their derivative both use them."""
        return self._operators(x.tobytes())

    def jacobian(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by x, (moving, moving)."""
        if not self.motion.constrained:
            ops = self.operators(x)
            return -ops.stiffness - ops.centrifugal * p**2 * ops.flux
        whole = self.model.motion_jacobian(np.concatenate([x, np.zeros(self.size)]), abs(p))
        return whole[self.size :, : self.size] + whole[: self.size, : self.size]

    def by_parameter(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by the speed: forces are affine in its square."""
        return 2.0 * p * (self.residual(x, 1.0) - self.residual(x, 0.0))

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
        return np.asarray(scipy.linalg.eigvals(companion))

    def growth(self, x: Array, u: float) -> Array:
        """Real parts of the eigenvalues beyond rounding, the largest first."""
        found = self.eigenvalues(x, u)
        return np.sort(found.real - rounding(found))[::-1]

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


def rounding(eigenvalues: Complex) -> float:
    """Real part up to which an eigenvalue counts as neutral."""
    largest = float(np.abs(eigenvalues).max())
    return 1e-10 + min(4.0 * float(np.finfo(float).eps) * largest**2, 1e-6)


# ------------------------------------------------------------------------------------ where to look


def pitchforks(statics: Statics, highest: float) -> list[float]:
    """Speeds up to the highest at which branches leave the straight pipe.

    Its stiffness is affine in the square of the speed.
    """
    if not (statics.rests(0.0) and statics.rests(1.0)):
        return []
    a = statics.jacobian(statics.resting, 0.0)
    b = statics.jacobian(statics.resting, 1.0) - a
    top, bottom = scipy.linalg.eig(a, -b, right=False, homogeneous_eigvals=True)
    good = np.abs(bottom) > 1e-12 * np.abs(top)  # b has a small rank: the others lie at infinity
    values = top[good] / bottom[good]
    real = np.sort(values.real[np.abs(values.imag) <= 1e-9 * np.abs(values)])
    return [math.sqrt(w) for w in real if 0.0 < w <= highest**2]


def _solutions(statics: Statics, u: float, starts: list[Array]) -> Iterator[Array]:
    """What may be equilibria at a speed.

    First the straight pipe, then what scipy's hybrid method finds from starts and Newton's method
    improves.
    """
    yield statics.resting
    # One of each and its mirror image, which leads to the mirror image.
    mixtures = [
        np.array(parts) for parts in product((-1.0, 0.0, 1.0), repeat=3) if parts > (0,) * 3
    ]
    for parts in (size * mixture for size in SIZES for mixture in mixtures):
        with suppress(PipedynError):  # guides and pins that such a bend cannot meet
            starts.append(statics.from_start("q0", modal_bend(parts)))
    for start in starts:
        with suppress(NewtonFailed, ValueError):
            found = root(statics.residual, start, args=(u,), jac=statics.jacobian, method="hybr")
            if float(np.abs(found.x).max()) <= FAR:
                yield solve(statics, found.x, u)
