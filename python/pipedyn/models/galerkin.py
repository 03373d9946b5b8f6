# SPDX-License-Identifier: MIT
"""The reduced model: the pipe's equation projected onto m functions."""

from __future__ import annotations

import bisect
import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, Literal, Self, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import (
    Model,
    Operators,
    arc_lengths,
    core_pipe,
    operators_from,
    projected,
    stored,
)
from pipedyn.models.pencil import DensePencil, Pencil, Traits
from pipedyn.models.pipe import Pipe
from pipedyn.models.reduced_supports import (
    FreeFunctions,
    MeetsSupports,
    ReducedSupports,
    orthonormal,
)
from pipedyn.models.space import FOLDED, SMALL_TURN, SpatialModel, rotations, tangents_by
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array

Compiled = TypeVar("Compiled")
Basis = Literal["beam", "legendre"]
BASES: tuple[Basis, ...] = get_args(Basis)
LARGEST_BASIS = 2000
"""Largest number of functions: each matrix takes 32 MB, and all eigenvalues take minutes."""

LARGEST_TABLE = 100_000_000
"""Largest number of values of functions in one result: 800 MB."""

SHORTEST_PANEL = 1e-4
"""Length of the shortest panel of a basis. Leaving out a joint at the distance d from another
changes results by d^3, 1e-11 of a critical speed at this length; on panels shorter than a third of
it, functions move so little mass that rounding makes their eigenvalues arbitrary."""


gauss_nodes = lru_cache(maxsize=32)(_core.gauss_nodes)
"""Function from a number of nodes to nodes and weights of Gauss-Legendre quadrature on [0, 1]."""


def panel_ends(pipe: Pipe) -> Array:
    """Ends of the panels between terms, supports and jumps of the pipe, shape (panels + 1,).

    Integrands are smooth on each panel.
    """
    places = [term.place for term in pipe.terms if term.place is not None]
    steps = [s for one in (pipe.stiffness, pipe.mass) if one is not None for s in one.at]
    return np.array(sorted({0.0, *places, *pipe.supports, *steps, 1.0}))


def basis_joints(pipe: Pipe) -> Array:
    """Inner ends of a basis' panels: supports, and other joints that leave no panel too short."""
    ends = [0.0, *pipe.supports, 1.0]
    for place in panel_ends(pipe)[1:-1].tolist():
        k = bisect.bisect(ends, place)
        if min(place - ends[k - 1], ends[min(k, len(ends) - 1)] - place) >= SHORTEST_PANEL:
            ends.insert(k, place)
    return np.array(ends[1:-1])


@saved_as("Galerkin", former={"size": "m"})
class Galerkin(MeetsSupports, Model):
    """A reduced model with m functions. Coordinates: their amplitudes q_i, shape (m,).

    The functions are 0 where the pipe is held across and have slope 0 where its direction is held;
    all other conditions follow from the projection. The angle of the centreline is sum_i q_i
    w_i'(s).

    Functions that are 0 where the pipe is held across do not keep a strongly bent pipe there. Large
    motions therefore have one more function for each support and for an end held across, and forces
    that keep x = 0: states have 2 * `coordinates` entries, which must meet these constraints.
    `simulate` accepts m small amplitudes and angles theta(s) as well, and starts from a nearby
    state that meets the constraints.

    `rhs` computes integrals along the pipe with as many nodes as the configuration needs: the error
    is below 1e-10 of the result (1e-6 with drag, whose integrand has kinks), for angles up to pi in
    any of the functions. Configurations beyond that get the largest number of nodes, some 16 m +
    96, fewer beyond 250 functions. With terms this holds for each panel between their places. If q
    coils the pipe more often than the quadrature resolves (some 100 turns with 8 functions), or the
    mass matrix is singular to rounding, `rhs` and all other functions of a state raise
    `NotResolved`, whose message gives the limit of the quadrature.

    Args:
        pipe: the pipe.
        m: number of functions, from 1 to 2000.
        basis: "beam" (modes of a uniform beam held at both ends as the pipe is, of unit mass; the
            critical speed's error falls like m^-4) or "legendre" (w_i'' is a normalised Legendre
            polynomial, of unit stiffness; the error falls exponentially, but the highest third of
            the eigenvalues is not the pipe's).
            The shear jumps at a term of the pipe, and the curvature jumps with its stiffness.
            Legendre polynomials then belong to the panels between jumps: each panel has a
            minimum of functions, the others are shared in proportion to length, and convergence
            stays exponential. Beam modes do not change; their error falls like a power of m.
            The same holds with inner supports, at which combinations of beam modes are 0, and
            with an inclined jet, which loads the end across: m^-2 at rest.
        dimensions: 2 for motions in a plane; 3 makes a `SpatialGalerkin`, which moves in space.

    Example:
        >>> model = pp.Galerkin(pp.Pipe(0.2), m=8, basis="legendre")
        >>> model.dof, round(pp.critical_speed(model).speed, 6)
        (8, 5.591406)

    Raises:
        ValueError: for m out of range or less than the number of panels, or an unknown basis.
        TypeError: for arguments that are not a whole number, a string or a pipe.

    Source: Gregory and Paidoussis (1966) for the equation; Orsino and Pesce (2018) for reduced
    models of this pipe. Equations of motion follow from virtual work along the inextensible
    centreline; the flow's forces are those of Orsino and Di Giulio, eqs. (1)-(9), for infinitely
    short segments.
    """

    def __new__(cls, *args: Any, dimensions: Literal[2, 3] = 2, **options: Any) -> Any:
        """A planar model, or with dimensions=3 the `SpatialGalerkin` of its functions."""
        if check.count("dimensions", dimensions, low=2, high=3) == 2:
            return super().__new__(cls)
        return SpatialGalerkin(cls(*args, **options))

    def __init__(
        self,
        pipe: Pipe,
        m: int,
        basis: Basis = "beam",
        *,
        dimensions: Literal[2, 3] = 2,  # read by __new__
    ) -> None:
        super().__init__(pipe)
        self._size = check.count("m", m, high=LARGEST_BASIS)
        self._basis = check.choice("basis", basis, BASES)
        self._more = 0
        self._check_pipe()

    setattr(__new__, "__signature__", inspect.signature(__init__))  # noqa: B010

    def archived(self) -> dict[str, Any]:
        return {**super().archived(), "m": self._size, "basis": self._basis, "more": self._more}

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Self:
        """Restores the model from the fields of a file, checked as by the constructor."""
        more, reference = fields.pop("more"), fields.pop("reference")
        made = cls(**fields)
        made._more = check.count("more", more, low=0, high=LARGEST_BASIS)
        if reference is not None:
            made._reference = made._checked_reference(reference)
        return made

    def _check_pipe(self) -> None:
        # The core has m functions and one more for each place that is held across. Each panel needs
        # one of them, and a root that can turn needs one more.
        needs = self.panels - len(self._held)
        if self._basis == "legendre":
            turns, directed = self._pipe.root != "clamped", self._pipe.end_guided
            needs += int(turns and not directed) - int(directed and not turns)
        if self._size < needs:
            raise ValueError(
                f"m must be at least {needs}, for one function on each of the {self.panels} panels "
                f"between terms, supports and steps, got {self._size}"
            )
        super()._check_pipe()

    @cached_property
    def core(self) -> _core.Galerkin:
        """The compiled model."""
        return self._compiled(_core.Galerkin, core_pipe(self._pipe, self._applied))

    def _compiled(self, kind: Callable[..., Compiled], pipe: _core.Pipe) -> Compiled:
        """A compiled model of some kind of a pipe, with the functions of this model."""
        legendre = self._basis == "legendre"
        return kind(pipe, legendre, self.coordinates, self._joints, self._more)

    def __repr__(self) -> str:
        return f"Galerkin({self._pipe!r}, m={self._size}, basis={self._basis!r}{self._about_shown})"

    dof = stored("_size", "Number of degrees of freedom, m.")

    @property
    def coordinates(self) -> int:
        """Number of functions in large motions; they need not be 0 where the pipe is held."""
        return self._size + len(self._held)

    @property
    def coordinate_kind(self) -> str:
        joined = f" joined at {check.shown(self._joints)}" if self._joints.size else ""
        of = self._pipe
        held = "" if of.cantilevered else f", held {of.root!r} to {of.end!r} at {of.supports}"
        return f"amplitudes of {self._size} {self._basis} functions{joined}{held}"

    basis = stored("_basis", "Name of the basis.")

    @property
    def panels(self) -> int:
        """Number of panels on which curvatures are smooth: 1 without terms inside the pipe."""
        return self._joints.size + 1

    @property
    def resolution(self) -> int:
        """Number of functions on one panel that would resolve as many modes as this basis.

        A joint between panels takes three functions: with 2 to 20 panels, the lowest three fifths
        of the remaining number are the pipe's modes to some 1e-4, the same as on one panel.
        """
        return max(self._size - 3 * self._joints.size, self._size // 2)

    @property
    def resolved_modes(self) -> int:
        # The highest third of Legendre modes is not the pipe's and heavily damped.
        return max(1, (2 * self.resolution) // 3) if self._basis == "legendre" else self.dof

    def refined(self) -> Galerkin:
        more = max(4, self.panels, self._size // 2)
        return enriched(Galerkin(self._pipe, self._size + more, self._basis), self._more + 1)

    @cached_property
    def _joints(self) -> Array:
        """Inner ends of the panels of the basis; beam modes have none."""
        return basis_joints(self._pipe) if self._basis == "legendre" else np.zeros(0)

    @property
    def _held(self) -> tuple[float, ...]:
        """Arc lengths at which the pipe is held across, ascending."""
        pipe = self._pipe
        return (*pipe.supports, *((1.0,) if pipe.end_held else ()))

    @cached_property
    def _ends(self) -> Array:
        """Ends of the panels on which integrands are smooth, from 0 to 1."""
        return panel_ends(self._pipe)

    def _rule(self, count: int, end: float = 1.0) -> tuple[Array, Array]:
        """Nodes and weights of Gauss-Legendre quadrature up to an end, `count` on each panel."""
        nodes, weights = gauss_nodes(count)
        ends = np.minimum(self._ends, end)
        lengths = np.diff(ends)[:, None]
        return (ends[:-1, None] + lengths * nodes).ravel(), (lengths * weights).ravel()

    def functions(self, s: ArrayLike, derivative: int = 0) -> Array:
        """The functions w_i, or their first or second derivatives w_i' or w_i''.

        Args:
            s: arc lengths in L, each in [0, 1], shape (p,), or one number.
            derivative: 0, 1 or 2.

        Returns:
            Shape (p, m), or (m,) for one number s.
        """
        order = check.count("derivative", derivative, low=0, high=2)
        at, asked = arc_lengths(s)
        found = self._basis_at(at, order)
        found = found @ self._free.lift if self._held else found
        return found.reshape((*asked, self._size))

    def _basis_at(self, s: Array, derivative: int) -> Array:
        """The core's functions or derivatives at arc lengths (p,), shape (p, coordinates)."""
        if s.size * self.coordinates > LARGEST_TABLE:
            raise ValueError(
                f"s must have at most {LARGEST_TABLE // self.coordinates} entries for "
                f"{self.coordinates} functions, got {s.size}"
            )
        return np.asarray(self.core.basis(s, derivative))

    @cached_property
    def _free(self) -> FreeFunctions:
        return FreeFunctions(self.core, self._held, self._basis == "beam")

    def pencil(self) -> Pencil:
        pipe = self._pipe
        by_panels = self._basis == "legendre" and self._reference is None and pipe.rests_straight
        by_panels = by_panels and not (pipe.terms and self.hides_turn)
        of = PanelPencil if by_panels and _core.PanelPencil.fits(self.core) else DensePencil
        found = of(self)
        found.end_moves = pipe.cantilevered and pipe.beta * pipe.inflow_share > 0.0
        return found

    @cached_property
    def _on_panels(self) -> tuple[_core.PanelPencil, Array, Array]:
        """Parts of the pencil in root slope and curvatures, and matrices between coordinates.

        These lead from elastic coordinates to root slope and curvatures, (core's, dof), and back.
        """
        core, root = _core.PanelPencil(self.core), self._pipe.root_stiffness
        lift = core.on_panels(self._amplitudes)
        if (self.elastic_share < 1.0).any():
            return core, lift, np.asarray(np.linalg.pinv(lift), dtype=np.float64)
        loads = core.times(lift, by_damping=1.0)
        if 0.0 < root < math.inf:
            loads[0] += root * lift[0]
        return core, lift, np.ascontiguousarray(loads.T)

    @property
    def elastic_scale(self) -> Array:
        """Amplitudes q_i for a unit of each elastic coordinate, shape (m, m)."""
        return self.small_motions[1]

    @property
    def elastic_share(self) -> Array:
        return self._elastic[1]

    @cached_property
    def _elastic(self) -> tuple[Array, Array]:
        free = self._free
        if self._pipe.stiffness is None:
            return np.diag(free.scale), free.share
        by_core = free.lift * free.scale
        by, share = orthonormal(by_core.T @ self.core.elastic() @ by_core, free.share)
        return free.scale[:, None] * by, share

    @cached_property
    def small_motions(self) -> tuple[Array, Array]:
        """Matrices from model coordinates to the core's amplitudes, and from elastic to model ones.

        If the pipe is held across, its supports allow other directions about the configuration of
        `about` than about the straight pipe.
        """
        rest = self._reference
        if rest is None or not self._held:
            return self._free.lift, self._elastic[0]
        by = self._supports.allowed(rest)
        return by, np.linalg.inv(np.linalg.cholesky(by.T @ self.core.elastic() @ by)).T

    def operators(self, q: ArrayLike | None = None) -> Operators:
        found = super().operators(q)
        if not self._held:
            return found
        by = self.small_motions[0] if q is None else self._supports.allowed(self._coordinates(q))
        return self._held_across(found, by, q is None and self._reference is None)

    def elastic_operators(self) -> Operators:
        rest = self._reference
        core = self.core.operators() if rest is None else self.core.operators(rest)
        return self._held_across(operators_from(core, self._pipe), self._amplitudes, rest is None)

    @cached_property
    def _amplitudes(self) -> Array:
        """Amplitudes of the core's functions for a unit of each elastic coordinate, (core's, m)."""
        lift, scale = self.small_motions
        return lift @ scale

    def _held_across(self, core: Operators, by: Array, straight: bool) -> Operators:
        """Operators in coordinates q, where the core's coordinates are `by` q."""
        found = projected(core, by)
        if not straight or not self._pipe.end_held:
            return found
        # The end is held: no force follows the pipe and the flow does no work, exactly.
        flux, end_flux = 0.5 * (found.flux + found.flux.T), np.zeros_like(found.flux)
        return replace(found, flux=flux, end_flux=end_flux)

    @cached_property
    def _supports(self) -> ReducedSupports:
        return ReducedSupports(self.core)

    @property
    def _is_held(self) -> bool:
        return bool(self._held)

    def _lifted(self, rows: Array) -> Array:
        return np.asarray(self._free.lift @ rows)

    def by_coordinates(self) -> Array:
        return self.small_motions[0]

    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        return np.tensordot(self.elastic_scale, self._columns("z", z), axes=1)

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        amplitudes = self._coordinates(q)

        def tangents(slopes: Array) -> Array:
            angles = slopes @ amplitudes
            return np.stack([np.sin(angles), np.cos(angles)], axis=-1)

        return self._integrated(tangents, amplitudes, s)

    def _integrated(
        self, integrand: Callable[[Array], NDArray[Any]], amplitudes: Array, at: Array
    ) -> NDArray[Any]:
        """Integral up to each of some arc lengths `at`, shape (p, k).

        The integrand takes the slopes of the functions, (points, m), to (points, k). The number of
        nodes is that needed for the pipe bent by the amplitudes.
        """
        nodes, weights = gauss_nodes(self._count_for(amplitudes[:, None]))
        # In pieces, as a table of the functions at all nodes for all s may exceed the memory.
        pieces = math.ceil(at.size * nodes.size * self._size / 1e7)
        found = []
        for piece in np.array_split(at, min(pieces, at.size)):
            total: NDArray[Any] = np.zeros((piece.size, 1))
            for low, high in pairwise(self._ends.tolist()):
                length = np.clip(piece, low, high) - low
                points = (low + np.outer(length, nodes)).ravel()
                values = integrand(self.core.basis(points, 1)).reshape(piece.size, nodes.size, -1)
                total = total + length[:, None] * np.einsum("pnk,n->pk", values, weights)
            found.append(total)
        return np.concatenate(found)

    def _displacing(self, places: Array) -> tuple[Array, Array]:
        count = self.core.most_on_a_panel() + 8
        rules = [self._rule(count, place) for place in places.tolist()]
        nodes = np.concatenate([at for at, _ in rules])
        weights = np.zeros((places.size, places.size, nodes.size // places.size))
        for i, (_, of_place) in enumerate(rules):
            weights[i, i] = of_place
        return np.asarray(self.core.basis(nodes, 1)), weights.reshape(places.size, -1)

    def _free_ends(self, q: Array, qdot: Array) -> Array:
        place = self._pipe.tip_place
        if place == 1.0:
            found = self.core.tips(np.concatenate([q, qdot]))
        else:
            found = np.full((4, q.shape[1]), np.nan)
        coiled = np.isnan(found[0])
        if coiled.any():  # more often than the core resolves in motions
            nodes, weights = self._rule(self._count_for(q[:, coiled]), place)
            angles, turning = self.core.basis(nodes, 1) @ np.stack([q, qdot])[:, :, coiled]
            across, down = weights[:, None] * np.sin(angles), weights[:, None] * np.cos(angles)
            parts = (across, down, down * turning, -across * turning)
            found[:, coiled] = np.sum(parts, axis=1)
        return found

    def _bending(self, q: Array) -> Array:
        return np.asarray(self._basis_at(self.stations, 2) @ q)

    def _count_for(self, amplitudes: Array) -> int:
        """Number of nodes on each panel that integrate sin and cos of the angle; columns (m, k)."""
        count = 2 * self.core.most_on_a_panel() + 60
        turns = np.abs(np.diff(self.core.basis(self._rule(count)[0], 1) @ amplitudes, axis=0))
        most = float(turns.sum(axis=0).max(initial=0.0))
        if not most <= 1000.0:  # the number of nodes grows with it
            raise ValueError(f"q must bend the pipe by at most 1000 rad in all, got {most:.3g} rad")
        return count + math.ceil(most)

    def largest_angle(self, p: NDArray[Any]) -> float:
        return float(np.abs(self.core.basis(np.linspace(0.0, 1.0, 401), 1) @ p).max())

    @cached_property
    def _fit(self) -> tuple[Array, Array]:
        """Arc lengths, and the matrix (m, k) from angles there to amplitudes, by least squares."""
        nodes, weights = self._rule(4 * self.core.most_on_a_panel() + 60)
        root = np.sqrt(weights)
        rows, columns = np.linalg.qr(root[:, None] * self.core.basis(nodes, 1))
        return nodes, np.linalg.solve(columns, rows.T) * root

    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        q = self.sampled(angle)
        return self._onto_supports("angle", q, np.zeros_like(q))[: q.size]

    def sampled(self, angle: Callable[[Array], ArrayLike]) -> Array:
        nodes, fit = self._fit
        return np.asarray(fit @ self._angles(angle, nodes))

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        return columns if len(columns) == self.coordinates else self.small_motions[0] @ columns

    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        rest = self._reference
        if rest is None or derivative == 1:
            return np.asarray(self._basis_at(s, derivative) @ p)
        return self._integrated(
            lambda slopes: np.cos(slopes @ rest)[:, None] * (slopes @ p), rest, s
        )


@saved_as("SpatialGalerkin")
class SpatialGalerkin(SpatialModel):
    """A reduced model with m functions in each of two planes, which moves in three dimensions.

    `Galerkin(pipe, m, basis, dimensions=3)` makes it.

    Coordinates: amplitudes of the rotation vector of the tangent, shape (2 m,) unless the pipe is
    held across beyond its root, first those of its
    component along x, then those of the one along z; each component is sum_i q_i w_i'(s). The
    tangent, and what is assumed about the pipe, are those of `SpatialChain`; in the plane z = 0 the
    model moves as `planar` does. Where a tangent turns by more than pi the coordinates end: `rhs`
    then raises `NotResolved`, and motions stop.

    A pipe may be held as one of `SpatialChain`. States then have two more coordinates for each
    support and for an end held across, as those of `planar` have one; 2 m small amplitudes are
    accepted as well, and a nearby state that meets the supports is found.

    Example:
        >>> model = pp.Galerkin(pp.Pipe(0.2), 8, "legendre", dimensions=3)
        >>> found = pp.rotating_motion(model, 6.0)
        >>> round(found.radius, 4), round(found.frequency, 3)
        (0.1968, 14.369)

    Raises:
        ValueError: as for `SpatialChain`.

    Source: virtual work along the inextensible, twist-free centreline; see
    cpp/pipedyn/galerkin/space.hpp.
    """

    _planar: Galerkin

    @property
    def planar(self) -> Galerkin:
        """The reduced model that moves in the plane z = 0."""
        return self._planar

    @property
    def coordinate_kind(self) -> str:
        return f"{self._planar.coordinate_kind} in two planes"

    def _of_across(self, of: Callable[[Any], Operators]) -> Operators:
        stiffer, pipe = self._pipe.root_across, self._pipe.across()
        if not stiffer:
            return super()._of_across(of)
        planar = self._planar.with_pipe(replace(pipe, root=self._pipe.root))
        found, slope = of(planar), planar._deflected(np.eye(planar.dof), np.zeros(1), 1)
        return replace(found, stiffness=found.stiffness + stiffer * slope.T @ slope)

    @cached_property
    def core(self) -> _core.SpatialGalerkin:
        across, basis = self._pipe.root_across, self._planar.basis
        if across and basis != "legendre":
            raise ValueError(
                "basis must be 'legendre' for a root whose spring differs in x and z, as beam "
                f"modes are those of one spring, got {basis!r}"
            )
        pipe = core_pipe(self._pipe, self._applied, across)
        return self._planar._compiled(_core.SpatialGalerkin, pipe)

    @property
    def matrix_rounding(self) -> float:
        return self._planar.matrix_rounding

    @property
    def resolved_modes(self) -> int:
        return 2 * self._planar.resolved_modes

    def refined(self) -> SpatialGalerkin:
        return SpatialGalerkin(self._planar.refined())

    def pencil(self) -> DensePencil:
        return DensePencil(self)

    @property
    def _held_places(self) -> Array:
        return np.array(self._planar._held)

    @property
    def _ease(self) -> Array:
        return np.tile(self._planar._supports.ease, (2, 1))

    def _slopes_of(self, s: Array, p: NDArray[Any], derivative: int = 1) -> NDArray[Any]:
        """Rotation vectors, or their derivatives, at arc lengths: (2 p, k) for p (2 m, k)."""
        table = self._planar._basis_at(s, derivative)
        return np.concatenate([table @ half for half in np.split(p, 2)])

    def largest_angle(self, p: NDArray[Any]) -> float:
        found = np.abs(self._slopes_of(np.linspace(0.0, 1.0, 401), p.reshape(len(p), -1)))
        return float(np.hypot(*np.split(found, 2)).max())

    def beyond_reach(self, x: Array) -> str:
        turned = self._planar.largest_angle(x)
        why = f"its tangent turns by {turned:.3g} rad, and the coordinates in space end at pi"
        return why if turned > math.pi - FOLDED else ""

    def _nodes_to(self, p: Array, places: Array) -> Iterator[tuple[Array, Array]]:
        """Nodes and weights of integrals from the clamp to each place, for p (2 m, k)."""
        planar = self._planar
        count = planar._count_for(np.abs(p).reshape(2, planar.coordinates, -1).sum(axis=0))
        return (planar._rule(count, place) for place in places.tolist())

    def _places(self, p: Array, places: Array) -> Array:
        found = []
        for nodes, weights in self._nodes_to(p, places):
            tangents, _ = rotations(self._slopes_of(nodes, p))
            found.append(np.einsum("j,cjk->ck", weights, tangents))
        return np.array(found).reshape(places.size, 3, p.shape[1])

    def _places_by(self, p: Array, places: Array) -> Array:
        found = []
        for nodes, weights in self._nodes_to(p, places):
            slopes = self._planar._basis_at(nodes, 1)
            by = tangents_by(self._slopes_of(nodes, p))
            found.append(np.einsum("j,dcjk,ji->cdik", weights, by, slopes))
        return np.array(found).reshape(places.size, 3, self.coordinates, p.shape[1])

    def _aside(self, rest: Array, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        def angles(slopes: Array) -> NDArray[Any]:
            return np.sinc(slopes @ rest / np.pi)[:, None] * (slopes @ p)

        if derivative:
            return angles(self._planar._basis_at(s, 1))
        return self._planar._integrated(angles, rest, s)

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        return self._places(self._coordinates(q)[:, None], s)[..., 0]

    def _free_ends(self, q: Array, qdot: Array) -> Array:
        place = self._pipe.tip_place
        if place == 1.0:
            return np.asarray(self.core.tips(np.concatenate([q, qdot])))
        at = np.array([place])
        velocity = np.einsum("pcik,ik->ck", self._places_by(q, at), qdot)
        return np.concatenate([self._places(q, at)[0], velocity])

    def _bending(self, q: Array) -> Array:
        stations = self.stations
        a, curved = self._slopes_of(stations, q), self._slopes_of(stations, q, 2)
        a_x, a_z = np.split(a, 2)
        k_x, k_z = np.split(curved, 2)
        share = rotations(a)[1]
        square = a_x**2 + a_z**2
        with np.errstate(invalid="ignore", divide="ignore"):
            less = np.where(square > SMALL_TURN, (1.0 - share**2) / square, 1.0 / 3.0)
        bent = k_x**2 + k_z**2 - less * (a_x * k_z - a_z * k_x) ** 2
        return np.asarray(np.sqrt(np.maximum(bent, 0.0)))

    @property
    def _angle_places(self) -> Array:
        return self._planar._fit[0]

    def _from_angles(self, angles: Array) -> Array:
        return np.asarray(self._planar._fit[1] @ angles)


class PanelPencil(Pencil):
    """Pencil of a straight model in Legendre functions, which the core eliminates by panels."""

    model: Galerkin

    def __init__(self, model: Galerkin) -> None:
        super().__init__(model)
        self.core, self.lift, self.projection = model._on_panels

    def spectrum(self, traits: Traits, size: float) -> _core.Eigenproblem:
        return _core.Structured(traits, self.core, self.lift, self.projection, size)

    def _product(self, x: Array, part: str) -> Array:
        return self.lift.T @ self.core.times(self.lift @ x, **{part: 1.0})


def enriched(model: Any, more: int) -> Any:
    """A model with as many functions, which puts `more` additional ones on short panels.

    If size and `more` of two models grow, they differ on every panel of the basis but those shorter
    than 0.003, so that the distance of their answers also bounds the error of short panels.
    """
    if model.dimensions == 3:
        return SpatialGalerkin(enriched(model.planar, more))
    made = model.with_pipe(model.pipe)
    made._more = more
    return made


def last_functions(model: Galerkin) -> list[int]:
    """Indices of the last two Legendre functions of each panel."""
    return [place for panel in model._free.groups[1:] for place in panel[-2:]]
