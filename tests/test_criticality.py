# SPDX-License-Identifier: MIT
"""Where the onset of flutter is supercritical and where subcritical."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.optimize import brentq

import pipedyn as pp


def three(beta):
    return pp.Chain(pp.Pipe(beta), 3)


def test_points_that_fail_are_marked_and_the_others_kept():
    def make(gamma):
        if gamma == 1.0:
            raise RuntimeError("no such pipe")
        return pp.Chain(pp.Pipe(0.9, gamma=gamma), 2)

    curve = pp.criticality_curve(make, [0.0, 1.0, 2.0, 30.0])
    assert [(failure.index, type(failure.error)) for failure in curve.failures] == [
        (1, RuntimeError),
        (3, pp.NoHopf),  # it diverges
    ]
    assert np.isnan(curve.speeds).tolist() == [False, True, False, True]
    assert np.isnan(curve.laws).tolist() == [False, True, False, True]
    assert not curve.subcritical.any()


def test_points_on_an_executor_are_the_same(terminal):
    alone = pp.criticality_curve(three, [0.2, 0.7])
    with ThreadPoolExecutor(2) as executor:
        again = pp.criticality_curve(three, [0.2, 0.7], executor=executor, progress=True)
    np.testing.assert_array_equal(alone.laws, again.laws)
    assert alone.failures == ()
    assert alone.speeds == pytest.approx([pp.hopf(three(b)).speed for b in (0.2, 0.7)])
    assert alone.laws[0] > 0.0 > alone.laws[1]
    assert "criticality" in terminal.readouterr().err
    assert alone.subcritical.tolist() == [False, True]


def test_models_are_made_by_a_function():
    with pytest.raises(TypeError, match="make_model must be a function"):
        pp.criticality_curve(3, [0.2])


def chain(n, gamma=0.0):
    return lambda beta: pp.Chain(pp.Pipe(beta, gamma=gamma), n)


def hanging(gamma):
    return lambda beta: pp.Galerkin(pp.Pipe(beta, gamma=gamma), 12, "legendre")


@pytest.mark.parametrize(
    ("make", "subcritical"),
    [
        # A share of fluid that grows with the number of segments divides chains,
        (chain(3), {0.2: False, 0.5: False, 0.6: True, 0.95: True}),
        (chain(4), {0.2: False, 0.6: False, 0.7: True, 0.95: True}),
        (chain(5), {0.2: False, 0.75: False, 0.85: True, 0.95: True}),
        (chain(6), {0.2: False, 0.8: False, 0.9: True, 0.95: True}),
        # but two segments are subcritical where the fluid is light only,
        (chain(2), {0.05: True, 0.2: False, 0.5: False, 0.9: False}),
        # and at heavy fluid too just before they diverge.
        (chain(2, 20.0), {0.05: True, 0.4: False, 0.8: True}),
        # The continuous pipe is so nowhere unless it hangs heavily.
        (hanging(0.0), dict.fromkeys([0.05, 0.3, 0.5, 0.7, 0.95], False)),
        (hanging(100.0), dict.fromkeys([0.05, 0.3, 0.5, 0.7, 0.95], False)),
        (hanging(300.0), {0.003: False, 0.01: True, 0.02: False}),
    ],
)
def test_where_flutter_is_subcritical_over_the_mass_ratio(make, subcritical):
    curve = pp.criticality_curve(make, [*subcritical])
    assert curve.failures == ()
    assert curve.subcritical.tolist() == [*subcritical.values()]


def test_changes_bracket_where_the_lyapunov_coefficient_passes_zero():
    curve = pp.criticality_curve(three, np.linspace(0.5, 0.65, 7))
    assert curve.changes.shape == (1, 2)
    low, high = curve.changes[0]

    def coefficient(beta):
        try:
            return pp.hopf(three(beta)).lyapunov
        except pp.NotConverged as error:  # at the root it is 0 within its error
            return error.result.lyapunov

    root = brentq(coefficient, low, high)
    assert root == pytest.approx(0.5719926, abs=1e-6)
    below, above = (pp.hopf(three(root + d)) for d in (-1e-5, 1e-5))
    assert below.amplitude_law == pytest.approx(-above.amplitude_law, rel=1e-2)
    assert below.amplitude_law > 1e4
    assert (below.criticality, above.criticality) == ("supercritical", "subcritical")
    with pytest.raises(pp.NotConverged, match="is 0 within its error"):
        pp.hopf(three(root))


def test_no_change_is_reported_across_a_point_that_failed():
    curve = pp.criticality_curve(lambda b: three(b) if b != 0.6 else None, [0.5, 0.6, 0.7])
    assert curve.subcritical.tolist() == [False, False, True]
    assert curve.changes.shape == (0, 2)


@pytest.mark.parametrize("drag", [1e-6, 0.1])
def test_with_drag_a_curve_shows_where_cycles_fold_past_their_onset(drag):
    def make(beta):
        return pp.Chain(pp.Pipe(beta, drag=drag), 2)

    curve = pp.criticality_curve(make, [0.05, 0.2])
    assert not curve.subcritical.any()
    assert np.isnan(curve.folds).tolist() == [False, True]
    assert 0.0 < curve.folds[0] - curve.speeds[0] < 0.02 * drag
    bare = pp.criticality_curve(lambda b: pp.Chain(pp.Pipe(b), 2), [0.05, 0.2])
    assert bare.subcritical.tolist() == [True, False]
    assert np.isnan(bare.folds).all()


def test_the_subcritical_cycle_of_a_heavily_hanging_continuous_pipe_follows_its_law():
    pipe = pp.Pipe(0.01, gamma=300.0)
    onset, coarser = (pp.hopf(pp.Galerkin(pipe, m, "legendre")) for m in (16, 12))
    assert onset.lyapunov == pytest.approx(coarser.lyapunov, rel=1e-3)
    cycle = pp.limit_cycle(onset.model, onset.speed - 1e-4)
    assert not cycle.stable
    assert cycle.amplitude == pytest.approx(onset.amplitude(cycle.u), rel=1e-2)
