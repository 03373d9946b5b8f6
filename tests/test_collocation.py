# SPDX-License-Identifier: MIT
"""Collocation and Magnus' series of periodic orbits, against motions, numpy and exponentials."""

import numpy as np
import pytest
import scipy

import pipedyn as pp
from pipedyn import _core
from pipedyn.motion.vector_field import VectorField
from pipedyn.orbits import magnus
from pipedyn.orbits.collocation import LOSS, collocation_maps
from pipedyn.orbits.periodic_orbit import (
    METHOD,
    ONCE,
    STAGE_NODES,
    TWICE,
    PeriodicOrbit,
    interpolated,
    stage_phases,
)

MODEL, SPEED = pp.Chain(pp.Pipe(0.2, 5.0, damping=0.01), 3), 6.0


@pytest.fixture(scope="module")
def cycle():
    return pp.limit_cycle(MODEL, SPEED, rtol=1e-9)


def at_stages(orbit):
    """States at the stages, the last of which are the ends of intervals, (M, s, 2 half)."""
    columns = orbit.stage_columns().reshape(2 * orbit.half, len(orbit.starts), -1)
    return columns.transpose(1, 2, 0)


def test_maps_are_what_motions_make_of_small_changes(cycle, each_level):
    motion, orbit = VectorField(MODEL), cycle.orbit
    maps, units = collocation_maps(motion, orbit)
    for m in (0, len(maps) - 1):
        ends = []
        for sign in (1.0, -1.0):
            for k in range(motion.size):
                y = orbit.starts[m].copy()
                y[k] += sign * 1e-4
                moved = scipy.integrate.solve_ivp(
                    *(lambda t, y: motion(y[:, None], SPEED)[:, 0], (0.0, orbit.durations[m]), y),
                    method="DOP853",
                    rtol=1e-11,
                    atol=1e-13,
                )
                ends.append(moved.y[:, -1])
        ahead, behind = np.split(np.array(ends).T, 2, axis=1)
        measured = (ahead - behind) / 2e-4 * units / units[:, None]
        assert maps[m] == pytest.approx(measured, abs=1e-6)


def linearised_orbit(model, h, starts, rates, frequency, *, speed_varies=True, **how):
    """The core's equations about an orbit whose mirror image follows it."""
    given = {"by_frequency": None, "of_states": False, "forced": False, **how}
    return _core.LinearisedOrbit(
        *(model.core, h, starts, rates, METHOD, frequency, -1.0, np.array([SPEED]), None),
        speed_varies=speed_varies,
        most=LOSS,
        **given,
    )


def random_orbit(random, count, half):
    """Starts and rates of intervals, which need not join."""
    n, stages = 2 * half, STAGE_NODES.size
    return random.normal(size=(count, n)), random.normal(size=(count, stages, half))


@pytest.mark.parametrize("half", [1, 2, 7, 20])
def test_eliminated_stages_solve_their_equations(half, each_level):
    """Each stage's change is that of its force, for each right-hand side."""
    random, model = np.random.default_rng(half), pp.Chain(pp.Pipe(0.2, 5.0, drag=0.3), half)
    stages, n, h, frequency = STAGE_NODES.size, 2 * half, 0.3, 4.0
    start, rates = random_orbit(random, 1, half)
    states = _core.stage_states(np.array([h]), start, rates, METHOD)
    linearised = model.motion_linearised(states, SPEED)
    moving = random.normal(size=(half, stages))
    force, by_speed, jacobians = linearised[:, 0, half:], linearised[:, 1, half:], linearised[:, 2:]
    given = model, np.array([h]), start, rates, frequency
    equations = linearised_orbit(*given, by_frequency=moving)
    found, ends = equations.by_rates.reshape(stages, half, n + 3), equations.maps[0]
    units = np.repeat([1.0, equations.unit], half)
    assert equations.unit == max(1.0, np.sqrt(np.abs(jacobians[0, half:, :half]).max()))
    # The states at the stages are moved by their rates, by the first state and by the duration.
    once, twice = (np.einsum("ij,jab->iab", matrix, found) for matrix in (ONCE, TWICE))
    p, v = h**2 * twice, h * once
    p[:, :, :half] += np.eye(half)
    p[:, :, half:n] += h * STAGE_NODES[:, None, None] * np.eye(half)
    v[:, :, half:n] += np.eye(half)
    longer = -h / frequency
    p[:, :, n + 1] += longer * (STAGE_NODES[:, None] * start[0, half:] + 2.0 * h * TWICE @ rates[0])
    v[:, :, n + 1] += longer * (ONCE @ rates[0])
    moved = jacobians[:, half:] @ np.concatenate([p, v], axis=1)
    moved[:, :, n] += force - rates[0]
    moved[:, :, n + 1] += moving.T
    moved[:, :, n + 2] += by_speed
    assert found == pytest.approx(moved, abs=1e-10 * np.abs(found).max())
    # The residual holds what the end misses of the mirror image of the beginning.
    orbit = PeriodicOrbit(np.array([0.0, frequency * h]), start, rates, frequency, 1.0)
    end = np.concatenate([p[-1], v[-1]]) / units[:, None]
    end[:, :n] *= units
    end[:, n] += (at_stages(orbit)[0, -1] + start[0]) / units
    assert ends == pytest.approx(end, abs=1e-10 * np.abs(ends).max())

    exchanged = [*range(n + 1), n + 2, n + 1]
    forced = linearised_orbit(*given, by_frequency=moving, forced=True)
    assert np.array_equal(forced.maps[0], ends[:, exchanged])
    assert np.array_equal(forced.by_rates, equations.by_rates[:, exchanged])
    still = linearised_orbit(*given, speed_varies=False)
    assert not still.maps[0, :, n + 2].any()
    states = linearised_orbit(*given, of_states=True)
    assert states.maps[0] == pytest.approx(ends[:, :n], abs=1e-12 * np.abs(ends).max())


def test_what_an_interval_misses_of_the_next_is_part_of_the_residual():
    random = np.random.default_rng(5)
    h, half = np.array([0.1, 0.3, 0.2]), 2
    starts, rates = random_orbit(random, h.size, half)
    model = pp.Chain(pp.Pipe(0.2), half)
    equations = linearised_orbit(model, h, starts, rates, 4.0)
    orbit = PeriodicOrbit(np.append(0.0, 4.0 * np.cumsum(h)), starts, rates, 4.0, 1.0)
    missed = at_stages(orbit)[:, -1] - np.stack([starts[1], starts[2], -starts[0]])
    units = np.repeat([1.0, equations.unit], half)
    for k in range(h.size):
        part = slice(k, k + 1)
        alone = linearised_orbit(model, h[part], starts[part], rates[part], 4.0)
        own = np.repeat([1.0, alone.unit], half)
        orbit = PeriodicOrbit(np.array([0.0, 4.0 * h[k]]), starts[part], rates[part], 4.0, 1.0)
        gap = at_stages(orbit)[0, -1] + starts[k]
        forces = alone.maps[0, :, 2 * half] * own - gap
        assert equations.maps[k, :, 2 * half] * units == pytest.approx(
            forces + missed[k], abs=1e-12
        )


@pytest.mark.parametrize("most", [1e300, 40.0, 1e-300])
def test_joined_intervals_are_products_and_runs_end_before_they_lose_digits(most):
    random = np.random.default_rng(2)
    maps, right = random.normal(size=(9, 5, 5)), random.normal(size=(9, 5, 2))
    relation = _core.SpanRelation(np.concatenate([maps, right], axis=2), most)
    whole, begins = relation.products, relation.begins
    assert begins[0] == 0
    assert (len(begins) == 1, len(begins) == 9) == (most > 40.0, most < 40.0)
    for first, last in zip(begins, [*begins[1:], 9], strict=True):
        product, sums = np.eye(5), np.zeros((5, 2))
        for k in range(first, last):
            product, sums = maps[k] @ product, maps[k] @ sums + right[k]
            assert whole[k] == pytest.approx(
                np.concatenate([product, sums], axis=1), rel=1e-12, abs=1e-12
            )
            assert k == first or np.abs(product).max() < most
        if last < 9:
            assert np.abs(maps[last] @ product).max() >= most


@pytest.mark.parametrize("most", [1e300, 40.0, 1e-300])
def test_states_of_a_span_meet_every_interval_and_the_relation_of_both_ends(most):
    random = np.random.default_rng(7)
    maps, right = random.normal(size=(9, 5, 5)), random.normal(size=(9, 5, 2))
    relation = _core.SpanRelation(np.concatenate([maps, right], axis=2), most)
    loads, first = random.normal(size=(2, 3)), random.normal(size=(5, 3))
    x = [first]
    for map_of, load in zip(maps, right, strict=True):
        x.append(map_of @ x[-1] + load @ loads)
    sizes = np.abs(x[-1]).max()
    left = relation.first @ first + relation.last @ x[-1] - relation.known @ loads
    assert np.abs(left).max() <= 1e-11 * sizes
    found = relation.states(np.concatenate([first, x[-1]]), loads).reshape(9, 5, 3)
    assert found == pytest.approx(np.array(x[:-1]), abs=1e-9 * sizes)


@pytest.mark.parametrize("forced", [False, True])
def test_changes_of_an_orbit_meet_the_linearised_equations(forced):
    """Each interval's equations, both conditions, and the closing up to the mirror image."""
    random, count, half = np.random.default_rng(3), 4, 3
    n = 2 * half
    starts, rates = random_orbit(random, count, half)
    equations = linearised_orbit(
        *(pp.Chain(pp.Pipe(0.2), half), np.full(count, 0.2), starts, rates, 4.0), forced=forced
    )
    size = starts.size + rates.size + 2
    phase, row = random.normal(size=(2, size))
    change = equations.change(phase, 0.3, row, 0.7, 1.0)
    assert [phase @ change, row @ change] == pytest.approx([0.3, 0.7], abs=1e-9)
    states, moved = change[: starts.size].reshape(count, n), change[starts.size : -2]
    units = np.repeat([1.0, equations.unit], half)
    for k in range(count):
        given = np.concatenate([states[k], [1.0], change[-2:]])
        found = equations.by_rates.reshape(count, -1, n + 3)[k] @ given
        assert moved.reshape(count, -1)[k] == pytest.approx(found, abs=1e-9)
        given[:n] /= units
        end = -states[0] if k == count - 1 else states[k + 1]
        assert equations.maps[k] @ given == pytest.approx(end / units, abs=1e-9)
    with pytest.raises(ValueError, match="phase and row must hold"):
        equations.change(phase[:-1], 0.3, row, 0.7, 1.0)


def test_states_between_the_stages_are_those_of_the_motion(cycle):
    t = np.linspace(0.0, 2.5 * cycle.period, 23)
    p, rates = np.split(cycle.orbit.states(np.zeros(1))[:, 0], 2)
    motion = pp.simulate(MODEL, SPEED, t[-1], p, rates, times=t, rtol=1e-11)
    found = cycle.orbit.states(cycle.orbit.frequency * t)
    assert found == pytest.approx(np.concatenate([motion.q, motion.qdot], axis=1).T, abs=1e-6)


def test_velocities_at_the_stages_are_those_at_their_phases(cycle):
    edges = np.array([0.0, 0.5, 1.3, 2.2, cycle.orbit.span])
    orbit = interpolated(VectorField(MODEL), cycle.orbit.states, edges, cycle.frequency, SPEED)
    stages = at_stages(orbit)[..., orbit.half :]
    phases = stage_phases(edges)
    phases[:, -1] -= 1e-9  # an interval's, not the next one's
    at = orbit.states(phases.ravel())[orbit.half :].T.reshape(stages.shape)
    assert stages[:, :-1] == pytest.approx(at[:, :-1], abs=1e-13)
    assert stages[:, -1] == pytest.approx(at[:, -1], abs=1e-6)


def test_arrays_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="maps must have shape"):
        _core.SpanRelation(np.zeros((2, 3, 2)), 1e5)
    with pytest.raises(ValueError, match="rates must have shape"):
        linearised_orbit(MODEL, *[np.zeros(3)] * 3, 1.0)
    given = np.zeros(3), np.zeros((2, 2)), np.zeros((2, STAGE_NODES.size, 1))
    with pytest.raises(ValueError, match="durations must hold 2 numbers"):
        linearised_orbit(MODEL, *given, 1.0)
    with pytest.raises(ValueError, match="rates must be those of the model"):
        linearised_orbit(MODEL, given[0][:2], *given[1:], 1.0)
    with pytest.raises(ValueError, match="rates must have shape"):
        linearised_orbit(MODEL, given[0][:0], given[1][:0], given[2][:0], 1.0)
    alone = pp.Chain(pp.Pipe(0.2), 1), given[0][:2] + 0.1, *given[1:], 1.0
    states, unknowns = linearised_orbit(*alone, of_states=True), np.zeros(2 * 10 + 2)
    with pytest.raises(ValueError, match="equations must have loads"):
        states.change(unknowns, 0.0, unknowns, 1.0, 0.0)
    with pytest.raises(ValueError, match="ends and loads must have 4 and 0 rows"):
        states.restored(np.zeros((4, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="ends and loads must have 4 and 3 rows"):
        linearised_orbit(*alone).restored(np.zeros((4, 1)), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="ends and loads must have 4 and 0 rows"):
        states.span.states(np.zeros((2, 1)), np.zeros((0, 1)))
    with pytest.raises(ValueError, match="edges must hold 2 numbers"):
        _core.orbit_states(
            np.zeros(1), *given[1:], 1.0, 1.0, np.zeros((9, 8)), np.zeros((10, 8)), [0]
        )
    with pytest.raises(ValueError, match="durations must hold 2 numbers"):
        _core.stage_states(*given, METHOD)
    with pytest.raises(ValueError, match="exponents must have shape"):
        magnus.exponentials(np.zeros((2, 3, 2)))
    with pytest.raises(ValueError, match="rows must have shape"):
        _core.interval_maps(np.zeros(3), np.zeros(1), [1], [0], 1.0, np.zeros(8), np.zeros(8))
    rows, weights = np.zeros((1, 8, 1, 2)), np.zeros((1, 8))
    with pytest.raises(ValueError, match="weights for them"):
        _core.interval_maps(rows, np.ones(1), [2], [0], 1.0, weights, weights)


# ----------------------------------------------------------------------------- Magnus' series


def mathieu(a, q, intervals=16):
    """Derivatives of x'' = -(a - 2 q cos 2 t) x at stages over its period pi, and durations."""
    duration = np.pi / intervals
    t = duration * (np.arange(intervals)[:, None] + STAGE_NODES)
    rows = np.zeros((intervals, STAGE_NODES.size, 1, 2))
    rows[..., 0, 0] = -(a - 2.0 * q * np.cos(2.0 * t))
    return rows, np.full(intervals, duration)


def product(maps):
    whole = np.eye(maps.shape[1])
    for one in maps:
        whole = one @ whole
    return whole


def monodromy(a, q, parts, units=(1.0, 1.0)):
    rows, durations = mathieu(a, q)
    counts = np.full(len(rows), parts)
    return product(magnus.interval_maps(rows, durations, np.array(units), counts))


@pytest.mark.parametrize("order", [1, 4])
def test_maps_converge_with_the_fourth_power_of_the_parts(order):
    # At its characteristic numbers the equation has a solution of period pi or 2 pi: the
    # multipliers' sum is 2 or -2.
    q = 20.0
    a = scipy.special.mathieu_a(order, q)
    parts = np.array([1, 2, 4, 8])
    found = [np.trace(monodromy(a, q, count)) for count in parts]
    errors = np.abs(np.array(found) - (2.0 if order % 2 == 0 else -2.0))
    assert errors[0] > 1000.0 * errors[-1]
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(4.0, abs=0.3)


def test_two_lengths_of_parts_give_a_better_map():
    q = 5.0
    a = scipy.special.mathieu_a(2, q)
    coarse, fine = (monodromy(a, q, parts) for parts in (1, 2))
    better = fine + (fine - coarse) / 15.0
    assert abs(np.trace(better) - 2.0) < 0.1 * abs(np.trace(fine) - 2.0)


def test_what_does_not_change_is_exact_however_fast():
    # 1,000 rad in a part: methods that resolve the turns would need thousands of steps.
    frequency = 16_000.0
    found = monodromy(frequency**2, 0.0, 1, (1.0, frequency))
    angle = frequency * np.pi
    exact = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    assert found == pytest.approx(np.array(exact), abs=1e-9)


def test_units_give_the_same_maps():
    rows, durations = mathieu(3.0, 2.0, 4)
    counts, units = np.array([1, 3, 3, 2]), np.array([1.0, 7.0])
    plain = magnus.interval_maps(rows, durations, np.ones(2), counts)
    scaled = magnus.interval_maps(rows, durations, units, counts)
    assert scaled * units[:, None] / units == pytest.approx(plain, rel=1e-13)


@pytest.mark.parametrize("size", [1e-3, 0.5, 3.0, 200.0])
def test_exponentials_are_those_of_scipy(size, each_level):
    rng = np.random.default_rng(3)
    for n in (1, 6, 27):
        turning = rng.normal(size=(3, 2, n, n))
        turning = size * (turning - turning.swapaxes(-1, -2))  # does not grow
        assert magnus.exponentials(turning) == pytest.approx(
            scipy.linalg.expm(turning), abs=1e-14 * (1.0 + 30.0 * size)
        )


def test_exponentials_that_overflow_are_not_finite():
    with np.errstate(over="ignore", invalid="ignore"):
        assert not np.isfinite(magnus.exponentials(np.full((1, 2, 2), 1e200))).any()


@pytest.mark.parametrize("singular", [False, True])
def test_general_eigenvalues_are_scipys_infinite_ones_too(singular):
    random = np.random.default_rng(0)
    a, b = random.normal(size=(2, 7, 7))
    if singular:
        b[:, 2] = b[:, 5]
    found = _core.general_values(a, b)
    expected = scipy.linalg.eigvals(a, b)
    largest = np.abs(expected) > 1e12
    assert np.count_nonzero(largest) == singular
    assert np.count_nonzero(~(np.abs(found) < 1e12)) == singular
    inner = found[np.abs(found) < 1e12]
    np.testing.assert_allclose(
        np.sort_complex(inner.round(9)), np.sort_complex(expected[~largest].round(9)), atol=2e-9
    )
    for wrong in (a[:6], np.full((7, 7), np.nan)):
        with pytest.raises(ValueError, match="must be finite, square and of the same size"):
            _core.general_values(wrong, b)


@pytest.mark.parametrize(("count", "n"), [(1, 4), (12, 2), (13, 3), (500, 6), (3000, 4)])
def test_the_nearest_of_many_points_is_scipys(count, n):
    random = np.random.default_rng(count)
    points, states = random.normal(size=(count, n)), 1.5 * random.normal(size=(200, n))
    points[count // 2] = points[0]  # two at one place
    nearest, tree = _core.NearestPoint(points), scipy.spatial.cKDTree(points)
    for most in (0.5, 1.5, np.inf):
        distances, _ = tree.query(states, distance_upper_bound=most)
        away, found = nearest(states, most)
        assert np.array_equal(found < 0, ~np.isfinite(distances))
        at = np.flatnonzero(found >= 0)
        apart = np.linalg.norm(states[at] - points[found[at]], axis=1)
        np.testing.assert_allclose(apart, distances[at], rtol=1e-14)
        np.testing.assert_array_equal(away[at], states[at] - points[found[at]])
        assert np.isinf(away[found < 0]).all()
    away, found = nearest(np.full((1, n), np.nan), np.inf)
    assert found.tolist() == [-1]
    assert np.isinf(away).all()
    with pytest.raises(ValueError, match=f"states must have shape \\(k, {n}\\), got \\(3, 1\\)"):
        nearest(np.zeros((3, 1)), 1.0)
    with pytest.raises(ValueError, match="derivatives must have the shape of the points"):
        _core.NearestPoint(points, points)


def test_differences_from_a_curve_are_of_third_order_in_the_time_since_its_nearest_point():
    """States lie 1e-3 outside a circle of radius 1, whose points are up to h / 2 away."""
    errors = []
    for count in (50, 100):
        at = 2.0 * np.pi * np.arange(count) / count
        points = np.stack([np.cos(at), np.sin(at)], axis=1)
        once = np.stack([-np.sin(at), np.cos(at)], axis=1)
        angle = np.linspace(0.0, 6.0, 500)
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        away, near = _core.NearestPoint(points, once, -points)(1.001 * normal, np.inf)
        assert np.abs(np.angle(np.exp(1j * (angle - at[near])))).max() <= 1.001 * np.pi / count
        errors.append(np.abs(np.sum(away * normal, axis=1) - 1e-3).max())
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] > 3.5
