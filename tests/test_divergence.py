# SPDX-License-Identifier: MIT
"""Divergence, from the stiffness alone, and what gyroscopic forces and damping make of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from campaign_elements import elements
from campaign_reference import divergences
from scipy.optimize import brentq

import pipedyn as pp

PI = np.pi
MODELS = [pp.Continuum, lambda p: pp.Galerkin(p, 16, "legendre"), lambda p: pp.Chain(p, 160)]
NAMES = ["continuous", "legendre", "chain"]


def pinned(beta, **more):
    return pp.Pipe(beta, root="pinned", end="pinned", **more)


def on_soil(n, k):
    """Speed at which a pinned pipe on a foundation buckles in n half waves."""
    return n * PI * np.sqrt(1.0 + k / (n * PI) ** 4)


@pytest.mark.parametrize("make", MODELS, ids=NAMES)
@pytest.mark.parametrize(("beta", "k"), [(0.1, 375.0), (0.6, 350.0), (0.3, 1000.0), (0.9, 40.0)])
def test_a_pinned_pipe_on_a_foundation_buckles_at_the_first_of_its_half_waves(make, beta, k):
    found = pp.critical_speed(make(pinned(beta, terms=(pp.Foundation(k),))))
    first = min((1, 2, 3, 4), key=lambda n: on_soil(n, k))
    assert (found.kind, found.mode) == ("divergence", first)
    # Of a chain discretisation is the distance; it is of second order in the segment's length.
    error = found.error if not isinstance(found.model, pp.Chain) else 2.5e-3
    assert found.speed == pytest.approx(on_soil(first, k), abs=error + 1e-9)


def test_hardly_any_fluid_mass_leaves_a_held_pipe_its_divergences():
    """It is conservative: nothing need be extrapolated from stronger gyroscopic forces."""
    found = pp.crossings(pp.Continuum(pinned(3e-13, terms=(pp.Foundation(351.267),))), 17.0)
    expected = sorted(on_soil(n, 351.267) for n in range(1, 6))
    assert {one.kind for one in found} == {"divergence"}
    np.testing.assert_allclose([one.speed for one in found], expected, rtol=1e-11)


@pytest.mark.parametrize("k", [0.0, 250.0, 500.0, 750.0, 800.0, 1300.0, 2000.0])
def test_no_range_between_two_divergences_is_missed_however_short(k):
    """By the stiffness of finite elements, an eigenproblem in u^2."""
    soil = [("Foundation", {"stiffness": k})]
    system = elements({"beta": 0.3, "end": "clamped", "terms": soil}, 20.0, 4)
    speeds = [one.speed for one in divergences(system, 12.0)]
    pipe = pp.Pipe(0.3, end="clamped", terms=(pp.Foundation(k),))
    found = [c for c in pp.crossings(pp.Continuum(pipe), 12.0) if c.kind == "divergence"]
    np.testing.assert_allclose([c.speed for c in found], speeds, rtol=1e-9)
    first = pp.critical_speed(pp.Continuum(pipe))
    assert abs(first.speed - found[0].speed) <= first.error + found[0].error


def test_gyroscopic_forces_alone_hold_a_pipe_whose_stiffness_is_indefinite():
    """Any damping undoes that (Kelvin, Tait and Chetaev)."""
    pipe = pp.Pipe(0.3, end="clamped", terms=(pp.Foundation(800.0),))
    found = pp.crossings(pp.Continuum(pipe), 12.0)
    assert [(c.kind, c.unstable_after, c.gyroscopic) for c in found] == [
        ("divergence", 1, False),
        ("divergence", 0, True),
        ("flutter", 2, True),
    ]
    assert "gyroscopic=True" in repr(found[1])
    damped = pp.Pipe(0.3, end="clamped", damping=1e-5, terms=(pp.Foundation(800.0),))
    between = 0.5 * (found[1].speed + found[2].speed)
    after = [c.unstable_after for c in pp.crossings(pp.Continuum(damped), between)]
    assert after[-1] == 2
    assert not any(c.gyroscopic for c in pp.crossings(pp.Continuum(damped), between))


def test_a_pipe_unstable_at_rest_is_told_so_first():
    found = pp.critical_speed(pp.Continuum(pp.Pipe(0.1, -10.0)))
    first = repr(found).split("speed=")[0]
    assert "stable_at_rest=False" in first
    assert "stable_from=1.797" in first
    growth = [
        pp.eigenvalues(pp.Continuum(pp.Pipe(0.1, -10.0)), found.stable_from + d, 4).real.max()
        for d in (-1e-4, 1e-4)
    ]
    assert growth[0] > 0.0 > growth[1]
    assert "stable_at_rest" not in repr(pp.critical_speed(pp.Continuum(pp.Pipe(0.2))))


def test_static_and_oscillating_roots_with_hysteresis_are_counted_together():
    guided = pp.Chain(pp.Pipe(0.2, hysteresis=0.05, end="guided"), 40)
    assert pp.critical_speed(guided).speed == pytest.approx(3.140785, abs=1e-6)
    fluid = pp.Pipe(5e-4, hysteresis=0.1, root="pinned", terms=(pp.Viscosity(0.8),))
    counts = [
        (c.unstable_before, c.unstable_after)
        for c in pp.crossings(pp.Galerkin(fluid, 24, "legendre"), 10.0)
    ]
    assert counts[0][0] == 0
    assert min(min(pair) for pair in counts) >= 0
    standing = pp.Pipe(1.1e-3, -20.0, hysteresis=0.1)
    found = pp.crossings(pp.Continuum(standing), 7.0)
    # Where the static root comes back the pair is there that it is with hysteresis.
    assert [(c.kind, c.unstable_before, c.unstable_after) for c in found] == [("divergence", 1, 2)]
    assert found[0].speed == pytest.approx(3.0477, abs=5e-5)
    values = pp.eigenvalues(pp.Continuum(standing), 4.0, 4)
    assert np.abs(values - (3.406 + 6.400j)).min() < 1e-3
    values = pp.eigenvalues(pp.Continuum(standing), 2.9, 4)  # 1.49 + 0.36i is its real root again
    assert [(v.real > 0, v.imag == 0) for v in values if v.real > 0] == [(True, True)]


def test_every_mode_of_a_weakly_damped_aspirating_pipe_is_counted():
    pipe = pp.Pipe(0.946029, 23.0036, flow="aspirating", alpha=0.0, damping=1.20532e-6)
    found = pp.crossings(pp.Continuum(pipe), 20.0)
    assert len(found) == 29
    assert found[-1].unstable_after == 58
    assert found[-1].vouched >= 58


@pytest.mark.parametrize(
    "model",
    [
        lambda pipe: pp.Chain(pipe, 10),
        lambda pipe: pp.Chain(pipe, 20),
        lambda pipe: pp.Chain(pipe, 40),
        lambda pipe: pp.Galerkin(pipe, 10),
        lambda pipe: pp.Galerkin(pipe, 16, "legendre"),
        pp.Continuum,
    ],
)
@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_heavy_tip_mass_lets_the_critical_speed_fall_by_its_square_root(model):
    """u sqrt(M) is a power series in 1 / M, of which masses that hide nothing give two terms."""
    found = [
        pp.critical_speed(model(pp.Pipe(0.2, terms=[pp.PointMass(at=1.0, mass=mass)])))
        for mass in (90.0, 900.0, 9000.0)
    ]
    light, medium, heavy = (
        one.speed * math.sqrt(mass) for one, mass in zip(found, (90.0, 900.0, 9e3), strict=True)
    )
    rounding = 100.0 * found[2].error  # of modes at rest, by a machine's linear algebra
    assert rounding <= 1e-4
    assert heavy == pytest.approx(medium + (medium - light) * 0.1, abs=1e-5 * heavy + rounding)
    assert found[2].error < 1e-3 * found[2].speed
    assert {one.kind for one in found} == {"flutter"}


def test_roots_at_rest_move_as_an_open_inlet_moves_them():
    """Where all of the fluid's momentum is drawn in across, growth is of third order in u."""
    chain = pp.Chain(pp.Pipe(0.04, 24.5, flow="aspirating", inflow_share=0.0), 7)
    growth = [np.max(pp.eigenvalues(chain, u, 2).real) for u in (0.1, 0.2)]
    assert growth[1] / growth[0] == pytest.approx(8.0, rel=0.02)
    assert [c.mode for c in pp.crossings(chain, 5.0)] == [1]


def test_a_search_may_end_between_its_first_two_divergences():
    """Just short of the second, which is looked for a little beyond the end."""
    model = pp.Continuum(pp.Pipe(0.3, supports=np.arange(1, 10) / 10.0))
    first, second = [c for c in pp.crossings(model, 36.0) if c.kind == "divergence"][:2]
    for end in (second.speed * (1.0 - 5e-5), second.speed * (1.0 + 5e-5)):
        assert pp.critical_speed(model, end).speed == pytest.approx(first.speed, rel=1e-12)
    with pytest.raises(pp.NoCrossing):
        pp.critical_speed(model, first.speed * (1.0 - 5e-5))


def clamped_loads(limit):
    """Wave numbers up to a limit at which a pipe clamped at both ends buckles, in order."""
    even = [2.0 * math.pi * k for k in range(1, math.ceil(limit))]
    odd = [
        2.0
        * brentq(
            lambda x: math.sin(x) - x * math.cos(x), k * math.pi + 1e-9, (k + 0.5 - 1e-12) * math.pi
        )
        for k in range(1, math.ceil(limit))
    ]
    return [load for load in sorted(even + odd) if load <= limit]


@pytest.mark.parametrize(("alpha", "end"), [(1.0, 20.0), (100.0, 3.0)])
def test_a_strong_thrust_reaches_as_many_modes_as_eulers_loads_say(alpha, end):
    found = pp.crossings(pp.Continuum(pp.Pipe(0.2, alpha=alpha, end="clamped")), end)
    speeds = [one.speed for one in found if one.kind == "divergence"]
    expected = np.array(clamped_loads(end * math.sqrt(alpha))) / math.sqrt(alpha)
    np.testing.assert_allclose(speeds, expected, rtol=1e-10)


def test_a_compressed_pipe_buckles_at_rest_in_as_many_modes_as_eulers_loads_say():
    pipe = pp.Pipe(0.3, end="clamped", terms=[pp.Tension(-5000.0)])
    found = pp.crossings(pp.Continuum(pipe), 6.0)
    loads = len(clamped_loads(math.sqrt(5000.0)))
    assert found.unstable_at_rest == loads == 21
    speeds = [one.speed for one in found if one.kind == "divergence"]
    expected = [math.sqrt(one**2 - 5000.0) for one in clamped_loads(math.sqrt(5036.0))[loads:]]
    np.testing.assert_allclose(speeds, expected, rtol=1e-8)


def test_a_strong_thrust_makes_all_modes_flutter_that_a_large_basis_shows():
    """A nozzle's jet acts as flow that is faster by the root of its coefficient."""
    pipe = pp.Pipe(0.3, alpha=25.0)
    found = pp.crossings(pp.Continuum(pipe), 12.0)
    alone = pp.crossings(pp.Galerkin(pipe, 64, "legendre"), 12.0)
    assert len(found) == 9
    np.testing.assert_allclose([c.speed for c in found], [c.speed for c in alone], rtol=1e-9)
