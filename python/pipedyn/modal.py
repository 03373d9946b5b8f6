# SPDX-License-Identifier: MIT
"""Eigenvalues, modes, root loci, critical speeds and stability curves of any model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.blas import one_thread
from pipedyn.chain import Chain
from pipedyn.continuum import Continuum, relative
from pipedyn.circulatory import CirculatoryHunt
from pipedyn.crossing import Hunt, Passage, Sweep, Untracked
from pipedyn.follow import march, sample
from pipedyn.galerkin import Galerkin
from pipedyn.model import Model, NotConverged, PipedynError
from pipedyn.pipe import Pipe
from pipedyn.progress import track
from pipedyn.spectrum import (
    BandPencil,
    Complex,
    DensePencil,
    Eigenpairs,
    Pencil,
    lowest,
    pencil_of,
    rows_of,
)

AnyModel = Model | Continuum
Kind = Literal["flutter", "divergence"]

LARGEST_SPEED = 1e4
LARGEST_SWEEP = 2000
"""Degrees of freedom up to which passages are searched."""


class NoCrossing(PipedynError):
    """The pipe does not lose stability up to the end of the search.

    Attributes:
        max_speed: where the search ended.
    """

    def __init__(self, message: str, max_speed: float) -> None:
        super().__init__(message, max_speed)
        self.max_speed = max_speed

    def __str__(self) -> str:
        return str(self.args[0])


# ---------------------------------------------------------------------------------- eigenvalues


def eigenvalues(model: AnyModel, u: float, count: int | None = None) -> Complex:
    """Eigenvalues lambda of the straight pipe at flow speed u; motion ~ exp(lambda tau).

    Args:
        model: chain, reduced model or `Continuum`.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        count: how many, from the lowest |lambda|; all 2 dof where not given. Long chains (beyond
            64 segments) are solved in O(n) for a small count. `Continuum` needs it.

    Returns:
        Complex array (count,), sorted by |lambda|; of a conjugate pair both stand side by side, the
        upper first (an odd count may cut the last pair).

    Raises:
        NotConverged: if an eigenvalue fails the check of its residual; `result` holds the `Modes`,
            of which `converged` says which.
        ValueError, TypeError: for bad arguments.

    Source: the inverse problem in joint angles, see `pipedyn.spectrum`.
    """
    return _good(modes(model, u, count)).eigenvalues


@dataclass(frozen=True)
class ModeShape:
    """Transverse displacement of one mode, complex; its largest magnitude is 1, there it is real.

    Attributes:
        eigenvalue: lambda.
        model: the model it belongs to.
        coordinates: q, complex, shape (dof,).
    """

    eigenvalue: complex
    model: Model = field(repr=False)
    coordinates: Complex = field(repr=False, compare=False)

    def __call__(self, s: ArrayLike) -> Complex:
        """Complex displacement at arc lengths s in [0, 1], shape (len(s),).

        The motion is Re(shape(s) exp(lambda tau)).
        """
        return np.asarray(self.model.deflection(self.coordinates, s), dtype=np.complex128)


@dataclass(frozen=True)
class Modes:
    """Eigenvalues and modes at one flow speed.

    Attributes:
        speed: u.
        eigenvalues: lambda, complex, shape (count,), sorted by |lambda|.
        shapes: one function of s for each eigenvalue.
        residuals: relative residual of each pair, shape (count,).
        converged: whether each passed the check of its residual, shape (count,).
        size: degrees of freedom of the model solved.
        discretisation: for `Continuum`, the largest relative change of an eigenvalue from the
            basis before the last; None for other models.
    """

    speed: float
    eigenvalues: Complex
    shapes: tuple[ModeShape, ...] = field(repr=False)
    residuals: Array = field(repr=False)
    converged: NDArray[np.bool_] = field(repr=False)
    size: int
    discretisation: float | None = None


def modes(model: AnyModel, u: float, count: int | None = None) -> Modes:
    """Eigenvalues and complex mode shapes of the straight pipe at flow speed u.

    Args:
        model, u, count: as for `eigenvalues`.

    Returns:
        Modes, in the order of `eigenvalues`; one that fails its residual check has converged False.

    Raises:
        NotConverged: if the continuous pipe's eigenvalues do not stand still as the basis grows.
        ValueError, TypeError: for bad arguments.
    """
    _check_model(model)
    u = _check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if count is not None:
        count = _check.count("count", count, high=100_000)
    if isinstance(model, Continuum):
        if count is None:
            raise ValueError("count must be given for a Continuum: its eigenvalues have no end")
        if count > 400:
            raise ValueError(f"count must be at most 400 for a Continuum, got {count}")
        asked = count
        settled = model.settle(
            lambda rom: _modes(rom, u, asked),
            lambda a, b: relative(a.eigenvalues, b.eigenvalues),
            smallest=max(16, count),
        )
        found = settled.value
        return Modes(
            *(u, found.eigenvalues, found.shapes, found.residuals, found.converged),
            *(settled.size, settled.error),
        )
    if count is not None and count > 2 * model.dof:
        raise ValueError(f"count must be at most 2 dof = {2 * model.dof}, got {count}")
    if count is None and model.dof > LARGEST_SWEEP:
        raise ValueError(
            f"count must be given beyond {LARGEST_SWEEP} degrees of freedom, got {model.dof}"
        )
    return _modes(model, u, count)


def _modes(model: Model, u: float, count: int | None) -> Modes:
    pencil = pencil_of(model)
    with one_thread(rows_of(pencil)):
        pairs = lowest(pencil, u, count)
    coordinates = model.from_elastic(pairs.right)
    peaks = _peaks(model, coordinates)
    with np.errstate(divide="ignore", invalid="ignore"):
        coordinates = coordinates / peaks
    shapes = tuple(
        ModeShape(complex(value), model, coordinates[:, i]) for i, value in enumerate(pairs.values)
    )
    return Modes(u, pairs.values, shapes, pairs.residuals, pairs.converged, model.dof)


def _peaks(model: Model, coordinates: Complex) -> Complex:
    """Displacement of largest magnitude of each mode, shape (count,)."""
    s = np.linspace(0.0, 1.0, max(201, 8 * min(model.dof, 500) + 1))
    if isinstance(model, Chain):
        s = np.minimum(model.base + np.cumsum(model.lengths), 1.0)  # polylines peak at their nodes
    displacement = model.deflection(coordinates, s)
    where = np.argmax(np.abs(displacement), axis=0)
    peaks: Complex = displacement[where, np.arange(where.size)]
    return peaks


def _good(found: Modes) -> Modes:
    if not found.converged.all():
        bad = np.flatnonzero(~found.converged)
        raise NotConverged(
            f"{bad.size} of {found.converged.size} eigenvalues at u = {found.speed:g} failed their residual "
            f"check, the first at index {bad[0]} with {found.residuals[bad[0]]:.1e}",
            found,
        )
    return found


# ------------------------------------------------------------------------------------ root loci


@dataclass(frozen=True)
class RootLoci:
    """Eigenvalues as functions of the flow speed, each column one branch.

    Attributes:
        speeds: u, shape (S,).
        eigenvalues: lambda, complex, shape (S, count); a branch starts in the upper half plane, or
            on the real axis with the greater of a pair.
        partners: the other root of each pair, shape (S, count): the conjugate while the pair is
            complex, the other real root while it is not.
        converged: whether each eigenvalue passed the check of its residual, shape (S, count).
        size: degrees of freedom of the model solved.
    """

    speeds: Array
    eigenvalues: Complex = field(repr=False)
    partners: Complex = field(repr=False)
    converged: NDArray[np.bool_] = field(repr=False)
    size: int


def root_loci(
    model: AnyModel, speeds: ArrayLike, count: int = 4, progress: bool = False
) -> RootLoci:
    """Branches of eigenvalues followed along the flow speed, not sorted.

    Between the speeds asked for, others are visited where a match would be doubtful.

    Args:
        model: chain, reduced model or `Continuum`.
        speeds: flow speeds u >= 0, strictly increasing, shape (S,).
        count: number of branches, the lowest pairs at the first speed.
        progress: show progress on stderr.

    Returns:
        RootLoci, at the speeds asked for only.

    Raises:
        NotConverged: if the continuous pipe's branches do not stand still as the basis grows.
        ValueError, TypeError: for bad arguments.
    """
    _check_model(model)
    at = _check.array("speeds", speeds, low=0.0, high=LARGEST_SPEED, longest=100_000)
    if np.any(np.diff(at) <= 0.0):
        raise ValueError("speeds must be strictly increasing")
    count = _check.count("count", count, high=1000)
    shown = _check.flag("progress", progress)
    if isinstance(model, Continuum):
        settled = model.settle(
            lambda rom: _root_loci(rom, at, count, shown),
            lambda a, b: relative(_both(a), _both(b)),
            tolerance=1e-8,
            smallest=max(16, 3 * count, math.ceil(at[-1])),
        )
        return settled.value
    if count > model.dof:
        raise ValueError(f"count must be at most dof = {model.dof}, got {count}")
    return _root_loci(model, at, count, shown)


def _both(loci: RootLoci) -> Complex:
    """Symmetric functions of each pair: smooth in u where the pair meets on the real axis."""
    half = 0.5 * (loci.eigenvalues + loci.partners)
    return np.stack([half, np.sqrt(np.abs(loci.eigenvalues * loci.partners))])


def _root_loci(model: Model, speeds: Array, count: int, shown: bool) -> RootLoci:
    pencil = pencil_of(model)
    taken = 2 * count + 16
    while True:
        every = isinstance(pencil, DensePencil) or taken >= pencil.dof
        with one_thread(rows_of(pencil)):
            found = _followed(pencil, speeds, count, None if every else taken, shown)
        if found is not None:
            return found
        taken *= 2  # a branch climbed out of the eigenvalues computed


def _followed(
    pencil: Pencil, speeds: Array, count: int, taken: int | None, shown: bool
) -> RootLoci | None:
    first = sample(pencil, float(speeds[0]), taken)
    upper, lower = _pairs(first.values, count)
    if upper.size < count:
        return None
    values = np.empty((speeds.size, count), dtype=np.complex128)
    partners = np.empty_like(values)
    converged = np.empty(values.shape, dtype=np.bool_)
    steps = march(
        lambda u: sample(pencil, u, taken),
        first,
        map(float, speeds[1:]),
        first.values.size if taken is None else 4 * count,
    )

    def store(row: int, pairs: Eigenpairs) -> None:
        values[row], partners[row] = pairs.values[upper], pairs.values[lower]
        converged[row] = pairs.converged[upper] & pairs.converged[lower]

    store(0, first.pairs)
    row = 1
    ticks = track(range(1, speeds.size), speeds.size - 1, "root loci", shown)
    for step in steps:
        was_real = (step.left.values[upper].imag == 0.0) & (step.left.values[lower].imag == 0.0)
        upper, lower = step.onto[upper], step.onto[lower]
        if (upper < 0).any() or (lower < 0).any():
            return None
        # A branch that left the upper half plane comes back there.
        swap = was_real & (step.right.values[upper].imag < 0.0)
        upper, lower = np.where(swap, lower, upper), np.where(swap, upper, lower)
        if step.right.u == speeds[row]:
            store(row, step.right.pairs)
            row += 1
            next(ticks)
    for _ in ticks:
        pass
    return RootLoci(speeds, values, partners, converged, pencil.dof)


def _pairs(values: Complex, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Upper (or greater) and lower root of the `count` lowest pairs."""
    upper, lower = [], []
    left = list(range(values.size))
    while left and len(upper) < count:
        i = left.pop(0)
        wanted = np.conj(values[i])
        if values[i].imag == 0.0:
            wanted = -values[i]
        same = [k for k in left if (values[k].imag == 0.0) == (values[i].imag == 0.0)]
        if not same:
            break
        k = min(same, key=lambda k: abs(values[k] - wanted))
        left.remove(k)
        first_is_upper = (values[i].imag, values[i].real) > (values[k].imag, values[k].real)
        upper.append(i if first_is_upper else k)
        lower.append(k if first_is_upper else i)
    return np.array(upper, dtype=np.intp), np.array(lower, dtype=np.intp)


# ------------------------------------------------------------------------------ critical speeds


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of one quantity by the pipe's numbers and the springs.

    Attributes:
        beta: None at beta = 0, where the square root of beta has no derivative.
        gamma, damping, alpha: alpha 0 for an ejecting pipe.
        springs: by each k_j, shape (n,), the others held; None for reduced models.
    """

    beta: float | None
    gamma: float
    damping: float
    alpha: float
    springs: Array | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Sensitivity:
    """How a passage moves with the pipe's numbers.

    Attributes:
        speed: derivatives of its speed.
        frequency: derivatives of its frequency.
    """

    speed: Derivatives
    frequency: Derivatives


@dataclass(frozen=True)
class Crossing:
    """A passage of an eigenvalue, or of a conjugate pair, through the imaginary axis.

    Attributes:
        speed: u.
        frequency: angular, in 1 / T; 0 for divergence.
        kind: "flutter" (a pair) or "divergence" (a real root).
        unstable_before, unstable_after: number of unstable roots on either side, a pair being two.
        error: of the speed, absolute: the eigenvalue solver's, and for `Continuum` the basis'.
        mode: which branch passes, counted from rest by frequency, from 1; of two that meet on the
            axis (beta = 0) the higher.
        sensitivity: derivatives of speed and frequency; None at u = 0 and at beta = 0 without
            damping.
    """

    speed: float
    frequency: float
    kind: Kind
    unstable_before: int
    unstable_after: int
    error: float
    mode: int
    sensitivity: Sensitivity | None = field(default=None, repr=False)

    @property
    def destabilising(self) -> bool:
        """Whether unstable roots become more."""
        return self.unstable_after > self.unstable_before


@dataclass(frozen=True)
class CriticalSpeed:
    """The lowest passage that destabilises.

    Attributes:
        speed: u; 0 if the pipe is unstable from the smallest flow on.
        frequency: angular, in 1 / T; 0 for divergence.
        kind: "flutter" or "divergence".
        error: of the speed, absolute: the eigenvalue solver's, and for `Continuum` the basis'.
        mode: which branch, counted from rest by frequency, from 1.
        stable_at_rest: False if the pipe is buckled without flow.
        sensitivity: derivatives of speed and frequency; None at u = 0 and at beta = 0 without
            damping.
        size: degrees of freedom of the model solved.
        pipe: the pipe.
    """

    speed: float
    frequency: float
    kind: Kind
    error: float
    mode: int
    stable_at_rest: bool
    sensitivity: Sensitivity | None = field(repr=False)
    size: int
    pipe: Pipe = field(repr=False)
    _approximates: bool = field(repr=False, default=True)
    _continuous: float | None = field(repr=False, default=None)
    _max_speed: float = field(repr=False, default=100.0)

    @cached_property
    def discretisation(self) -> float | None:
        """Bound on the distance of the speed to the continuous pipe's, absolute.

        None for chains with springs or inertia of the user's own, infinite where the continuous
        pipe has no critical speed. The continuous pipe is solved at the first request.
        """
        if not self._approximates:
            return None
        if self._continuous is not None:
            return self._continuous
        try:
            exact = critical_speed(Continuum(self.pipe), self._max_speed)
        except NoCrossing:
            return math.inf
        return abs(self.speed - exact.speed) + self.error + exact.error


def crossings(model: AnyModel, max_speed: float) -> tuple[Crossing, ...]:
    """Every passage of an eigenvalue through the imaginary axis up to a flow speed.

    None is missed between samples: see `pipedyn.crossing`. A pipe that is unstable from the smallest
    flow on has passages at speed 0, one for each mode that leaves the axis there.

    Args:
        model: chain, reduced model or `Continuum`, up to 2,000 degrees of freedom.
        max_speed: end of the search, > 0.

    Returns:
        Passages in order of speed, flutter and divergence.

    Raises:
        NotConverged: if the passages found do not account for the unstable roots, or the continuous
            pipe's do not stand still as the basis grows.
        ValueError, TypeError: for bad arguments.
    """
    _check_model(model)
    max_speed = _check.real("max_speed", max_speed, low=0.0, high=LARGEST_SPEED, open_low=True)
    found, _, _ = _swept(model, max_speed, None)
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
    _check_model(model)
    max_speed = _check.real("max_speed", max_speed, low=0.0, high=LARGEST_SPEED, open_low=True)
    for end in _windows(max_speed):
        found, size, moved = _swept(model, end, _destabilises)
        critical = _first_destabilising(found)
        if critical is not None:
            return _critical(model, found, critical, size, moved, max_speed)
    raise NoCrossing(f"no loss of stability up to u = {max_speed:g}", max_speed)


def _windows(max_speed: float) -> list[float]:
    """Ends of growing searches from rest: a low critical speed needs no large model."""
    return [end for end in (12.0, 30.0, 60.0) if end < max_speed] + [max_speed]


def _destabilises(passage: Passage) -> bool:
    return passage.change > 0


def _first_destabilising(found: tuple[Crossing, ...]) -> Crossing | None:
    return next((crossing for crossing in found if crossing.destabilising), None)


def _critical(
    model: AnyModel,
    found: tuple[Crossing, ...],
    crossing: Crossing,
    size: int,
    moved: float | None,
    max_speed: float,
) -> CriticalSpeed:
    own = isinstance(model, Chain) and not model.approximates_pipe
    return CriticalSpeed(
        speed=crossing.speed,
        frequency=crossing.frequency,
        kind=crossing.kind,
        error=crossing.error,
        mode=crossing.mode,
        stable_at_rest=found[0].unstable_before == 0,
        sensitivity=crossing.sensitivity,
        size=size,
        pipe=model.pipe,
        _approximates=not own,
        _continuous=None if moved is None else crossing.error,
        _max_speed=max_speed,
    )


def _swept(
    model: AnyModel, max_speed: float, until: Callable[[Passage], bool] | None
) -> tuple[tuple[Crossing, ...], int, float | None]:
    """Crossings, the size they were computed with, and how far the last growth moved them."""
    if not isinstance(model, Continuum):
        if model.dof > LARGEST_SWEEP:
            raise ValueError(
                f"model must have at most {LARGEST_SWEEP} degrees of freedom for crossings, got {model.dof}"
            )
        return _crossings(model, _sweep(model, max_speed, until)), model.dof, None

    settled = model.settle(
        lambda rom: _crossings(rom, _sweep(rom, max_speed, until, (3 * rom.dof) // 5)),
        _difference,
        smallest=max(16, 4 * math.ceil(0.2 * max_speed) + 8),
    )
    moved = settled.error
    found = tuple(
        Crossing(**{**c.__dict__, "error": c.error + moved * max(c.speed, 1e-300)})
        for c in settled.value
    )
    return found, settled.size, moved


def _sweep(
    model: Model,
    max_speed: float,
    until: Callable[[Passage], bool] | None,
    trusted: int | None = None,
) -> Sweep:
    """Passages of one model.

    Of a long chain only as many modes are followed as can meet the flow: a mode of wave number k
    does where k is comparable to u. With modes up to k = pi u and twelve more there is room, and if a
    root beyond that turns unstable, more are followed.
    """
    pencil = pencil_of(model)
    followed: int | None = None
    if isinstance(pencil, BandPencil):
        followed = 12 + math.ceil(max_speed)
    while True:
        if followed is not None and (followed > pencil.dof // 4 or max_speed > pencil.dof / 4):
            pencil, followed = DensePencil(model), None
        kind = CirculatoryHunt if pencil.velocity_free(1.0) else Hunt
        try:
            with one_thread(rows_of(pencil)):
                return kind(pencil, max_speed, followed, trusted).run(until)
        except Untracked:
            assert followed is not None
            followed *= 2


def _difference(a: tuple[Crossing, ...], b: tuple[Crossing, ...]) -> float:
    """Largest relative change of a speed; infinite where the passages differ in kind or number."""
    if [(c.kind, c.destabilising, c.mode) for c in a] != [
        (c.kind, c.destabilising, c.mode) for c in b
    ]:
        # Without flow every mode leaves the axis, and a larger model has more of them.
        a, b = (tuple(c for c in found if c.speed > 0.0 or c.mode == 1) for found in (a, b))
        if [(c.kind, c.destabilising, c.mode) for c in a] != [
            (c.kind, c.destabilising, c.mode) for c in b
        ]:
            return math.inf
    pairs = zip(a, b, strict=True)
    return max(
        (abs(x.speed - y.speed) / y.speed if y.speed else 0.0 for x, y in pairs), default=0.0
    )


def _crossings(model: Model, swept: Sweep) -> tuple[Crossing, ...]:
    found = []
    unstable = swept.unstable_at_rest
    for passage in swept.passages:
        after = unstable + passage.change
        found.append(
            Crossing(
                speed=passage.speed,
                frequency=abs(passage.value.imag),
                kind="flutter" if passage.value.imag else "divergence",
                unstable_before=unstable,
                unstable_after=after,
                error=passage.error,
                mode=passage.mode,
                sensitivity=_sensitivity(model, passage),
            )
        )
        unstable = after
    return tuple(found)


def _sensitivity(model: Model, passage: Passage) -> Sensitivity | None:
    """From left and right eigenvectors: along P(i omega, u; p) x = 0 with Re lambda held at 0,

    du/dp = -Re lambda_p / Re lambda_u and domega/dp = Im(lambda_p + lambda_u du/dp).
    """
    pair, slope = passage.pair, passage.slope
    if pair is None or slope is None or pair.left is None:
        return None
    pencil = pencil_of(model)
    pipe, u, value = model.pipe, passage.speed, passage.value
    x, y = pair.right, pair.left
    down = complex(pencil.derivative(u, np.array([value]), x, y)[0])

    def moved(rows: Any) -> complex:
        """d lambda / dp from (dP/dp) x."""
        return -complex(np.sum(y.conj() * rows)) / down

    def split(change: Any) -> tuple[Any, Any]:
        speed = -np.real(change) / slope.real
        frequency = np.imag(change + slope * speed) if passage.value.imag else 0.0 * speed
        return speed, frequency

    none: tuple[float | None, float | None] = (None, None)
    beta = split(moved(value * u * pencil.velocity(x) / (2.0 * pipe.beta))) if pipe.beta else none
    gamma = split(moved(pencil.gravity(x)))
    damping = split(moved(value * pencil.elastic * x))
    alpha = (0.0, 0.0)
    if pipe.flow == "aspirating":
        alpha = split(moved(u**2 * pencil.flux(x)))
    springs: tuple[Array | None, Array | None] = (None, None)
    if isinstance(model, Chain):
        scale = model.elastic_scale**2 * (1.0 + pipe.damping * value)
        springs = split(-(y[:, 0].conj() * scale * x[:, 0]) / down)
    speed, frequency = (
        Derivatives(
            beta=None if beta[i] is None else float(beta[i]),
            gamma=float(gamma[i]),
            damping=float(damping[i]),
            alpha=float(alpha[i]),
            springs=springs[i],
        )
        for i in (0, 1)
    )
    return Sensitivity(speed, frequency)


# ------------------------------------------------------------------------------ stability curve


@dataclass(frozen=True)
class Failure:
    """A point of a sweep that could not be computed.

    Attributes:
        index: its place in the sweep.
        value: the parameter there.
        error: what was raised.
    """

    index: int
    value: float
    error: Exception


@dataclass(frozen=True)
class StabilityCurve:
    """Critical speed, and every passage, against a parameter.

    Attributes:
        values: the parameter, shape (S,).
        critical: CriticalSpeed at each value, None where there is none or the point failed.
        crossings: passages at each value; those up to the critical speed where no max_speed was
            asked for; empty where the point failed.
        failures: the points that failed, with what they raised.
    """

    values: Array
    critical: tuple[CriticalSpeed | None, ...] = field(repr=False)
    crossings: tuple[tuple[Crossing, ...], ...] = field(repr=False)
    failures: tuple[Failure, ...]

    @property
    def speeds(self) -> Array:
        """Critical speeds, shape (S,), NaN where there is none."""
        return np.array([math.nan if c is None else c.speed for c in self.critical])

    @property
    def frequencies(self) -> Array:
        """Critical frequencies, shape (S,), NaN where there is none."""
        return np.array([math.nan if c is None else c.frequency for c in self.critical])


def stability_curve(
    make_model: Callable[[float], AnyModel],
    values: ArrayLike,
    max_speed: float | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> StabilityCurve:
    """Critical speed against any parameter.

    Args:
        make_model: the model at a value of the parameter; called in this process, so a lambda will
            do.
        values: the parameter, shape (S,).
        max_speed: collect every passage up to this speed; without it the search ends at the
            critical speed.
        executor: a `concurrent.futures.Executor` that takes the points.
        progress: show progress on stderr.

    Returns:
        StabilityCurve; a point that fails is recorded in `failures` and the others are kept. A pipe
        that stays stable is no failure if max_speed is given.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    if not callable(make_model):
        raise TypeError(
            f"make_model must be a function of the parameter, got {_check.shown(make_model)}"
        )
    at = _check.array("values", values, longest=100_000)
    if max_speed is not None:
        max_speed = _check.real("max_speed", max_speed, low=0.0, high=LARGEST_SPEED, open_low=True)
    if executor is not None and not hasattr(executor, "submit"):
        raise TypeError(
            f"executor must be a concurrent.futures.Executor, got {_check.shown(executor)}"
        )
    shown = _check.flag("progress", progress)

    failures: list[Failure] = []
    critical: list[CriticalSpeed | None] = [None] * at.size
    found: list[tuple[Crossing, ...]] = [()] * at.size
    points: list[tuple[int, AnyModel]] = []
    for i, value in enumerate(at):
        try:
            model = make_model(float(value))
            _check_model(model)
            points.append((i, model))
        except Exception as error:
            failures.append(Failure(i, float(value), error))

    for i, outcome in track(
        _outcomes(points, max_speed, executor), len(points), "stability curve", shown
    ):
        if isinstance(outcome, Exception):
            failures.append(Failure(i, float(at[i]), outcome))
        else:
            critical[i], found[i] = outcome
    failures.sort(key=lambda failure: failure.index)
    return StabilityCurve(at, tuple(critical), tuple(found), tuple(failures))


Point = tuple[CriticalSpeed | None, tuple[Crossing, ...]]


def _outcomes(
    points: list[tuple[int, AnyModel]], max_speed: float | None, executor: Executor | None
) -> Iterable[tuple[int, Point | Exception]]:
    if executor is None:
        for i, model in points:
            yield i, _outcome(lambda model=model: _point(model, max_speed))  # type: ignore[misc]
        return
    tasks = []
    for i, model in points:
        tasks.append((i, executor.submit(_point, model, max_speed)))
    for i, task in tasks:
        yield i, _outcome(task.result)


def _outcome(get: Callable[[], Point]) -> Point | Exception:
    try:
        return get()
    except Exception as error:
        return error


def _point(model: AnyModel, max_speed: float | None) -> Point:
    """What a stability curve keeps of one model."""
    if max_speed is None:
        for end in _windows(100.0):
            found, size, moved = _swept(model, end, _destabilises)
            crossing = _first_destabilising(found)
            if crossing is not None:
                return _critical(model, found, crossing, size, moved, 100.0), found
        raise NoCrossing("no loss of stability up to u = 100", 100.0)
    found, size, moved = _swept(model, max_speed, None)
    crossing = _first_destabilising(found)
    if crossing is None:
        return None, found
    return _critical(model, found, crossing, size, moved, max_speed), found


def _check_model(model: Any) -> None:
    if not isinstance(model, Model | Continuum):
        raise TypeError(f"model must be a Chain, Galerkin or Continuum, got {_check.shown(model)}")


__all__ = [
    "Crossing",
    "CriticalSpeed",
    "Derivatives",
    "Failure",
    "Galerkin",
    "ModeShape",
    "Modes",
    "NoCrossing",
    "RootLoci",
    "Sensitivity",
    "StabilityCurve",
    "critical_speed",
    "crossings",
    "eigenvalues",
    "modes",
    "root_loci",
    "stability_curve",
]
