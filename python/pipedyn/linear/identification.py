# SPDX-License-Identifier: MIT
"""Identification of a pipe's numbers from measurements, with their uncertainties.

Least squares of (model - measured) / uncertainty in the logarithms of the unknown numbers, within
bounds, from several starts. The model is the small motion of the continuous pipe, whose predictions
are precise enough for derivatives by differences.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal, Self, get_args

import numpy as np
import scipy

from pipedyn.linear.critical_speed import CriticalSpeed, critical_speed
from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.loci import branches_followed
from pipedyn.models.base import Model
from pipedyn.models.continuum import Continuum, checked_model
from pipedyn.models.pipe import Pipe, checked_pipe
from pipedyn.models.pipe_numbers import checked_number, unit_of_number
from pipedyn.models.scales import Scales
from pipedyn.models.supports import RootSpring
from pipedyn.models.terms import converted
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged, PipedynError, warn_of_number, warn_of_plane
from pipedyn.util.parallel import one_thread, track
from pipedyn.util.result import TableResult

MeasuredQuantity = Literal[
    "frequency", "decay_rate", "decrement", "critical_speed", "critical_frequency"
]

STIFFNESS, COMPLIANCE = "bending_stiffness", "clamp_compliance"

RANGES_OF_ZERO = {"damping": (1e-6, 1.0), "hysteresis": (1e-5, 1.0), COMPLIANCE: (1e-5, 10.0)}
"""Default nondimensional bounds of unknowns that are 0 in the given pipe."""

AROUND = 30.0
"""Default factor by which an unknown may differ from its value in the given pipe."""

LOG_STEP = 1e-6
"""Step of the logarithms in differences of predictions: terms of second order then leave relative
errors of 4e-7 in derivatives, and the rounding of predictions less."""

JUMP = 0.01
"""Largest difference of derivatives from both sides, as a share of the largest derivative."""

FUNCTIONS = (16, 24, 36, 54)
"""Numbers of functions of the model, tried in turn until the predictions no longer change."""

MOST_SPEED = 55.0
"""Largest u at which modes are computed. A flow of u = 1.25 (FUNCTIONS[-1] - 8) bends the pipe into
the shortest waves that the largest model can represent."""

SCANNED = 24
"""Number of values of each unknown in a scan of all ranges and on lines, which show where to
search."""

MOST_SEARCHES, REPEATS, MOST_LINES = 12, 8, 4
"""Largest number of searches from a scan of all ranges, which end when so many of them have come to
an optimum once more; and largest number of optima from which lines lead on. All optima of 24 random
problems are then found; with 16 values, 8 searches and 4 repeats, four of 12 of them lacked one."""

NARROWED = 4
"""Number of times that an interval of a line is narrowed before a search begins in it: three lead
beyond the kinks in three of the problems."""

SAME_OPTIMUM = 0.02
"""Largest difference of logarithms of one optimum found twice: uncertainties are seldom less."""

SCOUT, PRECISE = 1e-3, 1e-12
"""Relative tolerances of searches for optima, and of the optima themselves."""

RULED_OUT = 0.01
"""Chance at which measurements of the best pipe fit it better than another by as much as they do,
below which the other is ruled out."""

MOST_TRIALS = 40
"""Largest number of pipes tried from one start; searches that find an optimum try 5 to 30."""

RESOLVED_CHANGE = 0.02
"""Largest change of a prediction in a larger model, as a share of its uncertainty."""

UNDETERMINED = 1.0
"""Standard deviation of a combination of logarithms, here a factor of e, beyond which measurements
do not determine it: the linear law of errors does not apply there."""

WEAKLY_DETERMINED = 0.3
"""Relative uncertainty beyond which an estimate comes with a warning."""

LEAST_TURN = 1e-3
"""Least divisor of a decrement: Im lambda as a share of |lambda|. The search may pass through pipes
whose mode does not oscillate and so has no decrement."""

HIGHEST_MODE = 20
"""Number of the highest mode that a measurement may name."""


@saved_as("NotIdentifiable")
class NotIdentifiable(PipedynError):
    """The measurements do not determine the unknowns."""


@saved_as("Measurement", added=("across",))
@dataclass(frozen=True)
class Measurement:
    """One measured number, in SI units for a pipe made with `Pipe.from_si`, else nondimensional.

    Attributes:
        quantity: "frequency" of a mode, in Hz (nondimensional: angular, 1 / T); "decay_rate", minus
            the real part of its eigenvalue, in 1/s (1 / T); "decrement", the logarithm of the ratio
            of two maxima one period apart; "critical_speed" in m/s (u); or "critical_frequency",
            the frequency at the onset of flutter, in Hz (1 / T).
        value: measured value of the quantity.
        uncertainty: standard deviation of the value, > 0, in the same unit.
        speed: flow speed at which a mode was measured, in m/s (u).
        mode: number of the mode, from 1, counted at rest by frequency.
        across: whether the mode moves across the plane in which the pipe rests bent, not in it;
            modes of both planes are counted apart.

    Raises:
        ValueError, TypeError: for arguments out of range or of a wrong type.

    Example:
        >>> first = pp.Measurement("frequency", 2.31, 0.02)
        >>> first.speed, first.mode, first.across
        (0.0, 1, False)
    """

    quantity: MeasuredQuantity
    value: float
    uncertainty: float
    speed: float = 0.0
    mode: int = 1
    across: bool = False

    def __post_init__(self) -> None:
        check.flag("across", self.across)
        check.choice("quantity", self.quantity, get_args(MeasuredQuantity))
        signed = self.quantity in ("decay_rate", "decrement")
        vars(self).update(
            value=check.real("value", self.value, low=-1e9 if signed else 0.0, high=1e9),
            uncertainty=check.real(
                "uncertainty", self.uncertainty, low=0.0, high=1e9, open_low=True
            ),
            speed=check.real("speed", self.speed, low=0.0, high=1e6),
            mode=check.count("mode", self.mode, low=1, high=HIGHEST_MODE),
        )
        if self.uncertainty > abs(self.value) > 0.0:
            warn_of_number(
                f"uncertainty is {self.uncertainty:.4g}, more than the value, {self.value:.4g}: in "
                "its unit, not in per cent?"
            )
        if self.speed and self.quantity.startswith("critical"):
            raise ValueError(f"speed must be left out of a {self.quantity}, got {self.speed:g}")
        if self.across and self.quantity.startswith("critical"):
            raise ValueError(f"across must be left out of a {self.quantity}, got True")


@saved_as("Identification", added=("alternatives",))
class Identification(TableResult):
    """Numbers of a pipe estimated from measurements.

    If the pipe has scales, all values are in SI units: the bending stiffness in N m^2, damping in
    s, the clamp's compliance in rad/(N m) and the numbers of terms in their units; `units` names
    them.

    Attributes:
        unknowns: names of the U unknowns.
        values: estimates, shape (U,).
        uncertainties: standard deviations, shape (U,); NaN for an estimate at the end of its range,
            and for all estimates if there are `alternatives`.
        covariance: covariance of the estimates, shape (U, U); NaN where it is not known.
        correlation: covariance divided by both uncertainties, shape (U, U).
        predicted: measured quantities as predicted for the estimated pipe, shape (M,).
        residuals: (measured - predicted) / uncertainty, shape (M,).
        chi_squared: sum of the squared residuals, which is about `freedom` if the model and the
            uncertainties are right.
        freedom: number of measurements less the number of unknowns within their ranges; an estimate
            at the end of its range is not counted.
        condition: condition number of the derivatives by the logarithms of the unknowns, in units
            of the measurements' uncertainties.
        warnings: sentences to read before the estimates are used.
        critical_speed: predicted flow speed at which the pipe loses stability, in m/s (u); NaN with
            one of the `warnings` if none is found.
        critical_speed_uncertainty: standard deviation of that speed due to the uncertainties of the
            unknowns only.
        pipe: the pipe with the estimated numbers.
        measurements: the measurements, as given.
        alternatives: estimates of other pipes that explain the measurements about as well, (U,)
            each: at the best pipe, chance alone would make a difference of chi-squared as large as
            theirs in more than 1 % of all cases. Empty if none was found. Ranges that hold only one
            of the pipes, or other measurements, tell which one is right.
    """

    unknowns: tuple[str, ...]
    values: Array
    uncertainties: Array
    covariance: Array = field(repr=False)
    correlation: Array = field(repr=False)
    predicted: Array = field(repr=False)
    residuals: Array = field(repr=False)
    chi_squared: float
    freedom: int
    condition: float = field(repr=False)
    warnings: tuple[str, ...]
    critical_speed: float
    critical_speed_uncertainty: float
    pipe: Pipe = field(repr=False)
    measurements: tuple[Measurement, ...] = field(repr=False)
    alternatives: tuple[Array, ...] = field(default=(), repr=False)

    @property
    def units(self) -> dict[str, str]:
        """Units of the unknowns and of the critical speed; empty for a nondimensional pipe."""
        units = {name: _unit_text(name, self.pipe) for name in self.unknowns}
        speeds = dict.fromkeys(("critical_speed", "critical_speed_uncertainty"), "m/s")
        return {} if self.pipe.scales is None else units | speeds

    def in_si(self, pipe: Any = None) -> Self:
        """The result itself if its pipe has scales: it is in SI units already, see `units`."""
        if self.pipe.scales is None:
            return super().in_si(pipe)
        self._known_scales(pipe)
        return self

    def _shown(self) -> dict[str, Any]:
        units = self.units

        def named(name: str) -> str:
            return f"{name} ({units[name]})" if units.get(name) else name

        shown = super()._shown() | {"unknowns": tuple(map(named, self.unknowns))}
        return {named(name): value for name, value in shown.items()}

    def _columns(self) -> dict[str, Any]:
        units = [_unit_text(name, self.pipe) for name in self.unknowns]
        columns = {"unknown": self.unknowns, "value": self.values}
        return columns | {"uncertainty": self.uncertainties, "unit": units}


def identify(
    pipe: Pipe,
    measurements: Sequence[Measurement],
    unknowns: Sequence[str] | Mapping[str, tuple[float, float]],
    *,
    dimensions: Literal[2, 3] = 2,
    progress: bool = False,
) -> Identification:
    """Estimates numbers of a pipe from measured frequencies, decay rates and critical speeds.

    Args:
        pipe: the pipe with its known numbers. The search begins at its values of the unknowns.
        measurements: measured numbers, at least as many as unknowns.
        unknowns: names, or bounds (low, high) by name. Names are "bending_stiffness" (for a pipe
            made with `from_si`), "clamp_compliance" (one over the stiffness of a `RootSpring`), and
            the numbers of the pipe that `boundary` accepts, such as "damping", "hysteresis",
            "Viscosity.sigma" or "Spring.stiffness". By default an unknown may differ by a factor of
            30 from the pipe's value, within the range that the number has.
        dimensions: 3 if the pipe may also move across the plane in which a load bends it, where it
            may flutter first; measurements `across` that plane need it.
        progress: whether to show progress on stderr: of the scan, of the lines on which one unknown
            takes all values, and of the searches.

    Returns:
        Identification with the estimates, their uncertainties and warnings. Several pipes may
        explain the measurements. Searches therefore begin at the given pipe, where a scan of 24
        values of each unknown points to a small misfit, and where one unknown at a time takes the
        values of its range. All pipes found that the measurements do not rule out are told. That
        all are found is likely and not certain: they were in 24 random problems with one to
        three unknowns that have two or three such pipes by grids of 200 to 1600 points with
        searches. One may be missed if its misfit is small only within less than about 1/24 of the
        ranges of the logarithms. Pipes of which all unknowns agree to 2 % are told as one. Where
        measurements hardly determine a combination of unknowns, several pipes of one curved valley
        may be told.

    Example:
        >>> pipe = pp.Pipe.from_si(
        ...     length=0.45, bending_stiffness=8e-3, pipe_mass=0.19, fluid_mass=0.032
        ... )
        >>> measured = [
        ...     pp.Measurement("frequency", 1.014, 0.01),
        ...     pp.Measurement("frequency", 3.58, 0.03, mode=2),
        ...     pp.Measurement("decrement", 0.05, 0.005),
        ... ]
        >>> found = pp.identify(pipe, measured, ["bending_stiffness", "damping"])
        >>> found.freedom, found.alternatives
        (1, ())
        >>> found.units["bending_stiffness"]
        'N m^2'

    Raises:
        NotIdentifiable: if the measurements do not determine the unknowns; the message names the
            combination that is not determined.
        NoCrossing: if a measured critical speed has no counterpart in the model.
        NotConverged: if the model's predictions still change in the largest model.
        ValueError, TypeError: for arguments out of range or of a wrong type.

    Source: Nocedal and Wright (2006), Numerical optimization, ch. 10, for least squares.
    Uncertainties follow from those of the measurements by the linear law of errors.
    """
    shown = check.flag("progress", progress)
    known = _checked_problem(pipe, measurements, unknowns, dimensions, shown)
    if not known.given.rests_straight and dimensions == 2:
        warn_of_plane(__name__)
    with one_thread(max(FUNCTIONS)):
        optima = known.searched(FUNCTIONS[0])
        for size in FUNCTIONS:
            optima = known.optima(optima, size, PRECISE)
            moved = [known.moved(x, size) for x in optima]
            if max(moved) <= RESOLVED_CHANGE:
                break
        if moved[0] > RESOLVED_CHANGE:
            raise NotConverged(
                f"with {size} functions a prediction still moves by {moved[0]:.2g} of its "
                "uncertainty"
            )
        return known.estimated(optima, size)


@dataclass(frozen=True)
class _Unknown:
    """A number of the pipe that is estimated."""

    name: str
    low: float  # bounds, in the units of users
    high: float

    def put(self, pipe: Pipe, value: float) -> Pipe:
        """The pipe with this number set to a value in the units of users."""
        if self.name == STIFFNESS:
            return _with_stiffness(pipe, value)
        one = value / _unit(self.name, pipe)
        if self.name == COMPLIANCE:
            spring = pipe.root if isinstance(pipe.root, RootSpring) else RootSpring(1.0)
            return replace(pipe, root=replace(spring, stiffness=1.0 / one))
        return checked_number("unknowns", self.name, pipe, others=()).changed(pipe, one)


def _unit(name: str, pipe: Pipe) -> float:
    """Value, in the units of users, of the nondimensional unit of an unknown."""
    if pipe.scales is None:
        return 1.0
    length, mass, time = pipe.scales[:3]
    if name == STIFFNESS:
        return mass * length**4 / time**2
    if name == COMPLIANCE:
        return time**2 / (mass * length**3)
    unit = unit_of_number(name, pipe)
    return 1.0 if unit is None else float(unit.scale(pipe.scales))


def _unit_text(name: str, pipe: Pipe) -> str:
    """The unit of an unknown in the units of users; empty if it has none."""
    if pipe.scales is None:
        return ""
    if name in (STIFFNESS, COMPLIANCE):
        return "N m^2" if name == STIFFNESS else "rad N^-1 m^-1"
    unit = unit_of_number(name, pipe)
    return "" if unit is None else unit.name


def _speed_unit(pipe: Pipe) -> float:
    """Value, in the units of users, of the nondimensional unit of flow speed."""
    return 1.0 if pipe.scales is None else pipe.scales.speed


def _with_stiffness(pipe: Pipe, value: float) -> Pipe:
    """The pipe with another bending stiffness, and all other numbers the same in SI units."""
    old = pipe.scales
    assert old is not None
    slower = math.sqrt(_unit(STIFFNESS, pipe) / value)  # factor on the unit of time
    change = Scales(1.0, 1.0, slower, 1.0 / slower)  # factors on all units
    root = pipe.root
    return replace(
        pipe,
        gamma=pipe.gamma * slower**2,
        damping=pipe.damping / slower,
        terms=tuple(converted(term, change, operator.truediv) for term in pipe.terms),
        root=converted(root, change, operator.truediv) if isinstance(root, RootSpring) else root,
        scales=old._replace(time=old.time * slower, speed=old.speed / slower),
    )


def _checked_problem(
    pipe: Pipe, measurements: Any, unknowns: Any, dimensions: Any, shown: bool
) -> _Problem:
    """The problem given by the arguments of `identify`; raises errors for bad arguments."""
    pipe = checked_pipe(pipe)
    check.instance("measurements", measurements, list | tuple, "a list of Measurement")
    if not measurements:
        raise ValueError("measurements must have at least one Measurement, got none")
    for i, one in enumerate(measurements):
        check.instance(f"measurements[{i}]", one, Measurement, "a Measurement")
        if one.across and (dimensions == 2 or pipe.rests_straight):
            raise ValueError(
                f"measurements[{i}].across must be False unless dimensions=3 and a load bends the "
                f"pipe, got {one!r}"
            )
    Continuum(pipe, dimensions)  # refuses what has no equations in these
    check.instance("unknowns", unknowns, list | tuple | Mapping, "a list of names")
    names = list(unknowns)
    if not names:
        raise ValueError("unknowns must have at least one name, got none")
    if len(set(map(str, names))) < len(names):
        raise ValueError(f"unknowns must differ, got {names!r}")
    found, begin = list[_Unknown](), list[float]()
    for name in names:
        bounds = unknowns[name] if isinstance(unknowns, Mapping) else None
        one, value = _unknown(pipe, name, bounds)
        found.append(one)
        begin.append(min(max(value, one.low), one.high))
    problem = _Problem(pipe, tuple(measurements), tuple(found), np.log(begin), dimensions, shown)
    unit = _speed_unit(problem.pipe(problem.begin))
    for i, given in enumerate(measurements):
        if given.speed > MOST_SPEED * unit:
            word = "" if unit == 1.0 else f", {given.speed / unit:.3g} in units of the pipe"
            raise ValueError(
                f"measurements[{i}].speed must be at most {MOST_SPEED * unit:.4g}, "
                f"got {given.speed:g}{word}"
            )
    if len(measurements) < len(found):
        few = check.how_many(len(measurements), "measurement")
        raise NotIdentifiable(f"{few} cannot tell {len(found)} unknowns")
    return problem


def _unknown(pipe: Pipe, name: Any, bounds: Any) -> tuple[_Unknown, float]:
    """An unknown, and the value at which its search begins."""
    if name == STIFFNESS and pipe.scales is None:
        raise ValueError(
            "unknowns must not have 'bending_stiffness' of a nondimensional pipe, which is counted "
            "in it: make the pipe with Pipe.from_si"
        )
    if name in ("clamp_stiffness", "root_stiffness"):
        raise ValueError(
            f"unknowns must have 'clamp_compliance' instead of {name!r}, one over that, which is 0 "
            "of a rigid clamp"
        )
    rule: dict[str, Any] = {"high": math.inf}
    if name == COMPLIANCE:
        stiffness = pipe.root_stiffness
        if stiffness == 0.0:
            raise ValueError("unknowns must not have 'clamp_compliance' where the root is a hinge")
        value = 1.0 / stiffness
    elif name == STIFFNESS:
        value = 1.0
    else:
        number = checked_number("unknowns", name, pipe, others=(STIFFNESS, COMPLIANCE))
        value, rule = number.of(pipe), number.rule
        if number.name in ("beta", "gamma", "alpha") and pipe.scales is not None:
            raise ValueError(
                f"unknowns must not have {name!r} of a pipe made with Pipe.from_si: its masses and "
                "lengths are given"
            )
    unit = _unit(name, pipe)
    most = rule["high"] * unit
    if name == "beta" and pipe.mass is not None:
        most = min(most, pipe.mass.bounds[0])  # of which it is a part
    if bounds is not None:
        within = {"low": 0.0, "high": most, "open_low": True}
        within["open_high"] = rule.get("open_high", False)
        low, high = check.array(f"unknowns[{name!r}]", bounds, size=2, **within)
        if not low < high:
            raise ValueError(f"unknowns[{name!r}] must be (low, high), got ({low:g}, {high:g})")
    elif value > 0.0:
        low, high = value / AROUND * unit, min(value * AROUND * unit, most * (1.0 - 1e-9))
    elif name in RANGES_OF_ZERO:
        low, high = (unit * one for one in RANGES_OF_ZERO[name])
    else:
        raise ValueError(
            f"unknowns must give bounds (low, high) of {name!r}, which the pipe has at {value:g}"
        )
    one = _Unknown(name, float(low), float(high))
    begin = value * unit if value > 0.0 else math.sqrt(low * high)
    for end in (one.low, one.high):  # raises an error for a bad range before the search
        one.put(pipe, end)
    return one, begin


class _FoundBefore(Exception):
    """A search has come to an optimum that is known."""


@dataclass(frozen=True)
class _Problem:
    """A least-squares problem in x, the logarithms of the unknowns, shape (U,)."""

    given: Pipe
    measurements: tuple[Measurement, ...]
    unknowns: tuple[_Unknown, ...]
    begin: Array
    dimensions: Literal[2, 3]
    shown: bool  # whether progress is shown

    @property
    def bounds(self) -> Array:
        """Lowest and highest x, shape (2, U)."""
        return np.log([[one.low for one in self.unknowns], [one.high for one in self.unknowns]])

    def pipe(self, x: Array) -> Pipe:
        """The pipe with the unknowns exp(x)."""
        pipe = self.given
        # The stiffness is set first, since it changes the units of the others.
        pairs = list(zip(self.unknowns, np.exp(x).tolist(), strict=True))
        for one, value in sorted(pairs, key=lambda pair: pair[0].name != STIFFNESS):
            pipe = one.put(pipe, value)
        return pipe

    def searched(self, size: int) -> list[Array]:
        """The optima that searches from several x find, as `optima` has them."""
        found, seen = self.optima(self.starts(size), size, SCOUT, REPEATS), list[Array]()

        def is_new(x: Array) -> bool:
            return all(float(np.abs(x - y).max()) > SAME_OPTIMUM for y in seen)

        while len(seen) < MOST_LINES and (new := [*filter(is_new, found)]):
            seen.append(new[0])
            found = self.optima([*found, *self.beside(new[0], size)], size, SCOUT)
        return found

    def starts(self, size: int) -> list[Array]:
        """The x of the given pipe, and others to which an even scan points.

        A linear law through the residuals of a pipe of the scan and of its nearest tells where near
        it the misfit is least. The pipes are kept for which it is less than for their nearest.
        """
        low, high = self.bounds
        many = low.size
        even = (np.arange(SCANNED * many) + 0.5) / (SCANNED * many)  # values of each unknown
        scan = np.random.default_rng(0).permuted(np.tile(even, (many, 1)), axis=1).T
        pipes = track(low + (high - low) * scan, len(scan), "scan of the ranges", self.shown)
        every = np.array([self.residuals(x, size) for x in pipes])
        known = np.isfinite(every).all(axis=1)
        scan, every = scan[known], every[known]
        apart = np.linalg.norm(scan[:, None] - scan, axis=2)
        near = np.argsort(apart, axis=1)[:, 1 : 2 * many + 1]
        squares = np.full(len(scan), math.inf)
        ends = scan.copy()
        for i, others in enumerate(near if near.size else ()):
            weights = 1.0 / apart[i, others, None] ** 2
            sides = (scan[others] - scan[i]) * weights, (every[others] - every[i]) * weights
            law = np.linalg.lstsq(*sides)[0]
            step = np.linalg.lstsq(law.T, -every[i])[0]
            step *= min(1.0, apart[i, others[-1]] / max(float(np.linalg.norm(step)), 1e-300))
            ends[i] = np.clip(scan[i] + step, 0.0, 1.0)
            squares[i] = np.sum((every[i] + (ends[i] - scan[i]) @ law) ** 2)
        best = np.flatnonzero(squares < squares[near].min(axis=1, initial=math.inf))
        chosen = best[np.argsort(squares[best])][:MOST_SEARCHES]
        return [self.begin, *(low + (high - low) * ends[chosen])]

    def beside(self, x: Array, size: int) -> list[Array]:
        """The x of least misfit where one unknown at a time takes all values, but x itself.

        Residuals are taken to be linear between values, so that one which changes its sign vanishes
        there. They may have a kink, where a mode ceases to oscillate: intervals are narrowed, too.
        """
        found = list[Array]()
        lines = track(self.bounds.T, x.size, "lines from an optimum", self.shown)
        for i, (low, high) in enumerate(lines):
            line, step = np.tile(x, (SCANNED, 1)), (high - low) / (SCANNED - 1)
            line[:, i] = np.linspace(low, high, SCANNED)
            every = np.array([self.residuals(one, size) for one in line])
            part, squares = _least_between(every[:-1], every[1:])
            padded = np.pad(squares, 1, constant_values=math.inf)
            best = (squares <= padded[:-2]) & (squares < padded[2:])
            best &= np.abs(line[:-1, i] + part * step - x[i]) > 0.6 * step
            for k in np.flatnonzero(best):
                (a, b), (of_a, of_b) = line[k : k + 2], every[k : k + 2]
                for turn in range(NARROWED):
                    middle = a + _least_between(of_a, of_b)[0] * (b - a)
                    new = self.residuals(middle, size)
                    if turn in (0, NARROWED - 1):
                        found.append(middle)
                    if _least_between(of_a, new)[1] < _least_between(new, of_b)[1]:
                        b, of_b = middle, new
                    else:
                        a, of_a = middle, new
        return found

    def residuals(self, x: Array, size: int) -> Array:
        """The residuals of a model of this size, NaN where there is none, shape (M,)."""
        try:
            return self.misfit(x, size)
        except PipedynError:
            return np.full(len(self.measurements), math.nan)

    def squares(self, x: Array, size: int) -> float:
        """The sum of squared residuals of a model of this size; infinite where there is none."""
        squares = float(np.sum(self.residuals(x, size) ** 2))
        return math.inf if math.isnan(squares) else squares

    def optima(
        self, starts: Sequence[Array], size: int, tolerance: float, repeats: float = math.inf
    ) -> list[Array]:
        """The least-squares x, and others to which searches lead and that are not ruled out.

        An x is not another one if pipes lead from it to a better one of which none is ruled out.
        Of equal ones, the first is the one nearest to the given pipe. Searches end when so many
        `repeats` have come to an optimum once more.
        """
        found, failed = list[tuple[float, Array]](), list[PipedynError]()
        for start in track(starts, len(starts), f"searches, {size} functions", self.shown):
            try:
                found.append(self.fitted(start, size, tolerance, [x for _, x in found]))
            except PipedynError as error:
                failed.append(error)
            except _FoundBefore:
                repeats -= 1
                if not repeats:
                    break
        if not found:
            raise failed[0]
        least = min(squares for squares, _ in found)

        def order(one: tuple[float, Array]) -> tuple[float, float]:
            return max(one[0] - least, 1e-6), float(np.linalg.norm(one[1] - self.begin))

        def apart(x: Array, y: Array) -> bool:
            line = (x + part * (y - x) for part in (0.25, 0.5, 0.75))
            return max(self.squares(one, size) for one in line) > self.limit(least)

        kept = list[Array]()
        for squares, x in sorted(found, key=order):
            if squares <= self.limit(least) and all(apart(x, y) for y in kept):
                kept.append(x)
        return kept

    def limit(self, least: float) -> float:
        """Sum of squares beyond which a pipe is ruled out, if the least is that of another."""
        allowed = scipy.special.chdtri(len(self.unknowns), RULED_OUT)
        freedom = max(len(self.measurements) - len(self.unknowns), 1)
        return float(least + allowed * max(1.0, least / freedom))  # sigmas may be too small

    def fitted(
        self, begin: Array, size: int, tolerance: float, known: Sequence[Array]
    ) -> tuple[float, Array]:
        """The sum of squares at its minimum that a search from `begin` finds, and its x.

        Raises _FoundBefore where the search comes to one of the known optima.
        """
        low, high = self.bounds
        inner = 1e-9 * (high - low)
        misfit, here = partial(self.misfit, size=size), np.zeros(0)

        def tried(x: Array) -> Array:
            nonlocal here
            # A pipe without predictions is refused at the begin; later the step is made shorter.
            here = self.residuals(x, size) if here.size else misfit(x)
            return here

        def slopes(x: Array) -> Array:
            if any(float(np.abs(x - one).max()) < SAME_OPTIMUM for one in known):
                raise _FoundBefore
            return self.slopes(misfit, x, here)  # of the x tried last

        found = scipy.optimize.least_squares(
            tried,
            np.clip(begin, low + inner, high - inner),
            jac=slopes,
            bounds=(low, high),
            xtol=tolerance,
            ftol=tolerance,
            gtol=1e-12,
            max_nfev=MOST_TRIALS,
        )
        return 2.0 * float(found.cost), np.asarray(found.x)

    def predicted(self, x: Array, size: int, measurements: Sequence[Measurement]) -> Array:
        """What a model of this size predicts for measurements, shape (M,)."""
        model = Continuum(self.pipe(x), self.dimensions).frozen(size)
        return _predicted(model, measurements)

    def misfit(self, x: Array, size: int) -> Array:
        """Residuals (predicted - measured) / uncertainty of a model of this size, shape (M,)."""
        predicted = self.predicted(x, size, self.measurements)
        measured, sigma = np.array([(one.value, one.uncertainty) for one in self.measurements]).T
        return np.asarray((predicted - measured) / sigma)

    def slopes(
        self, question: Callable[[Array], Array], x: Array, here: Array, step: float = LOG_STEP
    ) -> Array:
        """Derivatives by x of k functions of x, shape (k, U), by differences within the bounds.

        here: values of the functions at x, shape (k,).
        step: step of the differences; its sign is changed where x + step is out of bounds.
        """
        low, high = self.bounds
        steps = np.where((x + step > low) & (x + step < high), step, -step)
        columns = [(question(x + change) - here) / change.sum() for change in np.diag(steps)]
        return np.stack(columns, axis=1)

    def moved(self, x: Array, size: int) -> float:
        """Largest change of a prediction in a larger model, as a share of its uncertainty."""
        larger = size + max(8, size // 2)
        return float(np.abs(self.misfit(x, larger) - self.misfit(x, size)).max())

    def estimated(self, optima: Sequence[Array], size: int) -> Identification:
        """The estimates at the first of the optima, with their uncertainties and warnings."""
        low, high = self.bounds
        x = optima[0]
        at_end = (x - low < 1e-4) | (high - x < 1e-4)
        free = np.flatnonzero(~at_end)
        spread = np.full((x.size, x.size), math.nan)
        condition = math.inf
        misfit = partial(self.misfit, size=size)
        residuals = misfit(x)
        if free.size:
            slopes = self.slopes(misfit, x, residuals)
            jumps = np.abs(slopes - self.slopes(misfit, x, residuals, -LOG_STEP)).max(axis=1)
            if (jumps > JUMP * np.abs(slopes).max()).any():
                k = int(np.argmax(jumps))
                raise NotConverged(
                    f"the prediction for measurements[{k}] jumps near the best pipe, where roots "
                    "lie too close together to be told apart"
                )
            _, sizes, right = np.linalg.svd(slopes[:, free], full_matrices=False)
            condition = float(sizes[0] / sizes[-1]) if sizes[-1] > 0.0 else math.inf
            if not sizes[-1] * UNDETERMINED > 1.0:
                raise NotIdentifiable(self._undetermined(free, right[-1], sizes[-1]))
            spread[np.ix_(free, free)] = (right.T / sizes**2) @ right
        warnings = []
        if others := optima[1:]:
            spread[:] = math.nan
            listed = "; ".join(map(self.told, optima))
            warnings.append(
                f"{len(optima)} different pipes explain the measurements about equally well: "
                f"{listed}. Give ranges that hold only one of them, or measure something else, too"
            )
        values, relative = np.exp(x), np.sqrt(np.diag(spread))
        for i, one in enumerate(self.unknowns):
            if at_end[i]:
                at_low = x[i] - low[i] < 1e-4
                side, word = (one.low, "at most") if at_low else (one.high, "at least")
                warnings.append(
                    f"{one.name} lies at the end of its range: the measurements say that it is "
                    f"{word} about {side:.3g}, and uncertainties are those at that value"
                )
            elif relative[i] > WEAKLY_DETERMINED:
                warnings.append(f"{one.name} is known to {100.0 * relative[i]:.0f} % only")
        squares, freedom = float(residuals @ residuals), len(self.measurements) - free.size
        if not _explained_by_chance(squares, freedom):
            warnings.append(
                f"the pipe with these numbers does not explain the measurements: chi-squared is "
                f"{squares:.3g} at {check.how_many(freedom, 'degree')} of freedom. An effect is "
                "missing, a range too narrow, or the uncertainties are too small"
            )

        def onset(x: Array) -> Array:
            return self.predicted(x, size, [Measurement("critical_speed", 0.0, 1.0)])

        try:
            speed = onset(x)
            (by_x,) = self.slopes(onset, x, speed)
        except PipedynError as error:  # the measurements may have told the unknowns without it
            speed, by_x = np.full((2, x.size), math.nan)
            warnings.append(f"no critical speed is predicted: {error}")
        of_onset = by_x[free] @ spread[np.ix_(free, free)] @ by_x[free]
        return Identification(
            unknowns=tuple(one.name for one in self.unknowns),
            values=values,
            uncertainties=values * relative,
            covariance=spread * np.outer(values, values),
            correlation=spread / np.outer(relative, relative),
            predicted=self.predicted(x, size, self.measurements),
            residuals=-residuals,
            chi_squared=squares,
            freedom=freedom,
            condition=condition,
            warnings=tuple(warnings),
            critical_speed=float(speed[0]),
            critical_speed_uncertainty=math.sqrt(of_onset) if free.size else math.nan,
            pipe=self.pipe(x),
            measurements=self.measurements,
            alternatives=tuple(np.exp(other) for other in others),
        )

    def told(self, x: Array) -> str:
        """The unknowns at x in words."""
        pairs = zip(self.unknowns, np.exp(x).tolist(), strict=True)
        told = (f"{one.name} = {v:.4g} {_unit_text(one.name, self.given)}" for one, v in pairs)
        return ", ".join(map(str.rstrip, told))

    def _undetermined(self, free: Any, direction: Array, size: float) -> str:
        """A sentence naming the combination of unknowns that the measurements do not determine."""
        names = [self.unknowns[i].name for i in free]
        powers = direction / direction[int(np.argmax(np.abs(direction)))]
        parts = [
            name if abs(power - 1.0) < 0.05 else f"{name}^{power:.2g}"
            for name, power in zip(names, powers.tolist(), strict=True)
            if abs(power) > 0.05
        ]
        known = f"to a factor of {math.exp(1.0 / size):.2g}" if size > 0.1 else "not at all"
        return f"the measurements tell {' '.join(parts)} {known}: measure something else, too"


def _least_between(a: Array, b: Array) -> tuple[Array, Array]:
    """Where residuals that are linear from a to b, (..., M), have the least squares, and these.

    The place is counted from 0 at a to 1 at b; where residuals are NaN the squares are infinite.
    """
    part = -np.sum(a * (b - a), axis=-1) / np.maximum(np.sum((b - a) ** 2, axis=-1), 1e-300)
    part = np.nan_to_num(np.clip(part, 0.0, 1.0))
    squares = np.sum((a + part[..., None] * (b - a)) ** 2, axis=-1)
    return part, np.nan_to_num(squares, nan=math.inf)


def _explained_by_chance(squares: float, freedom: int) -> bool:
    """Whether chance alone exceeds a sum of squares in more than 1 % of all cases.

    Without degrees of freedom the sum has to vanish.
    """
    if not freedom:
        return squares < 1e-6
    return bool(scipy.special.chdtrc(freedom, squares) > 0.01)


def _predicted(model: Model, measurements: Sequence[Measurement]) -> Array:
    """What a model predicts for measurements, shape (M,)."""
    pipe, scales = model.pipe, model.pipe.scales
    time, turn = (1.0, 1.0) if scales is None else (scales.time, 2.0 * math.pi)
    given = [one for one in measurements if not one.quantity.startswith("critical")]
    highest = max((one.mode for one in given), default=0)
    loci = {
        speed: _roots_in_flow(model, speed / _speed_unit(pipe), highest)
        for speed in {one.speed for one in given}
    }
    onset = critical_speed(model) if len(given) < len(measurements) else None
    found = []
    for one in measurements:
        if onset is not None and one.quantity == "critical_speed":
            found.append(_speed_unit(pipe) * onset.speed)
        elif onset is not None and one.quantity == "critical_frequency":
            found.append(_onset_frequency(onset) / (turn * time))
        else:
            root = complex(loci[one.speed][int(one.across)][one.mode - 1])
            if math.isnan(root.real):
                at = one.speed / _speed_unit(pipe)
                raise NotIdentifiable(f"mode {one.mode} has no oscillation at u = {at:.4g} to tell")
            # An overdamped mode has a decrement, too.
            decrement = -2.0 * math.pi * root.real / max(root.imag, LEAST_TURN * abs(root))
            rates = {"frequency": root.imag / turn, "decay_rate": -root.real}
            found.append(rates[one.quantity] / time if one.quantity in rates else decrement)
    return np.array(found)


def _roots_in_flow(model: Model, u: float, count: int) -> list[Complex]:
    """The eigenvalues of the lowest modes at u, in the order of their frequencies at rest.

    They are those of motions in the plane of a bent rest and, in three dimensions, across it.
    """
    if u > MOST_SPEED:
        raise NotConverged(f"at u = {u:.3g} no mode is followed")
    speeds = np.linspace(0.0, u, 2 + math.ceil(u)) if u else np.zeros(1)
    found = branches_followed(checked_model(model), speeds, max(count, 2))
    roots = found.eigenvalues[-1]
    return [roots] if found.across is None else [roots[~found.across], roots[found.across]]


def _onset_frequency(onset: CriticalSpeed) -> float:
    """The frequency of an onset; NotIdentifiable if differences would not give its derivatives."""
    refused = "measurements must not have a critical_frequency of a pipe that"
    if not onset.frequency:
        raise NotIdentifiable(
            f"{refused} diverges, as the model does at u = {onset.speed:.4g}: it does not "
            "oscillate there"
        )
    assert isinstance(onset.model, Model)
    problem = eigenproblem(onset.model)
    if problem.is_conservative or problem.velocity_free(onset.speed):
        raise NotIdentifiable(
            f"{refused} loses no energy, two modes of which meet at u = {onset.speed:.4g}: "
            "what moves the frequency at which they do is not computed"
        )
    return onset.frequency
