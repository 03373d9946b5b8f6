# SPDX-License-Identifier: MIT
"""Error against cost: references that know their own error, orders, counts, failures, pictures."""

import csv
import io
import itertools
import math
import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from independent import series_crossing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn import plot
from pipedyn.accuracy.choose import measure_model
from pipedyn.accuracy.convergence import FAMILIES
from pipedyn.accuracy.quantities import (
    CriticalSpeedOf,
    Frequencies,
    LimitCycleAt,
    MotionOf,
    RootLociOver,
)
from pipedyn.orbits.periodic_orbit import ORBIT_STAGES
from pipedyn.util.counters import TookTooLong, count_work, time_limit

PIPE = pp.Pipe(0.2)
DAMPED = pp.Pipe(0.2, damping=1e-3)
EXACT = 5.591404377827069
"""Root of the determinant at beta = 0.2, to rounding (see the first test)."""


@pytest.fixture(scope="module")
def critical():
    families = ["consistent", "uniform", "rayleigh", "consistent pair", "beam", "legendre"]
    chains = (6, 8, 12, 16)
    sizes = dict.fromkeys(families[:2], chains) | {
        "consistent pair": (6, 8, 10, 12),
        "rayleigh": (6, 8, 12, 16, 24),
        "beam": (8, 11, 16, 22),
        "legendre": (2, 6, 7, 8, 9, 10, 16),
    }
    return pp.trade(PIPE, "critical_speed", families=families, sizes=sizes, repeats=1)


# ----------------------------------------------------------------------------------- references


def test_the_reference_of_a_critical_speed_is_a_root_of_the_determinant():
    rng = np.random.default_rng(3)
    for beta in rng.uniform(0.02, 0.98, 4):
        reference = CriticalSpeedOf().reference(pp.Pipe(beta), 1e-10)
        near = pp.critical_speed(pp.Galerkin(pp.Pipe(beta), 12, "legendre"))
        speed, _ = series_crossing(pp.Pipe(beta), near.speed, near.frequency)
        assert abs(reference.values[0] / speed - 1.0) <= reference.error <= 1e-9
    reference = CriticalSpeedOf().reference(PIPE, 1e-10)
    assert abs(reference.values[0] / EXACT - 1.0) <= reference.error


@pytest.mark.parametrize(
    "pipe",
    [pp.Pipe(0.0), pp.Pipe(0.3, flow="aspirating")],
    ids=["Beck's column", "unstable from u = 0 on"],
)
def test_where_no_root_crosses_the_axis_the_reference_is_the_continuous_pipes_too(pipe):
    reference = CriticalSpeedOf().reference(pipe, 1e-8)
    exact = pp.critical_speed(pp.Continuum(pipe))
    assert abs(reference.values[0] - exact.speed) <= reference.error * exact.speed


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
@pytest.mark.parametrize(
    "pipe",
    [pp.Pipe(0.9, gamma=-4.0), pp.Pipe(0.5, damping=0.03), pp.Pipe(0.1, 20.0, flow="aspirating")],
    ids=["undamped", "overdamped", "aspirating"],
)
def test_linear_references_bound_their_own_error(pipe, tolerance):
    """Against 48 functions, twice as many as any of these references takes."""
    for quantity in (Frequencies(u=6.0), RootLociOver(speeds=[0.0, 3.0, 6.0], count=2)):
        reference = quantity.reference(pipe, tolerance)
        sharp = replace(quantity.answer(pp.Galerkin(pipe, 48, "legendre")), candidates=None)
        assert reference.error <= tolerance
        # What 48 functions leave of the overdamped cluster is no better than 1e-12.
        answer = replace(reference, candidates=None)
        assert quantity.distance(answer, sharp) <= reference.error + 1e-12


@pytest.mark.parametrize(
    ("pipe", "quantity", "larger"),
    [
        (DAMPED, MotionOf(u=6.0, duration=2.0, rtol=1e-2), 14),
        (pp.Pipe(0.3, damping=1e-3, drag=1.0), MotionOf(u=8.0, duration=1.5, rtol=1e-2), 16),
        (DAMPED, LimitCycleAt(u=6.0, rtol=1e-2), 13),
    ],
    ids=["motion", "motion under drag", "cycle"],
)
def test_nonlinear_references_bound_their_own_error(pipe, quantity, larger):
    """Against more functions than the reference has, solved ten times as sharply."""
    asked = quantity.solved_for(1e-3).prepared(pipe)
    reference = asked.reference(pipe, 1e-4)
    sharp = asked.solved_for(1e-6).answer(pp.Galerkin(pipe, larger, "legendre"))
    assert reference.error <= 1e-4
    assert asked.distance(reference, sharp) <= reference.error


def test_a_chain_pair_agrees_with_the_reference_of_a_motion_under_drag():
    """Nothing of a chain's drag is integrated by the reduced model's quadrature."""
    pipe = pp.Pipe(0.3, damping=1e-3, drag=1.0)
    found = pp.trade(
        *(pipe, "motion"),
        families=["consistent", "consistent pair"],
        sizes=[16, 32],
        repeats=1,
        u=8.0,
        duration=1.0,
        rtol=1e-7,
    )
    pair, chain = found.of("consistent pair"), found.of("consistent")
    assert pair[-1].error < 0.1 * chain[-1].error
    assert pair[-1].error < 0.3 * pair[0].error


def test_without_a_start_a_motion_sets_out_on_the_least_damped_mode():
    """With its rates as well: at small amplitudes the free end goes as exp(lambda t)."""
    asked = MotionOf(u=6.0, duration=0.5).prepared(DAMPED)
    tip = asked.answer(pp.Galerkin(DAMPED, 10, "legendre")).values[:, 0]
    values = pp.eigenvalues(pp.Continuum(DAMPED), 6.0, 8)
    least = values[np.argmax(values.real)]
    t = np.linspace(0.0, 0.5, tip.size)
    expected = 0.05 * np.real(np.exp(least * t))
    # A motion of 0.07 L is 2 % off by its cubic terms; let go at rest it would be 40 % off.
    assert np.abs(tip - expected).max() < 0.03 * np.abs(expected).max()


# ------------------------------------------------------------------------------ what is measured


def test_errors_fall_as_the_families_do(critical):
    orders = critical.orders()
    assert orders["consistent"].rate == pytest.approx(2.0, abs=0.1)
    assert orders["uniform"].rate == pytest.approx(1.0, abs=0.1)
    assert orders["consistent pair"].rate == pytest.approx(4.4, abs=0.3)
    assert orders["beam"].rate == pytest.approx(4.0, abs=0.3)
    assert orders["legendre"].law == "exponential"
    assert orders["rayleigh"].law == "flat"
    assert abs(orders["rayleigh"].limit) == pytest.approx(0.0144, rel=0.1)


def test_an_error_is_the_distance_from_the_determinant(critical):
    row = critical.of("consistent")[-1]
    speed = pp.critical_speed(pp.Chain(PIPE, row.size)).speed
    assert row.error == pytest.approx(abs(speed / EXACT - 1.0), rel=1e-9)
    assert row.resolved


def test_what_the_reference_cannot_resolve_is_a_bound(critical):
    row = critical.of("legendre")[-1]
    assert not row.resolved
    assert row.error >= critical.reference.error
    assert row.cells[3].startswith("<")
    assert all(row.resolved for row in critical.of("consistent"))


def test_a_model_of_another_kind_of_instability_is_infinitely_wrong():
    answers = [CriticalSpeedOf().answer(pp.Chain(pp.Pipe(0.3, gamma=g), 2)) for g in (0.0, 60.0)]
    assert {answer.kind for answer in answers} == {"flutter", "divergence"}
    assert CriticalSpeedOf().distance(*answers) == math.inf


def test_a_model_that_fails_stays_as_a_row_that_says_why():
    with pytest.raises(pp.NoCrossing, match="no loss of stability up to u = 5"):
        pp.trade(PIPE, "critical_speed", families="consistent", sizes=[8], max_speed=5.0)
    found = pp.trade(
        DAMPED, "limit_cycle", families=["beam", "legendre"], sizes=[2], repeats=1, u=6.0, rtol=1e-3
    )
    assert len(found.rows) == 2
    (row,) = found.failures
    assert (row.family, row.cells[3]) == ("legendre", "failed")
    assert f"legendre {row.size} failed: {row.failure}" in str(found)
    assert math.isnan(row.error)
    assert isinstance(row.failure, pp.NoCycle)
    assert str(row.failure) in found.to_csv().replace('""', '"')


def test_a_model_too_small_for_the_question_is_a_row_that_says_so():
    found = pp.trade(PIPE, "frequencies", families="beam", sizes=[3, 6], repeats=1, count=4)
    small, enough = found.rows
    assert "size must be at least 4" in str(small.failure)
    assert enough.failure is None


def test_none_beats_the_front(critical):
    for cost in ("seconds", "dof", "factorisations"):
        front = critical.pareto(cost)
        assert front
        for row in critical.rows:
            better = [f for f in front if getattr(f, cost) <= getattr(row, cost)]
            assert math.isinf(row.error) or any(f.error <= row.error for f in better)


def test_sizes_are_numbers_or_go_by_the_words_for_families():
    found = pp.trade(PIPE, "critical_speed", families="legendre", sizes=8, repeats=1)
    assert [row.size for row in found.rows] == [8]
    sizes = {"chain": [4, 5], "legendre": 6}
    found = pp.trade(PIPE, "frequencies", families=[*sizes], sizes=sizes, repeats=1)
    assert [row.size for row in found.of("legendre")] == [6]
    assert [row.size for row in found.of("midpoint")] == [4, 5]
    assert [row.size for row in found.of("rayleigh")] == [4, 5]


@pytest.mark.parametrize("ask", [pp.trade, pp.choose])
def test_a_start_that_does_not_move_is_refused(ask):
    asked = {"tolerance": 1e-2} if ask is pp.choose else {}
    with pytest.raises(ValueError, match="start must bend the pipe"):
        ask(PIPE, "motion", u=6.0, duration=1.0, start=lambda s: 0.0 * s, **asked)


# -------------------------------------------------------------------------------------- counts


@pytest.mark.parametrize("method", ["scipy:LSODA", "scipy:Radau"])
def test_an_implicit_motion_counts_its_factorisations(method):
    chain = pp.Chain(pp.Pipe(0.2, damping=0.1), 6)
    with count_work() as counters:
        pp.simulate(*(chain, 6.0, 1.0, lambda s: 0.05 * s**2), method=method, rtol=1e-8, atol=1e-10)
    start = np.concatenate([chain.bent(lambda s: 0.05 * s**2), np.zeros(6)])
    peer = solve_ivp(
        *(lambda t, y: chain.rhs(t, y, 6.0), (0.0, 1.0), start),
        method="LSODA" if method == "scipy:LSODA" else "Radau",
        jac=lambda t, y: chain.jacobian(t, y, 6.0),
        rtol=1e-8,
        atol=1e-10,
    )
    assert 0.5 < counters.factorisations / peer.nlu < 2.0


def test_a_row_has_the_counts_of_one_answer():
    family, asked = FAMILIES["legendre"], CriticalSpeedOf()
    reference = asked.reference(PIPE, 1e-6)
    row = measure_model(PIPE, asked, family, 6, reference, 3)
    with count_work() as counters:
        asked.answer(family.make(PIPE, 6))
    assert row.factorisations == counters.factorisations > 10
    assert row.right_hand_sides == 0


def test_motions_cycles_and_eigenvalue_problems_count_what_they_do():
    with count_work() as counters:
        motion = pp.simulate(pp.Chain(DAMPED, 6), 6.0, 1.0, lambda s: 0.05 * s**2, method="dop853")
    assert counters.right_hand_sides == motion.evaluations
    assert counters.factorisations == 0
    with count_work() as counters:
        cycle = pp.limit_cycle(pp.Galerkin(DAMPED, 3, "legendre"), 6.0)
    assert counters.right_hand_sides >= cycle.evaluations
    assert counters.factorisations > cycle.phases / ORBIT_STAGES  # each interval's, at least
    with count_work() as outer:
        with count_work() as inner:
            pp.eigenvalues(pp.Galerkin(PIPE, 6), 3.0)
        pp.eigenvalues(pp.Galerkin(PIPE, 6), 3.0)
    assert inner.factorisations == outer.factorisations == 2


# ------------------------------------------------------------------------------ how it is shown


def test_the_table_says_what_the_rows_do_and_goes_to_a_file(critical, tmp_path):
    text, page = str(critical), critical._repr_html_()
    assert "reference: Continuum, 25 Legendre functions" in text
    assert text.count("\n") == len(critical.rows) + 2
    assert page.count("<tr>") == len(critical.rows) + 1
    text = critical.to_csv(tmp_path / "trade.csv")
    assert (tmp_path / "trade.csv").read_text(encoding="utf-8") == text
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [float(row["error"]) for row in rows] == [row.error for row in critical.rows]
    assert {row["resolved"] for row in rows} == {"True", "False"}


@pytest.mark.parametrize("cost", ["seconds", "dof", "factorisations"])
def test_the_picture_shows_every_row_and_the_front(critical, cost):
    figure = Figure()
    FigureCanvasAgg(figure)
    ax = plot.trade(critical, cost, ax=figure.subplots())
    figure.canvas.draw()
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels[-2:] == ["Pareto front", "below the error of the reference"]
    assert labels[:-2] == [label for label in labels if label.split(":")[0] in critical.families]
    second = next(label for label in labels if label.startswith("consistent:"))
    assert float(second.removeprefix("consistent: order ")) == pytest.approx(2.0, abs=0.05)
    low, high = ax.get_ylim()
    shown = [row.error for row in critical.rows if math.isfinite(row.error)]
    assert low < min(shown) < max(shown) < high
    bounds = [row for row in critical.rows if not row.resolved]
    assert len([text for text in ax.texts if not text.get_text()]) == len(bounds)


def test_a_picture_without_right_hand_sides_says_so(critical):
    with matplotlib.rc_context():
        figure = Figure()
        ax = plot.trade(critical, "right_hand_sides", ax=figure.subplots())
    assert "No model" in ax.texts[0].get_text()


def test_a_picture_has_no_front_where_the_best_has_no_such_cost(critical):
    best = min(critical.rows, key=lambda row: row.error)
    rows = [replace(row, factorisations=0) if row is best else row for row in critical.rows]
    ax = plot.trade(replace(critical, rows=tuple(rows)), "factorisations", ax=Figure().subplots())
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "Pareto front" not in labels


# ------------------------------------------------------------------------------------ bad input


MOTION = {"u": 1.0, "duration": 1.0}


@pytest.mark.parametrize(
    ("quantity", "given", "error", "message"),
    [
        ("motion", {}, TypeError, "'motion' takes u, .* lacks u, duration"),
        ("frequencies", {"v": 1.0}, TypeError, "takes u, count, dimensions, got 'v'"),
        ("root_loci", {"speeds": [2.0, 1.0]}, ValueError, "strictly increasing"),
        ("motion", MOTION | {"start": [0.1]}, TypeError, "start must be a function of arc lengths"),
        ("motion", MOTION | {"rates": np.sin}, ValueError, "rates must come with a start"),
        ("critical_speed", {"families": "rod"}, ValueError, "families must be one of 'chain'"),
        ("critical_speed", {"families": np.array("beam")}, TypeError, "families must be words"),
    ],
)
def test_bad_arguments_are_refused(quantity, given, error, message):
    with pytest.raises(error, match=message):
        pp.trade(quantity=quantity, **{"pipe": PIPE} | given)


# ---------------------------------------------------------------------------------- an end to it


def test_a_reference_whose_next_model_fails_serves_as_far_as_it_got():
    """The third model has no start: what the second moved the first by is the error."""
    calls = itertools.count(1)

    def start(s):
        if next(calls) == 4:  # the first call is to see whether it bends the pipe
            raise pp.PipedynError("no such start")
        return 0.1 * np.sin(0.5 * np.pi * s)

    asked = {"u": 7.0, "duration": 1.0, "start": start}
    table = pp.trade(DAMPED, "motion", families="legendre", sizes=5, **asked)
    words = r"Galerkin, (\d+) legendre functions, as that of (\d+) failed"
    size, failed = map(int, re.fullmatch(words, table.reference.source).groups())
    assert failed == size + 2
    ask = table.quantity
    moved = ask.distance(
        *(ask.answer(pp.Galerkin(DAMPED, n, "legendre")) for n in (size - 2, size))
    )
    assert table.reference.error == pytest.approx(moved, rel=1e-6)
    assert not table.rows[0].resolved or table.rows[0].error >= 10.0 * moved


def test_a_reference_of_which_nothing_is_known_in_time_is_refused(monkeypatch):
    monkeypatch.setattr("pipedyn.accuracy.quantities.LONGEST_REFERENCE", 0.0)
    with pytest.raises(pp.NotConverged, match="functions was not done in 0 s"):
        pp.trade(pp.Pipe(0.2), "motion", u=4.0, duration=1.0)
    with pytest.raises(pp.NotConverged, match="functions was not done in 0 s"):
        pp.choose(pp.Pipe(0.2), "limit_cycle", 1e-2, u=6.0)


def test_a_reference_that_no_larger_model_confirms_is_refused():
    """At u = 50 the pipe coils at once, and 20 functions do not follow."""
    with pytest.raises(pp.NotConverged, match=r"not known: Galerkin, 20 .* moved it by"):
        pp.trade(pp.Pipe(0.2), "motion", u=50.0, duration=0.1, rtol=1e-3)


@pytest.mark.parametrize("method", ["dop853", "scipy:LSODA"])
def test_a_computation_ends_with_its_time(method):
    chain = pp.Chain(pp.Pipe(0.2, damping=1e-3), 20)
    with pytest.raises(TookTooLong, match=r"more than 0\.1 s"), time_limit(60.0), time_limit(0.1):
        pp.simulate(chain, 6.0, 1e3, 0.1 * np.ones(20), samples=2, method=method)
    with pytest.raises(TookTooLong), time_limit(0.01):
        pp.limit_cycle(pp.Galerkin(pp.Pipe(0.2), 16, "legendre"), 6.0)
    pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 2), 6.0)


def test_an_ensemble_that_takes_too_long_is_no_failure_of_its_members():
    with time_limit(0.0), pytest.raises(TookTooLong):
        pp.simulate_many(pp.Chain(PIPE, 2), [4.0, 5.0], 100.0, lambda s: 0.1 * s, method="dop853")
