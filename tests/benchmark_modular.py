# SPDX-License-Identifier: MIT
"""Error and cost of scenes from parts, next to `Chain`: what generality costs.

Run with `.venv/bin/python tests/benchmark_modular.py`; pytest does not collect it. Prints, and
fails on an error only.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmark_eigenvalues import machine

import pipedyn as pp
from pipedyn import modular as md

failures = []
PIPE = pp.Pipe(0.2, 5.0, drag=0.5)


def clocked(call: Callable[..., Any], *given: Any, least: float = 0.2) -> tuple[float, Any]:
    """Shortest time of a call among those that fit into so many seconds, s, and its answer."""
    answer, best, begun = call(*given), np.inf, time.perf_counter()
    while True:
        start = time.perf_counter()
        answer = call(*given)
        best = min(best, time.perf_counter() - start)
        if time.perf_counter() - begun > least:
            return best, answer


def check(name: str, error: float, bound: float) -> None:
    if not error < bound:
        failures.append(f"{name}: {error:.1e}")


def rates() -> None:
    print("one right-hand side, flow, gravity and drag, bent; microseconds and relative error")
    print(f"{'n':>6} {'Chain':>9} {'scene':>9} {'guided':>9} {'U.-K.':>11} {'error':>9}")
    for n in (5, 10, 20, 50, 100, 1000):
        chain, scene = pp.Chain(PIPE, n), md.chain(PIPE, n)
        guided = scene.plus(md.Guide(n))
        rng = np.random.default_rng(n)
        theta, omega = np.cumsum(rng.normal(size=n)) / n, rng.normal(size=n)
        flat, y = np.concatenate([theta, omega]), scene.state(theta, omega)
        plain, expected = clocked(chain.rhs, 0.0, flat, 5.0)
        cost, found = clocked(scene.rhs, 0.0, y, 5.0)
        turned = np.cumsum(found[3 * n + 2 :: 3])
        error = np.abs(turned - expected[n:]).max() / np.abs(expected[n:]).max()
        met = guided.state(*guided.motion.projected(theta, 0.0 * omega))
        held, _ = clocked(guided.rhs, 0.0, met, 5.0)
        dense = np.nan
        if n <= 50:
            dense, other = clocked(scene.accelerations, y, 5.0, "udwadia-kalaba")
            check(
                "Udwadia-Kalaba", np.abs(other - found[3 * n :]).max() / np.abs(other).max(), 1e-7
            )
        times = " ".join(f"{1e6 * t:9.1f}" for t in (plain, cost, held))
        print(f"{n:6} {times} {1e6 * dense:11.1f} {error:9.1e}")
        check("scene against Chain", error, 1e-8)


def linear() -> None:
    print("\nlinear analysis; seconds and relative difference")
    print(f"{'n':>6} {'':24} {'Chain':>9} {'scene':>9} {'error':>9}")
    for n in (100, 1000):
        chain, scene = pp.Chain(pp.Pipe(0.2), n), md.chain(pp.Pipe(0.2), n)
        cost, mine = clocked(pp.eigenvalues, scene, 5.0, 8)
        plain, theirs = clocked(pp.eigenvalues, chain, 5.0, 8)
        error = np.abs(mine / theirs - 1.0).max()
        print(f"{n:6} {'8 eigenvalues':24} {plain:9.4f} {cost:9.4f} {error:9.1e}")
        check("eigenvalues", error, 1e-9)
        cost, mine = clocked(pp.critical_speed, scene, least=0.0)
        plain, theirs = clocked(pp.critical_speed, chain, least=0.0)
        error = abs(mine.speed / theirs.speed - 1.0)
        print(f"{n:6} {'critical speed':24} {plain:9.4f} {cost:9.4f} {error:9.1e}")
        check("critical speed", error, 1e-9)
    for n in (50, 100, 200, 1000):
        guided = md.chain(pp.Pipe(0.2), n).plus(md.Guide(n))
        cost, held = clocked(pp.critical_speed, guided, least=0.0)
        error = abs(held.speed / 4.493409457909064 - 1.0)
        print(f"{n:6} {'the same, guided end':24} {'':9} {cost:9.4f} {error:9.1e}")
        check("guided end", error, 4.0 / n**2)
    for n in (50, 100, 200):  # what is no chain is dense
        other = md.chain(pp.Pipe(0.2), n).plus(md.TorsionalSpring(n, 1.0, damping=0.0))
        cost, _ = clocked(pp.critical_speed, other, least=0.0)
        print(f"{n:6} {'the same, by matrices':24} {'':9} {cost:9.4f}")


def motion() -> None:
    print("\n10 segments, u = 6, to tau = 10, rtol 1e-6; seconds and error at the free end")
    pipe = pp.Pipe(0.2)

    def run(model: pp.Model, rtol: float = 1e-6) -> pp.Motion:
        return pp.simulate(model, 6.0, 10.0, lambda s: 0.1 * s, samples=101, rtol=rtol)

    chain, scene = pp.Chain(pipe, 10), md.chain(pipe, 10)
    exact = run(chain, 1e-11)
    for name, model in (("Chain", chain), ("scene", scene)):
        cost, found = clocked(run, model, least=0.0)
        error = np.abs(found.tip - exact.tip).max()
        print(f"{name:>6} {cost:9.3f} {error:9.1e}")
        check(f"motion of {name}", error, 1e-3)


if __name__ == "__main__":
    print(machine())
    rates()
    linear()
    motion()
    for failure in failures:
        print(f"FAILED {failure}")
    sys.exit(bool(failures))
