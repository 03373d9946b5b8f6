# SPDX-License-Identifier: MIT
"""Flow whose speed changes and a base that moves, in every model.

Two routes check the forces that share nothing with the models: Hamilton's principle for open
systems (McIver 1973) with velocities on the ground, and virtual work at the places that `shape`
draws, both by differences.
"""

import dataclasses

import numpy as np
import pytest
import redundant
from independent import derivative_along, panels
from test_terms import MODELS, jacobian_by_differences, sizes_of, state_of, turning_of

import pipedyn as pp

TERMS = (
    pp.PointMass(0.37, 0.4),
    pp.Damper(0.62, 1.5),
    pp.CubicSpring(0.8, 60.0),
    pp.Foundation(9.0),
    pp.Viscosity(1.3),
    pp.AddedMass(0.6),
)
PIPE = pp.Pipe(0.3, 7.0, damping=0.02)
LOADED = dataclasses.replace(
    PIPE, flow="aspirating", alpha=0.8, inflow_share=0.4, drag=0.7, terms=TERMS
)
SPEED, RATE = 1.7, 2.3
BASE = np.array([[0.3, -0.2], [0.7, 0.5], [-1.1, 1.9]])

models = pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)


def gauss_points(model, count=30):
    """Arc lengths and weights between all kinks of the shape and its angle."""
    if isinstance(model, pp.Chain):
        return panels(model.base + np.cumsum([0.0, *model.lengths]), count)
    inner = [term.place for term in model.pipe.terms if term.place]
    return panels([*inner, *model.pipe.supports], count)


def tangents(model, q, s):
    return derivative_along(lambda at: model.shape(q, at), s, np.ones_like(s), step=1e-5)


@models
def test_motion_obeys_hamiltons_principle_for_open_systems_on_the_ground(make):
    """d/dt dL/dq' - dL/dq = -b U (r' + U t) . dr/dq at the end, with velocities on the ground.

    L = int |r'|^2 / 2 + chi (n . r')^2 / 2 + b U t . r' + gamma y, less the bending energy: McIver
    (1973), in a fluid with the added mass chi.
    """
    chi = 0.6
    model = make(dataclasses.replace(PIPE, damping=0.0, terms=(pp.AddedMass(chi),)))
    q, rate = state_of(model)
    s, w = gauss_points(model)
    b, gamma = np.sqrt(PIPE.beta), PIPE.gamma
    y = np.concatenate([q, rate])
    acceleration = model.rhs(0.0, y, SPEED, u_dot=RATE, base=BASE)[model.dof :]
    sizes = sizes_of(model)

    place, moving, accelerating = BASE

    def momentum(at, rates, base, speed):  # linear in all but the first
        by_q = jacobian_by_differences(lambda x: model.shape(x, s), at, sizes)
        t, velocity = tangents(model, at, s), by_q @ rates + base
        n = np.stack([t[:, 1], -t[:, 0]], axis=1)
        across = chi * np.sum(n * velocity, axis=1)[:, None] * n
        return np.einsum("p,pc,pci->i", w, velocity + across + b * speed * t, by_q)

    def lagrangian(at):
        velocity = derivative_along(lambda x: model.shape(x, s), at, rate) + moving
        t = tangents(model, at, s)
        across = velocity[:, 0] * t[:, 1] - velocity[:, 1] * t[:, 0]
        kinetic = (np.sum(velocity**2, axis=1) + chi * across**2) / 2
        flow = b * SPEED * np.sum(velocity * t, axis=1)
        height = place[1] + model.shape(at, s)[:, 1]
        still = np.concatenate([at, np.zeros_like(at)])
        weight = make(dataclasses.replace(PIPE, gamma=0.0)).energy(still)
        return w @ (kinetic + flow + gamma * height) - weight

    left = derivative_along(lambda at: momentum(at, rate, moving, SPEED), q, rate)
    left = left + momentum(q, acceleration, accelerating, RATE)
    left = left - jacobian_by_differences(lambda x: np.array([lagrangian(x)]), q, sizes)[0]
    end = np.array([1.0])
    by_q = jacobian_by_differences(lambda x: model.shape(x, end), q, sizes)[0]
    velocity = by_q @ rate + moving
    t_end = derivative_along(
        lambda at: model.shape(q, at), np.array([0.999]), np.ones(1), step=1e-4
    )[0]
    if isinstance(model, pp.Galerkin):
        angle = (model.functions(end, 1) @ q)[0]
        t_end = np.array([np.sin(angle), np.cos(angle)])
    right = -(b * SPEED * velocity + SPEED**2 * t_end) @ by_q
    scale = np.abs(left).max() + np.abs(right).max()
    assert np.abs(left - right).max() < 1e-8 * scale


@models
def test_a_drive_does_the_virtual_work_of_its_forces(make):
    """Inflow, drag and terms see motion on the ground; chains have drag at points."""
    drag = 0.7 if make(PIPE).linear_cost else 0.0
    model = make(dataclasses.replace(LOADED, drag=drag, terms=TERMS[:-1]))
    q, rate = state_of(model)
    y = np.concatenate([q, rate])
    driven, still = (
        model.rhs(0.0, y, SPEED, **more) for more in ({"u_dot": RATE, "base": BASE}, {})
    )
    work = model.operators(q).mass @ (driven - still)[model.dof :]
    bare = make(dataclasses.replace(PIPE, terms=[pp.PointMass(t.at, 0.0) for t in TERMS[:3]]))

    def at(s):
        by_q = jacobian_by_differences(lambda x: bare.shape(x, s), q, sizes_of(model))
        place, velocity = bare.shape(q, s), by_q @ rate
        return by_q, (place, velocity), (place + BASE[0], velocity + BASE[1])

    def force(place, w, law):
        by_q, relative, absolute = place
        return np.einsum("p,pc,pci->i", w, law(*absolute) - law(*relative), by_q)

    s, w = gauss_points(bare)
    t = tangents(bare, q, s)
    n = np.stack([t[:, 1], -t[:, 0]], axis=1)
    along = at(s)
    push = LOADED.direction * np.sqrt(LOADED.beta) * RATE * t
    expected = -np.einsum("p,pc,pci->i", w, push + BASE[2], along[0])
    mass = TERMS[0].mass * np.ones(1)
    one = np.ones(1)
    expected -= np.einsum("p,c,pci->i", mass, BASE[2], at(np.array([0.37]))[0])
    only_x = np.array([1.0, 0.0])
    expected += force(at(np.array([0.62])), one, lambda r, v: -1.5 * v * only_x)
    expected += force(at(np.array([0.8])), one, lambda r, v: -60.0 * r**3 * only_x)
    expected += force(along, w, lambda r, v: -9.0 * r * only_x)
    expected += force(along, w, lambda r, v: -1.3 * np.sum(v * n, axis=1)[:, None] * n)
    if drag:
        points = model.base + np.cumsum(model.lengths) - 0.5 * model.lengths
        t = tangents(bare, q, points)
        across = np.stack([t[:, 1], -t[:, 0]], axis=1)

        def law(r, v):
            normal = np.sum(v * across, axis=1)[:, None]
            return -drag * np.abs(normal) * normal * across

        expected += force(at(points), model.lengths, law)
    entering = 0.6 * LOADED.direction * np.sqrt(LOADED.beta) * SPEED
    expected += force(at(one), one, lambda r, v: entering * v)
    assert np.abs(work - expected).max() < 1e-9 * np.abs(expected).max()


@models
def test_unsteady_operator_is_the_jacobian_at_rest(make):
    model = make(dataclasses.replace(PIPE, flow="aspirating"))
    n = model.dof
    for q in (np.zeros(n), state_of(model)[0]):

        def force(at):
            still = np.concatenate([at, np.zeros(n)])
            return model.operators(at).mass @ model.rhs(0.0, still, SPEED, u_dot=RATE)[n:]

        _, _, stiffness = model.operators(q).at(SPEED, RATE)
        differences = jacobian_by_differences(force, q, sizes_of(model))
        assert np.abs(stiffness + differences).max() < 1e-9 * np.abs(stiffness).max()
    scaled = model.elastic_operators().unsteady
    to_q = model.from_elastic(np.eye(n))
    expected = to_q.T @ model.operators().unsteady @ to_q
    assert np.abs(scaled - expected).max() < 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("held", [{}, {"root": "pinned", "end": "pinned", "supports": (0.4,)}])
@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_unsteady_operator_has_its_closed_form(basis, held):
    model = pp.Galerkin(pp.Pipe(0.5, 7.0, **held), 6, basis)
    assert np.abs(model.functions(np.array([0.4, 1.0]))).max() < 1e-12 or not held
    s, w = gauss_points(model, 60)
    values, curvatures = model.functions(s), model.functions(s, 2)
    closed = np.sqrt(0.5) * values.T @ ((w * (1.0 - s))[:, None] * curvatures)
    assert np.abs(model.operators().unsteady - closed).max() < 1e-9 * np.abs(closed).max()


# ------------------------------------------------------------------------------------------ scenes


DRIVE = {"u_dot": RATE, "base": BASE}


def test_a_scene_that_is_driven_moves_as_the_chain_does():
    chain, scene = pp.Chain(LOADED, 4), pp.modular.chain(LOADED, 4)
    q, rate = state_of(chain)
    y, state = np.concatenate([q, rate]), scene.state(q, rate)
    expected, found = chain.rhs(0.0, y, SPEED, **DRIVE), turning_of(scene, state, SPEED, **DRIVE)
    assert np.abs(found - expected[4:]).max() < 1e-11 * np.abs(expected).max()
    powers = [of.power(at, SPEED, **DRIVE).total for of, at in ((chain, y), (scene, state))]
    assert powers[0] == pytest.approx(powers[1], rel=1e-11)
    assert scene.energy(state, base=BASE) == pytest.approx(chain.energy(y, base=BASE), rel=1e-12)
    assert scene.power(state, SPEED, **DRIVE).base == pytest.approx(
        chain.power(y, SPEED, **DRIVE).base, rel=1e-11
    )
    unsteady = scene.operators().unsteady
    assert np.abs(unsteady - chain.operators().unsteady).max() < 1e-14


HOLDS = {
    "free": (),
    "guide": (pp.modular.Guide(3),),
    "guides": (pp.modular.Guide(1), pp.modular.Guide(4)),
    "pin": (pp.modular.Pin(2, x=0.1, y=0.44),),
}


@pytest.mark.parametrize("holds", HOLDS.values(), ids=HOLDS)
def test_a_held_scene_that_is_driven_moves_as_its_redundant_form_says(holds):
    """Guides and pins stand on the base. The other route is dense, in redundant coordinates."""
    scene = pp.modular.chain(LOADED, 4).plus(*holds)
    theta = scene.admissible([0.3, -0.1, 0.5, 0.2])
    start = np.concatenate([theta, [0.7, -0.4, 0.2, 0.9]])
    for_rates, _ = scene.onto_constraints(*np.split(start[:, None], 2))
    omega = scene.onto_constraints(for_rates, start[4:, None])[1]
    state = scene.state(for_rates[:, 0], omega[:, 0])
    y, drive = np.append(for_rates, omega), np.concatenate([[RATE], BASE.ravel(), np.zeros(3)])
    expected = redundant.accelerations(scene, state, SPEED, drive[:7])
    found = scene.rhs(0.0, state, SPEED, **DRIVE)[12:]
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()
    exact = scene.motion_jacobian(y, SPEED, drive)
    differences = jacobian_by_differences(
        lambda at: scene.motion_rates(at, SPEED, drive), y, np.ones(8), step=2e-3
    )
    assert np.abs(exact - differences).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize("holds", list(HOLDS.values())[:3], ids=list(HOLDS)[:3])
def test_unsteady_operator_of_a_held_scene_is_the_jacobian_at_rest(holds):
    scene = pp.modular.chain(dataclasses.replace(PIPE, flow="aspirating"), 4).plus(*holds)
    operators, still = scene.operators(), np.zeros(8)
    basis = scene.free_directions(np.zeros(4))
    steady, pushed = (
        scene.motion_jacobian(still, SPEED, np.append(rate, np.zeros(9)))[4:, :4]
        for rate in (0.0, RATE)
    )
    force = operators.mass @ basis.T @ (pushed - steady) @ basis
    difference = force + operators.at(SPEED, RATE)[2] - operators.at(SPEED)[2]
    assert np.abs(difference).max() < 1e-11 * np.abs(force).max()


def test_custom_modules_refuse_a_base_that_moves():
    scene = pp.modular.chain(PIPE, 3).plus(
        pp.modular.Custom(nodes=(2,), energy=lambda q: 3.0 * q[0] ** 2)
    )
    state = scene.state(np.full(3, 0.1))
    rates = scene.rhs(0.0, state, SPEED, u_dot=RATE)
    assert np.isfinite(rates).all()
    with pytest.raises(ValueError, match="base must be at rest in a scene with custom modules"):
        scene.rhs(0.0, state, SPEED, base=BASE)
    with pytest.raises(ValueError, match="base must be at rest in a scene with custom modules"):
        pp.simulate(scene, 1.0, 1.0, np.full(3, 0.1), base=pp.Harmonic(0.1, 3.0))
