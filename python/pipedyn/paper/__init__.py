# SPDX-License-Identifier: MIT
"""The modal analysis of the paper, which the command computes, draws and reports."""
