# SPDX-License-Identifier: MIT
"""Independent jobs of a sweep, here or in an executor, and the progress of whatever takes long."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

from pipedyn.util.later import futures

Item = TypeVar("Item")
Answer = TypeVar("Answer")
Job = Callable[[], Answer]
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


def outcome_of(job: Job[Answer]) -> Answer | Exception:
    """What a job returned, or the exception that it raised."""
    try:
        return job()
    except Exception as error:
        return error


def parallel(
    jobs: Sequence[Job[Answer]],
    executor: futures.Executor | None = None,
    *,
    label: str = "",
    progress: bool = False,
) -> Iterator[Answer | Exception]:
    """What each job returned, or the exception that it raised, in the order of the jobs.

    A job that fails leaves the others. Without an executor each runs when its answer is taken; an
    executor gets all at once, and those that have not begun are cancelled where the caller takes no
    more answers.
    """
    submitted = [] if executor is None else [executor.submit(job) for job in jobs]
    results: Iterable[Job[Answer]] = [future.result for future in submitted] if submitted else jobs
    try:
        for result in track(results, len(jobs), label, progress):
            yield outcome_of(result)
    finally:
        for future in submitted:
            future.cancel()
