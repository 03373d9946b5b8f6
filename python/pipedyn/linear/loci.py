# SPDX-License-Identifier: MIT
"""Root loci of any model: eigenvalues as functions of the flow speed."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.continuation.arclength import BranchStep, DenseProblem
from pipedyn.linear.bent_crossings import RootsFollowed
from pipedyn.linear.critical_speed import (
    count_resolved,
    is_searchable,
    only_answer,
    stability_losses,
    unstable_at_rest,
)
from pipedyn.linear.eigenproblem import Eigenproblem, eigenproblem, select_pairs
from pipedyn.linear.following import RootFollower, matched
from pipedyn.linear.modes import (
    CONTINUUM_COUNT,
    LARGEST_FULL,
    LARGEST_VECTORS,
    checked_count,
    feeds_every_mode,
    largest_speed,
)
from pipedyn.linear.reach import Reach, is_overdamped
from pipedyn.linear.rest import BranchOfRest, at_rest, lost_rest, rest_follows
from pipedyn.linear.sensitivity import Crossing, of_each
from pipedyn.models.base import Model
from pipedyn.models.continuum import (
    AnyModel,
    Continuum,
    Converged,
    checked_model,
    converged_answer,
    relative,
)
from pipedyn.models.drive import require_steady
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array, Complex
from pipedyn.util.counters import count_factorisations
from pipedyn.util.errors import BranchesMissing, NotConverged, warn_caller
from pipedyn.util.parallel import Progress, one_thread
from pipedyn.util.result import RATE, TableResult

MOST_ADDED = 30
"""Largest number of branches that are followed beyond those asked for: more do not fit a picture.
Of an aspirating pipe with little damping, hundreds of modes grow."""

OF_OLD_FILE = "the file is of a version that did not look for other modes that grow"

RESOLVING = 24
"""Size beyond the largest wave number of a basis that is searched for growing modes."""

SAME_ROOT = 1e-5
"""Distance of two roots, over 1 + |lambda|, within which they are one root computed twice: near a
meeting, rounding moves both by its square root."""

OF_BRANCHES = ("eigenvalues", "partners", "errors", "converged")
"""Fields of `RootLoci` with a row for each speed and a column for each branch."""

NEUTRAL = 1e-6
"""Real part over 1 or |lambda| above which a root grows whatever the bound on its error, and
largest change of a growing root from one basis to the next."""

BESIDE_CROSSING = 1e-3
"""Distance from a crossing, over 1 + its speed, within which growing roots are not counted: there
the bound on the error of a root may be larger than its real part."""


@saved_as("RootLoci", added=("modes", "complete", "across", "missing"))
class RootLoci(TableResult, units=dict.fromkeys(("error", "errors"), RATE)):
    """Eigenvalues as functions of the flow speed, one branch in each of B columns.

    Attributes:
        speeds: flow speeds u, shape (S,).
        eigenvalues: lambda, complex, shape (S, B); a branch starts in the upper half plane, or on
            the real axis with the greater root of a pair.
        partners: the other root of each pair, shape (S, B): the conjugate while the pair is
            complex, the other real root while it is not, NaN where that is not known. With
            hysteresis, branches follow oscillating roots and the real roots that grow, which are
            those without it. Eigenvalues are NaN where strong damping leaves a branch without such
            a root, or where it is not known which overdamped root a growing one continues.
        converged: whether the residual of each eigenvalue is small enough, shape (S, B).
        errors: bounds, to first order, on the absolute error of each eigenvalue or its partner,
            shape (S, B): residual and rounding times the condition number, so that they are
            large where two roots meet. For `Continuum` the largest change from the basis before the
            last is added; bounds are infinite for overdamped roots, which need not converge.
        size: number of degrees of freedom of the model that was solved.
        pipe: the pipe of the model.
        modes: number of the mode of each branch, from 1, shape (B,), increasing. Modes are counted
            from the lowest at rest, as in `Crossing.mode`; for a model that does not rest without
            flow where it is linearised, at the first speed. It is 0 for the last branches, if these
            grow but have no number, since damping is so strong that they come from roots that do
            not oscillate.
        complete: whether every mode that grows at a speed in the range has a branch, as far as
            `crossings` finds these modes or, if this search fails, the roots at the speeds and
            their slopes tell; False in files of versions that did not look for them.
        across: of a model in three dimensions whose pipe is bent by a load or has terms that differ
            in x and z, whether the motions of each branch are across the plane z = 0, shape (B,);
            modes of both planes are counted apart. None for other models.
        missing: which modes grow, or may grow, without a branch, and how to get it; empty if all
            have one.

    Example:
        >>> chain = pp.Chain(pp.Pipe(0.2), n=5)
        >>> loci = pp.root_loci(chain, [0.0, 3.0, 6.0], count=2)
        >>> loci.eigenvalues.round(2)
        array([[  0.   +3.45j,   0.  +20.73j],
               [ -3.07 +3.61j,  -2.17+17.79j],
               [-11.35 +0.j  ,   1.73+13.17j]])
    """

    speeds: Array
    eigenvalues: Complex = field(repr=False)
    partners: Complex = field(repr=False)
    converged: NDArray[np.bool_] = field(repr=False)
    errors: Array = field(repr=False)
    size: int
    pipe: Pipe = field(repr=False)
    modes: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    complete: bool = False
    across: NDArray[np.bool_] | None = None
    missing: str = ""

    def __post_init__(self) -> None:
        if not (self.complete or self.missing):
            object.__setattr__(self, "missing", OF_OLD_FILE)
        if not self.modes.size:  # all from the first, as in files of versions without the field
            object.__setattr__(self, "modes", np.arange(1, self.eigenvalues.shape[1] + 1))

    def _columns(self) -> dict[str, Any]:
        count = self.eigenvalues.shape[1]
        planes = {} if self.across is None else {"across": np.tile(self.across, self.speeds.size)}
        columns = {
            "speed": np.repeat(self.speeds, count),
            "branch": np.tile(np.arange(count), self.speeds.size),
            "mode": np.tile(self.modes, self.speeds.size),
            "growth_rate": self.eigenvalues.real.ravel(),
            "frequency": self.eigenvalues.imag.ravel(),
            "error": self.errors.ravel(),
            "converged": self.converged.ravel(),
        }
        return columns | planes


def root_loci(
    model: AnyModel, speeds: ArrayLike, count: int | None = None, progress: bool = False
) -> RootLoci:
    """Branches of eigenvalues, followed continuously along the flow speed.

    Every mode that grows at a speed in the range has a branch, whatever the count, so that no
    instability is missed. Additional speeds are inserted where it is not clear which root continues
    which branch. The pipe is at rest, straight or bent, as for `eigenvalues`; about a bent rest,
    which is followed with the speed, a root goes on as the nearest one at the next rest.

    Args:
        model: chain, reduced model or `Continuum`.
        speeds: flow speeds u >= 0, strictly increasing, shape (S,).
        count: least number of branches, which are those of the lowest modes at rest (about a bent
            rest in three dimensions, of the lowest in each plane); default: four, or all of a model
            that has fewer. Branches of higher modes follow if they grow between
            the first speed and the last one, also if they do so only between two speeds: up to 30,
            those that lose stability first. If the smallest flow makes modes unstable, as all of an
            aspirating pipe without damping, only the lowest of these is added.
        progress: whether to show progress on stderr.

    Returns:
        RootLoci at the speeds asked for only. Its `modes` says which mode each branch is. If modes
        grow, or may grow, that have no branch, its `complete` is False, its `missing` and the
        warning `BranchesMissing` say which and how to follow them, and pictures show it.

    Example:
        >>> loci = pp.root_loci(pp.Chain(pp.Pipe(0.2), 10), np.linspace(0.0, 8.0, 41), count=3)
        >>> loci.eigenvalues.shape
        (41, 3)
        >>> hose = pp.Pipe(0.225, gamma=998.0)
        >>> pp.root_loci(pp.Continuum(hose), [0.0, 20.0, 24.0], count=2).modes
        array([1, 2, 5])

    Raises:
        NotConverged: if branches cannot be followed, in models of which not all roots are computed:
            beyond 2,000 degrees of freedom, and if the smallest flow makes all modes grow.
        ValueError, TypeError: for arguments out of range or of a wrong type.
    """
    model = checked_model(model)
    require_steady("speeds", speeds)
    at = check.array("speeds", speeds, low=0.0, high=largest_speed(model), longest=100_000)
    if np.any(np.diff(at) <= 0.0):
        raise ValueError("speeds must be strictly increasing")
    planes = model.dimensions - 1
    most = CONTINUUM_COUNT if isinstance(model, Continuum) else model.dof // planes
    count = checked_count(min(4, most) if count is None else count, model, most)
    shown = check.flag("progress", progress)
    rests, dense, bent = _rests_without_flow(model), True, rest_follows(model)
    searched = not feeds_every_mode(model)
    if isinstance(model, Model):
        if not bent:
            model.require_equilibrium(float(at[0]), float(at[-1]))
        most, dense = min(most, LARGEST_VECTORS // model.dof), model.dof <= LARGEST_FULL
        few = rests and not (bent or model.pipe.hysteresis)
        searched &= dense or (few and is_searchable(model, float(at[-1])))
    # A bent pipe rests at one speed, whose roots decide.
    growing = _GrowingModes([], at, np.full(at.size, math.inf if searched else 0.0))
    highest, loci = count, None
    if not searched:
        growing = replace(growing, missing=_not_searched(model, count, most))
    elif rests:
        growing = _growing_modes(model, at, count, most)
        added = min(max([count, *growing.added]), most)
        highest = count if is_overdamped(model.pipe, added) else added
    try:
        loci = branches_followed(model, growing.speeds, highest, shown)
        known = np.isfinite(growing.roots).all() and not is_overdamped(model.pipe, highest)
        if model.pipe.hysteresis and known:
            loci = _with_static_roots(loci, model)
    except NotConverged:
        if not (searched and dense) or bent:
            raise
    missing = growing.missing
    # With hysteresis, a twin of a growing real root may be counted in place of another root.
    unsure = searched and model.pipe.hysteresis > 0.0
    if loci is not None and (bent or not dense or missing):  # no other roots are followed then
        if growing.are_missing_in(loci):
            unknown = "other modes than these may grow: take a larger count"
            missing = missing or (unknown if dense else _not_searched(model, count, most))
    elif loci is None or unsure or growing.are_missing_in(loci):
        from_rest = [0.0] if loci is None and rests else []
        speeds = np.union1d(from_rest, growing.speeds)
        loci, left = _with_growing_roots(model, loci, speeds, highest)
        missing = missing or left
    every = isinstance(model, Model) and np.count_nonzero(loci.modes) == model.dof
    if every and not model.pipe.hysteresis:
        missing = ""  # all modes of the model have a branch
    wanted = np.isin(loci.modes, [*range(1, count + 1), *growing.added])
    kept = np.flatnonzero(wanted | _growing_roots(loci).any(axis=0))
    rows = np.isin(loci.speeds, at)
    if missing:
        warn_caller(BranchesMissing, missing, __name__)
    return replace(
        loci,
        speeds=at,
        **{name: getattr(loci, name)[rows][:, kept] for name in OF_BRANCHES},
        modes=loci.modes[kept],
        across=None if loci.across is None else loci.across[kept],
        complete=not missing,
        missing=missing,
    )


def _not_searched(model: AnyModel, count: int, most: int) -> str:
    """Which modes have no branch, where it is known that all grow, or not known which do."""
    if not feeds_every_mode(model):
        return (
            f"modes beyond {count} may grow, which with damping, inflow or loads only a chain of "
            f"up to {LARGEST_FULL} segments tells: take fewer"
        )
    every = "without damping inflow makes all modes grow, and"
    if isinstance(model, Continuum):
        return f"{every} those beyond {count} have no branch: take a larger count"
    asked = f"count={model.dof}" if model.dof <= most else "a larger count"
    return f"{every} {model.dof - count} of {model.dof} have no branch: take {asked}"


def _clearly_grow(roots: Complex) -> NDArray[np.bool_]:
    """Which roots grow whatever the bounds on their errors."""
    return roots.real > NEUTRAL * np.maximum(np.abs(roots), 1.0)


def _growing_roots(loci: RootLoci) -> NDArray[np.int64]:
    """Number of roots of each branch that grow at each speed, 0 to 2, shape (S, B).

    The bound on the errors is one for both roots, of which one may be in the cluster.
    """
    both = (loci.eigenvalues, loci.partners)
    return np.sum([(root.real > loci.errors) | _clearly_grow(root) for root in both], axis=0)


def _with_static_roots(loci: RootLoci, model: AnyModel) -> RootLoci:
    """Branches of a pipe with hysteresis, on which its growing real roots replace other roots.

    Hysteresis does not act on static motions, so that its growing real roots are those of the pipe
    without hysteresis.
    """
    lossless = model.with_pipe(replace(model.pipe, hysteresis=0.0))
    static = branches_followed(lossless, loci.speeds, int(loci.modes.max()))
    flutters = _clearly_grow(loci.eigenvalues) & (loci.eigenvalues.imag > loci.eigenvalues.real)
    grows, both = (
        (root.imag == 0.0) & _clearly_grow(root) & ~flutters
        for root in (static.eigenvalues, static.partners)
    )
    taken = {
        name: np.where(grows, getattr(static, name), getattr(loci, name))
        for name in ("eigenvalues", "converged", "errors")
    }
    # The oscillating root of the mode stays as the other root, unless it is the growing motion.
    other = np.where(loci.eigenvalues.real < 0.0, loci.eigenvalues, complex(math.nan, math.nan))
    partners = np.where(both, static.partners, np.where(grows, other, loci.partners))
    return replace(loci, **taken, partners=partners)


def _with_growing_roots(
    model: AnyModel, loci: RootLoci | None, speeds: Array, count: int
) -> tuple[RootLoci, str]:
    """Root loci in which every growing root has a branch, and what is missing if that is not so.

    Each growing root without a branch is followed from a speed at which it grows, so that no number
    of a mode is needed. If no branches are given, the lowest roots are followed from the first
    speed on.
    """
    at, missing, solved = speeds.tolist(), "", model
    if isinstance(model, Continuum):

        def all_roots(one: Model) -> tuple[Model, list[Complex]]:
            problem = eigenproblem(one)
            return one, [problem.lowest(u, 2 * problem.dof).values for u in at]

        smallest = max(16, 3 * count, math.ceil(at[-1]))
        try:
            found = model.converge(all_roots, _growing_move, NEUTRAL, smallest, smallest + 48).value
        except NotConverged as error:
            found = error.result
            missing = "growing roots of the continuous pipe do not converge: take a Chain"
        solved = found[0]
    assert isinstance(solved, Model)
    follower, delta, loss = RootFollower(solved), model.pipe.damping, model.pipe.hysteresis
    nothing = complex(math.nan, math.nan)

    def ends(root: Complex) -> NDArray[np.bool_]:
        return _overdamped(root, delta) | ((root.imag == 0.0) & (root.real < 0.0) & (loss > 0.0))

    if loci is None:
        none = np.empty((2, speeds.size, 0))
        values, partners = none.astype(np.complex128)
        columns = values, partners, none[0] > 0.0, none[0]
        across = np.empty(0, dtype=np.bool_) if model.dimensions == 3 else None
        loci = RootLoci(speeds, *columns, size=solved.dof, pipe=model.pipe, across=across)
        first = follower.at(at[0]).values.imag
        lowest = np.flatnonzero((first > 0.0) | ((first == 0.0) & (loss == 0.0)))[:count]
        starts = [(root, mode) for mode, root in enumerate(lowest.tolist(), 1)]
    else:
        loci, starts = _with_pairs_only(loci, follower), []
    known = loci.modes.size
    for row, u in enumerate(at):
        roots = follower.at(u)
        grow = _clearly_grow(roots.values) & (roots.values.imag >= 0.0)
        starts += [(root, 0) for root in np.flatnonzero(grow).tolist()]
        for root, mode in starts:
            value = roots.values[root]
            both = np.concatenate([loci.eigenvalues[row], loci.partners[row]])
            if (np.abs(both - value) < SAME_ROOT * (1.0 + abs(value))).any():
                continue
            if np.count_nonzero(loci.modes == 0) >= MOST_ADDED:
                missing = (
                    f"more than {MOST_ADDED} roots grow that continue no mode: end at lower speeds"
                )
                continue
            branch = follower.branch(at, row, root, ends)
            if loci.across is not None:
                loci = replace(loci, across=np.append(loci.across, roots.across[root]))
            apart = np.abs(loci.eigenvalues - branch[0][:, None])
            taken = (apart < SAME_ROOT * (1.0 + np.abs(branch[0][:, None]))).any(axis=1)
            for one, unknown in zip(branch, (nothing, nothing, math.inf), strict=True):
                one[taken] = unknown
            more: dict[str, Any] = {}
            for name, new in zip(OF_BRANCHES, (*branch, np.isfinite(branch[0])), strict=True):
                more[name] = np.column_stack([getattr(loci, name), new])
            loci = replace(loci, **more, modes=np.append(loci.modes, mode))
        starts = []
    if isinstance(model, Continuum):
        larger = eigenproblem(model.frozen(solved.dof + 8))
        for row, u in enumerate(at):
            there, here = larger.lowest(u, 2 * larger.dof).values, loci.eigenvalues[row, known:]
            moved = np.abs(here[:, None] - there).min(axis=1)
            loci.errors[row, known:] += np.where(_overdamped(here, delta), np.inf, moved)
            off = _clearly_grow(here) & (moved > NEUTRAL * (1.0 + np.abs(here)))
            loci.converged[row, known:] &= ~off
    return loci, missing


def _growing_move(a: tuple[Model, list[Complex]], b: tuple[Model, list[Complex]]) -> float:
    """Largest distance of a growing root of one model to the nearest root of another."""
    moved = 0.0
    for one, other in zip(a[1], b[1], strict=True):
        apart = np.abs(one[:, None] - other) / (1.0 + np.abs(one[:, None]))
        near = apart[_clearly_grow(one)].min(axis=1), apart[:, _clearly_grow(other)].min(axis=0)
        moved = max(moved, np.concatenate(near).max(initial=0.0))
    return moved


def _with_pairs_only(loci: RootLoci, follower: RootFollower) -> RootLoci:
    """Root loci without growing roots that are none of the pipe or no pair with the other root.

    With hysteresis each growing real root, on which it does not act, has a twin that oscillates.
    Where a pair that grows and a growing real root met, one branch may have a root of each.
    """
    loci = replace(loci, **{name: getattr(loci, name).copy() for name in OF_BRANCHES})
    nothing = complex(math.nan, math.nan)
    for row, u in enumerate(loci.speeds.tolist()):
        roots, values, partners = follower.at(u).values, loci.eigenvalues[row], loci.partners[row]
        apart = np.abs(values[:, None] - roots).min(axis=1, initial=math.inf)
        twin = _clearly_grow(values) & ~(apart < SAME_ROOT * (1.0 + np.abs(values)))
        values[twin] = partners[twin] = nothing
        loci.converged[row, twin], loci.errors[row, twin] = False, math.inf
        partners[_clearly_grow(partners) & (partners.imag != 0) & (partners != values.conj())] = (
            nothing
        )
    return loci


def _rests_without_flow(model: AnyModel) -> bool:
    """Whether the configuration about which a model is linearised is an equilibrium at rest."""
    try:
        if isinstance(model, Model):
            at_rest(model, 0.0).require_equilibrium(0.0)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class _GrowingModes:
    """The modes of a model that grow in a range of speeds.

    Attributes:
        added: numbers of modes beyond the lowest `count` that grow and get a branch, in the order
            in which they lose stability.
        speeds: the speeds asked for and one between any two neighbouring crossings, shape (S,). If
            the search for crossings fails, there are more where slopes tell that roots may grow.
        roots: number of growing roots at each speed, shape (S,); 0 close to a crossing, and
            infinite where it is not known.
        missing: which modes grow, or may grow, that are not known or not added.
    """

    added: list[int]
    speeds: Array
    roots: Array
    missing: str = ""

    def are_missing_in(self, loci: RootLoci) -> bool:
        """Whether the branches have fewer growing roots than the model at one of the speeds."""
        return bool(np.any(np.sum(_growing_roots(loci), axis=1) < self.roots))


def _growing_modes(model: AnyModel, at: Array, count: int, most: int) -> _GrowingModes:
    """The modes that grow at a speed from the first of `at` to the last one.

    `most` is the largest count that the model may have.
    """
    pipe, searched, resolved = model.pipe, model, math.inf
    size = max(2 * count, RESOLVING + math.ceil(Reach(pipe).wave_number(float(at[-1]))))
    for larger in (True, True, False):
        if isinstance(model, Continuum) and not (
            pipe.end_held or (pipe.bare and pipe.flow == "ejecting")
        ):
            # Any mode may grow, for instance with a mass at the free end, so that ever larger bases
            # have ever more crossings: one basis gives those of the modes that it resolves.
            searched = model.frozen(size)
            planar = searched.planar
            resolved = count_resolved(planar, eigenproblem(planar).spectrum())
        found, failed = tuple[Crossing, ...](), False
        try:
            if at[-1] > 0.0:
                _, found = only_answer(stability_losses([searched], float(at[-1]), sensitive=False))
            at_rest = unstable_at_rest(model, found)
        except NotConverged as error:  # with what was found below the speed of the failure
            failed, found = True, found or error.result or ()
            at_rest = found[0].unstable_before if found else 0
        found = tuple(one for one in found if one.mode <= resolved)
        growing = dict.fromkeys(range(1, at_rest + 1), 1)  # number of growing roots by mode
        for one in found:
            before, change = growing.get(one.mode, 0), one.unstable_after - one.unstable_before
            if one.speed <= at[0] or one.destabilising:
                growing[one.mode] = (before if one.speed <= at[0] else max(before, 0)) + change
        every = [mode for mode, number in growing.items() if number > 0]
        if not larger or max(every, default=0) < resolved or len(every) > count + MOST_ADDED:
            break
        size *= 2
    later = {one.mode for one in found if one.destabilising and one.speed > 0.0}
    leaving = {one.mode for one in found if one.destabilising and one.speed == 0.0} - later
    lowest = min(leaving.intersection(every), default=0)
    more = [mode for mode in every if mode > count and (mode not in leaving or mode == lowest)]
    added = more[:MOST_ADDED]
    left, missing = {*every} - {*range(1, count + 1), *added}, ""
    if max(every, default=0) >= resolved:
        first = min(left, default=max(every) + 1)
        missing = f"modes beyond {first - 1} grow, or may grow: take a larger count"
    elif left:
        take = f"count={max(left)}" if max(left) <= most else "a larger count"
        missing = f"{check.how_many(len(left), 'mode')} beyond {min(left) - 1} grow: take {take}"
    if failed:
        solved = model.frozen(size) if isinstance(model, Continuum) else model
        if not rest_follows(model) and solved.dof <= LARGEST_FULL:
            between, pairs = RootFollower(solved).between, itertools.pairwise(at.tolist())
            at = np.union1d(at, [u for pair in pairs for u in between(*pair)])
        return _GrowingModes(added, at, np.full(at.size, math.inf), missing)
    speeds = of_each(found, "speed")
    ends = np.concatenate([at[:1], speeds[(speeds > at[0]) & (speeds < at[-1])], at[-1:]])
    asked = np.histogram(at, ends)[0] if at.size > 1 else np.ones(ends.size - 1)
    at = np.union1d(at, 0.5 * (ends[1:] + ends[:-1])[asked == 0])
    roots = np.array([at_rest, *(one.unstable_after for one in found)])
    near = (np.abs(at[:, None] - speeds) <= BESIDE_CROSSING * (1.0 + speeds)).any(axis=1)
    numbers = np.where(near, 0.0, roots[np.searchsorted(speeds, at, side="right")])
    return _GrowingModes(added, at, numbers, missing)


def branches_followed(model: AnyModel, speeds: Array, count: int, shown: bool = False) -> RootLoci:
    """Branches of the `count` lowest modes at rest, whether or not others grow.

    Args:
        model: chain, reduced model or `Continuum`.
        speeds: checked flow speeds, increasing, shape (S,).
        count: number of branches.
        shown: whether to show progress on stderr.
    """
    ahead = int(speeds[0] > 0.0 and _rests_without_flow(model))
    asked = np.concatenate([np.zeros(ahead), speeds])
    smallest = max(16, 3 * count, math.ceil(speeds[-1]))
    answer: Converged[RootLoci] = converged_answer(
        model,
        () if rest_follows(model) else (float(speeds[0]), float(speeds[-1])),
        lambda one: _root_loci(one, asked, count, shown),
        partial(_loci_change, pipe=model.pipe),
        tolerance=1e-8,
        smallest=smallest,
        largest=smallest + 32,
    )
    found = answer.value
    if not (model.pipe.hysteresis or rest_follows(model) or found.across is not None):
        solved = model.frozen(answer.size) if isinstance(model, Continuum) else model
        found = _told_apart(eigenproblem(solved), found)
    if isinstance(model, Continuum):
        scale = np.maximum(np.maximum(np.abs(found.eigenvalues), np.abs(found.partners)), 1.0)
        unknown = _overdamped(found.eigenvalues, model.pipe.damping) | np.isnan(scale)
        moved = np.where(unknown, np.inf, answer.error * scale)
        found = replace(found, errors=found.errors + moved)
    every = ("speeds", *OF_BRANCHES)
    return replace(found, **{name: getattr(found, name)[ahead:] for name in every})


def _loci_change(a: RootLoci, b: RootLoci, pipe: Pipe) -> float:
    """Largest relative change of a root; under damping, overdamped roots are not compared.

    Overdamped roots of neighbouring modes meet and part in the cluster at -1 / delta, so that the
    choice of a root for each branch is a convention. Roots that grow are always compared.
    """
    delta = pipe.damping
    grows = (a.eigenvalues.real > 0.0) | (b.eigenvalues.real > 0.0)
    compared = ~(_overdamped(a.eigenvalues, delta) | _overdamped(b.eigenvalues, delta)) | (
        grows & (delta > 0.0)
    )
    if pipe.hysteresis:  # NaN is a root that does not exist
        compared &= np.isfinite(a.eigenvalues) & np.isfinite(b.eigenvalues)
    moved = relative(a.eigenvalues[compared], b.eigenvalues[compared])
    if delta > 0.0:
        return moved
    return max(moved, relative(a.partners[compared], b.partners[compared]))


def _overdamped(values: Complex, delta: float) -> NDArray[np.bool_]:
    """Which roots are real and decay under damping, or lie in the cluster at -1 / delta."""
    on_axis: NDArray[np.bool_] = (values.imag == 0.0) & (values.real < 0.0)
    return (on_axis | (np.abs(delta * values + 1.0) < 0.5)) & (delta > 0.0)


def _root_loci(model: Model, speeds: Array, count: int, shown: bool) -> RootLoci:
    """Root loci of one model, computed with more roots until no branch is lost."""
    if rest_follows(model):
        return _loci_of_rest(model, speeds, count)
    if model.dimensions == 3:
        each = [
            _told_apart(one, _loci_about(one, speeds, count, shown))
            for one in eigenproblem(model).planes
        ]
        return _side_by_side(each)
    return _loci_about(eigenproblem(model), speeds, count, shown)


def _side_by_side(each: list[RootLoci]) -> RootLoci:
    """Root loci in the plane of a bent rest and across it, as branches of one result."""
    first = each[0]
    if len(each) == 1:
        return first
    count = first.modes.size
    columns: dict[str, Any] = {
        name: np.stack([getattr(one, name) for one in each], -1).reshape(-1, 2 * count)
        for name in OF_BRANCHES
    }
    modes, across = np.repeat(first.modes, 2), np.tile([False, True], count)
    return replace(first, **columns, modes=modes, across=across, size=2 * first.size)


def _loci_about(problem: Eigenproblem, speeds: Array, count: int, shown: bool) -> RootLoci:
    """Root loci about a configuration at rest at all speeds."""
    # If the requested modes are overdamped, half of their roots lie beyond the cluster at -1 /
    # delta, and only a computation of all roots finds them.
    overdamped = is_overdamped(problem.pipe, count)
    spectrum, every = problem.spectrum(), 2 * problem.dof
    size = every if overdamped else 2 * count + 16
    if count < (before := Reach(problem.pipe).before_cluster()):
        size = min(size, 2 * before)
    with Progress("root loci", shown and speeds.size > 1) as progress:
        total, done = speeds.size - 1, itertools.count(1)

        def row_done() -> None:
            row = next(done)
            progress.to(row / total, f"{min(row, total)}/{total}")

        report = row_done if progress.shown else None
        while True:
            size = size if problem.is_long and size < problem.dof else every
            asked = speeds.tolist(), count, size
            with one_thread(problem.rows):
                loci = spectrum.root_loci(*asked, count_factorisations, report)
            if loci is not None:
                values, partners = loci.values, loci.partners
                checks = loci.converged, loci.errors
                return RootLoci(speeds, values, partners, *checks, problem.dof, problem.pipe)
            size *= 2


def _loci_of_rest(model: Model, speeds: Array, count: int) -> RootLoci:
    """Root loci of a bent pipe, whose rest is followed from u = 0 with all of its roots.

    Each root continues as the nearest one of its plane from one rest to the next.
    """
    rests, followed = BranchOfRest(model), list[RootsFollowed]()
    rows = [list[tuple[NDArray[Any], ...]]() for _ in rests.planes]

    def record(x: Array, u: float) -> None:
        for row, roots, problem in zip(
            rows, followed, eigenproblem(rests.about(x)).planes, strict=True
        ):
            row.append(recorded(problem, roots, u))

    def recorded(problem: Eigenproblem, roots: RootsFollowed, u: float) -> tuple[NDArray[Any], ...]:
        pairs = problem.lowest(u, 2 * problem.dof, left=True)
        own = matched(roots.values, pairs.values)[: 2 * count].reshape(count, 2)
        # The upper root of a pair comes first, and the greater one of a real pair.
        order = np.lexsort((-pairs.values[own].real, -pairs.values[own].imag), axis=1)
        own = np.take_along_axis(own, order, axis=1)
        values, errors = pairs.values[own], problem.errors(u, pairs)[own].max(axis=1)
        good = (pairs.converged[own] & (own >= 0)).all(axis=1)
        return (*values.T, np.asarray(good), errors)

    def note(step: BranchStep[DenseProblem]) -> str | None:
        if not followed:
            begin = step.begin
            followed.extend(RootsFollowed(rests.roots(begin.x, begin.p, k)) for k in rests.planes)
            if speeds[0] == 0.0:
                record(begin.x, 0.0)
        for plane, roots in enumerate(followed):
            roots.move(rests.roots(step.end.x, step.end.p, plane))
        if len(rows[0]) < speeds.size and step.end.p == speeds[len(rows[0])]:
            record(step.end.x, step.end.p)
        return "fold" if step.end.tangent[-1] <= 0.0 else None

    with one_thread(model.dof):
        reason = rests.following(max(float(speeds[-1]), 1e-3), note, speeds[speeds > 0.0].tolist())
    if len(rows[0]) < speeds.size:
        raise NotConverged(lost_rest(reason, float(speeds[len(rows[0]) - 1]), float(speeds[-1])))
    each = list[RootLoci]()
    for row in rows:
        values, partners, converged, errors = map(np.array, zip(*row, strict=True))
        checks = converged, errors
        each.append(RootLoci(speeds, values, partners, *checks, rests.within.dof, model.pipe))
    return _side_by_side(each)


def _told_apart(problem: Eigenproblem, loci: RootLoci) -> RootLoci:
    """Root loci in which no two branches have the same root.

    Roots of two real pairs may meet and become a complex pair, as in a pipe that two modes buckle
    at rest. The core then follows this pair on both branches. The later one gets a root that no
    branch has instead: the one next to its root at the speed before.
    """
    tables = np.stack([loci.eigenvalues, loci.partners], axis=-1)
    converged, errors, count = loci.converged.copy(), loci.errors.copy(), loci.modes.size
    for row, roots in enumerate(tables):
        known = roots[np.isfinite(roots) & (roots != 0.0)]
        if np.unique(known).size == known.size:
            continue
        asked = min(4 * count + 16, 2 * problem.dof) if problem.is_long else 2 * problem.dof
        u = float(loci.speeds[row])
        found = problem.lowest(u, asked, left=True)
        there, left = found.values, [*range(found.values.size)]
        own = np.full(roots.shape, -1)  # indices of roots among those found
        is_pair = (roots[:, 1] == roots[:, 0].conj()) | ~roots.imag.any(axis=1)
        for place in sorted(np.ndindex(*roots.shape), key=lambda at: not is_pair[at[0]]):
            nearest = min(left, key=lambda j: abs(there[j] - roots[place]), default=-1)
            if abs(there[nearest] - roots[place]) < SAME_ROOT * (1.0 + abs(roots[place])):
                own[place] = nearest
                left.remove(nearest)
        for k in np.flatnonzero((own < 0).any(axis=1)).tolist():
            for slot in (0, 1):
                if own[k, slot] >= 0 or not left:
                    continue
                other = own[k, 1 - slot]
                near = tables[max(row - 1, 0), k, slot]
                if other < 0:
                    some = left
                elif there[other].imag:
                    some, near = left, there[other].conjugate()
                else:
                    some = [j for j in left if not there[j].imag] or left
                own[k, slot] = min(some, key=lambda j: abs(there[j] - near))
                left.remove(own[k, slot])
            pair = sorted(own[k].tolist(), key=lambda j: (-there[j].imag, -there[j].real))
            roots[k] = there[pair]
            converged[row, k] = found.converged[pair].all() and (own[k] >= 0).all()
            errors[row, k] = problem.errors(u, select_pairs(found, np.array(pair))).max()
    values, partners = np.moveaxis(tables, -1, 0).copy()
    return replace(loci, eigenvalues=values, partners=partners, converged=converged, errors=errors)
