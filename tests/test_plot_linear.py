# SPDX-License-Identifier: MIT
"""Pictures of the linear analysis: which curves they have, and what is written next to these."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from canvas import all_axes, axes

import pipedyn as pp
from pipedyn import plot

LOCI = pp.root_loci(pp.Chain(pp.Pipe(0.2), 3), [0.0, 1.0, 2.0], 2)
HOSE = pp.Pipe.from_si(
    length=0.5, bending_stiffness=0.01, pipe_mass=0.1, fluid_mass=0.02, damping_time=1e-3
)

HOSE_LOCI = pp.root_loci(pp.Chain(pp.Pipe(0.225, gamma=998.0), 20), np.linspace(0.0, 30.0, 31), 2)
"""Branches 1 and 2, and those of the modes that flutter, 5, 7, ..."""


def written(ax):
    """Texts next to curves, with the places that they point to."""
    return {text.get_text(): text.xy for text in ax.texts}


@pytest.mark.parametrize("draw", [plot.root_loci, plot.frequencies])
def test_each_branch_has_the_number_of_its_mode_once_at_a_point_of_its_curve(draw):
    numbers = HOSE_LOCI.modes.tolist()
    assert numbers[:3] == [1, 2, 5]
    ax = draw(HOSE_LOCI, ax=axes())
    assert sorted(written(ax), key=int) == [str(number) for number in numbers]
    ends = np.concatenate(ax.collections[0].get_segments())
    for place in written(ax).values():
        assert np.abs(ends - place).sum(axis=1).min() < 1e-9
    boxes = [text.get_window_extent() for text in ax.texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert not draw(HOSE_LOCI, numbers=False, ax=axes()).texts


def test_the_plane_of_complex_frequencies_is_that_of_eigenvalues_turned():
    """omega = -i lambda: growth is below the real axis, and a labelled root as in the book."""
    turned = plot.root_loci(HOSE_LOCI, plane="omega", ax=axes())
    usual = plot.root_loci(HOSE_LOCI, ax=axes())
    assert (turned.get_xlabel(), turned.get_ylabel()) == (r"Re $\omega$", r"Im $\omega$")
    ends, before = (np.array(ax.collections[0].get_segments()) for ax in (turned, usual))
    np.testing.assert_array_equal(ends, np.stack([before[..., 1], -before[..., 0]], axis=-1))
    with pytest.raises(ValueError, match="plane must be one of 'lambda', 'omega'"):
        plot.root_loci(HOSE_LOCI, plane="Omega", ax=axes())


def test_speeds_along_branches_are_at_the_roots_of_these_speeds():
    loci = pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), np.linspace(0.0, 8.0, 81), 3)
    ax = plot.root_loci(loci, numbers=False, speeds=True, ax=axes())
    assert len(ax.texts) >= 6
    for text in ax.texts:
        row = round(float(text.get_text()) / 0.1)
        roots = np.column_stack([loci.eigenvalues[row].real, loci.eigenvalues[row].imag])
        assert np.abs(roots - text.xy).sum(axis=1).min() < 1e-9
    hose = pp.root_loci(pp.Chain(HOSE, 4), np.linspace(0.0, 8.0, 9), 2)
    largest = hose.speeds[-1] * HOSE.scales.speed
    words = [
        float(text.get_text())
        for text in plot.root_loci(hose, numbers=False, speeds=True, units="si", ax=axes()).texts
    ]
    assert 0.7 * largest < max(words) <= largest


@pytest.mark.parametrize("draw", [plot.root_loci, plot.frequencies])
def test_eigenvalues_have_a_bar_for_their_colours_which_a_common_one_replaces(draw):
    ax = draw(LOCI, ax=axes())
    [bar] = ax.child_axes
    assert bar.get_ylabel() == (plot.SPEED_LABEL if draw is plot.root_loci else plot.REAL_LABEL)
    common = plot.colour_bar("common", ax=ax)
    assert ax.child_axes == [common]
    assert draw(LOCI, bar=False, ax=axes()).child_axes == []


def test_curves_of_few_samples_pass_through_these_and_lie_close_to_many():
    """Branches 2 and 3; the first reaches the real axis at speeds between two samples."""
    coarse, fine = (
        pp.root_loci(pp.Continuum(pp.Pipe(0.2)), np.linspace(0.0, 9.0, size), 3)
        for size in (37, 721)
    )
    pieces = np.array(plot.root_loci(coarse, ax=axes()).collections[0].get_segments())
    starts, stops = (pieces[:, i, 0] + 1j * pieces[:, i, 1] for i in (0, 1))

    def distance(root, starts, stops):
        """From a set of straight lines."""
        along, from_start = stops - starts, root - starts
        share = np.clip((from_start * along.conj()).real / np.abs(along) ** 2, 0.0, 1.0)
        return np.abs(from_start - share * along).min()

    for root in coarse.eigenvalues.ravel():
        assert distance(root, starts, stops) < 1e-9
    roots = fine.eigenvalues[:, 1:].ravel()
    polygons = coarse.eigenvalues[:-1, 1:].ravel(), coarse.eigenvalues[1:, 1:].ravel()
    assert max(distance(root, *polygons) for root in roots) > 0.1
    assert max(distance(root, starts, stops) for root in roots) < 0.03


def test_a_pair_that_moves_fast_reaches_the_real_axis_without_a_corner():
    """Mode 2 of a long hanging hose is real from u = 22.25 to 24.51, both between samples."""
    pipe = pp.Continuum(pp.Pipe(beta=0.225, gamma=998.0))
    loci = pp.root_loci(pipe, np.linspace(20.0, 26.0, 13))
    ax = plot.frequencies(loci, ax=axes())
    points = np.concatenate(ax.collections[0].get_segments())
    near = np.abs(points[:, 0] - np.array([[22.125], [24.8125]])).argsort(axis=1)[:, :60]
    for speed, frequency in points[near].reshape(-1, 2):
        exact = np.abs(pp.eigenvalues(pipe, float(speed), count=12).imag)
        assert np.abs(exact - frequency).min() < 0.5


def test_no_onset_is_drawn_where_two_real_pairs_become_other_pairs():
    """Two modes buckle at rest; their growing roots meet and stay unstable."""
    pipe = pp.Continuum(pp.Pipe(0.2, gamma=-100.0))
    loci = pp.root_loci(pipe, np.linspace(0.0, 9.0, 19), 3)
    (onsets,) = [line for line in plot.root_loci(loci, ax=axes()).lines if line.get_marker() == "D"]
    assert onsets.get_xdata().size == 0
    assert not any(c.destabilising for c in pp.crossings(pipe, 9.0))


def test_dots_of_a_benchmark_leave_the_curve_visible_between_them():
    speeds = np.linspace(0.0, 8.0, 161)
    exact = pp.root_loci(pp.Continuum(pp.Pipe(0.2)), speeds)
    for draw in (plot.root_loci, plot.frequencies):
        ax = draw(exact, exact, ax=axes())
        (dots,) = [line for line in ax.lines if line.get_marker() == "o"]
        shown = ax.transData.transform(dots.get_xydata()) * 72.0 / ax.figure.dpi
        apart = np.hypot(*(shown[:, None] - shown).T) + 100.0 * np.eye(len(shown))
        assert len(shown) > 30
        assert apart.min() > 5.0


def test_mode_shapes_have_all_that_grow_and_no_legend_if_asked_for_none():
    found = pp.modes(pp.Chain(pp.Pipe(0.225, gamma=998.0), 20), 24.0)
    growing = int(np.sum(found.eigenvalues.real > 0.0))
    ax = plot.mode_shapes(found, 2, ax=axes())
    labels = [one for one in ax.get_legend_handles_labels()[1] if "lambda" in one]
    assert growing == 1
    assert len(labels) == 3
    assert ax.get_title() == f"$u = 24$, 3 of {found.eigenvalues.size} modes"
    assert ax.get_legend() is not None
    assert plot.mode_shapes(found, 2, legend=False, ax=axes()).get_legend() is None
    with pytest.raises(TypeError, match="legend must be True or False"):
        plot.mode_shapes(found, legend=1, ax=axes())


@pytest.mark.parametrize("layout", ["constrained", "tight"])
def test_a_bar_of_its_own_leaves_a_picture_its_place_in_a_figure_of_four(layout):
    figure = plot.Figure(figsize=(7.0, 5.0), layout=layout)
    four = figure.subplots(2, 2)
    for ax in four.flat:
        plot.frequencies(HOSE_LOCI, ax=ax)
    figure.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in all_axes(figure)]
    assert len(boxes) == 8
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert all(box.width > 0.25 * figure.bbox.width for box in boxes[:4])


@pytest.mark.parametrize("draw", [plot.root_loci, plot.frequencies])
def test_a_picture_says_if_modes_without_a_branch_may_grow(draw):
    def note(loci):
        return draw(loci, ax=axes()).get_title(loc="right")

    few = "8 of 12 modes have no branch: take count=12"
    assert note(replace(LOCI, complete=False, missing=few)) == few
    assert note(LOCI) == ""
    assert note(replace(HOSE_LOCI, complete=False)).startswith("the file is of a version that")


@pytest.mark.parametrize("draw", [plot.root_loci, plot.frequencies])
@pytest.mark.parametrize("width", [3.4, 4.8])
def test_the_note_on_missing_branches_stays_within_the_width_of_its_axes(draw, width):
    with pytest.warns(pp.BranchesMissing):
        loci = pp.root_loci(pp.Chain(pp.Pipe(0.2, flow="aspirating"), 12), [0.0, 2.0, 4.0])
    ax = plot.Figure(figsize=(width, 2.6), layout="constrained").add_subplot()
    draw(loci, ax=ax)
    ax.figure.draw_without_rendering()
    [box] = [
        text.get_window_extent()
        for text in ax.get_children()
        if getattr(text, "get_text", str)().replace("\n", " ") == loci.missing
    ]
    assert ax.bbox.x0 <= box.x0 + 1.0
    assert box.x1 <= ax.bbox.x1 + 1.0
    assert box.y1 <= ax.figure.bbox.y1


@pytest.mark.parametrize("draw", [plot.root_loci, plot.frequencies])
def test_roots_of_one_speed_are_discs_with_the_numbers_of_their_modes(draw):
    loci = pp.root_loci(pp.Chain(pp.Pipe(0.225, gamma=998.0), 20), [26.0], 2)
    assert loci.eigenvalues.imag.all()
    ax = draw(loci, ax=axes())
    (discs,) = [one for one in ax.collections if one.get_offsets().any()]
    (roots,) = loci.eigenvalues
    across = roots.real if draw is plot.root_loci else np.full(roots.size, 26.0)
    np.testing.assert_allclose(discs.get_offsets(), np.column_stack([across, roots.imag]))
    assert sorted(written(ax), key=int) == [str(number) for number in loci.modes]
    edges = discs.get_edgecolors()[:, :3].sum(axis=1)
    grows = (roots.real > 0.0) & (draw is plot.frequencies)
    np.testing.assert_array_equal(edges == 0.0, grows)
    low, high = np.sort([ax.get_xlim(), ax.get_ylim()])[:, :2].T
    assert (discs.get_offsets() > low).all()
    assert (discs.get_offsets() < high).all()


def test_a_growing_root_without_a_known_partner_is_a_curve_without_a_number():
    """A clamped pipe that buckles twice, with strong damping and hysteresis."""
    pipe = pp.Pipe(0.72, 10.0, damping=0.3, hysteresis=0.1, end="clamped")
    loci = pp.root_loci(pp.Continuum(pipe), np.linspace(5.0, 10.0, 21), 1)
    assert loci.modes.tolist() == [1, 0, 0]
    assert np.isnan(loci.partners[-1, 1:]).all()
    ax = plot.frequencies(loci, ax=axes())
    assert list(written(ax)) == ["1"]
    ends = np.concatenate(ax.collections[0].get_segments())
    static = ends[ends[:, 1] == 0.0]
    assert static[:, 0].max() == 10.0
    (onsets,) = [line for line in ax.lines if line.get_marker() == "D"]
    lost = [one.speed for one in pp.crossings(pp.Continuum(pipe), 10.0)]
    assert onsets.get_xdata() == pytest.approx(lost, abs=0.01)


def test_hysteresis_leaves_branches_smooth_next_to_the_real_axis():
    """Sum and product of a pair tell nothing of an imaginary part of a thousandth."""
    pipe = pp.Pipe(0.21, 10.0, damping=0.05, hysteresis=0.01)
    loci = pp.root_loci(pp.Continuum(pipe), np.linspace(0.0, 16.0, 21), 4)
    third = {name: getattr(loci, name)[:, 2:3] for name in ("eigenvalues", "partners", "converged")}
    picture = plot.frequencies(replace(loci, modes=loci.modes[2:3], **third), ax=axes())
    heights = np.array(picture.collections[0].get_segments())[..., 1]
    exact = loci.eigenvalues[:, 2].imag
    assert 0.0 < exact.min() < exact.max() < 0.3
    assert (heights >= 0.99 * exact.min()).all()
    assert (heights <= 1.01 * exact.max()).all()


def test_few_samples_of_a_stable_branch_show_no_onset():
    """Splines through three samples swing over the axis."""
    hose = pp.root_loci(pp.Continuum(pp.Pipe(0.225, 998.0)), [0.0, 11.0, 22.0])
    assert hose.eigenvalues.real.max() <= 0.0
    for picture in (plot.root_loci, plot.frequencies):
        ax = picture(hose, ax=axes())
        (diamonds,) = [line for line in ax.lines if line.get_marker() == "D"]
        assert diamonds.get_xdata().size == 0
