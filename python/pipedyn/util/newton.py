# SPDX-License-Identifier: MIT
"""Newton's method for unknowns of any type, with damping and tests of convergence."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util.archive import saved_as

State = TypeVar("State")


@saved_as("NewtonFailed")
class NewtonFailed(Exception):
    """Newton's method found no solution, for the reason in the message."""


def newton(
    start: State,
    correction: Callable[[State], tuple[Any, float]],
    plus: Callable[[State, Any, float], State] = lambda x, change, share: x + share * change,
    *,
    tolerance: float,
    stagnation: float = 0.0,
    longest: float = math.inf,
    iterations: int = 25,
    patience: int | None = None,
    hopeless: float = math.inf,
    check: Callable[[State], None] = lambda x: None,
) -> State:
    """The solution that Newton's method finds from a start.

    The unknowns may be an array, a number or a periodic orbit.

    `correction` returns Newton's full step from an iterate, and the size of that step. `plus` adds
    a share of the step to the iterate; the share is below 1 if the size exceeds `longest`. The
    iteration ends with a step whose size is at most `tolerance`. A step is slow if it is longer
    than half the one before; a slow step of at most `stagnation` ends the iteration, too, since it
    is due to rounding only. After `patience` slow steps in a row, one slow step of more than
    `hopeless`, or `iterations` steps in all, the method fails.

    Raises:
        NewtonFailed: if a step is not finite, a matrix is singular, `check` raises it for an
            iterate, or steps do not converge.
    """
    state, last, slow = start, math.inf, 0
    for _ in range(iterations):
        with np.errstate(over="raise", invalid="raise"):
            try:
                change, step = correction(state)
                if not math.isfinite(step):
                    raise FloatingPointError
                moved = plus(state, change, min(1.0, longest / step) if step > 0.0 else 1.0)
            except LinAlgError as error:
                raise NewtonFailed("Newton's method met a singular matrix") from error
            except (FloatingPointError, ValueError) as error:
                raise NewtonFailed("Newton's method met numbers that are not finite") from error
        check(moved)
        slowly = step >= 0.5 * last
        if slowly and step > hopeless:
            break
        if step <= tolerance or (slowly and step <= stagnation):
            return moved
        slow = slow + 1 if slowly else 0
        if slow == patience:
            break
        state, last = moved, step
    raise NewtonFailed("Newton's method did not converge")
