# SPDX-License-Identifier: MIT
"""Motion in time: integration, events, sampling, Lyapunov exponents and the vector field."""
