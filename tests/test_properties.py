# SPDX-License-Identifier: MIT
"""What holds for any pipe and model: answers that verify, or an exception of the package's own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from independent import derivative_along

import pipedyn as pp
from pipedyn import modular

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")  # also extreme ones

RULES = ["consistent", "midpoint", "uniform", "frequency", "rayleigh"]
SEEDS = st.integers(0, 2**32 - 1)


def mixed(edges, low, high):
    """Numbers of a range and, as often, those at the ends of what is accepted."""
    return st.sampled_from(edges) | st.floats(low, high).map(lambda x: float(f"{x:.6g}"))


SPEEDS = mixed([0.0, 1e-9, 30.0, 100.0], 0.0, 15.0)


def pipes(**given):
    """Pipes of the whole space of parameters, but for those given."""
    parameters = {
        "beta": mixed([0.0, 1e-12, 0.5, 0.999999], 0.0, 0.99),
        "gamma": mixed([-1e6, -1e4, 0.0, 1e4, 1e6], -50.0, 50.0),
        "flow": st.sampled_from(["ejecting", "aspirating"]),
        "alpha": mixed([0.0, 1.0, 1e3], 0.0, 2.0),
        "drag": mixed([0.0, 1e-9, 1e4], 0.0, 5.0),
        "damping": mixed([0.0, 1e-12, 1e-4, 1e3], 0.0, 0.1),
    }
    return st.builds(pp.Pipe, **{**parameters, **given})


def calm_pipes(**given):
    """Pipes whose forces are of the size of their stiffness."""
    return pipes(
        **{
            "gamma": mixed([0.0], -30.0, 30.0),
            "alpha": mixed([0.0, 1.0], 0.0, 2.0),
            "drag": mixed([0.0], 0.0, 5.0),
            "damping": mixed([0.0, 1e-4], 0.0, 0.05),
            **given,
        }
    )


@st.composite
def chains(draw, pipe, wild=True):
    """Equal segments by a rule, or segments, springs and inertia of one's own."""
    n = draw(st.integers(1, 7))
    if draw(st.booleans()):
        rule = draw(st.sampled_from(RULES))
        base = 0.0 if rule == "midpoint" else draw(st.sampled_from([0.0, 0.1, 0.9]))
        return pp.Chain(draw(pipe), n, springs=rule, base=base)
    dice = np.random.default_rng(draw(SEEDS))
    span = 6.0 if wild else 0.7
    lengths = 10.0 ** dice.uniform(-span, 0.0, n)
    base = dice.choice([0.0, 0.2])
    springs = n * 10.0 ** dice.uniform(-1.0, 8.0 if wild else 1.0, n)
    return pp.Chain(
        draw(pipe),
        lengths=lengths * (1.0 - base) / lengths.sum(),
        springs=springs * dice.choice([0.0, 1.0], n, p=[0.05, 0.95]),
        centres=dice.uniform(0.0, 1.0, n),
        gyration_radii=dice.uniform(0.1, 1.0, n) / n,
        drag_points=dice.uniform(0.0, 1.0, n),
        base=base,
    )


HELD = st.builds(
    lambda at, mass, stiffness: (pp.PointMass(at, mass), pp.Spring(at, stiffness)),
    mixed([1.0, 0.5], 0.01, 1.0),
    mixed([1e-6, 1.0, 10.0], 0.001, 1.0),
    mixed([0.0, 1e4], 0.0, 50.0),
)


def reduced(pipe):
    """Either basis, with terms or without."""
    return st.builds(
        pp.Galerkin,
        st.builds(
            lambda pipe, held: replace(pipe, terms=[term for terms in held for term in terms]),
            pipe,
            st.just(()) | st.lists(HELD, max_size=2),
        ),
        st.integers(3, 8),
        st.sampled_from(["beam", "legendre"]),
    )


@st.composite
def scenes(draw, pipe):
    """Chains from parts, with further parts."""
    n = draw(st.integers(2, 5))
    scene = modular.chain(draw(pipe), n, springs=draw(st.sampled_from(RULES)))
    node = st.integers(1, n)
    place = mixed([1.0, 1.0 / n], 0.01, 1.0)
    size = mixed([0.0], 0.0, 3.0)
    more = draw(
        st.lists(
            st.one_of(
                st.builds(pp.PointMass, place, size),
                st.builds(pp.Spring, place, size),
                st.builds(pp.Damper, place, size),
                st.builds(modular.TorsionalSpring, node, size, size),
            ),
            max_size=2,
        )
    )
    return scene.plus(*more)


def models(pipe, wild=True):
    return st.one_of(chains(pipe, wild), reduced(pipe), scenes(pipe))


def bend(dice, size):
    """An angle theta(s) in three modes, the largest of about the size, rad."""
    parts = size * dice.uniform(-1.0, 1.0, 3)
    return lambda s: parts @ np.sin(np.array([1.0, 3.0, 5.0])[:, None] * (0.5 * math.pi * s))


def state(model, dice, size=1.0, rate=3.0):
    """A state [q, q'] of a bent pipe in motion."""
    q, p = model.bent(bend(dice, size)), model.bent(bend(dice, rate))
    if isinstance(model, modular.Assembly):
        return model.state(model.angles(q), model.angles(p))
    return np.concatenate([q, p])


def norm(matrix):
    return np.abs(matrix).sum(axis=1).max()


# ---------------------------------------------------------------------------------- linear motion


def all_roots(model, u):
    """Eigenvalues with those that fail the check of their residual, sorted by |lambda|."""
    upper = pp.modes(model, u).eigenvalues
    roots = np.concatenate([upper, upper[upper.imag > 0.0].conj()])
    return roots[np.argsort(np.abs(roots), kind="stable")]


@settings(max_examples=60)
@given(models(pipes()), SPEEDS)
def test_every_mode_solves_the_operators(model, u):
    """M, C and K in the user's coordinates share nothing with the pencil that was solved."""
    found = pp.modes(model, u)
    assert model.dof <= found.eigenvalues.size <= 2 * model.dof
    mass, velocity, stiffness = model.operators().at(u)
    for value, shape, good in zip(found.eigenvalues, found.shapes, found.converged, strict=True):
        if not good:
            continue
        q = shape.coordinates
        missed = (value**2 * mass + value * velocity + stiffness) @ q
        size = (1.0 + abs(value) ** 2) * norm(mass) + abs(value) * norm(velocity) + norm(stiffness)
        assert np.abs(missed).max() <= 1e-5 * size * np.abs(q).max()
        assert np.isfinite(shape([0.0, 0.5, 1.0])).all()


@settings(max_examples=8)
@given(models(pipes()), st.lists(SPEEDS, min_size=1, max_size=3, unique=True), st.integers(1, 3))
def test_every_branch_is_made_of_eigenvalues(model, speeds, count):
    speeds = sorted(speeds)
    assume(min(np.diff(speeds), default=1.0) > 0.0)
    loci = pp.root_loci(model, speeds, min(count, model.dof))
    for u, row, partners, good in zip(
        speeds, loci.eigenvalues, loci.partners, loci.converged, strict=True
    ):
        whole = all_roots(model, u)
        for value in (*row[good], *partners[good]):
            assert np.abs(whole - value).min() <= 1e-5 * (1.0 + abs(value))


@settings(max_examples=40)
@given(models(pipes()), SEEDS)
def test_the_flow_is_skew_but_for_what_leaves_at_the_end(model, seed):
    """About any configuration; about the straight pipe one motion of the end carries all of it."""
    bent = model.bent(bend(np.random.default_rng(seed), 2.0))
    for q, rank in ((None, 1), (bent, 2)):
        ops = model.operators(q)
        np.testing.assert_array_equal(ops.gyroscopic, -ops.gyroscopic.T)
        np.testing.assert_array_equal(ops.end_flux, ops.end_flux.T)
        values = np.sort(np.linalg.eigvalsh(ops.end_flux))[::-1]
        rounding = 1e-13 * values[0]
        assert (values >= -rounding).all()
        assert (np.abs(values[rank:]) <= rounding).all()
        assert (values[0] > 0.0) == (model.pipe.beta > 0.0)


# -------------------------------------------------------------------------------------- any motion


@settings(max_examples=60)
@given(models(pipes()), SPEEDS, SEEDS, mixed([0.0, 20.0], 0.0, 3.0))
def test_energy_changes_by_the_power_of_what_acts(model, u, seed, size):
    y = state(model, np.random.default_rng(seed), size)
    rates, power = model.rhs(0.0, y, u), model.power(y, u)
    assert np.isfinite(rates).all()
    still = np.concatenate([y[: y.size // 2], 0.0 * y[y.size // 2 :]])
    way, fast = rates / np.abs(rates).max(), np.abs(rates).max()
    change = fast * derivative_along(model.energy, y, way, 1e-3)
    parts = [power.flow, power.joints, power.drag, power.others]
    sizes = max(map(abs, [*parts, fast * (model.energy(y) - model.energy(still))]))
    largest = 1.0 + abs(model.pipe.gamma) + abs(model.energy(y))  # of what the energy sums
    assert abs(change - power.total) <= 1e-6 * sizes + 1e-11 * fast * largest
    assert power.joints <= 0.0
    assert power.drag <= 0.0 if model.pipe.drag else power.drag == 0.0
    assert power.flow == 0.0 or u > 0.0
    assert power.total == pytest.approx(sum(parts), rel=1e-12, abs=1e-14 * sizes)
    if not model.pipe.terms and not isinstance(model, modular.Assembly):
        assert power.others == 0.0
        assert power.joints == 0.0 or model.pipe.damping


@settings(max_examples=60)
@given(models(calm_pipes()), mixed([0.0], 0.0, 10.0), SEEDS)
def test_the_jacobian_is_the_derivative_of_the_rates(model, u, seed):
    dice = np.random.default_rng(seed)
    y, way = state(model, dice), state(model, dice)
    jacobian = model.jacobian(0.0, y, u)
    change = derivative_along(lambda y: model.rhs(0.0, y, u), y, way, 1e-3)
    size = np.abs(model.rhs(0.0, y, u)).max() + norm(jacobian) * np.abs(way).max()
    expected = jacobian @ way
    assert np.abs(change - expected).max() <= 1e-6 * size


@settings(max_examples=40)
@given(models(pipes()), SPEEDS, SEEDS)
def test_the_mirror_image_moves_as_the_mirror_image(model, u, seed):
    y = state(model, np.random.default_rng(seed))
    flip = np.full(y.size, -1.0)
    if isinstance(model, modular.Assembly):
        flip[1::3] = 1.0  # what is down stays down
    rates = model.rhs(0.0, y, u)
    np.testing.assert_allclose(model.rhs(0.0, flip * y, u), flip * rates, rtol=1e-12, atol=0.0)


@settings(max_examples=40)
@given(models(pipes(flow=st.just("aspirating"), alpha=st.just(1.0))), SPEEDS, SEEDS)
def test_aspirating_with_full_inlet_is_ejecting_the_other_way(model, u, seed):
    """Turned back in time, with damping and drag left out, the one motion is the other."""
    pipe = model.pipe
    drawn, blown = (pp.Pipe(pipe.beta, pipe.gamma, flow) for flow in ("aspirating", "ejecting"))
    y = state(model, np.random.default_rng(seed))
    assume(not model.resisted)
    back = np.repeat([1.0, -1.0], y.size // 2)
    forward = model.with_pipe(drawn).rhs(0.0, y, u)
    reversed_ = model.with_pipe(blown).rhs(0.0, back * y, u)
    size = np.abs(forward).max()
    np.testing.assert_allclose(reversed_, -back * forward, rtol=0.0, atol=1e-11 * size)


@settings(max_examples=40)
@given(models(calm_pipes(), wild=False), mixed([0.0], 0.0, 10.0), SEEDS)
def test_a_short_motion_keeps_its_balance_of_energy(model, u, seed):
    dice = np.random.default_rng(seed)
    start = model.bent(bend(dice, 0.5))
    try:
        motion = pp.simulate(model, u, 0.05, start, samples=5, rtol=1e-8)
    except pp.MotionStopped:
        return
    assert motion.audit < 1e-4
    assert np.isfinite(motion.y).all()
    assert np.isfinite(motion.energy).all()
    np.testing.assert_allclose(motion.q[0], start, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*motion.tip.T), 0.5, atol=0.5 + 1e-9)  # not beyond L


# ------------------------------------------------------------------------------------ what is found


@settings(max_examples=6)
@given(models(calm_pipes(), wild=False), mixed([0.0], 0.0, 8.0))
def test_every_equilibrium_stays_at_rest(model, u):
    try:
        found = pp.equilibria(model, u)
    except pp.PipedynError:
        return
    for q, growth, stable in zip(found.q, found.growth, found.stable, strict=True):
        rates = model.rhs(0.0, np.concatenate([q, 0.0 * q]), u)
        stiff = norm(model.jacobian(0.0, np.concatenate([q, 0.0 * q]), u))
        assert np.abs(rates).max() <= 1e-7 * stiff
        assert math.isfinite(growth)
        assert not (stable and growth > 1e-3 * stiff)


@settings(max_examples=12)
@given(
    chains(calm_pipes(damping=mixed([0.0], 1e-4, 0.02)), wild=False)
    | reduced(calm_pipes(damping=mixed([0.0], 1e-4, 0.02)))
)
def test_an_onset_has_a_pair_on_the_axis_and_a_law(model):
    try:
        onset = pp.hopf(model)
    except pp.PipedynError:
        return
    whole = all_roots(model, onset.speed)
    assert np.abs(whole - 1j * onset.frequency).min() <= 1e-5 * (1.0 + onset.frequency)
    step = 1e-5 * onset.speed
    ahead, behind = (all_roots(model, onset.speed + sign * step) for sign in (1.0, -1.0))
    near = [values[np.abs(values - 1j * onset.frequency).argmin()] for values in (ahead, behind)]
    slope = (near[0] - near[1]) / (2.0 * step)
    assert abs(slope - complex(onset.growth, onset.detuning)) <= 1e-2 * abs(slope)
    assert math.isfinite(onset.amplitude_law)


@settings(max_examples=6)
@given(
    st.builds(pp.Chain, calm_pipes(beta=st.floats(0.1, 0.6), flow=st.just("ejecting")), st.just(3)),
    st.floats(1.02, 1.2),
)
def test_a_cycle_comes_round(model, beyond):
    try:
        critical = pp.critical_speed(model, 30.0)
        cycle = pp.limit_cycle(model, max(beyond * critical.speed, 0.1), samples=17)
    except pp.PipedynError:
        return
    motion = pp.simulate(model, cycle.u, cycle.period, cycle.q[0], cycle.qdot[0], rtol=1e-10)
    worst = max(1.0, float(np.abs(cycle.multipliers).max()))
    miss = np.abs(motion.q[-1] - cycle.q[0]).max()
    assert miss <= worst * (1e-4 + 10.0 * cycle.error) * np.abs(cycle.q).max()


# --------------------------------------------------------------------------------------------- SI


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
@settings(max_examples=40)
@example(1.2, 0.3, 0.2, 0.1, 9.0, 1.0, 0.01, 0.5, 1e-3, 1e-3, 1.0, 1.0)  # in millimetres
@given(
    *[st.floats(0.01, 100.0)] * 4,
    st.floats(-50.0, 50.0, allow_subnormal=False),  # which hold no twelve digits
    *[st.floats(1e-3, 1.0)] * 4,
    *[st.floats(0.1, 10.0)] * 3,
)
def test_one_pipe_has_one_set_of_numbers_in_any_units(
    length, stiffness, pipe_mass, fluid_mass, gravity, drag, diameter, density, damping, m, kg, s
):
    """The same quantities counted in units that are m metres, kg kilograms and s seconds long."""
    metres = {
        "length": length,
        "bending_stiffness": stiffness,
        "pipe_mass": pipe_mass,
        "fluid_mass": fluid_mass,
        "gravity": gravity * stiffness / (length**3 * (pipe_mass + fluid_mass)),
        "drag_coefficient": drag,
        "external_diameter": diameter,
        "external_density": density,
        "damping_time": damping,
    }
    units = {
        "length": m,
        "bending_stiffness": kg * m**3 / s**2,
        "pipe_mass": kg / m,
        "fluid_mass": kg / m,
        "gravity": m / s**2,
        "drag_coefficient": 1.0,
        "external_diameter": m,
        "external_density": kg / m**3,
        "damping_time": s,
    }
    one = pp.Pipe.from_si(**metres)
    other = pp.Pipe.from_si(**{name: value / units[name] for name, value in metres.items()})
    lifted = density * math.pi * diameter**2 / 4.0 / (pipe_mass + fluid_mass)
    sizes = {"gamma": abs(gravity) * max(1.0, lifted)}  # a difference of these
    for name in ("beta", "gamma", "drag", "damping"):
        near = 1e-12 * max(abs(getattr(one, name)), sizes.get(name, 0.0))
        assert math.isclose(getattr(one, name), getattr(other, name), rel_tol=0.0, abs_tol=near)
    near = 1e-12 * sizes["gamma"]
    assert math.isclose(one.gamma, gravity * (1.0 - lifted), rel_tol=0.0, abs_tol=near)
    for method, unit in (("speed", m / s), ("time", s), ("frequency", 1.0 / s), ("length", m)):
        converted = getattr(one, f"{method}_si")(2.5)
        assert math.isclose(converted, unit * getattr(other, f"{method}_si")(2.5), rel_tol=1e-12)
        assert math.isclose(getattr(one, f"{method}_from_si")(converted), 2.5, rel_tol=1e-12)
