# SPDX-License-Identifier: MIT
"""What is fixed to the pipe at one place: point masses and springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipedyn import _core
from pipedyn.util import check
from pipedyn.util.check import Array

RANGES: dict[str, dict[str, Any]] = {
    "at": {"low": 0.0, "high": 1.0, "open_low": True},
    "mass": {"low": 0.0, "high": 1e6},
    "stiffness": {"low": 0.0, "high": 1e9},
}
"""What `check.real` asks of a fitting's numbers."""

SHORTEST_PANEL = 1e-4
"""Length of the shortest panel of a basis. To leave out a joint at the distance d from another
costs d^3, 1e-11 of a critical speed at this length; on panels below a third of it functions move
so little mass that rounding makes their eigenvalues any."""

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


def core_fittings(fittings: tuple[Fitting, ...]) -> list[_core.Fitting]:
    """The fittings as the core takes them."""
    return [_core.Fitting(at=f.at, mass=f.mass, stiffness=f.stiffness) for f in fittings]


def panel_ends(fittings: tuple[Fitting, ...]) -> Array:
    """Ends of the panels between fittings, from 0 to 1: integrands are smooth on each."""
    return np.unique([0.0, *(fitting.at for fitting in fittings), 1.0])


def basis_joints(fittings: tuple[Fitting, ...]) -> Array:
    """Inner ends of the panels of a basis: those of the above that leave none too short."""
    joints: list[float] = []
    for end in panel_ends(fittings)[1:-1].tolist():
        low = joints[-1] if joints else 0.0
        if end - low >= SHORTEST_PANEL and 1.0 - end >= SHORTEST_PANEL:
            joints.append(end)
    return np.array(joints)


def on_panels(ends: Array, nodes: Array, weights: Array) -> tuple[Array, Array]:
    """Nodes and weights of a quadrature on [0, 1] carried to each panel between the ends."""
    lengths = np.diff(ends)[:, None]
    return (ends[:-1, None] + lengths * nodes).ravel(), (lengths * weights).ravel()
