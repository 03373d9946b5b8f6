# SPDX-License-Identifier: MIT
"""The models of a pipe: chain, reduced model, continuous pipe and scenes from parts."""
