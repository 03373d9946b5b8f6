# SPDX-License-Identifier: MIT
"""What a computation costs on any machine: right-hand sides and factorisations, counted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass
class Effort:
    """Counts of a computation.

    Attributes:
        right_hand_sides: states at which dy/dt, or its Jacobian, was computed.
        factorisations: matrices factorised, dense eigenvalue problems among them.
    """

    right_hand_sides: int = 0
    factorisations: int = 0


_tally: ContextVar[Effort | None] = ContextVar("effort", default=None)


@contextmanager
def counted() -> Iterator[Effort]:
    """Within, what this thread computes is counted; an inner count keeps its own."""
    effort = Effort()
    token = _tally.set(effort)
    try:
        yield effort
    finally:
        _tally.reset(token)


def factorised(matrices: int = 1) -> None:
    """Counts matrices that were factorised."""
    effort = _tally.get()
    if effort is not None:
        effort.factorisations += matrices


def evaluated(states: int) -> None:
    """Counts states at which the right-hand side was computed."""
    effort = _tally.get()
    if effort is not None:
        effort.right_hand_sides += states
