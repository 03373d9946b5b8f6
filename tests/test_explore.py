# SPDX-License-Identifier: MIT
"""`plot.explore`: what it shows after each move is what the public functions answer."""

import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import pipedyn as pp
from pipedyn import plot

PIPE = pp.Pipe(
    0.3,
    5.0,
    damping=0.002,
    terms=[pp.PointMass(1.0, 0.1), pp.Spring(0.5, 3.0), pp.Spring(0.8, 1.0)],
    root=pp.RootSpring(4.0),
)
HOSE = pp.Pipe.from_si(
    length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.032, damping_time=2e-3
)
MOVES = {
    "u": 3.5,
    "beta": 0.55,
    "gamma": -4.0,
    "damping": 0.01,
    "segments": 4,
    "root.stiffness": 6.0,
    "PointMass.mass": 0.05,
    "terms[1].stiffness": 2.0,
    "terms[2].stiffness": 0.0,
}


def moved_pipe():
    """The pipe after all moves, made by hand."""
    terms = [pp.PointMass(1.0, 0.05), pp.Spring(0.5, 2.0), pp.Spring(0.8, 0.0)]
    return pp.Pipe(0.55, -4.0, damping=0.01, terms=terms, root=pp.RootSpring(6.0))


def drawn(state):
    """Lines and collections of the picture by their name or label."""
    state.picture.update()
    axes = state.picture.axes
    artists = [artist for ax in axes for artist in (*ax.lines, *ax.collections)]
    return {artist.get_gid() or artist.get_label(): artist for artist in artists}


def test_there_is_a_slider_for_each_number_that_is_asked_for_and_each_of_a_term():
    assert list(plot.Exploration(PIPE, 5).values) == list(MOVES)
    assert list(plot.Exploration(pp.Pipe(0.2), 5).values) == list(MOVES)[:5]
    ranges = {"hysteresis": (0.0, 0.1), "segments": (2.0, 8.0)}
    nozzle = plot.Exploration(pp.Pipe(0.2, alpha=1.4), 5, ranges=ranges)
    assert list(nozzle.values)[5:] == ["alpha", "hysteresis"]
    assert nozzle.sliders["segments"] == (2.0, 8.0)


@pytest.mark.parametrize("order", [list(MOVES), list(MOVES)[::-1]])
def test_answers_are_those_of_the_public_functions_after_each_move(order):
    state = plot.Exploration(PIPE, 5, 2.0, ranges={"u": (0.0, 8.0)})
    for name in order:
        state.set(name, MOVES[name])
    pipe = moved_pipe()
    model = pp.Chain(pipe, 4)
    loci = pp.root_loci(model, np.linspace(0.0, 8.0, state.loci.speeds.size))
    assert np.array_equal(state.loci.eigenvalues, loci.eigenvalues)
    values = pp.eigenvalues(model, 3.5)
    assert [mode.eigenvalue for mode in state.modes] == list(values[values.imag >= 0.0])
    assert state.least_stable.eigenvalue.real == values.real.max()
    assert state.critical.speed == pp.critical_speed(model).speed
    betas = state.curve.values
    each = [pp.critical_speed(pp.Chain(replace(pipe, beta=beta), 4)).speed for beta in betas]
    assert state.curve.speeds == pytest.approx(each, rel=1e-12)


def test_artists_have_the_data_of_the_answers():
    state = plot.Exploration(PIPE, 5, 2.0, against="PointMass.mass", ranges={"u": (0.0, 8.0)})
    for name, value in MOVES.items():
        state.set(name, value)
        shown = drawn(state)
        values = np.array([mode.eigenvalue for mode in state.modes])
        for gid, chosen in ("roots", values.real < 0.0), ("growing roots", values.real > 0.0):
            roots = np.column_stack([values.real, values.imag])[chosen]
            assert np.array_equal(shown[gid].get_xydata(), roots)
        loci = state.picture.axes[0].collections[0]
        ends = {tuple(end) for one in loci.get_segments() for end in one}
        upper = state.loci.eigenvalues[:, 0]
        assert {(z.real, abs(z.imag)) for z in upper.tolist()} <= ends
        onset = np.column_stack([state.curve.values, state.curve.speeds])
        assert np.array_equal(shown["onset"].get_xydata(), onset)
        place = [state.values["PointMass.mass"], state.values["u"]]
        assert shown["place"].get_xydata().tolist() == [place]


def test_after_many_moves_the_picture_is_that_of_a_new_one():
    ranges = {"u": (0.0, 8.0), "gamma": (-5.0, 60.0)}
    state = plot.Exploration(PIPE, 3, 2.0, ranges=ranges)
    before = state.picture.png()
    for name, value in [*MOVES.items(), ("gamma", 60.0), ("segments", 2), ("gamma", -4.0)]:
        state.set(name, value)
        state.picture.update()
        if value == 60.0:
            state.picture.png()
    fresh = plot.Exploration(moved_pipe(), 2, 3.5, ranges=ranges)
    assert before != state.picture.png() == fresh.picture.png()
    assert state.picture.overlay() == fresh.picture.overlay()


def test_the_region_shown_as_stable_is_that_in_which_no_eigenvalue_grows():
    """A standing pipe buckles by its weight: the flow straightens it before it flutters."""
    state = plot.Exploration(pp.Pipe(0.2, -10.0, damping=0.001), 6)
    found = state.stable_speeds
    assert np.isfinite(found).all()
    assert (found[:, 0] > 1.0).all()
    for beta, (low, high) in zip(state.curve.values, found, strict=True):
        model = pp.Chain(pp.Pipe(beta, -10.0, damping=0.001), 6)
        for u, stable in (0.99 * low, 0), (1.01 * low, 1), (0.99 * high, 1), (1.01 * high, 0):
            assert (pp.eigenvalues(model, u).real.max() < 0.0) == stable
    hanging = plot.Exploration(pp.Pipe(0.2, 10.0), 6)
    assert (hanging.stable_speeds[:, 0] == 0.0).all()
    assert np.array_equal(hanging.stable_speeds[:, 1], hanging.curve.speeds)


@pytest.mark.parametrize(
    ("pipe", "u", "sentence"),
    [
        (pp.Pipe(0.2, -50.0), None, "Unstable at every flow speed up to u = 6."),
        (pp.Pipe(0.0, -50.0), 0.0, "Unstable at every flow speed up to u = 6."),
        (pp.Pipe(0.95, -50.0), 7.0, "Up to u = 10 stable only from u = "),
        (pp.Pipe(0.2, -10.0), None, "Stable from u = 1.808 on; flutter begins at u = 4.75, mode 2"),
        (pp.Pipe(0.2, -5.0), None, "Flutter begins at u = "),
    ],
)
def test_the_report_and_the_map_say_at_which_speeds_the_pipe_is_stable(pipe, u, sentence):
    state = plot.Exploration(pipe, 10, u)
    assert state.report[1].startswith(sentence)
    onset = drawn(state)["onset"].get_ydata()
    values, ranges, end = state.curve.values, state.stable_speeds, state.sliders["u"][1]
    for i in range(0, values.size, 4):
        model = state.model.with_pipe(replace(pipe, beta=values[i]))
        stable = [(pp.eigenvalues(model, u).real < 1e-7).all() for u in np.linspace(0.1, end, 30)]
        for speed, good in zip(np.linspace(0.1, end, 30), stable, strict=True):
            assert good or not ranges[i, 0] <= speed <= ranges[i, 1]
            assert not (good and speed < ranges[i, 0])
        # Nothing is marked where the pipe is unstable below, too.
        marked = np.isfinite(onset[i])
        assert marked == (ranges[i, 1] == state.curve.speeds[i])
        assert marked or not np.isnan(ranges[i, 0]) or not any(stable)


def test_a_pipe_of_which_nobody_knows_where_it_is_stable_is_shown():
    """A follower force makes it grow at rest, without damping."""
    state = plot.Exploration(pp.Pipe(0.3, terms=[pp.FollowerForce(1.0, 26.0)]), 6)
    assert state.critical is None
    assert state.report[1].startswith("Where it is stable is not known: the pipe is unstable at")
    assert np.isnan(state.stable_speeds).all()


def test_a_pipe_that_never_loses_stability_is_stable_at_all_speeds_shown():
    state = plot.Exploration(pp.Pipe(0.2), 1)  # one segment does not flutter
    assert state.critical is None
    assert state.report[1] == "No loss of stability up to u = 100."
    assert (state.stable_speeds == [0.0, math.inf]).all()
    assert state.picture.png()
    (region,) = drawn(state)["stable"].get_paths()
    assert region.vertices[:, 0].max() - region.vertices[:, 0].min() == np.ptp(state.curve.values)


@pytest.mark.parametrize("u", [4.0, 7.0])
def test_the_film_is_small_motion_in_time(u):
    """Time stepping from its first frame, a millionth as large, gives the others."""
    state = plot.Exploration(pp.Pipe(0.2, 3.0, damping=0.004), 5, u)
    shapes, mode = state.film, state.least_stable
    assert state.unstable == (u > state.critical.speed)
    start = 1e-6 * mode.coordinates
    q, qdot = start.real, (mode.eigenvalue * start).real
    duration = 3.0 * 2.0 * np.pi / mode.eigenvalue.imag
    times = np.linspace(0.0, duration, len(shapes))
    steps = {"times": times, "rtol": 1e-9, "atol": 1e-15}
    motion = pp.simulate(state.model, u, duration, q, qdot, **steps)
    tip, shown = motion.tip[:, 0], shapes[:, -1, 0]
    scale = shown[np.argmax(np.abs(shown))] / tip[np.argmax(np.abs(shown))]
    assert np.abs(scale * tip - shown).max() < 1e-4
    pieces = np.diff(shapes, axis=1)
    lengths = np.hypot(pieces[..., 0], pieces[..., 1]).sum(axis=1)
    assert lengths == pytest.approx(1.0, abs=1e-12)
    assert np.abs(shapes[..., 0]).max() <= 0.25 + 1e-12


def test_at_rest_without_damping_the_lowest_mode_is_shown():
    """All real parts are zero but for rounding, which must not choose."""
    state = plot.Exploration(pp.Pipe(0.2), 10, 0.0)
    assert not state.unstable
    lowest = pp.eigenvalues(state.model, 0.0)[0]
    assert state.least_stable.eigenvalue == lowest
    first, last = state.film[[0, -1]]
    assert first == pytest.approx(last, abs=1e-9)


def test_divergence_grows_without_a_cycle():
    state = plot.Exploration(pp.Pipe(0.2, -10.0, damping=0.01), 6, 0.0)
    assert state.least_stable.eigenvalue.imag == 0.0
    tip = state.film[:, -1, 0]
    assert tip[-1] / tip[0] == pytest.approx(math.exp(3.0))
    assert "divergence grows" in state.report[0]


def test_the_moving_pipe_lies_on_the_axes():
    state = plot.Exploration(HOSE, 6, 3.0, units="si")
    svg = state.picture.overlay()
    values = re.findall(r'values="([^"]*)"', svg)
    assert len(values) == 2  # the pipe and the jet's arrow
    frames = [np.array(one.split(), dtype=float).reshape(-1, 2) for one in values[0].split(";")]
    assert len(frames) == len(state.film)
    height = state.picture.figure.bbox.height
    for frame, shape in zip(frames, state.film, strict=True):
        places = state.picture.axes[2].transData.transform(HOSE.scales.length * shape)
        assert frame / 10.0 == pytest.approx(
            np.column_stack([places[:, 0], height - places[:, 1]]), abs=0.051
        )
    state.set("u", 0.0)
    assert state.picture.overlay().count("values=") == 1


def test_speeds_and_frequencies_are_told_in_si_where_the_pipe_has_scales():
    now, then = plot.Exploration(HOSE, 6, 3.0).report
    assert f"u = 3 ({HOSE.speed_si(3.0):.3g} m/s)" in now
    assert " m/s)" in then
    assert " Hz)" in then
    tube = pp.Pipe.from_tube(
        **{"length": 0.5, "outer_diameter": 12e-3, "inner_diameter": 8e-3, "youngs_modulus": 3e6},
        **{"density": 1150.0, "fluid_density": 998.0},
    )
    rate = 6e4 * tube.flow_rate_si(3.0)
    assert f" m/s, {rate:.3g} l/min)" in plot.Exploration(tube, 6, 3.0).report[0]


@pytest.mark.parametrize("against", ["beta", "gamma"])
def test_the_picture_is_in_si_on_request(against):
    """Also where the mass ratio is turned, with which the unit of the flow speed changes."""
    state = plot.Exploration(HOSE, 6, 3.0, against=against, units="si")
    drawn(state)
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in state.picture.axes]
    assert labels[0] == (r"Re $\lambda$ (1/s)", r"Im $\lambda$ (rad/s)")
    assert labels[1][1] == "flow speed (m/s)"
    for beta in (HOSE.beta, 0.3):
        state.set("beta", beta)
        shown = drawn(state)
        pipe = replace(HOSE, beta=beta)
        values = np.array([mode.eigenvalue for mode in state.modes])
        np.testing.assert_allclose(shown["roots"].get_xdata(), values.real / HOSE.scales.time)
        assert shown["place"].get_ydata() == pytest.approx([pipe.speed_si(3.0)])
        made = [
            pp.critical_speed(pp.Chain(replace(pipe, **{against: value}), 6)).in_si().speed
            for value in state.curve.values
        ]
        np.testing.assert_allclose(shown["onset"].get_ydata(), made, rtol=1e-9)
        assert max(path.vertices[-1, 1] for path in shown["envelope"].get_paths()) <= 0.45
    assert labels[2][0] == "transverse $x$ (m)"
    assert state.picture.overlay().startswith("<svg")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: plot.Exploration(PIPE, 5, units="si"), "units must be 'nondimensional' where"),
        (lambda: plot.Exploration(PIPE, 5, -1.0), "u must lie in"),
        (lambda: plot.Exploration(PIPE, 5, springs="soft"), "springs must be one of"),
        (lambda: plot.Exploration(PIPE, 5, springs=[1.0] * 5), "springs must be of type str"),
        (lambda: plot.Exploration(PIPE, 5, against="u"), "against must be one of 'beta', 'gamma'"),
        (lambda: plot.Exploration(PIPE, 5, ranges=[1.0]), "ranges must be of type Mapping"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"drag": (0.0, 1.0)}), "got 'drag': drag has no"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"mass": (0.0, 1.0)}), "must be one of"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"beta": (0.1, 1.0)}), "ranges['beta'] must lie"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"beta": (0.4, 0.9)}), "must hold the value at"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"beta": (0.9, 0.2)}), "must be (low, high)"),
        (lambda: plot.Exploration(PIPE, 5, ranges={"beta": 0.2}), "ranges['beta'] must be one-dim"),
        (lambda: plot.Exploration(pp.Pipe(0.2, jet_angle=0.1), 5), "pipe must rest straight"),
        (
            lambda: plot.Exploration(PIPE, 5, ranges={"inclination": (-3.0, 3.0)}),
            "ranges['inclination'] must leave the pipe straight at rest",
        ),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises((ValueError, TypeError), match=re.escape(message)):
        call()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("mass", 1.0, "name must be one of 'u', 'beta'"),
        ("beta", 0.99, "beta must lie in [0.02, 0.95], got 0.99"),
        ("beta", math.nan, "beta must lie in"),
        ("beta", "high", "beta must be a real number"),
        ("segments", 2.5, "segments must be a whole number, got 2.5"),
        ("segments", 30, "segments must be from 1 to 20, got 30"),
    ],
)
def test_a_bad_move_is_refused_and_changes_nothing(name, value, message):
    state = plot.Exploration(pp.Pipe(0.2), 4)
    before = dict(state.values), state.model, state.curve
    with pytest.raises((ValueError, TypeError), match=re.escape(message)):
        state.set(name, value)
    assert (dict(state.values), state.model, state.curve) == before


def test_without_ipywidgets_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    with pytest.raises(ImportError, match=re.escape("pip install pipedyn[notebook]")):
        plot.explore(PIPE)


def test_sliders_move_the_state_and_what_is_shown():
    widgets = pytest.importorskip("ipywidgets")
    box = plot.explore(pp.Pipe(0.2, 2.0), 5, ranges={"beta": (0.1, 0.9)})
    controls, text, stack = box.children
    image, film = stack.children
    assert isinstance(image, widgets.Image)
    before = image.value, film.value, text.value
    by_name = {one.description: one for one in controls.children}
    assert list(by_name)[:5] == [
        *("flow speed u", "mass ratio β", "gravity γ", "damping δ"),
        "segments",
    ]
    by_name["gravity γ"].value = 20.0
    by_name["segments"].value = 7
    assert box.exploration.model.dof == 7
    assert box.exploration.model.pipe.gamma == 20.0
    assert image.value == box.exploration.picture.png()
    after = image.value, film.value, text.value
    assert all(old != new for old, new in zip(before, after, strict=True))


def test_a_move_without_an_answer_is_told_and_the_picture_stays():
    pytest.importorskip("ipywidgets")
    box = plot.explore(pp.Pipe(0.2), 5)
    controls, text, stack = box.children
    before = stack.children[0].value
    box.exploration.set = lambda name, value: (_ for _ in ()).throw(pp.NotConverged("lost", None))
    controls.children[1].value = 0.5
    assert "No answer for beta = 0.5: lost" in text.value
    assert stack.children[0].value == before
