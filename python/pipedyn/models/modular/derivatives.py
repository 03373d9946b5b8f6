# SPDX-License-Identifier: MIT
"""Derivatives of a scene's forces and accelerations, sparse, custom modules included."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipedyn import _core
from pipedyn.models.modular.custom import CustomForce
from pipedyn.models.modular.layout import Layout
from pipedyn.models.modular.linearisation import SceneMatrices, factored
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.threads import one_thread


def matrix(triplets: Any, rows: int, columns: int) -> Any:
    """A sparse matrix by rows from the core's (rows, columns, values)."""
    row, column, values = triplets
    return sparse.coo_array((values, (row, column)), shape=(rows, columns)).tocsr()


def _spread(custom: CustomForce, block: Array, size: int) -> Any:
    """A custom module's (k, k) among all coordinates."""
    return matrix((*custom.module.places, block.ravel()), size, size)


def scene_matrices(
    core: _core.Scene, pipe: Pipe, layout: Layout, customs: Sequence[CustomForce], q: Array
) -> SceneMatrices:
    """What all modules are to small motions about redundant coordinates q at rest."""
    size, operators = core.coordinates, core.operators()
    names = ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux")
    made = {name: matrix(operators[name], size, size) for name in names}
    zero = np.zeros(size)
    force = np.array(core.forces(np.concatenate([q, zero]), 0.0))
    thrust = np.zeros(size)
    if layout.has_flow:
        end = float(np.sum(q[2::3]))
        thrust[-3:-1] = -math.sin(end), -math.cos(end)
    springs = np.zeros(size)
    springs[2::3] = layout.springs
    made["stiffness"] = made["stiffness"] - sparse.diags_array(springs)
    for custom in customs:
        force[custom.index] += custom.force(q, zero)
        made["stiffness"] = made["stiffness"] - _spread(custom, custom.by_q(q, zero), size)
        made["damping"] = made["damping"] - _spread(custom, custom.by_qdot(q, zero), size)
    return SceneMatrices(
        **made,
        springs=layout.springs,
        force=force,
        thrust=thrust,
        direction=pipe.direction,
        centrifugal=pipe.centrifugal,
    )


def acceleration_jacobian(
    core: _core.Scene,
    customs: Sequence[CustomForce],
    kept_rows: NDArray[np.bool_],
    y: Array,
    u: float,
) -> Array:
    """Derivative of q'' by the redundant state, (3 n, 6 n), from M q'' + A^T mu = f, A q'' = b.

    Args:
        core: the compiled scene.
        customs: modules of the user's own.
        kept_rows: rows of A that do not depend on others.
        y: state [q, q'], shape (6 n,).
        u: flow speed.
    """
    size = core.coordinates
    _, triplets, wanted, _ = core.constraints(y)
    ties = matrix(triplets, wanted.size, size)[kept_rows]
    solve = _solver(matrix(core.operators()["mass"], size, size), ties)
    force = np.asarray(core.forces(y, u))
    by_q, by_rate = (matrix(part, size, size) for part in core.force_derivatives(y, u))
    for custom in customs:
        q, rates = y[:size], y[size:]
        force[custom.index] += custom.force(q, rates)
        by_q = by_q + _spread(custom, custom.by_q(q, rates), size)
        by_rate = by_rate + _spread(custom, custom.by_qdot(q, rates), size)
    found = solve(np.concatenate([force, wanted[kept_rows]])[:, None])[:, 0]
    multipliers = np.zeros(wanted.size)
    multipliers[kept_rows] = found[size:]
    by_q = by_q - matrix(core.curvature(y[:size], multipliers), size, size)
    of_q, of_rate = (
        matrix(part, wanted.size, size)[kept_rows]
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
