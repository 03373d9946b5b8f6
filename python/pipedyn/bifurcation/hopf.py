# SPDX-License-Identifier: MIT
"""Onset of flutter beyond linear theory: which way the limit cycle is born, and how fast it grows.

On the centre manifold of a pair i omega_c with right and left eigenvectors q and p, <p, q> = 1,

    z' = (i omega_c + lambda_u (u - u_c)) z + c_1 z |z|^2 + ...,   y = rest + 2 Re(z q) + ...,

    2 c_1 = <p, C(q, q, q*) - 2 B(q, A^-1 B(q, q*)) + B(q*, (2 i omega_c - A)^-1 B(q, q))>

with A, B and C the first three derivatives of the rate (Kuznetsov, Elements of Applied Bifurcation
Theory, eq. (5.39) of the third edition): l_1 = Re c_1 / omega_c. With q scaled to unit displacement
of the free end, its amplitude is 2 |z|, so that amplitude^2 / (u - u_c) -> -4 growth / (omega_c
l_1). B and C act along two real directions only, so they follow from the analytic Jacobian on these
two lines, by central differences whose steps are halved and extrapolated.

Quadratic drag has no third derivative at rest. Its force N is of second degree along each ray,
N(r y) = r^2 N(y), and odd: to first order in r, y = rest + r Re(q exp(i phi)), it adds

    d = mean over phi of 2 <p, N(Re(q e^(i phi)))> e^(-i phi).

So the free end moves like Re Z with the amplitude equation

    Z' = (i omega_c + lambda_u (u - u_c)) Z + d |Z| Z + c_1 / 4 |Z|^2 Z + ...,

c_1 being that of the other forces. With drag amplitude / (u - u_c) -> -growth / Re(d): strictly the
drag alone decides the onset, but only below the amplitude 4 |Re d / Re c_1|, at which the two terms
balance. Terms that are left out are of the size d^2 |Z|^2 Z and d (u - u_c) |Z| Z: the equation is
that of faint drag, and of any drag where the amplitude is small.

It is the left eigenvector that weighs the drag, not the velocity: drag bends the mode as well,
which changes what the flow feeds, so that it may even drive the flutter, Re(d) > 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pipedyn.bifurcation.equilibria import BranchPoint, Rest
from pipedyn.bifurcation.vector_field import STENCIL, Field
from pipedyn.linear.critical_speed import critical_speed
from pipedyn.linear.eigenproblem import Complex
from pipedyn.linear.sensitivity import Crossing
from pipedyn.models.base import Model, NotConverged, PipedynError
from pipedyn.models.galerkin import Galerkin
from pipedyn.motion.simulate import checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised
from pipedyn.util.threads import one_thread

LARGEST_HOPF = 500
"""Degrees of freedom; beyond, dense eigenvectors lose the digits that differences need."""

LEAST_DRAG = 1e-100
"""Less acts at amplitudes alone that are nothing, and its law would leave finite numbers."""

LEVELS = 6
"""Steps of the differences, each half of the one before."""

FIRST_STEP = 0.2
"""The longest: the largest angle of the displaced mode, rad."""

PLACES = 401
"""Along the pipe among which the largest angle of a mode of functions is found."""

PHASES = 8192
"""Over which drag is averaged; its integrand has kinks, so the mean converges slowly."""

MET = 3e-5
"""Cosine of the angle between left and right eigenvector below which two pairs have met; rounding
leaves the root of its own size."""

COARSEST = 1e-3
"""Relative error of a normal form beyond which it is no result."""


class NoHopf(PipedynError):
    """A loss of stability from which no limit cycle is born the way of Hopf's theorem."""


@dataclass(frozen=True)
class NormalForm:
    """What decides a Hopf point: z' = i omega z + cubic z |z|^2.

    Attributes:
        frequency: omega.
        right: q, complex, shape (N,), scaled as asked for.
        left: p, complex, shape (N,), with <p, q> = sum conj(p) q = 1.
        cubic: c_1.
        error: of c_1, absolute, estimated from the last two extrapolations.
    """

    frequency: float
    right: Complex = field(repr=False)
    left: Complex = field(repr=False)
    cubic: complex
    error: float

    @property
    def lyapunov(self) -> float:
        """First Lyapunov coefficient l_1 = Re c_1 / omega."""
        return self.cubic.real / self.frequency


@dataclass(frozen=True)
class Hopf:
    """A flutter onset, and the limit cycle born there.

    The amplitude A of the free end obeys A' = growth (u - u_c) A + Re(quadratic) A^2 + Re(cubic)
    A^3, and the phase phi' = omega_c + detuning (u - u_c) + Im(quadratic) A + Im(cubic) A^2.

    Attributes:
        speed: u_c.
        frequency: omega_c, in 1 / T.
        growth: d Re(lambda) / du.
        detuning: d Im(lambda) / du.
        quadratic: of the drag, complex, in 1 / (L T); 0 without.
        cubic: of all other forces, complex, in 1 / (L^2 T).
        lyapunov: first Lyapunov coefficient, of q scaled to unit displacement of the free end; with
            drag that of the pipe without its drag.
        lyapunov_error: absolute, of the differences.
        amplitude_law: limit of amplitude^2 / (u - u_c), with drag of amplitude / (u - u_c);
            negative where the cycle lives below u_c. Where the leading coefficient passes 0 along a
            parameter (a Bautin point) it grows without bound, and holds at ever smaller amplitudes
            only.
        amplitude_error: of amplitude_law, absolute, from that of the differences.
        frequency_law: limit of (omega - omega_c) / (u - u_c) along the cycles.
        exponent: the cycle grows like |u - u_c| to this power, 1/2, with drag 1.
        criticality: "supercritical" if the cycle attracts all that the critical mode does, and so
            lives where that mode grows; "subcritical" if it repels. With drag this is said of
            amplitudes far below `balance`; of what follows tells `fold`. Where other modes grow at
            the onset, `unstable_beside`, no cycle born there is stable.
        crossing: the passage of the pair.
        model: the model.
        mode: q, complex, of the integrated state [p, p'], shape (2 moving,).
        rest: the equilibrium, an integrated state, shape (2 moving,).
    """

    speed: float
    frequency: float
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
    mode: Complex = field(repr=False, compare=False)
    rest: Array = field(repr=False, compare=False)

    @property
    def unstable_beside(self) -> int:
        """Number of eigenvalues with positive real part at the onset, beside the pair."""
        if isinstance(self.crossing, Crossing):
            return min(self.crossing.unstable_before, self.crossing.unstable_after)
        values = np.linalg.eigvals(Field(self.model).jacobian(self.rest, self.speed))
        pair = np.minimum(*(np.abs(values - sign * 1j * self.frequency) for sign in (1.0, -1.0)))
        return int(np.count_nonzero(values[np.argsort(pair)[2:]].real > 0.0))

    @property
    def balance(self) -> float:
        """Amplitude at which drag and the cubic terms are equal, far below which drag decides.

        In L, 0 without drag.
        """
        quadratic, cubic = abs(self.quadratic.real), abs(self.cubic.real)
        return quadratic / cubic if cubic > 0.0 else math.inf

    @property
    def fold(self) -> float | None:
        """Speed at which the amplitude equation's cycles turn back; None where they do not.

        They do where drag and cubic terms pull to different sides, at half the amplitude of
        `balance`. Of two segments (beta 0.05 and 0.02) its distance from the onset is right to 1 %
        at an amplitude of 0.02 and to 12 % at 0.05; from 0.085 on the cycles do not turn there.
        """
        quadratic, cubic = self.quadratic.real, self.cubic.real
        if quadratic * cubic >= 0.0:
            return None
        return self.speed + 0.25 * quadratic**2 / (cubic * self.growth)

    def amplitude(self, u: float) -> float:
        """Amplitude of the free end by the amplitude equation at a speed; of two, the smaller.

        With three segments at beta 0.2 and drag up to 1 it is right to 4 % at amplitudes up to 0.1;
        with four at beta 0.8, near l_1 = 19, to 3 % up to 0.03.

        Raises:
            ValueError: if it has no cycle there.
        """
        u = check.real("u", u, low=0.0)
        leading = self.quadratic.real or self.cubic.real
        sign = -math.copysign(1.0, leading)  # as if the leading term took amplitude away
        fed = sign * self.growth * (u - self.speed)
        quadratic, cubic = sign * self.quadratic.real, sign * self.cubic.real
        inside = quadratic**2 - 4.0 * cubic * fed
        if fed == 0.0:
            return 0.0
        if inside >= 0.0 and fed > 0.0:
            return 2.0 * fed / (math.sqrt(inside) - quadratic)
        if fed < 0.0 < cubic:
            return (math.sqrt(inside) - quadratic) / (2.0 * cubic)
        above = sign * self.growth > 0.0
        if self.fold is None:
            where = f"{'above' if above else 'below'} the onset at {self.speed:.9g}"
        else:
            where = f"{'below' if above else 'above'} the fold at {self.fold:.9g}"
        raise ValueError(f"u must be {where}, got {u:.9g}")

    def pace(self, u: float) -> float:
        """Angular frequency of the cycle of `amplitude` at a speed, in 1 / T.

        Raises:
            ValueError: if there is none.
        """
        size = self.amplitude(u)
        turned = self.quadratic.imag * size + self.cubic.imag * size**2
        return self.frequency + self.detuning * (float(u) - self.speed) + turned


def hopf(model: Model, crossing: Crossing | BranchPoint | None = None) -> Hopf:
    """The limit cycle born at a flutter onset: its law, and on which side of the onset it lives.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        crossing: a passage of a pair, of `crossings(model, ...)`, or a point of kind "hopf" on a
            branch of bent equilibria, of `equilibrium_branch(model, ...)`; the critical speed where
            not given.

    Returns:
        Hopf.

    Raises:
        NoCrossing: if none is given and the pipe does not lose stability.
        NoHopf: if stability is lost by divergence or from u = 0 on, two pairs meet at the onset, or
            the free end stands still in the mode.
        NotConverged: if differences do not settle (a force that is not smooth, other than drag), or
            the law's first coefficient is 0 within its error; eigenvalues not found.
        ValueError: if the crossing is no flutter, or not of this model.
        TypeError: for what is no such model or crossing.

    Source: Kuznetsov's projection formula, see the module's head.
    """
    model = checked_model_in_motion(model)
    if model.dof > LARGEST_HOPF:
        raise ValueError(
            f"model must have at most {LARGEST_HOPF} degrees of freedom for hopf, got {model.dof}"
        )
    own = crossing is None
    if crossing is None:
        crossing = _first(model)
    elif not isinstance(crossing, Crossing | BranchPoint):
        raise TypeError(
            f"crossing must be a Crossing or a BranchPoint, got {check.shown(crossing)}"
        )
    elif crossing.kind not in ("flutter", "hopf"):
        raise ValueError(f"crossing must be a flutter, got a {crossing.kind}")
    u = crossing.speed
    if u == 0.0:
        raise NoHopf(
            "the pipe is unstable from u = 0 on: all its modes lie on the axis there, and no cycle "
            "belongs to one of them"
        )
    motion = Field(model)
    if isinstance(crossing, BranchPoint):
        start = Rest(model).from_start("crossing", crossing.q)
        rest = np.concatenate([start, np.zeros(motion.half)])
    else:
        model.require_equilibrium(u)
        rest = motion.resting()
    smooth = with_drag(model, 0.0) if model.pipe.drag else motion
    drag = model.pipe.drag if model.pipe.drag >= LEAST_DRAG else 0.0
    with one_thread(motion.size):
        try:
            form = normal_form(
                lambda y: smooth.jacobian(y, u),
                rest,
                crossing.frequency,
                lambda q: tip_of(motion, rest, q),
                lambda q: angle_of(model, q),
            )
        except ValueError as error:
            if own:  # two that meet move by the root of rounding
                raise NoHopf(f"no simple pair lies on the axis at u = {u:g}") from error
            raise
        slope = _slope(motion, rest, u, form)
        if abs(slope.real) < 1e-9 * (1.0 + abs(slope)):
            raise NoHopf(f"the pair touches the axis at u = {u:g} and does not pass through it")
        mean, spread = 0j, 0.0
        if drag:  # its force is as large as its number: that of a faint one would drown
            mean, spread = averaged(with_drag(model, 1.0), smooth, rest, u, form)
    if abs(mean) <= 1e-12 * form.frequency:  # no drag where the mode moves
        mean = 0j
    return _described(model, crossing, rest, form, slope, drag * mean, drag * spread)


def with_drag(model: Model, drag: float) -> Field:
    """The motion of a model with another drag."""
    return Field(model.with_pipe(replace(model.pipe, drag=drag)))


def _first(model: Model) -> Crossing:
    critical = critical_speed(model)
    if critical.kind != "flutter":
        raise NoHopf(
            f"stability is lost by divergence at u = {critical.speed:g}; a flutter beyond it is "
            "asked for with crossing="
        )
    return Crossing(
        speed=critical.speed,
        frequency=critical.frequency,
        kind="flutter",
        unstable_before=0,
        unstable_after=2,
        error=critical.error,
        mode=critical.mode,
        sensitivity=critical.sensitivity,
    )


def _described(
    model: Model,
    crossing: Crossing | BranchPoint,
    rest: Array,
    form: NormalForm,
    slope: complex,
    drag: complex,
    error: float,
) -> Hopf:
    omega, cubic = form.frequency, 0.25 * form.cubic
    leading, name = drag, "the mean of drag"
    if not drag:
        leading, error, name = cubic, 0.25 * form.error, "the first Lyapunov coefficient"
    if abs(leading.real) <= error:
        raise NotConverged(
            f"{name} at u = {crossing.speed:g} is 0 within its error of {error:.1e}, as at a "
            "Bautin point: terms of higher degree decide, which are not computed",
            form,
        )
    law = -slope.real / leading.real
    return Hopf(
        speed=crossing.speed,
        frequency=omega,
        growth=slope.real,
        detuning=slope.imag,
        quadratic=drag,
        cubic=cubic,
        lyapunov=form.lyapunov,
        lyapunov_error=form.error / omega,
        amplitude_law=law,
        amplitude_error=abs(law * error / leading.real),
        frequency_law=slope.imag + law * leading.imag,
        exponent=1.0 if drag else 0.5,
        criticality="supercritical" if leading.real < 0.0 else "subcritical",
        crossing=crossing,
        model=model,
        mode=form.right,
        rest=rest,
    )


def tip_of(motion: Field, rest: Array, q: Complex) -> complex:
    """Transverse displacement of the free end, to first order."""
    size = angle_of(motion.model, q)
    parts = []
    for part in (q.real, q.imag):
        steps = np.outer(part, 0.01 / size * np.arange(1.0, 4.0))
        ahead, behind = (motion.tip(rest[:, None] + sign * steps) for sign in (1.0, -1.0))
        parts.append(float(STENCIL @ (ahead - behind)) / (0.01 / size))
    return complex(*parts)


def angle_of(model: Model, q: Complex) -> float:
    """Largest angle of the pipe displaced by a mode, to first order; coordinates of chains are."""
    p = q[: model.moving]
    if not isinstance(model, Galerkin):
        return float(np.abs(p).max())
    across = model.deflection(p, np.linspace(0.0, 1.0, PLACES))
    return float(np.abs(np.diff(across)).max()) * (PLACES - 1)


def _slope(motion: Field, rest: Array, u: float, form: NormalForm) -> complex:
    """Derivative of lambda by u of the pair, the rest moving with the speed where it does."""
    by_speed = motion.jacobian_by_speed(rest, u)
    moved = motion.by_speed(rest[:, None], u)[:, 0]
    slope = complex(form.left.conj() @ (by_speed @ form.right))
    if np.abs(moved).max() > 1e-10 * (1.0 + u):
        factorised()
        shift = -np.asarray(np.linalg.solve(motion.jacobian(rest, u), moved), dtype=np.float64)
        slope += complex(
            form.left.conj() @ _odd(lambda y: motion.jacobian(y, u), rest, shift, form.right)
        )
    return slope


def _odd(jacobian: Callable[[Array], Array], rest: Array, along: Array, vector: Complex) -> Complex:
    """B(along, vector) by one central difference of sixth order."""
    size = float(np.abs(along).max()) / 0.01
    total = np.zeros(rest.size, dtype=np.complex128)
    for k in (1, 2, 3):
        change = jacobian(rest + k / size * along) - jacobian(rest - k / size * along)
        total += STENCIL[k - 1] * size * (change @ vector)
    return total


# ------------------------------------------------------------------------------- the normal form


def normal_form(
    jacobian: Callable[[Array], Array],
    rest: Array,
    frequency: float,
    scale: Callable[[Complex], complex],
    reach: Callable[[Complex], float],
) -> NormalForm:
    """Cubic normal form at a Hopf point of y' = f(y), of any smooth system.

    Args:
        jacobian: df/dy of states, shape (N,) to (N, N).
        rest: the equilibrium, shape (N,).
        frequency: omega of the pair on the axis, to some 1e-6.
        scale: a linear function of q, which is divided by its value.
        reach: the size of q by which the steps of differences are measured.

    Returns:
        NormalForm.

    Raises:
        ValueError: if there is no such eigenvalue.
        NoHopf: if it is a double one, or scale(q) is 0.
        NotConverged: if the differences do not settle.
    """
    a = jacobian(rest)
    right, left = vectors(a, frequency)
    share = scale(right)
    if abs(share) <= 1e-9 * float(np.abs(right).max()) / (1.0 + frequency):
        raise NoHopf("the free end stands still in the mode that flutters")
    right = right / share
    left = left / np.conj(left.conj() @ right)
    first = FIRST_STEP / reach(right)
    values = []
    directions = (right.real, right.imag)
    for level in range(LEVELS):
        h = first / 2**level
        ahead, behind = (
            [jacobian(rest + sign * h * direction) for direction in directions]
            for sign in (1.0, -1.0)
        )
        # B(d, .) and C(d, d, .) along d = Re q and Im q.
        second = [(x - y) / (2.0 * h) for x, y in zip(ahead, behind, strict=True)]
        third = sum((x + y - 2.0 * a) / h**2 for x, y in zip(ahead, behind, strict=True))
        values.append(_cubic(a, frequency, right, left, second, third))
    value, error = _extrapolated(values)
    if not error <= COARSEST * abs(value):
        raise NotConverged(
            "the third derivatives at the onset do not settle as the steps of their differences "
            f"shrink: {value:.6g} with an error of {error:.1e}",
        )
    return NormalForm(frequency, right, left, value, error)


def vectors(a: Array, frequency: float) -> tuple[Complex, Complex]:
    """Right and left eigenvector of i omega by inverse iteration."""
    size = a.shape[0]
    # Rates are about omega times coordinates: balanced, the shift is felt by both alike.
    balance, (scaling, _) = scipy.linalg.matrix_balance(a, permute=False, separate=True)
    shift = 1j * frequency * (1.0 + 1e-12) + 1e-11 * frequency
    factorised()
    factors = scipy.linalg.lu_factor(balance - shift * np.eye(size))
    start = np.cos(np.arange(size)) + 1.5j
    right, left = start, start.conj()
    for _ in range(4):
        right = scipy.linalg.lu_solve(factors, right)
        left = scipy.linalg.lu_solve(factors, left, trans=2)
        right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
    value = complex(right.conj() @ (balance @ right))
    if abs(value - 1j * frequency) > 1e-5 * frequency:
        raise ValueError(
            f"crossing must be one of the model's: no eigenvalue lies at {frequency:g} i, "
            f"the nearest at {value:g}"
        )
    right, left = scaling * right, left / scaling
    # Rates in units of the frequency, so that the angle does not depend on other modes' sizes.
    unit = np.ones(size)
    unit[size // 2 :] = frequency
    lengths = np.linalg.norm(right / unit) * np.linalg.norm(left * unit)
    if abs(complex(left.conj() @ right)) < MET * lengths:
        raise NoHopf("two pairs meet on the axis at the onset")
    return right, left


def _cubic(
    a: Array,
    frequency: float,
    q: Complex,
    p: Complex,
    second: list[Array],
    third: NDArray[Any],
) -> complex:
    """c_1 from B along Re q and Im q, shape (N, N) each, and C(q, q*, .)."""

    def b(x: NDArray[Any]) -> Complex:
        return np.asarray(second[0] @ x + 1j * (second[1] @ x))

    both = b(q.conj()).real  # B(q, q*) is real
    twice = b(q)
    total = third @ q
    size = np.abs(total).max()
    if max(np.abs(both).max(), np.abs(twice).max()) > 1e-13 * size:
        factorised(2)
        total = total - 2.0 * b(np.linalg.solve(a, both))
        outer = np.linalg.solve(2j * frequency * np.eye(q.size) - a, twice)
        total = total + second[0] @ outer - 1j * (second[1] @ outer)
    return complex(0.5 * (p.conj() @ total))


def _extrapolated(values: list[complex]) -> tuple[complex, float]:
    """Limit of values whose error is a series in h^2, h halved each time, by Neville's scheme."""
    rows = [list(values)]
    for order in range(1, len(values)):
        factor = 4.0**order
        last = rows[-1]
        rows.append(
            [(factor * last[i + 1] - last[i]) / (factor - 1.0) for i in range(len(last) - 1)]
        )
    best, error = values[-1], math.inf
    for row, above in zip(rows[1:], rows[:-1], strict=True):
        for i, value in enumerate(row):
            told = max(abs(value - above[i]), abs(value - above[i + 1]))
            if told < error:
                best, error = value, told
    return best, error


def averaged(
    motion: Field, bare: Field, rest: Array, u: float, form: NormalForm
) -> tuple[complex, float]:
    """Mean of drag's force over one turn of the mode, d of the module's head, and its error.

    Args:
        motion: with drag.
        bare: without it; the difference of the two is drag alone, free of cancellation.
        rest: the equilibrium.
        u: flow speed.
        form: the mode.
    """
    phase = np.linspace(0.0, 2.0 * np.pi, PHASES, endpoint=False)
    turn = np.exp(1j * phase)
    line = np.outer(form.right.real, turn.real) - np.outer(form.right.imag, turn.imag)
    first = FIRST_STEP / angle_of(motion.model, form.right)

    def mean(r: float, stride: int) -> complex:
        y = np.ascontiguousarray(rest[:, None] + r * line[:, ::stride])
        force = (motion(y, u) - bare(y, u)) / r**2
        return complex(2.0 * np.mean((form.left.conj() @ force) * turn[::stride].conj()))

    values = [mean(first / 2**level, 4) for level in range(1, 4)]
    value, error = _extrapolated(values)
    fine = mean(first / 8.0, 1)  # what the kinks leave of the mean shows in fewer phases
    return value + fine - values[-1], error + abs(fine - values[-1]) + 1e-9 * abs(value)
