# SPDX-License-Identifier: MIT
"""Answers as they were when the package was rebuilt, to what each algorithm warrants."""

import numpy as np
import pytest

import pipedyn as pp

HANGING = pp.Pipe(0.3, 12.0, drag=0.5, damping=1e-3)
TERMS = pp.PointMass(0.4, 0.3), pp.Spring(0.4, 40.0), pp.Damper(0.8, 0.8), pp.Foundation(5.0)
LOADED = pp.Pipe(0.3, 12.0, drag=0.5, damping=1e-3, terms=TERMS)
ASPIRATING = pp.Pipe(0.4, -3.0, "aspirating", 0.7, drag=1.5, damping=0.01)
MODELS = {
    "chain": pp.Chain(HANGING, 4),
    "long": pp.Chain(LOADED, 70),
    "undamped": pp.Chain(pp.Pipe(0.2), 3),
    "standing": pp.Chain(pp.Pipe(0.2, -20.0, damping=0.01), 2),
    "aspirating": pp.Chain(ASPIRATING, 5, springs="midpoint"),
    "legendre": pp.Galerkin(ASPIRATING, 6, "legendre"),
    "panels": pp.Galerkin(LOADED, 8, "legendre"),
    "scene": pp.modular.chain(LOADED, 5),
    "continuum": pp.Continuum(LOADED),
}


def eigenvalues(model):
    found = pp.eigenvalues(model, 6.0, 4)[::2]
    return [*found.real, *found.imag]


def critical_speed(model):
    found = pp.critical_speed(model)
    return [found.speed, found.frequency, found.sensitivity.speed.beta]


def hopf(model):
    found = pp.hopf(model)
    return [found.lyapunov, found.amplitude_law, found.frequency_law]


def cycle(model):
    found = pp.limit_cycle(model, 7.5 if model.pipe.gamma else 4.7)
    return [found.amplitude, found.frequency]


def equilibria(model):
    found = pp.equilibria(model, 1.0)
    return [len(found), np.abs(found.tips[:, 0]).max(), found.growth.max()]


QUESTIONS = {
    "crossings": lambda model: [c.speed for c in pp.crossings(model, 12.0)],
    **{f.__name__: f for f in (eigenvalues, critical_speed, hopf, cycle, equilibria)},
    "simulate": lambda model: pp.simulate(model, 6.0, 0.3, lambda s: 0.3 * s, rtol=1e-9).tip[-1],
}
TABLE = {  # relative tolerance, and the numbers
    ("eigenvalues", "long"): (1e-08, [-11.34487297, -2.399904931, 3.641238308, 14.22026317]),
    ("eigenvalues", "continuum"): (1e-08, [-11.34262554, -2.403455119, 3.64580713, 14.22531458]),
    ("eigenvalues", "scene"): (1e-08, [-11.82576042, -1.777510613, 2.594730819, 13.313581]),
    ("crossings", "aspirating"): (1e-08, [0.0492165550963, 2.02245765643]),
    ("crossings", "standing"): (1e-08, [1.61245154966]),
    ("critical_speed", "chain"): (1e-08, [7.11169802811, 20.5596440825, 3.16433207987]),
    ("critical_speed", "scene"): (1e-08, [7.84783693991, 18.904975382, 3.1008225312]),
    ("critical_speed", "continuum"): (1e-08, [8.96169876361, 21.3503276907, 4.49065215571]),
    ("hopf", "undamped"): (1e-05, [-2.88122413264, 0.312782079586, -1.21823375305]),
    ("hopf", "aspirating"): (1e-05, [-0.00204972129401, 1.00999385508, 0.00788088981753]),
    ("cycle", "undamped"): (1e-06, [0.240080229691, 11.1129385548]),
    ("cycle", "chain"): (1e-06, [0.268448893916, 21.1769191049]),
    ("equilibria", "standing"): (1e-09, [3, 0.715107201073, 3.33540379369]),
    ("simulate", "chain"): (1e-07, [-0.0564290634771, 0.997607582633]),
    ("simulate", "legendre"): (1e-07, [-0.37952313874, 0.857008128548]),
    ("simulate", "panels"): (1e-07, [-0.0340106253581, 0.999138483578]),
}


@pytest.mark.parametrize(("question", "name"), TABLE)
def test_answers_stay_as_they_were(question, name):
    tolerance, expected = TABLE[question, name]
    assert list(QUESTIONS[question](MODELS[name])) == pytest.approx(expected, rel=tolerance)
