# SPDX-License-Identifier: MIT
"""The core's integrators on problems whose solutions are known: orders, tolerances, samples."""

import numpy as np
import pytest
from scipy.optimize import brentq

from pipedyn import _core

# An error between 1 and rounding has 15 decades, which a method of order 8 crosses in less than two
# decades of step: three are more than double precision can show. Each fit takes what there is.


def growth(t, y):
    """y' = y cos t, which depends on time."""
    return np.cos(t) * y


def orbit(t, y):
    """Kepler's problem, of eccentricity 0.2."""
    return np.concatenate([y[2:], -y[:2] / np.hypot(*y[:2]) ** 3])


def on_orbit(t):
    def behind(anomaly, at):
        return anomaly - 0.2 * np.sin(anomaly) - at

    anomaly = np.array([brentq(behind, at - 1.0, at + 1.0, (at,), xtol=1e-15) for at in t])
    place = np.array([np.cos(anomaly) - 0.2, np.sqrt(0.96) * np.sin(anomaly)])
    rate = np.array([-np.sin(anomaly), np.sqrt(0.96) * np.cos(anomaly)])
    return np.concatenate([place, rate / (1.0 - 0.2 * np.cos(anomaly))]).T


def swirl(t, y):
    return np.array([0.1 * y[0] + y[1], 0.1 * y[1] - y[0]])


def in_swirl(t):
    return np.exp(0.1 * t)[:, None] * np.array([np.cos(t), -np.sin(t)]).T


PROBLEMS = {  # rates, solution, end, steps
    "in time": (growth, lambda t: np.exp(np.sin(t))[:, None], 6.0, np.logspace(0.0, -0.9, 12)),
    "swirl": (swirl, in_swirl, 10.0, np.logspace(0.0, -0.8, 12)),
    "logistic": (
        *(lambda t, y: y * (1.0 - y), lambda t: 1.0 / (1.0 + 99.0 * np.exp(-t))[:, None]),
        *(5.0, np.logspace(0.0, -0.7, 12)),
    ),
    "orbit": (orbit, on_orbit, 6.0, np.logspace(-0.4, -1.3, 12)),
}


def moved(rates, start, times, rtol, atol=None, *, t0=0.0, max_step=np.inf, slopes=None):
    """States (members, times, n) of y' = rates(t, y) from starts (n, members), and the members.

    Implicit where the derivative of one member's rates is given, slopes(t, y).
    """
    start = np.atleast_2d(np.asarray(start, dtype=float).T).T
    members = start.shape[1]
    rtol = np.broadcast_to(rtol, members)
    atol = np.broadcast_to(rtol if atol is None else atol, start.shape)
    motion = _core.Integrator(
        *(lambda t, y, u: rates(t, y), np.zeros(members), start, t0, rtol, atol, 1e8, max_step),
        jacobian=None if slopes is None else lambda t, y, u: slopes(t, y),
    )
    states = np.empty((members, len(times), len(start)))
    while not motion.advance(np.asarray(times, dtype=float), states, 100_000)[0]:
        pass
    return states, motion.members


def solved(problem, times, rtol, max_step=np.inf):
    rates, solution, _, _ = PROBLEMS[problem]
    states, [member] = moved(rates, solution(np.zeros(1))[0], times, rtol, max_step=max_step)
    return states[0], member.evaluations


def order(steps, errors):
    """Of errors of steps, where they are above rounding and below all."""
    kept = (errors > 3e-13) & (errors < 1e-6)
    assert errors[kept].max() > 1e4 * errors[kept].min()
    return np.polyfit(np.log(steps[kept]), np.log(errors[kept]), 1)[0]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_errors_of_equal_steps_have_order_eight_at_the_end_and_seven_or_more_within(problem):
    _, solution, end, steps = PROBLEMS[problem]
    orders = []
    for times in (np.array([end]), np.linspace(0.0, end, 301)[1:]):
        found = (solved(problem, times, 1e9, step)[0] for step in steps)
        errors = np.array([np.abs(states - solution(times)).max() for states in found])
        orders.append(order(steps, errors))
    assert orders[0] == pytest.approx(8.0, abs=0.6)
    assert 7.0 < orders[1] < 9.0


@pytest.mark.parametrize("problem", ["swirl", "orbit"])
def test_errors_are_proportional_to_tolerances_over_nine_decades(problem):
    _, solution, _, _ = PROBLEMS[problem]
    times = np.linspace(0.0, 20.0, 301)
    tolerances = np.logspace(-3, -12, 10)
    found = [solved(problem, times, rtol) for rtol in tolerances]
    errors = [np.abs(states - solution(times)).max() for states, _ in found]
    calls = [calls for _, calls in found]
    assert np.polyfit(np.log(tolerances), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)
    assert (np.array(errors) < 100.0 * tolerances).all()
    # Steps as long as an error of order 8 allows: h ~ rtol^(1/8).
    assert np.polyfit(np.log(tolerances), np.log(calls), 1)[0] == pytest.approx(-0.125, abs=0.05)


def test_members_of_a_batch_keep_to_their_own_tolerances():
    rates, solution, end, _ = PROBLEMS["swirl"]
    tolerances, times = np.array([1e-3, 1e-10, 1e-6]), np.linspace(0.0, end, 11)[1:]
    start = np.repeat(solution(np.zeros(1)).T, 3, axis=1)
    states, members = moved(rates, start, times, tolerances)
    for member, tolerance, found in zip(members, tolerances, states, strict=True):
        alone, evaluations = solved("swirl", times, tolerance)
        assert member.evaluations == evaluations
        assert found == pytest.approx(alone, abs=1e-11)


@pytest.mark.parametrize("implicit", [False, True])
def test_entries_of_a_state_keep_to_their_own_tolerances(implicit):
    """Of a slow and a fast oscillation whose errors do not count."""
    own = np.array([1.0, 1.0, 40.0, 40.0])
    matrix = np.kron(np.eye(2), [[0.0, 1.0], [-1.0, 0.0]]) * own
    slopes = (lambda t, y: matrix) if implicit else None
    taken = []
    for atol in (1e-8 * np.ones(4), np.array([1e-8, 1e-8, 1.0, 1.0])):
        states, [member] = moved(
            *(lambda t, y: matrix @ y, [1.0, 0.0, 1e-3, 0.0], [5.0], 1e-8, atol[:, None]),
            slopes=slopes,
        )
        assert states[0, 0, :2] == pytest.approx([np.cos(5.0), -np.sin(5.0)], abs=1e-7)
        taken.append(member.evaluations)
    assert taken[1] < 0.5 * taken[0]


def test_steps_joined_are_the_polynomials_from_which_samples_come():
    rates, solution, end, _ = PROBLEMS["orbit"]
    start = solution(np.zeros(1)).T
    times = np.linspace(0.0, end, 41)
    motion = _core.Integrator(
        *(lambda t, y, u: rates(t[0], y), np.zeros(1), start),
        *(0.0, [1e-8], np.full_like(start, 1e-8), 1e8),
    )
    states = np.empty((1, times.size, 4))
    finished, breaks, pieces = False, [np.zeros(1)], []
    while not finished:
        finished, ends, coefficients = motion.advance(times, states, 1000, True)
        assert ends[0] == pytest.approx(breaks[-1][-1], abs=1e-15)
        breaks.append(ends[1:])
        pieces.append(coefficients)
    ends, pieces = np.concatenate(breaks), np.concatenate(pieces)
    assert pieces.shape == (ends.size - 1, 8, 4)
    assert ends[-1] == end
    left, right = pieces[1:, 0], pieces[:-1].sum(axis=1)
    assert np.abs(left - right).max() < 1e-13
    slopes = (np.arange(8)[:, None] * pieces).sum(axis=1) / np.diff(ends)[:, None]
    for slope, state in zip(slopes[:-1], left, strict=True):
        assert slope == pytest.approx(orbit(0.0, state), rel=1e-9, abs=1e-9)
    assert np.abs(states[0] - solution(times)).max() < 1e-6
