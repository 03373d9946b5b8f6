# SPDX-License-Identifier: MIT
"""Models of every kind, of a pipe with any terms, and all that is asked of their states."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

import pipedyn as pp
from pipedyn import modular

LAWS = sorted(pp.Term.__subclasses__(), key=lambda law: law.__name__)
SPEED = 3.0


def extremes(law: type[pp.Term]) -> list[pp.Term]:
    """A term for each choice of the least and the largest legal number in every field."""
    ends = []
    for item in dataclasses.fields(law):
        rule = item.metadata["range"]
        least = np.nextafter(0.0, 1.0) if rule["open_low"] else rule["low"]
        ends.append((float(least), rule.get("high", 1.0)))  # places end with the pipe
    names = [item.name for item in dataclasses.fields(law)]
    return [law(**dict(zip(names, each, strict=True))) for each in itertools.product(*ends)]


@dataclasses.dataclass(frozen=True)
class Maker:
    """Makes models of one kind, of a pipe that is held in one way."""

    make: Callable[[pp.Pipe], pp.Model]
    held: dict[str, Any] = dataclasses.field(default_factory=dict)

    def __call__(self, *terms: pp.Term) -> pp.Model:
        return self.make(pp.Pipe(0.3, 10.0, damping=0.01, terms=terms, **self.held))

    def takes(self, law: type[pp.Term]) -> bool:
        """What stretches needs an end that is held across; some laws have no motion.

        A law of a user's own may state no load in three dimensions, which refuse it then.
        """
        held = self.held.get("end") in ("pinned", "clamped")
        if law.no_motion or (law is pp.Stretching and not held):
            return False
        try:
            self(extremes(law)[0])
        except ValueError as error:
            return "has no equations in three dimensions here" not in str(error)
        return True


def beam(pipe: pp.Pipe) -> pp.Model:
    return pp.Galerkin(pipe, 5, "beam")


def legendre(pipe: pp.Pipe) -> pp.Model:
    return pp.Galerkin(pipe, 18 + len(pipe.supports), "legendre")


def chain(rule: str) -> Callable[[pp.Pipe], pp.Model]:
    return lambda pipe: pp.Chain(pipe, 4, springs=rule)


def scene(pipe: pp.Pipe) -> modular.Assembly:
    return modular.chain(pipe, 4)


RULES = "consistent", "midpoint", "rayleigh", "uniform", "frequency"
SPANS = {"root": "pinned", "end": "pinned", "supports": (0.5,)}
MAKERS = {f"chain of {rule} springs": Maker(chain(rule)) for rule in RULES} | {
    "pinned chain": Maker(chain("midpoint"), {"end": "pinned"}),
    "chain on supports": Maker(chain("consistent"), SPANS),
    "beam": Maker(beam),
    "legendre": Maker(legendre),
    "clamped beam": Maker(beam, {"end": "clamped"}),
    "beam on supports": Maker(beam, SPANS),
    "legendre on supports": Maker(legendre, SPANS),
    "chain in space": Maker(lambda pipe: pp.Chain(pipe, 4, dimensions=3)),
    "beam in space": Maker(lambda pipe: pp.Galerkin(pipe, 5, dimensions=3)),
    "scene": Maker(scene),
    "clamped scene": Maker(scene, {"end": "clamped"}),
    "held scene": Maker(lambda pipe: scene(pipe).plus(modular.Guide(2))),
}


def states(model: pp.Model, seed: int = 7, count: int = 9) -> np.ndarray:
    """States with angles of up to .3 rad and rates of up to 1, (2 coordinates, count).

    As many as fill the vectors of every level and leave some over.
    """
    dice, size = np.random.default_rng(seed), model.integrated
    p, rates = dice.normal(size=(2, size, count)) / np.arange(1.0, size + 1.0)[:, None]
    for of, largest in ((p, 0.3), (rates, 1.0)):
        of *= largest / model.largest_angle(of)
    q, qdot = model.to_user(*(of.T for of in model.onto_constraints(p, rates)))
    return np.ascontiguousarray(np.concatenate([q, qdot], axis=1).T)


def answers(model: pp.Model, y: np.ndarray) -> dict[str, np.ndarray]:
    """What users ask of one state or several, which are along the last axis."""
    power = model.power(y, SPEED)
    parts = power.flow, power.joints, power.drag, power.others
    found = {"rhs": model.rhs(0.0, y, SPEED), "energy": model.energy(y), "power": np.stack(parts)}
    if y.ndim == 1 or not isinstance(model, modular.Assembly):
        slopes = model.jacobian(0.0, y, SPEED)
        found["jacobian"] = slopes if y.ndim == 1 else np.moveaxis(slopes, 0, -1)
    return found


def deviations(model: pp.Model, y: np.ndarray) -> dict[str, float]:
    """How far the answers to several states are from those to each alone, as a share of these.

    NaN where some answer is not finite.
    """
    batch, worst = answers(model, y), dict[str, float]()
    for j in (0, y.shape[1] // 2, y.shape[1] - 1):
        for name, alone in answers(model, y[:, j].copy()).items():
            if name not in batch:
                continue
            apart = np.abs(batch[name][..., j] - alone).max()
            share = float(apart / max(np.abs(alone).max(), np.finfo(float).tiny))
            worst[name] = max(share, worst.get(name, 0.0), key=lambda x: (np.isnan(x), x))
    return worst
