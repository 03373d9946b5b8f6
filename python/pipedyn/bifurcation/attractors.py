# SPDX-License-Identifier: MIT
"""The attractors at one flow speed and their basins: where motions from many starts end.

A few of the starts are followed as far as `brute_force` needs to tell where they end. So are all
others that do not reach what these, or stable equilibria, show: most of them do, and end there.
"""

from __future__ import annotations

import math
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.bifurcation import brute_force
from pipedyn.bifurcation.brute_force import Attractor
from pipedyn.bifurcation.capture import NOWHERE, STOPPED, Excitation, Labels, Region, follow
from pipedyn.bifurcation.equilibria import LARGEST
from pipedyn.bifurcation.motion_options import FIRST_LOOK, MotionOptions, initial_bends
from pipedyn.bifurcation.on_attractor import Found, Recorder
from pipedyn.bifurcation.vector_field import VectorField
from pipedyn.models.base import Model, PipedynError
from pipedyn.models.drive import LARGEST_SPEED, Harmonic, Pulsation, Supply
from pipedyn.motion.lyapunov import lyapunov_exponent
from pipedyn.motion.simulate import (
    BATCH,
    LARGEST_ENSEMBLE,
    LARGEST_SAMPLES,
    Motion,
    MotionStopped,
    checked_model_in_motion,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.later import futures
from pipedyn.util.result import Result, TableResult
from pipedyn.util.units import LENGTH, RATE

Starts = NDArray[np.int_]
"""Numbers of some of the starts."""

PILOTS = BATCH
"""Starts that are followed first, one batch: what attracts a tenth of all starts is missed once in
30 times, and then found by the others."""

MOST_ATTRACTORS = 100
"""Beyond, attractors are not told apart from motions that have not settled."""


@saved_as("Share")
class Share(Result):
    """How many of all starts.

    Attributes:
        count: number of starts.
        value: the same as a share of all.
        error: its standard error where the starts are drawn at random, independently; half the
            width of Wilson's interval, which is above 0 also where all starts or none count. For
            a plane or starts of one's own it is a measure of how few they are.
    """

    count: int
    value: float
    error: float


@saved_as("Basin", shapes={"F": "frequencies spectrum", "K n": "section"})
class Basin(Result, units={"exponent": RATE, "spectrum": LENGTH}):
    """An attractor, and the starts that end on it.

    Attributes:
        attractor: where one of these ends; its exponent is measured if it is irregular.
        share: of the starts that end on it.
        attracts: whether motions from beside it in all of sixteen directions drawn at random come
            nearer. Where not, the starts lie on what an unstable equilibrium or cycle attracts, as
            the straight pipe at rest does, or it attracts so slowly that none comes nearer in the
            transient. Of irregular ones not known: False.
        period: in T; 0 at rest, NaN where irregular.
        amplitude: half the peak-to-peak transverse motion of the free end, in L.
        exponent: largest Lyapunov exponent in 1 / T: of rest the largest real part of an eigenvalue
            and of a cycle 0, as its phase is neutral; measured where irregular, NaN if not asked
            for, and where the flow pulsates or the base oscillates.
        mirror_image: which of the basins is its mirror image, itself where it is symmetric; -1
            where the pipe has no mirror symmetry or no start ends there.
        frequencies: angular, in 1 / T, shape (F,); empty at rest.
        spectrum: amplitude of the free end's transverse motion by frequency, in L, shape (F,): of a
            cycle, those of its harmonics; where irregular, through Hann's window.
        section: Poincare section: states [q, q'] on it where the free end is at a maximum of its
            transverse position, in order, shape (K, 2 coordinates); empty at rest. Where the flow
            pulsates or the base oscillates, the stroboscopic one: when a period of that begins.
        motion: on it, as it was recorded: of a cycle 16 periods, if driven 48 of the drive's.
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

    @property
    def ending(self) -> str:
        """One of "rest", "periodic" and "irregular", as of `Attractor`."""
        return self.attractor.ending


@saved_as("StartPlane", shapes={"X": "x", "Y": "y"})
class StartPlane(Result):
    """Starts on a plane of two coordinates or rates, such as two initial angles.

    Attributes:
        x: values of the first, increasing, shape (X,).
        y: values of the second, increasing, shape (Y,).
        indices: which entries of the state [q, q'] they are, counted from 0.
        state: [q, q'] elsewhere, shape (2 coordinates,), or coordinates at rest; the pipe at rest
            where not given.

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
        """(Y, X): starts go along x first."""
        return self.y.size, self.x.size


@saved_as("StartFailure")
class StartFailure(Result):
    """A start whose motion stopped or was not computed, or that has none.

    Attributes:
        index: of the start.
        error: why.
    """

    index: int
    error: Exception


@saved_as("Attractors", shapes={"N 2coordinates": "starts", "N": "ends"})
class Attractors(TableResult, units={"exponent": RATE}):
    """All that motions from many starts end on, at one flow speed.

    Attributes:
        u: flow speed, as given.
        basins: attractors with their shares, the largest first.
        unsettled: share of the starts whose motions still approached something at the end.
        failed: share of the starts whose motions stopped or were not computed.
        starts: states [q, q'], shape (N, 2 coordinates).
        ends: of each start which of the basins it lies in; -1 if unsettled, -2 if failed, shape
            (N,).
        failures: the starts whose motions stopped or were not computed, with the reasons.
        model: the model.
        plane: that was given, None for other starts.
        base: motion of the base, as given.

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
    transient: float = 60.0,
    duration: float = 40.0,
    exponents: bool = True,
    rtol: float = 1e-6,
    seed: int = 0,
    executor: futures.Executor | None = None,
    progress: bool = False,
) -> Attractors:
    """All attractors that motions from many starts end on, with the share of starts of each.

    A motion ends as soon as it has reached a known attractor: it is near, and comes nearer, and
    motions from beside that attractor were tried in all directions. Known are stable equilibria and
    on what a first batch of starts ends. All others are integrated for the transient and a time
    that is recorded, and told by the turning points of the free end, as of `bifurcation_diagram`. A
    motion and its mirror image, x to -x, end on two attractors, unless these are the same.

    Where the flow pulsates or the base oscillates, motions begin with a period of that, and states
    are compared at the same phase of it.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom. Its free end must move.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L, or a `Pulsation`.
        starts: a number of starts at rest, drawn at random: the angle theta(s) is the sum of sin((k
            - 1/2) pi s), k = 1, 2, 3, times a_k, uniform in [-2, 2], [-1, 1] and [-1/2, 1/2] rad,
            all times 10^-a, a uniform in [0, 1.5]; shares are of this distribution. Or states
            [q, q'], shape (N, 2 coordinates), or coordinates at rest, (N, coordinates); or a
            `StartPlane`.
        base: motion of the base, of the frequency of a pulsating flow; None at rest.
        transient: time in T after which a motion that has reached nothing known is recorded.
        duration: time over which it is.
        exponents: whether the largest Lyapunov exponent of irregular motions is computed.
        rtol: relative tolerance of the motions. Where those of the first batch are on their way,
            explicit steps take 1e-4 if rtol is less.
        seed: of the random starts, and of the choice of the first batch.
        executor: a `concurrent.futures.Executor`, of which batches are the tasks, instead of the
            threads of this process. Motions that it does not answer, since a worker died or it is
            broken or shut down, fail.
        progress: show progress on stderr.

    Returns:
        Attractors; a start whose motion fails is reported and leaves the others.

    Raises:
        ValueError, TypeError: for bad arguments.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), 2)
        >>> found = pp.attractors(chain, 4.0, 10)
        >>> found.basins[0].ending, found.basins[0].share.value
        ('periodic', 1.0)
    """
    model = checked_model_in_motion(model, largest=LARGEST, purpose="attractors")
    drive = _checked_drive(model, u, base)
    check.real("transient", transient, low=FIRST_LOOK, high=1e6)
    options = MotionOptions.checked(transient, duration, rtol, exponents, seed, executor, progress)
    options = replace(
        options,
        transient=drive.whole(options.transient),
        duration=drive.whole(options.duration),
        flow=drive.u,
        base=drive.base,
    )
    options.require_room(model)
    plane = starts if isinstance(starts, StartPlane) else None
    _require_moving_end(model)
    given = _given_starts(model, starts, options.seed)
    search = _Search(model, drive, given, options)
    search.run(np.random.default_rng(options.seed).permutation(len(given)))
    return search.answer(plane)


def _checked_drive(model: Model, u: Any, base: Any) -> Excitation:
    """The arguments `u` and `base`, if motions end on something."""
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
    if isinstance(u, Pulsation):
        if base is not None and base.frequency != u.frequency:
            raise ValueError(
                f"base must have the frequency of u, {u.frequency:g}, so that both repeat, got "
                f"{base.frequency:g}"
            )
        return Excitation(u, base)
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if u == 0.0 and not (model.pipe.damping or model.resisted):
        raise ValueError(
            "u must be > 0 for a pipe without damping and drag, got 0: nothing takes energy from "
            "its motions, so that they end nowhere"
        )
    return Excitation(u, base)


def _given_starts(model: Model, starts: Any, seed: int) -> Array:
    """The argument as states [q, q'], (N, 2 coordinates)."""
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
    """The states [q, q'] of a plane, (Y X, 2 coordinates)."""
    size = 2 * model.coordinates
    if max(plane.indices) >= size:
        raise ValueError(
            f"starts must have indices in [0, {size - 1}], as a state [q, q'] of the model has "
            f"{size} entries, got {plane.indices}"
        )
    if plane.x.size * plane.y.size > LARGEST_ENSEMBLE:
        raise ValueError(f"starts must be 1 to {LARGEST_ENSEMBLE}, got {plane.shape}")
    rest, _ = model.recorded(model.resting()[None], np.zeros((1, model.moving)))
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
    """Motions are told by their free end: a held one tells nothing."""
    resting = model.resting()
    bent = np.column_stack([resting, resting[:, None] + 0.1 * model.free_directions(resting)])
    p, rates = model.projected(bent, np.zeros_like(bent))
    q, _ = model.recorded(p.T, rates.T)
    places = model.tips(q.T)[:, 0]
    if np.abs(places - places[0]).max() < 1e-6:
        raise ValueError(
            "model must have an end that moves across: attractors are told by its transverse "
            f"motion, and the end of {model!r} is held"
        )


# --------------------------------------------------------------------------------------- the search


class _Search:
    """The attractors found so far, and where each start ends."""

    def __init__(
        self,
        model: Model,
        drive: Excitation,
        starts: Array,
        options: MotionOptions,
    ) -> None:
        self.model, self.drive, self.options = model, drive, options
        self.mean = drive.u if isinstance(drive.u, float) else drive.u.mean
        self.starts = starts
        self.recorder = Recorder(model, drive, options)
        self.found: list[Found] = []
        self.ends = np.full(len(starts), NOWHERE)
        self.errors: dict[int, Exception] = {}
        self.odd = VectorField(model).is_odd(self.mean)
        if drive.shifts and isinstance(drive.u, Pulsation):
            self.odd = False  # half a period later the flow is another

    def run(self, order: Starts) -> None:
        """Finds where the starts end, the first in order before the others."""
        states = np.full((len(self.starts), 2 * self.model.moving), math.nan)
        for i, start in enumerate(self.starts):
            try:
                states[i] = self.model.start(*np.split(start, 2))
            except PipedynError as error:
                self.errors[i] = error
            except ValueError as error:
                rule = str(error).replace("qdot0", "q0").replace("q0", "starts", 1)
                raise ValueError(f"{rule} (start {i})") from error
        for one in self.recorder.stable_equilibria():
            self.learn(one)
        meant = np.array([i for i in order if i not in self.errors], dtype=int)
        pilots, others = meant[:PILOTS], meant[PILOTS:]
        # The last of a batch is where neighbours of all go: it must not be at rest.
        bent = np.abs(states[pilots, : self.model.moving] - self.model.resting()).max(axis=1)
        pilots, options = pilots[np.argsort(bent)], self.options
        if self.drive.period:  # all take the transient, in whole periods
            labels = self.followed(pilots, states, [])
            options = replace(options, transient=0.0)
            self.classify_stopped(pilots[labels == STOPPED], states)
            pilots = pilots[labels == NOWHERE]
        approaching = self.classify(pilots, states, options)
        others = np.concatenate([others, approaching])
        attracting = [k for k, one in enumerate(self.found) if one.attracts]
        labels = self.followed(others, states, [self.found[k].region for k in attracting])
        self.ends[others] = np.array([*attracting, STOPPED, NOWHERE])[labels]
        self.classify(others[labels == NOWHERE], states, replace(self.options, transient=0.0))
        self.classify_stopped(others[labels == STOPPED], states)
        self.ends[list(self.errors)] = STOPPED

    def followed(self, some: Starts, states: Array, regions: list[Region]) -> Labels:
        """Which region motions from some of the states reach in the transient; moves the states."""
        failed = dict[int, Exception]()
        labels, states[some] = follow(
            *(self.model, self.drive, states[some], regions),
            *(self.options.transient, self.options.rtol),
            *(self.options.executor, self.options.shown),
            failed=failed,
        )
        self.errors |= {int(some[place]): error for place, error in failed.items()}
        return labels

    def classify_stopped(self, some: Starts, states: Array) -> None:
        """Finds why motions stopped, from their starts on; of those without answer it is known."""
        some = np.array([i for i in some.tolist() if i not in self.errors], dtype=int)
        for i in some.tolist():
            states[i] = self.model.start(*np.split(self.starts[i], 2))
        self.classify(some, states, self.options)

    def classify(self, some: Starts, states: Array, options: MotionOptions) -> Starts:
        """Where motions from some of the states end. Those that approach something go on there."""
        if not some.size:
            return some
        starts, failed = [states[i].reshape(2, -1) for i in some], list[brute_force.Failed]()
        at = np.array([self.mean])
        asked = replace(options, exponents=False)  # but of those that differ, later
        answers = brute_force.attractors(self.model, at, starts, asked, failed)
        errors = iter(failed)
        for i, one in zip(some.tolist(), answers, strict=True):
            if one.ending == "failed":
                self.ends[i], (_, error) = STOPPED, next(errors)
                if isinstance(error, MotionStopped):  # of which start, by its number here
                    report = str(error).replace(f"start {one.start} ", f"start {i} ", 1)
                    error = MotionStopped(report, error.motion)
                self.errors[i] = error
                continue
            states[i] = one.end
            self.ends[i] = NOWHERE if one.ending == "settling" else self.number(one)
        return some[self.ends[some] == NOWHERE]

    def number(self, one: Attractor) -> int:
        """Which attractor a motion ends on, a new one if it is none of those found."""
        held = self.holding(one)
        if held != NOWHERE or len(self.found) >= MOST_ATTRACTORS:
            return held
        return self.learn(self.recorder.found(one))

    def holding(self, one: Attractor) -> int:
        """Which of those found a motion ended on."""
        held = (k for k, known in enumerate(self.found) if known.holds(one))
        return next(held, NOWHERE)

    def learn(self, one: Found) -> int:
        """Takes another attractor, and its mirror image where there is one."""
        images, shifts = [one], self.drive.shifts
        if (
            self.odd
            and one.attractor.ending != "irregular"
            and not one.is_mirror_image(one, shifts)
        ):
            images.append(one.mirrored(shifts))
        for new in images:
            if self.holding(new.attractor) != NOWHERE:
                continue
            for k, known in enumerate(self.found):
                apart = known.region.apart(new.region)
                self.found[k], new = known.kept_apart(apart), new.kept_apart(apart)
            self.found.append(new)
        return self.holding(one.attractor)

    def share(self, end: int) -> Share:
        """Of the starts that end there."""
        n, count = len(self.starts), int(np.count_nonzero(self.ends == end))
        value = count / n
        error = math.sqrt(value * (1.0 - value) / n + 0.25 / n**2) / (1.0 + 1.0 / n)
        return Share(count, value, error)

    def answer(self, plane: StartPlane | None) -> Attractors:
        """What was found."""
        shares, shifts = [self.share(k) for k in range(len(self.found))], self.drive.shifts
        order = [
            k for k in np.argsort([-s.count for s in shares], kind="stable") if shares[k].count
        ]
        some = [self.found[k] for k in order]
        basins: list[Basin] = []
        for k, one in zip(order, some, strict=True):
            record = self.recorder.record(one.attractor)
            attractor = replace(one.attractor, start=int(np.argmax(self.ends == k)))
            images = (j for j, other in enumerate(some) if one.is_mirror_image(other, shifts))
            image = next(images, -1) if self.odd else -1
            exponent, steady = one.growth, not self.drive.period
            if one.attractor.ending == "periodic" and steady:
                exponent = 0.0
            if attractor.ending == "irregular" and self.options.exponents and steady:
                if 0 <= image < len(basins):  # its exponent is the same
                    measured = basins[image].attractor.exponent
                    assert measured is not None
                    measured = replace(measured, end=-measured.end)
                else:
                    measured = lyapunov_exponent(
                        *(self.model, self.mean, attractor.end),
                        duration=2.0 * self.options.duration,
                        transient=5.0,
                    )
                attractor, exponent = replace(attractor, exponent=measured), measured.value
            basins.append(
                Basin(
                    attractor=attractor,
                    share=shares[k],
                    attracts=one.attracts,
                    period=record.period,
                    amplitude=record.amplitude,
                    exponent=exponent,
                    mirror_image=image,
                    frequencies=record.frequencies,
                    spectrum=record.spectrum,
                    section=record.section,
                    motion=record.motion,
                )
            )
        places = np.append(np.zeros(len(self.found), dtype=int), [STOPPED, NOWHERE])
        places[order] = np.arange(len(order))
        return Attractors(
            u=self.drive.u,
            base=self.drive.base,
            basins=tuple(basins),
            unsettled=self.share(NOWHERE),
            failed=self.share(STOPPED),
            starts=self.starts,
            ends=places[self.ends],
            failures=tuple(StartFailure(i, self.errors[i]) for i in sorted(self.errors)),
            model=self.model,
            plane=plane,
        )
