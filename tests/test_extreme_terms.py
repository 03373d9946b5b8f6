# SPDX-License-Identifier: MIT
"""Every law at its least and largest legal numbers, alone and among many, in every model.

Continuous integration runs these on the sanitized core, too: what reads or writes beyond its memory
mostly gives right answers elsewhere.
"""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pipedyn as pp
from pipedyn import modular
from pipedyn.models.chain import SPRING_RULES

LAWS = sorted(pp.Term.__subclasses__(), key=lambda law: law.__name__)
CROWD = tuple(pp.Spring((j + 1) / 16, 1.0) for j in range(15))
"""Many terms, with a panel of a reduced model between each two."""

SPEED = 3.0


def extremes(law):
    """A term for each choice of the least and the largest number in every field."""
    ends = []
    for item in dataclasses.fields(law):
        rule = item.metadata["range"]
        least = np.nextafter(0.0, 1.0) if rule["open_low"] else rule["low"]
        ends.append((float(least), rule.get("high", 1.0)))  # places end with the pipe
    return [law(*numbers) for numbers in itertools.product(*ends)]


@dataclasses.dataclass(frozen=True)
class Kind:
    """Models of a pipe that is held in one way."""

    make: Callable[[pp.Pipe], pp.Model]
    held: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __call__(self, *terms):
        return self.make(pp.Pipe(0.3, 10.0, damping=0.01, terms=terms, **self.held))

    def takes(self, law):
        """What stretches needs an end that is held across."""
        return law is not pp.Stretching or self.held.get("end") in ("pinned", "clamped")


def beam(pipe):
    return pp.Galerkin(pipe, 5, "beam")


def legendre(pipe):
    return pp.Galerkin(pipe, 20, "legendre")


def chain(rule):
    return lambda pipe: pp.Chain(pipe, 4, springs=rule)


def scene(pipe):
    return modular.chain(pipe, 4)


SPANS = {"root": "pinned", "end": "pinned", "supports": (0.5,)}
MODELS = {f"chain of {rule} springs": Kind(chain(rule)) for rule in SPRING_RULES} | {
    "pinned chain": Kind(chain("midpoint"), {"end": "pinned"}),
    "chain on supports": Kind(chain("consistent"), SPANS),
    "beam": Kind(beam),
    "legendre": Kind(legendre),
    "clamped beam": Kind(beam, {"end": "clamped"}),
    "beam on supports": Kind(beam, SPANS),
    "legendre on supports": Kind(legendre, SPANS),
    "scene": Kind(scene),
    "clamped scene": Kind(scene, {"end": "clamped"}),
    "held scene": Kind(lambda pipe: scene(pipe).plus(modular.Guide(2))),
    "dense scene": Kind(lambda pipe: modular.chain(pipe, 2, enforcement="udwadia-kalaba")),
}
TAKEN = [(name, law) for name, kind in MODELS.items() for law in LAWS if kind.takes(law)]


def states(model, count=5):
    """States with angles of up to .3 rad and rates of up to 1, (2 coordinates, count).

    More than the vectors of some levels hold, so that some lanes are left over.
    """
    dice, size = np.random.default_rng(7), model.moving
    p, rates = dice.normal(size=(2, size, count)) / np.arange(1.0, size + 1.0)[:, None]
    for of, largest in ((p, 0.3), (rates, 1.0)):
        of *= largest / np.array([model.largest_angle(one) for one in of.T])
    q, qdot = model.recorded(*(of.T for of in model.projected(p, rates)))
    return np.ascontiguousarray(np.concatenate([q, qdot], axis=1).T)


def answers(model, y):
    """What users ask of states, by name, states along the last axis."""
    power = model.power(y, SPEED)
    parts = power.flow, power.joints, power.drag, power.others
    found = {"rhs": model.rhs(0.0, y, SPEED), "energy": model.energy(y), "power": np.stack(parts)}
    if y.ndim == 1 or not isinstance(model, modular.Assembly):
        slopes = model.jacobian(0.0, y, SPEED)
        found["jacobian"] = slopes if y.ndim == 1 else np.moveaxis(slopes, 0, -1)
    return found


def asked(model):
    """Answers to a batch, after each was found to be that of its state alone."""
    y = states(model)
    batch = answers(model, y)
    for j, one in enumerate(y.T.copy()):
        for name, found in answers(model, one).items():
            if name in batch:
                same = batch[name][..., j]
                # Ill-conditioned mass matrices (of 1e6 beside 1, in 20 functions) take digits.
                assert found == pytest.approx(same, rel=0, abs=1e-6 * np.abs(same).max()), name
    return batch


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_answers_are_finite_and_a_batch_has_those_of_its_states(name, law):
    for term in extremes(law):
        for crowd in ((), CROWD):
            for found in asked(MODELS[name](*crowd, term)).values():
                assert np.isfinite(found).all(), term


@pytest.mark.parametrize("name", MODELS)
def test_all_laws_act_together_at_their_least_and_largest_numbers(name):
    taken = [law for law in LAWS if MODELS[name].takes(law)]
    for end in (0, -1):
        for found in asked(MODELS[name](*CROWD, *(extremes(law)[end] for law in taken))).values():
            assert np.isfinite(found).all()


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_motions_go_on_or_say_why_they_stop(name, law):
    for term in extremes(law):
        model = MODELS[name](*CROWD, term)
        try:
            motion = pp.simulate(model, SPEED, 1e-4, lambda s: 1e-3 * s, samples=3, most=200)
        except pp.MotionStopped as stopped:
            motion = stopped.motion
        assert np.isfinite(motion.q).all()
        assert np.isfinite(motion.energy).all()


@pytest.mark.parametrize(("name", "law"), TAKEN)
def test_a_law_without_strength_changes_nothing(name, law):
    """At a place where another term is: elsewhere a reduced model has one panel more."""
    idle = {item.name: 0.0 for item in dataclasses.fields(law)}
    idle |= {name: own for name, own in (("at", 0.5), ("gap", 0.05)) if name in idle}
    for crowd in (CROWD[7:8], CROWD):
        with_it, without = (asked(MODELS[name](*crowd, *more)) for more in ((law(**idle),), ()))
        for what, found in with_it.items():
            expected = without[what]
            assert found == pytest.approx(expected, rel=0, abs=1e-15 * np.abs(expected).max()), what
