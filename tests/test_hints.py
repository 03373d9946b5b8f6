# SPDX-License-Identifier: MIT
"""Words and arguments from other programs and from the book: each refusal names what is meant."""

import inspect
import pickle
import re

import pytest

import pipedyn as pp
from pipedyn import continuation, modular, plot
from pipedyn.util.hints import did_you_mean

PIPE = pp.Pipe(0.2, terms=[pp.Spring(1.0, 3.0), pp.PointMass(0.5, 0.1)])
CHAIN = pp.Chain(PIPE, 3)
SI = {"length": 0.45, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.032}
HOSE = pp.Pipe.from_si(**SI)
HEARD = [pp.Measurement("frequency", 1.0, 0.1)]


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda: pp.Chain(PIPE, segments=10), "'n'"),
        (lambda: pp.Galerkin(PIPE, n=10), "'m'"),
        (lambda: pp.Pipe(mass_ratio=0.2), "'beta'"),
        (lambda: pp.Pipe(0.2, mu=0.02), "'hysteresis'"),
        (lambda: pp.Pipe(0.2, Gamma=3.0), "'gamma'"),
        (lambda: pp.Pipe.from_si(**{**SI, "EI": 1.0}), "'bending_stiffness'"),
        (lambda: pp.Pipe.from_si(M=0.2), "'pipe_mass' or 'fluid_mass'"),
        (lambda: pp.Spring(0.5, k=3.0), "'stiffness'"),
        (lambda: pp.PointMass(position=0.5, mass=0.1), "'at'"),
        (lambda: modular.PointMass(1.0, m=3.0), "'mass'"),
        (lambda: pp.Measurement("frequency", 1.0, std=0.1), "'uncertainty'"),
        (lambda: pp.Pulsation(2.0, amp=0.3, frequency=25.0), "'amplitude'"),
        (lambda: pp.StartPlane(xs=[0.0, 1.0], y=[2.0]), "'x'"),
        (lambda: pp.critical_speed(CHAIN, umax=30.0), "'max_speed'"),
        (lambda: pp.modes(CHAIN, 1.0, n_modes=3), "'count'"),
        (lambda: pp.simulate(CHAIN, 1.0, t_end=3.0), "'duration'"),
        (lambda: pp.simulate(CHAIN, 1.0, 3.0, tol=1e-3), "'rtol'"),
        (lambda: plot.root_loci(pp.root_loci(CHAIN, [0.0, 1.0], 2), axes=None), "'ax'"),
        (lambda: plot.root_loci(pp.root_loci(CHAIN, [0.0, 1.0], 2), legend=False), "'bar'"),
        (lambda: plot.spectrum(pp.simulate(CHAIN, 1.0, 1.0), dB=True), "'decibels'"),
        (lambda: plot.spectrum(pp.simulate(CHAIN, 1.0, 1.0), transient=0.5), "'start'"),
        (lambda: modular.chain(PIPE, segments=3), "'n'"),
        (lambda: modular.Segment(L=1.0), "'length'"),
        (lambda: continuation.follow(None, [0.0], 0.0, (0.0, 1.0), n_points=9), "'points'"),
    ],
)  # fmt: skip
def test_an_unknown_argument_is_answered_with_the_one_that_is_meant(call, meant):
    with pytest.raises(TypeError, match=rf"\(\) has no argument '\w+': did you mean {meant}\?$"):
        call()


@pytest.mark.parametrize(
    ("call", "meant"),
    [
        (lambda: pp.Pipe(0.2, root="fixed"), "clamped"),
        (lambda: pp.Pipe(0.2, root="Clamped"), "clamped"),
        (lambda: pp.Pipe(0.2, root="hinged"), "pinned"),
        (lambda: pp.Pipe(0.2, end="simply supported"), "pinned"),
        (lambda: pp.Pipe(0.2, end="built-in"), "clamped"),
        (lambda: pp.Pipe(0.2, end="sliding"), "guided"),
        (lambda: pp.Pipe(0.2, flow="sucking"), "aspirating"),
        (lambda: pp.Galerkin(PIPE, 10, "Legendre"), "legendre"),
        (lambda: pp.simulate(CHAIN, 1.0, 1.0, method="RK45"), "dop853"),
        (lambda: plot.root_loci(pp.root_loci(CHAIN, [0.0, 1.0], 2), units="SI"), "si"),
        (lambda: pp.Measurement("flutter speed", 1.0, 0.1), "critical_speed"),
        (lambda: pp.Measurement("log. decrement", 1.0, 0.1), "decrement"),
        (lambda: pp.choose(PIPE, "flutter speed", 0.01), "critical_speed"),
        (lambda: pp.identify(HOSE, HEARD, ["EI"]), "bending_stiffness"),
        (lambda: pp.identify(HOSE, HEARD, ["dampng"]), "damping"),
        (lambda: pp.identify(PIPE, HEARD, ["mass ratio"]), "beta"),
        (lambda: pp.critical_speeds(CHAIN, {"mass": [0.1]}), "PointMass.mass"),
        (lambda: pp.Harmonic(0.1, 3.0, "horizontal"), "x"),
        (lambda: pp.boundary(CHAIN, "velocity", "beta", {}), "u"),
    ],
)
def test_an_unknown_word_is_answered_with_the_one_that_is_meant(call, meant):
    with pytest.raises(ValueError, match=rf"got '.*': did you mean '{re.escape(meant)}'"):
        call()


def test_a_word_that_resembles_nothing_gets_the_list_alone():
    with pytest.raises(TypeError, match=r"has no argument 'wibble', only model, max_speed$"):
        pp.critical_speed(CHAIN, wibble=3.0)
    with pytest.raises(ValueError, match=r"root must be one of 'clamped', 'pinned', got 'loose'$"):
        pp.Pipe(0.2, root="loose")
    assert did_you_mean("EI", ["u", "beta", "gamma"]) == ""
    assert did_you_mean("", ["u", "beta"]) == ""
    assert did_you_mean("kappa", ["u", "alpha"]) == ""  # which is drag, and no slip of the pen
    several = ["terms[0].stiffness", "Spring.stiffness", "Foundation.stiffness"]
    assert did_you_mean("k", several) == (
        ": did you mean 'Spring.stiffness' or 'Foundation.stiffness' or 'terms[0].stiffness'?"
    )


FURTHER = {
    "u": 1.0, "speeds": [1.0, 2.0], "x": "beta", "y": "u", "max_speed": 5.0, "duration": 1.0,
    "ranges": {"beta": (0.1, 0.9), "u": (0.0, 9.0)}, "numbers": {"beta": [0.2]}, "q0": [0.0] * 3,
    "u0": 1.0, "pulsation": pp.Pulsation(1.0, 0.1, 9.0), "mean": 1.0, "amplitudes": [0.1],
    "frequencies": (1.0, 9.0), "quantity": "critical_speed", "conditions": 0.01,
    "measurements": HEARD, "unknowns": ["damping"],
}  # fmt: skip


def public_functions():
    for name in pp.__all__:
        one = getattr(pp, name)
        if inspect.isfunction(one):
            yield name, one, inspect.signature(one).parameters


@pytest.mark.parametrize("taken", ["model", "pipe"])
def test_a_list_where_one_is_asked_for_is_refused_with_the_way_to_ask(taken):
    one = {"model": CHAIN, "pipe": PIPE}[taken]
    asked = 0
    for name, function, parameters in public_functions():
        if next(iter(parameters)) == taken:
            needed = [k for k, of in parameters.items() if of.default is of.empty]
            further = {k: [one, one] if k == taken else FURTHER[k] for k in needed}
            many = ", ..." if len(further) > 1 else ""
            with pytest.raises(TypeError) as caught:
                function(**further)
            assert f"{taken} must be " in str(caught.value)
            way = f"; ask for one at a time, [pp.{name}({taken}{many}) for {taken} in ...]"
            assert str(caught.value).endswith(way), name
            asked += 1
    assert asked == {"model": 20, "pipe": 4}[taken]
    with pytest.raises(TypeError, match=r"; ask for one at a time, \[pp.Chain\(pipe, ...\) for"):
        pp.Chain([PIPE, PIPE], 3)
    loci = pp.root_loci(CHAIN, [0.0, 1.0], 2)
    with pytest.raises(TypeError, match=r"one at a time, \[pp.plot.root_loci\(loci\) for loci in"):
        plot.root_loci([loci, loci])
    with pytest.raises(TypeError, match=r"got [^;]*; ask .*, \[pp\.plot\.explore\(pipe\) for"):
        plot.explore([PIPE])


def test_errors_of_the_users_own_functions_are_left_as_they_are():
    def wrong(s):
        return wrong(segments=3)

    with pytest.raises(TypeError, match=r"wrong\(\) got an unexpected keyword argument 'segments'"):
        pp.simulate(CHAIN, 1.0, 1.0, wrong)
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'm'"):
        pp.Galerkin(PIPE)


def test_public_functions_keep_their_names_signatures_and_places_in_pickles():
    for name, function, parameters in public_functions():
        assert pickle.loads(pickle.dumps(function)) is function
        assert function.__name__ == name
        assert "given" not in parameters
    assert not hasattr(plot.Figure.__init__, "__wrapped__")  # matplotlib's stays as it is
    inner = inspect.unwrap(pp.critical_speed)
    assert pickle.loads(pickle.dumps(inner)) is inner
    assert next(iter(inspect.signature(pp.Chain).parameters)) == "pipe"


def test_what_completion_offers_is_what_users_call():
    for module in (plot, modular, continuation):
        names = dir(module)
        assert names == sorted(names)
        assert not [name for name in names if inspect.ismodule(getattr(module, name))]
        assert all(callable(getattr(module, name)) for name in names)
        assert {*names} <= {*module.__all__}
    assert {"root_loci", "style", "explore"} <= {*dir(plot)}
    assert not {"BLUE", "SPEED_LABEL", "CURVE_STYLES", "Figure", "units"} & {*dir(plot)}
    assert plot.BLUE.startswith("#")  # hidden, and still there
    assert plot.units.__name__ == "pipedyn.plot.units"
