# SPDX-License-Identifier: MIT
"""Cases in which the plain eigenvalue problem loses its digits."""
