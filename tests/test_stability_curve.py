# SPDX-License-Identifier: MIT
"""Stability curves: critical speed against any parameter, failures kept apart."""

import logging
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.util.counters import count_work

BETAS = [0.1, 0.2, 0.5, 0.65]


def test_a_curve_holds_the_critical_speed_of_each_model():
    curve = pp.stability_curve(lambda beta: pp.Continuum(pp.Pipe(beta)), BETAS)
    alone = [pp.critical_speed(pp.Continuum(pp.Pipe(beta))) for beta in BETAS]
    np.testing.assert_array_equal(curve.values, BETAS)
    assert curve.failures == ()
    assert [crossings[-1].speed for crossings in curve.crossings] == list(curve.speeds)
    for name in ("speed", "frequency"):
        found, expected = ([getattr(c, name) for c in given] for given in (curve.critical, alone))
        assert found == pytest.approx(expected, rel=1e-13)
    np.testing.assert_array_equal(curve.frequencies, [c.frequency for c in curve.critical])


def test_a_curve_through_the_fold_holds_every_crossing():
    curve = pp.stability_curve(
        lambda beta: pp.Continuum(pp.Pipe(beta)), [0.28, 0.295, 0.31], max_speed=9.0
    )
    assert [len(crossings) for crossings in curve.crossings] == [1, 3, 1]
    assert curve.speeds[1] == curve.crossings[1][0].speed


def test_any_parameter_will_do():
    curve = pp.stability_curve(lambda gamma: pp.Chain(pp.Pipe(0.2, gamma=gamma), 8), [0.0, 10.0])
    assert curve.speeds[0] < curve.speeds[1]


def test_a_point_that_fails_is_recorded_and_the_others_kept():
    """beta = 1.5 is no pipe; a chain of one segment never flutters."""

    def make_model(value):
        if value == 3.0:
            return "no model"
        return pp.Chain(pp.Pipe(1.5 if value == 1.0 else 0.2), 1 if value == 2.0 else 6)

    curve = pp.stability_curve(make_model, [0.0, 1.0, 2.0, 3.0, 4.0])
    assert [failure.index for failure in curve.failures] == [1, 2, 3]
    assert [failure.value for failure in curve.failures] == [1.0, 2.0, 3.0]
    assert [type(f.error) for f in curve.failures] == [ValueError, pp.NoCrossing, TypeError]
    assert "beta" in str(curve.failures[0].error)
    assert curve.speeds[0] == curve.speeds[4]
    assert np.isnan(curve.speeds[1:4]).all()
    assert np.isnan(curve.frequencies[1:4]).all()
    assert curve.crossings[1:4] == ((), (), ())


def test_a_pipe_that_stays_stable_is_no_failure_up_to_a_bound():
    curve = pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), 6), [0.2, 0.5], max_speed=6.0)
    assert curve.failures == ()
    assert curve.critical[1] is None
    assert curve.critical[0] is not None


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_a_batch_changes_nothing(damping):
    """Neighbours that are one pipe at rest share its starts there; the answers are the same."""

    def make_model(value):
        size = 9 if 0.3 < value < 0.6 else 7
        return pp.Chain(pp.Pipe(value, gamma=10.0 if value > 0.8 else 0.0, damping=damping), size)

    values = np.linspace(0.05, 0.95, 10)
    curve = pp.stability_curve(make_model, values, max_speed=15.0)
    for value, found in zip(values, curve.crossings, strict=True):
        alone = pp.crossings(make_model(value), 15.0)
        assert [(c.speed, c.mode, c.error) for c in found] == [
            (c.speed, c.mode, c.error) for c in alone
        ]


LINES = {
    "beta, through three folds": lambda x: pp.Chain(pp.Pipe(0.05 + 0.85 * x), 8),
    "beta and gamma": lambda x: pp.Chain(pp.Pipe(0.3 + 0.2 * x, gamma=20.0 * x), 7),
    "damping": lambda x: pp.Chain(pp.Pipe(0.25, damping=0.005 * x), 6),
    "a mass at the end": lambda x: pp.Chain(pp.Pipe(0.4, terms=[pp.PointMass(1.0, x)]), 6),
    "a spring that moves": lambda x: pp.Chain(pp.Pipe(0.2, terms=[pp.Spring(1.0 - x, 60.0)]), 9),
    "one pipe among others": lambda x: pp.Chain(pp.Pipe(0.4 if 0.5 < x < 0.51 else 0.2), 6),
}


@pytest.mark.parametrize("line", LINES)
def test_neighbours_that_share_a_search_have_the_answers_of_their_own(line):
    """Where the critical speed jumps, where a mode takes over or a pipe differs, too."""
    values = np.linspace(0.0, 0.9, 200)
    with count_work() as shared:
        curve = pp.stability_curve(LINES[line], values)
    with count_work() as own:
        alone = [pp.critical_speed(LINES[line](value)) for value in values]
    for one, other in zip(curve.critical, alone, strict=True):
        assert (one.kind, one.mode, one.stable_from) == (other.kind, other.mode, other.stable_from)
        assert abs(one.speed - other.speed) <= one.error + other.error
    assert shared.factorisations < 0.9 * own.factorisations


def test_a_process_pool_takes_a_lambda_and_keeps_failures():
    """Models are made here and pickled; spawned processes share nothing with this one."""
    make_model = lambda beta: (  # noqa: E731
        pp.Continuum(pp.Pipe(beta)) if beta < 0.3 else pp.Chain(pp.Pipe(0.2), 1)
    )
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        curve = pp.stability_curve(make_model, [0.1, 0.2, 0.4], executor=executor)
    assert list(curve.speeds[:2]) == pytest.approx([4.749897, 5.591404], abs=5.1e-7)
    (failure,) = curve.failures
    assert failure.index == 2
    assert isinstance(failure.error, pp.NoCrossing)
    assert failure.error.max_speed == 100.0
    assert curve.critical[0].sensitivity.speed.gamma > 0.0


def test_the_batches_of_a_curve_run_on_a_cluster():
    """Dask's client is an executor; the batches are its tasks, in a process of their own."""
    from distributed import Client, LocalCluster  # a second, which other tests need not wait for

    betas = np.linspace(0.05, 0.9, 33)

    def make_model(beta):
        return pp.Chain(pp.Pipe(1.5 if beta == betas[4] else beta), 8)

    alone = pp.stability_curve(make_model, betas)
    with (
        LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.ERROR
        ) as cluster,
        Client(cluster) as client,
    ):
        together = pp.stability_curve(make_model, betas, executor=client)
        (tasks,) = client.run(lambda dask_worker: dask_worker.state.executed_count).values()
    assert tasks == 16  # of 32 models
    np.testing.assert_array_equal(together.speeds, alone.speeds)
    assert [failure.index for failure in together.failures] == [4]
    assert isinstance(together.failures[0].error, ValueError)
    assert [c.kind for c in together.critical if c] == [c.kind for c in alone.critical if c]
    assert together.critical[0].sensitivity.speed.beta == alone.critical[0].sensitivity.speed.beta


LOADED = pp.Pipe(0.2, 1.0, damping=1e-3, terms=[pp.PointMass(0.4, 0.1), pp.Spring(0.6, 50.0)])


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(LOADED, 6),
        pp.Chain(
            pp.Pipe(0.2, hysteresis=0.1), springs=[3.0, 4.0, 5.0], drag_points=[0.1, 0.2, 0.3]
        ),
        pp.Galerkin(LOADED, 6),
        pp.Galerkin(LOADED, 6, "legendre"),
        pp.Continuum(LOADED),
        pp.modular.chain(LOADED, 4),
    ],
    ids=repr,
)
def test_models_and_their_answers_pickle(model):
    found = pp.modes(model, 3.0, 2)  # with what the model keeps
    same, again = pickle.loads(pickle.dumps((model, found)))
    for ask in (repr, lambda one: one.pipe, pp.critical_speed, lambda one: pp.modes(one, 3.0, 2)):
        assert ask(same) == ask(model)
    assert again == found
    assert again.shapes[0]([1.0]) == found.shapes[0]([1.0])


def test_exceptions_pickle_with_what_they_carry():
    """Else a process pool would hang or lose them."""
    missing = pickle.loads(pickle.dumps(pp.NoCrossing("none up to 3", 3.0)))
    assert (str(missing), missing.max_speed) == ("none up to 3", 3.0)
    unfinished = pickle.loads(pickle.dumps(pp.NotConverged("still moves", [1, 2])))
    assert (str(unfinished), unfinished.result) == ("still moves", [1, 2])


def test_progress_is_counted_on_stderr_only(terminal):
    pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), 4), [0.1, 0.2], progress=True)
    out, err = terminal.readouterr()
    assert out == ""
    assert "stability curve" in err
    assert "2/2" in err


def test_the_reason_why_all_points_failed_is_shown():
    """Segments are counted in whole numbers, values of a sweep are not."""
    curve = pp.stability_curve(lambda n: pp.Chain(pp.Pipe(0.2), n), [5, 10])
    assert "failures=<2 Failure, the first: TypeError('n must be a whole number" in repr(curve)
    assert "n must be a whole number" in curve._repr_html_()


def test_models_may_come_from_a_table():
    models = {5.0: pp.Chain(pp.Pipe(0.2), 5), 10.0: pp.Chain(pp.Pipe(0.2), 10)}
    curve = pp.stability_curve(models.__getitem__, list(models))
    assert curve.parameter == ""
    assert (curve.speeds > 5.0).all()
