# SPDX-License-Identifier: MIT
"""Pictures: what they must not take, and that what they show fits."""

import dataclasses
import inspect
import io
import itertools
import math
import pickle
from contextlib import nullcontext
from functools import cache, partial

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from canvas import axes, legend_of, overlaps, small_letters
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg

import pipedyn as pp
from pipedyn import plot
from pipedyn.accuracy.quantities import LimitCycleAt
from pipedyn.plot import arrange, common
from pipedyn.plot.units import View, of_number

PIPE = pp.Pipe(0.2)
CHAIN = pp.Chain(PIPE, 3)
LOCI = pp.root_loci(CHAIN, [0.0, 1.0, 2.0], 2)
MODES = pp.modes(CHAIN, 1.0)
CRITICAL = pp.critical_speed(CHAIN)


@cache
def buckled():
    window = {"beta": (0.1, 0.5), "u": (0.0, 8.0)}
    return pp.boundary(pp.Chain(pp.Pipe(0.2, -10.0), 4), "beta", "u", window, criticality=False)


@cache
def plain():
    window = {"beta": (0.1, 0.2), "u": (0.0, 8.0)}
    return pp.boundary(CHAIN, "beta", "u", window, criticality=False)


@cache
def standing():
    model, window = pp.Chain(pp.Pipe(0.2, damping=0.01), 2), {"gamma": (-22, 0), "u": (0, 5)}
    return pp.boundary(model, "gamma", "u", window)


def shown(ax):
    """Its lines, without those that are only in the legend."""
    return [line for line in ax.lines if len(line.get_xdata())]


@pytest.mark.parametrize(
    ("draw", "given", "message"),
    [
        (plot.convergence, lambda: ({"a": [1.0]}, CRITICAL), "families['a'][0] must be"),
        (plot.stability_map, lambda: (plain(),), "boundaries must map labels to"),
        (plot.stability_map, lambda: ({"a": 3},), "boundaries['a'] must be of type Boundary"),
        (
            *(
                plot.stability_map,
                lambda: ({"a": dataclasses.replace(plain(), names=("u", "beta"))},),
            ),
            "boundaries['a'] must have 'u' for y, got ('u', 'beta')",
        ),
        (
            *(plot.stability_map, lambda: ({"a": plain(), "b": standing()},)),
            "boundaries must be over one number, got beta, gamma",
        ),
        (partial(plot.colour_bar, ax=[3]), lambda: ("",), "ax must be of type Axes, got [3]"),
    ],
)
def test_a_picture_refuses_what_it_cannot_show_by_name(draw, given, message):
    with pytest.raises((ValueError, TypeError)) as caught:
        draw(*given())
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
        lambda ax: plot.stability_map({}, 1.0, ax=ax),
    ],
)
def test_a_picture_of_little_or_nothing_is_drawn(draw):
    ax = axes()
    assert draw(ax) is ax
    ax.figure.canvas.draw()


def test_a_folded_boundary_is_one_line_through_all_crossings():
    """At gamma = 10 the critical speed folds near beta = 0.62: three crossings, one beside."""
    model = pp.Galerkin(pp.Pipe(0.2, 10.0), 16, "legendre")
    ranges = {"beta": (0.55, 0.7), "u": (0.0, 14.0)}
    found = pp.boundary(model, "beta", "u", ranges, criticality=False)
    (line,) = shown(plot.stability_map({"a": found}, ax=axes()))
    x, y = line.get_xydata().T
    for beta, times in ((0.56, 1), (0.61, 3), (0.62, 3), (0.69, 1)):
        at = np.flatnonzero((x[:-1] - beta) * (x[1:] - beta) <= 0.0)
        speeds = y[at] + (beta - x[at]) / (x[at + 1] - x[at]) * (y[at + 1] - y[at])
        crossings = pp.crossings(model.with_pipe(pp.Pipe(beta, 10.0)), 14.0)
        lost = [c.speed for c in crossings if min(c.unstable_before, c.unstable_after) == 0]
        assert len(lost) == times
        assert sorted(speeds) == pytest.approx(lost, abs=1e-3)  # a hundredth of a line's width
    turns = np.diff(np.sign(np.diff(x))).nonzero()[0]
    assert turns.size == 2  # the tips of the fold
    directions = np.unwrap(np.arctan2(np.diff(y) / 14.0, np.diff(x) / 0.15))
    assert np.abs(np.diff(directions)).max() < 0.1  # no corner that a page shows


def side(line):
    """Points beside the middle of a line, on the side of its ticks and on the other."""
    at = line.get_xydata()
    k = len(at) // 2
    along = at[k] - at[k - 1]
    left = np.array([-along[1], along[0]]) * 0.01 / np.hypot(*along)
    (ticks,) = line.get_path_effects()
    sign = 1.0 if ticks._angle > 0.0 else -1.0
    middle = 0.5 * (at[k] + at[k - 1])
    return middle + sign * left, middle - sign * left


def test_ticks_of_a_map_point_to_the_unstable_side_and_words_tell_what_divergence_it_is():
    window = {"beta": (0.1, 0.5), "u": (0.0, 4.0)}
    held = pp.Galerkin(pp.Pipe(0.6, root="pinned", end="pinned"), 4, "beam")
    pinned = pp.boundary(held, "beta", "u", window, criticality=False)
    for found, words in ((buckled(), "buckled by its weight below"), (pinned, "divergence above")):
        ax = plot.stability_map({"a": found}, ax=axes())
        assert [text.get_text() for text in ax.texts] == [words]
        for line in shown(ax):
            unstable, stable = side(line)
            assert found.unstable(*unstable) > 0 == found.unstable(*stable)
        assert legend_of(ax) == ["a", "ticks: unstable side"]
    ax = plot.stability_map({"a": buckled()}, ax=axes())
    assert min(line.get_ydata().max() for line in shown(ax)) < 2.0  # the flow straightens the pipe


def test_a_map_has_the_label_of_its_number_and_tells_what_failed():
    assert "gravity" in plot.stability_map({"a": standing()}, ax=axes()).get_xlabel()
    failed = dataclasses.replace(plain(), failures=("a curve was not followed",))
    legend = plot.stability_map({"a": failed}, ax=axes()).get_legend()
    assert legend.get_texts()[0].get_text() == "a (1 curve with failures)"


def never_stable(gamma=-50.0):
    return pp.Galerkin(pp.Pipe(0.2, gamma, damping=0.001), 8, "legendre")


UP_TO_HALF = {"beta": (0.1, 0.9), "u": (0.0, 0.5)}


@pytest.mark.parametrize(
    ("swept", "sentence", "labels"),
    [
        (
            lambda: pp.boundary(CHAIN, "beta", "u", UP_TO_HALF, criticality=False),
            "No boundary lies in the window: all is stable.",
            ["a: stable from $u = 0$ to $u = 0.5$"],
        ),
        (
            lambda: pp.boundary(
                pp.Chain(pp.Pipe(0.2, flow="aspirating"), 3),
                *("beta", "u", {"beta": (0.1, 0.9), "u": (0.1, 2.0)}),
                criticality=False,
            ),
            "No boundary lies in the window: all is unstable.",
            ["a: unstable from $u = 0.1$ to $u = 2$"],
        ),
        (
            lambda: dataclasses.replace(plain(), curves=(), failures=("not found",)),
            "No stability boundary was computed.",
            ["a: no boundary known from $u = 0$ to $u = 8$ (1 curve with failures)"],
        ),
    ],
)
def test_a_map_says_why_it_has_no_boundary(swept, sentence, labels):
    found = swept()
    ax = plot.stability_map({"a": found}, ax=axes())
    assert [text.get_text() for text in ax.texts] == [sentence]
    assert legend_of(ax) == labels
    assert (ax.get_xlim(), ax.get_ylim()) == (found.ranges[0], (0.0, found.ranges[1][1]))
    rng = np.random.default_rng(2)
    for beta, u in rng.uniform(*np.array(found.ranges).T, (20, 2)).tolist():
        pipe = dataclasses.replace(found.model.pipe, beta=beta)
        grows = (pp.eigenvalues(found.model.with_pipe(pipe), u).real > 1e-7).any()
        assert found.failures or grows == ("unstable" in sentence)


def test_a_map_shows_all_that_was_searched_and_words_stay_within_it():
    """At gamma = -50 only heavy fluid is held upright: the curves begin at beta = 0.7."""
    window = {"beta": (0.05, 0.9), "u": (0.0, 12.0)}
    found = pp.boundary(never_stable(), "beta", "u", window, criticality=False)
    for width in (3.4, 6.4):
        ax = plot.stability_map({"a": found}, ax=axes(figsize=(width, 3.0)))
        assert ax.get_xlim() == window["beta"]
        assert min(line.get_xdata().min() for line in shown(ax)) > 0.7
        ax.figure.canvas.draw()
        frame = ax.get_window_extent()
        for text in filter(Artist.get_visible, ax.texts):
            assert frame.x0 <= text.get_window_extent().x0
            assert text.get_window_extent().x1 <= frame.x1


def test_a_map_is_in_order_of_gravity():
    def of(gamma):
        model = CHAIN.with_pipe(dataclasses.replace(CHAIN.pipe, gamma=gamma))
        return pp.boundary(model, "beta", "u", {"beta": (0.1, 0.2), "u": (0, 8)}, criticality=False)

    ax = plot.stability_map({f"{gamma:g}": of(gamma) for gamma in (10.0, -10.0, 0.0)}, ax=axes())
    assert legend_of(ax)[:3] == ["-10", "0", "10"]


def test_a_map_ends_at_the_speed_that_is_asked_for():
    assert plot.stability_map({"a": plain()}, 5.0, ax=axes()).get_ylim() == (0.0, 5.0)


def test_a_boundary_shades_what_is_stable_and_names_its_organising_points():
    ax = plot.boundary(standing(), ax=axes())
    (image,) = ax.images
    rows, columns, _ = image.get_array().shape
    left, right, low, high = image.get_extent()
    rng = np.random.default_rng(5)
    wrong = 0
    for i, j in zip(rng.integers(rows, size=60), rng.integers(columns, size=60), strict=True):
        x, y = left + (right - left) * (j + 0.5) / columns, low + (high - low) * (i + 0.5) / rows
        wrong += (image.get_array()[i, j, 3] > 0.0) != (standing().unstable(x, y) == 0)
    assert wrong == 0
    named = set(legend_of(ax))
    assert {point.kind for point in standing().points} <= named
    assert {"Bogdanov-Takens", "degenerate pitchfork"} <= named
    assert {"flutter, supercritical", "divergence, subcritical"} <= named
    ax.figure.canvas.draw()
    below = ax.get_legend().get_window_extent().y1
    assert below < ax.xaxis.label.get_window_extent().y0 + 1.0


LEGENDRE = pp.Galerkin(pp.Pipe(0.3, damping=0.001), 8, basis="legendre")


def shade(ax):
    """Which pixels of a picture of boundaries are shaded, and x and y of their middles."""
    (image,) = ax.images
    left, right, low, high = image.get_extent()
    rows, columns, _ = image.get_array().shape
    x = left + (right - left) * (np.arange(columns) + 0.5) / columns
    y = low + (high - low) * (np.arange(rows) + 0.5) / rows
    return image.get_array()[..., 3] > 0.0, x, y


def test_shading_and_lines_say_what_eigenvalues_say_next_to_organising_points():
    """Other roots become unstable within a step, exactly where curves cross."""
    found = pp.boundary(LEGENDRE, "gamma", "u", {"gamma": (-80.0, 20.0), "u": (0.0, 12.0)})
    ax = plot.boundary(found, ax=axes())
    stable, gammas, speeds = shade(ax)
    rng = np.random.default_rng(3)
    for j, gamma in enumerate(gammas):
        i = rng.integers(1, len(speeds) - 1)
        if (stable[i - 1 : i + 2, j] == stable[i, j]).all():  # a curve lies a pixel away
            model = LEGENDRE.with_pipe(dataclasses.replace(LEGENDRE.pipe, gamma=gamma))
            assert (pp.eigenvalues(model, speeds[i]).real <= 0.0).all() == stable[i, j]
    compared = 0
    for line in shown(ax)[: -len({point.kind for point in found.points})]:
        middles = 0.5 * (line.get_xydata()[1:] + line.get_xydata()[:-1])
        for gamma, u in [*middles[:: max(1, len(middles) // 20)], middles[-1]]:
            model = LEGENDRE.with_pipe(dataclasses.replace(LEGENDRE.pipe, gamma=gamma))
            values = pp.eigenvalues(model, u)
            own = 1 if line.get_color() in (plot.BLUE, plot.PURPLE) else 2
            others = values[np.argsort(np.abs(values.real))][own:]
            beside = not line.get_linewidth() > 1.0
            assert (others.real > 0.0).any() == beside
            compared += 1
    assert compared > 40


def test_what_lies_behind_the_crossing_of_a_curve_with_itself_is_not_shaded():
    """Two pairs grow in the loop behind this double Hopf point, and none before it."""
    pipe = pp.Pipe(0.3846, 15.92, damping=0.00234, terms=[pp.PointMass(1.0, 0.2, 0.05)])
    window = {"PointMass.inertia": (0.0, 0.2), "u": (0.0, 14.0)}
    found = pp.boundary(pp.Galerkin(pipe, 6), *window, window, criticality=False)
    assert [point.kind for point in found.points] == ["double Hopf"]
    stable, inertias, speeds = shade(plot.boundary(found, ax=axes()))
    assert found.unstable(0.01, 6.8) == 4
    assert not stable[np.ix_((speeds > 6.3) & (speeds < 7.5), inertias > 0.006)].any()
    assert found.unstable(0.001, 6.8) == 0
    assert stable[np.ix_(abs(speeds - 6.8) < 0.1, inertias < 0.001)].all()


def test_an_upright_boundary_between_two_columns_parts_what_is_shaded():
    """Without momentum of the jet the flow leaves the buckling load alone: gamma = -7.837."""
    model = pp.Galerkin(pp.Pipe(0.3, alpha=0.0, damping=0.001), 6, basis="legendre")
    window = {"gamma": (-20.0, 5.0), "u": (0.0, 4.0)}
    found = pp.boundary(model, "gamma", "u", window, criticality=False)
    stable, gammas, _ = shade(plot.boundary(found, ax=axes()))
    np.testing.assert_array_equal(stable.all(axis=0), gammas > -7.837)
    np.testing.assert_array_equal(stable.any(axis=0), gammas > -7.837)


def test_parts_of_a_map_end_where_curves_cross():
    point = next(one for one in standing().points if one.kind == "Bogdanov-Takens")
    lines = shown(plot.stability_map({"a": standing()}, ax=axes()))
    ends = [tuple(line.get_xydata()[k]) for line in lines for k in (0, -1)]
    assert sum(end == pytest.approx((point.x, point.y), rel=1e-12) for end in ends) == 2


def test_where_criticality_is_known_no_curve_is_drawn_without():
    """A step in which other roots become unstable is drawn so from the organising point on."""
    chain = pp.Chain(pp.Pipe(0.2, terms=[pp.PointMass(1.0, 0.1)]), 4)
    ranges = {"PointMass.mass": (0.0, 0.5), "u": (3.0, 10.0)}
    drawn = plot.boundary(pp.boundary(chain, "PointMass.mass", "u", ranges), ax=axes())
    labels = {line.get_label() for line in drawn.lines}
    assert "flutter, other roots unstable" in labels
    assert "flutter" not in labels


def test_where_buckling_modes_exchange_the_shading_and_the_criticality_hold():
    """Of an undamped pipe, too: bent equilibria attract beyond its first divergence."""
    pipe = pp.Pipe(0.6, root="pinned", end="pinned", terms=(pp.Foundation(10.0),))
    ranges = {"Foundation.stiffness": (300.0, 500.0), "u": (5.0, 9.0)}
    found = pp.boundary(pp.Galerkin(pipe, 4, "beam"), "Foundation.stiffness", "u", ranges)
    ax = plot.boundary(found, ax=axes())
    shade = ax.images[0].get_array()[..., 3] > 0.0
    assert shade[:160].all()  # below u = 6.28, across the crossing at 389.6
    for curve in found.curves:
        if curve.kind == "divergence":
            squares = [k**2 * np.pi**2 + curve.x / (k**2 * np.pi**2) for k in (1, 2)]
            first = curve.y < np.sqrt(np.min(squares, axis=0)) + 1e-9
            assert set(curve.criticality[first]) == {"supercritical"}


def test_a_boundary_over_the_mass_of_a_term_has_axes_in_si_units():
    pipe = pp.Pipe.from_si(
        length=0.5,
        bending_stiffness=0.01,
        pipe_mass=0.05,
        fluid_mass=0.03,
        terms=[pp.PointMass(0.5, 0.004)],
    )
    ranges = {"PointMass.mass": (0.0, 0.5), "u": (0.0, 8.0)}
    found = pp.boundary(pp.Chain(pipe, 3), "PointMass.mass", "u", ranges, criticality=False)
    ax = plot.boundary(found, units="si", ax=axes())
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        "mass of the point mass $m$ (kg)",
        "flow speed (m/s)",
    )
    assert ax.get_xlim()[1] == pytest.approx(0.5 * 0.08 * 0.5)  # of 0.04 kg
    assert ax.get_ylim()[1] == pytest.approx(pipe.speed_si(8.0))


OUTSIDE = pp.ExternalFlow(0.3, 0.1, end_shape=0.7)
SCALED = {"length": 0.5, "bending_stiffness": 0.01, "pipe_mass": 0.05, "fluid_mass": 0.03}


@pytest.mark.parametrize(
    ("term", "name", "label", "unit"),
    [
        (pp.PointMass(0.5, 0.004), "PointMass.mass", r"$m/[(\mu_p+\mu_f)L]$", "kg"),
        (
            pp.PointMass(0.5, 0.004, 1e-5),
            "PointMass.inertia",
            r"$J/[(\mu_p+\mu_f)L^3]$",
            "kg m$^{2}$",
        ),
        (pp.Spring(0.5, 1.0), "Spring.stiffness", "$kL^3/EI$", "N m$^{-1}$"),
        (pp.CubicSpring(0.5, 1.0), "CubicSpring.stiffness", "$kL^5/EI$", "N m$^{-3}$"),
        (pp.Stop(0.5, 0.1, 1.0), "Stop.stiffness", "$kL^3/EI$", "N m$^{-1}$"),
        (pp.Stop(0.5, 0.1, 1.0), "Stop.gap", "$d/L$", "m"),
        (pp.RotationalSpring(0.5, 1.0), "terms[0].stiffness", "$kL/EI$", "N m"),
        (
            *(pp.Damper(0.5, 1.0), "Damper.coefficient"),
            *(r"$cL/[EI(\mu_p+\mu_f)]^1/2$", "N s m$^{-1}$"),
        ),
        (
            *(pp.RotationalDamper(0.5, 1.0), "RotationalDamper.coefficient"),
            *(r"$c/([EI(\mu_p+\mu_f)]^1/2L)$", "N s m"),
        ),
        (pp.Foundation(1.0), "Foundation.stiffness", "$kL^4/EI$", "N m$^{-2}$"),
        (
            *(pp.Viscosity(1.0), "Viscosity.sigma"),
            *(r"$\sigma L^2/[EI(\mu_p+\mu_f)]^1/2$", "N s m$^{-2}$"),
        ),
        (pp.AddedMass(0.5), "AddedMass.chi", r"$\chi/(\mu_p+\mu_f)$", "kg m$^{-1}$"),
        (pp.Tension(1.0), "Tension.load", "$PL^2/EI$", "N"),
        (pp.Weight(0.5, 1.0), "Weight.load", "$PL^2/EI$", "N"),
        (pp.FollowerForce(0.5, 1.0), "FollowerForce.force", "$FL^2/EI$", "N"),
        (OUTSIDE, "ExternalFlow.chi", r"$\chi/(\mu_p+\mu_f)$", "kg m$^{-1}$"),
        (OUTSIDE, "ExternalFlow.speed", "$u_o$", "m s$^{-1}$"),
        (OUTSIDE, "ExternalFlow.end_shape", "end shape of the external flow $f$", None),
    ],
)
def test_numbers_of_terms_have_a_symbol_and_a_unit_on_axes(term, name, label, unit):
    """In these units the axis shows the number that `Pipe.from_si` was given."""
    pipe, field = pp.Pipe.from_si(**SCALED, terms=[term]), name.split(".")[1]
    measure, si = of_number(name, pipe), View("si", pipe)
    plain = View("nondimensional", pipe).label(measure)
    bare = plain.replace("{", "").replace("}", "").replace(" ", "")
    assert bare.endswith(label.replace(" ", ""))
    assert si.label(measure).endswith(f" ({unit})" if unit else label)
    shown = si.one(measure) * getattr(pipe.terms[0], field)
    assert shown == pytest.approx(getattr(term, field))


def test_a_thin_stable_region_beside_a_double_divergence_is_shaded():
    """An undamped pinned pipe flutters a little above its second divergence, and is stable between:
    without the shading, the curve of that divergence looks like a spur."""
    pipe = pp.Pipe(0.1, root="pinned", end="pinned", terms=(pp.Foundation(10.0),))
    ranges = {"Foundation.stiffness": (0.0, 1000.0), "u": (0.0, 12.0)}
    model = pp.Galerkin(pipe, 6, "beam")
    found = pp.boundary(model, "Foundation.stiffness", "u", ranges, criticality=False)
    stable, stiffnesses, speeds = shade(plot.boundary(found, ax=axes()))
    for stiffness, u in ((380.0, 7.05), (390.0, 7.08), (400.0, 7.14), (350.0, 6.85), (200.0, 6.65)):
        there = model.with_pipe(dataclasses.replace(pipe, terms=(pp.Foundation(stiffness),)))
        at = np.argmin(np.abs(speeds - u)), np.argmin(np.abs(stiffnesses - stiffness))
        assert stable[at] == (pp.eigenvalues(there, u).real < 1e-7).all()


def test_ticks_change_sides_where_a_divergence_turns_from_the_second_to_the_first():
    """The divergence of mode 2 frees an undamped pipe up to where it crosses that of mode 1."""
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", terms=(pp.Spring(0.5, 10.0),))
    window = {"Spring.stiffness": (0.0, 400.0), "u": (0.0, 10.0)}
    model = pp.Galerkin(pipe, 6, "beam")
    found = pp.boundary(model, "Spring.stiffness", "u", window, criticality=False)
    lines = shown(plot.stability_map({"a": found}, ax=axes()))
    level = [line for line in lines if np.ptp(line.get_ydata()) < 1e-6]
    assert len(level) == 2
    assert len(lines) > 4
    for line in lines:
        unstable, stable = side(line)
        assert found.unstable(*unstable) > 0 == found.unstable(*stable)


def test_subcritical_parts_of_a_boundary_differ_in_more_than_colour():
    lines = {line.get_label(): line for line in plot.boundary(standing(), ax=axes()).lines}
    above, below = lines["divergence, supercritical"], lines["divergence, subcritical"]
    assert (above.get_linestyle(), below.get_linestyle()) == ("-", "--")
    beside, alone = lines["divergence, other roots unstable"], lines["flutter"]
    assert beside.get_alpha() < alone.get_alpha()
    assert (beside.get_linestyle(), alone.get_linestyle()) == ("--", "-")  # dots are short dashes


def test_a_window_without_boundaries_says_what_it_is():
    ranges = {"beta": (0.1, 0.9), "u": (0.0, 1.0)}
    found = pp.boundary(CHAIN, "beta", "u", ranges, criticality=False)
    ax = plot.boundary(found, ax=axes())
    assert ax.texts[0].get_text() == "No boundary lies in the window: all is stable."
    assert ax.images[0].get_array()[..., 3].all()
    failed = dataclasses.replace(found, failures=("crossings at 0.5: not found",))
    ax = plot.boundary(failed, ax=axes())
    assert ax.texts[0].get_text() == "No stability boundary was computed."


def test_convergence_of_no_model_leaves_axes_that_have_no_positive_data_as_they_are():
    ax = axes()
    ax.plot([-1.0, 0.0], [-2.0, 0.0])
    plot.convergence({"uniform": []}, CRITICAL, ax=ax)
    ax.figure.canvas.draw()
    assert ax.get_yscale() == ax.get_xscale() == "linear"
    assert "No model" in ax.texts[0].get_text()


@pytest.mark.parametrize("cost", ["seconds", "dof"])
@pytest.mark.parametrize("width", [3.4, 6.4])
def test_costs_have_several_ticks_with_labels_apart_from_each_other(cost, width):
    trade = pp.trade(PIPE, "critical_speed", families="beam", sizes=[4, 6, 12], repeats=1)
    ax = plot.trade(trade, cost, ax=axes(figsize=(width, 2.6)))
    ax.figure.canvas.draw()
    low, high = ax.get_xlim()
    ticks = [tick.label1 for tick in ax.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    boxes = [label.get_window_extent() for label in ticks if label.get_text()]
    assert len(boxes) >= 2
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(boxes))


def test_the_trade_of_one_model_has_ticks_and_explains_no_more_than_is_seen():
    one = pp.trade(PIPE, "critical_speed", families="consistent", sizes=[8], repeats=1)
    ax = plot.trade(one, "dof", ax=axes())
    ax.figure.canvas.draw()
    low, high = ax.get_ylim()
    assert sum(low <= tick <= high for tick in ax.get_yticks()) >= 2
    assert all(label.get_text() for label in ax.get_yticklabels())
    assert legend_of(ax) == ["consistent: no clear order", "Pareto front"]
    curve, _, front = ax.lines
    assert front.get_xydata().tolist() == [[8.0, one.rows[0].error]]
    assert front.get_markersize() > curve.get_markersize()
    assert front.get_marker() == "o"


@pytest.mark.parametrize("within", [nullcontext, partial(plot.style, "single")])
def test_the_label_of_errors_is_whole_above_a_legend_of_many_rows(within):
    trade = pp.trade(PIPE, "critical_speed", sizes=[4, 6, 8], repeats=1)
    cycles = dataclasses.replace(trade, quantity=LimitCycleAt(u=6.5))  # has a long label
    with within():
        ax = plot.trade(cycles, ax=axes())
        ax.figure.draw_without_rendering()
        label, frame = ax.yaxis.label.get_window_extent(), ax.get_window_extent()
    assert ax.figure.bbox.y0 <= label.y0 < label.y1 <= ax.figure.bbox.y1
    assert label.height < 1.1 * frame.height


@pytest.mark.parametrize("sizes", [[4, 8, 24, 28], [24]])
def test_arrows_of_bounds_end_above_the_ticks(sizes):
    trade = pp.trade(PIPE, "critical_speed", families="legendre", sizes=sizes, repeats=1)
    figure = plot.Figure(figsize=(7.0, 5.0), layout="constrained")
    for ax in figure.subplots(2, 2).flat:
        plot.trade(trade, ax=ax)
    figure.draw_without_rendering()
    arrows = [text.arrow_patch.get_window_extent() for text in ax.texts]
    assert len(arrows) > 0
    assert min(arrow.y0 for arrow in arrows) >= ax.get_window_extent().y0


def test_errors_of_convergence_fill_the_axis():
    ax = plot.convergence({"uniform": found(0.05 * 0.7 ** np.arange(5))}, CRITICAL, ax=axes())
    errors = ax.lines[0].get_ydata()
    low, high = ax.get_ylim()
    assert 0.5 * errors[-1] < low < high < 2.0 * errors[0]


def found(errors):
    return [
        dataclasses.replace(CRITICAL, speed=CRITICAL.speed * (1.0 + error), error=0.0, size=2**i)
        for i, error in enumerate(errors, 1)
    ]


@pytest.mark.parametrize(
    ("layout", "within"),
    [(None, plot.style), ("constrained", nullcontext), ("tight", plot.style)],
)
def test_the_legend_of_the_convergence_picture_fits_below_and_no_decade_is_empty(layout, within):
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
        label = ax.xaxis.label.get_window_extent()
    whole = ax.figure.bbox
    assert frame.height > 0.5 * whole.height
    assert frame.width > 0.6 * whole.width
    assert whole.x0 <= legend.x0 < legend.x1 <= whole.x1
    assert whole.y0 <= legend.y0 < legend.y1 <= label.y0 + 1.0
    errors = np.concatenate([line.get_ydata() for line in shown(ax) if len(line.get_xdata()) > 2])
    low, high = ax.get_ylim()
    assert 0.1 * errors.min() < low < errors.min() < errors.max() < high < 10.0 * errors.max()
    assert "reduced, legendre: factor 20 per function" in legend_of(ax)


@pytest.mark.parametrize("name", ["boundary", "stability_map", "time_history", "frequencies"])
@pytest.mark.parametrize("within", [plot.style, nullcontext], ids=["style", "defaults"])
def test_at_one_column_nothing_is_cut_off_and_the_curves_have_room(name, within):
    shows = {"boundary": buckled(), "stability_map": {"n = 4": buckled()}, "frequencies": LOCI}
    motion = pp.simulate(pp.Chain(HOSE, 3), 2.0, 2.0, lambda s: 0.1 * s)
    units = {"units": "si"} if name == "time_history" else {}
    with within():
        ax = axes(figsize=(3.4, 2.45))
        figure = ax.figure
        getattr(plot, name)(shows.get(name, motion), ax=ax, **units)
        figure.canvas.draw()
        texts = [ax.xaxis.label, ax.yaxis.label, *filter(Artist.get_visible, ax.texts)]
        texts += [] if ax.get_legend() is None else [ax.get_legend()]
        boxes = [text.get_window_extent() for text in texts]
        for box in boxes:
            assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
            assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1
        frame = ax.get_window_extent()
        assert frame.height > 0.5 * figure.bbox.height
        for text in ax.texts:  # clear of the axis line
            assert text.get_window_extent().y0 > frame.y0 + 1.0


PICTURES = {
    name: inspect.signature(getattr(plot, name)).parameters
    for name in plot.__all__
    if inspect.isfunction(getattr(plot, name)) and name != "explore"  # a figure of its own
}
OF_RESULTS = {
    name
    for name, parameters in PICTURES.items()
    if name not in ("colour_bar", "dot_stride", "explore", "films", "notice", "style")
}
"""All public functions of `plot` that draw results."""


def test_every_picture_takes_its_axes_last_by_name_and_makes_its_own_without():
    assert len(OF_RESULTS) >= 20
    for name, parameters in PICTURES.items():
        if name in ("dot_stride", "explore", "films", "style"):  # draw on no Axes of the caller
            continue
        *_, last = parameters.values()
        assert (last.name, last.kind, last.default) == ("ax", last.KEYWORD_ONLY, None), name
    before = dict(matplotlib.rcParams)
    try:
        drawn = {name: draw for name, draw in of_the_hose().items() if name != "animate"}
        for name, draw in {**drawn, "notice": partial(plot.notice, "nothing")}.items():
            assert draw().figure.number in plt.get_fignums(), name
            plt.close("all")
        assert dict(matplotlib.rcParams) == before
        mesh = plt.gca().scatter([0.0, 1.0], [0.0, 1.0], c=[0.0, 1.0])
        assert plot.colour_bar("of the current Axes") is mesh.colorbar.ax
    finally:
        plt.close("all")


def test_four_modes_are_drawn_unless_more_are_asked_for():
    found = pp.modes(pp.Chain(pp.Pipe(0.2), 5), 4.0)
    for count, curves in ((None, 4), (2, 2), (5, 5), (99, 5)):
        asked = {} if count is None else {"count": count}
        ax = plot.mode_shapes(found, ax=axes(), **asked)
        labels = [one for one in ax.get_legend_handles_labels()[1] if "lambda" in one]
        assert len(labels) == curves
        assert ax.get_title() == ("$u = 4$" if curves == 5 else f"$u = 4$, {curves} of 5 modes")


HOSE = pp.Pipe.from_si(
    length=0.5, bending_stiffness=0.01, pipe_mass=0.1, fluid_mass=0.02, damping_time=1e-3
)


def film(motion, **how):
    """The Axes of an animation, which is drawn once."""
    plot.animate(motion, fps=5.0, **how)._init_draw()
    return how["ax"]


@cache
def of_the_hose(pipe=HOSE):
    """Each picture of results of a pipe, as a function of `units` and `ax`."""
    chain = pp.Chain(pipe, 2)
    loci = pp.root_loci(chain, [0.0, 3.0, 6.0], 2)
    window = {"gamma": (10.0, 30.0), "u": (0.0, 12.0)}
    onset = pp.boundary(chain, "gamma", "u", window, criticality=False)
    onset.unstable(20.0, 3.0)
    critical = pp.critical_speed(chain)
    sizes = [pp.critical_speed(pp.Chain(pipe, n)) for n in (2, 4, 8)]
    diagram = pp.bifurcation_diagram(chain, [3.0, 4.5], cycles=0)
    cycle = pp.limit_cycle(chain, 5.0)
    branch = pp.CycleBranch(
        *(np.array([4.0, 5.0]), np.array([0.1, 0.2]), np.array([0.1, 0.2]), np.array([9.0, 9.0])),
        *(np.array([True, True]), np.array([cycle.multipliers] * 2), (), (cycle, cycle)),
    )
    motion = pp.simulate(chain, 3.0, 2.0, lambda s: 0.1 * s)
    angles = np.linspace(-0.5, 0.5, 2)
    ends = pp.attractors(chain, 5.0, pp.StartPlane(angles, angles))
    response = pp.frequency_response(chain, 2.0, (0.5, 40.0), input=("force", 1.0))
    edges = np.array([[2.0, 3.0], [1.5, 4.0]])
    region = pp.ParametricRegion("harmonic", np.array([0.1, 0.2]), edges, 0.05, 2.4, 0.0, pipe)
    base = pp.Harmonic(0.02, 5.0)
    forced = pp.forced_response(chain, 2.0, base=base, frequencies=(4.0, 6.0))
    known = pp.CycleBoundary(
        names=("gamma", "u"),
        ranges=onset.ranges,
        curves=(),
        points=(),
        onsets=onset,
        model=chain,
        failures=(),
        evaluations=0,
    )
    trade = pp.trade(pipe, "critical_speed", families="legendre", sizes=[4, 8], repeats=1)
    draw = {
        "animate": (motion,),
        "basins": (ends,),
        "bifurcation_diagram": (dataclasses.replace(diagram, cycles=(branch,)),),
        "boundary": (onset,),
        "convergence": ({"consistent": sizes}, critical),
        "cycle_boundary": (known,),
        "forced_response": (forced,),
        "frequencies": (loci, loci),
        "frequency_response": (response,),
        "mode_shapes": (pp.modes(chain, 3.0),),
        "multipliers": (branch,),
        "parametric_regions": ([region],),
        "phase_portrait": (motion,),
        "poincare_section": (ends,),
        "root_loci": (loci, loci),
        "snapshots": (motion,),
        "spectrum": (ends,),
        "stability_map": ({"a": onset},),
        "time_history": (motion,),
        "trade": (trade,),
    }
    pictures = {name: partial(getattr(plot, name), *given) for name, given in draw.items()}
    return pictures | {"animate": partial(film, motion)}


@cache
def crowded():
    """Pictures with more entries in their legends than those of the hose have."""
    families = {name: found(0.5 ** np.arange(1, 7)) for name in plot.FAMILY_STYLES}
    trade = pp.trade(PIPE, "critical_speed", sizes=[4, 6, 8], repeats=1)
    diagram = pp.bifurcation_diagram(pp.Chain(PIPE, 2), [3.0, 4.0, 5.0], brute_force=1)
    return {
        "bifurcation_diagram": partial(plot.bifurcation_diagram, diagram),
        "boundary": partial(plot.boundary, standing()),
        "convergence": partial(plot.convergence, families, CRITICAL),
        "stability_map": partial(plot.stability_map, {f"pipe {i}": buckled() for i in range(6)}),
        "trade": partial(plot.trade, trade),
    }


SETTINGS = {
    "four, constrained": (nullcontext, 2, {"figsize": (7.0, 5.0), "layout": "constrained"}),
    "four, tight": (nullcontext, 2, {"figsize": (7.0, 5.0), "layout": "tight"}),
    "one column": (partial(plot.style, column="single"), 1, {"figsize": (3.4, 2.6)}),
    "default": (nullcontext, 1, {}),
}
"""Style, number of rows and columns, and figure in which pictures are seen."""


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("name", sorted(OF_RESULTS))
def test_no_picture_collapses_and_no_text_covers_curves_or_texts(name, setting):
    draw = (of_the_hose() | crowded())[name]
    within, count, options = SETTINGS[setting]
    with within():
        figure = plot.Figure(**options)
        FigureCanvasAgg(figure)
        several = list(figure.subplots(count, count, squeeze=False).flat)
        for ax in several:
            draw(ax=ax)
        figure.canvas.draw()
    whole = figure.bbox
    for every in (ax.get_tightbbox() for ax in figure.axes):
        assert whole.x0 - 2.0 < every.x0 < every.x1 < whole.x1 + 2.0  # 0.02 inches
        assert whole.y0 - 2.0 < every.y0 < every.y1 < whole.y1 + 2.0
    for ax in several:
        place = ax.get_position(original=True)
        assert place.height > SHARE_OF_HEIGHT / count
        assert place.width > SHARE_OF_WIDTH / count
        others = [other.get_window_extent() for other in figure.axes if other is not ax]
        assert not ax.get_window_extent().count_overlaps(others)
    assert overlaps(figure) == []
    assert small_letters(figure) == []


SHARE_OF_HEIGHT, SHARE_OF_WIDTH = 0.45, 0.5
"""Least parts of a panel's share of the figure that remain for the curves in each direction."""


def seen(name, layout, size):
    """A figure of two equal pictures that was drawn."""
    figure = plot.Figure(figsize=size, layout=layout)
    FigureCanvasAgg(figure)
    for ax in figure.subplots(1, 2):
        (of_the_hose() | crowded())[name](ax=ax)
    figure.canvas.draw()
    return figure


ARRANGED = ["boundary", "mode_shapes", "trade"]
"""Pictures whose legends or titles depend most on the size of the figure."""


@pytest.mark.parametrize("layout", ["constrained", "tight"])
@pytest.mark.parametrize("name", ARRANGED)
def test_a_figure_that_is_resized_after_it_was_drawn_is_arranged_anew(name, layout):
    figure = seen(name, layout, (10.0, 4.2))
    for size in ((7.0, 3.0), (10.0, 4.2)):
        figure.set_size_inches(size)
        figure.canvas.draw()
        assert overlaps(figure) == []
        assert small_letters(figure) == []
        assert all(ax.get_position().height > SHARE_OF_HEIGHT for ax in figure.axes[:2])


@pytest.mark.parametrize("name", ARRANGED)
def test_texts_stay_apart_in_files_of_any_resolution_and_with_tight_boxes(name):
    figure = seen(name, "constrained", (7.0, 3.0))
    for options in ({"dpi": 300}, {"bbox_inches": "tight"}, {"format": "pdf"}):
        figure.savefig(io.BytesIO(), **options)
        figure.canvas.draw()
        assert overlaps(figure) == [], options
    figure.set_dpi(220.0)
    figure.canvas.draw()
    assert overlaps(figure) == []


@pytest.mark.parametrize("name", ["boundary", "mode_shapes", "frequencies", "time_history"])
def test_a_second_picture_in_the_same_axes_is_arranged_with_the_first(name):
    figure = plot.Figure(figsize=(6.4, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    for _ in range(2):
        (of_the_hose() | crowded())[name](ax=ax)
        figure.canvas.draw()
        assert overlaps(figure) == []


def test_axes_that_were_placed_by_subplots_adjust_stay_there():
    figure = plot.Figure(figsize=(7.0, 5.0))
    FigureCanvasAgg(figure)
    four = list(figure.subplots(2, 2).flat)
    figure.subplots_adjust(left=0.12, right=0.98, bottom=0.12, top=0.92, wspace=0.5, hspace=0.6)
    places = [ax.get_position().bounds for ax in four]
    for ax in four:
        of_the_hose()["mode_shapes"](ax=ax)
    figure.canvas.draw()
    assert figure.get_layout_engine() is None
    assert [ax.get_position().bounds for ax in four] == places
    assert overlaps(figure) == []  # legends are inside, as nothing makes room below


def test_every_picture_is_laid_out_in_a_figure_without_layout_as_in_a_constrained_one():
    for name, draw in of_the_hose().items():
        places = []
        for layout in (None, "constrained"):
            ax = axes(layout)
            draw(ax=ax)
            ax.figure.draw_without_rendering()
            places.append(ax.get_position().bounds)
        np.testing.assert_allclose(*places, atol=1e-9, err_msg=name)


def four_panels():
    """A figure as users have them, with bars, a legend and a title of ours."""
    figure = plot.Figure(figsize=(7.0, 5.0))
    FigureCanvasAgg(figure)
    for ax, name in zip(figure.subplots(2, 2).flat, SHARING_A_FIGURE, strict=True):
        of_the_hose()[name](ax=ax)
    return figure


SHARING_A_FIGURE = ("root_loci", "frequencies", "phase_portrait", "mode_shapes")
SPACES = {"left": 0.12, "right": 0.88, "bottom": 0.12, "top": 0.92, "wspace": 0.9, "hspace": 0.5}


@pytest.mark.parametrize("drawn_before", [False, True])
def test_axes_may_be_adjusted_after_pictures_were_drawn_in_them(drawn_before):
    figure = four_panels()
    if drawn_before:
        figure.canvas.draw()
    usual = plot.Figure(figsize=(7.0, 5.0))
    usual.subplots(2, 2)
    for one in (figure, usual):
        one.subplots_adjust(**SPACES)
        one.canvas.draw()
    assert overlaps(figure) == []
    places = [[ax.get_position().bounds for ax in one.axes] for one in (figure, usual)]
    np.testing.assert_allclose(*places, atol=1e-12)


@pytest.mark.parametrize(
    "lay_out",
    [
        plot.Figure.tight_layout,
        lambda figure: figure.set_layout_engine("tight"),
        lambda figure: figure.set_layout_engine("constrained"),
    ],
)
def test_a_layout_may_be_chosen_after_pictures_were_drawn(lay_out):
    figure = four_panels()
    lay_out(figure)
    for _ in range(2):
        figure.canvas.draw()
        assert overlaps(figure) == []


def test_a_figure_with_a_colour_bar_of_its_user_is_laid_out_and_may_be_adjusted():
    figure = four_panels()
    ax = figure.axes[2]
    figure.colorbar(ax.scatter([0.0], [0.0], c=[1.0]), ax=ax, label="of the user")
    for size in ((7.0, 5.0), (9.0, 6.0)):
        figure.set_size_inches(size)
        figure.canvas.draw()
        assert overlaps(figure) == []
    figure.subplots_adjust(**SPACES)
    figure.canvas.draw()
    assert figure.axes[0].get_position().x0 == SPACES["left"]


def test_edges_of_a_grid_that_its_user_gave_stay():
    figure = plot.Figure(figsize=(7.0, 5.0))
    left, right = (
        figure.add_subplot(figure.add_gridspec(1, 1, left=a, right=b)[0])
        for a, b in ((0.1, 0.4), (0.65, 0.9))
    )
    plot.root_loci(LOCI, ax=left)
    plot.frequencies(LOCI, ax=right)
    figure.draw_without_rendering()
    assert left.get_position().x0 == 0.1
    assert right.get_position().x0 == 0.65


def test_every_picture_with_a_legend_is_drawn_without_on_request():
    for name, draw in (of_the_hose() | crowded()).items():
        if "legend" in PICTURES[name]:
            ax = axes()
            draw(legend=False, ax=ax)
            assert ax.get_legend() is None, name
        else:
            assert name in ("animate", "frequencies", "root_loci", "snapshots"), name


def test_a_label_whose_words_each_have_a_line_is_broken_no_further():
    """A label that no break makes short enough ended in an endless loop."""
    low = plot.Figure(figsize=(6.4, 4.8)).subplots(8, 1)[0]
    plot.boundary(plain(), ax=low)
    low.figure.draw_without_rendering()
    assert low.get_ylabel().count("\n") == 2  # the formula has no spaces


def test_labels_and_sentences_stay_within_their_part_of_a_figure():
    pipe = pp.Pipe(0.2, terms=[pp.RotationalDamper(1.0, 0.1), pp.RotationalDamper(0.5, 0.1)])
    window = {"terms[0].coefficient": (0.0, 1.0), "u": (0.0, 0.5)}
    found = pp.boundary(pp.Chain(pipe, 2), *window, window, criticality=False)
    figure = plot.Figure(figsize=(7.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    several = list(figure.subplots(2, 3).flat)
    for ax in several:
        plot.boundary(found, ax=ax)
    figure.canvas.draw()
    for ax in several:
        (sentence,), frame = ax.texts, ax.get_window_extent()
        for one in (sentence, ax.xaxis.label):
            box = one.get_window_extent()
            assert "\n" in one.get_text()
            assert box.width < figure.bbox.width / 3
            assert (one is not sentence) or frame.x0 < box.x0 < box.x1 < frame.x1


@pytest.mark.parametrize("layout", ["constrained", "tight"])
def test_a_legend_inside_covers_no_curve_when_other_panels_are_drawn(layout):
    figure = plot.Figure(figsize=(7.0, 5.0), layout=layout)
    FigureCanvasAgg(figure)
    first, *others = figure.subplots(2, 2).flat
    curves = [
        first.plot([0.0, 0.5], [0.6, 1.0], label=f"the straight pipe becomes unstable {i}")[0]
        for i in range(5)
    ]
    first.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    arrange.legend_below(first)
    for ax in others:
        plot.boundary(standing(), ax=ax)
    figure.canvas.draw()
    place = first.get_legend().get_window_extent()
    assert place.y0 > first.get_window_extent().y0
    drawn = curves[0].get_transform().transform_path(curves[0].get_path())
    assert not drawn.intersects_bbox(place, filled=False)


@pytest.mark.parametrize("entries", [7, 9])
def test_legends_in_one_column_have_letters_of_at_least_six_points(entries):
    with plot.style(column="single"):
        ax = axes(figsize=(3.4, 2.6))
        for i in range(entries):
            ax.plot(
                [0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 1.0, i], label=f"turning points of motions {i}"
            )
        common.axes(ax, (3.4, 2.6))
        arrange.legend_below(ax)
    ax.figure.canvas.draw()
    assert ax.get_legend().get_texts()[0].get_size() >= 6.0
    assert ax.get_window_extent().height > 0.5 * ax.figure.bbox.height


@pytest.mark.parametrize("setting", SETTINGS)
def test_words_of_a_map_are_written_where_they_cover_nothing(setting):
    """A pinned pipe has divergences close above each other."""
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", terms=(pp.Spring(0.5, 10.0),))
    window = {"Spring.stiffness": (0.0, 400.0), "u": (0.0, 10.0)}
    pinned = pp.boundary(pp.Galerkin(pipe, 6, "beam"), *window, window, criticality=False)
    for found in ({str(k): buckled() for k in range(6)}, {"pinned": pinned}):
        within, count, options = SETTINGS[setting]
        with within():
            figure = plot.Figure(**options)
            FigureCanvasAgg(figure)
            for ax in figure.subplots(count, count, squeeze=False).flat:
                plot.stability_map(found, ax=ax)
            figure.canvas.draw()
        assert any(text.get_visible() for text in ax.texts)
        assert overlaps(figure) == []


@pytest.mark.parametrize("layout", ["tight", "constrained"])
def test_a_legend_of_long_entries_has_fewer_columns_rather_than_entries_of_many_lines(layout):
    figure, panels = plt.subplots(2, 2, figsize=(7.0, 5.0), layout=layout)
    ax = panels[0, 0]
    for words in ("fold of a stable cycle", "rest and flutter both stable"):
        ax.plot([0.0, 1.0], label=words)
    ax.plot([0.0, 1.0], label="the straight pipe becomes unstable")
    ax.plot([0.0], "o", label="Bautin")
    arrange.legend_below(ax)
    figure.canvas.draw()
    lines = [text.get_text().count("\n") + 1 for text in ax.get_legend().get_texts()]
    assert max(lines) <= 2
    plt.close(figure)


def test_a_legend_keeps_below_panels_that_share_labels_at_other_dots_an_inch():
    """Letters are then a little wider or narrower, so that other columns fit."""
    figure = plot.Figure(figsize=(7.0, 5.0), layout="constrained")
    several = list(figure.subplots(2, 2, sharex=True).flat)
    for ax in several:
        plot.boundary(standing(), ax=ax)
        ax.label_outer()
    for dpi in (100.0, 110.0, 72.0):
        figure.set_dpi(dpi)
        FigureCanvasAgg(figure).draw()
        assert overlaps(figure) == []
        for ax in several:
            assert ax.get_legend().get_window_extent().y1 < ax.get_window_extent().y0 + 1.0


def test_a_text_that_a_user_gave_a_legend_remains_when_it_finds_its_place():
    ax = axes(figsize=(3.4, 2.6))
    for i in range(6):
        ax.plot([0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 1.0, i], label=f"motion {i}, " + "of a kind " * 3)
    arrange.legend_below(ax)
    ax.get_legend().set_title("motions")
    ax.get_legend().get_texts()[0].set_text("mine")
    ax.figure.canvas.draw()
    assert legend_of(ax)[0] == "mine"
    assert ax.get_legend().get_title().get_text() == "motions"
    ax.legend([], [])
    ax.figure.canvas.draw()
    assert legend_of(ax) == []


def test_a_figure_whose_texts_find_their_places_can_be_copied():
    ax = plot.stability_map({str(k): buckled() for k in range(6)}, ax=axes(figsize=(3.4, 2.6)))
    copy = pickle.loads(pickle.dumps(ax.figure))
    for figure in ax.figure, copy:
        FigureCanvasAgg(figure).draw()
    texts = [figure.axes[0].get_legend().get_window_extent().bounds for figure in (ax.figure, copy)]
    assert texts[0] == pytest.approx(texts[1])


@pytest.mark.parametrize("setting", ["one column", "four, tight"])
def test_labels_of_basins_are_whole_in_the_first_file_that_is_saved(setting):
    starts = np.linspace(-1.0, 1.0, 13)
    ends = pp.attractors(pp.Chain(PIPE, 2), 3.0, pp.StartPlane(starts, starts))
    within, count, options = SETTINGS[setting]
    with within():
        figure = plot.Figure(**options)
        for ax in figure.subplots(count, count, squeeze=False).flat:
            plot.basins(ends, ax=ax)
        figure.savefig(io.BytesIO(), dpi="figure")
        for ax in figure.axes:
            for box in (ax.yaxis.label.get_window_extent(), ax.xaxis.label.get_window_extent()):
                assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
                assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1
        assert overlaps(figure) == []


def test_a_map_ends_where_the_search_does_and_tells_what_lies_beyond():
    short = dataclasses.replace(plain(), ranges=(plain().ranges[0], (0.0, 4.8)))
    assert plot.stability_map({"a": short}, ax=axes()).get_ylim() == (0.0, 4.8)
    ax = plot.stability_map({"a": plain(), "b": buckled()}, 2.0, ax=axes())
    assert "a: no boundary up to $u = 2$" in legend_of(ax)
    assert "not searched" in legend_of(plot.stability_map({"a": plain()}, 9.0, ax=axes()))


def test_a_boundary_names_its_shading():
    assert "stable" in legend_of(plot.boundary(standing(), ax=axes()))


def test_the_style_of_one_column_sets_the_size_of_figures_and_letters():
    try:
        with plot.style(column="single"):
            ax = plot.boundary(standing())
        assert tuple(ax.figure.get_size_inches()) == (3.4, 2.6)
        assert ax.xaxis.label.get_size() == 7.0
        with plot.style():
            ax = plot.boundary(standing())
        assert tuple(ax.figure.get_size_inches()) == (6.4, 4.8)
        assert ax.xaxis.label.get_size() == 8.0
    finally:
        plt.close("all")


def test_every_picture_shows_si_units_on_request():
    assert set(of_the_hose()) == OF_RESULTS
    metre, second, speed = HOSE.length_si(1.0), HOSE.time_si(1.0), HOSE.speed_si(1.0)
    units = {  # what a nondimensional 1 is, in the unit that a label ends with
        "flow speed (m/s)": speed,
        "velocity of the free end $\\dot{x}$ (m/s)": metre / second,
        "(m)": metre,
        "time (s)": second,
        "(Hz)": HOSE.frequency_si(1.0) / (2.0 * math.pi),
        "(1/s)": 1.0 / second,
        "(rad/s)": 1.0 / second,
        "(m/N)": metre / (HOSE.scales.mass * metre**2 / second**2),
    }
    seen = set()
    for name, draw in of_the_hose().items():
        pair = []
        for system in ("nondimensional", "si"):
            ax = axes()
            draw(units=system, ax=ax)
            pair.append(ax)
        plain, si = pair
        for axis, other in ((plain.xaxis, si.xaxis), (plain.yaxis, si.yaxis)):
            label = other.label.get_text()
            found = [one for words, one in units.items() if label.endswith(words)]
            expected = axis.get_view_interval() * (found or [1.0])[0]
            assert other.get_view_interval() == pytest.approx(expected, 1e-9, 1e-12), (name, label)
            seen |= {words for words in units if label.endswith(words)}
    assert seen == set(units)


def test_a_pipe_without_scales_has_no_si_units():
    for name, draw in of_the_hose(dataclasses.replace(HOSE, scales=None)).items():
        ax = axes()
        with pytest.raises(ValueError, match="units must be 'nondimensional' where the pipe has"):
            draw(units="si", ax=ax)
        with pytest.raises(ValueError, match="units must be one of 'nondimensional', 'si'"):
            draw(units="SI", ax=ax)
        assert draw(ax=ax), name


def test_a_colour_bar_stands_beside_all_axes_that_share_it():
    figure = plot.Figure(figsize=(4.0, 2.0), layout="constrained")
    several = figure.subplots(1, 2, squeeze=False)
    assert plot.colour_bar(plot.SPEED_LABEL, ax=several) is None
    for ax in several.flat:
        plot.root_loci(LOCI, ax=ax)
    bar = plot.colour_bar(plot.SPEED_LABEL, ax=several)
    assert bar.get_ylabel() == plot.SPEED_LABEL
    assert figure.axes == [*several.flat, bar]
    several[0, 1].clear()
    plot.root_loci(pp.root_loci(CHAIN, [0.0, 1.0, 3.0], 2), ax=several[0, 1])
    with pytest.raises(ValueError, match=r"ax must hold collections .* got 0 to 2 and 0 to 3"):
        plot.colour_bar(plot.SPEED_LABEL, ax=several)


def test_axes_at_a_place_of_their_own_are_left_there():
    figure = plot.Figure(figsize=(4.0, 3.0))
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0.2, 0.3, 0.7, 0.6))
    plot.boundary(plain(), ax=ax)
    figure.canvas.draw()  # without a warning
    assert ax.get_position().bounds == pytest.approx((0.2, 0.3, 0.7, 0.6))


def test_pictures_leave_the_settings_of_matplotlib_alone():
    before = dict(matplotlib.rcParams)
    with plot.style():
        plot.convergence({"uniform": found([0.5, 0.25])}, CRITICAL, ax=axes())
    assert dict(matplotlib.rcParams) == before


def test_speeds_over_the_mass_ratio_have_units_of_their_own():
    """Over beta the unit of u changes: each point is multiplied by that at its own beta."""
    window = {"beta": (0.1, 0.5), "u": (0.0, 9.0)}
    found = pp.boundary(pp.Chain(HOSE, 3), "beta", "u", window, criticality=False)
    length, stiffness = HOSE.scales.length, HOSE.scales.mass * HOSE.scales.length**4
    stiffness /= HOSE.scales.time**2

    def unit(beta):
        return math.sqrt(stiffness / (HOSE.scales.mass * beta)) / length

    for ax in plot.stability_map({"chain": found}, units="si"), plot.boundary(found, units="si"):
        (line,) = (one for one in ax.lines if one.get_xdata().size > 5)
        for end in 0, -1:
            expected = found.curves[0].y[end] * unit(line.get_xdata()[end])
            assert line.get_ydata()[end] == pytest.approx(expected, rel=1e-6)
    assert ax.get_ylim() == pytest.approx((0.0, 9.0 * unit(0.1)))
    shade = ax.images[0].get_array()
    left, right, low, high = ax.images[0].get_extent()
    assert (left, right) == (0.1, 0.5)
    seen = set()
    for i, j in itertools.product(range(25, 500, 50), repeat=2):
        beta = left + (right - left) * (j + 0.5) / 500
        u = (low + (high - low) * (i + 0.5) / 500) / unit(beta)
        stable = u < 9.0 and found.unstable(beta, u) == 0
        seen.add((stable, tuple(shade[i, j])))
    assert len(seen) == len({colour for _, colour in seen}) == 2
    hatch = ax.collections[0].get_paths()[0]  # above the window
    assert hatch.contains_point((0.4, 9.1 * unit(0.4)))
    assert not hatch.contains_point((0.4, 8.9 * unit(0.4)))
    assert "not searched" in set(legend_of(ax))


def test_a_map_in_si_tells_where_nothing_was_searched():
    """The highest speed searched is one number; in m/s it falls with the mass ratio."""
    hose = pp.Pipe.from_si(length=1.2, bending_stiffness=0.08, pipe_mass=0.2, fluid_mass=0.11)
    window = {"beta": (0.1, 0.9), "u": (0.0, 12.0)}
    found = pp.boundary(pp.Chain(hose, 3), "beta", "u", window, criticality=False)
    words = []
    for units in ("nondimensional", "si"):
        ax = plot.stability_map({"hose": found}, highest=12.0, units=units)
        words.append(legend_of(ax))
        top = ax.get_ylim()[1]
    assert "not searched" not in words[0]
    assert "not searched" in words[1]
    [area] = ax.collections
    [lowest] = {tuple(p) for path in area.get_paths() for p in path.vertices if p[0] == 0.9} - {
        (0.9, top)
    }
    assert lowest[1] == pytest.approx(dataclasses.replace(hose, beta=0.9).speed_si(12.0))
