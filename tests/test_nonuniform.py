# SPDX-License-Identifier: MIT
"""Pipes whose bending stiffness and mass vary along them, against routes that share no code."""

import dataclasses
import itertools
import math
import pickle

import numpy as np
import pytest
from campaign_elements import elements
from independent import derivative_along, panels, second_derivative_along
from scipy.integrate import quad
from test_terms import MODELS, jacobian_by_differences, sizes_of, state_of

import pipedyn as pp

STEPS = (0.3, 0.37)


def stiffness(s):
    """With a jump at 0.37."""
    return np.where(s < 0.37, 1.0 - s / 2, 0.5 + 0.3 * np.sin(3 * s))


def mass(s):
    """With a jump at 0.3 and, beyond, the weight of a flange."""
    return np.where(s < 0.3, 1.0 + s, 0.8 + s**2)


PIPE = pp.Pipe(
    0.3, 7.0, "aspirating", alpha=0.8, drag=0.4, damping=0.02, stiffness=stiffness, mass=mass
)
UNIFORM = dataclasses.replace(
    PIPE, stiffness=None, mass=None, terms=[pp.PointMass(s, 0.0) for s in STEPS]
)
SPEED = 1.7
TAPER = {"stiffness": lambda s: 1 - s / 2, "mass": lambda s: 1 + s}

models = pytest.mark.parametrize("kind", MODELS)


@pytest.mark.parametrize(
    "holding",
    [
        {},
        {"root": pp.RootSpring(0.3)},
        {"root": "pinned", "end": "pinned"},
        {"root": "pinned"},
        {"end": "clamped", "supports": [0.6]},
        {"root": pp.RootSpring(20.0), "end": "guided"},
        {"supports": [0.37]},
    ],
    ids=repr,
)
def test_eigenvalues_are_those_of_finite_elements(holding):
    pipe, u = dataclasses.replace(PIPE, **holding), 1.5
    numbers = {name: getattr(pipe, name) for name in ("beta", "gamma", "flow", "alpha", "damping")}
    numbers |= {"stiffness": ([0.37], [stiffness] * 2), "mass": ([0.3], [mass] * 2)}
    numbers |= holding
    if isinstance(pipe.root, pp.RootSpring):
        numbers["root"] = pipe.root.stiffness
    expected = elements(numbers, 20.0, 4).roots(u).value
    expected = np.array(sorted(expected[expected.imag > 0], key=abs))
    found = pp.eigenvalues(pp.Continuum(pipe), u, count=2)
    found = found[found.imag > 0]
    assert found == pytest.approx(expected[: found.size], rel=1e-9)
    assert found.size >= 1
    beam = pp.eigenvalues(pp.Galerkin(pipe, 40), u, count=2)
    assert beam[beam.imag > 0][0] == pytest.approx(expected[0], rel=2e-3)


# ---------------------------------------------------------------------------------- any amplitude


def elastic_energy(model, q):
    """Of the joints, from their compliance by adaptive quadrature, or of the pipe's curvature."""
    if not isinstance(model, pp.Chain):
        s, weights = panels(STEPS)
        return 0.5 * np.sum(weights * model.pipe.stiffness(s) * (model.functions(s, 2) @ q) ** 2)
    turns = np.diff(q, prepend=0.0)
    if model.rule is None:
        return 0.5 * np.sum(model.springs * turns**2)
    ends = model.base + np.cumsum([0.0, *model.lengths])
    cells = np.append(0.0, ends[1:] - model.lengths / 2)
    if model.rule == "midpoint":
        cells = np.linspace(0.0, 1.0, model.dof + 1)
    soft = [
        quad(lambda s: 1.0 / stiffness(s), *cell, points=STEPS, epsabs=1e-14)[0]
        for cell in itertools.pairwise(cells)
    ]
    return 0.5 * np.sum(turns**2 / soft)


def kinks(model):
    joints = model.base + np.cumsum([0.0, *model.lengths]) if isinstance(model, pp.Chain) else ()
    return [*STEPS, *joints]


def gradient(function, at, model):
    return jacobian_by_differences(function, at, sizes_of(model))


@models
def test_inertia_weight_and_bending_do_the_virtual_work_of_what_varies(kind):
    """What is left of it is the flow's and the drag's, and those are a uniform pipe's."""
    varying, plain = (MODELS[kind](pipe) for pipe in (PIPE, UNIFORM))
    q, rate = state_of(varying)
    s, weights = panels(kinks(varying))

    def positions(at):
        return varying.shape(at, s)

    by_q = jacobian_by_differences(positions, q, sizes_of(varying))
    bias = second_derivative_along(positions, q, rate)

    def left(model, density, energy):
        force = model.rhs(0.0, np.concatenate([q, rate]), SPEED)[model.dof :]
        load = density * weights * (by_q @ force + bias - [0.0, PIPE.gamma]).T
        work = np.einsum("ck,kci->i", load, by_q)
        bending = gradient(energy, q, model) + PIPE.damping * gradient(energy, rate, model)
        return work + bending, np.abs(bending).max()

    if isinstance(plain, pp.Chain):

        def of_uniform(at):
            return 0.5 * np.sum(plain.springs * np.diff(at, prepend=0.0) ** 2)
    else:
        places, of = panels(STEPS)

        def of_uniform(at):
            return 0.5 * np.sum(of * (plain.functions(places, 2) @ at) ** 2)

    expected, _ = left(plain, 1.0, of_uniform)
    found, scale = left(varying, mass(s), lambda at: elastic_energy(varying, at))
    # Both have their own quadrature of the drag, whose integrand has kinks.
    assert np.abs(found - expected).max() < 1e-7 * scale


@models
def test_energy_is_that_of_what_varies_and_its_joints_lose_by_their_damping(kind):
    model = MODELS[kind](PIPE)
    q, rate = state_of(model)
    y = np.concatenate([q, rate])
    s, weights = panels(kinks(model))
    _, height = model.shape(q, s).T
    velocity = derivative_along(lambda at: model.shape(at, s), q, rate)
    density = mass(s) * (np.sum(velocity**2, axis=1) / 2 - PIPE.gamma * (height - s))
    expected = np.sum(weights * density) + elastic_energy(model, q)
    assert model.energy(y) == pytest.approx(expected, rel=1e-12)
    parts = model.power(y, SPEED)
    damped = -2.0 * PIPE.damping * elastic_energy(model, rate)
    assert parts.joints == pytest.approx(damped, rel=1e-9)


@models
def test_operators_are_the_derivatives_of_the_forces_at_rest(kind):
    model = MODELS[kind](dataclasses.replace(PIPE, drag=0.0))
    n = model.dof
    straight, (q, _) = np.zeros(n), state_of(model)
    elastic = model.elastic_operators()
    assert elastic.stiffness - PIPE.gamma * 0.0 == pytest.approx(elastic.stiffness.T, abs=1e-9)
    for at in (straight, q):

        def force(where, rates, at=at):
            inertia = model.operators(where).mass
            return inertia @ model.rhs(0.0, np.concatenate([where, rates]), SPEED)[n:]

        _, velocity, stiff = model.operators(at).at(SPEED)
        by_q = jacobian_by_differences(lambda x: force(x, straight), at, sizes_of(model))
        by_rate = jacobian_by_differences(lambda x, at=at: force(at, x), straight, sizes_of(model))
        assert np.abs(stiff + by_q).max() < 1e-9 * np.abs(stiff).max()
        assert np.abs(velocity + by_rate).max() < 1e-9 * np.abs(stiff).max()


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_bending_is_the_identity_in_elastic_coordinates(basis):
    weightless = dataclasses.replace(PIPE, gamma=0.0)
    for root, end in (("pinned", "free"), (pp.RootSpring(0.2), "pinned"), ("clamped", "guided")):
        held = dataclasses.replace(weightless, root=root, end=end)
        ops = pp.Galerkin(held, 14, basis).elastic_operators()
        share = pp.Galerkin(held, 14, basis).elastic_share
        assert np.abs(ops.stiffness - np.diag(share)).max() < 1e-12
        assert np.sum(share < 1.0 - 1e-12) <= 1
    model = pp.Galerkin(weightless, 14, basis)
    ops = model.elastic_operators()
    assert np.abs(ops.stiffness - np.eye(14)).max() < 1e-13
    assert np.abs(ops.damping - PIPE.damping * np.eye(14)).max() < 1e-13
    z = np.cos(np.arange(28.0)).reshape(14, 2)
    q = model.from_elastic(z)
    assert q.T @ model.operators().stiffness @ q == pytest.approx(z.T @ z, rel=1e-12)
    assert model.from_elastic(z[:, 0]) == pytest.approx(q[:, 0], rel=1e-15)


# ------------------------------------------------------------------------------ scenes and chains


def test_segments_have_the_mass_the_centre_and_the_inertia_of_their_stretch():
    chain = pp.Chain(PIPE, lengths=[0.25, 0.2, 0.15, 0.3], base=0.1)
    starts = 0.1 + np.cumsum([0.0, *chain.lengths[:-1]])
    for k, (start, length) in enumerate(zip(starts, chain.lengths, strict=True)):

        def moment(power, start=start, length=length):
            return quad(
                lambda s: mass(s) * (s - start) ** power, start, start + length,
                points=STEPS, epsabs=1e-14,
            )[0]  # fmt: skip

        whole, first, second = (moment(power) for power in range(3))
        assert chain.masses[k] == pytest.approx(whole, rel=1e-12)
        assert chain.centres[k] * length == pytest.approx(first / whole, rel=1e-12)
        radius = np.sqrt(second / whole - (first / whole) ** 2)
        assert chain.gyration_radii[k] == pytest.approx(radius, rel=1e-10)


def test_masses_of_the_users_own_are_the_segments():
    uniform = dataclasses.replace(PIPE, mass=None)
    inertia = {"masses": [0.4, 0.2, 0.5], "centres": [0.4] * 3, "gyration_radii": [0.1] * 3}
    ones, others = (pp.Chain(pipe, 3, **inertia) for pipe in (PIPE, uniform))
    assert ones.masses.tolist() == inertia["masses"]
    assert not ones.approximates_pipe
    y = np.concatenate(state_of(ones))
    assert ones.rhs(0.0, y, SPEED).tolist() == others.rhs(0.0, y, SPEED).tolist()
    light = {**inertia, "masses": [0.4, 0.05, 0.5]}
    with pytest.raises(ValueError, match=r"masses must be at least beta = 0\.3 times the length"):
        pp.Chain(PIPE, 3, **light)
    with pytest.raises(ValueError, match=r"given together or left.*got centres and gyration_radii"):
        pp.Chain(PIPE, 3, centres=[0.4] * 3, gyration_radii=[0.1] * 3)
    segments = [pp.modular.Segment(0.5), pp.modular.Segment(0.5)]
    parts = [pp.modular.Clamp(), pp.modular.Joint(2)]
    with pytest.raises(ValueError, match=r"mass of each Segment.*none of segment 1"):
        pp.modular.Assembly(PIPE, segments, parts)


def test_equal_springs_of_the_rules_follow_the_stiffness():
    pipe = pp.Pipe(0.2, **TAPER)
    exact = abs(pp.eigenvalues(pp.Continuum(pipe), 0.0, count=1)[0])
    chain = pp.Chain(pipe, 20, springs="frequency")
    assert np.abs(pp.eigenvalues(chain, 0.0, count=1)[0]) == pytest.approx(exact, rel=1e-10)
    uniform = pp.Chain(pipe, 20, springs="uniform")
    assert chain.springs / chain.springs[0] == pytest.approx(uniform.springs / uniform.springs[0])
    cells = [quad(lambda s: 1 / (1 - s / 2), k / 20, (k + 1) / 20)[0] for k in range(20)]
    assert uniform.springs == pytest.approx(1.0 / np.array(cells), rel=1e-12)
    paper = pp.Chain(pipe, 200, springs="rayleigh")
    assert np.abs(pp.eigenvalues(paper, 0.0, count=1)[0]) == pytest.approx(exact, rel=0.03)


# ---------------------------------------------------------------------------------- the quantities


def test_searches_and_curves_take_such_pipes():
    pipe = pp.Pipe(0.2, 5.0, damping=0.005, **TAPER)
    exact = pp.critical_speed(pp.Continuum(pipe)).speed
    reduced, chain = pp.Galerkin(pipe, 8, "legendre"), pp.Chain(pipe, 16)
    points = [pp.hopf(model) for model in (reduced, chain)]
    assert points[0].speed == pytest.approx(exact, rel=1e-6)
    assert points[0].criticality == points[1].criticality
    choice = pp.choose(pipe, "critical_speed", tolerance=1e-3)
    assert pp.critical_speed(choice.model).speed == pytest.approx(exact, rel=1.1e-3)


def test_hysteresis_is_kelvin_voigt_damping_of_equal_loss_at_the_crossing():
    for make in (pp.Continuum, lambda pipe: pp.Chain(pipe, 24)):
        lossy = pp.critical_speed(make(pp.Pipe(0.2, hysteresis=0.1, **TAPER)))
        damped = pp.critical_speed(make(pp.Pipe(0.2, damping=0.1 / lossy.frequency, **TAPER)))
        assert damped.speed == pytest.approx(lossy.speed, rel=1e-8)
        assert damped.frequency == pytest.approx(lossy.frequency, rel=1e-7)


# ------------------------------------------------------------------------------------ the profiles


def test_profiles_compare_hash_pickle_and_print():
    one, same = (pp.Pipe(0.2, stiffness=lambda s: 1 - s / 2) for _ in range(2))
    assert one == same
    assert hash(one) == hash(same)
    assert one != pp.Pipe(0.2)
    assert pickle.loads(pickle.dumps(one)) == one
    assert repr(one) == "Pipe(beta=0.2, stiffness=Profile(at=(), values=(<1 to 0.5>,)))"
    stepped = pp.Profile(at=[0.5], values=[1, 0.5])
    assert repr(stepped) == "Profile(at=(0.5,), values=(1, 0.5))"
    assert stepped([0.0, 0.49, 0.5, 1.0]).tolist() == [1.0, 1.0, 0.5, 0.5]
    assert pickle.loads(pickle.dumps(pp.Galerkin(one, 4))).pipe == one


def test_a_profile_of_1_is_a_uniform_pipe():
    assert pp.Pipe(0.2, stiffness=np.ones_like, mass=pp.Profile([0.3], [1.0, 1.0])) == pp.Pipe(0.2)


def test_profiles_have_the_values_of_the_function_and_find_its_jumps_and_kinks():
    s = np.linspace(0.0, 1.0, 777)
    hose = pp.Profile(values=lambda s: np.exp(-s) / (1 + 30 * (s - 0.4) ** 2) + 0.1)
    assert np.abs(hose(s) - (np.exp(-s) / (1 + 30 * (s - 0.4) ** 2) + 0.1)).max() < 1e-13
    found = pp.Profile(values=stiffness)
    assert found.at == (0.37,)
    assert np.abs(found(s) - stiffness(s)).max() < 1e-13
    table = np.array([0.0, 0.11, 0.35, 0.4, 0.83, 1.0]), np.array([1.0, 0.7, 0.9, 0.2, 0.4, 0.3])
    measured = pp.Profile(values=lambda s: np.interp(s, *table))
    assert measured.at == pytest.approx(table[0][1:-1], abs=1e-9)
    assert np.abs(measured(s) - np.interp(s, *table)).max() < 1e-9
    told = pp.Profile(at=table[0][1:-1], values=lambda s: np.interp(s, *table))
    assert told.at == tuple(table[0][1:-1])
    assert told(s) == pytest.approx(measured(s), abs=1e-9)
    ring = pp.Profile(values=lambda s: np.where(np.abs(s - 0.7) < 0.001, 3.0, 1.0))
    assert ring.at == pytest.approx((0.699, 0.701), abs=1e-12)


def test_profiles_from_si_are_those_of_the_pipe_without_its_fluid():
    hose = {"length": 0.6, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(
        **hose, stiffness_profile=lambda s: 1 - s / 2, mass_profile=pp.Profile([0.5], [1.0, 3.0])
    )
    share = 0.19 / 0.31
    assert pipe.scales == pp.Pipe.from_si(**hose).scales
    assert pipe.stiffness([1.0]) == pytest.approx([0.5])
    assert pipe.mass([0.2, 0.6]) == pytest.approx([1.0, 1.0 - share + 3.0 * share], rel=1e-15)
    wet = {"external_diameter": 0.01, "external_density": 1e3, "mass_profile": lambda s: 1.0 + s}
    assert pp.Pipe.from_si(**hose, **wet, gravity=0.0).gamma == 0.0
    with pytest.raises(ValueError, match="mass_profile must be None in a fluid that bears part"):
        pp.Pipe.from_si(**hose, **wet)  # its buoyancy would vary as its mass does


def test_bad_profiles_are_refused():
    def refused(error, match, **given):
        with pytest.raises(error, match=match):
            pp.Pipe(0.2, **given)

    refused(ValueError, r"mass\(s\) must have \d+ entries, got 3", mass=lambda s: np.ones(3))
    refused(ValueError, "stiffness must be 1 at s = 0, got 2", stiffness=lambda s: 2 - s)
    refused(ValueError, r"mass must be at least beta = 0\.2.*got 0\.1", mass=lambda s: 1 - 0.9 * s)
    refused(
        ValueError, "smooth but for a few places.*to s = 0$", stiffness=lambda s: 1 + np.sqrt(s)
    )
    for own in (lambda s: math.exp(-s), lambda s: 1.0 if s < 0.5 else 0.5):
        refused(TypeError, "stiffness must be a function of an array of arc", stiffness=own)
    with pytest.raises(TypeError, match="angle must be a function of an array of arc lengths"):
        pp.Chain(PIPE, 3).bent(lambda s: math.sin(s))
    rule = r"stiffness must be a function of arc length or a Profile, got .*make a Profile\(at,"
    refused(TypeError, rule, stiffness=[1, 0.5])
    rng = np.random.default_rng(1)
    refused(ValueError, "noise|smooth", stiffness=lambda s: 1 + 1e-3 * rng.random(s.size) * (s > 0))
    with pytest.raises(ValueError, match="at must ascend between 0 and 1"):
        pp.Profile([0.5, 0.4], [1, 1, 1])
    with pytest.raises(ValueError, match=r"values must be 2, one for each stretch.*, got 3"):
        pp.Profile([0.5], [1, 2, 3])
    with pytest.raises(ValueError, match="pipe must have the stiffness along it"):
        pp.Chain(PIPE, 3).with_pipe(UNIFORM)
