# SPDX-License-Identifier: MIT
"""Periodic orbits: collocation on a mesh, Floquet multipliers, and steps along a branch of them."""
