# SPDX-License-Identifier: MIT
"""Root loci: branches that are followed, not sorted."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from independent import chain_newton_step, companion_eigenvalues, distances, series_newton_step
from saved_things import path_of
from scipy.optimize import linear_sum_assignment

import pipedyn as pp
from pipedyn.linear.following import RootFollower
from pipedyn.linear.loci import branches_followed
from pipedyn.linear.neutral import eigenvalues_of

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


HOSE = pp.Pipe(0.225, gamma=998.0)
"""1.2 m of silicone tube, which flutters in its fifth mode at u = 23.4 and, up to 36, in the sixth,
seventh and eighth as well."""


def missed(model, loci, tolerance=1e-6):
    """Growing eigenvalues of dense matrices, below |lambda| = 2000, that no branch has."""
    found = []
    for u, values, partners in zip(loci.speeds, loci.eigenvalues, loci.partners, strict=True):
        roots = companion_eigenvalues(*model.operators().at(u))
        grows = (roots.real > 1e-5 * (1.0 + np.abs(roots))) & (np.abs(roots) < 2000.0)
        apart = np.abs(np.concatenate([values, partners])[:, None] - roots[grows]).min(axis=0)
        found += roots[grows][apart > tolerance * (1.0 + np.abs(roots[grows]))].tolist()
    return found


@pytest.mark.parametrize(
    "model",
    [
        pp.Continuum(HOSE),
        *(pp.Chain(HOSE, n) for n in (10, 40, 100)),
        *(pp.Galerkin(HOSE, 16, basis) for basis in ("beam", "legendre")),
    ],
    ids=["continuum", "10 segments", "40 segments", "100 segments", "beam", "legendre"],
)
def test_every_mode_of_a_hose_that_flutters_has_a_branch(model):
    for speeds in (np.linspace(0.0, 36.0, 37), np.array([20.0, 28.0, 36.0])):
        loci = pp.root_loci(model, speeds, count=2)
        flutters = {one.mode for one in pp.crossings(model, 36.0) if one.destabilising}
        assert loci.modes.tolist() == sorted({1, 2, *flutters})
        assert loci.complete
        dense = model.frozen(60) if isinstance(model, pp.Continuum) else model
        assert missed(dense, loci) == []
    assert pp.root_loci(model, [0.0, 18.0], count=2).modes.tolist() == [1, 2]


def test_a_branch_that_grows_only_between_two_speeds_is_followed():
    """The sixth mode flutters from 29.365 to 30.375."""
    loci = pp.root_loci(pp.Continuum(HOSE), [0.0, 29.0, 30.5], count=2)
    assert loci.modes.tolist() == [1, 2, 5, 6]
    assert (loci.eigenvalues[1:, 3].real < 0.0).all()


def test_slopes_tell_that_a_root_grows_between_two_speeds_only():
    """As known from its crossings, for pipes of which these are not known."""
    follower = RootFollower(pp.Galerkin(HOSE, 40, "legendre"))
    sixth = [one.speed for one in pp.crossings(pp.Continuum(HOSE), 31.0) if one.mode == 6]
    assert sixth == pytest.approx([29.365, 30.375], abs=1e-3)
    between = follower.between(29.0, 30.5)
    assert any(sixth[0] < u < sixth[1] for u in between)
    assert follower.between(10.0, 10.5) == []


def test_modes_are_counted_from_rest_wherever_the_speeds_begin():
    for model in (pp.Continuum(HOSE), pp.Chain(HOSE, 20)):
        from_rest = pp.root_loci(model, [0.0, 26.0, 28.0], count=6)
        later = pp.root_loci(model, [26.0, 28.0], count=6)
        np.testing.assert_array_equal(later.modes, from_rest.modes)
        np.testing.assert_array_equal(later.speeds, [26.0, 28.0])
        np.testing.assert_allclose(later.eigenvalues, from_rest.eigenvalues[1:], rtol=1e-6)


def random_pipe(rng):
    """A pipe, often buckled or aspirating, damped or held at both ends, with terms or without."""
    terms = []
    if rng.random() < 0.3:
        terms.append(pp.Spring(rng.uniform(0.2, 0.95), 10.0 ** rng.uniform(0.0, 3.0)))
    if rng.random() < 0.3:
        place = 1.0 if rng.random() < 0.5 else rng.uniform(0.2, 0.95)
        terms.append(pp.PointMass(at=place, mass=10.0 ** rng.uniform(-2.0, 0.5)))
    end = "free"
    if place_is_free := all(getattr(one, "at", 0.0) < 1.0 for one in terms):
        end = rng.choice(["free", "free", "pinned", "clamped", "guided"])
    flow = "aspirating" if place_is_free and rng.random() < 0.3 else "ejecting"
    return pp.Pipe(
        rng.uniform(0.01, 0.95),
        gamma=rng.choice([0.0, 10.0, -5.0, 100.0, 1000.0, -100.0]),
        damping=rng.choice([0.0, 0.0, 1e-4, 1e-3, 1e-2]),
        flow=str(flow),
        end=str(end),
        terms=terms,
    )


@pytest.mark.parametrize("seed", range(15))
def test_no_growing_root_of_random_pipes_is_missed_by_their_branches(seed):
    """Against all eigenvalues of dense matrices; where branches are not complete, they say so."""
    rng = np.random.default_rng(seed)
    complete = 0
    for _ in range(6):
        pipe, end = random_pipe(rng), rng.choice([6.0, 10.0, 16.0, 30.0])
        for model in (
            pp.Chain(pipe, int(rng.integers(3, 20))),
            pp.Galerkin(pipe, int(rng.integers(3, 20)), str(rng.choice(["beam", "legendre"]))),
        ):
            speeds = np.linspace(rng.choice([0.0, end / 2.0]), end, 21)
            with warnings.catch_warnings(record=True) as seen:
                warnings.simplefilter("always", pp.BranchesMissing)
                loci = pp.root_loci(model, speeds, 1)
            assert loci.complete == (not seen)
            assert loci.eigenvalues.shape == (21, loci.modes.size)
            assert not (loci.complete and missed(model, loci)), (pipe, model)
            complete += loci.complete or (pipe.flow == "aspirating" and not pipe.damping)
    assert complete >= 11


def test_all_branches_of_a_pipe_that_two_modes_buckle_are_different_pairs():
    """The greater roots of two real pairs meet: one branch has this pair, the other the rest."""
    pipe = pp.Pipe(0.458, gamma=-100.0, terms=[pp.PointMass(at=0.535, mass=0.085)])
    for model in (pp.Galerkin(pipe, 4, "beam"), pp.Galerkin(pipe, 4), pp.Chain(pipe, 6)):
        speeds = np.linspace(0.0, 30.0, 61)
        loci = pp.root_loci(model, speeds, count=model.dof)
        for u, values, partners in zip(speeds, loci.eigenvalues, loci.partners, strict=True):
            both = np.concatenate([values, partners])
            reference = companion_eigenvalues(*model.operators().at(u))
            left, right = linear_sum_assignment(np.abs(both[:, None] - reference[None, :]))
            np.testing.assert_allclose(both[left], reference[right], atol=1e-5, rtol=1e-6)


def test_modes_that_buckle_at_rest_have_branches_whatever_the_count():
    for model in (pp.Continuum(pp.Pipe(0.2, -1000.0)), pp.Chain(pp.Pipe(0.2, -1000.0), 30)):
        growing = int(np.sum(pp.eigenvalues(model, 0.0, 20).real > 0.0))
        loci = pp.root_loci(model, [0.0, 1.0], count=1)
        assert growing > 3
        assert loci.modes.tolist() == [*range(1, growing + 1)]
        assert (loci.eigenvalues[0].real > 0.0).all()


@pytest.mark.parametrize("damping", [1e-6, 1e-5, 1e-3])
def test_every_mode_of_an_aspirating_pipe_that_grows_in_spite_of_damping_has_a_branch(damping):
    pipe = pp.Pipe(0.2, flow="aspirating", alpha=0.5, damping=damping)
    for model in (pp.Continuum(pipe), pp.Chain(pipe, 12)):
        loci = pp.root_loci(model, np.linspace(0.0, 8.0, 13), count=2)
        grow = np.count_nonzero(pp.eigenvalues(model, 8.0, 24).real > 0.0) // 2
        assert (loci.eigenvalues[-1, :2].real > 0.0).all()
        assert loci.complete
        assert loci.missing == ""
        assert loci.modes.size >= grow > 2


def warned_of(model, speeds, count):
    """Root loci that are not complete, which the warning says with their words."""
    with pytest.warns(pp.BranchesMissing) as seen:
        loci = pp.root_loci(model, speeds, count)
    assert [one.filename for one in seen] == [__file__]
    assert str(seen[0].message).startswith(f"{loci.missing} (warnings.filterwarnings")
    assert not loci.complete
    return loci


def test_an_aspirating_pipe_without_damping_says_how_many_modes_grow_without_a_branch():
    """All grow from the smallest flow on; those of a chain have branches if asked for."""
    pipe = pp.Pipe(0.2, flow="aspirating", alpha=0.5)
    speeds = np.linspace(0.0, 6.0, 13)
    every = "without damping inflow makes all modes grow, and"
    loci = warned_of(pp.Continuum(pipe), speeds, 2)
    assert loci.missing == f"{every} those beyond 2 have no branch: take a larger count"
    for n in (12, 80):
        chain = pp.Chain(pipe, n)
        few = warned_of(chain, speeds, 2)
        assert few.missing == f"{every} {n - 2} of {n} have no branch: take count={n}"
        assert (few.eigenvalues[1:].real > 0.0).all()
        loci = pp.root_loci(chain, speeds, count=n)
        assert loci.complete
        assert (loci.eigenvalues[4].real > 0.0).all()


def test_more_modes_that_grow_than_fit_a_picture_get_branches_if_they_are_asked_for():
    chain = pp.Chain(pp.Pipe(0.2, -1e5), 60)
    loci = warned_of(chain, [0.0, 1.0], 4)
    assert loci.modes.tolist() == [*range(1, 35)]
    assert loci.missing == "22 modes beyond 34 grow: take count=56"
    assert pp.root_loci(chain, [0.0, 1.0], 56).complete
    mass = pp.Continuum(pp.Pipe(0.2, terms=[pp.PointMass(1.0, 0.5)]))  # any mode may grow
    loci = warned_of(mass, [0.0, 10.0, 20.0], 4)
    assert loci.missing == "modes beyond 34 grow, or may grow: take a larger count"


def test_chains_of_thousands_of_segments_have_the_branches_of_the_continuous_pipe():
    speeds = [0.0, 20.0, 24.0, 30.0]
    exact = pp.root_loci(pp.Continuum(HOSE), speeds, 2)
    for n in (2001, 5000):
        loci = pp.root_loci(pp.Chain(HOSE, n), speeds, 2)
        assert loci.complete
        assert loci.modes.tolist() == exact.modes.tolist() == [1, 2, 5, 6]
        np.testing.assert_allclose(loci.eigenvalues, exact.eigenvalues, rtol=1e-4, atol=1e-4)
    unsure = "only a chain of up to 2000 segments tells: take fewer"
    lossy = warned_of(pp.Chain(pp.Pipe(0.2, hysteresis=0.01), 2001), [0.0, 3.0], 2)
    assert unsure in lossy.missing
    for flow in ("ejecting", "aspirating"):  # the search does not meet the overdamped roots
        pipe = pp.Pipe(0.2, flow=flow, damping=1e-3)
        exact = pp.root_loci(pp.Continuum(pipe), [0.0, 1.0, 3.0])
        ask = pp.root_loci if flow == "ejecting" else warned_of
        loci = ask(pp.Chain(pipe, 2500), [0.0, 1.0, 3.0], 4)
        assert loci.complete == (flow == "ejecting")
        assert flow == "ejecting" or unsure in loci.missing
        np.testing.assert_allclose(loci.eigenvalues, exact.eigenvalues, rtol=1e-4, atol=1e-4)


def test_hysteretic_branches_that_grow_are_followed():
    model = pp.Chain(pp.Pipe(0.225, gamma=998.0, hysteresis=0.02), 20)
    loci = pp.root_loci(model, [0.0, 20.0, 34.0], count=2)
    roots = pp.eigenvalues(model, 34.0)
    growing = roots[(roots.real > 0.0) & (roots.imag > 0.0)]
    assert growing.size > 2
    np.testing.assert_allclose(
        np.sort_complex(loci.eigenvalues[-1][loci.eigenvalues[-1].real > 0.0]),
        np.sort_complex(growing),
        rtol=1e-9,
    )


def test_a_bent_pipe_that_grows_in_a_high_mode_says_so():
    chain = pp.Chain(pp.Pipe(0.225, gamma=998.0, jet_angle=0.02), 12)
    rest = pp.equilibria(chain, 30.0).q[0]
    loci = pp.root_loci(chain.about(rest), [30.0], count=1)
    roots = pp.eigenvalues(chain.about(rest), 30.0)
    growing = roots[(roots.real > 1e-6) & (roots.imag >= 0.0)]
    assert growing.size > 0
    assert loci.complete
    assert all(np.abs(loci.eigenvalues[0] - one).min() < 1e-6 * abs(one) for one in growing)


@pytest.mark.parametrize(
    "model",
    [pp.Continuum(HOSE), pp.Chain(HOSE, 12), pp.Chain(HOSE, 100), pp.Galerkin(HOSE, 20)],
    ids=["continuum", "chain", "long chain", "beam"],
)
def test_the_modes_at_one_speed_have_all_that_grow(model):
    found = pp.modes(model, 26.0, count=1)
    every = pp.eigenvalues(model, 26.0, 24)
    growing = every[(every.real > 0.0) & (every.imag >= 0.0)]
    assert growing.size > 0
    np.testing.assert_allclose(found.eigenvalues[1:], growing, rtol=1e-9)
    assert found.converged.all()
    assert (found.errors < 1e-6 * np.abs(found.eigenvalues)).all()
    for shape, value in zip(found.shapes, found.eigenvalues, strict=True):
        assert shape.eigenvalue == value
        assert np.abs(shape(np.linspace(0.0, 1.0, 801))).max() == pytest.approx(1.0, abs=1e-3)
    assert pp.modes(model, 5.0, count=1).eigenvalues.size == 1


def test_a_file_of_an_earlier_version_has_the_numbers_of_its_first_modes():
    old = pp.load(path_of("RootLoci"))
    assert old.modes.tolist() == [*range(1, old.eigenvalues.shape[1] + 1)]
    assert not old.complete


def test_a_table_of_branches_says_which_modes_they_are(tmp_path):
    loci = pp.root_loci(pp.Chain(HOSE, 20), [0.0, 24.0], count=1)
    header, *lines = loci.to_csv().splitlines()
    column = header.split(",").index("mode")
    assert [int(line.split(",")[column]) for line in lines] == [1, 5, 1, 5]
    loci.save(tmp_path / "loci.npz")
    again = pp.load(tmp_path / "loci.npz")
    np.testing.assert_array_equal(again.modes, loci.modes)
    assert again.complete


@pytest.mark.parametrize(
    ("model", "u"),
    [
        (pp.Continuum(pp.Pipe(0.2, 10.0, damping=0.05)), 12.0),
        (pp.Continuum(pp.Pipe(0.5, 10.0, damping=0.05, end="pinned")), 12.0),
        (pp.Continuum(pp.Pipe(0.225, 998.0, damping=0.01)), 30.0),
        (pp.Chain(pp.Pipe(0.225, 998.0, damping=0.01), 100), 30.0),
        (pp.Chain(pp.Pipe(0.7, flow="aspirating", damping=0.01), 100), 30.0),
    ],
)
def test_modes_that_grow_beyond_the_cluster_of_overdamped_roots_are_not_left_out(model, u):
    solved = model.frozen(40) if isinstance(model, pp.Continuum) else model
    every = eigenvalues_of(*solved.operators().at(u))
    growing = every[(every.real > 1e-6) & (every.imag >= 0.0)]
    found = pp.modes(model, u, 4).eigenvalues
    apart = np.abs(found[:, None] - growing).min(axis=0) / np.abs(growing)
    assert growing.size
    assert apart.max() < 1e-6
    assert (np.abs(growing) > 1.0 / model.pipe.damping).any()


@pytest.mark.parametrize(
    ("pipe", "end"),
    [
        (pp.Pipe(0.39, 10.0, damping=0.05, end="clamped"), 8.0),  # diverges
        (pp.Pipe(0.25, 100.0, damping=0.05), 12.0),
        (pp.Pipe(0.225, 998.0, damping=0.005), 30.0),
        (pp.Pipe(0.225, 998.0, damping=0.01), 24.0),
        (pp.Pipe(0.225, 998.0, damping=0.01), 36.0),
        (pp.Pipe(0.2, 100.0, damping=0.05, end="pinned"), 8.0),
    ],
)
def test_growing_roots_of_strongly_damped_pipes_have_branches(pipe, end):
    """Some continue from the cluster of overdamped roots, whose numbers depend on the basis."""
    loci = pp.root_loci(pp.Continuum(pipe), np.linspace(0.0, end, 13), 2)
    every = eigenvalues_of(*pp.Galerkin(pipe, 48, "legendre").operators().at(end))
    growing = every[(every.real > 1e-6) & (every.imag >= 0.0)]
    roots = np.concatenate([loci.eigenvalues[-1], loci.partners[-1]])
    apart = np.nanmin(np.abs(roots[:, None] - growing), axis=0) / np.abs(growing)
    assert loci.complete
    assert growing.size
    assert apart.max() < 1e-6


def growing_roots(model, u):
    """Growing roots at or above the real axis by dense matrices, with the complex stiffness.

    Hysteresis does not act on static motions: a growing real root of the pipe without it replaces
    the nearest growing root of the complex matrices.
    """
    every = eigenvalues_of(*model.operators().at(u))
    every = every[every.real > 1e-5 * (1.0 + np.abs(every))]
    if not model.pipe.hysteresis:
        return every[every.imag >= 0.0]
    lossless = model.with_pipe(replace(model.pipe, hysteresis=0.0))
    static = eigenvalues_of(*lossless.operators().at(u))
    static = static[(static.real > 1e-5 * (1.0 + np.abs(static))) & (static.imag == 0.0)]
    twins = np.abs(every[:, None] - static).argmin(axis=0) if every.size else []
    every = np.delete(every, twins)
    return np.concatenate([static, every[every.imag > 0.0]])


def without_branch(solved, loci):
    """Growing roots of a model that no branch has, and growing roots of branches that it has not.

    They are those at or above the real axis at the speeds of the branches.
    """
    found = []
    for u, *both in zip(loci.speeds, loci.eigenvalues, loci.partners, strict=True):
        exact, roots = growing_roots(solved, u), np.concatenate(both)
        roots = roots[np.isfinite(roots) & (roots.imag >= 0.0)]
        apart = np.abs(exact[:, None] - roots) / (1.0 + np.abs(exact[:, None]))
        found += exact[apart.min(axis=1, initial=1.0) > 1e-5].tolist()
        grows = roots.real > 1e-4 * (1.0 + np.abs(roots))
        found += roots[(apart.min(axis=0, initial=1.0) > 1e-5) & grows].tolist()
    return found


def damped_pipe(rng):
    """A pipe with strong damping, in most cases with hysteresis too, held and loaded in any way."""
    terms = []
    if rng.random() < 0.3:
        terms.append(pp.Spring(rng.uniform(0.2, 0.95), 10.0 ** rng.uniform(0.0, 3.0)))
    if rng.random() < 0.3:
        terms.append(pp.PointMass(rng.choice([1.0, 0.6]), 10.0 ** rng.uniform(-2.0, 0.5)))
    if rng.random() < 0.2:
        terms.append(pp.Damper(rng.uniform(0.2, 0.95), 10.0 ** rng.uniform(-1.0, 1.5)))
    at_end = any(one.at == 1.0 for one in terms)
    return pp.Pipe(
        rng.uniform(0.01, 0.95),
        gamma=rng.choice([0.0, 10.0, -5.0, 100.0, 200.0]),
        damping=10.0 ** rng.uniform(-4.0, -0.3),
        hysteresis=rng.choice([0.0, 0.01, 0.1, 0.5]),
        flow="ejecting" if at_end else str(rng.choice(["ejecting", "ejecting", "aspirating"])),
        end="free" if at_end else str(rng.choice(["free", "pinned", "clamped", "guided"])),
        terms=terms,
    )


@pytest.mark.parametrize("seed", range(10))
def test_no_growing_root_of_strongly_damped_random_pipes_is_missed(seed):
    """In some the search for crossings ends where a growing motion ceases to oscillate."""
    rng = np.random.default_rng(seed)
    for _ in range(10):
        pipe, end = damped_pipe(rng), rng.choice([6.0, 10.0, 16.0])
        if rng.random() < 0.5:
            model = pp.Chain(pipe, int(rng.integers(3, 20)))
        else:
            model = pp.Galerkin(pipe, int(rng.integers(4, 20)), "legendre")
        loci = pp.root_loci(model, np.linspace(rng.choice([0.0, end / 2.0]), end, 11), 2)
        assert loci.complete, model
        assert without_branch(model, loci) == [], model


@pytest.mark.parametrize(
    ("model", "end"),
    [
        (pp.Chain(pp.Pipe(0.16, 10.0, damping=0.05, hysteresis=0.01, end="guided"), 66), 8.0),
        (pp.Chain(pp.Pipe(0.22, 100.0, damping=0.05), 66), 12.0),
        (pp.Continuum(pp.Pipe(0.72, 10.0, damping=0.3, hysteresis=0.1, end="clamped")), 10.0),
        (pp.Continuum(pp.Pipe(0.21, 10.0, damping=0.05, hysteresis=0.01)), 16.0),
        (pp.Galerkin(pp.Pipe(0.88, damping=0.04, hysteresis=0.01), 12), 16.0),
        (
            pp.Chain(
                pp.Pipe(
                    *(0.866, 100.0),
                    alpha=1.452,
                    damping=4e-4,
                    hysteresis=0.5,
                    terms=[pp.PointMass(at=1.0, mass=0.741)],
                    supports=[0.308],
                ),
                20,
            ),
            16.0,
        ),
    ],
)
def test_roots_that_grow_out_of_the_cluster_with_a_loss_factor_or_many_segments_are_followed(
    model, end
):
    loci = pp.root_loci(model, np.linspace(0.5 * end, end, 7), 1)
    solved = model.frozen(56) if isinstance(model, pp.Continuum) else model
    assert growing_roots(solved, end).size > 0
    assert loci.complete
    assert without_branch(solved, loci) == []


def test_branches_that_do_not_converge_from_rest_are_followed_all_the_same():
    """Two modes of one frequency flutter together, and which is which depends on the basis."""
    pipe = pp.Continuum(pp.Pipe(0.65, 10.0, rotary_inertia=0.006, end="clamped"))
    speeds = np.linspace(8.0, 16.0, 9)
    with pytest.raises(pp.NotConverged, match="still moves by"):
        branches_followed(pipe, np.concatenate([[0.0], speeds]), 1)
    loci = pp.root_loci(pipe, speeds, 1)
    assert loci.complete
    assert loci.modes[0] == 1
    assert loci.speeds.tolist() == speeds.tolist()
    assert without_branch(pipe.frozen(40), loci) == []
    np.testing.assert_array_equal(loci.converged, np.isfinite(loci.eigenvalues))
    for row in loci.eigenvalues:
        known = row[np.isfinite(row)]
        assert np.unique(known.round(6)).size == known.size


def test_a_branch_without_a_number_is_one_curve_and_ends_in_the_cluster():
    """Each of its roots is the nearest to the one before at steps of 1e-3 in u."""
    chain = pp.Chain(pp.Pipe(0.225, 998.0, damping=0.01), 16)
    loci = pp.root_loci(chain, np.linspace(0.0, 35.0, 71), 4)
    assert loci.complete
    assert loci.modes.tolist() == [1, 2, 3, 4, 0]
    assert [int(line.split(",")[2]) for line in loci.to_csv().splitlines()[1:6]] == [1, 2, 3, 4, 0]
    branch = loci.eigenvalues[:, 4]
    rows = np.flatnonzero(np.isfinite(branch))
    assert branch[-1].real > 0.0
    assert rows[0] > 0
    assert rows.tolist() == [*range(rows[0], 71)]
    assert branch[rows[0]].real < 0.0
    value, problem = branch[-1], chain.operators()
    for u in np.linspace(35.0, loci.speeds[rows[0] + 1], 1 + round(500 * (70 - rows[0] - 1))):
        roots = companion_eigenvalues(*problem.at(u))
        value = roots[np.abs(roots - value).argmin()]
        row = np.abs(loci.speeds - u).argmin()
        if abs(loci.speeds[row] - u) < 1e-9:
            assert abs(value - branch[row]) < 1e-6 * abs(value)


def test_loci_are_complete_where_every_mode_has_a_branch():
    for pipe in (pp.Pipe(0.2, flow="aspirating"), pp.Pipe(0.3765, -20.0, root="pinned")):
        loci = pp.root_loci(pp.Chain(pipe, 7), np.linspace(0.0, 12.0, 25), 7)
        assert loci.complete
        assert loci.modes.tolist() == [*range(1, 8)]


@pytest.mark.parametrize(
    ("model", "end"),
    [
        (pp.Continuum(pp.Pipe(0.2, end="pinned", hysteresis=0.01)), 5.0),
        (pp.Chain(pp.Pipe(0.2, -20.0, hysteresis=0.01), 10), 1.0),
        (pp.Continuum(pp.Pipe(0.2, 100.0, damping=0.02, hysteresis=0.02, end="clamped")), 12.0),
    ],
)
def test_pipes_with_hysteresis_that_buckle_have_branches_that_grow(model, end):
    """The last one buckles in two modes, whose roots are one pair."""
    loci = pp.root_loci(model, np.linspace(0.0, end, 6), 2)
    assert loci.complete
    values = pp.eigenvalues(model, end, 4)
    growing = values[values.real > 0.0]
    roots = np.concatenate([loci.eigenvalues[-1], loci.partners[-1]])
    assert growing.real.max() > 1.0
    assert np.sort(roots[roots.real > 0.0].real) == pytest.approx(np.sort(growing.real), rel=1e-9)
