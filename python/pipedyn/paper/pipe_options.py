# SPDX-License-Identifier: MIT
"""Options of the command for the pipe, in nondimensional numbers or in SI units."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import Any

from pipedyn.models.pipe import FLOWS, Pipe
from pipedyn.util import check

UNITLESS_OPTIONS = ("flow", "alpha")
"""Options without a unit, for pipes in nondimensional numbers and in SI units."""

NONDIMENSIONAL_OPTIONS = {
    "beta": ("B", 0.2, "mass ratio in [0, 1)"),
    "gamma": ("G", 0.0, "gravity; negative when the free end stands above the clamp"),
    "damping": ("D", 0.0, "Kelvin-Voigt damping, D >= 0"),
}
"""Options for nondimensional numbers by name: metavariable, default and help."""

SI_OPTIONS = {
    "length": ("L", None, "length, m"),
    "bending-stiffness": ("EI", None, "bending stiffness, N m^2"),
    "youngs-modulus": ("E", None, "in its place: Young's modulus, Pa, with both diameters"),
    "pipe-mass": ("M", None, "mass of the pipe, kg/m"),
    "pipe-density": ("RHO", None, "in its place: density, kg/m^3, with both diameters"),
    "fluid-mass": ("M", None, "mass of the fluid, kg/m"),
    "fluid-density": ("RHO", None, "in its place: density, kg/m^3, with --inner-diameter"),
    "outer-diameter": ("D", None, "outer diameter, m"),
    "inner-diameter": ("D", None, "inner diameter, m"),
    "gravity": ("G", 9.81, "m/s^2; negative when the free end stands above the clamp"),
    "damping-time": ("T", 0.0, "stress is E (strain + T d strain / dt), s"),
}
"""Options for quantities in SI units by name: metavariable, default and help."""


def add_pipe_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the pipe; options with a unit are None if they are not given."""
    usual = "(default: %(default)s)"
    groups = (
        ("nondimensional pipe", None, NONDIMENSIONAL_OPTIONS),
        ("pipe in SI units", "Speeds are then in m/s, frequencies in Hz.", SI_OPTIONS),
    )
    for title, text, options in groups:
        add = parser.add_argument_group(title, text).add_argument
        for name, (metavar, default, words) in options.items():
            words += "" if default is None else f" (default: {default:g})"
            add(f"--{name}", type=float, metavar=metavar, help=words)
    add = parser.add_argument_group("pipe, in either units").add_argument
    text = f"end coefficient, A >= 0: of nozzle or inlet {usual}"
    add("--alpha", type=float, default=1.0, metavar="A", help=text)
    add("--flow", choices=FLOWS, default="ejecting", help=f"direction {usual}")


def taken_pipe(given: dict[str, Any]) -> Pipe:
    """Makes the pipe from its options, and removes the options from `given`.

    Raises:
        ValueError: if numbers are out of range, if options in both kinds of units are given, or if
            there are too few or too many options.
    """
    both = {name: given.pop(name) for name in UNITLESS_OPTIONS}
    numbers, measured = (
        {name: value for name in names if (value := given.pop(name.replace("-", "_"))) is not None}
        for names in (NONDIMENSIONAL_OPTIONS, SI_OPTIONS)
    )
    if not measured:
        defaults = {name: default for name, (_, default, _) in NONDIMENSIONAL_OPTIONS.items()}
        return Pipe(**(defaults | numbers), **both)
    if numbers:
        raise ValueError(
            f"argument --{next(iter(numbers))}: is nondimensional and cannot be given with "
            f"--{next(iter(measured))}, which is in SI units"
        )
    return Pipe.from_si(**_quantities(measured), **both)


def _quantities(measured: Mapping[str, float]) -> dict[str, Any]:
    """Arguments of `Pipe.from_si` from the options in SI units."""
    left = dict(measured)

    def needed(name: str, why: str) -> float:
        if name not in measured:
            raise ValueError(f"argument --{name}: must be given {why}")
        left.pop(name, None)
        bounds: dict[str, Any] = {"low": 0.0, "high": 1e15, "open_low": True}
        return check.real(f"argument --{name}:", measured[name], **bounds)

    def either(name: str, other: str, factor: Any) -> float:
        """A quantity given directly, or as a property of the material times one of the section.

        The property of the section is `factor` of the words that say why it is needed.
        """
        if name in measured and other in measured:
            raise ValueError(f"argument --{other}: cannot be given with --{name}")
        if other in measured:
            return needed(other, "") * float(factor(f"with --{other}"))
        return needed(name, f"in SI units, or --{other}")

    def section(power: int, why: str) -> float:
        """D^power - d^power, from the outer and inner diameters."""
        outer, inner = needed("outer-diameter", why), needed("inner-diameter", why)
        if outer <= inner:
            raise ValueError(
                "argument --outer-diameter: must be above --inner-diameter, got "
                f"{outer:g} and {inner:g}"
            )
        return outer**power - inner**power

    found: dict[str, Any] = {
        "length": needed("length", "in SI units"),
        "bending_stiffness": either(
            "bending-stiffness", "youngs-modulus", lambda why: math.pi / 64.0 * section(4, why)
        ),
        "pipe_mass": either(
            "pipe-mass", "pipe-density", lambda why: math.pi / 4.0 * section(2, why)
        ),
        "fluid_mass": either(
            "fluid-mass",
            "fluid-density",
            lambda why: math.pi / 4.0 * needed("inner-diameter", why) ** 2,
        ),
    }
    for name in ("gravity", "damping-time"):
        if name in left:
            found[name.replace("-", "_")] = left.pop(name)
    if left:
        raise ValueError(
            f"argument --{next(iter(left))}: has no part where bending stiffness and masses are "
            "given"
        )
    return found
