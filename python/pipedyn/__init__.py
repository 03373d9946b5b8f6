# SPDX-License-Identifier: MIT
"""Dynamics of a pipe conveying fluid: chain, reduced-order and continuous models on one footing."""

from pipedyn import modular
from pipedyn.branches import CycleBranch
from pipedyn.chain import Chain
from pipedyn.changes import CycleEvent
from pipedyn.choose import Choice, NoModel, choose
from pipedyn.continuum import Continuum
from pipedyn.critical import CriticalSpeed, NoCrossing, critical_speed, crossings
from pipedyn.criticality import CriticalityCurve, criticality_curve
from pipedyn.cycles import LimitCycle, NoCycle, limit_cycle
from pipedyn.diagram import BifurcationDiagram, bifurcation_diagram
from pipedyn.ensemble import Ensemble, MemberFailure, simulate_many
from pipedyn.equilibria import (
    BranchPoint,
    Equilibria,
    EquilibriumBranch,
    equilibria,
    equilibrium_branch,
)
from pipedyn.fitting import Fitting
from pipedyn.galerkin import Galerkin
from pipedyn.hopf import Hopf, NoHopf, hopf
from pipedyn.lyapunov import LyapunovExponent, lyapunov_exponent
from pipedyn.modal import Modes, ModeShape, RootLoci, eigenvalues, modes, root_loci
from pipedyn.model import Model, NotConverged, Operators, PipedynError, Power
from pipedyn.motion import Motion, MotionStopped, simulate
from pipedyn.pipe import Pipe, Scales, inlet_coefficient
from pipedyn.relevant import Effect, Relevance, relevant
from pipedyn.sections import Ended
from pipedyn.sensitivity import Crossing, Derivatives, Sensitivity
from pipedyn.stability import Failure, StabilityCurve, stability_curve
from pipedyn.trade import Trade, TradeRow, trade

__version__ = "0.1.0"

__all__ = [
    "BifurcationDiagram",
    "BranchPoint",
    "Chain",
    "Choice",
    "Continuum",
    "CriticalSpeed",
    "CriticalityCurve",
    "Crossing",
    "CycleBranch",
    "CycleEvent",
    "Derivatives",
    "Effect",
    "Ended",
    "Ensemble",
    "Equilibria",
    "EquilibriumBranch",
    "Failure",
    "Fitting",
    "Galerkin",
    "Hopf",
    "LimitCycle",
    "LyapunovExponent",
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
    "Operators",
    "Pipe",
    "PipedynError",
    "Power",
    "Relevance",
    "RootLoci",
    "Scales",
    "Sensitivity",
    "StabilityCurve",
    "Trade",
    "TradeRow",
    "bifurcation_diagram",
    "choose",
    "critical_speed",
    "criticality_curve",
    "crossings",
    "eigenvalues",
    "equilibria",
    "equilibrium_branch",
    "hopf",
    "inlet_coefficient",
    "limit_cycle",
    "lyapunov_exponent",
    "modes",
    "modular",
    "relevant",
    "root_loci",
    "simulate",
    "simulate_many",
    "stability_curve",
    "trade",
]
