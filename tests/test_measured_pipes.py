# SPDX-License-Identifier: MIT
"""Measured pipes (Paidoussis 1970, hanging elastomer cantilevers conveying air) against theory.

And the kind of error that few segments make.
"""

import numpy as np
import pytest
from independent import collocation_eigenvalues, collocation_matrices

import pipedyn as pp

LIGHT = pp.Pipe(0.00023, gamma=61.1)
HEAVY = pp.Pipe(0.00203, gamma=42.4)


@pytest.mark.parametrize(
    ("pipe", "speed", "frequency", "published", "measured"),
    [
        (LIGHT, 6.14472, 21.2932, (6.15, 21.3), (6.33, 18.0)),
        (HEAVY, 5.62348, 19.5080, (5.62, 19.5), (6.05, 19.5)),
    ],
    ids=["beta 0.00023", "beta 0.00203"],
)
def test_undamped_theory_meets_what_was_published_and_falls_short_of_what_was_measured(
    pipe, speed, frequency, published, measured
):
    found = pp.critical_speed(pp.Continuum(pipe))
    assert found.kind == "flutter"
    assert found.speed == pytest.approx(speed, rel=0, abs=5.1e-6)
    assert found.frequency == pytest.approx(frequency, rel=0, abs=5.1e-5)
    # The published figures have three digits, the first within one in the last.
    assert found.speed == pytest.approx(published[0], rel=0, abs=1e-2)
    assert found.frequency == pytest.approx(published[1], rel=0, abs=5e-2)
    # Material damping, which undamped theory lacks, raised the measured speed.
    assert 0.0 < measured[0] / found.speed - 1.0 < 0.08
    assert abs(measured[1] / found.frequency - 1.0) < 0.19


@pytest.mark.parametrize("pipe", [LIGHT, HEAVY], ids=["light", "heavy"])
def test_undamped_theory_of_the_measured_pipes_has_a_root_of_the_strong_form_on_the_axis(pipe):
    found = pp.critical_speed(pp.Continuum(pipe))
    values = collocation_eigenvalues(pipe, found.speed, size=48)
    assert np.abs(values - 1j * found.frequency).min() < 1e-7


def test_hysteretic_damping_meets_the_published_theory_of_the_second_pipe():
    """EI (1 + 0.02 i) scales the elastic terms of the matrices: 5.79087 and 18.1460.

    No parameter of a Pipe says that; the operators do.
    """
    ops = pp.Galerkin(HEAVY, 16, "legendre").operators()
    bending = np.eye(16)

    def on_the_axis(u):
        mass, damping, stiffness = ops.at(u)
        stiffness = stiffness + 0.02j * bending
        size = len(mass)
        step = np.zeros((2 * size, 2 * size), dtype=complex)
        step[:size] = -np.linalg.solve(stiffness, np.hstack([damping, mass]))
        step[size:, :size] = np.eye(size)
        values = 1.0 / np.linalg.eigvals(step)
        upward = values[(values.imag > 5.0) & (values.imag < 40.0)]
        return upward[np.argmax(upward.real)]

    low, high = 5.5, 6.0
    assert on_the_axis(low).real < 0.0 < on_the_axis(high).real
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if on_the_axis(middle).real > 0.0 else (middle, high)
    assert low == pytest.approx(5.79087, rel=0, abs=5.1e-6)
    assert on_the_axis(low).imag == pytest.approx(18.1460, rel=0, abs=5.1e-5)


def test_a_hanging_chain_of_few_segments_diverges_where_the_pipe_only_flutters():
    """The 'paradox' of Paidoussis and Deksnis: the divergence retreats as segments become more."""
    pipe = pp.Pipe(0.5, gamma=50.0)
    exact = pp.critical_speed(pp.Continuum(pipe))
    assert exact.kind == "flutter"
    # det K of the strong form keeps its sign: no divergence at any of these speeds.
    signs = [
        np.linalg.slogdet(collocation_matrices(pipe, u, 48)[2])[0]
        for u in np.linspace(0.0, 30.0, 301)
    ]
    assert np.ptp(signs) == 0.0

    def divergence(n):
        found = pp.crossings(pp.Chain(pipe, n), 40.0)
        return min(crossing.speed for crossing in found if crossing.kind == "divergence")

    two = pp.critical_speed(pp.Chain(pipe, 2))
    assert two.kind == "divergence"
    assert two.speed < 0.7 * exact.speed
    retreat = [divergence(n) for n in (2, 4, 8, 16)]
    assert retreat[0] == pytest.approx(two.speed, abs=2.0 * two.error)
    assert (np.diff(retreat) > 2.0).all()
    assert retreat[-1] > 2.0 * exact.speed
    for n in (8, 16):
        assert pp.critical_speed(pp.Chain(pipe, n)).kind == "flutter"
    assert pp.critical_speed(pp.Chain(pipe, 16)).speed == pytest.approx(exact.speed, rel=0.03)
