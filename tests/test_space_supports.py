# SPDX-License-Identifier: MIT
"""Pipes in three dimensions that are held beyond their root: x = z = 0 at supports and ends."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import spatial

import pipedyn as pp

PIPES = {
    "pinned end": pp.Pipe(0.3, gamma=3.0, damping=0.05, drag=0.3, end="pinned"),
    "clamped end": pp.Pipe(0.3, gamma=3.0, damping=0.05, end="clamped"),
    "guided end": pp.Pipe(0.3, damping=0.05, end="guided"),
    "supports": pp.Pipe(0.3, damping=0.05, supports=[0.25, 0.5]),
    "hinged root": pp.Pipe(0.3, gamma=4.0, damping=0.05, root="pinned"),
    "held everywhere": pp.Pipe(
        *(0.3, -2.0, "aspirating", 0.5),
        **{"inflow_share": 0.3, "root": pp.RootSpring(4.0), "end": "clamped", "supports": [0.375]},
        damping=0.05,
    ),
}
MODELS = {
    "chain": partial(pp.Chain, n=8, dimensions=3),
    "legendre": partial(pp.Galerkin, m=8, basis="legendre", dimensions=3),
    "beam": partial(pp.Galerkin, m=6, basis="beam", dimensions=3),
}


def bends(s):
    return 0.7 * np.sin(5.0 * s) + 0.2 * s


def bends_across(s):
    return 0.6 * s * np.sin(4.0 * s)


def state_of(model, seed=0):
    """A state out of any plane that meets the supports."""
    rates = np.random.default_rng(seed).normal(size=(2, model.coordinates // 2))
    rates *= 1.0 if isinstance(model.planar, pp.Chain) else 1.0 / np.arange(1, rates.shape[1] + 1)
    q = model.bent(bends, bends_across)
    return model.initial_state(*model.onto_constraints(q, rates.ravel()))


@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_held_chains_balance_the_virtual_work_of_all_forces(pipe):
    chain = pp.Chain(pipe, 8, dimensions=3)
    a, rates = state_of(chain).reshape(2, 2, -1).transpose(0, 2, 1)
    base = np.random.default_rng(1).normal(size=(3, 3))
    for moved in (None, base):
        expected = spatial.accelerations(chain.planar, a, rates, 4.0, 1.3, moved)
        y = np.concatenate([a.T.ravel(), rates.T.ravel()])
        found = chain.rhs(0.0, y, 4.0, u_dot=1.3, base=moved)[chain.coordinates :].reshape(2, -1).T
        assert found == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_held_motion_in_any_plane_through_the_axis_is_the_planar_one(pipe, make):
    model = make(pipe)
    planar, c = model.planar, model.planar.coordinates
    q = planar.bent(bends)
    rates = np.cos(np.arange(c)) / np.arange(1.0, c + 1.0)
    y = planar.initial_state(*planar.onto_constraints(q, rates))
    y[c:] += 1e-3  # off the supports, to which both return alike
    none = np.zeros(c)
    embedded = model.turned(np.concatenate([y[:c], none, y[c:], none]), 0.8)
    found = model.turned(model.rhs(0.0, embedded, 3.0), -0.8)[2 * c :]
    expected = planar.rhs(0.0, y, 3.0)[c:]
    # The planar quadrature ends integrals of drag at the zeros of the velocity across the pipe.
    drags = pipe.drag and not isinstance(planar, pp.Chain)
    error = (1e-4 if drags else 1e-12) * np.abs(expected).max()
    assert found[:c] == pytest.approx(expected, abs=error)
    assert found[c:] == pytest.approx(none, abs=error)
    assert model.energy(embedded) == pytest.approx(planar.energy(y), rel=1e-13)
    columns = embedded[: 2 * c, None]
    assert model.curvatures(columns) == pytest.approx(planar.curvatures(y[:c, None]), rel=1e-12)
    assert model.tips(columns)[0, 1] == pytest.approx(planar.tips(y[:c, None])[0, 1], rel=1e-12)


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_held_rates_have_their_power_their_derivatives_and_their_batches(pipe, make):
    model, h = make(pipe), 1e-6
    y = state_of(model)
    rates = model.rhs(0.0, y, 3.0)
    change = (model.energy(y + h * rates) - model.energy(y - h * rates)) / (2.0 * h)
    power = model.power(y, 3.0)
    size = abs(power.flow) + abs(power.joints) + abs(power.drag)
    assert change == pytest.approx(power.total, abs=1e-6 * size + 1e-7)
    differences = np.stack(
        [
            (model.rhs(0.0, y + h * one, 3.0) - model.rhs(0.0, y - h * one, 3.0)) / (2.0 * h)
            for one in np.eye(y.size)
        ],
        axis=1,
    )
    found = model.jacobian(0.0, y, 3.0)
    assert found == pytest.approx(differences, abs=1e-7 * np.abs(found).max())
    states = np.stack([y, 0.5 * y, 0.1 * y], axis=1)
    alone = np.stack([model.rhs(0.0, one, 3.0) for one in states.T.copy()], axis=1)
    assert model.rhs(0.0, states, 3.0) == pytest.approx(alone, abs=1e-12 * np.abs(alone).max())


@pytest.mark.parametrize("method", ["radau", "dop853", "scipy:Radau"])
@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
def test_held_motions_keep_to_their_supports_and_balance_energy(make, method):
    model = make(PIPES["held everywhere"])
    motion = pp.simulate(model, 2.0, 0.5, model.bent(bends, bends_across), method=method, rtol=1e-7)
    places = [0.375, 1.0]
    at = np.stack([model.shape(q, places) for q in motion.q[::50]])
    assert at[:, :, [0, 2]] == pytest.approx(0.0, abs=1e-9)
    assert motion.audit < 1e-4
    assert np.abs(motion.tip[:, 2]).max() > 0.01


@pytest.mark.parametrize(
    ("pipe", "starts"),
    [
        (PIPES["pinned end"], "spans"),
        (PIPES["clamped end"], "spans"),
        (PIPES["guided end"], "spans"),
        (PIPES["hinged root"], "hanging"),
    ],
    ids=["pinned end", "clamped end", "guided end", "hinged root"],
)
def test_held_chains_tend_to_the_reduced_model_in_space(pipe, starts):
    bend = {
        "spans": (
            lambda s: 0.9 * np.sin(2.0 * np.pi * s) ** 2 * np.cos(np.pi * s),
            lambda s: 0.7 * np.sin(np.pi * s) ** 2 * np.cos(np.pi * s),
        ),
        "hanging": (
            lambda s: 0.8 + 0.6 * s - 0.3 * s**2,
            lambda s: -0.5 + 0.2667 * s**3 - 0.4 * s**2,
        ),
    }[starts]

    def shape(make):
        model = make(pipe, dimensions=3)
        motion = pp.simulate(model, 2.0, 0.2, model.bent(*bend), samples=2, rtol=1e-9)
        return model.shape(motion.q[-1], [0.3, 0.7, 1.0])

    expected = shape(partial(pp.Galerkin, m=16, basis="legendre"))
    few, many = (shape(partial(pp.Chain, n=n)) - expected for n in (10, 20))
    assert np.abs(many).max() < 1e-3
    assert np.linalg.norm(few) / np.linalg.norm(many) == pytest.approx(4.0, abs=1.0)


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
@pytest.mark.parametrize("name", ["pinned end", "clamped end", "guided end", "supports"])
def test_linear_questions_about_held_pipes_have_the_planar_answers_twice(make, name):
    model = make(PIPES[name])
    assert pp.critical_speed(model).speed == pp.critical_speed(model.planar).speed
    assert pp.eigenvalues(model, 2.0, 4) == pytest.approx(pp.eigenvalues(model.planar, 2.0, 4))
    c, by = model.coordinates, np.kron(np.eye(2), model.by_coordinates())
    mass, damping, stiffness = model.operators().at(2.0)
    moved = model.jacobian(0.0, np.zeros(2 * c), 2.0) @ by
    slopes = np.linalg.lstsq(by, moved, rcond=None)[0][model.dof :]
    size = np.abs(stiffness).max()
    assert mass @ slopes == pytest.approx(np.hstack([-stiffness, -damping]), abs=1e-9 * size)


@pytest.mark.parametrize("make", [MODELS["chain"], MODELS["legendre"]], ids=["chain", "legendre"])
@pytest.mark.parametrize("holds", [{"supports": [0.25]}, {"end": "pinned"}, {"end": "clamped"}])
def test_operators_about_a_held_rest_that_sags_are_the_derivatives_of_the_motion(make, holds):
    model = make(pp.Pipe(0.3, gamma=8.0, inclination=1.4, damping=0.02, **holds))
    [rest] = pp.equilibria(model.planar, 1.5).q[:1]
    about = model.about(np.append(rest, 0.0 * rest))
    state = np.append(model.initial_state(np.append(rest, 0.0 * rest), None), [])
    free = model.free_states(state)
    exact = np.linalg.eigvals(free.T @ model.jacobian(0.0, state, 1.5) @ free)
    every = pp.eigenvalues(about, 1.5)
    assert every.size == exact.size == 2 * model.dof
    slow = every[np.abs(every) < 100.0]
    assert slow.size > 6
    for one in slow:
        assert np.abs(exact - one).min() < 1e-6 * abs(one)


@pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")
def test_small_oscillations_about_a_held_rest_start_to_grow_at_its_critical_speed():
    model = MODELS["legendre"](pp.Pipe(0.2, gamma=5.0, inclination=np.pi / 2, supports=[0.25]))
    found = pp.critical_speed(model)  # across the plane of sag, before that in the plane
    assert found.speed < pp.crossings(model.planar, 9.0)[0].speed - 1e-3
    growth = []
    for u in (found.speed - 0.02, found.speed + 0.02):
        rest = pp.equilibria(model.planar, u).q[0]
        state = model.initial_state(np.append(rest, 0.0 * rest), None)
        free = model.free_states(state)
        slopes = free.T @ model.jacobian(0.0, state, u) @ free
        growth.append(np.linalg.eigvals(slopes).real.max())
    assert growth[0] < 0.0 < growth[1]


@pytest.mark.parametrize(
    "make", [partial(pp.Chain, n=6), partial(pp.Galerkin, m=6, basis="legendre")]
)
def test_flutter_of_a_pipe_that_is_held_at_a_support_is_followed_in_space(make):
    model = make(pp.Pipe(0.2, damping=0.005, supports=[0.25]), dimensions=3)
    onset = pp.hopf(model)
    assert onset.own + onset.other == pytest.approx(16.0 * onset.plane.cubic, rel=1e-6)
    u = onset.speed + 1e-3
    circular = pp.rotating_motion(model, u)
    assert circular.radius**2 == pytest.approx(1e-3 * onset.rotating_law, rel=0.02)
    assert circular.exponents.size == 2 * model.dof - 1  # none of the return to the support
    assert circular.stable == (onset.stable == "rotating")
    cycle = pp.limit_cycle(model, u)
    across = np.log(np.abs(cycle.across)) / cycle.period
    assert np.abs(across - 1e-3 * onset.planar_exponent).min() < 0.03e-3 * abs(
        onset.planar_exponent
    )
    turned = model.turned(np.concatenate([cycle.q[0], cycle.qdot[0]]), 0.4)
    motion = pp.simulate(model, u, cycle.period, *np.split(turned, 2), samples=2, rtol=1e-9)
    last = np.concatenate([motion.q[-1], motion.qdot[-1]])
    assert last == pytest.approx(turned, abs=1e-5 * np.abs(turned).max())


def test_members_and_exponents_of_held_pipes_are_those_of_single_motions():
    model = MODELS["chain"](PIPES["supports"])
    start = model.bent(bends, bends_across)
    many = pp.simulate_many(model, [1.0, 2.0, 3.0], 0.5, start, method="dop853", rtol=1e-9)
    for u, motion in zip((1.0, 2.0, 3.0), many.motions, strict=True):
        one = pp.simulate(model, u, 0.5, start, times=motion.t, method="radau", rtol=1e-9)
        assert motion.tip == pytest.approx(one.tip, abs=1e-7)
    found = pp.lyapunov_exponent(model, 2.0, duration=20.0, transient=10.0)
    assert abs(found.value - pp.eigenvalues(model, 2.0, 1)[0].real) < 3.0 * found.spread


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
def test_states_off_the_supports_are_refused_or_brought_there(make):
    model = make(PIPES["supports"])
    bent = model.bent(bends, bends_across)
    with pytest.raises(ValueError, match="q0 and qdot0 must meet the supports, got a deviation of"):
        pp.simulate(model, 1.0, 0.1, bent + 1e-3)
    with pytest.raises(ValueError, match=r"q0 must have .* entries"):
        pp.simulate(model, 1.0, 0.1, bent[:-1])
    small = 0.01 * np.ones(model.dof)
    q = model.initial_state(small, None)[: model.coordinates]
    assert model.shape(q, [0.25, 0.5])[:, [0, 2]] == pytest.approx(0.0, abs=1e-12)


def test_a_shape_that_no_small_turn_brings_to_a_support_is_refused():
    chain = MODELS["chain"](PIPES["supports"])
    with pytest.raises(pp.NotConverged, match="no configuration close to angle meets the supports"):
        chain.bent(lambda s: 0.0 * s + 0.5 * np.pi)  # level: turning does not move it across


def test_held_models_in_space_are_kept_by_files_and_pickles(tmp_path):
    for make in MODELS.values():
        model = make(PIPES["held everywhere"])
        y = state_of(model)
        motion = pp.simulate(model, 2.0, 0.05, *np.split(y, 2), samples=2)
        motion.save(tmp_path / "motion.npz")
        back = pp.load(tmp_path / "motion.npz").model
        for other in (back, pickle.loads(pickle.dumps(model)), model.with_pipe(model.pipe)):
            assert other.rhs(0.0, y, 2.0).tolist() == model.rhs(0.0, y, 2.0).tolist()


UNEVEN_ROOTS = [pp.RootSpring(4.0, 9.0), pp.RootSpring(6.0, 0.0), pp.RootSpring(0.0, 3.0)]
UNEVENLY_HELD = {
    "chain": partial(pp.Chain, n=5),
    "legendre": partial(pp.Galerkin, m=5, basis="legendre"),
}


def of_root(make, root, dimensions=3, **numbers):
    numbers = {"gamma": 5.0, "damping": 0.02, **numbers}
    return make(pp.Pipe(0.3, root=root, **numbers), dimensions=dimensions)


@pytest.mark.parametrize("root", UNEVEN_ROOTS, ids=repr)
def test_chains_on_an_uneven_root_balance_the_virtual_work_of_all_forces(root):
    chain = of_root(UNEVENLY_HELD["chain"], root)
    a, rates = state_of(chain).reshape(2, 2, -1).transpose(0, 2, 1)
    expected = spatial.accelerations(chain.planar, a, rates, 4.0, 1.3)
    y = np.concatenate([a.T.ravel(), rates.T.ravel()])
    found = chain.rhs(0.0, y, 4.0, u_dot=1.3)[chain.coordinates :].reshape(2, -1).T
    assert found == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("make", UNEVENLY_HELD.values(), ids=UNEVENLY_HELD)
@pytest.mark.parametrize("root", UNEVEN_ROOTS, ids=repr)
def test_a_root_spring_acts_in_both_planes_by_its_own_numbers(make, root):
    model = of_root(make, root)
    bend = (lambda s: 0.2 + 0.4 * s - 0.3 * s**2), (lambda s: 1.0 - 2.0 * s**3)
    for k, stiffness in enumerate((root.stiffness, root.stiffness_across)):
        planar = of_root(make, pp.RootSpring(stiffness), 2)
        ways = [(one, lambda s: 0.0 * s)[:: 1 - 2 * k] for one in bend]
        y = np.concatenate([model.sampled(*way) for way in ways])
        own = np.concatenate([planar.sampled(one) for one in bend])
        assert model.energy(y) == pytest.approx(planar.energy(own), rel=1e-12)
        assert model.power(y, 4.0).total == pytest.approx(planar.power(own, 4.0).total, rel=1e-11)
        h = 1e-7  # accelerations move the places of both pipes alike
        moved = [
            one.shape(q + h * one.rhs(0.0, state, 4.0)[q.size :], [0.4, 1.0])
            for one, state, q in ((model, y, y[: y.size // 2]), (planar, own, own[: own.size // 2]))
        ]
        assert moved[0][:, [2 * k, 1]] == pytest.approx(moved[1], abs=1e-12)
        assert moved[0][:, 2 - 2 * k] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("make", UNEVENLY_HELD.values(), ids=UNEVENLY_HELD)
@pytest.mark.parametrize("root", UNEVEN_ROOTS, ids=repr)
def test_an_uneven_root_keeps_the_balance_of_energy_and_has_a_jacobian(make, root):
    model, h, u = of_root(make, root, drag=0.3), 1e-6, 4.0
    y = state_of(model)
    rates = model.rhs(0.0, y, u)
    step, weights = 0.1 / np.abs(rates).max(), np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
    ends = [
        [model.energy(y + sign * k * step * rates) for sign in (1.0, -1.0)] for k in range(1, 5)
    ]
    change = weights @ [ahead - behind for ahead, behind in ends] / step
    assert change == pytest.approx(model.power(y, u).total, rel=1e-9)
    steps = h * np.eye(y.size)
    columns = [model.rhs(0.0, y + d, u) - model.rhs(0.0, y - d, u) for d in steps]
    found = model.jacobian(0.0, y, u)
    assert found == pytest.approx(np.transpose(columns) / (2 * h), abs=1e-7 * np.abs(found).max())


@pytest.mark.parametrize("make", UNEVENLY_HELD.values(), ids=UNEVENLY_HELD)
def test_small_motions_on_an_uneven_root_are_those_of_the_motion(make):
    root = pp.RootSpring(9.0, 4.0)
    model, u = of_root(make, root), 3.0
    found = pp.eigenvalues(model, u)
    for one in np.linalg.eigvals(model.jacobian(0.0, np.zeros(2 * model.dof), u)):
        assert np.abs(found - one).min() < 1e-8 * (1.0 + abs(one))
    critical = pp.critical_speed(model)
    planes = [
        pp.critical_speed(of_root(make, pp.RootSpring(k), 2)).speed
        for k in (root.stiffness, root.stiffness_across)
    ]
    assert planes[1] < planes[0]
    assert (critical.speed, critical.across) == (pytest.approx(planes[1], rel=1e-10), True)
    shape = critical.mode_shape([0.2, 1.0])
    alone = pp.critical_speed(of_root(make, pp.RootSpring(4.0), 2)).mode_shape([0.2, 1.0])
    assert np.abs(shape[0]).max() == 0.0
    assert np.abs(shape[1]) == pytest.approx(np.abs(alone), abs=1e-7)
    # Over the number across, the boundary is that of the planar pipe over its own.
    ranges = {"root.stiffness_across": (3.0, 6.0), "u": (4.0, planes[0] - 0.01)}
    (curve,) = pp.boundary(model, *ranges, ranges, criticality=False).curves
    k = len(curve) // 2
    there = pp.critical_speed(of_root(make, pp.RootSpring(float(curve.x[k])), 2))
    assert there.speed == pytest.approx(curve.y[k], rel=1e-9)


def test_an_uneven_root_sags_in_its_plane_and_is_asked_across_it():
    pipe = pp.Pipe(0.3, 10.0, inclination=np.pi / 2, damping=0.02, root=pp.RootSpring(9.0, 4.0))
    model = pp.Chain(pipe, 5, dimensions=3)
    critical = pp.critical_speed(model)
    even = pp.Chain(replace(pipe, root=pp.RootSpring(9.0)), 5, dimensions=3)
    assert critical.across
    assert critical.speed < pp.critical_speed(even).speed - 0.05
    rest = pp.equilibria(model.planar, critical.speed).q[0]
    whole = model.jacobian(0.0, np.concatenate([rest, np.zeros(15)]), critical.speed)
    values = np.linalg.eigvals(whole)
    assert np.abs(values - 1j * critical.frequency).min() < 1e-6


def test_a_root_that_turns_freely_in_the_plane_has_the_equilibria_of_a_hinge():
    pipe = pp.Pipe(0.3, root="pinned", damping=0.002)
    hinge, uneven = (
        pp.equilibria(pp.Galerkin(replace(pipe, root=root), 6, "legendre"), 3.0)
        for root in ("pinned", pp.RootSpring(0.0, 5.0))
    )
    assert len(hinge) == 1
    np.testing.assert_array_equal(hinge.tips, uneven.tips)


def test_the_number_across_of_a_root_is_converted_kept_and_checked(tmp_path):
    spring = pp.RootSpring(0.2, stiffness_across=0.05)
    masses = {"pipe_mass": 0.19, "fluid_mass": 0.05}
    pipe = pp.Pipe.from_si(length=0.5, bending_stiffness=5e-3, **masses, root=spring)
    assert pipe.root.stiffness == pytest.approx(20.0)
    assert pipe.root.stiffness_across == pytest.approx(5.0)
    model = pp.Chain(pipe, 4, dimensions=3)
    model.save(tmp_path / "model.npz")
    for copy in (pp.load(tmp_path / "model.npz"), pickle.loads(pickle.dumps(model))):
        assert copy.pipe == pipe
    assert repr(spring) == "RootSpring(stiffness=0.2, stiffness_across=0.05)"
    assert pp.Pipe(0.2, root=pp.RootSpring(0.0, 0.0)).root == "pinned"
    with pytest.raises(ValueError, match="stiffness_across must"):
        pp.RootSpring(1.0, -1.0)
    with pytest.raises(ValueError, match=r"root.stiffness_across must"):
        pp.Pipe(0.2, root=pp.RootSpring(1.0, 1e12))
    with pytest.raises(TypeError, match="stiffness_across must"):
        pp.RootSpring(1.0, "soft")
    with pytest.raises(ValueError, match="basis must be 'legendre' for a root whose spring differ"):
        pp.Galerkin(pp.Pipe(0.2, root=pp.RootSpring(1.0, 2.0)), 4, "beam", dimensions=3)
    swinging = pp.Chain(pp.Pipe(0.2, root=pp.RootSpring(1.0, 2.0)), 3, dimensions=3)
    assert not swinging.axisymmetric
