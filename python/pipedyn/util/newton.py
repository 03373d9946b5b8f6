# SPDX-License-Identifier: MIT
"""Newton's method for unknowns of any type, and zeros between places of different signs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

State = TypeVar("State")

MOST_PLACES, PLACE_ERROR = 100, 1e-12
"""Largest number of places at which a function is evaluated in search of a zero, which mostly takes
seven; bisection alone takes 40. Largest error of the place of the zero."""


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
    `hopeless`, a first step of four times that, or `iterations` steps in all, the method fails.

    Raises:
        NewtonFailed: if a step is not finite, a matrix is singular, `check` raises it for an
            iterate, or steps do not converge.
    """
    state, last, slow = start, 8.0 * hopeless, 0  # a first step may be slow, too
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


def zeros_between(
    values: Callable[[Array], Array],
    low: Array,
    high: Array,
    below: Array,
    above: Array,
    error: float = PLACE_ERROR,
) -> Array:
    """Zeros of k functions, each between two places where its values differ in sign, shape (k,).

    Places are found by inverse quadratic interpolation where the last three show a function that is
    smooth enough, and by bisection elsewhere.

    Args:
        values: values (k,) of the functions at places (k,).
        low: the place on one side of each zero.
        high: the place on the other side.
        below: values at `low`.
        above: values at `high`.
        error: largest error of the places, beyond rounding.

    Source: Chandrupatla (1997), A new hybrid quadratic/bisection algorithm for finding the zero of
    a nonlinear function without using derivatives.
    """
    # The zero lies between a and b; c is the place before these. Fractions of 0 are not used.
    a, b, c, at_a, at_b, at_c = high, low, low, above, below, below
    share = at_a / np.where(at_a == at_b, 1.0, at_a - at_b)
    for _ in range(MOST_PLACES):
        best = np.where(np.abs(at_a) < np.abs(at_b), a, b)
        allowed = 0.5 * np.maximum(error, 4.0 * np.finfo(float).eps * np.abs(best))
        least = allowed / np.maximum(np.abs(b - a), allowed)
        done = (least > 0.5) | (at_a == 0.0) | (at_b == 0.0)
        if done.all():
            break
        x = np.where(done, best, a + np.clip(share, least, 1.0 - least) * (b - a))
        found = values(x)
        same = (found > 0.0) == (at_a > 0.0)
        b, c = np.where(same, b, a), np.where(same, a, b)
        at_b, at_c = np.where(same, at_b, at_a), np.where(same, at_a, at_b)
        a, at_a = x, found
        with np.errstate(divide="ignore", invalid="ignore"):
            place, value = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
            smooth = (value**2 < place) & ((1.0 - value) ** 2 < 1.0 - place)
            curved = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            curved += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
        share = np.where(smooth, curved, 0.5)
    return best


def zero_between(
    value: Callable[[float], float], low: float, high: float, error: float = PLACE_ERROR
) -> float:
    """The zero of a function between two places where its values differ in sign.

    error: as for `zeros_between`.
    """
    below, above = (np.array([value(at)]) for at in (low, high))
    ends = np.array([low]), np.array([high]), below, above
    found = zeros_between(lambda at: np.array([value(float(at[0]))]), *ends, error)
    return float(found[0])
