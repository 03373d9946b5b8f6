# SPDX-License-Identifier: MIT
"""Options with which `attractors` and `bifurcation_diagram` compute motions."""

from __future__ import annotations

import math
from concurrent import futures
from dataclasses import dataclass
from typing import Any

from pipedyn.models.base import Model
from pipedyn.motion.integrator import MOST_CALLS
from pipedyn.motion.simulate import LARGEST_SAMPLES
from pipedyn.util import check

FIRST_LOOK = 4.0
"""Time after which motions are examined for the first time, some ten periods of flutter; then they
are examined after as much time again or half the time so far. Of 3, 4, 5, 6 and 8 it was measured
to be the cheapest."""

SAMPLES_A_TIME = 100
"""Number of samples in a unit of time: cubics through them give a maximum of flutter to 1e-6."""

EARLY_RECURRENCE = 0.005
"""Distance to an earlier state, relative to a motion's size, below which a cycle is solved for
while the motion is on its way: chaotic motions keep coming back to within a fiftieth."""


@dataclass(frozen=True)
class MotionOptions:
    """Options of motions, including whether exponents of irregular motions are computed."""

    transient: float = 100.0  # time left out
    duration: float = 40.0  # time recorded
    rtol: float = 1e-6
    exponents: bool = True
    seed: int = 0  # seed of random starts
    executor: futures.Executor | None = None  # to which batches are submitted
    shown: bool = False  # whether progress is shown
    recurrence: float = EARLY_RECURRENCE  # share of its size to which a motion must return
    most: float = MOST_CALLS  # most right-hand sides of a motion between two looks

    @staticmethod
    def checked(
        transient: Any,
        duration: Any,
        rtol: Any,
        exponents: Any,
        seed: Any,
        executor: Any,
        progress: Any,
    ) -> MotionOptions:
        """Options with the values that a caller gives, checked; raises ValueError or TypeError."""
        check.executor("executor", executor)
        return MotionOptions(
            transient=check.real("transient", transient, low=0.0, high=1e6),
            duration=check.real("duration", duration, low=1.0, high=1e4),
            rtol=check.real("rtol", rtol, low=1e-12, high=1e-3),
            exponents=check.flag("exponents", exponents),
            seed=check.count("seed", seed, low=0),
            executor=executor,
            shown=check.flag("progress", progress),
        )

    @property
    def samples(self) -> int:
        """The largest number of samples of each motion that are held at a time."""
        return self.samples_of(max(self.duration, 2.0 * FIRST_LOOK))

    def samples_of(self, time: float) -> int:
        """The number of samples of each motion over a time."""
        return max(math.ceil(time * SAMPLES_A_TIME), 100) + 1

    def require_room(self, model: Model) -> None:
        """Refuses records that are too long to be held."""
        numbers = self.samples * model.coordinates
        if numbers > LARGEST_SAMPLES:
            raise ValueError(
                f"duration must ask for at most {LARGEST_SAMPLES} numbers a motion, at "
                f"{SAMPLES_A_TIME} samples a unit of time, got {numbers}"
            )
