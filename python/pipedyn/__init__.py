# SPDX-License-Identifier: MIT
"""Dynamics of a pipe conveying fluid: chain, reduced-order and continuous models on one footing."""

from pipedyn.chain import Chain
from pipedyn.continuum import Continuum
from pipedyn.galerkin import Galerkin
from pipedyn.modal import (
    Crossing,
    CriticalSpeed,
    Derivatives,
    Failure,
    Modes,
    ModeShape,
    NoCrossing,
    RootLoci,
    Sensitivity,
    StabilityCurve,
    critical_speed,
    crossings,
    eigenvalues,
    modes,
    root_loci,
    stability_curve,
)
from pipedyn.model import Model, NotConverged, Operators, PipedynError
from pipedyn.pipe import Pipe, Scales, inlet_coefficient

__version__ = "0.1.0"

__all__ = [
    "Chain",
    "Continuum",
    "CriticalSpeed",
    "Crossing",
    "Derivatives",
    "Failure",
    "Galerkin",
    "ModeShape",
    "Model",
    "Modes",
    "NoCrossing",
    "NotConverged",
    "Operators",
    "Pipe",
    "PipedynError",
    "RootLoci",
    "Scales",
    "Sensitivity",
    "StabilityCurve",
    "critical_speed",
    "crossings",
    "eigenvalues",
    "inlet_coefficient",
    "modes",
    "root_loci",
    "stability_curve",
]
