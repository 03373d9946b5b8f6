# SPDX-License-Identifier: MIT
"""Independent jobs of a sweep, run in this thread or in an executor, and progress on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from pipedyn.util.later import futures

Item = TypeVar("Item")
Returned = TypeVar("Returned")
Job = Callable[[], Returned]
"""A function without arguments. It must allow pickling, as a `functools.partial` of a function of a
module does, so that it can run in any process."""


def watched() -> bool:
    """Whether somebody can read stderr, because it goes to a terminal or a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def track(items: Iterable[Item], total: int | None, label: str, shown: bool) -> Iterator[Item]:
    """Yields the items and counts them on stderr, by tqdm if that is installed.

    Nothing is written if `shown` is False or nobody can read stderr. `total` is the number of
    items, or None if it is not known.
    """
    if not (shown and watched()) or total == 0:
        yield from items
        return
    try:
        from tqdm import tqdm
    except ImportError:
        try:
            for done, item in enumerate(items, start=1):
                yield item
                count = f"{done}" if total is None else f"{done}/{total}"
                print(f"\r{label}: {count}", end="", file=sys.stderr, flush=True)
        finally:  # runs also if the caller stops before the last item
            print(file=sys.stderr)
        return
    yield from tqdm(items, total=total, desc=label)


def outcome_of(job: Job[Returned]) -> Returned | Exception:
    """The value that a job returned, or the exception that it raised."""
    try:
        return job()
    except Exception as error:
        return error


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
            submitted.extend(outcome_of(partial(executor.submit, job)) for job in jobs)
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
    except futures.CancelledError as error:
        error.args = error.args or ("the executor cancelled the job before it began",)
        raise
