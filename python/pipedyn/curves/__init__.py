# SPDX-License-Identifier: MIT
"""Curves in the plane of two numbers: boundaries of stability, and of events of cycles."""
