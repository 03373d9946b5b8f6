# SPDX-License-Identifier: MIT
"""What chains answer misses the pipe's answer by an error of second order in a segment's length.

The pipe's answer is the continuous pipe's, that of a reduced model with many Legendre functions, or
numbers that are known otherwise.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk
from test_equilibria import STANDING, bent, elastica
from test_jet_angle import NUMBERS, rest_of
from test_nonuniform import TAPER, mass, stiffness
from test_terms import SPEED, TABLE

import pipedyn as pp
from pipedyn.modular import chain as scene


@dataclass(frozen=True)
class Row:
    """A question, (model) -> numbers, about a pipe, and how chains' answers tend to the pipe's."""

    ask: Callable  # each number of (k,) must tend for itself, of what has more dimensions the whole
    pipe: pp.Pipe
    sizes: tuple[int, ...] = (10, 20, 40)
    error: float = 1e-3  # largest of the longest chain, relative
    order: float = 0.1  # how far it may be from 2
    to: Any = pp.Continuum  # what makes the model of the pipe's answer, or is this answer
    chain: Callable = pp.Chain
    without: pp.Pipe | None = None  # whose answer is far from that


PLACES = np.linspace(0.0, 1.0, 1601)


def functions(count):
    return lambda pipe: pp.Galerkin(pipe, count, "legendre")


def midpoint(pipe, n):
    return pp.Chain(pipe, n, springs="midpoint")


def onset(model):
    return [pp.critical_speed(model).speed]


def roots(u, count):
    """One of each pair."""

    def ask(model):
        found = pp.eigenvalues(model, u, 2 * count)
        return found[found.imag > 0.0]

    return ask


def multiplier(model):
    return pp.floquet(model, pp.Pulsation(6.0, 0.3, 30.0)).multipliers[:1]


def rest(u):
    return lambda model: model.tip(rest_of(model, u))[None]


def buckled(model):
    found = pp.equilibria(model, 1.0)
    return found.tips[bent(found), :1]


def response(omega, **asked):
    return lambda model: pp.frequency_response(model, 4.0, omega, **asked).response[None]


def peaks(model):
    found = pp.frequency_response(model, 4.0, (5.0, 60.0)).resonances
    return np.ravel([(peak.frequency, peak.height, peak.width) for peak in found])


def slope_under_a_force(model):
    force = model.deflection(np.eye(model.dof), [1.0])[0]
    q = np.linalg.solve(model.operators().stiffness, force)
    return model.deflection(q, PLACES, 1)[:, None]


def shaken(model):
    base = pp.Harmonic(0.05, 8.0)
    (motion,) = pp.forced_response(model, 5.0, base=base, frequencies=(8.0, 8.1)).at(8.0)
    return [motion.amplitude]


def hopf(model):
    found = pp.hopf(model)
    return np.array([found.speed, found.frequency, found.lyapunov])


def law_when_fed(model):
    return [pp.hopf(model, friction=1.5).amplitude_law]


def cycle(model):
    found = pp.limit_cycle(model, 6.0)
    assert found.stable
    return np.array([found.amplitude, found.frequency])


def at_the_root(model):
    return np.abs(pp.equilibria(model, 3.4).q[1, :1])


def angle_at_the_root():
    """Of the elastica whose thrust turns with its end: u^2 cos th = 4 K(sin(th / 2))^2."""
    return brentq(
        lambda th: 3.4**2 * np.cos(th) - 4.0 * ellipk(np.sin(0.5 * th) ** 2) ** 2, 0.1, 1.5
    )


def middle(model):
    """Of a pipe that buckles between fixed ends."""
    return np.abs(model.shape(pp.equilibria(model, 3.3).q[1], [0.5])[:, 0])


def bow(s):
    """Bends no free end, whose moment would jump."""
    return 0.9 * np.sin(0.5 * np.pi * s)


def wave(s):
    return 0.6 * np.cos(np.pi * s)


def moved(u, angle, time, places=(1.0,), **driven):
    """Where a large motion has taken the pipe at two times."""

    def ask(model):
        motion = pp.simulate(model, u, time, angle, samples=3, rtol=1e-9, **driven)
        return np.array([model.shape(q, places) for q in motion.q[1:]])

    return ask


def flow_and_tip(model):
    """At constant head: how much faster the flow has become, and where the tip is."""
    supply, angle = pp.Supply(40.0, 2.5), lambda s: 0.6 * (1.0 - (1.0 - s) ** 3)
    motion = pp.simulate(model, supply, 0.25, angle, rtol=1e-8, times=[0.25])
    return np.append(motion.flow_speed - supply.speed(model.pipe), motion.tip)


def by_a_force(root, end):
    """Slope of a pipe at rest under a unit force across its end, EI = 1, at its places."""
    give = 0.0 if root == "clamped" else 1.0 / root.stiffness
    if end == "free":
        return give + PLACES - 0.5 * PLACES**2
    at_root = 0.5 / (1.0 + give)  # the moment there, as the slope at the end is 0
    return at_root * give + at_root * PLACES - 0.5 * PLACES**2


ANY, PLAIN = pp.Pipe(0.2), pp.Pipe(0.2, 3.0, damping=1e-2)
SPRUNG = pp.Pipe(0.2, terms=(pp.Spring(1.0, 50.0),))
TIPPED = pp.Pipe(0.0, terms=(pp.PointMass(1.0, 0.5),))
INSIDE = pp.Pipe(0.2, 10.0, terms=(pp.PointMass(0.613, 0.3), pp.Spring(0.351, 20.0)))
LOADS = pp.PointMass(0.6, 0.2), pp.Spring(0.8, 20.0), pp.Damper(1.0, 0.5), pp.Foundation(5.0)
FITTED = pp.Pipe(0.2, 5.0, damping=2e-3, terms=LOADS)
LOSSY = pp.Pipe(0.3, 5.0, damping=1e-3, hysteresis=0.07)
DRAWN = pp.Pipe(0.2, flow="aspirating", inflow_share=0.0, damping=0.005)
GIVING = pp.Pipe(0.3, 2.0, damping=5e-3, root=pp.RootSpring(3.0))
THICK = pp.Pipe(0.2, rotary_inertia=0.01)
FED, FLOWING = pp.Pipe(0.3, 2.0, damping=0.01), pp.Pipe(0.3, 7.0, damping=0.01)
TAPERED = pp.Pipe(0.3, 7.0, **TAPER)
MOVED = replace(TAPERED, damping=0.02)
PINNED = {"root": "pinned", "end": "pinned"}
SPANS = {"root": pp.RootSpring(3.0), "end": "clamped", "supports": [0.4]}
BETWEEN = pp.Pipe(0.3, terms=[pp.Stretching(400.0)], **PINNED)
TWO, SHORT, MIDDLE, LONG = (20, 40), (8, 16, 32), (16, 32, 64), (20, 40, 80)

ROWS = {
    "spring at the end": Row(onset, SPRUNG, error=1.1e-3, order=0.05),
    "mass at the end": Row(roots(0.0, 1), TIPPED),
    "mass at the end, midpoint": Row(roots(0.0, 1), TIPPED, chain=midpoint),
    "terms inside": Row(onset, INSIDE),
    "terms inside, midpoint": Row(onset, INSIDE, order=0.2, chain=midpoint),
    "onset with hysteresis": Row(onset, LOSSY, LONG),
    "roots with hysteresis": Row(roots(5.0, 2), LOSSY, LONG),
    "drawn in": Row(onset, DRAWN, SHORT),
    "thick": Row(onset, THICK, TWO, 1.3e-3, 0.03),
    "root spring": Row(roots(2.0, 1), GIVING),
    "steps": Row(onset, replace(TAPERED, stiffness=stiffness, mass=mass), MIDDLE),
    "resonances": Row(peaks, replace(ANY, gamma=5.0, damping=0.004), LONG, 1e-3, 0.03),
    "multipliers": Row(multiplier, pp.Pipe(0.2, 10.0), (16, 32), 0.02),
    "cycle": Row(cycle, ANY, (7, 12, 21), 0.03, 0.15, functions(12)),
    "law": Row(hopf, replace(THICK, damping=2e-3), TWO, 2e-3, to=functions(10)),
    "law, scene": Row(hopf, replace(THICK, damping=2e-3), TWO, 2e-3, to=functions(10), chain=scene),
    "law at constant head": Row(law_when_fed, pp.Pipe(0.3, 2.0), LONG, 5e-3, to=functions(10)),
    "fed": Row(flow_and_tip, FED, TWO, 0.03, to=functions(10)),
    "fed, scene": Row(flow_and_tip, FED, TWO, 0.03, to=functions(10), chain=scene),
    "shaken": Row(shaken, replace(ANY, damping=0.01), (6, 12, 24), 0.01, 0.2, functions(10)),
    "buckled between": Row(middle, BETWEEN, error=3e-3, to=functions(8)),
    "sliding elastica": Row(
        at_the_root, replace(ANY, **PINNED), error=2e-3, to=np.array([angle_at_the_root()])
    ),
    "on soil": Row(onset, pp.Pipe(0.3, terms=[pp.Foundation(300.0)], **PINNED)),
    "elastica": Row(buckled, STANDING, to=elastica(-10.0, 1.0)[:1]),
    "motion, tapered": Row(moved(3.0, bow, 0.4, (0.5, 1.0)), MOVED, SHORT, to=functions(8)),
    "motion, tapered and pinned": Row(
        moved(3.0, wave, 0.4, (0.5, 1.0)), replace(MOVED, **PINNED), SHORT, to=functions(8)
    ),
    "motion, thick": Row(
        *(moved(4.0, bow, 0.3), replace(PLAIN, rotary_inertia=0.05), TWO),
        to=functions(12),
        without=PLAIN,
    ),
}
for name, angle, held in (
    ("pinned", lambda s: 0.9 * np.cos(np.pi * s), PINNED),
    ("guided", lambda s: 0.9 * np.cos(0.5 * np.pi * s), {"root": "pinned", "end": "guided"}),
    ("clamped", lambda s: 0.9 * np.sin(2.0 * np.pi * s), {"end": "clamped"}),
    ("two spans", lambda s: 0.9 * np.cos(2.0 * np.pi * s), PINNED | {"supports": (0.5,)}),
    ("stretched", lambda s: 0.9 * np.cos(np.pi * s), PINNED | {"terms": [pp.Stretching(60.0)]}),
):
    one = pp.Pipe(0.3, 6.0, damping=0.01, **{"terms": [pp.AddedMass(0.3)]} | held)
    asked = moved(3.0, angle, 0.1)
    ROWS[f"motion, {name}"] = Row(asked, one, LONG, 1e-4, 0.05, functions(16))
for of, make in itertools.product(TAPER, (pp.Chain, midpoint)):
    one = pp.Pipe(0.3, 7.0, **{of: TAPER[of]})
    ROWS[f"{of}, {make.__name__}"] = Row(onset, one, MIDDLE, order=0.03, chain=make)
for held in (
    *({}, {"root": pp.RootSpring(3.0)}, PINNED, {"end": "guided"}),
    *({"end": "clamped", "supports": [0.5]}, SPANS | {"terms": [pp.AddedMass(0.4)]}),
):
    ROWS[f"tapered {held}"] = Row(roots(1.5, 1), replace(TAPERED, **held), (12, 24, 48), 3e-3)
for (speed, angle, alpha), (_, *end) in NUMBERS:
    jet = pp.Pipe(0.2, alpha=alpha, jet_angle=angle)
    ROWS[f"rest with a jet at {angle}"] = Row(rest(speed), jet, SHORT, 3e-3, to=np.array([end]))
for how, place in (
    *(("base", "tip"), ("base", 0.4)),
    *((("force", 0.7), 0.5), (("moment", 0.625), "tip")),  # also in the middle of a segment
):
    asked = response([1.0, 6.0, 20.0], input=how, output=place)
    ROWS[f"{how} to {place}"] = Row(asked, FITTED, (15, 45, 135), order=0.15)
for root, to, make in itertools.product(
    ("clamped", pp.RootSpring(2.0)), ("free", "guided"), (pp.Chain, scene)
):
    ROWS[f"slope, {root}, {to}, {make.__name__}"] = Row(
        *(slope_under_a_force, pp.Pipe(0.3, root=root, end=to), (5, 10, 20, 40)),
        error=2e-4 if to == "free" else 7e-4,
        to=by_a_force(root, to)[:, None],
        chain=make,
    )
for name, flow, base in (
    ("pulsating flow", pp.Pulsation(4.0, 0.5, 20.0), None),
    ("base across", 4.0, pp.Harmonic(0.2, 12.0)),
    ("base along", 4.0, pp.Harmonic(0.2, 12.0, "y")),
):
    asked = moved(flow, bow, 0.3, base=base)
    ROWS[f"motion, {name}"] = Row(asked, FLOWING, LONG, 1e-4, 0.05, functions(16))
for row in TABLE:
    terms, small, large = row.terms, SHORT, LONG
    turned = row.turns or isinstance(row.term, pp.FollowerForce)
    if turned:  # in the middle of a segment, whose angle is the tangent's there
        terms, small, large = [replace(row.term, at=0.5)], (5, 15, 45), (15, 45, 135)
    if row.place != 1.0:
        ROWS[f"onset, {row}"] = Row(onset, pp.Pipe(0.3, 7.0, terms=terms), small, 4e-3)
    if row.place not in (None, 1.0) and not turned:  # where segments end
        terms = [replace(row.term, at=0.6)]
    if not row.pipe.end_held:
        one = replace(row.pipe, terms=terms, **row.numbers)
        ROWS[f"motion, {row}"] = Row(
            moved(SPEED, bow, 0.15), one, large, 1e-4, 0.03, functions(16), without=row.pipe
        )


@pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")  # a uniform load makes it sag
@pytest.mark.parametrize("row", ROWS.values(), ids=ROWS)
def test_chains_tend_to_the_pipe_at_second_order(row):
    exact = np.asarray(row.ask(row.to(row.pipe)) if callable(row.to) else row.to)
    missed = np.array([np.abs(row.ask(row.chain(row.pipe, n)) - exact) for n in row.sizes])
    size = np.abs(exact)
    if exact.ndim > 1:
        missed, size = missed.reshape(len(row.sizes), -1).max(axis=1), size.max()
    orders = -np.diff(np.log(missed), axis=0).T / np.diff(np.log(row.sizes))
    assert np.abs(orders - 2.0).max() < row.order
    assert (missed[-1] < row.error * size).all()
    if row.without is not None:
        assert np.abs(row.ask(row.to(row.without)) - exact).max() > 50.0 * missed[-1]
