# SPDX-License-Identifier: MIT
"""The modular route: scenes put together from parts, each with its own inertia and forces."""

from pipedyn.models.terms import PointMass
from pipedyn.modular.assembly import Assembly, chain
from pipedyn.modular.parts import (
    Clamp,
    Constraint,
    Custom,
    Drag,
    Guide,
    InternalFlow,
    Joint,
    Module,
    Pin,
    Segment,
    TorsionalSpring,
)

__all__ = [
    "Assembly",
    "Clamp",
    "Constraint",
    "Custom",
    "Drag",
    "Guide",
    "InternalFlow",
    "Joint",
    "Module",
    "Pin",
    "PointMass",
    "Segment",
    "TorsionalSpring",
    "chain",
]
