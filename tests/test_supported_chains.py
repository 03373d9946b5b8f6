# SPDX-License-Identifier: MIT
"""Chains and scenes whose pipe is held: a root that gives, supports, an end that is held."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import redundant
import scipy.linalg
import scipy.special
from independent import series_newton_step

import pipedyn as pp
from pipedyn import modular as md
from pipedyn.equilibrium.equilibria import Statics

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


def converged(of: Callable[[int], object], sizes: tuple[int, ...] = (20, 40, 80)) -> Array:
    """What tends to a limit with second order, or fourth, from three sizes."""
    values = np.array([of(n) for n in sizes], dtype=np.float64)
    steps = np.diff(values, axis=0)
    assert (np.log2(np.abs(steps[0] / steps[1])) > 1.96).all()
    once = values[1:] + steps / 3.0
    return np.asarray(once[1] + (once[1] - once[0]) / 15.0)


# ------------------------------------------------------------------------------- a root that gives


@pytest.mark.parametrize(
    ("stiffness", "speed", "frequency"),  # physics-2: determinants and Legendre functions
    [(0.5, 5.237511, 5.58395), (2.0, 5.040909, 8.23630), (100.0, 5.538008, 13.44585)],
)
def test_flutter_of_a_pipe_on_a_root_spring(
    stiffness: float, speed: float, frequency: float
) -> None:
    def flutter(n: int) -> tuple[float, float]:
        pipe = pp.Pipe(0.2, root=pp.RootSpring(stiffness))
        found = pp.critical_speed(pp.Chain(pipe, n))
        return found.speed, found.frequency

    found = converged(flutter)
    assert found[0] == pytest.approx(speed, abs=1e-6)
    assert found[1] == pytest.approx(frequency, abs=1e-5)


def frequencies(pipe: pp.Pipe, count: int, n: int, **chain: object) -> Array:
    values = pp.eigenvalues(pp.Chain(pipe, n, **chain), 0.0, 2 * count + 2)
    upper = np.sort(values.imag[values.imag > 1e-3])
    return np.asarray(upper[:count])


def test_a_hinged_free_pipe_vibrates_as_the_beam_does_about_its_rigid_rotation() -> None:
    # tan k = tanh k
    found = converged(partial(frequencies, pp.Pipe(0.2, root="pinned"), 2))
    np.testing.assert_allclose(found, [3.92660231**2, 7.06858275**2], rtol=3e-7)
    assert abs(pp.eigenvalues(pp.Chain(pp.Pipe(0.2, root="pinned"), 20), 0.0, 2)).max() == 0.0


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

        for _ in range(30):
            h = 1e-6 * abs(value)
            slope = (determinant(value + h) - determinant(value - h)) / (2.0 * h)
            value -= determinant(value) / slope
        return value

    off = []
    for delta in (2e-3, 1e-3):
        pipe = pp.Pipe(0.0, damping=delta, root=pp.RootSpring(1.2))
        values = pp.eigenvalues(pp.Chain(pipe, 2, springs=[2.4, 1.7]), 0.0)
        off.append(abs(series(delta) - values[values.imag > 0.0][0]))
        assert off[-1] < 0.1 * abs(series(delta).real)
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.05)


def test_what_moves_a_crossing_on_a_root_spring_is_its_difference() -> None:
    springs, pipe = np.array([3.0, 9.0, 8.0, 7.0]), pp.Pipe(0.3, damping=0.02)
    pipe = replace(pipe, root=pp.RootSpring(5.0))

    def speed(k: Array, pipe: pp.Pipe = pipe) -> float:
        return pp.critical_speed(pp.Chain(pipe, springs=k)).speed

    by = pp.critical_speed(pp.Chain(pipe, springs=springs)).sensitivity
    assert by is not None
    steps = 1e-4 * np.diag(springs)
    rates = [(speed(springs + s) - speed(springs - s)) / (2.0 * s.sum()) for s in steps]
    np.testing.assert_allclose(by.speed.springs, rates, rtol=1e-5)
    more, less = (replace(pipe, damping=0.02 + s) for s in (1e-5, -1e-5))
    rate = (speed(springs, more) - speed(springs, less)) / 2e-5
    assert by.speed.damping == pytest.approx(rate, rel=1e-5)


# ------------------------------------------------------------------------- supports and held ends


def divergences(pipe: pp.Pipe, end: float, n: int) -> list[float]:
    return [c.speed for c in pp.crossings(pp.Chain(pipe, n), end)]


@pytest.mark.parametrize(
    ("root", "end", "expected"),  # closed forms: book sec. 3.4, physics-2
    [
        ("pinned", "pinned", (math.pi, 2.0 * math.pi, 3.0 * math.pi)),
        ("clamped", "clamped", (2.0 * math.pi, 8.98681892, 4.0 * math.pi)),
        ("clamped", "pinned", (4.49340946, 7.72525184, 10.90412166)),
        ("clamped", "guided", (math.pi, 2.0 * math.pi, 3.0 * math.pi)),
        ("pinned", "guided", (0.5 * math.pi, 1.5 * math.pi, 2.5 * math.pi)),
    ],
)
def test_divergence_of_held_pipes(root: str, end: str, expected: tuple[float, ...]) -> None:
    pipe = pp.Pipe(0.0, root=root, end=end)
    found = converged(partial(divergences, pipe, 1.02 * expected[-1]), (30, 60, 120))
    np.testing.assert_allclose(found, expected, rtol=2e-8)


@pytest.mark.parametrize(("stiffness", "speed"), [(100.0, 4.47232856), (300.0, 6.34554643)])
def test_a_foundation_raises_the_divergence_of_a_pinned_pipe(
    stiffness: float, speed: float
) -> None:
    # u = n pi sqrt(1 + k / (n pi)^4), of one half wave and of two
    terms = (pp.Foundation(stiffness),)
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", terms=terms)
    found = converged(lambda n: pp.critical_speed(pp.Chain(pipe, n)).speed)
    assert found == pytest.approx(speed, rel=3e-8)


@pytest.mark.parametrize(
    ("root", "end", "beta", "speed", "frequency"),  # physics-2: Legendre functions
    [
        ("pinned", "pinned", 0.5, 6.303883, 6.7116),
        ("clamped", "clamped", 0.3, 9.081050, 13.3895),
        ("clamped", "clamped", 0.5, 9.294579, 17.0723),
        ("clamped", "pinned", 0.5, 7.774398, 9.7617),
    ],
)
def test_held_pipes_diverge_recover_and_flutter_in_coupled_modes(
    root: str, end: str, beta: float, speed: float, frequency: float
) -> None:
    pipe = pp.Pipe(beta, root=root, end=end)

    def found(n: int) -> Array:
        crossings = pp.crossings(pp.Chain(pipe, n), 1.01 * speed)
        assert [c.kind for c in crossings] == ["divergence", "divergence", "flutter"]
        assert [c.unstable_after for c in crossings] == [1, 0, 2]
        return np.array([crossings[-1].speed, crossings[-1].frequency])

    limit = converged(found)
    assert limit[0] == pytest.approx(speed, abs=1e-6)
    assert limit[1] == pytest.approx(frequency, abs=1e-4)


def test_without_recovery_two_unstable_roots_meet_and_flutter() -> None:
    pipe = pp.Pipe(0.1, root="pinned", end="pinned")

    def meeting(n: int) -> float:
        *_, coupled = pp.crossings(pp.Chain(pipe, n), 6.5)
        return coupled.speed

    assert converged(meeting) == pytest.approx(6.394115, abs=1e-6)
    chain = pp.Chain(pipe, 40)
    found = pp.crossings(chain, 6.5)
    assert [c.unstable_after for c in found] == [1, 2, 2]
    before, after = (pp.eigenvalues(chain, found[-1].speed + off, 4) for off in (-1e-6, 1e-6))
    assert np.abs(before.imag).max() == 0.0
    assert np.sum((after.real > 0.1) & (after.imag > 1e-4)) == 1


@pytest.mark.parametrize(
    ("root", "end", "u", "expected"),  # physics-2
    [
        ("clamped", "clamped", 4.0, (16.30777486, 56.12714690)),
        ("pinned", "pinned", 2.0, (7.45357311, 37.63213422)),
    ],
)
def test_frequencies_below_divergence(
    root: str, end: str, u: float, expected: tuple[float, float]
) -> None:
    def found(n: int) -> Array:
        values = pp.eigenvalues(pp.Chain(pp.Pipe(0.5, root=root, end=end), n), u, 4)
        assert np.abs(values.real).max() < 1e-9
        return np.sort(values.imag[values.imag > 0.0])

    np.testing.assert_allclose(converged(found, (40, 80, 160)), expected, rtol=2e-8)


@pytest.mark.parametrize(
    ("place", "speed", "frequency", "kind"),  # physics-2; the first by the determinant of two spans
    [
        (0.25, 6.99934118, 20.70480215, "flutter"),
        (0.5, 8.98681, 0.0, "divergence"),
        (0.75, 5.991212, 0.0, "divergence"),
    ],
)
def test_a_support_decides_how_an_overhanging_pipe_loses_stability(
    place: float, speed: float, frequency: float, kind: str
) -> None:
    def found(n: int) -> Array:
        critical = pp.critical_speed(pp.Chain(pp.Pipe(0.2, supports=[place]), n))
        assert critical.kind == kind
        return np.array([critical.speed, critical.frequency])[: 1 + (kind == "flutter")]

    limit = converged(found)
    assert limit[0] == pytest.approx(speed, rel=1e-6)
    if kind == "flutter":
        assert limit[1] == pytest.approx(frequency, abs=1e-4)


@pytest.mark.parametrize("end", ["free", "guided", "pinned", "clamped"])
@pytest.mark.parametrize("root", ["clamped", "pinned", pp.RootSpring(7.0)])
def test_eigenvalues_in_flow_are_those_of_power_series(end: str, root: pp.RootSpring | str) -> None:
    pipe, u = pp.Pipe(0.4, root=root, end=end), 1.3

    def found(n: int) -> Array:
        values = pp.eigenvalues(pp.Chain(pipe, n), u, 8)
        second = np.sort_complex(1j * values[values.imag > 5.0])[-2] / 1j
        parts = np.array([second.imag, second.real])
        return parts[: 1 + (abs(second.real) > 1e-9)]

    imag, *real = converged(found, (40, 80, 160))
    value = complex(sum(real), imag)
    assert abs(series_newton_step(pipe, value, u)) < 1e-6 * abs(value)


def test_supports_go_with_what_varies_along_the_pipe() -> None:
    pipe = pp.Pipe(
        *(0.2, 5.0),
        **{"stiffness": lambda s: 1.0 - 0.5 * s, "mass": lambda s: 1.0 + 0.3 * s},
        terms=(pp.AddedMass(0.4),),
        **{"root": pp.RootSpring(3.0), "end": "clamped", "supports": (0.4,)},
    )

    def found(model: pp.Model) -> Array:
        return np.unique(np.abs(pp.eigenvalues(model, 2.0, 4).imag).round(12))

    expected = found(pp.Galerkin(pipe, 20, "legendre"))
    np.testing.assert_allclose(converged(lambda n: found(pp.Chain(pipe, n))), expected, rtol=2e-6)


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
        y = scene.core.from_angles(theta, 0.0 * theta)
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


@pytest.mark.parametrize(
    ("held", "angle"),  # starts without a jump of the moment, which would spoil the order
    [
        ({"root": "pinned", "end": "pinned"}, lambda s: 0.9 * np.cos(math.pi * s)),
        ({"root": "pinned", "end": "guided"}, lambda s: 0.9 * np.cos(0.5 * math.pi * s)),
        ({"end": "clamped"}, lambda s: 0.9 * np.sin(2.0 * math.pi * s)),
        (
            {"root": "pinned", "end": "pinned", "supports": (0.5,)},
            lambda s: 0.9 * np.cos(2.0 * math.pi * s),
        ),
        (
            {"root": "pinned", "end": "pinned", "terms": (pp.Stretching(60.0),)},
            lambda s: 0.9 * np.cos(math.pi * s),
        ),
    ],
)
def test_large_motions_of_held_chains_tend_to_the_reduced_models(
    held: dict[str, object], angle: Callable[[Array], Array]
) -> None:
    pipe = pp.Pipe(0.3, 6.0, damping=0.01, **{"terms": (pp.AddedMass(0.3),)} | held)

    def end(model: pp.Model) -> Array:
        """How far down the end is, at two times."""
        motion = pp.simulate(model, 3.0, 0.1, angle, samples=3, rtol=1e-9)
        return np.array([model.shape(q, [1.0])[0, 1] for q in motion.q[1:]])

    expected = end(pp.Galerkin(pipe, 16, "legendre"))
    assert np.abs(expected - 1.0).max() > 0.02
    found = converged(lambda n: end(pp.Chain(pipe, n)), (40, 80, 160))
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_a_pinned_pipe_slides_and_buckles_as_the_elastica() -> None:
    u, pipe = 3.4, pp.Pipe(0.3, root="pinned", end="pinned")
    low, high = 0.1, 1.5
    for _ in range(60):  # u^2 cos th = 4 K(sin(th / 2))^2, th at the ends
        at = 0.5 * (low + high)
        bent = u**2 * math.cos(at) > 4.0 * scipy.special.ellipk(math.sin(0.5 * at) ** 2) ** 2
        low, high = (at, high) if bent else (low, at)

    def angle(n: int) -> float:
        found = pp.equilibria(pp.Chain(pipe, n), u)
        assert found.residuals.max() < 1e-10
        return float(abs(found.q[1, 0]))  # the least bent but for the straight one

    assert converged(angle, (10, 20, 40)) == pytest.approx(low, abs=2e-6)


def test_chains_between_fixed_ends_buckle_as_the_reduced_model_and_holmes_say() -> None:
    """A^2 = 4 (u^2 - pi^2) / (stiffness pi^2), to leading order in the amplitude: Holmes (1977)."""
    u, stiffness = 3.3, 400.0
    terms = [pp.Stretching(stiffness)]
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", terms=terms)

    def middle(model: pp.Model) -> float:
        bent = model.bent(lambda s: 0.1 * np.cos(math.pi * s))
        return float(model.shape(Statics(model).solved(bent, u), [0.5])[0, 0])

    expected = middle(pp.Galerkin(pipe, 8, "legendre"))
    holmes = math.sqrt(4.0 * (u**2 - math.pi**2) / stiffness) / math.pi
    assert expected == pytest.approx(holmes, rel=0.04)
    assert middle(pp.Chain(pipe, 20)) == pytest.approx(0.03145267, abs=1e-8)
    found = converged(lambda n: middle(pp.Chain(pipe, n)), (20, 40, 80))
    assert found == pytest.approx(expected, abs=2e-8)


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
