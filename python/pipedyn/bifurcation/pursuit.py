# SPDX-License-Identifier: MIT
"""One cycle followed to a flow speed, past folds, by arc length on panels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from pipedyn.bifurcation.arcs import Birth, arc, from_birth
from pipedyn.bifurcation.collocation import Condition, head, plus, solved
from pipedyn.bifurcation.fourier import Elsewhere
from pipedyn.bifurcation.mesh import EDGES, Course, course_of, drawn, on_edges
from pipedyn.bifurcation.vector_field import Field
from pipedyn.util.check import Array

FIRST, LONGEST, SHORTEST = 0.05, 0.3, 1e-4
"""Steps: in L of the free end, and in the logarithms of speed and frequency."""

STRAIGHT = 0.8
"""Cosine of the angle between steps below which one is made shorter."""

ROUGH, TOLERANCE = 1e-3, 1e-5
"""Roughness of the panels on the way, and Newton's last step."""

PROBE: Array = np.linspace(0.0, 2.0 * math.pi, 65)
"""Phases among which the free end's extremes are looked for."""

HALVINGS = 8
"""Of the last step."""

MOST_STEPS = 60
"""Cycles that are computed on the way."""


def pursued(motion: Field, birth: Birth, u: float, most: int) -> Course:
    """The cycle at a speed to which those born at an onset lead.

    Args:
        motion: the model's.
        birth: the onset.
        u: the speed.
        most: evaluations of right-hand sides and Jacobians after which it is given up.

    Raises:
        Elsewhere: if they do not lead there, or not so soon.
    """
    born = next(arc(motion, from_birth(motion, birth)))
    last, here = _alike(motion, *(course_of(motion, o, ROUGH) for o in (born.begin, born.end)))
    swing = 0.5 * float(np.ptp(motion.tip(here.states(PROBE))))
    unit, least = here.size / swing, 0.25 * here.size
    length, begun, stopped = FIRST, motion.evaluations, "it takes too many steps"
    passed = [last, here]
    for _ in range(MOST_STEPS):
        if (last.u - u) * (here.u - u) <= 0.0 and last.u != here.u:
            return _landed(motion, last, here, unit, u)
        if motion.evaluations > begun + most:
            break
        if not 0.5 * min(u, birth.speed) < here.u < 1.5 * max(u, birth.speed):
            stopped = f"it goes off to u = {here.u:.6g}"
            break
        try:
            found, length = _stepped(motion, last, here, unit, length)
        except Elsewhere as reason:
            stopped = f"it is lost at u = {here.u:.6g}, where {reason}"
            break
        if found.size < least or _turned_over(here, found):
            stopped = f"it shrinks to rest at u = {found.u:.6g}"
            break
        last, here = _alike(motion, here, found)
        passed.append(here)
    told = f"does not come to u = {u:g}: {stopped}"
    turn = _turn(motion, passed, unit, u)
    if turn is not None and (turn < birth.speed) == (u < birth.speed):
        told = f"reaches {'down' if u < turn else 'up'} to u = {turn:.6g} only"
    raise Elsewhere(f"the cycle born at u = {birth.speed:.6g} {told}")


def _turn(motion: Field, passed: list[Course], unit: float, u: float) -> float | None:
    """The speed nearest to another at which cycles on the way turned back; None if none did."""
    speeds = [course.u for course in passed]
    turns = [
        i
        for i in range(1, len(speeds) - 1)
        if (speeds[i] - speeds[i - 1]) * (speeds[i + 1] - speeds[i]) < 0.0
        and (u - speeds[i]) * (speeds[i] - speeds[i - 1]) > 0.0
    ]
    if not turns:
        return None
    k = min(turns, key=lambda i: abs(speeds[i] - u))
    last, here = _alike(motion, passed[k - 1], passed[k])
    line, sign = _Line(motion, last, here, unit), math.copysign(1.0, u - here.u)
    try:
        reach = line.length(head(passed[k + 1]) - head(here))
        found = minimize_scalar(
            lambda length: -sign * line.at(motion, here, float(length)).u,
            bounds=(-line.covered, STRAIGHT * reach),
            method="bounded",
            options={"xatol": 1e-3 * reach},
        )
    except Elsewhere:
        return None
    return float(-sign * found.fun)


def _turned_over(here: Course, found: Course) -> bool:
    """Whether a cycle passed through rest, beyond which it is the same half a period later."""
    half = here.starts.shape[1] // 2
    a, b = (
        c.starts[:, :half] - (0.0 if c.half else c.starts[:, :half].mean(axis=0))
        for c in (here, found)
    )
    return float((a * b).sum()) < 0.0


def _alike(motion: Field, last: Course, here: Course) -> tuple[Course, Course]:
    """Two courses on panels that suit the second."""
    rough = here.roughness()
    short = np.count_nonzero(rough <= 1e-3 * ROUGH) > EDGES.size
    if last.edges.size == here.edges.size and rough.max() <= ROUGH and not short:
        return last, here
    here = drawn(motion, here.states, here.frequency, here.u, here.half, ROUGH)
    return on_edges(motion, last.states, here.edges, last.frequency, last.u), here


def _towards(last: Course, here: Course, u: float) -> Course:
    """What a line through two courses tells at a speed."""
    guess = plus(here, *_change(last, here), (u - here.u) / (here.u - last.u))
    return replace(guess, u=u)


def _change(last: Course, here: Course) -> tuple[Array, Array, float, float]:
    return (
        *(here.starts - last.starts, here.pushes - last.pushes),
        *(here.frequency - last.frequency, here.u - last.u),
    )


def _landed(motion: Field, last: Course, here: Course, unit: float, u: float) -> Course:
    """The cycle at a speed between those of two, which come nearer where the branch is steep."""
    for _ in range(HALVINGS):
        try:
            found = solved(motion, _towards(last, here, u), TOLERANCE)
            if 0.5 < found.size / here.size < 2.0:
                return found
        except Elsewhere:
            pass
        line = _Line(motion, last, here, unit)
        middle = line.at(motion, here, -0.5 * line.covered)
        if (middle.u - u) * (here.u - u) <= 0.0:
            last = middle
        else:
            here = middle
    raise Elsewhere(f"Newton's method does not settle at u = {u:g}")


class _Line:
    """The line through two courses, and the condition that a third be so far along it."""

    def __init__(self, motion: Field, last: Course, here: Course, unit: float) -> None:
        self.weights = np.full(motion.size + 2, unit**-2)
        self.weights[motion.half : -2] /= here.frequency**2
        self.weights[-2:] = here.frequency**-2, here.u**-2
        self.change = _change(last, here)
        along = head(here) - head(last)
        self.covered = self.length(along)
        # Not along the motion, which would be the same cycle from another phase on.
        turning = self.weights * np.append(motion(here.starts[:1].T, here.u)[:, 0], [0.0, 0.0])
        turning = turning / np.linalg.norm(turning)
        self.rows = np.stack([turning, self.weights * along / self.covered])
        self.begin = self.rows @ head(here)

    def length(self, change: Array) -> float:
        """Of a change of (y(0), omega, u)."""
        return math.sqrt(float(self.weights @ change**2))

    def at(self, motion: Field, here: Course, length: float) -> Course:
        """The cycle at a length from the second course.

        Raises:
            Elsewhere: if Newton's method does not settle.
        """
        guess = plus(here, *self.change, length / self.covered)
        if guess.u <= 0.0 or guess.frequency <= 0.0:
            raise Elsewhere("it leaves positive speeds")
        condition = Condition(self.rows, self.begin + np.array([0.0, length]))
        return solved(motion, guess, TOLERANCE, condition)


def _stepped(
    motion: Field, last: Course, here: Course, unit: float, length: float
) -> tuple[Course, float]:
    """The next cycle, and the length to try next."""
    line = _Line(motion, last, here, unit)
    while True:
        try:
            found = line.at(motion, here, length)
            if length > STRAIGHT * line.length(head(found) - head(here)):
                return found, min(1.5 * length, LONGEST)
            raise Elsewhere("it turns too sharply")
        except Elsewhere:
            if length <= SHORTEST:
                raise
            length = max(0.4 * length, SHORTEST)
