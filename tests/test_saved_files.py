# SPDX-License-Identifier: MIT
"""Files that 5e7fa04 wrote, one of every result and model, load ever after."""

import pytest
from saved_things import FOLDER, THINGS, differences, facts, path_of, recorded

import pipedyn as pp


@pytest.mark.parametrize("name", THINGS)
def test_files_of_before_load_and_know_what_they_knew(name):
    assert differences(facts(pp.load(path_of(name))), recorded()[name]) == []


def test_every_file_is_of_a_thing_that_is_listed():
    listed = {path_of(name) for name in THINGS}
    assert {path for path in FOLDER.iterdir() if path.suffix == ".npz"} == listed
    assert recorded().keys() == THINGS.keys()
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < 500_000
