# SPDX-License-Identifier: MIT
"""Linear analysis: eigenvalues, their tracking, crossings, critical speeds."""
