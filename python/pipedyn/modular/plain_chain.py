# SPDX-License-Identifier: MIT
"""The chain of segments as an assembly, to which further parts can be added."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pipedyn.models.chain import Chain, SpringRule
from pipedyn.models.pipe import Pipe
from pipedyn.modular.assembly import Assembly
from pipedyn.modular.parts import (
    Clamp,
    Drag,
    InternalFlow,
    Joint,
    Module,
    Segment,
    TorsionalSpring,
)


def chain(
    pipe: Pipe,
    n: int | None = None,
    *,
    springs: SpringRule | ArrayLike = "consistent",
    lengths: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    gyration_radii: ArrayLike | None = None,
    drag_points: ArrayLike | None = None,
    base: float = 0.0,
    masses: ArrayLike | None = None,
) -> Assembly:
    """The chain of `pipedyn.Chain`, put together from parts, with internal flow and drag.

    Args:
        pipe: the pipe.
        n: number of segments; not needed if an array gives it.
        springs: a rule, or the stiffness of each joint, as for `Chain`.
        lengths: lengths of the segments in L, as for `Chain`.
        centres: centres of mass, as fractions of the lengths.
        gyration_radii: radii of gyration about the centres of mass, in L.
        drag_points: places at which drag acts, as fractions of the lengths.
        base: length of the fixed part at the clamp, in L.
        masses: masses of the segments, as for `Chain`.

    Example:
        >>> scene = pp.modular.chain(pp.Pipe(0.2), 10)
        >>> round(pp.critical_speed(scene).speed, 4)
        5.4857

    Raises:
        ValueError: as for `Chain` and `Assembly`.
        TypeError: for arguments that are not numbers, arrays or pipes.
    """
    plain = Chain(
        *(pipe, n),
        springs=springs,
        lengths=lengths,
        centres=centres,
        gyration_radii=gyration_radii,
        drag_points=drag_points,
        base=base,
        masses=masses,
    )
    columns = [plain.lengths, plain.centres, plain.gyration_radii, plain.drag_points]
    if masses is not None or pipe.mass is not None:
        columns.append(plain.masses)
    modules: list[Module] = [
        Segment(*row) for row in zip(*(column.tolist() for column in columns), strict=True)
    ]
    springs = [*plain.springs.tolist(), plain.end_spring][: plain.coordinates + pipe.end_directed]
    modules += [TorsionalSpring(j, k) for j, k in enumerate(springs, start=1)]
    modules += [InternalFlow(), Drag()]
    joints = [Joint(j) for j in range(2, plain.coordinates + 1)]
    return Assembly(pipe, modules, [Clamp(plain.base), *joints])
