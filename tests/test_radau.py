# SPDX-License-Identifier: MIT
"""The implicit integrator: its order, stiff problems with known solutions, chains, scenes."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from independent import any_chain
from test_integrator import moved

import pipedyn as pp
from pipedyn import modular as md


def driven(t, y):
    return np.sin(t) + np.cos(t) - y


@pytest.mark.parametrize(
    ("rates", "slopes", "start", "solution"),
    [
        (
            *(lambda t, y: np.stack([y[1], -y[0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])),
            *([1.0, 0.0], lambda t: [np.cos(t), -np.sin(t)]),
        ),
        (driven, -np.eye(1), [0.0], lambda t: [np.sin(t)]),
    ],
)
def test_equal_steps_have_order_fifteen_at_their_ends(rates, slopes, start, solution):
    """Of linear problems, of which Newton's first iterate is the solution."""
    counts = np.arange(5, 13)
    ends = [np.linspace(0.0, 24.0, count + 1)[1:] for count in counts]
    loose = {"rtol": 1e-6, "atol": 1e9, "slopes": lambda t, y: slopes}
    errors = np.array(
        [
            np.abs(moved(rates, start, t, max_step=t[0], **loose)[0][0].T - solution(t)).max()
            for t in ends
        ]
    )
    kept = (errors > 1e-11) & (errors < 1e-6)  # above rounding errors
    assert errors[kept].max() > 1e3 * errors[kept].min()
    order = -np.polyfit(np.log(counts[kept]), np.log(errors[kept]), 1)[0]
    assert order == pytest.approx(15.0, abs=0.7)


def test_errors_are_proportional_to_tolerances_over_seven_decades():
    """Looser tolerances than 2e-5 are not used."""

    def logistic(t, y):
        return y * (1.0 - y) * (1.0 + 0.5 * np.cos(t))

    def slopes(t, y):
        return np.array([[(1.0 - 2.0 * y[0]) * (1.0 + 0.5 * np.cos(t))]])

    times = np.linspace(0.0, 12.0, 61)
    exact = 1.0 / (1.0 + 99.0 * np.exp(-times - 0.5 * np.sin(times)))
    tolerances = np.logspace(-5, -12, 8)
    found = [moved(logistic, [0.01], times, rtol, slopes=slopes)[0] for rtol in tolerances]
    errors = np.array([np.abs(states[0, :, 0] - exact).max() for states in found])
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.2)
    assert (errors < 10.0 * tolerances).all()


@pytest.mark.parametrize("functions", [6, 10])
def test_fast_modes_are_not_shaken_at_loose_tolerances(functions):
    """Steps that err by 1e-3 gave motions that overflow or took 60 times as many evaluations."""
    model = pp.Galerkin(pp.Pipe(0.5, 10.0), functions)
    given = model, 9.0, 2.0, lambda s: 0.3 * s
    exact = pp.simulate(*given, method="radau", rtol=1e-10)
    tight, loose = (pp.simulate(*given, method="radau", rtol=rtol) for rtol in (1e-5, 1e-2))
    assert np.abs(loose.q - exact.q).max() < 1e-5
    assert loose.evaluations < 1.2 * tight.evaluations


@pytest.mark.parametrize("rate", [1e2, 1e5, 1e9])
def test_what_decays_at_once_costs_no_steps(rate):
    """Prothero and Robinson (1974): y' = -rate (y - sin t) + cos t, y = sin t.

    From a start off this solution, the motion falls onto it.
    """
    times = np.linspace(0.0, 10.0, 41)

    def rates(t, y):
        return -rate * (y - np.sin(t)) + np.cos(t)

    def slopes(t, y):
        return np.array([[-rate]])

    for rtol in (1e-4, 1e-7, 1e-10):
        found, [member] = moved(rates, [0.0], times, rtol, slopes=slopes)
        assert np.abs(found[0, :, 0] - np.sin(times)).max() < 10.0 * rtol
        assert member.evaluations < 3000
    found, _ = moved(rates, [4.0], times := [1.0 / rate, 2.0], 1e-8, slopes=slopes)
    exact = np.sin(times) + 4.0 * np.exp(-rate * np.array(times))
    assert found[0, :, 0] == pytest.approx(exact, abs=1e-6)


def test_van_der_pol_of_stiffness_a_million_has_its_known_end():
    """References of the problem VDPOL in Hairer and Wanner, IV.10, at eps = 1e-6."""
    eps = 1e-6

    def rates(t, y):
        return np.stack([y[1], ((1.0 - y[0] ** 2) * y[1] - y[0]) / eps])

    def slopes(t, y):
        a, b = y
        return np.array([[0.0, 1.0], [(-2.0 * a * b - 1.0) / eps, (1.0 - a * a) / eps]])

    found, [member] = moved(rates, [2.0, -0.66], [1.0, 2.0], 1e-9, 1e-11, slopes=slopes)
    known = [[-1.863646254808130, 0.753543012043], [1.706167732170483, -0.8928097010247975]]
    assert found[0] == pytest.approx(np.array(known), rel=1e-6)
    assert member.evaluations < 60_000


@pytest.mark.parametrize("n", [1, 3, 30])
def test_a_small_motion_is_the_exponential_of_the_matrix(n, each_level):
    chain = any_chain(n, 0, gamma=4.0, drag=1.5, damping=0.02)  # drag is of second order
    slopes = chain.jacobian(0.0, np.zeros(2 * n), 3.0)
    start = 1e-7 * np.cos(np.arange(n))
    times = np.array([0.02, 0.5, 1.0])
    found = pp.simulate(chain, 3.0, 1.0, start, times=times, rtol=1e-9, atol=1e-17, method="radau")
    for t, y in zip(times, found.y.T, strict=True):
        exact = scipy.linalg.expm(t * slopes) @ np.append(start, np.zeros(n))
        assert np.abs(y - exact)[:n].max() < 1e-6 * np.abs(start).max()


TERMS = (
    pp.PointMass(at=0.37, mass=0.3),
    pp.Spring(at=0.8, stiffness=30.0),
    pp.Damper(at=0.6, coefficient=2.0),
    pp.Foundation(stiffness=10.0),
)
MODELS = {
    "damped": pp.Chain(pp.Pipe(0.2, damping=0.02), 12),
    "drag": pp.Chain(pp.Pipe(0.4, gamma=5.0, damping=5e-3, drag=2.0), 9),
    "unequal": any_chain(8, 0, gamma=4.0, flow="aspirating", drag=1.5, damping=0.01),
    "terms": pp.Chain(pp.Pipe(0.3, 2.0, drag=1.0, damping=0.01, terms=TERMS), 10),
    "beam": pp.Galerkin(pp.Pipe(0.3, 2.0, damping=0.01, drag=1.0), 5),
    "legendre": pp.Galerkin(pp.Pipe(0.3, 2.0, damping=0.01, terms=TERMS[:3]), 6, "legendre"),
    "guided": md.chain(pp.Pipe(0.3, damping=0.01), 6).plus(md.Guide(3)),
    "free scene": md.chain(pp.Pipe(0.3, 2.0, drag=1.0, damping=0.01), 8).plus(*TERMS),
}


def bent(s):
    return 0.4 * s * (1.0 - 0.3 * s)


def start_of(name):
    """An angle that the model may have; a guide leaves no large one."""
    return (lambda s: 0.1 * s**2) if name == "guided" else bent


@pytest.mark.parametrize("name", MODELS)
def test_a_stiff_motion_is_that_of_scipys_radau(name):
    model, options = MODELS[name], {"samples": 11, "rtol": 1e-9}
    found, other = (
        pp.simulate(model, 4.0, 0.2, start_of(name), method=method, **options)
        for method in ("radau", "scipy:Radau")
    )
    assert np.abs(found.q - other.q).max() < 3e-8
    assert np.abs(found.qdot - other.qdot).max() < 3e-8 * max(1.0, np.abs(other.qdot).max())
    assert found.audit < 1e-7
    assert found.evaluations < 3 * other.evaluations


@pytest.mark.parametrize("name", MODELS)
def test_the_audit_falls_with_the_tolerance(name):
    options = {"q0": start_of(name), "samples": 41, "method": "radau"}
    audits = [
        pp.simulate(MODELS[name], 4.0, 1.0, rtol=rtol, **options).audit
        for rtol in (1e-4, 1e-7, 1e-10)
    ]
    assert (np.array(audits) < [1e-3, 2e-6, 5e-9]).all()


def test_a_scene_whose_nodes_nothing_holds_moves_as_a_chain_does_without_matrices(monkeypatch):
    pipe = pp.Pipe(0.3, 2.0, drag=1.0, damping=0.01)
    scene, chain = md.chain(pipe, 40).plus(*TERMS), pp.Chain(replace(pipe, terms=TERMS), 40)
    monkeypatch.delattr("pipedyn.models.base.Model.motion_jacobian")
    options = {"samples": 6, "rtol": 1e-8, "method": "radau"}
    found, other = (pp.simulate(model, 4.0, 0.3, bent, **options) for model in (scene, chain))
    assert found.evaluations == other.evaluations
    assert np.abs(found.tip - other.tip).max() < 1e-10


def test_a_speed_in_time_acts_in_the_derivative_too():
    model = MODELS["terms"]
    speeds = {"u": lambda t: 3.0 + np.sin(5.0 * t), "duration": 1.0, "q0": bent, "samples": 11}
    found, other = (
        pp.simulate(model, method=method, rtol=1e-9, **speeds) for method in ("radau", "dop853")
    )
    assert np.abs(found.q - other.q).max() < 1e-7
    assert found.evaluations < 0.5 * other.evaluations


def test_members_move_as_each_does_alone():
    model, speeds = MODELS["drag"], np.array([2.0, 6.0, 4.0])
    many = pp.simulate_many(model, speeds, 0.5, bent, samples=6, method="radau")
    for motion, u in zip(many.motions, speeds, strict=True):
        alone = pp.simulate(model, u, 0.5, bent, samples=6, method="radau")
        np.testing.assert_array_equal(motion.q, alone.q)
        assert motion.evaluations == alone.evaluations


def test_vector_levels_agree(levels, at_level):
    def ends():
        return [
            pp.simulate(MODELS[name], 4.0, 0.5, start_of(name), rtol=1e-10, samples=3).q
            for name in ("terms", "legendre", "guided")
        ]

    widest = ends()
    for level in levels:
        at_level(level)
        for other, found in zip(ends(), widest, strict=True):
            assert np.abs(other - found).max() < 1e-9


def test_a_thousand_damped_segments_take_no_more_steps_than_twenty():
    calls = [
        pp.simulate(pp.Chain(pp.Pipe(0.2, damping=0.01), n), 6.0, 0.5, bent, samples=3).evaluations
        for n in (20, 1000)
    ]
    assert calls[1] < 2 * calls[0]


def test_a_step_vanishes_as_soon_before_time_0_as_after():
    """y' = y^2 from 1 is infinite a unit of time later."""
    taken = []
    for t0 in (2.0, -4.0):
        _, [member] = moved(
            *(lambda t, y: y**2, [1.0], [t0 + 2.0], 1e-8, 1e-10),
            t0=t0,
            slopes=lambda t, y: np.array([[2.0 * y[0]]]),
        )
        assert member.time == pytest.approx(t0 + 1.0, abs=1e-6)
        assert member.progress in ("not finite", "vanishing")
        taken.append(member.evaluations)
    assert taken[1] == pytest.approx(taken[0], rel=0.1)


def test_a_wrong_jacobian_is_refused_and_a_singular_one_is_no_harm():
    still = (lambda t, y: np.zeros_like(y), [1.0, 2.0], [1.0], 1e-6)
    with pytest.raises(ValueError, match="a Jacobian must hold 4 numbers"):
        moved(*still, slopes=lambda t, y: np.zeros(3))
    found, _ = moved(*still, slopes=lambda t, y: np.zeros((2, 2)))
    assert found[0].tolist() == [[1.0, 2.0]]
