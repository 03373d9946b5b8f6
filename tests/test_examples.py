# SPDX-License-Identifier: MIT
"""Examples in docstrings of public names print what they say, and every public function has one."""

import doctest
import inspect
from collections.abc import Iterator
from typing import Any

import matplotlib.pyplot
import numpy as np
import pytest

import pipedyn as pp
from pipedyn import plot

MODULES = {"pp": pp, "plot": plot, "pp.modular": pp.modular}
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def documented() -> Iterator[tuple[str, Any]]:
    """Public functions and classes with the classes' own methods."""
    for prefix, module in MODULES.items():
        for name in module.__all__:
            one = getattr(module, name)
            if not (inspect.isfunction(one) or inspect.isclass(one)):
                continue
            yield f"{prefix}.{name}", one
            for method, of in vars(one).items() if inspect.isclass(one) else ():
                plain = getattr(of, "__func__", of)
                if not method.startswith("_") and inspect.isfunction(plain):
                    yield f"{prefix}.{name}.{method}", plain


EVERY = dict(documented())
WITH_EXAMPLE = {name: one for name, one in EVERY.items() if ">>>" in (one.__doc__ or "")}


def test_every_public_function_has_an_example():
    functions = [n for n, one in EVERY.items() if inspect.isfunction(one) and n.count(".") < 3]
    top = [name for name in functions if not inspect.isclass(EVERY.get(name.rpartition(".")[0]))]
    assert [name for name in top if name not in WITH_EXAMPLE] == []


FIRST_WEEK = """
    Pipe Pipe.from_si Pipe.from_tube Pipe.speed_si Pipe.speed_from_si Pipe.time_si Pipe.frequency_si
    Pipe.length_si Pipe.equivalent_damping
    Scales Chain Galerkin Continuum Operators Operators.at Model.operators
    Model.rhs Model.jacobian Model.energy Model.power Model.shape Model.tip Model.tips Model.about
    CriticalSpeed Sensitivity Modes RootLoci StabilityCurve Crossings Motion Ensemble Event
    Pulsation Harmonic Equilibria Hopf Hopf.amplitude Hopf.cycle_frequency LimitCycle
    BifurcationDiagram Boundary.unstable Attractors FrequencyResponse Trade.pareto
    modular.Assembly modular.Assembly.plus
"""


def test_what_a_newcomer_calls_has_an_example():
    assert [name for name in FIRST_WEEK.split() if f"pp.{name}" not in WITH_EXAMPLE] == []


@pytest.mark.parametrize("name", WITH_EXAMPLE)
def test_examples_print_what_they_say(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    known = {"np": np, "pp": pp, "plot": plot}
    finder = doctest.DocTestFinder(recurse=False)
    said = list[str]()
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    with matplotlib.rc_context({"backend": "agg", "figure.max_open_warning": 0}):
        for example in finder.find(WITH_EXAMPLE[name], name, globs=known):
            runner.run(example, out=said.append)
    matplotlib.pyplot.close("all")
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
