# SPDX-License-Identifier: MIT
"""Pictures of results. Every picture draws on a matplotlib Axes and returns it.

Pictures of the linear analysis take the Axes first; those of motion make their own where none is
given. Magnitudes are shown by colours that grow in lightness, and every distinction made by colour
is made a second time by line style, marker or outline, so that pictures survive grey print.
"""

from matplotlib.figure import Figure

from pipedyn.plot.bifurcation import bifurcation_diagram, multipliers, orbit
from pipedyn.plot.boundary import boundaries, stability_map
from pipedyn.plot.linear import (
    FAMILY_STYLES,
    NEUTRAL,
    convergence,
    dot_stride,
    frequencies,
    mode_shapes,
    root_loci,
)
from pipedyn.plot.pipes import animate, snapshots
from pipedyn.plot.style import (
    BETA_LABEL,
    BLACK,
    BLUE,
    CURVE_STYLES,
    FREQUENCY_LABEL,
    GREEN,
    IMAGINARY_LABEL,
    ORANGE,
    PURPLE,
    REAL_LABEL,
    SKY,
    SPEED_LABEL,
    TIME_LABEL,
    VERMILION,
    colour_bar,
    notice,
    panels,
    style,
)
from pipedyn.plot.time_series import phase_portrait, time_history
from pipedyn.plot.trade import trade

__all__ = [
    "BETA_LABEL",
    "BLACK",
    "BLUE",
    "CURVE_STYLES",
    "FAMILY_STYLES",
    "FREQUENCY_LABEL",
    "GREEN",
    "IMAGINARY_LABEL",
    "NEUTRAL",
    "ORANGE",
    "PURPLE",
    "REAL_LABEL",
    "SKY",
    "SPEED_LABEL",
    "TIME_LABEL",
    "VERMILION",
    "Figure",
    "animate",
    "bifurcation_diagram",
    "boundaries",
    "colour_bar",
    "convergence",
    "dot_stride",
    "frequencies",
    "mode_shapes",
    "multipliers",
    "notice",
    "orbit",
    "panels",
    "phase_portrait",
    "root_loci",
    "snapshots",
    "stability_map",
    "style",
    "time_history",
    "trade",
]
