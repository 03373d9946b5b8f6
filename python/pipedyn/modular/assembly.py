# SPDX-License-Identifier: MIT
"""Scenes made from parts: modules in redundant coordinates, connected by constraints."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property
from operator import attrgetter
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import ANGLES, BALANCED, Operators, stored
from pipedyn.models.chain import Chain, SpringRule
from pipedyn.models.pipe import Pipe, checked_pipe
from pipedyn.models.segments import MET, SegmentModel, SmallMotions, position_along
from pipedyn.models.terms import Term
from pipedyn.modular.custom import CustomForces
from pipedyn.modular.layout import CONSTRAINTS, MODULES, Layout
from pipedyn.modular.parts import (
    Clamp,
    Constraint,
    Drag,
    InternalFlow,
    Joint,
    Module,
    Part,
    Segment,
    TorsionalSpring,
    part_text,
)
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged, resolved
from pipedyn.util.newton import NewtonFailed, newton

LEAST_ARM = 1e-8
"""Least sum of the distances of a last segment's centre of mass and of its radius of gyration from
its joint, in L: the rounding of the other segments' inertia hides less."""

LARGEST_JACOBIAN = 1300
"""Largest number of segments for a dense Jacobian (6 n, 6 n), which then takes 0.5 GB."""


@saved_as("Assembly")
class Assembly(SegmentModel):
    """A scene made from parts: a pipe of rigid segments, and further parts.

    Every part has its inertia, forces or constraints in redundant coordinates, independently of all
    other parts. Effects at a place of the pipe, or per length, are terms of the pipe; their places
    may lie anywhere along a segment. The supports belong to the pipe as well: a root's spring lies
    in series with joint 1, supports hold the nodes at their places as a `Guide` does, and a guided
    or clamped end needs a `TorsionalSpring` of joint n + 1, between the end and the last segment.

    States are given in the redundant coordinates q = (x_1, y_1, phi_1, x_2, ...), shape (3 n,):
    x_j transverse and y_j downward from the clamp is the position of node j, the end of segment j,
    and phi_j is the angle of joint j. `rhs`, `energy` and `power` read only the angles of the
    joints and their rates; all other coordinates follow from these through the clamp and the
    joints. Guides and pins need not be met exactly. Accelerations satisfy all constraints, take
    O(n), and are NaN if a direction has lost its inertia.

    Operators use the degrees of freedom that the constraints leave. Without guides and pins these
    are the angles of the segments, theta_j = phi_1 + .. + phi_j; with them, they are coordinates
    along an orthonormal basis of the angles that guides and pins allow. Methods that take a
    configuration take the angles, shape (n,), or redundant coordinates, shape (3 n,), that meet the
    constraints. Linear problems cost O(n^3); about the straight pipe, a scene that is a `Chain`
    with terms, free or held by guides, costs as much as that chain.

    A scene is immutable; `plus` returns another scene.

    Args:
        pipe: the pipe, whose numbers determine flow, gravity, drag and Kelvin-Voigt damping.
        modules: parts with inertia or forces, the segments in their order from the clamp; terms
            among them are added to those of the pipe.
        constraints: constraints in any order: `Clamp`, a `Joint` for each further segment, and
            guides and pins that hold the pipe. Redundant constraints are accepted.

    Example:
        >>> scene = pp.modular.chain(pp.Pipe(0.2), 4)
        >>> scene
        Assembly(Pipe(beta=0.2), n=4, 4 springs, InternalFlow(), Drag())
        >>> round(pp.critical_speed(scene).speed, 4)
        4.9493

    Raises:
        ValueError: for parts that do not fit one another: nodes or segments that are not there,
            lengths that do not add up to 1, constraints that contradict one another or leave
            nothing that moves, a span that is taut, a direction without inertia.
        TypeError: for arguments that are no pipe, modules or constraints.

    Source: Orsino and Di Giulio, eqs. (1)-(11).
    """

    def __init__(
        self,
        pipe: Pipe,
        modules: Iterable[Module | Term],
        constraints: Iterable[Constraint],
    ) -> None:
        given = _parts("modules", modules, (Module, Term))
        terms = tuple(part for part in given if isinstance(part, Term))
        super().__init__(pipe)
        if terms:
            self._pipe = replace(pipe, terms=(*pipe.terms, *terms))
        self._layout = Layout(
            [part for part in given if isinstance(part, Module)],
            _parts("constraints", constraints, (Constraint,)),
            self._pipe,
        )
        light = [j for j, s in enumerate(self._layout.segments, start=1) if s.mass is None]
        if self._pipe.mass is not None and light:
            raise ValueError(
                "modules must say the mass of each Segment where the pipe's varies along it, as "
                f"modular.chain does, got none of segment {light[0]}"
            )
        straight = np.zeros(self.integrated)
        self._customs = CustomForces(self._layout)
        for custom in self._customs.each:
            custom.validate(self._configuration(self._layout.rest)[custom.index])
        self._check_pipe()
        self._reference = straight if self._residual(straight) <= MET else None

    def archived(self) -> dict[str, Any]:
        """Arguments by name and the configuration of `about`, from which files restore a scene."""
        return {
            **super().archived(),
            "modules": self.modules,
            "constraints": self.constraints,
        }

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Self:
        """The scene with these arguments and, if there is one, the configuration of `about`.

        Older files also name one of two methods for the accelerations, which had the same result;
        the name is ignored.
        """
        fields.pop("enforcement", None)
        reference = fields.pop("reference")
        made = cls(**fields)
        if reference is not None:
            made._reference = made._angles_from("reference", reference, sizes=(made.integrated,))
        return made

    def _check_pipe(self) -> None:
        """Raises ValueError if a direction that the constraints leave free has no inertia."""
        _, centre, radius, _ = self._chain.bodies()[-1]
        if centre * self._lengths[-1] + radius < LEAST_ARM:
            raise ValueError(
                f"phi_{self._layout.size} moves without inertia of the pipe: give its segment a "
                "gyration radius, or the pipe a point mass there"
            )

    @cached_property
    def core(self) -> _core.Scene:
        """The compiled scene, in redundant coordinates and in the segments' angles."""
        return self._layout.compiled(self._pipe, self._customs or None, self._applied)

    @property
    def calls_python(self) -> bool:
        return bool(self._customs)

    def __repr__(self) -> str:
        layout = self._layout
        plain = [p for p in self.modules if _is_plain_spring(p)]
        parts = [f"n={layout.size}", f"{len(plain)} springs"]
        if layout.base:
            parts.append(f"base={layout.base:g}")
        others = [p for p in self.modules if not (isinstance(p, Segment) or _is_plain_spring(p))]
        parts += [part_text(part) for part in (*others, *layout.guides_and_pins)]
        return f"Assembly({self._pipe!r}, {', '.join(parts)}{self._about_shown})"

    modules = stored("_layout.modules", "The parts with inertia or forces, a tuple.")
    constraints = stored("_layout.constraints", "The constraints, those of supports last.")
    integrated = stored("_layout.size", "Number of angles that an integrator advances, n.")
    _base = stored("_layout.base", "Length of the fixed part at the clamp.")
    _lengths = stored("_layout.lengths", "Lengths of the segments, shape (n,).")
    _own_joints = stored("_layout.springs", "Stiffness of the joints, without a root's spring.")

    @property
    def coordinates(self) -> int:
        """Number of redundant coordinates, 3 n."""
        return 3 * self._layout.size

    @property
    def approximates_pipe(self) -> bool:
        """False: the user chooses the parts, and which pipe they approximate, if any."""
        return False

    @property
    def matrix_rounding(self) -> float:
        return 8.0 * np.finfo(float).eps * len(self._layout.independent)

    @cached_property
    def resisted(self) -> bool:
        still = np.split(self.state(self.resting()), 2)
        own_damping = self._layout.joint_damping(replace(self._pipe, damping=0.0)).any()
        return bool(super().resisted or own_damping or self._customs.resist(*still))

    def plus(self, *parts: Part | Term) -> Assembly:
        """Another scene, with further modules, constraints and terms of the pipe.

        The configuration that `about` chose stays if it meets all constraints, old and new.

        Example:
            >>> scene = pp.modular.chain(pp.Pipe(0.2), 4)
            >>> held = scene.plus(pp.modular.Guide(2), pp.PointMass(at=1.0, mass=0.1))
            >>> round(pp.critical_speed(scene).speed, 4), round(pp.critical_speed(held).speed, 4)
            (4.9493, 5.2274)

        Raises:
            TypeError: for parts that are none of these.
            ValueError: for parts that do not fit, as for `Assembly`.
        """
        for part in parts:
            kinds = Module | Constraint | Term
            check.instance("parts", part, kinds, "modules, constraints or terms")
        constraints = tuple(part for part in parts if isinstance(part, Constraint))
        others = tuple(part for part in parts if isinstance(part, Module | Term))
        return self._remade(self._pipe, others, constraints)

    def _remade(
        self,
        pipe: Pipe,
        modules: tuple[Module | Term, ...] = (),
        constraints: tuple[Constraint, ...] = (),
    ) -> Assembly:
        """The scene on another pipe, with further parts; a free or pinned end has no spring."""
        joints = self.integrated + pipe.end_guided
        own = [m for m in self.modules if getattr(m, "joint", 1) <= joints]
        more = Assembly(
            pipe,
            (*own, *modules),
            (*self._layout.given, *constraints),
        )
        chosen = self._reference
        if chosen is not None and chosen.size == more.integrated and more._residual(chosen) <= MET:
            more._reference = chosen
        return more

    def with_pipe(self, pipe: Pipe) -> Assembly:
        parts = attrgetter("root", "end", "supports")
        same = parts(checked_pipe(pipe)) == parts(self._pipe)
        return super().with_pipe(pipe) if same else self._remade(pipe)

    @cached_property
    def linear_cost(self) -> bool:
        """Whether the scene is, about the straight pipe, a chain that guides may hold."""
        plain = self._layout.has_flow and all(
            isinstance(part, Segment | InternalFlow | Drag) or _is_plain_spring(part)
            for part in self.modules
        )
        return plain and self._reference is not None and not self._reference.any()

    # ------------------------------------------------------------------------------------ states

    def state(self, angles: ArrayLike, rates: ArrayLike | None = None) -> Array:
        """The redundant state y = [q, q'] at angles of the segments and their rates.

        Args:
            angles: theta_j from the axis, rad, shape (n,).
            rates: theta_j', rad / T, shape (n,); 0 if not given.

        Returns:
            State, shape (6 n,).

        Raises:
            ValueError: for other shapes, or a guide or pin that is missed by more than 1e-9; see
                `admissible`.
            TypeError: for arguments that are no arrays of real numbers.
        """
        theta = self._angles_from("angles", angles, sizes=(self.integrated,))
        omega = self._angles_from("rates", rates, theta, sizes=(self.integrated,))
        return self.core.redundant(np.append(theta, omega))

    def _configuration(self, theta: Array) -> Array:
        """Redundant coordinates, shape (3 n,), at angles of the segments, shape (n,)."""
        return self._rest_state(theta)[: self.coordinates, 0]

    def _rest_state(self, theta: Array) -> Array:
        """The redundant state at rest, shape (6 n, 1), at angles of the segments, shape (n,)."""
        return self.core.redundant(np.append(theta, 0.0 * theta)[:, None])

    def _residual(self, theta: Array) -> float:
        """Largest distance of the nodes at angles theta from guides and pins."""
        missed = self._configuration(theta)[self._layout.held] - self._layout.held_values
        return float(np.abs(missed).max(initial=0.0))

    def angles(self, y: ArrayLike) -> Array:
        """Angles of the segments from redundant coordinates or states.

        Args:
            y: q or [q, q'], shape (3 n, ...) or (6 n, ...).

        Returns:
            theta_j, rad, shape (n, ...).

        Raises:
            ValueError, TypeError: for another shape, or numbers that are not finite.
        """
        size = self.coordinates
        raw = check.numbers("y", y, "an array of real numbers", longest=check.LONGEST)
        given = self._columns("y", raw, 2 * size if raw.shape[:1] == (2 * size,) else size)
        return np.cumsum(given[2:size:3], axis=0)

    @property
    def _held_at_rest(self) -> tuple[Array, str]:
        return self._layout.rest, self._layout.guides_text()

    def equilibrium(self, start: ArrayLike, u: float = 0.0) -> Array:
        """A configuration at which all forces balance, stable or not, by Newton's method.

        Args:
            start: configuration from which to begin, angles (n,) or redundant coordinates (3 n,);
                it need not meet guides and pins.
            u: flow speed >= 0, in sqrt(EI / mu_f) / L.

        Returns:
            Redundant coordinates of the equilibrium, shape (3 n,).

        Raises:
            NotConverged: if no equilibrium is found near start.
            ValueError, TypeError: for bad arguments.
        """
        self.require_large_motions()
        u = check.real("u", u, low=0.0, high=1e4)
        given = check.array("start", start, size=(self.integrated, self.coordinates), **ANGLES)
        if given.size == self.coordinates:
            given = np.cumsum(given[2::3])

        def correction(theta: Array) -> tuple[Array, float]:
            """Newton's step of the angles, and its largest entry."""
            linear = self._small_motions(theta)
            joints = linear.joint_angles(np.eye(self.dof))
            _, _, stiffness = self._operators(linear, joints).at(u)
            # The step has no component in directions whose stiffness is of the order of rounding of
            # the largest stiffness: the forces do not determine it there.
            rounding = len(stiffness) * float(np.finfo(float).eps)
            step = np.linalg.lstsq(stiffness, self._forces(linear, u), rcond=rounding)[0]
            turn = np.cumsum(joints @ step)
            return turn, float(np.abs(turn).max())

        try:
            found = newton(
                self.admissible(given),
                correction,
                lambda theta, turn, share: self.admissible(theta + share * turn),
                tolerance=1e-13,
                stagnation=1e-9,
                longest=0.3,
                iterations=100,
            )
        except NewtonFailed as reason:
            raise NotConverged(f"no equilibrium was found at u = {u:g} near start") from reason
        configuration = self._configuration(found)
        left = self._relative_imbalance(self._small_motions(found), u)
        if left > BALANCED:
            raise NotConverged(
                f"no equilibrium was found at u = {u:g} near start: a force of {left:.2g} times "
                "1 + |gamma| + a u^2 is left in a direction in which nothing resists it",
                configuration,
            )
        return configuration

    # ------------------------------------------------------------------------------ linear motion

    @property
    def reference(self) -> Array:
        """Angles of the configuration about which the scene is linearised, shape (n,).

        Raises:
            ValueError: if the straight pipe misses a constraint and `about` was not called.
        """
        if self._reference is None:
            raise ValueError(
                f"the straight pipe misses {self._layout.guides_text()}: choose a "
                "configuration with about(q), for example about(equilibrium(...))"
            )
        return self._reference

    def unbalanced(self, u: float) -> float:
        return self._relative_imbalance(self.linear, u)

    def _relative_imbalance(self, linear: SmallMotions, u: float) -> float:
        """Largest unbalanced force, relative to 1 + |gamma| + a u^2."""
        size = 1.0 + abs(self._pipe.gamma) + self._pipe.alpha * u**2
        return float(np.abs(self._forces(linear, u)).max(initial=0.0)) / size

    def _forces(self, linear: SmallMotions, u: float) -> Array:
        """Unbalanced force at rest, in elastic coordinates, (dof,); it is 0 at an equilibrium."""
        factors = np.array([1.0, self._pipe.alpha * u**2, 0.0])
        moments = self._rest_moments(linear.theta) @ factors
        return linear.elastic.projected(linear.elastic_loads(moments[:, None]))[:, 0]

    @property
    def _held(self) -> NDArray[np.intp]:
        layout = self._layout
        return layout.held[layout.independent] // 3

    def _held_rows(self, theta: Array) -> Array:
        return self._layout.rows(theta)[:, self._layout.independent]

    def _rest_moments(self, theta: Array) -> Array:
        found = super()._rest_moments(theta)
        found[:, 1:] *= self._layout.has_flow
        if self._customs:
            found[:, 0] += self._customs.moments(self._rest_state(theta))[:, 0]
        return found

    def _unconstrained(self, theta: Array) -> Operators:
        found = super()._unconstrained(theta)
        if not self._layout.has_flow:
            found = replace(found, flux=0.0 * found.flux, centrifugal=0.0)
        if not self._customs:
            return found
        layout = self._layout
        rows = layout.moments(theta, layout.inertia.T)
        by_angles, by_rates = np.hsplit(self._customs.slopes(self._rest_state(theta)), 2)
        return replace(
            found,
            mass=found.mass + rows @ rows.T,
            damping=found.damping - by_rates,
            stiffness=found.stiffness - by_angles,
        )

    # -------------------------------------------------------------------------- nonlinear motion

    def require_base(self) -> None:
        super().require_base()
        if self._customs:
            raise ValueError(
                "base must be at rest in a scene with custom modules: whether these stand on the "
                "base or on the ground is not known"
            )

    def jacobian(
        self,
        t: float,
        y: ArrayLike,
        u: float | ArrayLike,
        *,
        u_dot: float | ArrayLike | None = None,
        base: ArrayLike | None = None,
    ) -> Array:
        """Derivative (6 n, 6 n) of `rhs` by one state, in O(n^2), for at most 1300 segments.

        Accelerations depend on the angles of the joints and their rates only, see the class. The
        arguments are those of `Model.jacobian`.
        """
        if self.integrated > LARGEST_JACOBIAN:
            raise ValueError(
                f"dense results need at most {LARGEST_JACOBIAN} segments, got {self.integrated}"
            )
        size = self.coordinates
        state = check.doubles("y", y, "an array of real numbers")
        if state.shape != (2 * size,):
            raise ValueError(f"y must have shape ({2 * size},), got {state.shape}")
        angles, drive = self.core.angles(state), self._drive(state, u_dot, base)
        by_angles = resolved("jacobian", lambda: self._by_angles(angles, u, drive))
        # A segment's angle is the sum of the joints' angles up to it; no other coordinate matters.
        by_joints = np.cumsum(by_angles.reshape(size, 2, -1)[:, :, ::-1], axis=2)[:, :, ::-1]
        whole = np.eye(2 * size, k=size)
        whole[size:, 2::3] = by_joints.reshape(size, -1)
        return whole

    def _by_angles(self, y: Array, u: Any, drive: Array | None) -> Array:
        """Derivative of the accelerations q'' in `rhs` by [theta, theta'], shape (3 n, 2 n)."""
        n, (theta, omega) = self.integrated, np.split(y, 2)
        free = self.equations.derivative(y, u, drive)[n:]
        rates = self.core.redundant_rhs(0.0, self.core.redundant(y), u, drive, refuses=False)
        turning = np.cumsum(rates[3 * n + 2 :: 3])
        along_pipe, by_nodes = self._lengths * np.exp(1j * theta), self._layout.nodes_by_angles
        found = by_nodes(1j * along_pipe) @ free
        found[:, :n] -= by_nodes((turning + 1j * omega**2) * along_pipe)
        found[:, n:] -= by_nodes(2.0 * omega * along_pipe)
        found[2::3] = np.diff(free, axis=0, prepend=0.0)
        return found

    @cached_property
    def _rhs(self) -> Callable[..., Array]:
        return self.equations.redundant_rhs

    # ------------------------------------------------------------------------- what is integrated

    def initial_state(self, q0: ArrayLike, qdot0: ArrayLike | None) -> Array:
        theta = self._angles_from("q0", q0)
        return np.concatenate([theta, self._angles_from("qdot0", qdot0, theta)])

    def to_user(self, p: Array, pdot: Array) -> tuple[Array, Array]:
        y = self.core.redundant(np.concatenate(self.onto_constraints(p.T, pdot.T)))
        return y[: self.coordinates].T, y[self.coordinates :].T

    def from_user(self, q: Array, qdot: Array) -> Array:
        return np.concatenate([np.cumsum(one[:, 2::3], axis=1) for one in (q, qdot)], axis=1)

    def resting(self) -> Array:
        return self._layout.rest if self._reference is None else self._reference

    @property
    def rests_bent(self) -> bool:
        return bool(self.resting().any())

    def _integrated_state(self, y: Any) -> Any:
        return self.core.angles(y)

    # ---------------------------------------------------------------------------------- geometry

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        rows = check.array("q", q, size=(self.integrated, self.coordinates), **ANGLES)
        # If redundant coordinates miss constraints, the line connects their nodes as given.
        places = self._configuration(rows) if rows.size == self.integrated else rows
        nodes = places.reshape(self.integrated, 3)[:, :2]
        steps = np.diff(nodes, axis=0, prepend=[[0.0, self._base]])
        line = position_along(steps, self._base, self._lengths, s)
        line[:, 1] += np.minimum(s, self._base)
        return line

    @property
    def _rest_turns(self) -> Array:
        layout = self._layout
        springs = np.where(layout.springs > 0.0, layout.springs, math.inf)
        moments = np.append(layout.rest_moments, np.zeros(springs.size - layout.size))
        return (moments / springs)[:, None]

    def _segment_angles(self, q: NDArray[Any]) -> NDArray[Any]:
        return np.cumsum(q[2::3], axis=0)

    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        """Redundant coordinates, (3 n,), with angles theta(s) at the segments' middles.

        With guides and pins, the angles are close to these. The argument is that of `Model.bent`.

        Raises:
            NotConverged: if no angles close to these meet guides and pins.
            ValueError, TypeError: for bad arguments, as for `Model.bent`.
        """
        return self._configuration(self.admissible(self.sampled(angle)))

    def _moved(self, columns: NDArray[Any]) -> NDArray[Any]:
        if len(columns) == self.coordinates:
            return self._segment_angles(columns)
        return super()._moved(columns)

    # ----------------------------------------------------------------------------------- arguments

    def _coordinates(self, q: ArrayLike) -> Array:
        return self._angles_from("q", q)

    def _angles_from(
        self,
        name: str,
        given: ArrayLike | None,
        theta: Array | None = None,
        sizes: tuple[int, ...] = (),
    ) -> Array:
        """Angles of the segments, or rates at the angles theta, shape (n,); rates not given are 0.

        They are given as such or in redundant coordinates, which must meet the constraints.
        """
        n, order = self.integrated, int(theta is not None)
        if given is None and theta is not None:
            return np.zeros(n)
        rows = check.array(name, given, size=sizes or (n, self.coordinates), **ANGLES)
        turned = np.array(rows if rows.size == n else np.cumsum(rows[2::3]))
        states = self.core.redundant(np.append(turned if theta is None else theta, turned))
        exact = np.split(states, 2)[order]
        most = MET * (1.0 + order * float(np.abs(turned).max()))
        missed, part = self._layout.worst_met(exact if rows.size == n else rows, exact, order)
        if not missed <= most:
            raise ValueError(
                f"{name} must {('meet', 'keep')[order]} {part_text(part)}, got a deviation of "
                f"{missed:.1e}; admissible(angles) gives angles that meet all"
            )
        return turned


def chain(
    pipe: Pipe,
    n: int | None = None,
    *,
    springs: SpringRule | ArrayLike = "consistent",
    lengths: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    gyration_radii: ArrayLike | None = None,
    drag_points: ArrayLike | None = None,
    base: float = 0.0,
    masses: ArrayLike | None = None,
) -> Assembly:
    """The chain of `pipedyn.Chain`, put together from parts, with internal flow and drag.

    Args:
        pipe: the pipe.
        n: number of segments; not needed if an array gives it.
        springs: a rule, or the stiffness of each joint, as for `Chain`.
        lengths: lengths of the segments in L, as for `Chain`.
        centres: centres of mass, as fractions of the lengths.
        gyration_radii: radii of gyration about the centres of mass, in L.
        drag_points: places at which drag acts, as fractions of the lengths.
        base: length of the fixed part at the clamp, in L.
        masses: masses of the segments, as for `Chain`.

    Example:
        >>> scene = pp.modular.chain(pp.Pipe(0.2), 10)
        >>> round(pp.critical_speed(scene).speed, 4)
        5.4857

    Raises:
        ValueError: as for `Chain` and `Assembly`.
        TypeError: for arguments that are not numbers, arrays or pipes.
    """
    plain = Chain(
        *(pipe, n),
        springs=springs,
        lengths=lengths,
        centres=centres,
        gyration_radii=gyration_radii,
        drag_points=drag_points,
        base=base,
        masses=masses,
    )
    columns = (plain.lengths, plain.centres, plain.gyration_radii, plain.drag_points, plain.masses)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    modules: list[Module] = [Segment(*row) for row in rows]
    springs = [*plain.springs.tolist(), plain.end_spring][: plain.coordinates + pipe.end_guided]
    modules += [TorsionalSpring(j, k) for j, k in enumerate(springs, start=1)]
    modules += [InternalFlow(), Drag()]
    joints = [Joint(j) for j in range(2, plain.coordinates + 1)]
    return Assembly(pipe, modules, [Clamp(plain.base), *joints])


def _is_plain_spring(part: Module) -> bool:
    """Whether a part is a joint's spring with the pipe's damping and without moment at phi = 0."""
    return isinstance(part, TorsionalSpring) and part.damping is None and part.rest_angle == 0.0


def _parts(name: str, given: Any, kinds: tuple[type[Any], ...]) -> tuple[Any, ...]:
    """The parts in an argument as a tuple, which must be a sequence of parts of the kinds."""
    if isinstance(given, str | bytes) or not np.iterable(given):
        raise TypeError(f"{name} must be parts in a sequence, got {check.shown(given)}")
    parts = tuple(given)
    for part in parts:
        if not isinstance(part, kinds):
            listed = " and ".join(f"{kind.__name__.lower()}s" for kind in kinds)
            raise TypeError(f"{name} must hold {listed} only, got {check.shown(part)}")
        if not isinstance(part, Term) and type(part) not in CONSTRAINTS + MODULES:
            raise TypeError(
                f"{name} must hold this package's parts, got {check.shown(part)}; write a module "
                "of your own as a Custom"
            )
    return parts
