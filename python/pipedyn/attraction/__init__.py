# SPDX-License-Identifier: MIT
"""Where motions end: one engine for attractors, their names, basins and exponents."""
