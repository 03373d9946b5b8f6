# SPDX-License-Identifier: MIT
"""The modular route: scenes put together from parts, each with its own inertia and forces."""

from types import ModuleType as _ModuleType

from pipedyn.models.terms import PointMass as PointMass
from pipedyn.modular.assembly import Assembly as Assembly
from pipedyn.modular.assembly import chain as chain
from pipedyn.modular.parts import Clamp as Clamp
from pipedyn.modular.parts import Constraint as Constraint
from pipedyn.modular.parts import Custom as Custom
from pipedyn.modular.parts import Drag as Drag
from pipedyn.modular.parts import Guide as Guide
from pipedyn.modular.parts import InternalFlow as InternalFlow
from pipedyn.modular.parts import Joint as Joint
from pipedyn.modular.parts import Module as Module
from pipedyn.modular.parts import Pin as Pin
from pipedyn.modular.parts import Segment as Segment
from pipedyn.modular.parts import TorsionalSpring as TorsionalSpring
from pipedyn.util.hints import with_hints as _with_hints

__all__ = sorted(
    name for name, one in globals().items() if not isinstance(one, _ModuleType) and name[0] != "_"
)
globals().update({name: _with_hints(globals()[name], __name__) for name in __all__})


def __dir__() -> list[str]:
    return __all__
