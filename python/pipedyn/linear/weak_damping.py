# SPDX-License-Identifier: MIT
"""Crossings of pipes whose gyroscopic force and damping are so weak that rounding hides Re lambda.

Below sqrt(beta) = delta = mu = 2e-5 the sign of Re lambda would be determined by rounding, so that
a search would find crossings that do not exist, or fail.

The gyroscopic force and both kinds of damping are odd under reversal of time. At a constant ratio
sqrt(beta) : delta : mu, crossings are therefore even functions of their size:
u_c = F(ratio) + O(beta, delta^2, mu^2). The same pipe is solved with all of them made stronger, in
three sizes, and the crossings are extrapolated to the size asked for. The limit is not the pipe
with none of them, which is circulatory (Ziegler's paradox).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipedyn.linear.sensitivity import Crossing, Derivatives, Sensitivity
from pipedyn.models.pipe import Pipe
from pipedyn.util.errors import NotConverged

STRONG = 1e-4
"""Least sqrt(beta), delta or mu that is solved: rounding changes speeds by 1e-10 to 1e-8 there."""

WEAK = 0.2
"""Share of `STRONG` below which crossings are extrapolated. As measured, errors of speeds are 4e-11
at this share with and without extrapolation; without it they are smaller above this share, and
larger below (7e-10 at a tenth)."""

SQUARES = (1.0, 2.0, 4.0)
"""Squares of the sizes solved, in units of the least. Three determine a parabola in the square,
whose distance from the line through two bounds the error; they are close, so that terms of higher
order stay small."""


def _size(pipe: Pipe) -> float:
    """Largest of sqrt(beta), delta and mu, in units of the least size that is solved."""
    return max(math.sqrt(pipe.beta), pipe.damping, pipe.hysteresis) / STRONG


def is_weakly_damped(pipe: Pipe) -> bool:
    """Whether gyroscopic force and damping are present, but so weak that rounding hides them.

    They are not hidden in an undamped pipe that is held at both ends: it is conservative, and the
    search takes its roots as lying on the axis.
    """
    conservative = pipe.end_held and not (pipe.damping or pipe.hysteresis)
    return 0.0 < _size(pipe) < WEAK and not conservative


def strengthened(pipe: Pipe) -> list[Pipe]:
    """The pipes with stronger gyroscopic force and damping to solve in place of a pipe."""
    flow, delta, mu, size = math.sqrt(pipe.beta), pipe.damping, pipe.hysteresis, _size(pipe)
    factors = [math.sqrt(square) / size for square in SQUARES]
    return [
        replace(pipe, beta=(f * flow) ** 2, damping=f * delta, hysteresis=f * mu) for f in factors
    ]


def extrapolated(pipe: Pipe, found: Sequence[tuple[Crossing, ...]]) -> tuple[Crossing, ...]:
    """Crossings of a pipe from those of the strengthened pipes, which must agree in kind."""
    kinds = [[(c.kind, c.mode, c.unstable_before, c.unstable_after) for c in row] for row in found]
    if any(row != kinds[0] for row in kinds):
        raise NotConverged(
            f"crossings at beta = {pipe.beta:g}, damping = {pipe.damping:g} cannot be extrapolated "
            "from larger values, where they differ in kind or mode",
            found[0],
        )
    x = _size(pipe) ** 2
    # Weights of the solved values in the parabola, and in the line, through them at x.
    parabola, line = (
        np.linalg.solve(np.vander(SQUARES[:n]).T, np.vander([x], n)[0]) for n in (3, 2)
    )
    result = []
    for same in zip(*found, strict=True):
        speeds, frequencies = [c.speed for c in same], [c.frequency for c in same]
        speed = float(np.dot(parabola, speeds))
        curved = abs(speed - float(np.dot(line, speeds[:2])))
        error = curved + float(np.dot(np.abs(parabola), [c.error for c in same]))
        result.append(
            replace(
                same[0],
                speed=speed,
                frequency=float(np.dot(parabola, frequencies)),
                error=error,
                sensitivity=_weakened(pipe, same[0].sensitivity),
            )
        )
    return tuple(result)


def _weakened(pipe: Pipe, sensitivity: Sensitivity | None) -> Sensitivity | None:
    """Sensitivity of a pipe from that of its first strengthened pipe, rescaled by both sizes."""
    if sensitivity is None:
        return None
    solved = strengthened(pipe)[0]
    weaker = _size(solved) / _size(pipe)

    def shrunk(by: Derivatives) -> Derivatives:
        # In u = F(ratio) + beta G, derivatives of F grow as the size shrinks, by beta like
        # 1 / beta. At beta = 0 with one kind of damping there is no ratio, and u is even in it.
        shrinks = [by.beta is None and not other for other in (solved.hysteresis, solved.damping)]
        damping, hysteresis = (
            one * (1.0 / weaker if alone else weaker)
            for one, alone in zip((by.damping, by.hysteresis), shrinks, strict=True)
        )
        beta = by.beta
        if beta is not None:
            across = 0.5 * (by.damping * solved.damping + by.hysteresis * solved.hysteresis)
            beta += across / solved.beta - across / pipe.beta
        return replace(by, beta=beta, damping=damping, hysteresis=hysteresis)

    return Sensitivity(shrunk(sensitivity.speed), shrunk(sensitivity.frequency))
