# SPDX-License-Identifier: MIT
"""Bounds on the modes that the flow and the loads of a pipe can make unstable."""

from __future__ import annotations

import math
from itertools import pairwise

from pipedyn.models.pipe import Pipe

LEAST_WITHIN = 12
"""Number of modes that are tracked beyond the bound on those that can become unstable."""

LARGE_GRAVITY = 100.0
"""Value of gamma beyond which weight sets the scale of flow speeds. As measured at beta 0.05 to
0.8, critical speeds at this gamma are 1.6 to 1.9 times those without weight; beyond, they grow
about like gamma^(1/3)."""


def is_overdamped(pipe: Pipe, mode: int) -> bool:
    """Whether damping is so strong that modes from this number on do not oscillate at rest.

    Their real roots cluster at -1 / damping, where those of different modes meet, so that the
    number of a mode that comes from there is a convention and depends on the model.
    """
    return pipe.damping * (math.pi * mode) ** 2 > 2.0


class Reach:
    """Bounds on what the flow and loads can do to a pipe, by which searches are planned.

    Args:
        pipe: the pipe.

    Attributes:
        weight: upper bound of the weight of the pipe and the masses on it, in EI / L^2.
        tension: axial force at the root due to weight and loads, in EI / L^2; negative if it
            compresses the pipe.
        compression: upper bound of compressive loads, in EI / L^2.
        softness: factor <= 1 on flow speeds by the least stiffness, at equal wave lengths.
        thrust: largest of 1 and the factor of u^2 in the stiffness.
    """

    def __init__(self, pipe: Pipe) -> None:
        self.pipe = pipe
        mass = 1.0 if pipe.mass is None else pipe.mass.bounds[1]
        for term in pipe.terms:
            mass += getattr(term, "mass", 0.0)
        pulls, pushes = pipe.axial_loads
        self.weight = pipe.axial_gravity * mass
        self.tension = self.weight + pulls - pushes
        self.compression = pushes + max(-self.weight, 0.0)
        least = 1.0 if pipe.stiffness is None else pipe.stiffness.bounds[0]
        self.softness = math.sqrt(min(1.0, least))
        self.thrust = max(pipe.alpha, 1.0)

    def before_cluster(self) -> int:
        """Number of modes among whose roots a search for few meets no cluster at -1 / damping.

        Their (damping omega)^2 is below 0.9, and four modes fewer count, as a search also examines
        roots beyond those asked for.
        """
        return math.floor(math.sqrt(0.9 / max(self.pipe.damping, 1e-15)) / math.pi) - 4

    def speed_scale(self, large_gravity: float = LARGE_GRAVITY) -> float:
        """Flow speed with the effect on the pipe that u = 1 has on a light pipe without supports.

        Near the free end of a heavy hanging pipe, where weight stretches it little, lengths scale
        with gamma^(-1/3) and flow speeds with gamma^(1/3).
        """
        supports, longest = self.pipe.supports, 1.0
        if supports:
            longest = max(high - low for low, high in pairwise([0.0, *supports, 1.0]))
        of_weight = math.cbrt(1.0 + max(self.pipe.axial_gravity, 0.0) / large_gravity)
        return of_weight * self.softness / (longest * math.sqrt(self.thrust))

    def wave_number(self, max_speed: float) -> float:
        """Upper bound of the wave numbers at which flow and compressive loads exceed the stiffness.

        Tension is not counted, so that this is a bound. Flow forces proportional to velocities act
        up to wave numbers of about u, which the bound includes.
        """
        return math.sqrt(self.thrust * max_speed**2 + self.compression)

    def modes_reached(self, max_speed: float) -> float:
        """Number of modes whose stiffness flow and compressive loads can exceed, and two more."""
        return self.wave_number(max_speed) / (math.pi * self.softness) + 2.0

    def modes_within(self, max_speed: float) -> int:
        """Bound on the number of modes that flow and loads can make unstable, and some more.

        About k / pi modes lie below the wave number k at which the remaining stiffness is 0; the
        bound is k, some three times as many.
        """
        return LEAST_WITHIN + math.ceil(self.wave_number(max_speed) / self.softness)
