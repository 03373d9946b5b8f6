# SPDX-License-Identifier: MIT
"""Small motions of the straight pipe while its flow pulsates, u = mean (1 + amplitude cos(w tau)).

They obey M q'' + (C_0 + u C_1) q' + (K_0 + u^2 K_2 + u' K_3) q = 0, of period 2 pi / w. Floquet
multipliers follow from the maps over parts of the period. Motions with one multiplier exp(2 pi i
nu / w) are sums of q_k exp(i (nu + k w) tau), of which Hill's equations H(w, nu, amplitude) q = 0
are blocks; H is a polynomial of second degree in each of its arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipedyn.linear.eigenproblem import Complex, eigenproblem
from pipedyn.linear.modes import largest_speed
from pipedyn.models.base import Model, NotConverged, Operators
from pipedyn.models.continuum import (
    FUNCTIONS_A_JOINT,
    AnyModel,
    Continuum,
    answered,
    checked_model,
    relative,
)
from pipedyn.models.drive import Pulsation
from pipedyn.models.galerkin import basis_joints
from pipedyn.orbits.floquet import UNIT, by_series
from pipedyn.orbits.periodic_orbit import STAGE_NODES
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.result import TableResult
from pipedyn.util.threads import one_thread
from pipedyn.util.units import RATE

LARGEST = 100
"""Degrees of freedom: matrices of 200 rows, and a second or two."""

EXTRA = 3
"""Harmonics beyond those: edges converge by a factor of ten or more with each."""

HARMONICS = 20
"""Orders up to which resonances are counted."""

SMALL = 30
"""Degrees of freedom up to which all are kept: Hill's equations have some ten times as many."""


@dataclass(frozen=True)
class PulsatingPipe:
    """Matrices of the equations above, each (n, n), and the mean of the speed."""

    mass: Array
    damping: Array  # C_0
    velocity: Array  # C_1
    stiffness: Array  # K_0
    flux: Array  # K_2
    unsteady: Array  # K_3
    mean: float

    @classmethod
    def of(cls, operators: Operators, mean: float) -> PulsatingPipe:
        """From a model's operators."""
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
        """The same with coordinates along the columns of a basis."""
        names = ("mass", "damping", "velocity", "stiffness", "flux", "unsteady")
        parts = {name: basis.T @ getattr(self, name) @ basis for name in names}
        return PulsatingPipe(**parts, mean=self.mean)

    def steady(self, amplitude: float) -> Complex:
        """Eigenvalues with the means of u and u^2 for these: where regions come from."""
        mean = self.mean**2 * (1.0 + 0.5 * amplitude**2)
        return np.asarray(np.linalg.eigvals(self.companion(self.mean, mean)), dtype=np.complex128)

    def companion(self, speed: float, square: float) -> Array:
        """Derivative of the state's rate by the state with these for u and u^2."""
        return np.tensordot([1.0, speed, square], self.companions()[:3], 1)

    def companions(self) -> Array:
        """Its parts by 1, u, u^2 and u', (4, 2 n, 2 n), of a state [q, M^-1 p].

        With the momenta p = M q' + u C_1 q / 2 the equations of a conservative pipe are Hamilton's
        at any u, and stay so where they are projected on some of its modes.
        """
        n = self.size
        made = np.zeros((4, 2 * n, 2 * n))
        made[0, :n, n:] = np.eye(n)
        still, square, rate, damping, velocity = self._forces
        half = 0.5 * velocity
        made[1, :n, :n] = made[1, n:, n:] = half
        made[0, n:, n:] = damping
        made[:, n:, :n] = still, damping @ half, square + half @ half, rate - half
        return made

    def require_stable(self, highest: float) -> None:
        """Raises ValueError if rest is unstable at the mean speed.

        Counted are its modes up to five times a frequency.
        """
        values = self.steady(0.0)
        values = values[np.abs(values) < max(5.0 * highest, 50.0)]
        worst = float(values.real.max(initial=0.0))
        if worst > 1e-7 * max(1.0, float(np.abs(values).max(initial=0.0))):
            raise ValueError(
                f"mean must be a speed at which the pipe is stable, got {self.mean:g}, at which "
                f"motions grow like exp({worst:.2g} tau)"
            )

    def resonance(self, kind: str, frequency: float) -> float:
        """The frequency nearest to another from which a region of a conservative pipe comes."""
        values = self.steady(0.0)
        omega = np.unique(np.abs(values.imag)[np.abs(values.imag) > 0.0])
        if kind == "combination":
            i, j = np.triu_indices(omega.size, 1)
            of = np.concatenate([omega[i] + omega[j], omega[j] - omega[i]])
        else:
            of = 2.0 * omega
        order = np.arange(1.0, 2.0 * HARMONICS)
        if kind != "combination":
            order = order[::2] if kind == "subharmonic" else order[1::2]
        every = (of[:, None] / order).ravel()
        return float(every[np.argmin(np.abs(every - frequency))])

    def multipliers(self, amplitude: float, frequency: float) -> tuple[Complex, float]:
        """Floquet multipliers, the largest modulus first, and the error of the worst.

        Raises:
            NewtonFailed: if they overflow.
        """
        given, parts = self._along(amplitude, frequency)
        roots, error = by_series(*given, parts)
        order = np.lexsort((-roots.imag, -np.abs(roots).round(11)))
        return roots[order], error

    def _along(
        self, amplitude: float, frequency: float
    ) -> tuple[tuple[Array, Array, Array], NDArray[np.int_]]:
        """What `interval_maps` takes of a period."""
        count, period = 8, 2.0 * math.pi / frequency
        phases = 2.0 * math.pi * (np.arange(count)[:, None] + STAGE_NODES) / count
        speed = self.mean * (1.0 + amplitude * np.cos(phases))
        rate = -self.mean * amplitude * frequency * np.sin(phases)
        one = np.ones_like(speed)
        by_position = np.tensordot(np.stack([one, speed**2, rate], -1), self._forces[:3], 1)
        by_velocity = np.tensordot(np.stack([one, speed], -1), self._forces[3:], 1)
        units = np.ones(2 * self.size)
        units[self.size :] = math.sqrt(max(np.abs(by_position).max(), 1.0))
        fastest = math.sqrt(np.abs(np.linalg.eigvals(self._forces[0])).max())
        parts = np.full(count, math.ceil(2.0 * (fastest * period) ** (1.0 / 3.0)))
        rows = np.concatenate([by_position, by_velocity], axis=-1)
        return (rows, np.full(count, period / count), units), parts

    @cached_property
    def _forces(self) -> Array:
        """Accelerations by position, times 1, u^2 and u', and by velocity, times 1 and u."""
        forces = self.stiffness, self.flux, self.unsteady, self.damping, self.velocity
        return np.asarray(-np.linalg.solve(self.mass, np.stack(forces)))


def require_motion(model: AnyModel) -> None:
    """Raises ValueError for a pipe with no equation of motion, or none that leaves it at rest."""
    if model.pipe.thrust_across:
        raise ValueError(
            "model must be of a pipe that rests straight where the flow pulsates, got jet_angle = "
            f"{model.pipe.jet_angle:.6g}: it bends with the flow and never rests; simulate gives "
            "its motion"
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
    """Hill's equations with harmonics -many .. many, or -many .. many - 1 where nu is w / 2."""

    def __init__(self, pipe: PulsatingPipe, many: int) -> None:
        self.pipe, self.many = pipe, many
        self._polynomials = dict[float | None, Polynomial]()
        self._others = dict[int, Hill]()

    def fewer(self, low: float, frequency: float) -> Hill:
        """With harmonics that reach as high at a frequency as all do at a lower one."""
        many = math.ceil(self.many * min(low / frequency, 1.0)) + EXTRA
        if many >= self.many:
            return self
        return self._others.setdefault(many, Hill(self.pipe, many))

    @cached_property
    def is_hermitian(self) -> bool:
        """Whether H is Hermitian, as of pipes that neither gain nor lose energy."""
        return self._same_as(lambda h: h.conj().T)

    @cached_property
    def is_real(self) -> bool:
        """Whether H is real, as of pipes with neither damping nor a Coriolis force."""
        return self._same_as(np.conj)

    def _same_as(self, other: Callable[[Complex], Complex]) -> bool:
        h = self.matrix(11.0, 3.0, 0.1, 2 * self.many + 1)
        return bool(np.abs(h - other(h)).max() <= 1e-11 * np.abs(h).max())

    def matrix(self, frequency: float, nu: float, amplitude: float, count: int) -> Complex:
        """H, shape (count n, count n), of count harmonics from -many on."""
        pipe, u, n = self.pipe, self.pipe.mean, self.pipe.size
        at = np.arange(count)
        omega = (nu + frequency * (at - self.many))[:, None, None]
        blocks = np.zeros((count, n, count, n), dtype=np.complex128)
        mean = pipe.stiffness + u**2 * (1.0 + 0.5 * amplitude**2) * pipe.flux
        rate = pipe.damping + u * pipe.velocity
        blocks[at, :, at] = mean + 1j * omega * rate - omega**2 * pipe.mass
        swing = 0.5 * u * amplitude
        for way in (1, -1):  # from the harmonic before and from that behind
            to = at[1:] if way == 1 else at[:-1]
            blocks[to, :, to - way] = (
                2.0 * u * swing * pipe.flux
                + 1j * swing * omega[to - way] * pipe.velocity
                + 1j * swing * way * frequency * pipe.unsteady
            )
            to = at[2:] if way == 1 else at[:-2]
            blocks[to, :, to - 2 * way] = swing**2 * pipe.flux
        return blocks.reshape(count * n, count * n)

    def polynomial(self, share: float | None) -> Polynomial:
        """H by w and the amplitude, nu being share * w, in the cosines and sines of real motions.

        By w, nu and the amplitude where no share is given. Shares are 0 and 1/2.
        """
        if share not in self._polynomials:
            self._polynomials[share] = self._polynomial(share)
        return self._polynomials[share]

    def _polynomial(self, share: float | None) -> Polynomial:
        if share is None:
            is_real = self.is_real

            def every(frequency: float, nu: float, amplitude: float) -> NDArray[Any]:
                h = self.matrix(frequency, nu, amplitude, 2 * self.many + 1)
                return np.ascontiguousarray(h.real) if is_real else h

            return Polynomial(every, 3)
        count = 2 * self.many + (share == 0.0)
        turn = _real_form(count)

        def real(frequency: float, amplitude: float) -> Array:
            h = self.matrix(frequency, share * frequency, amplitude, count)
            rows = turn @ h.reshape(count, -1)  # each coordinate's harmonics by themselves
            both = turn.conj() @ rows.reshape(len(h), count, -1)
            return np.ascontiguousarray(both.real).reshape(h.shape)

        return Polynomial(real, 2)

    def edges(self, share: float, amplitude: float) -> Array:
        """All frequencies of motions with nu = share * frequency, rising: eigenvalues of H."""
        of = self.polynomial(share)
        still, slope, ahead = of(0.0, amplitude), of.by((0,), 0.0, amplitude), of(1.0, amplitude)
        size = len(still)
        # Of 1 / w, as H of one harmonic has no second degree.
        try:
            upper = -np.linalg.solve(still, np.hstack([slope, ahead - slope - still]))
        except np.linalg.LinAlgError:
            return np.empty(0)
        values = np.linalg.eigvals(np.vstack([upper, np.eye(size, 2 * size)]))
        frequencies = 1.0 / values[np.abs(values) > 1e-12]
        real = np.abs(frequencies.imag) < 1e-8 * np.abs(frequencies)
        return np.sort(frequencies.real[real & (frequencies.real > 0.0)])


class Polynomial:
    """A matrix that is a polynomial of second degree in each of some numbers."""

    def __init__(self, of: Callable[..., NDArray[Any]], numbers: int) -> None:
        points = product((-1.0, 0.0, 1.0), repeat=numbers)
        values = np.stack([of(*point) for point in points])
        coefficients = values.reshape(*[3] * numbers, *values.shape[1:])
        for axis in range(numbers):
            less, none, more = np.moveaxis(coefficients, axis, 0)
            parts = none, 0.5 * (more - less), 0.5 * (more + less) - none
            coefficients = np.stack(parts, axis)
        every = coefficients.reshape(3**numbers, -1)
        sizes = np.abs(every).max(axis=1)
        kept = sizes > 1e-15 * sizes.max()
        powers = np.array(list(product(range(3), repeat=numbers)))
        self._powers, self._shape = powers[kept], values.shape[1:]
        # Between harmonics more than two apart there is nothing, whatever the numbers.
        self._filled = np.flatnonzero(values.reshape(len(values), -1).any(axis=0))
        self._parts = np.ascontiguousarray(every[kept][:, self._filled])

    def __call__(self, *at: float) -> NDArray[Any]:
        """The matrix."""
        return self._sum(np.prod(np.array(at) ** self._powers, axis=1))

    def by(self, numbers: tuple[int, ...], *at: float) -> NDArray[Any]:
        """Its derivative by some of the numbers, one after the other."""
        powers, factors = self._powers.copy(), np.ones(len(self._powers))
        for i in numbers:
            factors *= powers[:, i]
            powers[:, i] = np.maximum(powers[:, i] - 1, 0)
        return self._sum(factors * np.prod(np.array(at) ** powers, axis=1))

    def _sum(self, factors: Array) -> NDArray[Any]:
        whole = np.zeros(math.prod(self._shape), dtype=self._parts.dtype)
        whole[self._filled] = factors @ self._parts
        return whole.reshape(self._shape)


def _real_form(count: int) -> Complex:
    """Unitary: cosines and sines from harmonics in order, k and -k in mirrored places."""
    turn = np.zeros((count, count), dtype=np.complex128)
    root = math.sqrt(0.5)
    for i in range(count):
        j = count - 1 - i
        turn[i, i] = 1.0 if i == j else root if i < j else -1j * root
        if i != j:
            turn[i, j] = root if i < j else 1j * root
    return turn


def pulsating_pipe(model: AnyModel, mean: float, size: int) -> PulsatingPipe:
    """Of a model up to 30 degrees of freedom, of others from so many of their lowest modes.

    Of the continuous pipe it is that of a reduced model with so many functions.
    """
    if isinstance(model, Continuum):
        one = model.frozen(size + FUNCTIONS_A_JOINT * basis_joints(model.pipe).size)
        return PulsatingPipe.of(one.elastic_operators(), mean)
    whole = PulsatingPipe.of(model.elastic_operators(), mean)
    if whole.size <= SMALL:
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


@saved_as("FloquetMultipliers", shapes={"2dof": "multipliers"})
class FloquetMultipliers(TableResult, units={"growth": RATE}):
    """What a period of a pulsating flow makes of small motions of the straight pipe.

    Attributes:
        multipliers: complex, shape (2 dof,), the largest modulus first: some motion is multiplied
            by one of these in each period. One at -1 changes sign from period to period.
        growth: largest rate of growth, log |multiplier| / period, in 1 / T.
        stable: whether none is larger than 1, by more than 1e-6.
        pulsation: the flow speed.
        model: the model.
        size: degrees of freedom of the model solved.
        error: of the worst multiplier, relative if above 1, as shorter intervals say; for
            `Continuum` also what the largest one changes by from the basis before.
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
    checked_model(model)
    if not isinstance(pulsation, Pulsation):
        raise TypeError(f"pulsation must be a Pulsation, got {check.shown(pulsation)}")
    require_motion(model)
    check.real("pulsation.mean", pulsation.mean, low=0.0, high=largest_speed(model))
    if isinstance(model, Model) and model.dof > LARGEST:
        raise ValueError(
            f"model must have at most {LARGEST} degrees of freedom for floquet, got {model.dof}"
        )

    def question(one: Model) -> tuple[Complex, float]:
        pipe = PulsatingPipe.of(one.elastic_operators(), pulsation.mean)
        with one_thread(2 * pipe.size):
            return pipe.multipliers(pulsation.amplitude, pulsation.frequency)

    def moved(before: tuple[Complex, float], after: tuple[Complex, float]) -> float:
        return relative(*(np.abs(answer[0][:1]) for answer in (before, after)))

    speeds = (pulsation.mean,)
    try:
        answer = answered(
            *(model, speeds, question, moved), tolerance=1e-7, smallest=12, largest=60
        )
    except NewtonFailed as reason:
        raise NotConverged(f"the multipliers were not found: {reason}") from None
    values, error = answer.value
    largest = float(np.abs(values[0]))
    return FloquetMultipliers(
        multipliers=values,
        growth=math.log(max(largest, 1e-300)) / pulsation.period,
        stable=largest <= 1.0 + UNIT,
        pulsation=pulsation,
        model=model,
        size=answer.size,
        error=max(error, answer.error),
    )
