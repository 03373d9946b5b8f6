# SPDX-License-Identifier: MIT
"""How chains and reduced models tend to the continuous pipe, and that the paper's rule does not."""

from dataclasses import replace
from functools import cache

import mpmath
import numpy as np
import pytest
from independent import chain_crossing, series_crossing, tells_its_distance
from matplotlib.figure import Figure

import pipedyn as pp
from pipedyn import plot

PIPE = pp.Pipe(0.2)
EXACT = 5.591404378
"""Critical speed at beta = 0.2: determinant of the four exponentials in 30 digits."""


@cache
def chain_speed(rule, n, beta=0.2):
    """Critical speed of a chain without gravity, damping or drag."""
    return pp.critical_speed(pp.Chain(pp.Pipe(beta), n, springs=rule)).speed


def chain_errors(rule, sizes):
    return np.array([abs(chain_speed(rule, n) / EXACT - 1.0) for n in sizes])


def errors(models, exact=EXACT):
    return np.array([abs(pp.critical_speed(model).speed / exact - 1.0) for model in models])


def fitted_order(sizes, error):
    return -np.polyfit(np.log(sizes), np.log(error), 1)[0]


@pytest.mark.parametrize(
    ("rule", "order", "sizes", "largest"),
    [
        ("consistent", 2.0, (20, 28, 40), 1.3e-3),
        ("midpoint", 2.0, (20, 28, 40), 6.7e-4),
        ("uniform", 1.0, (30, 42, 60), 9e-3),
        ("frequency", 1.0, (60, 85, 120), 5.3e-3),  # settles last: 1.5 % less at half the size
    ],
)
def test_chains_converge_in_a_window(rule, order, sizes, largest):
    error = chain_errors(rule, sizes)
    assert fitted_order(sizes, error) == pytest.approx(order, abs=0.05)
    assert error[-1] < largest


@pytest.mark.parametrize(
    ("rule", "speeds"),
    [
        ("uniform", {2: 3.6541, 4: 4.7127, 10: 5.2762, 20: 5.4419, 40: 5.5190}),
        ("consistent", {2: 3.5927, 4: 4.9493, 10: 5.4857, 20: 5.5649, 40: 5.5848}),
        ("rayleigh", {2: 4.6649, 4: 5.1848, 10: 5.4122, 20: 5.4683, 40: 5.4914}),
        ("midpoint", {2: 5.4684, 3: 4.893, 4: 5.2150, 10: 5.5345, 20: 5.5773, 40: 5.5879}),
    ],
)
def test_chains_meet_the_printed_table(rule, speeds):
    """Of an earlier program. The midpoint cut is exact by chance at two segments."""
    for n, speed in speeds.items():
        assert chain_speed(rule, n) == pytest.approx(speed, abs=5.1e-4 if n == 3 else 5.1e-5), n


@pytest.mark.parametrize(("beta", "ratio"), [(0.2, 0.5), (0.5, 1.0)])
def test_the_midpoint_cut_has_no_more_error_than_consistent_springs(beta, ratio):
    """Half of it at beta = 0.2; hardly less of it at 0.5."""
    exact = pp.critical_speed(pp.Continuum(pp.Pipe(beta))).speed
    midpoint, consistent = (
        abs(chain_speed(rule, 40, beta) / exact - 1.0) for rule in ("midpoint", "consistent")
    )
    assert midpoint / consistent < ratio + 0.05


@pytest.mark.parametrize("n", [2, 3, 4, 5])
def test_matching_the_frequency_is_best_of_the_rules_with_equal_springs_on_few_segments(n):
    frequency, uniform, rayleigh = errors(
        [pp.Chain(PIPE, n, springs=rule) for rule in ("frequency", "uniform", "rayleigh")]
    )
    assert frequency < uniform
    assert frequency < rayleigh


def test_unequal_segments_converge_at_second_order_too():
    """Segments that shrink smoothly towards the free end, consistent springs."""
    sizes = np.array([14, 28, 56])

    def graded(n):
        ends = np.sin(0.4 * np.pi * np.arange(n + 1) / n)
        return pp.Chain(PIPE, lengths=np.diff(ends / ends[-1]))

    error = errors([graded(int(n)) for n in sizes])
    assert fitted_order(sizes, error) == pytest.approx(2.0, abs=0.05)
    assert error[-1] < 1e-3


def test_beam_modes_converge_at_fourth_order():
    """3 beam modes give 1e-3, 10 beam modes 6e-5."""
    sizes = np.array([8, 11, 16, 22, 32])
    error = errors([pp.Galerkin(PIPE, int(m), "beam") for m in sizes])
    assert fitted_order(sizes, error) == pytest.approx(4.0, abs=0.3)
    assert error[-1] < 1e-6
    three, ten = errors([pp.Galerkin(PIPE, 3, "beam"), pp.Galerkin(PIPE, 10, "beam")])
    assert three == pytest.approx(1e-3, rel=0.5)
    assert ten == pytest.approx(6e-5, rel=0.1)
    heavy = pp.Pipe(0.9)  # ten beam modes are worse
    exact = pp.critical_speed(pp.Continuum(heavy)).speed
    assert errors([pp.Galerkin(heavy, 10)], exact) == pytest.approx([1.7e-3], abs=5e-5)


def test_legendre_functions_converge_exponentially():
    """10 functions: 2e-10; each further one gains most of a digit."""
    exact = pp.critical_speed(pp.Continuum(PIPE)).speed
    sizes = np.arange(4, 12)
    error = errors([pp.Galerkin(PIPE, int(m), "legendre") for m in sizes], exact)
    digits_a_function = -np.polyfit(sizes, np.log10(error), 1)[0]
    assert digits_a_function > 0.8
    assert error[sizes == 10][0] == pytest.approx(2e-10, rel=0.5)


def law_told(found, exact):
    """What the legend of the picture says of a family."""
    ax = plot.convergence({"legendre": found}, exact, ax=Figure().subplots())
    return ax.get_legend_handles_labels()[1][0].removeprefix("reduced, legendre: ")


def law_of(sizes, errors):
    """The law that is told of models of these sizes with these relative errors."""
    exact = pp.critical_speed(pp.Continuum(PIPE))
    return law_told(
        [
            replace(exact, size=size, speed=exact.speed * (1.0 + error))
            for size, error in zip(sizes, errors, strict=True)
        ],
        exact,
    )


def test_a_law_is_told_from_the_largest_error_on():
    """Of Legendre functions three are closer than four, by chance; from four on the error falls."""
    found = [pp.critical_speed(pp.Galerkin(PIPE, m, "legendre")) for m in (2, 3, 4, 6, 8, 16)]
    off = np.abs([one.speed / EXACT - 1.0 for one in found])
    assert off[1] < off[2] > off[3]
    law = law_told(found, pp.critical_speed(pp.Continuum(PIPE)))
    assert law.startswith("factor ")
    assert law.endswith(" per function")
    assert float(law.split()[1]) == pytest.approx((off[2] / off[4]) ** (1.0 / 4.0), rel=0.05)


def test_errors_that_fall_fast_are_not_told_to_have_a_limit():
    sizes = [4, 6, 8, 10]
    assert law_of(sizes, [2.0**-size for size in sizes]) == "factor 2 per function"


def test_no_law_is_told_of_errors_that_grow():
    assert law_of([4, 6, 8, 12], [1e-8, -1e-6, 1e-4, -1e-2]) == "no clear order"


@pytest.mark.parametrize(("beta", "m"), [(0.5, 16), (0.99, 24)])
def test_a_few_legendre_functions_give_twelve_digits(beta, m):
    """With ten functions more nothing moves."""
    models = (pp.Galerkin(pp.Pipe(beta), size, "legendre") for size in (m, m + 10))
    few, more = (pp.critical_speed(model).speed for model in models)
    assert few == pytest.approx(more, rel=1e-12)


# ------------------------------------------------------------- what results say of their own error


FLOWS = ["ejecting", "aspirating"]


def random_pipe(rng, flow):
    """beta in [0.02, 0.9], gamma in [-5, 60]; damped where it aspirates, and half of the others."""
    damped = flow == "aspirating" or rng.random() < 0.5
    damping = 10.0 ** rng.uniform(-3.0, -1.3) if damped else 0.0
    # Without centrifugal force no ejecting pipe loses stability.
    alpha = rng.choice([0.0 if flow == "aspirating" else 0.8, 0.5, 1.0, 1.5])
    return pp.Pipe(rng.uniform(0.02, 0.9), rng.uniform(-5.0, 60.0), flow, alpha, damping=damping)


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("seed", range(2))
def test_the_distance_to_the_continuum_is_bounded_and_by_little(seed, flow):
    """Against the series in 60 digits; where the solvers' errors are all that is left, bounded."""
    pipe = random_pipe(np.random.default_rng(seed), flow)
    start = pp.critical_speed(pp.Continuum(pipe))
    exact, _ = series_crossing(pipe, start.speed, start.frequency)
    telling = 0
    for model in (
        pp.Chain(pipe, 10),
        pp.Chain(pipe, 16, springs="midpoint"),
        pp.Chain(pipe, 12, springs="uniform"),
        pp.Chain(pipe, 12, springs="frequency"),
        pp.Chain(pipe, 8, springs="rayleigh"),
        pp.Galerkin(pipe, 10),
        pp.Galerkin(pipe, 10, "legendre"),
        pp.Galerkin(pipe, 20, "legendre"),
    ):
        found = pp.critical_speed(model)
        telling += tells_its_distance(found, start, exact)
    assert telling >= 6


def galerkin_crossing(model, u, omega):
    """(u, omega) where an eigenvalue of the model's own matrices lies on the axis, in 30 digits."""
    ops = model.elastic_operators()
    mass, damping, stiffness, flux = (
        mpmath.matrix(x.tolist()) for x in (ops.mass, ops.damping, ops.stiffness, ops.flux)
    )
    velocity = mpmath.matrix((ops.direction * (ops.gyroscopic + ops.end_flux)).tolist())
    with mpmath.workdps(30):

        def parts(u, omega):
            value = mpmath.mpc(0, omega)
            whole = value**2 * mass + value * (u * velocity + damping)
            determinant = mpmath.det(whole + stiffness + ops.centrifugal * u**2 * flux)
            return determinant.real, determinant.imag

        u, _ = mpmath.findroot(parts, (mpmath.mpf(u), mpmath.mpf(omega)), tol=1e-20)
        return u


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("seed", range(2))
def test_the_solvers_error_is_bounded(seed, flow):
    """Against the same models in 30 digits: a chain by shooting, a reduced model's determinant."""
    pipe = random_pipe(np.random.default_rng(100 + seed), flow)
    chain, reduced = pp.Chain(pipe, 7), pp.Galerkin(pipe, 7, "legendre")
    found = pp.critical_speed(chain)
    exact, _ = chain_crossing(chain, found.speed, found.frequency)
    assert abs(found.speed - exact) <= found.error <= 1e-9 * found.speed
    found = pp.critical_speed(reduced)
    exact = galerkin_crossing(reduced, found.speed, found.frequency)
    assert abs(found.speed - exact) <= found.error <= 1e-9 * found.speed
