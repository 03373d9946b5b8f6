# SPDX-License-Identifier: MIT
"""Chains held by guides: by recursion along them, against their matrices and known answers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from test_modular_core import light

import pipedyn as pp
from pipedyn import modular as md

EJECTING = pp.Pipe(0.3, 5.0, drag=0.5)
TERMS = (
    pp.Damper(at=0.6, coefficient=0.5),
    pp.PointMass(at=0.37, mass=0.3),
    pp.Spring(at=0.8, stiffness=30.0),
    pp.PointMass(at=1.0, mass=0.5),
)
PIPES = {
    "ejecting": EJECTING,
    "damped": pp.Pipe(0.5, damping=0.02),
    "beta 0": pp.Pipe(0.0, -3.0),
    "aspirating": pp.Pipe(0.3, 5.0, "aspirating", 0.8, damping=0.01),
    "terms": pp.Pipe(0.4, 2.0, terms=TERMS[1:]),
    "damper": pp.Pipe(0.4, 2.0, terms=TERMS),
}
HELD = [
    (3, (1,)),
    (3, (3,)),
    (3, (1, 2)),
    (6, (2, 3, 4, 5, 6)),
    (6, (1, 2, 3, 4, 6)),
    (10, (4, 5, 6)),
    (10, (10,)),
    (20, (7, 20)),
    (40, (40, 20)),
]
LOOSE = np.where(np.isin(np.arange(10), [2, 3, 5]), 0.0, 10.0)


def guided(pipe: pp.Pipe, n: int, nodes: tuple[int, ...], **chain: object) -> md.Assembly:
    return md.chain(pipe, n, **chain).plus(*map(md.Guide, nodes))


def by_matrices(scene: md.Assembly) -> md.Assembly:
    """The scene with a law in Python that does nothing, for which recursions are not known."""
    same = scene.plus(md.Custom(nodes=(1,), energy=lambda q: 0.0 * q[0]))
    assert scene.linear_cost
    assert not same.linear_cost
    return same


def compared(scene: md.Assembly, u: float, recursion_alone: bool = True) -> None:
    """All eigenvalues are the dense ones within the errors that both state."""
    found, dense = pp.modes(scene, u), pp.modes(by_matrices(scene), u)
    if recursion_alone:
        values = pp.eigenvalues(scene, u)
        np.testing.assert_allclose(values[values.imag >= 0.0], found.eigenvalues, rtol=1e-14)
        assert found.residuals.max() < 1e-12
    left = list(range(dense.eigenvalues.size))
    for value, error in zip(found.eigenvalues, found.errors, strict=True):
        i = min(left, key=lambda k: abs(dense.eigenvalues[k] - value))
        left.remove(i)
        assert abs(dense.eigenvalues[i] - value) <= 2.0 * (error + dense.errors[i]) + 1e-13
    assert left == []


@pytest.mark.parametrize("name", PIPES)
@pytest.mark.parametrize(("n", "nodes"), HELD)
def test_recursion_finds_what_the_matrices_have(name: str, n: int, nodes: tuple[int, ...]) -> None:
    for u in (0.0, 3.0, 7.0):
        compared(guided(PIPES[name], n, nodes), u)


@pytest.mark.parametrize("nodes", [(10,), (4,), (3,), (2, 6), (7,), (5, 10)])
@pytest.mark.parametrize("u", [0.0, 3.0])
def test_joints_without_springs_may_be_held_or_not(nodes: tuple[int, ...], u: float) -> None:
    compared(guided(EJECTING, 10, nodes, springs=LOOSE), u, recursion_alone=False)


@pytest.mark.parametrize("name", [*PIPES, "buckled at rest"])
@pytest.mark.parametrize(
    ("n", "nodes"),
    [(6, ()), (24, ()), (4, (1,)), (10, (10,)), (16, (5, 16)), (67, (33, 67))],
)
def test_crossings_are_those_of_the_matrices(name: str, n: int, nodes: tuple[int, ...]) -> None:
    """And, without guides, those of `Chain`."""
    end = 11.0 if nodes else 9.0  # beyond which the matrices of 24 free segments have few digits
    pipe = PIPES.get(name, pp.Pipe(0.3, -12.0))
    scene = guided(pipe, n, nodes)
    mine = pp.crossings(scene, end)
    others = [] if nodes else [(pp.crossings(pp.Chain(pipe, n), end), 1e-9)]
    others.append((pp.crossings(by_matrices(scene), end), 1e-5))
    for theirs, rel in others:
        for a, b in zip(mine, theirs, strict=True):
            assert (a.kind, a.mode, a.unstable_after) == (b.kind, b.mode, b.unstable_after)
            assert abs(a.speed - b.speed) <= a.error + b.error + 1e-12
            assert a.frequency == pytest.approx(b.frequency, rel=min(rel, 1e-6))
            assert (a.sensitivity is None) == (b.sensitivity is None)
            for part in ("beta", "gamma", "damping", "alpha") if a.sensitivity else ():
                of = [getattr(c.sensitivity.speed, part) for c in (a, b)]
                assert of[0] == pytest.approx(of[1], rel=rel, abs=1e-7), part


@pytest.mark.parametrize("name", ["ejecting", "terms", "damper", "idle damper"])
@pytest.mark.parametrize(("n", "nodes"), [(4, (2, 3)), (4, (2, 4, 3)), (5, (3, 4)), (12, (10, 11))])
@pytest.mark.parametrize("by", [lambda scene: scene, by_matrices], ids=["recursion", "matrices"])
def test_a_span_that_neighbouring_guides_clamp_diverges(
    name: str, n: int, nodes: tuple[int, ...], by: Callable[[md.Assembly], md.Assembly]
) -> None:
    """Nothing beyond moves with it, and nothing takes its energy: zero is a double root."""
    pipe = PIPES.get(name, pp.Pipe(0.3, terms=[pp.Damper(at=1.0, coefficient=0.5)]))
    scene = by(guided(pipe, n, (*nodes, n) if name == "idle damper" and n not in nodes else nodes))
    critical = pp.critical_speed(scene, 11.0)
    assert critical.kind == "divergence"
    assert critical.error < 1e-12
    below, above = (
        np.linalg.det(scene.operators().at(critical.speed + step)[2]) for step in (-1e-9, 1e-9)
    )
    assert below * above < 0.0


@pytest.mark.parametrize("nodes", [(12,), (5, 6), (3, 9)])
def test_root_loci_are_those_of_the_matrices(nodes: tuple[int, ...]) -> None:
    speeds, scene = np.linspace(0.0, 6.0, 13), guided(EJECTING, 12, nodes)
    mine, theirs = (pp.root_loci(one, speeds, 3) for one in (scene, by_matrices(scene)))
    assert (np.abs(mine.eigenvalues - theirs.eigenvalues) <= mine.errors + theirs.errors).all()


@pytest.mark.parametrize("nodes", [(), (4,), (2,)])
def test_a_last_segment_may_have_the_inertia_of_a_term_alone(nodes: tuple[int, ...]) -> None:
    """The answer is that of a segment with next to no inertia of its own."""
    scenes = (light(4, *map(md.Guide, nodes), radius=radius) for radius in (0.0, 1e-6))
    found, expected = (pp.eigenvalues(scene, 2.0, 2) for scene in scenes)
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_shapes_do_not_pass_through_the_guides() -> None:
    scene = guided(EJECTING, 30, (11, 12, 30))
    found = pp.modes(scene, 4.0, 4)
    operators = scene.operators()
    for value, shape in zip(found.eigenvalues, found.shapes, strict=True):
        across = np.abs(shape(np.array([11.0, 12.0, 30.0]) / 30.0))
        assert across.max() < 1e-12
        mass, velocity, stiffness = operators.at(4.0)
        rest = (value**2 * mass + value * velocity + stiffness) @ shape.coordinates
        assert np.linalg.norm(rest) < 1e-9 * np.linalg.norm(stiffness @ shape.coordinates)


@pytest.mark.parametrize(("kind", "node", "gamma"), [("flutter", 2, 5.0), ("divergence", 6, 20.0)])
def test_what_moves_a_guided_crossing_is_its_difference(kind: str, node: int, gamma: float) -> None:
    numbers = np.append(6.0 + np.arange(6.0), gamma)

    def critical(of: np.ndarray) -> pp.CriticalSpeed:
        return pp.critical_speed(guided(pp.Pipe(0.3, of[6]), 6, (node,), springs=of[:6]))

    found = critical(numbers)
    assert found.kind == kind
    for j, of in enumerate([*found.sensitivity.speed.springs, found.sensitivity.speed.gamma]):
        step = 1e-4 * np.eye(7)[j]
        slope = (critical(numbers + step).speed - critical(numbers - step).speed) / 2e-4
        assert of == pytest.approx(slope, rel=1e-5, abs=1e-8)


def clamped_clamped(n: int) -> tuple[float, float]:
    """Fixed beyond the last joint: a beam of the length 1 - 1 / n, its frequency as of length 1."""
    springs = np.full(n, float(n))
    springs[[0, -1]] *= 2.0
    scene = guided(pp.Pipe(0.0), n, (n - 1, n), springs=springs)
    return abs(pp.eigenvalues(scene, 0.0, 2)[0]) * (1.0 - 1.0 / n) ** 2, 4.7300407448627040**2


def clamped_pinned(n: int) -> tuple[float, float]:
    scene = guided(pp.Pipe(0.3), n, (n,))
    return abs(pp.eigenvalues(scene, 0.0, 2)[0]), 3.9266023120479187**2


def buckling(n: int) -> tuple[float, float]:
    """Where tan u = u."""
    critical = pp.critical_speed(guided(pp.Pipe(0.3), n, (n,)))
    assert critical.kind == "divergence"
    return critical.speed, 4.493409457909064


@pytest.mark.parametrize("number", [clamped_clamped, clamped_pinned, buckling])
def test_long_chains_tend_to_the_beam(number: Callable[[int], tuple[float, float]]) -> None:
    sizes = np.array([50, 100, 200, 400])
    errors = [abs(found / exact - 1.0) for found, exact in map(number, sizes.tolist())]
    assert -np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.03)
    found, exact = number(2000)
    assert found == pytest.approx(exact, rel=2e-6)


def test_a_guided_chain_of_any_length_has_eigenvalues() -> None:
    """Far beyond what matrices can hold."""
    scene = guided(pp.Pipe(0.2), 10_000, (3_000, 10_000))
    found = pp.modes(scene, 3.0, 2)
    finer = pp.eigenvalues(guided(pp.Pipe(0.2), 1_000, (300, 1_000)), 3.0, 4)
    assert found.converged.all()
    np.testing.assert_allclose(found.eigenvalues, finer[::2], rtol=1e-5)
