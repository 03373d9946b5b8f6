# SPDX-License-Identifier: MIT
"""Pictures of results. Most functions draw on matplotlib Axes and return them.

The Axes are the keyword argument `ax`; without it a function makes a new figure. `units="si"` shows
SI units if the pipe was made with `Pipe.from_si`. `animate` returns a film, `films` a film of each
attractor. Colours of magnitudes grow in lightness. Whatever differs in colour also differs in line
style, marker or outline, so that pictures can be printed in grey.
"""

from types import ModuleType as _ModuleType

from matplotlib.figure import Figure as Figure

from pipedyn.plot.accuracy import FAMILY_STYLES as FAMILY_STYLES
from pipedyn.plot.accuracy import convergence as convergence
from pipedyn.plot.accuracy import trade as trade
from pipedyn.plot.attractors import basins as basins
from pipedyn.plot.attractors import films as films
from pipedyn.plot.attractors import poincare_section as poincare_section
from pipedyn.plot.attractors import spectrum as spectrum
from pipedyn.plot.bifurcation import bifurcation_diagram as bifurcation_diagram
from pipedyn.plot.bifurcation import multipliers as multipliers
from pipedyn.plot.common import BETA_LABEL as BETA_LABEL
from pipedyn.plot.common import BLACK as BLACK
from pipedyn.plot.common import BLUE as BLUE
from pipedyn.plot.common import CURVE_STYLES as CURVE_STYLES
from pipedyn.plot.common import FREQUENCY_LABEL as FREQUENCY_LABEL
from pipedyn.plot.common import GREEN as GREEN
from pipedyn.plot.common import IMAGINARY_LABEL as IMAGINARY_LABEL
from pipedyn.plot.common import ORANGE as ORANGE
from pipedyn.plot.common import PURPLE as PURPLE
from pipedyn.plot.common import REAL_LABEL as REAL_LABEL
from pipedyn.plot.common import SKY as SKY
from pipedyn.plot.common import SPEED_LABEL as SPEED_LABEL
from pipedyn.plot.common import TIME_LABEL as TIME_LABEL
from pipedyn.plot.common import VERMILION as VERMILION
from pipedyn.plot.common import colour_bar as colour_bar
from pipedyn.plot.common import notice as notice
from pipedyn.plot.common import style as style
from pipedyn.plot.exploration import Exploration as Exploration
from pipedyn.plot.exploration import explore as explore
from pipedyn.plot.forced import forced_response as forced_response
from pipedyn.plot.forced import frequency_response as frequency_response
from pipedyn.plot.forced import parametric_regions as parametric_regions
from pipedyn.plot.linear import dot_stride as dot_stride
from pipedyn.plot.linear import frequencies as frequencies
from pipedyn.plot.linear import mode_shapes as mode_shapes
from pipedyn.plot.linear import root_loci as root_loci
from pipedyn.plot.motion import animate as animate
from pipedyn.plot.motion import phase_portrait as phase_portrait
from pipedyn.plot.motion import snapshots as snapshots
from pipedyn.plot.motion import time_history as time_history
from pipedyn.plot.stability_map import boundary as boundary
from pipedyn.plot.stability_map import cycle_boundary as cycle_boundary
from pipedyn.plot.stability_map import stability_map as stability_map
from pipedyn.util.hints import with_hints as _with_hints

__all__ = sorted(
    name for name, one in globals().items() if not isinstance(one, _ModuleType) and name[0] != "_"
)
globals().update({name: _with_hints(globals()[name], __name__) for name in __all__})


def __dir__() -> list[str]:
    """The functions and classes that users call, without colours, styles and modules."""
    return [name for name in __all__ if callable(globals()[name]) and name != "Figure"]
