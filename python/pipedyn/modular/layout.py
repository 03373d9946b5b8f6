# SPDX-License-Identifier: MIT
"""The layout of a scene: its parts in order, which are checked when the scene is made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import core_pipe
from pipedyn.models.pipe import Pipe
from pipedyn.models.segments import SAME, closest, core_segments, held_ends
from pipedyn.modular.parts import (
    Clamp,
    Constraint,
    Custom,
    Drag,
    Guide,
    InternalFlow,
    Joint,
    Module,
    Part,
    Pin,
    Segment,
    TorsionalSpring,
    part_text,
)
from pipedyn.util.check import Array

CONSTRAINTS = (Clamp, Joint, Guide, Pin)
"""Kinds of constraints."""

MODULES = (Segment, TorsionalSpring, InternalFlow, Drag, Custom)
"""Kinds of modules."""

DEPENDENT = 1e-9
"""Relative size of a pivot, well above rounding, below which a guide or pin is dependent."""

LEAST_PIVOT = 1e-5
"""Relative size of a pivot below which guides and pins are dependent because a span is taut.

Newton's method meets them to 1e-12, which leaves angles of some 1e-6 on a span without slack.
"""

P = TypeVar("P", bound=Part)


class Layout:
    """Modules and constraints in the order of their places, and a configuration that meets them.

    The root's spring, the supports and a held end come from the pipe.

    Args:
        modules, constraints: parts of the scene.
        pipe: the pipe of the scene.

    Raises:
        ValueError: if the parts do not fit one another or the supports of the pipe.
    """

    def __init__(
        self, modules: Sequence[Module], constraints: Sequence[Constraint], pipe: Pipe
    ) -> None:
        self.modules, self.constraints = tuple(modules), tuple(constraints)
        self.given, self.guided = self.constraints, pipe.end_guided
        """Constraints without those of the pipe's supports; whether there is a joint n + 1."""
        self.segments = segments = _of_kind(modules, Segment)
        self.customs = _of_kind(modules, Custom)
        self.size = len(segments)
        if self.size == 0:
            raise ValueError("modules must hold at least one Segment, got none")
        self._check_places()
        self.base = self._checked_base()
        self.lengths = np.array([segment.length for segment in segments])
        total = self.base + math.fsum(self.lengths)
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"the base and the segments' lengths must add up to 1, got {total!r}")
        self.ends = self.base + np.concatenate([[0.0], np.cumsum(self.lengths)])
        self.constraints += self._supports(pipe)
        self.centres = np.array([segment.centre for segment in segments])
        self.gyration_radii = np.array([segment.gyration_radius for segment in segments])
        self.drag_points = np.array([segment.drag_point for segment in segments])
        self.masses = np.array([s.length if s.mass is None else s.mass for s in segments])
        self.springs, self.rest_moments = np.zeros(self.size + self.guided), np.zeros(self.size)
        """Stiffness k_j of each joint, without a root's spring, and moment k_j psi_j at angle 0."""
        for spring in _of_kind(modules, TorsionalSpring):
            self.springs[spring.joint - 1] += spring.stiffness
            if spring.joint <= self.size:
                self.rest_moments[spring.joint - 1] += spring.stiffness * spring.rest_angle
            elif spring.rest_angle != 0.0:
                raise ValueError(f"{part_text(spring)}: rest_angle of a guided end must be 0")
        for array in (self.lengths, self.ends, self.springs):
            array.flags.writeable = False
        self.has_flow = bool(_of_kind(modules, InternalFlow))
        self.has_drag = bool(_of_kind(modules, Drag))
        rows = [custom._inertia_rows(3 * self.size) for custom in self.customs]
        self.inertia = np.concatenate([np.zeros((0, 3 * self.size)), *rows])
        """Rows W of the inertia of custom modules, (m, 3 n): the mass matrix in redundant
        coordinates is that of the segments and W^T W."""
        holding = self._found_holding()
        self.held = np.array(list(holding), dtype=np.intp)
        """Redundant coordinates that guides and pins hold, shape (c,)."""
        self.held_values = np.array([value for value, _ in holding.values()])
        self.holding = [part for _, part in holding.values()]
        """The guide or pin that holds each of these coordinates."""
        self.unit_loads = np.zeros((3 * self.size, self.held.size))
        self.unit_loads[self.held, np.arange(self.held.size)] = 1.0
        self.rest = self._found_rest()
        self.independent = self._independent(self.rest, DEPENDENT)
        self._refuse_taut()
        if self.independent.size == self.size:
            raise ValueError(f"{self.guides_text()} must leave something that moves, got nothing")

    # -------------------------------------------------------------------------------- what is where

    def _check_places(self) -> None:
        """Raises ValueError for parts at places that do not exist, and for missing parts."""
        n = self.size
        for part in (*self.modules, *self.constraints):
            for name in ("node", "joint", "segment", "nodes", "joints"):
                given, most = getattr(part, name, ()), n + (self.guided and name == "joint")
                beyond = [p for p in (given if isinstance(given, tuple) else (given,)) if p > most]
                if beyond:
                    raise ValueError(
                        f"{part_text(part)}: {name} must be at most {most}, the number of "
                        f"{'joints' if most > n else 'segments'}, got {beyond[0]}"
                    )
        if self.guided and n + 1 not in [s.joint for s in _of_kind(self.modules, TorsionalSpring)]:
            raise ValueError(
                f"modules must hold a TorsionalSpring(joint={n + 1}), between segment {n} and the "
                "end that keeps its direction"
            )
        for kind in (InternalFlow, Drag):
            count = len(_of_kind(self.modules, kind))
            if count > 1:
                raise ValueError(f"modules must hold at most one {kind.__name__}, got {count}")
        tied = {getattr(part, "segment", 1) for part in _of_kind(self.constraints, (Clamp, Joint))}
        if loose := [j for j in range(1, n + 1) if j not in tied]:
            lacking = "a Clamp" if loose[0] == 1 else f"Joint(segment={loose[0]})"
            raise ValueError(
                f"constraints must hold {lacking}: without it phi_{loose[0]} moves without inertia"
            )

    def _checked_base(self) -> float:
        """Length of the fixed part of the pipe; ValueError if clamps give different lengths."""
        clamps = _of_kind(self.constraints, Clamp)
        bases = [clamp.base for clamp in clamps]
        if max(bases) - min(bases) > SAME:
            named = " and ".join(map(part_text, clamps))
            raise ValueError(f"constraints contradict one another: {named}")
        return bases[0]

    def _supports(self, pipe: Pipe) -> tuple[Constraint, ...]:
        """The guides that hold the pipe at its supports and at its end."""
        if self.base > 0.0 and pipe.root != "clamped":
            raise ValueError(
                f"base of Clamp must be 0 unless the root is clamped, got {self.base:g} with "
                f"{pipe!r}"
            )
        return tuple(Guide(node) for node in (held_ends(pipe, self.ends[1:]) + 1).tolist())

    def _found_holding(self) -> dict[int, tuple[float, Constraint]]:
        """Held redundant coordinates, each with its value and the first part that holds it."""
        found: dict[int, tuple[float, Constraint]] = {}
        for part in self.constraints:
            for coordinate, value in _held_by(part):
                other, first = found.setdefault(coordinate, (value, part))
                if abs(other - value) > SAME:
                    raise ValueError(
                        f"constraints contradict one another: {part_text(first)} and "
                        f"{part_text(part)}"
                    )
        return found

    @property
    def guides_and_pins(self) -> list[Constraint]:
        """Guides and pins, each once; duplicates that hold the same coordinates are left out."""
        return list(dict.fromkeys(self.holding))

    def guides_text(self) -> str:
        """List of the guides and pins as text for messages."""
        return ", ".join(part_text(part) for part in self.guides_and_pins)

    # ------------------------------------------------------------------------------- configurations

    def worst_met(self, given: Array, exact: Array, order: int = 0) -> tuple[float, Constraint]:
        """Largest deviation of coordinates, or rates, from a constraint, and that constraint.

        Args:
            given: the coordinates or rates, shape (3 n,).
            exact: coordinates or rates that follow from the same angles of the joints, so that they
                meet clamp and joints.
            order: 0 for coordinates, 1 for rates.
        """
        torn = np.diff((given - exact).reshape(self.size, 3)[:, :2], axis=0, prepend=0.0)
        missed = np.abs(exact[self.held] - (0.0 if order else self.held_values))
        ties = _of_kind(self.constraints, (Clamp, Joint))
        gaps = [float(np.abs(torn[getattr(part, "segment", 1) - 1]).max()) for part in ties]
        every = zip([*missed.tolist(), *gaps], [*self.holding, *ties], strict=True)
        return max(every, key=itemgetter(0))

    def moments(self, theta: Array, forces: Array) -> Array:
        """Moments on the segments, shape (n, r), by forces on the coordinates, shape (3 n, r).

        The angles have shape (n,), or (n, r) if each column of forces has its own angles.
        """
        columns = theta.reshape(self.size, -1)
        across, along = (self.lengths[:, None] * of(columns) for of in (np.cos, np.sin))
        beyond_x, beyond_y = (np.cumsum(forces[k::3][::-1], axis=0)[::-1] for k in (0, 1))
        moments: Array = across * beyond_x - along * beyond_y + forces[2::3]
        moments[:-1] -= forces[5::3]
        return moments

    def nodes_by_angles(self, steps: NDArray[np.complex128]) -> Array:
        """Changes of the coordinates by n numbers, (3 n, n); 0 for the angles of the joints.

        Number j changes the vector dy + i dx of segment j by steps_j, of steps (n,), and moves all
        nodes from its end on.
        """
        found, moved = np.zeros((3 * self.size, self.size)), np.tri(self.size) * steps
        found[::3], found[1::3] = moved.imag, moved.real
        return found

    def rows(self, theta: Array) -> Array:
        """Derivative of the held coordinates by the segments' angles, transposed: shape (n, c)."""
        return self.moments(theta, self.unit_loads)

    def _found_rest(self) -> Array:
        """Angles that meet all constraints: those of the straight pipe if it meets them."""
        straight = np.zeros(self.size)
        if not self.holding:
            return straight
        s = 0.5 * (self.ends[:-1] + self.ends[1:])
        first, second, third = (np.sin(math.pi * k * s) for k in (1, 2, 3))
        two_turns = 0.7 * second + 0.2 * first
        core = self.compiled(Pipe(0.0, end="guided" if self.guided else "free"))
        best, least = closest(
            core, (straight, two_turns, -two_turns, first, -first, 1.5 * second + third)
        )
        if least <= SAME:
            return best
        missed = np.abs(core.redundant(np.append(best, straight))[self.held] - self.held_values)
        worst = {part for part, by in zip(self.holding, missed, strict=True) if by > 0.01 * least}
        named = " and ".join(part_text(part) for part in self.constraints if part in worst)
        raise ValueError(
            f"constraints contradict the pipe's length or one another: {named} cannot be met, "
            f"the closest found misses by {least:.2g}"
        )

    def _independent(self, theta: Array, tolerance: float) -> NDArray[np.intp]:
        """Indices of held coordinates that do not depend on the others at angles theta."""
        if not self.holding:
            return np.zeros(0, dtype=np.intp)
        columns = self.rows(theta) / self.lengths[:, None] ** 0.5
        _, r, order = scipy.linalg.qr(columns, mode="economic", pivoting=True)
        size = np.abs(np.diag(r))
        rank = int(np.sum(size > tolerance * max(float(size[0]), 1e-300)))
        return np.sort(order[:rank]).astype(np.intp)

    def _refuse_taut(self) -> None:
        """Raises ValueError for a span pulled straight, for which the constraints lose rank."""
        if not self.holding:
            return
        bent = self.rest + 0.3 * np.cos(1.0 + 1.7 * np.arange(self.size))
        here = self._independent(self.rest, LEAST_PIVOT)
        if here.size < self._independent(bent, LEAST_PIVOT).size:
            lost = [part for i, part in enumerate(self.holding) if i not in here]
            named = " and ".join(dict.fromkeys(map(part_text, lost)))
            raise ValueError(f"{named} must leave some slack, got a span that is taut")

    # ------------------------------------------------------------------------------------- the core

    def acting(self, pipe: Pipe) -> Pipe:
        """The pipe, without flow or drag if the scene has no module for it."""
        flow: dict[str, Any] = {} if self.has_flow else {"beta": 0.0, "alpha": 0.0}
        return replace(pipe, **flow, drag=pipe.drag if self.has_drag else 0.0)

    def joint_damping(self, pipe: Pipe) -> Array:
        """Damping c_j of each joint, without a root's spring."""
        damping = np.zeros(self.springs.size)
        for s in _of_kind(self.modules, TorsionalSpring):
            damping[s.joint - 1] += pipe.damping * s.stiffness if s.damping is None else s.damping
        return damping

    def compiled(self, pipe: Pipe, customs: Any = None, applied: Sequence[Any] = ()) -> _core.Scene:
        """The compiled scene on a pipe, with the forces of custom modules and applied forces."""
        return _core.Scene(
            core_pipe(self.acting(pipe), applied),
            core_segments(
                self,
                spring=self.springs,
                damping=self.joint_damping(pipe),
                rest_moment=self.rest_moments,
            ),
            held=self.held.tolist(),
            value=self.held_values,
            inertia=self.inertia,
            customs=customs,
        )


def _of_kind(parts: Iterable[Part], kind: type[P] | tuple[type[P], ...]) -> list[P]:
    """The parts of one kind or of several kinds."""
    return [part for part in parts if isinstance(part, kind)]


def _held_by(part: Constraint) -> list[tuple[int, float]]:
    """Redundant coordinates that a guide or pin holds, with their values; else an empty list."""
    if isinstance(part, Guide):
        return [(3 * part.node - 3, 0.0)]
    return (
        [(3 * part.node - 3, part.x), (3 * part.node - 2, part.y)] if isinstance(part, Pin) else []
    )
