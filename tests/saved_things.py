# SPDX-License-Identifier: MIT
"""One small thing of every kind that `save` writes, and what it knows, number by number.

The folder `saved` beside this script holds a file of each and, in `facts.json`, what each knew when
it was written. These files were written by commit 5e7fa04 and are loaded ever after: they are never
written anew. `python tests/saved_things.py` writes what the folder does not have yet, so that a
class that is new since gets a file, too.
"""

from __future__ import annotations

import dataclasses
import json
import math
from functools import cache
from pathlib import Path

import numpy as np

import pipedyn as pp
from pipedyn import modular
from pipedyn.accuracy.convergence import convergence_law
from pipedyn.equilibrium.hopf import hopf_point
from pipedyn.models.drive import DriveFailed
from pipedyn.motion.integrator import Stopped
from pipedyn.motion.vector_field import VectorField
from pipedyn.util.counters import TookTooLong
from pipedyn.util.newton import NewtonFailed

FOLDER = Path(__file__).parent / "saved"
FACTS = FOLDER / "facts.json"

HOSE = {"length": 0.45, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.032}
PLAIN = pp.Pipe(0.2)
DAMPED = pp.Pipe(0.2, 10.0, damping=0.01)
SMALL = pp.Chain(PLAIN, 2)
THREE = pp.Chain(DAMPED, 3)
SCALED = pp.Chain(pp.Pipe.from_si(**HOSE), 2)
WINDOW = {"gamma": (0.0, 5.0), "u": (0.0, 8.0)}

# ------------------------------------------------------------------------------------------ pipes

TERMS = (
    pp.PointMass(1.0, 0.1),
    pp.Spring(0.25, 3.0),
    pp.Damper(0.5, 0.2),
    pp.Foundation(1.5),
    pp.Viscosity(0.3),
    pp.AddedMass(0.4),
    pp.CubicSpring(0.75, 20.0),
    pp.Stop(0.8, 0.05, 90.0),
    pp.Tension(-0.2),
    pp.Weight(0.6, 0.7),
)

PIPES = {
    "pipe": lambda: PLAIN,
    "pipe with every term": lambda: pp.Pipe(0.3, 5.0, terms=TERMS),
    "pipe with every number": lambda: pp.Pipe(
        0.3, -2.0, alpha=1.2, drag=0.4, damping=0.01, hysteresis=0.02, jet_angle=0.1
    ),
    "pipe that aspirates": lambda: pp.Pipe(0.3, 4.0, "aspirating", inflow_share=0.25),
    "pipe that is held": lambda: pp.Pipe(
        0.2,
        root=pp.RootSpring(3.0),
        end="pinned",
        supports=(0.4,),
        terms=[pp.Stretching(100.0)],
    ),
    "pipe in SI": lambda: pp.Pipe.from_si(**HOSE, terms=[pp.PointMass(0.45, 0.01)]),
    "pipe that varies": lambda: pp.Pipe(
        0.2,
        stiffness=lambda s: 1.0 - 0.5 * s + 0.2 * s**2,
        mass=pp.Profile([0.5], [1.0, lambda s: np.exp(-s)]),
    ),
}

# ----------------------------------------------------------------------------------------- models

BENT = pp.Chain(pp.Pipe(0.2, -30.0), 2)

MODELS = {
    "chain": lambda: pp.Chain(DAMPED, 3),
    "chain with midpoint springs": lambda: pp.Chain(PLAIN, 3, springs="midpoint"),
    "chain with rayleigh springs": lambda: pp.Chain(PLAIN, 3, springs="rayleigh"),
    "chain with uniform springs": lambda: pp.Chain(PLAIN, 3, springs="uniform"),
    "chain with frequency springs": lambda: pp.Chain(PLAIN, 3, springs="frequency"),
    "chain of arrays": lambda: pp.Chain(
        pp.Pipe(0.2, drag=0.3),
        springs=[2.0, 3.0, 0.0],
        lengths=[0.3, 0.2, 0.4],
        centres=[0.5, 0.4, 0.6],
        gyration_radii=[0.1, 0.05, 0.1],
        drag_points=[0.2, 0.5, 1.0],
        masses=[0.4, 0.3, 0.2],
        base=0.1,
    ),
    "chain that is held": lambda: pp.Chain(
        pp.Pipe(0.2, root="pinned", end="guided", supports=(0.4,)), 5
    ),
    "chain of another pipe": lambda: pp.Chain(PLAIN, 3).with_pipe(
        pp.Pipe(0.3, 4.0, end="clamped", terms=[pp.Spring(0.5, 2.0)])
    ),
    "chain that rests bent": lambda: BENT.about(pp.equilibria(BENT, 1.0).q[1]),
    "chain of a tapered pipe": lambda: pp.Chain(pp.Pipe(0.2, stiffness=lambda s: 1.0 - 0.5 * s), 3),
    "beam functions": lambda: pp.Galerkin(DAMPED, 3),
    "legendre functions": lambda: pp.Galerkin(
        pp.Pipe(0.2, terms=[pp.Spring(0.5, 9.0)]), 8, "legendre"
    ),
    "beam functions that are held": lambda: pp.Galerkin(
        pp.Pipe(0.2, end="pinned", supports=(0.4,)), 4
    ),
    "beam functions that rest bent": lambda: _rests_bent(pp.Galerkin(pp.Pipe(0.2, -30.0), 3)),
    "continuum": lambda: pp.Continuum(DAMPED),
    "scene": lambda: modular.chain(DAMPED, 3).plus(modular.Guide(2), pp.Damper(0.5, 1.0)),
    "scene of parts": lambda: modular.Assembly(
        pp.Pipe(0.2, 3.0, drag=0.2),
        [
            modular.Segment(0.4),
            modular.Segment(0.5, 0.4, 0.1, 0.3, 0.6),
            modular.TorsionalSpring(1, 2.0),
            modular.TorsionalSpring(2, 1.0, 0.1, 0.2),
            modular.InternalFlow(),
            modular.Drag(),
            modular.Custom(nodes=(2,), joints=(1,), mass=np.diag([0.1, 0.1, 0.2]), name="ballast"),
        ],
        [modular.Clamp(0.1), modular.Joint(2)],
    ),
    "scene with a pin": lambda: modular.chain(PLAIN, 3).plus(modular.Pin(3, 0.0, 0.9)),
    "scene that rests bent": lambda: _pinned_at_rest(),
}


def _rests_bent(model):
    return model.about(pp.equilibria(model, 1.0).q[1])


def _pinned_at_rest():
    scene = modular.chain(pp.Pipe(0.2, 2.0), 3).plus(modular.Pin(3, 0.0, 0.9))
    return scene.about(scene.equilibrium([0.3, 0.1, -0.6]))


# ---------------------------------------------------------------------------------------- results


@cache
def motion():
    return pp.simulate(
        SMALL,
        4.0,
        0.2,
        lambda s: 0.1 * s,
        samples=5,
        events=pp.Event(lambda t, q, qdot: q[0] - 0.02),
        dense=True,
    )


@cache
def cycle():
    return pp.limit_cycle(SMALL, 4.0, samples=9)


@cache
def diagram():
    found = pp.bifurcation_diagram(SMALL, [3.5, 3.8], cycles=4, brute_force=1)
    branch = found.cycles[0]
    branch = dataclasses.replace(branch, cycles=branch.cycles[:1])
    return dataclasses.replace(found, cycles=(branch,), motions=found.motions[:2])


@cache
def found_attractors():
    found = pp.attractors(SMALL, 3.8, 2)
    basins = tuple(map(without_most_samples, found.basins))
    return dataclasses.replace(found, basins=basins)


def without_most_samples(basin):
    """A basin of which five samples, five points of the section and five frequencies are left."""
    names = ("t", "q", "qdot", "tip", "energy", "flow_speed")
    short = {name: getattr(basin.motion, name)[-5:] for name in names}
    cut = {name: getattr(basin, name)[:5] for name in ("frequencies", "spectrum", "section")}
    return dataclasses.replace(
        basin, motion=dataclasses.replace(basin.motion, dense=None, **short), **cut
    )


@cache
def shaken():
    found = pp.forced_response(
        pp.Galerkin(DAMPED, 2), 1.0, base=pp.Harmonic(0.01, 6.0), frequencies=(5.5, 5.9)
    )
    branch = found.branches[0]
    branch = dataclasses.replace(branch, steps=branch.steps[:1])
    return dataclasses.replace(found, branches=(branch,))


@cache
def pulsating():
    return pp.Pulsation(3.0, 0.3, 14.0)


@cache
def subharmonic():
    found = pp.forced_response(
        pp.Chain(pp.Pipe(0.1, 3.0, damping=0.005), 2),
        pp.Pulsation(3.0, 0.3, 14.0),
        frequencies=(4.0, 20.0),
    )
    branch = next(one for one in found.branches if one.events)
    return dataclasses.replace(
        found, branches=(dataclasses.replace(branch, steps=branch.steps[:1]),)
    )


@cache
def regions():
    return pp.parametric_regions(pp.Chain(pp.Pipe(0.1, 3.0), 2), 3.0, [0.6], (5.0, 20.0))


@cache
def bounds():
    return pp.boundary(SMALL, "gamma", "u", WINDOW)


@cache
def fold_of_cycles():
    """A branch of cycles and its fold."""
    branch = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.2, 3.4]).cycles[0]
    return branch, next(event for event in branch.events if event.kind == "fold")


@cache
def folds():
    """A curve of folds up to where it ends, without most of its points."""
    window = {"beta": (0.045, 0.4), "u": (2.0, 6.0)}
    found = pp.cycle_boundary(*fold_of_cycles(), "beta", "u", window)
    names = {item.name for item in dataclasses.fields(found.curves[0])} - {"kind", "ends"}
    cut = {name: getattr(found.curves[0], name)[:2] for name in names}
    curve = dataclasses.replace(found.curves[0], **cut)
    return dataclasses.replace(found, curves=(curve,))


def in_a_plane():
    """Attractors among starts of a plane, with a base that moves."""
    plane = pp.StartPlane([0.1], [0.0, 0.2])
    found = pp.attractors(SMALL, 1.0, plane, base=pp.Harmonic(0.01, 3.0))
    return dataclasses.replace(found, basins=tuple(map(without_most_samples, found.basins)))


def start_that_fails():
    """Attractors of which a start has no motion."""
    starts = np.zeros((2, 6))
    starts[1, 3:] = 1e4
    return pp.attractors(pp.Galerkin(pp.Pipe(0.2, damping=0.01), 3), 1.0, starts)


@cache
def fitted():
    return pp.identify(
        pp.Pipe.from_si(**HOSE),
        [pp.Measurement("frequency", 1.0, 0.01), pp.Measurement("decrement", 0.5, 0.1, 0.2, 2)],
        ["bending_stiffness"],
    )


@cache
def traded():
    return pp.trade(PLAIN, "critical_speed", families=("beam", "rayleigh"), sizes=[1, 4], repeats=1)


@cache
def chosen():
    return pp.choose(PLAIN, "critical_speed", tolerance=0.1)


@cache
def effects():
    return pp.relevant(pp.Pipe(0.2, drag=0.3, damping=0.01), 1.0, "frequencies", count=1)


def curve_with_failures():
    return pp.stability_curve(
        lambda beta: pp.Chain(pp.Pipe(beta), 2 if beta < 0.5 else 1), [0.1, 0.6]
    )


def failed(call):
    """What a call raises."""
    try:
        call()
    except Exception as error:
        return error
    raise AssertionError("nothing was raised")


RESULTS = {
    "Operators": lambda: pp.Chain(pp.Pipe(0.2, hysteresis=0.01), 2).operators(),
    "Power": lambda: THREE.power(np.full((6, 2), 0.1), 2.0),
    "Power of one state": lambda: THREE.power(np.full(6, 0.1), 2.0),
    "Modes": lambda: pp.modes(THREE, 2.0, 2),
    "Modes of the continuum": lambda: pp.modes(
        pp.Continuum(pp.Pipe(0.2, terms=[pp.Spring(0.5, 3.0)])), 2.0, 1
    ),
    "ModeShape": lambda: pp.modes(SMALL, 2.0, 1).shapes[0],
    "RootLoci": lambda: pp.root_loci(THREE, [0.0, 2.0, 4.0], 2),
    "CriticalSpeed": lambda: pp.critical_speed(THREE),
    "CriticalSpeed of the continuum": lambda: pp.critical_speed(pp.Continuum(DAMPED)),
    "Crossing": lambda: pp.crossings(THREE, 9.0)[0],
    "Crossings": lambda: pp.crossings(THREE, 9.0),
    "Sensitivity": lambda: pp.critical_speed(THREE).sensitivity,
    "Derivatives": lambda: pp.critical_speed(THREE).sensitivity.speed,
    "StabilityCurve": curve_with_failures,
    "Failure": lambda: curve_with_failures().failures[0],
    "FrequencyResponse": lambda: pp.frequency_response(SCALED, 1.0, [1.0, 2.0, 3.0]),
    "Resonance": lambda: pp.frequency_response(
        pp.Galerkin(pp.Pipe(0.01, damping=1e-4), 3), 0.5, [1.0, 5.0]
    ).resonances[0],
    "Identification": fitted,
    "Motion": motion,
    "Motion in a pulsating flow on a moving base": lambda: pp.simulate(
        SMALL,
        pp.Pulsation(4.0, 0.1, 5.0),
        0.2,
        lambda s: 0.1 * s,
        samples=3,
        base=pp.Harmonic(0.01, 3.0),
    ),
    "Motion at constant head": lambda: pp.simulate(
        SMALL, pp.Supply(8.0, 1.5, 0.1, 3.0), 0.2, lambda s: 0.1 * s, samples=3
    ),
    "Motion of a scene": lambda: pp.simulate(
        modular.chain(PLAIN, 3).plus(modular.Guide(3)), 1.0, 0.1, lambda s: 0.1 * s, samples=3
    ),
    "Occurrences": lambda: motion().events[0],
    "DenseOutput": lambda: motion().dense,
    "Ensemble": lambda: pp.simulate_many(SMALL, [1.0, 2.0], 0.2, lambda s: 0.1 * s, samples=3),
    "MemberFailure": lambda: pp.simulate_many(
        SMALL, [4.0], 1e5, lambda s: 0.1 * s, samples=3, most=2000
    ).failures[0],
    "LyapunovExponent": lambda: pp.lyapunov_exponent(
        SMALL, 4.0, lambda s: 0.1 * s, duration=5.0, transient=1.0
    ),
    "Equilibria": lambda: pp.equilibria(BENT, 1.0),
    "EquilibriumBranch": lambda: pp.equilibrium_branch(
        BENT, pp.equilibria(BENT, 1.0).q[1], 1.0, (0.5, 1.5), step=0.3
    ),
    "BranchPoint": lambda: diagram().equilibria[0].points[0],
    "Hopf": lambda: pp.hopf(SMALL),
    "Hopf at constant head": lambda: pp.hopf(SMALL, friction=2.0),
    "HopfPoint": lambda: hopf_point(VectorField(SMALL), pp.crossings(SMALL, 9.0)[0]),
    "CriticalityCurve": lambda: pp.criticality_curve(
        lambda beta: pp.Chain(pp.Pipe(beta), 2 if beta < 0.5 else 1), [0.1, 0.6]
    ),
    "LimitCycle": cycle,
    "CycleBranch": lambda: diagram().cycles[0],
    "CycleEvent": lambda: fold_of_cycles()[1],
    "Attractor": lambda: diagram().motions[0],
    "BifurcationDiagram": diagram,
    "DiagramCost": lambda: pp.diagram_cost(SMALL, [3.0, 4.0]),
    "Attractors": found_attractors,
    "Basin": lambda: found_attractors().basins[0],
    "Share": lambda: found_attractors().unsettled,
    "StartPlane": lambda: pp.StartPlane([-0.1, 0.0], [0.0, 0.2], (0, 2), [0.0, 0.1, 0.0, 0.0]),
    "Attractors of a plane": lambda: in_a_plane(),
    "StartFailure": lambda: start_that_fails().failures[0],
    "Boundary": bounds,
    "BoundaryCurve": lambda: bounds().curves[0],
    "OrganisingPoint": lambda: pp.boundary(
        pp.Galerkin(pp.Pipe(0.2), 2),
        "gamma",
        "u",
        {"gamma": (-60.0, 0.0), "u": (0.0, 4.0)},
        criticality=False,
    ).points[0],
    "CycleBoundary": folds,
    "CycleCurve": lambda: folds().curves[0],
    "CyclePoint": lambda: folds().points[0],
    "Branch": lambda: circle(),
    "MarkedPoint": lambda: circle().points[0],
    "FloquetMultipliers": lambda: pp.floquet(SMALL, pulsating()),
    "ParametricRegion": lambda: regions()[0],
    "ParametricRegions": regions,
    "ForcedResponse": shaken,
    "ForcedResponse of a pulsating flow": subharmonic,
    "ForcedBranch": lambda: shaken().branches[0],
    "ForcedMotion": lambda: shaken().at(5.51, samples=9)[0],
    "ForcedEvent": lambda: subharmonic().branches[0].events[0],
    "Trade": traded,
    "Trade of frequencies": lambda: pp.trade(
        PLAIN, "frequencies", families="beam", sizes=[3], repeats=1, u=1.0, count=2
    ),
    "Trade of root loci": lambda: pp.trade(
        PLAIN, "root_loci", families="beam", sizes=[3], repeats=1, speeds=[0.0, 1.0], count=2
    ),
    "Trade of limit cycles": lambda: pp.trade(
        pp.Pipe(0.2, damping=0.01), "limit_cycle", families="beam", sizes=[3], repeats=1, u=6.0
    ),
    "TradeRow": lambda: traded().rows[0],
    "Choice": chosen,
    "Tried": lambda: chosen().tried[0],
    "Answer": lambda: chosen().reference,
    "ConvergenceLaw": lambda: convergence_law(
        [pp.critical_speed(pp.Chain(PLAIN, n)) for n in (4, 8, 16)],
        pp.critical_speed(pp.Continuum(PLAIN)),
    ),
    "Effect": lambda: effects().effects[0],
    "Relevance": effects,
}


def circle():
    return pp.continuation.follow(lambda x, p: x**2 + p**2 - 1.0, [1.0], 0.0, (-2.0, 2.0), step=0.3)


# ------------------------------------------------------------------------------------- exceptions

ERRORS = {
    "PipedynError": lambda: pp.PipedynError("no", 1, -0.0, math.inf, math.nan, 1 + 2j, (1, [2])),
    "NoCrossing": lambda: failed(lambda: pp.critical_speed(pp.Galerkin(PLAIN, 1))),
    "NoHopf": lambda: failed(lambda: pp.hopf(pp.Galerkin(pp.Pipe(0.2, end="pinned"), 2))),
    "NoCycle": lambda: failed(lambda: pp.limit_cycle(SMALL, 1.0)),
    "NoModel": lambda: failed(
        lambda: pp.choose(PLAIN, "critical_speed", tolerance=1e-9, among="rayleigh")
    ),
    "NotResolved": lambda: pp.NotResolved("rhs cannot be computed of this state", (0,)),
    "NotConverged": lambda: pp.NotConverged("not yet", pp.critical_speed(SMALL)),
    "NotIdentifiable": lambda: failed(
        lambda: pp.identify(
            PLAIN,
            [pp.Measurement("frequency", 3.0, 0.01)],
            {"gamma": (1.0, 5.0), "damping": (0.001, 0.1)},
        )
    ),
    "MotionStopped": lambda: (
        pp.simulate_many(SMALL, [4.0], 1e5, lambda s: 0.1 * s, samples=3, most=2000)
        .failures[0]
        .error
    ),
    "TookTooLong": lambda: TookTooLong("it took more than 3 s"),
    "NewtonFailed": lambda: NewtonFailed("it turns too sharply"),
    "Stopped": lambda: Stopped("the step became too short"),
    "DriveFailed": lambda: DriveFailed("the flow reverses"),
    "Mechanism": lambda: pp.PipedynError("it moves without inertia"),
    "ValueError": lambda: ValueError("beta must lie in [0, 1)"),
    "KeyError": lambda: KeyError("beta"),
    "an error of another package": lambda: np.linalg.LinAlgError("Singular matrix"),
}
"""Each is saved in a `Failure`, as results hold those that a sweep met."""


def errors():
    """What `ERRORS` has, in results."""
    return {
        f"Failure of {name}": lambda make=make: pp.Failure(0, math.nan, make())
        for name, make in ERRORS.items()
    }


THINGS = PIPES | MODELS | RESULTS | errors()
"""How each is made, by the name of its file."""

# ------------------------------------------------------------------------------------------ facts

CALLED = {"Mechanism": "PipedynError", ", 'udwadia-kalaba'": ""}
"""What classes, attributes and words are called today that `facts.json` has under an older name."""

STATE = "rates of a bent state"


def facts(thing):
    """All that a thing knows: class, numbers and words by where they are, as JSON takes them.

    Of an array two sums of its entries are told, exactly rounded. Of a model what it
    answers. What is met again is not told again.
    """
    found, met = {}, {}
    _add(thing, "", found, met)
    return found


def _add(value, where, found, met):
    if value is None or isinstance(value, bool | int | str):
        found[where] = value
    elif isinstance(value, float):
        found[where] = value if math.isfinite(value) else repr(value)
    elif isinstance(value, complex):
        found[where] = [repr(value.real), repr(value.imag)]
    elif isinstance(value, np.generic):
        _add(value.item(), where, found, met)
    elif isinstance(value, np.ndarray):
        found[where] = _of_array(value)
    elif isinstance(value, tuple | list) or id(value) not in met:
        met[id(value)] = value  # which keeps it in memory
        found[f"{where}:"] = type(value).__name__
        for name, part in _parts(value):
            _add(part, f"{where}.{name}" if where else name, found, met)


def _of_array(values):
    """Shape, kind, words, or how many numbers are not finite and the sums of the others."""
    told = [list(values.shape), values.dtype.kind]
    each = values.ravel()
    if values.dtype.kind == "U":
        return told + each.tolist()
    for part in (each.real, each.imag)[: 1 + (values.dtype.kind == "c")]:
        numbers = [x for x in part.astype(float).tolist() if math.isfinite(x)]
        ramp = math.fsum(k * x for k, x in enumerate(numbers, 1))
        told += [part.size - len(numbers), math.fsum(numbers), ramp]
    return told


def _parts(value):
    """What is in a value, by names."""
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        yield "length", len(value)
        yield from enumerate(value)
    elif isinstance(value, tuple):
        yield from value._asdict().items()
    elif isinstance(value, BaseException):
        yield "said", str(value)
        yield "args", value.args
    elif isinstance(value, pp.Model | pp.Continuum):
        yield from _answers(value)
    elif dataclasses.is_dataclass(value):
        yield from ((item.name, getattr(value, item.name)) for item in dataclasses.fields(value))
    else:  # the equations of a branch of orbits, and the motion in them
        names = ("motion", "start", "control", "unit", "model", "forcing", "order", "weights")
        known = [(name, getattr(value, name)) for name in names if hasattr(value, name)]
        assert known, value
        yield from known


def _answers(model):
    """What a model is, and what it says of a bent state."""
    yield "pipe", model.pipe
    yield "shown", repr(model)
    yield "approximates_pipe", model.approximates_pipe
    if isinstance(model, pp.Continuum):
        yield "dof", model.frozen(12).dof
        return
    yield "dof", model.dof
    yield "coordinates", model.coordinates
    for name in (
        "lengths",
        "springs",
        "centres",
        "gyration_radii",
        "drag_points",
        "masses",
        "base",
    ):
        if isinstance(model, pp.Chain):
            yield name, getattr(model, name)
    q = np.asarray(model.bent(lambda s: 0.1 * np.sin(3.0 * s)))
    rates = model.rhs(0.0, np.concatenate([q, 0.0 * q]), 2.0)
    yield STATE, [float(rate) for rate in rates[q.size :]]
    if model._about_shown:
        yield "unbalanced", float(model.unbalanced(2.0))


def recorded():
    """What each thing knew when its file was written, under today's names."""
    found = {}
    for name, known in json.loads(FACTS.read_text("utf-8")).items():
        text = json.dumps(known)
        for before, today in CALLED.items():
            text = text.replace(before, today)
        found[name] = json.loads(text)
    return found


def differences(one, other):
    """Where facts differ from others by more than rounding of what models compute.

    What the others do not have is a field that came later.
    """
    return [
        (where, one.get(where), other.get(where))
        for where in sorted(other)
        if not _near(where, one.get(where), other.get(where))
    ]


def _near(where, one, other):
    computed = STATE in where or where.endswith("unbalanced")
    if computed and isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return one == other


def path_of(name):
    """Of the file of a thing."""
    return FOLDER / f"{name.replace(' ', '-')}.npz"


def main():
    FOLDER.mkdir(exist_ok=True)
    told = json.loads(FACTS.read_text("utf-8")) if FACTS.exists() else {}
    for name, make in THINGS.items():
        path = path_of(name)
        if path.exists():
            continue
        thing = make()
        thing.save(path)
        told[name] = facts(pp.load(path))
        foreign = "of another package" in name  # its text is kept, but not its class
        assert foreign or not differences(told[name], facts(thing)), name
        print(f"{path.stat().st_size:7d} {len(told[name]):5d}  {name}", flush=True)
    FACTS.write_text(json.dumps(told, sort_keys=True).replace("}, ", "},\n") + "\n", "utf-8")


if __name__ == "__main__":
    main()
