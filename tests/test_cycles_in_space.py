# SPDX-License-Identifier: MIT
"""Cycles that leave the plane of a load, or other symmetries, against motions in time."""

from functools import cache

import numpy as np
import pytest

import pipedyn as pp

LEANING = pp.Chain(pp.Pipe(0.2, 10.0, inclination=0.3, damping=0.005), 3, dimensions=3)
"""A pipe that hangs askew: first it swings across its plane, then in it."""

SPRUNG = pp.Chain(
    pp.Pipe(0.2, damping=0.005, terms=[pp.Spring(0.6, 1.0, stiffness_across=1.6)]),
    *(3,),
    dimensions=3,
)
"""A straight pipe with a spring that is stiffer along z: it has two planes of symmetry."""


@cache
def diagram(model, *speeds):
    return pp.bifurcation_diagram(model, speeds, cycles=60)


def leaning():
    return diagram(LEANING, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0)


def returns(model, cycle):
    """How far a motion from a cycle's first state is from it after a period, by simulation."""
    given = cycle.period, cycle.q[0], cycle.qdot[0]
    motion = pp.simulate(model, cycle.u, *given, rtol=1e-10, samples=2)
    return np.abs(motion.q[-1] - cycle.q[0]).max() + np.abs(motion.qdot[-1] - cycle.qdot[0]).max()


def test_cycles_across_the_plane_of_a_load_begin_to_whirl_and_come_into_the_plane():
    found = leaning()
    assert not found.failures
    across, first, second, _, within = found.cycles
    assert [branch.origin for branch in found.cycles[:3]] == [
        "hopf",
        "branch point",
        "branch point",
    ]
    leaving = [event.speed for event in across.events if event.kind == "branch point"]
    assert first.onset == leaving[0] == pytest.approx(5.4768, abs=1e-4)
    assert second.onset == leaving[1]
    # The second branch joins motions across the plane to those in it.
    joined = [event.speed for event in within.events if event.kind == "branch point"]
    assert second.events[-1].kind == "branch point"
    assert second.events[-1].speed == pytest.approx(joined[0], abs=3e-5)
    assert np.abs(second.cycles[-1].tip[:, 2]).max() < 0.05 < np.ptp(second.cycles[0].tip[:, 2])
    assert np.abs(within.cycles[-1].tip[:, 2]).max() < 1e-12


def test_cycles_that_leave_a_symmetry_repeat_in_time_and_have_none():
    (cycle,) = leaning().cycles[1].at(6.0)
    assert cycle.stable
    assert returns(LEANING, cycle) < 1e-5
    half = len(cycle.t) // 2
    later = cycle.tip[half : 2 * half] * [1.0, 1.0, -1.0]
    assert np.abs(later - cycle.tip[:half]).max() > 0.1
    (swinging,) = leaning().cycles[0].at(6.0)
    later = swinging.tip[half : 2 * half] * [1.0, 1.0, -1.0]
    assert np.abs(later - swinging.tip[:half]).max() < 1e-4
    assert not swinging.stable


def test_a_motion_from_beside_a_lost_cycle_ends_on_the_one_that_left_it():
    (swinging,), (whirling,) = (branch.at(6.0) for branch in leaning().cycles[:2])
    q = swinging.q[0] + 0.01 * np.repeat([1.0, 0.0], 3)
    motion = pp.simulate(LEANING, 6.0, 400.0, q, swinging.qdot[0], samples=40001)
    late = motion.tip[motion.t > 380.0]
    for axis in (0, 2):
        assert np.ptp(late[:, axis]) == pytest.approx(np.ptp(whirling.tip[:, axis]), rel=5e-3)
    basins = pp.attractors(LEANING, 6.0, 6).basins
    assert {basin.ending for basin in basins} == {"periodic"}
    for basin in basins:
        assert basin.amplitude == pytest.approx(whirling.amplitude, rel=1e-4)
        assert basin.period == pytest.approx(whirling.period, rel=1e-4)


def test_planar_cycles_of_a_pipe_with_two_planes_of_symmetry_leave_that_of_the_stiffer_spring():
    found = diagram(SPRUNG, 4.5, 5.0, 5.5, 6.0)
    soft, stiff, whirling = found.cycles[:3]
    assert max(np.ptp(soft.cycles[-1].tip[:, 2]), np.ptp(stiff.cycles[-1].tip[:, 0])) < 1e-12
    (event,) = (one for one in stiff.events if one.kind == "branch point")
    assert (whirling.origin, whirling.onset) == ("branch point", event.speed)
    for cycle in whirling.at(5.0) + whirling.at(5.5):
        assert min(np.ptp(cycle.tip[:, 0]), np.ptp(cycle.tip[:, 2])) > 0.1
        assert returns(SPRUNG, cycle) < 1e-5
        half = len(cycle.t) // 2  # half a period later it is turned by half a turn
        assert cycle.tip[half, ::2] == pytest.approx(-cycle.tip[0, ::2], abs=1e-6)
    (cycle,) = stiff.at(5.0)
    assert not cycle.stable
