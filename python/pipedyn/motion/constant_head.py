# SPDX-License-Identifier: MIT
"""The motion of a pipe fed at constant head: the flow speed is a state."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from pipedyn import _core
from pipedyn.models.base import ROWS, Model
from pipedyn.models.drive import Supply
from pipedyn.util.check import Array


class ConstantHead:
    """Equations of motion of a model whose pipe is fed at constant head.

    A state is [p, p', u], shape (2 integrated + 1,); integrators take [p, p', W, u] with the work
    W.

    Args:
        model: the model.
        supply: the supply that feeds the pipe.

    Raises ValueError if there is no flow at constant head.
    """

    def __init__(self, model: Model, supply: Supply) -> None:
        pipe = model.pipe
        if pipe.beta == 0.0:
            raise ValueError(
                "beta must be above 0 with a Supply: without mass the fluid has no speed of its own"
            )
        self.model, self.supply = model, supply
        self.speed = supply.speed(pipe)
        self.start = self.speed if supply.start is None else supply.start

    @property
    def largest_speed(self) -> float:
        """Largest speed to which the supply drives the flow: the speed at the start or at rest."""
        return max(self.start, self.speed)

    @cached_property
    def core(self) -> _core.Supply:
        """The compiled equation of the flow speed."""
        pipe, supply = self.model.pipe, self.supply
        numbers = (supply.head, supply.friction, supply.weight_in(pipe))
        return _core.Supply(self.model.core, *numbers, math.sqrt(pipe.beta), pipe.direction)

    def rates(self, y: Array, drive: Array | None = None) -> Array:
        """Rates of a state [p, p', W, u]; drive: the forcing without u', shape (ROWS,)."""
        base = np.zeros(ROWS) if drive is None else np.asarray(drive)
        return np.asarray(self.core.rates(y[:, None], base[:, None])[:, 0])

    def jacobian(self, y: Array, drive: Array | None = None) -> Array:
        """Derivative of the rates of one state [p, p', u] by that state.

        The result has the shape (2 integrated + 1, 2 integrated + 1). drive: the forcing without
        u', shape (ROWS,).
        """
        model, pipe, supply = self.model, self.model.pipe, self.supply
        n, state = model.integrated, y[:-1]
        u = max(float(y[-1]), 0.0)  # an implicit step may try u < 0, which has no rates
        change = float(self.rates(np.concatenate([state, [0.0, u]]), drive)[-1])
        now = np.zeros(ROWS) if drive is None else drive.copy()
        now[0] = change
        rates, by_speed, *slopes = model.motion_linearised(state[:, None], u, now[:, None])[0]
        acceleration = rates[n:]
        pushed = now + np.eye(now.size)[0]  # accelerations are affine in u'
        response = model.motion_rates(state, u, pushed)[n:] - acceleration
        axial = model.core.axial(np.concatenate([state, acceleration]), now)
        by_q, by_rates, by_acceleration, depth = np.split(axial[2:], 4)
        share = pipe.direction * pipe.beta
        pull = share * by_acceleration
        gradient = np.append(
            share * np.concatenate([by_q, by_rates]) + pull @ slopes[n:],
            pull @ by_speed[n:] + supply.friction * u,
        )
        gradient[:n] -= pipe.direction * supply.weight_in(pipe) * depth
        change_by = -gradient / (math.sqrt(pipe.beta) + pull @ response)
        whole = np.zeros((2 * n + 1, 2 * n + 1))
        whole[:-1, :-1] = slopes
        whole[n:-1, -1] = by_speed[n:]
        whole[n:-1] += np.outer(response, change_by)
        whole[-1] = change_by
        return whole

    def jacobians(self, y: Array) -> Array:
        """Jacobians of the rates at k states, shape (k, 2 integrated + 1, 2 integrated + 1)."""
        return np.stack([self.jacobian(column) for column in y.T.copy()])
