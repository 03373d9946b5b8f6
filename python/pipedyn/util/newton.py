# SPDX-License-Identifier: MIT
"""Newton's method for unknowns of any type, and zeros between places of different signs."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from typing import Any, TypeVar

import numpy as np
from numpy.linalg import LinAlgError

from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

State = TypeVar("State")

MOST_PLACES, PLACE_ERROR = 100, 1e-12
"""Largest number of places at which a function is evaluated in search of a zero, which mostly takes
seven; bisection alone takes 40. Largest error of the place of the zero."""

EPSILON = float(np.finfo(float).eps)
"""Distance from 1 to the next larger number."""


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
    farthest: float = math.inf,
    check: Callable[[State], None] = lambda x: None,
) -> State:
    """The solution that Newton's method finds from a start.

    The unknowns may be an array, a number or a periodic orbit.

    `correction` returns Newton's full step from an iterate, and the size of that step. `plus` adds
    a share of the step to the iterate; the share is below 1 if the size exceeds `longest`. The
    iteration ends with a step whose size is at most `tolerance`. A step is slow if it is longer
    than half the one before; a slow step of at most `stagnation` ends the iteration, too, since it
    is due to rounding only. After `patience` slow steps in a row, one slow step of more than
    `hopeless`, a first step of more than `farthest`, or `iterations` steps in all, it fails.

    Raises:
        NewtonFailed: if a step is not finite, a matrix is singular, `check` raises it for an
            iterate, or steps do not converge.
    """
    state, last, slow = start, math.inf, 0
    for done in range(iterations):
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
        if (slowly and step > hopeless) or (done == 0 and step > farthest):
            break
        if step <= tolerance or (slowly and step <= stagnation):
            return moved
        slow = slow + 1 if slowly else 0
        if slow == patience:
            break
        state, last = moved, step
    raise NewtonFailed("Newton's method did not converge")


def _search(
    error: float, low: float, high: float, below: float, above: float
) -> Generator[tuple[float, bool], float, None]:
    """Places at which to evaluate a function, from which it gets the values, in search of a zero.

    After each place it says whether that is the zero. The arguments are as for `zeros_between`.
    """
    # The zero lies between a and b; c is the place before these.
    a, b, c, at_a, at_b, at_c = high, low, low, above, below, below
    share = at_a / ((at_a - at_b) or 1.0)
    for _ in range(MOST_PLACES):
        best = a if abs(at_a) < abs(at_b) else b
        allowed = 0.5 * max(error, 4.0 * EPSILON * abs(best))
        least = allowed / max(abs(b - a), allowed)
        if least > 0.5 or at_a == 0.0 or at_b == 0.0:
            break
        x = a + min(max(share, least), 1.0 - least) * (b - a)
        found = yield x, False
        if (found > 0.0) == (at_a > 0.0):
            c, at_c = a, at_a
        else:
            b, c, at_b, at_c = a, b, at_a, at_b
        a, at_a, share = x, found, 0.5
        place, value = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        if value * value < place and (1.0 - value) * (1.0 - value) < 1.0 - place:
            share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
            share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
    while True:
        yield best, True


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
    given = np.stack([low, high, below, above], axis=1).tolist()
    searches = [_search(error, *each) for each in given]
    steps = [next(search) for search in searches]
    while not all(done for _, done in steps):
        found = values(np.array([place for place, _ in steps])).tolist()
        steps = [search.send(value) for search, value in zip(searches, found, strict=True)]
    return np.array([place for place, _ in steps], dtype=np.float64)


def zero_between(
    value: Callable[[float], float], low: float, high: float, error: float = PLACE_ERROR
) -> float:
    """The zero of a function between two places where its values differ in sign.

    error: as for `zeros_between`.
    """
    search = _search(error, low, high, value(low), value(high))
    place, done = next(search)
    while not done:
        place, done = search.send(value(place))
    return place
