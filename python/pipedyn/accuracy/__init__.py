# SPDX-License-Identifier: MIT
"""Error against cost, and the cheapest model that is good enough."""
