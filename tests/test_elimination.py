# SPDX-License-Identifier: MIT
"""The core's eigenproblems: pairs, sweeps, and elimination panel by panel beside matrices.

The matrices come from quadrature on a grid, which shares nothing with the banded tables.
"""

import math

import numpy as np
import pytest
from independent import companion_eigenvalues, series_crossing
from scipy.optimize import brentq
from test_continuum import PIPES as CONTINUOUS

import pipedyn as pp
from pipedyn import _core
from pipedyn.linear.critical_speed import _run_searches, _Search
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.models.galerkin import PanelPencil, enriched, last_functions
from pipedyn.util.counters import count_work

SPANS = tuple(np.arange(1, 10) / 10.0)
STATIONS = (pp.PointMass(0.3, 0.4), pp.Spring(0.65, 30.0), pp.Damper(1.0, 0.2))
PIPES = {
    "plain": pp.Pipe(0.3),
    "heavy and damped": pp.Pipe(0.6, 40.0, damping=2e-3),
    "standing": pp.Pipe(0.2, -5.0),
    "hysteretic": pp.Pipe(0.4, 3.0, hysteresis=0.05),
    "aspirating": pp.Pipe(0.3, 2.0, flow="aspirating", inflow_share=0.4),
    "with terms": pp.Pipe(0.5, 10.0, damping=1e-3, terms=STATIONS),
    "distributed": pp.Pipe(0.3, terms=(pp.Foundation(80.0), pp.Viscosity(2.0), pp.Tension(5.0))),
    "spans": pp.Pipe(0.3, 4.0, supports=SPANS),
    "pinned spans": pp.Pipe(0.3, root="pinned", end="pinned", supports=(0.2, 0.55)),
    "on a spring": pp.Pipe(0.2, root=pp.RootSpring(2.0), end="guided", supports=(0.4,)),
}


def matrices(model, u):
    """M, C and K at a speed in elastic coordinates, of the grid, with a loss factor's part of K."""
    ops, pipe = model.elastic_operators(), model.pipe
    velocity = pipe.direction * (ops.gyroscopic + ops.end_flux)
    stiffness = ops.stiffness + pipe.alpha * u**2 * ops.flux
    if pipe.hysteresis:
        stiffness = stiffness + 1j * pipe.hysteresis * np.diag(model.elastic_share)
    return ops.mass, u * velocity + ops.damping, stiffness


def log_derivatives(model, u, values):
    """d log det P / dlambda = tr(P^-1 dP/dlambda) of the grid's matrices."""
    mass, velocity, stiffness = matrices(model, u)
    slopes = [2.0 * value * mass + velocity for value in values]
    p = [value**2 * mass + value * velocity + stiffness for value in values]
    return [np.trace(np.linalg.solve(*pair)) for pair in zip(p, slopes, strict=True)]


@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_tables_of_panels_multiply_as_the_grid_s_matrices(pipe):
    model = pp.Continuum(pipe).frozen(30 + 4 * len(pipe.supports))
    pencil = model.pencil()
    assert isinstance(pencil, PanelPencil)
    ops, every = model.elastic_operators(), np.eye(model.dof)
    velocity = pipe.direction * (ops.gyroscopic + ops.end_flux)
    expected = ops.mass, velocity, ops.damping, ops.stiffness, ops.flux
    products = pencil.mass, pencil.velocity, pencil.damping, pencil.stiffness, pencil.flux
    for product, matrix in zip(products, expected, strict=True):
        size = np.abs(matrix).max() + 1.0
        np.testing.assert_allclose(product(every), matrix, rtol=0.0, atol=2e-13 * size)


@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_determinant_by_panels_is_that_of_the_grid_s_matrices(pipe):
    model = pp.Continuum(pipe).frozen(24 + 4 * len(pipe.supports))
    spectrum = eigenproblem(model).spectrum()
    dice = np.random.default_rng(8)
    for u in (0.0, 2.0, 9.0):
        values = dice.uniform(-60.0, 60.0, 9) + 1j * dice.uniform(1.0, 400.0, 9)
        found = spectrum.log_derivatives(u, values)
        expected = log_derivatives(model, u, values)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_determinant_of_200_functions_neither_overflows_nor_loses_digits():
    model = pp.Continuum(pp.Pipe(0.5, 10.0)).frozen(200)
    spectrum = eigenproblem(model).spectrum()
    values = 10.0 ** np.linspace(-3.0, 7.0, 21) * np.exp(1.9j)
    found = spectrum.log_derivatives(6.0, values)
    # Far beyond all roots, of which there are 400, det P is like lambda^400; the mass matrix, all
    # that is left there, has the condition number 1e18.
    far = np.array([1e60 + 1e60j])
    assert far * spectrum.log_derivatives(6.0, far) == pytest.approx(400.0, rel=1e-4)
    expected = log_derivatives(model, 6.0, values)
    np.testing.assert_allclose(found, expected, rtol=1e-7)


@pytest.mark.parametrize("pipe", [PIPES["plain"], PIPES["with terms"]], ids=["plain", "terms"])
def test_determinant_is_as_good_where_the_first_pivot_is_zero(pipe):
    """The entry of P that elimination begins with vanishes: only by other rows does it go on."""
    model = pp.Continuum(pipe).frozen(26)
    spectrum, last, u = eigenproblem(model).spectrum(), last_functions(model)[-1], 5.0
    mass, velocity, stiffness = (matrix[last, last] for matrix in matrices(model, u))
    values = np.roots([mass, velocity, stiffness])
    found = spectrum.log_derivatives(u, values)
    np.testing.assert_allclose(found, log_derivatives(model, u, values), rtol=1e-9)


@pytest.mark.parametrize("pipe", PIPES.values(), ids=PIPES)
def test_both_null_vectors_are_those_of_the_grid_s_matrices(pipe):
    model = pp.Continuum(pipe).frozen(36 + 4 * len(pipe.supports))
    for u in (0.0, 2.0, 9.0):
        pairs = eigenproblem(model).spectrum().by_recursion(u, 12, True)
        assert pairs is not None
        mass, velocity, stiffness = matrices(model, u)
        for value, x, y in zip(pairs.values, pairs.right.T, pairs.left.T, strict=True):
            whole = value**2 * mass + value * velocity + stiffness
            for vector, p in ((x, whole), (y, whole.conj().T)):
                sizes = (abs(value) ** 2 * mass, abs(value) * velocity, stiffness)
                size = sum(np.linalg.norm(one @ vector) for one in sizes)
                assert np.linalg.norm(p @ vector) < 1e-11 * size


@pytest.mark.parametrize("pipe", [PIPES["spans"], pp.Pipe(0.3, supports=SPANS)], ids=["heavy", ""])
def test_vectors_hold_of_modes_that_move_the_last_span_alone(pipe):
    """Its own mode, 1e-5 as large at the root, is what loads there hardly excite."""
    model = pp.Continuum(pipe).frozen(90)
    for u in (0.0, 5.0):
        pairs = eigenproblem(model).spectrum().by_recursion(u, 28, True)
        assert pairs is not None
        assert pairs.converged.all()
        mass, velocity, stiffness = matrices(model, u)
        for value, x in zip(pairs.values, pairs.right.T, strict=True):
            parts = value**2 * (mass @ x), value * (velocity @ x), stiffness @ x
            assert np.linalg.norm(sum(parts)) < 1e-11 * sum(map(np.linalg.norm, parts))


def test_fifty_equal_spans_have_the_roots_of_the_three_moments_equation():
    """Moments sin(j phi) at supports, phi = p pi / n: coth k - cot k = (csch k - csc k) cos phi."""
    n = 50

    def wave_number(phi):
        def sum_of_slopes(k):
            moved = math.sin(k) / math.tanh(k) - math.cos(k)
            return moved - (math.sin(k) / math.sinh(k) - 1.0) * math.cos(phi)

        return brentq(sum_of_slopes, math.pi, 4.8, xtol=1e-15)

    numbers = [math.pi, *(wave_number(p * math.pi / n) for p in range(n - 1, 0, -1))]
    pipe = pp.Pipe(0.3, root="pinned", end="pinned", supports=np.arange(1, n) / n)
    found = pp.eigenvalues(pp.Continuum(pipe), 0.0, count=20)
    np.testing.assert_allclose(found.real, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.imag[::2], (n * np.array(numbers[:10])) ** 2, rtol=1e-9)


def test_roots_asked_of_a_long_damped_chain_end_before_its_cluster():
    pipe = pp.Pipe(0.3, flow="aspirating", damping=1e-4, terms=(pp.Viscosity(30.0),))
    search = _Search(pp.Chain(pipe, 400), 12.0, True)
    found = search.spectrum.by_recursion(1.0, search.count, False)
    assert found is not None
    assert np.abs(found.values).max() < 1.0 / pipe.damping


def test_modes_are_left_out_only_where_flow_damps_all_of_them():
    """A tip mass lets each mode grow in turn: then all that are resolved are tracked."""
    pipes = {7: pp.Pipe(0.3), 18: pp.Pipe(0.3, terms=(pp.PointMass(1.0, 0.5),))}
    for least, pipe in pipes.items():
        model = pp.Continuum(pipe).frozen(40)
        search = _Search(model, 9.0, True, True)
        assert isinstance(search.spectrum, _core.Structured)
        assert search.tracked == least if least < 10 else search.tracked >= least


def test_roots_far_from_known_ones_are_those_of_matrices():
    """Of thirty spans roots move too far for one step, and those half way are found first."""
    pipe = pp.Pipe(0.3, supports=tuple(np.arange(1, 30) / 30))
    model = pp.Continuum(pipe).frozen(200)
    spectrum, u = eigenproblem(model).spectrum(), 40.0
    assert spectrum.by_recursion(0.0, 100, False) is not None
    far = spectrum.by_recursion(u, 90, False)
    assert far is not None
    mass, velocity, stiffness = matrices(model, u)
    expected = companion_eigenvalues(mass, velocity, stiffness)
    for value in far.values:
        assert np.abs(expected - value).min() < 1e-6 * abs(value)
    assert np.abs(far.values).max() < (1.0 + 1e-6) * np.sort(np.abs(expected))[89]


def test_all_modes_that_a_tip_mass_lets_grow_cross_where_power_series_say():
    """The mass all but pins the end, and flow works hardly on high modes: each crosses in turn."""
    pipe = pp.Pipe(0.99, terms=(pp.PointMass(1.0, 0.897), pp.Spring(1.0, 19.07)))
    found = pp.crossings(pp.Continuum(pipe), 7.0)
    growing = [one for one in found if one.destabilising]
    assert [one.mode for one in growing[1:]] == [*range(3, 15)]
    for one in growing:
        speed, frequency = series_crossing(pipe, one.speed, one.frequency, 90)
        assert abs(one.speed - speed) <= one.error < 1e-6 * speed
        assert abs(one.frequency - frequency) < 1e-9 * frequency


@pytest.mark.parametrize(
    ("end", "count"), [(15.0, 62), pytest.param(20.0, 113, marks=pytest.mark.slow)]
)
def test_all_crossings_are_found_where_larger_bases_show_more(end, count):
    """Those of 300 functions, searched by themselves, agree."""
    tip = pp.PointMass(1.0, 0.897), pp.Spring(1.0, 19.07)
    pipe = pp.Pipe(0.994375, 169.518, terms=tip)
    found = pp.crossings(pp.Continuum(pipe), end)
    search = _Search(pp.Continuum(pipe).frozen(300), end, False, True)
    _run_searches([search])
    alone = search().value
    assert len(found) == len(alone) == count
    for one, other in zip(found, alone, strict=True):
        assert abs(one.speed - other.speed) <= one.error + other.error
        assert one.error < 1e-6 * one.speed


# ------------------------------------------------------------------- pairs and their residuals


@pytest.mark.parametrize("n", [10, 100])
def test_a_wrong_pair_has_a_residual_that_shows_it(n):
    """An eigenvalue wrong in the seventh digit, or a vector wrong in the seventh, does not pass."""
    problem = eigenproblem(pp.Chain(pp.Pipe(0.2), n))
    assert problem.is_long == (n == 100)
    spectrum = problem.spectrum()
    pairs = spectrum.lowest(6.0, 4, left=False, high=True)
    assert pairs.converged.all()
    off = _core.Pairs(pairs.values * (1 + 1e-7), pairs.right)
    bent = _core.Pairs(pairs.values, pairs.right + 1e-7 * np.eye(n)[:, [n // 2]])
    for wrong in (off, bent):
        spectrum.assess(6.0, wrong)
        assert (wrong.residuals > 1e-9).all()
        assert not wrong.converged.any()


def test_a_slope_of_a_stiff_root_is_the_change_of_the_root():
    chain = pp.Chain(pp.Pipe(0.4, damping=1e-9), lengths=[0.3, 1e-4, 0.7 - 1e-4])
    spectrum = eigenproblem(chain).spectrum()
    u, h = 5.0, 0.01
    before, at, after = (
        spectrum.lowest(speed, 6, left=True, high=True) for speed in (u - h, u, u + h)
    )
    spectrum.assess(u, at)
    slope = at.slopes[-2]
    change = (after.values[-2] - before.values[-2]) / (2.0 * h)
    assert abs(at.values[-2]) > 1e5
    assert abs(slope - change) <= 1e-7 * abs(change)


def test_a_sweep_of_a_heavy_hanging_pipe_needs_no_more_samples_than_that_of_a_light_one():
    """Their critical speeds go with the speeds of their free ends, and so do the steps."""
    counts, speeds = [], []
    for gamma in (0.0, 1e4):
        with count_work() as counters:
            speeds.append(pp.critical_speed(pp.Galerkin(pp.Pipe(0.2, gamma), 40, "legendre")).speed)
        counts.append(counters.factorisations)
    assert speeds[1] > 8.0 * speeds[0]
    assert counts[1] < 3 * counts[0]


# ------------------------------------------------------------- one search for two sizes


def searched(model, max_speed, larger=None):
    """A search over three fifths of the modes, and what it says of a larger model."""
    problem = eigenproblem(model)
    spectrum, resolved = problem.spectrum(), (3 * model.dof) // 5
    if larger is not None:
        others = eigenproblem(larger).spectrum()
        spectrum = _core.Truncated(spectrum, others, resolved)
    size = model.dof
    asked = (max_speed, 1.0, 2 * size, size, resolved, model.resolved_modes, False)
    (sweep,) = _core.crossings([spectrum], [asked], lambda _: None)
    if larger is None:
        return sweep
    return spectrum.of_larger(sweep, max_speed, (3 * larger.dof) // 5)


@pytest.mark.parametrize("pipe", [one for one in CONTINUOUS if one.flow == "ejecting"], ids=str)
def test_a_search_finds_the_crossings_of_the_next_size(pipe):
    model = pp.Continuum(pipe)
    larger = enriched(model.frozen(38), 1)
    found = searched(model.frozen(30), 12.0, larger)
    assert found is not None
    expected = searched(larger, 12.0).crossings
    assert len(found.crossings) == len(expected) > 0
    for one, other in zip(found.crossings, expected, strict=True):
        assert abs(one.speed - other.speed) <= one.error + other.error
        assert one.change == other.change


@pytest.mark.parametrize("size", [4, 5, 6, 7, 8, 10])
def test_too_small_a_basis_says_nothing_of_a_larger_one(size):
    """At u = 20 it has not the crossings of the larger one, or misses too much of some root."""
    model = pp.Continuum(pp.Pipe(0.5))
    assert searched(model.frozen(size), 20.0, model.frozen(size + 8)) is None
