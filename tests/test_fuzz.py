# SPDX-License-Identifier: MIT
"""Malformed arguments: a share of what `fuzz.py` tries, and that it sees what it looks for."""

import importlib
import inspect
import math
import re
from itertools import islice
from types import FunctionType

import pytest

import pipedyn as pp
from pipedyn import modular, plot

MADE_BY_USERS = {pp.Pipe, pp.Profile, pp.Chain, pp.Galerkin, pp.Continuum, pp.RootSpring}
MADE_BY_USERS |= {pp.StartPlane, pp.Pulsation, pp.Harmonic, pp.Supply, pp.Phase, pp.Force}
MADE_BY_USERS |= set(pp.Term.__subclasses__())
MADE_BY_USERS |= {getattr(modular, name) for name in modular.__all__}
MADE_BY_USERS -= {modular.Module, modular.Constraint}

CALLED_WITH_CHECKED = {"acceleration", "admissible", "along", "basis", "end_motion"}
CALLED_WITH_CHECKED |= {"free_directions", "free_states", "from_user", "initial_state", "kinks"}
CALLED_WITH_CHECKED |= {"as_of_si", "components", "largest_angle", "with_applied"}
CALLED_WITH_CHECKED |= {
    "law_numbers",
    "laws",
    "require_large_motions",
    "motion_jacobian",
    "motion_linearised",
    "motion_rates",
}
CALLED_WITH_CHECKED |= {
    "quarter_turn",
    "from_plane",
    "into_plane",
    "nearest_in_plane",
    "lies_in_plane",
    "inertia",
    "beyond_reach",
}
CALLED_WITH_CHECKED |= {"onto_constraints", "rate", "require_equilibrium", "sampled", "to_user"}
CALLED_WITH_CHECKED |= {"require_dimensions"}
CALLED_WITH_CHECKED |= {"unbalanced", "velocity", "weight_in"}
"""Methods that integrators and searches call, with what they have checked."""


@pytest.fixture(scope="module")
def fuzz():
    """Its good arguments take a second to compute: not by each process that collects the tests."""
    return importlib.import_module("fuzz")


def public_calls():
    """Names of all functions, constructors and methods that users give arguments to."""
    modules = {"": pp, "continuation.": pp.continuation, "modular.": modular, "plot.": plot}
    for prefix, module in modules.items():
        for name in module.__all__:
            item = getattr(module, name)
            if not getattr(item, "__module__", "").startswith("pipedyn"):
                continue  # what plot hands on from matplotlib
            if isinstance(item, FunctionType) or item in MADE_BY_USERS:
                yield prefix + name
            if isinstance(item, type) and item not in (pp.Model, pp.continuation.Continuation):
                yield from methods_with_arguments(prefix + name, item)


def methods_with_arguments(label, cls):
    """Those of results, which all of them inherit, are tried once."""
    for base in cls.__mro__:
        if base.__module__.startswith("pipedyn"):
            for name, method in vars(base).items():
                public = not name.startswith("_") and name not in CALLED_WITH_CHECKED
                arguments = inspect.signature(method).parameters if callable(method) else ()
                if public and isinstance(method, FunctionType) and len(arguments) > 1:
                    of_results = base.__module__.startswith("pipedyn.util.")
                    yield f"{base.__name__ if of_results else label}.{name}"


def test_every_public_call_is_tried(fuzz):
    tried = {re.sub(r"\[.*", "", target.name) for target in fuzz.TARGETS}
    assert sorted(set(public_calls()) - tried) == []


def test_malformed_arguments_are_refused_by_name_and_good_ones_answered(fuzz):
    assert fuzz.run(fuzz.random_cases(20261121, 0, 300)) == []


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_every_argument_alone_is_refused_by_name(fuzz, seed):
    assert fuzz.run(fuzz.one_by_one(seed)) == []


@pytest.mark.parametrize("first", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2))])
def test_every_argument_is_refused_by_name_at_each_of_its_bounds(fuzz, first):
    """Every third of what is tried, from the first, the second or the third on."""
    assert fuzz.run(islice(fuzz.at_bounds(0), first, None, 3)) == []


@pytest.mark.parametrize(
    ("call", "spoiled", "message"),
    [
        (lambda u: u, ["u"], "accepted"),
        (lambda u: {}["a"], ["u"], "raised KeyError"),
        (lambda u: int("x" * 500), ["u"], "refused without the argument's name"),
        (lambda u: math.nan, [], "not finite: result"),
        (lambda u: (0.0, [complex(0.0, math.inf)]), [], "not finite: result[1][0]"),
        (lambda u: pp.Pipe(2.0), [], "refused good arguments"),
        (lambda u: "x".encode("ascii").decode("utf-16"), ["u"], "raised UnicodeDecodeError"),
        (lambda u: next(i for i in iter(int, 1) if i), ["u"], "took more than 0.2 s"),
    ],
)
def test_a_call_that_ends_as_it_must_not_is_a_finding(fuzz, monkeypatch, call, spoiled, message):
    target = fuzz.Target("call", call, {"u": fuzz.NUMBER})
    monkeypatch.setattr(fuzz, "TARGETS", (target,))
    monkeypatch.setattr(fuzz, "LONGEST", 0.2)
    cases = (number for number in range(99) if fuzz.case(0, number)[2] == spoiled)
    (finding,) = fuzz.run(fuzz.random_cases(0, next(cases), 1))
    assert finding.target.startswith("call(")
    assert message in finding.message


def test_a_case_can_be_seen_again(fuzz):
    names = [(target.name, spoiled) for target, _, spoiled in (fuzz.case(3, n) for n in range(50))]
    assert names == [(t.name, spoiled) for t, _, spoiled in (fuzz.case(3, n) for n in range(50))]
