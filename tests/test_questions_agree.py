# SPDX-License-Identifier: MIT
"""All questions about the linear pipe say the same of the same pipe, of each kind that there is."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import jv

import pipedyn as pp

PIPES = {
    "cantilevered": (pp.Pipe(0.3, 10.0, damping=1e-3), 12.0),
    "standing, unstable at rest": (pp.Pipe(0.1, -10.0, damping=2e-3), 5.0),
    "standing high": (pp.Pipe(0.3, -60.0, damping=5e-3), 9.0),
    "buckled by the flow": (pp.Pipe(0.2, root="pinned", end="pinned", damping=2e-3), 7.0),
    "on a foundation": (
        pp.Pipe(0.3, end="clamped", damping=1e-3, terms=(pp.Foundation(800.0),)),
        11.0,
    ),
    "on two supports": (
        pp.Pipe(0.3, root="pinned", end="pinned", supports=(1 / 3, 2 / 3), damping=1e-4),
        16.0,
    ),
    "guided with hysteresis": (pp.Pipe(0.2, hysteresis=0.05, end="guided"), 3.5),
    "cantilevered with hysteresis": (pp.Pipe(0.2, hysteresis=0.05), 7.0),
    "standing with hysteresis": (pp.Pipe(0.2, -5.0, hysteresis=0.02), 6.0),
    "aspirating, overdamped": (
        pp.Pipe(0.4, flow="aspirating", damping=1e-3, terms=(pp.Viscosity(30.0),)),
        6.0,
    ),
    "aspirating": (pp.Pipe(0.4, flow="aspirating", alpha=0.8, damping=1e-3), 2.0),
}

MODELS = [
    pytest.param(lambda pipe: pp.Galerkin(pipe, 10, "legendre"), id="legendre"),
    pytest.param(lambda pipe: pp.Chain(pipe, 15), id="chain"),
    pytest.param(pp.Continuum, id="continuum"),
]
LONG_SEARCHES = {"on a foundation", "on two supports", "standing, unstable at rest"}
LONG_SEARCHES |= {"buckled by the flow"}
"""Pipes of which a reduced model has many equilibria."""

ASKED = [
    pytest.param(name, *make.values, id=f"{name}-{make.id}", marks=[pytest.mark.slow] * late)
    for make in MODELS
    for name in PIPES
    for late in [make.id == "legendre" and name in LONG_SEARCHES]
]


def ranges(found, end):
    """Ends of the ranges of speed between crossings and the number of unstable roots in each."""
    bounds = [0.0, *(c.speed for c in found), end]
    counts = [found.unstable_at_rest, *(c.unstable_after for c in found)]
    for low, high, count in zip(bounds[:-1], bounds[1:], counts, strict=True):
        if high - low > 1e-3:
            yield low, high, count


@cache
def searched(name, make):
    """A pipe, its model, the end of the search, the crossings, and the one that destabilises."""
    pipe, end = PIPES[name]
    model = make(pipe)
    found = pp.crossings(model, end)
    return pipe, model, end, found, next((c for c in found if c.destabilising), None)


@pytest.mark.parametrize(("name", "make"), ASKED)
def test_speeds_and_numbers_of_unstable_roots_are_the_same(name, make):
    pipe, model, end, found, loss = searched(name, make)
    counted = list(ranges(found, end))
    if pipe.hysteresis and loss is not None:  # beyond, growth is not known for sure
        counted = [one for one in counted if one[1] <= loss.speed]
    if loss is None:
        said = "unstable at rest, where 2 roots grow" if found.unstable_at_rest else "no loss"
        with pytest.raises(pp.NoCrossing, match=said):
            pp.critical_speed(model, end)
    else:
        critical = pp.critical_speed(model, end)
        assert critical.speed == pytest.approx(loss.speed, abs=loss.error + critical.error)
        assert (critical.kind, critical.mode) == (loss.kind, loss.mode)
        assert critical.stable_at_rest == (found[0].unstable_before == 0)
        assert critical.stable_from == max(
            (low for low, high, count in counted if count == 0 and high == loss.speed), default=None
        )
        curve = pp.stability_curve(lambda beta: make(replace(pipe, beta=beta)), [pipe.beta])
        assert curve.speeds == pytest.approx([critical.speed], abs=2.0 * critical.error)
    for low, high, count in counted:
        values = pp.eigenvalues(model, 0.5 * (low + high), 14)
        assert np.sum(values.real > 1e-9 * np.abs(values)) == count
    if isinstance(model, pp.Continuum) or pipe.hysteresis:
        return  # equilibria are asked of neither
    for low, high, count in counted[:2]:  # a search of all equilibria takes a second
        rest = pp.equilibria(model, 0.5 * (low + high))
        straight = int(np.argmin(np.abs(rest.q).max(axis=1)))
        assert np.abs(rest.q[straight]).max() < 1e-9
        assert rest.stable[straight] == (count == 0)


@pytest.mark.parametrize("make", MODELS)
@pytest.mark.parametrize("name", PIPES)
def test_boundaries_pass_where_the_crossings_are(name, make):
    pipe, model, end, found, loss = searched(name, make)
    near = (0.9 * pipe.beta, 1.1 * pipe.beta)
    bounds = pp.boundary(model, "beta", "u", {"beta": near, "u": (0.0, end)}, criticality=False)
    assert bounds.failures == ()
    passed = []
    for curve in bounds.curves:
        for k in np.flatnonzero(np.diff(np.sign(curve.x - pipe.beta))):
            share = (pipe.beta - curve.x[k]) / (curve.x[k + 1] - curve.x[k])
            passed.append(curve.y[k] + share * (curve.y[k + 1] - curve.y[k]))
    last = loss.speed if pipe.hysteresis and loss else end
    speeds = sorted(speed for speed in passed if speed <= last * 1.001)
    assert speeds == pytest.approx([c.speed for c in found if c.speed <= last], rel=1e-3)
    for low, high, count in ranges(found, end):
        if high <= last:
            assert bounds.unstable(pipe.beta, 0.5 * (low + high)) == count


@pytest.mark.parametrize("gamma", [-60.0, -200.0, -2e4])
@pytest.mark.parametrize("make", [pp.Continuum, lambda pipe: pp.Chain(pipe, 200)])
def test_a_standing_pipe_is_told_in_how_many_modes_it_buckles_by_its_weight(gamma, make):
    """Greenhill: those with J_{-1/3}(2/3 sqrt(gamma_k)) = 0 and gamma_k < -gamma."""
    x = np.linspace(1e-3, 2.0 / 3.0 * np.sqrt(-gamma), 20_001)
    modes = np.count_nonzero(np.diff(np.sign(jv(-1.0 / 3.0, x))))
    found = pp.crossings(make(pp.Pipe(0.3, gamma, damping=1e-3)), 0.5)
    assert found.unstable_at_rest == modes
    assert repr(found).startswith(f"Crossings(unstable_at_rest={modes}, ")
