# SPDX-License-Identifier: MIT
"""The onset of flutter beyond linear theory: Lyapunov coefficients, laws, and refusals."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn.equilibrium.hopf import normal_form

PIPE = pp.Pipe(0.2)
ASPIRATING = pp.Pipe(0.2, flow="aspirating", damping=0.01)


@cache
def onset_of(beta, kind, size):
    """Without gravity, damping and drag."""
    pipe = pp.Pipe(beta)
    return pp.hopf(pp.Galerkin(pipe, size, kind) if kind else pp.Chain(pipe, size))


def largest(q):
    return np.abs(q).max()


# ----------------------------------------------------------------------- systems with a known l_1


def quadratic(omega, a, b):
    """x' = -omega y + f, y' = omega x + g with quadratic and cubic terms, and its l_1.

    Guckenheimer and Holmes (1983), eq. (3.4.11): 16 times what they call a.
    """
    (fxx, fxy, fyy), (gxx, gxy, gyy) = a
    (fxxx, fxyy), (gxxy, gyyy) = b

    def jacobian(z):
        x, y = z
        return np.array(
            [
                [
                    fxx * x + fxy * y + 0.5 * fxxx * x**2 + 0.5 * fxyy * y**2,
                    -omega + fxy * x + fyy * y + fxyy * x * y,
                ],
                [
                    omega + gxx * x + gxy * y + gxxy * x * y,
                    gxy * x + gyy * y + 0.5 * gxxy * x**2 + 0.5 * gyyy * y**2,
                ],
            ]
        )

    cubic = (fxxx + fxyy + gxxy + gyyy) / 16.0
    squares = fxy * (fxx + fyy) - gxy * (gxx + gyy) - fxx * gxx + fyy * gyy
    return jacobian, cubic + squares / (16.0 * omega)


def of_each(jacobian):
    """Of the states in the columns, from that of one."""
    return lambda y: np.array([jacobian(column) for column in y.T])


@pytest.mark.parametrize("omega", [0.7, 3.0])
@pytest.mark.parametrize(
    ("a", "b"),
    [
        (((0, 0, 0), (0, 0, 0)), ((-6.0, -2.0), (-2.0, -6.0))),  # the normal form itself
        (((1.0, 0.4, -0.3), (0.2, -0.7, 0.5)), ((0, 0), (0, 0))),
        (((0.3, 1.1, 0.9), (-0.6, 0.8, 0.1)), ((0.5, -0.2), (0.7, 1.3))),
    ],
)
def test_the_projection_formula_meets_the_planar_one(omega, a, b):
    jacobian, expected = quadratic(omega, a, b)
    form = normal_form(of_each(jacobian), np.zeros(2), omega, lambda q: q[0], largest)
    # r' = a r^3 with x = r cos = 2 |z| cos: Re c_1 = 4 a.
    assert form.cubic.real == pytest.approx(4.0 * expected, rel=1e-9)
    assert form.lyapunov == pytest.approx(4.0 * expected / omega, rel=1e-9)
    assert form.error < 1e-8 * abs(form.cubic)


def test_quadratic_terms_act_through_slaved_modes():
    # z' = i omega z - w z, w' = -k w + |z|^2: w = |z|^2 / k at rest, so c_1 = -1 / k.
    omega, k = 2.0, 5.0
    shift = np.array([0.3, -0.2, 0.7])  # the rest need not be 0

    def jacobian(y):
        x, v, w = y - shift
        return np.array([[-w, -omega, -x], [omega, -w, -v], [2 * x, 2 * v, -k]])

    form = normal_form(of_each(jacobian), shift, omega, lambda q: 0.5 * q[0], largest)
    # Scaled to q = (2, ...): x = 2 Re(z q) is four times what it would be; c_1 goes with |q|^2.
    half = normal_form(of_each(jacobian), shift, omega, lambda q: q[0], largest)
    assert form.cubic == pytest.approx(4.0 * half.cubic, rel=1e-9)
    # x + i v = 2 z here: w' = -k w + 4 |z|^2.
    assert half.cubic == pytest.approx(-4.0 / k, rel=1e-9)


def test_a_force_without_a_third_derivative_is_not_taken_for_a_smooth_one():
    def jacobian(y):
        return np.array([[0.0, 1.0], [-4.0, -2.0 * abs(y[1])]])

    with pytest.raises(pp.NotConverged, match="do not converge"):
        normal_form(of_each(jacobian), np.zeros(2), 2.0, lambda q: q[0], largest)


def test_a_bad_friction_is_refused_for_what_it_is():
    """And not as an onset at which no simple pair lies on the axis."""
    with pytest.raises(ValueError, match="friction must lie in"):
        pp.hopf(pp.Chain(pp.Pipe(0.2), 3), friction=math.nan)


def test_two_pairs_at_one_place_are_refused():
    block = np.array([[0.0, -1.0], [1.0, 0.0]])
    twice = np.block([[block, np.eye(2)], [np.zeros((2, 2)), block]])
    with pytest.raises(pp.NoHopf, match="two pairs"):
        normal_form(of_each(lambda y: twice), np.zeros(4), 1.0, lambda q: q[0], largest)


def test_a_free_end_that_does_not_move_measures_nothing():
    turning = np.array([[0.0, -1.0], [1.0, 0.0]])
    with pytest.raises(pp.NoHopf, match="does not move"):
        normal_form(of_each(lambda y: turning), np.zeros(2), 1.0, lambda q: 0.0, largest)


# ------------------------------------------------------------------------------------- the pipe


def test_the_continuous_pipe_has_the_known_coefficient():
    # -3.20501 and 0.20520 by other routes too (l_1 to some 3e-5: differences and chains).
    found = onset_of(0.2, "legendre", 12)
    assert found.speed == pytest.approx(5.591404378, abs=1e-8)
    assert found.frequency == pytest.approx(13.71469980, abs=1e-7)
    assert found.lyapunov == pytest.approx(-3.20501, rel=5e-5)
    assert found.amplitude_law == pytest.approx(0.20520, rel=6e-5)
    assert found.lyapunov_error < 1e-5
    assert (found.criticality, found.exponent) == ("supercritical", 0.5)
    assert found.amplitude_law == pytest.approx(
        -4.0 * found.growth / (found.frequency * found.lyapunov), rel=1e-12
    )
    assert found.amplitude(6.0) == pytest.approx(0.2895, abs=1e-3)
    with pytest.raises(ValueError, match="u must be above the onset"):
        found.amplitude(5.0)


def test_beam_modes_tend_to_the_coefficient():
    exact = onset_of(0.2, "legendre", 12).lyapunov
    beams = [abs(pp.hopf(pp.Galerkin(PIPE, m)).lyapunov - exact) for m in (4, 8, 16)]
    assert beams[0] > 5 * beams[1] > 25 * beams[2]
    assert beams[2] < 1e-4


def test_growth_is_the_slope_of_the_real_part():
    for model in (pp.Chain(ASPIRATING, 6), pp.Galerkin(pp.Pipe(0.3, gamma=5.0, damping=1e-3), 6)):
        found = pp.hopf(model)
        h = 1e-3 * found.speed

        def real_part(u, model=model, near=found.frequency):
            values = pp.eigenvalues(model, u)
            return values[np.argmin(np.abs(values - 1j * near))].real

        slope = (real_part(found.speed + h) - real_part(found.speed - h)) / (2 * h)
        assert found.growth == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize(
    ("model", "side"),
    [
        (pp.Galerkin(PIPE, 8, "legendre"), 1),
        (pp.Galerkin(PIPE, 5), 1),
        (pp.Chain(PIPE, 8), 1),
        (pp.Chain(pp.Pipe(0.3, gamma=10.0, damping=2e-3), 5), 1),
        (pp.Chain(ASPIRATING, 6), 1),
        (pp.Galerkin(ASPIRATING, 6, "legendre"), 1),
        (pp.Chain(pp.Pipe(0.7), 3), -1),
        (pp.Chain(pp.Pipe(0.3, damping=2e-3, terms=[pp.AddedMass(0.5)]), 4), 1),
        (pp.Chain(pp.Pipe(0.2, terms=[pp.CubicSpring(0.8, 1e3)]), 4), 1),
        (pp.Galerkin(pp.Pipe(0.2, damping=2e-3, supports=[0.25]), 6, "legendre"), 1),
        (pp.modular.chain(PIPE, n=3).plus(pp.Spring(at=1.0, stiffness=3.0)), 1),
        (pp.modular.chain(PIPE, n=4).plus(pp.modular.Guide(node=1)), 1),
    ],
    ids=repr,
)
def test_the_law_is_that_of_the_cycles_just_past_onset(model, side):
    onset = pp.hopf(model)
    assert onset.criticality == ("supercritical" if side > 0 else "subcritical")
    distances = side * min(1.0, onset.speed) * np.array([1e-4, 5e-5])
    far = pp.limit_cycle(model, onset.speed + distances[0], rtol=1e-7)
    cycles = [far, pp.limit_cycle(model, onset.speed + distances[1], far, rtol=1e-7)]
    ratios = np.array([c.amplitude**2 for c in cycles]) / distances
    turned = np.array([c.frequency - onset.frequency for c in cycles]) / distances
    # What is left goes with the distance: halved, it vanishes.
    assert 2 * ratios[1] - ratios[0] == pytest.approx(onset.amplitude_law, rel=3e-4)
    assert ratios[1] == pytest.approx(onset.amplitude_law, rel=2e-2)
    assert 2 * turned[1] - turned[0] == pytest.approx(onset.frequency_law, rel=1e-3, abs=1e-3)
    assert all(c.stable == (side > 0) for c in cycles)


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(pp.Pipe(0.2, drag=1.0), 6),
        pp.Galerkin(pp.Pipe(0.2, drag=0.5), 6, "legendre"),
        pp.Chain(pp.Pipe(0.2, flow="aspirating", damping=0.01, drag=2.0), 4),
        pp.modular.chain(pp.Pipe(0.2, drag=1.0), n=2),
    ],
    ids=repr,
)
def test_with_drag_the_amplitude_itself_grows_with_the_speed(model):
    onset = pp.hopf(model)
    assert onset.exponent == 1.0
    assert onset.criticality == "supercritical"
    assert onset.amplitude_error < 2e-4 * onset.amplitude_law
    distances = min(1.0, onset.speed) * np.array([2e-3, 1e-3])
    cycles = [pp.limit_cycle(model, onset.speed + d, rtol=1e-5) for d in distances]
    ratios = np.array([c.amplitude for c in cycles]) / distances
    turned = np.array([c.frequency - onset.frequency for c in cycles]) / distances
    assert 2 * ratios[1] - ratios[0] == pytest.approx(onset.amplitude_law, rel=1e-3)
    assert 2 * turned[1] - turned[0] == pytest.approx(onset.frequency_law, rel=5e-3)


@pytest.mark.parametrize(
    ("n", "beta", "drag", "distance"),
    [
        (3, 0.2, 1e-6, 1e-4),  # both take amplitude away
        (3, 0.2, 1e-2, 1e-4),
        (3, 0.2, 1.0, 1e-2),
        (3, 0.7, 1e-6, -1e-4),  # both feed it
        (3, 0.7, 1e-2, -1e-4),
        (3, 0.7, 1.0, -1e-4),
        (4, 0.8, 1e-3, -1e-4),
        (2, 0.05, 1e-6, -1e-4),  # drag takes away, the cubic terms feed
        (2, 0.05, 1e-2, -1e-5),
        (2, 0.05, 0.1, 1e-5),
    ],
)
def test_drag_and_cubic_terms_together_give_the_amplitude(n, beta, drag, distance):
    model = pp.Chain(pp.Pipe(beta, drag=drag), n)
    onset = pp.hopf(model)
    u = onset.speed + distance
    cycle = pp.limit_cycle(model, u, rtol=1e-5)
    assert onset.amplitude(u) < 0.02
    assert onset.amplitude(u) == pytest.approx(cycle.amplitude, rel=6e-3)
    assert onset.cycle_frequency(u) - onset.frequency == pytest.approx(
        cycle.frequency - onset.frequency, rel=2e-2
    )


def test_the_mean_of_drag_is_proportional_to_it_and_known_to_eight_digits():
    weak, strong = (pp.hopf(pp.Chain(pp.Pipe(0.3, 12.0, drag=d), 3)) for d in (0.01, 1.0))
    assert strong.quadratic == pytest.approx(100.0 * weak.quadratic, rel=1e-12)
    for onset in (weak, strong):
        assert onset.amplitude_error < 1e-8 * abs(onset.amplitude_law)


def test_weak_drag_decides_at_small_amplitudes_only():
    plain = pp.hopf(pp.Chain(PIPE, 3))
    assert plain.balance == 0.0
    for drag in (1e-12, 1e-6, 1e-3):
        weak = pp.hopf(pp.Chain(pp.Pipe(0.2, drag=drag), 3))
        assert weak.lyapunov == pytest.approx(plain.lyapunov, rel=1e-9)
        assert weak.balance == pytest.approx(0.2631 * drag, rel=1e-3)
    nothing = pp.hopf(pp.Chain(pp.Pipe(0.2, drag=3e-311), 3))
    assert nothing.amplitude_law == pytest.approx(plain.amplitude_law, rel=1e-12)
    assert nothing.exponent == 0.5
    # Far below the balance the law with drag holds, far above it the one without.
    near, far = weak.speed + 1e-9, weak.speed + 1e-2
    assert weak.amplitude(near) == pytest.approx(weak.amplitude_law * 1e-9, rel=1e-2)
    assert weak.amplitude(far) == pytest.approx(plain.amplitude(far), rel=1e-2)


def test_drag_may_drive_flutter():
    # As damping does in follower-force systems: it bends the mode, and the flow feeds it more.
    drive, resist = (pp.hopf(pp.Chain(pp.Pipe(beta, drag=1e-2), 3)) for beta in (0.7, 0.2))
    assert resist.quadratic.real < 0.0 < drive.quadratic.real
    assert (resist.criticality, drive.criticality) == ("supercritical", "subcritical")
    # Less of a kick is survived with drag than without.
    u = drive.speed - 1e-4
    plain = pp.limit_cycle(pp.Chain(pp.Pipe(0.7), 3), u)
    dragged = pp.limit_cycle(drive.model, u)
    assert not dragged.stable
    assert dragged.amplitude < 0.9 * plain.amplitude


def test_drag_holds_a_subcritical_pipe_up_to_a_fold():
    model = pp.Chain(pp.Pipe(0.05, drag=0.1), 2)
    onset = pp.hopf(model)
    beyond = onset.fold - onset.speed
    assert onset.criticality == "supercritical"
    assert onset.cubic.real > 0.0
    assert beyond == pytest.approx(1.23e-4, rel=1e-2)
    assert onset.amplitude(onset.fold) == pytest.approx(0.5 * onset.balance)
    held = pp.limit_cycle(model, onset.speed + 0.9 * beyond)
    gone = pp.limit_cycle(model, onset.speed + 1.1 * beyond)
    assert held.stable
    assert held.amplitude < 0.5 * onset.balance
    assert gone.amplitude > 10.0 * held.amplitude
    with pytest.raises(ValueError, match=r"u must be below the fold at 3\.1339978"):
        onset.amplitude(onset.speed + 1.1 * beyond)
    # Without drag it is subcritical.
    assert pp.hopf(pp.Chain(pp.Pipe(0.05), 2)).fold is None


@pytest.mark.parametrize("growth", [2.0, -2.0])
@pytest.mark.parametrize("quadratic", [0.0, 1e-3, 0.3, -0.3])
@pytest.mark.parametrize("cubic", [0.7, -0.7])
def test_amplitudes_solve_the_amplitude_equation(growth, quadratic, cubic):
    onset = replace(
        onset_of(0.2, "", 2), growth=growth, quadratic=complex(quadratic), cubic=cubic + 1j
    )
    found = 0
    for u in onset.speed + np.array([-1.0, -1e-2, -1e-5, 1e-5, 1e-2, 1.0]):
        try:
            size = onset.amplitude(u)
        except ValueError:
            continue
        found += 1
        terms = np.array([growth * (u - onset.speed), quadratic * size, cubic * size**2])
        assert size > 0.0
        assert abs(terms.sum()) <= 1e-12 * np.abs(terms).max()
    assert found >= 3
    assert onset.amplitude(onset.speed) == 0.0
    if onset.fold is not None:
        h = 1e-5 * abs(onset.fold - onset.speed)
        side = np.sign(onset.fold - onset.speed)
        assert onset.amplitude(onset.fold - side * h) == pytest.approx(
            0.5 * onset.balance, rel=1e-2
        )
        with pytest.raises(ValueError, match="the fold at"):
            onset.amplitude(onset.fold + side * h)


def test_the_law_of_higher_modes_does_not_depend_on_the_functions():
    # Beam functions count their higher modes' angles in tens of their coordinates.
    pipe = pp.Pipe(0.41, gamma=31.0, flow="aspirating", alpha=0.79, damping=1e-2)
    exact = pp.Galerkin(pipe, 14, "legendre")
    for model, tolerance in (
        (pp.Galerkin(pipe, 14), 2e-2),
        (pp.Galerkin(pipe, 12, "legendre"), 1e-6),
    ):
        # At the first, of a speed near 0, hardly anything but linear terms is felt.
        pairs = zip(pp.crossings(exact, 6.0)[1:], pp.crossings(model, 6.0)[1:], strict=True)
        for a, b in pairs:
            one, other = pp.hopf(exact, a), pp.hopf(model, b)
            assert one.lyapunov_error < 1e-6 * abs(one.lyapunov)
            assert other.lyapunov == pytest.approx(one.lyapunov, rel=tolerance)


@pytest.mark.parametrize(
    ("model", "last"),
    [
        (pp.Chain(pp.Pipe(0.8, flow="aspirating", alpha=0.5, damping=0.02), 3), 10.0),
        (pp.Galerkin(pp.Pipe(0.4, flow="aspirating", damping=0.02), 4, "legendre"), 15.0),
        (pp.modular.chain(pp.Pipe(0.3, flow="aspirating", damping=0.02), n=3), 10.0),
    ],
    ids=repr,
)
def test_cycles_follow_the_law_at_onsets_beside_other_unstable_modes(model, last):
    found = [c for c in pp.crossings(model, last) if c.kind == "flutter" and c.speed > 0.0]
    onsets = [pp.hopf(model, c) for c in found]
    assert [h.growth > 0.0 for h in onsets] == [c.destabilising for c in found]
    assert any(h.other_unstable for h in onsets)
    for onset in onsets:
        speeds = onset.speed + np.array([4e-4, 1e-4]) / onset.amplitude_law
        cycles = [pp.limit_cycle(model, u, onset, rtol=1e-5) for u in speeds]
        ratios = [c.amplitude / onset.amplitude(u) for c, u in zip(cycles, speeds, strict=True)]
        assert (4.0 * ratios[1] - ratios[0]) / 3.0 == pytest.approx(1.0, abs=2e-3)
        assert ratios[1] == pytest.approx(1.0, abs=2e-2)
        assert not (onset.other_unstable and any(c.stable for c in cycles))


def test_every_flutter_of_a_pipe_that_turns_stable_again_has_its_law():
    model = pp.Galerkin(pp.Pipe(0.295), 12, "legendre")
    found = [pp.hopf(model, c) for c in pp.crossings(model, 9.0)]
    assert [round(h.speed, 3) for h in found] == [7.261, 7.852, 8.189]
    assert [h.growth > 0 for h in found] == [True, False, True]
    # From the first to the second a cycle appears and vanishes, where rest is unstable.
    assert [h.amplitude_law > 0 for h in found] == [True, False, True]
    for onset, d in zip(found[:2], (1e-3, -1e-3), strict=True):
        cycle = pp.limit_cycle(model, onset.speed + d)
        assert cycle.amplitude == pytest.approx(onset.amplitude(onset.speed + d), rel=0.05)


def test_a_subcritical_onset_gives_the_size_of_a_kick_that_rest_survives():
    model = pp.Chain(pp.Pipe(0.8), 4)
    onset = pp.hopf(model)
    u = onset.speed - 2e-2
    assert onset.criticality == "subcritical"
    assert onset.lyapunov > 0.0 > onset.amplitude_law
    y = 2.0 * (0.5 * onset.amplitude(u) * onset.mode).real  # at maximum of the free end

    def later(share):
        run = solve_ivp(lambda t, y: model.rhs(t, y, u), (0.0, 12.0), share * y, rtol=1e-8)
        return np.abs(model.tips(run.y[:4, -200:])[:, 0]).max()

    assert later(0.7) < 0.7 * onset.amplitude(u)
    assert later(1.3) > 1.3 * onset.amplitude(u)


# ----------------------------------------------------------------------------------- refusals


def test_where_there_is_no_flutter_there_is_no_hopf_point():
    with pytest.raises(pp.NoHopf, match="divergence at u = "):
        pp.hopf(pp.modular.chain(PIPE, n=6).plus(pp.modular.Guide(node=6)))
    with pytest.raises(pp.NoHopf, match="unstable from u = 0 on"):
        pp.hopf(pp.Chain(pp.Pipe(0.2, flow="aspirating"), 4))
    with pytest.raises(pp.NoCrossing):
        pp.hopf(pp.Chain(pp.Pipe(0.0, flow="aspirating", alpha=0.0), 4))
    with pytest.raises(pp.NoHopf, match=r"two pairs|no simple pair"):
        pp.hopf(pp.Chain(pp.Pipe(0.0), 4))  # Beck's column: two frequencies meet
    with pytest.raises(pp.NoCrossing):
        pp.hopf(pp.Chain(PIPE, 1))
    with pytest.raises(pp.NotConverged, match="terms of higher degree decide"):
        # One segment without gravity is a linear oscillator, whatever its angle.
        pp.hopf(pp.Chain(ASPIRATING, 1))


def test_a_coefficient_that_is_lost_in_its_error_is_not_given():
    """At a Bautin point, where it changes sign: `boundary` has its beta."""
    with pytest.raises(pp.NotConverged, match="0 within its error"):
        pp.hopf(pp.Chain(pp.Pipe(0.571992558903), 3))
    near = pp.hopf(pp.Chain(pp.Pipe(0.571993), 3))
    assert near.lyapunov_error < abs(near.lyapunov) < 1e-4


def test_the_coefficients_error_holds_what_rounding_does_to_it():
    """One mass and spring in two parts: the same pipe, other rounding."""
    whole = [pp.PointMass(0.4, 0.3), pp.Spring(0.4, 40.0)]
    parts = [pp.PointMass(0.4, 0.1), pp.PointMass(0.4, 0.2)]
    parts += [pp.Spring(0.4, 15.0), pp.Spring(0.4, 25.0)]
    one, other = (
        pp.hopf(pp.Galerkin(pp.Pipe(0.5, gamma=2.0, terms=terms), 5, "legendre"))
        for terms in (whole, parts)
    )
    assert abs(one.lyapunov - other.lyapunov) < min(one.lyapunov_error, other.lyapunov_error)
    assert one.lyapunov_error < 1e-8


def test_a_pipe_held_at_both_ends_flutters_where_two_pairs_meet():
    """Rounding puts the pairs on either side of the crossing that the model itself has found."""
    pipe = pp.Pipe(0.75, 9.3, root="pinned", end="pinned")
    model = pp.Galerkin(pipe, 6, "legendre")
    flutters = [one for one in pp.crossings(model, 20.0) if one.frequency > 0.0]
    for one in flutters:
        with pytest.raises(pp.NoHopf, match="two pairs meet on the axis"):
            pp.hopf(model, one)
    lowest = min(pp.eigenvalues(model, 1.0).imag, key=lambda w: abs(w - 8.0))
    with pytest.raises(pp.NoHopf, match="the pair touches the axis at u = 1 and does not pass"):
        pp.hopf(model, replace(flutters[0], speed=1.0, frequency=float(lowest)))


def test_a_crossing_that_is_not_the_models_own_is_refused():
    model = pp.Chain(PIPE, 4)
    divergence = pp.crossings(pp.Chain(pp.Pipe(0.2, gamma=-10.0), 4), 4.0)[0]
    other = pp.crossings(pp.Chain(PIPE, 5), 6.0)[0]
    with pytest.raises(ValueError, match="crossing must be a flutter, got a divergence"):
        pp.hopf(model, divergence)
    with pytest.raises(ValueError, match="crossing must be one of the model's"):
        pp.hopf(model, other)
    with pytest.raises(ValueError, match="model must have at most"):
        pp.hopf(pp.Chain(PIPE, 501))
