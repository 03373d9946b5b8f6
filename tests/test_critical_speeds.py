# SPDX-License-Identifier: MIT
"""Critical speeds of many pipes: numbers as arrays, failures kept apart, batches anywhere."""

import logging
import os
import pickle
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import pipedyn as pp

CHAIN = pp.Chain(pp.Pipe(0.2), 6)
TERMS = (pp.PointMass(1.0, 0.1), pp.Spring(0.5, 20.0), pp.Damper(0.7, 0.2))


def one_by_one(model, names, points):
    """Answers of `critical_speed` for each pipe, made by replacing its numbers."""
    rows = []
    for point in points:
        pipe = model.pipe
        for name, value in zip(names, point, strict=True):
            if "." not in name:
                pipe = replace(pipe, **{name: value})
                continue
            term, number = name.split(".")
            terms = tuple(
                replace(one, **{number: value}) if type(one).__name__ == term else one
                for one in pipe.terms
            )
            pipe = replace(pipe, terms=terms)
        try:
            found = pp.critical_speed(model.with_pipe(pipe))
        except pp.NoCrossing:
            rows.append([np.nan] * 6)
            continue
        numbers = found.speed, found.frequency, found.error, found.mode
        rows.append([*numbers, found.kind == "divergence", found.unstable_before])
    return np.array(rows)


@pytest.mark.parametrize(
    ("model", "names"),
    [
        (CHAIN, ["beta", "gamma"]),
        (pp.Chain(pp.Pipe(0.3, terms=TERMS), 5), ["PointMass.mass", "Spring.stiffness", "damping"]),
        (pp.Chain(pp.Pipe(0.3, end="pinned"), 6), ["beta", "gamma"]),
        (pp.Chain(pp.Pipe(0.3, hysteresis=0.05), 5), ["beta", "hysteresis"]),
        (pp.Chain(pp.Pipe(0.3, 5.0, flow="aspirating", damping=0.01), 5), ["beta", "inflow_share"]),
        (pp.Chain(pp.Pipe(1e-12), 4), ["beta", "gamma"]),  # so weakly damped that it extrapolates
        (pp.Galerkin(pp.Pipe(0.2), 5), ["beta", "gamma", "alpha"]),
        (pp.Galerkin(pp.Pipe(0.2, terms=TERMS), 8, "legendre"), ["Damper.coefficient", "beta"]),
        (pp.Continuum(pp.Pipe(0.2, terms=TERMS)), ["PointMass.mass", "beta"]),
        (pp.modular.chain(pp.Pipe(0.2), 4), ["beta", "gamma"]),
        (CHAIN.with_pipe(pp.Pipe(0.2, gamma=-20.0)), ["gamma", "beta"]),  # buckled at rest
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_each_pipe_has_the_answer_of_its_own_search(model, names):
    rng = np.random.default_rng(len(names))
    own = pp.critical_speed(model.with_pipe(replace(model.pipe, gamma=0.0))).speed
    assert own > 0.0
    values = {name: rng.uniform(0.05, 0.6, 4) for name in names}
    if "gamma" in values:
        values["gamma"] = rng.uniform(-15.0, 30.0, 4)
    if model.pipe.beta < 1e-9:
        values["beta"] = 10.0 ** rng.uniform(-13.0, -11.0, 4)
    found = pp.critical_speeds(model, values)
    assert found.failures == ()
    expected = one_by_one(model, names, np.stack(list(values.values()), axis=-1))
    some = ~np.isnan(expected[:, 0])
    assert some.any()
    answers = found.speeds, found.frequencies, found.errors, found.modes
    for one, wanted in zip(answers, expected.T[:4], strict=True):
        np.testing.assert_allclose(one[some], wanted[some], rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.divergent[some], expected[some, 4])
    np.testing.assert_array_equal(found.unstable_before[some], expected[some, 5])
    assert np.isnan(found.speeds[~some]).all()


def test_values_broadcast_as_numpy_does():
    betas, gammas = np.array([[0.1], [0.2], [0.4]]), np.array([0.0, 10.0])
    found = pp.critical_speeds(CHAIN, {"beta": betas, "gamma": gammas})
    assert found.speeds.shape == (3, 2)
    alone = pp.critical_speeds(CHAIN, {"beta": 0.4, "gamma": 10.0})
    assert alone.speeds.shape == ()
    assert found.speeds[2, 1] == alone.speeds[()]
    table = found.columns()
    assert list(table)[:3] == ["beta", "gamma", "speed"]
    assert {values.shape for values in table.values()} == {(6,)}
    assert table["beta"][4] == 0.4
    assert set(table["kind"]) == {"flutter"}
    with pytest.raises(
        ValueError, match=r"\(3,\) of 'beta', \(2,\) of 'gamma'; numpy.ix_ gives all"
    ):
        pp.critical_speeds(CHAIN, {"beta": betas[:, 0], "gamma": gammas})


def test_a_pipe_without_loss_of_stability_is_no_failure():
    found = pp.critical_speeds(CHAIN, {"gamma": [0.0, 200.0, -30.0]}, max_speed=1.0)
    assert found.failures == ()
    assert np.isnan(found.speeds).all()
    assert found.columns()["kind"].tolist() == [""] * 3
    buckled = pp.crossings(CHAIN.with_pipe(pp.Pipe(0.2, -30.0)), 1.0)
    assert buckled.unstable_at_rest > 0
    assert found.unstable_before.tolist() == [0, 0, buckled.unstable_at_rest]
    further = pp.critical_speeds(CHAIN, {"gamma": [0.0, 200.0]}, max_speed=7.0)
    assert np.isnan(further.speeds).tolist() == [False, True]


def test_a_pipe_that_fails_keeps_the_others():
    """The fluid's part of the mass may not exceed the pipe's mass along it."""
    pipe = pp.Pipe(0.1, mass=pp.Profile((0.5,), (1.0, 0.4)))
    found = pp.critical_speeds(pp.Chain(pipe, 6), {"beta": [[0.1, 0.5], [0.2, 0.7]]})
    assert [failure.index for failure in found.failures] == [1, 3]
    assert [failure.value for failure in found.failures] == [0.5, 0.7]
    assert "mass must be at least beta" in str(found.failures[0].error)
    assert np.isnan(found.speeds).tolist() == [[False, True], [False, True]]
    assert [bool(text) for text in found.columns()["failure"]] == [False, True, False, True]


@pytest.mark.parametrize(
    ("numbers", "kind", "said"),
    [
        ({}, TypeError, "must map names"),
        ([0.1], TypeError, "must map names"),
        ({"betta": [0.1]}, ValueError, "did you mean 'beta'"),
        ({"drag": [0.1]}, ValueError, "small motions"),
        ({"beta": [0.1, 1.0]}, ValueError, r"numbers\['beta'\]"),
        ({"beta": ["a"]}, TypeError, "array of real numbers"),
        ({"beta": [np.nan]}, ValueError, "got nan"),
        ({"beta": []}, ValueError, "0"),
        ({"beta": [0.1, 0.2], "gamma": [1.0, 2.0, 3.0]}, ValueError, r"\(2,\) of 'beta'"),
        ({"PointMass.mass": [0.1]}, ValueError, "PointMass.mass"),
        ({"beta": np.zeros(20_000)[:, None], "gamma": np.zeros(20_000)}, ValueError, "at most"),
    ],
)
def test_bad_numbers_are_refused_at_once(numbers, kind, said):
    with pytest.raises(kind, match=said):
        pp.critical_speeds(CHAIN, numbers)


def test_results_have_si_units_of_each_pipe(tmp_path):
    """The unit of speed depends on beta."""
    hose = pp.Pipe.from_si(length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.032)
    found = pp.critical_speeds(pp.Chain(hose, 5), {"beta": [0.1, 0.2], "gamma": [[1.0], [2.0]]})
    for index in np.ndindex(2, 2):
        beta, gamma = (found.numbers[name][index] for name in ("beta", "gamma"))
        alone = pp.critical_speed(pp.Chain(replace(hose, beta=beta, gamma=gamma), 5)).in_si()
        assert found.in_si().speeds[index] == pytest.approx(alone.speed, rel=1e-12)
        assert found.in_si().frequencies[index] == pytest.approx(alone.frequency, rel=1e-12)
    assert found.columns("si")["speed (m/s)"] == pytest.approx(found.in_si().speeds.ravel())
    found.save(tmp_path / "map.npz")
    assert pp.load(tmp_path / "map.npz") == found


@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_an_executor_changes_no_answer(pool):
    numbers = {"beta": np.linspace(0.05, 0.9, 150), "gamma": 3.0}
    alone = pp.critical_speeds(CHAIN, numbers)
    with pool(1) as executor:
        together = pp.critical_speeds(CHAIN, numbers, executor=executor, progress=True)
    np.testing.assert_array_equal(alone.speeds, together.speeds)
    assert alone == together


def test_an_interrupt_ends_the_searches_of_all_threads():
    """A search of thousands of pipes takes seconds; the interrupt comes while it runs."""
    long = pp.Chain(pp.Pipe(0.2), 60)

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            pp.critical_speeds(long, {"beta": np.linspace(0.1, 0.9, 20_000)})
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


# --------------------------------------------------------------------------------------- a cluster


class KillsOne:
    """A cluster's client whose second task kills each worker that it is given to, or the first.

    `once` is the path of a file that the first worker leaves behind, None if all are killed.
    """

    def __init__(self, client, once):
        self.client, self.once, self.jobs = client, once, 0

    def submit(self, job):
        self.jobs += 1
        if self.jobs == 2:
            return self.client.submit(killed, job, self.once, pure=False)
        return self.client.submit(job, pure=False)


def killed(job, once):
    if once is None or not once.exists():
        if once is not None:
            once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(10.0)
    return job()


@pytest.mark.slow
@pytest.mark.parametrize("lost", [[], [5, 6, 7, 8, 9]], ids=["one worker dies", "each dies"])
def test_a_worker_that_is_killed_costs_nothing_and_a_chunk_that_kills_each_its_pipes(
    lost, tmp_path
):
    """The cluster gives a chunk to another worker three times, as it does what its workers held."""
    from distributed import Client, LocalCluster  # a second, which other tests need not wait for

    numbers = {"beta": np.linspace(0.05, 0.9, 320)}
    alone = pp.critical_speeds(CHAIN, numbers)
    once = None if lost else tmp_path / "killed"
    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        found = pp.critical_speeds(CHAIN, numbers, executor=KillsOne(client, once))
    assert once is None or once.exists()  # a worker was killed
    assert [failure.index for failure in found.failures] == lost  # the second chunk
    assert {type(failure.error).__name__ for failure in found.failures} <= {"KilledWorker"}
    kept = np.setdiff1d(np.arange(320), lost)
    np.testing.assert_array_equal(found.speeds[kept], alone.speeds[kept])
    assert np.isnan(found.speeds[lost]).all()


@pytest.mark.parametrize(
    "model",
    [
        CHAIN,
        pp.Chain(pp.Pipe(0.2, 10.0, damping=0.01, terms=(pp.PointMass(1.0, 0.1),)), 10),
        pp.Galerkin(pp.Pipe(0.2, 10.0), 10, "legendre"),
        pp.Galerkin(pp.Pipe(0.2, 10.0, damping=0.01), 8),
        pp.Chain(pp.Pipe(0.2), 10, dimensions=3),
    ],
    ids=["chain", "chain with a mass", "Legendre functions", "beam modes", "space"],
)
@pytest.mark.parametrize("ask", [pp.critical_speed, lambda model: pp.eigenvalues(model, 3.0)])
def test_what_is_asked_a_thousand_times_takes_few_calls_of_python(model, ask):
    """Each call costs as much as tracking a root for a step."""
    calls = []

    def count(frame, event, _):
        if event == "call":
            calls.append(frame.f_code.co_qualname)

    ask(model)
    sys.setprofile(count)
    try:
        ask(model)
    finally:
        sys.setprofile(None)
    assert len(calls) <= 60, calls


def test_a_sensitivity_is_computed_when_it_is_first_read_and_kept():
    found, same = pp.critical_speed(CHAIN), pp.critical_speed(CHAIN)
    assert callable(vars(found)["sensitivity"])
    kept = pickle.loads(pickle.dumps(found)).sensitivity
    assert kept == found.sensitivity is found.sensitivity
    assert kept.speed.gamma == pytest.approx(pp.critical_speed(CHAIN).sensitivity.speed.gamma)
    assert replace(same, mode=3).sensitivity == kept
