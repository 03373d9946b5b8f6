# SPDX-License-Identifier: MIT
"""The chain: n rigid segments joined by torsional springs, and rules for the springs."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import Model, Operators, core_pipe, stored
from pipedyn.models.galerkin import Galerkin, basis_joints
from pipedyn.models.pencil import DensePencil
from pipedyn.models.pipe import Pipe
from pipedyn.models.profile import moments
from pipedyn.models.segments import MET, SegmentModel, core_segments, held_ends, position_along
from pipedyn.models.space import FOLDED, SpatialModel, rotations, tangents_by, turning
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.power_iteration import largest_stretch

SpringRule = Literal["consistent", "midpoint", "rayleigh", "uniform", "frequency"]
SPRING_RULES: tuple[SpringRule, ...] = get_args(SpringRule)

FIRST_BEAM_EIGENVALUE = 1.8751040687119611664**4
"""Square of a cantilever's first angular frequency: k^4 at the root of cos(k) cosh(k) = -1."""

ARRAYS = ("lengths", "masses", "centres", "drag_points", "gyration_radii")
"""Arguments of the constructor with one number for each segment."""

NOT_HELD = np.zeros(0, dtype=np.intp)

LARGEST_CHAIN = 1_000_000
"""Largest number of segments: each array takes 8 MB, a right-hand side some 0.03 s."""

LARGEST_SHARED, MOST_SHARED = 300, 32
"""Largest number of segments of chains that are kept in `_SHARED`, 20 kB each, and of chains."""

_SHARED: dict[tuple[Any, ...], dict[str, Any]] = {}
"""Attributes of chains whose segments follow from a few numbers, for other chains with these."""

SHORTEST_SEGMENT = 1e-7
"""Shortest segment: shorter ones, or a last one with less inertia, are lost in rounding."""


@saved_as("Chain", former={"centers": "centres"})
class Chain(SegmentModel):
    """A chain of n rigid segments, the lumped-parameter model of a pipe.

    Coordinates: the angles theta_j of the segments from the straight pipe, shape (n,), from the
    root to the other end. The terms of the pipe act at their places, anywhere along a segment; a
    force on the fixed base moves nothing. `rhs` takes O(n), `jacobian` O(n^2).

    Supports, and an end that is pinned or clamped, hold ends of segments on the axis, so that the
    degrees of freedom, `dof`, are fewer than n. States and configurations have all n angles and
    must meet the supports to 1e-9, as the results of `bent` and `admissible` do. Operators and
    modes have coordinates along the orthonormal `basis`. An undamped root spring lies in series
    with the first joint, 1 / k_1 + 1 / k_r; a guided or clamped end has a joint n + 1, the mirror
    image of the clamp's.

    Args:
        pipe: the pipe.
        n: number of segments; not needed if an array is given.
        springs: stiffness k_j of the joint at the root side of each segment, in EI / L, shape (n,),
            each >= 0, with one more for a guided or clamped end; or a rule:

            - "consistent": 1 / k_j is the length nearer to joint j than to any other joint (if the
              stiffness e varies, the integral of 1 / e over that length); the base belongs to the
              first joint. So k_j = n on n equal segments, but 2 n at clamps. Second order.
            - "midpoint": n equal cells with a joint in the middle of each, all springs n; half a
              cell stays fixed at the clamp and the last segment is half a cell. Second order, for a
              clamped root, an end free or pinned and no supports.
            - "uniform": all springs n. First order.
            - "frequency": all springs equal, so that the chain's first frequency without flow,
              gravity and terms is the cantilever's. First order.
            - "rayleigh" (the paper's): all springs equal, so that the Rayleigh quotient of the
              tip-load shape, sampled at the joints, is the square of the cantilever's first
              frequency. It converges to a pipe with 0.97133 of the bending stiffness: without
              gravity, frequencies and critical speed end 1.44 % low.

            If the stiffness varies, springs that are equal by these rules are multiplied by its
            harmonic mean over the cell ("midpoint") or over the joint's segment.
        lengths: lengths of the segments in L, shape (n,), each > 0, with a segment's end at each
            support. Default: equal, or equal between supports.
        centres: centre of mass of each segment as a fraction chi_j of its length, shape (n,), in
            [0, 1]. Default: that of the pipe's mass, 1/2 if it is uniform.
        gyration_radii: radii of gyration eta_j about the centres of mass, in L, shape (n,), >= 0.
            Default: those of the pipe's mass, l_j / sqrt(12) if it is uniform.
        drag_points: points where drag acts, as fractions xi_j of the lengths, shape (n,), in [0,
            1]. Default: 1/2.
        base: length of the fixed part at a clamped root, in L; with the lengths it adds up to 1.
        masses: masses of the segments in units of the pipe's mass, shape (n,), each > 0. Default:
            their lengths, or integrals of the pipe's mass if it varies; then masses, centres and
            gyration_radii must be given together or not at all.
        dimensions: 2 for motions in a plane; 3 makes a `SpatialChain`, which moves in space.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=3)
        >>> chain
        Chain(Pipe(beta=0.2), n=3, springs='consistent')
        >>> chain.springs.round(6)
        array([6., 3., 3.])
        >>> pp.Chain(pp.Pipe(0.2), n=3, springs="rayleigh").springs.round(4)
        array([3.9707, 3.9707, 3.9707])

    Raises:
        ValueError: for a number out of range, arrays that do not fit one another, lengths that do
            not add up or do not end at the supports, supports that leave no motion, more than a
            million segments, a segment lighter than its fluid, or "midpoint" with lengths, a base
            or a way of holding the pipe that the rule excludes.
        TypeError: for an argument that is not a number, array or pipe.

    Source: Orsino and Di Giulio, eqs. (1)-(11) and the modal analysis; "midpoint" after Paidoussis
    and Deksnis (1970).
    """

    def __new__(cls, *args: Any, dimensions: Literal[2, 3] = 2, **options: Any) -> Any:
        """A planar chain, or with dimensions=3 the `SpatialChain` of its segments."""
        if check.count("dimensions", dimensions, low=2, high=3) == 2:
            return super().__new__(cls)
        return SpatialChain(cls(*args, **options))

    def __init__(
        self,
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
        dimensions: Literal[2, 3] = 2,  # read by __new__
    ) -> None:
        super().__init__(pipe)
        rule = check.choice("springs", springs, SPRING_RULES) if isinstance(springs, str) else None
        base = check.real("base", base, low=0.0, high=1.0, open_high=True)
        arrays = {"lengths": lengths, "centres": centres, "gyration_radii": gyration_radii}
        arrays |= {"drag_points": drag_points, "masses": masses}
        if n is None:
            n = _segments_in(arrays | {"springs": None if rule else springs}, pipe.end_guided)
        n = check.count("n", n, high=LARGEST_CHAIN)
        # Segments that follow from these numbers alone are made once.
        plain = rule is not None and lengths is centres is gyration_radii is drag_points is None
        plain = plain and masses is None and pipe.stiffness is pipe.mass is None
        key = (n, rule, base, pipe.supports, pipe.end_guided)
        if plain and key in _SHARED:
            vars(self).update(_SHARED[key])
            self._check_pipe()
            return
        cells = _cells(n, base, pipe.supports)
        if rule == "midpoint":
            if lengths is not None or base != 0.0:
                raise ValueError(
                    "springs='midpoint' cuts the pipe itself: give neither lengths nor base"
                )
            base = 0.5 / n
            cells = np.full(n, 1.0 / n)
            cells[-1] = 0.5 / n
        self._lengths = _segment_values("lengths", lengths, cells, open_low=True)
        total = base + float(self._lengths.sum())  # pairwise sum, whose rounding 1e-9 allows
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"base + sum(lengths) must be 1, got {total!r}")
        shortest = float(self._lengths.min())
        if shortest < SHORTEST_SEGMENT:
            raise ValueError(f"lengths must be at least {SHORTEST_SEGMENT:g} each, got {shortest}")
        self._base = base
        inertia = ("masses", "centres", "gyration_radii")
        own = [name for name in inertia if arrays[name] is not None]
        if pipe.mass is not None and len(own) in (1, 2):
            raise ValueError(
                "masses, centres and gyration_radii must be given together or left to the pipe's "
                f"mass, which varies along it, got {' and '.join(own)}"
            )
        mass, center, radius = self._pipe_inertia()
        self._masses = _segment_values("masses", masses, mass, high=1e6, open_low=True)
        self._centres = _segment_values("centres", centres, center, high=1.0)
        self._drag_points = _segment_values("drag_points", drag_points, np.full(n, 0.5), high=1.0)
        self._gyration_radii = _segment_values("gyration_radii", gyration_radii, radius, high=1e3)
        arm = self._centres[-1] * self._lengths[-1] + self._gyration_radii[-1]
        if arm < 0.1 * SHORTEST_SEGMENT:
            raise ValueError(
                "centres and gyration_radii must not both be 0 at the last segment: "
                "it would turn without inertia"
            )
        self._rule = rule
        if rule is None:
            self._joints = check.array(
                "springs", springs, size=n + pipe.end_guided, low=0.0, high=1e15
            )
        else:
            self._joints = _read_only(self._springs_by_rule(rule))
        self._check_pipe()
        self._approximates = rule is not None and not own
        if plain and n <= LARGEST_SHARED:
            if len(_SHARED) == MOST_SHARED:
                _SHARED.clear()
            names = ("_base", "_rule", "_joints", "_approximates", *(f"_{name}" for name in ARRAYS))
            _SHARED[key] = {name: vars(self)[name] for name in names}
            _SHARED[key]["_segments"] = self._segments

    setattr(__new__, "__signature__", inspect.signature(__init__))  # noqa: B010

    def archived(self) -> dict[str, Any]:
        return {
            **super().archived(),
            **{name: getattr(self, name) for name in ARRAYS},
            "base": self._base,
            "rule": self._rule,
            "joints": self._joints,
            "approximates": self._approximates,
        }

    @classmethod
    def restored(cls, fields: dict[str, Any]) -> Self:
        """Restores the chain from the fields of a file, checked as by the constructor."""
        rule, joints, approximates, reference = (
            fields.pop(name) for name in ("rule", "joints", "approximates", "reference")
        )
        n = np.size(fields["lengths"])
        kept = check.array("joints", joints, low=0.0, longest=LARGEST_CHAIN + 1)
        if kept.size not in (n, n + 1):
            raise ValueError(f"joints must have {n} or {n + 1} entries, got {kept.size}")
        made = cls(springs=kept[: n + fields["pipe"].end_guided], **fields)
        for name in ARRAYS:
            given = fields.get(name)
            if isinstance(given, np.ndarray) and given.dtype == np.float64:
                setattr(made, f"_{name}", _read_only(given))  # chains with other pipes share it
        made._joints = kept
        made._rule = None if rule is None else check.choice("rule", rule, SPRING_RULES)
        made._approximates = check.flag("approximates", approximates)
        if reference is not None:
            made._reference = made._checked_reference(reference)
        made._check_pipe()
        return made

    def _pipe_inertia(self) -> tuple[Array, Array, Array]:
        """Masses, centres of mass and radii of gyration of the pipe's segments, shape (n,) each."""
        lengths, mass = self._lengths, self._pipe.mass
        if mass is None:
            return lengths, np.full(lengths.size, 0.5), lengths / math.sqrt(12.0)
        whole, first, second = moments(mass, self._ends())
        arms = first / whole
        return whole, arms / lengths, np.sqrt(second / whole - arms**2)

    def _springs_by_rule(self, rule: str) -> Array:
        """Springs of all joints, with a clamped root and a guided end's joint, shape (n + 1,)."""
        n, every = self.coordinates, self._relative_stiffness(rule)
        if rule == "consistent":
            beside = np.append(self._lengths, 0.0)
            beside[0] += 2.0 * self._base
            beside[1:] += self._lengths
            return 2.0 / beside * every
        if rule in ("uniform", "midpoint"):
            return n * every
        cantilever = replace(self._pipe, terms=(), root="clamped", end="free", supports=())
        bare, relative = self._compiled(np.ones(n), cantilever).chain, every[:-1]
        lowest = _first_eigenvalue(self._pipe)

        def inertia(turns: Array) -> Array:
            """The product of the mass matrix with joint angles, O(n)."""
            return bare.joint_times(turns[:, None], mass=1.0)[:, 0]

        if rule == "rayleigh":
            joints = self._base + np.concatenate([[0.0], np.cumsum(self._lengths)])
            joints[0] = 0.0  # a fixed part does not bend: the first angle is relative to the axis
            tip_load = joints**2 * (3.0 - joints)
            angles = np.diff(tip_load) / self._lengths
            turns = np.diff(angles, prepend=0.0)
            kinetic = turns @ inertia(turns)
            return lowest * kinetic / (turns @ (relative * turns)) * every
        # "frequency": with these springs times k, the largest eigenvalue of the mass matrix is
        # k / omega_1^2.
        soft = np.sqrt(1.0 / relative)
        stretch = largest_stretch(lambda turns: soft * inertia(soft * turns), np.ones(n))
        return lowest * stretch * every

    def _check_pipe(self) -> None:
        """Raises ValueError if the chain does not fit its pipe or the way the pipe is held."""
        pipe, n = self._pipe, self.coordinates
        if self._masses is not self._lengths:
            lacking = self._masses - pipe.beta * self._lengths
            if lacking.min() < -1e-9 * self._masses.max():
                raise ValueError(
                    f"masses must be at least beta = {pipe.beta:g} times the length each, the "
                    f"fluid's part, got {float(self._masses[lacking.argmin()])!r}"
                )
        if pipe.cantilevered:
            return
        guided = pipe.end_guided
        if self._rule == "midpoint" and (pipe.root != "clamped" or guided or pipe.supports):
            raise ValueError(
                "springs='midpoint' is made for a clamped root, an end free or pinned and no "
                f"supports, got {pipe!r}"
            )
        if self._base > 0.0 and pipe.root != "clamped":
            raise ValueError(
                f"base must be 0 unless the root is clamped, got {self._base:g} with {pipe!r}"
            )
        if self._joints.size < n + guided:
            raise ValueError(
                f"springs must have {n + 1} entries, the last of the joint that holds the "
                f"{pipe.end} end, got {n}"
            )
        if self._held.size == n:
            raise ValueError(
                f"supports must leave something that moves: n must be at least {n + 1}, got {n}"
            )
        super()._check_pipe()

    @cached_property
    def _held(self) -> NDArray[np.intp]:
        if self._pipe.cantilevered:
            return NOT_HELD
        return held_ends(self._pipe, self._ends()[1:])

    def _compiled(
        self, springs: Array, pipe: Pipe, held: Sequence[int] = (), applied: Sequence[Any] = ()
    ) -> _core.Scene:
        """The compiled segments with these springs of joints, the ends of those in `held` held."""
        segments, places = core_segments(self, spring=springs), [3 * k for k in held]
        acting = core_pipe(pipe, applied)
        return _core.Scene(acting, segments, held=places, value=np.zeros(len(places)))

    @property
    def _own_joints(self) -> Array:
        return self._joints[: self.coordinates + self._pipe.end_guided]

    @cached_property
    def _segments(self) -> _core.Segments:
        """The segments in the core's form, with their joints."""
        return core_segments(self, spring=self._own_joints)

    def with_pipe(self, pipe: Pipe) -> Self:
        other = super().with_pipe(pipe)
        if pipe.end_guided == self._pipe.end_guided:
            vars(other)["_segments"] = self._segments
        return other

    @cached_property
    def _chain(self) -> _core.Chain:
        return _core.Chain(core_pipe(self._pipe), self._segments)

    @cached_property
    def core(self) -> _core.Scene:
        return self._compiled(self._own_joints, self._pipe, self._held.tolist(), self._applied)

    def _held_rows(self, theta: Array) -> Array:
        before = np.arange(theta.size)[:, None] <= self._held
        return before * (self._lengths * np.cos(theta))[:, None]

    def __repr__(self) -> str:
        rule = repr(self._rule) if self._rule else "array"
        return f"Chain({self._pipe!r}, n={self.coordinates}, springs={rule}{self._about_shown})"

    @property
    def coordinates(self) -> int:
        """Number of angles, n."""
        return self._lengths.size

    approximates_pipe = stored("_approximates", "Whether springs and inertia are not from arrays.")
    rule = stored("_rule", "Name of the spring rule, None for springs of the user's own.")
    base = stored("_base", "Length of the fixed part at the clamp.")
    lengths = stored("_lengths", "l_j, shape (n,).")
    masses = stored("_masses", "Of the segments, in the pipe's, shape (n,).")
    centres = stored("_centres", "chi_j, shape (n,).")
    gyration_radii = stored("_gyration_radii", "eta_j, shape (n,).")
    drag_points = stored("_drag_points", "xi_j, shape (n,).")

    @property
    def springs(self) -> Array:
        """Stiffness k_j of the joints, shape (n,), the first without a root's spring."""
        return self._joints[: self.coordinates]

    @property
    def end_spring(self) -> float:
        """Stiffness k_{n+1} of the joint at a guided or clamped end; 0 for other ends."""
        return float(self._joints[-1]) if self._pipe.end_guided else 0.0

    @property
    def linear_cost(self) -> bool:
        return self._reference is None

    def operators(self, q: ArrayLike | None = None) -> Operators:
        return super().operators(q) if self._held.size else Model.operators(self, q)

    def initial_state(self, q0: ArrayLike, qdot0: ArrayLike | None) -> Array:
        y = super().initial_state(q0, qdot0)
        theta, rates = np.split(y, 2)
        self._require_held("q0", theta)
        self._require_held("qdot0", theta, rates)
        return y

    def _coordinates(self, q: ArrayLike) -> Array:
        return self._require_held("q", super()._coordinates(q))

    def _checked_reference(self, q: Any) -> Array:
        return self._require_held("reference", super()._checked_reference(q))

    def _require_held(self, name: str, theta: Array, rates: Array | None = None) -> Array:
        """The angles, if they meet the supports, and rates keep them; else raises ValueError."""
        if not self._held.size:
            return theta
        if rates is None:
            off = np.cumsum(self._lengths * np.sin(theta))[self._held]
            rule, how, most = "meet", f"admissible({name})", MET
        else:
            off = self._held_rows(theta).T @ rates
            rule, how = "keep", "onto_constraints(q0, qdot0)"
            most = MET * (1.0 + float(np.abs(rates).max()))
        worst = int(np.argmax(np.abs(off)))
        if np.abs(off[worst]) > most:
            raise ValueError(
                f"{name} must {rule} the support at s = {self.stations[self._held][worst]:g}, got "
                f"a deviation of {abs(off[worst]):.1e}; {how} does"
            )
        return theta

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        angles = super()._coordinates(q)  # the angles need not meet supports
        line = position_along(self._lengths * np.exp(1j * angles), self._base, self._lengths, s)
        return np.stack([line.imag, line.real + np.minimum(s, self._base)], axis=-1)

    @property
    def kinks_known(self) -> bool:
        return True

    def kinks(self, p: Array, pdot: Array, drive: Array | None = None) -> Array:
        """Adds the velocities across the segments of the points where drag acts."""
        of_terms = super().kinks(p, pdot, drive)
        if self.pipe.drag == 0.0:
            return of_terms
        tangents = np.exp(1j * p)
        steps = self._lengths[:, None] * pdot * tangents
        joints = np.cumsum(steps, axis=0) - steps  # velocities of the roots of the segments
        if drive is not None:
            joints += drive[3] - 1j * drive[4]
        reach = (self._drag_points * self._lengths)[:, None]
        return np.concatenate([of_terms, (joints * tangents.conj()).real + reach * pdot])

    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        return self.admissible(self.sampled(angle))


@saved_as("SpatialChain")
class SpatialChain(SpatialModel):
    """A chain of n rigid segments that moves in three dimensions.

    `Chain(pipe, n, dimensions=3)` makes it, with all other arguments of `Chain`.

    Coordinates: the rotation vectors of the segments' tangents, shape (2 n,), first all a_x, then
    all a_z. A segment's tangent is (sin(rho) a_x / rho, cos rho, sin(rho) a_z / rho) along (x, y,
    z) with rho = hypot(a_x, a_z). A motion in the plane z = 0 has a_x = theta and a_z = 0, and is
    the motion of `planar`. x and z are across the straight pipe, y along it.

    The pipe has the same stiffness in all directions and does not twist: damping of a bent pipe
    causes a couple about its axis, for which its torsional stiffness is assumed to be infinite. The
    joints' angles are those between neighbouring tangents, up to pi.

    Supports, and an end that is pinned or clamped, hold x and z of ends of segments at 0; the pipe
    slides along the axis. A guided or clamped end keeps the direction of the axis and lets the pipe
    turn about it, as a swivel does. A hinged root bends in all directions, but does not let the
    pipe turn about its own axis, like a universal joint of constant velocity. States have all 2 n
    coordinates. Those given must meet the supports to 1e-6 and are brought onto them.

    At rho = pi the coordinates are singular for motions across the plane. Segments that point
    backwards are therefore integrated, by methods of the core, with rotation vectors from the
    backward direction of the axis, and pass it without shorter steps. Results have the coordinates
    above: rho is at most pi for such a segment, and where it passes straight backwards the
    direction of its rotation vector turns quickly, so that a_x and a_z may jump from sample to
    sample. Positions do not jump: let events be functions of these. In a motion in the plane z = 0
    angles count the turns, as those of `planar` do. A segment with a `RotationalSpring`, whose
    energy has a kink at rho = pi, and methods of scipy take shorter and shorter steps there.

    Small motions of the straight pipe are those of `planar`, in two planes independently, so that
    questions about its stability are answered by `planar`. Where a load bends the pipe in the plane
    z = 0, or terms have other numbers across it, small motions in that plane and across it are
    uncoupled, too, and both are told.

    A jet at an angle leaves in the plane of the tangent and of that axis which is along x at the
    root and is carried along the pipe without twist. Its direction depends on the shape alone.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=10, dimensions=3)
        >>> motion = pp.simulate(chain, 6.0, 10.0)
        >>> motion.tip.shape
        (501, 3)

    Source: d'Alembert's principle for the velocities of a chain of inextensible, twist-free
    segments; see cpp/pipedyn/chain/space.hpp.
    """

    _planar: Chain

    @property
    def planar(self) -> Chain:
        """The chain that moves in the plane z = 0."""
        return self._planar

    @property
    def coordinate_kind(self) -> str:
        return f"rotation vectors of {self._planar.dof} segments"

    @cached_property
    def core(self) -> _core.SpatialChain:
        segments = core_segments(self._planar, spring=self._planar._own_joints)
        held = self._planar._held.tolist()
        pipe = core_pipe(self._pipe, self._applied, self._pipe.root_across)
        return _core.SpatialChain(pipe, segments, held)

    @property
    def _held_places(self) -> Array:
        return self._planar.stations[self._planar._held]

    @property
    def _ease(self) -> Array:
        return np.ones((self.coordinates, 1))

    def pencil(self) -> DensePencil:
        return DensePencil(self)

    def beyond_reach(self, x: Array) -> str:
        if (np.abs(np.abs(x) % (2.0 * math.pi) - math.pi) < FOLDED).any():
            return "a segment points straight backwards, where coordinates in space are singular"
        hinged = not self._pipe.root_stiffness
        joints = np.diff(x, prepend=[0.0][hinged:], append=[0.0] * self._pipe.end_guided)
        turned = float(np.abs(joints).max(initial=0.0))
        why = f"a joint turns by {turned:.6g} rad, and joints in space by less than pi"
        return why if turned > math.pi - FOLDED else ""

    def largest_angle(self, p: NDArray[Any]) -> float:
        return float(np.hypot(*np.abs(np.split(p, 2))).max())

    def _alike(self, y: Array, other: Array) -> Array:
        (at, _), (a, rates) = (
            of[: 4 * self._planar.coordinates].reshape(2, 2, -1) for of in (y, other)
        )
        rho = np.hypot(*a)
        unit = a / np.where(rho > 0.0, rho, 1.0)
        turns = 2.0 * np.pi * np.round((rho - (at * unit).sum(axis=0)) / (2.0 * np.pi))
        if not turns.any():
            return other
        share = 1.0 - turns / np.where(rho > 0.0, rho, 1.0)
        rates = share * rates + (1.0 - share) * (rates * unit).sum(axis=0) * unit
        moved = np.concatenate([share * a, rates]).ravel()
        return np.concatenate([moved, other[moved.size :]])

    def _segments_to(self, tangents: NDArray[Any], s: Array) -> NDArray[Any]:
        """Sums of the segments' vectors up to arc lengths s, (p, 3, k)."""
        planar = self._planar
        steps = planar.lengths[:, None, None] * tangents.transpose(1, 0, 2)
        return position_along(steps, planar.base, planar.lengths, s)

    def _centreline(self, q: ArrayLike, s: Array) -> Array:
        tangents, _ = rotations(self._coordinates(q)[:, None])
        line = self._segments_to(tangents, s)[..., 0]
        line[:, 1] += np.minimum(s, self._planar.base)
        return line

    def _free_ends(self, q: Array, qdot: Array) -> Array:
        lengths = self._planar._lengths_to_tip
        tangents, _ = rotations(q)
        found = np.concatenate(
            [np.einsum("j,cjk->ck", lengths, of) for of in (tangents, turning(q, qdot))]
        )
        found[1] += self._planar.base
        return found

    def _bending(self, q: Array) -> Array:
        tangents, _ = rotations(q)
        axis = np.broadcast_to([[[0.0]], [[1.0]], [[0.0]]], (3, 1, q.shape[1]))
        beyond = axis[:, : self._pipe.end_guided]
        every = np.concatenate([axis, tangents, beyond], axis=1)
        before, after = every[:, :-1], every[:, 1:]
        apart = np.linalg.norm(after - before, axis=0)
        angles = 2.0 * np.arctan2(apart, np.linalg.norm(after + before, axis=0))
        local = self._planar._relative_stiffness()[: len(angles), None]
        return np.asarray(self._planar._chain.joints[:, :1] * angles / local)

    def _places(self, p: Array, places: Array) -> Array:
        return self._segments_to(rotations(p)[0], places)

    def _places_by(self, p: Array, places: Array) -> Array:
        lengths = self._planar._displacing(places)[1]
        found = np.einsum("pj,dcjk->pcdjk", lengths, tangents_by(p))
        return found.reshape(places.size, 3, self.coordinates, p.shape[1])

    def _aside(self, rest: Array, p: NDArray[Any], s: Array, derivative: int) -> NDArray[Any]:
        return self._across._deflected(np.sinc(rest / np.pi)[:, None] * p, s, derivative)

    @property
    def _of_shapes_across(self) -> Any:
        return self._across

    @property
    def _angle_places(self) -> Array:
        return self._planar._middles

    def _from_angles(self, angles: Array) -> Array:
        return angles


def _first_eigenvalue(pipe: Pipe) -> float:
    """Square of the cantilever's first angular frequency, without flow, gravity and terms."""
    if pipe.stiffness is None and pipe.mass is None:
        return FIRST_BEAM_EIGENVALUE
    bare = Pipe(0.0, stiffness=pipe.stiffness, mass=pipe.mass)
    joints = basis_joints(bare).size
    mass = Galerkin(bare, 24 + 4 * joints, "legendre").elastic_operators().mass
    return float(1.0 / np.linalg.eigvalsh(mass)[-1])


def _segments_in(arrays: dict[str, Any], guided: bool) -> int:
    """Number of segments that the first given array is for."""
    for name, given in arrays.items():
        if given is not None:
            size = check.array(name, given, longest=LARGEST_CHAIN + 1).size
            return check.count(f"{name}'s segments", size - (guided and name == "springs"))
    raise ValueError("n or lengths must be given")


def _cells(n: int, base: float, supports: Sequence[float]) -> Array:
    """Lengths of n segments beyond the base, equal within each span and nearly equal overall."""
    if not supports:
        return np.full(n, (1.0 - base) / n)
    edges = np.array([base, *supports, 1.0])
    spans = np.diff(edges)
    if spans[0] <= 0.0:
        raise ValueError(f"base must end before the first support, {edges[1]:g}, got {base:g}")
    if n < spans.size:
        raise ValueError(
            f"n must be at least {spans.size}, a segment for each span between supports, got {n}"
        )
    counts = np.maximum(1, np.floor(n * spans / spans.sum() * (1.0 + 1e-12))).astype(int)
    while counts.sum() < n:
        counts[np.argmax(spans / counts)] += 1
    while counts.sum() > n:
        counts[np.argmin(np.where(counts > 1, spans / counts, np.inf))] -= 1
    return np.repeat(spans / counts, counts)


def _read_only(values: Array) -> Array:
    values.flags.writeable = False
    return values


def _segment_values(name: str, values: Any, default: Array, **rule: Any) -> Array:
    """One number >= 0 for each segment: the user's numbers, checked, or the default."""
    if values is None:
        return _read_only(default)
    return check.array(name, values, size=default.size, low=0.0, **rule)
