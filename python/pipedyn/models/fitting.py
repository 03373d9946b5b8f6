# SPDX-License-Identifier: MIT
"""What is fixed to the pipe at one place: point masses and springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pipedyn.util import check

RANGES: dict[str, dict[str, Any]] = {
    "at": {"low": 0.0, "high": 1.0, "open_low": True},
    "mass": {"low": 0.0, "high": 1e6},
    "stiffness": {"low": 0.0, "high": 1e9},
}
"""What `check.real` asks of a fitting's numbers."""

MOST_FITTINGS = 400


@dataclass(frozen=True)
class Fitting:
    """A point mass and a transverse spring at one place of the pipe.

    The mass has no extent, no rotary inertia and no part in the flow: the jet leaves through the
    pipe's own section. The spring pulls towards the axis, -stiffness x with the transverse
    displacement x of its place, linear at any amplitude; what the place moves along the axis it
    does not feel.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        mass: in the pipe's whole mass, (mu_p + mu_f) L; its weight gamma * mass is included.
        stiffness: in EI / L^3.

    Raises:
        ValueError: for a number out of its range, or neither mass nor stiffness.
        TypeError: for what is no number.
    """

    at: float
    mass: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        for name, rule in RANGES.items():
            object.__setattr__(self, name, check.real(name, getattr(self, name), **rule))
        if self.mass == self.stiffness == 0.0:
            raise ValueError("mass or stiffness must be > 0, got 0 for both")

    def __repr__(self) -> str:
        parts = [f"{self.at:.12g}"]
        parts += [f"{k}={v:.12g}" for k in ("mass", "stiffness") if (v := getattr(self, k))]
        return f"Fitting({', '.join(parts)})"


def checked_fittings(fittings: Any) -> tuple[Fitting, ...]:
    """The argument, if it is a sequence of fittings.

    Raises:
        ValueError: for more than 400.
        TypeError: for what is no sequence of fittings.
    """
    if not isinstance(fittings, tuple | list):
        raise TypeError(f"fittings must be a tuple or list, got {check.shown(fittings)}")
    for i, fitting in enumerate(fittings):
        if not isinstance(fitting, Fitting):
            raise TypeError(f"fittings[{i}] must be a Fitting, got {check.shown(fitting)}")
    if len(fittings) > MOST_FITTINGS:
        raise ValueError(f"fittings must be at most {MOST_FITTINGS}, got {len(fittings)}")
    return tuple(fittings)
