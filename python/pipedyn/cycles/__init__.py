# SPDX-License-Identifier: MIT
"""Limit cycles of a pipe at a steady flow speed, and branches of them over the speed."""
