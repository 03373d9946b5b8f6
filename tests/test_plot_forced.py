# SPDX-License-Identifier: MIT
"""Pictures of driven pipes show what the results say."""

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
    assert legend_of(ax) == ["harmonic"]


def test_forced_motions_are_drawn_with_their_folds():
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.002), 2)
    found = pp.forced_response(model, 0.0, base=pp.Harmonic(0.02, 20.0), frequencies=(15.0, 26.0))
    ax = plot.forced_response(found, ax=axes())
    folds = [event for event in found.branches[0].events if event.kind == "fold"]
    marked = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "<"]
    np.testing.assert_allclose(marked, [[fold.frequency, fold.amplitude] for fold in folds])
    words = set(legend_of(ax))
    assert words == {"base, stable", "base, unstable", "fold"}


def test_a_region_without_edges_is_no_obstacle_to_the_others():
    """One that is too thin at all amplitudes asked for has edges of NaN alone."""
    thin = replace(REGION, edges=np.full((2, 2), math.nan), threshold=math.nan)
    ax = plot.parametric_regions([thin, REGION], ax=axes())
    (filled,) = ax.patches
    assert filled.get_xy()[:, 1].max() == 0.2
