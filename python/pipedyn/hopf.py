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
N(r y) = r^2 N(y), and odd: to first order in r, y = rest + r Re(q exp(i phi)), it enters as

    r' = growth (u - u_c) r + Re(d) r^2,   d = mean over phi of 2 <p, N(Re(q e^(i phi)))> e^(-i phi)

and amplitude / (u - u_c) -> -growth / Re(d). It is the left eigenvector that weighs the drag, not
the velocity: drag bends the mode as well, which changes what the flow feeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pipedyn import _check
from pipedyn._check import Array
from pipedyn.blas import one_thread
from pipedyn.critical import critical_speed
from pipedyn.equilibria import BranchPoint, Rest
from pipedyn.field import STENCIL, Field
from pipedyn.model import Model, NotConverged, PipedynError
from pipedyn.motion import checked_model_in_motion
from pipedyn.pencil import Complex
from pipedyn.sensitivity import Crossing

LARGEST_HOPF = 500
"""Degrees of freedom; beyond, dense eigenvectors lose the digits that differences need."""

LEVELS = 6
"""Steps of the differences, each half of the one before."""

FIRST_STEP = 0.2
"""The longest: the largest coordinate of the displaced mode."""

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
        cubic: c_1; NaN where the cubic terms were not asked for.
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

    Attributes:
        speed: u_c.
        frequency: omega_c, in 1 / T.
        growth: d Re(lambda) / du.
        lyapunov: first Lyapunov coefficient, of q scaled to unit displacement of the free end;
            None with drag, under which it does not exist.
        lyapunov_error: absolute, of the differences; None with drag.
        amplitude_law: limit of amplitude^2 / (u - u_c), with drag of amplitude / (u - u_c);
            negative where the cycle lives below u_c.
        amplitude_error: of amplitude_law, absolute.
        frequency_law: limit of (omega - omega_c) / (u - u_c) along the cycles.
        exponent: the cycle grows like |u - u_c| to this power, 1/2, with drag 1.
        criticality: "supercritical" if the cycle attracts all that the critical mode does, and so
            lives where the equilibrium has become unstable; "subcritical" if it repels.
        crossing: the passage of the pair.
        model: the model.
        mode: q, complex, of the integrated state [p, p'], shape (2 moving,).
        rest: the equilibrium, an integrated state, shape (2 moving,).
    """

    speed: float
    frequency: float
    growth: float
    lyapunov: float | None
    lyapunov_error: float | None
    amplitude_law: float
    amplitude_error: float
    frequency_law: float
    exponent: float
    criticality: Literal["supercritical", "subcritical"]
    crossing: Crossing | BranchPoint = field(repr=False)
    model: Model = field(repr=False)
    mode: Complex = field(repr=False, compare=False)
    rest: Array = field(repr=False, compare=False)

    def amplitude(self, u: float) -> float:
        """Amplitude of the free end that the law predicts at a speed.

        Raises:
            ValueError: if the cycle lives on the other side of the onset.
        """
        u = _check.real("u", u, low=0.0)
        share = self.amplitude_law * (u - self.speed)
        if share < 0.0:
            side = "above" if self.amplitude_law > 0.0 else "below"
            raise ValueError(f"u must be {side} the onset at {self.speed:g}, got {u:g}")
        return float(share**self.exponent)


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
            f"crossing must be a Crossing or a BranchPoint, got {_check.shown(crossing)}"
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
        rest = np.concatenate(
            [Rest(model).from_start("crossing", crossing.q), np.zeros(motion.half)]
        )
    else:
        model.require_equilibrium(u)
        rest = motion.resting()
    smooth = Field(model.with_pipe(replace(model.pipe, drag=0.0))) if model.pipe.drag else motion
    with one_thread(motion.size):
        try:
            form = normal_form(
                lambda y: smooth.jacobian(y, u),
                rest,
                crossing.frequency,
                lambda q: tip_of(motion, rest, q),
                cubic=False,
            )
        except ValueError as error:
            if own:  # two that meet move by the root of rounding
                raise NoHopf(f"no simple pair lies on the axis at u = {u:g}") from error
            raise
        slope = _slope(motion, rest, u, form)
        if abs(slope.real) < 1e-9 * (1.0 + abs(slope)):
            raise NoHopf(f"the pair touches the axis at u = {u:g} and does not pass through it")
        drag = (0j, 0.0) if motion is smooth else averaged(motion, smooth, rest, u, form)
        if abs(drag[0]) <= 1e-12 * form.frequency:  # no drag where the mode moves
            form = normal_form(
                lambda y: smooth.jacobian(y, u),
                rest,
                crossing.frequency,
                lambda q: tip_of(motion, rest, q),
            )
            return _of_cubic(model, crossing, rest, form, slope)
    return _of_drag(model, crossing, rest, form, slope, *drag)


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


def _of_cubic(
    model: Model,
    crossing: Crossing | BranchPoint,
    rest: Array,
    form: NormalForm,
    slope: complex,
) -> Hopf:
    omega, cubic = form.frequency, form.cubic
    if abs(cubic.real) <= form.error:
        raise NotConverged(
            f"the first Lyapunov coefficient at u = {crossing.speed:g} is 0 within its error of "
            f"{form.error / omega:.1e}",
            form,
        )
    law = -4.0 * slope.real / cubic.real
    return Hopf(
        speed=crossing.speed,
        frequency=omega,
        growth=slope.real,
        lyapunov=form.lyapunov,
        lyapunov_error=form.error / omega,
        amplitude_law=law,
        amplitude_error=abs(law * form.error / cubic.real),
        frequency_law=slope.imag + 0.25 * law * cubic.imag,
        exponent=0.5,
        criticality="supercritical" if cubic.real < 0.0 else "subcritical",
        crossing=crossing,
        model=model,
        mode=form.right,
        rest=rest,
    )


def _of_drag(
    model: Model,
    crossing: Crossing | BranchPoint,
    rest: Array,
    form: NormalForm,
    slope: complex,
    drag: complex,
    error: float,
) -> Hopf:
    if abs(drag.real) <= error:
        raise NotConverged(
            f"the mean of drag at u = {crossing.speed:g} is 0 within its error of {error:.1e}", form
        )
    law = -slope.real / drag.real
    return Hopf(
        speed=crossing.speed,
        frequency=form.frequency,
        growth=slope.real,
        lyapunov=None,
        lyapunov_error=None,
        amplitude_law=law,
        amplitude_error=abs(law * error / drag.real),
        frequency_law=slope.imag + law * drag.imag,
        exponent=1.0,
        criticality="supercritical" if drag.real < 0.0 else "subcritical",
        crossing=crossing,
        model=model,
        mode=form.right,
        rest=rest,
    )


def tip_of(motion: Field, rest: Array, q: Complex) -> complex:
    """Transverse displacement of the free end, to first order."""
    size = float(np.abs(q[: motion.half]).max())
    parts = []
    for part in (q.real, q.imag):
        steps = np.outer(part, 0.01 / size * np.arange(1.0, 4.0))
        ahead, behind = (motion.tip(rest[:, None] + sign * steps) for sign in (1.0, -1.0))
        parts.append(float(STENCIL @ (ahead - behind)) / (0.01 / size))
    return complex(*parts)


def _slope(motion: Field, rest: Array, u: float, form: NormalForm) -> complex:
    """Derivative of lambda by u of the pair, the rest moving with the speed where it does."""
    by_speed = motion.jacobian_by_speed(rest, u)
    moved = motion.by_speed(rest[:, None], u)[:, 0]
    slope = complex(form.left.conj() @ (by_speed @ form.right))
    if np.abs(moved).max() > 1e-10 * (1.0 + u):
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
    *,
    cubic: bool = True,
) -> NormalForm:
    """Cubic normal form at a Hopf point of y' = f(y), of any smooth system.

    Args:
        jacobian: df/dy of states, shape (N,) to (N, N).
        rest: the equilibrium, shape (N,).
        frequency: omega of the pair on the axis, to some 1e-6.
        scale: a linear function of q, which is divided by its value.
        cubic: whether c_1 is wanted, or the vectors only.

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
    if not cubic:
        return NormalForm(frequency, right, left, complex(math.nan, math.nan), math.nan)
    half = rest.size // 2
    first = FIRST_STEP / float(np.abs(right[: max(half, 1)]).max())
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
    first = FIRST_STEP / float(np.abs(form.right[: motion.half]).max())

    def mean(r: float, stride: int) -> complex:
        y = np.ascontiguousarray(rest[:, None] + r * line[:, ::stride])
        force = (motion(y, u) - bare(y, u)) / r**2
        return complex(2.0 * np.mean((form.left.conj() @ force) * turn[::stride].conj()))

    values = [mean(first / 2**level, 4) for level in range(1, 4)]
    value, error = _extrapolated(values)
    fine = mean(first / 8.0, 1)  # what the kinks leave of the mean shows in fewer phases
    return value + fine - values[-1], error + abs(fine - values[-1]) + 1e-9 * abs(value)
