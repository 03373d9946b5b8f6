# SPDX-License-Identifier: MIT
"""Rests out of the plane of a load, against scipy's root from random starts, Jacobians, motions."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq, root

import pipedyn as pp

LEANING = pp.Pipe(
    0.2,
    -5.0,
    damping=0.01,
    root=pp.RootSpring(8.0, 4.0),
    terms=[pp.Load(1.0, (0.3, 0.0))],
)
"""A standing pipe with a load, whose root is softer across the plane of the load."""

SPRUNG = pp.Pipe(
    0.2,
    -20.0,
    damping=0.01,
    terms=[pp.Spring(0.7, 40.0, stiffness_across=3.0), pp.Load(1.0, (1.0, 0.0))],
)
"""A clamped standing pipe whose spring holds it better in the plane of a load."""

EULER = pp.Pipe(0.2, damping=0.01, root=pp.RootSpring(8.0, 3.0), terms=[pp.Load(1.0, (0.0, -4.0))])
"""A pipe that a load pushes along the axis, with two planes of symmetry."""

TWO_PLANES = pp.Pipe(
    0.45,
    -8.0,
    damping=0.01,
    root=pp.RootSpring(5.63, 5.22),
    terms=[pp.Load(1.0, (0.54, 0.39)), pp.Spring(0.88, 1.25, stiffness_across=16.5)],
)
"""A pipe whose branch out of the plane of its load begins and ends there, and flutters between."""

WOUND = pp.Pipe(
    0.559544309817,
    -37.2071398301,
    damping=0.01,
    root=pp.RootSpring(3.17143474245, 7.71421921007),
    terms=[
        pp.Load(1.0, (0.531663665735, -3.2975747327)),
        pp.Spring(0.63754867174, 17.8943172439, stiffness_across=8.45433813891),
    ],
)
"""A pipe with rests beside half a turn, where residuals rise on the way to them."""


def chain(pipe, n=4):
    return pp.Chain(pipe, n, dimensions=3)


def within_half_a_turn(q):
    """Rotation vectors of the same tangents that are not longer than pi."""
    rho = np.hypot(*np.split(q, 2))
    share = 1.0 - 2.0 * np.pi * np.round(rho / (2.0 * np.pi)) / np.where(rho > 0.0, rho, 1.0)
    return np.tile(share, 2) * q


def rests_by_scipy(model, u, starts=60, seed=0, size=1.0):
    """Rests to which scipy's hybrid method leads from random starts in space, each once."""
    count, random = model.coordinates, np.random.default_rng(seed)

    def accelerations(q):
        if not np.isfinite(q).all():  # scipy's method may step on from a failed one
            return np.full(count, 1e3)
        rates = model.core.rhs(0.0, np.append(q, 0.0 * q), u, None, refuses=False)[count:]
        return np.nan_to_num(rates, nan=1e3)

    found = []
    for _ in range(starts):
        solved = root(accelerations, size * random.normal(size=count), tol=1e-12).x
        if np.abs(accelerations(solved)).max() > 1e-8:
            continue
        q = within_half_a_turn(solved)
        if all(np.abs(q - other).max() > 1e-5 for other in found):
            found.append(q)
    return found


def out_of_plane(model, rows):
    """The rows of q whose part along z is not 0."""
    return [q for q in rows if np.abs(q[model.coordinates // 2 :]).max() > 1e-6]


def growth_of(model, q, u):
    """Real parts of the eigenvalues of the spatial Jacobian at rest, the largest first."""
    slopes = model.jacobian(0.0, np.append(q, 0.0 * q), u)
    return np.sort(np.linalg.eigvals(slopes).real)[::-1]


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (chain(LEANING), 0.5),
        (chain(SPRUNG), 1.0),
        (chain(EULER), 0.5),
        (chain(TWO_PLANES, 3), 4.2),
        (chain(WOUND), 2.5),
        (chain(WOUND), 4.2),
    ],
)
def test_all_rests_to_which_random_starts_in_space_lead_are_found(model, u):
    found = pp.equilibria(model, u)
    assert found.complete is False
    assert "in space are not counted" in found.search
    q = np.array([within_half_a_turn(one) for one in found.q])
    seen = [
        other for k in (1.0, 1.5) for other in rests_by_scipy(model, u, seed=int(2 * k), size=k)
    ]
    assert out_of_plane(model, found.q)
    for other in seen:
        assert np.abs(q - other).max(axis=1).min() < 1e-6
    assert found.residuals.max() < 1e-10
    for one, largest, stable in zip(found.q, found.growth, found.stable, strict=True):
        assert largest == pytest.approx(growth_of(model, one, u)[0], abs=1e-6)
        assert stable == (largest < 0.0)


@pytest.mark.parametrize(
    "model", [chain(LEANING), pp.Galerkin(SPRUNG, 6, "legendre", dimensions=3)]
)
def test_rests_out_of_the_plane_are_mirror_images_of_one_another(model):
    found = pp.equilibria(model, 1.0)
    right, left = out_of_plane(model, found.q)
    half = model.coordinates // 2
    assert np.abs(right - left * np.repeat([1.0, -1.0], half)).max() < 1e-9
    assert np.abs(model.rhs(0.0, np.append(right, 0.0 * right), 1.0)).max() < 1e-7
    tips = found.tips[np.abs(found.tips[:, 2]) > 1e-6]
    assert tips[:, 2].tolist() == pytest.approx([tips[0, 2], -tips[0, 2]])


def test_chains_tend_with_their_order_to_the_rest_in_space_of_a_reduced_model():
    reduced = pp.equilibria(pp.Galerkin(SPRUNG, 10, "legendre", dimensions=3), 1.0)
    (tip,) = (one for one in reduced.tips if one[2] > 1e-6)
    of_chains = []
    for n in (10, 20):
        tips = pp.equilibria(chain(SPRUNG, n), 1.0).tips
        of_chains += [one for one in tips if one[2] > 0.5 and one[1] < 0.0]
    coarse, fine = of_chains
    assert np.linalg.norm(coarse - tip) > 5e-3
    assert np.linalg.norm((4.0 * fine - coarse) / 3.0 - tip) < 1e-4


def planar_rest(model, u, near):
    """The rest in the plane by scipy, from one nearby."""
    planar, half = model.planar, near.size
    return root(lambda q: planar.rhs(0.0, np.append(q, 0.0 * q), u)[half:], near, tol=1e-13).x


@cache
def lost_across():
    """Speed at which det of the Jacobian across the plane of the load is 0, and a rest nearby."""
    model = chain(LEANING)
    near = pp.equilibria(model.planar, 1.3).q[0]

    def determinant(u):
        q = planar_rest(model, u, near)
        slopes = model.jacobian(0.0, np.concatenate([q, np.zeros(12)]), u)[8:, :8]
        return np.linalg.det(slopes[4:, 4:])

    return model, brentq(determinant, 1.3, 1.4, xtol=1e-13), near


def test_a_branch_leaves_the_plane_where_the_rest_in_it_loses_stability_across():
    model, speed, near = lost_across()
    planar = pp.equilibrium_branch(model, np.append(near, 0.0 * near), 1.3, (0.0, 3.0))
    (point,) = planar.points
    assert (point.kind, point.speed) == ("branch point", pytest.approx(speed, rel=1e-9))
    rest = next(q for q in pp.equilibria(model, 1.0).q if model.tip(q)[2] > 0.0)
    branch = pp.equilibrium_branch(model, rest, 1.0, (0.0, 3.0))
    assert branch.ends == ("range", "branch point")
    assert branch.points[-1].speed == branch.speeds[-1] == pytest.approx(speed, rel=1e-9)
    assert branch.tips[-1] == pytest.approx(model.tip(point.q), abs=1e-9)
    assert branch.stable.all()
    # The distance from the plane grows like the square root of that from the branch point.
    near = branch.speeds > speed - 5e-3
    laws = branch.tips[near, 2] ** 2 / (speed - branch.speeds[near] + 1e-300)
    assert np.ptp(laws[:-1]) < 0.05 * laws[0]
    for q, u in zip(branch.q[::5], branch.speeds[::5], strict=True):
        assert np.abs(model.rhs(0.0, np.append(q, 0.0 * q), u)).max() < 1e-7


def test_a_motion_from_beside_the_lost_rest_ends_on_the_new_one():
    model = chain(LEANING)
    found = pp.equilibria(model, 1.0)
    lost, right, left = found.q
    assert found.stable.tolist() == [False, True, True]
    for side, end in ((1e-3, right), (-1e-3, left)):
        motion = pp.simulate(model, 1.0, 80.0, lost + side * np.repeat([0.0, 1.0], 4), samples=2)
        assert motion.q[-1] == pytest.approx(end, abs=1e-5)
    basins = pp.attractors(model, 1.0, 6).basins
    assert [(one.ending, one.attracts, one.mirror_image) for one in basins] == [
        ("rest", True, 1),
        ("rest", True, 0),
    ]
    assert abs(basins[0].motion.tip[-1, 2]) == pytest.approx(model.tip(right)[2], abs=1e-5)


@cache
def diagram():
    return pp.bifurcation_diagram(chain(TWO_PLANES, 3), np.linspace(2.0, 5.0, 7), cycles=40)


def test_a_diagram_follows_branches_out_of_the_plane_with_folds_and_hopf_points():
    found, model = diagram(), chain(TWO_PLANES, 3)
    assert not found.failures
    planar, right, left, *_ = found.equilibria
    assert [point.kind for point in planar.points] == ["branch point", "hopf", "branch point"]
    assert right.ends == left.ends == ("branch point", "branch point")
    ends = [right.points[0].speed, right.points[-1].speed]
    assert ends == pytest.approx([planar.points[0].speed, planar.points[2].speed], rel=1e-9)
    assert np.abs(right.tips - left.tips * [1.0, 1.0, -1.0]).max() < 1e-12
    kinds = [point.kind for point in right.points[1:-1]]
    assert kinds == ["fold", "hopf", "fold", "hopf", "hopf"]
    for point in right.points:
        slopes = model.jacobian(0.0, np.append(point.q, 0.0 * point.q), point.speed)
        passing = np.linalg.eigvals(slopes) - 1j * point.frequency
        assert np.abs(passing).min() < 1e-4


def test_every_rest_that_random_starts_find_lies_on_a_branch_of_the_diagram():
    found, model, met = diagram(), chain(TWO_PLANES, 3), 0
    for u in (2.1, 3.6, 3.7, 4.1, 4.9):
        rests = rests_by_scipy(model, u, 40)
        met += len(out_of_plane(model, rests))
        for q in rests:
            on = [one.q[np.abs(one.speeds - u) < 0.1] for one in found.equilibria]
            every = np.concatenate(on)
            assert np.abs(every - q).max(axis=1).min() < 0.2
    assert met >= 6


def test_cycles_begin_and_end_at_onsets_of_rests_out_of_the_plane():
    found, model = diagram(), chain(TWO_PLANES, 3)
    onsets = [point for point in found.equilibria[1].points if point.kind == "hopf"]
    within, leaving, between = found.cycles
    assert [one.origin for one in found.cycles] == ["hopf", "branch point", "hopf"]
    # Cycles that leave the plane come to rest where the rest that left it begins to flutter.
    assert leaving.onset in [event.speed for event in within.events]
    assert leaving.events[-1].kind == "hopf"
    ends = [leaving.events[-1].speed, between.onset, between.events[-1].speed]
    assert ends == pytest.approx([one.speed for one in onsets], rel=1e-6)
    hopf = pp.hopf(model, onsets[1])
    assert between.frequencies[0] == pytest.approx(hopf.frequency, rel=1e-6)
    (cycle,) = leaving.at(4.0)
    motion = pp.simulate(model, 4.0, cycle.period, cycle.q[0], cycle.qdot[0], rtol=1e-10, samples=2)
    assert motion.q[-1] == pytest.approx(cycle.q[0], abs=1e-6)
    assert np.abs(cycle.tip[:, 2]).max() > 0.01


def test_a_pipe_with_two_planes_of_symmetry_buckles_in_the_softer_one():
    model = chain(EULER)
    soft = pp.Chain(EULER.across(), 4)
    planar = np.array([q for q in pp.equilibria(soft, 0.5).q if q.any()])
    found = out_of_plane(model, pp.equilibria(model, 0.5).q)
    assert len(found) == len(planar) == 2
    for q in found:
        along, across = np.split(q, 2)
        assert np.abs(along).max() < 1e-9
        assert np.abs(planar - across).max(axis=1).min() < 1e-9
    branches = pp.bifurcation_diagram(model, [0.0, 1.0, 2.0, 3.0], cycles=0).equilibria
    straight, *others = branches
    speeds = [one.speed for one in straight.points if one.kind == "pitchfork"]
    ends = {one.points[-1].speed for one in others if one.ends[-1] == "pitchfork"}
    assert ends
    for end in ends:
        assert np.abs(np.array(speeds) - end).min() < 1e-9


def test_pitchforks_in_both_planes_have_the_speeds_at_which_the_pipe_diverges_there():
    root = pp.RootSpring(6.0, 6.2)
    model = pp.Chain(pp.Pipe(0.7, -10.0, damping=0.05, root=root), 6, dimensions=3)
    branch = pp.equilibrium_branch(model, np.zeros(12), 0.1, (0.0, 4.0))
    speeds = sorted(one.speed for one in branch.points if one.kind == "pitchfork")
    expected = [one.speed for one in pp.crossings(model, 4.0) if one.kind == "divergence"]
    assert len(expected) == 2
    assert np.ptp(expected) > 1e-3
    np.testing.assert_allclose(speeds, expected, rtol=1e-9)


def test_short_branches_end_where_they_must_and_none_leave_where_a_stop_is_met():
    barred = pp.Stop(0.8, 0.3, 100.0, stiffness_across=0.0)
    pipe = replace(LEANING, gamma=-15.0, terms=[pp.Load(1.0, (0.2, 0.0)), barred])
    found = pp.bifurcation_diagram(chain(pipe, 2), [2.0, 2.8], cycles=0)
    assert not found.failures  # although the stiffness passes 0 by a jump at u = 2.41
    spatial = [one for one in found.equilibria if np.ptp(one.tips[:, 2]) > 1e-6]
    right, _ = (one for one in spatial if one.ends == ("branch point", "branch point"))
    assert np.ptp(right.tips[:, 2]) < 0.1
    every = [one.speed for b in found.equilibria if b not in spatial for one in b.points]
    for point in right.points:
        assert np.abs(np.array(every) - point.speed).min() < 1e-6
    for k, one in enumerate(spatial):
        others = (np.abs(one.q[len(one) // 2] - other.q).max(axis=1).min() for other in spatial[:k])
        assert min(others, default=1.0) > 1e-3


def test_a_start_out_of_the_plane_leads_to_a_rest_there_or_is_refused_far_from_any():
    model = chain(LEANING)
    rest = next(q for q in pp.equilibria(model, 1.0).q if model.tip(q)[2] > 0.0)
    known = pp.equilibria(model, 1.0, [rest + 0.01])
    assert np.abs(known.q - rest).max(axis=1).min() < 1e-9
    with pytest.raises(pp.NotConverged, match="near q0"):
        pp.equilibrium_branch(model, model.bent(lambda s: 0.0 * s, lambda s: 2.0 * s), 2.5, (2, 3))
