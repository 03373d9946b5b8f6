# SPDX-License-Identifier: MIT
"""Continuation of a user's own equations."""

from functools import lru_cache

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.bifurcation.continuation import Control, DenseProblem, follow


def cubic(x, p):
    """The fold lines of p = x^3 - x lie at x = +-1 / sqrt(3)."""
    return x**3 - x - p


def test_a_branch_is_followed_past_both_folds_with_a_derivative_or_without():
    def derivative(x, p):
        return np.array([[3.0 * x[0] ** 2 - 1.0, -1.0]])

    for given in (None, derivative):
        branch = follow(cubic, [-1.4], -1.344, (-2.0, 2.0), derivative=given)
        assert branch.ends == ("range", "range")
        assert branch.p[[0, -1]].tolist() == [-2.0, 2.0]
        assert [fold.x[0] for fold in branch.folds] == pytest.approx(
            [-(3.0**-0.5), 3.0**-0.5], abs=1e-8
        )
        assert [fold.p for fold in branch.folds] == pytest.approx(
            [2.0 / 27.0**0.5, -2.0 / 27.0**0.5], abs=1e-12
        )
        assert np.abs(cubic(branch.x[:, 0], branch.p)).max() < 1e-12


def test_zeros_of_test_functions_are_solved_for_in_their_order():
    tests = {"half": lambda x, p: x[0] - 0.5, "zero": lambda x, p: x[0]}
    branch = follow(cubic, [-1.4], -1.344, (-2.0, 2.0), tests=tests)
    assert [point.kind for point in branch.points] == ["fold", "zero", "half", "fold"]
    assert branch.points[2].x[0] == pytest.approx(0.5, abs=1e-12)
    assert branch.points[2].p == pytest.approx(-0.375, abs=1e-12)


def test_a_branch_ends_at_limits_of_its_unknowns():
    branch = follow(cubic, [-1.4], -1.344, (-2.0, 2.0), limits={0: (-1.5, 0.0)})
    assert branch.ends == ("range", "range")
    assert branch.x[[0, -1], 0].tolist() == [-1.5, 0.0]


def test_a_closed_branch_ends_where_it_began():
    branch = follow(lambda x, p: x**2 + p**2 - 1.0, [1.0], 0.0, (-2.0, 2.0))
    assert branch.ends == ("closed", "closed")
    assert branch.x[0] == branch.x[-1]
    assert branch.p[0] == branch.p[-1]
    assert sorted(fold.p for fold in branch.folds) == pytest.approx([-1.0, 1.0], abs=1e-12)


def test_equilibria_are_a_branch_of_equations_like_others():
    """The chain's own forces followed by hand go through the points of `equilibrium_branch`."""
    chain = pp.Chain(pp.Pipe(0.2, jet_angle=0.4), 2)

    def forces(q, u):
        return chain.rhs(0.0, np.append(q, np.zeros(2)), u)[2:]

    own = pp.equilibrium_branch(chain, [0.0, 0.0], 1.0, (0.5, 4.0))
    branch = follow(forces, own.q[0], 0.5, (0.5, 4.0), tests={"3": lambda q, u: u - 3.0})
    (point,) = branch.points
    there = pp.equilibrium_branch(chain, point.x, 3.0, (0.5, 3.0))
    assert point.x == pytest.approx(there.q[-1], abs=1e-9)


def test_a_problem_that_solves_its_own_equations_is_followed():
    """As those of equilibria and boundaries do, with a control of steps of their own."""
    problem = DenseProblem(
        lambda x, p: (cubic(x, p), np.array([[3.0 * x[0] ** 2 - 1.0, -1.0]])),
        1,
        1.0,
        Control(longest=0.1),
    )
    branch = follow(problem, [-1.4], -1.344, (-2.0, 2.0))
    assert len(branch.folds) == 2
    assert np.linalg.norm(np.diff(branch.tangents, axis=0), axis=1).max() < 0.36


HARMONICS = np.array([1, 3, 5])
PHASES = 2.0 * np.pi * np.arange(20) / 20


def cycle_of_frequency(omega):
    """Equations of a cycle's harmonics and flow speed at a frequency and a mass ratio.

    The unknowns are the cosines and sines of both angles' odd harmonics, then u; the last equation
    fixes the phase. They are balanced at 20 phases: Galerkin's method in time.
    """
    c, s = np.cos(np.outer(PHASES, HARMONICS)), np.sin(np.outer(PHASES, HARMONICS))

    @lru_cache(maxsize=4)
    def chain(beta):
        return pp.Chain(pp.Pipe(beta), 2)

    def equations(x, beta):
        even, odd = x[:-1].reshape(2, 3, 2)
        q = c @ even + s @ odd
        rate = omega * ((-s * HARMONICS) @ even + (c * HARMONICS) @ odd)
        turning = -(omega**2) * ((c * HARMONICS**2) @ even + (s * HARMONICS**2) @ odd)
        left = turning - chain(float(beta)).rhs(0.0, np.hstack([q, rate]).T, float(x[-1]))[2:].T
        return np.append(np.stack([c.T @ left, s.T @ left]).ravel() / 10.0, odd[0, 1])

    return equations


def test_the_frequency_of_a_cycle_is_held_while_flow_speed_and_mass_ratio_are_free():
    """What no function of the package does: `follow` takes it, and `limit_cycle` agrees."""
    chain = pp.Chain(pp.Pipe(0.2), 2)
    cycle = pp.limit_cycle(chain, 1.01 * pp.critical_speed(chain).speed)
    angles = HARMONICS * cycle.frequency
    parts = np.hstack([np.cos(np.outer(cycle.t, angles)), np.sin(np.outer(cycle.t, angles))])
    even, odd = np.linalg.lstsq(parts, cycle.q, rcond=None)[0].reshape(2, 3, 2)
    later = np.exp(1j * HARMONICS * np.angle(even[0, 1] - 1j * odd[0, 1]))[:, None]
    turned = (even - 1j * odd) / later.conj()
    x0 = np.append(np.stack([turned.real, -turned.imag]), cycle.u)
    branch = follow(cycle_of_frequency(cycle.frequency), x0, 0.2, (0.19, 0.21), scale=0.1, step=0.5)
    for k in (0, -1):
        other = pp.Chain(pp.Pipe(float(branch.p[k])), 2)
        found = pp.limit_cycle(other, float(branch.x[k, -1]))
        assert found.frequency == pytest.approx(cycle.frequency, rel=1e-6)
        assert found.amplitude != pytest.approx(cycle.amplitude, rel=0.05)


@pytest.mark.parametrize(
    ("words", "more", "message"),
    [
        ((3, [0.0], 0.0, (-1, 1)), {}, "problem must be a function of x and p, or a Continuation"),
        ((cubic, "0", 0.0, (-1, 1)), {}, "x0 must be"),
        ((cubic, [0.0], 2.0, (-1, 1)), {}, "p0 must lie in [-1, 1], got 2"),
        ((cubic, [0.0], 0.0, (1, -1)), {}, "interval must be (lowest, highest), got (1, -1)"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"step": 0.0}, "step must lie in"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"scale": 0.0}, "scale must be finite and > 0"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"points": 0}, "points must be from 1 to"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"tests": {"a": 3}}, "tests must map names to functions"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"derivative": 3}, "derivative must be a function, got 3"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"limits": {0: (1, 2)}}, "limits[0] must hold x0[0] = 0"),
        ((cubic, [0.0], 0.0, (-1, 1)), {"limits": 3}, "limits must map indices to"),
        ((lambda x, p: [1.0, 2.0], [0.0], 0.0, (-1, 1)), {}, "problem must give an array of shape"),
        (
            (cubic, [0.0], 0.0, (-1, 1)),
            {"derivative": lambda x, p: [1.0]},
            "derivative must give an array of shape (1, 2), got (1,)",
        ),
    ],
)
def test_what_cannot_be_followed_is_refused_by_name(words, more, message):
    with pytest.raises((ValueError, TypeError)) as caught:
        follow(*words, **more)
    assert str(caught.value).startswith(message)


def test_where_there_is_no_solution_near_the_start_it_says_so():
    with pytest.raises(pp.NotConverged, match="no solution to follow was found near x0 at p = 0"):
        follow(lambda x, p: x**2 + 1.0 + p**2, [0.3], 0.0, (-1.0, 1.0))
