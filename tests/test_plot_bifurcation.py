# SPDX-License-Identifier: MIT
"""Pictures beyond onset show what is stable, what is not, and where it changes."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from canvas import axes as of_layout
from canvas import legend_of

import pipedyn as pp
from pipedyn import plot

TWO = pp.Chain(pp.Pipe(0.2, -20.0), 2)
SPEEDS = np.linspace(2.0, 3.0, 5)
BRANCH = pp.CycleBranch(
    speeds=SPEEDS,
    amplitudes=0.1 * SPEEDS,
    highest=0.1 * SPEEDS,
    frequencies=5.0 + SPEEDS,
    stable=SPEEDS < 2.6,
    multipliers=np.array([[-0.4 * u, 1.0, 0.2 + 0.1j, 0.2 - 0.1j] for u in SPEEDS]),
    events=(pp.CycleEvent("period doubling", 2.5, 0.0, -1.0 + 0j, 0.25),),
    cycles=(),
)


TURN = np.linspace(0.0, 2.0 * np.pi, 101)


def circle(stable=True):
    """A cycle on which both angles are 0.1 sin(10 t)."""
    return pp.LimitCycle(
        amplitude=0.1,
        frequency=10.0,
        period=0.2 * np.pi,
        multipliers=np.array([1.0, 0.5j, -0.5j, -1.4]),
        stable=stable,
        t=0.1 * TURN,
        q=0.1 * np.stack([np.sin(TURN)] * 2, axis=1),
        qdot=np.stack([np.cos(TURN)] * 2, axis=1),
        u=5.0,
        model=TWO,
        error=0.0,
        multiplier_error=0.0,
        residual=0.0,
        symmetric=True,
        phases=0,
        evaluations=0,
        method="written down",
        orbit=None,  # what was solved: no picture shows it
    )


@cache
def diagram():
    return pp.bifurcation_diagram(
        TWO, [0.5, 3.5], cycles=0, brute_force=2, transient=20.0, duration=5.0
    )


axes = partial(of_layout, "constrained")


def rendered(ax):
    ax.figure.canvas.draw()
    return ax


def test_stable_branches_are_solid_and_unstable_ones_dashed():
    ax = rendered(plot.bifurcation_diagram(diagram(), ax=axes()))
    fold = diagram().equilibria[1].folds[0].speed
    lines = [line for line in ax.lines if line.get_color() == plot.BLACK]
    solid = [line for line in lines if line.get_linestyle() == "-"]
    dashed = [line for line in lines if line.get_linestyle() == "--"]
    assert len(solid) + len(dashed) == len(lines)
    assert max(line.get_linewidth() for line in lines) < 1.0  # thinner than cycles, also in grey
    # Two mirror images are stable up to their fold; the straight pipe never is.
    assert len(solid) == 2
    for line in solid:
        assert line.get_xdata().max() == pytest.approx(fold, abs=1e-9)
        assert np.abs(line.get_ydata()).min() > 0.5
    labels = legend_of(ax)
    assert {"equilibrium, stable", "equilibrium, unstable", "fold", "pitchfork", "Hopf"} <= set(
        labels
    )
    marks = {tuple(line.get_xydata()[0]) for line in ax.lines if line.get_marker() == "<"}
    assert marks == {(b.folds[0].speed, b.folds[0].tip[0]) for b in diagram().equilibria[1:]}


def test_curves_begin_and_change_at_the_bifurcations():
    pipe = pp.Pipe(0.2, damping=0.01, root="pinned", end="pinned")
    found = pp.bifurcation_diagram(pp.Galerkin(pipe, 6, "legendre"), [2.5, 3.5], cycles=0)
    near = [b for b in found.equilibria if np.abs(b.q).max() < 2.5]  # not turned, and no loop
    ax = rendered(plot.bifurcation_diagram(replace(found, equilibria=tuple(near)), 1, ax=axes()))
    fork = round(near[0].points[0].speed, 9)  # either branch knows it to 1e-12
    lines = [line for line in ax.lines if line.get_color() == plot.BLACK]
    ends = {(line.get_linestyle(), *line.get_xdata()[[0, -1]].round(9).tolist()) for line in lines}
    assert ends == {("-", 2.5, fork), ("--", fork, 3.5), ("-", fork, 3.5)}
    bent = [line.get_ydata() for line in lines if round(line.get_xdata()[0], 9) == fork]
    assert [y[0] for y in bent] == [0.0, 0.0, 0.0]
    assert sorted(np.sign(y[-1]) for y in bent) == [-1.0, 0.0, 1.0]

    (branch,) = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.2), 2), [3.0, 4.0]).cycles
    ax = rendered(plot.bifurcation_diagram(replace(diagram(), cycles=(branch,)), ax=axes()))
    blue = [line.get_xydata() for line in ax.lines if line.get_color() == plot.BLUE]
    assert [points[0].tolist() for points in blue] == 2 * [[branch.onset, 0.0]]


def test_a_coordinate_may_be_shown_in_place_of_the_free_end():
    ax = rendered(plot.bifurcation_diagram(diagram(), 1, ax=axes()))
    shown = np.concatenate([line.get_ydata() for line in ax.lines if line.get_marker() == "None"])
    assert shown.max() == pytest.approx(diagram().equilibria[1].q[:, 1].max())
    assert not [line for line in ax.lines if line.get_gid() == "motions"]
    assert "cycles and motions are not shown" in legend_of(ax)


def test_late_motions_are_dots():
    ax = plot.bifurcation_diagram(diagram(), ax=axes())
    (dots,) = [line for line in ax.lines if line.get_gid() == "motions"]
    assert ax.get_xlim()[0] < dots.get_xdata().min() < dots.get_xdata().max() < ax.get_xlim()[1]
    assert len(dots.get_xdata()) == sum(one.turnings.size for one in diagram().motions)
    assert set(dots.get_xdata()) <= {0.5, 3.5}


def test_cycles_are_drawn_on_both_sides_with_their_events():
    ax = rendered(plot.bifurcation_diagram(replace(diagram(), cycles=(BRANCH,)), ax=axes()))
    lines = [line for line in ax.lines if line.get_color() == plot.BLUE]
    assert sorted(line.get_linestyle() for line in lines) == ["-", "-", "--", "--"]
    doubling = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "^"]
    np.testing.assert_allclose(sorted(y for _, y in doubling), [-0.25, 0.25])


def test_asymmetric_cycles_are_drawn_with_their_mirror_images():
    leaning = replace(BRANCH, highest=0.15 * SPEEDS, mirrored=True)
    ax = rendered(plot.bifurcation_diagram(replace(diagram(), cycles=(leaning,)), ax=axes()))
    lines = [line for line in ax.lines if line.get_color() == plot.BLUE]
    heights = {round(float(line.get_ydata()[0] / line.get_xdata()[0]), 6) for line in lines}
    assert heights == {0.15, -0.05, -0.15, 0.05}
    marks = [line.get_ydata()[0] for line in ax.lines if line.get_marker() == "^"]
    np.testing.assert_allclose(sorted(marks), [-0.375, -0.125, 0.125, 0.375])


def test_a_portrait_of_cycles_tells_which_are_stable():
    ax = rendered(plot.phase_portrait([circle(), circle(stable=False)], ax=axes()))
    first, second = (line for line in ax.lines if line.get_label().endswith("stable"))
    x, velocity = first.get_xydata().T
    assert np.abs(x).max() == pytest.approx(np.sin(0.1), abs=1e-6)
    assert np.abs(velocity).max() == pytest.approx(1.0, abs=1e-4)
    assert (first.get_linestyle(), second.get_linestyle()) == ("-", "--")
    assert first.get_label() == "0: $u = 5$, Chain, 2 d.o.f., stable"
    alone = plot.phase_portrait(circle(stable=False), ax=axes())
    assert alone.get_title() == "$u = 5$, ejecting, unstable"


def test_multipliers_outside_the_unit_circle_are_crosses():
    ax = rendered(plot.multipliers(circle(), ax=axes()))
    inside, outside = ax.collections
    np.testing.assert_allclose(sorted(inside.get_offsets()[:, 1]), [-0.5, 0.5])
    np.testing.assert_allclose(outside.get_offsets(), [[-1.4, 0.0]])
    assert ax.lines[-1].get_zorder() > outside.get_zorder()  # the ring at 1 is not covered
    assert ax.get_aspect() == 1.0
    assert legend_of(ax) == ["inside the circle", "outside: unstable", "trivial, 1"]
    assert plot.multipliers(circle(), legend=False, ax=axes()).get_legend() is None


def test_multipliers_of_a_branch_are_coloured_by_speed():
    ax = rendered(plot.multipliers(BRANCH, ax=axes()))
    assert sum(len(one.get_offsets()) for one in ax.collections) == 15
    assert len(ax.child_axes) == 1


def test_large_multipliers_do_not_hide_the_unit_circle():
    """On the way to an infinite period they grow without bound."""
    large = replace(circle(), multipliers=np.array([1.0, 0.5j, -0.5j, 4e6]))
    ax = rendered(plot.multipliers(large, ax=axes()))
    assert max(ax.get_xlim()[1], ax.get_ylim()[1]) < 10.0
    assert ax.get_title() == "not all are shown: up to 4e+06"


def drawn(speeds, highest):
    """Curve through points of a branch of cycles."""
    every = {"amplitudes": 0.0 * speeds, "highest": highest, "stable": np.full(speeds.size, True)}
    branch = replace(BRANCH, speeds=speeds, events=(), **every)
    ax = plot.bifurcation_diagram(replace(diagram(), cycles=(branch,)), ax=axes())
    curve, _ = (line.get_xydata() for line in ax.lines if line.get_color() == plot.BLUE)
    return curve


def test_branches_are_drawn_without_corners_through_their_points():
    """Of a circle with 16 points, whose chords turn by 22.5 degrees."""
    turn = np.linspace(0.0, 1.5 * np.pi, 13)
    points = np.stack([5.0 + np.cos(turn), np.sin(turn)], axis=1)
    curve = drawn(*points.T)
    assert np.abs(curve[:, None] - points).max(axis=2).min(axis=0).max() == 0.0
    pieces = np.diff(curve, axis=0)
    angles = np.unwrap(np.arctan2(pieces[:, 1], pieces[:, 0]))
    assert np.degrees(np.abs(np.diff(angles)).max()) < 5.0
    assert np.abs(np.hypot(curve[:, 0] - 5.0, curve[:, 1]) - 1.0).max() < 0.01
    straight = drawn(np.array([1.0, 2.0]), np.zeros(2))
    assert straight[[0, -1], 0].tolist() == [1.0, 2.0]
    assert not straight[:, 1].any()


def test_a_curve_stays_close_to_a_branch_where_short_steps_follow_long_ones():
    turn = np.sort(np.append(np.linspace(0.0, 1.5 * np.pi, 13), 2.0))  # steps of 22.5 and 2 degrees
    curve = drawn(5.0 + np.cos(turn), np.sin(turn))
    assert np.abs(np.hypot(curve[:, 0] - 5.0, curve[:, 1]) - 1.0).max() < 1e-3


def test_no_curve_runs_past_the_points_of_a_branch_that_leaves_another_at_an_angle():
    """Points of a straight pinned pipe that buckles: speeds and heights never fall."""
    speeds, bent = np.linspace(1.0115, 3.1365, 86), 3.1604 + 0.025 * np.arange(115)
    heights = np.append(np.zeros(86), 0.3 * np.sqrt(bent - np.pi))
    curve = drawn(np.append(speeds, bent), heights)
    assert (np.diff(curve, axis=0) > -1e-3 * np.ptp(curve, axis=0)).all()
