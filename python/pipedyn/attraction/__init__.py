# SPDX-License-Identifier: MIT
"""Ends of motions: one engine for attractors, their names, basins and exponents."""
