# SPDX-License-Identifier: MIT
"""Pictures: what they must not take, and that what they show fits."""

import dataclasses
import inspect
import math
from contextlib import nullcontext

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import pipedyn as pp
from pipedyn import plot

PIPE = pp.Pipe(0.2)
CHAIN = pp.Chain(PIPE, 3)
LOCI = pp.root_loci(CHAIN, [0.0, 1.0, 2.0], 2)
MODES = pp.modes(CHAIN, 1.0)
CRITICAL = pp.critical_speed(CHAIN)
CURVE = pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), 3), [0.1, 0.2], 8.0)


def axes(layout=None):
    figure = Figure(layout=layout)
    FigureCanvasAgg(figure)
    return figure.subplots()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda ax: plot.root_loci(LOCI, ax=3), "ax must be of type Axes, got 3"),
        (lambda ax: plot.root_loci(MODES, ax=ax), "loci must be of type RootLoci, got Modes("),
        (lambda ax: plot.root_loci(LOCI, 3, ax=ax), "benchmark must be of type RootLoci, got 3"),
        (lambda ax: plot.root_loci(LOCI, None, math.nan, ax=ax), "highest must be finite and > 0"),
        (lambda ax: plot.root_loci(LOCI, None, True, ax=ax), "highest must be a real number"),
        (lambda ax: plot.frequencies(LOCI, ax=[ax]), "ax must be of type Axes"),
        (lambda ax: plot.frequencies(None, ax=ax), "loci must be of type RootLoci, got None"),
        (lambda ax: plot.frequencies(LOCI, LOCI, -1, ax=ax), "largest must be finite and >= 0"),
        (lambda ax: plot.mode_shapes(LOCI, ax=ax), "modes must be of type Modes"),
        (
            lambda ax: plot.convergence([CRITICAL], CRITICAL, ax=ax),
            "families must be of type Mapping",
        ),
        (lambda ax: plot.convergence({1: []}, CRITICAL, ax=ax), "the names of families must be"),
        (lambda ax: plot.convergence({"a": CRITICAL}, CRITICAL, ax=ax), "families['a'] must be"),
        (lambda ax: plot.convergence({"a": [1.0]}, CRITICAL, ax=ax), "families['a'][0] must be"),
        (lambda ax: plot.convergence({}, None, ax=ax), "exact must be of type CriticalSpeed"),
        (lambda ax: plot.stability_map(CURVE, ax=ax), "curves must be of type Mapping"),
        (
            lambda ax: plot.stability_map({"a": 3}, ax=ax),
            "curves['a'] must be of type StabilityCurve",
        ),
        (lambda ax: plot.stability_map({}, math.inf, ax=ax), "highest must be finite and > 0"),
        (
            lambda ax: plot.stability_map({}, None, 3.0, ax=ax),
            "marked must be of type CriticalSpeed",
        ),
        (lambda ax: plot.panels(0, 1, 5, 5), "rows must be from 1 to 100, got 0"),
        (lambda ax: plot.panels(1, True, 5, 5), "columns must be a whole number, got True"),
        (lambda ax: plot.panels(1, 1, math.nan, 5), "width must lie in [0.1, 200], got nan"),
        (lambda ax: plot.panels(1, 1, 5, 1e9), "height must lie in [0.1, 200]"),
        (lambda ax: plot.notice(3, ax=ax), "text must be of type str, got 3"),
        (lambda ax: plot.colour_bar(None, np.array([[ax]])), "label must be of type str, got None"),
        (lambda ax: plot.colour_bar("", [ax]), "ax must be of type Axes, got [<Axes"),
        (lambda ax: plot.dot_stride(3), "loci must be of type RootLoci, got 3"),
        (lambda ax: plot.boundaries(np.array(None)), "found must be crossings in a sequence"),
        (lambda ax: plot.boundaries([3]), "found[0] must be of type Crossing, got 3"),
    ],
)
def test_a_picture_refuses_what_it_cannot_show_by_name(call, message):
    with pytest.raises((ValueError, TypeError)) as caught:
        call(axes())
    assert str(caught.value).startswith(message)


NOTHING = dataclasses.replace(LOCI, converged=np.zeros_like(LOCI.converged))
AT_REST = pp.root_loci(CHAIN, [0.0], 2)


@pytest.mark.parametrize(
    "draw",
    [
        lambda ax: plot.root_loci(NOTHING, ax=ax),
        lambda ax: plot.root_loci(AT_REST, ax=ax),
        lambda ax: plot.frequencies(NOTHING, ax=ax),
        lambda ax: plot.frequencies(AT_REST, LOCI, 0.0, ax=ax),
        lambda ax: plot.mode_shapes(dataclasses.replace(MODES, shapes=()), ax=ax),
        lambda ax: plot.convergence({}, CRITICAL, ax=ax),
        lambda ax: plot.convergence({"uniform": []}, CRITICAL, ax=ax),
        lambda ax: plot.convergence({"mine": [CRITICAL]}, CRITICAL, ax=ax),
        lambda ax: plot.stability_map({}, ax=ax),
        lambda ax: plot.stability_map({}, 1.0, CRITICAL, ax=ax),
    ],
)
def test_a_picture_of_little_or_nothing_is_drawn(draw):
    ax = axes()
    assert draw(ax) is ax
    ax.figure.canvas.draw()


def test_a_folded_boundary_is_one_line_through_all_crossings():
    """At gamma = 10 the critical speed folds near beta = 0.62: three crossings, one beside."""
    betas = [0.55, 0.61, 0.62, 0.7]
    curve = pp.stability_curve(
        lambda beta: pp.Galerkin(pp.Pipe(beta, 10.0), 20, "legendre"), betas, max_speed=15.0
    )
    found = [plot.boundaries(crossings) for crossings in curve.crossings]
    assert [len(column) for column in found] == [1, 3, 3, 1]
    (line,) = plot.stability_map({"a": curve}, ax=axes()).lines
    drawn = line.get_xydata()
    for beta, column in zip(curve.values, found, strict=True):
        for crossing in column:
            assert np.abs(drawn - [beta, crossing.speed]).max(axis=1).min() < 1e-12
    turns = np.diff(np.sign(np.diff(drawn[:, 0]))).nonzero()[0]
    assert turns.size == 2  # the tips of the fold
    assert drawn[:, 0].max() == 0.7
    assert (np.diff(drawn[:, 1]) > 0.0).all()


def test_convergence_of_no_model_leaves_axes_that_have_no_positive_data_as_they_are():
    ax = axes()
    ax.plot([-1.0, 0.0], [-2.0, 0.0])
    plot.convergence({"uniform": []}, CRITICAL, ax=ax)
    ax.figure.canvas.draw()
    assert ax.get_yscale() == ax.get_xscale() == "linear"
    assert "No model" in ax.texts[0].get_text()


def found(errors):
    return [
        dataclasses.replace(CRITICAL, speed=CRITICAL.speed * (1.0 + error), error=0.0, size=2**i)
        for i, error in enumerate(errors, 1)
    ]


@pytest.mark.parametrize("layout", [None, "constrained", "tight"])
@pytest.mark.parametrize("within", [plot.style, nullcontext], ids=["style", "defaults"])
def test_the_legend_of_the_convergence_picture_fits_above_the_curves(layout, within):
    families = {name: found(0.5 ** np.arange(1, 7)) for name in plot.FAMILY_STYLES}
    families["rayleigh"] = found(-0.0144 + 0.2 * 0.5 ** np.arange(1, 12))
    exponential = found(20.0 ** -np.arange(1.0, 8.0))
    families["legendre"] = [
        dataclasses.replace(critical, size=size) for size, critical in enumerate(exponential, 1)
    ]
    with within():
        ax = axes(layout)
        plot.convergence(families, dataclasses.replace(CRITICAL, error=0.0), ax=ax)
        ax.figure.canvas.draw()
        frame, legend = ax.get_window_extent(), ax.get_legend().get_window_extent()
    whole = ax.figure.bbox
    assert frame.height > 0.6 * whole.height
    assert frame.width > 0.6 * whole.width
    assert whole.x0 <= legend.x0 < legend.x1 <= whole.x1
    assert legend.y1 <= frame.y1
    assert legend.width < 1.02 * frame.width
    highest = max(float(np.max(line.get_ydata())) for line in ax.lines if len(line.get_ydata()) > 2)
    assert ax.transData.transform((1.0, highest))[1] < legend.y0


def test_every_picture_takes_its_axes_last_and_makes_its_own_without():
    pictures = {
        name: inspect.signature(getattr(plot, name)).parameters
        for name in plot.__all__
        if inspect.isfunction(getattr(plot, name))
    }
    taking = {
        name: tuple(parameters) for name, parameters in pictures.items() if "ax" in parameters
    }
    assert len(taking) >= 14
    for name, parameters in taking.items():
        assert parameters[-1] == "ax", name
        if name != "colour_bar":  # which needs Axes that show something
            assert pictures[name]["ax"].default is None, name
    try:
        for ax in (
            plot.root_loci(LOCI),
            plot.frequencies(LOCI),
            plot.mode_shapes(MODES),
            plot.convergence({}, CRITICAL),
            plot.stability_map({"a": CURVE}),
            plot.notice("nothing"),
        ):
            assert ax.figure.number in plt.get_fignums()
    finally:
        plt.close("all")


def test_a_colour_bar_stands_beside_all_axes_that_share_it():
    figure, several = plot.panels(1, 2, 4.0, 2.0)
    assert plot.colour_bar(plot.SPEED_LABEL, several) is None
    for ax in several.flat:
        plot.root_loci(LOCI, ax=ax)
    bar = plot.colour_bar(plot.SPEED_LABEL, several)
    assert bar.get_ylabel() == plot.SPEED_LABEL
    assert figure.axes == [*several.flat, bar]


def test_pictures_leave_the_settings_of_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    with plot.style():
        plot.convergence({"uniform": found([0.5, 0.25])}, CRITICAL, ax=axes())
    assert dict(matplotlib.rcParams) == before
