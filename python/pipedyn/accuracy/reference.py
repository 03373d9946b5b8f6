# SPDX-License-Identifier: MIT
"""References: answers of the continuous pipe with a bound on their error.

Reduced models of growing size are solved until two answers agree; their difference bounds the error
of the last.
"""

from __future__ import annotations

from dataclasses import field
from typing import Any

from numpy.typing import NDArray

from pipedyn.util.archive import saved_as
from pipedyn.util.result import Result

MARGIN = 10.0
"""Least ratio of an error to the error of the reference it is measured against. Such an error is
known to a tenth."""

LEAST_REFERENCE_ERROR = 1e-14
"""Least error stated for a reference: the rounding of an eigenvalue or of a quadrature."""


@saved_as("Answer")
class Answer(Result):
    """The answer of a model or, as a reference, of the continuous pipe.

    Attributes:
        values: the numbers, real or complex; their shape depends on the quantity.
        kind: a word that must agree besides the numbers, e.g. "flutter" for a loss of stability.
        error: relative error of the solver; for a reference a bound on its error, from the change
            between the last two models.
        damping: delta if the values are roots; roots in the cluster at -1 / delta are not compared.
        candidates: roots in which those of another model are looked for, if more were computed than
            asked for; the other model may count one of the surplus roots among those asked for.
        source: for a reference, the model that gave it.
        family: for a reference from models of growing size, the name of their family.
    """

    values: NDArray[Any] = field(repr=False)
    kind: str = ""
    error: float = 0.0
    damping: float = 0.0
    candidates: NDArray[Any] | None = field(default=None, repr=False)
    source: str = ""
    family: str = ""
