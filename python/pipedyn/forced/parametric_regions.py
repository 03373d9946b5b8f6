# SPDX-License-Identifier: MIT
"""Regions of amplitude and frequency in which a pulsating flow makes the straight pipe unstable.

On an edge Hill's equations H(w, nu, amplitude) q = 0 have a solution with real nu: a multiplier
exp(2 pi i nu / w) lies on the unit circle. It is -1 on the edges of subharmonic regions, 1 on those
of harmonic regions, and any other on those of combination regions. At one amplitude the edges of
the first two kinds are the real eigenvalues w of H, which is a polynomial in w; in combination
regions the modulus of a multiplier off the real axis is larger than 1. Each edge found is followed
in the amplitude, down to where it turns back, the least amplitude of its region, and up to where
the region ends.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipedyn.forced.parametric_edge import THINNEST, RegionKind
from pipedyn.forced.parametric_search import RegionEdges, recompute, region_change, regions
from pipedyn.forced.pulsating import Hill, pulsating_pipe, require_motion
from pipedyn.linear.frequency_response import checked_range
from pipedyn.models.base import Model
from pipedyn.models.continuum import AnyModel, checked_model
from pipedyn.models.drive import require_steady
from pipedyn.models.pipe import Pipe
from pipedyn.util import check
from pipedyn.util.archive import saved_as
from pipedyn.util.check import Array
from pipedyn.util.errors import NotConverged
from pipedyn.util.newton import NewtonFailed
from pipedyn.util.parallel import one_thread, track
from pipedyn.util.result import FREQUENCY, SPEED, ResultSequence, TableResult, join_tables

TRUNCATIONS = (12, 16, 22, 30, 40)
"""Numbers of functions or modes that are tried, one after the other, until edges converge."""

EDGE_TOLERANCE = 1e-7
"""Relative change of the edges from one truncation to the next at which they count as converged."""


@saved_as("ParametricRegion")
class ParametricRegion(
    TableResult,
    units={"amplitude": None, **dict.fromkeys(("edges", "lowest", "highest"), FREQUENCY)},
):
    """A region of amplitude and frequency in which the straight pipe is unstable.

    Attributes:
        kind: "subharmonic", where the growing motions change sign from one period to the next (as
            in the principal region of a mode); "harmonic", where they repeat with each period; or
            "combination", where two modes grow at frequencies of their own.
        amplitude: amplitudes asked for, relative to the mean speed, shape (A,).
        edges: lowest and highest frequency of the region at each amplitude, shape (A, 2). An edge
            is NaN below the threshold, where the region is thinner than 1e-6 of its frequency,
            where it lies far outside the range of frequencies, and where it was not found beside a
            region of another kind that meets this one. If regions of one kind overlap, each has the
            edges of their union; a region that is nowhere separate from others is not listed by
            itself. Regions of different kinds may lie within each other.
        threshold: least amplitude of the region; 0 for modes without damping, NaN if an edge leaves
            the range of frequencies first.
        threshold_frequency: frequency at the threshold.
        error: largest relative change of an edge from the second last truncation to the last.
        pipe: the pipe.
    """

    kind: RegionKind
    amplitude: Array = field(repr=False)
    edges: Array
    threshold: float
    threshold_frequency: float
    error: float
    pipe: Pipe = field(repr=False)

    def _columns(self) -> dict[str, Any]:
        low, high = self.edges.T
        return {"amplitude": self.amplitude, "lowest": low, "highest": high}


@saved_as("ParametricRegions", added=("amplitudes",))
class ParametricRegions(
    ResultSequence[ParametricRegion],
    units={"amplitude": None, "mean": SPEED, **dict.fromkeys(("lowest", "highest"), FREQUENCY)},
):
    """All regions of a pulsation, by rising frequency, as a tuple and as a table.

    Attributes:
        regions: the regions found.
        mean: mean flow speed.
        frequencies: range of the pulsation's angular frequency, in 1 / T, shape (2,).
        model: the model.
        amplitudes: amplitudes asked for, relative to the mean speed, shape (A,); None in a result
            of an older version.
    """

    regions: tuple[ParametricRegion, ...]
    mean: float
    frequencies: Array
    model: AnyModel
    amplitudes: Array | None = field(default=None, repr=False)

    def _members(self) -> tuple[ParametricRegion, ...]:
        return self.regions

    def _columns(self) -> dict[str, Any]:
        if not self.regions:
            return {name: [] for name in ("region", "kind", "amplitude", "lowest", "highest")}
        kinds = [one.kind for one in self.regions]
        tables = [one.columns() for one in self.regions]
        return join_tables(tables, region=range(len(kinds)), kind=kinds)


def parametric_regions(
    model: AnyModel,
    mean: float,
    amplitudes: ArrayLike,
    frequencies: ArrayLike,
    progress: bool = False,
) -> ParametricRegions:
    """Regions in which a pulsation u = mean (1 + amplitude cos(frequency tau)) is unstable.

    Args:
        model: chain or reduced model, scene, or `Continuum`.
        mean: mean flow speed > 0, at which the pipe is stable, in sqrt(EI / mu_f) / L.
        amplitudes: amplitudes relative to the mean, increasing, each in (0, 1), shape (A,); or one.
        frequencies: range (low, high) of the pulsation's angular frequency, 0 < low < high <=
            20 low, in 1 / T, or several frequencies in increasing order, of which the first and
            last are the range.
        progress: show on stderr which share of the amplitudes is searched for regions of each kind,
            and for how many regions edges are computed again with more harmonics and functions.

    Returns:
        The regions that touch the range at one of the amplitudes, or whose threshold lies in it, by
        rising frequency, indexed as a tuple, and a table. Edges are roots of Hill's determinant, to
        a relative accuracy of 1e-7, and may lie outside the range. Instabilities of a damped pipe
        in which motions grow by less than 1e-5 a period are left out, as are regions thinner than
        1e-6 of their frequency and combinations of modes with frequencies beyond high + 4 low.

    Example:
        >>> pipe = pp.Pipe(0.2, 10.0)
        >>> (region,) = pp.parametric_regions(pp.Continuum(pipe), 5.5, 0.2, (27.0, 37.0))
        >>> region.kind, region.edges.round(3)
        ('subharmonic', array([[27.431, 36.23 ]]))

    Raises:
        NotConverged: if edges do not converge as functions and harmonics are added.
        ValueError, TypeError: for bad arguments, and for a pipe that is unstable at the mean.

    Source: Paidoussis and Issid (1974); Bolotin (1964), The dynamic stability of elastic systems,
    for Hill's determinant.
    """
    model = checked_model(model)
    require_motion(model)
    require_steady("mean", mean)
    mean = check.real("mean", mean, low=0.0, high=100.0, open_low=True)
    given = check.numbers("amplitudes", amplitudes, "a number or an array of real numbers")
    mu = check.array("amplitudes", np.atleast_1d(given), open_low=True, low=0.0)
    if not (mu < 1.0).all():
        raise ValueError(
            f"amplitudes must be below 1, beyond which the flow reverses, got {mu.max():g}"
        )
    if (np.diff(mu) <= 0.0).any():
        raise ValueError("amplitudes must be strictly increasing")
    low, high = checked_range(frequencies)
    if not low > 0.0 or high > 20.0 * low:
        raise ValueError(
            f"frequencies must have 0 < low and high <= 20 low, got {check.shown(frequencies)}"
        )
    if isinstance(model, Model):
        model.require_equilibrium(mean)
    found = _converged(model, mean, mu, (low, high), check.flag("progress", progress))
    return ParametricRegions(found, mean, np.array([low, high]), model, mu)


def _converged(
    model: AnyModel, mean: float, mu: Array, window: tuple[float, float], shown: bool
) -> tuple[ParametricRegion, ...]:
    """The regions, computed with ever more functions and harmonics until edges converge."""
    # A flow that pulsates by 0.6 needs ten more harmonics than the frequencies alone demand: with
    # fewer, some growing motions do not exist in Hill's equations and cannot be found.
    many = math.ceil(window[1] / window[0]) + 4 + math.ceil(12.0 * mu[-1])
    last: list[RegionEdges] | None = None
    for size in TRUNCATIONS:
        pipe = pulsating_pipe(model, mean, size)
        with one_thread(pipe.size):
            if last is None:
                pipe.require_stable(window[1])
                found = regions(Hill(pipe, many), mu, *window, progress=shown)
            else:
                hill, label = Hill(pipe, many), "edges with more harmonics"
                try:
                    found = [
                        recompute(hill, region, mu, window[0])
                        for region in track(last, len(last), label, shown)
                    ]
                except NewtonFailed as reason:
                    raise NotConverged(
                        "edges of parametric regions were not found again with more functions and "
                        f"harmonics: {reason}"
                    ) from None
        error = math.inf if last is None else max(map(region_change, last, found), default=0.0)
        if error <= EDGE_TOLERANCE:
            for one in found:
                one.edges[np.diff(one.edges)[:, 0] < 0.3 * THINNEST * one.edges[:, 1]] = math.nan
            return tuple(
                ParametricRegion(
                    kind=one.kind,
                    amplitude=mu,
                    edges=one.edges,
                    threshold=float(one.bottom[0]),
                    threshold_frequency=float(one.bottom[1]),
                    error=error,
                    pipe=model.pipe,
                )
                for one in found
            )
        last = found
        many += 2
    raise NotConverged(f"edges of parametric regions still move by {error:.1e}")
