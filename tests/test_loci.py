# SPDX-License-Identifier: MIT
"""Root loci: branches that are followed, not sorted."""

import numpy as np
import pytest
from independent import chain_newton_step, companion_eigenvalues, distances, series_newton_step
from scipy.optimize import linear_sum_assignment

import pipedyn as pp

PIPE = pp.Pipe(0.2)
LONG = pp.Chain(PIPE, 66)
"""Beyond 64 segments the eigenvalues are a few, by sweeps along the chain."""


def followed_by_tiny_steps(model, speeds, step, count):
    """Each pair by nearest neighbours from one speed to the next, refusing what is ambiguous.

    Returns the two roots of each pair, shape (len(speeds), count, 2).
    """
    ops = model.operators()
    start = companion_eigenvalues(*ops.at(speeds[0]))
    upper = start[start.imag > 0.0]
    upper = upper[np.argsort(np.abs(upper))[:count]]
    here = np.concatenate([upper, upper.conj()])
    conjugate = np.roll(np.arange(2 * count), count)
    rows, u = [here], speeds[0]
    for target in speeds[1:]:
        steps = max(1, round((target - u) / step))
        for at in np.linspace(u, target, steps + 1)[1:]:
            values = companion_eigenvalues(*ops.at(at))
            gaps = np.abs(here[:, None] - values[None, :])
            left, right = linear_sum_assignment(gaps)
            mine = right[np.argsort(left)]
            chosen = gaps[np.arange(2 * count), mine]
            # Which root of a pair is which is no matter; whether it is another pair's is.
            gaps[np.arange(2 * count), mine] = gaps[np.arange(2 * count), mine[conjugate]] = np.inf
            assert (chosen < 0.3 * gaps.min(axis=1)).all(), f"ambiguous at u = {at}"
            here = values[mine]
        rows.append(here)
        u = target
    return np.array(rows).reshape(len(speeds), 2, count).transpose(0, 2, 1)


@pytest.mark.parametrize(
    ("model", "end"),
    [
        (pp.Chain(PIPE, 6), 9.0),
        (pp.Galerkin(PIPE, 8), 13.0),
        (pp.Chain(pp.Pipe(0.5, gamma=10.0, damping=1e-3), 7), 12.0),
        (pp.Chain(pp.Pipe(0.3, flow="aspirating", alpha=0.5, damping=1e-3), 8), 8.0),
    ],
    ids=["chain", "beam modes", "heavy", "aspirating"],
)
def test_branches_meet_nearest_neighbours_at_tiny_steps(model, end):
    """Pairs compared by sum and product, which run smoothly where a pair turns real."""
    speeds = np.linspace(0.0, end, 15)
    expected = followed_by_tiny_steps(model, speeds, 1e-2, 4)
    loci = pp.root_loci(model, speeds, count=4)
    sums, products = loci.eigenvalues + loci.partners, loci.eigenvalues * loci.partners
    np.testing.assert_allclose(sums, expected.sum(axis=2), atol=1e-6)
    np.testing.assert_allclose(products, expected.prod(axis=2), rtol=1e-7)


@pytest.mark.parametrize(
    "model",
    [pp.Continuum(PIPE), LONG, pp.Galerkin(PIPE, 12)],
    ids=["continuum", "long chain", "beam"],
)
def test_branches_do_not_depend_on_the_speeds_asked_for(model):
    fine = np.linspace(0.0, 10.0, 21)
    every = pp.root_loci(model, fine, count=4)
    for stride in (4, 20):
        some = pp.root_loci(model, fine[::stride], count=4)
        np.testing.assert_array_equal(some.speeds, fine[::stride])
        np.testing.assert_allclose(some.eigenvalues, every.eigenvalues[::stride], atol=1e-6)
        np.testing.assert_allclose(some.partners, every.partners[::stride], atol=1e-6)


@pytest.mark.parametrize(
    "model",
    [pp.Continuum(PIPE), pp.Chain(PIPE, 20), LONG],
    ids=["continuum", "chain", "long chain"],
)
def test_a_pair_turns_real_and_back_without_a_jump(model):
    """beta = 0.2 near u = 8: a branch meets its conjugate on the real axis."""
    speeds = np.linspace(6.0, 10.0, 81)
    loci = pp.root_loci(model, speeds, count=4)
    real = (loci.eigenvalues.imag == 0.0) & (loci.partners.imag == 0.0)
    at_8 = np.argmin(np.abs(speeds - 8.0))
    assert real[at_8].sum() == 1
    branch = int(np.argmax(real[at_8]))
    assert not real[0].any()
    assert np.flatnonzero(np.diff(real[:, branch])).size == 2
    # Sum and product of a pair run smoothly through the meeting; the roots like a square root.
    total = loci.eigenvalues + loci.partners
    product = loci.eigenvalues * loci.partners
    np.testing.assert_allclose(total.imag, 0.0, atol=1e-8)
    for smooth in (total.real, product.real):
        # A jump would be as large in the second difference as in the first.
        first, second = (np.abs(np.diff(smooth, k, axis=0)).max(axis=0) for k in (1, 2))
        assert (second < 0.25 * first).all()
    greater, lesser = loci.eigenvalues[:, branch].real, loci.partners[:, branch].real
    assert (greater >= lesser).all()
    if isinstance(model, pp.Continuum):
        assert greater[at_8] == pytest.approx(-15.871, rel=0, abs=5.1e-4)
        assert lesser[at_8] == pytest.approx(-24.153, rel=0, abs=5.1e-4)


def test_branches_are_roots_at_every_speed_and_partners_make_up_the_pair():
    model = pp.Chain(pp.Pipe(0.2, damping=1e-3), 12)
    speeds = np.linspace(0.0, 12.0, 49)
    loci = pp.root_loci(model, speeds, count=12)
    assert loci.converged.all()
    for u, values, partners in zip(speeds, loci.eigenvalues, loci.partners, strict=True):
        reference = companion_eigenvalues(*model.operators().at(u))
        both = np.concatenate([values, partners])
        left, right = linear_sum_assignment(np.abs(both[:, None] - reference[None, :]))
        np.testing.assert_allclose(both[left], reference[right], atol=2e-6)
        complex_ones = values.imag != 0.0
        np.testing.assert_allclose(partners[complex_ones], values[complex_ones].conj(), atol=1e-8)
        assert (values.imag >= 0.0).all()
        assert not partners[~complex_ones].imag.any()


def test_a_model_with_fewer_modes_than_four_has_all_its_branches():
    assert pp.root_loci(pp.Chain(PIPE, 2), [0.0, 1.0]).eigenvalues.shape == (2, 2)
    assert pp.root_loci(LONG, [0.0, 1.0]).eigenvalues.shape == (2, 4)
    with pytest.raises(ValueError, match="count must be from 1 to 2, got 4"):
        pp.root_loci(pp.Chain(PIPE, 2), [0.0, 1.0], count=4)


def test_sorting_would_have_exchanged_the_branches():
    """Between u = 8 and 9 the second branch passes the third, by magnitude and by frequency."""
    loci = pp.root_loci(pp.Continuum(PIPE), [0.0, 8.0, 9.0], count=3)
    second, third = loci.eigenvalues[:, 1], loci.eigenvalues[:, 2]
    for size in (np.abs, np.imag):
        np.testing.assert_array_equal(size(second) < size(third), [True, True, False])
    # At 8 the first branch, real there, has the second between its two roots.
    first = np.abs([loci.eigenvalues[1, 0], loci.partners[1, 0]])
    assert first.min() < abs(second[1]) < first.max()


def test_a_buckled_column_starts_with_its_real_pair():
    """gamma = -10: the first pair is real at rest, one root unstable, until 1.797."""
    loci = pp.root_loci(pp.Continuum(pp.Pipe(0.2, gamma=-10.0)), [0.0, 1.7, 1.9, 4.0], count=2)
    first, partner = loci.eigenvalues[:, 0], loci.partners[:, 0]
    assert first[0].imag == partner[0].imag == 0.0
    assert first[0].real > 0.0 > partner[0].real
    assert first[0].real == pytest.approx(-partner[0].real, rel=1e-9)
    assert first[1].real > 0.0 > first[2].real


def test_a_pipe_without_fluid_mass_keeps_to_the_axis_until_two_branches_meet():
    """beta = 0 (Beck's column): frequencies meet at 4.47783, then one grows and one decays."""
    loci = pp.root_loci(pp.Continuum(pp.Pipe(0.0)), [0.0, 2.0, 4.47, 4.49, 5.0], count=3)
    assert not loci.eigenvalues[:3].real.any()
    assert np.sort(loci.eigenvalues[3:, :2].real, axis=1)[:, 0].max() < 0.0
    assert np.sort(loci.eigenvalues[3:, :2].real, axis=1)[:, 1].min() > 0.0
    assert not loci.eigenvalues[:, 2].real.any()


def test_one_speed_is_a_locus_of_one_point():
    loci = pp.root_loci(pp.Chain(PIPE, 5), [3.0], count=5)
    assert loci.eigenvalues.shape == loci.partners.shape == (1, 5)
    assert distances(loci.eigenvalues[0], pp.eigenvalues(pp.Chain(PIPE, 5), 3.0)).max() < 1e-12
    assert loci.size == 5


def test_progress_changes_nothing_but_stderr(terminal):
    speeds = np.linspace(0.0, 8.0, 9)
    quiet = pp.root_loci(pp.Chain(PIPE, 5), speeds)
    assert terminal.readouterr().err == ""
    shown = pp.root_loci(pp.Chain(PIPE, 5), speeds, progress=True)
    assert "root loci: 100 %, 8/8, took" in terminal.readouterr().err
    np.testing.assert_array_equal(shown.eigenvalues, quiet.eigenvalues)


@pytest.mark.parametrize("damping", [0.01, 0.5])
def test_overdamped_modes_do_not_hide_those_asked_for(damping):
    """Roots cluster at -1 / delta below the frequencies of the modes; w1^2 = 12.362 at rest."""
    loci = pp.root_loci(pp.Continuum(pp.Pipe(0.2, damping=damping)), np.linspace(0.0, 9.0, 46), 4)
    products = (loci.eigenvalues[0] * loci.partners[0]).real
    squares = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349]) ** 4
    np.testing.assert_allclose(products, squares, rtol=1e-6)
    critical = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, damping=damping)), 20.0)
    unstable = (loci.eigenvalues.real > 0.0).any(axis=1)
    np.testing.assert_array_equal(unstable, loci.speeds > critical.speed)


@pytest.mark.parametrize("n", [30, 66])  # from all eigenvalues at each speed, and from some
@pytest.mark.parametrize(
    ("pipe", "speeds"),
    [(pp.Pipe(0.2, damping=0.05), (6.0, 14.0, 9)), (pp.Pipe(0.2, -100.0), (0.0, 30.0, 41))],
    ids=["damped", "standing"],
)
def test_a_branch_that_climbs_out_of_the_eigenvalues_computed_is_followed_on(pipe, speeds, n):
    loci = pp.root_loci(pp.Chain(pipe, n), np.linspace(*speeds), 1)
    assert loci.converged.all()
    steps = np.abs(np.diff(loci.eigenvalues, axis=0))
    assert steps.max() < 0.15 * np.abs(loci.eigenvalues).max()


@pytest.mark.parametrize("n", [6, 66])  # all roots, and a few of them
@pytest.mark.parametrize("pipe", [PIPE, pp.Pipe(0.5, gamma=300.0), pp.Pipe(0.3, damping=0.02)])
def test_the_errors_of_a_chains_branches_cover_their_distance_to_exact_roots(pipe, n):
    """Newton's corrections of the chain's equations in 40 digits."""
    chain = pp.Chain(pipe, n)
    loci = pp.root_loci(chain, [0.0, 3.0, 7.0], 4)
    assert loci.errors.shape == loci.eigenvalues.shape
    for i, u in enumerate(loci.speeds):
        for k in (0, 3):
            value = complex(loci.eigenvalues[i, k])
            assert abs(chain_newton_step(chain, value, u, 40)) <= loci.errors[i, k]
            assert loci.errors[i, k] < 1e-9 * abs(value)


def test_the_errors_of_the_pipes_branches_cover_their_distance_to_exact_roots():
    """Newton's corrections from power series; those in the cluster have none."""
    for pipe in (PIPE, pp.Pipe(0.9, gamma=50.0)):
        loci = pp.root_loci(pp.Continuum(pipe), [1.0, 6.0], 3)
        for i, u in enumerate(loci.speeds):
            for value, error in zip(loci.eigenvalues[i], loci.errors[i], strict=True):
                assert abs(series_newton_step(pipe, complex(value), u)) <= error < 1e-7 * abs(value)
    clustering = pp.root_loci(pp.Continuum(pp.Pipe(0.2, damping=0.1)), [1.0], 3).errors
    assert np.isfinite(clustering).any(axis=1).all()
    assert np.isinf(clustering[:, -1]).all()


def test_no_two_branches_go_on_as_one_root_where_roots_crowd():
    """Dozens lie near -1 / damping; each sample's roots are matched as a whole."""
    springs = {"root": pp.RootSpring(271.301), "terms": [pp.Spring(0.820868, 498.994)]}
    pipe = pp.Pipe(0.0291917, damping=0.0589028, alpha=0.9999, end="guided", **springs)
    loci = pp.root_loci(pp.Galerkin(pipe, 40, "legendre"), np.linspace(0.0, 5.5266, 40), count=4)
    gaps = np.abs(loci.eigenvalues[:, :, None] - loci.eigenvalues[:, None])
    assert (gaps + np.eye(4) > 0.0).all()
