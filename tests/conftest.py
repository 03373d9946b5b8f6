# SPDX-License-Identifier: MIT
"""Settings of the whole suite: property tests draw the same examples every time."""

import contextlib
import gc
import importlib
import os
import signal
import sys
import zlib
from itertools import groupby
from pathlib import Path

# Before numpy is imported: its matrices here are small, and threads only get in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest

hypothesis.settings.register_profile(
    "same", derandomize=True, deadline=None, database=None, max_examples=40
)
hypothesis.settings.load_profile("same")

ONE_IN = 3
"""Of a test of five cases or more one case in so many, drawn by a checksum, is not slow."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Marks as slow most cases of a test of many, unless files or tests are asked for by name."""
    if config.option.keyword or not all(map(os.path.isdir, config.args)):
        return
    for _, cases in groupby(items, lambda item: (item.path, getattr(item, "originalname", ""))):
        drawn = sorted(cases, key=lambda item: zlib.crc32(item.nodeid.encode()))
        if len(drawn) >= 5:
            for item in drawn[-(-len(drawn) // ONE_IN) :]:
                item.add_marker("slow")


@pytest.fixture
def at_level():
    """Sets the vector level, and the one in use before when the test ends."""
    from pipedyn import _core  # the process that hands out tests needs no package

    before = _core.vector_level()
    yield _core.set_vector_level
    _core.set_vector_level(before)


def pytest_generate_tests(metafunc):
    """A test of `each_level` runs at every vector level of the processor."""
    if "each_level" in metafunc.fixturenames:
        from pipedyn import _core

        metafunc.parametrize("each_level", _core.vector_levels(), indirect=True)


@pytest.fixture
def each_level(request, at_level):
    """The vector level at which the test runs."""
    at_level(request.param)
    return request.param


@pytest.fixture
def levels():
    """All vector levels that this processor has."""
    from pipedyn import _core

    return _core.vector_levels()


@pytest.fixture
def interrupted_after():
    """Sees that a call that would take hours is interrupted after so many seconds."""
    if not hasattr(signal, "setitimer"):
        pytest.skip("no timer on this system")

    def interrupt(*_):
        raise KeyboardInterrupt

    def interrupted(seconds, call):
        before = signal.signal(signal.SIGALRM, interrupt)
        signal.setitimer(signal.ITIMER_REAL, seconds)
        try:
            with pytest.raises(KeyboardInterrupt) as caught:
                call()
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
        return caught

    return interrupted


@pytest.fixture
def terminal(capsys, monkeypatch):
    """Captured output that passes for a terminal, to which progress is written."""
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda self: True)
    return capsys


def pytest_sessionstart(session):
    """Every other worker of a run of all tests imports them from the last: each compiles half."""
    worker = getattr(session.config, "workerinput", {}).get("workerid", "gw0")
    if int(worker[2:]) % 2 and session.config.args_source.name == "TESTPATHS":
        for path in sorted(Path(__file__).parent.glob("test_*.py"), reverse=True):
            with contextlib.suppress(Exception):  # collecting it says why
                importlib.import_module(path.stem)


def pytest_collection_finish():
    """What is there now stays to the end, so that no garbage is looked for in it again."""
    gc.collect()
    gc.freeze()
