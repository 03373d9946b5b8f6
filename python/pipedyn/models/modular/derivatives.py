# SPDX-License-Identifier: MIT
"""Forces and accelerations of a scene with their derivatives, custom modules included."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipedyn import _core
from pipedyn.models.modular.custom import CustomForces
from pipedyn.models.modular.layout import Layout
from pipedyn.models.modular.linearisation import SceneMatrices, factored
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.threads import one_thread


def matrix(triplets: Any, rows: int, columns: int) -> Any:
    """A sparse matrix by rows from the core's (rows, columns, values)."""
    row, column, values = triplets
    return sparse.coo_array((values, (row, column)), shape=(rows, columns)).tocsr()


def forces(core: _core.Scene, customs: CustomForces, y: Array, u: float) -> tuple[Array, Any, Any]:
    """Forces of all modules at a state, shape (3 n,), and their derivatives by q and by q', sparse.

    Args:
        core: the compiled scene.
        customs: modules of the user's own.
        y: state [q, q'], shape (6 n,).
        u: flow speed.
    """
    size = core.coordinates
    force = np.array(core.forces(y, u))
    by_q, by_rate = (matrix(part, size, size) for part in core.force_derivatives(y, u))
    for custom in customs.each:
        q, rates, places = y[:size][custom.index], y[size:][custom.index], custom.module.places
        force[custom.index] += custom.force(q, rates)
        by_q = by_q + matrix((*places, custom.by_q(q, rates).ravel()), size, size)
        by_rate = by_rate + matrix((*places, custom.by_qdot(q, rates).ravel()), size, size)
    return force, by_q, by_rate


def scene_matrices(
    core: _core.Scene, pipe: Pipe, layout: Layout, customs: CustomForces, q: Array
) -> SceneMatrices:
    """What all modules are to small motions about redundant coordinates q at rest."""
    size, operators = core.coordinates, core.operators()
    force, by_q, by_rate = forces(core, customs, np.concatenate([q, np.zeros(size)]), 0.0)
    thrust = np.zeros(size)
    if layout.has_flow:
        end = float(np.sum(q[2::3]))
        thrust[-3:-1] = -math.sin(end), -math.cos(end)
    springs = np.zeros(size)
    springs[2::3] = layout.springs
    return SceneMatrices(
        **{name: matrix(triplets, size, size) for name, triplets in operators.items()},
        damping=-by_rate,
        stiffness=-by_q - sparse.diags_array(springs),
        springs=layout.springs,
        force=force,
        thrust=thrust,
        direction=pipe.direction,
        centrifugal=pipe.centrifugal,
    )


def acceleration_jacobian(
    core: _core.Scene,
    customs: CustomForces,
    independent_rows: NDArray[np.bool_],
    y: Array,
    u: float,
) -> Array:
    """Derivative of q'' by the redundant state, (3 n, 6 n), from M q'' + A^T mu = f, A q'' = b.

    Args:
        core: the compiled scene.
        customs: modules of the user's own.
        independent_rows: rows of A that do not depend on others.
        y: state [q, q'], shape (6 n,).
        u: flow speed.
    """
    size = core.coordinates
    _, triplets, wanted, _ = core.constraints(y)
    ties = matrix(triplets, wanted.size, size)[independent_rows]
    solve = _solver(matrix(core.operators()["mass"], size, size), ties)
    force, by_q, by_rate = forces(core, customs, y, u)
    found = solve(np.concatenate([force, wanted[independent_rows]])[:, None])[:, 0]
    multipliers = np.zeros(wanted.size)
    multipliers[independent_rows] = found[size:]
    by_q = by_q - matrix(core.curvature(y[:size], multipliers), size, size)
    of_q, of_rate = (
        matrix(part, wanted.size, size)[independent_rows]
        for part in core.acceleration_derivatives(y, found[:size])
    )
    right = sparse.block_array([[by_q, by_rate], [-of_q, -of_rate]]).toarray()
    result: Array = solve(right)[:size]
    return result


def _solver(mass: Any, ties: Any) -> Callable[[Array], Array]:
    """Solves [M A^T; A 0] [q''; mu] = rows, with rows and unknowns from the clamp to the tip."""
    whole = sparse.block_array([[mass, ties.T], [ties, None]]).tocoo()
    last = np.maximum.reduceat(ties.indices, ties.indptr[:-1]) // 3
    order = np.argsort(np.concatenate([np.arange(mass.shape[0]) // 3, last]), kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    solve = factored(order.size, place[whole.row], place[whole.col], whole.data)

    def in_order(rows: Array) -> Array:
        with one_thread(1):
            solution: Array = solve(rows[order], False)[place]
        return solution

    return in_order
