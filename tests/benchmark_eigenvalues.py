# SPDX-License-Identifier: MIT
"""Error and cost of eigenvalues and critical speeds; prints, and fails on an error only.

Run with `.venv/bin/python tests/benchmark_eigenvalues.py`; pytest does not collect it.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Self

import mpmath
import numpy as np
from independent import chain_newton_step, determinant_crossing
from measuring import check, ended, machine, timed
from scipy.optimize import brentq

import pipedyn as pp
from pipedyn import _core
from pipedyn.linear.eigenproblem import eigenproblem

BETA, SPEED, COUNT = 0.2, 6.0, 8
FASTEST = 0.99  # of which the search has to go furthest
PIPE = pp.Pipe(beta=BETA)


def worst(values: np.ndarray, exact: np.ndarray) -> float:
    """Largest error of a set of eigenvalues, relative to each."""
    distance = np.abs(values[:, None] - exact[None, :])
    return float(np.max(distance.min(axis=0) / np.abs(exact)))


# ---------------------------------------------------------------------------------- references


def refined(chain: pp.Chain, value: complex) -> complex:
    """The chain's own eigenvalue nearest to a guess, by transfer matrices in 40 digits.

    From the free end to the clamp, angle, displacement, force and elastic moment are carried over
    each segment; the two motions of the free end must combine to none at the clamp.
    """
    root_beta, square = mpmath.sqrt(mpmath.mpf(BETA)), mpmath.mpf(SPEED) ** 2
    rows = [
        [mpmath.mpf(float(number)) for number in row]
        for row in zip(
            *(chain.lengths, chain.centres, chain.gyration_radii, chain.springs), strict=True
        )
    ]

    def determinant(guess: mpmath.mpc) -> mpmath.mpc:
        inertia, coriolis = guess**2, root_beta * SPEED * guess
        columns = []
        for theta, w in ((mpmath.mpc(1), mpmath.mpc(0)), (mpmath.mpc(0), mpmath.mpc(1))):
            force, moment = square * theta, mpmath.mpc(0)
            for length, center, radius, spring in reversed(rows):
                w -= length * theta
                arm = center * length
                moment = moment - length * (
                    (inertia * (arm**2 + radius**2) + coriolis * length - square) * theta
                    + inertia * arm * w
                    + force
                )
                force += length * (inertia * (w + arm * theta) + 2 * coriolis * theta)
                theta -= moment / spring
            columns.append((theta, w))
        (a, c), (b, d) = columns
        return a * d - b * c

    with mpmath.workdps(40):
        guess, step = mpmath.mpc(value), mpmath.mpf(10) ** -20
        for _ in range(2):
            here = determinant(guess)
            guess -= here * step / (determinant(guess + step) - here)
        return complex(guess)


def plain_critical_speed(n: int) -> float:
    """What a user would write: matrices of equal segments, a scan of the speeds, a refinement."""
    length, places = 1.0 / n, np.arange(n)
    springs = np.full(n, float(n))
    springs[0] = 2.0 * n
    beyond = (n - 1 - places) * length
    moments = length * (beyond + 0.5 * length)
    mass = length * moments[np.maximum.outer(places, places)]
    mass[places, places] = length**2 * (beyond + length / 3.0)
    velocity = np.sqrt(BETA) * length**2 * (np.eye(n) + 2.0 * np.triu(np.ones((n, n)), 1))
    flux = -length * np.eye(n)
    flux[:, -1] += length
    stiffness = np.diag(springs)
    stiffness[places[:-1], places[:-1]] += springs[1:]
    stiffness[places[:-1], places[1:]] -= springs[1:]
    stiffness[places[1:], places[:-1]] -= springs[1:]

    def growth(u: float) -> float:
        step = np.zeros((2 * n, 2 * n))
        step[:n, n:] = np.eye(n)
        step[n:] = -np.linalg.solve(mass, np.hstack([stiffness + u * u * flux, u * velocity]))
        return float(np.linalg.eigvals(step).real.max())

    u = 0.5
    while growth(u) < 1e-6:
        u += 0.5
    return float(brentq(growth, u - 0.5, u, xtol=1e-10))


# ---------------------------------------------------------------------------------- benchmarks


def against_dense() -> None:
    n = 800
    chain = pp.Chain(PIPE, n)
    found, cost = timed(lambda: pp.eigenvalues(pp.Chain(PIPE, n), SPEED, COUNT))
    exact = np.array([refined(chain, value) for value in found])

    mass, velocity, stiffness = chain.operators().at(SPEED)
    companion = np.zeros((2 * n, 2 * n))
    companion[:n, n:] = np.eye(n)
    companion[n:] = -np.linalg.solve(mass, np.hstack([stiffness, velocity]))
    all_values, dense_cost = timed(lambda: np.linalg.eigvals(companion), 0.0)
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


def any_chain(dice: np.random.Generator) -> pp.Chain:
    """Of 2 to 200 segments, one in four wildly unequal, with or without damping and terms."""
    n = int(dice.choice([2, 3, 5, 8, 12, 20, 30, 64, 100, 200]))
    terms: list[pp.PointMass | pp.Spring | pp.Damper] = []
    if dice.random() < 0.3:
        terms = [
            pp.PointMass(dice.uniform(0.1, 1.0), dice.uniform(0.1, 2.0)),
            pp.Spring(dice.uniform(0.1, 1.0), dice.uniform(0.0, 50.0)),
            pp.Damper(dice.uniform(0.1, 1.0), dice.uniform(0.0, 2.0)),
        ]
    pipe = pp.Pipe(
        dice.uniform(0.0, 0.95),
        dice.choice([0.0, 0.0, 10.0, 100.0, -5.0]),
        flow=str(dice.choice(["ejecting", "aspirating"])),
        damping=dice.choice([0.0, 0.0, 1e-3, 1e-2, 0.1]),
        terms=terms,
    )
    decades = dice.choice([0.0, 0.0, 1.0, 6.0])
    if decades == 0.0:
        return pp.Chain(pipe, n)
    lengths = 10.0 ** (-0.5 * dice.uniform(0.0, decades, n))
    springs = n * 10.0 ** (0.5 * dice.uniform(-decades, decades, n))
    return pp.Chain(pipe, lengths=lengths / lengths.sum(), springs=springs)


def random_chains(count: int = 1000) -> None:
    """How many recursion leaves to matrices, and how well its errors bound the true ones."""
    dice = np.random.default_rng(11)
    left, seconds, ratios = 0, 0.0, []
    for i in range(count):
        chain, u = any_chain(dice), dice.uniform(0.0, 20.0)
        every = chain.dof <= 64 and dice.random() < 0.6
        asked = 2 * chain.dof if every else min(COUNT, 2 * chain.dof)
        spectrum = eigenproblem(chain).spectrum()
        start = time.process_time()
        found = spectrum.by_recursion(u, asked, vectors=True)
        seconds += time.process_time() - start
        if found is None or not found.converged.all():
            left += 1
        elif i % 20 == 0 and chain.dof <= 30:
            k = int(dice.integers(asked))
            value = complex(found.values[k])
            true = abs(chain_newton_step(chain, value, u, 200))
            ratios.append(true / (found.uncertain[k] + 2e-15 * abs(value)))
    print(f"{count} random chains by recursion: {1e3 * seconds / count:.2f} ms each on average")
    print(f"  left to matrices: {left}; true error at most {max(ratios):.2f} of the stated one\n")
    check(left / count, 0.05, "share of random chains that recursion leaves to matrices")
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
        if n == 10:
            plain, cost = timed(lambda: plain_critical_speed(10))
            line("the same by numpy and a scan", cost, abs(plain / found.speed - 1.0))
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


def hopf_points() -> None:
    """Error: of the onset, against critical_speed; of the coefficient, as stated."""
    print("| Hopf point | time (ms) | error of the speed | of the first Lyapunov coefficient |")
    print("|---|---|---|---|")
    for n in (10, 40):
        found, cost = timed(lambda n=n: pp.hopf(pp.Chain(PIPE, n)))
        error = abs(found.speed / pp.critical_speed(pp.Chain(PIPE, n)).speed - 1.0)
        of_law = found.lyapunov_error / abs(found.lyapunov)
        print(f"| hopf, n = {n} | {1e3 * cost:.2f} | {error:.0e} | {of_law:.0e} |")
        check(error, 1e-9, f"hopf, n = {n}")
    print()


def critical_speeds() -> None:
    exact = determinant_crossing(BETA, "5.5914", "13.7147", 30)[0]
    fastest = determinant_crossing(FASTEST, "18.2896", "74.5179", 30)[0]
    print(f"critical speed, beta = {BETA}, gamma = 0: {exact:.9f} by the exact determinant,")
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


class InCore:
    """Processor time in the compiled core's searches, while it is entered."""

    CALLS = (
        (_core, "crossings"),
        (_core.Truncated, "of_larger"),
        (_core.Eigenproblem, "modes_at_rest"),
        (_core.Eigenproblem, "lowest"),
    )

    def __enter__(self) -> Self:
        self.seconds = 0.0
        self._own = [getattr(place, name) for place, name in self.CALLS]
        for (place, name), call in zip(self.CALLS, self._own, strict=True):
            setattr(place, name, self._timed(call))
        return self

    def __exit__(self, *_: object) -> None:
        for (place, name), call in zip(self.CALLS, self._own, strict=True):
            setattr(place, name, call)

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed_call(*arguments: Any, **named: Any) -> Any:
            start = time.process_time()
            try:
                return call(*arguments, **named)
            finally:
                self.seconds += time.process_time() - start

        return timed_call


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
    print("\n| continuous pipe | answer | stated relative error | time (ms) | in the core |")
    print("|---|---|---|---|---|")
    for name, ask in rows.items():
        ask()
        with InCore() as core:
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
        print(f"| {name} | {answer} | {stated} | {1e3 * cost:.1f} | {1e3 * core.seconds:.1f} |")
        # Where a mass all but pins the end, rounding hides growth of 1e-11 of the frequency.
        most = 1e-6 if name.startswith("tip mass") else 1e-8
        check(0.0 if math.isnan(error) else error, most, name)


def beside_threads() -> None:
    """Serial and with two threads in turn, so that other work on the machine meets both."""
    print("\nstability curve over beta, gamma = 10: best of three, s")
    print("| segments | values | serial | two threads | gain |")
    print("|---|---|---|---|---|")
    for n, points in ((10, 50), (40, 12)):
        betas = np.linspace(0.05, 0.9, points)
        with ThreadPoolExecutor(2) as pool:
            answers: dict[bool, np.ndarray] = {}
            times: dict[bool, list[float]] = {False: [], True: []}
            for threaded in 3 * (False, True):
                start = time.perf_counter()
                curve = pp.stability_curve(
                    lambda beta, n=n: pp.Chain(pp.Pipe(beta, 10.0), n),
                    betas,
                    executor=pool if threaded else None,
                )
                times[threaded].append(time.perf_counter() - start)
                answers[threaded] = curve.speeds
        serial, beside = min(times[False]), min(times[True])
        print(f"| {n} | {points} | {serial:.2f} | {beside:.2f} | {serial / beside:.2f} |")
        same = np.array_equal(answers[False], answers[True], equal_nan=True)
        check(0.0 if same else 1.0, 0.0, "critical speeds by threads")


def main() -> int:
    print(machine() + "\n")
    against_dense()
    against_continuum()
    random_chains()
    searches()
    hopf_points()
    critical_speeds()
    continuous_pipes()
    beside_threads()
    return ended()


if __name__ == "__main__":
    sys.exit(main())
