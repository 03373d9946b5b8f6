# SPDX-License-Identifier: MIT
"""Forces of the user's own, f(s, t), against virtual work, a moving base and linear responses."""

import math
from dataclasses import replace

import numpy as np
import pint
import pytest
from independent import derivative_along

import pipedyn as pp
from pipedyn.models.base import ROWS
from pipedyn.models.drive import AppliedForces

PIPE = pp.Pipe(0.3, 7.0, damping=0.02, drag=0.4, terms=[pp.Spring(0.6, 5.0)])
HELD = replace(PIPE, end="pinned", supports=(0.45,))
MODELS = {
    "chain": lambda pipe: pp.Chain(pipe, 5),
    "unequal chain": lambda pipe: pp.Chain(
        pipe, lengths=[0.3, 0.15, 0.25, 0.3], springs=[4.0, 3.0, 2.0, 5.0]
    ),
    "midpoint chain": lambda pipe: pp.Chain(pipe, 4, springs="midpoint"),
    "scene": lambda pipe: pp.modular.chain(pipe, 4),
    "beam": lambda pipe: pp.Galerkin(pipe, 4),
    "legendre": lambda pipe: pp.Galerkin(pipe, 4, "legendre"),
}
models = pytest.mark.parametrize("kind", MODELS)


def swirl(s, t):
    """A wave along the pipe with both components."""
    return np.stack([np.cos(3.0 * s - 2.0 * t), 0.5 + s * math.sin(t)], axis=-1)


FORCES = {
    "at the end": pp.Force(lambda t: (1.0 + t, -0.5 * t), at=1.0),
    "inside": pp.Force(lambda t: (math.cos(t), 0.3), at=0.63),
    "along": pp.Force(swirl, amplitude=3.0),
    "uniform": pp.Force(lambda s, t: 2.0 * math.cos(t)),
}
forces = pytest.mark.parametrize("name", FORCES)


def state_of(model):
    random = np.random.default_rng(5)
    q = model.bent(lambda s: 0.8 * np.sin(2.0 * s))
    q = q + 0.1 * np.abs(q).max() * random.normal(size=q.size)
    return np.concatenate([q, 0.5 * np.abs(q).max() * random.normal(size=q.size)])


def driven(model, applied, t, dimensions=2):
    """The model with the forces and their drive at a time."""
    numbers = AppliedForces(applied, np.linspace(0.0, 2.0, 9), dimensions)
    return model.with_applied(numbers.laws), np.concatenate([np.zeros(ROWS), numbers(t)])


def virtual_work(model, force, q, t):
    """Generalised force by displacements of what `shape` draws, whose slopes are differences."""

    def at(places):
        return lambda x: model.shape(x, places)

    if force.at is not None:
        places, weights = np.array([force.at]), np.ones(1)
    elif isinstance(model, pp.Galerkin):
        nodes, weights = np.polynomial.legendre.leggauss(20)
        ends = np.array([0.0, 0.45, 0.6, 1.0])  # joints of functions between them
        half = 0.5 * np.diff(ends)[:, None]
        places = (ends[:-1, None] + half * (1.0 + nodes)).ravel()
        weights = (half * weights).ravel()
    else:  # two Gauss points of each segment, as the chain itself takes laws all along
        ends = np.concatenate([[0.0], np.cumsum(model.lengths)]) + getattr(model, "base", 0.0)
        half = 0.5 * np.diff(ends)[:, None]
        places = (ends[:-1, None] + half * (1.0 + np.array([-1.0, 1.0]) / math.sqrt(3.0))).ravel()
        weights = np.repeat(half.ravel(), 2)
    loads = weights[:, None] * force.components(places, t)
    slopes = [derivative_along(at(places), q, one, 2e-3) for one in np.eye(q.size)]
    return np.array([(slope * loads).sum() for slope in slopes])


@forces
@models
def test_accelerations_by_a_force_do_its_virtual_work(kind, name):
    model, force, t = MODELS[kind](PIPE), FORCES[name], 0.7
    if kind == "scene":
        same = pp.Chain(PIPE, 4)
        forced, drive = driven(model, [force], t)
        other, _ = driven(same, [force], t)
        y = state_of(same)
        ours, theirs = (one.motion_rates(y, 2.0, drive) for one in (forced, other))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)
        return
    y, half = state_of(model), model.coordinates
    forced, drive = driven(model, [force], t)
    plain = model.motion_rates(y, 2.0)
    change = (forced.motion_rates(y, 2.0, drive) - plain)[half:]
    mass = model.operators(y[:half]).mass if isinstance(model, pp.Galerkin) else None
    if mass is None:  # by the kinetic energy, which is quadratic in the rates

        def kinetic(rates):
            moving = np.concatenate([y[:half], rates])
            return model.energy(moving) - model.energy(np.concatenate([y[:half], 0.0 * rates]))

        unit = np.eye(half)
        mass = np.array([[kinetic(a + b) - kinetic(a) - kinetic(b) for a in unit] for b in unit])
    expected = virtual_work(model, force, y[:half], t)
    np.testing.assert_allclose(mass @ change, expected, rtol=1e-7, atol=1e-8)


@forces
@models
def test_power_is_that_of_the_moving_places(kind, name):
    model, force, t = MODELS[kind](PIPE), FORCES[name], 1.3
    y = state_of(pp.Chain(PIPE, 4) if kind == "scene" else model)
    forced, drive = driven(model, [force], t)
    rows = len(y)
    with_work = np.append(y, 0.0)
    fed = forced.motion_rates(with_work, 2.0, drive)[rows]
    fed -= model.motion_rates(with_work, 2.0)[rows]
    chain = pp.Chain(PIPE, 4) if kind == "scene" else model
    half = rows // 2
    expected = virtual_work(chain, force, y[:half], t) @ y[half:]
    assert fed == pytest.approx(expected, rel=1e-7)


def assert_states_of_a_batch_have_own_forces(forced, y, drive):
    many = np.stack([y, 0.5 * y, 0.1 * y], axis=1)
    drives = np.stack([drive, 2.0 * drive, 0.0 * drive], axis=1)
    together = forced.motion_rates(many, 2.0, drives)
    for k in range(3):
        alone = forced.motion_rates(many[:, k], 2.0, drives[:, k].copy())
        np.testing.assert_allclose(together[:, k], alone, rtol=1e-10, atol=1e-10)


@forces
@pytest.mark.parametrize("pipe", [PIPE, HELD], ids=["free", "held"])
@models
def test_derivatives_by_the_state_are_those_of_differences(kind, pipe, name):
    if pipe is HELD and kind in ("scene", "midpoint chain"):
        return  # which have no supports
    model = MODELS[kind](pipe)
    forced, drive = driven(model, [FORCES[name], FORCES["inside"]], 0.4)
    y = state_of(pp.Chain(pipe, 4) if kind == "scene" else model)
    y = np.concatenate(model.onto_constraints(*np.split(y, 2)))

    def rates(x):
        return forced.motion_rates(x, 2.0, drive)

    found = forced.motion_jacobian(y, 2.0, drive)
    size = np.abs(y).max()
    columns = [derivative_along(rates, y, size * one, 1e-3) / size for one in np.eye(y.size)]
    np.testing.assert_allclose(
        found, np.stack(columns, axis=1), rtol=1e-6, atol=1e-6 * np.abs(found).max()
    )
    assert_states_of_a_batch_have_own_forces(forced, y, drive)


# ------------------------------------------------------------------------------- motions in time


@models
@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:DOP853"])
def test_a_uniform_force_moves_the_pipe_as_a_base_does(kind, method):
    """In the frame of the base all mass feels -X'': so it is without drag, and all on the base."""
    pipe = pp.Pipe(0.3, 7.0, damping=0.02)
    model = MODELS[kind](pipe)
    fixed = getattr(model, "base", 0.0)
    base = pp.Harmonic(0.05, 6.0)
    inertia = pp.Force(lambda s, t: 0.05 * 36.0 * math.cos(6.0 * t) + 0.0 * s)
    start = np.zeros(model.coordinates) if kind != "scene" else (lambda s: 0.0 * s)
    options = {"method": method, "rtol": 1e-9, "times": [0.5, 1.0, 2.0]}
    moved = pp.simulate(model, 3.0, 2.0, start, base=base, **options)
    pushed = pp.simulate(model, 3.0, 2.0, start, force=inertia, **options)
    np.testing.assert_allclose(pushed.tip, moved.tip, atol=1e-7)
    assert np.ptp(moved.tip[:, 0]) > 0.01
    assert pushed.audit < 1e-7
    assert fixed >= 0.0


@forces
@models
def test_the_energy_of_a_forced_motion_is_the_work_done_on_it(kind, name):
    model = MODELS[kind](PIPE)
    motion = pp.simulate(model, 2.0, 3.0, force=FORCES[name], rtol=1e-9, method="radau")
    assert motion.audit < (1e-7 if PIPE.drag == 0.0 else 1e-5)


@pytest.mark.parametrize("kind", ["chain", "legendre"])
@pytest.mark.parametrize("at", [0.4, 1.0])
def test_a_weak_oscillating_force_moves_the_pipe_by_its_frequency_response(kind, at):
    pipe = pp.Pipe(0.2, 10.0, damping=0.05)
    model = MODELS[kind](pipe)
    u, omega, size = 2.0, 5.0, 1e-4
    response = pp.frequency_response(model, u, [omega], input=("force", at)).response[0]
    push = pp.Force(at=at, frequency=omega, amplitude=size)
    motion = pp.simulate(
        model, u, 40.0, np.zeros(model.coordinates), force=push, samples=4001, rtol=1e-9
    )
    late = motion.t > 30.0
    expected = size * (response * np.exp(1j * omega * motion.t[late])).real
    np.testing.assert_allclose(motion.tip[late, 0], expected, atol=1e-4 * size * abs(response))


def test_a_constant_force_bends_the_pipe_as_a_weight_there_does():
    """A force along y that does not vary is a `Weight`."""
    pipe = pp.Pipe(0.2, -3.0, damping=0.1)
    pulled = pp.Galerkin(replace(pipe, terms=[pp.Weight(0.7, -2.0)]), 6)
    model = pp.Galerkin(pipe, 6)
    force = pp.Force(lambda t: (0.0, -2.0), at=0.7)
    start = {"q0": lambda s: 0.4 * s, "rtol": 1e-9, "times": [0.5, 2.0]}
    found = pp.simulate(model, 1.0, 2.0, force=force, **start)
    expected = pp.simulate(pulled, 1.0, 2.0, **start)
    np.testing.assert_allclose(found.tip, expected.tip, rtol=1e-6)


def test_forces_act_with_a_moving_base_a_varying_flow_and_a_supply():
    model = pp.Chain(replace(PIPE, drag=0.0), 4)
    force = [FORCES["inside"], FORCES["along"]]
    for u in (pp.Pulsation(3.0, 0.2, 5.0), lambda t: 2.0 + 0.5 * math.sin(t)):
        motion = pp.simulate(
            model, u, 2.0, base=pp.Harmonic(0.02, 4.0), force=force, rtol=1e-9, method="radau"
        )
        other = pp.simulate(
            model, u, 2.0, base=pp.Harmonic(0.02, 4.0), force=force, rtol=1e-9, method="dop853"
        )
        assert motion.audit < 1e-6
        np.testing.assert_allclose(motion.tip, other.tip, atol=1e-6)
    supply = pp.Supply.at_speed(model.pipe, 3.0, friction=2.0)
    fed = [
        pp.simulate(model, supply, 2.0, force=force, rtol=1e-9, method=method)
        for method in ("radau", "dop853")
    ]
    np.testing.assert_allclose(fed[0].tip, fed[1].tip, atol=1e-6)
    alone = pp.simulate(model, supply, 2.0, rtol=1e-9)
    assert np.abs(fed[0].flow_speed - alone.flow_speed).max() > 1e-3


@pytest.mark.parametrize("method", ["radau", "dop853"])
def test_a_force_may_begin_suddenly_and_a_short_one_is_not_passed_over(method):
    model, start = pp.Chain(pp.Pipe(0.2, damping=0.01), 6), np.zeros(6)
    at_once = pp.simulate(
        model, 3.0, 2.0, start, force=pp.Force(lambda t: 1.0, at=1.0), times=[1.0, 2.0], rtol=1e-11
    )
    late = pp.Force(lambda t: float(t >= 1.0), at=1.0)
    found = pp.simulate(model, 3.0, 3.0, start, force=late, times=[2.0, 3.0], method=method)
    np.testing.assert_allclose(found.tip, at_once.tip, atol=1e-8)
    blow = pp.Force(lambda t: 20.0 * (2.0 <= t < 2.05), at=1.0)  # in a motion of 4
    struck = pp.simulate(model, 3.0, 4.0, start, force=blow, method=method)
    fine = pp.simulate(model, 3.0, 4.0, start, force=blow, method=method, max_step=1e-3)
    assert np.abs(fine.tip[:, 0]).max() > 0.02
    np.testing.assert_allclose(struck.tip, fine.tip, atol=1e-6)


def test_members_of_an_ensemble_feel_the_same_force():
    model = pp.Chain(PIPE, 4)
    force = [FORCES["along"], FORCES["inside"]]
    speeds = [1.0, 2.0, 2.0]
    many = pp.simulate_many(model, speeds, 1.0, np.zeros(4), force=force, samples=5)
    for u, one in zip(speeds, many.motions, strict=True):
        alone = pp.simulate(model, u, 1.0, np.zeros(4), force=force, samples=5)
        np.testing.assert_allclose(one.tip, alone.tip, atol=1e-9)


def test_models_agree_on_a_force_along_the_pipe():
    pipe = pp.Pipe(0.2, 5.0, damping=0.02)
    exact, *others = (
        pp.simulate(model, 3.0, 2.0, np.zeros(model.dof), force=FORCES["along"], samples=51).tip
        for model in (
            pp.Galerkin(pipe, 10, "legendre"),
            pp.Galerkin(pipe, 10),
            pp.Chain(pipe, 20),
            pp.Chain(pipe, 40),
        )
    )
    errors = [np.abs(one - exact).max() for one in others]
    assert errors[0] < 1e-3
    assert errors[2] < 0.002
    assert math.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.2)


def test_a_forced_motion_has_the_model_without_its_force():
    model = pp.Galerkin(PIPE, 4)
    motion = pp.simulate(model, 2.0, 0.5, force=FORCES["inside"])
    y = state_of(model)
    np.testing.assert_array_equal(motion.model.rhs(0.0, y, 2.0), model.rhs(0.0, y, 2.0))
    assert repr(motion.model) == repr(model)


def test_a_force_in_si_units_is_that_force():
    numbers = {"bending_stiffness": 4.0, "pipe_mass": 0.75, "fluid_mass": 0.25}
    pipe = pp.Pipe.from_si(length=2.0, **numbers, gravity=0.0, damping_time=0.02)
    model, unit = pp.Chain(pipe, 4), pint.UnitRegistry()
    length, time = pipe.scales.length, pipe.scales.time
    newton = pipe.scales.mass * length**2 / time**2
    start = np.zeros(4)
    pairs = [
        (
            pp.Force(lambda t: 0.3 * math.sin(2.0 * t), at=0.5),
            pp.Force.from_si(
                pipe, lambda t: 0.3 * newton * math.sin(2.0 * t / time), at=0.5 * length
            ),
        ),
        (
            pp.Force(lambda s, t: s * t),
            pp.Force.from_si(
                pipe, lambda x, t: unit.Quantity(newton / length * x / length * t / time, "N/m")
            ),
        ),
        (
            pp.Force(at=1.0, frequency=3.0, amplitude=0.2),
            pp.Force.from_si(
                pipe, at=unit.Quantity(200.0, "cm"), frequency=3.0 / time, amplitude=0.2 * newton
            ),
        ),
    ]
    for plain, of_si in pairs:
        found = pp.simulate(model, 1.0, 1.0, start, force=of_si, samples=5)
        expected = pp.simulate(model, 1.0, 1.0, start, force=plain, samples=5)
        np.testing.assert_allclose(found.tip, expected.tip, rtol=1e-9, atol=1e-12)
        again = pp.simulate(
            model, pipe.speed_si(1.0), time, start, force=of_si, samples=5, units="si"
        )
        np.testing.assert_allclose(again.tip, expected.tip, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match=r"^force must come from Force\.from_si where units are"):
        pp.simulate(model, 1.0, 1.0, force=pairs[0][0], units="si")


# ---------------------------------------------------------------------------- forced responses


@pytest.mark.parametrize("kind", ["chain", "beam"])
def test_a_weak_force_has_forced_motions_of_its_frequency_response(kind):
    pipe = pp.Pipe(0.2, 10.0, damping=0.05)
    model, u, size = MODELS[kind](pipe), 2.0, 1e-3
    push = pp.Force(at=0.6, frequency=5.0, amplitude=size)
    found = pp.forced_response(model, u, force=push, frequencies=(4.0, 8.0))
    assert (found.failures, found.branches[0].kind) == ((), "force")
    for omega in (4.5, 6.0, 7.5):
        (motion,) = found.at(omega)
        response = pp.frequency_response(model, u, [omega], input=("force", 0.6)).response[0]
        assert motion.amplitude == pytest.approx(size * abs(response), rel=1e-4)
        assert motion.stable


def test_a_uniform_force_has_the_forced_motions_of_a_moving_base():
    """Of finite amplitude, at one frequency: the force of a base grows with its square."""
    pipe = pp.Pipe(0.2, damping=0.01)
    model, omega = pp.Galerkin(pipe, 4), 13.5
    base = pp.Harmonic(0.02, omega)
    inertia = pp.Force(lambda s, phase: math.cos(phase), frequency=omega, amplitude=0.02 * omega**2)
    (moved,) = pp.forced_response(model, 5.0, base=base).at(omega)
    (pushed,) = pp.forced_response(model, 5.0, force=inertia).at(omega)
    assert pushed.amplitude == pytest.approx(moved.amplitude, rel=1e-5)
    assert pushed.multipliers == pytest.approx(moved.multipliers, abs=1e-4)
    assert moved.amplitude > 0.1


def test_a_force_with_harmonics_has_the_motion_on_which_a_motion_in_time_ends():
    pipe = pp.Pipe(0.2, 5.0, damping=0.05)
    model, omega, u = pp.Chain(pipe, 4), 6.0, 3.0

    def bumps(phase):
        return (math.exp(math.cos(phase)), 0.4 * math.sin(2.0 * phase))

    force = pp.Force(bumps, at=0.8, frequency=omega, amplitude=2.0)
    (found,) = pp.forced_response(model, u, force=force).at(omega)
    period = 2.0 * math.pi / omega
    motion = pp.simulate(
        model, u, 40.0 * period, np.zeros(4), force=force, samples=40 * 64 + 1, rtol=1e-9
    )
    cycle = motion.tip[-65:, 0]
    assert found.amplitude == pytest.approx(0.5 * np.ptp(cycle), rel=2e-3)
    mean = float(np.mean(model.tips(found.q.T)[:-1, 0]))
    assert mean == pytest.approx(float(cycle[:-1].mean()), rel=1e-4)
    assert abs(mean) > 0.05


# -------------------------------------------------------------------------------- what is refused


def test_forces_that_cannot_be_are_refused():
    for arguments, kind, message in (
        ({}, ValueError, r"^frequency must be given for a force without a function, which is"),
        ({"function": 3.0}, TypeError, r"^function must be a function, got 3\.0"),
        ({"frequency": 0.0}, ValueError, r"^frequency must lie in \(0, 1e\+06\], got 0\.0"),
        ({"frequency": 1.0, "at": 0.0}, ValueError, r"^at must lie in \(0, 1\], got 0\.0"),
        ({"frequency": 1.0, "at": 1.2}, ValueError, r"^at must lie in \(0, 1\], got 1\.2"),
        (
            {"frequency": 1.0, "amplitude": math.nan},
            ValueError,
            r"^amplitude must lie in",
        ),
    ):
        with pytest.raises(kind, match=message):
            pp.Force(**arguments)


CHAIN = pp.Chain(pp.Pipe(0.2, damping=0.01), 3)


@pytest.mark.parametrize(
    ("force", "kind", "message"),
    [
        (3.0, TypeError, r"^force must be a Force or a sequence of them, got 3\.0"),
        ([pp.Force(at=1.0, frequency=1.0), None], TypeError, r"^force\[1\] must be a Force, got N"),
        ([pp.Force(at=1.0, frequency=1.0)] * 21, ValueError, r"^force must be 1 to 20 forces, g"),
        ([], ValueError, r"^force must be 1 to 20 forces, got 0"),
        (
            pp.Force(lambda s, t: np.where(s < 0.5, 1.0, 0.0)),
            ValueError,
            r"^force must be smooth along the pipe, so that a polynomial of degree 48 represents",
        ),
        (
            pp.Force(lambda s, t: np.exp(-(((s - 0.3137) / 0.003) ** 2))),
            ValueError,
            r"^force must be smooth along the pipe, .* misses by 8\.5e-01 of its size",
        ),
        (pp.Force(lambda t: math.nan, at=1.0), ValueError, r"^force\(0\) must give finite numbers"),
        (pp.Force(lambda t: "x", at=1.0), ValueError, r"^force\(0\) must give finite numbers, one"),
        (pp.Force(lambda t: (1.0, 2.0, 3.0), at=1.0), ValueError, r"^force\(0\) must give finite"),
        (pp.Force(lambda s, t: [1.0, 2.0]), ValueError, r"^force\(0\) must give finite numbers"),
        (
            pp.Force(lambda t: 1 / 0, at=1.0),
            ValueError,
            r"^force\(0\) must be numbers, it raised Z",
        ),
        (pp.Force(lambda t: 1.0), ValueError, r"^force\(0\) must be numbers, it raised TypeError"),
    ],
)
def test_simulate_refuses_what_is_no_force(force, kind, message):
    with pytest.raises(kind, match=message):
        pp.simulate(CHAIN, 1.0, 1.0, force=force)


def test_a_force_that_fails_in_motion_stops_the_motion_with_the_reason():
    def late(t):
        if 0.521 < t < 0.529:  # between two of the times that are tried beforehand
            raise RuntimeError("lost")
        return 0.1

    with pytest.raises(pp.MotionStopped, match=r"force\(0\.52.*it raised RuntimeError: lost") as at:
        pp.simulate(CHAIN, 1.0, 1.0, force=pp.Force(late, at=1.0), max_step=0.01)
    assert at.value.motion.t[-1] < 0.53


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        (
            {"force": pp.Force(lambda t: 1.0, at=1.0)},
            ValueError,
            r"^force must have a frequency, which sets the period, and a function of the phase",
        ),
        (
            {"force": pp.Force(lambda phase: phase, at=1.0, frequency=3.0)},
            ValueError,
            r"^force must repeat as its phase grows by 2 pi, got a function whose values then diff",
        ),
        (
            {"force": pp.Force(at=1.0, frequency=3.0, amplitude=0.0)},
            ValueError,
            r"^force must act, got one that is 0 at all times",
        ),
        (
            {"force": pp.Force(at=1.0, frequency=3.0), "base": pp.Harmonic(0.1, 3.0)},
            ValueError,
            r"^force must not be given where the base moves",
        ),
        (
            {"force": [pp.Force(at=1.0, frequency=3.0)]},
            TypeError,
            r"^force must be a Force, got \[",
        ),
        ({}, TypeError, r"^base must be a Harmonic or u a Pulsation, got None; or give a force"),
    ],
)
def test_forced_response_refuses_what_does_not_force_periodically(arguments, kind, message):
    with pytest.raises(kind, match=message):
        pp.forced_response(CHAIN, 1.0, **arguments)


def test_a_pulsating_flow_has_no_force_in_forced_response():
    push = pp.Force(at=1.0, frequency=3.0)
    with pytest.raises(ValueError, match=r"^force must not be given where the flow pulsates"):
        pp.forced_response(CHAIN, pp.Pulsation(1.0, 0.2, 3.0), force=push)
