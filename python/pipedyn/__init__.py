# SPDX-License-Identifier: MIT
"""Dynamics of a pipe conveying fluid: chain, reduced-order and continuous models on one footing."""

from importlib import import_module as _import_module
from types import ModuleType as _ModuleType

from pipedyn import continuation, modular
from pipedyn.accuracy.choose import Choice, NoModel, choose
from pipedyn.accuracy.effects import Effect, Relevance, relevant
from pipedyn.accuracy.trade import Trade, TradeRow, trade
from pipedyn.attraction.attractor import Attractor
from pipedyn.attraction.attractors import (
    Attractors,
    Basin,
    Share,
    StartFailure,
    StartPlane,
    attractors,
)
from pipedyn.curves.boundary import Boundary, BoundaryCurve, boundary
from pipedyn.curves.cycle_boundary import CycleBoundary, cycle_boundary
from pipedyn.curves.event_curve import CycleCurve, CyclePoint
from pipedyn.curves.organising import OrganisingPoint
from pipedyn.cycles.branches import CycleBranch, CycleEvent
from pipedyn.cycles.limit_cycle import LimitCycle, NoCycle, limit_cycle
from pipedyn.diagram import (
    BifurcationDiagram,
    DiagramCost,
    bifurcation_diagram,
    diagram_cost,
)
from pipedyn.equilibrium.equilibria import (
    BranchPoint,
    Equilibria,
    EquilibriumBranch,
    equilibria,
    equilibrium_branch,
)
from pipedyn.equilibrium.hopf import CriticalityCurve, Hopf, NoHopf, criticality_curve, hopf
from pipedyn.forced.forced_response import (
    ForcedBranch,
    ForcedEvent,
    ForcedMotion,
    ForcedResponse,
    forced_response,
)
from pipedyn.forced.parametric_regions import (
    ParametricRegion,
    ParametricRegions,
    parametric_regions,
)
from pipedyn.forced.pulsating import FloquetMultipliers, floquet
from pipedyn.linear.critical_speed import CriticalSpeed, NoCrossing, critical_speed, crossings
from pipedyn.linear.frequency_response import (
    FrequencyResponse,
    Resonance,
    frequency_response,
)
from pipedyn.linear.identification import (
    Identification,
    Measurement,
    NotIdentifiable,
    identify,
)
from pipedyn.linear.modes import Modes, ModeShape, RootLoci, eigenvalues, modes, root_loci
from pipedyn.linear.sensitivity import Crossing, Crossings, Derivatives, Sensitivity
from pipedyn.linear.stability_curve import Failure, StabilityCurve, stability_curve
from pipedyn.models.base import Model, Operators, Power
from pipedyn.models.chain import Chain
from pipedyn.models.continuum import Continuum
from pipedyn.models.drive import Harmonic, Pulsation, Supply
from pipedyn.models.end_coefficient import end_coefficient
from pipedyn.models.galerkin import Galerkin
from pipedyn.models.pipe import Pipe
from pipedyn.models.profile import Profile
from pipedyn.models.scales import Scales
from pipedyn.models.supports import RootSpring
from pipedyn.models.terms import (
    AddedMass,
    CubicSpring,
    Damper,
    Foundation,
    PointMass,
    RotationalDamper,
    RotationalSpring,
    Spring,
    Stop,
    Stretching,
    Tension,
    Term,
    Viscosity,
    Weight,
)
from pipedyn.motion.events import DenseOutput, Event, Occurrences
from pipedyn.motion.lyapunov import LyapunovExponent, lyapunov_exponent
from pipedyn.motion.simulate import (
    Ensemble,
    MemberFailure,
    Motion,
    MotionStopped,
    simulate,
    simulate_many,
)
from pipedyn.util.archive import load
from pipedyn.util.errors import NotConverged, NotResolved, PipedynError

__version__ = "0.2.0"

__all__ = [
    "AddedMass",
    "Attractor",
    "Attractors",
    "Basin",
    "BifurcationDiagram",
    "Boundary",
    "BoundaryCurve",
    "BranchPoint",
    "Chain",
    "Choice",
    "Continuum",
    "CriticalSpeed",
    "CriticalityCurve",
    "Crossing",
    "Crossings",
    "CubicSpring",
    "CycleBoundary",
    "CycleBranch",
    "CycleCurve",
    "CycleEvent",
    "CyclePoint",
    "Damper",
    "DenseOutput",
    "Derivatives",
    "DiagramCost",
    "Effect",
    "Ensemble",
    "Equilibria",
    "EquilibriumBranch",
    "Event",
    "Failure",
    "FloquetMultipliers",
    "ForcedBranch",
    "ForcedEvent",
    "ForcedMotion",
    "ForcedResponse",
    "Foundation",
    "FrequencyResponse",
    "Galerkin",
    "Harmonic",
    "Hopf",
    "Identification",
    "LimitCycle",
    "LyapunovExponent",
    "Measurement",
    "MemberFailure",
    "ModeShape",
    "Model",
    "Modes",
    "Motion",
    "MotionStopped",
    "NoCrossing",
    "NoCycle",
    "NoHopf",
    "NoModel",
    "NotConverged",
    "NotIdentifiable",
    "NotResolved",
    "Occurrences",
    "Operators",
    "OrganisingPoint",
    "ParametricRegion",
    "ParametricRegions",
    "Pipe",
    "PipedynError",
    "PointMass",
    "Power",
    "Profile",
    "Pulsation",
    "Relevance",
    "Resonance",
    "RootLoci",
    "RootSpring",
    "RotationalDamper",
    "RotationalSpring",
    "Scales",
    "Sensitivity",
    "Share",
    "Spring",
    "StabilityCurve",
    "StartFailure",
    "StartPlane",
    "Stop",
    "Stretching",
    "Supply",
    "Tension",
    "Term",
    "Trade",
    "TradeRow",
    "Viscosity",
    "Weight",
    "attractors",
    "bifurcation_diagram",
    "boundary",
    "choose",
    "continuation",
    "critical_speed",
    "criticality_curve",
    "crossings",
    "cycle_boundary",
    "diagram_cost",
    "eigenvalues",
    "end_coefficient",
    "equilibria",
    "equilibrium_branch",
    "floquet",
    "forced_response",
    "frequency_response",
    "hopf",
    "identify",
    "limit_cycle",
    "load",
    "lyapunov_exponent",
    "modes",
    "modular",
    "parametric_regions",
    "plot",
    "relevant",
    "root_loci",
    "simulate",
    "simulate_many",
    "stability_curve",
    "trade",
]


def __getattr__(name: str) -> _ModuleType:
    if name == "plot":  # matplotlib is imported only where something is drawn
        return _import_module("pipedyn.plot")
    raise AttributeError(f"module 'pipedyn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
