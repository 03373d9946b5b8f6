# SPDX-License-Identifier: MIT
"""Pipes from tubes: their section, flow rates, bending stresses, units, slips and warnings."""

import collections
import dataclasses
import math
import pickle
import re
import warnings

import numpy as np
import pint
import pytest

import pipedyn as pp
import pipedyn.__main__ as command
from pipedyn.paper.analysis import Findings, Row
from pipedyn.paper.report import report

TUBE = {
    "length": 0.5,
    "outer_diameter": 12e-3,
    "inner_diameter": 8e-3,
    "youngs_modulus": 3e6,
    "density": 1150.0,
    "fluid_density": 998.0,
}
HOSE = pp.Pipe.from_tube(**TUBE)
CHAIN = pp.Chain(HOSE, 6)
BORE = 5.026548245743669e-5
"""Area of a circle of 8 mm in m^2, pi 16e-6."""

BEAM = {"length": 0.45, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.032}
unit = pint.UnitRegistry()


def quantity(value, name):
    return unit.Quantity(value, name)


def bend(s):
    return 0.3 * s


# ------------------------------------------------------------------------------- the section


def test_a_tube_has_the_stiffness_and_masses_of_its_section():
    """By hand: I = pi (12^4 - 8^4) / 64 mm^4 = 816.8 mm^4, wall 20 pi mm^2, bore 16 pi mm^2."""
    stiffness = 3e6 * 816.8140899e-12
    by_hand = pp.Pipe.from_si(
        length=0.5,
        bending_stiffness=stiffness,
        pipe_mass=1150.0 * 62.83185307e-6,
        fluid_mass=998.0 * 50.26548246e-6,
    )
    assert HOSE.beta == pytest.approx(by_hand.beta, rel=1e-9)
    assert HOSE.gamma == pytest.approx(by_hand.gamma, rel=1e-9)
    assert HOSE.scales[:4] == pytest.approx(by_hand.scales[:4], rel=1e-9)
    assert HOSE.scales[4:6] == (12e-3, 8e-3)


def test_a_tube_takes_every_option_of_a_pipe_in_si_units():
    options = {
        **{"gravity": -9.81, "drag_coefficient": 1.1, "external_density": 998.0},
        **{"added_mass_coefficient": 1.0, "damping_time": 1e-3, "nozzle_ratio": 2.0},
        **{"rotary_inertia": 1e-6, "root": pp.RootSpring(0.1), "end": "guided"},
        **{"terms": [pp.PointMass(0.2, 0.01)], "supports": [0.3], "jet_angle": 0.1},
        "stiffness_profile": lambda s: 1.0 + s,
    }
    length, mass, time, _ = HOSE.scales[:4]
    section = {"length": length, "bending_stiffness": mass * length**4 / time**2}
    section |= {"pipe_mass": (1.0 - HOSE.beta) * mass, "fluid_mass": HOSE.beta * mass}
    plain = pp.Pipe.from_si(**section, **options, external_diameter=12e-3)
    tube = pp.Pipe.from_tube(**TUBE, **options)  # its own diameter is the external one
    for name in ("beta", "gamma", "drag", "damping", "alpha", "rotary_inertia", "jet_angle"):
        assert getattr(tube, name) == pytest.approx(getattr(plain, name), rel=1e-12), name
    for one, other in zip(tube.terms, plain.terms, strict=True):
        assert dataclasses.astuple(one) == pytest.approx(dataclasses.astuple(other), rel=1e-12)
    assert (tube.supports, tube.end) == (plain.supports, plain.end)
    assert tube.root.stiffness == pytest.approx(plain.root.stiffness, rel=1e-12)
    assert tube.stiffness == plain.stiffness


def test_a_tube_of_no_wall_or_with_unknown_options_is_refused():
    with pytest.raises(ValueError, match=r"^inner_diameter must be less than outer_diameter, 0\.0"):
        pp.Pipe.from_tube(**TUBE | {"inner_diameter": 0.012})
    with pytest.raises(
        ValueError, match=r"^external_diameter must be at least outer_diameter, 0\.0"
    ):
        pp.Pipe.from_tube(**TUBE, external_diameter=0.01, external_density=998.0)
    for name, hint in (
        ("bore", "did you mean 'inner_diameter'"),
        ("dampingtime", "'damping_time'"),
    ):
        with pytest.raises(TypeError, match=rf"from_tube\(\) has no argument '{name}': .*{hint}"):
            pp.Pipe.from_tube(**TUBE, **{name: 1.0})
    with pytest.raises(TypeError) as of_tube:
        pp.Pipe.from_tube(**TUBE, dampingtime=1.0)
    with pytest.raises(TypeError) as of_beam:
        pp.Pipe.from_si(**BEAM, dampingtime=1.0)
    assert str(of_tube.value) == str(of_beam.value).replace("from_si", "from_tube")


# ------------------------------------------------------------------------------- flow rates


def test_flow_rates_are_speeds_times_the_area_of_the_bore():
    found = pp.critical_speed(CHAIN)
    si = found.in_si()
    assert si.flow_rate == pytest.approx(si.speed * BORE, rel=1e-14)
    assert si.flow_rate_l_min == pytest.approx(si.speed * BORE * 6e4, rel=1e-14)
    assert "flow_rate_l_min" in dir(si)
    assert f"flow_rate_l_min={si.flow_rate_l_min:.7g} l/min" in repr(si)
    assert (found.units["flow_rate"], found.units["flow_rate_l_min"]) == ("m3/s", "l/min")
    row = f"<td>flow_rate_l_min</td><td></td><td>{si.flow_rate_l_min:.7g} l/min</td>"
    assert row in found._repr_html_()
    assert HOSE.flow_rate_si(found.speed) == pytest.approx(si.flow_rate, rel=1e-14)
    assert HOSE.flow_rate_from_si(si.flow_rate) == pytest.approx(found.speed, rel=1e-14)
    speeds = pp.root_loci(CHAIN, [1.0, 2.0]).in_si()
    np.testing.assert_allclose(speeds.flow_rates_l_min, 6e4 * BORE * speeds.speeds, rtol=1e-14)
    columns = pp.stability_curve(lambda n: pp.Chain(HOSE, round(n)), [2, 3]).columns("si")
    np.testing.assert_allclose(columns["flow_rate (m3/s)"], BORE * columns["speed (m/s)"])
    np.testing.assert_allclose(columns["flow_rate (l/min)"], 6e4 * columns["flow_rate (m3/s)"])
    assert list(columns)[1:4] == ["speed (m/s)", "flow_rate (m3/s)", "flow_rate (l/min)"]


def test_a_pipe_that_is_no_tube_has_no_flow_rates():
    plain = pp.Pipe.from_si(**BEAM)
    found = pp.critical_speed(pp.Chain(plain, 3))
    assert "flow_rate" not in found.units
    with pytest.raises(AttributeError, match=r"^flow_rate needs a pipe made with Pipe\.from_tube$"):
        _ = found.in_si().flow_rate
    with pytest.raises(ValueError, match=r"^flow rates need a pipe made with Pipe\.from_tube"):
        plain.flow_rate_si(1.0)
    with pytest.raises(
        ValueError, match=r"flow rate in SI needs a pipe made with Pipe\.from_tube, got"
    ):
        pp.Pipe(0.2).flow_rate_from_si(1.0)


def test_another_beta_is_another_fluid_in_the_same_bore():
    """At the same total mass: the critical speeds are those of a fluid of that density."""
    beta = 0.2
    changed = dataclasses.replace(HOSE, beta=beta)
    mass = HOSE.scales.mass
    tube = TUBE | {"fluid_density": beta * mass / BORE}
    wall = math.pi * (6e-3**2 - 4e-3**2)
    same = pp.Pipe.from_tube(**tube | {"density": (1.0 - beta) * mass / wall})
    assert changed.flow_rate_si(3.0) == pytest.approx(same.flow_rate_si(3.0), rel=1e-12)
    found = pp.critical_speeds(CHAIN, {"beta": [beta, HOSE.beta]}).columns("si")
    one = pp.critical_speed(pp.Chain(same, 6)).in_si()
    assert found["flow_rate (m3/s)"][0] == pytest.approx(one.flow_rate, rel=1e-9)
    own = pp.critical_speed(CHAIN).in_si()
    assert found["flow_rate (m3/s)"][1] == pytest.approx(own.flow_rate, rel=1e-9)


def test_each_tube_of_a_sweep_has_its_own_bore():
    def tube(inner_diameter):
        return pp.Chain(pp.Pipe.from_tube(**TUBE | {"inner_diameter": inner_diameter}), 3)

    found = pp.stability_curve(tube, [6e-3, 8e-3])
    areas = found.columns("si")["flow_rate (m3/s)"] / found.columns("si")["speed (m/s)"]
    np.testing.assert_allclose(areas, [math.pi * 9e-6, math.pi * 16e-6], rtol=1e-14)
    models = [CHAIN, pp.Chain(pp.Pipe.from_si(**BEAM), 6)]  # one of them no tube
    rates = pp.simulate_many(models, 1.0, 0.1, bend, samples=2).columns("si")
    np.testing.assert_allclose(rates["flow_rate (m3/s)"][:2], HOSE.flow_rate_si(1.0), rtol=1e-14)
    assert np.isnan(rates["flow_rate (m3/s)"][2:]).all()


@pytest.mark.parametrize("first", [0, 1])
def test_a_member_without_scales_has_no_numbers_in_si_among_others_that_have(first):
    models = [CHAIN, pp.Chain(pp.Pipe(0.2), 6)]
    found = pp.simulate_many([models[first], models[1 - first]], 1.0, 0.1, bend, samples=2)
    speeds = [motion.u for motion in found.in_si().motions]
    assert speeds[first] == HOSE.speed_si(1.0)
    assert math.isnan(speeds[1 - first])
    np.testing.assert_array_equal(found.columns("si")["flow_speed (m/s)"], np.repeat(speeds, 2))


def test_curvatures_are_found_only_when_they_are_asked_for(monkeypatch):
    motion = pp.simulate(CHAIN, 1.0, 0.1, bend, samples=2)
    monkeypatch.setattr(pp.Chain, "curvatures", None)
    assert motion.in_si().flow_rate[0] == HOSE.flow_rate_si(1.0)


def test_a_tube_survives_pickling_saving_and_changes_of_its_numbers(tmp_path):
    HOSE.save(tmp_path / "hose.npz")
    for again in (pp.load(tmp_path / "hose.npz"), pickle.loads(pickle.dumps(HOSE))):
        assert again == HOSE
        assert again.flow_rate_si(1.0) == HOSE.flow_rate_si(1.0)
    heavy = CHAIN.with_pipe(dataclasses.replace(HOSE, gamma=3.0)).pipe
    assert heavy.scales == HOSE.scales
    assert "bore 0.008 m" in repr(HOSE)
    stiffer = pp.identify(HOSE, [pp.Measurement("frequency", 1.7, 0.01)], ["bending_stiffness"])
    ratio = stiffer.values[0] / (3e6 * math.pi / 64.0 * (12e-3**4 - 8e-3**4))
    assert not 0.9 < ratio < 1.1
    assert stiffer.pipe.scales.wall_stress == pytest.approx(ratio * HOSE.scales.wall_stress)
    assert stiffer.pipe.scales.flow_rate / stiffer.pipe.scales.speed == pytest.approx(BORE)


def test_scales_may_be_given_without_diameters_and_not_with_wrong_ones():
    four = tuple(HOSE.scales[:4])
    assert pp.Pipe(HOSE.beta, scales=four).scales == pp.Scales(*four)
    with pytest.raises(ValueError, match=r"scales\.inner_diameter must be less than the outer"):
        pp.Pipe(HOSE.beta, scales=(*four, 0.01, 0.02))


# ------------------------------------------------------------------------------- bending stresses


@pytest.mark.parametrize("model", [pp.Chain(HOSE, 200), pp.Galerkin(HOSE, 4, "legendre")])
def test_a_circular_arc_has_one_curvature_in_every_model(model):
    q = np.array(model.bent(lambda s: 0.7 * s))
    assert model.curvatures(q[:, None]) == pytest.approx([0.7], rel=1e-9)


def test_the_curvature_of_a_chain_is_the_moment_of_its_joints_over_ei():
    held = pp.Pipe(0.2, root=pp.RootSpring(3.0), end="clamped", supports=[0.5])
    for pipe in (HOSE, held):
        chain = pp.Chain(pipe, 4)
        q = chain.bent(lambda s: 0.1 * np.sin(2.0 * math.pi * s))
        turns = np.diff(q, prepend=0.0, append=0.0)
        springs = np.append(chain.springs, chain.end_spring)
        if pipe is held:
            springs[0] = 1.0 / (1.0 / 3.0 + 1.0 / springs[0])
        largest = np.abs(springs * turns).max()
        scene = pp.modular.chain(pipe, 4)
        state = scene.bent(lambda s: 0.1 * np.sin(2.0 * math.pi * s))
        assert chain.curvatures(q[:, None]) == pytest.approx([largest], rel=1e-12)
        assert scene.curvatures(state[:, None]) == pytest.approx([largest], rel=1e-9)


def test_a_chain_bends_as_its_pipe_does_where_the_stiffness_varies():
    """At rest with an inclined jet, whose moment grows where the pipe is softest."""
    for profile in (lambda s: 1.0 - 0.8 * s, pp.Profile([0.5], [1.0, 0.2])):
        pipe = pp.Pipe.from_tube(**TUBE, stiffness_profile=profile, jet_angle=0.5)
        exact = pp.equilibria(pp.Galerkin(pipe, 10, "legendre"), 3.0).curvature[0]
        for model in (pp.Chain(pipe, 80), pp.modular.chain(pipe, 80)):
            assert pp.equilibria(model, 3.0).curvature[0] == pytest.approx(exact, rel=0.02)


def test_a_spring_of_a_scene_has_no_moment_at_its_angle_of_rest():
    plain = pp.modular.chain(HOSE, 2)
    bent = [
        dataclasses.replace(part, rest_angle=0.3)
        if isinstance(part, pp.modular.TorsionalSpring)
        else part
        for part in plain.modules
    ]
    scene = pp.modular.Assembly(HOSE, bent, plain.constraints)
    q = scene.state([0.3, 0.6])[:6]  # each joint turned by 0.3
    assert scene.curvatures(q[:, None]) == pytest.approx([0.0], abs=1e-12)
    assert plain.curvatures(q[:, None]) == pytest.approx([4.0 * 0.3], rel=1e-12)


def test_the_wall_stress_at_a_clamp_is_the_moment_of_the_jet_over_the_section_modulus():
    """A weak inclined jet loads the end across with mu_f V^2 sin psi: sigma = M D / (2 I)."""
    pipe = pp.Pipe.from_tube(**TUBE, gravity=0.0, jet_angle=0.3)
    speed = 2e-3  # m/s; u^2 = 2e-5 adds as much to the moment, relatively
    model = pp.Galerkin(pipe, 8, "legendre")
    rest = pp.equilibria(model, pipe.speed_from_si(speed)).in_si()
    moment = 998.0 * BORE * speed**2 * math.sin(0.3) * 0.5
    stress = moment * 6e-3 / 816.8140899e-12
    assert rest.wall_stress[0] == pytest.approx(stress, rel=1e-4)
    assert rest.curvature[0] == pytest.approx(stress / (3e6 * 6e-3), rel=1e-4)


def test_motions_cycles_and_branches_of_tubes_give_wall_stresses():
    """E D_o / 2 times the curvature is 18 kN/m times it."""
    speed = 1.1 * pp.critical_speed(CHAIN).speed
    motion = pp.simulate(CHAIN, speed, 1.0, bend, samples=9)
    found = motion.in_si()
    np.testing.assert_allclose(found.wall_stress, 18e3 * found.curvature, rtol=1e-12)
    np.testing.assert_allclose(found.curvature, CHAIN.curvatures(motion.q.T) / 0.5, rtol=1e-14)
    np.testing.assert_array_equal(motion.columns("si")["wall_stress (Pa)"], found.wall_stress)
    assert motion.units["wall_stress"] == "Pa"
    small = pp.Chain(dataclasses.replace(HOSE, gamma=0.0, damping=0.01), 4)
    cycle = pp.limit_cycle(small, 1.05 * pp.critical_speed(small).speed)
    assert cycle.in_si().wall_stress.shape == cycle.t.shape
    assert cycle.in_si().flow_rate == HOSE.flow_rate_si(cycle.u)
    shaken = pp.Chain(dataclasses.replace(HOSE, damping=0.01, gamma=3.0), 2)
    forced = pp.forced_response(shaken, 1.0, base=pp.Harmonic(0.01, 25.0), frequencies=(20.0, 30.0))
    [at] = forced.branches[0].at(25.0)
    assert at.in_si().wall_stress.max() == pytest.approx(18e3 * at.curvature.max() / 0.5)
    leaning = pp.Chain(dataclasses.replace(HOSE, gamma=-20.0), 2)
    branch = pp.equilibrium_branch(leaning, pp.equilibria(leaning, 1.0).q[1], 1.0, (0.5, 1.5))
    np.testing.assert_array_equal(
        branch.columns("si")["wall_stress (Pa)"], branch.in_si().wall_stress
    )


def test_stresses_of_chains_approach_those_of_reduced_models():
    """In a cycle: by the moments of joints, and by the curvature of polynomials."""
    pipe = pp.Pipe.from_tube(**TUBE, damping_time=2e-3)
    speed = pipe.flow_rate_from_si(3e-4)  # 18 l/min

    def peak(model):
        return pp.limit_cycle(model, speed).in_si().wall_stress.max()

    exact = peak(pp.Galerkin(pipe, 12, "legendre"))
    off = [abs(peak(pp.Chain(pipe, n)) / exact - 1.0) for n in (20, 40)]
    assert off[1] < 0.5 * off[0] < 0.02


def test_a_wall_that_varies_along_the_tube_has_no_stress_but_a_flow_rate():
    tapered = pp.Pipe.from_tube(**TUBE, stiffness_profile=lambda s: 1.0 - 0.5 * s)
    found = pp.simulate(pp.Chain(tapered, 3), 1.0, 0.1, bend, samples=3)
    assert "wall_stress" not in found.units
    assert found.in_si().flow_rate[0] == tapered.flow_rate_si(1.0)
    with pytest.raises(AttributeError, match=r"made with Pipe\.from_tube with a uniform wall$"):
        _ = found.in_si().wall_stress


# ------------------------------------------------------------------------------- pint


def test_quantities_of_pint_are_converted_to_si():
    tube = pp.Pipe.from_tube(
        length=quantity(500, "mm"),
        outer_diameter=quantity(1.2, "cm"),
        inner_diameter=quantity(8, "mm"),
        youngs_modulus=quantity(3, "MPa"),
        density=quantity(1.15, "g/cm**3"),
        fluid_density=quantity(998.0, "kg/m**3"),
        gravity=quantity(1.0, "standard_gravity"),
        damping_time=quantity(2.0, "ms"),
        hysteresis=quantity(3.0, "percent"),
        jet_angle=quantity(3.0, "degree"),
        terms=[pp.PointMass(quantity(30, "cm"), quantity(10, "g")), pp.Spring(0.4, 2.0)],
        root=pp.RootSpring(quantity(100, "N*mm/rad")),
        supports=quantity([200, 350], "mm"),
    )
    plain = pp.Pipe.from_tube(
        **TUBE,
        gravity=9.80665,
        damping_time=2e-3,
        hysteresis=0.03,
        jet_angle=math.radians(3.0),
        terms=[pp.PointMass(0.3, 0.01), pp.Spring(0.4, 2.0)],
        root=pp.RootSpring(0.1),
        supports=[0.2, 0.35],
    )
    for name in ("beta", "gamma", "damping", "hysteresis", "jet_angle", "supports"):
        assert getattr(tube, name) == pytest.approx(getattr(plain, name), rel=1e-12), name
    assert tube.root.stiffness == pytest.approx(plain.root.stiffness, rel=1e-12)
    assert [one.numbers for one in tube.terms] == [
        pytest.approx(one.numbers, rel=1e-12) for one in plain.terms
    ]
    assert [one.at for one in tube.terms] == pytest.approx([one.at for one in plain.terms])
    beam = pp.Pipe.from_si(
        length=quantity(45.0, "cm"),
        bending_stiffness=quantity(7300.0, "N*mm**2"),
        pipe_mass=quantity(190.0, "g/m"),
        fluid_mass=quantity(32.0, "g/m"),
    )
    assert beam.gamma == pytest.approx(pp.Pipe.from_si(**BEAM).gamma, rel=1e-12)
    assert HOSE.flow_rate_from_si(quantity(30.0, "l/min")) == pytest.approx(
        HOSE.flow_rate_from_si(5e-4), rel=1e-12
    )
    assert HOSE.time_from_si(quantity([1, 2], "min")) == pytest.approx(
        HOSE.time_from_si([60.0, 120.0])
    )
    listed = np.array([quantity(1, "min"), quantity(2, "s")], dtype=object)
    assert HOSE.time_from_si(listed) == pytest.approx(HOSE.time_from_si([60.0, 2.0]))
    for name in ("alpha", "hysteresis"):
        assert getattr(pp.Pipe(0.2, **{name: quantity(3, "percent")}), name) == 0.03
    flow = pp.Pulsation.from_si(HOSE, mean=quantity(80, "cm/s"), amplitude=0.1, frequency=3.0)
    assert flow.mean == pytest.approx(HOSE.speed_from_si(0.8))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda: pp.Pipe.from_tube(**TUBE | {"length": quantity(1, "kg")}),
            *(ValueError, r"^length must be a quantity that converts to m, got <Quantity\(1, 'kil"),
        ),
        (
            lambda: pp.Pipe.from_tube(**TUBE, terms=[pp.PointMass(0.1, quantity(1, "m"))]),
            *(ValueError, r"^terms\[0\]\.mass must be a quantity that converts to kg"),
        ),
        (
            lambda: pp.Pipe.from_tube(**TUBE, supports=[quantity(1, "s")]),
            *(ValueError, r"^supports\[0\] must be a quantity that converts to m"),
        ),
        (
            lambda: pp.Pipe(0.2, terms=[pp.PointMass(quantity(0.1, "m"), 1.0)]),
            *(TypeError, r"^terms\[0\]\.at must be a real number"),
        ),
        (
            lambda: pp.Pipe(0.2, terms=[pp.PointMass(0.1, quantity(1, "kg"))]),
            *(TypeError, r"^terms\[0\]\.mass must be a real number"),
        ),
        (
            lambda: pp.Pipe(0.2, root=pp.RootSpring(quantity(1, "N*m"))),
            *(TypeError, r"^root\.stiffness must be a real number"),
        ),
        (lambda: HOSE.frequency_from_si(quantity(1, "Hz")), TypeError, "omega_si must be a num"),
        (lambda: HOSE.length_si(quantity(1, "m")), TypeError, "s must be a number"),
        (
            lambda: pp.simulate(pp.Chain(pp.Pipe(0.2), 2), 1.0, quantity(1, "s"), bend),
            *(ValueError, "duration must be nondimensional where the pipe has no scales"),
        ),
        (lambda: pp.Pipe(0.2, damping=quantity(1, "s")), TypeError, "speed_from_si"),
        (lambda: pp.root_loci(CHAIN, quantity([1, 2], "m/s")), TypeError, "speed_from_si"),
        (
            lambda: pp.Harmonic.from_si(HOSE, amplitude=1e-3, frequency=quantity(3, "Hz")),
            *(TypeError, "frequency must be a real number .*frequencies are numbers in rad/s"),
        ),
        (
            lambda: pp.simulate(CHAIN, lambda t: quantity(1, "m"), 0.1, bend, units="si"),
            *(ValueError, "its value must be a quantity that converts to m/s"),
        ),
        (
            lambda: pp.simulate(CHAIN, quantity(1, "m"), 1.0, bend),
            *(ValueError, "u must be a quantity that converts to m/s"),
        ),
    ],
)
def test_quantities_of_another_dimension_or_without_scales_are_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


# ------------------------------------------------------------------------------- speeds and times


def test_motions_take_speeds_and_times_in_si_units():
    second, speed = HOSE.time_from_si(1.0), HOSE.speed_from_si(3.0)
    plain = pp.simulate(CHAIN, speed, 0.4 * second, bend, samples=9, t0=second)
    given = {"samples": 9, "t0": 1.0, "units": "si"}
    si = pp.simulate(CHAIN, 3.0, 0.4, bend, **given)
    np.testing.assert_allclose(si.q, plain.q, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(si.in_si().t, np.linspace(1.0, 1.4, 9), rtol=1e-12)
    of_pint = pp.simulate(
        *(CHAIN, quantity(300.0, "cm/s"), quantity(400.0, "ms"), bend),
        times=quantity([0.1, 0.2], "s"),
    )
    same = pp.simulate(CHAIN, 3.0, 0.4, bend, times=[0.1, 0.2], units="si")
    np.testing.assert_allclose(of_pint.q, same.q, rtol=1e-12)
    np.testing.assert_allclose(same.in_si().t, [0.1, 0.2], rtol=1e-12)


def test_functions_of_time_are_called_with_seconds_and_give_metres_and_metres_per_second():
    def plain(t):
        return 2.0 + math.sin(3.0 * t)

    scales = HOSE.scales

    def speed(t):
        return plain(t * scales.time) / scales.speed

    def place(t):
        return 1e-3 * math.cos(5.0 * t), 0.0

    def velocity(t):
        return -5e-3 * math.sin(5.0 * t), 0.0

    def acceleration(t):
        return -25e-3 * math.cos(5.0 * t), 0.0

    base = pp.Harmonic.from_si(HOSE, amplitude=1e-3, frequency=5.0)
    tau = HOSE.time_from_si(0.4)
    known = pp.simulate(CHAIN, speed, tau, bend, samples=9, base=base, rtol=1e-9)

    def with_unit(t):
        return quantity([100.0 * one for one in place(t)], "cm")

    for given in (place, (place, velocity, acceleration), (place, None, None), base, with_unit):
        for u in (plain, (plain, lambda t: 3.0 * math.cos(3.0 * t))):
            options = {"base": given, "rtol": 1e-9, "units": "si"}
            found = pp.simulate(CHAIN, u, 0.4, bend, samples=9, **options)
            np.testing.assert_allclose(found.q, known.q, atol=1e-6)
    np.testing.assert_allclose(found.in_si().flow_speed, [plain(t) for t in found.in_si().t])


def test_drives_with_numbers_of_their_own_are_refused_beside_si_units():
    flow, base = pp.Pulsation(6.0, 0.1, 20.0), pp.Harmonic(0.01, 20.0)
    small = pp.Chain(HOSE, 2)
    for call, name in (
        (lambda: pp.simulate(small, flow, 1.0, bend, units="si"), "u must come from Pulsation"),
        (
            lambda: pp.simulate_many(small, flow, 1.0, bend, units="si"),
            "speeds must come from Puls",
        ),
        (
            lambda: pp.simulate(small, pp.Supply(9.0, 1.0), 1.0, units="si"),
            "u must come from Supply",
        ),
        (lambda: pp.attractors(small, flow, 3, units="si"), "u must come from Pulsation"),
        (lambda: pp.attractors(small, 1.0, 3, base=base, units="si"), "base must come from Harm"),
        (
            lambda: pp.choose(HOSE, "motion", 0.1, u=1.0, duration=1.0, base=base, units="si"),
            "base must come from Harmonic",
        ),
    ):
        with pytest.raises(ValueError, match=rf"^{name}.*\.from_si where units are 'si'"):
            call()
    known = pp.Pulsation.from_si(HOSE, mean=2.0, amplitude=0.1, frequency=3.0)
    mixed = dataclasses.replace(known, mean=6.0)  # in units of the pipe
    with pytest.raises(ValueError, match="u must come from Pulsation"):
        pp.simulate(CHAIN, mixed, 0.1, bend, units="si")


def test_drives_in_si_stay_so_in_copies_and_files(tmp_path):
    flow = pp.Pulsation.from_si(HOSE, mean=2.0, amplitude=0.1, frequency=3.0)
    base = pp.Harmonic.from_si(HOSE, amplitude=1e-3, frequency=3.0)
    supply = pp.Supply.from_si(HOSE, pressure=5e3, density=998.0, friction=2.0)
    short = {"samples": 2, "units": "si", "max_step": np.inf}
    for u in (flow, supply):
        motion = pp.simulate(CHAIN, u, 0.1, bend, base=base, **short)
        motion.save(tmp_path / "motion.npz")
        for found in (pp.load(tmp_path / "motion.npz"), pickle.loads(pickle.dumps(motion))):
            assert (found.u, found.base) == (u, base)
            again = pp.simulate(CHAIN, found.u, 0.1, bend, base=found.base, **short)
            np.testing.assert_array_equal(again.q, motion.q)
    assert pp.simulate(CHAIN, flow, 0.1, bend, **short).in_si().flow_speed[0] == pytest.approx(2.2)
    pp.simulate(CHAIN, pp.Pulsation(4.0, 0.1, 3.0), 0.1, bend, samples=2).save(tmp_path / "own.npz")
    with pytest.raises(ValueError, match="u must come from Pulsation"):
        pp.simulate(CHAIN, pp.load(tmp_path / "own.npz").u, 0.1, bend, units="si")


def test_messages_about_converted_numbers_show_what_was_given():
    for u, duration, message in (
        (-3.0, 1.0, r"u must .* got -6\.78\d* \(in units .* 0\.442 m/s; given as -3\.0\)"),
        (3.0, quantity(1e-30, "s"), r"duration must .* given as <Quantity\(1e-30, 'second'\)>"),
    ):
        with pytest.raises(ValueError, match=message):
            pp.simulate(CHAIN, u, duration, bend, units="si")


def test_members_of_an_ensemble_take_speeds_and_times_by_their_own_pipes():
    stiff = pp.Chain(pp.Pipe.from_tube(**TUBE | {"youngs_modulus": 4e6}), 6)
    found = pp.simulate_many([CHAIN, stiff], [2.0, 3.0], 0.3, bend, samples=5, units="si")
    alone = pp.simulate(stiff, 3.0, 0.3, bend, samples=5, units="si")
    np.testing.assert_allclose(found.motions[1].q, alone.q, atol=1e-6)
    for motion, speed in zip(found.motions, (2.0, 3.0), strict=True):
        assert motion.in_si().t[-1] == pytest.approx(0.3, rel=1e-12)
        assert motion.in_si().flow_speed[0] == pytest.approx(speed, rel=1e-12)
    by_pint = pp.simulate_many([CHAIN, stiff], quantity([2.0, 3.0], "m/s"), 1.0, bend, samples=5)
    assert by_pint.motions[1].in_si().flow_speed[0] == pytest.approx(3.0)
    assert by_pint.motions[1].t[-1] == 1.0


def test_attractors_exponents_and_diagrams_take_speeds_and_times_in_si_units():
    model = pp.Chain(HOSE, 2)
    u = 1.05 * pp.critical_speed(model).speed
    speed, second = HOSE.speed_si(u), HOSE.time_si(1.0)
    exponent = pp.lyapunov_exponent(model, u, duration=8.0, transient=2.0)
    si = pp.lyapunov_exponent(
        model, speed, duration=8.0 * second, transient=2.0 * second, units="si"
    )
    assert si.duration == pytest.approx(exponent.duration, rel=1e-12)
    assert si.value == pytest.approx(exponent.value, abs=1e-6)
    short = pp.lyapunov_exponent(model, speed, duration=8.0 * second, units="si", transient=0.0)
    assert short.t[0] == pytest.approx(0.5, rel=0.7)  # the interval, not given, is 0.5 T or less
    ends = pp.attractors(model, speed, 3, units="si")  # its times stay those in T
    assert ends.u == pytest.approx(u, rel=1e-12)
    np.testing.assert_array_equal(ends.ends, pp.attractors(model, ends.u, 3).ends)
    with pytest.raises(ValueError, match=r"^transient must lie in .* units of the pipe, 1\.767 s"):
        pp.attractors(model, speed, 3, transient=second, units="si")
    diagram = pp.bifurcation_diagram(model, [0.9 * speed, speed], cycles=0, units="si")
    np.testing.assert_allclose(diagram.in_si().speeds, [0.9 * speed, speed], rtol=1e-12)


def test_questions_of_accuracy_take_speeds_and_times_in_si_units():
    speed, second = HOSE.speed_si(1.0), HOSE.time_si(1.0)
    asked = {"families": "beam", "sizes": [3], "repeats": 1}
    plain = pp.trade(HOSE, "motion", **asked, u=1.0, duration=0.2, samples=9)
    given = {"u": speed, "duration": 0.2 * second, "samples": 9, "units": "si"}
    found = pp.trade(HOSE, "motion", **asked, **given)
    assert found.rows[0].error == pytest.approx(plain.rows[0].error, rel=1e-3)
    assert found.quantity.duration == pytest.approx(0.2, rel=1e-12)
    effects = pp.relevant(HOSE, speed, "frequencies", count=1, units="si")
    assert effects.quantity.u == effects.u == pytest.approx(1.0, rel=1e-12)
    assert f"({speed:.4g} m/s, {6e4 * BORE * speed:.4g} l/min)" in str(effects)
    model = pp.choose(HOSE, "frequencies", 0.1, u=quantity(speed, "m/s"), count=1)
    assert model.quantity.u == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(ValueError, match=r"^units must be 'nondimensional' where the pipe has no"):
        pp.choose(pp.Pipe(0.2), "frequencies", 0.1, u=1.0, units="si")


def test_times_in_si_need_a_pipe_with_scales():
    bare = pp.Chain(pp.Pipe(0.2), 2)
    for call in (
        lambda: pp.simulate(bare, 1.0, 1.0, bend, units="si"),
        lambda: pp.simulate_many(bare, [1.0], 1.0, bend, units="si"),
        lambda: pp.attractors(bare, 4.0, 3, units="si"),
        lambda: pp.lyapunov_exponent(bare, 4.0, units="si"),
        lambda: pp.bifurcation_diagram(bare, [3.0, 4.0], units="si"),
    ):
        with pytest.raises(ValueError, match=r"^units must be 'nondimensional' where the pipe has"):
            call()


# ------------------------------------------------------------------------------- slips


BOOK = {"length": 0.5, "bending_stiffness": 2.45e-3, "pipe_mass": 0.07226, "fluid_mass": 0.05016}
STEEL = TUBE | {"outer_diameter": 0.025, "inner_diameter": 0.02, "youngs_modulus": 2e11}
STEEL |= {"density": 7850.0}
IN_WATER = BEAM | {"external_diameter": 0.0157, "external_density": 998.0}
LENGTHS = "length", "outer_diameter", "inner_diameter"

SLIPS = [
    # A value that is refused.
    (BEAM | {"length": 450.0}, "length in m, not in mm or cm"),
    (BEAM | {"jet_angle": 30.0}, "in rad, not in degrees"),
    (BEAM | {"bending_stiffness": 7.3e-12}, None),
    (BEAM | {"pipe_mass": 190.0, "length": 10.0}, "pipe_mass in kg/m, not in g/m"),
    (
        BEAM | {"external_diameter": 15.7, "external_density": 1000.0},
        "external_diameter in m, not in mm",
    ),
    (BEAM | {"supports": [200.0]}, "in m, not in mm"),
    (BEAM | {"terms": [pp.PointMass(400.0, 0.01)]}, "in m, not in mm"),
    (TUBE | {"length": 500.0}, "length in m, not in mm or cm"),
    (TUBE | {"length": 50.0}, "length in m, not in cm"),
    (TUBE | {"length": 0.0}, None),
    (TUBE | {"inner_diameter": 0.0}, None),
    (TUBE | {"length": 1e13}, None),
    (TUBE | {"inner_diameter": 11.9999e-3}, None),
    (STEEL | {"length": 5000.0, "outer_diameter": 0.3, "inner_diameter": 0.25}, None),
    (
        STEEL
        | {"length": 1e3, "outer_diameter": 20.0, "inner_diameter": 16.0, "youngs_modulus": 2e5},
        "inner_diameter in m, not in mm, and youngs_modulus in Pa, not in MPa",
    ),
    (TUBE | {"youngs_modulus": 3.0}, "youngs_modulus in Pa, not in MPa or GPa"),
]
UNUSUAL = [
    # One that is allowed, far outside what pipes are.
    (BEAM | {"bending_stiffness": 7300.0}, "bending_stiffness in N m2, not in N mm2"),
    (BEAM | {"length": 450.0, "gravity": 0.0}, "length in m, not in mm or cm"),
    (BEAM | {"jet_angle": 2.0}, "jet_angle in rad, not in degrees"),
    (BEAM | {"damping_time": 2.0}, "damping_time in s, not in ms"),
    (BEAM | {"gravity": 9810.0}, "gravity in m/s2, not in mm/s2"),
    (
        BEAM | {"pipe_mass": 190.0, "fluid_mass": 32.0},
        "pipe_mass and fluid_mass in kg/m, not in g/m",
    ),
    (BEAM | {"pipe_mass": 190.0}, "pipe_mass in kg/m, not in g/m"),
    (BEAM | {"fluid_mass": 32.0}, "fluid_mass in kg/m, not in g/m"),
    (BEAM | {"rotary_inertia": 1.0}, "are all units right"),
    (BEAM | {"terms": [pp.PointMass(0.45, 100.0)]}, "in kg, not in g"),
    (
        BEAM | {"pipe_mass": 1.9e-4, "fluid_mass": 3.2e-5},
        "bending_stiffness in N m2, not in N mm2, or pipe_mass and fluid_mass in kg/m, "
        "not in kg/mm",
    ),
    (TUBE | {"youngs_modulus": 1e5, "gravity": 981.0}, "gravity in m/s2, not in cm/s2"),
    *((BEAM | {name: 1e3}, "are all units right") for name in ("alpha", "nozzle_ratio")),
    *((IN_WATER | {name: 1e3}, None) for name in ("drag_coefficient", "added_mass_coefficient")),
    *(
        (
            BOOK | {"bending_stiffness": 2450.0, "length": at},
            f"bending_stiffness in N m2, not in N mm2{masses}",
        )
        for at, masses in ((0.5, ""), (1.2, ", or pipe_mass and fluid_mass in kg/m, not in kg/mm"))
    ),
    *(
        (BOOK | {"damping_time": 2.0, "length": at}, "damping_time in s, not in ms")
        for at in (0.8, 1.2)
    ),
    *(
        (
            TUBE | dict(zip(LENGTHS[:3], each, strict=True)),
            "length and outer_diameter and inner_diameter in m, not in mm or cm",
        )
        for each in (
            *((500.0, 12.0, 8.0), (450.0, 10.0, 7.0), (450.0, 8.0, 5.0), (100.0, 12.0, 8.0)),
            (50.0, 1.2, 0.8),
        )
    ),
    (TUBE | {"youngs_modulus": 3e11}, "are all units right"),
    (STEEL | {"length": 1000.0, "gravity": 0.0, "end": "pinned"}, "length in m, not in mm or cm"),
    (BEAM | {"hysteresis": 5.0}, "are all units right"),
    (
        BEAM | {"external_diameter": 15.7, "external_density": 1.2},
        "external_diameter in m, not in mm",
    ),
    (
        TUBE | {"outer_diameter": 12.0, "inner_diameter": 8.0},
        "outer_diameter and inner_diameter in m, not in mm",
    ),
    (TUBE | {"density": 1.15}, "density in kg/m3, not in g/cm3"),
    *((TUBE | {"fluid_density": at}, "fluid_density in kg/m3, not in g/cm3") for at in (1.0, 0.96)),
    (IN_WATER | {"external_density": 1.025}, "external_density in kg/m3, not in g/cm3"),
]


def make(given):
    return (pp.Pipe.from_tube if "outer_diameter" in given else pp.Pipe.from_si)(**given)


@pytest.mark.parametrize(("given", "slip"), SLIPS)
def test_the_message_about_a_refused_value_names_the_likely_slip(given, slip):
    with pytest.raises(ValueError, match=rf"must lie in .*: .*{slip}\?$" if slip else r"\d$"):
        make(given)


@pytest.mark.parametrize(("given", "slip"), UNUSUAL)
def test_a_legal_value_far_outside_what_pipes_are_brings_one_warning(given, slip):
    with pytest.warns(pp.UnusualPipe, match=f": .*{slip}\\?" if slip else "for pipes at") as seen:
        make(given)
    assert [(one.filename, one.category) for one in seen] == [(__file__, pp.UnusualPipe)]


def test_the_warning_is_silenced_by_its_class_and_derived_pipes_bring_none():
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=pp.UnusualPipe)
        lossy = pp.Pipe(0.2, 3.0, hysteresis=5.0)
        make(BEAM | {"bending_stiffness": 7300.0})
    with pytest.warns(pp.UnusualPipe, match="jet_angle is 2 rad, for pipes at most 1.57 rad"):
        pp.Pipe(0.2, jet_angle=2.0)
    with pytest.warns(pp.UnusualPipe, match="jet_angle"):
        backward = dataclasses.replace(HOSE, jet_angle=-2.0)
    dataclasses.replace(backward, gamma=3.0)  # its angle was meant
    dataclasses.replace(lossy, gamma=4.0)
    with pytest.raises(ValueError, match=r"got 30: in rad, not in degrees\?$"):
        pp.Pipe(0.2, jet_angle=30)
    assert pp.Chain(lossy, 3).operators().loss is not None  # found from a pipe of more damping


RUBBER, SILICONE, NYLON = (3e6, 1150.0), (1e6, 1100.0), (5e7, 1200.0)
METAL, ALUMINIUM = (2.1e11, 7850.0), (7e10, 2700.0)
SLOW, FLAT, SPAN = {"damping_time": 1e-3}, {"gravity": 0.0}, {"root": "clamped", "end": "clamped"}
SENSIBLE = [  # length, outer and inner diameter, E and density of the wall, density of the fluid
    (0.5, 12e-3, 8e-3, *RUBBER, 998.0, SLOW),
    (1.2, 12e-3, 8e-3, *RUBBER, 998.0, SLOW),
    (0.45, 10e-3, 7e-3, *RUBBER, 998.0, SLOW),
    (0.1, 12e-3, 8e-3, *RUBBER, 998.0, SLOW),
    (1.0, 12e-3, 8e-3, *RUBBER, 998.0, FLAT),
    (0.45, 15.5e-3, 9.2e-3, 1.4e6, 1150.0, 998.0, {}),
    (0.3, 10e-3, 6e-3, *SILICONE, 1.2, SLOW),  # air
    (0.1, 2e-3, 1e-3, *SILICONE, 998.0, SLOW),
    (0.15, 10e-3, 7e-3, 1e5, 1070.0, 998.0, SLOW),  # the softest rubber
    (0.05, 0.8e-3, 0.5e-3, *METAL, 998.0, {}),  # needles
    (0.013, 0.3e-3, 0.16e-3, *METAL, 998.0, FLAT),
    (1.0, 2e-3, 1.4e-3, *NYLON, 998.0, FLAT),  # a catheter
    (0.3, 0.36e-3, 0.05e-3, 7e10, 2200.0, 998.0, {}),  # a capillary
    (0.5, 6e-3, 4e-3, 7e10, 2500.0, 13600.0, {}),  # mercury in glass
    (1.0, 20e-3, 16e-3, *METAL, 998.0, {}),
    (2.0, 20e-3, 16e-3, *METAL, 1.2, {}),
    (10.0, 0.1, 0.09, *METAL, 998.0, {}),
    (1.0, 0.1, 0.09, *METAL, 998.0, SPAN),
    (50.0, 0.8, 0.76, *METAL, 850.0, SPAN | {"external_density": 1025.0}),
    (40.0, 1.0, 0.98, *METAL, 60.0, SPAN),  # gas
    (1500.0, 0.3, 0.25, *METAL, 998.0, {"external_density": 1025.0}),  # risers
    (1000.0, 0.3, 0.25, *METAL, 998.0, {}),
    (500.0, 0.03, 0.024, *METAL, 998.0, {}),
    (1000.0, 10.0, 9.8, 2e10, 1800.0, 1025.0, {"external_density": 1025.0}),  # cold water
    (2.0, 0.1, 0.098, *ALUMINIUM, 1140.0, SPAN),  # lines of a rocket
    (2.0, 0.1, 0.098, *ALUMINIUM, 71.0, SPAN),
    (1.0, 0.05, 0.048, 1.3e11, 1550.0, 998.0, {}),  # carbon fibre
    (10.0, 18e-3, 12e-3, *NYLON, 998.0, {}),  # garden hoses
    (25.0, 19e-3, 13e-3, *NYLON, 998.0, {}),
    (20.0, 0.05, 0.047, 2e8, 1150.0, 998.0, FLAT),  # a fire hose
    (300.0, 0.6, 0.5, 1e8, 1300.0, 850.0, FLAT),  # a floating one
    (4.0, 0.15, 0.125, 1e8, 1300.0, 2400.0, {}),  # of a concrete pump
    (3.0, 0.11, 0.1, 1e9, 950.0, 998.0, {}),
    (1.0, 0.04, 0.0396, 1e9, 950.0, 998.0, {}),  # a film
]
FACTORS = {
    **{name: (name, 1e3) for name in LENGTHS},
    **{f"lengths in {unit}": (" ".join(LENGTHS), by) for unit, by in (("mm", 1e3), ("cm", 1e2))},
    "E in MPa": ("youngs_modulus", 1e-6),
    "E in GPa": ("youngs_modulus", 1e-9),
    "EI in N mm2": ("bending_stiffness", 1e6),
    "densities": ("density fluid_density external_density", 1e-3),
    "density": ("density", 1e-3),
    "fluid_density": ("fluid_density", 1e-3),
    "masses": ("pipe_mass fluid_mass", 1e3),
    "pipe_mass": ("pipe_mass", 1e3),
    "fluid_mass": ("fluid_mass", 1e3),
    "time in ms": ("damping_time", 1e3),
}


def answer(given):
    """Whether a pipe is refused, brings a warning or neither."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            make(given)
        except ValueError:
            return "refused"
    return "warned" if seen else "silent"


def test_sensible_pipes_bring_no_warning_and_most_slips_of_their_units_do():
    """Of the rest, liquids other than water in g/cm3 may be gases, a stiff short pipe in cm may be
    a long or wide one, and masses of thin walls in g/m may be those of thick ones in kg/m.
    """
    counts = {name: collections.Counter() for name in FACTORS}
    for *numbers, options in SENSIBLE:
        tube = dict(zip(TUBE, numbers, strict=True)) | options
        length, mass, time = make(tube).scales[:3]
        beam = {"length": length, "bending_stiffness": mass * length**4 / time**2, **options}
        beam |= {"pipe_mass": mass * (1.0 - make(tube).beta), "fluid_mass": mass * make(tube).beta}
        if "external_density" in options:
            beam["external_diameter"] = tube["outer_diameter"]
        for given in (tube, beam):
            assert answer(given) == "silent", given
            for name, (of, by) in FACTORS.items():
                wrong = {one: by * given[one] for one in of.split() if one in given}
                if wrong and (given is tube or wrong.keys() & BEAM.keys() - {"length"}):
                    counts[name][answer(given | wrong)] += 1
    silent = {name: one["silent"] for name, one in counts.items() if one["silent"]}
    assert silent == {
        **{"length": 1, "lengths in mm": 1, "lengths in cm": 11, "fluid_density": 7},
        **{"masses": 2, "pipe_mass": 9, "fluid_mass": 5},
    }
    whole = sum(counts.values(), collections.Counter())
    assert whole == {"refused": 136, "warned": 311, "silent": 36}


SUPPLY = {"pressure": 1e5, "density": 998.0, "friction": 2.0}
TURNED = {"Q": "in m3/s, not in l/min or l/s or m3/h", "V": "in m/s, not in m3/s"}


@pytest.mark.parametrize(
    ("call", "slip"),
    [
        (lambda: pp.Pipe(0.2, damping=2.0), "damping is 2, for pipes at most 1: are all units"),
        (lambda: pp.Pipe(0.2, alpha=150.0), "alpha is 150, for pipes at most 100"),
        (lambda: pp.Pipe(0.2, rotary_inertia=1.0), "rotary_inertia is 1, for pipes at most 0.1"),
        (lambda: pp.Pipe(0.2, terms=[pp.PointMass(1.0, 500.0)]), "largest point mass .* is 500"),
        (lambda: pp.Pipe.from_tube(**TUBE, nozzle_ratio=8e-3), "nozzle_ratio is 0.008"),
        (lambda: pp.Phase(0.998, 2e-4), "water in g/cm3: density in kg/m3, not in g/cm3"),
        (lambda: pp.Phase(2e-4, 998.0), "density is 0.0002 kg/m3, for pipes at least 0.01"),
        *((lambda q=q: HOSE.flow_rate_from_si(q), TURNED["Q"]) for q in (15.0, 0.25, 0.9)),
        (lambda: HOSE.flow_rate_from_si([0.0, 15.0, 20.0]), TURNED["Q"]),
        (lambda: HOSE.speed_from_si(1.5e-4), TURNED["V"]),
        (lambda: pp.simulate(CHAIN, 1.5e-4, 0.01, bend, units="si"), TURNED["V"]),
        (
            lambda: pp.Pulsation.from_si(HOSE, mean=1.5e-4, amplitude=0.1, frequency=20.0),
            TURNED["V"],
        ),
        (lambda: pp.Harmonic.from_si(HOSE, amplitude=2.0, frequency=20.0), "not in mm"),
        (lambda: pp.Harmonic(-5.0, 20.0), "amplitude over the pipe's length is 5"),
        (lambda: pp.Supply.from_si(HOSE, **SUPPLY | {"pressure": 3.0}), "in Pa, not in bar"),
        (lambda: pp.Supply.from_si(HOSE, **SUPPLY | {"density": 1.0}), "fluid has 998 kg/m3"),
        (
            lambda: pp.Supply.from_si(pp.Pipe.from_si(**BEAM), **SUPPLY | {"density": 1.0}),
            "which is that of water in g/cm3",
        ),
        (lambda: pp.Measurement("frequency", 1.2, 5.0), "in its unit, not in per cent"),
        (lambda: pp.simulate(CHAIN, 1.0, 0.01, [5.0] * 6), "angle .* 5 rad.*, not in degrees"),
        (lambda: pp.simulate(CHAIN, 1.0, 0.01, lambda s: 10.0 * s), "in rad, not in degrees"),
        (
            lambda: pp.simulate(pp.Galerkin(HOSE, 4), 1.0, 0.01, lambda s: 10.0 * s),
            "in rad, not in degrees",
        ),
    ],
)
def test_a_value_far_from_usual_brings_one_warning_wherever_it_is_given(call, slip):
    with pytest.warns(pp.UnusualPipe, match=slip) as seen:
        call()
    assert [(one.filename, one.category) for one in seen] == [(__file__, pp.UnusualPipe)]


def test_usual_speeds_flow_rates_and_supplies_bring_no_warning():
    for speed in (0.0, 0.01, 3.0, 340.0):
        assert HOSE.flow_rate_from_si(HOSE.flow_rate_si(HOSE.speed_from_si(speed))) >= 0.0
    pp.Supply.from_si(HOSE, **SUPPLY)
    pp.Harmonic.from_si(HOSE, amplitude=0.1, frequency=20.0)
    pp.Measurement("decay_rate", 0.0, 0.1)


def test_gases_bring_no_warning():
    """Helium, methane, neon and natural gas, nitrogen and air, argon, butane, air at 10 bar."""
    for density in (0.17, 0.67, 0.85, 0.9, 1.14, 1.2, 1.66, 2.4, 12.0):
        assert answer(TUBE | {"fluid_density": density}) == "silent"


# ------------------------------------------------------------------------------- the command


OPTIONS = [
    word for name, value in TUBE.items() for word in (f"--{name.replace('_', '-')}", repr(value))
]


def test_the_command_makes_the_same_tube_and_gives_its_flow_rates(tmp_path, capsys):
    case = command._parse([*OPTIONS, "--gravity", "1.0", "--output", str(tmp_path)])
    assert case.pipe == pp.Pipe.from_tube(**TUBE, gravity=1.0)
    chain = pp.critical_speed(pp.Chain(case.pipe, 4))
    findings = Findings(highest=8.0, exact=None, rows=[Row("chain", "rayleigh", 4, chain)])
    rate = chain.in_si().flow_rate_l_min
    said = report(case, findings)
    assert "V_c (m/s)  f_c (Hz)  Q_c (l/min)" in said
    assert f"  {rate:.5f}  {chain.kind}" in said
    command.save_table(case, findings, tmp_path / "table.csv")
    rows = (tmp_path / "table.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].endswith("speed (m/s),frequency (Hz),flow rate (l/min)")
    assert float(rows[2].rpartition(",")[2]) == rate
    assert capsys.readouterr().err == ""
    command._parse([*OPTIONS, "--density", "1.15", "--output", str(tmp_path)])
    assert re.fullmatch(
        "pipedyn: warning: density is .* not in g/cm3\\?\n", capsys.readouterr().err
    )
    command._parse([*OPTIONS, "--density", "1.15", "--quiet", "--output", str(tmp_path)])
    assert capsys.readouterr().err.startswith("pipedyn: warning: density is")
    for words, message in (
        (OPTIONS[:-2], "argument --fluid-density: must be given in SI units"),
        ([*OPTIONS, "--pipe-mass", "1"], "--pipe-mass: cannot be given with --outer-diameter"),
    ):
        with pytest.raises(SystemExit):
            command._parse([*words, "--output", str(tmp_path)])
        assert message in capsys.readouterr().err
