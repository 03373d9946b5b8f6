# SPDX-License-Identifier: MIT
"""Collocation of periodic orbits in the core, against integrated motions and numpy."""

import numpy as np
import pytest
import scipy.integrate

import pipedyn as pp
from pipedyn import _core
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import WEIGHTS, collocation_maps
from pipedyn.orbits.periodic_orbit import (
    ONCE,
    STAGE_NODES,
    TWICE,
    PeriodicOrbit,
    interpolated,
    stage_phases,
)

MODEL, SPEED = pp.Chain(pp.Pipe(0.2, 5.0, damping=0.01), 3), 6.0


@pytest.fixture(scope="module")
def cycle():
    return pp.limit_cycle(MODEL, SPEED, rtol=1e-9)


def at_stages(orbit):
    """States at the stages, the last of which are the ends of intervals, (M, s, 2 half)."""
    columns = orbit.stage_columns().reshape(2 * orbit.half, len(orbit.starts), -1)
    return columns.transpose(1, 2, 0)


@pytest.mark.parametrize("level", _core.vector_levels())
def test_maps_are_what_motions_make_of_small_changes(cycle, level, at_level):
    at_level(level)
    motion, orbit = VectorField(MODEL), cycle.orbit
    maps, units = collocation_maps(motion, orbit)
    for m in (0, len(maps) - 1):
        ends = []
        for sign in (1.0, -1.0):
            for k in range(motion.size):
                y = orbit.starts[m].copy()
                y[k] += sign * 1e-4
                moved = scipy.integrate.solve_ivp(
                    *(lambda t, y: motion(y[:, None], SPEED)[:, 0], (0.0, orbit.durations[m]), y),
                    method="DOP853",
                    rtol=1e-11,
                    atol=1e-13,
                )
                ends.append(moved.y[:, -1])
        ahead, behind = np.split(np.array(ends).T, 2, axis=1)
        measured = (ahead - behind) / 2e-4 * units / units[:, None]
        assert maps[m] == pytest.approx(measured, abs=1e-6)


@pytest.mark.parametrize("half", [1, 2, 3, 7])
def test_eliminated_stages_solve_their_equations(half):
    """Of random derivatives: each stage's change is that of its force, for each right-hand side."""
    random = np.random.default_rng(half)
    stages, n, h, frequency = STAGE_NODES.size, 2 * half, 0.3, 4.0
    start, rates = random.normal(size=(1, n)), random.normal(size=(1, stages, half))
    linearised = random.normal(size=(stages, 2 + n, n))
    force, by_speed, jacobians = linearised[:, 0, half:], linearised[:, 1, half:], linearised[:, 2:]
    found, ends = _core.condense(
        np.array([h]), start, rates, linearised, None, True, frequency, WEIGHTS
    )
    found = found.reshape(stages, half, n + 3)
    # The states at the stages are moved by their rates, by the first state and by the duration.
    once, twice = (np.einsum("ij,jab->iab", matrix, found) for matrix in (ONCE, TWICE))
    p, v = h**2 * twice, h * once
    p[:, :, :half] += np.eye(half)
    p[:, :, half:n] += h * STAGE_NODES[:, None, None] * np.eye(half)
    v[:, :, half:n] += np.eye(half)
    longer = -h / frequency
    p[:, :, n + 1] += longer * (STAGE_NODES[:, None] * start[0, half:] + 2.0 * h * TWICE @ rates[0])
    v[:, :, n + 1] += longer * (ONCE @ rates[0])
    moved = jacobians[:, half:] @ np.concatenate([p, v], axis=1)
    moved[:, :, n] += force - rates[0]
    moved[:, :, n + 2] += by_speed
    assert found == pytest.approx(moved, abs=1e-10 * np.abs(found).max())
    assert ends[0] == pytest.approx(np.concatenate([p[-1], v[-1]]), abs=1e-10 * np.abs(ends).max())


def test_what_an_interval_misses_of_the_next_is_part_of_the_residual():
    random = np.random.default_rng(5)
    count, half, stages = 3, 2, STAGE_NODES.size
    n, h = 2 * half, np.array([0.1, 0.3, 0.2])
    starts, rates = random.normal(size=(count, n)), random.normal(size=(count, stages, half))
    linearised = random.normal(size=(count * stages, 2 + n, n))
    units = np.array([1.0, 2.0, 4.0, 0.5])
    given = h, starts, rates, linearised, None, False, 4.0, WEIGHTS
    by_rates, plain = _core.condense(*given)
    same, found = _core.condense(*given, -1.0, units)
    orbit = PeriodicOrbit(np.append(0.0, 4.0 * np.cumsum(h)), starts, rates, 4.0, 1.0)
    plain[:, :, n] += at_stages(orbit)[:, -1] - np.stack([starts[1], starts[2], -starts[0]])
    plain /= units[:, None]
    plain[:, :, :n] *= units
    assert np.array_equal(same, by_rates)
    assert found == pytest.approx(plain, abs=1e-13 * np.abs(plain).max())


def test_joined_intervals_are_products_and_runs_end_before_they_lose_digits():
    random = np.random.default_rng(2)
    maps, right = random.normal(size=(9, 5, 5)), random.normal(size=(9, 5, 2))
    whole, begins = _core.map_products(np.concatenate([maps, right], axis=2), 40.0)
    assert begins[0] == 0
    assert len(begins) > 1
    for first, last in zip(begins, [*begins[1:], 9], strict=True):
        product, sums = np.eye(5), np.zeros((5, 2))
        for k in range(first, last):
            product, sums = maps[k] @ product, maps[k] @ sums + right[k]
            assert whole[k] == pytest.approx(np.concatenate([product, sums], axis=1), abs=1e-12)
            assert k == first or np.abs(product).max() < 40.0
        if last < 9:
            assert np.abs(maps[last] @ product).max() >= 40.0


def test_states_between_the_stages_are_those_of_the_motion(cycle):
    t = np.linspace(0.0, 2.5 * cycle.period, 23)
    p, rates = np.split(cycle.orbit.states(np.zeros(1))[:, 0], 2)
    motion = pp.simulate(MODEL, SPEED, t[-1], p, rates, times=t, rtol=1e-11)
    found = cycle.orbit.states(cycle.orbit.frequency * t)
    assert found == pytest.approx(np.concatenate([motion.q, motion.qdot], axis=1).T, abs=1e-6)


def test_velocities_at_the_stages_are_those_at_their_phases(cycle):
    edges = np.array([0.0, 0.5, 1.3, 2.2, cycle.orbit.span])
    orbit = interpolated(VectorField(MODEL), cycle.orbit.states, edges, cycle.frequency, SPEED)
    stages = at_stages(orbit)[..., orbit.half :]
    phases = stage_phases(edges)
    phases[:, -1] -= 1e-9  # an interval's, not the next one's
    at = orbit.states(phases.ravel())[orbit.half :].T.reshape(stages.shape)
    assert stages[:, :-1] == pytest.approx(at[:, :-1], abs=1e-13)
    assert stages[:, -1] == pytest.approx(at[:, -1], abs=1e-6)


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="maps must have shape"):
        _core.map_products(np.zeros((2, 3, 2)), 1e5)
    with pytest.raises(ValueError, match="rates must have shape"):
        _core.condense(*[np.zeros(3)] * 4, None, False, 1.0, WEIGHTS)
    given = np.zeros(3), np.zeros((2, 2)), np.zeros((2, STAGE_NODES.size, 1))
    with pytest.raises(ValueError, match="durations must hold 2 numbers"):
        _core.condense(*given, np.zeros(0), None, False, 1.0, WEIGHTS)
