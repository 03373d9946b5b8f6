# SPDX-License-Identifier: MIT
"""Small motions of the straight pipe while its flow pulsates, u = mean (1 + amplitude cos(w tau)).

They obey M q'' + (C_0 + u C_1) q' + (K_0 + u^2 K_2 + u' K_3) q = 0 with coefficients of period
2 pi / w. Floquet multipliers follow from the maps of states over parts of the period. A motion with
the multiplier exp(2 pi i nu / w) is a sum of q_k exp(i (nu + k w) tau) over all k, whose q_k obey
Hill's equations H(w, nu, amplitude) q = 0; H is a polynomial of second degree in each of its
arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.eigenproblem import eigenproblem
from pipedyn.linear.modes import largest_speed
from pipedyn.models.base import BASE_ROWS, ROWS, Model, Operators
from pipedyn.models.continuum import (
    FUNCTIONS_A_JOINT,
    AnyModel,
    Continuum,
    checked_model,
    converged_answer,
    relative,
)
from pipedyn.models.drive import Pulsation
from pipedyn.models.galerkin import basis_joints
from pipedyn.orbits.floquet import beyond_circle, by_series
from pipedyn.orbits.periodic_orbit import STAGE_NODES
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import RATE, TableResult

FLOQUET_DOF = 100
"""Largest number of degrees of freedom for `floquet`: matrices have 200 rows, and it takes a second
or two."""

EXTRA = 3
"""Number of harmonics that are kept beyond those that reach as high in frequency: each reduces the
error of edges by a factor of ten or more."""

LARGEST_UNREDUCED = 30
"""Largest number of degrees of freedom of a model that is not projected on its lowest modes: Hill's
equations have some ten times as many unknowns."""


@dataclass(frozen=True)
class PulsatingPipe:
    """Matrices of the equations of motion in a pulsating flow, each (n, n), and the mean speed."""

    mass: Array
    damping: Array  # C_0
    velocity: Array  # C_1
    stiffness: Array  # K_0
    flux: Array  # K_2
    unsteady: Array  # K_3
    mean: float

    @classmethod
    def of(cls, operators: Operators, mean: float) -> PulsatingPipe:
        """The matrices of a model with these operators, at a mean speed."""
        way = operators.direction
        return cls(
            mass=operators.mass,
            damping=operators.damping,
            velocity=way * (operators.gyroscopic + operators.end_flux),
            stiffness=operators.stiffness,
            flux=operators.centrifugal * operators.flux,
            unsteady=way * operators.unsteady,
            mean=mean,
        )

    @property
    def size(self) -> int:
        """Number n of coordinates."""
        return len(self.mass)

    def projected(self, basis: Array) -> PulsatingPipe:
        """The matrices in coordinates along the columns of a basis, shape (n, r)."""
        names = ("mass", "damping", "velocity", "stiffness", "flux", "unsteady")
        parts = {name: basis.T @ getattr(self, name) @ basis for name in names}
        return PulsatingPipe(**parts, mean=self.mean)

    def modulated(self, k: Array) -> list[KroneckerTerm]:
        """Terms of Hill's equations, for harmonics k, that vary with the amplitude."""
        cosine, minus_sine = _waves(k.size)
        square = 0.5 * np.eye(k.size) + 0.25 * (np.eye(k.size, k=-2) + np.eye(k.size, k=2))
        flux, velocity = self.mean**2 * self.flux, self.mean * self.velocity
        return [
            ((0, 0, 1), cosine, 2.0 * flux),
            ((0, 0, 2), square, flux),
            ((1, 0, 1), 1j * cosine * k, velocity),
            ((0, 1, 1), 1j * cosine, velocity),
            ((1, 0, 1), minus_sine, self.mean * self.unsteady),
        ]

    def companion(self, speed: float, square: float) -> Array:
        """Matrix A of y' = A y, (2 n, 2 n), at constant `speed` for u and `square` for u^2."""
        return np.tensordot([1.0, speed, square], self.companions()[:3], 1)

    def companions(self) -> Array:
        """Coefficients of 1, u, u^2 and u' in the matrix A of y' = A y, shape (4, 2 n, 2 n).

        The state y is [q, M^-1 p]. With the momenta p = M q' + u C_1 q / 2 the equations of a
        conservative pipe are Hamilton's at any u, and stay so when they are projected on some of
        its modes.
        """
        n = self.size
        made = np.zeros((4, 2 * n, 2 * n))
        made[0, :n, n:] = np.eye(n)
        stiffness, flux, unsteady, damping, velocity = self._forces
        half = 0.5 * velocity
        made[1, :n, :n] = made[1, n:, n:] = half
        made[0, n:, n:] = damping
        made[:, n:, :n] = stiffness, damping @ half, flux + half @ half, unsteady - half
        return made

    def require_stable(self, highest: float, name: str = "mean") -> None:
        """Raises ValueError if rest is unstable at the mean speed, the argument `name`.

        Modes count up to five times the frequency `highest`, and at least up to 50.
        """
        values = np.linalg.eigvals(self.companion(self.mean, self.mean**2))
        values = values[np.abs(values) < max(5.0 * highest, 50.0)]
        worst = float(values.real.max(initial=0.0))
        if worst > 1e-7 * max(1.0, float(np.abs(values).max(initial=0.0))):
            raise ValueError(
                f"{name} must be a speed at which the pipe is stable, got {self.mean:g}, at which "
                f"motions grow like exp({worst:.2g} tau)"
            )

    def multipliers(self, amplitude: float, frequency: float) -> tuple[Complex, float]:
        """Floquet multipliers, the largest modulus first, and the error of the worst.

        Raises:
            NewtonFailed: if they overflow.
        """
        given, parts = self._along(amplitude, frequency)
        roots, error = by_series(*given, parts)
        if not roots.size:
            raise NewtonFailed("they overflow")
        order = np.lexsort((-roots.imag, -np.abs(roots).round(11)))
        return roots[order], error

    def _along(
        self, amplitude: float, frequency: float
    ) -> tuple[tuple[Array, Array, Array], NDArray[np.int_]]:
        """Arguments of `by_series` for one period: rows, durations and units, and parts."""
        count, period = 8, 2.0 * math.pi / frequency
        phases = 2.0 * math.pi * (np.arange(count)[:, None] + STAGE_NODES) / count
        by_position, by_velocity = self._accelerations(phases, amplitude, frequency)
        units = np.ones(2 * self.size)
        units[self.size :] = math.sqrt(max(np.abs(by_position).max(), 1.0))
        fastest = math.sqrt(np.abs(np.linalg.eigvals(self._forces[0])).max())
        parts = np.full(count, math.ceil(4.0 * (fastest * period) ** (1.0 / 3.0)))
        rows = np.concatenate([by_position, by_velocity], axis=-1)
        return (rows, np.full(count, period / count), units), parts

    def _accelerations(
        self, phases: Array, amplitude: float, frequency: float
    ) -> tuple[Array, Array]:
        """Derivatives of accelerations by position and by velocity at phases, (..., n, n) each."""
        speed = self.mean * (1.0 + amplitude * np.cos(phases))
        rate = -self.mean * amplitude * frequency * np.sin(phases)
        one = np.ones_like(speed)
        by_position = np.tensordot(np.stack([one, speed**2, rate], -1), self._forces[:3], 1)
        return by_position, np.tensordot(np.stack([one, speed], -1), self._forces[3:], 1)

    @cached_property
    def _forces(self) -> Array:
        """Matrices of the accelerations, shape (5, n, n).

        Three multiply the position, times 1, u^2 and u', and two the velocity, times 1 and u.
        """
        forces = self.stiffness, self.flux, self.unsteady, self.damping, self.velocity
        return np.asarray(-np.linalg.solve(self.mass, np.stack(forces)))


@dataclass(frozen=True)
class ShakenPipe(PulsatingPipe):
    """Matrices of the equations of motion of a straight pipe whose base oscillates along it.

    The flow is steady. The amplitude is that of the base, in L.
    """

    base: Array  # stiffness by position, velocity and acceleration of the base, (3, n, n)

    @classmethod
    def shaken(cls, model: Model, u: float) -> ShakenPipe:
        """The matrices of a model in elastic coordinates, at a flow speed."""
        still = np.zeros(2 * model.integrated)
        free, half = model.by_coordinates(), model.integrated

        def stiffness(row: int | None) -> Array:
            drive = np.zeros(ROWS) if row is None else np.eye(ROWS)[row]
            slopes = model.motion_jacobian(still, u, drive)[half:, :half] @ free
            moved, *_ = np.linalg.lstsq(free, slopes, rcond=0.0)
            return -model.operators().mass @ moved

        to_elastic, without = np.asarray(model.from_elastic(np.eye(model.dof))), stiffness(None)
        base = [to_elastic.T @ (stiffness(rows[1]) - without) @ to_elastic for rows in BASE_ROWS]
        plain = PulsatingPipe.of(model.elastic_operators(), u)
        return cls(**vars(plain), base=np.stack(base))

    def modulated(self, k: Array) -> list[KroneckerTerm]:
        """Terms of Hill's equations, for harmonics k, that vary with the amplitude."""
        cosine, minus_sine = _waves(k.size)
        by_place, by_velocity, by_acceleration = self.base
        return [
            ((0, 0, 1), cosine, by_place),
            ((1, 0, 1), minus_sine, by_velocity),
            ((2, 0, 1), -cosine, by_acceleration),
        ]

    def _accelerations(
        self, phases: Array, amplitude: float, frequency: float
    ) -> tuple[Array, Array]:
        by_position, by_velocity = super()._accelerations(phases, 0.0, frequency)
        turn = amplitude * np.exp(1j * phases)
        moves = np.stack([((1j * frequency) ** order * turn).real for order in range(3)], -1)
        return by_position - np.tensordot(
            moves, np.linalg.solve(self.mass, self.base), 1
        ), by_velocity


def require_motion(model: AnyModel) -> None:
    """Raises ValueError for a pipe that has no equation of motion or does not rest straight."""
    if not model.pipe.rests_straight:
        raise ValueError(
            "model must be of a pipe that rests straight where the flow pulsates, got "
            f"{model.pipe!r}: a load across bends it as far as the flow lets it, so that it never "
            "rests; simulate gives its motion"
        )
    if isinstance(model, Model) and model.resting().any():
        raise ValueError(
            "model must be about the straight pipe where the flow pulsates: a bent one does not "
            f"rest in it, got {model!r}"
        )
    if model.pipe.hysteresis:
        raise ValueError(
            f"hysteresis must be 0 where the flow pulsates, got {model.pipe.hysteresis:g}: a loss "
            "factor has no equation of motion; take damping=pipe.equivalent_damping(frequency)"
        )


class Hill:
    """Hill's equations of a pipe.

    Their harmonics are -many to many, or -many to many - 1 where nu is w / 2.
    """

    def __init__(self, pipe: PulsatingPipe, many: int) -> None:
        self.pipe, self.many = pipe, many
        self._polynomials = dict[float | None, Polynomial]()
        self._others = dict[int, Hill]()

    def fewer(self, low: float, frequency: float) -> Hill:
        """Equations with the fewer harmonics that are needed at a higher frequency than `low`.

        Their highest frequency at `frequency` is that of all harmonics at `low`, with some to
        spare.
        """
        many = math.ceil(self.many * min(low / frequency, 1.0)) + EXTRA
        if many >= self.many:
            return self
        return self._others.setdefault(many, Hill(self.pipe, many))

    @cached_property
    def is_hermitian(self) -> bool:
        """Whether H is Hermitian, which it is for pipes that neither gain nor lose energy."""
        h = Hill(self.pipe, 2).polynomial(None)(11.0, 3.0, 0.1)
        return bool(np.abs(h - h.conj().T).max() <= 1e-11 * np.abs(h).max())

    @cached_property
    def is_real(self) -> bool:
        """Whether H is real, which it is for pipes with neither damping nor a Coriolis force."""
        return Hill(self.pipe, 2).polynomial(None).is_real

    def polynomial(self, share: float | None) -> Polynomial:
        """H as a polynomial in w and the amplitude, with nu = share * w for a share of 0 or 1/2.

        It then acts on the cosines and sines of real motions. Where the share is None it is a
        polynomial in w, nu and the amplitude, and acts on the harmonics.
        """
        if share not in self._polynomials:
            self._polynomials[share] = Polynomial(self._terms(share))
        return self._polynomials[share]

    def _terms(self, share: float | None) -> list[KroneckerTerm]:
        """The terms of H, whose factors are matrices of the harmonics and of the pipe."""
        pipe, u = self.pipe, self.pipe.mean
        k: Array = np.arange(2.0 * self.many + (share != 0.5)) - self.many + (share or 0.0)
        one, flux, velocity = np.eye(k.size), u**2 * pipe.flux, u * pipe.velocity
        terms: list[KroneckerTerm] = [  # powers of w, nu and the amplitude, and both factors
            ((0, 0, 0), one, pipe.stiffness + flux),
            *pipe.modulated(k),
            ((1, 0, 0), 1j * np.diag(k), pipe.damping + velocity),
            ((0, 1, 0), 1j * one, pipe.damping + velocity),
            ((2, 0, 0), np.diag(-(k**2)), pipe.mass),
            ((1, 1, 0), np.diag(-2.0 * k), pipe.mass),
            ((0, 2, 0), -one, pipe.mass),
        ]
        if share is None:
            return terms
        turn = _real_form(k.size)
        return [
            ((w, a), (turn @ harmonics @ turn.conj().T).real, matrix)
            for (w, nu, a), harmonics, matrix in terms
            if not nu
        ]

    def edges(self, share: float, amplitude: float, about: float) -> Array:
        """All frequencies of motions with nu = share * frequency, rising, as eigenvalues of H.

        As a cosine is even, H with -w for w is H with the other sign of all sines. So it has the
        form [E_0 + w^2 E_2, w E_1; w O_1, O_0 + w^2 O_2], with E for cosines and O for sines, and
        is singular where A + w^2 B is, with A = [E_0, 0; O_1, O_0] and B = [E_2, E_1; 0, O_2].

        Args:
            share: 0 or 1/2.
            amplitude: amplitude of the pulsation relative to the mean speed.
            about: a frequency of the size of those that are wanted.
        """
        of = self.polynomial(share)
        zero, slope = of(0.0, amplitude), of.by((0,), 0.0, amplitude)
        bend = 0.5 * of.by((0, 0), 0.0, amplitude)
        cosines = (self.many + (share == 0.0)) * self.pipe.size
        zero[cosines:, :cosines] = slope[cosines:, :cosines]
        bend[:cosines, cosines:] = slope[:cosines, cosines:]
        # The eigenvalues are 1 / (w^2 + about^2): B may be singular, as a harmonic of frequency 0
        # adds nothing to it, and A is where a pipe without damping buckles.
        try:
            values = np.linalg.eigvals(np.linalg.solve(about**2 * bend - zero, bend))
        except np.linalg.LinAlgError:
            return np.empty(0)
        squares = 1.0 / values[np.abs(values) > 1e-12 / about**2] - about**2
        real = np.abs(squares.imag) < 2e-8 * np.abs(squares)
        return np.sqrt(np.sort(squares.real[real & (squares.real > 0.0)]))


KroneckerTerm = tuple[tuple[int, ...], NDArray[Any], Array]
"""Powers of the numbers in a term of a polynomial, and the factors of its coefficient, which is a
Kronecker product."""


class Polynomial:
    """A matrix that is a polynomial in several numbers, with Kronecker products as coefficients."""

    def __init__(self, terms: list[KroneckerTerm]) -> None:
        self._powers = np.array([powers for powers, *_ in terms])
        harmonics, matrices = (np.stack(factors) for factors in list(zip(*terms, strict=True))[1:])
        # Blocks between harmonics more than two apart are 0 at all numbers.
        at = np.nonzero(np.abs(harmonics).max(axis=0) > 1e-14)
        count, size = harmonics.shape[1], matrices.shape[1]
        rows, columns = (size * one[:, None] + np.arange(size) for one in at)
        self._filled = count * size * rows[:, :, None] + columns[:, None]
        self._shape = count * size, count * size
        blocks, sizes = harmonics[:, at[0], at[1]], np.abs(matrices).max(axis=(1, 2))[:, None]
        largest = (np.abs(blocks) * sizes).max()
        self.is_real = bool((np.abs(blocks.imag) * sizes).max() <= 1e-11 * largest)
        self._blocks = np.ascontiguousarray(blocks.real if self.is_real else blocks)
        self._matrices = matrices.reshape(len(terms), -1).astype(self._blocks.dtype)

    def __call__(self, *at: float) -> NDArray[Any]:
        """The matrix at given numbers."""
        return self._sum(np.prod(np.array(at) ** self._powers, axis=1))

    def by(self, numbers: tuple[int, ...], *at: float) -> NDArray[Any]:
        """Derivative of the matrix by the numbers with these indices, one after the other."""
        powers, factors = self._powers.copy(), np.ones(len(self._powers))
        for i in numbers:
            factors *= powers[:, i]
            powers[:, i] = np.maximum(powers[:, i] - 1, 0)
        return self._sum(factors * np.prod(np.array(at) ** powers, axis=1))

    def _sum(self, factors: Array) -> NDArray[Any]:
        whole = np.zeros(self._shape, dtype=self._blocks.dtype)
        entries = (factors[:, None] * self._blocks).T @ self._matrices
        whole.reshape(-1)[self._filled] = entries.reshape(self._filled.shape)
        return whole


def _waves(count: int) -> tuple[Array, Complex]:
    """Products of harmonics with cos(w tau) and with -sin(w tau), shape (count, count) each."""
    before, after = np.eye(count, k=-1), np.eye(count, k=1)  # exp(i w tau) and its conjugate
    return 0.5 * (before + after), np.asarray(0.5j * (before - after), dtype=np.complex128)


def _real_form(count: int) -> Complex:
    """Unitary matrix that makes cosines and sines of harmonics, shape (count, count).

    The harmonics are in order, so that k and -k are in mirrored places.
    """
    turn = np.zeros((count, count), dtype=np.complex128)
    root = math.sqrt(0.5)
    for i in range(count):
        j = count - 1 - i
        turn[i, i] = 1.0 if i == j else root if i < j else -1j * root
        if i != j:
            turn[i, j] = root if i < j else 1j * root
    return turn


def pulsating_pipe(model: AnyModel, mean: float, size: int) -> PulsatingPipe:
    """The pulsating pipe of a model, reduced to some of its modes where the model is large.

    A model with more than 30 degrees of freedom is projected on 2 `size` directions, which are
    those in which its lowest modes at three speeds are largest. The continuous pipe is replaced by
    a reduced model with `size` functions, and more for joints.
    """
    if isinstance(model, Continuum):
        one = model.frozen(size + FUNCTIONS_A_JOINT * basis_joints(model.pipe).size)
        return PulsatingPipe.of(one.elastic_operators(), mean)
    whole = PulsatingPipe.of(model.elastic_operators(), mean)
    if whole.size <= LARGEST_UNREDUCED:
        return whole
    spectrum, vectors = eigenproblem(model).spectrum(), list[Array]()
    for speed in mean * np.array([1.0, 0.7, 1.3]):
        pairs = spectrum.lowest(speed, 2 * size, left=False, high=True)
        some = pairs.right[:, pairs.converged & (pairs.values.imag >= 0.0)]
        weights = 1.0 / np.arange(1.0, some.shape[1] + 1.0) ** 2
        vectors += [some.real * weights, some.imag * weights]
    left, _, _ = np.linalg.svd(np.concatenate(vectors, axis=1), full_matrices=False)
    return whole.projected(np.ascontiguousarray(left[:, : 2 * size]))


# ----------------------------------------------------------------------------------- multipliers


@saved_as("FloquetMultipliers")
class FloquetMultipliers(TableResult, units={"growth": RATE}):
    """Floquet multipliers of small motions of the straight pipe in a pulsating flow.

    Attributes:
        multipliers: Floquet multipliers, complex, shape (2 dof,), the largest modulus first. In
            each period the motion of each eigenvector is multiplied by its multiplier; if that is
            -1 the motion changes sign from period to period.
        growth: largest rate of growth, log |multiplier| / period, in 1 / T.
        stable: whether no modulus is larger than 1 by more than 1e-6.
        pulsation: the flow speed.
        model: the model.
        size: degrees of freedom of the model that was solved.
        error: error of the worst multiplier, relative if that is above 1, estimated with shorter
            intervals; for `Continuum` at least the change of the largest one from the basis before.
    """

    multipliers: Complex
    growth: float
    stable: bool
    pulsation: Pulsation
    model: AnyModel
    size: int
    error: float

    def _columns(self) -> dict[str, Any]:
        values = self.multipliers
        return {"real": values.real, "imaginary": values.imag, "modulus": np.abs(values)}


def floquet(model: AnyModel, pulsation: Pulsation) -> FloquetMultipliers:
    """Floquet multipliers of the straight pipe whose flow speed pulsates.

    Args:
        model: chain, reduced model or scene up to 100 degrees of freedom, or `Continuum`.
        pulsation: u = mean (1 + amplitude cos(frequency t)).

    Raises:
        NotConverged: if the largest multiplier of the continuous pipe does not converge, or
            multipliers overflow.
        ValueError, TypeError: for bad arguments.

    Source: the variational equation by Magnus' series, see `orbits/magnus.py`.

    Example:
        >>> import pipedyn as pp
        >>> model = pp.Galerkin(pp.Pipe(beta=0.2, gamma=10.0), 10, "legendre")
        >>> found = pp.floquet(model, pp.Pulsation(6.0, 0.3, 30.0))
        >>> print(f"{found.multipliers[0].real:.4f}", found.stable)
        -1.8440 False
    """
    model = checked_model(model)
    if not isinstance(pulsation, Pulsation):
        raise TypeError(f"pulsation must be a Pulsation, got {check.shown(pulsation)}")
    require_motion(model)
    check.real("pulsation.mean", pulsation.mean, low=0.0, high=largest_speed(model))
    if isinstance(model, Model) and model.dof > FLOQUET_DOF:
        raise ValueError(
            f"model must have at most {FLOQUET_DOF} degrees of freedom for floquet, got {model.dof}"
        )

    def question(one: Model) -> tuple[Complex, float]:
        pipe = PulsatingPipe.of(one.elastic_operators(), pulsation.mean)
        with one_thread(2 * pipe.size):
            return pipe.multipliers(pulsation.amplitude, pulsation.frequency)

    def moved(before: tuple[Complex, float], after: tuple[Complex, float]) -> float:
        return relative(*(np.abs(answer[0][:1]) for answer in (before, after)))

    speeds = (pulsation.mean,)
    try:
        answer = converged_answer(
            *(model, speeds, question, moved), tolerance=1e-7, smallest=12, largest=60
        )
    except NewtonFailed as reason:
        raise NotConverged(f"the multipliers were not found: {reason}") from None
    values, error = answer.value
    largest = float(np.abs(values[0]))
    return FloquetMultipliers(
        multipliers=values,
        growth=math.log(max(largest, 1e-300)) / pulsation.period,
        stable=not (beyond_circle(values) > 0.0).any(),
        pulsation=pulsation,
        model=model,
        size=answer.size,
        error=max(error, answer.error),
    )
