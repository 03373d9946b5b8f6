# SPDX-License-Identifier: MIT
"""Crossings of the imaginary axis: none missed, each with an error that bounds the true one."""

import itertools

import numpy as np
import pytest
from independent import (
    assert_differences,
    chain_crossing,
    collocation_eigenvalues,
    companion_eigenvalues,
    series_crossing,
    unstable_count,
)
from scipy.optimize import brentq, minimize_scalar

import pipedyn as pp
from pipedyn import modular


def counts_meet_the_matrices(model, max_speed, samples=160, slack=1e-5, share=0.9):
    """Unstable roots between the crossings found, against eigvals of the matrices on a fine grid.

    Grid points within `slack` of a crossing, or with a root nearer to the axis than rounding and
    the meeting of two roots allow eigvals to decide, say nothing; a `share` must be counted.
    """
    found = pp.crossings(model, max_speed)
    speeds = np.array([crossing.speed for crossing in found])
    assert (np.diff(speeds) >= 0.0).all()
    assert (speeds <= max_speed).all()
    for before, after in itertools.pairwise(found):
        assert before.unstable_after == after.unstable_before
    ops = model.operators()
    conservative = model.pipe.beta == 0.0 and model.pipe.damping == 0.0  # all roots on the axis
    checked = 0
    for u in np.linspace(0.0, max_speed, samples)[1:]:
        growth = companion_eigenvalues(*ops.at(u)).real
        real = np.abs(growth)
        unclear = (real > 1e-9) & (real < 1e-5) if conservative else real < 1e-7
        if np.abs(speeds - u).min(initial=np.inf) < slack or unclear.any():
            continue
        past = int(np.sum(speeds < u))
        if past:
            expected = found[past - 1].unstable_after
        elif found:
            expected = found[0].unstable_before
        else:
            expected = unstable_count(model, 0.0)
        assert np.sum(growth > 1e-7) == expected, f"at u = {u}"
        checked += 1
    assert checked > share * samples
    return found


# --------------------------------------------------------------------- none missed, counts


@pytest.mark.parametrize(
    ("pipe", "max_speed"),
    [
        (pp.Pipe(0.2), 15.0),
        (pp.Pipe(0.295), 12.0),
        (pp.Pipe(0.67), 15.0),
        (pp.Pipe(0.9), 18.0),
        (pp.Pipe(0.2, gamma=-10.0), 12.0),
        (pp.Pipe(0.4, gamma=-60.0), 14.0),
        (pp.Pipe(0.3, gamma=40.0, damping=1e-3), 14.0),
        (pp.Pipe(0.3, flow="aspirating", damping=1e-2), 12.0),
        (pp.Pipe(0.3, gamma=5.0, flow="aspirating", alpha=0.0, damping=1e-2), 12.0),
        (pp.Pipe(0.0), 12.0),
        (pp.Pipe(0.0, gamma=-20.0), 12.0),
        (pp.Pipe(0.0, gamma=3.0, damping=1e-3), 12.0),
        (pp.Pipe(0.4, gamma=3e3), 60.0),
        (pp.Pipe(0.9, gamma=1e5, damping=1e-4), 100.0),
    ],
    ids=repr,
)
@pytest.mark.parametrize("kind", ["3", "10", "legendre 12"])
def test_crossings_account_for_every_unstable_root(pipe, max_speed, kind):
    model = {
        "3": lambda: pp.Chain(pipe, 3),
        "10": lambda: pp.Chain(pipe, 10),
        "legendre 12": lambda: pp.Galerkin(pipe, 12, "legendre"),
    }[kind]()
    counts_meet_the_matrices(model, max_speed)


@pytest.mark.parametrize("beta", [0.295, 0.9])
def test_a_long_chain_has_the_crossings_of_its_matrices(beta):
    """Eigenvalues come from sweeps along the chain, as they do beyond 64 segments."""
    counts_meet_the_matrices(pp.Chain(pp.Pipe(beta), 66), 13.0, samples=40)


@pytest.mark.parametrize(
    ("beta", "gamma", "max_speed"), [(0.2, 0.0, 15.0), (0.67, 0.0, 14.0), (0.9, -9.0, 17.0)]
)
def test_the_continuous_pipes_crossings_account_for_the_roots_of_its_strong_form(
    beta, gamma, max_speed
):
    pipe = pp.Pipe(beta, gamma=gamma)
    found = pp.crossings(pp.Continuum(pipe), max_speed)
    speeds = np.array([crossing.speed for crossing in found])
    for u in np.linspace(0.0, max_speed, 60)[1:]:
        values = collocation_eigenvalues(pipe, u, size=48)[:30]
        past = int(np.sum(speeds < u))
        expected = found[past - 1].unstable_after if past else found[0].unstable_before
        assert np.sum(values.real > 0.0) == expected


@pytest.mark.parametrize(
    ("low", "fold", "high", "max_speed"),
    [(0.28, 0.295, 0.31, 9.0), (0.64, 0.67, 0.71, 14.0), (0.84, 0.9, 0.93, 17.6)],
)
def test_the_stability_curve_folds(low, fold, high, max_speed):
    """Folds near beta = 0.293-0.297, 0.649-0.695 and 0.845-0.925."""

    def times(beta):
        found = pp.crossings(pp.Continuum(pp.Pipe(beta)), max_speed)
        lowest = [c for c in found if c.unstable_before + c.unstable_after == 2]
        assert [c.destabilising for c in lowest] == [True, False, True][: len(lowest)]
        return len(lowest)

    assert times(fold) == 3
    assert times(low) == times(high) == 1


# -------------------------------------------------------------------------- near tangency


def legendre(size):
    return lambda beta: pp.Galerkin(pp.Pipe(beta), size, "legendre")


def touch(make_model, beta, window, sign):
    """Least (sign 1) or largest (sign -1) growth rate within a window of speeds, times sign."""
    ops = make_model(beta).operators()

    def growth(u):
        return sign * companion_eigenvalues(*ops.at(u)).real.max()

    return minimize_scalar(growth, bounds=window, method="bounded", options={"xatol": 1e-7}).fun


@pytest.mark.parametrize(
    ("make_model", "betas", "window", "sign", "distances"),
    [
        (legendre(14), (0.2925, 0.2935), (7.7, 8.3), 1, (1e-4, 1e-9)),
        (legendre(14), (0.2965, 0.2975), (7.2, 8.0), -1, (1e-4, 1e-9)),
        (legendre(20), (0.845, 0.846), (15.9, 16.6), 1, (1e-5, 1e-8)),
        (legendre(20), (0.924, 0.926), (14.6, 15.2), -1, (1e-5, 1e-8)),
        (lambda beta: pp.Chain(pp.Pipe(beta), 70), (0.29300, 0.29302), (7.9, 8.1), 1, (1e-6,)),
    ],
    ids=["begin 1", "end 1", "begin 3", "end 3", "long chain"],
)
def test_two_crossings_that_all_but_touch_are_both_found_or_neither(
    make_model, betas, window, sign, distances
):
    """At either end of a fold a branch touches the axis; a hair to one side it passes it twice.

    Where the end is, and which side passes, come from eigvals and a minimisation over the speed.
    """
    digits = {"xtol": 1e-3 * min(distances)}
    nose = brentq(lambda beta: touch(make_model, beta, window, sign), *betas, **digits)
    for distance in distances:
        for beta in (nose - distance, nose + distance):
            gap = touch(make_model, beta, window, sign)
            assert abs(gap) > 1e-9
            speeds = [c.speed for c in pp.crossings(make_model(beta), window[1])]
            inside = [u for u in speeds if u > window[0]]
            assert len(inside) == (2 if gap < 0.0 else 0)
            if inside:
                middle = make_model(beta).operators().at(np.mean(inside))
                assert sign * companion_eigenvalues(*middle).real.max() < 0.0


# -------------------------------------------------------------------------- critical speed


@pytest.mark.parametrize("n", [3, 5, 10, 20, 70])
def test_a_chains_critical_speed_parts_stable_from_unstable_and_its_error_bounds_the_true_one(n):
    """Against the chain's matrices, and shooting along the chain with 30 digits."""
    chain = pp.Chain(pp.Pipe(0.2), n)
    found = pp.critical_speed(chain)
    assert found.error < 1e-10
    assert found.size == n
    assert unstable_count(chain, found.speed * (1.0 - 1e-6)) == 0
    assert unstable_count(chain, found.speed * (1.0 + 1e-6)) == 2
    speed, frequency = chain_crossing(chain, found.speed, found.frequency)
    assert abs(found.speed - speed) <= found.error + 4e-16 * found.speed
    assert abs(found.frequency - frequency) < 1e-10 * found.frequency


@pytest.mark.parametrize(
    "make_model",
    [lambda pipe: pp.Chain(pipe, 10), lambda pipe: pp.Galerkin(pipe, 10), pp.Continuum],
    ids=["chain", "reduced", "continuum"],
)
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_an_undamped_aspirating_pipe_is_unstable_from_the_smallest_flow_on(make_model, alpha):
    found = pp.critical_speed(make_model(pp.Pipe(0.3, flow="aspirating", alpha=alpha)))
    assert found.speed == 0.0
    assert found.kind == "flutter"
    assert found.stable_at_rest
    assert found.sensitivity is None


def test_every_mode_of_an_undamped_aspirating_pipe_leaves_the_axis_at_once():
    n = 7
    found = pp.crossings(pp.Chain(pp.Pipe(0.3, flow="aspirating"), n), 0.5)
    assert [crossing.speed for crossing in found] == [0.0] * n
    assert [crossing.mode for crossing in found] == list(range(1, n + 1))
    assert found[-1].unstable_after == 2 * n
    rest = pp.eigenvalues(pp.Chain(pp.Pipe(0.3, flow="aspirating"), n), 0.0)[::2].imag
    np.testing.assert_allclose([crossing.frequency for crossing in found], rest, rtol=1e-9)


def test_a_pipe_without_fluid_mass_flutters_where_two_frequencies_meet():
    """beta = 0: Beck's column, one branch of two, no sensitivity."""
    for model in (pp.Chain(pp.Pipe(0.0), 12), pp.Continuum(pp.Pipe(0.0))):
        found = pp.critical_speed(model)
        assert found.kind == "flutter"
        assert found.mode == 2
        assert found.sensitivity is None
        rom = model if isinstance(model, pp.Chain) else model.frozen(24)
        just_below, just_above = (
            companion_eigenvalues(*rom.operators().at(found.speed * factor))
            for factor in (1.0 - 1e-6, 1.0 + 1e-6)
        )
        assert just_below.real.max() < 1e-6
        assert just_above.real.max() > 1e-3


def test_the_second_mode_flutters_at_low_mass_ratio_but_not_always():
    """The paper: 'a critical speed at the second natural mode in all the analyzed scenarios'."""
    modes = [pp.critical_speed(pp.Continuum(pp.Pipe(beta))).mode for beta in (0.05, 0.1, 0.2)]
    assert modes == [2, 2, 2]
    assert pp.critical_speed(pp.Continuum(pp.Pipe(0.5))).mode == 3


def test_the_mode_is_the_branch_of_the_root_locus():
    for pipe in (pp.Pipe(0.2), pp.Pipe(0.5), pp.Pipe(0.5, gamma=-10.0), pp.Pipe(0.1, damping=0.01)):
        model = pp.Galerkin(pipe, 14, "legendre")
        found = pp.critical_speed(model)
        loci = pp.root_loci(model, [0.0, found.speed], count=6)
        on_axis = np.abs(loci.eigenvalues[1] - 1j * found.frequency)
        assert int(np.argmin(on_axis)) == found.mode - 1
        assert on_axis.min() < 1e-6


@pytest.mark.parametrize(
    "model", [pp.Chain(pp.Pipe(0.2), 10), pp.Continuum(pp.Pipe(0.2))], ids=["chain", "continuum"]
)
def test_a_search_that_gives_up_names_its_bound(model):
    with pytest.raises(pp.NoCrossing, match=r"5\.25") as caught:
        pp.critical_speed(model, max_speed=5.25)
    assert caught.value.max_speed == 5.25
    assert isinstance(caught.value, pp.PipedynError)
    assert not pp.crossings(model, 5.25)


def test_one_segment_never_flutters():
    """Its jet damping is positive at any speed and its stiffness k - 0 u^2 + ... positive."""
    with pytest.raises(pp.NoCrossing, match="100"):
        pp.critical_speed(pp.Chain(pp.Pipe(0.2), 1))


@pytest.mark.parametrize("beta", [0.1, 0.2, 0.295, 0.9, 0.99])
def test_the_continuums_error_bounds_the_true_one(beta):
    for crossing in pp.crossings(pp.Continuum(pp.Pipe(beta)), 18.5)[:4]:
        speed, frequency = series_crossing(pp.Pipe(beta), crossing.speed, crossing.frequency)
        assert abs(crossing.speed - speed) <= crossing.error + 4e-16 * speed
        assert crossing.frequency == pytest.approx(frequency, rel=1e-8 if beta > 0.9 else 1e-10)
        assert crossing.error < 1e-8 * speed


def test_a_chain_of_the_users_own_tells_no_distance_to_the_continuous_pipe():
    own = pp.critical_speed(pp.Chain(pp.Pipe(0.2), springs=[9.0] * 10))
    assert own.discretisation is None


# ----------------------------------------------------------------------------- sensitivity


def test_a_bent_pipe_has_no_sensitivity_as_its_shape_changes_as_well():
    """Without thrust a pipe bent by its weight rests at any flow speed."""
    pipe = pp.Pipe(0.2, -30.0, flow="aspirating", alpha=0.0, damping=0.02)
    chain = pp.Chain(pipe, 6)
    straight, bent = (chain.about(q) for q in pp.equilibria(chain, 0.0).q[:2])
    assert pp.critical_speed(straight).sensitivity is not None
    assert pp.critical_speed(bent).sensitivity is None


def near(crossing, model):
    """The crossing of another model nearest to one."""
    found = pp.crossings(model, 1.01 * crossing.speed)
    nearest = min(found, key=lambda c: abs(c.speed - crossing.speed))
    assert nearest.kind == crossing.kind
    return nearest


SCENES = {
    "flutter": (pp.Pipe(0.35, gamma=3.0, damping=2e-3), "flutter"),
    "aspirating": (pp.Pipe(0.35, 3.0, "aspirating", 0.8, damping=1e-2), "flutter"),
    "divergence": (pp.Pipe(0.2, gamma=-11.0, damping=1e-3), "divergence"),
    "straightened": (pp.Pipe(0.2, gamma=-11.0, damping=1e-3), "flutter"),
    "hysteretic": (pp.Pipe(0.3, 5.0, damping=1e-3, hysteresis=0.07), "flutter"),
    "on a root spring": (pp.Pipe(0.3, 3.0, damping=0.02, root=pp.RootSpring(5.0)), "flutter"),
}
MODELS = {
    "chain": lambda pipe: pp.Chain(
        pipe, lengths=[0.2, 0.3, 0.15, 0.35], springs=[8.0, 4.0, 4.0, 5.0]
    ),
    "beam": lambda pipe: pp.Galerkin(pipe, 6),
    "continuum": pp.Continuum,
}


def first_of(model, kind):
    return next(crossing for crossing in pp.crossings(model, 10.0) if crossing.kind == kind)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("kind", MODELS)
def test_sensitivity_meets_differences(scene, kind):
    pipe, lost_by = SCENES[scene]
    crossing = first_of(MODELS[kind](pipe), lost_by)
    steps = {"beta": 1e-4, "gamma": 2e-3, "damping": 5e-6, "alpha": 2e-4}

    # Twenty functions have all digits here, and no second size to compare with.
    make_model = (
        MODELS[kind] if kind != "continuum" else lambda pipe: pp.Galerkin(pipe, 20, "legendre")
    )
    assert_differences(
        crossing.sensitivity, lambda of: near(crossing, make_model(of)), pipe, steps, least=1e-7
    )


LOADS = pp.PointMass(0.25, 0.4), pp.Spring(0.6, 50.0), pp.PointMass(1.0, 0.2), pp.Spring(1.0, 3.0)
LOADED = pp.Pipe(0.3, 6.0, damping=1e-3, terms=LOADS)
LOSSY = pp.Pipe(0.3, 5.0, damping=1e-3, hysteresis=0.07)
WEAK, WEAKER = pp.Pipe(1e-12, damping=1e-7), pp.Pipe(1e-12, hysteresis=3e-6, damping=1e-7)
EACH = {"beta": 1e-5, "gamma": 1e-4, "damping": 1e-6, "alpha": 1e-5}


def of_size(n, kind=pp.Chain, *given):
    return lambda pipe: kind(pipe, n, *given)


@pytest.mark.parametrize(
    ("make", "pipe", "steps", "rel"),
    [
        (of_size(66), pp.Pipe(0.2, 3.0, damping=1e-4), {"beta": 1e-4}, 1e-5),
        *(
            (of_size(66), pp.Pipe(*drawn, inflow_share=c, damping=1e-4), {"beta": 1e-4}, 1e-4)
            for drawn in [(0.2, 0.0, "aspirating", 0.5)]
            for c in (0.0, 0.4)
        ),
        *((of_size(n), LOADED, EACH, 1e-5) for n in (6, 66)),
        *((of_size(14, pp.Galerkin, name), LOADED, EACH, 1e-5) for name in ("beam", "legendre")),
        (of_size(14), LOSSY, EACH | {"hysteresis": 1e-5}, 1e-5),
        (of_size(8, pp.Galerkin), LOSSY, EACH | {"hysteresis": 1e-5}, 1e-5),
        (of_size(5), WEAK, {"beta": 1e-15, "damping": 1e-10, "gamma": 1e-3}, 1e-4),
        (
            of_size(8, pp.Galerkin, "legendre"),
            *(WEAKER, {"beta": 1e-15, "damping": 1e-10, "hysteresis": 3e-9}, 1e-3),
        ),
    ],
)
def test_sensitivity_of_the_first_loss_meets_differences(make, pipe, steps, rel):
    """Of chains by sweeps, which those beyond 64 segments take, terms, hysteresis, weak forces."""

    def find(pipe):
        return pp.critical_speed(make(pipe))

    assert_differences(find(pipe).sensitivity, find, pipe, steps, rel=rel, least=1e-6)


@pytest.mark.parametrize("scene", SCENES)
def test_sensitivity_to_each_spring_meets_differences(scene):
    pipe, lost_by = SCENES[scene]
    springs = np.array([8.0, 4.0, 4.0, 5.0])
    crossing = first_of(MODELS["chain"](pipe), lost_by)
    found = crossing.sensitivity
    assert found.speed.springs.shape == found.frequency.springs.shape == (4,)
    for j in range(4):

        def stiffer(value, j=j):
            changed = np.where(np.arange(4) == j, value, springs)
            return pp.Chain(pipe, lengths=[0.2, 0.3, 0.15, 0.35], springs=changed)

        ahead, behind = (near(crossing, stiffer(springs[j] + h)) for h in (1e-3, -1e-3))
        speed, frequency = ahead.speed - behind.speed, ahead.frequency - behind.frequency
        assert found.speed.springs[j] == pytest.approx(speed / 2e-3, rel=1e-5, abs=1e-7)
        assert found.frequency.springs[j] == pytest.approx(frequency / 2e-3, rel=1e-5, abs=1e-6)


def test_stiffer_springs_and_faster_flow_scale_together():
    """Without gravity and damping u_c grows like sqrt(k): sum k du/dk = u / 2, omega alike."""
    for n in (5, 66):
        chain = pp.Chain(pp.Pipe(0.3), n)
        found = pp.critical_speed(chain)
        by_speed, by_frequency = found.sensitivity.speed, found.sensitivity.frequency
        assert by_speed.springs @ chain.springs == pytest.approx(found.speed / 2, rel=1e-9)
        assert by_frequency.springs @ chain.springs == pytest.approx(found.frequency / 2, rel=1e-9)
    reduced = pp.critical_speed(pp.Galerkin(pp.Pipe(0.3), 5)).sensitivity
    assert reduced.speed.springs is None
    assert reduced.frequency.springs is None


def test_a_damped_pipe_without_fluid_mass_has_no_derivative_by_it():
    """sqrt(beta) has none at beta = 0; the others are there."""
    pipe = pp.Pipe(0.0, damping=1e-2)
    crossing = first_of(pp.Galerkin(pipe, 6), "flutter")
    assert crossing.sensitivity.speed.beta is None
    assert_differences(
        *(crossing.sensitivity, lambda of: near(crossing, pp.Galerkin(of, 6)), pipe),
        {"gamma": 1e-3},
        rel=1e-6,
    )


@pytest.mark.parametrize("seed", range(12))
def test_irregular_chains_crossings_account_for_every_unstable_root(seed):
    """Localised modes hardly see the flow: their real parts drown in rounding."""
    random = np.random.default_rng(seed)
    n = int(random.integers(3, 10))
    lengths = random.uniform(0.2, 1.0, n)
    lengths /= lengths.sum()
    pipe = pp.Pipe(
        beta=float(random.choice([0.0, random.uniform(0.0, 0.95)])),
        gamma=float(random.choice([0.0, random.uniform(-20.0, 40.0)])),
        flow=str(random.choice(["ejecting", "aspirating"])),
        alpha=float(random.uniform(0.0, 1.5)),
        damping=float(random.choice([0.0, 1e-3])),
    )
    chain = pp.Chain(
        pipe,
        lengths=lengths,
        springs=n * 10.0 ** random.uniform(-1.0, 1.0, n),
        centres=random.uniform(0.2, 0.8, n),
        gyration_radii=lengths * random.uniform(0.1, 0.5, n),
    )
    counts_meet_the_matrices(chain, 10.0, share=0.75)


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
@pytest.mark.parametrize("kind", [pp.Chain, pp.Galerkin, modular.chain])
def test_derivatives_by_gravity_and_damping_are_right_at_the_ends_of_their_ranges(kind):
    x = np.eye(3)
    none = kind(pp.Pipe(0.5), 3).pencil()
    for gamma, damping in ((1e6, 0.0), (-1e6, 1e6), (0.0, 1.0)):
        pencil = kind(pp.Pipe(0.5, gamma, damping=damping), 3).pencil()
        np.testing.assert_allclose(pencil.gravity(x), none.gravity(x), rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(pencil.by_damping(x), none.by_damping(x), rtol=0.0, atol=1e-8)


def test_the_smallest_fluid_mass_has_a_speed_and_no_derivative():
    chains = [pp.Chain(pp.Pipe(beta, damping=0.02), 3) for beta in (5e-324, 1e-310, 1e-290, 0.0)]
    found = [pp.critical_speed(chain) for chain in chains]
    for critical in found:
        assert critical.speed == pytest.approx(found[-1].speed, rel=1e-12)
        assert (critical.sensitivity.speed.beta is None) == (critical.pipe.beta < 1e-300)


def test_what_is_found_twice_is_equal_and_may_stand_in_a_set():
    """Sensitivities by springs are arrays, which do not compare."""
    found = [pp.critical_speed(pp.Chain(pp.Pipe(0.2), 3)) for _ in range(2)]
    assert found[0] == found[1]
    assert found[0] != pp.critical_speed(pp.Chain(pp.Pipe(0.2), 4))
    assert len({*found}) == 1


@pytest.mark.parametrize("model", [pp.Continuum, lambda pipe: pp.Chain(pipe, 6)])
def test_hardly_any_damping_of_an_aspirating_pipe_is_outdone_by_hardly_any_flow(model):
    """Speed is proportional to damping; where rounding hides the damping, speed 0 has an error."""

    def critical(damping):
        return pp.critical_speed(model(pp.Pipe(0.2, damping=damping, flow="aspirating")))

    clear = critical(1e-9)
    for damping in (1e-12, 1e-14, 1e-16):
        found = critical(damping)
        exact = clear.speed * damping / 1e-9
        assert abs(found.speed - exact) <= found.error <= 1e-13
        assert found.speed > 0.0 or damping < 1e-14
        assert found.mode == 1


def test_a_pair_that_turns_real_and_passes_zero_in_one_step_diverges():
    """Of a mode beyond those tracked with certainty: it was flutter and divergence at one speed."""
    terms = (
        pp.Spring(at=0.458169555812, stiffness=506.95),
        pp.Damper(at=0.868, coefficient=0.3388),
    )
    model = pp.Galerkin(pp.Pipe(8.6e-11, 27.684, terms=terms), 9, "legendre")
    found = [one for one in pp.crossings(model, 13.1) if 12.5 < one.speed < 12.7]
    assert [one.kind for one in found] == ["divergence"]
    for change, side in ((found[0].unstable_before, -1e-4), (found[0].unstable_after, 1e-4)):
        assert change == np.sum(pp.eigenvalues(model, found[0].speed + side).real > 0.0)


def test_the_mode_shape_of_a_critical_speed():
    """Euler's half wave of a pinned pipe; of flutter the eigenvector that `modes` finds."""
    s = np.linspace(0.0, 1.0, 9)
    pinned = pp.critical_speed(pp.Continuum(pp.Pipe(0.2, root="pinned", end="pinned")))
    np.testing.assert_allclose(np.abs(pinned.mode_shape(s)), np.sin(np.pi * s), atol=1e-9)
    scene = pp.modular.chain(pp.Pipe(0.2), 6).plus(pp.Damper(0.5, 0.1))
    for model in (pp.Chain(pp.Pipe(0.2, 20.0), 3), pp.Galerkin(pp.Pipe(0.2), 10), scene):
        found = pp.critical_speed(model)
        shapes = pp.modes(model, found.speed).shapes
        near = min(shapes, key=lambda one: abs(one.eigenvalue - 1j * found.frequency))
        np.testing.assert_allclose(found.mode_shape(s), near(s), atol=1e-9)
    continuous = pp.critical_speed(pp.Continuum(pp.Pipe(0.2)))
    finer = pp.critical_speed(pp.Galerkin(pp.Pipe(0.2), 30, "legendre"))
    np.testing.assert_allclose(continuous.mode_shape(s), finer.mode_shape(s), atol=1e-8)


@pytest.mark.parametrize("ulps", [-3, -1, 0, 20])
def test_two_pairs_that_meet_where_rounding_hides_it_say_how_far_off_the_speed_may_be(ulps):
    """Of a conservative pipe no real part shows where between two speeds its roots meet.

    Which of two roots that part again is found first depends on the last digits.
    """
    beta = 0.75 * (1.0 + ulps * 3e-16)
    model = pp.Galerkin(pp.Pipe(beta, 9.3, root="pinned", end="pinned"), 3, "legendre")
    found = pp.crossings(model, 15.0)[-1]

    def growth(u):
        values = pp.eigenvalues(model, u)
        return values.real[np.abs(values.imag) > 1.0].max() - 1e-6

    assert abs(found.speed - brentq(growth, 14.4, 14.6)) < found.error + 1e-11
    assert found.error < 1e-4
