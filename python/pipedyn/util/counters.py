# SPDX-License-Identifier: MIT
"""What a computation costs: right-hand sides and factorisations, counted; and its time, limited."""

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
"""Seconds of this thread's work, which others on the machine hardly move; Windows counts them in
steps of 16 ms, and there it is the time that passes."""


@saved_as("TookTooLong")
class TookTooLong(Exception):
    """A computation that came to the end of its time; no failure of a search, which would go on."""


@dataclass
class Counters:
    """States at which dy/dt or its Jacobian was computed, and matrices that were factorised.

    A dense eigenvalue problem counts as a factorisation.
    """

    right_hand_sides: int = 0
    factorisations: int = 0


_unasked = Counters()  # what nobody asked to count
_tally: ContextVar[Counters] = ContextVar("counters", default=_unasked)
_end: ContextVar[tuple[float, str]] = ContextVar("end", default=(math.inf, ""))


@contextmanager
def counted() -> Iterator[Counters]:
    """Within, what this thread computes is counted; an inner count keeps its own."""
    counters = Counters()
    token = _tally.set(counters)
    try:
        yield counters
    finally:
        _tally.reset(token)


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Within, this thread computes for so many seconds at most; an outer limit holds as well.

    TookTooLong is raised at the next right-hand side or factorisation after that; integrators ask
    now and then only.
    """
    token = _end.set(min(_end.get(), (clock() + seconds, f"it took more than {seconds:.3g} s")))
    try:
        yield
    finally:
        _end.reset(token)


def in_time() -> None:
    """Asks whether there is time left."""
    end, message = _end.get()
    if end < math.inf and clock() > end:
        raise TookTooLong(message)


def factorised(matrices: int = 1) -> None:
    """Counts matrices that were factorised."""
    in_time()
    _tally.get().factorisations += matrices


def evaluated(states: int) -> None:
    """Counts states at which the right-hand side was computed."""
    in_time()
    _tally.get().right_hand_sides += states
