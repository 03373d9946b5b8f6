# SPDX-License-Identifier: MIT
"""The continuous pipe by finite elements of high degree, from its numbers alone.

With w the displacement and v any that the supports allow, virtual work is

    int EI (1 + delta d/dt + i mu) w'' v'' + T w' v' + (k + sigma d/dt) w v + (m + chi) w_tt v ds
    + alpha u^2 (w'(1) v(1) - int w' v' ds)
    + s sqrt(beta) u (c w_t(1) v(1) + int w_t' v - w_t v' ds)
    + what springs, dampers and masses at places do by w, and couples and inertia by w',

T the weight, dead loads and tension beyond a place, c the share of the free end's velocity that
flows in or out with the fluid, s the flow's sign. On each element between places where something
acts w is a cubic, by its values and slopes at the ends, and polynomials that have neither there,
of which the second derivatives are Legendre's (Szabo and Babuska 1991).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from campaign_cases import Numbers, energy_paths
from campaign_reference import (
    Answer,
    Change,
    System,
    Unsure,
    all_changes,
    divergences,
    in_other,
    projected,
)
from numpy.polynomial import legendre, polynomial
from scipy import linalg

Array = np.ndarray[Any, Any]


def _shapes(degree: int, h: float, x: Array) -> list[Array]:
    """Shape functions of one element at x in [-1, 1], their slopes and curvatures, each (x, n)."""
    t, tables = 0.5 * (x + 1.0), []
    cubics = ((1, 0, -3, 2), (0, h, -2 * h, h), (0, 0, 3, -2), (0, 0, -h, h))
    bends = legendre.legvander(x, degree)  # and their integrals from -1, once and twice
    slopes = (bends[:, 2:] - bends[:, :-2]) / np.arange(3, 2 * degree, 2)
    values = (slopes[:, 2:] - slopes[:, :-2]) / np.arange(5, 2 * degree - 2, 2)
    sizes = np.sqrt(np.arange(5, 2 * degree - 2, 2) / h)
    for order, inner in enumerate((values, slopes[:, 1:-1], bends[:, 2:-2])):
        columns = [polynomial.polyval(t, polynomial.polyder(c, order)) / h**order for c in cubics]
        tables.append(
            np.hstack([np.stack(columns, axis=1), inner * sizes * (0.5 * h) ** (2 - order)])
        )
    return tables


def _along(profile: Any, s: Array) -> Array:
    """Values of a profile at places in an element: on stretches polynomials or functions of s."""
    if profile is None:
        return np.ones_like(s)
    at, series = profile
    own = series[int(np.searchsorted(at, s.mean()))]
    return own(s) if callable(own) else polynomial.polyval(s, own)


def elements(numbers: Numbers, wave: float, more: int) -> System:
    """The matrices, of elements that resolve waves up to a wave number; `more` adds to degrees."""
    terms, supports = numbers.get("terms", ()), numbers.get("supports", ())
    stiffness, heaviness = numbers.get("stiffness"), numbers.get("mass")
    gamma, delta = numbers.get("gamma", 0.0), numbers.get("damping", 0.0)
    local = ("PointMass", "Spring", "Damper", "Weight", "RotationalSpring", "RotationalDamper")
    acting = [(law, of) for law, of in terms if law in local]
    steps = [s for one in (stiffness, heaviness) if one for s in one[0]]
    ends = np.array(sorted({0.0, 1.0, *supports, *steps, *(of["at"] for _, of in acting)}))
    lengths = np.diff(ends)
    degrees = [5 + more + math.ceil(0.75 * wave * h + min(8.0, 2.0 * wave * h)) for h in lengths]
    first = np.cumsum([2 * ends.size, *(d - 3 for d in degrees)])
    size, tip = int(first[-1]), 2 * ends.size - 2

    def along(law: str) -> float:
        return sum(value for name, of in terms if name == law for value in of.values())

    mass, gyro, bending, tension, plain, slopes, end, follower = np.zeros((8, size, size))
    beyond = 0.0  # mass of the pipe beyond an element
    for k in reversed(range(lengths.size)):
        a, h, (x, w) = ends[k], lengths[k], legendre.leggauss(degrees[k] + 6)
        s, w = a + 0.5 * h * (x + 1.0), 0.5 * h * w
        where = [*range(2 * k, 2 * k + 4), *range(first[k], first[k + 1])]
        at, (value, slope, bend) = np.ix_(where, where), _shapes(degrees[k], h, x)
        # Mass between a place and the element's end, by the same rule on what is left of it.
        left = a + h - s
        inner = s[:, None] + 0.5 * left[:, None] * (x + 1.0)
        part = _along(heaviness, inner.ravel()).reshape(inner.shape) @ w * left / h
        load = gamma * (beyond + part) + along("Tension")
        for law, of in acting:
            if of["at"] > s[0]:
                load += {"PointMass": gamma * of.get("mass", 0.0), "Weight": of.get("load")}.get(
                    law, 0.0
                )
        heavy = _along(heaviness, s)
        beyond += float(w @ heavy)
        mass[at] += value.T * (w * heavy) @ value
        plain[at] += value.T * w @ value
        gyro[at] += value.T * w @ slope - slope.T * w @ value
        slopes[at] += slope.T * w @ slope
        tension[at] += slope.T * (w * load) @ slope
        bending[at] += bend.T * (w * _along(stiffness, s)) @ bend
    end[tip, tip], follower[tip, tip + 1] = numbers.get("inflow_share", 1.0), 1.0
    damping = delta * bending + along("Viscosity") * plain
    mass += along("AddedMass") * plain
    still = bending + tension + along("Foundation") * plain
    for law, of in acting:
        i = 2 * int(np.searchsorted(ends, of["at"]))
        k = i + law.startswith("Rotational")  # the row of the displacement or of the slope
        mass[i, i] += of.get("mass", 0.0)
        mass[i + 1, i + 1] += of.get("inertia", 0.0)
        still[k, k] += of.get("stiffness", 0.0)
        damping[k, k] += of.get("coefficient", 0.0)
    root, held = numbers.get("root", "clamped"), numbers.get("end", "free")
    still[1, 1] += root if isinstance(root, float) else 0.0
    fixed = {0, *(2 * int(np.searchsorted(ends, s)) for s in supports)}
    fixed |= {1} if root == "clamped" else set()
    fixed |= {tip} if held in ("pinned", "clamped") else set()
    fixed |= {tip + 1} if held in ("guided", "clamped") else set()
    free = np.array([i for i in range(size) if i not in fixed])
    flow = math.sqrt(numbers["beta"]) * (-1.0 if numbers.get("flow") == "aspirating" else 1.0)
    thrust, loss = numbers.get("alpha", 1.0) * (follower - slopes), numbers.get("hysteresis", 0.0)
    if energy_paths(numbers)[0]:
        end, thrust = 0.0 * end, 0.5 * (thrust + thrust.T)
    made = (mass, flow * gyro, flow * end, damping, still, thrust, loss * bending)
    lower = linalg.cholesky((bending + plain)[np.ix_(free, free)], lower=True)
    system = System(*(one[np.ix_(free, free)] for one in made[: 7 if loss else 6]))
    # In these coordinates bending has about the stiffness 1.
    return projected(system, linalg.solve_triangular(lower, np.eye(free.size), lower=True).T)


def wave_number(numbers: Numbers, end: float) -> float:
    """Of the shortest waves that may matter: those the flow reaches, and those that it feeds.

    An aspirating pipe is fed at 2 sqrt(beta) u in every mode, and damping must take that.
    """
    soft = 1.0
    if "stiffness" in numbers:
        soft = min(0.9 * min(map(sum, numbers["stiffness"][1])), 1.0)
    wave = 1.3 * end / math.sqrt(soft) + 8.0
    if numbers.get("flow") == "aspirating":
        fed = 4.0 * math.sqrt(numbers["beta"]) * end * numbers.get("inflow_share", 1.0)
        lost = numbers.get("hysteresis", 0.0), math.sqrt(fed * numbers["damping"])
        wave = max(wave, 8.0 + 1.2 * math.sqrt(fed / max(*lost, 1e-6 * fed, 1e-300)))
    return wave


def continuum_changes(numbers: Numbers, end: float) -> Answer:
    """Every change of the continuous pipe, from elements of one degree and the next but three.

    The errors are what the changes move between the two. Raises `Unsure` where they differ in kind.
    """
    wave = wave_number(numbers, end)
    coarse, fine = (elements(numbers, wave, more) for more in (0, 4))
    found = all_changes(coarse, end, 0.5 * wave)
    static = divergences(fine, end)
    changes: list[Change] = []
    for one in found.changes:
        if one.frequency == 0.0:
            near = [c for c in static if abs(c.speed - one.speed) < 1e-4 * one.speed]
            better = min(near, key=lambda c: abs(c.speed - one.speed), default=None)
        else:
            better = in_other(fine, one)
        if better is None or abs(better.speed - one.speed) > 1e-4 * one.speed:
            raise Unsure(f"the change at {one.speed:.6g} is none of larger elements")
        moved = abs(better.speed - one.speed)
        if better.speed <= end:
            changes.append(replace(better, error=better.error + one.error + moved))
    if len(static) != sum(one.frequency == 0.0 for one in changes):
        raise Unsure("larger elements have another number of divergences")
    return Answer(tuple(changes), found.counts)
