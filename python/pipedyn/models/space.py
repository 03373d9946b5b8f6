# SPDX-License-Identifier: MIT
"""Chains that move in three dimensions, with rotation vectors of the tangents as coordinates."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import ANGLES, CORE_MATRICES, Model, Operators, core_pipe
from pipedyn.models.pencil import DensePencil
from pipedyn.models.pipe import Pipe
from pipedyn.models.segments import SegmentModel, core_segments, position_along
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

SMALL_TURN = 1e-8
"""Square of an angle below which sin(rho) / rho and its derivative are 1 and -1/3 to rounding."""


def rotations(q: NDArray[Any]) -> tuple[Array, Array]:
    """Tangents (x, y, z), shape (3, n, k), for rotation vectors [a_x, a_z], shape (2 n, k).

    The second result is sin(rho) / rho, shape (n, k).
    """
    a_x, a_z = np.split(q, 2)
    rho = np.hypot(a_x, a_z)
    share = np.sinc(rho / np.pi)
    return np.stack([share * a_x, np.cos(rho), share * a_z]), share


def turning(q: Array, qdot: Array) -> Array:
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


@saved_as("SpatialChain")
class SpatialChain(Model):
    """A chain of n rigid segments that moves in three dimensions.

    `Chain(pipe, n, dimensions=3)` makes it, with all other arguments of `Chain`.

    Coordinates: the rotation vectors of the segments' tangents, shape (2 n,), first all a_x, then
    all a_z. A segment's tangent is (sin(rho) a_x / rho, cos rho, sin(rho) a_z / rho) along (x, y,
    z) with rho = hypot(a_x, a_z). A motion in the plane z = 0 has a_x = theta and a_z = 0, and is
    the motion of `planar`. x and z are across the straight pipe, y along it.

    The pipe has the same stiffness in all directions and does not twist: damping of a bent pipe
    causes a couple about its axis, for which its torsional stiffness is assumed to be infinite. The
    joints' angles are those between neighbouring tangents, up to pi. At rho = pi the coordinates
    are singular for motions across the plane.

    Small motions of the straight pipe are those of `planar`, in two planes independently, so that
    questions about its stability are answered by `planar`.

    Attributes:
        planar: the chain that moves in the plane z = 0.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=10, dimensions=3)
        >>> motion = pp.simulate(chain, 6.0, 10.0)
        >>> motion.tip.shape
        (501, 3)

    Raises:
        ValueError: for a pipe that is held beyond its root, has a jet at an angle, or a term that
            has no equations in three dimensions here (`AddedMass`, `Stretching`).

    Source: d'Alembert's principle for the velocities of a chain of inextensible, twist-free
    segments; see cpp/pipedyn/chain/space.hpp.
    """

    def __init__(self, planar: SegmentModel) -> None:
        super().__init__(planar.pipe)
        self._planar = planar
        self._check_pipe()

    def _check_pipe(self) -> None:
        pipe = self._pipe
        if pipe.supports or pipe.end != "free" or pipe.jet_angle:
            held = "jet_angle" if pipe.jet_angle else "held"
            rule = "have no jet at an angle" if pipe.jet_angle else "be held at its root alone"
            raise ValueError(f"pipe must {rule} in three dimensions, got {held}: {pipe!r}")
        self.core  # noqa: B018

    def archived(self) -> dict[str, Any]:
        return {"planar": self._planar}

    def with_pipe(self, pipe: Pipe) -> Self:
        return type(self)(self._planar.with_pipe(pipe))

    def about(self, q: ArrayLike) -> Self:
        raise ValueError("a chain in three dimensions is linearised about the straight pipe only")

    def __repr__(self) -> str:
        return f"{self._planar!r}"[:-1] + ", dimensions=3)"

    @property
    def planar(self) -> SegmentModel:
        return self._planar

    @property
    def dimensions(self) -> int:
        return 3

    @property
    def dof(self) -> int:
        """Number of coordinates, 2 n."""
        return 2 * self._planar.dof

    @property
    def coordinate_kind(self) -> str:
        return f"rotation vectors of {self._planar.dof} segments"

    @property
    def approximates_pipe(self) -> bool:
        return self._planar.approximates_pipe

    @cached_property
    def core(self) -> _core.SpatialChain:
        segments = core_segments(self._planar, spring=self._planar._own_joints)
        return _core.SpatialChain(core_pipe(self._pipe), segments)

    def _twice(self, planar: Operators) -> Operators:
        """Operators of both planes, which are uncoupled."""
        both = {name: np.kron(np.eye(2), getattr(planar, name)) for name in CORE_MATRICES}
        loss = None if planar.loss is None else np.asarray(np.kron(np.eye(2), planar.loss))
        return Operators(
            **both, direction=planar.direction, centrifugal=planar.centrifugal, loss=loss
        )

    def operators(self, q: ArrayLike | None = None) -> Operators:
        """Operators of small motions of the straight pipe, of which `planar` has one half."""
        if q is not None and self._coordinates(q).any():
            raise ValueError(f"q must be 0, the straight pipe, in three dimensions, got {q!r}")
        return self._twice(self._planar.operators())

    def elastic_operators(self) -> Operators:
        return self._twice(self._planar.elastic_operators())

    @property
    def elastic_share(self) -> Array:
        return np.tile(self._planar.elastic_share, 2)

    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        columns = self._columns("z", z)
        return np.concatenate([self._planar.from_elastic(half) for half in np.split(columns, 2)])

    def pencil(self) -> DensePencil:
        return DensePencil(self)

    @property
    def stations(self) -> Array:
        return self._planar.stations

    def largest_angle(self, p: NDArray[Any]) -> float:
        return float(np.hypot(*np.abs(np.split(p, 2))).max())

    def _segments_to(self, tangents: Array, s: Array) -> Array:
        """Sums of the segments' vectors up to arc lengths s, (p, 3, k)."""
        planar = self._planar
        steps = planar._lengths[:, None, None] * tangents.transpose(1, 0, 2)
        return position_along(steps, planar._base, planar._lengths, s)

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        tangents, _ = rotations(self._coordinates(q)[:, None])
        line = self._segments_to(tangents, s)[..., 0]
        line[:, 1] += np.minimum(s, self._planar._base)
        return line

    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        raise ValueError(
            "deflection is that of a plane: ask planar.deflection for one half of q, a_x or a_z"
        )

    def _free_ends(self, q: Array, qdot: Array) -> Array:
        lengths = self._planar._lengths
        tangents, _ = rotations(q)
        found = np.concatenate(
            [np.einsum("j,cjk->ck", lengths, of) for of in (tangents, turning(q, qdot))]
        )
        found[1] += self._planar._base
        return found

    def _bending(self, q: Array) -> Array:
        tangents, _ = rotations(q)
        before = np.concatenate(
            [np.broadcast_to([[[0.0]], [[1.0]], [[0.0]]], (3, 1, q.shape[1])), tangents[:, :-1]],
            axis=1,
        )
        apart = np.linalg.norm(tangents - before, axis=0)
        angles = 2.0 * np.arctan2(apart, np.linalg.norm(tangents + before, axis=0))
        local = self._planar._relative_stiffness()[: len(angles), None]
        return np.asarray(self._planar._chain.joints[:, :1] * angles / local)

    @property
    def kinks_known(self) -> bool:
        return not self.pipe.drag

    def kinks(self, p: Array, pdot: Array, drive: Array | None = None) -> Array:
        """Functions that are zero where a place reaches the ring of a stop, (stops, k)."""
        met = [(term.place or 0.0, max(term.kinks)) for term in self.pipe.terms if term.kinks]
        if not met:
            return np.empty((0, p.shape[1]))
        places, gaps = np.array(met).T
        at = self._segments_to(rotations(p)[0], places)[:, [0, 2]]
        if drive is not None:
            at = at + drive[[1, 7]]
        return np.linalg.norm(at, axis=1) - gaps[:, None]

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
        """Coordinates q, shape (2 n,), of a bent pipe.

        Args:
            angle: a_x as a function of arc lengths s, (p,) to (p,): in the plane z = 0 the angle
                theta(s) of the pipe.
            across: a_z as a function of arc lengths; 0 if not given.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=2, dimensions=3)
            >>> chain.bent(lambda s: 0.1 * s, lambda s: 0.2 * s).round(3)
            array([0.025, 0.075, 0.05 , 0.15 ])
        """
        return self.sampled(angle, across)

    def sampled(
        self,
        angle: Callable[[Array], ArrayLike],
        across: Callable[[Array], ArrayLike] | None = None,
    ) -> Array:
        along = self._planar.sampled(angle)
        other = np.zeros_like(along) if across is None else self._planar.sampled(across)
        return np.concatenate([along, other])

    def turned(self, y: ArrayLike, angle: float) -> Array:
        """Configurations, or states [q, q'], turned about the axis of the straight pipe.

        Args:
            y: configurations (2 n, ...) or states (4 n, ...).
            angle: angle of rotation from x towards z, in rad.

        Returns:
            An array of the shape of y.

        Example:
            >>> chain = pp.Chain(pp.Pipe(0.2), n=1, dimensions=3)
            >>> chain.turned([0.1, 0.0], np.pi / 2.0).round(12)
            array([0. , 0.1])
        """
        states = check.doubles("y", y, "an array of real numbers")
        if states.shape[:1] not in ((self.dof,), (2 * self.dof,)):
            raise ValueError(
                f"y must have {self.dof} or {2 * self.dof} rows, got shape {states.shape}"
            )
        turn = check.real("angle", angle, **ANGLES)
        cosine, sine = np.cos(turn), np.sin(turn)
        halves = states.reshape(len(states) // self.dof, 2, -1, *states.shape[1:])
        x, z = halves[:, 0], halves[:, 1]
        moved = np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=1)
        return moved.reshape(states.shape)
