# SPDX-License-Identifier: MIT
"""What importing the package brings along, and its public names."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pipedyn as pp

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
print("imported:", *sorted({"matplotlib", "tqdm", "IPython", "mpmath"} & set(sys.modules)))
print("plot" in dir(pp))
pp.plot.root_loci
print("matplotlib" in sys.modules)
"""


def printed():
    """What a fresh interpreter prints of the program above, line by line; warnings are errors."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", FEATURES], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.splitlines()


HEAVY = {
    *("matplotlib", "multiprocessing", "concurrent.futures.process", "threadpoolctl"),
    *(f"scipy.{name}" for name in ("integrate", "interpolate", "linalg", "optimize")),
    *(f"scipy.{name}" for name in ("sparse", "spatial", "special", "stats")),
}
"""What takes 0.01 to 0.3 s to import each; scipy imports its own where `scipy.name` is first used,
so that the package says `import scipy` and no `from scipy.name import function`."""


def test_the_package_imports_nothing_that_takes_long():
    """Nor do pipes and terms need it; the first model or search that does brings it along."""
    program = "import sys, pipedyn as pp\npp.Chain(pp.Pipe(0.2), 3)\nprint(*sys.modules)"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    imported = set(done.stdout.split())
    assert "pipedyn" in imported
    assert not HEAVY & imported


def test_neither_the_package_nor_any_effect_needs_pictures_progress_bars_or_other_options():
    """Each is used, and none of the optional packages nor matplotlib is imported on the way.

    Pictures are at hand without matplotlib being imported, until one is asked for.
    """
    assert printed() == ["imported:", "True", "True"]


def test_every_name_of_the_package_is_there_and_documented():
    for name in pp.__all__:
        assert getattr(pp, name).__doc__, name


AMERICAN = ("color", "center", "behavior", "neighbor", "ization", "izer", "ized", "gray")


def test_public_names_are_spelled_the_british_way():
    names = set()
    for module in (pp, pp.plot, pp.modular, pp.continuation):
        for name, one in inspect.getmembers(module):
            if str(getattr(one, "__module__", "")).startswith("pipedyn."):
                names.add(name)
                names.update(inspect.signature(one).parameters if inspect.isfunction(one) else ())
                names.update(vars(one) if inspect.isclass(one) else ())
    assert len(names) > 500
    public = (name for name in names if not name.startswith("_"))
    assert [name for name in public if any(word in name.lower() for word in AMERICAN)] == []


def test_every_public_name_stands_in_the_reference():
    pages = (Path(__file__).parents[1] / "notebooks" / "reference").glob("*.md")
    words = set(" ".join(page.read_text(encoding="utf-8") for page in pages).split())
    for prefix, module in (("", pp), ("plot.", pp.plot), ("modular.", pp.modular)):
        every = {name: getattr(module, name) for name in module.__all__}
        own = {name for name, one in every.items() if getattr(one, "__module__", None) is not None}
        names = [name for name in own if every[name].__module__.startswith("pipedyn.")]
        assert len(names) > 10
        found = {name: {f"pipedyn.{name}", f"pipedyn.{prefix}{name}"} & words for name in names}
        assert [name for name in names if not found[name]] == []


def test_names_that_the_book_mentions_exist():
    book = Path(__file__).parents[1] / "notebooks"
    texts = [page.read_text(encoding="utf-8") for page in book.rglob("*.md")]
    for page in book.glob("*.ipynb"):
        cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
        texts += ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    objects = {"pipedyn": pp, "pp": pp, "model": pp.Model, "motion": pp.Motion, "pipe": pp.Pipe}
    objects |= {name: getattr(pp, name) for name in pp.__all__}
    names = {name for text in texts for name in re.findall(r"`(\w+\.\w+)[^`/]*`", text)}
    mentioned = [name.split(".") for name in names if name.split(".")[0] in objects]
    assert len(mentioned) > 15
    for owner, name in mentioned:
        fields = getattr(objects[owner], "__dataclass_fields__", {})
        assert name in fields or hasattr(objects[owner], name), f"{owner}.{name}"


def test_the_book_names_the_functions_that_take_an_executor():
    page = Path(__file__).parents[1] / "notebooks" / "how-to" / "sweep-in-parallel.md"
    text = page.read_text(encoding="utf-8").split("# Sweep in parallel")[1]
    taking, others = text.split("```")[0].split("The others")
    functions = {name: getattr(pp, name) for name in pp.__all__}
    parameters = {
        name: inspect.signature(one).parameters
        for name, one in functions.items()
        if inspect.isfunction(one)
    }
    named = set(re.findall(r"`([a-z_]+)`", taking)) - {"executor"}
    assert named == {name for name, own in parameters.items() if "executor" in own}
    assert set(re.findall(r"`([a-z_]+)`", others)) <= set(parameters) - named


def test_progress_needs_no_progress_bar(monkeypatch, terminal):
    """Without tqdm a plain count goes to stderr."""
    monkeypatch.setitem(sys.modules, "tqdm", None)
    pp.root_loci(pp.Chain(pp.Pipe(0.2), 3), [0.0, 1.0, 2.0], count=2, progress=True)
    err = terminal.readouterr().err
    assert "root loci" in err
    assert "2/2" in err


def test_the_package_shows_public_names_only():
    assert dir(pp) == sorted({*pp.__all__, "__version__"})
    assert not [name for name in pp.__all__ if name.startswith("_")]
    modules = {name for name in pp.__all__ if inspect.ismodule(getattr(pp, name))}
    assert modules == {"continuation", "modular", "plot"}
