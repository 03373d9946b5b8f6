# SPDX-License-Identifier: MIT
"""Exceptions of the package for results that it cannot compute, with the reason."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from pipedyn.util.archive import saved_as


@saved_as("PipedynError")
class PipedynError(Exception):
    """Base class of errors in computations; all other errors of the package are about arguments.

    The first argument is the message, the others are data for the caller.
    """

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class UnusualPipe(UserWarning):
    """A number is allowed, but far outside the range of pipes, perhaps in another unit.

    It is one of a pipe, of its flow, start, base or supply, or of a measurement.

    `warnings.filterwarnings("ignore", category=pipedyn.UnusualPipe)` silences it.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", pp.UnusualPipe)
        ...     backward = pp.Pipe(0.2, jet_angle=2.0)
    """


class FluttersAcross(UserWarning):
    """A pipe that rests bent may flutter across the plane of a planar model, at a lower speed.

    At beta = 0.2 a level pipe of gamma = 10 flutters 3 % below the speed of a planar model, and 7 %
    below it at gamma = 20; a pipe inclined by 45 degrees 1 % below it at gamma = 10. Without
    gravity, a pipe with its jet at the angle 0.5 rad flutters 4 % below it. `Chain`, `Galerkin` and
    `Continuum` made with `dimensions=3` tell where it flutters across the plane. Questions about
    stability of planar models bring the warning: `critical_speed`, `crossings`, `stability_curve`,
    `critical_speeds`, `boundary`, `hopf`, `criticality_curve`, `relevant`, `trade`, `choose` and
    `identify`.

    `warnings.filterwarnings("ignore", category=pipedyn.FluttersAcross)` silences it.

    Example:
        >>> import math, warnings
        >>> level = pp.Pipe(0.2, 10.0, inclination=math.pi / 2)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", pp.FluttersAcross)
        ...     found = pp.critical_speed(pp.Continuum(level))
        >>> round(found.speed, 4)
        5.9544
    """


class BranchesMissing(UserWarning):
    """Modes that no branch of `root_loci` follows grow, or may grow; the message says which.

    `warnings.filterwarnings("ignore", category=pipedyn.BranchesMissing)` silences it.

    Example:
        >>> import warnings
        >>> sucking = pp.Chain(pp.Pipe(0.2, flow="aspirating"), 12)
        >>> with warnings.catch_warnings():
        ...     warnings.simplefilter("ignore", pp.BranchesMissing)
        ...     loci = pp.root_loci(sucking, [0.0, 1.0, 2.0])
        >>> print(loci.missing)
        without damping inflow makes all modes grow, and 8 of 12 have no branch: take count=12
    """


def warn_caller(category: type[Warning], said: str, *asked: str) -> None:
    """Warns whoever called a function of the modules `asked` from outside of the package."""
    inner = *asked, "pipedyn.util.hints", __name__
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__") in inner:
        frame, level = frame.f_back, level + 1
    if not str(frame.f_globals.get("__name__")).startswith("pipedyn."):
        warnings.warn(said + _how_to_silence(category), category, stacklevel=level)


def warn_of_plane(*asked: str) -> None:
    """Warns with `FluttersAcross` whoever called a function of the modules `asked` from outside."""
    said = (
        "the pipe rests bent, and may flutter first across the plane of this model, some per cent "
        "below the critical speed in it: a model made with dimensions=3 answers for both"
    )
    warn_caller(FluttersAcross, said, *asked)


def warn_of_number(said: str) -> None:
    """Warns with `UnusualPipe` whoever called the package that a number is far from usual."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and str(frame.f_globals.get("__name__")).startswith("pipedyn"):
        frame, level = frame.f_back, level + 1
    warnings.warn(said + _how_to_silence(UnusualPipe), UnusualPipe, stacklevel=level)


def _how_to_silence(category: type[Warning]) -> str:
    name = f"pipedyn.{category.__name__}"
    return f' (warnings.filterwarnings("ignore", category={name}) silences this)'


def warn_of_pipe(
    reasons: Sequence[str], slip: str, own: Mapping[str, float] = MappingProxyType({})
) -> None:
    """Warns with `UnusualPipe` whoever called from outside of the package.

    Pipes that the package derives from a user's own bring no warning, nor do those that replace
    other numbers of a pipe than its `own` that are unusual.
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__") in MAKERS_OF_PIPES:
        replaced = frame.f_locals.get("obj")  # of dataclasses.replace
        if own and all(getattr(replaced, name, None) == one for name, one in own.items()):
            return
        frame, level = frame.f_back, level + 1
    module = str(frame.f_globals.get("__name__"))
    if module.startswith("pipedyn.") and not module.endswith("__main__"):
        return
    said = f"{'; '.join(reasons)}{slip or ': are all units right?'}"
    warnings.warn(said + _how_to_silence(UnusualPipe), UnusualPipe, stacklevel=level)


MAKERS_OF_PIPES = "pipedyn.models.pipe", "pipedyn.util.hints", "dataclasses"
"""Modules in whose frames a user makes a pipe."""


@saved_as("NotConverged")
class NotConverged(PipedynError):
    """A result did not meet its tolerance.

    Attributes:
        result: the result as far as it was computed, or None.
    """

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message, result)
        self.result = result


@saved_as("NotResolved")
class NotResolved(PipedynError):
    """A model has no answer for a state that its quadrature or double precision does not resolve.

    Integrators and searches refuse a step that leads to an unresolved state.

    Attributes:
        members: indices of the unresolved states in a batch, ascending; (0,) for a single state.

    Example:
        >>> coiled = [100.0, 0.0, 0.0, 0.0]
        >>> pp.Galerkin(pp.Pipe(0.2), m=2).rhs(0.0, coiled, 4.0)  # doctest: +ELLIPSIS
        Traceback (most recent call last):
        ...
        pipedyn.util.errors.NotResolved: rhs cannot be computed of this state because it bends ...
    """

    def __init__(self, message: str, members: tuple[int, ...] = (0,)) -> None:
        super().__init__(message, members)
        self.members = members

    @classmethod
    def of_states(
        cls, what: str, members: Sequence[int], states: int | None, why: str = ""
    ) -> Self:
        """The exception that `what` cannot be computed of some states of a batch, or of one state.

        `states` is the number of states in the batch, None for a single state.
        """
        which = "this state"
        if states is not None:
            listed = ", ".join(map(str, members[:5])) + (", ..." if len(members) > 5 else "")
            which = f"states {listed} ({len(members)} of {states}), the first"
        why = why or "its numbers leave double precision, or its mass matrix is singular there"
        return cls(f"{what} cannot be computed of {which} because {why}", tuple(members))


def resolved(what: str, answer: Callable[[], Any], batch: bool = False) -> Any:
    """The value of a function of a state, or of a batch of states along the last axis.

    Raises:
        NotResolved: if the value is not finite.
    """
    with np.errstate(all="ignore"):
        found = answer()
    finite = np.isfinite(found)
    if finite.all():
        return found
    if not batch:
        raise NotResolved.of_states(what, (0,), None)
    every = finite.reshape(-1, finite.shape[-1]).all(axis=0)
    raise NotResolved.of_states(what, np.flatnonzero(~every).tolist(), every.size)
