# SPDX-License-Identifier: MIT
"""Whether the onset of flutter is supercritical or subcritical, against any parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipedyn.bifurcation.hopf import Hopf, hopf
from pipedyn.linear.stability_curve import Failure, swept
from pipedyn.models.base import Model
from pipedyn.util.check import Array
from pipedyn.util.result import result


@result
class CriticalityCurve:
    """Onsets of flutter against a parameter.

    Attributes:
        values: the parameter, shape (S,).
        onsets: Hopf at each value, None where the point failed.
        failures: the points that failed, with what they raised: `NoHopf` where stability is lost
            otherwise, `NoCrossing` where it is not lost.
    """

    values: Array
    onsets: tuple[Hopf | None, ...] = field(repr=False)
    failures: tuple[Failure, ...]

    @property
    def speeds(self) -> Array:
        """Flow speeds of the onsets, shape (S,), NaN where there is none."""
        return np.array([math.nan if one is None else one.speed for one in self.onsets])

    @property
    def laws(self) -> Array:
        """Amplitude laws, negative where the onset is subcritical, shape (S,), NaN for none."""
        return np.array([math.nan if one is None else one.amplitude_law for one in self.onsets])

    @property
    def subcritical(self) -> NDArray[np.bool_]:
        """Where the cycle that emerges repels, so that flutter is large at once, shape (S,)."""
        return np.array(
            [one is not None and one.criticality == "subcritical" for one in self.onsets]
        )

    @property
    def folds(self) -> Array:
        """Speeds of `Hopf.fold`, shape (S,), NaN for none.

        With drag an onset may be supercritical, but its cycles turn back at this speed, beyond
        which flutter is large at once. Under weak drag that is hardly above the onset.
        """
        found = [None if one is None else one.fold for one in self.onsets]
        return np.array([math.nan if fold is None else fold for fold in found])

    @property
    def changes(self) -> Array:
        """Neighbouring values between which onsets change side, shape (C, 2).

        Either the leading coefficient passes 0 there (a Bautin point), which `laws` that grow
        without bound show, or the onset passes to another mode.
        """
        known = np.array([one is not None for one in self.onsets])
        side = self.subcritical
        at = np.flatnonzero(known[:-1] & known[1:] & (side[:-1] != side[1:]))
        return np.stack([self.values[at], self.values[at + 1]], axis=1)


def criticality_curve(
    make_model: Callable[[float], Model],
    values: ArrayLike,
    executor: Executor | None = None,
    progress: bool = False,
) -> CriticalityCurve:
    """Whether flutter at the critical speed is supercritical, against any parameter.

    Args:
        make_model: the model at a value of the parameter; called in this process, so a lambda will
            do. Of a map over two parameters it is a row.
        values: the parameter, shape (S,).
        executor: a `concurrent.futures.Executor` that takes the points.
        progress: show progress on stderr.

    Returns:
        CriticalityCurve; a point that fails is recorded in `failures` and the others are kept.

    Raises:
        ValueError, TypeError: for bad arguments.
    """
    at, onsets, failures = swept(make_model, values, hopf, executor, progress, "criticality")
    return CriticalityCurve(at, tuple(onsets), failures)
