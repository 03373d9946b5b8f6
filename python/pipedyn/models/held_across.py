# SPDX-License-Identifier: MIT
"""Large motions of a reduced model whose pipe is held across, x = 0, at its end or between.

The core's functions need not be 0 there; forces along x keep their sum so. What an integrator's
state misses decays in its motion. Recorded is a projection of the state that meets the supports.
"""

from __future__ import annotations

import numpy as np

from pipedyn import _core
from pipedyn.models.base import resolved
from pipedyn.util.check import Array

ROUNDING = 1e-13
"""x at a support, in L, that counts as 0: a hundred times rounding."""

ITERATIONS = 30
"""Newton's method takes four or five where supports are missed by 0.1."""


class HeldAcross:
    """Where the supports of a reduced model hold its states.

    Args:
        core: the compiled model, of `size` functions.
    """

    def __init__(self, core: _core.Galerkin) -> None:
        self.core = core
        stiffness = core.elastic_stiffness()
        self.ease = 1.0 / np.maximum(stiffness, 1.0)[:, None]  # steps of least elastic energy
        self.size = stiffness.size

    def held(self, q: Array) -> tuple[Array, Array]:
        """Places x at supports, (supports, k), of columns q; their derivatives (k, supports, size).

        NaN where q coils the pipe more often than the core resolves.
        """
        found = self.core.held(np.concatenate([q, np.zeros_like(q)]))
        places, by = np.split(found, [self.core.supports])
        return places, by.reshape(len(places), self.size, -1).transpose(2, 0, 1)

    def projected(self, q: Array, rates: Array) -> tuple[Array, Array]:
        """Coordinates and rates that meet the supports, close to those given; NaN without any."""
        columns, turning = (of.reshape(self.size, -1).copy() for of in (q, rates))
        missed, by = self.held(columns)
        for _ in range(ITERATIONS):
            if not np.nanmax(np.abs(missed), initial=0.0) > 0.1 * ROUNDING:
                break
            columns -= self._step(by, missed)
            missed, by = self.held(columns)
        off = ~(np.abs(missed) <= ROUNDING).all(axis=0)
        by[off] = np.nan
        turning -= self._step(by, np.einsum("kbi,ik->bk", by, turning))
        columns[:, off] = turning[:, off] = np.nan
        return columns.reshape(q.shape), turning.reshape(rates.shape)

    def _step(self, by: Array, missed: Array) -> Array:
        """The least change of each column by which places at the supports change by `missed`."""
        eased = by * self.ease.T
        lost = ~np.isfinite(by).all(axis=(1, 2))
        inverse = np.full((*by.shape[:2], by.shape[1]), np.nan)
        inverse[~lost] = np.linalg.pinv(eased[~lost] @ by[~lost].transpose(0, 2, 1))
        return np.asarray(np.einsum("kbi,kbc,ck->ik", eased, inverse, missed))

    def allowed(self, q: Array) -> Array:
        """Orthonormal changes of coordinates that the supports leave, (size, size - supports).

        Raises NotResolved where q coils the pipe more often than the core resolves.
        """
        by = resolved("operators", lambda: self.held(q[:, None])[1])
        vectors, _ = np.linalg.qr(by[0].T, mode="complete")
        return np.asarray(vectors[:, len(by[0]) :])

    def free_states(self, y: Array) -> Array:
        """The same of states [q, q'], (2 size, 2 (size - supports))."""
        q, rates = np.split(y, 2)
        # The derivative of the rates of x by q is that of the derivatives of x along the motion:
        # central differences of sixth order.
        turning = float(np.abs(self.core.basis(np.linspace(0.0, 1.0, 41), 1) @ rates).max())
        step = 0.01 / max(turning, 1e-100)
        _, by = self.held(q[:, None] + step * np.arange(-3, 4) * rates[:, None])
        drift = np.tensordot(np.array([-1, 9, -45, 0, 45, -9, 1]) / (60.0 * step), by, 1)
        vectors, _ = np.linalg.qr(np.block([[by[3], 0.0 * drift], [drift, by[3]]]).T, "complete")
        return np.asarray(vectors[:, 2 * len(drift) :])
