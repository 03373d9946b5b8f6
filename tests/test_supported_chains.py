# SPDX-License-Identifier: MIT
"""Chains and scenes whose pipe is held: a root that gives, supports, an end that is held."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import redundant
import scipy.linalg
import scipy.optimize
import scipy.special

import pipedyn as pp
from pipedyn import modular as md

Array = np.ndarray

HELD: dict[str, dict[str, object]] = {
    "root spring": {"root": pp.RootSpring(3.0)},
    "hinge": {"root": "pinned"},
    "pinned": {"end": "pinned"},
    "clamped": {"end": "clamped"},
    "guided": {"end": "guided"},
    "spans": {"root": pp.RootSpring(2.0), "end": "clamped", "supports": (0.3, 0.7)},
    "two spans": {"root": "pinned", "end": "pinned", "supports": (0.5,)},
    "overhang": {"supports": (0.625,)},
    "stretched": {"end": "pinned", "terms": (pp.Damper(0.3, 0.4), pp.Stretching(30.0))},
}
IN_MOTION = {**HELD, "jet": {"end": "guided", "jet_angle": 0.4}}
RICH = pp.Pipe(
    0.3,
    4.0,
    drag=0.3,
    damping=0.01,
    terms=(pp.Spring(0.6, 5.0), pp.PointMass(0.45, 0.2), pp.Damper(0.3, 0.4)),
)


def held(name: str, pipe: pp.Pipe = RICH) -> pp.Pipe:
    return replace(pipe, **IN_MOTION[name])


# ------------------------------------------------------------------------------- a root that gives


def frequencies(pipe: pp.Pipe, count: int, n: int, **chain: object) -> Array:
    values = pp.eigenvalues(pp.Chain(pipe, n, **chain), 0.0, 2 * count + 2)
    upper = np.sort(values.imag[values.imag > 1e-3])
    return np.asarray(upper[:count])


def test_a_stiff_hanging_hose_swings_as_a_rod() -> None:
    # omega^2 = gamma (1/2) / (1/3) while the weight is small beside the bending stiffness
    pipe = pp.Pipe(0.2, 1e-4, root="pinned")
    lowest = np.abs(pp.eigenvalues(pp.Chain(pipe, 20), 0.0, 2))
    np.testing.assert_allclose(lowest, math.sqrt(1.5e-4), rtol=1e-5)


@pytest.mark.parametrize(
    ("springs", "order"),  # a uniform spring at the root is half of what bends half a segment
    [("consistent", 2.0), ("uniform", 1.0), ("frequency", 1.0)],
)
def test_which_rules_keep_second_order_on_a_root_spring(springs: str, order: float) -> None:
    pipe = pp.Pipe(0.2, root=pp.RootSpring(2.0))
    first, second, third = (frequencies(pipe, 1, n, springs=springs)[0] for n in (20, 40, 80))
    found = math.log2(abs((first - second) / (second - third)))
    assert found == pytest.approx(order, abs=0.12)


def test_damping_in_series_with_a_root_spring_is_that_of_the_material_to_first_order() -> None:
    def series(delta: float) -> complex:
        """Lowest root of two segments whose first joint is 1 / (1 / (k (1 + delta l)) + 1 / kr)."""
        free = pp.Chain(pp.Pipe(0.0), 2, springs=[0.0, 1.7]).operators()
        bend = np.array([[1.0, -1.0], [-1.0, 1.0]])
        value = 1j * abs(pp.eigenvalues(pp.Chain(pp.Pipe(0.0), 2, springs=[0.8, 1.7]), 0.0)[0])

        def determinant(at: complex) -> complex:
            material = 1.0 + delta * at
            first = 1.0 / (1.0 / (2.4 * material) + 1.0 / 1.2)
            joints = 1.7 * material * bend + np.diag([first, 0.0])
            return complex(np.linalg.det(at**2 * free.mass + joints))

        return scipy.optimize.newton(determinant, value, tol=1e-8)

    off = []
    for delta in (2e-3, 1e-3):
        pipe = pp.Pipe(0.0, damping=delta, root=pp.RootSpring(1.2))
        values = pp.eigenvalues(pp.Chain(pipe, 2, springs=[2.4, 1.7]), 0.0)
        off.append(abs(series(delta) - values[values.imag > 0.0][0]))
        assert off[-1] < 0.1 * abs(series(delta).real)
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.05)


# ------------------------------------------------------------------------------------------ scenes


def state(chain: pp.Chain) -> tuple[Array, Array]:
    """Angles and rates that keep to the supports."""
    rng, n = np.random.default_rng(3), chain.coordinates
    return chain.onto_constraints(chain.admissible(0.4 * rng.normal(size=n)), rng.normal(size=n))


@pytest.mark.parametrize("name", list(HELD))
def test_the_scene_of_a_held_chain_has_its_numbers(name: str) -> None:
    chain, scene = pp.Chain(held(name), 8), md.chain(held(name), 8)
    on_axis = chain.pipe.end in ("pinned", "clamped")
    assert scene.dof == chain.dof == 8 - len(chain.pipe.supports) - on_axis
    found = pp.eigenvalues(chain, 2.0, 6)
    np.testing.assert_array_equal(pp.eigenvalues(scene, 2.0, 6), found)
    for model in (chain, scene):  # by recursion, and by matrices in other coordinates
        mass, damping, stiffness = model.operators().at(2.0)
        zero, one = np.zeros_like(mass), np.eye(len(mass))
        values = scipy.linalg.eigvals(
            np.block([[zero, one], [-stiffness, -damping]]), scipy.linalg.block_diag(one, mass)
        )
        for value in found:
            assert np.abs(values - value).min() < 1e-11 * (1.0 + abs(value))
    theta, omega = state(chain)
    y, own = scene.state(theta, omega), np.append(theta, omega)
    turning = np.cumsum(scene.rhs(0.0, y, 2.0).reshape(2, 8, 3)[:, :, 2], axis=1).ravel()
    np.testing.assert_allclose(turning, chain.rhs(0.0, own, 2.0), rtol=1e-9, atol=1e-9)
    dense = redundant.accelerations(scene, y, 2.0)  # M q'' = f with all constraints
    np.testing.assert_allclose(dense, scene.rhs(0.0, y, 2.0)[24:], atol=1e-9 * np.abs(dense).max())
    assert scene.energy(y) == pytest.approx(chain.energy(own), rel=1e-13)


@pytest.mark.parametrize("name", ["pinned", "spans", "guided", "stretched"])
def test_operators_about_a_bent_held_pipe_are_the_derivatives_of_its_forces(name: str) -> None:
    u, pipe = 8.0, replace(held(name), beta=0.2, jet_angle=0.3)
    chain, scene = pp.Chain(pipe, 8), md.chain(pipe, 8)
    found = pp.equilibria(chain, u)
    q = found.q[np.argmax(np.abs(found.q).max(axis=1))]
    assert np.abs(q).max() > 0.3
    whole = chain.jacobian(0.0, np.append(q, np.zeros(8)), u)[8:, :8]
    bent, places = chain.about(q), scene.state(q)[:24]
    for model, at in ((chain, q), (scene, places), (bent, None)):
        free = model.basis(at)
        mass, _, stiffness = model.operators(at).at(u)
        np.testing.assert_allclose(
            -mass @ (free.T @ whole @ free), stiffness, atol=1e-9 * np.abs(stiffness).max()
        )
    pushed = np.append(1.0, np.zeros(6))  # a change of the flow speed by s u' = 1

    def moments(theta: np.ndarray) -> np.ndarray:
        y = scene.core.redundant(np.append(theta, 0.0 * theta))
        push = redundant.forces(scene, y, 0.0, pushed) - redundant.forces(scene, y, 0.0)
        return scene._layout.moments(theta, push[:, None])[:, 0]

    rows, scale = chain._held_rows, chain.elastic_scale[:, None] * np.tri(8).T
    holding = np.linalg.lstsq(scale @ rows(q), -scale @ moments(q), rcond=None)[0]
    by_push = [
        [1e5 * (moments(q + h) + rows(q + h) @ holding) for h in 5e-6 * side * np.eye(8)]
        for side in (1.0, -1.0)
    ]
    free, by_push = chain.basis(q), np.subtract(*by_push).T
    for model, at in ((chain, q), (scene, places)):
        np.testing.assert_allclose(
            model.operators(at).unsteady, -free.T @ by_push @ free, atol=1e-9
        )
    values = pp.eigenvalues(bent, u, 4)
    np.testing.assert_allclose(pp.eigenvalues(scene.about(places), u, 4), values, rtol=1e-9)
    slow, fast = (
        pp.modes(model, u, 2).shapes[0](np.array([0.6])) for model in (bent, scene.about(places))
    )
    assert slow == pytest.approx(fast, rel=1e-8)


def test_a_scene_remade_for_another_pipe_is_held_as_that_pipe_is() -> None:
    scene = md.chain(held("spans"), 10)
    other = scene.with_pipe(replace(RICH, supports=(0.3,), root="pinned", end="guided"))
    assert (scene.dof, other.dof) == (7, 9)
    assert scene.plus(md.Guide(2)).dof == 6
    assert md.chain(held("guided"), 4).with_pipe(RICH).modules == md.chain(RICH, 4).modules
    same = pp.Chain(held("spans"), 10).with_pipe(other.pipe)
    np.testing.assert_allclose(
        pp.eigenvalues(other, 1.0, 4), pp.eigenvalues(same, 1.0, 4), rtol=1e-12
    )


# ------------------------------------------------------------------------------------------ motion


@pytest.mark.parametrize("name", list(IN_MOTION))
def test_rates_of_held_chains(name: str) -> None:
    """They keep to the supports, and together are what each is."""
    chain, u = pp.Chain(held(name), 8), 2.5
    y = np.concatenate(state(chain))
    rates, h = chain.rhs(0.0, y, u), 1e-4
    moved = np.split(y + h * rates, 2)
    size = np.abs(rates).max()
    assert np.abs(chain.onto_constraints(*moved)[0] - moved[0]).max() < 3.0 * (h * size) ** 2
    pair = np.stack([y, np.concatenate(chain.onto_constraints(*np.split(0.9 * y, 2)))], axis=1)
    together = chain.rhs(0.0, pair, np.array([u, 1.0]))
    np.testing.assert_allclose(together[:, 0], rates, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", list(IN_MOTION))
@pytest.mark.parametrize("method", ["dop853", "radau"])
def test_motions_of_held_chains_balance_energy_and_keep_to_supports(name: str, method: str) -> None:
    chain = pp.Chain(held(name), 8)
    motion = pp.simulate(
        chain, 2.5, 1.0, lambda s: 0.4 * np.sin(5.0 * s), samples=21, rtol=1e-9, method=method
    )
    assert motion.audit < 2e-8
    across = np.cumsum(chain.lengths * np.sin(motion.q), axis=1)
    for place in (*chain.pipe.supports, *[1.0] * (chain.pipe.end in ("pinned", "clamped"))):
        node = int(np.argmin(np.abs(np.cumsum(chain.lengths) - place)))
        assert np.abs(across[:, node]).max() < 1e-12


def test_a_branch_of_buckled_shapes_leaves_where_the_pipe_diverges() -> None:
    chain = pp.Chain(pp.Pipe(0.3, end="clamped"), 12)
    branch = pp.equilibrium_branch(chain, np.zeros(12), 6.0, (6.0, 7.0))
    pitchforks = [point for point in branch.points if point.kind == "pitchfork"]
    assert pitchforks[0].speed == pytest.approx(pp.critical_speed(chain).speed, rel=1e-7)


def test_an_overhanging_pipe_flutters_in_a_limit_cycle() -> None:
    pipe = pp.Pipe(0.2, damping=0.01, supports=[0.25])
    chain, scene = pp.Chain(pipe, 8), md.chain(pipe, 8)
    onset = pp.critical_speed(chain)
    assert onset.kind == "flutter"
    first, second = (pp.limit_cycle(model, 1.02 * onset.speed) for model in (chain, scene))
    assert first.amplitude == pytest.approx(second.amplitude, rel=1e-6)
    assert first.frequency == pytest.approx(onset.frequency, rel=0.05)
    assert len(first.multipliers) == 2 * chain.dof


# --------------------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: pp.Chain(held("pinned"), 1), "must leave something that moves: n must be at"),
        (lambda: pp.Chain(held("spans"), 2), "n must be at least 3, a segment for each span"),
        (lambda: pp.Chain(held("spans"), 3), "must leave something that moves"),
        (lambda: pp.Chain(held("overhang"), lengths=[0.5, 0.5]), "end at each support, got none"),
        (lambda: pp.Chain(held("overhang"), 4, base=0.7), "base must end before the first"),
        (lambda: pp.Chain(held("hinge"), 4, base=0.1), "base must be 0 unless the root is clamped"),
        (lambda: pp.Chain(held("hinge"), 4, springs="midpoint"), "'midpoint' is made for"),
        (lambda: pp.Chain(held("clamped"), 4, springs="midpoint"), "'midpoint' is made for"),
        (lambda: pp.Chain(held("clamped"), 2, springs=[1.0, 2.0]), "springs must have"),
        (lambda: pp.Chain(RICH, springs=[1.0, 2.0]).with_pipe(held("guided")), "have 3 entries"),
        (lambda: pp.Chain(RICH, 4).with_pipe(held("spans")), "must end at each support"),
        (lambda: md.chain(RICH, 4).with_pipe(held("overhang")), "must end at each support"),
        (lambda: md.chain(RICH, 4).with_pipe(held("guided")), r"TorsionalSpring\(joint=5\)"),
        (lambda: md.chain(RICH, 4, base=0.1).with_pipe(held("hinge")), "base of Clamp must be 0"),
        (lambda: md.chain(RICH, 4).plus(md.TorsionalSpring(5, 1.0)), "joint must be at most 4"),
        (
            lambda: md.chain(held("guided"), 4).plus(md.TorsionalSpring(5, 1.0, rest_angle=0.1)),
            "rest_angle of a guided end must be 0",
        ),
    ],
)
def test_chains_that_do_not_fit_their_supports_are_refused(
    made: Callable[[], object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        made()


def test_states_that_miss_a_support_are_refused() -> None:
    chain = pp.Chain(held("pinned"), 4)
    with pytest.raises(ValueError, match=r"q0 must meet the support at s = 1, got a deviation"):
        pp.simulate(chain, 1.0, 1.0, [0.1, 0.0, 0.0, 0.0])
    met = chain.admissible([0.1, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="qdot0 must keep the support at s = 1"):
        pp.simulate(chain, 1.0, 1.0, met, [1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"q must meet the support .* admissible\(q\) does"):
        chain.operators([0.1, 0.0, 0.0, 0.0])
    assert pp.simulate(chain, 1.0, 0.1, met).q.shape[1] == 4
