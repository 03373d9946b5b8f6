# SPDX-License-Identifier: MIT
"""The chain's nonlinear motion: right-hand side, derivative and vector levels."""

import math
import os
import subprocess
import sys

import mpmath
import numpy as np
import pytest
from independent import any_chain, dense_jacobian, dense_rates, lagrangian_accelerations, worst
from test_chain import UNEQUAL

import pipedyn as pp

FLOWS = [
    {"flow": "ejecting"},
    {"flow": "aspirating", "alpha": 0.7},
    {"flow": "aspirating", "alpha": 0.0},
    {"flow": "aspirating", "alpha": 0.7, "inflow_share": 0.35},
    {"alpha": 0.7, "jet_angle": -1.25},
]
flows = pytest.mark.parametrize("flow", FLOWS, ids=str)
TERMS = (pp.PointMass(0.37, 0.4), pp.Spring(0.52, 30.0), pp.PointMass(1.0, 0.2))
TERMS += (pp.Spring(0.9, 20.0), pp.PointMass(0.41, 0.1))
with_terms = pytest.mark.parametrize(
    "flow", [*FLOWS, *({**flow, "terms": TERMS} for flow in FLOWS[:2])], ids=str
)


def with_and_without_forces(n, seed, flow):
    """Chains with gravity, drag and damping, and with none of these."""
    yield any_chain(n, seed, gamma=4.0, drag=1.5, damping=0.01, **flow)
    yield any_chain(n, seed + 1, **flow)


def states(n, count, seed=1, size=2.0):
    return size * np.random.default_rng([n, count, seed]).normal(size=(2 * n, count))


# ------------------------------------------------------------------------------ equations of motion


@flows
def test_chain_moves_as_the_papers_lagrangian_says(flow):
    """Three unequal segments, base and all effects, at large states, derived by differences."""
    arrays = UNEQUAL | {"lengths": [0.45, 0.3, 0.15]}
    points = [0.8, 0.25, 0.6]
    pipe = pp.Pipe(0.3, gamma=2.5, drag=1.25, damping=0.01, **flow)
    chain = pp.Chain(pipe, **arrays, drag_points=points, base=0.1)
    y = states(3, 4)
    given = *arrays.values(), 0.3, 2.5, 0.01, pipe.flow == "aspirating", pipe.alpha, 3.75
    more = {name: flow[name] for name in ("inflow_share", "jet_angle") if name in flow}
    expected = lagrangian_accelerations(y, *given, drag=1.25, points=points, **more)
    found = chain.rhs(0.0, y, 3.75)
    np.testing.assert_array_equal(found[:3], y[3:])
    assert worst(found[3:], expected) < 1e-12


@pytest.mark.parametrize("n", [1, 2, 3, 50])
@with_terms
def test_recursion_solves_the_dense_equations(n, flow, each_level):
    for chain in with_and_without_forces(n, 0, flow):
        y = states(n, 5)
        for u in (0.0, 4.5):
            expected = np.stack([dense_rates(chain, state, u) for state in y.T], axis=1)
            assert worst(chain.rhs(0.0, y, u), expected) < 1e-14 * (10 + n**1.5)
            assert worst(chain.rhs(0.0, y[:, 0], u), expected[:, 0]) < 1e-14 * (10 + n**1.5)


def test_angles_of_many_turns_count_by_their_sine(each_level):
    chain = any_chain(9, 0, gamma=4.0)
    y = states(9, 4)
    y[4:9] += 1e5  # the fifth joint has no spring
    expected = np.stack([dense_rates(chain, state, 2.0) for state in y.T], axis=1)
    assert worst(chain.rhs(0.0, y, 2.0), expected) < 1e-10  # 1e5 itself is rounded
    assert worst(chain.rhs(0.0, y[:, 0], 2.0), expected[:, 0]) < 1e-10


def test_a_hundred_thousand_segments_obey_their_equations():
    """The straight pipe, where every term has its own product, known from the linear analysis."""
    n, u = 100_000, 5.0
    pipe = pp.Pipe(0.4, gamma=3.0, damping=1e-3)
    chain = pp.Chain(pipe, n)
    rates = 1e-3 * np.sin(np.arange(n) / 1e4)
    found = chain.rhs(0.0, np.concatenate([np.zeros(n), rates]), u)[n:]
    turning = np.diff(rates, prepend=0.0)
    length = 1.0 / n

    def inertia(turning):
        """Of equal segments with their mass in the middle and radius l / sqrt(12)."""
        joint = length * (np.cumsum(turning) - turning)
        force = length * (joint + 0.5 * length * turning)
        beyond = np.cumsum(force[::-1])[::-1] - force
        return length * (beyond + 0.5 * length * joint + length**2 / 3.0 * turning)

    beyond = np.cumsum(rates[::-1])[::-1] - rates
    force = u * math.sqrt(pipe.beta) * length**2 * (rates + 2.0 * beyond)
    force -= 1e-3 * np.diff(chain.springs * turning, append=0.0)
    missing = inertia(found) + force
    terms = inertia(np.abs(found))
    assert np.all(np.abs(missing) < 4.0 * np.finfo(float).eps * terms)


# ------------------------------------------------------------------------------------- derivative


@with_terms
@pytest.mark.parametrize("n", [1, 2, 3, 33])
def test_jacobian_is_the_derivative(n, flow, each_level):
    """Of the dense equations, by complex steps: to rounding."""
    for chain in with_and_without_forces(n, 3, flow):
        for u in (0.0, 4.5):
            y = states(n, 1, seed=7)[:, 0]
            found = chain.jacobian(0.0, y, u)
            assert worst(found, dense_jacobian(chain, y, u)) < 1e-14 * (10 + n**2)


# --------------------------------------------------------------------------------- vector levels


def test_level_can_be_forced(at_level):
    code = "from pipedyn import _core; print(_core.vector_level())"
    environment = {**os.environ, "PIPEDYN_VECTOR_LEVEL": "baseline"}
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "baseline"
    environment["PIPEDYN_VECTOR_LEVEL"] = "widest"
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "vector level must be one of 'baseline'" in run.stderr
    with pytest.raises(ValueError, match=r"vector level must be one of 'baseline'.*, got 'sse9'"):
        at_level("sse9")


@pytest.fixture(scope="module")
def sines_and_cosines():
    """Angles of all sizes and about the corners of the octants, and what is exact of them."""
    rng = np.random.default_rng(3)
    corners = np.arange(-1018, 1019, 7) * (np.pi / 4)
    x = np.concatenate(
        [
            *(rng.uniform(-size, size, 300) for size in (0.785, 1600.0)),
            *(np.nextafter(corners, to) for to in (-np.inf, 0.0, np.inf)),
            10.0 ** rng.uniform(-300.0, 5.0, 300),
            [0.0, -0.0, 5e-324, 0.785, 1600.0, np.nextafter(1600.0, 2e3), 1e22, -1e22, 1e300],
        ]
    )
    with mpmath.workdps(400):
        exact = [[f(mpmath.mpf(value)) for value in x] for f in (mpmath.sin, mpmath.cos)]
    return x, *exact


def test_sine_and_cosine_are_good_to_two_ulp(each_level, sines_and_cosines):
    x, *exact = sines_and_cosines

    def sincos(x):
        return pp.Chain(pp.Pipe(0.2), 1).core.redundant(np.stack([x, 0.0 * x]))[:2]

    sine, cosine = sincos(x)
    with mpmath.workdps(40):
        for found, right in zip((sine, cosine), exact, strict=True):
            errors = [
                abs(mpmath.mpf(a) - b) / mpmath.mpf(np.spacing(abs(float(b))))
                for a, b in zip(found, right, strict=True)
            ]
            assert max(errors) < 1.5
    near = x[:300]  # alone they take the short way: the same answer
    np.testing.assert_array_equal(sincos(near), [sine[:300], cosine[:300]])
