# SPDX-License-Identifier: MIT
"""Files are written beside their place and take it when whole: a full disk spoils none."""

import os
import signal
import stat
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure

import pipedyn as pp
import pipedyn.__main__ as command
from pipedyn import plot
from pipedyn.paper.analysis import Findings, Row
from pipedyn.paper.report import map_figure
from pipedyn.util.files import replacing

CHAIN = pp.Chain(pp.Pipe(0.2), 2)
posix = pytest.mark.skipif(os.name != "posix", reason="limits, signals and links are POSIX's")


def test_a_file_is_replaced_when_it_is_whole(tmp_path):
    path = tmp_path / "some.txt"
    path.write_text("before")
    with replacing(path) as beside:
        beside.write_text("after")
        assert path.read_text() == "before"
        assert (beside.parent, beside.suffix) == (path.parent, path.suffix)
    assert path.read_text() == "after"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
def test_what_was_begun_is_removed_and_what_was_there_stays(kind, tmp_path):
    path = tmp_path / "some.txt"
    path.write_text("before")

    def interrupted():
        with replacing(path) as beside:
            beside.write_text("af")
            raise kind

    with pytest.raises(kind):
        interrupted()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_what_others_left_beside_is_no_hindrance(tmp_path):
    """Such as 5e7fa04 left on a full disk, here as a folder, which no file can replace."""
    (tmp_path / "pipe.npz.partial").mkdir()
    pp.Pipe(0.2).save(tmp_path / "pipe.npz")
    pp.Pipe(0.3).save(tmp_path / "pipe.npz")
    assert pp.load(tmp_path / "pipe.npz") == pp.Pipe(0.3)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_folder_that_is_missing_is_named_as_it_was_given(tmp_path):
    path = tmp_path / "none" / "table.csv"
    with pytest.raises(FileNotFoundError) as refused:
        pp.crossings(CHAIN, 9.0).to_csv(path)
    assert str(refused.value).endswith(repr(os.path.realpath(path)))


def test_a_protected_file_is_not_replaced(tmp_path, monkeypatch):
    path = tmp_path / "some.npz"
    pp.Pipe(0.2).save(path)
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)  # as root is told else
    with pytest.raises(PermissionError, match=r"some\.npz"):
        pp.Pipe(0.3).save(path)
    assert pp.load(path) == pp.Pipe(0.2)


@posix
def test_permissions_and_links_stay(tmp_path):
    path, link = tmp_path / "some.npz", tmp_path / "link.npz"
    pp.Pipe(0.2).save(path)
    usual = os.umask(0)
    os.umask(usual)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~usual
    path.chmod(0o640)
    link.symlink_to(path)
    pp.Pipe(0.3).save(link)
    assert link.is_symlink()
    assert pp.load(path) == pp.Pipe(0.3)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@posix
def test_what_is_no_regular_file_is_written_to_itself(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    reader = subprocess.Popen(["cat", str(path)], stdout=subprocess.PIPE, text=True)
    text = pp.crossings(CHAIN, 9.0).to_csv(path)
    assert reader.communicate(timeout=60)[0] == text
    assert stat.S_ISFIFO(path.stat().st_mode)


# --------------------------------------------------------------------------------- on a full disk


@contextmanager
def full_disk(room=1000):
    """Within, no file can be longer than so many bytes, as if the disk were full."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module")
def motion():
    return pp.simulate(CHAIN, 4.0, 4.0, lambda s: 0.1 * s, samples=200)


@pytest.mark.parametrize("name", ["motion.npz", "motion.csv", "film.gif", "film.html"])
def test_a_full_disk_leaves_what_was_there(name, motion, tmp_path, monkeypatch):
    path = tmp_path / name
    path.write_bytes(b"before")
    write = {".npz": motion.save, ".csv": motion.to_csv}.get(path.suffix)
    if write is None:
        ax = Figure(figsize=(2.0, 2.0), dpi=50).subplots()
        film = plot.animate(motion, fps=10.0, span=(0.0, 0.15), speed=0.5, ax=ax)
        film._init_draw()
        monkeypatch.setattr(film, "to_jshtml", lambda: "page" * 1000)  # which has files of its own
        write = film.save
    with full_disk(), pytest.raises(OSError, match="File too large"):
        write(path)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_after_a_full_disk_a_small_save_succeeds(motion, tmp_path):
    path = tmp_path / "some.npz"
    with full_disk():
        with pytest.raises(OSError, match="File too large"):
            motion.save(path)
        pp.Pipe(0.2).save(path)
    assert pp.load(path) == pp.Pipe(0.2)
    assert list(tmp_path.iterdir()) == [path]


# ------------------------------------------------------------------------------------ the command


def some_findings(case):
    """Few, and quickly found."""
    exact = pp.critical_speed(pp.Continuum(case.pipe))
    chains = [pp.critical_speed(pp.Chain(case.pipe, n, springs="rayleigh")) for n in (4, 8)]
    rows = [Row("chain", "rayleigh", one.size, one) for one in chains]
    return Findings(highest=8.0, exact=exact, rows=rows)


def test_on_a_full_disk_the_command_keeps_tables_and_figures_and_says_so(tmp_path):
    case = command._parse(["--output", str(tmp_path)])
    findings = some_findings(case)
    savers = {"table.csv": command.save_table}
    savers["map.png"] = partial(command.save_figure, map_figure)
    paths = command.write_files(case, findings, savers)
    before = [path.read_bytes() for path in paths]
    with full_disk(100):
        assert command.write_files(case, findings, savers) == []
    assert findings.failures == [f"{path}: File too large" for path in paths]
    assert [path.read_bytes() for path in paths] == before
    assert sorted(tmp_path.iterdir()) == sorted(paths)


@posix
def test_ctrl_c_ends_the_command_with_one_line(tmp_path):
    """At once, in the midst of a search that takes minutes."""
    folder = tmp_path / "figures"  # which the command makes when it has read its options
    words = ["--output", str(folder), "--chain", "1000", "--speeds", "5001"]
    running = subprocess.Popen(
        [sys.executable, "-m", "pipedyn", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell lets what it starts in the background ignore it, and so do the children of that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    with running:
        while not folder.exists() and running.poll() is None:
            time.sleep(0.05)
        time.sleep(0.2)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=120)
    assert (out, err, running.returncode) == ("", "pipedyn: interrupted\n", 130)
    assert list(folder.iterdir()) == []


@posix
def test_a_report_that_nobody_reads_ends_with_one_line(tmp_path):
    words = """
    import pipedyn.__main__ as command

    def gather(case, executor):
        return command.Findings(highest=8.0)

    command.compute_findings, command.save_figure = gather, lambda *given: None
    command.program()
    """
    options = ["--quiet", "--output", str(tmp_path)]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(words), *options],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    os.close(write)
    said = "pipedyn: 1 not computed or written, the first: the report: Broken pipe\n"
    assert (done.stderr, done.returncode) == (said, 1)
    assert (tmp_path / "critical-speeds.csv").read_text().startswith("model,")


def test_random_numbers_of_users_are_left_alone(tmp_path):
    """Names of files beside are drawn elsewhere."""
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    pp.Pipe(0.2).save(tmp_path / "pipe.npz")
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002
