# SPDX-License-Identifier: MIT
"""Where each model and each numerical route holds, and where it stops: one table.

Run with `.venv/bin/python tests/extremes.py [--quick]`; fails if a row
misleads. Each row is an answer of the package and a reference that shares nothing with it but,
where it says so, another route of the package. Verdicts:

holds: the relative error is below the row's limit, and below the package's own estimate of it.
says so: the error is larger than the limit, and the package's own estimate covers it.
refused: an exception, which names itself.
too slow: more than a minute of one processor.
MISLEADS: none of these.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields
from functools import cache
from typing import Any

import numpy as np
from independent import (
    beck_speed,
    chain_crossing,
    chain_newton_step,
    collocation_eigenvalues,
    companion_eigenvalues,
    dense_rates,
    exact_jacobian,
    exact_rates,
    legendre_highest,
    pipe_rates,
    series_crossing,
    series_newton_step,
)
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

import pipedyn as pp

DIGITS = 1e-8
"""Relative error below which a row holds, where nothing else is said."""

PATIENCE = 60.0
"""Processor time in s beyond which a row is too slow."""

HEAVIEST = 1e5
"""gamma up to which the strong form's eigenvalues are right."""

SHOOTING, SERIES = "mpmath: shooting", "mpmath: power series"


@dataclass(frozen=True)
class Row:
    """One answer and its reference.

    Attributes:
        route: what was asked.
        model: of which model.
        at: at which parameters.
        result: the answer, shortened.
        reference: where the truth is from.
        error: relative; NaN where there is no answer.
        claim: the package's own estimate of it; NaN where it makes none.
        verdict: see above.
        seconds: processor time of the answer.
    """

    route: str
    model: str
    at: str
    result: str
    reference: str
    error: float
    claim: float
    verdict: str
    seconds: float


@dataclass(frozen=True)
class Outcome:
    """An answer's text, its relative error, and what the package estimates that to be."""

    result: str
    error: float
    claim: float = math.nan


def row(
    route: str,
    model: str,
    at: str,
    reference: str,
    ask: Callable[[], Any],
    measure: Callable[[Any], Outcome],
    limit: float = DIGITS,
) -> Row:
    """One row: asks, measures what comes, and judges."""
    start = time.process_time()
    try:
        answer = ask()
    except (pp.PipedynError, ValueError) as refusal:
        seconds = time.process_time() - start
        slow = seconds > PATIENCE
        verdict = "too slow" if slow else f"refused: {type(refusal).__name__}"
        said = str(refusal).split(";")[0][:60]
        return Row(route, model, at, said, reference, math.nan, math.nan, verdict, seconds)
    seconds = time.process_time() - start
    outcome = measure(answer)
    verdict = "too slow" if seconds > PATIENCE else judged(outcome, limit)
    return Row(
        route, model, at, outcome.result, reference, outcome.error, outcome.claim, verdict, seconds
    )


def judged(outcome: Outcome, limit: float) -> str:
    """A verdict on an answer; an estimate that does not cover the error misleads in any case."""
    said = not math.isnan(outcome.claim)
    if said and not outcome.error <= outcome.claim + 8.0 * np.finfo(float).eps:
        return "MISLEADS"
    if outcome.error <= limit:
        return "holds"
    return "says so" if said else "MISLEADS"


def named(model: Any) -> str:
    """A model in a few letters."""
    if isinstance(model, pp.Chain):
        return f"chain n={model.dof}"
    if isinstance(model, pp.Galerkin):
        return f"{model.basis} m={model.dof}"
    return "pipe" if isinstance(model, pp.Continuum) else f"scene of {model.dof}"


def digits_for(pipe: pp.Pipe, u: float) -> int:
    """Digits with which the power series keeps 20: its terms grow like these exponentials."""
    tension = math.sqrt(abs(pipe.gamma)) + u
    return 50 + math.ceil(tension)


def pipe_step(pipe: pp.Pipe, value: complex, u: float) -> complex:
    """Newton's correction of an eigenvalue of the continuous pipe."""
    return series_newton_step(pipe, value, u, digits_for(pipe, u))


def chain_step(chain: pp.Chain, value: complex, u: float) -> complex:
    """The same of a chain's; the highest ones take more digits."""
    ratio = max(chain.springs.max() / chain.springs.min(), abs(chain.pipe.gamma), u**2, abs(value))
    digits = 40 if chain.dof > 1000 else 60 + 6 * min(chain.dof, 200) * (ratio > 1e3)
    digits += math.ceil(3.0 * math.log10(max(abs(value) / 1e3, 1.0))) * min(chain.dof, 200)
    return chain_newton_step(chain, value, u, digits)


def worst_eigenvalue(
    found: pp.Modes, which: list[int] | slice, step: Callable[[complex], complex]
) -> Outcome:
    """The eigenvalue of some whose error is nearest to, or farthest above, what is said of it.

    Errors are relative to the eigenvalue or to the rate 1 / (1 + delta), whichever is more.
    """
    delta = found.shapes[0].model.pipe.damping
    values = found.eigenvalues[which]
    scale = np.maximum(np.abs(values), 1.0 / (1.0 + delta))
    errors = np.array([abs(step(complex(value))) for value in values]) / scale
    claims = found.errors[which] / scale
    i = int(np.argmax(errors / claims))
    return Outcome(f"{values[i]:.6g}", float(errors[i]), float(claims[i]))


def checked_modes(model: Any, u: float, count: int | None = None) -> pp.Modes:
    """Modes, or what `eigenvalues` raises where one of them fails its check."""
    found = pp.modes(model, u, count)
    if not found.converged.all():
        pp.eigenvalues(model, u, count)
    return found


def eigenvalue_row(
    model: Any, u: float, at: str, which: list[int] | slice, count: int | None = 3
) -> Row:
    """The lowest modes' eigenvalues, or some of them all."""
    chain = isinstance(model, pp.Chain)
    if chain and count is not None:
        count = min(count, model.dof)

    def step(value: complex) -> complex:
        return chain_step(model, value, u) if chain else pipe_step(model.pipe, value, u)

    reference = SHOOTING if chain else SERIES
    route = "all eigenvalues" if count is None else "eigenvalues"
    return row(
        *(route, named(model), at, reference, lambda: checked_modes(model, u, count)),
        lambda found: worst_eigenvalue(found, which, step),
    )


def eigenvalues_of_the_pipe(quick: bool) -> Iterator[Row]:
    """The lowest three pairs of the continuous pipe."""
    cases: list[tuple[str, dict[str, float], float]] = [
        ("beta=0, u=100", {"beta": 0.0}, 100.0),
        ("u=0", {"beta": 0.2}, 0.0),
        ("u=100", {"beta": 0.2}, 100.0),
        ("beta=0.999999, u=100", {"beta": 0.999999}, 100.0),
        ("gamma=1e4, u=6", {"beta": 0.2, "gamma": 1e4}, 6.0),
        ("gamma=-1e4, u=6", {"beta": 0.2, "gamma": -1e4}, 6.0),
        ("damping=1e3, u=6", {"beta": 0.2, "damping": 1e3}, 6.0),
        ("damping=1e3, u=100", {"beta": 0.2, "damping": 1e3}, 100.0),
    ]
    if not quick:
        cases += [
            ("beta=1e-12, u=100", {"beta": 1e-12}, 100.0),
            ("gamma=1e5, u=100", {"beta": 0.2, "gamma": 1e5}, 100.0),
        ]
    for at, numbers, u in cases:
        yield eigenvalue_row(pp.Continuum(pp.Pipe(**numbers)), u, at, [0, 1, 2])


def eigenvalues_of_chains(quick: bool) -> Iterator[Row]:
    """The lowest two pairs of chains, by recursion."""
    plain = pp.Pipe(0.2)
    yield eigenvalue_row(pp.Chain(plain, 1), 6.0, "u=6", [0])
    for n in (10, 200, *((1000, 10_000) if not quick else ())):
        yield eigenvalue_row(pp.Chain(plain, n), 6.0, "u=6", [0, 1])
    extremes = [
        ("u=100", plain, 100.0),
        ("beta=0, u=100", pp.Pipe(0.0), 100.0),
        ("beta=0.999999, u=100", pp.Pipe(0.999999), 100.0),
        ("gamma=1e6, u=6", pp.Pipe(0.2, gamma=1e6), 6.0),
        ("gamma=-1e4, u=6", pp.Pipe(0.2, gamma=-1e4), 6.0),
        ("damping=1e3, u=6", pp.Pipe(0.2, damping=1e3), 6.0),
        ("damping=1e3, u=100", pp.Pipe(0.2, damping=1e3), 100.0),
    ]
    for at, pipe, u in extremes:
        for n in (5, 70) if quick else (5, 50, 200):
            yield eigenvalue_row(pp.Chain(pipe, n), u, at, [0, 1])
    for n in (6, 100):
        for at, arrays in unequal(n).items():
            yield eigenvalue_row(pp.Chain(plain, **arrays), 1.0, f"{at}, u=1", [0, 1])
    if not quick:
        yield tends_to_the_pipe(100_000)


def unequal(n: int) -> dict[str, dict[str, np.ndarray]]:
    """Lengths of ratio 1e6 and springs of ratio 1e8, in no order, the same on each call."""
    ranks = np.random.default_rng(7).permutation(n) / (n - 1.0)
    lengths = 10.0 ** (-6.0 * ranks)
    lengths /= lengths.sum()
    springs = n * 10.0 ** (-8.0 * np.random.default_rng(8).permutation(n) / (n - 1.0))
    return {
        "lengths 1e6 : 1": {"lengths": lengths},
        "springs 1e8 : 1": {"springs": springs},
        "both": {"lengths": lengths, "springs": springs},
    }


def tends_to_the_pipe(n: int) -> Row:
    """Of a chain too long to shoot along: its distance to the pipe is below 20 / n^2."""
    model = pp.Chain(pp.Pipe(0.2), n)
    return row(
        *("eigenvalues", named(model), "u=6", SERIES + " of the pipe"),
        lambda: pp.eigenvalues(model, 6.0, 8)[2],
        lambda z: Outcome(f"{z:.6g}", abs(pipe_step(model.pipe, z, 6.0)) / abs(z)),
        20.0 / n**2 + 1e-11,
    )


def eigenvalues_of_reduced_models(quick: bool) -> Iterator[Row]:
    """Second pair at u = 6 against the pipe's, whose distance falls as said; and the highest."""
    pipe, u = pp.Pipe(0.2), 6.0
    sizes = {"beam": (10, 100, 1000), "legendre": (10, 50, 200)}
    for basis, numbers in sizes.items():
        for m in numbers[: 2 if quick else 3]:
            model = pp.Galerkin(pipe, m, basis)
            limit = 2.0 / m**4 + 1e-11 if basis == "beam" else 1e-8
            yield row(
                *("eigenvalues", named(model), "u=6", SERIES + " of the pipe"),
                lambda model=model: pp.eigenvalues(model, u, 8)[2],
                lambda z: Outcome(f"{z:.6g}", abs(pipe_step(pipe, z, u)) / abs(z)),
                limit,
            )


def largest_claim(found: pp.Modes) -> float:
    """What the package says of the worst of eigenvalues, relative."""
    return float((found.errors / np.abs(found.eigenvalues)).max())


def highest_eigenvalues(quick: bool) -> Iterator[Row]:
    """The fastest mode of all: what explicit integrators follow, and where rounding bites first."""
    pipe = pp.Pipe(0.2)

    def highest(model: pp.Galerkin, exact: float, reference: str) -> Row:
        def measured(found: pp.Modes) -> Outcome:
            value = abs(found.eigenvalues[-1])
            return Outcome(f"{value:.6g}i", abs(value / exact - 1.0), found.errors[-1] / exact)

        return row(
            *("highest eigenvalue", named(model), "u=0", reference),
            lambda: checked_modes(model, 0.0),
            measured,
        )

    sizes = (10, 50, 100) if quick else (10, 50, 100, 200)
    for m in sizes:
        model = pp.Galerkin(pipe, m, "legendre")
        yield highest(model, legendre_highest(m), "mpmath: inverse iteration")
    yield row(
        *("all eigenvalues", f"legendre m={sizes[-1]}", "u=6", "residuals"),
        lambda: checked_modes(pp.Galerkin(pipe, sizes[-1], "legendre"), 6.0),
        lambda found: Outcome("", float(found.residuals.max()), largest_claim(found)),
    )
    for m in (10, 100, *((1000,) if not quick else ())):
        yield highest(pp.Galerkin(pipe, m), cantilever_frequency(m), "cos k cosh k = -1")
    for n in (10, 60) if quick else (10, 60, 200):
        yield eigenvalue_row(pp.Chain(pipe, n), 6.0, "u=6", [n // 2, n - 1], None)
    for n in (2, 6) if quick else (2, 6, 40):
        for at, arrays in unequal(n).items():
            yield eigenvalue_row(pp.Chain(pipe, **arrays), 1.0, f"{at}, u=1", slice(None), None)
    overdamped = pp.Chain(pp.Pipe(1e-12, -1e4, damping=1.0), **unequal(6)["lengths 1e6 : 1"])
    yield eigenvalue_row(overdamped, 1.0, "lengths 1e6 : 1, damping=1", slice(None), None)


def critical_row(model: Any, at: str, max_speed: float = 100.0) -> Row:
    """The critical speed, or a search to the end of which `growing` sees nothing grow."""
    pipe = model.pipe

    def ask() -> pp.CriticalSpeed | float:
        try:
            return pp.critical_speed(model, max_speed)
        except pp.NoCrossing as none:
            return none.max_speed

    def measure(found: pp.CriticalSpeed | float) -> Outcome:
        if isinstance(found, float):
            speeds = np.linspace(0.1, 1.0, 4) * found
            growth = max(growing(model, u) for u in speeds)
            return Outcome(f"none to u={found:g}", max(growth, 0.0))
        u, omega = found.speed, found.frequency
        if isinstance(model, pp.Chain):
            exact = float(chain_crossing(model, u, omega, 60 + int(6 * abs(pipe.gamma) ** 0.5))[0])
        elif pipe.beta == 0.0:
            exact = beck_speed()
        else:
            exact = series_crossing(pipe, u, omega, digits_for(pipe, u))[0]
        text = f"{found.kind} in mode {found.mode}, u={u:.9g}"
        return Outcome(text, abs(u / exact - 1.0), found.error / u)

    chain = isinstance(model, pp.Chain)
    reference = SHOOTING if chain else ("mpmath: Beck's column" if pipe.beta == 0.0 else SERIES)
    return row("critical_speed", named(model), at, reference, ask, measure)


def cantilever_frequency(m: int) -> float:
    """Of mode m of the beam."""
    middle = (m - 0.5) * math.pi
    root = brentq(
        lambda k: math.cos(k) + 1.0 / math.cosh(min(k, 700.0)), middle - 1, middle + 1, xtol=1e-15
    )
    return float(root) ** 2


def growing(model: Any, u: float) -> float:
    """Largest growth rate by routes of their own, relative to the rate.

    Of the strong form; rounding spoils that of very heavy pipes, for which a chain stands in.
    """
    if not isinstance(model, pp.Chain) and model.pipe.gamma > HEAVIEST:
        model = pp.Chain(model.pipe, 200)
    if isinstance(model, pp.Chain):
        values = companion_eigenvalues(*model.operators().at(u))
    else:
        values = collocation_eigenvalues(model.pipe, u, 90)[:40]
    return float((values.real / np.maximum(np.abs(values), 1.0)).max() - 1e-8)


def critical_speeds(quick: bool) -> Iterator[Row]:
    """Of pipes and chains; at high beta or gravity the pipe stays stable to the end."""
    aspirating = {"flow": "aspirating", "damping": 1e-3}
    cases: list[tuple[str, dict[str, Any]]] = [
        ("beta=1e-12", {"beta": 1e-12}),
        ("beta=0.99", {"beta": 0.99}),
        ("beta=0.2, gamma=-100", {"beta": 0.2, "gamma": -100.0}),
        ("beta=0.2, damping=1", {"beta": 0.2, "damping": 1.0}),
        ("aspirating, beta=0.999999, damping=1e-3", {"beta": 0.999999, **aspirating}),
    ]
    if not quick:
        cases += [
            ("beta=0.999", {"beta": 0.999}),
            ("beta=0.9999", {"beta": 0.9999}),
            ("gamma=1e4", {"beta": 0.2, "gamma": 1e4}),
            ("gamma=-1e4", {"beta": 0.2, "gamma": -1e4}),
            ("damping=1e3", {"beta": 0.2, "damping": 1e3}),
        ]
    yield critical_row(pp.Continuum(pp.Pipe(0.0)), "beta=0")
    for at, numbers in cases:
        yield critical_row(pp.Continuum(pp.Pipe(**numbers)), at)
    pipes = {
        "beta=1e-12": pp.Pipe(1e-12),
        "beta=0.999999": pp.Pipe(0.999999),
        "gamma=1e3": pp.Pipe(0.2, 1e3),
        "gamma=1e6": pp.Pipe(0.2, 1e6),
        "damping=1e3": pp.Pipe(0.2, damping=1e3),
    }
    for at, pipe in pipes.items():
        yield critical_row(pp.Chain(pipe, 5), at)
    if not quick:
        yield critical_row(pp.Chain(pp.Pipe(0.2), 200), "beta=0.2")


def branches_followed(quick: bool) -> Iterator[Row]:
    """Root loci to u = 100: whether each branch ends on an eigenvalue, and none on another's."""
    pipe = pp.Pipe(0.2)
    damped = pp.Pipe(0.2, damping=1e3)
    cases = [(pp.Chain(pipe, 20), "to u=100"), (pp.Chain(damped, 10), "damping=1e3, to u=20")]
    if not quick:
        cases += [
            (pp.Continuum(pipe), "to u=50"),
            (pp.Chain(pp.Pipe(0.2, 1e6), 20), "gamma=1e6, to u=100"),
        ]
    for model, at in cases:
        end = float(at.rsplit("=", 1)[1])

        def measure(loci: pp.RootLoci, model: Any = model) -> Outcome:
            last, good = loci.eigenvalues[-1], loci.converged[-1]
            u = float(loci.speeds[-1])
            step = chain_step if isinstance(model, pp.Chain) else pipe_step
            by = model if isinstance(model, pp.Chain) else model.pipe
            scale = np.maximum(np.abs(last), 1.0 / (1.0 + model.pipe.damping))
            errors = np.array([abs(step(by, complex(z), u)) for z in last]) / scale
            twice = np.abs(last[:, None] - last[None, :]) + np.diag(np.full(last.size, np.inf))
            if not model.pipe.damping:  # else the slow roots of two modes may form a pair
                errors[(twice <= 1e-9 * scale).any(axis=1)] = math.inf
            return Outcome(f"{last[1]:.6g}", float(errors[good].max(initial=0.0)))

        yield row(
            *("root_loci", named(model), at, SHOOTING if isinstance(model, pp.Chain) else SERIES),
            lambda model=model, end=end: pp.root_loci(model, np.linspace(0.0, end, 21), 4),
            measure,
            1e-6,
        )


def rates(quick: bool) -> Iterator[Row]:
    """rhs and Jacobian at one wild state each, of random angles about 1 rad and rates about 10."""

    def off(found: np.ndarray, exact: np.ndarray) -> Outcome:
        size = np.abs(exact).max()
        return Outcome(f"largest {size:.2g}", float(np.abs(found - exact).max() / size))

    def coiled(basis: str, m: int, turns: int, falling: np.ndarray, limit: float) -> Row:
        model = pp.Galerkin(pp.Pipe(0.2, 10.0, damping=0.01), m, basis)
        coil = model.bent(lambda s: 2.0 * np.pi * turns * s)
        y = np.concatenate([coil, np.random.default_rng(4).standard_normal(m) / falling])
        return row(
            *("rhs", named(model), f"coiled, {turns} turns", "fine quadrature"),
            lambda: model.rhs(0.0, y, 6.0),
            lambda r: off(r, pipe_rates(model, y, 6.0, 500)),
            limit,
        )

    pipe = pp.Pipe(0.2)
    chains = {
        "u=100": (pp.Chain(pipe, 6), 100.0),
        "gamma=1e6": (pp.Chain(pp.Pipe(0.2, 1e6), 6), 6.0),
        "gamma=-1e4": (pp.Chain(pp.Pipe(0.2, -1e4), 6), 6.0),
        "drag=1e4": (pp.Chain(pp.Pipe(0.2, drag=1e4), 6), 6.0),
        "damping=1e3": (pp.Chain(pp.Pipe(0.2, damping=1e3), 6), 6.0),
        "coiled, 30 rad": (pp.Chain(pipe, 6), 6.0),
        **{at: (pp.Chain(pipe, **arrays), 6.0) for at, arrays in unequal(6).items()},
        "n=40": (pp.Chain(pipe, 40), 6.0),
    }
    for at, (chain, u) in chains.items():
        n = chain.dof
        angle = 30.0 if "coiled" in at else 1.0
        y = np.random.default_rng(3).standard_normal(2 * n) * np.repeat([angle, 10.0], n)

        yield row(
            *("rhs", named(chain), at, "mpmath: dense equations"),
            lambda chain=chain, y=y, u=u: chain.rhs(0.0, y, u),
            lambda r, chain=chain, y=y, u=u: off(r, np.array(exact_rates(chain, y, u), float)),
            1e-12,
        )
        if n == 6:
            yield row(
                *("jacobian", named(chain), at, "mpmath: differences"),
                lambda chain=chain, y=y, u=u: chain.jacobian(0.0, y, u),
                lambda jac, chain=chain, y=y, u=u: off(jac, exact_jacobian(chain, y, u)),
                1e-10,
            )
    for basis in ("beam", "legendre"):
        for turns in (3, 30):
            yield coiled(basis, 8, turns, np.ones(8), 1e-9)
    long = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.01), 1000)
    y = np.random.default_rng(3).standard_normal(2000) * np.repeat([1.0, 10.0], 1000)
    yield row(
        *("rhs", named(long), "n=1000", "dense equations"),
        lambda: long.rhs(0.0, y, 6.0),
        lambda r: off(r, dense_rates(long, y, 6.0)),
    )
    for basis, m, limit in (("beam", 60, 1e-10), ("legendre", 30, 1e-8)):
        yield coiled(basis, m, 3, np.arange(1.0, m + 1.0) ** 2, limit)


def motions(quick: bool) -> Iterator[Row]:
    """Short motions from a bow or coil against plain dense equations at rtol 1e-10."""
    pipe = pp.Pipe(0.2)
    cases: list[tuple[str, pp.Chain, float, float, float]] = [
        ("coiled, 3 turns", pp.Chain(pipe, 6), 6.0, 6.0 * math.pi, 0.1),
        ("u=100", pp.Chain(pipe, 3), 100.0, 0.3, 0.02),
        ("gamma=1e6", pp.Chain(pp.Pipe(0.2, 1e6), 4), 6.0, 0.3, 0.01),
        ("gamma=-1e4", pp.Chain(pp.Pipe(0.2, -1e4), 4), 6.0, 0.3, 0.03),
        ("drag=1e4", pp.Chain(pp.Pipe(0.2, drag=1e4), 4), 6.0, 0.3, 0.2),
        ("springs 1e8 : 1", pp.Chain(pipe, **unequal(6)["springs 1e8 : 1"]), 1.0, 0.3, 0.05),
    ]
    for at, chain, u, angle, end in cases:

        def measure(motion: pp.Motion, chain: pp.Chain = chain, u: float = u) -> Outcome:
            start = np.concatenate([motion.q[0], motion.qdot[0]])
            exact = solve_ivp(
                *(lambda t, y: dense_rates(chain, y, u), (0.0, motion.t[-1]), start, "DOP853"),
                rtol=1e-10,
                atol=1e-10,
            ).y[: chain.dof, -1]
            error = np.abs(motion.q[-1] - exact).max() / max(1.0, np.abs(exact).max())
            return Outcome(f"{motion.method}, audit {motion.audit:.0e}", float(error))

        yield row(
            *("simulate", named(chain), at, "dense equations, rtol 1e-10"),
            lambda chain=chain, u=u, angle=angle, end=end: pp.simulate(
                chain, u, end, lambda s: angle * s, times=[0.0, end], rtol=1e-9
            ),
            measure,
            1e-5,
        )
    yield stiff_motion()
    stiff = pp.Galerkin(pp.Pipe(0.2, damping=1e3), 8, "legendre")
    exact = creeping(stiff, "scipy:Radau", 1e-8).tip[-1]
    slower = () if quick else ("scipy:BDF",)
    methods = ("scipy:LSODA", "scipy:Radau", *slower)
    for method in methods:
        yield row(
            *("simulate", named(stiff), f"damping=1e3, {method}", "Radau, rtol 1e-8"),
            lambda method=method: creeping(stiff, method, 1e-6),
            lambda motion: Outcome(
                f"audit {motion.audit:.0e}",
                float(np.abs(motion.tip[-1] - exact).max()),
            ),
            1e-5,
        )


def stiff_motion() -> Row:
    """Of segments of very different lengths: a unit of time, where flutter takes some ten."""
    chain = pp.Chain(pp.Pipe(0.2), **unequal(6)["lengths 1e6 : 1"])
    return row(
        *("simulate, a unit of time", named(chain), "lengths 1e6 : 1, u=6", "none"),
        lambda: pp.simulate(chain, 6.0, 1.0, lambda s: 0.3 * s, times=[0.0, 1.0]),
        lambda motion: Outcome(f"{motion.evaluations} rhs", math.nan),
    )


def creeping(model: pp.Galerkin, method: str, rtol: float) -> pp.Motion:
    """An overdamped pipe that creeps back."""
    return pp.simulate(
        model, 6.0, 50.0, lambda s: 0.3 * s, times=[0.0, 50.0], rtol=rtol, method=method
    )


def kept_energy(motion: pp.Motion) -> Outcome:
    """What a motion without flow and damping lost or won, and its audit."""
    error = abs(motion.energy[-1] - motion.energy[0]) / np.abs(motion.energy).max()
    return Outcome(f"{motion.evaluations} rhs", float(error), motion.audit)


def long_runs(quick: bool) -> Iterator[Row]:
    """One segment without gravity is a harmonic oscillator at any amplitude, and a joint without
    spring a pendulum: exact states after many periods, and what the audit says of the energy."""
    periods = 300 if quick else 10_000
    swing = pp.Chain(pp.Pipe(0.2), 1)
    omega = math.sqrt(3.0 * swing.springs[0])
    end = periods * 2.0 * math.pi / omega

    @cache
    def swung(rtol: float) -> pp.Motion:
        return pp.simulate(swing, 0.0, end, [1.0], times=[0.0, end], rtol=rtol)

    for rtol in (1e-6, 1e-9, 1e-12):
        yield row(
            *("simulate", "chain n=1", f"{periods} periods, rtol {rtol:g}", "energy is constant"),
            lambda rtol=rtol: swung(rtol),
            kept_energy,
            1e-2,
        )
    yield row(
        *("simulate", "chain n=1", f"{periods} periods, rtol 1e-12", "state: cosine"),
        lambda: swung(1e-12),
        lambda motion: Outcome(
            f"{motion.q[-1, 0]:.12f}",
            math.hypot(motion.q[-1, 0] - 1.0, motion.qdot[-1, 0] / omega),
        ),
        1e-5,
    )
    pendulum = pp.Chain(pp.Pipe(0.2, 10.0), springs=[0.0])
    square, modulus = 15.0, math.sin(1.5) ** 2
    after = 100.25 * 4.0 * ellipk(modulus) / math.sqrt(square)
    sn = ellipj(ellipk(modulus) - math.sqrt(square) * after, modulus)[0]
    exact = 2.0 * math.asin(math.sin(1.5) * sn)
    yield row(
        *("simulate", "chain n=1", "pendulum from 3 rad, 100 swings", "elliptic functions"),
        lambda: pp.simulate(pendulum, 0.0, after, [3.0], times=[0.0, after], rtol=1e-12),
        lambda motion: Outcome(f"{motion.q[-1, 0]:.9f}", abs(motion.q[-1, 0] - exact)),
        1e-5,
    )
    chain = pp.Chain(pp.Pipe(0.2), 2)
    turns = 100 if quick else 10_000
    end = turns * 2.0 * math.pi / abs(pp.eigenvalues(chain, 0.0, 1)[0])
    yield row(
        *("simulate", named(chain), f"{turns} periods, no flow", "energy is constant"),
        lambda chain=chain, end=end: pp.simulate(
            chain, 0.0, end, lambda s: s, times=[0.0, end], rtol=1e-9
        ),
        kept_energy,
        1e-3,
    )
    yield long_flutter(50 if quick else 1000)


def long_flutter(periods: int) -> Row:
    """Flutter that stays on its cycle, found as a boundary-value problem."""
    chain = pp.Chain(pp.Pipe(0.2), 3)
    u = 1.2 * pp.critical_speed(chain).speed
    cycle = pp.limit_cycle(chain, u)
    end = periods * cycle.period

    def measure(motion: pp.Motion) -> Outcome:
        error = abs(np.abs(motion.tip[1:, 0]).max() / cycle.amplitude - 1.0)
        return Outcome(f"amplitude {cycle.amplitude:.6f}, audit {motion.audit:.0e}", float(error))

    return row(
        *("simulate", "chain n=3", f"flutter, {periods} periods", "limit_cycle"),
        lambda: pp.simulate(
            *(chain, u, end, cycle.q[0], cycle.qdot[0]),
            times=[0.0, *np.linspace(end - cycle.period, end, 400)],
            rtol=1e-8,
        ),
        measure,
        1e-4,
    )


def cycles(quick: bool) -> Iterator[Row]:
    """Limit cycles from barely past the onset to drag that all but forbids them."""
    chain = pp.Chain(pp.Pipe(0.2), 3)
    onset = pp.hopf(chain)
    for beyond in (1e-2, 1e-4, 1e-6, 1e-8):
        u = onset.speed * (1.0 + beyond)
        law = math.sqrt(onset.amplitude_law * (u - onset.speed))
        yield row(
            *("limit_cycle", "chain n=3", f"u = u_c (1 + {beyond:g})", "hopf's law"),
            lambda u=u: pp.limit_cycle(chain, u),
            lambda found, law=law: Outcome(
                f"amplitude {found.amplitude:.6g}", abs(found.amplitude / law - 1.0)
            ),
            beyond + 1e-6,
        )


SECTIONS: tuple[Callable[[bool], Iterator[Row]], ...] = (
    eigenvalues_of_the_pipe,
    eigenvalues_of_chains,
    eigenvalues_of_reduced_models,
    highest_eigenvalues,
    critical_speeds,
    branches_followed,
    rates,
    motions,
    long_runs,
    cycles,
)


def cells(one: Row) -> list[str]:
    """A row as text, numbers shortened."""
    return [f"{x:.1e}" if isinstance(x, float) else str(x) for x in astuple(one)]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="seconds only")
    asked = parser.parse_args()
    names = [field.name for field in fields(Row)]
    print("| " + " | ".join(names) + " |\n" + "|---" * len(names) + "|")
    rows = []
    for section in SECTIONS:
        for one in section(asked.quick):
            rows.append(one)
            print("| " + " | ".join(cells(one)) + " |", flush=True)
    misleading = [one for one in rows if one.verdict == "MISLEADS"]
    print(f"\n{len(rows)} rows, {len(misleading)} mislead")
    return 1 if misleading else 0


if __name__ == "__main__":
    sys.exit(main())
