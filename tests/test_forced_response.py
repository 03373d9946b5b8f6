# SPDX-License-Identifier: MIT
"""Periodic motions of finite amplitude under a moving base or a pulsating flow.

They are held against motions that are integrated until they repeat, and numbers of a separate
program that does so.
"""

import math
import re

import numpy as np
import pytest
import scipy.optimize
from test_driven_motion import PULSATING, SHAKEN, SUBHARMONIC

import pipedyn as pp
from pipedyn.forced import forced_response
from pipedyn.orbits.orbit_continuation import solved_anew


@pytest.mark.parametrize(("m", "amplitude"), [(4, 0.1462570), (6, 0.1633365), (8, 0.1634670)])
def test_a_moving_base_at_finite_amplitude(m, amplitude):
    """u = 5, X = 0.02, frequency 13.5: a separate program integrates to the digits given."""
    model = pp.Galerkin(SHAKEN, m, "legendre")
    found = pp.forced_response(model, 5.0, base=pp.Harmonic(0.02, 13.5))
    (motion,) = found.at(13.5)
    assert motion.amplitude == pytest.approx(amplitude, abs=1e-6)
    assert motion.stable
    assert motion.error <= 1e-6
    assert motion.period == pytest.approx(2.0 * math.pi / 13.5, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "amplitude"),
    [SUBHARMONIC[0], *(pytest.param(*one, marks=pytest.mark.slow) for one in SUBHARMONIC[1:3])],
    ids=["m=4", "m=6", "n=10"],
)
def test_a_pulsating_flow_at_finite_amplitude(make, amplitude):
    """Mean 6, amplitude 0.3, frequency 30: a separate program integrates to the digits given."""
    model = make(PULSATING)
    found = pp.forced_response(model, pp.Pulsation(6.0, 0.3, 30.0), frequencies=(30.0, 30.5))
    (motion,) = found.at(30.0)
    assert motion.amplitude == pytest.approx(amplitude, abs=1e-6)
    assert motion.stable
    assert motion.period == pytest.approx(4.0 * math.pi / 30.0, rel=1e-12)


def test_motions_are_those_that_simulations_end_on():
    model = pp.Chain(SHAKEN, 5)
    base = pp.Harmonic(0.03, 12.0)
    (motion,) = pp.forced_response(model, 5.0, base=base).at(12.0)
    start = motion.q[0], motion.qdot[0]
    going = pp.simulate(
        model, 5.0, motion.period, *start, base=base, rtol=1e-10, samples=motion.t.size
    )
    np.testing.assert_allclose(going.q, motion.q, atol=1e-7)
    far = pp.simulate(model, 5.0, 40.0 * motion.period, 0.0 * start[0], base=base, samples=11)
    np.testing.assert_allclose(far.q[-1], motion.q[0], atol=1e-5)


def test_subharmonic_motions_are_those_that_simulations_keep():
    model, flow = pp.Chain(PULSATING, 5), pp.Pulsation(6.0, 0.3, 28.0)
    (motion,) = pp.forced_response(model, flow).at(28.0)
    going = pp.simulate(
        model, flow, motion.period, motion.q[0], motion.qdot[0], rtol=1e-10, samples=motion.t.size
    )
    np.testing.assert_allclose(going.q, motion.q, atol=1e-7)
    np.testing.assert_allclose(going.tip_velocity, motion.tip_velocity, atol=1e-5)
    assert (motion.u.mean, motion.u.amplitude) == (6.0, 0.3)
    assert motion.u.frequency == pytest.approx(28.0, rel=1e-12)
    half = motion.t.size // 2
    np.testing.assert_allclose(motion.q[half], -motion.q[0], atol=1e-9)


def test_small_motions_of_the_base_have_the_linear_response():
    model = pp.Galerkin(SHAKEN, 4, "legendre")
    for omega in (6.0, 14.0):
        linear = pp.frequency_response(model, 5.0, [omega]).response[0]
        (motion,) = pp.forced_response(model, 5.0, base=pp.Harmonic(1e-4, omega)).at(omega)
        assert motion.amplitude == pytest.approx(1e-4 * abs(linear), rel=1e-5)


def test_a_resonance_bends_over_and_has_three_motions_between_its_folds():
    """Without flow, near the second mode, whose frequency falls as its amplitude grows."""
    model = pp.Galerkin(SHAKEN, 3, "legendre")
    found = pp.forced_response(model, 0.0, base=pp.Harmonic(0.02, 20.0), frequencies=(15.0, 26.0))
    (branch,) = found.branches
    folds = [event for event in branch.events if event.kind == "fold"]
    assert len(folds) == 2
    between = 0.5 * (folds[0].frequency + folds[1].frequency)
    assert sorted(motion.stable for motion in found.at(between)) == [False, True, True]
    assert len(found.at(0.98 * min(fold.frequency for fold in folds))) == 1
    assert len(found.at(1.02 * max(fold.frequency for fold in folds))) == 1


def test_branches_lead_from_edge_to_edge_of_a_parametric_region():
    model = pp.Galerkin(PULSATING, 4, "legendre")
    found = pp.forced_response(model, pp.Pulsation(6.0, 0.2, 30.0), frequencies=(28.0, 32.0))
    (branch,) = found.branches
    (region,) = pp.parametric_regions(model, 6.0, 0.2, (28.0, 32.0))
    assert branch.kind == "subharmonic"
    assert branch.frequency[0] == pytest.approx(region.edges[0, 0], rel=1e-6)
    assert branch.frequency[-1] == pytest.approx(region.edges[0, 1], rel=1e-6)
    assert branch.stable[1:-1].all()


RESTING = [
    (pp.Galerkin(PULSATING, 4), (6.0, 0.3), (24.0, 40.0), "subharmonic", 38.27192),
    (pp.Chain(pp.Pipe(0.242, 30.0, damping=2.7e-3), 4), (7.0, 0.26), (22.0, 40.0), "harmonic", 0.0),
    (pp.Chain(pp.Pipe(0.577, damping=2.8e-3), 3), (5.7, 0.2), (15.0, 27.0), "subharmonic", 0.0),
]


@pytest.mark.parametrize(
    ("model", "flow", "range_", "kind", "known"),
    [*RESTING[:2], pytest.param(*RESTING[2], marks=pytest.mark.slow)],
)
def test_branches_that_come_back_to_rest_lose_no_motion(model, flow, range_, kind, known):
    """The edge is where a multiplier that is integrated for the straight pipe passes 1 or -1.

    The number is of a separate program. Near an edge amplitudes grow like the square root of the
    distance from it.
    """

    def growing(frequency):
        way = 1.0 if kind == "harmonic" else -1.0
        multipliers = pp.floquet(model, pp.Pulsation(*flow, frequency)).multipliers
        real = multipliers[np.abs(multipliers.imag) < 1e-9].real
        return np.count_nonzero(way * real > 1.0)

    found = pp.forced_response(model, pp.Pulsation(*flow, range_[0]), frequencies=range_)
    (branch,) = (one for one in found.branches if one.kind == kind)
    (*_, before, end), ends = branch.frequency, branch.amplitude[-2:]
    assert 0.0 < ends[0] < 0.011
    assert ends[1] == 0.0
    assert abs(growing(end * (1.0 - 1e-5)) - growing(end * (1.0 + 1e-5))) == 1
    if known:
        assert end == pytest.approx(known, rel=1e-6)
    for share in (0.1, 0.5, 0.9, 0.99):
        (motion,) = branch.at(before + share * (end - before))
        assert motion.amplitude == pytest.approx(ends[0] * math.sqrt(1.0 - share), rel=2e-2)
    places = branch.frequency[-3:-1].tolist()
    assert len(branch.at(np.mean(places))) == 1


def test_a_small_motion_near_the_end_of_a_branch_is_what_simulations_end_on():
    model, flow = RESTING[0][0], pp.Pulsation(6.0, 0.3, 38.25)
    (motion,) = pp.forced_response(model, flow, frequencies=(24.0, 40.0)).at(38.25)
    assert motion.amplitude == pytest.approx(0.0515, rel=5e-3)
    assert motion.stable
    start = 1.3 * motion.q[0], 1.3 * motion.qdot[0]
    settled = pp.simulate(model, flow, 200.0 * motion.period, *start, samples=2)
    last = pp.simulate(model, flow, motion.period, settled.q[-1], settled.qdot[-1], samples=65)
    assert 0.5 * np.ptp(last.tip[:, 0]) == pytest.approx(motion.amplitude, rel=1e-2)


@pytest.mark.parametrize(
    "make",
    [lambda p: pp.Chain(p, 4), lambda p: pp.Galerkin(p, 4), lambda p: pp.modular.chain(p, 4)],
)
def test_a_pipe_that_rests_bent_moves_about_its_rest(make):
    model = make(pp.Pipe(0.2, damping=0.01, jet_angle=0.3))
    bent = model.about(pp.equilibria(model, 2.0).q[0])
    linear = abs(pp.frequency_response(bent, 2.0, [6.0]).response[0])
    for amplitude in (1e-4, 0.05):
        base = pp.Harmonic(amplitude, 6.0)
        (motion,) = pp.forced_response(bent, 2.0, base=base).at(6.0)
        assert motion.amplitude == pytest.approx(amplitude * linear, rel=1e-5 + 4.0 * amplitude**2)
        going = pp.simulate(
            *(model, 2.0, motion.period, motion.q[0], motion.qdot[0]),
            **{"base": base, "rtol": 1e-10, "samples": motion.t.size},
        )
        np.testing.assert_allclose(going.q, motion.q, atol=1e-9)
    for ask in (
        lambda: pp.floquet(bent, pp.Pulsation(2.0, 0.1, 3.0)),
        lambda: pp.parametric_regions(bent, 2.0, 0.1, (3.0, 9.0)),
        lambda: pp.forced_response(bent, pp.Pulsation(2.0, 0.1, 3.0)),
    ):
        with pytest.raises(ValueError, match=r"^model must be of a pipe that rests straight where"):
            ask()


def test_a_range_of_frequencies_may_be_a_list_or_an_array():
    base, model = pp.Harmonic(0.01, 5.0), pp.Galerkin(SHAKEN, 2)
    expected, *others = (
        pp.forced_response(model, 2.0, base=base, frequencies=given).branches[0]
        for given in ((5.0, 5.5), [5.0, 5.5], np.array([5.0, 5.2, 5.5]))
    )
    for found in others:
        np.testing.assert_array_equal(found.frequency, expected.frequency)


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (pp.Chain(pp.Pipe(0.2), 4), 0.0),
        (pp.Galerkin(pp.Pipe(0.2), 3), 0.0),
        (pp.Chain(pp.Pipe(0.0), 4), 1.0),
    ],
    ids=["chain", "reduced", "no fluid's inertia"],
)
def test_without_damping_motions_are_neutral_and_nothing_passes_the_unit_circle(model, u):
    found = pp.forced_response(model, u, base=pp.Harmonic(0.01, 5.0), frequencies=(5.0, 12.0))
    (branch,) = found.branches
    assert [event.kind for event in branch.events] == ["end"]
    assert branch.stable.all()
    np.testing.assert_allclose(branch.largest, 1.0, atol=1e-6)
    (motion,) = found.at(9.0)
    assert motion.stable
    np.testing.assert_allclose(np.abs(motion.multipliers), 1.0, atol=1e-9)


def test_without_damping_two_pairs_that_meet_leave_the_circle():
    """Then each multiplier has its inverse: the pipe's equations are reversible."""
    model = pp.Galerkin(pp.Pipe(0.2), 2, "legendre")
    base = pp.Harmonic(0.05, 18.5)
    found = pp.forced_response(model, 0.0, base=base, frequencies=(18.5, 19.5))
    events = [event for event in found.branches[0].events if event.kind != "end"]
    assert [event.kind for event in events] == ["torus", "torus"]
    first, last = (event.frequency for event in events)
    (before,), (between,), (beyond,) = (
        found.at(w) for w in (first - 0.02, 0.5 * (first + last), last + 0.02)
    )
    assert (before.stable, between.stable, beyond.stable) == (True, False, True)
    sizes = np.abs(between.multipliers)
    np.testing.assert_allclose(sizes[0] * sizes[-1], 1.0, rtol=1e-8)
    assert sizes[0] > 1.01


def test_without_damping_what_leaves_the_circle_gradually_is_no_event():
    """A multiplier does so near 15.998, by less than its error."""
    model, base = pp.Chain(pp.Pipe(0.0, end="pinned"), 4), pp.Harmonic(0.05, 12.0)
    (branch,) = pp.forced_response(model, 1.5, base=base, frequencies=(14.8, 16.0)).branches
    assert [event.kind for event in branch.events] == ["pitchfork", "end"]


def test_an_axially_fixed_pipe_on_a_shaker_is_duffings_oscillator():
    """w = a sin pi s: a'' + d (1 + K a^2 / 2) a' + pi^4 (a + K a^3 / 4) = (4 / pi) X omega^2 cos.

    d = delta pi^4.

    Holmes, J. Sound Vib. 53 (1977), 471. It is solved in its harmonics 1, 3 and 5 here; what
    bends the pipe at large angles is besides of the order of 10 / K.
    """
    axial, damping, reach, omega = 1e3, 0.01, 0.01, 15.0
    pipe = pp.Pipe(
        *(0.2,), damping=damping, root="pinned", end="pinned", terms=[pp.Stretching(axial)]
    )
    phases = 2.0 * np.pi * np.arange(32) / 32.0
    turns = np.exp(1j * phases[:, None] * np.array([1.0, 3.0, 5.0]))

    def missed(parts):
        x = parts[:3] + 1j * parts[3:]
        a = (turns @ x).real
        w = omega * np.array([1.0, 3.0, 5.0])
        rate = (turns @ (1j * w * x)).real
        bent = axial * (0.25 * a**3 + 0.5 * damping * a**2 * rate)
        left = (np.pi**4 - w**2 + 1j * w * damping * np.pi**4) * x
        left += np.pi**4 * turns.conj().T @ bent / 16.0
        left[0] -= 4.0 / np.pi * reach * omega**2
        return np.concatenate([left.real, left.imag])

    def largest(start):
        found = scipy.optimize.root(missed, [start, 0.0, 0.0, 0.0, 0.0, 0.0], tol=1e-12)
        assert found.success
        fine = np.exp(1j * np.linspace(0.0, 2 * np.pi, 4001)[:, None] * np.array([1.0, 3.0, 5.0]))
        return float(np.abs((fine @ (found.x[:3] + 1j * found.x[3:])).real).max())

    model = pp.Galerkin(pipe, 3)
    found = pp.forced_response(model, 0.0, base=pp.Harmonic(reach, omega), frequencies=(8.0, 16.5))
    motions = found.at(omega)
    assert [motion.stable for motion in motions] == [True, False, True]
    sine = math.sin(math.pi * pipe.tip_place)
    for motion, start in ((motions[0], 0.08), (motions[2], -0.02)):
        assert motion.amplitude == pytest.approx(sine * largest(start), rel=1e-2)
    assert motions[0].amplitude > 2.0 * motions[2].amplitude


STOPPED = pp.Chain(pp.Pipe(0.2, damping=0.01, terms=(pp.Stop(0.8, 0.01, 1000.0),)), 4)


def test_a_pipe_that_strikes_a_stop_is_followed_from_where_its_motion_ends():
    """Its linear response, without the stop, is far from any motion."""
    base = pp.Harmonic(0.05, 2.02)
    found = pp.forced_response(STOPPED, 2.0, base=base, frequencies=(2.0, 2.05))
    assert not found.failures
    (motion,) = found.at(2.02)
    going = pp.simulate(
        *(STOPPED, 2.0, 10.0 * motion.period, motion.q[0], motion.qdot[0]),
        **{"base": base, "rtol": 1e-9, "times": np.linspace(9.0, 10.0, 257) * motion.period},
    )
    assert motion.amplitude == pytest.approx(0.5 * np.ptp(going.tip[:, 0]), rel=1e-5)


def test_an_unstable_motion_of_a_strong_base_is_reached_from_those_of_weaker_ones(monkeypatch):
    """Newton's method fails from the linear response, and motions from rest do not settle."""
    sizes = []

    def solved(*given):
        orbit = solved_anew(*given)
        sizes.append(orbit.size)
        return orbit

    monkeypatch.setattr(forced_response, "solved_anew", solved)
    pipe = pp.Pipe(0.16, 10.0, damping=0.001, root="pinned", end="pinned")
    model, base = pp.Galerkin(pipe, 3, "legendre"), pp.Harmonic(0.4, 19.2)
    (motion,) = pp.forced_response(model, 0.8, base=base, frequencies=(19.2, 19.21)).at(19.2)
    assert not motion.stable
    start = {"q0": motion.q[0], "qdot0": motion.qdot[0], "base": base, "rtol": 1e-10}
    going = pp.simulate(model, 0.8, motion.period, **start, samples=motion.t.size)
    np.testing.assert_allclose(going.q, motion.q, atol=1e-8)
    # A fiftieth of the base moves the pipe as linear theory says, by as much less.
    assert sizes[0] == pytest.approx(0.1992, rel=0.01)
    assert np.all(np.diff(sizes) > -1e-9)  # the same on finer meshes
    assert sizes[-1] > 20.0 * sizes[0]


def test_small_motions_that_a_fixed_end_bends_over_are_followed_past_their_folds():
    """A resonance of 0.003 L: steps are measured by the motion and not by the pipe."""
    pipe = pp.Pipe(0.2, damping=0.01, root="pinned", end="pinned", terms=[pp.Stretching(1e5)])
    base = pp.Harmonic(3e-4, 9.0)
    found = pp.forced_response(pp.Galerkin(pipe, 2), 0.0, base=base, frequencies=(9.0, 12.0))
    (branch,) = found.branches
    assert [event.kind for event in branch.events] == ["fold", "fold", "end"]
    assert not found.failures
    first, last = (event.frequency for event in branch.events[:2])
    assert [m.stable for m in found.at(0.5 * (first + last))] == [True, False, True]


def test_a_branch_that_is_lost_says_where_and_why():
    """Without damping a segment turns over near its frequency 6^(1/2), from either side of it."""
    base, model = pp.Harmonic(0.1, 2.2), pp.Chain(pp.Pipe(0.2, flow="aspirating"), 1)
    found = pp.forced_response(model, 0.0, base=base, frequencies=(2.3, 2.6))
    assert [branch.kind for branch in found.branches] == ["base", "base"]
    assert [failure.index for failure in found.failures] == [0, 1]
    for branch, failure in zip(found.branches, found.failures, strict=True):
        assert failure.error is branch.failure
        assert failure.value == branch.frequency[-1] == branch.events[-1].frequency
        rule = rf"the base branch was lost at a frequency of {failure.value:.6g}, .* not converge"
        assert re.match(rule, str(failure.error))
    assert found.branches[0].frequency[-1] < 2.45 < found.branches[1].frequency[-1]
    with pytest.raises(pp.NotConverged, match="no motion is known at a frequency of 4: the base"):
        found.at(4.0)
    (motion,) = found.at(2.301)
    assert motion.stable


@pytest.mark.slow
def test_a_bad_step_elsewhere_hides_no_motion():
    """Between the folds of one step of another branch Newton's method fails."""
    damper = pp.Damper(at=0.944190922777, coefficient=0.0462866150038)
    pipe = pp.Pipe(
        0.623138405042, drag=0.176526630138, terms=[damper], root=pp.RootSpring(25.916316265)
    )
    flow = pp.Pulsation(7.3270389068480775, 0.5433834963687468, 1.0)
    found = pp.forced_response(pp.Chain(pipe, 8), flow, frequencies=(14.0065, 35.0163))
    motion = found.at(32.554)[0]
    start = {"q0": motion.q[0], "qdot0": motion.qdot[0], "rtol": 1e-10}
    pulsating = pp.Pulsation(flow.mean, flow.amplitude, 32.554)
    going = pp.simulate(pp.Chain(pipe, 8), pulsating, motion.period, **start, samples=3)
    np.testing.assert_allclose(going.q[-1], motion.q[0], atol=1e-7)


def test_where_no_motion_is_found_the_reason_and_what_to_change_are_told():
    """Without damping a motion from rest keeps all that it was given at the start."""
    rule = (
        "no periodic motion was found to begin with: at a frequency of 7 a motion from rest "
        "leads to none: it was not found to repeat with the base; at a frequency of 7.1 .* "
        "Give other frequencies.* or a smaller amplitude"
    )
    model, base = pp.Chain(pp.Pipe(0.54, flow="aspirating"), 2), pp.Harmonic(0.8, 7.0)
    with pytest.raises(pp.NotConverged, match=rule):
        pp.forced_response(model, 0.0, base=base, frequencies=(7.0, 7.1))


MODEL, BASE = pp.Galerkin(SHAKEN, 3), pp.Harmonic(0.1, 3.0)
PULSE, RANGE = pp.Pulsation(5.0, 0.1, 3.0), "frequencies must be a range (low, high), low < high"


@pytest.mark.parametrize(
    ("given", "error", "rule"),
    [
        ({}, TypeError, "base must be a Harmonic or u a Pulsation, got None"),
        ({"base": pp.Harmonic(0.0, 3.0)}, ValueError, "base must move, got an amplitude of 0"),
        ({"base": pp.Harmonic(0.1, 3.0, "z")}, ValueError, "base must stay in the plane of x and"),
        ({"u": pp.Pulsation(5.0, 0.0, 3.0)}, ValueError, "u.amplitude must be between 0 and 1"),
        ({"u": PULSE, "base": BASE}, ValueError, "base must not be given where the flow pulsates"),
        ({"base": BASE, "frequencies": (0.0, 3.0)}, ValueError, "frequencies must have low > 0"),
        ({"base": BASE, "frequencies": [3.0]}, ValueError, f"{RANGE}, got [3.0]"),
        ({"base": BASE, "frequencies": np.array([3.0, 1.0])}, ValueError, RANGE),
        ({"model": pp.Chain(SHAKEN, 80)}, ValueError, "model must have at most 60"),
        ({"model": pp.Continuum(SHAKEN)}, TypeError, "model must be"),
        ({"u": pp.Pulsation(9.0, 0.1, 30.0)}, ValueError, "mean must be a speed at which"),
    ],
)
def test_bad_arguments_are_named(given, error, rule):
    arguments = {"model": MODEL, "u": 5.0} | given
    with pytest.raises(error) as refused:
        pp.forced_response(arguments.pop("model"), arguments.pop("u"), **arguments)
    assert str(refused.value).startswith(rule)


def test_progress_counts_steps_whose_number_nobody_knows(terminal):
    found = pp.forced_response(
        pp.Chain(pp.Pipe(0.2, damping=0.01), 2),
        1.0,
        base=pp.Harmonic(0.01, 10.0),
        frequencies=(9.0, 11.0),
        progress=True,
    )
    told = terminal.readouterr().err.split("\r")[-1]
    steps = len(found.branches[0].steps) - 1  # the last ends it
    assert told.startswith(f"forced response: 100 %, {steps} steps, took ")


@pytest.mark.parametrize(
    ("end", "touching"), [(27.0, 1), pytest.param(30.0, 2, marks=pytest.mark.slow)]
)
def test_a_branch_goes_on_where_its_motion_begins_to_touch_a_stop(end, touching):
    """The stop stands still while the base moves, so that what touches is both together."""
    stop = pp.Stop(1.0, 0.08, 1e4)
    model = pp.Chain(pp.Pipe(0.05, 10.0, damping=0.002, terms=(stop,)), 4)
    shaken = pp.Harmonic(0.02, 9.0, "x")
    found = pp.forced_response(model, 1.0, base=shaken, frequencies=(21.0, end))
    (branch,) = found.branches
    assert branch.failure is None
    grazing = next(event for event in branch.events if event.kind == "grazing")
    assert grazing.frequency == pytest.approx(22.785, abs=1e-3)
    motions = *_, still = found.at(23.0)
    reach = [np.abs(one.tip[:, 0] + 0.02 * np.cos(23.0 * one.t)).max() for one in motions]
    assert [x > 0.08 for x in reach] == [*[True] * touching, False]
    assert still.stable
    late = np.linspace(120.0, 124.0, 2001) * 2.0 * np.pi / 23.0
    motion = pp.simulate(
        *(model, 1.0, late[-1], 1.01 * still.q[0], still.qdot[0]),
        base=pp.Harmonic(0.02, 23.0, "x"),
        times=late,
    )
    assert 0.5 * np.ptp(motion.tip[:, 0]) == pytest.approx(still.amplitude, rel=1e-3)
