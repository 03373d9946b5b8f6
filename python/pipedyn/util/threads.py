# SPDX-License-Identifier: MIT
"""One BLAS thread around many small eigenproblems.

Several threads of BLAS are not faster on matrices of a few hundred rows, and if other work shares
the processor they wait for one another. For example, the eigenvalues of 64 segments up to u = 15
took 39 s with two threads next to a busy process, and 0.5 s with one.

If OpenBLAS has threads of its own, a limit on their number holds for the whole process. But
threadpoolctl lets only the thread that set the first limit change it, and ignores others: work in a
second thread would stay without a limit, and the second thread could not lift a limit that the
first one set. If OpenBLAS uses OpenMP, a limit holds for the thread that sets it.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any

SMALL = 600
"""Number of rows up to which one thread is used: the eigenvalues of a matrix of this size take
0.3 s. On a busy machine two threads took 1.7 s for them, and for 200 rows 2 s instead of 0.03 s."""

_lock = threading.Lock()
_inside = 0
_before: list[int] = []


@cache
def _libraries() -> tuple[list[Any], list[Any]]:
    """BLAS libraries with a limit for the whole process, and those with one for each thread."""
    from threadpoolctl import ThreadpoolController

    import_module("scipy.linalg")  # its own BLAS is found only after scipy.linalg is loaded
    every = ThreadpoolController().select(user_api="blas").lib_controllers
    own = [one for one in every if getattr(one, "threading_layer", "") == "openmp"]
    return [one for one in every if one not in own], own


def _limit(libraries: list[Any], threads: list[int]) -> list[int]:
    """Sets the number of threads of each library; returns the numbers before."""
    before = [one.get_num_threads() for one in libraries]
    for one, number in zip(libraries, threads, strict=True):
        if hasattr(one, "clear_controlling_thread"):
            one.clear_controlling_thread(force=True)
        one.set_num_threads(number)
    return before


@contextmanager
def one_thread(rows: int) -> Iterator[None]:
    """Makes BLAS use one thread in a `with` block if matrices have at most `SMALL` rows.

    Blocks may be nested, and several threads may be in such blocks at the same time.
    """
    global _inside, _before
    if rows > SMALL:
        yield
        return
    shared, own = _libraries()
    mine = _limit(own, [1] * len(own))
    with _lock:  # the first block sets the limit of the process, and the last one removes it
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
