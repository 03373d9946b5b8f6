# SPDX-License-Identifier: MIT
"""The plain chain as an assembly, to which further parts are added."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.models.chain import Chain
from pipedyn.models.fitting import Fitting, checked_fittings
from pipedyn.models.modular.assembly import Assembly
from pipedyn.models.modular.parts import (
    Clamp,
    Drag,
    InternalFlow,
    Joint,
    Module,
    PointMass,
    Segment,
    TorsionalSpring,
    TransverseSpring,
)
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array

AT_NODE = 1e-6
"""A fitting this close to a node, in L, is at it, and two this close are at one."""


def chain(
    pipe: Pipe,
    n: int | None = None,
    springs: str | ArrayLike = "consistent",
    *,
    lengths: ArrayLike | None = None,
    centers: ArrayLike | None = None,
    gyration_radii: ArrayLike | None = None,
    drag_points: ArrayLike | None = None,
    base: float = 0.0,
    fittings: Sequence[Fitting] = (),
    enforcement: str = "orthonormal",
) -> Assembly:
    """The chain of `pipedyn.Chain`, put together from parts, with internal flow and drag.

    Args:
        pipe: the pipe.
        n: number of segments; not needed where an array tells it.
        springs: a rule, or the stiffness of each joint, as for `Chain`.
        lengths: of the segments, shape (n,).
        centers: their centres of mass, as fractions, shape (n,).
        gyration_radii: in L, shape (n,).
        drag_points: as fractions, shape (n,).
        base: length of the fixed part at the clamp, in L.
        fittings: point masses and transverse springs, the same that `Galerkin` and `Continuum`
            take, at nodes. Where n is given without lengths, and springs by another rule than
            "midpoint", the segments are cut so that each fitting is at a node.
        enforcement: as for `Assembly`.

    Raises:
        ValueError: as for `Chain` and `Assembly`; for a fitting that is at no node.
        TypeError: for what is no number, array, pipe or fitting.
    """
    fixed = checked_fittings(fittings)
    inner: list[float] = []
    for at in sorted(fitting.at for fitting in fixed if fitting.at < 1.0 - AT_NODE):
        if not inner or at > inner[-1] + AT_NODE:
            inner.append(at)
    if lengths is None and inner and n is not None and not isinstance(springs, str):
        raise ValueError("lengths must be given with springs of your own and fittings inside")
    if lengths is None and inner and n is not None and springs != "midpoint":
        Chain(pipe, n, springs=springs, base=base)  # refuses what is wrong with them
        if n <= len(inner):
            raise ValueError(
                f"n must be more than {len(inner)}, the fittings inside the pipe, got {n}"
            )
        lengths = _cut(n, base, inner)
    plain = Chain(
        pipe,
        n,
        springs=springs,
        lengths=lengths,
        centers=centers,
        gyration_radii=gyration_radii,
        drag_points=drag_points,
        base=base,
    )
    columns = (plain.lengths, plain.centers, plain.gyration_radii, plain.drag_points)
    modules: list[Module] = [
        Segment(*row) for row in zip(*(column.tolist() for column in columns), strict=True)
    ]
    modules += [TorsionalSpring(j, k) for j, k in enumerate(plain.springs.tolist(), start=1)]
    modules += [InternalFlow(), Drag()]
    ends = plain.base + np.cumsum(plain.lengths)
    for fitting in fixed:
        node = int(np.argmin(np.abs(ends - fitting.at))) + 1
        if abs(ends[node - 1] - fitting.at) > AT_NODE:
            raise ValueError(
                f"fittings must be at nodes, got {fitting}; the nearest is at {ends[node - 1]:g}, "
                "and only n segments by a rule other than 'midpoint' are cut to fit"
            )
        if fitting.mass:
            modules.append(PointMass(node, fitting.mass))
        if fitting.stiffness:
            modules.append(TransverseSpring(node, fitting.stiffness))
    joints = [Joint(j) for j in range(2, plain.dof + 1)]
    return Assembly(pipe, modules, [Clamp(plain.base), *joints], enforcement)


def _cut(n: int, base: float, inner: list[float]) -> Array:
    """Lengths of n segments, equal between fittings, whose nodes the fittings are."""
    ends = np.array([base, *inner, 1.0])
    panels = np.diff(ends)
    if panels.min() <= 0.0:
        raise ValueError(f"fittings must lie beyond the base of {base:g}, got one at {inner[0]:g}")
    counts = np.ones(panels.size, dtype=int)
    for _ in range(n - panels.size):
        counts[np.argmax(panels / counts)] += 1
    return np.repeat(panels / counts, counts)
