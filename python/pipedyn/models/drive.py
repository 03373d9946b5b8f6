# SPDX-License-Identifier: MIT
"""What drives a pipe in time: a flow whose speed changes, and a base that moves.

The base carries the clamp and all that holds the pipe rigidly (supports, guides, pins); it moves
without turning. Coordinates are counted from it. Springs, dampers, stops, foundations and the fluid
around the pipe rest on the ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.util import check
from pipedyn.util.check import Array

if TYPE_CHECKING:
    from pipedyn.models.pipe import Pipe

ROWS = 7
"""What drives a state: u', then position, velocity and acceleration of the base, x and y each."""

DIRECTIONS = ("x", "y")

LARGEST_FREQUENCY = 1e6
"""Angular: far above any pipe's, far below overflow."""


@dataclass(frozen=True)
class Pulsation:
    """A flow speed that pulsates: u = mean (1 + amplitude cos(frequency t)).

    Called with a time it gives the speed.

    Attributes:
        mean: u_0 >= 0, in sqrt(EI / mu_f) / L.
        amplitude: mu, in [-1, 1], so that the flow does not reverse.
        frequency: angular, in 1 / T, > 0.

    Raises:
        ValueError: for a number out of its range, NaN or infinity.
        TypeError: for what is no number.
    """

    mean: float
    amplitude: float
    frequency: float

    def __post_init__(self) -> None:
        checked = {
            "mean": check.real("mean", self.mean, low=0.0, high=1e6),
            "amplitude": check.real("amplitude", self.amplitude),
            "frequency": _frequency(self.frequency),
        }
        if abs(checked["amplitude"]) > 1.0:
            raise ValueError(
                f"amplitude must lie in [-1, 1], or the flow reverses, got {self.amplitude!r}"
            )
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_si(cls, pipe: Pipe, *, mean: float, amplitude: float, frequency: float) -> Pulsation:
        """Of a pipe made with `Pipe.from_si`: mean in m/s, frequency in rad/s."""
        return cls(pipe.speed(mean), amplitude, pipe.frequency(frequency))

    @property
    def period(self) -> float:
        """In T."""
        return 2.0 * math.pi / self.frequency

    def __call__(self, t: float) -> float:
        return self.mean * (1.0 + self.amplitude * math.cos(self.frequency * t))

    def rate(self, t: float) -> float:
        """du/dt."""
        return -self.mean * self.amplitude * self.frequency * math.sin(self.frequency * t)


@dataclass(frozen=True)
class Harmonic:
    """A base that oscillates: amplitude cos(frequency t) along x or y, y downward.

    Called with a time it gives the position (X, Y).

    Attributes:
        amplitude: in L.
        frequency: angular, in 1 / T, > 0.
        direction: "x", across the pipe, or "y", along it.

    Raises:
        ValueError: for a number out of its range, NaN or infinity, or another direction.
        TypeError: for what is no number.
    """

    amplitude: float
    frequency: float
    direction: str = "x"

    def __post_init__(self) -> None:
        checked = {
            "amplitude": check.real("amplitude", self.amplitude, low=-1e6, high=1e6),
            "frequency": _frequency(self.frequency),
            "direction": check.choice("direction", self.direction, DIRECTIONS),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_si(
        cls, pipe: Pipe, *, amplitude: float, frequency: float, direction: str = "x"
    ) -> Harmonic:
        """Of a pipe made with `Pipe.from_si`: amplitude in m, frequency in rad/s."""
        return cls(pipe.length(amplitude), pipe.frequency(frequency), direction)

    @property
    def period(self) -> float:
        """In T."""
        return 2.0 * math.pi / self.frequency

    def _along(self, value: float) -> tuple[float, float]:
        return (value, 0.0) if self.direction == "x" else (0.0, value)

    def __call__(self, t: float) -> tuple[float, float]:
        return self._along(self.amplitude * math.cos(self.frequency * t))

    def velocity(self, t: float) -> tuple[float, float]:
        """(X', Y')."""
        return self._along(-self.amplitude * self.frequency * math.sin(self.frequency * t))

    def acceleration(self, t: float) -> tuple[float, float]:
        """(X'', Y'')."""
        return self._along(-self.amplitude * self.frequency**2 * math.cos(self.frequency * t))


def _frequency(value: Any) -> float:
    return check.real("frequency", value, low=0.0, high=LARGEST_FREQUENCY, open_low=True)


def drive_of(y: ArrayLike, u_dot: ArrayLike | None, base: ArrayLike | None) -> Array | None:
    """What the core takes beside states (rows,) or (rows, k): (ROWS,), (ROWS, k), or None.

    Args:
        y: the states.
        u_dot: rate of the flow speed, a number or shape (k,); 0 where not given.
        base: position, velocity and acceleration of the base, x and y of each, shape (3, 2) or
            (3, 2, k); at rest where not given.
    """
    if u_dot is None and base is None:
        return None
    columns = np.shape(y)[1:]
    drive = np.zeros((ROWS, *columns))
    if u_dot is not None:
        rate = check.doubles("u_dot", u_dot, "a real number or an array of them")
        if rate.shape not in ((), columns):
            raise ValueError(f"u_dot must be a number or have shape {columns}, got {rate.shape}")
        check.entries("u_dot", np.atleast_1d(rate), np.isfinite(np.atleast_1d(rate)), "be finite")
        drive[0] = rate
    if base is not None:
        moves = check.doubles("base", base, "an array of real numbers")
        if moves.shape[:2] != (3, 2) or moves.shape[2:] not in ((), columns):
            rule = f"(3, 2) or {(3, 2, *columns)}" if columns else "(3, 2)"
            raise ValueError(f"base must have shape {rule}, got {moves.shape}")
        check.entries("base", moves, np.isfinite(moves), "be finite")
        drive[1:] = moves.reshape(6, *moves.shape[2:], *(1,) * (len(columns) + 2 - moves.ndim))
    return drive
