# SPDX-License-Identifier: MIT
"""Onset of flutter at which a branch of cycles begins, as a function of the second number."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from pipedyn.continuation.arclength import BranchStep
from pipedyn.continuation.tracer import TestFunction
from pipedyn.curves.boundary import Boundary, boundaries_in, checked_window
from pipedyn.curves.boundary_curves import TracedCurve
from pipedyn.curves.event_plane import EventPlane
from pipedyn.curves.organising import others_unstable
from pipedyn.equilibrium.axis_problems import AxisProblem
from pipedyn.linear.modes import largest_speed
from pipedyn.util.check import Array
from pipedyn.util.errors import PipedynError
from pipedyn.util.newton import NewtonFailed

FROM_0 = 1e-3
"""Lower end of a number's range, as a share of its upper end, for the boundary of stability if the
range begins at 0, where matrices have no derivative by the number, as by beta."""

SAME_ONSET = 1e-4
"""Relative difference of speed up to which a boundary is taken to pass the onset of a branch: two
onsets are farther apart."""

OnsetStep = BranchStep[AxisProblem]


class Onset:
    """Boundary of stability of the straight pipe, with the onset of a branch of cycles on it.

    Args:
        plane: plane of an event of cycles, not of forced motions.
        begin: flow speed of the flutter at which the branch begins; NaN if it begins elsewhere.
        fastest: flow speed up to which onsets are of interest.
        shown: whether progress is shown.
    """

    def __init__(
        self, plane: EventPlane, begin: float, fastest: float, shown: bool = False
    ) -> None:
        self.plane, self.failures = plane, list[str]()
        self.found: Boundary | None = None
        self._steps = list[OnsetStep]()  # steps along the onset, whose second number only grows
        second, name = plane.ranges[plane.second], plane.names[plane.second]
        speeds = plane.ranges[1 - plane.second]
        top = min(max(speeds[1], fastest), largest_speed(plane.model))
        ranges = {name: second, "u": (min(speeds[0] or math.inf, 0.1 * top), top)}
        if name in ("beta", "root.stiffness") and second[0] == 0.0:
            ranges[name] = (FROM_0 * second[1], second[1])
        try:
            for one in map(plane.at, ranges[name]):
                if not one.model.pipe.rests_straight or one.model.rests_bent:
                    raise ValueError(f"the straight pipe does not rest, got {one.model!r}")
            # A number without effect on small motions has a level boundary.
            window = checked_window(plane.model, plane.names, ranges, motions=True)
            alone = None, False, True, plane.names, shown  # only where stability is lost
            self.found, curves = boundaries_in(plane.model, window, *alone)
        except (PipedynError, ValueError) as error:
            self.failures.append(f"the onset of flutter was not followed over {name}: {error}")
            return
        lowest = math.inf
        for curve in curves:
            problem = curve.problem
            for steps in self._between_turns(curve):
                for z, speed in self._onsets(steps, plane.value):
                    if math.isnan(begin):
                        wanted = not others_unstable(problem.plane, problem, z) and speed < lowest
                    else:
                        near = abs(speed / begin - 1.0) < SAME_ONSET
                        wanted = near and problem.kind == "flutter"
                    if wanted:
                        lowest, self._steps = speed, steps

    def along(self, values: Array) -> Array:
        """Flow speed of the onset at values of the second number, shape (k,); NaN for no onset."""
        onsets = (self._onsets(self._steps, value) for value in values.tolist())
        return np.array([next((speed for _, speed in each), math.nan) for each in onsets])

    def _between_turns(self, curve: TracedCurve) -> Iterator[list[OnsetStep]]:
        """Steps of the parts of a curve on which the second number does not turn back."""
        i, part = -1 - self.plane.second, list[OnsetStep]()
        for step in curve.steps():
            turns = TestFunction(step, 1e-10 * step.length, lambda point: point.tangent[i])
            first, *others = step.parts([s for _, s in turns.changes(0.0, step.length)])
            part.append(first)
            for other in others:
                yield part
                part = [other]
        yield part

    def _onsets(self, steps: list[OnsetStep], value: float) -> Iterator[tuple[Array, float]]:
        """Onsets on steps at a value of the second number: unknowns and flow speed."""
        second = self.plane.second
        i = -1 - second
        for step in steps:
            problem, window = step.problem, step.problem.plane.window
            share = (value - window.low[second]) / window.size[second]
            if (step.begin.z[i] - share) * (step.end.z[i] - share) <= 0.0:
                problem.renew()
                with suppress(NewtonFailed):
                    z = step.where(share, i)
                    yield z, float(problem.place(z)[1 - second])
