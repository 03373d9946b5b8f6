# SPDX-License-Identifier: MIT
"""What a release says of itself: one version, whose owner is the package's `__version__`."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest

import pipedyn as pp

ROOT = Path(__file__).resolve().parents[1]


def metadata():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_the_build_reads_the_version_from_the_package():
    project, build = metadata()["project"], metadata()["tool"]["scikit-build"]
    assert "version" not in project
    assert project["dynamic"] == ["version"]
    assert (ROOT / build["metadata"]["version"]["input"]).samefile(
        ROOT / "python" / "pipedyn" / "__init__.py"
    )


def test_the_installed_package_has_the_version_of_the_source():
    try:
        installed = importlib.metadata.version("pipedyn")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package is imported from its source folder, not installed")
    assert installed == pp.__version__


@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        ("CHANGELOG.md", r"^## (\S+) \(\d{4}-\d\d-\d\d\)$"),
        ("CITATION.cff", r"^version: (\S+)$"),
        ("README.md", r"version = \{(.*?)\}"),
    ],
)
def test_what_is_read_by_people_names_the_version_of_the_package(name, pattern):
    """In the change log it is the first version named, which is the latest."""
    found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None
    assert found[1] == pp.__version__


def test_the_book_and_the_citation_have_the_same_authors():
    (author,) = re.findall(
        r'^author = "(.*)"$', (ROOT / "notebooks" / "conf.py").read_text(encoding="utf-8"), re.M
    )
    assert f'name: "{author}"' in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_date_of_the_release_is_one():
    changes, citation = (
        (ROOT / name).read_text(encoding="utf-8") for name in ("CHANGELOG.md", "CITATION.cff")
    )
    date = re.search(r"^## \S+ \((.*)\)$", changes, re.MULTILINE)[1]
    assert f"date-released: {date}\n" in citation


def test_the_entry_point_is_the_command():
    (entry,) = metadata()["project"]["scripts"].items()
    name, target = entry
    module, function = target.split(":")
    assert name == "pipedyn"
    assert callable(getattr(importlib.import_module(module), function))
