# SPDX-License-Identifier: MIT
"""The paper's modal analysis in one command: figures 2 and 3, convergence, stability map, table.

All results are computed first, on a few processes. Then the figures and the table are written.
What cannot be computed is left out and named at the end on stderr. The exit status is then 1.
"""

from __future__ import annotations

import argparse
import csv
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, NoReturn

from pipedyn import plot
from pipedyn.models.chain import SPRING_RULES
from pipedyn.models.galerkin import BASES
from pipedyn.models.pipe import FLOWS, Pipe
from pipedyn.paper.analysis import (
    HIGHEST_SPEED,
    LEAST_HIGHEST,
    Case,
    Findings,
    gather,
    one_blas_thread,
)
from pipedyn.paper.report import HEADER, draw, report, table
from pipedyn.util import check

LARGEST_CHAIN = 1000
"""Segments: root loci at 181 speeds take 12 s."""

LARGEST_REDUCED = 200
"""Functions: root loci at 181 speeds take 18 s; more digits are not gained."""

MOST_PANELS = 5
"""Panels in a row: more than 5 at 2 inches each do not fit on a page."""

MOST_SPEEDS = 5001
"""Flow speeds of figures 2 and 3: steps of 0.02 up to the highest speed."""

MOST_WORKERS = 64
"""Processes: there are fewer than 100 models to compute."""

FORMATS = ("png", "pdf", "svg")


class _Parser(argparse.ArgumentParser):
    """Reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def _parsed(arguments: Sequence[str] | None) -> Case:
    parser = _Parser(
        prog="python -m pipedyn",
        description="Modal analysis of a pipe conveying fluid: articulated chains, reduced models "
        "and the continuous pipe. Writes root loci (figure 2 of the paper), frequencies against "
        "flow speed (figure 3), the convergence of the critical speed, a stability map and a table "
        "of critical speeds. Without options: the paper's case.",
        epilog="Units: L, mu_p + mu_f and EI are 1, and the flow speed is u = V L sqrt(mu_f / EI). "
        "Exit status: 0 if all went well; 1 if something could not be computed or written; then "
        "the rest is kept; 2 for bad arguments.",
        allow_abbrev=False,
    )
    add = parser.add_argument_group("pipe").add_argument
    for name, metavar, default, text in (
        ("beta", "B", 0.2, "mass ratio in [0, 1)"),
        ("gamma", "G", 0.0, "gravity; negative when the free end stands above the clamp"),
        ("alpha", "A", 1.0, "inlet coefficient of an aspirating pipe, A >= 0"),
        ("damping", "D", 0.0, "Kelvin-Voigt damping, D >= 0"),
    ):
        text = f"{text} (default: {default:g})"
        add(f"--{name}", type=float, default=default, metavar=metavar, help=text)
    add("--flow", choices=FLOWS, default="ejecting", help="direction (default: ejecting)")

    add = parser.add_argument_group("panels of figures 2 and 3").add_argument
    text = (
        f"spring rules of the chains, one row of panels each: {', '.join(SPRING_RULES)}; rayleigh "
        "is the paper's (default: rayleigh consistent)"
    )
    rules: dict[str, Any] = {"choices": SPRING_RULES, "default": ["rayleigh", "consistent"]}
    add("--springs", nargs="+", metavar="RULE", help=text, **rules)
    for name, metavar, sizes, largest, text in (
        ("chain", "N", [4, 8, 16], LARGEST_CHAIN, "segments"),
        ("reduced", "M", [2, 4, 8], LARGEST_REDUCED, "functions"),
    ):
        text = f"numbers of {text}, each from 1 to {largest} (default: {' '.join(map(str, sizes))})"
        several: dict[str, Any] = {"nargs": "+", "type": _size(largest), "default": sizes}
        add(f"--{name}", metavar=metavar, help=text, **several)
    add("--basis", choices=BASES, default="beam", help="of the reduced models (default: beam)")
    text = (
        f"highest flow speed, 0 < U <= {HIGHEST_SPEED:g} (default: 1.5 times the critical speed, "
        f"but at least {LEAST_HIGHEST:g})"
    )
    add("--highest", type=float, metavar="U", help=text)
    text = f"number of flow speeds, from 2 to {MOST_SPEEDS} (default: 181)"
    add("--speeds", type=int, default=181, metavar="COUNT", help=text)

    add = parser.add_argument_group("output").add_argument
    text = "folder to write to, made if it does not exist (default: figures)"
    add("--output", default="figures", metavar="FOLDER", help=text)
    add("--format", choices=FORMATS, default="png", help="of the figures (default: png)")
    text = "processes that share the work; 0: this one alone (default: %(default)s)"
    add("--workers", type=int, default=min(2, os.cpu_count() or 1), metavar="K", help=text)
    add("--quiet", action="store_true", help="show no progress on stderr")
    given = sys.argv[1:] if arguments is None else arguments
    try:
        return _checked(parser.parse_args([_positional(word) for word in given]))
    except (ValueError, OSError) as error:
        parser.error(str(error))


def _positional(word: str) -> str:
    """The word, a negative number after a space: argparse could take it for an option."""
    try:
        float(word)
    except ValueError:
        return word
    return f" {word}" if word.startswith("-") else word


def _size(largest: int) -> Callable[[str], int]:
    def size(text: str) -> int:
        text = text.strip()
        if not text.isdecimal() or not 1 <= int(text) <= largest:
            raise argparse.ArgumentTypeError(
                f"sizes must be whole numbers from 1 to {largest}, got {text!r}"
            )
        return int(text)

    return size


def _checked(given: argparse.Namespace) -> Case:
    pipe = Pipe(given.beta, given.gamma, given.flow, alpha=given.alpha, damping=given.damping)
    highest = given.highest
    if highest is not None:
        name = "argument --highest:"
        highest = check.real(name, highest, low=0.0, high=HIGHEST_SPEED, open_low=True)
    speeds = check.count("argument --speeds:", given.speeds, low=2, high=MOST_SPEEDS)
    workers = check.count("argument --workers:", given.workers, low=0, high=MOST_WORKERS)
    for name in ("chain", "reduced"):
        if len(set(getattr(given, name))) > MOST_PANELS:
            raise ValueError(f"argument --{name}: at most {MOST_PANELS} sizes fit a page")
    if not given.output.strip() or "\0" in given.output:
        raise ValueError(f"argument --output: must name a folder, got {given.output!r}")
    folder = Path(given.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"argument --output: cannot write to {str(folder)!r}: {reason}") from None
    return Case(
        pipe=pipe,
        springs=tuple(dict.fromkeys(given.springs)),
        chain_sizes=tuple(sorted(set(given.chain))),
        basis=given.basis,
        reduced_sizes=tuple(sorted(set(given.reduced))),
        highest=highest,
        speeds=speeds,
        output=folder,
        format=given.format,
        workers=workers,
        progress=not given.quiet,
    )


def _pool(workers: int) -> AbstractContextManager[Executor | None]:
    """Processes with one BLAS thread each; None without workers or where none can be started."""
    if workers > 0:
        try:
            spawn = multiprocessing.get_context("spawn")
            return ProcessPoolExecutor(workers, spawn, one_blas_thread)
        except (OSError, ImportError, NotImplementedError):  # a system without semaphores
            pass
    return nullcontext()


def write(case: Case, findings: Findings, figures: dict[str, plot.Figure]) -> list[Path]:
    """Write the table and the figures; what cannot be written is added to `findings.failures`.

    Returns:
        The paths of the files written.
    """

    def save_table(path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(HEADER)
            writer.writerows(table(findings))

    savers: dict[str, Callable[[Path], None]] = {"critical-speeds.csv": save_table}
    savers |= {f"{name}.{case.format}": figure.savefig for name, figure in figures.items()}
    paths = []
    for name, save in savers.items():
        path = case.output / name
        try:
            with plot.style():
                save(path)
            paths.append(path)
        except OSError as error:
            findings.failures.append(f"{path}: {error.strerror or error}")
    return paths


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    case = _parsed(arguments)
    with _pool(case.workers) as executor:
        findings = gather(case, executor)
    print(report(case, findings), flush=True)
    paths = write(case, findings, draw(case, findings))
    print("\nWritten: " + ", ".join(map(str, paths)))
    if findings.failures:
        missing = f"{len(findings.failures)} not computed or written, the first:"
        print(f"python -m pipedyn: {missing} {findings.failures[0]}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
