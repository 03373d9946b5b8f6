# SPDX-License-Identifier: MIT
"""Parts of scenes: a user's own modules, what does not fit, and what comes with every part."""

from __future__ import annotations

import math
import multiprocessing
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import redundant

import pipedyn as pp
from pipedyn import modular as md
from pipedyn import plot

PIPE = pp.Pipe(0.3, 5.0, drag=0.4)


def wave(s: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(2.0 * math.pi * s)


# ---------------------------------------------------------------------------- modules of one's own


def own_spring(node: int, stiffness: float, coefficient: float) -> md.Custom:
    """A spring and a damper, written by a user."""
    return md.Custom(
        nodes=(node,),
        energy=lambda q: 0.5 * stiffness * q[0] ** 2,
        force=lambda q, v: np.array([-stiffness * q[0] - coefficient * v[0], 0.0 * q[1]]),
        name="my spring",
    )


SHARE = np.array([0.35, 0.65])
"""Of the nodes to the left and right of a place, 0.65 of the second of four segments."""

BUILT_IN: dict[str, tuple[int, md.Custom, list[Any]]] = {
    "spring and damper": (
        *(4, own_spring(2, 30.0, 0.7)),
        [pp.Spring(0.5, 30.0), pp.Damper(0.5, 0.7)],
    ),
    "the same on many segments": (
        *(30, own_spring(2, 30.0, 0.7)),
        [pp.Spring(1.0 / 15.0, 30.0), pp.Damper(1.0 / 15.0, 0.7)],
    ),
    "joints": (
        *(4, md.Custom(joints=(2, 3), energy=lambda q: 2.0 * q[0] ** 2 + 3.0 * q[1] ** 2)),
        [md.TorsionalSpring(2, 4.0), md.TorsionalSpring(3, 6.0)],
    ),
    "mass on a spring inside a segment": (
        4,
        md.Custom(
            nodes=(1, 2),
            energy=lambda q: 20.0 * (SHARE @ q[0::2]) ** 2 - 5.0 * 0.3 * (SHARE @ q[1::2]),
            mass=0.3 * np.kron(np.outer(SHARE, SHARE), np.eye(2)),
        ),
        [pp.PointMass(0.4125, 0.3), pp.Spring(0.4125, 40.0)],
    ),
}
"""Numbers of segments, what a user may write, and the parts of the package that are the same."""


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_module_in_python_is_the_built_in_one(name: str) -> None:
    n, mine, theirs = BUILT_IN[name]
    own, built_in = (md.chain(PIPE, n).plus(*parts) for parts in ([mine], theirs))
    y = own.state(np.sin(np.arange(1.0, n + 1.0)), np.cos(np.arange(1.0, n + 1.0)))
    batch = np.stack([y, 0.5 * y], axis=1)
    for ask in (
        lambda scene: scene.rhs(0.0, y, 3.0),
        lambda scene: scene.rhs(0.0, batch, 3.0),
        lambda scene: scene.jacobian(0.0, y, 3.0),
        lambda scene: scene.energy(batch),
        lambda scene: scene.power(batch, 3.0).others,
        lambda scene: scene.power(batch, 3.0).total,
        lambda scene: scene.operators(scene.angles(y)).stiffness,
        lambda scene: scene.operators().mass,
        lambda scene: pp.eigenvalues(scene, 4.0, 6),
        lambda scene: pp.critical_speed(scene).speed,
    ):
        found, expected = ask(own), ask(built_in)
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())


def test_a_motion_with_a_module_in_python_is_that_with_the_built_in_one() -> None:
    plain = md.chain(PIPE, 3)
    for method in ("dop853", "radau", "scipy:LSODA"):
        own, built_in = (
            pp.simulate(scene, 3.0, 0.5, wave, samples=11, rtol=1e-9, method=method)
            for scene in (
                plain.plus(own_spring(2, 30.0, 0.7)),
                plain.plus(pp.Spring(2.0 / 3.0, 30.0), pp.Damper(2.0 / 3.0, 0.7)),
            )
        )
        np.testing.assert_allclose(own.q, built_in.q, atol=1e-8)
        assert own.audit < 1e-6


@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:Radau"])
def test_a_module_without_a_force_ends_the_motion_and_leaves_its_beginning(method: str) -> None:
    edge = md.Custom(
        nodes=(3,),
        force=lambda q, v: 0.0 * q + np.where(np.abs(q[0].real) > 0.2, np.nan, 0.0),
    )
    scene = md.chain(PIPE, 3).plus(edge)
    with pytest.raises(pp.MotionStopped, match="no longer finite") as caught:
        pp.simulate(scene, 9.0, 40.0, lambda s: 0.05 * s**2, method=method, samples=4001)
    assert 0.05 < np.abs(caught.value.motion.tip[:, 0]).max() < 0.2


def test_what_a_force_of_ones_own_raises_is_seen() -> None:
    """Without a derivative of its own the force is called with complex arrays, but not at first."""
    broken = False

    def force(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if broken and np.abs(q[0]) > 0.03:
            raise TypeError("mine")
        return -3.0 * q

    scene = md.chain(PIPE, 3).plus(md.Custom(nodes=(2,), force=force))
    broken = True
    with pytest.raises(TypeError, match=r"^mine$"):
        scene.equilibrium([0.1, 0.1, 0.1], 3.0)


def test_a_magnet_bends_the_hose() -> None:
    """The straight pipe is no equilibrium, another is found."""

    def energy(q: np.ndarray) -> Any:
        return -2.0 / (1.0 + ((q[0] - 0.2) ** 2 + (q[1] - 1.0) ** 2) / 0.3**2)

    scene = md.chain(PIPE, 5).plus(md.Custom(nodes=(5,), energy=energy, name="magnet"))
    with pytest.raises(ValueError, match="the model must rest at u = 1 where it is linearised"):
        pp.eigenvalues(scene, 1.0)
    assert scene.tip(scene.equilibrium(np.zeros(5), 1.0))[0] > 0.01


def test_a_module_ties_far_nodes_together() -> None:
    """A rod between nodes far apart: its band is wide, and its inertia couples them."""
    mass = 0.2 / 6.0 * np.kron([[2.0, 1.0], [1.0, 2.0]], np.eye(2))
    rod = md.Custom(
        nodes=(10, 66), energy=lambda q: 20.0 * (q[0] - q[2]) ** 2, mass=mass, name="rod"
    )
    scene = md.chain(pp.Pipe(0.2), 70).plus(rod)
    found = pp.eigenvalues(scene, 4.0, 6)
    dense = pp.modes(scene, 4.0, 3)
    assert dense.residuals.max() < 1e-10
    ops = scene.operators()
    m, c, k = ops.at(4.0)
    n = scene.dof
    companion = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]]
    )
    every = np.linalg.eigvals(companion)
    assert np.all(np.abs(every[:, None] - found[None, :]).min(axis=0) < 1e-6 * np.abs(found))
    y = scene.state(0.5 * np.sin(np.arange(70.0)), np.cos(np.arange(70.0)))
    fast = scene.rhs(0.0, y, 4.0)[210:]
    slow = redundant.accelerations(scene, y, 4.0)
    np.testing.assert_allclose(fast, slow, atol=1e-8 * np.abs(slow).max())


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"nodes": (1,)}, ValueError, "magnet must have an energy, a force or a mass"),
        ({"energy": np.sum}, ValueError, "magnet must touch nodes or joints, got none"),
        ({"nodes": b"12", "energy": np.sum}, TypeError, "nodes of magnet must be a tuple"),
        ({"nodes": {1: 2}, "energy": np.sum}, TypeError, "nodes of magnet must be a tuple"),
        ({"nodes": (1,), "mass": 1e300 * np.eye(2)}, ValueError, "must be finite and at most 1e"),
        (
            {"nodes": (1,), "mass": np.eye(3)},
            ValueError,
            r"mass of magnet must have shape \(2, 2\)",
        ),
        ({"nodes": (1,), "mass": -np.eye(2)}, ValueError, "must be positive semidefinite"),
        ({"nodes": (1,), "mass": [[1.0, 0.5], [0.0, 1.0]]}, ValueError, "must be symmetric"),
        ({"nodes": (1,), "mass": [[1.0, math.nan], [0.0, 1.0]]}, ValueError, "must be finite"),
        (
            {"nodes": (1,), "energy": np.sum, "force_by_qdot": np.sum},
            ValueError,
            "force_by_qdot of magnet must come with a force",
        ),
    ],
)
def test_modules_of_ones_own_are_refused(given: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        md.Custom(**given, name="magnet")


@pytest.mark.parametrize(
    ("functions", "error", "message"),
    [
        ({"energy": lambda q: q}, ValueError, r"energy of magnet must return shape \(\)"),
        ({"force": lambda q, v: 1.0}, ValueError, r"force of magnet must return shape \(2,\)"),
        ({"energy": lambda q: "much"}, TypeError, "energy of magnet must return real numbers"),
        ({"energy": lambda q: np.sum(q) * np.nan}, ValueError, "magnet must give finite"),
        *(
            (
                {"energy": energy},
                ValueError,
                "energy of magnet must have its gradient by complex step",
            )
            for energy in (
                lambda q: 50.0 * np.abs(q[0]) ** 2,
                lambda q: q[0].real ** 2,
                lambda q: (q @ q.conj()).real,
                lambda q: np.maximum(np.abs(q[0]) - 0.05, 0.0) ** 2,
            )
        ),
        (
            {"force": lambda q, v: -np.abs(v) * v},
            ValueError,
            "force_by_qdot of magnet must be the force's derivative",
        ),
        (
            {"force": lambda q, v: -q, "force_by_q": lambda q, v: np.eye(2)},
            ValueError,
            "force_by_q of magnet must be the force's derivative",
        ),
        (
            {"energy": lambda q: math.sin(q[0])},
            ValueError,
            "energy of magnet must accept complex arrays",
        ),
    ],
)
def test_functions_of_ones_own_are_tried(functions: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        md.chain(PIPE, 4).plus(md.Custom(nodes=(2,), name="magnet", **functions))


def test_a_force_that_depends_on_places_alone_resists_no_velocity() -> None:
    plain = md.chain(pp.Pipe(0.0), 4)
    by_force = plain.plus(
        md.Custom(nodes=(3,), force=lambda q, v: np.array([-30.0 * q[0], 0.0 * q[1]]))
    )
    built_in = plain.plus(pp.Spring(0.75, 30.0))
    assert not by_force.resisted
    assert by_force.plus(own_spring(2, 0.0, 0.7)).resisted
    mine, theirs = (pp.crossings(scene, 8.0) for scene in (by_force, built_in))
    assert [(c.kind, c.mode) for c in mine] == [(c.kind, c.mode) for c in theirs]
    np.testing.assert_allclose([c.speed for c in mine], [c.speed for c in theirs], rtol=1e-10)


def test_modules_of_ones_own_are_alike_if_their_masses_are() -> None:
    light, heavy = (md.Custom(nodes=(1,), mass=m * np.eye(2)) for m in (1.0, 2.0))
    assert light != heavy
    assert light == md.Custom(nodes=(1,), mass=np.eye(2))


def test_parts_of_other_classes_are_refused() -> None:
    class Post(md.Guide):
        pass

    class Sail(md.Module):
        pass

    plain = md.chain(PIPE, 3)
    for part in (Post(2), Sail(), md.Module(), md.Constraint()):
        with pytest.raises(TypeError, match="must hold this package's parts"):
            plain.plus(part)


def test_the_description_of_a_scene_lists_its_parts() -> None:
    scene = md.chain(PIPE, 3).plus(md.TorsionalSpring(2, 1.0, rest_angle=0.4), md.Guide(3))
    assert "TorsionalSpring(joint=2, stiffness=1, rest_angle=0.4)" in repr(scene)
    assert "Guide(node=3)" in repr(scene)
    bent = md.chain(pp.Pipe(0.2), 3).about([0.1, 0.2, 0.3])
    assert "about array([0.1, 0.2, 0.3])" in repr(bent)
    assert "about" in repr(bent.plus(pp.PointMass(1.0, 0.1)))
    assert "about" not in repr(bent.plus(md.Guide(3)))


def test_dense_results_have_their_limits() -> None:
    with pytest.raises(ValueError, match="dense results need at most"):
        md.chain(pp.Pipe(0.2), 1400).jacobian(0.0, np.zeros(6 * 1400), 1.0)


def test_angles_are_found_though_segments_are_in_line_with_the_pin() -> None:
    scene = md.chain(pp.Pipe(0.2, damping=1e-3), 10).plus(md.Pin(2, 0.05, 0.15))
    angles = scene.admissible(np.zeros(10))
    np.testing.assert_allclose(scene.state(angles)[3:5], [0.05, 0.15], atol=1e-12)


def test_derivatives_that_are_given_need_no_complex_step() -> None:
    drag = md.Custom(
        nodes=(2,),
        force=lambda q, v: -np.abs(v) * v,
        force_by_q=lambda q, v: np.zeros((2, 2)),
        force_by_qdot=lambda q, v: np.diag(-2.0 * np.abs(v)),
        name="sail",
    )
    scene = md.chain(PIPE, 4).plus(drag)
    motion = pp.simulate(scene, 6.0, 1.0, wave, rtol=1e-8)
    assert motion.audit < 1e-5
    assert scene.power(motion.y[:, -1], 6.0).others < 0.0


# ------------------------------------------------------------------------------------ what all have


def test_scenes_are_immutable_and_plus_makes_another() -> None:
    scene = md.chain(PIPE, 4)
    more = scene.plus(md.PointMass(1.0, 0.1), md.Guide(4))
    assert scene.dof == 4
    assert scene.modules == more.modules
    assert scene.pipe.terms == ()
    assert more.pipe.terms == (pp.PointMass(1.0, 0.1),)
    assert more.dof == 3
    assert more.constraints[-1] == md.Guide(4)
    with pytest.raises(AttributeError):
        scene.dof = 3  # type: ignore[misc]
    with pytest.raises(AttributeError):
        more.constraints[-1].node = 2  # type: ignore[misc]


def test_elastic_coordinates_are_numbers_of_any_type() -> None:
    scene = md.chain(PIPE, 4).plus(md.Guide(3))
    whole = np.arange(6).reshape(3, 2)
    expected = scene.from_elastic(whole.astype(float))
    for kind in (int, np.longdouble, np.float32):
        np.testing.assert_allclose(scene.from_elastic(whole.astype(kind)), expected, rtol=1e-14)
    np.testing.assert_allclose(scene.from_elastic(1j * whole), 1j * expected, rtol=1e-14)


def test_another_pipe_reaches_every_part() -> None:
    mass = pp.PointMass(0.75, 0.2)
    pipe = pp.Pipe(0.1, -2.0, "aspirating", 0.8, 0.3, 0.02, terms=[mass])
    changed = md.chain(PIPE, 4).plus(pp.PointMass(1.0, 0.7)).with_pipe(pipe)
    fresh = md.chain(replace(pipe, terms=()), 4).plus(mass)
    assert changed.pipe == fresh.pipe == pipe
    y = fresh.state([0.1, 0.4, -0.3, 0.6], [1.0, -2.0, 0.5, 1.0])
    np.testing.assert_allclose(changed.rhs(0.0, y, 3.0), fresh.rhs(0.0, y, 3.0), rtol=1e-13)
    np.testing.assert_allclose(pp.eigenvalues(changed, 3.0), pp.eigenvalues(fresh, 3.0))


def test_what_nothing_balances_is_no_equilibrium() -> None:
    """The inclined jet turns the second segment, which hangs on a joint without a spring.

    About that joint its moment is u^2 sin(.5) l, whatever the angle, unless weight resists it.
    """

    def scene(gamma: float) -> md.Assembly:
        parts = [md.Segment(0.5), md.Segment(0.5), md.TorsionalSpring(1, 2.0), md.InternalFlow()]
        return md.Assembly(pp.Pipe(0.2, gamma, jet_angle=0.5), parts, [md.Clamp(), md.Joint(2)])

    with pytest.raises(pp.NotConverged, match="is left in a direction in which nothing resists"):
        scene(0.0).equilibrium([0.0, 0.0], 3.0)
    q = scene(40.0).equilibrium([0.0, 0.0], 3.0)
    moment = 9.0 * math.sin(0.5) * 0.5 + 40.0 * 0.5**2 / 2.0 * math.sin(q[2] + q[5])
    assert moment == pytest.approx(0.0, abs=1e-7)


def test_a_point_mass_weighs_and_a_rest_angle_bends() -> None:
    heavy = md.chain(pp.Pipe(0.2, 10.0), 3).plus(pp.PointMass(1.0, 0.5))
    turned = heavy.state([0.5, 0.5, 0.5])
    light = md.chain(pp.Pipe(0.2, 10.0), 3)
    lifted = 0.5 * 10.0 * (1.0 - math.cos(0.5))
    assert heavy.energy(turned) - light.energy(turned) == pytest.approx(lifted, rel=1e-12)
    bent = md.Assembly(
        pp.Pipe(0.2),
        [
            md.Segment(0.5),
            md.Segment(0.5),
            md.TorsionalSpring(1, 2.0, rest_angle=0.4),
            md.TorsionalSpring(2, 3.0, rest_angle=-0.7),
            md.InternalFlow(),
        ],
        [md.Clamp(), md.Joint(2)],
    )
    q = bent.equilibrium([0.0, 0.0])
    np.testing.assert_allclose(bent.angles(q), [0.4, -0.3], atol=1e-12)
    assert bent.energy(np.concatenate([q, np.zeros(6)])) == pytest.approx(
        -0.5 * (2.0 * 0.4**2 + 3.0 * 0.7**2), rel=1e-12
    )


def test_without_internal_flow_the_speed_does_nothing() -> None:
    plain = md.chain(PIPE, 3)
    still = md.Assembly(
        PIPE, [m for m in plain.modules if not isinstance(m, md.InternalFlow)], plain.constraints
    )
    y = still.state([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(still.rhs(0.0, y, 0.0), still.rhs(0.0, y, 9.0))
    assert still.power(y, 9.0).flow == 0.0
    assert not pp.crossings(still, 10.0)


def test_motions_of_scenes_are_plotted_though_their_ends_are_held() -> None:
    pipe = pp.Pipe(0.2, 2.0, drag=0.2)
    guided = md.chain(pipe, 4).plus(md.Guide(4))
    arch = md.chain(pipe, 4).plus(md.Pin(4, 0.0, 0.9))
    for scene in (guided, arch):
        start = scene.bent(lambda s: 0.4 * np.sin(2.0 * math.pi * s))
        motion = pp.simulate(scene, 2.0, 2.0, start, samples=801)
        axes = [
            plot.time_history(motion),
            plot.phase_portrait(motion, 3),
            plot.phase_portrait(motion, 11),
            plot.snapshots(motion, count=5),
        ]
        assert np.ptp(axes[0].lines[0].get_ydata()) < 1e-9
        assert np.ptp(axes[1].lines[0].get_xdata()) > 1e-3
        assert axes[3].dataLim.width > 0.02
    with pytest.raises(ValueError, match="coordinate must be from 0 to 11, got 12"):
        plot.phase_portrait(motion, 12)


def test_a_stability_curve_of_scenes_is_one_of_models() -> None:
    masses = np.array([0.05, 0.1, 0.2])
    curve = pp.stability_curve(lambda m: md.chain(PIPE, 6).plus(pp.PointMass(1.0, m)), masses)
    direct = [pp.critical_speed(md.chain(PIPE, 6).plus(pp.PointMass(1.0, m))).speed for m in masses]
    np.testing.assert_allclose([c.speed for c in curve.critical], direct, rtol=1e-12)
    assert not curve.failures


def test_scenes_serve_processes() -> None:
    scene = md.chain(PIPE, 3).plus(md.Guide(3), pp.PointMass(2.0 / 3.0, 0.1))
    _ = scene.core, scene.linear  # which go along
    start = scene.bent(lambda s: 0.3 * np.sin(2.0 * math.pi * s))
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        many = pp.simulate_many(scene, [1.0, 2.0], 0.2, start, samples=5, executor=pool)
    alone = pp.simulate_many(scene, [1.0, 2.0], 0.2, start, samples=5)
    for a, b in zip(many.motions, alone.motions, strict=True):
        np.testing.assert_array_equal(a.q, b.q)


# -------------------------------------------------------------------------------- what does not fit


def scene(*parts: Any) -> Callable[[], Any]:
    return lambda: md.chain(pp.Pipe(0.2), 4).plus(*parts)


SEGMENTS = [md.Segment(0.5), md.Segment(0.5)]


def lone_end() -> md.Assembly:
    """Its last segment has no inertia but that of a point mass."""
    last = md.Segment(0.5, centre=0.0, gyration_radius=0.0)
    return md.Assembly(PIPE, [SEGMENTS[0], last, pp.PointMass(1.0, 0.1)], [md.Clamp(), md.Joint(2)])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (scene(pp.PointMass(1.25, 0.1)), "terms[0].at must lie in (0, 1], got 1.25"),
        (scene(md.TorsionalSpring(7, 1.0)), "joint must be at most 4, the number of segments"),
        (scene(md.Joint(5)), "Joint(segment=5): segment must be at most 4"),
        (scene(md.Guide(9)), "Guide(node=9): node must be at most 4"),
        (lambda: scene(md.Custom(nodes=(6,), energy=np.sum))(), "Custom: nodes must be at most 4"),
        (lambda: md.Segment(0.0), "length of Segment must lie in [1e-07, 1], got 0.0"),
        (lambda: md.Assembly(PIPE, [], []), "modules must hold at least one Segment, got none"),
        (
            lambda: md.Assembly(PIPE, SEGMENTS, [md.Joint(2)]),
            "constraints must hold a Clamp: without it phi_1 moves without inertia",
        ),
        (
            lambda: md.Assembly(PIPE, SEGMENTS, [md.Clamp()]),
            "constraints must hold Joint(segment=2): without it phi_2 moves without inertia",
        ),
        (
            lambda: md.Assembly(PIPE, SEGMENTS[:1], [md.Clamp()]),
            "the base and the segments' lengths must add up to 1, got 0.5",
        ),
        (
            scene(md.Clamp(0.1)),
            "constraints contradict one another: Clamp(base=0) and Clamp(base=0.1)",
        ),
        (
            scene(md.Pin(4, 0.0, 0.9), md.Pin(4, 0.1, 0.9)),
            "constraints contradict one another: Pin(node=4, x=0, y=0.9) and Pin(node=4, x=0.1,",
        ),
        (
            scene(md.Guide(3), md.Pin(3, 0.2, 0.6)),
            "constraints contradict one another: Guide(node=3) and Pin(node=3, x=0.2, y=0.6)",
        ),
        (scene(md.Pin(4, 0.0, 1.2)), "Pin(node=4, x=0, y=1.2) cannot be met, the closest found"),
        (
            scene(md.Pin(2, 0.0, 0.4), md.Pin(4, 0.9, 0.4)),
            "Pin(node=4, x=0.9, y=0.4) cannot be met",
        ),
        (scene(md.Pin(4, 0.0, 1.0)), "must leave some slack, got a span that is taut"),
        (scene(md.Pin(2, 0.3, 0.4)), "Pin(node=2, x=0.3, y=0.4) must leave some slack"),
        (
            scene(*(md.Guide(j) for j in range(1, 5))),
            "must leave something that moves, got nothing",
        ),
        (
            lambda: md.Assembly(
                PIPE,
                [md.Segment(0.5), md.Segment(0.5, centre=0.0, gyration_radius=0.0)],
                [md.Clamp(), md.Joint(2)],
            ),
            "phi_2 moves without inertia of the pipe: give its segment a gyration radius",
        ),
        (scene(md.Drag()), "modules must hold at most one Drag, got 2"),
        (
            lambda: lone_end().with_pipe(PIPE),
            "phi_2 moves without inertia of the pipe: give its segment a gyration radius",
        ),
    ],
)
def test_what_does_not_fit_is_named(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: md.Assembly(PIPE, [md.Clamp()], []), "modules must hold modules and terms only"),
        (lambda: md.Assembly(PIPE, SEGMENTS, SEGMENTS), "constraints must hold constraints only"),
        (scene("mass"), "parts must be modules, constraints or terms, got 'mass'"),
        (
            lambda: md.chain(PIPE, 3, length=[1.0]),
            "has no argument 'length': did you mean 'lengths'?",
        ),
    ],
)
def test_what_is_no_part_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(TypeError, match=re.escape(message)):
        make()


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda m: m.rhs(0.0, np.zeros(7), 1.0), "y must have shape (18,)"),
        (lambda m: m.rhs(0.0, np.zeros(18), -1.0), "u must lie in"),
        (lambda m: m.angles(np.zeros(7)), "y must have shape (9, ...), got (7,)"),
        (lambda m: m.operators(np.zeros(4)), "q must have 3 or 9 entries, got 4"),
        (lambda m: m.about(None), "q must be an array of real numbers, got None"),
        (lambda m: m.deflection(np.zeros(4), [0.5]), "q must have shape (3, ...) or (9, ...), got"),
        (lambda m: m.tips(np.zeros((4, 1))), "q must have shape (9, ...), got (4, 1)"),
    ],
)
@pytest.mark.parametrize("own", [False, True])
def test_bad_questions_are_refused(ask: Callable[[Any], Any], message: str, own: bool) -> None:
    model = md.chain(PIPE, 3)
    if own:
        model = model.plus(own_spring(2, 1.0, 0.1))
    with pytest.raises((ValueError, TypeError), match=re.escape(message)):
        ask(model)
