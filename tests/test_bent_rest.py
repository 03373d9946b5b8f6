# SPDX-License-Identifier: MIT
"""Linear questions about pipes that sag: the rest is solved anew at each flow speed.

Numbers are those of a boundary-value problem of small motions about the bent rest, by a program
that shares no code with the package.
"""

import dataclasses
import math
import pickle
import warnings

import numpy as np
import pytest

import pipedyn as pp

LEVEL = math.pi / 2

ONSETS = [
    ({"gamma": 10.0, "inclination": LEVEL}, (5.9544239, 13.515863)),
    ({"gamma": 20.0, "inclination": LEVEL}, (6.6770006, 13.569462)),
    ({"gamma": 10.0, "inclination": math.pi / 4}, (6.2632989, 14.587331)),
]
"""Numbers of the pipe at beta = 0.2, and its critical speed and frequency in the plane."""

silent = pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")


def level(beta=0.2, gamma=10.0, **numbers):
    return pp.Pipe(beta, gamma, inclination=LEVEL, **numbers)


def legendre(pipe, m=12):
    return pp.Galerkin(pipe, m, "legendre")


@silent
@pytest.mark.parametrize(("numbers", "expected"), ONSETS)
def test_a_sagging_pipe_flutters_where_the_boundary_value_problem_says(numbers, expected):
    found = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, **numbers)))
    assert (found.speed, found.frequency) == pytest.approx(expected, abs=6e-8 * 10)
    assert (found.kind, found.mode, found.stable_from) == ("flutter", 2, 0.0)
    assert found.error < 1e-9


@silent
def test_sagging_chains_tend_to_the_exact_onset_with_second_order():
    exact = ONSETS[0][1][0]
    errors = [pp.critical_speed(pp.Chain(level(), n)).speed - exact for n in (10, 20, 40)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.05)
    assert abs(errors[2]) < 6e-3


@silent
def test_the_onset_moves_with_the_square_of_a_small_load_across():
    """The mirror image of a load has the same onset, so that it is even in the load."""
    straight = pp.critical_speed(legendre(pp.Pipe(0.2))).speed

    def moved(force):
        pipe = pp.Pipe(0.2, terms=[pp.Load(0.7, (force, 0.0))])
        return pp.critical_speed(legendre(pipe, 16)).speed - straight

    small, large, mirrored = map(moved, (0.2, 0.4, -0.4))
    assert large / small == pytest.approx(4.0, rel=0.02)
    assert mirrored == pytest.approx(large, rel=1e-6)


@silent
@pytest.mark.parametrize("name", ["beta", "gamma", "damping", "alpha"])
def test_sensitivities_let_the_rest_follow_the_numbers(name):
    pipe = level(damping=0.003)
    found = pp.critical_speed(legendre(pipe))
    step = 1e-4 * max(getattr(pipe, name), 0.1)
    moved = [
        pp.critical_speed(
            legendre(dataclasses.replace(pipe, **{name: getattr(pipe, name) + sign * step}))
        )
        for sign in (1.0, -1.0)
    ]
    for of in ("speed", "frequency"):
        expected = (getattr(moved[0], of) - getattr(moved[1], of)) / (2.0 * step)
        assert getattr(getattr(found.sensitivity, of), name) == pytest.approx(expected, rel=1e-5)


@silent
def test_all_questions_at_one_speed_are_about_one_rest():
    for make in (legendre, lambda p: pp.Chain(p, 12), lambda p: pp.modular.chain(p, 6)):
        model = make(level(damping=0.01))
        u, rest = 4.0, pp.equilibria(model, 4.0).q[0]
        about = model.about(rest)
        values = pp.eigenvalues(about, u, 4)
        assert pp.eigenvalues(model, u, 4) == pytest.approx(values, rel=1e-9)
        mode, same = (pp.modes(one, u, 1).shapes[0]([0.3, 1.0]) for one in (model, about))
        assert mode == pytest.approx(same, rel=1e-7)
        loci = pp.root_loci(model, [0.0, 2.0, u], 2)
        assert loci.eigenvalues[-1] == pytest.approx(values[::2], rel=1e-8)
        assert loci.converged.all()
        still = pp.root_loci(model, [0.0], 2).eigenvalues
        assert still == pytest.approx(loci.eigenvalues[:1], rel=1e-9)
        response, its = (pp.frequency_response(one, u, [3.0]).response for one in (model, about))
        assert response == pytest.approx(its, rel=1e-7)


@silent
def test_the_continuous_sagging_pipe_answers_as_large_reduced_models():
    exact, model = pp.Continuum(level()), legendre(level(), 24)
    assert pp.eigenvalues(exact, 4.0, 4) == pytest.approx(pp.eigenvalues(model, 4.0, 4), rel=1e-8)
    loci = [pp.root_loci(one, [1.0, 4.0], 2).eigenvalues for one in (exact, model)]
    assert loci[0] == pytest.approx(loci[1], rel=1e-7)
    found = [pp.frequency_response(one, 4.0, [4.0], input=("force", 0.5)) for one in (exact, model)]
    assert found[0].response == pytest.approx(found[1].response, rel=1e-4)
    every = pp.crossings(exact, 7.0)
    assert every.speeds == pytest.approx([5.9544239], abs=1e-6)
    assert every.unstable_at_rest == 0


def test_a_harmonic_force_moves_a_sagging_chain_as_its_response_says():
    """By a simulation of the base's motion, small beside the sag."""
    chain, u, w = pp.Chain(level(damping=0.02), 6), 3.0, 5.0
    rest = pp.equilibria(chain, u).q[0]
    answer = pp.frequency_response(chain, u, [w]).response[0]
    size = 1e-4
    motion = pp.simulate(chain, u, 40.0, rest, base=pp.Harmonic(size, w), rtol=1e-10, atol=1e-12)
    tip = motion.tip[motion.t > 30.0, 0] - chain.tip(rest)[0]
    at = motion.t[motion.t > 30.0]
    waves = np.stack([np.cos(w * at), np.sin(w * at)], axis=1)
    (cosine, sine), *_ = np.linalg.lstsq(waves, tip, rcond=None)
    assert complex(cosine, -sine) / size == pytest.approx(answer, rel=1e-3)


@silent
def test_cycles_of_a_sagging_pipe_grow_by_the_law_of_its_onset():
    model = legendre(level(damping=0.002), 8)
    law = pp.hopf(model)
    slopes = [
        pp.limit_cycle(model, law.speed + above).amplitude ** 2 / above for above in (0.02, 0.01)
    ]
    assert 2.0 * slopes[1] - slopes[0] == pytest.approx(law.amplitude_law, rel=2e-3)
    assert np.abs(law.rest).max() > 0.1


def test_a_user_of_a_planar_model_is_told_that_a_bent_pipe_flutters_across():
    loaded = pp.Pipe(0.2, terms=[pp.Load(1.0, (1.0, 0.0))])
    for pipe in (level(), loaded, pp.Pipe(0.2, jet_angle=0.2)):
        with pytest.warns(pp.FluttersAcross, match="across the plane of this model") as seen:
            pp.critical_speed(pp.Chain(pipe, 4))
        assert [one.filename for one in seen] == [__file__]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=pp.FluttersAcross)
            found = pp.critical_speed(pp.Chain(pipe, 4))
        assert found.discretisation > 0.0  # which asks the continuous pipe, without a warning
    standing = pp.Pipe(0.2, 10.0, inclination=math.pi)  # no load acts across it
    pp.critical_speed(pp.Chain(standing, 4))


def test_a_standing_pipe_may_be_given_by_its_inclination():
    upright, turned = pp.Pipe(0.2, -10.0), pp.Pipe(0.2, 10.0, inclination=-math.pi)
    for make in (pp.Continuum, lambda p: pp.Chain(p, 12), lambda p: pp.Galerkin(p, 12)):
        found = [pp.critical_speed(make(pipe)) for pipe in (upright, turned)]
        assert found[0].speed == pytest.approx(found[1].speed, rel=1e-12)
        assert found[0].stable_from == pytest.approx(found[1].stable_from, rel=1e-12)


@silent
def test_the_onset_is_continuous_from_hanging_over_level_to_leaning():
    """A pipe that stands nearly upright leans, to the side to which its weight pulls it."""
    angles = [0.0, 1e-3, 0.8, LEVEL, 2.4, 3.0, 3.1]
    curve = pp.stability_curve(
        lambda iota: pp.Continuum(pp.Pipe(0.2, 10.0, inclination=iota)), angles
    )
    assert curve.failures == ()
    assert curve.speeds[0] == pytest.approx(curve.speeds[1], abs=1e-5)
    assert curve.speeds[3] == pytest.approx(5.9544239, abs=1e-6)
    assert (np.diff(curve.speeds[1:]) < 0.0).all()
    assert curve.speeds[-1] == pytest.approx(4.8663, abs=3e-3)  # of the standing pipe's flutter


@silent
def test_a_leaning_pipe_snaps_where_its_rest_turns_back():
    """It hangs over the clamp until the flow straightens it; the fold's derivatives follow it."""
    pipe = pp.Pipe(0.2, 30.0, damping=0.002, inclination=3.1)
    model = legendre(pipe)
    found = pp.critical_speed(model)
    assert (found.kind, found.frequency, found.stable_from) == ("divergence", 0.0, 0.0)
    (hangs_over, *_) = (q for q in pp.equilibria(model, 0.0).q if 0.5 < model.tip(q)[0] < 0.6)
    branch = pp.equilibrium_branch(model, hangs_over, 0.0, (0.0, 6.0))
    fold = next(point for point in branch.points if point.kind == "fold")
    assert found.speed == pytest.approx(fold.speed, rel=1e-7)
    step = 1e-3
    moved = [
        pp.critical_speed(legendre(dataclasses.replace(pipe, gamma=30.0 + sign * step))).speed
        for sign in (1.0, -1.0)
    ]
    slope = (moved[0] - moved[1]) / (2.0 * step)
    assert found.sensitivity.speed.gamma == pytest.approx(slope, rel=1e-4)
    assert found.sensitivity.frequency.gamma == 0.0
    with pytest.raises(pp.NotConverged, match=r"does not reach u = 6: it turns back at u = 4\.1"):
        pp.eigenvalues(model, 6.0)


@silent
def test_a_rest_that_buckles_to_one_side_is_told_from_its_neighbours_or_refused():
    def onset(across):
        return pp.critical_speed(legendre(pp.Pipe(0.2, terms=[pp.Load(1.0, (across, -2.6))])))

    found = onset(0.01)
    assert (found.stable_at_rest, found.stable_from, found.kind) == (True, 0.0, "flutter")
    assert found.speed == pytest.approx(onset(0.0).speed, abs=1e-5)
    for across in (1e-5, 1e-6):  # of the latter, longer steps lead over to the mirrored rest
        near = onset(across)
        assert (near.stable_at_rest, near.kind) == (True, "flutter")
        assert near.speed == pytest.approx(onset(0.0).speed, abs=1e-9)
    with pytest.raises(pp.NotConverged, match="does not reach u = 100: it is not followed beyond"):
        onset(1e-8)


@silent
def test_a_level_hose_is_identified_from_its_own_frequencies():
    """Those of a straight hose without weight across would be 20 % off."""
    hose = {"length": 0.45, "pipe_mass": 0.19, "fluid_mass": 0.032, "damping_time": 2e-3}
    true, guess = (
        pp.Pipe.from_si(**hose, bending_stiffness=stiffness, inclination=LEVEL)
        for stiffness in (7.3e-3, 6e-3)
    )
    values = pp.eigenvalues(pp.Continuum(true), 0.0, 4)[::2]
    hertz = true.frequency_si(np.abs(values.imag)) / (2.0 * math.pi)
    measured = [pp.Measurement("frequency", hertz[mode - 1], 0.01, mode=mode) for mode in (1, 2)]
    found = pp.identify(guess, measured, ["bending_stiffness"])
    assert found.values == pytest.approx([7.3e-3], rel=1e-6)


@silent
def test_results_about_a_sagging_pipe_pickle_and_save(tmp_path):
    pipe = level(terms=[pp.Load(0.5, (0.2, 0.1)), pp.DistributedLoad((0.1, 0.0))])
    found = pp.critical_speed(pp.Chain(pipe, 4))
    found.save(tmp_path / "found.npz")
    for copy in (pp.load(tmp_path / "found.npz"), pickle.loads(pickle.dumps(found))):
        assert copy == found
        assert copy.model.pipe == pipe
    shape = found.mode_shape([0.5, 1.0])
    assert np.abs(shape).max() <= 1.0 + 1e-12


@silent
def test_what_cannot_be_asked_of_a_sagging_pipe_says_why():
    model = legendre(level(damping=0.002), 6)
    with pytest.raises(ValueError, match=r"^model must be of a pipe that rests straight where"):
        pp.floquet(model, pp.Pulsation(4.0, 0.1, 20.0))
    with pytest.raises(ValueError, match=r"^pipe must rest straight"):
        pp.plot.Exploration(level(), 4)
    arch = pp.Chain(level(end="clamped"), 12)
    with pytest.raises(
        pp.NotConverged, match=r"does not reach u = 12: it is not followed beyond u"
    ):
        pp.critical_speed(arch, 12.0)
    bent = level(terms=[pp.FollowerForce(1.0, 30.0)], damping=0.01)
    with pytest.raises(pp.NoCrossing, match="unstable at rest, where 2 roots grow"):
        pp.critical_speed(pp.Chain(dataclasses.replace(bent, inclination=0.0), 8), 5.0)
    column = pp.Chain(pp.Pipe(0.2, terms=[pp.FollowerForce(1.0, 30.0)]), 8)
    with pytest.raises(pp.NotConverged, match=r"unstable at rest.* make 2 roots grow"):
        pp.critical_speed(column, 5.0)
    curve = pp.stability_curve(
        lambda beta: pp.Chain(dataclasses.replace(column.pipe, beta=beta), 8), [0.2]
    )
    assert np.isnan(curve.no_loss_up_to).all()  # nobody knows where it is stable
    loci = pp.root_loci(column, [0.0, 1.0], 4)
    assert np.sum(loci.eigenvalues[0].real > 1e-6) == 1


@silent
def test_the_inclination_is_weighed_among_the_effects():
    found = pp.relevant(level(damping=1e-3), 2.0, tolerance=1e-2)
    assert found["inclination"].verdict == found["gravity"].verdict == "relevant"
    hanging = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, 10.0, damping=1e-3))).speed
    assert found["inclination"].answer.values[0] == pytest.approx(hanging, rel=1e-3)
    assert "the pipe at rest grows by" in str(found)


@pytest.mark.parametrize(("gamma", "at", "load"), [(0.0, 0.2, 0.003), (17.0, 1.0, 0.001)])
@pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")
def test_a_pipe_that_buckles_is_asked_about_the_side_that_its_small_load_chooses(gamma, at, load):
    # Long steps of two lengths jump alike to the other branch, nearly straight and unstable.
    pipe = pp.Pipe(0.2, gamma, damping=0.08, end="guided", terms=[pp.Load(at, (load, 0.0))])
    model = pp.Galerkin(pipe, 5)
    found = pp.equilibria(model, 5.0)
    stable = [model.about(q) for q in found.q[found.stable] if model.tip(q)[0] * load > 0.0]
    lowest = pp.eigenvalues(model, 5.0, 4)
    assert lowest.real.max() < 0.0
    assert any(lowest == pytest.approx(pp.eigenvalues(one, 5.0, 4), rel=1e-6) for one in stable)
