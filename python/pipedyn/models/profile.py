# SPDX-License-Identifier: MIT
"""Bending stiffness or mass that varies along the pipe."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pipedyn import _core
from pipedyn.models.scales import repr_of
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

Along: TypeAlias = Callable[[Array], ArrayLike]
"""A function of arc lengths in L, from shape (p,) to (p,)."""

LEAST_RATIO, LARGEST_RATIO = 1e-6, 1e6
"""Range of a profile's values, far beyond that of any pipe's."""

RESOLVED = 3e-14
"""Error of a function's Chebyshev series, as a share of its largest value: rounding is less."""

NEARLY = 1e-9
"""Error near a kink of a higher derivative. The weaker the kink, the less certain is its place:
kinks of a spline's third derivative are found to 1e-5 or so."""

SMOOTH = 1e-3
"""Length over which a function is steep but smooth if polynomials of degree 8 on a 64th of it
resolve the function."""

COUNTS = (16, 32, 64, 128)
"""Lengths of the series that are tried. Stretches that need longer series are divided."""

MOST_STRETCHES = 100
"""Largest number of stretches of one profile; each is a panel of reduced models."""

SHORTEST = 1e-4
"""Shortest stretch in L, equal to a basis' shortest panel: nearer to an end a function must be
smooth."""


@saved_as("ChebyshevSeries")
@dataclass(frozen=True, repr=False)
class _Series:
    """Chebyshev coefficients of a function on one stretch."""

    coefficients: tuple[float, ...]

    def __repr__(self) -> str:
        ends = np.polynomial.chebyshev.chebval([-1.0, 1.0], self.coefficients)
        return f"<{ends[0]:.6g} to {ends[1]:.6g}>"


@saved_as("Profile")
@dataclass(frozen=True, repr=False, init=False)
class Profile:
    """A property, such as bending stiffness, that varies along the pipe and may jump.

    Functions are called only at construction and replaced by Chebyshev series, whose error is below
    rounding. So profiles of equal functions are equal, and profiles pickle.

    Attributes:
        at: arc lengths in L of jumps and kinks, ascending in (0, 1); jumps and kinks of a function
            at other places are found and added.
        values: for each stretch between these places, from the clamp on, a number or a function of
            arc lengths s, (p,) to (p,); or one function for all stretches. Each value in [1e-6,
            1e6].

    Raises:
        ValueError: for places that do not ascend in (0, 1), a number of values other than that of
            stretches, a function whose results have a wrong shape, NaN, infinity or values out of
            range, or a function that is noise or not smooth within 1e-4 of an end of a stretch.
        TypeError: for a value that is neither a number nor a function of real numbers.

    Example:
        >>> import pipedyn as pp
        >>> stepped = pp.Profile(at=[0.5], values=[1.0, 0.5])
        >>> stepped
        Profile(at=(0.5,), values=(1, 0.5))
        >>> pipe = pp.Pipe(beta=0.2, stiffness=stepped)
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        4.6868
        >>> tapered = pp.Pipe(beta=0.2, stiffness=lambda s: 1 - s / 2)
        >>> round(pp.critical_speed(pp.Continuum(tapered)).speed, 4)
        4.9931
    """

    at: tuple[float, ...]
    values: tuple[float | _Series, ...]

    def __init__(
        self,
        at: ArrayLike = (),
        values: Along | Sequence[float | Along | _Series] = (),
        *,
        name: str = "values",
    ) -> None:
        inner = check.numbers("at", at, "an array of real numbers", longest=MOST_STRETCHES)
        if inner.size:
            inner = check.array("at", at, low=0.0, high=1.0, open_low=True)
        if inner.size and (np.any(np.diff(inner) <= 0.0) or inner[-1] == 1.0):
            raise ValueError(f"at must ascend between 0 and 1, got {check.shown(at)}")
        ends = [0.0, *inner.tolist(), 1.0]
        count = len(ends) - 1
        if callable(values):
            given: Sequence[Any] = [values] * count
        elif isinstance(values, list | tuple) or (isinstance(values, np.ndarray) and values.ndim):
            given = values
        else:
            raise TypeError(
                f"{name} must be a function of arc length or a Profile, got {check.shown(values)}"
            )
        if len(given) != count:
            raise ValueError(
                f"{name} must be {count}, one for each stretch between places at, got {len(given)}"
            )
        found: list[tuple[float, float | _Series]] = []
        for k, ((low, high), value) in enumerate(zip(pairwise(ends), given, strict=True)):
            if isinstance(value, _Series):
                found.append((high, value))
            elif callable(value):
                found += _fitted(_Function(name, value), low, high)
            else:
                one = check.real(f"{name}[{k}]", value, low=LEAST_RATIO, high=LARGEST_RATIO)
                found.append((high, one))
            _refuse_many(name, len(found))
        object.__setattr__(self, "at", tuple(high for high, _ in found[:-1]))
        object.__setattr__(self, "values", tuple(value for _, value in found))

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Profile:
        """Restores the profile from the fields of a file; checks its series and their range."""
        made = cls(**fields)
        if not all(1 <= len(one) <= COUNTS[-1] for one in made.series):
            raise ValueError(f"a series must have from 1 to {COUNTS[-1]} coefficients")
        low, high = made.bounds
        missed = 10.0 * NEARLY * high  # more than the error of a series
        if not LEAST_RATIO - missed <= low <= high <= LARGEST_RATIO + missed:
            raise ValueError(
                f"values must lie in [{LEAST_RATIO:g}, {LARGEST_RATIO:g}], got {low} to {high}"
            )
        return made

    __repr__ = repr_of

    def __call__(self, s: ArrayLike) -> Array:
        """Values at arc lengths s in [0, 1], shape (p,); at a jump, the value beyond it."""
        return self.core(check.array("s", s, low=0.0, high=1.0, longest=100_000_000))

    @property
    def core(self) -> _core.Profile:
        """The profile in the core's form."""
        return _core.Profile([0.0, *self.at, 1.0], [list(one) for one in self.series])

    @property
    def series(self) -> list[tuple[float, ...]]:
        """Chebyshev coefficients on each stretch."""
        return [v.coefficients if isinstance(v, _Series) else (v,) for v in self.values]

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest value among 1,001 on each stretch."""
        x = np.linspace(-1.0, 1.0, 1001)
        each = [np.polynomial.chebyshev.chebval(x, one) for one in self.series]
        return min(float(np.min(one)) for one in each), max(float(np.max(one)) for one in each)


def reciprocal(profile: Profile) -> Profile:
    """The profile 1 / p of a profile p."""
    core = profile.core
    return Profile(profile.at, lambda s: 1.0 / core(s))


def mixed(profile: Profile, share: float) -> Profile:
    """The profile 1 - share + share p of a profile p."""
    values = [np.multiply(share, one) for one in profile.series]
    for one in values:
        one[0] += 1.0 - share
    return Profile(profile.at, [_Series(tuple(one.tolist())) for one in values])


def moments(profile: Profile, ends: Array) -> Array:
    """Moments of a profile over the intervals between ascending ends (n + 1,), shape (3, n).

    The rows are integrals of the profile times the powers 0, 1, 2 of the distance from the start of
    each interval.
    """
    cuts = np.union1d(ends, [s for s in profile.at if ends[0] < s < ends[-1]])
    # Gauss quadrature is exact for the series times the square of the distance.
    nodes, weights = _core.gauss_nodes((max(map(len, profile.series)) + 3) // 2)
    found, core = np.zeros((3, ends.size - 1)), profile.core
    for first in range(0, cuts.size - 1, 100_000):
        some = cuts[first : first + 100_001]
        lengths, start = np.diff(some)[:, None], some[:-1, None]
        s = start + lengths * nodes
        values = lengths * weights * core(s.ravel()).reshape(s.shape)
        segment = np.searchsorted(ends, some[:-1], side="right") - 1
        arms = s - ends[segment, None]
        for power in range(3):
            np.add.at(found[power], segment, np.sum(values * arms**power, axis=1))
    return found


class _Function:
    """A user's function, whose values are checked at every call."""

    def __init__(self, name: str, function: Along) -> None:
        self.name, self.function = name, function

    def __call__(self, s: Array) -> Array:
        given = np.array(s)
        rule: dict[str, Any] = {"low": LEAST_RATIO, "high": LARGEST_RATIO, "longest": s.size}
        return check.array(
            f"{self.name}(s)", values_along(self.name, self.function, given), size=s.size, **rule
        )


def _nodes(count: int) -> tuple[Array, Array]:
    """Chebyshev nodes of the first kind, and the matrix from values there to coefficients."""
    angles = (np.arange(count) + 0.5) * (np.pi / count)
    matrix = np.cos(np.arange(count)[:, None] * angles) * (2.0 / count)
    matrix[0] *= 0.5
    return np.cos(angles), matrix


def _fitted(
    function: _Function, low: float, high: float, most: int = MOST_STRETCHES
) -> list[tuple[float, float | _Series]]:
    """Chebyshev series of a function on stretches from low to high, each with its upper end."""
    check_points = low + (high - low) * np.linspace(0.0, 1.0, 2003)
    inside = check_points[0 if low == 0.0 else 1 : None if high == 1.0 else -1]
    expected = function(inside)
    tolerance = RESOLVED * float(np.max(expected))
    for count in COUNTS:
        x, matrix = _nodes(count)
        coefficients = matrix @ function(low + 0.5 * (high - low) * (1.0 + x))
        local = 2.0 * (inside - low) / (high - low) - 1.0
        missed = np.max(np.abs(np.polynomial.chebyshev.chebval(local, coefficients) - expected))
        last = int(np.flatnonzero(np.abs(coefficients) > 0.1 * tolerance)[-1])
        kept = tuple(coefficients[: last + 1].tolist())
        found = [(high, kept[0] if last == 0 else _Series(kept))]
        if np.max(np.abs(coefficients[-count // 4 :])) <= tolerance and missed <= 30.0 * tolerance:
            return found
    where = _least_smooth(function, low, high, tolerance)
    _refuse_many(function.name, MOST_STRETCHES + 2 - most)
    if min(where - low, high - where) < SHORTEST:
        if missed <= NEARLY * float(np.max(expected)):
            return found
        end = low if where - low < high - where else high
        raise ValueError(
            f"{function.name} must be smooth but for a few places more than {SHORTEST:g} apart, "
            f"which Profile(at=...) may say, got a function that is not next to s = {end:.6g}"
        )
    before = _fitted(function, low, where, most - 1)
    return before + _fitted(function, where, high, most - len(before))


def _least_smooth(function: _Function, low: float, high: float, tolerance: float) -> float:
    """Place of the worst jump or kink of a function, by repeated division; the middle if none."""
    x, matrix = _nodes(9)
    halfway = 0.5 * (low + high)
    for _ in range(8):
        # Borders of cells are at places where a jump is unlikely, as two cells would see it there.
        borders = low + (high - low) * np.append(0.0, np.append((np.arange(64) + 0.618) / 64, 1.0))
        half = 0.5 * np.diff(borders)[:, None]
        s = borders[:-1, None] + half * (1.0 + x)
        coefficients = function(s.ravel()).reshape(s.shape) @ matrix.T
        tails = np.max(np.abs(coefficients[:, -3:]), axis=1)
        worst = int(np.argmax(tails))
        stands_out = tails[worst] > max(min(tolerance, 10.0 * float(np.median(tails))), 1e-17)
        if not stands_out or high - low < 1e-13:
            break
        low, high = float(borders[worst]), float(borders[worst + 1])
    if high - low > SMOOTH:
        return halfway
    # A round decimal that lies there, by chance once in a thousand, is what the user meant.
    middle = 0.5 * (low + high)
    digits = range(1, max(2, math.floor(-math.log10(1e3 * (high - low)))))
    return next((r for r in (round(middle, k) for k in digits) if low < r < high), middle)


def _refuse_many(name: str, stretches: int) -> None:
    if stretches > MOST_STRETCHES:
        raise ValueError(
            f"{name} must have at most {MOST_STRETCHES - 1} jumps and kinks, got a function with "
            "more, or noise"
        )


def values_along(name: str, function: Any, s: Array) -> Any:
    """Values of a function of arc lengths; TypeError if it accepts only single numbers."""
    try:
        return function(s)
    except (TypeError, ValueError) as error:
        try:
            function(float(s[0]))
        except Exception:  # it fails for numbers as well, so this is not the cause
            raise error from None
        raise TypeError(
            f"{name} must be a function of an array of arc lengths, as of numpy's functions, got "
            f"one that takes single numbers alone: {error}"
        ) from error


def checked_profile(name: str, given: Any) -> Profile | None:
    """A field of the pipe as a profile that is 1 at the clamp; None if it is uniform."""
    if given is None:
        return None
    if isinstance(given, list | tuple | np.ndarray):
        raise TypeError(
            f"{name} must be a function of arc length or a Profile, got {check.shown(given)}; of "
            "steps make a Profile(at, values)"
        )
    profile = given if isinstance(given, Profile) else Profile(values=given, name=name)
    at_clamp = float(profile([0.0])[0])
    if abs(at_clamp - 1.0) > 1e-9:
        raise ValueError(f"{name} must be 1 at s = 0, got {at_clamp:.12g}")
    return None if set(profile.values) == {1.0} else profile
