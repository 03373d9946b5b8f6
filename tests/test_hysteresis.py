# SPDX-License-Identifier: MIT
"""Structural damping of a constant loss factor, EI (1 + i mu), in linear questions."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from independent import chain_crossing, chain_newton_step, companion_eigenvalues, series_newton_step
from test_pipe import HOSE

import pipedyn as pp
from pipedyn import modular as md

LOSSY = pp.Pipe(0.3, 5.0, damping=1e-3, hysteresis=0.07)
TERMS = (
    pp.PointMass(at=0.6, mass=0.2),
    pp.Spring(at=0.45, stiffness=20.0),
    pp.Damper(at=1.0, coefficient=0.1),
)
MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 14),
    "beam": lambda pipe: pp.Galerkin(pipe, 8),
    "legendre": lambda pipe: pp.Galerkin(pipe, 12, "legendre"),
    "scene": lambda pipe: md.chain(pipe, 9),
    "guided": lambda pipe: md.chain(pipe, 9).plus(md.Guide(4)),
    "by matrices": lambda pipe: md.chain(pipe, 9).plus(md.TorsionalSpring(5, 3.0, damping=0.02)),
}
of_models = pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)


def without(pipe):
    return replace(pipe, hysteresis=0.0)


def viscous_pipe(pipe, frequency):
    """The pipe whose Kelvin-Voigt damping loses as much at a frequency."""
    return replace(pipe, damping=pipe.equivalent_damping(frequency), hysteresis=0.0)


def test_the_critical_speed_of_a_chain_with_terms_by_shooting():
    for pipe in (LOSSY, replace(LOSSY, terms=TERMS), replace(LOSSY, flow="aspirating", alpha=0.4)):
        found = pp.critical_speed(pp.Chain(pipe, 9))
        exact = chain_crossing(pp.Chain(pipe, 9), found.speed, found.frequency)
        assert found.speed == pytest.approx(float(exact[0]), rel=1e-11)
        assert found.frequency == pytest.approx(float(exact[1]), rel=1e-11)


@of_models
def test_at_each_crossing_it_is_kelvin_voigt_damping(make):
    """All flutter up to u = 14, each with a damping of its own, the lowest as critical speed."""
    pipe = replace(LOSSY, damping=0.0)
    flutter = [c for c in pp.crossings(make(pipe), 14.0) if c.kind == "flutter"]
    assert flutter
    for crossing in flutter:
        values = pp.eigenvalues(make(viscous_pipe(pipe, crossing.frequency)), crossing.speed)
        apart = np.abs(values - 1j * crossing.frequency).min()
        assert apart < 1e-9 * crossing.frequency
    critical = pp.critical_speed(make(pipe))
    if critical.kind == "flutter":
        same = pp.critical_speed(make(viscous_pipe(pipe, critical.frequency)))
        assert critical.speed == pytest.approx(same.speed, rel=1e-11)


def test_frequencies_of_a_pipe_on_hinges_in_closed_form():
    """lambda = i (k pi)^2 sqrt(1 + i mu) at rest."""
    pipe = pp.Pipe(0.2, hysteresis=0.3, root="pinned", end="pinned")
    values = pp.eigenvalues(pp.Continuum(pipe), 0.0, 6)
    exact = 1j * (np.pi * np.arange(1, 4)) ** 2 * np.sqrt(1.0 + 0.3j)
    np.testing.assert_allclose(values[::2], exact, rtol=1e-11)
    found = pp.critical_speed(pp.Continuum(pipe))
    assert (found.kind, found.speed) == ("divergence", pytest.approx(np.pi, rel=1e-11))


HELD = {
    "spring": {"root": pp.RootSpring(2.0)},
    "supported": {"supports": (0.4,)},
    "guided": {"end": "guided"},
    "tapered": {"stiffness": lambda s: 1.0 - 0.5 * s},
    "inclined": {"jet_angle": 0.3},
    "drawn from rest": {"flow": "aspirating", "inflow_share": 0.3},
}


@pytest.mark.parametrize("how", HELD.values(), ids=HELD)
@pytest.mark.parametrize("make", [*MODELS.values()][:3], ids=[*MODELS][:3])
def test_however_a_pipe_is_held_what_is_lost_is_the_share_of_kelvin_voigt_damping(make, how):
    pipe, u = replace(LOSSY, damping=0.0, **how), 3.0
    plain = make(without(pipe))
    if "jet_angle" in how:
        plain = plain.about(pp.equilibria(plain, u).q[0])
    viscous = plain.with_pipe(replace(plain.pipe, damping=1.0))
    elastic = viscous.operators().damping - plain.operators().damping
    model = plain.with_pipe(pipe)
    np.testing.assert_allclose(model.operators().loss, pipe.hysteresis * elastic, atol=1e-14)
    mass, damping, stiffness = plain.operators().at(u)
    every = companion_eigenvalues(mass, damping, stiffness + 1j * pipe.hysteresis * elastic)
    for value in pp.eigenvalues(model, u, 4)[::2]:
        assert np.abs(every - value).min() < 1e-6 * abs(value)
    if "jet_angle" not in how:
        for one in pp.crossings(model, 10.0):
            if one.frequency:  # 0 where a growing pair appears on the real axis, or vanishes
                same = plain.with_pipe(viscous_pipe(pipe, one.frequency))
                values = pp.eigenvalues(same, one.speed)
                assert np.abs(values - 1j * one.frequency).min() < 1e-8 * one.frequency


@pytest.mark.parametrize("terms", [(), TERMS], ids=["plain", "terms"])
def test_eigenvalues_of_a_chain_by_shooting(terms):
    chain = pp.Chain(replace(LOSSY, terms=terms), 10)
    for value in pp.eigenvalues(chain, 6.0, 10)[::2]:
        assert abs(chain_newton_step(chain, value, 6.0)) < 1e-10 * abs(value)


@of_models
@pytest.mark.parametrize("u", [0.0, 5.0, 9.0])
def test_all_eigenvalues_are_those_of_the_complex_matrices_above_the_axis(make, u):
    model = make(LOSSY)
    mass, damping, stiffness = model.operators().at(u)
    every = companion_eigenvalues(mass, damping, stiffness)
    above = every[every.imag > 0.0]
    found = pp.modes(model, u)
    values, wanted = found.eigenvalues, above[np.argsort(np.abs(above))]
    np.testing.assert_allclose(np.abs(values), np.abs(wanted)[: values.size], rtol=1e-5)
    assert found.converged.all()
    for value, error in zip(values, found.errors, strict=True):
        assert np.abs(wanted - value).min() < 1e-6 * abs(value) + error
    for value, shape in zip(values[:3], found.shapes[:3], strict=True):
        terms = (value**2 * mass, value * damping, stiffness)
        rest = sum(terms) @ shape.coordinates
        size = sum(np.abs(term) for term in terms) @ np.abs(shape.coordinates)
        assert np.abs(rest).max() < 1e-9 * size.max()


@pytest.mark.parametrize("pipe", [pp.Pipe(0.2, -12.0), pp.Pipe(0.2, terms=[pp.Spring(1.0, 50.0)])])
@pytest.mark.parametrize("make", [pp.Continuum, lambda pipe: pp.Chain(pipe, 20)])
def test_divergence_is_that_of_the_pipe_without(make, pipe):
    """A standing pipe that flow straightens, and one that an elastic end lets buckle."""
    still, lossy = (
        [c for c in pp.crossings(make(one), 8.0) if c.kind == "divergence"]
        for one in (pipe, replace(pipe, hysteresis=0.2))
    )
    assert len(still) == len(lossy) > 0
    for one, other in zip(still, lossy, strict=True):
        assert (one.speed, one.unstable_before) == (other.speed, other.unstable_before)
        assert other.frequency == 0.0


def test_divergence_before_flutter_is_the_critical_speed():
    """u^3 + K (sin u - u cos u) = 0 of a pipe whose end a spring holds, K = 50."""
    pipe = pp.Pipe(0.2, hysteresis=0.1, terms=[pp.Spring(at=1.0, stiffness=50.0)])
    found = pp.critical_speed(pp.Continuum(pipe))
    assert (found.kind, found.speed) == ("divergence", pytest.approx(5.03750298, abs=1e-8))
    assert found.sensitivity.speed.hysteresis == 0.0


@pytest.mark.parametrize("make", [*MODELS.values()][:3], ids=[*MODELS][:3])
def test_a_buckled_pipe_has_the_growing_root_of_the_pipe_without(make):
    pipe = pp.Pipe(0.2, -12.0, hysteresis=0.1)
    found, still = (pp.modes(make(one), 0.5, 4) for one in (pipe, without(pipe)))
    grows = found.eigenvalues.real > 0.0
    assert grows.sum() == 1
    assert found.eigenvalues[grows][0] == still.eigenvalues.real.max()
    assert found.errors.max() < 1e-9
    assert not pp.critical_speed(make(pipe)).stable_at_rest
    assert pp.crossings(make(pipe), 4.0)[0].unstable_before == 1


@pytest.mark.parametrize("seed", range(6))
def test_no_crossing_is_missed(seed):
    """Growing roots above the axis, from matrices, number what crossings say, but for those that
    pass the real axis between two speeds."""
    dice = np.random.default_rng(seed)
    pipe = pp.Pipe(dice.uniform(0.05, 0.95), damping=1e-3, hysteresis=10.0 ** dice.uniform(-2, 0))
    model = (pp.Chain(pipe, 7), pp.Galerkin(pipe, 7), pp.Galerkin(pipe, 7, "legendre"))[seed % 3]
    found = pp.crossings(model, 15.0)
    assert found
    surplus, near = [], []
    for u in np.arange(0.02, 15.0, 0.04):
        every = companion_eigenvalues(*model.operators().at(u))
        grows = every[every.real > 1e-9]
        counted = sum(1 if c.destabilising else -1 for c in found if c.speed < u)
        surplus.append(int(np.sum(grows.imag > 0.0)) - counted)
        near.append(np.abs(grows.imag).min(initial=np.inf))
    assert surplus[0] == 0
    for k in np.flatnonzero(np.diff(surplus)):
        assert min(near[k : k + 2]) < 2.0


@of_models
def test_root_loci_are_eigenvalues(make):
    model, speeds = make(LOSSY), np.linspace(0.0, 12.0, 7)
    loci = pp.root_loci(model, speeds, 4)
    known = np.isfinite(loci.eigenvalues)
    assert known.sum() > 20
    np.testing.assert_array_equal(loci.converged, known)
    oscillates = known & (loci.eigenvalues.imag != 0.0)
    assert (loci.partners[oscillates] == loci.eigenvalues[oscillates].conj()).all()
    assert (loci.eigenvalues[known & ~oscillates].real > 0.0).all()
    for u, row in zip(speeds, loci.eigenvalues, strict=True):
        values = pp.eigenvalues(model, u)
        for value in row[np.isfinite(row)]:
            assert np.abs(values - value).min() < 1e-8 * abs(value)


def test_eigenvalues_and_root_loci_of_the_continuous_pipe_by_series():
    values = pp.eigenvalues(pp.Continuum(LOSSY), 6.0, 8)
    assert (values[1::2] == values[::2].conj()).all()
    assert (values[::2].imag > 0.0).all()
    for value in values[::2]:
        assert abs(series_newton_step(LOSSY, value, 6.0)) < 1e-9 * abs(value)
    loci = pp.root_loci(pp.Continuum(LOSSY), [0.0, 3.0, 6.0], 3)
    assert loci.converged.all()
    for u, row in zip(loci.speeds, loci.eigenvalues, strict=True):
        for value in row:
            assert abs(series_newton_step(LOSSY, value, u)) < 1e-8 * abs(value)


def test_the_limit_of_weak_damping_depends_on_the_ratio_to_the_coriolis_force():
    """u_c = F(mu / sqrt(beta)) + O(beta): the last is large enough to be solved as it is."""
    speeds = []
    for size in (1e-12, 1e-6, 2e-4):
        pipe = pp.Pipe(0.04 * size**2, hysteresis=size)
        speeds.append(pp.critical_speed(pp.Galerkin(pipe, 8, "legendre")).speed)
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9)
    assert speeds[0] == pytest.approx(speeds[2], rel=1e-6)


def test_joints_with_a_damping_of_their_own_are_not_the_pipe_s_material():
    scene = md.chain(LOSSY, 6).plus(md.TorsionalSpring(3, 4.0, damping=0.1))
    plain = md.chain(LOSSY, 6)
    np.testing.assert_allclose(scene.operators().loss, plain.operators().loss, atol=1e-12)
    assert md.chain(without(LOSSY), 6).operators().loss is None


def test_a_scene_is_the_chain_and_its_guided_end_is_held():
    pipe = replace(LOSSY, damping=0.0)
    same = pp.critical_speed(md.chain(pipe, 12))
    assert same.speed == pp.critical_speed(pp.Chain(pipe, 12)).speed
    held = pp.critical_speed(md.chain(without(pipe), 12).plus(md.Guide(12)))
    lossy = pp.critical_speed(md.chain(pipe, 12).plus(md.Guide(12)))
    assert (lossy.kind, lossy.speed) == ("divergence", held.speed)


def test_the_equivalent_damping():
    pipe = pp.Pipe(0.2, damping=2e-3, hysteresis=0.1)
    assert pipe.equivalent_damping(12.5) == pytest.approx(0.01, rel=1e-15)
    assert pp.Pipe(0.2, damping=2e-3).equivalent_damping(1.0) == 2e-3
    hose = pp.Pipe.from_si(**HOSE | {"damping_time": 0.0}, hysteresis=0.1)
    assert hose.hysteresis == 0.1
    seconds = hose.time_si(hose.equivalent_damping(hose.frequency_from_si(8.0)))
    assert seconds == pytest.approx(0.1 / 8.0, rel=1e-14)
    assert "hysteresis=0.1" in repr(hose)
    assert pickle.loads(pickle.dumps(hose)) == hose


MOTIONS = {
    "simulate": lambda m: pp.simulate(m, 6.0, 1.0, lambda s: 0.1 * s),
    "simulate_many": lambda m: pp.simulate_many(m, [6.0, 7.0], 1.0, lambda s: 0.1 * s),
    "lyapunov_exponent": lambda m: pp.lyapunov_exponent(m, 6.0, lambda s: 0.1 * s),
    "limit_cycle": lambda m: pp.limit_cycle(m, 7.0),
    "hopf": lambda m: pp.hopf(m),
    "bifurcation_diagram": lambda m: pp.bifurcation_diagram(m, [5.0, 7.0]),
}


@pytest.mark.parametrize("ask", MOTIONS.values(), ids=MOTIONS)
def test_motions_are_refused_with_how_to_find_the_damping_that_loses_as_much(ask):
    model = pp.Chain(replace(LOSSY, damping=0.0), 4)
    with pytest.raises(ValueError, match=r"hysteresis, got 0\.07: .*damping=(\S+) loses") as said:
        ask(model)
    advice = re.search(r"damping=(.*) loses", str(said.value)).group(1)
    names = {"pipe": model.pipe, "critical_speed": pp.critical_speed, "model": model}
    onset = pp.critical_speed(model)
    assert eval(advice, names) == pytest.approx(0.07 / onset.frequency, rel=1e-12)


@of_models
def test_there_are_no_equations_of_motion(make):
    model = make(LOSSY)
    still = np.zeros(2 * model.coordinates)
    for ask in (
        lambda: model.rhs(0.0, still, 5.0),
        lambda: model.jacobian(0.0, still, 5.0),
        lambda: model.power(still, 5.0),
    ):
        with pytest.raises(ValueError, match=r"hysteresis must be 0 in motion, got 0\.07"):
            ask()


def test_the_onset_of_an_aspirating_pipe_in_closed_form():
    """u_c = mu omega_1 / (4 sqrt(beta)), from Re lambda = 2 sqrt(beta) u - mu omega / 2."""
    pipe = pp.Pipe(0.2, flow="aspirating", hysteresis=1e-4)
    found = pp.critical_speed(pp.Continuum(pipe))
    omega = 1.8751040687119611**2
    assert found.frequency == pytest.approx(omega, rel=1e-5)
    assert found.speed == pytest.approx(1e-4 * omega / (4.0 * np.sqrt(0.2)), rel=1e-5)


def test_a_mode_that_strong_damping_keeps_from_oscillating_has_its_growing_root_only():
    pipe = pp.Pipe(0.2, hysteresis=0.1, damping=0.02, end="pinned")
    loci = pp.root_loci(pp.Continuum(pipe), np.linspace(0.0, 8.0, 9), count=3)
    missing = np.isnan(loci.partners)
    assert missing.any()
    assert not missing.all(axis=0).any()
    assert (loci.eigenvalues[missing].real > 0.0).all()
    assert (loci.eigenvalues[missing].imag == 0.0).all()


def test_eigenvalues_at_the_speed_of_a_divergence():
    pipe = pp.Pipe(
        *(0.7, -10.0, "aspirating"), damping=0.05, hysteresis=0.06, inflow_share=0.4, root="pinned"
    )
    model = pp.Chain(pipe, 3)
    u = pp.critical_speed(model).speed
    found, above = (pp.eigenvalues(model, speed) for speed in (u, u * (1.0 - 1e-9)))
    np.testing.assert_allclose(found, above, rtol=1e-6)
