# SPDX-License-Identifier: MIT
"""Independent jobs in this thread or in an executor, progress on stderr, and threads of BLAS.

One thread of BLAS is used for many small eigenproblems. Several threads of BLAS are not faster on
matrices of a few hundred rows, and if other work shares the processor they wait for one another.
For example, the eigenvalues of 64 segments up to u = 15 took 39 s with two threads next to a busy
process, and 0.5 s with one.

If OpenBLAS has threads of its own, a limit on their number holds for the whole process. But
threadpoolctl lets only the thread that set the first limit change it, and ignores others: work in a
second thread would stay without a limit, and the second thread could not lift a limit that the
first one set. So OpenBLAS is told itself. If it uses OpenMP, a limit holds for the thread that sets
it.
"""

from __future__ import annotations

import gc
import math
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache, partial
from itertools import product
from shutil import get_terminal_size
from time import monotonic
from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeVar

from pipedyn.util.lapack import library

if TYPE_CHECKING:
    from concurrent import futures

SMALL = 600
"""Number of rows up to which one thread is used: the eigenvalues of a matrix of this size take
0.3 s. On a busy machine two threads took 1.7 s for them, and for 200 rows 2 s instead of 0.03 s."""

LEAST_PAUSE = 0.1
"""Least time in s between two writings of a line of progress."""

LINES_OF_PACE = 20
"""Number of the last lines of progress from whose pace the time left follows."""

LONGEST_LEFT = 1e6
"""Longest time left that is told, in s: a slower pace is none."""

LEAST_DONE = 1e-3
"""Least share of which the pace says something: first steps may be far smaller than later ones."""

_lock = threading.Lock()
_inside = 0
_before: list[int] = []


Limit: TypeAlias = tuple[Callable[[], int], Callable[[int], Any]]
"""Functions that return and set the number of threads of a BLAS library."""


@cache
def _libraries() -> tuple[list[Limit], list[Limit]]:
    """BLAS libraries with a limit for the whole process, and those with one for each thread."""
    from threadpoolctl import ThreadpoolController

    library("cython_blas")  # SciPy's own BLAS is found only after it is loaded
    every = ThreadpoolController().select(user_api="blas").lib_controllers
    own = [one for one in every if getattr(one, "threading_layer", "") == "openmp"]
    shared = [_limit_of(one) for one in every if one not in own]
    return shared, [(one.get_num_threads, one.set_num_threads) for one in own]


def _limit_of(one: Any) -> Limit:
    """The functions of a library that threadpoolctl found.

    They are OpenBLAS' own, which are ten times as fast as threadpoolctl's and obey every thread.
    """
    for prefix, suffix in product(("", "scipy_"), ("", "64_", "_64")):
        names = (f"{prefix}openblas_{verb}_num_threads{suffix}" for verb in ("get", "set"))
        get, set_to = (getattr(one.dynlib, name, None) for name in names)
        if get and set_to:
            return get, set_to
    return one.get_num_threads, one.set_num_threads


def _limit(libraries: list[Limit], threads: list[int]) -> list[int]:
    """Sets the number of threads of each library; returns the numbers before."""
    before = []
    for (get, set_to), number in zip(libraries, threads, strict=True):
        before.append(get())
        set_to(number)
    return before


class _OneThread:
    """A `with` block in which BLAS uses one thread."""

    def __enter__(self) -> None:
        global _inside, _before
        shared, own = _libraries()
        self.mine = _limit(own, [1] * len(own)) if own else []
        with _lock:  # the first block sets the limit of the process, and the last one removes it
            if _inside == 0:
                _before = _limit(shared, [1] * len(shared))
            _inside += 1

    def __exit__(self, *_: object) -> None:
        global _inside
        shared, own = _libraries()
        with _lock:
            _inside -= 1
            if _inside == 0:
                _limit(shared, _before)
        if own:
            _limit(own, self.mine)


def one_thread(rows: int) -> AbstractContextManager[None]:
    """Makes BLAS use one thread in a `with` block if matrices have at most `SMALL` rows.

    Blocks may be nested, and several threads may be in such blocks at the same time.
    """
    return _OneThread() if rows <= SMALL else nullcontext()


class NoCollection:
    """A `with` block in which Python does not look for garbage in cycles."""

    def __enter__(self) -> None:
        self.was_enabled = gc.isenabled()
        gc.disable()

    def __exit__(self, *_: object) -> None:
        if self.was_enabled:
            gc.enable()


Item = TypeVar("Item")
Returned = TypeVar("Returned")
Job = Callable[[], Returned]
"""A function without arguments. It must allow pickling, as a `functools.partial` of a function of a
module does, so that it can run in any process."""


def progress_visible() -> bool:
    """Whether somebody can read stderr, because it goes to a terminal or a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def clock_face(seconds: float) -> str:
    """A duration as minutes and seconds, or as hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Progress:
    """A line on stderr that says what share of some work is done, and how long the rest may take.

    It is used in a `with` block, at whose end it says 100 % and the time taken; an exception leaves
    the line as it is. The time left follows from the pace of the last lines, and is not told before
    there is a pace. Nothing is written if `shown` is False or nobody can read stderr.
    """

    def __init__(self, label: str, shown: bool) -> None:
        self.label, self.shown = label, shown and progress_visible()
        self.share, self.count = 0.0, ""
        self.marks = deque([(monotonic(), 0.0)], maxlen=LINES_OF_PACE) if self.shown else deque()
        self.begun, self.width = self.marks[0][0] if self.shown else 0.0, 0

    def __enter__(self) -> Self:
        return self

    def to(self, share: float, count: str = "") -> None:
        """Notes the share that is done, from 0 to 1, and shows it at most ten times a second.

        A smaller share than before counts as the same one; `count` is said beside it.
        """
        if not self.shown:
            return
        self.share, self.count = max(self.share, min(share, 1.0)), count
        now, (then, before) = monotonic(), self.marks[0]
        if self.width and now - self.marks[-1][0] < LEAST_PAUSE:
            return
        self.marks.append((now, self.share))
        gained = self.share - before
        left = (1.0 - self.share) * (now - then) / gained if gained > 0.0 else math.inf
        paced = self.share >= LEAST_DONE and left < LONGEST_LEFT
        told = f", about {clock_face(left)} left" if paced else ""
        self._write(min(math.floor(100.0 * self.share), 99), told)

    def steps(self, every: Iterable[Item], share: Callable[[Item], float]) -> Iterator[Item]:
        """Yields steps whose number nobody knows; `share` gives what is done after a step."""
        for done, step in enumerate(every, start=1):
            yield step
            if self.shown:
                self.to(share(step), f"{done} steps")

    def _write(self, percent: int, told: str) -> None:
        said = f": {percent} %{self.count and f', {self.count}'}{told}"
        room = max(get_terminal_size().columns - 1 - len(said), 0)  # a longer line would not stay
        line = self.label[:room] + said
        print(f"\r{line:{self.width}}", end="", file=sys.stderr, flush=True)
        self.width = len(line)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self.shown and kind is None:
            self._write(100, f", took {clock_face(monotonic() - self.begun)}")
        if self.width:
            print(file=sys.stderr)


def track(items: Iterable[Item], total: int, label: str, shown: bool) -> Iterator[Item]:
    """Yields the items, of which there are `total`, and shows how many are done; see `Progress`."""
    with Progress(label, shown and total > 0) as progress:
        if not progress.shown:
            yield from items
            return
        for done, item in enumerate(items, start=1):
            yield item
            progress.to(done / total, f"{done}/{total}")


def share_of_way(start: float, here: float, low: float, high: float) -> float:
    """Share that is covered of the way from a start to the end of a range on the side of `here`."""
    way = abs((high if here > start else low) - start)
    return abs(here - start) / way if way else 0.0


def outcome_of(job: Callable[..., Returned], *given: Any) -> Returned | Exception:
    """The value that a job returned for what it is given, or the exception that it raised."""
    try:
        return job(*given)
    except Exception as error:
        return error


def batches(count: int, largest: int, least: int) -> list[range]:
    """Indices of so many points in batches of equal size, the last one smaller.

    Args:
        count: number of points.
        largest: largest number of points in a batch.
        least: least number of batches, where there are as many points.
    """
    size = min(largest, max(1, count // least))
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


def parallel(
    jobs: Sequence[Job[Returned]],
    executor: futures.Executor | None = None,
    *,
    label: str = "",
    progress: bool = False,
) -> Iterator[Returned | Exception]:
    """Runs jobs and yields, in their order, the value or the exception of each.

    A job that fails does not stop the others. If the executor fails a job, because a worker died or
    because the executor was broken or shut down, its exception takes the place of the job's value.
    Without an executor, each job runs when the caller takes its value. An executor gets all jobs at
    once; if the caller stops early, jobs that have not begun are cancelled.
    """
    submitted: list[futures.Future[Returned] | Exception] = []
    calls: Iterable[Job[Returned]] = jobs
    try:
        if executor is not None:
            submitted.extend(outcome_of(executor.submit, job) for job in jobs)
            calls = [partial(_result, one) for one in submitted]
        for call in track(calls, len(jobs), label, progress):
            yield outcome_of(call)
    finally:
        for one in submitted:
            if not isinstance(one, Exception):
                one.cancel()


def _result(submitted: futures.Future[Returned] | Exception) -> Returned:
    """The value that a job returned; raises its exception, or that with which it was refused."""
    if isinstance(submitted, Exception):
        raise submitted
    try:
        return submitted.result()
    except Exception as error:
        if submitted.cancelled():
            error.args = error.args or ("the executor cancelled the job before it began",)
        raise
