# SPDX-License-Identifier: MIT
"""Small motions of the straight pipe while its flow pulsates, u = mean (1 + amplitude cos(w tau)).

They obey M q'' + (C_0 + u C_1) q' + (K_0 + u^2 K_2 + u' K_3) q = 0, of period 2 pi / w. Floquet
multipliers follow from the maps over parts of the period. Motions with one multiplier exp(2 pi i
nu / w) are sums of q_k exp(i (nu + k w) tau), of which Hill's equations H(w, nu, amplitude) q = 0
are blocks; H is a polynomial of second degree in each of its arguments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipedyn.bifurcation.floquet import by_series
from pipedyn.bifurcation.periodic_orbit import NODES
from pipedyn.linear.eigenproblem import Complex
from pipedyn.models.base import Model, NotConverged, Operators
from pipedyn.util.check import Array


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
        square = self.mean**2 * (1.0 + 0.5 * amplitude**2)
        inverse = np.linalg.inv(self.mass)
        stiffness = self.stiffness + square * self.flux
        velocity = self.damping + self.mean * self.velocity
        lower = -inverse @ np.hstack([stiffness, velocity])
        upper = np.eye(self.size, 2 * self.size, self.size)
        return np.asarray(np.linalg.eigvals(np.vstack([upper, lower])), dtype=np.complex128)

    def multipliers(self, amplitude: float, frequency: float) -> tuple[Complex, float]:
        """Floquet multipliers, the largest modulus first, and the error of the worst.

        Raises:
            NewtonFailed: if they overflow.
        """
        period = 2.0 * math.pi / frequency
        inverse = np.linalg.inv(self.mass)
        products = [
            inverse @ part
            for part in (self.stiffness, self.flux, self.unsteady, self.damping, self.velocity)
        ]
        largest = self.mean * (1.0 + amplitude)
        fastest = math.sqrt(
            max(np.abs(np.linalg.eigvals(products[0] + largest**2 * products[1])).max(), 1.0)
        )
        count = 8
        phases = 2.0 * math.pi * (np.arange(count)[:, None] + NODES) / count
        speed = self.mean * (1.0 + amplitude * np.cos(phases))
        rate = -self.mean * amplitude * frequency * np.sin(phases)
        factors = np.stack([np.ones_like(speed), speed**2, rate], axis=-1)
        by_position = np.tensordot(factors, np.stack(products[:3]), 1)
        by_velocity = np.tensordot(factors[..., :1], products[3][None], 1)
        by_velocity = by_velocity + speed[..., None, None] * products[4]
        rows = -np.concatenate([by_position, by_velocity], axis=-1)
        units = np.ones(2 * self.size)
        units[self.size :] = fastest
        parts = np.full(count, math.ceil(3.0 * (fastest * period) ** (1.0 / 3.0)))
        roots, error = by_series(rows, np.full(count, period / count), units, parts)
        order = np.lexsort((-roots.imag, -np.abs(roots).round(11)))
        return roots[order], error


class Hill:
    """Hill's equations with harmonics -many .. many, or -many .. many - 1 where nu is w / 2."""

    def __init__(self, pipe: PulsatingPipe, many: int) -> None:
        self.pipe, self.many = pipe, many

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

    def real(self, frequency: float, share: float, amplitude: float) -> Array:
        """H with nu = share * frequency, share 0 or 1/2, in the cosines and sines of real motions."""
        count = 2 * self.many + (share == 0.0)
        h = self.matrix(frequency, share * frequency, amplitude, count)
        blocks = h.reshape(count, self.pipe.size, count, self.pipe.size)
        turn = _real_form(count)
        made = np.einsum("ij,jakb,lk->ialb", turn, blocks, turn.conj(), optimize=True)
        return np.ascontiguousarray(made.real.reshape(h.shape))

    def edges(self, share: float, amplitude: float) -> Array:
        """All frequencies of motions with nu = share * frequency, rising: eigenvalues of H."""
        still, ahead, behind = (self.real(w, share, amplitude) for w in (0.0, 1.0, -1.0))
        first, second = 0.5 * (ahead - behind), 0.5 * (ahead + behind) - still
        size = len(still)
        # Of 1 / w, as H of one harmonic may have no second degree.
        try:
            upper = -np.linalg.solve(still, np.hstack([first, second]))
        except np.linalg.LinAlgError:
            return np.empty(0)
        values = np.linalg.eigvals(np.vstack([upper, np.eye(size, 2 * size)]))
        frequencies = 1.0 / values[np.abs(values) > 1e-12]
        real = np.abs(frequencies.imag) < 1e-8 * np.abs(frequencies)
        found: Array = frequencies.real[real & (frequencies.real > 0.0)]
        return np.sort(found)


def _real_form(count: int) -> Complex:
    """Unitary, of cosines and sines by harmonics that are numbered so that k and -k are mirrored."""
    turn = np.zeros((count, count), dtype=np.complex128)
    root = math.sqrt(0.5)
    for i in range(count):
        j = count - 1 - i
        turn[i, i] = 1.0 if i == j else root if i < j else -1j * root
        if i != j:
            turn[i, j] = root if i < j else 1j * root
    return turn
