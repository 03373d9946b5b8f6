# SPDX-License-Identifier: MIT
"""Error and cost of scenes from parts, next to `Chain`: what generality costs.

Run with `.venv/bin/python tests/benchmark_modular.py`; pytest does not collect it. Prints, and
fails on an error only.
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
import redundant
from measuring import check, ended, machine, timed

import pipedyn as pp
from pipedyn import modular as md

PIPE = pp.Pipe(0.2, 5.0, drag=0.5)


def rates() -> None:
    print("one right-hand side, flow, gravity and drag, bent; microseconds and relative error")
    print(f"{'n':>6} {'Chain':>9} {'scene':>9} {'guided':>9} {'dense':>11} {'error':>9}")
    for n in (5, 10, 20, 50, 100, 1000):
        chain, scene = pp.Chain(PIPE, n), md.chain(PIPE, n)
        guided = scene.plus(md.Guide(n))
        rng = np.random.default_rng(n)
        theta, omega = np.cumsum(rng.normal(size=n)) / n, rng.normal(size=n)
        flat, y = np.concatenate([theta, omega]), scene.state(theta, omega)
        expected, plain = timed(partial(chain.rhs, 0.0, flat, 5.0))
        found, cost = timed(partial(scene.rhs, 0.0, y, 5.0))
        turned = np.cumsum(found[3 * n + 2 :: 3])
        error = np.abs(turned - expected[n:]).max() / np.abs(expected[n:]).max()
        met = guided.state(*guided.onto_constraints(theta, 0.0 * omega))
        _, held = timed(partial(guided.rhs, 0.0, met, 5.0))
        dense = np.nan
        if n <= 50:
            other, dense = timed(partial(redundant.accelerations, scene, y, 5.0))
            apart = np.abs(other - found[3 * n :]).max() / np.abs(other).max()
            check(apart, 1e-7, "scene against the dense route")
        times = " ".join(f"{1e6 * t:9.1f}" for t in (plain, cost, held))
        print(f"{n:6} {times} {1e6 * dense:11.1f} {error:9.1e}")
        check(error, 1e-8, "scene against Chain")


def linear() -> None:
    print("\nlinear analysis; seconds and relative difference")
    print(f"{'n':>6} {'':24} {'Chain':>9} {'scene':>9} {'error':>9}")
    for n in (100, 1000):
        chain, scene = pp.Chain(pp.Pipe(0.2), n), md.chain(pp.Pipe(0.2), n)
        for what, ask, seconds in (
            ("8 eigenvalues", lambda model: pp.eigenvalues(model, 5.0, 8), 0.3),
            ("critical speed", lambda model: np.array(pp.critical_speed(model).speed), 0.0),
        ):
            mine, cost = timed(partial(ask, scene), seconds)
            theirs, plain = timed(partial(ask, chain), seconds)
            error = np.abs(mine / theirs - 1.0).max()
            print(f"{n:6} {what:24} {plain:9.4f} {cost:9.4f} {error:9.1e}")
            check(error, 1e-9, what)
    for n in (50, 100, 200, 1000):
        guided = md.chain(pp.Pipe(0.2), n).plus(md.Guide(n))
        held, cost = timed(partial(pp.critical_speed, guided), 0.0)
        error = abs(held.speed / 4.493409457909064 - 1.0)
        print(f"{n:6} {'the same, guided end':24} {'':9} {cost:9.4f} {error:9.1e}")
        check(error, 4.0 / n**2, "guided end")
    for n in (50, 100, 200):  # what is no chain is dense
        other = md.chain(pp.Pipe(0.2), n).plus(md.TorsionalSpring(n, 1.0, damping=0.0))
        _, cost = timed(partial(pp.critical_speed, other), 0.0)
        print(f"{n:6} {'the same, by matrices':24} {'':9} {cost:9.4f}")


def motion() -> None:
    print("\n10 segments, u = 6, to tau = 10, rtol 1e-6; seconds and error at the free end")
    pipe = pp.Pipe(0.2)

    def run(model: pp.Model, rtol: float = 1e-6) -> pp.Motion:
        return pp.simulate(model, 6.0, 10.0, lambda s: 0.1 * s, samples=101, rtol=rtol)

    chain, scene = pp.Chain(pipe, 10), md.chain(pipe, 10)
    exact = run(chain, 1e-11)
    for name, model in (("Chain", chain), ("scene", scene)):
        found, cost = timed(partial(run, model), 0.0)
        error = np.abs(found.tip - exact.tip).max()
        print(f"{name:>6} {cost:9.3f} {error:9.1e}")
        check(error, 1e-3, f"motion of {name}")


if __name__ == "__main__":
    print(machine())
    rates()
    linear()
    motion()
    sys.exit(ended())
