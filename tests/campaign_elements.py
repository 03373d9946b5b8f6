# SPDX-License-Identifier: MIT
"""The continuous pipe by finite elements of high degree, from its numbers alone.

With w the displacement and v any that the supports allow, virtual work is

    int EI (1 + delta d/dt + i mu) w'' v'' + T w' v' + (k + sigma d/dt) w v + (m + chi) w_tt v ds
    + alpha u^2 (w'(1) v(1) - int w' v' ds)
    + s sqrt(beta) u (c w_t(1) v(1) + int w_t' v - w_t v' ds)
    + what springs, dampers and masses at places do,

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
from campaign_reference import (
    Answer,
    Change,
    System,
    Unsure,
    all_changes,
    divergences,
    in_other,
)
from numpy.polynomial import Legendre, legendre
from scipy import linalg

Array = np.ndarray[Any, Any]


def _shapes(degree: int, h: float, x: Array) -> list[Array]:
    """Shape functions of one element at x in [-1, 1], their slopes and curvatures, each (x, n)."""
    t = 0.5 * (x + 1.0)
    cubics = [
        np.array(c, dtype=float)
        for c in ([1, 0, -3, 2], [0, h, -2 * h, h], [0, 0, 3, -2], [0, 0, -h, h])
    ]
    tables = []
    for order in range(3):
        columns = []
        for c in cubics:
            d = np.polynomial.polynomial.polyder(c, order) if order else c
            columns.append(np.polynomial.polynomial.polyval(t, d) / h**order)
        for k in range(2, degree - 1):
            one = Legendre.basis(k)
            whole = one.integ(2 - order, lbnd=-1) if order < 2 else one
            columns.append(
                whole(x) * math.sqrt(k + 0.5) * (0.5 * h) ** (2 - order) * math.sqrt(2.0 / h)
            )
        tables.append(np.stack(columns, axis=1))
    return tables


def _along(profile: Any, s: Array) -> Array:
    """Values of a profile, polynomials of s on stretches, at places inside an element."""
    if profile is None:
        return np.ones_like(s)
    at, series = profile
    return np.polynomial.polynomial.polyval(s, series[int(np.searchsorted(at, s.mean()))])


def elements(numbers: dict[str, Any], wave: float, more: int) -> System:
    """The matrices, of elements that resolve waves up to a wave number; `more` adds to degrees."""
    terms = numbers.get("terms", ())
    supports = numbers.get("supports", ())
    steps = [s for name in ("stiffness", "mass") if name in numbers for s in numbers[name][0]]
    acting = ("PointMass", "Spring", "Damper", "Weight")
    places = [of["at"] for law, of in terms if law in acting]
    ends = np.array(sorted({0.0, 1.0, *supports, *steps, *places}))
    lengths = np.diff(ends)
    degrees = [
        5 + more + math.ceil(0.75 * wave * h + 8.0 * min(1.0, 0.25 * wave * h)) for h in lengths
    ]
    first = np.cumsum([2 * ends.size, *(d - 3 for d in degrees)])
    size = int(first[-1])
    beta, gamma = numbers["beta"], numbers.get("gamma", 0.0)
    named = {
        name: sum(v for law, of in terms if law == name for v in of.values())
        for name in ("Foundation", "Viscosity", "AddedMass", "Tension")
    }
    pulls = [
        (of["at"], gamma * of["mass"] if law == "PointMass" else of["load"])
        for law, of in terms
        if law in ("PointMass", "Weight")
    ]
    mass, gyro, bending, tension, plain, slopes = np.zeros((6, size, size))

    # Weight of the pipe beyond each element's end.
    nodes = [legendre.leggauss(d + 6) for d in degrees]
    weights = [
        0.5 * h * np.sum(w * _along(numbers.get("mass"), a + 0.5 * h * (x + 1.0)))
        for a, h, (x, w) in zip(ends[:-1], lengths, nodes, strict=True)
    ]
    beyond = np.cumsum([*weights, 0.0][::-1])[::-1][1:]
    for k, (a, h, (x, w)) in enumerate(zip(ends[:-1], lengths, nodes, strict=True)):
        s, w = a + 0.5 * h * (x + 1.0), 0.5 * h * w
        where = [2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3, *range(first[k], first[k + 1])]
        value, slope, bend = _shapes(degrees[k], h, x)
        heavy = _along(numbers.get("mass"), s)
        # Mass between a place and the element's end, by the same rule on what is left of it.
        left = a + h - s
        inner = s[:, None] + 0.5 * left[:, None] * (x + 1.0)
        part = _along(numbers.get("mass"), inner.ravel()).reshape(inner.shape)
        load = gamma * (beyond[k] + 0.5 * left * (part @ (w / (0.5 * h))))
        load += named["Tension"] + sum(pull for at, pull in pulls if at > a + 0.5 * h)
        at = np.ix_(where, where)
        mass[at] += value.T * (w * heavy) @ value
        plain[at] += value.T * w @ value
        gyro[at] += value.T * w @ slope - slope.T * w @ value
        slopes[at] += slope.T * w @ slope
        tension[at] += slope.T * (w * load) @ slope
        bending[at] += bend.T * (w * _along(numbers.get("stiffness"), s)) @ bend
    tip, direction = 2 * ends.size - 2, -1.0 if numbers.get("flow") == "aspirating" else 1.0
    end, follower = np.zeros((2, size, size))
    end[tip, tip], follower[tip, tip + 1] = numbers.get("inflow_share", 1.0), 1.0
    damping = numbers.get("damping", 0.0) * bending + named["Viscosity"] * plain
    mass += named["AddedMass"] * plain
    still = bending + tension + named["Foundation"] * plain
    for law, of in terms:
        if law in ("PointMass", "Spring", "Damper"):
            i = 2 * int(np.searchsorted(ends, of["at"]))
            into = {"PointMass": mass, "Spring": still, "Damper": damping}[law]
            into[i, i] += next(v for name, v in of.items() if name != "at")
    root = numbers.get("root", "clamped")
    if not isinstance(root, str):
        still[1, 1] += root
    fixed = {
        0,
        *([1] if root == "clamped" else []),
        *(2 * int(np.searchsorted(ends, s)) for s in supports),
    }
    held = numbers.get("end", "free")
    fixed |= {tip} if held in ("pinned", "clamped") else set()
    fixed |= {tip + 1} if held in ("guided", "clamped") else set()
    free = [i for i in range(size) if i not in fixed]
    flow = direction * math.sqrt(beta)
    loss = numbers.get("hysteresis", 0.0)
    thrust = numbers.get("alpha", 1.0) * (follower - slopes)
    every = (
        mass,
        flow * gyro,
        flow * end,
        damping,
        still,
        thrust,
        loss * bending if loss else None,
    )
    elastic = (bending + plain)[np.ix_(free, free)]
    lower = linalg.cholesky(elastic, lower=True)

    def scaled(matrix: Array | None) -> Array | None:
        if matrix is None:
            return None
        half = linalg.solve_triangular(lower, matrix[np.ix_(free, free)], lower=True)
        return linalg.solve_triangular(lower, half.T, lower=True).T

    made = [scaled(matrix) for matrix in every]
    for i in (0, 2, 3, 4):
        made[i] = 0.5 * (made[i] + made[i].T)
    made[1] = 0.5 * (made[1] - made[1].T)
    if held in ("pinned", "clamped"):
        made[5] = 0.5 * (made[5] + made[5].T)
    return System(*made)


def wave_number(numbers: dict[str, Any], end: float) -> float:
    """Of the shortest waves that may matter: those the flow reaches, and those that it feeds.

    An aspirating pipe is fed at 2 sqrt(beta) u in every mode, and damping must take that.
    """
    soft = 1.0
    if "stiffness" in numbers:
        soft = min(0.9 * min(map(sum, numbers["stiffness"][1])), 1.0)
    wave = 1.3 * end / math.sqrt(soft) + 8.0
    if numbers.get("flow") == "aspirating":
        loss = numbers.get("hysteresis", 0.0)
        fed = 4.0 * math.sqrt(numbers["beta"]) * end * numbers.get("inflow_share", 1.0)
        if fed:
            wave = max(
                wave,
                1.2 / math.sqrt(max(loss / fed, math.sqrt(numbers["damping"] / fed), 1e-6)) + 8.0,
            )
    return wave


def continuum_changes(numbers: dict[str, Any], end: float) -> Answer:
    """Every change of the continuous pipe, from elements of one degree and the next but three.

    The errors are what the changes move between the two. Raises `Unsure` where they differ in kind.
    """
    wave = wave_number(numbers, end)
    coarse, fine = (elements(numbers, wave, more) for more in (0, 4))
    found = all_changes(coarse, end)
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
