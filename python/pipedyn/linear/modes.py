# SPDX-License-Identifier: MIT
"""Eigenvalues, modes and root loci of any model."""

from __future__ import annotations

import math
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn import _core
from pipedyn.linear.eigenproblem import eigenproblem, select_pairs
from pipedyn.linear.neutral import grows
from pipedyn.linear.reach import Reach
from pipedyn.linear.rest import at_rest
from pipedyn.models.base import DENSE_LIMIT, Model
from pipedyn.models.continuum import (
    TOLERANCE,
    AnyModel,
    Continuum,
    checked_model,
    converged_answer,
    relative,
)
from pipedyn.models.drive import LARGEST_SPEED, steady_speed
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import NotConverged
from pipedyn.util.parallel import one_thread
from pipedyn.util.result import RATE, Result, TableResult

LARGEST_FULL = _core.dense_limit
"""Largest number of degrees of freedom at which all eigenvalues are computed at once."""

LARGEST_VECTORS = 10_000_000
"""Largest number of eigenvalues times degrees of freedom: work arrays then take 1 GB."""

CONTINUUM_SPEED, CONTINUUM_COUNT = 1000.0, 400
"""Largest u and count for a `Continuum`, whose basis grows with both. At u = 1000, eigenvalues from
640 and 816 functions differ by 3e-9, which is rounding, so that larger bases do not help; 400
eigenvalues need dense problems of 816 rows, which take a second each."""

FEW_MODES = 64
"""Number of modes up to which all roots of a model are computed anyway."""

CLUSTER_APART = 0.5
"""Largest square of the last wave number that the flow reaches, times the damping, at which growing
roots lie before the cluster at -1 / damping."""

CLUSTER = 1e-6
"""Relative distance from |lambda| = 1 / damping within which a root belongs to the cluster."""


def eigenvalues(model: AnyModel, u: float, count: int | None = None) -> Complex:
    """Eigenvalues lambda of a pipe at rest at flow speed u; motions go as exp(lambda tau).

    The pipe is straight, or bent as in the rest that follows from that without flow, or as in
    `model.about(q)`.

    Args:
        model: chain, reduced model or `Continuum`.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        count: number of eigenvalues, from the lowest |lambda|; default: all 2 dof. Long chains
            (beyond 64 segments) are solved in O(n) for a small count. A `Continuum` needs a count.

    Returns:
        Complex array (count,), sorted by |lambda|; conjugates are neighbours, the upper one first
        (an odd count may cut the last pair). With hysteresis it contains the pairs that oscillate
        and the real roots that grow, see `Pipe.hysteresis`; under strong damping these may be fewer
        than 2 dof. Eigenvalues of a damped `Continuum` accumulate at -1 / damping, so that only
        those with |lambda| < 1 / damping are returned, which may be fewer than count.

    Example:
        >>> found = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2)), 4.0, count=4)
        >>> found.round(3)
        array([-4.755 +4.012j, -4.755 -4.012j, -2.526+17.036j, -2.526-17.036j])

    Raises:
        NotConverged: if the residual of an eigenvalue is too large; `result` has all of them as
            `Modes`, whose `converged` is False for those that fail.
        ValueError, TypeError: for arguments out of range or of a wrong type.

    Source: chains and straight models in Legendre curvatures are solved by elimination along the
    pipe, see `cpp/pipedyn/linear/structured.hpp`; other models by the inverse problem, see
    `cpp/pipedyn/linear/operator.hpp`.
    """
    model, u, count = _checked_question(model, u, count)
    model = at_rest(model, u)
    if isinstance(model, Model):
        model.require_equilibrium(u)
        asked, problem, pairs = 2 * model.dof if count is None else count, eigenproblem(model), None
        if model.linear_cost and not model.pipe.hysteresis:
            with one_thread(problem.rows):
                pairs = problem.spectrum().by_recursion(u, asked, vectors=False)
        if pairs is None or not pairs.converged.all():
            pairs = problem.lowest(u, asked)
        if pairs.converged.all():
            return pairs.values
    found = roots_and_shapes(model, u, count)
    bad = np.flatnonzero(~found.converged)
    if bad.size:
        raise NotConverged(
            f"{bad.size} of {found.converged.size} eigenvalues at u = {found.speed:g} failed their "
            f"residual check, the first at index {bad[0]} with {found.residuals[bad[0]]:.1e}",
            found,
        )
    return found.eigenvalues


@saved_as("ModeShape")
class ModeShape(Result):
    """Complex transverse displacement of one mode, scaled to be 1 where its magnitude is largest.

    Attributes:
        eigenvalue: eigenvalue lambda of the mode.
        model: the model whose mode it is.
        coordinates: coordinates q of the mode, complex, shape (dof,).

    In SI the eigenvalue is in 1/s; the size of a mode is arbitrary, so its shape stays as it is.
    """

    eigenvalue: complex
    model: Model = field(repr=False)
    coordinates: Complex = field(repr=False, compare=False)

    def __call__(self, s: ArrayLike) -> Complex:
        """Complex displacement at arc lengths s in [0, 1], shape (len(s),).

        In three dimensions, of a pipe that is not the same in all directions, the shape is
        (2, len(s)): displacements along x and along z. The motion is Re(shape(s) exp(lambda tau)).

        Raises:
            NotConverged: if the mode was not found.
            ValueError, TypeError: for arc lengths out of range or of a wrong type.
        """
        if not np.isfinite(self.coordinates).all():
            raise NotConverged(f"the mode of eigenvalue {self.eigenvalue:g} was not found")
        return np.asarray(self.model.deflection(self.coordinates, s), dtype=np.complex128)


@saved_as("Modes", added=("across",))
class Modes(TableResult, units={"errors": RATE}):
    """Eigenvalues and modes at one flow speed.

    Attributes:
        speed: flow speed u.
        eigenvalues: lambda, complex, shape (count,), sorted by |lambda|: the root in the upper half
            plane of each conjugate pair, and real roots. NaN if double precision cannot represent
            one.
        shapes: a function of arc length for each eigenvalue.
        residuals: relative residual of each pair, shape (count,).
        converged: whether the residual of each pair is small enough, shape (count,).
        size: number of degrees of freedom of the model that was solved.
        discretisation: for `Continuum`, the largest change of an eigenvalue from the basis before
            the last to the last, relative to the larger of the eigenvalue and 1; None for other
            models.
        across: of a model in three dimensions whose pipe is bent by a load or has terms that differ
            in x and z, whether each mode is across the plane z = 0, shape (count,); None for other
            models.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=5)
        >>> found = pp.modes(chain, 4.0, count=2)
        >>> found.eigenvalues.round(3)
        array([-4.966 +3.99j , -2.101+15.318j])
        >>> abs(found.shapes[0]([0.0, 0.5, 1.0])).round(3)
        array([0.   , 0.271, 1.   ])
    """

    speed: float
    eigenvalues: Complex
    shapes: tuple[ModeShape, ...] = field(repr=False)
    residuals: Array = field(repr=False)
    converged: NDArray[np.bool_] = field(repr=False)
    size: int
    discretisation: float | None = None
    across: NDArray[np.bool_] | None = None

    @cached_property
    def errors(self) -> Array:
        """Bound, to first order, on the absolute error of each eigenvalue, shape (count,).

        It is the residual and rounding times the condition number of the eigenvalue, plus the
        `discretisation` for `Continuum`. The condition number needs left eigenvectors, which are
        computed at the first request.
        """
        problem = eigenproblem(self.shapes[0].model)
        # Conjugates that are no modes are among the lowest roots, too.
        roots = self.eigenvalues.size + int(np.nansum(np.sign(self.eigenvalues.imag)))
        highest = np.nanmax(np.abs(self.eigenvalues), initial=0.0)
        pairs, most = problem.lowest(self.speed, roots, left=True), 2 * problem.dof
        while roots < most and np.nanmax(np.abs(pairs.values), initial=0.0) < highest:
            roots = min(2 * roots, most)  # a mode that grows may lie above others left out
            pairs = problem.lowest(self.speed, roots, left=True)
        errors = np.full(self.eigenvalues.size, np.inf)
        good = np.flatnonzero(np.isfinite(self.eigenvalues))
        values = self.eigenvalues[good]
        there = np.nan_to_num(pairs.values)
        same = np.abs(there[:, None] - values).argmin(axis=0)
        # These pairs are refined, so that their residuals differ from those of the eigenvalues
        # above.
        right, left = pairs.right[:, same], pairs.left[:, same]
        found = _core.Pairs(values, right, left, self.residuals[good])
        errors[good] = problem.errors(self.speed, found)
        errors[good] += (self.discretisation or 0.0) * np.maximum(np.abs(values), 1.0)
        return errors

    def _columns(self) -> dict[str, Any]:
        values = self.eigenvalues
        columns = {
            "growth_rate": values.real,
            "frequency": values.imag,
            "damping_ratio": -values.real / np.abs(values),
            "residual": self.residuals,
            "converged": self.converged,
        }
        return columns if self.across is None else columns | {"across": self.across}


def modes(model: AnyModel, u: float, count: int | None = None) -> Modes:
    """Complex mode shapes of a pipe at rest at flow speed u, with their eigenvalues.

    The rest is that of `eigenvalues`. In three dimensions a pipe that is not the same in all
    directions across its axis has modes in the plane z = 0 and others across it.

    Args:
        model: chain, reduced model or `Continuum`.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        count: least number of modes, from the lowest |lambda|, at most dof (dof / 4 for a long
            chain); default: all. A conjugate pair of eigenvalues is one mode, and so is a real
            eigenvalue. A `Continuum` needs a count.

    Returns:
        Modes. Higher modes follow the lowest if they grow, so that no instability is missed: all
        that do up to 64 degrees of freedom; in larger models and the continuous pipe those that
        flow and weight can make unstable, for which all roots are computed if damping is strong;
        none of an aspirating pipe without damping, all modes of which grow. `converged` is False
        for those with a large residual. There may be fewer than count, if `eigenvalues` would
        return fewer than 2 count.

    Example:
        >>> found = pp.modes(pp.Chain(pp.Pipe(0.2), 10), 4.0, count=2)
        >>> found.eigenvalues.round(2), len(found.shapes)
        (array([-4.8  +4.01j, -2.42+16.61j]), 2)
        >>> hose = pp.Pipe(0.225, gamma=998.0)  # flutters in its fifth mode
        >>> pp.modes(pp.Continuum(hose), 24.0, count=1).eigenvalues.round(1)
        array([-34.3 +30.8j,  11.8+169.8j])

    Raises:
        NotConverged: if the continuous pipe's eigenvalues do not converge as the basis grows, or
            if all of them have |lambda| above 1 / damping.
        ValueError, TypeError: for arguments out of range or of a wrong type.
    """
    model, u, count = _checked_question(model, u, count, roots=2)
    roots = None if count is None else 2 * count
    found = roots_and_shapes(model, u, roots, *_looked_at(model, u))
    above = np.flatnonzero(~(found.eigenvalues.imag < 0.0))
    growing = above[grows(np.nan_to_num(found.eigenvalues[above]))]
    return _selected(found, np.union1d(above[:count], growing))


def feeds_every_mode(model: AnyModel) -> bool:
    """Whether the smallest flow makes all modes grow, as in an aspirating pipe without damping."""
    pipe = model.pipe
    damped = pipe.damping or pipe.hysteresis or model.resisted
    return pipe.flow == "aspirating" and pipe.beta > 0.0 and not (pipe.end_held or damped)


def _looked_at(model: AnyModel, u: float) -> tuple[float, int]:
    """Number of lowest roots among which growing ones are looked for, and of modes among them.

    If damping is strong, growing roots may lie beyond the cluster of overdamped ones at -1 / delta:
    they are looked for among all roots.
    """
    if feeds_every_mode(model):
        return 0, 0
    reach, delta = Reach(model.pipe), model.pipe.damping
    if isinstance(model, Continuum):
        few = math.ceil(reach.modes_reached(u)) + 2
    elif model.dof <= FEW_MODES:
        few = model.dof
    else:
        few = min(reach.modes_within(u), LARGEST_VECTORS // (2 * model.dof))
    damped = delta * (math.pi * reach.modes_reached(u)) ** 2 > CLUSTER_APART
    every = isinstance(model, Continuum) or 2 * model.dof**2 <= LARGEST_VECTORS
    return (math.inf if damped and every else 2 * few), few


def roots_and_shapes(
    model: AnyModel, u: float, count: int | None, searched: float = 0, reached: int = 0
) -> Modes:
    """The lowest `count` eigenvalues, with both of each conjugate pair, and their mode shapes.

    Those of the lowest `searched` eigenvalues that grow follow, if they are not among these. The
    basis of the continuous pipe has at least twice as many functions as modes are `reached`.
    """
    found = converged_answer(
        at_rest(model, u),
        (u,),
        lambda one: _modes(at_rest(one, u), u, count, searched),
        partial(_basis_change, model.pipe, searched == math.inf),
        smallest=max(16, count or 0, 2 * reached),
    )
    if not isinstance(model, Continuum):
        return found.value
    answer = _without_cluster(found.value, model.pipe, searched == math.inf)
    if not answer.eigenvalues.size:
        raise NotConverged(
            f"no eigenvalue lies below |lambda| = 1 / damping = {1.0 / model.pipe.damping:.6g}, "
            "where those of the continuous pipe accumulate",
            answer,
        )
    return replace(answer, size=found.size, discretisation=found.error)


def _selected(found: Modes, chosen: NDArray[np.intp]) -> Modes:
    """Modes with only some of their eigenvalues."""
    return replace(
        found,
        eigenvalues=found.eigenvalues[chosen],
        shapes=tuple(found.shapes[i] for i in chosen),
        residuals=found.residuals[chosen],
        converged=found.converged[chosen],
        across=None if found.across is None else found.across[chosen],
    )


def _without_cluster(found: Modes, pipe: Pipe, growing: bool) -> Modes:
    """Modes of the continuous pipe with |lambda| below the cluster due to damping, or `growing`.

    Infinitely many overdamped roots tend to -1 / delta, so that a count of roots has no meaning
    near it.
    """
    delta = pipe.damping / abs(1.0 + 1j * pipe.hysteresis)
    if not delta:
        return found
    values = found.eigenvalues
    kept = np.abs(values) * delta < 1.0 - CLUSTER
    if growing:
        kept |= grows(np.nan_to_num(values))
    return _selected(found, np.flatnonzero(kept))


def _basis_change(pipe: Pipe, growing: bool, before: Modes, after: Modes) -> float:
    """Relative change of modes not in the cluster from one basis to the next, beyond rounding.

    If neither basis has such a mode, it is the change of the lowest one.

    Under strong damping at high speed, rounding alone changes them by more than the tolerance. A
    larger basis does not help then, and `errors` of the modes gives the size of rounding.
    """
    apart = [_without_cluster(one, pipe, growing) for one in (before, after)]
    if not any(one.eigenvalues.size for one in apart):
        return relative(before.eigenvalues[:1], after.eigenvalues[:1])
    before, after = apart
    moved = relative(before.eigenvalues, after.eigenvalues)
    if not TOLERANCE < moved < 100.0 * TOLERANCE:  # errors cost as much as the eigenvalues
        return moved
    return relative(before.eigenvalues, after.eigenvalues, before.errors + after.errors)


def largest_speed(model: AnyModel | None) -> float:
    """Largest flow speed of a sweep with a model, or with one not known yet (None)."""
    return CONTINUUM_SPEED if isinstance(model, Continuum) else LARGEST_SPEED


def _checked_question(
    model: AnyModel, u: Any, count: Any, roots: int = 1
) -> tuple[AnyModel, float, int | None]:
    """The model, flow speed and count, checked, where each answer has this number of roots."""
    model = checked_model(model)
    u = steady_speed("u", u)
    if count is None:
        if isinstance(model, Continuum):
            raise ValueError("count must be given for a Continuum: its eigenvalues have no end")
        if model.dof > LARGEST_FULL:
            raise ValueError(
                f"count must be given beyond {LARGEST_FULL} degrees of freedom, got {model.dof}"
            )
        return model, u, None
    if isinstance(model, Continuum):
        most = CONTINUUM_COUNT
    else:  # of a long chain, some roots are computed at once
        most = 2 * model.dof if model.dof <= DENSE_LIMIT else model.dof // 2
    return model, u, checked_count(count, model, most // roots)


def checked_count(count: Any, model: AnyModel, most: int) -> int:
    """The argument count, checked to be at most `most`, and its vectors to fit into memory."""
    asked = check.count("count", count, high=most)
    if isinstance(model, Model) and asked * model.dof > LARGEST_VECTORS:
        raise ValueError(
            f"count must be at most {LARGEST_VECTORS // model.dof} for {model.dof} degrees of "
            f"freedom, got {asked}"
        )
    return asked


def neutral_shape(
    model: Model, u: float, frequency: float, across: bool | None = None
) -> ModeShape:
    """Shape of the mode at flow speed u whose eigenvalue is i times frequency, up to rounding.

    In three dimensions it is that of a motion across the plane of rest, or in it.

    It is computed by inverse iteration, which converges in one step so near to an eigenvalue.
    """
    value = complex(0.0, frequency)
    mass, velocity, stiffness = model.operators().at(u)
    if frequency == 0.0:  # hysteresis does not act on static loads
        stiffness = stiffness.real
    dynamic = value**2 * mass + value * velocity + stiffness
    x = np.linspace(1.0, 2.0, len(mass)) + 0j
    if across is not None:
        np.split(x, 2)[not across][:] = 0.0
    with one_thread(len(mass)):
        dynamic = dynamic + np.finfo(float).eps * np.linalg.norm(dynamic) * np.eye(len(mass))
        for _ in range(3):
            x = np.linalg.solve(dynamic, x)
            x /= np.linalg.norm(x)
    count_factorisations(3)
    (shape,) = _shapes(model, np.array([value]), np.asarray(x[:, None], dtype=np.complex128))
    return shape


def _shapes(model: Model, values: Complex, coordinates: Complex) -> tuple[ModeShape, ...]:
    """Shapes of modes from their coordinates, (dof, k), which are NaN for modes not found."""
    displacement = model.deflection(np.nan_to_num(coordinates), model.stations)
    displacement = displacement.reshape(-1, displacement.shape[-1])  # along x, then along z
    largest = np.argmax(np.abs(displacement), axis=0)
    peaks = displacement[largest, np.arange(largest.size)]
    with np.errstate(divide="ignore", invalid="ignore"):
        coordinates = coordinates / peaks
    return tuple(
        ModeShape(complex(value), model, coordinates[:, i].copy()) for i, value in enumerate(values)
    )


def _modes(model: Model, u: float, count: int | None, searched: float) -> Modes:
    """The lowest `count` modes of one model, or all if it is None, and those that grow.

    Growing modes are looked for among the lowest `searched`.
    """
    every = 2 * model.dof
    count = every if count is None else count
    problem = eigenproblem(model)
    pairs = problem.lowest(u, int(min(max(count, searched), every)))
    if searched > count:
        values = np.nan_to_num(pairs.values)
        kept = np.flatnonzero((np.arange(values.size) < count) | grows(values))
        pairs = select_pairs(pairs, kept)
    shapes = _shapes(model, pairs.values, model.from_elastic(pairs.right))
    checks = pairs.residuals, pairs.converged
    across = problem.is_across(pairs) if model.dimensions == 3 else None
    return Modes(u, pairs.values, shapes, *checks, model.dof, across=across)
