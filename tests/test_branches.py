# SPDX-License-Identifier: MIT
"""Branches of cycles in the bifurcation diagram: what they meet, where they turn and change."""

import math
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp

THREE = pp.Chain(pp.Pipe(0.2), 3)
SUBCRITICAL = pp.Chain(pp.Pipe(0.7), 3)
ROM = pp.Galerkin(pp.Pipe(0.2), 4)


@pytest.fixture(scope="module")
def three():
    return pp.bifurcation_diagram(THREE, np.array([4.0, 5.0, 8.4]), cycles=26)


@pytest.fixture(scope="module")
def subcritical():
    return pp.bifurcation_diagram(SUBCRITICAL, [6.15, 6.1996, 6.1998, 6.202, 6.25], cycles=12)


def outside(multipliers):
    return np.count_nonzero(np.abs(multipliers) > 1.0 + 1e-6)


def events(branch):
    return [event.kind for event in branch.events]


# --------------------------------------------------------------------------------- what they meet


@pytest.mark.parametrize("model", [THREE, ROM, pp.Chain(pp.Pipe(0.2, drag=1.0), 3)], ids=repr)
def test_cycles_over_the_onset_are_those_of_limit_cycle(model):
    onset = pp.hopf(model)
    speeds = onset.speed + np.array([-0.5, 0.2, 0.8])
    found = pp.bifurcation_diagram(model, speeds)
    (branch,) = found.cycles
    assert found.failures == ()
    assert branch.onset == pytest.approx(onset.speed, rel=1e-9)
    assert branch.at(speeds[0]) == ()
    for u in speeds[1:]:
        (cycle,) = branch.at(u)
        alone = pp.limit_cycle(model, u)
        assert cycle.amplitude == pytest.approx(alone.amplitude, rel=2e-6)
        assert cycle.frequency == pytest.approx(alone.frequency, rel=2e-6)
        assert cycle.stable == alone.stable
        assert cycle.symmetric
        assert cycle.multiplier_error < 1e-6
    assert branch.stable.all()
    assert (branch.speeds[0], branch.amplitudes[0]) == (branch.onset, 0.0)
    assert branch.frequencies[0] == pytest.approx(onset.frequency, rel=1e-9)
    assert branch.amplitudes[1] == pytest.approx(onset.amplitude(branch.speeds[1]), rel=5e-2)
    assert events(branch) == ["hopf"]


def test_cycles_between_the_speeds_asked_for_are_good_to_1e_5():
    branch = pp.bifurcation_diagram(THREE, [4.4, 5.2]).cycles[0]
    for cycle in branch.cycles[2:-1:2]:
        assert pp.limit_cycle(THREE, cycle.u).amplitude == pytest.approx(cycle.amplitude, rel=1e-5)


def test_the_torus_of_three_segments_is_listed(three):
    branch = three.cycles[0]
    torus = next(event for event in branch.events if event.kind == "torus")
    assert torus.speed == pytest.approx(8.352, abs=1e-3)
    assert torus.error < 1e-3
    assert abs(torus.multiplier) == pytest.approx(1.0, abs=1e-3)
    assert abs(torus.multiplier.imag) > 0.1
    first = int(np.flatnonzero(~branch.stable)[0])
    assert branch.speeds[first] == pytest.approx(torus.speed, abs=1e-3)
    assert (np.diff(branch.speeds[:first]) > 0.0).all()
    # Either side, alone.
    before = pp.limit_cycle(THREE, 8.34)
    assert before.stable
    past = pp.limit_cycle(THREE, 8.37, before)
    assert not past.stable
    assert np.count_nonzero(np.abs(past.others) > 1.0) == 2
    assert np.abs(past.others - torus.multiplier).min() < 0.05


def test_a_cycle_is_unstable_if_a_multiplier_exceeds_1_beyond_its_error(three, subcritical):
    for branch in three.cycles + subcritical.cycles:
        for cycle in branch.cycles:
            excess = np.abs(cycle.others).max() - 1.0
            unsure = max(1e-6, 3.0 * cycle.multiplier_error)
            assert abs(excess) < unsure or cycle.stable == (excess < 0.0)
    # At a fold the second multiplier is 1, from above or from below.
    (branch,) = subcritical.cycles
    fold = branch.cycles[int(branch.speeds.argmin())]
    assert np.abs(fold.others).max() == pytest.approx(1.0, abs=1e-3)


def test_an_unstable_cycle_lies_on_the_stable_side_of_a_subcritical_onset(subcritical):
    (branch,) = subcritical.cycles
    onset = pp.hopf(SUBCRITICAL)
    assert onset.criticality == "subcritical"
    small, large = branch.at(6.202)
    assert small.u < onset.speed
    assert not small.stable
    assert large.stable
    assert small.amplitude < large.amplitude
    assert pp.eigenvalues(SUBCRITICAL, 6.202).real.max() < 0.0
    assert pp.limit_cycle(SUBCRITICAL, 6.202).amplitude == pytest.approx(small.amplitude, rel=1e-6)


def test_a_fold_of_cycles_is_where_the_two_meet(subcritical):
    (branch,) = subcritical.cycles
    fold = branch.events[1]
    assert events(branch)[:2] == ["hopf", "fold"]
    assert fold.multiplier == pytest.approx(1.0, abs=1e-3)
    assert branch.speeds.min() == pytest.approx(fold.speed, abs=1e-9)
    top = int(branch.speeds.argmin())
    assert not branch.stable[1:top].any()
    assert branch.stable[top + 1 : top + 3].all()
    # Near it the square of the distance in amplitude is as the distance in speed.
    near = [branch.at(u) for u in (6.1996, 6.1998)]
    halves = np.array([0.5 * (b.amplitude - a.amplitude) for a, b in near])
    distances = np.array([6.1996, 6.1998]) - fold.speed
    assert halves**2 / distances == pytest.approx(halves[0] ** 2 / distances[0], rel=0.1)


def test_a_cycle_that_appears_and_vanishes_is_one_branch():
    """None is lost where it comes back to rest: there amplitudes are like a square root."""
    model = pp.Galerkin(pp.Pipe(0.295), 7, "legendre")
    found = pp.crossings(model, 8.0)
    onsets, frequencies = [c.speed for c in found], [c.frequency for c in found]
    before = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    found = pp.bifurcation_diagram(model, [7.2, 7.6, *(onsets[-1] - before), 8.0])
    (branch,) = found.cycles
    assert found.failures == ()
    assert events(branch) == ["hopf", "hopf"]
    assert [event.speed for event in branch.events] == pytest.approx(onsets, rel=1e-9)
    assert (branch.amplitudes < 0.1).all()
    ends = [0, -1]  # at rest, where a pair of multipliers is 1
    assert branch.amplitudes[ends].tolist() == branch.highest[ends].tolist() == [0.0, 0.0]
    assert (branch.amplitudes[1:-1] > 0.0).all()
    np.testing.assert_allclose(branch.speeds[ends], onsets, rtol=1e-9)
    np.testing.assert_allclose(branch.frequencies[ends], frequencies, rtol=1e-9)
    np.testing.assert_allclose(branch.multipliers[ends, :2], 1.0, atol=1e-6)
    assert branch.stable[ends].all()
    law = [branch.at(onsets[-1] - apart)[0].amplitude / np.sqrt(apart) for apart in before]
    np.testing.assert_allclose(law, law[-1], rtol=4e-3)


@pytest.mark.slow
def test_a_branch_goes_on_where_its_cycles_begin_to_touch_a_stop():
    stop, speeds = pp.Stop(1.0, gap=0.05, stiffness=200.0), [4.491, 4.4935, 4.51]
    model = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.005, terms=(stop,)), 2)
    (branch, *_) = pp.bifurcation_diagram(model, speeds).cycles
    grazing = next(event for event in branch.events if event.kind == "grazing")
    assert grazing.amplitude == pytest.approx(stop.gap, rel=1e-3)
    free = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.005), 2)
    before = pp.limit_cycle(free, grazing.speed - 3.0 * grazing.error)
    assert before.amplitude < stop.gap < pp.limit_cycle(free, grazing.speed + 0.01).amplitude
    assert pp.limit_cycle(free, speeds[0]).amplitude == pytest.approx(
        branch.at(speeds[0])[0].amplitude, rel=1e-6
    )
    (touching,) = branch.at(speeds[1])
    assert touching.stable
    start = touching.q[0], 1.01 * touching.qdot[0]
    going = pp.simulate(model, speeds[1], 300.0 * touching.period, *start, samples=2, rtol=1e-9)
    last = pp.simulate(model, speeds[1], touching.period, going.q[-1], going.qdot[-1], samples=201)
    assert 0.5 * np.ptp(last.tip[:, 0]) == pytest.approx(touching.amplitude, rel=1e-4)
    (unstable,) = branch.at(speeds[2])
    assert unstable.symmetric
    assert not unstable.stable


def test_a_branch_goes_on_where_its_cycles_touch_a_stop_once_more(monkeypatch):
    """At 5.0738, where a smaller maximum of the displacement comes to the stop.

    A motion leads to the branch: the 49 branches of equilibria take much longer and are left out.
    """
    monkeypatch.setattr("pipedyn.diagram.equilibrium_branches", lambda *_: ())
    stop = pp.Stop(1.0, gap=0.05, stiffness=200.0)
    model = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.005, terms=(stop,)), 2)
    u = 5.08
    branch = pp.bifurcation_diagram(model, [4.49, u]).cycles[0]
    grazing = [event.speed for event in branch.events if event.kind == "grazing"]
    assert grazing == pytest.approx([4.492, 5.0738], abs=1e-4)
    cycles = branch.at(u)
    assert len(cycles) == 3
    for cycle in cycles:
        start = np.concatenate([cycle.q[0], cycle.qdot[0]])
        accurate = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}
        step = {"max_step": cycle.period / 500.0}
        period = (0.0, cycle.period)
        found = solve_ivp(lambda t, y: model.rhs(t, y, u), period, start, **accurate, **step)
        np.testing.assert_allclose(found.y[:, -1], start, atol=1e-6)


DRAGGED = pp.Chain(pp.Pipe(0.2, flow="aspirating", damping=0.01, drag=1.0), 3)


@pytest.mark.parametrize(
    ("model", "beyond", "rtol"),
    [(THREE, (1e-6, 2e-5), 1e-3), (THREE, (2e-5, 1e-3), 2e-2), (DRAGGED, (2e-5, 1e-3), 2e-2)],
)
def test_the_cycle_is_found_however_near_the_speed_is_to_the_onset(model, beyond, rtol):
    onset = pp.hopf(model)
    u = onset.speed * (1.0 + np.array([-1e-2, *beyond]))
    found = pp.bifurcation_diagram(model, u)
    assert found.failures == ()
    (branch,) = found.cycles
    for speed in u[1:]:
        (cycle,) = branch.at(speed)
        assert cycle.amplitude == pytest.approx(onset.amplitude(speed), rel=rtol)
        assert cycle.stable


@pytest.mark.parametrize("executor", [None, ThreadPoolExecutor])
def test_a_branch_that_two_onsets_lead_to_is_listed_once(executor):
    hose = pp.Pipe(0.2, 10.0, damping=1e-3, terms=[pp.PointMass(1.0, 0.2)])
    with executor(1) if executor else nullcontext() as pool:
        found = pp.bifurcation_diagram(pp.Galerkin(hose, 4), [5.3, 5.5], executor=pool)
    # Followed from the first onset, the cycles lead away beyond 6.9 and end in the last of three.
    assert len(pp.crossings(found.model, 8.2)) == 3
    (branch,) = found.cycles
    assert branch.onset == pytest.approx(pp.critical_speed(found.model).speed, rel=1e-9)
    assert [len(branch.at(u)) for u in found.speeds] == [1, 1]
    assert found.failures == ()


def test_a_branch_that_meets_a_known_one_ends_there():
    """From the onset eight steps lead up to 5.56; the second branch is followed down from 6."""
    found = pp.bifurcation_diagram(THREE, [4.7, 5.3, 5.5, 6.0], cycles=8, brute_force=1)
    assert [branch.origin for branch in found.cycles] == ["hopf", "motion"]
    assert [sum(len(b.at(u)) for b in found.cycles) for u in found.speeds] == [1, 1, 1, 1]


def test_cycles_of_bent_pipes_double_their_period():
    found = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2, -20.0), 2), [1.6, 1.65], cycles=12)
    points = [p.speed for b in found.equilibria for p in b.points if p.kind == "hopf"]
    bent = [b for b in found.cycles if b.origin == "hopf" and not b.cycles[0].symmetric]
    (branch,) = bent  # of two mirror images one
    assert branch.mirrored
    assert points.count(pytest.approx(branch.onset, rel=1e-9)) == 2
    doubling = next(event for event in branch.events if event.kind == "period doubling")
    assert doubling.multiplier == pytest.approx(-1.0, abs=1e-3)
    cycle = branch.cycles[0]
    assert cycle.tip[:, 0].min() * cycle.tip[:, 0].max() > 0.0  # on one side
    # Symmetric cycles cannot: their multipliers are squares of a real map's.
    symmetric = next(b for b in found.cycles if b.cycles[0].symmetric)
    assert "period doubling" not in events(symmetric)
    assert not symmetric.mirrored


# ---------------------------------------------------------------------- beyond the speeds, and back


@pytest.fixture(scope="module")
def returning():
    return pp.bifurcation_diagram(SUBCRITICAL, [6.3, 6.33], cycles=20)


def test_a_branch_that_leaves_the_speeds_and_comes_back_is_followed():
    (branch,) = pp.bifurcation_diagram(SUBCRITICAL, [6.25, 6.3], cycles=20).cycles
    assert branch.onset < 6.25
    cycles = branch.at(6.3)
    assert len(cycles) == 3
    alone = pp.limit_cycle(SUBCRITICAL, 6.3)
    assert alone.stable
    (same,) = [cycle for cycle in cycles if cycle.stable]
    assert same.amplitude == pytest.approx(alone.amplitude, rel=2e-6)
    assert same.amplitude == pytest.approx(0.5388, abs=1e-4)


def test_where_a_symmetric_branch_turns_is_a_fold_and_no_pitchfork(returning):
    branch = returning.cycles[0]
    (fold,) = [event for event in branch.events if event.kind == "fold"]
    assert fold.speed == pytest.approx(6.3161, abs=1e-4)
    assert fold.multiplier == pytest.approx(1.0, abs=1e-2)
    assert "pitchfork" not in events(branch)
    below = branch.at(6.3)
    assert sorted(cycle.amplitude < fold.amplitude for cycle in below) == [False, False, True]
    assert len(branch.at(6.33)) == 1
    # Near it neighbours diverge so fast that the branch's own meshes leave an error of 1.6e-4.
    assert max(cycle.multiplier_error for cycle in branch.cycles) < 1e-4


def test_a_motion_leaves_an_unstable_cycle_unless_the_search_ends_before(returning):
    """Beside the onset neighbours leave it by 0.8 % in each period: too slowly to be seen."""
    unstable = next(cycle for cycle in returning.cycles[0].at(6.3) if not cycle.stable)
    assert pp.limit_cycle(SUBCRITICAL, 6.3, unstable.y[:, 0]).stable
    onset = pp.hopf(SUBCRITICAL)
    beside = pp.limit_cycle(SUBCRITICAL, onset.speed * (1.0 - 1e-4), onset)
    found = pp.limit_cycle(SUBCRITICAL, beside.u, beside.y[:, 0])
    assert not found.stable
    assert found.amplitude == pytest.approx(beside.amplitude, rel=1e-6)


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((1.0, 1.0), []),
        ((0.0, 1.0, 1.0), [-0.5]),
        ((0.0, 1.0, -0.5), [1.0]),
        ((0.0, 0.75, -1.0, 1.0 / 3.0), [0.5, 1.5]),
        ((0.0, -0.36, 1.0, -1.0 / 3.0), [0.2, 1.8]),
        ((0.0, 0.99, -1.0, 1.0 / 3.0), [0.9, 1.1]),
        ((0.0, 1.2, -1.0, 1.0 / 3.0), []),
    ],
)
def test_a_step_may_hold_no_fold_or_one_or_two(coefficients, expected):
    """Over so long an interval that the branch seems straight, steps have the length 1."""
    equation = np.polynomial.Polynomial(coefficients)
    asked = {"derivative": lambda x, p: [[equation.deriv()(x[0]), -1.0]], "step": 1.0}
    branch = pp.continuation.follow(
        lambda x, p: equation(x) - p, [0.0], equation(0.0), (-300.0, 300.0), **asked
    )
    steps = np.abs(np.diff(branch.x[:, 0]))
    assert steps.max() == pytest.approx(1.0, abs=0.2)
    assert sorted(fold.x[0] for fold in branch.folds) == pytest.approx(expected, abs=1e-4)


# ------------------------------------------------------------------------ cycles that leave cycles


LEANING = pp.Chain(pp.Pipe(0.5, -20.0), 2)


@pytest.fixture(scope="module")
def leaving():
    return pp.bifurcation_diagram(
        LEANING, [1.7, 1.72, 1.73], cycles=8, brute_force=2, transient=80.0, duration=30.0
    )


def test_mirror_images_leave_a_cycle_at_a_pitchfork_and_motions_end_on_one(leaving):
    parent, child = leaving.cycles[:2]
    fork = next(event for event in parent.events if event.kind == "pitchfork")
    assert (parent.origin, child.origin) == ("hopf", "pitchfork")
    assert child.onset == fork.speed
    assert fork.multiplier == pytest.approx(1.0, abs=1e-3)
    assert fork.error < 1e-5
    assert child.mirrored
    # Stability passes over, and the square of what breaks the symmetry grows like u - onset.
    assert parent.at(1.7)[0].stable
    assert not parent.at(1.72)[0].stable
    (leant,) = child.at(1.72)
    assert leant.stable
    assert not leant.symmetric
    assert child.speeds[0] == pytest.approx(fork.speed, abs=2.0 * fork.error)
    assert child.amplitudes[0] == pytest.approx(child.highest[0], rel=1e-14)  # half of both peaks
    assert child.highest[0] == pytest.approx(fork.amplitude, rel=1e-5)
    assert child.stable[0]  # the multiplier that passes does not count
    uneven = (child.highest - child.amplitudes)[1:4] ** 2 / (child.speeds[1:4] - fork.speed)
    assert uneven == pytest.approx(uneven[0], rel=0.1)
    ended = [one for one in leaving.at(1.72) if one.ending == "periodic"]
    assert ended
    for one in ended:
        assert 0.5 * np.ptp(one.turnings) == pytest.approx(leant.amplitude, rel=1e-3)
        assert abs(one.turnings.max() + one.turnings.min()) > 0.01


def test_a_cycle_of_twice_the_period_leaves_at_a_doubling_and_motions_end_on_it(leaving):
    _, child, doubled = leaving.cycles[:3]
    event = next(event for event in child.events if event.kind == "period doubling")
    assert doubled.origin == "period doubling"
    assert doubled.onset == event.speed
    assert event.multiplier == pytest.approx(-1.0, abs=1e-3)
    once, twice = child.at(1.73)[0], doubled.at(1.73)[0]
    assert not once.stable
    assert twice.stable
    assert twice.period / once.period == pytest.approx(2.0, rel=0.05)
    assert doubled.cycles[0].period / once.period == pytest.approx(2.0, rel=0.05)
    ended = [one for one in leaving.at(1.73) if one.ending == "periodic"]
    assert ended
    for one in ended:
        assert one.period == 2
        assert 0.5 * np.ptp(one.turnings) == pytest.approx(twice.amplitude, rel=1e-3)


def test_a_cycle_that_no_onset_leads_to_is_followed_from_a_motion():
    model = pp.Chain(pp.Pipe(0.5, -30.0), 2)
    found = pp.bifurcation_diagram(
        model, [4.4, 4.6], cycles=16, brute_force=1, transient=60.0, duration=20.0
    )
    (branch,) = found.cycles
    assert branch.origin == "motion"
    assert math.isnan(branch.onset)
    assert branch.stable.all()
    for u in found.speeds:
        (one,) = found.at(u)
        (cycle,) = branch.at(u)
        assert 0.5 * np.ptp(one.turnings) == pytest.approx(cycle.amplitude, rel=1e-3)


def test_where_no_onset_leads_to_cycles_a_motion_finds_one():
    model = pp.Chain(pp.Pipe(0.2, drag=3.0, flow="aspirating"), 3)
    found = pp.bifurcation_diagram(model, [0.3, 0.35], cycles=4)
    branch = found.cycles[0]
    assert branch.origin == "motion"
    (cycle,) = branch.at(0.3)
    assert cycle.amplitude == pytest.approx(pp.limit_cycle(model, 0.3).amplitude, rel=1e-5)


def test_where_motions_wind_up_without_end_no_cycle_is_said_to_be_found():
    model = pp.Chain(pp.Pipe(0.3, flow="aspirating"), 2)
    found = pp.bifurcation_diagram(model, [1.0, 2.0])
    assert found.cycles == ()
    assert [(f.index, f.value) for f in found.failures] == [(0, 1.0), (1, 2.0)]
    assert all(isinstance(f.error, pp.NoCycle) for f in found.failures)


JET = pp.Chain(pp.Pipe(0.3, 10.0, jet_angle=0.4, damping=0.005), 3)


def test_what_takes_a_small_share_of_the_speeds_is_left_out_and_named():
    found = pp.bifurcation_diagram(SUBCRITICAL, [1.0, 1000.0])
    (branch,) = found.cycles
    assert len(branch) < 40
    assert events(branch)[-1] == "end"
    assert events(branch).count("pitchfork") == 2  # what begins there is left out
    (failure,) = (f for f in found.failures if "it has wound within" in str(f.error))
    assert branch.speeds.min() < failure.value < branch.speeds.max()


@pytest.mark.slow
def test_what_is_narrower_than_the_speeds_show_is_left_out_and_named():
    """The third generation at 6.96823, and folds without end near a homoclinic orbit at 8.68."""
    found = pp.bifurcation_diagram(JET, [6.0, 6.97])
    onsets = np.array([b.onset for b in found.cycles if b.origin == "period doubling"])
    assert np.abs(onsets - 6.96487).min() < 1e-4
    assert np.abs(onsets - 6.96823).min() > 1e-3
    found = pp.bifurcation_diagram(JET, [8.3, 8.9])
    (winding,) = (b for b in found.cycles if abs(b.onset - 8.674173) < 1e-4)
    assert len(winding) < 80
    assert winding.events[-1].kind == "end"
    met = [event for branch in found.cycles for event in branch.events]
    assert {"fold", "period doubling", "torus"} <= {event.kind for event in met}
    for event in met:  # none of these cycles is symmetric
        assert event.kind != "pitchfork"
        if event.kind == "torus":
            assert abs(event.multiplier) == pytest.approx(1.0)
            assert abs(event.multiplier.imag) > 0.1
        else:
            beginning = event.kind == "period doubling" and event.multiplier != -1.0
            assert (
                event.multiplier == (-1.0 if event.kind == "period doubling" else 1.0) or beginning
            )
    (failure,) = (f for f in found.failures if "it has wound within" in str(f.error))
    assert failure.value == pytest.approx(8.6785, abs=1e-3)


# ------------------------------------------------------------------------------------- machinery


def test_branches_on_an_executor_are_the_same(terminal):
    speeds = [4.0, 5.0]
    alone = pp.bifurcation_diagram(THREE, speeds)
    with ProcessPoolExecutor(1) as executor:
        again = pp.bifurcation_diagram(THREE, speeds, executor=executor, progress=True)
    assert "cycles" in terminal.readouterr().err
    np.testing.assert_array_equal(again.cycles[0].speeds, alone.cycles[0].speeds)
    np.testing.assert_array_equal(again.cycles[0].amplitudes, alone.cycles[0].amplitudes)


def test_a_speed_that_fails_is_marked_and_the_others_kept():
    class Broken(pp.Chain):
        """At one speed it answers for few states at a time."""

        def motion_rates(self, y, u, *given):
            if y.shape[-1] > 8 and math.isclose(u, 4.8, rel_tol=1e-12):
                raise pp.NotConverged("not there")
            return super().motion_rates(y, u, *given)

    found = pp.bifurcation_diagram(Broken(THREE.pipe, 3), [4.0, 4.7, 4.8, 4.9])
    assert {f.index for f in found.failures} == {2}
    assert {f.value for f in found.failures} == {4.8}
    (branch,) = found.cycles
    assert branch.at(4.8) == ()
    assert len(branch.at(4.7)) == len(branch.at(4.9)) == 1


def test_an_onset_that_fails_is_marked_and_the_equilibria_kept():
    model = pp.Chain(pp.Pipe(0.0, drag=1.0), 3)
    found = pp.bifurcation_diagram(model, [3.3, 4.1], cycles=26)
    (branch,) = found.cycles
    assert branch.origin == "motion"
    assert branch.at(4.1)[0].amplitude == pytest.approx(pp.limit_cycle(model, 4.1).amplitude)
    assert len(found.equilibria) == 1
    (failure,) = found.failures
    assert failure.value == pytest.approx(pp.critical_speed(model).speed)
    assert "two pairs meet" in str(failure.error)


def test_a_branch_ends_where_its_steps_run_out():
    found = pp.bifurcation_diagram(THREE, [4.0, 4.7, 5.5], cycles=3)
    branch = found.cycles[0]
    assert events(branch) == ["hopf", "end"]
    assert branch.speeds.max() < 4.7
    failure = found.failures[0]
    assert (failure.index, failure.value) == (-1, pytest.approx(branch.events[-1].speed))
    assert "steps ran out" in str(failure.error)


def test_an_event_is_compared_with_events_only(three):
    with pytest.raises(TypeError, match="other must be a CycleEvent"):
        three.cycles[0].events[0].same(three)


def test_no_cycles_are_sought_where_none_are_asked_for():
    found = pp.bifurcation_diagram(THREE, [4.0, 5.0], cycles=0)
    assert found.cycles == found.at(4.0) == ()


@pytest.mark.slow
def test_a_step_beyond_a_meeting_of_branches_leaves_the_diagram():
    """From a motion beside a period doubling a branch began that no meeting could be found on."""
    pipe = pp.Pipe(0.313591587301, gamma=-10.0, jet_angle=-0.478597799288)
    model, u = pp.Chain(pipe, 3), 5.113592052618494
    asked = {"brute_force": 4, "transient": 30.0, "duration": 15.0}
    found = pp.bifurcation_diagram(model, [u - 0.05, u, u + 0.05], **asked)
    assert [len(found.at(speed)) for speed in found.speeds] == [4, 4, 4]
    (cycle,) = (one for branch in found.cycles for one in branch.at(u))
    assert cycle.stable
    assert cycle.period == pytest.approx(0.65930, abs=1e-5)
