# SPDX-License-Identifier: MIT
"""Constraints of a chain whose nodes are held by guides and pins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Operators
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged

MET = 1e-9
"""Tolerance of given states in the constraints, in L and rad, and for rates in these per T.

States with ten digits meet it; it is far above rounding, 1e-15 n.
"""

SAME = 1e-12
"""Distance below which places are equal and guides and pins are met; rounding is some 1e-15."""


class ChainSupports:
    """Constraints on the coordinates of held nodes, and the states that meet them.

    Args:
        core: the compiled scene that holds the nodes.
        rows: derivative of the constraints by the angles of the segments, (n, c) as a function of
            angles (n,); the c columns are independent.
    """

    def __init__(self, core: _core.Scene, rows: Callable[[Array], Array]) -> None:
        self.core, self.rows = core, rows

    def onto_constraints(self, theta: Array, omega: Array) -> tuple[Array, Array]:
        """Nearby angles and rates that meet guides and pins; NaN where none are found."""
        columns = (theta.shape[0], -1)
        *met, missed = self.core.project(theta.reshape(columns), omega.reshape(columns))
        for of in met:
            of[:, missed > self.core.met] = np.nan
        return met[0].reshape(theta.shape), met[1].reshape(theta.shape)

    def free_states(self, y: Array) -> Array:
        """Orthonormal changes of [theta, theta'] that constraints allow, (2 n, 2 dof)."""
        theta, omega = np.split(y, 2)
        by_angles = self.rows(theta)
        drift = omega[:, None] * self.rows(theta + 0.5 * math.pi)
        held = np.block([[by_angles, drift], [np.zeros_like(drift), by_angles]])
        vectors, _, _ = np.linalg.svd(held)
        return np.asarray(vectors[:, 2 * by_angles.shape[1] :])

    def bent(self, chain: Operators, theta: Array, moments: Array, scale: Array) -> Operators:
        """The chain's operators in its angles, with the stiffness of the forces that hold nodes.

        The forces balance the moments at rest, and their own moments change as the segments turn.
        They are found by least squares in elastic coordinates, where stiff springs do not hide soft
        ones.

        Args:
            chain: the operators of the chain without supports.
            theta: angles of the segments, shape (n,).
            moments: the columns of `rest_moments`, shape (n, 3).
            scale: joint angle for a unit of each elastic coordinate, shape (n,).
        """
        rows, loads = (
            scale[:, None] * np.cumsum(of[::-1], axis=0)[::-1] for of in (self.rows(theta), moments)
        )
        # The rows are independent: no singular value is due to rounding, so that none is cut off.
        forces, *_ = np.linalg.lstsq(rows, -loads, rcond=0.0)
        by_turning = self.rows(theta + 0.5 * math.pi) @ forces
        still, thrust, push = map(np.diag, by_turning.T)
        return replace(
            chain,
            stiffness=chain.stiffness - still,
            flux=chain.flux - thrust,
            unsteady=chain.unsteady - push,
        )


def rest_moments(core: _core.Chain, theta: Array, lengths: Array, pipe: Pipe) -> Array:
    """Moments on the segments of a chain at rest, shape (n, 3).

    The first column has the moments without flow, the others the factors of a u^2 and of s u'.

    Args:
        core: the compiled chain.
        theta: angles of the segments, shape (n,).
        lengths: lengths of the segments, shape (n,).
        pipe: the pipe.
    """
    still = core.rhs(0.0, np.append(theta, 0.0 * theta), 0.0, refuses=False)[theta.size :]
    if still.any():
        still = core.operators(theta).mass @ still
    end = (0.0 if pipe.end_directed else theta[-1]) + pipe.jet_angle
    # The product of one direction exp(i theta) with another's conjugate gives the sine of their
    # difference.
    turned = lengths * np.exp(1j * theta)
    beyond = np.cumsum(turned[::-1])[::-1] - turned
    push = -math.sqrt(pipe.beta) * (np.conj(turned) * beyond).imag
    return np.stack([still, lengths * np.sin(theta - end), push], axis=1)


def held_ends(pipe: Pipe, ends: Array) -> NDArray[np.intp]:
    """Indices of segments whose ends are held on the axis by supports or the pipe's end, from 0 on.

    Raises ValueError for a support at which no segment ends.
    """
    held = []
    for place in pipe.supports:
        nearest = int(np.abs(ends - place).argmin())
        if abs(ends[nearest] - place) > MET:
            raise ValueError(
                f"a segment must end at each support, got none that ends at s = {place:g}"
            )
        held.append(nearest)
    if pipe.end_held:
        held.append(ends.size - 1)
    return np.array(held, dtype=np.intp)


def closest(core: _core.Scene, starts: Iterable[Array]) -> tuple[Array, float]:
    """Angles that meet guides and pins, from the first start that converges, else the closest."""
    best, least = np.zeros(0), math.inf
    for start in starts:
        found, _, missed = core.project(start[:, None], np.zeros((start.size, 1)))
        if missed[0] < least:
            best, least = found[:, 0], float(missed[0])
        if least <= SAME:
            break
    return best, least


def closed(core: _core.Scene, theta: Array, rest: Array, held_by: str) -> Array:
    """Angles close to those given, shape (n,), that meet guides and pins.

    If Newton's method fails, as for segments in line with a pin, it starts again from points
    between the given angles and `rest`, a known configuration that meets all constraints.

    Raises NotConverged, with a message that names what holds the nodes, if no angles are found.
    """
    shares = (0.0, 0.25, 0.5, 0.75, 1.0)
    found, missed = closest(core, (theta + share * (rest - theta) for share in shares))
    if missed > SAME:
        raise NotConverged(f"no angles close to those given meet {held_by}", found)
    return found
