# SPDX-License-Identifier: MIT
"""Labels and units of the quantities on axes; SI units need a pipe with scales."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from pipedyn.models.drive import Supply
from pipedyn.models.pipe import OWN_NUMBERS, Pipe
from pipedyn.models.pipe_numbers import pipe_numbers, unit_of_number
from pipedyn.models.scales import scales_at
from pipedyn.plot import common
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.result import FREQUENCY, LENGTH, RATE, SPEED, TIME, VELOCITY, Unit
from pipedyn.util.result import Units as Units


@dataclass(frozen=True)
class Measure:
    """A quantity that an axis shows.

    Attributes:
        label: label of an axis in nondimensional units.
        words: label of an axis in SI units, without the unit.
        unit: SI unit; None if the quantity has none.
    """

    label: str
    words: str = ""
    unit: Unit | None = None


FLOW_SPEED = Measure(common.SPEED_LABEL, "flow speed", SPEED)
ELAPSED = Measure(common.TIME_LABEL, "time", TIME)
TIP = Measure(common.TIP_LABEL, "free end $x$", LENGTH)
TIP_ACROSS = Measure("free end $z/L$", "free end $z$", LENGTH)
TIP_RATE = Measure(common.TIP_RATE_LABEL, r"velocity of the free end $\dot{x}$", VELOCITY)
AMPLITUDE = Measure("amplitude of the free end / $L$", "amplitude of the free end", LENGTH)
DENSITY = Measure(
    "spectral density of $x/L$",
    "spectral density of $x$",
    Unit("m^2/Hz", lambda scales: 2.0 * math.pi * scales.length**2 * scales.time),
)
TRANSVERSE = Measure("transverse $x/L$", "transverse $x$", LENGTH)
ACROSS = Measure("transverse $z/L$", "transverse $z$", LENGTH)
AXIAL = Measure("along the straight pipe $y/L$", "along the straight pipe $y$", LENGTH)
ARC = Measure("arc length $s/L$ from the clamp", "arc length $s$ from the clamp", LENGTH)
GROWTH = Measure(common.REAL_LABEL, common.REAL_LABEL, RATE)
OSCILLATION = Measure(common.IMAGINARY_LABEL, common.IMAGINARY_LABEL, Unit("rad/s", RATE.scale))
REAL_OMEGA = Measure(r"Re $\omega$", r"Re $\omega$", OSCILLATION.unit)
IMAGINARY_OMEGA = Measure(r"Im $\omega$", r"Im $\omega$", RATE)
ROOT_FREQUENCY = Measure(common.FREQUENCY_LABEL, r"|Im $\lambda$| $/2\pi$", FREQUENCY)
OMEGA = Measure(r"angular frequency $\omega$ (nondimensional)", "frequency", FREQUENCY)

PER_FORCE = Unit("m/N", lambda scales: scales.time**2 / (scales.mass * scales.length))
PER_MOMENT = Unit("1/N", lambda scales: scales.time**2 / (scales.mass * scales.length**2))
"""Units of the displacement per force and per moment."""

OF_A_NUMBER = {
    "u": FLOW_SPEED,
    **{name: Measure(f"{one.label} ${one.symbol}$") for name, one in OWN_NUMBERS.items()},
    "beta": Measure(common.BETA_LABEL),
    "damping": Measure(r"damping $\delta$", "damping time", TIME),
    "frequency": Measure("frequency of the forcing", OMEGA.words, OMEGA.unit),
    "amplitude": Measure("amplitude of the forcing"),
}
"""Numbers that axes of boundaries show, by name; all other numbers are looked up in the pipe."""


SYMBOLS = {"mass": "m", "inertia": "J", "stiffness": "k", "coefficient": "c", "gap": "d"}
SYMBOLS |= {"load": "P", "sigma": r"\sigma", "chi": r"\chi"}
SYMBOLS |= {"stiffness_across": "k_z", "coefficient_across": "c_z"}
"""Symbols, in TeX, of the numbers of terms and of the spring at the root."""

SCALES = {(0.0, 0.0): "", (1.0, 0.0): "EI", (0.0, 1.0): r"(\mu_p+\mu_f)"}
SCALES[0.5, 0.5] = r"[EI(\mu_p+\mu_f)]^{1/2}"
"""Products of EI and the mass per length, in TeX, by the powers of these two."""


def of_number(name: str, pipe: Pipe) -> Measure:
    """The measure for a number of a pipe, of one of its terms or of the spring at its root."""
    number = pipe_numbers(pipe, motions=True).get(name)
    if name in OF_A_NUMBER or number is None:
        return OF_A_NUMBER.get(name, Measure(name))
    holder, symbol = number.holder(pipe), SYMBOLS[number.attribute]
    words = re.sub("(?<=[a-z])(?=[A-Z])", " ", type(holder).__name__).lower()
    if not symbol.startswith("\\"):  # a Greek letter is the only number of its term
        words = f"{number.attribute.replace('_', ' ')} of the {words}"
    if name.startswith("terms"):
        words += f" {name.split('.')[0]}"
    mass, length, time = type(holder).__dataclass_fields__[number.attribute].metadata["powers"]
    # T^2 is (mu_p + mu_f) L^4 / EI.
    below, power = SCALES[-0.5 * time, mass + 0.5 * time], length + 2 * time
    arm = "" if power == 0 else "L" if abs(power) == 1 else f"L^{abs(power)}"
    if power > 0:
        below = (f"[{below}{arm}]" if below[0] == "(" else f"({below}{arm})") if below else arm
        arm = ""
    label = f"{words} ${{{symbol}}}{arm}/{below}$"
    return Measure(label, f"{words} ${symbol}$", unit_of_number(name, pipe))


def rate(coordinate: int | str, before: str = "", after: str = "") -> Measure:
    """Rate of change of a coordinate, with words before and after it in the label."""
    words = rf"{before}rate $\dot{{q}}_{{{coordinate}}}${after}"
    return Measure(words, words, RATE)


def of_coordinate(
    coordinate: Any, coordinates: int, words: tuple[str, ...] = ("tip",)
) -> tuple[int | None, Measure]:
    """Index of a coordinate, or None for a word, the free end; and what its axis shows."""
    if isinstance(coordinate, str):
        check.choice("coordinate", coordinate, words)
        return None, TIP
    index = check.count("coordinate", coordinate, low=0, high=coordinates - 1)
    return index, Measure(f"coordinate $q_{{{index}}}$, counted from 0")


class View:
    """Units in which a picture shows the quantities of a pipe, and the words for its end.

    Raises ValueError for units="si" if the pipe has no scales.

    Attributes:
        end: what is shown of the pipe's end, in words: a point of the pipe if the end is held.
        time_unit: "s" or "T".
    """

    def __init__(self, units: Any, pipe: Pipe | None) -> None:
        self.si = check.choice("units", units, ("nondimensional", "si")) == "si"
        self.time_unit = "s" if self.si else "T"
        self._place = ""
        if pipe is not None and pipe.end != "free":
            self._place = f" at $s/L={pipe.tip_place:.3g}$"
        self.end = f"the point{self._place}" if self._place else "the free end"
        self.scales = pipe.scales if self.si and pipe is not None else None
        if self.si and self.scales is None:
            raise ValueError(
                "units must be 'nondimensional' where the pipe has no scales, as one made by "
                "`Pipe.from_si` has them, got 'si'"
            )

    def one(self, quantity: Measure) -> float:
        """The value that is shown for a nondimensional 1 of a quantity."""
        if self.scales is None or quantity.unit is None:
            return 1.0
        return float(quantity.unit.scale(self.scales))

    def label(self, quantity: Measure) -> str:
        """Label of an axis that shows a quantity."""
        unit = quantity.unit if self.si else None
        label = quantity.label if unit is None else quantity.words
        if self._place and "free end" in label:
            label = re.sub("^free end | of the free end", "", label) + self._place
        if unit is None:
            return label
        powers = re.sub(r"\^(-?\d+)", r"$^{\1}$", unit.name)
        return f"{label} ({powers})"

    def axes(self, ax: Axes | None, size: tuple[float, float], x: Measure, y: Measure) -> Axes:
        """The given Axes, or new ones of a size in inches, with the labels of two quantities."""
        return common.axes(ax, size, xlabel=self.label(x), ylabel=self.label(y))

    def speed(self, u: Any, digits: int = 4) -> str:
        """A flow speed in words: a number with some digits, a constant head or a function u(t)."""
        if not isinstance(u, float):
            return "constant head" if isinstance(u, Supply) else "$u(t)$"
        if self.si:
            return f"$V = {u * self.one(FLOW_SPEED):.{digits}g}$ m/s"
        return f"$u = {u:.{digits}g}$"


SHOWN_BETA = 0.04
"""Share of the largest beta in a plane at which the range of speeds in m/s ends, since these grow
without bound towards beta = 0."""


class PlaneView(View):
    """Units in which a picture shows the plane of two numbers.

    If one number is beta and the other u, the SI unit of the flow speed changes across the plane.

    Attributes:
        quantities: the quantities on the x and y axes.
    """

    def __init__(self, units: Any, pipe: Pipe, names: tuple[str, str]) -> None:
        super().__init__(units, pipe)
        self.quantities = of_number(names[0], pipe), of_number(names[1], pipe)
        self._beta = names.index("beta") if {"beta", "u"} == set(names) else None

    def units(self, x: Any, y: Any) -> Array:
        """Values shown for a nondimensional 1 of x and y, shape (2, *shape of x and y)."""
        places = np.asarray([x, y], dtype=float)
        ones = np.empty_like(places)
        ones.T[...] = [self.one(quantity) for quantity in self.quantities]
        if self._beta is not None and self.scales is not None:
            ones[1 - self._beta] = scales_at(places[self._beta], self.scales).speed
        return ones

    def at(self, x: Any, y: Any) -> Array:
        """Points (x, y) in the units shown, shape (2, *shape of x and y)."""
        shown: Array = self.units(x, y) * [x, y]
        return shown

    def limits(self, ranges: Any) -> Array:
        """Limits of the axes that show a window, one row for each axis, shape (2, 2)."""
        edges = np.array(ranges)
        if self._beta is not None:
            edges[self._beta, 0] = max(edges[self._beta, 0], SHOWN_BETA * edges[self._beta, 1])
        corners = self.at(*np.meshgrid(*edges))
        found = np.stack([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))], axis=1)
        if self._beta is not None:
            found[self._beta] = ranges[self._beta]
        return found
