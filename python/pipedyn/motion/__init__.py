# SPDX-License-Identifier: MIT
"""Motion in time."""
