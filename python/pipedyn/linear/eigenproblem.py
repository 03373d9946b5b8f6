# SPDX-License-Identifier: MIT
"""P(lambda, u) x = 0 of any model, for the core, which solves it: see `cpp/pipedyn/linear`.

The products come from `model.pencil()`; all is done in elastic coordinates, where the elastic
stiffness is the identity. Chains are solved by recursion along them, others by their matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import Model
from pipedyn.models.pencil import Pencil, Vectors

Complex = NDArray[np.complex128]


class Eigenproblem:
    """P(lambda, u) x = 0 of one model.

    Args:
        pencil: the model's.
    """

    def __init__(self, pencil: Pencil) -> None:
        self.pencil = pencil
        self.model, self.pipe, self.dof = pencil.model, pencil.pipe, pencil.dof
        self.is_damped, self.is_long = pencil.is_damped, pencil.is_long

    @property
    def rows(self) -> int:
        """Rows of the largest matrix that a solve hands to LAPACK; recursion has none."""
        return 1 if self.is_long else 2 * self.dof

    @cached_property
    def is_conservative(self) -> bool:
        """Whether eigenvalues come in fours, lambda, -lambda and conjugates, at every speed.

        No damping, gyroscopic forces only and symmetric stiffness: ends that do no work.
        """
        if self.is_damped or self.pencil.end_moves:
            return False
        angles = np.arange(1.0, self.dof + 1.0)
        x, y = np.cos(angles)[:, None], np.sin(2.0 * angles)[:, None]

        def differ(product: Callable[[Vectors], Vectors], sign: float) -> bool:
            one, other = float((x.T @ product(y))[0, 0]), float((y.T @ product(x))[0, 0])
            size = float(np.abs(x * product(y)).sum()) + self.dof  # springs have stiffness 1
            return abs(one - sign * other) > 1e-11 * size

        of = self.pencil
        thrust = of.centrifugal != 0.0 and differ(of.flux, 1.0)
        return not (thrust or differ(of.velocity, -1.0) or differ(of.stiffness, 1.0))

    @cached_property
    def zero_tolerance(self) -> float:
        """|lambda| below which a root counts as zero.

        A double zero scatters by the square root of rounding, the triple one of a free joint by its
        cube root; damping slows all that is near zero.
        """
        least = 1e-4 if (self.model.elastic_share == 0.0).any() else 1e-6
        return least / max(1.0, self.pipe.damping)

    def velocity_free(self, u: float) -> bool:
        """Whether P holds lambda only as lambda^2: no damping, and no flow or no fluid mass."""
        return not self.is_damped and (u == 0.0 or self.pipe.beta == 0.0)

    def spectrum(self) -> _core.Eigenproblem:
        """For the core: what it computes is the same from call to call, but not kept here."""
        traits = _core.Traits(
            dof=self.dof,
            delta=self.pipe.damping,
            zero=self.zero_tolerance,
            damped=self.is_damped,
            conservative=self.is_conservative,
            squared=self.velocity_free(1.0),
            free_at_rest=self.velocity_free(0.0),
        )
        # Of the stiffness at rest, elastic stiffness being 1.
        size = 1.0 + abs(self.pipe.gamma) + self.model.term_stiffness(self.pencil)
        return self.pencil.spectrum(traits, size)


def eigenproblem(model: Model) -> Eigenproblem:
    """The model's eigenproblem."""
    return Eigenproblem(model.pencil())
