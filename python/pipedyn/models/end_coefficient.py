# SPDX-License-Identifier: MIT
"""End coefficient: the momentum of the fluid that passes the free end of a pipe."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from pipedyn import _core
from pipedyn.util import check
from pipedyn.util.check import Array

QUADRATURE = 1e-12
"""Relative error asked of both integrals; rounding in sums of 23,000 terms is 1e-13."""


def end_coefficient(
    velocity: Callable[[float], float] | ArrayLike,
    *,
    radius: float = 1.0,
    radii: ArrayLike | None = None,
    areas: ArrayLike | None = None,
    section: float | None = None,
) -> float:
    """End coefficient alpha = A int V^2 dS / (int V dS)^2 of the outlet or inlet at the free end.

    V is the velocity normal to the surface S of the opening and A is the pipe's section. alpha is 1
    for a uniform velocity over A, 4/3 for a parabolic profile over A, 2 for a nozzle whose jet is
    uniform over A / 2, and 1/2 for a uniform inlet over 2 A. Any consistent units are allowed.

    Args:
        velocity: an axisymmetric profile V(r), a function called with some 50,000 floats 0 <= r <=
            radius, which may have jumps (a jet narrower than 1e-4 of the radius may be missed); or
            samples of V, shape (k,), with either their radii or their areas.
        radius: radius of the end's opening, if velocity is a function.
        radii: increasing radii of the samples, shape (k,), k >= 2, from 0 to the opening's radius;
            between samples the profile is interpolated by monotone cubics.
        areas: area of the patch of each sample, shape (k,), > 0.
        section: the pipe's section A; the area of the opening by default.

    Example:
        >>> round(pp.end_coefficient(lambda r: 1.0 - r**2), 6)  # laminar flow in a tube
        1.333333

    Raises:
        ValueError: for numbers out of range, an end with no net flow, or a function that cannot be
            integrated.
        TypeError: for a velocity that is neither function nor array, or a value that is no number.

    Source: Orsino and Di Giulio, eqs. (7)-(8), for an inlet; the jet's momentum is analogous.
    """
    radius = check.real("radius", radius, low=0.0, open_low=True)
    if section is not None:
        section = check.real("section", section, low=0.0, open_low=True)
    if [callable(velocity), radii is not None, areas is not None].count(True) != 1:
        given = [name for name, of in (("radii", radii), ("areas", areas)) if of is not None]
        raise ValueError(
            "velocity must be a function, or samples with either radii or areas, "
            f"got {check.shown(velocity)} with {' and '.join(given) or 'neither'}"
        )
    if callable(velocity):
        mean, square = _means_of_function(velocity, radius)
        area = radius, math.pi * radius
    elif radii is not None:
        at = check.array("radii", radii, low=0.0)
        samples = check.array("velocity", velocity, size=at.size)
        # A cubic's coefficients grow with the inverse cube of the distance: 1e90 does not overflow.
        if at.size < 2 or at[0] != 0.0 or np.any(np.diff(at) <= 1e-30 * at[-1]):
            raise ValueError(
                f"radii must increase from 0, by more than 1e-30 of the last, "
                f"got {check.shown(radii)}"
            )
        x = at / at[-1]
        profile = scipy.interpolate.PchipInterpolator(x, samples / _peak(samples))
        # The rule is exact up to degree 7, that of x times the square of a cubic.
        nodes, weights = _core.gauss_nodes(4)
        widths = np.diff(x)[:, None]
        nodes = x[:-1, None] + widths * nodes
        values, rings = profile(nodes), 2.0 * nodes * widths * weights
        mean, square = float(np.sum(rings * values)), float(np.sum(rings * values**2))
        area = float(at[-1]), math.pi * float(at[-1])
    else:
        patches = check.array("areas", areas, low=0.0, open_low=True)
        samples = check.array("velocity", velocity, size=patches.size)
        parts = patches / patches.max()
        whole = float(parts.sum())
        scaled = samples / _peak(samples)
        mean, square = float(parts @ scaled) / whole, float(parts @ scaled**2) / whole
        area = float(patches.max()), whole
    if _vanishes(mean, square):
        raise ValueError(f"velocity must carry fluid through the end, got a mean of {mean:.1e}")
    # The opening's area is kept as two factors, as their product may overflow or underflow.
    part = 1.0 if section is None else section / area[0] / area[1]
    alpha = part * (square / mean**2)
    if not 0.0 < alpha < math.inf:
        raise ValueError(
            f"section must be comparable with the opening's area, got {part!r} times that"
        )
    return alpha


def _means_of_function(velocity: Callable[[float], Any], radius: float) -> tuple[float, float]:
    """Means over the opening of V and V^2, with V in units of the largest |V| of a first sampling.

    Panels are halved where their 10 Gauss and 21 Kronrod nodes give different integrals.
    """

    def at(x: float) -> float:
        r = x * radius
        value = velocity(r)
        if isinstance(value, float) and math.isfinite(value):
            return float(value)
        return check.real(f"velocity({r:g})", value)

    # In 1024 panels the widest gap between the 21 nodes is 7.3e-5 of the radius: a jet of width
    # 1e-4 contains a node. The first and the last panel are halved towards the centre and the wall,
    # down to 2^-40, so that an infinite slope there is resolved before any panel is divided.
    near = 0.5 ** np.arange(11, 41)
    edges = np.concatenate([[0.0], near[::-1], np.arange(1, 1024) / 1024, 1.0 - near, [1.0]])
    samples = edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(16) + 0.5) / 16
    peak = _peak(np.array([at(x) for x in samples.ravel().tolist()]))

    def ring(x: float) -> complex:  # of both integrands: an array would take five times as long
        value = at(x) / peak
        if abs(value) > 1e100:  # so that squares stay far from overflow
            raise ValueError(f"velocity({x * radius:g}) must be at most 1e+100 times the others")
        return complex(2.0 * x * value, 2.0 * x * value**2)

    # A jump takes 50 more panels, a profile like (1 - r)^-0.4 takes 840, noise would never end.
    means, error = scipy.integrate.quad_vec(
        ring, 0.0, 1.0, epsabs=0.0, epsrel=QUADRATURE, limit=8000, points=edges[1:-1]
    )
    mean, square = means.real, means.imag
    if not _vanishes(mean, square):
        uncertain = error * (1.0 / square + 2.0 / abs(mean))
        # Jumps leave 3e-12, (1 - r)^-0.4 leaves 9e-9, noise of 1e-6 of the velocity leaves 1e-5.
        if not uncertain <= 1e-7:
            raise ValueError(
                "velocity must be a profile that can be integrated, got one whose coefficient "
                f"has an error of {uncertain:.0e}"
            )
    return mean, square


def _peak(velocity: Array) -> float:
    """Largest magnitude: squares of velocities in this unit neither overflow nor underflow."""
    peak = float(np.abs(velocity).max())
    if peak == 0.0:
        raise ValueError("velocity must carry fluid through the end, got 0 everywhere")
    return peak


def _vanishes(mean: float, square: float) -> bool:
    """Whether the mean velocity is only rounding relative to its root mean square, or NaN."""
    return not mean**2 > QUADRATURE**2 * square
