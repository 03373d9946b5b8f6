# SPDX-License-Identifier: MIT
"""Reduced models: bases and operators against quadrature of the textbook expressions."""

import math

import mpmath
import numpy as np
import pytest
from independent import gauss
from numpy.polynomial import Legendre
from scipy.special import eval_legendre

import pipedyn as pp


def beam_root(i):
    """Root i (from 1) of cos(k) cosh(k) = -1, in mpmath."""
    guess = (i - mpmath.mpf(1) / 2) * mpmath.pi
    if i == 1:
        guess = mpmath.mpf("1.875")
    return mpmath.findroot(lambda k: mpmath.cos(k) + 1 / mpmath.cosh(k), guess)


def beam_mode(i, s, derivative=0):
    """Textbook beam mode, cosh - cos - sigma (sinh - sin), with digits to spare, in mpmath."""
    k = beam_root(i)
    sigma = (mpmath.cosh(k) + mpmath.cos(k)) / (mpmath.sinh(k) + mpmath.sin(k))
    x = k * s
    ch, sh, c, n = mpmath.cosh(x), mpmath.sinh(x), mpmath.cos(x), mpmath.sin(x)
    value = [ch - c - sigma * (sh - n), sh + n - sigma * (ch - c), ch + c - sigma * (sh + n)]
    return k**derivative * value[derivative]


# ----------------------------------------------------------------------------------- bases


@pytest.mark.parametrize("number", [1, 2, 5, 12, 13, 50, 300])
def test_beam_modes_are_good_at_any_number(number):
    """Against the textbook formula with as many digits as it needs."""
    s = np.array([0.0, 1e-3, 0.02, 0.3, 0.5, 0.77, 0.999, 1.0])
    model = pp.Galerkin(pp.Pipe(0.2), number)
    with mpmath.workdps(int(30 + number * math.pi)):
        root = float(beam_root(number))
        for derivative in range(3):
            expected = [float(beam_mode(number, mpmath.mpf(float(x)), derivative)) for x in s]
            found = model.functions(s, derivative)[:, -1]
            np.testing.assert_allclose(
                found, expected, atol=2e-14 * number * root**derivative, err_msg=f"{derivative}"
            )


def test_beam_modes_are_orthogonal_with_unit_mass():
    model = pp.Galerkin(pp.Pipe(0.2), 60)
    nodes, weights = gauss(240)
    values = model.functions(nodes)
    roots = np.array([float(beam_root(i)) for i in range(1, 61)])
    np.testing.assert_allclose(values.T * weights @ values, np.eye(60), atol=1e-12)
    scaled = model.functions(nodes, 2) / roots**2
    np.testing.assert_allclose(scaled.T * weights @ scaled, np.eye(60), atol=1e-12)
    np.testing.assert_allclose(model.operators().mass, np.eye(60), atol=1e-12)
    np.testing.assert_allclose(model.operators().stiffness, np.diag(roots**4), rtol=1e-12)
    s = np.linspace(0.1, 0.9, 9)  # far from its ends a mode of high number is a sine
    high = pp.Galerkin(pp.Pipe(0.2), 600).functions(s)[:, -1]
    sine = math.sqrt(2.0) * np.sin((599.5 * s - 0.25) * math.pi)
    np.testing.assert_allclose(high, sine, atol=1e-9)


def test_legendre_functions_have_legendre_polynomials_for_curvature():
    model = pp.Galerkin(pp.Pipe(0.2), 30, "legendre")
    s = np.linspace(0.0, 1.0, 41)
    for i in range(30):
        expected = math.sqrt(2 * i + 1) * eval_legendre(i, 2.0 * s - 1.0)
        np.testing.assert_allclose(model.functions(s, 2)[:, i], expected, atol=1e-12)
    high = pp.Galerkin(pp.Pipe(0.2), 2000, "legendre")
    expected = math.sqrt(3999) * eval_legendre(1999, 2.0 * s - 1.0)
    np.testing.assert_allclose(high.functions(s, 2)[:, -1], expected, atol=1e-9)
    assert np.isfinite([high.functions(s, derivative) for derivative in (0, 1)]).all()
    nodes, weights = gauss(40)
    curvatures = model.functions(nodes, 2)
    np.testing.assert_allclose(curvatures.T * weights @ curvatures, np.eye(30), atol=1e-13)


def test_legendre_functions_integrate_their_curvature_twice():
    """Exact series: w'' -> w' -> w with w(0) = w'(0) = 0."""
    model = pp.Galerkin(pp.Pipe(0.2), 20, "legendre")
    s = np.linspace(0.0, 1.0, 23)
    for i in range(20):
        curvature = math.sqrt(2 * i + 1) * Legendre.basis(i, domain=[0.0, 1.0])
        slope = curvature.integ(lbnd=0.0)
        np.testing.assert_allclose(model.functions(s, 1)[:, i], slope(s), atol=1e-14)
        np.testing.assert_allclose(model.functions(s)[:, i], slope.integ(lbnd=0.0)(s), atol=1e-14)


# -------------------------------------------------------------------------------- operators


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_operators_are_the_weak_form_of_the_pipes_equation(basis):
    """Each term of the equation, integrated from mpmath or polynomial functions."""
    pipe = pp.Pipe(0.3, gamma=2.0, damping=0.01)
    m = 4
    ops = pp.Galerkin(pipe, m, basis).operators()
    s, weights = gauss(60)
    ends = np.append(s, 1.0)
    if basis == "beam":
        with mpmath.workdps(30):
            tables = [
                np.array(
                    [[float(beam_mode(i + 1, mpmath.mpf(x), d)) for i in range(m)] for x in at]
                )
                for at, d in ((ends, 0), (s, 1), (s, 2))
            ]
    else:
        curves = [math.sqrt(2 * i + 1) * Legendre.basis(i, domain=[0, 1]) for i in range(m)]
        families = [[c.integ(2 - d, lbnd=0.0) if d < 2 else c for c in curves] for d in range(3)]
        tables = [np.stack([f(s) for f in family], axis=1) for family in families]
        tables[0] = np.stack([f(ends) for f in families[0]], axis=1)
    (value, end), slope, curve = (tables[0][:-1], tables[0][-1]), tables[1], tables[2]
    bend, weight = curve.T * weights @ curve, slope.T * (weights * (1.0 - s)) @ slope
    leaves = math.sqrt(0.3) * np.outer(end, end)
    expected = {
        "mass": value.T * weights @ value,
        "stiffness": bend + 2.0 * weight,
        "damping": 0.01 * bend,
        "flux": value.T * weights @ curve,
        "end_flux": leaves,
        "gyroscopic": 2.0 * math.sqrt(0.3) * value.T * weights @ slope - leaves,
    }
    for name, matrix in expected.items():
        found, most = getattr(ops, name), 1e-11 * np.abs(matrix).max()
        np.testing.assert_allclose(found, matrix, rtol=1e-10, atol=most, err_msg=name)


def test_aspirating_reverses_the_speed_and_alpha_multiplies_the_centrifugal_term_only():
    out = pp.Galerkin(pp.Pipe(0.3), 5).operators()
    back = pp.Galerkin(pp.Pipe(0.3, flow="aspirating", alpha=0.25), 5).operators()
    for name in ("mass", "gyroscopic", "end_flux", "stiffness", "flux"):
        np.testing.assert_array_equal(getattr(out, name), getattr(back, name))
    _, c_out, k_out = out.at(4.0)
    _, c_back, k_back = back.at(4.0)
    np.testing.assert_array_equal(c_back, -c_out)
    np.testing.assert_allclose(k_back, k_out - 0.75 * 16.0 * out.flux, rtol=1e-14)


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_elastic_coordinates_describe_the_same_pipe(basis):
    model = pp.Galerkin(pp.Pipe(0.3, gamma=1.0, damping=0.01), 8, basis)
    transform = model.from_elastic(np.eye(8))
    plain, elastic = model.operators(), model.elastic_operators()
    for name in ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"):
        expected = transform.T @ getattr(plain, name) @ transform
        np.testing.assert_allclose(getattr(elastic, name), expected, atol=1e-13)


# ------------------------------------------------------------------------------------ shape


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_the_centreline_keeps_its_length_at_any_amplitude(basis):
    model = pp.Galerkin(pp.Pipe(0.2), 4, basis)
    q = np.array([0.4, -0.1, 0.05, 0.02])
    s = np.linspace(0.0, 1.0, 2001)
    steps = np.hypot(*np.diff(model.shape(q, s), axis=0).T)
    np.testing.assert_allclose(steps, 1 / 2000, rtol=1e-4)
    assert steps.sum() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(model.tip(q), model.shape(q, s)[-1], rtol=1e-13)
    np.testing.assert_allclose(model.deflection(q, s), model.functions(s) @ q, atol=1e-15)
