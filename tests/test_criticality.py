# SPDX-License-Identifier: MIT
"""Where flutter sets in gently and where it snaps."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import pipedyn as pd


def three(beta):
    return pd.Chain(pd.Pipe(beta), 3)


def test_three_segments_snap_at_great_fluid_mass_only():
    curve = pd.criticality_curve(three, [0.2, 0.7])
    assert curve.failures == ()
    assert curve.subcritical.tolist() == [False, True]
    assert curve.speeds == pytest.approx([pd.hopf(three(b)).speed for b in (0.2, 0.7)])
    assert curve.laws[0] > 0.0 > curve.laws[1]


def test_points_that_fail_are_marked_and_the_others_kept():
    def make(gamma):
        if gamma == 1.0:
            raise RuntimeError("no such pipe")
        return pd.Chain(pd.Pipe(0.9, gamma=gamma), 2)

    curve = pd.criticality_curve(make, [0.0, 1.0, 2.0, 30.0])
    assert [(failure.index, type(failure.error)) for failure in curve.failures] == [
        (1, RuntimeError),
        (3, pd.NoHopf),  # it diverges
    ]
    assert np.isnan(curve.speeds).tolist() == [False, True, False, True]
    assert np.isnan(curve.laws).tolist() == [False, True, False, True]
    assert not curve.subcritical.any()


def test_points_on_an_executor_are_the_same(capsys):
    alone = pd.criticality_curve(three, [0.2, 0.7])
    with ThreadPoolExecutor(2) as executor:
        again = pd.criticality_curve(three, [0.2, 0.7], executor=executor, progress=True)
    np.testing.assert_array_equal(alone.laws, again.laws)
    assert "criticality" in capsys.readouterr().err
    assert pickle.loads(pickle.dumps(alone)).subcritical.tolist() == [False, True]


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        ({"make_model": 3}, TypeError, "make_model must be a function"),
        ({"values": [np.nan]}, ValueError, "values must"),
        ({"values": "all"}, (TypeError, ValueError), "values must"),
        ({"executor": 2}, TypeError, "executor must be"),
        ({"progress": 1}, TypeError, "progress must be True or False"),
    ],
)
def test_bad_arguments_are_refused_by_name(given, kind, message):
    arguments = {"make_model": three, "values": [0.2], **given}
    with pytest.raises(kind, match=message):
        pd.criticality_curve(**arguments)


@pytest.mark.parametrize(("n", "last"), [(3, 0.5), (4, 0.6), (5, 0.75), (6, 0.8)])
def test_chains_snap_beyond_a_share_of_fluid_that_grows_with_the_segments(n, last):
    curve = pd.criticality_curve(lambda b: pd.Chain(pd.Pipe(b), n), [0.2, last, last + 0.1, 0.95])
    assert curve.subcritical.tolist() == [False, False, True, True]


def test_two_segments_snap_where_the_fluid_is_light_only():
    curve = pd.criticality_curve(lambda b: pd.Chain(pd.Pipe(b), 2), [0.05, 0.2, 0.5, 0.9])
    assert curve.subcritical.tolist() == [True, False, False, False]


@pytest.mark.parametrize("gamma", [0.0, 10.0, 100.0])
def test_the_continuous_pipe_snaps_nowhere(gamma):
    curve = pd.criticality_curve(
        lambda b: pd.Galerkin(pd.Pipe(b, gamma=gamma), 12, "legendre"), [0.05, 0.3, 0.5, 0.7, 0.95]
    )
    assert curve.failures == ()
    assert not curve.subcritical.any()
