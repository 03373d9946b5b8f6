# SPDX-License-Identifier: MIT
"""Supports of a pipe: its root, its other end and rigid supports between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pipedyn.models.scales import SLACK, checked_place, given_fields, number, repr_of
from pipedyn.util import check
from pipedyn.util.archive import saved_as

End = Literal["free", "guided", "pinned", "clamped"]
ROOTS: tuple[Literal["clamped", "pinned"], ...] = ("clamped", "pinned")
ENDS = ("free", "guided", "pinned", "clamped")

MOST_SUPPORTS = 100
"""Largest number of inner rigid supports of a pipe: each span between them needs functions."""

SHORTEST_SPAN = 1e-3
"""Least distance in L between two supports, or from a support to an end of the pipe. Two supports
at this distance turn by a third of it under a unit moment: they act as a clamp."""


GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
"""Place on a span, as a share of it, that is no node of its lowest 20 modes: sin(k pi GOLDEN) >
0.08."""


@saved_as("RootSpring", added=("stiffness_across",))
@dataclass(frozen=True)
class RootSpring:
    """A hinged root with a rotational spring, between a hinge and a clamp.

    Attributes:
        stiffness: k >= 0, in EI / L; the moment at the root is k times the pipe's angle there. The
            value 0 is a hinge, and the limit of infinite k is the clamp. The spring has none of the
            pipe's damping.
        stiffness_across: of rotation across the plane z = 0, >= 0, in a model in three dimensions;
            None if it is that of rotation in the plane.

    In `Pipe.from_si`: both in N m/rad.

    Raises:
        ValueError: for a negative stiffness, NaN or infinity.
        TypeError: for an argument that is not a number.

    Source: energy stiffness * theta(0)^2 / 2; in three dimensions (stiffness * a_x^2 +
    stiffness_across * a_z^2) / 2 with the rotation vector (a_x, a_z) of the tangent at the root. In
    a chain the springs for both directions lie in series with the first joint.

    Example:
        >>> import pipedyn as pp
        >>> pp.Pipe(beta=0.2, root=pp.RootSpring(2.0))
        Pipe(beta=0.2, root=RootSpring(stiffness=2))
    """

    stiffness: float = number(1e9, mass=1, length=3, time=-2)
    stiffness_across: float | None = number(1e9, mass=1, length=3, time=-2, default=None)

    def __post_init__(self) -> None:  # the pipe checks how large it is, as it may be in SI
        for item, value in given_fields(self):
            if not check.is_quantity(value):  # `Pipe.from_si` converts quantities
                vars(self)[item.name] = check.real(item.name, value, low=0.0)

    def across(self) -> RootSpring:
        """The spring whose stiffness along x is that of this one along z."""
        return self if self.stiffness_across is None else RootSpring(self.stiffness_across)

    __repr__ = repr_of


Root = Literal["clamped", "pinned"] | RootSpring


def checked_root(root: Any, given: str = "") -> Root:
    """Checks how a root is held; a spring of zero stiffness becomes "pinned".

    given: text for error messages on the origin of a spring's number.
    """
    if isinstance(root, RootSpring):
        for item, value in given_fields(root):
            check.real(f"root.{item.name}{given}", value, **item.metadata["range"])
        return root if root.stiffness or root.stiffness_across else "pinned"
    check.instance("root", root, str, '"clamped", "pinned" or a RootSpring')
    return check.choice("root", root, ROOTS)


def checked_supports(supports: Any, end: float = 1.0, in_si: bool = False) -> tuple[float, ...]:
    """Checks supports and returns them as ascending arc lengths on a pipe of length `end`.

    Raises ValueError for more than 100 supports, for one that is not inside the pipe, or if two
    supports, or a support and an end of the pipe, are closer than 0.001 L; else TypeError if the
    argument is no sequence of numbers.
    """
    sequence = isinstance(supports, Sequence) and not isinstance(supports, str | bytes | bytearray)
    if not sequence and not (isinstance(supports, np.ndarray) and supports.ndim == 1):
        raise TypeError(f"supports must be a sequence of arc lengths, got {check.shown(supports)}")
    if not len(supports):
        return ()
    if len(supports) > MOST_SUPPORTS:
        raise ValueError(f"supports must be at most {MOST_SUPPORTS}, got {len(supports)}")
    places = sorted(
        checked_place(f"supports[{i}]", s, end, in_si, True) for i, s in enumerate(supports)
    )
    spans = [right - left for left, right in zip([0.0, *places], [*places, end], strict=True)]
    if places and min(spans) < SHORTEST_SPAN * end * (1.0 - SLACK):
        span = spans.index(min(spans))
        left, right = [0.0, *places, end][span : span + 2]
        raise ValueError(
            f"supports must leave spans of at least {SHORTEST_SPAN * end:g}, got "
            f"{right - left:.3g} from {left:g} to {right:g}; supports so close, or so close to an "
            "end of the pipe, are one, which clamps it"
        )
    return tuple(places)
