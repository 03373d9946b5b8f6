# SPDX-License-Identifier: MIT
"""Malformed arguments for every public call: `python tests/fuzz.py --cases 10000 --seed 0`.

A case draws good arguments for one call and spoils none, one or two of them. It must end in a
TypeError or ValueError that names a spoiled argument, in a PipedynError, or in a finite result;
never in another exception, a warning, more than 5 s of work or a result from what was spoiled.
Prints what did not, and exits with 1 then; `--first` begins at the case to be seen again.
"""

from __future__ import annotations

import argparse
import dataclasses
import faulthandler
import inspect
import math
import re
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import matplotlib

matplotlib.use("agg")

import numpy as np
from loaded import LAWS, MAKERS, Maker, deviations, extremes, states
from matplotlib.figure import Figure

import pipedyn as pp
from pipedyn import modular, plot

NAN, INF = math.nan, math.inf

LONGEST = 20.0
"""Seconds of one core that a case may take."""

HUNG = 300
"""Seconds after which a case that no signal ends is shown by the stacks of all threads."""

Values = Callable[[Random], Any]


# ------------------------------------------------------------------------------- hostile values


class Unspeakable:
    """Has no repr."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")


class Endless:
    """Longer than any list."""

    def __len__(self) -> int:
        return sys.maxsize

    def __getitem__(self, i: int) -> float:
        return 0.5


class Bent(np.ndarray):
    """An array of another class."""


class Words:
    """Stands for an array of words."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array(["a", "b"])


class Mine(pp.Term):
    """A law that no model knows."""

    def __init__(self) -> None:
        pass


def _nested() -> list[Any]:
    itself: list[Any] = [0.5]
    itself.append(itself)
    return itself


def each(*values: Any) -> tuple[Values, ...]:
    """A draw of each value."""
    return tuple(lambda _, v=v: v for v in values)


NOTHINGS: tuple[Values, ...] = (
    *each({}, {"a": 1}, set(), frozenset({1.0}), object(), Ellipsis, NotImplemented, b"1"),
    *each(Decimal("0.5"), np.ma.masked, np.timedelta64(1)),
    *each(np.datetime64("2020-01-01"), Unspeakable(), math, 1j, complex(NAN, 0.0)),
    *each(np.array("a"), np.array(None), slice(3)),
    lambda _: (i for i in range(3)),
    lambda _: iter([0.5]),
    lambda _: Random(3),
)
"""Neither numbers nor arrays, words, models or functions."""

WORDS = each("", "1", "nan", "out", "Beam", "\0", "\ud800", "x" * 10_000, "tip\n")

LOGICAL = each(True, False, np.bool_(True), np.array(False))

NOT_FINITE = (
    *each(NAN, INF, -INF, 10**400, 10**5000, -(10**400), np.float64(NAN), np.float32(INF)),
    *each(np.float16(NAN), np.array(NAN), np.longdouble("1e4000"), Fraction(10**400)),
    *each(Fraction(-(10**400))),
)

LISTS = each(
    *([], (), [0.5], [[0.5]], [NAN], np.zeros(0), np.zeros((0, 3)), np.array([0.5])),
    *(np.zeros((2, 2, 2)), range(10**12), Endless()),
)


@dataclasses.dataclass(frozen=True)
class Kind:
    """What an argument may be, and what it must not.

    Attributes:
        good: draws a value that is accepted.
        bad: draws one that is refused; None where it is not to be spoiled.
    """

    good: Values
    bad: Values | None


def one_of(*values: Any) -> Values:
    return lambda dice: dice.choice(values)


def sure(draw: Values, *values: Any) -> Values:
    """The draw, and values that are not left to chance: `at_bounds` gives each of them."""
    draw.bounds = values + bounds_of(draw)  # type: ignore[attr-defined]
    return draw


def bounds_of(draw: Values | None) -> tuple[Any, ...]:
    return getattr(draw, "bounds", ())


def listed(*values: Any) -> Values:
    """One of some values, each of which `at_bounds` gives."""
    return sure(one_of(*values), *values)


def any_of(*draws: Values) -> Values:
    known = (bounds_of(draw) for draw in dict.fromkeys(draws))
    return sure(lambda dice: dice.choice(draws)(dice), *(value for some in known for value in some))


def optional(kind: Kind) -> Kind:
    """Left out in half of the cases."""
    return Kind(any_of(one_of(None), kind.good), _not(None, kind.bad))


def _not(value: Any, draw: Values) -> Values:
    def drawn(dice: Random) -> Any:
        while (found := draw(dice)) is value:
            pass
        return found

    return sure(drawn, *(one for one in bounds_of(draw) if one is not value))


NONE: Values = one_of(None)


def real(good: tuple[float, float], below: float = -INF, above: float = INF) -> Kind:
    """A number; `below` and `above` are out of range."""

    def fair(dice: Random) -> Any:
        value = dice.uniform(*good)
        kinds = (float, float, np.float64, np.float32, np.array, Fraction, np.longdouble)
        return dice.choice(kinds)(value)

    ends = [end for end in (below, above) if math.isfinite(end)]
    outside = [one_of(end) for end in ends]
    wrong = any_of(NONE, *NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE, *LISTS, *outside * 8)
    return Kind(fair, sure(wrong, *ends, NAN, True, "1", [0.5]))


def count(low: int, high: int, above: int | None = None) -> Kind:
    """A whole number from low on, drawn up to high; `above` is out of range."""

    def fair(dice: Random) -> Any:
        kinds = (int, int, np.int64, np.uint8, np.int32)
        return dice.choice(kinds)(dice.randint(low, high))

    outside = [low - 1, -(10**30), *([] if above is None else [above, 10**30])]
    fractions = one_of(2.5, 3.0, np.float64(2.0), Fraction(3))
    wrong = any_of(
        *(NONE, *NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE, *LISTS, fractions),
        *[one_of(*outside)] * 12,
    )
    return Kind(fair, sure(wrong, *outside, 2.5, True))


def array(
    size: int | tuple[int, ...],
    good: tuple[float, float] = (-1.0, 1.0),
    outside: tuple[float, ...] = (),
    fair: Values | None = None,
    rising: bool = False,
    any_size: bool = False,
) -> Kind:
    """Numbers of one shape; `outside` are out of range."""

    def drawn(dice: Random) -> Any:
        values = np.array([dice.uniform(*good) for _ in range(int(np.prod(size)))])
        if rising:
            values = np.sort(values) + 1e-3 * np.arange(values.size)
        values = values.reshape(size)
        dress = dice.randrange(8)
        if dress == 0:
            return values.tolist()
        if dress == 1:
            return np.ma.array(values)
        if dress == 2:
            return values.view(Bent)
        if dress == 3:
            return values.astype(">f8")
        if dress == 4:
            return np.repeat(values, 2, axis=0)[::2]
        if dress == 5:
            return values.astype(np.longdouble)
        return values

    def spoiled(dice: Random) -> Any:
        values = np.array(drawn(dice), dtype=np.float64)
        at = dice.randrange(values.size)
        wrong = [NAN, INF, -INF, *outside]
        how = dice.choice((0, 1, 2, 3, 4, 5, 6, 8, 9, 0 if any_size else 7))
        if how < 4:
            values.flat[at] = dice.choice(wrong)
            return values if how < 3 else values.tolist()
        if how == 4:
            mask = np.zeros(values.shape, dtype=bool)
            mask.flat[at] = True
            return np.ma.array(values, mask=mask)
        if how == 5:
            entries = values.astype(object)
            entries.flat[at] = dice.choice(["a", None, True, 1j, {}, [1.0], 10**400, Unspeakable()])
            return entries if dice.random() < 0.5 else entries.tolist()
        if how == 6:
            return values.astype(dice.choice([bool, complex, str, bytes]))
        if how == 7:
            return np.append(values.ravel(), values.ravel())[: values.size + dice.choice([-1, 1])]
        if how == 8:
            return values[None, ..., None]
        return np.zeros(values.size, dtype=[("a", float)])

    junk = any_of(
        *(NONE, *NOTHINGS, *WORDS, *LOGICAL),
        *map(one_of, (_nested(), Endless(), Words(), [[0.5], [0.5, 0.5]], [[[0.5] * 10**3]])),
        *map(one_of, (np.zeros(0), [], np.broadcast_to(0.5, (10**10,)), range(10**12), [[]] * 3)),
    )
    others = [] if any_size else [np.full(int(np.prod(size)) + 1, good[0])]
    ends = [np.full(size, value) for value in (NAN, *outside)]
    ends += [np.arange(good[1], good[0], (good[0] - good[1]) / np.prod(size))] if rising else []
    return Kind(fair or drawn, sure(any_of(spoiled, spoiled, junk), *ends, *others, "12"))


def word(*options: str) -> Kind:
    wrong = any_of(NONE, *NOTHINGS, *WORDS, *LOGICAL, one_of(3, NAN, [""]))
    return Kind(one_of(*options), sure(wrong, "out", 3))


def either(good: Sequence[Any], *wrong: Any) -> Kind:
    """One of some values, and none of others, words or what is nothing."""
    return Kind(one_of(*good), sure(any_of(NONE, *NOTHINGS, *WORDS, one_of(*wrong)), *wrong))


def of(*values: Any) -> Kind:
    """An object of the package, or others of it."""
    strangers = tuple(s for s in OBJECTS if not isinstance(s, tuple({type(v) for v in values})))
    wrong = any_of(NONE, *NOTHINGS, *WORDS, one_of(3, NAN, []), *[one_of(*strangers)] * 9)
    return Kind(one_of(*values), sure(wrong, 3))


# ------------------------------------------------------------------------------- good arguments


def bend(s: Any) -> Any:
    return 0.2 * s


PIPE = pp.Pipe(0.2, 3.0)
SI = {"length": 1.2, "bending_stiffness": 0.3, "pipe_mass": 0.2, "fluid_mass": 0.1}
MEASURED = pp.Pipe.from_si(**SI)
TUBE = {"length": 1.0, "outer_diameter": 0.016, "inner_diameter": 0.012, "youngs_modulus": 3e6}
TUBE |= {"density": 1100.0, "fluid_density": 998.0}
HOSE = pp.Pipe.from_tube(**TUBE)
DRAGGED = pp.Pipe(0.4, 5.0, "aspirating", 0.5, drag=2.0, damping=0.01)
FULL = pp.Pipe(0.6, 20.0, "aspirating", 0.5, drag=2.0, damping=0.01)
MASS, SPRING = pp.PointMass(0.6, 0.2), pp.Spring(0.6, 3.0)
JET = pp.Pipe(0.2, 3.0, alpha=1.3, jet_angle=0.4)
DRAWN = pp.Pipe(0.4, 5.0, "aspirating", 0.5, inflow_share=0.3, damping=0.01)
LOSSY = pp.Pipe(0.2, 3.0, hysteresis=0.05)
SAGGING = pp.Pipe(0.2, 3.0, inclination=1.0, terms=(pp.Load(1.0, (0.5, 0.2)),))
TAPERED = pp.Pipe(0.2, stiffness=lambda s: 1.0 - 0.4 * s, mass=pp.Profile([0.5], [1.0, 1.4]))
WET = (pp.AddedMass(0.4), pp.Viscosity(0.2), pp.Foundation(3.0), pp.Damper(0.7, 0.3))
STRUCK = (pp.Stop(0.4, 0.05, 30.0), pp.CubicSpring(0.8, 9.0), pp.Tension(0.5))
UNEVEN = pp.Pipe(0.2, 3.0, terms=(pp.Spring(0.6, 3.0, 1.0), pp.Stop(0.4, 0.05, 30.0, 0.0), *WET))
PROPPED = pp.Pipe(0.3, 5.0, damping=0.01, root="pinned", end="clamped", supports=(0.5,))
SPANS = pp.Pipe(
    *(0.3, 5.0),
    damping=0.01,
    root="pinned",
    end="pinned",
    supports=(0.5,),
    terms=(pp.Stretching(40.0), *WET, *STRUCK),
)
HINGED = pp.Pipe(0.3, 5.0, root=pp.RootSpring(4.0), end="clamped", damping=0.01)
GUIDED = pp.Pipe(0.3, 5.0, end="guided", alpha=1.2, terms=STRUCK)
CHAIN = pp.Chain(PIPE, 3)
BEAM, LEGENDRE = pp.Galerkin(DRAGGED, 3), pp.Galerkin(PIPE, 4, "legendre")
LOADED = pp.Galerkin(pp.Pipe(0.2, 3.0, terms=(MASS, SPRING)), 3, "legendre")
EXACT = pp.Continuum(PIPE)
SCENE = modular.chain(DRAGGED, 3)
HELD = SCENE.plus(modular.Guide(3))
MODELS = {"chain": CHAIN, "beam": BEAM, "legendre": LEGENDRE, "loaded": LOADED, "scene": SCENE}
SPANNED, SUPPORTED = pp.Chain(SPANS, 4), pp.Galerkin(SPANS, 4, "legendre")
LOST = pp.Chain(LOSSY, 3)
SWEPT = pp.Chain(pp.Pipe(0.2, 3.0, terms=(pp.ExternalFlow(1.5, 0.4, 0.3, 0.2, end_shape=0.7),)), 3)
ENDLESS = tuple(map(pp.Continuum, (HINGED, TAPERED, LOSSY, SAGGING)))
ENDLESS += (pp.Continuum(SAGGING, dimensions=3),)
MODELS |= {
    "supported chain": SPANNED,
    "supported": SUPPORTED,
    "hinged": pp.Chain(HINGED, 5),
    "hinged beam": pp.Galerkin(HINGED, 3),
    "guided": modular.chain(GUIDED, 4),
    "jet": pp.Chain(JET, 3),
    "sagging": pp.Chain(SAGGING, 3),
    "drawn": pp.Galerkin(DRAWN, 3),
    "tapered": pp.Chain(TAPERED, 3),
    "space": pp.Chain(DRAGGED, 3, dimensions=3),
    "reduced space": pp.Galerkin(PIPE, 2, "legendre", dimensions=3),
    "uneven space": pp.Chain(UNEVEN, 3, dimensions=3),
    "held space": pp.Chain(PROPPED, 4, dimensions=3),
    "held reduced space": pp.Galerkin(PROPPED, 4, "legendre", dimensions=3),
}
EVERY = {**MODELS, "held": HELD}

FLUTTER = pp.Chain(pp.Pipe(0.2), 3)
CRITICAL = pp.critical_speed(FLUTTER)
SPEED = 1.02 * CRITICAL.speed
CROSSING = pp.crossings(FLUTTER, SPEED)[0]
HOPF = pp.hopf(FLUTTER, CROSSING)
CYCLE = pp.limit_cycle(FLUTTER, SPEED, samples=33)
MOTION = pp.simulate(FLUTTER, 1.0, 2.0, bend, samples=201)
ENSEMBLE = pp.simulate_many(FLUTTER, [0.5, 1.0], 2.0, bend, samples=201)
DIAGRAM = pp.bifurcation_diagram(FLUTTER, [0.98 * CRITICAL.speed, SPEED], cycles=8, brute_force=1)
BRANCH = DIAGRAM.cycles[0]
FOLDED = pp.bifurcation_diagram(pp.Chain(pp.Pipe(0.05), 2), [3.0, 3.3]).cycles[0]
(FOLD,) = (event for event in FOLDED.events if event.kind == "fold")
NEAR_FOLD = {"beta": (0.045, 0.055), "u": (3.0, 3.3)}
FOLDS = pp.cycle_boundary(FOLDED, FOLD, "beta", "u", NEAR_FOLD)
SCIPYS = "scipy:DOP853", "scipy:Radau", "scipy:BDF", "scipy:LSODA"
TRADE = pp.trade(PIPE, "critical_speed", families="beam", sizes=[2, 3], repeats=1)
LOCI = pp.root_loci(CHAIN, [0.0, 1.0, 2.0], 2)
MODES = pp.modes(CHAIN, 1.0)
WINDOW = {"beta": (0.1, 0.9), "u": (0.0, 9.0)}
BOUNDARY = pp.boundary(pp.Chain(pp.Pipe(0.2), 2), "beta", "u", WINDOW, criticality=False)
FIGURE = Figure(layout="constrained")
AX = FIGURE.subplots()
AXES = np.array([[AX]])

OVERHANG = pp.Chain(pp.Pipe(0.2, damping=0.002, supports=[0.25]), 4)
OVERHANG_SPEED = pp.critical_speed(OVERHANG).speed
SHAKEN = pp.Chain(pp.Pipe(0.2, 3.0, damping=0.01), 2)
HINGES = pp.Chain(HINGED, 5)
PLANE = pp.StartPlane(np.array([-0.1, 0.2]), np.array([-0.2, 0.1]))
ENDS = pp.attractors(FLUTTER, SPEED, PLANE)
SPACE = pp.Chain(pp.Pipe(0.2), 3, dimensions=3)
PUMP, SHAKER = pp.Pulsation(2.0, 0.3, 25.0), pp.Harmonic(0.01, 25.0)
SHAKES = pp.forced_response(SHAKEN, 1.0, base=SHAKER, frequencies=(20.0, 30.0))
PUSH = pp.Force(at=0.7, frequency=25.0, amplitude=0.1)
RESPONSE = pp.frequency_response(SHAKEN, 1.0, (1.0, 30.0))
KEPT = Path(tempfile.mkdtemp()) / "kept.npz"
CRITICAL.save(KEPT)
REGIONS = pp.parametric_regions(pp.Chain(pp.Pipe(0.1, 3.0), 2), 3.0, [0.3, 0.6], (12.0, 60.0))
OBJECTS = (PIPE, CHAIN, BEAM, EXACT, SCENE, CRITICAL, CROSSING, HOPF, CYCLE, MOTION, ENSEMBLE)
OBJECTS += (DIAGRAM, ENDS, BRANCH, BRANCH.events[0], TRADE, LOCI, MODES, BOUNDARY, FIGURE, AX)
OBJECTS += (MASS, modular.Clamp())

NUMBER = real((0.0, 1.0))
SHARE = real((0.01, 0.99), below=-0.1, above=1.1)
U = real((0.0, 3.0), below=-1e-9, above=1e101)
SLOW = real((0.0, 3.0), below=-1e-9, above=1e5)
PIPES = of(PIPE, DRAGGED, MEASURED, DRAWN, LOSSY, HINGED, GUIDED)
OTHERS = of(PIPE, DRAGGED, MEASURED, DRAWN, LOSSY, JET, SAGGING)
FLAG = either([False], 0, 1, NAN, 2.0, [True])
EXECUTOR = Kind(one_of(None), sure(any_of(*NOTHINGS, *WORDS, one_of(2, True, object())), 3))
MOVING = Kind(
    one_of(CHAIN, BEAM, SCENE, SPANNED, SUPPORTED),
    sure(any_of(of(CHAIN, BEAM, SCENE).bad, one_of(EXACT, LOST, SWEPT)), EXACT),
)
LINEAR = of(
    EVERY["uneven space"],
    *(CHAIN, BEAM, LEGENDRE, SCENE, EXACT, SPANNED, SUPPORTED, LOST, SWEPT, pp.Chain(SAGGING, 3)),
    *ENDLESS,
)
STRAIGHT = Kind(one_of(CHAIN, LEGENDRE, SPANNED, SUPPORTED, LOST), LINEAR.bad)
TERMS = Kind(
    one_of((), [MASS], (MASS, SPRING), WET, STRUCK),
    any_of(
        *(NONE, *NOTHINGS, *WORDS),
        listed(3, NAN, MASS, [None], ["mass"], [PIPE], [MASS] * 401, [Mine()]),
        *map(listed, ([pp.Spring(1.5, 1.0)], [pp.Tension(-1e7)], [pp.PointMass(0.5, 1e12)])),
    ),
)
PHASES = Kind(
    one_of([pp.Phase(998.0, 1e-4)], (pp.Phase(998.0, 1e-4), pp.Phase(1.2, 3e-4, slip=1.5))),
    any_of(*NOTHINGS, *WORDS, listed(3, NAN, pp.Phase(2.0, 1.0), [None], [998.0], [PIPE])),
)
ROOT = either(
    ["clamped", "pinned", pp.RootSpring(3.0), pp.RootSpring(0.0)],
    "free",
    3.0,
    NAN,
    pp.RootSpring,
    pp.RootSpring(1e10),
)
END = word("free", "guided", "pinned", "clamped")
SUPPORTS = Kind(
    one_of((), [0.5], (0.7, 0.3), [np.float64(0.25)], [Fraction(1, 3)]),
    any_of(
        *(NONE, *NOTHINGS, *WORDS),
        listed(0.5, [0.0], [1.0], [-0.1], [1.2], [NAN], ["a"], [None], [True], [[0.5]]),
        listed([0.5, 0.5], [0.5, 0.5005], [5e-4], [0.9995], [0.01] * 101, np.array([[0.3, 0.6]])),
    ),
)
PLACES = array(3, (0.0, 1.0), (-0.1, 1.1), any_size=True)
AXIS = Kind(one_of(AX), _not(None, of(AX).bad))
USUAL = {"executor": EXECUTOR, "s": PLACES, "ax": AXIS, "units": word("nondimensional")}
"""What these arguments may be in every call that has them and more."""
FUNCTION = Kind(
    one_of(bend),
    any_of(
        *(NONE, *WORDS, listed(3, NAN, [], {}, object(), 1j, "1")),
        *map(listed, (lambda s: NAN * s, lambda s: "a", lambda s: s[:1], lambda s: None)),
        *map(listed, (lambda s: s * 1j, lambda s: np.ma.masked_all_like(s), lambda s: 1e300 * s)),
        *map(listed, (lambda s: math.sin(s), lambda s: 1.0 if s < 0.5 else 0.5, lambda s: s > 0.5)),
    ),
)
UPWARD = Kind(one_of(lambda s: 1.0 + s, lambda s: np.exp(s)), FUNCTION.bad)
ALONG = Kind(
    any_of(NONE, UPWARD.good, one_of(pp.Profile([0.5], [1.0, 1.7]))),
    any_of(
        *(
            _not(None, FUNCTION.bad),
            listed([1.0, 0.5], np.array([1.0, 0.5]), lambda s: 1.0 - 2.0 * s),
        ),
        listed(lambda s: 2.0 + s, pp.Profile([0.5], [2.0, 1.0]), lambda s: 1.0 + np.sqrt(s)),
    ),
)
PROFILE = Kind(
    one_of(lambda r: 1.0 - 0.5 * r),
    listed(
        *(None, 3, NAN, "a", {}, object()),
        *(lambda r, v=v: v for v in (NAN, "a", [1, 2], 1j, [[1], [1, 2]], np.ma.masked)),
    ),
)


FLOWS = Kind(
    one_of(PUMP, lambda t: 1.0 + 0.2 * t, (lambda t: 1.0 + t**2, lambda t: 2.0 * t)),
    any_of(
        *(NONE, *NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE),
        listed(-1.0, 1e5, [1.0], (1.0, 2.0), (PUMP, 1.0), (PUMP,) * 3, (lambda t: 1.0,)),
        *map(listed, (lambda t: NAN, lambda t: "a", lambda t: [1.0], lambda t: None)),
        *map(listed, (lambda t: -1.0, lambda t: 1j, lambda t: {}, lambda t: "1")),
        *map(listed, (lambda t: 1.0 if t < 0.05 else NAN, (lambda t: 1.0, lambda t: NAN))),
        *map(one_of, (lambda t: 1.0 - 20.0 * t, lambda t: True, lambda t: np.zeros(2))),
    ),
)
ASTIR = pp.Harmonic(0.1, 3.0, (1, 0, -1j))
SHAKERS = Kind(
    one_of(
        *(None, SHAKER, pp.Harmonic(0.1, 3.0, "y"), lambda t: (0.1 * t, np.float64(0.2))),
        pp.Harmonic(0.1, 3.0, (1.0, 2.0, 0.0)),
        (lambda t: (t**2, 0), lambda t: (2 * t, 0), lambda t: [2, 0]),
    ),
    any_of(
        *(*NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE),
        listed(1.0, [1.0, 2.0], (SHAKER,), (SHAKER, SHAKER), (SHAKER, None, 3.0), PUMP, ASTIR),
        *map(listed, (lambda t: 0.1, lambda t: (t,), lambda t: (t, t, t), lambda t: (NAN, 0.0))),
        *map(listed, (lambda t: "ab", lambda t: None, lambda t: (1j, 0), lambda t: "12")),
        *map(listed, (lambda t: (0, INF if t > 0.09 else 0), lambda t: ((0, 0), (0, 0)))),
    ),
)
WAVES = one_of(
    None, lambda s, t: np.sin(s - t), lambda s, t: 0.1, lambda s, t: np.ones((len(s), 2))
)
NO_FORCE = any_of(
    *(*NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE),
    listed(1.0, [1.0], [None], [PUSH] * 21, SHAKER, PUMP, lambda t: 1.0, pp.Force),
    *map(listed, (pp.Force(lambda t: NAN, 1.0), pp.Force(lambda t: "a", 1.0), [PUSH, "a"])),
    *map(listed, (pp.Force(lambda t: (1.0, 2.0, 3.0), 1.0), pp.Force(lambda s, t: [s]))),
    *map(listed, (pp.Force(lambda s, t: np.sign(s - 0.4)), pp.Force(lambda t: None, 1.0))),
)
FORCES = Kind(
    one_of(None, PUSH, [PUSH, pp.Force(lambda s, t: s * t)], (pp.Force(lambda t: (t, 1), 0.5),)),
    NO_FORCE,
)
SHAKERS_IN_SPACE = Kind(
    one_of(None, SHAKER, ASTIR, pp.Harmonic(0.1, 3.0, "z"), lambda t: (0.1 * t, 0, t**2)),
    listed(*((lambda t: (t, t)), (lambda t: (t, t, NAN)), (lambda t: 0.1), 3.0, PUMP)),
)
FORCES_IN_SPACE = Kind(
    one_of(None, PUSH, [PUSH, pp.Force(lambda s, t: s * t)], pp.Force(lambda t: (t, 1, 2), 0.5)),
    listed(pp.Force(lambda t: (1.0, 2.0), 1.0), pp.Force(lambda s, t: np.ones((len(s), 2)))),
)
IN_SI = pp.Force.from_si(HOSE, lambda x, t: 0.01 * x * t)
FORCES_IN_SI = Kind(
    one_of(
        None,
        pp.Force.from_si(HOSE, lambda x, t: 0.01 * x * t),
        [pp.Force.from_si(HOSE, at=0.2, frequency=3.0)],
    ),
    NO_FORCE,  # tests have the forces that SI units beside them would belie
)


def start(size: int, any_size: bool = False) -> Kind:
    """Coordinates at rest or an angle theta(s)."""
    rows = array(size, (-0.1, 0.1), (1e7,), any_size=any_size)
    return Kind(any_of(rows.good, one_of(bend)), any_of(rows.bad, FUNCTION.bad))


def parts(good: tuple[Any, ...], *wrong: Any) -> Kind:
    bad = any_of(NONE, *NOTHINGS[:8], *WORDS, listed(3, NAN, [], [PIPE], [None], [good], *wrong))
    return Kind(any_of(one_of(good), one_of(list(good))), bad)


MODULES = SCENE.modules
CONSTRAINTS = SCENE.constraints
FURTHER = modular.Module(), modular.Constraint(), modular.Segment, pp.PointMass(at=4.0, mass=1.0)


@dataclasses.dataclass(frozen=True)
class Target:
    """One public call.

    Attributes:
        name: what messages call it; up to a bracket the public name.
        call: takes the arguments by name.
        kinds: of the arguments.
        slow: whether an unspoiled call takes long; few are made.
        called: names by which messages may call an argument, a pattern each.
    """

    name: str
    call: Callable[..., Any]
    kinds: Mapping[str, Kind]
    slow: bool = False
    called: Mapping[str, str] = dataclasses.field(default_factory=dict)


def public_name(call: Any) -> str:
    """The name by which users call a function, class, method or callable object."""
    name = getattr(call, "__name__", "__call__")
    owner = getattr(call, "__self__", call if name == "__call__" else None)
    module = call.__module__
    if owner is not None:
        cls = owner if isinstance(owner, type) else type(owner)
        name, module = f"{cls.__name__}.{name}", cls.__module__
    folder = module.removeprefix("pipedyn.").split(".")[0]
    return f"{folder}.{name}" if folder in ("continuation", "modular", "plot") else name


def target(
    call: Callable[..., Any],
    name: str = "",
    /,
    slow: bool = False,
    called: Mapping[str, str] | None = None,
    **kinds: Kind,
) -> Target:
    """A call with kinds of its arguments; those of `USUAL` and flags need not be given.

    name: what messages call it; what begins with a bracket follows the public name.
    """
    own = inspect.signature(call).parameters
    usual = {k: v for k, v in USUAL.items() if k in own}
    usual |= {k: FLAG for k, argument in own.items() if isinstance(argument.default, bool)}
    full = public_name(call) + name if name[:1] in ("", "[") else name
    return Target(full, call, usual | kinds, slow, called or {})


def _pipes() -> Iterator[Target]:
    numbers = {
        "alpha": real((0.0, 2.0), -0.1, 1e300),
        "hysteresis": real((0.0, 1.0), -1e-12, 1e300),
        "terms": TERMS,
        "root": ROOT,
        "end": END,
        "supports": SUPPORTS,
        "rotary_inertia": real((0.0, 0.1), -1e-9, 1e4),
        "inclination": real((-3.1, 3.1), -3.2, 3.2),
    }
    turned, share = real((-1.5, 1.5), -3.2, 3.2), real((0.0, 1.0), -1e-9, 1.1)
    ends = {  # what only one of the flows has
        "ejecting": {"jet_angle": turned, "inflow_share": Kind(one_of(1, 1.0), share.bad)},
        "aspirating": {"jet_angle": Kind(one_of(0, 0.0), turned.bad), "inflow_share": share},
    }
    for flow, own in ends.items():
        yield target(
            pp.Pipe,
            f"[{flow}]",
            beta=real((0.0, 0.99), -0.1, 1.0),
            gamma=real((-10.0, 10.0), -1e7, 1e300),
            flow=word(flow),
            drag=real((0.0, 2.0), -0.1, 1e300),
            damping=real((0.0, 2.0), -1e-12, 1e300),
            scales=Kind(
                one_of(None, (1.0, 1.0, 2.0, 3.0)),
                any_of(*NOTHINGS, *WORDS, *NOT_FINITE, one_of((1, 1, 1, 0.0), (1, 1), [1] * 4)),
            ),
            stiffness=ALONG,
            mass=ALONG,
            **numbers,
            **own,
        )
    places, values = array(1, (0.2, 0.8), (-0.1, 1.0)), array(2, (0.5, 2.0), (-1.0, 0.0, 1e7))
    size = real((0.1, 2.0), 0.0)
    yield target(pp.Phase, density=real((1.0, 1e3), 0.0), flow_rate=size, slip=size)
    yield target(pp.Profile, at=places, values=values)
    yield target(pp.Profile, values=UPWARD)
    yield target(pp.Profile([0.5], [1.0, 0.5]))
    positive = real((0.1, 3.0), 0.0, 1e300)
    beam = dict.fromkeys(SI, positive) | {"length": real((1.0, 1.0), 0.0, 1e300)}  # of places
    tube = {name: real((0.9 * x, x), 0.0, 1e300) for name, x in TUBE.items()}
    tube["length"] = beam["length"]
    for flow, own in ends.items():
        for make, section in ((pp.Pipe.from_si, beam), (pp.Pipe.from_tube, tube)):
            yield target(
                make,
                f"[{flow}]",
                **numbers | {"rotary_inertia": real((0.0, 0.01), -1e-9, 1e4)},
                **section,
                gravity=real((-9.81, 9.81), -1e13, 1e300),
                damping_time=real((0.0, 0.1), -1.0, 1e300),
                drag_coefficient=real((0.5, 1.2), -1.0, 1e300),
                external_diameter=real((0.016, 0.1), -1.0, 1e300),
                external_density=real((1.0, 1e3), -1.0, 1e300),
                added_mass_coefficient=real((1.0, 1.5), -1.0, 1e300),
                flow=word(flow),
                stiffness_profile=ALONG,
                **own,
            )
    dry = {k: v for k, v in beam.items() if k != "fluid_mass"}
    yield target(
        pp.Pipe.from_si,
        "Pipe.from_si[phases]",
        **dry,
        phases=PHASES,
        inner_diameter=real((0.01, 0.2), 0.0),
    )
    dry = {k: v for k, v in tube.items() if k != "fluid_density"}
    yield target(pp.Pipe.from_tube, "Pipe.from_tube[phases]", **dry, phases=PHASES)
    from_si = partial(pp.Pipe.from_si, **SI)
    yield target(from_si, "Pipe.from_si[mass_profile]", mass_profile=ALONG)
    ratio = Kind(positive.good, _not(None, positive.bad))
    yield target(from_si, "Pipe.from_si[nozzle]", nozzle_ratio=ratio)
    rows = array(4)
    odd = any_of(
        *NOTHINGS, *WORDS, *LOGICAL, *NOT_FINITE, one_of([1.0, NAN], [True], [[1], [1, 2]])
    )
    for quantity in ("speed", "flow_rate", "time", "frequency", "length"):
        for way in ("si", "from_si"):
            converted = getattr(HOSE, f"{quantity}_{way}")
            name, *index = inspect.signature(converted).parameters
            of_phase = dict.fromkeys(index, optional(count(0, 0, 1)))
            yield target(converted, **{name: Kind(any_of(rows.good, NUMBER.good), odd)}, **of_phase)
    yield target(MEASURED.equivalent_damping, frequency=size)
    yield target(
        pp.end_coefficient,
        "[function]",
        slow=True,
        velocity=PROFILE,
        radius=size,
        section=optional(size),
    )
    rows = array(3, (0.1, 1.0))
    rising = array(3, (0.1, 1.0), (-1.0,), fair=one_of([0.0, 0.4, 1.0], np.array([0.0, 1.0, 2.0])))
    yield target(
        pp.end_coefficient,
        "[radii]",
        called={"radii": "radii|velocity"},
        velocity=rows,
        radii=rising,
    )
    yield target(
        pp.end_coefficient,
        "[areas]",
        called={"areas": "areas|velocity"},
        velocity=rows,
        areas=array(3, (0.1, 1.0), (0.0, -1.0)),
        section=optional(size),
    )
    for law in LAWS:
        kinds = {item.name: real((0.1, 1.0), -1.0, -1e300) for item in dataclasses.fields(law)}
        signed = [name for name in kinds if name.startswith(("load", "force"))]
        kinds |= dict.fromkeys(signed, real((-1.0, 1.0)))
        kinds |= {"at": real((0.01, 0.99), -0.1, 0.0)} if "at" in kinds else {}
        for name, kind in kinds.items():
            ends = one_of(*(getattr(term, name) for term in extremes(law)))
            kinds[name] = Kind(any_of(kind.good, ends), kind.bad)
            if name.endswith("_across"):  # None: as along x
                kinds[name] = optional(kinds[name])
        yield target(law, **kinds)
    pair = array(2, (-1.0, 1.0))
    yield target(pp.Load, "[pair]", at=real((0.01, 0.99), -0.1, 0.0), force=pair)
    yield target(pp.DistributedLoad, "[pair]", force=pair)


def _chains() -> Iterator[Target]:
    thirds = array(
        3, (0.2, 0.5), (-1.0, 0.0), fair=one_of([0.2, 0.3, 0.5], np.array([0.5, 0.4, 0.1]))
    )
    fractions = optional(array(3, (0.1, 0.9), (-0.1, 1.1)))
    springs = array(3, (0.0, 9.0), (-1.0, 1e300))
    rules = one_of("consistent", "uniform", "frequency", "rayleigh")
    kinds = {
        "pipe": OTHERS,
        "n": Kind(one_of(3), any_of(*NOTHINGS, *WORDS, one_of(0, -1, 2.0))),
        "springs": Kind(any_of(springs.good, rules), springs.bad),
        "lengths": optional(thirds),
        "centres": fractions,
        "gyration_radii": optional(array(3, (0.01, 0.1), (-1.0,))),
        "drag_points": fractions,
        "base": Kind(one_of(0.0, 0), real((0.0, 0.1), -0.1, 1.0).bad),
    }
    yield target(pp.Chain, **kinds)
    four = array(4, (0.0, 9.0), (-1.0, 1e300))  # an end that is clamped or guided has a joint, too
    held = {**kinds, "pipe": of(HINGED, GUIDED), "springs": Kind(rules, four.bad)}
    held["base"] = Kind(one_of(0.0), kinds["base"].bad)
    for make in (pp.Chain, modular.chain):
        yield target(make, "[held]", **held)
    yield target(modular.chain, **kinds)
    yield target(
        pp.Galerkin,
        pipe=PIPES,
        m=Kind(count(2, 6).good, count(1, 6, 2001).bad),
        basis=word("beam", "legendre"),
    )
    plain = either([PIPE, SAGGING], CHAIN, 3)
    dimensions = either([2, 3], 0, 1, 4, NAN, 2.5, [3])
    yield target(pp.Continuum, pipe=plain, dimensions=dimensions)
    yield target(EXACT.with_pipe, pipe=PIPES)
    yield target(EXACT.frozen, m=count(1, 9, 2001))
    no_function = any_of(NONE, *NOTHINGS[:12], *WORDS, one_of(3, NAN))
    yield target(
        EXACT.converge,
        question=Kind(one_of(lambda rom: rom.dof), no_function),
        distance=Kind(
            one_of(lambda a, b: 0.0), any_of(no_function, one_of(lambda a, b: "a", lambda a, b: 1j))
        ),
        tolerance=real((0.1, 1.0), 0.0),
        smallest=count(1, 9, 1993),
        largest=count(1, 9, 2001),
    )


def _models() -> Iterator[Target]:
    for name, model in EVERY.items():
        cls = "modular.Assembly" if isinstance(model, modular.Assembly) else type(model).__name__
        tag = f"[{name}]"
        n = model.coordinates
        closed = n != model.dof
        resting = np.array(model.bent(lambda s: 0.0 * s))
        fair = one_of(resting, resting.tolist()) if closed else None
        q = array(n, (-0.5, 0.5), (1e7,), fair=fair)
        if closed:  # redundant coordinates may be given as angles, but guides are met by few
            q = Kind(q.good, any_of(NONE, *NOTHINGS, *WORDS, q.bad))
        still = one_of(np.append(resting, 0.0 * resting)) if closed else None
        rates = array(2 * n, (-0.3, 0.3), fair=still)
        batch = array((2 * n, 2), (-0.3, 0.3))
        y = Kind(any_of(rates.good, *([] if closed else [batch.good])), rates.bad)
        columns = array((n, 2), (-0.5, 0.5))
        small = Kind(
            any_of(array(model.dof).good, array((model.dof, 3)).good),
            array(model.dof, any_size=closed).bad,
        )
        complexes = Kind(small.good, _no_complex(small.bad))
        driven = {
            **{"y": rates, "u": U, "u_dot": optional(real((-9.0, 9.0)))},
            "base": optional(array((3, model.dimensions))),
        }
        for ask, states_of in ((model.rhs, y), (model.jacobian, rates)):
            asked, title = partial(ask, 0.0), f"{cls}.{ask.__name__}{tag}"
            yield target(asked, title, y=states_of, u=U)
            yield target(asked, title, **driven)
        yield target(model.energy, tag, y=y)
        yield target(model.power, tag, y=y, u=U)
        yield target(model.power, tag, **driven)
        # Small changes of a held pipe, (dof,), are taken as well as coordinates.
        either = q if not closed else Kind(q.good, any_of(*NOTHINGS, *WORDS))
        yield target(model.shape, tag, q=either)
        yield target(model.tip, tag, q=either)
        yield target(model.tips, tag, q=columns)
        yield target(model.curvatures, tag, q=columns)
        yield target(model.tip_velocities, tag, q=columns, qdot=columns)
        yield target(model.bent, tag, angle=FUNCTION)
        others = Kind(one_of(model.pipe), PIPES.bad) if name == "tapered" else OTHERS
        if model.dimensions == 3:
            fair = one_of(PROPPED) if closed else one_of(PIPE, DRAGGED, SAGGING, JET)
            others = Kind(fair, PIPES.bad)
        yield target(model.with_pipe, tag, pipe=others)
        yield target(model.deflection, tag, q=complexes)
        yield target(model.from_elastic, tag, z=complexes)
        bent = [] if closed else [np.repeat((0.1, 0.0), n // 2)]
        in_plane = one_of([0.0] * n, *bent)  # z = 0
        at = Kind(in_plane, q.bad) if model.dimensions == 3 else q
        yield target(model.operators, tag, q=optional(at))
        yield target(model.about, tag, q=at)
        shape = pp.modes(model, 0.0).shapes[0]
        yield target(shape, tag)
    yield target(LEGENDRE.functions, derivative=count(0, 2, 3))
    for model in (CHAIN, SPANNED, LOST):
        given = {"u": U, "u_dot": real((-9.0, 9.0), -1e300)}
        yield target(model.operators().at, **given)


def any_loaded(maker: Maker) -> Values:
    """Models of a pipe with one term or many, whose numbers are ordinary, the least or the largest.

    Some terms are so at one place, and many between any two.
    """
    laws = [law for law in LAWS if maker.takes(law)]

    def drawn(dice: Random) -> pp.Model:
        terms = []
        for _ in range(dice.choice((1, 2, 5, 15))):
            term = dice.choice(extremes(dice.choice(laws)))
            for item in dataclasses.fields(term):
                if dice.random() < 0.5:
                    term = dataclasses.replace(term, **{item.name: dice.uniform(0.01, 0.99)})
            terms.append(term)
        return maker(*terms)

    return drawn


def _same_in_batches(model: pp.Model, seed: int) -> list[float]:
    """Numbers where a batch of states is answered as each is alone; where it is not NaN."""
    shares = deviations(model, states(model, seed))
    return [share if share < 1e-6 else NAN for share in shares.values()]


def _moved(model: pp.Model) -> Any:
    """As much of a short motion as so many evaluations reach."""
    try:
        return pp.simulate(model, 3.0, 1e-3, lambda s: 1e-3 * s, samples=3, most=200)
    except pp.MotionStopped as stopped:
        return stopped.motion


def _loaded() -> Iterator[Target]:
    for name, maker in MAKERS.items():
        model = Kind(any_loaded(maker), None)
        seed = Kind(lambda dice: dice.randrange(1000), None)
        yield target(_same_in_batches, f"states[{name}]", model=model, seed=seed)
        yield target(_moved, f"motion[{name}]", model=model)


def _no_complex(draw: Values) -> Values:
    """Complex columns are small displacements as good as real ones."""

    def drawn(dice: Random) -> Any:
        while True:
            found = draw(dice)
            kind = getattr(getattr(found, "dtype", None), "kind", "")
            listed = isinstance(found, list) and any(isinstance(part, complex) for part in found)
            if kind not in "cO" and not listed:
                return found

    return drawn


def _scenes() -> Iterator[Target]:
    node = count(1, 3, 10**6 + 1)
    stiff = real((0.0, 3.0), -1.0, 1e300)
    for part, kinds in {
        modular.Segment: {
            "length": real((0.1, 1.0), 0.0, 1.1),
            "centre": SHARE,
            "gyration_radius": optional(real((0.0, 1.0), -0.1, 1e300)),
            "drag_point": SHARE,
        },
        modular.TorsionalSpring: {
            "joint": node,
            "stiffness": stiff,
            "damping": optional(stiff),
            "rest_angle": real((-1.0, 1.0), -1e300, 1e300),
        },
        modular.PointMass: {"at": real((0.1, 1.0), 0.0), "mass": real((0.1, 1.0), -1.0)},
        modular.Clamp: {"base": real((0.0, 0.9), -0.1, 1.0)},
        modular.Joint: {"segment": count(2, 5, 10**6 + 1)},
        modular.Guide: {"node": node},
        modular.Pin: {"node": node, "x": real((-1, 1), -1e300, 1e300), "y": real((-1, 1), -1e300)},
        modular.Drag: {},
        modular.InternalFlow: {},
    }.items():
        yield target(part, f"modular.{part.__name__}", **kinds)
    functions = Kind(one_of(None), any_of(*NOTHINGS[:12], *WORDS, listed(3, NAN, [])))
    yield target(
        modular.Custom,
        called={"mass": "mass|Custom|mine", "name": "name"},
        nodes=either([(1,), [2, 3], np.array([1])], 1, NAN, (0,), (1, 1), (1.5,), (True,), ("a",)),
        joints=either([(), (2,)], 1, NAN, (0,), (1, 1), (1.5,), (None,), [[1]]),
        energy=Kind(one_of(lambda q: 0.5 * q @ q), functions.bad),
        force=functions,
        force_by_q=functions,
        force_by_qdot=functions,
        mass=Kind(
            one_of(None),
            any_of(_not(None, array((7, 7)).bad), one_of(-np.eye(2), [[0.0, NAN]] * 2)),
        ),
        name=Kind(one_of("mine"), any_of(NONE, *NOTHINGS, listed("", "\t", 3, NAN, []))),
    )
    for role, good, values in (
        ("energy", lambda q: 0.5 * q @ q, (NAN, "a", None, [1.0, 2.0], {}, 1e400, 1j, np.ones(9))),
        ("force", lambda q, qdot: -qdot, (NAN, "a", None, [1.0], {}, [NAN, 0.0], np.ones(9))),
    ):
        yield target(
            lambda **own: SCENE.plus(modular.Custom(nodes=(2,), name="mine", **own)),
            f"modular.Assembly[{role}]",
            called={role: "mine"},
            **{role: Kind(one_of(good), one_of(*(lambda *_, v=v: v for v in values)))},
        )
    yield target(
        modular.Assembly,
        called={
            "modules": "module|segment|node|lengths|inertia|terms",
            "constraints": "constraint|(?i:joint|pin|clamp)|Guide|segment|node|inertia",
        },
        pipe=OTHERS,
        modules=parts(
            MODULES, *([*MODULES, part] for part in (*FURTHER, *CONSTRAINTS)), MODULES[1:]
        ),
        constraints=parts(
            CONSTRAINTS,
            *([*CONSTRAINTS, part] for part in (*FURTHER, modular.Joint(4), modular.Guide(4))),
            *([*CONSTRAINTS, modular.Pin(3, *at)] for at in ((0.0, 1.0), (2.0, 0.0))),
            *(CONSTRAINTS[1:], CONSTRAINTS[:-1]),
        ),
    )
    yield target(
        lambda parts: SCENE.plus(parts),
        "modular.Assembly.plus",
        called={"parts": "parts|module|constraint|node|lengths|segment|terms"},
        parts=either(
            [modular.PointMass(1, 0.2), modular.Guide(3)], *FURTHER, 3, [], modular.Segment(0.1)
        ),
    )
    angles = array(3, (-0.2, 0.2), (1e7,))
    for scene, tag in ((SCENE, ""), (HELD, "[held]")):
        n = scene.integrated
        fair = one_of(np.zeros(n)) if tag else None
        turned = array(n, (-0.2, 0.2), (1e7,), fair=fair)
        state = array(6 * n, (-0.2, 0.2))
        yield target(scene.about, tag, q=turned)
        yield target(scene.state, tag, angles=turned, rates=optional(turned))
        yield target(scene.angles, tag, y=state)
        yield target(scene.admissible, tag, angles=angles)
        yield target(scene.basis, tag, q=optional(turned))
        yield target(scene.equilibrium, tag, start=angles, u=SLOW)


def _questions() -> Iterator[Target]:
    for function, several in ((pp.eigenvalues, 4), (pp.modes, 2)):
        yield target(
            function,
            model=LINEAR,
            u=SLOW,
            count=Kind(one_of(1, several), _not(None, count(1, 5, 10**7).bad)),
        )
    speeds = array(3, (0.0, 3.0), (-1.0, 1e9), rising=True, any_size=True)
    yield target(
        pp.root_loci, slow=True, model=STRAIGHT, speeds=speeds, count=optional(count(1, 2, 1001))
    )
    ends = real((1.0, 9.0), 0.0, 1e9)
    for function in (pp.crossings, pp.critical_speed):
        yield target(function, slow=True, model=STRAIGHT, max_speed=ends)
    maker = Kind(
        one_of(lambda value: pp.Chain(pp.Pipe(value), 2)),
        any_of(NONE, *NOTHINGS[:10], *WORDS, one_of(3, NAN, CHAIN)),
    )
    values = array(2, (0.1, 0.5), any_size=True)
    yield target(
        pp.stability_curve, slow=True, make_model=maker, values=values, max_speed=optional(ends)
    )
    of_beta = one_of({"beta": [0.1, 0.5]}, {"beta": 0.2, "gamma": [[1.0], [2.0]]})
    wrong = ({}, {"bet": 0.1}, {"beta": 1.0}, {"beta": []}, {"beta": "a"}, {"beta": [NAN]})
    yield target(
        pp.critical_speeds,
        slow=True,
        model=STRAIGHT,
        numbers=Kind(of_beta, any_of(NONE, *NOTHINGS[2:], *WORDS, one_of(*wrong))),
        max_speed=real((30.0, 60.0), 0.0, 1e9),  # speeds are NaN where a search ends before
        progress=FLAG,
    )
    yield target(
        pp.boundary,
        slow=True,
        model=STRAIGHT,
        x=word("beta"),
        y=word("u"),
        ranges=Kind(
            one_of(WINDOW),
            any_of(
                NONE,
                *(*NOTHINGS[2:], *WORDS),
                one_of({}, {"beta": (0.1, 0.9)}, 3, WINDOW | {"u": (9.0, 1.0)}),
                one_of(WINDOW | {"beta": (0.0, 0.5)}, WINDOW | {"u": (NAN, 1.0)}),
                one_of(WINDOW | {"u": "12"}, WINDOW | {"gamma": (0.0, 1.0)}),
            ),
        ),
        u=Kind(one_of(None), any_of(*NOTHINGS, *WORDS, one_of(1.0, -1.0, NAN, [None]))),
        progress=FLAG,
    )
    inside = {"x": real((0.1, 0.9), 0.09, 0.91), "y": real((0.0, 9.0), -0.1, 9.1)}
    yield target(BOUNDARY.unstable, **inside)
    yield target(pp.criticality_curve, slow=True, make_model=maker, values=values)


def _own_equations() -> Iterator[Target]:
    """Of a branch that users follow themselves."""
    law = one_of(lambda x, p: x - p)
    no_law = (3, "x", lambda x, p: [1.0, 2.0], lambda x, p: "a")
    names = any_of(*NOTHINGS[2:], *WORDS, listed(3, {"a": 3}, [lambda x, p: 1.0]))
    yield target(
        pp.continuation.follow,
        problem=Kind(law, any_of(NONE, *NOTHINGS, *WORDS, listed(*no_law))),
        x0=array(1, (-0.1, 0.1), any_size=True),
        p0=real((-0.1, 0.1), -1.1, 1.1),
        interval=array(2, fair=one_of((-1.0, 1.0), [-0.5, 0.7])),
        derivative=Kind(
            one_of(None, lambda x, p: np.insert(np.eye(x.size), x.size, -1.0, axis=1)),
            any_of(*NOTHINGS, *WORDS, listed(3, lambda x, p: [1.0], lambda x, p: [[2.0, 0.0]])),
        ),
        tests=Kind(one_of(None, {"a": lambda x, p: x[0]}), names),
        step=real((0.05, 0.2), 0.0, 2.0),
        scale=real((0.5, 2.0), 0.0),
        points=count(1, 50, 100_001),
    )


QUANTITIES: dict[str, dict[str, Kind]] = {
    "critical_speed": {"max_speed": real((1.0, 20.0), 0.0, 1e9)},
    "frequencies": {"u": SLOW, "count": count(1, 4, 101)},
    "root_loci": {
        "speeds": array(3, (0.0, 3.0), (-1.0, 1e9), rising=True, any_size=True),
        "count": count(1, 3, 101),
    },
    "motion": {
        "u": SLOW,
        "duration": Kind(
            any_of(real((0.02, 0.1)).good, one_of(1e-6)), real((0.1, 0.2), 0.0, 1e300).bad
        ),
        "start": Kind(one_of(None, bend), _not(None, FUNCTION.bad)),
        "samples": count(2, 9, 100_001),
        "rtol": Kind(real((1e-5, 1e-2)).good, optional(real((1e-5, 1e-2), 0.0, 1.0)).bad),
    },
    "limit_cycle": {
        "u": Kind(one_of(6.5, 1e-3), real((1.0, 2.0), 0.0, 1e9).bad),
        "rtol": Kind(real((1e-3, 1e-2)).good, optional(real((1e-3, 1e-2), 0.0, 1.0)).bad),
    },
}
"""The conditions of each quantity."""


def _comparisons() -> Iterator[Target]:
    """Models held against the continuous pipe, for every quantity."""
    repeats = count(1, 2, 1001)
    junk = any_of(*NOTHINGS, *WORDS, listed(3, [3], [], [None], ["beam", "rod"], {"beam": 3}))
    among = Kind(one_of(["midpoint", "legendre"], "legendre", ("beam", "midpoint pair")), junk)
    sizes = [3, 6], 4, np.array([4, 5], dtype=np.uint8), {"legendre": [5, 6], "midpoint": 4}
    several = one_of(*sizes, range(2, 5))
    no_sizes = listed(
        *([], [0], [3, 3], [5, 3], [2.5], "a", NAN, [NAN], [True], -1, 10**30, [[3, 4]]),
        *({3: [3]}, {"rod": [3]}, {"legendre": [0]}, {"beam": "a"}, {"beam": []}, {"beam": [NAN]}),
        *(np.array([6, 3], dtype=np.uint8), {"midpoint": np.array([6, 3], dtype=np.uint64)}),
        *(Unspeakable(), {"legendre": Unspeakable()}, np.zeros(0, dtype=int), range(10**12)),
    )
    sharp, wide = real((1e-3, 0.1), 0.0, 1.0), one_of(1e-10, 1e-6, 0.5)
    cheap = "critical_speed", "frequencies"
    budget = Kind(
        any_of(real((1e-3, 1e-2)).good, one_of(1e-300, 1e-5)), real((0.1, 0.2), 0.0, 1e7).bad
    )
    for name, conditions in QUANTITIES.items():
        called = {"start": "start|angle"}
        tolerance = Kind(any_of(sharp.good, wide), sharp.bad) if name in cheap else sharp
        pipe = Kind(one_of(PIPE) if name == "limit_cycle" else one_of(PIPE, FULL, SPANS), PIPES.bad)
        common = {**conditions, "pipe": pipe, "quantity": Kind(one_of(name), word("a").bad)}
        for tag, demand in (
            ("tolerance", {"tolerance": tolerance}),
            ("budget", {"budget": budget}),
            ("both", {"tolerance": Kind(tolerance.good, None), "budget": Kind(budget.good, None)}),
        ):
            kinds = {**common, **demand, "among": among, "repeats": repeats}
            yield target(_chosen, f"choose[{name}, {tag}]", slow=True, called=called, **kinds)
        measured = {"families": among, "sizes": Kind(several, no_sizes), "progress": FLAG}
        yield target(
            _traded,
            f"trade[{name}]",
            slow=True,
            called=called,
            **common,
            **measured,
            repeats=repeats,
        )
        wanted = real((1e-3, 0.1), 0.0, 2.0)
        if name == "limit_cycle":  # those without one take long
            common["u"] = Kind(one_of(1e-3), conditions["u"].bad)
        kinds = {"u": SLOW, **common, "tolerance": wanted}
        yield target(_relevance, f"relevant[{name}]", slow=True, called=called, **kinds)


def _chosen(**given: Any) -> tuple[Any, ...]:
    """What a choice must give in numbers; those of models that failed are NaN."""
    found = pp.choose(**given)
    _own(row.failure for row in (one.row for one in found.tried) if row is not None)
    return found.row, found.reference.error, found.seconds, str(found), found._repr_html_()


def _traded(**given: Any) -> tuple[Any, ...]:
    """The same of a trade; a model whose answer is of another kind is infinitely wrong."""
    found = pp.trade(**given)
    _own(row.failure for row in found.rows)
    costs = [(row.seconds, row.spread) for row in found.rows if row.failure is None]
    return costs, found.reference.error, _laws(found), str(found), found.to_csv()


def _own(failures: Iterable[Exception | None]) -> None:
    """Raises what no model may fail with: rows keep whatever was raised.

    A search gives up models that take twice the time of the best, which on a busy machine may be
    any.
    """
    for failure in failures:
        late = type(failure).__name__ == "TookTooLong"
        own = failure is None or late or isinstance(failure, pp.PipedynError)
        if not own and type(failure) is not ValueError:
            raise RuntimeError(f"a model failed with {type(failure).__name__}") from failure


def _laws(found: pp.Trade) -> list[Any]:
    """The numbers that the laws of a trade have."""
    laws = found.orders().values()
    named = {"power": "rate", "exponential": "rate", "flat": "limit"}
    return [getattr(law, named[law.law]) for law in laws if law.law in named]


def _relevance(**given: Any) -> str:
    """In words: an effect that changes the kind of the answer is infinitely large."""
    return str(pp.relevant(**given))


def _motions() -> Iterator[Target]:
    rtol = real((1e-6, 1e-2), 0.0, 1.0)
    common = {
        "duration": real((0.05, 0.2), 0.0, 1e300),
        "samples": optional(count(2, 9, 10**30)),
        "times": Kind(
            one_of(None), _not(None, array(3, (0.0, 0.01), (-1.0, 1e9), any_size=True).bad)
        ),
        "rtol": rtol,
        "atol": optional(real((1e-8, 1e-4), 0.0, 2.0)),
        "method": word("auto", "dop853", "radau", *SCIPYS),
        "most": Kind(any_of(real((1e6, 1e9)).good, one_of(1, 30.0)), real((1, 2), 0.0, 1e19).bad),
        "progress": FLAG,
    }
    for name, model in MODELS.items():
        n = model.integrated
        held = model.dof != n  # few states meet supports, and small changes, (dof,), are taken too
        rows, rates = start(n, held), array(n, (-0.1, 0.1), (1e7,), any_size=held)
        if held:
            rows = Kind(one_of(bend, np.zeros(n)), any_of(rows.bad, listed(np.zeros(n + 1))))
            rates = Kind(one_of(np.zeros(n), [0.0] * n), rates.bad)
        rates = optional(rates)
        yield target(
            lambda m=model, **given: pp.simulate(m, **_without_none(given, "times")),
            f"simulate[{name}]",
            called={"q0": "q0|angle"},
            **common,
            u=SLOW,
            q0=optional(rows),
            qdot0=rates,
        )
    yield target(
        lambda model: pp.simulate(model, 1.0, 0.1, bend, samples=3), "simulate", model=MOVING
    )
    watched = {
        "method": word("dop853", "radau"),
        "t0": real((-3.0, 3.0), -1e10, 1e10),
        "events": Kind(
            one_of((), lambda t, q, qdot: q[0], [pp.Event(lambda t, q, qdot: qdot[-1], -1)]),
            any_of(NONE, *WORDS, one_of(3, NAN, object(), [None], pp.Event(3), lambda t, q, v: q)),
        ),
        "dense": FLAG,
        "callback": Kind(one_of(None, lambda t, q, qdot: None), any_of(*WORDS, listed(3, [], NAN))),
        "max_step": Kind(real((0.1, 1.0)).good, listed(0.0, -1.0, NAN, "long")),
    }
    short = partial(pp.simulate, CHAIN, 1.0, 0.1, bend, samples=3)
    yield target(short, "simulate[watched]", **watched)
    in_si = {name: common[name] for name in ("duration", "times", "samples")} | {"u": SLOW}
    in_si |= {name: watched[name] for name in ("t0", "max_step")} | {"units": word("si")}
    yield target(
        lambda **given: pp.simulate(pp.Chain(HOSE, 3), q0=bend, **_without_none(given, "times")),
        "simulate[si]",
        **in_si,
    )
    still = partial(pp.simulate, pp.Chain(HOSE, 3), duration=0.1, q0=bend, samples=3, units="si")
    yield target(still, "simulate[si, driven]", u=FLOWS, base=SHAKERS, force=FORCES_IN_SI)
    for tag, model in (("chain", CHAIN), ("supported", pp.Galerkin(HINGED, 3))):
        driven = partial(pp.simulate, model, duration=0.1, q0=bend, samples=3)
        yield target(driven, f"simulate[{tag}, driven]", u=FLOWS, base=SHAKERS, force=FORCES)
    driven = partial(pp.simulate, SPACE, duration=0.1, samples=3)
    in_space = {"base": SHAKERS_IN_SPACE, "force": FORCES_IN_SPACE}
    yield target(driven, "simulate[space, driven]", u=FLOWS, **in_space)
    speeds = array(2, (0.0, 3.0), (-1.0, 1e9), any_size=True)
    yield target(
        lambda **given: pp.simulate_many(
            given.pop("models"), given.pop("speeds"), **_without_none(given, "times")
        ),
        "simulate_many",
        called={"q0": "q0|angle", "speeds": "speeds|models"},
        **common,
        models=Kind(one_of(CHAIN, [CHAIN, CHAIN]), any_of(MOVING.bad, one_of([], [EXACT], [3]))),
        speeds=speeds,
        executor=EXECUTOR,
        q0=optional(
            Kind(start(3).good, any_of(FUNCTION.bad, one_of([[0.1]], [NAN] * 3, [[0.1, NAN, 0.0]])))
        ),
    )
    many = one_of([PUMP, 1.0, lambda t: 1.0 + t], (PUMP, PUMP), [(lambda t: 1.0, lambda t: 0.0)])
    few = one_of([PUMP, -1.0], [None], [lambda t: NAN], [(PUMP,)], [[PUMP]], ["a"], [], 1j)
    yield target(
        lambda **given: pp.simulate_many(CHAIN, duration=0.1, q0=bend, samples=3, **given),
        "simulate_many[driven]",
        called={"speeds": r"speeds|\bu\b"},
        speeds=Kind(many, few),
        base=SHAKERS,
        force=FORCES,
    )
    state = Kind(one_of(None), any_of(*NOTHINGS, *WORDS, one_of([0.1], [NAN] * 3, PIPE, EXACT)))
    flutter = Kind(one_of(FLUTTER), MOVING.bad)
    beyond = Kind(one_of(SPEED), real((1.0, 2.0), -1.0, 1e9).bad)
    yield target(
        pp.limit_cycle,
        slow=True,
        model=flutter,
        u=beyond,
        start=state,
        rtol=real((1e-6, 1e-3), 0.0, 1.0),
        samples=count(9, 33, 100_001),
    )
    onset = {"crossing": optional(of(CROSSING)), "friction": optional(real((0.5, 9.0), 0.0))}
    yield target(pp.hopf, slow=True, model=flutter, **onset)
    space, sagging = SPACE, pp.Chain(SAGGING, 3, dimensions=3)
    whirling = Kind(one_of(space), any_of(MOVING.bad, one_of(FLUTTER, EVERY["uneven space"])))
    yield target(pp.rotating_motion, slow=True, model=whirling, u=beyond)
    yield target(space.bent, angle=FUNCTION, across=optional(FUNCTION))
    yield target(space.turned, y=array(12, any_size=True), angle=NUMBER)
    circles = pp.bifurcation_diagram(space, [SPEED, 1.01 * SPEED], cycles=1).rotating[0]
    yield target(circles.at, u=real((1.0, 2.0), -1.0))
    reduced = pp.Galerkin(PIPE, 2, dimensions=3)
    yield target(reduced.bent, angle=FUNCTION, across=optional(FUNCTION))
    yield target(reduced.turned, y=array(8, any_size=True), angle=NUMBER)
    lossy = {"model": Kind(one_of(OVERHANG), one_of(LOST, EXACT, 3, NAN, None))}
    refused = {"model": "model|hysteresis"}
    yield target(pp.hopf, "[supported]", slow=True, called=refused, **lossy)
    given = {**lossy, "u": Kind(one_of(1.02 * OVERHANG_SPEED), SLOW.bad)}
    yield target(pp.limit_cycle, "[supported]", slow=True, called=refused, **given)
    yield target(
        pp.equilibria,
        slow=True,
        model=Kind(any_of(MOVING.good, one_of(pp.Chain(JET, 3), space, sagging)), MOVING.bad),
        u=SLOW,
        starts=Kind(one_of(()), any_of(NONE, *WORDS, one_of(3, {}, [[NAN]], [3], [None], ["a"]))),
    )
    pair = array(2, (0.0, 3.0), (-1.0, 1e9), fair=one_of((0.5, 1.5), [0.0, 2.0]))
    yield target(
        pp.equilibrium_branch,
        slow=True,
        called={"q0": "q0|angle"},
        model=Kind(one_of(FLUTTER, pp.Chain(JET, 3), space, sagging), flutter.bad),
        q0=Kind(one_of(bend), start(3).bad),
        u0=Kind(one_of(1.0), SLOW.bad),
        speeds=pair,
        step=real((0.1, 1.0), 0.0, 2.0),
    )
    yield target(
        pp.lyapunov_exponent,
        slow=True,
        model=MOVING,
        u=SLOW,
        start=state,
        duration=real((0.5, 1.0), 0.0, 1e300),
        transient=real((0.0, 0.5), -1.0, 1e300),
        blocks=count(4, 6, 10_001),
        interval=real((0.1, 0.5), 0.0, 1e300),
    )
    diagram = {
        "model": flutter,
        "speeds": array(2, (0.1, 1.0), (-1.0, 1e9), rising=True),
        "cycles": count(0, 0, 10_001),
        "brute_force": count(0, 1, 10_001),
        "transient": real((0.0, 1.0), -1.0, 1e300),
        "duration": real((1.0, 2.0), 0.0, 1e300),
        "rtol": real((1e-6, 1e-3), 0.0, 1.0),
        "seed": either([0, 7], -1, 0.5, NAN),
    }
    own = any_of(array((2, 3), (-0.1, 0.1)).good, array((2, 6), (-0.1, 0.1)).good)
    own = any_of(count(1, 3).good, own, one_of(PLANE))
    yield target(
        pp.attractors,
        slow=True,
        called={"starts": "starts|angle"},
        model=flutter,
        u=Kind(one_of(1.0, 2.0), SLOW.bad),
        starts=Kind(own, any_of(array((2, 6), (-0.1, 0.1), (1e7,)).bad, listed(0, -1, 2.5))),
        base=Kind(one_of(None), any_of(*NOTHINGS, *WORDS, one_of(3, NAN, [], PUMP))),
        force=Kind(one_of(None, PUSH), NO_FORCE),
        transient=real((10.0, 20.0), -1.0, 1e300),
        duration=real((1.0, 2.0), 0.0, 1e300),
        rtol=real((1e-6, 1e-4), 0.0, 1.0),
        seed=diagram["seed"],
    )
    wrong = any_of(NONE, *WORDS, listed(3, (0,), (0, 0), (-1, 2)))
    yield target(
        pp.StartPlane,
        x=array(2, (-1.0, 1.0), rising=True, any_size=True),
        y=array(3, (-1.0, 1.0), rising=True, any_size=True),
        indices=Kind(one_of((0, 1), (1, 5), [0, 3]), wrong),
        state=optional(array(6, (-0.1, 0.1), any_size=True)),
    )
    yield target(pp.bifurcation_diagram, slow=True, **diagram)
    in_space = {"model": Kind(one_of(space, sagging), flutter.bad)}
    yield target(pp.bifurcation_diagram, "[space]", slow=True, **diagram | in_space)
    yield target(
        pp.attractors,
        "[space]",
        slow=True,
        **in_space,
        u=Kind(one_of(1.0, 2.0), SLOW.bad),
        starts=Kind(count(1, 3).good, one_of(0, -1, 2.5, [[0.1] * 5])),
        base=Kind(one_of(None, SHAKER, ASTIR, pp.Harmonic(0.01, 25.0, "z")), one_of(3, PUMP)),
        transient=real((10.0, 20.0), -1.0, 1e300),
        duration=real((1.0, 2.0), 0.0, 1e300),
    )
    wrong = any_of(NONE, *NOTHINGS, *WORDS, one_of(3, NAN, {}, []))
    other = (
        {"beta": (0.1, 0.05), "u": (3.0, 3.3)},
        {"u": (3.0, 3.3)},
        NEAR_FOLD | {"u": (0.0, 1.0)},
    )
    yield target(
        pp.cycle_boundary,
        slow=True,
        branch=Kind(one_of(FOLDED), any_of(wrong, one_of(BRANCH, DIAGRAM))),
        events=Kind(one_of(FOLD, [FOLD]), any_of(wrong, one_of(FOLDED.events[0]))),
        x=Kind(one_of("beta"), any_of(wrong, one_of("u", "hysteresis"))),
        y=Kind(one_of("u"), any_of(wrong, one_of("beta", "frequency"))),
        ranges=Kind(one_of(NEAR_FOLD), any_of(wrong, one_of(*other))),
    )


def _without_none(given: dict[str, Any], name: str) -> dict[str, Any]:
    """Of samples and times the one that is there."""
    if given[name] is not None:
        given.pop("samples")
    return given


def any_trade(dice: Random) -> pp.Trade:
    """Rows as a measurement may leave them: errors of any size, equal, none, infinite, failed."""
    rows = []
    for family in dice.sample(
        ("beam", "legendre", "midpoint", "rayleigh pair"), dice.randint(1, 3)
    ):
        sizes = sorted(dice.sample(range(1, 65), dice.randint(1, 9)))
        slope, last = dice.choice((0.0, 1.0, 4.0, 30.0)), dice.choice((0.0, 1e-16, 1e-3, 0.9))
        for size in sizes:
            error = dice.choice((1.0, 1.0, 0.9)) * (float(size) ** -slope + last)
            error = dice.choice([max(error, 1e-17)] * 12 + [INF, 1e6])
            failure = ValueError("too small") if dice.random() < 0.1 else None
            if failure is not None:
                rows.append(pp.TradeRow(family, size, size, NAN, False, NAN, NAN, 0, 0, failure))
                continue
            seconds = dice.choice((1e-9, 1e-3, 1e-3, 20.0))
            counts = dice.randint(0, 9), dice.randint(0, 9)
            resolved = dice.random() < 0.8
            rows.append(pp.TradeRow(family, size, size, error, resolved, seconds, 0.0, *counts))
    return dataclasses.replace(TRADE, rows=tuple(rows))


def _front(found: pp.Trade, cost: str) -> list[Any]:
    """Costs and errors of the front; NaN where it does not rise and fall."""
    front = [(getattr(row, cost), row.error) for row in found.pareto(cost)]
    rises = all(a < c and b > d for (a, b), (c, d) in pairwise(front))
    return front if rises else [NAN]


def _any_model(dice: Random) -> Any:
    """Some pipe's, with roots that meet, vanish or cluster among them."""
    beta, gamma = dice.choice((0.0, 1e-12, 0.5, 0.999999)), dice.choice((-1e4, -7.837, 0.0, 1e6))
    flow, damping = dice.choice(("ejecting", "aspirating")), dice.choice((0.0, 1e-12, 0.01, 1e3))
    pipe = pp.Pipe(beta, gamma, flow, dice.choice((0.0, 1.0)), damping=damping)
    made: Any = dice.choice((pp.Chain, pp.Galerkin, lambda p, m: pp.Galerkin(p, m, "legendre")))
    return made(pipe, dice.randint(1, 6))


def _any_modes(dice: Random) -> Any:
    return pp.modes(_any_model(dice), dice.choice((0.0, 1e-9, 5.0, 1e4)))


def _any_loci(dice: Random) -> Any:
    return pp.root_loci(_any_model(dice), sorted(dice.sample((0.0, 1e-9, 2.0, 30.0), 2)), 1)


def _uncertain(found: Any) -> Any:
    """Errors of what was found to be roots; those of roots that meet are infinite."""
    errors = np.minimum(found.errors[found.converged], 1e300)
    return np.where(errors >= 0.0, errors, NAN)


def _results() -> Iterator[Target]:
    at = Kind(one_of(SPEED, CYCLE.u), real((1.0, 2.0), -1.0).bad)
    yield target(DIAGRAM.at, u=at)
    yield target(BRANCH.at, u=at)
    event = BRANCH.events[0]
    yield target(event.same, other=of(event))
    yield target(TRADE.of, family=word("beam"))
    costs = word("seconds", "dof", "right_hand_sides", "factorisations")
    yield target(TRADE.pareto, cost=costs)
    rows = {"found": Kind(any_trade, None)}
    yield target(_front, "Trade.pareto[rows]", **rows, cost=costs)
    yield target(lambda found: _laws(found), "Trade.orders[rows]", **rows)
    yield target(lambda found: (str(found), found._repr_html_()), "Trade.__str__[rows]", **rows)
    yield target(lambda found: found.to_csv(), "Trade.to_csv[rows]", **rows)
    yield target(_uncertain, "Modes.errors", found=Kind(any_of(_any_modes, one_of(MODES)), None))
    yield target(_uncertain, "RootLoci.errors", found=Kind(any_of(_any_loci, one_of(LOCI)), None))
    path = Kind(one_of(None), one_of(3, 2.5, [], {}, NAN, True))
    yield target(TRADE.to_csv, path=path)
    yield target(HOPF.amplitude, u=at)
    yield target(HOPF.cycle_frequency, u=at)


def _kept() -> Iterator[Target]:
    """Files, and numbers from measurements."""
    kept, bad = one_of(KEPT, str(KEPT)), any_of(NONE, *NOTHINGS, one_of("x.json", 3))
    path = Kind(kept, any_of(bad, one_of("/nowhere/x.npz")))
    things = Kind(one_of(CHAIN, PIPE, CRITICAL, CYCLE, SCENE), None)
    yield target(lambda thing, path: thing.save(path), "Saved.save", thing=things, path=path)
    found = (MODES, LOCI, MOTION, ENSEMBLE, DIAGRAM, TRADE, ENDS, BOUNDARY, RESPONSE, SHAKES)
    table = {"table": Kind(one_of(*found), None), "units": word("nondimensional")}
    yield target(lambda table, units: table.columns(units), "TableResult.columns", **table)
    table["units"] = word("si", "nondimensional")
    table["table"] = Kind(one_of(pp.modes(pp.Chain(MEASURED, 3), 1.0)), None)
    yield target(lambda table, units: table.to_csv(units=units), "TableResult.to_csv", **table)
    yield target(
        lambda table, units: table.to_dataframe(units), "TableResult.to_dataframe", **table
    )
    known = {"found": Kind(one_of(CRITICAL, CYCLE, LOCI, BOUNDARY), None)}
    known["pipe"] = Kind(one_of(MEASURED), one_of(PIPE, 3, "pipe", CHAIN))
    yield target(lambda found, pipe: repr(found.in_si(pipe)), "Result.in_si", **known)
    heard = pp.identify(MEASURED, [pp.Measurement("frequency", 1.0, 0.1)], ["bending_stiffness"])
    yield target(heard.in_si, pipe=Kind(one_of(MEASURED, None), any_of(known["pipe"].bad)))
    yield target(pp.load, path=Kind(kept, bad))
    size, most = real((0.1, 5.0), -1.0, 1e300), real((0.1, 5.0), 0.0, 1e300)
    words = ("frequency", "decay_rate", "decrement", "critical_speed", "critical_frequency")
    yield target(
        lambda **given: pp.Measurement(**given),
        "Measurement",
        quantity=Kind(one_of(*words[:3]), any_of(NONE, *NOTHINGS, one_of("speed", 3))),
        value=Kind(size.good, one_of(NAN, "1", 1e300)),
        uncertainty=most,
        speed=real((0.0, 3.0), -0.1, 1e300),
        mode=count(1, 3, 21),
        across=FLAG,
    )
    measured = [pp.Measurement("frequency", 3.5, 0.1), pp.Measurement("decrement", 0.2, 0.05)]
    names = one_of(["damping"], ("damping",), {"damping": (1e-4, 1.0)})
    wrong = listed([], ["damping", "damping"], ["x"], {"damping": (1.0, 0.0)}, {"damping": 3}, "x")
    yield target(
        pp.identify,
        slow=True,
        pipe=either([PIPE], CHAIN, 3),
        measurements=Kind(one_of(measured, tuple(measured)), listed([], None, [3], 3)),
        unknowns=Kind(names, any_of(NONE, *NOTHINGS, wrong)),
        dimensions=either([2, 3], 0, 1, 4, NAN, 2.5, [3]),
        progress=FLAG,
    )


def _driven() -> Iterator[Target]:
    frequency = real((20.0, 40.0), 0.0, 1e300)
    yield target(
        pp.RootSpring,
        stiffness=real((0.0, 9.0), -0.1),
        stiffness_across=optional(real((0.0, 9.0), -0.1)),
    )
    yield target(pp.Pulsation, mean=U, amplitude=real((-1.0, 1.0), -1.1, 1.1), frequency=frequency)
    size = real((-0.1, 0.1))
    given = any_of(NONE, *NOTHINGS, *WORDS, *LOGICAL, one_of(3, (1.0, 2.0), (0, 0, 0), (NAN, 1, 1)))
    direction = Kind(one_of("x", "y", "z", (1, 0, -1j), [0.5, 2.0, 1.0]), sure(given, "out", 3))
    yield target(pp.Harmonic, amplitude=size, frequency=frequency, direction=direction)
    positive = real((0.1, 3.0), 0.0, 1e300)
    si = {"pipe": of(MEASURED), "frequency": positive}
    yield target(pp.Pulsation.from_si, **si, mean=real((0.0, 3.0), -0.1, 1e300), amplitude=size)
    yield target(pp.Harmonic.from_si, **si, amplitude=size)
    no_function = any_of(*WORDS, *LOGICAL, *NOT_FINITE, listed(1.0, [], PUSH))
    own = {"function": Kind(WAVES, no_function), "amplitude": real((-1.0, 1.0), -1e10, 1e10)}
    at = optional(real((0.1, 1.0), 0.0, 1.5))
    yield target(pp.Force, **own, at=at, frequency=frequency)
    yield target(pp.Force.from_si, **si, **own, at=at)
    supply = {"friction": real((0.5, 9.0), 0.0), "weight": optional(real((-1.0, 1.0)))}
    supply["start"] = optional(SLOW)
    yield target(pp.Supply, head=real((5.0, 50.0)), **supply)
    at_speed = {"pipe": of(PIPE, DRAGGED), "u": real((0.5, 9.0), 0.0, 1e5), **supply}
    yield target(pp.Supply.at_speed, **at_speed)
    dense = {"pressure": real((1e3, 1e5)), "density": real((500.0, 1500.0), 0.0)}
    dense |= {"pipe": of(MEASURED), "friction": supply["friction"], "start": optional(SLOW)}
    yield target(pp.Supply.from_si, **dense)
    yield target(pp.Supply(20.0, 2.0).speed, pipe=of(PIPE, DRAGGED))
    bent = pp.Chain(JET, 3)
    unsuitable = any_of(of(CHAIN, LEGENDRE, SCENE, EXACT).bad, one_of(LOST))
    lossless = Kind(
        one_of(CHAIN, LEGENDRE, SCENE, SPANNED, SUPPORTED), any_of(unsuitable, one_of(bent))
    )
    refused = {"model": "model|hysteresis"}
    given = {"model": lossless, "pulsation": of(PUMP)}
    yield target(pp.floquet, called=refused, **given)
    frequencies = Kind(
        one_of((20.0, 30.0)),
        any_of(*NOTHINGS, *WORDS, one_of(3, NAN, (2.0, 1.0), (0.0, 1.0), (1.0,), (NAN, 1.0))),
    )
    yield target(
        pp.parametric_regions,
        called={"model": "model|mean|hysteresis"},  # some are unstable there
        slow=True,
        model=Kind(one_of(SHAKEN, SPANNED), lossless.bad),
        mean=real((1.0, 2.0), 0.0, 1e9),
        amplitudes=array(2, (0.1, 0.3), (-0.1, 1.0), rising=True, any_size=True),
        frequencies=frequencies,
        progress=FLAG,
    )
    place = Kind(
        one_of("tip", 1.0, 0.5), any_of(NONE, *NOTHINGS, *LOGICAL, one_of("root", NAN, -0.1, 1.1))
    )
    yield target(
        pp.frequency_response,
        model=of(CHAIN, LEGENDRE, SCENE, EXACT, HINGES, LOST, *ENDLESS),
        u=real((0.0, 2.0), -0.1, 1e300),
        frequencies=optional(array(3, (1.0, 20.0), (-1.0,), any_size=True)),
        input=Kind(
            one_of("base", ("force", 0.5), ("moment", 1.0)),
            any_of(NONE, *NOTHINGS, one_of("force", ("force",), ("force", 2.0), ("shear", 1))),
        ),
        output=place,
        direction=word("x"),
        tolerance=real((1e-3, 1e-2), 0.0, 1.0),
    )
    leaning = pp.Chain(pp.Pipe(0.2, 3.0, damping=0.05, inclination=0.5), 3, dimensions=3)
    yield target(
        partial(pp.frequency_response, frequencies=[1.0, 9.0]),
        "frequency_response[space]",
        model=of(SPACE, leaning),
        u=real((0.0, 2.0), -0.1, 1e300),
        direction=word("x", "y", "z"),
    )
    yield target(
        pp.forced_response,
        slow=True,
        called=refused,
        model=Kind(one_of(SHAKEN, HINGES, bent), unsuitable),
        u=real((1.0, 2.0), -0.1, 1e300),
        base=of(SHAKER),
        frequencies=frequencies,
    )
    yield target(
        pp.forced_response,
        "[space]",
        slow=True,
        called=refused,
        model=Kind(one_of(pp.Chain(SHAKEN.pipe, 2, dimensions=3)), unsuitable),
        u=real((1.0, 2.0), -0.1, 1e300),
        base=Kind(one_of(SHAKER, ASTIR, pp.Harmonic(0.01, 25.0, "z")), of(SHAKER).bad),
        frequencies=frequencies,
    )
    never = listed(pp.Force(lambda t: 1.0, 1.0), pp.Force(None, 0.7, 25.0, 0.0), [PUSH])
    yield target(
        pp.forced_response,
        "[force]",
        slow=True,
        called={"force": "force|base", **refused},
        model=Kind(one_of(SHAKEN, bent), unsuitable),
        u=real((1.0, 2.0), -0.1, 1e300),
        force=Kind(one_of(PUSH), any_of(NO_FORCE, never)),
        frequencies=frequencies,
    )
    still = pp.Pulsation(2.0, 0.0, 25.0)
    yield target(
        pp.forced_response,
        "[flow]",
        slow=True,
        called={"u": r"\bu\b|base", **refused},
        model=Kind(one_of(SHAKEN, SPANNED), lossless.bad),
        u=either([PUMP], SHAKER, still, 1.0),
        frequencies=frequencies,
    )
    inside = Kind(one_of(22.0, 25.0), real((20.0, 30.0), 0.0).bad)
    yield target(SHAKES.at, frequency=inside)
    yield target(SHAKES.branches[0].at, frequency=inside)


def _pictures() -> Iterator[Target]:
    loci = of(LOCI)
    top = optional(real((1.0, 9.0), -1.0))
    motion = of(MOTION)
    several = Kind(
        one_of(MOTION, [MOTION], ENSEMBLE, ENDS),
        any_of(*NOTHINGS, *WORDS, NONE, one_of(3, [], [3], PIPE)),
    )
    ends_or_motions = Kind(one_of(MOTION, [MOTION], ENSEMBLE), several.bad)
    start = optional(real((0.0, 1.0), above=1e9))
    span = Kind(
        one_of(None, (0.5, 1.5)),
        any_of(_not(None, array(2, (0.0, 1.0), (-9.0, 9.0)).bad), one_of((1.0, 1.0), (2.0, 1.0))),
    )
    place = Kind(
        one_of("tip", 0, 2), any_of(NONE, *NOTHINGS, *WORDS, *LOGICAL, one_of(3, -1, NAN, 1.0))
    )
    side = Kind(one_of("side"), any_of(NONE, *NOTHINGS, *WORDS, one_of("above", "space", 3)))
    cycles = Kind(one_of(CYCLE, BRANCH), any_of(*NOTHINGS, *WORDS, NONE, one_of(3, [], MOTION)))
    words = Kind(one_of("a", ""), any_of(NONE, *NOTHINGS, one_of(3, NAN, [])))

    def named(one: Any) -> Kind:
        return Kind(
            one_of({}, {"uniform": one}),
            any_of(NONE, *NOTHINGS[3:], *WORDS, listed(3, [], {1: one}, {"a": 3}, {"a": [3]}, one)),
        )

    calls: dict[str, dict[str, Kind]] = {
        "root_loci": {
            **{"loci": loci, "benchmark": optional(loci), "highest": top},
            "plane": word("lambda", "omega"),
        },
        "frequencies": {"loci": loci, "benchmark": optional(loci), "largest": top},
        "mode_shapes": {"modes": of(MODES), "count": count(1, 4, 1001)},
        "convergence": {"families": named([CRITICAL]), "exact": of(CRITICAL)},
        "stability_map": {
            "boundaries": named(BOUNDARY),
            "highest": top,
        },
        "boundary": {"found": of(BOUNDARY)},
        "dot_stride": {"loci": loci},
        "notice": {"text": words},
        "colour_bar": {
            "label": words,
            "ax": Kind(one_of(AXES), any_of(*NOTHINGS, one_of([AX], np.ones(2), AXES[:0]))),
        },
        "style": {"column": optional(word("single"))},
        "time_history": {"motions": several, "start": start},
        "phase_portrait": {"motions": several, "coordinate": place, "start": start},
        "snapshots": {"motion": motion, "span": span, "count": count(2, 5, 10_001), "view": side},
        "animate": {
            "motion": motion,
            "path": Kind(
                one_of(None), any_of(*NOTHINGS, *WORDS, one_of(3, "/nowhere/a.gif", "a.txt"))
            ),
            "fps": real((1.0, 2.0), 0.0, 1e3),
            "speed": optional(real((0.1, 0.4), 0.0)),
            "ax": AXIS,
            "span": span,
            "view": side,
        },
        "bifurcation_diagram": {"diagram": of(DIAGRAM), "coordinate": place},
        "basins": {"found": of(ENDS)},
        "poincare_section": {"found": ends_or_motions, "coordinate": place, "start": start},
        "spectrum": {"found": ends_or_motions, "segments": count(1, 9, 10_001), "start": start},
        "cycle_boundary": {"found": of(FOLDS)},
        "trade": {
            "found": Kind(any_of(of(TRADE).good, any_trade), of(TRADE).bad),
            "cost": word("seconds", "dof", "right_hand_sides", "factorisations"),
        },
        "multipliers": {"cycles": cycles},
        "frequency_response": {"response": of(RESPONSE)},
        "forced_response": {"response": of(SHAKES)},
        "parametric_regions": {"regions": either([REGIONS], 3, [3], PIPE)},
    }
    knob = plot.Exploration(PIPE, 3)
    moved = Kind(real((0.1, 0.9), 0.0).good, None)  # the message names the slider
    yield target(knob.set, name=word("beta", "gamma"), value=moved)
    explored = {"pipe": of(PIPE), "n": count(1, 4, 1001), "against": word("beta", "gamma")}
    explored["units"] = word("nondimensional")
    yield target(plot.Exploration, "plot.explore", **explored)  # without its widgets
    ends = {"found": of(ENDS), "fps": real((4.0, 5.0), 0.0, 1e3), "view": side}
    yield target(_films, "plot.films", slow=True, **ends)
    yield target(
        _filmed,
        "plot.animate",
        slow=True,
        called={"motion": "motion|speed"},  # of a cycle, too few frames are shown at these speeds
        **calls.pop("animate"),
    )
    for name, kinds in calls.items():
        yield target(getattr(plot, name), f"plot.{name}", slow=bool(kinds), **kinds)
    for name in ("poincare_section", "spectrum"):
        found = Kind(of(ENDS).good, several.bad)
        yield target(getattr(plot, name), f"plot.{name}[attractors]", slow=True, found=found)


def _filmed(**given: Any) -> str:
    """A film that nobody looks at is warned of."""
    film: str = plot.animate(**given).to_jshtml()
    return film


def _films(**given: Any) -> list[str]:
    """The same of each attractor."""
    return [film.to_jshtml() for film in plot.films(**given).values()]


TARGETS: tuple[Target, ...] = tuple(
    target
    for group in (
        _pipes,
        _chains,
        _models,
        _loaded,
        _scenes,
        _questions,
        _own_equations,
        _comparisons,
        _motions,
        _results,
        _kept,
        _driven,
        _pictures,
    )
    for target in group()
)


# ------------------------------------------------------------------------------------ the cases


@dataclasses.dataclass(frozen=True)
class Finding:
    """A case that ended as it must not."""

    case: int
    target: str
    message: str


Case = tuple[int, Target, dict[str, Any], list[str]]
"""Its number, the call, its arguments and the names of those spoiled."""


class TooLong(BaseException):
    """Not an Exception: no handler of the package may take it for a failure of its own."""


def _too_long(*_: Any) -> None:
    raise TooLong


def case(seed: int, number: int) -> tuple[Target, dict[str, Any], list[str]]:
    """The call of one case, its arguments and the names of those spoiled."""
    dice = Random(f"{seed} {number}")
    target = dice.choice(TARGETS)
    names = [name for name, kind in target.kinds.items() if kind.bad is not None]
    most = min(len(names), dice.choice((1, 1, 1, 2) if target.slow else (0, 1, 1, 2)))
    if target.slow and dice.random() < 0.02:
        most = 0
    spoiled = dice.sample(names, most)
    arguments = {
        name: (kind.bad if name in spoiled else kind.good)(dice)
        for name, kind in target.kinds.items()
    }
    return target, arguments, spoiled


def outcome(target: Target, arguments: dict[str, Any], spoiled: list[str]) -> str | None:
    """What is wrong with how a case ends, None where nothing is."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        result = target.call(**arguments)
    except TooLong:
        return f"took more than {LONGEST:g} s"
    except (pp.PipedynError, ValueError, TypeError) as error:
        return _refusal(error, target, spoiled)
    except Exception as error:
        return f"raised {type(error).__name__}: {str(error)[:200]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    if spoiled:
        return f"accepted, and gave {_brief(result)}"
    where = not_finite(result)
    return where and f"gave a result that is not finite: {where}"


def _refusal(error: Exception, target: Target, spoiled: list[str]) -> str | None:
    message = str(error)
    if not spoiled:
        own = isinstance(error, pp.PipedynError)
        return None if own else f"refused good arguments: {type(error).__name__}: {message[:200]}"
    if isinstance(error, pp.PipedynError):
        return None
    if type(error) not in (ValueError, TypeError):
        return f"raised {type(error).__name__}: {message[:200]}"
    names = "|".join(target.called.get(name, rf"\b{name}\b") for name in spoiled)
    if not re.search(names, message):
        return f"refused without the argument's name: {message[:200]}"
    return None if len(message) < 400 and "\n" not in message else f"message too long: {message!r}"


UNKNOWN = {"onset", "residuals", "errors", "_continuous", "discretisation", "width", "edges"}
UNKNOWN |= {"threshold", "threshold_frequency", "lyapunov", "exponent"}
"""Fields that may be NaN or infinite."""


def not_finite(result: Any, path: str = "result", depth: int = 0) -> str | None:
    """The first place of a result where a number is not finite."""
    if isinstance(result, float | complex | np.number):
        return None if np.isfinite(result) else path
    if isinstance(result, np.ndarray) and result.dtype.kind in "fc":
        return None if np.isfinite(result).all() else path
    if isinstance(result, tuple | list) and depth < 6:
        found = (not_finite(one, f"{path}[{i}]", depth + 1) for i, one in enumerate(result))
        return next((place for place in found if place), None)
    if dataclasses.is_dataclass(result) and depth < 6:
        names = [f.name for f in dataclasses.fields(result) if f.name not in UNKNOWN]
        found = (not_finite(getattr(result, n), f"{path}.{n}", depth + 1) for n in names)
        return next((place for place in found if place), None)
    return None


def _brief(value: Any) -> str:
    try:
        text = " ".join(repr(value).split())
    except Exception:
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 120 else text[:117] + "..."


def random_cases(seed: int, first: int, count: int) -> Iterator[Case]:
    """So many cases from a number on."""
    return ((number, *case(seed, number)) for number in range(first, first + count))


def one_by_one(seed: int) -> Iterator[Case]:
    """Every argument of every call spoiled alone, the others good."""
    dice = Random(seed)
    for number, target in enumerate(TARGETS):
        for name in (name for name, kind in target.kinds.items() if kind.bad is not None):
            given = {
                k: (kind.bad if k == name else kind.good)(dice) for k, kind in target.kinds.items()
            }
            yield number, target, given, [name]


def _without_excuse(call: Callable[..., Any]) -> Callable[..., Any]:
    def asked(**given: Any) -> Any:
        try:
            return call(**given)
        except pp.PipedynError as error:
            raise RuntimeError(f"computed to {error!r}") from error

    return asked


def at_bounds(seed: int) -> Iterator[Case]:
    """Every argument of every call spoiled alone by each of its bounds.

    Errors of the package that a computation ends with do not pass for a refusal of these.
    """
    dice = Random(seed)
    for number, tried in enumerate(TARGETS):
        target = dataclasses.replace(tried, call=_without_excuse(tried.call))
        for name, kind in target.kinds.items():
            for value in bounds_of(kind.bad):
                given = {k: other.good(dice) for k, other in target.kinds.items()}
                yield number, target, given | {name: value}, [name]


def run(cases: Iterable[Case], beginning: Callable[[], None] = lambda: None) -> list[Finding]:
    """All findings of cases; `beginning` is called before each."""
    before = signal.signal(signal.SIGPROF, _too_long)
    findings = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for one in (pp.BranchesMissing, pp.UnusualPipe):  # of pipes that are allowed
                warnings.simplefilter("ignore", one)
            for number, target, arguments, spoiled in cases:
                beginning()
                if AX.has_data() or AX.texts:  # clearing takes longer than most calls
                    AX.clear()
                wrong = outcome(target, arguments, spoiled)
                if wrong:
                    given = ", ".join(f"{k}={_brief(arguments[k])}" for k in spoiled)
                    findings.append(Finding(number, f"{target.name}({given})", wrong))
    finally:
        signal.signal(signal.SIGPROF, before)
    return findings


def _watch() -> None:
    faulthandler.dump_traceback_later(HUNG, exit=True)


def main() -> int:
    """Prints every finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    findings = run(random_cases(asked.seed, asked.first, asked.cases), _watch)
    faulthandler.cancel_dump_traceback_later()
    for finding in findings:
        print(f"case {finding.case}: {finding.target}\n    {finding.message}")
    print(
        f"{asked.cases} cases of {len(TARGETS)} calls, seed {asked.seed}: {len(findings)} findings"
    )
    return bool(findings)


if __name__ == "__main__":
    sys.exit(main())
