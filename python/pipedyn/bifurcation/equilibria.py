# SPDX-License-Identifier: MIT
"""Configurations at which a pipe rests in the flow: all of them at a speed, and along the speed.

At rest the flow acts with a u^2 and with nothing else, so forces are affine in u^2 at any
configuration. Their derivative is exact: the operators' stiffness and flux.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import field, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import root

from pipedyn.bifurcation.continuation import Lost, Path, Point, solve
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged, Operators, PipedynError
from pipedyn.models.modular.assembly import Assembly
from pipedyn.motion.simulate import Start, checked_model_in_motion
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import evaluated
from pipedyn.util.result import result
from pipedyn.util.threads import one_thread

Change = Literal["fold", "pitchfork", "branch point", "hopf"]

LARGEST = 500
"""Degrees of freedom up to which equilibria are searched: factorisations here are dense."""

DISTINCT = 1e-6
"""Coordinates by which two equilibria differ at least."""

NEAR = 0.5
"""Root mean square of the coordinates, in rad, within which a start leads to an equilibrium."""

BALANCED = 1e-8
"""Force that may be left at an equilibrium, beside 1 + |gamma| + a u^2."""

FAR = 60.0
"""Coordinate beyond which a branch is not followed: ten turns."""

MOST_POINTS = 4000
"""Points of one branch."""

LEAVING = 0.02
"""Distance from a branch point, in rad, at which a branch that leaves it is taken up."""


@result
class Equilibria:
    """Equilibria at one flow speed, the straight one first, the others from the least bent on.

    Attributes:
        q: coordinates, shape (k, coordinates).
        stable: whether no eigenvalue of the linearisation has a positive real part, shape (k,).
        growth: largest real part of an eigenvalue, in 1 / T, shape (k,).
        tips: position (x, y) of the free end in L, shape (k, 2).
        residuals: largest force left, beside 1 + |gamma| + a u^2, shape (k,).
        u: flow speed.
        model: the model.
    """

    q: Array = field(repr=False)
    stable: NDArray[np.bool_]
    growth: Array
    tips: Array
    residuals: Array = field(repr=False)
    u: float
    model: Model

    def __len__(self) -> int:
        return len(self.stable)


@result
class BranchPoint:
    """Where the stability of a branch changes or the branch turns.

    Attributes:
        kind: "fold", "pitchfork" (branches leave the straight pipe as mirror images, which is how
            it diverges), "branch point" (another passage of a real eigenvalue through 0) or "hopf"
            (of a pair: flutter).
        speed: u.
        frequency: angular, in 1 / T; 0 but for "hopf".
        q: the configuration, shape (coordinates,).
        tip: position (x, y) of the free end.
    """

    kind: Change
    speed: float
    frequency: float
    q: Array = field(repr=False)
    tip: Array


@result
class EquilibriumBranch:
    """A branch of equilibria, point by point along its arc length.

    Attributes:
        speeds: u, shape (S,).
        q: coordinates, shape (S, coordinates).
        stable: shape (S,).
        unstable: number of eigenvalues with positive real part, shape (S,).
        tips: position (x, y) of the free end in L, shape (S, 2).
        points: where it turns or stability changes, in order along the branch.
        ends: why it ends, at its first and its last point: "range" of speeds, "pitchfork" (it joins
            its mirror image on the straight pipe), "closed", "far" (a coordinate beyond 60 rad),
            "points" (their number ran out) or "lost" (it could not be followed).
        model: the model.
    """

    speeds: Array
    q: Array = field(repr=False)
    stable: NDArray[np.bool_] = field(repr=False)
    unstable: NDArray[np.int_] = field(repr=False)
    tips: Array = field(repr=False)
    points: tuple[BranchPoint, ...]
    ends: tuple[str, str]
    model: Model

    def __len__(self) -> int:
        return len(self.speeds)

    @property
    def folds(self) -> tuple[BranchPoint, ...]:
        """Where it turns back in the flow speed."""
        return tuple(point for point in self.points if point.kind == "fold")

    @property
    def straight(self) -> bool:
        """Whether its configuration, that of the straight pipe, is the same at every speed."""
        return not float(np.ptp(self.q, axis=0).max()) > 0.0


def equilibria(model: Model, u: float, starts: Sequence[Start] = ()) -> Equilibria:
    """Equilibria at a flow speed, stable or not, mirror images included.

    Sought are those on branches that leave the straight pipe, in the flow speed and in gravity as
    it grows from nothing, and those that Newton's method finds from bent starts: half a radian to
    one and a half turns, in the first three modes of bending. No method finds all for certain; the
    user's own starts come on top.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        starts: further starts, coordinates each or angles theta(s), as for `simulate`.

    Returns:
        Equilibria. Those of an undamped pipe without flow are stable where they oscillate.

    Raises:
        NotConverged: if not a single one is found.
        ValueError, TypeError: for bad arguments.
    """
    rest = Rest(checked_size(model))
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    if isinstance(starts, str) or not isinstance(starts, Sequence):
        raise TypeError(f"starts must be a sequence of starts, got {check.shown(starts)}")
    own = [rest.from_start(f"starts[{i}]", start) for i, start in enumerate(starts)]
    with one_thread(model.dof):
        found = _Found(rest, u)
        found.add(rest.resting)
        for x in (*rest.left_behind(u), *rest.out_of_gravity(u)):
            found.add(x)
        for x in (*own, *rest.bent_starts()):
            found.add_from(x)
        if not found.xs:
            raise NotConverged(f"no equilibrium was found at u = {u:g}")
        xs = found.sorted()
        growth = np.array([rest.growth(x, u) for x in xs])
        stable = np.array([rest.unstable(x, u) == 0 for x in xs])
        residuals = np.array([rest.unbalanced(x, u) for x in xs])
    q = rest.recorded(np.array(xs))
    return Equilibria(q, stable, growth, model.tips(q.T), residuals, u, model)


def equilibrium_branch(
    model: Model,
    q0: Start,
    u0: float,
    speeds: tuple[float, float],
    step: float = 0.05,
) -> EquilibriumBranch:
    """The branch of equilibria through a given one, followed in the flow speed past folds.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom; a point costs
            eigenvalues of a dense matrix, O(dof^3).
        q0: near the equilibrium, coordinates or an angle theta(s), as for `simulate`; Newton's
            method goes on from there, to at most half a radian away, as the root mean square over
            the coordinates.
        u0: its flow speed, within `speeds`.
        speeds: (lowest, highest) flow speed of the branch.
        step: longest step along the branch, in [1e-4, 1]: in rad, as the root mean square over
            the coordinates, and in tenths of the range of speeds.

    Returns:
        EquilibriumBranch, from the end that lies in the direction of falling speed at q0.

    Raises:
        NotConverged: if there is no equilibrium near q0, or none could be followed.
        ValueError, TypeError: for bad arguments.

    Source: Keller (1977) for the continuation.
    """
    rest = Rest(checked_size(model))
    low, high = checked_range(speeds)
    u0 = check.real("u0", u0, low=low, high=high)
    step = check.real("step", step, low=1e-4, high=1.0)
    start = rest.from_start("q0", q0)
    with one_thread(model.dof):
        try:
            x, _ = solve(rest, start, u0)
            if rest.unbalanced(x, u0) > BALANCED:
                raise Lost("forces are left")
        except Lost as error:
            raise NotConverged(f"no equilibrium was found near q0 at u = {u0:g}") from error
        away = rest.rms(x - start)
        if away > NEAR:
            raise NotConverged(
                f"no equilibrium was found near q0 at u = {u0:g}: that to which Newton's method "
                f"leads lies {away:.3g} rad away, more than {NEAR:g}"
            )
        return _branch(rest, x, u0, (low, high), step)


def checked_size(model: Any) -> Model:
    """The argument, if it is a model whose equilibria can be found."""
    moving = checked_model_in_motion(model)
    if moving.dof > LARGEST:
        raise ValueError(
            f"model must have at most {LARGEST} degrees of freedom for equilibria, got {moving.dof}"
        )
    return moving


def checked_range(speeds: Any) -> tuple[float, float]:
    """The argument speeds, if it is a lowest and a highest flow speed."""
    ends = check.array("speeds", speeds, size=2, low=0.0, high=LARGEST_SPEED)
    low, high = (float(end) for end in ends)
    if not high - low >= 1e-9 * (1.0 + high):
        raise ValueError(f"speeds must be (lowest, highest), got ({low:g}, {high:g})")
    return low, high


# ----------------------------------------------------------------------------------- forces at rest


class Rest:
    """Forces at rest and their derivatives, in the coordinates that integrators advance.

    With guides and pins the equations are those of accelerations along what these allow plus, for
    what they forbid, the rates with which the motion returns to them: as many as unknowns, and zero
    together at an equilibrium that meets the constraints.

    Args:
        model: the model.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self.size = model.moving
        self.tied = isinstance(model, Assembly) and model.dof < model.moving
        self._at: tuple[bytes, Operators] | None = None
        self.resting = np.array(model.resting(), dtype=np.float64)

    def accelerations(self, x: Array, u: float) -> tuple[Array, Array]:
        """Rates and accelerations of [x, 0], (moving,) each; rates are 0 but beside a guide."""
        y = np.zeros(2 * self.size + 1)
        y[: self.size] = x
        evaluated(1)
        rates = self.model.motion.rhs_and_power(0.0, y, u)
        return rates[: self.size], rates[self.size : -1]

    def residual(self, x: Array, p: float) -> Array:
        """Forces, or for scenes accelerations and returns, shape (moving,)."""
        rates, turning = self.accelerations(x, abs(p))
        if self.tied:
            total: Array = rates + turning
            return total
        forces: Array = self.operators(x).mass @ turning
        return forces

    def operators(self, x: Array) -> Operators:
        """About a configuration; the last is kept, since forces and their derivative both ask."""
        key = x.tobytes()
        if self._at is None or self._at[0] != key:
            self._at = key, self.model.operators(x)
        return self._at[1]

    def jacobian(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by x, (moving, moving)."""
        if not self.tied:
            ops = self.operators(x)
            slope: Array = -ops.stiffness - ops.centrifugal * p**2 * ops.flux
            return slope
        whole = self.model.motion_jacobian(np.concatenate([x, np.zeros(self.size)]), abs(p))
        joined: Array = whole[self.size :, : self.size] + whole[: self.size, : self.size]
        return joined

    def by_parameter(self, x: Array, p: float) -> Array:
        """Derivative of `residual` by the speed: forces are affine in its square."""
        slope: Array = 2.0 * p * (self.residual(x, 1.0) - self.residual(x, 0.0))
        return slope

    def basis(self, x: Array) -> Array | None:
        """Directions that guides and pins leave, (moving, dof); None where there are none."""
        if self.tied and isinstance(self.model, Assembly):
            return self.model.basis(x)
        return None

    def unbalanced(self, x: Array, u: float) -> float:
        """Largest force left, beside 1 + |gamma| + a u^2, and how far guides are missed."""
        rates, turning = self.accelerations(x, u)
        missed = float(np.abs(rates).max())
        if not missed < 1e-9:  # `operators` takes no configuration that misses a guide
            return math.inf
        basis = self.basis(x)
        along = turning if basis is None else basis.T @ turning
        pipe = self.model.pipe
        size = 1.0 + abs(pipe.gamma) + pipe.centrifugal * u**2
        return float(np.abs(self.operators(x).mass @ along).max()) / size + missed

    def eigenvalues(self, x: Array, u: float) -> NDArray[np.complex128]:
        """Of small motions about an equilibrium, shape (2 dof,)."""
        mass, velocity, stiffness = self.operators(x).at(u)
        lower = np.linalg.cholesky(mass)

        def scaled(matrix: Array) -> Array:
            half = scipy.linalg.solve_triangular(lower, matrix, lower=True)
            whole: Array = scipy.linalg.solve_triangular(lower, half.T, lower=True).T
            return whole

        n = len(mass)
        companion = np.zeros((2 * n, 2 * n))
        companion[:n, n:] = np.eye(n)
        companion[n:, :n], companion[n:, n:] = -scaled(stiffness), -scaled(velocity)
        found: NDArray[np.complex128] = scipy.linalg.eigvals(companion)
        return found

    def growth(self, x: Array, u: float) -> float:
        """Largest real part of an eigenvalue."""
        return float(self.eigenvalues(x, u).real.max())

    def unstable(self, x: Array, u: float) -> int:
        """Number of eigenvalues whose real part is positive beyond rounding."""
        found = self.eigenvalues(x, u)
        return int(np.count_nonzero(found.real > rounding(found)))

    def recorded(self, xs: Array) -> Array:
        """Coordinates that users see, (k, coordinates), of (k, moving)."""
        return self.model.recorded(xs, np.zeros_like(xs))[0]

    def from_start(self, name: str, start: Any) -> Array:
        """The argument as [x], from coordinates or an angle theta(s)."""
        given = self.model.bent(start) if callable(start) else start
        try:
            return np.array(self.model.start(given, None)[: self.size])
        except (ValueError, TypeError) as error:
            raise type(error)(str(error).replace("q0", name, 1)) from error

    def rms(self, x: Array) -> float:
        """Size of a difference of configurations."""
        return float(np.linalg.norm(x)) / math.sqrt(self.size)

    def straight(self, x: Array) -> bool:
        """Whether a configuration is that of the straight pipe, its own mirror image."""
        return not self.resting.any() and self.rms(x) < 1e-9

    # --------------------------------------------------------------------------- where to look

    def rests(self, u: float) -> bool:
        """Whether the configuration at rest is an equilibrium."""
        return self.unbalanced(self.resting, u) <= BALANCED

    def pitchforks(self, highest: float) -> list[tuple[float, Array]]:
        """Speeds up to the highest at which branches leave the straight pipe, with directions."""
        if not (self.rests(0.0) and self.rests(1.0)):
            return []
        still = self.jacobian(self.resting, 0.0)
        squares = _singular(still, self.jacobian(self.resting, 1.0) - still)
        speeds = [math.sqrt(square) for square in squares if 0.0 < square <= highest**2]
        return [(u, _null(self.jacobian(self.resting, u))) for u in speeds]

    def left_behind(self, u: float) -> Iterator[Array]:
        """Equilibria at a speed on branches that leave the straight pipe as the speed changes."""
        highest = 2.0 * u + 10.0
        for speed, direction in self.pitchforks(highest):
            path = Path(self, 0.1 * highest)
            yield from _met(path, self.resting, speed, direction, u, (0.0, highest))

    def out_of_gravity(self, u: float) -> Iterator[Array]:
        """Equilibria on branches that leave the straight pipe as gravity grows from nothing."""
        pipe = self.model.pipe
        if pipe.gamma == 0.0 or not self.rests(u):
            return
        problem = _Weighed(self, u)
        none = problem.jacobian(self.resting, 0.0)
        for share in _singular(none, problem.jacobian(self.resting, 1.0) - none):
            if 0.0 < share < 1.0:
                direction = _null(problem.jacobian(self.resting, share))
                yield from _met(
                    *(Path(problem, 0.5), self.resting, share, direction, 1.0, (0.0, 2.0))
                )

    def bent_starts(self) -> Iterator[Array]:
        """Bends of growing amplitude in three shapes."""
        for shape in (1.0, 3.0, 5.0):
            for amplitude in (0.5, 1.5, 3.0, 5.0, 9.0):

                def bend(s: Array, shape: float = shape, size: float = amplitude) -> Array:
                    return np.asarray(size * np.sin(0.5 * math.pi * shape * s))

                try:
                    yield self.from_start("q0", self.model.bent(bend))
                except PipedynError:  # guides and pins that such a bend cannot meet
                    continue


def rounding(eigenvalues: NDArray[np.complex128]) -> float:
    """Real part up to which an eigenvalue counts as neutral."""
    largest = float(np.abs(eigenvalues).max())
    return 1e-10 + min(4.0 * float(np.finfo(float).eps) * largest**2, 1e-6)


class _Weighed:
    """Forces at rest at one speed, with a share p of gravity: they are affine in it."""

    def __init__(self, full: Rest, u: float) -> None:
        pipe = full.model.pipe
        self.full, self.u = full, u
        self.none = Rest(full.model.with_pipe(replace(pipe, gamma=0.0)))

    def residual(self, x: Array, p: float) -> Array:
        none = self.none.residual(x, self.u)
        result: Array = none + p * (self.full.residual(x, self.u) - none)
        return result

    def jacobian(self, x: Array, p: float) -> Array:
        none = self.none.jacobian(x, self.u)
        result: Array = none + p * (self.full.jacobian(x, self.u) - none)
        return result

    def by_parameter(self, x: Array, p: float) -> Array:
        result: Array = self.full.residual(x, self.u) - self.none.residual(x, self.u)
        return result


def _singular(a: Array, b: Array) -> list[float]:
    """Real w > 0, in order, at which a + w b is singular."""
    top, bottom = scipy.linalg.eig(a, -b, right=False, homogeneous_eigvals=True)
    good = np.abs(bottom) > 1e-12 * np.abs(top)  # b has a small rank: the others lie at infinity
    values = top[good] / bottom[good]
    real = values.real[np.abs(values.imag) <= 1e-9 * np.abs(values)]
    return sorted(float(value) for value in real if value > 0.0)


def _null(matrix: Array) -> Array:
    """Unit vector that a singular matrix takes to nothing."""
    direction: Array = np.linalg.svd(matrix)[2][-1]
    return direction


def _met(
    path: Path,
    x: Array,
    p: float,
    direction: Array,
    target: float,
    ends: tuple[float, float],
) -> Iterator[Array]:
    """Solutions at a parameter on the branch that leaves a branch point, one half of it."""
    try:
        point = path.leaving(x, p, direction, LEAVING)
    except Lost:
        return
    step = 0.05
    for _ in range(MOST_POINTS):
        try:
            found, _, step = path.following(point, step, 0.4)
        except Lost:
            return
        if (point.p - target) * (found.p - target) <= 0.0 and point.p != found.p:
            share = (target - point.p) / (found.p - point.p)
            with suppress(Lost):
                yield solve(path.problem, point.x + share * (found.x - point.x), target)[0]
        away = found.x - x
        back = float(away @ direction) / math.sqrt(x.size)
        if abs(back) < 0.5 * LEAVING and float(np.linalg.norm(away)) < LEAVING * math.sqrt(x.size):
            return  # through the straight pipe again, onto a mirror image
        if not ends[0] <= found.p <= ends[1] or float(np.abs(found.x).max()) > FAR:
            return
        point = found


class _Found:
    """Equilibria at a speed, each once, with mirror images."""

    def __init__(self, rest: Rest, u: float) -> None:
        self.rest, self.u = rest, u
        self.xs: list[Array] = []

    def known(self, x: Array) -> bool:
        return any(
            float(np.abs(x - other).max()) < DISTINCT * (1 + np.abs(x).max()) for other in self.xs
        )

    def add(self, x: Array) -> None:
        """A solution, if it is one and new, and its mirror image."""
        for candidate in (x, -x):
            if self.known(candidate) or float(np.abs(candidate).max()) > FAR:
                continue
            try:
                good = self.rest.unbalanced(candidate, self.u) <= BALANCED
            except (ValueError, PipedynError):
                continue
            if good:
                self.xs.append(candidate + 0.0)

    def add_from(self, x: Array) -> None:
        """What scipy's hybrid method finds from a start, polished."""
        rest, u = self.rest, self.u
        try:
            found = root(rest.residual, x, args=(u,), jac=rest.jacobian, method="hybr")
            if float(np.abs(found.x).max()) <= FAR:
                self.add(solve(rest, found.x, u)[0])
        except (Lost, ValueError):
            pass

    def sorted(self) -> list[Array]:
        """From the least bent on, a mirror image beside its original, to the right first."""
        rest = self.rest

        def key(x: Array) -> tuple[float, float]:
            tip = rest.model.tips(rest.recorded(x[None]).T)[0, 0]
            return round(rest.rms(x - rest.resting), 6), -float(tip)

        return sorted(self.xs, key=key)


# ----------------------------------------------------------------------------------------- branches


def _branch(
    rest: Rest, x: Array, u: float, ends: tuple[float, float], step: float
) -> EquilibriumBranch:
    """The branch through an equilibrium, both ways."""
    still = rest.rms(x - rest.resting) < 1e-9 and rest.rests(0.0) and rest.rests(1.0)
    path = (_Still if still else Path)(rest, 0.1 * (ends[1] - ends[0]))
    if still:
        x = rest.resting
    try:
        down = path.heading(x, u, -1.0)
    except Lost as error:
        raise NotConverged(f"the equilibrium at u = {u:g} is a branch point") from error
    up = Point(x, u, -down.tangent)
    halves = [_Half(rest, path, start, ends, step) for start in (down, up)]
    for half in halves:
        half.run()
        if half.end == "closed":
            break
    first, second = halves
    if first.end == "closed":
        halves, whys = [first], ("closed", "closed")
        points, counts, changes = first.points, first.counts, first.changes
    else:
        whys = (first.end, second.end)
        points = first.points[:0:-1] + second.points
        counts = first.counts[:0:-1] + second.counts
        changes = first.changes[::-1] + second.changes
    q = rest.recorded(np.array([point.x for point in points]))
    unstable = np.array(counts)
    return EquilibriumBranch(
        speeds=np.array([point.p for point in points]),
        q=q,
        stable=unstable == 0,
        unstable=unstable,
        tips=rest.model.tips(q.T),
        points=tuple(changes),
        ends=whys,
        model=rest.model,
    )


class _Still(Path):
    """The path of a configuration that rests at any speed: nothing needs to be solved."""

    def heading(self, x: Array, p: float, sign: float) -> Point:
        return Point(x, p, np.append(np.zeros_like(x), sign * self.scale))

    def stepped(self, start: Point, ds: float) -> Point:
        return Point(start.x, start.p + ds * float(start.tangent[-1]), start.tangent)


class _Half:
    """A branch from one of its points on, one way."""

    def __init__(
        self, rest: Rest, path: Path, start: Point, ends: tuple[float, float], longest: float
    ) -> None:
        self.rest, self.path, self.ends, self.longest = rest, path, ends, longest
        self.points, self.counts = [start], [self.count(start)]
        self.changes: list[BranchPoint] = []
        self.end = "points"

    def count(self, point: Point) -> int:
        return self.rest.unstable(point.x, abs(point.p))

    def run(self) -> None:
        step = 0.2 * self.longest
        low, high = self.ends
        gone = 0.0
        while len(self.points) < MOST_POINTS // 2:
            a = self.points[-1]
            if (a.p <= low and a.tangent[-1] < 0.0) or (a.p >= high and a.tangent[-1] > 0.0):
                self.end = "range"
                return
            try:
                found, ds, step = self.path.following(a, step, self.longest)
                if not low <= found.p <= high and a.p != (edge := min(max(found.p, low), high)):
                    found, ds = self.path.landing(a, ds, edge)
                    found = Point(found.x, edge, found.tangent)
                joined = self._noted(a, found, ds)
            except Lost:
                self.end = "lost"
                return
            if joined:
                self.end = "pitchfork"
                return
            self.points.append(found)
            self.counts.append(self.count(found))
            gone += ds
            if float(np.abs(found.x).max()) > FAR:
                self.end = "far"
                return
            if gone > 10.0 * self.longest and self._around(found, ds):
                self.end = "closed"
                return

    def _around(self, found: Point, ds: float) -> bool:
        start = self.points[0]
        away = np.append(found.x - start.x, found.p - start.p)
        alike = self.path.product(found.tangent, start.tangent) > 0.9
        return alike and self.path.length(away) <= ds

    def _noted(self, a: Point, b: Point, ds: float) -> bool:
        """Keeps what changes between two neighbours; whether the branch ends on the straight pipe.

        Undamped, a real eigenvalue near a fold is a root's root, so that the count changes as far
        beside the fold as rounding in the count lets it: one change, told once.
        """
        rest, path = self.rest, self.path
        met = self._met(a, b)
        turn: tuple[Point, float] | None = None
        until = ds
        if met is not None:
            size = rest.rms(a.x)
            until = 0.98 * ds * size / (size + rest.rms(b.x))
        elif a.tangent[-1] * b.tangent[-1] < 0.0:
            turn = path.turning(a, ds)
        marked: list[tuple[float, BranchPoint]] = []
        count, at = self.counts[-1], 0.0
        last = self.count(path.stepped(a, until))
        for _ in range(8):
            if count == last:
                break
            beyond, at = path.change(a, at, until, self.count)
            change = self.count(beyond) - count
            count += change
            if change % 2 == 0:
                marked.append((at, self._point("hopf", beyond)))
            elif turn is None or abs(at - turn[1]) > 1e-3 * ds:
                kind: Change = "pitchfork" if rest.straight(beyond.x) else "branch point"
                marked.append((at, self._point(kind, beyond)))
        if turn is not None:
            marked.append((turn[1], self._point("fold", turn[0])))
        self.changes += [point for _, point in sorted(marked, key=lambda one: one[0])]
        if met is None:
            return False
        end = Point(rest.resting, met, a.tangent)
        self.changes.append(self._point("pitchfork", end))
        self.points.append(end)
        self.counts.append(last)
        return True

    def _met(self, a: Point, b: Point) -> float | None:
        """Speed of the pitchfork through which a branch goes over into its mirror image."""
        rest = self.rest
        if rest.resting.any() or rest.straight(a.x) or not float(a.x @ b.x) < 0.0:
            return None
        if max(rest.rms(a.x), rest.rms(b.x)) > 2.0 * self.longest:
            return None
        near = 0.02 * (1.0 + a.p)
        forks = [u for u, _ in rest.pitchforks(a.p + near) if abs(u - a.p) < near]
        return min(forks, key=lambda u: abs(u - a.p)) if forks else None

    def _point(self, kind: Change, point: Point) -> BranchPoint:
        rest = self.rest
        frequency = 0.0
        if kind == "hopf":
            found = rest.eigenvalues(point.x, abs(point.p))
            swinging = found[np.abs(found.imag) > 1e-6]
            if swinging.size:
                passing = np.argmin(np.abs(swinging.real - rounding(found)))
                frequency = float(abs(swinging[passing].imag))
        speed = abs(point.p)
        if kind == "pitchfork":  # rounding in the count reaches further than in the roots of det K
            near = 1e-4 * (1.0 + speed)
            forks = [u for u, _ in rest.pitchforks(speed + near)]
            speed = min(forks, key=lambda u: abs(u - speed), default=speed)
        q = rest.recorded(point.x[None])[0]
        return BranchPoint(kind, speed, frequency, q, rest.model.tips(q[:, None])[0])
