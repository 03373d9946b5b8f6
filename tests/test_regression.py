# SPDX-License-Identifier: MIT
"""A few dozen answers as they were when the package was rebuilt, to what each algorithm warrants.

`python tests/test_regression.py` prints the table anew: for numbers that were wrong, not for those
that moved.
"""

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
    "beam": pp.Galerkin(LOADED, 5),
    "legendre": pp.Galerkin(ASPIRATING, 6, "legendre"),
    "panels": pp.Galerkin(LOADED, 8, "legendre"),
    "scene": pp.modular.chain(LOADED, 5),
    "continuum": pp.Continuum(LOADED),
}


def integrated(model):
    """A state of a bent pipe in motion, in the coordinates that an integrator advances."""
    k = np.arange(1.0, model.integrated + 1.0)
    q, p = 0.5 * np.sin(k), 3.0 * np.sin(k + 1.0)
    if isinstance(model, pp.Galerkin):
        q, p = q / k**2, p / k**2
    return np.append(q, p)


def moving(model):
    """The same as the state that users see."""
    y = integrated(model)
    return model.state(*np.split(y, 2)) if isinstance(model, pp.modular.Assembly) else y


def probe(*arrays):
    """One number for each array."""
    return [float(np.cos(np.arange(x.size)) @ x.ravel()) for x in arrays]


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
    "rhs": lambda model: probe(model.rhs(0.0, moving(model), 6.0)),
    "jacobian": lambda model: probe(model.motion_jacobian(integrated(model), 6.0)),
    "operators": lambda model: probe(*model.operators(moving(model)[: model.dof]).at(6.0)),
    "energy": lambda model: [model.energy(moving(model)), model.power(moving(model), 6.0).total],
    "crossings": lambda model: [c.speed for c in pp.crossings(model, 12.0)],
    **{f.__name__: f for f in (eigenvalues, critical_speed, hopf, cycle, equilibria)},
    "simulate": lambda model: pp.simulate(model, 6.0, 0.3, lambda s: 0.3 * s, rtol=1e-9).tip[-1],
}
TABLE = {  # relative tolerance, and the numbers
    ("rhs", "chain"): (1e-10, [603.00861909]),
    ("rhs", "long"): (1e-10, [-36392293.7229]),
    ("rhs", "aspirating"): (1e-10, [-520.08895706]),
    ("rhs", "beam"): (1e-10, [-137.019901639]),
    ("rhs", "legendre"): (1e-10, [37209.3697557]),
    ("rhs", "panels"): (1e-10, [-16852.6195478]),
    ("rhs", "scene"): (1e-10, [1464.4732941]),
    ("jacobian", "chain"): (1e-10, [-46.8925861768]),
    ("jacobian", "aspirating"): (1e-10, [-22337.9782586]),
    ("jacobian", "panels"): (1e-10, [-803169.854777]),
    ("jacobian", "scene"): (1e-10, [-5417.14478778]),
    ("operators", "aspirating"): (1e-10, [0.0690567012663, -0.597299472955, 10.2037782421]),
    ("operators", "beam"): (1e-10, [23.7854980966, 91.6941317023, 28747.2956866]),
    ("energy", "chain"): (1e-10, [2.01425236812, 9.49120965899]),
    ("energy", "panels"): (1e-10, [0.636936379974, -10.6284967783]),
    ("energy", "scene"): (1e-10, [3.16211860405, 4.93025228685]),
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


if __name__ == "__main__":
    for (asked, of), (digits, _) in TABLE.items():
        numbers = ", ".join(f"{x:.12g}" for x in QUESTIONS[asked](MODELS[of]))
        print(f'    ("{asked}", "{of}"): ({digits:g}, [{numbers}]),')
