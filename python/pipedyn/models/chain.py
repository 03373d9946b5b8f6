# SPDX-License-Identifier: MIT
"""The chain: n rigid segments joined by torsional springs, and the rules that set the springs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.models.base import (
    Model,
    Operators,
    arc_lengths,
    core_pipe,
    operators_from,
    stored,
)
from pipedyn.models.pencil import ChainPencil, Pencil
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.power_iteration import largest_stretch

SPRING_RULES = ("consistent", "midpoint", "rayleigh", "uniform", "frequency")

FIRST_BEAM_EIGENVALUE = 1.8751040687119611664**4
"""Square of a cantilever's first angular frequency: root of cos(k) cosh(k) = -1, to the fourth."""

LARGEST_CHAIN = 1_000_000
"""Segments: their arrays take 8 MB each, a right-hand side some 0.03 s."""

SHORTEST_SEGMENT = 1e-7
"""Shorter segments, or a last one with less inertia, are lost in the rounding of the others."""


class Chain(Model):
    """A chain of n rigid segments, the lumped-parameter model of a pipe.

    Coordinates: the angles theta_j of the segments from the straight pipe, shape (n,), from the
    clamp to the free end. The terms of the pipe act where they are, anywhere along a segment; what
    acts at a place of the fixed base moves nothing. `rhs` takes O(n), `jacobian` O(n^2).

    Args:
        pipe: the pipe.
        n: number of segments; not needed where an array is given.
        springs: stiffness k_j of the joint at each segment's clamped side, in EI / L, shape (n,),
            each >= 0; or a rule:
            "consistent": 1 / k_j is the length that lies nearer to joint j than to any other, with
            all of the base at the first; n on n equal segments, but 2 n at the clamp. Second order.
            "midpoint": n equal cells with a joint in the middle of each, all springs n; half a
            cell stays fixed at the clamp and the last segment is half a cell. Second order.
            "uniform": all springs n. First order.
            "frequency": all equal, the chain's first frequency without flow, gravity and terms
            that of the cantilever. First order.
            "rayleigh" (the paper's): all equal; the Rayleigh quotient of the tip-load shape,
            sampled at the joints, that of the cantilever's first frequency. It does not converge
            to the continuous pipe: frequencies and critical speed end 1.44 % low.
        lengths: of the segments in L, shape (n,), each > 0; equal where not given.
        centers: centre of mass of each segment as a fraction chi_j of its length, shape (n,), in
            [0, 1]; 1/2 where not given.
        gyration_radii: eta_j in L, about the centre of mass, shape (n,), >= 0; l_j / sqrt(12),
            that of a homogeneous segment, where not given.
        drag_points: where drag acts, as a fraction xi_j of the length, shape (n,), in [0, 1]; 1/2
            where not given.
        base: length of the fixed part at the clamp, in L; base + sum(lengths) = 1.

    Raises:
        ValueError: for a number out of range, arrays that do not fit one another, lengths that do
            not add up, more than a million segments, or "midpoint" with lengths or a base.
        TypeError: for what is no number, array or pipe.

    Source: Orsino and Di Giulio, eqs. (1)-(11) and the modal analysis; "midpoint" after Paidoussis
    and Deksnis (1970).
    """

    def __init__(
        self,
        pipe: Pipe,
        n: int | None = None,
        *,
        springs: str | ArrayLike = "consistent",
        lengths: ArrayLike | None = None,
        centers: ArrayLike | None = None,
        gyration_radii: ArrayLike | None = None,
        drag_points: ArrayLike | None = None,
        base: float = 0.0,
    ) -> None:
        super().__init__(pipe)
        rule = check.choice("springs", springs, SPRING_RULES) if isinstance(springs, str) else None
        base = check.real("base", base, low=0.0, high=1.0, open_high=True)
        n = _segment_count(
            n,
            lengths=lengths,
            springs=None if rule else springs,
            centers=centers,
            gyration_radii=gyration_radii,
            drag_points=drag_points,
        )
        cells = np.full(n, (1.0 - base) / n)
        if rule == "midpoint":
            if lengths is not None or base != 0.0:
                raise ValueError(
                    "springs='midpoint' cuts the pipe itself: give neither lengths nor base"
                )
            base = 0.5 / n
            cells = np.full(n, 1.0 / n)
            cells[-1] = 0.5 / n
        self._lengths = _given("lengths", lengths, cells, open_low=True)
        total = base + float(self._lengths.sum())  # pairwise, which 1e-9 allows
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"base + sum(lengths) must be 1, got {total!r}")
        shortest = float(self._lengths.min())
        if shortest < SHORTEST_SEGMENT:
            raise ValueError(f"lengths must be at least {SHORTEST_SEGMENT:g} each, got {shortest}")
        self._base = base
        self._centers = _given("centers", centers, np.full(n, 0.5), high=1.0)
        self._drag_points = _given("drag_points", drag_points, np.full(n, 0.5), high=1.0)
        homogeneous = self._lengths / math.sqrt(12.0)
        self._gyration_radii = _given("gyration_radii", gyration_radii, homogeneous, high=1e3)
        arm = self._centers[-1] * self._lengths[-1] + self._gyration_radii[-1]
        if arm < 0.1 * SHORTEST_SEGMENT:
            raise ValueError(
                "centers and gyration_radii must not both be 0 at the last segment: "
                "it would turn without inertia"
            )
        self._rule = rule
        if rule is None:
            self._springs = check.array("springs", springs, size=n, low=0.0, high=1e15)
        else:
            self._springs = _frozen(self._springs_by_rule(rule))
        self._approximates = rule is not None and centers is None and gyration_radii is None

    def _springs_by_rule(self, rule: str) -> Array:
        n = self.dof
        if rule == "consistent":
            inner = np.concatenate([[2.0 * self._base], self._lengths[:-1]])
            return 2.0 / (inner + self._lengths)
        if rule in ("uniform", "midpoint"):
            return np.full(n, float(n))
        bare = self._with_springs(np.ones(n), replace(self._pipe, terms=()))

        def inertia(turns: Array) -> Array:
            """Product with the mass matrix in joint angles, O(n)."""
            return bare.joint_times(turns[:, None], square=1.0)[:, 0]

        if rule == "rayleigh":
            joints = self._base + np.concatenate([[0.0], np.cumsum(self._lengths)])
            joints[0] = 0.0  # a fixed part does not bend: the first angle is measured from the axis
            tip_load = joints**2 * (3.0 - joints)
            angles = np.diff(tip_load) / self._lengths
            turns = np.diff(angles, prepend=0.0)
            kinetic = turns @ inertia(turns)
            return np.full(n, FIRST_BEAM_EIGENVALUE * kinetic / (turns @ turns))
        # "frequency": with unit springs the largest inertia is 1 / omega_1^2.
        return np.full(n, FIRST_BEAM_EIGENVALUE * largest_stretch(inertia, np.ones(n)))

    def _with_springs(self, springs: Array, pipe: Pipe | None = None) -> _core.Chain:
        return _core.Chain(
            pipe=core_pipe(self._pipe if pipe is None else pipe),
            length=self._lengths,
            center=self._centers,
            gyration_radius=self._gyration_radii,
            spring=springs,
            drag_point=self._drag_points,
            base=self._base,
        )

    @cached_property
    def core(self) -> _core.Chain:
        """The compiled chain."""
        return self._with_springs(self._springs)

    def __repr__(self) -> str:
        rule = repr(self._rule) if self._rule else "array"
        return f"Chain({self._pipe!r}, n={self.dof}, springs={rule}{self._about_shown})"

    @property
    def dof(self) -> int:
        return self._lengths.size

    approximates_pipe = stored("_approximates", "Whether springs and inertia are not from arrays.")
    rule = stored("_rule", "Name of the spring rule, None for springs of the user's own.")
    base = stored("_base", "Length of the fixed part at the clamp.")
    lengths = stored("_lengths", "l_j, shape (n,).")
    springs = stored("_springs", "k_j, shape (n,).")
    centers = stored("_centers", "chi_j, shape (n,).")
    gyration_radii = stored("_gyration_radii", "eta_j, shape (n,).")
    drag_points = stored("_drag_points", "xi_j, shape (n,).")

    def pencil(self) -> Pencil:
        return ChainPencil(self) if self._reference is None else super().pencil()

    @cached_property
    def elastic_scale(self) -> Array:
        """Joint angle of one elastic coordinate, shape (n,)."""
        return _frozen(elastic_scale(self._springs))

    @property
    def elastic_share(self) -> Array:
        return self._springs * self.elastic_scale**2

    @property
    def linear_cost(self) -> bool:
        return self._reference is None

    @property
    def stations(self) -> Array:
        """Arc lengths of the nodes: polylines peak there."""
        return np.minimum(self._base + np.cumsum(self._lengths), 1.0)

    def elastic_operators(self) -> Operators:
        self._check_dense()
        if self._reference is not None:
            return self.operators().projected(np.cumsum(np.diag(self.elastic_scale), axis=0))
        return operators_from(self.core.joint_operators(self.elastic_scale), self._pipe)

    def from_elastic(self, z: ArrayLike) -> NDArray[Any]:
        joints = (self.elastic_scale * self._columns("z", z).T).T
        return np.cumsum(joints, axis=0, out=joints)

    def shape(self, q: ArrayLike, s: ArrayLike) -> Array:
        angles = self._coordinates(q)
        at = arc_lengths(s)
        line = along(self._lengths * np.exp(1j * angles), self._base, self._lengths, at)
        return np.stack([line.imag, line.real + np.minimum(at, self._base)], axis=-1)

    def _tips(self, q: NDArray[Any]) -> NDArray[Any]:
        down = self._base + self._lengths @ np.cos(q)
        return np.stack([self._lengths @ np.sin(q), down], axis=-1)

    @property
    def kinks_known(self) -> bool:
        return True

    def kinks(self, p: Array, pdot: Array) -> Array:
        """Besides, the velocities across the segments of the points at which drag acts."""
        of_terms = super().kinks(p, pdot)
        if self.pipe.drag == 0.0:
            return of_terms
        tangents = np.exp(1j * p)
        steps = self._lengths[:, None] * pdot * tangents
        joints = np.cumsum(steps, axis=0) - steps  # velocities where the segments begin
        reach = (self._drag_points * self._lengths)[:, None]
        return np.concatenate([of_terms, (joints * tangents.conj()).real + reach * pdot])

    def _across(self, p: Array, s: Array) -> Array:
        steps = self._lengths[:, None] * np.sin(p)
        return np.asarray(along(steps, self._base, self._lengths, s))

    def bent(self, angle: Callable[[Array], ArrayLike]) -> Array:
        ends = self._base + np.cumsum(self._lengths)
        return self._angles(angle, ends - 0.5 * self._lengths)

    def deflection(self, q: ArrayLike, s: ArrayLike, derivative: int = 0) -> NDArray[Any]:
        at, order = arc_lengths(s), check.count("derivative", derivative, low=0, high=1)
        across = self._lengths if order else self._lengths * np.cos(self.resting())
        steps = (across * self._displaced(q, at.size).T).T
        return along(steps, self._base, self._lengths, at, order)


def along(
    steps: NDArray[Any], base: float, lengths: Array, s: Array, derivative: int = 0
) -> NDArray[Any]:
    """Sum of the segments' steps (n, ...) up to s, linear within a segment, 0 in the base.

    Or its derivative, the mean of both where segments meet.
    """
    ends = base + np.concatenate([[0.0], np.cumsum(lengths)])
    if derivative == 1:
        slopes = np.concatenate([0.0 * steps[:1], (steps.T / lengths).T])
        sides = (np.searchsorted(ends, s, side=side) for side in ("left", "right"))
        before, after = (slopes[np.minimum(side, lengths.size)] for side in sides)
        return np.asarray(0.5 * (before + after))
    nodes = np.concatenate([np.zeros_like(steps[:1]), np.cumsum(steps, axis=0)])
    j = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, lengths.size - 1)
    part = np.clip((s - ends[j]) / lengths[j], 0.0, 1.0)
    return nodes[j] + (part * steps[j].T).T


def elastic_scale(springs: Array) -> Array:
    """Joint angle of one elastic coordinate, shape (n,): 1 / sqrt(k_j).

    A joint with no spring, or one far below the mean, takes a scale from the mean instead.
    """
    mean = float(springs.mean())
    floor = 1e-3 * mean if mean > 1e-100 else float(springs.size)  # squares of the scale are taken
    return 1.0 / np.sqrt(np.maximum(springs, floor))


def _segment_count(n: int | None, **arrays: Any) -> int:
    if n is not None:
        return check.count("n", n, high=LARGEST_CHAIN)
    for name, given in arrays.items():
        if given is not None:
            return check.array(name, given, longest=LARGEST_CHAIN).size
    raise ValueError("n or lengths must be given")


def _frozen(values: Array) -> Array:
    values.flags.writeable = False
    return values


def _given(name: str, values: Any, default: Array, **rule: Any) -> Array:
    """Numbers of each segment, >= 0: the user's, checked, or the default."""
    if values is None:
        return _frozen(default)
    return check.array(name, values, size=default.size, low=0.0, **rule)
