# SPDX-License-Identifier: MIT
"""The attractors at one flow speed and their basins: where motions from many starts end.

A few of the starts are followed first. Most of the other motions soon reach an attractor that these
have shown, or a stable equilibrium, and end there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent import futures
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.motion_ends import RECORD_FACTOR, Case, motion_ends
from pipedyn.attraction.motion_options import FIRST_LOOK, SAMPLES_A_TIME, MotionOptions
from pipedyn.attraction.regions import NOWHERE, STOPPED
from pipedyn.attraction.solutions import Solution, equilibria_near, with_separate_regions
from pipedyn.equilibrium.equilibria import EQUILIBRIA_DOF, searched
from pipedyn.models.base import Model, loses_energy
from pipedyn.models.drive import (
    LARGEST_SPEED,
    Force,
    Harmonic,
    InputUnits,
    Pulsation,
    Supply,
    checked_periodic_force,
)
from pipedyn.models.space import SpatialModel
from pipedyn.motion.sampling import farthest_direction, turning_points
from pipedyn.motion.simulate import (
    BATCH,
    LARGEST_ENSEMBLE,
    LARGEST_SAMPLES,
    Motion,
    MotionStopped,
    checked_model_in_motion,
    initial_bends,
    simulate,
)
from pipedyn.motion.vector_field import Excitation
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged, PipedynError
from pipedyn.util.newton import zeros_between
from pipedyn.util.result import LENGTH, RATE, TIME, Result, TableResult, Units

PILOTS, GROUP = BATCH, 128
"""Number of starts that are followed first, in one batch, and of those that afterwards share what
they learn. The first batch misses an attractor of a tenth of all starts once in 30 times; the other
starts then find it."""

RECORDED_PERIODS, SAMPLES_A_MAXIMUM = 16, 256
"""Number of periods of a cycle that are recorded for its basin, and of samples between two
maxima."""

DRIVE_PERIODS = 48
"""Number of periods of the drive that are recorded, rounded down to whole periods of the motion."""

MOST_SAMPLES = 2**16
"""Largest number of samples of a motion that is recorded."""

RECORD_TOLERANCE = 1e-9
"""Relative tolerance of the motions that are recorded."""


@saved_as("Share")
class Share(Result):
    """A share of all starts.

    Attributes:
        count: number of starts.
        value: the number divided by that of all starts.
        error: standard error of the value if the starts are drawn at random, independently: half
            the width of Wilson's interval, which is above 0 even if all starts or none count. For a
            plane or given starts it only measures how few starts there are.
    """

    count: int
    value: float
    error: float


@saved_as("Basin", added=("drive_period",))
class Basin(Result, units={"exponent": RATE, "spectrum": LENGTH, "drive_period": TIME}):
    """An attractor, and the starts that end on it.

    Attributes:
        attractor: the attractor, with the end of one of these motions; its exponent is measured if
            it is irregular.
        share: share of the starts that end on it.
        attracts: whether nearby motions come to it, by eigenvalues or Floquet multipliers. If these
            are not known (more than 100 degrees of freedom, or a driven pipe at rest), motions that
            start near it in sixteen random directions are tested. If False, the starts lie on the
            stable set of an unstable equilibrium or cycle, such as the straight pipe at rest. It is
            False for irregular motions, for which it is not known.
        period: in T; 0 at rest, NaN where irregular.
        amplitude: half the peak-to-peak transverse motion of the free end, in L. In three
            dimensions this, the spectrum and the section are those along the direction in which
            the free end moves farthest.
        exponent: largest Lyapunov exponent in 1 / T: at rest the largest real part of an
            eigenvalue, and on a cycle 0, as its phase is neutral; measured for irregular motions,
            NaN if not asked for. NaN for rest and cycles of driven motions.
        mirror_image: index of the basin that is its mirror image, its own index if it is symmetric;
            -1 if motions have no mirror images or no start ends there.
        frequencies: angular frequencies of the spectrum, in 1 / T, shape (F,); empty at rest.
        spectrum: amplitude of the free end's transverse motion at each frequency, in L, shape (F,):
            the amplitudes of a cycle's harmonics; for irregular motions through Hann's window.
        section: Poincare section: states [q, q'] on the attractor where the free end is at a
            maximum of its transverse position, in order, shape (K, 2 coordinates); empty at rest.
            Of driven motions it is the stroboscopic section: the states at the beginning of each
            period of the drive.
        motion: recorded motion on it: 16 periods of a cycle, or 48 periods of the drive.
        drive_period: period in T of what drives the motion; 0 if all is steady.
    """

    attractor: Attractor
    share: Share
    attracts: bool
    period: float
    amplitude: float
    exponent: float
    mirror_image: int
    frequencies: Array = field(repr=False)
    spectrum: Array = field(repr=False)
    section: Array = field(repr=False)
    motion: Motion = field(repr=False)
    drive_period: float = field(default=0.0, repr=False)

    @property
    def ending(self) -> str:
        """Ending of its motions: "rest", "periodic", "quasi-periodic", "chaotic" or "irregular"."""
        return self.attractor.ending


@saved_as("StartPlane")
class StartPlane(Result):
    """Starts on a plane of two coordinates or rates, such as two initial angles.

    Attributes:
        x: values of the first entry, increasing, shape (X,).
        y: values of the second entry, increasing, shape (Y,).
        indices: indices of the two entries in the state [q, q'], counted from 0.
        state: the other entries, as a state [q, q'], shape (2 coordinates,), or as coordinates at
            rest; the pipe at rest if not given.

    Example:
        >>> angles = np.linspace(-1.0, 1.0, 5)
        >>> plane = pp.StartPlane(angles, angles)
        >>> plane.shape
        (5, 5)
    """

    x: Array
    y: Array
    indices: tuple[int, int] = (0, 1)
    state: Array | None = None

    def __post_init__(self) -> None:
        for name in ("x", "y"):
            values = check.array(name, getattr(self, name), longest=LARGEST_ENSEMBLE)
            if not values.size or np.any(np.diff(values) <= 0.0):
                raise ValueError(f"{name} must hold values, strictly increasing")
            object.__setattr__(self, name, values)
        if not isinstance(self.indices, tuple | list) or len(self.indices) != 2:
            raise TypeError(f"indices must be two numbers, got {check.shown(self.indices)}")
        pair = tuple(check.count("indices", one, low=0) for one in self.indices)
        if pair[0] == pair[1]:
            raise ValueError(f"indices must be two different ones, got {pair}")
        object.__setattr__(self, "indices", pair)
        if self.state is not None:
            object.__setattr__(self, "state", check.array("state", self.state))

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (Y, X) of the grid of starts, in which x runs first."""
        return self.y.size, self.x.size


@saved_as("StartFailure")
class StartFailure(Result):
    """A start whose motion stopped or was not computed, or that has no motion.

    Attributes:
        index: number of the start.
        error: the exception that tells why.
    """

    index: int
    error: Exception


@saved_as("Attractors", added=("unsettled_motions", "force"))
class Attractors(TableResult, units={"exponent": RATE}):
    """Attractors of the motions from many starts, at one flow speed.

    Attributes:
        u: flow speed, as given.
        basins: attractors with their shares, the largest first; of equal ones, that with the first
            start.
        unsettled: share of the starts whose motions could not be shown to end anywhere.
        failed: share of the starts whose motions stopped or were not computed.
        starts: states [q, q'], shape (N, 2 coordinates).
        ends: index of the basin in which each start lies; -1 if unsettled, -2 if failed, shape
            (N,).
        failures: the starts whose motions stopped or were not computed, with the reasons.
        model: the model.
        plane: the plane of starts that was given, None for other starts.
        base: motion of the base, as given.
        unsettled_motions: the unsettled motions, each with its `reason`, as many as `unsettled`
            counts.
        force: the force, as given.

    Example:
        >>> found = pp.attractors(pp.Chain(pp.Pipe(0.2), 2), 4.0, 8)
        >>> [(basin.ending, basin.share.count) for basin in found.basins]
        [('periodic', 8)]
    """

    u: float | Pulsation
    basins: tuple[Basin, ...]
    unsettled: Share
    failed: Share
    starts: Array = field(repr=False)
    ends: NDArray[np.int_] = field(repr=False)
    failures: tuple[StartFailure, ...]
    model: Model
    plane: StartPlane | None = field(default=None, repr=False)
    base: Harmonic | None = None
    unsettled_motions: tuple[Attractor, ...] = field(default=(), repr=False)
    force: Force | None = None

    def __len__(self) -> int:
        return len(self.basins)

    def _columns(self) -> dict[str, Any]:
        names = "ending", "period", "amplitude", "exponent", "attracts", "mirror_image"
        shares = {
            "share": [one.share.value for one in self.basins],
            "share_error": [one.share.error for one in self.basins],
        }
        return shares | {name: [getattr(one, name) for one in self.basins] for name in names}


def attractors(
    model: Model,
    u: float | Pulsation,
    starts: int | ArrayLike | StartPlane = 200,
    *,
    base: Harmonic | None = None,
    force: Force | None = None,
    transient: float = 60.0,
    duration: float = 40.0,
    exponents: bool = True,
    rtol: float = 1e-6,
    seed: int = 0,
    executor: futures.Executor | None = None,
    units: Units = "nondimensional",
    progress: bool = False,
) -> Attractors:
    """The attractors of motions from many starts, with the share of starts of each.

    A motion ends as soon as it has reached a known attractor: it is near, and comes nearer as in
    linear theory. Stable equilibria are known from the beginning. If a motion returns to an earlier
    state, a cycle is searched for there, and known from then on if its multipliers are stable. A
    motion that neither rests nor repeats after the transient is followed as long as it comes
    nearer to a known solution. Otherwise it is "chaotic" if its largest Lyapunov exponent is above
    0 by more than three times its spread, and "quasi-periodic" if it is not and averages over its
    record converge as they do only on a torus. If neither can be shown, it is unsettled, with the
    reason. A motion and its mirror image, x to -x, end on two attractors, unless these are the
    same.

    If the flow pulsates, the base oscillates or a force acts, motions begin with a period of the
    drive, and states are compared at the same phase.

    In three dimensions mirror images are those from z to -z. If the pipe is the same in all
    directions, and base and force act along its axis, motions that differ by a turn about the axis
    end on the same attractor. A base that moves across the axis in one plane, or such a force,
    leaves no turn but one mirror: that plane in a pipe that is the same in all directions, and in
    others z = 0, if the base moves in it or along z. Otherwise there are no mirror images.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom. Its free end must move.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L, or a `Pulsation`.
        starts: a number of starts at rest, drawn at random: the angle theta(s) is the sum of sin((k
            - 1/2) pi s), k = 1, 2, 3, times a_k, uniform in [-2, 2], [-1, 1] and [-1/2, 1/2] rad,
            all times 10^-a, a uniform in [0, 1.5]; shares refer to this distribution. Or states [q,
            q'], shape (N, 2 coordinates), or coordinates at rest, (N, coordinates); or a
            `StartPlane`.
        base: motion of the base, with the frequency of a pulsating flow; None if it is at rest.
        force: a `Force` with a frequency, in a steady flow and with the base at rest; None if none
            acts.
        transient: time in T after which a motion that has not ended is recorded.
        duration: time in T over which it is recorded; a motion that still comes nearer to a
            solution is followed for up to eight times the sum of both times.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed. Without
            it they are "irregular".
        rtol: relative tolerance of the motions.
        seed: seed of the random starts, and of the choice of the first batch.
        executor: a `concurrent.futures.Executor` that computes batches as tasks, instead of the
            threads of this process. Motions fail if it does not return their batch, because a
            worker died or it is broken or shut down.
        units: "si" if u is given in m/s, transient and duration in s, and the pipe has scales;
            times not given keep their values in T. A pulsation, a base and a force must then come
            from `Pulsation.from_si`, `Harmonic.from_si` and `Force.from_si`.
        progress: show progress on stderr.

    Returns:
        Attractors; if the motion of a start fails, it is reported and the others are kept.

    Raises:
        ValueError, TypeError: for bad arguments.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), 2)
        >>> found = pp.attractors(chain, 4.0, 10)
        >>> found.basins[0].ending, found.basins[0].share.value
        ('periodic', 1.0)

        A hose that is shaken in a plane ends on one of two whirls, which are mirror images:

        >>> hose = pp.Chain(pp.Pipe(0.2, 10.0, damping=0.001), 3, dimensions=3)
        >>> shaken = pp.Harmonic(0.01, 5.15)
        >>> found = pp.attractors(hose, 0.1, 4, base=shaken, transient=400.0)
        >>> [(round(one.period / shaken.period, 6), one.mirror_image) for one in found.basins]
        [(1.0, 1), (1.0, 0)]
    """
    model = checked_model_in_motion(model, largest=EQUILIBRIA_DOF, purpose="attractors")
    given_in = InputUnits(units, model.pipe)
    if isinstance(u, Pulsation) or not callable(u):
        u = given_in.speed("u", u)
    transient, duration = given_in.times(attractors, transient=transient, duration=duration)
    with given_in.explained():
        drive = _checked_drive(model, u, given_in.base(base), given_in.force(force))
        check.real("transient", transient, low=FIRST_LOOK, high=1e6)
        options = MotionOptions.checked(
            transient, duration, rtol, exponents, seed, executor, progress
        )
    options = replace(
        options, transient=drive.whole(options.transient), duration=drive.whole(options.duration)
    )
    options.require_room(model)
    plane = starts if isinstance(starts, StartPlane) else None
    _require_moving_end(model)
    given = _given_starts(model, starts, options.seed)
    # Motions of a pipe that is driven in one plane are computed turned into the plane z = 0.
    flat, azimuth = drive.in_plane() if model.axisymmetric else (drive, 0.0)
    case = _case(model, flat, given, options, azimuth)
    solutions = [
        replace(one, attractor=_turned_end(model, drive, one.attractor, azimuth))
        for one in case.solutions
    ]
    records = dict[int, Motion]()
    for k in {number for number, _ in case.ends.values() if number >= 0}:
        try:
            records[k] = _motion_on(model, drive, options, solutions[k])
        except MotionStopped as stopped:
            seemed = f"after it seemed {solutions[k].attractor.ending}, {stopped}"
            error = _turned_end(model, flat, MotionStopped(seemed, stopped.motion), -azimuth)
            lost = (i for i, (number, _) in case.ends.items() if number == k)
            case.ends |= dict.fromkeys(lost, (STOPPED, error))
    every = [case.ends[i] for i in range(len(given))]
    ends = np.array([number for number, _ in every])
    shares = [_share(ends, k) for k in range(len(case.solutions))]
    first = {k: int(np.argmax(ends == k)) for k, share in enumerate(shares) if share.count}
    order = sorted(first, key=lambda k: (-shares[k].count, first[k]))
    some = [case.solutions[k] for k in order]
    basins, shifts = [], flat.shifts(model)
    for k, one in zip(order, some, strict=True):
        images = (j for j, other in enumerate(some) if one.is_mirror_image(other, shifts))
        image = next(images, -1) if case.odd else -1
        end = replace(solutions[k].attractor, start=first[k])
        one = replace(one, attractor=end)
        basins.append(_basin(model, drive, one, records[k], shares[k], image))
    places = np.append(np.zeros(len(shares), dtype=int), [STOPPED, NOWHERE])
    places[order] = np.arange(len(order))
    all_ends = [_turned_end(model, drive, end, azimuth) for _, end in every]
    failed = [(i, end) for i, end in enumerate(all_ends) if isinstance(end, Exception)]
    unsettled = [end for end in all_ends if isinstance(end, Attractor) and end.reason]
    return Attractors(
        u=drive.u,
        base=drive.base,
        basins=tuple(basins),
        unsettled=_share(ends, NOWHERE),
        failed=_share(ends, STOPPED),
        starts=given,
        ends=places[ends],
        failures=tuple(StartFailure(i, error) for i, error in failed),
        model=model,
        plane=plane,
        unsettled_motions=tuple(unsettled),
        force=drive.force,
    )


def _turned(model: Model, states: Array, angle: float) -> Array:
    """States [q, q'], (..., 2 coordinates), turned about the axis from x towards z."""
    if not (angle and isinstance(model, SpatialModel)):
        return states
    return np.ascontiguousarray(model.turned(states.T, angle).T)


def _turned_end(model: Model, drive: Excitation, end: Any, angle: float) -> Any:
    """The end of a motion, an attractor or an exception, turned about the axis.

    drive: what drives the turned motion.
    """
    if isinstance(end, Attractor):
        return replace(end, end=_turned(model, end.end, angle))
    if isinstance(end, MotionStopped):
        q, qdot = np.split(_turned(model, end.motion.y.T, angle), 2, axis=1)
        motion = replace(end.motion, q=q, qdot=qdot, tip=model.tips(q.T), base=drive.base)
        return MotionStopped(str(end), motion)
    return end


def _checked_drive(model: Model, u: Any, base: Any, forces: tuple[Force, ...]) -> Excitation:
    """The drive that the arguments describe; refuses drives with which no motion ends."""
    if isinstance(u, Supply) or (callable(u) and not isinstance(u, Pulsation)):
        rule = "u must be a flow speed or a Pulsation"
        raise TypeError(
            f"{rule}, as attractors need a steady flow or a period, got {check.shown(u)}"
        )
    if not (base is None or isinstance(base, Harmonic)):
        raise TypeError(
            f"base must be a Harmonic, which has a period, or None, got {check.shown(base)}"
        )
    if base is not None:
        model.require_base()
        base.require_dimensions(model.dimensions)
    if len(forces) > 1 or (forces and (base is not None or isinstance(u, Pulsation))):
        raise ValueError(
            "force must be one, where the flow is steady and the base at rest, got "
            f"{check.shown(forces)}"
        )
    force = next((checked_periodic_force(one, model.dimensions) for one in forces), None)
    if isinstance(u, Pulsation):
        if base is not None and base.frequency != u.frequency:
            raise ValueError(
                f"base must have the frequency of u, {u.frequency:g}, so that both repeat, got "
                f"{base.frequency:g}"
            )
        return Excitation(u, base)
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if not loses_energy(model, u):
        raise ValueError(
            "u must be > 0 for a pipe without damping and drag, got 0: nothing takes energy from "
            "its motions, so that they end nowhere"
        )
    return Excitation(u, base, force)


def _given_starts(model: Model, starts: Any, seed: int) -> Array:
    """The argument `starts` as states [q, q'], shape (N, 2 coordinates)."""
    size = model.coordinates
    if isinstance(starts, StartPlane):
        return _plane_states(starts, model)
    kinds = "a whole number, an array of states or a StartPlane"
    given = check.numbers("starts", starts, kinds, longest=LARGEST_SAMPLES)
    if given.ndim == 0:
        count = check.count("starts", starts, high=LARGEST_ENSEMBLE)
        made = np.array(initial_bends(model, count + 1, seed)[1:])
    elif given.ndim != 2 or given.shape[1] not in (size, 2 * size):
        raise ValueError(
            f"starts must have the shape (N, {2 * size}) of states [q, q'] or (N, {size}) of "
            f"coordinates at rest, got {given.shape}"
        )
    elif not 0 < len(given) <= LARGEST_ENSEMBLE:
        raise ValueError(f"starts must be 1 to {LARGEST_ENSEMBLE}, got {len(given)}")
    else:
        made = check.array("starts", given.ravel(), longest=LARGEST_SAMPLES).reshape(given.shape)
    return np.concatenate([made, np.zeros((len(made), 2 * size - made.shape[1]))], axis=1)


def _plane_states(plane: StartPlane, model: Model) -> Array:
    """States [q, q'] of the starts on a plane, shape (Y X, 2 coordinates)."""
    size = 2 * model.coordinates
    if max(plane.indices) >= size:
        raise ValueError(
            f"starts must have indices in [0, {size - 1}], as a state [q, q'] of the model has "
            f"{size} entries, got {plane.indices}"
        )
    if plane.x.size * plane.y.size > LARGEST_ENSEMBLE:
        raise ValueError(f"starts must be 1 to {LARGEST_ENSEMBLE}, got {plane.shape}")
    rest, _ = model.to_user(model.resting()[None], np.zeros((1, model.integrated)))
    given = rest[0] if plane.state is None else plane.state
    if given.size not in (size, size // 2):
        raise ValueError(
            f"starts must have a state of {size // 2} or {size} entries, got {given.size}"
        )
    made = np.zeros((*plane.shape, size))
    made[..., : given.size] = given
    made[..., plane.indices[0]] = plane.x
    made[..., plane.indices[1]] = plane.y[:, None]
    return made.reshape(-1, size)


def _require_moving_end(model: Model) -> None:
    """Refuses a model whose free end is held: motions are told apart by the tip's motion."""
    resting = model.resting()
    bent = np.column_stack([resting, resting[:, None] + 0.1 * model.free_directions(resting)])
    p, rates = model.onto_constraints(bent, np.zeros_like(bent))
    q, _ = model.to_user(p.T, rates.T)
    places = model.tips(q.T)[:, 0]
    if np.abs(places - places[0]).max() < 1e-6:
        raise ValueError(
            "model must have an end that moves across: attractors are told by its transverse "
            f"motion, and the end of {model!r} is held"
        )


# --------------------------------------------------------------------------------------- the search


def _case(
    model: Model, drive: Excitation, starts: Array, options: MotionOptions, azimuth: float
) -> Case:
    """The case of motions from states [q, q'], with their ends, turned back by an azimuth."""
    case = Case(model, drive, _stable_equilibria(model, drive))
    for i, start in enumerate(starts):
        try:
            begun = np.asarray(model.initial_state(*np.split(start, 2)))
            case.starts[i] = _turned(model, begun, -azimuth)
        except PipedynError as error:
            case.ends[i] = STOPPED, error
        except ValueError as error:
            rule = str(error).replace("qdot0", "q0").replace("q0", "starts", 1)
            raise ValueError(f"{rule} (start {i})") from error
    order = np.random.default_rng(options.seed).permutation(len(starts)).tolist()
    order = [i for i in order if i in case.starts]
    for some in (order[:PILOTS], order[PILOTS:]):
        known = case.solutions
        parts = [some[i : i + GROUP] for i in range(0, len(some), GROUP)]
        copies = [Case(model, drive, known, {i: case.starts[i] for i in part}) for part in parts]
        for copy in motion_ends(model, copies, options, "attractors"):
            new = [case.learn(one) for one in copy.solutions[len(known) :]]
            numbers = [*range(len(known)), *new, STOPPED, NOWHERE]
            case.ends |= {i: (numbers[number], end) for i, (number, end) in copy.ends.items()}
    return case


def _stable_equilibria(model: Model, drive: Excitation) -> list[Solution]:
    """Stable equilibria, as far as they are found; none if motions are driven."""
    if drive.period:
        return []
    try:
        known = searched(model, drive.mean, (), counted=False)
    except NotConverged:
        return []
    q = known.q[known.stable]
    places = model.from_user(q, np.zeros_like(q))[:, : model.integrated]
    found = equilibria_near(model, places, drive.mean)
    return with_separate_regions([one for one in found if one.attracts])


def _share(ends: NDArray[np.int_], end: int) -> Share:
    """The share of the starts whose entry in `ends` is a given index."""
    n, count = len(ends), int(np.count_nonzero(ends == end))
    value = count / n
    error = math.sqrt(value * (1.0 - value) / n + 0.25 / n**2) / (1.0 + 1.0 / n)
    return Share(count, value, error)


# ---------------------------------------------------------------------------- motions on attractors


def _motion_on(model: Model, drive: Excitation, options: MotionOptions, one: Solution) -> Motion:
    """A motion on a solution, from its end on; raises MotionStopped if it was only a transient."""
    end, period = one.attractor, one.period
    if end.ending == "rest":
        duration, samples = 1.0, 101
    elif math.isnan(period):
        duration = drive.whole(RECORD_FACTOR * options.duration)
        samples = math.ceil(duration * SAMPLES_A_TIME) + 1
    elif drive.period:
        duration = max(DRIVE_PERIODS // round(period / drive.period), 1) * period
        samples = round(duration / drive.period) * SAMPLES_A_MAXIMUM // 2 + 1
    else:
        duration = RECORDED_PERIODS * period
        samples = RECORDED_PERIODS * SAMPLES_A_MAXIMUM * end.period + 1
    q, qdot = (part[0] for part in model.to_user(*(y[None] for y in np.split(end.end, 2))))
    return simulate(
        *(model, drive.u, duration, q, qdot),
        samples=min(samples, MOST_SAMPLES + 1),
        base=drive.base,
        force=drive.force,
        rtol=RECORD_TOLERANCE,
        dense=True,
    )


def _basin(
    model: Model, drive: Excitation, one: Solution, motion: Motion, share: Share, image: int
) -> Basin:
    """The basin of a solution, with the quantities measured on a recorded motion on it."""
    end, period = one.attractor, one.period
    ending, repeats, duration = end.ending, not math.isnan(period), float(motion.t[-1])
    amplitude, points = 0.0, np.empty((0, 2 * model.coordinates))
    frequencies = spectrum = np.zeros(0)
    direction = farthest_direction(motion.tip)
    x = motion.tip @ direction
    if ending != "rest":
        turnings = turning_points(motion.t, x, motion.tip_velocity @ direction)
        amplitude = 0.5 * float(np.ptp(turnings)) if turnings.size else 0.0
        assert motion.dense is not None
        t = np.linspace(0.0, duration, math.ceil(duration * SAMPLES_A_TIME) + 1)
        points = section(model, motion.dense, t, drive.period, direction)
        frequencies, spectrum = _lines(motion.t[:-1], x[:-1], whole=repeats)
        # Between the harmonics the spectrum is 0 but for errors.
        every = slice(0, None, round(duration / period) if repeats else 1)
        frequencies, spectrum = frequencies[every], spectrum[every]
    exponent = one.growth
    if ending in ("periodic", "rotating") and not drive.period:
        exponent = 0.0
    elif end.exponent is not None:
        exponent = end.exponent.value
    return Basin(
        attractor=end,
        share=share,
        attracts=one.attracts,
        period=period,
        amplitude=amplitude,
        exponent=exponent,
        mirror_image=image,
        frequencies=frequencies,
        spectrum=spectrum,
        section=points,
        motion=motion,
        drive_period=drive.period,
    )


def section(
    model: Model, states: Callable[[Array], Array], t: Array, drive: float, direction: Array
) -> Array:
    """States [q, q'] of a Poincare section of a motion, shape (K, 2 coordinates).

    They are those at the beginnings of the periods of the drive; or, if all is steady and `drive`
    0, those where the transverse position of the free end is at a maximum.

    Args:
        model: model that moves.
        states: states of the motion, (2 coordinates, k), at times (k,).
        t: times of the motion, increasing, between which the free end turns round at most once.
        drive: period of the drive.
        direction: unit vector along which the transverse position is measured.
    """
    half = model.coordinates

    def velocity(t: Array) -> Array:
        found = states(t)
        return np.asarray(model.tip_velocities(found[:half], found[half:]) @ direction)

    if drive:
        at = drive * np.arange(*(math.ceil(time / drive - 1e-6) for time in (t[0], t[-1])))
    else:
        values = velocity(t)
        falls = np.flatnonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))
        at = zeros_between(velocity, t[falls], t[falls + 1], values[falls], values[falls + 1])
    return np.ascontiguousarray(states(at).T)


def _lines(t: Array, x: Array, *, whole: bool) -> tuple[Array, Array]:
    """Angular frequencies and amplitudes of the Fourier series of evenly spaced samples of x.

    whole: whether the samples span a whole number of periods; otherwise Hann's window is applied.
    """
    window = np.ones(x.size) if whole else np.hanning(x.size + 1)[:-1]
    found = np.asarray(np.abs(np.fft.rfft((x - x.mean()) * window)) * 2.0 / window.sum())
    return np.asarray(2.0 * math.pi * np.fft.rfftfreq(x.size, float(t[1] - t[0]))), found
