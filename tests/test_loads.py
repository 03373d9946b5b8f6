# SPDX-License-Identifier: MIT
"""Inclined pipes and dead or follower loads, under which a pipe rests bent.

The routes are independent of the models': the boundary-value problem of the elastica, identities
between loads, and numbers of a program that shares no code with the package.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from independent import derivative_along
from scipy.integrate import solve_bvp

import pipedyn as pp

LEVEL = math.pi / 2

RESTS = [
    ({"gamma": 10.0, "inclination": LEVEL}, 0.0, (1.052643117, 0.700199716, 0.656353761)),
    ({"gamma": 10.0, "inclination": math.pi / 4}, 4.0, (0.390468724, 0.272701775, 0.955073166)),
    ({"terms": [pp.Load(1.0, (3.0, 0.0))]}, 0.0, (0.986016947, 0.603253441, 0.745579815)),
    ({"terms": [pp.Load(1.0, (1.0, -2.0))]}, 2.0, (0.627664367, 0.357512298, 0.912174439)),
    ({"terms": [pp.DistributedLoad((4.0, -3.0))]}, 1.0, (0.782107470, 0.537667236, 0.813520403)),
]
"""Numbers of the pipe, u, and theta(1), x, y of its end, by a boundary-value problem."""

TWO_LOADS = {
    "gamma": 6.0,
    "inclination": 2.0,
    "terms": [pp.Load(0.6, (1.5, -2.0)), pp.FollowerForce(0.35, 2.5), pp.FollowerForce(1.0, -1.0)],
}


def elastica(pipe, u, s):
    """theta, x and y of the pipe at rest at arc lengths s, by a boundary-value problem.

    The moment changes along the pipe as the force beyond each place turns it, theta'' = n . F(s);
    panels between the places of loads are mapped to [0, 1] and solved at once.
    """
    iota, terms = pipe.inclination, pipe.terms
    ends = np.unique([0.0, *(t.at for t in terms if hasattr(t, "at")), 1.0])
    h, count = np.diff(ends), len(ends) - 1
    per_length = pipe.gamma * np.array([math.sin(iota), math.cos(iota)])
    for term in terms:
        if isinstance(term, pp.DistributedLoad):
            per_length = per_length + np.array([term.force_x, term.force_y])

    def force_beyond(panel, at, angles):
        """The force on the pipe beyond a place; angles: those at the ends of panels."""
        force = per_length[:, None] * (1.0 - at)
        thrust = pipe.alpha * u**2
        force = force - thrust * np.array([[np.sin(angles[-1])], [np.cos(angles[-1])]])
        for term in terms:
            if not hasattr(term, "at") or term.at <= ends[panel]:
                continue
            there = angles[np.searchsorted(ends, term.at)]
            if isinstance(term, pp.Load):
                force = force + np.array([[term.force_x], [term.force_y]])
            else:
                force = force - term.force * np.array([[np.sin(there)], [np.cos(there)]])
        return force

    def slopes(t, z, angles):
        found = np.empty_like(z)
        for k in range(count):
            theta = z[4 * k]
            across, along = force_beyond(k, ends[k] + h[k] * t, angles)
            bend = -(np.cos(theta) * across - np.sin(theta) * along)
            found[4 * k : 4 * k + 4] = h[k] * np.array(
                [z[4 * k + 1], bend, np.sin(theta), np.cos(theta)]
            )
        return found

    def conditions(a, b, angles):
        joined = np.concatenate(
            [a[4 * k : 4 * k + 4] - b[4 * k - 4 : 4 * k] for k in range(1, count)] or [[]]
        )
        return np.concatenate([a[[0, 2, 3]], joined, [b[-3]], angles - np.append(a[0], b[::4])])

    t = np.linspace(0.0, 1.0, 41)
    guess = np.zeros((4 * count, t.size))
    found = solve_bvp(slopes, conditions, t, guess, np.zeros(count + 1), tol=1e-10, max_nodes=20000)
    assert found.success
    panel = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, count - 1)
    return np.array(
        [
            found.sol((one - ends[k]) / h[k])[4 * k + np.array([0, 2, 3])]
            for k, one in zip(panel, s, strict=True)
        ]
    ).T


def exact(numbers, m=16):
    return pp.Galerkin(pp.Pipe(0.2, **numbers), m, "legendre")


def rest_of(model, u):
    """The equilibrium to which the straight pipe is nearest."""
    return pp.equilibria(model, u).q[0]


@pytest.mark.parametrize(("numbers", "u", "expected"), RESTS)
def test_a_loaded_pipe_rests_as_a_boundary_value_problem_says(numbers, u, expected):
    model = exact(numbers)
    q = rest_of(model, u)
    found = [float(model.functions(1.0, 1) @ q), *model.tip(q)]
    assert found == pytest.approx(expected, abs=2e-9)


@pytest.mark.parametrize("numbers", [one for one, *_ in RESTS] + [TWO_LOADS])
def test_a_loaded_pipe_rests_as_the_elastica(numbers):
    model = exact(numbers, 24)
    q, s = rest_of(model, 1.5), np.linspace(0.05, 1.0, 9)
    theta, x, y = elastica(model.pipe, 1.5, s)
    assert model.functions(s, 1) @ q == pytest.approx(theta, abs=1e-7)
    assert model.shape(q, s) == pytest.approx(np.transpose([x, y]), abs=1e-7)


@pytest.mark.parametrize(("numbers", "u", "expected"), [RESTS[1], RESTS[4]])
def test_loaded_chains_tend_to_the_exact_rest_with_second_order(numbers, u, expected):
    errors = []
    for n in (10, 20, 40):
        chain = pp.Chain(pp.Pipe(0.2, **numbers), n)
        errors.append(chain.tip(rest_of(chain, u)) - expected[1:])
    ratios = [np.linalg.norm(a) / np.linalg.norm(b) for a, b in itertools.pairwise(errors)]
    assert ratios == pytest.approx([4.0, 4.0], rel=0.05)
    assert np.linalg.norm(errors[-1]) < 1e-3


MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 5),
    "midpoint chain": lambda pipe: pp.Chain(pipe, 5, springs="midpoint"),
    "beam modes": lambda pipe: pp.Galerkin(pipe, 4),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 10, "legendre"),
    "scene": lambda pipe: pp.modular.chain(pipe, 5),
}
kinds = pytest.mark.parametrize("kind", MODELS)


def state_of(model):
    """Angles up to some .5 rad and rates of the same size."""
    rng = np.random.default_rng(3)
    p, rate = rng.standard_normal((2, model.integrated)) / np.arange(2.0, model.integrated + 2.0)
    return np.concatenate([one[0] for one in model.to_user(p[None], rate[None])])


def answers(model, y, u=1.7):
    power = model.power(y, u)
    found = [model.rhs(0.0, y, u), power.total]
    if not isinstance(model, pp.modular.Assembly):
        found += [model.jacobian(0.0, y, u), model.operators(y[: y.size // 2]).stiffness]
    return [*found, model.energy(y) - model.energy(0.9 * y)]


@kinds
def test_an_inclined_pipe_is_a_hanging_one_with_its_weight_across(kind):
    iota, others = 0.8, [pp.PointMass(0.6, 0.3), pp.AddedMass(0.4)]
    gx, gy = 7.0 * math.sin(iota), 7.0 * math.cos(iota)
    inclined = pp.Pipe(0.3, 7.0, drag=0.4, inclination=iota, terms=others)
    loads = [pp.DistributedLoad((gx, 0.0)), pp.Load(0.6, (0.3 * gx, 0.0))]
    loaded = pp.Pipe(0.3, gy, drag=0.4, terms=[*others, *loads])
    one, other = MODELS[kind](inclined), MODELS[kind](loaded)
    y = state_of(one)
    for a, b in zip(answers(one, y), answers(other, y), strict=True):
        assert a == pytest.approx(b, rel=1e-10, abs=1e-10 * np.abs(b).max())
    upright = pp.Pipe(0.3, -7.0), pp.Pipe(0.3, 7.0, inclination=math.pi)
    found = [answers(MODELS[kind](pipe), y) for pipe in upright]
    for a, b in zip(*found, strict=True):
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12 * np.abs(b).max())


@pytest.mark.parametrize("kind", ["chain", "Legendre functions"])
def test_weight_in_any_direction_acts_as_an_acceleration_of_the_clamp(kind):
    """Also on a mass that varies along the pipe."""
    iota = -1.1
    numbers = {"mass": lambda s: 1.0 + s**2, "damping": 0.01, "terms": [pp.PointMass(1.0, 0.2)]}
    one, other = (
        MODELS[kind](pp.Pipe(0.3, gamma, inclination=angle, **numbers))
        for gamma, angle in ((5.0, iota), (0.0, 0.0))
    )
    y = state_of(one)
    base = np.zeros((3, 2))
    base[2] = -5.0 * math.sin(iota), -5.0 * math.cos(iota)
    found, expected = one.rhs(0.0, y, 2.0), other.rhs(0.0, y, 2.0, base=base)
    assert found == pytest.approx(expected, rel=1e-11, abs=1e-11 * np.abs(expected).max())


@kinds
def test_energy_changes_as_the_power_of_loads_says(kind):
    pipe = pp.Pipe(0.3, damping=0.01, drag=0.3, **TWO_LOADS)
    model = MODELS[kind](dataclasses.replace(pipe, terms=[*pipe.terms, pp.DistributedLoad((1, 2))]))
    y = state_of(model)
    change = derivative_along(model.energy, y, model.rhs(0.0, y, 2.0), step=1e-4)
    assert model.power(y, 2.0).total == pytest.approx(change, rel=1e-8)
    assert model.power(y, 2.0).others != 0.0
    still = 0.0 * y if not isinstance(model, pp.modular.Assembly) else model.state(np.zeros(5))
    assert model.energy(still) == pytest.approx(0.0, abs=1e-13)


def test_a_swinging_level_pipe_keeps_its_energy_and_comes_to_its_rest():
    free = pp.Galerkin(pp.Pipe(0.0, 10.0, inclination=LEVEL), 4)
    motion = pp.simulate(free, 0.0, 2.0, np.zeros(4), rtol=1e-10, atol=1e-12)
    energy = motion.energy
    assert np.ptp(energy) < 1e-8 * np.abs(
        motion.model.energy(np.append(motion.q[-1], 0.0 * motion.q[-1]))
    )
    damped = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.2, inclination=LEVEL), 6)
    motion = pp.simulate(damped, 1.0, 30.0, np.zeros(6))
    assert motion.q[-1] == pytest.approx(rest_of(damped, 1.0), abs=1e-6)


def test_the_head_of_an_inclined_pipe_counts_the_depth_of_its_outlet():
    """The equation of the flow is Newton's along the tube; its derivatives meet differences."""
    for kind in ("chain", "Legendre functions"):
        pipe = pp.Pipe(0.3, 8.0, inclination=1.1)
        model = MODELS[kind](pipe)
        supply = pp.Supply.at_speed(pipe, 3.0, friction=2.0)
        assert supply.speed(pipe) == pytest.approx(3.0)
        motion = pp.simulate(model, supply, 0.02, np.zeros(model.coordinates), samples=3)
        steady = pp.simulate(model, 3.0, 0.02, np.zeros(model.coordinates), samples=3)
        assert np.abs(motion.q - steady.q).max() < 1e-4
        assert np.ptp(motion.flow_speed) > 0.0
        flow = pp.motion.constant_head.ConstantHead(model, supply)
        y = np.append(state_of(model), 2.5)

        def rates(z, flow=flow):
            return np.delete(flow.rates(np.insert(z, -1, 0.0)), -2)

        exact_slopes = flow.jacobian(y)
        slopes = np.stack([derivative_along(rates, y, way, 1e-3) for way in np.eye(y.size)], axis=1)
        assert exact_slopes == pytest.approx(slopes, abs=1e-6 * np.abs(slopes).max())


def test_a_hose_clamped_level_at_a_table_is_given_in_si():
    hose = {"length": 0.6, "bending_stiffness": 0.02, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(
        **hose,
        inclination=LEVEL,
        terms=[
            pp.Load(0.3, (0.02, -0.01)),
            pp.DistributedLoad((0.3, 0.0)),
            pp.FollowerForce(0.6, 0.1),
        ],
    )
    force = 0.02 / 0.6**2
    assert pipe.inclination == LEVEL
    load, wind, thrust = pipe.terms
    assert (load.at, load.force_x, load.force_y) == pytest.approx(
        (0.5, 0.02 / force, -0.01 / force)
    )
    assert wind.force_x == pytest.approx(0.3 * 0.6 / force)
    assert thrust.force == pytest.approx(0.1 / force)
    numbers = dataclasses.astuple(pipe.terms_si[0])
    assert numbers == pytest.approx((0.3, 0.02, -0.01))
    tube = pp.Pipe.from_tube(
        length=0.5,
        outer_diameter=12e-3,
        inner_diameter=8e-3,
        youngs_modulus=3e6,
        density=1150.0,
        fluid_density=998.0,
        inclination=LEVEL,
    )
    assert (tube.inclination, tube.axial_gravity) == (LEVEL, 0.0)
    with pytest.raises(ValueError, match=r"^inclination must lie in .*: in rad, not in degrees\?"):
        pp.Pipe.from_si(**hose, inclination=90)
    floating = pp.Pipe.from_si(
        **hose,
        inclination=1.0,
        external_diameter=0.02,
        external_density=1000.0,
        terms=[pp.PointMass(0.6, 0.1)],
    )
    mass, kept = floating.terms
    whole = 9.81 * 0.6**3 * 1000.0 * math.pi * 1e-4 / 0.02 * mass.mass
    assert (kept.force_x, kept.force_y) == pytest.approx(
        (whole * math.sin(1.0), whole * math.cos(1.0))
    )


@pytest.mark.parametrize("kind", ["chain", "Legendre functions"])
def test_a_loaded_pipe_in_space_moves_in_its_plane_as_the_planar_one(kind):
    """And its energy changes as the power says where it leaves that plane."""
    terms = [*TWO_LOADS["terms"], pp.DistributedLoad((1.0, 2.0)), pp.PointMass(0.7, 0.2)]
    pipe = pp.Pipe(0.3, damping=0.01, drag=0.3, **{**TWO_LOADS, "terms": terms})
    planar = MODELS[kind](pipe)
    n = planar.coordinates
    model = (
        pp.Chain(pipe, 5, dimensions=3)
        if kind == "chain"
        else pp.Galerkin(pipe, 10, "legendre", dimensions=3)
    )
    y = state_of(planar)
    both = np.concatenate([y[:n], np.zeros(n), y[n:], np.zeros(n)])
    found = np.split(model.rhs(0.0, both, 2.0), 4)
    expected = planar.rhs(0.0, y, 2.0)
    assert found[2] == pytest.approx(expected[n:], rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert np.abs(found[3]).max() == 0.0
    assert model.energy(both) == pytest.approx(planar.energy(y), rel=1e-10)
    leaving = (
        0.6 * np.random.default_rng(5).standard_normal(4 * n) / np.tile(np.arange(1, n + 1), 4)
    )
    change = derivative_along(model.energy, leaving, model.rhs(0.0, leaving, 2.0), step=1e-4)
    assert model.power(leaving, 2.0).total == pytest.approx(change, rel=1e-7)
    modes = pp.modes(model, 1.0, 6)
    in_plane = modes.eigenvalues[~modes.across]
    assert in_plane == pytest.approx(pp.modes(planar, 1.0, in_plane.size).eigenvalues, rel=1e-7)


def test_loads_take_quantities():
    pint = pytest.importorskip("pint").UnitRegistry()
    pair = (0.1 * pint.N, 20.0 * pint.mN)
    loads = [
        pp.Load(30.0 * pint.cm, pair),
        pp.DistributedLoad(np.array([1.0, 2.0]) * pint.N / pint.m),
    ]
    hose = {"length": 0.6, "bending_stiffness": 0.02, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(**hose, terms=loads)
    load, wind = pipe.terms_si
    assert dataclasses.astuple(load) == pytest.approx((0.3, 0.1, 0.02))
    assert wind.force == pytest.approx((1.0, 2.0))


def test_loads_are_checked_and_shown():
    assert repr(pp.Load(1.0, (3.0, 0.0))) == "Load(at=1, force_x=3)"
    assert pp.Load(0.5, [1, 2]) == pp.Load(0.5, force_x=1.0, force_y=2.0)
    assert pp.DistributedLoad((1, 2)).force == pp.Load(0.5, [1, 2]).force == (1.0, 2.0)
    rule = r"^force must be a pair of components \(x, y\) in the plane of motion, .*, got "
    for bad in (3.0, (1.0, 2.0, 3.0), "ab", {1.0, 2.0}):
        with pytest.raises(TypeError, match=rule):
            pp.Load(1.0, bad)
        with pytest.raises(TypeError, match=rule):
            pp.DistributedLoad(bad)
    with pytest.raises(ValueError, match="force or its components must be given, not both"):
        pp.Load(1.0, (1.0, 0.0), force_y=2.0)
    with pytest.raises(ValueError, match=r"force\[0\] must be finite"):
        pp.Load(1.0, (math.nan, 0.0))
    with pytest.raises(ValueError, match=r"terms\[0\]\.force_y must lie in"):
        pp.Pipe(0.2, terms=[pp.Load(1.0, (0.0, 1e7))])
    with pytest.raises(
        ValueError, match=r"^inclination must lie in \[-3\.14159, 3\.14159\], got 4"
    ):
        pp.Pipe(0.2, 10.0, inclination=4.0)
    hanging, level, standing = (pp.Pipe(0.2, 10.0, inclination=i) for i in (0.0, LEVEL, math.pi))
    assert (hanging.rests_straight, level.rests_straight, standing.rests_straight) == (
        True,
        False,
        True,
    )
    assert pp.Pipe(0.2, inclination=LEVEL).rests_straight  # without weight
    assert not pp.Pipe(0.2, terms=[pp.Load(0.5, (1.0, 0.0))]).rests_straight
    assert pp.Pipe(0.2, terms=[pp.Load(0.5, (0.0, 1.0)), pp.FollowerForce(0.5, 1.0)]).rests_straight


# ------------------------------------------------------------ straight pipes with follower loads


@pytest.mark.parametrize(
    "make", [pp.Continuum, lambda p: pp.Galerkin(p, 24, "legendre"), lambda p: pp.Galerkin(p, 60)]
)
def test_a_follower_force_at_mid_span_lowers_the_critical_speed(make):
    found = pp.critical_speed(make(pp.Pipe(0.2, terms=[pp.FollowerForce(0.5, 5.0)])))
    digits = 1e-8 if make is pp.Continuum else 1e-4
    assert (found.speed, found.frequency) == pytest.approx((5.17559965, 13.7910851), rel=digits)


def test_chains_with_a_follower_force_tend_to_the_exact_onset_with_second_order():
    """The force stands in the middle of a segment."""
    pipe = pp.Pipe(0.2, terms=[pp.FollowerForce(0.5, 5.0)])
    errors = [pp.critical_speed(pp.Chain(pipe, n)).speed - 5.17559965 for n in (11, 21, 43)]
    assert errors[0] / errors[1] == pytest.approx((21 / 11) ** 2, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx((43 / 21) ** 2, rel=0.1)


def test_becks_column_flutters_under_its_printed_load():
    """20.05 of Beck 1952; two frequencies meet at 20.05096, at 11.0154."""
    below, above = (
        pp.eigenvalues(pp.Continuum(pp.Pipe(0.0, terms=[pp.FollowerForce(1.0, load)])), 0.0, 4)
        for load in (20.05095, 20.05097)
    )
    assert np.abs(below.real).max() < 1e-6
    assert above.real.max() > 1e-3
    assert above.imag.max() == pytest.approx(11.0154, abs=1e-3)


def test_dead_loads_along_the_pipe_stretch_it_as_a_weight_does():
    """A load per length is gamma without the inertia of mass, and one at the end is a tension."""
    heavy = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, 10.0))).speed
    for make in (pp.Continuum, lambda p: pp.Chain(p, 30)):
        pulled = pp.critical_speed(
            make(pp.Pipe(0.2, terms=[pp.DistributedLoad((0.0, 10.0))]))
        ).speed
        expected = (
            heavy if make is pp.Continuum else pp.critical_speed(make(pp.Pipe(0.2, 10.0))).speed
        )
        assert pulled == pytest.approx(expected, rel=1e-9)
    ended = [pp.Load(1.0, (0.0, -2.0)), pp.Tension(-2.0)]
    found = [pp.critical_speed(pp.Continuum(pp.Pipe(0.2, terms=[one]))).speed for one in ended]
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    both = pp.Pipe(0.2, terms=[pp.PointMass(0.4, 0.3), pp.DistributedLoad((0.0, 4.0))])
    found = [pp.critical_speed(one).speed for one in (pp.Continuum(both), pp.Galerkin(both, 80))]
    assert found[0] == pytest.approx(found[1], rel=1e-4)
