# SPDX-License-Identifier: MIT
"""The straight pipe whose flow pulsates: Floquet multipliers and regions of instability.

Edges, which are roots of Hill's determinant, are held against multipliers of the equations
integrated step by step, and against numbers of a separate program by both routes.
"""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import pipedyn as pp
from pipedyn.forced import combinations
from pipedyn.forced.parametric_search import RegionSearch, regions
from pipedyn.forced.pulsating import Hill, PulsatingPipe

PIPE = pp.Pipe(0.2, gamma=10.0)


def integrated(pipe, amplitude, frequency):
    """Multipliers from the identity, integrated over a period."""
    n, inverse = pipe.size, np.linalg.inv(pipe.mass)

    def rates(t, y):
        u = pipe.mean * (1.0 + amplitude * math.cos(frequency * t))
        rate = -pipe.mean * amplitude * frequency * math.sin(frequency * t)
        q, v = y.reshape(2, n, 2 * n)
        stiffness = pipe.stiffness + u**2 * pipe.flux + rate * pipe.unsteady
        force = (pipe.damping + u * pipe.velocity) @ v + stiffness @ q
        return np.stack([v, -inverse @ force]).ravel()

    start, end = np.eye(2 * n).ravel(), 2.0 * math.pi / frequency
    found = solve_ivp(rates, (0.0, end), start, method="DOP853", rtol=1e-11, atol=1e-13)
    return np.linalg.eigvals(found.y[:, -1].reshape(2 * n, 2 * n))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mean", "amplitude", "low", "high"),
    [(4.5, 0.3, 33.062473, 39.994481), (6.0, 0.3, 23.703843, 38.500475)],
)
def test_principal_regions_of_the_second_mode(mean, amplitude, low, high):
    """beta = 0.2, gamma = 10, undamped: a separate program, by Hill and by Magnus."""
    (found,) = pp.parametric_regions(pp.Continuum(PIPE), mean, [amplitude], (34.0, 35.0))
    assert found.kind == "subharmonic"
    np.testing.assert_allclose(found.edges, [[low, high]], atol=1e-6)
    assert found.error <= 1e-7


def test_the_least_amplitude_of_a_region():
    amplitudes = [0.1, 0.2]
    (found,) = pp.parametric_regions(pp.Continuum(PIPE), 5.5, amplitudes, (31.0, 32.0))
    assert found.kind == "subharmonic"
    assert found.error <= 1e-7
    assert found.threshold == pytest.approx(0.1234732, abs=5e-8)
    assert found.threshold_frequency == pytest.approx(31.5835, abs=1e-4)
    assert np.isnan(found.edges[0]).all()
    np.testing.assert_allclose(found.edges[1], [27.431472, 36.229891], atol=1e-6)
    just = [found.threshold * (1.0 + step) for step in (-1e-5, 1e-5)]
    model = pp.Galerkin(PIPE, 14, "legendre")
    below, above = (
        pp.floquet(model, pp.Pulsation(5.5, mu, found.threshold_frequency)) for mu in just
    )
    assert below.stable
    assert not above.stable


@pytest.mark.parametrize("model", [pp.Galerkin(PIPE, 4), pp.Chain(PIPE, 5)], ids=["beam", "chain"])
def test_a_multiplier_is_at_minus_one_on_the_edges(model):
    (found,) = pp.parametric_regions(model, 5.0, 0.3, (28.0, 33.0))
    pipe = PulsatingPipe.of(model.elastic_operators(), 5.0)
    for edge in found.edges[0]:
        sides = [integrated(pipe, 0.3, edge * (1.0 + step)) for step in (-1e-6, 1e-6)]
        nearest = [m[np.argmin(np.abs(m + 1.0))] + 1.0 for m in sides]
        assert nearest[0].real * nearest[1].real < 0.0
        assert np.abs(np.imag(nearest)).max() == 0.0


@pytest.mark.parametrize("damping", [0.0, 0.01])
def test_multipliers_by_two_routes(damping):
    model = pp.Galerkin(dataclasses.replace(PIPE, damping=damping), 5)
    found = pp.floquet(model, pp.Pulsation(6.0, 0.4, 20.0))
    expected = integrated(PulsatingPipe.of(model.operators(), 6.0), 0.4, 20.0)
    for one in found.multipliers:
        assert np.abs(expected - one).min() < 1e-7
    assert found.error <= 1e-7
    largest = np.abs(expected).max()
    assert found.growth == pytest.approx(math.log(largest) * 20.0 / (2.0 * math.pi), abs=1e-6)
    assert found.stable == (largest <= 1.0)


def test_a_steady_flow_has_the_multipliers_of_its_eigenvalues():
    model = pp.Chain(PIPE, 6)
    found = pp.floquet(model, pp.Pulsation(5.0, 0.0, 9.0))
    expected = np.exp(pp.eigenvalues(model, 5.0) * 2.0 * math.pi / 9.0)
    np.testing.assert_allclose(np.sort(np.abs(found.multipliers)), np.sort(np.abs(expected)))


def test_the_continuous_pipe_has_the_multipliers_of_many_functions():
    found = pp.floquet(pp.Continuum(PIPE), pp.Pulsation(6.0, 0.3, 30.0))
    other = pp.floquet(pp.Galerkin(PIPE, 26, "legendre"), pp.Pulsation(6.0, 0.3, 30.0))
    assert found.multipliers[0] == pytest.approx(other.multipliers[0], rel=1e-6)


@pytest.mark.slow
def test_regions_of_chains_converge_with_second_order():
    expected = np.array([27.431472, 36.229891, 0.1234732])
    errors = []
    for n in (7, 14, 28):
        hill = Hill(PulsatingPipe.of(pp.Chain(PIPE, n).elastic_operators(), 5.5), 5)
        (found,) = regions(hill, np.array([0.2]), 31.0, 32.0, ("subharmonic",))
        errors.append(np.abs(np.append(found.edges[0], found.bottom[0]) - expected))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.15)
    np.testing.assert_allclose(orders[1], 2.0, atol=0.06)


def test_regions_without_the_fluids_acceleration_are_wrong_by_a_fifth():
    pipe = PulsatingPipe.of(pp.Galerkin(PIPE, 10, "legendre").elastic_operators(), 6.0)
    without = dataclasses.replace(pipe, unsteady=0.0 * pipe.unsteady)
    (found,) = regions(Hill(without, 5), np.array([0.3]), 30.0, 31.0)
    np.testing.assert_allclose(found.edges, [[24.861, 36.718]], atol=1e-3)


def conservative(mean, functions=9, **ends):
    """Hill's equations of a pipe held at both ends, beta = 0.5."""
    model = pp.Galerkin(pp.Pipe(0.5, **ends), functions, "legendre")
    return Hill(PulsatingPipe.of(model.elastic_operators(), mean), 4)


def test_regions_of_a_pipe_pinned_at_both_ends_begin_at_amplitude_zero():
    """u = 2: a separate program; the mode's frequency by its converged digits."""
    hill = conservative(2.0, root="pinned", end="pinned")
    assert hill.is_hermitian
    (one,) = regions(hill, np.array([0.1]), 14.0, 16.0, ("subharmonic",))
    np.testing.assert_allclose(one.edges, [[14.093116, 15.698815]], atol=2e-6)
    np.testing.assert_allclose(one.bottom[:2], [0.0, 2.0 * 7.45357311], atol=1e-7)


def test_principal_and_combination_regions_of_a_pipe_clamped_at_both_ends():
    """u = 4: a separate program; frequencies of the modes by their converged digits."""
    kinds = "subharmonic", "combination"
    found = regions(conservative(4.0, end="clamped"), np.array([0.1]), 34.0, 36.5, kinds)
    (one,) = [r for r in found if r.kind == "subharmonic" and r.edges[0, 0] < 32 < r.edges[0, 1]]
    np.testing.assert_allclose(one.edges, [[30.850958, 34.254095]], atol=2e-6)
    np.testing.assert_allclose(one.bottom[:2], [0.0, 2.0 * 16.30777486], atol=1e-6)
    (one,) = [r for r in found if r.kind == "combination"]
    np.testing.assert_allclose(one.edges, [[36.181805, 36.381321]], atol=2e-6)
    np.testing.assert_allclose(one.bottom[:2], [0.0, 0.5 * (16.30777486 + 56.12714690)], atol=1e-6)


def test_two_thin_intervals_between_edges_may_be_neighbours():
    """Whether motions grow in one depends on its neighbours, without asking for ever."""
    hill = conservative(2.0, root="pinned", end="pinned")
    search = RegionSearch(hill, np.array([0.1]), 14.0, 16.0)
    edges = np.array([14.0, 14.0001, 14.0002, 15.7])
    assert search._unstable(0.5, 0.1, edges, 0, 4) == [(14.0, 14.0002)]


def test_both_edges_of_a_thin_combination_region_are_found():
    """Motions grow just inside and not just outside: by multipliers."""
    hill = conservative(3.0, 12, end="pinned")
    (one,) = regions(hill, np.array([0.1]), 28.5, 30.0, ("combination",))
    ((left, right),) = one.edges
    assert 1e-3 < right / left - 1.0 < 5e-3
    for edge, way in ((left, 1.0), (right, -1.0)):
        outside, inside = (
            np.abs(hill.pipe.multipliers(0.1, edge + way * share * (right - left))[0]).max()
            for share in (-0.1, 0.1)
        )
        assert outside < 1.0 + 1e-6
        assert inside > 1.0 + 1e-4


@pytest.mark.parametrize(
    ("hill", "low", "high", "edges"),
    [
        pytest.param(
            *(conservative(3.0, 8, end="pinned"), 29.2, 29.4, (29.3072, 29.3185)),
            marks=pytest.mark.slow,
        ),
        (conservative(2.0, root="pinned", end="pinned"), 24.9, 25.2, (24.7946, 24.8070)),
    ],
    ids=["beside another", "beside the axis"],
)
def test_thin_regions_beside_what_changes_are_found(hill, low, high, edges):
    """Beside a region, and where multipliers have just left the real axis: by multipliers."""
    found = regions(Hill(hill.pipe, 6), np.array([0.5]), low, high, ("combination",))
    ((left, right),) = found[-1].edges
    assert (left, right) == pytest.approx(edges, abs=1e-4)
    for w, grows in ((left - 1e-3, False), (0.5 * (left + right), True), (right + 1e-3, False)):
        assert (np.abs(hill.pipe.multipliers(0.5, w)[0]).max() > 1.0 + 1e-5) == grows


def test_a_combination_region_may_end_with_a_multiplier_at_minus_one():
    """Two multipliers meet on the real axis, from which one comes back: by multipliers."""
    model = pp.Galerkin(pp.Pipe(0.4), 6, "legendre")
    hill = Hill(PulsatingPipe.of(model.elastic_operators(), 6.5), 10)
    (one,) = regions(hill, np.array([0.6]), 9.5, 10.5, ("combination",))
    np.testing.assert_allclose(one.edges, [[8.3608, 10.4537]], atol=1e-3)
    for edge, inward in zip(one.edges[0], (1e-4, -1e-4), strict=True):
        sides = [hill.pipe.multipliers(0.6, edge + side * inward)[0][0] for side in (-1, 1)]
        assert abs(sides[0]) < 1.0 < abs(sides[1])
    assert sides[1].imag != 0.0
    assert one.nus[0, 0] == pytest.approx(0.5 * one.edges[0, 0])


def growing(model, pulsation, frequency):
    """By how much motions grow in a period, by multipliers."""
    at = dataclasses.replace(pulsation, frequency=frequency)
    return np.abs(pp.floquet(model, at).multipliers[0]) - 1.0


CLAMPED = pp.Galerkin(pp.Pipe(0.5, end="clamped"), 6, "legendre")
PINNED = pp.Galerkin(pp.Pipe(0.5, root="pinned", end="pinned"), 6, "legendre")


@pytest.mark.parametrize(
    ("model", "pulsation", "frequencies", "kind", "edges"),
    [
        (CLAMPED, (4.0, 0.2), (53.3, 53.5), "combination", (53.408805, 53.409365)),
        pytest.param(
            *(CLAMPED, (4.0, 0.3), [14.0, 14.5], "combination", (14.297402, 14.299242)),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *(PINNED, (2.0, 0.3), np.array([25.2, 25.4]), "combination", (25.236294, 25.236417)),
            marks=pytest.mark.slow,
        ),
        (PINNED, (2.0, 0.2), (25.0, 25.2), "subharmonic", (25.043155, 25.046724)),
    ],
    ids=["clamped", "clamped, slow", "pinned", "pinned, on the axis"],
)
def test_thin_regions_of_conservative_pipes_have_both_edges(
    model, pulsation, frequencies, kind, edges
):
    """Edges by a scan of multipliers."""
    mean, amplitude = pulsation
    (found,) = pp.parametric_regions(model, mean, [amplitude], frequencies)
    assert found.kind == kind
    assert found.threshold == 0.0
    np.testing.assert_allclose(found.edges, [edges], atol=1e-6)
    ((left, right),) = found.edges
    step = 0.05 * (right - left)
    for edge, inward in ((left, step), (right, -step)):
        assert growing(model, pp.Pulsation(mean, amplitude, 1.0), edge - inward) < 1e-7
        assert growing(model, pp.Pulsation(mean, amplitude, 1.0), edge + inward) > 1e-6


@pytest.mark.slow
def test_a_wide_combination_region_of_a_conservative_pipe_has_both_edges():
    """Its edges are not alike, and the saddle between them is not in their middle."""
    model = pp.Galerkin(pp.Pipe(0.54, root="pinned", end="pinned"), 5, "legendre")
    (found,) = pp.parametric_regions(model, 1.7, 0.5, (46.0, 47.0))
    assert found.kind == "combination"
    np.testing.assert_allclose(found.edges, [[43.464884, 48.543355]], atol=1e-6)
    for edge, inward in zip(found.edges[0], (1e-4, -1e-4), strict=True):
        assert growing(model, pp.Pulsation(1.7, 0.5, 1.0), edge - inward) < 1e-7
        assert growing(model, pp.Pulsation(1.7, 0.5, 1.0), edge + inward) > 1e-4


def test_combination_regions_side_by_side_leave_the_gaps_between_them():
    """Three regions of which two have met at the higher amplitude: by multipliers."""
    ends = {"root": "pinned", "end": "pinned"}
    model = pp.Chain(pp.Pipe(0.8457, 18.75, **ends), 6, springs="consistent")
    amplitudes = [0.15, 0.197]
    found = pp.parametric_regions(model, 2.082, amplitudes, (66.0, 67.2))
    assert [one.kind for one in found] == ["combination"] * 3
    pipe = PulsatingPipe.of(model.elastic_operators(), 2.082)
    for index, intervals in enumerate((3, 2)):
        edges = np.unique([one.edges[index].round(9) for one in found], axis=0)
        assert len(edges) == intervals
        for w in np.linspace(66.0, 67.2, 121):
            grows = np.abs(pipe.multipliers(amplitudes[index], w)[0][0]) > 1.0 + 1e-6
            assert grows == ((edges[:, 0] < w) & (w < edges[:, 1])).any()


def test_a_combination_region_is_followed_beyond_the_range():
    """It begins on the edge of a subharmonic region, which multipliers leave together."""
    model = pp.Galerkin(pp.Pipe(0.0, 8.0, damping=1e-3), 5, "legendre")
    found = pp.parametric_regions(model, 2.64, 0.31, (10.0, 11.6))
    ((left, right),) = next(one.edges for one in found if one.kind == "combination")
    assert right > 1.1 * 11.6
    for w, grows in ((left + 1e-3, True), (right - 1e-3, True), (right + 1e-3, False)):
        assert (growing(model, pp.Pulsation(2.64, 0.31, 1.0), w) > 0.0) == grows
    for w in np.linspace(left, right, 9)[1:-1]:
        assert growing(model, pp.Pulsation(2.64, 0.31, 1.0), w) > 1e-3


def test_regions_where_the_mean_square_of_the_speed_buckles_the_pipe():
    """The lowest mode does not oscillate in the mean, but takes part in what grows."""
    pipe = pp.Pipe(0.46, 0.86, damping=2.3e-3, root="pinned", end="pinned")
    model, pulsation = pp.Galerkin(pipe, 3, "legendre"), pp.Pulsation(3.156, 0.54, 1.0)
    found = pp.parametric_regions(model, 3.156, 0.54, (29.0, 70.0))
    ((left, right),) = next(one.edges for one in found if one.kind == "combination")
    for w in np.linspace(29.0, 70.0, 42):
        assert (growing(model, pulsation, w) > 0.0) == (left < w < right)


@pytest.mark.slow
def test_edges_of_a_large_model_follow_from_its_lowest_modes():
    """Multipliers are those of all its degrees of freedom."""
    model = pp.Chain(PIPE, 31)
    (found,) = pp.parametric_regions(model, 5.5, 0.2, (31.0, 32.0))
    for edge, inward in zip(found.edges[0], (1e-5, -1e-5), strict=True):
        assert growing(model, pp.Pulsation(5.5, 0.2, 1.0), edge * (1.0 - inward)) < 1e-7
        assert growing(model, pp.Pulsation(5.5, 0.2, 1.0), edge * (1.0 + inward)) > 1e-7


@pytest.mark.slow
def test_regions_that_overlap_are_told_as_their_union():
    """Two harmonic regions without a gap at amplitude 0.3, and with one at 0.2: by multipliers."""
    model = pp.Galerkin(pp.Pipe(0.0, 10.0), 6, "legendre")
    (one,) = pp.parametric_regions(model, 2.0, 0.3, (5.4, 6.0))
    np.testing.assert_allclose(one.edges, [[5.670518, 5.688389]], atol=1e-6)
    for w in np.linspace(*one.edges[0], 9)[1:-1]:
        assert growing(model, pp.Pulsation(2.0, 0.3, 1.0), w) > 1e-4
    hill = Hill(PulsatingPipe.of(model.elastic_operators(), 2.0), 8)
    left, right = regions(hill, np.array([0.2, 0.3]), 5.4, 6.0, ("harmonic",))
    np.testing.assert_array_equal(left.edges[1], right.edges[1])
    np.testing.assert_allclose(left.edges, [[5.659389, 5.667712], one.edges[0]], atol=1e-6)
    assert growing(model, pp.Pulsation(2.0, 0.2, 1.0), left.edges[0].mean()) > 1e-3
    between = 0.5 * (left.edges[0, 1] + right.edges[0, 0])
    assert growing(model, pp.Pulsation(2.0, 0.2, 1.0), between) < 1e-7
    assert growing(model, pp.Pulsation(2.0, 0.2, 1.0), right.edges[0].mean()) > 1e-6


@pytest.mark.parametrize(
    ("beta", "damping", "amplitudes", "frequencies"),
    [
        pytest.param(0.5, 1e-5, [0.2, 0.4], (24.5, 25.1), marks=pytest.mark.slow),
        (0.3, 1e-4, [0.2], (14.0, 15.0)),
    ],
    ids=["thin", "principal"],
)
def test_the_least_amplitude_of_a_region_of_a_lightly_damped_pipe(
    beta, damping, amplitudes, frequencies
):
    """Edges turn within a millionth of the frequency, or at an amplitude of 0.001."""
    pipe = pp.Pipe(beta, root="pinned", end="pinned", damping=damping)
    model = pp.Galerkin(pipe, 6, "legendre")
    (found,) = pp.parametric_regions(model, 2.0, amplitudes, frequencies)
    np.testing.assert_array_equal(
        np.isnan(found.edges).all(axis=1), np.array(amplitudes) < found.threshold
    )
    for side, grows in ((-1e-4, False), (1e-4, True)):
        at = pp.Pulsation(2.0, found.threshold * (1.0 + side), 1.0)
        assert (growing(model, at, found.threshold_frequency) > 0.0) == grows


@pytest.mark.slow
def test_a_region_whose_multipliers_turn_all_the_way_round_the_circle():
    """They pass the real axis on both sides, and leave the circle, alone, between 1 and -1."""
    model = pp.Galerkin(PIPE, 6, "legendre")
    every = pp.parametric_regions(model, 5.5, 0.6, (8.0, 9.0))
    (found,) = [one for one in every if one.kind == "combination"]
    ((left, right),) = found.edges
    for w, grows in ((left - 1e-4, False), (left + 1e-4, True), (right - 1e-4, True)):
        assert (growing(model, pp.Pulsation(5.5, 0.6, 1.0), w) > 0.0) == grows
    for w in np.linspace(left, right, 9)[1:-1]:
        assert growing(model, pp.Pulsation(5.5, 0.6, 1.0), w) > 1e-2
    assert growing(model, pp.Pulsation(5.5, 0.6, 1.0), right + 1e-4) < 0.0


MODEL = pp.Galerkin(PIPE, 4)


@pytest.mark.parametrize(
    ("seed", "damping"),
    [(0, 0.0), (1, 1e-3), pytest.param(1, 0.0, marks=pytest.mark.slow), (0, 1e-3)],
)
def test_pipes_are_unstable_inside_of_all_edges_and_stable_outside(seed, damping):
    random = np.random.default_rng(seed)
    held = dict([[("root", "pinned"), ("end", "pinned")], [("end", "clamped")]][seed])
    beta, mean = random.uniform(0.1, 0.8), random.uniform(1.0, 2.5)
    model = pp.Galerkin(pp.Pipe(beta, damping=damping, **held), 5, "legendre")
    omega = np.sort(pp.eigenvalues(model, mean).imag)
    first, second = omega[omega > 0.0][:2]
    amplitude = random.uniform(0.2, 0.4)
    ends = sorted([0.45 * (first + second), 2.1 * first])
    found = pp.parametric_regions(model, mean, amplitude, ends)
    edges = np.concatenate([one.edges for one in found])
    assert found
    assert np.isfinite(edges).all()
    for left, right in edges:
        step = min(1e-5 * left, 0.1 * (right - left))
        for edge, inward in ((left, step), (right, -step)):
            at = pp.Pulsation(mean, amplitude, 1.0)
            assert growing(model, at, edge + inward) > 0.0
            others = (edges[:, 0] < edge - inward) & (edge - inward < edges[:, 1])
            assert growing(model, at, edge - inward) < 1e-7 or others.any()


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_edges_are_all_real_eigenvalues_of_the_quadratic_problem(share):
    """The problem in w^2 has the roots of that in w, of twice the size."""
    hill, amplitude = Hill(PulsatingPipe.of(MODEL.elastic_operators(), 5.0), 8), 0.6
    of = hill.polynomial(share)
    zero, slope, bend = of(0.0, amplitude), of.by((0,), 0.0, amplitude), of.by((0, 0), 0.0, 0.6)
    upper = -np.linalg.solve(zero, np.hstack([slope, 0.5 * bend]))
    values = np.linalg.eigvals(np.vstack([upper, np.eye(len(zero), 2 * len(zero))]))
    every = 1.0 / values[np.abs(values) > 1e-9]
    expected = np.sort(every[np.abs(every.imag) < 1e-8 * np.abs(every)].real)
    found = hill.edges(share, amplitude, 30.0)
    assert found.size > 3
    np.testing.assert_allclose(found, expected[expected > 0.0], rtol=1e-9)


@pytest.mark.parametrize(("beta", "mean", "low"), [(0.2, 5.5, 6.0), (0.3, 6.0, 8.0)])
def test_growth_is_where_a_scan_with_small_steps_everywhere_finds_it(beta, mean, low, monkeypatch):
    model = pp.Galerkin(pp.Pipe(beta, 10.0), 6, "legendre")
    hill, counts, intervals = Hill(PulsatingPipe.of(model.elastic_operators(), mean), 18), [], []
    for widest in (combinations.WIDEST_STEP, 1):
        monkeypatch.setattr(combinations, "WIDEST_STEP", widest)
        few = combinations.FewModes(hill, 0.6, low, 60.0)
        seen = few.scanned(low, 60.0)
        counts.append(len(seen))
        (growth,) = few.unstable(seen)
        intervals.append([end.inside.frequency for end in growth])
    assert counts[0] < counts[1]
    np.testing.assert_allclose(*intervals, rtol=1e-5)


def test_progress_tells_the_share_of_amplitudes_and_of_regions(terminal):
    pp.parametric_regions(MODEL, 5.0, [0.1, 0.3], (28.0, 33.0), progress=True)
    told = terminal.readouterr().err
    kinds = "subharmonic", "harmonic", "combination"
    for line in (*(f"{kind} regions" for kind in kinds), "edges with more harmonics"):
        assert line in told


RANGE = "frequencies must be a range (low, high), low < high"


@pytest.mark.parametrize(
    ("arguments", "error", "rule"),
    [
        ((MODEL, 5.0, 1.0, (20.0, 30.0)), ValueError, "amplitudes must be below 1, beyond which"),
        ((MODEL, 5.0, [], (20.0, 30.0)), ValueError, "amplitudes must have from 1 to"),
        ((MODEL, 5.0, 0.1, (30.0, 30.0)), ValueError, RANGE),
        ((MODEL, 5.0, 0.1, (1.0, 30.0)), ValueError, "frequencies must have 0 < low and high <="),
        ((MODEL, 5.0, 0.1, [20.0]), ValueError, RANGE),
        ((MODEL, 9.0, 0.1, (20.0, 30.0)), ValueError, "mean must be a speed at which the pipe"),
    ],
)
def test_bad_arguments_of_regions_are_named(arguments, error, rule):
    with pytest.raises(error) as refused:
        pp.parametric_regions(*arguments)
    assert str(refused.value).startswith(rule)


def test_bad_arguments_of_floquet_are_named():
    with pytest.raises(
        ValueError, match=r"amplitude must lie in \[-1, 1\] or the flow reverses, got 1.5"
    ):
        pp.floquet(MODEL, pp.Pulsation(5.0, 1.5, 20.0))
    with pytest.raises(TypeError, match=r"pulsation must be a Pulsation, got 5\.0"):
        pp.floquet(MODEL, 5.0)
    with pytest.raises(ValueError, match="model must have at most 100 degrees of freedom"):
        pp.floquet(pp.Chain(PIPE, 200), pp.Pulsation(5.0, 0.1, 20.0))
    with pytest.raises(pp.NotConverged, match="the multipliers were not found: they overflow"):
        pp.floquet(MODEL, pp.Pulsation(12.0, 0.1, 0.05))


def test_a_loss_factor_has_no_motion_to_pulsate():
    model = pp.Galerkin(pp.Pipe(0.2, hysteresis=0.02), 4)
    with pytest.raises(ValueError, match="hysteresis must be 0 where the flow pulsates"):
        pp.floquet(model, pp.Pulsation(4.0, 0.1, 20.0))
    with pytest.raises(ValueError, match="hysteresis must be 0 where the flow pulsates"):
        pp.parametric_regions(model, 4.0, 0.1, (20.0, 30.0))
    with pytest.raises(ValueError, match="model must be a pipe without hysteresis"):
        pp.forced_response(model, 4.0, base=pp.Harmonic(0.1, 9.0))


def test_a_pipe_that_does_not_oscillate_has_no_regions():
    """Its damping is so strong that no multiplier is complex at any frequency."""
    terms = pp.Viscosity(sigma=112.205), pp.Damper(at=1.0, coefficient=77.8193)
    model = pp.Galerkin(pp.Pipe(0.0, terms=terms), 3)
    found = pp.parametric_regions(model, 3.372, [0.073, 0.251], (2.079, 7.754))
    assert found.regions == ()
    pipe = PulsatingPipe.of(model.operators(), 3.372)
    for frequency in (6.1, 7.7):
        assert np.abs(integrated(pipe, 0.251, frequency)).max() < 1.0
