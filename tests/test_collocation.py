# SPDX-License-Identifier: MIT
"""Collocation of periodic orbits in the core, against integrated motions and numpy."""

import numpy as np
import pytest
import scipy.integrate

import pipedyn as pp
from pipedyn import _core
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import collocation_maps, eliminated
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


@pytest.mark.parametrize("level", _core.vector_levels())
@pytest.mark.parametrize("half", [1, 2, 3, 7])
def test_eliminated_stages_solve_their_equations(half, level, at_level):
    """Of random derivatives: each stage's change is that of its force, for each right-hand side."""
    at_level(level)
    random = np.random.default_rng(half)
    count, stages, n, h, frequency = 3, STAGE_NODES.size, 2 * half, np.array([0.1, 0.3, 0.2]), 4.0
    starts, rates = random.normal(size=(count, n)), random.normal(size=(count, stages, half))
    linearised = random.normal(size=(count, stages, 2 + n, n))
    orbit = PeriodicOrbit(np.append(0.0, frequency * np.cumsum(h)), starts, rates, frequency, 1.0)
    by_rates, ends = eliminated(
        orbit, orbit.stage_columns(), linearised.reshape(-1, 2 + n, n), None, True
    )
    missed = at_stages(orbit)[:, -1] - np.stack([starts[1], starts[2], -starts[0]])
    for m in range(count):
        force, by_speed, jacobians = np.split(linearised[m], [1, 2], axis=1)
        found = by_rates[m].reshape(stages, half, n + 3)
        # The states at the stages are moved by their rates, the first state and the duration.
        once, twice = (np.einsum("ij,jab->iab", matrix, found) for matrix in (ONCE, TWICE))
        p, v = h[m] ** 2 * twice, h[m] * once
        p[:, :, :half] += np.eye(half)
        p[:, :, half:n] += h[m] * STAGE_NODES[:, None, None] * np.eye(half)
        v[:, :, half:n] += np.eye(half)
        longer = -h[m] / frequency
        at_once = STAGE_NODES[:, None] * starts[m, half:] + 2.0 * h[m] * TWICE @ rates[m]
        p[:, :, n + 1] += longer * at_once
        v[:, :, n + 1] += longer * (ONCE @ rates[m])
        moved = jacobians[:, half:] @ np.concatenate([p, v], axis=1)
        moved[:, :, n] += force[:, 0, half:] - rates[m]
        moved[:, :, n + 2] += by_speed[:, 0, half:]
        assert found == pytest.approx(moved, abs=1e-10 * np.abs(found).max())
        end = np.concatenate([p[-1], v[-1]])
        end[:, n] += missed[m]
        assert ends[m] == pytest.approx(end, abs=1e-10 * np.abs(ends).max())


@pytest.mark.parametrize("level", _core.vector_levels())
def test_joined_intervals_are_products_and_runs_end_before_they_lose_digits(level, at_level):
    at_level(level)
    random = np.random.default_rng(2)
    maps, right = random.normal(size=(9, 5, 5)), random.normal(size=(9, 5, 2))
    whole, begins = _core.carried(np.concatenate([maps, right], axis=2), 40.0)
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
    right, slopes = np.zeros((2, STAGE_NODES.size, 1)), np.zeros((2, STAGE_NODES.size, 4, 2))
    with pytest.raises(ValueError, match="maps must have shape"):
        _core.carried(np.zeros((2, 3, 2)), 1e5)
    with pytest.raises(ValueError, match="once and right must have shapes"):
        _core.stage_changes(*[np.zeros(3)] * 5)
    with pytest.raises(ValueError, match="durations must hold 2 numbers"):
        _core.stage_changes(np.zeros(3), np.zeros(0), ONCE, TWICE, right)
    with pytest.raises(ValueError, match="right must hold 16 numbers"):
        _core.stage_changes(np.zeros(2), slopes, ONCE, TWICE, np.zeros((2, 9, 1)))
