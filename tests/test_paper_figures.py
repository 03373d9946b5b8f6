# SPDX-License-Identifier: MIT
"""Figures 2 and 3 of the paper's analysis are fit to be printed."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from canvas import overlaps
from matplotlib.backends.backend_agg import FigureCanvasAgg

import pipedyn as pp
from pipedyn import plot
from pipedyn.paper.analysis import Findings, Options, Row
from pipedyn.paper.report import (
    convergence_figure,
    frequency_figure,
    instabilities,
    loci_figure,
    map_figure,
    second_mode,
    table,
)

PIPE = pp.Pipe(0.2)
CASE = Options(PIPE, ["rayleigh"], [2, 12], [4], "beam", None, 41, Path(), "png", 0, False)


@cache
def findings():
    """A coarse chain, a fine one, and one that failed."""
    speeds, exact = np.linspace(0.0, 9.0, 41), pp.Continuum(PIPE)
    coarse, fine = (pp.root_loci(pp.Chain(PIPE, n), speeds, min(n, 4)) for n in (4, 12))
    maps = {
        gamma: pp.boundary(
            pp.Galerkin(pp.Pipe(0.2, gamma), 6),
            *("beta", "u", {"beta": (0.1, 0.3), "u": (0.0, 8.0)}),
            criticality=False,
        )
        for gamma in (0.0, 10.0, -10.0)
    }
    return Findings(
        highest=9.0,
        exact=pp.critical_speed(exact),
        benchmark=pp.root_loci(exact, speeds, 4),
        panels=[[("coarse", coarse), ("fine", fine), ("failed", None)]],
        maps=maps,
    )


@cache
def drawn(draw):
    """A figure, laid out."""
    with plot.style():
        figure = draw(CASE, findings())
        FigureCanvasAgg(figure)
        figure.canvas.draw()
    return figure


FIGURES = pytest.mark.parametrize("draw", [loci_figure, frequency_figure])


@FIGURES
def test_panels_have_letters_and_the_legend_tells_the_marks(draw):
    figure = drawn(draw)
    panels = figure.axes[:3]
    assert [ax.get_title() for ax in panels] == ["(a) coarse", "(b) fine", "(c) failed"]
    assert figure.get_suptitle().count("nondimensional") == 1
    assert not any("nondimensional" in ax.get_xlabel() + ax.get_ylabel() for ax in figure.axes)
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert "its critical speed, $u_c = 5.591$" in words
    frames = [ax.get_tightbbox() for ax in panels]
    titles = [ax.title.get_window_extent() for ax in panels]
    assert all(a.x1 < b.x0 for a, b in pairwise(titles))
    assert legend.get_window_extent().y1 < min(frame.y0 for frame in frames)
    assert legend.get_window_extent().y0 >= 0.0


@FIGURES
def test_one_column_of_panels_has_room_for_the_title_and_the_legend(draw):
    column = [[one] for one in findings().panels[0][:2]]
    with plot.style():
        figure = draw(CASE, replace(findings(), panels=column))
        FigureCanvasAgg(figure)
        figure.canvas.draw()
    (legend,) = figure.legends
    for one in (figure._suptitle, legend):
        extent = one.get_window_extent()
        assert 0.0 <= extent.x0 < extent.x1 <= figure.bbox.x1
        assert not any(extent.overlaps(ax.get_tightbbox()) for ax in figure.axes)


def test_the_critical_speed_is_marked_in_both():
    exact = findings().exact
    for ax in drawn(loci_figure).axes[:3]:
        (mark,) = [line for line in ax.lines if line.get_marker() == "+"]
        assert mark.get_xydata().tolist() == [[0.0, exact.frequency]]
    for ax in drawn(frequency_figure).axes[:3]:
        (line,) = [line for line in ax.lines if line.get_linestyle() == ":"]
        assert line.get_xdata() == [exact.speed, exact.speed]


@FIGURES
def test_axes_are_those_of_the_continuous_pipe_and_tell_what_is_outside(draw):
    coarse, fine, _, *_ = drawn(draw).axes
    exact, model = findings().benchmark.eigenvalues, findings().panels[0][0][1].eigenvalues
    assert coarse.get_ylim()[1] < 1.2 * exact.imag.max()
    if draw is loci_figure:
        left, right = coarse.get_xlim()
        width = np.ptp(np.append(exact.real, findings().benchmark.partners.real))
        assert right - left < 1.5 * width
        assert model.real.max() > right
        notes = [text.get_text() for text in coarse.texts]
        assert any(f"Re $\\lambda$ to {model.real.max():.3g}" in note for note in notes)
        assert not any("outside" in text.get_text() for text in fine.texts)


@FIGURES
def test_notes_of_what_is_outside_cover_neither_curves_nor_numbers(draw):
    with plot.style():
        figure = draw(CASE, replace(findings(), highest=6.0))
        FigureCanvasAgg(figure)
        figure.canvas.draw()
    assert any("outside" in text.get_text() for ax in figure.axes for text in ax.texts)
    assert overlaps(figure) == []


@pytest.mark.parametrize(
    ("gamma", "said"),
    [
        (0.0, "is stable from u = 0 to u = 5.5914. Instabilities: u = 5.5914 (flutter"),
        (
            -10.0,
            "The pipe is buckled at rest. Up to u = 8 the continuous pipe is stable from u = 1.",
        ),
        (
            -50.0,
            "The pipe is buckled at rest. Up to u = 8 the continuous pipe is unstable at every",
        ),
    ],
)
def test_speeds_at_which_the_pipe_is_stable_are_told(gamma, said):
    pipe = pp.Pipe(0.2, gamma)
    exact = pp.Continuum(pipe)
    critical = pp.critical_speed(exact)
    row = Row("chain", "rayleigh", 4, pp.critical_speed(pp.Chain(pipe, 4, springs="rayleigh")))
    known = Findings(8.0, critical, crossings=pp.crossings(exact, 8.0), rows=[row])
    assert said in instabilities(pipe, known)
    never = gamma == -50.0
    assert [line[10] for line in table(pipe, known)] == [never * "unstable below, too"] * 2
    assert ("no stability to lose" in second_mode(critical, known.rows)) == never
    assert "not computed" in instabilities(pipe, Findings(8.0, critical))


def test_modes_that_damping_keeps_from_oscillating_have_no_number():
    """The number differs from model to model: the sixth, the seventh, the seventeenth."""
    pipe = pp.Pipe(0.225, 998.0, damping=0.01)
    exact = pp.Continuum(pipe)
    rows = [Row("chain", "consistent", 16, pp.critical_speed(pp.Chain(pipe, 16)))]
    critical = pp.critical_speed(exact)
    known = Findings(30.0, critical, crossings=pp.crossings(exact, 30.0), rows=rows)
    assert "(flutter, begins), u = " in instabilities(pipe, known)
    assert [line[6] for line in table(pipe, known)] == ["", ""]
    assert "so damped that they do not oscillate" in second_mode(critical, rows)
    light = replace(pipe, damping=0.001)
    known = Findings(24.0, pp.critical_speed(pp.Continuum(light)))
    known.crossings = pp.crossings(pp.Continuum(light), 24.0)
    number = known.exact.mode
    assert f"(flutter, mode {number}, begins)" in instabilities(light, known)
    assert [line[6] for line in table(light, known)] == [str(number)]


def test_panels_write_what_they_leave_out_below_their_title():
    chain = pp.Chain(pp.Pipe(0.2, flow="aspirating"), 12)
    with pytest.warns(pp.BranchesMissing):
        loci = pp.root_loci(chain, np.linspace(0.0, 9.0, 21), 2)
    figure = frequency_figure(CASE, replace(findings(), panels=[[("fed", loci)]]))
    assert figure.axes[0].get_title(loc="right") == ""
    written = [text.get_text().replace("\n", " ") for text in figure.axes[0].texts]
    assert any(text.startswith(loci.missing) for text in written)


def test_the_map_is_in_order_of_gravity_and_titles_are_no_sentences():
    found = findings()
    (ax,) = map_figure(CASE, found).axes
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert words[:4] == [
        rf"$\beta = 0.2$, $\gamma = 0$: $u = {found.exact.speed:.4g}$",
        *(r"$\gamma = -10$", r"$\gamma = 0$", r"$\gamma = 10$"),
    ]
    never = pp.critical_speed(pp.Galerkin(pp.Pipe(0.2, -50.0, damping=0.001), 8, "legendre"))
    (unmarked,) = map_figure(CASE, replace(found, exact=never)).axes
    assert len(unmarked.get_legend().get_texts()) == len(words) - 1  # no stability is lost there
    (ax,) = convergence_figure(CASE, findings()).axes
    assert "." not in ax.get_title().replace("0.2", "")
    (ax,) = convergence_figure(replace(CASE, pipe=pp.Pipe(0.2, damping=9.8e-5)), found).axes
    assert ax.get_title().endswith(r"damping $\delta = 9.8 \times 10^{-5}$")
