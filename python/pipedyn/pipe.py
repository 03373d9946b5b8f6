# SPDX-License-Identifier: MIT
"""The pipe: a handful of nondimensional numbers, from SI and back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from pipedyn import _check

Flow = Literal["ejecting", "aspirating"]
FLOWS = ("ejecting", "aspirating")


class Scales(NamedTuple):
    """SI value of one nondimensional unit."""

    length: float
    """L, m"""
    mass: float
    """mu_p + mu_f, kg/m"""
    time: float
    """L^2 sqrt((mu_p + mu_f) / EI), s"""
    speed: float
    """sqrt(EI / mu_f) / L, m/s"""


@dataclass(frozen=True)
class Pipe:
    """A cantilevered pipe conveying fluid, in units in which L, mu_p + mu_f and EI are 1.

    Time is counted in L^2 sqrt((mu_p + mu_f) / EI), flow speed u in sqrt(EI / mu_f) / L.

    Attributes:
        beta: mass ratio mu_f / (mu_p + mu_f), 0 <= beta < 1.
        gamma: gravity g L^3 (mu_p + mu_f) / EI; negative when the free end stands above the clamp.
        flow: "ejecting" (out of the free end) or "aspirating" (into it).
        alpha: inlet coefficient >= 0 of the aspirating pipe, see `inlet_coefficient`; the ejecting
            pipe does not use it.
        drag: quadratic drag kappa = rho_e C_D d_e L / (2 (mu_p + mu_f)) >= 0; it has no part in the
            linear analysis.
        damping: Kelvin-Voigt damping delta >= 0; EI becomes EI (1 + delta d/dtau).
        scales: SI value of one unit, or None for a pipe not made with `from_si`.

    Raises:
        ValueError: for a number out of its range, NaN or infinity.
        TypeError: for what is no number.

    Source: Orsino and Di Giulio, eqs. (1)-(9); delta is not in the paper.
    """

    beta: float
    gamma: float = 0.0
    flow: Flow = "ejecting"
    alpha: float = 1.0
    drag: float = 0.0
    damping: float = 0.0
    scales: Scales | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        checked = {
            "beta": _check.real("beta", self.beta, low=0.0, high=1.0, open_high=True),
            "gamma": _check.real("gamma", self.gamma, low=-1e6, high=1e6),
            "flow": _check.choice("flow", self.flow, FLOWS),
            "alpha": _check.real("alpha", self.alpha, low=0.0, high=1e6),
            "drag": _check.real("drag", self.drag, low=0.0, high=1e9),
            "damping": _check.real("damping", self.damping, low=0.0, high=1e6),
        }
        if self.scales is not None:
            if not isinstance(self.scales, tuple) or len(self.scales) != 4:
                raise TypeError(f"scales must be a Scales, got {_check.shown(self.scales)}")
            parts = zip(Scales._fields, self.scales, strict=True)
            checked["scales"] = Scales(
                *(_check.real(f"scales.{k}", v, low=0.0, open_low=True) for k, v in parts)
            )
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_si(
        cls,
        *,
        length: float,
        bending_stiffness: float,
        pipe_mass: float,
        fluid_mass: float,
        gravity: float = 9.81,
        drag_coefficient: float = 0.0,
        external_diameter: float = 0.0,
        external_density: float = 0.0,
        damping_time: float = 0.0,
        flow: Flow = "ejecting",
        alpha: float = 1.0,
    ) -> Pipe:
        """A pipe from measured quantities.

        Args:
            length: L, m.
            bending_stiffness: EI, N m^2.
            pipe_mass: mu_p, kg/m.
            fluid_mass: mu_f, kg/m, > 0: without fluid there is no unit of flow speed.
            gravity: m/s^2; negative when the free end stands above the clamp, 0 for a pipe that
                moves in a horizontal plane.
            drag_coefficient: C_D of the pipe's outside.
            external_diameter: d_e, m.
            external_density: rho_e of the surrounding fluid, kg/m^3.
            damping_time: eps, s; the material's stress is E (strain + eps d strain / dt).
            flow: "ejecting" or "aspirating".
            alpha: inlet coefficient, see `inlet_coefficient`.

        Raises:
            ValueError: for a number out of its range, or drag given in part: of drag_coefficient,
                external_diameter and external_density all three or none.
            TypeError: for what is no number.
        """
        length = _check.real("length", length, low=0.0, high=1e12, open_low=True)
        stiffness = _check.real(
            "bending_stiffness", bending_stiffness, low=0.0, high=1e12, open_low=True
        )
        pipe_mass = _check.real("pipe_mass", pipe_mass, low=0.0, high=1e12, open_low=True)
        fluid_mass = _check.real("fluid_mass", fluid_mass, low=0.0, high=1e12, open_low=True)
        gravity = _check.real("gravity", gravity, low=-1e12, high=1e12)
        drag = [
            _check.real("drag_coefficient", drag_coefficient, low=0.0),
            _check.real("external_diameter", external_diameter, low=0.0),
            _check.real("external_density", external_density, low=0.0),
        ]
        if any(drag) and not all(drag):
            raise ValueError(
                "drag_coefficient, external_diameter and external_density must be given together, "
                f"got {drag[0]!r}, {drag[1]!r} and {drag[2]!r}"
            )
        damping_time = _check.real("damping_time", damping_time, low=0.0)
        mass = pipe_mass + fluid_mass
        time = length**2 * math.sqrt(mass / stiffness)
        speed = math.sqrt(stiffness / fluid_mass) / length
        scales = (length, mass, time, speed)
        if not all(0.0 < scale < math.inf for scale in scales):
            raise ValueError(
                "length, bending_stiffness, pipe_mass and fluid_mass must give finite units, "
                f"got {dict(zip(Scales._fields, scales, strict=True))}"
            )
        return cls(
            beta=fluid_mass / mass,
            gamma=gravity * length**3 * mass / stiffness,
            flow=flow,
            alpha=alpha,
            drag=math.prod(drag) * length / (2.0 * mass),
            damping=damping_time / time,
            scales=Scales(*scales),
        )

    def __repr__(self) -> str:
        parts = [f"beta={self.beta:.12g}"]
        for item in fields(self)[1:-1]:
            value = getattr(self, item.name)
            if value != item.default:
                parts.append(
                    f"{item.name}={value!r}" if item.name == "flow" else f"{item.name}={value:.12g}"
                )
        if self.scales is not None:
            units = zip(self.scales, ("m", "kg/m", "s", "m/s"), strict=True)
            parts.append("units " + ", ".join(f"{value:.6g} {unit}" for value, unit in units))
        return f"Pipe({', '.join(parts)})"

    def _scale(self, name: str) -> float:
        if self.scales is None:
            raise ValueError(f"{name} in SI needs a pipe made with Pipe.from_si, got {self!r}")
        return float(getattr(self.scales, name))

    def speed_si(self, u: ArrayLike) -> Any:
        """Flow speed in m/s from the nondimensional u; a number or an array."""
        return _numbers("u", u) * self._scale("speed")

    def speed(self, V: ArrayLike) -> Any:
        """Nondimensional flow speed u from V in m/s; a number or an array."""
        return _numbers("V", V) / self._scale("speed")

    def time_si(self, tau: ArrayLike) -> Any:
        """Time in s from the nondimensional tau; a number or an array."""
        return _numbers("tau", tau) * self._scale("time")

    def time(self, t: ArrayLike) -> Any:
        """Nondimensional time tau from t in s; a number or an array."""
        return _numbers("t", t) / self._scale("time")

    def frequency_si(self, omega: ArrayLike) -> Any:
        """Angular frequency in rad/s from the nondimensional omega; a number or an array."""
        return _numbers("omega", omega) / self._scale("time")

    def frequency(self, omega_si: ArrayLike) -> Any:
        """Nondimensional angular frequency from rad/s; a number or an array."""
        return _numbers("omega_si", omega_si) * self._scale("time")

    def length_si(self, s: ArrayLike) -> Any:
        """Length in m from a fraction of the pipe's; a number or an array."""
        return _numbers("s", s) * self._scale("length")

    def length(self, x: ArrayLike) -> Any:
        """Length as a fraction of the pipe's from m; a number or an array."""
        return _numbers("x", x) / self._scale("length")


def _numbers(name: str, value: ArrayLike) -> Any:
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "iuf":
        raise TypeError(
            f"{name} must be a number or an array of numbers, got {_check.shown(value)}"
        )
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be finite, got {_check.shown(value)}")
    return numbers.astype(np.float64) if numbers.ndim else float(numbers)


def inlet_coefficient(
    velocity: Callable[[float], float] | ArrayLike,
    *,
    radius: float = 1.0,
    radii: ArrayLike | None = None,
    areas: ArrayLike | None = None,
    section: float | None = None,
) -> float:
    """Inlet coefficient alpha = A int V_i^2 dS / (int V_i dS)^2 of an aspirating pipe.

    V_i is the velocity normal to the inlet surface, A the pipe's section. alpha is 1 for a uniform
    inlet over A, 4/3 for a parabolic profile over A, 1/2 for a uniform inlet over 2 A. Any
    consistent units will do.

    Args:
        velocity: an axisymmetric profile V_i(r), called with floats 0 <= r <= radius; or samples
            of V_i, shape (k,), with either their radii or the areas they stand for.
        radius: radius of the inlet, for a function.
        radii: increasing radii of the samples, shape (k,), k >= 2, the first 0 and the last the
            inlet's; between samples the profile is interpolated by monotone cubics.
        areas: area of the patch that each sample stands for, shape (k,), > 0.
        section: the pipe's section A; the area of the inlet where it is not given.

    Raises:
        ValueError: for numbers out of range, or an inlet through which nothing flows on balance.
        TypeError: for what is neither a function nor an array, or not a number.

    Source: Orsino and Di Giulio, eqs. (7)-(8).
    """
    radius = _check.real("radius", radius, low=0.0, high=1e50, open_low=True)
    if callable(velocity):
        if radii is not None or areas is not None:
            raise ValueError("radii and areas must go with samples, not with a function")
        return _axisymmetric(
            velocity, _check.real("radius", radius, low=0.0, open_low=True), section
        )
    if (radii is None) == (areas is None):
        raise ValueError("samples must come with either radii or areas")
    if radii is not None:
        at = _check.array("radii", radii, low=0.0, high=1e50)
        samples = _check.array("velocity", velocity, size=at.size, low=-1e50, high=1e50)
        if at.size < 2 or at[0] != 0.0 or np.any(np.diff(at) <= 0.0):
            raise ValueError(f"radii must increase from 0, got {_check.shown(radii)}")
        profile = PchipInterpolator(at, samples)
        return _axisymmetric(profile, float(at[-1]), section, breaks=at[1:-1])
    patches = _check.array("areas", areas, low=0.0, high=1e100, open_low=True)
    samples = _check.array("velocity", velocity, size=patches.size, low=-1e50, high=1e50)
    return _coefficient(
        float(patches @ samples), float(patches @ samples**2), float(patches.sum()), section
    )


def _axisymmetric(
    profile: Callable[[float], Any],
    radius: float,
    section: float | None,
    breaks: _check.Array | None = None,
) -> float:
    def integral(power: int, floor: float) -> float:
        def ring(r: float) -> float:
            value = _check.real(
                f"velocity({r:g})", np.asarray(profile(r))[()], low=-1e50, high=1e50
            )
            return float(2.0 * math.pi * r * value**power)

        edges = [0.0, radius] if breaks is None else [0.0, *breaks, radius]
        pieces = pairwise(edges)
        return math.fsum(
            quad(ring, a, b, limit=200, epsabs=floor, epsrel=1e-10)[0] for a, b in pieces
        )

    area = math.pi * radius**2
    momentum = integral(2, 0.0)
    flow = integral(1, 1e-11 * math.sqrt(area * momentum))
    return _coefficient(flow, momentum, area, section)


def _coefficient(flow: float, momentum: float, area: float, section: float | None) -> float:
    pipe_section = area
    if section is not None:
        pipe_section = _check.real("section", section, low=0.0, open_low=True)
    # Cauchy-Schwarz bounds flow^2 by area * momentum: the ratio is dimensionless.
    if flow**2 <= 1e-24 * area * momentum or momentum == 0.0:
        raise ValueError(f"velocity must carry fluid through the inlet, got a net flow of {flow!r}")
    return pipe_section * momentum / flow**2
