# SPDX-License-Identifier: MIT
"""Newton's method: one loop, whatever the unknowns, with damping and with tests of convergence."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

State = TypeVar("State")


class NewtonFailed(Exception):
    """Newton's method that found no solution: the reason.

    Attributes:
        state: the last iterate, None where there is none.
    """

    def __init__(self, message: str, state: Any = None) -> None:
        super().__init__(message)
        self.state = state


@dataclass(frozen=True)
class Solution(Generic[State]):
    """What Newton's method found.

    Attributes:
        state: the solution.
        step: size of the last step, which measures the error.
        iterations: number of steps.
    """

    state: State
    step: float
    iterations: int


def newton(
    start: State,
    correction: Callable[[State], tuple[Any, float]],
    plus: Callable[[State, Any, float], State] = lambda x, change, share: x + share * change,
    *,
    tolerance: float,
    stagnation: float = 0.0,
    slower: float = 0.5,
    keep: bool = False,
    longest: float = math.inf,
    iterations: int = 25,
    patience: int | None = None,
    scale: Callable[[State], float] = lambda x: 1.0,
    check: Callable[[State], None] = lambda x: None,
) -> Solution[State]:
    """A solution near a start.

    The unknowns may be of any type: an array, a number, a periodic orbit.

    Args:
        start: where to begin.
        correction: Newton's step from an iterate, in full, and its size.
        plus: an iterate and a share of a step; their sum where not given.
        tolerance: steps up to this size, times `scale`, end the iteration.
        stagnation: so do steps up to this size, times `scale`, that are no longer shorter than
            `slower` times the one before: that is rounding.
        slower: see `stagnation` and `patience`.
        keep: whether the iterate before the last step is returned, and not the one after it.
        longest: size beyond which a step is shortened to it.
        iterations: steps at most.
        patience: number of steps in a row, each longer than `slower` times the one before, after
            which the iteration is given up; never where not given.
        scale: size of the solution.
        check: raises `NewtonFailed` for iterates that are not to be followed.

    Returns:
        Solution.

    Raises:
        NewtonFailed: if a step is not finite, a matrix is singular, `check` refuses an iterate, or
            steps do not converge.
    """
    state, last, slow = start, math.inf, 0
    for iteration in range(1, iterations + 1):
        with np.errstate(over="raise", invalid="raise"):
            try:
                change, step = correction(state)
                if not math.isfinite(step):
                    raise FloatingPointError
                moved = plus(state, change, min(1.0, longest / step) if step > 0.0 else 1.0)
            except LinAlgError as error:
                raise NewtonFailed("Newton's method met a singular matrix", state) from error
            except (FloatingPointError, ValueError) as error:
                raise NewtonFailed("Newton's method left finite numbers", state) from error
        check(moved)
        size = scale(moved)
        slowly = step >= slower * last
        if step <= tolerance * size or (slowly and step <= stagnation * size):
            return Solution(state if keep else moved, step, iteration)
        slow = slow + 1 if slowly else 0
        if slow == patience:
            break
        state, last = moved, step
    raise NewtonFailed("Newton's method did not converge", state)
