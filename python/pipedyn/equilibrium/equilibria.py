# SPDX-License-Identifier: MIT
"""Configurations at which a pipe rests in the flow: all at one speed, and branches over the speed.

Branches are followed past folds, and changes of stability along them are recorded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field, replace
from functools import partial
from itertools import product
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from pipedyn.continuation.arclength import BranchStep, Control, DenseProblem, Point
from pipedyn.continuation.tracer import Tracer, special_points
from pipedyn.equilibrium.statics import (
    DISTINCT,
    SOLVED,
    Statics,
    StaticsInSpace,
    from_start,
    leaves_planes,
    rms_along,
    statics_of,
)
from pipedyn.linear.following import GrowthTest
from pipedyn.linear.neutral import grows
from pipedyn.models.base import BALANCED, Configurations, Model
from pipedyn.models.drive import LARGEST_SPEED, require_steady, steady_speed
from pipedyn.motion.simulate import Start, checked_model_in_motion, modal_bend
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.errors import NotConverged, NotResolved, PipedynError
from pipedyn.util.newton import NewtonFailed, zero_between
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import RATE, Result, TableResult, numbered_columns

EQUILIBRIA_DOF = 500
"""Most degrees of freedom in which equilibria are searched. A search in a chain takes 0.4 s with
100 segments, 1 s with 250 and 6 s with 500, as factorisations are dense; one in space 7 s with 125
and 29 s with 250."""

TEN_TURNS = 60.0
"""Largest coordinate, about ten turns in rad, up to which equilibria are searched and followed."""

BEND_ANGLES = (0.5, 1.0, 1.5, 2.2, 3.0, 4.0, 5.0, 7.0, 9.0)
"""Angles, in rad, of the bends from which equilibria are searched; a first look takes every second
angle.
For 96 pipes with 2 to 20 degrees of freedom under a weight up to 180, these starts led to all
equilibria with no coordinate beyond 4 rad that scipy's hybrid method found. Of its equilibria with
larger coordinates they missed 16, and they led to 88 equilibria that it did not find."""

IN_SPACE = 3.0
"""Largest angle, in rad, of starts in space, where tangents turn by less than pi."""

MOST_DOF_WOUND = 30
"""Most degrees of freedom for which all starts are taken. In five chains of 31 to 60 segments under
a weight up to 180, all starts led to no more equilibria than the first look."""

COUNTED_DOF = 4
"""Most degrees of freedom in which equilibria are counted by the signs of their determinants."""

DRAWN = 200
"""Number of configurations at which forces that springs balance are sampled for their size."""

FIRST_SIZE, FIRST_STARTS, MOST_STARTS, MOST_FOUND = 4.0, 4, 2**16, 256
"""Limits of a search that counts equilibria: the largest angle of its first starts, in rad; their
number, which is this to the power of the degrees of freedom and at least 256; the number of starts,
which take some seconds, after which the search ends; and the number of equilibria at which it ends,
as a pipe that is soft relative to its weight and jet has thousands."""

NEIGHBOURS, RADIUS = 40, 2.0
"""Number of starts around each known equilibrium, and their largest angle from it, in rad.
In 27 chains of four segments these starts led to all of up to 55 equilibria; 80,000 starts spread
evenly led to all but four."""

LEAST_SHARE, MOST_SEARCH_STEPS = 0.01, 40
"""Limits of Newton's method from each start: the share of a full step below which it gives up, and
the largest number of steps."""

NEAR = 0.5
"""Root mean square of the angle, in rad, within which a start or a larger basis is taken to lead to
the same equilibrium. It is far more than the rounding of a given configuration, and less than the
distance between two equilibria."""

BATCH_ENTRIES = 1_000_000
"""Most entries of the Jacobians by x of one batch of starts. Jacobians by the whole state, which
contain these, have four times as many entries and take 32 MB."""


@saved_as("Equilibria", added=("resolved", "valid", "discarded", "complete", "search"))
class Equilibria(Configurations, TableResult, units={"growth": RATE}):
    """Equilibria at one flow speed, ordered by how far they are bent, the straight one first.

    Equilibria that `equilibria` returns are resolved and valid; it puts others in `discarded`.

    Attributes:
        q: coordinates, shape (k, coordinates).
        stable: whether no eigenvalue of the linearisation has a positive real part, shape (k,).
        growth: largest real part of an eigenvalue, in 1 / T, shape (k,).
        tips: position (x, y) of the free end in L, shape (k, 2), or (x, y, z), shape (k, 3).
        residuals: largest force left, in units of 1 + |gamma| + a u^2, shape (k,).
        resolved: whether two larger bases of the reduced model have the equilibrium too, by the
            test that `equilibria` describes, shape (k,); if not, it is an artefact of the
            discretisation. Always True for chains and scenes.
        valid: whether the laws of all terms hold at the equilibrium's angles, shape (k,): the law
            of `Stretching` holds up to a quarter turn. `resolved` and `valid` are None in files of
            versions that did not compute them.
        u: flow speed.
        model: the model.
        discarded: solutions of the model's equations that are not resolved or not valid; None where
            there are none.
        complete: whether the search for all solutions with angles up to 60 rad ended and their
            count was right, as `equilibria` describes; None in files of versions that did not
            compute it.
        search: sentences on how equilibria were looked for, and why that is complete or not.

    Example:
        >>> found = pp.equilibria(pp.Chain(pp.Pipe(0.2, -20.0), 2), 1.0)
        >>> found.stable.tolist(), found.tips[:, 0].round(3)
        ([False, True, True], array([ 0.   ,  0.715, -0.715]))
    """

    q: Array = field(repr=False)
    stable: NDArray[np.bool_]
    growth: Array
    tips: Array
    residuals: Array = field(repr=False)
    u: float
    model: Model
    resolved: NDArray[np.bool_] | None = field(default=None, repr=False)
    valid: NDArray[np.bool_] | None = field(default=None, repr=False)
    discarded: Equilibria | None = None
    complete: bool | None = None
    search: str = field(default="", repr=False)

    def __len__(self) -> int:
        return len(self.stable)

    def _shown(self) -> dict[str, Any]:
        shown = super()._shown()
        if self.discarded is not None:
            shown["discarded"] = len(self.discarded)
        return shown

    def _columns(self) -> dict[str, Any]:
        asked = {"resolved": self.resolved, "valid": self.valid}
        return {
            "tip_x": self.tips[:, 0],
            "tip_y": self.tips[:, 1],
            **({"tip_z": self.tips[:, 2]} if self.tips.shape[1] == 3 else {}),
            "curvature": self.curvature,
            "growth_rate": self.growth,
            "stable": self.stable,
            **{name: one for name, one in asked.items() if one is not None},
            **numbered_columns("q", self.q),
        }


def equilibria(model: Model, u: float, starts: Sequence[Start] = ()) -> Equilibria:
    """Equilibria at a flow speed, stable or not, mirror images included.

    If a pipe has a free end and up to four degrees of freedom, all its equilibria are searched for.
    Newton's method starts from mixtures of the modes of bending, spread evenly up to angles beyond
    the largest found; from configurations spread evenly over the range in which elastic forces can
    balance the others; and from starts near each known equilibrium. The search ends when these and
    as many further starts lead to no more equilibria, and the equilibria found agree with the
    degree of the equations: elastic forces grow without bound and all others do not, so the signs
    of det K over all equilibria add up to 1. For a pipe on a free hinge, whole turns about it count
    once and the signs add up to 0; if no force opposes turns, all angles count once. A pair of
    opposite signs to which no start leads would be missed.

    In other pipes starts are bent by half a radian to one and a half turns, in all mixtures of the
    first three or four modes, and in the shapes in which the straight pipe buckles at that speed.
    This may miss some equilibria, mainly of supported pipes, which can coil in many ways:
    `complete` is False. Further starts may be given as `starts`.

    The equations of a reduced model with few functions have solutions that the pipe does not have.
    So each equilibrium of a reduced model is searched for in two larger bases, each with 1.5 times
    as many functions as the one before and at least four more. Newton's method starts there from
    the equilibrium. The equilibrium is kept if each step is at most half of the one before, and if
    the limit has the same stability, is nearer to it than to any other equilibrium found, and is
    within half a radian of it (root mean square along the pipe). Shapes that every basis has, such
    as the straight one, are kept whatever their stability.

    In three dimensions equilibria in the plane z = 0 are searched like that, and their stability is
    that of small motions in this plane and across it. If no load acts across the pipe and nothing
    else tells directions apart, all planes through the axis are alike: each bent equilibrium stands
    for all that a turn about the axis makes of it, and the eigenvalue 0 of that turn does not
    count. Otherwise equilibria that leave the plane are looked for as well, from starts bent in
    both planes and in the shapes in which those in the plane buckle; they are not counted, so that
    `complete` is False. Planar equilibria in which a joint of a chain, or a tangent of a reduced
    model, turns by more than pi are left out, and `search` says so.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        starts: further starts, each given by coordinates or by angles theta(s), as for `simulate`.

    Returns:
        Equilibria that are kept, with all others in `discarded`. Equilibria of an undamped pipe
        without flow count as stable where small motions about them oscillate.

    Example:
        >>> found = pp.equilibria(pp.Chain(pp.Pipe(0.2, -20.0), 2), 1.0)  # bent by its weight
        >>> len(found.q), found.stable.tolist()
        (3, [False, True, True])

    Raises:
        NotConverged: if no equilibrium is found, or if all are discarded; then the exception's
            `result` has the discarded ones.
        ValueError, TypeError: for bad arguments.
    """
    return searched(model, u, starts, counted=True)


def searched(model: Model, u: float, starts: Sequence[Start], counted: bool) -> Equilibria:
    """Result of `equilibria`; without `counted` the search for all equilibria is left out.

    Without `counted`, starts are bent by up to one and a half turns only. Diagrams need this: a
    soft pipe in a fast flow has dozens of equilibria wound up by many turns, which no motion
    reaches.
    """
    model = checked_model_in_motion(model, largest=EQUILIBRIA_DOF, purpose="equilibria")
    statics = Statics(model)
    u = steady_speed("u", u)
    if isinstance(starts, str) or not isinstance(starts, Sequence):
        raise TypeError(f"starts must be a sequence of starts, got {check.shown(starts)}")
    own = [from_start(model, f"starts[{i}]", start) for i, start in enumerate(starts)]
    with one_thread(model.dof):
        solutions = _Solutions(statics, u)
        solutions.run([model.nearest_in_plane(p) for p in own], counted)
        if not solutions.found:
            raise NotConverged(f"no equilibrium was found at u = {u:g}")
        xs = np.array(solutions.in_order())
        every = xs[~statics.turned_alike(xs)]
        reasons = [model.beyond_reach(x) for x in every]
        xs, left_out = every[[not why for why in reasons]], list(filter(None, reasons))
        complete, search = solutions.complete, solutions.search
        parts = [_columns_at(statics, u, xs)] if len(xs) else []
        if leaves_planes(model):
            beside = _Solutions(StaticsInSpace(model), u)
            beside.run_in_space(own, statics.whole(xs.T).T)
            complete, search = False, f"{search}; {beside.search}"
            if beside.found:
                parts.append(_columns_at(beside.statics, u, np.array(beside.in_order())))
        if not parts:
            why = f"in that of a plane {left_out[0]}"
            raise NotConverged(f"no equilibrium was found at u = {u:g}: {why}")
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    order = np.argsort(columns.pop("distance"), kind="stable")
    columns = {name: column[order] for name, column in columns.items()}

    def rows(which: NDArray[np.bool_]) -> dict[str, Any]:
        return {name: column[which] for name, column in columns.items()}

    resolved, valid = columns["resolved"], columns["valid"]
    kept = resolved & valid
    if left_out:
        why = f"{len(left_out)} of a plane left out, for instance as {left_out[0]}"
        complete, search = False, f"{search}; {why}"
    answer = Equilibria(**rows(kept), u=u, model=model, complete=complete, search=search)
    if not kept.all():
        answer = replace(answer, discarded=replace(answer, **rows(~kept)))
    if not kept.any():
        raise NotConverged(
            f"none of the {check.how_many(len(kept), 'solution')} found at u = {u:g} is an "
            f"equilibrium of the pipe: {np.count_nonzero(~resolved)} are not resolved by "
            f"{model.dof} degrees of freedom, {np.count_nonzero(~valid)} lie where a term is not "
            "valid",
            answer,
        )
    return answer


# ------------------------------------------------------------------------------- one flow speed


def _columns_at(statics: Statics, u: float, xs: Array) -> dict[str, Array]:
    """Columns of `Equilibria` for solutions xs, (k, integrated), with the distance from rest."""
    values, q = [statics.eigenvalues(x, u) for x in xs], statics.to_user(xs)
    stable = np.array([is_stable(one) for one in values])
    terms = statics.model.pipe.terms
    highest = min((term.largest_angle for term in terms), default=math.inf)
    return {
        "q": q,
        "stable": stable,
        "growth": np.array([float(one.real.max()) for one in values]),
        "tips": statics.model.tips(q.T),
        "residuals": np.array([statics.unbalanced(x, u) for x in xs]),
        "resolved": _in_larger_bases(statics, u, xs, stable),
        "valid": np.array([statics.within.largest_angle(x) <= highest for x in xs]),
        "distance": np.linalg.norm(xs - statics.resting, axis=1).round(6),
    }


def is_stable(eigenvalues: Complex) -> bool:
    """Whether no eigenvalue has a positive real part beyond its rounding."""
    return not grows(eigenvalues).any()


def _in_larger_bases(
    statics: Statics, u: float, xs: Array, stable: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Whether two larger bases have each equilibrium xs, (k, integrated), too; shape (k,).

    The test is that of `equilibria`. If each of Newton's steps is at most half the one before,
    there is a single equilibrium nearby, by the theorem of Newton and Mysovskikh.

    Source: Deuflhard (2004), Newton methods for nonlinear problems, sec. 2.1.
    """
    larger = statics.model.refined()
    largest = larger and larger.refined()
    if larger is None or largest is None:
        return np.ones(len(xs), dtype=bool)
    kind: type[Any] = type(statics)
    bases = kind(larger), kind(largest)
    angles, mirrors = statics.angles(xs), statics.mirrors(u)
    kept = np.zeros(len(xs), dtype=bool)
    for i, x in enumerate(xs):
        same = [j for j in range(i) for one in mirrors if np.abs(one * x - xs[j]).max() <= DISTINCT]
        if same:  # the mirror image
            kept[i] = kept[same[0]]
            continue
        with suppress(NewtonFailed, PipedynError, ValueError):
            here, y = statics, x
            for basis in bases:
                start = basis.resembling(here, y)
                here, y = basis, basis.balanced(start, u, patience=1)
            apart = rms_along(angles - here.angles(y[None]))
            if apart[i] <= min(NEAR, apart.min()):
                kept[i] = apart[i] <= DISTINCT or is_stable(here.eigenvalues(y, u)) == stable[i]
    return kept


class _Solutions:
    """Search for the solutions of the equations at one flow speed.

    Attributes:
        found: solutions with coordinates up to `TEN_TURNS`, each once, with their mirror images.
        complete: whether there are no other solutions.
        search: sentences on how they were looked for, and why that is complete or not.
    """

    def __init__(self, statics: Statics, u: float) -> None:
        self.statics, self.u = statics, u
        self.found: list[Array] = []
        self.mirrors = statics.mirrors(u)
        self.complete, self.search = False, ""

    def run(self, own: list[Array], counted: bool) -> None:
        """Looks for solutions, from a user's own starts and from others.

        With `counted`, a search in few degrees of freedom goes on until all solutions are known.
        """
        statics, u = self.statics, self.u
        self.add([statics.resting])
        for start in statics.buckled(statics.resting, u):
            with suppress(NewtonFailed):
                self.add([statics.balanced(start, u, longest=0.3, iterations=40)])
        model = statics.within
        held = model.integrated != model.dof
        if counted and model.dof <= COUNTED_DOF and not held:
            self.add(_balanced(statics, u, own, 0.5))
            self.count()
            return
        odd = statics.motion.is_odd(u)
        # A few starts show whether a hanging pipe has bent equilibria at all; only then are all
        # starts taken.
        starts, modes = [*own, *_bends(statics, 3, BEND_ANGLES[::2], odd)], 3
        found = _balanced(statics, u, starts, 0.2)
        self.add(found)
        taken = len(starts)
        if statics.size <= MOST_DOF_WOUND and (len(found) > 1 or model.pipe.axial_gravity < 0.0):
            starts, modes = [*_bends(statics, 4, BEND_ANGLES, odd)], 4
            self.add(_balanced(statics, u, starts, 0.5))
            taken += len(starts)
        why = "of pipes that are held" if held else f"in more than {COUNTED_DOF} degrees of freedom"
        self.search = (
            f"{taken} starts bent by up to {BEND_ANGLES[-1]:g} rad in mixtures of {modes} "
            f"modes; solutions {why} are not counted"
        )

    def run_in_space(self, own: list[Array], rests: Array) -> None:
        """Looks for solutions out of the plane z = 0, given those in it as rows of `rests`."""
        statics, modes, odd = self.statics, 2, len(self.mirrors) > 1
        buckled = [start for rest in rests for start in statics.buckled(rest, self.u)]
        sizes = [size for size in BEND_ANGLES if size <= IN_SPACE]
        starts = [*own, *buckled, *_bends(statics, modes, sizes, odd)]
        self.add(_balanced(statics, self.u, starts, 0.5))
        self.found = [x for x in self.found if not statics.model.lies_in_plane(x)]
        self.search = (
            f"in space {len(starts)} starts bent by up to {sizes[-1]:g} rad in mixtures of {modes} "
            "modes of each plane and in shapes that buckle; solutions in space are not counted"
        )

    def in_order(self) -> list[Array]:
        """Solutions by their distance from rest, of mirror images those to the right first."""
        statics = self.statics

        def place(x: Array) -> list[float]:
            tip = statics.model.tips(statics.to_user(x[None]).T)[0]
            return [round(statics.rms(x - statics.resting), 6), *(-tip[::2]).round(9).tolist()]

        return sorted(self.found, key=place)

    def add(self, xs: Sequence[Array] | Array) -> int:
        """Keeps the rows of xs that are new solutions, and returns their number."""
        before = len(self.found)
        for x in xs:
            size = float(np.abs(x).max())
            images = [x, *(signs * x for signs in self.mirrors)] if size <= TEN_TURNS else []
            for image in map(self.statics.unwound, images):
                far = DISTINCT * (1.0 + size)
                others = np.reshape(self.found, (-1, x.size))
                new = np.abs(image - others).max(axis=1).min(initial=math.inf) >= far
                with suppress(ValueError, PipedynError):
                    if new and self.statics.unbalanced(image, self.u) <= BALANCED:
                        self.found.append(image + 0.0)
        return len(self.found) - before

    def count(self) -> None:
        """Looks for all solutions of a model with few degrees of freedom, and counts them."""
        statics, model = self.statics, self.statics.within
        basis = _modal_basis(model, model.dof)
        first = max(FIRST_STARTS**model.dof, 256)
        # Multiples of these, modulo 1, fill a cube evenly (Richtmyer's sequence).
        roots = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0])[: model.dof + 1]
        beside = np.random.default_rng(0)

        def led_to(starts: Array) -> int:
            """Number of new solutions to which Newton's method leads from the rows of `starts`."""
            return self.add(_balanced(statics, self.u, list(starts), 0.5))

        size, here, drawn, every, settled = FIRST_SIZE, 0, 0, 0, False
        reach = _reach(statics, self.u)
        while not settled and every < MOST_STARTS and len(self.found) < MOST_FOUND:
            many = max(first, here)
            draws = np.arange(drawn + 1.0, drawn + many + 1.0)[:, None] * roots % 1.0
            # High modes are stiff: their largest angle falls as a power of their number, whose
            # exponent is drawn as well.
            even = 2.0 * draws[:, :-1] - 1.0
            parts = size * even * _shares(basis, 0.5 + 0.5 * draws[:, -1:])
            new = led_to(statics.resting + np.concatenate([parts @ basis, even @ reach]))
            near = new
            while near and every < MOST_STARTS and len(self.found) < MOST_FOUND:
                around = np.repeat(self.found, NEIGHBOURS, axis=0)
                parts = RADIUS * beside.uniform(-1.0, 1.0, (len(around), model.dof))
                near = led_to(around + (parts * _shares(basis, 0.75)) @ basis)
                every += len(around)
            here, drawn, every = here + many, drawn + many, every + 2 * many
            largest = max((float(np.abs(x).max()) for x in self.found), default=0.0)
            if largest > 0.5 * size and size < TEN_TURNS:
                size, here = min(2.0 * size, TEN_TURNS), 0
            else:
                settled = not new and here > first and self.missing() == 0
        self.complete, taken = settled, f"{every:,} starts bent by up to {size:g} rad"
        if len(self.found) >= MOST_FOUND:
            self.search = f"{taken}, where there are at least {MOST_FOUND} solutions"
        elif settled:
            self.search = f"{taken}; the signs of det K add up as they must"
        elif self.missing() is None:
            self.search = f"{taken}; where det K is 0 none are counted"
        elif self.missing():
            self.search = f"{taken}; the signs of det K do not add up as they must"
        else:
            self.search = f"{taken}, of which the last led to others"

    def missing(self) -> int | None:
        """The required sum of the signs of det K minus their sum; None where a determinant is 0."""
        statics, expected = self.statics, 1 if self.statics.whole_turn is None else 0
        if not self.found:
            return expected
        slopes = statics.jacobian(np.array(self.found), self.u)
        signs, logs = np.linalg.slogdet(-slopes)
        if not np.isfinite(logs).all():
            return None
        return expected - round(float(signs.sum()))


def _reach(statics: Statics, u: float) -> Array:
    """Rows e_j such that every equilibrium is a sum of s_j e_j, |s_j| <= 1; (dof, integrated).

    At an equilibrium the elastic forces K x balance the others. These, of gravity, flow and terms,
    are bounded, as they depend on the directions of the pipe and not on how often it is wound up.
    Each is taken to be at most a fifth larger than in configurations drawn at random. Rows are
    limited to `TEN_TURNS`, for instance where no spring resists.
    """
    model, size = statics.within, statics.size
    plain = model.with_pipe(replace(model.pipe, gamma=0.0, terms=(), jet_angle=0.0))
    elastic = plain.operators().stiffness
    places = np.random.default_rng(0).uniform(-TEN_TURNS, TEN_TURNS, (DRAWN, size))
    forces = np.zeros((0, size))
    for place in places:
        with suppress(ValueError, PipedynError):  # for instance where a reduced model coils
            left = statics.forces(place, u)
            forces = np.append(forces, (left + elastic @ place)[None], axis=0)
    most = 1.2 * np.abs(forces).max(axis=0, initial=0.0)
    rows = most[:, None] * np.linalg.pinv(elastic)
    return np.asarray(np.clip(rows, -TEN_TURNS, TEN_TURNS))


def _modal_basis(model: Model, modes: int) -> Array:
    """Changes of x that bend the pipe by 1 rad in each of its first modes, (modes, integrated).

    They need not meet supports. In three dimensions there are as many in the plane of z.
    """
    rows = [model.planar.sampled(modal_bend(one)) for one in np.eye(modes)]
    return np.asarray(np.kron(np.eye(model.dimensions - 1), rows))


def _shares(basis: Array, power: float | Array) -> Array:
    """Largest angle in each mode as a share of that in the first mode, (1, dof) or (k, dof)."""
    return np.arange(1.0, 2.0 * len(basis), 2.0)[None] ** -power


def _bends(statics: Statics, modes: int, sizes: Sequence[float], odd: bool) -> Array:
    """Starts that are bent in all mixtures of the first modes, with the largest angles `sizes`.

    If motions are odd, one of a bend and its mirror image is enough, as the mirror image leads to
    the mirror image of the solution. In space all leave the plane z = 0, to one side.
    """
    axes = statics.axes
    every = np.array([*product((-1, 0, 1), repeat=axes * modes)])
    # Mirrored mixtures have the opposite sign, which is that of their first mode that is not 0.
    signs = np.sign(every.reshape(-1, axes, modes) @ 3.0 ** -np.arange(modes))
    kept = signs[:, -1] > 0.0 if odd or axes == 2 else signs[:, -1] != 0.0
    kept &= (signs[:, 0] >= 0.0) | (not odd)
    parts = np.multiply.outer(sizes, every[kept]).reshape(-1, axes * modes)
    bent = (parts @ _modal_basis(statics.within, modes)).T
    starts = statics.within.onto_constraints(bent, np.zeros_like(bent))[0].T
    return starts[np.isfinite(starts).all(axis=1)]  # some bends are far from all supports


def _balanced(statics: Statics, u: float, starts: list[Array], longest: float) -> Array:
    """Solutions to which Newton's method leads from many starts, in batches, (k, integrated).

    Most solutions are listed once. A step is at most `longest` relative to 1 rad plus the size of
    x, and is quartered until the next step, by the same derivatives, would be shorter; a start
    whose step becomes too short is given up. In space, near half a turn, residuals rise on the way
    to some solutions.

    Source: Deuflhard (2004), Newton methods for nonlinear problems, sec. 3.3 (natural level).
    """
    found = np.zeros((0, statics.size))
    if not starts:
        return found
    for x in np.array_split(starts, math.ceil(len(starts) * statics.size**2 / BATCH_ENTRIES)):
        step, share, size = np.zeros_like(x), np.ones(len(x)), np.full(len(x), math.inf)
        slopes = np.broadcast_to(np.eye(statics.size), (*x.shape, statics.size)).copy()
        for _ in range(MOST_SEARCH_STEPS):
            moved = x + share[:, None] * step
            residual = statics.accelerations(moved, u)
            onward = np.linalg.norm(statics.steps(slopes, residual), axis=1)
            lower = onward <= (1.0 - 0.25 * share) * size
            share[~lower] *= 0.25
            x[lower] = moved[lower]
            if lower.any():
                slopes[lower] = statics.jacobian(x[lower], u)
                step[lower] = statics.steps(slopes[lower], residual[lower])
                size = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
                most = longest * (math.sqrt(statics.size) + np.linalg.norm(x, axis=1))
                share[lower] = np.minimum(1.0, most / size)[lower]
            solved = lower & (size <= SOLVED)
            found = np.concatenate([found, (x + step)[solved]])
            going = ~solved & (share > LEAST_SHARE) & (np.abs(x).max(axis=1) <= TEN_TURNS)
            x, step, slopes, share, size = (a[going] for a in (x, step, slopes, share, size))
            if not len(x):
                break
    _, first = np.unique(found.round(7), axis=0, return_index=True)
    return np.asarray(found[first])


# --------------------------------------------------------------------- branches over the flow speed


Change = Literal["fold", "pitchfork", "branch point", "hopf"]

SAME_FORK = 1e-6
"""Largest relative distance in speed from a pitchfork of a change that is that of the pitchfork."""

SINGULAR = 1e-6
"""Least singular value of a stiffness, relative to the next one, up to which a branch may leave:
at nine branch points it was 5e-12 at most, and 0.4 where the pipe meets a stop."""

BRANCH_STEP = 0.05
"""Longest step along a branch, as for `equilibrium_branch`, where none is given."""

MOST_POINTS = 4000
"""Most points of one branch: at the default step they reach 200 rad, three times `TEN_TURNS`."""


@saved_as("BranchPoint")
class BranchPoint(Result):
    """Point of a branch of equilibria at which its stability changes or it turns back.

    Attributes:
        kind: "fold", "pitchfork" (branches leave the straight pipe as mirror images, which is how
            it diverges), "branch point" (another real eigenvalue passes 0, as where branches leave
            the plane of a load) or "hopf" (flutter: a pair passes the axis).
        speed: flow speed u.
        frequency: angular frequency of the pair, in 1 / T; 0 unless "hopf".
        q: the configuration, shape (coordinates,).
        tip: position (x, y) of the free end, in three dimensions (x, y, z).
    """

    kind: Change
    speed: float
    frequency: float
    q: Array = field(repr=False)
    tip: Array


@saved_as("EquilibriumBranch")
class EquilibriumBranch(Configurations, TableResult):
    """A branch of equilibria, point by point along its arc length.

    Where the branch turns back or its stability changes, it has a point, with the stability that
    the eigenvalues off the imaginary axis give.

    Attributes:
        speeds: flow speed u, shape (S,).
        q: coordinates, shape (S, coordinates).
        stable: whether the equilibrium is stable, shape (S,).
        unstable: number of eigenvalues with positive real part, shape (S,).
        tips: position (x, y) of the free end in L, shape (S, 2), or (x, y, z), shape (S, 3).
        points: points at which the branch turns back or its stability changes, in order.
        ends: why the branch ends, at its first and its last point: "range" (of speeds), "pitchfork"
            (it joins its mirror image on the straight pipe), "branch point" (it joins its mirror
            image on bent rests, as in the plane of a load), "closed", "far" (a coordinate beyond 60
            rad), "points" (it has too many) or "not converged" (no next point was found).
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
        """Points at which the branch turns back in the flow speed."""
        return tuple(point for point in self.points if point.kind == "fold")

    @property
    def straight(self) -> bool:
        """Whether the branch is the straight pipe, whose shape is the same at every speed."""
        return not float(np.ptp(self.q, axis=0).max()) > 0.0

    def _columns(self) -> dict[str, Any]:
        return {
            "speed": self.speeds,
            "tip_x": self.tips[:, 0],
            "tip_y": self.tips[:, 1],
            **({"tip_z": self.tips[:, 2]} if self.tips.shape[1] == 3 else {}),
            "curvature": self.curvature,
            "stable": self.stable,
            "unstable": self.unstable,
            **numbered_columns("q", self.q),
        }


def equilibrium_branch(
    model: Model,
    q0: Start,
    u0: float,
    speeds: tuple[float, float],
    step: float = BRANCH_STEP,
) -> EquilibriumBranch:
    """The branch of equilibria through a given equilibrium, followed past folds in the speed.

    Args:
        model: chain, reduced model or scene, up to 500 degrees of freedom; each point costs the
            eigenvalues of a dense matrix, O(dof^3).
        q0: configuration near the equilibrium, as coordinates or an angle theta(s), as for
            `simulate`. Newton's method starts there, and leads at most half a radian away, as the
            root mean square along the pipe. In three dimensions it may lie out of the plane z = 0
            if the pipe is not the same in all directions.
        u0: flow speed of the equilibrium, within `speeds`.
        speeds: (lowest, highest) flow speed of the branch.
        step: longest step along the branch, in [1e-4, 1]: in rad, as the root mean square over
            the coordinates, and in tenths of the range of speeds.

    Returns:
        EquilibriumBranch; its first end is the one reached from q0 with falling speed.

    Example:
        >>> model = pp.Chain(pp.Pipe(0.2, -20.0), 2)
        >>> leaning = pp.equilibria(model, 1.0)
        >>> branch = pp.equilibrium_branch(model, leaning.q[1], 1.0, (0.0, 4.0))
        >>> branch.q.shape[1], float(branch.speeds.max()) <= 4.0
        (2, True)

    Raises:
        NotConverged: if there is no equilibrium near q0, or that equilibrium is a branch point.
        ValueError, TypeError: for bad arguments.

    Source: Keller (1977) for the continuation.
    """
    model = checked_model_in_motion(model, largest=EQUILIBRIA_DOF, purpose="equilibria")
    require_steady("speeds", speeds)
    low, high = map(float, check.array("speeds", speeds, size=2, low=0.0, high=LARGEST_SPEED))
    if not high - low >= 1e-9 * (1.0 + high):
        raise ValueError(f"speeds must be (lowest, highest), got ({low:g}, {high:g})")
    require_steady("u0", u0)
    u0 = check.real("u0", u0, low=low, high=high)
    step = check.real("step", step, low=1e-4, high=1.0)
    statics, start = statics_of(model, from_start(model, "q0", q0))
    with one_thread(model.dof):
        try:
            x = statics.solved(start, u0)
        except NewtonFailed as error:
            raise NotConverged(f"no equilibrium was found near q0 at u = {u0:g}") from error
        away = float(rms_along(statics.angles((x - start)[None]))[0])
        if away > NEAR:
            raise NotConverged(
                f"no equilibrium was found near q0 at u = {u0:g}: Newton's method leads to one "
                f"that lies {away:.3g} rad away, more than {NEAR:g}"
            )
        return _branch_through(statics, x, u0, (low, high), step)


def offshoots(
    model: Model, point: BranchPoint, speeds: tuple[float, float], marks: Sequence[float]
) -> list[EquilibriumBranch]:
    """The branch out of a plane, and its mirror images, that leave another one at a point.

    There a real eigenvalue passes 0, whose small motion breaks a mirror symmetry; of other points,
    and where the branch stays in the plane z = 0, the result is empty.

    Args:
        model: model in three dimensions.
        point: the point, of a branch of the model.
        speeds: (lowest, highest) flow speed of the branch.
        marks: flow speeds at which the branch is to have points.

    Raises:
        NewtonFailed: if no equilibrium is found beside the point.
    """
    statics, u = StaticsInSpace(model), point.speed
    x = from_start(model, "point", point.q)
    with one_thread(model.dof):
        free, mirrors = model.free_directions(x), statics.mirrors(u)
        _, (*_, second, least), rows = np.linalg.svd(statics.matrices(x, u, 0)[2])
        if least > SINGULAR * second:  # where the pipe meets a stop, stiffnesses jump past 0
            return []
        away = free @ rows[-1]
        away *= np.sign(away[np.abs(away).argmax()])
        broken = [
            max(np.abs(one * x - x).max(), np.abs(one * away + away).max()) <= DISTINCT
            for one in mirrors
        ]
        if not any(broken) or (model.lies_in_plane(x) and model.lies_in_plane(away)):
            return []
        problem = _problem(statics, speeds, BRANCH_STEP)
        start = problem.starting(np.append(x, u), np.append(away, 0.0))
        beside = problem.at(start, 0.2 * BRANCH_STEP)
        if not speeds[0] <= beside.p <= speeds[1]:
            return []
        found = [_branch_through(statics, beside.x, beside.p, speeds, BRANCH_STEP, marks)]
    for signs in mirrors:
        q = signs * found[0].q
        if all(np.abs(q - other.q).max() > DISTINCT for other in found):
            points = tuple(
                replace(one, q=signs * one.q, tip=model.tip(signs * one.q))
                for one in found[0].points
            )
            found.append(replace(found[0], q=q, tips=model.tips(q.T), points=points))
    return found


def _problem(statics: Statics, speeds: tuple[float, float], step: float) -> DenseProblem:
    """The equations of rest, with a tenth of the range of speeds as long as a change of 1 rad."""
    scale = 0.1 * (speeds[1] - speeds[0])
    return DenseProblem(statics.equations, statics.size, scale, Control(longest=step))


def _branch_through(
    statics: Statics,
    x: Array,
    u0: float,
    speeds: tuple[float, float],
    step: float,
    marks: Sequence[float] = (),
) -> EquilibriumBranch:
    """The branch through an equilibrium x at a speed, as for `equilibrium_branch`.

    It has a point at each of the speeds `marks`.
    """
    branch, rest = _problem(statics, speeds, step), statics.straightened(x)
    if statics.always_rests and statics.rms(x - rest) < 1e-9:
        x, branch.equations = rest, partial(statics.at_rest, rest)
    try:
        down = branch.point(np.append(x, u0), np.append(np.zeros_like(x), -1.0))
    except NewtonFailed as error:
        raise NotConverged(f"the equilibrium at u = {u0:g} is a branch point") from error
    back, ahead = (
        _EquilibriumTracer(statics, point, step, speeds, marks)
        for point in (down, Point(down.z, -down.tangent))
    )
    end = back.followed(branch)
    ends = end, "closed" if end == "closed" else ahead.followed(branch)
    points, growth = back.points[:0:-1] + ahead.points, back.growth[:0:-1] + ahead.growth
    q = statics.to_user(np.array([point.x for point in points]))
    unstable = np.array([np.count_nonzero(one > 0.0) for one in growth])
    return EquilibriumBranch(
        speeds=np.array([point.p for point in points]),
        q=q,
        stable=unstable == 0,
        unstable=unstable,
        tips=statics.model.tips(q.T),
        points=tuple(back.changes[::-1] + ahead.changes),
        ends=ends,
        model=statics.model,
    )


class _EquilibriumTracer(Tracer[DenseProblem]):
    """Tracer of a branch of equilibria, one way from one of its points.

    The branch gets a point wherever it passes the speed at which it began or one of the marks.
    """

    def __init__(
        self,
        statics: Statics,
        start: Point,
        longest: float,
        speeds: tuple[float, float],
        marks: Sequence[float],
    ) -> None:
        super().__init__([(-1, *speeds)], MOST_POINTS // 2, (NewtonFailed, NotResolved))
        self.statics, self.longest = statics, longest
        self.marks = [(-1, mark) for mark in (start.p, *marks)]
        self.points, self.growth = [start], [self._growth(start)]
        self.changes: list[BranchPoint] = []
        self.test: GrowthTest | None = None  # of the last step

    def followed(self, branch: DenseProblem) -> str:
        """Follows the branch, and returns why it ends."""
        start = self.points[0]
        steps = branch.steps(start, 0.2 * self.longest, self.marks)
        return self.one_way(steps, branch, start)[1]

    def note(self, step: BranchStep[DenseProblem]) -> str | None:
        """Keeps the end of a step and the changes on it; returns why the branch ends there.

        In an undamped pipe an eigenvalue is like the square root of the distance to a fold, so that
        by rounding the number of unstable eigenvalues changes next to the fold: both are one
        change, listed once.
        """
        statics, ds = self.statics, step.length
        fork, until = statics.meeting(step, 2.0 * self.longest) or (None, ds)

        def kind(before: float, s: float) -> Change:
            straight, passing = statics.straight(step.at(s).x), growth.positive(s)
            passing -= growth.positive(before)
            if straight and statics.model.axisymmetric:  # two planes alike
                passing //= 2
            if passing % 2 == 0:
                return "hopf"
            return "pitchfork" if straight else "branch point"

        self.test = growth = GrowthTest(
            step, 1e-10 * (1.0 + until), self._roots, kind, before=self.test
        )
        found = special_points(step, 1e-12 if fork is None else 0.0, [growth], until)
        turns = [s for name, _, s in found if name == "fold"]
        for name, before, beyond in found:
            s = beyond
            if name in ("branch point", "pitchfork"):
                most = math.inf if fork is None else 0.9 * until
                singular = self._singular(step, before, beyond, most)
                if singular is None and name == "branch point":
                    continue
                s = beyond if singular is None else singular
                # Right beside a pitchfork its own eigenvalue counts as neutral.
                same = fork is not None and abs(step.at(s).p / fork.p - 1.0) < SAME_FORK
                if same or any(abs(s - turn) <= 1e-3 * ds for turn in turns):
                    continue
            point = self._point(cast(Change, name), step.at(s))
            self.changes.append(point)
            if 1e-6 * ds < s < (1.0 - 1e-6) * ds:  # otherwise the end of the step is there
                z = np.append(step.at(s).x, point.speed)
                self._add(Point(z, step.at(s).tangent), growth.at(before), growth.at(beyond))
        if fork is None:
            self._add(step.end, growth.at(until))
            return "far" if float(np.abs(step.end.x).max()) > TEN_TURNS else None
        end: Change = "pitchfork" if statics.straight(fork.x) else "branch point"
        self.changes.append(self._point(end, fork))
        self._add(fork, self._growth(fork), growth.at(until))
        return end

    def _add(self, point: Point, *growth: Array) -> None:
        """Keeps a point with the growth of motions about it or, of a change, on both its sides.

        An eigenvalue on the axis does not count as unstable.
        """
        self.points.append(point)
        self.growth.append(min(growth, key=lambda one: np.count_nonzero(one > 0.0)))

    def _growth(self, point: Point) -> Array:
        """The growth of small motions about an equilibrium, as `Statics.growth` gives it."""
        return self.statics.growth(point.x, abs(point.p))

    def _roots(self, point: Point) -> Complex:
        """The eigenvalues of small motions about an equilibrium."""
        return self.statics.eigenvalues(point.x, abs(point.p))

    def _singular(
        self, step: BranchStep[DenseProblem], before: float, beyond: float, until: float
    ) -> float | None:
        """Arc length near a change of one real eigenvalue at which a stiffness K is singular.

        None is returned if there is none: right beside folds and forks the count of unstable
        eigenvalues also changes where an eigenvalue rises above its rounding.
        """
        near, statics = 0.1 * step.length, self.statics
        low, high = before - near, min(beyond + near, until)
        for plane in statics.planes:
            if plane and statics.model.axisymmetric:  # singular anywhere, by a turn about the axis
                return beyond

            def determinant(s: float, plane: int = plane) -> float:
                point = step.at(s)
                stiffness = statics.matrices(point.x, abs(point.p), plane)[2]
                sign, log = np.linalg.slogdet(stiffness)
                return float(sign * np.exp(log / len(stiffness)))

            if determinant(low) * determinant(high) < 0.0:
                return zero_between(determinant, low, high)
        return None

    def _point(self, kind: Change, point: Point) -> BranchPoint:
        statics, speed, frequency = self.statics, abs(point.p), 0.0
        if kind == "hopf":
            found = statics.eigenvalues(point.x, speed)
            oscillating = found[np.abs(found.imag) > 1e-6]
            if oscillating.size:
                crossing = np.argmin(np.abs(oscillating.real))
                frequency = float(abs(oscillating[crossing].imag))
        q = statics.to_user(point.x[None])[0]
        return BranchPoint(kind, speed, frequency, q, statics.model.tips(q[:, None])[0])
