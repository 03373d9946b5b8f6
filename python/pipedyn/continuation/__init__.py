# SPDX-License-Identifier: MIT
"""Continuation by arc length: of a user's own equations, and of all branches in the package."""

from pipedyn.continuation.arclength import Continuation, Control
from pipedyn.continuation.own_equations import Branch, MarkedPoint, follow
from pipedyn.util.hints import with_hints

__all__ = ["Branch", "Continuation", "Control", "MarkedPoint", "follow"]
globals().update({name: with_hints(globals()[name], __name__) for name in __all__})


def __dir__() -> list[str]:
    return __all__
