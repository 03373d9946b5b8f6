# SPDX-License-Identifier: MIT
"""Relevance of effects: how far an answer moves when each effect is switched off in turn."""

from __future__ import annotations

import math
from collections.abc import Collection
from contextlib import suppress
from dataclasses import field, replace
from typing import Any, TypeAlias

import numpy as np

from pipedyn.accuracy.quantities import (
    MARGIN,
    Answer,
    MotionOf,
    Quantity,
    QuantityName,
    checked_quantity,
    conditions_of,
)
from pipedyn.cycles.limit_cycle import NoCycle
from pipedyn.linear.critical_speed import NoCrossing
from pipedyn.linear.modes import CONTINUUM_SPEED, modes
from pipedyn.linear.neutral import growth
from pipedyn.linear.reach import Reach
from pipedyn.models.base import Model, core_pipe
from pipedyn.models.continuum import LARGEST, Continuum
from pipedyn.models.drive import InputUnits, Pulsation, Supply
from pipedyn.models.pipe import DEFAULTS, OWN_NUMBERS, Pipe, checked_pipe
from pipedyn.models.profile import Profile
from pipedyn.models.supports import RootSpring
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.errors import PipedynError, warn_of_plane
from pipedyn.util.result import RATE, Result, Table, TableResult, speed_in_si

LIMIT_BETA = 1e-9
"""Value of beta for the limit beta -> 0; its critical speed differs from the limit by 1.1 beta."""

EFFECTS = {
    "gravity": "gamma",
    "drag": "drag",
    "damping": "damping",
    "hysteresis": "hysteresis",
    "Coriolis": "beta",
    "centrifugal": "alpha",
    **{one.effect: name for name, one in OWN_NUMBERS.items() if one.effect},
}
"""Names of the numbers of the pipe by the effects that they switch off."""

ABSENT = {one.effect: DEFAULTS[name] for name, one in OWN_NUMBERS.items() if one.effect}
"""Values of numbers, by effect, at which the pipe lacks the effect, which is then not listed."""

PROFILES = {"varying stiffness": "stiffness", "varying mass": "mass"}
"""Effects of a nonuniform pipe, with the name of the profile. Without the effect the pipe has the
value at s = 0 over its whole length."""


@saved_as("Effect")
class Effect(Result):
    """One effect, and the change of the quantity without it.

    Attributes:
        name: "gravity", "drag", "damping", "hysteresis", "Coriolis", "centrifugal", "flow" (both
            parts), "end coefficient" (the change of alpha from 1 by a nozzle or an inlet), "inflow"
            (the part of the free end's velocity that the entering fluid lacks), "jet angle",
            "inclination", "rotary inertia",
            "pulsation", "constant head" or "moving base" of a motion, "varying stiffness" or
            "varying mass" of a nonuniform pipe, the root's spring, "RootSpring(stiffness=30)", or a
            term of the pipe as it prints, "PointMass(at=1, mass=0.1)". Equal terms count as one
            effect. Names of several effects are joined by " + ".
        strength: the number that sets the effect, in words; empty if the pipe lacks the effect.
        without: the quantity without the effect, in words.
        answer: the quantity without the effect, in numbers; None if there is no answer or the
            effect is absent.
        size: relative change of the quantity; infinite if its kind changes, NaN if it could not be
            found.
        error: bound on the error of `size`, from the errors of both answers.
        growth: largest real part of an eigenvalue of the pipe at rest without the effect at u, in
            1 / T; NaN if it was not found.
        verdict: "relevant", "negligible" or "absent". An effect is relevant unless `size` and its
            error together are within the tolerance.
        note: a remark, or empty.
    """

    name: str
    strength: str
    without: str
    answer: Answer | None = field(repr=False)
    size: float
    error: float
    growth: float
    verdict: str
    note: str = ""

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the effect in a table, one for each column."""
        if self.verdict == "absent":
            return (self.name, "", "", "", "", self.verdict)
        size = "unknown" if math.isnan(self.size) else f"{self.size:.1e}"
        if self.size == math.inf:
            size = "infinite"
        elif self.size < self.error:
            size = f"<{self.size + self.error:.1e}"
        growth = f"{self.growth:.4g}"
        return (self.name, self.strength, self.without, size, growth, self.verdict)


@saved_as("Relevance")
class Relevance(TableResult, units={"growth": RATE}):
    """The size of each effect on one quantity of a pipe.

    Attributes:
        pipe: the pipe.
        u: flow speed at which the growth is given, and that of the quantity if it depends on one.
        quantity: the question that was asked, with its conditions.
        full: the quantity with all effects, in words.
        growth: largest real part of an eigenvalue of the pipe at rest at u, in 1 / T.
        tolerance: relative change up to which an effect is negligible.
        effects: the effects, the largest first, and those that the pipe lacks last.
        together: the effect of all negligible ones switched off at once; None for fewer than two.
    """

    pipe: Pipe
    u: float
    quantity: Quantity
    full: str
    growth: float
    tolerance: float
    effects: tuple[Effect, ...] = field(repr=False)
    together: Effect | None = field(repr=False)

    def __getitem__(self, name: str) -> Effect:
        """The effect with a given name."""
        known = {effect.name: effect for effect in self.effects}
        return known[check.choice("name", name, tuple(known))]

    @property
    def negligible(self) -> tuple[str, ...]:
        """Names of the effects that the pipe has and that change the quantity negligibly."""
        return tuple(effect.name for effect in self.effects if effect.verdict == "negligible")

    @property
    def simplified(self) -> Pipe:
        """The pipe without its negligible effects."""
        return _without(self.pipe, _droppable(self.negligible))

    def _table(self) -> Table:
        shown = self.effects if self.together is None else (*self.effects, self.together)
        rest = "straight pipe" if self.pipe.rests_straight else "pipe at rest"
        title = (
            f"{self.quantity.name} of {self.pipe}: {self.full}\n"
            f"at {_speed(self.u, self.pipe)} the {rest} grows by {self.growth:.4g} / T; "
            f"negligible is a change below {self.tolerance:g}"
        )
        notes = [f"{effect.name}: {effect.note}" for effect in shown if effect.note]
        if self.quantity.name in ("frequencies", "root_loci"):
            notes.insert(0, "change: of the complex root, growth and frequency, over its modulus")
        headings = ("effect", "strength", "without it", "change", "growth at u", "verdict")
        return Table(title, headings, [effect.cells for effect in shown], notes=notes)

    def __str__(self) -> str:
        return self._table().text()

    def _columns(self) -> dict[str, Any]:
        names = "name", "strength", "without", "size", "error", "growth", "verdict", "note"
        return {name: [getattr(one, name) for one in self.effects] for name in names}


def relevant(
    pipe: Pipe,
    u: float | Pulsation | Supply,
    quantity: QuantityName = "critical_speed",
    *,
    tolerance: float = 1e-3,
    **conditions: Any,
) -> Relevance:
    """How much each effect matters for one quantity of a pipe.

    Each effect is switched off in turn, and the quantity is computed again for the continuous pipe:

    - gravity (gamma = 0), drag (kappa = 0), damping (delta = 0) and hysteresis (mu = 0);
    - the Coriolis force of the flow together with the momentum that the velocity of the free end
      carries away (beta = 0, since beta enters by sqrt(beta) u alone), the centrifugal force of the
      flow (alpha = 0) and, except for the critical speed, the flow as a whole;
    - the nozzle or inlet at the end (alpha = 1), the part of the free end's velocity that the
      entering fluid lacks (inflow_share = 1), the angle of the jet (jet_angle = 0) and the
      inclination of the pipe, which then hangs (inclination = 0);
    - the spring at the root (which is then clamped), a varying stiffness or mass (which then has
      its value at s = 0 all along) and each term;
    - for a motion also the pulsation of the flow (its mean speed), the constant head (the speed of
      the straight pipe) and the moving base.

    An effect that changes the kind of the answer (flutter to divergence, buckled at rest or not, no
    loss of stability, unstable from the smallest flow on, no limit cycle) is infinitely large. The
    limit beta -> 0 is not continuous: with an arbitrarily small Coriolis force the critical speed
    differs from the one without Coriolis force. The Coriolis force is therefore never negligible
    for the critical speed of an undamped ejecting pipe; a note gives the limit.

    Args:
        pipe: the pipe, whose numbers may come from `Pipe.from_si`.
        u: flow speed, `pipe.speed_from_si(V)` from m/s. It is a condition of "frequencies",
            "motion" and "limit_cycle". For all quantities it is also the speed at which the growth
            of the straight pipe, the real part of its least damped eigenvalue, is listed. For a
            "motion" it may be a `Pulsation` or a `Supply`; the condition base= is as for
            `simulate`.
        quantity: "critical_speed", "frequencies", "root_loci", "motion" or "limit_cycle", as for
            `trade`.
        tolerance: relative change up to which an effect is negligible, in [1e-8, 1].
        **conditions: conditions of the quantity: max_speed, count, speeds, duration, ..., and
            dimensions=3 for small motions across the plane of a bent rest as well; with
            units="si" speeds, `u` too, are in m/s and a duration in s.

    Returns:
        Relevance.

    Raises:
        NotConverged, MotionStopped: if there is no answer for the pipe with all its effects. If
            there is no answer without an effect, its note says so and it counts as relevant.
        NoCycle: if the pipe does not come to rest, but no limit cycle was found.
        ValueError, TypeError: for bad arguments.

    Example:
        A hose of 1 m, as heavy as the water in it, hanging in air at 4 m/s:

        >>> hose = pp.Pipe.from_si(length=1.0, bending_stiffness=0.1, pipe_mass=0.1, fluid_mass=0.1,
        ...                        drag_coefficient=1.0, external_diameter=0.015,
        ...                        external_density=1.2, damping_time=1e-4)
        >>> pp.relevant(hose, hose.speed_from_si(4.0)).negligible
        ('damping', 'drag')
    """
    pipe = checked_pipe(pipe)
    if "u" in conditions_of(quantity):
        conditions = {"u": u, **conditions}
    u = InputUnits(conditions.get("units", "nondimensional"), pipe).speed("u", u)
    steady = quantity != MotionOf.name or not isinstance(u, Pulsation | Supply)
    speed = check.real("u", u, low=0.0, high=CONTINUUM_SPEED) if steady else math.nan
    tolerance = check.real("tolerance", tolerance, low=1e-8, high=1.0)
    asked = checked_quantity(quantity, conditions, pipe).prepared(pipe)
    if asked.sees_one_plane_of(pipe):
        warn_of_plane(__name__)
    if isinstance(asked, MotionOf):
        speed = asked.steady_speed(pipe)
    words, full = _outcome(asked, pipe, tolerance)
    drives = _drives(asked, speed)
    strengths = {name: strength for name, (strength, _) in (_effects(pipe) | drives).items()}
    if asked.name == "critical_speed":
        del strengths["flow"]
    if "constant head" in drives:  # the equation of the flow speed needs the mass of the fluid
        del strengths["Coriolis"], strengths["flow"]

    def effect(*names: str) -> Effect:
        """The result of switching off some effects at once; absent if they have no strength."""
        name, strength = " + ".join(names), ", ".join(strengths[one] for one in names)
        if not strength:
            return Effect(name, "", "", None, 0.0, 0.0, math.nan, "absent")
        simpler = _without(pipe, names)
        growth = _growth_at(simpler, speed, asked)
        left: Any = replace(asked, **_changes(drives, names))  # type: ignore[type-var]
        try:
            without, found = _outcome(left, simpler, tolerance)
        except PipedynError as failure:
            unknown = (None, math.nan, math.nan, growth)
            return Effect(name, strength, "not found", *unknown, "relevant", str(failure.args[0]))
        size = asked.distance(found, full)
        error = found.error + full.error if 0.0 < size < math.inf else 0.0
        note = ""
        undamped = pipe.damping == pipe.hysteresis == 0.0 and pipe.flow == "ejecting"
        if names == ("Coriolis",) and asked.name == "critical_speed" and undamped:
            with suppress(PipedynError):
                limit, _ = _outcome(asked, replace(pipe, beta=LIMIT_BETA), tolerance)
                note = f"as beta tends to 0 the pipe's is {limit}, not that at 0"
        verdict = "negligible" if size + error <= tolerance else "relevant"
        answer = found if found.values.size else None
        return Effect(name, strength, without, answer, size, error, growth, verdict, note)

    def rank(effect: Effect) -> tuple[bool, float]:
        # Absent effects come last; infinite and unknown ones come first.
        return effect.verdict == "absent", -math.inf if math.isnan(effect.size) else -effect.size

    effects = sorted(map(effect, strengths), key=rank)
    dropped = _droppable([one.name for one in effects if one.verdict == "negligible"])
    return Relevance(
        pipe=pipe,
        u=speed,
        quantity=asked,
        full=words,
        growth=_growth_at(pipe, speed, asked),
        tolerance=tolerance,
        effects=tuple(effects),
        together=effect(*dropped) if len(dropped) > 1 else None,
    )


Effects: TypeAlias = dict[str, tuple[str, dict[str, Any]]]
"""Effects by name: the strength in words, empty if the pipe lacks the effect, and the numbers of
the pipe, or the conditions of the quantity, without it."""


def _effects(pipe: Pipe) -> Effects:
    """The effects of a pipe. Without several of its terms it has the others, see `_without`."""
    found: Effects = {}
    for name, number in EFFECTS.items():
        value, absent = float(getattr(pipe, number)), ABSENT.get(name)
        if value != absent:
            strength = f"{OWN_NUMBERS[number].ascii} = {value:.6g}"
            found[name] = strength if value or name in ABSENT else "", {number: absent or 0.0}
    parts = [found[name][0] for name in ("Coriolis", "centrifugal")]
    found["flow"] = ", ".join(filter(None, parts)), {"beta": 0.0, "alpha": 0.0}
    if isinstance(pipe.root, RootSpring):
        found[repr(pipe.root)] = f"stiffness = {pipe.root.stiffness:.4g}", {"root": "clamped"}
    for term in pipe.terms:
        numbers = [f"{name} = {value:.4g}" for name, value in term.numbers.items() if value]
        found[repr(term)] = ", ".join(numbers), {}
    for name, of in PROFILES.items():
        profile: Profile | None = getattr(pipe, of)
        if profile is not None:
            low, high = profile.bounds
            found[name] = f"{of} {low:.4g} to {high:.4g}", {of: None}
    return found


def _drives(asked: Quantity, speed: float) -> Effects:
    """The effects of what drives a motion."""
    drives: Effects = {}
    if not isinstance(asked, MotionOf):
        return drives
    if isinstance(asked.u, Pulsation):
        strength = f"amplitude = {asked.u.amplitude:.4g}, frequency = {asked.u.frequency:.4g}"
        drives["pulsation"] = strength, {"u": speed}
    if isinstance(asked.u, Supply):
        drives["constant head"] = f"friction = {asked.u.friction:.4g}", {"u": speed}
    if asked.base is not None:
        drives["moving base"] = check.shown(asked.base), {"base": None}
    return drives


def _droppable(names: Collection[str]) -> tuple[str, ...]:
    """The names without "flow", which consists of two other effects."""
    return tuple(name for name in names if name != "flow")


def _changes(effects: Effects, names: Collection[str]) -> dict[str, Any]:
    """What changes without some of the effects."""
    return {k: v for name, (_, gone) in effects.items() if name in names for k, v in gone.items()}


def _without(pipe: Pipe, names: Collection[str]) -> Pipe:
    """The pipe with some of its effects switched off."""
    terms = tuple(term for term in pipe.terms if repr(term) not in names)
    return replace(pipe, terms=terms, **_changes(_effects(pipe), names))


def _outcome(quantity: Quantity, pipe: Pipe, tolerance: float) -> tuple[str, Answer]:
    """The answer for a pipe in words and in numbers; without numbers if there is no answer."""
    state = ""
    if (
        quantity.name == "critical_speed"
        and pipe.axial_gravity < 0.0
        and _growth_at(pipe, 0.0, quantity) > 0.0
    ):
        state = "buckled at rest, "
    none = Answer(np.zeros(0), f"{state}none")
    passive = pipe.alpha == 0.0 and pipe.flow == "ejecting" and not pipe.fed_at_rest
    if quantity.name == "critical_speed" and passive:
        # Without the centrifugal force the flow changes no stiffness, and takes energy at the end.
        return f"{state}no loss of stability at any speed", none
    try:
        # Both errors are a tenth of the tolerance, so a change as large as it is known to a fifth.
        found = quantity.reference(pipe, tolerance / MARGIN)
    except NoCrossing as failure:
        return f"{state}{failure.args[0]}", none
    except NoCycle as failure:
        if not _growth_at(pipe, failure.u, quantity) <= 0.0:  # a cycle may exist that was not found
            raise
        return "no limit cycle, it rests", none
    words, kind = _answer_in_words(quantity, pipe, found)
    return state + words, replace(found, kind=state + kind)


def _answer_in_words(quantity: Quantity, pipe: Pipe, answer: Answer) -> tuple[str, str]:
    """An answer in words, and the kind of the answer."""
    values = answer.values
    if quantity.name == "critical_speed":
        if values[0] == 0.0:
            from_rest = "unstable from the smallest flow on"
            return from_rest, from_rest
        return f"{answer.kind} at {_speed(float(values[0]), pipe)}", answer.kind
    if quantity.name == "limit_cycle":
        return f"amplitude {values[0]:.4g}, frequency {values[1]:.4g}", ""
    if quantity.name == "motion":
        return f"free end to {np.abs(values[:, 0]).max():.4g} aside", ""
    if quantity.name == "frequencies":
        above = ", ".join(f"{value.imag:.4g}" for value in values if value.imag > 0.0)
        return f"omega = {above}" if above else "no oscillation", ""
    return f"growth up to {growth(values).max():.4g}", ""


def _speed(u: float, pipe: Pipe) -> str:
    return f"u = {u:.6g}{speed_in_si(u, pipe.scales, 4)}"


def _growth_at(pipe: Pipe, u: float, asked: Quantity) -> float:
    """Largest real part of an eigenvalue of the pipe at rest at a speed; NaN if none converges.

    Motions are in the planes that the quantity is asked of.

    Only eigenvalues up to the magnitude that belongs to a wave which neither flow nor weight can
    buckle are counted. The lowest few alone do not suffice, since they may all lie in the cluster
    at -1 / delta, and the highest of a reduced model are not those of the pipe.
    """
    soft, stiff = (1.0, 1.0) if pipe.stiffness is None else pipe.stiffness.bounds
    light = 1.0 if pipe.mass is None else pipe.mass.bounds[0]
    weight = Reach(pipe).tension
    across, turning = core_pipe(pipe).added_stiffness
    thrust = (max(pipe.alpha, 1.0) * u**2 + max(-weight, 0.0)) / soft
    half_waves = 4 + math.ceil(math.sqrt(thrust) / math.pi)
    wave = math.pi * half_waves
    elastic = wave * math.hypot(math.sqrt(stiff) * wave, math.sqrt(abs(weight)))
    largest = math.hypot(elastic, math.sqrt(across + turning * wave**2)) / math.sqrt(light)

    def least_damped(rom: Model) -> float:
        values = modes(rom, u).eigenvalues
        return float(growth(values)[np.abs(values) <= largest].max(initial=-math.inf))

    first = min(max(16, 2 * half_waves), LARGEST)
    try:
        found = Continuum(pipe, asked.dimensions).converge(
            least_damped, lambda a, b: abs(a - b) / max(abs(b), 1.0), 1e-8, first
        )
        return found.value
    except PipedynError:
        return math.nan
