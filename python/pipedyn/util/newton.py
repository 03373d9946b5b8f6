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
    """Why Newton's method found no solution, with the last iterate, `state`, if there is one."""

    def __init__(self, message: str, state: Any = None) -> None:
        super().__init__(message)
        self.state = state


@dataclass(frozen=True)
class Solution(Generic[State]):
    """What Newton's method found; the size of its last step measures the error."""

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
    longest: float = math.inf,
    iterations: int = 25,
    patience: int | None = None,
    scale: Callable[[State], float] = lambda x: 1.0,
    check: Callable[[State], None] = lambda x: None,
) -> Solution[State]:
    """A solution near a start; the unknowns may be an array, a number, a periodic orbit.

    `correction` gives Newton's step from an iterate, in full, and its size; `plus` adds a share of
    it, less than all where the size is beyond `longest`. Steps up to `tolerance` times the `scale`
    of the solution end the iteration. A step is slow if it is longer than `slower` times the one
    before: then `stagnation` times the scale is enough, as steps are rounding. `patience` slow
    steps in a row, or `iterations` in all, end it without a solution.

    Raises:
        NewtonFailed: if a step is not finite, a matrix is singular, `check` raises it for an
            iterate, or steps do not converge.
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
                raise NewtonFailed(
                    "Newton's method met numbers that are not finite", state
                ) from error
        check(moved)
        size = scale(moved)
        slowly = step >= slower * last
        if step <= tolerance * size or (slowly and step <= stagnation * size):
            return Solution(moved, step, iteration)
        slow = slow + 1 if slowly else 0
        if slow == patience:
            break
        state, last = moved, step
    raise NewtonFailed("Newton's method did not converge", state)
