# SPDX-License-Identifier: MIT
"""Springs, dampers and inertia of rotation against routes of their own, in what models answer."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

import pipedyn as pp

PLACE, BETA, U = 0.4, 0.3, 2.5
TERMS = [
    pp.RotationalSpring(PLACE, 6.0),
    pp.RotationalDamper(PLACE, 0.3),
    pp.PointMass(PLACE, 0.2, 0.03),
]


@pytest.mark.parametrize(
    ("held", "limit"),
    [
        ({}, {"end": "guided"}),
        ({"end": "pinned"}, {"end": "clamped"}),
        ({"root": "pinned", "end": "pinned"}, {"root": "pinned", "end": "clamped"}),
    ],
    ids=str,
)
@pytest.mark.parametrize("kind", [pp.Continuum, lambda pipe: pp.Galerkin(pipe, 12, "legendre")])
def test_a_stiff_spring_at_an_end_keeps_its_direction(kind, held, limit):
    stiff = kind(pp.Pipe(BETA, 5.0, **held, terms=[pp.RotationalSpring(1.0, 1e9)]))
    expected = kind(pp.Pipe(BETA, 5.0, **limit))
    for u in (0.0, U):
        found, exact = (pp.eigenvalues(model, u, count=4) for model in (stiff, expected))
        np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-6)
    assert pp.critical_speed(stiff).speed == pytest.approx(
        pp.critical_speed(expected).speed, rel=1e-6
    )


@pytest.mark.parametrize(("mass", "inertia"), [(0.3, 0.0), (0.4, 0.05)])
def test_frequencies_of_a_cantilever_with_a_body_at_its_end_are_the_textbooks(mass, inertia):
    """Blevins, Formulas for Natural Frequency and Mode Shape: omega = k^2."""

    def characteristic(k):
        c, s, tanh, one = math.cos(k), math.sin(k), math.tanh(k), 1.0 / math.cosh(k)
        with_mass = one + c + mass * k * (c * tanh - s)
        return with_mass - inertia * k**3 * (s + tanh * c) + mass * inertia * k**4 * (one - c)

    k = np.linspace(0.5, 20.0, 400)
    sign = np.array([characteristic(x) for x in k]) > 0.0
    roots = [
        brentq(characteristic, k[i], k[i + 1], xtol=1e-14)
        for i in np.flatnonzero(sign[1:] != sign[:-1])
    ]
    pipe = pp.Pipe(0.2, terms=[pp.PointMass(1.0, mass, inertia)])
    found = pp.eigenvalues(pp.Continuum(pipe), 0.0, 10)
    omega = np.sort(found.imag[found.imag > 0.0])
    np.testing.assert_allclose(omega, np.square(roots[:5]), rtol=1e-10)


def in_the_middle(term):
    """The term in the middle of a segment of chains of 3, 9, 27 segments, where angles agree."""
    return dataclasses.replace(term, at=0.5)


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_models_agree_on_what_large_motions_do_with_it(term):
    """Onset, cycle and its growth of a long chain and of both bases."""
    pipe = pp.Pipe(0.2, 5.0, damping=0.01, terms=[in_the_middle(term)])
    exact = pp.hopf(pp.Galerkin(pipe, 12, "legendre"))
    for model, within in ((pp.Chain(pipe, 27), 0.02), (pp.Galerkin(pipe, 10), 0.03)):
        found = pp.hopf(model)
        assert found.criticality == exact.criticality
        assert found.crossing.speed == pytest.approx(exact.crossing.speed, rel=within)
        assert found.amplitude_law == pytest.approx(exact.amplitude_law, rel=4.0 * within)


def number_of(term):
    """Name and size of its number of rotation."""
    names = {pp.PointMass: "inertia", pp.RotationalSpring: "stiffness"}
    name = names.get(type(term), "coefficient")
    return f"{type(term).__name__}.{name}", getattr(term, name)


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_questions_about_small_motions_feel_it(term):
    pipe = pp.Pipe(0.2, 5.0, damping=0.01, terms=[term])

    def onset(gamma):
        return pp.critical_speed(pp.Continuum(dataclasses.replace(pipe, gamma=gamma))).speed

    found = pp.critical_speed(pp.Galerkin(pipe, 24, "legendre")).sensitivity.speed.gamma
    assert found == pytest.approx((onset(5.01) - onset(4.99)) / 0.02, rel=1e-4)
    assert pp.relevant(pipe, U)[repr(term)].verdict == "relevant"
    middle = dataclasses.replace(pipe, terms=[in_the_middle(term)])
    exact, chain = (
        pp.frequency_response(model, U, [3.0, 11.0, 30.0]).response
        for model in (pp.Continuum(middle), pp.Chain(middle, 81))
    )
    np.testing.assert_allclose(chain, exact, rtol=0.01)


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_its_number_is_found_again_from_what_the_pipe_shows(term):
    name, size = number_of(term)
    pipe = pp.Pipe(0.2, 5.0, damping=0.01, terms=[term])
    roots = pp.eigenvalues(pp.Continuum(pipe), 0.0, count=4)
    roots = sorted((root for root in roots if root.imag > 0.0), key=abs)
    seen = [
        pp.Measurement("frequency", root.imag, 1e-4, mode=mode)
        for mode, root in enumerate(roots, start=1)
    ] + [
        pp.Measurement("decrement", -2 * np.pi * root.real / root.imag, 1e-4, mode=mode)
        for mode, root in enumerate(roots, start=1)
    ]
    guess = dataclasses.replace(term, **{name.split(".")[1]: 0.7 * size})
    found = pp.identify(dataclasses.replace(pipe, terms=[guess]), seen, (name,))
    assert found.values == pytest.approx([size], rel=1e-5)


HELD = {"root": "pinned", "end": "pinned", "supports": (0.5,)}


@pytest.mark.parametrize("term", TERMS, ids=str)
@pytest.mark.parametrize("place", [0.5, 1.0])
def test_a_pipe_turns_against_it_where_it_is_held_across(term, place):
    """Chains converge at first order there, as the segment before the support turns."""
    pipe = pp.Pipe(0.2, 5.0, **HELD, terms=[dataclasses.replace(term, at=place)])
    exact, plain = (
        pp.eigenvalues(pp.Continuum(one), 2.0, count=4)
        for one in (pipe, dataclasses.replace(pipe, terms=()))
    )
    assert np.abs(exact - plain).max() > 0.01 * np.abs(plain).max()
    reduced = pp.eigenvalues(pp.Galerkin(pipe, 24, "legendre"), 2.0, count=4)
    np.testing.assert_allclose(reduced, exact, rtol=1e-8)
    coarse, fine = (pp.eigenvalues(pp.Chain(pipe, n), 2.0, count=4) for n in (80, 160))
    np.testing.assert_allclose(2.0 * fine - coarse, exact, rtol=0.005)


@pytest.mark.parametrize("kind", [lambda p: pp.Chain(p, 13), lambda p: pp.Galerkin(p, 5)])
def test_a_standing_pipe_rests_where_its_spring_holds_it(kind):
    """A soft spring leaves the buckled rest, a stiff one leaves none but the straight pipe."""
    bent, straight = (
        pp.equilibria(kind(pp.Pipe(0.2, -12.0, terms=[pp.RotationalSpring(0.5, k)])), 0.0)
        for k in (0.2, 20.0)
    )
    assert len(bent.q) > 1
    assert len(straight.q) == 1
