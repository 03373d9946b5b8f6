# SPDX-License-Identifier: MIT
"""Error and cost of the motion: the chain's against pinocchio and mujoco, the reduced model's.

Run with `.venv/bin/python tests/benchmark_motion.py` after `pip install ".[bench,test]"`; pytest
does not collect it. Prints, and fails on an error only. Flow, drag, damping and gravity act on our
side; the peers, which have no flow, move the same bars on the same hinges with gravity alone. One
thread.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import mpmath
import numpy as np
import scipy
from independent import dense_jacobian, dense_rates
from measuring import check, cost_of, ended, machine, timed

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe

SPEED, MEMBERS = 6.0, 256
PIPE = pp.Pipe(beta=0.2, gamma=2.0, drag=1.0, damping=1e-3)


def worst(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest error relative to the largest entry."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def state(n: int, members: int = 0) -> np.ndarray:
    """Angles of some tenths of a radian between neighbours, rates of order 1."""
    rng = np.random.default_rng(n)
    shape = (n, members) if members else (n,)
    angles = np.cumsum(rng.normal(scale=0.3, size=shape), axis=0)
    return np.concatenate([angles, rng.normal(size=shape)])


# --------------------------------------------------------------------------------------- references


def exact_accelerations(chain: pp.Chain, y: np.ndarray, u: float) -> np.ndarray:
    """theta'' by the dense equations in the angles, written once more in 30 digits."""
    n, pipe = chain.dof, chain.pipe
    with mpmath.workdps(30):
        length, chi, eta, spring, xi = (
            [mpmath.mpf(float(x)) for x in numbers]
            for numbers in (
                *(chain.lengths, chain.centres, chain.gyration_radii),
                *(chain.springs, chain.drag_points),
            )
        )
        angle, rate = [mpmath.mpf(x) for x in y[:n]], [mpmath.mpf(x) for x in y[n:]]
        root_beta = mpmath.sqrt(mpmath.mpf(pipe.beta))
        cosine = [[mpmath.cos(a - b) for b in angle] for a in angle]
        sine = [[mpmath.sin(a - b) for b in angle] for a in angle]
        mass, force = mpmath.matrix(n, n), [mpmath.mpf(0)] * n
        beyond = [mpmath.fsum(length[k + 1 :]) for k in range(n)]
        moment = [length[k] * (beyond[k] + chi[k] * length[k]) for k in range(n)]
        for k in range(n):
            for i in range(n):
                coupling = length[min(k, i)] * moment[max(k, i)]
                if i == k:
                    coupling = length[k] ** 2 * beyond[k]
                    coupling += length[k] * ((chi[k] * length[k]) ** 2 + eta[k] ** 2)
                mass[k, i] = coupling * cosine[k][i]
                force[k] += coupling * sine[k][i] * rate[i] ** 2
                if i > k:
                    force[k] += 2 * root_beta * u * length[k] * length[i] * cosine[k][i] * rate[i]
            force[k] += root_beta * u * length[k] ** 2 * rate[k]
            force[k] += u**2 * length[k] * sine[n - 1][k]
            force[k] += pipe.gamma * moment[k] * mpmath.sin(angle[k])
            turn, turning = angle[k], rate[k]
            if k > 0:
                turn, turning = turn - angle[k - 1], turning - rate[k - 1]
            elastic = spring[k] * (turn + mpmath.mpf(pipe.damping) * turning)
            force[k] += elastic
            if k > 0:
                force[k - 1] -= elastic
            lever = [length[i] * cosine[k][i] for i in range(k)] + [xi[k] * length[k]]
            across = mpmath.fdot(lever, rate[: k + 1])
            drag = pipe.drag * length[k] * abs(across) * across
            for i in range(k + 1):
                force[i] += lever[i] * drag
        solution = mpmath.lu_solve(mass, -mpmath.matrix(force))
        return np.array([float(x) for x in solution])


# -------------------------------------------------------------------------------------------- peers


def plain_accelerations(n: int, y: np.ndarray) -> np.ndarray:
    """Of the bars on hinges without springs, with gravity alone."""
    chain = pp.Chain(pp.Pipe(0.0, gamma=PIPE.gamma), n, springs=np.zeros(n))
    return exact_accelerations(chain, y, 0.0)


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
    found = np.cumsum(pinocchio.aba(model, data, q, v, torque))
    return (
        lambda: pinocchio.aba(model, data, q, v, torque),
        lambda: pinocchio.computeABADerivatives(model, data, q, v, torque),
        worst(found, plain_accelerations(n, y)),
    )


def mujoco_chain(n: int) -> tuple[Callable[[], object], float]:
    """mj_forward and its error."""
    import mujoco

    length = 1.0 / n
    link = (
        f"<body pos='{{}} 0 0'><joint type='hinge' axis='0 0 1'/><inertial pos='{length / 2} 0 0' "
        f"mass='{length}' diaginertia='{length**3 / 12} {length**3 / 12} {length**3 / 12}'/>"
    )
    bodies = "".join(link.format(length if j else 0.0) for j in range(n)) + "</body>" * n
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><compiler angle='radian' inertiafromgeom='false' boundmass='0'/>"
        f"<option gravity='{PIPE.gamma} 0 0'/><worldbody>{bodies}</worldbody></mujoco>"
    )
    data, y = mujoco.MjData(model), state(n)
    data.qpos[:] = np.diff(y[:n], prepend=0.0)
    data.qvel[:] = np.diff(y[n:], prepend=0.0)
    mujoco.mj_forward(model, data)
    error = worst(np.cumsum(data.qacc), plain_accelerations(n, y))
    return lambda: mujoco.mj_forward(model, data), error


# --------------------------------------------------------------------------------------- benchmarks


Route = tuple[str, str, Callable[[], object], float]
"""Question, route, call and error."""


def peers(n: int) -> tuple[list[Route], dict[str, float]]:
    """Other ways to the answers, and pinocchio's time for each question."""
    chain, y = pp.Chain(PIPE, n), state(n)
    aba, derivatives, aba_error = pinocchio_chain(n)
    forward, forward_error = mujoco_chain(n)
    dense_error = worst(dense_rates(chain, y, SPEED)[n:], exact_accelerations(chain, y, SPEED))
    routes: list[Route] = [
        ("rhs", "dense numpy", lambda: dense_rates(chain, y, SPEED), dense_error),
        ("rhs", "mujoco mj_forward", forward, forward_error),
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


def reduced_state(model: pp.Galerkin, rng: np.random.Generator) -> np.ndarray:
    """Angles of up to one radian, falling like i^-2 in the functions, rates 14 times that."""
    slopes = model.functions(np.linspace(0.0, 1.0, 200), 1)
    order = np.arange(1.0, model.dof + 1.0)
    q, rate = rng.normal(size=(2, model.dof)) / (np.abs(slopes).max(axis=0) * order**2)
    q /= np.abs(slopes @ q).max()
    rate *= 14.0 / np.abs(slopes @ rate).max()
    return np.concatenate([q, rate])


def eighth_order(model: pp.Galerkin, y: np.ndarray, column: int, step: float) -> np.ndarray:
    """Central difference of rhs with respect to one entry of the state."""
    pairs = zip((1, 2, 3, 4), (4 / 5, -1 / 5, 4 / 105, -1 / 280), strict=True)
    unit = step * np.eye(y.size)[column]
    moved = (
        c * (model.rhs(0.0, y + k * unit, SPEED) - model.rhs(0.0, y - k * unit, SPEED))
        for k, c in pairs
    )
    return sum(moved) / step


def reduced_model(pipe: pp.Pipe, basis: str, m: int) -> list[tuple[float, float]]:
    """Errors of rhs, a batch and the Jacobian, each with the cost of a state, s.

    rhs against the same equations with three times the nodes, the Jacobian against differences,
    whose steps move the kinks of drag's integrand.
    """
    model, rng = pp.Galerkin(pipe, m, basis), np.random.default_rng(m)
    many = np.stack([reduced_state(model, rng) for _ in range(MEMBERS)], axis=1)
    y, speeds = many[:, 0].copy(), np.linspace(3.0, 7.0, MEMBERS)
    finer = _core.Galerkin(
        core_pipe(pipe), basis == "legendre", m, least_nodes=3 * model.motion.nodes(y[:m])
    )
    jacobian = model.jacobian(0.0, y, SPEED)
    steps = 1e-2 * np.concatenate([model.elastic_scale, 14.0 * model.elastic_scale])
    differences = np.stack([eighth_order(model, y, j, h) for j, h in enumerate(steps)], axis=1)
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


def questions() -> list[tuple[str, Callable[[], object], Callable[[object], np.ndarray], float]]:
    """What each kernel is asked for: a call, the numbers of its answer, and how far these may be
    from those of another level, relative to the largest.

    Motions are compared at the tolerance that they are integrated with.
    """
    chain, long_chain = pp.Chain(PIPE, 20), pp.Chain(pp.Pipe(0.2), 400)
    one, many = state(20), state(20, MEMBERS)
    reduced = pp.Galerkin(REDUCED_DRAG, 8)
    bent = reduced_state(reduced, np.random.default_rng(8))
    start, longer = np.linspace(0.0, 0.02, 20), np.linspace(0.0, 0.02, 100)
    plain, damped = pp.Chain(pp.Pipe(0.2), 20), pp.Chain(pp.Pipe(0.2, damping=0.01), 100)
    pulsating = pp.Pulsation(4.0, 0.1, 10.0)

    def moved(model: pp.Model, u: object, end: float, y0: np.ndarray, method: str = "auto"):
        return lambda: pp.simulate(
            model, u, end, y0, rtol=1e-6, atol=1e-8, samples=61, method=method
        )

    def angles(motion: pp.Motion) -> np.ndarray:
        return motion.y

    same, values, speed = np.asarray, np.abs, lambda found: np.array([found.speed])
    return [
        ("rhs", lambda: chain.rhs(0.0, one, SPEED), same, 1e-12),
        (f"rhs, {MEMBERS} states", lambda: chain.rhs(0.0, many, SPEED), same, 1e-12),
        ("jacobian", lambda: chain.jacobian(0.0, one, SPEED), same, 1e-12),
        (f"energy, {MEMBERS} states", lambda: chain.energy(many), same, 1e-12),
        (f"power, {MEMBERS} states", lambda: chain.power(many, SPEED).total, same, 1e-12),
        ("reduced rhs", lambda: reduced.rhs(0.0, bent, SPEED), same, 1e-10),
        ("reduced jacobian", lambda: reduced.jacobian(0.0, bent, SPEED), same, 1e-10),
        ("explicit motion", moved(plain, SPEED, 6.0, start, "dop853"), angles, 1e-4),
        ("implicit motion", moved(plain, SPEED, 60.0, start), angles, 1e-4),
        ("implicit motion, damped, n = 100", moved(damped, SPEED, 5.0, longer), angles, 1e-4),
        ("reduced motion", moved(reduced, SPEED, 5.0, bent[:8] * 0.01), angles, 1e-4),
        ("pulsating motion", moved(plain, pulsating, 6.0, start), angles, 1e-4),
        ("eigenvalues, n = 400", lambda: pp.eigenvalues(long_chain, SPEED, 10), values, 1e-10),
        ("critical speed, n = 400", lambda: pp.critical_speed(long_chain), speed, 1e-10),
    ]


def kernels() -> None:
    levels = _core.vector_levels()
    print("each kernel at every level, ms, and the largest distance from the first level's answer")
    print(f"| question | {' | '.join(levels)} | apart |")
    print("|---|" + "---|" * (len(levels) + 1))
    for what, call, numbers, limit in questions():
        answers, costs = [], []
        for level in levels:
            _core.set_vector_level(level)
            answer, cost = timed(call)
            answers.append(numbers(answer))
            costs.append(f"{1e3 * cost:.3g}")
        distance = max(worst(one, answers[0]) for one in answers)
        check(distance, limit, f"{what} at other levels")
        print(f"| {what} | {' | '.join(costs)} | {distance:.0e} |")
    print()


def plain_monodromy(
    model: pp.Model, u: float, cycle: pp.LimitCycle, rtol: float
) -> tuple[np.ndarray, np.ndarray]:
    """State and derivative after a period, by scipy's DOP853 on the variational equations.

    One step of shooting, as a user would write it, without the search for a start.
    """
    y0 = cycle.y[:, 0]
    size = y0.size

    def rates(t: float, whole: np.ndarray) -> np.ndarray:
        y, matrix = whole[:size], whole[size:].reshape(size, size)
        return np.concatenate([model.rhs(t, y, u), (model.jacobian(t, y, u) @ matrix).ravel()])

    start = np.concatenate([y0, np.eye(size).ravel()])
    end = scipy.integrate.solve_ivp(
        rates, (0.0, cycle.period), start, "DOP853", rtol=rtol, atol=1e-3 * rtol
    ).y[:, -1]
    return end[:size], end[size:].reshape(size, size)


def apart(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest distance of multipliers, relative where above 1."""
    distances = np.abs(found[:, None] - exact) / np.maximum(np.abs(exact), 1.0)
    pairs = scipy.optimize.linear_sum_assignment(distances)
    return float(distances[pairs].max())


def cycles() -> None:
    print("limit cycles with multipliers, ms; as plain script a monodromy matrix by scipy, ms")
    print("| model | u | limit_cycle | stated errors | does not close by | plain | apart by |")
    print("|---|---|---|---|---|---|---|")
    scene = pp.modular.chain(pp.Pipe(0.2), 10)
    aspirating = pp.modular.chain(pp.Pipe(0.2, flow="aspirating", damping=0.01), 10)
    cases: list[tuple[str, pp.Model, float, bool]] = [
        ("Legendre 8", pp.Galerkin(pp.Pipe(0.2), 8, "legendre"), 6.0, True),
        ("chain 20", pp.Chain(pp.Pipe(0.2), 20), 6.0, True),
        ("chain 40", pp.Chain(pp.Pipe(0.2), 40), 6.0, True),
        ("chain 20, drag 0.5", pp.Chain(pp.Pipe(0.2, drag=0.5), 20), 6.0, True),
        ("scene of 10", scene, 6.0, False),
        ("scene of 10, aspirating", aspirating, 0.0757, False),
    ]
    for name, model, u, multipliers in cases:
        cycle = pp.limit_cycle(model, u)
        cost = cost_of(lambda model=model, u=u: pp.limit_cycle(model, u))
        check(cycle.error, 1e-6, f"amplitude and frequency, {name}")
        check(cycle.multiplier_error, 1e-6, f"multipliers, {name}")
        plain, distance = "-", "-"
        if multipliers:
            begun = time.thread_time()
            end, monodromy = plain_monodromy(model, u, cycle, 1e-8)
            plain = f"{1e3 * (time.thread_time() - begun):.0f}"
            between = apart(cycle.multipliers, np.linalg.eigvals(monodromy))
            check(between, 1e-5, f"multipliers against scipy, {name}")
            distance = f"{between:.0e}"
        else:
            end = scipy.integrate.solve_ivp(
                *(lambda t, y, model=model, u=u: model.rhs(t, y, u), (0.0, cycle.period)),
                *(cycle.y[:, 0], "DOP853"),
                rtol=1e-9,
                atol=1e-11,
            ).y[:, -1]
        missed = worst(end, cycle.y[:, 0])
        check(missed, 1e-5, f"a period by scipy, {name}")
        stated = f"{cycle.error:.0e}, {cycle.multiplier_error:.0e}"
        print(
            f"| {name} | {u} | {1e3 * cost:.0f} | {stated} | {missed:.0e} | {plain} | {distance} |"
        )
    print()


def main() -> int:
    print(machine() + "\n")
    right_hand_sides()
    reduced_models()
    kernels()
    linearity()
    cycles()
    return ended()


if __name__ == "__main__":
    sys.exit(main())
