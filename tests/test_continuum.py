# SPDX-License-Identifier: MIT
"""Continuum against power series along the pipe and Chebyshev collocation.

Reference numbers: the determinant of the four exponentials in 30 digits or, where gamma is not 0,
an earlier program.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest
from independent import collocation_eigenvalues, distances, series_crossing, series_newton_step
from scipy.optimize import brentq

import pipedyn as pp


@cache
def critical(beta, **numbers):
    return pp.critical_speed(pp.Continuum(pp.Pipe(beta, **numbers)))


SUPPORTED = (pp.PointMass(0.4, 0.3), pp.Spring(0.7, 40.0), pp.Damper(1.0, 0.2))

PIPES = [
    pp.Pipe(0.2),
    pp.Pipe(0.5, gamma=20.0),
    pp.Pipe(1e-4),
    pp.Pipe(0.6, damping=0.02),
    pp.Pipe(0.3, gamma=-9.0, damping=1e-3),
    pp.Pipe(0.4, flow="aspirating", damping=3e-3),
    pp.Pipe(0.3, terms=(pp.Spring(1.0, 200.0),)),
    pp.Pipe(0.5, gamma=10.0, terms=SUPPORTED),
]


# ------------------------------------------------------------------------- critical speeds


WET, SLOWED = pp.AddedMass(0.5), pp.Viscosity(0.2)
ALL = (*SUPPORTED, pp.PointMass(1.0, 0.2), pp.Spring(1.0, 3.0))
TURNED = (
    pp.RotationalSpring(0.4, 6.0),
    pp.RotationalDamper(0.4, 0.3),
    pp.PointMass(0.4, 0.2, 0.03),
)


def drawn(share=1.0, alpha=1.0, beta=0.2, damping=5e-3):
    return pp.Pipe(beta, 0.0, "aspirating", alpha, inflow_share=share, damping=damping)


LOADED = {
    pp.Foundation(10.0): (0.1, "4.783532", "14.54114"),
    pp.Foundation(100.0): (0.1, "5.133889", "17.17017"),
    pp.Viscosity(1.42): (0.1, "5.002018", "13.42175"),
    pp.Viscosity(0.23): (0.65, "10.387042", "26.20101"),
    pp.Viscosity(5.0): (0.65, "10.026246", "22.12648"),
    pp.Tension(-2.0): (0.2, "4.976284857", "13.29835807"),
    pp.Tension(20.0): (0.2, "8.583785800", "15.84115869"),
    pp.Spring(1.0, 50.0): (0.2, "5.03750298", "0.0"),
    pp.Spring(1.0, 1000.0): (0.2, "4.51428818", "0.0"),
    WET: (0.3, "5.591404378", "11.19800550"),
}
LOST = [  # speed and frequency as determinants of exponentials and other programs print them
    (pp.Pipe(0.1), "4.749897", "14.21710"),
    (pp.Pipe(0.2), "5.591404378", "13.71469980"),
    (pp.Pipe(0.5), "9.322418433", "26.49732846"),
    (pp.Pipe(0.65), "10.405319", "26.41544"),
    (pp.Pipe(0.2, hysteresis=0.02), "5.664183", "13.54838"),
    (pp.Pipe(0.2, hysteresis=0.1), "5.900876", "12.96576"),
    (pp.Pipe(0.65, hysteresis=0.1), "10.078309", "23.15219"),
    (pp.Pipe(0.00203, 42.4, hysteresis=0.02), "5.790870", "18.14601"),  # Paidoussis: 5.79, 18.1
    (pp.Pipe(0.2, alpha=2.0), "3.358684218", "14.21710258"),
    (pp.Pipe(0.2, alpha=0.8), "6.947846171", "13.61380457"),
    (drawn(), "0.034553"),
    (drawn(0.5), "0.069089"),
    (drawn(0.5, 0.0), "0.069112"),
    (drawn(0.0), "0.869106"),
    *((pp.Pipe(beta, terms=[one]), *said) for one, (beta, *said) in LOADED.items()),
    (pp.Pipe(0.2, terms=[pp.Foundation(100.0)]), "7.172840", "17.72512"),
    (pp.Pipe(0.3, 10.0, damping=1e-3, terms=(WET, SLOWED)), "6.421133982", "12.17007738"),
    (pp.Pipe(0.2, stiffness=lambda s: 1 - s / 2), "4.993065", "12.64890"),
    (pp.Pipe(0.2, mass=lambda s: 1 + s), "4.700274", "11.37937"),
    (pp.Pipe(0.2, stiffness=pp.Profile([0.5], [1.0, 0.5])), "4.6867518", "11.79215"),
    *((pp.Pipe(beta),) for beta in (0.01, 0.9, 0.99, 0.999)),
    (pp.Pipe(0.3, damping=1e-3),),
    *((drawn(1.0, alpha, 0.3, damping),) for alpha, damping in ((1, 1e-3), (0.5, 0.01), (0, 0.01))),
    *((pp.Pipe(0.2, gamma, terms=ALL),) for gamma in (0.0, 10.0)),
    *((pp.Pipe(0.2, terms=[one]),) for one in SUPPORTED),
    (pp.Pipe(0.2, rotary_inertia=0.01),),
]


@pytest.mark.parametrize(("pipe", "printed"), [(pipe, said) for pipe, *said in LOST], ids=str)
def test_critical_speeds_are_those_in_print_and_of_power_series(pipe, printed):
    found = pp.critical_speed(pp.Continuum(pipe))
    assert found.stable_at_rest
    assert found.kind == ("flutter" if found.frequency else "divergence")
    for number, text in zip((found.speed, found.frequency), printed, strict=False):
        assert number == pytest.approx(float(text), abs=0.5 * 10.0 ** -len(text.split(".")[1]))
    if pipe.stiffness is None and pipe.mass is None:
        speed, frequency = series_crossing(pipe, found.speed, found.frequency)
        assert abs(found.speed - speed) <= found.error + 1e-13 * speed
        assert [found.speed, found.frequency] == pytest.approx([speed, frequency], rel=1e-12)
    assert found.discretisation == found.error <= 1e-10 * found.speed


@pytest.mark.parametrize("beta", [0.1, 0.5])
@pytest.mark.parametrize("gamma", [-6.0, 10.0, 60.0])
def test_heavy_pipes_cross_where_collocation_of_the_strong_form_does(beta, gamma):
    """An eigenvalue on the axis, no other unstable, and stable just below."""
    found = critical(beta, gamma=gamma)
    pipe = pp.Pipe(beta, gamma=gamma)
    values = collocation_eigenvalues(pipe, found.speed, size=48)[:24]
    nearest = values[np.argmin(np.abs(values - 1j * found.frequency))]
    assert abs(nearest - 1j * found.frequency) < 1e-8 * found.frequency
    others = values[np.abs(np.abs(values.imag) - found.frequency) > 1e-6]
    assert (others.real < 0.0).all()
    below = collocation_eigenvalues(pipe, 0.999 * found.speed, size=48)[:24]
    above = collocation_eigenvalues(pipe, 1.001 * found.speed, size=48)[:24]
    assert (below.real < 0.0).all()
    assert np.sum(above.real > 0.0) == 2


def test_a_pipe_buckled_under_its_own_weight_is_straightened_by_the_flow():
    """gamma = -10, beta = 0.2: straight from 1.797, flutter from 4.866."""
    found = pp.crossings(pp.Continuum(pp.Pipe(0.2, gamma=-10.0)), 6.0)
    assert [crossing.kind for crossing in found] == ["divergence", "flutter"]
    assert [(c.unstable_before, c.unstable_after) for c in found] == [(1, 0), (0, 2)]
    assert found[0].speed == pytest.approx(1.797, rel=0, abs=5e-4)
    assert found[1].speed == pytest.approx(4.866, rel=0, abs=5e-4)
    assert found[0].frequency == 0.0
    critical_one = critical(0.2, gamma=-10.0)
    assert critical_one.speed == pytest.approx(found[1].speed, rel=1e-12)
    assert not critical_one.stable_at_rest


def test_a_pipe_buckles_under_its_own_weight_at_minus_7_837():
    """Greenhill's column: stable at rest above gamma = -7.837, buckled below."""
    assert critical(0.2, gamma=-7.836).stable_at_rest
    assert not critical(0.2, gamma=-7.838).stable_at_rest


# ------------------------------------------------------------------------------ eigenvalues


@pytest.mark.parametrize(
    ("u", "omegas"),
    [
        (4.0, [4.012 + 4.755j, 17.036 + 2.526j, 55.738 + 3.497j, 114.625 + 3.551j]),
        (6.0, [2.152 + 12.157j, 13.631 - 0.882j, 47.382 + 4.998j, 106.377 + 5.261j]),
    ],
)
def test_eigenvalues_meet_the_printed_root_locus(u, omegas):
    """beta = 0.2, gamma = 0, as omega = -i lambda, three decimals."""
    found = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2)), u, 8)
    printed = sorted((-1j * found[found.imag > 0.0]), key=lambda omega: omega.real)
    np.testing.assert_allclose(np.real(printed), np.real(omegas), rtol=0, atol=5.1e-4)
    np.testing.assert_allclose(np.imag(printed), np.imag(omegas), rtol=0, atol=5.1e-4)


@pytest.mark.parametrize(
    ("u", "pipe"),
    [
        (6.0, pp.Pipe(0.2)),
        (8.0, pp.Pipe(0.2)),
        (12.0, pp.Pipe(0.7, damping=1e-3)),
        (2.0, pp.Pipe(0.4, flow="aspirating", alpha=0.6)),
        (6.0, pp.Pipe(0.3, 5.0, damping=1e-3, hysteresis=0.07)),
        (4.0, pp.Pipe(0.2, damping=1e-3, rotary_inertia=0.01)),
        (4.0, pp.Pipe(0.2, terms=[pp.Spring(1.0, 20.0)])),
        (6.0, pp.Pipe(0.4, damping=1e-3, terms=[pp.Spring(0.6, 50.0)])),
        *((3.0, pp.Pipe(0.3, damping=damping, terms=ALL)) for damping in (0.0, 2e-3)),
        (2.5, pp.Pipe(0.3, 25.0, terms=ALL)),
        (2.5, pp.Pipe(0.6, -3.0, damping=5e-4, terms=ALL)),
        (2.5, pp.Pipe(0.1, 8.0, "aspirating", 1.4, damping=1e-3, terms=ALL)),
        *((2.5, pp.Pipe(0.3, terms=terms)) for terms in (*([one] for one in TURNED), TURNED)),
    ],
    ids=str,
)
def test_eigenvalues_are_those_of_power_series(u, pipe):
    found = pp.eigenvalues(pp.Continuum(pipe), u, 6)
    for value in found[found.imag >= 0.0]:
        assert abs(series_newton_step(pipe, value, u)) < 1e-9 * abs(value)


@pytest.mark.parametrize(
    "pipe",
    [
        pp.Pipe(0.3, gamma=25.0),
        pp.Pipe(0.6, gamma=-12.0, damping=5e-4),
        pp.Pipe(0.1, gamma=8.0, flow="aspirating", alpha=1.4, damping=1e-3),
    ],
    ids=["hanging", "standing", "aspirating"],
)
@pytest.mark.parametrize("u", [0.5, 5.0, 9.0])
def test_eigenvalues_meet_collocation_of_the_strong_form(pipe, u):
    found = pp.eigenvalues(pp.Continuum(pipe), u, 12)
    reference = collocation_eigenvalues(pipe, u, size=48)
    assert distances(found, reference).max() < 1e-8
    assert distances(reference[:12], found).max() < 1e-8


def test_published_four_mode_eigenvalues_come_back_and_their_converged_values():
    """Stored output of a MATLAB package: 4 beam modes, delta = 0.001."""
    pipe = pp.Pipe(0.2, damping=0.001)
    for u, four, half_digit, full in (
        (5.2, -1.0556 + 14.0064j, 5e-5, -1.0423 + 14.0263j),
        (6.0, 0.7631 + 13.53j, 5e-3, 0.7928 + 13.5575j),
    ):
        rom = pp.eigenvalues(pp.Galerkin(pipe, 4), u)
        exact = pp.eigenvalues(pp.Continuum(pipe), u, 8)
        for found, printed, last in ((rom, four, half_digit), (exact, full, 5e-5)):
            value = found[np.argmin(np.abs(found - printed))]
            assert value.real == pytest.approx(printed.real, rel=0, abs=5.1e-5)
            assert value.imag == pytest.approx(printed.imag, rel=0, abs=1.02 * last)


# ---------------------------------------------------------------------------------- size


def test_the_benchmark_reports_the_size_it_needed_and_that_it_converged():
    modes = pp.modes(pp.Continuum(pp.Pipe(0.2)), 6.0, 2)
    assert modes.discretisation is not None
    assert modes.discretisation < 1e-10
    far = pp.modes(pp.Continuum(pp.Pipe(0.2)), 6.0, 30)
    assert far.size > modes.size >= 16
    assert far.converged.all()


def test_a_frozen_benchmark_is_the_reduced_model_of_that_size():
    frozen = pp.Continuum(pp.Pipe(0.2)).frozen(24)
    assert isinstance(frozen, pp.Galerkin)
    assert (frozen.dof, frozen.basis) == (24, "legendre")
    assert pp.critical_speed(frozen).speed == pytest.approx(5.591404377827, rel=1e-11)


def test_a_benchmark_that_does_not_converge_says_so():
    """Eigenvalues of a pipe so heavy that 400 functions do not hold its boundary layer."""
    heavy = pp.Continuum(dataclasses.replace(pp.Pipe(0.2), gamma=1e6))
    with pytest.raises(pp.NotConverged) as caught:
        pp.eigenvalues(heavy, 6000.0, 10)
    assert "400" in str(caught.value)


@pytest.mark.parametrize("pipe", PIPES, ids=str)
def test_crossings_are_those_of_a_search_of_a_basis_twice_as_large(pipe):
    found = pp.crossings(pp.Continuum(pipe), 12.0)
    larger = pp.crossings(pp.Galerkin(pipe, 52, "legendre"), 12.0)
    assert found
    for one, other in zip(found, larger, strict=True):
        assert one.unstable_before == other.unstable_before
        assert one.unstable_after == other.unstable_after
        assert abs(one.speed - other.speed) <= one.error + other.error + 1e-10 * other.speed
        assert one.frequency == pytest.approx(other.frequency, rel=1e-7, abs=1e-9)
        assert one.mode == other.mode


@pytest.mark.parametrize("stiffness", [0.0, 10.0, 300.0])
def test_a_foundation_leaves_becks_load_as_it_is(stiffness):
    """Without mass in the flow it adds its stiffness to every omega^2 (Smith and Herrmann 1972)."""
    pipe = pp.Pipe(0.0, terms=[pp.Foundation(stiffness)])
    found = pp.critical_speed(pp.Continuum(pipe))
    assert found.speed == pytest.approx(4.47782912, abs=6e-9)
    plain = pp.critical_speed(pp.Continuum(pp.Pipe(0.0))).frequency
    assert found.frequency**2 == pytest.approx(plain**2 + stiffness, rel=1e-6)


@pytest.mark.parametrize("count", [8, 20])
@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_roots_below_those_that_damping_clusters_are_answered_where_more_are_asked_for(count):
    """On a hinge at rest omega = x^2 with tan x = tanh x, and each mode is damped by itself."""
    delta = 0.0168
    pipe = pp.Continuum(pp.Pipe(0.085, damping=delta, root="pinned"))
    found = pp.eigenvalues(pipe, 0.0, count)
    ends = (3.5, 4.0), (6.9, 7.2)
    squares = [brentq(lambda x: np.tan(x) - np.tanh(x), *each) ** 4 for each in ends]
    expected = [root for square in squares for root in np.roots([1.0, delta * square, square])]
    assert np.abs(found[:2]).max() < 1e-6  # it turns freely
    np.testing.assert_allclose(np.sort_complex(found[2:]), np.sort_complex(expected), rtol=1e-8)
    with pytest.raises(pp.NotConverged, match="accumulate"):
        pp.modes(pp.Continuum(pp.Pipe(0.085, damping=10.0)), 0.0, 2)
