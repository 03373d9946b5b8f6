# SPDX-License-Identifier: MIT
"""What importing the package brings along."""

import subprocess
import sys

import pipedyn as pd

PROGRAM = """
import sys
import pipedyn
import pipedyn.stability
print(",".join({"matplotlib", "tqdm", "IPython"} & set(sys.modules)))
"""


def test_importing_the_package_brings_neither_pictures_nor_progress_bars():
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""
    assert done.stderr == ""


def test_every_name_of_the_package_is_there_and_documented():
    for name in pd.__all__:
        assert getattr(pd, name).__doc__, name


def test_progress_needs_no_progress_bar(monkeypatch, capsys):
    """Without tqdm a plain count goes to stderr."""
    monkeypatch.setitem(sys.modules, "tqdm", None)
    pd.root_loci(pd.Chain(pd.Pipe(0.2), 3), [0.0, 1.0, 2.0], count=2, progress=True)
    err = capsys.readouterr().err
    assert "root loci" in err
    assert "2/2" in err
