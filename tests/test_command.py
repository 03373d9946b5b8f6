# SPDX-License-Identifier: MIT
"""The command `python -m pipedyn`, given what it must not take."""

import re

import pytest

from pipedyn.__main__ import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--output", ""], "argument --output: must name a folder, got ''"),
        (["--output", "  "], "argument --output: must name a folder, got '  '"),
        (["--output", "a\0b"], r"argument --output: must name a folder, got 'a\x00b'"),
        (["--output", "/dev/null/x"], "argument --output: cannot write to '/dev/null/x': "),
        (["--beta", "1"], "beta must lie in [0, 1), got 1.0"),
        (["--beta", "nan"], "beta must lie in [0, 1), got nan"),
        (["--gamma", "-inf"], "gamma must lie in [-1e+06, 1e+06], got -inf"),
        (["--gamma", "-1e300"], "gamma must lie in [-1e+06, 1e+06], got -1e+300"),
        (["--damping", "-1e-3"], "damping must lie in [0, 1e+06], got -0.001"),
        (["--alpha", "-nan"], "alpha must lie in [0, 1e+06], got nan"),
        (["--flow", "in"], "argument --flow: invalid choice: 'in'"),
        (["--springs", "stiff"], "argument --springs: invalid choice: 'stiff'"),
        (["--chain", "0"], "argument --chain: must be a whole number from 1 to 1000, got '0'"),
        (["--chain", *"123456"], "argument --chain: at most 5 sizes fit a page"),
        (
            ["--reduced", "2.5"],
            "argument --reduced: must be a whole number from 1 to 200, got",
        ),
        (["--highest", "0"], "argument --highest: must lie in (0, 100], got 0"),
        (["--highest", "nan"], "argument --highest: must lie in (0, 100], got nan"),
        (["--speeds", "1"], "argument --speeds: must be a whole number from 2 to 5001, got '1'"),
        (
            ["--speeds", "9" * 30],
            "argument --speeds: must be a whole number from 2 to 5001, got",
        ),
        (["--workers", "-1"], "argument --workers: must be a whole number from 0 to 64, got '-1'"),
        (["--format", "gif"], "argument --format: invalid choice: 'gif'"),
        (["--bet", "0.3"], "unrecognized arguments: --bet 0.3"),
    ],
    ids=lambda words: " ".join(words)[:40] if isinstance(words, list) else "",
)
def test_a_bad_option_ends_the_command_with_one_line(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert stopped.value.code == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(rf"python -m pipedyn: error: {re.escape(said)}.*\n", err), err
    assert words[0] == "--output" or not list(tmp_path.rglob("*.*"))
