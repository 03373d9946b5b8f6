# SPDX-License-Identifier: MIT
"""Motions that end on equilibria and cycles that are known, and those that do not."""

from dataclasses import replace

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.bifurcation import brute_force
from pipedyn.bifurcation import diagram as module
from pipedyn.bifurcation.branches import _steepness
from pipedyn.bifurcation.known_solutions import KnownSolution, approached, at_rest
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.util.counters import counted

MODEL, SPEED = pp.Chain(pp.Pipe(0.2), 3), 5.0
PHASES = np.linspace(0.0, 12.0, 32)


@pytest.fixture(scope="module")
def cycle():
    return KnownSolution(True, orbit=pp.limit_cycle(MODEL, SPEED).orbit)


def beside(cycle, share):
    """States by a share of the cycle's size beside it, in a direction across it."""
    y = cycle.sign * cycle.orbit.states(PHASES)
    return y + share * cycle.size * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])[:, None]


def test_distances_are_across_a_cycle_and_not_along_it(cycle):
    assert cycle.distances(cycle.orbit.states(PHASES + 0.3), 10.0) == pytest.approx(0.0, abs=1e-7)
    dense = cycle.orbit.states(np.linspace(0.0, 2.0 * np.pi, 20_001))
    states = beside(cycle, 0.05)
    units = np.repeat([1.0, 10.0], 3)[:, None]
    least = [np.linalg.norm((dense - y[:, None]) / units, axis=0).min() for y in states.T]
    assert cycle.distances(states, 10.0) == pytest.approx(np.array(least), rel=1e-2)


@pytest.mark.parametrize(
    ("shares", "ends"),
    [
        (np.geomspace(0.01, 0.001, 32), True),
        (np.geomspace(1e-3, 8e-4, 32), True),  # slowly, but near
        (np.geomspace(0.01, 0.008, 32), False),  # too slowly to be sure of it
        (np.geomspace(0.001, 0.01, 32), False),  # it leaves
        (np.geomspace(0.5, 0.1, 32), False),  # still far
    ],
)
def test_motions_end_on_what_they_come_near_to(cycle, shares, ends):
    states = beside(cycle, shares)
    assert (approached([cycle], states) == 0) == ends
    assert approached([replace(cycle, stable=False)], states) is None
    mirrored = replace(cycle, sign=-1.0)
    still = at_rest(VectorField(MODEL), [np.zeros(3)], SPEED)
    assert (approached([*still, mirrored], states) == 1) == ends  # its own mirror image


def test_an_unstable_cycle_next_to_a_stable_one_leaves_it_open_where_motions_end(cycle):
    states = beside(cycle, np.geomspace(0.01, 0.001, 32))
    near = pp.limit_cycle(MODEL, 1.0001 * SPEED).orbit
    assert approached([cycle, KnownSolution(False, orbit=near)], states) is None


def test_equilibria_and_their_stability_are_those_of_a_pipe_that_leans():
    model = pp.Chain(pp.Pipe(0.2, -20.0), 2)
    known = pp.equilibria(model, 1.0)
    found = at_rest(VectorField(model), known.q + 0.01, 1.0)
    assert [one.stable for one in found] == known.stable.tolist()
    for one, q in zip(found, known.q, strict=True):
        assert one.rest[:2] == pytest.approx(q, abs=1e-8)
    assert at_rest(VectorField(model), [known.q[0] + 1.0], 1.0) == []


def test_motions_end_where_they_would_have_ended_and_cost_less():
    speeds = np.array([4.0, 4.8, 5.6])
    found = pp.bifurcation_diagram(MODEL, speeds)
    known = module._known_solutions(MODEL, speeds, found.equilibria, list(found.cycles))
    assert [[one.stable for one in known[u]] for u in speeds] == [[True]] + 2 * [[False, True]]
    options = brute_force.MotionOptions(100.0, 40.0, 1e-6, False)
    starts = brute_force.initial_bends(MODEL, 3, 0)
    answers, costs = [], []
    for solutions in ({}, known):
        with counted() as work:
            answers.append(
                brute_force.attractors(MODEL, speeds, starts, options, [], None, False, solutions)
            )
        costs.append(work.right_hand_sides)
    assert costs[1] < 0.6 * costs[0]
    for long, short in zip(*answers, strict=True):
        assert (short.ending, short.period) == (long.ending, long.period)
        for end in (np.min, np.max):
            assert end(short.turnings) == pytest.approx(end(long.turnings), abs=2e-5)


def test_the_largest_of_a_dozen_peaks_is_the_amplitude():
    model = pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2)
    (one,) = brute_force.attractors(
        model,
        np.array([11.3846]),
        brute_force.initial_bends(model, 1, 0),
        brute_force.MotionOptions(60.0, 20.0, 1e-6, False),
        [],
        None,
        False,
    )
    cycle = pp.limit_cycle(model, 11.3846, one.end)
    phases = np.linspace(0.0, 2.0 * np.pi, 20_001)
    across = VectorField(model).tip(cycle.orbit.states(phases))
    assert cycle.amplitude == pytest.approx(0.5 * np.ptp(across), rel=1e-6)
    assert one.period > 10


def test_a_speed_that_stays_while_the_frequency_falls_is_that_of_an_infinite_period():
    frequencies = [2.0, 1.8, 1.6, 1.4]
    assert _steepness([5.0, 5.0 + 1e-6, 5.0, 5.0], frequencies) < 3e-6
    assert _steepness([5.0, 5.1, 5.2, 5.3], frequencies) > 0.1
    assert _steepness([5.0] * 4, [2.0, 1.8, 1.9, 1.4]) == np.inf
    assert _steepness([5.0] * 3, frequencies[:3]) == np.inf
