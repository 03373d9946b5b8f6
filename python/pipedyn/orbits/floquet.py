# SPDX-License-Identifier: MIT
"""Floquet multipliers of a periodic orbit, and the events where they pass the unit circle.

The variational equation along the orbit is solved by Magnus' series. If that does not reach the
tolerance, or forces have kinks at unknown phases, the equation is solved by the orbit's own
collocation, on a mesh fine enough for all fast modes that do not decay at once; likewise if the
orbit's mesh is that fine anyway. Either method gives the maps of intervals and, from shorter ones,
an error. The multipliers mu are those of the pencil L + mu R that follows from the maps, so that
multipliers of a million cost no digits of the trivial one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.continuation.tracer import TestFunction
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits.collocation import LOSS, collocation_maps, stage_derivatives, state_units
from pipedyn.orbits.magnus import interval_maps
from pipedyn.orbits.periodic_orbit import PeriodicOrbit, joined_in_pairs, refined
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.newton import NewtonFailed

MULTIPLIER_TOLERANCE, MOST_HALVINGS, MOST_FLOQUET_INTERVALS = 1e-7, 4, 4000
"""Error allowed for a multiplier, relative if above 1: a tenth of the allowed error of the trivial
one. Largest number of halvings of mesh intervals to reach it: one mostly does. Largest number of
mesh intervals: 2 GB for 100 segments."""

TURN = 4.0
"""Largest |lambda| h of an interval, for modes that persist, up to which multipliers are known to
MULTIPLIER_TOLERANCE: the error is 3e-8, and at half of it 5e-13, as it falls with the sixteenth
power."""

FINER = 2.0
"""Factor by which the collocation may need more intervals before Magnus' series is tried: then both
cost about the same."""

MAGNUS_PARTS = 36.0
"""Number of parts into which Magnus' series first divides half a period, for each cube root of the
fastest mode's turns in it, to reach MULTIPLIER_TOLERANCE. Multipliers of chains of 20 to 60
segments then mostly err by up to 2e-8, and the error that is given for them is 3e-8 to 6e-8. With
fewer parts, whose length may be that of half a turn of a fast mode, they may err by six times the
error that is given."""

FEWER_PARTS = 0.125
"""Number of parts of a coarser series, relative to the first one. The difference of the multipliers
of both shows the error. For ten models it shows the same error with a share of a third, which takes
a fifth longer."""

UNIT = 1e-6
"""Largest excess of multipliers over 1 on a stable cycle: the allowed error of the trivial one."""

LARGEST_ERROR = 1e-3
"""Error of the multipliers beyond which a cycle on a branch, or of a motion, is left out: near five
folds it was measured to be 6e-5 at most."""

FLAT_ORBIT = 1e-14
"""Largest part of an orbit across the plane z = 0 or x = 0, relative to its size, that is
rounding."""

EventKind = Literal[
    "fold",
    "pitchfork",
    "period doubling",
    "torus",
    "grazing",
    "hopf",
    "infinite period",
    "branch point",
    "end",
]


def orbit_multipliers(
    motion: VectorField,
    orbit: PeriodicOrbit,
    tolerance: float = MULTIPLIER_TOLERANCE,
) -> tuple[Complex, Complex, float]:
    """Floquet multipliers, the largest modulus first, their roots and the error of the worst.

    Finer meshes are tried until the error is at most the tolerance, which may remain out of reach.

    If the orbit has mirror symmetry, the roots are the eigenvalues of the map over half a period
    followed by the reflection. The multipliers, shape (2 dof,), are their squares: the trivial one
    is 1 either way, and a perturbation that breaks the mirror symmetry and neither grows nor decays
    has the root -1. Without the symmetry the roots are the multipliers.

    Raises:
        NewtonFailed: if they overflow.
    """
    parts, error = multipliers_by_plane(motion, orbit, tolerance)
    return *all_multipliers(parts), error


def all_multipliers(parts: list[tuple[Complex, Complex]]) -> tuple[Complex, Complex]:
    """Multipliers and roots of `multipliers_by_plane` together, the largest modulus first."""
    values, roots = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = _largest_first(values)
    return values[order], roots[order]


def multipliers_by_plane(
    motion: VectorField, orbit: PeriodicOrbit, tolerance: float = MULTIPLIER_TOLERANCE
) -> tuple[list[tuple[Complex, Complex]], float]:
    """Floquet multipliers and their roots, as `orbit_multipliers`, and the error of the worst.

    If an orbit in three dimensions lies in the plane z = 0 or x = 0, they are those of changes in
    the plane, then those of changes across it; else there is one pair, of all.
    """
    turns, error = fast_turns(motion, orbit), math.inf
    roots: Complex = np.empty(0, dtype=np.complex128)
    # The series serves only modes that the collocation resolves on a far finer mesh. With kinks at
    # unknown phases the error is the one that halving shows.
    parts = parts_for(turns, tolerance)
    if parts.sum() > FINER * parts.size and (smooth := _between_kinks(motion, orbit)):
        roots, error = _by_magnus(motion, smooth, turns.sum(), tolerance)
    if not error <= tolerance:
        others, other = _by_collocation(motion, orbit, parts, tolerance)
        if not other > error:
            roots, error = others, other
    found = list[tuple[Complex, Complex]]()
    for some in np.split(roots, len(uncoupled(motion, orbit))):
        values = (some**2 if orbit.symmetric else some).astype(np.complex128)
        order = _largest_first(values)
        found.append((values[order], some[order]))
    return found, error


def _largest_first(values: Complex) -> NDArray[np.intp]:
    """Order of multipliers; moduli are rounded, as those of a pair differ by rounding."""
    sizes = np.log(np.maximum(np.abs(values), 1e-300)).round(11)
    return np.lexsort((-values.imag, -sizes))


def uncoupled(motion: VectorField, orbit: PeriodicOrbit) -> list[NDArray[np.intp]]:
    """Indices of the entries of a state whose small changes along an orbit are uncoupled.

    If an orbit in three dimensions lies in the plane z = 0 or x = 0, they are those in the plane
    and those across it; else all.
    """
    every, half = np.arange(motion.size), motion.half
    if motion.model.dimensions == 3:
        planes = every.reshape(2, 2, half // 2).swapaxes(0, 1).reshape(2, half)
        for plane, across in (planes, planes[::-1]):
            parts = (orbit.starts, across), (orbit.rates, across[: half // 2])
            if all(np.abs(of[..., z]).max() <= FLAT_ORBIT * np.abs(of).max() for of, z in parts):
                return [plane, across]
    return [every]


def parts_for(turns: Array, tolerance: float) -> NDArray[np.int_]:
    """Number of parts of each interval, (M,), from `fast_turns`, for multipliers to a tolerance."""
    longest = TURN * (tolerance / MULTIPLIER_TOLERANCE) ** 0.0625
    return np.ceil(np.maximum(turns / longest, 1.0)).astype(int)


def _between_kinks(motion: VectorField, orbit: PeriodicOrbit) -> PeriodicOrbit | None:
    """An orbit on intervals with smooth derivatives; None if the phases of kinks are not known."""
    if not motion.model.pipe.has_kinks:
        return orbit
    if not motion.model.kinks_known:
        return None
    return refined(motion, orbit, np.ones(len(orbit.starts), dtype=int), at_kinks=True)


def _by_magnus(
    motion: VectorField, orbit: PeriodicOrbit, turns: float, tolerance: float
) -> tuple[Complex, float]:
    """Roots of the multipliers and the error of the worst, by Magnus' series."""
    units = state_units(motion, orbit)
    rounds = orbit.span / math.pi
    number = MAGNUS_PARTS * rounds * (turns / rounds) ** (1.0 / 3.0)
    # By its order, a series with the fourth root of an error would do. Few parts are too long for
    # fast modes to follow that order.
    number *= (MULTIPLIER_TOLERANCE / tolerance) ** 0.125
    parts = np.ceil(number * np.diff(orbit.edges) / orbit.span).astype(int)
    return by_series(
        *(stage_derivatives(motion, orbit), orbit.durations, units, parts),
        lambda maps: _roots_of_maps(motion, orbit, maps, units),
        2 if orbit.symmetric else 1,
        tolerance,
    )


def by_series(
    rows: Array,
    durations: Array,
    units: Array,
    parts: NDArray[np.int_],
    eigenvalues: Callable[[Array], Complex] | None = None,
    power: int = 1,
    tolerance: float = MULTIPLIER_TOLERANCE,
) -> tuple[Complex, float]:
    """Roots of the multipliers and the error of the worst, from derivatives along a period.

    An interval's map errs by the fourth power of the length of its parts, so that the difference of
    two lengths gives a better map; the error is the change of the multipliers that this causes.

    Args:
        rows: as for `interval_maps`.
        durations: as for `interval_maps`.
        units: as for `interval_maps`.
        parts: as for `interval_maps`; the numbers of the finer of the first two series.
        eigenvalues: function from the maps to the roots, which raises `NewtonFailed` if they
            overflow; by default the eigenvalues of the product of the maps.
        power: power of the roots that gives the multipliers.
        tolerance: tolerance of the multipliers.
    """
    eigenvalues = eigenvalues or eigenvalues_through
    given = rows, durations, units
    parts = np.maximum(parts, 2)
    fewer, error = np.ceil(FEWER_PARTS * parts).astype(int), math.inf
    roots: Complex = np.empty(0, dtype=np.complex128)
    coarser = interval_maps(*given, fewer)
    while parts.sum() <= MOST_FLOQUET_INTERVALS:
        maps = interval_maps(*given, parts)
        left = 1.0 / ((parts / fewer) ** 4 - 1.0)
        try:
            plain = eigenvalues(maps)
            roots = eigenvalues(maps + left[:, None, None] * (maps - coarser))
        except NewtonFailed:  # parts may be too long for the fastest modes
            return roots, math.inf
        last, error = error, _worst_change(plain**power, roots**power)
        # Two that meet at 1, as at a Hopf point, have half the digits.
        if error <= tolerance or error > 0.5 * last:
            break
        fewer, coarser = parts, maps
        parts = np.ceil(np.clip((2.0 * error / tolerance) ** 0.25, 1.5, 2.0) * parts).astype(int)
    return roots, error


def _by_collocation(
    motion: VectorField,
    orbit: PeriodicOrbit,
    parts: NDArray[np.int_],
    tolerance: float,
) -> tuple[Complex, float]:
    """Roots of the multipliers and the error of the worst, by collocation.

    The equations are those that the orbit solves, with interval i divided into parts[i] parts, and
    those on meshes half and twice as fine. Halving leaves 2^-15 of the error where f is smooth, and
    2^-3 across kinks at unknown phases; somewhat more is allowed for both.
    """
    left = 1e-3 if motion.model.kinks_known else 0.25
    if (parts > 1).any() and 2 * parts.sum() <= MOST_FLOQUET_INTERVALS:
        orbit = refined(motion, orbit, parts, at_kinks=True)
    roots, error = _roots(motion, orbit), math.inf
    power = 2 if orbit.symmetric else 1
    if coarser := joined_in_pairs(motion, orbit):
        error = 0.1 * _worst_change(_roots(motion, coarser) ** power, roots**power)
    for _ in range(MOST_HALVINGS):
        if error <= tolerance or 2 * len(orbit.starts) > MOST_FLOQUET_INTERVALS:
            break
        orbit = refined(motion, orbit, np.full(len(orbit.starts), 2))
        before, roots = roots, _roots(motion, orbit)
        last, error = error, left * _worst_change(before**power, roots**power)
        if error > 0.5 * last:
            break
    return roots, error


def _roots(motion: VectorField, orbit: PeriodicOrbit) -> Complex:
    """The roots of the multipliers by the collocation on the orbit's own mesh."""
    return _roots_of_maps(motion, orbit, *collocation_maps(motion, orbit))


def _worst_change(before: Complex, after: Complex) -> float:
    """Largest change of a multiplier, relative if above 1."""
    moved = np.abs(before[:, None] - after) / np.maximum(np.abs(after), 1.0)
    return float(moved[np.arange(len(moved)), _core.assignment(moved)].max())


def _roots_of_maps(motion: VectorField, orbit: PeriodicOrbit, maps: Array, units: Array) -> Complex:
    """Roots of the multipliers from the maps of intervals, in units of the state."""
    free = motion.model.free_states(orbit.starts[0]) if motion.constrained else None
    found, parts = list[Complex](), uncoupled(motion, orbit)
    for part in parts:
        own = maps if len(parts) == 1 else maps[:, part[:, None], part]
        allowed = None  # directions in the plane or across it that supports leave free
        if free is not None:
            allowed = scipy.linalg.orth(free[part], 1e-9) / units[part, None]
        found.append(eigenvalues_through(own, allowed))
    return np.asarray(orbit.mirror_sign * np.concatenate(found))


def eigenvalues_through(maps: Array, allowed: Array | None = None) -> Complex:
    """Eigenvalues of the product of intervals' maps, (M, n, n), on the span of allowed columns.

    Raises:
        NewtonFailed: if they overflow.
    """
    count_factorisations()
    with np.errstate(over="raise", invalid="raise"):
        try:
            relation = _core.SpanRelation(maps, LOSS)
            left, right = relation.first, relation.last
            if allowed is not None:
                allowed, _ = np.linalg.qr(allowed)
                left = allowed.T @ np.linalg.solve(right, left @ allowed)
                right = np.eye(len(left))
            if np.array_equal(right, np.eye(len(right))):
                values = np.asarray(np.linalg.eigvals(-left), dtype=np.complex128)
            else:
                values = _core.general_values(left, -right)
            if not (np.abs(values) < 1e150).all():  # its square is finite
                raise FloatingPointError
        except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
            raise NewtonFailed("its Floquet multipliers overflow") from error
    return values


def fast_turns(motion: VectorField, orbit: PeriodicOrbit) -> Array:
    """Product |lambda| h of the fastest mode that persists, for each interval, shape (M,).

    A mode that decays by more than exp(-25) over the span ends below 1e-11 of its size.
    """
    every = len(orbit.starts) // 2
    some = np.ascontiguousarray(orbit.starts[::every].T)
    motion = motion.along(orbit.edges[:-1:every], orbit.frequency)
    count_factorisations(some.shape[1])
    rates = np.linalg.eigvals(motion.jacobians(some, orbit.u))
    persist = rates.real > -25.0 * orbit.frequency / orbit.span
    return np.asarray(orbit.durations * np.abs(rates[persist]).max(initial=0.0))


# --------------------------------------------------------------------- passing the unit circle


def nontrivial(multipliers: ArrayLike) -> Complex:
    """All multipliers but the one nearest to 1."""
    given = np.asarray(multipliers, dtype=np.complex128)
    return np.delete(given, int(np.argmin(np.abs(given - 1.0))))


def circle_margin(error: float = 0.0) -> float:
    """Largest distance from 1 of a multiplier's modulus at which it counts as on the unit circle.

    It is three times the error of the multipliers, between `UNIT` and `LARGEST_ERROR`.
    """
    return max(UNIT, min(3.0 * error, LARGEST_ERROR))


def beyond_circle(multipliers: ArrayLike, error: float = 0.0) -> Array:
    """Logarithms of moduli relative to 1 + `circle_margin`, of the shape of the multipliers.

    A motion is stable if none is positive.
    """
    return np.log(np.maximum(np.abs(multipliers), 1e-300) / (1.0 + circle_margin(error)))


@dataclass(kw_only=True)
class CircleTest(TestFunction):
    """Test function along a branch of orbits that is 0 where a multiplier passes the unit circle.

    Special points have the names of events by default, without folds, which the tangent shows.
    With a mirror symmetry of the orbit its multipliers are squares of their roots, the eigenvalues
    of the map over half a period followed by the reflection, which distinguish a pitchfork from a
    fold. Without it the roots are the multipliers.

    Attributes:
        roots: function from an arc length to the roots of the multipliers, the largest first; the
            values of the test function are `beyond_circle` of these multipliers.
        multipliers: the multiplier that passes, on the unit circle, by the arc length right beyond.
    """

    roots: Callable[[float], Complex]
    multipliers: dict[float, complex] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.name = self.name or self.kind_but_fold

    def kind(self, before: float, beyond: float) -> EventKind:
        """Kind of the event between two arc lengths; keeps the multiplier that passes there."""
        passing = min(self.positive(before), self.positive(beyond))
        root = complex(self.roots(beyond)[passing])
        root /= abs(root)
        mirrored = self.step.problem.orbit(self.step.at(beyond).z).symmetric
        kind: EventKind = "torus"
        if abs(root.imag) < 1e-3:  # two roots that meet split by sqrt(error)
            flipped: EventKind = "pitchfork" if mirrored else "period doubling"
            kind = "fold" if root.real > 0.0 else flipped
            root = complex(math.copysign(1.0, root.real))
        self.multipliers[beyond] = root**2 if mirrored else root
        return kind

    def kind_but_fold(self, before: float, beyond: float) -> str:
        """Kind of the event between two arc lengths; empty for a fold, which the tangent shows.

        In three dimensions a multiplier that passes 1 away from folds belongs to motions across the
        plane of the cycle.
        """
        kind = self.kind(before, beyond)
        if kind != "fold":
            return kind
        return "branch point" if self.step.problem.motion.model.dimensions == 3 else ""
