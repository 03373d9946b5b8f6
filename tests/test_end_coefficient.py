# SPDX-License-Identifier: MIT
"""Inlet coefficient alpha = A int V^2 dS / (int V dS)^2 (paper, eqs. (7)-(8))."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad_vec

import pipedyn as pp


@pytest.mark.parametrize(
    ("velocity", "given", "alpha"),
    [
        (lambda r: 3.0, {"radius": 0.02}, 1.0),
        (lambda r: 1.0 - (r / 0.5) ** 2, {"radius": 0.5}, 4.0 / 3.0),  # parabolic
        (lambda r: 1.0, {"radius": math.sqrt(2.0), "section": math.pi}, 0.5),  # a wide inlet
        ([1.0, 0.5, 0.0], {"radii": [0.0, 1.0, 2.0]}, 1.5),  # samples on a straight line
    ],
)
def test_profiles_have_the_coefficients_of_elementary_integration(velocity, given, alpha):
    assert pp.end_coefficient(velocity, **given) == pytest.approx(alpha, rel=1e-10)


@pytest.mark.parametrize("n", [6, 7, 10])
def test_the_power_law_of_turbulent_pipe_flow_has_its_textbook_coefficient(n):
    """V = (1 - r)^(1/n): (1 + n)(1 + 2n)^2 / (4 n^2 (2 + n)), elementary integration."""
    expected = (1 + n) * (1 + 2 * n) ** 2 / (4 * n**2 * (2 + n))
    assert pp.end_coefficient(lambda r: (1.0 - r) ** (1.0 / n)) == pytest.approx(expected, rel=1e-8)


def test_samples_at_radii_meet_the_function_they_are_taken_from():
    r = np.linspace(0.0, 0.7, 400)
    profile = 2.0 - (r / 0.7) ** 2
    from_function = pp.end_coefficient(lambda x: 2.0 - (x / 0.7) ** 2, radius=0.7)
    assert pp.end_coefficient(profile, radii=r) == pytest.approx(from_function, rel=1e-6)


def test_samples_on_patches_are_plain_sums():
    velocity, areas = [1.0, 2.0, 4.0], [0.5, 0.25, 0.25]
    flow, momentum = 0.5 + 0.5 + 1.0, 0.5 + 1.0 + 4.0
    assert pp.end_coefficient(velocity, areas=areas) == pytest.approx(momentum / flow**2)
    assert pp.end_coefficient(velocity, areas=areas, section=3.0) == pytest.approx(
        3.0 * momentum / flow**2
    )


@given(
    st.lists(st.tuples(st.floats(0.01, 10.0), st.floats(0.01, 10.0)), min_size=1, max_size=20),
    st.floats(1e-6, 1e6),
)
def test_no_profile_over_the_pipes_own_section_has_a_coefficient_below_one(patches, unit):
    """Cauchy and Schwarz; and neither the unit of speed nor that of area matters."""
    velocity, areas = map(np.array, zip(*patches, strict=True))
    alpha = pp.end_coefficient(velocity, areas=areas)
    assert alpha >= 1.0 - 1e-12
    assert pp.end_coefficient(unit * velocity, areas=areas) == pytest.approx(alpha, rel=1e-12)
    assert pp.end_coefficient(velocity, areas=unit * areas) == pytest.approx(alpha, rel=1e-12)


def test_the_coefficient_does_not_ask_for_the_unit_of_speed():
    def jet(r):
        return 1.0 if 0.25 < r < 0.3 else 0.0

    r, v, areas = [0.0, 0.3, 1.0], np.array([1.0, 1.0, 0.0]), [1.0, 2.0, 3.0]
    for ask in (
        lambda k: pp.end_coefficient(lambda r: k * jet(r)),
        lambda k: pp.end_coefficient(k * v, radii=r),
        lambda k: pp.end_coefficient(k * v, areas=areas),
    ):
        expected = ask(1.0)
        for scale in (-1e-200, 5e-324, 1.7e308):
            assert ask(scale) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("unit", [1e-200, 1e200])
def test_the_coefficient_does_not_ask_for_the_unit_of_length(unit):
    def profile(r):
        return 1.0 - (r / unit) ** 2

    assert pp.end_coefficient(profile, radius=unit) == pytest.approx(4.0 / 3.0, rel=1e-11)
    r = np.linspace(0.0, 1.0, 5)
    assert pp.end_coefficient(1.0 - r, radii=unit * r) == pytest.approx(
        pp.end_coefficient(1.0 - r, radii=r), rel=1e-13
    )
    assert pp.end_coefficient([1.0, 2.0], areas=[unit, unit]) == pytest.approx(10.0 / 9.0)


def test_a_profile_that_does_not_settle_is_refused(monkeypatch):
    def sooner(*given, **settings):  # it gives up with fewer panels than for others
        return quad_vec(*given, **settings | {"limit": 2000})

    monkeypatch.setattr("scipy.integrate.quad_vec", sooner)
    noise = np.random.default_rng(1)
    with pytest.raises(ValueError, match=r"^velocity must be a profile that can be integrated"):
        pp.end_coefficient(lambda r: noise.random())


@pytest.mark.parametrize("slow", [0.0, 0.001])
@pytest.mark.parametrize("width", [1e-1, 1e-4])
@pytest.mark.parametrize("place", ["centre", "middle", "wall"])
def test_a_narrow_jet_is_not_overlooked(width, place, slow):
    """alpha of a uniform jet alone is the inlet's area over the jet's; a slow stream is beside."""
    start = {"centre": -1.0, "middle": 0.517, "wall": 1.0 - width}[place]
    end = {"centre": width, "middle": 0.517 + width, "wall": 2.0}[place]
    part = min(end, 1.0) ** 2 - max(start, 0.0) ** 2
    expected = (part + slow**2 * (1.0 - part)) / (part + slow * (1.0 - part)) ** 2
    alpha = pp.end_coefficient(lambda r: 1.0 if start < r / 0.02 < end else slow, radius=0.02)
    assert alpha == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("velocity", "given", "message"),
    [
        (lambda r: 0.0, {}, "velocity"),
        (lambda r: 1.0 - 2.0 * r**2, {}, "velocity"),  # as much out as in
        (lambda r: 1.0 / math.sqrt(1.0 - r) if r < 1.0 else math.inf, {}, "velocity"),
        (
            lambda r: 1.0,
            {"radius": 1e-200, "section": 1.0},
            "^section must be comparable with the opening's area",
        ),
    ],
    ids=["none", "as much out as in", "infinite momentum", "section out of proportion"],
)
def test_openings_without_a_coefficient_are_refused(velocity, given, message):
    with pytest.raises(ValueError, match=message):
        pp.end_coefficient(velocity, **given)
