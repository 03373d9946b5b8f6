# SPDX-License-Identifier: MIT
"""The attractor on which a motion ends, as users see it."""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from pipedyn.motion.lyapunov import LyapunovExponent
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.result import LENGTH, Result

Ending = Literal[
    "rest", "periodic", "rotating", "quasi-periodic", "chaotic", "irregular", "unsettled", "failed"
]


@saved_as("Attractor", added=("reason",))
class Attractor(Result, units={"turnings": LENGTH, "period": None}):
    """An attractor on which a motion ends.

    Attributes:
        speed: u.
        start: number of the start of the motion, counted from 0. It is -1 in a bifurcation diagram
            if only a motion that began beside a cycle at a neighbouring speed reached the
            attractor.
        ending: "rest"; "periodic" for a motion that reaches a cycle; "rotating" for one that
            becomes circular, as `rotating_motion` describes; "quasi-periodic" where the
            largest Lyapunov exponent is not above 0 beyond its spread and averages over the record
            converge as they do only on a torus; "chaotic" where the exponent is above 0 by more
            than three times its spread; "irregular" where exponents are not asked for; "unsettled"
            where none of these was shown, see `reason`; or "failed".
        period: number of maxima of the tip's transverse position in a period; 0 unless "periodic"
            or "rotating".
        turnings: transverse positions of the tip where its velocity changes sign, in order, over
            four periods of a cycle or over the recorded time of other motions, shape (K,); at rest
            the position itself. In three dimensions positions are along the direction in which the
            tip moves farthest, towards positive x or z, whichever that is nearer to. If no motion
            ended on an attractor in space but its mirror image is known, they are those of the
            image, whose sign may be the other.
        end: state [p, p'] on the attractor, shape (2 integrated,); empty where the motion failed.
        exponent: the largest Lyapunov exponent, if it is asked for and the motion is irregular.
            Motions at one speed whose turning points are spread alike share the exponent of one of
            them.
        reason: why the motion is "unsettled"; empty otherwise.
    """

    speed: float
    start: int
    ending: Ending
    period: int
    turnings: Array = field(repr=False)
    end: Array = field(repr=False)
    exponent: LyapunovExponent | None = None
    reason: str = ""

    @property
    def repeats(self) -> bool:
        """Whether the motion ends at rest or repeats after a period."""
        return self.ending in ("rest", "periodic", "rotating")

    @property
    def name(self) -> str:
        """The ending in words, with the number of maxima in a period or the exponent of chaos."""
        if self.ending == "periodic":
            return f"periodic, {self.period} maxim{'um' if self.period == 1 else 'a'}"
        if self.ending == "chaotic" and self.exponent is not None:
            return f"chaotic, exponent {self.exponent.value:.2g}"
        return self.ending
