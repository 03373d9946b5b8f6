# SPDX-License-Identifier: MIT
"""Random windows of `bifurcation_diagram`, against motions that another program integrates.

    python tests/campaign_motions.py 0 10    # the windows 0 to 9, three speeds each

Each window has a pipe with stops, springs, masses, a jet, drag or a held end. From ten starts of
its own, at each speed, `scipy.integrate.solve_ivp` follows `Model.motion_rates` for 300 T. The end
of each motion has to be in the answer: a stable equilibrium where it rests, a stable cycle where
its last state lies on one, and otherwise a motion of the diagram that neither rests nor repeats.
"""

import argparse
import time

import numpy as np
from scipy.integrate import solve_ivp

import pipedyn as pp

DURATION, LATE = 300.0, 40.0
"""Time of the motions, and the last of it in which they are judged."""

NEAR = 0.02
"""Distance from a cycle on which a motion counts as on it, in ranges of the cycle's coordinates:
those that attract slowly are not nearer after 300 T."""


def random_model(random):
    """A chain or a reduced model of a pipe on which something acts."""
    numbers = {"beta": random.uniform(0.1, 0.8), "gamma": random.choice([0.0, 10.0, 40.0, -10.0])}
    numbers["damping"] = random.choice([0.002, 0.005, 0.01])
    mass = pp.PointMass(random.uniform(0.4, 1.0), random.uniform(0.05, 0.3))
    kind, size = random.integers(6), int(random.integers(2, 6))
    if kind == 0:
        gap, stiffness = random.uniform(0.03, 0.1), 10.0 ** random.uniform(2.0, 3.0)
        numbers["terms"] = (pp.Stop(random.uniform(0.5, 1.0), gap, stiffness),)
    elif kind == 1:
        numbers["jet_angle"] = random.uniform(0.1, 0.5)
    elif kind == 2:
        numbers |= {"end": "pinned", "terms": (pp.Stretching(10.0 ** random.uniform(2.0, 3.5)),)}
        size = max(size, 3)
    elif kind == 3:
        spring = pp.Spring(random.uniform(0.3, 1.0), 10.0 ** random.uniform(0.5, 2.0))
        numbers["terms"] = (spring, mass)
    elif kind == 4:
        numbers["drag"] = random.uniform(0.1, 1.0)
    else:
        numbers |= {"jet_angle": random.uniform(0.1, 0.4), "terms": (mass,)}
    pipe = pp.Pipe(**numbers)
    return pp.Chain(pipe, size) if random.random() < 0.6 else pp.Galerkin(pipe, size)


def random_speeds(model, random):
    """One below the onset of instability and two beyond; of jets, which have none, three."""
    try:
        onset = pp.critical_speed(model).speed
    except (pp.PipedynError, ValueError):
        onset = random.uniform(5.5, 8.0)
    return onset * np.array([0.95, random.uniform(1.05, 1.3), random.uniform(1.35, 1.8)])


def own_motion(model, u, random):
    """States [p, p'] at late times, (2 integrated, k), or None where supports forbid the bend."""
    size = 10.0 ** random.uniform(-1.5, 0.0)
    parts = size * random.uniform(-1.0, 1.0, 3) * np.array([2.0, 1.0, 0.5])
    waves = np.pi * np.array([0.5, 1.5, 2.5])
    try:
        q = model.bent(lambda s: np.sin(np.outer(s, waves)) @ parts)
        start = np.asarray(model.initial_state(q, None))
    except pp.PipedynError:
        return None
    found = solve_ivp(
        lambda t, y: model.motion_rates(y, u),
        (0.0, DURATION),
        start,
        method="LSODA",
        rtol=1e-7,
        atol=1e-9,
        t_eval=np.linspace(DURATION - LATE, DURATION, 4001),
    )
    return found.y


def is_in(found, u, states):
    """Whether a diagram has what a motion ends on, and what that is."""
    model, half = found.model, len(states) // 2
    q, _ = model.to_user(states[:half].T.copy(), states[half:].T.copy())
    across = model.tips(q.T)[:, 0]
    if np.ptp(across) < 1e-5:
        rests = [one.turnings[-1] for one in found.at(u) if one.ending == "rest"]
        stable = pp.equilibria(model, u)
        rests += stable.tips[stable.stable, 0].tolist()
        return min(abs(abs(across[-1]) - np.abs(rests)), default=np.inf) < 1e-3, "rest"
    for branch in found.cycles:
        for cycle in (one for one in branch.at(u) if one.stable):
            on = cycle.orbit.states(np.linspace(0.0, 2.0 * np.pi, 8001))
            for sign in (1.0, -1.0) if branch.mirrored else (1.0,):
                apart = (sign * on - states[:, -1:]) / np.ptp(on, axis=1, keepdims=True)
                if np.abs(apart).max(axis=0).min() < NEAR:
                    return True, "a cycle"
    names = {one.ending for one in found.at(u)}
    return bool(names & {"chaotic", "quasi-periodic", "unsettled"}), "neither rest nor a cycle"


def window(seed):
    """How many motions of one window there are, and how many whose end is not in the answer."""
    random = np.random.default_rng(seed)
    model = random_model(random)
    speeds, begun = random_speeds(model, random), time.process_time()
    found = pp.bifurcation_diagram(model, speeds, brute_force=10, seed=seed)
    taken = time.process_time() - begun
    names = [sorted({one.ending for one in found.at(u)}) for u in speeds]
    print(f"{seed}: {model}, u = {speeds.round(4)}, {taken:.1f} s: {names}", flush=True)
    motions, missing = 0, 0
    for u in speeds:
        for k in range(10):
            states = own_motion(model, u, random)
            if states is None or states.shape[1] < 4001:
                continue
            held, what = is_in(found, u, states)
            motions, missing = motions + 1, missing + (not held)
            if not held:
                print(f"    u = {u:.6f}, motion {k}: {what} is not in the answer", flush=True)
    return motions, missing


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    arguments = parser.parse_args()
    totals = np.array([window(seed) for seed in range(arguments.first, arguments.end)])
    print(f"{len(totals)} windows, {totals[:, 0].sum()} motions, {totals[:, 1].sum()} missing")
