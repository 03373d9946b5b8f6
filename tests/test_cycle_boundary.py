# SPDX-License-Identifier: MIT
"""Folds of cycles, symmetry-breaking pitchforks, period doublings and tori in two numbers.

They are held against events of branches at fixed values of the second number, against multipliers
from the variational equation as scipy integrates it, and, where curves end at an onset, against the
normal form of flutter.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy
from matplotlib.figure import Figure

import pipedyn as pp
from pipedyn import plot
from pipedyn.continuation.arclength import Control
from pipedyn.curves.event_plane import plane_of
from pipedyn.curves.event_problem import EventProblem

BETA = 0.05
FOUR = pp.Chain(pp.Pipe(0.09, gamma=200.0), 4)
FORCED = pp.Galerkin(pp.Pipe(0.2, damping=0.002), 3, "legendre")


def folds(branch):
    return [event for event in branch.events if event.kind == "fold"]


@cache
def cycles_of(model, speeds):
    (branch,) = pp.bifurcation_diagram(model, speeds, cycles=8, rtol=1e-3).cycles
    return branch


@cache
def response(u=0.0, amplitude=0.02, low=15.5, high=21.0):
    base = pp.Harmonic(amplitude, 20.0)
    return pp.forced_response(FORCED, u, base=base, frequencies=(low, high)).branches[0]


@pytest.fixture(scope="module")
def subcritical():
    """The branch of two segments, which has one fold, below the onset."""
    (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(BETA), 2), [3.0, 3.3]).cycles
    return branch


@pytest.fixture(scope="module")
def folded(subcritical):
    """Its fold over beta."""
    (fold,) = folds(subcritical)
    return pp.cycle_boundary(subcritical, fold, "beta", "u", {"beta": (0.02, 0.2), "u": (2.0, 5.0)})


@pytest.fixture(scope="module")
def three():
    """Cycles of three segments, which lose their symmetry, double their period, leave for tori."""
    return pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.3), 3), [6.7, 7.4])


def monodromy(model, orbit, span):
    """What perturbations become over a phase, by the variational equation along the motion.

    The Jacobian is a central difference of the rates.
    """
    n, h = model.dof, 1e-6
    y0 = orbit.states(np.array([0.0]))[:, 0]

    def rates(y):
        return model.rhs(0.0, y, orbit.u)

    def both(_, z):
        y, moved = z[: 2 * n], z[2 * n :].reshape(2 * n, 2 * n)
        all_at_once = rates(np.hstack([y[:, None] + h * moved, y[:, None] - h * moved, y[:, None]]))
        ahead, behind, here = np.split(all_at_once, [2 * n, 4 * n], axis=1)
        return np.concatenate([here[:, 0], ((ahead - behind) / (2.0 * h)).ravel()])

    start = np.concatenate([y0, np.eye(2 * n).ravel()])
    time = span / orbit.frequency
    found = scipy.integrate.solve_ivp(both, (0.0, time), start, "DOP853", rtol=1e-9, atol=1e-8)
    end = found.y[:, -1]
    return y0, end[: 2 * n], end[2 * n :].reshape(2 * n, 2 * n)


def model_at(found, i):
    """The chain at a point of the curve in (beta, u)."""
    return found.model.with_pipe(replace(found.model.pipe, beta=float(found.curves[0].x[i])))


def test_folds_at_other_mass_ratios_are_those_of_the_bifurcation_diagram(subcritical, folded):
    curve = folded.curves[0]
    assert folded.names == ("beta", "u")
    assert curve.kind == "fold"
    assert curve.x[0] == pytest.approx(0.02, abs=1e-12)
    (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.02), 2), [2.9, 3.1]).cycles
    (fold,) = folds(branch)
    assert curve.y[0] == pytest.approx(fold.speed, abs=1e-8)
    assert curve.amplitude[0] == pytest.approx(fold.amplitude, abs=1e-5)
    begin = int(np.flatnonzero(np.isclose(curve.x, BETA, rtol=1e-12))[0])
    (event,) = folds(subcritical)
    assert curve.y[begin] == pytest.approx(event.speed, abs=1e-8)
    assert (np.diff(curve.x) > 0.0).all()
    assert (curve.unstable == 0).all()
    assert (curve.opens == 1).all()
    assert (curve.y[:-1] < curve.onset[:-1]).all()


def test_at_a_fold_a_second_multiplier_is_one(folded):
    """1 is then a double root of the characteristic polynomial of the monodromy matrix."""
    curve = folded.curves[0]
    for i in (1, len(curve) // 2):
        orbit = curve.orbits[i]
        y0, end, moved = monodromy(model_at(folded, i), orbit, 2.0 * math.pi)
        assert np.abs(end - y0).max() < 1e-8
        polynomial = np.poly(moved)
        assert abs(np.polyval(polynomial, 1.0)) < 1e-6
        assert abs(np.polyval(np.polyder(polynomial), 1.0)) < 1e-6
        assert abs(np.polyval(np.polyder(polynomial, 2), 1.0)) > 0.1


def test_folds_end_where_the_criticality_of_flutter_changes(folded):
    """There the first Lyapunov coefficient is 0, which comes from the normal form alone."""
    (point,) = folded.points
    assert point.kind == "Bautin"
    assert folded.curves[0].ends == ("range", "Bautin")

    def lyapunov(beta):
        return pp.hopf(pp.Chain(pp.Pipe(beta), 2)).lyapunov

    beta = scipy.optimize.brentq(lyapunov, 0.07, 0.1, xtol=1e-7)
    assert point.x == pytest.approx(beta, abs=2e-5)
    assert point.y == pytest.approx(pp.critical_speed(pp.Chain(pp.Pipe(beta), 2)).speed, abs=2e-5)
    assert point.amplitude == 0.0


@pytest.mark.slow
def test_folds_of_a_stiff_model_end_where_the_criticality_changes():
    """Near the end the conditions' rounding errors must not turn the curve's tangents."""
    model = pp.Galerkin(pp.Pipe(0.01, gamma=300.0), 14, "legendre")
    (fold,) = folds(branch := cycles_of(model, (11.71, 11.72)))
    window = {"beta": (0.01, 0.03), "u": (11.0, 12.6)}
    found = pp.cycle_boundary(branch, fold, "beta", "u", window)
    (curve,), end = found.curves, found.points[-1]
    assert curve.ends == ("range", "Bautin")
    assert [point.kind for point in found.points] == ["cusp", "Bautin"]
    below, there, above = (
        model.with_pipe(replace(model.pipe, beta=end.x + by)) for by in (-1e-6, 0.0, 1e-6)
    )
    assert pp.hopf(below).lyapunov > 0.0 > pp.hopf(above).lyapunov
    assert end.y == pytest.approx(pp.critical_speed(there).speed, rel=1e-7)
    i = int(np.flatnonzero(curve.amplitude > 0.01)[-1])
    plane = plane_of(branch, "beta", "u", window)
    event = EventProblem(plane, "fold", curve.orbits[i], curve.x[[i]], Control(longest=1.0))
    along = event.linearised(event.origin)(event.weights, 1.0, 0.0)
    near = slice(i - 1, i + 2)
    parabola = np.polyfit(curve.frequency[near] - curve.frequency[i], curve.x[near], 2)
    assert along[-1] / along[-3] == pytest.approx(parabola[1], rel=0.02)


def test_with_drag_folds_go_on_at_small_amplitudes_as_long_as_there_is_no_onset():
    """At the end of the range, beta = 0.02, the amplitude is 0.0021 L."""
    (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(BETA, drag=0.05), 2), [3.0, 3.3]).cycles
    ranges = {"beta": (0.02, 0.2), "u": (2.0, 5.0)}
    found = pp.cycle_boundary(branch, folds(branch)[0], "beta", "u", ranges)
    (curve,) = found.curves
    assert curve.ends == ("range", "range")
    assert curve.x[[0, -1]].tolist() == [0.02, 0.02]
    assert [point.kind for point in found.points] == ["cusp"]
    ends = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.02, drag=0.05), 2), [3.03, 3.1]).cycles[0]
    assert curve.y[0] == pytest.approx(folds(ends)[0].speed, abs=1e-6)
    assert curve.amplitude[-1] < 0.003
    assert curve.y[-1] == pytest.approx(curve.onset[-1], abs=1e-5)


def test_folds_shrink_to_the_onset_as_the_drag_falls_to_0():
    """No step leads there, as there is no pipe beyond it."""
    chain = pp.Chain(pp.Pipe(0.049, gamma=4.6), 2)
    speed = pp.critical_speed(chain).speed
    branch = pp.bifurcation_diagram(chain, [0.97 * speed, 1.05 * speed, 1.15 * speed]).cycles[0]
    ranges = {"drag": (0.0, 1.0), "u": (0.5 * speed, 2.5 * speed)}
    found = pp.cycle_boundary(branch, folds(branch), "drag", "u", ranges)
    assert found.curves[0].ends == ("range", "Hopf")
    cusp, end = found.points
    assert (cusp.kind, end.kind) == ("cusp", "Hopf")
    assert (end.x, end.y) == pytest.approx((0.0, speed), abs=1e-6)
    assert found.failures == ()
    # Drag has no part in small motions: the onset is level.
    assert found.curves[0].onset == pytest.approx(speed, rel=1e-12)
    (bound,) = (curve for curve in found.onsets.curves if abs(curve.y[0] - speed) < 0.1)
    assert bound.y == pytest.approx(speed, rel=1e-12)
    assert {tuple(sides) for sides in bound.sides.tolist()} in ({(2, 0)}, {(0, 2)})
    assert [found.onsets.unstable(0.5, speed + way) for way in (-0.1, 0.1)] == [0, 2]


def test_two_events_at_once_are_named_where_other_multipliers_pass_the_circle():
    """On the fold of four segments a pitchfork's multiplier passes, too."""
    branch = cycles_of(FOUR, (9.57, 9.573))
    window = {"beta": (0.05, 0.2), "u": (8.0, 13.0)}
    found = pp.cycle_boundary(branch, folds(branch)[0], "beta", "u", window)
    (curve,), (point,) = found.curves, [p for p in found.points if p.kind == "fold-pitchfork"]
    before, after = curve.unstable[curve.x < point.x], curve.unstable[curve.x > point.x]
    assert abs(before[-1] - after[0]) == 1
    end = next(p for p in found.points if p.kind == "Bautin")
    at = pp.critical_speed(FOUR.with_pipe(replace(FOUR.pipe, beta=end.x))).speed
    assert end.y == pytest.approx(at, abs=1e-6)


@pytest.mark.parametrize("kind", ["pitchfork", "period doubling", "torus"])
def test_multipliers_on_the_unit_circle(three, kind):
    """-1 at a period doubling, e^(i theta) at a torus; with the reflection -1 at a pitchfork.

    Other multipliers are as large as 1,000, and all are known relative to the largest.
    """
    branch, event = next(
        (b, e) for b in three.cycles for e in b.events if e.kind == kind and e.speed != b.onset
    )
    window = {"beta": (0.3, 0.4), "u": (event.speed - 0.02, 9.0)}
    found = pp.cycle_boundary(branch, event, "beta", "u", window)
    (curve,) = found.curves
    assert curve.kind == kind
    assert curve.ends == ("range", "range")
    assert found.failures == ()
    assert (curve.x[0], curve.y[-1]) == pytest.approx((0.3, event.speed - 0.02), abs=1e-10)
    for i, orbit in list(enumerate(curve.orbits))[-1:]:
        halved = orbit.span < 0.9 * 2.0 * math.pi
        assert halved == (kind != "period doubling")
        y0, end, moved = monodromy(model_at(found, i), orbit, orbit.span)
        assert np.abs(end - orbit.mirror_sign * y0).max() < 1e-6 * np.abs(y0).max()
        root = -1.0
        if kind == "torus":
            assert abs(curve.multiplier[i]) == pytest.approx(1.0, abs=1e-12)
            assert curve.multiplier[i].imag > 0.1
            root = np.sqrt(curve.multiplier[i])
        units = np.where(np.arange(len(y0)) < len(y0) // 2, 1.0, orbit.frequency)
        scaled = orbit.mirror_sign * moved * units / units[:, None]
        sizes = [np.linalg.svd(scaled - sign * root * np.eye(len(y0)))[1] for sign in (1.0, -1.0)]
        nearest = min(s[-1] / s[0] for s in sizes[: 1 + (kind == "torus")])
        assert nearest < 1e-6
        others = np.linalg.eigvals(scaled)
        assert np.sort(np.abs(others - 1.0))[1] > 1e-2  # only the trivial one is 1


def test_a_pitchfork_is_followed_from_either_branch_that_meets_there(three):
    """Also from that of cycles without mirror symmetry, which it is the beginning of."""
    ranges = {"beta": (0.2, 0.4), "u": (6.70, 6.75)}
    found = []
    for branch in three.cycles[:2]:
        (event,) = (one for one in branch.events if one.kind == "pitchfork")
        found += pp.cycle_boundary(branch, event, "beta", "u", ranges).curves
    symmetric, other = found
    assert not three.cycles[1].cycles[0].symmetric
    assert other.ends == symmetric.ends == ("range", "range")
    for name in ("x", "y", "frequency"):
        ends = [getattr(curve, name)[[0, -1]] for curve in found]
        assert ends[0] == pytest.approx(ends[1], rel=1e-8)
    assert other.orbits[0].symmetric


def test_a_period_doubling_is_followed_from_the_cycles_of_twice_the_period(three):
    branch = three.cycles[1]
    (event,) = (one for one in branch.events if one.kind == "period doubling")
    near = min(branch.cycles, key=lambda cycle: abs(cycle.u - event.speed))
    twice = replace(near, orbit=near.orbit.doubled())
    rest = {"amplitudes": np.array([near.amplitude]), "speeds": np.array([near.u])}
    changed = replace(branch, origin="period doubling", onset=event.speed, cycles=(twice,), **rest)
    ranges = {"beta": (0.3, 0.4), "u": (7.32, 9.0)}
    (curve,) = pp.cycle_boundary(changed, event, "beta", "u", ranges).curves
    assert curve.y[0] == pytest.approx(event.speed, abs=2.0 * event.error)
    assert curve.frequency[0] == pytest.approx(near.frequency, rel=0.02)


def test_folds_of_forced_motions_over_the_amplitude_of_the_forcing():
    """Both folds of a resonance that bends over lie on one curve, which ends in a cusp below."""
    branch = response()
    first, second = folds(branch)
    window = {"amplitude": (0.001, 0.02), "frequency": (12.0, 30.0)}
    found = pp.cycle_boundary(branch, (first, second), "amplitude", "frequency", window)
    (curve,) = found.curves
    (cusp,) = found.points
    assert cusp.kind == "cusp"
    assert cusp.x == curve.x.min()
    assert curve.ends == ("range", "range")
    assert found.names == ("amplitude", "frequency")
    assert curve.y[[0, -1]] == pytest.approx([second.frequency, first.frequency], rel=1e-6)
    near = 0.98 * cusp.y, 1.02 * cusp.y
    assert folds(response(0.0, 0.97 * cusp.x, *near)) == []
    assert len(folds(response(0.0, 1.05 * cusp.x, *near))) == 2


def test_folds_of_forced_motions_over_the_flow_speed():
    """They are those of the response at the other end of the range."""
    branch, window = response(), {"u": (0.0, 0.4), "frequency": (12.0, 30.0)}
    (curve,) = pp.cycle_boundary(branch, folds(branch)[0], "u", "frequency", window).curves
    assert curve.x[[0, -1]].tolist() == [0.0, 0.4]
    assert curve.ends == ("range", "range")
    assert curve.y[-1] == pytest.approx(folds(response(0.4))[0].frequency, rel=1e-6)


def test_a_curve_that_cannot_be_followed_says_where_and_keeps_what_it_has(subcritical):
    """Without fluid mass there is no such fold: flow and stiffness alone keep the energy."""
    (fold,) = folds(subcritical)
    window = {"u": (2.0, 5.0), "beta": (0.0, 0.2)}
    found = pp.cycle_boundary(subcritical, fold, "u", "beta", window)
    (curve,) = found.curves
    assert curve.ends == ("not converged", "Bautin")
    assert len(curve) > 5
    beyond = f"({curve.x[0]:.6g}, {curve.y[0]:.6g})"
    (only,) = found.failures
    assert only.startswith(f"the fold was not followed beyond {beyond}: ")
    assert found.names == ("u", "beta")


@pytest.mark.parametrize("ends", [(BETA, 0.2), (0.02, BETA), (0.0, 0.2)])
def test_the_onset_is_followed_from_an_edge_of_the_range(subcritical, ends):
    window = {"beta": ends, "u": (3.12, 3.14)}
    (curve,) = pp.cycle_boundary(subcritical, folds(subcritical)[0], "beta", "u", window).curves
    for beta, onset in zip(curve.x, curve.onset, strict=True):
        known = pp.critical_speed(pp.Chain(pp.Pipe(float(beta)), 2)).speed
        assert onset == pytest.approx(known, rel=1e-10)


def test_where_the_onset_cannot_be_followed_it_says_why():
    """The straight pipe is no equilibrium of an inclined jet."""
    (branch,) = pp.bifurcation_diagram(
        pp.Chain(pp.Pipe(BETA, jet_angle=0.01), 2), [3.0, 3.3]
    ).cycles
    window = {"beta": (0.02, 0.2), "u": (3.12, 3.14)}
    found = pp.cycle_boundary(branch, folds(branch)[0], "beta", "u", window)
    assert found.onsets is None
    assert np.isnan(found.curves[0].onset).all()
    (only,) = found.failures
    assert only.startswith("the onset of flutter was not followed over beta: the straight pipe")


HANGING = pp.Galerkin(pp.Pipe(0.01, gamma=300.0), 10, "legendre")


@pytest.mark.parametrize(
    ("model", "speeds", "end", "speeds_there"),
    [
        (FOUR, (9.57, 9.573), 0.092, (9.58, 9.585)),
        pytest.param(
            *(HANGING, (11.704, 11.707), 0.0101, (11.708, 11.711)), marks=pytest.mark.slow
        ),
    ],
    ids=["four segments", "gamma = 300"],
)
def test_folds_of_four_segments_and_of_the_long_hanging_pipe(model, speeds, end, speeds_there):
    """At the other end of the range they are those of the branch there; rest is stable above."""
    begin = model.pipe.beta
    other = model.with_pipe(replace(model.pipe, beta=end))
    branch, there = cycles_of(model, speeds), cycles_of(other, speeds_there)
    (fold,), (fold_there,) = folds(branch), folds(there)
    found = pp.cycle_boundary(branch, fold, "u", "beta", {"u": (9.0, 13.0), "beta": (begin, end)})
    (curve,) = found.curves
    assert curve.ends == ("range", "range")
    assert curve.y[[0, -1]].tolist() == [begin, end]
    assert curve.x[[0, -1]] == pytest.approx([fold.speed, fold_there.speed], rel=1e-8)
    onsets = [pp.critical_speed(one).speed for one in (model, other)]
    assert curve.onset[[0, -1]] == pytest.approx(onsets, rel=1e-9)
    assert (curve.unstable == 0).all()
    assert (curve.opens == 1).all()
    assert (curve.x < curve.onset).all()
    shade = plot.cycle_boundary(found, ax=Figure().subplots()).collections[0]
    corners = np.concatenate([path.vertices for path in shade.get_paths()])
    assert np.ptp(corners[:, 0]) == pytest.approx(onsets[1] - fold.speed, rel=1e-4)
    assert np.ptp(corners[:, 1]) == pytest.approx(end - begin, rel=1e-9)


@pytest.mark.parametrize("m", [4, 12, 30])
def test_the_mirror_of_a_model_of_many_functions_is_seen(m):
    """The states that show it are bent by 0.3 rad, not each of their functions."""
    onset = pp.hopf(pp.Galerkin(pp.Pipe(0.01, gamma=300.0), m, "beam"))
    u = onset.speed + math.copysign(1e-3, onset.amplitude_law)
    assert pp.limit_cycle(onset.model, u, onset, rtol=1e-2).symmetric


WINDOW = {"beta": (0.02, 0.2), "u": (2.0, 5.0)}


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"branch": 3}, TypeError, "branch must be a CycleBranch or a ForcedBranch, got 3"),
        ({"events": 3}, TypeError, "events must be one or more events, got 3"),
        ({"events": []}, TypeError, "events must be one or more events"),
        ({"events": ["fold"]}, TypeError, "events must be CycleEvents, got 'fold'"),
        ({"events": "onset"}, ValueError, "events must be of kind fold, pitchfork"),
        ({"events": "foreign"}, ValueError, "events must be the branch's"),
        ({"x": 3}, TypeError, "x must be a name, got 3"),
        ({"x": "u"}, ValueError, "x or y must be 'u', and the other not"),
        ({"x": "betta"}, ValueError, "x must be one of 'u', 'beta', 'gamma'"),
        (
            {"x": "hysteresis"},
            ValueError,
            "a pipe with hysteresis has no equation of motion in time",
        ),
        ({"x": "jet_angle"}, ValueError, "x must leave the pipe the mirror symmetry"),
        ({"ranges": 3}, TypeError, "ranges must map x and y to .low, high., got 3"),
        ({"ranges": {"beta": (0.0, 0.1)}}, ValueError, "ranges must have 'beta' and 'u', got"),
        (
            {"ranges": WINDOW | {"beta": (0.2, 0.02)}},
            ValueError,
            "must be .low, high., got .0.2, 0.02.",
        ),
        (
            {"ranges": WINDOW | {"beta": (0.02, 1.2)}},
            ValueError,
            "ranges.'beta'. must lie in .0, 1., got 1.2",
        ),
        ({"ranges": WINDOW | {"u": (-1.0, 5.0)}}, ValueError, "must lie in .0, .*got -1"),
        (
            {"ranges": WINDOW | {"u": (4.0, 5.0)}},
            ValueError,
            "ranges must hold the event: u is 3.12",
        ),
    ],
)
def test_bad_arguments(subcritical, change, error, text):
    (fold,) = folds(subcritical)
    other = {"onset": subcritical.events[0], "foreign": replace(fold, speed=3.0)}
    events = change.get("events", fold)
    given = {"branch": subcritical, "x": "beta", "y": "u", "ranges": WINDOW} | change
    given["events"] = other.get(events, events) if isinstance(events, str) else events
    if given["x"] not in (3, "u", "beta"):
        given["ranges"] = {given["x"]: (0.0, 0.5), "u": (2.0, 5.0)}
    with pytest.raises(error, match=text):
        pp.cycle_boundary(**given)


def test_the_picture_shades_where_the_pipe_may_snap(folded):
    ax = plot.cycle_boundary(folded, ax=Figure().subplots())
    (shade,) = ax.collections
    assert shade.get_label() == "rest and flutter both stable"
    # The region that is shaded lies between the fold and the onset.
    for path in shade.get_paths():
        for beta, u in path.vertices:
            onset = pp.critical_speed(pp.Chain(pp.Pipe(float(beta)), 2)).speed
            assert u <= onset + 1e-4
    labels = [line.get_label() for line in ax.lines]
    assert labels == ["fold of a stable cycle", "the straight pipe becomes unstable", "Bautin"]
    with pytest.raises(TypeError, match="found must be of type CycleBoundary"):
        plot.cycle_boundary(3)


def test_the_picture_in_si_has_the_speeds_of_pipes_of_each_mass_ratio(folded):
    numbers = {"length": 0.45, "bending_stiffness": 7.3e-3, "gravity": 0.0}
    hose = pp.Pipe.from_si(**numbers, pipe_mass=0.19, fluid_mass=0.01)
    of_hose = replace(folded, model=pp.Chain(hose, 2))
    before, after = (
        plot.cycle_boundary(of_hose, units=units, ax=Figure().subplots())
        for units in ("nondimensional", "si")
    )
    for line, in_si in zip(before.lines, after.lines, strict=True):
        for k in 0, -1:
            (beta, u), (same, speed) = line.get_xydata()[k], in_si.get_xydata()[k]
            fluid = 0.2 * beta
            pipe = pp.Pipe.from_si(**numbers, pipe_mass=0.2 - fluid, fluid_mass=fluid)
            assert (same, speed) == pytest.approx((beta, pipe.speed_si(u)), rel=1e-9)
    (shade,) = after.collections
    lowest = min(after.lines[0].get_ydata())
    assert min(y for path in shade.get_paths() for _, y in path.vertices) >= lowest * (1.0 - 1e-9)
