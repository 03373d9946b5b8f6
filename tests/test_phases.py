# SPDX-License-Identifier: MIT
"""Mixtures in a pipe against sums over their phases, which are put together here, in SI units."""

import dataclasses
import math

import numpy as np
import pint
import pytest
import scipy

import pipedyn as pp

WATER, AIR = pp.Phase(998.0, 2e-4), pp.Phase(1.2, 3e-4, slip=2.5)
SAND = pp.Phase(2650.0, 5e-5, slip=0.8)
TUBE = {
    "length": 0.5,
    "outer_diameter": 12e-3,
    "inner_diameter": 8e-3,
    "youngs_modulus": 3e6,
    "density": 1150.0,
}
MIXTURES = [(WATER, AIR), (WATER, SAND), (WATER, AIR, SAND)]
BORE = 16e-6 * math.pi
WALL = 1150.0 * 20e-6 * math.pi
STIFFNESS = 3e6 * math.pi / 64.0 * (12e-3**4 - 8e-3**4)


def shares(phases):
    """Shares of the bore: of two phases 1 / (1 + K Q_l / Q_g), the void fraction."""
    areas = [phase.flow_rate / phase.slip for phase in phases]
    return np.array(areas) / sum(areas)


def masses(phases):
    return [one.density * BORE * share for one, share in zip(phases, shares(phases), strict=True)]


def sum_of_phases(phases, speeds, length=0.5, gravity=9.81, size=20):
    """M, C and K in SI of polynomials, with M_k (d/dt + V_k d/dx)^2 w for each phase.

    The weak form of V_k^2 w'' is not integrated by parts, so that the free end needs no term.
    """
    nodes, weights = np.polynomial.legendre.leggauss(2 * size)
    x, weights = 0.5 * length * (nodes + 1.0), 0.5 * length * weights
    curves = [np.polynomial.Legendre.basis(i, [0.0, length]) for i in range(size)]
    curve = np.array([one(x) for one in curves])
    slope = np.array([one.integ(1, lbnd=0.0)(x) for one in curves])
    shape = np.array([one.integ(2, lbnd=0.0)(x) for one in curves])
    whole = WALL + sum(masses(phases))
    mass = whole * (shape * weights) @ shape.T
    stiff = STIFFNESS * (curve * weights) @ curve.T
    stiff += (slope * weights * whole * gravity * (length - x)) @ slope.T
    rate = np.zeros((size, size))
    for one, speed in zip(masses(phases), speeds, strict=True):
        rate += 2.0 * one * speed * (shape * weights) @ slope.T
        stiff += one * speed**2 * (shape * weights) @ curve.T
    return mass, rate, stiff


def roots(phases, speeds):
    mass, rate, stiff = sum_of_phases(phases, speeds)
    n = len(mass)
    first = np.block([[np.zeros((n, n)), np.eye(n)], [-stiff, -rate]])
    values = scipy.linalg.eigvals(first, scipy.linalg.block_diag(np.eye(n), mass))
    return values[np.argsort(np.abs(values))]


@pytest.mark.parametrize("phases", MIXTURES, ids=len)
def test_small_motions_are_those_of_the_sum_over_phases(phases):
    hose = pp.Pipe.from_tube(**TUBE, phases=phases)
    found = pp.eigenvalues(pp.Continuum(hose), 6.0, count=4) / hose.scales.time
    direct = roots(phases, [hose.speed_si(6.0, k) for k in range(len(phases))])
    for value in found:
        assert np.abs(direct - value).min() < 1e-9 * abs(value)


@pytest.mark.parametrize("phases", MIXTURES, ids=len)
def test_at_the_speeds_in_si_of_the_onset_the_sum_over_phases_flutters(phases):
    hose = pp.Pipe.from_tube(**TUBE, phases=phases)
    si = pp.critical_speed(pp.Continuum(hose)).in_si()
    direct = roots(phases, si.phase_speeds)
    crossing = direct[np.argmin(np.abs(direct - 2j * math.pi * si.frequency))]
    assert crossing == pytest.approx(2j * math.pi * si.frequency, rel=1e-8)


def test_at_any_amplitude_the_flow_feeds_what_its_phases_feed():
    """Each phase leaves with the thrust M_k V_k^2 along the end, and takes M_k V_k |v|^2 away."""
    phases, y, u = (WATER, AIR, SAND), np.array([0.2, 0.7, 1.4, 5.0, -3.0, 2.0]), 6.0
    hose = pp.Pipe.from_tube(**TUBE, phases=phases)
    chain = pp.Chain(hose, 3)
    (velocity,) = chain.tip_velocities(y[:3, None], y[3:, None])
    velocity = velocity * hose.scales.length / hose.scales.time
    along = velocity @ [math.sin(y[2]), math.cos(y[2])]
    speeds = [hose.speed_si(u, k) for k in range(3)]
    fed = -sum(
        mass * (speed * velocity @ velocity + speed**2 * along)
        for mass, speed in zip(masses(phases), speeds, strict=True)
    )
    assert chain.power(y, u).in_si(hose).flow == pytest.approx(fed, rel=1e-12)


def test_the_speed_in_si_is_the_mean_by_mass_and_flow_rates_are_those_of_the_phases():
    phases = (WATER, AIR)
    hose = pp.Pipe.from_tube(**TUBE, phases=phases)
    u = hose.flow_rate_from_si(5e-4)
    for k, phase in enumerate(phases):
        assert hose.flow_rate_si(u, k) == pytest.approx(phase.flow_rate, rel=1e-13)
        assert hose.flow_rate_from_si(phase.flow_rate, k) == pytest.approx(u, rel=1e-13)
        speed = phase.flow_rate / (shares(phases)[k] * BORE)
        assert hose.speed_si(u, k) == pytest.approx(speed, rel=1e-13)
        assert hose.speed_from_si(speed, k) == pytest.approx(u, rel=1e-13)
    flow = sum(phase.density * phase.flow_rate for phase in phases)
    assert hose.speed_si(u) == pytest.approx(flow / sum(masses(phases)), rel=1e-13)
    # By hand: U = L sum M_k V_k / sqrt(EI sum M_k).
    assert u == pytest.approx(0.5 * flow / math.sqrt(STIFFNESS * sum(masses(phases))), rel=1e-12)


def test_results_in_si_say_the_speed_and_flow_rate_of_each_phase():
    hose = pp.Pipe.from_tube(**TUBE, phases=(WATER, AIR))
    found = pp.critical_speed(pp.Chain(hose, 5))
    si = found.in_si()
    assert si.phase_speeds == pytest.approx([hose.speed_si(found.speed, k) for k in (0, 1)])
    assert si.phase_speeds[1] / si.phase_speeds[0] == pytest.approx(2.5, rel=1e-14)
    assert si.phase_flow_rates.sum() == pytest.approx(si.flow_rate, rel=1e-14)
    assert "phase_speeds=[" in repr(si)
    assert (found.units["phase_speeds"], found.units["phase_flow_rates"]) == ("m/s", "m3/s")
    loci = pp.root_loci(pp.Chain(hose, 5), [1.0, 2.0]).in_si()
    assert loci.phase_speeds == pytest.approx(np.outer(loci.speeds, si.phase_speeds) / si.speed)
    # In tables of an ensemble each member has its own mixture.
    single = pp.Pipe.from_tube(**TUBE, fluid_density=998.0)
    models = [pp.Chain(hose, 2), pp.Chain(single, 2)]
    rates = pp.simulate_many(models, 1.0, 0.1, samples=2).columns("si")["flow_rate (m3/s)"]
    expected = np.repeat([hose.flow_rate_si(1.0), single.flow_rate_si(1.0)], 2)
    np.testing.assert_allclose(rates, expected, rtol=1e-14)
    with pytest.raises(
        AttributeError, match=r"^phase_speeds needs a flow speed in one pipe made with"
    ):
        _ = pp.critical_speed(models[1]).in_si().phase_speeds


def test_phases_of_one_speed_are_a_single_fluid_of_their_mean_density():
    phases = [dataclasses.replace(phase, slip=3.0) for phase in (WATER, AIR, SAND)]
    mean = sum(p.density * p.flow_rate for p in phases) / sum(p.flow_rate for p in phases)
    mixed = pp.Pipe.from_tube(**TUBE, phases=phases, nozzle_ratio=1.5)
    single = pp.Pipe.from_tube(**TUBE, fluid_density=mean, nozzle_ratio=1.5)
    for name in ("beta", "gamma", "alpha"):
        assert getattr(mixed, name) == pytest.approx(getattr(single, name), rel=1e-14)
    assert mixed.scales[:6] == pytest.approx(single.scales[:6], rel=1e-14)
    assert mixed.flow_rate_si(2.0) == pytest.approx(single.flow_rate_si(2.0), rel=1e-14)
    beam = pp.Pipe.from_si(
        length=0.5,
        bending_stiffness=STIFFNESS,
        pipe_mass=WALL,
        inner_diameter=8e-3,
        phases=phases,
        alpha=1.5,
    )
    assert (beam.beta, beam.gamma) == pytest.approx((mixed.beta, mixed.gamma), rel=1e-13)
    assert beam.flow_rate_si(2.0) == pytest.approx(mixed.flow_rate_si(2.0), rel=1e-13)


def test_slip_raises_the_thrust_and_changes_what_is_relevant():
    """Of a gas with the slip K the end coefficient is that of physics: sum over two phases."""
    hose = pp.Pipe.from_tube(**TUBE, phases=(WATER, SAND))
    (m1, m2), (v1, v2) = masses((WATER, SAND)), (1.0, 0.8)
    assert hose.alpha == pytest.approx(
        (m1 + m2) * (m1 * v1**2 + m2 * v2**2) / (m1 * v1 + m2 * v2) ** 2, rel=1e-14
    )
    assert hose.alpha > 1.0
    effect = pp.relevant(hose, 6.0, tolerance=1e-4)["end coefficient"]
    assert effect.verdict == "relevant"


def test_phases_survive_files_and_changes_of_the_pipe(tmp_path):
    hose = pp.Pipe.from_tube(**TUBE, phases=(WATER, AIR))
    hose.save(tmp_path / "hose.npz")
    again = pp.load(tmp_path / "hose.npz")
    assert again == hose
    assert again.phases == (WATER, AIR)
    heavy = dataclasses.replace(hose, gamma=1.0, beta=0.3)
    assert heavy.speed_si(1.0, 1) / heavy.speed_si(1.0, 0) == pytest.approx(2.5, rel=1e-14)
    assert "2 phases" in repr(hose)


def test_phases_may_be_quantities():
    unit = pint.UnitRegistry()
    phase = pp.Phase(unit.Quantity(0.998, "g/cm**3"), unit.Quantity(12.0, "l/min"))
    assert (phase.density, phase.flow_rate) == pytest.approx((998.0, 2e-4), rel=1e-14)


BEAM = {"length": 0.5, "bending_stiffness": 0.01, "pipe_mass": 0.05}


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (pp.Pipe.from_si, {}, r"^fluid_mass or phases must be given, not both, got None and 0 pha"),
        (pp.Pipe.from_tube, {}, r"^fluid_density or phases must be given, not both, got None and"),
        (
            pp.Pipe.from_si,
            {"fluid_mass": 0.1, "phases": [WATER], "inner_diameter": 0.01},
            r"^fluid_mass or phases must be given, not both, got 0\.1 and 1 phases",
        ),
        (
            pp.Pipe.from_tube,
            {"fluid_density": 998.0, "phases": [WATER]},
            r"^fluid_density or phases must be given, not both, got 998\.0 and 1 phases",
        ),
        (pp.Pipe.from_si, {"phases": [WATER]}, r"^inner_diameter must be given with phases, whose"),
        (
            pp.Pipe.from_si,
            {"fluid_mass": 0.1, "inner_diameter": 0.01},
            r"^inner_diameter must be given with phases, whose bore it is, and only then, got 0",
        ),
        (
            pp.Pipe.from_tube,
            {"phases": [WATER, AIR], "nozzle_ratio": 2.0},
            r"^nozzle_ratio must be None for phases with different speeds, as their speeds in the",
        ),
        (pp.Pipe.from_tube, {"phases": [WATER] * 21}, r"^phases must be at most 20, got 21"),
    ],
)
def test_incomplete_or_contradictory_mixtures_are_refused(make, options, message):
    with pytest.raises(ValueError, match=message):
        make(**(BEAM if make == pp.Pipe.from_si else TUBE), **options)


@pytest.mark.parametrize("phases", [WATER, 3, None, "water", {WATER}])
def test_phases_must_be_a_sequence_of_phases(phases):
    with pytest.raises(TypeError, match=r"^phases must be a tuple or list of Phase, got "):
        pp.Pipe.from_tube(**TUBE, phases=phases)
    with pytest.raises(TypeError, match=r"^phases\[1\] must be a Phase, got "):
        pp.Pipe.from_tube(**TUBE, phases=[WATER, phases if phases is not WATER else 998.0])


@pytest.mark.parametrize("name", ["density", "flow_rate", "slip"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, 1e300])
def test_numbers_of_phases_are_positive(name, value):
    with pytest.raises(ValueError, match=rf"^{name} must "):
        pp.Phase(**{"density": 998.0, "flow_rate": 1e-4} | {name: value})


def test_a_flow_rate_in_liters_a_minute_beside_one_in_si_brings_a_warning():
    for rates in ((2e-4, 6.0), (12.0, 1e-4)):
        phases = [pp.Phase(998.0, rates[0]), pp.Phase(1.2, rates[1])]
        with pytest.warns(pp.UnusualPipe, match=r"a phase fills .* none in l/min\?"):
            pp.Pipe.from_tube(**TUBE, phases=phases)
    pp.Pipe.from_tube(
        **TUBE, phases=[pp.Phase(998.0, 12.0), pp.Phase(1.2, 6.0)]
    )  # only their ratio counts


def test_a_single_fluid_is_its_own_only_phase():
    hose = pp.Pipe.from_tube(**TUBE, fluid_density=998.0)
    assert hose.speed_si(2.0, 0) == hose.speed_si(2.0)
    with pytest.raises(ValueError, match=r"^phase must be from 0 to 0, got 1"):
        hose.flow_rate_si(2.0, 1)
