# SPDX-License-Identifier: MIT
"""References: answers of the continuous pipe whose own error is known.

Reduced models grow until two answers agree; by how much they differ bounds the error of the last.
"""

from __future__ import annotations

from dataclasses import field
from typing import Any

from numpy.typing import NDArray

from pipedyn.util.archive import saved_as
from pipedyn.util.result import Result

MARGIN = 10.0
"""By how much the error of a reference must be smaller than an error measured against it, which is
then known to a tenth."""

LEAST_REFERENCE_ERROR = 1e-14
"""Least error that a reference is given: rounding of an eigenvalue or of a quadrature."""


@saved_as("Answer")
class Answer(Result):
    """What a model answered, or of the continuous pipe: a reference.

    Attributes:
        values: numbers, real or complex, of a shape that the quantity sets.
        kind: what must agree besides numbers, as that a loss of stability is flutter.
        error: relative: the solver's own; of a reference a bound, what the last growth of the model
            changed in it.
        damping: delta, if these are roots: those that cluster at -1 / delta are not compared.
        candidates: roots among which another model's are looked for, where they are more than those
            asked for: beyond these may be one that the other model counts among them.
        source: of a reference, which model gave it.
        family: of a reference, the models that it grew from, if it did.
    """

    values: NDArray[Any] = field(repr=False)
    kind: str = ""
    error: float = 0.0
    damping: float = 0.0
    candidates: NDArray[Any] | None = field(default=None, repr=False)
    source: str = ""
    family: str = ""
