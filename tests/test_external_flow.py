# SPDX-License-Identifier: MIT
"""A fluid that flows along the outside of the pipe, in small motions.

The routes are independent of the models': the differential equation of the pipe with its conditions
at the ends, integrated along the pipe from the clamp, where the models multiply by functions and
integrate by parts; the same pipe with the flow inside; and numbers of a program that shares no code
with the package.
"""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn import modular

FLOW = pp.ExternalFlow(
    *(2.2, 0.7, 0.5, 0.3),
    base_drag=0.2,
    end_shape=0.8,
    end_length=0.05,
    added_mass_coefficient=1.4,
)
PIPES = {
    "cantilever": pp.Pipe(0.3, 6.0, alpha=1.2, terms=[FLOW]),
    "aspirating": pp.Pipe(0.3, -1.0, "aspirating", terms=[FLOW]),
    "pinned": pp.Pipe(0.3, 6.0, root="pinned", end="pinned", terms=[FLOW]),
    "clamped": pp.Pipe(0.3, end="clamped", terms=[FLOW]),
    "guided": pp.Pipe(0.3, end="guided", terms=[FLOW]),
    "sprung": pp.Pipe(0.3, root=pp.RootSpring(3.0), terms=[FLOW]),
}


def starts(pipe):
    """w and its derivatives at the root of two motions that the root allows, (4, 2)."""
    first, second = {"clamped": (0, 1), "pinned": (1, 0)}.get(pipe.root, (1, pipe.root_stiffness))
    return np.array([[0, 0], [first, 0], [second, 0], [0, 1]])


def along(pipe, flow, u, value, start):
    """w and its derivatives at the end, (4, k), from those at the root, for exp(value tau)."""
    square, speed, chi = flow.speed**2, flow.speed, flow.chi
    rough, root = square / flow.added_mass_coefficient, math.sqrt(chi)
    resisting = flow.normal_friction * rough * root / speed
    inside = 2.0 * pipe.direction * u * math.sqrt(pipe.beta)

    def slopes(s, y):
        w, first, second, third = y.reshape(4, -1)
        tension = rough * (flow.tangential_friction * (1.0 - s) + flow.base_drag / 2)
        tension += pipe.gamma * (1.0 - s)
        by_second = pipe.alpha * u**2 + square - tension
        by_first = flow.normal_friction * rough + pipe.gamma
        by_first += value * (inside + 2.0 * root * speed)
        by_w = value * resisting + value**2 * (1.0 + chi)
        fourth = -(by_second * second + by_first * first + by_w * w)
        return np.concatenate([first, second, third, fourth])

    y0 = start.astype(complex).ravel()
    found = solve_ivp(slopes, (0.0, 1.0), y0, "DOP853", rtol=1e-12, atol=1e-14)
    return found.y[:, -1].reshape(4, -1)


def missed(pipe, flow, u, value, start):
    """What motions from a start miss of both conditions at the end, (2, k)."""
    w, first, second, third = along(pipe, flow, u, value, start)
    shed = flow.speed * (flow.speed * first + math.sqrt(flow.chi) * value * w)
    carried = flow.end_length * (1.0 + flow.end_shape * flow.chi) * value**2 * w
    shear = -third - flow.end_shape * shed + carried
    conditions = {
        "free": (second, shear),
        "guided": (first, shear),
        "pinned": (w, second),
        "clamped": (w, first),
    }
    return np.array(conditions[pipe.end])


def root_near(function, value):
    """A root near a value, by the secant method."""
    before, value = value * (1.0 + 1e-5), value * (1.0 - 1e-5)
    at_before, at = function(before), function(value)
    for _ in range(20):
        before, at_before, value = value, at, value - at * (value - before) / (at - at_before)
        at = function(value)
        if abs(value - before) < 1e-12 * abs(value):
            break
    return value


@pytest.mark.parametrize("name", PIPES)
def test_small_motions_obey_the_equation_of_the_pipe_and_its_end(name):
    pipe = PIPES[name]
    found = pp.eigenvalues(pp.Continuum(pipe), 1.7, 6)

    def determinant(value):
        return np.linalg.det(missed(pipe, FLOW, 1.7, value, starts(pipe)))

    expected = [root_near(determinant, x) for x in found]
    np.testing.assert_allclose(found, expected, rtol=3e-9)


CASES = {
    "chain": lambda pipe, n: pp.Chain(pipe, n),
    "midpoint chain": lambda pipe, n: pp.Chain(pipe, n, springs="midpoint"),
    "scene": lambda pipe, n: modular.chain(pipe, n),
    "beam modes": lambda pipe, n: pp.Galerkin(pipe, n // 5),
    "Legendre functions": lambda pipe, n: pp.Galerkin(pipe, n // 2, "legendre"),
}


ALL = "cantilever", "guided", "pinned"


@pytest.mark.parametrize(
    ("kind", "name"),
    [("midpoint chain", "cantilever"), *itertools.product(("chain", "scene"), ALL)],
)
def test_chains_tend_to_the_exact_pipe_with_second_order(kind, name):
    pipe = PIPES[name]
    exact = pp.eigenvalues(pp.Continuum(pipe), 1.7, 4)
    errors = [np.abs(pp.eigenvalues(CASES[kind](pipe, n), 1.7, 4) - exact) for n in (20, 40, 80)]
    ratios = [np.linalg.norm(a) / np.linalg.norm(b) for a, b in itertools.pairwise(errors)]
    assert ratios == pytest.approx([4.0, 4.0], rel=0.05)
    assert errors[-1].max() < 0.02


@pytest.mark.parametrize(("kind", "error"), [("beam modes", 5e-2), ("Legendre functions", 1e-8)])
def test_reduced_models_tend_to_the_exact_pipe(kind, error):
    exact = pp.eigenvalues(pp.Continuum(PIPES["cantilever"]), 1.7, 4)
    found = [pp.eigenvalues(CASES[kind](PIPES["cantilever"], n), 1.7, 4) for n in (20, 40)]
    apart = [float(np.abs(one - exact).max()) for one in found]
    assert apart[1] < min(error, 0.6 * apart[0])


HELD = [{}, {"end": "guided"}, {"end": "pinned"}, {"supports": [0.5]}]


@pytest.mark.parametrize(
    ("kind", "held"),
    [
        *itertools.product(("chain", "beam modes", "Legendre functions"), HELD),
        *itertools.product(("midpoint chain",), HELD[::2]),
        ("scene", {}),
    ],
)
def test_a_frictionless_flow_outside_a_blunt_end_acts_like_one_inside(kind, held):
    """The mass ratio is chi / (1 + chi), frequencies are divided by sqrt(1 + chi)."""
    chi, speed = 0.6, 2.5
    outside = pp.Pipe(0.0, 4.0, alpha=0.0, terms=[pp.ExternalFlow(speed, chi)], **held)
    inside = pp.Pipe(chi / (1.0 + chi), 4.0, **held)
    found = pp.eigenvalues(CASES[kind](outside, 20), 0.0, 6) * math.sqrt(1.0 + chi)
    np.testing.assert_allclose(found, pp.eigenvalues(CASES[kind](inside, 20), speed, 6), rtol=1e-9)


@pytest.mark.parametrize("shape", [0.0, 0.3, 1.0])
def test_a_pinned_pipe_buckles_where_both_flows_together_have_eulers_load(shape):
    """u^2 + u_o^2 = pi^2: a held end does not feel its shape."""
    flow = pp.ExternalFlow(2.0, 0.5, end_shape=shape, end_length=0.1, base_drag=0.0)
    pipe = pp.Pipe(0.2, root="pinned", end="pinned", terms=[flow])
    for model in (pp.Continuum(pipe), pp.Galerkin(pipe, 10), pp.Galerkin(pipe, 12, "legendre")):
        found = pp.critical_speed(model)
        assert found.kind == "divergence"
        assert found.speed == pytest.approx(math.sqrt(math.pi**2 - 4.0), rel=1e-9)
        assert found.stable_at_rest


def test_a_pinned_pipe_in_frictionless_flow_keeps_its_energy():
    """Its roots come in fours, and it is stable again beyond its second divergence, by both flows
    as by the flow inside alone."""
    chi, speed = 0.5, 3.0
    held = {"root": "pinned", "end": "pinned"}
    flow = pp.ExternalFlow(speed, chi, end_shape=0.4)
    model = pp.Galerkin(pp.Pipe(0.2, terms=[flow], **held), 10, "legendre")
    found = pp.crossings(model, 8.0)
    squares = [one.speed**2 + speed**2 for one in found[:2]]
    assert squares == pytest.approx([math.pi**2, 4.0 * math.pi**2], rel=1e-9)
    assert [one.kind for one in found] == ["divergence", "divergence", "flutter"]
    assert found[1].unstable_after == 0
    assert found[1].gyroscopic
    assert found[2].unstable_after == 2


SHAPES = [
    pp.ExternalFlow(1.0, 1.0, end_shape=0.7),
    pp.ExternalFlow(1.0, 0.2, end_shape=0.9, end_length=0.1),
    pp.ExternalFlow(1.0, 5.0, end_shape=1.0),
]


def external_onsets(model, window, u=0.0):
    """Speeds of the external flow at which roots cross at an internal speed, with frequencies."""
    ranges = {"ExternalFlow.speed": window, "u": (u, u + 1.0)}
    found = pp.boundary(model, "ExternalFlow.speed", "u", ranges, criticality=False)
    assert not found.failures
    ends = [(curve, k) for curve in found.curves for k in (0, -1) if abs(curve.y[k] - u) < 1e-9]
    return sorted((float(curve.x[k]), float(curve.frequency[k])) for curve, k in ends)


@pytest.mark.parametrize("flow", SHAPES)
def test_a_tapered_end_makes_the_pipe_buckle_where_statics_says(flow):
    """cos u_o = -(1 - f) / f, which is Euler's load of a cantilever for f = 1."""
    model = pp.Continuum(pp.Pipe(0.2, terms=[flow]))
    first = external_onsets(model, (0.5, 2.8))[0]
    shape = flow.end_shape
    assert first == pytest.approx((math.acos(-(1.0 - shape) / shape), 0.0), rel=1e-9)


ROUGH = pp.ExternalFlow(1.0, 1.0, 0.5, 0.5, end_shape=0.8, end_length=0.01)
DRAGGED = pp.ExternalFlow(1.0, 1.0, 0.5, 0.5, base_drag=0.2, end_shape=0.8)


def test_critical_external_speeds_are_those_of_hermite_elements():
    """Divergence, where it ends, and flutter, by a program that shares no code with this one; the
    case of the literature, remembered, has 2.04 and 5.16."""
    (buckles, _), (straightens, _), (flutters, omega) = external_onsets(
        pp.Continuum(pp.Pipe(0.2, terms=[ROUGH])), (0.0, 6.0)
    )
    assert buckles == pytest.approx(2.044016, abs=6e-7)
    assert straightens == pytest.approx(4.934601, abs=6e-7)
    assert flutters == pytest.approx(5.16906, abs=6e-6)
    assert omega == pytest.approx(7.4961, abs=6e-5)


def test_the_flow_inside_moves_the_critical_external_speeds():
    onsets = external_onsets(pp.Continuum(pp.Pipe(0.2, terms=[DRAGGED])), (0.0, 6.0), u=2.0)
    assert onsets[0][0] == pytest.approx(2.767515, abs=6e-7)
    assert onsets[-1] == pytest.approx((5.66209, 6.3039), abs=6e-5)


def test_the_flow_outside_moves_the_critical_speed_of_that_inside():
    flow = pp.ExternalFlow(1.0, 0.5, 0.3, 0.3, base_drag=0.3, end_shape=0.7)
    pipe = pp.Pipe(0.3, terms=[flow])
    found = pp.critical_speed(pp.Continuum(pipe))
    assert (found.speed, found.frequency) == pytest.approx((6.627446, 11.67490), abs=6e-6)
    speeds = pp.critical_speeds(pp.Continuum(pipe), {"ExternalFlow.speed": [1.0, 1.5]}).speeds
    assert speeds[0] == pytest.approx(found.speed)
    curve = pp.stability_curve(
        lambda x: pp.Continuum(
            dataclasses.replace(pipe, terms=[dataclasses.replace(flow, speed=x)])
        ),
        [1.0, 1.5],
    )
    np.testing.assert_allclose(curve.speeds, speeds, rtol=1e-9)


def test_chains_lose_stability_to_the_external_flow_with_second_order():
    exact = np.array(external_onsets(pp.Continuum(pp.Pipe(0.2, terms=[ROUGH])), (0.0, 6.0)))
    errors = []
    for n in (10, 20, 40):
        model = pp.Chain(pp.Pipe(0.2, terms=[ROUGH]), n)
        errors.append(np.array(external_onsets(model, (0.0, 6.0))) - exact)
    for a, b in itertools.pairwise(errors):
        np.testing.assert_allclose(a[:, 0] / b[:, 0], 4.0, rtol=0.05)
    assert np.abs(errors[-1]).max() < 0.02


@pytest.mark.parametrize("name", PIPES)
def test_crossings_account_for_the_roots_of_the_matrices(name):
    """With an asymmetric stiffness and gyroscopic forces of a constant speed."""
    pipe = PIPES[name]
    for model in (pp.Chain(pipe, 12), pp.Galerkin(pipe, 10, "legendre"), pp.Galerkin(pipe, 8)):
        found = pp.crossings(model, 9.0)
        edges = [0.0, *found.speeds, 9.0]
        counts = [found.unstable_at_rest, *(one.unstable_after for one in found)]
        for (low, high), count in zip(itertools.pairwise(edges), counts, strict=True):
            mass, damping, stiffness = model.operators().at(0.5 * (low + high))
            inverse = np.linalg.inv(mass)
            still = np.zeros_like(mass)
            companion = np.block(
                [[still, np.eye(len(mass))], [-inverse @ stiffness, -inverse @ damping]]
            )
            assert int(np.sum(np.linalg.eigvals(companion).real > 1e-7)) == count


@pytest.mark.parametrize(
    "model",
    [pp.Chain(PIPES["cantilever"], 70), pp.Galerkin(PIPES["cantilever"], 10, "legendre")],
)
def test_sensitivities_are_differences_of_critical_speeds(model):
    """Also by gravity: the tapered end has inertia, but no weight."""
    found = pp.critical_speed(model).sensitivity.speed
    for name, step in (("gamma", 1e-3), ("beta", 1e-5), ("alpha", 1e-4), ("damping", 1e-6)):
        value = getattr(model.pipe, name)
        ahead, behind = (
            pp.critical_speed(model.with_pipe(dataclasses.replace(model.pipe, **{name: at}))).speed
            for at in (value + step, max(value - step, 0.0))
        )
        width = value + step - max(value - step, 0.0)
        assert getattr(found, name) == pytest.approx((ahead - behind) / width, rel=1e-3)


def test_a_faint_growth_is_that_of_perturbation_theory():
    """Of a flow without resistance, the friction along the pipe makes roots grow in proportion."""
    growth = []
    for friction in (1e-9, 1e-3):
        flow = pp.ExternalFlow(1.2, 1.0, tangential_friction=friction, end_shape=1.0)
        model = pp.Galerkin(pp.Pipe(0.0, alpha=0.0, terms=[flow]), 24, "legendre")
        growth.append(pp.eigenvalues(model, 0.0, 8).real / friction)
    np.testing.assert_allclose(growth[0], growth[1], rtol=2e-3, atol=1e-4)


def test_in_space_small_motions_are_those_of_the_plane_twice():
    pipe = PIPES["cantilever"]
    for make in (lambda **k: pp.Chain(pipe, 8, **k), lambda **k: pp.Galerkin(pipe, 6, **k)):
        planar, spatial = make(), make(dimensions=3)
        np.testing.assert_allclose(
            spatial.operators().stiffness, np.kron(np.eye(2), planar.operators().stiffness)
        )
        assert pp.critical_speed(spatial).speed == pp.critical_speed(planar).speed
        np.testing.assert_array_equal(pp.eigenvalues(spatial, 2.0), pp.eigenvalues(planar, 2.0))


def test_a_moving_base_carries_the_pipe_through_the_flow():
    """The fluid belongs to the ground: its forces depend on the whole displacement."""
    pipe, u, omega = PIPES["cantilever"], 1.7, 9.0
    model = pp.Galerkin(pipe, 16, "legendre")
    found = pp.frequency_response(model, u, np.array([omega, 10.0])).response[0]
    start = np.column_stack([[1, 0, 0, 0], starts(pipe)])
    ends = missed(pipe, FLOW, u, 1j * omega, start)
    shares = np.append(1.0, np.linalg.solve(ends[:, 1:], -ends[:, 0]))
    expected = along(pipe, FLOW, u, 1j * omega, start)[0] @ shares - 1.0
    assert found == pytest.approx(expected, rel=1e-7)


LOADED = pp.Pipe(0.2, 5.0, terms=[FLOW])
MOTIONS = {
    "simulate": lambda m: pp.simulate(m, 3.0, 1.0, lambda s: 0.1 * s),
    "simulate_many": lambda m: pp.simulate_many(m, [3.0, 4.0], 1.0, lambda s: 0.1 * s),
    "lyapunov_exponent": lambda m: pp.lyapunov_exponent(m, 6.0, lambda s: 0.1 * s),
    "limit_cycle": lambda m: pp.limit_cycle(m, 9.0),
    "hopf": lambda m: pp.hopf(m),
    "equilibria": lambda m: pp.equilibria(m, 2.0),
    "equilibrium_branch": lambda m: pp.equilibrium_branch(m, np.zeros(m.dof), 1.0, [1.0, 2.0]),
    "bifurcation_diagram": lambda m: pp.bifurcation_diagram(m, [5.0, 9.0]),
    "attractors": lambda m: pp.attractors(m, 9.0, [lambda s: 0.1 * s]),
    "forced_response": lambda m: pp.forced_response(
        m, 1.0, base=pp.Harmonic(0.01, 9.0), frequencies=(8.0, 10.0)
    ),
    "relevant": lambda m: pp.relevant(m.pipe, 2.0, "motion", duration=1.0),
    "boundary": lambda m: pp.boundary(m, "gamma", "u", {"gamma": (0.0, 5.0), "u": (0.0, 5.0)}),
    "rhs": lambda m: m.rhs(0.0, np.zeros(2 * m.dof), 1.0),
    "jacobian": lambda m: m.jacobian(0.0, np.zeros(2 * m.dof), 1.0),
    "energy": lambda m: m.energy(np.zeros(2 * m.dof)),
    "power": lambda m: m.power(np.zeros(2 * m.dof), 1.0),
    "about": lambda m: m.about(m.bent(lambda s: 0.1 * s)),
    "operators": lambda m: m.operators(m.bent(lambda s: 0.1 * s)),
}


@pytest.mark.parametrize("ask", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.parametrize(
    "model",
    [pp.Chain(LOADED, 4), pp.Galerkin(LOADED, 4, "legendre"), pp.Chain(LOADED, 4, dimensions=3)],
    ids=["chain", "reduced model", "chain in space"],
)
def test_whatever_needs_large_motions_is_refused_with_the_reason(ask, model):
    with pytest.raises(ValueError, match="known from experiments alone"):
        ask(model)


def test_points_of_a_sweep_over_onsets_of_motion_tell_the_reason():
    found = pp.criticality_curve(lambda x: pp.Chain(LOADED, 4), [1.0])
    assert "known from experiments alone" in str(found.failures[0].error)


def test_a_scene_in_the_flow_has_no_equilibrium_but_the_straight_one():
    scene = modular.chain(pp.Pipe(0.2), 4).plus(FLOW)
    assert pp.critical_speed(scene).speed == pp.critical_speed(pp.Chain(scene.pipe, 4)).speed
    with pytest.raises(ValueError, match="known from experiments alone"):
        scene.equilibrium(np.full(4, 0.1), 1.0)


def test_rotating_motions_in_the_flow_are_refused():
    with pytest.raises(ValueError, match="known from experiments alone"):
        pp.rotating_motion(pp.Chain(LOADED, 4, dimensions=3), 9.0)


@pytest.mark.parametrize(
    "bent",
    [
        {"gamma": 5.0, "inclination": 1.0},
        {"jet_angle": 0.2},
        {"terms": [FLOW, pp.Load(1.0, (0.1, 0.0))]},
    ],
)
def test_a_pipe_that_rests_bent_has_no_external_flow(bent):
    with pytest.raises(ValueError, match=r"terms\[0\] must act on a pipe that rests straight"):
        pp.Pipe(0.2, **{"terms": [FLOW]} | bent)


def test_the_fluid_around_the_pipe_has_its_mass_once():
    for other in (pp.AddedMass(0.2), FLOW):
        with pytest.raises(ValueError, match="the only one with the mass of the fluid around"):
            pp.Pipe(0.2, terms=[FLOW, other])
    with pytest.raises(ValueError, match="added_mass_coefficient"):
        pp.Pipe.from_si(**SI, **WATER, added_mass_coefficient=1.0, terms=[OUTSIDE])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("speed", -1.0, "speed must be finite and >= 0"),
        ("chi", 0.0, "chi must be finite and >= 1e-09"),
        ("end_length", math.nan, "end_length must be"),
        ("end_shape", "blunt", "end_shape must be"),
        ("added_mass_coefficient", 0.0, "added_mass_coefficient must be finite and >= 0.1"),
    ],
)
def test_bad_numbers_are_refused_by_name(name, value, message):
    error = TypeError if isinstance(value, str) else ValueError
    with pytest.raises(error, match=message):
        pp.ExternalFlow(**{"speed": 1.0, "chi": 0.5} | {name: value})


def test_the_shape_of_the_end_is_at_most_one():
    with pytest.raises(ValueError, match=r"terms\[0\].end_shape must lie in \[0, 1\]"):
        pp.Pipe(0.2, terms=[pp.ExternalFlow(1.0, 0.5, end_shape=1.1)])


SI = {"length": 0.5, "bending_stiffness": 0.02, "pipe_mass": 0.05, "fluid_mass": 0.03}
WATER = {"external_diameter": 0.012, "external_density": 998.0}
OUTSIDE = pp.ExternalFlow(1.5, 0.11, 0.4, 0.3, end_shape=0.6)


def test_si_numbers_are_a_speed_and_a_mass_per_length():
    """u_o = V_o L sqrt(C_m rho A / EI), as by hand, and back."""
    pipe = pp.Pipe.from_si(**SI, **WATER, terms=[OUTSIDE])
    (flow,) = pipe.terms
    assert flow.speed == pytest.approx(1.5 * 0.5 * math.sqrt(0.11 / 0.02), rel=1e-14)
    assert flow.chi == pytest.approx(0.11 / 0.08, rel=1e-14)
    assert (flow.normal_friction, flow.end_shape) == (0.4, 0.6)
    (back,) = pipe.terms_si
    assert dataclasses.astuple(back) == pytest.approx(dataclasses.astuple(OUTSIDE), rel=1e-14)


def test_quantities_of_pint_are_converted():
    pint = pytest.importorskip("pint")
    ureg = pint.UnitRegistry()
    knots = pp.ExternalFlow(5.4 * ureg.km / ureg.hour, 110.0 * ureg.g / ureg.m, 0.4, 0.3)
    given, plain = (
        pp.Pipe.from_si(**SI, terms=[flow]).terms[0]
        for flow in (knots, dataclasses.replace(OUTSIDE, end_shape=0.0))
    )
    assert dataclasses.astuple(given) == pytest.approx(dataclasses.astuple(plain), rel=1e-12)


def test_an_external_speed_is_identified_from_frequencies():
    """Beside the stiffness, whose change moves the units of all numbers."""
    pipe = pp.Pipe.from_si(**SI, damping_time=1e-4, terms=[OUTSIDE])
    model = pp.Continuum(pipe)
    measured = []
    for u in (0.0, 1.0, 2.0):
        roots = pp.eigenvalues(model, u, 4)[::2]
        speed, hertz = pipe.speed_si(u), pipe.frequency_si(abs(roots[1].imag)) / (2.0 * math.pi)
        measured.append(
            pp.Measurement("frequency", hertz, speed=speed, mode=2, uncertainty=1e-4 * hertz)
        )
    stiffer = pp.Pipe.from_si(
        **SI | {"bending_stiffness": 0.022}, damping_time=1e-4, terms=[OUTSIDE]
    )
    unknowns = {"bending_stiffness": (0.015, 0.03)}
    found = pp.identify(stiffer, measured, unknowns)
    assert found.values[0] == pytest.approx(0.02, rel=1e-6)
    assert found.pipe.terms_si[0].speed == pytest.approx(1.5, rel=1e-9)


def test_pulsating_flow_inside_is_a_linear_question():
    """Floquet multipliers by the matrices alone, without the package's integrators."""
    pipe = pp.Pipe(0.3, damping=0.002, terms=[FLOW])
    model = pp.Galerkin(pipe, 4)
    drive = pp.Pulsation(2.0, 0.4, 20.0)
    found = pp.floquet(model, drive).multipliers
    of, n = model.operators(), model.dof
    inverse = np.linalg.inv(of.mass)

    def rates(t, y):
        q, v = y.reshape(2, n, -1)
        u = 2.0 * (1.0 + 0.4 * math.cos(20.0 * t))
        _, damping, stiffness = of.at(u, -2.0 * 0.4 * 20.0 * math.sin(20.0 * t))
        return np.concatenate([v, -inverse @ (damping @ v + stiffness @ q)]).ravel()

    map_ = solve_ivp(rates, (0.0, math.pi / 10.0), np.eye(2 * n).ravel(), "DOP853", rtol=1e-10)
    expected = np.linalg.eigvals(map_.y[:, -1].reshape(2 * n, 2 * n))
    key = np.abs(found[:, None] - expected).min(axis=1)
    assert key.max() < 1e-6
