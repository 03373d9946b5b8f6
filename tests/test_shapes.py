# SPDX-License-Identifier: MIT
"""Shapes and small displacements of every kind of model, however it is held."""

import re

import numpy as np
import pytest

import pipedyn as pp

S = np.linspace(0.0, 1.0, 11)
PINNED = pp.Pipe(0.2, root="pinned", end="pinned", damping=5e-3)
MODELS = {
    "chain": pp.Chain(pp.Pipe(0.2), 6, base=0.1),
    "held chain": pp.Chain(pp.Pipe(0.2, end="clamped", supports=(0.5,)), 8),
    "beam modes": pp.Galerkin(pp.Pipe(0.2), 4),
    "held beam modes": pp.Galerkin(pp.Pipe(0.2, end="guided", supports=(0.4,)), 4),
    "held Legendre functions": pp.Galerkin(PINNED, 5, "legendre"),
    "scene": pp.modular.chain(pp.Pipe(0.2), 4),
    "held scene": pp.modular.chain(pp.Pipe(0.2), 5).plus(pp.modular.Guide(node=3)),
}
every = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def bend(s):
    return np.sin(2.0 * s) - 0.4


def differences(model, s, derivative, configuration, step=1e-5):
    """Displacement or turn of a shape by a step along the axis of a change, from exact shapes."""
    places = np.stack([model.shape(configuration(k * step), s) for k in (-1.0, 1.0)])
    if derivative == 0:
        return (places[1] - places[0])[:, 0] / (2.0 * step)
    turns = np.unwrap(np.arctan2(*np.diff(places, axis=1).transpose(2, 0, 1)), axis=0)
    return (turns[1] - turns[0]) / (2.0 * step)


@every
def test_a_displacement_is_that_of_the_shape_in_any_coordinates_that_a_model_gives(model):
    """Of what `bent` gives, small enough to be a displacement and to meet supports as one."""
    tiny = 1e-7
    q = model.bent(lambda s: tiny * bend(s))
    moved = model.deflection(q, S)
    np.testing.assert_allclose(moved, model.shape(q, S)[:, 0], atol=1e-6 * tiny)
    assert np.abs(moved).max() > 0.01 * tiny
    recorded = pp.simulate(model, 0.0, 0.01, q, samples=2).q.T
    np.testing.assert_allclose(model.deflection(recorded, S)[:, 0], moved, atol=1e-12 * tiny)
    held = [*model.pipe.supports, *([1.0] if model.pipe.end == "pinned" else [])]
    assert all(abs(model.deflection(q, s)) < 1e-6 * tiny for s in held)


@every
def test_one_arc_length_is_asked_as_a_number(model):
    q = model.bent(lambda s: 0.1 * bend(s))
    for number in (0.3, np.float64(0.3), np.array(0.3)):
        for order in (0, 1):
            one = model.deflection(q, number, order)
            assert np.shape(one) == ()
            assert one == model.deflection(q, [0.3], order)[0]
        np.testing.assert_array_equal(model.shape(q, number), model.shape(q, [0.3])[0])
    whole = np.eye(model.dof)
    assert model.deflection(whole, 0.3).shape == (model.dof,)
    assert model.deflection(whole, [0.3]).shape == (1, model.dof)
    mode = pp.modes(model, 1.0).shapes[0]
    assert mode(0.3) == mode([0.3])[0]
    for wrong in (1.1, -0.1, np.nan, True):
        with pytest.raises((ValueError, TypeError), match=r"^s must"):
            model.deflection(q, wrong)
        with pytest.raises((ValueError, TypeError), match=r"^s must"):
            model.shape(q, wrong)


@pytest.mark.parametrize("basis", ["beam", "legendre"])
def test_functions_are_asked_at_one_arc_length(basis):
    model = pp.Galerkin(PINNED, 4, basis)
    np.testing.assert_array_equal(model.functions(0.3, 1), model.functions([0.3], 1)[0])


@pytest.mark.parametrize("basis", ["legendre", pytest.param("beam", marks=pytest.mark.slow)])
def test_displacements_about_a_buckled_pipe_are_those_of_its_exact_shapes(basis):
    """In degrees of freedom, which supports turn with the pipe, and in all amplitudes."""
    pipe = pp.Pipe(0.2, root="pinned", end="pinned", terms=(pp.Tension(-15.0),))
    model = pp.Galerkin(pipe, 3, basis)
    rest = pp.equilibria(model, 1.0).q[1]
    about = model.about(rest)
    by = about.by_coordinates()
    assert np.abs(about.deflection(rest, S, 1)).max() > 0.3
    s = np.linspace(0.0, 1.0, 4001)
    for derivative, at in ((0, s), (1, 0.5 * (s[1:] + s[:-1]))):
        for z in np.eye(model.dof):
            exact = differences(model, s, derivative, lambda k, z=z: rest + k * (by @ z))
            atol = 1e-5 * np.abs(exact).max()  # of differences over 1 / 4000
            np.testing.assert_allclose(about.deflection(z, at, derivative), exact, atol=atol)
            np.testing.assert_allclose(about.deflection(by @ z, at, derivative), exact, atol=atol)


@pytest.mark.parametrize(
    ("name", "listed"),
    [
        ("chain", "(6, ...)"),
        ("held chain", "(6, ...) or (8, ...)"),
        ("held beam modes", "(4, ...) or (5, ...)"),
        ("held scene", "(4, ...) or (5, ...) or (15, ...)"),
    ],
)
def test_other_coordinates_are_refused_with_those_that_are_taken(name, listed):
    with pytest.raises(ValueError, match=re.escape(f"q must have shape {listed}, got (3,)")):
        MODELS[name].deflection(np.zeros(3), 0.5)
