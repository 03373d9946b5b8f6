# SPDX-License-Identifier: MIT
"""Files of 5e7fa04, one of every result and model, load ever after; names in them stay."""

import dataclasses
import inspect
import subprocess
import sys
import typing

import numpy as np
import pytest
from saved_things import FOLDER, THINGS, differences, facts, names_in, path_of, recorded

import pipedyn as pp
from pipedyn.util import archive
from pipedyn.util.archive import FORMER_NAMES, Saved

BASES = {
    *("Saved", "Result", "TableResult", "ResultSequence", "InPlane", "OfPipe", "Model"),
    "SpatialModel",
    *("SegmentModel", "SweptResult", "PeriodicMotion", "Term", "Quantity", "Unit"),
}
"""Classes from which saved ones inherit, but of which no object is in a file, and an SI unit."""

for public in pp.__all__:
    getattr(pp, public)  # a class has its name in files once its module is imported

KNOWN = recorded()


@pytest.mark.parametrize("name", THINGS)
def test_files_of_before_load_and_know_what_they_knew_and_so_do_those_written_from_them(
    name, tmp_path
):
    loaded = pp.load(path_of(name))
    assert differences(facts(loaded), KNOWN[name]) == []
    loaded.save(tmp_path / "new.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["new.npz"]
    assert not any("." in one for one in names_in(tmp_path / "new.npz"))  # no name of a module
    again = pp.load(tmp_path / "new.npz")
    assert differences(facts(again), KNOWN[name]) == []
    assert repr(again) == repr(loaded)
    if not isinstance(loaded, pp.Model | pp.Continuum):
        assert again == loaded
        return
    assert again.pipe == loaded.pipe
    if isinstance(loaded, pp.Continuum):
        assert pp.critical_speed(again) == pp.critical_speed(loaded)
        return
    if "pin" not in name:  # without a choice of `about` the straight pipe misses the pin
        assert again.operators() == loaded.operators()
    y = np.zeros(2 * loaded.coordinates)
    y[: loaded.coordinates] = loaded.bent(lambda s: 0.1 * np.sin(3.0 * s))
    np.testing.assert_array_equal(again.rhs(0.0, y, 3.0), loaded.rhs(0.0, y, 3.0))


def test_every_file_is_of_a_thing_that_is_listed():
    listed = {path_of(name) for name in THINGS}
    assert {path for path in FOLDER.iterdir() if path.suffix == ".npz"} == listed
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 500_000


def test_files_of_before_load_in_a_process_that_did_nothing_else():
    """What makes them is there as soon as the package is imported."""
    words = "import sys, pipedyn; [pipedyn.load(path) for path in sys.argv[1:]]; print('all')"
    paths = [str(path_of(name)) for name in THINGS]
    done = subprocess.run(
        [sys.executable, "-c", words, *paths], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("all\n", "")


# ------------------------------------------------------------------------------------------ names


def named():
    """Classes of the package with a name in files."""
    return {kind for kind in archive._BY_CLASS if kind.__module__.startswith("pipedyn.")}


def heirs(kind):
    for one in kind.__subclasses__():
        if one.__module__.startswith("pipedyn."):
            yield one
            yield from heirs(one)


def reached():
    """Classes of the package that are saved, and those that annotations of their fields name."""
    waiting, found = [*heirs(Saved), *heirs(pp.PipedynError)], set()
    while waiting:
        one = waiting.pop()
        if isinstance(one, type) and one.__module__.startswith("pipedyn.") and one not in found:
            found.add(one)
            hints = typing.get_type_hints(one)
            waiting += hints.values()
        waiting += typing.get_args(one)
    return found


def test_every_class_that_can_be_in_a_file_has_a_name():
    assert len(reached()) > 80
    assert {kind.__name__ for kind in reached() - named()} <= BASES
    assert all(inspect.isabstract(kind) or kind in named() for kind in heirs(pp.Model))
    quantities = next(kind for kind in reached() if kind.__name__ == "Quantity")
    assert {one for one in heirs(quantities) if dataclasses.is_dataclass(one)} <= named()
    assert set(heirs(pp.Term)) <= named()


def test_names_are_words_of_one_class_that_tell_no_module():
    names = [entry.name for entry in archive._BY_CLASS.values()]
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() for name in names)
    assert set(FORMER_NAMES.values()) <= set(names)


@pytest.mark.parametrize("law", tuple(heirs(pp.Term)))
def test_a_file_keeps_a_law_of_force(law, tmp_path):
    """A new law is a record of numbers like others: it needs no file among those of before."""
    term = law(**{item.name: 0.5 for item in dataclasses.fields(law)})
    pipe = pp.Pipe(0.2, end="pinned", terms=[term])
    pipe.save(tmp_path / "pipe.npz")
    assert pp.load(tmp_path / "pipe.npz") == pipe


def test_the_files_of_before_have_every_class_by_its_name_of_then():
    """Of `MotionOf` there is none: it holds functions, which no file can."""
    met = set().union(*(names_in(path_of(name)) for name in THINGS))
    known = set(map(archive.todays_name, met))
    others = named() - set(heirs(pp.Term))
    assert {archive._BY_CLASS[kind].name for kind in others} - known == {"MotionOf"}
    assert FORMER_NAMES.keys() <= met


def test_files_of_before_have_fields_and_names_that_are_others_today():
    """As of a class that was renamed, a field that was renamed and one that was added."""
    met = set().union(*(names_in(path_of(name)) for name in THINGS))
    assert met - set(map(archive.todays_name, met)) >= {"modular.Mechanism"}
    text = str(np.load(path_of("chain"))["header"])
    assert "_centers" in text
    assert "rotary_inertia" not in text
    chain = pp.load(path_of("chain"))
    assert (chain.centres.size, chain.pipe.rotary_inertia) == (chain.dof, 0.0)


def test_a_name_is_that_of_one_class_alone():
    for taken in ("Pipe", *FORMER_NAMES):
        with pytest.raises(ValueError, match=f"name must be that of one class alone, got '{taken}"):
            archive.saved_as(taken)(KeyError)


def test_a_module_can_be_imported_again_after_an_interrupt_cut_its_import_short(monkeypatch):
    """Names of its first classes were taken, so that no later call found its functions."""
    for registry in ("_BY_NAME", "_BY_CLASS"):
        monkeypatch.setattr(archive, registry, getattr(archive, registry).copy())
    again = type("NoHopf", (Exception,), {"__module__": pp.NoHopf.__module__})
    archive.saved_as("NoHopf")(again)
    assert archive._BY_NAME["NoHopf"].kind is again
