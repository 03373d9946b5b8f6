# SPDX-License-Identifier: MIT
"""References: answers of the continuous pipe whose own error is known.

Reduced models grow until two answers agree; by how much they differ bounds the error of the last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import spherical_jn

from pipedyn.models.pipe import Pipe
from pipedyn.util.result import result

MARGIN = 10.0
"""By how much the error of a reference must be smaller than an error measured against it, which is
then known to a tenth."""

LEAST_ERROR = 1e-14
"""Least error that a reference is given: rounding of an eigenvalue or of a quadrature."""


@result
class Answer:
    """What a model answered.

    Attributes:
        values: numbers, real or complex, of a shape that the quantity sets.
        kind: what must agree besides numbers, as that a loss of stability is flutter.
        error: the solver's own, relative.
        damping: delta, if these are roots: those that cluster at -1 / delta are not compared.
        others: roots beyond those asked for, of which another model may count one among them.
    """

    values: NDArray[Any]
    kind: str = ""
    error: float = 0.0
    damping: float = 0.0
    others: NDArray[Any] | None = None

    @property
    def candidates(self) -> NDArray[Any]:
        """All roots, those asked for first."""
        if self.others is None:
            return self.values
        return np.concatenate([self.values, self.others], axis=-1)


@dataclass(frozen=True)
class Reference:
    """The continuous pipe's answer.

    Attributes:
        answer: the numbers.
        error: bound on their error, relative: by what the last growth of the model moved them.
        source: which model gave it.
        family: of the models that it grew from, if it did.
    """

    answer: Answer = field(repr=False)
    error: float
    source: str
    family: str = ""


def resolving_size(pipe: Pipe, u: float, value: complex, tolerance: float) -> float:
    """About the number of Legendre functions that resolve motions ~ exp(value tau) to a tolerance.

    By what they leave of the shortest wave in it, of wave number k: its share j_(m-1)(k / 2)^2.
    Infinite where 127 functions do not resolve it.
    """
    thrust = pipe.centrifugal * u**2 - 0.5 * pipe.gamma
    coriolis = 2.0 * math.sqrt(pipe.beta) * pipe.direction * u * value
    roots = np.roots([1.0 + pipe.damping * value, 0.0, thrust, coriolis, value**2])
    half = 0.5 * float(np.abs(roots).max(initial=0.0))
    sizes = np.arange(1, 128)
    # Beyond k / 2 functions the share falls; before, it oscillates.
    fits = sizes[(spherical_jn(sizes - 1, half) ** 2 <= tolerance) & (sizes > half)]
    return float(fits[0]) if fits.size else math.inf
