# SPDX-License-Identifier: MIT
"""SI units of the numbers in results, for a pipe that has scales."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import MappingProxyType
from typing import Any, NamedTuple


class Unit(NamedTuple):
    """An SI unit and a function that gives the value of a nondimensional 1 from `Scales`."""

    name: str
    scale: Callable[[Any], Any]


SPEED = Unit("m/s", lambda scales: scales.speed)
FREQUENCY = Unit("Hz", lambda scales: 1.0 / (2.0 * math.pi * scales.time))
"""Unit of angular frequencies, which are shown as frequencies in Hz."""
TIME = Unit("s", lambda scales: scales.time)
RATE = Unit("1/s", lambda scales: 1.0 / scales.time)
LENGTH = Unit("m", lambda scales: scales.length)
VELOCITY = Unit("m/s", lambda scales: scales.length / scales.time)
"""Unit of velocities of points of the pipe; the unit of flow speeds is `SPEED`."""
POWER = Unit("W", lambda scales: scales.mass * scales.length**3 / scales.time**3)
ENERGY = Unit("J", lambda scales: scales.mass * scales.length**3 / scales.time**2)

UNIT_OF: MappingProxyType[str, Unit] = MappingProxyType(
    {
        **dict.fromkeys(("speed", "speeds", "flow_speed", "u"), SPEED),
        **dict.fromkeys(("frequency", "frequencies", "threshold_frequency"), FREQUENCY),
        **dict.fromkeys(("t", "period", "duration"), TIME),
        **dict.fromkeys(("eigenvalue", "eigenvalues", "partners", "poles"), RATE),
        **dict.fromkeys(("growth_rate", "qdot"), RATE),
        **dict.fromkeys(("tip", "tips", "amplitude", "amplitudes", "highest"), LENGTH),
        "energy": ENERGY,
        "tip_velocity": VELOCITY,
    }
)
"""Units of numbers and arrays in results and of columns of tables, by name. A class of results may
state other units."""
