# SPDX-License-Identifier: MIT
"""Pictures of basins, Poincare sections and spectra show what was found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from canvas import axes, legend_of

import pipedyn as pp
from pipedyn import plot

MEASURED = pp.Pipe.from_si(
    length=0.5,
    bending_stiffness=0.01,
    pipe_mass=0.1,
    fluid_mass=0.02,
)


@cache
def found():
    """A chain that leans to either side or flutters."""
    angles = np.linspace(-2.0, 2.0, 6)
    return pp.attractors(pp.Chain(pp.Pipe(0.2, -30.0), 2), 4.1, pp.StartPlane(angles, angles))


def test_basins_show_where_each_start_ends():
    ax = axes()
    assert plot.basins(found(), ax=ax) is ax
    (mesh,) = ax.collections
    np.testing.assert_array_equal(mesh.get_array(), found().ends.reshape(6, 6))
    words = legend_of(ax)
    assert len(words) == len(found().basins)
    assert sum("mirror image" in word for word in words) == 1
    ax.figure.canvas.draw()


def test_equilibria_in_the_plane_are_marked():
    wide = replace(found(), plane=pp.StartPlane(np.linspace(-3, 3, 6), np.linspace(-3, 3, 6)))
    ax = plot.basins(wide, ax=axes())
    marked = [line.get_xydata()[0] for line in ax.lines]
    ends = [basin.motion.q[-1] for basin in wide.basins if basin.ending == "rest"]
    np.testing.assert_allclose(marked, ends)


def test_what_did_not_settle_or_failed_is_in_the_legend():
    ends = found().ends.copy()
    ends[:3], ends[3:5] = -1, -2
    shares = {"unsettled": pp.Share(3, 3 / 36, 0.0), "failed": pp.Share(2, 2 / 36, 0.0)}
    ax = plot.basins(replace(found(), ends=ends, **shares), ax=axes())
    words = legend_of(ax)
    assert words[-2:] == ["not settled, 8.33 %", "failed, 5.56 %"]


def test_a_section_shows_each_maximum_of_a_cycle():
    ax = plot.poincare_section(found(), ax=axes())
    (points,) = ax.lines  # what rests has none
    cycle = next(basin for basin in found().basins if basin.ending == "periodic")
    tips = found().model.tips(cycle.section[:, :2].T)[:, 0]
    np.testing.assert_allclose(points.get_xdata(), tips)
    low, high = ax.get_xlim()
    assert high - low > 0.05 * abs(tips[0])  # rounding of a point is not spread over the page
    one = plot.poincare_section(cycle, 0, ax=axes())
    np.testing.assert_allclose(one.lines[0].get_xydata(), cycle.section[:, [0, 2]])


def test_a_spectrum_shows_the_harmonics():
    cycle = next(basin for basin in found().basins if basin.ending == "periodic")
    ax = plot.spectrum(cycle, ax=axes())
    (tops,) = ax.lines
    assert tops.get_xdata()[0] == pytest.approx(2.0 * np.pi / cycle.period)
    assert tops.get_ydata()[0] == cycle.spectrum[1]


def test_pictures_of_what_rests_say_so():
    rest = next(basin for basin in found().basins if basin.ending == "rest")
    for picture in (plot.poincare_section, plot.spectrum):
        (text,) = picture(rest, ax=axes()).texts
        assert text.get_text() == "all are at rest"


def test_pictures_refuse_what_they_cannot_show():
    with pytest.raises(ValueError, match="found must come from a StartPlane"):
        plot.basins(replace(found(), plane=None), ax=axes())


def test_a_section_of_a_measured_pipe_has_axes_in_si_units():
    measured = replace(found(), model=pp.Chain(MEASURED, 2))
    plain, section = (
        plot.poincare_section(measured, units=units, ax=axes())
        for units in ("nondimensional", "si")
    )
    assert (section.get_xlabel(), section.get_ylabel()) == (
        "free end $x$ (m)",
        "rate $\\dot{q}_{1}$ at a maximum of the free end (1/s)",
    )
    assert section.get_xlim()[1] == pytest.approx(0.5 * plain.get_xlim()[1])
    assert section.get_ylim()[1] == pytest.approx(plain.get_ylim()[1] / MEASURED.scales.time)
