# SPDX-License-Identifier: MIT
"""Continuation of a user's own equations."""

from functools import lru_cache

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.continuation import Continuation, Control, follow


def cubic(x, p):
    """The fold lines of p = x^3 - x lie at x = +-1 / sqrt(3)."""
    return x**3 - x - p


class Own(Continuation):
    """One equation with the slopes dx and -1, which solves for its steps itself."""

    def __init__(self, equation, slope, least=0.0, **control):
        super().__init__(np.ones(2), Control(longest=0.1, **control))
        self.equation, self.slope, self.least = equation, slope, least

    def linearised(self, z):
        residual, slopes = self.equation(z[:1], z[1]), [self.slope(z), -1.0]
        return lambda row, gap, share: np.linalg.solve([slopes, row], [-share * residual[0], gap])

    def relative(self, z, step):
        return max(self.length(step), self.least)


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
    problem = Own(cubic, lambda x: 3.0 * x[0] ** 2 - 1.0)
    branch = follow(problem, [-1.4], -1.344, (-2.0, 2.0))
    assert len(branch.folds) == 2
    assert np.linalg.norm(np.diff(branch.tangents, axis=0), axis=1).max() < 0.36


def of_two(x, p):
    """The root of two where p = 0."""
    return x**2 - 2.0 - p


def test_newtons_method_converges_to_rounding_in_a_few_steps():
    problem = Own(of_two, lambda z: 2.0 * z[0], iterations=6)
    branch = follow(problem, [1.0], 0.0, (-1e-9, 1e-9))
    assert branch.x[np.argmin(np.abs(branch.p)), 0] == pytest.approx(2.0**0.5, rel=1e-15)


def test_its_steps_are_shortened_to_the_longest_allowed():
    iterates = []

    def recorded(x, p):
        iterates.append(x[0])
        return of_two(x, p)

    problem = Own(recorded, lambda z: 2.0 * z[0], longest_change=10.0, iterations=50)
    follow(problem, [100.0], 0.0, (-1e-9, 1e-9))
    assert np.abs(np.diff(iterates)).max() <= 10.0
    assert iterates[:2] == [100.0, 90.0]


@pytest.mark.parametrize(
    ("equation", "slope", "control", "reason"),
    [
        (of_two, lambda z: 2.0 * z[0], {"least": 1e-9, "stagnation": 0.0}, "did not converge"),
        (lambda x, p: x - np.nan, lambda z: 1.0, {}, "met numbers that are not finite"),
        (of_two, lambda z: 0.0, {}, "met a singular matrix"),
    ],
)
def test_newtons_method_says_why_it_fails(equation, slope, control, reason):
    with pytest.raises(pp.NotConverged, match=f"near x0 at p = 0: Newton's method {reason}"):
        follow(Own(equation, slope, **control), [1.0], 0.0, (-1.0, 1.0))


def test_a_check_of_its_own_refuses_an_iterate():
    """The first one, 1.5, though the solution is less."""

    class Bounded(Own):
        def check(self, z):
            if z[0] > 1.45:
                raise ValueError("too far")

    with pytest.raises(ValueError, match="too far"):
        follow(Bounded(of_two, lambda z: 2.0 * z[0]), [1.0], 0.0, (-1e-9, 1e-9))


def test_steps_that_only_rounding_keeps_up_end_it_or_are_few():
    """Each step has the size 1e-9 at least: of the slow ones two are allowed."""
    problem = Own(of_two, lambda z: 2.0 * z[0], least=1e-9, stagnation=1e-8, tolerance=1e-12)
    assert follow(problem, [1.4], 0.0, (-0.01, 0.01)).ends == ("range", "range")
    asked = []

    def counted(x, p):
        asked.append(x[0])
        return of_two(x, p)

    problem = Own(counted, lambda z: 2.0 * z[0], least=1e-9, stagnation=0.0, patience=2)
    with pytest.raises(pp.NotConverged, match="did not converge"):
        follow(problem, [2.0**0.5], 0.0, (-1.0, 1.0))
    assert len(asked) < 9


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
        ((cubic, [0.0], 2.0, (-1, 1)), {}, "p0 must lie in [-1, 1], got 2"),
        ((cubic, [0.0], 0.0, (1, -1)), {}, "interval must be (lowest, highest), got (1, -1)"),
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


def circle(x, p):
    """Folds at p = -1 and 1, where x = 0."""
    return x**2 + p**2 - 1.0


def test_exceptions_of_the_equations_end_the_branch_which_says_so_and_keeps_what_it_has():
    def broken(error):
        def equations(x, p):
            if p > 0.5:
                raise error
            return x - p

        return equations

    for error in (ValueError("no such pipe"), RuntimeError("no such pipe"), KeyError("pipe")):
        branch = follow(broken(error), [0.0], 0.0, (-1.0, 1.0))
        assert branch.ends == ("range", "not converged")
        assert branch.p[-1] == pytest.approx(0.5, abs=1e-4)
        (failure,) = branch.failures
        assert failure.startswith(
            f"the branch was not followed beyond p = {branch.p[-1]:.6g}, x = ["
        )
        assert f"problem raised {type(error).__name__}: {error}, at p = 0.5" in failure
        with pytest.raises(type(error)):  # at the start it passes through
            follow(broken(error), [0.6], 0.6, (-1.0, 1.0))
    own = Own(broken(RuntimeError("no such pipe")), lambda x: 1.0)
    branch = follow(own, [0.0], 0.0, (-1.0, 1.0))
    assert branch.ends == ("range", "not converged")
    assert branch.failures[0].endswith("RuntimeError: no such pipe")


def test_where_equations_are_not_defined_it_says_so():
    branch = follow(lambda x, p: x - np.sqrt(0.3 - p), [0.5], 0.05, (0.0, 1.0), step=0.02)
    assert branch.ends == ("range", "not converged")
    assert branch.p[-1] == pytest.approx(0.3, abs=1e-5)
    (failure,) = branch.failures
    assert "problem gives nan at p = 0.3" in failure


def test_a_branch_that_takes_too_many_points_says_so():
    branch = follow(lambda x, p: x - p, [0.0], 0.0, (-1.0, 1.0), points=3)
    assert branch.ends == ("points", "points")
    for failure, p in zip(branch.failures, branch.p[[0, -1]], strict=True):
        assert failure.startswith(f"the branch was not followed beyond p = {p:.6g}, x = [")
        assert failure.endswith(": it takes more than 3 points")
    assert follow(lambda x, p: x - p, [0.0], 0.0, (-1.0, 1.0)).failures == ()


@pytest.mark.parametrize(
    ("derivative", "message"),
    [
        (
            lambda x, p: [[3.0 * x[0] ** 2 - 2.0, -1.0]],
            "of G[0] by x[0] at x0 and p0 it gives 3.88",
        ),
        (lambda x, p: [[3.0 * x[0] ** 2 - 1.0, 1.0]], "of G[0] by p at x0 and p0 it gives 1, and "),
    ],
)
def test_a_derivative_that_is_not_that_of_the_equations_is_refused(derivative, message):
    with pytest.raises(ValueError, match="derivative must be that of problem") as caught:
        follow(cubic, [-1.4], -1.344, (-2.0, 2.0), derivative=derivative)
    assert message in str(caught.value)


def test_a_scale_out_of_proportion_is_named():
    def small(x, p):
        return (x / 1e-6) ** 3 - x / 1e-6 - p

    def exact(x, p):
        return np.array([[(3.0 * (x[0] / 1e-6) ** 2 - 1.0) / 1e-6, -1.0]])

    said = "scale is out of proportion: it is 1, and x is about {}: folds may be passed over"
    branch = follow(small, [-1.4e-6], -1.344, (-2.0, 2.0), derivative=exact)
    assert branch.failures[-1] == said.format("2e-06")
    with pytest.raises(pp.NotConverged, match=said.format("5e-06")):
        follow(lambda x, p: small(x, p) ** 2 + 1.0, [5e-6], 0.0, (-2.0, 2.0))
    branch = follow(small, [-1.4e-6], -1.344, (-2.0, 2.0), scale=1e-6)
    assert branch.ends == ("range", "range")
    assert len(branch.folds) == 2


def test_differences_are_in_proportion_to_the_interval():
    branch = follow(lambda x, p: cubic(x, 1e9 * p), [-1.4], -1.344e-9, (-2e-9, 2e-9))
    assert branch.ends == ("range", "range")
    assert len(branch.folds) == 2


@pytest.mark.parametrize(("x0", "p0"), [(0.0, 1.0), (0.003, 1.0), (0.0, -1.0)])
def test_a_start_on_a_fold_is_followed(x0, p0):
    branch = follow(circle, [x0], p0, (-2.0, 2.0))
    assert branch.ends == ("closed", "closed")
    assert branch.x[0, 0] == pytest.approx(x0, abs=1e-5)
    assert branch.tangents[0, 0] > 0.99
    assert np.abs(circle(branch.x[:, 0], branch.p)).max() < 1e-12


def test_zeros_of_tests_at_both_ends_are_reported_once():
    tests = {"first": lambda x, p: x[0] + 1.0, "last": lambda x, p: x[0] - 1.0}
    branch = follow(lambda x, p: x - p, [0.0], 0.0, (-1.0, 1.0), tests=tests)
    assert [(one.kind, one.p) for one in branch.points] == [("first", -1.0), ("last", 1.0)]
    around = follow(circle, [1.0], 0.0, (-2.0, 2.0), tests={"start": lambda x, p: p})
    starts = [point for point in around.points if point.kind == "start"]
    assert sorted(point.x[0] for point in starts) == pytest.approx([-1.0, 1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("test", "said"),
    [
        (lambda x, p: np.sqrt(0.25 - p) - 0.6, "it gives nan at p = "),
        (lambda x, p: x[0] + 0.11 if p < 0.25 else {}["here"], "KeyError: 'here'"),
    ],
)
def test_a_test_that_gives_no_number_is_told_and_keeps_the_others(test, said):
    tests = {"root": test, "zero": lambda x, p: x[0]}
    branch = follow(lambda x, p: x - p, [-0.5], -0.5, (-1.0, 1.0), tests=tests)
    assert branch.ends == ("range", "range")
    assert [point.kind for point in branch.points] == ["root", "zero"]
    (failure,) = branch.failures
    assert failure.startswith("zeros of tests['root'] are not known from p = 0.2")
    assert said in failure
    with pytest.raises(TypeError, match="tests\\['root'\\] must give a number, got"):
        follow(lambda x, p: x - p, [0.0], 0.0, (-1.0, 1.0), tests={"root": lambda x, p: x})


@pytest.mark.parametrize("p0", [0.0, 0.4])
def test_an_interval_may_end_where_the_equations_do(p0):
    """As that of a pipe's number which must not be negative: differences are then one-sided."""

    def equations(x, p):
        if p < 0.0:
            raise ValueError("p must be positive")
        return x**3 + x - np.exp(p)

    branch = follow(equations, [0.8], p0, (0.0, 1.0))
    assert branch.ends == ("range", "range")
    assert branch.failures == ()
    assert branch.p[[0, -1]].tolist() == [0.0, 1.0]
    slope = 1.0 / (3.0 * branch.x[0, 0] ** 2 + 1.0)
    assert branch.tangents[0, 0] / branch.tangents[0, 1] == pytest.approx(slope, rel=1e-8)
