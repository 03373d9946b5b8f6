# SPDX-License-Identifier: MIT
"""What changes along a branch of cycles, as Floquet multipliers show."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.linear.eigenproblem import Complex
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.result import result

UNIT = 1e-6
"""By how much multipliers may exceed 1 on a stable cycle: as far as the trivial one may be off."""

SAME = 1e-4
"""Relative difference below which two cycles, or the speeds of two events, are the same: measured,
orbits on a coarse mesh (`limit_cycle.FIRST_DEFECT`) are off by 4e-6 at most."""

EventKind = Literal[
    "fold", "pitchfork", "period doubling", "torus", "hopf", "infinite period", "end"
]


@result
class CycleEvent:
    """Where the stability of a branch of cycles changes, or the branch turns or ends.

    Attributes:
        kind: "fold" (the branch turns back), "pitchfork" (a cycle that is its own mirror image
            meets two that are not), "period doubling" (it meets one of twice its period: a
            multiplier passes -1), "torus" (a pair passes the unit circle), "hopf" (its
            amplitude falls to 0), "infinite period" (the frequency falls towards 0, as where a
            cycle meets an equilibrium) or "end" (it was not followed further).
        speed: u.
        error: half the interval of speeds that is known to hold it.
        multiplier: the one that passes, where it does, on the unit circle: 1 at a fold and a
            pitchfork, as where the branch begins or ends, -1 at a doubling.
        amplitude: of the cycle.
    """

    kind: EventKind
    speed: float
    error: float
    multiplier: complex
    amplitude: float

    def same(self, other: CycleEvent) -> bool:
        """Whether two branches meet in one event; raises TypeError for what is no event."""
        if not isinstance(other, CycleEvent):
            raise TypeError(f"other must be a CycleEvent, got {check.shown(other)}")
        apart = abs(self.speed - other.speed)
        near = SAME * self.speed + 3.0 * (self.error + other.error)
        equal = abs(self.amplitude - other.amplitude) <= 0.1 * self.amplitude
        return self.kind == other.kind and apart <= near and equal


def nontrivial(multipliers: ArrayLike) -> Complex:
    """All multipliers but the one nearest to 1."""
    given = np.asarray(multipliers, dtype=np.complex128)
    return np.delete(given, int(np.argmin(np.abs(given - 1.0))))


def growth(multipliers: ArrayLike) -> Array:
    """Logarithms of the moduli of all but the trivial one, relative to 1 + UNIT, falling."""
    sizes = np.sort(np.abs(nontrivial(multipliers)))[::-1]
    return np.asarray(np.log(np.maximum(sizes, 1e-300) / (1.0 + UNIT)))


def crossing_event(roots: ArrayLike, mirrored: bool) -> tuple[EventKind, complex]:
    """What a multiplier that passes the unit circle does, and that multiplier.

    One that passes 1 makes a fold. With a mirror symmetry of the cycle the multipliers are squares
    of their `roots`, the eigenvalues of the map over half a period and the reflection, which
    distinguish a pitchfork from a fold. Without one the roots are the multipliers themselves.
    """
    others = nontrivial(roots)
    nearest = complex(others[int(np.argmin(np.abs(np.abs(others) - 1.0)))])
    kind: EventKind = "torus"
    if abs(nearest.imag) < 1e-3 * abs(nearest):  # two that meet split by sqrt(error)
        flipped: EventKind = "pitchfork" if mirrored else "period doubling"
        kind = "fold" if nearest.real > 0.0 else flipped
        nearest = complex(math.copysign(1.0, nearest.real))
    nearest /= abs(nearest)
    return kind, nearest**2 if mirrored else nearest
