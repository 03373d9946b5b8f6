# SPDX-License-Identifier: MIT
"""Cubic normal form of a pair of eigenvalues on the imaginary axis, of any smooth system.

On the centre manifold of a pair of eigenvalues +- i omega, whose right and left eigenvectors are q
and p with <p, q> = 1,

    z' = i omega z + c_1 z |z|^2 + ...,   y = rest + 2 Re(z q) + ...,

    2 c_1 = <p, C(q, q, q*) - 2 B(q, A^-1 B(q, q*)) + B(q*, (2 i omega - A)^-1 B(q, q))>

where A, B and C are the first three derivatives of f in y' = f(y) at rest, and the first Lyapunov
coefficient is l_1 = Re c_1 / omega (Kuznetsov, Elements of Applied Bifurcation Theory, eq. (5.39)
of the third edition). B and C act along two real directions only, so that they follow from the
Jacobian on these two lines, by central differences with halved steps and extrapolation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotConverged, PipedynError

LEVELS, FIRST_STEP = 6, 0.2
"""Number of steps of the differences, each half of the last, and the largest angle, in rad, by
which the first step displaces the pipe. With these values the error of the coefficient is 8e-8 at
most in 28 smooth pipes; a seventh step gains nothing."""


@saved_as("NoHopf")
class NoHopf(PipedynError):
    """Raised where no limit cycle emerges from a loss of stability as in Hopf's theorem."""


@dataclass(frozen=True)
class NormalForm:
    """Normal form z' = i omega z + c_1 z |z|^2 of a Hopf point."""

    frequency: float  # omega
    right: Complex = field(repr=False)  # q, shape (N,)
    left: Complex = field(repr=False)  # p, shape (N,), with <p, q> = sum conj(p) q = 1
    cubic: complex  # c_1
    error: float  # absolute error of c_1, from the last two extrapolations

    @property
    def lyapunov(self) -> float:
        """First Lyapunov coefficient l_1 = Re c_1 / omega."""
        return self.cubic.real / self.frequency


def normal_form(
    jacobians: Callable[[Array], Array],
    rest: Array,
    frequency: float,
    scale: Callable[[Complex], complex],
    reach: Callable[[Complex], float],
) -> NormalForm:
    """Cubic normal form at an equilibrium, shape (N,), of any smooth system y' = f(y).

    `jacobians` gives df/dy at states, shape (N, k), as an array (k, N, N); `frequency` is omega, to
    a relative accuracy of some 1e-6. The eigenvector q is divided by scale(q), a linear function.
    Steps of differences are measured by `reach` of the displacement, such as its largest angle.

    Raises:
        ValueError: if i omega is no eigenvalue.
        NoHopf: if it is a double eigenvalue, or scale(q) is 0.
        NotConverged: if the differences do not converge.
    """
    a = jacobians(rest[:, None])[0]
    q, p = vectors(a, frequency, scale)
    steps = np.ldexp(FIRST_STEP / reach(q), -np.arange(LEVELS))
    totals = [
        _cubic_term(a, q, frequency, *both)
        for both in second_and_third(jacobians, rest, a, q, steps)
    ]
    value, error = projected_limit(a, p, q, totals, steps)
    value, error = 0.5 * value, 0.5 * error
    return NormalForm(frequency, q, p, value, error)


def projected_limit(
    a: Array, p: Complex, q: Complex, vectors: list[Complex], steps: Array
) -> tuple[complex, float]:
    """Limit of <p, v> for vectors v by differences with these steps, and its error.

    a: Jacobian at rest, from which rounding is estimated.

    Raises:
        NotConverged: if the differences do not converge.
    """
    terms = float(np.abs(p) @ np.abs(a) @ np.abs(q))
    rounding = 2.0 * np.finfo(float).eps * terms / steps**2
    value, error = neville_limit([complex(p.conj() @ one) for one in vectors], rounding)
    # If a force is not smooth, the error is some per cent.
    if not error <= 1e-3 * abs(value) + rounding[-1]:
        raise NotConverged(
            "the third derivatives at the onset do not converge as the steps of their differences "
            f"shrink: {value:.6g} with an error of {error:.1e}",
        )
    return value, error


def second_and_third(
    jacobians: Callable[[Array], Array], rest: Array, a: Array, q: Complex, steps: Array
) -> Iterable[tuple[Complex, Array]]:
    """Matrices B(q, .) and C(q, q*, .) by central differences, for each step h to O(h^2)."""
    signs = np.array([1.0, -1.0])
    moves = np.einsum("h,s,dn->nhsd", steps, signs, [q.real, q.imag])
    states = (rest[:, None] + moves.reshape(rest.size, -1)).copy()
    around = jacobians(states).reshape(*moves.shape[1:], *a.shape)
    for h, (ahead, behind) in zip(steps, around, strict=True):
        slopes = (ahead - behind) / (2.0 * h)
        yield slopes[0] + 1j * slopes[1], ((ahead + behind - 2.0 * a) / h**2).sum(axis=0)


def _cubic_term(a: Array, q: Complex, frequency: float, second: Complex, third: Array) -> Complex:
    """Vector whose product with p is 2 c_1 in Kuznetsov's formula."""
    total = third @ q
    mean, second_harmonic = (second @ q.conj()).real, second @ q  # B(q, q*) is real
    if max(np.abs(mean).max(), np.abs(second_harmonic).max()) > 1e-13 * np.abs(total).max():
        count_factorisations(2)
        total = total - 2.0 * (second @ np.linalg.solve(a, mean))
        outer = np.linalg.solve(2j * frequency * np.eye(q.size) - a, second_harmonic)
        total = total + second.conj() @ outer
    return np.asarray(total)


def vectors(
    a: Array, frequency: float, scale: Callable[[Complex], complex]
) -> tuple[Complex, Complex]:
    """Right and left eigenvectors q and p of the eigenvalue i omega, by inverse iteration.

    They are scaled so that scale(q) = <p, q> = 1.

    Raises:
        ValueError: if i omega is no eigenvalue.
        NoHopf: if it is a double eigenvalue, or scale(q) is 0.
    """
    # Rates are scaled by the frequency, so that in this mode they are as large as coordinates.
    unit = np.ones(len(a))
    unit[len(a) // 2 :] = frequency
    scaled = a * unit / unit[:, None]
    shift = 1j * frequency * (1.0 + 1e-12) + 1e-11 * frequency
    count_factorisations()
    inverse = np.linalg.inv(scaled - shift * np.eye(len(a)))
    start = np.cos(np.arange(len(a))) + 1.5j
    right, left = start, start.conj()
    for _ in range(4):
        right, left = inverse @ right, inverse.conj().T @ left
        right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
    value = complex(right.conj() @ (scaled @ right))
    # Where two pairs meet, rounding puts two eigenvalues about i omega, and the iteration does not
    # converge; or p and q are orthogonal up to the square root of rounding.
    meets = abs(complex(left.conj() @ right)) < 3e-5
    if abs(value - 1j * frequency) > 1e-5 * frequency:
        away = np.linalg.eigvals(scaled) - 1j * frequency
        nearest, second = away[np.argsort(np.abs(away))[:2]]
        meets = abs(nearest + second) <= 0.2 * abs(nearest) <= 0.02 * frequency
        if not meets:
            raise ValueError(
                f"crossing must be one of the model's: no eigenvalue lies at {frequency:g} i, "
                f"the nearest at {nearest + 1j * frequency:g}"
            )
    if meets:
        raise NoHopf("two pairs meet on the axis at the onset")
    # Where two planes are alike to first order, there is another eigenvector.

    def others(x: Complex) -> Complex:
        return x - right * (left.conj() @ x) / (left.conj() @ right)

    apart = others(start[::-1])
    if frequency * np.linalg.norm(others(inverse @ apart)) > 1e9 * np.linalg.norm(apart):
        raise NoHopf("two pairs are the same at the onset, as in two planes that are alike")
    right, left = unit * right, left / unit
    share = scale(right)
    if abs(share) <= 1e-9 * float(np.abs(right).max()) / (1.0 + frequency):
        raise NoHopf("the free end does not move in the mode that flutters")
    right = right / share
    return right, left / np.conj(left.conj() @ right)


def neville_limit(values: list[complex], rounding: Array) -> tuple[complex, float]:
    """Limit, by Neville's scheme, of values whose error is a series in h^2, and its error.

    The step h is halved from one value to the next. As the least error estimate of the scheme may
    be small by chance, the rounding of the values is added to each.
    """
    best, error, row = values[-1], math.inf, np.array(values)
    for order in range(1, len(values)):
        above, row = row, (4.0**order * row[1:] - row[:-1]) / (4.0**order - 1.0)
        estimates = np.maximum(np.abs(row - above[:-1]), np.abs(row - above[1:]))
        estimates += rounding[order:]
        i = int(np.argmin(estimates))
        if estimates[i] < error:
            best, error = complex(row[i]), float(estimates[i])
    return best, error
