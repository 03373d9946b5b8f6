# SPDX-License-Identifier: MIT
"""Independent jobs of a sweep, here or in an executor, and the progress of whatever takes long."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from pipedyn.util.later import futures

Item = TypeVar("Item")
Returned = TypeVar("Returned")
Job = Callable[[], Returned]
"""What runs anywhere: it pickles, e.g. a `functools.partial` of a module's function."""


def watched() -> bool:
    """Whether someone sees what goes to stderr: in a terminal or a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def track(items: Iterable[Item], total: int | None, label: str, shown: bool) -> Iterator[Item]:
    """The items, counted on stderr while they are taken: by tqdm where that is installed.

    Nothing is written where nobody watches. total: how many there are, if that is known.
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
        finally:  # also where no more items are taken
            print(file=sys.stderr)
        return
    yield from tqdm(items, total=total, desc=label)


def outcome_of(job: Job[Returned]) -> Returned | Exception:
    """What a job returned, or the exception that it raised."""
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
    """What each job returned, or why there is no answer, in the order of the jobs.

    A job that fails leaves the others: its exception stands in its place. So does that of an
    executor which does not answer, because a worker died, or because the executor was broken or
    shut down before the job was given or done. Without an executor each job runs when its answer is
    taken; an executor gets all at once, and those that have not begun are cancelled where the
    caller takes no more answers.
    """
    submitted: list[futures.Future[Returned]] = []
    calls: Iterable[Job[Returned]] = jobs
    try:
        if executor is not None:
            submitted.extend(_submitted(executor, job) for job in jobs)
            calls = [partial(_result, future) for future in submitted]
        for call in track(calls, len(jobs), label, progress):
            yield outcome_of(call)
    finally:
        for future in submitted:
            future.cancel()


def _submitted(executor: futures.Executor, job: Job[Returned]) -> futures.Future[Returned]:
    """The future of a job, one that has failed already where the executor refuses the job."""
    try:
        return executor.submit(job)
    except Exception as error:
        refused: futures.Future[Returned] = futures.Future()
        refused.set_exception(error)
        return refused


def _result(future: futures.Future[Returned]) -> Returned:
    """What a future's job returned. Raises what kept it from that, in words."""
    try:
        return future.result()
    except futures.CancelledError as error:
        error.args = error.args or ("the executor cancelled the job before it began",)
        raise
