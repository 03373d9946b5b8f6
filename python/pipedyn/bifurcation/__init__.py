# SPDX-License-Identifier: MIT
"""Beyond the onset: equilibria, Hopf points, periodic orbits and their branches."""
