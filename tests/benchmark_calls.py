# SPDX-License-Identifier: MIT
"""Time and error of what users wait for, and of what they ask a thousand times.

Run with `.venv/bin/python tests/benchmark_calls.py [row ...]`; pytest does not collect it. With
`--beside PYTHON`, the interpreter of an environment with another version of the package, each row
is measured with both in turn. Prints, and fails on an error only. Each row takes a process and one
thread of its own; times are the processor times of that process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

ROWS: dict[str, Callable[[], Iterator[float]]] = {}
"""Rows by name; each is a generator: the first value begins the time, which ends at the second one,
the error of the answer."""


def row(function: Callable[[], Iterator[float]]) -> Callable[[], Iterator[float]]:
    ROWS[function.__name__.replace("_", " ")] = function
    return function


def swings(segments: int, u: float, end: float, samples: int | None = None) -> Iterator[float]:
    chain = pp.Chain(pp.Pipe(0.2), segments)
    yield 0.0
    yield pp.simulate(chain, u, end, lambda s: 0.1 * s, samples=samples).audit


def cycle(model: pp.Chain | pp.Galerkin) -> Iterator[float]:
    pp.limit_cycle(model, 7.0)
    yield 0.0
    yield pp.limit_cycle(model, 7.0).error


def diagram(model: pp.Chain | pp.Galerkin, low: float, high: float) -> Iterator[float]:
    yield 0.0
    found = pp.bifurcation_diagram(model, np.linspace(low, high, 40), brute_force=4)
    yield max(one.residual for branch in found.cycles for one in branch.cycles)


@row
def the_import() -> Iterator[float]:
    import numpy  # noqa: F401

    yield 0.0
    import pipedyn  # noqa: F401

    yield 0.0


@row
def first_critical_speed() -> Iterator[float]:
    yield 0.0
    yield pp.critical_speed(pp.Chain(pp.Pipe(0.2), 10)).error


@row
def stability_curve_of_10000() -> Iterator[float]:
    betas = np.linspace(0.05, 0.5, 10_000)
    yield 0.0
    curve = pp.stability_curve(lambda beta: pp.Chain(pp.Pipe(beta), 10), betas)
    yield max(one.error for one in curve.critical if one)


@row
def swings_of_20_segments() -> Iterator[float]:
    yield from swings(20, 6.0, 60.0)


@row
def swings_of_20_with_61_samples() -> Iterator[float]:
    yield from swings(20, 6.0, 60.0, 61)


@row
def swings_of_60_segments() -> Iterator[float]:
    yield from swings(60, 6.0, 20.0)


@row
def swings_of_1000_damped() -> Iterator[float]:
    chain = pp.Chain(pp.Pipe(0.2, damping=0.01), 1000)
    yield 0.0
    yield pp.simulate(chain, 6.0, 1.0, lambda s: 0.1 * s, samples=2).audit


@row
def cycle_of_8_functions() -> Iterator[float]:
    yield from cycle(pp.Galerkin(pp.Pipe(0.2), 8, "legendre"))


@row
def cycle_of_20_segments() -> Iterator[float]:
    yield from cycle(pp.Chain(pp.Pipe(0.2), 20))


@row
def cycle_of_40_segments() -> Iterator[float]:
    yield from cycle(pp.Chain(pp.Pipe(0.2), 40))


@row
def diagram_of_2_segments() -> Iterator[float]:
    yield from diagram(pp.Chain(pp.Pipe(0.2, 20.0, drag=0.5), 2), 4.0, 12.0)


@row
def diagram_of_3_segments() -> Iterator[float]:
    yield from diagram(pp.Chain(pp.Pipe(0.3), 3), 4.0, 9.0)


@row
def diagram_of_6_functions() -> Iterator[float]:
    yield from diagram(pp.Galerkin(pp.Pipe(0.2), 6), 5.0, 8.0)


@row
def chaotic_attractor() -> Iterator[float]:
    stop = pp.Stop(0.8, 0.05, 1000.0)
    chain = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.002, terms=(stop,)), 4)
    yield 0.0
    found = pp.attractors(chain, 6.42714, 1, transient=25.0, duration=60.0)
    yield float(found.basins[0].ending != "chaotic")


@row
def parametric_regions() -> Iterator[float]:
    pipe, asked = pp.Pipe(0.2, 10.0), (5.5, np.linspace(0.05, 0.4, 12), (5.0, 60.0))
    yield 0.0
    found = pp.parametric_regions(pp.Continuum(pipe), *asked)
    yield 0.0
    other = pp.parametric_regions(pp.Galerkin(pipe, 24, "legendre"), *asked)
    apart = [np.abs(a.edges / b.edges - 1.0) for a, b in zip(found, other, strict=True)]
    yield max(float(np.nanmax(one)) for one in apart)


@row
def film() -> Iterator[float]:
    chain = pp.Chain(pp.Pipe(0.2), 10)
    motion = pp.simulate(chain, 6.5, 10.0, lambda s: 0.1 * s)
    yield 0.0
    with tempfile.TemporaryDirectory() as folder:
        pp.plot.animate(motion, Path(folder) / "film.gif")
    yield 0.0


def measured(name: str) -> None:
    """Prints the time and the error of a row."""
    steps = ROWS[name]()
    next(steps)
    start = time.process_time()
    error = next(steps)
    cost = time.process_time() - start
    error = next(steps, error)
    print(f"{cost * 1e3:11.1f} ms {error:8.0e}", end="", flush=True)
    if not error < 1e-4:
        sys.exit(f"{name}: error {error:.1e} is not within 1e-4")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", nargs="*", metavar="row", choices=[[], *ROWS])
    parser.add_argument("--beside", metavar="PYTHON")
    asked = parser.parse_args()
    print(machine())
    failed = 0
    for name in asked.rows or ROWS:
        print(f"{name:32}", end="", flush=True)
        for python in [sys.executable, *([asked.beside] if asked.beside else [])]:
            failed += subprocess.call([python, __file__, "--measure", name])
        print()
    return int(failed > 0)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        if sys.argv[2] not in ("the import", "first critical speed"):
            import numpy as np

            import pipedyn as pp
        elif sys.argv[2] == "first critical speed":
            import pipedyn as pp
        measured(sys.argv[2])
    else:
        from measuring import machine

        sys.exit(main())
