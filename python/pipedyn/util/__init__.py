# SPDX-License-Identifier: MIT
"""Tools for all other folders: checks of arguments, results, files, counters, threads, tables."""
