# SPDX-License-Identifier: MIT
"""Random pipes in classes against independent programs: `python tests/campaign.py --pipes 10000`.

A case is one pipe, one model of it and the end of a search. `crossings` and `critical_speed` must
find every change of the number of unstable roots that `campaign_reference.py` finds, and no other.
Wrong is a speed farther from the true one than its stated error or 1e-9 of it, a range of speeds
wider than 1e-6 of them in which the number of unstable roots is another, and a wrong kind.

Prints a table by class: pipes, wrong ones, refused ones with what was raised, those that the
reference is not sure of, and seconds of the package and of the reference. Wrong and refused cases
are written as lines of Python. A case depends on --seed and its number alone.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from campaign_elements import continuum_changes, elements
from campaign_reference import Answer, Unsure, all_changes, system_of

import pipedyn as pp

Numbers = dict[str, Any]


# ------------------------------------------------------------------------------------- the cases


@dataclass(frozen=True)
class Case:
    """A pipe's numbers, a model of it as Python text with {} for the pipe, and the search's end."""

    name: str
    numbers: Numbers
    model: str
    end: float

    @property
    def text(self) -> str:
        """The model as Python text."""
        return self.model.format(pipe_text(self.numbers))


def rounded(x: float) -> float:
    """Few digits, so that cases can be read."""
    return float(f"{x:.6g}")


def power(rng: Random, low: float, high: float) -> float:
    """A number of which the logarithm is uniform between powers of ten."""
    return rounded(10.0 ** rng.uniform(low, high))


def pipe_text(numbers: Numbers) -> str:
    """`Pipe` of the numbers as Python text."""
    parts = []
    for name, value in numbers.items():
        if name == "terms":
            each = ", ".join(
                f"pp.{law}({', '.join(f'{k}={v!r}' for k, v in of.items())})" for law, of in value
            )
            parts.append(f"terms=[{each}]")
        elif name in ("stiffness", "mass"):
            at, series = value
            each = ", ".join(
                repr(c[0]) if len(c) == 1 else f"lambda s: {c[0]!r} + {c[1]!r} * s + {c[2]!r} * s**2"
                for c in series
            )
            parts.append(f"{name}=pp.Profile({at!r}, [{each}])")
        elif name == "root" and not isinstance(value, str):
            parts.append(f"root=pp.RootSpring({value!r})")
        else:
            parts.append(f"{name}={value!r}")
    return f"pp.Pipe({', '.join(parts)})"


def some_beta(rng: Random) -> float:
    return rounded(rng.choice([rng.uniform(0.01, 0.95), rng.uniform(0.01, 0.95), power(rng, -3, -1)]))


def some_gravity(rng: Random, share: float = 0.5) -> float:
    return rounded(rng.uniform(-7.0, 40.0)) if rng.random() < share else 0.0


def some_damping(rng: Random, share: float = 0.5) -> float:
    return power(rng, -5, -1.3) if rng.random() < share else 0.0


def some_root(rng: Random) -> Any:
    return rng.choice(["clamped", "clamped", "pinned", power(rng, -1, 3)])


def some_place(rng: Random) -> float:
    return rng.choice([0.5, 1.0, rounded(rng.uniform(0.05, 0.98))])


def cantilevered(rng: Random, _: int) -> Numbers:
    made: Numbers = {"beta": some_beta(rng), "gamma": some_gravity(rng), "damping": some_damping(rng)}
    if rng.random() < 0.3:
        made["alpha"] = rounded(rng.uniform(0.0, 2.5))
    if rng.random() < 0.05:
        made["beta"] = 0.0
    return made


def held(rng: Random, _: int) -> Numbers:
    made: Numbers = {
        "beta": some_beta(rng),
        "gamma": some_gravity(rng, 0.3),
        "root": some_root(rng),
        "end": rng.choice(["pinned", "clamped"]),
    }
    if rng.random() < 0.5:
        at = {"at": rng.choice([0.5, rounded(rng.uniform(0.1, 0.9))])}
        laws = [
            ("Tension", {"load": rounded(rng.uniform(-8.0, 30.0))}),
            ("PointMass", at | {"mass": power(rng, -2, 0.5)}),
            ("Spring", at | {"stiffness": rounded(rng.uniform(0.0, 500.0))}),
            ("Spring", at | {"stiffness": power(rng, 1, 4)}),
            ("AddedMass", {"chi": power(rng, -1, 1)}),
        ]
        made["terms"] = [rng.choice(laws)]
    return made


def held_damped(rng: Random, size: int) -> Numbers:
    made = held(rng, size) | {"end": rng.choice(["guided", "pinned", "clamped"])}
    made["damping"] = power(rng, -5, -0.5)
    if rng.random() < 0.3:
        made["damping"] = 0.0
        made["terms"] = [*made.get("terms", []), ("Viscosity", {"sigma": power(rng, -2, 1)})]
    return made


def on_foundation(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, held, held, held_damped])(rng, size)
    kind = rng.random()
    stiffness = rng.uniform(0.0, 2500.0) if kind < 0.5 else power(rng, 0.5, 4)
    if kind > 0.8:  # about where the divergences of two modes of a hinged pipe meet
        made |= {"root": "pinned", "end": "pinned", "gamma": 0.0}
        n = rng.randint(1, 3)
        stiffness = (n * (n + 1)) ** 2 * math.pi**4 * (1.0 + rng.uniform(-0.15, 0.15))
    made["terms"] = [("Foundation", {"stiffness": rounded(stiffness)})]
    if rng.random() < 0.2:
        made["terms"].append(("Spring", {"at": some_place(rng), "stiffness": power(rng, 0, 3.5)}))
    return made


def overdamped(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, aspirating])(rng, size)
    if rng.random() < 0.3:
        made["damping"] = power(rng, -1.5, 1)
    if rng.random() < 0.7 or not made.get("damping"):
        made["terms"] = [("Viscosity", {"sigma": power(rng, 0.5, 3)})]
    if rng.random() < 0.3:
        made["terms"] = [*made.get("terms", []), ("Damper", {"at": some_place(rng), "coefficient": power(rng, 0, 3)})]
    return made


def hysteretic(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, held, held_damped, aspirating])(rng, size)
    made["hysteresis"] = power(rng, -4, -0.3)
    if rng.random() < 0.2:
        made["terms"] = [*made.get("terms", []), ("Viscosity", {"sigma": power(rng, -1, 1)})]
    return made


def aspirating(rng: Random, size: int) -> Numbers:
    made = cantilevered(rng, size) | {"flow": "aspirating"}
    made["damping"] = power(rng, -6, -1.5) if rng.random() < 0.7 else 0.0
    made["alpha"] = rng.choice([1.0, 0.0, rounded(rng.uniform(0.0, 1.5))])
    if rng.random() < 0.5:
        made["inflow_share"] = rng.choice([0.0, 0.5, rounded(rng.uniform(0.0, 1.0))])
    return made


def supported(rng: Random, size: int) -> Numbers:
    made = rng.choice([held, held, held_damped, cantilevered])(rng, size)
    made.pop("terms", None)
    most = max(1, min(100, size // 3))
    spans = min(most + 1, 2 + int(most * rng.random() ** (2 if size <= 40 else 0.5)))
    places = np.linspace(0.0, 1.0, spans + 1)
    if rng.random() < 0.4:
        places = np.cumsum([0.0, *(rng.uniform(0.4, 1.6) for _ in range(spans))])
        places /= places[-1]
    elif rng.random() < 0.5:
        made |= {"root": "pinned", "end": "pinned", "gamma": 0.0}
    # A chain has a segment end at each support, which decimals of nine digits meet.
    made["supports"] = [float(f"{x:.9g}") for x in places[1:-1]]
    return made


def profiled(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, cantilevered, held, held_damped, aspirating])(rng, size)
    made.pop("terms", None)

    def profile(low: float) -> tuple[list[float], list[list[float]]]:
        if rng.random() < 0.5:
            end = rng.uniform(low, 2.0)
            bend = rng.uniform(-0.3, 0.3) * (1.0 - low)
            return [], [[1.0, rounded(end - 1.0 - bend), rounded(bend)]]
        at = sorted(rounded(rng.uniform(0.1, 0.9)) for _ in range(rng.choice([1, 1, 2])))
        return at, [[1.0], *([rounded(rng.uniform(low, 2.0))] for _ in at)]

    which = rng.random()
    if which < 0.75:
        made["stiffness"] = profile(0.3)
    if which > 0.5:
        made["beta"] = rounded(min(made["beta"], 0.6))
        made["mass"] = profile(max(0.65, made["beta"]))
    return made


def with_terms(rng: Random, size: int) -> Numbers:
    made = rng.choice([cantilevered, cantilevered, held, held_damped, aspirating])(rng, size)
    wide = rng.choice([1.0, 1.0, 1.0, 2.0, 4.0])
    laws: dict[str, Callable[[], Numbers]] = {
        "PointMass": lambda: {"at": some_place(rng), "mass": power(rng, -1 - wide, 0.5 * wide)},
        "Spring": lambda: {"at": some_place(rng), "stiffness": power(rng, 1 - wide, 1.5 + wide)},
        "Damper": lambda: {"at": some_place(rng), "coefficient": power(rng, -wide, wide)},
        "Foundation": lambda: {"stiffness": power(rng, 1 - wide, 1.5 + wide)},
        "Viscosity": lambda: {"sigma": power(rng, -wide, wide)},
        "AddedMass": lambda: {"chi": power(rng, -wide, wide)},
        "CubicSpring": lambda: {"at": some_place(rng), "stiffness": power(rng, 0, 4)},
        "Stop": lambda: {"at": some_place(rng), "gap": power(rng, -3, 0), "stiffness": power(rng, 0, 4)},
        "Tension": lambda: {"load": rounded(rng.uniform(-5.0, 20.0))},
        "Weight": lambda: {"at": some_place(rng), "load": rounded(rng.uniform(-5.0, 20.0))},
    }
    if made.get("end") in ("pinned", "clamped"):
        laws["Stretching"] = lambda: {"stiffness": power(rng, 0, 5)}
    names = rng.sample(sorted(laws), rng.choice([1, 1, 2, 3]))
    made["terms"] = [(name, laws[name]()) for name in names]
    return made


CLASSES: dict[str, Callable[[Random, int], Numbers]] = {
    "cantilevered": cantilevered,
    "held": held,
    "held and damped": held_damped,
    "on foundations": on_foundation,
    "overdamped": overdamped,
    "hysteretic": hysteretic,
    "aspirating": aspirating,
    "with supports": supported,
    "profiles": profiled,
    "with terms": with_terms,
}


def energy_paths(numbers: Numbers) -> tuple[bool, bool]:
    """Whether no energy passes an end of the pipe, and whether anything dissipates."""
    closed = numbers.get("end", "free") in ("pinned", "clamped")
    still = {1.0, *numbers.get("supports", ())} if closed else set(numbers.get("supports", ()))
    damps = [
        law == "Viscosity" or (law == "Damper" and of["at"] not in still)
        for law, of in numbers.get("terms", ())
    ]
    return closed, any((numbers.get("damping", 0.0), numbers.get("hysteresis", 0.0), *damps))


def some_size(rng: Random, band: int) -> int:
    """Degrees of freedom: of 100 cases 90 have up to 40, mostly few, 9 up to 120 and one more."""
    if band == 0:
        return rng.randint(121, 400)
    if band < 10:
        return rng.randint(41, 120)
    return rng.choice([*[rng.randint(2, 6)] * 10, *[rng.randint(7, 14)] * 7, rng.randint(15, 24),
                       rng.randint(15, 40)])


def drawn(seed: int, index: int, names: list[str]) -> Case:
    """The case of a number."""
    rng = Random(f"{seed} {index}")
    name, band = names[index % len(names)], index // len(names) * 37 % 100
    size = some_size(rng, band)
    numbers = CLASSES[name](rng, size)
    if not (restored := numbers.get("end", "free") != "free" or "supports" in numbers):
        restored = numbers.get("root", "clamped") != "pinned"
    if not restored:  # a pipe free to turn is neutral at every speed
        numbers["gamma"] = rounded(rng.uniform(1.0, 40.0))
    model = some_model(rng, numbers, size)
    return Case(name, numbers, model, rounded(some_end(rng, numbers)))


def some_end(rng: Random, numbers: Numbers) -> float:
    """How far to search: to about twice the first loss."""
    spans = len(numbers.get("supports", ())) + 1
    if spans > 1:
        return spans * rng.uniform(2.5, 5.0 if spans < 10 else 3.6 if spans < 30 else 3.2)
    foundation = sum(of.get("stiffness", 0.0) for law, of in numbers.get("terms", ()) if law == "Foundation")
    scale = (1.0 + foundation / 100.0) ** 0.25
    return rng.uniform(4.0, 15.0) * min(scale, 4.0)


def some_model(rng: Random, numbers: Numbers, size: int) -> str:
    """Text of a model with {} for its pipe."""
    spans = len(numbers.get("supports", ())) + 1
    joints = {of["at"] for _, of in numbers.get("terms", ()) if of.get("at", 1.0) < 1.0}
    joints |= {s for name in ("stiffness", "mass") if name in numbers for s in numbers[name][0]}
    kind = rng.random()
    # Of an undamped aspirating pipe all modes grow at once, and no reference has them all.
    if kind > 0.85 and size <= 120 and (numbers.get("flow") != "aspirating" or numbers["damping"]):
        return "pp.Continuum({})"
    if kind < 0.5:
        n = max(2 * spans, size + spans - 1)
        plain = spans == 1 and numbers.get("root", "clamped") == "clamped"
        rules = ["consistent", "consistent", "uniform", "rayleigh", "frequency"]
        if plain and numbers.get("end", "free") in ("free", "pinned"):
            rules.append("midpoint")
        rule = rng.choice(rules)
        if spans == 1 and rng.random() < 0.25 and rule != "midpoint":
            lengths = np.array([rng.uniform(0.5, 1.5) for _ in range(n)])
            listed = [float(f"{x:.12g}") for x in lengths / lengths.sum()]
            extra = f", lengths={listed}"
            if rng.random() < 0.4:
                directed = numbers.get("end", "free") in ("clamped", "guided")
                springs = [rounded(n * rng.uniform(0.6, 1.7)) for _ in range(n + directed)]
                return f"pp.Chain({{}}, springs={springs}{extra})"
            return f"pp.Chain({{}}, springs={rule!r}{extra})"
        return f"pp.Chain({{}}, {n}, springs={rule!r})"
    basis = "legendre" if rng.random() < 0.55 else "beam"
    least = len(joints) + spans + 2
    m = min(max(size, least if basis == "legendre" else 2), 200)
    return f"pp.Galerkin({{}}, {m}, {basis!r})"


# --------------------------------------------------------------------------------- the judgement


@dataclass
class Outcome:
    """What came of a case."""

    case: Case
    verdict: str = "right"
    reason: str = ""
    seconds: float = 0.0
    reference_seconds: float = 0.0
    loose: bool = False
    notes: list[str] = field(default_factory=list)

    def wrong(self, reason: str) -> None:
        self.verdict, self.reason = "wrong", self.reason or reason


def judged(case: Case) -> Outcome:
    """Asks the package and the reference, and compares."""
    outcome = Outcome(case)
    start = time.process_time()
    model = eval(case.text, {"pp": pp})
    try:
        found: Any = pp.crossings(model, case.end)
    except pp.PipedynError as error:
        found = error
    try:
        critical: Any = pp.critical_speed(model, case.end)
    except pp.PipedynError as error:
        critical = error
    outcome.seconds = time.process_time() - start
    start = time.process_time()
    try:
        if isinstance(model, pp.Continuum):
            system, answer = elements(case.numbers, 8.0, 0), continuum_changes(case.numbers, case.end)
        else:
            system = system_of(model, *energy_paths(case.numbers))
            answer = all_changes(system, case.end)
        at_rest = int(np.sum(np.linalg.eigvalsh(0.5 * (system.still + system.still.T)) < 0.0))
    except Unsure as doubt:
        outcome.verdict, outcome.reason = "unchecked", str(doubt)
        return outcome
    finally:
        outcome.reference_seconds = time.process_time() - start
    lossy = case.numbers.get("hysteresis", 0.0) > 0.0
    compare(outcome, answer, at_rest, found, critical, case.end, lossy)
    return outcome


def compare(
    outcome: Outcome, answer: Answer, at_rest: int, found: Any, critical: Any, end: float, lossy: bool
) -> None:
    """Sets the verdict.

    With hysteresis only up to the first loss and just behind it: beyond, growing real roots and
    growing pairs may be the same motion.
    """
    changes, counts = answer.changes, [*answer.counts]
    first = next((i for i in range(len(changes)) if counts[i + 1][0] > counts[i][0]), None)
    if at_rest < counts[0][0]:
        loss = 0.0
    else:
        loss = changes[first].speed if first is not None else None
    refused = isinstance(critical, Exception) and not isinstance(critical, pp.NoCrossing)
    if refused or (isinstance(found, Exception) and not lossy):
        error = critical if refused else found
        outcome.verdict = "refused"
        outcome.reason = f"{type(error).__name__}: {' '.join(str(error).split()[:9])}"
        return
    if isinstance(critical, pp.NoCrossing):
        if loss is not None:
            outcome.wrong(f"no loss of stability, true {loss:.9g}")
    elif loss is None:
        outcome.wrong(f"critical speed {critical.speed:.9g}, there is none")
    else:
        slack = max(critical.error, 1e-9 * loss) + (changes[first].error if loss else 0.0)
        if abs(critical.speed - loss) > slack:
            outcome.wrong(
                f"critical speed {critical.speed:.9g} +- {critical.error:.1e}, true {loss:.9g}"
            )
        elif loss and (critical.kind == "divergence") != (changes[first].frequency == 0.0):
            together = [c for c in changes if abs(c.speed - loss) < slack]
            if len(together) == 1:
                outcome.wrong(f"{critical.kind} at {loss:.9g}, omega = {changes[first].frequency:.6g}")
        if critical.stable_at_rest != (at_rest == 0):
            outcome.wrong(f"stable at rest {critical.stable_at_rest}, {at_rest} unstable roots")
    if isinstance(found, Exception):
        outcome.notes.append("crossings refused")
        return
    outcome.loose = any(c.error > 1e-6 * c.speed for c in found)
    stop = end
    if lossy and loss is not None:
        after = 0 if loss == 0.0 else first + 1
        stop = changes[after].speed * (1.0 - 1e-6) if after < len(changes) else end
        stop = min(stop, 1.001 * loss) if loss else stop
    listed = [(c.speed, max(c.error, 1e-9 * c.speed), c.unstable_after, c.kind) for c in found]
    before = found[0].unstable_before if len(found) else at_rest
    if before != at_rest:
        outcome.wrong(f"{before} unstable at rest, true {at_rest}")
    if lossy and at_rest:
        behind = next((count for speed, _, count, _ in listed if loss is not None and speed >= loss), at_rest + 1)
        if behind <= at_rest:
            outcome.wrong(f"{behind} unstable roots beyond {loss:.9g}, true more than {at_rest}")
    else:
        ranges_differ(outcome, answer, listed, before, stop)
    # Both questions must agree.
    grown = next((c for c in found if c.destabilising), None)
    told = None if isinstance(critical, Exception) else critical.speed
    if (grown is None) != (told is None) or (grown and abs(grown.speed - told) > grown.error + critical.error + 1e-9 * told):
        outcome.wrong(f"crossings say {grown and grown.speed}, critical_speed {told}")


def ranges_differ(
    outcome: Outcome, answer: Answer, listed: list[tuple[float, float, int, str]], before: int, stop: float
) -> None:
    """Compares the number of unstable roots as functions of the speed, and kinds where it changes."""
    own = [0.0, *(c.speed for c in answer.changes)]
    told = []  # speeds, those within their errors of a true one in its place, and counts behind
    for speed, error, count, _ in listed:
        near = [c for c in answer.changes if abs(c.speed - speed) <= error + c.error]
        told.append((min(near, key=lambda c: abs(c.speed - speed)).speed if near else speed, count))  # noqa: B023
    at = [speed for speed, _ in told]
    edges = sorted({0.0, *own, *at, stop})
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        true = answer.counts[sum(x <= low for x in own) - 1]
        said = [before, *(count for speed, count in told if speed <= low)][-1]
        if true[0] <= said <= true[1] or high > stop:
            continue
        # A range that only one of both has may be narrow; one change at two speeds is wrong.
        moved = (low in own) != (high in own) and (low in at) != (high in at) and low > 0.0
        if moved or high - low > 1e-6 * high:
            outcome.wrong(f"{said} unstable roots from {low:.9g} to {high:.9g}, true {true[0]}")
            return
    for i, one in enumerate(answer.changes):
        if one.speed > stop or answer.counts[i][0] == answer.counts[i + 1][0]:
            continue
        near = [kind for speed, error, _, kind in listed if abs(speed - one.speed) <= error + one.error]
        kind = "divergence" if one.frequency == 0.0 else "flutter"
        if near and kind not in near:
            outcome.wrong(f"{near[0]} at {one.speed:.9g}, omega = {one.frequency:.6g}")


def safely(seed: int, names: list[str], index: int) -> Outcome:
    """A case's outcome, also where something unforeseen is raised."""
    case = drawn(seed, index, names)
    try:
        return judged(case)
    except Exception as error:
        outcome = Outcome(case)
        outcome.wrong(f"{type(error).__name__}: {error}"[:200])
        return outcome


# --------------------------------------------------------------------------------------- the run


def table(outcomes: list[Outcome]) -> str:
    """By class."""
    rows = [("class", "pipes", "wrong", "refused", "unchecked", "loose", "seconds", "reference")]
    for name in [*CLASSES, "all"]:
        some = [one for one in outcomes if name in (one.case.name, "all")]
        if not some:
            continue
        each = Counter(one.verdict for one in some)
        own, other = (sum(getattr(one, k) for one in some) for k in ("seconds", "reference_seconds"))
        loose = sum(one.loose for one in some)
        rows.append(
            (name, *(str(x) for x in (len(some), each["wrong"], each["refused"], each["unchecked"], loose)),
             f"{own:.1f}", f"{other:.1f}")
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(x.rjust(w) if i else x.ljust(w) for i, (x, w) in enumerate(zip(row, widths, strict=True))) for row in rows]
    reasons = Counter((one.verdict, one.reason) for one in outcomes if one.verdict in ("refused", "unchecked"))
    lines += [f"{verdict} {count}: {reason}" for (verdict, reason), count in reasons.most_common(30)]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pipes", type=int, default=10_000, help="number of cases")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--name", "--class", choices=[*CLASSES], help="this class alone")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--count", type=int, help="as --pipes")
    parser.add_argument("--failures", type=Path, help="file for failing cases")
    given = parser.parse_args(arguments)
    names, count = [given.name] if given.name else [*CLASSES], given.count or given.pipes
    start, ask = time.time(), partial(safely, given.seed, names)
    indices = range(given.first, given.first + count)
    outcomes, failures = [], []
    with ProcessPoolExecutor(given.jobs) as pool:
        asked = pool.map(ask, indices, chunksize=8) if given.jobs > 1 else map(ask, indices)
        for index, one in zip(indices, asked, strict=True):
            outcomes.append(one)
            if one.verdict == "right":
                continue
            line = f"pp.crossings({one.case.text}, {one.case.end!r})  # {index} {one.case.name}: {one.verdict}: {one.reason}"
            failures.append(line)
            if given.failures is None:
                print(line, flush=True)
    if given.failures:
        given.failures.write_text("\n".join(failures) + "\n")
    print(table(outcomes))
    print(f"{time.time() - start:.0f} s")
    return int(any(one.verdict == "wrong" for one in outcomes))


if __name__ == "__main__":
    sys.exit(main())
