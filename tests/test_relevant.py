# SPDX-License-Identifier: MIT
"""Which effects a scene requires: sizes held against models and determinants without the effect."""

import dataclasses
import math

import numpy as np
import pytest
from independent import series_crossing, series_newton_step

import pipedyn as pp

HOSE = {
    "length": 1.0,
    "bending_stiffness": 0.1,
    "pipe_mass": 0.1,
    "fluid_mass": 0.1,
    "drag_coefficient": 1.0,
    "external_diameter": 0.015,
    "external_density": 1.2,
    "damping_time": 1e-4,
}


@pytest.fixture(scope="module")
def horizontal():
    """beta = 0.2 without gravity, damping or drag: Gregory and Paidoussis' pipe."""
    return pp.relevant(pp.Pipe(0.2), 5.0)


@pytest.fixture(scope="module")
def hose():
    pipe = pp.Pipe.from_si(**HOSE)
    return pp.relevant(pipe, pipe.speed_from_si(4.0))


# ----------------------------------------------------------------------------------- critical speed


def test_a_pipe_without_coriolis_force_is_becks_column(horizontal):
    """u^2 = 20.0509..., two frequencies meeting; printed as 4.47783 (physics, section 6)."""
    effect = horizontal["Coriolis"]
    full, without = 5.591404378, math.sqrt(20.05095)
    assert effect.answer.values[0] == pytest.approx(without, abs=2e-6)
    assert effect.size == pytest.approx((full - without) / full, rel=1e-6)
    assert effect.verdict == "relevant"


def test_the_limit_of_weak_coriolis_force_is_noted_where_it_is_another(horizontal, hose):
    assert "u = 4.19024," in horizontal["Coriolis"].note
    assert hose["Coriolis"].note == ""


def test_the_weakest_coriolis_force_matters_to_an_undamped_pipe():
    effect = pp.relevant(pp.Pipe(1e-10), 4.0)["Coriolis"]
    assert effect.size == pytest.approx(4.47783 / 4.190241 - 1.0, rel=1e-4)
    assert effect.verdict == "relevant"


def test_without_centrifugal_force_no_ejecting_pipe_loses_stability(horizontal):
    """Known without a search: all roots stay left of the axis."""
    effect = horizontal["centrifugal"]
    assert effect.size == math.inf
    assert effect.without == "no loss of stability at any speed"
    for u in (3.0, 10.0, 30.0):
        quiet = pp.relevant(pp.Pipe(0.2), u, "frequencies", count=2)["centrifugal"]
        assert quiet.growth < 0.0
        for value in quiet.answer.values[:4]:
            missed = series_newton_step(pp.Pipe(0.2, alpha=0.0), value, u)
            assert abs(missed) < 1e-8 * abs(value)


def test_a_horizontal_pipe_flutters_and_never_diverges(horizontal):
    """Nor does a horizontal chain, whose det K no flow changes."""
    for effect in horizontal.effects:
        assert "divergence" not in effect.without
    for n in (2, 3, 5):
        chain = pp.Chain(pp.Pipe(0.5), n)
        assert {one.kind for one in pp.crossings(chain, 30.0)} == {"flutter"}
        ops = chain.operators()
        rest, flowing = (np.linalg.det(ops.at(u)[2]) for u in (0.0, 4.0))
        assert flowing == pytest.approx(rest, rel=1e-10)


def test_drag_has_no_part_in_linear_questions():
    pipe = pp.Pipe(0.2, drag=3.0)
    for quantity, conditions in (
        ("critical_speed", {}),
        ("frequencies", {"count": 2}),
        ("root_loci", {"speeds": [1.0, 2.0], "count": 1}),
    ):
        effect = pp.relevant(pipe, 4.0, quantity, **conditions)["drag"]
        assert (effect.size, effect.error, effect.verdict) == (0.0, 0.0, "negligible")


def test_gravity_is_as_large_as_the_published_critical_speeds_say():
    """beta = 0.2: 6.3398 at gamma = 10, 5.591404 at 0 (physics, section 6)."""
    found = pp.relevant(pp.Pipe(0.2, gamma=10.0, damping=1e-5), 5.0)
    assert found["gravity"].size == pytest.approx(1.0 - 5.591404 / 6.3398, abs=2e-5)


def test_small_effects_are_as_large_as_the_sensitivity_of_the_onset_says():
    """To the first order in gamma and delta, whose derivatives come from the pencil."""
    pipe = pp.Pipe(0.3, gamma=1e-3, damping=1e-5)
    found = pp.relevant(pipe, 5.0)
    critical = pp.critical_speed(pp.Continuum(pipe))
    for name, number in (("gravity", "gamma"), ("damping", "damping")):
        slope = getattr(critical.sensitivity.speed, number)
        expected = abs(slope) * getattr(pipe, number) / critical.speed
        assert found[name].size == pytest.approx(expected, rel=1e-2)
    assert found.negligible == ("damping", "gravity")


def test_only_damping_keeps_an_aspirating_pipe_from_instability_at_the_smallest_flow():
    found = pp.relevant(pp.Pipe(0.2, flow="aspirating", alpha=0.5, damping=1e-3), 1.0)
    damping = found["damping"]
    assert damping.size == math.inf
    assert damping.without == "unstable from the smallest flow on"
    undamped = pp.relevant(pp.Pipe(0.2, 5.0, flow="aspirating"), 1.0)
    assert undamped.full == "unstable from the smallest flow on"
    assert undamped["gravity"].size == 0.0
    assert undamped["Coriolis"].size == math.inf


def test_damping_without_coriolis_force_moves_an_aspirating_pipes_onset_as_the_determinant_says():
    found = pp.relevant(pp.Pipe(0.3, flow="aspirating", damping=0.05), 1.0)["Coriolis"]
    u = found.answer.values[0]
    guess = pp.critical_speed(pp.Continuum(pp.Pipe(0.0, flow="aspirating", damping=0.05)))
    exact, _ = series_crossing(pp.Pipe(0.0, damping=0.05), guess.speed, guess.frequency)
    assert u == pytest.approx(exact, rel=1e-8)


def test_a_pipe_that_buckles_under_its_weight_is_another_pipe_without_it():
    found = pp.relevant(pp.Pipe(0.2, gamma=-10.0), 3.0)
    assert found.full.startswith("buckled at rest, flutter at u = 4.86")
    assert found["gravity"].size == math.inf
    assert found["gravity"].without.startswith("flutter at u = 5.59")


def test_each_term_is_switched_off_like_any_other_effect():
    """Each as large as the critical speed without it says; equal terms are one effect."""
    mass, spring, speck = pp.PointMass(1.0, 0.1), pp.Spring(0.6, 10.0), pp.PointMass(0.5, 1e-7)
    pipe = pp.Pipe(0.2, 10.0, terms=(mass, spring, speck, spring, pp.PointMass(0.2, 0.0)))
    found = pp.relevant(pipe, 4.0)
    full = pp.critical_speed(pp.Continuum(pipe)).speed
    for term in (mass, spring, speck):
        others = tuple(other for other in pipe.terms if other != term)
        without = pp.critical_speed(pp.Continuum(dataclasses.replace(pipe, terms=others))).speed
        effect = found[repr(term)]
        assert effect.size == pytest.approx(abs(without / full - 1.0), rel=1e-6, abs=1e-11)
        assert f"u = {without:.6g}" in effect.without
    assert found[repr(mass)].strength == "mass = 0.1"
    assert found.negligible == (repr(speck),)
    assert speck not in found.simplified.terms
    assert {mass, spring} < set(found.simplified.terms)
    assert found["PointMass(at=0.2, mass=0)"].verdict == "absent"


def test_the_growth_beside_is_of_modes_that_springs_stiffen():
    """A stiff foundation of many springs lifts all frequencies above those of the free beam."""
    terms = tuple(pp.Spring(at, 1e7) for at in np.linspace(0.2, 1.0, 5))
    pipe = pp.Pipe(0.2, damping=1e-6, terms=terms)
    values = pp.eigenvalues(pp.Galerkin(pipe, 60, "legendre"), 2.0, 8)
    growth = pp.relevant(pipe, 2.0, "frequencies", count=1).growth
    assert growth == pytest.approx(values.real.max(), rel=1e-6)


# ------------------------------------------------------------------------------- at a speed


def test_frequencies_without_flow_are_the_beams():
    """(1.8751, 4.69409)^2 of the cantilever, Blevins' table."""
    found = pp.relevant(pp.Pipe(0.2), 4.0, "frequencies", count=2)
    upper = found["flow"].answer.values.imag
    expected = np.array([1.87510407, 4.69409113]) ** 2
    np.testing.assert_allclose(np.sort(upper[upper > 0.0])[:2], expected, rtol=1e-7)
    assert found["flow"].strength == "beta = 0.2, alpha = 1"
    assert found["flow"].growth == 0.0


@pytest.mark.parametrize(
    ("pipe", "u", "count"),
    [
        (pp.Pipe(0.2), 6.0, 24),
        (pp.Pipe(0.2, 10.0, damping=0.2), 12.0, None),  # the lowest all cluster at -5
        (pp.Pipe(0.2, -400.0), 1.0, 24),
        (pp.Pipe(0.2, flow="aspirating"), 3.0, 24),
    ],
)
def test_the_growth_beside_is_that_of_a_chains_least_damped_mode(pipe, u, count):
    growth = pp.relevant(pipe, u, "root_loci", speeds=[1.0], count=1).growth
    values = pp.eigenvalues(pp.Chain(pipe, 100), u, count)
    assert growth == pytest.approx(values.real.max(), rel=5e-3)


def test_no_flow_effect_acts_on_a_pipe_at_rest():
    found = pp.relevant(pp.Pipe(0.2, 5.0), 0.0, "frequencies", count=3)
    assert found.negligible == ("Coriolis", "centrifugal", "flow")
    assert all(found[name].size == 0.0 for name in found.negligible)


@pytest.mark.parametrize("flow", ["ejecting", "aspirating"])
def test_a_pipe_drops_its_centrifugal_part_by_alpha(flow):
    pipe = pp.Pipe(0.2, flow=flow, alpha=0.7, damping=1e-3)
    effect = pp.relevant(pipe, 3.0, "frequencies", count=2)["centrifugal"]
    plain = pp.eigenvalues(pp.Continuum(dataclasses.replace(pipe, alpha=0.0)), 3.0, 4)
    np.testing.assert_allclose(effect.answer.values[:4], plain, rtol=1e-9)


def test_drag_matters_to_a_motion_and_not_in_thin_air():
    found = pp.relevant(pp.Pipe(0.2, drag=1e-3, damping=2e-3), 5.0, "motion", duration=0.4)
    assert found["drag"].verdict == "negligible"
    assert 0.0 < found["drag"].size < 1e-4
    strong = pp.relevant(pp.Pipe(0.2, drag=10.0, damping=2e-3), 5.0, "motion", duration=0.4)
    assert strong["drag"].size > 1e3 * found["drag"].size


@pytest.mark.slow
def test_without_damping_a_limit_cycle_is_the_undamped_pipes():
    """Amplitudes 0.262918 and 0.276611 at u = 6, frequencies 13.69632 and 13.79155."""
    loose = {"tolerance": 1e-2, "rtol": 1e-5}
    found = pp.relevant(pp.Pipe(0.2, damping=1e-3), 6.0, "limit_cycle", **loose)
    damping = found["damping"]
    np.testing.assert_allclose(damping.answer.values, [0.276611, 13.79155], rtol=1e-3)
    assert abs(damping.size - (0.276611 / 0.262918 - 1.0)) <= damping.error < 1e-3
    assert found["centrifugal"].size == math.inf
    assert found["centrifugal"].without == "no limit cycle, it rests"


def test_what_cannot_be_found_counts_as_relevant():
    """Without Coriolis force the undamped pipe grows without a cycle that the search would find."""
    effect = pp.relevant(pp.Pipe(0.2), 5.0, "limit_cycle", tolerance=1e-2)["Coriolis"]
    assert math.isnan(effect.size)
    assert effect.growth > 0.0
    assert (effect.verdict, effect.without) == ("relevant", "not found")
    assert effect.note


# ------------------------------------------------------------------------------------- the result


def test_effects_are_sorted_by_size_and_absent_ones_last(horizontal, hose):
    for found in (horizontal, hose):
        sizes = [one.size for one in found.effects if one.verdict != "absent"]
        assert sizes == sorted(sizes, reverse=True)
        verdicts = [one.verdict == "absent" for one in found.effects]
        assert verdicts == sorted(verdicts)
    assert {one.name for one in horizontal.effects if one.verdict == "absent"} == {
        *("gravity", "drag", "damping", "hysteresis")
    }


def test_dropping_all_that_is_negligible_changes_as_little_as_is_said(hose):
    assert hose.negligible == ("damping", "drag")
    assert hose.together.verdict == "negligible"
    assert (hose.simplified.damping, hose.simplified.drag) == (0.0, 0.0)
    assert hose.simplified.gamma == hose.pipe.gamma
    before, after = (
        pp.critical_speed(pp.Continuum(pipe)).speed for pipe in (hose.pipe, hose.simplified)
    )
    assert hose.together.size == pytest.approx(abs(after / before - 1.0), rel=1e-3)


def test_an_effect_within_its_error_of_the_tolerance_is_kept(hose):
    for verdict, share in (("relevant", 1.0), ("negligible", 1.01)):
        size = pp.relevant(hose.pipe, 4.0, "frequencies", count=2)["damping"].size
        edge = pp.relevant(hose.pipe, 4.0, "frequencies", count=2, tolerance=share * size)
        assert edge["damping"].error > 0.0
        assert edge["damping"].verdict == verdict


def test_si_pipes_show_speeds_in_metres_per_second(hose):
    assert "(4 m/s)" in str(hose)
    speed = hose.pipe.speed_si(hose["gravity"].answer.values[0])
    assert f"({speed:.4g} m/s)" in hose["gravity"].without


def test_results_print_as_text_and_as_a_table(horizontal):
    text, page = str(horizontal), horizontal._repr_html_()
    for effect in horizontal.effects:
        assert effect.name in text
        assert f"<td>{effect.name}</td>" in page
    assert "infinite" in text
    assert page.count("<tr>") == 1 + len(horizontal.effects)
    with pytest.raises(dataclasses.FrozenInstanceError):
        horizontal.u = 1.0


@pytest.mark.parametrize(
    ("arguments", "conditions", "error", "message"),
    [
        ((pp.Pipe(0.2), 1.0, "motion"), {}, TypeError, "lacks duration"),
        ((pp.Pipe(0.2), 1.0), {"colour": 1}, TypeError, "takes max_speed"),
    ],
)
def test_bad_arguments_are_named(arguments, conditions, error, message):
    with pytest.raises(error, match=message):
        pp.relevant(*arguments, **conditions)


def test_an_unknown_effect_is_named(horizontal):
    with pytest.raises(ValueError, match="name must"):
        horizontal["wind"]


# -------------------------------------------------------------------------- effects that are absent


MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 6),
    "beam": lambda pipe: pp.Galerkin(pipe, 4),
    "legendre": lambda pipe: pp.Galerkin(pipe, 4, "legendre"),
    "modules": lambda pipe: pp.modular.chain(pipe, 6),
}


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
def test_effects_that_are_absent_add_no_terms(make):
    """Their operators are zero to the last entry; the stiffness is the springs' alone."""
    bare, hung = (make(pp.Pipe(0.0, gamma=gamma)) for gamma in (0.0, 3.0))
    for name in ("damping", "gyroscopic", "end_flux"):
        assert not np.any(getattr(bare.operators(), name))
    assert np.any(bare.operators().stiffness != hung.operators().stiffness)
    mass, velocity, stiffness = bare.operators().at(0.0)
    assert not np.any(velocity)
    np.testing.assert_array_equal(stiffness, bare.operators().stiffness)
    np.testing.assert_array_equal(mass, hung.operators().mass)
    both = make(pp.Pipe(0.0, damping=0.5)).operators()
    np.testing.assert_allclose(both.damping, 0.5 * stiffness, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
def test_effects_that_are_absent_do_no_work(make):
    model = make(pp.Pipe(0.3))
    rng = np.random.default_rng(1)
    y = model.state(*rng.normal(size=(2, 6))) if hasattr(model, "state") else None
    y = rng.normal(size=2 * model.dof) if y is None else y
    power = model.power(y, 0.0)
    assert (power.flow, power.joints, power.drag) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("count", [1, 3])
def test_as_many_frequencies_are_given_as_were_asked_for(count):
    """Two roots of another set lie close to the last, and are no part of the answer."""
    found = pp.relevant(pp.Pipe(0.3, 5.0, damping=1e-3), 3.0, "frequencies", count=count)
    assert found.full.count(",") == count - 1
    assert all(one.without.count(",") <= count - 1 for one in found.effects)


def test_changes_of_roots_are_said_to_be_of_the_complex_ones():
    """Damping of 0.001 moves the third frequency by 2e-3, and its root by 3e-2."""
    found = pp.relevant(pp.Pipe(0.3, 5.0, damping=1e-3), 3.0, "frequencies", count=3)
    assert found["damping"].size > 0.02
    assert "of the complex root" in str(found)
    assert "of the complex root" in found._repr_html_()
    assert "complex" not in str(pp.relevant(pp.Pipe(0.3), 3.0))


def test_growth_that_is_rounding_is_given_as_zero():
    """Without flow an undamped pipe neither grows nor decays."""
    found = pp.relevant(pp.Pipe(0.3), 0.0, "root_loci", speeds=[0.0], count=2)
    assert found.full == "growth up to 0"


PLAIN, HUNG = pp.Pipe(0.2), pp.Pipe(0.2, 10.0)
DRAWN = pp.Pipe(0.2, flow="aspirating", damping=0.005)


@pytest.mark.parametrize(
    ("plain", "name", "strong", "strength", "faint"),
    [
        (PLAIN, "end coefficient", {"alpha": 1.2}, "alpha = 1.2", {"alpha": 1.0005}),
        (PLAIN, "hysteresis", {"hysteresis": 0.1}, "mu = 0.1", {"hysteresis": 1e-5}),
        (PLAIN, "rotary inertia", {"rotary_inertia": 0.01}, "J = 0.01", {"rotary_inertia": 1e-6}),
        (DRAWN, "inflow", {"inflow_share": 0.0}, "c = 0", {"inflow_share": 0.9999}),
        (
            *(PLAIN, "varying stiffness", {"stiffness": lambda s: 1 - s / 2}),
            *("stiffness 0.5 to 1", {"stiffness": lambda s: 1 + 1e-5 * s}),
        ),
        (
            *(PLAIN, "varying mass", {"mass": lambda s: 1 + s}),
            *("mass 1 to 2", {"mass": lambda s: 1 + 1e-5 * s}),
        ),
        (
            *(PLAIN, "AddedMass", {"terms": [pp.AddedMass(0.5)]}),
            *("chi = 0.5", {"terms": [pp.AddedMass(1e-9)]}),
        ),
        (
            *(PLAIN, "ExternalFlow", {"terms": [pp.ExternalFlow(1.0, 0.5, end_shape=0.7)]}),
            *("speed = 1, chi = 0.5, end_shape = 0.7, added_mass_coefficient = 1",),
            {"terms": [pp.ExternalFlow(1e-5, 1e-9)]},
        ),
        (
            *(HUNG, "RootSpring", {"root": pp.RootSpring(30.0)}),
            *("stiffness = 30", {"root": pp.RootSpring(1e6)}),
        ),
    ],
)
def test_each_effect_is_weighed_by_the_loss_of_the_pipe_without_it(
    plain, name, strong, strength, faint
):
    pipe = dataclasses.replace(plain, **strong)
    found = pp.relevant(pipe, 0.05 if plain is DRAWN else 5.0, max_speed=20.0)
    (effect,) = (one for one in found.effects if one.name.startswith(name))
    full, without = (pp.critical_speed(pp.Continuum(one)).speed for one in (pipe, plain))
    assert (effect.strength, effect.verdict) == (strength, "relevant")
    assert effect.size == pytest.approx(abs(without / full - 1.0), rel=1e-4)
    weak = pp.relevant(dataclasses.replace(plain, **faint), 0.05 if plain is DRAWN else 5.0)
    assert any(one.startswith(name) for one in weak.negligible)
    for number in faint:
        assert getattr(weak.simplified, number) == getattr(plain, number)


def test_what_drives_a_motion_is_weighed_against_the_motion_without_it():
    pipe, start = pp.Pipe(0.2, damping=0.01), lambda s: 0.5 * s
    given = {"duration": 0.25, "start": start, "samples": 9, "tolerance": 2e-2}
    pump, base = pp.Pulsation(4.0, 0.2, 10.0), pp.Harmonic(1e-4, 3.0)
    found = pp.relevant(pipe, pump, "motion", base=base, **given)
    assert found.u == 4.0
    assert found["moving base"].verdict == "negligible"
    model = pp.Galerkin(pipe, 8, "legendre")
    tips = [
        pp.simulate(model, u, 0.25, start, samples=9, base=base, rtol=1e-8).tip for u in (pump, 4.0)
    ]
    apart = np.hypot(*(tips[0] - tips[1]).T).max()
    excursion = np.hypot(*(tips[0] - [0.0, 1.0]).T).max()
    assert found["pulsation"].size == pytest.approx(apart / excursion, rel=1e-3)
    fed = pp.relevant(pipe, pp.Supply(16.0, 2.0), "motion", **given)
    assert fed.u == 4.0
    assert fed["constant head"].strength == "friction = 2"
    assert 1e-3 < fed["constant head"].size < 0.1
    with pytest.raises(TypeError, match=r"^u must be a real number, got Pulsation"):
        pp.relevant(pipe, pump)
