# SPDX-License-Identifier: MIT
"""Where driven motions end in three dimensions, against long motions and symmetric counterparts."""

import math

import numpy as np
import pytest

import pipedyn as pp
from pipedyn import plot

SLACK = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.001), 3, dimensions=3)
LEVEL = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.004, inclination=1.2), 4, dimensions=3)
UNEVEN = pp.Chain(
    pp.Pipe(0.2, 10.0, damping=0.01, terms=[pp.Spring(1.0, 2.0, stiffness_across=8.0)]),
    2,
    dimensions=3,
)
FLUTTERING = pp.Chain(pp.Pipe(0.1, 10.0, damping=0.001), 3, dimensions=3)
WHIRLING = pp.Chain(pp.Pipe(0.2), 4, dimensions=3)
MEAN = 0.98 * pp.critical_speed(FLUTTERING.planar).speed
PUSH = pp.Force(None, 0.5, 3.0)
SHAKEN, LONG = 5.15, {"transient": 400.0, "duration": 60.0}


def starts_of(model):
    """Two bent shapes in no plane through the axis, and their images from z to -z."""
    some = [
        model.bent(lambda s: 0.5 * s, lambda s: 0.1 * s**2),
        model.bent(lambda s: -0.2 * s**2, lambda s: 0.4 * s),
    ]
    return np.array(some + [mirrored(model, one) for one in some])


def mirrored(model, y):
    signs = np.repeat([1.0, -1.0], model.coordinates // 2)
    return np.tile(signs, y.size // model.coordinates) * y


def later(model, y, periods, w, u, **given):
    """States a number of periods of the drive after a state, by the implicit integrator."""
    start = np.append(y, np.zeros(2 * model.coordinates - y.size))
    found = pp.simulate(
        *(model, u, 2.0 * math.pi * periods / w, *np.split(start, 2)),
        **{"method": "radau", "rtol": 1e-8, "samples": periods + 1, **given},
    )
    return found.y.T


FORCE = pp.Force(lambda phase: (0.05 * math.cos(phase), 0.0, 0.02 * math.sin(phase)), 1.0, SHAKEN)
ACROSS = {
    "in a plane": (SLACK, {"u": 0.1, "base": pp.Harmonic(0.01, SHAKEN)}),
    "in another plane": (SLACK, {"u": 0.1, "base": pp.Harmonic(0.01, SHAKEN, (3.0, 0.0, -4.0))}),
    "on a circle": (SLACK, {"u": 0.1, "base": pp.Harmonic(0.01, 4.6, (1.0, 0.0, -1j))}),
    "by a force": (SLACK, {"u": 0.1, "force": FORCE}),
    "bent along x": (LEVEL, {"u": 2.0, "base": pp.Harmonic(0.02, 5.0)}),
    "bent along z": (LEVEL, {"u": 2.0, "base": pp.Harmonic(0.02, 5.0, "z")}),
    "uneven": (UNEVEN, {"u": 1.0, "base": pp.Harmonic(0.03, 5.0, (1.0, 0.5, 1.0))}),
}


@pytest.mark.parametrize("name", ACROSS)
def test_motions_driven_across_end_where_long_motions_do(name):
    model, given = ACROSS[name]
    w = (given.get("base") or given["force"]).frequency
    found = pp.attractors(model, starts=starts_of(model)[:2], **given, **LONG)
    assert found.unsettled.count == found.failed.count == 0
    for start, number in zip(found.starts, found.ends, strict=True):
        basin = found.basins[number]
        assert (basin.ending, basin.attracts) == ("periodic", True)
        assert basin.period == pytest.approx(2.0 * math.pi / w)
        late = later(model, start, 400, w, **given)[-1]
        np.testing.assert_allclose(basin.section[-1], late, atol=3e-4 * np.abs(late).max())
    for basin in found.basins:
        np.testing.assert_allclose(basin.section, basin.section[:1].repeat(48, 0), atol=1e-6)


def test_a_hose_shaken_in_a_plane_ends_on_the_stable_forced_motion_or_its_image():
    base = pp.Harmonic(0.01, SHAKEN)
    found = pp.attractors(SLACK, 0.1, starts_of(SLACK), base=base, **LONG)
    solved = pp.forced_response(SLACK, 0.1, base=base, frequencies=(5.1, 5.21)).at(SHAKEN)
    (whirl,) = (motion for motion in solved if motion.stable)
    assert [basin.mirror_image for basin in found.basins] == [1, 0]
    for basin in found.basins:
        assert basin.amplitude == pytest.approx(whirl.amplitude, rel=1e-4)
        assert np.ptp(basin.motion.tip[:, 2]) == pytest.approx(np.ptp(whirl.tip[:, 2]), rel=1e-3)
    first, other = (basin.section[-1] for basin in found.basins)
    np.testing.assert_allclose(mirrored(SLACK, first), other, atol=1e-6)
    assert np.array_equal(found.ends[2:], 1 - found.ends[:2])


def test_drives_in_another_plane_have_turned_attractors():
    angle, starts = math.atan2(-4.0, 3.0), starts_of(SLACK)
    found, turned = (
        pp.attractors(SLACK, 0.1, some, base=pp.Harmonic(0.01, SHAKEN, way), **LONG)
        for some, way in (
            (starts, "x"),
            (SLACK.turned(starts.T, angle).T, (3.0, 0.0, -4.0)),
        )
    )
    np.testing.assert_array_equal(found.ends, turned.ends)
    assert turned.base.direction == (3.0, 0.0, -4.0)
    for one, other in zip(found.basins, turned.basins, strict=True):
        assert one.mirror_image == other.mirror_image
        end, section = (SLACK.turned(y.T, angle).T for y in (one.attractor.end, one.section))
        np.testing.assert_allclose(other.attractor.end, end, atol=1e-9)
        np.testing.assert_allclose(other.section, section, atol=1e-7)


def test_a_motion_that_stops_is_shown_as_it_was_started_in_any_plane():
    start = np.append(starts_of(SLACK)[0], 1e3 * np.array([1.0, -1.0, 1.0, -2.0, 1.0, 1.0]))
    base = pp.Harmonic(0.01, SHAKEN, (3.0, 0.0, -4.0))
    found = pp.attractors(SLACK, 0.1, [start], base=base)
    (failure,) = found.failures
    motion = failure.error.motion
    np.testing.assert_allclose(motion.y[:, 0], start, atol=1e-9)
    assert motion.base == base
    again = pp.simulate(SLACK, 0.1, motion.t[1], *np.split(start, 2), base=base, samples=2)
    np.testing.assert_allclose(motion.y[:, 1], again.y[:, 1], rtol=1e-3)


def test_a_base_along_z_makes_motions_that_are_their_own_images_half_a_period_later():
    (basin,) = pp.attractors(LEVEL, 2.0, 3, base=pp.Harmonic(0.02, 5.0, "z"), **LONG).basins
    assert basin.mirror_image == 0
    now, half = basin.motion.dense(np.array([0.0, math.pi / 5.0])).T
    np.testing.assert_allclose(half, mirrored(LEVEL, now), atol=1e-6)


def radii(tip):
    radius = np.hypot(tip[:, 0], tip[:, 2])
    return radius.min(), radius.max()


def inclinations(states):
    """Angles of the segments to the axis, which no turn about it changes, (segments, k)."""
    x, z, *_ = np.split(states, 4, axis=1)
    return np.hypot(x, z).T


@pytest.mark.parametrize(
    ("w", "flow", "times", "planar"),
    [
        (25.9, True, 2, True),
        (32.3, True, 2, False),
        (33.0, True, 1, True),
        (25.9, False, 2, True),
        (20.0, False, 0, True),
    ],
)
def test_motions_driven_along_the_axis_end_where_long_motions_do_but_for_a_turn(
    w, flow, times, planar
):
    given = {"u": pp.Pulsation(MEAN, 0.3, w)} if flow else {"u": 0.9 * MEAN}
    given |= {} if flow else {"base": pp.Harmonic(0.05, w, "y")}
    starts = starts_of(FLUTTERING)
    found = pp.attractors(FLUTTERING, starts=starts, **given)
    (basin,) = found.basins
    assert basin.attracts
    assert basin.share.count == 4
    assert basin.period == pytest.approx(times * 2.0 * math.pi / w)
    assert basin.ending == ("periodic" if times else "rest")
    across = basin.motion.tip[:, ::2]
    sizes = np.linalg.svd(across - across.mean(axis=0), full_matrices=False)[1]
    assert (sizes[1] <= 1e-6 * max(sizes[0], 1.0)) == planar
    late = later(FLUTTERING, starts[0], 400, w, **given)[-2:]
    section = basin.section if times else np.zeros((2, 12))
    for seen, expected in zip(inclinations(section[-2:]), inclinations(late), strict=True):
        assert sorted(seen) == pytest.approx(sorted(expected), rel=1e-3, abs=1e-5)


DRIVEN_WHIRLS = {
    "pulsating flow": {"u": pp.Pulsation(6.0, 0.02, 9.0)},
    "base along the axis": {"u": 6.0, "base": pp.Harmonic(0.01, 9.0, "y")},
}


@pytest.mark.parametrize("given", DRIVEN_WHIRLS.values(), ids=DRIVEN_WHIRLS)
def test_a_whirl_driven_along_the_axis_precesses_in_either_sense(given):
    found = pp.attractors(WHIRLING, starts=starts_of(WHIRLING), **given)
    assert [basin.ending for basin in found.basins] == ["quasi-periodic"] * 2
    assert [basin.mirror_image for basin in found.basins] == [1, 0]
    assert np.array_equal(found.ends[2:], 1 - found.ends[:2])
    for basin, number in zip(found.basins, (0, 1), strict=True):
        start = found.starts[list(found.ends).index(number)]
        late = later(WHIRLING, start, 100, 9.0, **given)[-1]
        moving = pp.simulate(
            *(WHIRLING, given["u"], 20.0, *np.split(late, 2)),
            **{"base": given.get("base"), "samples": 2001},
        )
        assert radii(moving.tip) == pytest.approx(radii(basin.motion.tip), rel=2e-3)
        (x, _, z), (by_x, _, by_z) = moving.tip.T, moving.tip_velocity.T
        (a, _, c), (by_a, _, by_c) = basin.motion.tip.T, basin.motion.tip_velocity.T
        assert np.sign(x * by_z - z * by_x).mean() == np.sign(a * by_c - c * by_a).mean()
        # In the frame that turns with it the motion repeats with the drive: radii do.
        every = basin.motion.dense(2.0 * math.pi / 9.0 * np.arange(20))
        distances = np.hypot(every[3], every[7])
        np.testing.assert_allclose(distances, distances[0], rtol=1e-4)
        assert np.ptp(np.hypot(x, z)) > 1e-3


def test_a_force_leads_a_planar_pipe_to_its_forced_motion():
    model, push = pp.Chain(pp.Pipe(0.2, damping=0.01), 2), pp.Force(None, 0.7, 9.0, 0.3)
    found = pp.attractors(model, 2.0, 3, force=push)
    (solved,) = pp.forced_response(model, 2.0, force=push).at(9.0)
    (basin,) = found.basins
    assert found.force == push
    assert basin.amplitude == pytest.approx(solved.amplitude, rel=1e-5)
    np.testing.assert_allclose(basin.section[-1], solved.y[:, 0], atol=1e-5)
    assert (basin.attracts, basin.mirror_image) == (True, 0)


def test_the_section_of_a_forced_motion_is_said_to_be_stroboscopic():
    found = pp.attractors(pp.Chain(pp.Pipe(0.2, damping=0.01), 2), 2.0, 2, force=PUSH)
    assert found.basins[0].drive_period == pytest.approx(2.0 * math.pi / 3.0)
    for one in (found, found.basins[0]):
        assert "once a period of the drive" in plot.poincare_section(one).get_title()


def test_attractors_of_a_forced_motion_are_kept_by_files(tmp_path):
    push = pp.Force(None, 0.7, 9.0, 0.3)
    found = pp.attractors(UNEVEN, 1.0, 2, force=push)
    found.save(tmp_path / "found.npz")
    back = pp.load(tmp_path / "found.npz")
    assert back.force == push
    np.testing.assert_array_equal(back.basins[0].section, found.basins[0].section)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"force": [PUSH, PUSH]}, r"^force must be one, where the flow is steady and the base at"),
        ({"force": PUSH, "base": pp.Harmonic(0.1, 3.0)}, r"^force must be one, where the flow"),
        ({"force": PUSH, "u": pp.Pulsation(1.0, 0.1, 3.0)}, r"^force must be one, where the flow"),
        ({"force": pp.Force(lambda t: t, 0.5)}, r"^force must have a frequency, which sets the"),
        ({"force": 3.0}, r"^force must be a Force"),
        ({"force": pp.Force(lambda p: (1.0, 2.0), 0.5, 3.0)}, r"^force\(0\) must give finite"),
    ],
)
def test_forces_that_have_no_one_period_are_refused(given, message):
    with pytest.raises((ValueError, TypeError), match=message):
        pp.attractors(SLACK, **{"u": 1.0, "starts": 2} | given)


def test_a_torus_on_which_neighbours_turn_at_other_rates_is_told_by_its_averages():
    """Its exponent, 6e-5 with a spread of 8e-6 after a time of 535, is no chaos, nor a doubt."""
    model = pp.Chain(pp.Pipe(0.3, 10.0, drag=0.3, damping=0.002), 2, dimensions=3)
    flow = pp.Pulsation(6.046199930863956, 0.09071368885172378, 2.1133187851809336)
    found = pp.attractors(model, flow, 1, transient=200.0)
    assert [basin.ending for basin in found.basins] == ["quasi-periodic"]
