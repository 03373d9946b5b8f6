# SPDX-License-Identifier: MIT
"""The paper's modal analysis in one command: figures 2 and 3, convergence, stability map, table.

There are no subcommands, since Python answers other questions about a model in as few words.

Results are computed on a few threads, and then written. Results that cannot be computed are left
out and named at the end on stderr, and the exit status is then 1.
"""

from __future__ import annotations

import argparse
import csv
import os
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from pipedyn import plot
from pipedyn.models.chain import SPRING_RULES
from pipedyn.models.galerkin import BASES
from pipedyn.models.pipe import BEAM, FLOWS, TUBE, Pipe
from pipedyn.paper.analysis import HIGHEST_SPEED, LEAST_HIGHEST, Findings, Options, compute_findings
from pipedyn.paper.report import FIGURES, HEADINGS, Draw, report, si_header, table
from pipedyn.util import check
from pipedyn.util.files import replacing

PROGRAM = "pipedyn"

NONDIMENSIONAL_OPTIONS = {
    "beta": ("B", 0.2, "mass ratio in [0, 1)"),
    "gamma": ("G", 0.0, "gravity; negative when the free end stands above the clamp"),
    "damping": ("D", 0.0, "Kelvin-Voigt damping, D >= 0"),
}
"""Options for nondimensional numbers by name: metavariable, default and help."""

SI_OPTIONS = {
    "length": ("L", None, "length, m"),
    "bending-stiffness": ("EI", None, "bending stiffness, N m^2"),
    "pipe-mass": ("M", None, "mass of the pipe, kg/m"),
    "fluid-mass": ("M", None, "mass of the fluid, kg/m"),
    "outer-diameter": ("D", None, "of a tube, m, in place of stiffness and masses"),
    "inner-diameter": ("D", None, "of a tube, m"),
    "youngs-modulus": ("E", None, "of a tube's wall, Pa"),
    "density": ("RHO", None, "of a tube's wall, kg/m^3"),
    "fluid-density": ("RHO", None, "of the fluid in a tube, kg/m^3"),
    "gravity": ("G", 9.81, "m/s^2; negative when the free end stands above the clamp"),
    "damping-time": ("T", 0.0, "stress is E (strain + T d strain / dt), s"),
}
"""Options for quantities in SI units by name: metavariable, default and help. Those without a
default must be given: the length and all of `BEAM`, or the length and all of `TUBE`."""


def add_pipe_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the pipe; options with a unit are None if they are not given."""
    usual = "(default: %(default)s)"
    groups = (
        ("nondimensional pipe", None, NONDIMENSIONAL_OPTIONS),
        ("pipe in SI units", "Speeds are then in m/s, frequencies in Hz.", SI_OPTIONS),
    )
    for title, text, options in groups:
        add = parser.add_argument_group(title, text).add_argument
        for name, (metavar, default, words) in options.items():
            words += "" if default is None else f" (default: {default:g})"
            add(f"--{name}", type=float, metavar=metavar, help=words)
    add = parser.add_argument_group("pipe, in either units").add_argument
    text = f"end coefficient, A >= 0: of nozzle or inlet {usual}"
    add("--alpha", type=float, default=1.0, metavar="A", help=text)
    add("--flow", choices=FLOWS, default="ejecting", help=f"direction {usual}")


def pop_pipe(given: dict[str, Any]) -> Pipe:
    """Makes the pipe from its options, and removes the options from `given`.

    Raises:
        ValueError: if numbers are out of range, if options in both kinds of units are given, or if
            there are too few.
    """
    both = {name: given.pop(name) for name in ("flow", "alpha")}
    numbers, measured = (
        {name: value for name in names if (value := given.pop(name.replace("-", "_"))) is not None}
        for names in (NONDIMENSIONAL_OPTIONS, SI_OPTIONS)
    )
    if not measured:
        defaults = {name: default for name, (_, default, _) in NONDIMENSIONAL_OPTIONS.items()}
        return Pipe(**(defaults | numbers), **both)
    if numbers:
        raise ValueError(
            f"argument --{next(iter(numbers))}: is nondimensional and cannot be given with "
            f"--{next(iter(measured))}, which is in SI units"
        )
    of_names = {name.replace("-", "_"): value for name, value in measured.items()}
    of_tube = [name for name in TUBE if name in of_names]
    if of_tube and (twice := [name for name in BEAM if name in of_names]):
        words = (f"--{name.replace('_', '-')}" for name in (twice[0], of_tube[0]))
        raise ValueError("argument {}: cannot be given with {}, of a tube".format(*words))
    for name in ("length", *(TUBE if of_tube else BEAM)):
        if name not in of_names:
            raise ValueError(f"argument --{name.replace('_', '-')}: must be given in SI units")
    return (Pipe.from_tube if of_tube else Pipe.from_si)(**of_names, **both)


class _Parser(argparse.ArgumentParser):
    """A parser of arguments that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def _parse(arguments: Sequence[str] | None) -> Options:
    parser = _Parser(
        prog=PROGRAM,
        description="Modal analysis of a pipe conveying fluid: articulated chains, reduced models "
        "and the continuous pipe. Writes root loci (figure 2 of the paper), frequencies against "
        "flow speed (figure 3), the convergence of the critical speed, a stability map and a table "
        "of critical speeds. Without options: the paper's case.",
        epilog="Nondimensional: L, mu_p + mu_f and EI are 1, and the flow speed is "
        "u = V L sqrt(mu_f / EI). "
        "Exit status: 0 if all went well; 1 if something could not be computed or written; then "
        "the rest is kept; 2 for bad arguments.",
        allow_abbrev=False,
    )
    usual = "(default: %(default)s)"
    add_pipe_options(parser)

    add = parser.add_argument_group("panels of figures 2 and 3").add_argument
    rules: dict[str, Any] = {"choices": SPRING_RULES, "default": ["rayleigh", "consistent"]}
    text = (
        f"spring rules of the chains, one row of panels each: {', '.join(SPRING_RULES)}; rayleigh "
        "is the paper's (default: rayleigh consistent)"
    )
    add("--springs", nargs="+", metavar="RULE", help=text, **rules)
    for name, metavar, sizes, largest, text in (  # the largest models take 12 and 18 s
        ("chain", "N", [4, 8, 16], 1000, "segments"),
        ("reduced", "M", [2, 4, 8], 200, "functions"),
    ):
        text = f"numbers of {text}, each from 1 to {largest} (default: {' '.join(map(str, sizes))})"
        several: dict[str, Any] = {"nargs": "+", "type": partial(_whole_number, 1, largest)}
        several |= {"dest": f"{name}_sizes", "default": sizes}
        add(f"--{name}", metavar=metavar, help=text, **several)
    add("--basis", choices=BASES, default="beam", help=f"of the reduced models {usual}")
    text = (
        f"highest flow speed, 0 < u <= {HIGHEST_SPEED:g}; in m/s of a pipe in SI units (default: "
        f"1.5 times the critical speed, but at least u = {LEAST_HIGHEST:g})"
    )
    add("--highest", type=float, metavar="U", help=text)
    text = f"number of flow speeds, from 2 to 5001 {usual}"  # steps of 0.02 up to the highest
    add("--speeds", type=partial(_whole_number, 2, 5001), default=181, metavar="COUNT", help=text)

    add = parser.add_argument_group("output").add_argument
    text = f"folder to write to, made if it does not exist {usual}"
    add("--output", default="figures", metavar="FOLDER", help=text)
    add("--format", choices=("png", "pdf", "svg"), default="png", help=f"of the figures {usual}")
    workers = min(2, os.cpu_count() or 1)
    text = f"threads that share the work; 0: the command's own alone {usual}"
    add("--workers", type=partial(_whole_number, 0, 64), default=workers, metavar="K", help=text)
    add("--quiet", dest="progress", action="store_false", help="show no progress on stderr")

    given = vars(parser.parse_args(arguments))
    try:
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            pipe = pop_pipe(given)
        for one in seen:
            _say(f"warning: {one.message}".partition(" (warnings.")[0])
        if given["highest"] is not None:
            unit = 1.0 if pipe.scales is None else pipe.scales.speed
            bounds: dict[str, Any] = {"low": 0.0, "high": HIGHEST_SPEED * unit, "open_low": True}
            given["highest"] = check.real("argument --highest:", given["highest"], **bounds) / unit
        for name in ("chain", "reduced"):
            sizes = given[f"{name}_sizes"] = sorted(set(given[f"{name}_sizes"]))
            if len(sizes) > 5:  # panels of 2 inches
                raise ValueError(f"argument --{name}: at most 5 sizes fit a page")
        given["springs"] = list(dict.fromkeys(given["springs"]))
        given["output"] = _writable(given["output"])
    except (ValueError, OSError) as error:
        parser.error(str(error))
    return Options(pipe=pipe, **given)


def _whole_number(low: int, high: int, text: str) -> int:
    """The whole number that a word of the command line stands for, refused outside an interval."""
    text = text.strip()
    if not text.isdecimal() or not low <= int(text) <= high:
        rule = f"must be a whole number from {low} to {high}"
        raise argparse.ArgumentTypeError(f"{rule}, got {text!r}")
    return int(text)


def _writable(name: str) -> Path:
    """The folder of a name, made if it does not exist; refused if it cannot be written to."""
    if not name.strip() or "\0" in name:
        raise ValueError(f"argument --output: must name a folder, got {name!r}")
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"argument --output: cannot write to {name!r}: {reason}") from None


Saver: TypeAlias = Callable[[Options, Findings, Path], None]


def save_table(case: Options, findings: Findings, path: Path) -> None:
    """Saves the table as comma-separated values."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(HEADINGS + si_header(case.pipe))
        writer.writerows(table(case.pipe, findings))


def save_figure(draw: Draw, case: Options, findings: Findings, path: Path) -> None:
    """Saves a figure."""
    with plot.style():
        draw(case, findings).savefig(path)


def write_files(case: Options, findings: Findings, savers: dict[str, Saver]) -> list[Path]:
    """Writes files and returns their paths; failures are added to `findings.failures`."""
    paths = []
    for name, save in savers.items():
        path = case.output / name
        try:
            with replacing(path) as beside:
                save(case, findings, beside)
            paths.append(path)
        except OSError as error:
            findings.failures.append(f"{path}: {error.strerror or error}")
    return paths


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status."""
    case = _parse(arguments)
    # Nine tenths of the time are spent in the core, which releases the lock of the interpreter. The
    # executor is not closed, so that Ctrl-C does not wait for its threads.
    findings = compute_findings(case, ThreadPoolExecutor(case.workers) if case.workers else None)
    savers: dict[str, Saver] = {"critical-speeds.csv": save_table}
    for name, draw in FIGURES.items():
        savers[f"{name}.{case.format}"] = partial(save_figure, draw)
    paths = write_files(case, findings, savers)
    try:
        print(report(case, findings))
        print("\nWritten: " + ", ".join(map(str, paths)), flush=True)
    except OSError as error:
        findings.failures.insert(0, f"the report: {error.strerror or error}")
    if findings.failures:
        missing = f"{len(findings.failures)} not computed or written, the first:"
        _say(f"{missing} {findings.failures[0]}")
        return 1
    return 0


def _say(line: str) -> None:
    """Writes a line to stderr, if that is possible."""
    with suppress(OSError):
        print(f"{PROGRAM}: {line}", file=sys.stderr, flush=True)


def program() -> NoReturn:
    """Runs the command as a program, which ends with the exit status of the command.

    Ctrl-C ends it at once with the status 130, even if threads are still at work. If the report
    cannot be written, because the reader of the pipe has gone, the status is 1.
    """
    try:
        status: Any = main()
    except SystemExit as stopped:  # --help, or bad arguments
        status = stopped.code
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        _say("interrupted")
        os._exit(128 + signal.SIGINT)
    stdout: Any = sys.stdout  # None in a program without a terminal
    try:
        if stdout is not None:
            stdout.flush()
    except OSError:
        os._exit(status or 1)  # at a normal exit Python would try again and print an error
    sys.exit(status)


if __name__ == "__main__":
    program()
