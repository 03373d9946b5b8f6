# SPDX-License-Identifier: MIT
"""Chains whose segments turn over: against unit vectors as coordinates, energy, plane motions."""

import numpy as np
import pytest
import scipy

import pipedyn as pp
from pipedyn.models.space import in_first_chart

PIPES = {
    "loose": (pp.Pipe(0.3, gamma=6.0), np.zeros(4)),
    "with flow": (pp.Pipe(0.4, gamma=2.0), np.full(4, 0.3)),
}
START = [0.4, -0.2, 0.5, 0.1], [0.1, 0.3, -0.2, 0.2]
RATES = np.array([9.0, 8.0, 10.0, 11.0, 1.0, -2.0, 1.5, 0.5])


def thrown(pipe, springs):
    """A chain of four segments, and a state in which it is thrown upwards."""
    chain = pp.Chain(pipe, springs=springs, lengths=np.full(4, 0.25), dimensions=3)
    return chain, np.concatenate(START), RATES


def unit_vectors(chain, u):
    """Rates of [t_1 .. t_n, t_1' .. t_n'], (6 n,): equations for unit vectors, without angles."""
    planar, pipe = chain.planar, chain.pipe
    n, lengths, mass = planar.dof, planar.lengths, planar.masses
    arms = np.tril(np.ones((n, n)), -1) * lengths + np.diag(planar.centres * lengths)
    inertia = arms.T @ np.diag(mass) @ arms + np.diag(mass * planar.gyration_radii**2)
    weight, b = mass @ arms, np.sqrt(pipe.beta)
    flow = np.triu(2.0 * np.outer(lengths, lengths), 1) + np.diag(lengths**2)
    springs = planar.springs

    def rates(_, y):
        t, dt = y.reshape(2, n, 3)
        force = -b * u * flow @ dt - u**2 * np.outer(lengths, t[-1])
        force[:, 1] += pipe.gamma * weight
        before = np.vstack([[0.0, 1.0, 0.0], t[:-1]])
        angle = np.arccos(np.clip((before * t).sum(axis=1), -1.0, 1.0))
        pull = (springs / np.sinc(angle / np.pi))[:, None]
        force += pull * before
        force[:-1] += (pull * t)[1:]
        system = np.zeros((3 * n, 3 * n))
        right = np.zeros(3 * n)
        for k in range(n):
            across = np.eye(3) - np.outer(t[k], t[k])
            own = slice(3 * k, 3 * k + 3)
            system[own] = np.kron(inertia[k], across)
            system[own, own] += np.outer(t[k], t[k])
            right[own] = across @ force[k] - t[k] * (dt[k] @ dt[k])
        return np.concatenate([dt.ravel(), np.linalg.solve(system, right)])

    return rates


def in_unit_vectors(chain, u, q, qdot, times):
    """Tangents at some times, (times, n, 3), by the equations for unit vectors."""
    h = 1e-30
    a, da = q.reshape(2, -1), qdot.reshape(2, -1)

    def tangents(a):
        rho = np.sqrt((a**2).sum(axis=0))
        return np.stack([np.sin(rho) / rho * a[0], np.cos(rho), np.sin(rho) / rho * a[1]], axis=1)

    start = np.concatenate([tangents(a).ravel(), tangents(a + 1j * h * da).imag.ravel() / h])
    found = scipy.integrate.solve_ivp(
        *(unit_vectors(chain, u), (0.0, times[-1]), start),
        method="DOP853",
        t_eval=times,
        rtol=1e-11,
        atol=1e-12,
    )
    return found.y.T.reshape(len(times), 2, -1, 3)[:, 0]


def tangents_of(q):
    rho = np.hypot(*np.split(q, 2, axis=1))
    x, z = np.split(q, 2, axis=1)
    share = np.sinc(rho / np.pi)
    return np.stack([share * x, np.cos(rho), share * z], axis=2)


@pytest.mark.parametrize("method", ["radau", "dop853"])
@pytest.mark.parametrize(
    ("pipe", "springs", "u"), [(*PIPES["loose"], 0.0), (*PIPES["with flow"], 2.0)], ids=PIPES
)
def test_segments_pass_straight_up_as_unit_vectors_do(pipe, springs, u, method):
    chain, q, qdot = thrown(pipe, springs)
    times = np.linspace(0.0, 1.5, 61)
    motion = pp.simulate(chain, u, 1.5, q, qdot, times=times, method=method, rtol=1e-10)
    expected = in_unit_vectors(chain, u, q, qdot, times)
    highest = expected[:, :, 1].min()
    assert highest < -0.99, highest  # a segment passes close to straight up
    assert tangents_of(motion.q) == pytest.approx(expected, abs=1e-6)
    assert motion.audit < 1e-8
