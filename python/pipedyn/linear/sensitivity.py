# SPDX-License-Identifier: MIT
"""Crossings of the imaginary axis with their numbers of unstable roots and sensitivities.

The last part of this module is about pipes whose gyroscopic force and damping are so weak that
rounding hides Re lambda. Below sqrt(beta) = delta = mu = 2e-5 the sign of Re lambda would be
determined by rounding, so that a search would find crossings that do not exist, or fail.

The gyroscopic force and both kinds of damping are odd under reversal of time. At a constant ratio
sqrt(beta) : delta : mu, crossings are therefore even functions of their size:
u_c = F(ratio) + O(beta, delta^2, mu^2). The same pipe is solved with all of them made stronger, in
three sizes, and the crossings are extrapolated to the size asked for. The limit is not the pipe
with none of them, which is circulatory (Ziegler's paradox).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from pipedyn import _core
from pipedyn.linear.eigenproblem import Eigenproblem, eigenproblem
from pipedyn.models.base import Model
from pipedyn.models.continuum import AnyModel
from pipedyn.models.pipe import Pipe
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged
from pipedyn.util.result import FREQUENCY, SPEED, Deferred, Result, ResultSequence, Unit

CrossingKind = Literal["flutter", "divergence"]

LEAST_BETA = 1e-300
"""Smallest beta with derivatives by beta: under weak damping they grow like 1 / beta."""


@saved_as("Derivatives", added=("rotary_inertia",))
class Derivatives(Result):
    """Derivatives of one quantity by the pipe's numbers and the springs.

    Attributes:
        beta: derivative by beta; None at beta = 0 (below 1e-300), where the square root of beta has
            no derivative.
        gamma, damping, alpha, hysteresis: derivatives by these numbers.
        springs: derivatives by each k_j with the others fixed, shape (n,); None for reduced models
            and for scenes solved by matrices, see `Assembly`.
        rotary_inertia: derivative by that number; None in a file of an earlier version.

    In SI, derivatives of a speed are in m/s and those of a frequency in Hz, with respect to the
    same nondimensional numbers. The derivative of a speed by beta is omitted, because the unit of
    speed changes with beta.
    """

    beta: float | None
    gamma: float
    damping: float
    alpha: float
    hysteresis: float
    springs: Array | None = field(default=None, repr=False, compare=False)
    rotary_inertia: float | None = None


@saved_as("Sensitivity")
class Sensitivity(Result):
    """Derivatives of a crossing's speed and frequency by the pipe's numbers.

    Attributes:
        speed: derivatives of the crossing's speed.
        frequency: derivatives of the crossing's frequency.

    Example:
        >>> found = pp.critical_speed(pp.Chain(pp.Pipe(0.2), n=10)).sensitivity
        >>> round(found.speed.gamma, 4), round(found.frequency.gamma, 4)
        (0.0741, 0.1296)
    """

    speed: Derivatives
    frequency: Derivatives

    def _units_within(self, name: str) -> dict[str, Unit | None]:
        names = ("gamma", "damping", "alpha", "hysteresis", "springs", "rotary_inertia")
        if name == "speed":
            return dict.fromkeys(names, SPEED)
        return dict.fromkeys((*names, "beta"), FREQUENCY)


@saved_as("Crossing", added=("gyroscopic", "vouched", "across"))
class Crossing(Result, units={"error": SPEED}):
    """A crossing of the imaginary axis by an eigenvalue or a conjugate pair.

    In a conservative pipe two growing real eigenvalues may meet and become a growing pair,
    Paidoussis' coupled-mode flutter: this counts as a flutter of frequency 0, with `unstable_after`
    equal to `unstable_before`. With hysteresis, which acts on oscillation only, a growing
    eigenvalue may pass the real axis, so that a growing pair appears or vanishes: this also counts
    as a flutter of frequency 0. Beyond the first loss of stability, a loss factor is no sound model
    of a material.

    Attributes:
        speed: flow speed u of the crossing.
        frequency: angular, in 1 / T; 0 for divergence, and at u = 0 for a pair that leaves zero.
        kind: "flutter" (a pair) or "divergence" (a real root).
        unstable_before, unstable_after: number of unstable roots below and above the speed; a pair
            counts as two.
        error: absolute error of the speed due to the eigenvalue solver and, for `Continuum`, the
            basis.
        mode: number of the branch that crosses, from 1, counted at rest by frequency; the higher of
            two branches that meet on the axis (beta = 0). At a divergence of a conservative pipe,
            the mode whose frequency at rest is nearest to Rayleigh's quotient of the buckled shape.
            If damping is so strong that the mode does not oscillate at rest, the
            number is a convention, which differs from model to model.
        sensitivity: derivatives of speed and frequency; None at u = 0, at beta = 0 without
            damping, at the divergence of a chain with a free joint, and about a configuration of
            `about` that is bent. Those of a pipe whose rest follows the flow contain the change of
            the rest; they are differences of fourth order, and none are by springs.
        gyroscopic: whether, on the side where no root is unstable, only gyroscopic forces keep the
            pipe from diverging: it has no damping, its stiffness is indefinite there, and any
            damping makes it unstable (Kelvin, Tait and Chetaev).
        vouched: for `Continuum`, the number of lowest roots that its basis resolves and that are
            counted; None for other models, all of whose roots are counted.
        across: of a model in three dimensions whose pipe is bent by a load or has terms that differ
            in x and z, whether the motion is across the plane z = 0, or in it; None for other
            models. Modes of both planes are counted apart.
    """

    speed: float
    frequency: float
    kind: CrossingKind
    unstable_before: int
    unstable_after: int
    error: float
    mode: int
    sensitivity: Sensitivity | None = field(default=None, repr=False)
    gyroscopic: bool = False
    vouched: int | None = field(default=None, repr=False)
    across: bool | None = None

    @property
    def destabilising(self) -> bool:
        """Whether the number of unstable roots grows."""
        return self.unstable_after > self.unstable_before


Crossing.sensitivity = Deferred("sensitivity")  # type: ignore[assignment]


@saved_as("Crossings", added=("unstable_at_rest",))
class Crossings(ResultSequence[Crossing], units={"error": SPEED, "max_speed": SPEED}):
    """All crossings of a model up to a flow speed, in order of speed, as a tuple and as a table.

    Attributes:
        crossings: the crossings, in order of speed.
        max_speed: flow speed at which the search ended.
        model: the model that was searched.
        unstable_at_rest: number of roots that grow without flow, as in a pipe that buckles under
            its weight; None in a file of an earlier version.

    Example:
        >>> found = pp.crossings(pp.Continuum(pp.Pipe(0.295)), 9.0)
        >>> len(found), found[0].kind, found.speeds.round(3).tolist()
        (3, 'flutter', [7.261, 7.852, 8.189])
        >>> print(found.to_csv().splitlines()[0])
        speed,frequency,kind,mode,unstable_before,unstable_after,error
    """

    crossings: tuple[Crossing, ...] = field(repr=False)
    max_speed: float
    model: AnyModel
    unstable_at_rest: int | None = None

    @property
    def speeds(self) -> Array:
        """Flow speeds of the crossings, shape (K,)."""
        return of_each(self.crossings, "speed")

    @property
    def frequencies(self) -> Array:
        """Angular frequencies of the crossings, shape (K,)."""
        return of_each(self.crossings, "frequency")

    def _members(self) -> tuple[Crossing, ...]:
        return self.crossings

    def _shown(self) -> dict[str, Any]:
        kinds = tuple(one.kind for one in self.crossings)
        shown = super()._shown()
        at_rest = shown.pop("unstable_at_rest", None)
        first = {"unstable_at_rest": at_rest} if at_rest else {}
        return first | {"speeds": self.speeds, "kinds": kinds} | shown

    def _columns(self) -> dict[str, Any]:
        names = ["speed", "frequency", "kind", "mode", "unstable_before", "unstable_after", "error"]
        if self.model.dimensions == 3:
            names.append("across")
        return {name: [getattr(one, name) for one in self.crossings] for name in names}


def of_each(results: Iterable[Any], name: str) -> Array:
    """An attribute of each of K results, shape (K,); NaN if the attribute or the result is None."""
    found = [getattr(one, name, None) for one in results]
    return np.array([math.nan if value is None else value for value in found])


def crossings_of(
    problem: Eigenproblem, swept: _core.Sweep, vouched: int | None = None, sensitive: bool = True
) -> tuple[Crossing, ...]:
    """The crossings of a sweep of the core; sensitivities, if `sensitive`, follow when first read.

    A result keeps no pencil, as that of a reduced model may hold matrices.
    """
    found = []
    for crossing in swept.crossings:
        one = Crossing._made(
            speed=crossing.speed,
            frequency=crossing.frequency,
            kind="flutter" if crossing.change % 2 == 0 else "divergence",
            unstable_before=crossing.before,
            unstable_after=crossing.before + crossing.change,
            error=crossing.error,
            mode=crossing.mode,
            sensitivity=partial(_sensitivity, problem.model, crossing) if sensitive else None,
            gyroscopic=crossing.gyroscopic,
            vouched=vouched,
        )
        found.append(one)
    return tuple(found)


def _sensitivity(model: Model, crossing: _core.AxisCrossing) -> Sensitivity | None:
    """Sensitivity of a crossing from its left and right eigenvectors y and x, with Re lambda = 0.

    Along P(i omega, u; p) x = 0, du/dp = -Re lambda_p / Re lambda_u and domega/dp =
    Im(lambda_p + lambda_u du/dp). At a divergence everything is real and the common divisor
    y^H P_lambda x may be 0, since zero is a double root of a conservative pipe: there du/dp =
    -y^H P_p x / y^H P_u x. The result is None where a derivative does not exist.
    """
    if crossing.vectors is None or model.rests_bent:
        return None
    problem = eigenproblem(model)
    pencil, pipe = problem.pencil, problem.pipe
    forms = problem.spectrum().forms(crossing) or pencil.forms(*crossing.vectors)
    u, value = crossing.speed, crossing.value
    if value:
        down = 2.0 * value * forms.mass + u * forms.velocity + forms.damping
        slope = crossing.slope
    else:
        down = 1.0 + 0j
        slope = -forms.flux * 2.0 * pipe.alpha * u
    if slope.real == 0.0:
        return None
    heavier, step = model._stepped("rotary_inertia")  # the mass matrix is linear in it
    right, left = crossing.vectors
    heavier_mass = heavier.pencil().mass(right) - pencil.mass(right)
    inertia = step * complex(np.sum(left.conj() * heavier_mass))
    # d lambda / dp = -y^H (dP/dp) x / down
    changes: dict[str, Any] = {
        "gamma": -forms.gravity / down,
        "damping": -value * forms.by_damping / down,
        "alpha": -(u**2) * forms.flux / down,
        "hysteresis": -1j * forms.by_damping / down if value else 0j,
        "rotary_inertia": -(value**2) * inertia / down,
    }
    if pipe.beta >= LEAST_BETA:
        changes["beta"] = -value * u * forms.velocity / (2.0 * pipe.beta * down)
    if forms.springs.size:
        changes["springs"] = -pencil.by_springs(value) * forms.springs / down
    speed: dict[str, Any] = {"beta": None}
    frequency = speed.copy()
    for name, change in changes.items():
        speed[name] = -change.real / slope.real
        along = change.imag + slope.imag * speed[name]
        frequency[name] = along if value.imag else 0.0 * speed[name]
    return Sensitivity(Derivatives(**speed), Derivatives(**frequency))


STRONG = 1e-4
"""Least sqrt(beta), delta or mu that is solved: rounding changes speeds by 1e-10 to 1e-8 there."""

WEAK = 0.2
"""Share of `STRONG` below which crossings are extrapolated. As measured, errors of speeds are 4e-11
at this share with and without extrapolation; without it they are smaller above this share, and
larger below (7e-10 at a tenth)."""

SQUARES = (1.0, 2.0, 4.0)
"""Squares of the sizes solved, in units of the least. Three determine a parabola in the square,
whose distance from the line through two bounds the error; they are close, so that terms of higher
order stay small."""


def _size(pipe: Pipe) -> float:
    """Largest of sqrt(beta), delta and mu, in units of the least size that is solved."""
    return max(math.sqrt(pipe.beta), pipe.damping, pipe.hysteresis) / STRONG


def is_weakly_damped(pipe: Pipe) -> bool:
    """Whether gyroscopic force and damping are present, but so weak that rounding hides them.

    They are not hidden in an undamped pipe that is held at both ends: it is conservative, and the
    search takes its roots as lying on the axis.
    """
    if pipe.beta > STRONG**2 or not 0.0 < _size(pipe) < WEAK:
        return False
    return not pipe.end_held or bool(pipe.damping or pipe.hysteresis)


def strengthened(pipe: Pipe) -> list[Pipe]:
    """The pipes with stronger gyroscopic force and damping to solve in place of a pipe."""
    flow, delta, mu, size = math.sqrt(pipe.beta), pipe.damping, pipe.hysteresis, _size(pipe)
    factors = [math.sqrt(square) / size for square in SQUARES]
    return [
        replace(pipe, beta=(f * flow) ** 2, damping=f * delta, hysteresis=f * mu) for f in factors
    ]


def extrapolated(pipe: Pipe, found: Sequence[tuple[Crossing, ...]]) -> tuple[Crossing, ...]:
    """Crossings of a pipe from those of the strengthened pipes, which must agree in kind."""
    kinds = [
        [(c.kind, c.across, c.mode, c.unstable_before, c.unstable_after) for c in row]
        for row in found
    ]
    if any(row != kinds[0] for row in kinds):
        raise NotConverged(
            f"crossings at beta = {pipe.beta:g}, damping = {pipe.damping:g} cannot be extrapolated "
            "from larger values, where they differ in kind or mode",
            found[0],
        )
    x = _size(pipe) ** 2
    # Weights of the solved values in the parabola, and in the line, through them at x.
    parabola, line = (
        np.linalg.solve(np.vander(SQUARES[:n]).T, np.vander([x], n)[0]) for n in (3, 2)
    )
    result = []
    for same in zip(*found, strict=True):
        speeds, frequencies = [c.speed for c in same], [c.frequency for c in same]
        speed = float(np.dot(parabola, speeds))
        curved = abs(speed - float(np.dot(line, speeds[:2])))
        error = curved + float(np.dot(np.abs(parabola), [c.error for c in same]))
        result.append(
            replace(
                same[0],
                speed=speed,
                frequency=float(np.dot(parabola, frequencies)),
                error=error,
                sensitivity=_weakened(pipe, same[0].sensitivity),
            )
        )
    return tuple(result)


def _weakened(pipe: Pipe, sensitivity: Sensitivity | None) -> Sensitivity | None:
    """Sensitivity of a pipe from that of its first strengthened pipe, rescaled by both sizes."""
    if sensitivity is None:
        return None
    solved = strengthened(pipe)[0]
    weaker = _size(solved) / _size(pipe)

    def shrunk(by: Derivatives) -> Derivatives:
        # In u = F(ratio) + beta G, derivatives of F grow as the size shrinks, by beta like
        # 1 / beta. At beta = 0 with one kind of damping there is no ratio, and u is even in it.
        shrinks = [by.beta is None and not other for other in (solved.hysteresis, solved.damping)]
        damping, hysteresis = (
            one * (1.0 / weaker if alone else weaker)
            for one, alone in zip((by.damping, by.hysteresis), shrinks, strict=True)
        )
        beta = by.beta
        if beta is not None:
            across = 0.5 * (by.damping * solved.damping + by.hysteresis * solved.hysteresis)
            beta += across / solved.beta - across / pipe.beta
        return replace(by, beta=beta, damping=damping, hysteresis=hysteresis)

    return Sensitivity(shrunk(sensitivity.speed), shrunk(sensitivity.frequency))
