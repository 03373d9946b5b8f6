# SPDX-License-Identifier: MIT
"""Largest Lyapunov exponents: rest, cycles, chaos; two routes to the same number."""

import itertools
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn.motion.lyapunov import exponents_together, pooled

CHAIN = pp.Chain(pp.Pipe(0.2), 3)


def mean_growth(rates, y, transient, duration, blocks, rtol=1e-8):
    """Means over blocks of the growth of v' = J(y) v along y' = f(y), brought back to length 1.

    rates: function of t, y and v that gives f(y) and J(y) v; each column of y is a motion.
    """
    v, growth, step = np.cos(np.arange(y.size)).reshape(y.shape), [], 0.25

    def both_rates(t, both):
        return np.concatenate(rates(t, *both.reshape(2, *y.shape))).ravel()

    for _ in range(round((transient + duration) / step)):
        both = np.concatenate([y, v / np.linalg.norm(v, axis=0)]).ravel()
        end = solve_ivp(both_rates, (0.0, step), both, method="DOP853", rtol=rtol, atol=0.01 * rtol)
        y, v = end.y[:, -1].reshape(2, *y.shape)
        growth.append(np.log(np.linalg.norm(v, axis=0)) / step)
    return np.mean(np.reshape(growth[round(transient / step) :], (blocks, -1)), axis=1)


def rates_of(model, u):
    return lambda t, y, v: (model.rhs(t, y, u), model.jacobian(t, y, u) @ v)


def lorenz(t, y, v):
    (a, b, c), (da, db, dc) = y, v
    f = 10.0 * (b - a), a * (28.0 - c) - b, a * b - 8.0 / 3.0 * c
    df = 10.0 * (db - da), da * (28.0 - c) - a * dc - db, da * b + a * db - 8.0 / 3.0 * dc
    return np.array(f), np.array(df)


def test_mean_growth_is_the_known_exponent_of_the_lorenz_attractor():
    """So the route to which exponents of pipes are compared is that of a published number."""
    near = np.stack([np.linspace(-8.0, 8.0, 200), np.linspace(-8.0, 8.0, 200), np.full(200, 25.0)])
    blocks = mean_growth(lorenz, near, 20.0, 20.0, 10, rtol=1e-6)
    # 0.9056: Sprott (2003), Chaos and Time-Series Analysis, table of exponents. The means of three
    # such sets of starts lie within 0.004 of it.
    assert blocks.mean() == pytest.approx(0.9056, abs=0.01)
    assert blocks.std() < 0.1


def test_exponent_at_rest_is_the_largest_real_part():
    pipe = pp.Pipe(0.2, -10.0, damping=0.02)  # buckled, and more than one mode decays slowly
    chain = pp.Chain(pipe, 3)
    rest = pp.equilibria(chain, 1.0)
    k = int(np.argmax(rest.tips[:, 0]))
    found = pp.lyapunov_exponent(chain, 1.0, rest.q[k] + 0.05, duration=30.0, transient=20.0)
    assert abs(found.value - rest.growth[k]) < min(2.0 * found.spread + 1e-3, 0.01)
    assert found.value < 0.0
    assert not found.chaotic


def test_exponent_of_a_cycle_is_zero_within_its_spread():
    found = pp.lyapunov_exponent(CHAIN, 5.5, duration=40.0, transient=20.0)
    assert abs(found.value) < 2.0 * found.spread
    assert abs(found.value) < 0.05
    assert not found.chaotic


@pytest.mark.slow
def test_three_segments_are_chaotic_far_beyond_onset_by_either_route():
    # The cycle gives way to a torus near u = 8.35 and that to chaos: the largest multipliers and
    # brute force say the same.
    found = pp.lyapunov_exponent(CHAIN, 11.0, duration=24.0, transient=8.0)
    rates, start = rates_of(CHAIN, 11.0), np.full(6, 0.1)
    blocks = mean_growth(rates, start, 8.0, 24.0, 12, rtol=1e-6)  # means suffice
    assert found.chaotic
    spread = math.hypot(found.spread, blocks.std() / math.sqrt(11.0))
    assert abs(found.value - blocks.mean()) < 4.0 * spread
    assert 3.0 < found.value < 5.5


def test_a_pair_about_a_bent_pipe_at_rest_takes_steps_as_long_as_its_motion():
    """Its rates are rounding: tolerances below that would make steps a thousand times as short."""
    model, calls = pp.Chain(pp.Pipe(0.2, -20.0, damping=0.005), 4), itertools.count()

    def idle(q, qdot):
        if next(calls) > 100_000:
            raise ArithmeticError("the law was asked too often")
        return 0.0 * q

    scene = pp.modular.chain(model.pipe, 4).plus(pp.modular.Custom(joints=(1,), force=idle))
    rest = pp.equilibria(model, 1.0)
    stable = np.flatnonzero(rest.stable)[0]
    found = pp.lyapunov_exponent(scene, 1.0, rest.q[stable], duration=20.0, transient=10.0)
    assert found.value == pytest.approx(rest.growth[stable], abs=2.0 * found.spread)


def test_both_routes_agree_along_the_same_motion():
    model, start = pp.Chain(pp.Pipe(0.2, -20.0), 2), np.array([0.4, -0.3, 0.0, 0.5])
    found = pp.lyapunov_exponent(model, 4.0, start, duration=20.0, transient=10.0)
    blocks = mean_growth(rates_of(model, 4.0), start, 10.0, 20.0, 10)
    np.testing.assert_allclose(found.blocks, blocks, atol=1e-5)


def test_differences_that_change_much_in_an_interval_are_measured_more_often():
    """Over eight units of time the difference of motions at rest would fall below rounding."""
    found, short = (
        pp.lyapunov_exponent(CHAIN, 2.0, duration=32.0, transient=8.0, blocks=4, interval=interval)
        for interval in (8.0, 0.5)
    )
    assert found.t.size > 4
    np.testing.assert_allclose(found.blocks, short.blocks, atol=1e-5)


def test_differences_that_cannot_be_followed_are_refused():
    """Upright, a difference grows in each interval by exp(39), and they are as many as may be."""
    model, many = pp.Chain(pp.Pipe(0.2, -1e5), 1), {"duration": 2.6e5, "interval": 0.1}
    with pytest.raises(pp.NotConverged, match="motions part or meet in no time"):
        pp.lyapunov_exponent(model, 0.0, np.zeros(1), transient=0.0, **many)


def test_stiff_pipe_is_followed_by_an_implicit_method():
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.05), 8, "legendre")
    found = pp.lyapunov_exponent(model, 2.0, duration=10.0, transient=10.0)
    assert found.value == pytest.approx(pp.eigenvalues(model, 2.0).real.max(), abs=0.3)


def test_motion_goes_on_from_where_another_ended():
    motion = pp.simulate(CHAIN, 5.5, 30.0, lambda s: 0.1 * s)
    found = pp.lyapunov_exponent(CHAIN, 5.5, motion, duration=20.0, transient=5.0)
    assert abs(found.value) < 0.2
    assert found.history.shape == found.t.shape
    assert found.history[-1] == pytest.approx(found.value, abs=1e-12)
    assert found.t[-1] == pytest.approx(20.0)
    assert found.end.shape == (6,)


def test_exponent_may_be_taken_along_a_cycle():
    # Two cycles at one speed: on the unstable one the exponent is that of its multiplier.
    model = pp.Chain(pp.Pipe(0.7), 3)
    onset = pp.hopf(model)
    u = onset.speed - 2e-3
    repelling = pp.limit_cycle(model, u, onset, rtol=1e-8)
    growth = math.log(abs(repelling.multipliers[0])) / repelling.period
    found = pp.lyapunov_exponent(model, u, repelling, duration=40.0, transient=80.0)
    assert found.value == pytest.approx(growth, rel=0.1)
    stable = pp.limit_cycle(CHAIN, 5.5)
    along = pp.lyapunov_exponent(CHAIN, 5.5, stable, duration=20.0, transient=0.5)
    assert abs(along.value) < 3.0 * along.spread


def test_exponent_goes_on_from_the_state_at_its_end():
    first = pp.lyapunov_exponent(CHAIN, 5.5, duration=10.0, transient=10.0)
    again = pp.lyapunov_exponent(CHAIN, 5.5, first.end, duration=10.0, transient=0.0)
    motion = pp.simulate(CHAIN, 5.5, 10.0, first.end[:3], first.end[3:], rtol=1e-9)
    np.testing.assert_allclose(again.end, motion.y[:, -1], atol=1e-6)


def test_scene_agrees_with_its_chain():
    pipe = pp.Pipe(0.2)
    scene, chain = pp.modular.chain(pipe, n=2), pp.Chain(pipe, 2)
    a, b = (
        pp.lyapunov_exponent(model, 5.0, duration=10.0, transient=5.0) for model in (scene, chain)
    )
    np.testing.assert_allclose(a.blocks, b.blocks, atol=1e-5)


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (lambda: pp.lyapunov_exponent(CHAIN, 1.0, [1.0]), ValueError, "start must have 3"),
        (
            lambda: pp.lyapunov_exponent(CHAIN, 1.0, "x"),
            TypeError,
            "start must be a LimitCycle, a Mo",
        ),
        (lambda: pp.lyapunov_exponent(CHAIN, 1.0, pp.hopf(CHAIN)), TypeError, "start must be a L"),
        (
            lambda: pp.lyapunov_exponent(CHAIN, 1.0, duration=1e6, interval=1e-6),
            ValueError,
            "interval must cut",
        ),
    ],
)
def test_bad_arguments_are_refused_by_name(call, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        call()


def test_motion_of_another_model_is_refused():
    motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 2), 1.0, 1.0, [0.1, 0.1])
    expected = (
        "start must be a Motion in the model's coordinates, angles of 3 segments, got angles of 2"
    )
    with pytest.raises(ValueError, match=expected):
        pp.lyapunov_exponent(CHAIN, 1.0, motion)


def test_a_pair_whose_motion_stops_says_so():
    edge = pp.modular.Custom(
        nodes=(2,),
        force=lambda q, v: 0.0 * q + np.where(np.abs(q[0].real) > 0.2, np.nan, 0.0),
    )
    scene = pp.modular.chain(pp.Pipe(0.2), 2).plus(edge)
    with pytest.raises(pp.NotConverged, match=r"the motion stopped: .* no longer finite"):
        pp.lyapunov_exponent(scene, 6.0, duration=40.0, transient=0.0)


def test_exponents_of_several_motions_together_are_those_of_each_alone():
    """Chaos beyond doubt needs no more time.

    Rounding decides which motion a chaotic one is: of two, one may take long, or be on a cycle.
    """
    model = pp.Chain(pp.Pipe(0.3), 3)
    asked = {"cycles": 0, "brute_force": 1, "transient": 8.0, "duration": 75.0}
    found = pp.bifurcation_diagram(model, [9.3, 9.5], **asked).motions
    irregular = [one for one in found if one.exponent is not None]
    assert irregular
    assert all(one.ending == "chaotic" for one in irregular)
    early = min(irregular, key=lambda one: one.exponent.duration)
    assert early.exponent.duration < 100.0 < 2.0 * asked["duration"]
    alone = pp.lyapunov_exponent(model, early.speed, early.end, duration=100.0, transient=5.0)
    allowed = 3.0 * np.hypot(alone.spread, early.exponent.spread)  # it is large where it ends early
    assert early.exponent.value == pytest.approx(alone.value, abs=allowed)


@pytest.mark.parametrize(("u", "chaotic"), [(6.0, False), (8.5, True)])
def test_exponents_along_known_states_are_those_of_motions_that_are_integrated(u, chaotic):
    model = pp.Chain(pp.Pipe(0.3), 3)
    motion = pp.simulate(model, u, 150.0, lambda s: 0.1 * s, samples=15_001, rtol=1e-8)
    states = np.concatenate([motion.q, motion.qdot], axis=1)[5000:]
    options = {"duration": 80.0, "transient": 10.0}
    [along] = exponents_together(model, [u], [states[::50]], interval=0.5, **options)
    [own] = exponents_together(model, [u], [states[0]], **options)
    assert along.chaotic == own.chaotic == chaotic
    assert abs(along.value - own.value) < 3.0 * (along.spread + own.spread)
    if not chaotic:  # the difference does not grow, and the last state is that of the record
        assert along.value == pytest.approx(0.0, abs=3.0 * along.spread)
        assert along.t.size == 160
        assert np.array_equal(along.end, states[-1])
    # Where few states are known, the transient is shortened first.
    [short] = exponents_together(model, [u], [states[::50][:162]], interval=0.5, **options)
    assert short.duration == pytest.approx(80.0) or short.chaotic
    longer = pooled(along, short)
    assert longer.duration == along.duration + short.duration == longer.t[-1]
    mean = np.average([along.value, short.value], weights=[along.duration, short.duration])
    assert longer.value == pytest.approx(mean, abs=1e-12) == longer.history[-1]
    assert np.array_equal(longer.end, short.end)
