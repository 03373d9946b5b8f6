# SPDX-License-Identifier: MIT
"""Continuation by arc length: of a user's own equations, and of all branches in the package."""

from pipedyn.continuation.arclength import Continuation, Control
from pipedyn.continuation.own_equations import Branch, MarkedPoint, follow

__all__ = ["Branch", "Continuation", "Control", "MarkedPoint", "follow"]
