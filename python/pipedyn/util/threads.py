# SPDX-License-Identifier: MIT
"""One BLAS thread around many small eigenproblems.

Threads of BLAS gain nothing on matrices of a few hundred rows, and where other work shares the
processor they wait for one another: measured, 64 segments up to u = 15 took 39 s with two threads
next to a busy process and 0.5 s with one.

A limit of OpenBLAS with its own threads holds for the whole process, but threadpoolctl lets only
the thread that limited it first change it, and ignores the others: work in a second thread would
stay without the limit, and a limit that the first thread set could not be lifted by the second.
With OpenMP below, a limit holds for the thread that sets it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any

SMALL = 600
"""Rows up to which one thread is used: eigenvalues then take 0.3 s. Measured, on a busy machine two
threads take 1.7 s for as many, and 2 s in place of 0.03 s for 200 rows."""

_lock = threading.Lock()
_inside = 0
_before: list[int] = []


@cache
def _libraries() -> tuple[list[Any], list[Any]]:
    """BLAS libraries with a limit for the process, and those with one for each thread."""
    from threadpoolctl import ThreadpoolController

    import_module("scipy.linalg")  # has a BLAS of its own, and only what is loaded is found
    every = ThreadpoolController().select(user_api="blas").lib_controllers
    own = [one for one in every if getattr(one, "threading_layer", "") == "openmp"]
    return [one for one in every if one not in own], own


def _limit(libraries: list[Any], threads: list[int]) -> list[int]:
    """Sets the numbers of threads; returns those before."""
    before = [one.get_num_threads() for one in libraries]
    for one, number in zip(libraries, threads, strict=True):
        if hasattr(one, "clear_controlling_thread"):
            one.clear_controlling_thread(force=True)
        one.set_num_threads(number)
    return before


@contextmanager
def one_thread(rows: int) -> Iterator[None]:
    """Within, BLAS uses one thread if the matrices are small; nests, and serves many threads."""
    global _inside, _before
    if rows > SMALL:
        yield
        return
    shared, own = _libraries()
    mine = _limit(own, [1] * len(own))
    with _lock:  # first in sets the process' limit, last out lifts it
        if _inside == 0:
            _before = _limit(shared, [1] * len(shared))
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if _inside == 0:
                _limit(shared, _before)
        _limit(own, mine)
