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
    values = collocation_eigenvalues(pipe, found.speed, size=48)
    assert np.abs(values - 1j * found.frequency).min() < 1e-7
    # The published figures have three digits, the first within one in the last.
    assert found.speed == pytest.approx(published[0], rel=0, abs=1e-2)
    assert found.frequency == pytest.approx(published[1], rel=0, abs=5e-2)
    # Material damping, which undamped theory lacks, raised the measured speed.
    assert 0.0 < measured[0] / found.speed - 1.0 < 0.08
    assert abs(measured[1] / found.frequency - 1.0) < 0.19


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
