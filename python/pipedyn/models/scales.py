# SPDX-License-Identifier: MIT
"""Units of length, mass, time and speed in SI, and numbers that are measured in them."""

from __future__ import annotations

import math
from dataclasses import MISSING, field
from typing import Any, NamedTuple

import numpy as np

from pipedyn.util.archive import saved_as

SLACK = 1e-9
"""Share of the length by which a place may lie beyond the free end, far above rounding of sums of
lengths: as much as a chain's lengths may miss 1."""


@saved_as("Scales")
class Scales(NamedTuple):
    """SI value of one nondimensional unit.

    Example:
        >>> pp.Pipe.from_si(
        ...     length=2.0, bending_stiffness=4.0, pipe_mass=0.75, fluid_mass=0.25
        ... ).scales
        Scales(length=2.0, mass=1.0, time=2.0, speed=2.0)
    """

    length: float
    """L, m"""
    mass: float
    """mu_p + mu_f, kg/m"""
    time: float
    """L^2 sqrt((mu_p + mu_f) / EI), s"""
    speed: float
    """sqrt(EI / mu_f) / L, m/s"""


def scales_at(beta: Any, scales: Scales) -> Scales:
    """Scales at another mass ratio, or several, of a pipe with as much length, EI and mass."""
    with np.errstate(divide="ignore"):
        speed = scales.length / scales.time / np.sqrt(beta)
    if np.ndim(beta):
        return scales._replace(speed=speed)
    same = beta == 0.0 or math.isclose(speed, scales.speed, rel_tol=1e-9)
    return scales if same else scales._replace(speed=float(speed))


def number(
    high: float,
    *,
    mass: int = 0,
    length: int = 0,
    time: int = 0,
    low: float = 0.0,
    open_low: bool = False,
    default: Any = MISSING,
) -> Any:
    """A field of a term: its range, and the powers of the units in its SI value, see `Scales`."""
    rule = {"low": low, "high": high, "open_low": open_low}
    return field(default=default, metadata={"range": rule, "powers": (mass, length, time)})
