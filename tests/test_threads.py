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
import scipy.linalg
import threadpoolctl
from threadpoolctl import threadpool_info, threadpool_limits

import pipedyn as pp
from pipedyn.util.parallel import SMALL, one_thread


def blas_threads() -> set[int]:
    return {found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    """The main thread sets two threads, and so it owns threadpoolctl's limit."""
    scipy.linalg.inv(np.eye(2))  # which loads a BLAS of its own
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


def compute(inside, segments=2):
    """Finds a Hopf point, of a scene whose law calls a function once in the midst of it."""
    calls, begun = itertools.count(), []

    def force(q, qdot):
        if begun and next(calls) == 20:
            inside()
        return -q

    law = pp.modular.Custom(joints=(1,), force=force)
    scene = pp.modular.chain(pp.Pipe(0.2), segments).plus(law)
    begun.append(True)
    pp.hopf(scene)
    assert next(calls) > 20


class Held:
    """A computation in the thread of a pool, held in its midst until it may go on."""

    def __init__(self, pool, look=blas_threads):
        self.entered, self.leaving, self.look = threading.Event(), threading.Event(), look
        self.done = pool.submit(compute, self.hold)
        assert self.entered.wait(60.0)

    def hold(self):
        self.entered.set()
        assert self.leaving.wait(60.0)
        self.seen = self.look()

    def leave(self):
        self.leaving.set()
        self.done.result(60.0)


def test_a_worker_s_limit_holds_though_the_main_thread_set_one_first(pools):
    seen = []
    do(pools[0], lambda: compute(lambda: seen.append(blas_threads())))
    assert seen == [{1}]
    assert blas_threads() == {2}


@pytest.mark.parametrize("leaving", [*itertools.permutations(range(3))])
def test_the_last_thread_that_leaves_restores_what_the_first_found(pools, leaving):
    entered = []
    for pool in pools:
        entered.append(Held(pool))
        assert blas_threads() == {1}
    for i in leaving:
        assert blas_threads() == {1}
        entered[i].leave()
    assert blas_threads() == {2}
    # And the next round works alike: nothing is left behind by threads of the first.
    seen = []
    compute(lambda: seen.append(blas_threads()))
    assert (seen, blas_threads()) == ([{1}], {2})


def test_limits_nest_within_a_thread_and_end_with_an_exception(pools):
    def within():
        compute(lambda: None)
        assert blas_threads() == {1}
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        do(pools[0], lambda: compute(within))
    assert blas_threads() == {2}


def test_large_matrices_keep_their_threads():
    with one_thread(SMALL + 1):
        assert blas_threads() == {2}


def test_libraries_are_searched_once(pools, monkeypatch):
    searched = []
    monkeypatch.setattr(threadpoolctl, "ThreadpoolController", lambda: searched.append(1))
    for pool in pools:
        do(pool, lambda: pp.critical_speed(pp.Chain(pp.Pipe(0.2), 3)))
    assert not searched


def printed(program):
    """Lines that a program prints in a process of its own, with two threads of BLAS."""
    path = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    settings = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "PYTHONPATH": path}
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=settings)
    return done.stdout.splitlines()


def test_scipy_s_library_is_limited_though_the_package_imports_it_late():
    program = """
from threadpoolctl import threadpool_info
import pipedyn as pp
seen = []
def force(q, qdot):
    if seen:
        import scipy.linalg
        found = threadpool_info()
        seen.append({one["num_threads"] for one in found if one["user_api"] == "blas"})
    return -q
law = pp.modular.Custom(joints=(1,), force=force)
scene = pp.modular.chain(pp.Pipe(0.2), 2).plus(law)
pp.eigenvalues(pp.Chain(pp.Pipe(0.2), 3), 1.0)
seen.append({})
pp.hopf(scene)
print({1} in seen)
"""
    assert printed(program) == ["True"]


def test_a_limit_of_each_thread_is_set_in_each():
    """As of BLAS over OpenMP: a thread's own number, which no other thread sets or lifts."""
    program = """
import threading, threadpoolctl
from concurrent.futures import ThreadPoolExecutor
class Library:
    threading_layer, number = "openmp", threading.local()
    def get_num_threads(self):
        return getattr(self.number, "value", 4)
    def set_num_threads(self, number):
        self.number.value = number
class Controller:
    lib_controllers = [library := Library()]
    def select(self, **asked):
        return self
threadpoolctl.ThreadpoolController, look = Controller, Controller.library.get_num_threads
from test_threads import Held, do
pools = [ThreadPoolExecutor(1) for _ in range(3)]
print(*(do(pool, look) for pool in pools))
held = [Held(pool, look) for pool in pools]
for one in held:
    one.leave()
print(*(one.seen for one in held), *(do(pool, look) for pool in pools))
"""
    assert printed(program) == ["4 4 4", "1 1 1 4 4 4"]


def test_another_thread_runs_while_the_core_solves():
    """Python would change threads on its own only after a minute."""
    model = pp.Galerkin(pp.Pipe(0.2), 150)
    begun, done = threading.Event(), threading.Event()

    def solve():
        begun.set()
        pp.eigenvalues(model, 3.0)
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
