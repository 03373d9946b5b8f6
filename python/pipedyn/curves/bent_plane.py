# SPDX-License-Identifier: MIT
"""Matrices of small motions about a bent rest over two numbers of a pipe, and where it rests.

The rest is that to which the pipe comes as its loads, and then the flow, grow from zero. Points of
the plane are (x, y, *q) with the coordinates q at rest: the equilibria of all numbers (x, y) are a
surface, on which curves of flutter and of divergence lie. Its folds, where the rest turns back, are
curves of divergence. On other sheets beyond them lie equilibria to which the pipe does not come.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy

from pipedyn.linear.bent_crossings import SearchOfRest
from pipedyn.linear.plane import ON_EDGE, Matrices, Plane, times
from pipedyn.linear.rest import SAME_REST, BranchOfRest, lost_rest
from pipedyn.linear.sensitivity import Crossing
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged

SURFACE_STEP = 1e-6
"""Step of differences along the surface of equilibria, in rad and in shares of the window. Their
errors of some 1e-6 slow Newton's method down, but do not move the solutions."""

RESTING = 1e-10
"""Distance from the surface of equilibria below which the matrices do not change by rounding."""

SAME_SHEET = 1e-3
"""Largest distance, in rad, of a rest from that which follows the flow. At a fold the latter is
known to the square root of the error of the fold."""

BESIDE = 1e-3
"""Distance from a fold, in rad, at which the curvature of the surface of equilibria is found."""

KEPT = 64
"""Number of pipes whose rests are kept, which are asked for several times in a row."""


class BentPlane(Plane):
    """Matrices of motions in the plane of rest, or across it, over a window of two numbers.

    The arguments are those of `Plane`; `planes` has both kinds of motion.
    """

    exact, across, conservative = False, False, False

    def _prepare(self) -> None:
        planar = self.model.planar
        self.dof, self.rest_size = planar.dof, planar.integrated
        self.scale = np.asarray(planar.from_elastic(np.eye(self.dof)), dtype=np.float64)
        self._rests = dict[tuple[float, ...], BranchOfRest]()
        self._followed = dict[tuple[float, ...], tuple[Array, str, float]]()
        self._planes: tuple[BentPlane, ...] = (self,)
        if self.model.dimensions == 3:
            other = copy.copy(self)
            other.across = True
            self._planes = other._planes = self, other

    @property
    def planes(self) -> tuple[BentPlane, ...]:
        """Planes of motions in the plane of rest and, in three dimensions, across it."""
        return self._planes

    @cached_property
    def _allowed(self) -> list[tuple[float, float]]:
        """Ranges of the two numbers, with room for rounding, or without ends that are excluded."""
        found = []
        for number, size in zip(self.window.numbers, self.window.size.tolist(), strict=True):
            rule, room = {} if number is None else number.rule, ON_EDGE * size
            low, high = rule.get("low", -math.inf), rule.get("high", math.inf)
            low += room if rule.get("open_low") else -room
            found.append((low, high - room if rule.get("open_high") else high + room))
        return found

    # ----------------------------------------------------------------------------- where it rests

    def rests(self, at: Array) -> BranchOfRest:
        """Equations of rest of the pipe with the numbers (x, y)."""
        key = tuple(v for i, v in enumerate(at[:2].tolist()) if i != self.speed_index)
        if key not in self._rests:
            if len(self._rests) >= KEPT:
                self._rests.pop(next(iter(self._rests)))
            self._rests[key] = BranchOfRest(self.model_at(at[:2]))
        return self._rests[key]

    def _to_rest(self, at: Array) -> tuple[Array, str, float]:
        """The followed rest at (x, y), or where it ends; why it ends, and the speed there."""
        key = tuple(at[:2].tolist())
        if key not in self._followed:
            try:
                last, reason = self.rests(at).towards(abs(self.speed_at(at)))
                reason = self.model.beyond_reach(last.x) or reason
                self._followed[key] = last.x, reason, last.p
            except NotConverged as error:  # there is no rest without flow
                self._followed[key] = np.full(self.rest_size, np.nan), str(error), 0.0
        return self._followed[key]

    def nearest_rest(self, at: Array) -> Array:
        """Coordinates of the rest at (x, y), or of that at which it turns back before."""
        return self._to_rest(at)[0]

    def follows(self, at: Array) -> bool:
        """Whether the rest at (x, y, *q) is that to which the pipe comes."""
        rest, reason, u = self._to_rest(at)
        near = reason == "range" or abs(u - self.speed_at(at)) <= SAME_REST * (1.0 + u)
        return near and float(np.abs(rest - at[2:]).max()) <= SAME_SHEET

    def settled(self, at: Array) -> Array:
        """The point (x, y, *q) with the rest that follows the flow, if q is not given.

        Raises:
            NotConverged: if that rest does not reach the flow speed.
        """
        if at.size > 2:
            return at
        rest, reason, u = self._to_rest(at)
        if reason != "range":
            raise NotConverged(lost_rest(reason, u, self.speed_at(at)))
        return np.append(at, rest)

    def varied(self, at: Array) -> tuple[Array, Matrices, list[Matrices], Array, Array]:
        """Matrices at (x, y, *q), with their derivatives along the surface of equilibria."""
        balance, by = self._balance(at)
        # Directions along the surface of equilibria, and that of the least step onto it.
        own, _ = scipy.linalg.qr(by.T)
        onto, *_ = np.linalg.lstsq(by, balance)
        off = float(np.linalg.norm(onto))
        along = own[:, len(by) :].T
        directions = np.vstack([along, onto / off]) if off > RESTING else along
        return directions, *self._changes(at, directions), balance, by

    def _balance(self, at: Array) -> tuple[Array, Array]:
        """Accelerations at rest, (n,), with derivatives by q and shares of y and x, (n, n + 2)."""
        rest, u, columns = at[2:], self.speed_at(at), []
        balance, by = self.rests(at).equations(rest, u)
        for i, way in ((1, [1.0, 0.0]), (0, [0.0, 1.0])):
            if i == self.speed_index:
                columns.append(self.window.size[i] * by[:, -1])
                continue
            end, step = self._beside(at, np.append(0.0 * rest, way))
            moved = self.rests(end).accelerations(rest[None], abs(u))[0]
            columns.append((moved - balance) / step)
        return balance, np.column_stack([by[:, :-1], *columns])

    def _beside(self, at: Array, direction: Array) -> tuple[Array, float]:
        """A point in a direction of (q, y, x) or, at the end of a range, in the opposite one."""
        way = np.concatenate([self.window.size * direction[[-1, -2]], direction[:-2]])
        step = SURFACE_STEP if self.defined(at + SURFACE_STEP * way) else -SURFACE_STEP
        return at + step * way, step

    def _changes(self, at: Array, directions: Array) -> tuple[Matrices, list[Matrices]]:
        """The matrices at a point, and their derivatives in directions of (q, y, x)."""
        here, found = self.at(at), list[Matrices]()
        for direction in directions:
            end, step = self._beside(at, direction)
            mass, damping, stiffness = (
                (b - a) / step for a, b in zip(here, self.at(end), strict=True)
            )
            found.append((mass, damping, stiffness))
        return here, found

    # ------------------------------------------------------------------------------- the matrices

    def defined(self, at: Array) -> bool:
        """Whether the numbers (x, y) are allowed."""
        return all(low <= v <= high for v, (low, high) in zip(at[:2], self._allowed, strict=True))

    def _of_plane(self, at: Array, plane: int) -> Matrices:
        rests, rest, u = self.rests(at), at[2:], self.speed_at(at)
        if self.dof < self.rest_size:
            rest = rests.within.onto_constraints(rest[:, None], np.zeros((rest.size, 1)))[0][:, 0]
        mass, damping, stiffness = rests.matrices(rest, abs(u), plane)
        if u < 0.0:  # beside the edge without flow: C is affine in u, and K in its square
            damping = 2.0 * rests.matrices(rest, 0.0, plane)[1] - damping
        mass, damping, stiffness = (
            self.scale.T @ one @ self.scale for one in (mass, damping, stiffness)
        )
        return mass, damping, stiffness if self.hysteretic else stiffness.real

    def at(self, at: Array) -> Matrices:
        """The matrices M, C, K at (x, y, *q), or at the rest at (x, y)."""
        return self._of_plane(self.settled(at), int(bool(self.across)))

    def matrices(self, at: Array) -> tuple[Matrices, Matrices, Matrices]:
        """The matrices M, C, K at a point, and their derivatives by x and by y, as the rest moves.

        The second and third do not exist at a fold.
        """
        at = self.settled(at)
        _, by = self._balance(at)
        moved = np.linalg.solve(by[:, :-2], -by[:, :-3:-1])  # by shares of x and y
        ways = np.vstack([moved, np.eye(2)[::-1]]).T
        lengths = np.linalg.norm(ways, axis=1)
        here, changes = self._changes(at, ways / lengths[:, None])
        by_x, by_y = map(times, lengths / self.window.size, changes)
        return here, by_x, by_y

    def conservative_at(self, at: Array) -> bool:
        """Whether the motions in all planes are those of a conservative system, if it rests."""
        try:
            return all(Plane.conservative_at(one, self.settled(at)) for one in self.planes)
        except NotConverged:
            return False

    def eigenvalues(self, at: Array) -> Complex:
        """Eigenvalues of the counted modes in all planes."""
        at = self.settled(at)
        return np.concatenate([Plane.eigenvalues(one, at) for one in self.planes])

    def static_stiffnesses(self, at: Array) -> Array | None:
        """Eigenvalues of K of all planes, if C vanishes and K is symmetric."""
        at = self.settled(at)
        each = [Plane.static_stiffnesses(one, at) for one in self.planes]
        return None if each[0] is None else np.concatenate(each)  # type: ignore[arg-type]

    def turning(self, at: Array) -> float:
        """A number that passes 0 at folds: the root of the determinant of K in the plane of rest.

        It has the sign of the determinant, which is positive where the pipe does not buckle.
        """
        sign, size = np.linalg.slogdet(self._of_plane(at, 0)[2].real)
        return float(sign * math.exp(size / self.dof))

    def turns_back(self, at: Array) -> Array:
        """Direction (x, y), in shares of the window, away from the rests next to a fold.

        It is that of the left null vector w of G_q times (G_x, G_y), in which the fold's normal
        lies, with the sign found at an equilibrium beside the fold.
        """
        _, by = self._balance(at)
        left, _, right = np.linalg.svd(by[:, :-2])
        normal = left[:, -1] @ by[:, :-3:-1]
        moved = at.copy()
        moved[2:] += BESIDE * right[-1]
        pushed = left[:, -1] @ (self._balance(moved)[0] - self._balance(at)[0])
        return np.asarray(np.sign(pushed) * normal)

    # ----------------------------------------------------------------------- lines over the window

    def pairs(self, at: Array) -> tuple[Complex, Complex]:
        """Eigenvalues and slopes as of `Plane`; none where the pipe does not come to rest."""
        try:
            return super().pairs(self.settled(at))
        except NotConverged:
            return np.empty(0, dtype=complex), np.empty((2, 0), dtype=complex)

    def _stiffnesses(self, at: Array) -> tuple[Complex, Complex]:
        """Numbers that pass 0 at divergences on a line, with their slopes as of `pairs`.

        Across the plane of rest they are the real eigenvalues of K. In that plane it is 1 where the
        pipe comes to rest, and -1 beyond the fold at which the rest turns back.
        """
        try:
            at = self.settled(at)
        except NotConverged:
            none = np.empty(0) if self.across else np.full(1, -1.0)
            return none.astype(complex), np.zeros((2, none.size), dtype=complex)
        if not self.across:
            return np.ones(1, dtype=complex), np.zeros((2, 1), dtype=complex)
        (_, _, stiffness), *changes = self.matrices(at)
        values, left, right = scipy.linalg.eig(stiffness.real, left=True)
        real = values.imag == 0.0
        values, left, right = values[real], left[:, real].conj().T, right[:, real]
        sizes = np.sum(left.T * right, axis=0)
        slopes = [np.sum(left.T * (one[2].real @ right), axis=0) / sizes for one in changes]
        return values, self.window.size[:, None] * np.array(slopes)

    def static_roots(self, at: Array, index: int) -> list[float]:
        """Values of x (index 0) or y (1) next to divergences on the line through (x, y).

        Those along the flow speed are among the results of `along_speed`. Two folds that are closer
        to each other than samples, so that the pipe does not come to rest between them, are missed.
        """
        if index == self.speed_index:
            return []
        low, size = float(self.window.low[index]), float(self.window.size[index])
        return [low + share * size for share, _ in self._on_line(self._stiffnesses, at, index)[0]]

    def along_speed(self, line: Array) -> Sequence[Crossing]:
        """Crossings of the axis along the rest that follows the flow speed, up to its range's end.

        Raises:
            NotConverged: if the rest is lost elsewhere than at a fold, with the crossings before.
        """
        assert self.speed_index is not None
        end = float(self.window.low[self.speed_index] + self.window.size[self.speed_index])
        counted = 2 * self.modes * len(self.planes)
        search = SearchOfRest(self.model_at(line), end, False, counted)
        try:
            search.run()
        except NotConverged:
            last = search.found[-1].crossing if search.found else None
            if last is None or last.kind == "flutter" or last.across:
                raise
        return [one.crossing for one in search.found]
