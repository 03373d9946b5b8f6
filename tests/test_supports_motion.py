# SPDX-License-Identifier: MIT
"""Large motions of reduced models whose pipe is held across at its end or between."""

import math

import numpy as np
import pytest
from independent import companion_eigenvalues, derivative_along, second_derivative
from scipy.optimize import brentq
from scipy.special import ellipk
from test_terms import jacobian_by_differences, state_of

import pipedyn as pp

HELD = (
    {"root": "pinned", "end": "pinned"},
    {"end": "clamped", "supports": [0.4]},
    {"end": "pinned", "root": pp.RootSpring(3.0), "terms": [pp.Stretching(50.0)]},
    {"root": "pinned", "supports": [0.3, 0.7], "drag": 0.4},
    {"end": "clamped", "root": "pinned", "terms": [pp.PointMass(0.5, 0.2), pp.Viscosity(0.3)]},
)
SPEED = 3.0

held = pytest.mark.parametrize("given", HELD, ids=repr)
bases = pytest.mark.parametrize("basis", ["beam", "legendre"])


def model_of(given, basis, m=4, **more):
    return pp.Galerkin(pp.Pipe(0.4, 5.0, damping=2e-3, **given, **more), m, basis)


def places(model, q):
    supports = [*model.pipe.supports, *([1.0] if model.pipe.end in ("pinned", "clamped") else [])]
    return model.shape(q, supports)[:, 0]


def buckled(model, u, angle):
    """The equilibrium near a bent shape, where a branch of them begins."""
    branch = pp.equilibrium_branch(model, model.bent(angle), u, (u, 1.0001 * u))
    return branch.q[np.argmin(branch.speeds)]


@bases
@held
def test_supports_are_met_and_kept(given, basis):
    model = model_of(given, basis)
    q, slow = state_of(model)
    rates = 5.0 * slow
    assert np.abs(places(model, q)).max() < 1e-12
    assert np.abs(derivative_along(lambda at: places(model, at), q, rates, 1e-3)).max() < 1e-10
    turning = model.rhs(0.0, np.append(q, rates), SPEED)[q.size :]
    kept, left = (
        second_derivative(lambda t, a=a: places(model, q + t * rates + 0.5 * t**2 * a), 1e-4)
        for a in (turning, 0.0 * turning)
    )
    assert np.abs(kept).max() < 1e-4 * np.abs(left).max()


@pytest.mark.parametrize("supports", [[], [0.35]])
def test_forces_of_supports_are_lagranges(supports):
    """Added to the free pipe's accelerations: M^-1 G^T mu, G by differences of the drawn shape.

    Legendre functions of a pinned end are those of a free one, but for the panels of supports.
    """
    terms = [pp.PointMass(s, 1e-300) for s in supports]
    free = pp.Galerkin(pp.Pipe(0.4, 5.0, drag=0.3, terms=terms), 6 + len(supports), "legendre")
    pipe = pp.Pipe(0.4, 5.0, drag=0.3, end="pinned", supports=supports)
    model = pp.Galerkin(pipe, 5, "legendre")
    n, y = model.coordinates, np.concatenate(state_of(model))
    assert free.dof == n
    at = [*supports, 1.0]
    by = jacobian_by_differences(lambda q: free.shape(q, at)[:, 0], y[:n], np.ones(n), 1e-3)
    ours, loose = (of.rhs(0.0, y, SPEED)[n:] for of in (model, free))
    force = free.operators(y[:n]).mass @ (ours - loose)
    reaction = np.linalg.lstsq(by.T, force, rcond=0.0)[0]
    assert np.abs(by.T @ reaction - force).max() < 1e-9 * np.abs(force).max()
    assert np.abs(force).max() > 0.1
    assert model.energy(y) == pytest.approx(free.energy(y), rel=1e-13)
    assert model.power(y, SPEED).total == pytest.approx(free.power(y, SPEED).total, rel=1e-12)


@bases
@held
def test_small_motions_are_those_of_the_linear_model(given, basis):
    model = model_of(given, basis)
    n = model.coordinates
    found = np.linalg.eigvals(model.jacobian(0.0, np.zeros(2 * n), SPEED))
    expected = companion_eigenvalues(*model.operators().at(SPEED))
    missed = [np.abs(found - value).min() for value in expected]
    assert np.max(missed) < 1e-6 * np.abs(expected).max()
    # what is left is the return to the supports, (lambda + k)^2 = 0 each
    assert found.size - expected.size == 2 * (n - model.dof)


def test_operators_about_a_buckled_pipe_are_those_of_its_motion():
    pipe = pp.Pipe(0.3, 4.0, root="pinned", end="pinned", damping=1e-3, supports=[0.4])
    model = pp.Galerkin(pipe, 6, "legendre")
    u = 1.04 * pp.critical_speed(model).speed
    q = buckled(model, u, lambda s: np.sin(6.0 * s))
    assert np.abs(q).max() > 0.1
    assert np.abs(places(model, q)).max() < 1e-12
    n = model.coordinates
    expected = companion_eigenvalues(*model.operators(q).at(u))
    rates = model.jacobian(0.0, np.concatenate([q, np.zeros(n)]), u)
    values = np.linalg.eigvals(rates)
    for value in expected:
        assert np.abs(values - value).min() < 1e-6 * abs(value)


@pytest.mark.parametrize(("basis", "m", "most"), [("legendre", 10, 1e-9), ("beam", 10, 3e-5)])
def test_a_sliding_pinned_pipe_buckles_as_the_elastica(basis, m, most):
    """U^2 cos th0 = 4 K(sin(th0 / 2))^2: the jet leaves along the end's tangent."""
    u = 3.5
    expected = brentq(
        lambda turn: u**2 * math.cos(turn) - 4.0 * ellipk(math.sin(turn / 2.0) ** 2) ** 2, 0.01, 1.5
    )
    model = pp.Galerkin(pp.Pipe(0.3, root="pinned", end="pinned", damping=1e-3), m, basis)
    q = buckled(model, u, lambda s: expected * np.cos(np.pi * s))
    turned = np.arctan2(*model.shape(q, 1e-6))
    assert turned == pytest.approx(expected, rel=most)


@pytest.mark.parametrize("stiffness", [1e4, 1e5])
def test_an_axially_fixed_pipe_buckles_by_holmes_amplitude(stiffness):
    """w = A sin pi s with A^2 = 4 (U^2 - pi^2) / (stiffness pi^2), at any mass ratio.

    Holmes, J. Sound Vib. 53 (1977), 471; what is left is of the order of 1 / stiffness, A^2.
    """
    terms = [pp.Stretching(stiffness)]
    for beta, u in ((0.1, 3.3), (0.6, 4.0)):
        pipe = pp.Pipe(beta, root="pinned", end="pinned", damping=1e-3, terms=terms)
        model = pp.Galerkin(pipe, 3)
        amplitude = math.sqrt(4.0 * (u**2 - math.pi**2) / stiffness) / math.pi
        q = buckled(model, u, lambda s, a=amplitude: a * np.pi * np.cos(np.pi * s))
        x = model.shape(q, [0.5])[0, 0]
        assert x == pytest.approx(amplitude, rel=25.0 / stiffness)


def test_a_pipe_let_go_below_and_above_buckling_comes_to_rest():
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", damping=0.05, terms=[pp.Stretching(500.0)])
    model = pp.Galerkin(pipe, 3)
    for u in (2.0, 4.0):
        motion = pp.simulate(model, u, 20.0, [0.01, 0.0, 0.0], rtol=1e-9)
        assert motion.audit < 1e-6
        assert np.abs([places(model, q) for q in motion.q]).max() < 1e-13
        middle = model.shape(motion.q[-1], [0.5])[0, 0]
        bent = math.sqrt(max(u**2 - math.pi**2, 0.0) / 500.0) * 2.0 / math.pi
        assert middle == pytest.approx(bent, rel=25.0 / 500.0, abs=1e-6)


@pytest.mark.parametrize(
    "make",
    [lambda p: pp.Galerkin(p, 5), lambda p: pp.Chain(p, 10), lambda p: pp.modular.chain(p, 10)],
)
def test_of_an_end_held_across_results_watch_the_longest_span(make):
    pipe = pp.Pipe(0.3, 6.0, end="pinned", supports=[0.4], damping=1e-3)
    assert pipe.tip_place == pytest.approx(0.4 + 0.381966 * 0.6, rel=1e-6)
    assert pp.Pipe(0.3, end="guided", supports=[0.4]).tip_place == 1.0
    model = make(pipe)
    motion = pp.simulate(model, 3.0, 0.2, lambda s: 0.3 * np.sin(7.0 * s), rtol=1e-9, samples=201)
    drawn = np.array([model.shape(q, [pipe.tip_place])[0] for q in motion.q])
    assert np.abs(motion.tip - drawn).max() < 1e-12
    assert np.ptp(motion.tip[:, 0]) > 0.01
    rates = (motion.tip[2:] - motion.tip[:-2]) / (motion.t[2:] - motion.t[:-2])[:, None]
    assert np.abs(rates - motion.tip_velocity[1:-1]).max() < 1e-2 * np.abs(rates).max()


def test_a_start_that_no_support_can_hold_leaves_the_others_of_its_batch():
    model = pp.Galerkin(pp.Pipe(0.2, supports=[0.5]), 6, "legendre")
    small = model.sampled(lambda s: 0.3 * np.sin(3.0 * s))
    both = np.stack([small, 500.0 * np.cos(np.arange(small.size))], axis=1)
    found, _ = model.onto_constraints(both, 0.0 * both)
    alone, _ = model.onto_constraints(small, 0.0 * small)
    np.testing.assert_allclose(found[:, 0], alone, rtol=1e-12)
    assert np.isnan(found[:, 1]).all()


def test_starts_meet_supports_or_are_refused():
    model = pp.Galerkin(pp.Pipe(0.4, end="clamped", supports=[0.5]), 4)
    start = lambda q0, qdot0=None: pp.simulate(model, 0.0, 1e-3, q0, qdot0, samples=2)  # noqa: E731
    small = start([0.05, 0.0, 0.0, 0.0], [0.3, 0.0, 0.0, 0.0])
    assert small.q.shape == small.qdot.shape == (2, 6)
    assert np.abs(places(model, small.q[0])).max() < 1e-13
    same = start(small.q[0], small.qdot[0])
    assert same.q[0] == pytest.approx(small.q[0], abs=1e-14)
    assert same.qdot[0] == pytest.approx(small.qdot[0], abs=1e-14)
    with pytest.raises(ValueError, match="q0 and qdot0 must meet the supports, got a deviation"):
        start(np.full(6, 0.1))
    with pytest.raises(ValueError, match=r"q0 must have 4 or 6 entries, got 5"):
        start(np.zeros(5))
    with pytest.raises(ValueError, match=r'terms.0. stretches a pipe whose end is "pinned" or'):
        pp.Pipe(0.2, end="guided", terms=[pp.Stretching(3.0)])
