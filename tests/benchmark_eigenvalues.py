# SPDX-License-Identifier: MIT
"""Error and cost of eigenvalues and critical speeds; prints, and fails on an error only.

Run with `.venv/bin/python tests/benchmark_eigenvalues.py`; pytest does not collect it.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from campaign_cases import drawn
from independent import chain_newton_step, companion_eigenvalues, series_crossing
from measuring import check, ended, machine, timed

import pipedyn as pp
from pipedyn.linear.eigenproblem import eigenproblem

BETA, SPEED, COUNT = 0.2, 6.0, 8
FASTEST = 0.99  # of which the search has to go furthest
PIPE = pp.Pipe(beta=BETA)


def worst(values: np.ndarray, exact: np.ndarray) -> float:
    """Largest error of a set of eigenvalues, relative to each."""
    distance = np.abs(values[:, None] - exact[None, :])
    return float(np.max(distance.min(axis=0) / np.abs(exact)))


# ---------------------------------------------------------------------------------- benchmarks


def against_dense() -> None:
    n = 800
    chain = pp.Chain(PIPE, n)
    found, cost = timed(lambda: pp.eigenvalues(pp.Chain(PIPE, n), SPEED, COUNT))
    exact = found + [chain_newton_step(chain, value, SPEED, 40) for value in found]

    matrices = chain.operators().at(SPEED)
    all_values, dense_cost = timed(lambda: companion_eigenvalues(*matrices), 0.0)
    error = worst(found, exact)
    print(f"{COUNT} lowest eigenvalues, chain of {n} segments, beta = {BETA}, u = {SPEED:g}")
    print("  route                              time (s)   error, against 40 digits")
    print(f"  numpy.linalg.eigvals, companion   {dense_cost:9.3f}   {worst(all_values, exact):.1e}")
    print(f"  pipedyn.eigenvalues               {cost:9.5f}   {error:.1e}")
    print(f"  {dense_cost / cost:.0f} times faster\n")
    check(error, 1e-9, f"eigenvalues of {n} segments")


def against_continuum() -> None:
    exact = pp.eigenvalues(pp.Continuum(PIPE), SPEED, COUNT)
    print(f"{COUNT} lowest eigenvalues, beta = {BETA}, u = {SPEED:g}, against the continuous pipe")
    print("  segments       time (ms)   error")
    found = {}
    for n in (100, 800, 1600, 10_000, 100_000):
        found[n], cost = timed(lambda n=n: pp.eigenvalues(pp.Chain(PIPE, n), SPEED, COUNT))
        print(f"  {n:8d}   {1e3 * cost:11.3f}   {worst(found[n], exact):.1e}")
    extrapolated = worst((4.0 * found[1600] - found[800]) / 3.0, exact)
    print(f"  800 and 1600 extrapolated       {extrapolated:.1e}\n")
    check(worst(found[100_000], exact), 1e-6, "eigenvalues of 100000 segments")
    check(extrapolated, 1e-8, "extrapolated eigenvalues")


def random_chains(count: int = 500) -> None:
    """How many recursion leaves to matrices, and how well its errors bound the true ones."""
    left, seconds, chains, ratios = 0, 0.0, 0, []
    for i in range(count):
        chain = eval(drawn(11, i, ["cantilevered", "aspirating"]).text, {"pp": pp})
        if not isinstance(chain, pp.Chain):
            continue
        dice = np.random.default_rng(i)
        u, asked = dice.uniform(0.0, 20.0), min(int(dice.choice([COUNT, 128])), 2 * chain.dof)
        start = time.process_time()
        found = eigenproblem(chain).spectrum().by_recursion(u, asked, vectors=True)
        seconds, chains = seconds + time.process_time() - start, chains + 1
        if found is None or not found.converged.all():
            left += 1
        elif i % 10 == 0 and chain.dof <= 30:
            k = int(dice.integers(asked))
            value = complex(found.values[k])
            true = abs(chain_newton_step(chain, value, u, 200))
            ratios.append(true / (found.uncertain[k] + 2e-15 * abs(value)))
    print(f"{chains} random chains by recursion: {1e3 * seconds / chains:.2f} ms each on average")
    print(f"  left to matrices: {left}; true error at most {max(ratios):.2f} of the stated one\n")
    check(left / chains, 0.05, "share of random chains that recursion leaves to matrices")
    check(max(ratios), 1.0, "true error of random chains, in the stated one")


def searches() -> None:
    """Searches of chains; errors: of a crossing what its root moves by in 60 digits, relative."""
    print("searches of chains, beta = 0.2")
    print("| search | time (ms) | error |")
    print("|---|---|---|")

    def line(name: str, cost: float, error: float) -> None:
        print(f"| {name} | {1e3 * cost:.2f} | {error:.0e} |")
        check(error, 1e-9, name)

    def off(chain: pp.Chain, crossing: pp.Crossing) -> float:
        root = 1j * crossing.frequency
        return float(abs(chain_newton_step(chain, root, crossing.speed, 60) / root))

    for n in (10, 40, 200, 1000):
        found, cost = timed(lambda n=n: pp.critical_speed(pp.Chain(PIPE, n)))
        line(f"critical_speed, n = {n}", cost, off(pp.Chain(PIPE, n), found))
    chain = pp.Chain(PIPE, 10)
    every, cost = timed(lambda: pp.crossings(pp.Chain(PIPE, 10), 20.0))
    line("crossings to u = 20, n = 10", cost, max(off(chain, c) for c in every if c.frequency))
    speeds = np.linspace(0.0, 10.0, 81)
    loci, cost = timed(lambda: pp.root_loci(pp.Chain(PIPE, 10), speeds))
    line("root_loci, 81 speeds, n = 10", cost, float(loci.errors[1:].max()))
    betas = np.linspace(0.01, 0.9, 50)
    for n in (10, 40):
        curve, cost = timed(
            lambda n=n: pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), n), betas)
        )
        line(f"stability_curve, 50 beta, n = {n}", cost, max(c.error for c in curve.critical if c))
        check(float(len(curve.failures)), 0.0, f"points of the stability curve, n = {n}")
    print()


def critical_speeds() -> None:
    exact = series_crossing(PIPE, 5.5914, 13.7147)[0]
    fastest = series_crossing(pp.Pipe(FASTEST), 18.2896, 74.5179)[0]
    print(f"critical speed, beta = {BETA}, gamma = 0: {exact:.9f} by power series,")
    print(f"beta = {FASTEST}: {fastest:.9f}")
    print("| model | critical speed | relative error | time (ms) |")
    print("|---|---|---|---|")
    makers: list[tuple[str, Callable[[], pp.Chain | pp.Galerkin | pp.Continuum]]] = [
        (f"chain, {rule}, n = {n}", lambda rule=rule, n=n: pp.Chain(PIPE, n, springs=rule))
        for rule in ("rayleigh", "consistent", "midpoint")
        for n in (10, 40)
    ]
    makers += [
        (f"reduced, {basis}, m = {m}", lambda basis=basis, m=m: pp.Galerkin(PIPE, m, basis))
        for basis, m in (("beam", 4), ("beam", 10), ("legendre", 10), ("legendre", 16))
    ]
    makers.append(("continuous pipe", lambda: pp.Continuum(PIPE)))
    fast = f"continuous pipe, beta = {FASTEST}"
    makers.append((fast, lambda: pp.Continuum(pp.Pipe(FASTEST))))
    for name, make in makers:
        found, cost = timed(lambda make=make: pp.critical_speed(make()))
        error = found.speed / (fastest if name == fast else exact) - 1.0
        digits = "< 1e-12" if abs(error) < 1e-12 else f"{error:+.0e}"
        if abs(error) > 1e-4:
            digits = f"{100.0 * error:+.2f} %"
        print(f"| {name} | {found.speed:.7f} | {digits} | {1e3 * cost:.1f} |")
        if name.startswith("continuous"):
            check(abs(error), 1e-9, "critical speed of the continuous pipe")


def even(count: int) -> tuple[float, ...]:
    """Places of so many supports that leave equal spans."""
    return tuple(np.arange(1, count + 1) / (count + 1))


def pipeline() -> pp.Pipe:
    """200 m of a 30-inch pipe with a wall of half an inch, full of water, on soil of 5 MN/m2."""
    outer, inner, length = 0.762, 0.762 - 2 * 0.0127, 200.0
    bending = 2.07e11 * np.pi / 64.0 * (outer**4 - inner**4)
    steel, water = 7850.0 * (outer**2 - inner**2), 1000.0 * inner**2
    soil = pp.Foundation(5e6 * length**4 / bending)
    return pp.Pipe(water / (water + steel), root="pinned", end="pinned", terms=(soil,))


def continuous_pipes() -> None:
    """Searches of the continuous pipe and others that once took long, with the error they state."""
    tip = pp.PointMass(1.0, 0.897), pp.Spring(1.0, 19.07)
    viscous = pp.Pipe(0.3, flow="aspirating", damping=1e-4, terms=(pp.Viscosity(30.0),))
    continuum, spans = pp.Continuum, pp.Pipe(0.3, supports=even(49))
    window = {"beta": (0.05, 0.95), "u": (0.0, 20.0)}
    rows: dict[str, Callable[[], Any]] = {
        "gamma = 998, damping 1.4e-4": lambda: pp.critical_speed(
            continuum(pp.Pipe(0.225, 998.0, damping=1.4e-4))
        ),
        "beta = 0.95, gamma = 200": lambda: pp.critical_speed(continuum(pp.Pipe(0.95, 200.0))),
        "nine supports": lambda: pp.critical_speed(continuum(pp.Pipe(0.3, supports=even(9)))),
        "nine supports, pinned end": lambda: pp.critical_speed(
            continuum(pp.Pipe(0.3, end="pinned", supports=even(9)))
        ),
        "fifty spans": lambda: pp.critical_speed(
            continuum(replace(spans, end="pinned")), max_speed=400.0
        ),
        "fifty spans, 60 eigenvalues": lambda: pp.eigenvalues(
            continuum(replace(spans, end="pinned")), 0.0, count=60
        ),
        "pipeline on soil": lambda: pp.critical_speed(continuum(pipeline())),
        "pipeline on soil, to u = 300": lambda: pp.critical_speed(continuum(pipeline()), 300.0),
        "tip mass and spring, crossings to u = 20": lambda: pp.crossings(
            continuum(pp.Pipe(0.994375, 169.518, terms=tip)), 20.0
        ),
        "chain of 400, aspirating, viscous": lambda: pp.critical_speed(pp.Chain(viscous, 400)),
        "stability_curve, 50 beta": lambda: pp.stability_curve(
            lambda beta: continuum(pp.Pipe(beta)), np.linspace(0.05, 0.95, 50)
        ),
        "boundary in beta and u": lambda: pp.boundary(continuum(PIPE), "beta", "u", window),
    }
    print("\n| continuous pipe | answer | stated relative error | time (ms) |")
    print("|---|---|---|---|")
    for name, ask in rows.items():
        ask()
        start = time.process_time()
        found = ask()
        cost = time.process_time() - start
        answer, error = "", math.nan
        if isinstance(found, pp.CriticalSpeed):
            answer, error = f"u = {found.speed:.6f}", found.error / found.speed
        elif isinstance(found, pp.Crossings):
            answer = f"{len(found)} crossings"
            error = max(one.error / one.speed for one in found)
        stated = "" if math.isnan(error) else f"{error:.0e}"
        print(f"| {name} | {answer} | {stated} | {1e3 * cost:.1f} |")
        # Where a mass all but pins the end, rounding hides growth of 1e-11 of the frequency.
        most = 1e-6 if name.startswith("tip mass") else 1e-8
        check(0.0 if math.isnan(error) else error, most, name)


def main() -> int:
    print(machine() + "\n")
    against_dense()
    against_continuum()
    random_chains()
    searches()
    critical_speeds()
    continuous_pipes()
    return ended()


if __name__ == "__main__":
    sys.exit(main())
