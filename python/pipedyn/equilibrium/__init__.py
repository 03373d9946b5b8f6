# SPDX-License-Identifier: MIT
"""Where the pipe rests: equilibria, their branches, and Hopf points with their normal forms."""
