# SPDX-License-Identifier: MIT
"""Aspirating pipes whose fluid enters with a share c of the free end's velocity."""

import numpy as np
import pytest
from independent import quadratic_eigenvalues

import pipedyn as pp


def aspirating(share, beta=0.2, **numbers):
    return pp.Pipe(beta, flow="aspirating", inflow_share=share, **numbers)


def test_at_small_speeds_the_flow_feeds_each_mode_by_its_share_alone():
    """First order: Re lambda = 2 c sqrt(beta) u - (delta omega^2 + sigma) / 2 for every mode."""
    u, share, sigma = 1e-4, 0.3, 0.01
    pipe = aspirating(share, damping=1e-5, terms=[pp.Viscosity(sigma)])
    values = pp.eigenvalues(pp.Continuum(pipe), u, 6)[::2]
    expected = 2.0 * share * np.sqrt(0.2) * u - 0.5 * (1e-5 * values.imag**2 + sigma)
    assert values.real == pytest.approx(expected, rel=2e-4)
    onset = pp.critical_speed(pp.Continuum(pipe)).speed
    assert onset == pytest.approx((1e-5 * 3.516015**2 + sigma) / (4 * share * 0.2**0.5), rel=1e-3)


def test_fluid_drawn_from_rest_without_suction_takes_and_gives_no_energy():
    pipe = aspirating(0.0, alpha=0.0, gamma=3.0)
    for model in (pp.Chain(pipe, 5), pp.Galerkin(pipe, 4), pp.modular.chain(pipe, 5)):
        with pytest.raises(pp.NoCrossing):
            pp.critical_speed(model, 20.0)
        assert np.abs(pp.eigenvalues(model, 3.0, 6).real).max() < 1e-10
    y = np.random.default_rng(2).normal(size=10)
    assert pp.Chain(pipe, 5).power(y, 3.0).total == 0.0
    with pytest.raises(pp.NoCrossing):
        pp.critical_speed(pp.Continuum(pipe), 20.0)


def test_undamped_suction_of_fluid_at_rest_feeds_the_pipe_from_the_smallest_flow_on():
    """Growth begins with u^3, which rounding hides up to some 1e-4: so far the speed is known."""
    pipe = aspirating(0.0)
    for model in (pp.Chain(pipe, 30), pp.Galerkin(pipe, 8), pp.Continuum(pipe)):
        found = pp.critical_speed(model)
        assert found.speed == 0.0
        assert found.error < 1e-3
        assert (found.mode, found.unstable_after) == (1, 2)
        growth = [pp.eigenvalues(model, u, 2)[0].real for u in (0.02, 0.04)]
        assert growth[1] / growth[0] == pytest.approx(8.0, rel=0.01)


@pytest.mark.parametrize("share", [0.0, 0.4])
def test_recursion_along_the_chain_meets_the_matrices_roots(share):
    """Small chains against the textbook's inverse problem; a long one with its own errors."""
    for n, damping in ((1, 0.0), (2, 0.1), (9, 1e-3)):
        chain = pp.Chain(aspirating(share, 0.5, gamma=3.0, damping=damping), n)
        exact = quadratic_eigenvalues(*chain.operators().at(4.0))
        found = pp.eigenvalues(chain, 4.0)
        apart = np.abs(found[:, None] - exact).min(axis=1)
        assert (apart <= 1e-11 * (1.0 + np.abs(found))).all()
    long = pp.Chain(aspirating(share, 0.5, damping=1e-4), 300)
    exact = pp.eigenvalues(pp.Continuum(long.pipe), 3.0, 6)
    found = pp.modes(long, 3.0, 3)
    assert np.abs(found.eigenvalues[:3] / exact[::2] - 1.0).max() < 1e-3
    assert found.errors.max() < 1e-8


def test_weak_damping_is_extrapolated_with_the_share_as_well():
    """u_c depends on sqrt(beta) / delta: delta omega^2 / (4 c sqrt(beta)) at leading order."""
    for share, number in ((1.0, 1), (0.25, 4)):
        pipe = aspirating(share, 1e-12, damping=1e-9)
        found = pp.critical_speed(pp.Galerkin(pipe, 8)).speed
        assert found == pytest.approx(number * 1e-9 * 3.516015**2 / 4e-6, rel=1e-3)


def test_share_is_checked_converted_and_shown():
    with pytest.raises(ValueError, match=r"^inflow_share must be 1 for an ejecting pipe, as no"):
        pp.Pipe(0.2, inflow_share=0.5)
    hose = {"length": 0.6, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(**hose, flow="aspirating", inflow_share=0.25)
    assert pipe.inflow_share == 0.25
    assert "inflow_share=0.25" in repr(pipe)


@pytest.mark.parametrize(("share", "sigma"), [(1.0, 0.02), (1.0, 0.5), (0.3, 0.05)])
def test_where_all_modes_lose_stability_at_nearly_one_speed_the_true_first_is_found(share, sigma):
    """At leading order u = sigma / (4 c sqrt(beta)) for every mode; the first is a little lower."""
    pipe = aspirating(share, terms=[pp.Viscosity(sigma)])
    found = pp.critical_speed(pp.Continuum(pipe))
    leading = sigma / (4.0 * share * np.sqrt(0.2))
    assert found.mode == 1
    assert leading * (1.0 - leading**2) < found.speed < leading
    assert found.error < 1e-12
    assert pp.critical_speed(pp.Galerkin(pipe, 24)).speed == pytest.approx(found.speed, rel=3e-6)
    assert pp.eigenvalues(pp.Continuum(pipe), found.speed, 40).real.max() < 1e-9
