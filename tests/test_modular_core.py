# SPDX-License-Identifier: MIT
"""The modular route's core: modules in redundant coordinates, constraints enforced in groups."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import splu

from pipedyn import _core
from pipedyn.models.modular.motion import acceleration_derivatives

CLAMP, JOINT, GUIDE, PIN = range(4)
FLOWS = [(False, 1.0), (True, 0.7)]


def chained(n):
    return [(CLAMP, 1), *((JOINT, j) for j in range(2, n + 1))]


def springs(joint, stiffness, damping, rest):
    return np.stack([joint, stiffness, damping, rest], axis=1)


class Made:
    """A scene with nothing equal or homogeneous, and the chain with the same segments."""

    def __init__(
        self, n, more=(), seed=0, constraints=None, aspirating=False, alpha=1.0, terms=(), **given
    ):
        rng = np.random.default_rng([n, seed])
        self.n, self.base = n, 0.1
        lengths = rng.uniform(0.4, 1.6, n)
        self.length = (1.0 - self.base) * lengths / lengths.sum()
        self.spring = rng.uniform(0.5, 2.0, n) * n
        segments = {
            "center": rng.uniform(0.2, 0.8, n),
            "gyration_radius": rng.uniform(0.1, 0.5, n) / n,
            "drag_point": rng.uniform(0.0, 1.0, n),
        }
        numbers = {
            "beta": 0.3,
            "gamma": 4.0,
            "centrifugal": alpha if aspirating else 1.0,
            "drag": 1.5,
            "damping": 0.01,
            "aspirating": aspirating,
        }
        pipe = _core.Pipe(**numbers, terms=list(terms))
        self.chain = _core.Chain(
            pipe, length=self.length, spring=self.spring, base=self.base, **segments
        )
        groups = chained(n) if constraints is None else list(constraints)
        groups += more
        arguments = {
            "springs": springs(np.arange(1, n + 1), self.spring, 0.01 * self.spring, np.zeros(n)),
            "constraints": [(*group, 0.0, 0.0)[:4] for group in groups],
            "inertia": np.zeros((0, 3)),
            "flow": True,
            "drag": True,
        }
        arguments.update(segments, **given)
        self.core = _core.Scene(pipe, length=self.length, base=self.base, **arguments)

    def angles(self, size=2.0, members=None, seed=1):
        shape = self.n if members is None else (self.n, members)
        rng = np.random.default_rng([self.n, seed])
        return size * rng.normal(size=shape), size * rng.normal(size=shape)

    def state(self, size=2.0, seed=1):
        return self.core.from_angles(*self.angles(size, seed=seed))


def rich(n, more=(), **given):
    """All that a scene can have besides the chain's own modules."""
    places = [1.0, 0.37]
    # a rod between two far nodes' transverse motions, and a body on coordinates of one node
    first, last = 0, 3 * (n - 1)
    return Made(
        n,
        more,
        **{
            "terms": [
                *(("spring", at, [k]) for at, k in zip(places, [3.0, 2.0], strict=True)),
                *(("damper", at, [c]) for at, c in zip(places, [0.7, 0.2], strict=True)),
                *(("point_mass", at, [m]) for at, m in zip(places, [0.3, 0.1], strict=True)),
            ],
            "springs": springs(
                np.r_[1 : n + 1, n, 1],
                np.r_[np.full(n, float(n)), 2.0, 3.0],
                np.r_[np.full(n, 0.1), 0.2, 0.0],
                np.r_[np.zeros(n), 0.4, -0.3],
            ),
        }
        | inertia(
            [first, first, last, last, last + 1, last + 2],
            [first, last, first, last, last + 1, last + 2],
            [0.1, 0.05, 0.05, 0.2, 0.02, 0.01],
        )
        | given,
    )


def inertia(rows, columns, values):
    """Arguments of a scene for further inertia, by Cholesky's factors of the matrix."""
    size = max(rows) + 1
    whole = matrix((rows, columns, values), (size, size))
    touched = np.unique(rows)
    return inertia_rows(np.linalg.cholesky(whole[np.ix_(touched, touched)]).T, touched)


def inertia_rows(factor, coordinates):
    row, column = np.nonzero(factor)
    entries = [row, np.asarray(coordinates)[column], factor[row, column]]
    return {"inertia": np.stack(entries, axis=1)}


def matrix(triplets, shape):
    rows, columns, values = triplets
    return sparse.coo_array((values, (rows, columns)), shape=shape).toarray()


def curvature(core, q, multipliers):
    """sum_i multipliers_i d2 g_i / dq2."""
    rows, *places, values = core.hessians(q)
    return matrix((*places, values * multipliers[rows]), (q.size, q.size))


def least_squares_accelerations(core, y, u):
    """[M A^T; A 0] [q''; -multipliers] = [f; b], whatever its rank."""
    size = core.coordinates
    g, triplets, b, _ = core.constraints(y)
    a = matrix(triplets, (g.size, size))
    mass = matrix(core.operators()["mass"], (size, size))
    whole = np.block([[mass, a.T], [a, np.zeros((g.size, g.size))]])
    solution = np.linalg.lstsq(whole, np.r_[core.forces(y, u), b], rcond=1e-11)[0]
    return solution[:size]


def operators_of(core):
    """All linear operators about the straight pipe, dense: constant ones, and of the forces."""
    size = core.coordinates
    straight = np.r_[core.straight(), np.zeros(core.coordinates)]
    by_q, by_rate = core.force_derivatives(straight, 0.0)
    dense = {name: matrix(of, (size, size)) for name, of in core.operators().items()}
    flow = dense.pop("velocity")
    dense |= {"gyroscopic": 0.5 * (flow - flow.T), "end_flux": 0.5 * (flow + flow.T)}
    forces = {"stiffness": by_q, "damping": by_rate}
    return dense | {name: -matrix(of, (size, size)) for name, of in forces.items()}


def worst(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


def differences(function, x, step=1e-5):
    columns = []
    for i in range(x.size):
        e = np.zeros(x.size)
        e[i] = step
        columns.append((function(x + e) - function(x - e)) / (2.0 * step))
    return np.stack(columns, axis=-1)


# ---------------------------------------------------------------------------------- accelerations


@pytest.mark.parametrize("n", [1, 2, 3, 10, 100, 1000])
@pytest.mark.parametrize(("aspirating", "alpha"), FLOWS)
def test_scene_of_a_chain_moves_as_the_chain(n, aspirating, alpha):
    made = Made(n, aspirating=aspirating, alpha=alpha)
    s = np.cumsum(made.length)
    for theta, omega in (made.angles(), (0.4 * np.sin(3.0 * s), np.cos(2.0 * s))):
        expected = made.chain.rhs(0.0, np.r_[theta, omega], 5.0)[n:]
        rates = made.core.rhs(0.0, made.core.from_angles(theta, omega), 5.0)
        assert worst(np.cumsum(rates[3 * n + 2 :: 3]), expected) < 1e-14 * (10 + n**1.5)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
@pytest.mark.parametrize("spot", ["free", "guide", "guided twice", "middle", "spread"])
def test_enforcement_solves_the_whole_system(n, spot):
    more = {
        "free": [],
        "guide": [(GUIDE, n)],
        "guided twice": [(GUIDE, n), (GUIDE, n)],
        "middle": [(GUIDE, max(1, n // 2))],
        "spread": [(GUIDE, j) for j in range(1, n + 1, 2)],
    }[spot]
    for made in (Made(n, more), rich(n, more)):
        y = made.state(1.0)
        rates = made.core.rhs(0.0, y, 4.0)
        np.testing.assert_array_equal(rates[: 3 * n], y[3 * n :])
        assert worst(rates[3 * n :], least_squares_accelerations(made.core, y, 4.0)) < 1e-9
        assert made.core.lacking(y[: 3 * n]) == -1


@pytest.mark.parametrize("n", [3, 6])
def test_pinned_arch_with_slack(n):
    for more in ([(PIN, n, 0.2, 0.9)], [(PIN, n, 0.2, 0.9), (GUIDE, n), (PIN, n, 0.2, 0.9)]):
        for made in (Made(n, more), rich(n, more)):
            y = made.state(1.0)
            y[3 * n :] = 0.0  # any others would contradict the pin
            found = made.core.rhs(0.0, y, 4.0)[3 * n :]
            assert worst(found, least_squares_accelerations(made.core, y, 4.0)) < 1e-9
            assert np.abs(found[3 * n - 3 : 3 * n - 1]).max() < 1e-12 * np.abs(found).max()


@pytest.mark.parametrize("more", [[], [(GUIDE, 1000)], [(PIN, 1000, 0.3, 0.8), (GUIDE, 1000)]])
def test_a_thousand_segments_obey_constraints_and_forces(more):
    """A q'' = b, and what M q'' lacks to f lies in the constraints' directions."""
    n = 1000
    made = Made(n, more)
    s = np.cumsum(made.length)
    y = made.core.from_angles(np.sin(4.0 * s), np.zeros(n))
    acceleration = made.core.rhs(0.0, y, 5.0)[3 * n :]
    g, (rows, columns, values), b, group = made.core.constraints(y)
    a = sparse.csr_array((values, (rows, columns)), shape=(g.size, 3 * n))
    terms = abs(a) @ np.abs(acceleration)
    assert np.all(np.abs(a @ acceleration - b) <= 1e-11 * terms.max())
    ops = made.core.operators()
    mass = sparse.csr_array((ops["mass"][2], ops["mass"][:2]), shape=(3 * n, 3 * n))
    force = made.core.forces(y, 5.0)
    kept = a[: 2 * n + (2 if len(more) > 1 else len(more))]  # the last guide says nothing new
    saddle = sparse.block_array([[sparse.eye_array(3 * n), kept.T], [kept, None]], format="csc")
    missing = force - mass @ acceleration
    out = splu(saddle).solve(np.r_[missing, np.zeros(kept.shape[0])])[: 3 * n]
    scale = np.abs(force).max() + (abs(mass) @ np.abs(acceleration)).max()
    assert np.abs(out).max() < 1e-10 * scale
    assert group.max() == len(more) + n - 1


def null_space(a):
    """Orthonormal directions that the rows allow."""
    _, sizes, directions = np.linalg.svd(a)
    return directions[int((sizes > 1e-9 * sizes[0]).sum()) :].T


def test_scenes_at_random_move_or_name_what_lacks_inertia():
    """Any groups in any order, at states that need not meet them, by the null space at once."""
    moved = lacked = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 7))
        groups = [group for group in chained(n) if rng.random() < 0.95]
        groups += [(GUIDE, int(rng.integers(1, n + 1))) for _ in range(rng.integers(0, 3))]
        groups += [(PIN, int(rng.integers(1, n + 1)), 0.1, 0.5)] * int(rng.integers(0, 2))
        groups = [groups[i] for i in rng.permutation(len(groups))]
        if not groups:
            continue
        made = (rich if seed % 2 else Made)(n, constraints=groups, seed=seed)
        y = np.r_[made.core.straight(), np.zeros(3 * n)]
        y[: 3 * n] += 0.5 * rng.normal(size=3 * n)
        g, triplets, b, _ = made.core.constraints(y)
        assert not b.any()
        ways = null_space(matrix(triplets, (g.size, 3 * n)))
        mass = ways.T @ matrix(made.core.operators()["mass"], (3 * n, 3 * n)) @ ways
        inertia, combinations = np.linalg.eigh(mass)
        found = made.core.rhs(0.0, y, 3.0)[3 * n :]
        lacking = made.core.lacking(y[: 3 * n])
        if inertia.size and inertia[0] < 1e-13:
            lacked += 1
            assert np.isnan(found).all()
            assert np.abs((ways @ combinations[:, inertia < 1e-13])[lacking]).max() > 1e-3
            continue
        moved += 1
        assert lacking == -1
        force = made.core.forces(y, 3.0)
        expected = ways @ np.linalg.solve(mass, ways.T @ force) if inertia.size else 0.0 * force
        scale = max(np.abs(expected).max(), np.abs(force).max())
        assert np.abs(found - expected).max() < 1e-9 * scale
    assert moved > 50
    assert lacked > 10


def test_order_of_the_groups_does_not_matter():
    n = 5
    groups = [*chained(n), (GUIDE, 3), (GUIDE, 5)]
    made = rich(n, constraints=groups)
    y = made.state()
    expected = made.core.rhs(0.0, y, 3.0)
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(len(groups))
        other = rich(n, constraints=[groups[i] for i in order])
        assert worst(other.core.rhs(0.0, y, 3.0), expected) < 1e-12
        np.testing.assert_array_equal(
            other.core.constraints(y)[3],
            np.concatenate(
                [[k] * (1 if groups[i][0] == GUIDE else 2) for k, i in enumerate(order)]
            ),
        )


def test_inertia_may_couple_every_coordinate():
    n = 5
    rng = np.random.default_rng(0)
    for rank in (3 * n, 4):
        factor = rng.normal(size=(3 * n, rank))
        made = Made(n, [(GUIDE, n)], **inertia_rows(factor.T, np.arange(3 * n)))
        y = made.state(1.0)
        found = made.core.rhs(0.0, y, 4.0)[3 * n :]
        assert worst(found, least_squares_accelerations(made.core, y, 4.0)) < 1e-8


def test_chain_of_coupled_inertia_stays_exact():
    """Inertia between neighbours along the whole pipe, against the dense solution."""
    n = 30
    nodes = np.arange(n)
    rows = np.r_[3 * nodes, 3 * nodes[1:], 3 * nodes[:-1]]
    columns = np.r_[3 * nodes, 3 * nodes[:-1], 3 * nodes[1:]]
    values = np.r_[np.full(n, 0.2), np.full(2 * n - 2, 0.1)]
    made = Made(n, **inertia(rows, columns, values))
    y = made.state(0.3)
    found = made.core.rhs(0.0, y, 4.0)[3 * n :]
    assert worst(found, least_squares_accelerations(made.core, y, 4.0)) < 1e-9


def test_batches_and_threads_give_what_single_states_give():
    made = rich(4)
    theta, omega = made.angles(members=6)
    y = made.core.from_angles(theta, omega)
    u = np.linspace(0.0, 5.0, 6)
    force = np.random.default_rng(2).normal(size=(12, 6))
    rates = made.core.rhs(0.0, y, u, force=force)
    energy, power = made.core.energy(y), np.array(made.core.power(y, u))

    def one(k):
        state = made.core.from_angles(theta[:, k], omega[:, k])
        np.testing.assert_array_equal(state, y[:, k])
        np.testing.assert_array_equal(rates[:, k], made.core.rhs(0.0, state, u[k], force[:, k]))
        assert made.core.energy(state) == energy[k]
        np.testing.assert_array_equal(power[:, k], made.core.power(state, u[k]))

    with ThreadPoolExecutor(3) as pool:
        list(pool.map(one, list(range(6)) * 20))


def test_further_forces_add_to_the_modules():
    made = Made(3)
    y = made.state()
    with_all, without = made.core.forces(y, 5.0), made.core.forces(y, 0.0)
    found = made.core.rhs(0.0, y, 0.0, force=with_all - without)
    assert worst(found, made.core.rhs(0.0, y, 5.0)) < 1e-12


# -------------------------------------------------------------------------------------- operators


def test_operators_are_those_of_the_chain_on_the_straight_pipe():
    """r_j = sum l_i (theta_i, 0), phi_j = theta_j - theta_{j-1}; gravity enters by curvature."""
    for n, (aspirating, alpha) in itertools.product((1, 4), FLOWS):
        made = Made(n, aspirating=aspirating, alpha=alpha)
        size = 3 * n
        basis = np.zeros((size, n))
        basis[0::3] = np.tril(np.ones((n, n))) * made.length
        basis[2::3] = np.eye(n) - np.eye(n, k=-1)
        dense = operators_of(made.core)
        expected = made.chain.operators()
        for name in ("mass", "gyroscopic", "end_flux", "damping"):
            found = basis.T @ dense[name] @ basis
            np.testing.assert_allclose(found, getattr(expected, name), rtol=1e-12, atol=1e-13)
        # flux and gravity act along the pipe too: multipliers of the constraints times curvature
        q = made.core.straight()
        y = np.r_[q, np.zeros(size)]
        g, triplets, b, _ = made.core.constraints(y)
        assert np.abs(g).max() < 1e-15
        assert not b.any()
        a = matrix(triplets, (g.size, size))
        np.testing.assert_allclose(a @ basis, 0.0, atol=1e-14)
        centrifugal = alpha if aspirating else 1.0
        for u in (0.0, 3.0):
            multipliers = np.linalg.lstsq(a.T, made.core.forces(y, u), rcond=None)[0]
            stiffness = dense["stiffness"] + centrifugal * u**2 * dense["flux"]
            stiffness += curvature(made.core, q, multipliers)
            whole = expected.stiffness + centrifugal * u**2 * expected.flux
            np.testing.assert_allclose(basis.T @ stiffness @ basis, whole, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("aspirating", "alpha"), FLOWS)
def test_forces_follow_the_operators_at_small_motions(aspirating, alpha):
    made = rich(3, aspirating=aspirating, alpha=alpha, drag=False)
    size, u = 9, 2.5
    y = np.random.default_rng(0).normal(size=2 * size)
    ops = operators_of(made.core)
    np.testing.assert_array_equal(ops["gyroscopic"], -ops["gyroscopic"].T)
    np.testing.assert_array_equal(ops["mass"], ops["mass"].T)
    direction = -1.0 if aspirating else 1.0
    velocity = direction * u * (ops["gyroscopic"] + ops["end_flux"]) + ops["damping"]
    stiffness = ops["stiffness"] + (alpha if aspirating else 1.0) * u**2 * ops["flux"]
    change = made.core.forces(y, u) - made.core.forces(np.zeros(2 * size), u)
    np.testing.assert_allclose(change, -stiffness @ y[:size] - velocity @ y[size:], atol=1e-12)


# ------------------------------------------------------------------------------------ derivatives


@pytest.mark.parametrize("n", [1, 2, 4])
def test_derivatives_agree_with_differences(n):
    size = 3 * n
    made = rich(n, [(GUIDE, n), (PIN, 1, 0.1, 0.2)], aspirating=n == 2, alpha=0.7)
    rng = np.random.default_rng(n)
    y = np.r_[made.core.straight(), np.zeros(size)] + 0.3 * rng.normal(size=2 * size)
    core, u = made.core, 3.0
    g, triplets, b, _ = core.constraints(y)
    m = g.size
    a = matrix(triplets, (m, size))

    def close(triplet_pair, shape, function):
        found = np.hstack([matrix(t, shape) for t in triplet_pair])
        np.testing.assert_allclose(found, differences(function, y), atol=2e-8, rtol=1e-7)

    close(core.force_derivatives(y, u), (size, size), lambda z: core.forces(z, u))
    by_coordinates = differences(lambda z: core.constraints(z)[0], y)
    np.testing.assert_allclose(np.hstack([a, 0.0 * a]), by_coordinates, atol=1e-8)
    # d/dt of A q' is A q'' + A' q', so b = -A' q'
    q, rates = y[:size], y[size:]

    def along(s):
        state = np.r_[q + s * rates, rates]
        return matrix(core.constraints(state)[1], (m, size)) @ rates

    np.testing.assert_allclose(b, -(along(1e-5) - along(-1e-5)) / 2e-5, atol=1e-8)
    multipliers, acceleration = rng.normal(size=m), rng.normal(size=size)
    found = curvature(core, q, multipliers)
    expected = differences(
        lambda x: multipliers @ matrix(core.constraints(np.r_[x, rates])[1], (m, size)), q
    )
    np.testing.assert_allclose(found, expected, atol=1e-8)
    np.testing.assert_allclose(found, found.T, atol=1e-13)

    def missing(z):
        _, triplets, b, _ = core.constraints(z)
        return matrix(triplets, (m, size)) @ acceleration - b

    found = acceleration_derivatives(core, y, acceleration)
    dense = np.hstack([of.toarray() for of in found])
    np.testing.assert_allclose(dense, differences(missing, y), atol=2e-8, rtol=1e-7)


# ----------------------------------------------------------------------------------------- energy


@pytest.mark.parametrize("guided", [False, True])
@pytest.mark.parametrize("drag", [False, True])
@pytest.mark.parametrize(("aspirating", "alpha"), FLOWS)
def test_energy_changes_by_the_power(guided, drag, aspirating, alpha):
    """dE/dtau along the motion, by the energy's derivative in the direction of the rates."""
    n = 4
    made = rich(n, [(GUIDE, n)] * guided, drag=drag, aspirating=aspirating, alpha=alpha)
    y = made.state(1.0)
    if guided:
        a = matrix(made.core.constraints(y)[1], (2 * n + 1, 3 * n))
        y[3 * n :] -= np.linalg.pinv(a) @ (a @ y[3 * n :])
    rates = made.core.rhs(0.0, y, 3.0)
    h = 1e-6
    change = (made.core.energy(y + h * rates) - made.core.energy(y - h * rates)) / (2.0 * h)
    parts = made.core.power(y, 3.0)
    assert change == pytest.approx(sum(parts), rel=1e-6)
    assert (parts[2] != 0.0) == drag
    assert parts[3] < 0.0


def test_energy_and_power_of_a_chain_are_the_chains():
    made = Made(6)
    theta, omega = made.angles()
    y = made.core.from_angles(theta, omega)
    assert made.core.energy(y) == pytest.approx(made.chain.energy(np.r_[theta, omega]), rel=1e-12)
    expected = made.chain.power(np.r_[theta, omega], 5.0)
    np.testing.assert_allclose(made.core.power(y, 5.0), expected, rtol=1e-12)
    rest = np.r_[made.core.straight(), np.zeros(18)]
    assert made.core.energy(rest) == 0.0
    assert Made(6, flow=False).core.power(y, 5.0)[0] == 0.0


# ---------------------------------------------------------------------------------------- closing


def test_projection_meets_guides_and_pins_said_twice_and_says_how_far_it_misses_others():
    twice = [(GUIDE, 5), (PIN, 5, 0.0, 0.8), (GUIDE, 5), (GUIDE, 2)]
    core = Made(5, twice).core
    theta, omega = (0.3 * x for x in Made(5).angles(1.0, members=7))
    met_theta, met_omega, missed = core.project(theta, omega)
    assert missed.max() <= core.met
    for y in core.from_angles(met_theta, met_omega).T:
        g, triplets, _, _ = core.constraints(y)
        assert np.abs(g).max() < 1e-12
        assert np.abs(matrix(triplets, (g.size, 15)) @ y[15:]).max() < 1e-11
    _, again, _ = core.project(met_theta, met_omega)
    np.testing.assert_allclose(again, met_omega, atol=1e-12)
    *_, missed = Made(5, [(PIN, 5, 0.0, 1.3)]).core.project(theta, omega)
    assert np.all((missed >= 0.3 - 1e-12) & (missed < 0.4))  # the pipe's length is 1


# ------------------------------------------------------------------------------------- degenerate


def test_a_direction_without_inertia_is_named():
    free_joint = [group for group in chained(4) if group != (JOINT, 3)]
    made = Made(4, constraints=free_joint)
    y = made.state()
    assert made.core.lacking(y[:12]) == 8  # phi_3 is tied to nothing
    rates = made.core.rhs(0.0, y, 1.0)
    np.testing.assert_array_equal(rates[:12], y[12:])
    assert np.isnan(rates[12:]).all()
    massless_end = {"gyration_radius": np.zeros(4), "center": np.array([0.5, 0.5, 0.5, 0.0])}
    assert Made(4, **massless_end).core.lacking(y[:12]) in (9, 10, 11)
    mass_at_its_end = Made(4, terms=[("point_mass", 1.0, [0.1])], **massless_end)
    assert mass_at_its_end.core.lacking(y[:12]) == -1


def test_a_thousand_straight_segments_at_rest_stay():
    made = Made(1000)
    q = made.core.straight()
    assert made.core.lacking(q) == -1
    rates = made.core.rhs(0.0, np.r_[q, np.zeros(3000)], 5.0)
    assert np.abs(rates).max() < 1e-3  # a spring's moment turns a segment at 1e12 a radian


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"center": np.zeros(2)}, "one entry a segment"),
        ({"springs": [[4, 1, 0, 0]]}, r"spring_joint must lie in 1\.\.3, got 4"),
        ({"springs": [[1, 2]]}, "a row of springs must have 4 entries, got 2"),
        ({"constraints": [(JOINT, 1)]}, "a joint's constraint_node"),
        ({"constraints": [(CLAMP, 2)]}, "a clamp's constraint_node"),
        ({"constraints": [(4, 1)]}, "constraint_kind"),
        ({"inertia": [[0, 9, 1.0]]}, "inertia must lie on the scene's coordinates"),
        ({"inertia": [[0, 1]]}, "a row of inertia must have 3 entries, got 2"),
    ],
)
def test_inconsistent_scenes_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        Made(3, **given)


def test_wrong_sizes_are_refused():
    core = Made(2).core
    with pytest.raises(ValueError, match=r"y must have shape \(12,\)"):
        core.rhs(0.0, np.zeros(11), 1.0)
    with pytest.raises(ValueError, match="as many columns as y"):
        core.rhs(0.0, np.zeros((12, 2)), 1.0, force=np.zeros(6))
    with pytest.raises(ValueError, match="y must have 12 entries, got 6"):
        core.forces(np.zeros(6), 1.0)
    with pytest.raises(ValueError, match="q must have 6 entries, got 3"):
        core.hessians(np.zeros(3))
    with pytest.raises(ValueError, match="omega must have the shape of theta"):
        core.from_angles(np.zeros(2), np.zeros((2, 1)))
