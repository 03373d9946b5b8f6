# SPDX-License-Identifier: MIT
"""The response of the straight pipe to a harmonic force, moment or motion of its base.

The continuous pipe's answers are held against its boundary-value problem: power series along the
pipe, from the equation in the ground's frame, where the base is a boundary condition.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent import series_response

import pipedyn as pp


@pytest.mark.parametrize(
    ("u", "omega", "damping", "expected"),
    [
        (4.0, 4.0, 0.0, 0.435537098 - 0.580465010j),
        (5.0, 13.5, 0.0, -3.953945431 - 8.886436152j),
        (0.0, 2.0, 0.01, 0.741658393 - 0.021991760j),
    ],
)
def test_a_moving_base_moves_the_free_end(u, omega, damping, expected):
    """Relative to the base, beta = 0.2, gamma = 0: two routes that agree to the digits given."""
    pipe = pp.Pipe(0.2, damping=damping)
    found = pp.frequency_response(pp.Continuum(pipe), u, [omega])
    assert found.response[0] == pytest.approx(expected, abs=6e-10)
    assert series_response(pipe, omega, u) == pytest.approx(expected, abs=6e-10)
    assert found.error <= 1e-8


@pytest.mark.parametrize("held", [False, True], ids=["cantilever", "pinned at both ends"])
@pytest.mark.parametrize("driven", ["force", "moment"])
@pytest.mark.parametrize("output", [0.3, 0.6, "tip"])
def test_a_load_inside_the_pipe(driven, output, held):
    ends = {"root": "pinned", "end": "pinned"} if held else {}
    pipe, omega = pp.Pipe(0.3, damping=0.004, **ends), np.array([2.0, 17.0])
    found = pp.frequency_response(
        pp.Continuum(pipe), 2.0, omega, input=(driven, 0.6), output=output
    )
    assert found.output == (pipe.tip_place if output == "tip" else output)
    expected = [series_response(pipe, w, 2.0, (driven, 0.6), found.output) for w in omega]
    np.testing.assert_allclose(found.response, expected, rtol=1e-8)


def test_a_place_that_is_held_does_not_move():
    pipe = pp.Pipe(0.3, end="clamped", damping=0.004)
    for model in (pp.Continuum(pipe), pp.Chain(pipe, 6), pp.Galerkin(pipe, 5)):
        found = pp.frequency_response(model, 2.0, [3.0, 20.0], output=1.0)
        assert np.abs(found.response).max() < 1e-12


@pytest.mark.parametrize("driven", ["base", "force", "moment"])
@pytest.mark.parametrize(
    "terms",
    [(), [pp.Spring(1.0, 30.0)], [pp.Damper(1.0, 0.7)], [pp.Foundation(50.0)]],
    ids=["plain", "spring", "damper", "foundation"],
)
def test_what_rests_on_the_ground_feels_the_base_move(terms, driven):
    pipe = pp.Pipe(0.3, damping=0.004, terms=terms)
    omega = np.array([0.5, 3.0, 14.0, 40.0])
    how = "base" if driven == "base" else (driven, 1.0)
    found = pp.frequency_response(pp.Continuum(pipe), 3.0, omega, input=how)
    expected = [series_response(pipe, w, 3.0, how) for w in omega]
    np.testing.assert_allclose(found.response, expected, rtol=1e-9)
    np.testing.assert_array_equal(found.frequencies, omega)


def test_a_few_solutions_serve_a_long_chain_at_all_frequencies():
    """Against the dense equations in the angles of the segments."""
    pipe = pp.Pipe(0.2, gamma=3.0, damping=1e-4, terms=[pp.Spring(0.5, 40.0)])
    chain = pp.Chain(pipe, 120)
    omega = np.linspace(0.0, 120.0, 40)
    found = pp.frequency_response(chain, 4.5, omega, input=("force", 0.35), output=0.9)
    mass, velocity, stiffness = chain.operators().at(4.5)
    load, output = chain.deflection(np.eye(120), [0.35, 0.9])
    for w, response in zip(omega, found.response, strict=True):
        pencil = stiffness + 1j * w * velocity - w**2 * mass
        assert response == pytest.approx(output @ np.linalg.solve(pencil, load), rel=1e-7)


@pytest.mark.parametrize("damping", [1e-2, 1e-4, 1e-6])
def test_no_resonance_is_missed_however_narrow(damping):
    pipe = pp.Pipe(0.2, damping=damping)
    found = pp.frequency_response(pp.Continuum(pipe), 0.0, (1.0, 150.0))
    modes = (np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349]) ** 2).tolist()
    weak = [w for w in modes if 0.5 * damping * w < 0.1]
    assert len(found.resonances) >= len(weak)
    for omega, peak in zip(weak, found.resonances, strict=False):
        ratio = 0.5 * damping * omega
        assert peak.frequency == pytest.approx(omega, rel=2.0 * max(ratio, 1e-10) + 2.0 * ratio**2)
        assert peak.width == pytest.approx(2.0 * ratio * omega, rel=max(0.1, 10 * ratio))
        height = abs(series_response(pipe, peak.frequency, 0.0))
        assert peak.height == pytest.approx(height, rel=1e-5)
        assert peak.frequency in found.frequencies


def test_lines_between_the_frequencies_are_true_to_the_tolerance():
    model = pp.Galerkin(pp.Pipe(0.2, damping=1e-4), 10, "legendre")
    found = pp.frequency_response(model, 3.0, (0.5, 130.0), tolerance=1e-3)
    rng = np.random.default_rng(0)
    k = rng.integers(0, found.frequencies.size - 1, 2000)
    share = rng.uniform(size=k.size)
    ends = found.frequencies[k], found.frequencies[k + 1]
    values = found.response[k], found.response[k + 1]
    at = ends[0] + share * (ends[1] - ends[0])
    exact = pp.frequency_response(model, 3.0, at).response
    missed = np.abs(values[0] + share * (values[1] - values[0]) - exact)
    assert (missed <= 1.05e-3 * np.maximum(*np.abs(values)) + 1e-9).all()


def test_without_damping_the_response_is_infinite_at_the_modes_frequencies():
    found = pp.frequency_response(pp.Continuum(pp.Pipe(0.2)), 0.0)
    expected = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349]) ** 2
    np.testing.assert_allclose([r.frequency for r in found.resonances], expected, rtol=1e-9)
    assert {r.height for r in found.resonances} == {math.inf}
    assert {r.width for r in found.resonances} == {0.0}
    assert np.isinf(found.response[np.isin(found.frequencies, expected.round(20))]).all()
    assert found.frequencies[0] == 0.0
    assert found.response[0] == 0.0
    assert found.stable


def test_the_response_of_an_unstable_pipe_says_so():
    model = pp.Chain(pp.Pipe(0.2), 20)
    assert pp.frequency_response(model, 5.4, (5.0, 30.0)).stable
    found = pp.frequency_response(model, 6.0, (5.0, 30.0))
    assert not found.stable
    assert any(pole.real > 0.0 for pole in found.poles)


def test_a_scene_responds_like_its_chain():
    pipe = pp.Pipe(0.2, damping=1e-3, terms=[pp.Spring(0.75, 10.0)])
    scene = pp.modular.chain(pipe, 8)
    omega = [1.0, 9.0, 30.0]
    for how in ("base", ("force", 0.5), ("moment", 0.3)):
        one = pp.frequency_response(scene, 4.0, omega, input=how)
        other = pp.frequency_response(pp.Chain(pipe, 8), 4.0, omega, input=how)
        np.testing.assert_allclose(one.response, other.response, rtol=1e-9)


MODEL = pp.Galerkin(pp.Pipe(0.2), 4)


@pytest.mark.parametrize(
    ("given", "error", "rule"),
    [
        ({"input": "bases"}, ValueError, "input must be 'base', ('force', s) or"),
        ({"input": ("push", 0.5)}, ValueError, "input[0] must be one of 'force', 'moment'"),
        ({"input": ("force", 1.5)}, ValueError, "input[1] must lie in (0, 1]"),
        ({"input": 3}, TypeError, "input must be 'base', ('force', s) or"),
        ({"output": "end"}, ValueError, "output must be one of 'tip'"),
        ({"output": 0.0}, ValueError, "output must lie in (0, 1]"),
        ({"frequencies": (3.0, 3.0)}, ValueError, "frequencies must be a range (low, high), low"),
        ({"frequencies": (3.0, 2.0, 1.0)}, ValueError, "frequencies must be a tuple (low, high)"),
        ({"frequencies": []}, ValueError, "frequencies must have from 1 to"),
        (
            {"model": pp.Galerkin(pp.Pipe(0.2, damping=1.0), 1)},
            ValueError,
            "frequencies must be given: at u = 1 no mode oscillates",
        ),
        (
            {"model": pp.Pipe(0.2)},
            TypeError,
            "model must be a Model or a Continuum, got Pipe(beta=0.2): take Continuum(pipe)",
        ),
        ({"model": pp.Chain(pp.Pipe(0.2), 5000)}, ValueError, "model must have at most 4000"),
    ],
)
def test_bad_arguments_are_named(given, error, rule):
    arguments = {"model": MODEL, "u": 1.0} | given
    with pytest.raises(error) as refused:
        pp.frequency_response(arguments.pop("model"), arguments.pop("u"), **arguments)
    assert str(refused.value).startswith(rule)


@pytest.mark.parametrize(
    ("root", "end"), [("pinned", "pinned"), ("clamped", "clamped"), ("clamped", "pinned")]
)
def test_supports_move_with_the_base(root, end):
    """Displacement of the middle, held against the boundary-value problem."""
    pipe = pp.Pipe(0.5, damping=0.003, root=root, end=end)
    u, omega = 2.0, np.array([5.0, 12.0])
    found = pp.frequency_response(pp.Continuum(pipe), u, omega, output=0.5).response
    expected = [series_response(pipe, w, u, output=0.5) for w in omega]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    chain = pp.frequency_response(pp.Chain(pipe, 60), u, omega, output=0.5).response
    np.testing.assert_allclose(chain, found, rtol=0.02)


@pytest.mark.parametrize("driven", ["base", "force"])
def test_a_loss_factor_damps_every_frequency_alike(driven):
    pipe, omega = pp.Pipe(0.2, hysteresis=0.05), np.array([3.0, 22.0, 60.0])
    how = "base" if driven == "base" else (driven, 1.0)
    found = pp.frequency_response(pp.Continuum(pipe), 4.0, omega, input=how)
    expected = [series_response(pipe, w, 4.0, how) for w in omega]
    np.testing.assert_allclose(found.response, expected, rtol=1e-9)
    chain = pp.frequency_response(pp.Chain(pipe, 100), 4.0, omega, input=how)
    np.testing.assert_allclose(chain.response, expected, rtol=2e-2)


def test_a_moment_on_a_chain_errs_by_second_order_wherever_it_acts():
    """In a segment's middle, at a joint that rounding hides, between; also next to a step."""
    held = {"root": "pinned", "end": "pinned"}
    step = {"stiffness": pp.Profile([0.58], [1.0, 0.4])}
    for kind in (held, step):
        pipe = pp.Pipe(0.3, 7.0, damping=0.004, **kind)
        for s in (0.3, 0.6, 0.37):
            exact = pp.frequency_response(
                pp.Continuum(pipe), 2.0, [6.0], input=("moment", s), output=0.55
            )
            for n in (20, 40, 60, 80):
                for make in (pp.Chain, pp.modular.chain) if n == 20 else (pp.Chain,):
                    found = pp.frequency_response(
                        make(pipe, n), 2.0, [6.0], input=("moment", s), output=0.55
                    )
                    error = abs(found.response[0] / exact.response[0] - 1.0)
                    assert error < (1.5 if kind is held else 4.0) / n**2


def test_a_base_at_rest_moves_nothing_also_where_no_load_is_borne():
    """A hinged pipe without weight turns freely: at frequency 0 its equations are singular."""
    pipe = pp.Pipe(0.3, root="pinned", damping=0.01)
    for model in (pp.Chain(pipe, 5), pp.Chain(pipe, 80), pp.Galerkin(pipe, 4), pp.Continuum(pipe)):
        found = pp.frequency_response(model, 1.0, [0.0, 1.0]).response
        assert found[0] == 0.0
        assert 0.1 < abs(found[1]) < 10.0
    pushed = pp.frequency_response(pp.Chain(pipe, 5), 1.0, [0.0, 1.0], input=("force", 0.5))
    assert np.isinf(pushed.response[0])
    assert np.isfinite(pushed.response[1])


def test_what_stretches_a_pipe_does_nothing_to_small_motions_of_its_base():
    plain = pp.Pipe(0.2, damping=0.01, root="pinned", end="pinned")
    fixed = replace(plain, terms=[pp.Stretching(100.0)])
    for make in (
        *(pp.Continuum, lambda p: pp.Chain(p, 6), lambda p: pp.Galerkin(p, 5)),
        lambda p: pp.modular.chain(p, 6),
    ):
        one, other = (
            pp.frequency_response(make(pipe), 1.0, [5.0, 20.0]).response for pipe in (fixed, plain)
        )
        np.testing.assert_allclose(one, other, rtol=1e-9)
