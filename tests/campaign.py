# SPDX-License-Identifier: MIT
"""Random pipes in classes against independent programs: `python tests/campaign.py --jobs 2`.

A case is one pipe, one model of it and the end of a search, see `campaign_cases.py`. `crossings`
and `critical_speed` must find every change of the number of unstable roots that the programs of
`campaign_reference.py` and `campaign_elements.py` find, and no other. Wrong is a speed farther from
the true one than its stated error or 1e-9 of it, a range of speeds wider than 1e-6 of them in which
the number of unstable roots is another, and a wrong kind. One case in five asks `eigenvalues`, too.

Prints a table by class: pipes, wrong ones, refused ones, those unchecked as the reference is not
sure of them, and seconds of the package and of the reference; and before it each wrong, refused or
unchecked case as a line of Python. Exits with 1 if one is wrong, or more than one in a hundred of a
class is refused.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from random import Random
from typing import Any

import numpy as np
from campaign_cases import CLASSES, Case, drawn, energy_paths
from campaign_elements import continuum_changes, elements, wave_number
from campaign_reference import Answer, System, Unsure, all_changes, system_of

import pipedyn as pp


@dataclass
class Outcome:
    """What came of a case: right, wrong, refused or unchecked, and why."""

    case: Case
    verdict: str = "right"
    reason: str = ""
    seconds: float = 0.0
    reference_seconds: float = 0.0


@dataclass(frozen=True)
class Truth:
    """What the reference says of a case.

    system: of the model, or of the continuous pipe a fine one; at_rest: its number of unstable
    roots without flow; loss: the critical speed, None if there is none; kind: of the loss.
    """

    case: Case
    system: System
    answer: Answer
    at_rest: int
    loss: float | None
    error: float
    kind: str

    @property
    def is_lossy(self) -> bool:
        return self.system.loss is not None

    @property
    def is_ill_defined(self) -> bool:
        """Whether the pipe has hysteresis and is unstable at rest.

        A growing real root of the pipe without it may then be a growing pair of the pipe with it:
        whether any root grows is known, but not how many.
        """
        return self.is_lossy and self.at_rest > 0


def truth(case: Case, model: Any) -> Truth:
    """Raises `Unsure`."""
    wave = wave_number(case.numbers, case.end)
    if isinstance(model, pp.Continuum):
        system, answer = elements(case.numbers, wave, 4), continuum_changes(case.numbers, case.end)
    else:
        system = system_of(model, *energy_paths(case.numbers))
        answer = all_changes(system, case.end, 0.5 * wave)
    at_rest = int(np.sum(np.linalg.eigvalsh(system.still) < 0.0))
    least = [at_rest, *(count for count, _ in answer.counts)]
    grows = next((i for i, (a, b) in enumerate(pairwise(least)) if b > a), None)
    if not grows:
        return Truth(case, system, answer, at_rest, grows, 0.0, "")
    first = answer.changes[grows - 1]
    near = [c for c in answer.changes if abs(c.speed - first.speed) <= 1e-9 * first.speed]
    kinds = {"flutter" if c.frequency else "divergence" for c in near}
    return Truth(case, system, answer, at_rest, first.speed, first.error, " and ".join(kinds))


def judged(case: Case) -> Outcome:
    """Asks the package and the reference, and compares."""
    outcome, start = Outcome(case), time.process_time()
    model = eval(case.text, {"pp": pp})

    def asked(question: Any, *arguments: Any) -> Any:
        try:
            return question(model, *arguments)
        except pp.PipedynError as error:
            return error

    found, critical = asked(pp.crossings, case.end), asked(pp.critical_speed, case.end)
    rng = Random(case.text)
    u, values = rng.uniform(0.0, case.end), None
    if rng.random() < 0.2:
        values = asked(pp.eigenvalues, u, min(4, 2 * getattr(model, "dof", 4)))
    outcome.seconds, start = time.process_time() - start, time.process_time()
    try:
        true = truth(case, model)
        answers = [values]
        answers += [] if true.is_ill_defined else [critical]
        answers += [] if true.is_lossy else [found]
        refusals = [one for one in answers if isinstance(one, pp.PipedynError)]
        refusals = [one for one in refusals if not isinstance(one, pp.NoCrossing)]
        if refusals:
            outcome.verdict = "refused"
            said = " ".join(str(refusals[0]).split()[:9])
            outcome.reason = f"{type(refusals[0]).__name__}: {said}"
        elif fault := next(faults(true, found, critical, u, values), ""):
            outcome.verdict, outcome.reason = "wrong", fault
    except Unsure as doubt:
        outcome.verdict, outcome.reason = "unchecked", str(doubt)
    outcome.reference_seconds = time.process_time() - start
    return outcome


def faults(true: Truth, found: Any, critical: Any, u: float, values: Any) -> Iterator[str]:
    """What is wrong with the answers."""
    yield from faults_of_loss(true, critical)
    if not isinstance(found, Exception):
        yield from faults_of_ranges(true, found)
        grown = next((c for c in found if c.destabilising), None)
        none = isinstance(critical, pp.NoCrossing)
        if (grown is None) != none and not (
            true.is_ill_defined and isinstance(critical, Exception)
        ):
            yield f"crossings and critical_speed differ: {grown}, {critical}"
        elif (
            grown
            and not isinstance(critical, Exception)
            and abs(grown.speed - critical.speed) > grown.error + critical.error
        ):
            yield f"crossings say {grown.speed:.12g}, critical_speed {critical.speed:.12g}"
    if values is not None:
        yield from faults_of_values(true, u, values)


def faults_of_loss(true: Truth, critical: Any) -> Iterator[str]:
    """Of the critical speed, its kind, and what is said of the pipe at rest."""
    if true.is_ill_defined:
        if not isinstance(critical, Exception):
            slack = max(critical.error, 1e-9 * critical.speed)
            if all(abs(c.speed - critical.speed) > slack + c.error for c in true.answer.changes):
                yield f"critical speed {critical.speed:.9g} where nothing changes"
            if critical.stable_at_rest:
                yield f"stable at rest, true {true.at_rest} unstable roots"
        return
    if isinstance(critical, Exception) or true.loss is None:
        if not isinstance(critical, Exception):
            yield f"critical speed {critical.speed:.9g}, there is none"
        elif true.loss is not None:
            yield f"no loss of stability, true {true.loss:.9g}"
        return
    slack = max(critical.error, 1e-9 * true.loss) + true.error
    behind = true.answer.counts[sum(c.speed <= critical.speed for c in true.answer.changes)]
    if 0.0 < critical.speed < true.loss - slack and behind[0] < behind[1]:
        raise Unsure("rounding hides which roots grow")
    if abs(critical.speed - true.loss) > slack:
        yield f"critical speed {critical.speed:.9g} +- {critical.error:.1e}, true {true.loss:.9g}"
    elif true.kind and critical.kind not in true.kind:
        yield f"{critical.kind} at {true.loss:.9g}, true {true.kind}"
    if critical.stable_at_rest != (true.at_rest == 0):
        yield f"stable at rest {critical.stable_at_rest}, {true.at_rest} unstable roots"


def faults_of_ranges(true: Truth, found: Any) -> Iterator[str]:
    """Of the number of unstable roots as a function of the speed, and of kinds where it changes.

    With hysteresis up to the first loss and just behind it: beyond, growing real roots and growing
    pairs may be the same motion. Of a pipe that is unstable at rest only whether there are any.
    """
    changes, counts, stop = true.answer.changes, true.answer.counts, true.case.end
    before = found[0].unstable_before if len(found) else true.at_rest
    if before != true.at_rest:
        yield f"{before} unstable roots at rest, true {true.at_rest}"
    if true.is_lossy and true.loss and not true.is_ill_defined:
        later = (c.speed for c in changes if c.speed > true.loss * (1.0 + 1e-9))
        stop = min(1.001 * true.loss, (1.0 - 1e-6) * next(later, stop))
    own, told = [0.0, *(c.speed for c in changes)], []
    for c in found:  # within its error of a true one a speed counts as that
        distance = [(abs(c.speed - x.speed), x) for x in changes]
        near = [(d, x.speed) for d, x in distance if d <= max(c.error, 1e-9 * c.speed) + x.error]
        told.append((min(near)[1] if near else c.speed, c))
    at = [speed for speed, _ in told]
    for low, high in pairwise(sorted({0.0, *own, *at, stop})):
        least, most = counts[sum(x <= low for x in own) - 1]
        said = [before, *(c.unstable_after for speed, c in told if speed <= low)][-1]
        same = least <= said <= most or (true.is_ill_defined and bool(said) == bool(least))
        if same or high > stop:
            continue
        # A range that only one of both has may be narrow; one change at two speeds is wrong.
        moved = (low in own) != (high in own) and (low in at) != (high in at) and low > 0.0
        if moved or high - low > 1e-6 * high:
            yield f"{said} unstable roots from {low:.9g} to {high:.9g}, true {least}"
    for one, (a, _), (b, _) in zip(changes, counts[:-1], counts[1:], strict=True):
        kinds = [c.kind for speed, c in told if speed == one.speed]
        kind = "flutter" if one.frequency else "divergence"
        if one.speed <= stop and a != b and kinds and kind not in kinds:
            yield f"{kinds[0]} at {one.speed:.9g}, omega = {one.frequency:.6g}"


def faults_of_values(true: Truth, u: float, values: Any) -> Iterator[str]:
    """Of eigenvalues: each must be one of the reference's."""
    roots = true.system.roots(u)
    own, error = roots.value, roots.error
    if true.is_lossy:
        still = true.system.without_loss().roots(u)
        real = (still.value.imag == 0.0) & (still.value.real > 0.0)
        own, error = (
            np.concatenate([a, b[real]]) for a, b in ((own, still.value), (error, still.error))
        )
    for value in values:
        if true.case.numbers.get("damping", 0.0) * abs(value) > 0.3:
            continue  # near the cluster at -1 / delta
        upper = complex(value.real, abs(value.imag))
        nearest = int(np.argmin(np.abs(own - upper)))
        if abs(own[nearest] - upper) > 1e-6 * (1.0 + abs(value)) + 1e3 * error[nearest]:
            yield f"eigenvalue {value:.9g} at u = {u:.6g}, true {own[nearest]:.9g}"


def safely(seed: int, names: list[str], index: int) -> Outcome:
    """A case's outcome, also where something unforeseen is raised."""
    case = drawn(seed, index, names)
    try:
        return judged(case)
    except Exception as error:
        return Outcome(case, "wrong", f"{type(error).__name__}: {error}"[:200])


def rows_of(outcomes: list[Outcome]) -> Iterator[tuple[str, list[Outcome], Counter[str]]]:
    """Name, outcomes and numbers of verdicts of each class that has any."""
    for name in CLASSES:
        if some := [one for one in outcomes if one.case.name == name]:
            yield name, some, Counter(one.verdict for one in some)


def table(outcomes: list[Outcome]) -> str:
    """By class."""
    verdicts = ("wrong", "refused", "unchecked")
    lines = [("class", "pipes", *verdicts, "seconds", "reference")]
    every = ("all", outcomes, Counter(one.verdict for one in outcomes))
    for name, some, each in (*rows_of(outcomes), every):
        own, other = sum(x.seconds for x in some), sum(x.reference_seconds for x in some)
        numbers = [len(some), *(each[x] for x in verdicts)]
        lines.append((name, *map(str, numbers), f"{own:.1f}", f"{other:.1f}"))
    shown = [f"{name:15}" + "".join(f"{x:>10}" for x in rest) for name, *rest in lines]
    return "\n".join(shown)


def main(arguments: list[str] | None = None) -> int:
    """Runs cases; 1 if one is wrong, or more than one in a hundred of a class refused."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pipes", "--count", type=int, default=10_000, help="number of cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--class", dest="name", choices=[*CLASSES], help="this class alone")
    given = parser.parse_args(arguments)
    names = [given.name] if given.name else [*CLASSES]
    outcomes, start = [], time.time()
    ask = partial(safely, given.seed, names)
    indices = range(given.first, given.first + given.pipes)
    with ProcessPoolExecutor(given.jobs) as pool:
        asked = pool.map(ask, indices, chunksize=4) if given.jobs > 1 else map(ask, indices)
        for index, one in zip(indices, asked, strict=True):
            outcomes.append(one)
            if one.verdict != "right":
                why = f"{index} {one.case.name}: {one.verdict}: {one.reason}"
                print(f"pp.crossings({one.case.text}, {one.case.end!r})  # {why}", flush=True)
    print(table(outcomes))
    print(f"{time.time() - start:.0f} s")
    each = [(len(some), verdicts) for _, some, verdicts in rows_of(outcomes)]
    return int(any(v["wrong"] or v["refused"] > max(0.01 * n, 1) for n, v in each))


if __name__ == "__main__":
    sys.exit(main())
