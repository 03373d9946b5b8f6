# SPDX-License-Identifier: MIT
"""Crossings where plain eigenvalues do not serve: free joints, meetings at zero, weak forces."""

import itertools
from functools import cache

import mpmath
import numpy as np
import pytest
from independent import chain_crossing, clamp_misfit, series_crossing, unstable_count
from scipy.optimize import brentq

import pipedyn as pp

FREE = [
    *([0], [1, 0], [1, 0, 1], [5, 5, 0], [0, 0, 1], [2, 0, 0], [0, 0, 0]),
    *([3, 0, 2, 0], [0, 0.9, 0, 6.4]),  # several free joints: three roots may pass zero as one
]
FLOWS = [
    {"beta": 0.5},
    {"beta": 0.0},
    {"beta": 0.0, "damping": 0.01},
    {"beta": 0.3, "flow": "aspirating", "alpha": 0.0, "damping": 0.1},
    {"beta": 0.3, "flow": "aspirating", "alpha": 0.5},
]


@pytest.mark.parametrize("flow", FLOWS, ids=str)
@pytest.mark.parametrize("springs", FREE, ids=str)
def test_crossings_of_a_chain_with_a_free_joint_account_for_every_unstable_root(springs, flow):
    chain = pp.Chain(pp.Pipe(**flow), springs=np.array(springs, dtype=float))
    found = pp.crossings(chain, 6.0)
    ends = np.unique([0.0, *(crossing.speed for crossing in found), 6.0])
    for low, high in itertools.pairwise(ends):
        u = 0.5 * (low + high)
        passed = [crossing.unstable_after for crossing in found if crossing.speed < u]
        # Rounding moves a triple zero by up to 1e-5.
        assert unstable_count(chain, u, 1e-4) == (passed[-1] if passed else 0)


@pytest.mark.parametrize("springs", [[1, 0, 2], [0, 3, 0, 1], 5 * [40.0] + [0.0] + 3000 * [5e3]])
def test_roots_that_a_free_joint_keeps_at_zero_are_zero_exactly(springs):
    springs = np.array(springs, dtype=float)
    free = np.count_nonzero(springs == 0.0)
    still = {"beta": 0.3, "flow": "aspirating", "alpha": 0.0}
    for flow, u, due in (
        ({"beta": 0.3}, 0.0, 2 * free),  # without forces lambda^2 M is all that moves a joint
        ({"beta": 0.3}, 1.0, 1),
        ({"beta": 0.0}, 1.0, 2),
        (still, 1.0, free),  # no thrust: each free joint has its own
    ):
        found = pp.eigenvalues(pp.Chain(pp.Pipe(**flow), springs=springs), u, 6)
        assert np.count_nonzero(found == 0.0) == due
        assert (np.abs(found[due:]) > 1e-3).all()


def test_a_chain_diverges_at_its_free_joint_where_the_flow_no_longer_damps_it():
    # Two segments, the second hinged freely: K(u) x = 0 for x = (u^2 / 2, k), in the joint angles,
    # and K^T y = 0 for y = (0, 1), so that y^T (G + F) x = 0 at u^2 = 2 k by hand.
    for spring in (1.0, 3.0):
        first = next(
            crossing
            for crossing in pp.crossings(pp.Chain(pp.Pipe(0.3), springs=[spring, 0.0]), 4.0)
            if crossing.kind == "divergence"
        )
        assert first.speed == pytest.approx(np.sqrt(2.0 * spring), rel=1e-13)
        assert first.error < 1e-12
        assert first.sensitivity is None  # gravity parts the two zeros: no derivative


def test_a_long_chain_with_a_free_joint_has_the_crossings_of_its_equations():
    """By shooting in mpmath, where a spring of 1e-14 stands for none."""
    springs = np.full(66, 66.0)
    springs[33] = 0.0
    flutter, divergence = pp.crossings(pp.Chain(pp.Pipe(0.2), springs=springs), 6.0)
    almost = pp.Chain(pp.Pipe(0.2), springs=np.maximum(springs, 1e-14))
    speed, frequency = chain_crossing(almost, flutter.speed, flutter.frequency)
    assert (flutter.kind, divergence.kind) == ("flutter", "divergence")
    assert flutter.speed == pytest.approx(float(speed), rel=1e-11)
    assert flutter.frequency == pytest.approx(float(frequency), rel=1e-10)

    def slope(u):  # where it vanishes, a second root comes to the one that stays at zero
        return mpmath.diff(lambda value: clamp_misfit(almost, value, u), 0).real

    with mpmath.workdps(40):
        assert divergence.speed == pytest.approx(float(mpmath.findroot(slope, 3.0)), rel=1e-11)


def test_sensitivity_of_a_flutter_beside_a_standing_zero_meets_differences():
    springs = np.array([4.0, 0.0, 5.0])

    def flutter(beta, first):
        chain = pp.Chain(pp.Pipe(beta), springs=[first, *springs[1:]])
        return next(c for c in pp.crossings(chain, 4.0) if c.kind == "flutter")

    by = flutter(0.1, 4.0).sensitivity.speed
    h = 1e-4
    assert by.beta == pytest.approx(
        (flutter(0.1 + h, 4.0).speed - flutter(0.1 - h, 4.0).speed) / (2 * h), rel=1e-5
    )
    assert by.springs[0] == pytest.approx(
        (flutter(0.1, 4.0 + h).speed - flutter(0.1, 4.0 - h).speed) / (2 * h), rel=1e-6
    )


@pytest.mark.parametrize(("beta", "gamma"), [(0.01, -51.9), (1e-6, -50.0)])
def test_a_divergence_beside_a_meeting_is_known_to_rounding(beta, gamma):
    def divergence(gamma):
        found = pp.crossings(pp.Continuum(pp.Pipe(beta, gamma)), 3.0)
        return next(crossing for crossing in found if crossing.kind == "divergence")

    found = divergence(gamma)
    assert found.error < 1e-10 * found.speed
    exact, _ = series_crossing(pp.Pipe(beta, gamma), found.speed, 0.0)
    assert found.speed == pytest.approx(exact, abs=1e-10)
    h = 1e-3
    slope = (divergence(gamma + h).speed - divergence(gamma - h).speed) / (2 * h)
    assert found.sensitivity.speed.gamma == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("beta", [1e-9, 4.1e-10, 3.9e-10, 1e-20, 5e-324])
def test_the_critical_speed_tends_to_4_190241_as_fluid_mass_vanishes(beta):
    found = pp.critical_speed(pp.Continuum(pp.Pipe(beta)))
    assert found.speed == pytest.approx(4.190241 + 4.68 * beta, abs=5e-7)
    assert found.frequency == pytest.approx(14.63273, abs=5e-6)
    assert found.error < 2e-9
    # One limit, whichever way it is computed: see the slope in the sensitivity.
    assert abs(found.speed - 4.6766 * beta - 4.19024096460) < found.error


def first_order_onset(ops, low, high):
    """Where a little damping turns a frequency of Beck's column unstable, to first order.

    Re lambda = -delta y^T D x / (2 y^T M x), from plain numpy eigenvectors at delta = 0.
    """

    def growth(u):
        mass, damping, stiffness = ops.at(u)
        squares, right = np.linalg.eig(np.linalg.solve(mass, stiffness))
        back, left = np.linalg.eig(np.linalg.solve(mass, stiffness.T))
        x = right[:, np.argmin(squares.real)].real
        y = left[:, np.argmin(back.real)].real
        return float((y @ damping @ x) / (y @ mass @ x))

    return brentq(growth, low, high, xtol=1e-13)


@pytest.mark.parametrize("delta", [2.1e-5, 1.9e-5, 1e-8, 1e-12, 1e-300])
def test_the_weakest_damping_destabilises_becks_column_at_a_limit(delta):
    model = pp.Galerkin(pp.Pipe(0.0, damping=delta), 10, "legendre")
    found = pp.critical_speed(model)
    unit = pp.Galerkin(pp.Pipe(0.0, damping=1.0), 10, "legendre").operators()
    limit = first_order_onset(unit, 2.5, 4.0)
    assert found.speed == pytest.approx(limit + 41.2 * delta**2, abs=1e-9)
    assert found.sensitivity.speed.damping == pytest.approx(82.4 * delta, rel=0.2)
    assert abs(found.speed - limit - 41.2 * delta**2) < found.error < 1e-6
    assert found.mode == 1


def test_all_crossings_of_the_lightest_fluid_have_a_limit():
    light = pp.crossings(pp.Continuum(pp.Pipe(1e-20)), 15.0)
    small = pp.crossings(pp.Continuum(pp.Pipe(1e-8)), 15.0)
    assert len(light) == len(small) == 2
    for a, b in zip(light, small, strict=True):
        assert a.kind == b.kind == "flutter"
        assert a.speed == pytest.approx(b.speed, rel=1e-7)


@pytest.mark.parametrize(
    "pipe",
    [
        pp.Pipe(0.0, flow="aspirating", alpha=0.0, damping=1e-3),
        pp.Pipe(0.0, gamma=-20.0, flow="aspirating", alpha=0.0),
    ],
    ids=["damped", "buckled"],
)
@pytest.mark.parametrize(
    "make", [pp.Continuum, lambda pipe: pp.Chain(pipe, 200)], ids=["Continuum", "Chain"]
)
def test_a_flow_that_acts_on_nothing_moves_nothing(pipe, make):
    assert not pp.crossings(make(pipe), 500.0)
    with pytest.raises(pp.NoCrossing, match="100"):
        pp.critical_speed(make(pipe))


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_pipe_with_very_strong_damping_flutters_late():
    # Every mode overdamped; rounding, not the basis, limits the speed, and the error says so. It
    # is an estimate of rounding: the order of a sum moves it by a factor of four.
    found = pp.critical_speed(pp.Continuum(pp.Pipe(0.0, damping=10.0)))
    finer = pp.crossings(pp.Galerkin(pp.Pipe(0.0, damping=10.0), 50, "legendre"), 42.0)
    assert found.speed == pytest.approx(finer[0].speed, abs=found.error)
    assert found.error < 1e-4 * found.speed


@pytest.mark.parametrize(
    ("chain", "max_speed", "due"),
    [
        (
            pp.Chain(
                pp.Pipe(0.2, -5.0, damping=1.0),
                lengths=[
                    *(0.18335150926617733, 0.2098036945910874, 0.11030613696111356),
                    *(0.15551986978196283, 0.1655111893993469, 0.11682359608997496),
                    0.05868400391033702,
                ],
                springs=[
                    *(26.27373438681658, 3.5514918545348224, 2.8987564614004544),
                    *(2.026217195731345, 5.963920508909944, 2.1943480913041142),
                    6.059936062896461,
                ],
            ),
            12.0,
            2,
        ),
        (
            pp.Chain(
                pp.Pipe(0.332412239275, -6.25933663554, damping=1.0),
                lengths=[0.18369, 0.13615, 0.27816, 0.05949, 0.09151, 0.251],
                springs=[5.81727, 0.0, 4.84922, 7.3024377, 0.0, 2.20481],
            ),
            9.0,
            3,
        ),
    ],
    ids=["springs everywhere", "two free joints"],
)
def test_every_divergence_is_a_zero_of_the_determinant_and_none_is_listed_twice(
    chain, max_speed, due
):
    speeds = np.linspace(0.0, max_speed, 20001)
    ops = chain.operators()
    signs = np.sign(np.linalg.det(np.stack([ops.at(u)[2] for u in speeds])))
    zeros = speeds[:-1][signs[1:] != signs[:-1]]
    assert len(zeros) >= due
    found = [c.speed for c in pp.crossings(chain, max_speed) if c.kind == "divergence"]
    assert found == pytest.approx(zeros, abs=1.01 * max_speed / 20000)


@cache
def divergences(gamma, damping):
    found = pp.crossings(pp.Continuum(pp.Pipe(0.2, gamma, damping=damping)), 4.0)
    return [c.speed for c in found if c.kind == "divergence"]


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
@pytest.mark.parametrize("gamma", [-8.5, -7.9, -50.0])
@pytest.mark.parametrize("damping", [1.0, 100.0, 1e4])
def test_damping_does_not_move_a_divergence_however_slow_it_makes_it(gamma, damping):
    found = divergences(gamma, damping)
    assert found == pytest.approx(divergences(gamma, 0.0), rel=1e-10)
    assert len(found) >= 1


def test_coupled_flutter_of_a_long_held_chain_is_as_accurate_as_it_says():
    """The speed at which two roots meet on the axis, by 30 digits of the model's matrices."""
    pipe = pp.Pipe(0.441912, -1.15448, root=pp.RootSpring(214.482), end="pinned")
    found = pp.crossings(pp.Chain(pipe, 77, springs="uniform"), 10.3267)[2]
    assert found.speed == pytest.approx(7.62866547310930, rel=1e-13)
    assert found.frequency == pytest.approx(8.37020144334, rel=1e-9)
