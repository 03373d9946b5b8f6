# SPDX-License-Identifier: MIT
"""Cycles as polynomials on panels, whose ends are where the motion asks for them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from pipedyn.bifurcation.fourier import Elsewhere, Equations, Orbit, Phases
from pipedyn.bifurcation.vector_field import Field
from pipedyn.util.check import Array

STAGES = 8
"""Of the Radau method, whose order is one less than twice as many."""

EDGES: Array = np.linspace(0.0, 1.0, 9)
"""Ends of the fewest panels, in spans."""

MOST, HALVINGS = 2000, 12
"""Panels of a span, and halvings of one by which others' values are drawn."""

FEWEST_PHASES, MOST_UNKNOWNS = 16, 3000
"""Equal phases in half a period to begin with, and values at them at most."""

APART = 1e-4
"""Share of the span within which two ends of panels are one."""


class _Radau:
    """Coefficients of the Radau IIA method on [0, 1].

    Attributes:
        nodes: c, shape (s,).
        once, twice: integrals from 0 to each node, and integrals of these, shape (s, s).
        waves: Legendre coefficients from values at the nodes, shape (s, s).
    """

    def __init__(self, stages: int) -> None:
        ends = np.zeros(stages + 1)
        ends[-2:] = -1.0, 1.0
        x = np.sort(legendre.legroots(ends).real)
        x[-1] = 1.0
        self.waves = np.linalg.inv(legendre.legvander(x, stages - 1))
        self.nodes: Array = 0.5 * (x + 1.0)
        self._rises = {
            times: 0.5**times * legendre.legint(self.waves, times, lbnd=-1.0) for times in (1, 2)
        }
        self.once = self.integrals(self.nodes, 1)
        self.twice = self.once @ self.once

    def integrals(self, at: Array, times: int) -> Array:
        """Integrals from 0, once or twice, of the polynomials through values, shape (k, s)."""
        rises = self._rises[times]
        found: Array = legendre.legvander(2.0 * at - 1.0, len(rises) - 1) @ rises
        return found


RADAU = _Radau(STAGES)


@dataclass(frozen=True)
class Course:
    """A cycle, or one half of it of which the other is the mirror image, on panels.

    Attributes:
        edges: phases at which the panels end, from 0 to the span, shape (M + 1,).
        starts: states at the panels' beginnings, shape (M, 2 moving).
        pushes: accelerations at the stages, with constraints rates of whole states, shape
            (M, s, width).
        frequency: omega.
        u: flow speed.
    """

    edges: Array = field(repr=False)
    starts: Array = field(repr=False)
    pushes: Array = field(repr=False)
    frequency: float
    u: float

    @property
    def span(self) -> float:
        """Phase covered."""
        return float(self.edges[-1])

    @property
    def half(self) -> bool:
        """Whether it is one half."""
        return self.span < 4.0

    @property
    def size(self) -> float:
        """Largest extent of a coordinate."""
        p = self.starts[:, : self.starts.shape[1] // 2]
        return float((2.0 * np.abs(p) if self.half else np.ptp(p, axis=0)).max())

    @property
    def mirror(self) -> float:
        """-1 where the state after the span is the mirror image of the first, else 1."""
        return -1.0 if self.half else 1.0

    @property
    def steps(self) -> Array:
        """Times that the panels take, shape (M,)."""
        return np.diff(self.edges) / self.frequency

    @property
    def tied(self) -> bool:
        """Whether whole states' rates are kept."""
        return bool(self.pushes.shape[2] == self.starts.shape[1])

    def stages(self) -> Array:
        """States at the stages, shape (M, s, 2 moving)."""
        return self._states(
            *(self.starts, self.pushes, self.steps[:, None, None]),
            *(RADAU.nodes[:, None], RADAU.once, RADAU.twice),
        )

    def states(self, phase: Array) -> Array:
        """[p, p'] at phases, shape (2 moving, k)."""
        turns = np.floor(phase / self.span)
        inside = phase - turns * self.span
        where = np.clip(np.searchsorted(self.edges, inside, side="right") - 1, 0, None)
        where = np.minimum(where, len(self.starts) - 1)
        share = (inside - self.edges[where]) / np.diff(self.edges)[where]
        once, twice = RADAU.integrals(share, 1)[:, None], RADAU.integrals(share, 2)[:, None]
        y = self._states(
            *(self.starts[where], self.pushes[where], self.steps[where, None, None]),
            *(share[:, None, None], once, twice),
        )
        return np.ascontiguousarray((self.mirror**turns)[:, None] * y[:, 0]).T

    def _states(
        self, starts: Array, pushes: Array, h: Array, share: Array, once: Array, twice: Array
    ) -> Array:
        if self.tied:
            return starts[:, None] + h * (once @ pushes)
        half = pushes.shape[2]
        p, v = starts[:, None, :half], starts[:, None, half:]
        return np.concatenate(
            [p + h * share * v + h**2 * (twice @ pushes), v + h * (once @ pushes)], axis=2
        )

    def roughness(self) -> Array:
        """Share of the largest rate that each panel's last polynomials add, shape (M,)."""
        half = self.starts.shape[1] // 2
        last = np.abs(RADAU.waves[-2:] @ self.pushes[:, :, -half:]).sum(axis=1).max(axis=1)
        rough: Array = self.steps * last / np.abs(self.starts[:, half:]).max()
        return rough


def course_of(motion: Field, orbit: Orbit, tolerance: float) -> Course:
    """An orbit's values on panels whose roughness is below a tolerance."""
    equations = Equations(motion, orbit.phases)

    def states(phase: Array) -> Array:
        return equations.states(orbit, phase)

    return drawn(motion, states, orbit.frequency, orbit.u, orbit.phases.half, tolerance)


def orbit_of(motion: Field, course: Course) -> Orbit:
    """The same cycle by its values at equal phases, as few as it takes.

    Raises:
        Elsewhere: if it takes more than there may be.
    """
    count = FEWEST_PHASES
    while True:
        phases = Phases(count if course.half else 2 * count + 1, course.half)
        y = course.states(phases.at)
        z = y.T if motion.tied else y[: motion.half].T
        orbit = Orbit(phases, np.ascontiguousarray(z), course.frequency, course.u)
        try:
            return Equations(motion, phases).solve(orbit)
        except Elsewhere:
            count *= 2
            if count * z.shape[1] > MOST_UNKNOWNS:
                raise


def drawn(
    motion: Field,
    states: Callable[[Array], Array],
    frequency: float,
    u: float,
    half: bool,
    tolerance: float,
) -> Course:
    """A course through states.

    Args:
        motion: the model's.
        states: [p, p'] at phases, shape (k,) to (2 moving, k).
        frequency: of a course.
        u: of a course.
        half: whether one half is to be drawn.
        tolerance: roughness below which the panels are short enough.
    """
    course = on_edges(motion, states, EDGES * (math.pi if half else 2.0 * math.pi), frequency, u)
    for _ in range(HALVINGS):
        rough = course.roughness() > tolerance
        if not rough.any():
            break
        course = on_edges(motion, states, _divided(course.edges, 1 + rough), frequency, u)
    return course


def divided(
    motion: Field, course: Course, parts: NDArray[np.int_], turning: bool = False
) -> Course:
    """The same course on shorter panels.

    Args:
        motion: the model's.
        course: what is drawn.
        parts: into how many each panel is divided, shape (M,).
        turning: whether panels are to end also where drag points turn back on the course as it is.
    """
    edges = _divided(course.edges, parts)
    if turning:
        edges = _joined(edges, _turning_points(motion, course))
    return on_edges(motion, course.states, edges, course.frequency, course.u)


def on_edges(
    motion: Field, states: Callable[[Array], Array], edges: Array, frequency: float, u: float
) -> Course:
    """A course through states on given panels."""
    at = edges[:-1, None] + np.diff(edges)[:, None] * RADAU.nodes
    rates = motion(states(at.ravel()), u)
    width = motion.size if motion.tied else motion.half
    pushes = np.ascontiguousarray(rates[-width:].T).reshape(edges.size - 1, STAGES, width)
    return Course(edges, states(edges[:-1]).T.copy(), pushes, frequency, u)


def _divided(edges: Array, parts: NDArray[np.int_]) -> Array:
    which = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[which]
    return np.append(edges[which] + share * np.diff(edges)[which], edges[-1])


def _joined(edges: Array, turns: Array) -> Array:
    """Edges with others that take the place of such as they coincide with."""
    least = APART * edges[-1]
    inner = edges[1:-1]
    if turns.size:
        turns = turns[np.concatenate([[True], np.diff(turns) > least])]
        turns = turns[(turns > least) & (turns < edges[-1] - least)]
        inner = inner[np.abs(inner[:, None] - turns).min(axis=1, initial=math.inf) > least]
    return np.sort(np.concatenate([edges[:1], inner, turns, edges[-1:]]))


def _turning_points(motion: Field, course: Course) -> Array:
    """Phases at which drag's second derivative jumps, shape (k,)."""
    share = np.linspace(0.0, 1.0, 9)[:-1]
    phase = np.append(course.edges[:-1, None] + np.diff(course.edges)[:, None] * share, course.span)
    values = motion.drag_velocities(course.states(phase))
    point, at = np.nonzero(values[:, :-1] * values[:, 1:] < 0.0)
    low, high = phase[at], phase[at + 1]
    first, last = values[point, at], values[point, at + 1]
    for _ in range(6):
        middle = low - first * (high - low) / (last - first)
        now = motion.drag_velocities(course.states(middle))[point, np.arange(point.size)]
        after = now * last > 0.0
        # Illinois: the end that stays is halved, which keeps the order above one.
        low, high = np.where(after, low, middle), np.where(after, middle, high)
        first, last = np.where(after, 0.5 * first, now), np.where(after, now, 0.5 * last)
    return np.sort(low - first * (high - low) / (last - first))
