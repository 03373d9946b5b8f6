# SPDX-License-Identifier: MIT
"""Critical speeds: flow speeds at which eigenvalues cross the imaginary axis."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np

from pipedyn import _core
from pipedyn.linear.bent_crossings import CrossingOfRest, SearchOfRest
from pipedyn.linear.eigenproblem import Eigenproblem, eigenproblem
from pipedyn.linear.modes import (
    LARGEST_FULL,
    LARGEST_VECTORS,
    ModeShape,
    largest_speed,
    neutral_shape,
)
from pipedyn.linear.neutral import grows
from pipedyn.linear.reach import LARGE_GRAVITY, LEAST_WITHIN, Reach, is_overdamped
from pipedyn.linear.rest import at_rest, rest_follows
from pipedyn.linear.sensitivity import (
    Crossing,
    Crossings,
    crossings_of,
    extrapolated,
    is_weakly_damped,
    strengthened,
)
from pipedyn.models.base import Model
from pipedyn.models.continuum import AnyModel, Continuum, Converged, checked_model, converged_ahead
from pipedyn.models.galerkin import Galerkin, PanelPencil, last_functions
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotConverged, PipedynError, warn_of_plane
from pipedyn.util.parallel import NoCollection, Returned, one_thread, outcome_of
from pipedyn.util.result import SPEED

LONG_MODEL = 4
"""Number of degrees of freedom for each tracked mode, and for each unit of flow speed, from which
on a model counts as long: computing some of its modes is then faster than computing all."""

JUST_BEYOND = 1e-3
"""Distance beyond the last crossing, relative to its speed, at which unstable roots are counted."""

LAST = {"ejecting": 1e-2, "aspirating": 1e-6}
"""Largest share of a mode's elastic energy in the last two functions of each panel, by direction of
flow, for which the mode counts as one of the continuous pipe's. All modes of an aspirating pipe may
lose stability at nearly the same speed, so that a small error makes a high mode the first."""


@saved_as("NoCrossing")
class NoCrossing(PipedynError):
    """No root becomes unstable up to the end of the search; the message says if roots grow at rest.

    Attributes:
        max_speed: flow speed at which the search ended.
    """

    def __init__(self, message: str, max_speed: float) -> None:
        super().__init__(message, max_speed)
        self.max_speed = max_speed


@saved_as("CriticalSpeed", added=("stable_from", "gyroscopic", "vouched", "across"))
class CriticalSpeed(Crossing, units={"discretisation": SPEED}):
    """The lowest crossing of the imaginary axis that destabilises the pipe.

    The speed is 0 if the pipe is unstable from the smallest flow on. The number `mode` is a
    convention if damping is so strong that the modes at rest do not oscillate.

    Attributes:
        stable_at_rest: False if the pipe is buckled without flow, as a heavy standing pipe is.
        stable_from: flow speed from which the pipe is stable up to the critical speed: 0 if it is
            stable from rest on, None if it is unstable also just below the critical speed (or if
            this is not known, as in a file of an earlier version).
        size: number of degrees of freedom of the model that was solved.
        model: the model whose critical speed this is.

    Example:
        >>> found = pp.critical_speed(pp.Chain(pp.Pipe(0.2), n=10))
        >>> found.kind, found.mode, round(found.speed, 4), round(found.sensitivity.speed.beta, 3)
        ('flutter', 2, 5.4857, 10.312)
        >>> round(found.discretisation, 3)
        0.106
    """

    stable_at_rest: bool = field(kw_only=True)
    stable_from: float | None = field(default=None, kw_only=True)
    size: int = field(kw_only=True)
    model: AnyModel = field(kw_only=True, repr=False, compare=False)
    _continuous: float | None = field(repr=False, default=None)
    _max_speed: float = field(repr=False, default=100.0)

    @property
    def pipe(self) -> Pipe:
        """The pipe of the model."""
        return self.model.pipe

    def _shown(self) -> dict[str, Any]:
        """Puts the fields on instability below the critical speed first, if they apply."""
        warnings = ("stable_at_rest", "stable_from", "gyroscopic")
        shown = super()._shown()
        if self.stable_at_rest and self.unstable_before == 0:
            shown = {name: one for name, one in shown.items() if name not in warnings[:2]}
        return {name: shown[name] for name in warnings if name in shown} | shown

    @cached_property
    def mode_shape(self) -> ModeShape:
        """Shape of the neutral motion at the critical speed, computed at the first request.

        Raises:
            ValueError: for more than 4000 degrees of freedom.
        """
        model = self.model
        if isinstance(model, Continuum):
            model = model.frozen(self.size // (model.dimensions - 1))
        return neutral_shape(at_rest(model, self.speed), self.speed, self.frequency, self.across)

    @cached_property
    def discretisation(self) -> float | None:
        """Bound on the absolute distance of the speed from the continuous pipe's critical speed.

        It is None for chains with the user's own springs or inertia, which do not approximate a
        continuous pipe, and infinite if the continuous pipe has no critical speed. The continuous
        pipe is solved at the first request.
        """
        model = self.model
        if not model.approximates_pipe:
            return None
        if self._continuous is not None:
            return self._continuous
        found = []
        each = [(plane.pipe, 2) for plane in model.planes] or [(self.pipe, model.dimensions)]
        for pipe, dimensions in each:
            with suppress(NoCrossing):
                found.append(_continuous_speed(pipe, dimensions, self._max_speed))
        if not found:
            return math.inf
        exact = min(found, key=lambda one: one.speed)
        return abs(self.speed - exact.speed) + self.error + exact.error


CriticalPoint: TypeAlias = tuple[CriticalSpeed, tuple[Crossing, ...]]
CriticalPointIfAny: TypeAlias = tuple[CriticalSpeed | None, tuple[Crossing, ...]]
Found: TypeAlias = Converged[tuple[Crossing, ...]]
Search: TypeAlias = Callable[[bool], Found]
"""Finds crossings; the argument tells whether with sensitivities, which some have at any rate."""
Plan: TypeAlias = Sequence[Search]


@lru_cache
def _continuous_speed(pipe: Pipe, dimensions: Literal[2, 3], max_speed: float) -> CriticalSpeed:
    """Critical speed of the continuous pipe, cached because models of several sizes need it."""
    return critical_point(Continuum(pipe, dimensions), max_speed)[0]


def crossings(model: AnyModel, max_speed: float) -> Crossings:
    """Every crossing of the imaginary axis by an eigenvalue up to a flow speed.

    The pipe is at rest, straight or bent, as for `critical_speed`; if a bent rest ends in a fold
    before that speed, the search ends there with `NotConverged`.

    Divergence occurs where the stiffness is singular; all such speeds follow from one eigenvalue
    problem. Flutter is found by following eigenvalues in steps that are halved until the crossings
    found account for the number of unstable roots. Two crossings closer than about a millionth of
    their speed may be missed together. `cpp/pipedyn/linear/crossings.hpp` describes the method and
    `tests/campaign.py` compares it with independent programs. A pipe that is unstable from the
    smallest flow on has crossings at speed 0, one for each mode that leaves the axis there (for
    `Continuum`, one for each such mode of its basis).

    Args:
        model: chain, reduced model or `Continuum`, up to 2,000 degrees of freedom; a straight chain
            of which few modes tell the crossings may have more.
        max_speed: end of the search, > 0.

    Returns:
        Crossings of both kinds in order of speed. The result can be indexed like a tuple and
        written as a table.

    Example:
        >>> found = pp.crossings(pp.Continuum(pp.Pipe(0.295)), 9.0)
        >>> [(round(c.speed, 4), c.destabilising) for c in found]
        [(7.2605, True), (7.8516, False), (8.1892, True)]

    Raises:
        NotConverged: if the crossings found do not account for the number of unstable roots, if
            crossings of the continuous pipe do not converge as the basis grows, or if a growing
            motion ceases to oscillate, where hysteresis is not defined. The exception's `result`
            holds the crossings below that speed.
        ValueError, TypeError: for arguments out of range or of a wrong type.
    """
    model = checked_model(model)
    if not model._pipe.rests_straight and model.dimensions == 2:
        warn_of_plane(__name__)
    end = checked_end(max_speed, model)
    _, found = only_answer(stability_losses([model], end))
    return Crossings(found, end, model, unstable_at_rest(model, found))


def critical_speed(model: AnyModel, max_speed: float = 100.0) -> CriticalSpeed:
    """Lowest flow speed at which the number of unstable roots of a pipe at rest grows.

    If a jet, gravity or another load acts across the straight pipe, its rest bends with the flow.
    That rest is followed to which the pipe comes as its loads, and then the flow, grow from zero:
    it flutters, or it turns back in a fold, which counts as divergence. A pipe that is bent may
    flutter first across the plane of its rest: a model made with `dimensions=3` searches both
    planes, and a planar one brings the warning `FluttersAcross`. Across that plane the pipe may
    also diverge. In three dimensions terms may differ in x and z: the lower of the speeds in both
    planes is found, with the number of the mode in its plane.

    Args:
        model: chain, reduced model or `Continuum`, as for `crossings`.
        max_speed: end of the search, in sqrt(EI / mu_f) / L.

    Returns:
        CriticalSpeed: speed, frequency, kind, mode and sensitivity, with the speed's error.

    Example:
        >>> found = pp.critical_speed(pp.Continuum(pp.Pipe(0.2)))
        >>> found.kind, found.mode, round(found.speed, 6), round(found.frequency, 5)
        ('flutter', 2, 5.591404, 13.7147)

    Raises:
        NoCrossing: if there is no such speed up to max_speed; the message says if roots grow at
            rest.
        NotConverged: for the reasons that `crossings` lists.
        ValueError, TypeError: for arguments out of range or of a wrong type.
    """
    model = checked_model(model)
    # Not by the pipe's property, since small searches take few other calls.
    if not model._pipe.rests_straight and model.dimensions == 2:
        warn_of_plane(__name__)
    critical, _ = only_answer(critical_points([model], checked_end(max_speed, model)))
    return critical


def stable_speeds(
    model: AnyModel, found: Sequence[Crossing], end: float
) -> tuple[tuple[float, float], ...]:
    """Ranges of flow speed, from 0 to the end of a search, in which no root is unstable.

    Args:
        model: the model that was searched.
        found: all its crossings up to the end of the search, in order of speed.
        end: flow speed at which the search ended.
    """
    counts = [unstable_at_rest(model, found), *(one.unstable_after for one in found)]
    bounds = pairwise([0.0, *(one.speed for one in found), end])
    return tuple(
        (low, high)
        for (low, high), count in zip(bounds, counts, strict=True)
        if not count and low < high
    )


def checked_end(max_speed: Any, model: AnyModel | None = None) -> float:
    """Checks max_speed, which must be within the limit of searches, and returns it as a float."""
    high = largest_speed(model)
    return check.real("max_speed", max_speed, low=0.0, high=high, open_low=True)


def critical_point(model: AnyModel, max_speed: float = 100.0) -> CriticalPoint:
    """The critical speed of a model, and its crossings up to that speed.

    Raises:
        NoCrossing: if the pipe stays stable up to max_speed.
    """
    return only_answer(critical_points([model], max_speed))


def critical_points(
    models: Sequence[AnyModel], max_speed: float = 100.0
) -> list[CriticalPoint | Exception]:
    """Critical points of several models, or the exceptions of those that fail, in one search."""
    found: list[Any] = first_losses(models, max_speed, sensitive=True)
    for i, model in enumerate(models):
        if not isinstance(found[i], Exception) and found[i][0] is None:
            found[i] = outcome_of(_no_critical_speed, model, max_speed)
    return found


def first_losses(
    models: Sequence[AnyModel], max_speed: float, sensitive: bool
) -> list[CriticalPointIfAny | Exception]:
    """Critical speed, if any, and crossings up to it of each model, or its exception.

    Args:
        models: the models.
        max_speed: flow speed at which the searches end.
        sensitive: whether crossings have their sensitivities.
    """
    found: list[Any] = [None] * len(models)
    searched: dict[float, list[int]] = {}  # models by the ends of their searches
    for i, model in enumerate(models):
        for end in (*_first_ends(model, max_speed), max_speed):
            searched.setdefault(end, []).append(i)
    for end in sorted(searched):
        at, some = [], []
        for i in searched[end]:
            if found[i] is None:
                at.append(i)
                some.append(models[i])
        points = stability_losses(some, end, True, max_speed, sensitive)
        for i, point in zip(at, points, strict=True):
            if isinstance(point, Exception) or point[0] is not None or end == max_speed:
                found[i] = point
    return found


def _first_ends(model: AnyModel, max_speed: float) -> list[float]:
    """Increasing speeds below max_speed at which searches for the critical speed end first.

    A low critical speed needs no large basis, and few modes of a long chain; ends at which that is
    not cheaper than the whole search are left out.

    As measured at beta 0.02 to 0.99 and gamma up to 3000, uniform cantilevers flutter below the
    first of these speeds. For light pipes it is 12 below beta = 0.68, 16 up to 0.9 and 18.5 beyond;
    the larger beta, the smaller is the weight that raises it. Spans held at both ends buckle
    between pi and 2 pi.
    """
    if not isinstance(model, Continuum) and model.dof < LONG_MODEL * LEAST_WITHIN:
        return []  # at least so many modes would be tracked, which is not cheaper
    if rest_follows(model):
        return []  # the search goes along the rest, whatever its end
    pipe, gravity, reach = model.pipe, LARGE_GRAVITY, Reach(model.pipe)
    if pipe.supports or pipe.end_held:
        ends = [5.0, 8.0, 12.0, 24.0, 48.0]
    elif pipe.flow == "ejecting":
        first = 12.0 if pipe.beta < 0.68 else 16.0 if pipe.beta <= 0.9 else 18.5
        ends = [first, 2.0 * first, 4.0 * first]
        gravity *= max(1.0 - pipe.beta, 0.01)
    else:
        ends = [12.0, 24.0, 48.0]
    # The unit is rounded up to a power of 1.1, so that similar pipes are searched together.
    unit = 1.1 ** math.ceil(math.log(reach.speed_scale(gravity), 1.1) - 1e-9)
    ends = [end * unit for end in ends if end * unit < max_speed]
    if isinstance(model, Model):
        ends = [end for end in ends if _some_are_cheaper(reach.modes_within(end), end, model.dof)]
        if ends and not model.pencil().is_long:
            return []
    return ends


def _no_critical_speed(model: AnyModel, max_speed: float) -> NoCrossing:
    """The error for a pipe without critical speed: stable throughout, or unstable at rest."""
    growing = unstable_at_rest(model)
    if not growing:
        return NoCrossing(f"no loss of stability up to u = {max_speed:g}", max_speed)
    roots = check.how_many(growing, "root")
    return NoCrossing(
        f"the pipe is unstable at rest, where {roots} grow{'s' if growing == 1 else ''}, and no "
        f"more become unstable up to u = {max_speed:g}",
        max_speed,
    )


def stability_losses(
    models: Sequence[AnyModel],
    max_speed: float,
    until_unstable: bool = False,
    continuum_end: float | None = None,
    sensitive: bool = True,
) -> list[CriticalPointIfAny | Exception]:
    """Critical speed, if any, and crossings up to max_speed of each model, or its exception.

    Models of one size are searched in one call of the core.

    Args:
        models: the models to search.
        max_speed: flow speed at which the search ends.
        until_unstable: whether the search ends at the critical speed.
        continuum_end: speed up to which the continuous pipe's critical speed is searched when
            `CriticalSpeed.discretisation` asks for it; max_speed where not given.
        sensitive: whether crossings have their sensitivities.
    """
    plans: list[Any] = []
    jobs: list[Search] = []
    # The garbage collector would look at the same objects, none of which are in cycles, many times.
    with NoCollection():
        for model in models:
            plans.append(outcome_of(_plan, model, max_speed, until_unstable))
            if not isinstance(plans[-1], Exception):
                jobs += plans[-1]
        _run_searches(jobs)
        end = max_speed if continuum_end is None else continuum_end
        for i, model in enumerate(models):
            if not isinstance(plans[i], Exception):
                plans[i] = outcome_of(_point, model, plans[i], end, sensitive)
    return plans


def only_answer(answers: Sequence[Returned | Exception]) -> Returned:
    """The only answer of a list; raises it if it is an exception."""
    (one,) = answers
    if isinstance(one, Exception):
        raise one
    return one


def _plan(model: AnyModel, max_speed: float, until_unstable: bool) -> Plan:
    """Jobs whose crossings give those of the model: one, or one for each strengthened pipe."""
    pipe = model.pipe
    if pipe.beta == 0.0 and pipe.alpha == 0.0:
        return ()  # the flow acts on nothing
    if model.planes:
        return (_in_planes(model.planes, max_speed, until_unstable),)
    bent = not pipe.rests_straight and rest_follows(model)
    undamped = pipe.fed_at_rest and not (pipe.damping or pipe.hysteresis or model.resisted)
    if undamped and not bent and (growing := unstable_at_rest(model)):
        raise NotConverged(
            f"the pipe is unstable at rest, where forces that follow it make "
            f"{check.how_many(growing, 'root')} grow; without damping no crossings are told from "
            "there on",
            (),
        )
    solved: list[AnyModel] = [model]
    if is_weakly_damped(pipe) and not model.resisted:
        solved = [model.with_pipe(one) for one in strengthened(pipe)]
    plan: list[Search] = []
    for one in solved:
        if bent:
            plan.append(_along_rest(one, max_speed, until_unstable))
        elif isinstance(one, Continuum):
            plan.append(_converging(one, max_speed, until_unstable))
        else:
            search = _Search(one, max_speed, until_unstable)
            if not search.is_possible:
                _require_few(one)
            plan.append(search)
    return plan


def _in_planes(planes: Sequence[AnyModel], max_speed: float, until_unstable: bool) -> Search:
    """The search for crossings of a straight pipe with different motions in two planes."""

    def job(sensitive: bool) -> Found:
        answers = stability_losses(planes, max_speed, until_unstable, sensitive=sensitive)
        points, each = zip(*(only_answer([one]) for one in answers), strict=True)
        counts = [unstable_at_rest(*one) for one in zip(planes, each, strict=True)]
        merged = []
        for i, one in sorted(
            ((i, one) for i, found in enumerate(each) for one in found), key=lambda of: of[1].speed
        ):
            before, counts[i] = sum(counts), one.unstable_after
            changed = {"unstable_before": before, "unstable_after": sum(counts), "across": i == 1}
            merged.append(Crossing._made(**vars(one) | changed))  # `replace` reads sensitivities
            if until_unstable and one.destabilising:
                break
        return Converged(tuple(merged), sum(point.size for point in points if point), 0.0)

    return job


def is_searchable(model: Model, max_speed: float) -> bool:
    """Whether crossings can be found: a model of many degrees of freedom needs few of its modes."""
    return model.dof <= LARGEST_FULL or _Search(model, max_speed, False).is_possible


def _along_rest(model: AnyModel, max_speed: float, until_unstable: bool) -> Search:
    """The search for crossings along the rest of a bent pipe."""

    def found(one: Model, counted: int | None = None) -> tuple[CrossingOfRest, ...]:
        _require_few(one)
        with one_thread(one.dof):
            return SearchOfRest(one, max_speed, until_unstable, counted).run()

    def crossed(one: Galerkin, _: Galerkin | None) -> tuple[tuple[CrossingOfRest, ...], None]:
        return found(one, 2 * one.resolved_modes), None

    def difference(a: tuple[CrossingOfRest, ...], b: tuple[CrossingOfRest, ...]) -> float:
        return _difference(*(tuple(one.crossing for one in each) for each in (a, b)))

    def job(sensitive: bool) -> Found:
        if isinstance(model, Continuum):
            every = converged_ahead(model, crossed, difference)
        else:
            every = Converged(found(model), model.dof, 0.0)
        with one_thread(every.size):
            each = [one.with_sensitivity() if sensitive else one.crossing for one in every.value]
        moved = (replace(c, error=c.error + every.error * c.speed) for c in each)
        return Converged(tuple(moved), every.size, every.error)

    return job


def _require_few(model: Model) -> None:
    """Raises ValueError for a model with too many degrees of freedom."""
    if model.dof > LARGEST_FULL:
        raise ValueError(
            f"model must have at most {LARGEST_FULL} degrees of freedom for crossings, unless it "
            "is a chain that rests straight, is hardly damped and has outflow or is held at the "
            f"end, got {model.dof}"
        )


def _point(
    model: AnyModel, plan: Plan, continuum_end: float, sensitive: bool
) -> CriticalPointIfAny:
    """The critical speed among a model's crossings, or None, together with all crossings.

    The crossings are those that the jobs find, extrapolated if these solved strengthened pipes.
    """
    solved = [job(sensitive) for job in plan]
    all_found = solved[0].value if solved else ()
    if len(solved) > 1:
        all_found = extrapolated(model.pipe, [one.value for one in solved])
    before: list[float] = []
    for first in all_found:
        if first.unstable_after > first.unstable_before:
            break
        before.append(first.speed)
    else:
        return None, all_found
    before = [speed for speed in before if speed < first.speed] if before else []
    critical = CriticalSpeed._made(
        **vars(first),
        stable_at_rest=all_found[0].unstable_before == 0,
        stable_from=None if first.unstable_before else max(before, default=0.0),
        size=solved[0].size,
        model=model,
        _continuous=first.error if isinstance(model, Continuum) else None,
        _max_speed=continuum_end,
    )
    return critical, all_found


def unstable_at_rest(model: AnyModel, found: Sequence[Crossing] = ()) -> int:
    """Number of roots that grow without flow, as in a pipe that buckles under its own weight.

    Args:
        model: the model.
        found: its crossings from rest on, if known; the first one then gives the answer at no cost.

    Raises:
        NotConverged: if the number for a continuous pipe does not settle as the basis grows.
    """
    if found:
        return found[0].unstable_before
    # Damping does not change the number of roots that grow at rest, but makes roots cluster at
    # -1 / delta.
    # A term that supplies energy makes roots grow that oscillate, and damping changes that.
    fed = model.pipe.fed_at_rest
    still = model if fed else model.with_pipe(replace(model.pipe, damping=0.0))

    def growing(one: Model) -> int:
        problem = eigenproblem(at_rest(one, 0.0))
        every = 2 * problem.dof
        if fed:
            counted = 2 * one.resolved_modes if isinstance(model, Continuum) else every
            return int(np.sum(grows(problem.lowest(0.0, every).values)[:counted]))
        asked = min(2 * Reach(model.pipe).modes_within(0.0), every) if problem.is_long else every
        return int(np.sum(problem.grows_statically(problem.lowest(0.0, asked).values)))

    if isinstance(still, Continuum):
        return still.converge(growing, lambda a, b: float(abs(a - b))).value
    return growing(still)


def _converging(model: Continuum, max_speed: float, until_unstable: bool) -> Search:
    """The search for a continuous pipe, whose basis grows until the crossings converge."""
    pipe, reach = model.pipe, Reach(model.pipe)

    def crossed(
        one: Galerkin, larger: Galerkin | None
    ) -> tuple[tuple[Crossing, ...] | None, tuple[Crossing, ...] | None]:
        search = _Search(one, max_speed, until_unstable, True, larger)
        assert search.resolved is not None
        if search.resolved < reach.modes_reached(max_speed):
            return None, None  # the flow reaches modes that this basis does not resolve
        _run_searches([search], final=larger is None or not search.all_resolved)
        assert search.swept is not None
        if search.swept.untracked:
            return None, None  # a mode that this basis does not resolve loses stability
        ahead = search.of_larger()
        return search(sensitive=ahead is None).value, ahead

    def job(_: bool) -> Found:
        # Fluid that is drawn in feeds all modes equally. If only terms of the pipe damp the modes,
        # a high mode on which these terms do not act grows first, at any flow speed.
        missed = pipe.flow == "aspirating" and not pipe.damping and model.resisted
        smallest = 60 if missed else 16
        smallest = max(smallest, math.ceil(0.7 * reach.wave_number(max_speed)) + 8)
        found = converged_ahead(model, crossed, _difference, smallest=smallest)
        assert found.value is not None
        moved = []
        for one in found.value:
            error = 2.0 * one.error + found.error * one.speed
            moved.append(Crossing._made(**vars(one) | {"error": error}))
        return Converged(tuple(moved), found.size, found.error)

    return job


def count_resolved(model: Model, spectrum: _core.Eigenproblem) -> int:
    """Number of lowest modes of a Legendre model that the continuous pipe has as well.

    A mode is resolved if the last functions of each panel hold little of its bending energy, since
    the error of a polynomial series decreases as its last coefficients do. Compared with larger
    bases, on plain pipes and on up to ten uneven spans, the frequencies of the counted modes of an
    ejecting pipe are right to 1e-3.

    Args:
        model: reduced model in Legendre functions.
        spectrum: its spectrum. If this has no modes at rest, all modes count.

    Source: Boyd (2001), Chebyshev and Fourier spectral methods, ch. 2.
    """
    assert isinstance(model, Galerkin)
    modes = spectrum.modes_at_rest()
    if modes is None:
        return model.dof
    squares = modes**2  # elastic energy of each function in each mode
    good = squares[last_functions(model)].sum(axis=0) <= LAST[model.pipe.flow] * squares.sum(axis=0)
    count = int(np.argmin([*good, False]))
    # If damping is so strong that the last resolved modes do not oscillate, the modes beyond are
    # overdamped as well. Roots do not distinguish these modes, so that all of them are tracked.
    return model.dof if is_overdamped(model.pipe, count) else count


class _Search:
    """A search for the crossings of one model, run by `_run_searches`.

    For a long chain only the modes that the flow can make unstable are tracked: their wave number
    is comparable to u. If a root of a higher mode becomes unstable, more modes are tracked.

    Args:
        model: the model, whose configuration is an equilibrium at flow speeds 0 and max_speed.
        max_speed: flow speed at which the search ends.
        until_unstable: whether the search ends at the first crossing that destabilises.
        continuous: whether only modes that the model shares with the continuous pipe count.
        larger: larger reduced model, to which `of_larger` extends the crossings.
    """

    def __init__(
        self,
        model: Model,
        max_speed: float,
        until_unstable: bool,
        continuous: bool = False,
        larger: Galerkin | None = None,
    ) -> None:
        model.require_equilibrium(0.0, max_speed)
        self.model, self.problem = model, Eigenproblem(model.pencil())
        self.reach = Reach(self.problem.pipe)
        self.max_speed, self.until_unstable = max_speed, until_unstable
        self.swept: _core.Sweep | None = None
        spectrum = self.problem.spectrum()
        self.spectrum: _core.Spectrum = spectrum
        self.resolved = count_resolved(model, spectrum) if continuous else None
        self.tracked, self.count = self.problem.dof, 2 * self.problem.dof
        self.larger: tuple[Eigenproblem, _core.Structured] | None = None
        self.all_resolved = True  # whether all resolved modes are tracked
        if self.resolved is not None and isinstance(self.problem.pencil, PanelPencil):
            self._track_reached(self.resolved, spectrum.modes_at_rest())
        # Roots that stay on the imaginary axis have no distance from it that would bound errors.
        if (
            larger is not None
            and self.resolved is not None
            and isinstance(self.problem.pencil, PanelPencil)
            and not (self.problem.is_conservative or self.problem.velocity_free(1.0))
        ):
            problem = eigenproblem(larger)
            more = problem.spectrum()
            assert isinstance(spectrum, _core.Structured)
            assert isinstance(more, _core.Structured)
            self.larger = problem, more
            self.spectrum = _core.Truncated(spectrum, more, self.resolved)
        if not self.problem.is_long or continuous:
            return
        some, pipe = self.reach.modes_within(max_speed), self.problem.pipe
        # The highest modes of a reduced model are not the pipe's, and the flow may make them grow
        # most. Fluid that is drawn into a chain feeds the highest modes most.
        fed = pipe.flow == "aspirating" and not pipe.end_held
        cheaper = _some_are_cheaper(some, max_speed, self.tracked)
        judged = cheaper and (fed or isinstance(self.problem.pencil, PanelPencil))
        known = judged and self.model.dof <= LARGEST_FULL
        modes = spectrum.modes_at_rest() if known else None
        if judged and not self._are_enough(some, modes):
            return
        if cheaper:
            self._track(some)
        before = self.reach.before_cluster() if pipe.damping else self.tracked
        fewer = max_speed / math.pi + 1.0 <= before < self.count // 2
        if fewer and (not fed or self._are_enough(before, modes)):
            self._track(min(before, self.tracked), beyond=1)

    def _track_reached(self, resolved: int, modes: Array | None) -> None:
        """Tracks only the modes of a continuous pipe that the flow reaches, if that is safe.

        It is safe if these modes oscillate and `_are_enough` shows that no higher mode grows first.
        Otherwise all resolved modes are tracked.
        """
        pipe = self.model.pipe
        tracked = min(resolved, math.ceil(self.reach.modes_reached(self.max_speed)) + 2)
        few = self._are_enough(tracked, None if modes is None else modes[:, :resolved])
        if not few:
            tracked = resolved
        oscillate = pipe.damping * (math.pi * (tracked + 4)) ** 2 <= 0.9
        if oscillate and (pipe.end_held or pipe.flow == "ejecting"):
            self.resolved = self.tracked = tracked
            self.count = min(2 * (tracked + 4), self.count)
            self.all_resolved = not few

    def _are_enough(self, some: int, modes: Array | None) -> bool:
        """Whether no mode beyond the first `some` modes at rest grows before these do.

        In a pipe whose end is held across, only modes without stiffness grow. With a free end, the
        outflow must damp each higher mode at least a third as much as the mode that it damps most.
        In a uniform cantilever it damps all modes equally; with a mass at the end, every mode can
        grow. Fluid that is drawn in can make every mode grow as well: then damping must take from
        each higher mode three times the power that the fastest flow supplies to it.
        """
        pipe, pencil = self.model.pipe, self.problem.pencil
        if pipe.end_held or (pipe.flow == "ejecting" and pipe.bare):
            return True
        if modes is None:
            return False
        flow, damping, mass = (
            np.sum(modes * product(modes), axis=0)
            for product in (pencil.velocity, pencil.damping, pencil.mass)
        )
        if pipe.flow == "aspirating":
            return bool(np.all(damping[some:] > -3.0 * self.max_speed * flow[some:]))
        rates = flow / mass
        return bool(np.all(rates[some:] > rates.max(initial=0.0) / 3.0))

    def _track(self, modes: int, beyond: int = 8) -> None:
        """Sets the number of modes to track; roots of `beyond` more modes are computed."""
        every = not _some_are_cheaper(modes, self.max_speed, self.problem.dof)
        self.tracked = self.problem.dof if every else modes
        self.count = 2 * (self.problem.dof if every else modes + beyond)

    def widen(self) -> None:
        """Tracks more modes, after a root of an untracked mode became unstable."""
        self._track(max(2 * self.tracked, self.reach.modes_within(self.max_speed)))

    @property
    def is_possible(self) -> bool:
        """Whether the roots to compute are few enough, or the model is small enough for all."""
        dof = self.problem.dof
        fit = self.count <= min(LARGEST_FULL, LARGEST_VECTORS // dof)
        return fit or dof <= LARGEST_FULL

    def range(self) -> tuple[float, float, int, int, int, int, bool]:
        """The request to the core, in the order of `Range` in linear/crossings.hpp."""
        resolved = self.tracked if self.resolved is None else self.resolved
        certain = min(self.tracked, self.model.resolved_modes)
        return (
            self.max_speed,
            self.reach.speed_scale(),
            self.count,
            self.tracked,
            resolved,
            certain,
            self.until_unstable,
        )

    def __call__(self, sensitive: bool = True) -> Found:
        """The crossings, with sensitivities if `sensitive`; NotConverged if the search failed."""
        assert self.swept is not None
        vouched = None if self.resolved is None else 2 * self.resolved
        found = crossings_of(self.problem, self.swept, vouched, sensitive)
        if self.swept.failure:
            raise NotConverged(self.swept.failure, found)
        return Converged(found, self.problem.dof, 0.0)

    def of_larger(self) -> tuple[Crossing, ...] | None:
        """Crossings of the larger model, if those of the smaller one account for all of them."""
        if self.larger is None or not isinstance(self.spectrum, _core.Truncated):
            return None
        assert self.swept is not None
        end, found = self.max_speed, self.swept.crossings
        if self.until_unstable and found and found[-1].change > 0:
            end = min(end, found[-1].speed * (1.0 + JUST_BEYOND))
        assert self.resolved is not None
        problem, spectrum = self.larger
        # If all resolved modes are tracked, the larger model counts the modes that it resolves.
        modes = count_resolved(problem.model, spectrum) if self.all_resolved else self.resolved
        swept = self.spectrum.of_larger(self.swept, end, modes)
        return None if swept is None else crossings_of(problem, swept, 2 * modes)


def _run_searches(jobs: Sequence[Search], final: bool = True) -> None:
    """Runs the searches among jobs in one call of the core, again where more modes must be tracked.

    If `final` is False, no search is repeated, and `swept.untracked` marks those that should be.
    """
    while jobs:
        searches, spectra, ranges, rows, untracked = [], [], [], 1, []
        for one in jobs:
            if isinstance(one, _Search):
                searches.append(one)
                spectra.append(one.spectrum)
                ranges.append(one.range())
                rows = max(rows, one.problem.rows)
        with one_thread(rows):
            found = _core.crossings(spectra, ranges, count_factorisations)
        for one, swept in zip(searches, found, strict=True):
            one.swept = swept
            if final and swept.untracked:
                one.widen()
                untracked.append(one)
        jobs = untracked


def _some_are_cheaper(tracked: int, max_speed: float, dof: int) -> bool:
    """Whether computing the tracked modes of a long chain is faster than computing all modes."""
    return tracked <= dof // LONG_MODEL and max_speed <= dof / LONG_MODEL


def _difference(a: tuple[Crossing, ...] | None, b: tuple[Crossing, ...] | None) -> float:
    """Largest relative change of a crossing's speed beyond the errors of both speeds.

    It is infinite if crossings differ in kind or number, or are not known.
    """
    if a is None or b is None:
        return math.inf
    # A larger model has more modes that leave the axis at speed 0: the first one represents all.
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
