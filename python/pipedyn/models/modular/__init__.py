# SPDX-License-Identifier: MIT
"""The modular route: scenes put together from parts, each with its own inertia and forces."""

from pipedyn.models.modular.assembly import Assembly
from pipedyn.models.modular.enforcement import Mechanism
from pipedyn.models.modular.parts import (
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
from pipedyn.models.modular.plain_chain import chain
from pipedyn.models.terms import PointMass

__all__ = [
    "Assembly",
    "Clamp",
    "Constraint",
    "Custom",
    "Drag",
    "Guide",
    "InternalFlow",
    "Joint",
    "Mechanism",
    "Module",
    "Pin",
    "PointMass",
    "Segment",
    "TorsionalSpring",
    "chain",
]
