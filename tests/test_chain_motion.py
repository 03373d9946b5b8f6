# SPDX-License-Identifier: MIT
"""The chain's nonlinear motion: right-hand side, derivative, energy and power."""

import itertools
import math
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import mpmath
import numpy as np
import pytest
from independent import (
    any_chain,
    dense_jacobian,
    dense_rates,
    lagrangian_accelerations,
    lagrangian_operators,
)
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import pipedyn as pp
from pipedyn import _core

LEVELS = _core.vector_levels()
FLOWS = [("ejecting", 1.0), ("aspirating", 0.7), ("aspirating", 0.0)]


def everything(n, seed=0, flow="ejecting", alpha=1.0):
    return any_chain(n, seed, gamma=4.0, flow=flow, alpha=alpha, drag=1.5, damping=0.01)


def states(n, count, seed=1, size=2.0):
    return size * np.random.default_rng([n, count, seed]).normal(size=(2 * n, count))


def worst(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


both = pytest.mark.parametrize(
    "model", [everything(3), pp.Galerkin(pp.Pipe(0.2, gamma=1.0, drag=0.3), 3)], ids=repr
)


# ------------------------------------------------------------------------------ equations of motion


@pytest.mark.parametrize(
    ("flow", "alpha", "entering", "jet"),
    [
        ("ejecting", 1.0, 1.0, 0.0),
        ("ejecting", 0.3, 1.0, 0.0),
        ("ejecting", 0.7, 1.0, -1.25),
        ("aspirating", 0.7, 1.0, 0.0),
        ("aspirating", 0.0, 1.0, 0.0),
        ("aspirating", 0.7, 0.0, 0.0),
        ("aspirating", 0.7, 0.35, 0.0),
    ],
)
def test_chain_moves_as_the_papers_lagrangian_says(flow, alpha, entering, jet):
    """Three unequal segments, base and all effects, at large states; derived with sympy.

    Straight chains also linearised, to rounding.
    """
    arrays = {
        "lengths": [0.45, 0.3, 0.15],
        "centres": [0.4, 0.65, 0.55],
        "gyration_radii": [0.11, 0.2, 0.05],
        "springs": [3.0, 2.0, 5.0],
    }
    points, ends = [0.8, 0.25, 0.6], {"inflow_share": entering, "jet_angle": jet}
    pipe = pp.Pipe(0.3, 2.5, flow, alpha, drag=1.25, damping=0.01, **ends)
    chain = pp.Chain(pipe, **arrays, drag_points=points, base=0.1)
    y, given = states(3, 12), (*arrays.values(), 0.3, 2.5, 0.01, flow == "aspirating", alpha, 3.75)
    expected = lagrangian_accelerations(y, *given, drag=1.25, points=points, **ends)
    found = chain.rhs(0.0, y, 3.75)
    np.testing.assert_array_equal(found[:3], y[3:])
    assert worst(found[3:], expected) < 1e-12
    if jet:  # it rests bent
        return
    linear = lagrangian_operators(*given, **ends)
    for mine, right in zip(chain.operators().at(3.75), linear, strict=True):
        np.testing.assert_allclose(mine, right, rtol=1e-13, atol=1e-15 * np.abs(right).max())


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("n", [1, 2, 3, 50])
@pytest.mark.parametrize(("flow", "alpha"), FLOWS)
def test_recursion_solves_the_dense_equations(n, flow, alpha, level, at_level):
    at_level(level)
    for chain in (everything(n, 0, flow, alpha), any_chain(n, 1, flow=flow, alpha=alpha)):
        y = states(n, 5)
        for u in (0.0, 4.5):
            expected = np.stack([dense_rates(chain, state, u) for state in y.T], axis=1)
            assert worst(chain.rhs(0.0, y, u), expected) < 1e-14 * (10 + n**1.5)
            assert worst(chain.rhs(0.0, y[:, 0], u), expected[:, 0]) < 1e-14 * (10 + n**1.5)


@pytest.mark.parametrize("level", LEVELS)
def test_angles_of_many_turns_count_by_their_sine(level, at_level):
    at_level(level)
    chain = any_chain(9, 0, gamma=4.0)
    y = states(9, 4)
    y[4:9] += 1e5  # the fifth joint has no spring
    expected = np.stack([dense_rates(chain, state, 2.0) for state in y.T], axis=1)
    assert worst(chain.rhs(0.0, y, 2.0), expected) < 1e-10  # 1e5 itself is rounded
    assert worst(chain.rhs(0.0, y[:, 0], 2.0), expected[:, 0]) < 1e-10


def test_a_hundred_thousand_segments_obey_their_equations():
    """The straight pipe, where every term has its own product, known from the linear analysis."""
    n, u = 100_000, 5.0
    pipe = pp.Pipe(0.4, gamma=3.0, damping=1e-3)
    chain = pp.Chain(pipe, n)
    rates = 1e-3 * np.sin(np.arange(n) / 1e4)
    found = chain.rhs(0.0, np.concatenate([np.zeros(n), rates]), u)[n:]
    turning = np.diff(rates, prepend=0.0)
    length = 1.0 / n

    def inertia(turning):
        """Of equal segments with their mass in the middle and radius l / sqrt(12)."""
        joint = length * (np.cumsum(turning) - turning)
        force = length * (joint + 0.5 * length * turning)
        beyond = np.cumsum(force[::-1])[::-1] - force
        return length * (beyond + 0.5 * length * joint + length**2 / 3.0 * turning)

    beyond = np.cumsum(rates[::-1])[::-1] - rates
    force = u * math.sqrt(pipe.beta) * length**2 * (rates + 2.0 * beyond)
    force -= 1e-3 * np.diff(chain.springs * turning, append=0.0)
    missing = inertia(found) + force
    terms = inertia(np.abs(found))
    assert np.all(np.abs(missing) < 4.0 * np.finfo(float).eps * terms)


# ------------------------------------------------------------------------------------- derivative


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("flow", "alpha"), FLOWS)
@pytest.mark.parametrize("n", [1, 2, 3, 33])
def test_jacobian_is_the_derivative(n, flow, alpha, level, at_level):
    """Of the dense equations, by complex steps: to rounding."""
    at_level(level)
    for chain in (everything(n, 3, flow, alpha), any_chain(n, 4, flow=flow, alpha=alpha)):
        for u in (0.0, 4.5):
            y = states(n, 1, seed=7)[:, 0]
            found = chain.jacobian(0.0, y, u)
            assert worst(found, dense_jacobian(chain, y, u)) < 1e-14 * (10 + n**2)


def test_drag_has_no_derivative_where_nothing_moves():
    y = states(5, 1)[:, 0]
    y[5:] = 0.0
    with_drag = everything(5).jacobian(0.0, y, 3.0)
    without = any_chain(5, 0, gamma=4.0, damping=0.01).jacobian(0.0, y, 3.0)
    np.testing.assert_array_equal(with_drag, without)


# ------------------------------------------------------------------------------- energy and power


def exact_energy(chain, y):
    """From positions and velocities of the segments' centres, in mpmath."""
    n, pipe = chain.dof, chain.pipe
    total = px = py = vx = vy = before = mpmath.mpf(0)
    for j in range(n):
        length, chi = mpmath.mpf(chain.lengths[j]), mpmath.mpf(chain.centres[j])
        sine, cosine, rate = mpmath.sin(y[j]), mpmath.cos(y[j]), y[n + j]
        dx, dy = length * sine, length * (cosine - 1)
        wx, wy = length * cosine * rate, -length * sine * rate
        speed = (vx + chi * wx) ** 2 + (vy + chi * wy) ** 2
        total += length * (speed + mpmath.mpf(chain.gyration_radii[j]) ** 2 * rate**2) / 2
        total -= mpmath.mpf(pipe.gamma) * length * (py + chi * dy)
        total += mpmath.mpf(chain.springs[j]) * (y[j] - before) ** 2 / 2
        px, py, vx, vy, before = px + dx, py + dy, vx + wx, vy + wy, y[j]
    return total


@pytest.mark.parametrize(("flow", "alpha"), FLOWS)
@pytest.mark.parametrize("on", [*itertools.product([False, True], repeat=4)])
def test_energy_changes_by_the_power(on, flow, alpha):
    """dE/dy . rhs = flow + joints + drag, to rounding, with every effect on and off."""
    gamma, drag, damping, u = np.where(on, [4.0, 2.0, 0.1, 3.0], 0.0).tolist()
    chain = any_chain(4, 0, gamma=gamma, drag=drag, damping=damping, flow=flow, alpha=alpha)
    y = states(4, 1, seed=sum(on))[:, 0]
    rates, power = chain.rhs(0.0, y, u), chain.power(y, u)
    with mpmath.workdps(40):
        exact = [mpmath.mpf(x) for x in y]
        assert chain.energy(y) == pytest.approx(float(exact_energy(chain, exact)), rel=1e-14)
        parts = []
        for j in range(8):
            ahead, behind = exact.copy(), exact.copy()
            ahead[j] += mpmath.mpf("1e-12")
            behind[j] -= mpmath.mpf("1e-12")
            slope = exact_energy(chain, ahead) - exact_energy(chain, behind)
            parts.append(slope / mpmath.mpf("2e-12") * mpmath.mpf(rates[j]))
        assert abs(float(sum(parts)) - power.total) < 1e-14 * float(sum(abs(x) for x in parts))
    assert power.others == 0.0
    assert (power.joints < 0.0) == (damping > 0.0)
    assert (power.drag < 0.0) == (drag > 0.0)
    assert (power.flow != 0.0) == (u > 0.0)


def test_flow_feeds_energy_only_through_the_free_end():
    """-sqrt(beta) U |v|^2 - a U^2 t . v with v of the tip, by differences of its position."""
    chain = any_chain(5, 0, flow="aspirating", alpha=0.6)
    y, u, step = states(5, 1)[:, 0], 2.5, 1e-6
    velocity = (chain.tip(y[:5] + step * y[5:]) - chain.tip(y[:5] - step * y[5:])) / (2 * step)
    tangent = np.array([np.sin(y[4]), np.cos(y[4])])
    expected = math.sqrt(0.3) * u * velocity @ velocity - 0.6 * u**2 * tangent @ velocity
    assert chain.power(y, u).flow == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    "model", [any_chain(4, 0, gamma=5.0), pp.Galerkin(pp.Pipe(0.3, gamma=6.0), 4)], ids=repr
)
def test_energy_of_small_motions_keeps_its_digits(model):
    y = 1e-9 * states(4, 1)[:, 0]
    ops = model.operators()
    expected = (y[4:] @ ops.mass @ y[4:] + y[:4] @ ops.stiffness @ y[:4]) / 2
    assert model.energy(y) == pytest.approx(expected, rel=1e-12, abs=0.0)
    assert model.energy(np.zeros(8)) == 0.0


def test_a_bar_on_a_hinge_is_a_pendulum():
    """Homogeneous bar: omega^2 = 3 gamma / 2; period at any amplitude by the elliptic integral."""
    chain = pp.Chain(pp.Pipe(0.2, gamma=6.0), n=1, springs=[0.0])
    start = np.array([2.5, 0.0])
    found = solve_ivp(
        *(chain.rhs, (0.0, 10.0), start, "DOP853"),
        args=(0.0,),
        events=lambda t, y, u: y[1],
        rtol=1e-12,
        atol=1e-12,
    )
    period = 4.0 / 3.0 * ellipk(math.sin(1.25) ** 2)
    np.testing.assert_allclose(np.diff(found.t_events[0]), period / 2.0, rtol=1e-9)
    energies = chain.energy(found.y)
    np.testing.assert_allclose(energies, 3.0 * (1.0 - math.cos(2.5)), rtol=1e-10)


# ---------------------------------------------------------------------------- batches and threads


@both
def test_empty_batch_is_empty(model):
    assert model.rhs(0.0, np.zeros((6, 0)), 1.0).shape == (6, 0)
    assert model.rhs(0.0, np.zeros((6, 0)), np.zeros(0)).shape == (6, 0)
    assert model.energy(np.zeros((6, 0))).shape == (0,)
    assert model.power(np.zeros((6, 0)), 1.0).total.shape == (0,)


def test_levels_agree(at_level):
    assert LEVELS[0] == "baseline"
    chain, y = everything(12), states(12, 9)
    found = []
    for level in LEVELS:
        at_level(level)
        assert _core.vector_level() == level
        found.append((chain.rhs(0.0, y, 3.0), chain.jacobian(0.0, y[:, 0], 3.0)))
    for rates, jacobian in found[1:]:
        assert worst(rates, found[0][0]) < 1e-12
        assert worst(jacobian, found[0][1]) < 1e-12


def test_level_can_be_forced():
    code = "from pipedyn import _core; print(_core.vector_level())"
    environment = {**os.environ, "PIPEDYN_VECTOR_LEVEL": "baseline"}
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "baseline"
    environment["PIPEDYN_VECTOR_LEVEL"] = "widest"
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "vector level must be one of 'baseline'" in run.stderr
    with pytest.raises(ValueError, match=r"vector level must be one of 'baseline'.*, got 'sse9'"):
        _core.set_vector_level("sse9")


@pytest.mark.parametrize(
    "model", [everything(60), pp.Galerkin(pp.Pipe(0.3, 1.0, drag=0.5), 6, "legendre")], ids=repr
)
def test_one_model_serves_many_threads(model):
    rows = 2 * model.dof
    y = np.random.default_rng(9).normal(size=(rows, 40)) / np.arange(1.0, rows + 1.0)[:, None]

    def work(seed):
        order = np.random.default_rng(seed).permutation(40)
        rates = np.empty_like(y)
        for j in order:
            rates[:, j] = model.rhs(0.0, y[:, j], 3.0)
        whole = model.rhs(0.0, y, 3.0), model.jacobian(0.0, y[:, 0], 3.0)
        return rates, *whole, model.energy(y), model.power(y, 5.0).total

    expected = work(0)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(work, range(12)):
            for part, right in zip(found, expected, strict=True):
                np.testing.assert_array_equal(part, right)


@pytest.fixture(scope="module")
def sines_and_cosines():
    """Angles of all sizes and about the corners of the octants, and what is exact of them."""
    rng = np.random.default_rng(3)
    corners = np.arange(-1018, 1019, 3) * (np.pi / 4)
    x = np.concatenate(
        [
            *(rng.uniform(-size, size, 300) for size in (0.785, 1600.0)),
            *(np.nextafter(corners, to) for to in (-np.inf, 0.0, np.inf)),
            10.0 ** rng.uniform(-300.0, 5.0, 300),
            [0.0, -0.0, 5e-324, 0.785, 1600.0, np.nextafter(1600.0, 2e3), 1e22, -1e22, 1e300],
        ]
    )
    with mpmath.workdps(400):
        exact = [[f(mpmath.mpf(value)) for value in x] for f in (mpmath.sin, mpmath.cos)]
    return x, *exact


@pytest.mark.parametrize("level", LEVELS)
def test_sine_and_cosine_are_good_to_two_ulp(level, at_level, sines_and_cosines):
    at_level(level)
    x, *exact = sines_and_cosines
    sine, cosine = _core.sincos(x)
    with mpmath.workdps(40):
        for found, right in zip((sine, cosine), exact, strict=True):
            errors = [
                abs(mpmath.mpf(a) - b) / mpmath.mpf(np.spacing(abs(float(b))))
                for a, b in zip(found, right, strict=True)
            ]
            assert max(errors) < 1.5
    near = x[:300]  # alone they take the short way: the same answer
    np.testing.assert_array_equal(_core.sincos(near)[0], sine[:300])
    np.testing.assert_array_equal(_core.sincos(near)[1], cosine[:300])


# -------------------------------------------------------------------------------------- bad input

GOOD = np.full(6, 0.1)
NAN = np.where(np.arange(6) == 3, np.nan, GOOD)


@pytest.mark.parametrize(
    ("y", "u", "error", "message"),
    [
        (GOOD[:5], 1.0, ValueError, r"y must have shape (6,) or (6, k), got (5,)"),
        (np.zeros((5, 6)), 1.0, ValueError, r"y must have shape (6,) or (6, k), got (5, 6)"),
        (np.zeros((6, 2, 2)), 1.0, ValueError, r"got (6, 2, 2)"),
        (0.5, 1.0, ValueError, r"y must have shape (6,) or (6, k), got ()"),
        ([], 1.0, ValueError, r"got (0,)"),
        (NAN, 1.0, ValueError, r"y must be finite, got nan at index 3"),
        (NAN[:, None] * [1, 1], 1.0, ValueError, r"y must be finite, got nan at index (3, 0)"),
        (GOOD * [-math.inf, *[1] * 5], 1.0, ValueError, r"y must be finite, got -inf at index 0"),
        (GOOD + 0j, 1.0, TypeError, r"y must be an array of real numbers, got array([0.1+0.j"),
        (
            np.ma.array(GOOD, mask=GOOD > 0.0),
            1.0,
            ValueError,
            "y must not be masked, got 6 masked",
        ),
        ([[1.0], [1.0, 2.0]], 1.0, TypeError, r"y must be an array of real numbers, got [[1.0], "),
        (GOOD, -1e-9, ValueError, r"u must lie in [0, 1e+100], got -1e-09"),
        (GOOD, math.nan, ValueError, r"u must lie in [0, 1e+100], got nan"),
        (GOOD, 10**400, ValueError, r"u must lie in [0, 1e+100], got inf"),
        (GOOD, [1.0], ValueError, r"u must be a number, got shape (1,)"),
        (GOOD, "1", TypeError, r"u must be a real number, got '1'"),
        (GOOD[:, None], [1.0, 2.0], ValueError, r"u must be a number or have shape (1,), got"),
        (GOOD[:, None], [[1.0]], ValueError, r"u must be a number or have shape (1,), got"),
        (GOOD[:, None] * [1, 1], [1, -2], ValueError, r"[0, 1e+100], got -2.0 at index 1"),
        (GOOD[:, None], "u", TypeError, r"u must be a real number or an array of them, got 'u'"),
    ],
)
@both
def test_bad_states_and_speeds_are_refused(model, y, u, error, message):
    with pytest.raises(error, match=re.escape(message)):
        model.rhs(0.0, y, u)
    with pytest.raises(error, match=re.escape(message)):
        model.power(y, u)
    if message.startswith("y must be"):
        with pytest.raises(error, match=re.escape(message)):
            model.energy(y)


def test_jacobian_takes_a_state_or_a_batch():
    chain = everything(3)
    y, u = states(3, 3), np.array([0.0, 2.0, 4.0])
    each = [chain.jacobian(0.0, y[:, k], u[k]) for k in range(3)]
    # States of a batch are differentiated side by side, so that rounding differs.
    np.testing.assert_allclose(chain.jacobian(0.0, y, u), each, rtol=1e-12, atol=1e-12)
    with pytest.raises(ValueError, match=re.escape("or (6, k), got (1, 6)")):
        chain.jacobian(0.0, GOOD[None], 1.0)
    with pytest.raises(ValueError, match=re.escape("u must be a number, got shape (1,)")):
        chain.jacobian(0.0, GOOD, [1.0])
    with pytest.raises(ValueError, match="at most 4000 degrees of freedom, got 4001"):
        pp.Chain(pp.Pipe(0.2), 4001).jacobian(0.0, np.zeros(8002), 1.0)


@both
def test_numbers_of_any_real_type_and_layout_are_taken(model):
    whole = np.arange(12).reshape(6, 2) % 5 % 2
    expected = model.rhs(0.0, whole.astype(float), 2.0)
    same = [
        model.rhs(0.0, whole, 2),
        model.rhs(0.0, whole.tolist(), np.int64(2)),
        model.rhs(0.0, np.asfortranarray(whole, dtype=float), np.float32(2)),
        model.rhs(0.0, np.repeat(whole, 2, axis=1)[:, ::2], np.array(2.0)),
        model.rhs(0.0, whole.astype(np.float32), [2, 2]),
        model.rhs(0.0, whole.astype(object), 2.0),
        model.rhs(0.0, np.ma.array(whole), 2.0),
        model.rhs(0.0, whole.astype(">f8"), np.array([2.0, 9.0, 2.0])[::2]),
    ]
    for found in same:
        np.testing.assert_array_equal(found, expected)
    frozen = whole.astype(float)
    frozen.flags.writeable = False
    np.testing.assert_array_equal(model.rhs(None, frozen, 2.0), expected)
    assert model.rhs(0.0, frozen[:, :1], 1.0).shape == (6, 1)
    assert isinstance(model.energy(frozen[:, 0]), float)
    assert isinstance(model.power(frozen[:, 0], 1.0).total, float)


@both
def test_operators_take_one_number_a_coordinate(model):
    with pytest.raises(ValueError, match=r"y must have shape \(6,\) or \(6, k\), got \(5, 2\)"):
        model.jacobian(0.0, np.ones((5, 2)), 1.0)
    with pytest.raises(ValueError, match="q must have 3 entries, got 2"):
        model.operators([0.0, 0.0])
    with pytest.raises(ValueError, match=r"q must lie in \[-1e\+06, 1e\+06\], got nan at index 1"):
        model.operators([0.0, np.nan, 0.0])
    for name in ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"):
        found, expected = (getattr(model.operators(q), name) for q in (np.zeros(3), None))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
