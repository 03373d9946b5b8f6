# SPDX-License-Identifier: MIT
"""Random pipes against independent programs in short, and these programs against what is known."""

import math
from dataclasses import replace

import campaign
import campaign_elements
import campaign_reference
import numpy as np
import pytest
from campaign_cases import CLASSES, Case, drawn
from independent import beck_speed, series_crossing

import pipedyn as pp

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")  # also extreme ones

SHORT = range(10, 60)
"""Cases of seed 0: five of each class, none of more than 40 degrees of freedom."""

SLOW = pytest.mark.slow
NUMBERED = [*CLASSES][:10]
"""The classes among which cases with numbers below are drawn."""

BEFORE = [197, 541, 586, 603, 908, 2798, 3275, 3703, 4013, 4053, 4359, 5625]
BEFORE += [686, 976, 1604, 1936, 4286, 8646, 8681, 8985, 703, 1332, 1618, 573, 2323]
LONG = [253, 403, 1223, 1572, 2569, 2737, 2833, 3233, 3323, 6387, 9283]
"""Cases of seed 0 that searches before have got wrong or refused.

Rounding of high modes beside a slow growth (197, 6387), no growth at rest of an open inlet (586),
two divergences close together (603, 2798, 2833, 3323), one growing pair for two growing real roots
(3275, 5625), a left vector through a joint beyond which the pipe is singular by itself (908, 1572),
rounding of constraints (2737), roots that leave the axis and come back within a step (3703, 403), a
damper at a support (4359), growth from rest by the cube of the speed (686, 976, 1604, 1936, 4286,
8646), two roots that meet right behind a divergence (8681, 9283), growth that ceases to oscillate
(8985), overdamped modes of the continuous pipe beyond those that oscillate (253, 703, 1332, 1618,
2569), high modes that are lost beside a divergence and seemed to grow (573), steps right behind a
divergence that were so short that they were matched unseen (2323), a meeting of growing real roots
that was looked for where both are known to the square root of rounding (1223).
"""


def acted_on(law, **of):
    """A pipe's terms: one of a law."""
    return {"terms": [(law, of)]}


HINGED = {"root": "pinned", "end": "pinned"}
DRAWN = {"flow": "aspirating"}
WEAK = {"gamma": 23.0036, "alpha": 0.0, "damping": 1.20532e-6}
CLAMPED = {"end": "clamped"}
KNOWN = [
    ({"beta": 0.3, **CLAMPED, **acted_on("Foundation", stiffness=800.0)}, 11.0),
    ({"beta": 0.3, **CLAMPED, **acted_on("Foundation", stiffness=750.0)}, 10.0),
    ({"beta": 0.1, **HINGED, **acted_on("Foundation", stiffness=375.0)}, 9.0),
    (
        {"beta": 0.27208501319, **CLAMPED, **acted_on("Spring", at=0.5, stiffness=196.428504675)},
        10.0,
    ),
    ({"beta": 0.4, **DRAWN, "damping": 1e-3, **acted_on("Viscosity", sigma=30.0)}, 10.0),
    ({"beta": 1.1e-3, "gamma": -20.0, "hysteresis": 0.1}, 7.0),
    ({"beta": 0.2, "hysteresis": 0.05, "end": "guided"}, 10.0),
    ({"beta": 0.946029, **DRAWN, **WEAK}, 20.0),
]
"""Pipes of which crossings were missed, and the ends of the searches."""


def equal_spans(spans):
    """A hinged pipe on so many equal spans."""
    return {"beta": 0.3, **HINGED, "supports": [k / spans for k in range(1, spans)]}


EVERY = "pp.Continuum({})", "pp.Galerkin({}, 12, 'legendre')", "pp.Chain({}, 20)"
CASES = [(numbers, model, end) for numbers, end in KNOWN for model in EVERY]
CASES += [
    # Two supports near a free end: real roots go so fast past a divergence that they seemed lost.
    ({"beta": 0.631, "supports": [0.939, 0.9402]}, "pp.Continuum({})", 20.0),
    (equal_spans(20), "pp.Galerkin({}, 100, 'legendre')", 64.0),
    (equal_spans(30), "pp.Galerkin({}, 120, 'legendre')", 95.0),
    (equal_spans(50), "pp.Galerkin({}, 200, 'legendre')", 100.0),
    (equal_spans(30), "pp.Chain({}, 60)", 95.0),
    ({"beta": 0.631, "supports": [0.52, 0.939, 0.945]}, "pp.Continuum({})", 20.0),
    (equal_spans(100), "pp.Chain({}, 200)", 285.0),
]
LENGTHY = 21, 24, 26, 27, 30  # places of cases beside which a quicker one asks for the same


@pytest.mark.parametrize("name", CLASSES)
def test_random_pipes_lose_stability_where_independent_programs_say(name):
    names = NUMBERED if name in NUMBERED else [name] * 10
    cases = [drawn(0, i, names) for i in SHORT if names[i % 10] == name][:5]
    outcomes = [campaign.judged(case) for case in cases]
    wrong = [(one.case.text, one.reason) for one in outcomes if one.verdict != "right"]
    assert len(outcomes) == 5
    assert wrong == []


@pytest.mark.parametrize("number", [*BEFORE, *(pytest.param(n, marks=SLOW) for n in LONG)])
def test_random_pipes_that_were_answered_wrongly_are_right(number):
    outcome = campaign.judged(drawn(0, number, NUMBERED))
    assert (outcome.verdict, outcome.reason) == ("right", "")


def test_with_hysteresis_a_growing_motion_that_ceases_to_oscillate_is_told():
    pipe = pp.Pipe(4.59e-3, -19.48, damping=3.2e-5, flow="aspirating", alpha=1.0, hysteresis=0.3)
    with pytest.raises(pp.NotConverged, match=r"near u = 7\.58.* up to where it loses") as refused:
        pp.crossings(pp.Continuum(pipe), 10.9)
    (first,) = refused.value.result
    assert (first.kind, first.unstable_after) == ("divergence", 2)
    without = pp.crossings(pp.Continuum(replace(pipe, hysteresis=0.0)), 10.9)
    (static,) = (c for c in without if c.kind == "divergence" and c.unstable_after > 0)
    assert static.speed == pytest.approx(first.speed, rel=1e-12)


@pytest.mark.parametrize(
    "number", [pytest.param(k, marks=SLOW if k in LENGTHY else ()) for k in range(len(CASES))]
)
def test_pipes_that_were_answered_wrongly_are_right(number):
    outcome = campaign.judged(Case("known", *CASES[number]))
    assert (outcome.verdict, outcome.reason) == ("right", "")


def test_where_growing_real_roots_meet_every_basis_says_the_same():
    pipe = pp.Pipe(0.05, root="pinned", end="pinned", terms=(pp.Foundation(15401.5),))
    found = [pp.crossings(pp.Galerkin(pipe, m, "legendre"), 24.0).crossings for m in (30, 40, 61)]
    meetings = [[c for c in one if c.unstable_before == c.unstable_after] for one in found]
    assert len(meetings[0]) == 2
    for same in zip(*meetings, strict=True):
        speeds = [c.speed for c in same]
        assert np.ptp(speeds) <= 2.0 * max(c.error for c in same) < 1e-10


def test_modes_that_terms_miss_count_however_slow_the_flow():
    """Fluid drawn in feeds all modes, and a damper none that has a node where it is."""
    pipe = pp.Pipe(0.5, flow="aspirating", terms=(pp.Damper(0.98, 0.007),))
    first = pp.critical_speed(pp.Continuum(pipe), 5.0)
    assert pp.critical_speed(pp.Continuum(pipe), 1e-3).speed == pytest.approx(first.speed, rel=1e-6)
    assert (pp.eigenvalues(pp.Galerkin(pipe, 60, "legendre"), 1e-3).real > 1e-6).any()


@pytest.mark.parametrize("m", [40, 90])
def test_high_modes_of_a_reduced_model_count_where_the_flow_feeds_them(m):
    terms = (pp.Viscosity(5.88918), pp.Damper(0.5, 2.10575))
    pipe = pp.Pipe(0.0023111, flow="aspirating", alpha=0.0, terms=terms)
    model = pp.Galerkin(pipe, m, "legendre")
    for u in (1.5, 3.0):
        growing = np.count_nonzero(pp.eigenvalues(model, u).real > 0.1)
        found = pp.crossings(model, u).crossings
        assert found[-1].unstable_after == growing > 0


@pytest.mark.parametrize("n", [60, 150])
def test_the_highest_mode_of_a_long_chain_counts_where_the_flow_feeds_it_most(n):
    """Half a segment hangs below the last joint, where springs are at the middles."""
    pipe = pp.Pipe(0.159806, flow="aspirating", terms=(pp.Viscosity(41.9741),))
    model = pp.Chain(pipe, n, springs="midpoint")
    found = pp.critical_speed(model)
    assert found.mode == n
    below, above = (pp.eigenvalues(model, x * found.speed).real.max() for x in (0.999, 1.001))
    assert below < 0.0 < above


@pytest.mark.parametrize("spans", [1, 3, 6])
def test_elements_know_hinged_pipes_on_equal_spans(spans):
    numbers = equal_spans(spans)
    end = 1.01 * spans * math.pi
    answer = campaign_elements.continuum_changes(numbers, end)
    assert answer.changes[0].speed == pytest.approx(spans * math.pi, rel=1e-10)
    assert answer.counts[0] == (0, 0)
    system = campaign_elements.elements(numbers, 10.0 * spans, 0)
    rest = np.sort(system.roots(0.0).value.imag)[:spans]
    assert rest[0] == pytest.approx((math.pi * spans) ** 2, rel=1e-9)
    assert np.all(rest < 22.3733 * spans**2)


def test_elements_find_flutter_where_power_series_and_beck_do():
    found = campaign_elements.continuum_changes({"beta": 0.2}, 8.0).changes[0]
    speed, frequency = series_crossing(pp.Pipe(0.2), found.speed, found.frequency)
    assert found.speed == pytest.approx(speed, rel=1e-10)
    assert found.frequency == pytest.approx(frequency, rel=1e-9)
    (without_fluid,) = campaign_elements.continuum_changes({"beta": 0.0}, 5.0).changes
    assert without_fluid.speed == pytest.approx(beck_speed(), rel=1e-9)


def test_samples_and_the_bialternate_product_find_the_same_flutter():
    compared = 0
    for index in range(66):
        case = drawn(4, index, ["cantilevered", "overdamped", "aspirating", "with terms"])
        model = eval(case.text, {"pp": pp})
        if isinstance(model, pp.Continuum) or model.dof > 5:
            continue
        system = campaign_reference.system_of(model, *campaign.energy_paths(case.numbers))
        if system.stays_on_axis:
            continue
        static = [one.speed for one in campaign_reference.divergences(system, case.end)]
        one = campaign_reference.bialternate_flutter(system, case.end)
        start = 0.0 if system.damping.any() else 0.01
        other = campaign_reference.sampled_flutter(system, sorted({start, *static, case.end}))
        speeds = [sorted(c.speed for c in found if c.speed > 0.01) for found in (one, other)]
        assert speeds[0] == pytest.approx(speeds[1], rel=1e-8)
        compared += len(speeds[0])
    assert compared > 12


def test_the_campaign_sees_what_is_wrong():
    """Of a case that loses stability three times."""
    case = Case("known", {"beta": 0.295}, "pp.Galerkin({}, 8, 'legendre')", 9.0)
    model = eval(case.text, {"pp": pp})
    true, found = campaign.truth(case, model), list(pp.crossings(model, case.end))
    critical = pp.critical_speed(model, case.end)
    assert len(found) == 3

    def sees(found=found, critical=critical, values=None):
        return bool([*campaign.faults(true, found, critical, 1.0, values)])

    assert not sees()
    assert sees(found[:1])
    assert sees(critical=replace(critical, speed=critical.speed * (1.0 + 3e-9)))
    assert sees([found[0], replace(found[1], speed=found[1].speed + 1e-7), found[2]])
    assert sees(critical=replace(critical, kind="divergence"))
    assert sees([*found[:2], replace(found[2], unstable_after=1)])
    assert sees(values=np.array([1.0 + 2.0j]))
