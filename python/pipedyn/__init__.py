# SPDX-License-Identifier: MIT
"""Dynamics of a pipe conveying fluid, modelled as a chain, a reduced model or a continuous pipe."""

from importlib import import_module as _import_module
from types import ModuleType as _ModuleType

from pipedyn import continuation as continuation
from pipedyn import modular as modular
from pipedyn.accuracy.choose import Choice as Choice
from pipedyn.accuracy.choose import NoModel as NoModel
from pipedyn.accuracy.choose import Trade as Trade
from pipedyn.accuracy.choose import TradeRow as TradeRow
from pipedyn.accuracy.choose import choose as choose
from pipedyn.accuracy.choose import trade as trade
from pipedyn.accuracy.effects import Effect as Effect
from pipedyn.accuracy.effects import Relevance as Relevance
from pipedyn.accuracy.effects import relevant as relevant
from pipedyn.attraction.attractor import Attractor as Attractor
from pipedyn.attraction.attractors import Attractors as Attractors
from pipedyn.attraction.attractors import Basin as Basin
from pipedyn.attraction.attractors import Share as Share
from pipedyn.attraction.attractors import StartFailure as StartFailure
from pipedyn.attraction.attractors import StartPlane as StartPlane
from pipedyn.attraction.attractors import attractors as attractors
from pipedyn.curves.boundary import Boundary as Boundary
from pipedyn.curves.boundary import BoundaryCurve as BoundaryCurve
from pipedyn.curves.boundary import boundary as boundary
from pipedyn.curves.cycle_boundary import CycleBoundary as CycleBoundary
from pipedyn.curves.cycle_boundary import cycle_boundary as cycle_boundary
from pipedyn.curves.event_curve import CycleCurve as CycleCurve
from pipedyn.curves.event_curve import CyclePoint as CyclePoint
from pipedyn.curves.organising import OrganisingPoint as OrganisingPoint
from pipedyn.cycles.branches import CycleBranch as CycleBranch
from pipedyn.cycles.branches import CycleEvent as CycleEvent
from pipedyn.cycles.limit_cycle import LimitCycle as LimitCycle
from pipedyn.cycles.limit_cycle import NoCycle as NoCycle
from pipedyn.cycles.limit_cycle import limit_cycle as limit_cycle
from pipedyn.diagram import BifurcationDiagram as BifurcationDiagram
from pipedyn.diagram import bifurcation_diagram as bifurcation_diagram
from pipedyn.equilibrium.equilibria import BranchPoint as BranchPoint
from pipedyn.equilibrium.equilibria import Equilibria as Equilibria
from pipedyn.equilibrium.equilibria import EquilibriumBranch as EquilibriumBranch
from pipedyn.equilibrium.equilibria import equilibria as equilibria
from pipedyn.equilibrium.equilibria import equilibrium_branch as equilibrium_branch
from pipedyn.equilibrium.hopf import CriticalityCurve as CriticalityCurve
from pipedyn.equilibrium.hopf import Hopf as Hopf
from pipedyn.equilibrium.hopf import NoHopf as NoHopf
from pipedyn.equilibrium.hopf import criticality_curve as criticality_curve
from pipedyn.equilibrium.hopf import hopf as hopf
from pipedyn.forced.forced_response import ForcedBranch as ForcedBranch
from pipedyn.forced.forced_response import ForcedEvent as ForcedEvent
from pipedyn.forced.forced_response import ForcedMotion as ForcedMotion
from pipedyn.forced.forced_response import ForcedResponse as ForcedResponse
from pipedyn.forced.forced_response import forced_response as forced_response
from pipedyn.forced.parametric_regions import ParametricRegion as ParametricRegion
from pipedyn.forced.parametric_regions import ParametricRegions as ParametricRegions
from pipedyn.forced.parametric_regions import parametric_regions as parametric_regions
from pipedyn.forced.pulsating import FloquetMultipliers as FloquetMultipliers
from pipedyn.forced.pulsating import floquet as floquet
from pipedyn.linear.critical_speed import CriticalSpeed as CriticalSpeed
from pipedyn.linear.critical_speed import NoCrossing as NoCrossing
from pipedyn.linear.critical_speed import critical_speed as critical_speed
from pipedyn.linear.critical_speed import crossings as crossings
from pipedyn.linear.critical_speeds import CriticalSpeeds as CriticalSpeeds
from pipedyn.linear.critical_speeds import critical_speeds as critical_speeds
from pipedyn.linear.frequency_response import FrequencyResponse as FrequencyResponse
from pipedyn.linear.frequency_response import Resonance as Resonance
from pipedyn.linear.frequency_response import frequency_response as frequency_response
from pipedyn.linear.identification import Identification as Identification
from pipedyn.linear.identification import Measurement as Measurement
from pipedyn.linear.identification import NotIdentifiable as NotIdentifiable
from pipedyn.linear.identification import identify as identify
from pipedyn.linear.modes import Modes as Modes
from pipedyn.linear.modes import ModeShape as ModeShape
from pipedyn.linear.modes import RootLoci as RootLoci
from pipedyn.linear.modes import eigenvalues as eigenvalues
from pipedyn.linear.modes import modes as modes
from pipedyn.linear.modes import root_loci as root_loci
from pipedyn.linear.sensitivity import Crossing as Crossing
from pipedyn.linear.sensitivity import Crossings as Crossings
from pipedyn.linear.sensitivity import Derivatives as Derivatives
from pipedyn.linear.sensitivity import Sensitivity as Sensitivity
from pipedyn.linear.stability_curve import Failure as Failure
from pipedyn.linear.stability_curve import StabilityCurve as StabilityCurve
from pipedyn.linear.stability_curve import stability_curve as stability_curve
from pipedyn.models.base import Model as Model
from pipedyn.models.base import Operators as Operators
from pipedyn.models.base import Power as Power
from pipedyn.models.chain import Chain as Chain
from pipedyn.models.continuum import Continuum as Continuum
from pipedyn.models.drive import Harmonic as Harmonic
from pipedyn.models.drive import Pulsation as Pulsation
from pipedyn.models.drive import Supply as Supply
from pipedyn.models.end_coefficient import end_coefficient as end_coefficient
from pipedyn.models.galerkin import Galerkin as Galerkin
from pipedyn.models.pipe import Pipe as Pipe
from pipedyn.models.profile import Profile as Profile
from pipedyn.models.scales import Scales as Scales
from pipedyn.models.supports import RootSpring as RootSpring
from pipedyn.models.terms import AddedMass as AddedMass
from pipedyn.models.terms import CubicSpring as CubicSpring
from pipedyn.models.terms import Damper as Damper
from pipedyn.models.terms import Foundation as Foundation
from pipedyn.models.terms import PointMass as PointMass
from pipedyn.models.terms import RotationalDamper as RotationalDamper
from pipedyn.models.terms import RotationalSpring as RotationalSpring
from pipedyn.models.terms import Spring as Spring
from pipedyn.models.terms import Stop as Stop
from pipedyn.models.terms import Stretching as Stretching
from pipedyn.models.terms import Tension as Tension
from pipedyn.models.terms import Term as Term
from pipedyn.models.terms import Viscosity as Viscosity
from pipedyn.models.terms import Weight as Weight
from pipedyn.motion.events import DenseOutput as DenseOutput
from pipedyn.motion.events import Event as Event
from pipedyn.motion.events import Occurrences as Occurrences
from pipedyn.motion.lyapunov import LyapunovExponent as LyapunovExponent
from pipedyn.motion.lyapunov import lyapunov_exponent as lyapunov_exponent
from pipedyn.motion.simulate import Ensemble as Ensemble
from pipedyn.motion.simulate import MemberFailure as MemberFailure
from pipedyn.motion.simulate import Motion as Motion
from pipedyn.motion.simulate import MotionStopped as MotionStopped
from pipedyn.motion.simulate import simulate as simulate
from pipedyn.motion.simulate import simulate_many as simulate_many
from pipedyn.util.archive import load as load
from pipedyn.util.errors import NotConverged as NotConverged
from pipedyn.util.errors import NotResolved as NotResolved
from pipedyn.util.errors import PipedynError as PipedynError

__version__ = "0.2.0"

__all__ = sorted(
    {name for name, one in globals().items() if not isinstance(one, _ModuleType) and name[0] != "_"}
    | {"continuation", "modular", "plot"}
)
"""Public names: all imported above, and three modules, of which `plot` is imported on demand."""


def __getattr__(name: str) -> _ModuleType:
    if name == "plot":  # matplotlib is imported only where something is drawn
        return _import_module("pipedyn.plot")
    raise AttributeError(f"module 'pipedyn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
