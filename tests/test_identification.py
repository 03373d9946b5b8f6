# SPDX-License-Identifier: MIT
"""Numbers of a pipe from measurements: found again, with uncertainties that hold, or refused.

Measurements are made by another model (a chain of many segments, or the determinant's numbers of
the literature) or drawn at random around the true ones.
"""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from independent import companion_eigenvalues

import pipedyn as pp
from pipedyn.models.pipe_numbers import pipe_numbers

EI, LENGTH, DAMPING_TIME, COMPLIANCE = 7.3e-3, 0.45, 2e-3, 0.03


def hose(stiffness=EI, **more):
    return pp.Pipe.from_si(
        length=LENGTH, bending_stiffness=stiffness, pipe_mass=0.19, fluid_mass=0.032, **more
    )


TRUE = hose(damping_time=DAMPING_TIME, root=pp.RootSpring(EI / LENGTH / COMPLIANCE))
GUESS = hose(9e-3)


def shown(pipe, sigma=0.01):
    """What the pipe shows, by its matrices at rest and its onset."""
    model = pp.Continuum(pipe).frozen(24)
    values = companion_eigenvalues(*model.operators().at(0.0))
    roots = sorted(values[values.imag > 0.0], key=abs)
    found = []
    for mode in (1, 2):
        root = roots[mode - 1]
        hertz = root.imag / (2.0 * math.pi * pipe.scales.time)
        decrement = -2.0 * math.pi * root.real / root.imag
        found.append(pp.Measurement("frequency", hertz, sigma * hertz, mode=mode))
        found.append(pp.Measurement("decrement", decrement, 5.0 * sigma * decrement, mode=mode))
    critical = pp.critical_speed(model)
    speed = pipe.speed_si(critical.speed)
    found.append(pp.Measurement("critical_speed", speed, 2.0 * sigma * speed))
    hertz = pipe.frequency_si(critical.frequency) / (2.0 * math.pi)
    found.append(pp.Measurement("critical_frequency", hertz, sigma * hertz))
    return found


MEASURED = shown(TRUE)
EVERY = ("bending_stiffness", "damping", "clamp_compliance")


def test_a_pipe_that_flow_does_not_make_unstable_is_identified_without_a_critical_speed():
    pipe = pp.Pipe(0.3, gamma=1e5)
    first = pp.modes(pp.Continuum(pipe), 0.0, count=1).eigenvalues[0].imag
    measured = [pp.Measurement("frequency", first, 0.01 * first)]
    found = pp.identify(replace(pipe, gamma=6e4), measured, ["gamma"])
    assert abs(found.values[0] - 1e5) < 0.02 * found.uncertainties[0]
    assert math.isnan(found.critical_speed)
    assert math.isnan(found.critical_speed_uncertainty)
    assert found.warnings == ("no critical speed is predicted: no loss of stability up to u = 100",)


def test_exact_measurements_give_the_numbers_back():
    found = pp.identify(GUESS, MEASURED, EVERY)
    truth = [EI, DAMPING_TIME, COMPLIANCE * LENGTH / EI]
    np.testing.assert_allclose(found.values, truth, rtol=1e-6)
    assert found.chi_squared < 1e-9
    assert found.freedom == 3
    np.testing.assert_allclose(found.predicted, [m.value for m in MEASURED], rtol=1e-7)
    assert found.critical_speed == pytest.approx(MEASURED[4].value, rel=1e-6)
    assert found.pipe.scales.time == pytest.approx(TRUE.scales.time)
    assert found.pipe.damping == pytest.approx(TRUE.damping)


def test_progress_of_scan_lines_and_searches_changes_nothing_but_stderr(terminal):
    measured = MEASURED[:2]
    quiet = pp.identify(GUESS, measured, ["bending_stiffness"])
    assert terminal.readouterr().err == ""
    shown = pp.identify(GUESS, measured, ["bending_stiffness"], progress=True)
    said = terminal.readouterr().err
    for label in ("scan of the ranges", "lines from an optimum", "searches, 16 functions"):
        assert f"{label}: 100 %" in said
    np.testing.assert_array_equal(shown.values, quiet.values)


def test_uncertainties_are_the_spread_of_estimates_from_noisy_measurements():
    unknowns = EVERY[:2]
    rigid = hose(damping_time=DAMPING_TIME)
    exact = shown(rigid, 0.003)
    random = np.random.default_rng(3)
    found = pp.identify(hose(EI), exact, unknowns)
    drawn = []
    for _ in range(10):
        noisy = [replace(m, value=m.value + m.uncertainty * random.normal()) for m in exact]
        one = pp.identify(
            rigid,
            noisy,
            {name: (v / 2, v * 2) for name, v in zip(unknowns, found.values, strict=True)},
        )
        drawn.append([*one.values, one.critical_speed])
    spread = np.std(drawn, axis=0, ddof=1)
    known = [*found.uncertainties, found.critical_speed_uncertainty]
    # The spread of ten is known to a quarter.
    assert np.abs(np.log(spread / known)).max() < math.log(2.0)


def test_modes_in_flow_tell_damping_by_the_fluid_from_that_of_the_wall():
    pipe = replace(TRUE, terms=(pp.Viscosity(0.5),))
    model, u = pp.Continuum(pipe).frozen(24), pipe.speed_from_si(3.0)
    values = companion_eigenvalues(*model.operators().at(u))
    first, second = sorted(values[values.imag > 0.0], key=abs)[:2]
    hertz = second.imag / (2.0 * math.pi * pipe.scales.time)
    decay = [-root.real / pipe.scales.time for root in (first, second)]
    measured = [
        pp.Measurement("frequency", hertz, 0.01 * hertz, speed=3.0, mode=2),
        *(
            pp.Measurement("decay_rate", one, 0.01 * one, speed=3.0, mode=i)
            for i, one in enumerate(decay, 1)
        ),
    ]
    given = replace(TRUE, terms=(pp.Viscosity(0.3),))
    found = pp.identify(given, measured, ["damping", "Viscosity.sigma"])
    sigma = 0.5 * pipe.scales.mass / pipe.scales.time
    assert found.values == pytest.approx([DAMPING_TIME, sigma], rel=1e-6)


@pytest.mark.parametrize(
    ("unknown", "value", "made"),
    [
        (EVERY[0], EI, lambda ei: hose(ei, end="pinned")),
        (EVERY[0], EI, lambda ei: hose(ei, end="clamped", damping_time=DAMPING_TIME)),
        (
            "Spring.stiffness",
            200.0,
            lambda k: pp.Pipe(0.2, 5.0, hysteresis=0.05, terms=(pp.Spring(1.0, k),)),
        ),
        (
            "Spring.stiffness",
            10.0,
            lambda k: pp.Pipe(0.9, -100.0, end="pinned", terms=(pp.Spring(0.6, k),)),
        ),
    ],
    ids=["two roots meet at 0", "damped", "hysteresis", "two pairs meet on the axis"],
)
def test_a_critical_speed_is_as_uncertain_as_it_was_measured(unknown, value, made):
    """Also where roots meet on the axis, which have no derivative there."""

    def onset(value):
        pipe = made(value)
        speed = pp.critical_speed(pp.Continuum(pipe)).speed
        return pipe.speed_si(speed) if pipe.scales else speed

    speed = onset(value)
    measured = [pp.Measurement("critical_speed", speed, 0.01 * speed)]
    found = pp.identify(made(1.2 * value), measured, {unknown: (0.5 * value, 2.0 * value)})
    slope = (onset(1.001 * value) - onset(0.999 * value)) / (0.002 * value)
    assert found.values == pytest.approx([value], rel=1e-5)
    assert found.uncertainties == pytest.approx([0.01 * speed / abs(slope)], rel=1e-5)
    assert found.critical_speed_uncertainty == pytest.approx(0.01 * speed, rel=1e-6)


def test_the_stiffness_of_a_pipe_held_at_both_ends_comes_from_its_divergence():
    """Pinned ends: u_c = pi without weight, so that EI = mu_f (L U_c / pi)^2."""
    pipe = pp.Pipe.from_si(
        length=0.6, bending_stiffness=5e-3, pipe_mass=0.19, fluid_mass=0.032, gravity=0.0,
        root="pinned", end="pinned",
    )  # fmt: skip
    speed = math.pi / 0.6 * math.sqrt(EI / 0.032)
    found = pp.identify(pipe, [pp.Measurement("critical_speed", speed, 0.01 * speed)], [EVERY[0]])
    assert found.values == pytest.approx([EI], rel=1e-6)
    assert found.uncertainties == pytest.approx([0.02 * EI], rel=1e-6)


@pytest.mark.parametrize(
    ("pipe", "message"),
    [
        (hose(end="pinned"), "of a pipe that diverges, as the model does at u = "),
        (pp.Pipe(0.9, -100.0, end="pinned", damping=0.0), "two modes of which meet at u = 3.64"),
        (pp.Pipe(0.0, 10.0), "two modes of which meet at u = "),
    ],
)
def test_the_frequency_of_an_onset_without_one_of_its_own_is_refused(pipe, message):
    unknown = "bending_stiffness" if pipe.scales else "Spring.stiffness"
    if not pipe.scales:
        pipe = replace(pipe, terms=(pp.Spring(0.6, 1e-3),))
    with pytest.raises(pp.NotIdentifiable, match=message):
        pp.identify(pipe, [pp.Measurement("critical_frequency", 2.0, 0.1)], [unknown])


def test_a_clamp_taken_as_rigid_shows_in_the_residuals():
    """EI comes out a tenth too low then, and its uncertainty says nothing of it."""
    sharp = [replace(m, uncertainty=0.3 * m.uncertainty) for m in MEASURED]
    rigid = pp.identify(GUESS, sharp, EVERY[:2])
    assert rigid.values[0] < 0.95 * EI
    assert rigid.uncertainties[0] < 0.02 * EI
    assert rigid.chi_squared > 4.0 * rigid.freedom
    assert any("does not explain the measurements" in word for word in rigid.warnings)


def test_what_the_data_do_not_tell_is_refused_with_its_name():
    onset = [m for m in MEASURED if m.quantity == "critical_speed"]
    with pytest.raises(pp.NotIdentifiable, match="1 measurement cannot tell 2 unknowns"):
        pp.identify(GUESS, onset, EVERY[:2])
    twice = [*onset, replace(onset[0], value=1.001 * onset[0].value)]
    with pytest.raises(pp.NotIdentifiable, match=r"tell .*damping.* measure something else"):
        pp.identify(GUESS, twice, EVERY[:2])


def test_an_unknown_at_the_end_of_its_range_is_told():
    """A rigid clamp: any small compliance will do."""
    rigid = shown(hose(damping_time=DAMPING_TIME))
    found = pp.identify(GUESS, rigid, EVERY)
    assert found.values[:2] == pytest.approx([EI, DAMPING_TIME], rel=0.02)
    assert math.isnan(found.uncertainties[2]) or found.uncertainties[2] > 0.3 * found.values[2]
    assert any("clamp_compliance" in word for word in found.warnings)


def test_a_nondimensional_pipe_and_its_loss_factor():
    """Paidoussis (1970): beta .00203, gamma 42.4; u_c 5.79, omega_c 18.1 belong to mu = .02."""
    pipe = pp.Pipe(0.00203, 42.4)
    measured = [
        pp.Measurement("critical_speed", 5.79087, 0.005),
        pp.Measurement("critical_frequency", 18.1460, 0.02),
    ]
    found = pp.identify(pipe, measured, ["hysteresis"])
    assert found.values[0] == pytest.approx(0.02, rel=1e-3)
    assert found.uncertainties[0] < 0.001
    assert found.chi_squared < 0.01
    assert found.warnings == ()


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (
            {"measurements": [pp.Measurement("frequency", 1.0, 0.1, speed=100.0)]},
            ValueError,
            r"measurements\[0\]\.speed must be at most 64\.82, got 100, 84\.9 in units of the pipe",
        ),
        ({"unknowns": ["dampng"]}, ValueError, "got 'dampng': did you mean 'damping'"),
        ({"unknowns": ["clamp_stiffness"]}, ValueError, "'clamp_compliance' instead of 'clamp_st"),
        ({"unknowns": ["drag"]}, ValueError, "no part in small motions"),
        ({"unknowns": ["gamma"]}, ValueError, "its masses and lengths are given"),
        ({"unknowns": {"damping": (0.0, 1.0)}}, ValueError, r"unknowns\['damping'\]"),
        (
            {"unknowns": {"damping": (1.0, 0.5)}},
            ValueError,
            r"must be \(low, high\), got \(1, 0\.5",
        ),
        ({"pipe": pp.Pipe(0.2), "unknowns": ["gamma"]}, ValueError, "bounds .* the pipe has at 0"),
        (
            {"pipe": pp.Pipe(0.2), "unknowns": ["bending_stiffness"]},
            ValueError,
            "make the pipe with Pipe.from_si",
        ),
        (
            {"pipe": pp.Pipe(0.2, 10.0, root="pinned"), "unknowns": ["clamp_compliance"]},
            ValueError,
            "the root is a hinge",
        ),
    ],
)
def test_bad_arguments_are_named(change, kind, message):
    given = {"pipe": GUESS, "measurements": MEASURED, "unknowns": ["damping"], **change}
    with pytest.raises(kind, match=message):
        pp.identify(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("speed", 1.0, 0.1), "quantity must be one of"),
        (("frequency", -1.0, 0.1), "value"),
        (("critical_speed", 1.0, 0.1, 2.0), "speed must be left out of a critical_speed"),
    ],
)
def test_bad_measurements_are_named(given, message):
    with pytest.raises(ValueError, match=message):
        pp.Measurement(*given)


def test_an_estimate_held_by_its_range_promises_nothing():
    """All measurements then judge what no unknown could fit."""
    [first, *_] = MEASURED
    far = replace(first, value=3.0 * first.value)
    found = pp.identify(GUESS, [far], {"bending_stiffness": (5e-3, 9e-3)})
    assert found.values == pytest.approx([9e-3], rel=1e-3)
    assert np.isnan(found.uncertainties).all()
    assert math.isnan(found.critical_speed_uncertainty)
    assert found.freedom == 1
    assert any("chi-squared" in one and "at 1 degree of freedom" in one for one in found.warnings)


def test_as_many_unknowns_as_measurements_may_explain_nothing():
    """No range holds a frequency and a decrement of the second mode that are both too small."""
    measured = [replace(one, value=0.5 * one.value) for one in MEASURED[:2]]
    unknowns = {"bending_stiffness": (5e-3, 9e-3), "hysteresis": (0.1, 0.2)}
    found = pp.identify(GUESS, measured, unknowns)
    assert found.freedom == 2
    assert found.chi_squared > 100.0
    assert any("does not explain" in one for one in found.warnings)


def test_a_mode_that_is_not_told_from_its_neighbours_tells_nothing():
    """The loci of modes 2 and 3 meet below u = 9 at beta = 0.38583, and change places beyond it.

    The decay rate is that at beta = 0.37, the critical speed that at 0.40.
    """
    decay = pp.Measurement("decay_rate", -3.93, 1.0, 9.0, 2)
    onset = pp.Measurement("critical_speed", 8.778, 0.05)
    with pytest.raises(pp.NotConverged, match=r"measurements\[0\] jumps .* too close together"):
        pp.identify(pp.Pipe(0.37), [decay, onset], {"beta": (0.3, 0.45)})


# ---------------------------------------------------------------------------- more than one answer


def swayed(gamma):
    """A pipe whose first mode, at u = 6, decays at one rate for three values of gamma."""
    return pp.Pipe(0.22, gamma, alpha=1.2, damping=0.02)


def decay_at_six(gamma):
    loci = pp.root_loci(pp.Continuum(swayed(gamma)), np.linspace(0.0, 6.0, 13), 2)
    return -loci.eigenvalues[-1, 0].real


@pytest.mark.parametrize("given", [2.0, 10.0, 30.0])
def test_all_pipes_that_explain_the_measurements_are_told_from_any_start(given):
    """One search from gamma = 30 finds 42.9 with an uncertainty of 2.4 %; the truth is 1.5."""
    rate = decay_at_six(1.5)
    measured = [pp.Measurement("decay_rate", rate, 0.01 * rate, speed=6.0)]
    found = pp.identify(swayed(given), measured, {"gamma": (0.5, 60.0)})
    every = sorted(float(one[0]) for one in (found.values, *found.alternatives))
    assert every == pytest.approx([1.5, 18.248, 42.892], rel=1e-4)
    assert [decay_at_six(gamma) for gamma in every] == pytest.approx([rate] * 3, rel=1e-6)
    assert found.values[0] == min(every, key=lambda gamma: abs(math.log(gamma / given)))
    assert np.isnan(found.uncertainties).all()
    assert math.isnan(found.critical_speed_uncertainty)
    assert found.warnings[0].startswith("3 different pipes explain the measurements about equally ")
    assert {"gamma = 1.5", "gamma = 18.25", "gamma = 42.89"} == {
        *re.findall(r"gamma = [\d.]*\d", found.warnings[0])
    }
    alone = pp.identify(swayed(given), measured, {"gamma": (30.0, 60.0)})
    assert alone.alternatives == ()
    assert alone.warnings == ()
    assert alone.values[0] == pytest.approx(every[2], rel=1e-6)
    assert 0.01 < alone.uncertainties[0] / alone.values[0] < 0.03


def test_a_mode_that_ceases_to_oscillate_within_the_ranges_ends_no_search():
    """A loss factor above 0.01 leaves the first mode of this pipe without a root at u = 6."""
    pipe = pp.Pipe(
        *(0.31471500154, 2.06247622854), alpha=1.12919664616, damping=0.0257576851125,
        hysteresis=0.02, terms=[pp.Spring(1.0, 92.6767580485)],
    )  # fmt: skip
    slow = pp.Measurement("decay_rate", -4.14, 0.04, speed=6.0)
    with pytest.raises(pp.NotIdentifiable, match=r"^mode 1 has no oscillation at u = 6 to tell$"):
        pp.identify(pipe, [slow], {"hysteresis": (0.01, 0.3)})
    pipe = pp.Pipe(
        *(0.8, 1.716), alpha=1.06256, damping=0.0075, hysteresis=0.03,
        terms=[pp.Spring(0.5, 1.242)],
    )  # fmt: skip
    measured = [
        pp.Measurement("decay_rate", 8.9, 0.089, speed=4.0),
        pp.Measurement("frequency", 6.54, 0.065, speed=6.0),
    ]
    found = pp.identify(pipe, measured, {"hysteresis": (1e-3, 0.3), "beta": (0.02, 0.98)})
    assert found.pipe.hysteresis == pytest.approx(0.04, rel=0.03)
    for one in measured:
        value = predicted(found.pipe, one.quantity, one.speed)
        assert value == pytest.approx(one.value, abs=0.05 * one.uncertainty)


def test_uncertainties_that_are_too_small_rule_no_pipe_out():
    """Two decay rates do not fit any gamma: the one at 42.9 is only a little better than at 1.5."""
    rate, sigma = decay_at_six(1.5), 1e-4
    measured = [
        pp.Measurement("decay_rate", rate * (1.0 + 0.01 * sign), sigma * rate, speed=6.0)
        for sign in (-1, 1)
    ]
    found = pp.identify(swayed(30.0), measured, {"gamma": (0.5, 60.0)})
    assert found.chi_squared > 1e4
    assert len(found.alternatives) >= 2
    assert any("does not explain the measurements" in one for one in found.warnings)


LAWS = {
    "beta": (0.02, 0.98),
    "gamma": (0.3, 100.0),
    "damping": (5e-4, 0.2),
    "Spring.stiffness": (0.1, 1e3),
}
KINDS = [
    ("frequency", 0.0, 1), ("frequency", 0.0, 2), ("decrement", 0.0, 1), ("frequency", 6.0, 1),
    ("decay_rate", 4.0, 1), ("frequency", 4.0, 2), ("critical_speed",), ("critical_frequency",),
]  # fmt: skip


@pytest.mark.parametrize(
    ("seed", "others"), [(0, 0), (17, 0), (35, 0), (25, 1), (30, 1), (34, 1), (32, 1), (48, 1)]
)
def test_random_pipes_come_back_within_their_uncertainties_or_among_those_told(seed, others):
    """The search begins far from them, at a pipe in the middle of all ranges."""
    random = np.random.default_rng(seed)
    numbers = random.choice([*LAWS], 2, replace=False).tolist()
    true = pp.Pipe(
        random.uniform(0.1, 0.8),
        10.0 ** random.uniform(0.0, 1.5),
        damping=10.0 ** random.uniform(-2.5, -1.5),
        terms=[pp.Spring(0.5, 10.0 ** random.uniform(0.0, 2.0))],
    )
    measured = []
    for k in random.permutation(len(KINDS)).tolist():
        quantity, *at = KINDS[k]
        value = predicted(true, quantity, *at)
        if not value or len(measured) == 3:  # a mode that does not oscillate has no frequency
            continue
        sigma = 0.01 * abs(value)
        noisy = value + sigma * random.normal()
        measured.append(pp.Measurement(quantity, noisy, sigma, *at))
    given, truth = true, []
    for name in numbers:
        number = pipe_numbers(true)[name]
        truth.append(number.of(true))
        given = number.changed(given, math.sqrt(math.prod(LAWS[name])))
    found = pp.identify(given, measured, {name: LAWS[name] for name in numbers})
    assert len(found.alternatives) == others
    if others:
        every = np.log([found.values, *found.alternatives])
        assert np.abs(every - np.log(truth)).max(axis=1).min() < 0.1
    else:
        assert np.abs((found.values - truth) / found.uncertainties).max() < 4.0
        assert found.uncertainties.max() < 0.3 * found.values.max()


def predicted(pipe, quantity, speed=0.0, mode=1):
    """A measured quantity, by root loci and critical speed of 30 functions."""
    model = pp.Continuum(pipe).frozen(30)
    if quantity.startswith("critical"):
        found = pp.critical_speed(model)
        return found.speed if quantity == "critical_speed" else found.frequency
    speeds = np.linspace(0.0, speed, 2 + math.ceil(speed)) if speed else np.zeros(1)
    root = pp.root_loci(model, speeds, 3).eigenvalues[-1, mode - 1]
    if quantity == "decrement":
        return -2.0 * math.pi * root.real / root.imag
    return root.imag if quantity == "frequency" else -root.real


@pytest.mark.parametrize(
    ("given", "true"),
    [
        (pp.Pipe(0.3, 10.0, damping=0.01), 0.9),
        (pp.Pipe(0.3, 10.0, damping=0.01, mass=lambda s: 1.0 - 0.4 * s), 0.55),
    ],
    ids=["uniform", "mass that varies"],
)
def test_a_mass_ratio_is_searched_for_below_one_or_the_least_mass(given, true):
    """Thirty times 0.3 is no mass ratio."""
    pipe = replace(given, beta=true)
    critical = pp.critical_speed(pp.Continuum(pipe))
    measured = [
        pp.Measurement("critical_speed", critical.speed, 0.01 * critical.speed),
        pp.Measurement("critical_frequency", critical.frequency, 0.01 * critical.frequency),
    ]
    found = pp.identify(given, measured, ["beta"])
    assert found.values == pytest.approx([true], rel=1e-5)
    with pytest.raises(
        ValueError, match=r"^unknowns\['beta'\] must lie in \(0, (1|0.6)[)\]], got 9"
    ):
        pp.identify(given, measured, {"beta": (0.01, 9.0)})
