# SPDX-License-Identifier: MIT
"""What importing the package brings along."""

import subprocess
import sys

import pipedyn as pp

PROGRAM = """
import sys
import pipedyn
import pipedyn.linear.stability_curve
print(",".join({"matplotlib", "tqdm", "IPython"} & set(sys.modules)))
"""


FEATURES = """
import sys
import pipedyn as pp
effects = {"gamma": 3.0, "drag": 1.0, "damping": 0.01}
pipes = [pp.Pipe(0.2), *(pp.Pipe(0.2, **{name: value}) for name, value in effects.items())]
pipes.append(pp.Pipe(0.2, flow="aspirating", alpha=0.5, **effects))
for pipe in pipes:
    for model in (pp.Chain(pipe, 3), pp.Galerkin(pipe, 3), pp.Galerkin(pipe, 3, "legendre")):
        pp.simulate(model, 1.0, 0.1, [0.1, 0.0, 0.0])
        model.operators()
        pp.eigenvalues(model, 1.0)
        pp.critical_speed(model)
pp.relevant(pipe, 1.0, "frequencies", count=2)
print(",".join(sorted({"matplotlib", "tqdm", "IPython", "mpmath", "sympy"} & set(sys.modules))))
"""


def printed_by(program):
    """What a fresh interpreter prints, warnings being errors."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.strip()


def test_importing_the_package_brings_neither_pictures_nor_progress_bars():
    assert printed_by(PROGRAM) == ""


def test_no_effect_needs_an_optional_package():
    """Each is used, and none of the optional packages nor matplotlib is imported on the way."""
    assert printed_by(FEATURES) == ""


def test_every_name_of_the_package_is_there_and_documented():
    for name in pp.__all__:
        assert getattr(pp, name).__doc__, name


def test_progress_needs_no_progress_bar(monkeypatch, capsys):
    """Without tqdm a plain count goes to stderr."""
    monkeypatch.setitem(sys.modules, "tqdm", None)
    pp.root_loci(pp.Chain(pp.Pipe(0.2), 3), [0.0, 1.0, 2.0], count=2, progress=True)
    err = capsys.readouterr().err
    assert "root loci" in err
    assert "2/2" in err
