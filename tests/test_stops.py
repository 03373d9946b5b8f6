# SPDX-License-Identifier: MIT
"""Motion-limiting stops: what their law means for rest, motion and cycles of the pipe.

Virtual work, energy, Jacobian and operators are in test_terms.py.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn import _core

MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 40),
    "scene": lambda pipe: pp.modular.chain(pipe, 40),
    "beam modes": lambda pipe: pp.Galerkin(pipe, 6),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 8, "legendre"),
}


@pytest.mark.parametrize(
    ("kind", "error"),
    [("chain", 1e-3), ("scene", 1e-3), ("beam modes", 1e-3), ("Legendre functions", 2e-6)],
)
def test_a_buckled_pipe_leans_on_a_stop_with_the_beam_columns_force(kind, error):
    """Dead load P = lambda^2 beyond Euler's, tip on a stop: R (lambda - tan lambda) / P^1.5 = x.

    The beam-column's tip deflection under the lateral force R, with R = k (x - g); to g^2.
    """
    load, gap, stiffness = 4.0, 1e-3, 40.0
    root = math.sqrt(load)
    compliance = (root - math.tan(root)) / root**3
    force = gap / (compliance - 1.0 / stiffness)
    pipe = pp.Pipe(0.2, terms=[pp.Tension(-load), pp.Stop(at=1.0, gap=gap, stiffness=stiffness)])
    model = MODELS[kind](pipe)
    tips = pp.equilibria(model, 0.0, [lambda s: 2e-3 * s]).tips[:, 0]
    for side in (1.0, -1.0):
        assert np.abs(tips / (side * (gap + force / stiffness)) - 1.0).min() < error


def bouncing(reach, stiffness=30.0):
    """One stiff segment on a spring, with the period in which it swings to `reach` gaps.

    The motion is an arc of frequency w between the stops, and one of frequency W beyond each.
    """
    gap = 1e-4
    chain = pp.Chain(pp.Pipe(0.0, terms=[pp.Stop(1.0, gap, stiffness)]), 1, springs=[3.0])
    inertia, farthest = 1.0 / 3.0, reach * gap
    slow, fast = math.sqrt(3.0 / inertia), math.sqrt((3.0 + stiffness) / inertia)
    # Beyond the stop about the place where both springs balance.
    middle = stiffness * gap / (3.0 + stiffness)
    beyond = math.acos((gap - middle) / (farthest - middle)) / fast
    speed = (farthest - middle) * fast * math.sin(beyond * fast)
    return chain, farthest, speed, 4.0 * (beyond + math.atan(gap * slow / speed) / slow)


def test_a_segment_bounces_between_stops_in_the_time_of_two_arcs():
    chain, reach, speed, period = bouncing(1.7)
    motion = pp.simulate(chain, 0.0, 5.0 * period, [math.asin(reach)], rtol=1e-11, atol=1e-16)
    assert motion.q[-1] == pytest.approx([reach], rel=2e-7)  # angles to reach^2
    assert np.abs(motion.qdot[-1]).max() < 1e-5 * speed
    assert motion.audit < 1e-8  # up to 8.5e-9 over 120 reaches, by where steps meet the stops


@pytest.mark.parametrize("beyond", [1e-1, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_a_short_contact_is_not_stepped_over(beyond, rtol):
    """Where the stop is hardly reached, a contact is far shorter than a step."""
    missed = []
    for stiffness in np.geomspace(3.0, 300.0, 24):  # with each, steps meet the stops elsewhere
        chain, reach, _, period = bouncing(1.0 + beyond, stiffness)
        motion = pp.simulate(
            *(chain, 0.0, 2.5 * period, [math.asin(reach)]), samples=6, rtol=rtol, atol=rtol * reach
        )
        swings = motion.q[:, 0] * (-1.0) ** np.arange(6)
        rates = motion.qdot[:, 0] * (-1.0) ** np.arange(6)
        missed.append(max(np.ptp(swings), np.ptp(rates)) / math.sqrt(1.0 + stiffness / 30.0))
    assert max(missed) <= 100.0 * rtol * reach


@pytest.mark.parametrize("seed", range(40))
def test_implicit_steps_miss_no_contact_of_random_pipes(seed):
    """Explicit steps are as short as their contacts."""
    random = np.random.default_rng(seed)
    stop = pp.Stop(
        random.uniform(0.3, 1.0), random.uniform(0.01, 0.15), 10.0 ** random.uniform(1, 4)
    )
    damping = random.choice([0.0, 0.002, 0.02])
    pipe = pp.Pipe(
        random.uniform(0.05, 0.7), random.uniform(0.0, 50.0), damping=damping, terms=[stop]
    )
    n = int(random.integers(1, 7))
    model = pp.Chain(pipe, n) if random.random() < 0.7 else pp.Galerkin(pipe, min(max(n, 2), 4))
    speed, slope = random.uniform(0.0, 12.0), random.uniform(0.05, 0.5)
    implicit, explicit = (
        pp.simulate(
            *(model, speed, 1.0, model.bent(lambda s: slope * s)),
            method=method,
            rtol=rtol,
            samples=76,
        )
        for method, rtol in (("radau", 1e-8), ("dop853", 1e-10))
    )
    size = np.abs(explicit.q).max()
    np.testing.assert_allclose(implicit.q, explicit.q, rtol=0.0, atol=1e-5 * size)


@pytest.mark.parametrize("kind", MODELS)
def test_places_of_stops_are_displaced_as_the_pipe_is(kind):
    stops = pp.Stop(0.8, 0.05, 10.0), pp.Stop(0.37, 0.02, 1.0), pp.Stop(1.0, 0.3, 1.0)
    model = MODELS[kind](pp.Pipe(0.2, terms=stops))
    angles, weights, gaps = model.stop_places()
    assert gaps.tolist() == [0.02, 0.05, 0.3]
    p = model.sampled(lambda s: 0.7 * s - 0.3 * s**2)
    found = weights @ np.sin(angles @ p if angles.size else p)
    beyond = model.kinks(p[:, None], np.zeros((p.size, 1)))[:, 0].reshape(3, 2)  # by stop and side
    across = {stop.at: one - stop.gap for stop, one in zip(stops, beyond.max(axis=1), strict=True)}
    assert found == pytest.approx([across[at] for at in (0.37, 0.8, 1.0)], abs=1e-9)


@pytest.mark.parametrize("kind", ["chain", "Legendre functions"])
def test_a_pipe_that_strikes_stops_keeps_its_balance_of_energy(kind):
    pipe = pp.Pipe(
        0.3, 5.0, damping=0.01, terms=[pp.Stop(0.6, 0.02, 500.0), pp.Stop(1.0, 0.2, 50.0)]
    )
    model = pp.Chain(pipe, 6) if kind == "chain" else pp.Galerkin(pipe, 6, "legendre")
    motion = pp.simulate(model, 8.0, 4.0, lambda s: 0.5 * s, rtol=1e-9)
    assert np.abs(motion.tip[:, 0]).max() > 0.2
    assert motion.audit < 1e-7


@pytest.mark.parametrize(
    "make",
    [
        lambda pipe: pp.Chain(pipe, 4),
        lambda pipe: pp.Galerkin(pipe, 4),
        lambda pipe: pp.modular.chain(pipe, 4),
    ],
    ids=["chain", "beam modes", "scene"],
)
def test_a_cycle_between_stops_is_that_of_a_simulation_and_known_to_rounding(make):
    """Its mesh has the phases at which the pipe meets the stops; scipy's steps know of none."""
    model = make(pp.Pipe(0.2, damping=1e-3, terms=[pp.Stop(0.8, gap=0.05, stiffness=100.0)]))
    u = 1.1 * pp.critical_speed(model).speed
    cycle = pp.limit_cycle(model, u, rtol=1e-9)
    assert cycle.stable
    assert cycle.error < 1e-9
    assert cycle.multiplier_error < 1e-9
    across = np.array([model.shape(q, [0.8])[0, 0] for q in cycle.q])
    assert 0.06 < across.max() < 0.1
    start = np.concatenate([cycle.q[0], cycle.qdot[0]])
    end = solve_ivp(
        lambda t, y: model.rhs(t, y, u),
        (0.0, cycle.period),
        start,
        "DOP853",
        rtol=1e-10,
        atol=1e-12,
    ).y[:, -1]
    assert np.abs(end - start).max() < 1e-7 * np.abs(start).max()


def test_stops_bound_flutter_and_leave_the_onset():
    free, held = (
        pp.Chain(pp.Pipe(0.2, damping=2e-3, terms=terms), 4)
        for terms in ((), (pp.Stop(1.0, 0.1, 100.0),))
    )
    onset = pp.critical_speed(free).speed
    assert pp.critical_speed(held).speed == onset
    assert pp.hopf(held).amplitude_law == pytest.approx(pp.hopf(free).amplitude_law, rel=1e-9)
    wide, narrow = (pp.limit_cycle(model, 1.1 * onset).amplitude for model in (free, held))
    assert wide > 0.3
    assert 0.1 < narrow < 0.2


def test_stops_lead_to_chaos():
    """The exponent of 200 units of time is 2.45 with a spread of 0.06."""
    pipe = pp.Pipe(0.2, 10.0, damping=0.002, terms=[pp.Stop(0.8, gap=0.05, stiffness=1e3)])
    chain = pp.Chain(pipe, 4)
    u = 1.1 * pp.critical_speed(chain).speed
    found = pp.lyapunov_exponent(chain, u, duration=20.0, transient=5.0)
    assert found.value > 1.5


def test_a_stop_is_relevant_where_the_pipe_meets_it():
    pipe = pp.Pipe(0.2, damping=0.005, terms=[pp.Stop(1.0, 0.1, 100.0), pp.Stop(1.0, 2.0, 100.0)])
    near, far = map(repr, pipe.terms)
    assert pp.relevant(pipe, 5.0).negligible == (near, far)
    found = pp.relevant(pipe, 5.0, "motion", tolerance=0.1, duration=0.2, start=lambda s: 0.3 * s)
    assert found[near].verdict == "relevant"
    assert found[far].verdict == "negligible"


def test_stops_that_do_not_fit_the_states_are_refused():
    start = np.ones((4, 1))
    given = *(lambda t, y, u: y, np.zeros(1), start, 0.0, [1e-6], start, 1e6), math.inf
    how = {"jacobian": lambda t, y, u: np.eye(4)}
    none = np.zeros((0, 0))
    for angles, weights, gaps in (
        (none, np.ones((1, 5)), [1.0]),
        (none, np.ones((1, 2)), [1.0, 1.0]),
        (np.ones((3, 2)), np.ones((1, 2)), [1.0]),
        (np.ones((3, 5)), np.ones((1, 3)), [1.0]),
    ):
        with pytest.raises(ValueError, match="stops must have angles, weights and gaps that fit"):
            _core.Integrator(*given, **how, stops=(angles, weights, np.array(gaps)))
    _core.Integrator(*given, **how, stops=(np.ones((3, 4)), np.ones((1, 3)), np.ones(1)))
