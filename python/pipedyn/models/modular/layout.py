# SPDX-License-Identifier: MIT
"""How the parts of a scene fit one another: what is checked once, when a scene is made."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipedyn import _core
from pipedyn.models.base import core_pipe
from pipedyn.models.modular.custom import inertia_rows
from pipedyn.models.modular.linearisation import DEPENDENT, independent
from pipedyn.models.modular.parts import (
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
    described,
)
from pipedyn.models.pipe import Pipe
from pipedyn.util.check import Array
from pipedyn.util.newton import NewtonFailed, newton

KINDS: dict[type[Constraint], int] = {Clamp: 0, Joint: 1, Guide: 2, Pin: 3}
"""Numbers of the constraints in the core."""

MODULES = (Segment, TorsionalSpring, InternalFlow, Drag, Custom)
"""Modules that there are."""

SAME = 1e-12
"""Places that differ by less are one, and guides and pins are met: rounding leaves some 1e-15."""

TAUT = 1e-5
"""Guides and pins that depend on one another to this, but only on a straight span, hold it taut.

Newton's method meets them to 1e-12, which leaves angles of some 1e-6 on a span without slack.
"""

P = TypeVar("P", bound=Part)


@dataclass(frozen=True)
class Held:
    """A redundant coordinate that a guide or pin holds.

    Attributes:
        coordinate: its index in q.
        value: where it is held.
        part: by what.
    """

    coordinate: int
    value: float
    part: Constraint


class Layout:
    """Modules and constraints in the order of their places, and a configuration that fits them all.

    Args:
        modules, constraints: the parts.

    Raises:
        ValueError: if they do not fit one another.
    """

    def __init__(self, modules: Sequence[Module], constraints: Sequence[Constraint]) -> None:
        self.modules, self.constraints = tuple(modules), tuple(constraints)
        self.segments = _of(modules, Segment)
        self.customs = _of(modules, Custom)
        self.size = len(self.segments)
        if self.size == 0:
            raise ValueError("modules must hold at least one Segment, got none")
        self._check_places()
        self.base = self._checked_base()
        self.lengths = np.array([segment.length for segment in self.segments])
        total = self.base + math.fsum(self.lengths)
        if abs(total - 1.0) > 1e-9:
            raise ValueError(f"the base and the segments' lengths must add up to 1, got {total!r}")
        self.ends = self.base + np.concatenate([[0.0], np.cumsum(self.lengths)])
        self.springs = np.zeros(self.size)
        for spring in _of(modules, TorsionalSpring):
            self.springs[spring.joint - 1] += spring.stiffness
        for array in (self.lengths, self.ends, self.springs):
            array.flags.writeable = False
        self.has_flow = bool(_of(modules, InternalFlow))
        self.held = self._found_held()
        self.nodes = np.array([c.coordinate // 3 for c in self.held], dtype=np.intp)
        self.axes = np.array([c.coordinate % 3 for c in self.held], dtype=np.intp)
        self.wanted = np.array([c.value for c in self.held])
        self.rest = self._found_rest()
        self.independent = self._independent(self.rest, DEPENDENT)
        self._refuse_taut()
        if self.independent.size == self.size:
            raise ValueError(
                f"{self.described_holds()} must leave something that moves, got nothing"
            )
        self.independent_rows = self._found_rows()

    # -------------------------------------------------------------------------------- what is where

    def _check_places(self) -> None:
        n = self.size
        for part in (*self.modules, *self.constraints):
            for name in ("node", "joint", "segment"):
                place = getattr(part, name, 1)
                if place > n:
                    raise ValueError(
                        f"{described(part)}: {name} must be at most {n}, the number of segments"
                    )
            if isinstance(part, Custom):
                for name in ("nodes", "joints"):
                    beyond = [place for place in getattr(part, name) if place > n]
                    if beyond:
                        raise ValueError(
                            f"{part.name}: {name} must be at most {n}, the number of segments, "
                            f"got {beyond[0]}"
                        )
        for kind in (InternalFlow, Drag):
            count = len(_of(self.modules, kind))
            if count > 1:
                raise ValueError(f"modules must hold at most one {kind.__name__}, got {count}")
        if not _of(self.constraints, Clamp):
            raise ValueError(
                "constraints must hold a Clamp: without it phi_1 moves without inertia"
            )
        held = {joint.segment for joint in _of(self.constraints, Joint)}
        loose = [j for j in range(2, n + 1) if j not in held]
        if loose:
            j = loose[0]
            raise ValueError(
                f"constraints must hold Joint(segment={j}): without it phi_{j} moves without "
                "inertia"
            )

    def _checked_base(self) -> float:
        bases = [clamp.base for clamp in _of(self.constraints, Clamp)]
        if max(bases) - min(bases) > SAME:
            raise ValueError(
                "constraints contradict one another: "
                + " and ".join(described(clamp) for clamp in _of(self.constraints, Clamp))
            )
        return bases[0]

    def _found_held(self) -> tuple[Held, ...]:
        """What guides and pins hold, each coordinate once."""
        found: dict[int, Held] = {}
        for part in self.constraints:
            held: list[tuple[int, float]] = []
            if isinstance(part, Guide):
                held = [(3 * part.node - 3, 0.0)]
            elif isinstance(part, Pin):
                held = [(3 * part.node - 3, part.x), (3 * part.node - 2, part.y)]
            for coordinate, value in held:
                other = found.setdefault(coordinate, Held(coordinate, value, part))
                if abs(other.value - value) > SAME:
                    raise ValueError(
                        f"constraints contradict one another: {described(other.part)} and "
                        f"{described(part)}"
                    )
        return tuple(found.values())

    def _found_rows(self) -> NDArray[np.bool_]:
        """Which rows of the core's constraints to take, so that none depends on the others."""
        taken = {self.held[i].coordinate for i in self.independent}
        rows: list[bool] = []
        seen: set[Any] = set()
        for part in self.constraints:
            if isinstance(part, Clamp | Joint):
                place = 1 if isinstance(part, Clamp) else part.segment
                rows += 2 * [("segment", place) not in seen]
                seen.add(("segment", place))
                continue
            assert isinstance(part, Guide | Pin)
            first = 3 * part.node - 3
            for coordinate in range(first, first + (1 if isinstance(part, Guide) else 2)):
                rows.append(coordinate in taken and coordinate not in seen)
                seen.add(coordinate)
        return np.array(rows)

    def coordinate(self, index: int) -> str:
        """A redundant coordinate by name."""
        j, axis = divmod(index, 3)
        return f"phi_{j + 1}" if axis == 2 else f"node {j + 1} along {'xy'[axis]}"

    @property
    def guides_and_pins(self) -> list[Constraint]:
        """Those that hold something, each once."""
        return list(dict.fromkeys(held.part for held in self.held))

    def described_holds(self) -> str:
        """The guides and pins in a message."""
        return ", ".join(described(part) for part in self.guides_and_pins)

    # ------------------------------------------------------------------------------- configurations

    def missed(self, theta: Array) -> Array:
        """How far guides and pins are missed at angles (n,), shape (c,); at (n, k), (c, k)."""
        places = np.cumsum(
            np.stack([np.sin(theta).T, np.cos(theta).T]) * self.lengths, axis=-1
        )  # (2, k?, n)
        places[1] += self.base
        found: Array = (
            np.stack([places[a, ..., j] for j, a in zip(self.nodes, self.axes, strict=True)])
            if self.held
            else np.zeros((0, *theta.shape[1:]))
        )
        missed: Array = found - self.wanted.reshape(-1, *(1,) * (theta.ndim - 1))
        return missed

    def rows(self, theta: Array) -> Array:
        """Derivative of `missed` by the angles, shape (c, n)."""
        by_angle = np.stack([np.cos(theta), -np.sin(theta)]) * self.lengths
        reached = np.arange(self.size) <= self.nodes[:, None]
        rows: Array = by_angle[self.axes] * reached
        return rows

    def closed(self, theta: Array, steps: int = 100) -> tuple[Array, float]:
        """Angles close to those given that meet guides and pins, and how far they still miss.

        Where Newton's method fails, between segments in line with a pin, it starts again from
        between there and a configuration that is known.
        """
        if not self.held:
            return theta, 0.0
        best, least = self._newton(theta, steps)
        for share in (0.25, 0.5, 0.75, 1.0):
            if least <= SAME:
                break
            other, miss = self._newton(theta + share * (self.rest - theta), steps)
            if miss < least:
                best, least = other, miss
        return best, least

    def _newton(self, theta: Array, steps: int) -> tuple[Array, float]:
        """Newton's method by least turns, and how far its best angles miss."""
        best, least = theta, math.inf

        def correction(theta: Array) -> tuple[Array, float]:
            nonlocal best, least
            missed = self.missed(theta)
            far = float(np.abs(missed).max())
            if far < least:
                best, least = theta, far
            if not far > 1e-14:
                return np.zeros_like(theta), 0.0
            turn = -np.linalg.pinv(self.rows(theta), rcond=1e-12) @ missed
            return turn, float(np.abs(turn).max())

        with suppress(NewtonFailed):  # the best may be near enough
            newton(theta, correction, tolerance=0.0, longest=0.5, iterations=steps)
        return best, least

    def _found_rest(self) -> Array:
        """Angles that meet all constraints: the straight pipe where it does."""
        if not self.held:
            return np.zeros(self.size)
        s = 0.5 * (self.ends[:-1] + self.ends[1:])
        wave = [np.sin(math.pi * k * s) for k in (1, 2, 3)]
        starts: list[Callable[[], Array]] = [
            lambda: np.zeros(self.size),
            lambda: 0.7 * wave[1] + 0.2 * wave[0],
            lambda: -0.7 * wave[1] - 0.2 * wave[0],
            lambda: wave[0],
            lambda: -wave[0],
            lambda: 1.5 * wave[1] + wave[2],
        ]
        best, least = np.zeros(self.size), math.inf
        for start in starts:
            theta, missed = self._newton(start(), 200)
            if missed < least:
                best, least = theta, missed
            if least <= SAME:
                return best
        far = np.abs(self.missed(best))
        worst = dict.fromkeys(
            held.part for held, miss in zip(self.held, far, strict=True) if miss > 0.01 * far.max()
        )
        named = " and ".join(described(part) for part in worst)
        raise ValueError(
            f"constraints contradict the pipe's length or one another: {named} cannot be met, "
            f"the closest found misses by {least:.2g}"
        )

    def _independent(self, theta: Array, tolerance: float) -> NDArray[np.intp]:
        """Which held coordinates depend on none of the others at some angles."""
        return independent(self.rows(theta).T / self.lengths[:, None] ** 0.5, tolerance)

    def _refuse_taut(self) -> None:
        """A span that is pulled straight has no neighbours: constraints lose their rank there."""
        if not self.held:
            return
        bent = self.rest + 0.3 * np.cos(1.0 + 1.7 * np.arange(self.size))
        here = self._independent(self.rest, TAUT)
        if here.size < self._independent(bent, TAUT).size:
            lost = [c for i, c in enumerate(self.held) if i not in here]
            named = " and ".join(dict.fromkeys(described(c.part) for c in lost))
            raise ValueError(f"{named} must leave some slack, got a span that is taut")

    # ------------------------------------------------------------------------------------- the core

    def compiled(self, pipe: Pipe) -> _core.Scene:
        """The scene as the core takes it, on a pipe."""
        springs = _of(self.modules, TorsionalSpring)
        damping = [
            pipe.damping * spring.stiffness if spring.damping is None else spring.damping
            for spring in springs
        ]
        factors = [(custom.index, row) for custom in self.customs for row in inertia_rows(custom)]
        entries = [
            (i, index[c], row[c])
            for i, (index, row) in enumerate(factors)
            for c in np.flatnonzero(row)
        ]
        rows = np.array(entries, dtype=np.float64).reshape(-1, 3)
        return _core.Scene(
            pipe=core_pipe(pipe),
            length=self.lengths,
            center=_numbers(s.center for s in self.segments),
            gyration_radius=_numbers(s.gyration_radius or 0.0 for s in self.segments),
            drag_point=_numbers(s.drag_point for s in self.segments),
            base=self.base,
            spring_joint=_places(s.joint for s in springs),
            spring_stiffness=_numbers(s.stiffness for s in springs),
            spring_damping=_numbers(damping),
            spring_rest=_numbers(s.rest_angle for s in springs),
            flow=self.has_flow,
            drag=bool(_of(self.modules, Drag)),
            constraint_kind=_places(KINDS[type(c)] for c in self.constraints),
            constraint_node=_places(
                getattr(c, "node", getattr(c, "segment", 1)) for c in self.constraints
            ),
            constraint_x=_numbers(getattr(c, "x", 0.0) for c in self.constraints),
            constraint_y=_numbers(getattr(c, "y", 0.0) for c in self.constraints),
            inertia_row=rows[:, 0].astype(np.int64),
            inertia_coordinate=rows[:, 1].astype(np.int64),
            inertia_weight=rows[:, 2],
        )


def _of(parts: Iterable[Part], kind: type[P]) -> list[P]:
    return [part for part in parts if isinstance(part, kind)]


def _numbers(values: Iterable[float]) -> Array:
    return np.array(list(values), dtype=np.float64)


def _places(values: Iterable[int]) -> NDArray[np.int64]:
    return np.array(list(values), dtype=np.int64)
