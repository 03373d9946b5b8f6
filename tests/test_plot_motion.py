# SPDX-License-Identifier: MIT
"""Pictures of motion: they show the motion, the right way up, and refuse bad questions."""

import base64
import dataclasses
import io
import math
import re
from functools import cache, partial
from itertools import pairwise

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from canvas import axes as of_layout
from canvas import legend_of
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from PIL import Image
from scipy.interpolate import CubicSpline

import pipedyn as pp
from pipedyn import plot


def bend(s):
    return 0.05 * s**2


CHAIN = pp.Chain(pp.Pipe(0.2), 6)
PIPES = {
    "hanging": pp.Pipe(0.2, 10.0),
    "standing": pp.Pipe(0.2, -5.0),
    "level": pp.Pipe(0.2),
    "hanging, aspirating": pp.Pipe(0.2, 10.0, "aspirating", damping=0.02),
    "standing, aspirating": pp.Pipe(0.2, -5.0, "aspirating", damping=0.02),
}


MOTIONS = {
    "cycle": partial(pp.simulate, CHAIN, 6.0, 30.0, bend, samples=1201, rtol=1e-8),
    "fine": partial(pp.simulate, CHAIN, 6.0, 30.0, bend, samples=12001, rtol=1e-8),
    "decay": partial(pp.simulate, CHAIN, 2.0, 10.0, bend, samples=4001),
    "coarse": partial(pp.simulate, CHAIN, 6.0, 30.0, bend, samples=201),
    "rest": partial(pp.simulate, CHAIN, 1.0, 1.0, np.zeros(6), samples=11),
    "reduced": partial(pp.simulate, pp.Galerkin(pp.Pipe(0.2), 6), 6.5, 20.0, bend, samples=1601),
    "short": partial(pp.simulate, CHAIN, 1.0, 1.0, bend, samples=2),
    "sparse cycle": partial(pp.limit_cycle, pp.Chain(pp.Pipe(0.2), 3), 8.0, samples=9),
    "many": partial(pp.simulate_many, CHAIN, [5.5, 6.0], 5.0, bend, samples=401),
}


@cache
def run(name):
    """What the pictures show, each computed when it is first asked for."""
    return MOTIONS[name]()


axes = partial(of_layout, "constrained")


def small_axes():
    """For animations, of which every frame is rendered: without a layout computed for each."""
    none = PlaceHolderLayoutEngine(adjust_compatible=True, colorbar_gridspec=True)
    return Figure(figsize=(2.0, 2.3), dpi=50, layout=none).subplots()


SPACE = pp.Chain(pp.Pipe(0.2, 10.0), 6, dimensions=3)


@cache
def whirl(gamma=10.0):
    """A circular motion, whose free end turns from x towards z, with its samples over 3 T."""
    model = pp.Chain(pp.Pipe(0.2, gamma), 6, dimensions=3)
    found = pp.rotating_motion(model, 1.08 * pp.critical_speed(model).speed)
    q0 = model.turned(found.q, 0.3)
    motion = pp.simulate(model, found.u, 3.0, q0, found.frequency * model.quarter_turn(q0))
    return found, motion


COLUMNS = {"side": [0, 1], "front": [2, 1], "above": [0, 2], "space": [0, 2, 1]}


def axes_for(view, **options):
    figure = Figure(layout="constrained", **options)
    FigureCanvasAgg(figure)
    return figure.add_subplot(projection="3d" if view == "space" else None)


def images_of(page):
    """The frames of a player."""
    text = page.read_text(encoding="utf-8")
    coded = re.findall(r"data:image/png;base64,([^\"]+)", text)
    bare = (io.BytesIO(base64.b64decode(one.replace("\\\n", ""))) for one in coded)
    return [Image.open(one) for one in bare]


def by_gid(ax, gid):
    return [child for child in ax.get_children() if child.get_gid() == gid]


def shapes_of(motion, **asked):
    """Shapes, (k, points, 2), that a picture shows, and their times, (k,)."""
    (shapes,) = plot.snapshots(motion, ax=axes(), **asked).collections
    return np.array(shapes.get_segments()), np.asarray(shapes.get_array())


def last_cycle(motion):
    """Start and end of the cycle that is shown if no span is given, of 16 equal times."""
    _, t = shapes_of(motion)
    np.testing.assert_allclose(np.diff(t), np.ptp(t) / 15.0, rtol=1e-9)
    return t[0] - np.ptp(t) / 15.0, t[-1]


SEVERAL = "motions must be Attractors, a Motion, several of them or an En"
COARSE = "must be sampled at least six times a cycle"
NO_FILM = "path must end with .gif, .mp4 or .html and lie in a folder"


@pytest.mark.parametrize(
    ("draw", "motion", "asked", "message"),
    [
        (
            *(plot.snapshots, "short", {}),
            "motion must have at least 3 samples, got 2: compute it with more `samples=`",
        ),
        (plot.snapshots, "coarse", {}, f"motion {COARSE}"),
        (plot.snapshots, "cycle", {"span": (2.0, 1.0)}, "span must be a start and a later end"),
        (plot.snapshots, "cycle", {"span": (0.0, 31.0)}, "span must be a start and a later end"),
        (plot.time_history, [], {}, "motions must hold at least one, got none"),
        (plot.time_history, ["cycle", "short"], {}, "motions[1] must have at least 3 samples"),
        (
            *(plot.time_history, ["cycle", "decay"], {"start": 9.999}),
            "start must leave at least 3 samples of motions[1], whose third last is at 9.995 T",
        ),
        (plot.phase_portrait, "cycle", {"start": "late"}, "start must be a real number"),
        (plot.phase_portrait, "cycle", {"coordinate": 6}, "coordinate must be from 0 to 5, got 6"),
        (
            *(plot.phase_portrait, "cycle", {"coordinate": "path"}),
            "coordinate must not be 'path' for a model that moves in a plane",
        ),
        (
            plot.phase_portrait,
            "cycle",
            {"coordinate": "pth"},
            "coordinate must be one of 'tip', 'p",
        ),
        (
            *(plot.snapshots, "cycle", {"view": "above"}),
            "view must be 'side' for a model that moves in a plane",
        ),
        (plot.animate, "cycle", {"view": "front"}, "view must be 'side' for a model that moves in"),
        (
            plot.snapshots,
            "cycle",
            {"view": "below"},
            "view must be one of 'side', 'front', 'above'",
        ),
        (plot.animate, "coarse", {}, f"motion {COARSE}"),
        (plot.animate, "cycle", {"path": "pipe.avi"}, NO_FILM),
        (plot.animate, "cycle", {"path": "none/pipe.gif"}, NO_FILM),
        (plot.animate, "cycle", {"speed": 5.0}, "speed must leave at least 8 frames to a cy"),
        (
            *(plot.animate, "cycle", {"span": (0, 30), "speed": 5.0}),
            "speed must leave at least 8 frames to a cy",
        ),
        (plot.animate, "cycle", {"speed": 1e-9}, "span, fps and speed must ask for at most"),
        (plot.animate, "rest", {"speed": 10.0, "fps": 1}, "speed must leave at least 2 frames"),
    ],
)
def test_a_picture_of_motion_refuses_what_it_cannot_show_by_name(draw, motion, asked, message):
    def named(one):
        return run(one) if isinstance(one, str) else one

    shown = [named(one) for one in motion] if isinstance(motion, list) else named(motion)
    with pytest.raises((ValueError, TypeError)) as caught:
        draw(shown, **asked)
    assert str(caught.value).startswith(message)
    with pytest.raises(TypeError, match=re.escape(SEVERAL)):
        plot.time_history("abc")


def test_samples_once_a_cycle_are_no_pipe_at_rest():
    fine, (start, end) = run("fine"), last_cycle(run("fine"))
    on = (rows[np.argmin(np.abs(fine.t - start))] for rows in (fine.q, fine.qdot))
    motion = pp.simulate(CHAIN, 6.0, 10 * (end - start), *on, samples=11, rtol=1e-8)
    assert np.ptp(motion.tip[:, 0]) < 0.01
    for draw in plot.time_history, plot.phase_portrait:
        ax = draw(motion, ax=axes())
        assert dots_and_curves(ax)[0] == 1
        assert "fewer than ten samples a cycle" in ax.get_title()


@pytest.mark.parametrize("draw", [plot.time_history, plot.phase_portrait])
def test_a_motion_with_fewer_than_ten_samples_a_cycle_has_a_note(draw):
    few, dots = "\nfewer than ten samples a cycle", "\nsamples, too far apart for a curve"
    start, end = last_cycle(run("fine"))
    for samples, note in ((14, ""), (8, few), (4, few + dots)):
        seldom = every_one(run("fine"), round((end - start) / 0.0025 / samples))
        ax = draw(seldom, start=20.0, ax=axes())
        assert ax.get_title() == "$u = 6$, ejecting" + note
        assert dots_and_curves(ax)[0] == (samples == 4)
    two = [run("cycle"), every_one(run("fine"), 50)]
    ax = draw(two, ax=axes())
    assert ax.get_title().startswith("fewer than ten samples a cycle: 1 of 2 motions")


def test_a_slow_drift_does_not_hide_a_swing_of_few_samples():
    """The pipe falls to one side, and swings with six samples a cycle."""
    model = pp.Galerkin(pp.Pipe(0.2, -12.0, damping=0.0005), 6)
    fall = pp.simulate(model, 0.5, 60.0, lambda s: 0.01 * s + 0.02 * np.sin(12.6 * s), samples=301)
    assert "fewer than ten samples a cycle" in plot.time_history(fall, ax=axes()).get_title()
    slow = every_one(run("decay"), 5)
    assert "fewer" not in plot.time_history(slow, ax=axes()).get_title()


def test_rounding_is_not_drawn_as_a_motion():
    motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 3), 2.0, 60.0, bend, samples=3001)
    ax = plot.time_history(motion, start=40.0, ax=axes())
    assert ax.get_title() == "$u = 2$, ejecting\nthe free end is at rest"
    assert np.ptp(ax.get_ylim()) > 1e3 * np.ptp(ax.lines[-1].get_ydata())
    ax = plot.phase_portrait(motion, 1, start=40.0, ax=axes())
    assert ax.get_title() == "$u = 2$, ejecting\nthe coordinate is at rest"
    drawn = np.ptp([line.get_xydata()[0] for line in ax.lines], axis=0)
    assert min(np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())) > 1e3 * drawn.max()
    both = plot.time_history([run("rest"), run("decay")], ax=axes())
    assert both.get_title() == "the free end is at rest: 1 of 2 motions"
    assert both.get_ylim()[1] > 1e-3


def every_one(motion, step):
    """A motion as it would be with fewer samples."""
    names = ("t", "q", "qdot", "tip", "energy", "flow_speed")
    return dataclasses.replace(motion, **{name: getattr(motion, name)[::step] for name in names})


@pytest.mark.parametrize("draw", [plot.time_history, plot.phase_portrait])
def test_a_start_leaves_out_the_transient(draw):
    whole, late = run("cycle"), run("cycle").t >= 20.0
    lines = draw(run("cycle"), start=20.0, ax=axes()).lines
    drawn = np.concatenate([line.get_xydata() for line in lines if len(line.get_xdata()) > 2])
    of_time = draw is plot.time_history
    shown = whole.t if of_time else whole.tip[:, 0]
    assert drawn[:, 0].min() == pytest.approx(shown[late].min(), abs=1e-4)
    assert len(drawn) > 4 * late.sum()
    rings = [line for line in lines if line.get_marker() == "o"]
    assert not rings  # the transient's start is not shown
    cycle = pp.limit_cycle(CHAIN, 6.0)
    assert draw([whole, cycle], start=0.2, legend=False, ax=axes()).get_legend() is None


def test_a_chaotic_motion_has_no_last_cycle():
    stop = pp.Stop(0.8, gap=0.05, stiffness=1000.0)
    chain = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.002, terms=[stop]), 4)
    chaos, cycle = (pp.simulate(chain, u, 40.0, bend, samples=6001) for u in (6.43, 5.9))
    widths = [
        {line.get_linewidth() for line in plot.phase_portrait(one, start=20.0, ax=axes()).lines}
        for one in (chaos, cycle)
    ]
    assert max(widths[0]) < 1.0 < max(widths[1])
    for one, words in ((chaos, "a swing of"), (cycle, "a cycle of")):
        assert words in plot.snapshots(one, ax=axes()).get_title()
    repeats = [plot.animate(one, fps=4, ax=small_axes()) for one in (chaos, cycle)]
    assert [film.repeats for film in repeats] == [False, True]
    for film in repeats:
        film._init_draw()


def test_a_portrait_of_many_seldom_samples_has_no_corners():
    cycle = pp.limit_cycle(CHAIN, 6.0)
    q, qdot = cycle.q[0], cycle.qdot[0]
    long = pp.simulate(CHAIN, 6.0, 520 * cycle.period, q, qdot, samples=8 * 520 + 1)
    ax = plot.phase_portrait(long, ax=axes())
    points = ax.lines[1].get_xydata()[: 4 * 64] / [
        np.ptp(cycle.tip[:, 0]),
        np.ptp(cycle.tip_velocity[:, 0]),
    ]
    steps = np.diff(points, axis=0)
    turn = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turn).max() < 0.3


def test_the_tip_moves_as_its_velocity_says():
    step = 1e-6
    generator = np.random.default_rng(5)
    for model in CHAIN, pp.Chain(pp.Pipe(0.2), 5, springs="midpoint"), pp.Galerkin(pp.Pipe(0.2), 6):
        q, qdot = generator.normal(size=(2, model.dof, 4))
        moved = model.tips(q + step * qdot) - model.tips(q - step * qdot)
        np.testing.assert_allclose(model.tip_velocities(q, qdot), moved / (2 * step), atol=2e-8)
    q, qdot = run("cycle").q.T, run("cycle").qdot.T
    np.testing.assert_array_equal(run("cycle").tip_velocity, CHAIN.tip_velocities(q, qdot))


@pytest.mark.parametrize("model", [CHAIN, pp.Galerkin(pp.Pipe(0.2), 6)], ids=["chain", "reduced"])
@pytest.mark.parametrize(
    ("q", "qdot", "message"),
    [
        (np.zeros(6), np.zeros(6), r"q must have shape \(6, k\), got \(6,\)"),
        (np.zeros((6, 2)), np.zeros((6, 3)), r"qdot must have the shape of q, \(6, 2\), got"),
        (np.zeros((6, 2)), np.zeros((6, 2), complex), "qdot must be real"),
    ],
)
def test_the_velocity_of_the_tip_refuses_what_is_no_state(model, q, qdot, message):
    with pytest.raises((ValueError, TypeError), match=message):
        model.tip_velocities(q, qdot)


def test_between_samples_lies_the_motion_itself():
    cycle, fine = run("cycle"), run("fine")
    times, positions = plot.time_history(cycle, ax=axes()).lines[-1].get_xydata().T
    assert times.size > 2 * cycle.t.size
    path = CubicSpline(fine.t, fine.tip[:, 0])
    np.testing.assert_allclose(positions, path(times), atol=5e-4)
    shapes, times = shapes_of(cycle, span=(20.0, 20.25), count=101)
    np.testing.assert_array_equal(times, np.linspace(20.0, 20.25, 101))
    expected = [CHAIN.shape(q, np.linspace(0.0, 1.0, len(shapes[0]))) for q in fine.q[8000:8101]]
    np.testing.assert_allclose(shapes, expected, atol=3e-3)
    every = [CHAIN.shape(q, np.linspace(0.0, 1.0, len(shapes[0]))) for q in cycle.q[800:811]]
    np.testing.assert_allclose(shapes[::10], every, atol=1e-12)


def test_the_last_cycle_is_a_period_of_the_settled_motion():
    start, end = last_cycle(run("cycle"))
    x = run("fine").tip[:, 0]
    middles = run("fine").t[1:][(x[:-1] < 0.0) & (x[1:] >= 0.0)]
    assert end - start == pytest.approx(np.diff(middles[-10:]).mean(), rel=1e-3)
    assert 30.0 - end < end - start
    _, times = shapes_of(run("rest"))
    np.testing.assert_allclose(times, np.linspace(0.0, 1.0, 16))


def test_a_cycle_with_three_crossings_is_shown_whole():
    """In large motion of a standing pipe the free end crosses its middle more than once a cycle."""
    pipe = pp.Pipe(0.2, -10.0, "aspirating", drag=1.0, damping=0.02)
    motion = pp.simulate(pp.Chain(pipe, 12), 3.0, 20.0, bend, samples=2001)
    start, end = last_cycle(motion)
    (first, last), _ = shapes_of(motion, span=(start, end), count=2)
    np.testing.assert_allclose(first, last, atol=0.05)
    x = motion.tip[(motion.t > start) & (motion.t < end), 0]
    assert x.min() < -0.9
    assert x.max() > 0.9


@pytest.mark.parametrize("name", PIPES)
def test_gravity_points_down_the_page_and_the_arrow_along_the_flow(name):
    pipe = PIPES[name]
    motion = pp.simulate(pp.Chain(pipe, 6), 1.0, 1.0, bend, samples=201)
    ax = axes()
    assert plot.snapshots(motion, (0.0, 1.0), 5, ax=ax) is ax
    ax.figure.canvas.draw()
    assert ax.get_aspect() == 1.0
    to_page = ax.transData.transform
    clamp, tip = to_page((0.0, 0.0)), to_page(motion.tip[-1])
    assert (tip[1] > clamp[1]) == (pipe.gamma < 0.0)  # only a standing pipe is above its clamp
    gravity = by_gid(ax, "gravity")
    assert len(gravity) == (pipe.gamma != 0.0)
    for arrow in gravity:
        tail, head = (to_page(point) for point in arrow._posA_posB)
        assert head[1] < tail[1] - 5.0
        assert head[0] == tail[0]
    (flow,) = by_gid(ax, "flow")
    tail, head = (np.array(point) for point in flow._posA_posB)
    outward = motion.model.shape(motion.q[-1], [0.99, 1.0]) @ np.eye(2)
    outward = np.diff(outward, axis=0)[0] / 0.01
    sign = 1.0 if pipe.flow == "ejecting" else -1.0
    assert (head - tail) @ outward == pytest.approx(sign * np.linalg.norm(head - tail))
    nearer, farther = (tail, head) if sign > 0 else (head, tail)
    assert np.linalg.norm(nearer - motion.tip[-1]) < 0.03
    assert np.linalg.norm(farther - motion.tip[-1]) > 0.1


def test_a_held_end_is_shown_held_and_is_not_called_free():
    held = {"root": "pinned", "end": "pinned", "supports": (0.3,), "damping_time": 2e-3}
    masses = {"pipe_mass": 0.08, "fluid_mass": 0.05}
    pipe = pp.Pipe.from_si(length=0.45, bending_stiffness=7.3e-3, **masses, **held)
    motion = pp.simulate(pp.Galerkin(pipe, 4), 1.0, 5.0, lambda s: 0.05 * np.sin(np.pi * s))
    place = f"at $s/L={pipe.tip_place:.3g}$"
    assert plot.time_history(motion, ax=axes()).get_ylabel() == f"$x/L$ {place}"
    ax = plot.phase_portrait(motion, units="si", ax=axes())
    assert ax.get_xlabel() == f"$x$ {place} (m)"
    assert ax.get_ylabel() == f"velocity $\\dot{{x}}$ {place} (m/s)"
    ax = plot.poincare_section(motion, ax=axes())
    assert ax.get_title().endswith(f"at maxima of the point {place}")
    ax = plot.snapshots(motion, ax=axes())
    ends = [line.get_ydata() for line in by_gid(ax, "support")]
    (shapes,) = ax.collections
    tips = np.array(shapes.get_segments())[:, -1, 1]
    assert len(ends) == 4
    assert min(ends[2]) < tips.min() < tips.max() < max(ends[3])
    assert not by_gid(plot.snapshots(run("rest"), ax=axes()), "support")
    ax = plot.snapshots(motion, (0.1234, 1.234), units="si", ax=axes(figsize=(2.2, 4.0)))
    ax.figure.draw_without_rendering()
    lines = ax.title._get_wrapped_text().split("\n")
    assert len(lines) > 2
    assert all(line.count("$") % 2 == 0 and line != "s" for line in lines)


def test_spans_and_the_speed_of_a_film_are_in_the_units_of_the_picture():
    pipe = pp.Pipe.from_si(length=2.0, bending_stiffness=4.0, pipe_mass=0.75, fluid_mass=0.25)
    assert pipe.scales.time == 2.0
    motion = pp.simulate(pp.Chain(pipe, 6), 6.0, 30.0, bend, samples=1201, rtol=1e-8)
    shapes, t = shapes_of(motion, span=(20.0, 22.0), count=5)
    in_si, seconds = shapes_of(motion, span=(40.0, 44.0), count=5, units="si")
    np.testing.assert_array_equal(in_si, 2.0 * shapes)
    np.testing.assert_array_equal(seconds, 2.0 * t)
    whole = motion.in_si().t[[0, -1]]
    assert shapes_of(motion, span=whole, count=2, units="si")[1] == pytest.approx(whole)
    with pytest.raises(ValueError, match=r"times, \[0, 60\] s, got \(58\.0, 61\.0\)$"):
        plot.snapshots(motion, (58.0, 61.0), units="si")
    with pytest.raises(ValueError, match=r"times, \[0, 30\] T, got \(58\.0, 61\.0\)$"):
        plot.snapshots(motion, (58.0, 61.0))
    seconds = {"units": "si", "fps": 10, "ax": small_axes()}
    real_time = plot.animate(motion, span=(40.0, 42.0), speed=1.0, **seconds)
    assert real_time.frames == 20
    real_time._draw_frame(19)
    assert real_time.moving[-1].get_text() == "$t$ = 42.0 s"
    films = [real_time, plot.animate(motion, **seconds), plot.animate(motion, fps=10)]
    assert films[1].frames == films[2].frames
    for film in films:
        film._draw_was_started = True  # one that was never drawn warns
    for change, message in (
        ({"speed": 1e-9}, r"60 s at 1e-09 s a second"),
        ({"speed": 60.0, "fps": 1}, r"2 frames to 60 s|8 frames to a cycle of [.\d]* s"),
    ):
        with pytest.raises(ValueError, match=message):
            plot.animate(motion, span=(0.0, 60.0), **seconds | change)


def test_the_arrow_of_an_inclined_nozzle_is_its_jet():
    model = pp.Chain(pp.Pipe(0.2, jet_angle=1.2), 6)
    motion = pp.simulate(model, 1.0, 1.0, bend, samples=201)
    (flow,) = by_gid(plot.snapshots(motion, (0.0, 1.0), 5, ax=axes()), "flow")
    tail, head = (np.array(point) for point in flow._posA_posB)
    angle = motion.q[-1, -1] + 1.2
    jet = np.array([np.sin(angle), np.cos(angle)])
    assert (head - tail) @ jet == pytest.approx(np.linalg.norm(head - tail))


def test_snapshots_are_the_pipe_at_equal_steps_the_latest_darkest():
    ax = plot.snapshots(run("decay"), (2.0, 4.0), 5, ax=axes())
    (shapes,) = (c for c in ax.collections if isinstance(c, LineCollection))
    ax.figure.canvas.draw()
    np.testing.assert_allclose(shapes.get_array(), [2.0, 2.5, 3.0, 3.5, 4.0])
    grey = np.asarray(shapes.get_colors())[:, :3] @ [0.299, 0.587, 0.114]
    assert np.all(np.diff(grey) < -0.05)
    assert grey[0] < 0.9
    for t, line in zip(shapes.get_array(), shapes.get_segments(), strict=True):
        i = int(np.argmin(np.abs(run("decay").t - t)))
        s = np.linspace(0.0, 1.0, len(line))
        np.testing.assert_allclose(line, CHAIN.shape(run("decay").q[i], s), atol=1e-12)
    bar = plot.colour_bar(plot.TIME_LABEL, ax=ax)
    assert ax.child_axes == [bar]


@pytest.mark.parametrize("name", ["cycle", "rest", "reduced"])
@pytest.mark.parametrize("draw", [plot.snapshots, plot.time_history, plot.phase_portrait])
def test_nothing_of_a_picture_of_motion_is_cut_off(draw, name):
    with plot.style():
        ax = draw(run(name), ax=axes())
        ax.figure.canvas.draw()
    whole, inside = ax.figure.bbox, ax.get_window_extent()
    for text in ax.title, ax.xaxis.label, ax.yaxis.label:
        box = text.get_window_extent()
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1
        assert whole.y0 <= box.y0 < box.y1 <= whole.y1
    assert re.search(r"/L\$|\\tau=", ax.xaxis.label.get_text())  # the unit is told
    for patch in ax.patches:
        box = patch.get_window_extent()
        assert inside.x0 <= box.x0 <= box.x1 <= inside.x1
        assert inside.y0 <= box.y0 <= box.y1 <= inside.y1


def test_labels_of_ticks_do_not_meet_in_a_figure_of_four():
    four = Figure(figsize=(7.0, 5.0), layout="constrained").subplots(2, 2)
    swing = pp.simulate(CHAIN, 6.0, 0.3, lambda s: 0.01 * s, samples=301)
    pictures = [
        partial(plot.snapshots, swing),
        partial(plot.snapshots, run("rest")),
        partial(plot.phase_portrait, swing, 0),
        partial(plot.phase_portrait, run("decay"), 2, start=0.3),
    ]
    for draw, ax in zip(pictures, four.flat, strict=True):
        draw(ax=ax)
    ax.figure.draw_without_rendering()
    for ax in four.flat:
        low, high = ax.get_xlim()
        shown = [one for one in ax.xaxis.get_major_ticks() if low <= one.get_loc() <= high]
        boxes = [one.label1.get_window_extent() for one in shown]
        assert len(boxes) > 1
        assert all(one.x1 < two.x0 for one, two in pairwise(boxes))


def test_histories_and_portraits_show_every_motion_under_its_speed():
    ax = plot.time_history(run("many"), ax=axes())
    assert legend_of(ax) == ["$u = 5.5$", "$u = 6$"]
    curves = [line for line in ax.lines if line.get_label().startswith("$u")]
    for curve, motion in zip(curves, run("many").motions, strict=True):
        shown = np.interp(motion.t, *curve.get_data())
        np.testing.assert_allclose(shown, motion.tip[:, 0], atol=1e-12)
    assert curves[0].get_linestyle() != curves[1].get_linestyle()
    ax = plot.time_history([run("cycle"), run("fine")], ax=axes())
    assert legend_of(ax) == ["0: $u = 6$, Chain, 6 d.o.f.", "1: $u = 6$, Chain, 6 d.o.f."]


def test_a_dozen_motions_differ_in_grey_and_more_are_counted():
    many = [run("rest")] * 12
    ax = plot.time_history(many, ax=axes())
    looks = [(str(line._dash_pattern), line.get_linewidth()) for line in ax.lines[1:]]
    assert len(set(looks)) == len(legend_of(ax)) == 12
    ax = plot.time_history([*many, run("decay")], ax=axes())
    assert ax.get_title().startswith("13 motions")


def test_members_that_failed_are_left_out_of_a_picture_and_told():
    found = pp.simulate_many(
        pp.Chain(pp.Pipe(0.2, 10.0), 4), [5.0, 6.0, 9999.0], 5.0, lambda s: 0.1 * s, most=20_000
    )
    assert [one.index for one in found.failures] == [2]
    for draw in plot.time_history, plot.phase_portrait:
        ax = draw(found, ax=axes())
        assert legend_of(ax) == ["$u = 5$", "$u = 6$"]
        assert ax.get_title() == "1 member left out after failure: 2"


def test_the_only_member_that_did_not_fail_is_shown_as_one_motion():
    chain, start = pp.Chain(pp.Pipe(0.2, 10.0), 4), [0.1, 0.1, 0.1, 0.1]
    found = pp.simulate_many(chain, [6.0, 9999.0], 5.0, start, most=20_000)
    title = plot.time_history(found, ax=axes()).get_title()
    assert title == "$u = 6$, ejecting\n1 member left out after failure: 1"
    none = pp.simulate_many(chain, [9999.0], 5.0, start, most=20_000)
    told = r"motions must have a member that did not fail, the first: .* as `most=`"
    with pytest.raises(ValueError, match=told):
        plot.time_history(none, ax=axes())


def test_a_portrait_of_a_coordinate_shows_it_against_its_rate():
    ax = plot.phase_portrait(run("decay"), 2, ax=axes())
    shown = np.concatenate([np.column_stack(line.get_data()) for line in ax.lines[:3]])
    states = np.column_stack([run("decay").q[:, 2], run("decay").qdot[:, 2]])
    begin = np.abs(shown[:, None] - states[None, ::400]).max(axis=-1).min(axis=0)
    assert begin.max() < 1e-3
    assert "q_{2}" in ax.get_xlabel()


def test_an_animation_has_its_frames_at_equal_times_and_can_be_read(tmp_path):
    path = tmp_path / "pipe.gif"
    ax = small_axes()
    animation = plot.animate(run("cycle"), path, fps=10, span=(20.0, 20.25), speed=0.5, ax=ax)
    assert isinstance(animation, FuncAnimation)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.n_frames == 5
        assert image.info["duration"] == 100
    (pipe,) = by_gid(ax, "pipe")
    animation._draw_frame(4)
    s = np.linspace(0.0, 1.0, pipe.get_xdata().size)
    shape = CHAIN.shape(run("cycle").q[810], s)
    np.testing.assert_allclose(np.column_stack(pipe.get_data()), shape, atol=1e-12)
    (trace,) = by_gid(ax, "trace")
    np.testing.assert_allclose(np.column_stack(trace.get_data())[-1], shape[-1], atol=1e-12)


def test_an_animation_of_a_cycle_closes_and_has_all_frames(tmp_path):
    path = tmp_path / "pipe.html"
    with matplotlib.rc_context({"animation.embed_limit": 1e-6}):
        animation = plot.animate(run("cycle"), path, fps=4, ax=small_axes())
    assert repr(animation) == "Film(10 frames, 4 a second, 2.5 s)"
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert page.count("data:image/png;base64") == 10  # 2.5 seconds
    assert "checked" in page[page.index('value="loop"') :][:200]
    (ax,) = animation._fig.axes
    animation._draw_frame(0)
    (trace,) = by_gid(ax, "trace")
    x, y = trace.get_data()
    assert math.hypot(x[0] - x[-1], y[0] - y[-1]) < 1e-3
    assert np.ptp(x) > 0.1  # the whole path, from the first frame on
    assert ax.yaxis_inverted()


def test_a_film_shows_what_a_figure_of_its_own_would(tmp_path):
    """What does not move is drawn once, below what moves; the figure is as before afterwards."""
    none = PlaceHolderLayoutEngine(adjust_compatible=True, colorbar_gridspec=True)
    ax, beside = (figure := Figure(figsize=(3.0, 2.03), layout=none)).subplots(1, 2)
    figure.suptitle("what does not move")
    beside.plot([0.0, 1.0], [1.0, 0.0], label="beside")
    film = plot.animate(run("cycle"), fps=4, ax=ax)
    film.save(tmp_path / "pipe.html")
    shown = np.asarray(images_of(tmp_path / "pipe.html")[3].convert("RGB")).astype(float)
    assert figure.get_size_inches().tolist() == [3.0, 2.03]
    assert not figure.images
    film._draw_frame(3)
    whole = io.BytesIO()
    figure.set_size_inches(3.0, 2.02)  # matplotlib makes frames of players of even sizes
    figure.savefig(whole, format="png", dpi="figure")
    with Image.open(whole) as image:
        drawn = np.asarray(image.convert("RGB")).astype(float)
    assert shown.shape == drawn.shape
    assert (np.abs(shown - drawn).max(axis=-1) > 60.0).mean() < 2e-3
    assert (drawn.min(axis=-1) < 128.0).mean() > 0.02


def test_a_film_has_the_dots_asked_for_and_says_how_far_it_is(tmp_path, terminal):
    for path in (tmp_path / "pipe.gif", tmp_path / "pipe.html"):
        plot.animate(run("cycle"), path, fps=4, dpi=40.0, ax=small_axes(), progress=True)
        told = terminal.readouterr().err.split("\r")
        assert told[-1].startswith("film: 100 %, 10/10, took ")
    with Image.open(tmp_path / "pipe.gif") as image:
        assert image.size == (80, 92)
    assert [image.size for image in images_of(path)] == [(80, 92)] * 10
    with pytest.raises(ValueError, match=r"dpi must lie in \[10, 1000\], got 1"):
        plot.animate(run("cycle"), fps=4, dpi=1.0, ax=small_axes())


def test_the_reduced_model_is_animated_like_the_chain():
    film = plot.animate(run("reduced"), fps=4, ax=small_axes())
    film._init_draw()
    (pipe,) = by_gid(film._fig.axes[0], "pipe")
    steps = np.diff(np.column_stack(pipe.get_data()), axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T).sum(), 1.0, rtol=1e-4)  # inextensible


def test_a_motion_that_stopped_is_shown_as_far_as_it_went():
    whole = run("cycle")
    names = ("t", "q", "qdot", "tip", "energy")
    part = dataclasses.replace(whole, **{name: getattr(whole, name)[:301] for name in names})
    ax = plot.time_history(part, ax=axes())
    assert ax.get_xlim() == pytest.approx((0.0, 7.5))


def test_a_motion_in_a_varying_flow_is_told_by_its_function():
    motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 2), lambda t: 2.0 + 0.1 * t, 1.0, [0.1, 0.1])
    for draw in (plot.time_history, plot.phase_portrait, plot.snapshots):
        assert draw(motion).get_title().startswith("$u(t)$, ejecting")


@pytest.mark.parametrize(
    ("model", "u", "duration", "start"),
    [
        (pp.Chain(pp.Pipe(0.2), 3), 9.0, 30.0, lambda s: 0.1 * s),
        (pp.Chain(pp.Pipe(0.2), 20), 0.0, 2.0, np.full(20, 0.1)),
        (pp.Chain(pp.Pipe(0.2, flow="aspirating", damping=0.001), 20), 3.0, 5.0, np.full(20, 0.1)),
        (pp.Chain(pp.Pipe(0.5, -20.0, drag=0.5), 100), 6.0, 0.01, np.full(100, 0.1)),
        (pp.Galerkin(pp.Pipe(0.2), 8), 3.0, 0.5, lambda s: 0.1 + 0.0 * s),
    ],
    ids=["chaos", "undamped", "aspirating", "long chain", "reduced"],
)
def test_a_default_motion_is_drawn_by_every_picture(model, u, duration, start):
    motion = pp.simulate(model, u, duration, start)
    for draw in plot.time_history, plot.phase_portrait, plot.snapshots:
        assert draw(motion, ax=axes())
    plot.animate(motion, fps=5.0, ax=small_axes())._init_draw()
    least = max(501, math.ceil(40.0 * duration) + 1)
    parts, rest = divmod(motion.t.size - 1, least - 1)
    assert (parts, rest) == (1 << (parts.bit_length() - 1), 0)
    asked = pp.simulate(model, u, duration, start, samples=least)
    np.testing.assert_array_equal(asked.q, motion.q[::parts])
    assert asked.evaluations == motion.evaluations
    if parts > 1:
        title = plot.phase_portrait(asked, ax=axes()).get_title()
        assert title.endswith("samples, too far apart for a curve")


def test_a_slow_motion_has_no_more_samples_than_it_needs():
    assert pp.simulate(CHAIN, 6.0, 30.0, bend).t.size == 1201


def test_a_limit_cycle_and_what_a_basin_ends_on_are_shown_as_motions():
    cycle = pp.limit_cycle(CHAIN, 6.0)
    ax = small_axes()
    plot.animate(cycle, fps=4, ax=ax)._init_draw()
    (trace,) = by_gid(ax, "trace")
    ends = np.column_stack(trace.get_data())[[0, -1]]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)  # one period, which closes
    assert "a cycle of" in plot.snapshots(cycle, ax=axes()).get_title()
    found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 2)
    drawn = plot.time_history(found.basins[0], ax=axes()).lines
    (line,) = [line for line in drawn if line.get_label().startswith("$u")]
    assert np.ptp(line.get_ydata()) == pytest.approx(2.0 * found.basins[0].amplitude, rel=1e-3)


def test_a_film_is_an_mp4_where_ffmpeg_is(tmp_path, monkeypatch):
    """In place of ffmpeg a program that writes the frames as they come."""
    program = tmp_path / "ffmpeg"
    program.write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n')
    program.chmod(0o755)
    path = tmp_path / "pipe.mp4"
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(program))
    film = plot.animate(run("cycle"), path, fps=4, ax=small_axes())
    assert path.stat().st_size == 10 * 100 * 114 * 4  # RGBA; heights of H.264 are even
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(tmp_path / "none"))
    for save in (film.save, lambda path: plot.animate(run("cycle"), path, ax=small_axes())):
        with pytest.raises(ValueError, match=r"path must end with \.gif or \.html, since ffmpeg"):
            save(path)


def test_films_are_of_each_attractor_that_moves(tmp_path):
    model = pp.Chain(pp.Pipe(0.2), 2)
    diagram = pp.bifurcation_diagram(model, [3.0, 4.0], brute_force=1)
    chaotic = dataclasses.replace(diagram.motions[-1], ending="irregular", start=7)
    diagram = dataclasses.replace(diagram, motions=(*diagram.motions, chaotic))
    made = plot.films(diagram, 4.0, fps=4.0)
    assert list(made) == ["cycle 0", "motion from start 7"]
    assert not plot.films(diagram, 3.0)  # at rest
    made["cycle 0"].save(tmp_path / "cycle.gif")
    with Image.open(tmp_path / "cycle.gif") as image:
        assert image.n_frames == 10
    made["motion from start 7"]._init_draw()
    found = pp.attractors(model, 4.0, 2)
    ((name, film),) = plot.films(found, fps=4.0).items()
    assert name.startswith("0: cycle, period")
    film._init_draw()
    with pytest.raises(ValueError, match="speed must be one of the diagram's speeds"):
        plot.films(diagram, 3.5)
    with pytest.raises(ValueError, match="view must be 'side' for a model that moves in a plane"):
        plot.films(diagram, 4.0, view="above")
    with pytest.raises(TypeError, match="found must be of type BifurcationDiagram, got 3"):
        plot.films(3)


def dots_and_curves(ax):
    dotted = [line for line in ax.lines if line.get_marker() == "."]
    return len(dotted), sum(len(line.get_xdata()) > 100 for line in ax.lines if line not in dotted)


@pytest.mark.parametrize(
    ("model", "rate", "start"),
    [
        (CHAIN, 0.0, bend),
        (pp.Galerkin(pp.Pipe(0.2), 5), 0.0, bend),
        (pp.Chain(pp.Pipe(0.2, drag=1.0), 2), 1e4, [0.0, 0.0]),
        (pp.Chain(pp.Pipe(0.2, damping=1e-3), 3), [1e3, -400.0, 700.0], [0.0, 0.0, 0.0]),
        (pp.Chain(pp.Pipe(0.2), 8), 300.0, np.zeros(8)),
    ],
)
def test_pictures_of_a_default_motion_never_refuse(model, rate, start):
    """Neither where it starts so fast that it whirls, nor of coordinates that no tip shows."""
    motion = pp.simulate(model, 3.0, 1.0, start, np.zeros(model.dof) + rate)
    for ax in (plot.time_history(motion, ax=axes()), plot.phase_portrait(motion, ax=axes())):
        dots, curves = dots_and_curves(ax)
        assert dots == 0
        assert curves > 0
    plot.snapshots(motion, ax=axes())
    film = plot.animate(motion, fps=5.0, ax=small_axes())
    film._init_draw()  # a film that was never drawn warns
    film._draw_was_started = True
    for index in range(model.dof):
        dots, curves = dots_and_curves(plot.phase_portrait(motion, index, ax=axes()))
        assert (dots == 1) != (curves > 0)


def test_a_coordinate_that_moves_too_fast_for_a_curve_is_shown_by_its_samples():
    motion = pp.simulate(pp.Galerkin(pp.Pipe(0.2), 5), 4.0, 20.0, bend)
    ax = plot.phase_portrait(motion, 4, ax=axes())
    assert ax.get_title().endswith("samples, too far apart for a curve")
    (line,) = ax.lines
    # The last sample is the end of a cubic, which may miss it by rounding.
    np.testing.assert_allclose(line.get_xdata(), motion.q[:, 4], rtol=1e-15)
    np.testing.assert_allclose(line.get_ydata(), motion.qdot[:, 4], rtol=1e-14)


@pytest.mark.parametrize("gamma", [10.0, -5.0], ids=["hanging", "standing"])
@pytest.mark.parametrize("view", COLUMNS)
def test_each_view_shows_the_pipe_projected_on_its_axes(view, gamma):
    _, motion = whirl(gamma)
    ax = plot.snapshots(motion, (1.0, 2.0), 5, view=view, ax=axes_for(view))
    ax.figure.canvas.draw()
    lines = ax.collections[0]
    shown = lines._segments3d if view == "space" else lines.get_segments()
    s = np.linspace(0.0, 1.0, len(shown[0]))
    for t, line in zip(np.linspace(1.0, 2.0, 5), shown, strict=True):
        q = motion.q[np.flatnonzero(np.abs(motion.t - t) < 1e-9)]
        assert len(q) <= 1
        if len(q):
            shape = motion.model.shape(q[0], s)
            np.testing.assert_allclose(line, shape[:, COLUMNS[view]], atol=1e-12)
    last = motion.model.shape(motion.q[np.argmin(np.abs(motion.t - 2.0))], [0.999, 1.0])
    along = (np.diff(last, axis=0)[0] / 0.001)[COLUMNS[view]]
    (flow,) = by_gid(ax, "flow")
    tail, head = flow._ends
    np.testing.assert_allclose(head - tail, 0.12 * along, atol=2e-3)
    # Gravity is along y: into the page from above, where it is not drawn.
    assert len(by_gid(ax, "gravity")) == (view != "above")
    names = [getattr(ax, f"get_{name}label")() for name in "xyz"[: len(COLUMNS[view])]]
    for column, name in zip(COLUMNS[view], names, strict=True):
        assert f"${'xyz'[column]}/L$" in name


@pytest.mark.parametrize("gamma", [10.0, -5.0], ids=["hanging", "standing"])
def test_a_turn_from_x_towards_z_has_its_sense_in_every_view_from_above(gamma):
    """Of x, y and z, right-handed, y points down a hanging pipe and up a standing one."""
    found, motion = whirl(gamma)
    assert found.frequency > 0.0
    above = plot.snapshots(motion, view="above", ax=axes_for("above"))
    path = plot.phase_portrait(motion, "path", ax=axes())
    space = plot.snapshots(motion, view="space", ax=axes_for("space"))
    for ax in (above, path, space):
        assert ax.yaxis_inverted() == (gamma < 0.0)
        assert not ax.xaxis_inverted()
    assert space.zaxis_inverted() == (gamma > 0.0)
    assert above.get_aspect() == path.get_aspect() == 1.0
    np.testing.assert_allclose(np.abs(path.axis()), 1.08 * found.radius, rtol=1e-3)
    ends = [np.ptp(one) for one in (space.get_xlim(), space.get_ylim(), space.get_zlim())]
    np.testing.assert_allclose(space._box_aspect / space._box_aspect[0], ends / ends[0])


def test_the_path_of_a_whirling_free_end_is_a_circle_and_of_a_planar_one_a_line():
    found, motion = whirl()
    ax = plot.phase_portrait(motion, "path", ax=axes())
    for line in ax.lines[:3]:
        np.testing.assert_allclose(np.hypot(*line.get_data()), found.radius, rtol=2e-4)
    assert "free end $x/L$" in ax.get_xlabel()
    assert "free end $z/L$" in ax.get_ylabel()
    q0 = SPACE.turned(SPACE.bent(lambda s: 0.3 * s), 0.5)
    planar = pp.simulate(SPACE, 4.0, 2.0, q0)
    ax = plot.phase_portrait(planar, "path", start=0.5, ax=axes())
    for line in ax.lines:
        x, z = line.get_data()
        np.testing.assert_allclose(z, np.tan(0.5) * x, atol=1e-9)


def test_a_motion_across_x_is_not_called_at_rest():
    q0 = SPACE.turned(SPACE.bent(lambda s: 0.3 * s), np.pi / 2.0)
    across = pp.simulate(SPACE, 4.0, 2.0, q0)
    ax = plot.time_history(across, ax=axes())
    assert ax.get_title().endswith("the free end is at rest along $x$")
    ax = plot.phase_portrait(across, "path", ax=axes())
    assert "at rest" not in ax.get_title()
    assert "samples" not in ax.get_title()
    ax.figure.canvas.draw()
    assert np.ptp(ax.get_ylim()) > 0.1


def test_a_section_in_space_has_x_and_the_rate_of_the_last_a_x():
    found, motion = whirl()
    ax = plot.poincare_section(motion, ax=axes())
    assert ax.get_title().endswith("at maxima of the free end along $x$")
    assert ax.get_ylabel().endswith(r"$\dot{q}_{5}$")
    x, rates = ax.lines[0].get_data()
    np.testing.assert_allclose(x, found.radius, rtol=1e-3)
    tip = found.model.tips(found.q[:, None])[0]
    at = found.model.turned(found.q, -np.arctan2(tip[2], tip[0]))
    expected = found.frequency * found.model.quarter_turn(at)[5]
    np.testing.assert_allclose(rates, expected, rtol=5e-3)


@pytest.mark.parametrize("view", ["above", "space"])
def test_a_film_in_space_shows_what_a_figure_of_its_own_would(view, tmp_path):
    _, motion = whirl()
    none = PlaceHolderLayoutEngine(adjust_compatible=True, colorbar_gridspec=True)
    figure = Figure(figsize=(3.0, 3.03), layout=none)
    ax = figure.add_subplot(projection="3d" if view == "space" else None)
    film = plot.animate(motion, span=(1.0, 1.5), fps=10.0, speed=0.5, view=view, ax=ax)
    film._draw_frame(4)
    pipe, trace = (by_gid(ax, gid)[0] for gid in ("pipe", "trace"))
    data = [one.get_data_3d() if view == "space" else one.get_data() for one in (pipe, trace)]
    t = np.linspace(1.0, 1.5, film.frames)[4]
    q = CubicSpline(motion.t, motion.q)(t)
    shape = motion.model.shape(q, np.linspace(0.0, 1.0, len(data[0][0])))[:, COLUMNS[view]]
    np.testing.assert_allclose(np.transpose(data[0]), shape, atol=1e-4)
    np.testing.assert_allclose(np.transpose(data[1])[-1], shape[-1], atol=1e-4)
    film.save(tmp_path / "pipe.html")
    shown = np.asarray(images_of(tmp_path / "pipe.html")[4].convert("RGB")).astype(float)
    film._draw_frame(4)
    whole = io.BytesIO()
    figure.set_size_inches(3.0, 3.02)
    figure.savefig(whole, format="png", dpi="figure")
    with Image.open(whole) as image:
        drawn = np.asarray(image.convert("RGB")).astype(float)
    assert shown.shape == drawn.shape
    assert (np.abs(shown - drawn).max(axis=-1) > 60.0).mean() < 2e-3
    assert np.median(np.abs(shown - drawn)) == 0.0


def test_nothing_of_a_picture_in_space_is_cut_off():
    with plot.style(column="single"):
        ax = plot.snapshots(whirl()[1], view="space")
        ax.figure.canvas.draw()
    whole = ax.figure.bbox
    labels = [axis.label for axis in (ax.xaxis, ax.yaxis, ax.zaxis)]
    boxes = [text.get_window_extent() for text in (ax.title, *labels)]
    for box in boxes:
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1
        assert whole.y0 <= box.y0 < box.y1 <= whole.y1
    assert not any(one.overlaps(two) for one, two in pairwise(boxes))
    plt.close(ax.figure)


def test_axes_in_space_are_for_the_view_in_space_alone():
    _, motion = whirl()
    with pytest.raises(ValueError, match="ax must have projection='3d' for this picture, got <Axe"):
        plot.snapshots(motion, view="space", ax=axes())
    for draw in (plot.snapshots, plot.animate, plot.time_history):
        with pytest.raises(ValueError, match="ax must not have projection='3d' for this picture"):
            draw(motion, ax=axes_for("space"))
