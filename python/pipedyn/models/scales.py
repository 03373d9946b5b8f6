# SPDX-License-Identifier: MIT
"""Units of length, mass, time and speed in SI, and the quantities in SI that describe a pipe."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, Field, astuple, dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import warn_of_number

SLACK = 1e-9
"""Distance in L by which a place may lie beyond the free end: as much as a chain's lengths may miss
1, far above the rounding of sums of lengths."""


@saved_as("Phase")
@dataclass(frozen=True)
class Phase:
    """One fluid of a mixture that fills a pipe, in SI units or as quantities of pint.

    The phases of a mixture share the bore and keep their shares of it all along the pipe. They may
    have speeds of their own, as gas flows faster than liquid. Their flow rates vary together: only
    the ratios of the flow rates that are given here count, as questions vary the flow speed.

    Attributes:
        density: rho_k, kg/m^3, > 0.
        flow_rate: volume per time Q_k, m^3/s, > 0.
        slip: K_k > 0, speed of the phase over that of a phase with slip 1. If gas with the slip K
            flows with liquid, the gas fills the share 1 / (1 + K Q_l / Q_g) of the bore.

    Raises:
        ValueError: for a number out of its range, NaN or infinity.
        TypeError: for an argument that is not a number.

    Example:
        >>> phases = [pp.Phase(998.0, 2e-4), pp.Phase(1.2, 1e-4, slip=1.5)]  # water and air
        >>> hose = pp.Pipe.from_tube(
        ...     length=0.5, outer_diameter=12e-3, inner_diameter=8e-3, youngs_modulus=3e6,
        ...     density=1150.0, phases=phases,
        ... )
        >>> round(hose.beta, 4), round(hose.alpha, 4)
        (0.3425, 1.0001)
        >>> u = hose.flow_rate_from_si(3e-4)  # of both phases
        >>> print([round(hose.speed_si(u, phase), 3) for phase in (0, 1)], "m/s")
        [5.305, 7.958] m/s
    """

    density: float
    flow_rate: float
    slip: float = 1.0

    def __post_init__(self) -> None:
        for name, unit, high in (
            ("density", "kg/m**3", 1e12),
            ("flow_rate", "m**3/s", 1e12),
            ("slip", "dimensionless", 1e6),
        ):
            vars(self)[name] = check.real(
                name, getattr(self, name), low=0.0, high=high, open_low=True, unit=unit
            )
        if found := unusual({"fluid_density": self.density}) + like_water(density=self.density):
            warn_of_number(f"{found[0]}: density in kg/m3, not in g/cm3?")


class Mixture(NamedTuple):
    """What follows from the phases of a mixture, whatever the speed at which they flow together.

    Attributes:
        density: mass of all phases over the volume of the bore, kg/m^3.
        momentum: sum M_k sum M_k V_k^2 / (sum M_k V_k)^2, the end coefficient.
        speeds: speed of each phase over the mean speed by mass, sum M_k V_k / sum M_k.
        shares: flow rate of each phase over the mean speed by mass times the area of the bore.
    """

    density: float
    momentum: float
    speeds: Array
    shares: Array


def mixture_of(phases: Sequence[Phase]) -> Mixture:
    """The mixture of phases; without any, a single fluid whose density counts as 1."""
    density, flow_rate, slip = np.array([astuple(one) for one in phases] or [(1.0, 1.0, 1.0)]).T
    areas = flow_rate / slip
    masses = density * areas / areas.sum()
    mean = float(masses.sum())
    speeds = slip * mean / (masses @ slip)
    momentum = float(masses @ speeds**2) / mean
    return Mixture(mean, momentum, speeds, speeds * areas / areas.sum())


def checked_phases(phases: Any) -> tuple[Phase, ...]:
    """Checks a sequence of at most 20 phases and returns it as a tuple."""
    if not isinstance(phases, tuple | list):
        raise TypeError(f"phases must be a tuple or list of Phase, got {check.shown(phases)}")
    if len(phases) > 20:
        raise ValueError(f"phases must be at most 20, got {len(phases)}")
    return tuple(
        check.instance(f"phases[{k}]", one, Phase, "a Phase") for k, one in enumerate(phases)
    )


@saved_as("Scales", added=("outer_diameter", "inner_diameter", "flow_factor"))
class Scales(NamedTuple):
    """Values in SI of the nondimensional units of a pipe, with the diameters of a tube.

    Example:
        >>> pp.Pipe.from_si(
        ...     length=2.0, bending_stiffness=4.0, pipe_mass=0.75, fluid_mass=0.25
        ... ).scales[:4]
        (2.0, 1.0, 2.0, 2.0)
    """

    length: float
    """L, m"""
    mass: float
    """mu_p + mu_f, kg/m"""
    time: float
    """L^2 sqrt((mu_p + mu_f) / EI), s"""
    speed: float
    """sqrt(EI / mu_f) / L, m/s"""
    outer_diameter: float = 0.0
    """D_o, m; 0 if it is not known or the wall is not uniform"""
    inner_diameter: float = 0.0
    """D_i, m; 0 if it is not known"""
    flow_factor: float = 1.0
    """flow rate of all phases over mean speed by mass times area of the bore; 1 for one fluid"""

    @property
    def flow_rate(self) -> Any:
        """Flow rate at u = 1, m^3/s, of all phases together; NaN if the bore is unknown."""
        bore = 0.25 * math.pi * np.square(self.inner_diameter)
        return self.speed * np.where(bore > 0.0, bore, math.nan) * self.flow_factor

    @property
    def wall_stress(self) -> Any:
        """Largest bending stress at the curvature 1 / L, E D_o / (2 L), Pa; NaN if unknown."""
        outer, inner = np.asarray(self.outer_diameter), np.asarray(self.inner_diameter)
        area_moment = math.pi / 64.0 * (outer**4 - inner**4)
        stiffness = self.mass * np.power(self.length, 4) / np.square(self.time)
        modulus = stiffness / np.where(outer > 0.0, area_moment, math.nan)
        return 0.5 * modulus * outer / self.length


def scales_at(beta: Any, scales: Scales) -> Scales:
    """Scales for another mass ratio, or several, at the same length, EI and total mass."""
    with np.errstate(divide="ignore"):
        speed = scales.length / scales.time / np.sqrt(beta)
    if np.ndim(beta):
        return scales._replace(speed=speed)
    same = beta == 0.0 or math.isclose(speed, scales.speed, rel_tol=1e-9)
    return scales if same else scales._replace(speed=float(speed))


def number(
    high: float,
    *,
    mass: int = 0,
    length: int = 0,
    time: int = 0,
    low: float = 0.0,
    open_low: bool = False,
    root_of: str = "",
    default: Any = MISSING,
) -> Any:
    """Dataclass field of a term's number: its range, and the powers of `Scales` in its SI unit.

    root_of: name of a mass per length of the term, with whose root the nondimensional number grows
    at the same number in SI.
    """
    rule = {"low": low, "high": high, "open_low": open_low}
    powers = {"powers": (mass, length, time), "root_of": root_of}
    return field(default=default, metadata={"range": rule, **powers})


def given_fields(one: Any) -> Iterator[tuple[Field[Any], Any]]:
    """Fields of a term or root spring with their values, without those left at None."""
    for item in fields(one):
        value = getattr(one, item.name)
        if value is not None or item.default is not None:
            yield item, value


def text_of(value: Any) -> str:
    """A value as text, with 12 digits of each number."""
    if isinstance(value, tuple):
        return f"({', '.join(map(text_of, value))}{',' * (len(value) == 1)})"
    return f"{value:.12g}" if isinstance(value, float) else repr(value)


def repr_of(one: Any, *more: str) -> str:
    """A dataclass as text: its fields that are not at their defaults, then `more` texts."""
    shown = {item.name: getattr(one, item.name) for item in fields(one) if item.repr}
    defaults = {item.name: item.default for item in fields(one)}
    told = [f"{name}={text_of(of)}" for name, of in shown.items() if of != defaults[name]]
    return f"{type(one).__name__}({', '.join([*told, *more])})"


# --------------------------------------------------------------------------- descriptions in SI


class SIQuantity(NamedTuple):
    """An argument in SI that describes a pipe.

    Attributes:
        unit: its unit, as pint reads it.
        rule: allowed range, as arguments of `check.real`.
        mistaken: units that users take for it, with their values in it.
        usual: range outside which no pipe's value lies.
    """

    unit: str
    rule: Mapping[str, Any]
    mistaken: Mapping[str, float] = MappingProxyType({})
    usual: tuple[float, float] = (0.0, math.inf)

    @property
    def words(self) -> str:
        """The unit as messages show it, with a space before it; empty if there is none."""
        plain = self.unit.replace("**", "").replace("*", " ")
        return "" if plain == "dimensionless" else f" {plain}"


POSITIVE: dict[str, Any] = {"low": 0.0, "high": 1e12, "open_low": True}
AT_LEAST_0: dict[str, Any] = {"low": 0.0}

MM, MASSES = {"mm": 1e-3, "cm": 1e-2}, {"g/m": 1e-3, "kg/mm": 1e3}

SI_QUANTITIES = {
    "length": SIQuantity("m", POSITIVE, MM, (0.0, 1e4)),
    # Pipes that fetch cold water from the deep sea are 10 m wide.
    **dict.fromkeys(
        ("outer_diameter", "inner_diameter"), SIQuantity("m", POSITIVE, MM, (0.0, 12.0))
    ),
    # From the softest gels to tungsten carbide.
    "youngs_modulus": SIQuantity("Pa", POSITIVE, {"MPa": 1e6, "GPa": 1e9}, (1e3, 1e12)),
    # From light foams to osmium, and for the fluid from thin gases.
    "density": SIQuantity("kg/m**3", POSITIVE, {"g/cm3": 1e3}, (10.0, 2.3e4)),
    "fluid_density": SIQuantity("kg/m**3", POSITIVE, {"g/cm3": 1e3}, (0.01, 2.3e4)),
    "bending_stiffness": SIQuantity("N*m**2", POSITIVE, {"N mm2": 1e-6}),
    **dict.fromkeys(("pipe_mass", "fluid_mass"), SIQuantity("kg/m", POSITIVE, MASSES)),
    # Centrifuges for models of structures reach 500 g.
    "gravity": SIQuantity(
        "m/s**2", {"low": -1e12, "high": 1e12}, {"cm/s2": 1e-2, "mm/s2": 1e-3}, (-5e3, 5e3)
    ),
    # A plate across a flow has 2, a thread in a slow one 10.
    "drag_coefficient": SIQuantity("dimensionless", AT_LEAST_0, usual=(0.0, 20.0)),
    "external_diameter": SIQuantity("m", AT_LEAST_0, MM, (0.0, 12.0)),
    "external_density": SIQuantity("kg/m**3", AT_LEAST_0, {"g/cm3": 1e3}, (0.0, 2.3e4)),
    # In a bore 1 % wider than the pipe it is 100.
    "added_mass_coefficient": SIQuantity("dimensionless", AT_LEAST_0, usual=(0.0, 100.0)),
    # The loss factor is 2 pi damping_time at 1 Hz, as large as 3 at the limit.
    "damping_time": SIQuantity("s", AT_LEAST_0, {"ms": 1e-3}, (0.0, 0.5)),
    "rotary_inertia": SIQuantity("kg*m", AT_LEAST_0),
}
"""Arguments of `Pipe.from_si` and `Pipe.from_tube` by name; the pipe adds its own numbers."""

DERIVED = {
    "time": ("the unit of time, L^2 sqrt((mu_p + mu_f) / EI),", " s", (0.0, 86400.0)),
    "damping": ("damping_time over the unit of time", "", (0.0, 0.2)),
    "slenderness": ("length over the outer diameter", "", (5.0, 2e4)),
    "bore": ("length over the diameter of a bore that holds fluid_mass", "", (5.0, math.inf)),
    "wall": ("4 pi bending_stiffness / pipe_mass^2", " m5/(kg s2)", (0.02, 1.5e6)),
    "material": ("youngs_modulus / density^2", " m5/(kg s2)", (0.02, 1.5e5)),
    "thickness": ("the thickness of the wall", " m", (0.0, 0.15)),
    "rod": ("length over the diameter of a rod of lead as heavy as the pipe", "", (5.0, math.inf)),
    "heaviest": ("the largest point mass over the pipe's mass", "", (0.0, 100.0)),
    "stretch": ("the strain under the weight of the hanging pipe", "", (0.0, 0.2)),
    "share": ("the fluid's share of the mass, beta,", "", (0.0, 0.99)),
    "filled": ("the share of the bore that a phase fills", "", (1e-4, 1.0)),
    "inertia": ("rotary_inertia over mass times length squared", "", (0.0, 0.1)),
}
"""What is derived from these arguments, by name: words, unit and range of pipes.

Motions that take days are no pipe's, nor are loss factors of 4, which damping 0.2 gives at the
second frequency, beams as thick as long and, wider than a wire, ones longer than 2e4 diameters. E /
rho^2 is 0.04 of the softest rubber, but 0.003 of steel with E in MPa, and 1e5 of the stiffest
carbon fibre. A thin tube's 4 pi EI / mu_p^2 is E / rho^2 times its diameter over twice its wall:
1.5e6 for aluminium 1/300 as thick as wide. Walls of pipes that bend reach 0.1 m. Strains above 0.2
change the stiffness. With water in a film of 0.2 mm, 40 mm wide, beta is 0.98. The droplets of a
mist fill 1e-4 of the bore; a flow rate in l/min beside one in m3/s leaves the other phase less."""


WATER = 0.95, 1.05
"""Densities that are taken for those of water or sea water in g/cm3, between 0 and 100 degrees.
In kg/m3 no common gas has them at 1 atm and 0 to 25 degrees: neon has at most 0.90, acetylene at
least 1.06, nitrogen 1.14 and air 1.18. Air has them between 62 and 98 degrees, and at heights of
1600 to 2550 m in the standard atmosphere."""


def si_number(name: str, value: Any) -> float:
    """The value of an argument in SI, checked; the message about a refused one names a slip."""
    one = SI_QUANTITIES[name]
    value = check.in_unit(name, value, one.unit)
    try:
        return check.real(name, value, **one.rule)
    except ValueError as error:
        (low, high), found = one.usual, list[str]()
        with suppress(OverflowError):  # of whole numbers and fractions beyond doubles
            tried = one.mistaken.items() if value else ()
            found = [word for word, by in tried if low <= value * by <= high]
        slip = f": in{one.words}, not in {' or '.join(found)}?" if found else ""
        raise ValueError(f"{error}{slip}") from None


def checked_place(name: str, place: Any, end: float, in_si: bool, open_high: bool) -> float:
    """A place on a pipe of length `end`, checked; one in mm is told from one in m."""
    try:
        return check.real(name, place, low=0.0, high=end, open_low=True, open_high=open_high)
    except ValueError as error:
        slip = ": in m, not in mm?" if in_si and end < place <= 1e3 * end else ""
        raise ValueError(f"{error}{slip}") from None


def unusual(numbers: Mapping[str, float]) -> list[str]:
    """A sentence for each number, given or derived, outside the range of pipes."""
    found = []
    for name, value in numbers.items():
        words, unit, usual = name, "", (-math.inf, math.inf)
        if name in DERIVED:
            words, unit, usual = DERIVED[name]
        elif name in SI_QUANTITIES:
            unit, usual = SI_QUANTITIES[name].words, SI_QUANTITIES[name].usual
        found += beyond(words, value, usual, unit)
    return found


def beyond(words: str, value: float, usual: tuple[float, float], unit: str = "") -> list[str]:
    """A sentence if a number is outside the range of pipes."""
    low, high = usual
    if low <= value <= high:
        return []
    limit = f"at least {low:.3g}" if value < low else f"at most {high:.3g}"
    return [f"{words} is {value:.4g}{unit}, for pipes {limit}{unit}"]


def like_water(**densities: float) -> list[str]:
    """A sentence for each density, by name, that is that of water in another unit."""
    return [
        f"{name} is {value:.4g} kg/m3, which is that of water in g/cm3"
        for name, value in densities.items()
        if WATER[0] <= value <= WATER[1]
    ]


def likely_slip(given: Mapping[str, float], is_usual: Callable[[Mapping[str, float]], bool]) -> str:
    """The question whether arguments are in another unit, if they are usual then; else empty.

    Gravity is tried first, in units in which it is that of the earth, then the first argument, the
    length, then lengths and densities that share a unit, each other argument in the units that
    users take for its own, and more that share one, at last lengths in mm with a modulus in MPa.
    """
    mistaken = {name: SI_QUANTITIES[name].mistaken for name, value in given.items() if value}
    pull = mistaken.pop("gravity", {})
    earthly = [
        {"gravity": word} for word, by in pull.items() if 9.7 < abs(given["gravity"] * by) < 9.9
    ]
    mm, cm, dense, light, short, stiff = (
        {name: word for name, words in mistaken.items() for word in words if word in together}
        for together in (["mm"], ["cm"], ["g/cm3"], ["g/m"], ["kg/mm"], ["mm", "MPa"])
    )
    diameters = [{k: word for k, word in one.items() if "diameter" in k} for one in (mm, cm)]
    single = [  # few use kg/mm, and for both masses; they look like EI in N mm2
        [{name: word} for word in words if word != "kg/mm"] + [short] * ("N mm2" in words)
        for name, words in mistaken.items()
        if name != "inner_diameter"  # in mm it is refused beside an outer one in m
    ]
    every = [earthly, *single[:1], [mm, cm], [dense], *single[1:], diameters, [light], [stiff]]
    for tries in every:
        found = dict[tuple[str, ...], list[dict[str, str]]]()  # by the arguments that are changed
        for one in filter(None, tries):
            by = {k: given[k] * SI_QUANTITIES[k].mistaken[word] for k, word in one.items()}
            if is_usual({**given, **by}):
                found.setdefault(tuple(one), []).append(one)
        questions = []
        for names, each in found.items():
            groups: dict[str, list[str]] = {}
            for k in names:
                words = " or ".join(one[k] for one in each)
                groups.setdefault(f"in{SI_QUANTITIES[k].words}, not in {words}", []).append(k)
            asked = (f"{' and '.join(of)} {unit}" for unit, of in groups.items())
            questions.append(", and ".join(asked))
        if questions:
            return f": {', or '.join(questions)}?"
    return ""


Numbered = TypeVar("Numbered", bound=Any)


def without_quantities(name: str, one: Numbered) -> Numbered:
    """A term or root spring with numbers in SI in place of quantities of pint."""
    numbers = {}
    for item, value in given_fields(one):
        mass, length, time = item.metadata["powers"]  # `Scales` counts masses per length
        powers = zip(("kg", "m", "s"), (mass, length - mass, time), strict=True)
        parts = (base if power == 1 else f"{base}**{power}" for base, power in powers if power)
        unit = "*".join(parts) or "dimensionless"
        numbers[item.name] = check.in_unit(f"{name}.{item.name}", value, unit)
    made: Numbered = replace(one, **numbers)
    return made
