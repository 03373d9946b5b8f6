# SPDX-License-Identifier: MIT
"""States that a model or double precision does not resolve: refused, with the reason."""

import re

import numpy as np
import pytest
import scipy.integrate

import pipedyn as pp
from pipedyn import modular

STIFF = pp.Pipe(0.592138856705, gamma=58.9115777566)
SPANS = pp.Pipe(0.3, 5.0, drag=0.5, end="pinned", supports=(0.5,), terms=[pp.AddedMass(0.3)])
SCENE = modular.chain(pp.Pipe(0.3, 5.0, damping=0.01), 3)
SWING = modular.Custom(nodes=(2,), energy=lambda q: 0.5 * q @ q, name="swing")
MODELS = {
    "chain": pp.Chain(pp.Pipe(0.2, 3.0, drag=1.0), 3),
    "chain on supports": pp.Chain(SPANS, 4),
    "beam": pp.Galerkin(STIFF, 9),
    "legendre": pp.Galerkin(pp.Pipe(0.3, terms=[pp.Spring(0.4, 30.0)]), 5, "legendre"),
    "beam on supports": pp.Galerkin(SPANS, 3),
    "legendre on supports": pp.Galerkin(SPANS, 4, "legendre"),
    "scene": SCENE,
    "held scene": SCENE.plus(modular.Guide(3)),
    "custom scene": SCENE.plus(SWING),
    "scene on supports": modular.chain(SPANS, 4),
}
SIZES = (1e-300, 1.0, 30.0, 1e3, 1e6, 1e30, 1e150, 1e300)


def questions(model, y):
    """What users ask of a state [q, q'], each a call."""
    q, rates = np.split(y, 2)
    columns, turning = q[:, None], rates[:, None]
    small = q[: model.dof]
    return {
        "rhs": lambda: model.rhs(0.0, y, 3.0),
        "rhs of two": lambda: model.rhs(0.0, np.stack([y, 0.5 * y], axis=1), [3.0, 1e100]),
        "rhs, driven": lambda: model.rhs(0.0, y, 3.0, u_dot=1e300),
        "jacobian": lambda: model.jacobian(0.0, y, 3.0),
        "energy": lambda: model.energy(y),
        "power": lambda: vars(model.power(y, 1e100)),
        "tips": lambda: model.tips(columns),
        "tip_velocities": lambda: model.tip_velocities(columns, turning),
        "tip": lambda: model.tip(q),
        "shape": lambda: model.shape(q, [0.0, 0.3, 1.0]),
        "operators": lambda: vars(model.operators(q)),
        "about": lambda: vars(model.about(q).operators()),
        "deflection": lambda: model.deflection(small, [0.5, 1.0]),
        "from_elastic": lambda: model.from_elastic(small),
    }


def numbers(answer):
    parts = answer.values() if isinstance(answer, dict) else [answer]
    return [np.asarray(part) for part in parts if part is not None]


@pytest.mark.parametrize("name", MODELS)
def test_no_finite_state_has_an_answer_that_is_not(name):
    model, dice = MODELS[name], np.random.default_rng(5)
    for size in SIZES:
        for fast in SIZES:
            y = dice.normal(size=2 * model.coordinates)
            y *= np.repeat([size, fast], model.coordinates)
            for question, ask in questions(model, y).items():
                try:
                    answer = ask()
                except (pp.PipedynError, ValueError):
                    continue
                assert all(np.isfinite(part).all() for part in numbers(answer)), (question, y)


@pytest.mark.parametrize("name", MODELS)
def test_states_of_the_size_of_a_motion_are_answered(name):
    model = MODELS[name]
    y = np.append(model.bent(lambda s: 0.2 * s), np.zeros(model.coordinates))
    for answer in (ask() for ask in questions(model, y).values()):
        assert all(np.isfinite(part).all() for part in numbers(answer))


def coiled(model, *angles):
    """States of one shape with these largest angles, a column each."""
    q = np.linspace(1.0, -0.5, model.coordinates)
    q /= model.largest_angle(q)
    return np.concatenate([np.outer(q, angles), np.zeros((model.coordinates, len(angles)))])


@pytest.mark.parametrize(("name", "turned"), [("beam", 60.0), ("legendre", 3000.0)])
def test_a_refusal_says_how_far_the_quadrature_resolves(name, turned):
    model, (far,) = MODELS[name], coiled(MODELS[name], turned).T.copy()
    with pytest.raises(pp.NotResolved, match="rhs cannot be computed of this state") as refused:
        model.rhs(0.0, far, 3.0)
    assert refused.value.members == (0,)
    bent, most = map(float, re.findall(r"([\d.e+]+) rad", str(refused.value)))
    assert bent == pytest.approx(turned, rel=0.01)  # printed in three digits
    within, beyond = coiled(model, 0.99 * most, 1.01 * most).T.copy()
    assert np.isfinite(model.rhs(0.0, within, 3.0)).all()
    for ask in (
        lambda y: model.rhs(0.0, y, 3.0),
        lambda y: model.jacobian(0.0, y, 3.0),
        model.energy,
        lambda y: model.power(y, 3.0),
        lambda y: model.operators(y[: model.dof]),
    ):
        with pytest.raises(pp.NotResolved, match=f"resolve this shape up to {most:.3g} rad"):
            ask(beyond)


def test_a_refusal_names_the_states_of_a_batch(each_level):
    model = MODELS["beam"]
    angles = np.ones(11)
    angles[[2, 3, 7]] = 60.0
    y = coiled(model, *angles)
    for ask in (
        lambda: model.rhs(0.0, y, 3.0),
        lambda: model.jacobian(0.0, y, 3.0),
        lambda: model.energy(y),
        lambda: model.power(y, 3.0),
    ):
        with pytest.raises(pp.NotResolved, match=r"of states 2, 3, 7 \(3 of 11\), the first") as no:
            ask()
        assert no.value.members == (2, 3, 7)
    with pytest.raises(pp.NotResolved, match=r"states 0, 1, 2, 3, 4, \.\.\. \(9 of 9\)"):
        model.rhs(0.0, coiled(model, *np.full(9, 60.0)), 3.0)


@pytest.mark.parametrize("name", ["chain", "scene", "custom scene"])
def test_rates_beyond_double_precision_are_refused(name):
    model = MODELS[name]
    y = np.full((2 * model.coordinates, 2), 0.1)
    y[:, 1] = 1e300
    with pytest.raises(pp.NotResolved, match=r"states 1 \(1 of 2\).* double precision") as refused:
        model.rhs(0.0, y, 3.0)
    assert refused.value.members == (1,)


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_motion_does_not_go_where_a_state_is_refused():
    """Within an integration it is a step that is not taken; an integrator of the user's is told."""
    model = pp.Galerkin(STIFF, 4)
    (start,) = coiled(model, 200.0).T.copy()
    with pytest.raises(pp.MotionStopped):
        pp.simulate(model, 3.0, 0.1, start[: model.dof])
    with pytest.raises(pp.NotResolved):
        scipy.integrate.solve_ivp(lambda t, y: model.rhs(t, y, 3.0), (0.0, 0.1), start)
