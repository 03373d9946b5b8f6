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
tube = {"length": 0.5, "outer_diameter": 0.012, "inner_diameter": 0.008, "youngs_modulus": 3e6}
pp.Pipe.from_tube(**tube, density=1150.0, fluid_density=998.0)
pp.relevant(pipe, 1.0, "frequencies", count=2)
print("imported:", *sorted({"matplotlib", "tqdm", "IPython", "mpmath", "pint"} & set(sys.modules)))
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
    *("matplotlib", "multiprocessing", "concurrent.futures", "numpy.f2py"),
    *(f"scipy.{name}" for name in ("integrate", "interpolate", "linalg", "optimize")),
    *(f"scipy.{name}" for name in ("sparse", "spatial", "special", "stats")),
}
"""What takes 4 to 300 ms each to import; scipy imports its own where `scipy.name` is first used, so
that the package says `import scipy` and no `from scipy.name import function`."""


def lines_of(program):
    """Lines that a program prints in a fresh interpreter, as sets of words."""
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return [set(line.split()) for line in done.stdout.splitlines()]


def test_neither_the_package_nor_the_first_critical_speeds_import_what_takes_long():
    """Nor does the package import its own modules, but for what a pipe is made of."""
    alone, used = lines_of("""
import sys
import pipedyn as pp
print(*sys.modules)
pipes = pp.Pipe(0.2), pp.Pipe(0.2, supports=(0.5,), terms=(pp.Spring(0.8, 10.0),))
for pipe in pipes:
    models = pp.Chain(pipe, 10), pp.Galerkin(pipe, 8), pp.Galerkin(pipe, 8, "legendre")
    for model in (*models, pp.Continuum(pipe)):
        pp.critical_speed(model)
print(*sys.modules)
""")
    assert {"numpy", "pipedyn.models.pipe"} < alone
    assert not {"pipedyn.models.chain", "pipedyn.linear", "pipedyn.motion", "pipedyn.plot"} & alone
    assert "pipedyn.linear.critical_speed" in used
    assert not HEAVY & used
    assert not {"pipedyn.motion", "pipedyn.orbits", "pipedyn.plot"} & used


def test_what_another_process_saved_is_loaded_by_one_that_used_none_of_it(tmp_path):
    pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 2), 5.0).save(tmp_path / "cycle.npz")
    imported, kind, unknown = lines_of(f"""
import sys
import pipedyn as pp
found = pp.load({str(tmp_path / "cycle.npz")!r})
print(*sys.modules)
print(type(found).__name__, type(found.model).__name__)
try:
    pp.util.archive._entry("Unheard", object)
except ValueError as error:
    print(error)
""")
    assert not {"pipedyn.curves", "pipedyn.forced", "pipedyn.plot"} & imported
    assert kind == {"LimitCycle", "Chain"}
    assert "'Unheard'," in unknown


def test_every_class_of_a_file_is_found_by_way_of_the_public_names():
    (missing,) = lines_of("""
import pkgutil
import pipedyn as pp
from pipedyn.util import archive
for name in pp.__all__:
    if name[0].isupper():
        getattr(pp, name)
known = {*archive._BY_NAME}
for one in pkgutil.walk_packages(pp.__path__, "pipedyn."):
    if not one.name.startswith(("pipedyn.plot", "pipedyn.paper", "pipedyn.__main__")):
        __import__(one.name)
print("missing", *{*archive._BY_NAME} - known)
""")
    assert missing == {"missing"}


def test_scipy_is_whole_after_its_lapack_was_taken_alone():
    """`import` binds a module in its package only where it is not among the loaded ones yet."""
    before, after, value = lines_of("""
import sys
import pipedyn as pp
model = pp.Galerkin(pp.Pipe(0.2), 8)
found = pp.critical_speed(model).speed
print(*[name for name in sys.modules if name.startswith("scipy.linalg")], "-")
import scipy.linalg.cython_blas, scipy.linalg.cython_lapack
print(scipy.linalg.cython_blas.__name__, scipy.linalg.cython_lapack.__name__)
print(pp.critical_speed(model).speed == found, scipy.linalg.inv([[2.0]])[0, 0])
""")
    assert before == {"-"}
    assert after == {"scipy.linalg.cython_blas", "scipy.linalg.cython_lapack"}
    assert value == {"True", "0.5"}


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
            if str(getattr(one, "__module__", "")).startswith("pipedyn"):
                names.add(name)
                names.update(inspect.signature(one).parameters if inspect.isfunction(one) else ())
                names.update(vars(one) if inspect.isclass(one) else ())
    assert len(names) > 500
    public = (name for name in names if not name.startswith("_"))
    assert [name for name in public if any(word in name.lower() for word in AMERICAN)] == []


def test_every_public_name_stands_in_the_reference():
    pages = (Path(__file__).parents[1] / "notebooks" / "reference").glob("*.md")
    words = set(" ".join(page.read_text(encoding="utf-8") for page in pages).split())
    parts = {f"{name}.": getattr(pp, name) for name in ("plot", "modular", "continuation")}
    for prefix, module in {"": pp, **parts}.items():
        every = {name: getattr(module, name) for name in module.__all__}
        own = {name for name, one in every.items() if getattr(one, "__module__", None) is not None}
        names = [name for name in own if every[name].__module__.startswith("pipedyn")]
        assert len(names) > 4
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


def test_the_package_shows_public_names_only():
    assert dir(pp) == sorted({*pp.__all__, "__version__"})
    assert not [name for name in pp.__all__ if name.startswith("_")]
    modules = {name for name in pp.__all__ if inspect.ismodule(getattr(pp, name))}
    assert modules == {"continuation", "modular", "plot"}
