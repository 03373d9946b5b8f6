# SPDX-License-Identifier: MIT
"""Pictures of driven pipes show what the results say."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from canvas import axes, legend_of

import pipedyn as pp
from pipedyn import plot

PIPE = pp.Pipe.from_si(
    length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.08, fluid_mass=0.05, damping_time=2e-3
)
RESPONSE = pp.frequency_response(pp.Galerkin(PIPE, 3), 2.0, (0.5, 40.0))
REGION = pp.ParametricRegion(
    "harmonic", np.array([0.1, 0.2]), np.array([[2, 3], [1.5, 4]]), 0.05, 2.4, 0.0, PIPE
)


def test_a_response_at_any_frequencies_is_drawn_from_left_to_right():
    found = pp.frequency_response(pp.Galerkin(PIPE, 3), 2.0, [9.0, 2.0, 0.0])
    curve = plot.frequency_response(found, ax=axes()).lines[0]
    assert curve.get_xdata().tolist() == [0.0, 2.0, 9.0]
    still = pp.frequency_response(pp.Galerkin(PIPE, 3), 2.0, [0.0])
    assert np.isnan(plot.frequency_response(still, ax=axes()).lines[0].get_ydata()).all()


def test_a_pulsation_without_regions_has_its_pipe():
    none = pp.parametric_regions(pp.Chain(PIPE, 2), 1.0, [0.01], (50.0, 60.0))
    assert len(none) == 0
    ax = plot.parametric_regions(none, units="si", ax=axes())
    assert ax.get_xlabel() == "frequency (Hz)"
    assert ax.get_ylim() == (0.0, 0.01)
    assert [text.get_text() for text in ax.texts] == ["no region to show"]
    assert ax.get_legend() is None


def test_the_response_is_drawn_with_its_resonances():
    ax = plot.frequency_response(RESPONSE, ax=axes())
    curve, *others = ax.lines
    np.testing.assert_allclose(curve.get_ydata(), np.abs(RESPONSE.response))
    rings = others[-1].get_xydata()
    np.testing.assert_allclose(rings, [[r.frequency, r.height] for r in RESPONSE.resonances])
    width = np.ptp(others[0].get_xdata())
    assert width == pytest.approx(RESPONSE.resonances[0].width, rel=1e-2)
    phase = plot.frequency_response(RESPONSE, True, ax=axes()).lines[0].get_ydata()
    known = np.isfinite(phase)  # a jump breaks the curve
    np.testing.assert_allclose(phase[known], np.degrees(np.angle(RESPONSE.response[known])))
    assert np.mean(known) > 0.9


def test_the_legend_of_a_response_explains_bars_rings_and_triangles():
    assert legend_of(plot.frequency_response(RESPONSE, ax=axes())) == [
        "half-power width",
        "resonance",
    ]
    undamped = pp.frequency_response(pp.Galerkin(pp.Pipe(0.2), 3), 0.0, (1.0, 30.0))
    assert legend_of(plot.frequency_response(undamped, ax=axes())) == [
        "resonance of infinite height"
    ]
    assert plot.frequency_response(RESPONSE, True, ax=axes()).get_legend() is None


def test_the_label_of_a_response_breaks_in_no_formula():
    found = pp.frequency_response(pp.Galerkin(PIPE, 3), 2.0, (0.5, 40.0), output=0.7)
    for height in np.arange(1.8, 3.0, 0.1):
        ax = plot.frequency_response(found, ax=axes(figsize=(3.4, height)))
        ax.figure.draw_without_rendering()
        lines = ax.get_ylabel().split("\n")
        assert len(lines) > 1
        assert all(line.count("$") % 2 == 0 for line in lines)


@pytest.mark.parametrize("low", [1e-3, 2.1])
@pytest.mark.parametrize("decades", [0.02, 0.6, 1.7])
def test_labels_of_a_response_lie_apart_however_little_it_varies(low, decades):
    peaks = replace(RESPONSE, resonances=())
    sizes = low * 10.0 ** (decades * np.linspace(0.0, 1.0, peaks.frequencies.size))
    figure = plot.Figure(figsize=(7.0, 5.0), layout="constrained")
    for ax in figure.subplots(2, 2).flat:
        plot.frequency_response(replace(peaks, response=sizes + 0j), ax=ax)
    figure.draw_without_rendering()
    bottom, top = ax.get_ylim()
    ticks = [*ax.yaxis.get_major_ticks(), *ax.yaxis.get_minor_ticks()]
    labels = [tick.label1 for tick in ticks if bottom <= tick.get_loc() <= top]
    boxes = [label.get_window_extent() for label in labels if label.get_text()]
    boxes.sort(key=lambda box: box.y0)
    assert len(boxes) >= 2
    assert all(under.y1 < over.y0 for under, over in itertools.pairwise(boxes))


def test_infinite_resonances_are_marked_at_the_upper_end():
    found = pp.frequency_response(pp.Galerkin(pp.Pipe(0.2), 3), 0.0, (1.0, 30.0))
    marks = plot.frequency_response(found, ax=axes()).lines[1]
    np.testing.assert_allclose(marks.get_xdata(), [r.frequency for r in found.resonances])


def test_regions_are_drawn_from_their_least_amplitude_on():
    ax = plot.parametric_regions([REGION, REGION], ax=axes())
    outline, ring, *_ = ax.lines
    known = [[1.5, 0.2], [2.0, 0.1], [2.4, 0.05], [3.0, 0.1], [4.0, 0.2]]
    missed = np.abs(outline.get_xydata()[:, None] - known).max(axis=2).min(axis=0)
    assert missed.max() < 1e-12
    np.testing.assert_allclose(outline.get_xydata()[[0, -1]], [known[0], known[-1]])
    np.testing.assert_allclose(ring.get_xydata(), [[2.4, 0.05]])
    assert legend_of(ax) == ["harmonic", "least amplitude"]


def test_forced_motions_are_drawn_with_their_folds():
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.002), 2)
    found = pp.forced_response(model, 0.0, base=pp.Harmonic(0.02, 20.0), frequencies=(15.0, 26.0))
    ax = plot.forced_response(found, ax=axes())
    folds = [event for event in found.branches[0].events if event.kind == "fold"]
    marked = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "<"]
    np.testing.assert_allclose(marked, [[fold.frequency, fold.amplitude] for fold in folds])
    words = set(legend_of(ax))
    assert words == {"base, stable", "base, unstable", "fold"}
    assert max(found.branches[0].frequency) > 26.0  # the end of the last step
    assert ax.get_xlim() == (15.0, 26.0)


def test_motions_out_of_a_plane_are_drawn_with_their_amplitude_across():
    model = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.001), 3, dimensions=3)
    base = pp.Harmonic(0.01, 5.0)
    found = pp.forced_response(model, 0.1, base=base, frequencies=(5.1, 5.21))
    ax = plot.forced_response(found, ax=axes())
    away = found.branches[1]
    across = [line.get_xydata() for line in ax.lines if line.get_label().startswith("across")]
    drawn = np.concatenate(across)
    known = np.stack([away.frequency, away.amplitude_across], axis=1)
    assert np.abs(drawn[:, None] - known).max(axis=2).min(axis=0).max() < 1e-12
    assert {"out of plane, stable", "across, stable", "pitchfork"} <= set(legend_of(ax))
    assert ax.get_xlim() == (5.1, 5.21)


def test_a_response_across_a_plane_says_so():
    bent = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.05, inclination=1.2), 3, dimensions=3)
    labels = [
        plot.frequency_response(
            pp.frequency_response(bent, 1.0, (1.0, 9.0), direction=direction), ax=axes()
        )
        .get_ylabel()
        .replace("\n", " ")
        for direction in "xyz"
    ]
    ends = "free end / base|", "free end / base along $y$|", "free end along $z$ / base|"
    for label, end in zip(labels, ends, strict=True):
        assert label == f"|displacement of the {end}"


def test_branches_of_each_kind_look_like_the_legend_says_and_kinds_differ_in_grey():
    forced = pp.forced_response(
        pp.Chain(pp.Pipe(0.2, damping=0.003), 2), pp.Pulsation(3.0, 0.6, 12.0), frequencies=(2, 12)
    )
    assert len(forced.branches) > len(kinds := {branch.kind for branch in forced.branches}) == 2
    ax = plot.forced_response(forced, ax=axes())

    def look(line):
        return line.get_label(), line.get_color(), line.get_linestyle(), line.get_linewidth()

    curves = {look(line) for line in ax.lines if line.get_linestyle() != "None"}
    handles = ax.get_legend().legend_handles
    assert curves == {look(line) for line in handles if line.get_linestyle() != "None"}
    assert {label.split(",")[0] for label, *_ in curves} == kinds
    assert len({(line, width) for _, _, line, width in curves}) == len(curves)


def largest_turn(curve):
    """Largest change of direction, in degrees, along a curve that fills a square."""
    steps = np.diff(curve / np.ptp(curve, axis=0), axis=0)
    steps = steps[np.hypot(*steps.T) > 1e-9]
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    return np.degrees(np.abs(turns).max())


def test_a_forced_response_has_no_corners_and_shows_motions_between_the_steps():
    found = pp.forced_response(
        pp.Galerkin(pp.Pipe(0.2), 3), 5.3, base=pp.Harmonic(0.01, 13.0), frequencies=(11.0, 17.0)
    )
    (line,) = plot.forced_response(found, ax=axes()).lines
    assert largest_turn(line.get_xydata()) < 4.0  # 10 degrees without motions within the steps
    for frequency in (13.2, 14.35, 15.1):
        (motion,) = found.at(frequency)
        shown = np.interp(frequency, *line.get_xydata().T)
        assert shown == pytest.approx(motion.amplitude, rel=1e-3)


def test_regions_are_smooth_between_amplitudes_in_the_range_that_was_asked_for():
    model = pp.Galerkin(pp.Pipe(0.2, damping=2e-3), 3)
    coarse, fine = (
        pp.parametric_regions(model, 4.0, amplitudes, (20.0, 45.0))
        for amplitudes in ([0.35, 0.4, 0.5], [0.32, 0.33, 0.36, 0.45])
    )
    ax = plot.parametric_regions(coarse, ax=axes())
    outline = ax.lines[0].get_xydata()
    assert largest_turn(outline) < 4.0
    middle = np.argmin(outline[:, 1])
    for amplitude, edges in zip(fine[0].amplitude, fine[0].edges, strict=True):
        low, high = outline[middle::-1], outline[middle:]
        shown = [np.interp(amplitude, side[:, 1], side[:, 0]) for side in (low, high)]
        assert shown == pytest.approx(edges, abs=0.1)  # of an axis of 25
    assert (ax.get_xlim(), ax.get_ylim()) == ((20.0, 45.0), (0.0, 0.5))


def test_one_amplitude_and_the_threshold_give_nearly_the_whole_region():
    """As the square of its width grows in proportion to the square of the amplitude."""
    model, mean, window = pp.Galerkin(pp.Pipe(0.2, damping=2e-3), 3), 4.0, (20.0, 45.0)
    (one,) = pp.parametric_regions(model, mean, 0.5, window)
    (fine,) = pp.parametric_regions(model, mean, [0.32, 0.35, 0.4, 0.45], window)
    outline = plot.parametric_regions([one], ax=axes()).lines[0].get_xydata()
    middle = np.argmin(outline[:, 1])
    for side, edge in zip((outline[middle::-1], outline[middle:]), fine.edges.T, strict=True):
        shown = np.interp(fine.amplitude, side[:, 1], side[:, 0])
        np.testing.assert_allclose(shown, edge, atol=0.2)  # of a width of 17


def test_regions_that_are_not_seen_are_not_in_the_legend():
    far = replace(REGION, kind="combination", edges=REGION.edges + 20.0, threshold_frequency=22.4)
    thin = replace(REGION, kind="subharmonic", edges=np.full((2, 2), np.nan), threshold=np.nan)
    asked = pp.parametric_regions(pp.Chain(PIPE, 2), 1.0, [0.01], (50.0, 60.0))
    shown = replace(asked, regions=(thin, REGION, far), frequencies=np.array([1.0, 10.0]))
    ax = plot.parametric_regions(shown, ax=axes())
    assert legend_of(ax) == ["harmonic", "least amplitude"]
    assert len(ax.patches) == 1
    assert not ax.texts


def test_a_region_with_edges_at_one_amplitude_alone_is_seen_as_a_bar():
    known = np.array([[math.nan, math.nan], [1.5, 4.0]])
    bar = replace(REGION, kind="combination", edges=known, threshold=math.nan)
    ax = plot.parametric_regions([bar], ax=axes())
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[1.5, 0.2], [4.0, 0.2]])
    assert (legend_of(ax), len(ax.patches)) == (["combination"], 0)


def test_a_region_from_one_of_the_amplitudes_on_begins_at_a_point():
    from_first = replace(REGION, threshold=0.1, threshold_frequency=2.5)
    outline = plot.parametric_regions([from_first], ax=axes()).lines[0].get_xydata()
    assert outline[:, 1].min() == 0.1
    assert set(outline[outline[:, 1] == 0.1, 0]) == {2.5}


def test_a_region_without_edges_is_no_obstacle_to_the_others():
    """One that is too thin at all amplitudes asked for has edges of NaN alone."""
    thin = replace(REGION, edges=np.full((2, 2), math.nan), threshold=math.nan)
    ax = plot.parametric_regions([thin, REGION], ax=axes())
    (filled,) = ax.patches
    assert filled.get_xy()[:, 1].max() == 0.2
