# SPDX-License-Identifier: MIT
"""Floquet multipliers by Magnus' series and by collocation, and at the kinks of forces."""

import numpy as np
import pytest

import pipedyn as pp


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
