# SPDX-License-Identifier: MIT
"""The pipe: a set of nondimensional numbers, and its conversion from and to SI."""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.models.profile import Along, Profile, checked_profile, mixed
from pipedyn.models.scales import (
    SI_QUANTITIES,
    Phase,
    Scales,
    SIQuantity,
    beyond,
    checked_phases,
    like_water,
    likely_slip,
    mixture_of,
    repr_of,
    scales_at,
    si_number,
    unusual,
    without_quantities,
)
from pipedyn.models.supports import (
    ENDS,
    GOLDEN,
    End,
    Root,
    RootSpring,
    checked_root,
    checked_supports,
)
from pipedyn.models.terms import (
    AddedMass,
    Load,
    PointMass,
    Term,
    Weight,
    checked_terms,
    converted,
    in_range,
    with_roots,
)
from pipedyn.util import check
from pipedyn.util.archive import Saved, saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import warn_of_number, warn_of_pipe
from pipedyn.util.hints import unknown_argument
from pipedyn.util.result import TIME, Unit

Flow = Literal["ejecting", "aspirating"]
FLOWS = ("ejecting", "aspirating")


@dataclass(frozen=True)
class OwnNumber:
    """Description of a number of the pipe, for code that treats all numbers alike.

    Attributes:
        label: name of the number in a label.
        symbol: its symbol in TeX; a Greek letter is given by its name.
        bounds: allowed range (low, high), wider than any pipe's and far from overflow.
        slider: range of a slider, extended if the pipe's own number lies outside; None if only a
            number that is not at its default gets a slider.
        flow: the direction of flow to which the number is limited; empty if it applies to both.
        no_linear_effect: why the number does not enter small motions about the straight pipe; empty
            if it does.
        no_nonlinear_effect: why the number does not enter motions in time; empty if it does.
        unit: SI unit; None if it has none.
        effect: name of the effect that the pipe lacks if the number has its default; `relevant`
            switches the effect off by setting the default. Empty for a number such as gamma, whose
            effect, gravity, is switched off by 0: accuracy/effects.py names these effects.
        open_high: whether the upper bound itself is not allowed.
        usual: range outside which no pipe's number lies.
    """

    label: str
    symbol: str
    bounds: tuple[float, float]
    slider: tuple[float, float] | None = None
    flow: str = ""
    no_linear_effect: str = ""
    no_nonlinear_effect: str = ""
    unit: Unit | None = None
    effect: str = ""
    open_high: bool = False
    usual: tuple[float, float] = (-math.inf, math.inf)

    @property
    def rule(self) -> dict[str, Any]:
        """The allowed range as arguments of `check.real`."""
        return {"low": self.bounds[0], "high": self.bounds[1], "open_high": self.open_high}

    def excluded(self, motions: bool) -> str:
        """Why the number has no effect on finite (if `motions`) or small motions; "" if it has."""
        return self.no_nonlinear_effect if motions else self.no_linear_effect

    @property
    def ascii(self) -> str:
        """The symbol in ASCII, without TeX's backslash."""
        return self.symbol.removeprefix("\\")


OWN_NUMBERS = {
    "beta": OwnNumber("mass ratio", r"\beta", (0.0, 1.0), (0.02, 0.95), open_high=True),
    "gamma": OwnNumber("gravity", r"\gamma", (-1e6, 1e6), (-20.0, 60.0)),
    "alpha": OwnNumber(
        "end coefficient",
        r"\alpha",
        (0.0, 1e6),
        (0.0, 2.0),
        effect="end coefficient",
        usual=(0.0, 100.0),  # nozzles contract to a tenth of the diameter
    ),
    "drag": OwnNumber(
        "drag", r"\kappa", (0.0, 1e9), no_linear_effect="drag has no part in small motions"
    ),
    "damping": OwnNumber(  # at 1 no mode of a cantilever oscillates
        "damping", r"\delta", (0.0, 1e6), (0.0, 0.05), unit=TIME, usual=(0.0, 1.0)
    ),
    "hysteresis": OwnNumber(
        "loss factor",
        r"\mu",
        (0.0, 1e3),
        (0.0, 0.2),
        no_nonlinear_effect="a pipe with hysteresis has no equation of motion in time",
        usual=(0.0, 1.5),  # sheets made to damp have a loss factor of 1
    ),
    "inflow_share": OwnNumber(
        "inflow share", "c", (0.0, 1.0), (0.0, 1.0), flow="aspirating", effect="inflow"
    ),
    "jet_angle": OwnNumber(
        "jet angle",
        r"\psi",
        (-math.pi, math.pi),
        flow="ejecting",
        effect="jet angle",
        usual=(-0.5 * math.pi, 0.5 * math.pi),  # a nozzle does not point backward
    ),
    "rotary_inertia": OwnNumber(  # 1/16 for a solid rod as thick as long
        "rotary inertia", "J", (0.0, 1e3), effect="rotary inertia", usual=(0.0, 0.1)
    ),
    "inclination": OwnNumber(
        "inclination",
        r"\iota",
        (-math.pi, math.pi),
        effect="inclination",
    ),
}
"""The numbers of a pipe by argument name, in the order of `own_numbers` in pipe.hpp."""

SI_QUANTITIES.update(
    {
        name: SIQuantity("dimensionless", OWN_NUMBERS[name].rule, usual=OWN_NUMBERS[name].usual)
        for name in ("alpha", "inflow_share", "hysteresis")
    },
    nozzle_ratio=SIQuantity(
        "dimensionless", OWN_NUMBERS["alpha"].rule | {"open_low": True}, usual=(0.05, 100.0)
    ),
    **{
        name: SIQuantity(
            "rad", OWN_NUMBERS[name].rule, {"degrees": math.pi / 180.0}, OWN_NUMBERS[name].usual
        )
        for name in ("jet_angle", "inclination")
    },
)

USUAL_NUMBERS = {
    name: one.usual for name, one in OWN_NUMBERS.items() if math.isfinite(one.usual[1])
}
"""Ranges outside which no pipe's own number lies."""

FROM_SI = "alpha", "damping", "rotary_inertia"
"""Those that a pipe in SI finds from other arguments, which are judged then."""

BEAM = "bending_stiffness", "pipe_mass", "fluid_mass"
TUBE = "outer_diameter", "inner_diameter", "youngs_modulus", "density", "fluid_density"
"""Arguments in SI that describe the pipe's section."""


@saved_as("Pipe", added=("rotary_inertia", "phases", "inclination"))
@dataclass(frozen=True)
class Pipe(Saved):
    """A pipe conveying fluid, by default a cantilever, described by nondimensional numbers.

    The units are the length L, the mass per length mu_p + mu_f (pipe and fluid) and the bending
    stiffness EI. So the unit of time is L^2 sqrt((mu_p + mu_f) / EI); that of flow speed u is
    sqrt(EI / mu_f) / L. If EI or mu_p varies along the pipe, the units use the values at the root;
    the bore is uniform.

    Attributes:
        beta: mass ratio mu_f / (mu_p + mu_f), 0 <= beta < 1.
        gamma: gravity g L^3 (mu_p + mu_f) / EI, less the buoyancy of a fluid around the pipe;
            negative when the free end stands above the clamp.
        flow: "ejecting" (out of the free end) or "aspirating" (into it).
        alpha: end coefficient >= 0, the factor of u^2 in the centrifugal term, see
            `end_coefficient`. It depends on the nozzle, the diffuser or the outlet's profile of an
            ejecting pipe, and on the inlet of an aspirating one.
        drag: quadratic drag kappa = rho_e C_D d_e L / (2 (mu_p + mu_f)) >= 0; it does not enter the
            linear analysis.
        damping: Kelvin-Voigt damping delta >= 0; EI becomes EI (1 + delta d/dtau), with tau the
            nondimensional time.
        hysteresis: loss factor mu >= 0 of the material, the same at every frequency. EI becomes EI
            (1 + i mu) for oscillations exp(lambda tau) with Im lambda > 0, and its conjugate for Im
            lambda < 0. It applies to linear analysis only, as it has no equation of motion. It does
            not change divergence, as a static load has no loss. See `equivalent_damping`.
        inflow_share: for an aspirating pipe, share c in [0, 1] of the free end's velocity that the
            fluid has before it enters: 1 if it already moves with the free end, as Orsino and Di
            Giulio assume, 0 if it is drawn from rest. The free end gives it the remaining velocity,
            which damps the pipe: the energy that flows through the end is multiplied by c.
        jet_angle: for an ejecting pipe, angle psi in rad, in [-pi, pi], from the tangent at the
            free end to the jet of an inclined nozzle. The jet leaves at theta(1) + psi from the
            downward vertical, theta(1) being the tangent's angle. Such a pipe rests bent, see
            `equilibria`; the straight pipe is no equilibrium with flow.
        rotary_inertia: J >= 0, moment of inertia per length of a cross-section about the axis
            across the plane of motion, in units of (mu_p + mu_f) L^2, including the part of the
            fluid that turns with the pipe. It is uniform along the pipe, and 0 for a slender pipe.
        inclination: angle iota in rad, in [-pi, pi], from the downward vertical to the clamp's
            axis: 0 for a pipe that hangs, pi / 2 for a level one, pi for one that stands, which is
            also a hanging one with -gamma. The axes x and y stay across and along the clamp's axis,
            so that gravity has the direction (sin iota, cos iota). Unless it hangs or stands, such
            a pipe rests bent.
        terms: other forces on the pipe, such as `PointMass` and `Spring`: a sequence of at most 400
            terms, kept as a tuple.
        root: support at s = 0: "clamped", "pinned" (a hinge) or a `RootSpring`, a hinge with a
            rotational spring.
        end: support at s = 1: "free", "guided" (it keeps its direction and slides across), "pinned"
            (a hinge on the axis of the straight pipe) or "clamped" (on the axis, in its direction).
            A pinned or clamped end slides along the axis.
        supports: arc lengths in L of rigid supports, hinges on the axis along which the pipe
            slides; at most 100, each in (0, 1), kept as an ascending tuple.
        stiffness: bending stiffness along the pipe in units of that at the root: a function from
            arc lengths s (p,) to values (p,), or a `Profile`, which may have jumps; 1 at s = 0.
            None if it is uniform. Damping is proportional to it. Kept as a `Profile`.
        mass: mass per length along the pipe, including the uniform mass of the fluid, in the same
            form as stiffness; nowhere below beta.
        phases: phases of a mixture in the pipe, by which numbers in SI tell their speeds and flow
            rates; empty for a single fluid. `from_si` and `from_tube` take them and find the other
            numbers from them; they are kept as a tuple. With another beta, all their densities
            change in proportion.
        scales: values in SI of the units, or None for a pipe not made with `from_si` or
            `from_tube`.

    Example:
        >>> hanging = pp.Pipe(beta=0.2, gamma=10.0, terms=[pp.PointMass(at=1.0, mass=0.1)])
        >>> hanging
        Pipe(beta=0.2, gamma=10, terms=(PointMass(at=1, mass=0.1),))
        >>> round(pp.critical_speed(pp.Chain(hanging, n=10)).speed, 4)
        4.8073

    Raises:
        ValueError: for a number out of its range, NaN or infinity; for an inflow_share other than 1
            of an ejecting pipe, or a jet_angle of an aspirating one.
        TypeError: for an argument that is not a number.

    Source: Orsino and Di Giulio, eqs. (1)-(9); delta, mu and inflow_share are not in the paper. For
    mu: Paidoussis (1970). For inflow_share: Hamilton's principle for open systems (McIver 1973)
    with an inflow of that velocity. For inclined nozzles: Lundgren, Sethna and Bajaj (1979). For
    rotary inertia: Rayleigh, The Theory of Sound, vol. 1, sec. 162. For supported pipes:
    Paidoussis, Fluid-Structure Interactions, vol. 1, ch. 3.
    """

    beta: float
    gamma: float = 0.0
    flow: Flow = "ejecting"
    alpha: float = 1.0
    drag: float = 0.0
    damping: float = 0.0
    hysteresis: float = field(default=0.0, kw_only=True)
    inflow_share: float = field(default=1.0, kw_only=True)
    jet_angle: float = field(default=0.0, kw_only=True)
    rotary_inertia: float = field(default=0.0, kw_only=True)
    inclination: float = field(default=0.0, kw_only=True)
    terms: Sequence[Term] = field(default=(), kw_only=True)
    root: Root = field(default="clamped", kw_only=True)
    end: End = field(default="free", kw_only=True)
    supports: Sequence[float] = field(default=(), kw_only=True)
    stiffness: Profile | None = field(default=None, kw_only=True)
    mass: Profile | None = field(default=None, kw_only=True)
    phases: Sequence[Phase] = field(default=(), kw_only=True, repr=False)
    scales: Scales | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        given = vars(self)
        for name, checked in CHECKS.items():
            if given[name] is not DEFAULTS[name]:
                given[name] = checked(given[name])
        if self.mass is not None and self.mass.bounds[0] < self.beta * (1.0 - 1e-9):
            raise ValueError(
                f"mass must be at least beta = {self.beta:g}, the fluid's part of it, all "
                f"along the pipe, got {self.mass.bounds[0]:.6g}"
            )
        if self.flow == "ejecting" and self.inflow_share != 1.0:
            raise ValueError(
                "inflow_share must be 1 for an ejecting pipe, as no fluid enters at its free end, "
                f"got {check.shown(self.inflow_share)}"
            )
        if self.flow == "aspirating" and self.jet_angle != 0.0:
            raise ValueError(
                "jet_angle must be 0 for an aspirating pipe, as no jet leaves its free end, "
                f"got {check.shown(self.jet_angle)}"
            )
        if self.scales is not None:  # mu_f = beta (mu_p + mu_f), also for a replaced beta
            scales = scales_at(self.beta, self.scales)
            factor = float(mixture_of(self.phases).shares.sum())
            scales = scales._replace(flow_factor=factor)
            given["scales"] = scales._replace(outer_diameter=0.0) if self.stiffness else scales
        elif self.phases:
            raise ValueError(
                "phases must be empty for a pipe without scales, as they are in SI: Pipe.from_si "
                f"and Pipe.from_tube take them, got {check.shown(self.phases)}"
            )
        for i, term in enumerate(self.terms):
            if term.needs_held_end and not self.end_held:
                raise ValueError(
                    f'terms[{i}] stretches a pipe whose end is "pinned" or "clamped", got end '
                    f"{self.end!r}"
                )
            if term.no_motion and not self.rests_straight:
                raise ValueError(
                    f"terms[{i}] must act on a pipe that rests straight, got a load, a jet or "
                    f"gravity across it: {term.no_motion}"
                )
            others = (one.has_fluid_around for one in self.terms)
            if term.no_motion and sum(others) > 1:
                raise ValueError(
                    f"terms[{i}] must be the only one with the mass of the fluid around the pipe, "
                    f"such as AddedMass from an added_mass_coefficient, got {self.terms!r}"
                )
        own = {
            name: value
            for name, (low, high) in USUAL_NUMBERS.items()
            if not low <= (value := getattr(self, name)) <= high
            and (self.scales is None or name not in FROM_SI)
        }
        reasons = [
            text
            for name, value in own.items()
            for text in beyond(name, value, USUAL_NUMBERS[name], " rad" * (name == "jet_angle"))
        ]
        if self.terms and self.scales is None:
            masses = (one.mass for one in self.terms if isinstance(one, PointMass))
            reasons += unusual({"heaviest": max(masses, default=0.0)})
        if reasons:
            angle = {name: value for name, value in own.items() if name == "jet_angle"}
            warn_of_pipe(reasons, likely_slip(angle, lambda one: not unusual(one)), own)

    @classmethod
    def from_si(
        cls,
        *,
        length: float,
        bending_stiffness: float,
        pipe_mass: float,
        fluid_mass: float | None = None,
        phases: Sequence[Phase] = (),
        inner_diameter: float | None = None,
        gravity: float = 9.81,
        drag_coefficient: float = 0.0,
        external_diameter: float = 0.0,
        external_density: float = 0.0,
        added_mass_coefficient: float = 0.0,
        damping_time: float = 0.0,
        hysteresis: float = 0.0,
        flow: Flow = "ejecting",
        alpha: float | None = None,
        nozzle_ratio: float | None = None,
        inflow_share: float = 1.0,
        jet_angle: float = 0.0,
        rotary_inertia: float = 0.0,
        inclination: float = 0.0,
        terms: Sequence[Term] = (),
        root: Root = "clamped",
        end: End = "free",
        supports: Sequence[float] = (),
        stiffness_profile: Along | Profile | None = None,
        mass_profile: Along | Profile | None = None,
    ) -> Pipe:
        """A pipe from measured quantities in SI units, or from quantities of pint in other units.

        For values far outside the range of pipes it brings the warning `UnusualPipe`. `from_tube`
        takes diameters, Young's modulus and densities in place of EI and masses.

        Args:
            length: L, m.
            bending_stiffness: EI, N m^2; at the clamp if it varies.
            pipe_mass: mu_p, kg/m; at the clamp if it varies.
            fluid_mass: mu_f, kg/m, > 0: without fluid there is no unit of flow speed.
            phases: in place of fluid_mass, the phases of a mixture, which fill the bore everywhere
                in the same shares. With M_k the mass per length and V_k the speed of each phase,
                mu_f = sum M_k, V = sum M_k V_k / sum M_k is the speed in m/s of which u is the
                nondimensional one, and alpha is sum M_k sum M_k V_k^2 / (sum M_k V_k)^2 unless it
                is given. `speed_si`, `flow_rate_si` and what they invert convert to and from those
                of each phase.
            inner_diameter: D_i of the bore, m, which must be given with phases, and only then.
            gravity: m/s^2; negative when the free end stands above the clamp, 0 for a pipe that
                moves in a horizontal plane.
            drag_coefficient: C_D of the pipe's outer surface.
            external_diameter: d_e, m.
            external_density: rho_e of the surrounding fluid at rest, kg/m^3. Together with the
                diameter it gives buoyancy: gamma is that of weight minus buoyancy, negative if the
                pipe floats up. A point mass, whose volume is not known, keeps its whole weight: a
                `Weight` is added at its place. With a mass_profile it is allowed only without
                gravity.
            added_mass_coefficient: C_m, which adds an `AddedMass` of C_m rho_e pi d_e^2 / 4. It is
                1 far from walls, (D^2 + d_e^2) / (D^2 - d_e^2) in the middle of a tank of diameter
                D.
            damping_time: eps, s; the material's stress is E (strain + eps d(strain)/dt).
            hysteresis: the material's loss factor.
            flow: "ejecting" or "aspirating".
            alpha: end coefficient, see `end_coefficient`; 1 by default, or that of the phases.
            nozzle_ratio: A / A_j > 0, area of an ejecting pipe's bore over that of its jet, which
                is uniform. It replaces alpha, to which it is equal: above 1 for a nozzle, below 1
                for a diffuser. Give a nozzle's mass as a term. Phases must have the same speed.
            inflow_share: share of the free end's velocity that the fluid has before it enters.
            jet_angle: angle of an inclined nozzle's jet to the tangent at the free end, rad.
            rotary_inertia: density times second moment of area of the pipe's section, kg m,
                including the part of the fluid that turns with it.
            inclination: angle of the clamp's axis to the downward vertical, rad: pi / 2 for a hose
                clamped level at the edge of a table.
            terms: other forces on the pipe, with numbers in SI units and `at` in m; `terms_si`
                returns them.
            root: "clamped", "pinned" or a `RootSpring` with its stiffness in N m/rad.
            end: "free", "guided", "pinned" or "clamped".
            supports: arc lengths of rigid supports, m.
            stiffness_profile: EI along the pipe over that at the clamp, a function of s = x / L
                with x from the clamp, or a `Profile`, as for `Pipe`.
            mass_profile: mu_p, the pipe's own mass without the fluid, along the pipe over that at
                the clamp, given as stiffness_profile is.

        Example:
            >>> hose = pp.Pipe.from_si(
            ...     length=0.45, bending_stiffness=7.3e-3, pipe_mass=0.19, fluid_mass=0.032
            ... )
            >>> round(hose.beta, 4), round(hose.gamma, 3)
            (0.1441, 27.185)
            >>> found = pp.critical_speed(pp.Continuum(hose))
            >>> print(f"{found.in_si().speed:.3f} m/s, {found.in_si().frequency:.3f} Hz")
            7.004 m/s, 2.449 Hz

        Raises:
            ValueError: for a number out of its range, a term beyond the free end, both alpha and
                nozzle_ratio, both fluid_mass and phases or neither, or incomplete surroundings:
                external_diameter and external_density must be given together, and each coefficient
                needs both.
            TypeError: for an argument that is not a number.

        Source for phases: Monette and Pettigrew (2004) for flutter in two-phase flow. The forces
        are those of Paidoussis with a sum over phases of M_k (d/dt + V_k d/dx)^2 w.
        """
        given = locals()
        section = "length", *BEAM, "inner_diameter"
        return cls._from_quantities({name: given[name] for name in section}, given)

    @classmethod
    def from_tube(
        cls,
        *,
        length: float,
        outer_diameter: float,
        inner_diameter: float,
        youngs_modulus: float,
        density: float,
        fluid_density: float | None = None,
        **options: Any,
    ) -> Pipe:
        """The pipe whose section is that of a round tube, for measured quantities in SI units.

        EI = E pi (D_o^4 - D_i^4) / 64, mu_p = rho pi (D_o^2 - D_i^2) / 4 and mu_f = rho_f pi D_i^2
        / 4. The pipe keeps the diameters, so that SI results also give flow rates (`flow_rate` in
        m^3/s, `flow_rate_l_min` in l/min) and, where results know the `curvature`, the bending
        stress of the wall.

        Args:
            length: L, m.
            outer_diameter: D_o, m; also the external diameter, if an external_density is given and
                no external_diameter.
            inner_diameter: D_i, m, less than D_o.
            youngs_modulus: E of the wall, Pa.
            density: rho of the wall, kg/m^3.
            fluid_density: rho_f of the fluid in the tube, kg/m^3; or phases are given in its place.
                From 0.95 to 1.05, where water lies in grams per cubic centimetre and no common gas
                at 1 atm and 0 to 25 degrees, it brings the warning `UnusualPipe`; other densities
                of gases, in which 0.85 may be oil, do not.
            **options: all arguments of `from_si` that have a default there, but fluid_mass.

        Example:
            >>> hose = pp.Pipe.from_tube(
            ...     length=0.5, outer_diameter=12e-3, inner_diameter=8e-3, youngs_modulus=3e6,
            ...     density=1150.0, fluid_density=998.0,
            ... )
            >>> round(hose.beta, 4), round(hose.gamma, 2)
            (0.4098, 61.26)
            >>> found = pp.critical_speed(pp.Continuum(hose)).in_si()
            >>> print(f"{found.speed:.2f} m/s, {found.flow_rate_l_min:.1f} l/min")
            5.08 m/s, 15.3 l/min

        Raises:
            ValueError: as `from_si`, and for an inner diameter that is not less than the outer one,
                or an external_diameter that is.
            TypeError: for an argument that is not a number, or an option that `from_si` lacks.
        """
        given = locals()
        optional = inspect.signature(cls.from_si).parameters.values()
        defaults = {
            one.name: one.default
            for one in optional
            if one.default is not one.empty and one.name not in (*BEAM, *TUBE)
        }
        section = {name: given[name] for name in ("length", *TUBE)}
        if unknown := unknown_argument("pp.Pipe.from_tube", options, [*section, *defaults]):
            raise TypeError(unknown)
        return cls._from_quantities(section, defaults | options)

    @classmethod
    def _from_quantities(cls, section: Mapping[str, Any], options: Mapping[str, Any]) -> Pipe:
        """The pipe from its length and section, and the arguments of `from_si` with defaults."""
        phases, of_tube = checked_phases(options["phases"]), "density" in section
        mixture = mixture_of(phases)
        fluid = "fluid_density" if of_tube else "fluid_mass"
        if (section[fluid] is None) != bool(phases):
            raise ValueError(
                f"{fluid} or phases must be given, not both, got {check.shown(section[fluid])} and "
                f"{len(phases)} phases"
            )
        if not of_tube and (section["inner_diameter"] is None) == bool(phases):
            raise ValueError(
                "inner_diameter must be given with phases, whose bore it is, and only then, got "
                f"{check.shown(section['inner_diameter'])} and {len(phases)} phases"
            )
        absent = (fluid,) if phases else () if of_tube else ("inner_diameter",)
        si = {k: si_number(k, value) for k, value in section.items() if k not in absent}
        if phases:
            si["fluid_density"] = si_number("fluid_density", mixture.density)
        if of_tube and si["inner_diameter"] >= si["outer_diameter"]:
            raise ValueError(
                f"inner_diameter must be less than outer_diameter, {si['outer_diameter']:g}, got "
                f"{si['inner_diameter']:g}"
            )
        for name in SI_QUANTITIES:
            left_out = name in ("alpha", "nozzle_ratio") and options[name] is None
            if name not in ("length", *BEAM, *TUBE) and not left_out:
                si[name] = si_number(name, options[name])
        if si["external_density"] and not si["external_diameter"]:
            si["external_diameter"] = si.get("outer_diameter", 0.0)
        if 0.0 < si["external_diameter"] < (1.0 - 1e-9) * si.get("outer_diameter", 0.0):
            raise ValueError(
                f"external_diameter must be at least outer_diameter, {si['outer_diameter']:g}, got "
                f"{si['external_diameter']:g}"
            )
        outside = si["external_diameter"], si["external_density"]
        coefficients = si["drag_coefficient"], si["added_mass_coefficient"]
        if any((*outside, *coefficients)) and not all(outside):
            raise ValueError(
                "external_diameter and external_density must be given together, also where "
                "drag_coefficient or added_mass_coefficient is, "
                f"got {outside[0]!r} and {outside[1]!r}"
            )
        if "nozzle_ratio" in si and "alpha" in si:
            raise ValueError(
                f"alpha or nozzle_ratio must be given, not both, got {si['alpha']:g} and "
                f"{si['nozzle_ratio']:g}"
            )
        if "nozzle_ratio" in si and len({phase.slip for phase in phases}) > 1:
            raise ValueError(
                "nozzle_ratio must be None for phases with different speeds, as their speeds in "
                "the jet do not follow from it: give alpha, sum M_k sum M_k V_k^2 / (sum M_k "
                "V_k)^2 times the factor by which the nozzle raises the thrust, got "
                f"{si['nozzle_ratio']:g}"
            )
        if "nozzle_ratio" in si and options["flow"] != "ejecting":
            raise ValueError(
                f"nozzle_ratio must be that of an ejecting pipe, whose jet it contracts, "
                f"got flow={check.shown(options['flow'])}"
            )
        try:
            units, checked = _numbers_in_si(si)
        except ValueError as error:
            slip = likely_slip(si, _is_usual) if _unusual_in_si(si) else ""
            raise ValueError(f"{error}{slip}") from None
        length, mass = si["length"], units.mass
        terms, root = options["terms"], options["root"]
        if isinstance(terms, tuple | list):
            terms = [
                without_quantities(f"terms[{i}]", one) if isinstance(one, Term) else one
                for i, one in enumerate(terms)
            ]
        terms = checked_terms(terms, length, in_si=True)
        terms = [with_roots(one, operator.mul) for one in terms]
        given = [converted(one, units, operator.truediv) for one in terms]
        heaviest = max((one.mass for one in given if isinstance(one, PointMass)), default=0.0)
        displaced, (stiffness, pipe_mass, _) = _displaced(si), _rigidity_and_masses(si)
        buoyancy = si["gravity"] * length**3 * displaced / stiffness  # its part in gamma
        iota = si["inclination"]
        given += [
            Load(at=one.at, force=(whole * math.sin(iota), whole * math.cos(iota)))
            if iota
            else Weight(at=one.at, load=whole)
            for one in given
            if isinstance(one, PointMass) and (whole := buoyancy * one.mass)
        ]
        if si["added_mass_coefficient"]:
            causes = "added_mass_coefficient, external_diameter, external_density and the masses"
            share = displaced / mass * si["added_mass_coefficient"]
            given.append(AddedMass(check.real(f"added mass from {causes}", share, high=1e6)))
        own = checked_profile("mass_profile", options["mass_profile"])
        if own is not None and displaced and si["gravity"]:
            raise ValueError(
                "mass_profile must be None in a fluid that bears part of the weight, or gravity 0: "
                "buoyancy is uniform along the pipe, the weight of such a pipe is not, got "
                f"external_density = {si['external_density']:g}"
            )
        source = " from its SI value, length, bending_stiffness and the masses"
        if isinstance(root, RootSpring):
            root = converted(without_quantities("root", root), units, operator.truediv)
            root = checked_root(root, source)
        supports = check.in_unit("supports", options["supports"], "m")
        supports = checked_supports(supports, length, in_si=True)
        made = cls(
            **checked,
            flow=options["flow"],
            alpha=si.get("nozzle_ratio", si.get("alpha", mixture.momentum)),
            **{k: si[k] for k in ("hysteresis", "inflow_share", "jet_angle", "inclination")},
            terms=in_range(tuple(given), source),
            root=root,
            end=options["end"],
            supports=tuple(s / length for s in supports),
            stiffness=checked_profile("stiffness_profile", options["stiffness_profile"]),
            mass=None if own is None else mixed(own, pipe_mass / mass),
            phases=phases,
            scales=units,
        )
        if reasons := _unusual_in_si(si):
            warn_of_pipe(reasons, likely_slip(si, _is_usual))
        if reasons := unusual({"heaviest": heaviest}):
            warn_of_pipe(reasons, ": in kg, not in g?")
        if reasons := unusual({"filled": float((mixture.shares / mixture.speeds).min())}):
            warn_of_pipe(reasons, ": all flow rates in m3/s, none in l/min?")
        return made

    @property
    def direction(self) -> float:
        """Sign s of the flow's velocity: 1 ejecting, -1 aspirating."""
        return -1.0 if self.flow == "aspirating" else 1.0

    @property
    def thrust_across(self) -> float:
        """Transverse load of the jet on the end of the straight pipe, in units of u^2.

        It is 0 if the end is held, and for a jet along the axis.
        """
        across = self.alpha * abs(math.sin(self.jet_angle))
        return 0.0 if self.end_held or across < 1e-15 else across

    @property
    def down(self) -> tuple[float, float]:
        """The direction of gravity: components across and along the clamp's axis.

        They are exact for a pipe that hangs, stands or is level.
        """
        if self.inclination == 0.0:
            return 0.0, 1.0
        both = math.sin(self.inclination), math.cos(self.inclination)
        across, along = (0.0 if abs(x) < 1e-15 else x for x in both)
        return across, along

    @cached_property
    def axial_gravity(self) -> float:
        """Weight per length along the clamp's axis, in EI / L^3."""
        return self.gamma * self.down[1]

    @property
    def sags(self) -> bool:
        """Whether gravity or another dead load acts across the straight pipe, so that it bends."""
        return bool(self.gamma * self.down[0]) or any(one.load_across for one in self.terms)

    @cached_property
    def rests_straight(self) -> bool:
        """Whether no jet, gravity or other load acts across the straight pipe."""
        return not (self.thrust_across or self.sags)

    @cached_property
    def symmetric_about_axis(self) -> bool:
        """Whether the pipe is the same in all directions across its straight axis, as at rest."""
        alike = all(term.symmetric_about_axis for term in self.terms)
        return alike and self.rests_straight and not self.root_across

    def across(self) -> Pipe:
        """The pipe whose terms and root have along x the numbers that these have along z."""
        root = self.root.across() if isinstance(self.root, RootSpring) else self.root
        return replace(self, terms=tuple(term.across() for term in self.terms), root=root)

    @cached_property
    def axial_loads(self) -> tuple[float, float]:
        """Sums of the terms' loads that stretch the straight pipe and that compress it, >= 0."""
        pulls, pushes = 0.0, 0.0
        for term in self.terms:
            pulls += max(term.axial_load, 0.0)
            pushes += max(-term.axial_load, 0.0)
        return pulls, pushes

    @cached_property
    def fed_at_rest(self) -> bool:
        """Whether a term may supply energy to small motions where there is no flow."""
        return any(one.supplies_energy for one in self.terms)

    @cached_property
    def no_motion(self) -> str:
        """Why a term acts in small motions alone; empty if all act in motions of any amplitude."""
        return next((term.no_motion for term in self.terms if term.no_motion), "")

    @property
    def bare(self) -> bool:
        """Whether the pipe is uniform, without terms, inner supports and rotary inertia.

        Weight, damping and drag, which are uniform along the pipe, are allowed. Rotary inertia is
        not, as its share in a mode's inertia grows with the mode.
        """
        varied = self.terms or self.supports or self.stiffness or self.mass
        return not varied and self.rotary_inertia == 0.0

    @property
    def cantilevered(self) -> bool:
        """Whether the pipe is clamped at the root and held nowhere else."""
        return self.root == "clamped" and self.end == "free" and not self.supports

    @property
    def root_stiffness(self) -> float:
        """Stiffness against rotation at the root in EI / L: infinite if clamped, 0 if pinned."""
        if isinstance(self.root, RootSpring):
            return self.root.stiffness
        return math.inf if self.root == "clamped" else 0.0

    @property
    def root_across(self) -> float:
        """What the spring at the root has more for rotation across the plane z = 0, in EI / L."""
        if not isinstance(self.root, RootSpring):
            return 0.0
        return self.root.across().stiffness - self.root.stiffness

    @property
    def end_held(self) -> bool:
        """Whether the end is held on the axis of the straight pipe."""
        return self.end in ("pinned", "clamped")

    @property
    def end_guided(self) -> bool:
        """Whether the end keeps the direction of the straight pipe's axis."""
        return self.end in ("guided", "clamped")

    @property
    def has_kinks(self) -> bool:
        """Whether a force has kinks: drag where a velocity changes sign, a stop at its gap."""
        return self.drag > 0.0 or any(term.kinks for term in self.terms)

    @property
    def tip_place(self) -> float:
        """Arc length in L of the point that stands for the free end, or tip, in results.

        It is the end, unless the end is held across: then it is a point at 0.382 of the longest
        span between supports, where no low mode has a node.
        """
        if not self.end_held:
            return 1.0
        ends = np.array([0.0, *self.supports, 1.0])
        longest = int(np.argmax(np.diff(ends)))
        return float(ends[longest] + GOLDEN * (ends[longest + 1] - ends[longest]))

    def equivalent_damping(self, frequency: float) -> float:
        """Kelvin-Voigt damping that dissipates as much, at one frequency, as all damping.

        At the onset of flutter, the pipe with this damping and without hysteresis is equivalent:

            critical = critical_speed(model)
            delta = pipe.equivalent_damping(critical.frequency)
            moving = replace(pipe, damping=delta, hysteresis=0.0)

        Args:
            frequency: angular, nondimensional, > 0, for instance that of a `CriticalSpeed`; convert
                one in rad/s with `pipe.frequency_from_si(omega)`.

        Returns:
            delta = damping + hysteresis / frequency; `time_si` converts it to the damping_time of
            `from_si`.

        Example:
            >>> hysteretic = pp.Pipe(0.2, damping=1e-3, hysteresis=0.02)
            >>> round(hysteretic.equivalent_damping(10.0), 6)
            0.003

        Raises:
            ValueError, TypeError: for a bad frequency.
        """
        omega = check.real("frequency", frequency, low=1e-100, high=1e100)
        return self.damping + self.hysteresis / omega

    def __repr__(self) -> str:
        if self.scales is None:
            return repr_of(self)
        units = zip(self.scales, ("m", "kg/m", "s", "m/s"), strict=False)
        shown = "units " + ", ".join(f"{value:.6g} {unit}" for value, unit in units)
        if bore := self.scales.inner_diameter:
            shown += f", bore {bore:.6g} m"
        if self.phases:
            shown += f", {len(self.phases)} phases"
        return repr_of(self, shown)

    @property
    def terms_si(self) -> tuple[Term, ...]:
        """The terms with their numbers in SI units.

        Raises:
            ValueError: for a pipe not made with `from_si`.
        """
        units = self._units("terms", "need")
        terms = (converted(term, units, operator.mul) for term in self.terms)
        return tuple(with_roots(term, operator.truediv) for term in terms)

    def _units(self, name: str, need: str = "needs") -> Scales:
        if self.scales is None:
            made = "made with Pipe.from_tube" + " or Pipe.from_si" * (name != "flow rate")
            raise ValueError(f"{name} in SI {need} a pipe {made}, got {self!r}")
        return self.scales

    def speed_si(self, u: ArrayLike, phase: int | None = None) -> Any:
        """Flow speed in m/s from the nondimensional u; a number or an array.

        For a pipe with phases, it is the mean by mass, or the speed of the phase with that index.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).speed_si(3.0)
            6.0
        """
        return scaled_by("u", u, np.multiply, self._speed(phase))

    def speed_from_si(self, V: ArrayLike, phase: int | None = None) -> Any:
        """Nondimensional flow speed u from V in m/s; a number or an array.

        For a pipe with phases, V is the mean by mass, or the speed of the phase with that index.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).speed_from_si(6.0)
            3.0
        """
        return self._speed_given("V", V, self._speed(phase))

    def _speed_given(self, name: str, V: Any, scale: float | None = None) -> Any:
        """Nondimensional flow speed from the speed in m/s of an argument, over that at u = 1."""
        units = self._units(name)
        slips = {} if math.isnan(units.flow_rate) else {"m3/s": units.speed / units.flow_rate}
        scale = units.speed if scale is None else scale
        return scaled_by(name, V, np.divide, scale, "m/s", USUAL_SPEEDS, slips)

    def _speed(self, phase: int | None) -> float:
        """Speed of a phase at u = 1, in m/s; the mean by mass if none is named."""
        if phase is None:
            return self._units("speed").speed
        return float(self.phase_units[0][self._index(phase)])

    def _index(self, phase: int) -> int:
        return check.count("phase", phase, low=0, high=max(len(self.phases) - 1, 0))

    @property
    def phase_units(self) -> Array:
        """Speed (m/s) and flow rate (m^3/s, or NaN) of each phase at u = 1, shape (2, phases)."""
        units, mixture = self._units("speeds", "need"), mixture_of(self.phases)
        speeds = units.speed * mixture.speeds
        return np.stack([speeds, float(units.flow_rate) / units.flow_factor * mixture.shares])

    def flow_rate_si(self, u: ArrayLike, phase: int | None = None) -> Any:
        """Flow rate in m^3/s from the nondimensional flow speed u; a number or an array.

        The pipe must have been made with `from_tube` or with phases. With another beta, its bore
        holds a fluid of another density. The flow rate of a mixture is that of all phases together,
        or of the phase with that index.

        Example:
            >>> hose = pp.Pipe.from_tube(
            ...     length=0.5, outer_diameter=12e-3, inner_diameter=8e-3, youngs_modulus=3e6,
            ...     density=1150.0, fluid_density=998.0,
            ... )
            >>> round(6e4 * hose.flow_rate_si(2.0), 3)  # l/min
            2.666
        """
        return scaled_by("u", u, np.multiply, self._flow_rate(phase))

    def flow_rate_from_si(self, Q: ArrayLike, phase: int | None = None) -> Any:
        """Nondimensional flow speed u from a flow rate in m^3/s; a number or an array.

        The flow rate of a mixture is that of all phases together, or of the phase with that index.

        Example:
            >>> hose = pp.Pipe.from_tube(
            ...     length=0.5, outer_diameter=12e-3, inner_diameter=8e-3, youngs_modulus=3e6,
            ...     density=1150.0, fluid_density=998.0,
            ... )
            >>> round(hose.flow_rate_from_si(15.0 / 6e4), 3)  # 15 l/min
            11.252
        """
        rate, speed = self._flow_rate(phase), self._speed(phase)
        low, high = (one * rate / speed for one in USUAL_SPEEDS)
        return scaled_by("Q", Q, np.divide, rate, "m**3/s", (low, high), FLOW_RATES)

    def _flow_rate(self, phase: int | None) -> float:
        """Flow rate of a phase, or of all phases, at u = 1, in m^3/s."""
        whole = self._units("flow rate").flow_rate
        rate = float(whole if phase is None else self.phase_units[1][self._index(phase)])
        if math.isnan(rate):
            raise ValueError(f"flow rates need a pipe made with Pipe.from_tube, got {self!r}")
        return rate

    def time_si(self, tau: ArrayLike) -> Any:
        """Time in s from the nondimensional tau; a number or an array.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).time_si(1.5)
            3.0
        """
        return scaled_by("tau", tau, np.multiply, self._units("time").time)

    def time_from_si(self, t: ArrayLike) -> Any:
        """Nondimensional time tau from t in s; a number or an array.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).time_from_si(3.0)
            1.5
        """
        return scaled_by("t", t, np.divide, self._units("time").time, "s")

    def frequency_si(self, omega: ArrayLike) -> Any:
        """Angular frequency in rad/s from the nondimensional omega; a number or an array.

        The method `in_si()` of results gives frequencies in Hz, which are this value over 2 pi.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).frequency_si(14.0)
            7.0
        """
        return scaled_by("omega", omega, np.divide, self._units("time").time)

    def frequency_from_si(self, omega_si: ArrayLike) -> Any:
        """Nondimensional angular frequency from rad/s (2 pi times Hz); a number or an array.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).frequency_from_si(7.0)
            14.0
        """
        return scaled_by("omega_si", omega_si, np.multiply, self._units("time").time)

    def length_si(self, s: ArrayLike) -> Any:
        """Length in m from a length in units of L; a number or an array.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).length_si(0.5)
            1.0
        """
        return scaled_by("s", s, np.multiply, self._units("length").length)

    def length_from_si(self, x: ArrayLike) -> Any:
        """Length in units of L from a length in m; a number or an array.

        Example:
            >>> numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
            >>> pp.Pipe.from_si(length=2.0, **numbers).length_from_si(1.0)
            0.5
        """
        return scaled_by("x", x, np.divide, self._units("length").length, "m")


def checked_pipe(pipe: Any) -> Pipe:
    """Returns the argument if it is a pipe; else raises TypeError."""
    checked: Pipe = check.instance("pipe", pipe, Pipe, "a Pipe")
    return checked


def _rigidity_and_masses(si: Mapping[str, float]) -> tuple[float, float, float]:
    """EI, mu_p and mu_f from quantities in SI: as they are, or of a tube."""
    if "fluid_mass" in si:
        return si["bending_stiffness"], si["pipe_mass"], si["fluid_mass"]
    inner = si["inner_diameter"]
    fluid_mass = si["fluid_density"] * 0.25 * math.pi * inner**2
    if "bending_stiffness" in si:
        return si["bending_stiffness"], si["pipe_mass"], fluid_mass
    outer = si["outer_diameter"]
    wall = 0.25 * math.pi * (outer**2 - inner**2)
    stiffness = si["youngs_modulus"] * wall * (outer**2 + inner**2) / 16.0
    return stiffness, si["density"] * wall, fluid_mass


def _displaced(si: Mapping[str, float]) -> float:
    """Mass per length of the fluid that the pipe displaces outside, kg/m."""
    diameter = si["external_diameter"]
    return 0.25 * math.pi * si["external_density"] * diameter * diameter


def _numbers_in_si(si: Mapping[str, float]) -> tuple[Scales, dict[str, float]]:
    """The units, and the pipe's own numbers that follow from quantities in SI, checked."""
    stiffness, pipe_mass, fluid_mass = _rigidity_and_masses(si)
    length, mass, displaced = si["length"], pipe_mass + fluid_mass, _displaced(si)
    outside = "external_diameter, external_density"
    if "bending_stiffness" in si:
        fluid = "fluid_mass" if "fluid_mass" in si else "inner_diameter, phases"
        masses, section = f"pipe_mass and {fluid}", f"pipe_mass, {fluid} and bending_stiffness"
    else:
        masses, section = "the diameters and densities", f"{', '.join(TUBE[:-1])} and {TUBE[-1]}"
    gravity = f"gravity, {outside}" if displaced else "gravity"
    units = Scales(
        length,
        mass,
        length**2 * math.sqrt(mass / stiffness) if stiffness else math.inf,
        math.sqrt(stiffness / fluid_mass) / length if fluid_mass else math.inf,
    )
    if not all(0.0 < unit < math.inf for unit in units[:4]):
        raise ValueError(f"length, {section} must give finite units, got {units[:4]}")
    drag = si["drag_coefficient"] * si["external_diameter"] * si["external_density"]
    numbers = {
        "beta": (fluid_mass / mass, masses),
        "gamma": (
            si["gravity"] * length**3 * (mass - displaced) / stiffness,
            f"{gravity}, length, {section}",
        ),
        "drag": (
            drag * length / (2.0 * mass),
            f"drag_coefficient, {outside}, length and the masses",
        ),
        "damping": (si["damping_time"] / units.time, f"damping_time, length, {section}"),
        "rotary_inertia": (
            si["rotary_inertia"] / (mass * length * length),
            "its SI value, length and the masses",
        ),
    }
    diameters = si.get("outer_diameter", 0.0), si.get("inner_diameter", 0.0)
    return units._replace(outer_diameter=diameters[0], inner_diameter=diameters[1]), {
        name: check.real(f"{name} from {causes}", value, **OWN_NUMBERS[name].rule)
        for name, (value, causes) in numbers.items()
    }


def _unusual_in_si(si: Mapping[str, float]) -> list[str]:
    """What is outside the range of pipes, in quantities in SI and what follows from them."""
    with np.errstate(all="ignore"):  # a refused pipe may have masses of 0 or infinity
        numbers = si = {name: np.float64(value) for name, value in si.items()}
        outer = si.get("outer_diameter", si["external_diameter"])
        length, (stiffness, pipe_mass, fluid_mass) = si["length"], _rigidity_and_masses(si)
        mass = pipe_mass + fluid_mass
        time = length**2 * np.sqrt(mass / stiffness)
        numbers |= {"time": time, "damping": si["damping_time"] / time, "share": fluid_mass / mass}
        numbers["inertia"] = si["rotary_inertia"] / mass / length**2
        if outer:
            numbers["slenderness"] = length / outer
        if "density" in si:
            numbers["material"] = si["youngs_modulus"] / si["density"] ** 2
            numbers["thickness"] = 0.5 * (outer - si["inner_diameter"])
            load = mass / pipe_mass * si["density"] * abs(si["gravity"])
            numbers["stretch"] = load * length / si["youngs_modulus"]
        else:  # the bore of a fluid as heavy as ore in water, as few are heavier
            numbers["bore"] = length / np.sqrt(fluid_mass / (0.25 * math.pi * 4000.0))
            numbers["wall"] = 4.0 * math.pi * stiffness / pipe_mass**2
            numbers["rod"] = length / np.sqrt(pipe_mass / (0.25 * math.pi * 11340.0))
    found = unusual({k: v for k, v in numbers.items() if k not in USUAL_NUMBERS or k in FROM_SI})
    fluids = {k: si[k] for k in ("fluid_density", "external_density") if k in si}
    return found + like_water(**fluids)


def _is_usual(si: Mapping[str, float]) -> bool:
    """Whether quantities in SI describe a pipe in the range of pipes."""
    try:
        _numbers_in_si(si)
    except (ValueError, OverflowError):
        return False
    return not _unusual_in_si(si)


def _checked_scales(scales: Any) -> Scales:
    """Checks a tuple of four positive numbers, and maybe the diameters of a tube; returns it."""
    if not isinstance(scales, tuple) or len(scales) not in (4, 6, 7):
        raise TypeError(f"scales must be a Scales, got {check.shown(scales)}")
    given = Scales(*scales)._asdict().items()
    found = Scales(
        *(check.real(f"scales.{k}", v, low=0.0, open_low="diameter" not in k) for k, v in given)
    )
    if 0.0 < found.outer_diameter <= found.inner_diameter:
        raise ValueError(f"scales.inner_diameter must be less than the outer one, got {found}")
    return found


CHECKS: dict[str, Callable[[Any], Any]] = {
    "flow": partial(check.choice, "flow", options=FLOWS),
    **{name: partial(check.real, name, **one.rule) for name, one in OWN_NUMBERS.items()},
    **{
        name: partial(si_number, name)
        for name in ("alpha", "hysteresis", "inflow_share", "jet_angle", "inclination")
    },
    "terms": lambda terms: in_range(checked_terms(terms)),
    "root": checked_root,
    "end": partial(check.choice, "end", options=ENDS),
    "supports": checked_supports,
    "stiffness": partial(checked_profile, "stiffness"),
    "mass": partial(checked_profile, "mass"),
    "phases": checked_phases,
    "scales": _checked_scales,
}
"""For each field, the function that checks and converts what is given, unless it is the default."""

DEFAULTS = {item.name: item.default for item in fields(Pipe)}


USUAL_SPEEDS = 1e-3, 1e3
"""Flow speeds in m/s of pipes, from creeping ones to those of gases."""

FLOW_RATES = {"l/min": 1e-3 / 60.0, "l/s": 1e-3, "m3/h": 1.0 / 3600.0}
"""Units that users take for m^3/s, with their values in it."""


def scaled_by(
    name: str,
    value: ArrayLike,
    by: np.ufunc,
    scale: float,
    unit: str = "",
    usual: tuple[float, float] = (0.0, math.inf),
    slips: Mapping[str, float] = MappingProxyType({}),
) -> Any:
    """A number or array times or over the SI value of its unit; a quantity of pint in `unit`.

    If the largest number is outside the `usual` range, a warning names those of the units in
    `slips`, with their values, in which it is not.
    """
    if unit:
        value = check.in_unit(name, value, unit)
    numbers = check.numbers(name, value, "a number or an array of numbers", longest=10_000_000)
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be finite, got {check.shown(value)}")
    if slips and (largest := float(np.max(np.abs(numbers), initial=0.0))):
        plain = f" {unit.replace('**', '')}"
        if far := beyond(name, largest, usual, plain):
            found = [word for word, by_ in slips.items() if not beyond("", largest * by_, usual)]
            slip = f": in{plain}, not in {' or '.join(found)}?" if found else ": is the unit right?"
            warn_of_number(far[0] + slip)
    with np.errstate(over="ignore", under="ignore"):
        result = by(numbers.astype(np.float64), scale)
    if not np.isfinite(result).all():
        raise ValueError(f"{name} must be finite after conversion, got {check.shown(value)}")
    return result if numbers.ndim else float(result)
