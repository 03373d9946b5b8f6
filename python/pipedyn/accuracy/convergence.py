# SPDX-License-Identifier: MIT
"""Families of models of one pipe, each growing with a size, and the laws by which errors fall."""

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
from pipedyn.models.galerkin import Galerkin, basis_joints
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.result import Result

RULES = {"consistent": 2.0, "midpoint": 2.0, "rayleigh": 0.0, "uniform": 1.0, "frequency": 1.0}
"""Spring rules and the order of their errors; the paper's tends to another limit."""


@dataclass(frozen=True)
class ModelFamily:
    """Models of one kind and growing size, named by a spring rule, that and "pair", or a basis.

    Attributes:
        order: of the error, n^-order; infinite where it falls exponentially, 0 where it stays.
        sizes: at which `trade` measures the family where none are given.
        largest: size, without terms, up to which a search goes; None where only the question sets
            a limit. 60 Legendre functions resolve waves of 120 / L; the quadrature of beam modes
            takes a second from 400 on.
    """

    name: str
    order: float
    sizes: tuple[int, ...]
    largest: int | None = None

    @property
    def paired(self) -> bool:
        """Whether the answer is extrapolated from the models of one and of twice the size."""
        return self.name.endswith(" pair")

    def make(self, pipe: Pipe, size: int) -> Model:
        """One model of a pipe."""
        word = self.name.removesuffix(" pair")
        return Chain(pipe, size, springs=word) if word in RULES else Galerkin(pipe, size, word)

    def models(self, pipe: Pipe, size: int) -> tuple[Model, ...]:
        """One model, or two, the second of twice the size."""
        members = (size, 2 * size) if self.paired else (size,)
        return tuple(self.make(pipe, member) for member in members)

    def dof(self, size: int) -> int:
        """Degrees of freedom of the model, or of the two."""
        return 3 * size if self.paired else size

    def for_terms(self, pipe: Pipe) -> int:
        """Functions that a Legendre basis takes on top, where the pipe is divided into panels."""
        return FUNCTIONS_A_JOINT * basis_joints(pipe).size if self.order == math.inf else 0

    def beyond(self, size: int) -> int:
        """The next size, at which an error that is small only by a change of sign is not."""
        return size + 1 if self.order == math.inf else math.ceil(1.2 * size + 0.5)


DOUBLED = (2, 4, 8, 16, 32, 64)
"""Sizes of chains: doubled, each pair but the last has its larger chain among them. A limit cycle
of 64 segments takes 6 s, of the largest pair 7: 128 would take more than `trade.LONGEST_ANSWER`.
Reduced models go up to where beam modes take 3 s of one, and two sizes beyond 12 Legendre
functions, which leave 8e-14 in a critical speed and 8e-9 in a cycle."""

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
"""Words for several families."""


def checked_families(name: str, given: Any, default: Sequence[str]) -> tuple[ModelFamily, ...]:
    """Families by their names or the words for several, each once; the default where None is given.

    Raises ValueError or TypeError, naming the argument, for what is no such word.
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


@saved_as("ConvergenceLaw", shapes={"k": "sizes"})
class ConvergenceLaw(Result):
    """How the error of a family's critical speed falls as its models grow.

    Attributes:
        law: "power" (error ~ size^-rate), "exponential" (error ~ rate^-size), "flat" (it ends at
            `limit`), or "unknown" (no law fits, or too few sizes).
        rate: order, or factor by which the error falls with each degree of freedom; NaN for the
            other laws.
        limit: for "flat" the signed relative error at infinite size, extrapolated; else NaN.
        spread: by how much the limit moves without the smallest of the sizes; else NaN.
        sizes: the sizes used, shape (k,).
    """

    law: Literal["power", "exponential", "flat", "unknown"]
    rate: float
    limit: float
    spread: float
    sizes: Array


def relative_errors(
    found: Iterable[CriticalSpeed], exact: CriticalSpeed
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Sizes, signed errors of the speed relative to the exact, and whether the kind is the same."""
    results = sorted(found, key=lambda result: result.size)
    sizes = np.array([result.size for result in results], dtype=np.float64)
    speeds = np.array([result.speed for result in results])
    same_kind = np.array([result.kind == exact.kind for result in results], dtype=np.bool_)
    with np.errstate(divide="ignore", invalid="ignore"):
        return sizes, (speeds - exact.speed) / exact.speed, same_kind


def convergence_law(found: Sequence[CriticalSpeed], exact: CriticalSpeed) -> ConvergenceLaw:
    """The law of critical speeds of models of one family; rounding is not fitted."""
    sizes, errors, same_kind = relative_errors(found, exact)
    good = same_kind & np.isfinite(errors)
    good[good] &= np.abs(errors[good]) > 30.0 * own_error(found, exact)
    return fitted_law(sizes[good], errors[good])


def fitted_law(sizes: Array, errors: Array) -> ConvergenceLaw:
    """The law by which relative errors (k,) fall with increasing sizes (k,), far above rounding."""
    unknown = ConvergenceLaw("unknown", math.nan, math.nan, math.nan, sizes)
    if sizes.size < 4:
        return unknown
    # An error that lasts: c_0 of c_0 + c_1 / n + c_2 / n^2 + ..., if it converges.
    count = min(5, sizes.size)
    limits = [np.polyfit(1.0 / sizes[-k:], errors[-k:], k - 1)[-1] for k in (count, count - 1)]
    spread = float(abs(limits[0] - limits[1]))
    near = abs(limits[0]) < 2.0 * abs(errors[-1])  # fast decay is extrapolated to anything
    if near and abs(limits[0]) > max(0.3 * abs(errors[-1]), 5.0 * spread):
        return ConvergenceLaw("flat", math.nan, float(limits[0]), spread, sizes[-5:])
    last = sizes >= min(sizes[-1] / 2.0, sizes[-4])
    sizes, logs = sizes[last], np.log(np.abs(errors[last]))
    largest = int(np.argmax(logs))  # smaller models than this are too small to show a law
    if sizes.size - largest < 3:
        return replace(unknown, sizes=sizes)
    sizes, logs = sizes[largest:], logs[largest:]
    power, power_misfit = _straight_fit(np.log(sizes), logs)
    exponential, misfit = _straight_fit(sizes, logs)
    if min(power_misfit, misfit) > 0.1 * float(np.ptp(logs)):
        return replace(unknown, sizes=sizes)
    # The families' orders are 1 to 4: what falls faster than the eighth power is no power.
    if (misfit < power_misfit or -power > 8.0) and exponential < -math.log(2.0):
        return ConvergenceLaw("exponential", math.exp(-exponential), math.nan, math.nan, sizes)
    return ConvergenceLaw("power", -power, math.nan, math.nan, sizes)


def own_error(found: Iterable[CriticalSpeed], exact: CriticalSpeed) -> float:
    """Relative error that the speeds compared have of their own."""
    own = max((result.error for result in found), default=0.0)
    eps = float(np.finfo(float).eps)
    return (exact.error + own) / exact.speed + eps if exact.speed > 0.0 else eps


def _straight_fit(x: Array, y: Array) -> tuple[float, float]:
    """Slope and root mean square misfit of a straight line."""
    slope, start = np.polyfit(x, y, 1)
    return float(slope), float(np.sqrt(np.mean((start + slope * x - y) ** 2)))
