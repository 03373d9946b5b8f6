# SPDX-License-Identifier: MIT
"""Independent jobs of a sweep, here or in an executor; one that fails leaves the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from typing import TypeVar

from pipedyn.util.progress import track

Answer = TypeVar("Answer")
Job = Callable[[], Answer]
"""What runs anywhere: it pickles, e.g. a `functools.partial` of a module's function."""


def parallel(
    jobs: Sequence[Job[Answer]],
    executor: Executor | None = None,
    *,
    label: str = "",
    progress: bool = False,
) -> Iterator[Answer | Exception]:
    """What each job returned, or the exception that it raised, in the order of the jobs.

    Without an executor each runs when its answer is taken; an executor gets all at once, and those
    that have not begun are cancelled where the caller takes no more answers.
    """
    futures = [] if executor is None else [executor.submit(job) for job in jobs]
    results: Iterable[Job[Answer]] = [future.result for future in futures] if futures else jobs
    outcome: Answer | Exception
    try:
        for result in track(results, len(jobs), label, progress):
            try:
                outcome = result()
            except Exception as error:
                outcome = error
            yield outcome
    finally:
        for future in futures:
            future.cancel()
