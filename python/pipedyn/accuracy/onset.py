# SPDX-License-Identifier: MIT
"""Where a model's flutter sets in, tracked from the onset of another model: no search.

It finds what a search would find at a tenth of its cost, but not that nothing comes before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.models.base import Model
from pipedyn.models.pencil import Vectors

MOST_STEPS = 12
"""Of Newton's method; a good guess takes two."""

FARTHEST = 3.0
"""Factor by which the speed may leave its guess."""


@dataclass(frozen=True)
class Onset:
    """An eigenvalue on the imaginary axis.

    Attributes:
        speed: u.
        frequency: angular, in 1 / T.
        error: of the speed, absolute, by residual and rounding.
    """

    speed: float
    frequency: float
    error: float


def onset_near(model: Model, speed: float, frequency: float) -> Onset | None:
    """The crossing into flutter next to a speed and a frequency; None where Newton's method fails.

    Args:
        model: any.
        speed: guess of u, > 0.
        frequency: guess of the frequency there.
    """
    problem = eigenproblem(model)
    u, value = speed, complex(0.0, frequency)
    vector: Vectors | None = None
    last = np.inf
    for _ in range(MOST_STEPS):
        pair = problem.refine(u, value, vector)
        assert pair.left is not None
        slope = complex(problem.slopes(u, pair)[0])
        value = complex(pair.values[0])
        if not (slope.real > 0.0 and pair.converged[0]):
            return None
        change = -value.real / slope.real
        if abs(change) <= 1e-14 * u or abs(change) >= last < 1e-9 * u:
            uncertain = float(problem.uncertainties(u, pair)[0]) + abs(value.real)
            return Onset(u, abs(value.imag), uncertain / slope.real)
        u, value, vector = u + change, value + slope * change, pair.right[:, 0]
        if not speed / FARTHEST < u < speed * FARTHEST or value.imag <= 0.0:
            return None
        last = abs(change)
    return None
