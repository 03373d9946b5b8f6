# SPDX-License-Identifier: MIT
"""What each effect costs a right-hand side, and that one switched off costs nothing.

Run with `.venv/bin/python tests/benchmark_effects.py` after `pip install ".[bench,test]"`; pytest
does not collect it. Prints, and fails on an error only. Each effect is timed alone against the pipe
without any; its error is that of the same code path with the effect too weak to act (1e-30 of it)
beside the path that leaves it out. None and all are held against the dense equations or, for the
reduced model, against three times the nodes. One thread.
"""

from __future__ import annotations

import sys

import numpy as np
from benchmark_motion import reduced_state, state, worst
from independent import dense_rates
from measuring import check, cost_of, ended, machine

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe

SPEED, MEMBERS, WEAK, ROUNDS = 6.0, 256, 1e-30, 5
STRENGTH = {"gravity": 2.0, "drag": 1.0, "damping": 1e-3, "flow": SPEED}
"""gamma, kappa, delta and u; the Coriolis part comes with flow, at beta = 0.2."""


TERMS = {
    "point mass": lambda strength: pp.PointMass(1.0, strength),
    "spring": lambda strength: pp.Spring(1.0, strength),
    "damper": lambda strength: pp.Damper(1.0, strength),
    "stop": lambda strength: pp.Stop(1.0, 0.1, strength),
    "cubic spring": lambda strength: pp.CubicSpring(1.0, strength),
    "tension": pp.Tension,
    "foundation": pp.Foundation,
    "viscosity": pp.Viscosity,
    "added mass": pp.AddedMass,
}
"""Terms by their strength; alone they are 1 strong. At the end, so that functions stay the same."""


def scene(strengths: dict[str, float]) -> tuple[pp.Pipe, float]:
    """The pipe with some effects, and its flow speed."""
    numbers = {"gamma": "gravity", "drag": "drag", "damping": "damping"}
    given = {number: strengths.get(effect, 0.0) for number, effect in numbers.items()}
    terms = [make(strengths[name]) for name, make in TERMS.items() if name in strengths]
    return pp.Pipe(0.2, **given, terms=terms), strengths.get("flow", 0.0)


def chain_of(n: int):
    return lambda pipe: pp.Chain(pipe, n)


def reduced(pipe: pp.Pipe) -> pp.Galerkin:
    return pp.Galerkin(pipe, 8, "legendre")


def states_of(model: pp.Chain | pp.Galerkin) -> np.ndarray:
    """A batch, shape (2 dof, MEMBERS)."""
    if isinstance(model, pp.Chain):
        return state(model.dof, MEMBERS)
    rng = np.random.default_rng(model.dof)
    return np.stack([reduced_state(model, rng) for _ in range(MEMBERS)], axis=1)


def exact(model: pp.Chain | pp.Galerkin, y: np.ndarray, u: float) -> np.ndarray:
    """Rates of one state by another route."""
    if isinstance(model, pp.Chain):
        return dense_rates(model, y, u)
    nodes = 3 * model.motion.nodes(y[: model.dof])
    return _core.Galerkin(core_pipe(model.pipe), True, model.dof, least_nodes=nodes).rhs(0.0, y, u)


def rates(make, strengths: dict[str, float], many: np.ndarray) -> np.ndarray:
    """Accelerations of the first state by itself, then of all, side by side."""
    pipe, u = scene(strengths)
    model = make(pipe)
    one = model.rhs(0.0, many[:, 0].copy(), u)
    return np.column_stack([one, model.rhs(0.0, many, u)])[model.dof :]


def seconds(make, cases: list[dict[str, float]], many: np.ndarray) -> np.ndarray:
    """Of a state by itself and of one in a batch, shape (cases, 2).

    The least of rounds in which all cases take their turn: the machine's speed changes between.
    """
    y, best = many[:, 0].copy(), np.full((len(cases), 2), np.inf)
    made = [(make(pipe), u) for pipe, u in map(scene, cases)]
    for _ in range(ROUNDS):
        for row, (model, u) in zip(best, made, strict=True):
            alone = cost_of(lambda model=model, u=u: model.rhs(0.0, y, u), 0.1)
            batch = cost_of(lambda model=model, u=u: model.rhs(0.0, many, u), 0.1) / MEMBERS
            row[:] = np.minimum(row, [alone, batch])
    return best


def effects(name: str, make) -> None:
    many = states_of(make(pp.Pipe(0.2)))
    plain = rates(make, {}, many)
    cases = {"none": {}, "all": STRENGTH}
    errors = []
    for what, strengths in cases.items():
        pipe, u = scene(strengths)
        model, y = make(pipe), many[:, 0].copy()
        errors.append(worst(model.rhs(0.0, y, u), exact(model, y, u)))
        dragged = pipe.drag and isinstance(model, pp.Galerkin)  # |v| v under the integral
        check(errors[-1], 1e-6 if dragged else 1e-11, f"{name}, {what}")
    for effect, strength in (STRENGTH | dict.fromkeys(TERMS, 1.0)).items():
        cases[effect] = {effect: strength}
        errors.append(worst(rates(make, {effect: WEAK}, many), plain))
        check(errors[-1], 1e-11, f"{name}, {effect} too weak to act")
    costs = seconds(make, list(cases.values()), many)
    for effect, cost, error in zip(cases, costs, errors, strict=True):
        cells = [
            f"{1e6 * one:.4f} | {100.0 * (one / least - 1.0):+.0f} %"
            for one, least in zip(cost, costs[0], strict=True)
        ]
        print(f"| {name} | {effect} | {' | '.join(cells)} | {error:.0e} |")


def main() -> int:
    print(machine() + f", {_core.vector_level()}\n")
    print(f"time of a right-hand side, by itself and as one of {MEMBERS} states, us")
    print("| model | effects | alone | more | in a batch | more | error |")
    print("|---|---|---|---|---|---|---|")
    effects("chain, n = 10", chain_of(10))
    effects("chain, n = 100", chain_of(100))
    effects("Legendre, m = 8", reduced)
    return ended()


if __name__ == "__main__":
    sys.exit(main())
