# SPDX-License-Identifier: MIT
"""Options of the command for the pipe, in nondimensional numbers or in SI units."""

from __future__ import annotations

import argparse
from typing import Any

from pipedyn.models.pipe import FLOWS, Pipe

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
    "pipe-mass": ("M", None, "mass of the pipe, kg/m"),
    "fluid-mass": ("M", None, "mass of the fluid, kg/m"),
    "gravity": ("G", 9.81, "m/s^2; negative when the free end stands above the clamp"),
    "damping-time": ("T", 0.0, "stress is E (strain + T d strain / dt), s"),
}
"""Options for quantities in SI units by name: metavariable, default and help. Those without a
default must all be given."""


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
            there are too few.
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
    for name, (_, default, _) in SI_OPTIONS.items():
        if default is None and name not in measured:
            raise ValueError(f"argument --{name}: must be given in SI units")
    of_names = {name.replace("-", "_"): value for name, value in measured.items()}
    return Pipe.from_si(**of_names, **both)
