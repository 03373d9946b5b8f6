# SPDX-License-Identifier: MIT
"""The end coefficient of an ejecting pipe: what a nozzle or a diffuser does.

With U sqrt(alpha) for U and beta / alpha for beta every equation of the pipe with alpha is that of
the pipe without (Gregory and Paidoussis' scaling), at any amplitude.
"""

import dataclasses
import math

import numpy as np
import pytest

import pipedyn as pp

MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 12),
    "beam": lambda pipe: pp.Galerkin(pipe, 8),
    "legendre": lambda pipe: pp.Galerkin(pipe, 8, "legendre"),
    "continuum": pp.Continuum,
}
NOZZLES = [0.8, 2.0, 100.0, 1e6]


def without(pipe):
    """The pipe of the same motion with a plain end, whose flow is sqrt(alpha) times as fast."""
    return dataclasses.replace(pipe, beta=pipe.beta / pipe.alpha, alpha=1.0)


@pytest.mark.parametrize("alpha", NOZZLES)
@pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)
@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_nozzle_scales_critical_speeds(make, alpha):
    pipe = pp.Pipe(0.2, gamma=5.0, alpha=alpha, damping=1e-3, terms=[pp.PointMass(1.0, 0.1)])
    found, plain = pp.critical_speed(make(pipe)), pp.critical_speed(make(without(pipe)))
    assert found.speed * math.sqrt(alpha) == pytest.approx(plain.speed, rel=1e-11)
    assert found.frequency == pytest.approx(plain.frequency, rel=1e-11)


@pytest.mark.parametrize("make", [*MODELS.values()][:3], ids=[*MODELS][:3])
def test_a_nozzle_scales_motions_of_any_amplitude(make):
    pipe = pp.Pipe(0.3, gamma=2.0, alpha=1.7, drag=0.5, damping=1e-2)
    model, plain, u = make(pipe), make(without(pipe)), 4.0
    y = np.concatenate([model.bent(lambda s: 1.5 * s), model.bent(lambda s: np.sin(3.0 * s))])
    faster = u * math.sqrt(1.7)
    for name in ("rhs", "jacobian"):
        found, expected = (
            getattr(of, name)(0.0, y, speed) for of, speed in ((model, u), (plain, faster))
        )
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max())


def test_a_nozzle_scales_the_hopf_bifurcation():
    pipe = pp.Pipe(0.3, alpha=1.7, damping=1e-3)
    found, plain = (pp.hopf(pp.Chain(one, 5)) for one in (pipe, without(pipe)))
    assert found.lyapunov == pytest.approx(plain.lyapunov, rel=1e-8)
    assert found.speed * math.sqrt(1.7) == pytest.approx(plain.speed, rel=1e-12)


SI = {"length": 1.0, "bending_stiffness": 0.1, "pipe_mass": 0.1, "fluid_mass": 0.1}


def test_a_nozzle_is_given_by_its_ratio_of_areas():
    assert pp.Pipe.from_si(**SI, nozzle_ratio=4.0).alpha == 4.0
    assert pp.Pipe.from_si(**SI).alpha == 1.0
    jet = pp.end_coefficient(lambda r: 1.0, radius=0.5, section=math.pi)
    assert pp.Pipe.from_si(**SI, alpha=jet).alpha == pytest.approx(4.0, rel=1e-12)
    for alpha in (2.0, 1.0):
        with pytest.raises(ValueError, match=r"^alpha or nozzle_ratio must be given, not both"):
            pp.Pipe.from_si(**SI, nozzle_ratio=4.0, alpha=alpha)
    with pytest.raises(ValueError, match=r"^nozzle_ratio must be that of an ejecting pipe"):
        pp.Pipe.from_si(**SI, nozzle_ratio=4.0, flow="aspirating")
