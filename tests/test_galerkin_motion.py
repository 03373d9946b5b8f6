# SPDX-License-Identifier: MIT
"""Motion of the reduced model at any amplitude, against routes that do not share its derivation."""

import itertools
import math
from functools import partial

import numpy as np
import pytest
from independent import bent_state, derivative, gauss, second_derivative
from numpy.polynomial import Legendre
from scipy.optimize import brentq
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


# ----------------------------------------------------------------------- batches and threads


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


# ---------------------------------------------------------------------------------- symmetry


# ------------------------------------------------------------------------------ known motions


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
