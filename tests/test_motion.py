# SPDX-License-Identifier: MIT
"""Motion of every model alike: batches, vector levels, threads, energy and arguments."""

import math
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from independent import any_chain, bent_state, derivative
from test_terms import LENGTHS, jacobian_by_differences, sizes_of, state_of

import pipedyn as pp

TERMS = (pp.Spring(0.6, 50.0), pp.PointMass(0.6, 0.1), pp.PointMass(1.0, 0.2), pp.Spring(1.0, 3.0))
LOADED = pp.Pipe(0.4, -3.0, drag=0.7, damping=0.01)
IN_FLUID = pp.Pipe(0.3, 4.0, drag=0.5, damping=0.01, terms=[pp.AddedMass(0.6), pp.Spring(0.7, 5.0)])
TAPERED = pp.Pipe(
    *(0.3, 7.0, "aspirating", 0.8),
    drag=0.4,
    damping=0.02,
    stiffness=lambda s: np.where(s < 0.37, 1.0 - s / 2, 0.5 + 0.3 * np.sin(3 * s)),
    mass=lambda s: np.where(s < 0.3, 1.0 + s, 0.8 + s**2),
)


def everything(n):
    return any_chain(n, gamma=4.0, drag=1.5, damping=0.01)


MODELS = {
    "chain": everything(5),
    "long chain": everything(12),
    "chain in a fluid": pp.Chain(IN_FLUID, 6),
    "tapered chain": pp.Chain(TAPERED, 4),
    "beam modes in a fluid": pp.Galerkin(IN_FLUID, 5),
    "Legendre functions in a fluid": pp.Galerkin(IN_FLUID, 5, "legendre"),
    "tapered, Legendre functions": pp.Galerkin(TAPERED, 7, "legendre"),
}
for basis in ("beam", "legendre"):
    for m in (1, 3, 5, 8, 9):
        MODELS[f"{m} {basis}"] = pp.Galerkin(LOADED, m, basis)
    for m in (3, 8):
        loaded = pp.Pipe(0.4, -3.0, drag=0.7, damping=0.01, terms=TERMS)
        MODELS[f"{m} {basis} with terms"] = pp.Galerkin(loaded, m, basis)
models = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
SMALL = {"chain": everything(3), "reduced": pp.Galerkin(pp.Pipe(0.2, 1.0, drag=0.3), 3)}
small = pytest.mark.parametrize("model", SMALL.values(), ids=SMALL)


def states(model, angles, seed=8):
    """Random states of a chain, of a reduced model with these largest angles, a column each."""
    rng = np.random.default_rng(seed)
    if isinstance(model, pp.Chain):
        return 2.0 * rng.normal(size=(2 * model.dof, len(angles)))
    return np.stack([bent_state(model, rng, angle) for angle in angles], axis=1)


# ------------------------------------------------------------------------ batches and threads


@models
def test_a_batch_is_its_members(model, each_level):
    """At every width, whatever the neighbours' amplitudes."""
    y = states(model, np.random.default_rng(8).choice([0.0, 0.1, 1.0, 3.0], 20))
    u = np.random.default_rng(9).uniform(0.0, 7.0, 20)
    u[::5] = 0.0
    rates = np.stack([model.rhs(0.0, y[:, k], u[k]) for k in range(20)], axis=1)
    energies = np.array([model.energy(y[:, k]) for k in range(20)])
    powers = [model.power(y[:, k], u[k]) for k in range(20)]
    for width in range(1, 21):
        some = y[:, :width], u[:width]
        missed = np.abs(model.rhs(0.0, *some) - rates[:, :width])
        assert (missed <= 1e-12 * np.abs(rates[:, :width]).max(axis=0)).all()
        np.testing.assert_allclose(model.energy(some[0]), energies[:width], rtol=1e-13)
        power = model.power(*some)
        for name in ("flow", "joints", "drag", "others", "total"):
            each = np.array([getattr(one, name) for one in powers[:width]])
            assert getattr(power, name).shape == (width,)
            close = 1e-12 * np.abs(each).max()
            np.testing.assert_allclose(getattr(power, name), each, rtol=0.0, atol=close)
    common = model.rhs(0.0, y, 3.0)
    np.testing.assert_array_equal(common, model.rhs(0.0, y, np.full(20, 3.0)))


@models
def test_jacobians_of_a_batch_are_those_of_its_members_at_every_level(model, levels, at_level):
    """Of angles from small ones to two turns, which take grids of several sizes."""
    y, u = states(model, np.repeat([0.3, 1.0, 2.0, 12.0], 5)[:19]), np.linspace(0.0, 6.0, 19)
    first = None
    for level in levels:
        at_level(level)
        found, rates = model.jacobian(0.0, y, u), model.rhs(0.0, y, u)
        for k in range(19):
            expected = model.jacobian(0.0, y[:, k], u[k])
            assert np.abs(found[k] - expected).max() < 1e-11 * np.abs(expected).max()
        parts = found[:15], rates[:, :15]
        first = first or parts
        for part, same in zip(parts, first, strict=True):
            assert np.abs(part - same).max() < 1e-12 * np.abs(same).max()


@small
def test_an_empty_batch_is_empty(model):
    none = np.zeros((6, 0))
    assert model.rhs(0.0, none, 1.0).shape == model.rhs(0.0, none, np.zeros(0)).shape == (6, 0)
    assert model.energy(none).shape == model.power(none, 1.0).total.shape == (0,)
    assert model.jacobian(0.0, none, 3.0).shape == (0, 6, 6)


@pytest.mark.parametrize("name", ["chain", "reduced"])
def test_one_model_serves_many_threads(name):
    def made():
        pipe = pp.Pipe(0.3, gamma=1.0, drag=0.5)
        return everything(60) if name == "chain" else pp.Galerkin(pipe, 6, "legendre")

    model, fresh = made(), made()
    batch = states(model, np.random.default_rng(9).uniform(0.0, 3.0, 64))

    def answers(asked, y):
        return (
            asked.rhs(0.0, y, 5.0),
            asked.jacobian(0.0, y, 5.0),
            asked.energy(y),
            asked.power(y, 5.0).total,
            asked.rhs(0.0, batch, 5.0),
        )

    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(partial(answers, fresh), batch.T))
    for y, found in zip(batch.T, together, strict=True):
        for one, other in zip(found, answers(model, y), strict=True):
            np.testing.assert_array_equal(one, other)


# ------------------------------------------------------------------------------ what acts


@models
def test_operators_of_the_straight_pipe_are_its_jacobian_and_drag_has_no_part_in_it(model):
    n = model.dof
    mass, damping, stiffness = model.operators().at(5.0)
    linear = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    found = model.jacobian(0.0, np.zeros(2 * n), 5.0)
    np.testing.assert_allclose(found[n:], linear, atol=1e-10 * np.abs(linear).max())
    np.testing.assert_array_equal(found[:n], np.eye(2 * n)[n:])
    straight = vars(model.operators(np.zeros(n)))
    for name in ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"):
        expected = getattr(model.operators(), name)
        close = 1e-13 * max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(straight[name], expected, atol=close)


@pytest.mark.parametrize(("flow", "alpha"), [("ejecting", 1.0), ("aspirating", 0.7)])
@pytest.mark.parametrize(
    "make",
    [lambda p: pp.Chain(p, 5), lambda p: pp.Galerkin(p, 4, "legendre")],
    ids=["chain", "Legendre functions"],
)
def test_flow_feeds_energy_only_through_the_free_end(make, flow, alpha):
    """-sqrt(beta) U |v|^2 - a U^2 t . v with v of the tip, by differences of its position."""
    model = make(pp.Pipe(0.25, gamma=2.0, flow=flow, alpha=alpha))
    y, u = states(model, [1.5])[:, 0], 4.0
    q, rate = np.split(y, 2)
    velocity = derivative(lambda t: model.tip(q + t * rate), 1e-3)
    angle = q[-1] if isinstance(model, pp.Chain) else model.functions(1.0, 1) @ q
    along = velocity @ [math.sin(angle), math.cos(angle)]
    expected = -model.pipe.direction * 0.5 * u * velocity @ velocity - alpha * u**2 * along
    assert model.power(y, u).flow == pytest.approx(expected, rel=1e-9)


SPEED = 3.0
DRIVE = {"u_dot": 2.3, "base": np.array([[0.3, -0.2], [0.7, 0.5], [-1.1, 1.9]])}
ALL = (
    *(pp.PointMass(0.37, 0.4, 0.03), pp.Spring(0.6, 50.0), pp.PointMass(1.0, 0.2)),
    *(pp.Damper(0.62, 1.5), pp.CubicSpring(0.8, 60.0), pp.Foundation(9.0), pp.Viscosity(1.3)),
    *(pp.AddedMass(0.6), pp.RotationalSpring(0.4, 6.0), pp.RotationalDamper(0.62, 0.4)),
)
RICH = pp.Pipe(0.3, 7.0, damping=0.02, terms=ALL)
THICK = pp.Pipe(0.3, 4.0, damping=0.01, rotary_inertia=0.05, terms=ALL[:3])
HELD = pp.Pipe(0.4, 5.0, damping=2e-3)
PIPES = {
    "drawn in": replace(RICH, flow="aspirating", alpha=0.8, inflow_share=0.4),
    "inclined jet": replace(RICH, alpha=0.8, jet_angle=0.9),
    "tapered": replace(TAPERED, terms=[pp.Spring(0.6, 9.0)]),
    "tapered in a fluid": replace(
        *(HELD,), mass=lambda s: 1.0 + 0.5 * s, terms=[pp.AddedMass(0.6)], jet_angle=0.3
    ),
    "thick": THICK,
    "thick and tapered": replace(THICK, stiffness=TAPERED.stiffness, mass=TAPERED.mass),
    "turning root": replace(HELD, root="pinned"),
    "guided": replace(HELD, root=pp.RootSpring(3.0), end="guided", jet_angle=0.4),
    "pinned twice": replace(HELD, root="pinned", end="pinned"),
    "clamped twice": replace(HELD, end="clamped", supports=[0.4]),
    "stretched": replace(
        *(HELD,), end="pinned", root=pp.RootSpring(3.0), terms=[pp.Stretching(50.0)]
    ),
    "supported twice": replace(HELD, root="pinned", supports=[0.3, 0.7]),
    "spans": replace(HELD, root=pp.RootSpring(2.0), end="clamped", supports=[0.5]),
    "loaded between": replace(HELD, end="clamped", root="pinned", terms=[*ALL[:1], *ALL[6:7]]),
}
KINDS = {
    "chain": lambda pipe: pp.Chain(pipe, 4),
    "unequal chain": lambda pipe: pp.Chain(pipe, lengths=LENGTHS, springs=[4.0, 3.0, 0.0, 5.0]),
    "beam modes": lambda pipe: pp.Galerkin(pipe, 4),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 8, "legendre"),
}
FREE = [name for name, pipe in PIPES.items() if pipe.end == "free" and not pipe.supports]
DRAWN_BY = [(name, kind) for kind in KINDS for name in (FREE if kind == "unequal chain" else PIPES)]


@pytest.mark.parametrize("drive", [{}, DRIVE], ids=["still", "driven"])
@pytest.mark.parametrize("drag", [0.0, 0.7])
@pytest.mark.parametrize(("name", "kind"), DRAWN_BY)
def test_energy_changes_by_the_power_and_the_jacobian_meets_differences(name, kind, drag, drive):
    """At large angles, with all that may act on a pipe; forces of supports do no work."""
    model = KINDS[kind](replace(PIPES[name], drag=drag))
    y = np.concatenate(state_of(model))
    rates = partial(model.rhs, 0.0, u=SPEED, **drive)
    way = rates(y)

    def energy(t):
        place, moving, turning = drive.get("base", np.zeros((3, 2)))
        base = np.array([place + t * moving + t**2 / 2 * turning, moving + t * turning, turning])
        return model.energy(y + t * way, base=base)

    power = model.power(y, SPEED, **drive)
    assert power.total == pytest.approx(derivative(energy, 1e-3), rel=2e-8)
    assert (power.base != 0.0) == bool(drive)
    assert (power.drag < 0.0) == bool(drag)
    exact, units = model.jacobian(0.0, y, SPEED, **drive), np.tile(sizes_of(model), 2)
    differences = jacobian_by_differences(rates, y, units, 1e-3)
    assert np.abs((exact - differences) * units).max() < 1e-9 * np.abs(exact * units).max()


@pytest.mark.parametrize(
    "model",
    [
        everything(3),
        pp.Galerkin(LOADED, 4),
        pp.Galerkin(replace(LOADED, terms=TERMS), 6, "legendre"),
    ],
    ids=repr,
)
def test_energy_of_small_motions_keeps_its_digits(model):
    y = 1e-9 * states(model, [1.0])[:, 0]
    q, rate = np.split(y, 2)
    ops = model.operators()
    expected = 0.5 * (rate @ ops.mass @ rate + q @ ops.stiffness @ q)
    assert model.energy(y) == pytest.approx(expected, rel=1e-12, abs=0.0)
    assert model.energy(0.0 * y) == 0.0


HUNG = pp.Pipe(0.3, 5.0, damping=1e-3, drag=0.3, terms=[pp.AddedMass(0.6)])
FITTED = pp.Pipe(0.2, 5.0, damping=0.002, terms=TERMS)
DRAWN = pp.Pipe(0.3, 5.0, "aspirating", 0.5, damping=0.002, inflow_share=0.4)
BENT = pp.Pipe(0.3, 5.0, damping=0.002, drag=0.3, jet_angle=0.6)


@pytest.mark.parametrize(
    "model",
    [
        pp.Chain(HUNG, 9),
        pp.Chain(replace(HUNG, root="pinned", supports=[0.6]), 10),
        pp.Galerkin(HUNG, 6, "legendre"),
        pp.Galerkin(replace(HUNG, root="pinned"), 6, "legendre"),
        pp.modular.chain(HUNG, 6).plus(pp.modular.Guide(4)),
        pp.Chain(FITTED, 10),
        pp.Galerkin(FITTED, 8),
        pp.Galerkin(replace(FITTED, drag=0.5), 8, "legendre"),
        pp.Chain(DRAWN, 6),
        pp.Galerkin(DRAWN, 4),
        pp.Chain(BENT, 6),
        pp.Galerkin(BENT, 4),
        pp.Chain(TAPERED, 6),
        pp.Galerkin(TAPERED, 5, "legendre"),
        pp.modular.chain(TAPERED, 4),
    ],
    ids=repr,
)
def test_motions_balance_their_energy_by_explicit_and_implicit_steps(model):
    """The implicit steps solve with the exact Jacobian, a chain's and a scene's in O(n)."""
    u = 2.0 if model.pipe.flow == "aspirating" else 7.0
    found = [
        pp.simulate(model, u, 1.0, lambda s: 0.8 * s**2, rtol=1e-10, method=method)
        for method in ("radau", "dop853")
    ]
    assert max(motion.audit for motion in found) < 1e-9
    ends = [motion.q[-1] for motion in found]
    np.testing.assert_allclose(*ends, atol=1e-8)


# ---------------------------------------------------------------------------------- arguments

GOOD = np.full(6, 0.1)
NAN = np.where(np.arange(6) == 3, np.nan, GOOD)
SHAPE = "y must have shape (6,) or (6, k), got "
REAL = "y must be an array of real numbers, got "


@pytest.mark.parametrize(
    ("y", "u", "error", "message"),
    [
        (GOOD[:5], 1.0, ValueError, SHAPE + "(5,)"),
        (0.5, 1.0, ValueError, SHAPE + "()"),
        (NAN, 1.0, ValueError, "y must be finite, got nan at index 3"),
        (NAN[:, None] * [1, 1], 1.0, ValueError, "y must be finite, got nan at index (3, 0)"),
        (GOOD + 0j, 1.0, TypeError, REAL + "array([0.1+0.j"),
        (np.ma.array(GOOD, mask=GOOD > 0), 1.0, ValueError, "y must not be masked, got 6 masked"),
        (GOOD, -1e-9, ValueError, "u must lie in [0, 1e+100], got -1e-09"),
        (GOOD, [1.0], ValueError, "u must be a number, got shape (1,)"),
        (GOOD, "1", TypeError, "u must be a real number, got '1'"),
        (GOOD[:, None], [1.0, 2.0], ValueError, "u must be a number or have shape (1,), got"),
        (GOOD[:, None] * [1, 1], [1, -2], ValueError, "[0, 1e+100], got -2.0 at index 1"),
        (GOOD[:, None], "u", TypeError, "u must be a real number or an array of them, got 'u'"),
    ],
)
@small
def test_bad_states_and_speeds_are_refused(model, y, u, error, message):
    for ask in (partial(model.rhs, 0.0), model.power, partial(model.jacobian, 0.0)):
        with pytest.raises(error, match=re.escape(message)):
            ask(y, u)
    if message.startswith("y must be"):
        with pytest.raises(error, match=re.escape(message)):
            model.energy(y)


@small
def test_operators_take_one_number_a_coordinate(model):
    with pytest.raises(ValueError, match="q must have 3 entries, got 4"):
        model.operators(np.zeros(4))
    with pytest.raises(ValueError, match=r"q must lie in \[-1e\+06, 1e\+06\], got nan at index 1"):
        model.operators([0.0, math.nan, 0.0])


def test_jacobians_of_very_long_chains_are_refused():
    with pytest.raises(ValueError, match="at most 4000 degrees of freedom, got 4001"):
        pp.Chain(pp.Pipe(0.2), 4001).jacobian(0.0, np.zeros(8002), 1.0)


@small
def test_numbers_of_any_real_type_and_layout_are_taken(model):
    whole = np.arange(12).reshape(6, 2) % 3
    expected = model.rhs(0.0, whole.astype(float), 2.0)
    same = [
        model.rhs(0, whole, 2),
        model.rhs(0.0, whole.tolist(), np.int64(2)),
        model.rhs(0.0, np.asfortranarray(whole, dtype=float), np.float32(2)),
        model.rhs(0.0, np.repeat(whole, 2, axis=1)[:, ::2], np.array(2.0)),
        model.rhs(0.0, whole.astype(np.float32), [2, 2]),
        model.rhs(0.0, whole.astype(object), 2.0),
        model.rhs(0.0, np.ma.array(whole), 2.0),
        model.rhs(0.0, whole.astype(">f8"), np.array([2.0, 9.0, 2.0])[::2]),
    ]
    for found in same:
        np.testing.assert_array_equal(found, expected)
    frozen = whole.astype(float)
    frozen.flags.writeable = False
    np.testing.assert_array_equal(model.rhs(None, frozen, 2.0), expected)
    one = model.rhs(0.0, list(GOOD), 2)
    np.testing.assert_array_equal(one, model.rhs(0.0, np.repeat(GOOD, 2)[::2], np.int32(2)))
    assert isinstance(model.energy(GOOD), float)
    assert isinstance(model.power(GOOD, 1.0).total, float)
