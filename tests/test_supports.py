# SPDX-License-Identifier: MIT
"""Pipes held at both ends and between: linear questions to reduced and continuous models."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from campaign_elements import elements
from independent import series_newton_step
from scipy.optimize import brentq

import pipedyn as pp

ROOTS = ("clamped", "pinned", pp.RootSpring(0.004), pp.RootSpring(7.0))
ENDS = ("free", "guided", "pinned", "clamped")


def converged(of, sizes=(20, 40, 80)):
    """What tends to a limit with second order, or fourth, from three sizes."""
    values = np.array([of(n) for n in sizes])
    steps = np.diff(values, axis=0)
    assert (np.log2(np.abs(steps[0] / steps[1])) > 1.96).all()
    once = values[1:] + steps / 3.0
    return once[1] + (once[1] - once[0]) / 15.0


def test_divergence_of_pipes_held_at_both_ends_is_eulers_at_any_mass_ratio():
    """pinned-pinned sin u = 0, clamped-pinned tan u = u, clamped-clamped sin(u/2) or tan(u/2) = u/2

    by Paidoussis, Fluid-Structure Interactions, vol. 1, sec. 3.4. Chains tend to these speeds.
    """
    between = (4, 4.6), (7, 7.8), (10, 11)
    tangent = [brentq(lambda u: math.sin(u) - u * math.cos(u), *ends) for ends in between]
    closed = {
        ("pinned", "pinned"): (math.pi, 2 * math.pi, 3 * math.pi),
        ("clamped", "pinned"): tangent,
        ("pinned", "clamped"): tangent,
        ("clamped", "clamped"): (2 * math.pi, 2 * tangent[0], 4 * math.pi),
        ("clamped", "guided"): (math.pi, 2 * math.pi, 3 * math.pi),
        ("pinned", "guided"): (math.pi / 2, 1.5 * math.pi, 2.5 * math.pi),
    }
    for beta, ((root, end), speeds) in zip(itertools.cycle((0.1, 0.6)), closed.items()):
        model = pp.Galerkin(pp.Pipe(beta, root=root, end=end), 20, "legendre")
        found = pp.crossings(model, speeds[-1] + 0.01)
        still = [one.speed for one in found if one.kind == "divergence"]
        assert still == pytest.approx(speeds, rel=1e-10)
        if (root, end) != ("pinned", "clamped"):
            pipe = pp.Pipe(0.0, root=root, end=end)
            found = converged(
                lambda n, p=pipe, u=speeds[-1]: pp.crossings(pp.Chain(p, n), 1.02 * u).speeds,
                (30, 60, 120),
            )
            assert found == pytest.approx(speeds, rel=2e-8)
    lowest = pp.critical_speed(pp.Continuum(pp.Pipe(0.6, end="pinned")))
    assert lowest.speed == pytest.approx(tangent[0], rel=1e-12)


@pytest.mark.parametrize(
    ("root", "end", "beta", "speed", "frequency"),
    [
        ("pinned", "pinned", 0.5, 6.303883, 6.7116),
        ("clamped", "clamped", 0.3, 9.081050, 13.3895),
        ("clamped", "clamped", 0.5, 9.294579, 17.0723),
        ("clamped", "pinned", 0.5, 7.774398, 9.7617),
    ],
)
def test_coupled_mode_flutter_follows_on_gyroscopic_restabilisation(
    root, end, beta, speed, frequency
):
    """Undamped; digits of an independent program."""
    pipe = pp.Pipe(beta, root=root, end=end)
    *_, lost, back, flutter = pp.crossings(pp.Continuum(pipe), speed + 0.01)
    assert (lost.kind, back.kind, flutter.kind) == ("divergence", "divergence", "flutter")
    assert (lost.unstable_after, back.unstable_after, flutter.unstable_after) == (1, 0, 2)
    assert flutter.speed == pytest.approx(speed, abs=6e-7)
    assert flutter.frequency == pytest.approx(frequency, abs=6e-5)

    def of_chain(n):
        found = pp.crossings(pp.Chain(pipe, n), 1.01 * speed)
        assert [one.kind for one in found] == ["divergence", "divergence", "flutter"]
        assert [one.unstable_after for one in found] == [1, 0, 2]
        return found[-1].speed, found[-1].frequency

    limit = converged(of_chain)
    assert limit[0] == pytest.approx(speed, abs=1e-6)
    assert limit[1] == pytest.approx(frequency, abs=1e-4)


def test_two_diverging_modes_couple_where_little_of_the_mass_flows():
    """No root crosses the axis: two real ones meet and turn complex at the speed printed."""
    model = pp.Continuum(pp.Pipe(0.1, root="pinned", end="pinned"))
    first, second, coupled = pp.crossings(model, 7.0)
    assert (first.kind, second.kind, coupled.kind) == ("divergence", "divergence", "flutter")
    assert coupled.speed == pytest.approx(6.394115, abs=6e-7)
    assert (coupled.frequency, coupled.unstable_before, coupled.unstable_after) == (0.0, 2, 2)
    assert pp.critical_speed(model).speed == pytest.approx(first.speed, rel=1e-14)
    with pytest.raises(pp.NoHopf, match=r"^two growing real eigenvalues become a pair at u = 6.39"):
        pp.hopf(pp.Galerkin(model.pipe, 8, "legendre"), coupled)
    before, after = (pp.eigenvalues(model, 6.394115 + off, 4) for off in (-2e-6, 2e-6))
    assert np.abs(before.imag).max() == 0.0
    assert np.sum(before.real > 0.1) == 2
    assert np.sum(after.imag > 1e-3) == 2
    assert np.sum(after.real > 0.1) == 2
    chains = [pp.crossings(pp.Chain(model.pipe, n), 6.5) for n in (20, 40, 80)]
    assert [[one.unstable_after for one in found] for found in chains] == [[1, 2, 2]] * 3
    speeds = {20 * 2**k: found[-1].speed for k, found in enumerate(chains)}
    assert converged(speeds.get) == pytest.approx(6.394115, abs=1e-6)


@pytest.mark.parametrize(
    ("pipe", "u", "frequencies"),
    [
        (pp.Pipe(0.5, end="clamped"), 4.0, (16.30777486, 56.12714690)),
        (pp.Pipe(0.5, root="pinned", end="pinned"), 2.0, (7.45357311, 37.63213422)),
    ],
)
def test_frequencies_below_divergence_meet_independent_numbers(pipe, u, frequencies):
    found = pp.eigenvalues(pp.Continuum(pipe), u, 4)
    assert found[::2].imag == pytest.approx(frequencies, abs=6e-9)
    assert np.abs(found.real).max() < 1e-12
    found = converged(lambda n: pp.eigenvalues(pp.Chain(pipe, n), u, 4)[::2].imag, (40, 80, 160))
    assert found == pytest.approx(frequencies, rel=2e-8)


@pytest.mark.parametrize(
    ("given", "speed", "frequency"),
    [
        ({"supports": [0.25]}, 6.99934118, 20.70480215),
        ({"supports": [0.5]}, 8.98681892, 0.0),
        ({"supports": [0.75]}, 5.991212, 0.0),
        ({"root": pp.RootSpring(0.5)}, 5.237511, 5.58395),
        ({"root": pp.RootSpring(2.0)}, 5.040909, 8.23630),
        ({"root": pp.RootSpring(100.0)}, 5.538008, 13.44585),
    ],
)
def test_inner_supports_and_root_springs_meet_independent_numbers(given, speed, frequency):
    """Digits of an independent program; a cantilever supported at mid-length is clamped-pinned

    of half the length with a straight rest, tan(u/2) = u/2.
    """
    pipe = pp.Pipe(0.2, **given)
    found = pp.critical_speed(pp.Continuum(pipe))
    assert found.speed == pytest.approx(speed, rel=2e-6)
    assert found.frequency == pytest.approx(frequency, rel=5e-6)
    assert pp.critical_speed(pp.Galerkin(pipe, 12)).speed == pytest.approx(speed, rel=0.02)

    def of_chain(n):
        found = pp.critical_speed(pp.Chain(pipe, n))
        assert (found.kind == "flutter") == (frequency > 0.0)
        return (found.speed, found.frequency) if frequency else found.speed

    limit = np.atleast_1d(converged(of_chain))
    assert limit[0] == pytest.approx(speed, rel=2e-7)
    assert limit[-1] == pytest.approx(frequency or speed, rel=2e-6)


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("root", ROOTS, ids=repr)
def test_roots_of_any_holding_are_those_of_power_series(root, end):
    pipe = pp.Pipe(0.3, root=root, end=end, damping=2e-3)
    for value in pp.eigenvalues(pp.Continuum(pipe), 2.5, 6)[::2]:
        if abs(value) > 1e-3:  # zero is a double root
            assert abs(series_newton_step(pipe, value, 2.5)) < 1e-7 * abs(value)

    pipe = replace(pipe, damping=0.0)

    def of_chain(n):
        values = pp.eigenvalues(pp.Chain(pipe, n), 2.5, 8)
        return values[values.imag > 5.0][1]

    value = converged(of_chain, (40, 80, 160))
    assert abs(series_newton_step(pipe, value, 2.5)) < 1e-6 * abs(value)


@pytest.mark.parametrize(
    "given",
    [
        {"supports": [0.25]},
        {"supports": [0.25, 0.75], "root": "pinned", "gamma": 8.0},
        {"supports": [0.5], "root": pp.RootSpring(3.0), "end": "guided"},
        {"supports": [0.125, 0.5], "root": pp.RootSpring(0.2), "end": "pinned"},
        {"supports": [0.375], "end": "clamped", "gamma": -5.0},
    ],
    ids=repr,
)
def test_roots_on_inner_supports_are_those_of_finite_elements(given):
    pipe, numbers = pp.Pipe(0.3, **given), {"beta": 0.3, **given}
    if isinstance(pipe.root, pp.RootSpring):
        numbers["root"] = pipe.root.stiffness
    expected = elements(numbers, 20.0, 4).roots(3.0).value
    expected = np.array(sorted(expected[expected.imag > 0.0], key=abs)[:3])
    for model, most in ((pp.Continuum(pipe), 1e-9), (pp.Galerkin(pipe, 24), 3e-3)):
        found = pp.eigenvalues(model, 3.0, 6)[::2]
        assert np.abs(found - expected).max() < most * abs(expected[-1])


@pytest.mark.parametrize("supports", [(), (0.4,), (0.3, 0.65)])
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("root", ROOTS, ids=repr)
@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_functions_of_a_reduced_model_are_held_as_the_pipe_is(basis, root, end, supports):
    pipe = pp.Pipe(0.2, root=root, end=end, supports=supports)
    for m in (2, 9):
        model = pp.Galerkin(pipe, m, basis)
        held = [0.0, *supports, *([1.0] if end in ("pinned", "clamped") else [])]
        kept = [0.0] * (root == "clamped") + [1.0] * (end in ("guided", "clamped"))
        values, slopes = (model.functions([0.0, 0.37, 0.8, 1.0], order) for order in (0, 1))
        assert np.abs(model.functions(held)).max() < 1e-13 * np.abs(values).max()
        assert not kept or np.abs(model.functions(kept, 1)).max() < 1e-13 * np.abs(slopes).max()
        step = 1e-4
        around = model.functions([0.37 - step, 0.37 + step])
        assert np.diff(around, axis=0)[0] / (2 * step) == pytest.approx(
            model.functions([0.37], 1)[0], abs=1e-5 * np.abs(slopes).max() * m**3
        )
        stiffness = model.operators().stiffness
        if basis == "beam" and not supports:  # the beam's own modes
            assert model.operators().mass == pytest.approx(np.eye(m), abs=1e-13)
            assert stiffness == pytest.approx(np.diag(np.diag(stiffness)), abs=1e-9)
        else:
            assert np.diag(stiffness)[1:] == pytest.approx(np.ones(m - 1), rel=1e-12)
            assert stiffness == pytest.approx(np.diag(np.diag(stiffness)), abs=1e-12)


def test_beam_modes_of_every_holding_have_frequencies_of_print():
    """Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 8-1: kappa."""
    tables = {
        ("clamped", "free"): (1.87510407, 4.69409113, 7.85475744),
        ("clamped", "guided"): (2.36502037, 5.49780392, 8.63937983),
        ("clamped", "pinned"): (3.92660231, 7.06858275, 10.21017612),
        ("clamped", "clamped"): (4.73004074, 7.85320462, 10.9956079),
        ("pinned", "free"): (0.0, 3.92660231, 7.06858275),
        ("pinned", "guided"): (math.pi / 2, 1.5 * math.pi, 2.5 * math.pi),
        ("pinned", "pinned"): (math.pi, 2 * math.pi, 3 * math.pi),
        ("pinned", "clamped"): (3.92660231, 7.06858275, 10.21017612),
    }
    for (root, end), kappas in tables.items():
        stiffness = pp.Galerkin(pp.Pipe(0.2, root=root, end=end), 3).operators().stiffness
        assert np.abs(np.diag(stiffness)) ** 0.25 == pytest.approx(kappas, rel=1e-8, abs=1e-12)


def test_flow_turned_round_is_the_pipe_turned_round():
    """Ends that do no work: a pinned root and a clamped end, seen from the end."""
    one = pp.Pipe(0.4, root="pinned", end="clamped")
    other = pp.Pipe(0.4, end="pinned", flow="aspirating")
    for speed in (3.0, 5.0):
        found = [pp.eigenvalues(pp.Continuum(pipe), speed, 8) for pipe in (one, other)]
        assert found[0] == pytest.approx(found[1], rel=1e-11)


def test_an_end_held_across_takes_no_energy_and_gives_none():
    for basis, end in itertools.product(("beam", "legendre"), ("pinned", "clamped")):
        pipe = pp.Pipe(0.5, 3.0, root=pp.RootSpring(1.0), end=end, supports=[0.6])
        ops = pp.Galerkin(pipe, 7, basis).operators()
        assert not ops.end_flux.any()
        assert (ops.gyroscopic == -ops.gyroscopic.T).all()
        assert (ops.flux == ops.flux.T).all()


def test_a_hinged_pipe_without_weight_turns_freely_at_any_speed():
    """7.333402: determinant of the exponentials; the turning is a root of zero throughout."""
    pipe = pp.Pipe(0.2, root="pinned")
    for model in (pp.Continuum(pipe), pp.Galerkin(pipe, 10, "legendre"), pp.Chain(pipe, 20)):
        for speed in (0.0, 3.0, 7.0):
            assert np.abs(pp.eigenvalues(model, speed, 2)[0]) < 1e-6
    for model in (pp.Continuum(pipe), pp.Galerkin(pipe, 10, "legendre")):
        found = pp.critical_speed(model)
        assert found.speed == pytest.approx(7.333402, rel=1e-6)
        value = 1j * found.frequency
        assert abs(series_newton_step(pipe, value, found.speed)) < 1e-5 * abs(value)


def speeds_of_slow_turns(model, speeds):
    """Speeds at which a root passes zero beside the free turn t: det of K with a column C t."""
    ops = model.operators()
    turn = np.linalg.svd(ops.stiffness)[2][-1]
    column = np.abs(turn).argmax()

    def determinant(u):
        _, velocity, stiffness = ops.at(u)
        stiffness[:, column] = velocity @ turn
        return np.linalg.det(stiffness)

    signs = np.sign([determinant(u) for u in speeds])
    places = np.flatnonzero(signs[1:] != signs[:-1])
    return [brentq(determinant, speeds[k], speeds[k + 1], xtol=1e-13) for k in places]


OUTSIDE = pp.ExternalFlow(1.0, 0.3)


@pytest.mark.parametrize(
    ("make", "term"),
    [
        (lambda pipe: pp.Chain(pipe, 5), pp.FollowerForce(0.5, 1.0)),
        (lambda pipe: pp.Galerkin(pipe, 6, "legendre"), pp.FollowerForce(0.5, 1.0)),
        (lambda pipe: pp.Galerkin(pipe, 6, "legendre"), OUTSIDE),  # grows by 2e-4 at most
        (lambda pipe: pp.Galerkin(pipe, 7, "legendre"), OUTSIDE),  # touches zero, below it
        (lambda pipe: pp.Chain(pipe, 5), OUTSIDE),
    ],
)
@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_a_hinged_pipe_turns_freely_under_forces_that_follow_it(make, term, damping):
    """Their moments about the hinge cancel, if only to rounding."""
    model = make(pp.Pipe(0.6, damping=damping, root="pinned", terms=[term]))
    assert np.abs(pp.eigenvalues(model, 1.0, 2)[0]) < 1e-6
    found = pp.crossings(model, 8.0)
    slow = [one.speed for one in found if one.kind == "divergence"]
    np.testing.assert_allclose(
        slow, speeds_of_slow_turns(model, np.linspace(0.5, 8.0, 751)), rtol=1e-7
    )


def test_a_spring_keeps_a_hinged_pipe_from_turning_freely():
    """Its roots are then found by the recursion, whose time grows only with the segments."""
    follower = pp.FollowerForce(0.5, 1.0)
    free, sprung = (
        pp.Chain(pp.Pipe(0.3, root="pinned", damping=0.001, terms=terms), 5)
        for terms in ([follower], [follower, pp.Spring(0.7, 10.0)])
    )
    assert type(sprung.pencil()) is type(pp.Chain(pp.Pipe(0.3), 5).pencil())
    assert type(free.pencil()) is not type(sprung.pencil())


def test_a_slow_root_beside_a_free_turn_is_seen_to_pass_zero():
    """It grows so slowly with the flow that it has no sign at the next samples."""
    pipe = pp.Pipe(1e-8, alpha=0.18, terms=[pp.RotationalDamper(0.5, 0.004)], root="pinned")
    model = pp.Galerkin(pipe, 5, "legendre")
    found = pp.critical_speed(model)
    (expected,) = speeds_of_slow_turns(model, np.linspace(7.0, 9.0, 200))
    assert (found.kind, found.speed) == ("divergence", pytest.approx(expected, rel=1e-9))


def test_a_root_spring_leads_from_the_hinge_to_the_clamp():
    def lowest(root):
        return pp.eigenvalues(pp.Continuum(pp.Pipe(0.3, 6.0, root=root)), 3.0, 2)[0]

    assert lowest(pp.RootSpring(0.0)) == lowest("pinned")
    assert lowest(pp.RootSpring(1e-9)) == pytest.approx(lowest("pinned"), rel=1e-8)
    assert lowest(pp.RootSpring(1e8)) == pytest.approx(lowest("clamped"), rel=1e-6)


def test_curves_and_loci_take_supported_pipes():
    curve = pp.stability_curve(
        lambda beta: pp.Galerkin(pp.Pipe(beta, root="pinned", end="pinned"), 6), [0.1, 0.4, 0.8]
    )
    assert curve.speeds == pytest.approx(np.full(3, math.pi), rel=1e-12)
    model = pp.Continuum(pp.Pipe(0.5, end="clamped"))
    loci = pp.root_loci(model, [0.0, 4.0, 6.0], 2)
    assert loci.eigenvalues[1] == pytest.approx([16.30777486j, 56.12714690j], abs=1e-7)
    shape = pp.modes(model, 4.0, 2).shapes[0]
    assert np.abs(shape([0.0, 1.0])).max() < 1e-12


@pytest.mark.parametrize("end", ["free", "guided"])
@pytest.mark.parametrize("root", ROOTS, ids=repr)
@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_operators_of_a_root_that_turns_are_the_jacobian_at_rest(basis, root, end):
    terms = [pp.PointMass(0.6, 0.2), pp.Viscosity(0.3)]
    pipe = pp.Pipe(0.4, 3.0, drag=0.5, damping=2e-3, root=root, end=end, terms=terms)
    model = pp.Galerkin(pipe, 4, basis)
    mass, velocity, stiffness = model.operators().at(4.0)
    at_rest = model.jacobian(0.0, np.zeros(8), 4.0)[4:]
    assert mass @ at_rest == pytest.approx(
        -np.hstack([stiffness, velocity]), abs=1e-10 * np.abs(stiffness).max()
    )
    if root != "clamped":  # the root turns, and its spring has energy
        assert np.abs(model.functions([0.0], 1)).max() > 1e-3
        free = pp.Galerkin(pp.Pipe(0.4, root="pinned", end=end), 4, "legendre")
        assert free.elastic_share.min() == (0.0 if end == "free" else 1.0)


def test_supports_are_checked_where_they_are_given():
    with pytest.raises(ValueError, match="root must be one of 'clamped', 'pinned', got 'loose'"):
        pp.Pipe(0.2, root="loose")
    with pytest.raises(TypeError, match=r'root must be "clamped", "pinned" or a RootSpring, got 3'):
        pp.Pipe(0.2, root=3.0)
    with pytest.raises(ValueError, match=r"supports\[1\] must lie in \(0, 1\), got 1.2"):
        pp.Pipe(0.2, supports=[0.5, 1.2])
    with pytest.raises(ValueError, match=r"supports must leave spans of at least 0.001, got"):
        pp.Pipe(0.2, supports=[0.3, 0.3005])
    pipe = pp.Pipe(0.2, supports=[0.7, 0.2], root=pp.RootSpring(0.0), end="pinned")
    assert pipe.supports == (0.2, 0.7)
    for places in (np.array([0.7, 0.2]), np.array([]), range(0)):
        assert pp.Pipe(0.2, supports=places).supports == tuple(sorted(places))
    assert pipe.root == "pinned"
    assert repr(pipe) == "Pipe(beta=0.2, root='pinned', end='pinned', supports=(0.2, 0.7))"
    assert not pipe.cantilevered
    with pytest.raises(ValueError, match="m must be at least 2, for one function on each"):
        pp.Galerkin(pp.Pipe(0.2, root="pinned"), 1, "legendre")


def test_supports_take_si_values():
    hose = {"length": 0.6, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(**hose, root=pp.RootSpring(0.05), end="guided", supports=[0.15])
    assert pipe.root.stiffness == pytest.approx(0.05 * 0.6 / 7.3e-3, rel=1e-14)
    assert pipe.supports == pytest.approx((0.25,), rel=1e-15)
    with pytest.raises(ValueError, match=r"root.stiffness from its SI value, length"):
        pp.Pipe.from_si(**hose, root=pp.RootSpring(1e9))
    with pytest.raises(ValueError, match=r"supports\[0\] must lie in \(0, 0.6\), got 0.6"):
        pp.Pipe.from_si(**hose, supports=[0.6])
