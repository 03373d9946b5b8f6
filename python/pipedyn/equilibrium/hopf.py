# SPDX-License-Identifier: MIT
"""Onset of flutter beyond linear theory: side on which cycles emerge, and growth of amplitude.

The normal form z' = i omega z + c_1 z |z|^2 of a pair of eigenvalues, with right and left
eigenvectors q and p, is that of normal_form.py, and l_1 = Re c_1 / omega.

Let N be a force without a third derivative at rest that is odd and of second degree along each ray,
N(r y) = r^2 N(y). To first order in r it adds, at y = rest + r Re(q exp(i phi)), the coefficient

    d = mean over phi of 2 <p, N(Re(q e^(i phi)))> e^(-i phi).

These formulas hold for any system. Without drag l_1 decides: if q is scaled to unit displacement of
the free end, whose amplitude then is 2 |z|, amplitude^2 / (u - u_c) -> -4 growth / (omega_c l_1).

Quadratic drag is a force N of this kind: it has no third derivative at rest and acts at second
degree. The
free end moves like Re Z with the amplitude equation

    Z' = (i omega_c + lambda_u (u - u_c)) Z + d |Z| Z + c_1 / 4 |Z|^2 Z + ...,

in which c_1 is the coefficient of all other forces. With drag, amplitude / (u - u_c) -> -growth /
Re(d). Strictly the drag alone decides the onset, but only below the amplitude 4 |Re d / Re c_1|, at
which the two terms balance. Neglected terms are of the size d^2 |Z|^2 Z and d (u - u_c) |Z| Z: the
equation holds for weak drag, and for any drag where the amplitude is small.

At constant head the flow speed is one more state (`Supply`). To first order about the straight
pipe, the speed and the pipe do not act on each other, so that the pair stays as it is. But a moving
pipe changes the speed at second degree, which changes the coefficient c_1 by its two terms with B.

The mean of the drag is weighted by the left eigenvector, not by the velocity: drag changes the
shape of the mode as well, and thereby the energy that the flow feeds, so that it may even drive the
flutter, Re(d) > 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent import futures
from dataclasses import field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.equilibrium.axis_problems import gyroscopic_mass
from pipedyn.equilibrium.equilibria import BranchPoint
from pipedyn.equilibrium.normal_form import (
    FIRST_STEP,
    LEVELS,
    NoHopf,
    NormalForm,
    neville_limit,
    normal_form,
    projected_limit,
    second_and_third,
    vectors,
)
from pipedyn.equilibrium.statics import statics_of
from pipedyn.linear.critical_speed import critical_point
from pipedyn.linear.neutral import grows
from pipedyn.linear.rest import at_rest
from pipedyn.linear.sensitivity import Crossing
from pipedyn.linear.stability_curve import Failure, SweptResult, sweep
from pipedyn.models.base import Model
from pipedyn.models.drive import Supply
from pipedyn.models.pipe import Pipe
from pipedyn.motion.constant_head import ConstantHead
from pipedyn.motion.simulate import checked_model_in_motion
from pipedyn.motion.vector_field import VectorField
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotConverged, warn_of_plane
from pipedyn.util.parallel import one_thread, outcome_of
from pipedyn.util.result import LENGTH, SPEED, Result

# --------------------------------------------------------------------------------- for the pipe


@saved_as("HopfPoint")
class HopfPoint(Result):
    """A pair of eigenvalues on the imaginary axis, at which small periodic orbits emerge."""

    speed: float
    frequency: float
    mode: Complex = field(repr=False, compare=False, kw_only=True)
    rest: Array = field(repr=False, compare=False, kw_only=True)


def hopf_point(motion: VectorField, crossing: Crossing | BranchPoint) -> HopfPoint:
    """Hopf point at a flutter of the straight pipe or of a bent pipe.

    Raises:
        ValueError, NoHopf: as `vectors` does.
    """
    u, rest = crossing.speed, _rest_at(motion, crossing)
    jacobian = motion.jacobian(rest, u)
    mode, _ = vectors(jacobian, crossing.frequency, lambda q: _tip_of(motion.model, rest, q))
    return HopfPoint(u, crossing.frequency, mode=mode, rest=rest)


def _rest_at(motion: VectorField, crossing: Crossing | BranchPoint) -> Array:
    """The equilibrium that starts to flutter, an integrated state, shape (2 integrated,).

    Raises:
        ValueError: if the pipe is not in equilibrium there.
    """
    if isinstance(crossing, BranchPoint):
        return np.asarray(motion.model.initial_state(crossing.q, None))
    model = at_rest(motion.model, crossing.speed)
    model.require_equilibrium(crossing.speed)
    return np.concatenate([model.resting(), np.zeros(motion.half)])


@saved_as("Hopf")
class Hopf(HopfPoint, units={"balance": LENGTH, "fold": SPEED}):
    """A flutter onset, and the limit cycle that emerges there.

    The amplitude A of the free end obeys A' = growth (u - u_c) A + Re(quadratic) A^2 + Re(cubic)
    A^3, and the phase phi' = omega_c + detuning (u - u_c) + Im(quadratic) A + Im(cubic) A^2.

    Attributes:
        speed: u_c.
        frequency: omega_c, in 1 / T.
        growth: d Re(lambda) / du of the pair.
        detuning: d Im(lambda) / du of the pair.
        quadratic: complex coefficient of the drag, in 1 / (L T); 0 without drag.
        cubic: complex coefficient of all other forces, in 1 / (L^2 T).
        lyapunov: first Lyapunov coefficient without drag, with q scaled to unit displacement of the
            free end.
        lyapunov_error: absolute error of `lyapunov`, which comes from differences.
        amplitude_law: limit of amplitude^2 / (u - u_c) or, with drag, of amplitude / (u - u_c);
            negative where the cycle exists below u_c. Where the leading coefficient passes 0 along
            a parameter (a Bautin point) the limit grows without bound, and holds at ever smaller
            amplitudes only.
        amplitude_error: absolute error of amplitude_law, which comes from differences.
        frequency_law: limit of (omega - omega_c) / (u - u_c) along the cycles.
        exponent: power of |u - u_c| with which the amplitude grows: 1/2, or 1 with drag.
        criticality: "supercritical" if the cycle attracts motions in the critical mode, and so
            exists where that mode grows; "subcritical" if it repels. With drag this holds at
            amplitudes far below `balance`; for larger ones see `fold`. If other modes grow at the
            onset (`other_unstable`), no cycle that emerges there is stable.
        crossing: the crossing of the pair, as it was given or found.
        model: the model.
        mode: eigenvector q, complex, of the integrated state [p, p'], shape (2 integrated,).
        rest: the equilibrium, an integrated state, shape (2 integrated,).
        friction: friction of the supply at constant head, where u is the flow speed in the straight
            pipe; None at constant speed.

    Example:
        >>> found = pp.hopf(pp.Chain(pp.Pipe(0.2), 4))
        >>> found.criticality, round(found.speed, 4), round(found.amplitude_law, 4)
        ('supercritical', 4.9493, 0.2599)
    """

    growth: float
    detuning: float
    quadratic: complex
    cubic: complex
    lyapunov: float
    lyapunov_error: float
    amplitude_law: float
    amplitude_error: float
    frequency_law: float
    exponent: float
    criticality: Literal["supercritical", "subcritical"]
    crossing: Crossing | BranchPoint = field(repr=False)
    model: Model = field(repr=False)
    friction: float | None = None

    @property
    def other_unstable(self) -> int:
        """Number of eigenvalues with positive real part at the onset, without the critical pair."""
        if isinstance(self.crossing, Crossing):
            return min(self.crossing.unstable_before, self.crossing.unstable_after)
        statics, place = statics_of(self.model, np.split(self.rest, 2)[0])
        values = statics.eigenvalues(place, self.speed)
        pair = np.minimum(*(np.abs(values - sign * 1j * self.frequency) for sign in (1.0, -1.0)))
        return int(np.count_nonzero(grows(values)[np.argsort(pair)[2:]]))

    @property
    def balance(self) -> float:
        """Amplitude, in L, at which drag and the cubic terms are equal; 0 without drag.

        Far below it the drag decides.
        """
        quadratic, cubic = abs(self.quadratic.real), abs(self.cubic.real)
        return quadratic / cubic if cubic > 0.0 else math.inf

    @property
    def fold(self) -> float | None:
        """Speed at which cycles of the amplitude equation turn back; None if they do not.

        Cycles turn back if drag and cubic terms have opposite signs, at half the amplitude of
        `balance`. For two segments (beta 0.05 and 0.02) the distance of this speed from the onset
        is right to 1 % at an amplitude of 0.02 and to 12 % at 0.05; the cycles of the pipe do not
        turn back at this speed if that amplitude is 0.085 or more.
        """
        quadratic, cubic = self.quadratic.real, self.cubic.real
        if quadratic * cubic >= 0.0:
            return None
        return self.speed + 0.25 * quadratic**2 / (cubic * self.growth)

    def amplitude(self, u: float) -> float:
        """Amplitude of the free end by the amplitude equation at a speed, in L.

        If there are two cycles, it is the smaller amplitude. With three segments at beta 0.2 and
        drag up to 1 it is right to 4 % at amplitudes up to 0.1; with four segments at beta 0.8,
        where l_1 is near 19, it is right to 3 % up to 0.03.

        Example:
            >>> found = pp.hopf(pp.Chain(pp.Pipe(0.2), 4))
            >>> round(found.amplitude(found.speed + 0.01), 4)
            0.051
            >>> cycle = pp.limit_cycle(pp.Chain(pp.Pipe(0.2), 4), found.speed + 0.01)
            >>> round(cycle.amplitude, 4)
            0.0509

        Raises:
            ValueError: if the amplitude equation has no cycle at that speed.
        """
        u = check.real("u", u, low=0.0)
        quadratic, cubic = self.quadratic.real, self.cubic.real
        fed = self.growth * (u - self.speed)
        if fed == 0.0:
            return 0.0
        inside = 0.0 if u == self.fold else quadratic**2 - 4.0 * cubic * fed
        if inside >= 0.0:  # roots of fed + quadratic A + cubic A^2, without cancellation
            both = -0.5 * (quadratic + math.copysign(math.sqrt(inside), quadratic))
            sizes = [fed / both, both / cubic if cubic else 0.0]
            if max(sizes) > 0.0:
                return min(size for size in sizes if size > 0.0)
        above = self.growth * (quadratic or cubic) < 0.0
        if self.fold is None:
            where = f"{'above' if above else 'below'} the onset at {self.speed:.9g}"
        else:
            where = f"{'below' if above else 'above'} the fold at {self.fold:.9g}"
        raise ValueError(f"u must be {where}, got {u:.9g}")

    def cycle_frequency(self, u: float) -> float:
        """Angular frequency, in 1 / T, of the cycle whose amplitude `amplitude` gives at a speed.

        Example:
            >>> found = pp.hopf(pp.Chain(pp.Pipe(0.2), 4))
            >>> round(found.cycle_frequency(found.speed + 0.01) - found.frequency, 5)
            -0.00783

        Raises:
            ValueError: if the amplitude equation has no cycle at that speed.
        """
        size = self.amplitude(u)
        turned = self.quadratic.imag * size + self.cubic.imag * size**2
        return self.frequency + self.detuning * (float(u) - self.speed) + turned


@saved_as("SpatialHopf")
class SpatialHopf(Result):
    """A flutter onset in three dimensions, and the motions that emerge there.

    The pair of eigenvalues is double, for motions in the planes of x and of z. With the complex
    amplitudes z and w of the two circular motions, whose sum at z = w is planar,

        z' = z (lambda + A |z|^2 + B |w|^2),   w' = w (lambda + A |w|^2 + B |z|^2),

    where the free end is displaced by 2 |z| in circular and 4 |z| in planar motion. Either motion
    exists at speeds at which its law is positive.

    Attributes:
        plane: the onset in a plane, a `Hopf`, with its speed, frequency, growth and laws.
        own: A, in 1 / (L^2 T).
        other: B, in 1 / (L^2 T).
        error: largest absolute error of A and B, which comes from extrapolation.
        model: the model.

    Example:
        >>> found = pp.hopf(pp.Chain(pp.Pipe(0.2), n=10, dimensions=3))
        >>> found.stable, round(found.own.real, 2), round(found.other.real, 2)
        ('rotating', -84.39, -87.23)

    Source: Golubitsky, Stewart and Schaeffer, Singularities and Groups in Bifurcation Theory II,
    ch. XVII; for this pipe Bajaj and Sethna (1984).
    """

    plane: Hopf
    own: complex
    other: complex
    error: float
    model: Model = field(repr=False)

    @property
    def speed(self) -> float:
        """Critical speed u_c."""
        return self.plane.speed

    @property
    def frequency(self) -> float:
        """Critical frequency omega_c, in 1 / T."""
        return self.plane.frequency

    @property
    def planar_law(self) -> float:
        """Limit of amplitude^2 / (u - u_c) of planar motion."""
        return -16.0 * self.plane.growth / (self.own + self.other).real

    @property
    def rotating_law(self) -> float:
        """Limit of radius^2 / (u - u_c) of circular motion."""
        return -4.0 * self.plane.growth / self.own.real

    @property
    def stable(self) -> Literal["planar", "rotating", "neither"]:
        """The motion that attracts where it emerges, if no other mode grows there."""
        if self.own.real < self.other.real and (self.own + self.other).real < 0.0:
            return "planar"
        return "rotating" if self.other.real < self.own.real < 0.0 else "neither"

    @property
    def planar_exponent(self) -> float:
        """Growth rate, over u - u_c, of motion across the plane of a planar motion."""
        parts = (self.own - self.other).real / (self.own + self.other).real
        return -2.0 * self.plane.growth * parts

    @property
    def rotating_exponent(self) -> float:
        """Growth rate, over u - u_c, of the opposite circular motion beside a circular one."""
        return self.plane.growth * (1.0 - self.other.real / self.own.real)


def _spatial_hopf(model: Model, plane: Hopf) -> SpatialHopf:
    """The onset in three dimensions, with both coefficients.

    A = <P, C(E, E, E*)> / 2 and B = <P, C(E, F, F*)> with the states E = (q, i q) and F = (q, -i q)
    in both planes, and P = (p, i p) / 2.

    Raises:
        ValueError: for a pipe to which this does not apply.
    """
    if plane.quadratic or plane.friction is not None:
        raise ValueError(
            "an onset in three dimensions needs a pipe without drag and at constant speed, got "
            f"{model!r}"
        )
    motion, planar = VectorField(model), model.planar
    jacobian = VectorField(planar).jacobian(plane.rest, plane.speed)
    q, p = vectors(jacobian, plane.frequency, lambda q: _tip_of(planar, plane.rest, q))

    def both_planes(vector: Complex, turn: complex) -> Complex:
        """The state (v, turn v), in the coordinates of both planes, shape (2 integrated,)."""
        halves = np.split(vector, 2)
        return np.concatenate([part for half in halves for part in (half, turn * half)])

    rest = motion.resting()
    a = motion.jacobian(rest, plane.speed)
    one, left = both_planes(q, 1j), 0.5 * both_planes(p, 1j)
    steps = np.ldexp(FIRST_STEP / planar.largest_angle(q[: planar.integrated]), -np.arange(LEVELS))

    def coefficient(turn: complex) -> tuple[complex, float]:
        about = both_planes(q, turn)
        parts = second_and_third(partial(motion.jacobians, u=plane.speed), rest, a, about, steps)
        return projected_limit(a, left, one, [third @ one for _, third in parts], steps)

    own, error = coefficient(1j)
    other, spread = coefficient(-1j)
    return SpatialHopf(plane, 0.5 * own, other, 0.5 * error + spread, model)


def hopf(
    model: Model,
    crossing: Crossing | BranchPoint | None = None,
    *,
    friction: float | None = None,
) -> Any:
    """The limit cycle that emerges at a flutter onset: amplitude law, and side where it exists.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        crossing: a flutter from `crossings(model, ...)`, or a point of kind "hopf" on a branch of
            bent equilibria from `equilibrium_branch(model, ...)`; if not given, the crossing at
            the critical speed, about the rest that follows the flow if a load bends the pipe.
        friction: friction of a straight pipe that is fed at constant head, as in `Supply`; if it
            is not given, the speed is constant. The onset is the same, with u the speed in the
            straight pipe.

    Returns:
        Hopf; of a model in three dimensions SpatialHopf, which tells planar from circular motion.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.3), 6)
        >>> steady, fed = pp.hopf(chain), pp.hopf(chain, friction=1.0)
        >>> steady.criticality, fed.criticality, fed.amplitude_law > 2.0 * steady.amplitude_law
        ('supercritical', 'supercritical', True)

    Raises:
        NoCrossing: if no crossing is given and the pipe does not lose stability.
        NoHopf: if stability is lost by divergence or from u = 0 on, two pairs meet at the onset, or
            the free end does not move in the mode.
        NotConverged: if differences do not converge (a force other than drag is not smooth), or
            the law's first coefficient is 0 within its error; eigenvalues not found.
        ValueError: if the crossing is no flutter, or not of this model.
        TypeError: for arguments that are not a model or crossing of these kinds.

    Source: Kuznetsov's projection formula, see `normal_form`.
    """
    # With more degrees of freedom, dense eigenvectors lose digits that differences need.
    model = checked_model_in_motion(model, largest=500, purpose="hopf")
    if model.axisymmetric:
        return _spatial_hopf(model, hopf(model.planar, crossing, friction=friction))
    if friction is not None:  # else its refusal would be taken for that of the onset
        Supply.at_speed(model.pipe, 1.0, friction=friction)
    own = crossing is None
    if crossing is None:
        if model.dimensions == 2 and not model.pipe.rests_straight:
            warn_of_plane(__name__)
        critical, found = critical_point(model)
        if critical.kind != "flutter":
            raise NoHopf(
                f"stability is lost by divergence at u = {critical.speed:g}; a flutter beyond it "
                "may be given as crossing="
            )
        crossing = next(one for one in found if one.destabilising)
    check.instance("crossing", crossing, Crossing | BranchPoint, "a Crossing or a BranchPoint")
    if crossing.kind not in ("flutter", "hopf"):
        raise ValueError(f"crossing must be a flutter, got a {crossing.kind}")
    u = crossing.speed
    if crossing.frequency == 0.0:
        raise NoHopf(
            f"two growing real eigenvalues become a pair at u = {u:g}, away from the axis: no "
            "cycle emerges there"
        )
    if u == 0.0:
        raise NoHopf(
            "the pipe is unstable from u = 0 on: all its modes lie on the axis there, and no cycle "
            "belongs to one of them"
        )
    motion = VectorField(model)
    rest = _rest_at(motion, crossing)
    if friction is not None and rest.any():
        raise ValueError(
            "friction must be None of a bent pipe, whose onset at constant head is another one"
        )
    with one_thread(motion.size):
        try:
            form, drag, spread = onset_coefficients(model, u, crossing.frequency, rest, friction)
        except ValueError as error:
            if own:  # where two pairs meet, eigenvalues scatter by the root of rounding
                raise NoHopf(f"no simple pair lies on the axis at u = {u:g}") from error
            raise
        slope = _slope(motion, rest, u, form)
    if abs(slope.real) < 1e-9 * (1.0 + abs(slope)):
        raise NoHopf(f"the pair touches the axis at u = {u:g} and does not pass through it")
    cubic = 0.25 * form.cubic
    leading, name = drag, "the mean of drag"
    if not drag:
        leading, spread, name = cubic, 0.25 * form.error, "the first Lyapunov coefficient"
    if abs(leading.real) <= spread:
        raise NotConverged(
            f"{name} at u = {u:g} is 0 within its error of {spread:.1e}, as at a Bautin point: "
            "terms of higher degree decide, which are not computed",
            form,
        )
    law = -slope.real / leading.real
    return Hopf(
        speed=u,
        frequency=form.frequency,
        growth=slope.real,
        detuning=slope.imag,
        quadratic=drag,
        cubic=cubic,
        lyapunov=form.lyapunov,
        lyapunov_error=form.error / form.frequency,
        amplitude_law=law,
        amplitude_error=abs(law * spread / leading.real),
        frequency_law=slope.imag + law * leading.imag,
        exponent=1.0 if drag else 0.5,
        criticality="supercritical" if leading.real < 0.0 else "subcritical",
        crossing=crossing,
        model=model,
        mode=form.right,
        rest=rest,
        friction=friction,
    )


def onset_coefficients(
    model: Model, u: float, frequency: float, rest: Array, friction: float | None = None
) -> tuple[NormalForm, complex, float]:
    """Normal form of a flutter without drag, and the mean of drag with its error.

    The eigenvector q is scaled to unit displacement of the free end. The eigenvectors hold the
    states of the pipe only, without the flow speed at constant head.

    Args:
        model: the model.
        u: flow speed.
        frequency: angular frequency of the pair.
        rest: the equilibrium, an integrated state, shape (2 integrated,).
        friction: friction of a pipe at constant head; None at constant speed.

    Raises:
        ValueError, NoHopf, NotConverged: as `normal_form` does.
    """
    smooth, state = with_drag(model, 0.0), rest
    jacobians: Callable[[Array], Array] = partial(smooth.jacobians, u=u)
    if friction is not None:
        supply = Supply.at_speed(model.pipe, u, friction=friction)
        jacobians, state = ConstantHead(smooth.model, supply).jacobians, np.append(rest, u)
    form = normal_form(
        jacobians,
        state,
        frequency,
        lambda q: _tip_of(model, rest, q),
        lambda q: model.largest_angle(q[: smooth.half]),
    )
    form = replace(form, right=form.right[: rest.size], left=form.left[: rest.size])
    return form, *_mean_drag(model, smooth, rest, u, form)


def static_cubic(model: Model, u: float) -> float:
    """Coefficient c of z' = sigma z + c z^3 at a divergence of the straight pipe, in 1 / T.

    The amplitude z is the largest angle of the shape that buckles, in rad; c is negative where the
    bent equilibria attract. For an undamped pipe z'' replaces z'.

    Raises:
        NotConverged: if differences do not converge.
    """
    motion = VectorField(model)
    half, rest = motion.half, motion.resting()
    whole = motion.jacobian(rest, u)[half:]
    a = whole[:, :half]
    left, _, right = np.linalg.svd(a)
    shape, weight = right[-1], left[:, -1]
    shape = shape / model.largest_angle(shape)
    slowed = -whole[:, half:]
    rate = float(weight @ slowed @ shape)
    if abs(rate) <= 1e-9 * float(np.linalg.norm(slowed)) * float(np.linalg.norm(shape)):
        rate = float(weight @ shape) + gyroscopic_mass(-a, slowed, shape, weight)
    weight = weight / rate
    steps = FIRST_STEP / 2.0 ** np.arange(LEVELS)
    moves = np.concatenate([np.outer(shape, sign * steps) for sign in (1.0, -1.0)], axis=1)
    moves = np.concatenate([moves, np.zeros_like(moves)])
    around = motion.jacobians((rest[:, None] + moves).copy(), u)[:, half:, :half]
    second = (around[:LEVELS] + around[LEVELS:] - 2.0 * a) / steps[:, None, None] ** 2
    values = (second @ shape) @ weight / 6.0
    terms = float(np.abs(weight) @ np.abs(a) @ np.abs(shape))
    size = float(np.abs(weight) @ np.abs(second[0]) @ np.abs(shape))
    rounding = np.finfo(float).eps * terms / steps**2
    value, error = neville_limit([complex(one) for one in values], rounding)
    if not error <= 1e-3 * size:
        raise NotConverged(
            f"the third derivatives at the divergence at u = {u:g} do not converge: "
            f"{value.real:.6g} with an error of {error:.1e}"
        )
    return value.real


def with_drag(model: Model, drag: float) -> VectorField:
    """Equations of motion of a model in which the pipe's drag has another value."""
    if model.pipe.drag == drag:
        return VectorField(model)
    return VectorField(model.with_pipe(replace(model.pipe, drag=drag)))


def _slope(motion: VectorField, rest: Array, u: float, form: NormalForm) -> complex:
    """Derivative of the pair's eigenvalue by the speed.

    It includes the effect of the change of the equilibrium with the speed.
    """
    force = motion.linearised(rest[:, None], u)[0, 1]
    moved = np.zeros_like(rest)
    if np.abs(force).max() > 1e-10 * (1.0 + u):
        count_factorisations()
        moved = -np.asarray(np.linalg.solve(motion.jacobian(rest, u), force), dtype=np.float64)
    return complex(form.left.conj() @ (motion.jacobian_by_speed(rest, u, moved) @ form.right))


def _mean_drag(
    model: Model, smooth: VectorField, rest: Array, u: float, form: NormalForm
) -> tuple[complex, float]:
    """Mean of drag over one period of the mode, called d in the module's docstring, and its error.

    The mean is 0 without drag.
    """
    # A smaller drag decides only at amplitudes that are practically 0, and its law overflows.
    if model.pipe.drag < 1e-100:
        return 0j, 0.0
    # At a small amplitude r, terms of higher degree are r^2 times the mean. The drag is multiplied
    # by 1 / r to make it as large as the linear forces: else it would be lost in their rounding.
    r = 1e-6 / model.largest_angle(form.right[: smooth.half])
    strong = with_drag(model, 1.0 / r)
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 8192, endpoint=False))  # kinks need many
    line = np.outer(form.right.real, turn.real) - np.outer(form.right.imag, turn.imag)
    y = np.ascontiguousarray(rest[:, None] + r * line)
    means = 2.0 * (form.left.conj() @ (strong(y, u) - smooth(y, u))) * turn.conj() / r
    value = complex(np.mean(means))
    # The error is the difference from the mean over a quarter of the phases, plus rounding.
    error = abs(complex(np.mean(means[::4])) - value) + 1e-9 * abs(value)
    return model.pipe.drag * value, model.pipe.drag * error


def _tip_of(model: Model, rest: Array, mode: Complex) -> complex:
    """Transverse displacement of the free end in a mode, to first order.

    In three dimensions it is that along x or along z, whichever is larger. It is computed as the
    velocity of the free end for rates p' that are the mode's coordinates.
    """
    half = rest.size // 2
    parts = np.stack([mode.real, mode.imag])[:, :half]
    q, rates = model.to_user(np.stack([rest[:half]] * 2), parts)
    moved = model.tip_velocities(q.T, rates.T)[:, ::2]
    along = int(np.abs(moved).sum(axis=0).argmax())
    return complex(*moved[:, along])


# ----------------------------------------------------------------------- against a parameter


@saved_as("CriticalityCurve")
class CriticalityCurve(SweptResult, units={"folds": SPEED}):
    """Onsets of flutter against a parameter.

    Attributes:
        values: values of the parameter, shape (S,).
        onsets: the Hopf at each value, None where the point failed.
        failures: points that failed, with the exceptions raised: `NoHopf` if stability is lost
            otherwise than by flutter, `NoCrossing` if it is not lost.
        pipes: the pipe at each value, None where there is no model.
    """

    _each, _word, _numbers = "onsets", "criticality", ("lyapunov",)

    onsets: tuple[Hopf | None, ...] = field(repr=False)
    failures: tuple[Failure, ...]
    pipes: tuple[Pipe | None, ...] = field(default=(), repr=False)

    @property
    def laws(self) -> Array:
        """Amplitude laws, shape (S,), negative if subcritical; NaN where there is no onset."""
        return self._of_each("amplitude_law")

    @property
    def subcritical(self) -> NDArray[np.bool_]:
        """Whether the cycle that emerges repels, so that flutter is large at once, shape (S,)."""
        kinds = [getattr(one, "criticality", None) for one in self.onsets]
        return np.array([kind == "subcritical" for kind in kinds])

    @property
    def folds(self) -> Array:
        """Speeds of `Hopf.fold`, shape (S,); NaN where there is no fold.

        With drag an onset may be supercritical although its cycles turn back at this speed, beyond
        which flutter is large at once. Under weak drag this speed is hardly above the onset.
        """
        return self._of_each("fold")

    @property
    def changes(self) -> Array:
        """Neighbouring values between which the criticality of the onset changes, shape (C, 2).

        Either the leading coefficient passes 0 there (a Bautin point), near which `laws` grow
        without bound, or the onset passes to another mode.
        """
        known, side = ~np.isnan(self.speeds), self.subcritical
        at = np.flatnonzero(known[:-1] & known[1:] & (side[:-1] != side[1:]))
        return np.stack([self.values[at], self.values[at + 1]], axis=1)

    def _shown(self) -> dict[str, Any]:
        first = {"values": self.values, "speeds": self.speeds, "subcritical": self.subcritical}
        return first | super()._shown()


def _onsets(models: Sequence[Model]) -> list[Hopf | Exception]:
    return [outcome_of(hopf, model) for model in models]


def criticality_curve(
    make_model: Callable[[float], Model],
    values: ArrayLike,
    executor: futures.Executor | None = None,
    progress: bool = False,
) -> CriticalityCurve:
    """Criticality of flutter at the critical speed, super- or subcritical, against a parameter.

    Args:
        make_model: makes the model at a value of the parameter; it is called in this process, so
            that it may be a lambda. A map over two parameters consists of one such curve for each
            row.
        values: values of the parameter, shape (S,).
        executor: a `concurrent.futures.Executor` that computes the points. Points that it does not
            compute, because a worker died or it is broken or shut down, fail.
        progress: whether to show progress on stderr.

    Returns:
        CriticalityCurve; a point that fails is recorded in `failures` and the others are kept.

    Example:
        >>> curve = pp.criticality_curve(lambda beta: pp.Chain(pp.Pipe(beta), 2), [0.05, 0.2])
        >>> curve.subcritical.tolist()
        [True, False]

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    given = make_model, values, _onsets, executor, progress
    at, pipes, onsets, failures = sweep(*given, "criticality", __name__)
    return CriticalityCurve(at, tuple(onsets), failures, pipes)
