# SPDX-License-Identifier: MIT
"""References: answers of the continuous pipe whose own error is known.

Reduced models grow until two answers agree; by how much they differ bounds the error of the last.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

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
        candidates: roots among which another model's are looked for, where they are more than those
            asked for: beyond these may be one that the other model counts among them.
    """

    values: NDArray[Any]
    kind: str = ""
    error: float = 0.0
    damping: float = 0.0
    candidates: NDArray[Any] | None = None


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
