# SPDX-License-Identifier: MIT
"""What no single argument shows: sizes that do not fit together, absurd ones, whole messages.

Each argument of each public call is given what it must not take in `test_fuzz.py`.
"""

import math
import reprlib
from fractions import Fraction
from functools import cache
from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest

import pipedyn as pp

PIPE = pp.Pipe(0.2)
FED = pp.Pipe(0.2, flow="aspirating", damping=0.01)
CHAIN = pp.Chain(PIPE, 3)
ROM = pp.Galerkin(PIPE, 3)
EXACT = pp.Continuum(PIPE)

NAN, INF = math.nan, math.inf


@cache
def long_chain():
    return pp.Chain(PIPE, 100_000)


SI = {"length": 1.0, "bending_stiffness": 1.0, "pipe_mass": 1.0, "fluid_mass": 1.0}


CASES = [
    # Pipe
    *(
        ("from_si", getattr(PIPE, f"{number}{way}"), 1.0)
        for number in ("speed", "time", "frequency", "length")
        for way in ("_si", "_from_si")
    ),
    # end_coefficient
    ("velocity", lambda v: pp.end_coefficient(v, radii=[0, 1], areas=[1, 1]), [1.0, 1.0]),
    *(("velocity", lambda v: pp.end_coefficient(v), v) for v in [1.0, [1.0, 2.0], "fast"]),
    *(
        ("radii", lambda v: pp.end_coefficient([1.0] * 3, radii=v), v)
        for v in [[0.1, 0.2, 0.3], [0.0, 0.2, 0.2], None]
    ),
    ("radii", lambda v: pp.end_coefficient([1.0], radii=v), [0.0]),
    ("radii", lambda v: pp.end_coefficient([1.0] * 2, radii=v, areas=[1.0, 1.0]), [0.0, 1.0]),
    ("radii", lambda v: pp.end_coefficient(lambda r: 1.0, radii=v), [0.0, 1.0]),
    ("areas", lambda v: pp.end_coefficient(lambda r: 1.0, areas=v), [1.0, 1.0]),
    # Chain
    ("n", lambda v: pp.Chain(PIPE), None),
    *(("n", lambda v: pp.Chain(PIPE, v), v) for v in [10**12, 10**400]),
    ("lengths", lambda v: pp.Chain(PIPE, 3, lengths=v), [0.5, 0.5]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v), [0.5, 0.6]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v, base=0.1), [0.5, 0.5]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v, springs="midpoint"), [0.5, 0.5]),
    ("centres", lambda v: pp.Chain(PIPE, 2, centres=v, gyration_radii=[0.1, 0.0]), [0.5, 0.0]),
    ("base", lambda v: pp.Chain(PIPE, 3, springs="midpoint", base=v), 0.1),
    # what models answer
    *(("angle", model.bent, lambda s: 1e7 * s) for model in (CHAIN, ROM)),
    *(
        ("q", lambda v, model=model: model.deflection(v, [0.5]), v)
        for model in (CHAIN, ROM)
        for v in [np.zeros((3, 1, 1)), np.zeros((3, 0)), np.broadcast_to(0.0, (3, 10**9))]
    ),
    ("q", ROM.tip, [0.0, 0.0, 500.0]),
    ("s", lambda v: pp.Galerkin(PIPE, 2000).functions(v), np.linspace(0.0, 1.0, 60_000)),
    # questions
    *(
        case
        for question in (pp.eigenvalues, pp.modes)
        for case in [
            ("count", lambda v, f=question: f(CHAIN, 1.0, v), 7),
            ("count", lambda v, f=question: f(EXACT, 1.0, v), None),
            ("count", lambda v, f=question: f(long_chain(), 1.0, v), None),
            ("count", lambda v, f=question: f(long_chain(), 1.0, v), 60_000),
        ]
    ),
    *(
        ("count", lambda v, f=f: f(pp.Chain(PIPE, 10**6), v), 11)
        for f in (lambda c, v: pp.modes(c, 1.0, v), lambda c, v: pp.root_loci(c, [1.0], v))
    ),
    ("speeds", lambda v: pp.root_loci(CHAIN, v, 2), [1.0, 1.0]),
    ("count", lambda v: pp.root_loci(CHAIN, [0.0, 1.0], v), 4),
    ("count", lambda v: pp.root_loci(EXACT, [0.0, 1.0], v), 401),
    ("speeds", lambda v: pp.root_loci(EXACT, v, 2), [0.0, 1001.0]),
    *(
        case
        for question in (pp.crossings, pp.critical_speed)
        for case in [
            ("model", lambda v, f=question: f(v, 5.0), pp.Chain(FED, 2001)),
            ("model", lambda v, f=question: f(v, 5.0), pp.Chain(PIPE, 10**6)),
            ("max_speed", lambda v, f=question: f(EXACT, v), 1001.0),
        ]
    ),
    ("values", lambda v: pp.stability_curve(lambda b: CHAIN, v), 0.2),
    (
        *("executor", lambda v: pp.stability_curve(lambda b: CHAIN, [0.1], executor=v)),
        type("Name", (), {"submit": 3})(),
    ),
]


def label(value):
    if isinstance(value, int) and value.bit_length() > 1e4:
        return "more digits than Python prints"
    return reprlib.repr(value)


def must_refuse(call, value):
    call(value)
    pytest.fail(f"{label(value)} was accepted")


GROUPS = [(name, list(cases)) for name, cases in groupby(CASES, key=itemgetter(0))]
"""Neighbours that spoil one argument are one test: to collect thousands takes seconds."""


@pytest.mark.parametrize(("name", "cases"), GROUPS, ids=[name for name, _ in GROUPS])
def test_a_bad_argument_is_refused_by_name(name, cases):
    for _, call, value in cases:
        with pytest.raises((ValueError, TypeError), match=rf"\b{name}\b") as caught:
            must_refuse(call, value)
        assert type(caught.value) in (ValueError, TypeError), label(value)
        assert len(str(caught.value)) < 300, label(value)
        assert "\n" not in str(caught.value), label(value)


def converged(**given):
    return EXACT.converge(lambda rom: 0.0, lambda a, b: abs(a - b), **given)


MASKED = np.ma.array([0.5, 0.5, 0.5], mask=[0, 1, 0])
IMAGINARY_NAN = np.array([0.0, complex(1.0, NAN), 0.0])


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pp.Pipe(1.2), "beta must lie in [0, 1), got 1.2"),
        (lambda: pp.Pipe(10**5000), "beta must lie in [0, 1), got <int>"),
        (
            lambda: pp.Pipe(np.timedelta64(0)),
            f"beta must be a real number, got {np.timedelta64(0)!r}",
        ),
        (
            lambda: pp.Pipe.from_si(**SI | {"pipe_mass": 1e-30}),
            "beta from pipe_mass and fluid_mass must lie in [0, 1), got 1.0",
        ),
        (
            lambda: pp.Pipe.from_si(**SI, gravity=1e12),
            "gamma from gravity, length, pipe_mass, fluid_mass and bending_stiffness must lie in "
            "[-1e+06, 1e+06], got 2000000000000.0",
        ),
        (
            lambda: pp.Pipe.from_si(**SI).speed_si([[1], [1, 2]]),
            "u must be a number or an array of numbers, got [[1], [1, 2]]",
        ),
        (
            lambda: pp.Pipe.from_si(**SI | {"bending_stiffness": 1e6}).speed_si(1e308),
            "u must be finite after conversion, got 1e+308",
        ),
        (
            lambda: pp.Pipe.from_si(**SI | {"length": 1e6}, gravity=0.0).speed_from_si(
                [1.0, 1e308]
            ),
            "V must be finite after conversion, got [1.0, 1e+308]",
        ),
        (
            lambda: pp.Chain(PIPE, springs=MASKED),
            "springs must not be masked, got 1 masked of 3 entries",
        ),
        (
            lambda: pp.Chain(PIPE, 3, springs=[1.0, -1.0, 1.0]),
            "springs must lie in [0, 1e+15], got -1.0 at index 1",
        ),
        (
            lambda: CHAIN.deflection([0.0, 0.0], [0.5]),
            "q must have shape (3, ...), got (2,)",
        ),
        (
            lambda: ROM.deflection(IMAGINARY_NAN, [0.5]),
            "q must be finite, got (1+nanj) at index 1",
        ),
        (
            lambda: CHAIN.deflection(np.array([[0, 1], [0, INF], [0, 0]]), [0.5]),
            "q must be finite, got inf at index (1, 1)",
        ),
        (
            lambda: CHAIN.deflection(np.zeros((3, 1, 1)), [0.5]),
            "q must have shape (3,) or (3, k), got (3, 1, 1)",
        ),
        (lambda: ROM.from_elastic(np.zeros((2, 3))), "z must have shape (3, ...), got (2, 3)"),
        (
            lambda: converged(smallest=5000),
            "smallest must be from 1 to 1992, got 5000",
        ),
        (lambda: converged(tolerance=NAN), "tolerance must be finite and > 0, got nan"),
        (
            lambda: EXACT.converge("speed", lambda a, b: 0.0),
            "question must be a function, got 'speed'",
        ),
    ],
)
def test_a_refusal_names_the_rule_and_what_came(call, message):
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    assert str(caught.value) == message


def test_absurd_sizes_are_refused_before_memory_is_asked_for():
    """A chain of a million segments is light; its dense matrices would not be."""
    chain = pp.Chain(PIPE, 10**6, springs="uniform")
    with pytest.raises(ValueError, match="4000"):
        chain.operators()
    with pytest.raises(ValueError, match="4000"):
        chain.elastic_operators()
    with pytest.raises(ValueError, match="lengths"):
        pp.Chain(PIPE, lengths=np.broadcast_to(1e-9, (10**9,)))
    with pytest.raises(ValueError, match="speeds"):
        pp.root_loci(CHAIN, np.broadcast_to(1.0, (10**9,)), 2)
    with pytest.raises(ValueError, match="s must"):
        CHAIN.shape(np.zeros(3), np.broadcast_to(1.0, (10**9,)))
    with pytest.raises(ValueError, match=r"^q and s must ask for at most 1000000000 numbers"):
        CHAIN.deflection(np.broadcast_to(0.0, (3, 10**5)), np.linspace(0.0, 1.0, 20_000))


def test_arguments_are_not_changed_and_not_kept_in_hand():
    springs = np.array([1.0, 2.0, 3.0])
    chain = pp.Chain(PIPE, springs=springs)
    springs[0] = 99.0
    np.testing.assert_array_equal(chain.springs, [1.0, 2.0, 3.0])


def test_whole_numbers_of_numpy_count_and_lists_are_arrays():
    assert pp.Chain(PIPE, np.int64(3)).dof == 3
    assert pp.Galerkin(PIPE, np.uint8(3)).dof == 3
    loci = pp.root_loci(CHAIN, [0, 1, 2], np.int32(2))
    assert loci.speeds.dtype == np.float64


def test_coordinates_of_small_displacements_may_be_lists_columns_and_complex():
    for model in (CHAIN, ROM):
        one = model.deflection([1, 0, 2], [0.5, 1.0])
        both = model.deflection([[1.0, 1j], [0.0, 0.0], [2.0, 2j]], [0.5, 1.0])
        np.testing.assert_allclose(both, np.stack([one, 1j * one], axis=1), rtol=1e-14)
        np.testing.assert_array_equal(
            model.from_elastic([1, 0, 2]), model.from_elastic(np.array([1.0, 0.0, 2.0]))
        )


def test_fractions_and_arrays_with_nothing_masked_are_numbers():
    assert pp.Pipe(Fraction(1, 4)).beta == 0.25
    thirds = [Fraction(1, 4), Fraction(1, 4), Fraction(1, 2)]
    np.testing.assert_array_equal(pp.Chain(PIPE, lengths=thirds).lengths, [0.25, 0.25, 0.5])
    whole = np.ma.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(pp.Chain(PIPE, springs=whole).springs, [1.0, 2.0, 3.0])
    assert pp.Pipe.from_si(**SI).speed_si(Fraction(1, 2)) == 0.5


def test_negative_zero_is_zero():
    pipe = pp.Pipe(-0.0, gamma=-0.0, damping=-0.0)
    assert [math.copysign(1.0, x) for x in (pipe.beta, pipe.gamma, pipe.damping)] == [1.0] * 3


def test_springs_so_soft_that_their_squares_vanish_act_like_none():
    soft, none = (pp.Chain(PIPE, 3, springs=[k] * 3) for k in (1e-300, 0.0))
    np.testing.assert_allclose(
        soft.elastic_operators().at(1.0), none.elastic_operators().at(1.0), atol=1e-200
    )


def test_an_error_of_the_package_without_a_message_prints_nothing():
    assert str(pp.PipedynError()) == ""


def test_a_shape_at_many_points_is_drawn_in_pieces():
    q, s = [0.3, -0.1, 0.05], np.linspace(0.0, 1.0, 20_001)
    every = ROM.shape(q, s)
    np.testing.assert_allclose(every[::5000], ROM.shape(q, s[::5000]), rtol=0.0, atol=1e-14)
