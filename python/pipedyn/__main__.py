# SPDX-License-Identifier: MIT
"""The paper's modal analysis in one command: figures 2 and 3, convergence, stability map, table.

Everything is gathered first, on a few processes, then drawn, then written. What cannot be computed
is left out, named at the end on stderr, and makes the exit status 1; the rest is kept.
"""

from __future__ import annotations

import argparse
import csv
import math
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NoReturn

import numpy as np

from pipedyn import plot
from pipedyn.models.chain import SPRING_RULES
from pipedyn.models.galerkin import BASES
from pipedyn.models.pipe import FLOWS, Pipe
from pipedyn.paper.analysis import HIGHEST_SPEED, LEAST_HIGHEST, Case, Findings, gather
from pipedyn.paper.report import HEADER, draw, report, table

LARGEST_CHAIN, LARGEST_REDUCED, MOST_PANELS = 1000, 200, 5
MOST_SPEEDS = 5001
FORMATS = ("png", "pdf", "svg")


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

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
        "Exit status: 0 if all went well; 1 if something could not be computed or written, and "
        "the rest is kept; 2 for bad arguments.",
        allow_abbrev=False,
    )
    add = parser.add_argument_group("pipe").add_argument
    add("--beta", type=float, default=0.2, metavar="B", help="mass ratio in [0, 1) (default: 0.2)")
    add(
        "--gamma",
        type=float,
        default=0.0,
        metavar="G",
        help="gravity; negative when the free end stands above the clamp (default: 0)",
    )
    add("--flow", choices=FLOWS, default="ejecting", help="direction (default: ejecting)")
    add(
        "--alpha",
        type=float,
        default=1.0,
        metavar="A",
        help="inlet coefficient of an aspirating pipe, A >= 0 (default: 1)",
    )
    add(
        "--damping",
        type=float,
        default=0.0,
        metavar="D",
        help="Kelvin-Voigt damping, D >= 0 (default: 0)",
    )
    add = parser.add_argument_group("panels of figures 2 and 3").add_argument
    add(
        "--springs",
        nargs="+",
        choices=SPRING_RULES,
        default=["rayleigh", "consistent"],
        metavar="RULE",
        help=f"spring rules of the chains, a row of panels each: {', '.join(SPRING_RULES)}; "
        "rayleigh is the paper's (default: rayleigh consistent)",
    )
    add(
        "--chain",
        nargs="+",
        type=_size(LARGEST_CHAIN),
        default=[4, 8, 16],
        metavar="N",
        help=f"numbers of segments, each from 1 to {LARGEST_CHAIN} (default: 4 8 16)",
    )
    add("--basis", choices=BASES, default="beam", help="of the reduced models (default: beam)")
    add(
        "--reduced",
        nargs="+",
        type=_size(LARGEST_REDUCED),
        default=[2, 4, 8],
        metavar="M",
        help=f"numbers of functions, each from 1 to {LARGEST_REDUCED} (default: 2 4 8)",
    )
    add(
        "--highest",
        type=float,
        metavar="U",
        help=f"highest flow speed, 0 < U <= {HIGHEST_SPEED:g} (default: half as much again as the "
        f"critical speed, but {LEAST_HIGHEST:g} at least)",
    )
    add(
        "--speeds",
        type=int,
        default=181,
        metavar="COUNT",
        help=f"number of flow speeds, from 2 to {MOST_SPEEDS} (default: 181)",
    )
    add = parser.add_argument_group("output").add_argument
    add(
        "--output",
        type=_folder,
        default=Path("figures"),
        metavar="FOLDER",
        help="folder to write to, made if need be (default: figures)",
    )
    add("--format", choices=FORMATS, default="png", help="of the figures (default: png)")
    add(
        "--workers",
        type=int,
        default=min(2, os.cpu_count() or 1),
        metavar="K",
        help="processes that share the work, 0 for none beside this one (default: %(default)s)",
    )
    add("--quiet", action="store_true", help="show no progress on stderr")
    given = sys.argv[1:] if arguments is None else arguments
    try:
        return _checked(parser.parse_args([_positional(word) for word in given]))
    except (ValueError, OSError) as error:
        parser.error(str(error))


def _positional(word: str) -> str:
    """A negative number that argparse would take for an option, so that it does not."""
    try:
        number = float(word)
    except ValueError:
        return word
    if word.startswith("-") and not math.isfinite(number):
        return f" {word}"
    if word.startswith("-") and "e" in word.lower():
        return np.format_float_positional(number, trim="0")
    return word


def _size(largest: int) -> Callable[[str], int]:
    def size(text: str) -> int:
        try:
            number = int(text)
        except ValueError:
            number = 0
        if not 1 <= number <= largest:
            raise argparse.ArgumentTypeError(
                f"sizes must be whole numbers from 1 to {largest}, got {text!r}"
            )
        return number

    return size


def _folder(text: str) -> Path:
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError(f"must name a folder, got {text!r}")
    return Path(text)


def _checked(given: argparse.Namespace) -> Case:
    pipe = Pipe(
        beta=given.beta,
        gamma=given.gamma,
        flow=given.flow,
        alpha=given.alpha,
        damping=given.damping,
    )
    highest, speeds, workers = given.highest, given.speeds, given.workers
    if highest is not None and not 0.0 < highest <= HIGHEST_SPEED:
        rule = f"must lie in (0, {HIGHEST_SPEED:g}]"
        raise ValueError(f"argument --highest: {rule}, got {highest:g}")
    if not 2 <= speeds <= MOST_SPEEDS:
        raise ValueError(f"argument --speeds: must be from 2 to {MOST_SPEEDS}, got {speeds}")
    if not 0 <= workers <= 64:
        raise ValueError(f"argument --workers: must be from 0 to 64, got {workers}")
    for name in ("chain", "reduced"):
        if len(set(getattr(given, name))) > MOST_PANELS:
            raise ValueError(f"argument --{name}: at most {MOST_PANELS} sizes fit a page")
    folder: Path = given.output
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


@contextmanager
def _pool(workers: int) -> Iterator[Executor | None]:
    """Processes with one BLAS thread each, or None where there are to be or can be none."""
    name = "OPENBLAS_NUM_THREADS"  # read when a worker imports numpy
    before = os.environ.get(name)
    with ExitStack() as stack:
        pool = None
        if workers > 0:
            os.environ[name] = "1"
            stack.callback(_restore, name, before)
            try:
                spawn = multiprocessing.get_context("spawn")
                pool = stack.enter_context(ProcessPoolExecutor(workers, spawn))
            except (OSError, ImportError, NotImplementedError):  # a system without semaphores
                pool = None
        yield pool


def _restore(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


def write(case: Case, findings: Findings, figures: dict[str, plot.Figure]) -> list[Path]:
    """The table and the figures as files; the paths written, what could not be in `failures`."""

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
