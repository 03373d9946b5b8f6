# SPDX-License-Identifier: MIT
"""Families of models of growing size for one pipe, and the laws by which their errors fall."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.critical_speed import CriticalSpeed
from pipedyn.models.base import Model
from pipedyn.models.chain import Chain
from pipedyn.models.continuum import FUNCTIONS_A_JOINT
from pipedyn.models.galerkin import BASES, Galerkin, basis_joints
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.result import Result

RULES = {"consistent": 2.0, "midpoint": 2.0, "rayleigh": 0.0, "uniform": 1.0, "frequency": 1.0}
"""Order of the errors of each spring rule; 0 for the paper's, which tends to another limit."""


@dataclass(frozen=True)
class ModelFamily:
    """Models of one kind and growing size.

    Attributes:
        name: a spring rule of chains, a spring rule and "pair", or a basis of reduced models.
        order: p of an error n^-p; infinite if the error falls exponentially, 0 if it does not fall.
        sizes: sizes at which `trade` measures the family if none are given.
        largest: largest size that a search tries for a pipe without terms; None if only the
            question sets a limit. 60 Legendre functions resolve wavenumbers up to 120 / L; the
            quadrature of beam modes takes a second from 400 on.
    """

    name: str
    order: float
    sizes: tuple[int, ...]
    largest: int | None = None

    @property
    def paired(self) -> bool:
        """Whether the answer is extrapolated from two models, the second of twice the size."""
        return self.name.endswith(" pair")

    def make(self, pipe: Pipe, size: int, dimensions: Literal[2, 3] = 2) -> Model:
        """The model of a pipe with `size` segments or functions."""
        word = self.name.removesuffix(" pair")
        if word in RULES:
            return Chain(pipe, size, springs=word, dimensions=dimensions)
        return Galerkin(pipe, size, check.choice("basis", word, BASES), dimensions=dimensions)

    def models(self, pipe: Pipe, size: int, dimensions: Literal[2, 3] = 2) -> tuple[Model, ...]:
        """The model of a size; for a pair two models, the second of twice the size."""
        members = (size, 2 * size) if self.paired else (size,)
        return tuple(self.make(pipe, member, dimensions) for member in members)

    def dof(self, size: int) -> int:
        """Degrees of freedom of the model of a size; for a pair the sum of both models."""
        return 3 * size if self.paired else size

    def for_terms(self, pipe: Pipe) -> int:
        """Number of functions that a Legendre basis adds if the terms divide the pipe in panels."""
        return FUNCTIONS_A_JOINT * basis_joints(pipe).size if self.order == math.inf else 0

    def beyond(self, size: int) -> int:
        """A slightly larger size, at which an error near a change of sign is no longer small."""
        return size + 1 if self.order == math.inf else math.ceil(1.2 * size + 0.5)


DOUBLED = (2, 4, 8, 16, 32, 64)
"""Sizes of chains. They double, so that the larger chain of a pair is also one of the sizes.
`limit_cycle` takes at most 100 segments. The sizes of reduced models go beyond 12 Legendre
functions, which leave errors of 8e-14 in a critical speed and 8e-9 in a cycle."""

FAMILIES: dict[str, ModelFamily] = {
    family.name: family
    for family in (
        *(ModelFamily(rule, order, DOUBLED) for rule, order in RULES.items()),
        *(ModelFamily(f"{r} pair", 2.0 * p, DOUBLED[:-1]) for r, p in RULES.items() if p),
        ModelFamily("beam", 4.0, (2, 3, 4, 6, 8, 12, 16, 24), 400),
        ModelFamily("legendre", math.inf, (2, 4, 6, 8, 10, 12, 16), 60),
    )
}

GROUPS: dict[str, tuple[str, ...]] = {
    "chain": tuple(RULES),
    "pair": tuple(name for name in FAMILIES if name.endswith("pair")),
    "reduced": ("beam", "legendre"),
}
"""Words that stand for several families."""


def checked_families(name: str, given: Any, default: Sequence[str]) -> tuple[ModelFamily, ...]:
    """Families by their names or by words for several, without repetition; `default` for None.

    Raises ValueError or TypeError, which names the argument, for anything else.
    """
    words = default if given is None else [given] if isinstance(given, str) else given
    try:
        several = iter(() if isinstance(words, dict) else words)
    except TypeError:
        raise TypeError(f"{name} must be words, got {check.shown(given)}") from None
    found: dict[str, ModelFamily] = {}
    for word in several:
        one = check.choice(name, word, (*GROUPS, *FAMILIES))
        found |= {member: FAMILIES[member] for member in GROUPS.get(one, (one,))}
    if not found:
        raise ValueError(f"{name} must name at least one family, got {check.shown(given)}")
    return tuple(found.values())


# ----------------------------------------------------------------------------- laws of their errors


@saved_as("ConvergenceLaw")
class ConvergenceLaw(Result):
    """How the error of a family's critical speed falls as its models grow.

    Attributes:
        law: "power" (error ~ size^-rate), "exponential" (error ~ rate^-size), "flat" (the error
            tends to `limit`), or "unknown" (no law fits, or there are too few sizes).
        rate: for "power" the order, for "exponential" the factor by which the error falls with each
            degree of freedom; else NaN.
        limit: for "flat" the signed relative error, extrapolated to infinite size; else NaN.
        spread: for "flat" the change of the limit without the smallest size; else NaN.
        sizes: the sizes used, shape (k,).
    """

    law: Literal["power", "exponential", "flat", "unknown"]
    rate: float
    limit: float
    spread: float
    sizes: Array


def relative_errors(
    found: Iterable[CriticalSpeed], exact: CriticalSpeed
) -> tuple[Array, Array, NDArray[np.bool_], float]:
    """Sizes, signed relative errors of the speed, and whether the kind is correct, (k,) each.

    The last value is the part of the errors that comes from the solver: the sum of the relative
    errors of the exact speed and of the least accurate result.
    """
    results = sorted(found, key=lambda result: result.size)
    sizes = np.array([result.size for result in results], dtype=np.float64)
    speeds = np.array([result.speed for result in results])
    same_kind = np.array([result.kind == exact.kind for result in results], dtype=np.bool_)
    own = exact.error + max((result.error for result in results), default=0.0)
    own = float(np.finfo(float).eps) + (own / exact.speed if exact.speed > 0.0 else 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return sizes, (speeds - exact.speed) / exact.speed, same_kind, own


def convergence_law(found: Sequence[CriticalSpeed], exact: CriticalSpeed) -> ConvergenceLaw:
    """The law of the errors of one family's critical speeds; errors near rounding are left out."""
    sizes, errors, same_kind, own = relative_errors(found, exact)
    good = same_kind & np.isfinite(errors) & (np.abs(errors) > 30.0 * own)
    return fitted_law(sizes[good], errors[good])


def fitted_law(sizes: Array, errors: Array) -> ConvergenceLaw:
    """The law by which relative errors (k,), far above rounding, fall as sizes (k,) increase."""
    unknown = ConvergenceLaw("unknown", math.nan, math.nan, math.nan, sizes)
    if sizes.size < 4:
        return unknown
    # The limit of the error is c_0 in c_0 + c_1 / n + c_2 / n^2 + ..., if that converges.
    count = min(5, sizes.size)
    limits = [np.polyfit(1.0 / sizes[-k:], errors[-k:], k - 1)[-1] for k in (count, count - 1)]
    spread = float(abs(limits[0] - limits[1]))
    near = abs(limits[0]) < 2.0 * abs(errors[-1])  # extrapolation of a fast decay is meaningless
    if near and abs(limits[0]) > max(0.3 * abs(errors[-1]), 5.0 * spread):
        return ConvergenceLaw("flat", math.nan, float(limits[0]), spread, sizes[-5:])
    last = sizes >= min(sizes[-1] / 2.0, sizes[-4])
    sizes, logs = sizes[last], np.log(np.abs(errors[last]))
    largest = int(np.argmax(logs))  # before the largest error, models are too small to show a law
    if sizes.size - largest < 3:
        return replace(unknown, sizes=sizes)
    sizes, logs = sizes[largest:], logs[largest:]
    power, power_misfit = _straight_fit(np.log(sizes), logs)
    exponential, misfit = _straight_fit(sizes, logs)
    if min(power_misfit, misfit) > 0.1 * float(np.ptp(logs)):
        return replace(unknown, sizes=sizes)
    # Orders of families are 1 to 4, so an error that falls faster than size^-8 follows no power.
    if (misfit < power_misfit or -power > 8.0) and exponential < -math.log(2.0):
        return ConvergenceLaw("exponential", math.exp(-exponential), math.nan, math.nan, sizes)
    return ConvergenceLaw("power", -power, math.nan, math.nan, sizes)


def _straight_fit(x: Array, y: Array) -> tuple[float, float]:
    """Slope and root mean square misfit of the straight line fitted to y (k,) over x (k,)."""
    slope, start = np.polyfit(x, y, 1)
    return float(slope), float(np.sqrt(np.mean((start + slope * x - y) ** 2)))
