# SPDX-License-Identifier: MIT
"""Motion of the reduced model at any amplitude, against routes that do not share its derivation."""

import math
from functools import partial

import numpy as np
import pytest
from independent import bent_state, derivative, gauss, pipe_rates, second_derivative
from numpy.polynomial import Legendre
from scipy.optimize import brentq
from scipy.special import roots_legendre

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe
from pipedyn.models.galerkin import basis_joints

BASES = ["beam", "legendre"]
FLOWS = ["ejecting", "aspirating"]
SHORT = (pp.PointMass(0.5, 0.3), pp.Spring(0.55, 200.0), pp.PointMass(1.0, 0.1))
"""Terms that leave a short panel between two long ones."""


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


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(
    "flow", [{"flow": "aspirating", "inflow_share": 0.4}, {"jet_angle": 0.8}], ids=str
)
def test_flow_that_enters_or_leaves_another_way_does_its_virtual_work(flow, basis):
    """All integrals by one fine Gauss rule, those from the clamp by Legendre series."""
    model = pp.Galerkin(pp.Pipe(0.3, 4.0, alpha=0.7, damping=0.01, **flow), 4, basis)
    y = 0.3 * np.random.default_rng(8).normal(size=8)
    exact = pipe_rates(model, y, 4.5)
    np.testing.assert_allclose(model.rhs(0.0, y, 4.5), exact, rtol=1e-8, atol=1e-8)


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
def test_motions_whose_tolerance_takes_fewer_nodes_miss_no_more_than_it(basis):
    model = pp.Galerkin(pp.Pipe(0.3, gamma=5.0), 3, basis)

    def end(rtol):
        return pp.simulate(model, 6.0, 0.5, lambda s: 2.0 * s, rtol=rtol, atol=rtol).q[-1]

    exact = end(1e-13)
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        assert np.abs(end(rtol) - exact).max() < 10.0 * rtol * np.abs(exact).max(), rtol


def test_jacobians_do_not_read_what_another_state_left_in_memory():
    model, y = pp.Galerkin(pp.Pipe(0.3, 5.0), 9), np.append(np.full(9, 0.01), np.zeros(9))
    expected = model.jacobian(0.0, y, 3.0)
    fast = pp.Galerkin(pp.Pipe(0.3, 5.0, drag=1.0), 3)
    with pytest.raises(pp.NotResolved):
        fast.jacobian(0.0, np.append(np.zeros(3), np.full(3, 1e300)), 3.0)
    np.testing.assert_array_equal(model.jacobian(0.0, y, 3.0), expected)


# ------------------------------------------------------------------------------------ free end


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
    np.testing.assert_allclose(model.tip(q[0]), tips[0], atol=1e-13)
    np.testing.assert_allclose(model.tip_velocities(q.T, rates.T), moved, atol=1e-11)
