# SPDX-License-Identifier: MIT
"""Constant head: the flow speed as a state, its equation, its Jacobian, and what flutter does."""

import dataclasses
import math

import numpy as np
import pytest
from independent import derivative_along, panels
from test_terms import jacobian_by_differences

import pipedyn as pp
from pipedyn.motion.constant_head import ConstantHead

PIPE = pp.Pipe(0.3, 2.0)
LOADED = dataclasses.replace(
    PIPE,
    alpha=0.9,
    drag=0.4,
    damping=0.01,
    terms=(pp.Spring(0.6, 9.0), pp.Damper(1.0, 0.2), pp.AddedMass(0.3), pp.PointMass(0.7, 0.2)),
)
ASPIRATING = pp.Pipe(0.4, -3.0, "aspirating", inflow_share=0.5)
HELD = pp.Pipe(0.3, 2.0, root="pinned", end="pinned")
SUPPLY = pp.Supply(40.0, 2.5, start=2.0)


def drawn(model, size=0.3, u=2.0):
    """A state [p, p', 0, u] that no symmetry simplifies."""
    k = np.arange(1.0, 2 * model.integrated + 1.0)
    y = size * np.sin(1.7 * k) / np.tile(k[: model.integrated], 2)
    p, rates = model.onto_constraints(*np.split(y, 2))
    return np.concatenate([p, rates, [0.0, u]])


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(PIPE, 5),
        pp.Chain(ASPIRATING, 5),
        pp.Galerkin(LOADED, 4, "legendre"),
        pp.Galerkin(ASPIRATING, 4),
        pp.modular.chain(LOADED, 5),
    ],
    ids=repr,
)
def test_energy_of_pipe_and_fluid_together_is_balanced(model):
    """The fluid's kinetic energy is |sqrt(beta) r' + s u t|^2 / 2 per length.

    It enters with that of its speed and leaves with the free end's besides; head and weight work
    on what flows through, friction takes its share. The pipe is the model's shape, by differences.
    """
    pipe, u = model.pipe, 2.0
    b, sign = math.sqrt(pipe.beta), pipe.direction
    s, weights = panels(np.linspace(0.0, 1.0, 6), 20)
    y = drawn(model, 0.2, u)
    n, rates = model.integrated, ConstantHead(model, SUPPLY).rates(y)

    def energy(state):
        p, pdot = state[:n], state[n : 2 * n]

        def shape(at, places):
            return model.shape(model.to_user(at[None], pdot[None])[0][0], places)

        t = derivative_along(lambda at: shape(p, at), s, np.ones_like(s), step=1e-5)
        v = derivative_along(lambda at: shape(at, s), p, pdot, step=1e-5)
        q, qdot = model.to_user(p[None], pdot[None])
        own = model.energy(np.concatenate([q[0], qdot[0]]))
        flowing = b * sign * state[-1] * (weights @ np.sum(t * v, axis=1))
        return own + flowing + 0.5 * state[-1] ** 2

    gained = derivative_along(energy, y, rates, step=5e-5)
    q, qdot = model.to_user(y[None, :n], y[None, n : 2 * n])
    power = model.power(np.concatenate([q[0], qdot[0]]), u)
    velocity = model.tip_velocities(q.T, qdot.T)[0]
    depth = model.tips(q.T)[0, 1]
    driving = SUPPLY.head + sign * pipe.beta * pipe.gamma * depth - 0.5 * SUPPLY.friction * u**2
    # At a steady speed the flow takes c b u |v|^2 + alpha u^2 t . v from the pipe; what leaves has
    # |b v + u t|^2 / 2 for the u^2 / 2 with which it entered.
    carried = 0.5 * sign * b * u * (velocity @ velocity)
    assert gained == pytest.approx(power.total + u / b * driving + carried, rel=1e-6)


def models():
    return [
        pp.Chain(PIPE, 4),
        pp.Chain(LOADED, 4),
        pp.Chain(ASPIRATING, 4),
        pp.Chain(HELD, 5),
        pp.Galerkin(LOADED, 4, "legendre"),
        pp.Galerkin(ASPIRATING, 4),
        pp.Galerkin(HELD, 4, "legendre"),
        pp.modular.chain(LOADED, 4),
    ]


@pytest.mark.parametrize("model", models(), ids=repr)
def test_the_jacobian_is_the_derivative_of_the_rates(model):
    head, y = ConstantHead(model, SUPPLY), drawn(model, 0.2)
    work, drive = (
        2 * model.integrated,
        np.array([0.0, 0.1, 0.2, 0.3, -0.4, 0.7, -0.3, 0.0, 0.0, 0.0]),
    )
    found = head.jacobian(np.delete(y, work), drive)

    def rates(state):
        return np.delete(head.rates(np.insert(state, work, 0.0), drive), work)

    state = np.delete(y, work)
    by_differences = jacobian_by_differences(rates, state, 1.0, step=2e-4)
    assert np.abs(found - by_differences).max() < 1e-8 * np.abs(found).max()


@pytest.mark.parametrize("model", models()[:6], ids=repr)
def test_small_motions_of_a_straight_pipe_and_of_its_flow_do_not_act_on_each_other(model):
    """So the onset is that at constant speed. The flow's own eigenvalue is -f u / sqrt(beta)."""
    pipe, u = model.pipe, 3.0
    supply = pp.Supply.at_speed(pipe, u, friction=2.0)
    rest = np.append(np.zeros(2 * model.integrated), u)
    found = ConstantHead(model, supply).jacobian(rest)
    pipe_alone = model.motion_jacobian(rest[:-1], u)
    assert np.abs(found[:-1, :-1] - pipe_alone).max() <= 1e-12 * np.abs(pipe_alone).max()
    assert np.abs(found[:-1, -1]).max() == np.abs(found[-1, :-1]).max() == 0.0
    assert found[-1, -1] == pytest.approx(-2.0 * u / math.sqrt(pipe.beta), rel=1e-12)


@pytest.fixture(scope="module")
def sharp():
    """Motions at a sharper tolerance, by model."""
    return {}


@pytest.mark.parametrize("method", ["radau", "dop853", "scipy:DOP853", "scipy:Radau"])
@pytest.mark.parametrize(
    "model", [pp.Chain(LOADED, 5), pp.Galerkin(PIPE, 4), pp.modular.chain(PIPE, 4)], ids=repr
)
def test_every_method_gives_the_motion_and_closes_the_audit(model, method, sharp):
    supply = pp.Supply.at_speed(model.pipe, 4.0, friction=1.5, start=2.0)
    options = {"rtol": 1e-9, "times": [0.1, 0.2], "q0": lambda s: 0.8 * s}
    motion = pp.simulate(model, supply, 0.2, method=method, **options)
    if repr(model) not in sharp:
        sharper = options | {"rtol": 1e-11, "method": "dop853"}
        sharp[repr(model)] = pp.simulate(model, supply, 0.2, **sharper)
    other = sharp[repr(model)]
    assert np.abs(motion.q - other.q).max() < 2e-6
    assert motion.flow_speed == pytest.approx(other.flow_speed, abs=2e-7)
    assert motion.audit < 2e-7
    assert motion.u is supply


def test_strong_friction_is_constant_speed():
    model, start = pp.Chain(PIPE, 6), lambda s: 0.5 * s
    steady = pp.simulate(model, 6.0, 3.0, start, rtol=1e-9)
    assert steady.flow_speed == pytest.approx(np.full(steady.t.size, 6.0), abs=0.0)
    misses = []
    for friction in (1e3, 1e4):
        supply = pp.Supply.at_speed(PIPE, 6.0, friction=friction)
        motion = pp.simulate(model, supply, 3.0, start, rtol=1e-9)
        misses.append(np.abs(motion.tip - steady.tip).max())
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.02)  # of the first order in 1 / f


def test_a_base_that_accelerates_downward_is_less_gravity():
    """Of the fluid, too: it weighs less in the falling frame."""
    supply, falling = pp.Supply(40.0, 2.5), 1.5

    def motion(gamma, base):
        model = pp.Chain(pp.Pipe(0.3, gamma), 5)
        return pp.simulate(model, supply, 1.0, lambda s: 0.8 * s, rtol=1e-10, base=base)

    place = (
        lambda t: (0.0, 0.5 * falling * t**2),
        lambda t: (0.0, falling * t),
        lambda t: (0.0, falling),
    )
    moved = motion(2.0, place)
    weight = pp.Supply(40.0, 2.5, weight=0.3 * 2.0)
    assert moved.audit < 1e-8
    lighter = motion(2.0 - falling, None)
    # The head at which both begin is the same in the frame of the base.
    begin = dataclasses.replace(supply, start=weight.speed(pp.Pipe(0.3, 2.0)))
    again = pp.simulate(lighter.model, begin, 1.0, lambda s: 0.8 * s, rtol=1e-10)
    assert np.abs(moved.q - again.q).max() < 1e-8
    assert moved.flow_speed == pytest.approx(again.flow_speed, abs=1e-8)


@pytest.mark.parametrize("make", [lambda: pp.Chain(PIPE, 6), lambda: pp.Galerkin(PIPE, 5)])
def test_the_onset_stays_and_its_criticality_changes(make):
    """The law against motions at 0.002 above the onset, whose amplitude is measured."""
    model = make()
    steady = pp.hopf(model)
    assert pp.hopf(model, friction=1e6).lyapunov == pytest.approx(steady.lyapunov, rel=1e-5)
    found = pp.hopf(model, friction=1.5)
    assert (found.speed, found.growth) == (steady.speed, pytest.approx(steady.growth, rel=1e-9))
    assert steady.criticality == found.criticality == "supercritical"
    assert found.amplitude_law > 1.5 * steady.amplitude_law
    assert pp.hopf(model, friction=0.3).criticality == "subcritical"
    u = found.speed + 0.002
    supply = pp.Supply.at_speed(PIPE, u, friction=1.5)
    phase = math.sqrt(found.amplitude_law * 0.002) * found.mode.real  # on the cycle, to first order
    n = model.integrated
    motion = pp.simulate(
        model, supply, 60.0, phase[:n], phase[n:], rtol=1e-8, times=np.linspace(58.0, 60.0, 801)
    )
    reached = np.abs(motion.tip[:, 0]).max() ** 2 / 0.002
    assert reached == pytest.approx(found.amplitude_law, rel=0.02)


def test_from_si_counts_pressure_and_friction():
    pipe = pp.Pipe.from_si(length=1.0, bending_stiffness=0.02, pipe_mass=0.2, fluid_mass=0.1)
    supply = pp.Supply.from_si(pipe, pressure=2e4, density=1000.0, friction=5.0, start=1.0)
    # 0.1 kg/m of water has a section of 1e-4 m^2.
    assert supply.head == pytest.approx(2e4 * 1e-4 * 1.0**2 / 0.02, rel=1e-14)
    # 20 kPa and a metre of water against 5 velocity heads.
    speed = math.sqrt(2.0 * (2e4 + 1000.0 * 9.81) / (1000.0 * 5.0))
    assert pipe.speed_si(supply.speed(pipe)) == pytest.approx(speed, rel=1e-14)
    assert supply.start == pytest.approx(pipe.speed_from_si(1.0))
    # In oil of 900 kg/m^3, whose pressure grows with the depth of the outlet.
    dipped = pp.Supply.from_si(
        pipe, pressure=2e4, density=1000.0, friction=5.0, weight=9.81 * 1e-4 * 100.0
    )
    slower = math.sqrt(2.0 * (2e4 + 100.0 * 9.81) / (1000.0 * 5.0))
    assert pipe.speed_si(dipped.speed(pipe)) == pytest.approx(slower, rel=1e-14)


def test_members_have_supplies_of_their_own():
    model = pp.Chain(PIPE, 4)
    given = [pp.Supply.at_speed(PIPE, u, friction=2.0) for u in (3.0, 4.0)] + [5.0]
    ensemble = pp.simulate_many(model, given, 0.5, lambda s: 0.3 * s, rtol=1e-9)
    for motion, one in zip(ensemble.motions, given, strict=True):
        alone = pp.simulate(model, one, 0.5, lambda s: 0.3 * s, rtol=1e-9, method=motion.method)
        assert np.abs(motion.q - alone.q).max() < 1e-9
        assert motion.flow_speed == pytest.approx(alone.flow_speed, abs=1e-9)


def test_events_and_dense_output_see_the_pipe():
    event = pp.Event(lambda t, q, qdot: q[-1], terminal=True)
    motion = pp.simulate(
        pp.Chain(PIPE, 4), SUPPLY, 5.0, lambda s: 0.3 * s, events=event, dense=True, rtol=1e-9
    )
    at = float(motion.events[0].t[0])
    assert at < 5.0
    assert abs(motion.dense(at)[3]) < 1e-9


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pp.Supply(-10.0, 2.0).speed(PIPE), "head must drive a flow"),
        (lambda: pp.Supply.from_si(PIPE, pressure=1.0, density=1.0, friction=1.0), "from_si"),
        (
            lambda: pp.simulate(pp.Chain(pp.Pipe(0.0), 3), SUPPLY, 1.0, lambda s: 0 * s),
            "beta must be above 0 with a Supply",
        ),
        (
            lambda: pp.simulate(pp.Chain(PIPE, 3), pp.Supply(-9.0, 1.0), 1.0, lambda s: 0 * s),
            "head must drive a flow",
        ),
    ],
)
def test_bad_input_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_bent_pipe_has_no_law_at_constant_head():
    chain = pp.Chain(pp.Pipe(0.3, jet_angle=0.3), 4)
    branch = pp.equilibrium_branch(chain, pp.equilibria(chain, 4.0).q[0], 4.0, (4.0, 10.0))
    onset = next(point for point in branch.points if point.kind == "hopf")
    with pytest.raises(ValueError, match="friction must be None of a bent pipe"):
        pp.hopf(chain, onset, friction=1.0)


def test_a_flow_that_stops_ends_the_motion_for_that_reason():
    """A base that drops fast leaves the fluid behind."""
    drop = (
        lambda t: (0.0, 150.0 * t**2),
        lambda t: (0.0, 300.0 * t),
        lambda t: (0.0, 300.0),
    )
    with pytest.raises(pp.MotionStopped, match="its flow stops and would turn back") as caught:
        pp.simulate(pp.Chain(PIPE, 3), SUPPLY, 5.0, lambda s: 0.1 * s, base=drop, samples=2001)
    assert 0.0 < caught.value.motion.flow_speed[-1] < 1.0


FED, FLOW = pp.Supply(36.0, 2.0), pp.Pulsation(5.0, 0.1, 3.0)
STRAIGHT = pp.Chain(pp.Pipe(0.2, damping=0.01), 4)


@pytest.mark.parametrize(
    ("name", "ask", "pulsates"),
    [
        ("u", lambda u: pp.limit_cycle(STRAIGHT, u), True),
        ("u", lambda u: pp.equilibria(STRAIGHT, u), True),
        ("u", lambda u: pp.frequency_response(STRAIGHT, u), True),
        ("u", lambda u: pp.lyapunov_exponent(STRAIGHT, u), True),
        ("u", lambda u: pp.modes(STRAIGHT, u), True),
        ("u", lambda u: pp.eigenvalues(STRAIGHT, u), True),
        ("u", lambda u: pp.forced_response(STRAIGHT, u, base=pp.Harmonic(0.1, 3.0)), False),
        ("speeds", lambda u: pp.bifurcation_diagram(STRAIGHT, u), True),
        ("speeds", lambda u: pp.bifurcation_diagram(STRAIGHT, [4.0, u]), True),
        ("speeds", lambda u: pp.root_loci(STRAIGHT, u), True),
        ("mean", lambda u: pp.parametric_regions(STRAIGHT, u, 0.1, (3.0, 9.0)), True),
    ],
)
def test_what_needs_a_steady_flow_says_what_can_be_asked_of_another(name, ask, pulsates):
    rule = rf"^{name} must be steady, got Supply\(.*: at constant head ask simulate .* hopf\("
    with pytest.raises(TypeError, match=rule):
        ask(FED)
    if pulsates:
        with pytest.raises(TypeError, match=rf"^{name} must be steady, .*: of a pulsating flow"):
            ask(FLOW)
