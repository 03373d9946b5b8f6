# SPDX-License-Identifier: MIT
"""Motions that end on equilibria and cycles that are known, and those that do not."""

from dataclasses import replace

import numpy as np
import pytest

import pipedyn as pp
from pipedyn.attraction.motion_ends import Case, motion_ends
from pipedyn.attraction.motion_options import MotionOptions
from pipedyn.attraction.regions import DECAY_SHARE, NOWHERE, Approach, ApproachTask, Arrivals
from pipedyn.attraction.solutions import cycle as solution
from pipedyn.attraction.solutions import equilibria_near, with_separate_regions
from pipedyn.cycles.branches import _steepness
from pipedyn.motion.simulate import checked_task, initial_bends
from pipedyn.motion.vector_field import Excitation, VectorField
from pipedyn.util.counters import count_work

MODEL, SPEED = pp.Chain(pp.Pipe(0.2), 3), 5.0
BLOCK = 32
PHASES = np.linspace(0.0, 2.0 * np.pi * (1.0 - 1.0 / BLOCK), BLOCK)
ASIDE = np.sqrt(3.0) * np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # root mean square 1


def at_distances(stable, orbit, sign=1.0):
    """A cycle to which distances alone tell whether motions come nearer."""
    known = solution(MODEL, Excitation(SPEED), orbit, stable)
    known = known if sign > 0.0 else known.mirrored(False)
    return replace(known, region=replace(known.region, floquet=None))


@pytest.fixture(scope="module")
def cycle():
    return at_distances(True, pp.limit_cycle(MODEL, SPEED).orbit)


def ends_on(solutions, orbit, distances, sign=1.0, looks=1):
    """Which of the solutions a motion ends on that is so far beside an orbit in each period.

    looks: number of times that its samples are looked at, at equal intervals.
    """
    y = sign * orbit.states(np.tile(PHASES, len(distances))).T
    states = y + np.repeat(distances, BLOCK)[:, None] * ASIDE
    stable = [one for one in solutions if one.attracts]
    task = ApproachTask(
        **vars(checked_task(MODEL, SPEED, 1.0, np.zeros(3), None)),
        regions=tuple(one.region for one in stable),
        phases=np.zeros((BLOCK, 0)),
    )
    arrivals = Arrivals([task])
    for look in range(1, looks + 1):
        arrivals.ended(states[None], np.array([look * len(states) // looks]))
    [approach] = arrivals.approaches
    return solutions.index(stable[approach.region]) if approach.reached else NOWHERE


def test_distances_are_across_a_cycle_and_not_along_it(cycle):
    region, orbit = cycle.region, cycle.orbit
    assert region.distances(orbit.states(PHASES + 0.3).T) == pytest.approx(0.0, abs=3e-5)
    dense = orbit.states(np.linspace(0.0, 2.0 * np.pi, 20_001))
    states = orbit.states(PHASES) + 0.02 * ASIDE[:, None]
    units = np.repeat([1.0, orbit.frequency], 3)[:, None] * np.sqrt(3.0)
    least = [np.linalg.norm((dense - y[:, None]) / units, axis=0).min() for y in states.T]
    assert region.distances(states.T) == pytest.approx(np.array(least), abs=3e-5)


@pytest.mark.parametrize(
    ("distances", "ends"),
    [
        (np.geomspace(0.03, 0.001, 8), True),
        (np.full(2, 5e-5), True),  # on it
        (np.geomspace(0.03, 0.003, 8), False),  # not so much nearer yet
        (np.geomspace(0.001, 0.03, 8), False),  # it leaves
        (np.geomspace(0.5, 0.1, 8), False),  # still far
    ],
)
def test_motions_end_on_what_they_come_near_to(cycle, distances, ends):
    orbit = cycle.orbit
    assert (ends_on([cycle], orbit, distances) == 0) == ends
    mirrored = at_distances(True, orbit, -1.0)
    still = equilibria_near(MODEL, [np.zeros(3)], SPEED)
    assert not still[0].attracts
    assert (ends_on([mirrored, *still], orbit, distances, -1.0) == 0) == ends
    for looks in (3, 8, 100):  # several blocks at a look, each at one, or most looks without one
        assert (ends_on([cycle, *still], orbit, distances, looks=looks) == 0) == ends


def test_an_unstable_cycle_next_to_a_stable_one_leaves_it_open_where_motions_end(cycle):
    near = at_distances(False, pp.limit_cycle(MODEL, 1.001 * SPEED).orbit)
    distances = np.geomspace(0.03, 0.001, 8)
    assert ends_on([cycle], cycle.orbit, distances) == 0
    assert ends_on(with_separate_regions([cycle, near]), cycle.orbit, distances) == NOWHERE


def test_regions_are_the_same_if_solutions_become_known_one_by_one(cycle):
    near = at_distances(False, pp.limit_cycle(MODEL, 1.001 * SPEED).orbit)
    leaning = equilibria_near(MODEL, [np.zeros(3)], SPEED)
    every = [near, cycle, *leaning, at_distances(True, cycle.orbit, -1.0), near.mirrored(False)]
    one_by_one = []
    for one in every:
        one_by_one = with_separate_regions([*one_by_one, one], len(one_by_one))
    radii = [one.region.radius for one in with_separate_regions(every)]
    assert [one.region.radius for one in one_by_one] == radii
    assert max(radii) > 2.0 * min(radii)


def test_equilibria_and_their_stability_are_those_of_a_pipe_that_leans():
    model = pp.Chain(pp.Pipe(0.2, -20.0), 2)
    known = pp.equilibria(model, 1.0)
    found = equilibria_near(model, known.q + 0.01, 1.0)
    assert [one.attracts for one in found] == known.stable.tolist()
    for one, q in zip(found, known.q, strict=True):
        assert one.region.points[0, :2] == pytest.approx(q, abs=1e-8)
    assert equilibria_near(model, [known.q[0] + 1.0], 1.0) == []


def motions(model, speeds, starts, options, solutions=None):
    """Ends of motions from starts at speeds, where some solutions may be known."""
    known = solutions or {}
    numbered = {k: np.asarray(model.initial_state(q, None)) for k, q in enumerate(starts)}
    cases = [Case(model, Excitation(u), known.get(u, ()), numbered) for u in speeds]
    return [case.ends[k][1] for case in motion_ends(model, cases, options) for k in numbered]


def test_motions_end_where_they_would_have_ended_and_cost_less():
    speeds, options = [4.0, 4.8, 5.6], MotionOptions(100.0, 40.0, 1e-6, False)
    starts, known = initial_bends(MODEL, 3, 0), {4.0: equilibria_near(MODEL, [np.zeros(3)], 4.0)}
    for u in speeds[1:]:
        orbit = pp.limit_cycle(MODEL, u).orbit
        known[u] = [solution(MODEL, Excitation(u), orbit, True)]
    answers, costs = [], []
    for solutions in ({}, known):
        with count_work() as work:
            answers.append(motions(MODEL, speeds, starts, options, solutions))
        costs.append(work.right_hand_sides)
    assert costs[1] < 0.75 * costs[0]
    for long, short in zip(*answers, strict=True):
        assert (short.ending, short.period) == (long.ending, long.period)
        for end in (np.min, np.max):
            assert end(short.turnings) == pytest.approx(end(long.turnings), abs=2e-5)


def test_the_largest_of_a_dozen_peaks_is_the_amplitude():
    model, u = pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2), 11.3846
    (one,) = motions(model, [u], initial_bends(model, 1, 0), MotionOptions(60.0, 20.0, 1e-6, False))
    cycle = pp.limit_cycle(model, u, one.end)
    phases = np.linspace(0.0, 2.0 * np.pi, 200_001)
    across = VectorField(model).end(cycle.orbit.states(phases))[0]
    assert cycle.amplitude == pytest.approx(0.5 * np.ptp(across), rel=1e-6)
    assert one.period > 10


def test_a_speed_that_stays_while_the_frequency_falls_is_that_of_an_infinite_period():
    frequencies = [2.0, 1.8, 1.6, 1.4]
    assert _steepness([5.0, 5.0 + 1e-6, 5.0, 5.0], frequencies) < 3e-6
    assert _steepness([5.0, 5.1, 5.2, 5.3], frequencies) > 0.1
    assert _steepness([5.0] * 4, [2.0, 1.8, 1.9, 1.4]) == np.inf
    assert _steepness([5.0] * 3, frequencies[:3]) == np.inf


SUBCRITICAL = pp.Chain(pp.Pipe(0.7), 3)


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (SUBCRITICAL, 6.1),
        (pp.Chain(pp.Pipe(0.2, 10.0, drag=1.0), 2), 3.0),
        (pp.Galerkin(pp.Pipe(0.2, 10.0, terms=[pp.PointMass(1.0, 0.2)]), 4), 3.8),
    ],
)
def test_modal_coordinates_of_motions_beside_a_rest_decay_by_its_eigenvalues(model, u):
    [rest] = equilibria_near(model, [model.resting()], u)
    assert rest.attracts
    found, random = rest.region.floquet, np.random.default_rng(1)
    values = np.linalg.eigvals(model.motion_jacobian(rest.region.points[0], u))
    np.testing.assert_allclose(np.sort(found.decay), np.sort(-values.real)[: found.decay.size])
    away = 1e-5 * random.normal(size=2 * model.integrated)
    motion = pp.simulate(model, u, 1.0, *np.split(away, 2), times=[0.0, 0.4, 1.0], atol=1e-13)
    sizes = np.abs(rest.region.coordinates(np.concatenate([motion.q, motion.qdot], axis=1)))
    expected = sizes[0] * np.exp(-found.decay * motion.t[:, None])
    np.testing.assert_allclose(sizes, expected, rtol=1e-3, atol=1e-4 * sizes.max())


def test_motions_from_either_side_of_an_unstable_cycle_about_rest_part():
    onset = pp.hopf(SUBCRITICAL)
    u = onset.speed * (1.0 - 1e-4)
    cycle = pp.limit_cycle(SUBCRITICAL, u, onset)
    assert not cycle.stable
    on = cycle.orbit.states(PHASES[::32]).T
    starts = np.concatenate([share * on for share in (0.7, 0.95, 1.05, 1.3)])
    found = pp.attractors(SUBCRITICAL, u, starts, rtol=1e-8)
    rests = [k for k, one in enumerate(found.basins) if one.ending == "rest"]
    within = np.repeat([True, True, False, False], len(on))
    np.testing.assert_array_equal(np.isin(found.ends, rests), within)


TIP_MASS = pp.Galerkin(pp.Pipe(0.2, 10.0, terms=[pp.PointMass(1.0, 0.2)]), 6)


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (TIP_MASS, 4.5),  # modes up to a frequency of 280 decay slowly
        (pp.Galerkin(pp.Pipe(0.2), 4), 5.8),
        (MODEL, SPEED),
        (
            pp.Chain(pp.Pipe(0.3, terms=[pp.Weight(0.6, 3.0), pp.Spring(0.6, 40.0)]), 3),
            6.5,
        ),  # no mirror image
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_floquet_coordinates_of_motions_beside_a_cycle_decay_by_its_multipliers(model, u, sign):
    cycle, motion = pp.limit_cycle(model, u), VectorField(model)
    known = solution(model, Excitation(u), cycle.orbit, True)
    region = (known if sign > 0.0 else known.mirrored(False)).region
    found, period = region.floquet, 2.0 * np.pi / cycle.frequency
    sizes = np.sort(np.exp(-found.decay * period))[::-1]
    kept = np.abs(cycle.multipliers)[1 : 1 + sizes.size]  # the first is the trivial one
    assert sizes == pytest.approx(kept, rel=1e-3, abs=1e-4)
    assert np.abs(region.coordinates(sign * cycle.orbit.states(PHASES + 0.01).T)).max() < 1e-5
    random = np.random.default_rng(2)
    away = random.normal(size=motion.size)
    away *= 1e-4 / np.linalg.norm(away * region.units)
    on, times = sign * cycle.orbit.states(np.array([1.3]))[:, 0], np.linspace(0.0, period, 8)
    ends = []
    for start in (on + away, on - away):  # the difference is linear but for third order
        moved = pp.simulate(
            model, u, 1.001 * period, *np.split(start, 2), times=times, rtol=1e-12, atol=1e-13
        )
        ends.append(region.coordinates(np.concatenate([moved.q, moved.qdot], axis=1)))
    sizes = 0.5 * np.abs(ends[0] - ends[1])
    assert sizes[0].max() > 1e-5
    linear = sizes[0] * np.exp(-found.decay * times[:, None])
    assert np.abs(sizes - linear).max() < 0.02 * sizes[0].max()


def test_motions_come_nearer_where_every_floquet_coordinate_falls_as_it_must():
    decay, start = np.array([0.1, 5.0]), np.array([1.0, 100.0])

    def compared(rates, times):
        """Whether a motion whose coordinates change at rates is told to come nearer, and when."""
        approach = Approach(0, 0.01)
        for time in times:
            squares = start * np.exp(-2.0 * rates * time)
            approach = approach.later(times[1] - times[0], squares, decay)
            if approach.reached:
                return time
        return None

    times = np.arange(0.0, 20.0, 0.5)
    slowest = -np.log(DECAY_SHARE) / decay[0]
    # The fast one rules the first comparison, the slow one the second.
    assert slowest <= compared(decay, times) <= slowest + 1.5
    assert compared(0.6 * decay, times) is not None
    assert compared(np.array([0.4, 1.0]) * decay, times) is None  # too slow
    assert compared(np.array([0.0, 1.0]) * decay, times) is None  # as on a torus
    assert compared(np.array([-0.1, 1.0]) * decay, times) is None
