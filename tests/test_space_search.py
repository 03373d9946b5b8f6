# SPDX-License-Identifier: MIT
"""Equilibria, attractors and diagrams in three dimensions, against Jacobians and long motions."""

import warnings
from functools import cache

import numpy as np
import pytest
from scipy.optimize import root

import pipedyn as pp

WHIRLING = pp.Chain(pp.Pipe(0.2), 4, dimensions=3)
LEVEL = pp.Chain(pp.Pipe(0.2, 10.0, inclination=1.2), 5, dimensions=3)
STANDING = pp.Pipe(0.2, -20.0)


def growth_of(model, q, u):
    """Real parts of the eigenvalues of the spatial Jacobian at rest, the largest first."""
    slopes = model.jacobian(0.0, np.append(q, 0.0 * q), u)
    return np.sort(np.linalg.eigvals(slopes).real)[::-1]


def in_plane(model):
    """The critical speed of a planar model, which ignores that the pipe may leave its plane."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pp.FluttersAcross)
        return pp.critical_speed(model.planar)


def late(model, u, start, time=600.0):
    """The end of a long motion from a state [q, q']."""
    motion = pp.simulate(model, u, time, *np.split(start, 2), rtol=1e-8, samples=12001)
    return motion.tip[motion.t > time - 20.0]


# ------------------------------------------------------------------------------------- equilibria


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(STANDING, 6, dimensions=3),
        pp.Galerkin(STANDING, 6, "legendre", dimensions=3),
        pp.Chain(pp.Pipe(0.2, -20.0, terms=[pp.Spring(0.6, 30.0)]), 4, dimensions=3),
    ],
)
@pytest.mark.parametrize("u", [1.0, 2.0])
def test_a_bent_equilibrium_stands_for_a_circle_and_a_turn_of_it_is_neutral(model, u):
    found, planar = pp.equilibria(model, u), pp.equilibria(model.planar, u)
    assert found.complete == planar.complete
    images = np.count_nonzero(planar.tips[:, 0] < -1e-9)
    assert len(found) == len(planar) - images
    assert len(found) > 1
    for q, largest, stable in zip(found.q, found.growth, found.stable, strict=True):
        growth = growth_of(model, q, u)
        if q.any():
            assert np.abs(growth).min() < 1e-6  # that of the turn
            growth = np.delete(growth, np.abs(growth).argmin())
        assert largest == pytest.approx(growth[0], abs=1e-6)
        assert stable == (growth[0] < 0.0)


def test_a_pipe_may_rest_stably_in_its_plane_and_buckle_across_it():
    planar = pp.equilibria(pp.Chain(STANDING, 6), 1.0)
    model = pp.Chain(STANDING, 6, dimensions=3)
    found = pp.equilibria(model, 1.0)
    # Of stable bent rests the slowest motion is one across the plane.
    assert planar.growth.min() == pytest.approx(-0.6117, abs=1e-4)
    assert found.growth.min() == pytest.approx(-0.4427, abs=1e-4)


def test_newtons_method_from_starts_in_space_finds_only_the_equilibria_of_planes():
    model, u = pp.Chain(STANDING, 3, dimensions=3), 1.0
    known = pp.equilibria(model, u).q
    random = np.random.default_rng(3)
    met = set()

    def at_rest(q):
        if not np.isfinite(q).all():  # scipy's method may step on from a failed one
            return np.full(6, 1e3)
        rates = model.core.rhs(0.0, np.append(q, 0.0 * q), u, None, refuses=False)[6:]
        return np.nan_to_num(rates, nan=1e3)

    for _ in range(40):
        start = random.normal(size=6)
        solved = root(at_rest, start, tol=1e-12)
        if np.abs(at_rest(solved.x)).max() > 1e-8 or np.hypot(*np.split(solved.x, 2)).max() > 3.1:
            continue
        x, z = np.split(solved.x, 2)
        turned = model.turned(solved.x, -np.arctan2(z[-1], x[-1]))
        apart = [min(np.abs(turned - q).max(), np.abs(turned + q).max()) for q in known]
        assert min(apart) < 1e-6
        met.add(int(np.argmin(apart)))
    assert len(met) == len(known)


def test_a_start_is_turned_into_the_plane_or_refused_if_it_lies_in_none():
    model = pp.Chain(STANDING, 4, dimensions=3)
    rest = pp.equilibria(model, 1.0).q[-1]
    turned = pp.equilibrium_branch(model, model.turned(rest, 0.7), 1.0, (0.5, 2.0))
    assert np.abs(turned.q - rest).max(axis=1).min() < 1e-9
    twisted = model.bent(lambda s: s, lambda s: s**2)
    with pytest.raises(ValueError, match="starts\\[0\\] must lie in a plane through the axis"):
        pp.equilibria(model, 1.0, [twisted])
    with pytest.raises(pp.NotConverged, match="no equilibrium was found near q0"):
        pp.equilibrium_branch(LEVEL, LEVEL.bent(lambda s: 0.0 * s, lambda s: s), 1.0, (0.5, 2.0))


@pytest.mark.parametrize("gamma", [10.0, 20.0])
def test_the_branch_of_a_sagging_pipe_starts_to_flutter_across_its_plane(gamma):
    model = pp.Chain(pp.Pipe(0.2, gamma, inclination=np.pi / 2.0), 6, dimensions=3)
    rest = pp.equilibria(model, 1.0)
    assert rest.complete is False
    branch = pp.equilibrium_branch(model, rest.q[0], 1.0, (0.0, 7.5))
    across, within = (point for point in branch.points if point.kind == "hopf")
    assert across.speed == pytest.approx(pp.critical_speed(model).speed, rel=1e-6)
    assert within.speed == pytest.approx(in_plane(model).speed, rel=1e-6)
    assert across.speed < within.speed


# -------------------------------------------------------------------------- where motions end


@pytest.mark.parametrize(("u", "ending"), [(5.0, "periodic"), (6.0, "rotating"), (7.6, "periodic")])
def test_motions_end_planar_or_rotating_as_long_motions_do(u, ending):
    found = pp.attractors(WHIRLING, u, 12)
    assert sum(basin.share.count for basin in found.basins) == 12
    for basin in found.basins:
        assert (basin.ending, basin.attracts) == (ending, True)
        radius = np.hypot(*basin.motion.tip[:, ::2].T)
        start = found.starts[list(found.ends).index(found.basins.index(basin))]
        seen = np.hypot(*late(WHIRLING, u, start)[:, ::2].T)
        assert seen.max() == pytest.approx(radius.max(), rel=2e-3)
        assert seen.min() == pytest.approx(radius.min(), abs=0.02)
    if ending == "rotating":
        circle = pp.rotating_motion(WHIRLING, u)
        assert [basin.amplitude for basin in found.basins] == pytest.approx([circle.radius] * 2)
        assert found.basins[0].period == pytest.approx(2.0 * np.pi / circle.frequency)
        assert [basin.mirror_image for basin in found.basins] == [1, 0]
        senses = []
        for basin in found.basins:
            (x, _, z), (by_x, _, by_z) = basin.motion.tip[0], basin.motion.tip_velocity[0]
            senses.append(np.sign(x * by_z - z * by_x))
        assert sorted(senses) == [-1.0, 1.0]
    else:
        cycle = pp.limit_cycle(WHIRLING, u)
        assert found.basins[0].amplitude == pytest.approx(cycle.amplitude, rel=1e-5)
        assert found.basins[0].mirror_image == 0


def test_a_level_pipe_ends_in_a_cycle_across_its_plane():
    u = pp.critical_speed(LEVEL).speed + 0.05
    (basin,) = pp.attractors(LEVEL, u, 4).basins
    cycle = pp.limit_cycle(LEVEL, u)
    assert basin.ending == "periodic"
    assert basin.amplitude == pytest.approx(cycle.amplitude, rel=1e-5)
    tip = late(LEVEL, u, np.append(basin.motion.q[0], basin.motion.qdot[0]))
    assert 0.5 * np.ptp(tip[:, 2]) == pytest.approx(cycle.amplitude, rel=1e-3)
    assert np.ptp(tip[:, 0]) < 0.2 * np.ptp(tip[:, 2])


def test_the_onset_across_the_plane_of_a_load_has_the_law_of_its_cycles():
    onset = pp.hopf(LEVEL)
    assert onset.speed == pytest.approx(pp.critical_speed(LEVEL).speed)
    cycle = pp.limit_cycle(LEVEL, onset.speed + 1e-3)
    assert cycle.amplitude**2 == pytest.approx(1e-3 * onset.amplitude_law, rel=5e-3)
    assert np.abs(cycle.others - 1.0).min() > 1e-4  # no circle of cycles


# -------------------------------------------------------------------------------------- diagrams


@cache
def diagram():
    return pp.bifurcation_diagram(WHIRLING, np.linspace(4.5, 8.0, 8), brute_force=2)


def test_a_diagram_shows_where_planar_motion_leaves_its_plane():
    found = diagram()
    assert not found.failures
    branch = found.cycles[0]
    leaving = [event for event in branch.events if event.kind == "branch point"]
    assert [event.speed for event in leaving] == pytest.approx([5.154737, 7.288845], abs=2e-5)
    for event, sign in zip(leaving, (1.0, -1.0), strict=True):
        for side in (-1.0, 1.0):
            cycle = pp.limit_cycle(WHIRLING, event.speed + 2e-3 * side)
            across = np.delete(cycle.across, np.abs(cycle.across - 1.0).argmin())
            # Where a growing multiplier is nearly 1, it is that of the turn that is left over.
            assert (np.abs(across).max() > 1.0 + 1e-5) == (side * sign > 0.0)
    for cycle, stable in zip(branch.cycles, branch.stable, strict=True):
        between = leaving[0].speed < cycle.u < leaving[1].speed
        assert stable == (not between)
        assert cycle.q.shape[1] == 8


def test_a_diagram_follows_circular_motions_with_their_stability():
    found = diagram()
    branch, high = found.rotating
    assert branch.end == "range"
    assert branch.onset == pytest.approx(found.cycles[0].onset)
    changes = [point.speed for point in branch.points]
    assert changes == pytest.approx([5.16157, 7.34214], abs=1e-4)
    for u in (5.0, 5.5, 7.0, 7.5):
        alone = pp.rotating_motion(WHIRLING, u)
        (one,) = branch.at(u)
        assert one.radius == pytest.approx(alone.radius, rel=1e-8)
        assert one.stable == alone.stable == (changes[0] < u < changes[1])
    assert high.speeds.min() == pytest.approx(7.993, abs=1e-3)
    assert len(branch) == len(branch.speeds)


def test_motions_of_a_diagram_end_where_its_branches_are_stable():
    found = diagram()
    for one in found.motions:
        circles = any(motion.stable for branch in found.rotating for motion in branch.at(one.speed))
        cycles = any(cycle.stable for branch in found.cycles for cycle in branch.at(one.speed))
        wanted = "rotating" if circles else "periodic" if cycles else "rest"
        assert one.ending == wanted, one


def test_circular_motions_are_followed_past_folds():
    model, u = pp.Chain(pp.Pipe(0.5), 6, dimensions=3), 12.63
    branch = pp.bifurcation_diagram(model, [8.0, u, 12.7], cycles=1).rotating[0]
    folds = [point.speed for point in branch.points if point.kind == "fold"]
    assert folds == pytest.approx([12.664639, 12.589085], abs=1e-5)
    three = branch.at(u)
    assert len({round(one.radius, 6) for one in three}) == 3
    for one in three:
        rates = model.rhs(0.0, np.append(one.q, one.qdot), u)[model.dof :]
        left = rates + one.frequency**2 * one.q
        assert np.abs(left).max() < 1e-9 * np.abs(rates).max()
    for point in branch.points:
        near = min(branch.motions, key=lambda one: abs(one.u - point.speed))
        assert np.abs(near.exponents.real).min() < 1e-3


@pytest.mark.slow
def test_a_diagram_of_a_level_pipe_follows_cycles_that_leave_its_plane():
    found = pp.bifurcation_diagram(LEVEL, np.linspace(5.4, 6.2, 5), brute_force=1)
    assert not found.rotating
    across, whirling, within = found.cycles[:3]
    assert whirling.onset == across.events[1].speed
    assert across.onset == pytest.approx(pp.critical_speed(LEVEL).speed, rel=1e-6)
    assert within.onset == pytest.approx(in_plane(LEVEL).speed, rel=1e-6)
    assert not within.stable.any()
    planar = pp.limit_cycle(LEVEL.planar, 6.2)
    assert within.at(6.2)[0].amplitude == pytest.approx(planar.amplitude, rel=1e-5)
    assert [event.kind for event in across.events][:2] == ["hopf", "branch point"]


# --------------------------------------------------------------------- what only a plane has


@pytest.mark.parametrize(
    ("model", "u", "of_plane", "in_space"),
    [
        (pp.Chain(pp.Pipe(0.2, -60.0), 2, dimensions=3), 1.0, 9, 3),
        (pp.Galerkin(pp.Pipe(0.2, -150.0), 4, "legendre", dimensions=3), 1.0, 5, 2),
    ],
)
def test_equilibria_wound_by_more_than_half_a_turn_are_those_of_a_plane_alone(
    model, u, of_plane, in_space
):
    found, planar = pp.equilibria(model, u), pp.equilibria(model.planar, u)
    assert (len(planar.q), len(found.q), found.complete) == (of_plane, in_space, False)
    assert "of a plane left out" in found.search
    for q in found.q:
        assert np.abs(model.rhs(0.0, np.append(q, 0.0 * q), u)).max() < 1e-9


def test_a_jet_at_an_angle_out_of_a_hinge_has_a_plane_of_its_own():
    pipe = pp.Pipe(0.2, jet_angle=0.6, end="pinned", damping=0.01)
    chain = pp.Chain(pipe, 5, dimensions=3)
    assert not chain.axisymmetric
    found = pp.equilibria(chain, 6.5).q
    assert np.count_nonzero(found.any(axis=1)) >= 2
    for q in found:
        turned = chain.turned(np.append(q, 0.0 * q), 1.0)
        assert q.any() == (np.abs(chain.rhs(0.0, turned, 6.5)).max() > 1.0)


def test_a_search_along_a_rest_that_winds_up_in_its_plane_keeps_what_it_found():
    chain = pp.Chain(pp.Pipe(0.2, jet_angle=1.0), 3, dimensions=3)
    known = pp.crossings(chain, 5.0)
    with pytest.raises(pp.NotConverged, match="joints in space by less than pi") as stopped:
        pp.crossings(chain, 20.0)
    assert [one.speed for one in stopped.value.result] == pytest.approx([known[0].speed])
    branch = pp.equilibrium_branch(chain, np.zeros(6), 0.0, (0.0, 12.0))
    assert branch.ends == ("range", "not converged")
    assert branch.points[0].speed == pytest.approx(known[0].speed)
    with pytest.raises(pp.NotConverged, match="joint turns"):
        pp.equilibria(chain.with_pipe(pp.Pipe(0.2, jet_angle=1.0)), 9.0)


def test_a_planar_cycle_whose_joints_turn_over_is_none_of_a_chain_in_space():
    chain = pp.Chain(pp.Pipe(0.2, damping=0.01), 2, dimensions=3)
    planar = pp.limit_cycle(chain.planar, 9.0)
    assert np.abs(np.diff(planar.q, axis=1, prepend=0.0)).max() > np.pi
    with pytest.raises(pp.NotConverged, match="is none in space: a joint turns by") as refused:
        pp.limit_cycle(chain, 9.0)
    assert refused.value.result.frequency == planar.frequency
    assert pp.limit_cycle(chain, 6.0).across is not None


def test_a_pipe_on_a_free_hinge_without_weight_is_searched_although_it_turns_freely():
    found = pp.equilibria(pp.Chain(pp.Pipe(0.2, root="pinned"), 3), 3.0)
    assert not found.complete
    assert found.residuals.max() < 1e-9
