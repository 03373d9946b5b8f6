# SPDX-License-Identifier: MIT
"""Error and cost of motions: integrators, a flutter to its limit cycle, ensembles.

Run with `.venv/bin/python tests/benchmark_simulate.py`; pytest does not collect it. Prints, and
fails on an error only. Takes some minutes: the plain formulation is slow.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from benchmark_eigenvalues import machine
from independent import dense_rates
from scipy.integrate import ode, solve_ivp

import pipedyn as pp
from pipedyn.motion.integrator import choose_method

failures = []


def clocked(call: Callable[[], Any], rounds: int = 3) -> tuple[float, Any]:
    """Shortest time of a call, s, and its answer; once where it takes seconds."""
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        answer = call()
        best = min(best, time.perf_counter() - start)
        if best > 2.0:
            break
    return best, answer


def bow(s: np.ndarray) -> np.ndarray:
    return 0.3 * s


def methods() -> None:
    """Which integrator is cheapest, over size, damping and tolerance."""
    print("To tau = 2 at u = 6, beta = 0.2: ms and largest error of q; * is what 'auto' takes")
    print("| model | delta | rtol | dop853 | lsoda | Radau |")
    print("|---|---|---|---|---|---|")
    for name, make in (
        ("chain, n = 5", lambda pipe: pp.Chain(pipe, 5)),
        ("chain, n = 20", lambda pipe: pp.Chain(pipe, 20)),
        ("chain, n = 50", lambda pipe: pp.Chain(pipe, 50)),
        ("beam, m = 6", lambda pipe: pp.Galerkin(pipe, 6)),
        ("legendre, m = 8", lambda pipe: pp.Galerkin(pipe, 8, "legendre")),
    ):
        for delta in (0.0, 1e-3, 1e-2):
            model = make(pp.Pipe(0.2, damping=delta))
            sharp = {"samples": 21, "rtol": 1e-11}
            exact = pp.simulate(
                model, 6.0, 2.0, bow, method="scipy:LSODA" if delta else "dop853", **sharp
            )
            for rtol in (1e-3, 1e-6, 1e-9):
                chosen = choose_method(model, rtol)
                cells = []
                for method in ("dop853", "scipy:LSODA", "scipy:Radau"):
                    if method == "scipy:Radau" and (model.dof > 8 or rtol < 1e-8):
                        cells.append("-")
                        continue
                    cost, found = clocked(
                        lambda model=model, rtol=rtol, method=method: pp.simulate(
                            model, 6.0, 2.0, bow, method=method, samples=21, rtol=rtol
                        )
                    )
                    error = np.abs(found.q - exact.q).max()
                    mark = " *" if method == chosen else ""
                    cells.append(f"{1e3 * cost:.1f} ({error:.0e}){mark}")
                print(f"| {name} | {delta:g} | {rtol:g} | " + " | ".join(cells) + " |", flush=True)
    print()


def scripted(chain: pp.Chain, u: float, q0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The tip by scipy's compiled integrator on the model's right-hand side."""
    solver = ode(lambda t, y: chain.rhs(t, y, u))
    solver.set_integrator("dop853", rtol=1e-6, atol=1e-8, nsteps=10**9)
    solver.set_initial_value(np.concatenate([q0, np.zeros(chain.dof)]))
    states = [solver.y, *(solver.integrate(t) for t in times[1:])]
    return chain.tips(np.array(states)[:, : chain.dof].T)


def flutter() -> None:
    """20 segments from a small push to the settled limit cycle, against plain dense numpy."""
    chain, u, end = pp.Chain(pp.Pipe(0.2), 20), 6.0, 60.0
    q0 = chain.bent(lambda s: 0.01 * s)
    cost, ours = clocked(lambda: pp.simulate(chain, u, end, q0, rtol=1e-6, samples=601))
    start = time.perf_counter()
    plain = solve_ivp(
        lambda t, y: dense_rates(chain, y, u),
        (0.0, end),
        np.concatenate([q0, np.zeros(20)]),
        method="DOP853",
        rtol=1e-6,
        atol=1e-8,
        t_eval=ours.t,
    )
    dense = time.perf_counter() - start
    script, by_script = clocked(lambda: scripted(chain, u, q0, ours.t))
    exact = pp.simulate(chain, u, end, q0, rtol=1e-10, samples=601)
    tip = chain.tips(plain.y[:20])
    print("20 segments, u = 6, beta = 0.2, a small push, to tau = 60, rtol 1e-6")
    print("| route | s | times faster | largest error of the tip | audit |")
    print("|---|---|---|---|---|")
    for name, seconds, found, audit in (
        ("dense numpy, solve_ivp DOP853", dense, tip, np.nan),
        ("a user's script, ode dop853 on rhs", script, by_script, np.nan),
        ("pipedyn.simulate", cost, ours.tip, ours.audit),
    ):
        error = np.abs(found - exact.tip).max()
        print(f"| {name} | {seconds:.2f} | {dense / seconds:.0f} | {error:.0e} | {audit:.0e} |")
        if not error < 1e-3:
            failures.append(f"flutter by {name}: error {error:.1e}")
    print()


def ensembles() -> None:
    """A hundred members, on all cores, against a hundred motions."""
    print("100 flow speeds from 4 to 7 to tau = 10, rtol 1e-6")
    print("| n | 100 motions, s | ensemble, s | CPU, s | times faster | largest difference of q |")
    print("|---|---|---|---|---|---|")
    speeds = np.linspace(4.0, 7.0, 100)
    for n in (5, 10, 20):
        chain = pp.Chain(pp.Pipe(0.2), n)
        used = time.process_time()
        cost, together = clocked(
            lambda chain=chain: pp.simulate_many(chain, speeds, 10.0, bow, samples=101), 1
        )
        used = time.process_time() - used
        start = time.perf_counter()
        alone = [pp.simulate(chain, u, 10.0, bow, samples=101) for u in speeds]
        each = time.perf_counter() - start
        apart = max(np.abs(a.q - b.q).max() for a, b in zip(together.motions, alone, strict=True))
        print(
            f"| {n} | {each:.2f} | {cost:.2f} | {used:.2f} | {each / cost:.1f} | {apart:.0e} |",
            flush=True,
        )
        if not apart < 1e-3:
            failures.append(f"ensemble of {n} segments: difference {apart:.1e}")
    print()


def main() -> int:
    print(machine() + "\n")
    ensembles()
    methods()
    flutter()
    for failure in failures:
        print(f"FAILED {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
