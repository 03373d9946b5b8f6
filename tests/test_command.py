# SPDX-License-Identifier: MIT
"""The command `pipedyn`: options that it must not take, a pipe in SI units."""

import csv
import math
import re
from dataclasses import replace

import pytest

import pipedyn as pp
import pipedyn.__main__ as command
from pipedyn.__main__ import main
from pipedyn.paper.analysis import Findings, Row
from pipedyn.paper.report import report

HOSE = ["--length", "0.45", "--bending-stiffness", "7.3e-3"]
MASSES = ["--pipe-mass", "0.19", "--fluid-mass", "0.032"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--output", ""], "argument --output: must name a folder, got ''"),
        (["--output", "  "], "argument --output: must name a folder, got '  '"),
        (["--output", "a\0b"], r"argument --output: must name a folder, got 'a\x00b'"),
        (["--output", "/dev/null/x"], "argument --output: cannot write to '/dev/null/x': "),
        (["--beta", "1"], "beta must lie in [0, 1), got 1.0"),
        (["--beta", "nan"], "beta must lie in [0, 1), got nan"),
        (["--gamma=-inf"], "gamma must lie in [-1e+06, 1e+06], got -inf"),
        (["--gamma=-1e300"], "gamma must lie in [-1e+06, 1e+06], got -1e+300"),
        (["--damping=-1e-3"], "damping must lie in [0, 1e+06], got -0.001"),
        (["--alpha=-nan"], "alpha must lie in [0, 1e+06], got nan"),
        (["--flow", "in"], "argument --flow: invalid choice: 'in'"),
        (["--springs", "stiff"], "argument --springs: invalid choice: 'stiff'"),
        (["--chain", "0"], "argument --chain: must be a whole number from 1 to 1000, got '0'"),
        (["--chain", *"123456"], "argument --chain: at most 5 sizes fit a page"),
        (["--reduced", "2.5"], "argument --reduced: must be a whole number from 1 to 200, got"),
        (["--highest", "0"], "argument --highest: must lie in (0, 100], got 0"),
        (["--highest", "nan"], "argument --highest: must lie in (0, 100], got nan"),
        (["--speeds", "1"], "argument --speeds: must be a whole number from 2 to 5001, got '1'"),
        (["--speeds", "9" * 30], "argument --speeds: must be a whole number from 2 to 5001, got"),
        (["--workers", "-1"], "argument --workers: must be a whole number from 0 to 64, got '-1'"),
        (["--format", "gif"], "argument --format: invalid choice: 'gif'"),
        (
            [*HOSE, *MASSES, "--gamma", "3"],
            "argument --gamma: is nondimensional and cannot be given with --length, which is in SI",
        ),
        (["--beta", "0.2", "--gravity", "9.8"], "argument --beta: is nondimensional and cannot be"),
        (["--gravity", "9.8"], "argument --length: must be given in SI units"),
        (HOSE, "argument --pipe-mass: must be given in SI units"),
        ([*HOSE, *MASSES, "--length", "-1"], "length must lie in (0, "),
        ([*HOSE, *MASSES, "--highest", "1e4"], "argument --highest: must lie in (0, 106.139], got"),
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
    assert re.fullmatch(rf"pipedyn: error: {re.escape(said)}.*\n", err), err
    assert words[0] == "--output" or not list(tmp_path.rglob("*.*"))


def case_of(words, tmp_path):
    return command._parse([*words, "--output", str(tmp_path)])


def test_a_pipe_in_si_units_is_that_of_from_si(tmp_path):
    more = ["--gravity", "-9.81", "--damping-time", "2e-3", "--alpha", "0.5"]
    pipe = case_of([*HOSE, *MASSES, *more], tmp_path).pipe
    assert pipe == pp.Pipe.from_si(
        length=0.45,
        bending_stiffness=7.3e-3,
        pipe_mass=0.19,
        fluid_mass=0.032,
        gravity=-9.81,
        damping_time=2e-3,
        alpha=0.5,
    )


def test_the_highest_speed_of_a_pipe_in_si_units_is_in_metres_per_second(tmp_path):
    case = case_of([*HOSE, *MASSES, "--highest", "7.5"], tmp_path)
    assert case.pipe.speed_si(case.highest) == pytest.approx(7.5, rel=1e-14)
    assert case_of(["--highest", "7.5"], tmp_path).highest == 7.5


def test_the_table_of_a_pipe_in_si_units_is_in_metres_per_second_and_hertz(tmp_path):
    """The numbers come from omega / (2 pi T) and V = u sqrt(EI / mu_f) / L by hand."""
    case = case_of([*HOSE, *MASSES], tmp_path)
    exact = pp.critical_speed(pp.Continuum(case.pipe))
    chain = pp.critical_speed(pp.Chain(case.pipe, 4))
    findings = Findings(highest=8.0, exact=exact, rows=[Row("chain", "rayleigh", 4, chain)])
    speed = exact.speed * math.sqrt(7.3e-3 / 0.032) / 0.45
    hertz = exact.frequency / (0.45**2 * math.sqrt(0.222 / 7.3e-3)) / (2.0 * math.pi)
    said = report(case, findings)
    assert "V_c (m/s)  f_c (Hz)" in said
    assert f"{speed:.7f}  {hertz:.6f}  flutter" in said
    command.save_table(case, findings, tmp_path / "critical-speeds.csv")
    with (tmp_path / "critical-speeds.csv").open(encoding="utf-8") as stream:
        (first, *_) = csv.DictReader(stream)
    assert float(first["speed (m/s)"]) == pytest.approx(speed, rel=1e-14)
    assert float(first["frequency (Hz)"]) == pytest.approx(hertz, rel=1e-14)
    assert float(first["speed"]) == exact.speed
    plain = replace(case, pipe=replace(case.pipe, scales=None))
    assert f"{exact.speed:.7f}" in report(plain, findings)
