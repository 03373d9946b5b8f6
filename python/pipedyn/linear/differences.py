# SPDX-License-Identifier: MIT
"""Weights of the finite differences by which derivatives of operators are taken."""

import numpy as np

STENCIL = np.array([45.0, -9.0, 1.0]) / 60.0
"""Weights of central differences of sixth order, for 1, 2 and 3 steps to either side."""
