# SPDX-License-Identifier: MIT
"""Limit cycles: against long simulations, energy, symmetry and one another."""

import pickle
from functools import cache

import numpy as np
import pytest
import scipy.integrate

import pipedyn as pp
from pipedyn.orbits import floquet
from pipedyn.orbits.collocation import collocation_maps

PIPE = pp.Pipe(0.2)
TWO, THREE = pp.Chain(PIPE, 2), pp.Chain(PIPE, 3)
ROM, FINER, FINEST = (pp.Galerkin(PIPE, m, "legendre") for m in (8, 12, 14))
REPELLING = pp.Chain(pp.Pipe(0.2, damping=0.01), 3)
"""Beyond u = 14 its cycle repels some motions a million times within a period."""

GROWING = pp.Chain(pp.Pipe(0.3, damping=1e-3), 3)
SUBCRITICAL = pp.Chain(pp.Pipe(0.05), 2)
ASPIRATING = pp.Pipe(0.2, flow="aspirating", damping=0.01)


def heavy(mass, gamma=1.5):
    """A chain with a heavy nozzle, whose first mode is slow."""
    return pp.Chain(pp.Pipe(0.35, gamma, damping=0.1, terms=(pp.PointMass(1.0, mass),)), 2)


def bow(s):
    return 0.3 * s * (2.0 - s)


limit_cycle = cache(pp.limit_cycle)
"""For cycles that several tests look at; of the same model object."""


@pytest.fixture(scope="module")
def known():
    return limit_cycle(ROM, 6.0)


# ------------------------------------------------------------------------------ known values


def test_the_continuous_pipes_cycle_is_the_known_one(known):
    # 0.276611 and 13.79155 are this model's, of 8 functions; more functions end at 0.276614 and
    # 13.79150, as another program's 0.27661 and 13.7913 also allow.
    assert known.amplitude == pytest.approx(0.276611, abs=5e-7)
    assert known.frequency == pytest.approx(13.79155, abs=5e-6)
    assert known.period == pytest.approx(2.0 * np.pi / known.frequency, rel=1e-15)
    assert known.stable
    assert known.error < 1e-6
    assert known.residual < 1e-7  # of accelerations between the stages
    damped = pp.limit_cycle(pp.Galerkin(pp.Pipe(0.2, damping=1e-3), 8, "legendre"), 6.0)
    assert damped.amplitude == pytest.approx(0.262918, abs=5e-7)
    assert damped.frequency == pytest.approx(13.6969, abs=5e-5)


def test_more_functions_do_not_change_the_cycle(known):
    finer, finest = (limit_cycle(model, 6.0) for model in (FINER, FINEST))
    assert finer.amplitude == pytest.approx(finest.amplitude, rel=2e-8)
    assert finer.frequency == pytest.approx(finest.frequency, rel=1e-8)
    assert known.amplitude == pytest.approx(finest.amplitude, rel=2e-5)
    assert known.frequency == pytest.approx(finest.frequency, rel=5e-6)
    assert finest.amplitude == pytest.approx(0.276614006, abs=1e-8)
    beams = [
        abs(pp.limit_cycle(pp.Galerkin(PIPE, m), 6.0).amplitude - finer.amplitude)
        for m in (2, 4, 8)
    ]
    assert beams[0] > 4 * beams[1] > 16 * beams[2]
    assert beams[2] < 5e-4


# --------------------------------------------------------------------- what a cycle has to be

SCENES = {
    "ejecting": (pp.Galerkin(PIPE, 6), 6.0),
    "hanging, damped": (pp.Chain(pp.Pipe(0.4, gamma=10.0, damping=2e-3), 6), 9.5),
    "standing": (pp.Galerkin(pp.Pipe(0.2, gamma=-10.0), 6, "legendre"), 5.0),
    "aspirating": (pp.Chain(ASPIRATING, 6), 0.0689),
    "aspirating, reduced": (pp.Galerkin(ASPIRATING, 6, "legendre"), 0.0692),
    "drag": (pp.Chain(pp.Pipe(0.2, drag=1.0), 6), 6.0),
    "drag, reduced": (pp.Galerkin(pp.Pipe(0.2, drag=1.0), 6, "legendre"), 6.0),
    "aspirating, drag": (pp.Chain(pp.Pipe(0.2, flow="aspirating", drag=2.0, damping=0.01), 4), 0.2),
    "scene": (pp.modular.chain(PIPE, n=4).plus(pp.PointMass(at=1.0, mass=0.1)), 4.0),
    "guided": (pp.modular.chain(PIPE, n=4).plus(pp.modular.Guide(node=1)), 6.5),
    "unstable": (pp.Chain(pp.Pipe(0.8), 4), 8.2),
    "large": (TWO, 6.0),
}


@pytest.mark.parametrize("scene", SCENES)
def test_a_cycle_closes_balances_its_energy_and_is_its_own_mirror_image(scene):
    model, u = SCENES[scene]
    cycle = limit_cycle(model, u)
    tip = cycle.tip[:, 0]
    assert cycle.multiplier_error < 1e-6
    assert np.abs(cycle.multipliers - 1.0).min() < 1e-6
    assert cycle.multipliers.size == 2 * model.dof
    assert (np.diff(np.abs(cycle.multipliers)) <= 1e-12).all()
    assert cycle.stable == (np.abs(cycle.others).max() < 1.0)
    assert cycle.stable == (scene != "unstable")
    assert cycle.error < 1e-6
    assert (cycle.t[0], cycle.t[-1]) == (0.0, cycle.period)
    assert cycle.q[-1] == pytest.approx(cycle.q[0], abs=1e-9)
    assert tip.argmax() in (0, tip.size - 1)
    assert cycle.amplitude == pytest.approx(0.5 * np.ptp(tip), rel=1e-6)
    # Odd: half a period later on the other side.
    half = tip.size // 2
    assert tip[half:] == pytest.approx(-tip[: half + 1], abs=1e-5 * cycle.amplitude)
    # What the flow gives, damping and drag take.
    power = model.power(cycle.y[:, :-1], u)
    feed = np.abs(power.flow).mean()
    assert abs(np.mean(power.total)) < 2e-6 * feed
    if model.pipe.drag or model.pipe.damping:
        assert np.mean(power.flow) == pytest.approx(-np.mean(power.joints + power.drag), rel=2e-4)
        assert np.mean(power.flow) > 0.0


@pytest.mark.parametrize("scene", ["ejecting", "aspirating, drag", "guided", "large"])
def test_a_simulation_that_starts_on_the_cycle_comes_back(scene):
    model, u = SCENES[scene]
    cycle = limit_cycle(model, u, rtol=1e-8)
    motion = pp.simulate(
        model, u, cycle.period, cycle.q[0], cycle.qdot[0], times=cycle.t, rtol=1e-10
    )
    scale = np.abs(cycle.qdot).max()
    tolerance = 2e-6 if model.pipe.drag else 2e-8
    assert np.abs(motion.q - cycle.q).max() < tolerance * scale
    assert np.abs(motion.qdot - cycle.qdot).max() < 100 * tolerance * scale


def test_a_long_simulation_ends_on_the_stable_cycle():
    known = limit_cycle(THREE, 5.0)
    motion = pp.simulate(THREE, 5.0, 30.0, bow, times=np.linspace(28.0, 30.0, 2001), rtol=1e-9)
    tip = motion.tip[:, 0]
    assert tip.max() == pytest.approx(known.amplitude, rel=1e-5)
    up = np.flatnonzero((tip[:-1] < 0.0) & (tip[1:] >= 0.0))
    times = motion.t[up] - tip[up] * (motion.t[1] - motion.t[0]) / (tip[up + 1] - tip[up])
    assert 2.0 * np.pi / np.diff(times).mean() == pytest.approx(known.frequency, rel=1e-5)


def test_the_multipliers_are_those_of_perturbed_motions():
    model, u = GROWING, 6.5
    cycle = limit_cycle(model, u, rtol=1e-9)
    y, h = cycle.y[:, 0], 1e-5

    def after(state):
        return pp.simulate(model, u, cycle.period, state[:3], state[3:], samples=2, rtol=1e-12).y[
            :, -1
        ]

    through = np.array([(after(y + h * e) - after(y - h * e)) / (2 * h) for e in np.eye(6)]).T
    values = np.linalg.eigvals(through)
    for value in cycle.multipliers:
        assert np.abs(values - value).min() < 1e-5
    velocity = model.rhs(0.0, y, u)
    assert through @ velocity == pytest.approx(velocity, abs=1e-5 * np.abs(velocity).max())


def test_growth_away_from_an_unstable_cycle_is_its_largest_multiplier():
    model, u = SCENES["unstable"]
    cycle = pp.limit_cycle(model, u, rtol=1e-9)
    largest = cycle.multipliers[0]
    assert largest.imag == 0.0
    assert largest.real > 1.05
    motion = pp.simulate(
        *(model, u, 6 * cycle.period, 1.001 * cycle.q[0], 1.001 * cycle.qdot[0]),
        times=cycle.period * np.arange(1, 7),
        rtol=1e-11,
    )
    away = motion.tip[:, 0] - cycle.tip[0, 0]
    assert away[3:] / away[2:-1] == pytest.approx(np.full(3, largest.real), rel=0.02)


# ------------------------------------------------------------------------ accuracy and its cost


@pytest.mark.parametrize(
    ("model", "u"),
    [(TWO, 6.0), (pp.Chain(pp.Pipe(0.2, drag=1.0), 3), 6.0)],
    ids=["smooth", "drag"],
)
def test_the_error_stated_bounds_what_refinement_changes(model, u):
    exact = limit_cycle(model, u, rtol=1e-8)
    for rtol in (1e-3, 1e-4, 1e-5, 1e-6):
        cycle = pp.limit_cycle(model, u, rtol=rtol)
        off = abs(cycle.amplitude / exact.amplitude - 1.0)
        off = max(off, abs(cycle.frequency / exact.frequency - 1.0))
        assert off <= cycle.error + exact.error
        assert cycle.error <= rtol
        assert cycle.phases <= exact.phases


def test_cycles_of_stiff_models_are_found_from_samples_of_motions():
    """Modes that decay like exp(-9e7 tau) would multiply the errors of the samples' forces."""
    spring = pp.CubicSpring(at=1.0, stiffness=400.0)
    model = pp.Galerkin(pp.Pipe(0.35, damping=0.02, terms=(spring,)), 5, "legendre")
    cycle = pp.limit_cycle(model, 10.5)
    assert cycle.method == "collocation, simulation"
    assert cycle.amplitude == pytest.approx(0.5676335, abs=1e-6)
    assert len(cycle.orbit.starts) <= 80  # 113 with those forces


def test_a_cycle_is_found_from_samples_where_drag_and_a_cubic_spring_stiffen_it():
    """Some 26 samples a period, with high harmonics."""
    terms = pp.CubicSpring(at=0.4344, stiffness=5410.0), pp.PointMass(at=0.4357, mass=0.4052)
    pipe = pp.Pipe(0.9365, alpha=1.4775, drag=8.243, terms=terms, supports=(0.447,))
    model = pp.Chain(pipe, 6)
    cycle = pp.limit_cycle(model, 9.22, lambda s: 0.1 * s)
    assert cycle.method == "collocation, simulation"
    going = pp.simulate(model, 9.22, 40.0, lambda s: 0.1 * s)
    late = going.tip[going.t > 35.0, 0]
    assert cycle.amplitude == pytest.approx(0.5 * np.ptp(late), rel=1e-3)


@pytest.mark.parametrize(
    "times",
    [
        np.append(np.linspace(0.0, 25.0, 251), np.linspace(25.0, 30.0, 1001)[1:]),
        np.append(0.0, np.linspace(25.0, 30.0, 501)),
        30.0 * np.linspace(0.0, 1.0, 1500) ** 2,
        np.sort(np.append([0.0, 30.0], np.random.default_rng(0).uniform(0.0, 30.0, 3000))),
    ],
)
def test_a_motion_with_uneven_times_leads_to_its_cycle(times):
    model = pp.Chain(pp.Pipe(0.2, damping=0.002), 4)
    motion = pp.simulate(model, 6.5, 30.0, lambda s: 0.1 * s, times=times)
    cycle = pp.limit_cycle(model, 6.5, motion)
    assert (cycle.amplitude, cycle.frequency) == pytest.approx((0.4728700, 13.8658177), abs=1e-6)


def test_a_tolerance_out_of_reach_is_not_claimed():
    """Between 400 soft stops, each of which the pipe meets on its way there and back."""
    stops = tuple(pp.Stop(1.0, gap, 1e-4) for gap in np.linspace(0.01, 0.99, 400))
    model = pp.Chain(pp.Pipe(0.2, terms=stops), 2)
    with pytest.raises(pp.NotConverged, match="known on one mesh only: that takes more") as caught:
        pp.limit_cycle(model, 8.0, limit_cycle(TWO, 8.0), rtol=1e-9)
    kept = caught.value.result
    assert kept.amplitude > 0.1
    assert kept.error > 1e-9


def test_a_trivial_multiplier_is_judged_by_how_near_the_next_one_is(monkeypatch):
    def erring(*given):
        maps, units = collocation_maps(*given)
        maps[0] *= 1.0 + 1.5e-6
        return maps, units

    monkeypatch.setattr(floquet, "collocation_maps", erring)
    model = pp.Chain(pp.Pipe(0.1, drag=2.0), 2)
    with pytest.raises(pp.NotConverged, match="multipliers, one of which should be 1") as caught:
        pp.limit_cycle(model, 3.6)
    assert caught.value.result.multiplier_error > 1e-6
    # Right past the onset the next multiplier is 7e-4 away.
    onset = pp.hopf(model)
    cycle = pp.limit_cycle(model, onset.speed + 3e-4, onset)
    apart = np.abs(cycle.others - 1.0).min()
    assert 1e-6 < cycle.multiplier_error < 0.01 * apart
    assert apart < 1e-3
    # What attracts there is the cycle: its amplitude is that of the normal form.
    assert cycle.stable
    assert cycle.amplitude == pytest.approx(onset.amplitude(cycle.u), rel=1e-2)


def test_a_cycle_of_a_scene_is_known_right_past_its_onset():
    model = pp.modular.chain(pp.Pipe(0.1, drag=2.0), n=3)
    onset = pp.hopf(model)
    u = onset.speed + 1e-6
    cycle = pp.limit_cycle(model, u)
    assert cycle.multiplier_error < 1e-8
    assert cycle.stable
    assert cycle.amplitude == pytest.approx(onset.amplitude(u), rel=1e-5)


# ---------------------------------------------------------------------------------- where from


def test_every_start_leads_to_the_same_cycle():
    rom = pp.Galerkin(PIPE, 4)
    known = pp.limit_cycle(rom, 6.0)
    motion = pp.simulate(rom, 6.0, 8.0, bow)
    state = np.concatenate([rom.bent(bow), np.zeros(4)])
    near = pp.limit_cycle(rom, 6.1, known)
    assert near.amplitude > known.amplitude
    for start in (motion, state, near, known):
        cycle = pp.limit_cycle(rom, 6.0, start)
        assert cycle.amplitude == pytest.approx(known.amplitude, rel=1e-7)
        assert cycle.frequency == pytest.approx(known.frequency, rel=1e-7)
    guided, u = SCENES["guided"]
    first = limit_cycle(guided, u)
    again = pp.limit_cycle(guided, u, first)
    assert again.amplitude == pytest.approx(first.amplitude, rel=1e-7)


def test_a_whole_period_gives_what_half_of_one_does(known):
    """A jet that leaves askew by 1e-7 changes no digit below, and leaves no mirror symmetry."""
    whole = pp.limit_cycle(ROM.with_pipe(pp.Pipe(0.2, jet_angle=1e-7)), 6.0, known)
    assert known.symmetric
    assert not whole.symmetric
    assert whole.amplitude == pytest.approx(known.amplitude, rel=1e-8)
    assert whole.frequency == pytest.approx(known.frequency, rel=1e-8)
    assert whole.multipliers[:4] == pytest.approx(known.multipliers[:4], abs=1e-6)


def test_a_start_in_other_coordinates_is_refused_by_what_they_are(known):
    beams = pp.Galerkin(PIPE, 8)
    kinds = "coordinates, amplitudes of 8 beam functions, got amplitudes of 8 legendre functions"
    with pytest.raises(ValueError, match=f"start must be a LimitCycle in the model's {kinds}"):
        pp.limit_cycle(beams, 6.0, known)
    with pytest.raises(ValueError, match=f"start must be a Motion in the model's {kinds}"):
        pp.limit_cycle(beams, 6.0, pp.simulate(ROM, 6.0, 1.0, bow))
    # Legendre functions that are joined where a term acts are others again.
    joined = pp.Galerkin(pp.Pipe(0.2, terms=(pp.PointMass(at=0.4, mass=0.1),)), 8, "legendre")
    with pytest.raises(ValueError, match=r"legendre functions joined at .*0\.4.*, got amplitudes"):
        pp.limit_cycle(joined, 6.0, known)
    # A chain's coordinates are those of a scene of as many segments.
    chain = pp.limit_cycle(pp.Chain(PIPE, 3), 5.0)
    scene = pp.limit_cycle(pp.modular.chain(PIPE, n=3), 5.0, chain)
    assert scene.amplitude == pytest.approx(chain.amplitude, rel=1e-7)


def test_a_cycle_of_few_samples_is_as_good_a_start():
    chain = pp.Chain(pp.Pipe(0.2, drag=0.5), 4)
    few = pp.limit_cycle(chain, 6.0, samples=9)
    again = pp.limit_cycle(chain, 6.0, few)
    assert again.amplitude == pytest.approx(few.amplitude, rel=1e-7)


def test_a_cycle_of_another_pipe_is_a_start():
    first = pp.limit_cycle(pp.Chain(PIPE, 5), 6.0)
    damped = pp.limit_cycle(pp.Chain(pp.Pipe(0.2, damping=1e-3), 5), 6.0, first)
    assert 0.9 * first.amplitude < damped.amplitude < first.amplitude


def test_two_cycles_at_one_speed_below_a_subcritical_onset():
    model = pp.Chain(pp.Pipe(0.7), 3)
    onset = pp.hopf(model)
    u = onset.speed - 2e-3
    small = pp.limit_cycle(model, u)
    assert not small.stable
    assert small.multipliers[0].real > 1.01
    large = pp.limit_cycle(model, 6.303)  # past the onset, round the fold
    for speed in (6.25, 6.22, u):
        large = pp.limit_cycle(model, speed, large)
    assert large.stable
    assert large.amplitude > 2.0 * small.amplitude
    assert pp.eigenvalues(model, u).real.max() < 0.0  # the pipe may rest as well
    # Below the fold there is neither.
    with pytest.raises(pp.NoCycle, match="rest"):
        pp.limit_cycle(model, 6.19)


def test_a_cycle_that_no_onset_leads_to_is_found_by_simulation():
    # Undamped and aspirating: unstable from u = 0 on, drag alone bounds the motion.
    model = pp.Chain(pp.Pipe(0.2, flow="aspirating", drag=3.0), 3)
    cycle = pp.limit_cycle(model, 0.3)
    assert "simulation" in cycle.method
    assert cycle.stable
    assert 1e-3 < cycle.amplitude < 0.3


def test_a_search_may_start_from_an_onset():
    model = pp.Galerkin(pp.Pipe(0.295), 8, "legendre")
    first, second, third = (pp.hopf(model, c) for c in pp.crossings(model, 9.0))
    u = second.speed - 0.1
    one, other = (pp.limit_cycle(model, u, onset) for onset in (first, second))  # its two ends
    assert "from the onset at u = 7.8" in other.method
    assert other.amplitude == pytest.approx(one.amplitude, rel=1e-5)
    assert pp.limit_cycle(model, 8.3, third).amplitude == pytest.approx(
        pp.limit_cycle(model, 8.3).amplitude, rel=1e-5
    )
    with pytest.raises(pp.NoCycle, match=r"of the Hopf point at u = 7\.26.* does not reach u = 7"):
        pp.limit_cycle(model, 7.0, first)
    with pytest.raises(pp.NoCycle, match="does not reach"):
        pp.limit_cycle(model, third.speed, third)  # where it has no size
    with pytest.raises(ValueError, match="start must be an onset of the model, got one of Gal"):
        pp.limit_cycle(pp.Galerkin(pp.Pipe(0.3), 8, "legendre"), 8.3, third)
    with pytest.raises(ValueError, match="start must be an onset of the model"):
        pp.limit_cycle(THREE, 8.3, third)


def test_the_search_ends_at_the_speed_and_takes_no_step_beyond_it():
    assert limit_cycle(ROM, 7.0).evaluations < 1500  # 1853 with a step beyond and one back


def test_a_prediction_far_from_the_branch_is_not_taken_for_the_cycle():
    # Newton's method ends from there, but on no orbit of a finer mesh.
    cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.05), 4), 5.93416)
    assert cycle.amplitude == pytest.approx(0.637488, abs=1e-6)


def test_a_search_may_start_from_a_bent_pipe():
    model = THREE
    expected = limit_cycle(model, 5.0)
    q = model.bent(bow)
    for start in (bow, q, np.concatenate([q, 0.1 * q])):
        found = pp.limit_cycle(model, 5.0, start)
        assert "simulation" in found.method
        assert found.amplitude == pytest.approx(expected.amplitude, rel=1e-5)
    scene = pp.modular.chain(PIPE, n=3)
    assert pp.limit_cycle(scene, 5.0, q).amplitude == pytest.approx(expected.amplitude, rel=1e-5)


def test_a_cycle_is_its_own_mirror_image_though_the_motion_to_it_was_not_yet():
    found = pp.limit_cycle(pp.Chain(pp.Pipe(0.2, -40.0), 3), 5.0, lambda s: 0.05 * s**2)
    assert found.symmetric
    half = found.t.size // 2
    np.testing.assert_allclose(found.q[: half + 1], -found.q[half:], atol=1e-12)


def test_below_the_fold_of_cycles_the_search_says_where_it_lies():
    model = SUBCRITICAL
    onset = pp.hopf(model)
    assert onset.criticality == "subcritical"
    with pytest.raises(
        pp.NoCycle, match=r"of the Hopf point at u = 3\.13387 reaches down to u = 3\.12922 only"
    ):
        pp.limit_cycle(model, 3.12)
    with pytest.raises(pp.NoCycle, match=r"reaches down to u = 3\.12922 only"):
        pp.limit_cycle(model, 3.12, onset)
    # It lies there: two cycles above it, none below.
    assert pp.limit_cycle(model, 3.1293, onset).amplitude < 0.2
    with pytest.raises(pp.NoCycle):
        pp.limit_cycle(model, 3.1292, onset)


def test_a_cycle_below_an_onset_that_weak_drag_makes_supercritical_is_found():
    for drag in (1e-6, 1e-2):
        model = pp.Chain(pp.Pipe(0.05, drag=drag), 2)
        onset = pp.hopf(model)
        assert onset.criticality == "supercritical"
        cycle = pp.limit_cycle(model, onset.speed - 1e-3)
        assert not cycle.stable
        assert cycle.amplitude == pytest.approx(onset.amplitude(cycle.u), rel=0.05)


def test_an_aspirating_pipe_without_damping_has_the_cycle_that_damped_ones_tend_to():
    def chain(damping):
        return pp.Chain(pp.Pipe(0.2, flow="aspirating", drag=1.0, damping=damping), 6)

    near, nearer = (pp.limit_cycle(chain(damping), 0.1) for damping in (2e-3, 1e-3))
    cycle = pp.limit_cycle(chain(0.0), 0.1, nearer)
    assert cycle.frequency == pytest.approx(3.516, rel=0.05)  # about the beam's first mode
    ratio = (near.amplitude - cycle.amplitude) / (nearer.amplitude - cycle.amplitude)
    assert ratio == pytest.approx(2.0, rel=0.05)
    assert not cycle.stable  # higher modes grow too


def test_drag_alone_bounds_the_motion_of_an_aspirating_chain():
    cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.2, flow="aspirating", drag=1.0), 7), 0.1)
    assert "followed from a damped pipe" in cycle.method
    assert cycle.multiplier_error < 1e-6
    assert 1e-3 < cycle.amplitude < 0.3


def test_a_cycle_beside_bent_equilibria_is_found():
    cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.5, gamma=-30.0), 2), 4.5)
    assert cycle.stable
    assert cycle.amplitude > 0.5


# -------------------------------------------------------------------------- far from the onset


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (pp.Chain(ASPIRATING, 12), 0.08),
        pytest.param(pp.Galerkin(ASPIRATING, 8, "legendre"), 0.3, marks=pytest.mark.slow),
        (pp.Chain(pp.Pipe(0.2, drag=2.0), 10), 8.0),
        (pp.Chain(pp.Pipe(0.8, drag=2.0, damping=0.01), 3), 8.12),
        (REPELLING, 14.29),
    ],
    ids=["stiff", "stiff, far", "kinks", "many kinks", "large multipliers"],
)
def test_large_and_stiff_cycles_are_known_to_the_tolerance(model, u):
    cycle = limit_cycle(model, u, samples=4097)
    assert cycle.error < 1e-6
    assert cycle.multiplier_error < 1e-6
    power = model.power(cycle.y[:, :-1], u)
    assert abs(np.mean(power.total)) < 2e-6 * np.abs(power.flow).mean()


def test_a_stiff_cycle_closes_under_another_method():
    model, u = pp.Chain(ASPIRATING, 6), 0.12
    cycle = pp.limit_cycle(model, u)

    def rates(t, y):
        return model.rhs(t, y, u)

    def jacobian(t, y):
        return model.jacobian(t, y, u)

    after = scipy.integrate.solve_ivp(
        rates, (0.0, cycle.period), cycle.y[:, 0], "Radau", jac=jacobian, rtol=1e-9, atol=1e-11
    ).y[:, -1]
    assert after == pytest.approx(cycle.y[:, 0], abs=1e-7)


def test_the_trivial_multiplier_survives_one_of_ten_million():
    cycle = limit_cycle(REPELLING, 14.29, samples=4097)
    assert abs(cycle.multipliers[0]) > 1e6
    assert np.abs(cycle.multipliers - 1.0).min() < 1e-9


def test_a_multiplier_of_1e28_costs_the_others_no_digits():
    """Over the slow cycle of a heavy nozzle the other mode grows; another method agrees."""
    model = heavy(5.0)
    onset = pp.hopf(model, pp.crossings(model, 10.0)[-1])
    cycle = pp.limit_cycle(model, 1.001 * onset.speed, onset)

    def rates(t, y):
        state = cycle.orbit.states(np.array([cycle.frequency * t]))[:, 0]
        return (model.jacobian(t, state, cycle.u) @ y.reshape(4, 4)).ravel()

    run = scipy.integrate.solve_ivp(rates, (0.0, cycle.period), np.eye(4).ravel(), rtol=1e-8)
    grown = np.abs(np.linalg.eigvals(run.y[:, -1].reshape(4, 4))).max()
    assert 1e28 < cycle.multipliers[0].real == pytest.approx(grown, rel=1e-5)
    assert np.abs(cycle.multipliers - 1.0).min() < 1e-8
    assert cycle.amplitude == pytest.approx(onset.amplitude(cycle.u), rel=0.01)


def test_the_product_of_the_multipliers_is_the_exponential_of_the_divergence():
    # Liouville: the determinant is exp of the integral of the Jacobian's trace.
    model, u = GROWING, 6.5
    cycle = limit_cycle(model, u, rtol=1e-9)
    traces = [np.trace(model.jacobian(0.0, y, u)) for y in cycle.y[:, :-1].T]
    found = np.log(np.abs(cycle.multipliers)).sum()
    assert found == pytest.approx(cycle.period * np.mean(traces), rel=1e-6)


# ------------------------------------------------------------------------------------ refusals


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_why_each_way_to_a_cycle_fails_is_told():
    failure = "the onset do not converge .*; no limit cycle at u = 3.2 by simulation"
    with pytest.raises(pp.NoCycle, match=failure):
        pp.limit_cycle(heavy(160.0, gamma=0.0), 3.2)


def test_the_error_of_multipliers_is_never_below_rounding(known):
    for cycle in (known, limit_cycle(GROWING, 6.5)):
        assert cycle.multiplier_error >= cycle.multipliers.size * np.finfo(float).eps


def test_where_there_is_no_cycle_an_exception_says_why():
    with pytest.raises(pp.NoCycle, match=r"rests stably at u = 5\.3: flutter sets in") as caught:
        pp.limit_cycle(ROM, 5.3)
    assert caught.value.u == 5.3
    assert pickle.loads(pickle.dumps(caught.value)).u == 5.3
    chain = pp.Chain(PIPE, 3)
    with pytest.raises(pp.NoCycle, match="Newton's method takes the amplitude below 3 % of its st"):
        pp.limit_cycle(chain, 4.3, pp.limit_cycle(chain, 5.0))
    with pytest.raises(pp.NoCycle, match="by simulation: it ends in rest"):
        pp.limit_cycle(chain, 4.0, np.concatenate([chain.bent(bow), np.zeros(3)]))
    with pytest.raises(pp.NoCycle, match="ends in a bent pipe at rest"):
        pp.limit_cycle(pp.Chain(pp.Pipe(0.2, gamma=-20.0, damping=0.01), 3), 1.0)
    with pytest.raises(pp.NoCycle, match="does not come back to an earlier state"):
        pp.limit_cycle(ROM, 6.0, pp.simulate(ROM, 6.0, 0.2, bow))
    with pytest.raises(pp.NoCycle, match="no cycle attracts"):
        pp.limit_cycle(pp.Chain(pp.Pipe(0.0), 3), 6.0)
    with pytest.raises(pp.NoCycle, match="by simulation"):
        pp.limit_cycle(pp.Chain(pp.Pipe(0.2, flow="aspirating"), 3), 0.3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"model": pp.Chain(PIPE, 101)}, "model must"),
        ({"u": 0.0}, "u must"),
        ({"rtol": 1e-14}, "rtol must"),
        ({"samples": 3}, "samples must"),
        ({"start": "hopf"}, "start must be a LimitCycle, a Hopf, a Motion, an angle"),
        ({"start": np.zeros(5)}, "start must have 8 entries, or for a state twice as many"),
        ({"start": lambda: pp.simulate(THREE, 6.0, 1.0, bow)}, "start must be a Motion"),
        ({"start": lambda: limit_cycle(THREE, 5.0)}, "start must be a LimitCycle"),
    ],
)
def test_a_bad_argument_is_refused_by_name(given, message):
    """What each argument alone must not be is in fuzz.py."""
    start = given.get("start")
    given = given | ({"start": start()} if callable(start) else {})
    with pytest.raises((ValueError, TypeError), match=rf"^{message}"):
        pp.limit_cycle(**{"model": ROM, "u": 6.0} | given)


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_multipliers_that_overflow_are_refused():
    """Over a slow cycle the fast mode grows by more than numbers can hold."""
    model = heavy(160.0)
    onset = pp.crossings(model, 30.0)[-1]
    rates = pp.eigenvalues(model, onset.speed).real
    assert np.exp(2.0 * np.pi / onset.frequency * rates.max()) > 1e100
    with pytest.raises(pp.NotConverged, match="fails its check: its Floquet multipliers overflow"):
        pp.limit_cycle(model, 1.001 * onset.speed, pp.hopf(model, onset))


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_mesh_intervals_are_not_halved_for_defects_that_are_rounding(damping):
    """The cycle needs 64 intervals of 8 stages for ten digits; rounding would ask for 1,000."""
    model = FINEST.with_pipe(pp.Pipe(0.2, damping=damping)) if damping else FINEST
    sharp = pp.limit_cycle(model, 6.0, rtol=1e-10)
    assert sharp.error <= 1e-10
    assert sharp.phases < 1500
    loose = limit_cycle(model, 6.0)
    assert sharp.amplitude == pytest.approx(loose.amplitude, rel=1e-9)
