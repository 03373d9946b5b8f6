# SPDX-License-Identifier: MIT
"""Supports of reduced models, and of all in three dimensions: the pipe is held across, x = 0.

In three dimensions z = 0 as well.

The core's functions have slope 0 where the direction is held, but need not be 0 where the pipe is
held across. In small motions this is a linear condition, w(s) = 0, and a model's functions are
combinations that meet it. In large motions the condition is not linear in q; forces along x keep
it. An integrator's deviation from it decays, and recorded states are projected onto it.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipedyn import _core
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged, resolved

STENCIL = np.array([45.0, -9.0, 1.0]) / 60.0
"""Weights of central differences of sixth order, for 1, 2 and 3 steps to either side."""

SUPPORT_MISSED = 1e-13
"""Displacement x at a support, in L, that counts as 0: a hundred times rounding."""

SUPPORT_TOLERANCE = 1e-6
"""Largest distance from supports of a state given in all coordinates: integrators' tolerances."""

MOST_PROJECTIONS = 30
"""Largest number of Newton steps; four or five suffice if supports are missed by 0.1."""


class ReducedSupports:
    """Constraints of a reduced model by its supports.

    Args:
        core: the compiled model with `size` functions.
    """

    def __init__(self, core: _core.Galerkin) -> None:
        self.core = core
        stiffness = core.elastic_stiffness()
        self.ease = 1.0 / np.maximum(stiffness, 1.0)[:, None]  # least elastic energy
        self.size = stiffness.size

    def held(self, q: Array) -> tuple[Array, Array]:
        """Displacements x at supports, (supports, k), and derivatives by q, (k, supports, size).

        They are NaN for columns of q that coil the pipe more often than the core resolves.
        """
        found = self.core.held(np.concatenate([q, np.zeros_like(q)]))
        places, by = np.split(found, [self.core.supports])
        return places, by.reshape(len(places), self.size, -1).transpose(2, 0, 1)

    def onto_constraints(self, q: Array, rates: Array) -> tuple[Array, Array]:
        """Nearby coordinates and rates that meet the supports; NaN where none are found."""
        columns, turning = (of.reshape(self.size, -1).copy() for of in (q, rates))
        missed, by = self.held(columns)
        for _ in range(MOST_PROJECTIONS):
            if not np.nanmax(np.abs(missed), initial=0.0) > 0.1 * SUPPORT_MISSED:
                break
            columns -= self._step(by, missed)
            missed, by = self.held(columns)
        off = ~(np.abs(missed) <= SUPPORT_MISSED).all(axis=0)
        by[off] = np.nan
        turning -= self._step(by, np.einsum("kbi,ik->bk", by, turning))
        columns[:, off] = turning[:, off] = np.nan
        return columns.reshape(q.shape), turning.reshape(rates.shape)

    def _step(self, by: Array, missed: Array) -> Array:
        """The least change of each column by which x at the supports changes by `missed`.

        It is 0 for columns whose x, or its derivative `by`, is not known.
        """
        known = np.isfinite(missed).all(axis=0) & np.isfinite(by).all(axis=(1, 2))
        eased, change = by[known] * self.ease.T, np.zeros((self.size, len(by)))
        inverse = np.linalg.pinv(eased @ by[known].transpose(0, 2, 1))
        change[:, known] = np.einsum("kbi,kbc,ck->ik", eased, inverse, missed[:, known])
        return change

    def allowed(self, q: Array) -> Array:
        """Orthonormal changes of coordinates that the supports allow, (size, size - supports).

        Raises NotResolved if q coils the pipe more often than the core resolves.
        """
        by = resolved("operators", lambda: self.held(q[:, None])[1])
        vectors, _ = np.linalg.qr(by[0].T, mode="complete")
        return np.asarray(vectors[:, len(by[0]) :])

    def largest_turning(self, rates: Array) -> float:
        """Largest rate at which the pipe turns, for rates of coordinates, (size,)."""
        return float(np.abs(self.core.basis(np.linspace(0.0, 1.0, 41), 1) @ rates).max())

    def free_states(self, y: Array) -> Array:
        """Changes of states [q, q'] that the supports allow, (2 size, 2 (size - supports)).

        The changes are orthonormal and keep, to first order, x at the supports and its rate.
        """
        q, rates = np.split(y, 2)
        # The derivative of x' by q is the rate of dx/dq along the motion.
        step = 0.01 / max(self.largest_turning(rates), 1e-100)
        _, by = self.held(q[:, None] + step * np.arange(-3, 4) * rates[:, None])
        drift = np.tensordot(np.array([*-STENCIL[::-1], 0.0, *STENCIL]) / step, by, 1)
        vectors, _ = np.linalg.qr(np.block([[by[3], 0.0 * drift], [drift, by[3]]]).T, "complete")
        return np.asarray(vectors[:, 2 * len(drift) :])


class MeetsSupports:
    """What makes the states of a model meet its supports: a base class to stand before `Model`."""

    _rows: Any  # those of `Model`
    dof: Any
    coordinates: Any

    @property
    @abstractmethod
    def _is_held(self) -> bool:
        """Whether anything holds the pipe across beyond its root."""

    @property
    @abstractmethod
    def _supports(self) -> ReducedSupports:
        """The constraints."""

    @abstractmethod
    def _lifted(self, rows: Array) -> Array:
        """All coordinates, (coordinates,), of a small displacement by degrees of freedom."""

    def free_directions(self, p: Array) -> Array:
        return self._supports.allowed(p) if self._is_held else np.eye(self.dof)

    def free_states(self, y: Array) -> Array:
        return self._supports.free_states(y) if self._is_held else np.eye(2 * self.dof)

    def onto_constraints(self, p: Array, rates: Array) -> tuple[Array, Array]:
        return self._supports.onto_constraints(p, rates) if self._is_held else (p, rates)

    def initial_state(self, q0: ArrayLike, qdot0: ArrayLike | None) -> Array:
        q, exact = self._amplitudes_of("q0", q0)
        rates = np.zeros_like(q) if qdot0 is None else self._amplitudes_of("qdot0", qdot0)[0]
        state = self._onto_supports("q0", q, rates)
        missed = float(np.abs(state - np.concatenate([q, rates])).max())
        if exact and missed > SUPPORT_TOLERANCE:
            raise ValueError(
                f"q0 and qdot0 must meet the supports, got a deviation of {missed:.1e}; those "
                f"close to {self.dof} small amplitudes are found"
            )
        return state

    def _amplitudes_of(self, name: str, given: ArrayLike) -> tuple[Array, bool]:
        """All coordinates, and whether the argument has all of them."""
        rows: Array = self._rows(name, given, self.dof, self.coordinates)
        if rows.size == self.coordinates:
            return rows, True
        return self._lifted(rows), False

    def _onto_supports(self, name: str, q: Array, rates: Array) -> Array:
        """The nearby state [q, q'] that meets the supports."""
        state = np.concatenate(self.onto_constraints(q, rates))
        if not np.isfinite(state).all():
            raise NotConverged(f"no configuration close to {name} meets the supports", q)
        return state

    def _coordinates(self, q: ArrayLike) -> Array:
        rows, exact = self._amplitudes_of("q", q)
        return rows if exact else self._onto_supports("q", rows, np.zeros_like(rows))[: rows.size]


class FreeFunctions:
    """A model's functions as combinations of the core's, with their elastic stiffness.

    Only functions that supports hold are combined: all beam modes, and Legendre functions of degree
    0 and 1, as the others vanish at the ends of panels. The combinations have unit elastic
    stiffness and are orthogonal in it.

    Args:
        core: the compiled model; for a beam held at its end its first function is the shape under a
            force there.
        held: arc lengths at which the pipe is held across, ascending.
        beam: whether the functions are beam modes.

    Attributes:
        lift: amplitudes of the core's functions for each of the model's, (core's, model's).
        scale: amplitude for a unit of each elastic coordinate, (model's,).
        share: elastic stiffness in elastic coordinates, (model's,): 1, but less for a function that
            hardly bends.
    """

    def __init__(self, core: _core.Galerkin, held: tuple[float, ...], beam: bool) -> None:
        stiffness = core.elastic_stiffness()
        self.scale = 1.0 / np.sqrt(np.maximum(stiffness, 1.0))
        self.share = stiffness * self.scale**2
        self.lift = np.eye(stiffness.size)
        self._core = core
        if not held:
            return
        (low, *high), count = self.groups, stiffness.size
        end_shape: list[int] = []
        if beam:
            end_shape, inner = ([0], held[:-1]) if held[-1] == 1.0 else ([], held)
            modes = list(range(len(end_shape), count))
            low, high, held = (modes, [], inner) if inner else ([], [modes], inner)
        rows = core.basis(np.array(held), 0)[:, low] * self.scale[low]
        combined = _orthonormal_zeros(rows, self.share[low])
        own, first = [k for of in high for k in of], combined.shape[1]
        self.lift = np.zeros((count, first + len(own)))
        self.lift[low, :first] = self.scale[low, None] * combined
        self.lift[own, first:] = np.eye(len(own))
        unit = np.ones(first)
        self.scale = np.concatenate([unit, self.scale[own]])
        self.share = np.concatenate([unit, self.share[own]])
        places = iter(range(first, first + len(own)))
        self.groups = [list(range(first)), *([next(places) for _ in of] for of in high)]

    @cached_property
    def groups(self) -> list[list[int]]:
        """Indices of functions in groups, each in the order in which larger models append to it.

        The first group has the functions that supports hold, the others those of one panel each.
        """
        panels = self._core.functions_by_panel()
        of_degree = [[of[k] for of in panels if len(of) > k and of[k] >= 0] for k in (0, 1)]
        others = sorted(set(range(self.scale.size)).difference(*panels))
        return [[*others, *of_degree[0], *of_degree[1]], *(of[2:] for of in panels)]


def orthonormal(elastic: Array, share: Array) -> tuple[Array, Array]:
    """Combinations of functions in which the elastic stiffness is diagonal.

    Args:
        elastic: stiffness matrix of a pipe that is not uniform, (m, m).
        share: stiffness of the same functions on a uniform pipe, (m,): 1, less for one function at
            most.

    Returns:
        Amplitudes of the functions for each combination, (m, m), and the stiffness of the
        combinations, (m,): 1, less for one. Each combination contains the function of its own index
        and those before it, which a larger model has as well; the function with less than 1, which
        the others need not contain, comes last.
    """
    count, soft = share.size, int(np.argmin(share))
    order = [*(k for k in range(count) if k != soft), soft] if share[soft] < 1.0 else range(count)
    places = np.array(order)
    missing = 1.0 - share[places]
    factor = np.linalg.cholesky(elastic[np.ix_(places, places)] + np.diag(missing))
    by, found = np.zeros((count, count)), np.ones(count)
    by[np.ix_(places, places)] = scipy.linalg.solve_triangular(factor, np.eye(count), lower=True).T
    found[places] -= missing / np.diag(factor) ** 2
    return by, found


def _orthonormal_zeros(rows: Array, share: Array) -> Array:
    """Null space of rows (r, k), orthonormal with weights that are 1 but for one."""
    factors, _ = np.linalg.qr(rows.T, mode="complete")
    free = factors[:, len(rows) :]
    soft = int(np.argmin(share)) if share.size else 0
    part = free[soft : soft + 1]
    size = float(np.sum(part**2))
    lost = size * (1.0 - float(share[soft])) if share.size else 0.0
    if lost == 0.0:
        return free
    return free + free @ part.T @ part * ((1.0 / np.sqrt(1.0 - lost) - 1.0) / size)
