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
import textwrap
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from pipedyn import plot
from pipedyn.chain import SPRING_RULES, Chain
from pipedyn.continuum import Continuum
from pipedyn.critical import CriticalSpeed, Crossing, NoCrossing, critical_speed, crossings
from pipedyn.galerkin import BASES, Galerkin
from pipedyn.modal import RootLoci, root_loci
from pipedyn.model import Model
from pipedyn.pipe import FLOWS, Pipe
from pipedyn.progress import track
from pipedyn.stability import StabilityCurve, stability_curve

BRANCHES = 4
CHAIN_LADDER = (2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
REDUCED_LADDER = (2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 22, 32, 46)
"""Sizes of the convergence picture, beside those of the panels."""

LARGEST_CHAIN, LARGEST_REDUCED, MOST_PANELS = 1000, 200, 5
LEAST_HIGHEST, HIGHEST_SPEED, MOST_SPEEDS = 8.0, 100.0, 5001
FORMATS = ("png", "pdf", "svg")

MAP_GAMMAS = (-10.0, 0.0, 10.0, 100.0)
MAP_BETAS = np.linspace(0.01, 0.98, 25)
MAP_SPEEDS = 20.0, 30.0
"""Highest speed of the map, and how far it may be raised to hold the case itself."""
MAP_JUMP, MAP_STEP = 0.04, 0.002
"""Where boundaries jump by more than this part of the highest speed, steps in beta are halved, down
to MAP_STEP."""


@dataclass(frozen=True)
class Case:
    """What was asked for on the command line; highest None: chosen from the critical speed."""

    pipe: Pipe
    springs: tuple[str, ...]
    chain_sizes: tuple[int, ...]
    basis: str
    reduced_sizes: tuple[int, ...]
    highest: float | None
    speeds: int
    output: Path
    format: str
    workers: int
    progress: bool


@dataclass(frozen=True)
class Row:
    """One line of the table: a model and its critical speed, or a remark why there is none."""

    kind: str
    family: str
    size: int
    critical: CriticalSpeed | None
    remark: str = ""


@dataclass
class Findings:
    """All that the pictures and the table show; what failed is missing and named in `failures`.

    Attributes:
        highest: end of the speeds in figures 2 and 3.
        exact: critical speed of the continuous pipe; None with a remark that says why.
        crossings: passages of the continuous pipe up to `highest`.
        benchmark: root loci of the continuous pipe.
        panels: titles and root loci of the models, a list for each row of panels.
        rows: the table, without the continuous pipe.
        curves: stability over beta, by gamma.
        map_error: largest distance of the map's boundaries from the continuous pipe's.
        failures: what could not be computed, and why.
    """

    highest: float
    exact: CriticalSpeed | None = None
    remark: str = ""
    crossings: tuple[Crossing, ...] = ()
    benchmark: RootLoci | None = None
    panels: list[list[tuple[str, RootLoci | None]]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    curves: dict[float, StabilityCurve] = field(default_factory=dict)
    map_error: float = 0.0
    failures: list[str] = field(default_factory=list)


# -------------------------------------------------------------------------------- command line


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
        type=Path,
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
    """-1e3 as -1000.0: argparse takes a negative number with an exponent for an option."""
    try:
        if word.startswith("-") and "e" in word.lower():
            return np.format_float_positional(float(word), trim="0")
    except ValueError:
        pass
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


# -------------------------------------------------------------------------------------- gather


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


Job = Callable[[], Any]


def _outcomes(jobs: Sequence[Job], executor: Executor | None) -> Iterator[Any]:
    """What each job gave, or the exception that it raised, in order."""
    futures = [None if executor is None else executor.submit(job) for job in jobs]
    for job, future in zip(jobs, futures, strict=True):
        try:
            yield job() if future is None else _result(job, future)
        except Exception as error:
            yield error


def _result(job: Job, future: Future[Any]) -> Any:
    """The future's result; where its processes died, the job is done here."""
    try:
        return future.result()
    except BrokenExecutor:
        return job()


def gather(case: Case, executor: Executor | None = None) -> Findings:
    """Everything the pictures and the table show."""
    exact = Continuum(case.pipe)
    (first,) = _outcomes([partial(critical_speed, exact)], None)
    critical = first if isinstance(first, CriticalSpeed) else None
    findings = Findings(_highest(case, critical), critical)
    if critical is None:
        findings.remark = _remark(first)
        if not isinstance(first, NoCrossing):
            findings.failures.append(f"critical speed, continuous pipe: {findings.remark}")

    speeds = np.linspace(0.0, findings.highest, case.speeds)
    panels, families = _panels(case), _families(case)
    pictured = [model for row in panels for _, model in row]
    jobs: list[Job] = [
        partial(root_loci, exact, speeds, BRANCHES),
        partial(crossings, exact, findings.highest),
        *(partial(root_loci, model, speeds, min(BRANCHES, model.dof)) for model in pictured),
        *(partial(critical_speed, model) for _, _, model in families),
    ]
    every = track(_outcomes(jobs, executor), len(jobs), "models", case.progress)
    outcomes = iter(list(every))

    def next_of(what: str) -> tuple[Any, str]:
        """The next outcome, or None and why; a failure is noted."""
        outcome = next(outcomes)
        if not isinstance(outcome, Exception):
            return outcome, ""
        if not isinstance(outcome, NoCrossing):
            findings.failures.append(f"{what}: {_remark(outcome)}")
        return None, _remark(outcome)

    findings.benchmark, _ = next_of("root loci, continuous pipe")
    findings.crossings = next_of("crossings, continuous pipe")[0] or ()
    findings.panels = [
        [(title, next_of(f"root loci, {title}")[0]) for title, _ in row] for row in panels
    ]
    findings.rows = [
        Row(kind, family, model.dof, *next_of(f"critical speed, {kind}, {family}, {model.dof}"))
        for kind, family, model in families
    ]
    others = sorted({*MAP_GAMMAS} - {case.pipe.gamma}, reverse=True)
    gammas = [case.pipe.gamma, *others]
    for gamma in track(gammas, len(gammas), "stability map", case.progress):
        pipe = replace(case.pipe, gamma=gamma)
        try:
            curve, difference = mapped(pipe, _top(critical), executor)
        except BrokenExecutor:
            executor = None
            curve, difference = mapped(pipe, _top(critical), executor)
        findings.curves[gamma] = curve
        findings.map_error = max(findings.map_error, difference)
        if math.isinf(difference):
            what = f"stability map, gamma = {gamma:g}"
            findings.failures.append(f"{what}: boundaries differ from the continuous pipe's")
        findings.failures += [
            f"stability map, gamma = {gamma:g}, beta = {failure.value:g}: {_remark(failure.error)}"
            for failure in curve.failures
        ]
    return findings


def _highest(case: Case, critical: CriticalSpeed | None) -> float:
    if case.highest is not None:
        return case.highest
    wanted = 0.0 if critical is None else math.ceil(1.5 * critical.speed)
    return float(min(max(wanted, LEAST_HIGHEST), HIGHEST_SPEED))


def _top(critical: CriticalSpeed | None) -> float:
    """End of the map's speeds: low where the pipe loses stability by the least flow."""
    usual, farthest = MAP_SPEEDS
    if critical is None:
        return usual
    if critical.speed < 1.0:
        return 5.0 * critical.speed or 1.0
    return min(max(usual, 1.1 * critical.speed), farthest)


def _remark(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, NoCrossing) else f"{type(error).__name__}: {text}"


def _panels(case: Case) -> list[list[tuple[str, Model]]]:
    """Title and model of each panel: a row for each spring rule, and one for the basis."""
    rows: list[list[tuple[str, Model]]] = []
    for rule in case.springs:
        named = "rayleigh (the paper's)" if rule == "rayleigh" else f"{rule} springs"
        chains = [Chain(case.pipe, n, springs=rule) for n in case.chain_sizes]
        rows.append([(f"chain, n = {chain.dof}, {named}", chain) for chain in chains])
    rows.append(
        [
            (f"reduced, m = {m}, {case.basis} basis", Galerkin(case.pipe, m, case.basis))
            for m in case.reduced_sizes
        ]
    )
    return rows


def _families(case: Case) -> list[tuple[str, str, Model]]:
    """Kind, rule or basis, and model of each line of the table but the first."""
    chains = sorted({*CHAIN_LADDER, *case.chain_sizes})
    reduced = sorted({*REDUCED_LADDER, *case.reduced_sizes})
    return [
        *(("chain", k, Chain(case.pipe, n, springs=k)) for k in SPRING_RULES for n in chains),
        *(("reduced", k, Galerkin(case.pipe, m, k)) for k in BASES for m in reduced),
    ]


def mapped(pipe: Pipe, top: float, executor: Executor | None) -> tuple[StabilityCurve, float]:
    """All passages over beta, and how far they are from the continuous pipe's where compared.

    Legendre functions enough for the highest speed stand in for the continuous pipe, and take a
    third of its time; at three values of beta both are computed.
    """
    end = 1.02 * top
    size = math.ceil(0.8 * top) + 4

    def stand_in(beta: float) -> Galerkin:
        return Continuum(replace(pipe, beta=beta)).frozen(size)

    def continuous(beta: float) -> Continuum:
        return Continuum(replace(pipe, beta=beta))

    curve = stability_curve(stand_in, MAP_BETAS, max_speed=end, executor=executor)
    few = slice(None, None, MAP_BETAS.size // 2)
    exact = stability_curve(continuous, MAP_BETAS[few], max_speed=end, executor=executor)
    difference = _difference(curve.crossings[few], exact)
    while True:
        between = [
            0.5 * (curve.values[i] + curve.values[i + 1])
            for i, (left, right) in enumerate(pairwise(curve.crossings))
            if curve.values[i + 1] - curve.values[i] > MAP_STEP
            and _jumps(left, right, MAP_JUMP * top)
        ]
        if not between:
            return curve, difference
        more = stability_curve(stand_in, between, max_speed=end, executor=executor)
        curve = _merged(curve, more)


def _jumps(left: Sequence[Crossing], right: Sequence[Crossing], most: float) -> bool:
    a, b = plot.boundaries(left), plot.boundaries(right)
    pairs = zip(a, b, strict=False)
    return len(a) != len(b) or any(abs(p.speed - q.speed) > most for p, q in pairs)


def _difference(found: Sequence[Sequence[Crossing]], exact: StabilityCurve) -> float:
    """Largest distance of boundaries of stability, in speed; infinite where not the same ones."""
    failed = {failure.index for failure in exact.failures}
    largest = 0.0
    for i, (ours, theirs) in enumerate(zip(found, exact.crossings, strict=True)):
        a, b = plot.boundaries(ours), plot.boundaries(theirs)
        if i in failed:
            continue
        if len(a) != len(b):
            return math.inf
        largest = max([largest, *(abs(p.speed - q.speed) for p, q in zip(a, b, strict=True))])
    return largest


def _merged(a: StabilityCurve, b: StabilityCurve) -> StabilityCurve:
    values = np.concatenate([a.values, b.values])
    order = np.argsort(values)
    places = np.argsort(order)
    critical, found = a.critical + b.critical, a.crossings + b.crossings
    failures = [*a.failures, *(replace(f, index=f.index + a.values.size) for f in b.failures)]
    moved = [replace(failure, index=int(places[failure.index])) for failure in failures]
    return StabilityCurve(
        values[order],
        tuple(critical[i] for i in order),
        tuple(found[i] for i in order),
        tuple(sorted(moved, key=lambda failure: failure.index)),
    )


# ---------------------------------------------------------------------------------------- draw


def draw(case: Case, findings: Findings) -> dict[str, plot.Figure]:
    """The four figures by file name."""
    with plot.style():
        return {
            "figure-2-root-loci": _figure_2(case, findings),
            "figure-3-frequencies": _figure_3(case, findings),
            "convergence": _convergence(case, findings),
            "stability-map": _map(case, findings),
        }


def _figure_2(case: Case, findings: Findings) -> plot.Figure:
    figure, axes = _grid(case, findings)
    for ax, loci in _filled(axes, findings):
        plot.root_loci(ax, loci, findings.benchmark, findings.highest)
    _labelled(axes)
    left, right, top = _ranges(findings)
    axes[0, 0].set_xlim(left, right)
    axes[0, 0].set_ylim(-0.03 * top, 1.04 * top)
    plot.colour_bar(figure, axes, plot.SPEED_LABEL)
    return figure


def _figure_3(case: Case, findings: Findings) -> plot.Figure:
    figure, axes = _grid(case, findings, "; dotted line: its critical speed")
    left, right, top = _ranges(findings)
    for ax, loci in _filled(axes, findings):
        plot.frequencies(ax, loci, findings.benchmark, max(-left, right))
        if findings.exact is not None:
            ax.axvline(findings.exact.speed, color="0.4", linestyle=":", linewidth=0.9, zorder=0.6)
    _labelled(axes)
    axes[0, 0].set_xlim(-0.02 * findings.highest, 1.02 * findings.highest)
    axes[0, 0].set_ylim(-0.03 * top, 1.04 * top)
    plot.colour_bar(figure, axes, f"{plot.REAL_LABEL}; unstable: black outline, onset: diamond")
    return figure


def _grid(case: Case, findings: Findings, more: str = "") -> tuple[plot.Figure, Any]:
    rows, columns = len(findings.panels), max(len(row) for row in findings.panels)
    figure, axes = plot.panels(rows, columns, 1.5 + 2.05 * columns, 0.7 + 2.1 * rows)
    title = _heading(case.pipe)
    if findings.benchmark is not None:
        step = findings.benchmark.speeds[plot.dot_stride(findings.benchmark)]
        title += f"\nblack dots: continuous pipe, at steps of {step:.3g} in $u$"
        title += more if findings.exact is not None else ""
    figure.suptitle(title, fontsize=9.0)
    return figure, axes


def _filled(axes: Any, findings: Findings) -> Iterator[tuple[Any, RootLoci]]:
    """Axes with their loci; the others are hidden, or say that there is nothing to show."""
    for panels, row in zip(findings.panels, axes, strict=True):
        for ax in row[len(panels) :]:
            ax.set_visible(False)
        for ax, (title, loci) in zip(row, panels, strict=False):
            ax.set_title(title)
            if loci is None:
                ax.text(0.5, 0.5, "not computed", transform=ax.transAxes, ha="center")
            else:
                yield ax, loci


def _labelled(axes: Any) -> None:
    """Labels at the left, and below the lowest panel of each column, only."""
    for (i, j), ax in np.ndenumerate(axes):
        lowest = not any(below.get_visible() for below in axes[i + 1 :, j])
        ax.tick_params(labelbottom=lowest)
        if not lowest:
            ax.set_xlabel("")
        if j > 0:
            ax.set_ylabel("")


def _ranges(findings: Findings) -> tuple[float, float, float]:
    """Least and greatest real part and greatest |Im| to show.

    They hold every panel, unless one reaches far beyond the benchmark.
    """
    every = [loci for row in findings.panels for _, loci in row if loci is not None]
    if findings.benchmark is not None:
        every.insert(0, findings.benchmark)
    if not every:
        return -1.0, 1.0, 1.0
    values = [np.concatenate([loci.eigenvalues, loci.partners]) for loci in every]
    left, right = float(np.nanmin(values[0].real)), float(np.nanmax(values[0].real))
    top, room = float(np.nanmax(values[0].imag)), right - left
    left = max(left - room, min(float(np.nanmin(v.real)) for v in values))
    right = min(right + room, max(float(np.nanmax(v.real)) for v in values))
    top = min(1.5 * top, max(float(np.nanmax(v.imag)) for v in values))
    margin = 0.04 * max(right - left, 1.0)
    return left - margin, right + margin, max(top, 1.0)


def _convergence(case: Case, findings: Findings) -> plot.Figure:
    figure, axes = plot.panels(1, 1, 6.4, 5.2)
    ax = axes[0, 0]
    if findings.exact is None:
        plot.notice(ax, findings.remark)
    else:
        plot.convergence(ax, _by_family(findings), findings.exact)
    sentence = textwrap.fill(verdict(findings), 105).replace("-", "\u2212")
    ax.set_title(f"{_heading(case.pipe)}\n{sentence}", loc="left")
    return figure


def _map(case: Case, findings: Findings) -> plot.Figure:
    figure, axes = plot.panels(1, 1, 6.4, 4.8)
    ax = axes[0, 0]
    curves = {rf"$\gamma = {gamma:g}$": curve for gamma, curve in findings.curves.items()}
    plot.stability_map(ax, curves, _top(findings.exact), findings.exact)
    ax.set_xlim(0.0, 1.0)
    ax.set_title(f"Boundaries of stability of the continuous pipe, {_flow(case.pipe)}")
    return figure


def _heading(pipe: Pipe) -> str:
    return rf"$\beta = {pipe.beta:g}$, $\gamma = {pipe.gamma:g}$, {_flow(pipe)}"


def _flow(pipe: Pipe) -> str:
    inlet = rf" ($\alpha = {pipe.alpha:g}$)" if pipe.flow == "aspirating" else ""
    damped = rf"damping $\delta = {pipe.damping:g}$" if pipe.damping else "undamped"
    return f"{pipe.flow}{inlet}, {damped}"


# --------------------------------------------------------------------------------------- write


def verdict(findings: Findings) -> str:
    """What becomes of the paper's spring rule, in one sentence."""
    exact = findings.exact
    if exact is None:
        return "There is no critical speed of the continuous pipe to compare with."
    if exact.speed == 0.0:
        return "The pipe is unstable from the smallest flow on: there is nothing to converge to."
    fitted = plot.trend(_by_family(findings)["rayleigh"], exact)
    if fitted.law == "flat":
        sizes = ", ".join(f"{size:g}" for size in fitted.sizes)
        return (
            "The paper's spring rule (rayleigh) does not converge to the continuous pipe: its "
            f"critical speed tends to {exact.speed * (1.0 + fitted.limit):.5g}, "
            f"{100.0 * fitted.limit:+.2f} % from the exact {exact.speed:.5g} (extrapolated from "
            f"n = {sizes})."
        )
    return "Where the paper's spring rule (rayleigh) leads cannot be told from the sizes computed."


def passages(findings: Findings) -> str:
    """What the continuous pipe does as the flow grows."""
    exact = findings.exact
    start = ""
    if exact is not None and not exact.stable_at_rest:
        start = "The pipe is buckled at rest. "
    elif exact is not None and exact.speed == 0.0:
        start = "The pipe is unstable from the smallest flow on. "
    told = [
        f"u = {c.speed:.5g} ({c.kind}, mode {c.mode}, {'begins' if c.destabilising else 'ends'}"
        f"{'' if c.unstable_after else '; stable beyond'})"
        for c in findings.crossings
        if c.speed > 0.0
    ]
    if len(told) > 8:
        told[8:] = [f"and {len(told) - 8} more"]
    listed = ", ".join(told) or "none"
    return f"{start}Instabilities of the continuous pipe, 0 < u <= {findings.highest:g}: {listed}."


def second_mode(findings: Findings) -> list[str]:
    """Whether the instability is in the second mode, from the table and from the map."""
    lines = []
    exact = findings.exact
    if exact is not None:
        answer = "yes" if exact.mode == 2 else f"no, in mode {exact.mode}"
        modes = [(row, row.critical.mode) for row in findings.rows if row.critical is not None]
        others = [f"{row.family} {row.size} (mode {k})" for row, k in modes if k != exact.mode]
        count = len(others)
        others[10:] = [f"and {count - 10} more"] if count > 10 else []
        named = f"; not so: {', '.join(others)}" if others else ""
        lines.append(
            "Is the instability in the second mode (branches counted from rest)? Continuous pipe: "
            f"{answer}; {len(modes) - count} of {len(modes)} models agree{named}."
        )
    for gamma, curve in findings.curves.items():
        if runs := _mode_runs(curve):
            lines.append(f"  On the map, gamma = {gamma:g}: {', '.join(runs)}.")
    return lines


def _mode_runs(curve: StabilityCurve) -> list[str]:
    pairs = zip(curve.values, curve.critical, strict=True)
    known = [(float(beta), found.mode) for beta, found in pairs if found is not None]
    runs = []
    for mode, group in groupby(known, key=lambda point: point[1]):
        betas = [f"{beta:.3g}" for beta, _ in group]
        runs.append(f"mode {mode} at beta {' to '.join(dict.fromkeys((betas[0], betas[-1])))}")
    return runs


def _by_family(findings: Findings) -> dict[str, list[CriticalSpeed]]:
    families: dict[str, list[CriticalSpeed]] = {row.family: [] for row in findings.rows}
    for row in findings.rows:
        if row.critical is not None:
            families[row.family].append(row.critical)
    return families


HEADER = (
    *("model", "springs or basis", "size", "speed", "frequency", "kind", "mode"),
    *("stable at rest", "error %", "own error", "remark"),
)


def table(findings: Findings) -> list[tuple[str, ...]]:
    """Lines of the table under HEADER, the continuous pipe first; speeds with all their digits."""
    exact = findings.exact
    size = 0 if exact is None else exact.size
    first = Row("continuous", "", size, exact, findings.remark)
    lines: list[tuple[str, ...]] = []
    for row in (first, *findings.rows):
        found = row.critical
        if found is None:
            lines.append((row.kind, row.family, str(row.size), *[""] * 7, row.remark))
            continue
        error = ""
        if row is not first and exact is not None and exact.speed > 0.0:
            error = f"{100.0 * (found.speed / exact.speed - 1.0):+.6g}"
        lines.append(
            (
                *(row.kind, row.family, str(row.size), repr(found.speed), repr(found.frequency)),
                *(found.kind, str(found.mode), "yes" if found.stable_at_rest else "no"),
                *(error, f"{found.error:.1e}", row.remark),
            )
        )
    return lines


def report(case: Case, findings: Findings) -> str:
    """What is printed: the table for the sizes of the panels and the largest, and what it says."""
    shown = {
        "chain": {*case.chain_sizes, max((*CHAIN_LADDER, *case.chain_sizes))},
        "reduced": {*case.reduced_sizes, max((*REDUCED_LADDER, *case.reduced_sizes))},
    }
    pipe = case.pipe
    text = [
        f"Critical speeds: beta = {pipe.beta:g}, gamma = {pipe.gamma:g}, {pipe.flow}, "
        f"alpha = {pipe.alpha:g}, damping = {pipe.damping:g}",
        "",
        f"{'model':11}{'springs, basis':16}{'size':>5}{'u_c':>13}{'omega_c':>12}  {'kind':11}"
        f"{'mode':>4}{'error %':>12}",
    ]
    for kind, family, size, speed, frequency, how, mode, _, error, own, remark in table(findings):
        if kind in shown and int(size) not in shown[kind]:
            continue
        start = f"{kind:11}{family:16}{size:>5}"
        if not speed:
            text.append(f"{start}  {remark}")
            continue
        if kind == "continuous" and float(speed) > 0.0:
            error = f"+- {100.0 * float(own) / float(speed):.0e}"
        elif error:
            small = abs(float(error)) < 1e-3
            error = f"{float(error):+.2e}" if small else f"{float(error):+.4f}"
        text.append(
            f"{start}{float(speed):13.7f}{float(frequency):12.6f}  {how:11}{mode:>4}{error:>12}"
        )
    compared = (
        f"  The map's boundaries are within {findings.map_error:.0e} of the continuous pipe's, "
        "where compared."
    )
    text += ["", verdict(findings), passages(findings), *second_mode(findings), compared]
    return "\n".join(text)


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
