# SPDX-License-Identifier: MIT
"""Error and cost of the motion: the chain's against pinocchio, the reduced model's.

Run with `.venv/bin/python tests/benchmark_motion.py` after `pip install ".[bench,test]"`; pytest
does not collect it. Prints, and fails on an error only. Flow, drag, damping and gravity act on our
side; the peer, which has no flow, moves the same bars on the same hinges with gravity alone. One
thread.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from independent import (
    bent_state,
    dense_jacobian,
    dense_rates,
    derivative_along,
    exact_rates,
    worst,
)
from measuring import check, cost_of, ended, machine

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe

SPEED, MEMBERS = 6.0, 256
PIPE = pp.Pipe(beta=0.2, gamma=2.0, drag=1.0, damping=1e-3)


def state(n: int, members: int = 0) -> np.ndarray:
    """Angles of some tenths of a radian between neighbours, rates of order 1."""
    rng = np.random.default_rng(n)
    shape = (n, members) if members else (n,)
    angles = np.cumsum(rng.normal(scale=0.3, size=shape), axis=0)
    return np.concatenate([angles, rng.normal(size=shape)])


# --------------------------------------------------------------------------------------- references


def exact_accelerations(chain: pp.Chain, y: np.ndarray, u: float) -> np.ndarray:
    """theta'' in 30 digits."""
    return np.array(exact_rates(chain, y, u, 30)[chain.dof :], float)


def pinocchio_chain(n: int) -> tuple[Callable[[], object], Callable[[], object], float]:
    """aba, its derivatives, and the error of aba."""
    import pinocchio

    model, length, parent = pinocchio.Model(), 1.0 / n, 0
    model.gravity.linear = np.array([PIPE.gamma, 0.0, 0.0])  # down is x, where the chain hangs
    inertia = pinocchio.Inertia(
        length, np.array([length / 2, 0.0, 0.0]), np.diag([1e-12, 1.0, 1.0]) * length**3 / 12
    )
    for j in range(n):
        offset = np.array([length if j else 0.0, 0.0, 0.0])
        place = pinocchio.SE3(np.eye(3), offset)
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), place, f"joint{j}")
        model.appendBodyToJoint(parent, inertia, pinocchio.SE3.Identity())
    data, y = model.createData(), state(n)
    q, v = np.diff(y[:n], prepend=0.0), np.diff(y[n:], prepend=0.0)
    torque = np.zeros(n)
    hinged = pp.Chain(pp.Pipe(0.0, gamma=PIPE.gamma), n, springs=np.zeros(n))
    found = np.cumsum(pinocchio.aba(model, data, q, v, torque))
    return (
        lambda: pinocchio.aba(model, data, q, v, torque),
        lambda: pinocchio.computeABADerivatives(model, data, q, v, torque),
        worst(found, exact_accelerations(hinged, y, 0.0)),
    )


# --------------------------------------------------------------------------------------- benchmarks


Route = tuple[str, str, Callable[[], object], float]
"""Question, route, call and error."""


def peers(n: int) -> tuple[list[Route], dict[str, float]]:
    """Other ways to the answers, and pinocchio's time for each question."""
    chain, y = pp.Chain(PIPE, n), state(n)
    aba, derivatives, aba_error = pinocchio_chain(n)
    dense_error = worst(dense_rates(chain, y, SPEED)[n:], exact_accelerations(chain, y, SPEED))
    routes: list[Route] = [
        ("rhs", "dense numpy", lambda: dense_rates(chain, y, SPEED), dense_error),
        ("rhs", "pinocchio aba", aba, aba_error),
        ("jacobian", "pinocchio derivatives", derivatives, np.nan),
    ]
    return routes, {"rhs": cost_of(aba), "jacobian": cost_of(derivatives)}


def ours(n: int) -> list[Route]:
    """Our three questions at the level in use, each error checked."""
    chain, y, many = pp.Chain(PIPE, n), state(n), state(n, MEMBERS)
    speeds = np.linspace(3.0, 7.0, MEMBERS)
    some = [0, MEMBERS // 2 + 1, MEMBERS - 1]
    batch = [exact_accelerations(chain, many[:, j], speeds[j]) for j in some]
    errors = (
        worst(chain.rhs(0.0, y, SPEED)[n:], exact_accelerations(chain, y, SPEED)),
        worst(chain.jacobian(0.0, y, SPEED), dense_jacobian(chain, y, SPEED)),
        worst(chain.rhs(0.0, many, speeds)[n:, some], np.stack(batch, axis=1)),
    )
    level = _core.vector_level()
    check(errors[0], 1e-12, f"rhs, n = {n}, {level}")
    check(errors[1], 1e-11, f"jacobian against complex steps, n = {n}, {level}")
    check(errors[2], 1e-12, f"{MEMBERS} states, n = {n}, {level}")
    return [
        ("rhs", level, lambda: chain.rhs(0.0, y, SPEED), errors[0]),
        ("jacobian", level, lambda: chain.jacobian(0.0, y, SPEED), errors[1]),
        (f"rhs, {MEMBERS} states", level, lambda: chain.rhs(0.0, many, speeds), errors[2]),
    ]


def right_hand_sides() -> None:
    for n in (10, 100):
        routes, peer_costs = peers(n)
        print(f"n = {n}: time of a state, against pinocchio's for the same question")
        print("| question | route | us | times faster | error |")
        print("|---|---|---|---|---|")
        for level in (None, *_core.vector_levels()):
            if level is not None:
                _core.set_vector_level(level)
                routes = ours(n)
            for question, route, call, error in routes:
                cost = cost_of(call) / (MEMBERS if "states" in question else 1)
                faster = peer_costs["jacobian" if question == "jacobian" else "rhs"] / cost
                digits = "not measured" if np.isnan(error) else f"{error:.0e}"
                print(f"| {question} | {route} | {1e6 * cost:.3f} | {faster:.1f} | {digits} |")
        print()


REDUCED = pp.Pipe(beta=0.2, gamma=2.0, damping=1e-3)
REDUCED_DRAG = pp.Pipe(beta=0.2, gamma=2.0, drag=1.0, damping=1e-3)


def reduced_model(pipe: pp.Pipe, basis: str, m: int) -> list[tuple[float, float]]:
    """Errors of rhs, a batch and the Jacobian, each with the cost of a state, s.

    rhs against the same equations with three times the nodes, the Jacobian against differences,
    whose steps move the kinks of drag's integrand.
    """
    model, rng = pp.Galerkin(pipe, m, basis), np.random.default_rng(m)
    many = np.stack([bent_state(model, rng, 1.0) for _ in range(MEMBERS)], axis=1)
    y, speeds = many[:, 0].copy(), np.linspace(3.0, 7.0, MEMBERS)
    finer = _core.Galerkin(
        core_pipe(pipe), basis == "legendre", m, least_nodes=3 * model.core.nodes(y[:m])
    )
    jacobian = model.jacobian(0.0, y, SPEED)
    scale = np.diag(model.elastic_scale)
    steps = 1e-2 * np.concatenate([scale, 14.0 * scale])
    columns = [
        derivative_along(partial(model.rhs, 0.0, u=SPEED), y, way, 1.0) for way in np.diag(steps)
    ]
    differences = np.stack(columns, axis=1) / steps
    errors = (
        worst(model.rhs(0.0, y, SPEED)[m:], finer.rhs(0.0, y, SPEED)[m:]),
        worst(model.rhs(0.0, many, speeds)[m:], finer.rhs(0.0, many, speeds)[m:]),
        worst(jacobian * steps, differences * steps),
    )
    what = f"{basis}, m = {m}, drag {pipe.drag}, {_core.vector_level()}"
    limit = 1e-6 if pipe.drag else 1e-10
    check(max(errors[:2]), limit, f"rhs, {what}")
    check(errors[2], 1e-5 if pipe.drag else 1e-9, f"jacobian against differences, {what}")
    costs = (
        cost_of(lambda: model.rhs(0.0, y, SPEED)),
        cost_of(lambda: model.rhs(0.0, many, speeds)) / MEMBERS,
        cost_of(lambda: model.jacobian(0.0, y, SPEED)),
    )
    return list(zip(costs, errors, strict=True))


def reduced_models() -> None:
    print(f"reduced models: time of a state, us (error); a batch holds {MEMBERS} states")
    print("| basis | m | drag | level | rhs | rhs, batch | jacobian |")
    print("|---|---|---|---|---|---|---|")
    for basis in ("beam", "legendre"):
        for m in (4, 8, 16):
            for pipe in (REDUCED, REDUCED_DRAG):
                for level in _core.vector_levels():
                    _core.set_vector_level(level)
                    cells = [
                        f"{1e6 * cost:.2f} ({error:.0e})"
                        for cost, error in reduced_model(pipe, basis, m)
                    ]
                    drag = "yes" if pipe.drag else "no"
                    print(f"| {basis} | {m} | {drag} | {level} | {' | '.join(cells)} |")
    print()


def linearity() -> None:
    print(f"{_core.vector_level()}: ns a segment and state")
    print("| n | one state | 16 states |")
    print("|---|---|---|")
    for n in (10, 100, 1000, 10_000, 100_000):
        chain, y, many = pp.Chain(PIPE, n), state(n), state(n, 16)
        one = cost_of(lambda chain=chain, y=y: chain.rhs(0.0, y, SPEED))
        batch = cost_of(lambda chain=chain, many=many: chain.rhs(0.0, many, SPEED)) / 16
        print(f"| {n} | {1e9 * one / n:.1f} | {1e9 * batch / n:.1f} |")
    print()


def main() -> int:
    print(machine() + "\n")
    right_hand_sides()
    reduced_models()
    linearity()
    return ended()


if __name__ == "__main__":
    sys.exit(main())
