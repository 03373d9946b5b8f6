# SPDX-License-Identifier: MIT
"""Periodic orbits as piecewise polynomials on a mesh, and meshes that suit them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.util.check import Array

STAGES = 8
"""Stages of the Radau method, whose order is one less than twice as many: 15."""

COARSEST = 4
"""Intervals in half a period of the coarsest mesh: 32 stages resolve some 10 odd harmonics."""


class _Radau:
    """Coefficients of the Radau IIA method on [0, 1].

    Attributes:
        nodes: c, shape (s,).
        once, twice: integrals from 0 to each node, and integrals of these, shape (s, s).
        to_legendre: Legendre coefficients from values at the nodes, shape (s, s).
    """

    def __init__(self, stages: int) -> None:
        ends = np.zeros(stages + 1)
        ends[-2:] = -1.0, 1.0
        x = np.sort(legendre.legroots(ends).real)
        x[-1] = 1.0
        self.to_legendre = np.linalg.inv(legendre.legvander(x, stages - 1))
        self.nodes: Array = 0.5 * (x + 1.0)
        self._integrated = {
            times: 0.5**times * legendre.legint(self.to_legendre, times, lbnd=-1.0)
            for times in (1, 2)
        }
        self.once = self.integrals(self.nodes, 1)
        self.twice = self.once @ self.once

    def integrals(self, at: Array, times: int) -> Array:
        """Integrals from 0, once or twice, of the polynomials through values, shape (k, s)."""
        coefficients = self._integrated[times]
        basis = legendre.legvander(2.0 * at - 1.0, len(coefficients) - 1)
        found: Array = basis @ coefficients
        return found


RADAU = _Radau(STAGES)


@dataclass(frozen=True)
class PeriodicOrbit:
    """A periodic orbit, or the half of it of which the other half is the mirror image."""

    edges: Array = field(repr=False)
    """Phases at which the mesh intervals end, from 0 to the span, shape (M + 1,)."""
    starts: Array = field(repr=False)
    """States at the beginnings of the intervals, shape (M, 2 moving)."""
    rates: Array = field(repr=False)
    """Accelerations at the stages, with constraints rates of states, shape (M, s, width)."""
    frequency: float
    u: float

    @property
    def span(self) -> float:
        """Phase covered: pi or 2 pi."""
        return float(self.edges[-1])

    @property
    def symmetric(self) -> bool:
        """Whether it is one half."""
        return self.span < 4.0

    @property
    def mirror(self) -> float:
        """-1 where the state after the span is the mirror image of the first, else 1."""
        return -1.0 if self.symmetric else 1.0

    @property
    def half(self) -> int:
        """Number of positions in a state."""
        return int(self.starts.shape[1]) // 2

    @property
    def twice(self) -> int:
        """Number of positions that are their accelerations integrated twice."""
        return int(self.starts.shape[1] - self.rates.shape[2])

    @property
    def size(self) -> float:
        """Largest extent of a coordinate."""
        p = self.starts[:, : self.half]
        return float((2.0 * np.abs(p) if self.symmetric else np.ptp(p, axis=0)).max())

    @property
    def durations(self) -> Array:
        """Times that the intervals take, shape (M,)."""
        return np.diff(self.edges) / self.frequency

    def stages(self) -> Array:
        """States at the stages, shape (M, s, 2 moving)."""
        return self._states(
            *(self.starts, self.rates, self.durations[:, None, None]),
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
            *(self.starts[where], self.rates[where], self.durations[where, None, None]),
            *(share[:, None, None], once, twice),
        )
        return np.ascontiguousarray((self.mirror**turns)[:, None] * y[:, 0]).T

    def _states(
        self, starts: Array, rates: Array, h: Array, share: Array, once: Array, twice: Array
    ) -> Array:
        y = starts[:, None] + np.zeros((1, share.shape[-2], 1))
        y[..., : self.twice] += h * share * starts[:, None, self.twice : 2 * self.twice]
        y[..., : self.twice] += h**2 * (twice @ rates[..., : self.twice])
        y[..., self.twice :] += h * (once @ rates)
        return y

    def defects(self) -> Array:
        """Share of the largest velocity that each interval's last polynomials add, shape (M,)."""
        last = np.abs(RADAU.to_legendre[-2:] @ self.rates[:, :, -self.half :])
        velocity = np.abs(self.starts[:, self.half :]).max()
        shares: Array = self.durations * last.sum(axis=1).max(axis=1) / velocity
        return shares

    def packed(self) -> Array:
        """Unknowns: states, rates, frequency and speed, shape (M (2 moving + s width) + 2,)."""
        return np.concatenate([self.starts.ravel(), self.rates.ravel(), [self.frequency, self.u]])

    def unpacked(self, z: Array) -> PeriodicOrbit:
        """The orbit of these unknowns on this mesh."""
        starts, rates = np.split(z[:-2], [self.starts.size])
        return replace(
            self,
            starts=starts.reshape(self.starts.shape),
            rates=rates.reshape(self.rates.shape),
            frequency=float(z[-2]),
            u=float(z[-1]),
        )

    def doubled(self) -> PeriodicOrbit:
        """A symmetric orbit as a whole one, a whole one run through twice."""
        edges = np.append(self.edges, self.span + self.edges[1:])
        share = 1.0 if self.symmetric else 0.5
        return PeriodicOrbit(
            share * edges,
            np.concatenate([self.starts, self.mirror * self.starts]),
            np.concatenate([self.rates, self.mirror * self.rates]),
            share * self.frequency,
            self.u,
        )


# --------------------------------------------------------------------------------------- meshes


def coarsest_mesh(symmetric: bool) -> Array:
    """Edges of the coarsest mesh over half a period or a whole one."""
    spans = 1 if symmetric else 2
    return np.linspace(0.0, spans * math.pi, spans * COARSEST + 1)


def stage_phases(edges: Array) -> Array:
    """Phases of the stages, shape (M, s)."""
    phases: Array = edges[:-1, None] + np.diff(edges)[:, None] * RADAU.nodes
    return phases


def interpolated(
    motion: VectorField,
    states: Callable[[Array], Array],
    edges: Array,
    frequency: float,
    u: float,
) -> PeriodicOrbit:
    """An orbit through states [p, p'], a function of phases (k,) to (2 moving, k), on a mesh."""
    width = motion.width
    rates = motion(states(stage_phases(edges).ravel()), u)[-width:]
    rates = np.ascontiguousarray(rates.T).reshape(edges.size - 1, STAGES, width)
    return PeriodicOrbit(edges, states(edges[:-1]).T.copy(), rates, frequency, u)


def resolved(
    motion: VectorField,
    states: Callable[[Array], Array],
    frequency: float,
    u: float,
    symmetric: bool,
    tolerance: float,
) -> PeriodicOrbit:
    """An orbit through states, on as coarse a mesh as leaves no larger defect than a tolerance."""
    orbit = interpolated(motion, states, coarsest_mesh(symmetric), frequency, u)
    for _ in range(12):  # by then an interval is 4,000 times shorter
        coarse = orbit.defects() > tolerance
        if not coarse.any():
            break
        orbit = interpolated(motion, states, divided(orbit.edges, 1 + coarse), frequency, u)
    return orbit


def refined(
    motion: VectorField, orbit: PeriodicOrbit, parts: NDArray[np.int_], turning: bool = False
) -> PeriodicOrbit:
    """The same orbit with each interval in so many parts, shape (M,).

    With `turning` intervals end also where points at which drag acts turn back.
    """
    edges = divided(orbit.edges, parts)
    if turning:
        edges = _joined(edges, _turning_points(motion, orbit))
    return interpolated(motion, orbit.states, edges, orbit.frequency, orbit.u)


def divided(edges: Array, parts: NDArray[np.int_]) -> Array:
    """Edges of a mesh each interval of which is divided into so many."""
    which = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(which.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[which]
    return np.append(edges[which] + share * np.diff(edges)[which], edges[-1])


def _joined(edges: Array, turns: Array) -> Array:
    """Edges with others that take the place of such as they coincide with."""
    least = 1e-4 * edges[-1]  # a shorter interval costs as much and resolves nothing
    inner = edges[1:-1]
    if turns.size:
        turns = turns[np.concatenate([[True], np.diff(turns) > least])]
        turns = turns[(turns > least) & (turns < edges[-1] - least)]
        inner = inner[np.abs(inner[:, None] - turns).min(axis=1, initial=math.inf) > least]
    return np.sort(np.concatenate([edges[:1], inner, turns, edges[-1:]]))


def _turning_points(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Phases at which drag's second derivative jumps, shape (k,)."""
    share = np.linspace(0.0, 1.0, 9)[:-1]
    phase = np.append(orbit.edges[:-1, None] + np.diff(orbit.edges)[:, None] * share, orbit.span)
    values = _drag_velocities(motion, orbit, phase)
    point, at = np.nonzero(values[:, :-1] * values[:, 1:] < 0.0)
    low, high = phase[at], phase[at + 1]
    first, last = values[point, at], values[point, at + 1]
    for _ in range(6):
        middle = low - first * (high - low) / (last - first)
        now = _drag_velocities(motion, orbit, middle)[point, np.arange(point.size)]
        after = now * last > 0.0
        # Illinois: the end that stays is halved, which keeps the order above one.
        low, high = np.where(after, low, middle), np.where(after, middle, high)
        first, last = np.where(after, 0.5 * first, now), np.where(after, now, 0.5 * last)
    return np.sort(low - first * (high - low) / (last - first))


def _drag_velocities(motion: VectorField, orbit: PeriodicOrbit, phase: Array) -> Array:
    """Normal velocities of the points at which drag acts, shape (points, k)."""
    return motion.model.drag_velocities(*np.split(orbit.states(phase), 2))
