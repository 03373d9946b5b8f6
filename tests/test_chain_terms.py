# SPDX-License-Identifier: MIT
"""Terms of the pipe on a chain, anywhere along a segment: in motion and in linear answers.

The virtual work, energy and operators of each law are in test_terms.py.
"""

from dataclasses import replace

import numpy as np
import pytest
from independent import chain_crossing, unstable_count
from test_chain_motion import TERMS as ALL

import pipedyn as pp

# ------------------------------------------------------------------------------------- places


def test_a_place_on_the_fixed_base_does_nothing():
    held = (pp.PointMass(0.04, 3.0), pp.Spring(0.05, 1e3))
    chain = pp.Chain(pp.Pipe(0.2, 5.0), 10, springs="midpoint")
    same = chain.with_pipe(replace(chain.pipe, terms=held))
    y = np.random.default_rng(5).normal(size=20)
    np.testing.assert_array_equal(chain.rhs(0.0, y, 4.0), same.rhs(0.0, y, 4.0))
    np.testing.assert_array_equal(pp.eigenvalues(chain, 4.0), pp.eigenvalues(same, 4.0))


def test_a_place_may_pass_from_one_segment_to_the_next():
    y = np.random.default_rng(6).normal(size=8)
    low, high = (
        pp.Chain(pp.Pipe(0.2, terms=(pp.PointMass(at, 0.7), pp.Spring(at, 50.0))), 4)
        for at in (0.5 - 1e-12, 0.5 + 1e-12)
    )
    np.testing.assert_allclose(low.rhs(0.0, y, 4.0), high.rhs(0.0, y, 4.0), rtol=1e-9)


@pytest.mark.parametrize("rule", ["consistent", "midpoint", "rayleigh", "uniform", "frequency"])
def test_springs_by_a_rule_are_those_of_the_bare_pipe(rule):
    loaded = pp.Chain(pp.Pipe(0.2, terms=ALL), 7, springs=rule)
    np.testing.assert_array_equal(loaded.springs, pp.Chain(pp.Pipe(0.2), 7, springs=rule).springs)


# ------------------------------------------------------------------------------ linear analysis


@pytest.mark.parametrize("n", [1, 5, 100])
def test_the_response_to_a_force_is_that_of_the_matrices(n):
    chain = pp.Chain(pp.Pipe(0.2, 4.0, damping=0.01, hysteresis=0.03, terms=ALL), n)
    found = pp.frequency_response(chain, 3.0, [2.0, 20.0], input=("force", 0.6), output=0.9)
    mass, damping, stiffness = chain.operators().at(3.0)
    load, output = chain.deflection(np.eye(n), [0.6, 0.9])
    for omega, response in zip(found.frequencies, found.response, strict=True):
        dynamic = stiffness + 1j * omega * damping - omega**2 * mass
        assert response == pytest.approx(output @ np.linalg.solve(dynamic, load), rel=1e-9)


@pytest.mark.parametrize("n", [6, 90])
def test_crossings_are_exact(n):
    chain = pp.Chain(pp.Pipe(0.2, 3.0, damping=0.01, terms=ALL), n)
    found = pp.crossings(chain, 12.0)[0]
    speed, frequency = chain_crossing(chain, found.speed, found.frequency)
    assert abs(found.speed - speed) <= found.error <= 1e-10
    assert abs(found.frequency - frequency) <= 1e-9


@pytest.mark.parametrize(
    ("terms", "standing", "n"),
    [
        ((pp.PointMass(0.8, 0.3),), True, 5),
        ((pp.Spring(0.2, 20.0),), True, 5),
        ((pp.Spring(0.2, 20.0), pp.PointMass(0.9, 0.2)), True, 5),
        ((pp.Spring(0.2, 20.0), pp.PointMass(0.9, 0.2)), True, 66),
        ((pp.Spring(0.9, 20.0),), False, 5),
        ((pp.Spring(0.9, 20.0),), False, 66),
    ],
)
def test_a_root_stands_at_zero_unless_a_spring_holds_what_is_beyond_the_free_joint(
    terms, standing, n
):
    springs = np.full(n, float(n))
    springs[2 * n // 5] = 0.0
    chain = pp.Chain(pp.Pipe(0.3, terms=terms), springs=springs)
    zero = np.abs(pp.eigenvalues(chain, 1.0, count=4)[0])
    assert (zero < 1e-9) == standing
    found = pp.crossings(chain, 5.0)
    assert found
    for crossing in found:
        below, above = (
            unstable_count(chain, crossing.speed * part, 1e-4) for part in (0.999, 1.001)
        )
        assert (below, above) == (crossing.unstable_before, crossing.unstable_after)
