# SPDX-License-Identifier: MIT
"""Pulsating flow and a moving base: forced responses and parametric regions."""
