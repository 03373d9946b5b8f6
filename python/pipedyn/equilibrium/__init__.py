# SPDX-License-Identifier: MIT
"""Equilibria of the pipe, their branches, and Hopf points with their normal forms."""
