# SPDX-License-Identifier: MIT
"""Springs, dampers and inertia of rotation against routes of their own, in what models answer."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq, root

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


# -------------------------------------------------------- onset of flutter by exponentials, beta .2


def onset_by_exponentials(beta, speed, frequency, j=0.0, at=1.0, m=0.0, inertia=0.0, k=0.0, c=0.0):
    """Speed and frequency at which four exponentials on either side of a place meet all conditions.

    w'''' + u^2 w'' + 2 sqrt(beta) u w_dot' + w_ddot - j w_ddot'' = 0, clamped and free. At the
    place w'' jumps by (inertia lambda^2 + c lambda + k) w' and w''' by -m lambda^2 w.
    """

    def determinant(unknowns):
        u, value = unknowns[0], 1j * unknowns[1]
        a = np.roots([1.0, 0.0, u**2 - j * value**2, 2.0 * math.sqrt(beta) * u * value, value**2])

        def derivative(order, s):
            return a**order * np.exp(a * s)

        turned, pushed = inertia * value**2 + c * value + k, m * value**2
        free = [derivative(2, 1.0), -derivative(3, 1.0) + j * value**2 * derivative(1, 1.0)]
        if at == 1.0:
            free[0] = free[0] + turned * derivative(1, 1.0)
            free[1] = free[1] + pushed * derivative(0, 1.0)
            rows = np.array([derivative(0, 0.0), derivative(1, 0.0), *free])
        else:
            below = [derivative(order, at) for order in range(4)]
            jumps = [0.0, 0.0, turned * below[1], -pushed * below[0]]
            rows = np.zeros((8, 8), complex)
            rows[0, :4], rows[1, :4] = derivative(0, 0.0), derivative(1, 0.0)
            for order in range(4):
                rows[2 + order, :4] = -below[order] - jumps[order]
                rows[2 + order, 4:] = below[order]
            rows[6, 4:], rows[7, 4:] = free
        scaled = np.linalg.det(rows / np.abs(rows).max(axis=0))
        return scaled.real, scaled.imag

    found = root(determinant, [speed, frequency], tol=1e-13)
    return found.x


ONSETS = [
    (pp.PointMass(1.0, 0.1, 0.01), {"at": 1.0, "m": 0.1, "inertia": 0.01}, 2.20144358, 13.0454096),
    (pp.PointMass(0.5, 0.2, 0.02), {"at": 0.5, "m": 0.2, "inertia": 0.02}, 5.25526043, 11.9179253),
    (pp.RotationalSpring(0.5, 2.0), {"at": 0.5, "k": 2.0}, 5.89066738, 13.3207061),
    (pp.RotationalDamper(0.5, 0.1), {"at": 0.5, "c": 0.1}, 5.54833932, 13.3511800),
    (None, {"j": 0.001}, 5.53735807, 13.6765910),
]
"""Terms, or the rotary inertia 0.001 of cross-sections, with speed and frequency of the onset."""


def pipe_with(term):
    own = {"rotary_inertia": 0.001} if term is None else {"terms": [term]}
    return pp.Pipe(0.2, **own)


@pytest.mark.parametrize(("term", "law", "speed", "frequency"), ONSETS, ids=str)
def test_flutter_begins_where_a_determinant_of_exponentials_vanishes(term, law, speed, frequency):
    exact = onset_by_exponentials(0.2, speed, frequency, **law)
    assert exact == pytest.approx([speed, frequency], rel=5e-9)
    pipe = pipe_with(term)
    for model in (pp.Continuum(pipe), pp.Galerkin(pipe, 24, "legendre")):
        found = pp.critical_speed(model)
        assert (found.speed, found.frequency) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(("term", "law", "speed", "frequency"), ONSETS, ids=str)
def test_chains_tend_to_it_with_the_second_order_inside_and_the_first_at_the_end(
    term, law, speed, frequency
):
    """At the end the body turns with the last segment, whose angle is that half of it before."""
    errors = [
        abs(pp.critical_speed(make(pipe_with(term), n)).speed - speed)
        for make, n in ((pp.Chain, 27), (pp.Chain, 81), (pp.modular.chain, 27))
    ]
    order = math.log(errors[0] / errors[1]) / math.log(3.0)
    expected = 1.0 if term is not None and term.at == 1.0 else 2.0
    assert order == pytest.approx(expected, abs=0.1)
    assert errors[1] < (0.03 if expected == 1.0 else 0.002)
    assert errors[2] == pytest.approx(errors[0], rel=1e-9)


def test_a_small_body_at_the_end_halves_the_load_of_becks_column():
    """Of a plain column u^2 is printed as 20.05 (Beck 1952)."""
    plain, loaded = (
        pp.critical_speed(pp.Continuum(pp.Pipe(0.0, terms=terms))).speed ** 2
        for terms in ([], [pp.PointMass(1.0, 0.1, 0.01)])
    )
    assert plain == pytest.approx(20.05, abs=0.005)
    assert loaded == pytest.approx(13.66670, abs=6e-6)


def test_a_strong_rotational_spring_in_the_middle_lets_the_pipe_diverge():
    """Without gravity and springs a pipe with a free end never does."""
    found = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, terms=[pp.RotationalSpring(0.5, 200.0)])))
    assert (found.kind, found.frequency) == ("divergence", 0.0)
