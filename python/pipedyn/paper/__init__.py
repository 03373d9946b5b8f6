# SPDX-License-Identifier: MIT
"""The paper's analysis in one command."""
