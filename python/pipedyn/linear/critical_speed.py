# SPDX-License-Identifier: MIT
"""Critical speeds: crossings of the imaginary axis, and what moves them."""

from __future__ import annotations

import math
from dataclasses import field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.modes import LARGEST_FULL, largest_speed
from pipedyn.linear.sensitivity import Crossing, crossings_of
from pipedyn.linear.weak_damping import extrapolated, is_weakly_damped, strengthened
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.continuum import AnyModel, Continuum, Converged, answered, checked_model
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.counters import factorised
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

LARGE_GRAVITY = 100.0
"""gamma beyond which weight sets the scale of flow speeds: measured at beta 0.05 to 0.8, critical
speeds are 1.6 to 1.9 times those without weight here, and grow about like gamma^(1/3) beyond."""


class NoCrossing(PipedynError):
    """The pipe does not lose stability up to the end of the search.

    Attributes:
        max_speed: where the search ended.
    """

    def __init__(self, message: str, max_speed: float) -> None:
        super().__init__(message, max_speed)
        self.max_speed = max_speed


@result
class CriticalSpeed(Crossing):
    """The lowest crossing that destabilises: its speed, frequency, kind and the rest of a crossing.

    The speed is 0 if the pipe is unstable from the smallest flow on. `mode` is a convention where
    damping is so strong that the modes at rest do not oscillate.

    Attributes:
        stable_at_rest: False if the pipe is buckled without flow.
        size: degrees of freedom of the model solved.
        pipe: the pipe.
    """

    stable_at_rest: bool = field(kw_only=True)
    size: int = field(kw_only=True)
    pipe: Pipe = field(kw_only=True, repr=False)
    _exact: Continuum | None = field(repr=False, compare=False, default=None)
    _continuous: float | None = field(repr=False, default=None)
    _max_speed: float = field(repr=False, default=100.0)

    @cached_property
    def discretisation(self) -> float | None:
        """Bound on the distance of the speed to the continuous pipe's, absolute.

        None for chains with springs or inertia of the user's own, infinite where the continuous
        pipe has no critical speed. The continuous pipe is solved at the first request.
        """
        if self._exact is None:
            return None
        if self._continuous is not None:
            return self._continuous
        try:
            exact = _continuous_speed(self.pipe, self._max_speed)
        except NoCrossing:
            return math.inf
        return abs(self.speed - exact.speed) + self.error + exact.error


@lru_cache
def _continuous_speed(pipe: Pipe, max_speed: float) -> CriticalSpeed:
    """Of the continuous pipe, which models of several sizes are held against."""
    return critical_speed(Continuum(pipe), max_speed)


def crossings(model: AnyModel, max_speed: float) -> tuple[Crossing, ...]:
    """Every crossing of the imaginary axis by an eigenvalue up to a flow speed.

    None is missed between samples: see `cpp/pipedyn/linear/crossings.hpp`. A pipe that is unstable
    from the smallest flow on has crossings at speed 0, one for each mode that leaves the axis there
    (for `Continuum`, those of its basis).

    Args:
        model: chain, reduced model or `Continuum`, up to 2,000 degrees of freedom.
        max_speed: end of the search, > 0.

    Returns:
        Crossings in order of speed, flutter and divergence.

    Raises:
        NotConverged: if the crossings found do not account for the unstable roots, or those of the
            continuous pipe do not converge as the basis grows.
        ValueError, TypeError: for bad arguments.
    """
    checked_model(model)
    _, found = all_losses(model, checked_end(max_speed, model))
    return found


def critical_speed(model: AnyModel, max_speed: float = 100.0) -> CriticalSpeed:
    """Lowest flow speed at which the number of unstable roots of the straight pipe grows.

    Args:
        model: chain, reduced model or `Continuum`, up to 2,000 degrees of freedom.
        max_speed: end of the search, in sqrt(EI / mu_f) / L.

    Returns:
        Speed, frequency, kind, mode and sensitivity, with the error of the speed.

    Raises:
        NoCrossing: if there is none up to max_speed.
        NotConverged: as for `crossings`.
        ValueError, TypeError: for bad arguments.
    """
    checked_model(model)
    critical, _ = first_loss(model, checked_end(max_speed, model))
    return critical


def checked_end(max_speed: Any, model: AnyModel | None = None) -> float:
    """The argument max_speed, if it can end a search in the model."""
    high = largest_speed(model)
    return check.real("max_speed", max_speed, low=0.0, high=high, open_low=True)


def first_loss(
    model: AnyModel, max_speed: float = 100.0
) -> tuple[CriticalSpeed, tuple[Crossing, ...]]:
    """The critical speed, and the crossings up to it, or NoCrossing, from a search ending there."""
    # A low critical speed needs no large basis and few modes of a long chain, so where that is
    # cheaper the search first ends sooner: without weight pipes flutter below 12 if beta < 0.68,
    # below 30 at any beta, and gamma = 1000 takes the speed to 20 .. 80.
    ends = [end for end in (12.0, 30.0, 60.0) if end < max_speed]
    if isinstance(model, Model):
        ends = [end for end in ends if _some_are_cheaper(_modes_within(end), end, model.dof)]
        ends = ends if ends and model.pencil().is_long else []
    for end in [*ends, max_speed]:
        critical, found = all_losses(model, end, until_unstable=True)
        if critical is not None:
            return replace(critical, _max_speed=max_speed), found
    raise NoCrossing(f"no loss of stability up to u = {max_speed:g}", max_speed)


def all_losses(
    model: AnyModel, max_speed: float, until_unstable: bool = False
) -> tuple[CriticalSpeed | None, tuple[Crossing, ...]]:
    """The critical speed, if any, and crossings up to max_speed or, if asked for, up to it."""
    pipe = model.pipe
    if pipe.beta == 0.0 and pipe.centrifugal == 0.0:
        return None, ()  # the flow acts on nothing
    if is_weakly_damped(pipe) and not model.resisted:
        solved = strengthened(pipe)
        searches = [_search(model.with_pipe(one), max_speed, until_unstable) for one in solved]
        found = extrapolated(pipe, solved, [search.value for search in searches])
    else:
        searches = [_search(model, max_speed, until_unstable)]
        found = searches[0].value
    first = next((c for c in found if c.destabilising), None)
    if first is None:
        return None, found
    critical = CriticalSpeed(
        **vars(first),
        stable_at_rest=found[0].unstable_before == 0,
        size=searches[0].size,
        pipe=pipe,
        _exact=Continuum(pipe) if model.approximates_pipe else None,
        _continuous=first.error if isinstance(model, Continuum) else None,
        _max_speed=max_speed,
    )
    return critical, found


def _search(
    model: AnyModel, max_speed: float, until_unstable: bool
) -> Converged[tuple[Crossing, ...]]:
    continuous = isinstance(model, Continuum)
    if isinstance(model, Model) and model.dof > LARGEST_FULL:
        raise ValueError(
            f"model must have at most {LARGEST_FULL} degrees of freedom for crossings, "
            f"got {model.dof}"
        )

    def passed(one: Any) -> tuple[Crossing, ...]:
        resolved = None
        if continuous:
            # Three fifths of a Legendre model's modes are the pipe's to many digits. Where damping
            # is so strong that the last of these do not oscillate, those beyond are overdamped too,
            # however they would grow without it, and nothing sets them apart: then all.
            share = (3 * one.resolution) // 5
            resolved = share if one.pipe.damping * (math.pi * share) ** 2 <= 2.0 else None
        return _swept(one, max_speed, until_unstable, resolved)

    smallest = max(16, math.ceil(0.8 * max_speed) + 8)
    found = answered(model, (0.0, max_speed), passed, _difference, smallest=smallest)
    if not continuous:
        return found
    moved = (replace(c, error=2.0 * c.error + found.error * c.speed) for c in found.value)
    return replace(found, value=tuple(moved))


def _modes_within(max_speed: float) -> int:
    """How many modes the flow can reach: those of wave number k up to pi u, and twelve more."""
    return 12 + math.ceil(max_speed)


def _some_are_cheaper(tracked: int, max_speed: float, dof: int) -> bool:
    """Whether some modes of a long chain are computed faster than all."""
    return tracked <= dof // 4 and max_speed <= dof / 4


def _swept(
    model: Model, max_speed: float, until_unstable: bool, resolved: int | None
) -> tuple[Crossing, ...]:
    """Crossings of one model.

    Of a long chain only as many modes are tracked as can meet the flow: a mode of wave number k
    does where k is comparable to u. If a root beyond that turns unstable, more are tracked.
    """
    problem = eigenproblem(model)
    tracked, count = problem.dof, 2 * problem.dof
    if problem.is_long:
        tracked = _modes_within(max_speed)
        count = 2 * tracked + 16
        # Those before the cluster at -1 / delta, which a search for a few roots does not pass, may
        # be enough: modes with (delta omega)^2 < 0.9, four fewer as the search looks beyond those
        # tracked.
        delta = model.pipe.damping
        before = math.floor(math.sqrt(0.9 / delta) / math.pi) - 4 if delta else tracked
        if max_speed / math.pi + 1.0 <= before < tracked:
            tracked, count = before, 2 * before + 2
    # Near the free end of a heavy hanging pipe, where its weight no longer stretches it, lengths
    # are in gamma^(-1/3) and flow speeds in gamma^(1/3).
    scale = float(np.cbrt(1.0 + max(model.pipe.gamma, 0.0) / LARGE_GRAVITY))
    while True:
        if problem.is_long and not _some_are_cheaper(tracked, max_speed, problem.dof):
            tracked, count = problem.dof, 2 * problem.dof
        with one_thread(problem.rows):
            swept = problem.spectrum().crossings(
                max_speed=max_speed,
                scale=scale,
                count=count,
                tracked=tracked,
                resolved=tracked if resolved is None else resolved,
                certain=min(tracked, model.resolved_modes),
                until_unstable=until_unstable,
                factorised=factorised,
            )
        if swept.untracked:
            tracked = max(2 * tracked, _modes_within(max_speed))
            count = 2 * tracked + 16
            continue
        found = crossings_of(problem, swept)
        if swept.failure:
            raise NotConverged(swept.failure, found)
        return found


def _difference(a: tuple[Crossing, ...], b: tuple[Crossing, ...]) -> float:
    """Largest relative change of a speed beyond what the errors of either explain.

    Infinite where crossings differ in kind or number.
    """
    # Of modes that leave the axis at rest a larger model has more: the first stands for all.
    a, b = (tuple(c for c in found if c.speed > 0.0 or c is found[0]) for found in (a, b))
    kinds = [[(c.kind, c.destabilising) for c in found] for found in (a, b)]
    if kinds[0] != kinds[1]:
        return math.inf
    moves = (
        max(abs(x.speed - y.speed) - x.error - y.error, 0.0) / y.speed
        for x, y in zip(a, b, strict=True)
        if y.speed
    )
    return max(moves, default=0.0)
