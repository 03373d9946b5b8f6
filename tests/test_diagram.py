# SPDX-License-Identifier: MIT
"""The bifurcation diagram: equilibria, motions after the transient, bad arguments."""

import math
import re

import numpy as np
import pytest
import scipy.stats

import pipedyn as pp
from pipedyn import diagram as module
from pipedyn.attraction.from_motion import last_period
from pipedyn.attraction.records import Stretch
from pipedyn.motion.sampling import turning_points
from pipedyn.util.counters import count_work
from pipedyn.util.newton import NewtonFailed

TWO = pp.Chain(pp.Pipe(0.2, -20.0), 2)
SPEEDS = np.array([0.5, 1.0, 2.0, 3.0, 3.5, 5.0])


@pytest.fixture(scope="module")
def diagram():
    return pp.bifurcation_diagram(
        TWO, SPEEDS, cycles=0, brute_force=4, transient=40.0, duration=10.0
    )


def test_equilibria_of_all_speeds_are_on_the_branches_each_once(diagram):
    straight, *bent = diagram.equilibria
    assert straight.straight
    assert [branch.straight for branch in bent] == [False, False]
    np.testing.assert_allclose(bent[0].tips[:, 0], -bent[1].tips[:, 0], atol=1e-9)
    np.testing.assert_allclose(bent[0].tips[:, 1], bent[1].tips[:, 1], atol=1e-9)
    folds = [branch.folds[0].speed for branch in bent]
    assert folds[0] == pytest.approx(folds[1])
    assert bent[0].folds[0].tip[0] == pytest.approx(-bent[1].folds[0].tip[0])
    assert diagram.failures == ()


def test_motions_end_on_stable_equilibria_where_there_are_some(diagram):
    for u in (0.5, 1.0, 2.0, 3.0):
        found = pp.equilibria(TWO, u)
        stable = found.tips[found.stable, 0]
        attractors = diagram.at(u)
        assert [one.start for one in attractors] == [0, 1, 2, 3]
        for one in attractors:
            assert one.ending == "rest"
            assert np.abs(stable - one.turnings[-1]).min() < 1e-6


def test_motions_end_on_a_cycle_beyond_the_fold(diagram):
    for one in diagram.at(5.0):
        assert (one.ending, one.period) == ("periodic", 3)  # two loops in each swing
    motion = pp.simulate(TWO, 5.0, 60.0, lambda s: 0.3 * s, samples=30_001, rtol=1e-9)
    largest = np.abs(motion.tip[-5000:, 0]).max()
    assert diagram.at(5.0)[0].turnings.max() == pytest.approx(largest, abs=1e-4)


def test_motions_that_are_periodic_are_cycles_though_a_period_has_a_dozen_maxima():
    model = pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2)
    speeds = [10.0, 12.0]
    found = pp.bifurcation_diagram(model, speeds, cycles=0, brute_force=1)
    assert [(one.ending, one.period) for one in found.motions] == [
        *(("periodic", 11), ("periodic", 13))
    ]
    for one in found.motions:
        cycle = pp.limit_cycle(model, one.speed, one.end)
        assert cycle.stable
        assert cycle.amplitude == pytest.approx(0.5 * np.ptp(one.turnings), rel=1e-4)


@pytest.mark.parametrize("change", [{"cycles": 0}, {"brute_force": 0}])
def test_what_a_diagram_takes_is_told_beforehand(change, terminal, monkeypatch):
    model, speeds = pp.Galerkin(pp.Pipe(0.2), 3), np.linspace(5.0, 6.5, 7)
    given = {"brute_force": 3, "transient": 10.0, "duration": 4.0, **change}
    with count_work() as work:  # right-hand sides stand for seconds
        monkeypatch.setattr(module, "clock", lambda: work.right_hand_sides)
        pp.bifurcation_diagram(model, speeds, **given)
        needed = work.right_hand_sides
        pp.bifurcation_diagram(model, speeds, **given, progress=True)
    written = terminal.readouterr().err
    assert "equilibria" in written
    assert ("brute force" in written) == ("brute_force" not in change)
    told = float(re.search("diagram: about (.*) s on one thread", written)[1])
    assert needed / 3.0 < told < 3.0 * needed


@pytest.mark.parametrize(
    ("model", "speeds", "failed", "endings"),
    [
        (  # of two functions, which do not resolve how far the fast jet bends it
            pp.Galerkin(pp.Pipe(0.2, jet_angle=0.6), 2),
            *([0.5, 2.0, 6.0], 1, ["rest"] * 6),
        ),
        (  # nothing bounds motions that the flow feeds
            pp.Chain(pp.Pipe(0.5, flow="aspirating"), 2),
            *([0.0, 0.1, 5.0], 2, ["irregular"] * 4 + ["failed"] * 2),
        ),
    ],
    ids=["equilibria", "motions"],
)
def test_points_that_fail_are_marked_and_the_others_kept(model, speeds, failed, endings):
    asked = {"transient": 3.0, "duration": 2.0, "exponents": False}
    found = pp.bifurcation_diagram(model, speeds, cycles=0, brute_force=2, **asked)
    assert [(one.index, one.value) for one in found.failures] == [(2, speeds[2])] * failed
    assert [one.ending for one in found.motions] == endings
    assert len(found.equilibria) == 1


def test_two_frequencies_without_a_common_period_are_quasi_periodic():
    # Nothing takes energy from a pipe whose fluid rests: small motions are sums of two modes.
    found = pp.bifurcation_diagram(
        pp.Chain(pp.Pipe(0.2, 5.0), 2),
        [0.0, 0.1],
        cycles=0,
        brute_force=2,
        transient=0.0,
        duration=10.0,
        seed=5,
    )
    small, large = (np.ptp(one.turnings) for one in found.at(0.0))
    assert large > 5.0 * small  # motions whose turning points are not alike do not go on as one
    for one in found.at(0.0):
        assert one.name == "quasi-periodic"
        assert abs(one.exponent.value) < 3.0 * one.exponent.spread
    assert [one.name for one in found.at(0.1)] == ["rest", "rest"]


def test_irregular_motions_are_named_and_those_that_are_spread_alike_share_an_exponent():
    model = pp.Chain(pp.Pipe(0.3), 3)
    asked = {"cycles": 0, "brute_force": 3, "transient": 30.0}
    found = pp.bifurcation_diagram(model, [6.0, 8.5], **asked)
    assert [one.name for one in found.at(6.0)] == 3 * ["periodic, 1 maximum"]
    first, *others = found.at(8.5)
    assert first.ending == "chaotic"
    assert first.exponent.chaotic
    assert first.name == f"chaotic, exponent {first.exponent.value:.2g}"
    assert any(one.exponent is first.exponent for one in others)
    unnamed = pp.bifurcation_diagram(model, [6.0, 8.5], **asked, exponents=False).at(8.5)
    assert {one.name for one in unnamed} == {"irregular"}
    assert {one.exponent for one in unnamed} == {None}


def test_motions_that_nothing_damps_keep_their_own_sizes():
    """They are irregular, and the small ones move within the range of the large ones."""
    model = pp.Chain(pp.Pipe(0.2, 5.0), 2)
    asked = {"cycles": 0, "brute_force": 4, "transient": 20.0, "exponents": False}
    ends = pp.bifurcation_diagram(model, [0.0, 0.05], **asked).at(0.0)
    assert len({one.turnings.max() for one in ends}) == 4
    for one in ends:
        motion = pp.simulate(model, 0.0, 40.0, *np.split(one.end, 2), samples=2001)
        size = np.abs(one.turnings).max()
        assert np.abs(motion.tip[:, 0]).max() == pytest.approx(size, rel=0.1)


@pytest.mark.slow
def test_what_no_start_ends_on_is_found_from_a_branch_nearby():
    """Beside a pipe that leans on its stops a cycle attracts one in twenty starts or fewer."""
    stop = pp.Stop(at=0.893467140913, gap=0.0435158016257, stiffness=979.179198682)
    pipe = pp.Pipe(0.212504863262, -10.0, damping=0.002, terms=(stop,))
    model, u = pp.Chain(pipe, 2), 3.067254
    found = pp.bifurcation_diagram(model, [2.6, u], brute_force=3)
    *others, one = sorted(found.at(u), key=lambda end: -end.start)
    assert [end.name for end in others] == 3 * ["rest"]
    assert (one.start, one.ending) == (-1, "periodic")
    motion = pp.simulate(model, u, 200.0, *np.split(1.01 * one.end, 2), samples=20_001)
    late = motion.tip[motion.t > 190.0, 0]
    assert np.ptp(late) == pytest.approx(np.ptp(one.turnings), rel=1e-3)


def test_motions_begin_beside_cycles_to_which_others_led_at_other_speeds(monkeypatch):
    """The cycle is found at a higher speed; the only other start leads to another equilibrium.

    Beside equilibria none has to begin: their branches, which take longer, are left out.
    """
    monkeypatch.setattr(module, "equilibrium_branches", lambda *_: ())
    model = pp.Chain(pp.Pipe(0.2129, -40.0, drag=0.5), 3)
    asked = {"brute_force": 1, "exponents": False, "transient": 20.0, "duration": 5.0}
    found = pp.bifurcation_diagram(model, np.linspace(4.097, 5.513, 5), **asked)
    assert [branch.origin for branch in found.cycles] == ["motion"]
    assert [(one.speed, one.ending) for one in found.motions if one.start == -1] == [
        (found.speeds[1], "rest")
    ]


def test_settled_motions_end_early_where_they_would_have_ended():
    """So it costs nothing to allow them a longer transient."""
    model = pp.Galerkin(pp.Pipe(0.2), 4)
    for u, ending in ((4.0, "rest"), (6.5, "periodic"), (8.0, "periodic")):
        costs = []
        for transient in (100.0, 1e4):
            with count_work() as work:
                found = pp.attractors(model, u, 2, transient=transient)
            costs.append(work.right_hand_sides)
        assert costs[1] == pytest.approx(costs[0], rel=0.01)
        for basin in found.basins:
            assert basin.ending == ending
            amplitude = 0.0 if ending == "rest" else pp.limit_cycle(model, u).amplitude
            turnings = basin.attractor.turnings
            assert turnings.max() == pytest.approx(amplitude, abs=2e-6)
            assert turnings.min() == pytest.approx(-amplitude, abs=2e-6)


@pytest.mark.parametrize(
    ("model", "u", "ending"),
    [
        (pp.Chain(pp.Pipe(0.3), 3), 8.5, "irregular"),
        # Irregular for a while, and then on a cycle, on which each has to arrive by itself.
        (pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2), 10.18, "periodic"),
    ],
)
def test_motions_that_go_on_as_one_end_where_each_alone_does(model, u, ending):
    asked = {"transient": 40.0, "duration": 10.0, "exponents": False}
    with count_work() as together:
        found = pp.attractors(model, u, 3, **asked)
    with count_work() as apart:
        alone = [pp.attractors(model, u, [start], **asked).basins[0] for start in found.starts]
    for basin, one in zip((found.basins[k] for k in found.ends), alone, strict=True):
        assert basin.ending == one.ending == ending
        turnings = basin.attractor.turnings, one.attractor.turnings
        if ending == "periodic":
            assert basin.attractor.period == one.attractor.period
            assert turnings[0].max() == pytest.approx(turnings[1].max(), rel=0.05)
        else:  # of two chaotic records the farthest turning is chance, not how all are spread
            assert scipy.stats.ks_2samp(*turnings, method="asymp").pvalue > 0.01
    if ending == "irregular":
        assert together.right_hand_sides < 0.5 * apart.right_hand_sides


def test_a_motion_that_rests_where_nothing_stays_goes_on():
    # Upright and too heavy: 1e-12 beside the straight pipe a motion rests for a while.
    start = np.full(2, 1e-12)
    (basin,) = pp.attractors(TWO, 1.0, [start], transient=40.0, duration=10.0).basins
    one = basin.attractor
    stable = pp.equilibria(TWO, 1.0)
    assert np.abs(stable.tips[stable.stable, 0] - one.turnings[-1]).min() < 1e-2
    # Just beyond the onset of flutter it takes longer to leave than it is recorded.
    model, start = pp.Chain(pp.Pipe(0.2), 2), np.array([1e-9, 0.0])
    (basin,) = pp.attractors(model, 3.77, [start], transient=10.0, duration=5.0).basins
    assert basin.ending == "periodic"


def stretch(signals, end):
    """A record of which the states are given functions of time and their rates."""
    t = np.linspace(0.0, end, 100 * round(end) + 1)
    p = np.stack([signal(t) for signal in signals], axis=1)
    rates = np.stack([signal(t + 1e-20j).imag / 1e-20 for signal in signals], axis=1)
    return Stretch(t, np.concatenate([p, rates], axis=1), p[:, 0], rates[:, 0], 1e-6)


TORUS = [
    lambda t: np.cos(9.0 * t) + 0.4 * np.cos(9.0 * 2.0**0.5 * t),
    lambda t: np.sin(9.0 * t + 0.3 * np.cos(9.0 * 2.0**0.5 * t)),
]


def test_averages_converge_on_a_torus_and_not_where_motion_is_chaotic():
    assert stretch(TORUS, 100.0).averages_converge()
    drifting = [lambda t, one=one: one(t) * (1.0 + 0.1 * np.exp(-0.02 * t)) for one in TORUS]
    assert not stretch(drifting, 100.0).averages_converge()  # it still comes nearer to a torus
    random = np.random.default_rng(0)
    for _ in range(5):  # the phase of the second frequency is a random walk
        walk = np.cumsum(random.normal(0.0, 0.05, 10_001))
        t = np.linspace(0.0, 100.0, walk.size)
        x = np.cos(9.0 * t) + 0.4 * np.cos(9.0 * 2.0**0.5 * t + walk)
        states = np.stack([x, np.gradient(x, t)], axis=1)
        assert not Stretch(t, states, x, states[:, 1], 1e-6).averages_converge()


@pytest.mark.parametrize("times", [1, 21])
def test_a_period_is_found_however_many_maxima_it_holds(times):
    signals = [lambda t: np.cos(9.0 * t) + 0.2 * np.cos(9.0 / times * t), lambda t: np.sin(9.0 * t)]
    found = stretch(signals, 60.0)
    assert found.period == pytest.approx(times * 2.0 * np.pi / 9.0, rel=1e-4)
    assert stretch(TORUS, 60.0).period == 0.0


def test_a_drift_is_no_period_though_a_transient_changes_more():
    """A torus near a resonance changed by 6e-4 in its first period, then by 3e-5 in each."""
    drift = 1.2e-5

    def slow(t):
        return 1e-3 * np.exp(-0.5 * t) + drift * t

    moves = [lambda t: np.cos(9.0 * t) + np.cos(3.0 * t + slow(t)), lambda t: np.sin(9.0 * t)]
    assert stretch(moves, 60.0).period == 0.0
    drift = 0.0
    assert stretch(moves, 60.0).period == pytest.approx(2.0 * np.pi / 3.0, rel=1e-4)


@pytest.mark.parametrize("even", [True, False])
def test_states_between_the_samples_of_a_period_are_interpolated(even):
    t = np.linspace(0.0, 20.0, 2001)
    t = t if even else t + 2e-3 * np.sin(3.0 * t)

    def states(t):
        p = np.cos(23.0 * t) + 0.2 * np.cos(69.0 * t)
        return np.stack([p, -23.0 * np.sin(23.0 * t) - 13.8 * np.sin(69.0 * t)], axis=1)

    y = states(t)
    record = Stretch(t, y, y[:, 0], y[:, 1], 1e-6)
    between, frequency = last_period(record, 0.1)
    _, first, _, _ = record.recurrence
    assert frequency == pytest.approx(23.0, rel=1e-4)
    phases = np.linspace(0.0, 2.0 * np.pi, 1001)
    missed = np.abs(between(phases) - states(first + phases / frequency).T).max(axis=1)
    assert (missed < 2e-5 * np.ptp(y, axis=0)).all()


def test_starts_of_guided_scenes_meet_the_guide():
    scene = pp.modular.chain(pp.Pipe(0.2, damping=0.3), n=3).plus(pp.modular.Guide(node=2))
    found = pp.attractors(scene, 0.5, 8, duration=2.0)
    assert found.failed.count == 0
    for state in found.starts:
        assert abs(scene.shape(np.split(state, 2)[0], [2.0 / 3.0])[0, 0]) < 1e-9
        assert np.ptp(scene.angles(state)) > 0.01


def test_turning_points_of_a_sine():
    t = np.linspace(0.0, 6.0, 601)
    found = turning_points(t, 0.3 * np.sin(7.0 * t), 2.1 * np.cos(7.0 * t))
    assert len(found) == 13
    assert 2.0 * np.abs(np.abs(found) - 0.3).max() < 1e-6


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (lambda t: 0.2 + 1e-7 * np.sin(9.0 * t), "rest"),
        (lambda t: 0.2 * np.sin(9.0 * t), "periodic"),
        (lambda t: 0.2 * np.sin(9.0 * t) + 0.1 * np.sin(4.5 * t + 0.3), "periodic"),
        (lambda t: 0.2 * np.exp(-0.1 * t) * np.sin(9.0 * t), "settling"),
        (lambda t: 0.2 * np.sin(9.0 * t) * (1 - 0.5 * np.exp(-0.2 * t)), "settling"),
        (lambda t: 0.2 * np.sin(9.0 * t) + 0.15 * np.sin(math.e * t), "irregular"),
        # Maxima that repeat to 1e-3 of the range: a torus, what comes to a cycle, and slowly so.
        (lambda t: 0.2 * np.sin(9.0 * t) * (1 + 1e-3 * np.sin(0.8 * t)), "irregular"),
        (lambda t: 0.2 * np.sin(9.0 * t) * (1 + 1e-3 * np.exp(-0.3 * t)), "settling"),
        (lambda t: 0.2 * np.sin(9.0 * t) * (1 + 1e-3 * np.exp(-0.05 * t)), "settling"),
    ],
)
def test_kinds_of_motion_after_the_transient_are_distinguished(signal, expected):
    assert stretch([signal], 20.0).trend == expected


def test_what_is_recorded_keeps_to_rtol():
    """Nothing is known here on which motions could end; the cycle comes from collocation."""
    model = pp.Chain(pp.Pipe(0.2), 3)
    speeds = np.array([1.01, 1.1]) * pp.critical_speed(model).speed
    cycles = [pp.limit_cycle(model, u, rtol=1e-8) for u in speeds]
    asked = {"cycles": 0, "brute_force": 4, "duration": 20.0}  # eight motions take explicit steps
    found = pp.bifurcation_diagram(model, speeds, **asked).motions
    assert [one.name for one in found] == ["periodic, 1 maximum"] * 8
    for one in found:
        cycle = cycles[speeds.tolist().index(one.speed)]
        assert np.abs(one.turnings[-8:]) == pytest.approx(cycle.amplitude, rel=1e-5)


def test_a_drift_that_no_period_shows_is_not_taken_for_a_cycle():
    for drift, expected in ((1e-6, "periodic"), (0.05, "settling")):

        def signal(t, drift=drift):
            return 0.02 * (1.0 + drift * np.exp(-1e-3 * t)) * np.sin(9.0 * t)

        found = stretch([signal], 20.0)
        assert np.abs(np.diff(np.abs(found.turnings[1:-1]))).max() < 1e-6
        assert found.trend == expected


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"speeds": 2.0}, ValueError, "speeds must be one-dimensional"),
        ({"speeds": [1.0]}, ValueError, "speeds must be at least 2"),
        ({"speeds": [2.0, 1.0]}, ValueError, "strictly increasing"),
        ({"model": pp.Chain(pp.Pipe(0.2), 101)}, ValueError, "cycles must be 0 for more than 100"),
    ],
)
def test_bad_arguments_are_refused_by_name(change, kind, message):
    """Arguments of which a message says no more than their range are in fuzz.py."""
    given = {"model": TWO, "speeds": [0.0, 1.0], **change}
    with pytest.raises(kind, match=re.escape(message)):
        pp.bifurcation_diagram(given.pop("model"), given.pop("speeds"), **given)


def test_too_long_a_record_is_refused():
    chain = pp.Chain(pp.Pipe(0.2), 200)
    with pytest.raises(ValueError, match="duration must ask for at most 100000000 numbers"):
        pp.bifurcation_diagram(chain, [0.0, 1.0], cycles=0, brute_force=1, duration=1e4)


def test_too_many_motions_are_refused():
    with pytest.raises(ValueError, match="at most 100000 motions"):
        pp.bifurcation_diagram(TWO, np.linspace(0.0, 1.0, 11), brute_force=10_000)


def test_batches_count_for_their_caller():
    with count_work() as counters:
        found = pp.simulate_many(TWO, np.linspace(3.0, 6.0, 70), 1.0, lambda s: 0.1 * s, samples=5)
    assert counters.right_hand_sides == sum(motion.evaluations for motion in found.motions)


def test_a_motion_that_comes_back_in_one_state_only_is_near_no_cycle():
    # Both motions come back to an earlier state; only the first repeats all states in between.
    cycle = [lambda t: np.cos(9.0 * t) + 0.2 * np.cos(3.0 * t), lambda t: np.sin(9.0 * t)]
    assert stretch(cycle, 40.0).last_change < 1e-6
    t = np.linspace(0.0, 40.0, 4001)
    walk = np.cumsum(np.random.default_rng(1).normal(0.0, 0.1, t.size))
    x = np.cos(9.0 * t) + np.cos(9.0 * 2.0**0.5 * t + walk)
    chance = Stretch(t, np.stack([x, np.gradient(x, t)], axis=1), x, np.gradient(x, t), 1e-6)
    assert chance.recurrence[0] < 0.1
    assert chance.last_change > 0.3
    with pytest.raises(NewtonFailed, match="does not come back to an earlier state"):
        last_period(chance, 0.1)
    states, frequency = last_period(stretch(cycle, 40.0), 0.1)
    phase = np.linspace(0.0, 2.0 * np.pi, 7)
    t = phase / frequency
    assert frequency == pytest.approx(3.0, rel=1e-6)
    # Polynomials through eight samples miss a sine of 9 radians in a unit of time by 1e-13.
    assert np.ptp(states(phase)[1] ** 2 + (states(phase)[3] / 9.0) ** 2) < 1e-11
    assert states(phase[:1])[:, 0] == pytest.approx(states(phase[-1:])[:, 0], abs=1e-5)
    assert t[-1] == pytest.approx(2.0 * np.pi / 3.0, rel=1e-6)
