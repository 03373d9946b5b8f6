"""One map over independent jobs: in order, failures kept, in any executor, also in a dying one."""

import inspect
import logging
import multiprocessing
import os
import re
import subprocess
import sys
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from concurrent.futures.thread import BrokenThreadPool
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.util import parallel as module

PIPE = pp.Pipe(0.2)
SEGMENTS = 3, 1, 2, 1
"""Of four chains, each a job of its own; those of one segment never lose stability."""
TWO = pp.Chain(PIPE, 2)
THREE = [pp.Chain(PIPE, n) for n in (1, 2, 3)]


class Dying:
    """An executor whose worker dies of the job after so many, really: it leaves its process."""

    def __init__(self, executor, jobs):
        self.executor, self.left = executor, jobs

    def submit(self, job):
        self.left -= 1
        return self.executor.submit(os._exit, 1) if self.left == -1 else self.executor.submit(job)


class Refusing:
    """An executor that runs each job at once, but refuses the first of them."""

    def __init__(self):
        self.jobs = 0

    def submit(self, job):
        self.jobs += 1
        if self.jobs == 1:
            raise BrokenProcessPool("no worker could be started")
        future = Future()
        future.set_result(job())
        return future


def answers_of(executor, segments=SEGMENTS, **more):
    """The critical speed of each chain, or the error of its job."""
    places = np.arange(len(segments))
    found = pp.stability_curve(
        lambda i: pp.Chain(PIPE, segments[round(i)]), places, executor=executor, **more
    )
    errors = {failure.index: failure.error for failure in found.failures}
    return [errors.get(i, speed) for i, speed in enumerate(found.speeds.tolist())]


SPEEDS = [pp.critical_speed(pp.Chain(PIPE, n)).speed for n in (3, 2)]


def broken_pool():
    """A pool of processes whose only worker is dead."""
    pool = ProcessPoolExecutor(1)
    assert isinstance(pool.submit(os._exit, 1).exception(), BrokenProcessPool)
    return pool


@pytest.mark.parametrize("pool", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_a_job_that_fails_keeps_its_place_and_leaves_the_others(pool):
    executor = pool and pool(1)
    outcomes = answers_of(executor)
    if executor:
        executor.shutdown()
    assert outcomes[::2] == pytest.approx(SPEEDS)
    assert [type(outcome) for outcome in outcomes[1::2]] == [pp.NoCrossing] * 2
    assert "no loss of stability" in str(outcomes[1])


def test_progress_is_written_to_terminals_alone(capsys):
    answers_of(None, progress=True)
    assert capsys.readouterr().err == ""


def test_progress_is_counted_on_stderr(terminal):
    answers_of(None, progress=True)
    assert "4/4" in terminal.readouterr().err


# ----------------------------------------------------------------------------------------- progress


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on as the test says: `clock.now` is its time in s."""
    made = SimpleNamespace(now=0.0)
    monkeypatch.setattr(module, "monotonic", lambda: made.now)
    return made


def lines(terminal):
    """Lines that were written one over the other, without the spaces that cover the last one."""
    before, *written = terminal.readouterr().err.split("\r")
    assert before == ""
    return [re.sub(" +(?=\n|$)", "", line) for line in written]


def test_progress_says_the_share_and_the_time_left(terminal, clock):
    for seconds in module.track([20.0, 20.0, 40.0, 3600.0], 4, "work", True):
        clock.now += seconds
    assert lines(terminal) == [
        "work: 25 %, 1/4, about 1:00 left",
        "work: 50 %, 2/4, about 0:40 left",
        "work: 75 %, 3/4, about 0:27 left",
        "work: 99 %, 4/4, about 0:00 left",
        "work: 100 %, 4/4, took 1:01:20\n",
    ]


def test_the_time_left_follows_the_pace_of_late(terminal, clock):
    """A first half that takes an hour does not tell how long the second takes."""
    with module.Progress("work", True) as progress:
        clock.now = 3600.0
        progress.to(0.5)
        for k in range(1, 41):
            clock.now += 1.0
            progress.to(0.5 + 0.01 * k)
    first, second, *_, last, end = lines(terminal)
    assert first == "work: 50 %, about 1:00:00 left"
    assert int(second.split("about ")[1][:2]) > 50
    assert last == "work: 90 %, about 0:10 left"
    assert end == "work: 100 %, took 1:00:40\n"


def test_no_time_is_told_before_there_is_a_pace_and_shares_never_fall(terminal, clock):
    with module.Progress("work", True) as progress:
        for share in (0.0, 0.3, 0.1, 0.2, 7.0):
            clock.now += 1.0
            progress.to(share)
    at_first, *others = lines(terminal)
    assert at_first == "work: 0 %"
    assert [line.split()[1] for line in others] == ["30", "30", "30", "99", "100"]


def test_a_first_step_that_is_nearly_nothing_is_no_pace(terminal, clock):
    """Followed curves begin with steps far smaller than later ones: 0.4 s of 1e-6 was 111 h."""
    with module.Progress("work", True) as progress:
        for share in (1e-6, 0.5):
            clock.now += 0.4
            progress.to(share)
    assert lines(terminal)[:2] == ["work: 0 %", "work: 50 %, about 0:01 left"]


def test_progress_is_written_ten_times_a_second_at_most(terminal, clock):
    for _ in module.track(range(1000), 1000, "work", True):
        clock.now += 0.001
    assert 5 < len(lines(terminal)) < 15


def test_a_line_is_no_longer_than_the_terminal_is_wide(terminal, clock, monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    list(module.track("abc", 3, "work with a long name", True))
    first, *_, last = lines(terminal)
    assert first == "w: 33 %, 1/3, about 0:00 left"
    assert last == "work w: 100 %, 3/3, took 0:00\n"


def test_an_exception_ends_the_line_as_it_is(terminal, clock):
    def fail(item):
        if item:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        list(map(fail, module.track([0, 1], 2, "work", True)))
    assert lines(terminal) == ["work: 50 %, 1/2, about 0:00 left\n"]
    for _ in module.track(range(3), 3, "work", True):
        break
    assert terminal.readouterr().err == ""  # nothing was done


def test_without_progress_no_clock_is_read(terminal, monkeypatch):
    monkeypatch.setattr(module, "monotonic", None)
    assert list(module.track("abc", 3, "work", False)) == ["a", "b", "c"]
    with module.Progress("work", False) as progress:
        assert list(progress.steps("abc", float)) == ["a", "b", "c"]
    assert terminal.readouterr().err == ""


def diagram(**more):
    found = pp.bifurcation_diagram(TWO, [3.0, 3.7, 4.0], transient=20.0, duration=10.0, **more)
    assert not found.failures
    return found


def followed_event(**more):
    (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.2, 3.4]).cycles
    (fold,) = (event for event in branch.events if event.kind == "fold")
    window = {"beta": (0.03, 0.07), "u": (2.5, 4.0)}
    return pp.cycle_boundary(branch, fold, "beta", "u", window, **more)


WINDOW = {"gamma": (-20.0, 0.0), "u": (0.0, 5.0)}
DAMPED = pp.Chain(pp.Pipe(0.2, damping=0.01), 2)
LONG = {
    "boundary": (
        partial(pp.boundary, DAMPED, "gamma", "u", WINDOW),
        ["lines along y", "lines along x", "curves, 2 degrees of freedom", "criticality"],
    ),
    "cycle_boundary": (followed_event, ["lines along y", "fold in the plane"]),
    "attractors": (
        partial(pp.attractors, TWO, 4.0, 3, transient=20.0, duration=10.0),
        ["attractors"],
    ),
    "bifurcation_diagram": (
        partial(diagram, brute_force=2),
        ["equilibria", "cycles followed from the onset at u = 3.59271", "brute force"],
    ),
    "parametric_regions": (
        partial(
            pp.parametric_regions, pp.Galerkin(pp.Pipe(0.2, 10.0), 4), 5.0, [0.1, 0.3], (28.0, 33.0)
        ),
        ["subharmonic regions", "harmonic regions", "combination regions"],
    ),
    "forced_response": (
        partial(
            *(pp.forced_response, pp.Chain(pp.Pipe(0.2, damping=0.01), 2), 1.0),
            base=pp.Harmonic(0.01, 10.0),
            frequencies=(9.0, 11.0),
        ),
        ["forced response"],
    ),
    "simulate": (partial(pp.simulate, TWO, 4.0, 20.0, [0.1, 0.1]), ["motion"]),
    "root_loci": (partial(pp.root_loci, TWO, [0.0, 1.0, 2.0]), ["root loci"]),
}
"""Of each function that may take long a call, and labels of its lines."""


@pytest.mark.parametrize("name", LONG)
def test_shares_grow_to_the_end_of_everything_that_takes_long(name, terminal, monkeypatch):
    call, labels = LONG[name]
    call()
    assert terminal.readouterr().err == ""
    monkeypatch.setattr(module, "LEAST_PAUSE", 0.0)
    call(progress=True)
    told, written = {}, terminal.readouterr().err
    assert re.search(r" %, [^\r]*about \d+:\d\d left", written)
    for line in written.split("\n"):
        shares = [int(share) for share in re.findall(r"\r[^\r]*: (\d+) %", line)]
        assert shares == sorted(shares), line
        assert shares[-1:] == ([100] if line.startswith("\r") else []), line
        told.setdefault(line[1:].split(": ")[0], []).append(len(shares))
    assert not [label for label in labels if label not in told], told
    assert max(map(max, told.values())) > 2


def test_the_share_of_motions_grows_with_each_batch_and_not_only_when_all_have_gone_on(
    terminal, monkeypatch
):
    """Of a reduced model each motion is a batch; most of these reach rest at the first go."""
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.01), 4, "legendre")
    monkeypatch.setattr(module, "LEAST_PAUSE", 0.0)
    found = pp.attractors(model, 3.0, 20, transient=40.0, duration=10.0, progress=True)
    assert found.basins[0].share.count == 20
    written = terminal.readouterr().err
    first, *others = (int(share) for share in re.findall(r": (\d+) %", written.split("\n")[-2]))
    assert first <= 10
    assert len(others) >= 15
    assert all(" left" in line for line in written.split("\n")[-2].split("\r")[2:-1])


# --------------------------------------------------------------------- executors that do not answer


def test_a_worker_that_dies_leaves_what_was_answered_before():
    with ProcessPoolExecutor(1) as pool:
        outcomes = answers_of(Dying(pool, 2))
    assert outcomes[0] == pytest.approx(SPEEDS[0])
    assert [type(one) for one in outcomes[1:]] == [pp.NoCrossing, *[BrokenProcessPool] * 2]


def shut_down(pool):
    executor = pool(1)
    executor.shutdown()
    return executor


@pytest.mark.parametrize(
    ("make", "kind", "said"),
    [
        (broken_pool, BrokenProcessPool, "not usable anymore"),
        (partial(shut_down, ThreadPoolExecutor), RuntimeError, "after shutdown"),
        (partial(shut_down, ProcessPoolExecutor), RuntimeError, "after shutdown"),
        (
            partial(ThreadPoolExecutor, 1, initializer=int, initargs=("one",)),
            *(BrokenThreadPool, ""),
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_pool_that_cannot_work_answers_with_the_reason(make, kind, said):
    with make() as pool:
        outcomes = answers_of(pool)
    assert [type(outcome) for outcome in outcomes] == [kind] * 4
    assert all(said in str(outcome) for outcome in outcomes)


def test_jobs_that_an_executor_cancels_say_so():
    class CancelsTheSecond:
        jobs = 0

        def submit(self, job):
            self.jobs += 1
            future = Future()
            if self.jobs == 2:
                future.cancel()
                future.set_running_or_notify_cancel()
            else:
                future.set_result(job())
            return future

    outcomes = answers_of(CancelsTheSecond(), (3, 3, 2))
    assert outcomes[::2] == pytest.approx(SPEEDS)
    assert isinstance(outcomes[1], CancelledError)
    assert "cancelled the job" in str(outcomes[1])


@pytest.mark.parametrize("given_by", ["submit", "result"])
def test_an_interrupt_ends_a_sweep_and_cancels_what_has_not_begun(given_by):
    """It is no failure of a job: from the executor or from a worker that it reaches, it goes on."""
    submitted = []

    class Interrupted:
        def submit(self, job):
            if given_by == "submit" and len(submitted) == 2:
                raise KeyboardInterrupt
            submitted.append(Future())
            if given_by == "result" and len(submitted) == 1:
                submitted[0].set_exception(KeyboardInterrupt())
            return submitted[-1]

    with pytest.raises(KeyboardInterrupt):
        answers_of(Interrupted())
    cancelled = [future.cancelled() for future in submitted]
    assert cancelled == ([True] * 2 if given_by == "submit" else [False, *[True] * 3])


# ------------------------------------------------------------------------ every call with executor=


def starts_by_end(found):
    return found.ends.tolist()


def motions_by_speed(found):
    return [
        [(one.ending, one.period, one.turnings.tolist()) for one in found.at(u)]
        for u in found.speeds
    ]


SWEEPS = {
    "stability_curve": (
        lambda executor: pp.stability_curve(
            lambda beta: pp.Chain(pp.Pipe(beta), 4), [0.1, 0.2, 0.3, 0.4], executor=executor
        ),
        lambda found: found.speeds.tolist(),
    ),
    "critical_speeds": (
        lambda executor: pp.critical_speeds(
            pp.Chain(PIPE, 4), {"beta": np.linspace(0.1, 0.4, 6)}, executor=executor
        ),
        lambda found: found.speeds.tolist(),
    ),
    "criticality_curve": (
        lambda executor: pp.criticality_curve(
            lambda beta: pp.Chain(pp.Pipe(beta), 2), [0.1, 0.2, 0.3, 0.4], executor=executor
        ),
        lambda found: [None if one is None else one.lyapunov for one in found.onsets],
    ),
    "simulate_many": (
        lambda executor: pp.simulate_many(
            *(THREE, [4.0, 5.0, 6.0], 1.0, [one.bent(lambda s: 0.1 * s) for one in THREE]),
            **{"samples": 5, "executor": executor},
        ),
        lambda found: [one.q.tolist() for one in found.motions],
    ),
    "attractors": (
        lambda executor: pp.attractors(
            TWO, 4.0, 320, transient=20.0, duration=10.0, executor=executor
        ),
        starts_by_end,
    ),
    "bifurcation_diagram": (
        lambda executor: pp.bifurcation_diagram(
            TWO,
            np.linspace(3.0, 5.0, 6),
            brute_force=2,
            transient=20.0,
            duration=10.0,
            executor=executor,
        ),
        motions_by_speed,
    ),
}
"""Of every function that takes an executor a call, and the answers of its result, one by one."""


def named(found):
    """The answers that are missing, by the failures of a result."""
    return sorted({failure.index for failure in found.failures} - {-1})


def test_every_call_with_an_executor_is_tried():
    functions = {name: getattr(pp, name) for name in pp.__all__}
    taking = {
        name
        for name, one in functions.items()
        if inspect.isfunction(one) and "executor" in inspect.signature(one).parameters
    }
    assert taking == set(SWEEPS)


@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_keeps_what_was_answered_when_a_worker_dies_and_names_the_rest(name):
    call, answers = SWEEPS[name]
    with ProcessPoolExecutor(1) as pool:
        found = call(Dying(pool, 2))
    missing = named(found)
    assert 0 < len(missing) < len(answers(found))
    for i, (answer, alone) in enumerate(zip(answers(found), answers(call(None)), strict=True)):
        assert (answer == alone) == (i not in missing), i
    for failure in found.failures:
        assert "process pool" in str(failure.error)


@pytest.mark.parametrize("name", SWEEPS)
def test_a_sweep_names_all_when_the_pool_is_broken_before(name):
    call, answers = SWEEPS[name]
    with broken_pool() as pool:
        found = call(pool)
    assert named(found) == list(range(len(answers(found))))
    for failure in found.failures:
        assert "process pool" in str(failure.error)


@pytest.mark.slow
def test_a_cluster_keeps_what_was_answered_when_its_worker_dies_or_when_it_is_closed():
    import dask
    from distributed import Client, LocalCluster  # a second, which other tests need not wait for

    call, answers = SWEEPS["stability_curve"]
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),  # no job is given again
        LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        found = call(Dying(client, 2))
    missing = named(found)
    assert 2 in missing  # and maybe others that the worker held
    for i, (answer, alone) in enumerate(zip(answers(found), answers(call(None)), strict=True)):
        assert (answer == alone) == (i not in missing)
    assert {type(failure.error).__name__ for failure in found.failures} == {"KilledWorker"}
    closed = call(client)
    assert named(closed) == [0, 1, 2, 3]
    assert {"closed" in str(failure.error) for failure in closed.failures} == {True}


def test_a_branch_of_cycles_whose_worker_dies_is_named_by_its_onset():
    with ProcessPoolExecutor(1) as pool:
        found = pp.bifurcation_diagram(TWO, [3.0, 3.7], executor=Dying(pool, 0))
    onset = pp.critical_speed(TWO).speed
    (failure,) = found.failures
    assert (failure.index, failure.value) == (-1, pytest.approx(onset, rel=1e-9))
    assert isinstance(failure.error, BrokenProcessPool)
    assert len(found.equilibria) == 1


def test_driven_motions_that_an_executor_refuses_are_not_taken_for_attractors():
    """Those of a job that was refused have not moved, and must not be judged."""
    call = partial(
        *(pp.attractors, TWO, pp.Pulsation(3.0, 0.2, 4.0), 200),
        transient=20.0,
        duration=10.0,
        exponents=False,
    )
    executor = Refusing()
    found = call(executor=executor)
    assert executor.jobs > 1
    missing = named(found)
    assert 0 < len(missing) < 200
    whole = call()
    for i in range(200):
        assert (found.ends[i] == -2) == (i in missing)
        if i not in missing:
            assert found.basins[found.ends[i]].ending == whole.basins[whole.ends[i]].ending


def deadly_speed(t):
    """A flow speed, in another process its end."""
    if multiprocessing.parent_process() is not None:
        os._exit(1)
    return 5.0


def test_members_that_were_not_computed_have_no_samples_and_say_why(tmp_path):
    with ProcessPoolExecutor(1) as pool:
        found = pp.simulate_many(
            THREE, [4.0, deadly_speed, 4.0], 1.0, lambda s: 0.1 * s, samples=5, executor=pool
        )
    alone = pp.simulate_many(THREE, 4.0, 1.0, lambda s: 0.1 * s, samples=5)
    np.testing.assert_array_equal(found.motions[0].q, alone.motions[0].q)
    assert [failure.index for failure in found.failures] == [1, 2]
    for failure in found.failures:
        motion = found.motions[failure.index]
        assert motion.t.size == 0
        assert motion.q.shape == (0, THREE[failure.index].dof)
        assert motion.reached == "before its first sample"
        assert failure.error.motion is motion
        assert f"member {failure.index} was not computed: BrokenProcessPool" in str(failure.error)
        assert isinstance(failure.error.__cause__, BrokenProcessPool)
    assert found.columns()["member"].tolist() == [0] * 5
    saved = replace(found, motions=found.motions[::2], failures=found.failures[1:])
    saved.save(tmp_path / "some.npz")
    same = pp.load(tmp_path / "some.npz")
    assert str(same.failures[0].error) == str(found.failures[1].error)
    assert same.motions[1].t.size == 0


def test_a_law_that_raises_fails_its_members_and_keeps_the_others():
    torn = []

    def force(q, qdot):
        if torn:
            raise ZeroDivisionError("the spring is torn")
        return -q

    scene = pp.modular.chain(PIPE, 2).plus(pp.modular.Custom(joints=(1,), force=force))
    torn.append(True)
    found = pp.simulate_many([scene, TWO], 4.0, 0.5, lambda s: 0.1 * s, samples=5)
    (failure,) = found.failures
    assert failure.index == 0
    assert isinstance(failure.error.__cause__, ZeroDivisionError)
    assert "ZeroDivisionError: the spring is torn" in str(failure.error)
    assert found.motions[1].t.size == 5


# ------------------------------------------------------------------- what a pool of processes takes


@pytest.mark.parametrize("name", SWEEPS)
def test_a_pool_of_processes_gives_the_same_answers(name):
    """Also where lambdas make models and initial states: a process gets only what they made."""
    call, answers = SWEEPS[name]
    with ProcessPoolExecutor(1) as pool:
        found = call(pool)
    assert found.failures == ()
    assert answers(found) == answers(call(None))


def test_the_example_of_the_page_on_sweeps_runs(tmp_path):
    page = Path(__file__).parents[1] / "notebooks" / "how-to" / "sweep-in-parallel.md"
    code = page.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    assert "lambda" in code
    script = tmp_path / "sweep.py"
    script.write_text(code.replace("200)", "8)"), encoding="utf-8")
    source = os.pathsep.join([str(Path(pp.__file__).parents[1]), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ | {"PYTHONPATH": source},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("()\n", "")


def test_a_lambda_of_time_does_not_pickle_and_its_member_says_so():
    speeds = [4.0, lambda t: 4.0 + 0.0 * t, 4.0]
    start = lambda s: 0.1 * s  # noqa: E731
    with ProcessPoolExecutor(1) as pool:
        found = pp.simulate_many(THREE, speeds, 0.5, start, samples=5, executor=pool)
    (failure,) = found.failures
    assert failure.index == 1
    assert "pickle" in str(failure.error)
    with ThreadPoolExecutor(1) as pool:
        assert pp.simulate_many(THREE, speeds, 0.5, start, executor=pool).failures == ()
