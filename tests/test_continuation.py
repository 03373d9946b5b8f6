# SPDX-License-Identifier: MIT
"""Pseudo-arclength continuation: on curves that are known, and of orbits on meshes that change."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem
from pipedyn.continuation.tracer import TestFunction as Function
from pipedyn.continuation.tracer import Tracer, special_points
from pipedyn.curves.boundary import checked_window
from pipedyn.curves.boundary_curves import CurveTracer, line_starts, not_followed
from pipedyn.curves.event_onset import Onset
from pipedyn.curves.event_plane import EventPlane
from pipedyn.linear.following import GrowthTest
from pipedyn.linear.plane import Plane, Scale, Window
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.orbit_continuation import FINE, branch_steps, from_hopf, orbit_at
from pipedyn.util.newton import NewtonFailed, newton, zero_between, zeros_between


def circle_equations(x, p):
    """x^2 + p^2 = 1 for the first unknown, which the second one equals."""
    derivative = np.array([[2.0 * x[0], 0.0, 2.0 * p], [-1.0, 1.0, 0.0]])
    return np.array([x[0] ** 2 + p**2 - 1.0, x[1] - x[0]]), derivative


@pytest.fixture
def circle():
    return DenseProblem(circle_equations, 2, 1.0, Control(longest=0.2))


@pytest.mark.parametrize("p0", [-0.8, 0.0, 0.3])
@pytest.mark.parametrize("step", [0.05, 0.2, 1.0])
def test_a_closed_curve_is_followed_once_around_both_folds(step, p0):
    circle = DenseProblem(circle_equations, 2, 1.0, Control(longest=step))
    x = np.full(2, np.sqrt(1.0 - p0**2))
    start = circle.point(np.append(x, p0), np.array([0.0, 0.0, 1.0]))
    tracer = Tracer([(-1, -3.0, 3.0)])
    points, ends, reasons = tracer.both_ways(circle, start, 0.2 * step)
    assert ends == ("closed", "closed")
    assert reasons == ("", "")
    steps = circle.steps(start, 0.2 * step, [(-1, p0)])  # with a point wherever it passes p0
    marked, end, _ = tracer.one_way(steps, circle, start)
    assert end == "closed"
    assert [point.p for point in marked].count(p0) == 3
    assert points[0] is points[-1] is start
    turns = []
    for a, b in pairwise(points):
        segment = BranchStep(circle, a, b)
        turns += [segment.at(s).p for *_, s in special_points(segment, 1e-9, ())]
        assert b.x**2 + b.p**2 == pytest.approx(np.ones(2), abs=1e-12)
        assert circle.length(b.tangent) == pytest.approx(1.0, abs=1e-14)
        # With this metric the curve is the unit circle: its tangent is across the radius.
        assert circle.product(b.tangent, b.z) == pytest.approx(0.0, abs=1e-12)
    assert turns == pytest.approx([1.0, -1.0], abs=1e-12)


def test_a_segment_is_solved_for_at_a_length_and_at_a_parameter(circle):
    begin = circle.point(np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    segment, _ = circle.next(begin, 0.2)
    assert segment.at(0.1).p == pytest.approx(0.1, abs=1e-13)  # along the tangent at p = 0
    found = segment.where(0.15)
    assert found[:-1] == pytest.approx(np.full(2, np.sqrt(1.0 - 0.15**2)), abs=1e-12)
    assert found[-1] == 0.15
    passing = Function(segment, 1e-10, lambda point: point.p - 0.123, "passed")
    ((name, before, beyond),) = special_points(segment, 0.0, [passing])
    assert name == "passed"
    assert (before, beyond) == pytest.approx((0.123, 0.123), abs=1e-9)
    assert segment.at(before).p <= 0.123 < segment.at(beyond).p
    # The cubic through the ends misses by the fourth power of the length.
    for length in (0.05, 0.1, 0.15):
        assert segment.guess(length) == pytest.approx(segment.at(length).z, abs=1e-4)


@pytest.mark.parametrize(
    ("growths", "expected"),
    [
        (lambda u: (1e-3 - (u - 0.56) ** 2, -1.0), [0.56 - 1e-3**0.5, 0.56 + 1e-3**0.5]),
        (lambda u: ((u - 0.56) ** 2 - 1e-3, -1.0), [0.56 - 1e-3**0.5, 0.56 + 1e-3**0.5]),
        (lambda u: (0.53 - u, u - 0.55), [0.53, 0.55]),
        (lambda u: (u - 0.5301, 0.53 - u), [0.53, 0.5301]),
        (lambda u: (0.51 - u, 0.52 - u), [0.51, 0.52]),
    ],
    ids=["grows within a step", "ceases to within a step", "swap", "swap nearby", "both cease to"],
)
def test_each_root_that_passes_the_axis_is_found_whatever_the_others_do(growths, expected):
    random = np.random.default_rng(0)

    def roots(u):
        pairs = np.array(growths(u)) + 1j * np.array([8.0, 20.0])
        return random.permutation(np.concatenate([pairs, pairs.conj()]))

    found, before = [], None
    for low, high in pairwise(np.linspace(0.0, 1.0, 9)):
        step = SimpleNamespace(length=high - low, at=lambda s, low=low: low + s)
        before = GrowthTest(step, 1e-9, roots, before=before)
        found += [low + s for _, s in before.changes(0.0, high - low)]
    assert found == pytest.approx(expected, abs=2e-9)


def test_a_guess_uses_what_was_solved_for_and_leads_beyond_the_end(circle):
    begin = circle.point(np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    segment, _ = circle.next(begin, 0.2)

    def missed(s, true):
        return np.abs(segment.guess(s) - np.append(np.full(2, np.sqrt(1.0 - true**2)), true)).max()

    before = missed(0.11, 0.11)  # lengths are those of p, along the tangent at p = 0
    assert segment.at(0.1).p == pytest.approx(0.1, abs=1e-13)
    assert segment.guess(0.1) == pytest.approx(segment.at(0.1).z, abs=1e-15)
    assert missed(0.11, 0.11) < 0.25 * before
    segment.at(0.2 - 1e-9)  # of no use for an extrapolation
    # Beyond the end the cubic stays nearer to the circle than the tangent, by far.
    apart = [
        np.abs(z[:2] ** 2 + z[2] ** 2 - 1.0).max()
        for z in (segment.ahead(0.1), segment.end.z + 0.1 * segment.end.tangent)
    ]
    assert apart[0] < 0.05 * apart[1]


def test_where_a_curve_ends_continuation_fails():
    def ending(x, p):
        slope = np.full(2, 0.5 / np.sqrt(0.1 - p))
        return x - np.sqrt(0.1 - p), np.column_stack([np.eye(2), slope])

    branch = DenseProblem(ending, 2, 1.0, Control(longest=0.2, shortest=1e-3))
    point, step = branch.point(np.append(np.full(2, np.sqrt(0.1)), 0.0), np.array([0, 0, 1.0])), 0.1

    def follow(point, step):
        while point.p < 0.1:
            segment, step = branch.next(point, step)
            point = segment.end

    with pytest.raises(NewtonFailed):
        follow(point, step)


def test_meshes_of_orbits_are_refined_on_the_way_and_beyond_1000_unknowns():
    """Twenty segments far beyond the onset: the orbits are those that are found there alone."""
    model = pp.Chain(pp.Pipe(0.2), 20)
    motion = VectorField(model)
    sizes, last = [], None
    for step in branch_steps(motion, from_hopf(motion, pp.hopf(model)), FINE):
        orbit = orbit_at(step, step.length)
        sizes.append(orbit.rates.size)
        assert orbit.defects().max() <= FINE.defect
        assert orbit.states(np.array([0.0])) == pytest.approx(
            -orbit.states(np.array([np.pi])), abs=1e-9 * np.abs(orbit.starts).max()
        )
        if step.begin.p < 7.5 <= orbit.u:
            last = step.problem.orbit(step.where(7.5))
            break
    assert sizes[0] == 4 * 8 * 20
    assert sizes[-1] > 1000
    alone = pp.limit_cycle(model, 7.5)
    assert last.frequency == pytest.approx(alone.frequency, rel=1e-8)


def test_at_rest_drag_has_no_slope_also_where_guides_leave_differences_alone():
    scene = pp.modular.chain(pp.Pipe(0.2), n=4).plus(pp.modular.Guide(node=2))
    drags = VectorField(scene.with_pipe(pp.Pipe(0.2, drag=5.0)))
    plain = VectorField(scene).jacobian(np.zeros(8), 5.0)
    np.testing.assert_array_equal(drags.jacobian(np.zeros(8), 5.0), plain)
    moving = np.append(np.zeros(4), 1e-3 * np.ones(4))
    assert np.abs(drags.jacobian(moving, 5.0) - plain).max() > 1e-3


# ---------------------------------------------------------------- curves in a plane of two numbers


class Ring(Plane):
    """One degree of freedom, damped by its distance's square from a circle: it flutters inside."""

    def __init__(self, center=(0.5, 0.5), radius=0.3):
        self.center, self.radius = np.array(center), radius
        self._scales = [Scale(0.0, 1.0)] * 2
        self.window = Window((None, None), np.zeros(2), np.ones(2))
        self.dof = self.modes = 1
        self.hysteretic = self.conservative = False
        self.exact, self.speed_index, self.speed = True, None, 1.0

    def matrices(self, at):
        away = at - self.center
        one, none = np.ones((1, 1)), np.zeros((1, 1))
        damping = np.full((1, 1), float(away @ away - (self.radius**2).real))
        by_x, by_y = ((none, 2.0 * part * one, none) for part in away)
        return (one, damping, one), by_x, by_y

    def at(self, at):
        return self.matrices(at)[0]


@pytest.mark.parametrize(
    ("center", "radius", "only_stability"),
    [((0.5, 0.5), 0.3, False), ((0.68, 0.27), 0.05, False), ((0.68, 0.27), 0.05, True)],
    ids=["met by lines", "met by none", "stability"],
)
def test_a_closed_curve_that_no_edge_meets_is_found_and_closes(center, radius, only_stability):
    """Small ones, which no line meets, are reached uphill."""
    plane = Ring(center, radius)
    starts, failures = line_starts(plane, only_stability)
    tracer = CurveTracer(plane, starts)
    (curve,) = tracer.trace(starts)
    assert failures == [*not_followed(plane, tracer.curves)] == []
    assert curve.ends == ("closed", "closed")
    away = curve.places() - plane.center
    assert away[0].tolist() == away[-1].tolist()
    assert np.hypot(*away.T) == pytest.approx(radius, abs=1e-12)
    turned = np.unwrap(np.arctan2(*away.T))
    assert abs(turned[-1] - turned[0]) == pytest.approx(2.0 * np.pi)
    (change,) = {curve.problem.change(point) for point in curve.points}
    assert change * (turned[-1] - turned[0]) < 0.0  # the inside, left of the way, is unstable


def test_damping_that_has_an_extreme_beside_the_axis_is_no_curve():
    plane = Ring(center=(0.68, 0.27), radius=0.0)
    plane.radius = 0.1j  # damped everywhere
    assert line_starts(plane) == ([], [])


SPRUNG = pp.Pipe(0.07, gamma=5.0, root=pp.RootSpring(3.0), damping=0.01, hysteresis=0.02)


@pytest.mark.parametrize(
    "model",
    [pp.Chain(SPRUNG, 3), pp.Galerkin(SPRUNG, 4, "legendre"), pp.modular.chain(SPRUNG, 3)],
    ids=["chain", "legendre", "scene"],
)
def test_derivatives_by_a_roots_stiffness_hold_where_numbers_begin(model):
    """Eigenvalues of pipes whose numbers differ by a little, on the corner of the window."""
    ranges = {"root.stiffness": (1.0, 40.0), "alpha": (0.0, 3.0)}
    plane = Plane(model, checked_window(model, tuple(ranges), ranges), 7.0)
    at = np.array([1.0, 0.0])
    whole, *slopes = plane.matrices(at)

    def determinant(at, power):
        mass, damping, stiffness = plane.at(at)
        return np.linalg.slogdet(stiffness + 3.0j * damping - 9.0 * mass)[1]

    inverse = np.linalg.inv(whole[2] + 3.0j * whole[1] - 9.0 * whole[0])
    for k, (by_mass, by_damping, by_stiffness) in enumerate(slopes):
        slope = np.trace(inverse @ (by_stiffness + 3.0j * by_damping - 9.0 * by_mass)).real
        step = np.eye(2)[k] * 1e-4
        values = [determinant(at + i * step, 3.0j) for i in range(5)]
        by_differences = np.dot([-25.0, 48.0, -36.0, 16.0, -3.0], values) / 12e-4
        assert slope == pytest.approx(by_differences, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_with_folds_of_the_onset_that_one_is_followed_which_the_cycles_come_from(which):
    """Of six segments it turns back near beta = 0.2912 and 0.289: between there are three."""
    model = pp.Chain(pp.Pipe(0.2905), 6)
    begins = [c.speed for c in pp.crossings(model, 8.0) if c.unstable_before + c.unstable_after < 3]
    assert len(begins) == 3

    def make(beta):
        return VectorField(model.with_pipe(replace(model.pipe, beta=beta)))

    plane = EventPlane(make, ("beta", "u"), model, 0.2905, ((0.28, 0.3), (6.0, 9.0)))
    onset = Onset(plane, begins[which], 9.0)
    assert onset.failures == []
    values = np.array([0.285, 0.288, 0.29, 0.2905, 0.291, 0.2914, 0.295])
    speeds = onset.along(values)
    assert speeds[3] == pytest.approx(begins[which], rel=1e-10)
    assert [len(pp.crossings(pp.Chain(pp.Pipe(b), 6), 8.0)) for b in (0.288, 0.2914)] == [1, 1]
    known = [slice(None, 5), slice(2, 5), slice(2, None)][which]
    assert np.flatnonzero(np.isfinite(speeds)).tolist() == list(range(7))[known]
    for beta, speed in zip(values[known], speeds[known], strict=True):
        other = pp.crossings(pp.Chain(pp.Pipe(float(beta)), 6), 8.0)
        assert min(abs(c.speed - speed) for c in other) < 1e-9
    assert (np.diff(speeds[known]) > 0.0).all() == (which != 1)


def test_newtons_method_gives_up_a_search_that_diverges_at_its_second_step():
    def searched(start, **rules):
        """Newton's method for arctan x = 0, which converges from |x| < 1.39 only."""
        sizes = []

        def correction(x):
            step = -(1.0 + x**2) * np.arctan(x)
            sizes.append(abs(step))
            return step, sizes[-1]

        try:
            return newton(start, correction, tolerance=1e-12, **rules), len(sizes)
        except NewtonFailed:
            return None, len(sizes)

    assert searched(1.3, hopeless=3.0)[0] == pytest.approx(0.0, abs=1e-12)
    assert searched(1.5, iterations=6) == (None, 6)
    assert searched(1.5, iterations=6, hopeless=3.0) == (None, 2)


ZEROS = {
    "smooth": (lambda x: np.cos(x), 1.0, 2.0, np.pi / 2.0),
    "at its beginning": (lambda x: x, 0.0, 1.0, 0.0),
    "at its end": (lambda x: x - 1.0, 0.0, 1.0, 1.0),
    "steep": (lambda x: np.expm1(40.0 * (x - 0.1)), 0.0, 1.0, 0.1),
    "a jump": (lambda x: np.sign(x - 1.0 / 3.0) + 1e-9, 0.0, 1.0, 1.0 / 3.0),
    "flat, and then like a root": (
        lambda x: np.sqrt(np.maximum(x - 0.3, 0.0)) - 1e-6,
        *(0.0, 1.0, 0.3 + 1e-12),
    ),
    "far away": (lambda x: x - 1e6 * np.pi, 3e6, 4e6, 1e6 * np.pi),
    "of high order": (lambda x: (x - 0.2) ** 9, -1.0, 0.5, 0.2),
}


@pytest.mark.parametrize("kind", ZEROS)
def test_zeros_lie_as_near_as_they_are_asked_for(kind):
    function, low, high, zero = ZEROS[kind]
    asked = []

    def counted(x):
        asked.append(x)
        return float(function(x))

    for error in (1e-3, 1e-12):
        assert abs(zero_between(counted, low, high, error) - zero) <= error + 1e-15 * abs(zero)
    assert len(asked) <= 80
    ends = np.array([low, high]), np.array([high, low])
    both = zeros_between(function, *ends, *map(function, ends))
    assert both == pytest.approx([zero, zero], rel=1e-15, abs=1e-12)
