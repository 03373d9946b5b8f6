# SPDX-License-Identifier: MIT
"""Pictures: what they must not take, and that what they show fits."""

import dataclasses
import math
from contextlib import nullcontext

import matplotlib
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
        (lambda ax: plot.root_loci(None, LOCI), "ax must be of type Axes, got None"),
        (lambda ax: plot.root_loci(ax, MODES), "loci must be of type RootLoci, got Modes("),
        (lambda ax: plot.root_loci(ax, LOCI, 3), "benchmark must be of type RootLoci, got 3"),
        (lambda ax: plot.root_loci(ax, LOCI, None, math.nan), "highest must be finite and > 0"),
        (lambda ax: plot.root_loci(ax, LOCI, None, True), "highest must be a real number"),
        (lambda ax: plot.frequencies([ax], LOCI), "ax must be of type Axes"),
        (lambda ax: plot.frequencies(ax, None), "loci must be of type RootLoci, got None"),
        (lambda ax: plot.frequencies(ax, LOCI, LOCI, -1), "largest must be finite and >= 0"),
        (lambda ax: plot.mode_shapes(ax, LOCI), "modes must be of type Modes"),
        (lambda ax: plot.convergence(ax, [CRITICAL], CRITICAL), "families must be of type Mapping"),
        (lambda ax: plot.convergence(ax, {1: []}, CRITICAL), "the names of families must be"),
        (lambda ax: plot.convergence(ax, {"a": CRITICAL}, CRITICAL), "families['a'] must be"),
        (lambda ax: plot.convergence(ax, {"a": [1.0]}, CRITICAL), "families['a'][0] must be"),
        (lambda ax: plot.convergence(ax, {}, None), "exact must be of type CriticalSpeed"),
        (lambda ax: plot.stability_map(ax, CURVE), "curves must be of type Mapping"),
        (lambda ax: plot.stability_map(ax, {"a": 3}), "curves['a'] must be of type StabilityCurve"),
        (lambda ax: plot.stability_map(ax, {}, math.inf), "highest must be finite and > 0"),
        (lambda ax: plot.stability_map(ax, {}, None, 3.0), "marked must be of type CriticalSpeed"),
        (lambda ax: plot.panels(0, 1, 5, 5), "rows must be from 1 to 100, got 0"),
        (lambda ax: plot.panels(1, True, 5, 5), "columns must be a whole number, got True"),
        (lambda ax: plot.panels(1, 1, math.nan, 5), "width must lie in [0.1, 200], got nan"),
        (lambda ax: plot.panels(1, 1, 5, 1e9), "height must lie in [0.1, 200]"),
        (lambda ax: plot.notice(ax, 3), "text must be of type str, got 3"),
        (lambda ax: plot.colour_bar(None, np.array([[ax]]), ""), "figure must be of type Figure"),
        (lambda ax: plot.colour_bar(ax.figure, [ax], ""), "axes must be of type ndarray"),
        (lambda ax: plot.dot_stride(3), "loci must be of type RootLoci, got 3"),
        (lambda ax: plot.boundaries(np.array(None)), "found must be passages in a sequence"),
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
        lambda ax: plot.root_loci(ax, NOTHING),
        lambda ax: plot.root_loci(ax, AT_REST),
        lambda ax: plot.frequencies(ax, NOTHING),
        lambda ax: plot.frequencies(ax, AT_REST, LOCI, 0.0),
        lambda ax: plot.mode_shapes(ax, dataclasses.replace(MODES, shapes=())),
        lambda ax: plot.convergence(ax, {}, CRITICAL),
        lambda ax: plot.convergence(ax, {"uniform": []}, CRITICAL),
        lambda ax: plot.convergence(ax, {"mine": [CRITICAL]}, CRITICAL),
        lambda ax: plot.stability_map(ax, {}),
        lambda ax: plot.stability_map(ax, {}, 1.0, CRITICAL),
    ],
)
def test_a_picture_of_little_or_nothing_is_drawn(draw):
    ax = axes()
    assert draw(ax) is ax
    ax.figure.canvas.draw()


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
        plot.convergence(ax, families, dataclasses.replace(CRITICAL, error=0.0))
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


def test_pictures_leave_the_settings_of_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    with plot.style():
        plot.convergence(axes(), {"uniform": found([0.5, 0.25])}, CRITICAL)
    assert dict(matplotlib.rcParams) == before
