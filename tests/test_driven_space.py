# SPDX-License-Identifier: MIT
"""Forces, shaken bases and forced motions in three dimensions.

Forces are held against virtual work and a moving base, responses against motions in time, and
forced motions against those of the planar model, of simulations and of Mathieu's equation.
"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
import scipy.special
from independent import derivative_along
from test_applied_force import assert_states_of_a_batch_have_own_forces, driven

import pipedyn as pp
from pipedyn.attraction.motion_ends import Case
from pipedyn.linear.rest import at_rest
from pipedyn.models.space import nearest_plane
from pipedyn.motion.vector_field import Excitation, ForcedField

PIPE = pp.Pipe(0.3, 7.0, damping=0.02, drag=0.4, terms=[pp.Spring(0.6, 5.0)])
MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 4, dimensions=3),
    "unequal chain": lambda pipe: pp.Chain(
        pipe, lengths=[0.3, 0.2, 0.4], springs=[4.0, 3.0, 2.0], base=0.1, dimensions=3
    ),
    "beam": lambda pipe: pp.Galerkin(pipe, 4, dimensions=3),
    "legendre": lambda pipe: pp.Galerkin(pipe, 4, "legendre", dimensions=3),
}
models = pytest.mark.parametrize("kind", MODELS)
two_models = pytest.mark.parametrize("kind", ["chain", "legendre"])


def swirl(s, t):
    """A wave along the pipe with all components."""
    return np.stack([np.cos(3.0 * s - 2.0 * t), 0.5 + s * math.sin(t), s**2 - t], axis=-1)


FORCES = {
    "at the end": pp.Force(lambda t: (1.0 + t, -0.5 * t, 0.7), at=1.0),
    "inside": pp.Force(lambda t: (math.cos(t), 0.3, math.sin(t)), at=0.63),
    "along": pp.Force(swirl, amplitude=3.0),
    "along x": pp.Force(lambda s, t: 2.0 * math.cos(t)),
}
forces = pytest.mark.parametrize("name", FORCES)


def state_of(model):
    random = np.random.default_rng(5)
    q = model.bent(lambda s: 0.8 * np.sin(2.0 * s), lambda s: -0.5 * s)
    q = q + 0.1 * np.abs(q).max() * random.normal(size=q.size)
    return np.concatenate([q, 0.5 * np.abs(q).max() * random.normal(size=q.size)])


def virtual_work(model, force, q, t):
    """Generalised force by displacements of what `shape` draws, whose slopes are differences."""
    if force.at is not None:
        places, weights = np.array([force.at]), np.ones(1)
    else:
        ends, count = np.array([0.0, 0.6, 1.0]), 20  # joints of functions between them
        if isinstance(model.planar, pp.Chain):  # two points of each segment, as laws all along have
            lengths, count = model.planar.lengths, 2
            ends = model.planar.base + np.concatenate([[0.0], np.cumsum(lengths)])
        nodes, weights = np.polynomial.legendre.leggauss(count)
        half = 0.5 * np.diff(ends)[:, None]
        places = (ends[:-1, None] + half * (1.0 + nodes)).ravel()
        weights = (half * weights).ravel()
    loads = weights[:, None] * force.components(places, t, 3)
    slopes = [
        derivative_along(lambda x: model.shape(x, places), q, one, 2e-3) for one in np.eye(q.size)
    ]
    return np.array([(slope * loads).sum() for slope in slopes])


def in_space(model, applied, t):
    """The model with the forces and their drive at a time."""
    return driven(model, applied, t, 3)


@forces
@models
def test_accelerations_and_power_by_a_force_are_those_of_its_virtual_work(kind, name):
    model, force, t = MODELS[kind](PIPE), FORCES[name], 0.7
    y, half = state_of(model), model.dof
    forced, drive = in_space(model, [force], t)
    with_work = np.append(y, 0.0)
    change = forced.motion_rates(with_work, 2.0, drive) - model.motion_rates(with_work, 2.0)

    def kinetic(rates):  # quadratic in the rates
        moving = np.concatenate([y[:half], rates])
        return model.energy(moving) - model.energy(np.concatenate([y[:half], 0.0 * rates]))

    unit = np.eye(half)
    mass = np.array([[kinetic(a + b) - kinetic(a) - kinetic(b) for a in unit] for b in unit])
    expected = virtual_work(model, force, y[:half], t)
    np.testing.assert_allclose(mass @ change[half:-1], expected, rtol=1e-6, atol=1e-7)
    assert change[-1] == pytest.approx(expected @ y[half:], rel=1e-6)


@forces
@models
def test_derivatives_and_batches_of_forces_are_right(kind, name):
    model = MODELS[kind](PIPE)
    forced, drive = in_space(model, [FORCES[name], FORCES["inside"]], 0.4)
    y = state_of(model)
    size = np.abs(y).max()
    found = forced.motion_jacobian(y, 2.0, drive)
    columns = [
        derivative_along(lambda x: forced.motion_rates(x, 2.0, drive), y, size * one, 1e-3) / size
        for one in np.eye(y.size)
    ]
    largest = np.abs(found).max()
    np.testing.assert_allclose(found, np.stack(columns, axis=1), atol=1e-6 * largest)
    assert_states_of_a_batch_have_own_forces(forced, y, drive)


@pytest.mark.parametrize("turn", [1.0, 1j])
def test_the_nearest_plane_is_that_of_the_largest_singular_value(turn):
    random = np.random.default_rng(2)
    x, z = random.normal(size=(2, 6, 5)) + (turn.imag * 1j) * random.normal(size=(2, 6, 5))
    for azimuth, a, b in zip(nearest_plane(x, z), x, z, strict=True):
        rows = np.stack([np.append(a.real, a.imag), np.append(b.real, b.imag)])
        way = np.linalg.svd(rows)[0][:, 0]
        assert abs(way @ (math.cos(azimuth), math.sin(azimuth))) == pytest.approx(1.0)
    assert nearest_plane(np.zeros(2), np.array([0.0, 3.0])) == pytest.approx(math.pi / 2.0)


DIRECTIONS = {"z": "z", "y": "y", "oblique": (1.0, -0.5, 2.0), "circle": (1.0, 0.0, -1j)}


@pytest.mark.parametrize("direction", DIRECTIONS.values(), ids=DIRECTIONS)
@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:DOP853"])
@two_models
def test_a_uniform_force_moves_the_pipe_as_a_base_does(kind, method, direction):
    """In the frame of the base all mass feels -R'': so it is without drag, and all on the base."""
    model = MODELS[kind](pp.Pipe(0.3, 7.0, damping=0.02))
    base = pp.Harmonic(0.05, 6.0, direction)

    def pushing(s, t):
        place = np.zeros(3)
        place[: len(base(t))] = base(t)
        return np.tile(36.0 * place, (len(s), 1))

    start = model.bent(lambda s: 0.3 * s, lambda s: 0.1 * s)
    options = {"method": method, "rtol": 1e-9, "times": [0.5, 1.0, 2.0]}
    moved = pp.simulate(model, 3.0, 2.0, start, base=base, **options)
    pushed = pp.simulate(model, 3.0, 2.0, start, force=pp.Force(pushing), **options)
    np.testing.assert_allclose(pushed.tip, moved.tip, atol=1e-7)
    still = pp.simulate(model, 3.0, 2.0, start, **options)
    assert np.abs(moved.tip - still.tip).max() > 1e-3
    assert pushed.audit < 1e-7
    assert moved.audit < 1e-7


@forces
@models
def test_the_energy_of_a_forced_motion_is_the_work_done_on_it(kind, name):
    motion = pp.simulate(MODELS[kind](PIPE), 2.0, 2.0, force=FORCES[name], rtol=1e-9)
    assert motion.audit < 1e-5
    assert motion.tip.shape[1] == 3


def test_a_force_along_x_moves_the_pipe_in_space_as_in_the_plane():
    model, push = MODELS["chain"](PIPE), FORCES["along x"]
    start, none = 0.1 * np.arange(1.0, 5.0), np.zeros(4)
    whole = pp.simulate(model, 2.0, 1.0, np.append(start, none), force=push, samples=5)
    plane = pp.simulate(model.planar, 2.0, 1.0, start, force=push, samples=5)
    np.testing.assert_allclose(whole.tip[:, :2], plane.tip, atol=1e-12)
    assert not whole.tip[:, 2].any()


def test_members_of_an_ensemble_feel_the_same_force_and_base():
    model, base = MODELS["chain"](PIPE), pp.Harmonic(0.02, 5.0, (1.0, 0.0, 1j))
    given = {"force": [FORCES["along"], FORCES["inside"]], "base": base, "samples": 5}
    speeds = [1.0, 2.0, 2.0]
    many = pp.simulate_many(model, speeds, 1.0, **given)
    for u, one in zip(speeds, many.motions, strict=True):
        alone = pp.simulate(model, u, 1.0, **given)
        np.testing.assert_allclose(one.tip, alone.tip, atol=1e-9)


def test_a_force_with_three_components_may_be_in_si():
    numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
    pipe = pp.Pipe.from_si(length=2.0, **numbers)
    model = pp.Chain(pipe, 3, dimensions=3)
    scales = pipe.scales
    newton = scales.mass * scales.length**2 / scales.time**2
    of_si = pp.Force.from_si(pipe, lambda t: (newton, 0.0, 2.0 * newton * t / scales.time), at=2.0)
    plain = pp.Force(lambda t: (1.0, 0.0, 2.0 * t), at=1.0)
    found, expected = (
        pp.simulate(model, 1.0, 1.0, force=one, samples=5).tip for one in (of_si, plain)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


# ------------------------------------------------------------------------------- shaken bases


def test_a_harmonic_base_has_its_derivatives_and_its_farthest_distance():
    for direction in ("x", "y", "z", (3.0, 0.0, 4.0), (1.0, 0.0, -1j), (1.0 + 0.5j, 0.2, -1j)):
        base, h = pp.Harmonic(0.2, 3.0, direction), 1e-5
        t = np.linspace(0.0, 2.0 * math.pi / 3.0, 10_001)
        places = np.array([base(one) for one in t])
        assert np.linalg.norm(places, axis=1).max() == pytest.approx(0.2, rel=1e-6)
        for of, rate in ((base, base.velocity), (base.velocity, base.acceleration)):
            change = np.subtract(of(0.3 + h), of(0.3 - h)) / (2.0 * h)
            np.testing.assert_allclose(rate(0.3), change, atol=1e-8)
        assert pickle.loads(pickle.dumps(base)) == base
    turning = pp.Harmonic(1.0, 2.0, (1.0, 0.0, -1j))  # from x to z
    np.testing.assert_allclose(turning(math.pi / 4.0), (0.0, 0.0, 1.0), atol=1e-15)


def test_a_planar_pipe_may_be_shaken_obliquely():
    model = pp.Chain(PIPE, 4)
    oblique = pp.Harmonic(0.05, 4.0, (0.6, 0.8, 0.0))

    def same(t):
        return 0.03 * math.cos(4.0 * t), 0.04 * math.cos(4.0 * t)

    found, expected = (
        pp.simulate(model, 2.0, 1.0, base=base, samples=5, rtol=1e-9).tip
        for base in (oblique, same)
    )
    np.testing.assert_allclose(found, expected, atol=1e-6)


# --------------------------------------------------------------------------- linear responses

BENT = pp.Pipe(0.2, 10.0, damping=0.05, inclination=1.2)
BENT_MODELS = {
    "chain": pp.Chain(BENT, 6, dimensions=3),
    "legendre": pp.Galerkin(BENT, 5, "legendre", dimensions=3),
}


@pytest.mark.parametrize("given", ["base", ("force", 0.6)])
@pytest.mark.parametrize("direction", ["x", "z"])
@pytest.mark.parametrize("model", BENT_MODELS.values(), ids=BENT_MODELS)
def test_small_forcing_moves_a_bent_pipe_by_its_frequency_response(model, direction, given):
    u, omega, size, component = 2.0, 3.0, 1e-5, "xyz".index(direction)
    response = pp.frequency_response(model, u, [omega], input=given, direction=direction)
    assert response.direction == direction
    if given == "base":
        driving = {"base": pp.Harmonic(size, omega, direction)}
    else:
        along = np.eye(3)[component]
        driving = {"force": pp.Force(lambda t: size * math.cos(omega * t) * along, at=given[1])}
    start = at_rest(model, u).resting()
    motion = pp.simulate(model, u, 50.0, start, **driving, rtol=1e-9, atol=1e-14)
    late = motion.t > 40.0
    moved = motion.tip[late, component] - model.tip(start)[component]
    expected = size * (response.response[0] * np.exp(1j * omega * motion.t[late])).real
    np.testing.assert_allclose(moved, expected, atol=2e-4 * np.abs(expected).max())


def test_a_straight_pipe_responds_alike_along_x_and_z_and_a_bent_one_does_not():
    straight = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.05), 5, dimensions=3)
    answers = [
        pp.frequency_response(straight, 2.0, [3.0, 7.0], direction=way).response for way in "xz"
    ]
    np.testing.assert_array_equal(*answers)
    plane = pp.frequency_response(straight.planar, 2.0, [3.0, 7.0]).response
    np.testing.assert_array_equal(answers[0], plane)
    assert not pp.frequency_response(straight, 2.0, [3.0], direction="y").response.any()
    bent = BENT_MODELS["chain"]
    x, y, z = (pp.frequency_response(bent, 2.0, [3.0], direction=way).response[0] for way in "xyz")
    assert abs(x - z) > 0.1 * abs(x)
    assert abs(y) > 0.1 * abs(x)
    plane = pp.frequency_response(bent.planar, 2.0, [3.0], input=("moment", 0.5)).response
    whole = pp.frequency_response(bent, 2.0, [3.0], input=("moment", 0.5)).response
    np.testing.assert_allclose(whole, plane, rtol=1e-9)


def test_a_moment_across_a_bent_pipe_does_the_work_of_a_pair_of_forces():
    model, h = pp.Galerkin(BENT, 6, "legendre", dimensions=3), 1e-4
    moment, *pair = (
        pp.frequency_response(model, 2.0, [4.0], input=given, direction="z").response[0]
        for given in (("moment", 0.5), ("force", 0.5 + h), ("force", 0.5 - h))
    )
    assert (pair[0] - pair[1]) / (2.0 * h) == pytest.approx(moment, rel=1e-4)


# ---------------------------------------------------------------------------- forced motions

SLACK = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.001), 3, dimensions=3)
NEAR = {"frequencies": (5.1, 5.21)}


@pytest.fixture(scope="module")
def whirling():
    return pp.forced_response(SLACK, 0.1, base=pp.Harmonic(0.01, 5.0), **NEAR)


def test_a_hose_shaken_in_a_plane_leaves_it_between_two_pitchforks(whirling):
    plane, away = whirling.branches
    assert (plane.kind, away.kind) == ("base", "out of plane")
    planar = pp.forced_response(SLACK.planar, 0.1, base=pp.Harmonic(0.01, 5.0), **NEAR)
    first, last = [event for event in plane.events if event.across]
    assert (first.kind, last.kind) == ("pitchfork", "pitchfork")
    assert not any(event.across for event in planar.branches[0].events)
    assert not plane.amplitude_across.any()
    between = (plane.frequency > first.frequency) & (plane.frequency < last.frequency)
    assert between.any()
    assert not plane.stable[between].any()
    assert planar.branches[0].stable.all()
    assert planar.branches[0].amplitude_across is None
    assert away.frequency[[0, -1]] == pytest.approx([first.frequency, last.frequency], rel=1e-9)
    assert away.amplitude_across[[0, -1]].tolist() == [0.0, 0.0]
    assert away.amplitude_across[1:-1].min() > 0.0
    assert whirling.failures == ()


def test_planar_motions_in_space_are_those_of_the_planar_model(whirling):
    planar = pp.forced_response(SLACK.planar, 0.1, base=pp.Harmonic(0.01, 5.0), **NEAR)
    flat, _ = whirling.at(5.15)
    (same,) = planar.at(5.15)
    np.testing.assert_allclose(flat.q[:, :3], same.q, atol=1e-7)
    assert not flat.q[:, 3:].any()
    assert flat.amplitude == pytest.approx(same.amplitude, rel=1e-6)
    kept = np.abs(flat.multipliers[:, None] - same.multipliers).min(axis=0)
    assert kept.max() < 1e-6
    assert (same.stable, flat.stable, same.across) == (True, False, None)


def test_multipliers_across_are_those_of_motions_pushed_out_of_the_plane(whirling):
    flat, _ = whirling.at(5.15)
    base, columns, h = pp.Harmonic(0.01, 5.15), [], 1e-6
    start = np.concatenate([flat.q[0], flat.qdot[0]])
    across = [*range(3, 6), *range(9, 12)]
    for k in across:
        pushed = start + h * np.eye(12)[k]
        motion = pp.simulate(
            *(SLACK, 0.1, flat.period, *np.split(pushed, 2)),
            **{"base": base, "rtol": 1e-11, "atol": 1e-14, "samples": 2},
        )
        columns.append(np.concatenate([motion.q[-1], motion.qdot[-1]])[across] / h)
    values = np.linalg.eigvals(np.array(columns).T)
    assert np.sort(np.abs(values)) == pytest.approx(np.sort(np.abs(flat.across)), abs=1e-5)
    assert np.abs(flat.across).max() > 1.01


def test_motions_end_on_the_whirl_where_the_plane_repels(whirling):
    flat, whirl = whirling.at(5.15)
    assert whirl.stable
    assert (flat.amplitude_across, whirl.across) == (0.0, None)
    pushed = flat.q[0] + 1e-3 * np.repeat([0.0, 1.0], 3)
    base = pp.Harmonic(0.01, 5.15)
    times = np.linspace(499.0, 500.0, 257) * whirl.period
    motion = pp.simulate(SLACK, 0.1, times[-1], pushed, flat.qdot[0], base=base, times=times)
    assert np.ptp(motion.tip[:, 2]) == pytest.approx(np.ptp(whirl.tip[:, 2]), rel=1e-3)
    assert np.ptp(motion.tip[:, 0]) == pytest.approx(np.ptp(whirl.tip[:, 0]), rel=1e-3)
    assert np.ptp(whirl.tip[:, 2]) > 0.1
    half = whirl.t.size // 2
    np.testing.assert_allclose(whirl.q[half], -whirl.q[0], atol=1e-8)


@pytest.mark.parametrize("direction", ["z", (3.0, 0.0, -4.0)])
def test_shaking_in_another_plane_turns_all_motions(whirling, direction):
    found = pp.forced_response(SLACK, 0.1, base=pp.Harmonic(0.01, 5.0, direction), **NEAR)
    x, _, z = (0.0, 0.0, 1.0) if direction == "z" else (0.6, 0.0, -0.8)
    for ours, theirs in zip(found.at(5.15), whirling.at(5.15), strict=True):
        turned = SLACK.turned(theirs.q.T, math.atan2(z, x)).T
        assert np.abs(ours.q - turned).max() < 1e-6
        assert ours.amplitude_across == pytest.approx(theirs.amplitude_across, rel=1e-6)


def test_a_force_across_has_the_motions_of_its_plane():
    def push(x, z):
        return pp.Force(
            lambda phase: (x * math.cos(phase), 0.1 * math.cos(2.0 * phase), z * math.cos(phase)),
            **{"at": 0.8, "frequency": 5.0, "amplitude": 0.05},
        )

    found, turned = (
        pp.forced_response(SLACK, 0.1, force=push(x, z), **NEAR).at(5.15)
        for x, z in ((1.0, 0.0), (0.6, 0.8))
    )
    for one, other in zip(found, turned, strict=True):
        expected = SLACK.turned(one.q.T, math.atan2(0.8, 0.6)).T
        np.testing.assert_allclose(other.q, expected, atol=1e-6)


def test_circular_shaking_has_a_motion_at_rest_in_the_turning_frame():
    base = pp.Harmonic(0.01, 4.6, (1.0, 0.0, -1j))
    (motion,) = pp.forced_response(SLACK, 0.1, base=base).at(4.6)
    radius = np.hypot(motion.tip[:, 0], motion.tip[:, 2])
    assert np.ptp(radius) < 1e-9
    assert np.ptp(motion.tip[:, 1]) < 1e-9
    assert motion.amplitude == pytest.approx(radius[0], rel=1e-6)
    assert motion.amplitude_across == pytest.approx(radius[0], rel=1e-6)
    # Centrifugal and other forces in the turning frame are balanced.
    turn = SLACK.quarter_turn
    rates = motion.qdot[0] - 4.6 * turn(motion.q[0])
    assert np.abs(rates).max() < 1e-7


@pytest.mark.parametrize("direction", ["x", "y", "z"])
def test_a_pipe_that_rests_bent_is_shaken_in_any_direction(direction):
    model = pp.Chain(replace(BENT, damping=0.01), 3, dimensions=3)
    base = pp.Harmonic(0.01, 5.0, direction)
    (motion,) = pp.forced_response(model, 1.0, base=base).at(5.0)
    again = pp.simulate(
        *(model, 1.0, motion.period, motion.q[0], motion.qdot[0]),
        **{"base": base, "rtol": 1e-10, "samples": motion.t.size},
    )
    np.testing.assert_allclose(again.q, motion.q, atol=1e-7)
    assert (motion.amplitude_across > 1e-6) == (direction == "z")
    assert (motion.across is None) == (direction == "z")


def test_forced_responses_in_space_are_kept_by_files(whirling, tmp_path):
    found = pp.forced_response(SLACK, 0.1, base=pp.Harmonic(0.01, 5.0, "z"), **NEAR)
    found.save(tmp_path / "found.npz")
    back = pp.load(tmp_path / "found.npz")
    for ours, theirs in zip(back.at(5.15), found.at(5.15), strict=True):
        np.testing.assert_array_equal(ours.q, theirs.q)
    assert "amplitude_across" in back.columns()


# ------------------------------------------------------------------- forcing along the axis


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_base_that_moves_along_a_rod_has_the_regions_of_mathieus_equation(dimensions):
    """A rod on a spring: I theta'' + (k + (gamma + A w^2 cos w t) / 2) theta = 0, I = 1/3."""
    rod = pp.Chain(pp.Pipe(0.2, 6.0), 1, springs=[2.0], dimensions=dimensions)
    size, stiffness, inertia = 0.04, 2.0 + 3.0, 1.0 / 3.0
    q = 0.5 * size / inertia * 2.0
    edges = [
        math.sqrt(4.0 * stiffness / (inertia * of(1, q)))
        for of in (scipy.special.mathieu_a, scipy.special.mathieu_b)
    ]
    natural = math.sqrt(stiffness / inertia)
    found = pp.forced_response(
        rod, 0.0, base=pp.Harmonic(size, 2.0 * natural, "y"), frequencies=(1.9 * natural, 8.0)
    )
    assert {branch.kind for branch in found.branches} == {"subharmonic"}
    rests = [
        branch.frequency[k]
        for branch in found.branches
        for k in (0, -1)
        if branch.amplitude[k] == 0.0
    ]
    for edge in rests:
        assert min(abs(edge - one) for one in edges) < 2e-4
    assert {int(np.argmin(np.abs(np.array(edges) - one))) for one in rests} == {0, 1}
    (motion, *_) = found.at(2.0 * natural)
    going = pp.simulate(
        *(rod, 0.0, motion.period, motion.q[0], motion.qdot[0]),
        **{"base": pp.Harmonic(size, 2.0 * natural, "y"), "rtol": 1e-10, "samples": 3},
    )
    np.testing.assert_allclose(going.q[-1], motion.q[0], atol=1e-7)


FLUTTERING = pp.Chain(pp.Pipe(0.1, 10.0, damping=0.001), 3, dimensions=3)


@pytest.fixture(scope="module")
def pulsed():
    onset = pp.critical_speed(FLUTTERING.planar)
    flow = pp.Pulsation(0.98 * onset.speed, 0.3, 2.0 * onset.frequency)
    return pp.forced_response(FLUTTERING, flow, frequencies=(30.0, 35.0))


def test_motions_in_a_pulsating_flow_come_in_circles(pulsed):
    """A turn about the axis is a multiplier 1, and any motion so turned is a motion."""
    for motion in pulsed.at(32.3):
        assert np.abs(motion.multipliers - 1.0).min() < 1e-6
        turned = FLUTTERING.turned(np.concatenate([motion.q[0], motion.qdot[0]]), 0.9)
        again = pp.simulate(
            *(FLUTTERING, motion.u, motion.period, *np.split(turned, 2)),
            **{"rtol": 1e-11, "atol": 1e-13, "samples": 2},
        )
        np.testing.assert_allclose(again.q[-1], turned[:6], atol=1e-6)


def test_motions_leave_their_plane_in_a_pulsating_flow(pulsed):
    away = next(branch for branch in pulsed.branches if branch.kind == "out of plane")
    assert away.failure is None
    # It joins the plane of x and a motion in the plane of z, from either of which it may be lost.
    assert away.amplitude_across[[0, -1]].tolist() == [0.0, 0.0]
    assert away.amplitude_across.max() > 0.03
    found = [motion for motion in pulsed.at(32.3) if motion.amplitude_across > 1e-3]
    assert found
    for motion in found:
        # With x -> -x half a period later it is the same motion, so that it does not precess.
        half = motion.t.size // 2
        image = np.concatenate([-motion.q[half, :3], motion.q[half, 3:]])
        np.testing.assert_allclose(image, motion.q[0], atol=1e-7)


def test_motions_that_would_precess_are_events_without_a_branch(pulsed):
    (harmonic,) = (branch for branch in pulsed.branches if branch.kind == "harmonic")
    assert [event.kind for event in harmonic.events if event.across] == ["pitchfork"]
    assert sum(branch.kind == "out of plane" for branch in pulsed.branches) == 1


def test_axial_forcing_is_recognised():
    for forcing, axial in (
        (pp.Pulsation(1.0, 0.2, 3.0), True),
        (pp.Harmonic(0.1, 3.0, "y"), True),
        (pp.Harmonic(0.1, 3.0, "z"), False),
        (pp.Force(lambda phase: (0.0, math.cos(phase), 0.0), 1.0, 3.0), True),
        (pp.Force(lambda s, phase: math.cos(phase), None, 3.0), False),
    ):
        assert ForcedField(SLACK, forcing, 1).axisymmetric == axial
        assert not ForcedField(SLACK.planar, pp.Pulsation(1.0, 0.2, 3.0), 1).axisymmetric


# ------------------------------------------------------------------------------ what is refused

CHAIN = pp.Chain(pp.Pipe(0.2, damping=0.01), 3, dimensions=3)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda: pp.simulate(CHAIN, 1.0, 1.0, force=pp.Force(lambda t: (1.0, 2.0), 1.0)),
            r"^force\(0\) must give finite numbers, one or of shape \(1,\) for x or \(3,\) for x, "
            r"y and z in three dimensions, got \(1\.0, 2\.0\)",
        ),
        (
            lambda: pp.simulate(CHAIN.planar, 1.0, 1.0, force=pp.Force(lambda t: (1, 2, 3), 1.0)),
            r"^force\(0\) must give .* for x or \(2,\) for x and y in a plane, got \(1, 2, 3\)",
        ),
        (
            lambda: pp.simulate(CHAIN.planar, 1.0, 1.0, base=pp.Harmonic(0.1, 3.0, "z")),
            r"^base must stay in the plane of x and y, in which the model moves, got direction='z'",
        ),
        (
            lambda: pp.forced_response(CHAIN.planar, 1.0, base=pp.Harmonic(0.1, 3.0, (1, 0, 1))),
            r"^base must stay in the plane of x and y",
        ),
        (
            lambda: pp.attractors(CHAIN.planar, 1.0, base=pp.Harmonic(0.1, 3.0, "z")),
            r"^base must stay in the plane of x and y",
        ),
        (lambda: pp.Harmonic(0.1, 3.0, "w"), r"^direction must be one of 'x', 'y', 'z', got 'w'"),
        (
            lambda: pp.Harmonic(0.1, 3.0, (1.0, 2.0)),
            r"^direction must be 'x', 'y', 'z' or three numbers \(x, y, z\), finite and not all 0",
        ),
        (lambda: pp.Harmonic(0.1, 3.0, (0.0, 0.0, 0.0)), r"^direction must be .* not all 0, got"),
        (lambda: pp.Harmonic(0.1, 3.0, (1.0, 0.0, math.nan)), r"^direction must be .* finite"),
        (
            lambda: pp.frequency_response(CHAIN.planar, 1.0, direction="z"),
            r"^direction must be 'x' or 'y' for a model that moves in a plane, got 'z'; take dim",
        ),
        (
            lambda: pp.frequency_response(CHAIN, 1.0, input=("force", 0.5), direction="y"),
            r"^direction must be 'x' or 'z' for a force or a moment, got 'y'",
        ),
        (
            lambda: pp.forced_response(
                CHAIN, 1.0, force=pp.Force(lambda phase: (0.0, math.cos(phase), 0.0), 1.0, 3.0)
            ),
            r"^force must act across the straight pipe, which a force along it leaves at rest",
        ),
        (
            lambda: pp.forced_response(CHAIN, 9.0, base=pp.Harmonic(0.1, 3.0, "y")),
            r"^u must be a speed at which the pipe is stable, got 9",
        ),
        (
            lambda: pp.forced_response(pp.Chain(CHAIN.pipe, 31, dimensions=3), 1.0),
            r"^model must have at most 60 degrees of freedom for forced_response, got 62",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(ask, message):
    with pytest.raises(ValueError, match=message):
        ask()


@pytest.mark.parametrize("direction", [3.0, None, [True, False, True], "xyz", {1: 2}])
def test_what_is_no_direction_is_refused(direction):
    with pytest.raises((TypeError, ValueError), match=r"^direction must be"):
        pp.Harmonic(0.1, 3.0, direction)


def test_springs_that_differ_in_x_and_z_have_regions_in_both_planes():
    """Shaken along its axis, the pipe swings along x or along z, at twice the frequency of each."""
    uneven = pp.Spring(1.0, 2.0, stiffness_across=8.0)
    model = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.005, terms=[uneven]), 2, dimensions=3)
    stiff = model.planar.with_pipe(replace(model.pipe, terms=[pp.Spring(1.0, 8.0)]))
    for plane, along, across in ((model.planar, 0, 2), (stiff, 2, 0)):
        frequency = 2.0 * pp.eigenvalues(plane, 0.1, 1)[0].imag
        base = pp.Harmonic(0.04, frequency, "y")
        motion = pp.forced_response(model, 0.1, base=base).at(frequency)[0]
        reach = np.ptp(motion.tip, axis=0)
        assert reach[along] == pytest.approx(2.0 * motion.amplitude, rel=1e-3)
        assert (motion.amplitude > 0.5, reach[across]) == (True, 0.0)
        again = pp.simulate(
            *(model, 0.1, motion.period, motion.q[0], motion.qdot[0]),
            **{"base": base, "rtol": 1e-10, "samples": 2},
        )
        np.testing.assert_allclose(again.q[-1], motion.q[0], atol=1e-7)


@pytest.mark.parametrize(("direction", "odd"), [("x", True), ((1.0, 0.0, -1j), False)])
def test_the_mirror_image_of_a_shaken_motion_in_space_is_at_the_same_time(direction, odd):
    chain = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.002), 2, dimensions=3)
    shaken = pp.Harmonic(0.05, 5.0, direction)
    case = Case(chain, Excitation(1.0, shaken))
    assert case.odd == odd
    signs, start = np.array([1.0, 1.0, -1.0, -1.0]), np.array([0.1, 0.2, 0.1, -0.1])
    one, other = (
        pp.simulate(chain, 1.0, 3.0, begin, base=shaken, rtol=1e-9)
        for begin in (start, signs * start)
    )
    assert np.allclose(signs * one.q, other.q, atol=1e-6) == odd


def unlike(along, across):
    """A pipe whose spring differs in x and z."""
    spring = pp.Spring(1.0, along, stiffness_across=across)
    return pp.Chain(pp.Pipe(0.2, 10.0, damping=0.001, terms=[spring]), 2, dimensions=3)


def motion_repeats(motion, base):
    """Whether a simulation comes back after the period of a forced motion."""
    again = pp.simulate(
        *(motion.model, motion.u, motion.period, motion.q[0], motion.qdot[0]),
        **{"base": base, "rtol": 1e-10, "atol": 1e-12, "samples": 2},
    )
    return np.abs(again.q[-1] - motion.q[0]).max() < 1e-6


def test_shaking_along_z_is_shaking_along_x_of_the_pipe_turned():
    near = {"frequencies": (5.0, 5.2)}
    found, turned = (
        pp.forced_response(model, 0.1, base=pp.Harmonic(0.01, 5.0, way), **near)
        for model, way in ((unlike(0.3, 0.2), "x"), (unlike(0.2, 0.3), "z"))
    )
    assert [one.kind for one in turned.branches] == ["base", "out of plane"]
    for one, other in zip(found.branches, turned.branches, strict=True):
        for first, second in zip(one.events, other.events, strict=True):
            assert (first.kind, first.across) == (second.kind, second.across)
            assert first.frequency == pytest.approx(second.frequency, rel=1e-6)
    ours, theirs = found.at(5.1), turned.at(5.1)
    assert len(ours) == len(theirs) == 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.amplitude == pytest.approx(other.amplitude, rel=1e-6)
        assert one.stable == other.stable
        assert (one.across is None) == (other.across is None)
        np.testing.assert_allclose(np.abs(one.q[:, :2]), np.abs(other.q[:, 2:]), atol=1e-5)
        assert motion_repeats(other, pp.Harmonic(0.01, 5.1, "z"))


def test_motions_leave_either_plane_of_an_uneven_pipe_shaken_along_its_axis_and_join_the_other():
    model = unlike(0.3, 0.2)
    w = 2.0 * pp.eigenvalues(model.planar, 0.1, 1)[0].imag
    base = pp.Harmonic(0.025, w, "y")
    found = pp.forced_response(model, 0.1, base=base, frequencies=(0.95 * w, 1.05 * w))
    assert not found.failures
    leaving = [
        event.frequency
        for branch in found.branches
        if branch.kind == "subharmonic"
        for event in branch.events
        if event.across
    ]
    away = [branch for branch in found.branches if branch.kind == "out of plane"]
    assert len(away) >= 4
    met = [branch.frequency[-1] for branch in away if branch.amplitude_across[-1] == 0.0]
    assert len(met) >= 2
    assert max(min(abs(one - event) for event in leaving) for one in met) < 1e-3
    begun = [min(leaving, key=lambda event: abs(event - one.frequency[0])) for one in away]
    assert len(set(begun)) == len(begun)  # none is followed from both of its ends
    there = found.at(9.1)
    assert any(motion.amplitude_across > 0.05 for motion in there)
    for motion in there:
        assert motion_repeats(motion, replace(base, frequency=9.1))


def test_motions_in_no_plane_have_offshoots_of_twice_their_period():
    """Oblique shaking at twice the frequency of small motions across the plane of sag."""
    model = pp.Chain(pp.Pipe(0.2, 10.0, inclination=1.2, damping=0.001), 2, dimensions=3)
    base = pp.Harmonic(0.05, 9.5, (1.0, 0.0, 0.1))
    found = pp.forced_response(model, 0.1, base=base, frequencies=(9.3, 9.9))
    first, *others = found.branches
    (event,) = (one for one in first.events if one.kind == "period doubling")
    (offshoot,) = others
    assert (first.kind, offshoot.kind) == ("base", "offshoot")
    assert offshoot.frequency[0] == pytest.approx(event.frequency, rel=1e-9)
    (one,) = (motion for motion in found.at(9.6) if motion.period > 1.0)
    assert one.period == pytest.approx(4.0 * math.pi / 9.6)
    assert one.amplitude_across > 0.01
    assert motion_repeats(one, replace(base, frequency=9.6))
    half = one.t.size // 2
    assert np.abs(one.q[half] - one.q[0]).max() > 0.05
