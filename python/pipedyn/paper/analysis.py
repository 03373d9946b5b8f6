# SPDX-License-Identifier: MIT
"""The paper's modal analysis: all results that its figures and its table show.

They are computed on a few processes. What fails is left out and named; the rest is kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from pipedyn import plot
from pipedyn.linear.critical_speed import CriticalSpeed, NoCrossing, critical_speed, crossings
from pipedyn.linear.modes import RootLoci, root_loci
from pipedyn.linear.sensitivity import Crossing
from pipedyn.linear.stability_curve import Failure, Point, StabilityCurve, stability_curve
from pipedyn.models.base import Model
from pipedyn.models.chain import SPRING_RULES, Chain
from pipedyn.models.continuum import Continuum
from pipedyn.models.galerkin import BASES, Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.util.parallel import Job, parallel
from pipedyn.util.progress import track

BRANCHES = 4
"""Branches in figures 2 and 3: the paper's smallest chain has as many."""

LEAST_HIGHEST, HIGHEST_SPEED = 8.0, 100.0
"""Between these lies the highest flow speed of figures 2 and 3. At 8 the paper's case has lost
stability; at 100 the branches need more than 60 functions."""

CHAIN_SIZES = (2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
REDUCED_SIZES = (2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 22, 32, 46)
"""Sizes in the convergence picture, beside those of the panels: factors of sqrt(2), and every small
number of functions, because the error of Legendre functions falls to rounding by m = 12."""

MAP_GAMMAS = (-10.0, 0.0, 10.0, 100.0)
"""Gravity in the stability map: a standing pipe that does not buckle, a level one, two hanging
ones."""

MAP_BETAS = np.linspace(0.01, 0.98, 25)
"""Mass ratios at first; steps across folds are refined."""

MAP_SPEEDS = 20.0, 30.0
"""Highest speed of the map, and how far it may be raised to show the case's own critical speed."""

MAP_JUMP, MAP_STEP = 0.04, 0.002
"""Steps in beta are halved where a boundary jumps by more than the first, as a part of the highest
speed. Steps shorter than the second, a sixth of a line's width on the page, are left."""


@dataclass(frozen=True)
class Case:
    """The options of the command; highest None: chosen from the critical speed."""

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
    """One line of the table: a model and its critical speed, or a remark why it has none."""

    kind: str
    family: str
    size: int
    critical: CriticalSpeed | None
    remark: str = ""


@dataclass
class Findings:
    """All that the figures and the table show; what failed is missing and named in `failures`.

    Attributes:
        highest: end of the speeds in figures 2 and 3.
        exact: critical speed of the continuous pipe; None where it has none.
        remark: why there is no critical speed.
        crossings: of the continuous pipe, up to `highest`.
        benchmark: root loci of the continuous pipe.
        panels: titles and root loci of the models, a list for each row of panels.
        rows: the table, without the continuous pipe.
        curves: stability over beta, by gamma.
        map_error: largest distance of the map's boundaries from the continuous pipe's.
        failures: what could not be computed, and why.
    """

    highest: float = 0.0
    exact: CriticalSpeed | None = None
    remark: str = ""
    crossings: tuple[Crossing, ...] = ()
    benchmark: RootLoci | None = None
    panels: list[list[tuple[str, RootLoci | None]]] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    curves: dict[float, StabilityCurve] = field(default_factory=dict)
    map_error: float = 0.0
    failures: list[str] = field(default_factory=list)


def one_blas_thread() -> None:
    """Start of a worker process: as many processes share the work as there are processors."""
    threadpool_limits(1, "blas")


def gather(case: Case, executor: Executor | None = None) -> Findings:
    """Compute all that the figures and the table show.

    Args:
        case: the options of the command.
        executor: takes the models; without one they are computed in this process.
    """
    exact = Continuum(case.pipe)
    findings = Findings()

    def kept(what: str, outcome: Any) -> tuple[Any, str]:
        """The outcome, or None and the reason; a failure is recorded."""
        if not isinstance(outcome, Exception):
            return outcome, ""
        if not isinstance(outcome, NoCrossing):
            findings.failures.append(f"{what}: {_remark(outcome)}")
        return None, _remark(outcome)

    first: Job[Any] = partial(critical_speed, exact)
    (outcome,) = parallel([first])
    findings.exact, findings.remark = kept("critical speed, continuous pipe", outcome)
    findings.highest = _highest(case, findings.exact)
    speeds = np.linspace(0.0, findings.highest, case.speeds)
    panels, families = _panels(case), _families(case)
    pictured = [model for row in panels for _, model in row]
    jobs: list[Job[Any]] = [
        partial(root_loci, exact, speeds, BRANCHES),
        partial(crossings, exact, findings.highest),
        *(partial(root_loci, model, speeds, min(BRANCHES, model.dof)) for model in pictured),
        *(partial(critical_speed, model) for _, _, model in families),
    ]
    answers = parallel(jobs, executor, label="models", progress=case.progress)
    outcomes = (  # a job whose worker process died runs here
        next(parallel([job])) if isinstance(answer, BrokenExecutor) else answer
        for job, answer in zip(jobs, answers, strict=True)
    )

    def next_of(what: str) -> tuple[Any, str]:
        return kept(what, next(outcomes))

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
            curve, difference = stability_map(pipe, map_top(findings.exact), executor)
        except BrokenExecutor:
            executor = None
            curve, difference = stability_map(pipe, map_top(findings.exact), executor)
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


def map_top(critical: CriticalSpeed | None) -> float:
    """Highest speed of the map: low for a pipe that the smallest flow makes unstable."""
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
    chains = sorted({*CHAIN_SIZES, *case.chain_sizes})
    reduced = sorted({*REDUCED_SIZES, *case.reduced_sizes})
    return [
        *(("chain", k, Chain(case.pipe, n, springs=k)) for k in SPRING_RULES for n in chains),
        *(("reduced", k, Galerkin(case.pipe, m, k)) for k in BASES for m in reduced),
    ]


def stability_map(
    pipe: Pipe, top: float, executor: Executor | None
) -> tuple[StabilityCurve, float]:
    """Stability over beta, and the distance of its boundaries from the continuous pipe's.

    A reduced model with as many Legendre functions as the highest speed needs takes a third of the
    continuous pipe's time, and stands for it. At three values of beta both are computed and
    compared.
    """
    end = 1.02 * top
    size = math.ceil(0.8 * top) + 4

    def reduced(beta: float) -> Galerkin:
        return Continuum(replace(pipe, beta=beta)).frozen(size)

    def continuous(beta: float) -> Continuum:
        return Continuum(replace(pipe, beta=beta))

    points: dict[float, Point] = {}
    failures: list[Failure] = []
    betas = MAP_BETAS.tolist()
    while betas:
        curve = stability_curve(reduced, betas, max_speed=end, executor=executor)
        answers = zip(curve.critical, curve.crossings, strict=True)
        points |= zip(curve.values.tolist(), answers, strict=True)
        failures += curve.failures
        betas = [
            0.5 * (a + b)
            for a, b in pairwise(sorted(points))
            if b - a > MAP_STEP and _distance(points[a][1], points[b][1]) > MAP_JUMP * top
        ]
    values = sorted(points)
    critical, found = zip(*(points[value] for value in values), strict=True)
    failures.sort(key=lambda failure: failure.value)
    failed = tuple(replace(one, index=values.index(one.value)) for one in failures)
    three = MAP_BETAS[:: MAP_BETAS.size // 2].tolist()
    exact = stability_curve(continuous, three, max_speed=end, executor=executor)
    missing = {failure.value for failure in exact.failures}
    pairs = zip(three, exact.crossings, strict=True)
    distances = [_distance(points[value][1], c) for value, c in pairs if value not in missing]
    curve = StabilityCurve(np.array(values), critical, found, failed)
    return curve, max(distances, default=0.0)


def _distance(left: Sequence[Crossing], right: Sequence[Crossing]) -> float:
    """Largest distance of stability boundaries, in speed; infinite where their numbers differ."""
    a, b = plot.boundaries(left), plot.boundaries(right)
    if len(a) != len(b):
        return math.inf
    return max((abs(p.speed - q.speed) for p, q in zip(a, b, strict=True)), default=0.0)
