# SPDX-License-Identifier: MIT
"""What `choose` promises, on random pipes: its error against an accurate answer, its cost by hand.

    python tests/benchmark_choose.py [pipes] [seed] [question ...]

For each pipe, question and tolerance it prints the model chosen, its true error, its time, the time
of the cheapest model tried by hand that is as good, and the time of the whole search. The truth has
more functions than any that the search has seen: of a linear question the continuous pipe's, of a
motion or a cycle those of SHARP functions, whose own error stands in brackets. By hand are tried
all spring rules and both bases of a linear question; of motions and cycles the families that
`choose` tries where none are named, and all spring rules where it is asked for chains: bases of
about as many functions as it chose, and chains until they cost too much. It fails if a true
error is above its tolerance. Times are processor times of one thread, each the least of
three, of a nonlinear search the only one.
"""

import math
import sys
import warnings
from dataclasses import dataclass, replace

import numpy as np

import pipedyn as pp
from pipedyn.accuracy.choose import CANDIDATES, measure_model
from pipedyn.accuracy.convergence import FAMILIES, RULES
from pipedyn.accuracy.quantities import Answer
from pipedyn.util.counters import clock

HAND = (2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 40, 64, 100, 200)
CHAINS = (3, 4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 100, 128, 160, 200)
COSTLY = 0.15
"""Seconds of an answer after which a family is not tried by hand further."""

SHARP = {True: (48,), False: (18, 24)}
"""Legendre functions of the truth: of linear questions, and of others with the step before."""


@dataclass(frozen=True)
class Case:
    """A question to a pipe, with the tolerances asked for and the families to choose among."""

    pipe: pp.Pipe
    name: str
    conditions: dict
    tolerances: tuple = (1e-2, 1e-4, 1e-6, 1e-8)
    among: str | None = None

    @property
    def title(self):
        return self.name + (f" ({self.among})" if self.among else "")


def random_pipe(rng, least_damping=0.0):
    """beta in [0.02, 0.98], gamma in [-5, 60], both flows; some damping where it aspirates."""
    flow = str(rng.choice(["ejecting", "aspirating"], p=[0.65, 0.35]))
    damping = 10.0 ** rng.uniform(-3.0, np.log10(0.05))
    if flow == "ejecting" and rng.random() < 0.5:
        damping = least_damping
    return pp.Pipe(rng.uniform(0.02, 0.98), rng.uniform(-5.0, 60.0), flow=flow, damping=damping)


def linear_cases(rng):
    """Of one pipe that loses stability at a speed."""
    pipe = random_pipe(rng)
    u = rng.uniform(0.2, 1.2) * min(pp.critical_speed(pp.Continuum(pipe)).speed, 15.0)
    speeds = np.linspace(0.0, max(u, 0.5), 21)
    yield Case(pipe, "critical_speed", {})
    yield Case(pipe, "frequencies", {"u": u, "count": int(rng.integers(1, 7))})
    yield Case(pipe, "root_loci", {"speeds": speeds, "count": int(rng.integers(1, 5))})


def nonlinear_cases(rng):
    """Of one damped pipe, half of them with drag: below and beyond its loss of stability."""
    pipe = random_pipe(rng, least_damping=1e-3)
    if rng.random() < 0.5:
        pipe = replace(pipe, drag=10.0 ** rng.uniform(-1.0, 1.0))
    loss = pp.critical_speed(pp.Continuum(pipe)).speed
    motion = {"u": rng.uniform(0.5, 1.2) * loss, "duration": rng.uniform(1.0, 4.0)}
    cycle = {"u": rng.uniform(1.03, 1.3) * loss}
    yield Case(pipe, "motion", motion, (1e-2, 1e-3, 1e-4, 1e-6))
    yield Case(pipe, "motion", motion, (1e-1, 1e-2), "chain")
    yield Case(pipe, "limit_cycle", cycle, (1e-2, 1e-3, 1e-4, 1e-6)[: 3 if pipe.drag else 4])
    yield Case(pipe, "limit_cycle", cycle, (1e-1,), "chain")


def is_linear(name):
    """Whether a question is one of eigenvalues."""
    return name not in ("motion", "limit_cycle")


def true_answer(case, quantity):
    """Of functions beyond those of the search, and its own error."""
    if quantity.name == "critical_speed":
        return replace(quantity.answer(pp.Continuum(case.pipe)), error=0.0)
    if quantity.name == "root_loci":
        sharp = pp.Galerkin(case.pipe, SHARP[True][-1], "legendre")
        loci = pp.root_loci(sharp, quantity.speeds, quantity.count)
        return Answer(np.concatenate([loci.eigenvalues, loci.partners], axis=1))
    sizes = SHARP[is_linear(quantity.name)]
    sharp = quantity.solved_for(1e-2 * min(case.tolerances[-1], 1e-3))
    answers = [sharp.answer(pp.Galerkin(case.pipe, size, "legendre")) for size in sizes]
    return replace(answers[-1], error=quantity.distance(answers[0], answers[-1]))


def least_by_hand(case, choice, truth, tolerance, most):
    """The cheapest row of all families and sizes, tried until they cost too much."""
    quantity = choice.quantity
    names = (*RULES, "beam", "legendre")
    if not is_linear(quantity.name):
        names = tuple(RULES) if case.among else CANDIDATES
    good = []
    for name in names:
        sizes = HAND
        if not is_linear(quantity.name):
            near = range(max(2, choice.size - 3), choice.size + 5)
            sizes = CHAINS if name in RULES else near
        for size in sizes:
            if size < quantity.least or (name == "legendre" and size > 64):
                continue
            row = measure_model(case.pipe, quantity, FAMILIES[name], size, truth, 1)
            if row.error <= tolerance:
                good.append(row)
            if row.seconds > (COSTLY if is_linear(quantity.name) else 1.5 * most):
                break
    return min(good, key=lambda row: row.seconds, default=None)


def least_time(case, choice, row):
    """Of three answers of a row's model."""
    family = FAMILIES[row.family]
    return measure_model(case.pipe, choice.quantity, family, row.size, choice.reference, 3).seconds


def held(case):
    """A case's choices: cost over the cheapest by hand and search over cost, or what is wrong."""
    truth = None
    for tolerance in case.tolerances:
        begun, search = clock(), math.inf
        try:
            for _ in range(3 if is_linear(case.name) else 1):
                start = clock()
                choice = pp.choose(
                    case.pipe, case.name, tolerance, among=case.among, **case.conditions
                )
                search = min(search, clock() - start)
            quantity = choice.quantity
            truth = truth or true_answer(case, quantity)
        except pp.PipedynError as refused:
            why = f"{type(refused).__name__}: {refused} ({clock() - begun:.1f} s)"
            print(f"| {case.title} | {tolerance:g} | {why} | | | | | {case.pipe!r} |", flush=True)
            continue
        error = quantity.distance(quantity.answer(choice.model), truth)
        best = least_time(case, choice, choice.row)  # afresh: the search takes each once
        least = least_by_hand(case, choice, truth, tolerance, best) or choice.row
        by_hand = least_time(case, choice, least)
        wrong = " WRONG" if error > tolerance else ""
        print(
            f"| {case.title} | {tolerance:g} | {choice.family} {choice.size} | "
            f"{error:.1e} ({truth.error:.0e}){wrong} | {1e3 * best:.2f} | {least.family} "
            f"{least.size}: {1e3 * by_hand:.2f} ({best / by_hand:.2f}) | {search / best:.1f} | "
            f"{case.pipe!r} |",
            flush=True,
        )
        yield best / by_hand, search / best, bool(wrong)


def main():
    pipes, seed = (int(word) for word in [*sys.argv[1:3], *("20", "1")[len(sys.argv) - 1 :]])
    asked, found = sys.argv[3:], {}
    print("| question | tolerance | chosen | true error | ms | by hand | search / answer | pipe |")
    print("|---|---|---|---|---|---|---|---|")
    for cases in (linear_cases, nonlinear_cases):
        rng = np.random.default_rng(seed)
        for case in (one for _ in range(pipes) for one in cases(rng)):
            if not asked or case.name in asked:
                found.setdefault(case.title, []).extend(held(case))
    for name, rows in ((name, np.array(rows)) for name, rows in found.items() if rows):
        costs, searches, wrong = rows.T
        print(
            f"{name}: cost / cheapest by hand: median {np.median(costs):.2f}, largest "
            f"{costs.max():.2f}, above 2: {np.sum(costs > 2.0)} of {costs.size}; search / answer: "
            f"median {np.median(searches):.1f}, largest {searches.max():.1f}; "
            f"wrong: {wrong.sum():g}"
        )
    return int(any(wrong for rows in found.values() for *_, wrong in rows))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main())
