# SPDX-License-Identifier: MIT
"""Cubic normal form at a Hopf point of any system, and the mean of a force not smooth there.

On the centre manifold of a pair i omega with right and left eigenvectors q and p, <p, q> = 1,

    z' = i omega z + c_1 z |z|^2 + ...,   y = rest + 2 Re(z q) + ...,

    2 c_1 = <p, C(q, q, q*) - 2 B(q, A^-1 B(q, q*)) + B(q*, (2 i omega - A)^-1 B(q, q))>

with A, B and C the first three derivatives of the rate (Kuznetsov, Elements of Applied Bifurcation
Theory, eq. (5.39) of the third edition): l_1 = Re c_1 / omega. B and C act along two real
directions only, so they follow from the Jacobian on these two lines, by central differences whose
steps are halved and extrapolated.

A force N without a third derivative at rest, odd and of second degree along each ray,
N(r y) = r^2 N(y), adds to first order in r, at y = rest + r Re(q exp(i phi)),

    d = mean over phi of 2 <p, N(Re(q e^(i phi)))> e^(-i phi).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import NotConverged, PipedynError
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

LEVELS, FIRST_STEP = 6, 0.2
"""Steps of the differences, each half of the one before, and the largest angle, rad, by which the
first displaces the pipe. Of 28 smooth pipes the coefficient's error is then 8e-8 at most; a seventh
step gains nothing."""


class NoHopf(PipedynError):
    """A loss of stability from which no limit cycle emerges as in Hopf's theorem."""


@dataclass(frozen=True)
class NormalForm:
    """What decides a Hopf point: z' = i omega z + c_1 z |z|^2."""

    frequency: float  # omega
    right: Complex = field(repr=False)  # q, shape (N,)
    left: Complex = field(repr=False)  # p, shape (N,), with <p, q> = sum conj(p) q = 1
    cubic: complex  # c_1
    error: float  # of c_1, absolute, from the last two extrapolations

    @property
    def lyapunov(self) -> float:
        """First Lyapunov coefficient l_1 = Re c_1 / omega."""
        return self.cubic.real / self.frequency


def normal_form(
    jacobian: Callable[[Array], Array],
    rest: Array,
    frequency: float,
    scale: Callable[[Complex], complex],
    reach: Callable[[Complex], float],
) -> NormalForm:
    """Cubic normal form at an equilibrium of any smooth system y' = f(y).

    Args:
        jacobian: df/dy of states, shape (N,) to (N, N).
        rest: the equilibrium, shape (N,).
        frequency: omega of the pair on the axis, to some 1e-6.
        scale: a linear function of q, which is divided by its value.
        reach: the size of q by which the steps of differences are measured.

    Raises:
        ValueError: if there is no such eigenvalue.
        NoHopf: if it is a double one, or scale(q) is 0.
        NotConverged: if the differences do not converge.
    """
    a = jacobian(rest)
    right, left = vectors(a, frequency, scale)
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
    if not error <= 1e-3 * abs(value):  # a force that is not smooth leaves some per cent
        raise NotConverged(
            "the third derivatives at the onset do not converge as the steps of their differences "
            f"shrink: {value:.6g} with an error of {error:.1e}",
        )
    return NormalForm(frequency, right, left, value, error)


def vectors(
    a: Array, frequency: float, scale: Callable[[Complex], complex]
) -> tuple[Complex, Complex]:
    """Right and left eigenvector q and p of i omega, scale(q) = <p, q> = 1, by inverse iteration.

    Raises as `normal_form` does.
    """
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
    # Where two pairs meet, p and q are at right angles, but for the root of rounding.
    if abs(complex(left.conj() @ right)) < 3e-5 * lengths:
        raise NoHopf("two pairs meet on the axis at the onset")
    share = scale(right)
    if abs(share) <= 1e-9 * float(np.abs(right).max()) / (1.0 + frequency):
        raise NoHopf("the free end does not move in the mode that flutters")
    right = right / share
    return right, left / np.conj(left.conj() @ right)


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
            estimate = max(abs(value - above[i]), abs(value - above[i + 1]))
            if estimate < error:
                best, error = value, estimate
    return best, error


def averaged(
    force: Callable[[Array], Array], form: NormalForm, angle: float
) -> tuple[complex, float]:
    """Mean of a force over one turn of the mode, d of the module's head, and its error.

    Args:
        force: N of displacements from rest, shape (N, k) to (N, k).
        form: the mode.
        angle: the largest of the pipe displaced by q, by which the displacements are measured.
    """
    phase = np.linspace(0.0, 2.0 * np.pi, 8192, endpoint=False)  # drag's kinks ask for many
    turn = np.exp(1j * phase)
    line = np.outer(form.right.real, turn.real) - np.outer(form.right.imag, turn.imag)
    first = FIRST_STEP / angle

    def mean(r: float, stride: int) -> complex:
        values = force(r * line[:, ::stride]) / r**2
        return complex(2.0 * np.mean((form.left.conj() @ values) * turn[::stride].conj()))

    values = [mean(first / 2**level, 4) for level in range(1, 4)]
    value, error = _extrapolated(values)
    fine = mean(first / 8.0, 1)  # what the kinks leave of the mean shows in fewer phases
    return value + fine - values[-1], error + abs(fine - values[-1]) + 1e-9 * abs(value)
