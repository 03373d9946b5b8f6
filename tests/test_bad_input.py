# SPDX-License-Identifier: MIT
"""Every public argument, given what it must not take: refused at once, by name."""

import math
import reprlib
from decimal import Decimal
from fractions import Fraction
from functools import cache
from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest
from scipy.integrate import simpson

import pipedyn as pp

PIPE = pp.Pipe(0.2)
CHAIN = pp.Chain(PIPE, 3)
ROM = pp.Galerkin(PIPE, 3)
EXACT = pp.Continuum(PIPE)

NAN, INF = math.nan, math.inf
NOT_NUMBERS = ["1", None, [1.0], 1j, True, np.bool_(False), {}, object(), Decimal("0.5")]
NOT_NUMBERS += [np.timedelta64(1), np.ma.masked, iter([1.0])]
NOT_FINITE = [NAN, INF, -INF, np.float64("nan"), 10**400, 10**5000, np.longdouble("1e4000")]
NOT_COUNTS = ["3", 3.0, 2.5, None, True, np.bool_(True), [3], 1j, NAN, np.timedelta64(3)]
NOT_FLAGS = [1, 0, "yes", None, 1.0]
COMPLEX = [1j, 2j]
NOT_ARRAYS = ["abc", ["a", "b"], COMPLEX, [True, False], {}, [None, 1.0], [[0.5], [0.5, 0.5]]]
NOT_ARRAYS += [np.ma.array([0.5, 0.5, 0.5], mask=[0, 1, 0]), [0.5, np.ma.masked, 0.5]]
NOT_ARRAYS += [[0.5, 0.5, np.True_], [Decimal(0), Decimal(1)], (i for i in range(3)), range(10**12)]
NOT_ARRAYS += [[[0.5] * 10**5] * 10**5, np.zeros(3, dtype=[("a", float)]), bytearray(b"123")]
NOT_MODELS = [None, "chain", 3, PIPE, pp.Chain, object()]


@cache
def long_chain():
    return pp.Chain(PIPE, 100_000)


SI = {"length": 1.0, "bending_stiffness": 1.0, "pipe_mass": 1.0, "fluid_mass": 1.0}


def real(name, call, below=(), above=(), missing=()):
    """Cases of a real argument: no number, not finite, out of range."""
    skip = [value for value in missing if value is None]
    for value in NOT_NUMBERS:
        if value is not None or not skip:
            yield name, call, value
    for value in (*NOT_FINITE, *below, *above):
        yield name, call, value


def count(name, call, low=(0, -1), high=(), optional=False):
    for value in NOT_COUNTS:
        if not (optional and value is None):
            yield name, call, value
    for value in (*low, *high):
        yield name, call, value


def array(name, call, size, bad=(), optional=False):
    """Cases of an array argument of a given size."""
    for value in NOT_ARRAYS:
        yield name, call, value
    if not optional:
        yield name, call, None
    good = np.full(size, 0.5)
    for number in (NAN, INF, -INF, *bad):
        wrong = good.copy()
        wrong[-1] = number
        yield name, call, wrong
    yield name, call, good.reshape(1, -1)
    yield name, call, np.zeros((2, 2))
    yield name, call, []


def converged(**given):
    return EXACT.converge(lambda rom: 0.0, lambda a, b: abs(a - b), **given)


def not_columns():
    """What must not stand for coordinates of small displacements of 3 degrees of freedom."""
    yield from (value for value in NOT_ARRAYS if value is not COMPLEX)
    for number in (NAN, INF, -INF, complex(0.0, NAN), complex(INF, 0.0)):
        yield np.array([0.0, 0.0, number])
        yield np.array([[0.0, 1.0], [0.0, 1.0], [0.0, number]])
    yield from (0.0, [], [0.0, 0.0], np.zeros((2, 3)), np.zeros((3, 0)), None)
    yield from ([0.0, 0.0, 0.0, 0.0], np.broadcast_to(0.0, (3, 10**9)))


CASES = [
    # Pipe
    *real("beta", lambda v: pp.Pipe(v), below=[-1e-9, -1], above=[1, 1.2]),
    *real("gamma", lambda v: pp.Pipe(0.2, gamma=v), above=[1e300]),
    *real("alpha", lambda v: pp.Pipe(0.2, alpha=v), below=[-0.1], above=[1e300]),
    *real("drag", lambda v: pp.Pipe(0.2, drag=v), below=[-0.1]),
    *real("damping", lambda v: pp.Pipe(0.2, damping=v), below=[-1e-12]),
    *real("hysteresis", lambda v: pp.Pipe(0.2, hysteresis=v), below=[-1e-12], above=[1e300]),
    *real("frequency", lambda v: pp.Pipe(0.2).equivalent_damping(v), below=[0.0, -1.0]),
    *(("flow", lambda v: pp.Pipe(0.2, flow=v), v) for v in ["", "Ejecting", "out", 1, None, True]),
    *(
        ("scales", lambda v: pp.Pipe(0.2, scales=v), v)
        for v in ["SI", 1.0, (1.0, 1.0), (1.0, 1.0, 1.0, NAN), (1.0, 1.0, 1.0, 0.0), [1, 1, 1, 1]]
    ),
    # Pipe.from_si
    *real("length", lambda v: pp.Pipe.from_si(**SI | {"length": v}), below=[0, -1], above=[1e200]),
    *real("bending_stiffness", lambda v: pp.Pipe.from_si(**SI | {"bending_stiffness": v}), [0, -1]),
    *real("pipe_mass", lambda v: pp.Pipe.from_si(**SI | {"pipe_mass": v}), [0, -1]),
    *real("fluid_mass", lambda v: pp.Pipe.from_si(**SI | {"fluid_mass": v}), [0, -1]),
    *real("gravity", lambda v: pp.Pipe.from_si(**SI, gravity=v)),
    *real("drag_coefficient", lambda v: pp.Pipe.from_si(**SI, drag_coefficient=v), [-1], [1]),
    *real("external_diameter", lambda v: pp.Pipe.from_si(**SI, external_diameter=v), [-1], [1]),
    *real("external_density", lambda v: pp.Pipe.from_si(**SI, external_density=v), [-1], [1]),
    *real(
        *("added_mass_coefficient", lambda v: pp.Pipe.from_si(**SI, added_mass_coefficient=v)),
        *([-1], [1]),
    ),
    *real("damping_time", lambda v: pp.Pipe.from_si(**SI, damping_time=v), [-1]),
    *real("hysteresis", lambda v: pp.Pipe.from_si(**SI, hysteresis=v), [-1]),
    *real("alpha", lambda v: pp.Pipe.from_si(**SI, alpha=v), [-1], missing=[None]),
    *(("flow", lambda v: pp.Pipe.from_si(**SI, flow=v), v) for v in ["in", 0, None]),
    # conversions
    *(
        case
        for name, method in [
            ("u", "speed_si"),
            ("V", "speed_from_si"),
            ("tau", "time_si"),
            ("t", "time_from_si"),
            ("omega", "frequency_si"),
            ("omega_si", "frequency_from_si"),
            ("s", "length_si"),
            ("x", "length_from_si"),
        ]
        for case in [
            (name, getattr(pp.Pipe.from_si(**SI), method), value)
            for value in [
                *("1", None, 1j, True, [1.0, NAN], INF, ["a"], [[1], [1, 2]], [1.0, True], 10**400),
                *(np.ma.array([1.0, 2.0], mask=[0, 1]), np.broadcast_to(1.0, (10**10,))),
            ]
        ]
    ),
    *(
        ("from_si", getattr(PIPE, f"{number}_{way}"), 1.0)
        for number in ("speed", "time", "frequency", "length")
        for way in ("si", "from_si")
    ),
    # end_coefficient
    *array("velocity", lambda v: pp.end_coefficient(v, areas=[1.0, 1.0, 1.0]), 3),
    ("velocity", lambda v: pp.end_coefficient(v, areas=[1.0, 1.0]), [1.0, 1.0, 1.0]),
    *(("velocity", lambda v: pp.end_coefficient(v), v) for v in [None, 1.0, [1.0, 2.0], "fast"]),
    ("velocity", lambda v: pp.end_coefficient(v, radii=[0, 1], areas=[1, 1]), [1.0, 1.0]),
    ("velocity", lambda v: pp.end_coefficient(v), lambda r: NAN),
    ("velocity", lambda v: pp.end_coefficient(v), lambda r: [[1], [1, 2]]),
    ("velocity", lambda v: pp.end_coefficient(v), lambda r: np.ma.masked),
    ("velocity", lambda v: pp.end_coefficient(v), lambda r: "fast"),
    ("velocity", lambda v: pp.end_coefficient(v), lambda r: np.ones(2)),
    *real("radius", lambda v: pp.end_coefficient(lambda r: 1.0, radius=v), [0, -1]),
    *real("section", lambda v: pp.end_coefficient(lambda r: 1.0, section=v), [0], missing=[None]),
    *array("radii", lambda v: pp.end_coefficient([1.0] * 3, radii=v), 3, [-1], optional=True),
    ("radii", lambda v: pp.end_coefficient([1.0] * 3, radii=v), [0.1, 0.2, 0.3]),
    ("radii", lambda v: pp.end_coefficient([1.0] * 3, radii=v), [0.0, 0.2, 0.2]),
    ("radii", lambda v: pp.end_coefficient([1.0], radii=v), [0.0]),
    ("radii", lambda v: pp.end_coefficient([1.0] * 3, radii=v), None),
    ("radii", lambda v: pp.end_coefficient([1.0] * 2, radii=v, areas=[1.0, 1.0]), [0.0, 1.0]),
    ("radii", lambda v: pp.end_coefficient(lambda r: 1.0, radii=v), [0.0, 1.0]),
    ("areas", lambda v: pp.end_coefficient(lambda r: 1.0, areas=v), [1.0, 1.0]),
    *array("areas", lambda v: pp.end_coefficient([1.0] * 3, areas=v), 3, [0, -1], optional=True),
    # Chain
    *(("pipe", lambda v: pp.Chain(v, 3), v) for v in [None, 0.2, "pipe", CHAIN, pp.Pipe]),
    *count("n", lambda v: pp.Chain(PIPE, v), high=[10**6 + 1, 10**12, 10**400]),
    ("n", lambda v: pp.Chain(PIPE), None),
    *(
        ("springs", lambda v: pp.Chain(PIPE, 3, springs=v), v)
        for v in ["", "Uniform", "stiff", None, 1.0, True]
    ),
    *array("springs", lambda v: pp.Chain(PIPE, 3, springs=v), 3, [-1e-9, 1e300]),
    ("springs", lambda v: pp.Chain(PIPE, 3, springs=v), [1.0, 1.0]),
    *array("lengths", lambda v: pp.Chain(PIPE, 2, lengths=v), 2, [0, -0.5], optional=True),
    ("lengths", lambda v: pp.Chain(PIPE, 3, lengths=v), [0.5, 0.5]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v), [0.5, 0.6]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v, base=0.1), [0.5, 0.5]),
    ("lengths", lambda v: pp.Chain(PIPE, lengths=v, springs="midpoint"), [0.5, 0.5]),
    *array("centres", lambda v: pp.Chain(PIPE, 3, centres=v), 3, [-0.1, 1.1], optional=True),
    ("centres", lambda v: pp.Chain(PIPE, 3, centres=v), [0.5, 0.5]),
    ("centres", lambda v: pp.Chain(PIPE, 2, centres=v, gyration_radii=[0.1, 0.0]), [0.5, 0.0]),
    *array(
        "gyration_radii", lambda v: pp.Chain(PIPE, 3, gyration_radii=v), 3, [-0.1], optional=True
    ),
    ("gyration_radii", lambda v: pp.Chain(PIPE, 3, gyration_radii=v), [0.5, 0.5]),
    *array(
        "drag_points", lambda v: pp.Chain(PIPE, 3, drag_points=v), 3, [-0.1, 1.1], optional=True
    ),
    ("drag_points", lambda v: pp.Chain(PIPE, 3, drag_points=v), [0.5, 0.5]),
    *real("base", lambda v: pp.Chain(PIPE, 3, base=v), below=[-0.1], above=[1.0, 2.0]),
    ("base", lambda v: pp.Chain(PIPE, 3, springs="midpoint", base=v), 0.1),
    # Galerkin and Continuum
    *(("pipe", lambda v: pp.Galerkin(v, 3), v) for v in [None, 0.2, CHAIN]),
    *count("m", lambda v: pp.Galerkin(PIPE, v), high=[2001, 10**12]),
    *(
        ("basis", lambda v: pp.Galerkin(PIPE, 3, v), v)
        for v in ["", "Beam", "fourier", None, 1, True]
    ),
    *(("pipe", lambda v: pp.Continuum(v), v) for v in [None, 0.2, CHAIN, "pipe"]),
    *count("m", lambda v: EXACT.frozen(v), high=[2001]),
    *(("question", lambda v: EXACT.converge(v, lambda a, b: 0.0), v) for v in [None, "u", 3.0]),
    *(("distance", lambda v: EXACT.converge(lambda rom: 0.0, v), v) for v in [None, "u", 3.0]),
    *(
        ("distance", lambda v: EXACT.converge(lambda rom: 0.0, v), lambda a, b, v=v: v)
        for v in [None, "near", 1j]
    ),
    *real("tolerance", lambda v: converged(tolerance=v), below=[0.0, -1.0]),
    *count("smallest", lambda v: converged(smallest=v), high=[1993, 10**9]),
    *count("largest", lambda v: converged(largest=v), high=[2001, 10**9]),
    # what models answer
    *real("u", lambda v: CHAIN.operators().at(v), below=[-1e-9]),
    *real("u", lambda v: ROM.operators().at(v), below=[-1.0]),
    # motion
    *(
        case
        for model in (CHAIN, ROM)
        for case in [
            *real("u", lambda v, model=model: model.rhs(0.0, np.zeros(6), v), [-1e-9], [1e101]),
            *real("u", lambda v, model=model: model.jacobian(0.0, np.zeros(6), v), [-1e-9]),
            *real("u", lambda v, model=model: model.power(np.zeros(6), v), [-1e-9]),
            *array("y", lambda v, model=model: model.rhs(0.0, v, 1.0), size=6),
            *array("y", lambda v, model=model: model.jacobian(0.0, v, 1.0), size=6),
            *array("y", model.energy, size=6),
            *array("y", lambda v, model=model: model.power(v, 1.0), size=6),
            *array("q", model.operators, size=3, optional=True),
        ]
    ),
    *(("pipe", model.with_pipe, v) for model in (CHAIN, ROM) for v in [None, 0.2]),
    *(
        case
        for model in (CHAIN, ROM)
        for case in [
            *array("q", lambda v, model=model: model.shape(v, [0.5]), 3),
            *array("q", model.tip, 3),
            ("q", model.tip, [0.0, 0.0]),
            ("q", model.tip, [0.0, 0.0, 1e7]),
            *(("q", lambda v, model=model: model.deflection(v, [0.5]), v) for v in not_columns()),
            ("q", lambda v, model=model: model.deflection(v, [0.5]), np.zeros((3, 1, 1))),
            *(("z", model.from_elastic, v) for v in not_columns()),
            *array("s", lambda v, model=model: model.shape(np.zeros(3), v), 3, [-0.1, 1.1]),
            *array("s", lambda v, model=model: model.deflection(np.zeros(3), v), 3, [-0.1, 1.1]),
            *array("s", pp.modes(model, 1.0).shapes[0], 3, [-0.1, 1.1]),
            *(("angle", model.bent, lambda s, v=v: v * s) for v in [NAN, 1e7, 1e300, 1j]),
            *(("q", model.tips, v) for v in [[0.0, 0.0, 0.0], np.zeros((3, 2)) + 1j, None]),
        ]
    ),
    *array("s", lambda v: ROM.functions(v), 3, [-0.1, 1.1]),
    ("q", ROM.tip, [0.0, 0.0, 500.0]),
    ("s", lambda v: pp.Galerkin(PIPE, 2000).functions(v), np.linspace(0.0, 1.0, 60_000)),
    *count("derivative", lambda v: ROM.functions([0.5], v), low=[-1], high=[3, 10**9]),
    # eigenvalues, modes
    *(
        case
        for question in (pp.eigenvalues, pp.modes)
        for case in [
            *(("model", lambda v, f=question: f(v, 1.0, 2), v) for v in NOT_MODELS),
            *real("u", lambda v, f=question: f(CHAIN, v), below=[-1e-9], above=[1e9]),
            *count("count", lambda v, f=question: f(CHAIN, 1.0, v), high=[7, 10**9], optional=True),
            *count("count", lambda v, f=question: f(EXACT, 1.0, v), high=[10**9], optional=True),
            ("count", lambda v, f=question: f(EXACT, 1.0, v), None),
            ("count", lambda v, f=question: f(long_chain(), 1.0, v), None),
            ("count", lambda v, f=question: f(long_chain(), 1.0, v), 60_000),
        ]
    ),
    # root_loci
    *(("model", lambda v: pp.root_loci(v, [0.0, 1.0]), v) for v in NOT_MODELS),
    *array("speeds", lambda v: pp.root_loci(CHAIN, v, 2), 3, [-1.0, 1e9]),
    ("speeds", lambda v: pp.root_loci(CHAIN, v, 2), [1.0, 1.0]),
    ("speeds", lambda v: pp.root_loci(CHAIN, v, 2), [2.0, 1.0]),
    ("speeds", lambda v: pp.root_loci(CHAIN, v, 2), 3.0),
    *count("count", lambda v: pp.root_loci(CHAIN, [0.0, 1.0], v), high=[4, 10**9], optional=True),
    *count("count", lambda v: pp.root_loci(EXACT, [0.0, 1.0], v), high=[10**9], optional=True),
    ("count", lambda v: pp.root_loci(EXACT, [0.0, 1.0], v), 401),
    ("speeds", lambda v: pp.root_loci(EXACT, v, 2), [0.0, 1001.0]),
    *(("progress", lambda v: pp.root_loci(CHAIN, [0.0], 2, progress=v), v) for v in NOT_FLAGS),
    *(
        ("count", lambda v, f=f: f(pp.Chain(PIPE, 10**6), v), 11)
        for f in (lambda c, v: pp.modes(c, 1.0, v), lambda c, v: pp.root_loci(c, [1.0], v))
    ),
    # crossings, critical_speed
    *(
        case
        for question in (pp.crossings, pp.critical_speed)
        for case in [
            *(("model", lambda v, f=question: f(v, 5.0), v) for v in NOT_MODELS),
            ("model", lambda v, f=question: f(v, 5.0), pp.Chain(PIPE, 2001)),
            ("model", lambda v, f=question: f(v, 5.0), pp.Chain(PIPE, 10**6)),
            *real("max_speed", lambda v, f=question: f(CHAIN, v), below=[0, -1], above=[1e9]),
            ("max_speed", lambda v, f=question: f(EXACT, v), 1001.0),
        ]
    ),
    # stability_curve
    *(("make_model", lambda v: pp.stability_curve(v, [0.1]), v) for v in [None, "chain", CHAIN, 3]),
    *array("values", lambda v: pp.stability_curve(lambda b: CHAIN, v), 3),
    ("values", lambda v: pp.stability_curve(lambda b: CHAIN, v), 0.2),
    *real(
        "max_speed",
        lambda v: pp.stability_curve(lambda b: CHAIN, [0.1], max_speed=v),
        below=[0, -1],
        above=[1e9],
        missing=[None],
    ),
    *(
        ("executor", lambda v: pp.stability_curve(lambda b: CHAIN, [0.1], executor=v), v)
        for v in ["threads", 2, True, object(), type("Name", (), {"submit": 3})()]
    ),
    *(
        ("progress", lambda v: pp.stability_curve(lambda b: CHAIN, [0.1], progress=v), v)
        for v in NOT_FLAGS
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


MASKED = np.ma.array([0.5, 0.5, 0.5], mask=[0, 1, 0])
IMAGINARY_NAN = np.array([0.0, complex(1.0, NAN), 0.0])


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


def test_a_shape_that_turns_many_times_is_still_integrated():
    q, s = np.array([60.0, -20.0, 15.0]), np.linspace(0.0, 1.0, 100_001)
    angles = ROM.functions(s, 1) @ q
    assert np.ptp(angles) > 100.0 * math.pi
    x, y = simpson(np.sin(angles), x=s), simpson(np.cos(angles), x=s)
    np.testing.assert_allclose(ROM.tip(q), [x, y], rtol=0.0, atol=1e-9)
