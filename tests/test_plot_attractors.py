# SPDX-License-Identifier: MIT
"""Pictures of basins, Poincare sections and spectra show what was found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from canvas import axes, legend_of
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

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


@pytest.mark.parametrize("draw", [plot.phase_portrait, plot.time_history])
def test_attractors_are_shown_as_the_motions_of_their_basins(draw):
    ax, each = draw(found(), ax=axes()), draw([*found().basins], ax=axes())
    for one, other in zip(ax.lines, each.lines, strict=True):
        np.testing.assert_array_equal(one.get_xydata(), other.get_xydata())


def test_equilibria_in_the_plane_are_marked():
    wide = replace(found(), plane=pp.StartPlane(np.linspace(-3, 3, 6), np.linspace(-3, 3, 6)))
    ax = plot.basins(wide, ax=axes())
    marked = [line.get_xydata()[0] for line in ax.lines]
    ends = [basin.motion.q[-1] for basin in wide.basins if basin.ending == "rest"]
    np.testing.assert_allclose(marked, ends)
    markers = [line.get_marker() for line in ax.get_legend().findobj(Line2D)]
    assert markers == [line.get_marker() for line in ax.lines]


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
        assert text.get_text() == "at rest"


def test_pictures_refuse_what_they_cannot_show():
    with pytest.raises(ValueError, match="found must come from a StartPlane"):
        plot.basins(replace(found(), plane=None), ax=axes())
    for picture in (plot.poincare_section, plot.spectrum):
        with pytest.raises(ValueError, match="start must be None for attractors"):
            picture(found(), start=1.0, ax=axes())
        with pytest.raises(TypeError, match="found must be Attractors, a Basin, a Motion, several"):
            picture(3, ax=axes())
        with pytest.raises(TypeError, match="found must be Attractors, a Basin, a Motion or sev"):
            picture(pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 2), 4.0), ax=axes())
        with pytest.raises(ValueError, match="start must leave at least 3 samples of found"):
            picture(flutter(), start=29.99, ax=axes())


def test_a_start_on_a_saddle_belongs_to_no_basin():
    """The standing chain at rest is such a start, and its cell has the colour of those around."""
    angles = np.linspace(-2.0, 2.0, 5)
    ends = pp.attractors(found().model, 4.1, pp.StartPlane(angles, angles))
    saddle = int(ends.ends[12])
    assert (ends.basins[saddle].ending, ends.basins[saddle].attracts) == ("rest", False)
    ax = plot.basins(ends, ax=axes())
    (mesh,) = ax.collections
    shown = mesh.get_array()
    assert saddle not in shown
    assert shown[2, 2] in ends.ends.reshape(5, 5)[1:4, 1:4]
    (crosses,) = (line for line in ax.lines if line.get_gid() == f"unstable {saddle}")
    np.testing.assert_array_equal(crosses.get_xydata(), [[0.0, 0.0]])
    assert f"{saddle}: rest, unstable, 1 start" in legend_of(ax)
    assert len(legend_of(ax)) == len(ends.basins)


# ------------------------------------------------------------------------------ pictures of motions


@cache
def flutter(**asked):
    """A chain that flutters, from a slight bend on."""
    asked = {"samples": 3001, "rtol": 1e-9} | asked
    return pp.simulate(pp.Chain(pp.Pipe(0.2), 2), 4.0, 30.0, lambda s: 0.05 * s**2, **asked)


@cache
def settled():
    return pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 1).basins[0]


def curve_of(ax):
    (line,) = ax.lines
    return line.get_xydata().T


def test_a_density_peaks_at_the_frequency_of_flutter_and_adds_up_to_the_mean_square():
    ax = plot.spectrum(flutter(), start=15.0, ax=axes())
    omega, density = curve_of(ax)
    step = omega[1] - omega[0]
    peak = omega[density.argmax()]
    assert peak == pytest.approx(2.0 * np.pi / settled().period, abs=step)
    assert density.sum() * step == pytest.approx(flutter().tip[1500:, 0].var(), rel=0.03)
    assert ax.get_xlabel() == "angular frequency $\\omega$ (nondimensional)"
    finer, _ = curve_of(plot.spectrum(flutter(), start=15.0, segments=2, ax=axes()))
    assert finer[1] - finer[0] == pytest.approx(step / 3.0, rel=0.01)


def test_uneven_samples_have_the_density_of_even_ones():
    """Most of the time the samples are every 0.03 T, for a while every 0.01 T."""
    times = np.concatenate([np.arange(0.0, 20.0, 0.03), np.arange(20.0, 30.0, 0.01)])
    uneven = flutter(samples=None, times=tuple(times))
    shown = [curve_of(plot.spectrum(one, start=2.0, ax=axes())) for one in (uneven, flutter())]
    low = min(np.searchsorted(omega, 60.0) for omega, _ in shown)
    high = shown[1][1].max()
    np.testing.assert_allclose(shown[0][1][:low] / high, shown[1][1][:low] / high, atol=0.02)


def test_decibels_are_ten_logarithms_of_the_density():
    (_, plain), (_, decibels) = (
        curve_of(plot.spectrum(flutter(), start=15.0, decibels=wanted, ax=axes()))
        for wanted in (False, True)
    )
    np.testing.assert_allclose(decibels, 10.0 * np.log10(plain), atol=1e-9)
    tops, (loud,) = (
        plot.spectrum(settled(), decibels=wanted, ax=axes()).lines for wanted in (False, True)
    )
    np.testing.assert_allclose(loud.get_ydata(), 20.0 * np.log10(tops[0].get_ydata()), atol=1e-9)


def test_a_measured_pipe_has_its_density_over_hertz():
    model = pp.Chain(MEASURED, 2)
    motion = replace(flutter(), model=model)
    second = MEASURED.scales.time
    plain, hertz = (
        plot.spectrum(motion, start=start, units=units, ax=axes())
        for start, units in ((15.0, "nondimensional"), (15.0 * second, "si"))
    )
    (omega, density), (f, density_si) = map(curve_of, (plain, hertz))
    np.testing.assert_allclose(f, omega / (2.0 * np.pi * MEASURED.scales.time))
    # Either adds up to the mean square, here in m^2.
    np.testing.assert_allclose(density_si * f, density * omega * 0.5**2)
    assert (hertz.get_xlabel(), hertz.get_ylabel()) == (
        "frequency (Hz)",
        "spectral density of $x$ (m$^{2}$/Hz)",
    )
    ax = plot.spectrum(motion, units="si", decibels=True, ax=axes())
    assert ax.get_ylabel() == "spectral density of $x$ (dB re 1 m$^{2}$/Hz)"


@pytest.mark.parametrize("coordinate", ["tip", 0])
def test_the_section_of_a_settled_motion_is_that_of_its_attractor(coordinate):
    of_attractor = plot.poincare_section(settled(), coordinate, ax=axes())
    of_motion = plot.poincare_section(flutter(), coordinate, start=20.0, ax=axes())
    points = of_motion.lines[0].get_xydata()
    assert abs(len(points) - 10.0 / settled().period) < 1.0
    expected = np.broadcast_to(of_attractor.lines[0].get_xydata()[0], points.shape)
    np.testing.assert_allclose(points, expected, rtol=2e-4)
    assert of_motion.get_title() == "$u = 4$, ejecting\nat maxima of the free end"


@pytest.mark.parametrize(
    "picture", [plot.time_history, plot.phase_portrait, plot.poincare_section, plot.spectrum]
)
def test_a_start_is_in_the_units_shown(picture):
    motion, second = replace(flutter(), model=pp.Chain(MEASURED, 2)), MEASURED.scales.time
    shown = picture(motion, start=15.0 * second, units="si", ax=axes()).lines[-1].get_xydata()
    early = picture(motion, start=15.0, ax=axes()).lines[-1].get_xydata()
    assert shown.shape == early.shape
    with pytest.raises(ValueError, match=f"third last is at {29.98 * second:g} s, got 1000"):
        picture(motion, start=1000.0, units="si", ax=axes())


def test_the_section_of_a_driven_motion_is_taken_once_a_period():
    model, pump = pp.Chain(pp.Pipe(0.2, damping=0.02), 2), pp.Pulsation(2.0, 0.3, 9.0)
    motion = pp.simulate(model, pump, 20.0, lambda s: 0.3 * s, samples=4001, rtol=1e-9)
    ax = plot.poincare_section(motion, 1, ax=axes())
    period = 2.0 * np.pi / 9.0
    at = np.searchsorted(motion.t, period * np.arange(28))
    assert ax.get_title().endswith("once a period of the drive")
    points = ax.lines[0].get_xydata()
    assert len(points) == int(20.0 / period) + 1
    np.testing.assert_allclose(points[:28, 0], motion.q[at, 1], atol=0.01)
    both = replace(motion, base=pp.Harmonic(0.01, 5.0))  # has no one period
    assert plot.poincare_section(both, ax=axes()).get_title().endswith("maxima of the free end")


def test_several_motions_have_a_legend_unless_none_is_wanted():
    for picture in (plot.poincare_section, plot.spectrum):
        two = [flutter(), replace(flutter(), u=4.5)]
        assert legend_of(picture(two, start=10.0, ax=axes())) == ["$u = 4$", "$u = 4.5$"]
        for one in (two, found()):
            assert picture(one, legend=False, ax=axes()).get_legend() is None
        none = replace(found(), basins=(), ends=np.full(36, -1))
        assert [text.get_text() for text in picture(none, ax=axes()).texts] == [
            "no attractor was found"
        ]
    assert plot.basins(found(), legend=False, ax=axes()).get_legend() is None


def test_motions_of_several_pipes_have_each_its_own_units():
    """The second pipe is twice as long, so that its free end is seen to move twice as far."""
    long = pp.Pipe.from_si(length=1.0, bending_stiffness=0.01, pipe_mass=0.1, fluid_mass=0.02)
    names = ("t", "q", "qdot", "tip", "energy", "flow_speed")
    late = replace(flutter(), **{name: getattr(flutter(), name)[2000:] for name in names})
    two = [replace(late, model=pp.Chain(pipe, 2)) for pipe in (MEASURED, long)]
    ax = plot.poincare_section(two, units="si", ax=axes())
    short, far = (line.get_xdata().mean() for line in ax.lines)
    assert ax.get_ylabel() == "rate $\\dot{q}_{1}$ (1/s)"
    assert far == pytest.approx(2.0 * short)
    ax = plot.spectrum(two, units="si", ax=axes())
    drawn = [line.get_xydata().T for line in ax.lines]
    energies = [np.sum(np.gradient(f) * density) for f, density in drawn]
    assert energies[1] == pytest.approx(4.0 * energies[0])


def test_a_spectrum_and_a_section_of_few_samples_say_so():
    seldom = flutter(samples=round(8 * 30.0 / settled().period))  # 8 in a period
    for picture in (plot.poincare_section, plot.spectrum):
        title = picture(seldom, start=10.0, ax=axes()).get_title()
        assert title.split("\n")[-1] == "fewer than ten samples a cycle"
        assert "fewer" not in picture(flutter(), start=10.0, ax=axes()).get_title()


def test_a_section_of_a_measured_pipe_has_axes_in_si_units():
    model = pp.Chain(MEASURED, 2)
    basins = [replace(one, motion=replace(one.motion, model=model)) for one in found().basins]
    measured = replace(found(), model=model, basins=tuple(basins))
    plain, section = (
        plot.poincare_section(measured, units=units, ax=axes())
        for units in ("nondimensional", "si")
    )
    assert (section.get_xlabel(), section.get_ylabel()) == (
        "free end $x$ (m)",
        "rate $\\dot{q}_{1}$ (1/s)",
    )
    assert section.get_title().endswith("at maxima of the free end")
    assert section.get_xlim()[1] == pytest.approx(0.5 * plain.get_xlim()[1])
    assert section.get_ylim()[1] == pytest.approx(plain.get_ylim()[1] / MEASURED.scales.time)


@pytest.mark.parametrize("picture", [plot.poincare_section, plot.spectrum])
def test_no_section_or_spectrum_is_drawn_of_samples_twice_a_cycle(picture):
    """The spectrum would have its peak at an alias, and the section would look like a torus."""
    seldom = flutter(samples=round(2.1 * 30.0 / settled().period))
    with pytest.raises(ValueError, match="found must be sampled at least six times a cycle"):
        picture([flutter(), seldom], start=10.0, ax=axes())


def test_a_periodic_motion_has_no_peak_below_its_frequency():
    """The mean left in a segment that is no whole number of periods is no slow motion."""
    for segments in (2, 4):
        ax = plot.spectrum(flutter(), start=15.0, segments=segments, ax=axes())
        _, density = curve_of(ax)
        assert density[0] < 2.0 * density[1]


def test_the_label_of_decibels_is_not_cut_off():
    motion = replace(flutter(), model=pp.Chain(MEASURED, 2))
    four = Figure(figsize=(7.0, 5.0), layout="constrained").subplots(2, 2)
    for ax in four.flat:
        plot.spectrum(motion, decibels=True, units="si", ax=ax)
    ax.figure.draw_without_rendering()
    for ax in four.flat:
        assert ax.yaxis.label.get_window_extent().height < ax.get_window_extent().height
