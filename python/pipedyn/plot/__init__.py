# SPDX-License-Identifier: MIT
"""Pictures of results. Most functions draw on matplotlib Axes and return them.

The Axes are the keyword argument `ax`; without it a function makes a new figure. `units="si"` shows
SI units if the pipe was made with `Pipe.from_si`. By default axes are nondimensional, some with a
second axis in SI units. `animate` returns a film, `films` a film of each attractor. Colours of
magnitudes grow in lightness. Whatever differs in colour also differs in line style, marker or
outline, so that pictures can be printed in grey.
"""

from matplotlib.figure import Figure

from pipedyn.plot.accuracy import FAMILY_STYLES, convergence, trade
from pipedyn.plot.attractors import basins, films, poincare_section, spectrum
from pipedyn.plot.bifurcation import bifurcation_diagram, multipliers, orbit
from pipedyn.plot.common import (
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
from pipedyn.plot.cycle_boundary import cycle_boundary
from pipedyn.plot.exploration import Exploration
from pipedyn.plot.forced import forced_response, frequency_response, parametric_regions
from pipedyn.plot.linear import dot_stride, frequencies, mode_shapes, root_loci
from pipedyn.plot.motion import animate, phase_portrait, snapshots, time_history
from pipedyn.plot.sliders import explore
from pipedyn.plot.stability_map import boundary, stability_map

__all__ = [
    "BETA_LABEL",
    "BLACK",
    "BLUE",
    "CURVE_STYLES",
    "FAMILY_STYLES",
    "FREQUENCY_LABEL",
    "GREEN",
    "IMAGINARY_LABEL",
    "ORANGE",
    "PURPLE",
    "REAL_LABEL",
    "SKY",
    "SPEED_LABEL",
    "TIME_LABEL",
    "VERMILION",
    "Exploration",
    "Figure",
    "animate",
    "basins",
    "bifurcation_diagram",
    "boundary",
    "colour_bar",
    "convergence",
    "cycle_boundary",
    "dot_stride",
    "explore",
    "films",
    "forced_response",
    "frequencies",
    "frequency_response",
    "mode_shapes",
    "multipliers",
    "notice",
    "orbit",
    "panels",
    "parametric_regions",
    "phase_portrait",
    "poincare_section",
    "root_loci",
    "snapshots",
    "spectrum",
    "stability_map",
    "style",
    "time_history",
    "trade",
]
