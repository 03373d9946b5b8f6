# SPDX-License-Identifier: MIT
"""How fast the fastest mode of a model is, and which integrator serves it best."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pipedyn.models.base import Model

CHAIN_DECAY, CHAIN_SEGMENTS = 0.025, 16
"""Fastest decay, relative to the highest frequency of a chain and for each digit asked for, from
which implicit steps pay; beyond so many segments, in proportion to their number. The choice then
costs at most 1.5 times the cheaper of both, measured with 5 to 24 segments at damping 0.001 to 0.1,
rtol 1e-3 to 1e-9 and 41 or 51 samples."""

REDUCED_RATE = 40.0
"""|lambda| of the fastest mode of other models, for each digit, from which implicit steps pay:
measured likewise."""

LARGEST_IMPLICIT = 2000
"""Degrees of freedom beyond which dense factorisations are not chosen: one of 4,001 unknowns takes
128 MB and, measured, 4 s on one core."""


def choose_method(model: Model, rtol: float) -> str:
    """The integrator that measured cheapest: "dop853" unless damping makes the motion stiff.

    The fastest mode holds an explicit method to some 2 |lambda| right-hand sides a unit of time.
    "lsoda" leaves it out of account where it decays at once, at the cost of Jacobians and
    factorisations, which weigh less where a right-hand side costs more, as in a reduced model.
    Undamped it follows every mode and costs more (see tests/benchmark_simulate.py).
    """
    if not (model.pipe.damping or model.resisted) or model.moving > LARGEST_IMPLICIT:
        return "dop853"
    fastest, decay, digits = highest_frequency(model), fastest_decay(model), -math.log10(rtol)
    if model.linear_cost:
        share = CHAIN_DECAY * digits * max(1.0, model.moving / CHAIN_SEGMENTS)
        return "lsoda" if decay > share * fastest else "dop853"
    stiff = max(fastest, decay) > REDUCED_RATE * digits
    return "lsoda" if stiff and 0.5 * decay > 0.1 * fastest else "dop853"


def highest_frequency(model: Model) -> float:
    """Angular frequency of the fastest mode at rest, to some per cent, by power iteration."""
    return math.sqrt(_strongest(model.with_pipe(replace(model.pipe, damping=0.0, drag=0.0)), 0))


def fastest_decay(model: Model) -> float:
    """Rate of the fastest decay of velocities at rest, likewise."""
    if not model.resisted:
        return model.pipe.damping * highest_frequency(model) ** 2
    return _strongest(model.with_pipe(replace(model.pipe, drag=0.0)), model.moving)


def _strongest(model: Model, first: int) -> float:
    """Largest ratio of accelerations to coordinates (first 0) or velocities, by iteration."""
    size = model.moving
    rest = np.concatenate([model.resting(), np.zeros(size + 1)])
    at_rest = model.motion.rhs_and_power(0.0, rest, 0.0)[size:-1]
    moved = np.cos(math.pi * np.arange(size)) * np.linspace(1.0, 1.5, size)
    strongest = 0.0
    for _ in range(40):
        largest = float(np.abs(moved).max())
        if largest == 0.0:
            break
        moved *= 1e-6 / largest
        state = rest.copy()
        state[first : first + size] += moved
        answer = model.motion.rhs_and_power(0.0, state, 0.0)[size:-1] - at_rest
        strongest = float(np.linalg.norm(answer) / np.linalg.norm(moved))
        moved = answer
    return strongest
