# SPDX-License-Identifier: MIT
"""Rotary inertia J of cross-sections: E w'''' + ... + w_ddot - J w_ddot'' = 0, and at any angle."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent import quadratic_eigenvalues, series_newton_step

import pipedyn as pp

BETA, J = 0.2, 0.01
THICK = pp.Pipe(BETA, rotary_inertia=J)
RICH = pp.Pipe(
    *(0.3, 4.0),
    drag=0.5,
    damping=0.01,
    rotary_inertia=0.05,
    terms=[pp.PointMass(0.6, 0.2), pp.AddedMass(0.4), pp.Spring(1.0, 2.0)],
)


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_eigenvalues_are_those_of_power_series(basis):
    pipe = replace(THICK, damping=1e-3)
    values = pp.eigenvalues(pp.Galerkin(pipe, 24, basis), 4.0, 6)
    for value in values[values.imag > 0.0]:
        exact = value + series_newton_step(pipe, value, 4.0)
        assert value == pytest.approx(exact, rel=1e-9 if basis == "legendre" else 1e-3)


@pytest.mark.parametrize("of", [pp.Chain, pp.modular.chain])
def test_segments_turn_as_with_larger_radii_of_gyration(of):
    """Those, which users may give, are checked against a Lagrangian."""
    n, random = 4, np.random.default_rng(0)
    own = np.full(n, 1.0 / (n * math.sqrt(12.0)))
    model = of(RICH, n)
    given = of(
        replace(RICH, rotary_inertia=0.0),
        n,
        gyration_radii=np.sqrt(own**2 + RICH.rotary_inertia),
    )
    y = random.normal(size=2 * n)
    if of is pp.Chain:
        assert model.rhs(0.0, y, 3.0) == pytest.approx(given.rhs(0.0, y, 3.0), rel=1e-12)
        assert model.energy(y) == pytest.approx(given.energy(y), rel=1e-14)
    for one, other in zip(
        vars(model.operators()).values(), vars(given.operators()).values(), strict=True
    ):
        assert one is None or one == pytest.approx(other, abs=1e-14)


def test_supports_hold_it_and_a_pinned_pipe_has_the_frequencies_of_a_textbook():
    """Of a simply supported Rayleigh beam omega_k^2 = (k pi)^4 / (1 + J (k pi)^2)."""
    pipe = replace(THICK, root="pinned", end="pinned")
    waves = np.pi * np.arange(1.0, 4.0)
    expected = waves**2 / np.sqrt(1.0 + J * waves**2)
    for model, error in (
        (pp.Continuum(pipe), 1e-10),
        (pp.Galerkin(pipe, 8), 1e-10),
        (pp.Chain(pipe, 60), 1e-2),
    ):
        values = pp.eigenvalues(model, 0.0, 6)
        assert values.imag[values.imag > 0.0] == pytest.approx(expected, rel=error)
    state = pp.simulate(pp.Galerkin(pipe, 6), 2.0, 1.0, lambda s: 0.3 * np.cos(np.pi * s))
    assert state.audit < 1e-5


def test_linear_operators_are_those_of_small_motions_about_any_configuration():
    model = pp.Galerkin(RICH, 6, "legendre")
    for q in (np.zeros(6), 0.2 * np.sin(np.arange(6.0))):
        operators = model.operators(q)
        y = np.concatenate([q, np.zeros(6)])
        slopes = model.jacobian(0.0, y, 0.0)
        found = np.linalg.solve(operators.mass, -operators.damping)
        assert slopes[6:, 6:] == pytest.approx(found, rel=1e-8, abs=1e-8)
    values = pp.eigenvalues(model, 3.0, 12)
    dense = quadratic_eigenvalues(*model.operators().at(3.0))
    for value in values[:6]:
        assert np.abs(dense - value).min() < 1e-8 * abs(value)


def test_all_that_treats_numbers_alike_knows_it():
    assert "rotary inertia" not in {one.name for one in pp.relevant(pp.Pipe(BETA), 5.0).effects}
    hose = pp.Pipe.from_si(
        length=2.0, bending_stiffness=4.0, pipe_mass=3.0, fluid_mass=1.0, rotary_inertia=0.16
    )
    assert hose.rotary_inertia == pytest.approx(0.01, rel=1e-15)
    curve = pp.boundary(
        *(pp.Galerkin(THICK, 6), "rotary_inertia", "u"),
        {"rotary_inertia": (0.0, 0.02), "u": (4.0, 7.0)},
    )
    for one in curve.curves:
        k = len(one.x) // 2
        pipe = replace(THICK, rotary_inertia=float(one.x[k]))
        speeds = [crossing.speed for crossing in pp.crossings(pp.Galerkin(pipe, 6), 8.0).crossings]
        assert min(abs(speed - one.y[k]) for speed in speeds) < 1e-8
    assert curve.curves
