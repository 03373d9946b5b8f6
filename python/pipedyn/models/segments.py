# SPDX-License-Identifier: MIT
"""Models of rigid segments: what holds their nodes, and small motions about a configuration.

Guides and pins enforce B dtheta = 0 for changes of the segments' angles theta; the columns of an
orthonormal basis Z span all dtheta that satisfy this.

In elastic coordinates zeta the angles of the joints are phi = scale * Z zeta, and the elastic
stiffness is the identity.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import ANGLES, CORE_MATRICES, Model, Operators, operators_from, stored
from pipedyn.models.pencil import DensePencil, Pencil, Traits, Vectors, real_columns
from pipedyn.models.pipe import Pipe
from pipedyn.models.profile import moments, reciprocal
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged

MET = 1e-9
"""Tolerance of given states in the constraints, in L and rad, and for rates in these per T.

States with ten digits meet it; it is far above rounding, 1e-15 n.
"""

LONGEST_DENSE = 64
"""Largest chain with dense matrices: as measured, both methods take equal time near this size."""

SAME = 1e-12
"""Distance below which places are equal and guides and pins are met; rounding is some 1e-15."""


class SmallMotions:
    """Bases of the small motions of segments about a configuration at rest.

    Args:
        theta: angles of the segments, which meet guides and pins, shape (n,).
        rows: derivative of the independent constraints by the angles, shape (n, c).
        scale: joint angle for a unit of each elastic coordinate, shape (n,).
    """

    def __init__(self, theta: Array, rows: Array, scale: Array) -> None:
        self.theta, self.rows, self.scale = theta, rows, scale

    @cached_property
    def basis(self) -> _core.Complement:
        """Orthonormal basis, (n, dof), of the segments' angles that guides and pins allow."""
        return _core.Complement(self.rows)

    @cached_property
    def elastic(self) -> _core.Complement:
        """Orthonormal basis, (n, dof), of the elastic coordinates that guides and pins allow."""
        return _core.Complement(self.elastic_loads(self.rows))

    def elastic_loads(self, moments: Array) -> Array:
        """Loads on the elastic coordinates, (n, r), from moments on the segments, (n, r)."""
        return self.scale[:, None] * np.cumsum(moments[::-1], axis=0)[::-1]

    def joint_angles(self, zeta: NDArray[Any]) -> NDArray[Any]:
        """Angles of the joints, shape (n, r), for elastic coordinates, shape (dof, r)."""
        result: NDArray[Any] = self.scale[:, None] * real_columns(self.elastic.lifted, zeta)
        return result


class SegmentModel(Model):
    """A model of n rigid segments, whose angles an integrator advances.

    Guides and pins may hold nodes, the ends of segments.
    """

    _base: float
    _lengths: Array
    _chain = stored("core.chain", "The compiled chain without what holds its nodes.")

    @property
    @abstractmethod
    def _own_joints(self) -> Array:
        """Stiffness of the joints, the first without a root's spring, (n,); (n + 1,) if guided."""

    @abstractmethod
    def _held_rows(self, theta: Array) -> Array:
        """Derivative of the independent constraints by the angles of the segments, (n, c)."""

    @property
    @abstractmethod
    def _held(self) -> NDArray[np.intp]:
        """Indices, from 0 on, of segments, one for each independent constraint on their ends."""

    @property
    def is_varied(self) -> bool:
        pipe = self._pipe
        guided = pipe.end in ("guided", "clamped")
        return bool(guided or pipe.terms or pipe.stiffness or pipe.mass) or not self.linear_cost

    def pencil(self) -> Pencil:
        by_recursion = self.linear_cost and not (self._pipe.terms and self.hides_turn)
        return ChainPencil(self) if by_recursion else DensePencil(self)

    def _unconstrained(self, theta: Array) -> Operators:
        """Operators in the segments' angles, without what holds nodes or acts at the joints."""
        return operators_from(self.core.operators(theta, joints=False), self._pipe)

    def _rest_moments(self, theta: Array) -> Array:
        """Moments on the segments at rest where nothing holds nodes, shape (n, 3).

        The first column has the moments without flow, the others the factors of a u^2 and of s u'.
        """
        still, pipe = self.core.free_accelerations(theta), self._pipe
        if still.any():
            still = self.core.operators(theta).mass @ still
        end = (0.0 if pipe.end_guided else theta[-1]) + pipe.jet_angle
        # The product of one direction exp(i theta) with another's conjugate gives the sine of their
        # difference.
        along_pipe = self._lengths * np.exp(1j * theta)
        beyond = np.cumsum(along_pipe[::-1])[::-1] - along_pipe
        push = -math.sqrt(pipe.beta) * (np.conj(along_pipe) * beyond).imag
        return np.stack([still, self._lengths * np.sin(theta - end), push], axis=1)

    @property
    def dof(self) -> int:
        """Number of degrees of freedom: n less the number of nodes that constraints hold."""
        return self._lengths.size - self._held.size

    def _ends(self) -> Array:
        """Arc lengths where the segments begin and end, shape (n + 1,)."""
        return np.minimum(self._base + np.append(0.0, np.cumsum(self._lengths)), 1.0)

    @property
    def stations(self) -> Array:
        """Arc lengths of the nodes, at which polylines have their maxima."""
        return self._ends()[1:]

    def _relative_stiffness(self, rule: str = "consistent") -> Array:
        """Harmonic mean of the pipe's stiffness over the part of each joint, shape (n + 1,)."""
        if self._pipe.stiffness is None:
            return np.ones(self._lengths.size + 1)
        cells = self._ends()
        if rule == "consistent":
            cells[1:] -= 0.5 * self._lengths
            cells = np.append(cells, 1.0)
            cells[0] = 0.0
        elif rule == "midpoint":
            cells = np.linspace(0.0, 1.0, self._lengths.size + 1)
        harmonic = np.diff(cells) / moments(reciprocal(self._pipe.stiffness), cells)[0]
        return np.append(harmonic, harmonic[-1])[: self._lengths.size + 1]

    def _bending(self, q: Array) -> Array:
        moments = self._chain.joints[:, :1]
        straight = np.zeros((len(moments) - self.integrated, q.shape[1]))  # beyond a guided end
        angles = np.concatenate([self._segment_angles(q), straight])
        turns = np.diff(angles, axis=0, prepend=0.0)
        local = self._relative_stiffness()[: len(moments), None]
        return np.asarray(moments * (turns - self._rest_turns) / local)

    @property
    def _rest_turns(self) -> Array | float:
        """Angles of the joints at which their springs have no moment, (joints, 1), or 0."""
        return 0.0

    # --------------------------------------------------------------------------- small motions

    @cached_property
    def elastic_scale(self) -> Array:
        """Joint angle for a unit of each elastic coordinate, shape (n,): 1 / sqrt(k_j)."""
        scale: Array = self._chain.elastic_scale
        scale.flags.writeable = False
        return scale

    @property
    def elastic_share(self) -> Array:
        return self._chain.joints[: self.integrated, 0] * self.elastic_scale**2

    def _small_motions(self, theta: Array) -> SmallMotions:
        self._required_straight(theta)
        return SmallMotions(theta, self._held_rows(theta), self.elastic_scale)

    @cached_property
    def linear(self) -> SmallMotions:
        """Small motions about the configuration that `about` chose, else the straight pipe."""
        return self._small_motions(self.reference)

    @property
    def reference(self) -> Array:
        """Angles of the configuration about which the model is linearised, shape (n,)."""
        return self.resting()

    def _linear_at(self, q: ArrayLike | None) -> SmallMotions:
        """Small motions about q, or where the model is linearised; ValueError for too many dof."""
        self._check_dense()
        return self.linear if q is None else self._small_motions(self._coordinates(q))

    def operators(self, q: ArrayLike | None = None) -> Operators:
        """Linear operators about a configuration at rest, as of `Model.operators`.

        Without guides and pins their degrees of freedom are the angles of the segments, else the
        coordinates along the columns of `basis`. `stiffness` contains the forces of all parts but
        the flow and, for a bent pipe, the constraint forces that balance them; `flux` contains the
        forces of the flow and the constraint forces that balance it.

        Args:
            q: the configuration, which must meet supports, guides and pins; if not given, that of
                `about`, else the straight pipe.

        Raises:
            ValueError: for a q that misses a constraint or has another shape, or more than 4000
                degrees of freedom.
            TypeError: if q is no array of real numbers.
        """

        def found(model: SegmentModel) -> Operators:
            linear = model._linear_at(q)
            joints = np.diff(linear.basis.lifted(np.eye(self.dof)), axis=0, prepend=0.0)
            return model._operators(linear, joints)

        return self._with_loss(found)

    def basis(self, q: ArrayLike | None = None) -> Array:
        """Angles of the segments for unit degrees of freedom of `operators`, shape (n, dof).

        Where nothing holds nodes it is the identity; else its columns are orthonormal. The argument
        and exceptions are those of `operators`.
        """
        return self._linear_at(q).basis.lifted(np.eye(self.dof))

    def free_directions(self, p: Array) -> Array:
        return self.basis(p)

    def elastic_operators(self) -> Operators:
        """Operators in elastic coordinates, about the configuration of linearisation."""
        self._check_dense()
        return self._operators(self.linear, self.linear.joint_angles(np.eye(self.dof)))

    def _operators(self, linear: SmallMotions, joints: Array) -> Operators:
        """Operators in coordinates whose unit vectors turn the joints by the columns of `joints`.

        Springs are added in the joints' angles, so that the rounding of stiff springs does not hide
        soft ones.
        """
        angles, operators = np.cumsum(joints, axis=0), self._about_bent(linear)
        sizes = np.linalg.norm(angles, axis=0)

        def of_angles(matrix: Array) -> Array:
            """A matrix of the segments' angles in the coordinates; rounding errors are set to 0."""
            made = angles.T @ matrix @ angles
            # Constraints may cancel an effect, for example of a damper at a guide. Its rounding
            # error is set to 0, and so is that in the asymmetry of a symmetric or skew matrix.
            lost = 4.0 * np.finfo(float).eps * np.abs(matrix).max() * np.outer(sizes, sizes)
            parts = 0.5 * (made + made.T), 0.5 * (made - made.T)
            symmetric, skew = (np.where(np.abs(part) <= lost, 0.0, part) for part in parts)
            return symmetric + skew

        matrices: dict[str, Any] = {
            name: of_angles(getattr(operators, name)) for name in CORE_MATRICES
        }
        stiffness, damping, _ = self._chain.joints[: self.integrated].T
        matrices["stiffness"] += joints.T @ (stiffness[:, None] * joints)
        matrices["damping"] += joints.T @ (damping[:, None] * joints)
        return replace(operators, **matrices)

    def _about_bent(self, linear: SmallMotions) -> Operators:
        """The operators of `_unconstrained`, with the stiffness of the forces that hold nodes.

        The forces balance the moments at rest, and their own moments change as the segments turn.
        They are found by least squares in elastic coordinates, where stiff springs do not hide soft
        ones.
        """
        theta, chain = linear.theta, self._unconstrained(linear.theta)
        if not linear.rows.size:
            return chain
        rows, loads = map(linear.elastic_loads, (linear.rows, self._rest_moments(theta)))
        # The rows are independent: no singular value is due to rounding, so that none is cut off.
        forces, *_ = np.linalg.lstsq(rows, -loads, rcond=0.0)
        by_turning = self._held_rows(theta + 0.5 * math.pi) @ forces
        still, thrust, push = map(np.diag, by_turning.T)
        return replace(
            chain,
            stiffness=chain.stiffness - still,
            flux=chain.flux - thrust,
            unsteady=chain.unsteady - push,
        )

    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        columns, linear = self._columns("z", z), self.linear
        joints = linear.joint_angles(columns.reshape(self.dof, -1))
        angles = np.cumsum(joints, axis=0, out=joints)
        return real_columns(linear.basis.projected, angles).reshape(columns.shape)

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        if len(columns) == self.integrated:
            return columns
        return real_columns(self.linear.basis.lifted, columns)

    def _deflected(self, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        if derivative:
            return rotation(p, self._ends(), float(self._own_joints[0]), self._pipe, s)
        across = self._lengths * np.cos(self.linear.theta)
        return position_along((across * p.T).T, self._base, self._lengths, s)

    def _segment_angles(self, q: NDArray[Any]) -> NDArray[Any]:
        """Angles of the segments, (n, k), in configurations, (coordinates, k)."""
        return q

    def _free_ends(self, q: Array, qdot: Array) -> Array:
        states = self._segment_angles(q).T, self._segment_angles(qdot).T
        found = _core.ends(*states, self._lengths_to_tip)
        found[1] += self._base
        return found

    @cached_property
    def _lengths_to_tip(self) -> Array:
        """Lengths of the parts of the segments up to the point of `tips`, shape (n,)."""
        place = self.pipe.tip_place
        return self._lengths if place == 1.0 else self._displacing(np.array([place]))[1][0]

    def _displacing(self, places: Array) -> tuple[Array, Array]:
        starts = self._base + np.cumsum(self._lengths) - self._lengths
        return np.zeros((0, 0)), np.clip(places[:, None] - starts, 0.0, self._lengths)

    def _across(self, p: Array, s: Array) -> Array:
        return np.asarray(self._displacing(s)[1] @ np.sin(p))

    # ------------------------------------------------------------------- what holds nodes in motion

    def free_states(self, y: Array) -> Array:
        """Orthonormal changes of [theta, theta'] that constraints allow, (2 n, 2 dof)."""
        theta, omega = np.split(y, 2)
        by_angles = self._held_rows(theta)
        if not by_angles.size:
            return super().free_states(y)
        drift = omega[:, None] * self._held_rows(theta + 0.5 * math.pi)
        held = np.block([[by_angles, drift], [np.zeros_like(drift), by_angles]])
        vectors, _, _ = np.linalg.svd(held)
        return np.asarray(vectors[:, 2 * by_angles.shape[1] :])

    def onto_constraints(self, p: Array, rates: Array) -> tuple[Array, Array]:
        if not self._held.size:
            return p, rates
        columns = (p.shape[0], -1)
        *met, missed = self.core.project(p.reshape(columns), rates.reshape(columns))
        for of in met:
            of[:, missed > self.core.met] = np.nan
        return met[0].reshape(p.shape), met[1].reshape(rates.shape)

    def admissible(self, angles: ArrayLike) -> Array:
        """Angles close to those given at which supports, guides and pins are met.

        If Newton's method fails, as for segments in line with a pin, it starts again from points
        between the given angles and a known configuration that meets all constraints.

        Args:
            angles: theta_j, rad, shape (n,).

        Returns:
            Angles that meet the constraints, shape (n,).

        Raises:
            NotConverged: if no such angles are found near those given.
            ValueError, TypeError: for another shape, or numbers that are not finite.
        """
        theta = check.array("angles", angles, size=self.integrated, **ANGLES)
        rest, held_by = self._held_at_rest
        shares = (0.0, 0.25, 0.5, 0.75, 1.0)
        found, missed = closest(self.core, (theta + share * (rest - theta) for share in shares))
        if missed > SAME:
            raise NotConverged(f"no angles close to those given meet {held_by}", found)
        return found

    @property
    def _held_at_rest(self) -> tuple[Array, str]:
        """Angles that meet all constraints, and the name of what holds the nodes."""
        return np.zeros(self.integrated), "the supports"

    def sampled(self, angle: Callable[[Array], ArrayLike]) -> Array:
        return self._angles(angle, self._middles)

    @property
    def _middles(self) -> Array:
        """Arc lengths of the middles of the segments, shape (n,)."""
        return self._base + np.cumsum(self._lengths) - 0.5 * self._lengths


class ChainPencil(Pencil):
    """A chain's pencil, with products in O(n); the core solves it by recursion.

    Guides may hold the ends of segments; `complement` spans the elastic coordinates that they
    allow.
    """

    model: SegmentModel

    def __init__(self, model: SegmentModel) -> None:
        super().__init__(model)
        self.core, held = model._chain, model._held
        self.held = held.size > 0
        if self.held:
            guided = np.zeros(model.integrated, dtype=np.bool_)
            guided[held] = True
            self.core = self.core.guided(guided.tolist())
        self.is_long = self.dof > LONGEST_DENSE
        self.end_moves = not self.held and self.pipe.beta * self.pipe.inflow_share > 0.0

    @property
    def turns_freely(self) -> bool:
        return self.core.turns_freely

    @property
    def scale(self) -> Array:
        """Joint angle for a unit of each elastic coordinate, shape (n,)."""
        return self.model.elastic_scale

    @property
    def complement(self) -> _core.Complement:
        """Basis of the elastic coordinates that guides leave free."""
        return self.model.linear.elastic

    @property
    def lost_power(self) -> float:  # type: ignore[override]
        """Power below which a motion of a guided chain counts as undamped; 0 without guides."""
        free = self.scale[:, None] * np.cos(np.arange(1.0, self.scale.size + 1.0))[:, None]
        loads = self.scale[:, None] * self.core.joint_times(free, damping=1.0)
        return 1e-12 * float(np.abs(loads).max(initial=0.0)) if self.held else 0.0

    def spectrum(self, traits: Traits, size: float) -> _core.Eigenproblem:
        return _core.Structured(traits, self.core, self.complement if self.held else None, size)

    def elastic(self, x: Vectors) -> Vectors:
        result: Vectors = super().elastic(real_columns(self.complement.lifted, x))
        return real_columns(self.complement.projected, result)

    def by_springs(self, value: complex) -> Any:
        # What damping adds to a unit elastic stiffness: there is no loss at lambda = value = 0.
        damped = self.pipe.damping * value + (1j * self.pipe.hysteresis if value else 0.0)
        if self.pipe.root == "clamped":
            return 1.0 + damped
        by = np.full(self.scale.size, 1.0 + damped, dtype=np.complex128)
        # The root's spring is in series with the first joint's and has no damping.
        root = self.pipe.root_stiffness
        share = root / (root + float(self.model._own_joints[0])) if root else 0.0
        by[0] = share**2 * (1.0 + damped * (2.0 * share - 1.0))
        return by

    def _product(self, x: Array, part: str) -> Array:
        scale = self.scale[:, None]
        rows = self.core.joint_times(scale * self.complement.lifted(x), **{part: 1.0})
        return self.complement.projected(scale * rows)


def core_segments(one: Any, **joints: Array) -> _core.Segments:
    """Segments with the arrays of a chain or a layout in the core's form, and arrays of joints."""
    return _core.Segments(
        length=one.lengths,
        center=one.centres,
        gyration_radius=one.gyration_radii,
        drag_point=one.drag_points,
        base=one.base,
        mass=one.masses,
        **joints,
    )


def held_ends(pipe: Pipe, ends: Array) -> NDArray[np.intp]:
    """Indices of segments whose ends are held on the axis by supports or the pipe's end, from 0 on.

    Raises ValueError for a support at which no segment ends.
    """
    held = []
    for place in pipe.supports:
        nearest = int(np.abs(ends - place).argmin())
        if abs(ends[nearest] - place) > MET:
            raise ValueError(
                f"a segment must end at each support, got none that ends at s = {place:g}"
            )
        held.append(nearest)
    if pipe.end_held:
        held.append(ends.size - 1)
    return np.array(held, dtype=np.intp)


def closest(core: _core.Scene, starts: Iterable[Array]) -> tuple[Array, float]:
    """Angles that meet guides and pins, from the first start that converges, else the closest."""
    best, least = np.zeros(0), math.inf
    for start in starts:
        found, _, missed = core.project(start[:, None], np.zeros((start.size, 1)))
        if missed[0] < least:
            best, least = found[:, 0], float(missed[0])
        if least <= SAME:
            break
    return best, least


def position_along(steps: NDArray[Any], base: float, lengths: Array, s: Array) -> NDArray[Any]:
    """Sum of the segments' vectors (n, ...) up to s, linear within a segment, 0 on the base."""
    ends = base + np.concatenate([[0.0], np.cumsum(lengths)])
    nodes = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
    j = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, lengths.size - 1)
    part = np.clip((s - ends[j]) / lengths[j], 0.0, 1.0)
    return nodes[j] + (part * steps[j].T).T


def rotation(theta: NDArray[Any], ends: Array, spring: float, pipe: Pipe, s: Array) -> NDArray[Any]:
    """Angles at arc lengths s of the pipe that a chain approximates, (p, ...), of second order.

    Each segment has the pipe's angle at its middle. Between two middles the moment is nearly
    constant, so that the angle grows in proportion to the compliance passed, which for a uniform
    pipe is the length. Towards a free or pinned end the moment vanishes and the angle is constant;
    at a guided or clamped end it is 0, and at a root's spring it is the spring's share of the first
    segment's.

    Args:
        theta: angles of the segments, (n, ...).
        ends: arc lengths where the segments begin and end, (n + 1,).
        spring: stiffness of the first joint without the root's spring.
        pipe: the pipe.
        s: arc lengths, (p,).
    """
    places = np.concatenate([[0.0], 0.5 * (ends[:-1] + ends[1:]), [1.0]])
    at_root = spring / (spring + pipe.root_stiffness) if spring > 0.0 else 1.0
    last = 0.0 if pipe.end_guided else 1.0
    angles = np.concatenate([at_root * theta[:1], theta, last * theta[-1:]])
    if pipe.stiffness is not None:
        every = np.unique(np.concatenate([places, s]))
        passed = np.append(0.0, np.cumsum(moments(reciprocal(pipe.stiffness), every)[0]))
        places, s = (passed[np.searchsorted(every, some)] for some in (places, s))
    j = np.clip(np.searchsorted(places, s, side="right") - 1, 0, places.size - 2)
    share = (s - places[j]) / (places[j + 1] - places[j])
    return np.asarray((angles[j].T * (1.0 - share) + angles[j + 1].T * share).T)
