# SPDX-License-Identifier: MIT
"""What models that move in three dimensions share, with rotation vectors of the tangents.

A tangent with the rotation vector (a_x, a_z) is (sin(rho) a_x / rho, cos rho, sin(rho) a_z / rho)
along (x, y, z) with rho = hypot(a_x, a_z); x and z are across the straight pipe, y along it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from pipedyn.models.base import (
    ANGLES,
    COMPLEX_STEP,
    CORE_MATRICES,
    ROWS,
    Model,
    Operators,
    projected,
)
from pipedyn.models.pipe import Pipe
from pipedyn.models.reduced_supports import MeetsSupports, ReducedSupports
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.errors import NotResolved

SMALL_TURN = 1e-8
"""Square of an angle below which sin(rho) / rho and its derivative are 1 and -1/3 to rounding."""

FAST = 1e10
"""Size of rates beside whose kinetic energy all other energy is rounding."""

FOLDED = 1e-6
"""Distance in rad from half a turn at which a joint or a tangent in space is singular."""

IN_PLANE = 1e-9
"""Largest part of a configuration across a plane, relative to 1 plus its size, that is rounding."""


def rotations(q: NDArray[Any]) -> tuple[Array, Array]:
    """Tangents (x, y, z), shape (3, n, k), for rotation vectors [a_x, a_z], shape (2 n, k).

    The second result is sin(rho) / rho, shape (n, k).
    """
    a_x, a_z = np.split(q, 2)
    rho = np.hypot(a_x, a_z)
    share = np.sinc(rho / np.pi)
    return np.stack([share * a_x, np.cos(rho), share * a_z]), share


def turning(q: Array, qdot: NDArray[Any]) -> NDArray[Any]:
    """Rates of the tangents, shape (3, n, k), for rotation vectors and their rates, (2 n, k)."""
    (a_x, a_z), (b_x, b_z) = np.split(q, 2), np.split(qdot, 2)
    (_, cosine, _), share = rotations(q)
    square = a_x**2 + a_z**2
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = np.where(square > SMALL_TURN, (cosine - share) / square, -1.0 / 3.0)
    radial = a_x * b_x + a_z * b_z
    return np.stack(
        [share * b_x + slope * radial * a_x, -share * radial, share * b_z + slope * radial * a_z]
    )


def tangents_by(q: Array) -> Array:
    """Derivatives of the tangents by a_x and by a_z, shape (2, 3, n, k), for q (2 n, k)."""
    one, none = np.ones_like(q[: len(q) // 2]), np.zeros_like(q[: len(q) // 2])
    return np.stack([turning(q, np.concatenate(unit)) for unit in ((one, none), (none, one))])


def nearest_plane(x: NDArray[Any], z: NDArray[Any]) -> Array:
    """Azimuth, from x towards z, of the plane through the axis that is nearest to vectors (x, z).

    Real or complex vectors have the shape (..., k), azimuths (...,). The sum of the squares of the
    distances from the plane is least, so that factors of the vectors are weights.
    """
    squares = np.sum(np.abs(x) ** 2 - np.abs(z) ** 2, axis=-1)
    return np.asarray(0.5 * np.arctan2(2.0 * np.sum(x * z.conj(), axis=-1).real, squares))


class SpatialSupports(ReducedSupports):
    """Constraints x = z = 0 at the supports of a model in three dimensions."""

    def __init__(self, model: SpatialModel) -> None:
        self.model, self.ease, self.size = model, model._ease, model.coordinates

    def held(self, q: Array) -> tuple[Array, Array]:
        """Displacements at supports, (2 supports, k), x and z of each, and derivatives by q.

        The derivatives have the shape (k, 2 supports, size).
        """
        places, columns = self.model._held_places, q.shape[1]
        rows = 2 * places.size
        found = self.model._places(q, places)[:, [0, 2]].reshape(rows, columns)
        by = self.model._places_by(q, places)[:, [0, 2]].reshape(rows, self.size, columns)
        return found, by.transpose(2, 0, 1)

    def largest_turning(self, rates: Array) -> float:
        return self.model.largest_angle(rates)


class SpatialModel(MeetsSupports, Model):
    """A model that moves in three dimensions; its planar model has the same numbers.

    Coordinates: those of the planar model in the plane of x, then those in the plane of z.

    Args:
        planar: the model that moves in the plane z = 0.
    """

    _planar: Any

    def __init__(self, planar: Any) -> None:
        super().__init__(planar.pipe)
        self._planar = planar
        self.core  # noqa: B018

    def archived(self) -> dict[str, Any]:
        """Fields that a file stores: the planar model, and the configuration of `about`."""
        return {"planar": self._planar, "reference": self._reference}

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Self:
        """The model from the fields of a file; older ones have no configuration."""
        made = cls(fields["planar"])
        reference = fields.get("reference")
        return made if reference is None else made.about(reference)

    def with_pipe(self, pipe: Pipe) -> Self:
        """The model with another pipe, as for `Model`."""
        other = type(self)(self._planar.with_pipe(pipe))
        other._reference, other._applied = self._reference, self._applied
        return other

    def about(self, q: ArrayLike) -> Self:
        """A copy that is linearised about a configuration in the plane z = 0, as for `Model`."""
        other = self.with_pipe(self._pipe)
        other._reference = self._required_straight(self._in_plane(q))
        return other

    def _in_plane(self, q: ArrayLike) -> Array:
        """The configuration, refused unless it lies in the plane z = 0."""
        rest = self._coordinates(q)
        along, across = np.split(rest, 2)
        if across.any():
            raise ValueError(
                "q must lie in the plane z = 0, so that small motions in it and across it are "
                f"apart, got {check.shown(q)}"
            )
        self._planar._coordinates(along)  # checks that it meets supports
        return rest

    @property
    def axisymmetric(self) -> bool:
        """Whether every motion turned about the axis is a motion."""
        pipe = self._pipe
        # A jet at an angle out of a hinge pushes it along the axis, harder on one side.
        lopsided = pipe.end == "pinned" and pipe.alpha * abs(math.sin(pipe.jet_angle)) > 1e-15
        return pipe.symmetric_about_axis and not lopsided

    def from_plane(self, p: Array) -> Array:
        """Coordinates p, (dof, ...), from those of `planar`, which moves in the plane z = 0."""
        return np.concatenate([p, np.zeros_like(p)])

    def _towards_plane(self, p: Array) -> tuple[Array, Array]:
        """Parts of p in the plane z = 0 and across it, after the turn that is allowed."""
        x, z = np.split(p, 2)
        if self.axisymmetric:  # the plane nearest to p becomes z = 0
            x, z = np.split(self.turned(p, -float(nearest_plane(x, z))), 2)
        return x, z

    def nearest_in_plane(self, p: Array) -> Array:
        """Coordinates of `planar`, (integrated,), nearest to p, which may be turned for that."""
        return self._towards_plane(p)[0]

    def into_plane(self, name: str, p: Array) -> Array:
        """Coordinates of `planar`, (integrated,), for p of the argument `name`.

        Raises:
            ValueError: if p does not lie in the plane z = 0 or, where all planes through the axis
                are alike, in one of these.
        """
        if not self.lies_in_plane(p):
            planes = "a plane through the axis" if self.axisymmetric else "the plane z = 0"
            raise ValueError(f"{name} must lie in {planes}, got {check.shown(p)}")
        return self.nearest_in_plane(p)

    def lies_in_plane(self, p: Array) -> bool:
        x, z = self._towards_plane(p)
        return bool(np.abs(z).max() <= IN_PLANE * (1.0 + np.abs(x).max()))

    def __repr__(self) -> str:
        return f"{self._planar!r}"[:-1] + f", dimensions=3{self._about_shown})"

    @property
    def dimensions(self) -> int:
        """Number of dimensions in which the pipe moves, 3."""
        return 3

    @property
    def dof(self) -> int:
        """Number of degrees of freedom, twice that of the planar model."""
        return int(2 * self._planar.dof)

    @property
    def coordinates(self) -> int:
        """Number of coordinates, twice that of the planar model."""
        return int(2 * self._planar.coordinates)

    @property
    def _is_held(self) -> bool:
        return bool(self.dof < self.coordinates)

    @cached_property
    def _supports(self) -> ReducedSupports:
        return SpatialSupports(self)

    @property
    @abstractmethod
    def _held_places(self) -> Array:
        """Arc lengths at which the pipe is held across, ascending."""

    @property
    @abstractmethod
    def _ease(self) -> Array:
        """Weights of the coordinates in the least change that meets supports, (coordinates, 1)."""

    def _lifted(self, rows: Array) -> Array:
        return np.asarray(self._moved(rows[:, None])[:, 0])

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([self._planar._moved(half) for half in np.split(columns, 2)])

    def by_coordinates(self) -> Array:
        return self._directions(self._reference)

    def _directions(self, rest: Array | None) -> Array:
        """Changes of coordinates for unit degrees of freedom of `operators`, in their order."""
        planar, half = self._planar, self._planar.coordinates
        if rest is None or not rest.any():
            return np.asarray(np.kron(np.eye(2), planar.by_coordinates()))
        across = self._supports.held(rest[:, None])[1][0, 1::2, half:]
        free, _ = np.linalg.qr(across.T, mode="complete")
        along = planar.about(rest[:half]).by_coordinates()
        return scipy.linalg.block_diag(along, free[:, len(across) :])

    @property
    def approximates_pipe(self) -> bool:
        """Whether the model converges to the continuous pipe, as its planar model does."""
        return bool(self._planar.approximates_pipe)

    @cached_property
    def _across(self) -> Any:
        """The planar model of motions in the plane x = 0, where terms may have other numbers."""
        return self._planar.with_pipe(self._pipe.across())

    @property
    def planes(self) -> tuple[Any, ...]:
        """The planar models of the planes z = 0 and x = 0; empty if the pipe is bent at rest."""
        if self.rests_bent or not self._pipe.rests_straight:
            return ()
        return self._planar, self._across

    @cached_property
    def resisted(self) -> bool:
        """Whether linear forces but the flow's and Kelvin-Voigt damping depend on velocities."""
        return bool(self._planar.resisted or self._across.resisted)

    def _both(self, of: Callable[[Any], Operators]) -> Operators:
        """Operators of both planes, which are uncoupled, from those of a planar model."""
        planar = of(self._planar)
        across = planar if self._pipe.symmetric_about_axis else self._of_across(of)
        both: dict[str, Any] = {
            name: scipy.linalg.block_diag(getattr(planar, name), getattr(across, name))
            for name in CORE_MATRICES
        }
        loss = None if planar.loss is None else scipy.linalg.block_diag(planar.loss, across.loss)
        return replace(planar, **both, loss=loss)

    def _of_across(self, of: Callable[[Any], Operators]) -> Operators:
        """Operators of the plane x = 0 about the straight pipe, in coordinates of `planar`."""
        return of(self._across)

    def operators(self, q: ArrayLike | None = None) -> Operators:
        """Operators of small motions about a configuration in the plane z = 0.

        They have a block for motions in that plane, which is the planar one, and a block for those
        across it. About the straight pipe, which is taken by default, both are the same, unless
        terms have other numbers across the plane.
        """
        rest = self._reference if q is None else self._in_plane(q)
        if rest is None or not rest.any():
            return self._both(lambda planar: planar.operators())
        if why := self.beyond_reach(np.split(rest, 2)[0]):
            raise NotResolved.of_states("operators", (0,), None, why)
        return self._with_loss(lambda model: model._about_bent(rest))

    def _about_bent(self, rest: Array) -> Operators:
        """Operators about a configuration that is bent in the plane z = 0.

        Across the plane, the mass matrix follows from the kinetic energy, which is quadratic in the
        rates, and the other matrices from accelerations at two flow speeds, in which they are
        quadratic, and of a flow that changes. These are odd in the displacements and rates across
        the plane, so that tiny ones give derivatives, and those of a pipe with a large rotary
        inertia, which changes no other force: its mass matrix is so well conditioned that little
        is lost by rounding.
        """
        half, pipe = self._planar.coordinates, self._pipe
        free = self._directions(rest)[half:, self._planar.dof :]
        turning = self.with_pipe(replace(pipe, rotary_inertia=1.0))
        inertia = turning._mass_across(rest)

        planar = self._planar.operators(rest[:half])

        # Columns: a_z and a_z' without flow, both with a flow of speed 1, a_z where that changes.
        y = np.tile(np.append(rest, 0.0 * rest)[:, None], 5 * half)
        both = np.split(np.arange(half, 5 * half), 4)[::2]
        y[np.concatenate([*both, *both, both[0]]), np.arange(5 * half)] = COMPLEX_STEP
        u, drive = np.repeat([0.0, 0.0, 1.0, 1.0, 0.0], half), np.zeros((ROWS, 5 * half))
        drive[0, 4 * half :] = 1.0
        slopes = turning.motion_rates(y, u, drive)[3 * half :] / COMPLEX_STEP
        parts = np.split(-inertia @ slopes, 5, axis=1)
        stiffness, damping, faster, flowing, pushed = parts
        flux = faster - stiffness
        velocity = pipe.direction * (flowing - damping)
        gyroscopic = 0.5 * (velocity - velocity.T)
        across = {
            "mass": self._mass_across(rest),
            "gyroscopic": gyroscopic,
            "end_flux": velocity - gyroscopic,
            "damping": damping,
            "stiffness": stiffness,
            "flux": flux / pipe.alpha if pipe.alpha else 0.0 * flux,
            "unsteady": pipe.direction * (pushed - stiffness),
        }
        blocks: dict[str, Any] = {
            name: scipy.linalg.block_diag(getattr(planar, name), free.T @ of @ free)
            for name, of in across.items()
        }
        return Operators(
            **blocks, direction=planar.direction, centrifugal=planar.centrifugal, loss=None
        )

    def _mass_across(self, rest: Array) -> Array:
        """Mass matrix across the plane in which a configuration is bent, from kinetic energies.

        Rates are so large that all other energy is less than their rounding, and of equal kinetic
        energy, so that small entries are exact to rounding as well.
        """
        half = self._planar.coordinates

        def twice(rates: Array) -> Array:
            """Twice the kinetic energy, (k,), for k rates across the plane, (half, k)."""
            still = np.tile(np.append(rest, 0.0 * rest[:half])[:, None], rates.shape[1])
            return 2.0 * np.asarray(self.energy(np.concatenate([still, rates])))

        scale = FAST / np.sqrt(twice(FAST * np.eye(half)))
        fast = np.diag(FAST * scale)
        i, k = np.triu_indices(half)
        own, mass = twice(fast), np.zeros((half, half))
        mass[i, k] = mass[k, i] = 0.5 * (twice(fast[:, i] + fast[:, k]) - own[i] - own[k])
        return mass / np.outer(FAST * scale, FAST * scale)

    def inertia(self, q: Array, accelerations: Array) -> Array:
        """Forces, (coordinates, k), that give k pipes at rest accelerations, (coordinates, k).

        They are differences of kinetic energies at rates beside which other energy is rounding.
        """
        size = np.maximum(np.abs(accelerations).max(axis=0), 1e-300)
        unit = FAST * np.concatenate([np.eye(len(q)), -np.eye(len(q))], axis=1)[:, None]
        rates = unit + (FAST / size * accelerations)[:, :, None]
        y = np.concatenate([q[:, :, None] + 0.0 * unit, rates]).reshape(2 * len(q), -1)
        ahead, behind = np.split(np.reshape(self.energy(y), rates.shape[1:]), 2, axis=1)
        return np.asarray(0.5 * size / FAST**2 * (ahead - behind).T)

    def elastic_operators(self) -> Operators:
        """Operators in elastic coordinates; about the straight pipe two blocks of planar ones."""
        straight = self._reference is None or not self._reference.any()
        # Elastic coordinates are those of one root.
        if straight and not self._pipe.root_across:
            return self._both(lambda planar: planar.elastic_operators())
        return self._elastic_about

    @cached_property
    def _elastic_about(self) -> Operators:
        """Operators in elastic coordinates about the configuration of `about`."""
        return projected(self.operators(), self.from_elastic(np.eye(self.dof)))

    @property
    def elastic_share(self) -> Array:
        """Diagonal of the elastic stiffness in elastic coordinates."""
        return np.tile(self._planar.elastic_share, 2)

    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        """Coordinates q, shape (dof, ...), from elastic coordinates of the same shape."""
        columns = self._columns("z", z)
        return np.concatenate([self._planar.from_elastic(half) for half in np.split(columns, 2)])

    @property
    def stations(self) -> Array:
        """Arc lengths at which the largest displacement of a mode is searched."""
        return np.asarray(self._planar.stations)

    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        along, across = np.split(p, 2)
        planar, rest = self._planar, self._reference
        if rest is None:
            beside = self._of_shapes_across._deflected(across, s, derivative)
            return np.stack([planar._deflected(along, s, derivative), beside])
        rest, _ = np.split(rest, 2)
        in_plane = planar.about(rest)._deflected(along, s, derivative)
        return np.stack([in_plane, self._aside(rest, across, s, derivative)])

    @property
    def _of_shapes_across(self) -> Any:
        """The planar model whose coordinates and shapes are those across the plane z = 0."""
        return self._planar

    @abstractmethod
    def _aside(self, rest: Array, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        """Displacements z, or angles, of small a_z about a rest bent in the plane z = 0, (p, k).

        Args:
            rest: coordinates of the rest in its plane, (planar dof,).
            p: coordinates of a_z, (planar dof, k).
            s: arc lengths, (p,).
            derivative: 0 for displacements, 1 for angles, which are sin(theta) a_z / theta.
        """

    @property
    def kinks_known(self) -> bool:
        """Whether `kinks` is complete; not with drag."""
        return not self.pipe.drag

    def kinks(self, p: Array, pdot: Array, drive: Array | None = None) -> Array:
        """Functions that are zero where a place reaches a stop, (contacts, k).

        Stops are rings, or flat along x and z.
        """
        met = [
            (term.place or 0.0, max(term.kinks), *way)
            for term in self.pipe.terms
            if term.kinks
            for way in ([(1.0, 1.0)] if term.symmetric_about_axis else np.eye(2))
        ]
        if not met:
            return np.empty((0, p.shape[1]))
        places, gaps, *ways = np.array(met).T
        at = self._places(p, places)[:, [0, 2]]
        if drive is not None:
            at = at + drive[[1, 7]]
        return np.linalg.norm(at * np.transpose(ways)[:, :, None], axis=1) - gaps[:, None]

    @abstractmethod
    def _places(self, p: Array, places: Array) -> Array:
        """Positions on the pipe from the base, (points, 3, k), at p (coordinates, k)."""

    @abstractmethod
    def _places_by(self, p: Array, places: Array) -> Array:
        """Derivatives of the positions by p, (points, 3, coordinates, k)."""

    def stop_places(self) -> tuple[Array, Array, Array]:
        """No places: contacts with rings are not looked for within the steps of an integrator."""
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0)

    def _displacing(self, places: Array) -> tuple[Array, Array]:
        raise NotImplementedError

    def bent(
        self,
        angle: Callable[[Array], ArrayLike],
        across: Callable[[Array], ArrayLike] | None = None,
    ) -> Array:
        """Coordinates q, shape (coordinates,), of a bent pipe, close by those that meet supports.

        Args:
            angle: a_x as a function of arc lengths s, (p,) to (p,): in the plane z = 0 the angle
                theta(s) of the pipe.
            across: a_z as a function of arc lengths; 0 if not given.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2, dimensions=3)
            >>> chain.bent(lambda s: 0.1 * s, lambda s: 0.2 * s).round(3)
            array([0.025, 0.075, 0.05 , 0.15 ])
        """
        q = self.sampled(angle, across)
        return self._onto_supports("angle", q, np.zeros_like(q))[: q.size]

    def sampled(
        self,
        angle: Callable[[Array], ArrayLike],
        across: Callable[[Array], ArrayLike] | None = None,
    ) -> Array:
        """Coordinates, shape (coordinates,), from angles or rates; they need not meet supports."""
        along = self._from_angles(self._angles(angle, self._angle_places))
        if across is None:
            return np.concatenate([along, np.zeros_like(along)])
        other = self._from_angles(self._angles(across, self._angle_places, "across"))
        return np.concatenate([along, other])

    @property
    @abstractmethod
    def _angle_places(self) -> Array:
        """Arc lengths at which angles of a bent pipe are read."""

    @abstractmethod
    def _from_angles(self, angles: Array) -> Array:
        """Coordinates in one plane from angles at these places."""

    def turned(self, y: ArrayLike, angle: float) -> Array:
        """Configurations, or states [q, q'], turned about the axis of the straight pipe.

        Args:
            y: configurations (coordinates, ...) or states (2 coordinates, ...).
            angle: angle of rotation from x towards z, in rad.

        Returns:
            An array of the shape of y.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=1, dimensions=3)
            >>> chain.turned([0.1, 0.0], np.pi / 2.0).round(12)
            array([0. , 0.1])
        """
        states = check.doubles("y", y, "an array of real numbers")
        rows = self.coordinates
        if states.shape[:1] not in ((rows,), (2 * rows,)):
            raise ValueError(f"y must have {rows} or {2 * rows} rows, got shape {states.shape}")
        check.entries("y", states, np.isfinite(states), "be finite")
        turn = check.real("angle", angle, **ANGLES)
        cosine, sine = np.cos(turn), np.sin(turn)
        halves = states.reshape(len(states) // rows, 2, -1, *states.shape[1:])
        x, z = halves[:, 0], halves[:, 1]
        moved = np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=1)
        return moved.reshape(states.shape)
