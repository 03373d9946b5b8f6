# SPDX-License-Identifier: MIT
"""Units of length, mass, time and speed in SI, and metadata for numbers in these units."""

from __future__ import annotations

import math
from dataclasses import MISSING, field, fields
from typing import Any, NamedTuple

import numpy as np

from pipedyn.util.archive import saved_as

SLACK = 1e-9
"""Distance in L by which a place may lie beyond the free end: as much as a chain's lengths may miss
1, far above the rounding of sums of lengths."""


@saved_as("Scales")
class Scales(NamedTuple):
    """Values in SI of the nondimensional units of a pipe.

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
    """Scales for another mass ratio, or several, at the same length, EI and total mass."""
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
    """Dataclass field of a term's number: its range, and the powers of `Scales` in its SI unit."""
    rule = {"low": low, "high": high, "open_low": open_low}
    return field(default=default, metadata={"range": rule, "powers": (mass, length, time)})


def text_of(value: Any) -> str:
    """A value as text, with 12 digits of each number."""
    if isinstance(value, tuple):
        return f"({', '.join(map(text_of, value))}{',' * (len(value) == 1)})"
    return f"{value:.12g}" if isinstance(value, float) else repr(value)


def repr_of(one: Any, *more: str) -> str:
    """A dataclass as text: its fields that are not at their defaults, then `more` texts."""
    shown = {item.name: getattr(one, item.name) for item in fields(one) if item.repr}
    defaults = {item.name: item.default for item in fields(one)}
    told = [f"{name}={text_of(of)}" for name, of in shown.items() if of != defaults[name]]
    return f"{type(one).__name__}({', '.join([*told, *more])})"
