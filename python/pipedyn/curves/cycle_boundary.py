# SPDX-License-Identifier: MIT
"""Folds, pitchforks, period doublings and tori of cycles in the plane of two numbers.

An event on a branch of cycles or of forced motions is solved for (`EventProblem`) and followed both
ways by the same continuation as the branches themselves. Points on the way at which two conditions
hold get names: cusps; points on the curve of onsets at which the cycle's amplitude falls to 0, so
that folds end (Bautin); points at which other multipliers pass the unit circle; resonances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import cast

from pipedyn.curves.boundary import Boundary
from pipedyn.curves.event_curve import CycleCurve, CyclePoint, EventFollower
from pipedyn.curves.event_onset import Onset
from pipedyn.curves.event_plane import (
    Followed,
    checked_branch_events,
    orbit_at_event,
    plane_of,
)
from pipedyn.curves.in_plane import InPlane
from pipedyn.cycles.branches import CycleBranch, CycleEvent
from pipedyn.forced.forced_response import ForcedBranch, ForcedEvent
from pipedyn.models.base import Model
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread


@saved_as("CycleBoundary")
class CycleBoundary(InPlane):
    """Curves of events of cycles in a window of two numbers.

    Attributes:
        names: names of x and y.
        ranges: ranges of x and y, ((low, high), (low, high)).
        curves: one curve for each event that lies on no curve of another event.
        points: named points on the curves.
        onsets: curves on which the straight pipe becomes unstable, as `boundary` gives them with
            `only_stability`, also at speeds beyond the range; None where motions are forced or
            these curves were not found.
        model: the model.
        failures: sentences that say which curves were not followed to their ends.
        evaluations: number of right-hand sides and Jacobians that were computed.
    """

    _along = ("frequency", "amplitude", "unstable")

    curves: tuple[CycleCurve, ...]
    points: tuple[CyclePoint, ...]
    onsets: Boundary | None = field(repr=False)
    model: Model
    failures: tuple[str, ...]
    evaluations: int


def cycle_boundary(
    branch: CycleBranch | ForcedBranch,
    events: CycleEvent | ForcedEvent | Sequence[CycleEvent | ForcedEvent],
    x: str,
    y: str,
    ranges: Mapping[str, tuple[float, float]],
    *,
    progress: bool = False,
) -> CycleBoundary:
    """Folds, pitchforks, period doublings and tori of cycles followed in two numbers.

    Args:
        branch: branch of cycles from `bifurcation_diagram`, or of forced motions from
            `forced_response`.
        events: one or several events of the branch, of kind "fold", "pitchfork", "period doubling"
            or "torus". A pitchfork breaks the mirror symmetry of cycles; it may be given with
            either of the branches that meet there.
        x: name of a number. For cycles, x or y must be "u", the flow speed; for forced motions, one
            of them must be "frequency", the frequency of the forcing. The other is a number of the
            pipe, such as "beta" and "drag", or of a term, such as "terms[0].mass" or, if there is
            only one such term, "PointMass.mass". For forced motions it may also be "u", or
            "amplitude", the amplitude of the base's motion or of the pulsation relative to its
            mean.
        y: name of the other number.
        ranges: (low, high) of both numbers, by name, in which the events lie.
        progress: whether to show progress on stderr.

    Returns:
        CycleBoundary; a curve that cannot be followed further keeps the points found so far, and
        `failures` says where and why it ends.

    Raises:
        NotConverged: if none of the given events is found again.
        ValueError, TypeError: for bad arguments.

    Example:
        >>> import pipedyn as pp
        >>> diagram = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.2, 3.4])
        >>> branch = diagram.cycles[0]
        >>> fold = next(e for e in branch.events if e.kind == "fold")
        >>> found = pp.cycle_boundary(branch, fold, "beta", "u", {"beta": (0.01, 0.2), "u": (2, 5)})
        >>> [point.kind for point in found.points], found.curves[0].ends
        (['Bautin'], ('range', 'Bautin'))

    Source: Doedel, Govaerts and Kuznetsov (2003), Computation of periodic solution bifurcations in
    ODEs using bordered systems; Kuznetsov, Elements of Applied Bifurcation Theory, ch. 9, for the
    named points on the curves.
    """
    kinds = CycleBranch | ForcedBranch
    check.instance("branch", branch, kinds, "a CycleBranch or a ForcedBranch")
    given = checked_branch_events(branch, events)
    shown = check.flag("progress", progress)
    plane = plane_of(branch, x, y, ranges)
    names, window = plane.names, plane.ranges
    starts = []
    for event in given:
        begin = orbit_at_event(branch, event, plane.at(plane.value))
        own = begin.frequency * plane.order if plane.forced else begin.u
        for name, value, (low, high) in zip(
            names, plane.places(plane.value, own), window, strict=True
        ):
            if not low <= value <= high:
                raise ValueError(
                    f"ranges must hold the event: {name} is {value:.6g} there, and its range is "
                    f"{(low, high)}"
                )
        for end in window[plane.second] if begin.symmetric else ():
            if not plane.at(end).is_odd(begin.u):
                raise ValueError(
                    f"{'xy'[plane.second]} must leave the pipe the mirror symmetry that the cycle "
                    f"has, got {names[plane.second]!r}"
                )
        starts.append(begin)
    curves, failures, followers = list[CycleCurve](), list[str](), list[EventFollower]()
    with one_thread(2 * plane.model.integrated):
        onset = None
        if isinstance(branch, CycleBranch):
            by_flutter = branch.origin == "hopf"
            fastest = max(1.5 * begin.u for begin in starts)
            onset = Onset(plane, branch.onset if by_flutter else math.nan, fastest, shown)
            failures += onset.failures
        for event, begin in zip(given, starts, strict=True):
            follower = EventFollower(plane, cast(Followed, event.kind), shown, onset)
            try:
                start = follower.start(begin)
                here = follower.place(*start)
                if any(one.kind == follower.kind and one.holds(here) for one in followers):
                    continue
                curves.append(follower.run(start))
            except NewtonFailed as reason:
                at = event.frequency if isinstance(event, ForcedEvent) else event.speed
                failures.append(f"the {event.kind} at {at:.6g} is not found again: {reason}")
                continue
            followers.append(follower)
            failures += follower.failures
    if not curves:
        raise NotConverged("; ".join(failures))
    return CycleBoundary(
        names=names,
        ranges=window,
        curves=tuple(curves),
        points=tuple(_distinct([one for by in followers for one in by.points], window)),
        onsets=onset.found if onset is not None else None,
        model=plane.model,
        failures=tuple(failures),
        evaluations=plane.evaluations(),
    )


def _distinct(
    points: list[CyclePoint], ranges: tuple[tuple[float, float], tuple[float, float]]
) -> list[CyclePoint]:
    """Named points without duplicates, as two curves may both have found a common point."""
    widths = [1e-3 * (high - low) for low, high in ranges]
    kept = list[CyclePoint]()
    for new in points:
        near = (
            abs(new.x - old.x) < widths[0]
            and abs(new.y - old.y) < widths[1]
            and abs(new.frequency / old.frequency - 1.0) < 0.01
            for old in kept
            if old.kind == new.kind
        )
        if not any(near):
            kept.append(new)
    return kept
