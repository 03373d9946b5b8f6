# SPDX-License-Identifier: MIT
"""Terms of the reduced model and the continuum, against routes that derive them otherwise."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from independent import bent_state, panels, series_crossing, series_newton_step, tells_its_distance
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import pipedyn as pp
from pipedyn import _core
from pipedyn.models.base import core_pipe

BASES = ["beam", "legendre"]
OPERATORS = ["mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"]

SPRUNG = (pp.Spring(0.6, 50.0),)
LOADED = (pp.PointMass(0.35, 0.4),)
ALL = (pp.PointMass(0.25, 0.4), pp.Spring(0.6, 50.0), pp.PointMass(1.0, 0.2), pp.Spring(1.0, 3.0))
JOINTS, PLACES = [0.25, 0.6], np.array([0.25, 0.6, 1.0])
MASSES, STIFFNESSES = np.array([0.4, 0.0, 0.2]), np.array([0.0, 50.0, 3.0])


# ------------------------------------------------------------------------------------- the basis


@pytest.mark.parametrize("m", [3, 4, 20, 41])
def test_panelled_functions_integrate_legendre_curvatures_from_the_clamp(m):
    model = pp.Galerkin(pp.Pipe(0.2, terms=ALL), m, "legendre")
    s, weights = panels(JOINTS, m + 3)
    curvature = model.functions(s, 2)
    np.testing.assert_allclose(curvature.T * weights @ curvature, np.eye(m), atol=1e-13)
    at = np.array([0.1, 0.25, 0.4, 0.6, 0.77, 1.0])
    slope, value = np.zeros((2, at.size, m))
    for row, point in enumerate(at):
        inner, inner_weights = panels([*JOINTS, point], m)
        turned = model.functions(inner, 2) * (inner_weights * (inner < point))[:, None]
        slope[row], value[row] = turned.sum(axis=0), (point - inner) @ turned
    np.testing.assert_allclose(model.functions(at, 1), slope, atol=1e-13)
    np.testing.assert_allclose(model.functions(at), value, atol=1e-13)


def test_a_larger_basis_begins_with_the_smaller_one_and_serves_every_panel():
    s = np.linspace(0.0, 1.0, 50)
    pipe = pp.Pipe(0.2, terms=(pp.PointMass(0.01, 1.0), pp.PointMass(0.4, 1.0)))
    largest = pp.Galerkin(pipe, 60, "legendre").functions(s, 2)
    for m in (3, 10, 15, 31):
        model = pp.Galerkin(pipe, m, "legendre")
        np.testing.assert_allclose(model.functions(s, 2), largest[:, :m], atol=1e-12)
        counts = [
            int((np.abs(model.functions([point], 2)[0]) > 0).sum()) for point in (0.004, 0.2, 0.7)
        ]
        assert sum(counts) == m
        assert min(counts) >= min(4, m // 3)
        if m > 15:
            assert counts == sorted(counts)


@pytest.mark.parametrize("m", [5, 16, 40])
def test_no_panel_has_more_functions_than_its_quadrature_serves(m):
    """Operators by the model's own rule are those by far more nodes."""
    model = pp.Galerkin(pp.Pipe(0.3, gamma=4.0, terms=ALL), m, "legendre")
    s, weights = panels(JOINTS, m + 20)
    value, slope = model.functions(s), model.functions(s, 1)
    at = model.functions(PLACES)
    tension = 1.0 - s + 0.2 + 0.4 * (s < 0.25)
    mass = value.T * weights @ value + at.T * MASSES @ at
    stiffness = np.eye(m) + 4.0 * slope.T * (weights * tension) @ slope
    stiffness += at.T * STIFFNESSES @ at
    np.testing.assert_allclose(model.operators().mass, mass, atol=1e-14)
    np.testing.assert_allclose(model.operators().stiffness, stiffness, atol=1e-12)


# --------------------------------------------------------------------------------- linear answers


def test_every_mode_that_a_tip_mass_lets_grow_crosses_where_power_series_say():
    """Without damping mode after mode loses stability, ever more slowly: 1e-7 of its frequency."""
    pipe = pp.Pipe(0.115, terms=(pp.PointMass(1.0, 0.527), pp.Spring(1.0, 15.376)))
    found = pp.crossings(pp.Continuum(pipe), 9.0)
    assert [c.mode for c in found if c.destabilising] == list(range(2, 15))
    assert [c.mode for c in found if not c.destabilising] == [3]
    for crossing in found:
        assert crossing.error <= 1e-5

        def growth(u, value=1j * crossing.frequency):
            root = value + series_newton_step(pipe, value, u, 90)
            assert abs(root - value) <= 1e-6 * abs(value)
            return (root + series_newton_step(pipe, root, u, 90)).real

        before, after = (growth(crossing.speed + e) for e in (-crossing.error, crossing.error))
        assert before < 0.0 < after if crossing.destabilising else before > 0.0 > after


@pytest.mark.parametrize("basis", BASES)
def test_a_hung_mass_pulls_on_what_is_above_it(basis):
    """The least weight at s that buckles a weightless column clamped at 0: (pi / 2 s)^2."""
    at = 0.7
    pipe = pp.Pipe(0.2, gamma=-1.0)
    m = 60 if basis == "beam" else 24
    loaded = pp.Galerkin(replace(pipe, terms=[pp.PointMass(at, 1.0)]), m, basis)
    # A spring of nothing makes the panels of the two models the same.
    plain = pp.Galerkin(replace(pipe, terms=[pp.Spring(at, 0.0)]), m, basis)
    weight = plain.operators().stiffness - loaded.operators().stiffness
    elastic = np.linalg.inv(loaded.elastic_scale @ loaded.elastic_scale.T)
    least = 1.0 / eigh(weight, elastic, eigvals_only=True)[-1]
    assert least == pytest.approx((math.pi / 2.0 / at) ** 2, rel=1e-12 if m == 24 else 1e-3)


def test_a_stiff_end_spring_tends_to_a_pin():
    """Clamped-pinned divergence where tan u = u; the spring's give is of the order of 1 / k."""
    exact = brentq(lambda u: math.sin(u) - u * math.cos(u), 4.0, 4.6, xtol=1e-14)
    misses = []
    for stiffness in (1e4, 1e5, 1e6):
        found = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, terms=[pp.Spring(1.0, stiffness)])))
        assert found.kind == "divergence"
        misses.append(found.speed - exact)
    assert abs(misses[2]) < 1e-4
    np.testing.assert_allclose(misses[:2], np.multiply(misses[1:], 10.0), rtol=0.05)


def test_panels_restore_exponential_convergence():
    """A spring at mid-length: the first frequency's error, on panels and on one panel."""
    pipe = core_pipe(pp.Pipe(0.2, terms=(pp.Spring(0.5, 100.0),)))

    def frequency(m, joints):
        core = _core.Galerkin(
            pipe=pipe,
            legendre=True,
            size=m,
            joints=np.array(joints),
        )
        ops = core.operators()
        return math.sqrt(1.0 / eigh(ops.mass, ops.stiffness, eigvals_only=True)[-1])

    exact = frequency(30, [0.5])
    sizes = np.array([6, 8, 10, 12])
    errors = [frequency(m, [0.5]) / exact - 1.0 for m in sizes]
    rate = -np.polyfit(sizes, np.log(errors), 1)[0]
    assert rate > 2.0  # each function more divides the error by seven at least
    assert errors[-1] < 2e-12
    sizes = np.array([8, 12, 18, 27, 40])
    errors = [frequency(m, []) / exact - 1.0 for m in sizes]
    order = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 2.5 < order < 3.5
    assert errors[-1] > 1e-8


def test_beam_modes_converge_like_a_power():
    """The first frequency; critical speeds do too, from either side by turns."""

    def frequency(model):
        return np.abs(pp.eigenvalues(model, 0.0, 2))[0]

    exact = frequency(pp.Continuum(pp.Pipe(0.2, terms=SPRUNG)))
    sizes = np.array([10, 15, 22, 33, 50])
    models = [pp.Galerkin(pp.Pipe(0.2, terms=SPRUNG), m, "beam") for m in sizes]
    errors = [frequency(model) / exact - 1.0 for model in models]
    order = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 2.5 < order < 3.5
    assert errors[-1] < 1e-5
    found = pp.critical_speed(models[0])
    exact = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, terms=SPRUNG)))
    assert found.discretisation == pytest.approx(abs(found.speed - exact.speed), rel=1e-6)


@pytest.mark.parametrize(
    ("terms", "damping"),
    [(SPRUNG, 0.0), (LOADED, 0.01), (ALL, 0.0)],
    ids=["spring", "mass", "all"],
)
def test_the_distance_to_the_loaded_pipe_is_bounded_and_by_little(terms, damping):
    """Against power series; an end mass leaves little but the solvers' own errors."""
    pipe = pp.Pipe(0.2, damping=damping, terms=terms)
    start = pp.critical_speed(pp.Continuum(pipe))
    exact, _ = series_crossing(pipe, start.speed, start.frequency)
    telling = 0
    for basis, m in (("beam", 6), ("beam", 16), ("legendre", 4), ("legendre", 12)):
        found = pp.critical_speed(pp.Galerkin(pipe, m, basis))
        telling += tells_its_distance(found, start, exact)
    assert telling >= 3


def test_weak_damping_keeps_the_terms():
    """Crossings at beta = 1e-12 are extrapolated from stronger pipes, which must carry them."""
    strong, weak = (
        pp.critical_speed(pp.Continuum(pp.Pipe(beta, terms=ALL))).speed for beta in (1e-7, 1e-12)
    )
    assert weak == pytest.approx(strong, rel=1e-4)
    assert abs(weak - pp.critical_speed(pp.Continuum(pp.Pipe(1e-12))).speed) > 0.1


MANY = [pp.PointMass(k / 10.0, 0.1) for k in range(1, 11)]
MANY += [pp.Spring(k / 10.0, 5.0 * k) for k in range(1, 11)]


@pytest.mark.parametrize(
    ("pipe", "m"),
    [
        pytest.param(
            *(pp.Pipe(0.4, gamma=3.0, damping=1e-3, terms=MANY), 60), marks=pytest.mark.slow
        ),
        # With 60 functions the panel of length 0.025 has one more than with any number up to 47.
        (pp.Pipe(0.645204, gamma=267.145, terms=(pp.Spring(0.975, 1.75),)), 60),
    ],
)
def test_many_terms_and_short_panels_converge_within_their_error(pipe, m):
    found = pp.critical_speed(pp.Continuum(pipe))
    finer = pp.critical_speed(pp.Galerkin(pipe, m, "legendre"))
    assert abs(found.speed - finer.speed) <= found.error + finer.error
    assert found.error < 1e-8


@pytest.mark.parametrize("inner", [(0.975,), (0.004, 0.5, 0.99), tuple(np.arange(1, 20) / 20)])
def test_a_larger_basis_of_the_continuum_has_more_functions_on_every_panel(inner):
    pipe = pp.Pipe(0.2, terms=[pp.Spring(at, 1.0) for at in inner])
    ends = [0.0, *inner, 1.0]
    places = [0.3 * low + 0.7 * high for low, high in pairwise(ends)]
    counts = []

    def question(model):
        counts.append((np.abs(model.functions(places, 2)) > 0.0).sum(axis=1))
        assert counts[-1].sum() == model.dof
        return model.dof

    with pytest.raises(pp.NotConverged):
        pp.Continuum(pipe).converge(question, lambda a, b: 1.0, largest=200)
    assert len(counts) > 5
    assert (np.diff(counts, axis=0) >= 1).all()


def test_terms_side_by_side_are_as_at_one_place():
    """Too close for a panel between them: what that costs is the cube of the distance."""
    pipe = pp.Pipe(0.2, gamma=2.0)
    together = replace(pipe, terms=[pp.PointMass(0.5, 0.3), pp.Spring(0.5, 40.0)])
    speeds = [pp.critical_speed(pp.Continuum(together)).speed]
    for distance, count in ((2.1e-4, 3), (1.1e-4, 3), (0.9e-4, 2), (1e-7, 2)):
        near = replace(pipe, terms=[pp.PointMass(0.5, 0.3), pp.Spring(0.5 + distance, 40.0)])
        assert pp.Galerkin(near, 8, "legendre").panels == count
        speeds.append(pp.critical_speed(pp.Continuum(near)).speed)
    assert speeds[4] == pytest.approx(speeds[0], rel=1e-6)
    # Smooth in the distance, whether the panel is there or not.
    line = speeds[2] + 0.2 * (speeds[2] - speeds[1])
    assert speeds[3] == pytest.approx(line, rel=1e-8)


@pytest.mark.parametrize("basis", BASES)
def test_terms_at_one_place_add_up(basis):
    pipe = pp.Pipe(0.2, gamma=2.0, drag=0.5)
    one = [pp.PointMass(0.5, 0.3), pp.Spring(0.5, 40.0)]
    parts = [pp.Spring(0.5, 40.0), pp.PointMass(0.5, 0.1), pp.PointMass(0.5, 0.2)]
    whole, split = (pp.Galerkin(replace(pipe, terms=terms), 6, basis) for terms in (one, parts))
    for name in OPERATORS:
        expected = getattr(whole.operators(), name)
        size = np.abs(expected).max()
        np.testing.assert_allclose(getattr(split.operators(), name), expected, atol=1e-14 * size)
    y = bent_state(whole, np.random.default_rng(1), 1.0)
    expected = whole.rhs(0.0, y, 3.0)
    np.testing.assert_allclose(split.rhs(0.0, y, 3.0), expected, atol=1e-12 * abs(expected).max())


# ------------------------------------------------------------------------------------- the motion


EVERYTHING = pp.Pipe(0.4, gamma=-7.0, flow="aspirating", alpha=0.7, drag=1.5, damping=0.01)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("pipe", [EVERYTHING, pp.Pipe(0.3, gamma=5.0, drag=0.8)])
def test_a_term_of_nothing_leaves_the_plain_motion(pipe, basis):
    """Beam modes on several panels, Legendre on one."""
    at = (0.25, 0.6, 1.0) if basis == "beam" else (1.0,)
    nothing = [pp.PointMass(s, 1e-15) for s in at] + [pp.Spring(s, 1e-15) for s in at]
    plain, loaded = (pp.Galerkin(replace(pipe, terms=terms), 6, basis) for terms in ((), nothing))
    rng = np.random.default_rng(2)
    y = np.stack([bent_state(plain, rng, angle) for angle in (0.2, 1.0, 2.5)], axis=1)
    u = np.array([0.0, 3.0, 6.0])

    def close(found, expected, tolerance=1e-9):
        assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()

    close(loaded.rhs(0.0, y, u), plain.rhs(0.0, y, u), 1e-7)  # drag's kinks
    close(loaded.energy(y), plain.energy(y))
    for name in ("flow", "joints", "drag"):
        found, expected = (getattr(one.power(y, u), name) for one in (loaded, plain))
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)
    smooth = pp.Pipe(pipe.beta, gamma=pipe.gamma, damping=pipe.damping)
    plain, loaded = plain.with_pipe(smooth), loaded.with_pipe(replace(smooth, terms=nothing))
    close(loaded.rhs(0.0, y, u), plain.rhs(0.0, y, u))
    close(loaded.jacobian(0.0, y[:, 2], 6.0), plain.jacobian(0.0, y[:, 2], 6.0))
    for name in OPERATORS:
        found, expected = (getattr(one.operators(y[:6, 2]), name) for one in (loaded, plain))
        assert np.abs(found - expected).max() <= 1e-9 * max(1.0, np.abs(expected).max())
    close(loaded.tips(y[:6]), plain.tips(y[:6]))
    close(loaded.tip_velocities(y[:6], y[6:]), plain.tip_velocities(y[:6], y[6:]))
    close(loaded.bent(lambda s: s**2), plain.bent(lambda s: s**2))


@pytest.mark.parametrize("degrees", [20.0, 60.0, 110.0])
@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_under_an_end_weight_the_pipe_is_the_elastica(degrees):
    """Weight K(k)^2 turns the end by alpha, k = sin(alpha / 2), to x = 2 k / K, y = 2 E / K - 1.

    The pipe's own weight, a share of it, is extrapolated away.
    """
    alpha = math.radians(degrees)
    k = math.sin(0.5 * alpha)
    whole, second = ellipk(k**2), ellipe(k**2)
    ends = []
    for share in (2e-4, 1e-4):
        pipe = pp.Pipe(0.2, gamma=-share * whole**2, terms=[pp.PointMass(1.0, 1.0 / share)])
        model = pp.Galerkin(pipe, 12, "legendre")
        bent = model.bent(lambda s: alpha * np.sin(0.5 * math.pi * s))
        rest = pp.equilibrium_branch(model, bent, 0.0, (0.0, 0.1)).q[0]
        ends.append([*model.tip(rest), model.functions([1.0], 1)[0] @ rest])
    expected = [2.0 * k / whole, 2.0 * second / whole - 1.0, alpha]
    np.testing.assert_allclose(2.0 * np.array(ends[1]) - ends[0], expected, atol=1e-6)


# ---------------------------------------------------------------------------------- as an object


def test_models_keep_and_show_their_terms():
    pipe, other = pp.Pipe(0.2, terms=ALL), pp.Pipe(0.3, gamma=1.0, terms=SPRUNG)
    continuum = pp.Continuum(pipe)
    model = continuum.frozen(9)
    for one in (continuum, model):
        assert one.pipe.terms == ALL
        assert "PointMass(at=0.25, mass=0.4), Spring(at=0.6, stiffness=50)" in repr(one)
    assert continuum.with_pipe(other).pipe == model.with_pipe(other).pipe == other
    assert (model.panels, model.with_pipe(other).panels) == (3, 2)
    assert pp.Galerkin(pipe, 9, "beam").panels == 1
    assert pp.modes(continuum, 1.0, 4).converged.all()
    loci = pp.root_loci(continuum, [0.0, 1.0, 2.0], 4)
    values = np.concatenate([loci.eigenvalues[-1], loci.partners[-1]])
    found = pp.eigenvalues(continuum, 2.0, 8)
    assert max(np.abs(values - one).min() for one in found) < 1e-7


def test_every_panel_has_a_function():
    with pytest.raises(ValueError, match="one function on each of the 3 panels between terms, sup"):
        pp.Galerkin(pp.Pipe(0.2, terms=ALL), 2, "legendre")
