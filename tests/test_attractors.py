# SPDX-License-Identifier: MIT
"""Attractors at one speed and their basins, against single motions, symmetry and limit cycles."""

from functools import cache

import numpy as np
import pytest
import scipy.integrate

import pipedyn as pp
from pipedyn.attraction import attractors

STANDING = pp.Chain(pp.Pipe(0.2, -30.0), 2)
"""Upright, heavy: at u = 4.1 it leans to either side or flutters."""
ANGLES = np.linspace(-2.0, 2.0, 11)


@cache
def plane():
    return pp.attractors(STANDING, 4.1, pp.StartPlane(ANGLES, ANGLES))


def test_each_start_ends_where_its_motion_alone_does():
    found = plane()
    (cycle,) = (k for k, basin in enumerate(found.basins) if basin.ending == "periodic")
    some = np.random.default_rng(1).choice(len(found.starts), 16, replace=False)
    for i in some:
        q, qdot = np.split(found.starts[i], 2)
        motion = pp.simulate(STANDING, 4.1, 25.0, q, qdot)
        late = motion.tip[motion.t > 20.0, 0]
        basin = found.basins[found.ends[i]]
        if found.ends[i] == cycle:
            assert 0.5 * np.ptp(late) == pytest.approx(basin.amplitude, rel=2e-3)
        elif basin.attracts:
            assert np.ptp(late) < 1e-6
            np.testing.assert_allclose(motion.q[-1], basin.attractor.end[:2], atol=1e-6)


def test_mirror_images_have_equal_shares_of_a_symmetric_plane():
    found = plane()
    assert found.unsettled.count == found.failed.count == 0
    assert sum(basin.share.count for basin in found.basins) == ANGLES.size**2
    rests = [k for k, basin in enumerate(found.basins) if basin.ending == "rest"]
    one, other, upright = rests
    assert (found.basins[upright].share.count, found.basins[upright].attracts) == (1, False)
    assert (found.basins[one].mirror_image, found.basins[other].mirror_image) == (other, one)
    assert found.basins[one].share == found.basins[other].share
    np.testing.assert_allclose(
        found.basins[one].attractor.end, -found.basins[other].attractor.end, atol=1e-9
    )
    # Start by start: plane[-y, -x] mirrors plane[y, x].
    ends = found.ends.reshape(found.plane.shape)
    image = np.array([basin.mirror_image for basin in found.basins])
    np.testing.assert_array_equal(ends[::-1, ::-1], image[ends])


def test_an_upright_pipe_that_nothing_moves_is_told_from_what_attracts():
    found = plane()
    middle = found.basins[found.ends[len(found.ends) // 2]]
    assert (found.starts[len(found.ends) // 2] == 0.0).all()
    assert not middle.attracts
    assert middle.exponent > 1.0
    assert all(basin.attracts for basin in found.basins if basin is not middle)


def test_what_rests_is_an_equilibrium_and_its_exponent_an_eigenvalue():
    known = pp.equilibria(STANDING, 4.1)
    for basin in plane().basins:
        if basin.ending == "rest" and basin.attracts:
            apart = np.abs(known.q - basin.motion.q[-1]).max(axis=1)
            assert apart.min() < 1e-8
            assert basin.exponent == pytest.approx(known.growth[apart.argmin()], rel=1e-6)
            assert basin.amplitude == basin.period == 0.0
            assert basin.section.shape == (0, 4)


def test_a_cycle_has_the_period_and_amplitude_of_collocation():
    cycle = next(basin for basin in plane().basins if basin.ending == "periodic")
    solved = pp.limit_cycle(STANDING, 4.1, cycle.motion)
    assert cycle.period == pytest.approx(solved.period, rel=1e-7)
    assert cycle.amplitude == pytest.approx(solved.amplitude, rel=1e-6)
    assert solved.stable
    assert cycle.attracts
    # It is its own mirror image: x has odd harmonics alone.
    assert np.abs(cycle.spectrum[2:40:2]).max() < 1e-5 * cycle.spectrum.max()
    assert cycle.frequencies[1] == pytest.approx(solved.frequency, rel=1e-7)
    assert cycle.motion.tip[:, 0].var() == pytest.approx(
        0.5 * np.sum(cycle.spectrum[1:] ** 2), rel=1e-3
    )


def test_a_section_holds_the_maxima_of_the_free_end():
    cycle = next(basin for basin in plane().basins if basin.ending == "periodic")
    assert len(cycle.section) == 16 * cycle.attractor.period
    q, qdot = np.split(cycle.section.T, 2)
    rates = STANDING.tip_velocities(q, qdot)[:, 0]
    assert np.abs(rates).max() < 1e-10
    accelerations = STANDING.rhs(0.0, cycle.section.T, 4.1)[2:]
    theta = q
    # x'' of two segments of one half each.
    bend = 0.5 * (np.cos(theta) * accelerations - np.sin(theta) * qdot**2).sum(axis=0)
    assert (bend < 0.0).all()
    k = cycle.attractor.period
    np.testing.assert_allclose(cycle.section[k:], cycle.section[:-k], atol=1e-5)


def test_a_cycle_that_is_not_symmetric_and_its_mirror_image_are_two_attractors():
    model = pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2)
    starts = np.random.default_rng(3).uniform(-1.0, 1.0, (8, 2))
    found = pp.attractors(model, 7.0, np.concatenate([starts, -starts]))
    one, other = found.basins
    assert one.share == other.share
    assert (one.mirror_image, other.mirror_image) == (1, 0)
    assert (found.ends[:8] == 1 - found.ends[8:]).all()
    assert one.period == pytest.approx(other.period, rel=1e-6)
    assert one.amplitude == pytest.approx(other.amplitude, rel=1e-6)
    means = [basin.motion.tip[:-1, 0].mean() for basin in found.basins]
    assert means[0] == pytest.approx(-means[1], rel=1e-4)
    assert abs(means[0]) > 1e-2


def test_whole_turns_about_a_hinge_lead_to_the_same_attractor():
    model = pp.Chain(pp.Pipe(0.2, 10.0, root="pinned"), 2)
    angles = np.array([[0.5, 0.2], [-0.3, 0.4], [1.0, 1.5]])
    found = pp.attractors(model, 3.0, np.concatenate([angles, angles + 2.0 * np.pi]))
    (rest,) = found.basins
    assert (rest.ending, rest.share.value) == ("rest", 1.0)


@cache
def hanging():
    """Subcritical: its cycle folds at some 0.96 of the speed of onset."""
    model = pp.Chain(pp.Pipe(0.05, 60.0), 2)
    return model, pp.hopf(model)


@pytest.mark.parametrize(
    ("share", "endings"),
    [(0.94, {"rest"}), (0.98, {"rest", "periodic"}), (1.02, {"periodic"})],
)
def test_rest_and_cycle_attract_between_a_fold_and_a_subcritical_onset(share, endings):
    model, onset = hanging()
    assert onset.criticality == "subcritical"
    starts = np.array([0.1, 0.5, 1.5, -1.5])[:, None] * [1.0, -1.0]
    found = pp.attractors(model, share * onset.speed, starts)
    assert {basin.ending for basin in found.basins} == endings
    assert found.unsettled.count == 0


def test_an_unstable_cycle_lies_between_the_basins():
    model, onset = hanging()
    u = 0.98 * onset.speed
    between = pp.limit_cycle(model, u)
    assert not between.stable
    on = between.y.T[:: max(len(between.t) // 4, 1)]
    found = pp.attractors(model, u, np.concatenate([0.95 * on, 1.05 * on]))
    kinds = [found.basins[end].ending for end in found.ends]
    assert kinds == ["rest"] * len(on) + ["periodic"] * len(on)


def test_chaos_has_a_positive_exponent_beside_a_stable_pipe():
    model = pp.Chain(pp.Pipe(0.85), 3)
    starts = np.array([[0.02, 0.0, 0.0], [1.5, -1.5, 1.0]])
    found = pp.attractors(model, 6.3, starts, transient=20.0, duration=10.0)
    chaos, rest = sorted(found.basins, key=lambda basin: basin.ending)
    assert found.basins[found.ends[0]] is rest
    assert chaos.ending == "chaotic"
    assert chaos.attractor.exponent.chaotic
    assert chaos.exponent == chaos.attractor.exponent.value
    assert np.isnan(chaos.period)
    assert len(np.unique(chaos.section[:, 0].round(3))) > 30


def test_ends_that_are_held_tell_nothing():
    scene = pp.modular.chain(pp.Pipe(0.2), n=3).plus(pp.modular.Guide(node=3))
    with pytest.raises(ValueError, match="model must have an end that moves across"):
        pp.attractors(scene, 1.0, 4)


def test_a_start_that_fails_leaves_the_others():
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.01), 3)
    starts = np.zeros((36, 6))
    starts[:, 0] = np.linspace(0.1, 0.5, 36)
    starts[[2, 35], 3:] = 1e4
    found = pp.attractors(model, 4.0, starts)
    assert [failure.index for failure in found.failures] == [2, 35]
    assert all("no longer finite" in str(failure.error) for failure in found.failures)
    assert [f"start {failure.index} " in str(failure.error) for failure in found.failures]
    assert found.failed.count == 2
    assert (np.delete(found.ends, [2, 35]) == 0).all()
    assert found.ends[[2, 35]].tolist() == [-2, -2]
    assert found.basins[0].share.value == pytest.approx(34 / 36)


def test_what_comes_to_rest_slowly_is_followed_until_it_does():
    # Growth -0.1 at rest: after transient and record motions are a fifth as large.
    found = pp.attractors(pp.Chain(pp.Pipe(0.05), 2), 3.1, 3, transient=10.0, duration=5.0)
    (rest,) = found.basins
    assert (rest.ending, rest.share.count, rest.exponent) == (
        "rest",
        3,
        pytest.approx(-0.1017, abs=1e-4),
    )


def test_what_cannot_be_told_is_unsettled_with_the_reason():
    # Just below a supercritical onset motions get smaller by a tenth while they are recorded.
    model = pp.Chain(pp.Pipe(0.2), 2)
    u = pp.critical_speed(model).speed - 1e-3
    starts = np.array([[0.3, 0.3], [-0.3, 0.1]])
    found = pp.attractors(model, u, starts, transient=10.0, duration=5.0)
    assert found.basins == ()
    assert found.unsettled.value == 1.0
    assert found.ends.tolist() == [-1, -1]
    assert [one.start for one in found.unsettled_motions] == [0, 1]
    for one in found.unsettled_motions:
        assert one.ending == "unsettled"
        assert "still comes nearer to rest or a cycle after t = 175" in one.reason


def test_a_motion_is_chaotic_where_its_exponent_is_above_three_of_its_spreads():
    none = np.zeros(0)
    for value, chaotic in ((0.4, True), (0.2, False), (0.05, False)):
        found = pp.LyapunovExponent(value, 0.1, none, none, none, 1.0, none)
        assert found.chaotic == chaotic


def test_an_irregular_motion_that_nothing_shows_to_be_chaotic_or_a_torus_is_unsettled():
    """Nothing takes energy from it, and its frequencies are nearly resonant."""
    model, asked = pp.Chain(pp.Pipe(0.2, 5.0), 2), {"transient": 0.0, "duration": 5.0}
    one = pp.bifurcation_diagram(model, [0.0, 3.0], cycles=0, brute_force=3, **asked).at(0.0)[2]
    assert (one.ending, one.exponent.chaotic) == ("unsettled", False)
    value, spread = one.exponent.value, one.exponent.spread
    assert f"neither its largest Lyapunov exponent, {value:.2g} with a spread of" in one.reason
    assert f"{spread:.2g}, shows chaos, nor do averages over a time of 100 show a" in one.reason


def test_an_irregular_motion_whose_exponent_is_not_known_is_unsettled():
    """It grows slowly, to where a law of its own ends."""
    pipe = pp.Pipe(0.5, flow="aspirating")

    def law(q, v):
        return np.where(abs(q) > 0.7, np.nan, 0.0 * q)

    scene = pp.modular.chain(pipe, 2).plus(pp.modular.Custom(joints=(2,), force=law))
    start = scene.bent(lambda s: 0.3 * s)
    (one,) = pp.attractors(scene, 0.1, [start], transient=4.0, duration=1.0).unsettled_motions
    assert one.reason.startswith("its largest Lyapunov exponent is not known: the motion stopped: ")


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_motion_that_creeps_is_not_at_rest():
    found = pp.attractors(
        pp.Chain(pp.Pipe(0.2, damping=1e5), 2), 1.0, 2, transient=4.0, duration=1.0
    )
    assert found.unsettled.count == 2
    assert found.unsettled_motions[0].reason.startswith("it still comes nearer to rest")


def test_bent_rests_have_no_mirror_image():
    jet = pp.Chain(pp.Pipe(0.2, jet_angle=0.3), 2)
    found = pp.attractors(jet, 2.0, 5)
    (basin,) = found.basins
    assert (basin.ending, basin.mirror_image) == ("rest", -1)
    assert abs(basin.motion.tip[-1, 0]) > 1e-3


def test_the_error_of_a_share_is_a_binomial_s_and_not_0_where_all_starts_agree():
    found = plane()
    n = len(found.starts)
    for basin in found.basins[:3]:
        p = basin.share.count / n
        assert basin.share.value == p
        assert basin.share.error == pytest.approx(np.sqrt(p * (1.0 - p) / n), rel=0.02)
    assert 0.0 < found.failed.error < 1.0 / n


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"starts": "many"}, "starts must be a whole number, an array of states or a StartPlane"),
        ({"starts": np.zeros((3, 3))}, r"starts must have the shape \(N, 4\) .* got \(3, 3\)"),
        ({"starts": np.zeros((0, 2))}, "starts must be 1 to 1000000, got 0"),
        (
            {"starts": pp.StartPlane(np.arange(1001.0), np.arange(1000.0))},
            r"starts must be 1 to 1000000, got \(1000, 1001\)",
        ),
        ({"starts": [[1e9, 0.0]]}, r"starts must lie in .* \(start 0\)"),
        (
            {"starts": pp.StartPlane([0.0], [0.0], (0, 7))},
            r"starts must have indices in \[0, 3\]",
        ),
        (
            {"starts": pp.StartPlane([0.0], [0.0], state=[1.0])},
            "starts must have a state of 2 or 4 entries, got 1",
        ),
        ({"u": 0.0}, "u must be > 0 for a pipe without damping and drag, got 0"),
        ({"u": lambda t: 4.0}, "u must be a flow speed or a Pulsation"),
        ({"base": lambda t: (0.1, 0.0)}, "base must be a Harmonic, which has a period, or None"),
        (
            {"u": pp.Pulsation(4.0, 0.1, 9.0), "base": pp.Harmonic(0.1, 8.0)},
            "base must have the frequency of u, 9, so that both repeat, got 8",
        ),
    ],
)
def test_bad_arguments_are_refused_by_name(arguments, message):
    with pytest.raises((ValueError, TypeError), match=message):
        pp.attractors(STANDING, **{"u": 4.1, "starts": 3} | arguments)


def test_a_pipe_with_drag_alone_may_be_asked_without_flow():
    model = pp.Chain(pp.Pipe(0.2, 5.0, drag=0.5), 2)
    found = pp.attractors(model, 0.0, 2, transient=4.0, duration=1.0)
    assert found.unsettled.count == 2  # it comes to rest ever more slowly


def test_an_oscillating_base_leads_to_the_forced_motion():
    model, base = pp.Chain(pp.Pipe(0.2, damping=0.01), 2), pp.Harmonic(0.05, 9.0)
    found = pp.attractors(model, 2.0, 3, base=base)
    (basin,) = found.basins
    (solved,) = pp.forced_response(model, 2.0, base=base, frequencies=(8.0, 10.0)).at(9.0)
    assert basin.amplitude == pytest.approx(solved.amplitude, rel=1e-5)
    np.testing.assert_allclose(basin.section[-1], solved.y[:, 0], atol=1e-5)
    assert basin.attracts
    assert basin.mirror_image == 0  # half a period later
    assert basin.period == pytest.approx(2.0 * np.pi / 9.0)
    assert np.isnan(basin.exponent)
    assert len(basin.section) == 48
    np.testing.assert_allclose(basin.section, basin.section[:1].repeat(48, axis=0), atol=1e-5)


@pytest.mark.parametrize(("amplitude", "unstable"), [(0.1, False), (0.4, True)])
def test_a_pump_excites_a_motion_of_twice_its_period_where_multipliers_are_beyond_one(
    amplitude, unstable
):
    model, pump = pp.Chain(pp.Pipe(0.2), 2), pp.Pulsation(3.2, amplitude, 16.3)
    multipliers = pp.floquet(model, pump).multipliers
    assert (np.abs(multipliers).max() > 1.0) == unstable
    (basin,) = pp.attractors(model, pump, 4).basins
    assert basin.attracts
    if unstable:
        assert multipliers[0].real < -1.0
        assert basin.period == pytest.approx(2.0 * pump.period)
        motion = pp.simulate(model, pump, 80.0 * pump.period, basin.section[0][:2])
        late = motion.tip[motion.t > 60.0 * pump.period, 0]
        assert 0.5 * np.ptp(late) == pytest.approx(basin.amplitude, rel=1e-3)
    else:
        assert basin.ending == "rest"


LEANING = pp.Chain(pp.Pipe(0.3, 10.0, jet_angle=0.4, damping=0.005), 3)


def ends_by_another_integrator(model, u, q, until):
    """Half the range of the free end at last, and the states then, by LSODA on `Model.rhs`."""
    start = np.concatenate([q, np.zeros_like(q)])
    found = scipy.integrate.solve_ivp(
        *(lambda t, y: model.rhs(t, y, u), (0.0, until), start),
        method="LSODA",
        rtol=1e-8,
        atol=1e-10,
        t_eval=np.linspace(until - 15.0, until, 4001),
    )
    across = model.tips(found.y[: q.size])[:, 0]
    return 0.5 * np.ptp(across)


@pytest.mark.parametrize(
    ("model", "u", "count", "expected"),
    [
        # A period of 21 maxima; none shorter repeats.
        pytest.param(
            *(pp.Chain(pp.Pipe(0.5, 40.0, damping=0.01), 2), 9.0, 8, {(21, 6.5538)}),
            marks=pytest.mark.slow,
        ),
        # The largest multiplier of the second is 0.8996: transients last for some 200 T.
        pytest.param(*(LEANING, 7.0, 16, {(2, 1.13303), (9, 3.52762)}), marks=pytest.mark.slow),
        # Just beyond a period doubling, where the cycle that was left is near.
        (LEANING, 6.9652, 4, {(2, 1.14040), (6, 2.41071)}),
    ],
)
def test_motions_that_come_to_a_cycle_late_or_of_many_maxima_are_periodic(
    model, u, count, expected
):
    found = pp.attractors(model, u, count)
    assert found.unsettled.count == 0
    told = sorted((one.attractor.period, one.period) for one in found.basins)  # each once
    for (maxima, period), (known, length) in zip(told, sorted(expected), strict=True):
        assert (maxima, period) == (known, pytest.approx(length, abs=1e-4))
    for basin in found.basins:
        assert (basin.ending, basin.attracts) == ("periodic", True)
        cycle = pp.limit_cycle(model, u, basin.motion)
        assert cycle.stable
        assert cycle.period == pytest.approx(basin.period, rel=1e-6)
    q = found.starts[0, : model.coordinates]
    assert ends_by_another_integrator(model, u, q, 100.0) == pytest.approx(
        found.basins[found.ends[0]].amplitude, rel=1e-3
    )


@pytest.mark.slow
def test_a_torus_near_a_resonance_is_quasi_periodic():
    """Every 44.26 T it comes back to 3e-4 of its size, and drifts on by as much."""
    weight = pp.PointMass(0.477532986911, 0.0551827581442)
    pipe = pp.Pipe(0.454425609, damping=0.002, jet_angle=0.179560964181, terms=(weight,))
    model, u = pp.Chain(pipe, 4), 9.399742365358085
    (basin,) = pp.attractors(model, u, 3).basins
    assert (basin.ending, basin.share.value) == ("quasi-periodic", 1.0)
    assert abs(basin.exponent) < 3.0 * basin.attractor.exponent.spread
    # About an unstable cycle, one multiplier of which has left the unit circle as one of a pair.
    motion = pp.simulate(model, u, 500.0, basin.motion.q[-1], basin.motion.qdot[-1], samples=50_001)
    states = motion.y.T[motion.t > 100.0]
    for time in (44.26, 2 * 44.26, 4 * 44.26):
        step = round(time / 0.01)
        apart = np.abs((states[step:] - states[:-step]) / np.ptp(states, axis=0)).max()
        assert apart > 1e-4  # at none of these does it repeat


@pytest.mark.slow
def test_weak_chaos_is_told_by_longer_exponents():
    found = pp.attractors(LEANING, 6.97, 6)
    assert {basin.ending for basin in found.basins} == {"periodic", "chaotic"}
    (chaos,) = (basin for basin in found.basins if basin.ending == "chaotic")
    exponent = chaos.attractor.exponent
    assert exponent.value > 3.0 * exponent.spread
    longer = pp.lyapunov_exponent(LEANING, 6.97, chaos.motion, duration=200.0, transient=20.0)
    assert longer.value == pytest.approx(
        exponent.value, abs=3.0 * (longer.spread + exponent.spread)
    )


def test_driven_motions_are_named_by_the_same_rules():
    model = pp.Chain(pp.Pipe(0.2, damping=0.01), 2)
    u = 1.05 * pp.critical_speed(model).speed
    asked = {"transient": 50.0, "duration": 20.0}
    (torus,) = pp.attractors(model, u, 3, base=pp.Harmonic(0.002, 3.3), **asked).basins
    assert (torus.ending, torus.share.count) == ("quasi-periodic", 3)
    assert abs(torus.exponent) < 3.0 * torus.attractor.exponent.spread


@pytest.mark.slow
def test_nothing_in_a_diagram_contradicts_what_motions_end_on():
    speeds = [6.99, 7.0]
    found = pp.bifurcation_diagram(LEANING, speeds, brute_force=4)
    for one in found.motions:
        assert one.ending in ("periodic", "chaotic", "rest")
        if one.ending == "periodic" and one.start >= 0:
            cycles = [c for branch in found.cycles for c in branch.at(one.speed) if c.stable]
            apart = [abs(2.0 * c.amplitude / np.ptp(one.turnings) - 1.0) for c in cycles]
            assert min(apart) < 1e-4


def test_a_motion_that_comes_nearer_ever_more_slowly_is_unsettled():
    """The speed is 1e-5 below a period doubling: a multiplier is -0.99994."""
    pipe = pp.Pipe(0.313591587301, gamma=-10.0, jet_angle=-0.478597799288)
    model, u = pp.Chain(pipe, 3), 5.113592052618494
    found = pp.attractors(model, u, 2, transient=4.0, duration=10.0, seed=18)
    assert found.basins == ()
    reasons = [one.reason for one in found.unsettled_motions]
    assert len(reasons) == 2
    assert all("it still comes nearer to rest or a cycle" in one for one in reasons)
    cycle = pp.limit_cycle(model, u)
    assert cycle.stable
    assert np.abs(cycle.others).max() == pytest.approx(0.99994, abs=1e-5)
    # A motion that goes round twice leads to the cycle that is run through once.
    end = np.split(found.unsettled_motions[0].end, 2)
    motion = pp.simulate(model, u, 10.0, *end, samples=2001)
    again = pp.limit_cycle(model, u, motion)
    assert again.period == pytest.approx(cycle.period, rel=1e-6)


def test_motions_that_wind_up_without_end_fail_for_that_reason():
    pipe = pp.Pipe(0.4, gamma=60.0, flow="aspirating", damping=0.001)
    model = pp.Chain(pipe, 1)
    with pytest.raises(pp.MotionStopped, match="its coordinates grow beyond 1e\\+06") as stopped:
        pp.simulate(model, 7.7, 40.0, [0.3])
    motion = stopped.value.motion
    assert motion.t.size > 10
    assert np.abs(motion.q).max() <= 1e6
    found = pp.attractors(model, 7.7, 3)
    assert found.basins == ()
    assert all("grow beyond 1000" in str(one.error) for one in found.failures)
    assert len(found.failures) == 3


def test_a_motion_that_winds_up_leaves_the_others_their_ends():
    terms = (pp.Spring(0.627635164969, 4.2302969467), pp.CubicSpring(0.84825665574, 2794.41233978))
    stop = pp.Stop(0.714662226338, 0.0796417200423, 55.1800972845)
    pipe = pp.Pipe(0.392575066313, 60.0, "aspirating", damping=0.001, terms=(stop, *terms))
    found = pp.attractors(pp.Chain(pipe, 1), 7.7046334, np.array([[0.0, 0.0], [0.3, 0.0]]))
    assert found.ends.tolist() == [0, -2]
    (failure,) = found.failures
    assert isinstance(failure.error, pp.MotionStopped)


def test_a_motion_that_stops_while_its_attractor_is_recorded_leaves_the_others(monkeypatch):
    """Joints of chains in three dimensions folded after motions had been called chaotic."""
    recorded = attractors.simulate

    def stops(model, u, duration, *args, **options):
        motion = recorded(model, u, duration, *args, **options)
        if duration > 1.0:  # not at rest
            raise pp.MotionStopped("the motion stopped at t = 1", motion)
        return motion

    monkeypatch.setattr(attractors, "simulate", stops)
    starts = np.array([[0.0, 0.0], [0.3, 0.3]])
    found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, starts)
    assert found.ends.tolist() == [0, -2]
    assert [basin.ending for basin in found.basins] == ["rest"]
    (failure,) = found.failures
    assert str(failure.error) == "after it seemed periodic, the motion stopped at t = 1"


@pytest.mark.slow
def test_motions_that_joined_others_which_joined_more_have_their_ends():
    """One that joined another, which went on as a third one, had no answer.

    All end on one cycle, its own mirror image, which a record at five samples a maximum blurs: the
    cycle did not lie within its own region, and motions on it were lost.
    """
    stop = pp.Stop(0.527800982578, 0.172022108989, 1879.476871)
    mass, spring = pp.PointMass(0.975684157121, 0.519224861128), pp.CubicSpring(0.888086, 11.6373)
    numbers = {"drag": 0.552960836318, "damping": 0.02, "terms": (stop, mass, spring)}
    pipe = pp.Pipe(0.833963891004, 10.0, "aspirating", **numbers)
    found = pp.attractors(pp.Chain(pipe, 1), 11.49136402486077, 3, seed=21)
    assert found.failures == ()
    assert [basin.share.count for basin in found.basins] == [3]
    assert found.unsettled_motions == ()
