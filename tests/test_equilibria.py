# SPDX-License-Identifier: MIT
"""Equilibria against elastica, hand calculation and energy; branches past folds."""

import math
import re
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq, fsolve, root
from scipy.special import ellipe, ellipj, ellipk

import pipedyn as pp

STANDING = pp.Pipe(0.2, -10.0)
TWO = pp.Chain(pp.Pipe(0.2, -20.0), 2)


def elastica(gamma, u):
    """Tip of theta'' = u^2 sin(theta(1) - theta) + gamma (1 - s) sin(theta), clamped and free."""

    def slope(s, y):
        theta, curvature, end = y[:3]
        bending = u**2 * np.sin(end - theta) + gamma * (1.0 - s) * np.sin(theta)
        return np.array([curvature, bending, 0.0 * s, np.sin(theta), np.cos(theta)])

    def ends(a, b):
        return np.array([a[0], b[1], b[2] - b[0], a[3], a[4]])

    s = np.linspace(0.0, 1.0, 41)
    guess = np.array([1.5 * np.sin(1.5 * s), 2 * np.cos(1.5 * s), 0 * s + 1.5, 0.5 * s**2, s])
    found = solve_bvp(slope, ends, s, guess, tol=1e-10, max_nodes=20_000)
    assert found.success
    return found.y[3:, -1]


def two_moments(a, b, u):
    """Springs 4 and 2, weight 20 on arms 3/8 and 1/8, thrust on length 1/2."""
    first = 4 * a - 2 * (b - a) - 7.5 * math.sin(a) + 0.5 * u**2 * math.sin(b - a)
    return [first, 2 * (b - a) - 2.5 * math.sin(b)]


def two_fold():
    """Speed at which two equilibria of the two segments meet."""

    def meeting(x):
        a, b, u = x
        thrust = 0.5 * u**2 * math.cos(b - a)
        stiffness = [[6 - 7.5 * math.cos(a) - thrust, thrust - 2], [-2, 2 - 2.5 * math.cos(b)]]
        return [*two_moments(a, b, u), np.linalg.det(stiffness)]

    return fsolve(meeting, [1.2, 2.3, 3.2], xtol=1e-11)


def bent(found):
    """The equilibrium furthest to the right."""
    return int(np.argmax(found.tips[:, 0]))


@pytest.fixture(scope="module")
def buckled_branch():
    """The branch of two buckled segments, from no flow on past its fold."""
    return pp.equilibrium_branch(TWO, pp.equilibria(TWO, 0.0).q[1], 0.0, (0.0, 6.0))


@pytest.mark.parametrize("u", [0.0, 1.0, 1.6])
def test_heavy_column_takes_the_shape_of_the_elastica(u):
    found = pp.equilibria(pp.Galerkin(STANDING, 10, "legendre"), u)
    assert len(found) == 3
    assert found.stable.tolist() == [False, True, True]
    np.testing.assert_allclose(found.tips[bent(found)], elastica(-10.0, u), atol=1e-8)


def test_mirror_images_come_in_pairs():
    found = pp.equilibria(pp.Chain(pp.Pipe(0.2, -60.0), 3), 2.0)
    assert len(found) % 2 == 1
    np.testing.assert_array_equal(found.q[0], 0.0)
    np.testing.assert_allclose(found.q[1::2], -found.q[2::2], atol=1e-9)
    assert np.all(found.tips[1::2, 0] > 0.0)
    assert found.residuals.max() < 1e-12


def test_without_flow_the_energy_is_stationary_and_least_where_stable():
    model = pp.Chain(pp.Pipe(0.2, -60.0), 2)
    found = pp.equilibria(model, 0.0)
    for q, stable in zip(found.q, found.stable, strict=True):
        energy = lambda d, q=q: model.energy(np.concatenate([q + d, np.zeros(2)]))  # noqa: E731
        steps = 1e-4 * np.eye(2)
        slopes = [(energy(d) - energy(-d)) / 2e-4 for d in steps]
        np.testing.assert_allclose(slopes, 0.0, atol=1e-6)
        around = [energy(1e-2 * np.array([math.cos(t), math.sin(t)])) for t in np.arange(0, 6, 0.1)]
        assert (min(around) > energy(np.zeros(2))) == stable


def test_flow_straightens_the_buckled_pipe_before_it_flutters():
    model = pp.Galerkin(STANDING, 8, "legendre")
    straight = pp.equilibrium_branch(model, np.zeros(8), 1.0, (0.0, 6.0))
    assert straight.straight
    assert [point.kind for point in straight.points] == ["pitchfork", "hopf"]
    fork, flutter = straight.points
    # Straightened at 1.797, flutter from 4.866; published: about 1.8 and 4.85.
    found = pp.crossings(model, 6.0)
    assert fork.speed == pytest.approx(found[0].speed, abs=1e-9)
    assert flutter.speed == pytest.approx(found[1].speed, abs=1e-7)
    assert flutter.frequency == pytest.approx(found[1].frequency, abs=1e-6)
    assert (round(fork.speed, 3), round(flutter.speed, 3)) == (1.797, 4.866)
    buckled = pp.equilibrium_branch(model, pp.equilibria(model, 0.0).q[1], 0.0, (0.0, 6.0))
    assert buckled.ends == ("range", "pitchfork")
    assert buckled.stable.all()
    assert buckled.points[-1].speed == pytest.approx(fork.speed, abs=1e-9)
    assert np.all(np.diff(buckled.speeds) > 0.0)


def test_two_segments_leave_the_straight_pipe_where_its_determinant_vanishes():
    # det K = (5 u^2 - 13) / 4 with springs 4 and 2, gamma = -20.
    straight = pp.equilibrium_branch(TWO, [0.0, 0.0], 1.0, (0.0, 3.0))
    fork = next(point for point in straight.points if point.kind == "pitchfork")
    assert fork.speed == pytest.approx(math.sqrt(2.6), abs=1e-12)


@pytest.mark.parametrize("step", [0.1, 0.03])
def test_branch_is_followed_around_its_fold(step):
    start = pp.equilibria(TWO, 0.0)
    branch = pp.equilibrium_branch(TWO, start.q[bent(start)], 0.0, (0.0, 6.0), step)
    assert [point.kind for point in branch.points] == ["fold", "hopf", "pitchfork"]
    (fold,) = branch.folds
    *angles, speed = two_fold()
    assert fold.speed == pytest.approx(speed, abs=1e-10)
    np.testing.assert_allclose(fold.q, angles, atol=1e-7)
    assert branch.speeds.max() <= fold.speed + 1e-9
    assert (len(pp.equilibria(TWO, fold.speed - 1e-3)), len(pp.equilibria(TWO, 3.19))) == (5, 1)
    before = np.arange(len(branch)) < np.argmax(branch.speeds)
    assert branch.stable[before].all()
    assert not branch.stable[~before][1:].any()


def test_hopf_point_of_a_bent_branch_has_a_pair_on_the_axis(buckled_branch):
    hopf = next(point for point in buckled_branch.points if point.kind == "hopf")
    found = np.linalg.eigvals(TWO.jacobian(0.0, np.concatenate([hopf.q, np.zeros(2)]), hopf.speed))
    nearest = found[np.argmin(np.abs(found - 1j * hopf.frequency))]
    assert abs(nearest - 1j * hopf.frequency) < 1e-7


def test_cycles_about_a_bent_pipe_follow_the_law_of_its_hopf_point(buckled_branch):
    (point,) = [point for point in buckled_branch.points if point.kind == "hopf"]
    onset = pp.hopf(TWO, point)
    assert onset.criticality == "subcritical"
    assert (onset.growth < 0.0) == (onset.amplitude_law > 0.0)
    found = pp.bifurcation_diagram(TWO, [1.6, point.speed + 2e-3], cycles=5)
    cycles = next(b for b in found.cycles if b.onset == pytest.approx(point.speed, rel=1e-9))
    assert (cycles.speeds[0], cycles.amplitudes[0]) == (cycles.onset, 0.0)
    assert cycles.highest[0] == pytest.approx(point.tip[0], abs=1e-9)
    assert cycles.cycles[0].residual == 0.0
    assert not cycles.cycles[0].moves
    assert cycles.at(cycles.onset) == ()
    with pytest.raises(ValueError, match=re.escape("start must move, got a cycle without")):
        pp.limit_cycle(TWO, 1.63, cycles.cycles[0])
    law = cycles.amplitudes[1:4] ** 2 / (cycles.speeds[1:4] - cycles.onset)
    assert law == pytest.approx(onset.amplitude_law, rel=3e-3)


def test_a_start_far_from_any_equilibrium_leads_to_none():
    with pytest.raises(pp.NotConverged, match=re.escape("rad away, more than 0.5")):
        pp.equilibrium_branch(CHAIN, [1.5, 1.5], 1.0, (0.0, 2.0))
    assert pp.equilibrium_branch(CHAIN, [0.3, 0.3], 1.0, (0.0, 2.0)).straight


def test_growth_is_that_of_the_full_linearisation():
    model = pp.Galerkin(pp.Pipe(0.3, -30.0, damping=0.01), 5)
    found = pp.equilibria(model, 1.5)
    assert len(found) >= 3
    for q, growth in zip(found.q, found.growth, strict=True):
        whole = model.jacobian(0.0, np.concatenate([q, np.zeros(5)]), 1.5)
        assert growth == pytest.approx(np.linalg.eigvals(whole).real.max(), abs=1e-8)


def test_motion_beside_a_stable_equilibrium_stays_and_returns():
    model = pp.Chain(pp.Pipe(0.2, -10.0, damping=0.05), 3)
    found = pp.equilibria(model, 1.0)
    q = found.q[bent(found)]
    motion = pp.simulate(model, 1.0, 40.0, q + 0.05)
    np.testing.assert_allclose(motion.q[-1], q, atol=1e-5)


def test_scene_has_the_equilibria_of_its_chain():
    scene, chain = pp.modular.chain(STANDING, n=4), pp.Chain(STANDING, 4)
    of_scene, of_chain = pp.equilibria(scene, 1.0), pp.equilibria(chain, 1.0)
    np.testing.assert_allclose(of_scene.tips, of_chain.tips, atol=1e-10)
    np.testing.assert_allclose(of_scene.growth, of_chain.growth, atol=1e-8)
    assert of_scene.q.shape == (3, 12)


def test_guided_pipe_buckles_where_it_diverges_and_eigenvalues_count_its_freedom_only():
    pipe = pp.Pipe(0.2, damping=0.01)
    scene = pp.modular.chain(pipe, n=4).plus(pp.modular.Guide(node=4))
    straight = pp.equilibrium_branch(scene, np.zeros(4), 1.0, (0.0, 5.0))
    (fork,) = straight.points
    assert fork.kind == "pitchfork"
    assert fork.speed == pytest.approx(pp.critical_speed(scene).speed, abs=1e-8)
    start = scene.admissible([0.3, 0.1, -0.2, -0.5])
    u = fork.speed + 0.3
    branch = pp.equilibrium_branch(scene, start, u, (4.0, u + 0.1), step=0.2)
    assert "pitchfork" in branch.ends
    assert branch.stable.all()
    np.testing.assert_allclose(branch.tips[:, 0], 0.0, atol=1e-10)
    middle = len(branch) // 2
    q, speed = branch.q[middle], branch.speeds[middle]
    assert pp.eigenvalues(scene.about(q), speed).real.max() < 0.0
    assert scene.about(q).unbalanced(speed) < 1e-9


def test_crooked_joint_breaks_the_pitchfork_into_a_fold():
    spring = pp.modular.TorsionalSpring(joint=1, stiffness=1.0, rest_angle=0.1)
    scene = pp.modular.chain(pp.Pipe(0.2, -20.0), n=2).plus(spring)
    found = pp.equilibria(scene, 1.0)
    assert len(found) == 3
    assert np.abs(found.tips[:, 0]).min() > 1e-3
    left = int(np.argmin(found.tips[:, 0]))
    branch = pp.equilibrium_branch(scene, scene.angles(found.q[left]), 1.0, (1.0, 4.0), 0.4)
    assert "fold" in [point.kind for point in branch.points]
    assert "pitchfork" not in [point.kind for point in branch.points]


def test_own_starts_are_taken_in():
    chain = pp.Chain(pp.Pipe(0.2), 3)
    found = pp.equilibria(chain, 2.0, starts=[np.ones(3), lambda s: 2.0 * s])
    assert len(found) == 1


CHAIN = pp.Chain(pp.Pipe(0.2), 2)


@pytest.mark.parametrize(
    ("model", "words", "message"),
    [
        (pp.Chain(pp.Pipe(0.2), 501), {}, "at most 500"),
        (CHAIN, {"starts": [[1.0]]}, "starts[0] must have 2"),
    ],
)
def test_bad_arguments_of_a_search_are_refused_by_name(model, words, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        pp.equilibria(model, 1.0, **words)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"u0": 3.0}, "u0 must lie in [0, 2]"),
        ({"speeds": (2.0, 1.0)}, "speeds must be (lowest, highest)"),
    ],
)
def test_bad_arguments_of_a_branch_are_refused_by_name(words, message):
    given = {"q0": [0.0, 0.0], "u0": 1.0, "speeds": (0.0, 2.0)} | words
    with pytest.raises(ValueError, match=re.escape(message)):
        pp.equilibrium_branch(CHAIN, **given)


def by_recursion(model, u, far=60.0):
    """All equilibria of a chain with angles up to `far`: from its last angle the others follow.

    The moment at a joint is that of the weight and of the jet beyond it, and turns the segment
    before: rest is where the first turns against a root that does not. Roots are bracketed.
    """
    n, k, pipe = model.dof, model.springs, model.pipe

    def angles(last):
        found, moment = [last], 0.0 * last
        for j in range(n, 0, -1):
            weight = pipe.gamma / n**2 * (n - j + 0.5) * np.sin(found[0])
            moment = moment + weight + pipe.alpha * u**2 / n * np.sin(last - found[0])
            found.insert(0, found[0] + moment / k[j - 1])
        return found

    at = np.linspace(-far, far, 300_000)
    root = angles(at)[0]
    low, high = at[:-1], at[1:]
    passed = np.sign(root[:-1]) != np.sign(root[1:])
    low, high = low[passed], high[passed]
    before = np.sign(angles(low)[0])
    for _ in range(50):
        middle = 0.5 * (low + high)
        same = np.sign(angles(middle)[0]) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    every = np.array(angles(0.5 * (low + high))[1:]).T
    return every[np.abs(every).max(axis=1) <= far]


@pytest.mark.parametrize(
    ("n", "gamma", "u", "count"),
    [
        (2, 40.0, 14.0, 19),
        (2, -72.4, 9.0, None),
        (2, -42.6, 10.06, 9),
        (2, 40.0, 8.612060983640706, 7),  # two pairs wound up far beyond the others
        (2, -20.0, 2.0, 5),
        (1, 56.6, 11.81, 9),
        (1, -20.0, 3.0, 3),
        (3, 70.9, 12.24, None),
        (4, 28.6, 14.51, None),
        (4, -57.8, 11.37, None),
    ],
)
def test_all_equilibria_of_few_segments_are_found(n, gamma, u, count):
    model = pp.Chain(pp.Pipe(0.2, gamma, damping=0.005), n)
    found, every = pp.equilibria(model, u), by_recursion(model, u)
    assert found.complete, found.search
    assert "add up as they must" in found.search
    assert len(found) == len(every)
    assert count in (None, len(found))
    for x in every:
        assert np.abs(found.q - x).max(axis=1).min() < 1e-6


def test_a_search_that_is_not_counted_says_how_it_looked():
    hanging = pp.equilibria(pp.Chain(pp.Pipe(0.2, 10.0), 5), 3.0)
    assert hanging.complete is False
    assert "up to 9 rad in mixtures of 3 modes" in hanging.search
    assert "in more than 4 degrees of freedom are not counted" in hanging.search
    held = pp.equilibria(pp.Chain(pp.Pipe(0.2, end="pinned", root="pinned"), 3), 3.5)
    assert held.complete is False
    assert "of pipes that are held" in held.search


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (pp.Chain(pp.Pipe(0.15, -116.4, damping=0.01), 4), 8.7),
        (pp.Chain(pp.Pipe(0.3, -90.0), 3), 2.0),
        (pp.Galerkin(pp.Pipe(0.3, -140.0, damping=0.01), 3, "legendre"), 4.0),
        (pp.Galerkin(pp.Pipe(0.3, -100.0), 3), 3.0),
    ],
)
def test_search_finds_what_scipys_hybrid_method_finds(model, u):
    """From random bends, up to solutions that wind up by more than a turn."""
    found, n = pp.equilibria(model, u).q, model.dof
    random, ways = np.random.default_rng(1), np.arange(0.5, 4.0)[:, None] * np.pi

    def rates(q):
        return model.rhs(0.0, np.append(q, np.zeros(n)), u)[n:]

    for _ in range(60):
        parts = random.uniform(-3.0, 3.0, 4)
        start = model.bent(lambda s, parts=parts: parts @ np.sin(ways * s))
        try:
            left = root(rates, start, tol=1e-10)
        except (ValueError, pp.NotResolved):  # scipy's numbers are too large
            continue
        if left.success and np.abs(left.fun).max() < 1e-6 and np.abs(left.x).max() < 4.0:
            assert np.abs(found - left.x).max(axis=1).min() < 1e-6
    assert len(found) > 2


@pytest.mark.parametrize(
    "make",
    [lambda p: pp.Chain(p, 4), lambda p: pp.Galerkin(p, 4), lambda p: pp.modular.chain(p, 4)],
)
def test_a_hose_on_a_hinge_hangs_or_stands_and_whole_turns_count_once(make):
    model = make(pp.Pipe(0.2, 10.0, root="pinned"))
    found = pp.equilibria(model, 2.0)
    assert found.tips == pytest.approx(np.array([[0.0, 1.0], [0.0, -1.0]]), abs=1e-9)
    assert found.stable.tolist() == [True, False]
    assert found.complete is True  # the signs of det K add up to 0


# ----------------------------------------------------- which of a reduced model's are the pipe's


def pinned(*terms):
    return pp.Pipe(0.2, root="pinned", end="pinned", damping=5e-3, terms=terms)


def half_waves(axial, u):
    """Moduli k of a pinned pipe's elastica, of 1, 2 .. half waves; 2 asin(k) is its largest angle.

    The pinned ends take no moment and lie on the axis, so the force F along it is the same all
    along the pipe, theta'' = F sin(theta), and n half waves of this pendulum take (2 n K)^2 = -F.
    F is what holds the end along the axis, axial(y), less the thrust of the jet, u^2 cos(theta(1)),
    where y = 2 E / K - 1.
    """
    found = []
    for n in range(1, 20):

        def left(k, n=n):
            whole = ellipk(k**2)
            y = 2.0 * ellipe(k**2) / whole - 1.0
            return (2.0 * n * whole) ** 2 + axial(y) - u**2 * (1.0 - 2.0 * k**2)

        if left(1e-9) < 0.0:
            found.append(brentq(left, 1e-9, 1.0 - 1e-9, xtol=1e-14))
    return found


@pytest.mark.parametrize(
    ("stiffness", "u", "few", "m", "basis"),
    [
        pytest.param(1000.0, 3.2416, 3, 4, "legendre", marks=pytest.mark.slow),
        pytest.param(300.0, 7.0, 5, 4, "beam", marks=pytest.mark.slow),
        (300.0, 7.0, 5, 6, "legendre"),
        (20.0, 5.0, 3, 4, "beam"),
    ],
)
def test_an_axially_fixed_pipe_rests_straight_or_in_half_waves_and_no_coil_is_counted(
    stiffness, u, few, m, basis
):
    """All below a quarter turn, of which one half wave is stable; see `Stretching`."""
    model = pp.Galerkin(pinned(pp.Stretching(stiffness)), m, basis)
    found = pp.equilibria(model, u)
    turns = [2.0 * math.asin(k) for k in half_waves(lambda y: stiffness * (1.0 - y), u)]
    assert max(turns) < 0.5 * math.pi
    assert len(found) == 1 + 2 * len(turns) == few
    sizes = np.sort(np.abs(model.deflection(found.q.T, 0.0, 1)))
    exact = np.sort([0.0, *turns, *turns])
    np.testing.assert_allclose(sizes, exact, rtol=0.12 if m == 4 else 5e-3, atol=1e-12)
    assert found.stable.sum() == 2
    stable = np.abs(model.deflection(found.q[found.stable].T, 0.0, 1))
    np.testing.assert_allclose(stable, max(turns), rtol=0.12)
    assert found.resolved.all()
    assert found.valid.all()
    others = found.discarded
    assert others is None or not (others.resolved & others.valid).any()


@pytest.mark.parametrize("turned", [0.0, math.pi])
def test_a_pinned_pipe_becomes_unstable_and_bends_at_u_of_pi_turned_on_its_hinge_or_not(turned):
    """Its half wave, with the angle a at the pin, is that of `half_waves`: u^2 cos a = 4 K^2."""
    model = pp.Galerkin(pinned(), 6, "legendre")
    straight, bent = (
        pp.equilibrium_branch(model, lambda s, a=a: turned + a * np.cos(np.pi * s), u, (2.5, 3.5))
        for a, u in ((0.0, 2.5), (1.0, 3.4))
    )
    assert straight.straight
    assert bent.ends == ("pitchfork", "range")
    for branch in (straight, bent):
        (fork,) = branch.points
        assert fork.kind == "pitchfork"
        assert fork.speed == pytest.approx(math.pi, abs=1e-6)
        assert fork.speed in branch.speeds.tolist()
    # At the pitchfork nothing grows yet, and the bent pipe begins there.
    assert straight.stable.tolist() == (straight.speeds <= straight.points[0].speed).tolist()
    assert bent.stable.all()
    assert np.array_equal(bent.q[0], straight.q[0])
    angles = np.abs(model.deflection(bent.q.T, 0.0, 1) - turned)
    assert angles[0] == pytest.approx(0.0, abs=1e-14)
    speeds = 2.0 * ellipk(np.sin(0.5 * angles) ** 2) / np.sqrt(np.cos(angles))
    np.testing.assert_allclose(bent.speeds, speeds, rtol=1e-5)
    # The amplitude grows as the square root of the distance from the onset.
    near = (angles > 1e-3) & (angles < 0.1)
    law = angles[near] ** 2 / (bent.speeds[near] - bent.speeds[0])
    np.testing.assert_allclose(law, 16.0 / (5.0 * math.pi), rtol=5e-3)


def test_no_branch_point_is_listed_beside_the_pitchfork_where_a_branch_ends():
    """There an eigenvalue falls below what counts as neutral before it is 0."""
    (bent,) = (one for one in pp.equilibria(TWO, 1.7).q if one[1] > 1e-3 and abs(one[1]) < 0.6)
    branch = pp.equilibrium_branch(TWO, bent, 1.7, (1.0, 4.0))
    assert [point.kind for point in branch.points] == ["pitchfork", "hopf", "fold"]
    assert branch.unstable[0] == 2  # the pair of the flutter of the straight pipe
    assert branch.unstable[1] == 3


def test_a_coil_that_larger_bases_keep_is_resolved_but_not_valid():
    """A loop in the middle: the pendulum of `half_waves` swings about pi, and y = 1 - 2 E / K."""
    stiffness, u = 20.0, 3.2416

    def left(k):
        whole = ellipk(k**2)
        pulled = stiffness * 2.0 * ellipe(k**2) / whole + u**2 * (1.0 - 2.0 * k**2)
        return 4.0 * whole**2 - pulled

    k = brentq(left, 1e-9, 1.0 - 1e-12, xtol=1e-15)

    def coil(s):
        sn, *_ = ellipj(ellipk(k**2) * (2.0 * s - 1.0), k**2)
        return math.pi + 2.0 * np.arcsin(k * sn)

    model = pp.Galerkin(pinned(pp.Stretching(stiffness)), 11, "legendre")
    found = pp.equilibria(model, u, starts=[coil])
    assert len(found) == 3
    others = found.discarded
    s = np.linspace(0.0, 1.0, 101)
    away = np.abs(model.deflection(others.q.T, s, 1).T - coil(s)).max(axis=1)
    one = int(np.argmin(away))
    assert away[one] < 1e-4
    assert others.resolved[one]
    assert not others.valid[one]
    assert others.tips[one, 1] < 0.5  # that of the middle, far back


@cache
def free_ends(gamma, u):
    """Angles of the free end of all clamped elastica up to five turns.

    Shot from the end, where theta is given and theta' is 0, for theta = 0 at the root.
    """
    s = np.linspace(1.0, 0.0, 101)

    def rates(s, y, end):
        theta, curvature = y
        bending = u**2 * np.sin(end - theta) + gamma * (1.0 - s) * np.sin(theta)
        return np.stack([curvature, bending])

    def root_angle(end):
        y = np.stack([end, 0.0 * end])
        for a, b in pairwise(s):
            h = b - a
            one = rates(a, y, end)
            two = rates(a + h / 2, y + h / 2 * one, end)
            three = rates(a + h / 2, y + h / 2 * two, end)
            y = y + h / 6 * (one + 2 * two + 2 * three + rates(b, y + h * three, end))
        return y[0]

    ends = np.linspace(1e-3, 10.0 * math.pi, 3001)
    roots = root_angle(ends)
    return [
        brentq(lambda end: root_angle(np.array([end]))[0], *ends[i : i + 2], xtol=1e-10)
        for i in np.flatnonzero(roots[:-1] * roots[1:] < 0.0)
    ]


@pytest.mark.parametrize(
    ("gamma", "u", "m", "basis"),
    [
        (-100.0, 3.0, 6, "beam"),
        (-140.0, 4.0, 8, "legendre"),
        (-140.0, 4.0, 3, "legendre"),
        (-174.0, 1.2, 2, "beam"),
        (-116.4, 8.7, 4, "legendre"),
        (-60.0, 4.0, 4, "beam"),
    ],
)
def test_rests_of_a_heavy_cantilever_that_count_are_elastica(gamma, u, m, basis):
    """Each lies near one of all elastica, and each elastica near a rest that is resolved."""
    model = pp.Galerkin(pp.Pipe(0.2, gamma, damping=0.01), m, basis)
    found = pp.equilibria(model, u)
    exact = free_ends(gamma, u)
    counted = model.deflection(found.q.T, 1.0, 1)[1::2]
    apart = np.abs(np.abs(counted)[:, None] - np.reshape(exact, (1, -1)))
    near = apart.argmin(axis=1) if exact else np.zeros(0, int)
    assert sorted(set(near)) == sorted(near)
    assert (apart.min(axis=1, initial=np.inf) < 0.5).all()
    if m > 4:
        assert len(found) == 1 + 2 * len(exact)
        assert apart.min(axis=1).max() < 0.02


@pytest.mark.parametrize(
    ("load", "u", "m"),
    [
        pytest.param(21.354, 0.059, 4, marks=pytest.mark.slow),
        (21.354, 0.059, 7),
        (48.7, 3.146, 4),
        pytest.param(48.7, 3.146, 7, marks=pytest.mark.slow),
    ],
)
def test_a_pinned_pipe_under_a_dead_load_is_found_buckled_and_upside_down(load, u, m):
    """Others have both ends at one place, where the force that holds the end across turns F."""
    model = pp.Galerkin(pinned(pp.Tension(-load)), m)
    found = pp.equilibria(model, u)
    turns = [2.0 * math.asin(k) for k in half_waves(lambda y: -load, u)]
    ends = np.array([model.shape(q, 1.0)[1] for q in found.q])
    sizes = np.abs(model.deflection(found.q.T, 0.0, 1))[np.abs(ends) > 1e-3]
    exact = np.sort([0.0, *turns, *turns, math.pi])
    np.testing.assert_allclose(np.sort(sizes), exact, atol=0.2 if m == 4 else 0.01)


def test_a_fold_is_listed_once_though_its_tangents_err():
    """Two segments on a cubic spring: the slope dp/ds changed its sign five times at one fold."""
    chain = pp.Chain(pp.Pipe(0.231, 49.16, terms=(pp.CubicSpring(0.7, 100.0),)), 2)
    start = [3.812138545264322, 2.899547082568178]
    branch = pp.equilibrium_branch(chain, start, 4.0, (2.0, 20.0))
    folds = [point.speed for point in branch.points if point.kind == "fold"]
    assert folds == pytest.approx([6.62727192, 15.30732210, 2.87565043], rel=1e-8)
    turned = np.flatnonzero(np.diff(np.sign(np.diff(branch.speeds))))
    np.testing.assert_allclose(branch.speeds[turned + 1], folds, rtol=1e-3)


def test_chains_are_their_own_models():
    """Each solution of a chain is a rest of a chain; but no law holds beyond its range."""
    found = pp.equilibria(pp.Chain(pp.Pipe(0.2, -60.0), 3), 2.0)
    assert found.discarded is None
    assert found.resolved.all()
    fixed = pp.equilibria(pp.Chain(pinned(pp.Stretching(1000.0)), 8), 3.2416)
    assert (len(fixed), fixed.stable.sum()) == (3, 2)
    assert fixed.discarded.resolved.all()
    assert not fixed.discarded.valid.any()
    assert f"discarded={len(fixed.discarded)}," in repr(fixed)


def test_a_model_that_resolves_no_rest_says_so_with_what_it_has():
    """Two functions hold the pipe at rest where flutter has begun."""
    model = pp.Galerkin(pp.Pipe(0.2, jet_angle=0.5, damping=1e-3), 1)
    with pytest.raises(pp.NotConverged, match="not resolved by 1 degree") as error:
        pp.equilibria(model, 9.0)
    found = error.value.result
    assert len(found) == 0
    assert len(found.discarded) >= 1
    assert not found.discarded.resolved.any()


def test_a_jet_without_equilibria_that_are_found_says_so_or_finds_one():
    """Of 300 jets, twenty had none among the first starts, and a message about a shape."""
    found = pp.equilibria(pp.Chain(pp.Pipe(0.09, jet_angle=0.3), 2), 12.5)
    assert len(found) >= 1


@pytest.mark.parametrize("u", [0.0, 4.0])
@pytest.mark.parametrize("make", [pp.Chain, pp.Galerkin], ids=["chain", "beam functions"])
def test_a_hinged_pipe_that_nothing_turns_rests_at_all_angles_which_count_once(make, u):
    """K is singular there, and each start would be led to an angle of its own."""
    model = make(pp.Pipe(0.6, damping=0.01, root="pinned"), 6)
    found = pp.equilibria(model, u)
    assert np.abs(found.q).max() < 1e-9
    assert found.stable.tolist() == [True]
    assert found.complete is False
    diagram = pp.bifurcation_diagram(model, [3.0, 4.0])
    assert len(diagram.equilibria) == 1
