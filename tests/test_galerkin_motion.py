# SPDX-License-Identifier: MIT
"""Motion of the reduced model at any amplitude, against routes that do not share its derivation."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from independent import bent_state, derivative, gauss, second_derivative
from numpy.polynomial import Legendre
from scipy.optimize import brentq, root
from scipy.special import roots_legendre

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe
from pipedyn.models.galerkin import basis_joints

BASES = ["beam", "legendre"]
FLOWS = ["ejecting", "aspirating"]
LEVELS = _core.vector_levels()
OPERATORS = ["mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"]
TERMS = (pp.Spring(0.6, 50.0), pp.PointMass(0.6, 0.1), pp.PointMass(1.0, 0.2), pp.Spring(1.0, 3.0))
SIZES = [(1, ()), (3, ()), (5, ()), (8, ()), (9, ()), (3, TERMS), (8, TERMS)]
PANELLED = (*TERMS, pp.PointMass(0.25, 0.4))
"""With a mass where the pipe is cut into one panel more."""
SHORT = (pp.PointMass(0.5, 0.3), pp.Spring(0.55, 200.0), pp.PointMass(1.0, 0.1))
"""Terms that leave a short panel between two long ones."""
LOADS = [("ejecting", ()), ("aspirating", ()), ("aspirating", PANELLED)]
SIZE_NAMES = ["1", "3", "5", "8", "9", "3 with terms", "8 with terms"]


def fine(model, nodes):
    """The same equations with at least so many quadrature nodes."""
    return _core.Galerkin(
        pipe=core_pipe(model.pipe),
        legendre=model.basis == "legendre",
        size=model.dof,
        joints=basis_joints(model.pipe) if model.basis == "legendre" else np.zeros(0),
        least_nodes=nodes,
    )


# ------------------------------------------------------------- d'Alembert, from positions alone


def textbook_slopes(basis, m):
    """Functions Theta_i and their derivatives: beam modes with cosh, Legendre series by numpy."""
    if basis == "legendre":
        bends = [math.sqrt(2 * i + 1) * Legendre.basis(i, domain=[0, 1]) for i in range(m)]
        turns = [bend.integ(lbnd=0.0) for bend in bends]
        return (
            lambda s: np.stack([turn(s) for turn in turns], axis=-1),
            lambda s: np.stack([bend(s) for bend in bends], axis=-1),
        )
    characteristic = lambda k: math.cos(k) + 1 / math.cosh(k)  # noqa: E731
    roots = np.array(
        [brentq(characteristic, (i + 0.2) * math.pi, (i + 0.8) * math.pi) for i in range(m)]
    )
    sigma = (np.cosh(roots) + np.cos(roots)) / (np.sinh(roots) + np.sin(roots))

    def turn(s):
        x = np.multiply.outer(s, roots)
        return roots * (np.sinh(x) + np.sin(x) - sigma * (np.cosh(x) - np.cos(x)))

    def bend(s):
        x = np.multiply.outer(s, roots)
        return roots**2 * (np.cosh(x) + np.cos(x) - sigma * (np.sinh(x) + np.sin(x)))

    return turn, bend


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("m", [1, 3])
def test_pipe_and_fluid_obey_dalembert(m, basis, flow):
    """Accelerations of pipe and of fluid particles, differentiated from where they are.

    A fluid particle moves through the pipe at U / sqrt(beta); only positions r(s, q) are used, with
    virtual displacements that are their differences. The end coefficient, an empirical factor of
    the centrifugal force, multiplies that part of the particle's acceleration.
    """
    rng = np.random.default_rng(m)
    pipe = pp.Pipe(0.3, gamma=4.0, flow=flow, alpha=0.6, drag=0.8, damping=0.02)
    model = pp.Galerkin(pipe, m, basis)
    u = 5.0
    sign, centrifugal = 1.0 if flow == "ejecting" else -1.0, 0.6
    turn, bend = textbook_slopes(basis, m)
    inner, inner_weights = gauss(40)

    def position(s, q):
        angle = turn(np.multiply.outer(s, inner)) @ q
        along = np.stack([np.sin(angle), np.cos(angle)], axis=-1)
        return s[:, None] * np.einsum("skc,k->sc", along, inner_weights)

    def moved(t, q, rate, acceleration, drift=0.0):
        return position(s + drift * t, q + rate * t + 0.5 * acceleration * t**2)

    panel, panel_weights = gauss(8)
    s = ((np.arange(30)[:, None] + panel) / 30).ravel()  # many panels: the drag has kinks
    weights = np.tile(panel_weights / 30, 30)
    for _ in range(2):
        y = bent_state(model, rng, angle=rng.uniform(0.3, 2.0))
        q, rate = y[:m], y[m:]
        motion = partial(moved, q=q, rate=rate, acceleration=model.rhs(0.0, y, u)[m:])
        speed, h = sign * u / math.sqrt(0.3), 1e-3
        bent = second_derivative(lambda x, q=q: position(s + x, q), 5e-3) * speed**2
        fluid = second_derivative(partial(motion, drift=speed), h) - (1.0 - centrifugal) * bent
        angle = turn(s) @ q
        normal = np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
        across = np.sum(normal * derivative(motion, h), axis=-1)
        load = 0.7 * second_derivative(motion, h) + 0.3 * fluid - [0.0, 4.0]
        load += 0.8 * (np.abs(across) * across)[:, None] * normal
        for i in range(m):
            unit = np.eye(m)[i]
            virtual = derivative(lambda x, q=q, unit=unit: position(s, q + x * unit), 5e-3)
            work = np.sum(load * virtual, axis=-1)
            bending = bend(s) @ (q + 0.02 * rate) * bend(s)[:, i]
            size = weights @ np.abs(work) + weights @ np.abs(bending)
            assert abs(weights @ (work + bending)) < 2e-7 * size


# ------------------------------------------------------------------------------------ energy


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("effects", range(16))
def test_power_is_the_energys_rate_with_every_effect_on_and_off(effects, basis, flow):
    rng = np.random.default_rng(effects)
    gravity, drag, damping, flowing = (bool(effects >> bit & 1) for bit in range(4))
    pipe = pp.Pipe(
        0.4,
        gamma=-7.0 if gravity else 0.0,
        flow=flow,
        alpha=0.7,
        drag=1.5 if drag else 0.0,
        damping=0.01 if damping else 0.0,
    )
    model = pp.Galerkin(pipe, 5, basis)
    u = 6.0 if flowing else 0.0
    for angle in (0.5, 3.0):
        y = bent_state(model, rng, angle)
        slope = model.rhs(0.0, y, u)
        power = model.power(y, u)
        speed = np.linalg.norm(slope) / np.linalg.norm(y)
        rate = derivative(lambda t, y=y, slope=slope: model.energy(y + t * slope), 3e-3 / speed)
        # The modes exchange energy far faster than the pipe gains it, which differences show.
        assert rate == pytest.approx(power.total, abs=1e-11 * model.energy(y) * speed)
        assert power.total == power.flow + power.joints + power.drag
        assert power.others == 0.0
        assert (power.flow != 0.0) == flowing
        assert (power.joints < 0.0) == damping
        assert (power.drag < 0.0) == drag


@pytest.mark.parametrize("flow", FLOWS)
def test_the_flow_works_at_the_free_end_only(flow):
    rng = np.random.default_rng(3)
    model = pp.Galerkin(pp.Pipe(0.25, gamma=2.0, flow=flow, alpha=0.7), 4, "legendre")
    y, u = bent_state(model, rng, 1.5), 4.0
    q, rate = y[:4], y[4:]
    velocity = derivative(lambda t: model.tip(q + t * rate), 1e-3)
    angle = (model.functions([1.0], 1) @ q)[0]
    along = velocity @ [math.sin(angle), math.cos(angle)]
    sign, centrifugal = 1.0 if flow == "ejecting" else -1.0, 0.7
    expected = -sign * 0.5 * u * velocity @ velocity - centrifugal * u**2 * along
    assert model.power(y, u).flow == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("basis", BASES)
def test_energy_is_that_of_the_shape(basis):
    """Bending, weight and kinetic energy of the drawn centreline; zero at rest."""
    rng = np.random.default_rng(4)
    model = pp.Galerkin(pp.Pipe(0.3, gamma=6.0), 4, basis)
    y = bent_state(model, rng, 2.0)
    q, rate = y[:4], y[4:]
    s, weights = gauss(60)
    bending = 0.5 * weights @ (model.functions(s, 2) @ q) ** 2
    weight = 6.0 * weights @ (s - model.shape(q, s)[:, 1])
    velocity = derivative(lambda t: model.shape(q + t * rate, s), 1e-3)
    kinetic = 0.5 * weights @ np.sum(velocity**2, axis=1)
    assert model.energy(y) == pytest.approx(bending + weight + kinetic, rel=1e-9)
    assert model.energy(np.zeros(8)) == 0.0
    tiny = np.concatenate([1e-9 * q, np.zeros(4)])
    linear = 0.5 * tiny[:4] @ model.operators().stiffness @ tiny[:4]
    assert model.energy(tiny) == pytest.approx(linear, rel=1e-9, abs=0.0)


# ---------------------------------------------------------------------------------- Jacobian


@pytest.mark.parametrize(("flow", "terms"), LOADS)
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("drag", [0.0, 1.5])
def test_jacobian_is_the_derivative_of_rhs(drag, basis, flow, terms):
    rng = np.random.default_rng(5)
    m, u = 6, 5.0
    pipe = pp.Pipe(0.4, gamma=-7.0, flow=flow, alpha=0.7, drag=drag, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, m, basis)
    scale = np.concatenate([model.elastic_scale, 14.0 * model.elastic_scale])
    for angle in (0.5, 2.0):
        y = bent_state(model, rng, angle)
        found = model.jacobian(0.0, y, u) * scale

        def along(x, j, y=y):
            return model.rhs(0.0, y + x * scale[j] * np.eye(2 * m)[j], u)

        expected = np.stack([derivative(partial(along, j=j), 1e-2) for j in range(2 * m)], axis=1)
        error = np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)
        # With drag the difference's steps move the kinks of the integrand.
        assert error.max() < (3e-6 if drag else 1e-9)


@pytest.mark.parametrize(("flow", "terms"), LOADS)
@pytest.mark.parametrize("basis", BASES)
def test_small_motions_are_those_of_the_operators(basis, flow, terms):
    """Drag included: it has no linear part, and a Jacobian at rest."""
    rng = np.random.default_rng(6)
    pipe = pp.Pipe(0.4, gamma=5.0, flow=flow, alpha=0.7, drag=2.0, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, 6, basis)
    mass, damping, stiffness = model.operators().at(5.0)
    linear = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    jacobian = model.jacobian(0.0, np.zeros(12), 5.0)
    np.testing.assert_allclose(jacobian[6:], linear, atol=1e-10 * np.abs(linear).max())
    np.testing.assert_array_equal(jacobian[:6], np.eye(12)[6:])
    straight = model.operators(np.zeros(6))
    for name in OPERATORS:
        expected = getattr(model.operators(), name)
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(getattr(straight, name), expected, atol=1e-13 * size)
    smooth = pp.Galerkin(replace(pipe, drag=0.0), 6, basis)
    y = bent_state(model, rng, 1.0)
    errors = [
        np.abs(smooth.rhs(0.0, size * y, 5.0)[6:] / size - linear @ y).max() for size in (0.1, 0.01)
    ]
    assert errors[1] == pytest.approx(errors[0] / 100.0, rel=0.05)


@pytest.mark.parametrize("basis", BASES)
def test_operators_about_a_buckled_pipe_are_its_small_motions(basis):
    """Standing under too much weight it rests bent; there the Jacobian is that of the operators."""
    model = pp.Galerkin(pp.Pipe(0.3, gamma=-12.0, damping=0.02), 5, basis)

    def force(q):
        return model.rhs(0.0, np.concatenate([q, np.zeros(5)]), 1.0)[5:]

    rest = root(force, model.elastic_scale * [1.5, 0.0, 0.0, 0.0, 0.0], tol=1e-13).x
    assert abs(model.tip(rest)[0]) > 0.3
    ops = model.operators(rest)
    mass, damping, stiffness = ops.at(1.0)
    linear = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    jacobian = model.jacobian(0.0, np.concatenate([rest, np.zeros(5)]), 1.0)
    np.testing.assert_allclose(jacobian[5:], linear, atol=1e-9 * np.abs(linear).max())
    np.testing.assert_array_equal(ops.gyroscopic, -ops.gyroscopic.T)
    for name in ("mass", "end_flux", "damping", "stiffness"):
        matrix = getattr(ops, name)
        np.testing.assert_allclose(matrix, matrix.T, atol=1e-13 * np.abs(matrix).max())
    assert np.linalg.matrix_rank(ops.end_flux) == 2


# -------------------------------------------------------------------------------- quadrature


@pytest.mark.parametrize("drag", [0.0, 1.0])
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(
    ("m", "terms"),
    [(1, ()), (2, ()), (3, ()), (5, ()), (8, ()), (12, ()), (4, SHORT), (8, SHORT), (12, SHORT)],
)
def test_quadrature_misses_less_than_it_says(m, terms, basis, drag):
    """Against far more nodes, from small angles to pi, in low functions and in all of them."""
    rng = np.random.default_rng(7)
    model = pp.Galerkin(pp.Pipe(0.3, gamma=5.0, drag=drag, terms=terms), m, basis)
    reference = fine(model, (400 if drag else 250) // (2 if terms else 1))  # on each panel
    worst = 0.0
    for angle in (0.3, 1.0, 2.0, math.pi):
        for falling in (0.0, 1.0, 3.0):
            for speed in (1.0, 14.0, 40.0):
                y = bent_state(model, rng, angle, speed, falling)
                expected = reference.rhs(0.0, y, 6.0)
                error = np.abs(model.rhs(0.0, y, 6.0) - expected)[m:].max()
                worst = max(worst, error / np.abs(expected[m:]).max())
    assert worst < (1e-6 if drag else 1e-10)


@pytest.mark.parametrize("basis", BASES)
def test_steps_that_may_err_more_take_fewer_nodes_and_miss_a_thousandth_of_it_at_most(basis):
    """Over one step of a fixed length, against far more nodes."""
    rng, m, step = np.random.default_rng(7), 3, 1e-6
    model = pp.Galerkin(pp.Pipe(0.3, gamma=5.0), m, basis)
    reference, missed = fine(model, 250), []
    for rtol in (1e-4, 1e-6, 1e-10):
        worst = 0.0
        for angle, falling in itertools.product((0.3, 1.0, 2.0, math.pi), (0.0, 1.0, 3.0)):
            y = bent_state(model, rng, angle, 14.0, falling)
            ends = []
            for core in (model.motion, reference):
                motion = _core.Integrator(
                    *(core, np.array([6.0]), y[:, None], 0.0, [rtol]),
                    *(np.full((2 * m, 1), 1e9), 1e8, step),
                )
                found = np.empty((1, 1, 2 * m))
                while not motion.advance(np.array([step]), found, 1000)[0]:
                    pass
                ends.append(found[0, 0, m:])
            scale = step * np.abs(reference.rhs(0.0, y, 6.0)[m:]).max()
            worst = max(worst, np.abs(ends[0] - ends[1]).max() / scale)
        missed.append(worst)
    assert missed[0] < 1e-7
    assert missed[1] < 1e-9
    assert missed[2] < 1e-12 < missed[0]


def test_nodes_follow_functions_and_amplitude():
    counts = [
        pp.Galerkin(pp.Pipe(0.2), m, "legendre").motion.nodes(np.zeros(m)) for m in (2, 8, 24)
    ]
    assert counts == sorted(set(counts))
    model = pp.Galerkin(pp.Pipe(0.2), 8, "legendre")
    curled = np.eye(8)[0]
    counts = [model.motion.nodes(size * curled) for size in (0.0, 3.0, 30.0, 1e6)]
    assert counts == sorted(set(counts))
    with pytest.raises(pp.NotResolved, match=r"bends the pipe by 1e\+06 rad"):
        model.rhs(0.0, np.concatenate([1e6 * curled, curled]), 1.0)


# ----------------------------------------------------------------------- batches and threads


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(("m", "terms"), SIZES, ids=SIZE_NAMES)
def test_a_batch_is_its_members(m, terms, basis, level, at_level):
    """At every width, whatever the neighbours' amplitudes."""
    at_level(level)
    rng = np.random.default_rng(8)
    pipe = pp.Pipe(0.4, gamma=-3.0, drag=0.7, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, m, basis)
    angles = rng.choice([0.0, 0.1, 1.0, 3.0], 20)
    states = np.stack([bent_state(model, rng, angle) for angle in angles], axis=1)
    speeds = rng.uniform(0.0, 7.0, 20)
    speeds[::5] = 0.0
    single = np.stack([model.rhs(0.0, states[:, k], speeds[k]) for k in range(20)], axis=1)
    size = np.abs(single).max(axis=0)
    energies = np.array([model.energy(states[:, k]) for k in range(20)])
    powers = [model.power(states[:, k], speeds[k]) for k in range(20)]
    for width in range(1, 21):
        some = states[:, :width], speeds[:width]
        found = model.rhs(0.0, *some)
        assert (np.abs(found - single[:, :width]) <= 1e-12 * size[:width]).all()
        np.testing.assert_allclose(model.energy(some[0]), energies[:width], rtol=1e-13)
        power = model.power(*some)
        for name in ("flow", "joints", "drag", "others", "total"):
            each = np.array([getattr(one, name) for one in powers[:width]])
            assert getattr(power, name).shape == (width,)
            close = 1e-12 * np.abs(each).max()
            np.testing.assert_allclose(getattr(power, name), each, rtol=0.0, atol=close)
    common = model.rhs(0.0, states, 3.0)
    np.testing.assert_array_equal(common, model.rhs(0.0, states, np.full(20, 3.0)))


def test_an_empty_batch_is_empty():
    model = pp.Galerkin(pp.Pipe(0.4, drag=0.7), 3)
    assert model.rhs(0.0, np.zeros((6, 0)), 1.0).shape == (6, 0)
    assert model.rhs(0.0, np.zeros((6, 0)), np.zeros(0)).shape == (6, 0)
    assert model.energy(np.zeros((6, 0))).shape == (0,)
    assert model.power(np.zeros((6, 0)), 1.0).total.shape == (0,)


@pytest.mark.parametrize("drag", [0.0, 0.7])
@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(("m", "terms"), SIZES, ids=SIZE_NAMES)
def test_jacobians_of_a_batch_are_those_of_its_members(m, terms, basis, drag, at_level):
    """Of angles from small ones to two turns, which take grids of several sizes."""
    rng = np.random.default_rng(14)
    pipe = pp.Pipe(0.4, gamma=-3.0, drag=drag, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, m, basis)
    angles = np.repeat([0.3, 1.0, 2.0, 12.0], 5)[:19]
    y = np.stack([bent_state(model, rng, angle) for angle in angles], axis=1)
    u = np.linspace(0.0, 6.0, 19)
    for level in LEVELS:
        at_level(level)
        found = model.jacobian(0.0, y, u)
        assert found.shape == (19, 2 * m, 2 * m)
        for k in range(19):
            expected = model.jacobian(0.0, y[:, k], u[k])
            assert np.abs(found[k] - expected).max() < 1e-11 * np.abs(expected).max()
    assert model.jacobian(0.0, y[:, :0], 3.0).shape == (0, 2 * m, 2 * m)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(("m", "terms"), SIZES, ids=SIZE_NAMES)
def test_levels_agree(m, terms, basis, at_level):
    rng = np.random.default_rng(12)
    pipe = pp.Pipe(0.4, gamma=-3.0, drag=0.7, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, m, basis)
    y = np.stack([bent_state(model, rng, angle) for angle in (0.3, 1.0, 2.0)], axis=1)
    found = []
    for level in LEVELS:
        at_level(level)
        found.append((model.rhs(0.0, y, 3.0), model.jacobian(0.0, y[:, 1], 3.0)))
    for parts in found[1:]:
        for part, first in zip(parts, found[0], strict=True):
            assert np.abs(part - first).max() < 1e-12 * np.abs(first).max()


@pytest.mark.parametrize("terms", [(), TERMS], ids=["plain", "terms"])
def test_rates_with_the_work_done_are_rhs_and_power(terms):
    rng = np.random.default_rng(13)
    pipe = pp.Pipe(0.4, gamma=2.0, drag=0.7, damping=0.01, terms=terms)
    model = pp.Galerkin(pipe, 4, "legendre")
    y = np.stack([bent_state(model, rng, 1.0) for _ in range(5)], axis=1)
    u = np.linspace(0.0, 6.0, 5)
    found = model.motion.rhs_and_power(0.0, np.vstack([y, np.ones(5)]), u)
    np.testing.assert_array_equal(found[:8], model.rhs(0.0, y, u))
    np.testing.assert_array_equal(found[8], model.power(y, u).total)


def test_one_model_serves_many_threads():
    rng = np.random.default_rng(9)
    pipe = pp.Pipe(0.3, gamma=1.0, drag=0.5)
    model, fresh = pp.Galerkin(pipe, 6, "legendre"), pp.Galerkin(pipe, 6, "legendre")
    states = [bent_state(model, rng, angle) for angle in rng.uniform(0.0, 3.0, 64)]
    batch = np.stack(states, axis=1)

    def answers(asked, y):
        return (
            asked.rhs(0.0, y, 5.0),
            asked.jacobian(0.0, y, 5.0),
            asked.energy(y),
            asked.power(y, 5.0).total,
            asked.rhs(0.0, batch, 5.0),
        )

    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(partial(answers, fresh), states))
    for y, found in zip(states, together, strict=True):
        for one, other in zip(found, answers(model, y), strict=True):
            np.testing.assert_array_equal(one, other)


# ---------------------------------------------------------------------------------- symmetry


def test_reversing_time_turns_the_flow():
    """Ejecting, seen backwards, is aspirating with the inlet coefficient 1."""
    rng = np.random.default_rng(11)
    out = pp.Galerkin(pp.Pipe(0.4, gamma=2.0), 4, "legendre")
    back = pp.Galerkin(pp.Pipe(0.4, gamma=2.0, flow="aspirating"), 4, "legendre")
    y = bent_state(out, rng, 1.5)
    turned = np.concatenate([y[:4], -y[4:]])
    forward = out.rhs(0.0, y, 3.0)[4:]
    np.testing.assert_allclose(back.rhs(0.0, turned, 3.0)[4:], forward, rtol=1e-11)


# --------------------------------------------------------------------------------- arguments

MODEL = pp.Galerkin(pp.Pipe(0.2, gamma=1.0, drag=0.3), 3)
GOOD = np.linspace(0.1, 0.6, 6)


def test_states_of_any_layout_and_number_type_serve():
    expected = MODEL.rhs(0.0, GOOD, 2.0)
    np.testing.assert_array_equal(MODEL.rhs(0, list(GOOD), 2), expected)
    np.testing.assert_array_equal(MODEL.rhs(0.0, np.repeat(GOOD, 2)[::2], np.int32(2)), expected)
    np.testing.assert_array_equal(MODEL.rhs(None, GOOD, np.array(2.0)), expected)
    whole = np.array([1, 0, 0, 2, 0, 0])
    np.testing.assert_array_equal(MODEL.rhs(0.0, whole, 2.0), MODEL.rhs(0.0, whole * 1.0, 2.0))
    batch = np.stack([GOOD, 2 * GOOD, -GOOD], axis=1)
    many = MODEL.rhs(0.0, batch, [0, 1, 2])
    np.testing.assert_array_equal(MODEL.rhs(0.0, np.asfortranarray(batch), [0, 1, 2]), many)
    assert many.shape == (6, 3)
    assert MODEL.rhs(0.0, batch[:, :1], 1.0).shape == (6, 1)
    assert MODEL.energy(batch).shape == (3,)
    assert isinstance(MODEL.energy(GOOD), float)
    assert isinstance(MODEL.power(GOOD, 1.0).total, float)


def test_other_bad_arguments_are_refused():
    with pytest.raises(ValueError, match=r"y must have shape \(6,\) or \(6, k\), got \(5, 2\)"):
        MODEL.jacobian(0.0, np.ones((5, 2)), 1.0)
    with pytest.raises(ValueError, match="q must have 3 entries, got 4"):
        MODEL.operators(np.zeros(4))
    with pytest.raises(ValueError, match=r"q must lie in \[-1e\+06, 1e\+06\], got nan at index 1"):
        MODEL.operators([0.0, math.nan, 0.0])


@pytest.mark.parametrize("basis", ["beam", "legendre"])
@pytest.mark.parametrize("turns", [0.01, 0.5, 5.0, 150.0])  # the last beyond the core's grids
def test_tips_and_their_velocities_are_integrals_of_the_centreline(basis, turns):
    model = pp.Galerkin(pp.Pipe(0.3, 5.0), 3, basis)
    q = model.bent(lambda s: 2.0 * np.pi * turns * s) * np.linspace(0.9, 1.0, 9)[:, None]
    rates = np.linspace(-1.0, 2.0, 27).reshape(9, 3)
    nodes, weights = roots_legendre(1500)  # numpy 1.26's weights err by 1e-13
    slopes = model.functions(0.5 + 0.5 * nodes, 1)
    angles, turning = q @ slopes.T, rates @ slopes.T
    sine, cosine = np.sin(angles), np.cos(angles)
    tips = np.stack([sine, cosine], axis=-1).swapaxes(1, 2) @ (0.5 * weights)
    moved = np.stack([cosine * turning, -sine * turning], axis=-1).swapaxes(1, 2) @ (0.5 * weights)
    np.testing.assert_allclose(model.tips(q.T), tips, atol=1e-13)
    np.testing.assert_allclose(model.tip_velocities(q.T, rates.T), moved, atol=1e-11)


@pytest.mark.parametrize("terms", [(), (pp.PointMass(0.5, 1.0),)], ids=["plain", "terms"])
def test_a_coil_beyond_the_quadrature_is_refused_and_no_motion_goes_there(terms):
    """50 turns of 8 functions are resolved, 500 are not, nor 150 of 3."""
    model = pp.Galerkin(pp.Pipe(0.2, terms=terms), 8, "legendre")
    near, far = (
        np.append(model.bent(lambda s, turns=turns: 2.0 * np.pi * turns * s), np.zeros(8))
        for turns in (50, 500)
    )
    for ask in (model.rhs, model.jacobian):
        assert np.isfinite(ask(0.0, near, 1.0)).all()
        with pytest.raises(pp.NotResolved, match=r"by 3\.14e\+03 rad.* resolve this shape up to"):
            ask(0.0, far, 1.0)
    few = pp.Galerkin(pp.Pipe(0.2, terms=terms), 3, "legendre")
    with pytest.raises(pp.MotionStopped, match=r"step size tends to 0|finite"):
        pp.simulate(few, 1.0, 0.1, lambda s: 900.0 * s)
