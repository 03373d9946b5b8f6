# SPDX-License-Identifier: MIT
"""Scenes from parts: the recursions against one another, against `Chain`, and known answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import redundant
from independent import derivative_along
from test_modular_core import light, rich, state
from test_motion import TAPERED
from test_terms import jacobian_by_differences

import pipedyn as pp
from pipedyn import modular as md

CLAMPED_PINNED = 4.493409457909064
"""First root of tan u = u: the clamped-pinned column."""

EJECTING = pp.Pipe(0.3, 12.0, drag=0.7, damping=0.01)
ASPIRATING = pp.Pipe(0.4, -3.0, "aspirating", 0.7, drag=1.5)

LOADED = replace(  # places inside segments, on nodes and on the fixed base of some chains below
    EJECTING,
    terms=[
        *(pp.PointMass(0.05, 0.4), pp.PointMass(0.62, 0.3), pp.PointMass(1.0, 0.1)),
        *(pp.Spring(0.3, 20.0), pp.Spring(0.97, 5.0)),
    ],
)

UNEQUAL = {
    "lengths": [0.2, 0.25, 0.15, 0.3],
    "springs": [9.0, 4.0, 7.0, 3.0],
    "centres": [0.4, 0.65, 0.55, 0.3],
    "gyration_radii": [0.05, 0.08, 0.02, 0.1],
    "drag_points": [0.3, 0.5, 0.9, 0.2],
    "base": 0.1,
}
PARTED = {"lengths": [0.3, 0.1, 0.25, 0.35], "drag_points": [0.5, 0.4, 0.3, 0.6]}


def slack(n: int, pipe: pp.Pipe = EJECTING, y: float = 0.9) -> md.Assembly:
    """A chain whose free end is pinned nearer to the clamp than its length."""
    return md.chain(pipe, n).plus(md.Pin(n, 0.0, y))


SCENES: dict[str, Callable[[], md.Assembly]] = {
    "plain": lambda: md.chain(EJECTING, 5),
    "aspirating": lambda: md.chain(ASPIRATING, 6, springs="midpoint"),
    "unequal": lambda: md.chain(EJECTING, **UNEQUAL),
    "tapered": lambda: md.chain(TAPERED, **PARTED),
    "guided": lambda: md.chain(EJECTING, 5).plus(md.Guide(5)),
    "guided twice": lambda: md.chain(ASPIRATING, 5).plus(md.Guide(3), md.Guide(5), md.Guide(3)),
    "rich, guided between": lambda: rich(6).plus(*map(md.Guide, (1, 3, 5))),
    "arch": lambda: slack(6),
    "arch said twice": lambda: slack(6).plus(md.Guide(1), md.Pin(6, 0.0, 0.9)),
    "pin and guide": lambda: slack(6).plus(md.Guide(6)),
    "fitted": lambda: md.chain(EJECTING, 5).plus(
        pp.PointMass(at=1.0, mass=0.3),
        pp.PointMass(at=0.37, mass=0.1),
        pp.Spring(at=0.6, stiffness=40.0),
        pp.Damper(at=0.75, coefficient=0.8),
        md.TorsionalSpring(2, 3.0, damping=0.2, rest_angle=0.3),
    ),
    "held twice": lambda: md.chain(EJECTING, 4).plus(md.Joint(3), md.Clamp()),
    "rich": lambda: rich(4),
    "rich, aspirating": lambda: rich(4, ASPIRATING),
    "rich, held": lambda: rich(4).plus(md.Guide(4), md.Pin(2, 0.1, 0.4)),
    "light": lambda: light(4),
    "magnet": lambda: md.chain(EJECTING, 5).plus(  # at the free end, and beside it
        md.Custom(
            nodes=(5,),
            energy=lambda q: -2.0 / (1.0 + ((q[0] - 0.2) ** 2 + (q[1] - 1.0) ** 2) / 0.3**2),
        )
    ),
}


# ----------------------------------------------------------------------------------- accelerations


@pytest.mark.parametrize("name", SCENES)
def test_the_recursion_gives_the_accelerations_of_the_one_shot_null_space(name: str) -> None:
    scene = SCENES[name]()
    n = scene.coordinates
    for seed in range(3):
        y, u = state(scene, seed=seed), 2.0 + seed
        rates, expected = scene.rhs(0.0, y, u), redundant.accelerations(scene, y, u)
        np.testing.assert_array_equal(rates[:n], y[n:])
        scale = np.abs(rates).max()
        np.testing.assert_allclose(rates[n:], expected, atol=1e-10 * scale, rtol=0.0)


def test_redundant_constraints_change_nothing() -> None:
    plain = md.chain(EJECTING, 6).plus(md.Guide(4))
    again = plain.plus(md.Guide(4), md.Joint(2), md.Clamp(), md.Joint(6))
    y = state(plain)
    assert again.dof == plain.dof == 5
    expected = plain.rhs(0.0, y, 2.0)
    np.testing.assert_allclose(again.rhs(0.0, y, 2.0), expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(
        pp.eigenvalues(again, 2.0, 4), pp.eigenvalues(plain, 2.0, 4), rtol=1e-11
    )


# -------------------------------------------------------------------------------- the plain chain


@pytest.mark.parametrize(
    ("pipe", "given"),
    [
        (EJECTING, {"n": 7}),
        (ASPIRATING, {"n": 7, "springs": "midpoint"}),
        (EJECTING, UNEQUAL),
        (ASPIRATING, {"n": 1}),
        (ASPIRATING, {"n": 1000}),
        (LOADED, {"n": 7}),
        (LOADED, UNEQUAL),
        (TAPERED, PARTED),
    ],
)
def test_the_plain_chain_moves_like_chain(pipe: pp.Pipe, given: dict) -> None:
    chain, scene = pp.Chain(pipe, **given), md.chain(pipe, **given)
    n = chain.dof
    rng = np.random.default_rng(2)
    for u in (0.0, 5.5):
        theta, omega = rng.normal(size=n), 4.0 * rng.normal(size=n)
        expected = chain.rhs(0.0, np.concatenate([theta, omega]), u)[n:]
        y = scene.state(theta, omega)
        found = np.cumsum(scene.rhs(0.0, y, u)[3 * n + 2 :: 3])
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
        both = np.concatenate([theta, omega])
        assert math.isclose(scene.energy(y), chain.energy(both), rel_tol=1e-12, abs_tol=1e-12)
        for part in ("flow", "joints", "drag", "others", "total"):
            mine, theirs = getattr(scene.power(y, u), part), getattr(chain.power(both, u), part)
            assert math.isclose(mine, theirs, rel_tol=1e-11, abs_tol=1e-11)
        s = np.linspace(0.0, 1.0, 23)
        np.testing.assert_allclose(scene.shape(theta, s), chain.shape(theta, s), atol=1e-14)
        np.testing.assert_allclose(scene.tip(y[: 3 * n]), chain.tip(theta), atol=1e-14)


@pytest.mark.parametrize(
    ("pipe", "given"), [(EJECTING, UNEQUAL), (LOADED, UNEQUAL), (TAPERED, PARTED)]
)
@pytest.mark.parametrize("angles", [None, "bent"])
def test_the_plain_chain_has_the_operators_of_chain(
    angles: str | None, pipe: pp.Pipe, given: dict
) -> None:
    chain, scene = pp.Chain(pipe, **given), md.chain(pipe, **given)
    assert scene.linear_cost
    assert chain.linear_cost
    q = None if angles is None else np.array([0.3, -0.5, 0.8, 0.2])
    mine, theirs = scene.operators(q), chain.operators(q)
    names = ["mass", "gyroscopic", "end_flux", "damping"]
    # Besides the derivatives of the forces in the angles, about a bent chain that is no equilibrium
    # nothing else is left: no guide or pin bends the coordinates.
    for name in [*names, "stiffness", "flux"]:
        np.testing.assert_allclose(
            getattr(mine, name), getattr(theirs, name), atol=1e-13, err_msg=name
        )


# ------------------------------------------------------------------------------- terms of the pipe


def test_a_term_on_the_fixed_base_does_nothing() -> None:
    plain = md.chain(EJECTING, **UNEQUAL)
    held = plain.plus(pp.PointMass(0.05, 10.0), pp.Spring(plain.constraints[0].base, 1e4))
    y = state(plain)
    np.testing.assert_array_equal(held.rhs(0.0, y, 3.0), plain.rhs(0.0, y, 3.0))
    assert held.energy(y) == plain.energy(y)


# ----------------------------------------------------------------------- derivatives and balances


@pytest.mark.parametrize("name", SCENES)
def test_the_jacobian_is_the_derivative_of_the_rates(name: str) -> None:
    scene = SCENES[name]()
    y, u = state(scene, seed=4), 3.0
    differences = jacobian_by_differences(lambda y: scene.rhs(0.0, y, u), y, 1.0, 1e-5)
    atol = 3e-7 * np.abs(differences).max()
    np.testing.assert_allclose(scene.jacobian(0.0, y, u), differences, atol=atol)


@pytest.mark.parametrize("name", SCENES)
def test_energy_changes_by_the_power_of_the_parts(name: str) -> None:
    scene = SCENES[name]()
    y, u = state(scene, seed=6), 4.0
    measured = derivative_along(scene.energy, y, scene.rhs(0.0, y, u), 1e-5)
    power = scene.power(y, u)
    assert math.isclose(measured, power.total, rel_tol=1e-7, abs_tol=1e-6 * abs(power.flow))
    own = name == "fitted" or name.startswith("rich")
    assert power.others < 0.0 if own else power.others == 0.0


@pytest.mark.parametrize("name", ["unequal", "guided", "fitted", "arch", "magnet"])
def test_small_motions_obey_the_operators(name: str) -> None:
    """Eigenvalues of the nonlinear motion's own Jacobian, which knows no geometric stiffness."""
    scene = SCENES[name]()
    u = 2.5
    q = scene.equilibrium(scene.bent(lambda s: 0.8 * np.sin(2.0 * math.pi * s)), u)
    rested = scene.about(q)
    found = np.sort_complex(pp.eigenvalues(rested, u))
    start = np.concatenate([scene.angles(q), np.zeros(scene.integrated)])
    assert np.abs(scene.motion_rates(np.append(start, 0.0), u)).max() < 1e-9
    every = np.linalg.eigvals(scene.motion_jacobian(start, u))
    far = np.abs(every[:, None] - found[None, :]).min(axis=0)
    assert np.all(far < 1e-6 * (1.0 + np.abs(found)))
    # What is left are the rates at which the projection takes a state back to its constraints.
    assert found.size == 2 * scene.dof


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(pp.Pipe(0.2, end="pinned", supports=(0.5,)), 4),
        pp.Galerkin(pp.Pipe(0.2, end="pinned"), 4),
        pp.Galerkin(pp.Pipe(0.2), 3),
        SCENES["guided"](),
    ],
)
def test_what_is_recorded_tells_what_is_integrated(model: pp.Galerkin) -> None:
    random = np.random.default_rng(3)
    p, rates = model.onto_constraints(*random.uniform(-0.2, 0.2, (2, model.integrated, 5)))
    states = model.from_user(*model.to_user(p.T, rates.T))
    np.testing.assert_allclose(states, np.concatenate([p, rates]).T, atol=1e-10)


def test_the_arch_is_stable_and_keeps_its_shape_in_the_flow() -> None:
    """A pinned inextensible arch: thrust is taken up by its length, Coriolis forces do no work."""
    for n in (8, 16):
        scene = slack(n, pp.Pipe(0.3))
        q = scene.equilibrium(scene.bent(lambda s: np.sin(2.0 * math.pi * s)))
        assert abs(q[3 * (n // 2) - 3]) > 0.05
        for u in (3.0, 15.0):
            np.testing.assert_allclose(scene.equilibrium(q, u), q, atol=1e-9)
            values = pp.eigenvalues(scene.about(q), u)
            assert np.abs(values.real).max() < 1e-7 * np.abs(values).max()
        assert not pp.crossings(scene.about(q), 20.0)
        with pytest.raises(pp.NoCrossing):
            pp.critical_speed(scene.about(q), 20.0)
    # The straight pipe is no configuration of this scene.
    with pytest.raises(ValueError, match=r"the straight pipe misses Pin\(node=16"):
        pp.eigenvalues(scene, 1.0)


# ------------------------------------------------------------------------------------ known answers


@pytest.mark.parametrize("beta", [0.05, 0.5, 0.9])
def test_crossings_of_a_guided_pipe_meet_the_eigenvalues_on_either_side(beta: float) -> None:
    """Divergence, gyroscopic stabilisation and the meeting of modes, counted by numpy."""
    scene = md.chain(pp.Pipe(beta, 20.0), 10).plus(md.Guide(10))
    crossings = pp.crossings(scene, 12.0)
    assert {"flutter", "divergence"} >= {c.kind for c in crossings}
    operators, n = scene.operators(), scene.dof
    for u in np.arange(0.13, 12.0, 0.37):
        if min(abs(c.speed - u) for c in crossings) < 1e-2:
            continue
        mass, velocity, stiffness = operators.at(u)
        free = np.linalg.solve(mass, np.hstack([stiffness, velocity]))
        values = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-free]]))
        passed = [c.unstable_after for c in crossings if c.speed < u]
        assert (passed[-1] if passed else 0) == np.sum(values.real > 1e-5 * (1.0 + np.abs(values)))


def test_equal_spans_have_crossings_though_their_modes_are_close() -> None:
    """Alone a span buckles at 4.49 and later, clamped and pinned, or at pi, pinned, times four."""
    guides = (md.Guide(k) for k in (12, 24, 36, 48))
    critical = pp.critical_speed(md.chain(pp.Pipe(0.2), 48).plus(*guides))
    assert critical.kind == "divergence"
    assert 4.0 * math.pi < critical.speed < 4.0 * CLAMPED_PINNED


@pytest.mark.parametrize(
    ("gamma", "masses", "squares", "rtol"),
    [
        # Equal bobs on massless rods: omega^2 = (2 -+ sqrt 2) g / l. The segments of an assembly
        # have mass, which bobs a million times heavier hide.
        (1.0, [pp.PointMass(at, 1e6) for at in (0.5, 1.0)], (4.0, 2.0 * math.sqrt(2.0)), 2e-6),
        # Uniform rods: omega^2 = (3 -+ 6 / sqrt 7) g / l.
        (4.0, [], (24.0, 48.0 / math.sqrt(7.0)), 1e-12),
    ],
    ids=["bobs", "rods"],
)
def test_a_double_pendulum_swings_at_the_textbook_frequencies(
    gamma: float, masses: list, squares: tuple[float, float], rtol: float
) -> None:
    parts = [md.Segment(0.5), md.Segment(0.5), *masses]
    scene = md.Assembly(pp.Pipe(0.0, gamma), parts, [md.Clamp(), md.Joint(2)])
    values = pp.eigenvalues(scene, 0.0)
    mean, apart = squares
    found = np.sort(np.abs(values[values.imag > 0.0])) ** 2
    np.testing.assert_allclose(found, [mean - apart, mean + apart], rtol=rtol)


# ------------------------------------------------------------------------------------------ motion


def drifting(scene: md.Assembly, u: float, duration: float, method: str) -> float:
    """How far the angles that are integrated, before their projection, are off guides and pins.

    The integrator is asked for few digits: what holds them is not its accuracy.
    """
    start = scene.bent(lambda s: 0.3 * np.sin(2.0 * math.pi * s))
    motion = pp.simulate(scene, u, duration, start, rtol=1e-5, method=method, dense=True)
    rows, n = motion.dense.coefficients[:, 0], scene.integrated
    met, _ = scene.onto_constraints(rows[:, :n].T, rows[:, n:].T)
    return float(np.abs(met - rows[:, :n].T).max())


def missed(scene: md.Assembly, motion: pp.Motion) -> float:
    """How far the recorded coordinates miss the constraints."""
    return max(np.abs(redundant.constraints(scene, *np.split(y, 2))[0]).max() for y in motion.y.T)


def test_constraints_do_not_drift_over_a_hundred_periods() -> None:
    guided = md.chain(pp.Pipe(0.2, 5.0, drag=0.5), 4).plus(md.Guide(4))
    lowest = np.abs(pp.eigenvalues(guided, 2.0, 2)).min()
    duration = 100.0 * 2.0 * math.pi / lowest
    start = guided.bent(lambda s: 0.5 * np.sin(2.0 * math.pi * s))
    motion = pp.simulate(guided, 2.0, duration, start, samples=2001)
    assert np.abs(motion.q[-200:]).max() > 1e-3
    assert missed(guided, motion) < 1e-12
    assert np.abs(motion.qdot[:, 3 * 4 - 3]).max() < 1e-12
    assert motion.audit < 1e-4
    # What the integrator itself is off the guide stays as small.
    for method in ("dop853", "radau"):
        assert drifting(guided, 2.0, duration, method) < 1e-8


@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:LSODA"])
def test_pinned_and_fluttering_scenes_keep_their_constraints(method: str) -> None:
    tied = md.chain(pp.Pipe(0.2, drag=0.3), 4).plus(md.Guide(2))  # it flutters beyond the guide
    for scene, u in ((slack(5, pp.Pipe(0.3, 2.0, drag=0.3, damping=1e-3)), 4.0), (tied, 8.0)):
        assert method == "scipy:LSODA" or drifting(scene, u, 5.0, method) < 1e-6
        start = scene.bent(lambda s: 0.3 * np.sin(2.0 * math.pi * s))
        motion = pp.simulate(scene, u, 5.0, start, samples=101, rtol=1e-5, method=method)
        assert missed(scene, motion) < 1e-12


@pytest.mark.parametrize(("n", "node", "duration"), [(10, 6, 2.0), (100, 40, 0.02)])
@pytest.mark.parametrize("pipe", [EJECTING, pp.Pipe(0.3, 4.0, damping=0.01, drag=0.5)])
def test_guided_chains_move_as_with_dense_jacobians(
    pipe: pp.Pipe, n: int, node: int, duration: float
) -> None:
    """scipy's integrator knows nothing of the recursion that solves with these Jacobians."""
    scene = md.chain(pipe, n).plus(md.Guide(node), pp.PointMass(at=1.0, mass=0.1))
    start = scene.bent(lambda s: 0.2 * np.sin(2.0 * math.pi * s))
    runs = [
        pp.simulate(scene, 5.0, duration, start, samples=11, rtol=1e-10, method=method)
        for method in ("radau", "scipy:LSODA" if pipe.damping else "scipy:DOP853")
    ]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-7)
    assert all(missed(scene, motion) < 1e-12 for motion in runs)
    assert runs[0].audit < 1e-8


def test_initial_states_are_angles_or_coordinates_that_meet_the_constraints() -> None:
    scene = md.chain(pp.Pipe(0.2), 4).plus(md.Guide(4))
    angles = scene.admissible([0.3, 0.1, -0.2, 0.0])
    y = scene.state(angles)
    by_angles = pp.simulate(scene, 1.0, 0.1, angles, samples=3)
    by_coordinates = pp.simulate(scene, 1.0, 0.1, y[:12], samples=3)
    np.testing.assert_allclose(by_angles.q, by_coordinates.q, atol=1e-13)
    np.testing.assert_allclose(scene.angles(y), angles, atol=1e-15)
    with pytest.raises(
        ValueError, match=r"q0 must meet Guide\(node=4\), got a deviation of .*e-02"
    ):
        pp.simulate(scene, 1.0, 0.1, [0.3, 0.1, -0.2, 0.1])
    torn = y[:12].copy()
    torn[3] += 0.01
    with pytest.raises(ValueError, match=r"q0 must meet Joint\(segment=.\), got a deviation of"):
        pp.simulate(scene, 1.0, 0.1, torn)
    with pytest.raises(ValueError, match=r"qdot0 must keep Guide\(node=4\)"):
        pp.simulate(scene, 1.0, 0.1, angles, [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"q0 must have 4 or 12 entries, got 5"):
        pp.simulate(scene, 1.0, 0.1, np.zeros(5))
