# SPDX-License-Identifier: MIT
"""Floquet multipliers by Magnus' series, against Mathieu's equation, exponentials and kinks."""

import numpy as np
import pytest
import scipy

import pipedyn as pp
from pipedyn.orbits import magnus
from pipedyn.orbits.periodic_orbit import STAGE_NODES


def mathieu(a, q, intervals=16):
    """Derivatives of x'' = -(a - 2 q cos 2 t) x at stages over its period pi, and durations."""
    duration = np.pi / intervals
    t = duration * (np.arange(intervals)[:, None] + STAGE_NODES)
    rows = np.zeros((intervals, STAGE_NODES.size, 1, 2))
    rows[..., 0, 0] = -(a - 2.0 * q * np.cos(2.0 * t))
    return rows, np.full(intervals, duration)


def product(maps):
    whole = np.eye(maps.shape[1])
    for one in maps:
        whole = one @ whole
    return whole


def monodromy(a, q, parts, units=(1.0, 1.0)):
    rows, durations = mathieu(a, q)
    counts = np.full(len(rows), parts)
    return product(magnus.interval_maps(rows, durations, np.array(units), counts))


@pytest.mark.parametrize("order", [1, 4])
def test_maps_converge_with_the_fourth_power_of_the_parts(order):
    # At its characteristic numbers the equation has a solution of period pi or 2 pi: the
    # multipliers' sum is 2 or -2.
    q = 20.0
    a = scipy.special.mathieu_a(order, q)
    parts = np.array([1, 2, 4, 8])
    found = [np.trace(monodromy(a, q, count)) for count in parts]
    errors = np.abs(np.array(found) - (2.0 if order % 2 == 0 else -2.0))
    assert errors[0] > 1000.0 * errors[-1]
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(4.0, abs=0.3)


def test_two_lengths_of_parts_give_a_better_map():
    q = 5.0
    a = scipy.special.mathieu_a(2, q)
    coarse, fine = (monodromy(a, q, parts) for parts in (1, 2))
    better = fine + (fine - coarse) / 15.0
    assert abs(np.trace(better) - 2.0) < 0.1 * abs(np.trace(fine) - 2.0)


def test_what_does_not_change_is_exact_however_fast():
    # 1,000 rad in a part: methods that resolve the turns would need thousands of steps.
    frequency = 16_000.0
    found = monodromy(frequency**2, 0.0, 1, (1.0, frequency))
    angle = frequency * np.pi
    exact = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    assert found == pytest.approx(np.array(exact), abs=1e-9)


def test_units_give_the_same_maps():
    rows, durations = mathieu(3.0, 2.0, 4)
    counts, units = np.array([1, 3, 3, 2]), np.array([1.0, 7.0])
    plain = magnus.interval_maps(rows, durations, np.ones(2), counts)
    scaled = magnus.interval_maps(rows, durations, units, counts)
    assert scaled * units[:, None] / units == pytest.approx(plain, rel=1e-13)


@pytest.mark.parametrize("size", [1e-3, 0.5, 3.0, 200.0])
def test_exponentials_are_those_of_scipy(size):
    rng = np.random.default_rng(3)
    turning = rng.normal(size=(3, 2, 6, 6))
    turning = size * (turning - turning.swapaxes(-1, -2))  # does not grow
    assert magnus.exponentials(turning) == pytest.approx(
        scipy.linalg.expm(turning), abs=1e-14 * (1.0 + 30.0 * size)
    )


def test_exponentials_that_overflow_are_not_finite():
    with np.errstate(over="ignore", invalid="ignore"):
        assert not np.isfinite(magnus.exponentials(np.full((1, 2, 2), 1e200))).any()


@pytest.mark.parametrize("n", [3, 6, 10])
def test_intervals_end_at_the_kinks_of_drag(n):
    """A kink within an interval would leave 6e-8 or more of the trivial multiplier."""
    for rtol in (1e-3, 1e-6):
        cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.2, drag=2.0), n), 6.5, rtol=rtol)
        assert np.abs(cycle.multipliers - 1.0).min() < 1e-8


def test_both_ways_to_the_multipliers_agree():
    """Of functions that the mesh does not resolve; next to no drag has kinks at unknown phases."""
    by_series, by_collocation = (
        pp.limit_cycle(pp.Galerkin(pp.Pipe(0.2, drag=drag), 12, "legendre"), 6.0)
        for drag in (0.0, 1e-13)
    )
    assert by_collocation.multiplier_error < 1e-9 < by_series.multiplier_error < 1e-7
    assert by_series.multipliers == pytest.approx(
        by_collocation.multipliers, abs=by_series.multiplier_error
    )
