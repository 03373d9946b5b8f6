# SPDX-License-Identifier: MIT
"""Circular motion of a pipe that flutters in three dimensions, as an equilibrium that rotates.

In a frame that rotates about the axis of the straight pipe with the angular velocity W of the
motion the pipe is at rest: q(t) = R(W t) q_0. With the quarter turn J, q' = W J q and q'' = -W^2 q,
so that the accelerations of the model satisfy

    accelerations(q, W J q; u) + W^2 q = 0.

The plane in which the last coordinate lies is free; it is fixed by a_z = 0 there. Small changes of
the state obey the constant matrix Df - W J, whose eigenvalues are the exponents of the motion. One
of them is 0, since a rotated motion is a motion.

Source: relative equilibria, Golubitsky, Stewart and Schaeffer, Singularities and Groups in
Bifurcation Theory II, ch. XVI.
"""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np

from pipedyn.continuation.arclength import Control, DenseProblem, Segment
from pipedyn.equilibrium.hopf import hopf
from pipedyn.linear.neutral import growth
from pipedyn.models.base import Model
from pipedyn.models.drive import steady_speed
from pipedyn.motion.simulate import checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import LENGTH, RATE, Result

FIRST_RADIUS = 1e-3
"""Largest angle of the first motion that is solved for, in rad: terms of higher degree change its
speed by a millionth."""

LONGEST_BRANCH = 400
"""Largest number of steps along the branch of circular motions."""


@saved_as("RotatingMotion")
class RotatingMotion(Result, units={"radius": LENGTH, "height": LENGTH, "exponents": RATE}):
    """A circular motion: a bent shape that rotates about the axis of the straight pipe.

    Attributes:
        u: flow speed.
        frequency: angular velocity W, in 1 / T; the shape turns from x towards z.
        radius: distance of the free end from the axis, in L.
        height: y of the free end, in L.
        exponents: growth rates of small changes in the frame that rotates, by falling real parts,
            complex, shape (2 dof - 1,). That of the motion turned about the axis, which is 0, is
            left out.
        q: coordinates of the shape at one time, shape (dof,).
        model: the model.

    Example:
        >>> found = pp.rotating_motion(pp.Chain(pp.Pipe(0.2), n=10, dimensions=3), 6.0)
        >>> round(found.radius, 4), round(found.frequency, 3), found.stable
        (0.22, 14.336, True)
    """

    u: float
    frequency: float
    radius: float
    height: float
    exponents: Complex = field(repr=False)
    q: Array = field(repr=False)
    model: Model

    @property
    def stable(self) -> bool:
        """Whether all exponents have negative real parts, so that the motion attracts."""
        return bool(growth(self.exponents).max() < 0.0)

    @property
    def qdot(self) -> Array:
        """Rates of the coordinates at the time of `q`, shape (dof,)."""
        return self.frequency * self.model.quarter_turn(self.q)

    def _shown(self) -> dict[str, Any]:
        return super()._shown() | {"stable": self.stable}


def rotating_motion(model: Model, u: float) -> RotatingMotion:
    """The circular motion of a pipe in three dimensions at a flow speed.

    It is followed from the critical speed, where it emerges, through growing radius to the first
    such motion at the speed asked for.

    Args:
        model: model in three dimensions, up to 200 degrees of freedom.
        u: flow speed > 0.

    Returns:
        RotatingMotion. The mirrored motion, which turns the other way, exists as well.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.5), n=10, dimensions=3)
        >>> pp.rotating_motion(chain, 9.5).stable
        False

    Raises:
        NotConverged: if the branch of circular motions does not reach the speed.
        NoHopf, NoCrossing: if stability is not lost by flutter.
        ValueError, TypeError: for bad arguments, such as a model that moves in a plane.

    Source: see the module's docstring.
    """
    checked_model_in_motion(model, largest=200, purpose="rotating_motion")
    check.instance("model", model, Model, "a model in three dimensions")
    model.quarter_turn(np.zeros(model.integrated))
    u = steady_speed("u", u, open_low=True)
    with one_thread(2 * model.integrated):
        z = _reached(model, u)
        return _motion_at(model, z)


def _equations(model: Model, x: Array, u: float) -> tuple[Array, Array]:
    """Residual of a circular motion x = [q, W], and its derivatives by x and u."""
    size = model.integrated
    q, w = x[:size], float(x[size])
    turned = model.quarter_turn(q)
    found = model.motion_linearised(np.concatenate([q, w * turned])[:, None], u)[0]
    rates, by_speed, by_state = found[0, size:], found[1, size:], found[2 + size :]
    by_rate = by_state[:, size:]
    turn = model.quarter_turn(np.eye(size))
    slopes = by_state[:, :size] + w * (by_rate @ turn) + w**2 * np.eye(size)
    phase = np.zeros(size + 2)
    phase[size - 1] = 1.0
    whole = np.column_stack([slopes, by_rate @ turned + 2.0 * w * q, by_speed])
    return np.append(rates + w**2 * q, q[-1]), np.vstack([whole, phase])


def _reached(model: Model, u: float) -> Array:
    """The solution (q, W, u) at a speed, on the branch from the critical speed."""
    size, onset = model.integrated, hopf(model.planar)
    mode = onset.mode[: size // 2]
    mode = mode / mode[-1]
    mode *= FIRST_RADIUS / np.abs(mode).max()
    guess = np.concatenate([mode.real, mode.imag, [onset.frequency, onset.speed]])
    problem = DenseProblem(
        lambda x, p: _equations(model, x, p), size + 1, 1.0, Control(longest=0.2, shortest=1e-9)
    )
    last = size // 2 - 1
    try:
        small = problem.fixed(guess, float(guess[last]), last)
        outward = np.zeros(size + 2)
        outward[last] = 1.0
        start, step = problem.point(small, outward), FIRST_RADIUS
        for _ in range(LONGEST_BRANCH):
            segment: Segment[DenseProblem]
            segment, step = problem.next(start, step)
            if (segment.begin.p - u) * (segment.end.p - u) <= 0.0:
                return segment.where(u)
            start = segment.end
        reason = f"it takes more than {LONGEST_BRANCH} steps"
    except NewtonFailed as failed:
        reason = str(failed)
    raise NotConverged(
        f"no circular motion was found at u = {u:g}: the branch that emerges at u = "
        f"{onset.speed:.6g} was not followed so far, as {reason}"
    )


def _motion_at(model: Model, z: Array) -> RotatingMotion:
    size = model.integrated
    q, w, u = z[:size], float(z[size]), float(z[size + 1])
    state = np.concatenate([q, w * model.quarter_turn(q)])
    turn = np.kron(np.eye(2), model.quarter_turn(np.eye(size)))
    free = model.free_states(state)  # without changes that supports forbid
    slopes = free.T @ (model.motion_jacobian(state, u) - w * turn) @ free
    exponents = np.linalg.eigvals(slopes).astype(complex)
    exponents = np.delete(exponents, np.abs(exponents).argmin())
    x, y, across = model.tip(q)
    return RotatingMotion(
        u=u,
        frequency=w,
        radius=float(np.hypot(x, across)),
        height=float(y),
        exponents=exponents[np.lexsort((-exponents.imag, -exponents.real))],
        q=q,
        model=model,
    )
