# SPDX-License-Identifier: MIT
"""Computes all results in the figures and the table of the paper's modal analysis.

Results that fail are left out and named; all others are kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent import futures
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from pipedyn.curves.boundary import Boundary, boundary
from pipedyn.linear.critical_speed import (
    CriticalSpeed,
    NoCrossing,
    critical_speed,
    crossings,
)
from pipedyn.linear.loci import RootLoci, root_loci
from pipedyn.linear.sensitivity import Crossing
from pipedyn.models.base import Model
from pipedyn.models.chain import SPRING_RULES, Chain
from pipedyn.models.continuum import Continuum
from pipedyn.models.galerkin import BASES, Basis, Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.util.parallel import Job, outcome_of, parallel

BRANCHES = 4
"""Number of branches in figures 2 and 3, equal to that of the paper's smallest chain."""

LEAST_HIGHEST, HIGHEST_SPEED = 8.0, 100.0
"""Bounds of the highest flow speed in figures 2 and 3. At u = 8 the paper's pipe has lost
stability; at u = 100 the branches need more than 60 functions."""

CHAIN_SIZES = (2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64)
REDUCED_SIZES = (2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 22, 32, 46)
"""Sizes in the picture of convergence, besides those of the panels. Large sizes grow by factors of
sqrt(2) and sizes up to 8 by 1, because the error of Legendre functions falls to rounding by m = 12.
"""


MAP_GAMMAS = (-10.0, 0.0, 10.0, 100.0)
"""Values of gamma for the maps, besides the pipe's own: standing, level and hanging pipes."""


@dataclass(frozen=True)
class Options:
    """The options of the command; if `highest` is None, it follows from the critical speed."""

    pipe: Pipe
    springs: list[str]
    chain_sizes: list[int]
    reduced_sizes: list[int]
    basis: Basis
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
    """Results in the figures and the table; `failures` names those that failed."""

    highest: float = 0.0  # highest speed in figures 2 and 3
    exact: CriticalSpeed | None = None  # critical speed of the continuous pipe
    remark: str = ""  # why the continuous pipe has no critical speed
    crossings: Sequence[Crossing] | None = None  # of the continuous pipe, up to `highest`
    benchmark: RootLoci | None = None  # root loci of the continuous pipe
    panels: list[list[tuple[str, RootLoci | None]]] = field(default_factory=list)  # title, loci
    rows: list[Row] = field(default_factory=list)  # the table, without the continuous pipe
    maps: dict[float, Boundary] = field(default_factory=dict)  # over beta, by gamma
    map_error: float = 0.0  # largest error of the boundaries on the maps
    failures: list[str] = field(default_factory=list)


def compute_findings(case: Options, executor: futures.Executor | None = None) -> Findings:
    """Computes all results in the figures and the table, in an executor or in this thread."""
    exact, findings = Continuum(case.pipe), Findings()

    def recorded(name: str, answer: Any) -> tuple[Any, str]:
        """The answer of a job, or None with the reason; records failures by the name."""
        if not isinstance(answer, Exception):
            return answer, ""
        if not isinstance(answer, NoCrossing):
            findings.failures.append(f"{name}: {_remark(answer)}")
        return None, _remark(answer)

    found = outcome_of(critical_speed, exact)
    findings.exact, findings.remark = recorded("critical speed, continuous pipe", found)
    wanted = 0.0 if findings.exact is None else math.ceil(1.5 * findings.exact.speed)
    findings.highest = case.highest or float(min(max(wanted, LEAST_HIGHEST), HIGHEST_SPEED))
    speeds = np.linspace(0.0, findings.highest, case.speeds)
    panels, families = _panel_models(case), _families(case)
    own = case.pipe.gamma
    every = [own, *sorted({*MAP_GAMMAS} - {own}, reverse=True)]
    gammas = {f"stability map, gamma = {gamma}": gamma for gamma in every}
    window = {"beta": (0.01, 0.98), "u": (0.0, 1.02 * map_top(findings.exact))}
    jobs: dict[str, Job[Any]] = {
        "root loci, continuous pipe": partial(root_loci, exact, speeds, BRANCHES),
        "crossings, continuous pipe": partial(crossings, exact, findings.highest),
    }
    for title, model in chain.from_iterable(panels):
        jobs[f"root loci, {title}"] = partial(root_loci, model, speeds, min(BRANCHES, model.dof))
    for kind, family, model in families:
        jobs[f"critical speed, {kind}, {family}, {model.dof}"] = partial(critical_speed, model)
    for name, gamma in gammas.items():
        hanging = Continuum(replace(case.pipe, gamma=gamma))
        how = {"criticality": False, "only_stability": True}
        jobs[name] = partial(boundary, hanging, "beta", "u", window, **how)
    outcomes = parallel([*jobs.values()], executor, label="models", progress=case.progress)
    answers = {name: recorded(name, one) for name, one in zip(jobs, outcomes, strict=True)}
    findings.benchmark, _ = answers["root loci, continuous pipe"]
    findings.crossings, _ = answers["crossings, continuous pipe"]
    findings.panels = [[(of, answers[f"root loci, {of}"][0]) for of, _ in row] for row in panels]
    for kind, family, model in families:
        answer = answers[f"critical speed, {kind}, {family}, {model.dof}"]
        findings.rows.append(Row(kind, family, model.dof, *answer))
    for name, gamma in gammas.items():
        found, _ = answers[name]
        if found is not None:
            findings.maps[gamma] = found
            findings.map_error = max([findings.map_error, *(one.error for one in found.curves)])
            findings.failures += [f"{name}: {failure}" for failure in found.failures]
    return findings


def map_top(critical: CriticalSpeed | None) -> float:
    """Highest speed of a map; it is low for a pipe that loses stability at a low speed."""
    if critical is None:
        return 20.0
    if critical.speed < 1.0:
        return 5.0 * critical.speed or 1.0
    return min(max(20.0, 1.1 * critical.speed), 30.0)


def _remark(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, NoCrossing) else f"{type(error).__name__}: {text}"


def _panel_models(case: Options) -> list[list[tuple[str, Model]]]:
    """Title and model of each panel: a row for each spring rule, and one for the basis.

    The longest row is the last one, so that every column ends in it.
    """
    rows: list[list[tuple[str, Model]]] = []
    for rule in case.springs:
        named = "rayleigh (the paper's)" if rule == "rayleigh" else f"{rule} springs"
        chains = [Chain(case.pipe, n, springs=rule) for n in case.chain_sizes]
        rows.append([(f"chain, n = {chain.dof}, {named}", chain) for chain in chains])
    reduced = [Galerkin(case.pipe, m, case.basis) for m in case.reduced_sizes]
    rows.append([(f"reduced, m = {model.dof}, {case.basis} basis", model) for model in reduced])
    return sorted(rows, key=len)


def _families(case: Options) -> list[tuple[str, str, Model]]:
    """Kind, rule or basis, and model of each line of the table but the first."""
    chains = sorted({*CHAIN_SIZES, *case.chain_sizes})
    reduced = sorted({*REDUCED_SIZES, *case.reduced_sizes})
    return [
        *(("chain", k, Chain(case.pipe, n, springs=k)) for k in SPRING_RULES for n in chains),
        *(("reduced", k, Galerkin(case.pipe, m, k)) for k in BASES for m in reduced),
    ]
