# SPDX-License-Identifier: MIT
"""Configurations at which a pipe rests in the flow, all of them at one speed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import field, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import root

from pipedyn.bifurcation.continuation import (
    Continuation,
    Control,
    DenseProblem,
    Equations,
    solve,
)
from pipedyn.bifurcation.statics import BALANCED, Statics, growth_among
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.motion.simulate import Start, checked_model_in_motion, modal_bend
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

LARGEST = 500
"""Degrees of freedom up to which equilibria are searched: factorisations here are dense."""

DISTINCT = 1e-6
"""Change of coordinates, relative to 1 plus the largest, from which two equilibria differ. In 11
searches of five models solutions for one equilibrium differed by 7e-16 at most, and two equilibria
by 0.1 at least."""

FAR = 60.0
"""Coordinate beyond which a branch is not followed: ten turns."""

MOST_POINTS = 4000
"""Points of one branch: at the usual step those of 200 rad, three times as far as `FAR`."""

LEAVING = 0.02
"""Distance from a branch point, in rad, at which a branch that leaves it is taken up: in 7 searches
of four models 0.001 to 0.02 led to all equilibria, 0.08 and more missed a pair."""


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

    The search takes branches that leave the straight pipe, in the flow speed and in gravity as it
    grows from nothing, and Newton's method from bent starts: half a radian to one and a half turns,
    in the first three modes of bending. No method finds all for certain; `starts` adds others.

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
    statics = Statics(checked_size(model))
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if isinstance(starts, str) or not isinstance(starts, Sequence):
        raise TypeError(f"starts must be a sequence of starts, got {check.shown(starts)}")
    own = [statics.from_start(f"starts[{i}]", start) for i, start in enumerate(starts)]
    with one_thread(model.dof):
        found: list[Array] = []
        for x in _solutions(statics, u, own):
            for image in (x, -x):
                with suppress(ValueError, PipedynError):
                    if _is_new(found, image) and statics.unbalanced(image, u) <= BALANCED:
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
        stable=np.array([growth_among(one)[0] <= 0.0 for one in values]),
        growth=np.array([float(one.real.max()) for one in values]),
        tips=model.tips(q.T),
        residuals=residuals,
        u=u,
        model=model,
    )


def _is_new(known: list[Array], x: Array) -> bool:
    """Whether a configuration is none of those known, and not too far to count."""
    size = float(np.abs(x).max())
    return size <= FAR and all(np.abs(x - one).max() >= DISTINCT * (1.0 + size) for one in known)


def checked_size(model: Any) -> Model:
    """The argument, if it is a model whose equilibria can be found."""
    moving = checked_model_in_motion(model)
    if moving.dof > LARGEST:
        raise ValueError(
            f"model must have at most {LARGEST} degrees of freedom for equilibria, got {moving.dof}"
        )
    return moving


# ------------------------------------------------------------------------------------ where to look


def pitchforks(statics: Statics, highest: float) -> list[tuple[float, Array]]:
    """Speeds up to the highest at which branches leave the straight pipe, with directions."""
    if not (statics.rests(0.0) and statics.rests(1.0)):
        return []
    return _branch_points(statics, statics.resting, highest, squared=True)


def _branch_points(
    equations: Equations, x: Array, highest: float, squared: bool = False
) -> list[tuple[float, Array]]:
    """Parameters > 0 at which branches leave an equilibrium x of all parameters, with directions.

    The forces are affine in the parameter or in its square.
    """
    a = equations.jacobian(x, 0.0)
    b = equations.jacobian(x, 1.0) - a
    top, bottom = scipy.linalg.eig(a, -b, right=False, homogeneous_eigvals=True)
    good = np.abs(bottom) > 1e-12 * np.abs(top)  # b has a small rank: the others lie at infinity
    values = top[good] / bottom[good]
    real = np.sort(values.real[np.abs(values.imag) <= 1e-9 * np.abs(values)])
    parameters = [math.sqrt(w) if squared else float(w) for w in real if w > 0.0]
    # The null vector of the singular matrix is the direction.
    return [(p, np.linalg.svd(equations.jacobian(x, p))[2][-1]) for p in parameters if p <= highest]


def _solutions(statics: Statics, u: float, starts: list[Array]) -> Iterator[Array]:
    """What may be equilibria at a speed.

    First the straight pipe, then what lies on branches that leave it as speed or gravity grows, and
    what scipy's hybrid method finds from starts and Newton's method improves.
    """
    yield statics.resting
    highest = 2.0 * u + 10.0
    for speed, direction in pitchforks(statics, highest):
        problem = DenseProblem(statics, statics.size, 0.1 * highest)
        yield from _on_branch(problem, statics.resting, speed, direction, u, (0.0, highest))
    if statics.model.pipe.gamma != 0.0 and statics.rests(u):
        scaled = _ScaledGravity(statics, u)
        for share, direction in _branch_points(scaled, statics.resting, 1.0):
            problem = DenseProblem(scaled, statics.size, 0.5)
            yield from _on_branch(problem, statics.resting, share, direction, 1.0, (0.0, 2.0))
    bends = [size * mode for mode in np.eye(3) for size in (0.5, 1.5, 3.0, 5.0, 9.0)]
    for parts in bends:
        with suppress(PipedynError):  # guides and pins that such a bend cannot meet
            starts.append(statics.from_start("q0", modal_bend(parts)))
    for start in starts:
        with suppress(NewtonFailed, ValueError):
            found = root(statics.residual, start, args=(u,), jac=statics.jacobian, method="hybr")
            if float(np.abs(found.x).max()) <= FAR:
                yield solve(statics, found.x, u)


class _ScaledGravity:
    """Forces at rest at one speed, with a share p of gravity: they are affine in it."""

    def __init__(self, full: Statics, u: float) -> None:
        self.full, self.u = full, u
        self.none = Statics(full.model.with_pipe(replace(full.model.pipe, gamma=0.0)))

    def residual(self, x: Array, p: float) -> Array:
        none = self.none.residual(x, self.u)
        return np.asarray(none + p * (self.full.residual(x, self.u) - none))

    def jacobian(self, x: Array, p: float) -> Array:
        none = self.none.jacobian(x, self.u)
        return np.asarray(none + p * (self.full.jacobian(x, self.u) - none))

    def by_parameter(self, x: Array, p: float) -> Array:
        return np.asarray(self.full.residual(x, self.u) - self.none.residual(x, self.u))


def _on_branch(
    problem: DenseProblem,
    x: Array,
    p: float,
    direction: Array,
    target: float,
    ends: tuple[float, float],
) -> Iterator[Array]:
    """Solutions at a parameter on the branch that leaves a branch point, one half of it."""
    branch = Continuation(problem, Control(longest=0.4))
    begin = branch.starting(np.append(x, p), np.append(direction, 0.0))
    step = 0.05
    with suppress(NewtonFailed):
        point = branch.at(begin, LEAVING)
        for _ in range(MOST_POINTS):
            segment, step = branch.next(point, step)
            found = segment.end
            if (point.p - target) * (found.p - target) <= 0.0 and point.p != found.p:
                share = (target - point.p) / (found.p - point.p)
                with suppress(NewtonFailed):
                    yield solve(problem.equations, point.x + share * (found.x - point.x), target)
            away = (found.x - x) / math.sqrt(x.size)
            if abs(float(away @ direction)) < 0.5 * LEAVING and np.linalg.norm(away) < LEAVING:
                return  # through the straight pipe again, onto a mirror image
            if not ends[0] <= found.p <= ends[1] or float(np.abs(found.x).max()) > FAR:
                return
            point = found
