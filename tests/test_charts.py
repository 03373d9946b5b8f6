# SPDX-License-Identifier: MIT
"""Chains whose segments turn over: against unit vectors as coordinates, energy, plane motions."""

import numpy as np
import pytest
import scipy

import pipedyn as pp
from pipedyn import _core

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


CASES = {
    "loose": (pp.Pipe(0.3, gamma=6.0), np.zeros(4), 0.0),
    "with flow": (pp.Pipe(0.4, gamma=2.0), np.full(4, 0.1), 1.0),
}


@pytest.mark.parametrize("method", ["radau", "dop853", "scipy:DOP853"])
@pytest.mark.parametrize(("pipe", "springs", "u"), CASES.values(), ids=CASES)
def test_segments_pass_straight_up_as_unit_vectors_do(pipe, springs, u, method):
    chain, q, qdot = thrown(pipe, springs)
    times = np.linspace(0.0, 1.5, 61)
    motion = pp.simulate(chain, u, 1.5, q, qdot, times=times, method=method, rtol=1e-10)
    expected = in_unit_vectors(chain, u, q, qdot, times)
    assert expected[:, :, 1].min() < -0.99  # a segment passes close to straight up
    assert tangents_of(motion.q) == pytest.approx(expected, abs=1e-6)
    assert motion.audit < 1e-8


@pytest.mark.parametrize("method", ["radau", "dop853"])
@pytest.mark.parametrize("aside", [1e-2, 1e-5, 1e-9, 1e-12])
def test_passing_close_to_straight_up_takes_no_more_work_than_in_the_plane(method, aside):
    # With one chart the steps shrank with the distance from straight up, and motions stopped.
    chain, q, qdot = thrown(*CASES["loose"][:2])
    shares = np.repeat([1.0, aside], 4)
    given = {"samples": 61, "method": method, "rtol": 1e-8}
    motion = pp.simulate(chain, 0.0, 3.0, shares * q, shares * qdot, **given)
    planar = pp.simulate(chain.planar, 0.0, 3.0, q[:4], qdot[:4], **given)
    assert motion.evaluations < 1.5 * planar.evaluations
    assert motion.audit < 1e-7
    early = slice(0, 20)  # before the plane's instability shows
    apart = motion.tip[early, :2] - planar.tip[early]
    assert np.abs(apart).max() < 100.0 * aside**2 + 1e-5


def test_turns_in_a_plane_are_counted_as_those_of_the_planar_chain():
    chain, q, qdot = thrown(*CASES["loose"][:2])
    none = np.zeros(4)
    given = {"samples": 41, "rtol": 1e-10}
    planar = pp.simulate(chain.planar, 0.0, 2.0, q[:4], qdot[:4], **given)
    start = np.concatenate([q[:4], none, qdot[:4], none])
    motion = pp.simulate(chain, 0.0, 2.0, *np.split(start, 2), **given)
    assert np.abs(planar.q).max() > 2.0 * np.pi
    assert motion.q[:, :4] == pytest.approx(planar.q, abs=1e-5)
    assert motion.q[:, 4:].tolist() == np.zeros((41, 4)).tolist()
    # In another plane the integrator's errors leave it, and turns are not counted.
    turned = np.split(chain.turned(start, 0.7), 2)
    tangents = tangents_of(pp.simulate(chain, 0.0, 2.0, *turned, **given).q)
    expected = tangents_of(chain.turned(motion.q.T, 0.7).T)
    assert tangents == pytest.approx(expected, abs=1e-5)


def test_dense_output_and_events_go_through_changes_of_charts():
    chain, q, qdot = thrown(*CASES["with flow"][:2])
    across = pp.Event(lambda t, q, qdot: chain.tip(q)[0] - 0.2)
    given = {"samples": 151, "method": "dop853", "rtol": 1e-10}
    motion = pp.simulate(chain, 0.0, 1.5, q, qdot, dense=True, events=across, **given)
    states = motion.dense(motion.t)
    assert np.hypot(*np.split(motion.q, 2, axis=1)).max() > 3.0
    q, qdot = np.split(states.T, 2, axis=1)
    assert q == pytest.approx(motion.q, abs=1e-9)
    assert qdot == pytest.approx(motion.qdot, rel=1e-6, abs=1e-6)
    between = motion.dense(np.linspace(0.0, 1.5, 997))
    assert chain.energy(between) == pytest.approx(np.full(997, motion.energy[0]), rel=1e-6)
    crossings = np.flatnonzero(np.diff(motion.tip[:, 0] > 0.2))
    [found] = motion.events
    assert found.t.size == crossings.size > 1
    assert all(motion.t[crossings] <= found.t)
    assert [chain.tip(one)[0] for one in found.q] == pytest.approx([0.2] * found.t.size)


def test_members_of_a_batch_change_charts_at_times_of_their_own():
    chain, q, qdot = thrown(*CASES["loose"][:2])
    rates = [share * qdot for share in (0.3, 0.7, 1.0, 1.1, 1.2)]
    given = {"samples": 31, "method": "dop853", "rtol": 1e-9}
    many = pp.simulate_many(chain, 0.0, 1.0, q, rates, **given)
    for one, motion in zip(rates, many.motions, strict=True):
        alone = pp.simulate(chain, 0.0, 1.0, q, one, **given)
        assert tangents_of(motion.q) == pytest.approx(tangents_of(alone.q), abs=1e-6)
        assert motion.audit < 1e-7


def test_held_segments_beside_those_that_turn_over_keep_to_their_supports():
    pipe = pp.Pipe(0.3, gamma=6.0, supports=[0.25], damping=0.002)
    chain = pp.Chain(pipe, springs=np.full(8, 0.2), lengths=np.full(8, 0.125), dimensions=3)
    start = chain.bent(lambda s: 0.5 * s**2, lambda s: 0.2 * s)
    rates = np.concatenate([np.linspace(0.0, 16.0, 8), np.linspace(0.0, 2.0, 8)])
    state = np.split(chain.initial_state(*chain.onto_constraints(start, rates)), 2)
    motion = pp.simulate(chain, 1.0, 1.0, *state, rtol=1e-8)
    assert tangents_of(motion.q)[:, :, 1].min() < -0.9
    held = np.stack([chain.shape(q, [0.25])[0] for q in motion.q[::50]])
    assert held[:, [0, 2]] == pytest.approx(0.0, abs=1e-9)
    assert motion.audit < 1e-6


def test_a_segment_with_a_rotational_spring_keeps_its_rotation_vector():
    spring = pp.RotationalSpring(0.125, 3.0)  # in the first segment, whose turn it resists
    pipe = pp.Pipe(0.3, gamma=6.0, terms=[spring])
    chain, q, qdot = thrown(pipe, np.zeros(4))
    motion = pp.simulate(chain, 0.0, 1.0, q, qdot, rtol=1e-9)
    assert tangents_of(motion.q)[:, 1:, 1].min() < -0.9
    assert motion.audit < 1e-7


@pytest.mark.parametrize("azimuth", [0.0, 0.7])
def test_the_exponent_of_a_pendulum_that_turns_over_is_zero(azimuth):
    chain = pp.Chain(pp.Pipe(0.3, gamma=6.0), springs=[0.0], lengths=[1.0], dimensions=3)
    start = chain.turned([0.3, 0.0, 12.0, 0.0], azimuth)
    found = pp.lyapunov_exponent(chain, 0.0, start, duration=40.0, transient=10.0, blocks=8)
    assert abs(found.value) < 0.1
    assert not found.chaotic


def test_states_in_either_chart_are_the_same_tangents_with_the_same_rates():
    random, h = np.random.default_rng(3), 1e-6
    b, rates = random.normal(size=(2, 5, 6))
    signs = -np.ones((5, 3))

    def tangent(v, side):
        t = tangents_of(v)
        t[:, :, 1] *= side
        return t

    def in_first_chart(b, signs):
        return np.split(_core.in_first_chart(np.concatenate([b, rates], axis=1), signs), 2, axis=1)

    a, turning = in_first_chart(b, signs)
    assert tangent(a, 1.0) == pytest.approx(tangent(b, -1.0), abs=1e-14)
    change = tangent(a + h * turning, 1.0) - tangent(a - h * turning, 1.0)
    other = tangent(b + h * rates, -1.0) - tangent(b - h * rates, -1.0)
    assert change / h == pytest.approx(other / h, abs=1e-8)
    straight, coming = in_first_chart(0.0 * b, signs)
    assert np.hypot(*np.split(straight, 2, axis=1)) == pytest.approx(np.full((5, 3), np.pi))
    assert np.abs(coming) == pytest.approx(np.abs(rates))
    assert (straight * rates <= 0.0).all()
    kept = in_first_chart(b, -signs)
    assert [one.tolist() for one in kept] == [b.tolist(), rates.tolist()]
