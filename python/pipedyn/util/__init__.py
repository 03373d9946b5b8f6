# SPDX-License-Identifier: MIT
"""What every layer uses: argument checks, counters, threads, progress, tables."""
