# SPDX-License-Identifier: MIT
"""Every term in every model: a law's row in the table below is all that its tests need.

So it is of numbers of the pipe that load its free end.

The route is independent of the models' own: virtual work at the places that `shape` draws, whose
derivatives are taken by differences.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
import redundant
from independent import derivative_along, leggauss, second_derivative_along
from numpy.polynomial import Polynomial

import pipedyn as pp


@dataclasses.dataclass(frozen=True)
class Row:
    """A term and its law as a textbook writes it, of the place (x, y) and its velocity (vx, vy).

    Load, mass, energy and power are those of the place, or per length; load and power read the
    tangent, t, as well. The couple is that at the angle theta of the pipe at the place, which turns
    at the rate omega, with its own energy and power.
    """

    term: pp.Term | None
    load: Callable = lambda x, y, vx, vy, t: (0.0, 0.0)
    mass: float = 0.0
    normal_mass: float = 0.0  # moves with the velocity across the pipe alone, without weight
    energy: Callable = lambda x, y: 0.0
    power: Callable = lambda x, y, vx, vy, t: 0.0
    inertia: float = 0.0
    couple: Callable | None = None
    energy_of_turning: Callable = lambda theta: 0.0
    numbers: dict = dataclasses.field(default_factory=dict)  # of the pipe, where it is no term
    flow: str = "aspirating"

    def __str__(self):
        return str(self.numbers) if self.term is None else repr(self.term)

    @property
    def pipe(self):
        end = "pinned" if isinstance(self.term, pp.Stretching) else "free"
        return dataclasses.replace(PIPE, flow=self.flow, end=end)

    @property
    def terms(self):
        return () if self.term is None else (self.term,)

    @property
    def place(self):
        return 1.0 if self.term is None else self.term.place

    @property
    def turns(self):
        return self.couple is not None or self.inertia > 0.0

    def load_in_scenes(self, law, numbers, r, angle, t, n, v, omega):
        """As `redundant.load`, which alone knows the load of what moves across the pipe."""
        if self.normal_mass:
            return redundant.load(law, numbers, r, angle, t, n, v, omega)
        force = np.broadcast_arrays(*self.load(*r.T, *v.T, t.T), angle)[:2]
        return np.transpose(force), self.couple(angle, omega) if self.couple else 0.0 * angle


TABLE = [
    Row(pp.PointMass(at=0.37, mass=0.6), mass=0.6),
    Row(pp.PointMass(at=1.0, mass=0.3), mass=0.3),
    Row(pp.PointMass(at=0.75, mass=0.2, inertia=0.03), mass=0.2, inertia=0.03),
    Row(pp.PointMass(at=1.0, mass=0.0, inertia=0.05), inertia=0.05),
    Row(
        pp.Spring(at=0.62, stiffness=15.0),
        load=lambda x, y, vx, vy, t: (-15.0 * x, 0.0),
        energy=lambda x, y: 7.5 * x**2,
    ),
    Row(
        pp.Spring(at=1.0, stiffness=4.0),
        load=lambda x, y, vx, vy, t: (-4.0 * x, 0.0),
        energy=lambda x, y: 2.0 * x**2,
    ),
    Row(
        pp.Damper(at=0.62, coefficient=1.5),
        load=lambda x, y, vx, vy, t: (-1.5 * vx, 0.0),
        power=lambda x, y, vx, vy, t: -1.5 * vx**2,
    ),
    Row(
        pp.Foundation(stiffness=20.0),
        load=lambda x, y, vx, vy, t: (-20.0 * x, 0.0),
        energy=lambda x, y: 10.0 * x**2,
    ),
    Row(
        pp.Viscosity(sigma=1.3),
        load=lambda x, y, vx, vy, t: -1.3 * (vx * t[1] - vy * t[0]) * np.array([t[1], -t[0]]),
        power=lambda x, y, vx, vy, t: -1.3 * (vx * t[1] - vy * t[0]) ** 2,
    ),
    Row(
        pp.CubicSpring(at=0.62, stiffness=60.0),
        load=lambda x, y, vx, vy, t: (-60.0 * x**3, 0.0),
        energy=lambda x, y: 15.0 * x**4,
    ),
    Row(
        pp.Stop(at=0.3, gap=0.08, stiffness=200.0),
        load=lambda x, y, vx, vy, t: (-200.0 * np.sign(x) * np.maximum(np.abs(x) - 0.08, 0.0), 0.0),
        energy=lambda x, y: 100.0 * np.maximum(np.abs(x) - 0.08, 0.0) ** 2,
    ),
    Row(pp.AddedMass(chi=0.7), normal_mass=0.7),
    Row(
        pp.Tension(load=-3.0),
        load=lambda x, y, vx, vy, t: (0.0, -3.0),
        energy=lambda x, y: 3.0 * (y - 1.0),
    ),
    Row(
        pp.Weight(at=0.62, load=2.5),
        load=lambda x, y, vx, vy, t: (0.0, 2.5),
        energy=lambda x, y: 2.5 * (0.62 - y),
    ),
    Row(
        pp.Load(at=0.37, force=(1.5, -2.0)),
        load=lambda x, y, vx, vy, t: (1.5, -2.0),
        energy=lambda x, y: 2.0 * (y - 0.37) - 1.5 * x,
    ),
    Row(
        pp.DistributedLoad(force=(2.0, 3.0)),
        load=lambda x, y, vx, vy, t: (2.0, 3.0),
        energy=lambda x, y: 3.0 * (0.5 - y) - 2.0 * x,  # s is 0.5 on average
    ),
    Row(
        pp.FollowerForce(at=0.62, force=2.5),
        load=lambda x, y, vx, vy, t: -2.5 * t[:, 0],
        power=lambda x, y, vx, vy, t: -2.5 * (t[0] * vx + t[1] * vy),
    ),
    Row(
        pp.Stretching(stiffness=40.0),
        load=lambda x, y, vx, vy, t: (0.0, 40.0 * (1.0 - y) - 40.0 * PIPE.damping * vy),
        energy=lambda x, y: 20.0 * (1.0 - y) ** 2,
        power=lambda x, y, vx, vy, t: -40.0 * PIPE.damping * vy**2,
    ),
    Row(
        pp.RotationalSpring(at=0.4, stiffness=6.0),
        couple=lambda theta, omega: -6.0 * theta,
        energy_of_turning=lambda theta: 3.0 * theta**2,
    ),
    Row(pp.RotationalDamper(at=0.62, coefficient=0.4), couple=lambda theta, omega: -0.4 * omega),
    Row(
        None,
        numbers={"inflow_share": 0.4},
        load=lambda x, y, vx, vy, t: -0.6 * SPEED * PIPE.beta**0.5 * np.array([vx, vy])[:, 0],
        power=lambda x, y, vx, vy, t: -0.6 * SPEED * PIPE.beta**0.5 * (vx**2 + vy**2),
    ),
    Row(
        None,
        numbers={"jet_angle": 0.9},
        flow="ejecting",
        load=lambda x, y, vx, vy, t: (turned(t) - t)[:, 0] * -THRUST,
        power=lambda x, y, vx, vy, t: (turned(t) - t)[:, 0] @ np.array([vx, vy])[:, 0] * -THRUST,
    ),
]

LENGTHS = [0.3, 0.1, 0.25, 0.35]
MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 4),
    "unequal chain": lambda pipe: pp.Chain(pipe, lengths=LENGTHS, springs=[4.0, 3.0, 0.0, 5.0]),
    "midpoint chain": lambda pipe: pp.Chain(pipe, 4, springs="midpoint"),
    "beam modes": lambda pipe: pp.Galerkin(pipe, 4),
    "Legendre functions": lambda pipe: pp.Galerkin(pipe, 5, "legendre"),
}
PIPE = pp.Pipe(0.3, 7.0, flow="aspirating", alpha=0.8, damping=0.02)
SPEED = 1.7
THRUST = PIPE.alpha * SPEED**2


def turned(t, angle=0.9):
    """A direction (sin, cos) at a greater angle."""
    return np.cos(angle) * t + np.sin(angle) * np.array([t[1], -t[0]])


rows = pytest.mark.parametrize("row", TABLE, ids=str)
models = pytest.mark.parametrize("kind", MODELS)


def jacobian_by_differences(function, at, sizes, step=0.02):
    """Steps are in units of the coordinates' sizes."""
    directions = np.diag(np.broadcast_to(sizes, at.shape))
    columns = [derivative_along(function, at, direction, step) for direction in directions]
    return np.stack(columns, axis=-1) / sizes


def with_and_without(row, kind):
    """The model with the term, and the same coordinates without: a term without weight."""
    make, pipe = MODELS[kind], row.pipe
    if row.term is None:
        return make(dataclasses.replace(pipe, **row.numbers)), make(pipe)
    nothing = () if row.place is None else (pp.PointMass(row.place, 0.0),)
    fitted = make(dataclasses.replace(pipe, terms=(row.term,)))
    return fitted, make(dataclasses.replace(pipe, terms=nothing))


def sizes_of(model):
    """What turns the pipe by an angle of about 1, of each coordinate."""
    if isinstance(model, pp.Galerkin):
        return 1.0 / np.abs(model.core.basis(np.linspace(0.0, 1.0, 201), 1)).max(axis=0)
    return np.ones(model.coordinates)


def state_of(model):
    """Large angles, rates of the same size, that meet what holds the end."""
    rng = np.random.default_rng(3)
    size = 0.5 * sizes_of(model)
    q, rate = (size * rng.standard_normal(model.coordinates) for _ in range(2))
    return model.onto_constraints(q, rate)


def turning_of(scene, state, u, **drive):
    """Angular accelerations of a scene's segments, of which it counts what each adds."""
    return np.cumsum(scene.rhs(0.0, state, u, **drive)[state.size // 2 + 2 :: 3])


def places_of(row, model):
    """Arc lengths where the term acts and their weights: one, or Gauss points between all kinks."""
    if row.place is not None:
        return np.array([row.place]), np.ones(1)
    kinks = np.array([0.0, 1.0])
    if isinstance(model, pp.Chain):
        kinks = np.concatenate([[0.0], model.base + np.cumsum([0.0, *model.lengths])])
        kinks = np.unique(np.minimum(kinks, 1.0))
    nodes, weights = leggauss(30)
    halves = np.diff(kinks)[:, None] / 2
    middles = (kinks[1:] + kinks[:-1])[:, None] / 2
    return (middles + halves * nodes).ravel(), (halves * weights).ravel()


def tangents_of(row, model, q, places):
    """Of the shape drawn, (2, k), where a term acts all along or the flow at the free end."""
    if row.term is None:
        s = 0.985 + 0.015 * np.cos(np.pi * np.arange(14) / 13)
        lines = [Polynomial.fit(s, line, 9).deriv()(1.0) for line in model.shape(q, s).T]
        return np.array(lines)[:, None]
    if isinstance(row.term, pp.FollowerForce):
        theta = angle_at(row.place, model, q)
        return np.array([[np.sin(theta)], [np.cos(theta)]])
    if row.place is not None:
        return None
    return derivative_along(lambda s: model.shape(q, s), places, np.ones_like(places), step=1e-5).T


def angle_at(place, model, q, near=0.0):
    """Angle of the tangent just before a place, from the shape that the model draws.

    Of those that differ by whole turns, the one nearest to another.
    """
    length, degree = (0.01, 1) if isinstance(model, pp.Chain) else (0.1, 15)
    s = place - length * np.arange(41) / 40
    x, y = (Polynomial.fit(s, line, degree).deriv()(place) for line in model.shape(q, s).T)
    return near + np.angle((y + 1j * x) * np.exp(-1j * near))


def work_of_turning(row, model, q, rate, acceleration):
    """Virtual work of the couple by each coordinate, (dof,), of which angles are sums."""
    sizes = sizes_of(model)  # angles are linear, which allows long steps
    theta = angle_at(row.place, model, q)
    by_q = jacobian_by_differences(lambda at: angle_at(row.place, model, at, theta), q, sizes, 0.1)
    couple = 0.0 if row.couple is None else row.couple(theta, by_q @ rate)
    return by_q * (couple - row.inertia * (by_q @ acceleration))


def lagrangian_inertia(row, model, q, rate, acceleration):
    """d/dt dT/dq' - dT/dq of what moves across the pipe alone, (dof,)."""
    places, weights = places_of(row, model)

    def normals(at):  # the velocity across of each place by each rate
        t = tangents_of(row, model, at, places)
        by_q = jacobian_by_differences(lambda x: model.shape(x, places), at, sizes_of(model))
        return t[1][:, None] * by_q[:, 0] - t[0][:, None] * by_q[:, 1]

    def momentum(time):
        by_rate = normals(q + time[0] * rate)
        return by_rate.T @ (weights * (by_rate @ (rate + time[0] * acceleration)))

    def energy(at):
        t = tangents_of(row, model, at, places)
        vx, vy = derivative_along(lambda x: model.shape(x, places), at, rate).T
        return 0.5 * np.sum(weights * (vx * t[1] - vy * t[0]) ** 2)

    change = derivative_along(momentum, np.zeros(1), np.ones(1))
    by_q = jacobian_by_differences(energy, q, sizes_of(model))
    return row.normal_mass * (change - by_q)


@models
@rows
def test_term_does_the_virtual_work_of_its_law(row, kind):
    """Inertia, weight and load of the term, from the places that the model draws."""
    model, plain = with_and_without(row, kind)
    q, rate = state_of(model)
    y = np.concatenate([q, rate])
    fitted, bare = (m.rhs(0.0, y, SPEED)[q.size :] for m in (model, plain))
    places, weights = places_of(row, model)
    free = plain.free_directions(q)  # a held end does no work
    inertia = plain.operators(q).mass @ free.T
    work, scale = inertia @ (fitted - bare), np.abs(inertia @ bare).max()

    def positions(coordinates):
        return plain.shape(coordinates, places)

    by_q = jacobian_by_differences(positions, q, sizes_of(model))
    velocity = by_q @ rate
    bias = second_derivative_along(positions, q, rate)
    across, along = row.load(*positions(q).T, *velocity.T, tangents_of(row, plain, q, places))
    load = np.stack(np.broadcast_arrays(across, along, weights)[:2], axis=1)
    load = load - row.mass * (by_q @ fitted + bias - np.array([0.0, PIPE.gamma]))
    work = work - free.T @ np.einsum("k,kij,ki->j", weights, by_q, load)
    if row.normal_mass:
        work = work + lagrangian_inertia(row, plain, q, rate, fitted)
    if row.turns:
        work = work - free.T @ work_of_turning(row, plain, q, rate, fitted)
    assert np.abs(work).max() < 1e-9 * scale


@models
@rows
def test_energy_of_a_term_is_its_laws_and_changes_as_its_power_says(row, kind):
    model, plain = with_and_without(row, kind)
    q, rate = state_of(model)
    y = np.concatenate([q, rate])
    places, weights = places_of(row, model)
    x, height = plain.shape(q, places).T
    vx, vy = derivative_along(lambda at: plain.shape(at, places), q, rate).T
    density = row.mass * ((vx**2 + vy**2) / 2 - PIPE.gamma * (height - places))
    expected = np.sum(weights * (density + row.energy(x, height)))
    t = tangents_of(row, plain, q, places)
    if row.normal_mass:
        expected += np.sum(weights * row.normal_mass * (vx * t[1] - vy * t[0]) ** 2) / 2
    power = np.sum(weights * row.power(x, height, vx, vy, t))
    if row.turns:
        theta = angle_at(row.place, plain, q)
        omega = derivative_along(lambda at: angle_at(row.place, plain, at, theta), q, rate)
        expected += row.energy_of_turning(theta) + row.inertia * omega**2 / 2
        resisted = 0.0 if row.couple is None else row.couple(0.0, omega) * omega
        power += resisted
    assert model.energy(y) - plain.energy(y) == pytest.approx(expected, rel=1e-9)
    parts, name = model.power(y, SPEED), "flow" if row.term is None else "others"
    fed = getattr(parts, name) - getattr(plain.power(y, SPEED), name)
    assert fed == pytest.approx(power, rel=1e-9, abs=1e-12)
    change = derivative_along(model.energy, y, model.rhs(0.0, y, SPEED), step=1e-4)
    assert parts.total == pytest.approx(change, rel=1e-9)


@models
@rows
def test_jacobian_of_a_term_meets_differences(row, kind):
    model, _ = with_and_without(row, kind)
    y = np.concatenate(state_of(model))
    exact = model.jacobian(0.0, y, SPEED)
    sizes = np.tile(sizes_of(model), 2)
    differences = jacobian_by_differences(lambda at: model.rhs(0.0, at, SPEED), y, sizes, 0.01)
    assert np.abs(exact - differences).max() < 1e-9 * np.abs(exact).max()


@models
@rows
def test_linear_operators_of_a_term_are_the_jacobian_at_rest(row, kind):
    model, _ = with_and_without(row, kind)
    n = model.coordinates
    mass, velocity, stiffness = model.operators().at(SPEED)
    free = model.free_directions(np.zeros(n))
    at_rest = free.T @ model.jacobian(0.0, np.zeros(2 * n), SPEED)[n:]
    scale = np.abs(stiffness).max() + np.abs(velocity).max()
    assert np.abs(mass @ at_rest[:, :n] @ free + stiffness).max() < 1e-11 * scale
    assert np.abs(mass @ at_rest[:, n:] @ free + velocity).max() < 1e-11 * scale


@models
@pytest.mark.parametrize("row", [row for row in TABLE if not row.pipe.end_held], ids=str)
def test_operators_of_a_bent_pipe_are_the_derivatives_of_the_forces_at_rest(row, kind):
    model, _ = with_and_without(row, kind)
    q, _ = state_of(model)
    zero = np.zeros(model.dof)

    def force(at):
        return (
            model.operators(at).mass @ model.rhs(0.0, np.concatenate([at, zero]), SPEED)[q.size :]
        )

    def moving_force(rates):
        return model.operators(q).mass @ model.rhs(0.0, np.concatenate([q, rates]), SPEED)[q.size :]

    _, velocity, stiffness = model.operators(q).at(SPEED)
    differences = jacobian_by_differences(force, q, sizes_of(model))
    assert np.abs(stiffness + differences).max() < 1e-9 * np.abs(stiffness).max()
    differences = jacobian_by_differences(moving_force, zero, sizes_of(model))
    assert np.abs(velocity + differences).max() < 1e-9 * np.abs(stiffness).max()


@rows
def test_a_scene_with_a_term_moves_as_the_chain_does(row):
    pipe = dataclasses.replace(row.pipe, terms=row.terms, **row.numbers)
    chain, scene = pp.Chain(pipe, 4), pp.modular.chain(pipe, 4)
    added = pp.modular.chain(dataclasses.replace(pipe, terms=()), 4).plus(*row.terms)
    assert added.pipe.terms == row.terms
    q, rate = state_of(chain)
    y, state = np.concatenate([q, rate]), scene.state(q, rate)
    expected = chain.rhs(0.0, y, SPEED)
    for model in (scene, added):
        assert model.energy(state) == pytest.approx(chain.energy(y), rel=1e-12)
        for name in ("flow", "joints", "others"):
            mine, its = getattr(model.power(state, SPEED), name), chain.power(y, SPEED)
            assert mine == pytest.approx(getattr(its, name), rel=1e-11, abs=1e-12)
        ours = turning_of(model, state, SPEED)
        assert np.abs(ours - expected[4:]).max() < 1e-11 * np.abs(expected).max()
    dense = redundant.accelerations(scene, state, SPEED, load=row.load_in_scenes)
    ours = scene.rhs(0.0, state, SPEED)[dense.size :]
    assert np.abs(dense - ours).max() < 1e-9 * np.abs(ours).max()
    if not pipe.rests_straight:
        return
    found = pp.eigenvalues(scene, SPEED, count=4)
    assert found == pytest.approx(pp.eigenvalues(chain, SPEED, count=4), rel=1e-10)


def test_terms_are_checked_where_they_are_given():
    with pytest.raises(ValueError, match=r"terms\[1\]\.at must lie in \(0, 1\], got 1\.5"):
        pp.Pipe(0.2, terms=[pp.PointMass(0.5, 0.1), pp.Spring(1.5, 2.0)])
    with pytest.raises(TypeError, match="Term must be one of its laws"):
        pp.Term()
    with pytest.raises(
        ValueError, match=r"terms\[0\]\.mass must lie in \[0, 1e\+06\], got 2000000"
    ):
        pp.Pipe(0.2, terms=[pp.PointMass(0.5, 2e6)])

    @dataclasses.dataclass(frozen=True)
    class Mine(pp.Term):
        law = "mine"

    with pytest.raises(TypeError, match=r"terms\[0\] must be a law of the package"):
        pp.Pipe(0.2, terms=[Mine()])


def test_terms_take_and_give_si_values():
    hose = {"length": 0.6, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.12}
    terms = [pp.PointMass(0.6, 0.01), pp.Spring(0.3, 2.0), pp.Viscosity(0.2)]
    terms += [pp.CubicSpring(0.3, 40.0), pp.Stop(0.3, 0.03, 200.0)]
    pipe = pp.Pipe.from_si(**hose, terms=terms)
    held = pp.Pipe.from_si(**hose, end="pinned", terms=[pp.Stretching(1e4)])
    mass, spring, viscosity, cubic, stop = pipe.terms
    assert mass == pp.PointMass(1.0, 0.01 / (0.31 * 0.6))
    assert spring.at == pytest.approx(0.5, rel=1e-15)
    assert spring.stiffness == pytest.approx(2.0 * 0.6**3 / 7.3e-3, rel=1e-14)
    assert viscosity.sigma == pytest.approx(0.2 * 0.6**2 / np.sqrt(7.3e-3 * 0.31), rel=1e-14)
    assert cubic.stiffness == pytest.approx(40.0 * 0.6**5 / 7.3e-3, rel=1e-14)
    assert (stop.at, stop.gap) == pytest.approx((0.5, 0.05), rel=1e-15)
    assert stop.stiffness == pytest.approx(200.0 * 0.6**3 / 7.3e-3, rel=1e-14)
    assert held.terms[0].stiffness == pytest.approx(1e4 * 0.6**3 / 7.3e-3, rel=1e-14)
    assert pipe.has_kinks
    assert not held.has_kinks
    for term, given in zip(pipe.terms_si, (0.01, 2.0, 0.2, 40.0, 0.03), strict=True):
        assert next(iter(term.numbers.values())) == pytest.approx(given, rel=1e-14)
    riser = {"length": 1000.0, "bending_stiffness": 1e10, "pipe_mass": 5e3, "fluid_mass": 5e3}
    heavy = pp.Pipe.from_si(**riser, terms=[pp.PointMass(3 * 333.3333333333334, 2e6)])
    assert heavy.terms == (pp.PointMass(1.0, 0.2),)
    assert heavy.terms_si == (pp.PointMass(1000.0, 2e6),)
    with pytest.raises(
        ValueError, match=r"terms\[0\]\.stiffness from its SI value, length, .* got"
    ):
        pp.Pipe.from_si(**riser, terms=[pp.Spring(1.0, 1e12)])
    with pytest.raises(ValueError, match=r"terms\[0\]\.at must lie in \(0, 0\.6\], got 0\.7"):
        pp.Pipe.from_si(**hose, terms=[pp.Spring(0.7, 1.0)])
    with pytest.raises(ValueError, match="terms in SI need a pipe made with"):
        _ = pp.Pipe(0.2, terms=[mass]).terms_si


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_tip_mass_so_heavy_that_its_weight_needs_more_functions_is_refused():
    """Each basis shows other modes that a mass of 1e3, which hangs from the pipe, lets grow."""
    pipe = pp.Pipe(0.2, 10.0, terms=(pp.PointMass(1.0, 1e3),))
    with pytest.raises(pp.NotConverged, match="still moves by inf at 400 functions"):
        pp.critical_speed(pp.Continuum(pipe))


@pytest.mark.parametrize(
    "make", [lambda p: pp.Chain(p, 60), lambda p: pp.Galerkin(p, 8), pp.Continuum]
)
def test_a_compressed_pipe_buckles_at_eulers_load(make):
    """pi^2 / 4 of a cantilever under a dead load; a chain's is 1e-4 off."""
    for factor, stable in ((0.999, True), (1.001, False)):
        pipe = pp.Pipe(0.2, terms=[pp.Tension(-factor * np.pi**2 / 4)])
        assert pp.critical_speed(make(pipe), 5.0).stable_at_rest == stable


def test_a_cubic_spring_hardens_motions_and_leaves_the_onset():
    bare, held = (
        pp.Chain(pp.Pipe(0.2, terms=terms), 4) for terms in ((), (pp.CubicSpring(0.8, 1e3),))
    )
    onset = pp.critical_speed(bare).speed
    assert pp.critical_speed(held).speed == pytest.approx(onset, rel=1e-14)
    u = 1.001 * onset
    wide, narrow = (pp.limit_cycle(model, u).amplitude for model in (bare, held))
    assert narrow < 0.7 * wide
