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

    Args:
        jobs: functions without arguments; without an executor each runs when its answer is taken.
        executor: takes them all at once; those that have not begun are cancelled where the caller
            takes no more answers.
        label: of the progress bar.
        progress: show progress on stderr.
    """
    results: Iterable[Job[Answer]] = jobs
    futures = []
    if executor is not None:
        futures = [executor.submit(job) for job in jobs]
        results = [future.result for future in futures]
    try:
        for result in track(results, len(jobs), label, progress):
            yield _outcome(result)
    finally:
        for future in futures:
            future.cancel()


def _outcome(result: Job[Answer]) -> Answer | Exception:
    try:
        return result()
    except Exception as error:
        return error
