# SPDX-License-Identifier: MIT
"""Drives of a pipe in time: a flow whose speed varies or is free, a moving base, applied forces.

The base carries the clamp and all that holds the pipe rigidly (supports, guides, pins, the axial
fixing of its end); it moves without turning. Coordinates are measured from it. Springs, dampers,
stops, foundations and the fluid around the pipe rest on the ground.

Forces along the pipe are handed to the core as polynomials of the arc length, whose coefficients
vary in time.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from pipedyn.models.pipe import Pipe, checked_pipe, scaled_by
from pipedyn.models.scales import beyond, like_water
from pipedyn.models.space import nearest_plane
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import warn_of_number
from pipedyn.util.result import Units

Letter = Literal["x", "y", "z"]
LETTERS: tuple[Letter, ...] = get_args(Letter)

Direction: TypeAlias = Letter | tuple[complex, complex, complex]
"""A direction along an axis, or three numbers (x, y, z), complex if components are out of phase."""

LARGEST_SPEED = 1e4
"""Largest flow speed: at it the thrust u^2 is 1e8 times the elastic stiffness, so that rounding
takes half of the digits."""

LARGEST_HEAD = 1e12
"""Largest head and weight: larger ones give speeds above the largest."""

LARGEST_FREQUENCY = 1e6
"""Largest angular frequency: far above any pipe's, far below overflow."""

STEP = 2e-3
"""Distance in T between the nine values by which functions are differentiated: the first and second
derivative of cos(100 t) are then exact to 4e-9, and rounding adds 1e-9 of the values."""

TRIED = 101
"""Number of times at which functions are checked beforehand."""

TRIED_PLACES = 500
"""Number of places at which a force along the pipe is compared with its polynomial beforehand."""

HIGHEST_DEGREE = 48
"""Largest degree of the polynomial for a force along the pipe: nine waves of a sine have it."""

MISSED = 1e-6
"""Largest share of a force along the pipe that its polynomial may miss, at the times checked."""

Place: TypeAlias = tuple[float, ...]

Base: TypeAlias = Callable[[float], Place] | tuple[Callable[[float], Place], ...]
"""A function of time that gives the base's place (X, Y), in three dimensions (X, Y, Z), or a tuple
of it and its first and second derivative."""


@dataclass(frozen=True)
class _Drive:
    """A drive with numbers of its own, which knows whether they were given in SI."""

    of_si: bool = field(default=False, init=False, repr=False, compare=False)

    def as_of_si(self, of_si: bool = True) -> Self:
        """The drive, marked as made from numbers in SI, which `InputUnits` asks for beside others.

        A copy by `dataclasses.replace`, whose new numbers are nondimensional, has no mark.
        """
        vars(self)["of_si"] = of_si
        return self

    @classmethod
    def restored(cls, values: dict[str, Any]) -> Self:
        """The drive from its fields in a file; older files lack the mark."""
        of_si = values.pop("of_si", False)
        return cls(**values).as_of_si(of_si)


@saved_as("Pulsation", added=("of_si",))
@dataclass(frozen=True)
class Pulsation(_Drive):
    """A flow speed that pulsates: u = mean (1 + amplitude cos(frequency t)).

    A call with a time returns the speed.

    Attributes:
        mean: u_0 >= 0, in sqrt(EI / mu_f) / L.
        amplitude: mu, in [-1, 1], so that the flow does not reverse.
        frequency: angular, in 1 / T, > 0.

    Example:
        >>> flow = pp.Pulsation(mean=5.0, amplitude=0.2, frequency=30.0)
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 5), flow, 1.0, lambda s: 0.1 * s)
        >>> round(float(motion.flow_speed.max()), 3)
        6.0

    Raises:
        ValueError: for a number out of its range, NaN or infinity.
        TypeError: for an argument that is not a number.
    """

    mean: float
    amplitude: float
    frequency: float

    def __post_init__(self) -> None:
        amplitude = check.real("amplitude", self.amplitude)
        if abs(amplitude) > 1.0:
            raise ValueError(f"amplitude must lie in [-1, 1] or the flow reverses, got {amplitude}")
        vars(self).update(
            mean=check.real("mean", self.mean, low=0.0, high=LARGEST_SPEED),
            amplitude=amplitude,
            frequency=_frequency(self.frequency),
        )

    @classmethod
    def from_si(cls, pipe: Pipe, *, mean: float, amplitude: float, frequency: float) -> Pulsation:
        """The pulsation for a pipe made with `Pipe.from_si`: mean in m/s, frequency in rad/s.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pipe = pp.Pipe.from_si(length=2.0, **numbers)
            >>> pp.Pulsation.from_si(pipe, mean=8.0, amplitude=0.2, frequency=3.0)
            Pulsation(mean=4.0, amplitude=0.2, frequency=6.0)
        """
        speed = check.real("mean", mean, unit="m/s")
        omega = check.real("frequency", frequency)
        pipe = checked_pipe(pipe)
        return cls(pipe.speed_from_si(speed), amplitude, pipe.frequency_from_si(omega)).as_of_si()

    @property
    def period(self) -> float:
        """Period of the pulsation, in T."""
        return 2.0 * math.pi / self.frequency

    def __call__(self, t: float) -> float:
        """Flow speed u(t)."""
        return self.mean * (1.0 + self.amplitude * math.cos(self.frequency * t))

    def rate(self, t: float) -> float:
        """Rate of change of the flow speed, du/dt."""
        return -self.mean * self.amplitude * self.frequency * math.sin(self.frequency * t)


@saved_as("Harmonic", added=("of_si",))
@dataclass(frozen=True)
class Harmonic(_Drive):
    """A base that oscillates as amplitude cos(frequency t) in a direction, or on an ellipse.

    A call with a time returns the position: (X, Y) with a direction "x" or "y", else (X, Y, Z).

    Attributes:
        amplitude: amplitude of the base's displacement, in L: its farthest distance from rest.
        frequency: angular frequency, in 1 / T, > 0.
        direction: "x" or "z", across the pipe, or "y", along it, downward; or three numbers (x, y,
            z), whose size has no effect. If they are complex, the base moves as the real part of
            them times exp(i frequency t): with (1, 0, -1j) on a circle that turns from x to z.
            Models that move in a plane need z = 0.

    Example:
        >>> shaken = pp.Harmonic(amplitude=0.01, frequency=3.5)
        >>> motion = pp.simulate(pp.Chain(pp.Pipe(0.2), 5), 3.0, 10.0, np.zeros(5), base=shaken)
        >>> round(float(np.ptp(motion.tip[:, 0])), 4)
        0.0183
        >>> stirred = pp.Harmonic(amplitude=0.01, frequency=np.pi, direction=(1, 0, -1j))
        >>> np.round(stirred(0.5), 12)
        array([0.  , 0.  , 0.01])

    Raises:
        ValueError: for a number out of its range, NaN or infinity, or another direction.
        TypeError: for an argument that is not a number.
    """

    amplitude: float
    frequency: float
    direction: Direction = "x"

    def __post_init__(self) -> None:
        vars(self).update(
            amplitude=check.real("amplitude", self.amplitude, low=-1e6, high=1e6),
            frequency=_frequency(self.frequency),
            direction=_direction(self.direction),
        )
        for far in beyond("amplitude over the pipe's length", abs(self.amplitude), (0.0, 1.0)):
            warn_of_number(f"{far}: not in mm, where from_si takes m?")

    @classmethod
    def from_si(
        cls, pipe: Pipe, *, amplitude: float, frequency: float, direction: Direction = "x"
    ) -> Harmonic:
        """The motion for a pipe made with `Pipe.from_si`: amplitude in m, frequency in rad/s.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pipe = pp.Pipe.from_si(length=2.0, **numbers)
            >>> pp.Harmonic.from_si(pipe, amplitude=0.02, frequency=3.0)
            Harmonic(amplitude=0.01, frequency=6.0, direction='x')
        """
        reach = check.real("amplitude", amplitude, unit="m")
        omega = check.real("frequency", frequency)
        pipe = checked_pipe(pipe)
        return cls(pipe.length_from_si(reach), pipe.frequency_from_si(omega), direction).as_of_si()

    @property
    def period(self) -> float:
        """Period of the motion, in T."""
        return 2.0 * math.pi / self.frequency

    @cached_property
    def vector(self) -> Complex:
        """Complex amplitude a, shape (3,): the base is at the real part of a exp(i frequency t)."""
        if isinstance(self.direction, str):
            return np.asarray(self.amplitude * np.eye(3)[LETTERS.index(self.direction)] + 0.0j)
        given = np.array(self.direction, dtype=np.complex128)
        given /= np.abs(given).max()
        square = float(np.sum(np.abs(given) ** 2)) + abs(complex(np.sum(given**2)))
        return np.asarray(self.amplitude * given / math.sqrt(0.5 * square))

    @property
    def across(self) -> bool:
        """Whether the base moves across the straight pipe."""
        return bool(self.vector[[0, 2]].any())

    def _derivative(self, t: float, order: int) -> Place:
        turn = (1j * self.frequency) ** order * cmath.exp(1j * self.frequency * t)
        found = (turn * self.vector).real.tolist()
        return tuple(found[:2] if self.direction in ("x", "y") else found)

    def __call__(self, t: float) -> Place:
        """Position (X, Y), or (X, Y, Z)."""
        return self._derivative(t, 0)

    def velocity(self, t: float) -> Place:
        """Velocity (X', Y'), or (X', Y', Z')."""
        return self._derivative(t, 1)

    def acceleration(self, t: float) -> Place:
        """Acceleration (X'', Y''), or (X'', Y'', Z'')."""
        return self._derivative(t, 2)

    def in_plane(self) -> tuple[Harmonic, float]:
        """The motion turned about the axis into the plane z = 0, and the angle of its own plane.

        The angle is from x towards z. A motion that lies in no plane through the axis is returned
        as it is, with 0.
        """
        x, y, z = self.vector.tolist()
        angle = _azimuth_of(np.array([[x, z]]))
        if not angle:
            return self, 0.0
        return replace(self, direction=(math.cos(angle) * x + math.sin(angle) * z, y, 0.0)), angle

    def require_dimensions(self, dimensions: int) -> None:
        """Raises ValueError if the base leaves the plane of a model in two dimensions."""
        if dimensions == 2 and self.vector[2]:
            raise ValueError(
                "base must stay in the plane of x and y, in which the model moves, got "
                f"direction={self.direction!r}; one made with dimensions=3 also moves along z"
            )


@saved_as("Force", added=("of_si",))
@dataclass(frozen=True)
class Force(_Drive):
    """A force of the user's own that varies in time, at one place or all along the pipe.

    Its components, x across and y along the straight pipe (downward), in three dimensions also z
    across, do not turn with the pipe. A force along the pipe, such as a pressure times the width on
    which it acts, is a force per length of the pipe.

    Attributes:
        function: for a force at one place, a function of the time t to the component x or to a
            pair (x, y), in three dimensions to a triple (x, y, z); for a force along the pipe, a
            function of arc lengths s, shape (p,), and of t to components x, shape (p,) or one
            number, or to pairs (p, 2), in three dimensions triples (p, 3). A model takes as many
            components as it has dimensions, or x alone. The function must be smooth in s:
            a polynomial of degree 48 must represent it to 1e-6. It may jump in time, but `simulate`
            may pass over what lasts less than a hundredth of a motion, unless `max_step` is
            shorter. If a frequency is given, the function's argument is the phase frequency * t in
            place of t. If no function is given, the force is amplitude * cos(frequency * t) along
            x.
        at: arc length of the place in L, 0 < at <= 1; None for a force along the pipe. In a chain
            with a fixed part at its clamp, a force on that part moves nothing.
        frequency: angular, in 1 / T, > 0, of a function that repeats as its phase grows by 2 pi.
            `forced_response` varies it.
        amplitude: factor of the function. The unit is EI / L^2 at one place, EI / L^3 along the
            pipe.

    Example:
        >>> model = pp.Chain(pp.Pipe(0.2, damping=0.01), 6)
        >>> push = pp.Force(lambda t: 0.5 * np.exp(-((t - 1.0) ** 2) / 0.02), at=1.0)
        >>> motion = pp.simulate(model, 3.0, 4.0, np.zeros(6), force=push)
        >>> round(float(np.abs(motion.tip[:, 0]).max()), 3)
        0.024
        >>> wave = pp.Force(lambda s, phase: np.sin(3.0 * s - phase), frequency=8.0, amplitude=2.0)
        >>> motion = pp.simulate(model, 3.0, 4.0, np.zeros(6), force=wave)
        >>> round(float(np.abs(motion.tip[:, 0]).max()), 3)
        0.056

    Raises:
        ValueError: for a number out of its range, NaN or infinity, or neither function nor
            frequency.
        TypeError: for an argument that is not a number, or no function.
    """

    function: Callable[..., Any] | None = None
    at: float | None = None
    frequency: float | None = None
    amplitude: float = 1.0

    def __post_init__(self) -> None:
        check.instance("function", self.function, Callable | None, "a function")
        if self.function is None and self.frequency is None:
            raise ValueError(
                "frequency must be given for a force without a function, which is amplitude "
                "cos(frequency t), got None"
            )
        if self.at is not None:
            vars(self)["at"] = check.real("at", self.at, low=0.0, high=1.0, open_low=True)
        if self.frequency is not None:
            vars(self)["frequency"] = _frequency(self.frequency)
        vars(self)["amplitude"] = check.real("amplitude", self.amplitude, low=-1e9, high=1e9)

    @classmethod
    def from_si(
        cls,
        pipe: Pipe,
        function: Callable[..., Any] | None = None,
        *,
        at: float | None = None,
        frequency: float | None = None,
        amplitude: float = 1.0,
    ) -> Force:
        """The force for a pipe made with `Pipe.from_si`.

        Args:
            pipe: the pipe.
            function: as for `Force`, of places in m and the time in s, or of the phase, to a force
                in N, or along the pipe in N/m; quantities of pint are converted.
            at: place of the force, m; None for a force along the pipe.
            frequency: angular frequency, rad/s.
            amplitude: factor of the function; without a function the amplitude in N, or N/m.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pipe = pp.Pipe.from_si(length=2.0, **numbers)
            >>> pp.Force.from_si(pipe, at=1.0, frequency=3.0, amplitude=0.5)
            Force(function=None, at=0.5, frequency=6.0, amplitude=0.5)
        """
        scales = checked_pipe(pipe)._units("a force")
        length, time = scales.length, scales.time
        unit, name = scales.mass * length / time**2, "N/m"
        if at is not None:
            at = pipe.length_from_si(check.real("at", at, unit="m"))
            unit, name = unit * length, "N"
        if frequency is not None:
            frequency = pipe.frequency_from_si(check.real("frequency", frequency))
        if function is None:
            amplitude = check.real("amplitude", amplitude, unit=name)
        elif callable(function):
            scale = time if frequency is None else 1.0
            function = partial(_force_in_si, function, length, scale, name)
        amplitude = check.real("amplitude", amplitude) / unit
        return cls(function, at, frequency, amplitude).as_of_si()

    def components(self, places: Array, t: float, dimensions: int = 2) -> Array:
        """Components at a time, at places (p,) or at the force's own place, (p, dimensions).

        Raises ValueError if the function fails or returns no such numbers.
        """
        argument = t if self.frequency is None else self.frequency * t
        if self.function is None:
            found: Any = math.cos(argument)
        else:
            arguments = (argument,) if self.at is not None else (places, argument)
            try:
                found = self.function(*arguments)
            except Exception as error:
                told = f"{type(error).__name__}: {error}"
                raise ValueError(f"force({t:g}) must be numbers, it raised {told}") from error
        count = 1 if self.at is not None else len(places)
        try:
            values = check.doubles("force", found, "numbers")
        except (TypeError, ValueError):
            values = np.full((), math.nan)
        vector = (dimensions,) if self.at is not None else (count, dimensions)
        made = np.zeros((count, dimensions))
        if values.shape not in ((), (count,), vector) or not np.isfinite(values).all():
            named = "x and y in a plane" if dimensions == 2 else "x, y and z in three dimensions"
            raise ValueError(
                f"force({t:g}) must give finite numbers, one or of shape ({count},) for x or "
                f"{vector} for {named}, got {check.shown(found)}"
            )
        if values.shape == vector:
            made[:] = values
        else:
            made[:, 0] = values
        return self.amplitude * made

    def in_plane(self) -> tuple[Force, float]:
        """The force of a function of the phase, turned into the plane z = 0, as for `Harmonic`."""
        if self.function is None or self.frequency is None:
            return self, 0.0
        times = np.linspace(0.0, 2.0 * math.pi / self.frequency, TRIED)
        places = np.linspace(0.0, 1.0, 9)
        values = np.concatenate([self.components(places, t, 3) for t in times.tolist()])
        angle = _azimuth_of(values[:, ::2])
        if not angle:
            return self, 0.0
        return replace(
            self, function=partial(_force_in_plane, replace(self, amplitude=1.0), angle)
        ), angle


def _azimuth_of(across: NDArray[Any]) -> float:
    """Angle from x towards z of the plane of vectors (x, z), (k, 2), real or complex; 0 if none."""
    angle = float(nearest_plane(*across.T))
    beside = across @ np.array([-math.sin(angle), math.cos(angle)])
    return angle if np.abs(beside).max() <= 1e-12 * np.abs(across).max() else 0.0


def _force_in_plane(force: Force, angle: float, *arguments: Any) -> Array:
    """Components of a force in the plane at an angle from x towards z, turned into that of x."""
    *places, phase = arguments
    assert force.frequency is not None
    at = places[0] if places else np.zeros(1)
    x, y, z = force.components(at, phase / force.frequency, 3).T
    found = np.stack([math.cos(angle) * x + math.sin(angle) * z, y, 0.0 * z], axis=1)
    return found if places else found[0]


def _force_in_si(
    function: Callable[..., Any], length: float, time: float, unit: str, *arguments: Any
) -> Any:
    """Values in SI of a function of place and time in SI, or of time alone, at nondimensional ones.

    time: value of a nondimensional 1 of the last argument.
    """
    *places, t = arguments
    return check.in_unit("its value", function(*(length * s for s in places), time * t), unit)


def checked_periodic_force(force: Any, dimensions: int) -> Force:
    """The force, refused unless it has a frequency, repeats with its phase and acts."""
    known: Force = check.instance("force", force, Force, "a Force")
    if known.frequency is None:
        raise ValueError(
            "force must have a frequency, which sets the period, and a function of the "
            f"phase, got {check.shown(force)}"
        )
    places, times = np.linspace(0.0, 1.0, 9), phase_times(known)
    period = 2.0 * math.pi / known.frequency
    values, later = (
        np.array([known.components(places, t, dimensions) for t in (times + add).tolist()])
        for add in (0.0, period)
    )
    size = float(np.abs(values).max())
    if size == 0.0:
        raise ValueError("force must act, got one that is 0 at all times")
    if (missed := float(np.abs(later - values).max())) > 1e-9 * size:
        raise ValueError(
            "force must repeat as its phase grows by 2 pi, got a function whose values then differ "
            f"by {missed:.1e}"
        )
    return known


def phase_times(force: Force) -> Array:
    """Times in a period of a force that repeats, at which it is checked."""
    assert force.frequency is not None
    return np.linspace(0.0, 2.0 * math.pi / force.frequency, TRIED, endpoint=False)


def checked_forces(force: Any) -> tuple[Force, ...]:
    """The argument `force`, none, one or a sequence of at most 20 forces, as a tuple."""
    if force is None:
        return ()
    if not isinstance(force, tuple | list):
        return (check.instance("force", force, Force, "a Force or a sequence of them"),)
    if not 0 < len(force) <= 20:
        raise ValueError(f"force must be 1 to 20 forces, got {len(force)}")
    return tuple(
        check.instance(f"force[{k}]", one, Force, "a Force") for k, one in enumerate(force)
    )


class AppliedForces:
    """Forces as the core takes them: laws of applied forces, and their numbers at any time.

    Args:
        forces: the forces.
        times: times at which they are checked, shape (k,).
        dimensions: number of dimensions of the model.

    Attributes:
        laws: law, place and numbers of each force, as the core's pipe takes terms.
        rows: number of numbers at a time, which follow those of the base's motion in a drive.

    Raises:
        ValueError: for a force that a polynomial of degree 48 does not represent along the pipe, or
            whose function fails.
    """

    def __init__(self, forces: Sequence[Force], times: Array, dimensions: int = 2) -> None:
        self.dimensions = dimensions
        self.laws: list[tuple[str, float, list[float]]] = []
        self._parts: list[tuple[Force, Array, Array]] = []  # with places, values to coefficients
        self.rows = 0
        for force in forces:
            first, degree = float(self.rows // 3), 0
            if force.at is None:
                degree = _degree_along(force, times, dimensions)
                self.laws.append(("applied_load", 0.0, [first, degree + 1.0]))
            else:
                for t in times.tolist():
                    force.components(np.zeros(1), t, dimensions)
                self.laws.append(("applied_force", force.at, [first]))
            self._parts.append((force, *_to_chebyshev(degree + 1)))
            self.rows += 3 * (degree + 1)

    def __call__(self, t: float) -> Array:
        """The numbers at a time, shape (rows,): x, y and z of each coefficient."""
        made, size = np.zeros((self.rows // 3, 3)), self.dimensions
        found = [to @ force.components(places, t, size) for force, places, to in self._parts]
        np.concatenate(found, out=made[:, :size])
        return made.ravel()


def _to_chebyshev(count: int) -> tuple[Array, Array]:
    """Places in [0, 1], and the matrix from values there to coefficients of T_k(2 s - 1)."""
    x = np.polynomial.chebyshev.chebpts1(count)
    to = np.polynomial.chebyshev.chebvander(x, count - 1).T * (2.0 / count)
    to[0] *= 0.5
    return 0.5 * (1.0 + x), to.astype(np.float64)


def _degree_along(force: Force, times: Array, dimensions: int) -> int:
    """Degree of the polynomial of the arc length that represents a force at some times."""
    places, to = _to_chebyshev(HIGHEST_DEGREE + 1)
    series = np.array([to @ force.components(places, t, dimensions) for t in times.tolist()])
    sizes = np.abs(series).max(axis=(0, 2))
    seen = np.linspace(0.0, 1.0, TRIED_PLACES)
    powers = np.polynomial.chebyshev.chebvander(2.0 * seen - 1.0, HIGHEST_DEGREE)
    missed, size = 0.0, float(sizes.max())
    for k in range(0, len(times), 10):
        values = force.components(seen, float(times[k]), dimensions)
        size = max(size, float(np.abs(values).max()))
        missed = max(missed, float(np.abs(values - powers @ series[k]).max()))
    if missed > MISSED * size:
        raise ValueError(
            f"force must be smooth along the pipe, so that a polynomial of degree {HIGHEST_DEGREE} "
            f"represents it, got one that such a polynomial misses by {missed / size:.1e} of its "
            "size; where it has jumps or corners, round them off, or put forces at several places "
            "in a list"
        )
    return int(np.flatnonzero(sizes > 1e-11 * sizes.max()).max(initial=0))


@saved_as("Supply", added=("of_si",))
@dataclass(frozen=True)
class Supply(_Drive):
    """A flow at constant head instead of constant speed.

    The fluid in the pipe obeys Newton's law along the pipe, with s = 1 ejecting and -1 aspirating,

        sqrt(beta) u' + s beta int t . r'' ds = head + s * weight * y(1) - friction * u^2 / 2,

    with the tangent t and the acceleration r'' of the pipe. If the pipe is inclined, the depth of
    the outlet stands for y(1). So the pipe's motion slows the flow or
    speeds it up, and u' acts on the pipe. Small motions of a straight pipe do not change the flow
    to first order: it loses stability at the same speed. Large motions do, see `friction` of
    `hopf`.

    Attributes:
        head: pressure difference between reservoir and outlet times the pipe's section, in EI /
            L^2.
        friction: f > 0, coefficient of all losses of pressure, f rho V^2 / 2: friction factor times
            length by diameter, loss at the inlet, and 1 for the acceleration of the fluid from
            rest. Below 1 the fluid has a speed before it enters, and a whipping pipe may draw in
            more and more fluid.
        weight: weight of the fluid in the pipe, in EI / L^2; beta gamma by default. If there is a
            fluid outside, subtract the weight of the same volume of it, because its pressure at the
            outlet grows with depth.
        start: initial flow speed; by default that of the straight pipe at rest.

    Raises:
        ValueError: for a number out of its range, NaN or infinity.
        TypeError: for an argument that is not a number.

    Example:
        >>> pipe = pp.Pipe(0.2)
        >>> supply = pp.Supply.at_speed(pipe, 6.0, friction=2.0)
        >>> supply.head, supply.speed(pipe)
        (36.0, 6.0)
        >>> motion = pp.simulate(pp.Chain(pipe, 5), supply, 10.0, lambda s: 0.3 * s)
        >>> motion.flow_speed.shape
        (501,)

    Source: Bajaj, Sethna and Lundgren, SIAM Journal on Applied Mathematics 39 (1980) 213-230, for
    the question; the equation is Newton's law for the fluid's acceleration along t, r'' . t +
    du/dt, because 2 u dt/dtau and u^2 dt/ds have no component along t.
    """

    head: float
    friction: float
    weight: float | None = None
    start: float | None = None

    def __post_init__(self) -> None:
        rules: dict[str, dict[str, Any]] = {
            "head": {"low": -LARGEST_HEAD, "high": LARGEST_HEAD},
            "friction": {"low": 0.0, "high": 1e9, "open_low": True},
            "weight": {"low": -LARGEST_HEAD, "high": LARGEST_HEAD},
            "start": {"low": 0.0, "high": LARGEST_SPEED},
        }
        given = vars(self)
        for name, rule in rules.items():
            if given[name] is not None or name in ("head", "friction"):
                given[name] = check.real(name, given[name], **rule)

    @classmethod
    def at_speed(
        cls,
        pipe: Pipe,
        u: float,
        *,
        friction: float,
        weight: float | None = None,
        start: float | None = None,
    ) -> Supply:
        """The supply whose head gives the straight pipe at rest the flow speed u > 0."""
        u = check.real("u", u, low=0.0, high=LARGEST_SPEED, open_low=True)
        still = cls(0.0, friction, weight, start)
        return cls(0.5 * still.friction * u**2 - still._weight_head(pipe), friction, weight, start)

    @classmethod
    def from_si(
        cls,
        pipe: Pipe,
        *,
        pressure: float,
        density: float,
        friction: float,
        weight: float | None = None,
        start: float | None = None,
    ) -> Supply:
        """The supply for a pipe made with `Pipe.from_si`.

        Args:
            pipe: the pipe.
            pressure: pressure at the reservoir less that at the outlet, N/m^2.
            density: density of the fluid in the pipe, kg/m^3, > 0.
            friction: f, a number.
            weight: weight of the fluid in the pipe less that of the same volume of the fluid
                outside, N; by default as in air.
            start: initial flow speed, m/s.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pipe = pp.Pipe.from_si(length=2.0, **numbers)
            >>> pp.Supply.from_si(pipe, pressure=1e5, density=1000.0, friction=0.5)
            Supply(head=25.0, friction=0.5, weight=None, start=None)
        """
        pressure = check.real("pressure", pressure, unit="Pa")
        density = check.real("density", density, low=0.0, open_low=True, unit="kg/m**3")
        scales = checked_pipe(pipe)._units("head")
        own = pipe.beta * scales.mass / (0.25 * math.pi * scales.inner_diameter**2 or math.nan)
        if own > 0.0 and not 0.9 < density / own < 1.1:
            warn_of_number(
                f"density is {density:.4g} kg/m3, but the pipe's fluid has {own:.4g} kg/m3: in "
                "kg/m3, not in g/cm3?"
            )
        else:
            for far in like_water(density=density):
                warn_of_number(f"{far}: in kg/m3, not in g/cm3?")
        # Water 1 mm high has 10 Pa.
        for far in beyond("pressure", abs(pressure), (10.0, 1e9), " Pa") if pressure else ():
            warn_of_number(f"{far}: in Pa, not in bar, MPa or kPa?")
        head = check.real("head from pressure and density", pressure / density / scales.speed**2)
        if weight is not None:
            force = pipe.beta * scales.mass * scales.speed**2  # unit of force, EI / L^2
            weight = check.real("weight", weight, unit="N") / force
        if start is not None:
            start = pipe.speed_from_si(check.real("start", start, low=0.0, unit="m/s"))
        return cls(head, friction, weight, start).as_of_si()

    def _weight_head(self, pipe: Pipe) -> float:
        """Contribution of the fluid's weight in the straight pipe to the head."""
        return checked_pipe(pipe).direction * self.weight_in(pipe) * pipe.down[1]

    def weight_in(self, pipe: Pipe) -> float:
        """Weight of the fluid in the pipe, in EI / L^2."""
        return pipe.beta * pipe.gamma if self.weight is None else self.weight

    def speed(self, pipe: Pipe) -> float:
        """Flow speed in the straight pipe at rest.

        Raises:
            ValueError: if the head drives no flow in the pipe's direction.
        """
        driving = self.head + self._weight_head(pipe)
        if driving <= 0.0:
            raise ValueError(
                f"head must drive a flow through the straight pipe, got {self.head:g}, to which "
                f"the weight of its fluid adds {self._weight_head(pipe):g}"
            )
        u = math.sqrt(2.0 * driving / self.friction)
        return check.real("speed at this head and friction", u, high=LARGEST_SPEED)


Speed: TypeAlias = (
    float
    | Callable[[float], float]
    | tuple[Callable[[float], float], Callable[[float], float]]
    | Supply
)
"""A flow speed: steady, a function u(t), a tuple of it and its derivative, or a drive of the
flow."""


def steady_speed(
    name: str, u: Any, *, high: float = LARGEST_SPEED, open_low: bool = False
) -> float:
    """Checks a steady flow speed; for one that varies, TypeError names the functions to use."""
    require_steady(name, u)
    return check.real(name, u, low=0.0, high=high, open_low=open_low)


def require_steady(name: str, given: Any) -> None:
    """Raises TypeError if the argument or an entry of it is a flow that is free or pulsates."""
    for one in given if isinstance(given, list | tuple) else (given,):
        if isinstance(one, Supply):
            raise TypeError(
                f"{name} must be steady, got {check.shown(one)}: at constant head ask simulate for "
                "motions and hopf(model, friction=...) for onset and cycles next to it; rest and "
                "small motions are those at the speed supply.speed(pipe)"
            )
        if isinstance(one, Pulsation):
            raise TypeError(
                f"{name} must be steady, got {check.shown(one)}: of a pulsating flow ask simulate, "
                "floquet, parametric_regions or forced_response"
            )


def _direction(value: Any) -> Direction:
    """The direction of a `Harmonic`, refused unless it is a letter or three numbers, not all 0."""
    if isinstance(value, str):
        return check.choice("direction", value, LETTERS)
    said = "'x', 'y', 'z' or three numbers (x, y, z)"
    given = check.numbers("direction", value, said, kinds="iufc")
    if given.shape != (3,) or not np.isfinite(given).all() or not given.any():
        raise ValueError(
            f"direction must be {said}, finite and not all 0, got {check.shown(value)}"
        )
    x, y, z = (given + 0.0).tolist()
    return (x, y, z)


def _frequency(value: Any) -> float:
    return check.real("frequency", value, low=0.0, high=LARGEST_FREQUENCY, open_low=True)


@saved_as("DriveFailed")
class DriveFailed(Exception):
    """Raised during a motion if a function of time fails or returns no usable numbers."""


class Drive:
    """Flow speed, base motion and forces as functions of time, over a range of times.

    A call with a time returns u, u', X, Y, X', Y', X'', Y'', Z, Z', Z'' and the numbers of the
    forces, or raises `DriveFailed`.

    Args:
        u: the flow speed, of type `Speed`.
        base: the base's motion, of type `Base`; at rest if None.
        low: the first time at which functions are called.
        high: the last time at which functions are called.
        forces: the forces.
        dimensions: number of dimensions of the model: of coordinates of the base's place, and of
            components of the forces.

    Raises:
        ValueError: for speeds below 0, numbers that are not finite, or results of wrong shape.
        TypeError: for an argument that is no function as described.
    """

    def __init__(
        self,
        u: Any,
        base: Any,
        low: float,
        high: float,
        forces: Sequence[Force] = (),
        dimensions: int = 2,
    ) -> None:
        self._entries = dimensions  # of the base's place; a `Harmonic` has its own number
        if isinstance(base, Harmonic):
            base.require_dimensions(dimensions)
            self._entries = len(base(low))
        self.low, self.step = low, min(STEP, (high - low) / 16.0)
        self.last = high - 4.0 * self.step
        self._speed = _with_derivatives("u", u, 1)
        self._base = None if base is None else _with_derivatives("base", base, 2)
        times = np.linspace(low, high, TRIED)
        self.forces = AppliedForces(forces, times, dimensions)
        for t in times.tolist():
            self._at(t)

    def __call__(self, t: float) -> tuple[float, ...]:
        """Values of u, u', X, Y, X', Y', X'', Y'', Z, Z', Z'' and of the forces at a time."""
        try:
            return self._at(t)
        except (ValueError, TypeError) as error:
            raise DriveFailed(str(error)) from error

    def _at(self, t: float) -> tuple[float, ...]:
        u, rate = self._evaluated("u", self._speed, t, 1)
        if not 0.0 <= u[0] <= LARGEST_SPEED:
            check.real(f"u({t:g})", u[0], low=0.0, high=LARGEST_SPEED)
        forces = self.forces(t).tolist() if self.forces.rows else ()
        if self._base is None:
            return (*u, *rate, *(0.0,) * 9, *forces)
        moves = self._evaluated("base", self._base, t, self._entries)
        across = (0.0, 0.0, 0.0) if self._entries == 2 else (one[2] for one in moves)
        return (*u, *rate, *(x for one in moves for x in one[:2]), *across, *forces)

    @cached_property
    def numbers(self) -> tuple[float, ...] | None:
        """Numbers by which the core computes the drive itself, if speed and base only oscillate.

        They are mean speed, relative amplitude and frequency of the flow; frequency of the base,
        and real and imaginary parts of its complex amplitude, along x, y and z each.
        """
        speed = self._speed[0]
        base = Harmonic(0.0, 1.0) if self._base is None else self._base[0]
        oscillates = isinstance(speed, Pulsation) and isinstance(base, Harmonic)
        if self.forces.rows or not oscillates:
            return None
        parts = base.vector.real.tolist() + base.vector.imag.tolist()
        return (speed.mean, speed.amplitude, speed.frequency, base.frequency, *parts)

    def _evaluated(self, name: str, functions: Any, t: float, entries: int) -> list[Any]:
        """Values and derivatives of functions at a time, `entries` numbers each."""
        first, *others = functions
        if others and others[0] is not None:
            return [_finite(name, of, t, entries) for of in functions]
        center = min(max(t, self.low + 4.0 * self.step), self.last)
        near = np.array([_finite(name, first, center + k * self.step, entries) for k in NODES])
        powers = TO_POWERS @ (near - near[4])  # exact for a constant
        x = (t - center) / self.step
        found = [_finite(name, first, t, entries)]
        for _ in range(1, len(functions)):
            powers = np.arange(1.0, len(powers))[:, None] * powers[1:] / self.step
            found.append(tuple((x ** np.arange(len(powers)) @ powers).tolist()))
        return found


NODES = tuple(range(-4, 5))
TO_POWERS = np.linalg.inv(np.vander(NODES, increasing=True))
"""Matrix from values at these nodes to coefficients of the polynomial of degree 8."""


def _with_derivatives(name: str, given: Any, order: int) -> tuple[Any, ...]:
    """A function and its derivatives; None for each that must be computed by differences."""
    if isinstance(given, Pulsation):
        return given, given.rate
    if isinstance(given, Harmonic):
        return given, given.velocity, given.acceleration
    if order == 1 and isinstance(given, int | float | np.number):
        steady = Pulsation(check.real(name, given, low=0.0, high=LARGEST_SPEED), 0.0, 1.0)
        return steady, steady.rate
    listed = given if isinstance(given, tuple) else (given, *(None,) * order)
    rule = "one with its derivative" if order == 1 else "one with its two derivatives"
    derivatives = all(callable(of) or of is None for of in listed[1:])
    if len(listed) != order + 1 or not callable(listed[0]) or not derivatives:
        raise TypeError(f"{name} must be a function of time or {rule}, got {check.shown(given)}")
    return listed


def _finite(name: str, function: Any, t: float, entries: int) -> tuple[float, ...]:
    """The value of a function of time, checked to be `entries` finite numbers."""
    try:
        came = function(t)
    except Exception as error:
        told = f"{type(error).__name__}: {error}"
        raise ValueError(f"{name}({t:g}) must be a number or numbers, it raised {told}") from error
    if entries == 1:
        known = isinstance(came, float) and math.isfinite(came)  # often, and named only if not
        return (float(came) + 0.0 if known else check.real(f"{name}({t:g})", came),)
    try:
        values = tuple(check.real(name, one) for one in came)
    except (TypeError, ValueError):
        values = ()
    if len(values) != entries:
        rule = f"{name}({t:g}) must give {entries} finite numbers"
        raise ValueError(f"{rule}, got {check.shown(came)}")
    return values


class InputUnits:
    """Units in which a user gives flow speeds, times and motions of the base for a pipe.

    With "si" they are in m/s, s and m, and drives that have a `from_si` must come from it;
    quantities of pint are converted in any case. States and events stay nondimensional.

    Raises ValueError for SI units or quantities if the pipe has no scales.
    """

    def __init__(self, units: Units, pipe: Pipe) -> None:
        self.si = check.choice("units", units, ("nondimensional", "si")) == "si"
        self._pipe, self._given = pipe, dict[str, Any]()  # what is converted
        if self.si:
            self._require_scales("units must be 'nondimensional'", units)

    def _require_scales(self, rule: str, given: Any) -> None:
        if self._pipe.scales is None:
            raise ValueError(
                f"{rule} where the pipe has no scales, as one made by Pipe.from_si or "
                f"Pipe.from_tube has them, got {check.shown(given)}"
            )

    @contextmanager
    def explained(self) -> Iterator[None]:
        """Adds the pipe's units to messages about numbers that were converted."""
        try:
            yield
        except ValueError as error:
            if (scales := self._pipe.scales) is None or not self._given:
                raise
            units = f"in units of the pipe, {scales.time:.4g} s and {scales.speed:.4g} m/s"
            if (name := str(error).partition(" ")[0]) in self._given:
                units += f"; given as {check.shown(self._given[name])}"
            raise ValueError(f"{error} ({units})") from error

    def times(self, function: Callable[..., Any], **given: Any) -> Iterator[Any]:
        """Arguments of a function that are times, in T; its defaults are in T already."""
        defaults = getattr(function, "__kwdefaults__", None) or {}
        for name, value in given.items():
            # An explicit value that equals a default is in s, but infinity is the same in T.
            kept = value is defaults.get(name) or (isinstance(value, float) and value == math.inf)
            if kept or self._stays(name, value):
                yield value
            else:
                yield scaled_by(name, value, np.divide, self._pipe._units(name).time, "s")

    def speed(self, name: str, u: Any) -> Any:
        """A flow speed or speeds u, or a function of time, maybe with its derivative."""
        if isinstance(u, Pulsation | Supply):
            return self._checked(name, u)
        if self._stays(name, u):
            return u
        pair = isinstance(u, tuple) and any(map(callable, u))
        if not (pair or callable(u)):
            return self._pipe._speed_given(name, u)
        return self._functions(u, self._pipe._units(name).speed, "m/s")

    def base(self, base: Any) -> Any:
        """A motion of the base, in L over T."""
        if isinstance(base, Harmonic):
            return self._checked("base", base)
        if not (callable(base) or isinstance(base, tuple)) or not self.si:
            return base
        return self._functions(base, self._pipe._units("base").length, "m")

    def force(self, force: Any) -> tuple[Force, ...]:
        """Forces, in units of the pipe."""
        return tuple(self._checked("force", one) for one in checked_forces(force))

    def _checked(self, name: str, drive: Any) -> Any:
        """A drive with numbers of its own, which SI units beside it must not seem to concern."""
        if self.si and not drive.of_si:
            raise ValueError(
                f"{name} must come from {type(drive).__name__}.from_si where units are 'si', as "
                f"its own numbers are nondimensional, got {check.shown(drive)}"
            )
        return drive

    def _stays(self, name: str, value: Any) -> bool:
        """Whether a value is nondimensional already."""
        if check.has_quantity(value):
            self._require_scales(f"{name} must be nondimensional", value)
        elif not self.si:
            return True
        self._given[name] = value
        return False

    def _functions(self, given: Any, scale: float, unit: str) -> Any:
        """A function of time in SI, or it with its derivatives, in units of the pipe."""
        time = self._pipe._units("times").time
        if callable(given):
            return partial(_nondimensional, given, time, 1.0 / scale, unit)
        return tuple(
            partial(_nondimensional, of, time, time**n / scale, unit + n * "/s")
            if callable(of)
            else of
            for n, of in enumerate(given)
        )


def _nondimensional(
    function: Callable[[float], Any], time: float, scale: float, unit: str, t: float
) -> Any:
    """Values of a function of time in SI, or quantities of pint, at a nondimensional time."""
    found = np.multiply(check.in_unit("its value", function(time * t), unit), scale)
    return found if found.ndim else found.item()
