"""One map over independent jobs: in order, failures kept, in any executor."""

from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import pytest

from pipedyn.util.parallel import parallel

JOBS = [partial(int, text) for text in ("3", "one", "5", "")]


@pytest.mark.parametrize("pool", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_a_job_that_fails_keeps_its_place_and_leaves_the_others(pool):
    executor = pool and pool(1)
    outcomes = list(parallel(JOBS, executor))
    if executor:
        executor.shutdown()
    assert outcomes[::2] == [3, 5]
    assert [type(outcome) for outcome in outcomes[1::2]] == [ValueError, ValueError]
    assert "one" in str(outcomes[1])


def test_without_an_executor_a_job_runs_when_its_answer_is_taken():
    ran = []
    outcomes = parallel([partial(ran.append, i) for i in range(3)])
    next(outcomes)
    assert ran == [0]


def test_jobs_that_have_not_begun_are_cancelled_where_no_more_answers_are_taken():
    futures = []

    class OnlyTheFirst:
        def submit(self, job):
            futures.append(Future())
            if len(futures) == 1:
                futures[0].set_result(job())
            return futures[-1]

    outcomes = parallel(JOBS, OnlyTheFirst())
    assert next(outcomes) == 3
    outcomes.close()
    assert [future.cancelled() for future in futures] == [False, True, True, True]


def test_progress_is_written_to_terminals_alone(capsys):
    assert list(parallel(JOBS[:1], label="numbers", progress=True)) == [3]
    assert capsys.readouterr().err == ""


def test_progress_is_counted_on_stderr(terminal):
    assert list(parallel(JOBS[:1], label="numbers", progress=True)) == [3]
    assert "numbers" in terminal.readouterr().err
