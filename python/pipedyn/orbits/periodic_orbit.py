# SPDX-License-Identifier: MIT
"""Periodic orbits as piecewise polynomials on a mesh, and meshes that suit them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.motion.vector_field import VectorField
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.newton import zeros_between

ORBIT_STAGES = 8
"""Number of stages of the Radau IIA method, which has order 2 ORBIT_STAGES - 1 = 15. Cycles of two
pipes take 2.5 times as long to 1e-6 with 6 stages, and 1.1 times as long with 10."""

COARSEST = 4
"""Number of intervals in half a period of the coarsest mesh: 32 stages resolve some 10 odd
harmonics."""

PROBES: Array = np.linspace(0.0, 2.0 * math.pi, 65)[:-1]
"""Phases at which orbits are compared: enough for the harmonics that matter for a sign."""

MOST_JOINED = 0.7
"""Largest number of intervals of a mesh with intervals joined in pairs, as a share of the orbit's:
more would tell little about its error."""

MOST_CYCLE_INTERVALS = 2000
"""Largest number of intervals of a mesh: with more, one Newton step of a chain of 20 segments takes
some seconds."""

BEFORE = 1e-10
"""Phase by which an interval ends before a kink, so that its last stage, at its end, has the slopes
of the forces before the kink. The error in the next interval is this phase times the jump of the
slopes, below rounding; kinks are found to some 1e-14."""

KINK_SAMPLES = 8
"""Number of samples of an interval, between which kinks are looked for: two kinks that lie closer
enclose only a short stretch of other slopes."""

_X: Array = np.sort(legendre.legroots([0.0] * (ORBIT_STAGES - 1) + [-1.0, 1.0]).real)
_X[-1] = 1.0
STAGE_NODES: Array = 0.5 * (_X + 1.0)
"""Nodes of the stages in an interval of length 1, shape (s,)."""

TO_LEGENDRE = np.linalg.inv(legendre.legvander(_X, ORBIT_STAGES - 1))
"""Legendre coefficients from values at the stages, shape (s, s)."""

_INTEGRATED = [0.5**k * legendre.legint(TO_LEGENDRE, k, lbnd=-1.0) for k in (0, 1, 2)]


def integrals(at: Array, times: int) -> Array:
    """Matrix from stage values to values or integrals from 0 of their polynomial, shape (k, s).

    at: places in an interval of length 1, (k,); times: 0 for values, 1 or 2 for integrals.
    """
    basis = legendre.legvander(2.0 * at - 1.0, ORBIT_STAGES - 1 + times)
    return basis @ _INTEGRATED[times]


ONCE = integrals(STAGE_NODES, 1)
"""Matrix from stage values to integrals from 0 to each stage, shape (s, s)."""

SLOPES = np.linalg.inv(ONCE)
"""Matrix from changes since 0 at the stages to derivatives of their polynomial there, (s, s)."""

TWICE: Array = ONCE @ ONCE
"""Matrix from stage values to double integrals from 0 to each stage, shape (s, s)."""

METHOD = STAGE_NODES, ONCE.T.copy(), TWICE.T.copy()
"""Nodes and weights of the method, in the form that the core takes."""

BETWEEN: Array = 0.5 * (np.append(0.0, STAGE_NODES[:-1]) + STAGE_NODES)
"""Places half-way between the stages, the first of them between the beginning and the first stage,
shape (s,)."""

RATES_BETWEEN = integrals(BETWEEN, 0)
"""Matrix from stage values to values of their polynomial at `BETWEEN`, shape (s, s)."""


@saved_as("Closing")
@dataclass(frozen=True)
class Closing:
    """Matrices that files of version 0.2 may hold with an orbit; they are read and left out."""

    first: Array
    last: Array
    step: float


@saved_as("PeriodicOrbit")
@dataclass(frozen=True)
class PeriodicOrbit:
    """A periodic orbit, or one half of it if the other half is its mirror image.

    In a forced motion the frequency varies at a given speed u, otherwise the speed varies.
    """

    edges: Array = field(repr=False)  # phases at which intervals end, from 0 on, shape (M + 1,)
    starts: Array = field(repr=False)  # states where they begin, shape (M, 2 integrated)
    rates: Array = field(repr=False)  # accelerations at the stages, shape (M, s, integrated)
    frequency: float
    u: float
    forced: bool = False

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> PeriodicOrbit:
        """The orbit with the fields that a file kept, checked."""
        made = cls(**{name: value for name, value in fields.items() if name != "closing"})
        count, stages, half = made.rates.shape
        shapes = made.edges.shape, made.starts.shape, stages
        if shapes != ((count + 1,), (count, 2 * half), ORBIT_STAGES):
            raise ValueError("edges, starts and rates of an orbit must have shapes that agree")
        numbers = np.concatenate([made.edges, made.starts.ravel(), made.rates.ravel()])
        finite = np.isfinite(numbers).all() and math.isfinite(made.u)
        if not (finite and 0.0 < made.frequency < math.inf):
            raise ValueError("an orbit must have finite numbers and a frequency > 0")
        if made.edges[0] != 0.0 or np.any(np.diff(made.edges) <= 0.0):
            raise ValueError("edges of an orbit must ascend from 0")
        return made

    def in_space(self, model: Model) -> PeriodicOrbit:
        """The orbit of a model's planar model as one of the model in three dimensions."""
        p, rates = np.split(self.starts, 2, axis=1)
        states = (model.from_plane(part.T).T for part in (p, rates))
        accelerations = np.moveaxis(model.from_plane(np.moveaxis(self.rates, 2, 0)), 0, 2)
        starts = np.concatenate([*states], axis=1)
        return replace(self, starts=starts, rates=np.ascontiguousarray(accelerations))

    def in_plane(self, model: Model) -> PeriodicOrbit:
        """The orbit's part in the coordinates of a model, the first of those in each direction."""
        size = model.integrated
        if size == self.half:
            return self
        starts = np.concatenate([p[:, :size] for p in np.split(self.starts, 2, axis=1)], axis=1)
        return replace(self, starts=starts, rates=np.ascontiguousarray(self.rates[:, :, :size]))

    @property
    def span(self) -> float:
        """Phase that the edges cover: pi or 2 pi."""
        return float(self.edges[-1])

    @property
    def symmetric(self) -> bool:
        """Whether it is one half of an orbit whose other half is the mirror image."""
        return self.span < 4.0

    @property
    def mirror_sign(self) -> float:
        """-1 where the state after the span is the mirror image of the first, else 1."""
        return -1.0 if self.symmetric else 1.0

    @property
    def half(self) -> int:
        """Number of positions in a state."""
        return int(self.starts.shape[1]) // 2

    @cached_property
    def size(self) -> float:
        """Largest peak-to-peak value of a coordinate."""
        p = self.starts[:, : self.half]
        return float((2.0 * np.abs(p) if self.symmetric else np.ptp(p, axis=0)).max())

    @cached_property
    def durations(self) -> Array:
        """Durations of the intervals, shape (M,)."""
        return (self.edges[1:] - self.edges[:-1]) / self.frequency

    def stage_columns(self) -> Array:
        """States at the stages, in columns, shape (2 integrated, M s)."""
        given = self.durations, self.starts, self.rates
        return _core.stage_states(*given, METHOD)

    def states(self, phase: Array) -> Array:
        """States [p, p'] at phases, shape (2 integrated, k)."""
        given = self.edges, self.starts, self.rates, self.frequency, self.mirror_sign
        return _core.orbit_states(*given, _INTEGRATED[1], _INTEGRATED[2], phase)

    def sampled(self, parts: int, whole: bool = False) -> tuple[Array, Array]:
        """Phases at the ends of equal parts of the intervals, (k,), and states [p, p'] there.

        The states have the shape (2 integrated, k). With `whole` the mirror image of a symmetric
        orbit follows.
        """
        phase = divided(self.edges, np.full(len(self.starts), parts))
        if whole and self.symmetric:
            phase = np.append(phase, self.span + phase[1:])
        return phase, self.states(phase)

    def defects(self) -> Array:
        """Last two Legendre terms of each interval's rates, as a share of the velocity, (M,)."""
        last = np.abs(TO_LEGENDRE[-2:] @ self.rates).sum(axis=1)
        velocity = np.abs(self.starts[:, self.half :]).max()
        return self.durations * last.max(axis=1) / velocity

    def packed(self) -> Array:
        """Vector of unknowns: states, rates, frequency, speed, shape (M (2 + s) integrated + 2,).

        The last one is the branch parameter: the speed or, in a forced motion, the frequency.
        """
        last = [self.u, self.frequency] if self.forced else [self.frequency, self.u]
        return np.concatenate([self.starts.ravel(), self.rates.ravel(), last])

    def unpacked(self, z: Array) -> PeriodicOrbit:
        """The orbit on this mesh with the unknowns z, in the order of `packed`."""
        starts, rates = z[: self.starts.size], z[self.starts.size : -2]
        frequency, u = z[:-3:-1] if self.forced else z[-2:]
        return PeriodicOrbit(
            self.edges,
            starts.reshape(self.starts.shape),
            rates.reshape(self.rates.shape),
            float(frequency),
            float(u),
            self.forced,
        )

    def doubled(self, sign: float = 1.0) -> PeriodicOrbit:
        """The whole of a symmetric orbit, or two rounds of a whole one, the second times a sign."""
        edges, again = np.append(self.edges, self.span + self.edges[1:]), sign * self.mirror_sign
        share = 1.0 if self.symmetric else 0.5
        return PeriodicOrbit(
            share * edges,
            np.concatenate([self.starts, again * self.starts]),
            np.concatenate([self.rates, again * self.rates]),
            share * self.frequency,
            self.u,
            self.forced,
        )


# --------------------------------------------------------------------------------------- meshes


def coarsest_mesh(symmetric: bool) -> Array:
    """Edges of the coarsest mesh over half a period or a whole one."""
    spans = 1 if symmetric else 2
    return np.linspace(0.0, spans * math.pi, spans * COARSEST + 1)


def stage_phases(edges: Array) -> Array:
    """Phases of the stages of a mesh, shape (M, s)."""
    return edges[:-1, None] + (edges[1:] - edges[:-1])[:, None] * STAGE_NODES


def interpolated(
    motion: VectorField,
    states: Callable[[Array], Array],
    edges: Array,
    frequency: float,
    u: float,
    from_samples: bool = False,
) -> PeriodicOrbit:
    """An orbit on a mesh through states [p, p'], a function of phases (k,) to (2 integrated, k).

    Its accelerations are derivatives of polynomials through the rates, since stiff forces multiply
    the errors of the states. If forces have kinks, which polynomials do not follow, accelerations
    are those of the forces, unless the states are interpolated between samples of a motion
    (`from_samples`).
    """
    given = motion, states, edges[:-1], np.diff(edges), frequency, u, from_samples
    return PeriodicOrbit(edges, *_on_intervals(*given), frequency, u, motion.forced)


def _on_intervals(
    motion: VectorField,
    states: Callable[[Array], Array],
    begins: Array,
    lengths: Array,
    frequency: float,
    u: float,
    from_samples: bool,
) -> tuple[Array, Array]:
    """States where intervals of phases begin and accelerations at their stages, as `interpolated`.

    They have the shapes (M, 2 integrated) and (M, s, integrated).
    """
    phases = begins[:, None] + lengths[:, None] * np.append(0.0, STAGE_NODES)
    at = states(phases.ravel()).reshape(motion.size, *phases.shape)
    starts, stages, half = at[:, :, 0], at[:, :, 1:], motion.half
    if motion.model.pipe.has_kinks and not from_samples:
        along = motion.along(phases[:, 1:].ravel(), frequency)
        rates = along(stages.reshape(motion.size, -1), u)[half:].reshape(half, -1, ORBIT_STAGES)
    else:
        speeds = (stages[half:] - starts[half:, :, None]).reshape(-1, ORBIT_STAGES)
        rates = (speeds @ SLOPES.T).reshape(half, -1, ORBIT_STAGES)
        rates /= lengths[:, None] / frequency
    return starts.T.copy(), np.ascontiguousarray(rates.transpose(1, 2, 0))


def resolved_orbit(
    motion: VectorField,
    states: Callable[[Array], Array],
    frequency: float,
    u: float,
    symmetric: bool,
    tolerance: float,
    from_samples: bool = False,
) -> PeriodicOrbit:
    """An orbit through states, on the coarsest mesh whose defects meet a tolerance.

    Beyond `MOST_CYCLE_INTERVALS` intervals the mesh is refined no further.

    from_samples: as for `interpolated`.
    """
    orbit = interpolated(motion, states, coarsest_mesh(symmetric), frequency, u, from_samples)
    for _ in range(12):  # intervals are 4,000 times shorter at last
        coarse = orbit.defects() > tolerance
        if not coarse.any() or coarse.size > MOST_CYCLE_INTERVALS:
            break
        parts = 1 + coarse
        edges, anew = divided(orbit.edges, parts), np.repeat(coarse, parts)
        starts, rates = (np.repeat(one, parts, axis=0) for one in (orbit.starts, orbit.rates))
        given = edges[:-1][anew], np.diff(edges)[anew], frequency, u, from_samples
        starts[anew], rates[anew] = _on_intervals(motion, states, *given)
        orbit = replace(orbit, edges=edges, starts=starts, rates=rates)
    return orbit


def joined_in_pairs(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit | None:
    """An orbit on a mesh in which neighbouring intervals of like lengths are joined in pairs.

    It tells the error of the orbit's own mesh in a quarter of the time that one twice as fine
    takes. Three are joined where they are odd in number, and an interval alone among shorter and
    longer ones stays: to join neighbours one of which is 1.8 times as long increases the error
    1,000 times, and at least 30 times where the polynomial between the orbit's stages causes it.
    None is returned if few can be joined or forces have kinks.
    """
    count, lengths = len(orbit.starts), np.log(np.diff(orbit.edges))
    ends = np.flatnonzero(np.abs(np.diff(lengths)) > math.log(1.8)) + 1  # of runs of like lengths
    kept = [0]
    for begin, end in pairwise([0, *ends.tolist(), count]):
        kept += [*range(begin + 2, end - 1, 2), end]
    if motion.model.pipe.has_kinks or len(kept) > 1 + MOST_JOINED * count:
        return None
    return interpolated(motion, orbit.states, orbit.edges[kept], orbit.frequency, orbit.u)


def refined(
    motion: VectorField, orbit: PeriodicOrbit, parts: NDArray[np.int_], at_kinks: bool = False
) -> PeriodicOrbit:
    """An orbit on a finer mesh: interval i is divided into parts[i] equal parts, shape (M,).

    With `at_kinks` intervals end also where derivatives of the forces jump.
    """
    edges = divided(orbit.edges, parts)
    if at_kinks:
        edges = _edges_with_kinks(edges, _kinks(motion, orbit))
    return interpolated(motion, orbit.states, edges, orbit.frequency, orbit.u)


def divided(edges: Array, parts: NDArray[np.int_]) -> Array:
    """Edges of a mesh whose interval i is divided into parts[i] equal parts."""
    staying = np.append(0, np.cumsum(parts))  # indices in the finer mesh of the given edges
    return np.interp(np.arange(staying[-1] + 1), staying, edges)


def _edges_with_kinks(edges: Array, kinks: Array) -> Array:
    """Edges with kinks added; a kink replaces an edge with which it nearly coincides."""
    least = 1e-4 * edges[-1]  # a shorter interval costs as much and resolves nothing
    kinks = kinks[(kinks > least) & (kinks < edges[-1] - least)]
    kinks = kinks[np.diff(kinks, prepend=-math.inf) > least]
    apart = np.abs(edges[1:-1, None] - kinks).min(axis=1, initial=math.inf)
    return np.sort(np.concatenate([edges[[0, -1]], edges[1:-1][apart > least], kinks]))


@dataclass(frozen=True)
class StopContacts:
    """Extrema of an orbit near the places where forces begin, such as stops.

    Along the orbit the distance from such a place has extrema. Either an extremum is beyond the
    place, so that the orbit crosses the place on both sides of the extremum, or it is not.

    Attributes:
        beyond: how far each extremum is beyond the place, < 0 where it is not, (k,).
        outward: whether it moves farther beyond if the orbit grows about its mean, (k,).
        crossings: total number of crossings of the places.
    """

    beyond: Array
    outward: NDArray[np.bool_]
    crossings: int


def stop_contacts(motion: VectorField, orbit: PeriodicOrbit) -> StopContacts:
    """Contacts of an orbit with the places where forces begin, from samples along it."""
    phase, y = orbit.sampled(KINK_SAMPLES, whole=True)
    signed = motion.along(phase[:-1], orbit.frequency).kinks(y[:, :-1])  # the last is the first
    before, after = np.roll(signed, 1, axis=1), np.roll(signed, -1, axis=1)
    highest, lowest = (signed >= before) & (signed > after), (signed <= before) & (signed < after)
    above = signed > signed.mean(axis=1, keepdims=True)
    extreme = highest | lowest
    return StopContacts(
        beyond=np.where(highest, signed, -signed)[extreme],
        outward=(highest == above)[extreme],
        crossings=int(np.count_nonzero((signed > 0.0) != (after > 0.0))),
    )


def _kinks(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Phases at which derivatives of the forces jump, shape (k,), rising.

    There, functions change their signs, which are looked for between samples.
    """
    if not motion.model.pipe.has_kinks:
        return np.empty(0)
    phase, y = orbit.sampled(KINK_SAMPLES)
    signed = motion.along(phase, orbit.frequency).kinks(y)
    positive = signed > 0.0
    which, before = np.nonzero(positive[:, 1:] != positive[:, :-1])
    every = np.arange(which.size)

    def values(phase: Array) -> Array:
        return motion.along(phase, orbit.frequency).kinks(orbit.states(phase))[which, every]

    ends = phase[before], phase[before + 1]
    found = zeros_between(values, *ends, signed[which, before], signed[which, before + 1])
    return np.sort(found) - BEFORE
