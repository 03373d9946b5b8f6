# SPDX-License-Identifier: MIT
"""The equations of a cycle on panels: a Radau IIA method on each, and Newton's method for all.

The stages are eliminated panel by panel, which leaves y(k+1) = T(k) y(k) + g(k); orthogonal
transformations then eliminate the states in pairs down to L y(0) + R y(end) = c (Wright 1992). No
product of the T is formed, so that neither modes that decay at once nor large multipliers cost
digits. The cost is linear in the number of panels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre

from pipedyn.bifurcation.fourier import Elsewhere
from pipedyn.bifurcation.mesh import RADAU, STAGES, Course
from pipedyn.bifurcation.vector_field import Field
from pipedyn.util.check import Array
from pipedyn.util.counters import factorised

MOST_ENTRIES = 500_000
"""Numbers in the stages' matrices that are made at a time: what a cache holds."""

MOST_STEPS, MOST_SLOW = 15, 3
"""Of Newton's method, and such in a row as are not half as long as the one before."""


# ------------------------------------------------------------------------------------- one panel


@dataclass(frozen=True)
class _Answers:
    """What the panels answer to small changes.

    Attributes:
        pushes: of the stages to the state at the beginning, to what they miss, to the frequency and
            to the speed, shape (M, s, width, 2 moving + 3).
        ends: of the state at the end to the same, shape (M, 2 moving, 2 moving + 3).
    """

    pushes: Array
    ends: Array


def _answers(motion: Field, course: Course) -> _Answers:
    """Variational equations of the panels."""
    count, _, width = course.pushes.shape
    piece = max(1, MOST_ENTRIES // (STAGES * width) ** 2)
    parts = [
        _answered(
            motion,
            replace(
                course,
                edges=course.edges[i : i + piece + 1],
                starts=course.starts[i : i + piece],
                pushes=course.pushes[i : i + piece],
            ),
        )
        for i in range(0, count, piece)
    ]
    pushes, ends = (np.concatenate(part) for part in zip(*parts, strict=True))
    return _Answers(pushes, ends)


def _answered(motion: Field, course: Course) -> tuple[Array, Array]:
    """The same of a few."""
    count, _, width = course.pushes.shape
    size, half, u = motion.size, motion.half, course.u
    stages = course.stages()
    y = np.ascontiguousarray(stages.reshape(-1, size).T)
    missed = motion(y, u)[-width:].T.reshape(course.pushes.shape) - course.pushes
    by_speed = motion.by_speed(y, u)[-width:].T.reshape(course.pushes.shape)
    rows = motion.jacobians(y, u)[:, -width:].reshape(count, STAGES, width, size)
    h = course.steps[:, None, None]
    by_start, by_time = _carried(motion, course, h)
    by_frequency = -h / course.frequency * by_time
    forced = np.stack([missed, np.zeros_like(missed), by_speed], axis=-1)
    forced[..., 1] = (rows @ by_frequency[..., None])[..., 0]
    right = np.concatenate([rows @ by_start, forced], axis=-1)

    def spread(block: Array, weights: Array) -> Array:
        return block[:, :, :, None, :] * weights[:, None, :, None]

    if motion.tied:
        matrix = spread(-h[..., None] * rows, RADAU.once)
    else:
        matrix = spread(-(h[..., None] ** 2) * rows[..., :half], RADAU.twice)
        matrix += spread(-h[..., None] * rows[..., half:], RADAU.once)
    matrix = matrix.reshape(count, STAGES * width, STAGES * width)
    matrix += np.eye(STAGES * width)
    factorised(count)
    found = np.linalg.solve(matrix, right.reshape(count, STAGES * width, size + 3))
    found = found.reshape(count, STAGES, width, size + 3)
    ends = np.zeros((count, size, size + 3))
    ends[..., :size] = by_start[:, -1]
    ends[..., size + 1] = by_frequency[:, -1]
    ends[:, -width:] += h * np.tensordot(RADAU.once[-1], found, (0, 1))
    if not motion.tied:
        ends[:, :half] += h**2 * np.tensordot(RADAU.twice[-1], found, (0, 1))
    return found, ends


def _carried(motion: Field, course: Course, h: Array) -> tuple[Array, Array]:
    """How stages follow from the first state and the time taken while the pushes stay."""
    size, half = motion.size, motion.half
    by_start = np.zeros((len(course.starts), STAGES, size, size)) + np.eye(size)
    once = RADAU.once @ course.pushes
    if motion.tied:
        return by_start, once
    lag = RADAU.nodes[:, None]
    by_start[..., :half, half:] += (h * lag)[..., None] * np.eye(half)
    further = lag * course.starts[:, None, half:] + 2.0 * h * (RADAU.twice @ course.pushes)
    return by_start, np.concatenate([further, once], axis=2)


# ------------------------------------------------------------------------------------ all panels


@dataclass(frozen=True)
class _Link:
    """L x(begin) + R x(end) = C, for one panel or several.

    Attributes:
        first, last, right: stacks of L, R and C, shape (k, n, n) twice and (k, n, r).
    """

    first: Array
    last: Array
    right: Array

    def paired(self) -> tuple[_Link, tuple[Array, _Link]]:
        """Links of twice the length, and the triangles and rest that give the states between."""
        n, whole = self.first.shape[1], 2 * (len(self.first) // 2)
        a, b = (
            _Link(self.first[i:whole:2], self.last[i:whole:2], self.right[i:whole:2])
            for i in (0, 1)
        )
        factorised(whole // 2)
        q, r = np.linalg.qr(np.concatenate([a.last, b.first], axis=1), mode="complete")
        turned = q.transpose(0, 2, 1)
        first = turned[:, :, :n] @ a.first
        last = turned[:, :, n:] @ b.last
        right = turned[:, :, :n] @ a.right + turned[:, :, n:] @ b.right
        longer = (first[:, n:], last[:, n:], right[:, n:])
        odd = (self.first[whole:], self.last[whole:], self.right[whole:])
        joined = _Link(*(np.concatenate(pair) for pair in zip(longer, odd, strict=True)))
        return joined, (r[:, :n], _Link(first[:, :n], last[:, :n], right[:, :n]))


_Passed = list[tuple[Array, _Link]]


def _collapsed(answers: _Answers, right: Array, units: Array) -> tuple[_Link, _Passed]:
    """One link over all the panels, in units of the state, and what gives the states between."""
    n, passed = units.size, []
    through = answers.ends[:, :, :n] * units / units[:, None]
    link = _Link(-through, np.zeros_like(through) + np.eye(n), right / units[:, None])
    while len(link.first) > 1:
        link, between = link.paired()
        passed.append(between)
    return link, passed


def _restored(ends: Array, passed: _Passed, factors: Array) -> Array:
    """States at all ends of panels from the first and the last, shape (2, n) to (M + 1, n)."""
    for triangles, rest in reversed(passed):
        pairs = len(triangles)
        known = (rest.right @ factors)[..., None]
        known -= rest.first @ ends[:pairs, :, None] + rest.last @ ends[1 : pairs + 1, :, None]
        more = np.empty((len(ends) + pairs, ends.shape[1]))
        more[0 : 2 * pairs + 1 : 2] = ends[: pairs + 1]
        more[1 : 2 * pairs : 2] = np.linalg.solve(triangles, known)[..., 0]
        more[2 * pairs + 1 :] = ends[pairs + 1 :]
        ends = more
    return ends


def _units(motion: Field, course: Course) -> Array:
    """Units of the state in which its fastest mode turns at the rate of its coordinates."""
    stiffest = motion.jacobian(course.starts[0], course.u)[motion.half :, : motion.half]
    units = np.ones(motion.size)
    units[motion.half :] = math.sqrt(max(float(np.abs(stiffest).max()), 1.0))
    return units


# --------------------------------------------------------------------------- what is asked of it


@dataclass(frozen=True)
class Condition:
    """What takes the place of a given speed: rows @ (y(0), omega, u) = values.

    Attributes:
        rows: the first fixes the phase, shape (2, 2 moving + 2).
        values: shape (2,).
    """

    rows: Array
    values: Array


def head(course: Course) -> Array:
    """(y(0), omega, u), shape (2 moving + 2,)."""
    return np.append(course.starts[0], [course.frequency, course.u])


def solved(
    motion: Field, course: Course, tolerance: float, condition: Condition | None = None
) -> Course:
    """The cycle near a course, on its panels, by Newton's method.

    Args:
        motion: the model's.
        course: where to begin.
        tolerance: the last step, relative; one that shrinks no more may end at 1e3 times that.
        condition: what takes the place of the speed.

    Raises:
        Elsewhere: if it is lost.
    """
    units, last, slow = _units(motion, course), math.inf, 0
    begun, size = course.frequency, course.size
    for _ in range(MOST_STEPS):
        with np.errstate(over="raise", invalid="raise"):
            try:
                course, moved = _newton(motion, course, units, condition)
            except (FloatingPointError, ValueError, np.linalg.LinAlgError) as error:
                raise Elsewhere("Newton's method left finite numbers") from error
        if course.size < 0.03 * size:
            raise Elsewhere("it shrank to rest")
        far = course.size > 30.0 * size or not 0.1 * begun < course.frequency < 10.0 * begun
        if far or course.u <= 0.0:
            raise Elsewhere("Newton's method left the neighbourhood of its start")
        if moved <= tolerance or (last < 1e3 * tolerance and moved >= 0.5 * last):
            return course
        slow = slow + 1 if moved > 0.5 * last else 0
        if condition is not None and slow == MOST_SLOW:  # a shorter step is cheaper
            break
        last = moved
    raise Elsewhere("Newton's method did not converge")


def _newton(
    motion: Field, course: Course, units: Array, condition: Condition | None
) -> tuple[Course, float]:
    """One step, and by what share of the cycle's size it goes."""
    n, mirror = motion.size, course.mirror
    answers = _answers(motion, course)
    right = answers.ends[:, :, n:].copy()
    right[:, :, 0] += course.stages()[:, -1]
    right[:, :, 0] -= np.concatenate([course.starts[1:], mirror * course.starts[:1]])
    link, passed = _collapsed(answers, right, units)
    whole, known = np.zeros((n + 2, n + 2)), np.zeros(n + 2)
    whole[:n, :n] = link.first[0] + mirror * link.last[0]
    whole[:n, n:] = -link.right[0, :, 1:]
    known[:n] = link.right[0, :, 0]
    if condition is None:
        # The speed stays, and y(0) moves across the motion.
        whole[n, :n] = motion(course.starts[:1].T, course.u)[:, 0] / units
        whole[n] /= np.linalg.norm(whole[n])
        whole[n + 1, n + 1] = 1.0
    else:
        whole[n:] = condition.rows * np.append(units, [1.0, 1.0])
        known[n:] = condition.values - condition.rows @ head(course)
    factorised()
    found = np.linalg.solve(whole, known)
    factors = np.array([1.0, found[n], found[n + 1]])
    starts = _restored(np.stack([found[:n], mirror * found[:n]]), passed, factors)[:-1] * units
    changes = np.concatenate([starts, np.tile(factors, (len(starts), 1))], axis=1)
    pushes = (answers.pushes @ changes[:, None, :, None])[..., 0]
    moved = max(
        float(np.abs(starts[:, : motion.half]).max()) / course.size,
        *(abs(found[n]) / course.frequency, abs(found[n + 1]) / course.u),
    )
    share = min(1.0, 0.5 / moved) if moved > 0.0 else 1.0
    return plus(course, starts, pushes, float(found[n]), float(found[n + 1]), share), moved


def plus(
    course: Course, starts: Array, pushes: Array, frequency: float, u: float, share: float
) -> Course:
    """A course with a share of a change."""
    return Course(
        *(course.edges, course.starts + share * starts, course.pushes + share * pushes),
        *(course.frequency + share * frequency, course.u + share * u),
    )


def through(motion: Field, course: Course) -> tuple[Array, Array]:
    """L and R of L y(0) + R y(span) = 0 for small changes along a course, (2 moving,) * 2 each."""
    units = _units(motion, course)
    answers = _answers(motion, course)
    link, _ = _collapsed(answers, answers.ends[:, :, :0], units)
    return link.first[0] / units, link.last[0] / units


def residual(motion: Field, course: Course) -> float:
    """Largest |dy/dt - f(y)| half-way between the stages, of the accelerations, relative."""
    share = np.concatenate([[0.0], RADAU.nodes])
    share = 0.5 * (share[:-1] + share[1:])
    between = legendre.legvander(2.0 * share - 1.0, STAGES - 1) @ RADAU.waves
    told = (between @ course.pushes)[:, :, -motion.half :]
    phase = course.edges[:-1, None] + np.diff(course.edges)[:, None] * share
    true = motion(course.states(phase.ravel()), course.u)[motion.half :]
    return float(np.abs(told.reshape(true.T.shape) - true.T).max() / np.abs(true).max())
