# SPDX-License-Identifier: MIT
"""Terms: laws of force on a pipe in addition to its elasticity, gravity, drag and flow.

A term is a frozen dataclass with the place where it acts, if it acts at one place, and the numbers
of its law. The law (load, mass, inertia, energy and power at a station of the pipe) is in the core
under the term's name, cpp/pipedyn/terms/; the core derives slopes of the load from it. Terms belong
to the pipe, so that every model has them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, cast

import numpy as np

from pipedyn import _core
from pipedyn.models.scales import SLACK, Scales, checked_place, given_fields, number, repr_of
from pipedyn.util import check
from pipedyn.util.archive import saved_as

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

MOST_TERMS = 400
"""Largest number of terms. A reduced model has a panel between each two places: with four functions
each, 400 panels take 1,600 of the 2,000 functions of the largest basis."""


ALONG_Z = "_across"
"""End of the name of a number along z, of motions across the plane z = 0; None: as along x."""


def place() -> Any:
    """The field `at` of a term at one place; the pipe checks that the place lies on it."""
    rule = {"low": 0.0, "open_low": True}
    return field(metadata={"range": rule, "powers": (0, 1, 0)})


@dataclass(frozen=True)
class Term:
    """A law of force on the pipe; base class of all laws, not instantiated itself.

    Raises:
        ValueError: for a number out of its range, NaN or infinity, in any law.
        TypeError: for an argument that is not a number.
    """

    law: ClassVar[str]
    """Name of the law in the core."""

    needs_held_end: ClassVar[bool] = False
    """Whether the law acts only on pipes whose end is held on the axis of the straight pipe."""

    acts_at_end: ClassVar[bool] = False
    """Whether the law acts at the end of the pipe; else at its `at`, or all along the pipe."""

    supplies_energy: ClassVar[bool] = False
    """Whether the law may make small motions grow, with oscillation, where there is no flow."""

    has_fluid_around: ClassVar[bool] = False
    """Whether the law contains the inertia of the fluid around the pipe."""

    no_motion: ClassVar[str] = ""
    """Why the law acts in small motions about the straight pipe alone; empty if in all motions."""

    largest_angle: ClassVar[float] = math.inf
    """Largest angle between the pipe and its straight axis for which the law holds, in rad."""

    def __post_init__(self) -> None:
        if type(self) is Term:
            raise TypeError("Term must be one of its laws, such as PointMass, got Term itself")
        for item, value in given_fields(self):  # the pipe checks upper bounds, which may be in SI
            rule = dict(item.metadata.get("range", {}))
            rule.pop("high", None)
            if rule.get("low", 0.0) < 0.0:
                del rule["low"]
            if not check.is_quantity(value):  # `Pipe.from_si` converts quantities
                object.__setattr__(self, item.name, check.real(item.name, value, **rule))

    __repr__ = repr_of

    @property
    def place(self) -> float | None:
        """Arc length in L where the term acts; None if it acts all along the pipe."""
        return getattr(self, "at", 1.0 if self.acts_at_end else None)

    @property
    def kinks(self) -> tuple[float, ...]:
        """Transverse displacements of the place, in L, at which the slope of the load jumps."""
        return ()

    @property
    def is_felt_by_small_motions(self) -> bool:
        """Whether the law acts on small motions about the straight pipe."""
        return _core.is_felt_by_small_motions(self.law)

    @property
    def axial_load(self) -> float:
        """Load along the straight pipe at rest, in EI / L^2; positive if it stretches the pipe."""
        return 0.0

    @property
    def load_across(self) -> float:
        """Load across the straight pipe at rest, which then bends, in EI / L^2 or per length."""
        return 0.0

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers of the term by name, without its place and without those that are None."""
        return {item.name: value for item, value in given_fields(self) if item.name != "at"}

    @property
    def symmetric_about_axis(self) -> bool:
        """Whether the law is the same in all directions across the straight pipe."""
        numbers = self.numbers
        return all(numbers.get(name + ALONG_Z, one) == one for name, one in numbers.items())

    def across(self) -> Self:
        """The law whose numbers along x are those of this one along z."""
        numbers = self.numbers
        return replace(
            self, **{name: numbers.get(name + ALONG_Z, numbers[name]) for name in numbers}
        )

    def law_numbers(self, damping: float) -> list[float]:
        """Numbers of the law in the core's order, for a pipe with this Kelvin-Voigt damping."""
        found = {item.name: getattr(self, item.name) for item in fields(self) if item.name != "at"}
        each = found.items()
        return [found[key.removesuffix(ALONG_Z)] if one is None else one for key, one in each]

    def laws(self, damping: float, end_turns: bool) -> list[tuple[str, float, list[float]]]:
        """Names of laws in the core with their places (if all along, the mean) and numbers.

        The arguments are the pipe's Kelvin-Voigt damping, and whether its end may turn.
        """
        return [(self.law, self.place or 0.5, self.law_numbers(damping))]


@saved_as("PointMass", added=("inertia",))
@dataclass(frozen=True, repr=False)
class PointMass(Term):
    """A mass at one place of the pipe, with its weight, that moves and turns with the pipe.

    It does not affect the flow: the jet leaves through the pipe's own section. A nozzle or an
    accelerometer fixed to the pipe also has rotary inertia. It turns with the tangent at its place.
    In a chain it turns with the segment on which it lies, or with the segment that ends there.

    Attributes:
        at: arc length of the centre of mass from the clamp in L, 0 < at <= 1.
        mass: >= 0, in units of the pipe's whole mass (mu_p + mu_f) L.
        inertia: moment of inertia about the centre of mass, across the plane of motion, in
            [0, 1000], in units of (mu_p + mu_f) L^3.

    In `Pipe.from_si`: at in m, mass in kg, inertia in kg m^2.

    Source: d'Alembert's principle with the force mass * (acceleration - gamma) at the place and the
    couple -inertia * theta'', theta being the angle of the tangent.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, gamma=10.0, terms=[pp.PointMass(at=1.0, mass=0.1)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        4.8802
    """

    law: ClassVar[str] = "point_mass"
    at: float = place()
    mass: float = number(1e6, mass=1, length=1)
    inertia: float = number(1e3, mass=1, length=3, default=0.0)


@saved_as("Spring", added=("stiffness_across",))
@dataclass(frozen=True, repr=False)
class Spring(Term):
    """A spring between one place of the pipe and the axis of the straight pipe.

    Its force -stiffness * x acts along x only, where x is the transverse displacement of the place;
    it is linear at any amplitude and does not depend on the place's motion along the axis.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        stiffness: >= 0, in EI / L^3.
        stiffness_across: of the force along z, >= 0, in a model in three dimensions; None if it is
            that along x.

    In `Pipe.from_si`: at in m, stiffness in N/m.

    Source: energy stiffness * x^2 / 2, in three dimensions that and stiffness_across * z^2 / 2.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Spring(at=0.5, stiffness=20.0)])
        >>> pipe.terms
        (Spring(at=0.5, stiffness=20),)
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Spring(0.5, 20.0, stiffness_across=100.0)])
        >>> found = pp.crossings(pp.Chain(pipe, 10, dimensions=3), 8.0)
        >>> [round(one.speed, 4) for one in found]
        [5.4382, 5.5037]
    """

    law: ClassVar[str] = "spring"
    at: float = place()
    stiffness: float = number(1e9, mass=1, length=1, time=-2)
    stiffness_across: float | None = number(1e9, mass=1, length=1, time=-2, default=None)


@saved_as("RotationalSpring", added=("stiffness_across",))
@dataclass(frozen=True, repr=False)
class RotationalSpring(Term):
    """A rotational spring between one place of the pipe and the ground.

    Its couple -stiffness * theta acts against the angle theta between the tangent of the pipe and
    the straight axis; it is linear at any amplitude. In a chain theta is the angle of the segment
    on which the place lies, or of the segment that ends there.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1; a spring at the root is `RootSpring`.
        stiffness: >= 0, in EI / L.
        stiffness_across: of rotation across the plane z = 0, >= 0, in a model in three dimensions;
            None if it is that of rotation in the plane.

    In `Pipe.from_si`: at in m, stiffness in N m/rad.

    Source: energy stiffness * theta^2 / 2; in three dimensions (stiffness * a_x^2 +
    stiffness_across * a_z^2) / 2 with the rotation vector (a_x, a_z) of the tangent.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, end="pinned", terms=[pp.RotationalSpring(1.0, 1e9)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        6.2832
    """

    law: ClassVar[str] = "rotational_spring"
    at: float = place()
    stiffness: float = number(1e9, mass=1, length=3, time=-2)
    stiffness_across: float | None = number(1e9, mass=1, length=3, time=-2, default=None)


@saved_as("RotationalDamper", added=("coefficient_across",))
@dataclass(frozen=True, repr=False)
class RotationalDamper(Term):
    """A viscous damper between one place of the pipe and the ground that resists rotation.

    Its couple is -coefficient * theta', where theta' is the rate at which the tangent of the pipe
    turns; it is linear at any amplitude. In a chain theta' is the rate of the segment on which the
    place lies, or of the segment that ends there.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        coefficient: >= 0, in sqrt(EI (mu_p + mu_f)) L.
        coefficient_across: of rotation across the plane z = 0, >= 0, in a model in three
            dimensions; None if it is that of rotation in the plane.

    In `Pipe.from_si`: at in m, coefficient in N m s/rad.

    Source: power -coefficient * theta'^2. In three dimensions the couple resists the angular
    velocity t x t' of the tangent t: its component along z with the coefficient, that along x with
    coefficient_across, and that along y with their mean.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.RotationalDamper(at=0.5, coefficient=0.1)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.5483
    """

    law: ClassVar[str] = "rotational_damper"
    at: float = place()
    coefficient: float = number(1e9, mass=1, length=3, time=-1)
    coefficient_across: float | None = number(1e9, mass=1, length=3, time=-1, default=None)


@saved_as("Damper", added=("coefficient_across",))
@dataclass(frozen=True, repr=False)
class Damper(Term):
    """A viscous damper between one place of the pipe and the ground, across the pipe.

    Its force is -coefficient * x' along x only, where x' is the transverse velocity of the place;
    it is linear at any amplitude.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        coefficient: >= 0, in sqrt(EI (mu_p + mu_f)) / L.
        coefficient_across: of the force along z, >= 0, in a model in three dimensions; None if it
            is that along x.

    In `Pipe.from_si`: at in m, coefficient in N s/m.

    Source: power -coefficient * x'^2, in three dimensions that and -coefficient_across * z'^2.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Damper(at=0.5, coefficient=1.0)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        6.0513
    """

    law: ClassVar[str] = "damper"
    at: float = place()
    coefficient: float = number(1e9, mass=1, length=1, time=-1)
    coefficient_across: float | None = number(1e9, mass=1, length=1, time=-1, default=None)


@saved_as("Foundation", added=("stiffness_across",))
@dataclass(frozen=True, repr=False)
class Foundation(Term):
    """An elastic foundation all along the pipe, made of independent springs.

    Its force per length -stiffness * x acts along x only, where x is the transverse displacement;
    it is linear at any amplitude.

    Attributes:
        stiffness: >= 0, in EI / L^4.
        stiffness_across: of the force along z, as for `Spring`.

    In `Pipe.from_si`: stiffness in N/m^2.

    Source: Winkler's foundation, energy stiffness * x^2 / 2 per length.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Foundation(stiffness=10.0)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.7084
    """

    law: ClassVar[str] = "foundation"
    stiffness: float = number(1e9, mass=1, time=-2)
    stiffness_across: float | None = number(1e9, mass=1, time=-2, default=None)


@saved_as("Viscosity")
@dataclass(frozen=True, repr=False)
class Viscosity(Term):
    """Linear viscous resistance, all along the pipe, of a fluid at rest around it.

    Its force per length -sigma * v_n acts along the pipe's normal, like drag, where v_n is the
    velocity in that direction; motion along the pipe's tangent is free.

    Attributes:
        sigma: >= 0, in sqrt(EI (mu_p + mu_f)) / L^2.

    In `Pipe.from_si`: sigma in N s/m^2, the coefficient c of the force per length.

    Source: power -sigma * v_n^2 per length; Paidoussis, Fluid-Structure Interactions, vol. 1,
    eq. (3.70), has its linear form.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.1, terms=[pp.Viscosity(sigma=1.42)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.002
    """

    law: ClassVar[str] = "viscosity"
    sigma: float = number(1e9, mass=1, time=-1)


@saved_as("AddedMass")
@dataclass(frozen=True, repr=False)
class AddedMass(Term):
    """Added mass of a dense fluid at rest around the pipe, for motions of any amplitude.

    Only the velocity v_n normal to the pipe moves the fluid, whose kinetic energy per length is chi
    * v_n^2 / 2. The fluid adds no weight; its buoyancy lowers gamma, see `Pipe.from_si`. Small
    motions are those of a pipe with the mass ratio beta / (1 + chi), with damping and viscosity
    divided by sqrt(1 + chi), and with frequencies divided by sqrt(1 + chi). The wake that a free
    end sheds in large motions (Lighthill) is neglected.

    Attributes:
        chi: >= 0, mass of moving fluid per length of the pipe, in units of mu_p + mu_f: rho_e A_e
            C_m / (mu_p + mu_f), with the fluid's density rho_e, the pipe's outer section A_e and
            the coefficient C_m, which is 1 far from any wall and (D^2 + d^2) / (D^2 - d^2) for a
            pipe of outer diameter d along the middle of a tank of diameter D.

    In `Pipe.from_si`: chi in kg/m, the product rho_e A_e C_m.

    Source: Lagrange's equations with that energy. For the dependence of C_m and of the coefficient
    of `Viscosity` on frequency: Paidoussis, Fluid-Structure Interactions, vol. 1, eqs. (2.153),
    (2.157) and (3.105).

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.3, terms=[pp.AddedMass(chi=0.5)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.5914
    """

    law: ClassVar[str] = "added_mass"
    has_fluid_around: ClassVar[bool] = True
    chi: float = number(1e6, mass=1)


@saved_as("ExternalFlow")
@dataclass(frozen=True, repr=False)
class ExternalFlow(Term):
    """A fluid that flows along the outside of the pipe, from the clamp to the end.

    It acts on small motions about the straight pipe, in all linear questions. Motions of any
    amplitude are refused: the lift and the drag on a pipe at large angles to the flow are known
    from experiments alone. The flow inside the pipe may be at rest or flow at a speed of its own.

    The fluid has inertia, by which it acts like a flow inside the pipe, and friction. For a pipe of
    outer diameter D and length L, with forces per length rho_e D V_o C_f / 2 times the velocity,
    the coefficients of friction are e = 2 L C_f / (pi D); the drag on the base, if any, is
    rho_e A_e V_o^2 c_b / 2. Along the flow the pressure of the fluid changes by its weight alone,
    which is part of gamma, as far from walls.

    At a free end, the flow separates, or follows a tapered end to its tip. Such an end, of the
    length `end_length` beyond the end of the pipe, is short and rigid. An end that is held across
    does not feel its shape; a friction's tension remains as long as the end slides along the axis.

    Attributes:
        speed: u_o >= 0, in sqrt(EI / (C_m rho_e A_e)) / L.
        chi: >= 1e-9, added mass per length, C_m rho_e A_e / (mu_p + mu_f), as of `AddedMass`,
            which a pipe in external flow may not have as well.
        normal_friction: e_N >= 0, of the friction across the pipe.
        tangential_friction: e_T >= 0, of the friction along it.
        base_drag: c_b >= 0. The drag on the blunt end of the pipe turns with its tangent.
        end_shape: f from 0 (blunt, the flow separates) to 1 (tapered, the flow follows).
        end_length: x_e >= 0, the volume of the tapered end over the pipe's, both with the density
            of the pipe; a cone has a third of its length in L. It has inertia, but no weight, which
            a `Weight` adds.
        added_mass_coefficient: C_m >= 0.1, which is 1 far from walls and (D_c^2 + D^2) /
            (D_c^2 - D^2) in the middle of a channel of diameter D_c. Friction grows with the speed
            itself, u_o / sqrt(C_m).

    In `Pipe.from_si`: speed V_o in m/s, chi in kg/m, the product C_m rho_e A_e. The other numbers
    have no units.

    Source: Paidoussis, Fluid-Structure Interactions, vol. 2; equations in `theory/pipe`. Without
    friction, with end_shape 0, the pipe is one that conveys a fluid of the mass ratio
    chi / (1 + chi) at the speed u_o, with its frequencies over sqrt(1 + chi).

    Example:
        >>> import pipedyn as pp
        >>> flow = pp.ExternalFlow(speed=1.0, chi=0.5, normal_friction=0.3,
        ...                        tangential_friction=0.3, base_drag=0.3, end_shape=0.7)
        >>> pipe = pp.Pipe(beta=0.3, terms=[flow])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        6.6274
        >>> window = {"ExternalFlow.speed": (0.0, 4.0), "u": (0.0, 1.0)}  # at u = 0, the critical
        >>> found = pp.boundary(  # speeds of the external flow
        ...     pp.Continuum(pipe), "ExternalFlow.speed", "u", window, criticality=False)
        >>> [(curve.kind, round(float(curve.x.min()), 3)) for curve in found.curves]
        [('divergence', 2.087)]
    """

    law: ClassVar[str] = "external_flow"
    supplies_energy: ClassVar[bool] = True
    has_fluid_around: ClassVar[bool] = True
    no_motion: ClassVar[str] = (
        "the lift and drag of an external flow on a pipe at large angles are known from "
        "experiments alone, so that it acts in small motions about the straight pipe"
    )
    speed: float = number(1e3, length=1, time=-1, root_of="chi")
    chi: float = number(1e6, mass=1, low=1e-9)
    normal_friction: float = number(1e4, default=0.0)
    tangential_friction: float = number(1e4, default=0.0)
    base_drag: float = number(1e4, default=0.0)
    end_shape: float = number(1.0, default=0.0)
    end_length: float = number(1e3, default=0.0)
    added_mass_coefficient: float = number(1e3, default=1.0, low=0.1)

    @property
    def axial_load(self) -> float:
        """The compression that the momentum of the fluid is equal to, without any tension."""
        return -(self.speed**2)

    def laws(self, damping: float, end_turns: bool) -> list[tuple[str, float, list[float]]]:
        """The laws along the pipe and at its end."""
        numbers = [*self.law_numbers(damping), float(end_turns)]
        return [(self.law, 0.5, numbers), (f"{self.law}_end", 1.0, numbers)]


@saved_as("CubicSpring", added=("stiffness_across",))
@dataclass(frozen=True, repr=False)
class CubicSpring(Term):
    """A hardening spring between one place of the pipe and the axis of the straight pipe.

    Its force -stiffness * x^3 acts along x only, where x is the transverse displacement of the
    place: a smooth model of a motion-limiting restraint. It does not affect small motions.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        stiffness: >= 0, in EI / L^5.
        stiffness_across: of the force along z, as for `Spring`; 0 for a restraint along x alone.

    In `Pipe.from_si`: at in m, stiffness in N/m^3.

    Source: energy stiffness * x^4 / 4; Paidoussis, Fluid-Structure Interactions, vol. 1, sec. 5.8.
    In three dimensions the energy is (sqrt(stiffness) x^2 + sqrt(stiffness_across) z^2)^2 / 4, of
    the fourth power of the distance from the axis if both numbers are the same.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.CubicSpring(at=0.8, stiffness=100.0)])
        >>> pp.hopf(pp.Chain(pipe, 4)).criticality
        'supercritical'
    """

    law: ClassVar[str] = "cubic_spring"
    at: float = place()
    stiffness: float = number(1e12, mass=1, length=-1, time=-2)
    stiffness_across: float | None = number(1e12, mass=1, length=-1, time=-2, default=None)


@saved_as("Stop", added=("stiffness_across",))
@dataclass(frozen=True, repr=False)
class Stop(Term):
    """Two elastic stops beside one place of the pipe, a motion-limiting restraint.

    Between them the place is free; beyond a stop the force along x is -stiffness * (x - gap), or
    -stiffness * (x + gap) on the other side, where x is the transverse displacement of the place.
    Stops do not affect small motions. `simulate` shortens steps that would pass over a contact;
    while the base moves, only over contacts that last a twentieth of a step.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        gap: distance > 0 from the axis of the straight pipe to either stop, in L; a stop without a
            gap is a `Spring`.
        stiffness: >= 0, in EI / L^3.
        stiffness_across: None for a round ring in three dimensions. A number >= 0 makes both stops
            flat, with two more of this stiffness and the same gap along z; 0 for none there.

    In `Pipe.from_si`: at and gap in m, stiffness in N/m.

    Source: energy stiffness * (|x| - gap)^2 / 2 beyond the gap; the trilinear restraint of
    Paidoussis, Fluid-Structure Interactions, vol. 1, sec. 5.8.

    Example:
        >>> import pipedyn as pp
        >>> free, held = pp.Pipe(0.2), pp.Pipe(0.2, terms=[pp.Stop(0.8, gap=0.05, stiffness=100.0)])
        >>> wide, narrow = (pp.limit_cycle(pp.Chain(pipe, 4), 6.5) for pipe in (free, held))
        >>> narrow.amplitude < 0.8 * wide.amplitude
        True
    """

    law: ClassVar[str] = "stop"
    at: float = place()
    gap: float = number(1e6, length=1, open_low=True)
    stiffness: float = number(1e9, mass=1, length=1, time=-2)
    stiffness_across: float | None = number(1e9, mass=1, length=1, time=-2, default=None)

    def law_numbers(self, damping: float) -> list[float]:
        """Gap and stiffnesses; a ring has -1 in place of the second."""
        across = -1.0 if self.stiffness_across is None else self.stiffness_across
        return [self.gap, self.stiffness, across]

    @property
    def symmetric_about_axis(self) -> bool:
        """Whether it is a ring."""
        return self.stiffness_across is None

    @property
    def kinks(self) -> tuple[float, ...]:
        """Displacements at which the place meets the stops."""
        return (-self.gap, self.gap)


class _AxialLoad:
    """What dead loads along the straight pipe have in common."""

    load: float

    @property
    def axial_load(self) -> float:
        """The load."""
        return self.load

    def law_numbers(self, damping: float) -> list[float]:
        """Components of the load across and along the straight pipe."""
        return [0.0, self.load]


@saved_as("Tension")
@dataclass(frozen=True, repr=False)
class Tension(_AxialLoad, Term):
    """A dead load at the end along the straight pipe, which keeps its direction.

    A pressure p in a pipe of inner section A whose end is held across acts as the load -p A if the
    end slides along the axis, and as -(1 - 2 nu) p A, with the material's Poisson's ratio nu, if it
    is fixed (`Stretching`): Paidoussis, Fluid-Structure Interactions, vol. 1, eq. (3.70).

    Attributes:
        load: positive in tension, negative in compression, in EI / L^2.

    In `Pipe.from_si`: load in N.

    Source: potential -load * (y - 1), where y is the end's position along the straight pipe.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Tension(load=20.0)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        8.5838
    """

    law: ClassVar[str] = "dead_load"
    acts_at_end: ClassVar[bool] = True
    load: float = number(1e6, mass=1, length=2, time=-2, low=-1e6)


@saved_as("Weight")
@dataclass(frozen=True, repr=False)
class Weight(_AxialLoad, Term):
    """A dead load at one place, along the straight pipe, without mass.

    It represents a body that hangs there and hardly moves, or the difference between the weight of
    a mass and gamma times the mass.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1.
        load: positive if downward, in EI / L^2.

    In `Pipe.from_si`: at in m, load in N.

    Source: potential as for `Tension`, with y at the place.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Weight(at=0.5, load=20.0)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.7049
    """

    law: ClassVar[str] = "dead_load"
    at: float = place()
    load: float = number(1e6, mass=1, length=2, time=-2, low=-1e6)


class _DeadLoad:
    """What loads of two components have in common."""

    force_x: float
    force_y: float

    def _set(self, force: Any, force_x: Any, force_y: Any, **numbers: Any) -> None:
        """Sets the numbers, of which the force is given as a pair or by its components."""
        if force is not None:
            if check.is_quantity(force):
                force = [component * force.units for component in force.magnitude]
            listed = list(force) if isinstance(force, np.ndarray) and force.ndim == 1 else force
            if not isinstance(listed, tuple | list) or len(listed) != 2:
                raise TypeError(
                    f"force must be a pair of components (x, y) in the plane of motion, across and "
                    f"along the clamp's axis, got {check.shown(force)}"
                )
            if force_x or force_y:
                raise ValueError(
                    f"force or its components must be given, not both, got {check.shown(force)}, "
                    f"force_x = {check.shown(force_x)} and force_y = {check.shown(force_y)}"
                )
            force_x, force_y = (
                one if check.is_quantity(one) else check.real(f"force[{i}]", one)
                for i, one in enumerate(listed)
            )
        for name, value in {**numbers, "force_x": force_x, "force_y": force_y}.items():
            object.__setattr__(self, name, value)
        cast(Any, self).__post_init__()

    @property
    def force(self) -> tuple[float, float]:
        """Components (force_x, force_y) of the force."""
        return self.force_x, self.force_y

    @property
    def axial_load(self) -> float:
        """The component along the straight pipe."""
        return self.force_y

    @property
    def load_across(self) -> float:
        """The component across the straight pipe."""
        return self.force_x


@saved_as("Load")
@dataclass(frozen=True, repr=False, init=False)
class Load(_DeadLoad, Term):
    """A dead load at one place: a force that keeps its size and direction however the pipe moves.

    A pipe with a load across it rests bent, see `equilibria` and `critical_speed`.

    Args:
        at: arc length from the clamp in L, 0 < at <= 1.
        force: components (x, y) across the clamp's axis and along it, positive away from the clamp,
            in EI / L^2.

    Attributes:
        at: arc length of the place.
        force_x, force_y: the components, which are two numbers of a pipe with names of their own;
            they may be given in place of force.

    In `Pipe.from_si`: at in m, force in N.

    Source: potential -force_x * x - force_y * (y - at), with the position (x, y) of the place.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.Load(at=1.0, force=(3.0, 0.0))])
        >>> pp.equilibria(pp.Galerkin(pipe, 10, "legendre"), 0.0).tips.round(6)
        array([[0.603253, 0.74558 ]])
    """

    law: ClassVar[str] = "dead_load"
    at: float = place()
    force_x: float = number(1e6, mass=1, length=2, time=-2, low=-1e6, default=0.0)
    force_y: float = number(1e6, mass=1, length=2, time=-2, low=-1e6, default=0.0)

    def __init__(
        self, at: float, force: Any = None, *, force_x: float = 0.0, force_y: float = 0.0
    ) -> None:
        self._set(force, force_x, force_y, at=at)


@saved_as("DistributedLoad")
@dataclass(frozen=True, repr=False, init=False)
class DistributedLoad(_DeadLoad, Term):
    """A dead load per length, uniform along the pipe, as of a steady wind on a light pipe.

    It keeps its size and direction however the pipe moves. A pipe with a load across it rests bent,
    see `equilibria` and `critical_speed`.

    Args:
        force: components (x, y) across the clamp's axis and along it, positive away from the clamp,
            per length, in EI / L^3.

    Attributes:
        force_x, force_y: the components, which are two numbers of a pipe with names of their own;
            they may be given in place of force.

    In `Pipe.from_si`: force in N/m.

    Source: potential -force_x * x - force_y * (y - s) per length, with the position (x, y) of the
    pipe at the arc length s.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.DistributedLoad((4.0, -3.0))])
        >>> pp.equilibria(pp.Galerkin(pipe, 10, "legendre"), 1.0).tips.round(6)
        array([[0.537667, 0.81352 ]])
    """

    law: ClassVar[str] = "distributed_load"
    force_x: float = number(1e6, mass=1, length=1, time=-2, low=-1e6, default=0.0)
    force_y: float = number(1e6, mass=1, length=1, time=-2, low=-1e6, default=0.0)

    def __init__(self, force: Any = None, *, force_x: float = 0.0, force_y: float = 0.0) -> None:
        self._set(force, force_x, force_y)


@saved_as("FollowerForce")
@dataclass(frozen=True, repr=False)
class FollowerForce(Term):
    """A force at one place of the pipe that pushes it towards the clamp and turns with its tangent.

    It is the thrust of a rocket or a jet engine on the pipe. At the free end of a pipe without flow
    it is Beck's load.

    Attributes:
        at: arc length from the clamp in L, 0 < at <= 1. In a chain the force follows the segment on
            which the place lies, or the segment that ends there.
        force: positive if it compresses the pipe, negative if it pulls, in EI / L^2.

    In `Pipe.from_si`: at in m, force in N.

    Source: load -force * t with the tangent t at the place; it has no potential, and the power
    -force * t . v. Beck, Zeitschrift fuer angewandte Mathematik und Physik 3 (1952), 225.

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(beta=0.2, terms=[pp.FollowerForce(at=0.5, force=5.0)])
        >>> round(pp.critical_speed(pp.Continuum(pipe)).speed, 4)
        5.1756
    """

    law: ClassVar[str] = "follower_force"
    supplies_energy: ClassVar[bool] = True
    at: float = place()
    force: float = number(1e6, mass=1, length=2, time=-2, low=-1e6)

    @property
    def axial_load(self) -> float:
        """Minus the force, which compresses the pipe."""
        return -self.force


@saved_as("Stretching")
@dataclass(frozen=True, repr=False)
class Stretching(Term):
    """Stretching of a pipe between axially fixed ends, modelled by an axial spring at its end.

    The model of the pipe is inextensible: its end slides along the axis against a spring of force
    stiffness * (1 - y), where y is the end's position along the straight pipe, with the pipe's
    Kelvin-Voigt damping. To third order in the amplitude, this force is the mean tension of a pipe
    that stretches, stiffness / 2 times the integral of w'^2. It does not affect small motions. The
    end must be pinned or clamped. If the base moves, both ends move with it.

    The law is valid for moderate rotations. For a half sine wave with the largest angle 0.5 rad,
    its tension is seven eighths of the tension of a pipe that stretches; for 1 rad it is half.
    Beyond a quarter turn the pipe runs back along the axis, and 1 - y is no longer due to
    stretching. Coiled equilibria there have no physical meaning, and `equilibria` discards them.

    Attributes:
        stiffness: axial stiffness of the pipe, E A L^2 / (E I) >= 0, in EI / L^3.

    In `Pipe.from_si`: stiffness E A / L in N/m.

    Source: energy stiffness * (1 - y)^2 / 2; Holmes, J. Sound Vib. 53 (1977), 471; Paidoussis,
    Fluid-Structure Interactions, vol. 1, eq. (5.44).

    Example:
        >>> import pipedyn as pp
        >>> pipe = pp.Pipe(0.2, root="pinned", end="pinned", terms=[pp.Stretching(1000.0)])
        >>> round(pp.critical_speed(pp.Galerkin(pipe, 4)).speed, 4)
        3.1416
    """

    law: ClassVar[str] = "stretching"
    needs_held_end: ClassVar[bool] = True
    acts_at_end: ClassVar[bool] = True
    largest_angle: ClassVar[float] = 0.5 * math.pi
    stiffness: float = number(1e9, mass=1, length=1, time=-2)

    def law_numbers(self, damping: float) -> list[float]:
        """Stiffness and damping coefficient of the axial spring."""
        return [self.stiffness, self.stiffness * damping]


Law = TypeVar("Law", bound="DataclassInstance")


def converted(term: Law, scales: Scales, by: Callable[[float, float], float]) -> Law:
    """A term or root spring with numbers times (mul) or over (truediv) their units.

    A number that contains the root of a mass per length has the unit of both.
    """
    bases, numbers = (scales.mass, scales.length, scales.time), {}
    try:
        for item, value in given_fields(term):
            mass, *others = item.metadata["powers"]
            mass += 0.5 * bool(item.metadata.get("root_of"))
            unit = math.prod(map(pow, bases, (mass, *others)))
            numbers[item.name] = by(value, unit)
    except OverflowError:
        raise ValueError(f"{term!r} overflows in units of {scales}") from None
    return replace(term, **numbers)


def with_roots(term: Law, by: Callable[[float, float], float]) -> Law:
    """A term with numbers times (mul) or over (truediv) the roots that SI leaves out of them."""
    roots = {item.name: item.metadata.get("root_of") for item in fields(term)}
    numbers = {
        name: by(getattr(term, name), math.sqrt(getattr(term, of)))
        for name, of in roots.items()
        if of
    }
    return replace(term, **numbers)


def in_range(terms: tuple[Term, ...], given: str = "") -> tuple[Term, ...]:
    """Returns the terms if their nondimensional numbers are in range; else raises ValueError.

    given: text for error messages on the origin of the numbers.
    """
    for i, term in enumerate(terms):
        for item, value in given_fields(term):
            rule = item.metadata["range"]
            check.real(f"terms[{i}].{item.name}{given}", value, **rule)
    return terms


def checked_terms(terms: Any, end: float = 1.0, in_si: bool = False) -> tuple[Term, ...]:
    """Checks a sequence of terms on a pipe of length `end` and returns it as a tuple.

    Raises ValueError for more than 400 terms, or a place beyond the free end, else TypeError.
    """
    if isinstance(terms, Term) or not isinstance(terms, tuple | list):
        raise TypeError(f"terms must be a tuple or list of terms, got {check.shown(terms)}")
    if len(terms) > MOST_TERMS:
        raise ValueError(f"terms must be at most {MOST_TERMS}, got {len(terms)}")
    for i, term in enumerate(terms):
        check.instance(f"terms[{i}]", term, Term, "a term, such as PointMass or Spring")
        if type(term).__module__ != __name__:
            raise TypeError(f"terms[{i}] must be a law of the package, got {check.shown(term)}")
        if check.real(f"terms[{i}].at", getattr(term, "at", end)) > end * (1.0 + SLACK):
            checked_place(f"terms[{i}].at", term.place, end, in_si, False)
    return tuple(
        replace(term, at=end) if getattr(term, "at", end) > end else term for term in terms
    )
