# SPDX-License-Identifier: MIT
"""The compiled motion of scenes against the modular method's own form of them, M, f, A and b."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import redundant
from independent import any_segments, derivative_along, worst
from test_terms import jacobian_by_differences

import pipedyn as pp
from pipedyn import _core
from pipedyn import modular as md
from pipedyn.models.base import core_pipe

PIPE = pp.Pipe(0.3, 4.0, drag=1.5, damping=0.01)
ASPIRATING = pp.Pipe(0.3, 4.0, "aspirating", 0.7, drag=1.5, damping=0.01)


def unequal(n, pipe=PIPE, seed=0, **given):
    """A chain with nothing equal or homogeneous, from parts."""
    return md.chain(pipe, **any_segments(n, seed) | given)


def rich(n, pipe=PIPE, seed=0):
    """All that a scene can have besides the chain's own modules."""
    terms = [
        *(pp.Spring(1.0, 3.0), pp.Spring(0.37, 2.0), pp.Damper(1.0, 0.7), pp.Damper(0.37, 0.2)),
        *(pp.PointMass(1.0, 0.3), pp.PointMass(0.37, 0.1), pp.Foundation(1.5)),
    ]
    springs = md.TorsionalSpring(n, 2.0, 0.2, 0.4), md.TorsionalSpring(1, 3.0, 0.0, -0.3)
    body = md.Custom(nodes=(n,), joints=(n,), mass=np.diag([0.2, 0.02, 0.01]), name="body")
    magnet = md.Custom(nodes=(1,), energy=lambda q: -1.0 / (1.0 + q[0] ** 2 + (q[1] - 0.3) ** 2))
    parts = [*terms, *springs, body, magnet]
    if n > 1:  # a rod between the transverse motions of far nodes
        rod = np.kron([[0.1, 0.05], [0.05, 0.2]], np.diag([1.0, 0.0]))
        parts.append(md.Custom(nodes=(1, n), mass=rod, name="rod"))
    return unequal(n, pipe, seed).plus(*parts)


def state(scene, size=1.0, seed=1):
    """A state that meets guides and pins."""
    rng = np.random.default_rng([scene.integrated, seed])
    start = scene.admissible(scene.resting() + size * rng.normal(size=scene.integrated))
    return scene.state(*scene.onto_constraints(start, size * rng.normal(size=scene.integrated)))


# ---------------------------------------------------------------------------------- accelerations


@pytest.mark.parametrize("more", [[], [md.Guide(1000)], [md.Pin(1000, 0.3, 0.8), md.Guide(500)]])
def test_a_thousand_segments_obey_constraints_and_forces(more):
    """A q'' = b, and what M q'' lacks to f does no work in motions that guides and pins allow."""
    n = 1000
    scene = md.chain(PIPE, n).plus(*more)
    start = scene.admissible(np.sin(4.0 * np.linspace(0.0, 1.0, n)))
    theta, omega = scene.onto_constraints(start, np.cos(3.0 * np.linspace(0.0, 1.0, n)))
    y = scene.state(theta, omega)
    q, rates = np.split(y, 2)
    acceleration = scene.rhs(0.0, y, 5.0)[3 * n :]
    _, enforced, _ = redundant.constraints(scene, q, acceleration)
    _, _, wanted = redundant.constraints(scene, q, rates)
    assert np.abs(enforced - wanted).max() <= 1e-11 * np.abs(acceleration).max()
    layout, inertia = scene._layout, redundant.mass(scene, q) @ acceleration
    forces = redundant.forces(scene, y, 5.0)
    held = layout.rows(theta)
    moments, each = (layout.moments(theta, of[:, None])[:, 0] for of in (forces - inertia, inertia))
    left = moments - held @ np.linalg.lstsq(held, moments, rcond=0.0)[0] if more else moments
    assert np.abs(left).max() < 1e-9 * np.abs(each).max()


def test_scenes_at_random_move_or_name_what_lacks_inertia():
    """Any groups in any order, a last segment with inertia of its own or without."""
    moved, refusals = 0, []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 7))
        scene = (rich if seed % 2 else unequal)(n, seed=seed)
        modules, terms = list(scene.modules), ()
        if seed % 3 == 0:
            length = modules[n - 1].length
            modules[n - 1] = md.Segment(length, centre=0.0, gyration_radius=0.0)
        elif seed % 5:
            terms = scene.pipe.terms
        groups = list(scene.constraints)
        groups += [md.Guide(int(rng.integers(1, n + 1))) for _ in range(rng.integers(0, 3))]
        groups += [md.Pin(int(rng.integers(1, n + 1)), 0.1, 0.5)] * int(rng.integers(0, 2))
        groups = [groups[i] for i in rng.permutation(len(groups))]
        try:
            made = md.Assembly(pp.Pipe(0.3, 4.0, terms=terms), modules, groups)
        except ValueError as error:
            refusals.append((seed, n, str(error)))
            continue
        moved += 1
        y = state(made, 0.3, seed)
        found = made.rhs(0.0, y, 3.0)[3 * n :]
        assert worst(found, redundant.accelerations(made, y, 3.0)) < 1e-8
    assert moved > 50
    lacked = [(seed, n, text) for seed, n, text in refusals if "inertia" in text]
    assert len(lacked) > 10
    assert all(seed % 3 == 0 and f"phi_{n} moves" in text for seed, n, text in lacked)
    assert all("Pin" in text or "Guide" in text for *_, text in refusals if "inertia" not in text)


@pytest.mark.parametrize(("n", "rank"), [(5, 15), (5, 4), (30, None)])
def test_inertia_may_couple_every_coordinate(n, rank):
    """Also inertia between neighbours along the whole pipe."""
    nodes = tuple(range(1, n + 1))
    if rank is None:
        neighbours = np.eye(n, k=1) + np.eye(n, k=-1)
        across = np.kron(0.2 * np.eye(n) + 0.1 * neighbours, np.diag([1.0, 0.0]))
        body = md.Custom(nodes=nodes, mass=across)
    else:
        factor = np.random.default_rng(0).normal(size=(3 * n, rank))
        body = md.Custom(nodes=nodes, joints=nodes, mass=factor @ factor.T)
    scene = unequal(n).plus(body, *[md.Guide(n)] * (rank is not None))
    y = state(scene, 0.3)
    exact = redundant.accelerations(scene, y, 4.0)
    assert worst(scene.rhs(0.0, y, 4.0)[3 * n :], exact) < 1e-8


@pytest.mark.parametrize("guided", [False, True])
def test_batches_and_threads_give_what_single_states_give(guided):
    scene = rich(4).plus(*[md.Guide(3)] * guided)
    y = np.stack([state(scene, seed=k) for k in range(6)], axis=1)
    u = np.linspace(0.0, 5.0, 6)
    rates, energy, power = scene.rhs(0.0, y, u), scene.energy(y), scene.power(y, u)

    def one(k):
        single = np.ascontiguousarray(y[:, k])
        assert worst(scene.rhs(0.0, single, u[k]), rates[:, k]) < 1e-12
        assert math.isclose(scene.energy(single), energy[k], rel_tol=1e-13)
        for part in ("flow", "joints", "drag", "others"):
            mine, theirs = getattr(scene.power(single, u[k]), part), getattr(power, part)[k]
            assert math.isclose(mine, theirs, rel_tol=1e-12, abs_tol=1e-13)

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(one, list(range(6)) * 20))


def test_accelerations_follow_from_the_joints_alone():
    scene = rich(3).plus(md.Guide(3))
    y = state(scene)
    moved = y + np.tile([0.1, -0.2, 0.0], 6)
    np.testing.assert_array_equal(scene.rhs(0.0, moved, 2.0)[9:], scene.rhs(0.0, y, 2.0)[9:])
    assert scene.energy(moved) == scene.energy(y)
    jacobian = scene.jacobian(0.0, y, 2.0)[9:].reshape(9, 6, 3)
    assert not jacobian[:, :, :2].any()


def test_a_thousand_straight_segments_at_rest_stay():
    scene = unequal(1000)
    rates = scene.rhs(0.0, scene.state(np.zeros(1000)), 5.0)
    assert np.abs(rates).max() < 1e-3  # a spring's moment turns a segment at 1e12 a radian


# --------------------------------------------------------------------------- redundant coordinates


@pytest.mark.parametrize("pipe", [PIPE, ASPIRATING])
@pytest.mark.parametrize("n", [1, 3])
def test_operators_are_the_derivatives_of_the_forces_in_redundant_coordinates(pipe, n):
    """Moments of the forces and inertia about a bent configuration, which nothing holds."""
    scene, u = rich(n, replace(pipe, drag=0.0)), 2.5
    layout = scene._layout
    theta = np.array([0.3, -0.5, 0.8])[:n]

    def moments(z):
        forces = redundant.forces(scene, scene.core.redundant(z), u)
        return layout.moments(z[:n], forces[:, None])[:, 0]

    by_state = jacobian_by_differences(moments, np.append(theta, np.zeros(n)), 1.0)
    mass, velocity, stiffness = scene.operators(theta).at(u)
    np.testing.assert_allclose(by_state, -np.hstack([stiffness, velocity]), atol=1e-7)
    turning = scene.core.redundant(np.vstack([np.outer(theta, np.ones(n)), np.eye(n)]))[3 * n :]
    inertia = redundant.mass(scene, scene.core.redundant(np.append(theta, np.zeros(n)))[: 3 * n])
    np.testing.assert_allclose(turning.T @ inertia @ turning, mass, atol=1e-13)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_constraints_change_as_their_derivatives_say(n):
    """At states that meet no constraint."""
    scene = rich(n).plus(*[md.Guide(n), md.Pin(2, 0.1, 0.3)] * (n > 2))
    size = 3 * n
    rng = np.random.default_rng(n)
    q = scene.state(scene.resting())[:size] + 0.3 * rng.normal(size=size)
    rates = rng.normal(size=size)
    residual, drift, wanted = redundant.constraints(scene, q, rates)
    _, a, _ = redundant.constraints(scene, q, np.eye(size))
    assert a.shape == (residual.size, size)
    by_coordinates = jacobian_by_differences(
        lambda z: redundant.constraints(scene, z, rates)[0], q, 1.0
    )
    np.testing.assert_allclose(a, by_coordinates, atol=1e-8)
    np.testing.assert_allclose(a @ rates, drift, atol=1e-13)
    # d/dt of A q' is A q'' + A' q', so b = -A' q'
    by_time = derivative_along(lambda q: redundant.constraints(scene, q, rates)[1], q, rates)
    np.testing.assert_allclose(wanted, -by_time, atol=1e-8)


def light(n, *more, radius=0.0):
    """The last segment has no inertia but that of a term at its end, or a small radius as well."""
    segments = [md.Segment(1.0 / n, 0.5, 0.07)] * (n - 1) + [md.Segment(1.0 / n, 0.0, radius)]
    springs = [md.TorsionalSpring(j, 1.0 * n) for j in range(1, n + 1)]
    ties = [md.Clamp(), *(md.Joint(j) for j in range(2, n + 1))]
    pipe = replace(PIPE, terms=[pp.PointMass(at=1.0, mass=0.3)])
    return md.Assembly(pipe, [*segments, *springs, md.InternalFlow(), md.Drag()], [*ties, *more])


RETURNING = {
    "guided": lambda: unequal(4).plus(md.Guide(4)),
    "guided twice": lambda: unequal(6, ASPIRATING).plus(md.Guide(4), md.Guide(2)),
    "pinned": lambda: unequal(5).plus(md.Pin(5, 0.1, 0.8), md.Guide(2)),
    "own modules": lambda: rich(4).plus(md.Guide(4)),
    "own modules, pinned": lambda: rich(5, ASPIRATING).plus(md.Guide(5), md.Pin(2, 0.1, 0.3)),
    "light": lambda: light(4),
    "light, guided": lambda: light(4, md.Guide(2)),
}


def off_constraints(scene):
    """Angles and rates that miss guides and pins."""
    rng = np.random.default_rng(3)
    return scene.resting() + 0.3 * rng.normal(size=scene.integrated), rng.normal(
        size=scene.integrated
    )


@pytest.mark.parametrize("name", RETURNING)
def test_the_motion_jacobian_is_exact_where_guides_are_missed_too(name):
    """Differences in steps in which drag has no kink."""
    scene = RETURNING[name]()
    y, u = np.concatenate(off_constraints(scene)), 3.0

    def rates(z):
        return scene.motion_rates(np.append(z, 0.0), u)[:-1]

    found = jacobian_by_differences(rates, y, 1.0, 2e-3)
    assert worst(scene.motion_jacobian(y, u), found) < 1e-11
    both = scene.motion_jacobian(np.stack([y, 0.5 * y], axis=1), u)
    np.testing.assert_array_equal(both[0], scene.motion_jacobian(y, u))


@pytest.mark.parametrize("name", ["guided twice", "pinned", "own modules, pinned"])
def test_what_states_miss_guides_by_decays_at_the_return_rate(name):
    scene = RETURNING[name]()
    n, rate, held = scene.integrated, scene.core.return_rate, scene._layout.held
    theta, omega = off_constraints(scene)
    rates = scene.motion_rates(np.concatenate([theta, omega, [0.0]]), 3.0)[:-1]
    np.testing.assert_array_equal(rates[:n], omega)

    def off(y):
        places, speeds = (part[held] for part in np.split(scene.core.redundant(y), 2))
        return np.stack([places - scene._layout.held_values, speeds])

    y = np.append(theta, omega)
    missed, speed = off(y)
    slope = derivative_along(off, y, rates, 1e-4)[1]
    expected = -2.0 * rate * speed - rate**2 * missed
    np.testing.assert_allclose(slope, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("name", RETURNING)
def test_free_directions_of_states_keep_guides_and_pins(name):
    scene = RETURNING[name]()
    n, held = scene.integrated, scene._layout.held
    y = np.concatenate(scene.onto_constraints(*off_constraints(scene)))
    free = scene.free_states(y)
    assert free.shape == (2 * n, 2 * scene.dof)
    np.testing.assert_allclose(free.T @ free, np.eye(2 * scene.dof), atol=1e-13)
    slopes = jacobian_by_differences(scene.core.redundant, y, 1.0)
    moved = (slopes @ free).reshape(2, -1, 2 * scene.dof)[:, held]
    np.testing.assert_allclose(moved, 0.0, atol=1e-8)


# ---------------------------------------------------------------------------------------- closing


def core_scene(n=3, held=(), value=(), **given):
    """A compiled scene without forces."""
    arguments = {
        "length": np.full(n, 1.0 / n),
        "center": np.full(n, 0.5),
        "gyration_radius": np.full(n, 0.1),
        **{name: np.zeros(n) for name in ("spring", "drag_point")},
        "base": 0.0,
    }
    segments = _core.Segments(**arguments | given)
    return _core.Scene(core_pipe(pp.Pipe(0.3, 4.0)), segments, held, value)


def test_projection_meets_guides_and_pins_and_says_how_far_it_misses_others():
    core = core_scene(5, held=[12, 13, 3], value=[0.0, 0.8, 0.0])
    theta, omega = 0.3 * np.random.default_rng(0).normal(size=(2, 5, 7))
    met_theta, met_omega, missed = core.project(theta, omega)
    assert missed.max() <= core.met
    y = core.redundant(np.concatenate([met_theta, met_omega]))
    np.testing.assert_allclose(y[[12, 13, 3]].T, [[0.0, 0.8, 0.0]] * 7, atol=1e-12)
    np.testing.assert_allclose(y[[27, 28, 18]], 0.0, atol=1e-11)
    _, again, _ = core.project(met_theta, met_omega)
    np.testing.assert_allclose(again, met_omega, atol=1e-12)
    *_, missed = core_scene(5, held=[12, 13], value=[0.0, 1.3]).project(theta, omega)
    assert np.all((missed >= 0.3 - 1e-12) & (missed < 0.4))  # the pipe's length is 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"center": np.zeros(2)}, "one entry a segment"),
        ({"damping": np.zeros(2)}, "one entry a segment"),
    ],
)
def test_inconsistent_scenes_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        core_scene(**given)


def test_wrong_sizes_are_refused():
    core = core_scene(2)
    with pytest.raises(ValueError, match=r"y must have shape \(12,\)"):
        core.redundant_rhs(0.0, np.zeros(11), 1.0)
    with pytest.raises(ValueError, match="theta must have 2 entries, got 3"):
        core.project(np.zeros((3, 1)), np.zeros((2, 1)))
    with pytest.raises(ValueError, match=r"y must have shape \(4,\)"):
        core.redundant(np.zeros(5))
