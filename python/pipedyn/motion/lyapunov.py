# SPDX-License-Identifier: MIT
"""The largest Lyapunov exponent: how fast neighbours of a motion part, or join it.

Along the motion y' = f(y) a small difference obeys v' = J(y) v with the analytic Jacobian. v is
brought back to unit length at short intervals; the logarithms of its growth, divided by the time,
tend to the exponent.

Source: Benettin, Galgani, Giorgilli and Strelcyn (1980); the spread is that of means over blocks.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from scipy.integrate import ode
from scipy.linalg import block_diag

from pipedyn.bifurcation.cycles import LimitCycle
from pipedyn.linear.modes import LARGEST_SPEED
from pipedyn.models.base import Model, NotConverged
from pipedyn.motion.simulate import (
    Motion,
    Start,
    checked_model_in_motion,
    choose_method,
    state_of,
)
from pipedyn.util import check
from pipedyn.util.check import Array
from pipedyn.util.counters import evaluated
from pipedyn.util.progress import track

Rates = Callable[[Array], Array]
"""Right-hand side y' of a state, shape (n,)."""

ExponentStart: TypeAlias = LimitCycle | Motion | Start | None
"""Where a motion begins."""

KINDS = "a LimitCycle, a Motion, an angle theta(s), coordinates or a state [q, q']"
"""What a start may be."""

METHODS = ("variational", "pair")

APART = 1e-7
"""Distance of a pair of neighbours, in the norm of the state, after each interval."""

MOST_INTERVALS = 10_000_000


@dataclass(frozen=True)
class LyapunovExponent:
    """The largest Lyapunov exponent of a motion, with its statistical error.

    Attributes:
        value: in 1 / T; 0 on a limit cycle, the largest real part of an eigenvalue where the motion
            comes to rest, above 0 where it is chaotic.
        spread: standard error of the value, from the means over blocks, from what lies between the
            means of the two halves and from how far the difference's length breathes. A value
            within a few of these around 0 is 0.
        blocks: mean over each block, shape (blocks,).
        t: ends of the intervals from the end of the transient on, shape (S,).
        history: the value as it stood at these times, shape (S,).
        duration: over which it was taken.
        end: [p, p'] at the end, shape (2 moving,): a start for more.
    """

    value: float
    spread: float
    blocks: Array = field(repr=False)
    t: Array = field(repr=False)
    history: Array = field(repr=False)
    duration: float
    end: Array = field(repr=False)

    @property
    def chaotic(self) -> bool:
        """Whether the value is above 0 by more than three times its spread."""
        return self.value > 3.0 * self.spread


def lyapunov_exponent(
    model: Model,
    u: float,
    start: ExponentStart = None,
    *,
    duration: float = 200.0,
    transient: float = 100.0,
    blocks: int = 10,
    interval: float = 0.5,
    method: str = "variational",
    rtol: float = 1e-8,
    progress: bool = False,
) -> LyapunovExponent:
    """The largest Lyapunov exponent of the motion that a start leads to.

    Args:
        model: chain, reduced model or scene. Where guides and pins are, directions that these
            forbid count as decaying at rate 10.
        u: flow speed >= 0, in sqrt(EI / mu_f) / L.
        start: a `LimitCycle`, on which it begins; a `Motion`, at whose end; the angle theta(s) of
            the bent pipe or coordinates, at rest; or a state [q, q'], shape (2 coordinates,). Where
            not given, the pipe bent a little.
        duration: over which growth is measured, in T, after the transient.
        transient: time left out before, in which the motion finds its attractor and the difference
            its direction.
        blocks: parts of the duration whose means tell the spread, at least 4.
        interval: after which the difference is brought back to unit length, in T; the largest that
            divides a block and is not longer is taken.
        method: "variational", by the analytic Jacobian; "pair", by two neighbouring motions in one
            batch, which needs no Jacobian and is the cheaper for long chains.
        rtol: relative tolerance of the error of each step, in [1e-13, 1e-3].
        progress: show progress on stderr.

    Returns:
        LyapunovExponent.

    Raises:
        NotConverged: if the integration stops.
        ValueError, TypeError: for bad arguments.
    """
    model = checked_model_in_motion(model)
    u = check.real("u", u, low=0.0, high=LARGEST_SPEED)
    state = _started(model, start)
    duration = check.real("duration", duration, low=1e-3, high=1e6)
    transient = check.real("transient", transient, low=0.0, high=1e6)
    blocks = check.count("blocks", blocks, low=4, high=10_000)
    interval = check.real("interval", interval, low=1e-6, high=1e3)
    method = check.choice("method", method, METHODS)
    rtol = check.real("rtol", rtol, low=1e-13, high=1e-3)
    shown = check.flag("progress", progress)
    if (duration + transient) / min(interval, duration / blocks) > MOST_INTERVALS:
        raise ValueError(f"interval must cut the time into at most {MOST_INTERVALS} parts")

    return exponent_from(
        *(model, u, state, duration, transient, blocks, interval),
        pair=method == "pair",
        rtol=rtol,
        shown=shown,
    )


def exponent_from(
    model: Model,
    u: float,
    state: Array,
    duration: float,
    transient: float,
    blocks: int = 10,
    interval: float = 0.5,
    *,
    pair: bool = False,
    rtol: float = 1e-8,
    shown: bool = False,
) -> LyapunovExponent:
    """`lyapunov_exponent` of checked arguments, from [p, p'], shape (2 moving,)."""
    motion = model.motion

    def rates(y: Array) -> Array:
        work = np.zeros((1, *y.shape[1:]))
        evaluated(y[0].size)
        return motion.rhs_and_power(0.0, np.concatenate([y, work]), u)[:-1]

    def jacobian(y: Array) -> Array:
        evaluated(1)
        return model.motion_jacobian(y, u)

    return largest_exponent(
        rates,
        jacobian,
        state,
        *(duration, transient, blocks, interval),
        pair=pair,
        rtol=rtol,
        stiff=choose_method(model, rtol) == "lsoda",
        shown=shown,
    )


def _started(model: Model, start: Any) -> Array:
    """[p, p'] of the argument start."""
    if isinstance(start, Motion | LimitCycle):
        kind, at = ("motion", -1) if isinstance(start, Motion) else ("cycle", 0)
        if start.model is not model and start.q.shape[1] != model.coordinates:
            raise ValueError(
                f"start must be a {kind} of the model, with {model.coordinates} coordinates, got "
                f"{start.q.shape[1]}"
            )
        return np.array(model.start(start.q[at], start.qdot[at]))
    return state_of(model, "start", _bend if start is None else start, KINDS)


def _bend(s: Array) -> Array:
    return 0.05 * s**2


def largest_exponent(
    rates: Rates,
    jacobian: Callable[[Array], Array],
    start: Array,
    duration: float,
    transient: float,
    blocks: int,
    interval: float,
    *,
    pair: bool = False,
    rtol: float = 1e-8,
    stiff: bool = False,
    shown: bool = False,
) -> LyapunovExponent:
    """The largest exponent of any y' = f(y).

    Args:
        rates: f; with `pair` of two states at once, shape (n, 2).
        jacobian: df/dy, (n, n).
        start: y at time 0, shape (n,).
        duration: as for `lyapunov_exponent`, and so are the next three.
        transient: time left out before.
        blocks: parts of the duration.
        interval: longest time between two rescalings.
        pair: follow two neighbours, not the variational equation.
        rtol: relative tolerance; that of v, of unit length, is absolute as well.
        stiff: take an implicit method.
        shown: show progress.

    Raises:
        NotConverged: if the integration stops.
    """
    each = max(math.ceil(duration / blocks / interval), 1)
    step = duration / blocks / each
    before = math.ceil(transient / step)
    walk = _Pair if pair else _Variational
    going = walk(rates, jacobian, start, rtol, stiff)
    grown = np.empty(before + blocks * each)
    for i in track(range(grown.size), grown.size, "exponent", shown):
        grown[i] = going.advanced(step)
    grown = grown[before:]
    t = step * np.arange(1.0, grown.size + 1.0)
    means = grown.reshape(blocks, each).mean(axis=1) / step
    value = float(means.mean())
    standard = float(means.std(ddof=1)) / math.sqrt(blocks)
    half = blocks // 2
    drift = 0.5 * abs(float(means[:half].mean() - means[-half:].mean()))
    # The difference's length breathes with the motion: where it ends in its breath is chance.
    breath = float(np.ptp(np.cumsum(grown) - value * t)) / duration
    return LyapunovExponent(
        value=value,
        spread=max(standard, drift, breath),
        blocks=means,
        t=t,
        history=np.cumsum(grown) / t,
        duration=duration,
        end=going.state,
    )


class _Walk:
    """A state and a small difference that advance together."""

    def __init__(
        self,
        rates: Rates,
        jacobian: Callable[[Array], Array],
        start: Array,
        rtol: float,
        stiff: bool,
    ) -> None:
        self.rates, self.jacobian, self.size = rates, jacobian, start.size
        self.rtol, self.stiff = rtol, stiff
        self.state = start.copy()
        self.away = np.cos(np.arange(start.size) + 0.5)  # in no direction of the system's own
        self.away /= np.linalg.norm(self.away)
        self.failed: BaseException | None = None

    def advanced(self, step: float) -> float:
        """Logarithm of the difference's growth over a step."""
        raise NotImplementedError

    def slopes(self, t: float, whole: Array) -> Array:
        raise NotImplementedError

    def _safe(self, t: float, whole: Array) -> Array:
        """Slopes, NaN where there are none: compiled integrators survive no exception."""
        try:
            if self.failed is None:
                return self.slopes(t, whole)
        except BaseException as error:
            self.failed = error
        return np.full(whole.size, np.nan)

    def _integrated(self, whole: Array, step: float, atol: Array | float) -> Array:
        solver = ode(self._safe, self._slopes_by_state) if self.stiff else ode(self._safe)
        options = {"with_jacobian": True} if self.stiff else {}
        name = "lsoda" if self.stiff else "dop853"
        solver.set_integrator(name, rtol=self.rtol, atol=atol, nsteps=10_000_000, **options)
        solver.set_initial_value(whole, 0.0)
        if not self.stiff:
            solver._integrator.iwork[3] = -1  # its test for stiffness ends runs that are none
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # said by the exception
            found: Array = solver.integrate(step)
        failed = self.failed
        if failed is not None and not isinstance(failed, ValueError):
            raise failed
        if not (solver.successful() and np.isfinite(found).all()):
            raise NotConverged("the motion stopped: its step shrank to nothing, or it left numbers")
        return found

    def _slopes_by_state(self, t: float, whole: Array) -> Array:
        """Of both halves alike; the Newton iteration does without the Jacobian's own change."""
        block = self.jacobian(whole[: self.size])
        result: Array = block_diag(block, block)
        return result


class _Variational(_Walk):
    def slopes(self, t: float, whole: Array) -> Array:
        y, v = whole[: self.size], whole[self.size :]
        return np.concatenate([self.rates(y), self.jacobian(y) @ v])

    def advanced(self, step: float) -> float:
        whole = np.concatenate([self.state, self.away])
        found = self._integrated(whole, step, 0.01 * self.rtol)
        self.state, away = found[: self.size], found[self.size :]
        length = float(np.linalg.norm(away))
        self.away = away / length
        return math.log(length)


class _Pair(_Walk):
    def slopes(self, t: float, whole: Array) -> Array:
        columns = np.ascontiguousarray(whole.reshape(2, self.size).T)
        return np.asarray(self.rates(columns)).T.ravel()

    def advanced(self, step: float) -> float:
        whole = np.concatenate([self.state, self.state + APART * self.away])
        # Both take the same steps, whose errors are alike: the distance may be below the relative
        # tolerance, but beside a state at rest not below the absolute one.
        found = self._integrated(whole, step, APART * self.rtol)
        self.state, away = found[: self.size], found[self.size :] - found[: self.size]
        length = float(np.linalg.norm(away))
        self.away = away / length
        return math.log(length / APART)


__all__ = ["LyapunovExponent", "largest_exponent", "lyapunov_exponent"]
