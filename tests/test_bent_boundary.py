# SPDX-License-Identifier: MIT
"""Boundaries of stability of pipes that rest bent, in the plane of two numbers.

Points of curves are checked by rests that scipy solves for from the motion's accelerations, and by
eigenvalues of its Jacobian, which share neither matrices nor continuation with the curves.
"""

import dataclasses
import math
import warnings

import numpy as np
import pytest
import scipy

import pipedyn as pp

LEVEL = math.pi / 2
silent = pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")


def level(gamma=10.0, **numbers):
    return pp.Pipe(0.2, gamma, inclination=LEVEL, **{"damping": 0.005, **numbers})


def changed(pipe, name, value):
    """The pipe with another value of a number, without the package's table of numbers."""
    if "." not in name:
        return dataclasses.replace(pipe, **{name: value})
    kind, number = name.split(".")
    terms = [
        dataclasses.replace(one, **{number: value}) if type(one).__name__ == kind else one
        for one in pipe.terms
    ]
    return dataclasses.replace(pipe, terms=terms)


def at_point(found, curve, k):
    """The model and the flow speed at a point of a curve."""
    pipe, u = found.model.pipe, found.u
    for name, value in zip(found.names, (float(curve.x[k]), float(curve.y[k])), strict=True):
        u = value if name == "u" else u
        pipe = pipe if name == "u" else changed(pipe, name, value)
    return found.model.with_pipe(pipe), u


def small_motions(model, u):
    """Eigenvalues of the motion about the rest that follows loads and flow, by scipy.

    In three dimensions those of motions in the plane of rest come first, then those across it.
    """
    planar, half = model.planar, model.planar.dof
    light = dataclasses.replace(
        model.pipe,
        gamma=0.0,
        terms=[
            dataclasses.replace(one, force_x=0.0, force_y=0.0) if isinstance(one, pp.Load) else one
            for one in model.pipe.terms
        ],
    )

    def turning(q, share, speed):
        y = np.append(q, 0.0 * q)
        parts = [one.rhs(0.0, y, speed)[half:] for one in (planar, planar.with_pipe(light))]
        return share * parts[0] + (1.0 - share) * parts[1]

    rest = np.zeros(half)
    for share in np.linspace(0.0, 1.0, 21):
        rest = scipy.optimize.root(turning, rest, args=(share, 0.0), tol=1e-13).x
    for speed in np.linspace(0.0, u, 21):
        rest = scipy.optimize.root(turning, rest, args=(1.0, speed), tol=1e-13).x
    if model is planar:
        return [np.linalg.eigvals(model.jacobian(0.0, np.append(rest, 0.0 * rest), u))]
    whole = model.jacobian(0.0, np.concatenate([rest, np.zeros(3 * half)]), u)
    rows = [np.r_[k * half : (k + 1) * half, (k + 2) * half : (k + 3) * half] for k in (0, 1)]
    return [np.linalg.eigvals(whole[np.ix_(own, own)]) for own in rows]


def assert_on_the_axis(found, curve, k):
    """Asserts that a point of flutter is one, with the number of other unstable roots."""
    each = small_motions(*at_point(found, curve, k))
    own = each[int(bool(curve.across))]
    root = 1j * curve.frequency[k]
    assert np.abs(own - root).min() < 1e-6 * (1.0 + abs(root))
    others = sum(np.count_nonzero(one.real > 1e-6) for one in each)
    assert others == curve.unstable[k]


@silent
@pytest.mark.parametrize("seed", range(8))
def test_points_of_random_bent_pipes_are_those_of_the_motion(seed):
    rng = np.random.default_rng(seed)
    terms = [pp.Load(0.8, rng.normal(size=2)), pp.FollowerForce(0.7, rng.normal())]
    if rng.random() < 0.5:
        terms.append(pp.Spring(0.6, 5.0, 12.0))
    pipe = pp.Pipe(
        rng.uniform(0.1, 0.3),
        rng.uniform(2.0, 12.0),
        inclination=rng.uniform(0.3, 2.0),
        damping=rng.uniform(0.002, 0.02),
        terms=terms,
    )
    numbers = {"gamma": (2.0, 12.0), "beta": (0.1, 0.3), "Load.force_x": (0.5, 2.0)}
    numbers |= {"FollowerForce.force": (-1.0, 3.0), "damping": (0.002, 0.02)}
    name = sorted(numbers)[seed % 5]
    make = pp.Chain if seed % 2 else pp.Galerkin
    size, basis = (3, {}) if seed % 2 else (5, {"basis": "legendre"})
    model = make(pipe, size, **basis, dimensions=2 + seed // 4)
    found = pp.boundary(model, name, "u", {name: numbers[name], "u": (0.0, 9.0)}, criticality=False)
    assert not found.failures
    flutters = [one for one in found.curves if one.kind == "flutter"]
    assert flutters
    for curve in flutters:
        for k in (1, len(curve) // 2, len(curve) - 2):
            assert_on_the_axis(found, curve, k)
    # The lowest curve is the critical speed.
    middle, values = float(np.mean(numbers[name])), []
    for curve in found.curves:
        beside = (curve.x[:-1] - middle) * (curve.x[1:] - middle) <= 0.0
        values += [float(curve.y[k]) for k in np.flatnonzero(beside)]
    first = pp.critical_speed(model.with_pipe(changed(pipe, name, middle)), 9.0).speed
    assert min(values) == pytest.approx(first, abs=0.1)
    assert found.unstable(middle, first - 1e-4) == 0 < found.unstable(middle, first + 1e-4)


def test_a_sagging_pipe_flutters_across_below_the_curve_of_its_plane():
    """Ends of the curves: the continuous pipe's boundary-value problem, see test_bent_space."""
    model = pp.Galerkin(level(damping=0.0), 10, "legendre", dimensions=3)
    window = {"gamma": (10.0, 20.0), "u": (5.5, 7.0)}
    found = pp.boundary(model, "gamma", "u", window, criticality=False)
    ends = {one.across: (one.y[[0, -1]], one.unstable) for one in found.curves}
    across, in_plane = ends[True], ends[False]
    assert sorted(across[0]) == pytest.approx([5.7797017, 6.2343973], abs=2e-5)
    assert sorted(in_plane[0]) == pytest.approx([5.9544239, 6.6770006], abs=2e-5)
    assert (set(across[1]), set(in_plane[1])) == ({0}, {2})


def test_a_pipe_without_weight_has_the_curves_of_both_planes_in_one_point():
    model = pp.Chain(level(), 3, dimensions=3)
    window = {"gamma": (0.0, 6.0), "u": (3.0, 6.5)}
    found = pp.boundary(model, "gamma", "u", window)
    straight = pp.critical_speed(pp.Chain(pp.Pipe(0.2, damping=0.005), 3)).speed
    assert [one.across for one in found.curves] == [False, True]
    assert not found.points  # that pairs of both planes coincide there organises nothing
    for one in found.curves:
        assert (one.x[0], one.y[0]) == pytest.approx((0.0, straight), abs=1e-9)
        assert one.ends == ("range", "range")
        assert set(one.unstable) == {0 if one.across else 2}
    across = found.curves[1]
    k = len(across) // 2
    there, _ = at_point(found, across, k)
    onset = pp.hopf(there)
    assert onset.speed == pytest.approx(across.y[k], abs=1e-8)
    assert onset.lyapunov == pytest.approx(across.lyapunov[k], rel=1e-5)
    assert onset.criticality == across.criticality[k]


@silent
def test_windows_with_and_without_the_flow_speed_have_the_same_points():
    model = pp.Chain(level(), 3)
    by_speed = pp.boundary(
        model, "gamma", "u", {"gamma": (0.0, 20.0), "u": (3.0, 8.0)}, criticality=False
    )
    (curve,) = by_speed.curves
    held = pp.boundary(
        model, "gamma", "beta", {"gamma": (0.0, 20.0), "beta": (0.1, 0.3)}, u=5.5, criticality=False
    )
    (other,) = held.curves
    at = np.interp(0.2, *(np.array([other.y, other.x])[:, np.argsort(other.y)]))
    assert np.interp(at, curve.x, curve.y) == pytest.approx(5.5, abs=2e-3)
    for k in (0, len(other) // 2):
        assert_on_the_axis(held, other, k)


@silent
def test_a_standing_pipe_snaps_where_its_rest_turns_back_and_its_folds_meet_in_a_cusp():
    model = pp.Chain(pp.Pipe(0.2, -5.0, inclination=0.05, damping=0.01), 3)
    window = {"gamma": (-30.0, 0.0), "u": (0.0, 6.0)}
    found = pp.boundary(model, "gamma", "u", window, criticality=False)
    assert not found.failures
    (folds,) = (one for one in found.curves if one.kind == "divergence")
    flutter = next(one for one in found.curves if one.kind == "flutter")
    (cusp,) = (one for one in found.points if one.kind == "cusp")
    assert "cusp" in folds.ends
    assert cusp.x == pytest.approx(folds.x.max(), abs=1e-9)
    for k in (0, len(folds) // 2):
        there, u = at_point(found, folds, k)
        with pytest.raises(pp.NotConverged, match="it turns back") as turned:
            pp.crossings(there, u + 0.5)
        assert turned.value.result[-1].speed == pytest.approx(u, abs=1e-9)
        # Two equilibria meet there and vanish.
        near = [
            sum(np.abs(q).max() > 0.3 for q in pp.equilibria(there, u + step).q)
            for step in (-0.02, 0.02)
        ]
        assert near[0] == near[1] + 2
    # The pipe comes to no rest beyond a fold, nor does flutter go on beyond the cusp.
    x, y = float(folds.x[len(folds) // 2]), float(folds.y[len(folds) // 2])
    with pytest.raises(pp.NotConverged, match="it turns back at u"):
        found.unstable(x, y + 0.3)
    assert found.unstable(x, y - 0.3) == 0
    assert "fold" in flutter.ends
    assert flutter.x.min() == pytest.approx(cusp.x, abs=0.01)
    left = folds.change > 0  # the side without rest lies above
    assert (left == (folds.slopes[:, 0] > 0.0)).all()


def test_a_pipe_diverges_across_its_plane_where_loads_turn_to_the_other_side():
    """The same loads as in test_bent_space, over the one that buckles the pipe."""
    loads = [pp.Load(1.0, (0.05, -3.5)), pp.Load(0.6, (-0.1, 0.0))]
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.01, terms=loads), 4, "legendre", dimensions=3)
    name = "terms[0].force_y"
    window = {name: (-3.7, -3.45), "u": (0.0, 2.0)}
    found = pp.boundary(model, name, "u", window)
    across = next(one for one in found.curves if one.across)
    (folds,) = (one for one in found.curves if not one.across)
    assert (across.kind, folds.kind) == ("divergence", "divergence")
    assert set(across.criticality) | set(folds.criticality) == {""}
    assert set(across.unstable) == {0}
    assert set(folds.unstable) == {1}
    for k in (0, len(across) // 2, len(across) - 1):
        pipe = dataclasses.replace(
            model.pipe, terms=[pp.Load(1.0, (0.05, float(across.x[k]))), loads[1]]
        )
        there = pp.critical_speed(model.with_pipe(pipe))
        assert (there.kind, there.across) == ("divergence", True)
        assert there.speed == pytest.approx(across.y[k], abs=1e-8)


@silent
@pytest.mark.parametrize(
    ("pipe", "ranges"),
    [
        (level(end="pinned"), {"gamma": (5.0, 20.0), "u": (0.0, 5.0)}),
        (level(root=pp.RootSpring(5.0)), {"root.stiffness": (2.0, 20.0), "u": (3.0, 7.0)}),
        (level(damping=0.0, hysteresis=0.05), {"gamma": (0.0, 20.0), "u": (3.0, 8.0)}),
        (pp.Pipe(0.2, jet_angle=0.5, damping=0.01), {"beta": (0.1, 0.4), "u": (0.0, 8.0)}),
        (pp.Pipe(0.2, 5.0, "aspirating", inclination=1.0, damping=0.05),
         {"gamma": (0.0, 10.0), "u": (0.0, 3.0)}),
    ],
)  # fmt: skip
def test_all_ways_in_which_pipes_bend_have_boundaries_at_their_crossings(pipe, ranges):
    model, (name, (low, high)) = pp.Chain(pipe, 4), next(iter(ranges.items()))
    found = pp.boundary(model, *ranges, ranges, criticality=False)
    for x in (low, 0.5 * (low + high), high):
        moved = dataclasses.replace(
            pipe, **({"root": pp.RootSpring(x)} if name == "root.stiffness" else {name: x})
        )
        bottom, top = ranges["u"]
        every = pp.crossings(model.with_pipe(moved), top)
        expected = [one.speed for one in every if one.speed > max(bottom, 1e-9)]
        met = sum(
            np.count_nonzero((one.x[:-1] - x) * (one.x[1:] - x) < 0.0)
            + np.count_nonzero(one.x == x)
            for one in found.curves
        )
        assert met == len(expected)
        for u in expected:
            nearest = min(float(np.hypot(one.x - x, one.y - u).min()) for one in found.curves)
            assert nearest < 0.05 * (high - low)


def test_boundaries_of_a_plane_tell_of_the_other_and_results_keep_the_plane(tmp_path):
    chain = pp.Chain(level(), 2)
    window = {"gamma": (8.0, 10.0), "u": (3.0, 6.0)}
    with pytest.warns(pp.FluttersAcross, match="may flutter first across"):
        planar = pp.boundary(chain, "gamma", "u", window, criticality=False)
    assert {one.across for one in planar.curves} == {None}
    with warnings.catch_warnings():
        warnings.simplefilter("error", pp.FluttersAcross)
        found = pp.boundary(
            pp.Chain(level(), 2, dimensions=3), "gamma", "u", window, criticality=False
        )
    found.save(tmp_path / "found.npz")
    loaded = pp.load(tmp_path / "found.npz")
    assert [one.across for one in loaded.curves] == [one.across for one in found.curves]
    assert loaded.unstable(9.0, 3.5) == 0
    ax = pp.plot.boundary(found)
    labels = {line.get_label() for line in ax.lines}
    assert "flutter across" in labels


def test_a_configuration_of_ones_own_has_no_boundary():
    chain = pp.Chain(level(), 3)
    about = chain.about(pp.equilibria(chain, 2.0).q[0])
    with pytest.raises(ValueError, match="model must not be about a configuration"):
        pp.boundary(about, "gamma", "u", {"gamma": (0.0, 20.0), "u": (2.0, 8.0)})


def test_hysteresis_in_space_has_boundaries_at_its_crossings_with_paths_uphill():
    model = pp.Galerkin(level(damping=0.0, hysteresis=0.05), 4, "legendre", dimensions=3)
    window = {"gamma": (4.0, 16.0), "u": (4.0, 7.5)}
    found = pp.boundary(model, "gamma", "u", window, criticality=False)
    held = pp.boundary(
        model, "gamma", "beta", {"gamma": (4.0, 16.0), "beta": (0.1, 0.3)}, u=5.8, criticality=False
    )
    assert not found.failures + held.failures
    for curves, name in ((found.curves, "u"), (held.curves, "beta")):
        assert {one.across for one in curves} == {False, True}
        for one in curves:
            k = len(one) // 2
            pipe = dataclasses.replace(model.pipe, gamma=float(one.x[k]))
            u = 5.8
            if name == "u":
                u = one.y[k]
            else:
                pipe = dataclasses.replace(pipe, beta=float(one.y[k]))
            every = pp.crossings(model.with_pipe(pipe), 8.0)
            near = [each.speed for each in every if each.across == one.across]
            assert min(abs(speed - u) for speed in near) < 1e-6


def test_curves_in_space_end_where_a_joint_turns_over_and_failures_say_so():
    pipe = pp.Pipe(0.3, 5.0, damping=0.005, jet_angle=0.3)
    window = {"gamma": (2.0, 12.0), "u": (0.0, 8.0)}
    model = pp.Chain(pipe, 3, dimensions=3)
    found = pp.boundary(model, "gamma", "u", window, criticality=False)
    assert [curve.across for curve in found.curves] == [False, True, False]
    assert all("a joint turns by" in failure for failure in found.failures)
    assert found.failures


@pytest.mark.parametrize(
    ("name", "high", "gamma", "make"),
    [
        ("inclination", 1.5, 10.0, lambda pipe: pp.Chain(pipe, 4, dimensions=3)),
        ("jet_angle", 0.6, 0.0, lambda pipe: pp.Galerkin(pipe, 5, "legendre", dimensions=3)),
    ],
)
def test_boundaries_and_maps_run_from_a_straight_pipe_to_bent_ones(name, high, gamma, make):
    model = make(pp.Pipe(0.2, gamma, damping=0.001))
    ranges = {name: (0.0, high), "u": (4.0, 8.0)}
    found = pp.boundary(model, name, "u", ranges, criticality=False, only_stability=True)
    across, along = sorted(found.curves, key=lambda curve: -curve.across)
    assert (across.across, along.across, found.failures) == (True, False, ())
    assert across.x.min() == along.x.min() == 0.0
    assert along.x.max() == across.x.max() == high
    few = slice(None, None, across.x.size // 4)
    critical = pp.critical_speeds(model, {name: across.x[few]})
    assert critical.speeds == pytest.approx(across.y[few], rel=1e-8)
    assert critical.across[across.x[few] > 0.1].all()


@silent
@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_curve_that_meets_a_line_twice_between_its_samples_is_found(dimensions):
    """A force to either side bends the pipe, which then flutters earlier than the hanging one."""
    pipe = pp.Pipe(0.2, 10.0, damping=0.005, terms=[pp.Load(1.0, (1.0, 0.0))])
    chain = pp.Chain(pipe, 3, dimensions=dimensions)
    window = {"Load.force_x": (-3.0, 4.0), "beta": (0.17, 0.20005)}
    found = pp.boundary(chain, *window, window, u=5.468, criticality=False)
    assert [one.across for one in found.curves] == ([None] if dimensions == 2 else [False, True])
    for curve in found.curves:
        assert curve.ends == ("range", "range")
        assert curve.x[[0, -1]] == pytest.approx([-abs(curve.x[0]), abs(curve.x[0])], abs=1e-8)
        assert abs(curve.x[0]) < 0.3
        assert_on_the_axis(found, curve, 0)
        assert_on_the_axis(found, curve, len(curve) // 2)


@silent
def test_a_closed_curve_of_a_bent_pipe_that_no_line_meets_is_reached_uphill():
    """The spring that holds the pipe best and a force of 0: the only place of stability."""
    terms = [pp.Spring(1.0, 2.0), pp.Load(1.0, (1.0, 0.0))]
    chain = pp.Chain(pp.Pipe(0.5, 10.0, damping=0.005, terms=terms), 3)
    window = {"Spring.stiffness": (0.0, 40.0), "Load.force_x": (-3.0, 4.0)}
    found = pp.boundary(chain, *window, window, u=6.5265, criticality=False)
    (curve,) = found.curves
    assert curve.ends == ("closed", "closed")
    assert found.unstable(2.7, 0.0) == 0 < found.unstable(2.7, 0.2)
    for k in (0, len(curve) // 3):
        assert_on_the_axis(found, curve, k)


def test_a_pipe_that_buckles_at_rest_diverges_across_its_plane_where_it_is_bent_further():
    spring = pp.Spring(0.3, 28.0, stiffness_across=43.0)
    model = pp.Chain(pp.Pipe(0.2, -10.0, jet_angle=0.05, terms=[spring]), 3, dimensions=3)
    ranges = {"jet_angle": (0.05, 0.1), "u": (0.5, 1.5)}
    found = pp.boundary(model, "jet_angle", "u", ranges, criticality=False)
    assert not found.failures
    with pytest.raises(pp.NotConverged, match="turns back") as stopped:
        pp.crossings(model, 1.5)
    at_edge = {one.across: one.speed for one in stopped.value.result}
    assert {one.ends for one in found.curves} == {("range", "range"), ("range", "fold")}
    for curve in found.curves:
        assert curve.x[0] == 0.05
        assert curve.y[0] == pytest.approx(at_edge["fold" in curve.ends], abs=1e-6)
