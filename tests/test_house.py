# SPDX-License-Identifier: MIT
"""How the sources are kept: imports in one direction, small folders, one meaning a name, a budget.

A later change may lower the limits. It raises the budget of lines only in a commit that says for
what, and no other limit.
"""

import ast
import functools
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

LIMITS = {
    "longest chain of imports in a folder": 7,
    "modules in a folder": 17,
    "names with more than one meaning": 8,
    "docstrings that begin with a leaning word": 0,
    "lines of Python": 28377,
    "lines of C++": 16954,
}

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python" / "pipedyn"
LEANING = re.compile(
    r"(of|the same|those|that|this|its|it|as|see|beside|within|with|by|for|from|in|on|at|and|or"
    r"|each of|both)\b",
    re.IGNORECASE,
)
"""First words of a docstring that cannot be read alone: they point at something outside it."""


def dotted(path):
    """Name of the module in a file, as it is imported."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if path.stem == "__init__" else parts)


MODULES = {dotted(path): path for path in sorted(PACKAGE.rglob("*.py"))}
FOLDERS = (
    *("util", "models", "modular", "continuation", "linear", "motion"),
    *("equilibrium", "orbits", "attraction", "cycles", "forced", "curves"),
    *("diagram", "accuracy", "plot", "paper"),
)
"""Data flows from left to right: a folder imports from itself and from those to its left. The
diagram is a file."""


def within(folder):
    """Modules of a folder directly below the package, with those of all folders below it."""
    return [name for name in MODULES if f"{name}.".startswith(f"pipedyn.{folder}.")]


@functools.cache
def nodes():
    """All nodes of each module's syntax tree by path, its root first, listed for the first test."""
    return {path: [*ast.walk(ast.parse(path.read_text("utf-8")))] for path in MODULES.values()}


@functools.cache
def imported(name):
    """Modules of the package that one imports, wherever in its file the import stands."""
    path, found = MODULES[name], set()
    for node in nodes()[path]:
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            folder = name.split(".") if path.stem == "__init__" else name.split(".")[:-1]
            above = folder[: len(folder) + 1 - node.level] if node.level else []
            source = ".".join([*above, *filter(None, [node.module])])
            inner = {f"{source}.{alias.name}" for alias in node.names}
            found.update(inner & {*MODULES, "pipedyn._core"} or {source})
    return (found & MODULES.keys()) - {name}


def lines_of_docstrings(every):
    """Numbers of the lines of strings that stand alone: docstrings, those of constants too."""
    lines = set()
    for node in every:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                lines.update(range(node.lineno, node.end_lineno + 1))
    return lines


def check(measure, found):
    """Compares the number of what was found with its limit, and lists it where there is more."""
    listed = "\n".join(found)
    limit = LIMITS[measure]
    assert len(found) <= limit, f"{measure}: {len(found)}, the limit is {limit}:\n{listed}"


def test_no_module_imports_itself_by_way_of_others():
    TopologicalSorter({name: imported(name) for name in MODULES}).prepare()  # names the circle


def test_the_package_is_folders_and_three_files():
    files = {path.name for path in PACKAGE.glob("*.py")}
    assert files == {"__init__.py", "__main__.py", "diagram.py"}
    folders = {path.name for path in PACKAGE.iterdir() if list(path.glob("*.py"))}
    assert folders == {*FOLDERS} - {"diagram"}


@pytest.mark.parametrize("folder", FOLDERS)
def test_nothing_imports_upward(folder):
    """The package itself, whose public names come from every folder, is above all of them."""
    allowed = FOLDERS[: FOLDERS.index(folder) + 1]
    upward = [
        (name, other)
        for name in within(folder)
        for other in imported(name)
        if not f"{other}.".startswith(tuple(f"pipedyn.{one}." for one in allowed))
    ]
    assert upward == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_folders_have_few_floors_of_imports(folder):
    names = {name for name in within(folder) if MODULES[name].stem != "__init__"}
    below = {name: imported(name) & names for name in names}
    floor = {}
    for name in TopologicalSorter(below).static_order():
        floor[name] = 1 + max((floor[one] for one in below[name]), default=0)
    limit = LIMITS["longest chain of imports in a folder"]
    assert max(floor.values()) <= limit, sorted(floor.items(), key=lambda item: -item[1])


@pytest.mark.parametrize("folder", FOLDERS)
def test_folders_have_few_modules(folder):
    check("modules in a folder", within(folder))


def test_names_mean_one_thing():
    where = {}
    for path, (root, *_) in nodes().items():
        if path.stem == "__init__":
            continue
        for node in root.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                defined = [node.name]
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                leaves = (leaf for target in targets for leaf in ast.walk(target))
                defined = [leaf.id for leaf in leaves if isinstance(leaf, ast.Name)]
            else:
                continue
            for name in set(defined) - {"__all__", "T"}:  # T: the usual type variable
                where.setdefault(name.lstrip("_"), set()).add(dotted(path))
    found = [f"{name}: {', '.join(sorted(in_))}" for name, in_ in where.items() if len(in_) > 1]
    check("names with more than one meaning", sorted(found))


def test_docstrings_can_be_read_alone():
    found = []
    for path, every in nodes().items():
        for node in every:
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = (ast.get_docstring(node) or "").strip()
                if LEANING.match(text):
                    line = node.body[0].lineno
                    found.append(f"{path.relative_to(ROOT)}:{line} {text.splitlines()[0]}")
    check("docstrings that begin with a leaning word", found)


def test_lines_of_python_stay_within_the_budget():
    lines = 0
    for path, every in nodes().items():
        said = lines_of_docstrings(every)
        numbered = enumerate(path.read_text("utf-8").splitlines(), start=1)
        lines += sum(i not in said and not re.match(r"\s*(#|$)", line) for i, line in numbered)
    assert lines <= LIMITS["lines of Python"]


def test_lines_of_cpp_stay_within_the_budget():
    lines = 0
    for path in (ROOT / "cpp").rglob("*.[ch]pp"):
        text = re.sub(r"/\*.*?\*/", "", path.read_text("utf-8"), flags=re.DOTALL)
        lines += sum(not re.match(r"\s*(//|$)", line) for line in text.splitlines())
    assert lines <= LIMITS["lines of C++"]
