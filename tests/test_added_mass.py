# SPDX-License-Identifier: MIT
"""A pipe in a dense fluid: identities, published numbers and motions of any amplitude.

Virtual work against Lagrange's equations, energy, Jacobian and operators are in test_terms.py.
"""

import dataclasses
import math

import numpy as np
import pytest
from independent import any_chain, companion_eigenvalues

import pipedyn as pp
from pipedyn import modular

MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 7),
    "scene": lambda pipe: modular.chain(pipe, 5),
    "beam modes": lambda pipe: pp.Galerkin(pipe, 6),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 8, "legendre"),
    "continuum": pp.Continuum,
}
models = pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)


def scaled(pipe, chi):
    """The pipe whose own mass stands for the fluid's as well, and the unit of its time."""
    root = math.sqrt(1.0 + chi)
    terms = [
        pp.Viscosity(term.sigma / root) for term in pipe.terms if not isinstance(term, pp.AddedMass)
    ]
    numbers = {"beta": pipe.beta / (1.0 + chi), "damping": pipe.damping / root}
    return dataclasses.replace(pipe, **numbers, terms=terms), root


@models
def test_small_motions_are_those_of_a_heavier_pipe_of_the_same_weight(make):
    chi = 0.5
    terms = [pp.Viscosity(0.2), pp.AddedMass(0.2), pp.AddedMass(0.3)]
    pipe = pp.Pipe(0.3, 10.0, damping=1e-3, terms=terms)
    heavier, root = scaled(pipe, chi)
    found, plain = pp.critical_speed(make(pipe)), pp.critical_speed(make(heavier))
    assert found.speed == pytest.approx(plain.speed, rel=1e-9)
    assert found.frequency * root == pytest.approx(plain.frequency, rel=1e-9)
    mine, its = (pp.eigenvalues(make(one), 5.0, count=4) for one in (pipe, heavier))
    np.testing.assert_allclose(root * mine, its, rtol=1e-9)


def test_a_pipe_pinned_at_both_ends_vibrates_in_the_fluid_as_a_heavier_one():
    """The frequencies at beta = 0.5 and u = 2 are Legendre's and Hermite elements', as printed."""
    pipe = pp.Pipe(0.75, terms=[pp.AddedMass(0.5)], root="pinned", end="pinned")
    for model in (pp.Galerkin(pipe, 12, "legendre"), pp.Continuum(pipe)):
        found = np.sort(np.abs(pp.eigenvalues(model, 2.0, count=4).imag))[::2]
        np.testing.assert_allclose(math.sqrt(1.5) * found, [7.45357311, 37.63213422], rtol=2e-9)


def test_a_pendulum_in_a_fluid_turns_as_a_heavier_one_at_any_angle():
    """One segment has no velocity along itself, so that chi adds to its inertia alone."""
    pipe = pp.Pipe(0.3, 6.0, damping=0.01, terms=[pp.AddedMass(0.8)])
    heavier, root = scaled(pipe, 0.8)
    wet, dry = pp.Chain(pipe, 1), pp.Chain(heavier, 1)
    y = np.array([[1.2, -2.0], [0.7, 1.5]])
    faster = y * [[1.0], [root]]
    found, expected = wet.rhs(0.0, y, 4.0)[1], dry.rhs(0.0, faster, 4.0)[1]
    # Coriolis force and damping are even in units of the time: u and the angles are the same.
    np.testing.assert_allclose(found * root**2, expected, rtol=1e-13)


@pytest.mark.parametrize("n", [1, 3, 12])
def test_products_and_eigenvalues_of_any_chain_are_those_of_its_matrices(n):
    chain = any_chain(n, gamma=3.0, damping=0.02, terms=[pp.AddedMass(0.9), pp.Spring(0.9, 5.0)])
    basis = np.tri(n) * chain.elastic_scale
    ours, dense = chain.elastic_operators(), chain.operators()
    for name in ("mass", "stiffness", "damping"):
        expected = basis.T @ getattr(dense, name) @ basis
        np.testing.assert_allclose(
            getattr(ours, name), expected, atol=1e-12 * np.abs(expected).max()
        )
    values = companion_eigenvalues(*dense.at(2.0))
    found = pp.eigenvalues(chain, 2.0)
    distance = np.abs(found[:, None] - values).min(axis=1)
    assert np.abs(distance).max() < 1e-9 * np.abs(values).max()


def test_the_fluid_changes_the_cycle_that_emerges_though_not_as_a_heavier_pipe():
    pipe = pp.Pipe(0.3, damping=2e-3, terms=[pp.AddedMass(0.5)])
    wet, dry = pp.Chain(pipe, 4), pp.Chain(scaled(pipe, 0.5)[0], 4)
    law = pp.hopf(wet)
    assert law.speed == pytest.approx(pp.hopf(dry).speed, rel=1e-10)
    assert abs(law.amplitude_law / pp.hopf(dry).amplitude_law - 1.0) > 0.01
