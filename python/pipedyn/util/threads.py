# SPDX-License-Identifier: MIT
"""One BLAS thread around many small eigenproblems.

Threads of BLAS gain nothing on matrices of a few hundred rows, and where other work shares the
processor they wait for one another: measured, 64 segments up to u = 15 took 39 s with two threads
beside a busy process and 0.5 s with one.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController

SMALL = 600
"""Rows up to which one thread is used."""

_lock = threading.Lock()
_inside = 0
_limit: Any = None


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_thread(rows: int) -> Iterator[None]:
    """Within, BLAS uses one thread if the matrices are small; nests, and serves many threads."""
    global _inside, _limit
    if rows > SMALL:
        yield
        return
    with _lock:  # the limit is the process': first in sets it, last out lifts it
        if _inside == 0:
            _limit = _controller().limit(limits=1, user_api="blas")
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _limit.restore_original_limits()
