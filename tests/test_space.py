# SPDX-License-Identifier: MIT
"""Chains in three dimensions: against virtual work, plane motions, energy and known numbers."""

import pickle
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import spatial
from scipy.optimize import root

import pipedyn as pp
from pipedyn import _core, plot
from pipedyn.models.base import core_pipe
from pipedyn.models.segments import core_segments

PIPES = {
    "plain": pp.Pipe(0.3),
    "heavy": pp.Pipe(0.3, gamma=7.0),
    "with drag": pp.Pipe(0.3, drag=0.4),
    "damped": pp.Pipe(0.3, damping=0.05),
    "standing, damped, with drag": pp.Pipe(0.4, gamma=-5.0, damping=0.2, drag=1.0),
    "aspirating": pp.Pipe(
        0.3, flow="aspirating", alpha=0.5, inflow_share=0.3, damping=0.1, gamma=3.0
    ),
    "in a dense fluid": pp.Pipe(0.3, gamma=4.0, damping=0.05, terms=[pp.AddedMass(0.7)]),
}
ASKEW = {  # not the same in all directions across the axis
    "jet": pp.Pipe(0.3, jet_angle=0.6, damping=0.05),
    "jet in a dense fluid": pp.Pipe(0.3, jet_angle=-1.4, terms=[pp.AddedMass(0.4)]),
}
CONSERVATIVE = {
    "spring": pp.Spring(0.55, 30.0),
    "foundation": pp.Foundation(20.0),
    "cubic spring": pp.CubicSpring(0.7, 400.0),
    "stop": pp.Stop(0.8, 0.02, 300.0),
    "tension": pp.Tension(3.0),
    "rotational spring": pp.RotationalSpring(0.6, 2.0),
}
DISSIPATIVE = {
    "damper": pp.Damper(0.55, 1.5),
    "viscosity": pp.Viscosity(0.7),
    "rotational damper": pp.RotationalDamper(0.6, 0.3),
}


def random_state(n, amplitude, seed=0):
    random = np.random.default_rng(seed)
    return random.normal(size=(n, 2)) * amplitude, 3.0 * random.normal(size=(n, 2))


def as_state(a, rates):
    return np.concatenate([a.T.ravel(), rates.T.ravel()])


def change_of_energy(model, y, u):
    """Rate of the energy along a motion, by differences of eighth order.

    At a quarter of the step, rounding of the energy of the stiffest model is 2e-9 of the rate.
    """
    rates = model.rhs(0.0, y, u)
    h = 0.4 / np.abs(rates).max()
    weights = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    pairs = [model.energy(y + k * h * rates) - model.energy(y - k * h * rates) for k in range(1, 5)]
    return weights @ pairs / h


def accelerations(chain, y, u, **forcing):
    return chain.rhs(0.0, y, u, **forcing)[chain.dof :].reshape(2, -1).T


@pytest.mark.parametrize("pipe", (PIPES | ASKEW).values(), ids=PIPES | ASKEW)
@pytest.mark.parametrize("amplitude", [1e-3, 0.3, 0.8])
def test_accelerations_balance_the_virtual_work_of_all_forces(pipe, amplitude):
    chain = pp.Chain(pipe, 5, dimensions=3)
    a, rates = random_state(5, amplitude)
    expected = spatial.accelerations(chain.planar, a, rates, 4.0)
    found = accelerations(chain, as_state(a, rates), 4.0)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["standing, damped, with drag", "in a dense fluid"])
def test_a_moving_base_and_an_unsteady_flow_act_in_all_directions(kind):
    chain = pp.Chain(PIPES[kind], 5, base=0.1, dimensions=3)
    a, rates = random_state(5, 0.5)
    base = np.random.default_rng(1).normal(size=(3, 3))
    expected = spatial.accelerations(chain.planar, a, rates, 4.0, 1.3, base)
    found = accelerations(chain, as_state(a, rates), 4.0, u_dot=1.3, base=base)
    assert found == pytest.approx(expected, rel=1e-12)
    turned = [[row[2], row[1], -row[0]] for row in base]
    y = chain.turned(as_state(a, rates), -np.pi / 2)
    back = chain.turned(chain.rhs(0.0, y, 4.0, u_dot=1.3, base=turned), np.pi / 2)
    found = back[chain.dof :].reshape(2, -1).T
    assert found == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize(
    "pipe",
    [
        *PIPES.values(),
        *(pp.Pipe(0.3, terms=[one]) for one in (CONSERVATIVE | DISSIPATIVE).values()),
    ],
    ids=[*PIPES, *CONSERVATIVE, *DISSIPATIVE],
)
@pytest.mark.parametrize("azimuth", [0.0, 0.7, 4.0])
def test_a_motion_in_any_plane_through_the_axis_is_the_planar_one(pipe, azimuth):
    chain = pp.Chain(pipe, 6, dimensions=3)
    y = np.random.default_rng(2).normal(size=12) * np.repeat([0.4, 3.0], 6)
    none = np.zeros(6)
    embedded = chain.turned(np.concatenate([y[:6], none, y[6:], none]), azimuth)
    back = chain.turned(chain.rhs(0.0, embedded, 5.0), -azimuth)
    expected = chain.planar.rhs(0.0, y, 5.0)
    size = np.abs(expected).max()
    assert back[12:18] == pytest.approx(expected[6:], abs=3e-15 * size)
    assert back[18:] == pytest.approx(none, abs=3e-15 * size)
    assert chain.energy(embedded) == pytest.approx(chain.planar.energy(y), rel=1e-14)
    powers, planar = chain.power(embedded, 5.0), chain.planar.power(y, 5.0)
    for name in ("flow", "joints", "drag", "others"):
        assert getattr(powers, name) == pytest.approx(getattr(planar, name), rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("pipe", (PIPES | ASKEW).values(), ids=PIPES | ASKEW)
def test_the_energy_changes_at_the_rate_of_the_powers(pipe):
    chain = pp.Chain(pipe, 5, dimensions=3)
    y = as_state(*random_state(5, 0.4))
    assert change_of_energy(chain, y, 4.0) == pytest.approx(chain.power(y, 4.0).total, rel=1e-9)


def generalised_load(term, a, rates):
    """Chains of four without a term and with it, and the generalised force (8,) of the term."""
    y = as_state(a, rates)
    plain, with_term = (
        pp.Chain(pp.Pipe(0.3, terms=terms), 4, dimensions=3) for terms in ((), [term])
    )
    jacobian = spatial.jacobian(a)
    places = np.tril(np.full((4, 4), 0.25), -1) + 0.125 * np.eye(4)
    turning = 0.25 / np.sqrt(12.0) * np.eye(4)
    mass = sum(
        0.25 * np.einsum("jk,jm,kdc,mde->ckem", rows, rows, jacobian, jacobian)
        for rows in (places, turning)
    ).reshape(8, 8)
    added = with_term.rhs(0.0, y, 0.0) - plain.rhs(0.0, y, 0.0)
    return plain, with_term, mass @ added[8:]


@pytest.mark.parametrize("term", CONSERVATIVE.values(), ids=CONSERVATIVE)
def test_loads_of_terms_are_the_slopes_of_their_energy(term):
    a, none = random_state(4, 0.4)[0], np.zeros((4, 2))
    plain, with_term, load = generalised_load(term, a, none)
    y = as_state(a, none)
    h = 1e-5
    slopes = [
        (with_term.energy(y + h * one) - with_term.energy(y - h * one)) / (2.0 * h)
        - (plain.energy(y + h * one) - plain.energy(y - h * one)) / (2.0 * h)
        for one in np.eye(16)[:8]
    ]
    assert load == pytest.approx(-np.array(slopes), rel=1e-5, abs=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("term", DISSIPATIVE.values(), ids=DISSIPATIVE)
def test_resistances_take_the_energy_that_their_power_says(term):
    chain = pp.Chain(pp.Pipe(0.0, terms=[term]), 4, dimensions=3)
    y = as_state(*random_state(4, 0.4))
    rates, h = chain.rhs(0.0, y, 0.0), 1e-6
    change = (chain.energy(y + h * rates) - chain.energy(y - h * rates)) / (2.0 * h)
    power = chain.power(y, 0.0)
    assert power.others < 0.0
    assert change == pytest.approx(power.others, rel=1e-5)


@pytest.mark.parametrize("pipe", (PIPES | ASKEW).values(), ids=PIPES | ASKEW)
def test_the_jacobian_is_the_derivative_of_the_rates(pipe):
    chain = pp.Chain(pipe, 4, dimensions=3)
    y, h = as_state(*random_state(4, 0.5)), 1e-6
    differences = np.stack(
        [
            (chain.rhs(0.0, y + h * one, 4.0) - chain.rhs(0.0, y - h * one, 4.0)) / (2.0 * h)
            for one in np.eye(16)
        ],
        axis=1,
    )
    found = chain.jacobian(0.0, y, 4.0)
    assert found == pytest.approx(differences, abs=1e-8 * np.abs(found).max())
    both = chain.motion_linearised(y[:, None], 4.0)[0]
    assert both[0] == pytest.approx(chain.rhs(0.0, y, 4.0), rel=1e-13)
    by_speed = (chain.rhs(0.0, y, 4.0 + h) - chain.rhs(0.0, y, 4.0 - h)) / (2.0 * h)
    assert both[1] == pytest.approx(by_speed, rel=1e-6, abs=1e-7 * np.abs(by_speed).max())
    assert both[2:] == pytest.approx(found, abs=1e-14 * np.abs(found).max())


def test_states_of_a_batch_have_the_rates_that_they_have_alone():
    chain = pp.Chain(PIPES["damped"], 7, dimensions=3)
    y = 0.5 * np.random.default_rng(3).normal(size=(28, 13))
    alone = np.stack([chain.rhs(0.0, one, 4.0) for one in y.T.copy()], axis=1)
    assert chain.rhs(0.0, y, 4.0) == pytest.approx(alone, rel=1e-11, abs=1e-11)


def test_tangents_turned_by_more_than_half_a_turn_keep_their_motion():
    # Beyond a square of 10 the coefficients come from closed forms instead of polynomials.
    chain = pp.Chain(pp.Pipe(0.3), 3, dimensions=3)
    for rho in (3.1, 3.2, 5.0, 9.0):
        a = np.array([[rho, 0.3], [rho - 0.4, 0.5], [rho + 0.1, -0.2]])
        rates = random_state(3, 1.0)[1]
        expected = spatial.accelerations(chain.planar, a, rates, 3.0)
        assert accelerations(chain, as_state(a, rates), 3.0) == pytest.approx(expected, rel=1e-9)


def test_without_flow_energy_and_angular_momentum_about_the_axis_stay():
    chain = pp.Chain(pp.Pipe(0.2, gamma=5.0), 6, dimensions=3)
    start = chain.bent(lambda s: 0.8 * s, lambda s: -0.5 * s**2)
    motion = pp.simulate(chain, 0.0, 5.0, start, chain.quarter_turn(start), rtol=1e-9)
    shares = np.array([0.5 - 1.0 / np.sqrt(12.0), 0.5 + 1.0 / np.sqrt(12.0)])
    s = ((np.arange(6)[:, None] + shares) / 6.0).ravel()  # Gauss points of the segments

    def momentum(q, qdot):
        r = chain.shape(q, s)
        h = 1e-6
        v = (chain.shape(q + h * qdot, s) - chain.shape(q - h * qdot, s)) / (2.0 * h)
        return float((r[:, 2] * v[:, 0] - r[:, 0] * v[:, 2]).sum()) / s.size

    momenta = [momentum(motion.q[i], motion.qdot[i]) for i in (0, 100, 300, 500)]
    assert abs(momenta[0]) > 0.01
    assert momenta == pytest.approx([momenta[0]] * 4, rel=1e-6)
    assert motion.energy == pytest.approx(motion.energy[0], rel=1e-7)


@pytest.mark.parametrize("method", ["radau", "dop853", "scipy:DOP853"])
def test_integrators_agree_on_a_motion_that_leaves_every_plane(method):
    chain = pp.Chain(pp.Pipe(0.2), 5, dimensions=3)
    motion = pp.simulate(chain, 6.0, 5.0, method=method, rtol=1e-9, samples=3)
    reference = pp.simulate(chain, 6.0, 5.0, method="radau", rtol=1e-11, samples=3)
    assert motion.tip == pytest.approx(reference.tip, abs=1e-6)
    assert np.abs(reference.tip[-1, 2]) > 1e-3


def test_motions_end_in_the_circular_motion_where_that_attracts():
    chain = pp.Chain(pp.Pipe(0.2), 5, dimensions=3)
    circular = pp.rotating_motion(chain, 6.0)
    assert circular.stable
    motion = pp.simulate(chain, 6.0, 40.0)
    radius = np.hypot(motion.tip[-100:, 0], motion.tip[-100:, 2])
    assert radius == pytest.approx(circular.radius, rel=2e-3)
    assert motion.tip[-100:, 1] == pytest.approx(circular.height, rel=1e-3)


@pytest.mark.parametrize(
    ("n", "radius", "frequency"), [(10, 0.2200244, 14.336072), (20, 0.2029163, 14.361318)]
)
def test_the_circular_motion_of_a_chain_is_that_of_an_independent_program(n, radius, frequency):
    # The numbers come from the dense equations of another program.
    found = pp.rotating_motion(pp.Chain(pp.Pipe(0.2), n, dimensions=3), 6.0)
    assert found.radius == pytest.approx(radius, abs=1e-7)
    assert found.frequency == pytest.approx(frequency, abs=1e-6)


def extrapolated(quantity, n=(20, 40)):
    """Limit of long chains, whose error is of second order."""
    few, many = (quantity(pp.Chain(pp.Pipe(0.2), size, dimensions=3)) for size in n)
    return many + (many - few) / ((n[1] / n[0]) ** 2 - 1.0)


def test_circular_motions_of_chains_tend_to_that_of_the_continuous_pipe():
    # A boundary-value problem of the continuous pipe gives .19683612, 14.3689601 and .9598544.
    def numbers(chain):
        found = pp.rotating_motion(chain, 6.0)
        return np.array([found.radius, found.frequency, found.height])

    assert extrapolated(numbers) == pytest.approx([0.19683612, 14.3689601, 0.9598544], rel=3e-4)


def test_coefficients_of_the_onset_tend_to_those_of_the_continuous_pipe():
    def numbers(chain):
        found = pp.hopf(chain)
        return np.array([found.own, found.other])

    expected = np.array([-85.899 + 84.678j, -89.929 - 50.232j])
    assert np.abs(extrapolated(numbers, (10, 20)) - expected).max() < 0.05


def test_the_onset_in_space_holds_that_in_the_plane():
    found = pp.hopf(pp.Chain(pp.Pipe(0.35, gamma=10.0, damping=0.005), 8, dimensions=3))
    assert found.own + found.other == pytest.approx(16.0 * found.plane.cubic, rel=1e-6)
    assert found.planar_law == pytest.approx(found.plane.amplitude_law, rel=1e-6)


@pytest.mark.parametrize(
    ("beta", "stable"),
    [(0.1, "planar"), (0.25, "rotating"), (0.5, "planar"), (0.65, "rotating"), (0.8, "planar")],
)
def test_flutter_is_born_planar_or_rotating_by_the_share_of_the_fluid(beta, stable):
    # The continuous pipe changes at .194958, the fold .2972, .588074 and the fold .6954.
    assert pp.hopf(pp.Chain(pp.Pipe(beta), 20, dimensions=3)).stable == stable


@pytest.mark.parametrize("beta", [0.1, 0.2, 0.5])
def test_laws_of_the_onset_hold_next_to_it(beta):
    chain = pp.Chain(pp.Pipe(beta), 8, dimensions=3)
    onset = pp.hopf(chain)
    u = onset.speed + 1e-3
    circular = pp.rotating_motion(chain, u)
    assert circular.radius**2 == pytest.approx(1e-3 * onset.rotating_law, rel=0.02)
    slow = circular.exponents[np.abs(circular.exponents.real).argsort()]
    # Of the critical pair, the amplitude decays at -2 mu, and the opposite motion at its exponent.
    wanted = 1e-3 * onset.rotating_exponent
    assert np.abs(slow.real - wanted).min() < 0.03 * abs(wanted)
    plane = pp.limit_cycle(chain, u)
    across = np.log(np.abs(plane.across)) / plane.period
    assert plane.amplitude**2 == pytest.approx(1e-3 * onset.planar_law, rel=0.02)
    wanted = 1e-3 * onset.planar_exponent
    assert np.abs(across - wanted).min() < 0.03 * abs(wanted)


def test_a_planar_cycle_is_unstable_across_its_plane_where_circular_motion_attracts():
    # The continuous pipe has the multiplier 1.04878 across the plane.
    assert extrapolated(lambda chain: abs(pp.limit_cycle(chain, 6.0).across[0]), (10, 20)) == (
        pytest.approx(1.04878, abs=1e-3)
    )
    cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 10, dimensions=3), 6.0)
    assert not cycle.stable
    assert pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 10), 6.0).stable
    assert np.abs(cycle.across - 1.0).min() < 1e-6
    assert np.abs(cycle.others - 1.0).min() > 1e-2
    assert cycle.tip.shape == (257, 3)


def test_linear_questions_have_the_answers_of_the_planar_chain():
    chain = pp.Chain(pp.Pipe(0.2, damping=0.01), 8, dimensions=3)
    assert pp.critical_speed(chain).speed == pp.critical_speed(chain.planar).speed
    assert pp.eigenvalues(chain, 4.0, 4) == pytest.approx(pp.eigenvalues(chain.planar, 4.0, 4))
    operators = chain.operators()
    assert operators.mass[:8, :8] == pytest.approx(chain.planar.operators().mass)
    jacobian = chain.jacobian(0.0, np.zeros(32), 4.0)[16:]
    mass, damping, stiffness = operators.at(4.0)
    assert mass @ jacobian == pytest.approx(np.hstack([-stiffness, -damping]), abs=1e-10)


def test_a_chain_in_space_is_kept_by_files_and_pickles(tmp_path):
    chain = pp.Chain(pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0)]), 4, base=0.1, dimensions=3)
    y = as_state(*random_state(4, 0.3))
    for other in (pickle.loads(pickle.dumps(chain)), chain.with_pipe(chain.pipe)):
        assert other.rhs(0.0, y, 3.0).tolist() == chain.rhs(0.0, y, 3.0).tolist()
    found = pp.rotating_motion(pp.Chain(pp.Pipe(0.2), 4, dimensions=3), 6.0)
    found.save(tmp_path / "found.npz")
    back = pp.load(tmp_path / "found.npz")
    assert back.model.dimensions == 3
    assert back.q.tolist() == found.q.tolist()


def test_shapes_and_velocities_are_those_of_the_segments():
    chain = pp.Chain(pp.Pipe(0.2), 4, base=0.2, dimensions=3)
    a, rates = random_state(4, 0.6)
    q, qdot = a.T.ravel(), rates.T.ravel()
    ends = chain.shape(q, [0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
    expected = np.cumsum(0.2 * spatial.tangents(a), axis=0)
    expected[:, 1] += 0.2
    assert ends[0].tolist() == [0.0, 0.1, 0.0]
    assert ends[2:] == pytest.approx(expected, abs=1e-14)
    assert chain.tip(q) == pytest.approx(expected[-1], abs=1e-14)
    h = 1e-6
    velocity = (chain.tip(q + h * qdot) - chain.tip(q - h * qdot)) / (2.0 * h)
    assert chain.tip_velocities(q[:, None], qdot[:, None])[0] == pytest.approx(velocity, rel=1e-7)
    planar = chain.planar.curvatures(a[:, :1])
    in_plane = np.concatenate([a[:, 0], np.zeros(4)])
    assert chain.curvatures(chain.turned(in_plane, 1.1)[:, None]) == pytest.approx(planar)


@pytest.mark.parametrize("dimensions", [1, 4, 2.0, 2.5, True, "3"])
def test_only_two_and_three_dimensions_exist(dimensions):
    makes = [lambda **one: pp.Chain(pp.Pipe(0.2), 4, **one)]
    makes += [lambda **one: pp.Galerkin(pp.Pipe(0.2), 4, **one)]
    for make in (*makes, partial(pp.Continuum, pp.Pipe(0.2))):
        with pytest.raises((ValueError, TypeError), match="dimensions must be"):
            make(dimensions=dimensions)


def test_circular_motions_are_those_of_models_in_space():
    chain = pp.Chain(pp.Pipe(0.2), 4, dimensions=3)
    with pytest.raises(ValueError, match="model must move in three dimensions"):
        pp.rotating_motion(chain.planar, 6.0)
    with pytest.raises(pp.NotConverged, match="no circular motion was found at u = 3"):
        pp.rotating_motion(chain, 3.0)


# ------------------------------------------------------------------------------- reduced models

REDUCED = {
    "legendre": (5, 0.5),
    "beam": (4, 0.1),
}
LOADED = pp.Pipe(
    0.3,
    gamma=-5.0,
    damping=0.2,
    terms=[
        pp.PointMass(0.6, 0.2, inertia=0.01),
        *CONSERVATIVE.values(),
        *DISSIPATIVE.values(),
    ],
)
CONTINUOUS = {
    **PIPES,
    "loaded": LOADED,
    "on a spring": pp.Pipe(0.3, root=pp.RootSpring(4.0), damping=0.02),
    "tapered": pp.Pipe(
        0.3, stiffness=lambda s: 1.0 - 0.4 * s, mass=pp.Profile([0.5], [1.0, 1.4]), damping=0.01
    ),
    "thick": pp.Pipe(0.3, rotary_inertia=1e-3),
}


def reduced_state(m, size, planes, seed=4):
    random = np.random.default_rng(seed)
    sizes = np.tile(size / np.arange(1.0, m + 1.0) ** 2, planes)
    return np.concatenate([random.normal(size=sizes.size) * sizes * rate for rate in (1.0, 5.0)])


@pytest.mark.parametrize("pipe", CONTINUOUS.values(), ids=CONTINUOUS)
@pytest.mark.parametrize("basis", REDUCED)
def test_a_reduced_motion_in_any_plane_is_the_planar_one(pipe, basis):
    m, size = REDUCED[basis]
    m = 16 if basis == "legendre" and pipe is LOADED else m
    model = pp.Galerkin(pipe, m, basis, dimensions=3)
    y, none = reduced_state(m, size, 1), np.zeros(m)
    embedded = model.turned(np.concatenate([y[:m], none, y[m:], none]), 0.8)
    found = model.turned(model.rhs(0.0, embedded, 4.0), -0.8)[2 * m :]
    expected = model.planar.rhs(0.0, y, 4.0)[m:]
    # The planar quadrature ends integrals of drag at the zeros of the velocity across the pipe.
    error = (1e-4 if pipe.drag else 1e-12) * np.abs(expected).max()
    assert found[:m] == pytest.approx(expected, abs=error)
    assert found[m:] == pytest.approx(none, abs=error)
    assert model.energy(embedded) == pytest.approx(model.planar.energy(y), rel=1e-13)
    assert model.tip(embedded[: 2 * m])[1] == pytest.approx(model.planar.tip(y[:m])[1], rel=1e-14)


@pytest.mark.parametrize("pipe", (CONTINUOUS | ASKEW).values(), ids=CONTINUOUS | ASKEW)
def test_reduced_rates_have_their_power_and_their_derivatives(pipe):
    m = 16 if pipe is LOADED else 5
    model, h = pp.Galerkin(pipe, m, "legendre", dimensions=3), 1e-6
    y = reduced_state(m, 0.5, 2)
    assert change_of_energy(model, y, 4.0) == pytest.approx(model.power(y, 4.0).total, rel=1e-9)
    differences = np.stack(
        [
            (model.rhs(0.0, y + h * one, 4.0) - model.rhs(0.0, y - h * one, 4.0)) / (2.0 * h)
            for one in np.eye(4 * m)
        ],
        axis=1,
    )
    found = model.jacobian(0.0, y, 4.0)
    assert found == pytest.approx(differences, abs=1e-7 * np.abs(found).max())
    states = np.stack([y, 0.5 * y, 0.1 * y], axis=1)
    alone = np.stack([model.rhs(0.0, one, 4.0) for one in states.T.copy()], axis=1)
    size = np.abs(alone).max()
    assert model.rhs(0.0, states, 4.0) == pytest.approx(alone, abs=1e-12 * size)


@pytest.mark.parametrize(
    ("pipe", "duration"),
    [
        (pp.Pipe(0.3, gamma=5.0, damping=0.02), 0.2),
        (pp.Pipe(0.3, damping=0.02, jet_angle=0.8, terms=[pp.AddedMass(0.7)]), 0.05),
    ],
)
def test_chains_tend_to_the_reduced_model_in_space(pipe, duration):
    # The curvature is 0 at the free end, as that of every smooth motion.
    bends = (lambda s: 0.6 * s - 0.3 * s**2), (lambda s: 0.2667 * s**3 - 0.4 * s**2)

    def tip(make):
        model = make(dimensions=3)
        start = model.bent(*bends)
        return pp.simulate(model, 5.0, duration, start, samples=2, rtol=1e-9).tip[-1]

    expected = tip(partial(pp.Galerkin, pipe, 10, "legendre"))
    few, many = (tip(partial(pp.Chain, pipe, n)) - expected for n in (12, 24))
    assert np.abs(many).max() < 3e-4
    assert np.linalg.norm(few) / np.linalg.norm(many) == pytest.approx(4.0, abs=0.2)


def test_circular_motions_of_the_continuous_pipe_have_the_numbers_of_a_boundary_value_problem():
    found = pp.rotating_motion(pp.Galerkin(pp.Pipe(0.2), 10, "legendre", dimensions=3), 6.0)
    numbers = found.radius, found.frequency, found.height
    assert numbers == pytest.approx((0.19683612, 14.3689601, 0.9598544), abs=1e-6)
    assert found.exponents[0] == pytest.approx(-0.09509 + 27.61212j, abs=1e-5)
    assert found.stable
    other = pp.rotating_motion(pp.Galerkin(pp.Pipe(0.5), 12, "legendre", dimensions=3), 9.8)
    assert (other.radius, other.frequency) == pytest.approx((0.1424226, 27.992926), rel=2e-5)
    assert not other.stable


@pytest.mark.parametrize(
    ("numbers", "own", "other"),
    [
        ({"beta": 0.1}, -116.157 + 162.434j, -18.603 - 136.692j),
        ({"beta": 0.2}, -85.899 + 84.678j, -89.929 - 50.232j),
        ({"beta": 0.5}, -653.02 + 29.43j, -498.11 - 280.56j),
        ({"beta": 0.2, "gamma": 10.0}, -82.279, -100.146),
        ({"beta": 0.4, "gamma": 10.0}, -924.81, -591.03),
        ({"beta": 0.6, "gamma": 10.0}, -338.10, -406.24),
        ({"beta": 0.2, "damping": 0.005}, -86.328, -87.870),
        ({"beta": 0.4, "damping": 0.005}, -312.29, -305.06),
        ({"beta": 0.6, "damping": 0.005}, -277.41, -276.57),
        ({"beta": 0.2, "gamma": 10.0, "damping": 0.005}, -87.488, -99.505),
        ({"beta": 0.5, "gamma": 10.0, "damping": 0.005}, -403.41, -371.01),
    ],
)
def test_coefficients_of_the_continuous_pipe_are_those_of_another_program(numbers, own, other):
    # Where no imaginary parts stand, only real parts were handed over.
    found = pp.hopf(pp.Galerkin(pp.Pipe(**numbers), 12, "legendre", dimensions=3))
    for value, known in ((found.own, own), (found.other, other)):
        assert value.real == pytest.approx(np.real(known), abs=0.02)
        if isinstance(known, complex):
            assert value.imag == pytest.approx(known.imag, abs=0.02)


def test_the_planar_cycle_of_the_continuous_pipe_has_its_multiplier_across():
    cycle = pp.limit_cycle(pp.Galerkin(pp.Pipe(0.2), 8, "legendre", dimensions=3), 6.0)
    assert (cycle.amplitude, cycle.frequency) == pytest.approx((0.2766139, 13.791497), rel=2e-5)
    assert abs(cycle.across[0]) == pytest.approx(1.04878, abs=1e-5)
    assert np.abs(cycle.multipliers - 0.47873).min() < 1e-5


@pytest.mark.filterwarnings("ignore:the largest angle:pipedyn.UnusualPipe")
def test_a_reduced_model_stops_where_its_coordinates_end():
    model = pp.Galerkin(pp.Pipe(0.2), 4, "legendre", dimensions=3)
    q = model.bent(lambda s: 3.3 * s, lambda s: 0.2 * s)
    with pytest.raises(pp.NotResolved, match="coordinates of a reduced model in three dimensions"):
        model.rhs(0.0, np.concatenate([q, 0.0 * q]), 1.0)
    start = model.bent(lambda s: 3.0 * s, lambda s: 0.2 * s)
    why = "its tangent turns by 3.* rad, and the coordinates of a reduced model in three dimensions"
    for q0, qdot0 in ((start, 10.0 * start), (q, None)):
        with pytest.raises(pp.MotionStopped, match=why):
            pp.simulate(model, 1.0, 1.0, q0, qdot0)
    [failure] = pp.simulate_many(model, [1.0], 1.0, [start], 10.0 * start).failures
    assert "coordinates of a reduced model" in str(failure.error)


# ------------------------------------------------------------------------------ rest that is bent


@pytest.mark.parametrize(
    ("gamma", "inclination", "across", "in_plane"),
    [
        (10.0, np.pi / 2.0, (5.7797017, 13.982365), 5.9544239),
        (20.0, np.pi / 2.0, (6.2343973, 14.653427), 6.6770006),
        (10.0, np.pi / 4.0, (6.1903078, 14.736836), 6.2632989),
    ],
)
def test_a_pipe_that_sags_flutters_first_across_the_plane_of_sag(
    gamma, inclination, across, in_plane
):
    # The numbers come from a boundary-value problem of the continuous pipe.
    pipe = pp.Pipe(0.2, gamma=gamma, inclination=inclination)
    model = pp.Galerkin(pipe, 10, "legendre", dimensions=3)
    first, second = pp.crossings(model, in_plane + 0.05)
    assert (first.speed, first.frequency) == pytest.approx(across, abs=2e-6)
    assert second.speed == pytest.approx(in_plane, abs=1e-6)
    found = pp.critical_speed(model)  # without the warning that planar models bring
    assert found.speed == pytest.approx(first.speed, abs=1e-9)
    stiffer = pp.critical_speed(model.with_pipe(replace(pipe, gamma=gamma + 0.01)))
    lighter = pp.critical_speed(model.with_pipe(replace(pipe, gamma=gamma - 0.01)))
    slope = (stiffer.speed - lighter.speed) / 0.02
    assert found.sensitivity.speed.gamma == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
def test_operators_about_a_bent_rest_are_the_derivatives_of_the_motion(make):
    pipe = pp.Pipe(
        *(0.3, 8.0, "aspirating", 0.7),
        **{"inclination": 1.2, "damping": 0.03, "inflow_share": 0.4},
        terms=[pp.Load(0.7, (2.0, 1.0)), pp.Damper(0.5, 0.3), pp.FollowerForce(0.4, 2.0)],
    )
    model = make(pipe, 5, dimensions=3)
    rest = np.append(pp.equilibria(model.planar, 1.5).q[0], np.zeros(5))
    mass, damping, stiffness = model.operators(rest).at(1.5)
    slopes = model.jacobian(0.0, np.append(rest, 0.0 * rest), 1.5)[10:]
    size = np.abs(stiffness).max()
    assert mass @ slopes == pytest.approx(np.hstack([-stiffness, -damping]), abs=1e-9 * size)
    assert np.linalg.eigvalsh(mass).min() > 0.0
    every = pp.eigenvalues(model.about(rest), 1.5)
    for one in pp.eigenvalues(model.planar.about(rest[:5]), 1.5):
        assert np.abs(every - one).min() < 1e-6 * (1.0 + abs(one))
    with pytest.raises(ValueError, match=r"q must lie in the plane z = 0"):
        model.about(rest + 0.1)


def test_hysteresis_acts_across_a_bent_rest_as_in_its_plane():
    level = pp.Pipe(0.2, gamma=5.0, inclination=np.pi / 2.0, hysteresis=0.05)
    model = pp.Galerkin(level, 6, "legendre", dimensions=3)
    every = pp.eigenvalues(model, 2.0)
    for one in pp.eigenvalues(model.planar, 2.0, 6):
        assert np.abs(every - one).min() < 1e-6 * (1.0 + abs(one))
    straight = pp.eigenvalues(pp.Galerkin(replace(level, gamma=1e-6), 6, "legendre"), 2.0, 6)
    nearly = pp.Galerkin(replace(level, gamma=1e-6), 6, "legendre", dimensions=3)
    for one in straight:
        assert np.count_nonzero(np.abs(pp.eigenvalues(nearly, 2.0) - one) < 1e-4 * abs(one)) == 2


@pytest.mark.parametrize("seed", range(6))
def test_motions_about_a_bent_rest_start_to_grow_at_the_critical_speed(seed):
    random = np.random.default_rng(seed)
    pipe = pp.Pipe(
        *(random.uniform(0.1, 0.6), random.uniform(0.0, 25.0)),
        **{"inclination": random.uniform(0.3, 2.6), "damping": 0.01},
        terms=[
            pp.Load(random.uniform(0.3, 1.0), random.normal(size=2)),
            pp.PointMass(random.uniform(0.3, 1.0), random.uniform(0.0, 0.5)),
            pp.Damper(random.uniform(0.3, 1.0), random.uniform(0.0, 0.3)),
        ],
    )
    model = (
        pp.Chain(pipe, 4, dimensions=3)
        if seed % 2
        else pp.Galerkin(pipe, 6, "legendre", dimensions=3)
    )
    found = pp.critical_speed(model, 20.0)
    assert found.kind == "flutter"
    planar, (rest,) = model.planar, pp.equilibria(model.planar, 0.9 * found.speed).q

    def turned(q, u):
        return planar.rhs(0.0, np.append(q, 0.0 * q), u)[q.size :]

    growth = []
    for u in [*np.linspace(0.9 * found.speed, found.speed - 0.02, 9), found.speed + 0.02]:
        rest = root(turned, rest, u).x
        state = np.append(rest, np.zeros(3 * rest.size))
        growth.append(np.linalg.eigvals(model.jacobian(0.0, state, u)).real.max())
    assert max(growth[:-1]) < 0.0 < growth[-1]


# --------------------------------------------------- laws that differ in x and z, and held places


def off_axis(of, x, z):
    return x * of[0] ** 2 + z * of[2] ** 2


def angles_of(t):
    """Rotation vector of a tangent."""
    across = np.array([t[0], t[2]])
    return np.arctan2(np.linalg.norm(across), t[1]) * across / np.linalg.norm(across)


def spin_of(t, rate, x, z):
    w = np.cross(t, rate)
    return x * w[2] ** 2 + 0.5 * (x + z) * w[1] ** 2 + z * w[0] ** 2


# Energy or power as a textbook writes it, of the place, its velocity, the tangent and its rate.
UNEVEN_SPRINGS = {
    "spring": (pp.Spring(0.55, 30.0, 4.0), lambda r, v, t, rate: 0.5 * off_axis(r, 30.0, 4.0)),
    "spring along z": (pp.Spring(0.55, 0.0, 9.0), lambda r, v, t, rate: 4.5 * r[2] ** 2),
    "cubic spring": (
        pp.CubicSpring(0.7, 400.0, 100.0),
        lambda r, v, t, rate: 0.25 * off_axis(r, 20.0, 10.0) ** 2,
    ),
    "bars": (
        pp.Stop(0.8, 0.02, 300.0, 0.0),
        lambda r, v, t, rate: 150.0 * max(abs(r[0]) - 0.02, 0.0) ** 2,
    ),
    "window": (
        pp.Stop(0.8, 0.02, 300.0, 200.0),
        lambda r, v, t, rate: (
            150.0 * max(abs(r[0]) - 0.02, 0.0) ** 2 + 100.0 * max(abs(r[2]) - 0.02, 0.0) ** 2
        ),
    ),
    "rotational spring": (
        pp.RotationalSpring(0.6, 2.0, 7.0),
        lambda r, v, t, rate: 0.5 * angles_of(t) ** 2 @ [2.0, 7.0],
    ),
}
UNEVEN_DAMPERS = {
    "damper": (pp.Damper(0.55, 1.5, 0.2), lambda r, v, t, rate: -off_axis(v, 1.5, 0.2)),
    "rotational damper": (
        pp.RotationalDamper(0.6, 0.3, 1.1),
        lambda r, v, t, rate: -spin_of(t, rate, 0.3, 1.1),
    ),
}
UNEVEN = UNEVEN_SPRINGS | UNEVEN_DAMPERS


def gradient(function, at, h=1e-3):
    """Derivatives by central differences of fourth order."""
    return np.array(
        [
            (
                8.0 * (function(at + d) - function(at - d))
                - function(at + 2 * d)
                + function(at - 2 * d)
            )
            / (12.0 * h)
            for d in h * np.eye(at.size)
        ]
    )


@pytest.mark.parametrize(("term", "law"), UNEVEN.values(), ids=UNEVEN)
def test_laws_that_differ_in_x_and_z_are_those_of_a_textbook(term, law):
    a, rates = random_state(4, 0.4)
    _, chain, load = generalised_load(term, a, rates)

    def of_law(q, qdot):
        a, rates = q.reshape(2, 4).T, qdot.reshape(2, 4).T
        segment = int(4.0 * term.at)
        by = spatial.jacobian(a)
        t, turning = spatial.tangents(a), np.einsum("jkc,jc->jk", by, rates)
        lengths = np.append(np.full(segment, 0.25), term.at - 0.25 * segment)
        r, v = lengths @ t[: segment + 1], lengths @ turning[: segment + 1]
        return law(r, v, t[segment], turning[segment])

    q, qdot = a.T.ravel(), rates.T.ravel()
    y = as_state(a, rates)
    if isinstance(term, pp.Damper | pp.RotationalDamper):
        assert chain.power(y, 0.0).others == pytest.approx(of_law(q, qdot), rel=1e-12)
        expected = 0.5 * gradient(lambda x: of_law(q, x), qdot)
    else:
        bare = pp.Chain(pp.Pipe(0.0), 4, dimensions=3).energy(y)
        assert chain.energy(y) - bare == pytest.approx(of_law(q, qdot), rel=1e-12)
        expected = -gradient(lambda x: of_law(x, qdot), q)
    assert load == pytest.approx(expected, rel=1e-9, abs=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
@pytest.mark.parametrize("term", [term for term, _ in UNEVEN.values()], ids=UNEVEN)
def test_laws_that_differ_in_x_and_z_act_in_both_planes_by_their_own_numbers(make, term):
    pipe = pp.Pipe(0.3, 5.0, damping=0.02, terms=[term, pp.Foundation(3.0, 8.0)])
    model, none, size = make(pipe, 6, dimensions=3), np.zeros(6), 0.5
    y = np.random.default_rng(2).normal(size=12) * np.repeat([0.4, 3.0], 6)
    y *= 1.0 if make is pp.Chain else np.tile(size / np.arange(1.0, 7.0) ** 2, 2)
    for k, numbers in enumerate((pipe, replace(pipe, terms=tuple(t.across() for t in pipe.terms)))):
        halves = [[y[:6], none], [y[6:], none]]
        embedded = np.concatenate([part for half in halves for part in half[:: 1 - 2 * k]])
        expected = make(numbers, 6).rhs(0.0, y, 4.0)[6:]
        found = model.rhs(0.0, embedded, 4.0)[12:].reshape(2, 6)
        error = 1e-13 * np.abs(expected).max() if make is pp.Chain else 1e-11
        assert found[k] == pytest.approx(expected, rel=1e-11, abs=error)
        assert found[1 - k] == pytest.approx(none, abs=error)
        assert model.energy(embedded) == pytest.approx(make(numbers, 6).energy(y), rel=1e-12)


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
@pytest.mark.parametrize("term", [term for term, _ in UNEVEN.values()], ids=UNEVEN)
def test_uneven_laws_change_the_energy_by_their_power_and_have_a_jacobian(make, term):
    model, h = make(pp.Pipe(0.3, damping=0.02, terms=[term]), 5, dimensions=3), 1e-6
    y = as_state(*random_state(5, 0.4)) if make is pp.Chain else reduced_state(5, 0.3, 2)
    assert change_of_energy(model, y, 4.0) == pytest.approx(model.power(y, 4.0).total, rel=1e-9)
    steps = h * np.eye(20)
    columns = [model.rhs(0.0, y + d, 4.0) - model.rhs(0.0, y - d, 4.0) for d in steps]
    found = model.jacobian(0.0, y, 4.0)
    assert found == pytest.approx(np.transpose(columns) / (2 * h), abs=1e-7 * np.abs(found).max())
    batch = np.stack([y, 0.5 * y, 0.1 * y], axis=1)
    alone = np.stack([model.rhs(0.0, one, 4.0) for one in batch.T.copy()], axis=1)
    assert model.rhs(0.0, batch, 4.0) == pytest.approx(alone, abs=1e-12 * np.abs(alone).max())


def test_a_motion_between_bars_keeps_its_energy():
    pipe = pp.Pipe(0.2, gamma=5.0, terms=[pp.Stop(0.8, 0.05, 500.0, stiffness_across=0.0)])
    chain = pp.Chain(pipe, 5, dimensions=3)
    start, rates = chain.bent(lambda s: 0.05 * s, lambda s: -0.4 * s), chain.bent(lambda s: 1.5 * s)
    motion = pp.simulate(chain, 0.0, 3.0, start, rates, rtol=1e-9)
    reach = np.abs([chain.shape(q, 0.8) for q in motion.q]).max(axis=0)
    assert 0.055 < reach[0] < 0.07 < 0.12 < reach[2]  # free along the bars alone
    assert motion.energy == pytest.approx(motion.energy[0], rel=1e-7)


STRETCHED = [("stretching", 1.0, [40.0, 0.8])]


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
def test_an_axial_spring_at_the_end_acts_in_space_as_in_the_plane(make):
    # The end is free here, as the law does not depend on how it is held.
    model = make(pp.Pipe(0.3, damping=0.02), 5, dimensions=3)
    planar = model.planar.with_applied(STRETCHED)
    pipe = core_pipe(model.pipe, STRETCHED)
    vars(model)["core"] = (
        _core.SpatialChain(pipe, core_segments(planar, spring=planar.springs))
        if make is pp.Chain
        else _core.SpatialGalerkin(pipe, True, 5, planar._joints, planar._more)
    )
    y, none = np.random.default_rng(5).normal(size=10) * np.repeat([0.2, 1.0], 5), np.zeros(5)
    embedded = model.turned(np.concatenate([y[:5], none, y[5:], none]), 0.7)
    base = np.random.default_rng(6).normal(size=(3, 2))
    turned = np.stack([np.cos(0.7) * base[:, 0], base[:, 1], np.sin(0.7) * base[:, 0]], axis=1)
    found = model.turned(model.rhs(0.0, embedded, 4.0, base=turned), -0.7)[10:]
    expected = planar.rhs(0.0, y, 4.0, base=base)[5:]
    assert found[:5] == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    assert found[5:] == pytest.approx(none, abs=1e-12 * np.abs(expected).max())
    assert model.energy(embedded) == pytest.approx(planar.energy(y), rel=1e-13)
    powers = model.power(embedded, 4.0, base=turned), planar.power(y, 4.0, base=base)
    for name in ("others", "base", "joints", "flow"):
        each = [getattr(one, name) for one in powers]
        assert each[0] == pytest.approx(each[1], rel=1e-11)
    y = reduced_state(5, 0.3, 2)
    assert change_of_energy(model, y, 4.0) == pytest.approx(model.power(y, 4.0).total, rel=1e-9)


@pytest.mark.parametrize("across", [0.0, 5.0, 20.0 * (1.0 + 1e-6), 20.0 * (1.0 + 1e-12), 100.0])
@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
def test_linear_questions_see_both_planes_of_a_pipe_whose_springs_differ(make, across):
    pipe = pp.Pipe(0.2, damping=0.001, terms=[pp.Spring(0.5, 20.0, across)])
    model = make(pipe, 10, dimensions=3)
    planes = [make(replace(pipe, terms=[pp.Spring(0.5, k)]), 10) for k in (20.0, across)]
    each = [pp.crossings(plane, 12.0) for plane in planes]
    expected = sorted(one.speed for found in each for one in found)
    assert len(each[0]) > 0 < len(each[1])
    found = pp.crossings(model, 12.0)
    assert [one.speed for one in found] == pytest.approx(expected, rel=1e-12)
    for one, after in pairwise(found):
        assert one.unstable_after == after.unstable_before
    growing = (pp.eigenvalues(model, 12.0).real > 0.0).sum()
    assert found[-1].unstable_after == growing
    critical = pp.critical_speed(model)
    assert critical.speed == pytest.approx(expected[0], rel=1e-12)
    lower = min((pp.critical_speed(plane) for plane in planes), key=lambda one: one.speed)
    assert critical.mode == lower.mode
    assert critical.discretisation == pytest.approx(lower.discretisation, abs=1e-9)
    both = np.concatenate([pp.eigenvalues(plane, 4.0) for plane in planes])
    values = pp.eigenvalues(model, 4.0)
    assert np.sort(values.real) == pytest.approx(np.sort(both.real), abs=1e-6)
    assert np.sort(values.imag) == pytest.approx(np.sort(both.imag), abs=1e-6)
    if abs(across - 20.0) > 1.0:
        for shape in pp.modes(model, 4.0, count=4).shapes:
            sizes = np.abs(shape([0.3, 0.5, 0.9])).max(axis=1)
            assert sizes.min() < 1e-9 < 0.1 < sizes.max()  # in one plane each


def test_a_damper_across_the_plane_alone_damps_motions_there():
    pipe = pp.Pipe(0.0, alpha=0.0, terms=[pp.Damper(0.7, 0.0, coefficient_across=0.5)])
    values = pp.eigenvalues(pp.Chain(pipe, 4, dimensions=3), 0.0)
    assert (np.abs(values.real) < 1e-10).sum() == 8
    assert (values.real < -1e-3).sum() == 8


def test_a_hysteretic_pipe_has_the_roots_of_both_planes():
    pipe = pp.Pipe(0.2, hysteresis=0.05, terms=[pp.Spring(0.5, 20.0, 5.0)])
    values = pp.eigenvalues(pp.Chain(pipe, 6, dimensions=3), 3.0)
    for k in (20.0, 5.0):
        for one in pp.eigenvalues(pp.Chain(replace(pipe, terms=[pp.Spring(0.5, k)]), 6), 3.0):
            assert np.abs(values - one).min() < 1e-9 * abs(one)


UNLIKE = {
    "spring": pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0, 1.0)]),
    "bars": pp.Pipe(0.2, terms=[pp.Stop(0.8, 0.1, 50.0, 50.0)]),
    "jet": pp.Pipe(0.2, jet_angle=0.3),
    "level": pp.Pipe(0.2, 5.0, inclination=1.0),
}


@pytest.mark.parametrize("pipe", UNLIKE.values(), ids=UNLIKE)
def test_questions_about_circular_motion_need_the_same_pipe_in_all_directions(pipe):
    chain = pp.Chain(pipe, 4, dimensions=3)
    with pytest.raises(ValueError, match="must be the same in all directions across its axis"):
        pp.rotating_motion(chain, 6.5)
    if pipe.has_kinks:  # small motions do not reach the bars, and are alike in all planes
        with pytest.raises(pp.NoHopf, match="two pairs are the same at the onset"):
            pp.hopf(chain)
        return
    onset = pp.hopf(chain)  # in the plane that flutters first
    assert onset.speed == pytest.approx(pp.critical_speed(chain).speed)
    cycle = pp.limit_cycle(chain, onset.speed + 1e-3)
    assert cycle.amplitude**2 == pytest.approx(1e-3 * onset.amplitude_law, rel=0.02)
    same = pp.Chain(pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0, 3.0)]), 4, dimensions=3)
    assert same.pipe.symmetric_about_axis
    assert pp.hopf(same).own == pytest.approx(
        pp.hopf(same.with_pipe(pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0)]))).own, rel=1e-6
    )


def test_linear_questions_count_both_planes_of_springs_that_differ():
    pipe = pp.Pipe(0.2, terms=[pp.Spring(0.5, 30.0, 1.0)])
    chain, u = pp.Chain(pipe, 6, dimensions=3), 3.0
    planes = [pp.Chain(one, 6) for one in (pipe, pipe.across())]
    assert [one.pipe.terms[0].stiffness for one in planes] == [30.0, 1.0]
    modes = pp.modes(chain, u, 6)
    loci = pp.root_loci(chain, [0.0, u], count=6)
    for across, plane in enumerate(planes):
        known = pp.eigenvalues(plane, u)
        for found in (
            modes.eigenvalues[modes.across == across],
            loci.eigenvalues[-1, loci.across == across],
        ):
            assert found.size
            assert np.abs(found[:, None] - known).min(axis=1) == pytest.approx(0.0, abs=1e-7)
    speeds = [pp.critical_speed(plane).speed for plane in planes]
    critical = pp.critical_speed(chain)
    assert critical.speed == pytest.approx(min(speeds))
    assert critical.across == (speeds[1] < speeds[0])
    exact = pp.critical_speed(pp.Continuum(pipe, dimensions=3))
    assert exact.speed == pytest.approx(
        min(pp.critical_speed(pp.Continuum(plane.pipe)).speed for plane in planes)
    )
    assert critical.discretisation == pytest.approx(abs(critical.speed - exact.speed), rel=1e-3)


@pytest.mark.parametrize(("kind", "ones"), [("even", 2), ("uneven", 1), ("level", 1)])
def test_only_a_symmetric_pipe_has_a_multiplier_1_across_the_plane_of_a_cycle(kind, ones):
    pipe = {
        "even": pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0)]),
        "uneven": pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0, 6.0)]),
        "level": pp.Pipe(0.2, 1.0, inclination=1.0),
    }[kind]
    chain = pp.Chain(pipe, 4, dimensions=3)
    # A level pipe flutters across its plane first; that cycle lies in no plane. Near u = 5.4 those
    # of both onsets come so close that rounding would decide on which of them a longer way ends.
    first = kind == "level"
    cycle = pp.limit_cycle(chain, 5.2 if first else 6.5, start=pp.hopf(chain) if first else None)
    assert (np.abs(cycle.multipliers - 1.0) < 1e-5).sum() == ones
    assert cycle.others.size == cycle.multipliers.size - ones
    if kind == "level":  # it lies in no plane
        assert cycle.across is None
    else:
        assert (np.abs(cycle.across - 1.0) < 1e-5).sum() == ones - 1


def test_a_pipe_with_a_jet_at_an_angle_flutters_first_across_the_plane_of_its_rest():
    # As tests/spatial.py derives the direction of the jet. The planar model gives 5.66779.
    model = pp.Galerkin(pp.Pipe(0.2, jet_angle=0.2), 8, "legendre", dimensions=3)
    found = pp.critical_speed(model)
    assert found.speed < 5.66
    modes = pp.modes(model, found.speed + 0.01, count=2)
    (grown,) = [shape for shape in modes.shapes if shape.eigenvalue.real > 0.0]
    sizes = np.abs(grown([0.5, 0.9])).max(axis=1)
    assert sizes[0] < 1e-9 < 0.3 < sizes[1]  # across the plane
    rest = np.append(pp.equilibria(model.planar, found.speed).q[0], np.zeros(8))
    values = np.linalg.eigvals(model.jacobian(0.0, np.append(rest, 0.0 * rest), found.speed))
    assert values.real.max() == pytest.approx(0.0, abs=1e-5)
    at = values[np.argmax(values.real)]
    assert abs(at.imag) == pytest.approx(found.frequency, rel=1e-6)


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
def test_added_mass_in_space_takes_its_power_from_a_moving_base_as_in_the_plane(make):
    model = make(PIPES["in a dense fluid"], 5, dimensions=3)
    y, none = reduced_state(5, 0.4, 1), np.zeros(5)
    embedded = model.turned(np.concatenate([y[:5], none, y[5:], none]), 0.7)
    base = np.random.default_rng(6).normal(size=(3, 2))
    turned = np.stack([np.cos(0.7) * base[:, 0], base[:, 1], np.sin(0.7) * base[:, 0]], axis=1)
    found = model.power(embedded, 4.0, u_dot=0.6, base=turned)
    expected = model.planar.power(y, 4.0, u_dot=0.6, base=base)
    for name in ("flow", "joints", "others", "base"):
        each = [getattr(one, name) for one in (found, expected)]
        assert each[0] == pytest.approx(each[1], rel=1e-11)


@pytest.mark.parametrize("make", [pp.Chain, partial(pp.Galerkin, basis="legendre")])
def test_shapes_of_modes_about_a_bent_rest_are_small_changes_of_the_pipe(make):
    pipe = pp.Pipe(0.2, 12.0, inclination=1.2, damping=0.01)
    model = make(pipe, 6, dimensions=3)
    found = pp.modes(model, 3.0, count=4)
    about, s, h = found.shapes[0].model, np.array([0.3, 0.55, 1.0]), 1e-4
    rest = about.resting()
    for shape in found.shapes:
        change = np.real(shape.coordinates)
        moved = (about.shape(rest + h * change, s) - about.shape(rest - h * change, s)) / (2.0 * h)
        assert np.real(shape(s)) == pytest.approx(moved[:, [0, 2]].T, abs=1e-7)
        assert np.abs(shape(about.stations)).max() == pytest.approx(1.0)
    both = np.array([np.abs(shape(s)).max(axis=1) > 1e-6 for shape in found.shapes])
    assert (both.sum(axis=1) == 1).all()  # in the plane or across it
    assert both.any(axis=0).all()
    planar = pp.modes(model.planar, 3.0, count=2)
    for one in planar.shapes:
        (same,) = [shape for shape in found.shapes if abs(shape.eigenvalue - one.eigenvalue) < 1e-6]
        assert np.abs(same(s)[0]) == pytest.approx(np.abs(one(s)), abs=1e-6)


def test_a_picture_of_modes_in_space_tells_along_which_axis_each_moves():
    chain = pp.Chain(pp.Pipe(0.2, terms=[pp.Spring(0.5, 20.0, 100.0)]), 6, dimensions=3)
    found = pp.modes(chain, 4.0, count=2)
    ax = plot.mode_shapes(found)
    labels = ax.get_legend_handles_labels()[1]
    assert [label.endswith(", across") for label in labels[:2]] == [False, True]
    s, drawn = ax.get_lines()[2].get_data()
    assert drawn == pytest.approx(found.shapes[1](s)[1].real, abs=1e-12)


def test_numbers_across_the_plane_are_converted_kept_and_checked(tmp_path):
    term = pp.Spring(0.5, 20.0, stiffness_across=8.0)
    hose = {"length": 0.5, "bending_stiffness": 0.1, "pipe_mass": 0.2, "fluid_mass": 0.1}
    pipe = pp.Pipe.from_si(**hose, terms=[pp.Spring(0.25, 16.0, 8.0), pp.Spring(0.25, 16.0)])
    assert pipe.terms[0].stiffness_across == pytest.approx(10.0)
    assert pipe.terms[1].stiffness_across is None
    assert pipe.terms_si[0].stiffness_across == pytest.approx(8.0)
    chain = pp.Chain(pp.Pipe(0.2, terms=[term, pp.Damper(0.7, 0.1)]), 4, dimensions=3)
    pp.critical_speed(chain).save(tmp_path / "found.npz")
    assert pp.load(tmp_path / "found.npz").model.pipe.terms == chain.pipe.terms
    assert repr(term) == "Spring(at=0.5, stiffness=20, stiffness_across=8)"
    for wrong in (-1.0, np.nan, 1e10):
        with pytest.raises(ValueError, match="stiffness_across must"):
            pp.Pipe(0.2, terms=[pp.Spring(0.5, 20.0, stiffness_across=wrong)])
    with pytest.raises(TypeError, match="stiffness_across must"):
        pp.Spring(0.5, 20.0, "a")


@pytest.mark.parametrize("kind", ["chain", "reduced"])
def test_a_ring_around_the_straight_pipe_is_not_felt_by_small_motions(kind):
    bare = pp.Pipe(0.2, terms=[pp.PointMass(0.5, 0.0)])  # which gives the same functions
    ringed = pp.Pipe(0.2, terms=[pp.Stop(0.5, 0.05, 100.0)])
    free, held = (
        pp.Chain(pipe, 5, dimensions=3)
        if kind == "chain"
        else pp.Galerkin(pipe, 5, "legendre", dimensions=3)
        for pipe in (bare, ringed)
    )
    straight = np.zeros(20)
    assert held.jacobian(0.0, straight, 5.0) == pytest.approx(
        free.jacobian(0.0, straight, 5.0), rel=1e-9, abs=1e-9
    )
    first, second = pp.hopf(held), pp.hopf(free)
    assert (first.own, first.other) == pytest.approx((second.own, second.other), rel=1e-4)
    assert pp.bifurcation_diagram(held, [4.0, 4.5]).equilibria[0].stable.all()


@pytest.mark.parametrize("gap", [0.02, 0.1])
def test_a_pipe_whirls_within_a_ring_and_on_beyond_the_contact_with_it(gap):
    chain = pp.Chain(pp.Pipe(0.2, damping=0.002, terms=[pp.Stop(0.6, gap, 300.0)]), 5, dimensions=3)
    (branch,) = pp.bifurcation_diagram(chain, [5.5, 6.0]).rotating
    found = pp.rotating_motion(chain, 6.0)
    assert [one.radius for one in branch.at(6.0)] == pytest.approx([found.radius], rel=1e-9)
    free = pp.rotating_motion(chain.with_pipe(pp.Pipe(0.2, damping=0.002)), 6.0)
    assert found.radius < 0.95 * free.radius  # the ring is met
    motion = pp.simulate(chain, 6.0, 1.0, found.q, found.qdot, rtol=1e-10)
    radii = np.hypot(motion.tip[:, 0], motion.tip[:, 2])
    assert radii == pytest.approx(found.radius, rel=1e-8)
    phase = np.unwrap(np.arctan2(motion.tip[:, 2], motion.tip[:, 0]))
    assert np.ptp(phase) == pytest.approx(found.frequency, rel=1e-8)


def test_circular_motions_that_turn_back_below_the_range_of_speeds_come_into_it_later():
    pipe = pp.Pipe(0.2, damping=0.002, terms=[pp.Stop(0.6, 0.02, 300.0)])
    chain = pp.Chain(pipe, 5, dimensions=3)
    (branch,) = pp.bifurcation_diagram(chain, [5.5, 6.0]).rotating
    assert [one.kind for one in branch.points] == ["fold", "fold"]
    assert branch.points[1].speed < branch.onset < branch.points[0].speed < 5.5
    assert branch.end == "range"
    assert len(branch.at(5.5)) == len(branch.at(6.0)) == 1
