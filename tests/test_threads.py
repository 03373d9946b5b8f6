"""One BLAS thread within, as many as before after: whichever threads enter and leave, in any order.

The numbers asked of BLAS are what is asserted, and no time.
"""

import itertools
import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import threadpoolctl
from threadpoolctl import threadpool_info, threadpool_limits

import pipedyn as pp
from pipedyn import _core
from pipedyn.util import parallel as threads


def blas_threads() -> set[int]:
    return {found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    """The main thread sets two threads, and so it owns threadpoolctl's limit."""
    with threadpool_limits(2, user_api="blas"):
        if blas_threads() != {2}:
            pytest.skip("BLAS without threads")
        yield


@pytest.fixture
def pools():
    """Three threads, each of which does one thing at a time."""
    executors = [ThreadPoolExecutor(1) for _ in range(3)]
    yield executors
    for executor in executors:
        executor.shutdown()


def do(pool, work):
    return pool.submit(work).result(timeout=60.0)


def test_a_worker_s_limit_holds_though_the_main_thread_set_one_first(pools):
    def within():
        with threads.one_thread(10):
            return blas_threads()

    assert do(pools[0], within) == {1}
    assert blas_threads() == {2}


@pytest.mark.parametrize("leaving", [*itertools.permutations(range(3))])
def test_the_last_thread_that_leaves_restores_what_the_first_found(pools, leaving):
    entered = []
    for pool in pools:
        entered.append(threads.one_thread(10))
        do(pool, entered[-1].__enter__)
        assert blas_threads() == {1}
    for i in leaving:
        assert blas_threads() == {1}
        do(pools[i], lambda i=i: entered[i].__exit__(None, None, None))
    assert blas_threads() == {2}
    # And the next round works alike: nothing is left behind by threads of the first.
    with threads.one_thread(10):
        assert blas_threads() == {1}
    assert blas_threads() == {2}


def test_limits_nest_within_a_thread_and_end_with_an_exception(pools):
    def within():
        with threads.one_thread(10):
            with threads.one_thread(10):
                pass
            assert blas_threads() == {1}
            raise KeyError

    with pytest.raises(KeyError):
        do(pools[0], within)
    assert blas_threads() == {2}


def test_large_matrices_keep_their_threads():
    with threads.one_thread(threads.SMALL + 1):
        assert blas_threads() == {2}


def test_libraries_are_searched_once(pools, monkeypatch):
    searched = []
    monkeypatch.setattr(threadpoolctl, "ThreadpoolController", lambda: searched.append(1))
    for pool in pools:
        do(pool, lambda: pp.critical_speed(pp.Chain(pp.Pipe(0.2), 3)))
    assert not searched


def test_scipy_s_library_is_limited_though_the_package_imports_it_late():
    program = """
from threadpoolctl import threadpool_info
import pipedyn as pp
from pipedyn.util import parallel as threads
with threads.one_thread(10):
    pp.critical_speed(pp.Galerkin(pp.Pipe(0.2), 3))
    print(*{found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"})
"""
    words = [sys.executable, "-c", program]
    settings = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=settings)
    assert done.stdout.split() == ["1"]


def test_a_limit_of_each_thread_is_set_in_each(pools, monkeypatch):
    """As of BLAS over OpenMP: a thread's own number, which no other thread sets or lifts."""

    class Library:
        number = threading.local()

        def get_num_threads(self):
            return getattr(self.number, "value", 4)

        def set_num_threads(self, number):
            self.number.value = number

    library = Library()
    monkeypatch.setattr(threads, "_libraries", lambda: ([], [library]))
    entered = [threads.one_thread(10) for _ in pools]
    for pool, one in zip(pools, entered, strict=True):
        assert do(pool, library.get_num_threads) == 4
        do(pool, one.__enter__)
        assert do(pool, library.get_num_threads) == 1
    for pool, one in zip(pools, entered, strict=True):
        do(pool, lambda one=one: one.__exit__(None, None, None))
        assert do(pool, library.get_num_threads) == 4


def test_another_thread_runs_while_the_core_solves():
    """Python would change threads on its own only after a minute."""
    matrices = [*np.random.default_rng(0).standard_normal((5, 150, 150)), np.zeros((0, 0))]
    traits = _core.Traits(150, 0.0, 1e-9, True, False, False, False, 0.0)
    problem = _core.Eigenproblem(traits, matrices, 1.0, 1.0)
    begun, done = threading.Event(), threading.Event()

    def solve():
        begun.set()
        problem.lowest(0.0, 300, left=True, high=True)
        done.set()

    interval = sys.getswitchinterval()
    sys.setswitchinterval(60.0)
    try:
        worker = threading.Thread(target=solve)
        worker.start()
        begun.wait()
        beside = not done.is_set()
        worker.join()
    finally:
        sys.setswitchinterval(interval)
    assert beside


def test_a_search_in_the_core_is_interrupted_as_python_is(interrupted_after):
    model = pp.Galerkin(pp.Pipe(0.2), 100)
    caught = interrupted_after(0.1, lambda: pp.crossings(model, 40.0))  # which takes seconds
    assert "_run_searches" in [entry.name for entry in caught.traceback]
