# SPDX-License-Identifier: MIT
"""Which eigenvalues count as on the imaginary axis, against eigenvalues of 40 digits."""

import mpmath
import numpy as np
import pytest

import pipedyn as pp
from pipedyn.linear.neutral import beyond_rounding, decays, eigenvalues_of, grows, growth

HELD = pp.Pipe(0.3, root="pinned", end="pinned")

MODELS = [
    (pp.Galerkin(pp.Pipe(0.2), 8), 5.0),
    (pp.Galerkin(pp.Pipe(0.5, 10.0), 8, "legendre"), 9.0),
    (pp.Galerkin(pp.Pipe(0.4, flow="aspirating", damping=1e-6), 6, "legendre"), 1.0),
    (pp.Galerkin(HELD, 8), 2.0),
    (pp.Galerkin(HELD, 8), np.pi),  # zero is a double root
    (pp.Chain(pp.Pipe(0.3, -5.0, damping=0.01), 8), 3.0),
    (pp.Chain(pp.Pipe(0.3, terms=(pp.PointMass(1.0, 10.0),)), 8), 1.0),
]


def matrices(model, u):
    """M, C and K."""
    return model.elastic_operators().at(u)


def by_many_digits(mass, velocity, stiffness):
    """Eigenvalues by the matrix [0 I; -K -C] of M = 1, in 40 digits."""
    n = len(mass)
    with mpmath.workdps(40):
        inverse = mpmath.inverse(mpmath.matrix(mass.tolist()))
        still, rate = (inverse * mpmath.matrix(one.tolist()) for one in (stiffness, velocity))
        rows = mpmath.zeros(2 * n)
        for i in range(n):
            rows[i, n + i] = 1
            for j in range(n):
                rows[n + i, j], rows[n + i, n + j] = -still[i, j], -rate[i, j]
        found = mpmath.eig(rows, left=False, right=False)
        return np.array([complex(value) for value in found])


@pytest.mark.parametrize(("model", "u"), MODELS)
def test_no_eigenvalue_is_farther_off_than_rounding_is_said_to_move_it(model, u):
    true, values = by_many_digits(*matrices(model, u)), eigenvalues_of(*matrices(model, u))
    rounding = values.real - beyond_rounding(values)
    assert values.size == 2 * model.dof
    assert (np.abs(values[:, None] - true).min(axis=1) <= rounding).all()
    assert rounding[np.argsort(np.abs(values))[:4]].max() <= 1e-6  # it says something


@pytest.mark.parametrize("u", [0.0, 1.0, 3.1])
@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_below_divergence_all_roots_of_a_conservative_pipe_are_on_the_axis(u, basis):
    values = eigenvalues_of(*matrices(pp.Galerkin(HELD, 24, basis), u))
    assert not grows(values).any()
    assert (growth(values) == 0.0).all()


def test_little_damping_is_told_from_rounding():
    model = pp.Galerkin(pp.Pipe(0.3, root="pinned", end="pinned", damping=1e-9), 8)
    values = eigenvalues_of(*matrices(model, 1.0))
    lowest = values[np.argsort(np.abs(values))[:4]]
    assert decays(lowest).all()
    assert not grows(lowest).any()


def test_rows_are_judged_one_by_one_and_what_is_no_number_is_on_no_side():
    values = np.array([[1e-3 + 2j, -1.0, np.nan], [1e-18 + 2j, 1e5j, 3.0]])
    assert growth(values).tolist()[1] == [0.0, 0.0, 3.0]
    assert grows(values).tolist() == [[True, False, False], [False, False, True]]
    assert decays(values).tolist() == [[False, True, False], [False, False, False]]
    for row, whole in zip(values, beyond_rounding(values), strict=True):
        np.testing.assert_array_equal(beyond_rounding(row), whole)
