# SPDX-License-Identifier: MIT
"""What `choose` promises, on random pipes: its error against a sharper answer, its cost by hand.

    python tests/benchmark_choose.py [pipes] [seed]

For each pipe, linear quantity and tolerance it prints the model chosen, its true error (against the
continuous pipe, with more functions than any that the search has seen), its time, the time of the
cheapest model tried by hand (every spring rule and both bases, sizes up to 200) that is as good,
and the time of the whole search. It fails if a true error is above its tolerance. Times are
processor times of one thread, each the least of several.
"""

import math
import sys
import warnings

import numpy as np

import pipedyn as pd
from pipedyn.families import FAMILIES, RULES
from pipedyn.quantity import Answer
from pipedyn.trade import clock, measured

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8)
HAND = (2, 3, 4, 5, 6, 8, 10, 12, 16, 24, 40, 64, 100, 200)
DEAR = 0.15
"""Seconds of an answer after which a family is not tried by hand further."""

SHARP = 48
"""Legendre functions of the truth."""


def random_pipe(rng):
    """beta in [0.02, 0.98], gamma in [-5, 60], both flows; some damping where it aspirates."""
    flow = str(rng.choice(["ejecting", "aspirating"], p=[0.65, 0.35]))
    damping = 10.0 ** rng.uniform(-3.0, np.log10(0.05))
    if flow == "ejecting" and rng.random() < 0.5:
        damping = 0.0
    return pd.Pipe(rng.uniform(0.02, 0.98), rng.uniform(-5.0, 60.0), flow=flow, damping=damping)


def questions(rng, pipe, loss):
    """Linear questions to a pipe that loses stability at a speed."""
    u = rng.uniform(0.2, 1.2) * min(loss, 15.0)
    speeds = np.linspace(0.0, max(u, 0.5), 21)
    return {
        "critical_speed": {},
        "frequencies": {"u": u, "count": int(rng.integers(1, 7))},
        "root_loci": {"speeds": speeds, "count": int(rng.integers(1, 5))},
    }


def by_hand(pipe, quantity, reference):
    """Rows of every family, sizes growing until they are dear."""
    rows = []
    for name in (*RULES, "beam", "legendre"):
        family = FAMILIES[name]
        for size in HAND:
            if size < quantity.least or (name == "legendre" and size > 64):
                continue
            row = measured(pipe, quantity, family, size, reference, 1)
            rows.append(row)
            if row.seconds > DEAR:
                break
    return rows


def truth(quantity, pipe, chosen):
    """Error against Legendre functions beyond those of the search, followed where need be."""
    sharp = pd.Galerkin(pipe, SHARP, "legendre")
    if quantity.name == "critical_speed":
        exact = quantity.answer(pd.Continuum(pipe))
    elif quantity.name == "root_loci":
        loci = pd.root_loci(sharp, quantity.speeds, quantity.count)
        exact = Answer(np.concatenate([loci.eigenvalues, loci.partners], axis=1))
    else:
        exact = quantity.answer(sharp)
    return quantity.distance(quantity.answer(chosen), exact)


def main():
    pipes, seed = (int(word) for word in [*sys.argv[1:], *("20", "1")[len(sys.argv) - 1 :]])
    rng = np.random.default_rng(seed)
    failures, dearer, longer = [], {}, {}
    print("| quantity | tolerance | chosen | true error | ms | by hand | search / answer | pipe |")
    print("|---|---|---|---|---|---|---|---|")
    for _ in range(pipes):
        pipe = random_pipe(rng)
        loss = pd.critical_speed(pd.Continuum(pipe)).speed
        for name, conditions in questions(rng, pipe, loss).items():
            hand = None
            for tolerance in TOLERANCES:
                search = math.inf
                for _ in range(3 if name == "frequencies" else 1):
                    begun = clock()
                    choice = pd.choose(pipe, name, tolerance, **conditions)
                    search = min(search, clock() - begun)
                if hand is None:
                    hand = by_hand(pipe, choice.quantity, choice.quantity.reference(pipe, 1e-10))
                error = truth(choice.quantity, pipe, choice.model)
                # Time of both afresh, as the search itself takes each once.
                best = measured(
                    pipe, choice.quantity, FAMILIES[choice.family], choice.size, choice.reference, 3
                ).seconds
                good = [row for row in hand if row.error <= tolerance] or [choice.row]
                least = min(good, key=lambda row: row.seconds)
                again = measured(
                    pipe, choice.quantity, FAMILIES[least.family], least.size, choice.reference, 3
                ).seconds
                ratio, share = best / again, search / best
                dearer.setdefault(name, []).append(ratio)
                longer.setdefault(name, []).append(share)
                flag = ""
                if error > tolerance:
                    failures.append(f"{name} {tolerance:g} {pipe!r}: {error:.1e}")
                    flag = " WRONG"
                told = f"{choice.family} {choice.size}"
                other = f"{least.family} {least.size}: {1e3 * again:.2f} ({ratio:.2f})"
                flag += " DEAR" if ratio > 2.0 else ""
                flag += " LONG" if share > 10.0 else ""
                print(
                    f"| {name} | {tolerance:g} | {told} | {error:.1e}{flag} | {1e3 * best:.2f} | "
                    f"{other} | {share:.1f} | {pipe!r} |",
                    flush=True,
                )
    print()
    for name in dearer:
        a, b = np.array(dearer[name]), np.array(longer[name])
        print(
            f"{name}: cost / cheapest by hand: median {np.median(a):.2f}, largest {a.max():.2f}, "
            f"above 2: {np.sum(a > 2.0)} of {a.size}; "
            f"search / answer: median {np.median(b):.1f}, largest {b.max():.1f}, "
            f"above 10: {np.sum(b > 10.0)}"
        )
    for failure in failures:
        print(f"FAILED {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(main())
