# SPDX-License-Identifier: MIT
"""Inlet coefficient alpha = A int V^2 dS / (int V dS)^2 (paper, eqs. (7)-(8))."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pipedyn as pd


def test_a_uniform_inlet_over_the_pipes_section_has_coefficient_one():
    assert pd.inlet_coefficient(lambda r: 3.0, radius=0.02) == pytest.approx(1.0, rel=1e-12)


def test_a_parabolic_profile_carries_a_third_more_momentum():
    alpha = pd.inlet_coefficient(lambda r: 1.0 - (r / 0.5) ** 2, radius=0.5)
    assert alpha == pytest.approx(4.0 / 3.0, rel=1e-10)


@pytest.mark.parametrize("power", [6, 7, 10])
def test_the_power_law_of_turbulent_pipe_flow_has_its_textbook_coefficient(power):
    """V = (1 - r)^(1/n): (1 + n)(1 + 2n)^2 / (4 n^2 (2 + n)), elementary integration."""
    n = power
    expected = (1 + n) * (1 + 2 * n) ** 2 / (4 * n**2 * (2 + n))
    assert pd.inlet_coefficient(lambda r: (1.0 - r) ** (1.0 / n)) == pytest.approx(
        expected, rel=1e-8
    )


def test_an_inlet_wider_than_the_pipe_has_a_coefficient_below_one():
    section = math.pi
    wide = pd.inlet_coefficient(lambda r: 1.0, radius=math.sqrt(2.0), section=section)
    assert wide == pytest.approx(0.5, rel=1e-12)


def test_samples_at_radii_meet_the_function_they_are_taken_from():
    r = np.linspace(0.0, 0.7, 400)
    profile = 2.0 - (r / 0.7) ** 2
    from_function = pd.inlet_coefficient(lambda x: 2.0 - (x / 0.7) ** 2, radius=0.7)
    assert pd.inlet_coefficient(profile, radii=r) == pytest.approx(from_function, rel=1e-6)


def test_samples_on_patches_are_plain_sums():
    velocity, areas = [1.0, 2.0, 4.0], [0.5, 0.25, 0.25]
    flow, momentum = 0.5 + 0.5 + 1.0, 0.5 + 1.0 + 4.0
    assert pd.inlet_coefficient(velocity, areas=areas) == pytest.approx(momentum / flow**2)
    assert pd.inlet_coefficient(velocity, areas=areas, section=3.0) == pytest.approx(
        3.0 * momentum / flow**2
    )


@given(
    st.lists(st.tuples(st.floats(0.01, 10.0), st.floats(0.01, 10.0)), min_size=1, max_size=20),
    st.floats(1e-6, 1e6),
)
def test_no_profile_over_the_pipes_own_section_has_a_coefficient_below_one(patches, unit):
    """Cauchy and Schwarz; and neither the unit of speed nor that of area matters."""
    velocity, areas = map(np.array, zip(*patches, strict=True))
    alpha = pd.inlet_coefficient(velocity, areas=areas)
    assert alpha >= 1.0 - 1e-12
    assert pd.inlet_coefficient(unit * velocity, areas=areas) == pytest.approx(alpha, rel=1e-12)
    assert pd.inlet_coefficient(velocity, areas=unit * areas) == pytest.approx(alpha, rel=1e-12)


def test_the_coefficient_does_not_ask_for_the_sign_of_the_flow():
    assert pd.inlet_coefficient(lambda r: r - 1.0) == pytest.approx(
        pd.inlet_coefficient(lambda r: 1.0 - r), rel=1e-12
    )


@pytest.mark.parametrize(
    "velocity", [lambda r: 0.0, lambda r: 1.0 - 2.0 * r**2], ids=["none", "as much out as in"]
)
def test_an_inlet_through_which_nothing_flows_is_refused(velocity):
    with pytest.raises(ValueError, match="velocity"):
        pd.inlet_coefficient(velocity)
