# SPDX-License-Identifier: MIT
"""Error and cost of motions: integrators, a flutter to its limit cycle, ensembles.

Run with `.venv/bin/python tests/benchmark_simulate.py`; pytest does not collect it. Prints, and
fails on an error only. Takes some minutes: the plain formulation is slow.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from independent import dense_rates
from measuring import check, ended, machine, timed
from scipy.integrate import ode, solve_ivp

import pipedyn as pp
from pipedyn import modular as md
from pipedyn.motion.integrator import choose_method, fastest_rates

TOLERANCES = 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9


def methods() -> None:
    """Explicit against implicit steps at equal error, over models, damping, tolerance, members."""
    print(
        "u = 5 to 6, beta = 0.2: time of 'dop853' over that of 'radau' where both have the larger"
    )
    print(
        "error of q of the two at rtol 1e-3, 1e-5, 1e-7; what 'auto' takes; how often it costs the"
    )
    print("cheaper; and error of q of 'auto' at rtol 1e-6")
    print("| model | delta | members | 1e-3 | 1e-5 | 1e-7 | auto | costs | error |")
    print("|---|---|---|---|---|---|---|---|---|")
    makes: dict[str, Callable[[pp.Pipe], Any]] = {
        "chain, n = 3": lambda pipe: pp.Chain(pipe, 3),
        "chain, n = 5": lambda pipe: pp.Chain(pipe, 5),
        "chain, n = 20": lambda pipe: pp.Chain(pipe, 20),
        "chain with drag, n = 12": lambda pipe: pp.Chain(replace(pipe, drag=1.0), 12),
        "chain, n = 60": lambda pipe: pp.Chain(pipe, 60),
        "beam, m = 6": lambda pipe: pp.Galerkin(pipe, 6),
        "legendre, m = 8": lambda pipe: pp.Galerkin(pipe, 8, "legendre"),
        "guided scene, n = 10": lambda pipe: md.chain(pipe, 10).plus(md.Guide(6)),
        "guided scene, n = 40": lambda pipe: md.chain(pipe, 40).plus(md.Guide(21)),
    }
    for name, make in makes.items():
        for delta in (0.0, 1e-4, 1e-3, 1e-2):
            model = make(pp.Pipe(0.2, damping=delta))
            for members in (1, 4, 32):
                fastest = max(fastest_rates(model))
                if members > 1 and (model.integrated > 20 or "scene" in name):
                    continue
                chosen = choose_method(model, members)
                compared(f"| {name} | {delta:g} | {members} |", model, members, chosen, fastest)
    print()


def compared(row: str, model: Any, members: int, chosen: str, fastest: float) -> None:
    """Prints a row of `methods`; the explicit one is left out where it takes minutes."""
    end = 1.0 if model.integrated <= 20 else 0.1
    speeds = np.linspace(5.0, 6.0, members)

    def states(method: str, rtol: float) -> Any:
        many = pp.simulate_many(
            *(model, speeds, end, lambda s: 0.05 * s**2), samples=11, rtol=rtol, method=method
        )
        return np.stack([motion.q for motion in many.motions])

    exact = states("radau", 1e-11)
    costs: dict[str, list[tuple[float, float]]] = {}  # and errors
    for method in ("dop853", "radau"):
        if method == "dop853" and fastest * end > 1e5:
            continue
        costs[method] = []
        for rtol in TOLERANCES:
            ask = partial(states, method, rtol)
            found, cost = timed(ask, 1.0, time.process_time)
            costs[method].append((cost, np.abs(found - exact).max()))
    error = costs[chosen][TOLERANCES.index(1e-6)][1]
    check(error, 1e-4, f"{row} by {chosen} at rtol 1e-6")
    cells, loss = ["-"] * 3, 1.0
    if len(costs) == 2:
        cells = []
        for i in (0, 2, 4):
            larger = max(of[i][1] for of in costs.values())
            least = {m: min(cost for cost, e in of if e <= larger) for m, of in costs.items()}
            cells.append(f"{least['dop853'] / least['radau']:.2f}")
            loss = max(loss, least[chosen] / min(least.values()))
    print(row, " | ".join(cells), f"| {chosen} | {loss:.1f} | {error:.0e} |", flush=True)


def scipys_own(model: pp.Model, u: float, q0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """What a user would write: coordinates by `scipy.integrate.ode` on the model's own rates."""
    solver = ode(lambda t, y: model.rhs(t, y, u))
    solver.set_integrator("dop853", rtol=1e-6, atol=1e-8, nsteps=10**9)
    solver.set_initial_value(np.concatenate([q0, 0.0 * q0]), 0.0)
    return np.array([q0, *(solver.integrate(t)[: q0.size] for t in times[1:])])


def flutter() -> None:
    """20 segments from a small push to the settled limit cycle, against plain dense numpy."""
    chain, u, end = pp.Chain(pp.Pipe(0.2), 20), 6.0, 60.0
    q0 = chain.bent(lambda s: 0.01 * s)
    ask = partial(pp.simulate, chain, u, end, q0, rtol=1e-6, samples=601)
    ours, cost = timed(ask, 1.0)
    start = time.thread_time()
    plain = solve_ivp(
        lambda t, y: dense_rates(chain, y, u),
        (0.0, end),
        np.concatenate([q0, np.zeros(20)]),
        method="DOP853",
        rtol=1e-6,
        atol=1e-8,
        t_eval=ours.t,
    )
    dense = time.thread_time() - start
    by_script, script = timed(lambda: scipys_own(chain, u, q0, ours.t), 1.0)
    exact = pp.simulate(chain, u, end, q0, rtol=1e-10, samples=601)
    tip = chain.tips(plain.y[:20])
    print("20 segments, u = 6, beta = 0.2, a small push, to tau = 60, rtol 1e-6")
    print("| route | s | times faster | largest error of the tip | audit |")
    print("|---|---|---|---|---|")
    for name, seconds, found, audit in (
        ("dense numpy, solve_ivp DOP853", dense, tip, np.nan),
        ("a user's script, ode dop853 on rhs", script, chain.tips(by_script.T), np.nan),
        ("pipedyn.simulate", cost, ours.tip, ours.audit),
    ):
        error = np.abs(found - exact.tip).max()
        print(f"| {name} | {seconds:.2f} | {dense / seconds:.0f} | {error:.0e} | {audit:.0e} |")
        check(error, 1e-3, f"flutter by {name}")
    print()


def main() -> int:
    print(machine() + "\n")
    methods()
    flutter()
    return ended()


if __name__ == "__main__":
    sys.exit(main())
