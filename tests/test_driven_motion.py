# SPDX-License-Identifier: MIT
"""Motions of a pipe whose flow pulsates or whose base moves: amplitudes, energy, arguments."""

import dataclasses
import math
from functools import cache

import numpy as np
import pytest

import pipedyn as pp

PULSATING = pp.Pipe(0.2, 10.0, damping=0.002)
SHAKEN = pp.Pipe(0.2, damping=0.002)
LOADED = pp.Pipe(
    *(0.3, 4.0, "aspirating", 0.8),
    inflow_share=0.5,
    drag=0.4,
    damping=0.01,
    terms=(pp.Spring(0.6, 9.0), pp.Damper(1.0, 0.2), pp.AddedMass(0.3), pp.PointMass(0.7, 0.2)),
)


def amplitude(motion, period):
    """Half the peak-to-peak of the tip in the last period, by parabolas through its extremes."""
    t = np.linspace(motion.t[-1] - period, motion.t[-1], 401)
    x = motion.model.tips(motion.dense(t)[: motion.model.coordinates])[:, 0]

    def top(values):
        i = int(np.argmax(values[1:-1])) + 1
        low, middle, high = values[i - 1 : i + 2]
        return middle + (high - low) ** 2 / (8.0 * (2.0 * middle - high - low))

    return 0.5 * (top(x) + top(-x))


def bend(s):
    return 0.3 * s**2


SUBHARMONIC = [
    (lambda pipe: pp.Galerkin(pipe, 4, "legendre"), 0.3973139),
    (lambda pipe: pp.Galerkin(pipe, 6, "legendre"), 0.4200452),
    (lambda pipe: pp.Chain(pipe, 10), 0.4266074),
    (lambda pipe: pp.Chain(pipe, 20), 0.4214321),
    (lambda pipe: pp.modular.chain(pipe, 10), 0.4266074),
]
"""Models of `PULSATING`, and the amplitude of each at mean 6, amplitude 0.3, frequency 30."""


@pytest.mark.parametrize(("make", "expected"), SUBHARMONIC)
def test_subharmonic_response_to_a_pulsating_flow_has_its_amplitude(make, expected):
    """By another program, periodic motions by Newton's method; digits as it printed them.

    m = 4 and 6 of the exact reduced model, chains with n = 10 and 20. The motion has twice the
    period of the flow.
    """
    flow = pp.Pulsation(6.0, 0.3, 30.0)
    motion = pp.simulate(make(PULSATING), flow, 60 * flow.period, bend, rtol=1e-9, dense=True)
    assert amplitude(motion, 2.0 * flow.period) == pytest.approx(expected, abs=2e-7)
    assert motion.audit < 1e-8
    assert motion.u is flow


@pytest.mark.parametrize(("m", "expected"), [(4, 0.1462570), (6, 0.1633365)])
def test_response_to_a_shaken_base_has_its_amplitude(m, expected):
    """By the same program: X = 0.02 cos(13.5 tau), u = 5, the tip relative to the base."""
    base = pp.Harmonic(0.02, 13.5)
    model = pp.Galerkin(SHAKEN, m, "legendre")
    motion = pp.simulate(model, 5.0, 45.0, bend, base=base, rtol=1e-9, dense=True)
    assert amplitude(motion, base.period) == pytest.approx(expected, abs=2e-6)
    assert motion.base is base


def test_small_shaking_moves_the_tip_as_the_linear_pipe_says():
    """|w(1) / X| = |.435537098 - .580465010 i| at u = 4, omega = 4: determinants in 30 digits."""
    base = pp.Harmonic(1e-4, 4.0)
    model = pp.Galerkin(pp.Pipe(0.2), 8, "legendre")
    motion = pp.simulate(
        model, 4.0, 30.0, np.zeros(8), base=base, rtol=1e-9, atol=1e-12, dense=True
    )
    found = amplitude(motion, base.period) / 1e-4
    assert found == pytest.approx(abs(0.435537098 - 0.580465010j), rel=2e-6)


def test_a_base_that_falls_freely_takes_gravity_away_and_one_that_speeds_up_tilts_it():
    heavy, light = (pp.Chain(pp.Pipe(0.2, gamma), 4) for gamma in (7.0, 0.0))
    y = np.random.default_rng(1).standard_normal(8)
    falling = np.array([[0.0, 0.0], [0.3, -0.4], [0.0, 7.0]])
    rates = heavy.rhs(0.0, y, 2.0, base=falling)
    assert np.abs(rates - light.rhs(0.0, y, 2.0)).max() < 1e-12 * np.abs(rates).max()
    hose = pp.Chain(pp.Pipe(0.2, 7.0), 4, springs=np.zeros(4))
    hanging = np.concatenate([np.full(4, -math.atan2(3.0, 7.0)), np.zeros(4)])
    still = hose.rhs(0.0, hanging, 0.0, base=[[0.0, 0.0], [0.0, 0.0], [3.0, 0.0]])
    assert np.abs(still).max() < 1e-11


MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 5),
    "beam modes": lambda pipe: pp.Galerkin(dataclasses.replace(pipe, drag=0.0), 4),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 5, "legendre"),
    "scene": lambda pipe: pp.modular.chain(pipe, 5).plus(pp.modular.Guide(3)),
    "held chain": lambda pipe: pp.Chain(dataclasses.replace(pipe, **HELD), 5),
    "held Legendre functions": lambda pipe: pp.Galerkin(
        dataclasses.replace(pipe, drag=0.0, **HELD), 6, "legendre"
    ),
    "stretched chain": lambda pipe: pp.Chain(dataclasses.replace(pipe, **FIXED), 5),
    "stretched Legendre functions": lambda pipe: pp.Galerkin(
        dataclasses.replace(pipe, drag=0.0, **FIXED), 5, "legendre"
    ),
    "stretched scene": lambda pipe: pp.modular.chain(dataclasses.replace(pipe, **FIXED), 5),
}
HELD = {"root": "pinned", "supports": (0.6,)}
FIXED = {"root": "pinned", "end": "pinned", "terms": (*LOADED.terms, pp.Stretching(40.0))}


@pytest.mark.parametrize(
    ("make", "method"),
    [*((make, "radau") for make in MODELS.values()), (MODELS["chain"], "dop853")],
    ids=[*MODELS, "chain, explicit"],
)
def test_the_audit_of_a_driven_motion_closes(make, method):
    """Of a flow that pulsates and a base that runs around, with all that sees its motion."""
    model = make(LOADED)
    start = np.zeros(model.integrated)
    flow, base = (
        pp.Pulsation(1.5, 0.6, 7.0),
        lambda t: (0.2 * math.sin(3 * t), 0.1 * math.cos(2 * t)),
    )
    moves = (
        base,
        lambda t: (0.6 * math.cos(3 * t), -0.2 * math.sin(2 * t)),
        lambda t: (-1.8 * math.sin(3 * t), -0.4 * math.cos(2 * t)),
    )
    sharp = {"rtol": 1e-11, "samples": 21, "method": method}
    motion = pp.simulate(model, flow, 0.4, start, base=moves, **sharp)
    assert motion.audit < 1e-9
    if model.pipe.supports:
        assert max(abs(model.shape(q, [0.6])[0, 0]) for q in motion.q) < 1e-9
    if method == "dop853":
        return
    other = pp.simulate(model, lambda t: flow(t), 0.4, start, base=base, **sharp)
    assert np.abs(other.q - motion.q).max() < 1e-8 * np.abs(motion.q).max()


def tent(theta, rate, pipe, spring, base):
    """theta'' of two equal segments between hinges, theta_2 = -theta_1, from its Lagrangian; u = 0.

    With the base at (X, Y): T = I theta'^2 / 2 + X' c theta' / 4 - Y' s theta' / 2,
    I = (2 + 8 s^2) / 32 + 1 / 48, V = 2 k theta^2 + K (1 - c)^2 / 2 - gamma c / 2.
    """
    s, c = math.sin(theta), math.cos(theta)
    axial = pipe.terms[0].stiffness
    inertia = (2.0 + 8.0 * s**2) / 32.0 + 1.0 / 48.0
    force = -0.25 * s * c * rate**2 - 4.0 * spring * theta - axial * (1.0 - c) * s
    force -= 0.5 * pipe.gamma * s + pipe.damping * (4.0 * spring + axial * s**2) * rate
    return (force - 0.25 * c * base[2][0] + 0.5 * s * base[2][1]) / inertia


@pytest.mark.parametrize("make", [pp.Chain, pp.modular.chain])
def test_the_base_carries_an_end_that_is_fixed_axially(make):
    """Where it stands and how fast it moves has no effect, as nothing here is on the ground."""
    pipe = pp.Pipe(
        *(0.2, 3.0), damping=0.01, root="pinned", end="pinned", terms=[pp.Stretching(50.0)]
    )
    model, rng = make(pipe, 2), np.random.default_rng(3)
    spring = float(pp.Chain(pipe, 2).springs[1])
    for theta, rate in ((0.4, 0.0), (-0.9, 2.0)):
        base = rng.standard_normal((3, 2))
        angles, rates = np.array([theta, -theta]), np.array([rate, -rate])
        y = np.append(angles, rates) if make is pp.Chain else model.state(angles, rates)
        found = model.rhs(0.0, y, 0.0, base=base)[y.size // 2 :]
        turning = found[0] if make is pp.Chain else found[2]
        assert turning == pytest.approx(tent(theta, rate, pipe, spring, base), rel=1e-11)


@pytest.mark.parametrize("make", [MODELS[name] for name in MODELS if "stretched" in name])
def test_a_stretched_pipe_on_a_base_that_falls_is_one_without_weight(make):
    terms = (pp.PointMass(0.7, 0.2), pp.Stretching(40.0))
    pipe = pp.Pipe(0.3, 7.0, damping=0.02)
    heavy, light = (
        (model := make(dataclasses.replace(pipe, gamma=gamma))).with_pipe(
            dataclasses.replace(model.pipe, terms=terms)
        )
        for gamma in (7.0, 0.0)
    )
    q = heavy.bent(lambda s: 0.4 * np.cos(math.pi * s))
    y = np.append(q, 0.0 * q)
    falling = np.array([[0.2, -0.4], [0.3, -0.4], [0.0, 7.0]])
    rates, still = heavy.rhs(0.0, y, 2.0, base=falling), light.rhs(0.0, y, 2.0)
    assert np.abs(rates - still).max() < 1e-11 * np.abs(rates).max()
    slopes, own = heavy.jacobian(0.0, y, 2.0, base=falling), light.jacobian(0.0, y, 2.0)
    assert np.abs(slopes - own).max() < 1e-10 * np.abs(own).max()
    assert heavy.energy(y, base=falling) == pytest.approx(heavy.energy(y), rel=1e-12)


@pytest.mark.parametrize("method", ["scipy:Radau", "scipy:DOP853"])
def test_scipys_methods_and_custom_modules_take_what_drives_a_motion(method):
    flow, base = pp.Pulsation(3.0, 0.4, 11.0), pp.Harmonic(0.05, 6.0, "y")
    chain, scene = pp.Chain(SHAKEN, 3), pp.modular.chain(SHAKEN, 3)
    sharp = {"rtol": 1e-8, "samples": 5}
    ours = pp.simulate(chain, flow, 0.3, bend, base=base, **sharp)
    theirs = pp.simulate(chain, flow, 0.3, bend, base=base, method=method, **sharp)
    assert np.abs(ours.q - theirs.q).max() < 1e-6
    own = scene.plus(pp.modular.Custom(nodes=(1,), energy=lambda q: 0.0 * q[0]))
    plain, same = (pp.simulate(m, flow, 0.3, bend, **sharp) for m in (scene, own))
    assert np.abs(plain.q - same.q).max() < 1e-7


def test_members_may_pulsate_each_in_its_own_way():
    chain = pp.Chain(PULSATING, 4)
    flows = [pp.Pulsation(5.0, 0.2, w) for w in (10.0, 20.0)] + [4.0, lambda t: 4.0 + math.sin(t)]
    together = pp.simulate_many(chain, flows, 1.0, bend, samples=5, base=pp.Harmonic(0.02, 9.0))
    for flow, motion in zip(flows, together.motions, strict=True):
        alone = pp.simulate(chain, flow, 1.0, bend, samples=5, base=pp.Harmonic(0.02, 9.0))
        assert np.abs(motion.q - alone.q).max() < 1e-6
        assert motion.u is flow or motion.u == flow
    many = pp.simulate_many(chain, flows[0], 1.0, [bend] * 12, samples=3, method="dop853")
    assert np.ptp([m.q[-1] for m in many.motions], axis=0).max() == 0.0


def test_what_drives_a_motion_may_be_in_si():
    pipe = pp.Pipe.from_si(length=0.6, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.12)
    flow = pp.Pulsation.from_si(pipe, mean=2.0, amplitude=0.3, frequency=5.0)
    assert pipe.speed_si(flow.mean) == pytest.approx(2.0)
    assert pipe.frequency_si(flow.frequency) == pytest.approx(5.0)
    base = pp.Harmonic.from_si(pipe, amplitude=0.01, frequency=5.0, direction="y")
    assert base(0.0) == (0.0, pytest.approx(0.01 / 0.6))
    h = 1e-5
    for of, slope in ((base, base.velocity), (base.velocity, base.acceleration)):
        difference = (np.array(of(0.2 + h)) - np.array(of(0.2 - h))) / (2 * h)
        assert difference == pytest.approx(np.array(slope(0.2)), rel=1e-6)
    assert (flow(0.2 + h) - flow(0.2 - h)) / (2 * h) == pytest.approx(flow.rate(0.2), rel=1e-6)


CHAIN = pp.Chain(pp.Pipe(0.2), 3)


@pytest.mark.parametrize(
    ("call", "kind", "message"),
    [
        (
            lambda: CHAIN.rhs(0.0, np.zeros((6, 2)), 1.0, base=np.zeros((2, 3))),
            *(ValueError, r"base must have shape \(3, 2\) or \(3, 2, 2\), got \(2, 3\)"),
        ),
        (
            lambda: pp.simulate_many(CHAIN, [lambda t: 1.0, -1.0], 1.0, bend),
            *(ValueError, r"u must lie in \[0, 10000\], got -1.0 \(member 1\)"),
        ),
    ],
)
def test_a_bad_drive_is_refused_by_name(call, kind, message):
    with pytest.raises(kind, match=message):
        call()


BAD = {
    "nan": (math.nan, "must be finite, got nan"),
    "negative": (-1.0, r"must lie in \[0, 10000\], got -1.0"),
    "shape": ([1.0, 2.0], r"must be a real number, got \[1.0, 2.0\]"),
    "raises": (None, "it raised ZeroDivisionError: "),
}


def late(value):
    """A flow speed that turns bad between two of the times at which it is tried."""
    return lambda t: (1.0 / 0.0 if value is None else value) if 2.81 < t < 2.83 else 2.0


@cache
def undisturbed(method):
    """The motion at the speed before it turns bad."""
    return pp.simulate(CHAIN, 2.0, 4.0, bend, method=method)


@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:DOP853"])
@pytest.mark.parametrize("kind", BAD)
def test_a_function_of_time_that_turns_bad_late_stops_the_motion_and_keeps_it(kind, method):
    value, message = BAD[kind]
    with pytest.raises(pp.MotionStopped, match=rf"at t = 2\S* u\(2.8\d+\) .*{message}") as stopped:
        pp.simulate(CHAIN, late(value), 4.0, bend, method=method)
    kept = stopped.value.motion
    assert 2.7 < kept.t[-1] <= 2.83
    whole = undisturbed(method)
    assert kept.tip == pytest.approx(whole.tip[: kept.t.size], abs=2e-5)


def test_a_sample_at_which_a_function_fails_ends_what_is_kept():
    """Steps may pass the bad instant; the samples' energy and speed need it."""
    times = [1.0, 2.0, 3.0]
    with pytest.raises(pp.MotionStopped, match=r"base\(2\) must give 2 finite numbers") as stopped:
        pp.simulate(
            *(CHAIN, 2.0, 3.0, bend),
            times=times,
            base=lambda t: (math.nan if t == 2.0 else 0.01 * math.sin(t), 0.0),
        )
    assert stopped.value.motion.t.tolist() == [1.0]


def test_members_keep_their_motions_when_another_turns_bad():
    given = [5.0, late(math.nan), 4.0]
    ensemble = pp.simulate_many(CHAIN, given, 4.0, bend)
    [failure] = ensemble.failures
    assert failure.index == 1
    assert "must be finite, got nan" in str(failure.error)
    assert [one.t[-1] == 4.0 for one in ensemble.motions] == [True, False, True]
