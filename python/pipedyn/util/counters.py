# SPDX-License-Identifier: MIT
"""Counts of the right-hand sides and factorisations of a computation, and limits of its time."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from pipedyn.util.archive import saved_as

clock: Callable[[], float] = time.perf_counter if os.name == "nt" else time.thread_time
"""Processor time of this thread in seconds, on which other work on the machine has little effect.
Windows counts processor time in steps of 16 ms, so wall-clock time is used there."""


@saved_as("TookTooLong")
class TookTooLong(Exception):
    """A computation exceeded its time; unlike a failure of one step, this ends the whole of it."""


@dataclass
class Counters:
    """Numbers of states at which dy/dt or its Jacobian was computed, and of factorised matrices.

    A dense eigenvalue problem counts as a factorisation.
    """

    right_hand_sides: int = 0
    factorisations: int = 0


_outside = Counters()  # takes the counts outside all `count_work` blocks
_tally: ContextVar[Counters] = ContextVar("counters", default=_outside)
_end: ContextVar[tuple[float, str]] = ContextVar("end", default=(math.inf, ""))


@contextmanager
def count_work() -> Iterator[Counters]:
    """Counts the computations of this thread in a `with` block, except those in inner blocks."""
    counters = Counters()
    token = _tally.set(counters)
    try:
        yield counters
    finally:
        _tally.reset(token)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Limits the time of this thread in a `with` block; the limit of an outer block holds as well.

    TookTooLong is raised at the first right-hand side or factorisation after that time; integrators
    check the time only now and then.
    """
    token = _end.set(min(_end.get(), (clock() + seconds, f"it took more than {seconds:.3g} s")))
    try:
        yield
    finally:
        _end.reset(token)


def check_time() -> None:
    """Raises TookTooLong if the time limit of this thread has passed."""
    end, message = _end.get()
    if end < math.inf and clock() > end:
        raise TookTooLong(message)


def count_factorisations(matrices: int = 1) -> None:
    """Counts matrices that were factorised."""
    check_time()
    _tally.get().factorisations += matrices


def count_right_hand_sides(states: int) -> None:
    """Counts states at which the right-hand side was computed."""
    check_time()
    _tally.get().right_hand_sides += states
