# SPDX-License-Identifier: MIT
"""What axes show: labels of quantities, and second axes in SI units where a pipe has scales."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Literal

from matplotlib.axes import Axes

from pipedyn.models.pipe import Pipe, Scales
from pipedyn.models.pipe_numbers import pipe_numbers
from pipedyn.models.supports import RootSpring
from pipedyn.models.terms import Term
from pipedyn.plot import common


@dataclass(frozen=True)
class Quantity:
    """What an axis shows.

    Attributes:
        label: of the axis in nondimensional units.
        si_label: of the axis in SI units; empty where the quantity has no unit.
        unit: SI value of one.
    """

    label: str
    si_label: str = ""
    unit: Callable[[Scales], float] = lambda scales: 1.0


SPEED = Quantity(common.SPEED_LABEL, "flow speed (m/s)", lambda scales: scales.speed)
TIP = Quantity(common.TIP_LABEL, "free end $x$ (m)", lambda scales: scales.length)
FREQUENCY = Quantity(
    r"angular frequency $\omega$  $(1/T)$",
    "frequency (Hz)",
    lambda scales: 1.0 / (2.0 * math.pi * scales.time),
)

OF_A_NUMBER = {
    "u": SPEED,
    "beta": Quantity(common.BETA_LABEL),
    "gamma": Quantity(r"gravity $\gamma$"),
    "alpha": Quantity(r"end coefficient $\alpha$"),
    "damping": Quantity(r"damping $\delta$", "damping time (s)", lambda scales: scales.time),
    "hysteresis": Quantity(r"loss factor $\mu$"),
    "drag": Quantity(r"drag $\kappa$"),
    "inflow_share": Quantity("inflow share $c$"),
    "frequency": Quantity(r"frequency of the forcing  $(1/T)$", FREQUENCY.si_label, FREQUENCY.unit),
    "amplitude": Quantity("amplitude of the forcing"),
}
"""Of a boundary's axes, by the name of the number; others are looked up in the pipe."""


def of_number(name: str, pipe: Pipe) -> Quantity:
    """A number of a pipe, of one of its terms or of the root's spring, by its name."""
    if name in OF_A_NUMBER:
        return OF_A_NUMBER[name]
    label = "stiffness of the root $(EI/L)$" if name == "root.stiffness" else name
    number = pipe_numbers(pipe).get(name)
    holder: Any = pipe.root if name == "root.stiffness" else None
    if number is not None and number.term is not None:
        holder = pipe.terms[number.term]
    if number is None or not isinstance(holder, Term | RootSpring):
        return Quantity(label)
    (item,) = (item for item in fields(holder) if item.name == number.attribute)
    mass, length, time = item.metadata["powers"]

    def value(scales: Scales) -> float:
        return math.prod(map(pow, (scales.mass, scales.length, scales.time), (mass, length, time)))

    # Masses are counted per length.
    powers = zip(("kg", "m", "s"), (mass, length - mass, time), strict=True)
    unit = " ".join(
        f"{unit}$^{{{power}}}$" if power != 1 else unit for unit, power in powers if power
    )
    return Quantity(label, f"{name} ({unit})" if unit else name, value)


def rate(coordinate: int, before: str = "", after: str = "") -> Quantity:
    """Of change of a coordinate, with words before and after it in the label."""
    words = rf"{before}rate $\dot q_{{{coordinate}}}$"
    return Quantity(f"{words}  $(1/T)${after}", f"{words} (1/s)", lambda scales: 1.0 / scales.time)


def second_axis(ax: Axes, along: Literal["x", "y"], shown: Quantity, pipe: Pipe) -> None:
    """An axis in SI units on the other side, where the pipe has scales and the quantity a unit."""
    if pipe.scales is None or not shown.si_label:
        return
    one = shown.unit(pipe.scales)

    def to_si(value: Any) -> Any:
        return value * one

    def from_si(value: Any) -> Any:
        return value / one

    if along == "x":
        ax.secondary_xaxis("top", functions=(to_si, from_si)).set_xlabel(shown.si_label)
        ax.tick_params(top=False, which="both")
    else:
        ax.secondary_yaxis("right", functions=(to_si, from_si)).set_ylabel(shown.si_label)
        ax.tick_params(right=False, which="both")
