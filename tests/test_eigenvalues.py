# SPDX-License-Identifier: MIT
"""Eigenvalues that are right at any size."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from independent import chain_crossing, chain_newton_step, companion_eigenvalues, distances
from test_chain_motion import TERMS as ALL

import pipedyn as pp
from pipedyn import modular

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")  # also extreme ones
warnings.simplefilter("ignore", pp.UnusualPipe)  # until pytest has collected the tests


PIPES = [
    pp.Pipe(0.2),
    pp.Pipe(0.6, gamma=15.0, damping=1e-3),
    pp.Pipe(0.4, gamma=-5.0, flow="aspirating", alpha=0.7, damping=2e-4),
    pp.Pipe(0.0, gamma=2.0),
]


def every_model(pipe):
    n = np.arange(1.0, 6.0)
    return [
        pp.Chain(pipe, 1),
        pp.Chain(pipe, 6),
        pp.Chain(pipe, 6, springs="midpoint"),
        pp.Chain(pipe, 6, springs="rayleigh"),
        pp.Chain(pipe, lengths=n / n.sum(), springs=5.0 * n),
        pp.Galerkin(pipe, 6, "beam"),
        pp.Galerkin(pipe, 6, "legendre"),
    ]


# ------------------------------------------------------------------- all of them, and in order


@pytest.mark.parametrize("u", [0.0, 3.0, 9.0])
@pytest.mark.parametrize("pipe", PIPES, ids=repr)
def test_every_model_has_the_eigenvalues_of_its_matrices(pipe, u):
    for model in every_model(pipe):
        found = pp.eigenvalues(model, u)
        assert found.shape == (2 * model.dof,)
        reference = companion_eigenvalues(*model.operators().at(u))
        assert distances(found, reference).max() < 1e-7
        assert distances(reference, found).max() < 1e-7


def in_order(values):
    """Sorted by magnitude; conjugates side by side, the upper first."""
    magnitudes = np.abs(values)
    assert (np.diff(magnitudes) >= -1e-12 * magnitudes[1:]).all()
    i = 0
    while i < values.size:
        if values[i].imag == 0.0:
            i += 1
            continue
        assert values[i].imag > 0.0
        if i + 1 < values.size:
            assert values[i + 1] == np.conj(values[i])
        i += 2


@settings(max_examples=60)
@given(
    st.sampled_from(PIPES),
    st.integers(0, 6),
    st.floats(0.0, 20.0),
    st.integers(1, 12),
)
def test_eigenvalues_are_sorted_and_conjugates_stand_side_by_side(pipe, which, u, count):
    model = every_model(pipe)[which]
    count = min(count, 2 * model.dof)
    all_of_them = pp.eigenvalues(model, u)
    in_order(all_of_them)
    few = pp.eigenvalues(model, u, count)
    assert few.shape == (count,)
    np.testing.assert_allclose(few, all_of_them[:count], atol=1e-9 * (1 + np.abs(few[-1])))


@pytest.mark.parametrize(
    "pipe", [pp.Pipe(0.2), pp.Pipe(0.9, gamma=4.0), pp.Pipe(0.5, flow="aspirating", alpha=0.5)]
)
def test_without_damping_rest_is_conservative(pipe):
    """At u = 0 every eigenvalue lies on the imaginary axis, exactly."""
    for model in [*every_model(pipe), pp.Chain(pipe, 200)]:
        assert not pp.eigenvalues(model, 0.0, min(2 * model.dof, 12)).real.any()


def test_a_cantilever_at_rest_has_its_textbook_frequencies():
    """Roots of cos k cosh k = -1: 1.8751041, 4.6940911, 7.8547574, 10.9955407, squared."""
    roots = np.array([1.87510407, 4.69409113, 7.85475744, 10.99554073])
    found = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2)), 0.0, 8)[::2]
    np.testing.assert_allclose(found, 1j * roots**2, rtol=3e-9)


# ----------------------------------------------------------------------------- long chains


@pytest.mark.parametrize("rule", ["consistent", "midpoint", "rayleigh"])
@pytest.mark.parametrize("pipe", PIPES, ids=repr)
def test_recursion_finds_the_lowest_eigenvalues_of_the_matrices(pipe, rule):
    chain = pp.Chain(pipe, 90, springs=rule)
    for u in (0.0, 4.0, 8.0):
        mass, velocity, stiffness = chain.elastic_operators().at(u)
        found = pp.eigenvalues(chain, u, 12)
        rows = np.hstack([-np.linalg.solve(stiffness, velocity), -np.linalg.solve(stiffness, mass)])
        inverse = np.linalg.eigvals(np.vstack([rows, np.eye(90, 180)]))
        dense = 1.0 / inverse[np.argsort(-np.abs(inverse))[:12]]
        apart = np.abs(found[:, None] - dense)
        assert (apart.min(axis=0) <= 1e-9 * np.abs(found[-1])).all()
        assert (apart.min(axis=1) <= 1e-9 * np.abs(found[-1])).all()


def own_segments(n, k):
    """Unequal segments, centres, radii and springs."""
    lengths = 1.0 + 0.5 * np.sin(k)
    return {
        "lengths": 0.9 * lengths / lengths.sum(),
        "base": 0.1,
        "centres": 0.5 + 0.3 * np.cos(k),
        "gyration_radii": 0.01 + 0.005 * np.sin(2 * k),
        "springs": n * (1.0 + 0.5 * np.cos(3 * k)),
    }


TERMS = pp.PointMass(0.41, 0.3), pp.Spring(0.7, 12.0), pp.Damper(1.0, 0.2), pp.Foundation(3.0)
FITTED = [replace(pipe, gamma=-3.0, terms=TERMS) for pipe in PIPES[1:3]]


@pytest.mark.parametrize(
    ("chain", "u"),
    [
        *((pp.Chain(PIPES[k], 200), u) for k, u in enumerate((6.0, 9.0, 3.0))),
        *((pp.Chain(pipe, n), 5.0) for pipe in FITTED for n in (3, 40, 70)),
        *((pp.Chain(pipe, **own_segments(90, np.arange(90))), 5.0) for pipe in FITTED),
        (pp.Chain(PIPES[1], **own_segments(120, np.arange(120))), 5.0),
    ],
    ids=repr,
)
def test_chains_of_any_kind_have_their_own_exact_roots_and_say_so(chain, u):
    """Newton's correction by shooting along the chain with 30 digits."""
    found = pp.modes(chain, u, 3)
    sizes = np.abs(found.eigenvalues)
    true = np.array([abs(chain_newton_step(chain, z, u)) for z in found.eigenvalues])
    assert (true <= found.errors + 1e-15 * sizes).all()
    assert (found.errors <= 1e-9 * (1.0 + sizes)).all()


def test_400_and_800_segments_extrapolate_to_the_continuous_pipe():
    """Second order, so (4 x fine - coarse) / 3; the rest is of fourth order."""
    exact = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2)), 6.0, 8)
    coarser, coarse, fine = (
        pp.eigenvalues(pp.Chain(pp.Pipe(0.2), n), 6.0, 8) for n in (200, 400, 800)
    )
    order = np.log2(np.abs(coarse - exact) / np.abs(fine - exact))
    np.testing.assert_allclose(order, 2.0, atol=1e-3)
    two = (4.0 * fine - coarse) / 3.0
    assert (np.abs(two / exact - 1.0) < 1e-8).all()
    three = (64.0 * fine - 20.0 * coarse + coarser) / 45.0
    assert (np.abs(three / exact - 1.0) < 1e-11).all()


def test_100000_segments_meet_the_continuous_pipe_to_six_digits():
    found = pp.eigenvalues(pp.Chain(pp.Pipe(0.2), 100_000), 6.0, 8)
    exact = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2)), 6.0, 8)
    assert (np.abs(found / exact - 1.0) < 1e-6).all()


def test_a_long_chain_answers_for_many_eigenvalues_as_for_few():
    chain = pp.Chain(pp.Pipe(0.2), 150)
    all_of_them = pp.eigenvalues(chain, 6.0)
    for count in (1, 2, 5, 30, 140):
        found = pp.eigenvalues(chain, 6.0, count)
        in_order(found)
        np.testing.assert_allclose(found, all_of_them[:count], rtol=1e-8)


# ---------------------------------------------------------------------- singular stiffness


@pytest.mark.parametrize("n", [3, 100])
def test_without_any_spring_gravity_holds_the_chain(n):
    """A hanging chain of free joints swings like a rope: J0(2 omega sqrt(L / g)) = 0 as n grows."""
    chain = pp.Chain(pp.Pipe(0.2, gamma=9.0), n, springs=np.zeros(n))
    found = pp.eigenvalues(chain, 0.0, 4)
    reference = companion_eigenvalues(*chain.operators().at(0.0))
    assert distances(found, reference).max() < 1e-7
    if n == 100:
        assert found[0].imag == pytest.approx(2.404825557695773 * np.sqrt(9.0) / 2.0, rel=1e-4)


@pytest.mark.parametrize(("n", "count"), [(3, 4), (8, 4), (100, 4), (200, 8)])
def test_a_chain_that_nothing_holds_rests_at_zero(n, count):
    """No springs, no gravity, no flow: every eigenvalue is a double zero."""
    found = pp.eigenvalues(pp.Chain(pp.Pipe(0.2), n, springs=np.zeros(n)), 0.0, count)
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


@pytest.mark.parametrize(("n", "joint"), [(4, 0), (4, 2), (100, 0), (100, 40)])
def test_one_joint_without_a_spring_swings_free(n, joint):
    """Without gravity and flow the chain turns freely about it: a double zero, the rest elastic."""
    springs = np.full(n, float(n))
    springs[joint] = 0.0
    chain = pp.Chain(pp.Pipe(0.2), springs=springs)
    found = pp.eigenvalues(chain, 0.0, 6)
    np.testing.assert_allclose(found[:2], 0.0, atol=1e-6)
    assert (np.abs(found[2:]) > 1.0).all()
    reference = companion_eigenvalues(*chain.operators().at(0.0))
    assert distances(found[2:], reference).max() < 1e-7


@pytest.mark.parametrize("n", [8, 100])
def test_the_onset_of_divergence_has_an_eigenvalue_at_zero(n):
    """A standing pipe at the speed where its stiffness is singular."""
    chain = pp.Chain(pp.Pipe(0.2, gamma=-10.0), n)
    onset = pp.crossings(chain, 3.0)[0]
    assert onset.kind == "divergence"
    stiffness = chain.operators().at(onset.speed)[2]
    joints = np.tri(n)
    assert abs(np.linalg.det(joints.T @ stiffness @ joints / chain.springs)) < 1e-9
    assert abs(pp.eigenvalues(chain, onset.speed, 4)[0]) < 1e-10


@pytest.mark.parametrize("n", [6, 100])
def test_a_column_at_its_own_buckling_weight_has_a_double_zero(n):
    """gamma where K at rest is singular, from the matrices alone."""
    chain = pp.Chain(pp.Pipe(0.2), n)
    ops = chain.operators()
    weight = pp.Chain(pp.Pipe(0.2, gamma=1.0), n).operators().stiffness - ops.stiffness
    gamma = -1.0 / np.linalg.eigvals(np.linalg.solve(ops.stiffness, weight)).real.max()
    found = pp.eigenvalues(chain.with_pipe(pp.Pipe(0.2, gamma=gamma)), 0.0, 4)
    if n == 100:
        assert gamma == pytest.approx(-7.837, abs=1e-3)
    assert (np.abs(found[:2]) < 1e-5).all()
    assert (np.abs(found[2:]) > 1.0).all()


# ----------------------------------------------------------------------------- what fails


MASSLESS = {
    "lengths": [0.3, 0.3, 0.4],
    "centres": [0.0, 1.0, 0.5],
    "gyration_radii": [0.0, 0.0, 0.1],
}
"""A chain whose first node has no mass."""


@pytest.mark.parametrize("by", ["recursion", "matrices"])
def test_a_node_without_mass_has_roots_that_no_digits_hold_and_says_so(by):
    model = pp.Chain(pp.Pipe(0.0), **MASSLESS)
    if by == "matrices":
        scene = modular.chain(pp.Pipe(0.0), springs=model.springs, **MASSLESS)
        model = scene.plus(modular.TorsionalSpring(1, 0.0, damping=0.0))
    found = pp.modes(model, 3.0)
    assert found.converged.tolist() == [True] * 2 + [False]
    assert not found.errors[2] < np.abs(found.eigenvalues[2])
    with pytest.raises(pp.NotConverged, match="2 of 6 eigenvalues at u = 3 failed") as caught:
        pp.eigenvalues(model, 3.0)
    assert isinstance(caught.value, pp.PipedynError)
    assert caught.value.result.converged.tolist() == [True] * 4 + [False] * 2


# --------------------------------------------------------------------------------- modes


@pytest.mark.parametrize("u", [0.0, 6.0, 8.0])
@pytest.mark.parametrize("pipe", PIPES, ids=repr)
def test_modes_solve_the_models_equation_of_motion(pipe, u):
    """P(lambda) x = 0 with the matrices that the model shows."""
    for model in [*every_model(pipe), pp.Chain(pipe, 80)]:
        mass, damping, stiffness = model.operators().at(u)
        found = pp.modes(model, u, min(model.dof, 4))
        assert found.converged.all()
        for shape in found.shapes:
            x, value = shape.coordinates, shape.eigenvalue
            terms = value**2 * mass @ x, value * damping @ x, stiffness @ x
            size = sum(map(np.linalg.norm, terms)) + np.linalg.norm(np.abs(stiffness) @ np.abs(x))
            assert np.linalg.norm(sum(terms)) < 1e-10 * size


@pytest.mark.parametrize("u", [0.0, 6.0])
def test_a_modes_largest_displacement_is_one_and_real_there(u):
    s = np.linspace(0.0, 1.0, 2001)
    models = [*every_model(pp.Pipe(0.2)), pp.Chain(pp.Pipe(0.2), 100), pp.Continuum(pp.Pipe(0.2))]
    for model in models:
        count = 1 if isinstance(model, pp.Chain) and model.dof == 1 else 3
        for shape in pp.modes(model, u, count).shapes:
            displacement = shape(s)
            assert displacement[0] == 0.0
            largest = displacement[np.argmax(np.abs(displacement))]
            assert largest == pytest.approx(1.0, abs=2e-3)


def test_a_pair_of_conjugate_eigenvalues_is_one_mode_and_a_real_one_another():
    for model in (pp.Chain(pp.Pipe(0.2), 9), pp.Galerkin(pp.Pipe(0.2, damping=0.1), 9)):
        roots, found = pp.eigenvalues(model, 5.0), pp.modes(model, 5.0)
        assert (roots.imag < 0.0).any()
        np.testing.assert_allclose(found.eigenvalues, roots[roots.imag >= 0.0], rtol=1e-9)
        np.testing.assert_array_equal(pp.modes(model, 5.0, 3).eigenvalues, found.eigenvalues[:3])


def test_the_first_mode_at_rest_is_the_cantilevers():
    """w(1/2) / w(1) = 0.3395, the tabulated first mode of a clamped-free beam."""
    shape = pp.modes(pp.Continuum(pp.Pipe(0.2)), 0.0, 1).shapes[0]
    assert abs(shape([0.5])[0] / shape([1.0])[0]) == pytest.approx(0.3395, abs=5e-5)


def test_modes_report_size_and_residuals():
    found = pp.modes(pp.Chain(pp.Pipe(0.2), 100), 6.0, 6)
    assert (found.speed, found.size, found.discretisation) == (6.0, 100, None)
    assert found.residuals.shape == found.converged.shape == (6,)
    assert (found.residuals < 1e-10).all()
    assert [shape.eigenvalue for shape in found.shapes] == list(found.eigenvalues)


OVERDAMPED = pp.Pipe(0.5, damping=1e3)

STIFF_SHORT = modular.chain(OVERDAMPED, 3, springs=[5e8] * 3, lengths=[0.3, 1e-5, 0.69999])


@pytest.mark.parametrize(
    ("model", "missing"),
    [
        (pp.Chain(pp.Pipe(0.2, damping=1e-3), 150), 0),
        (pp.Galerkin(pp.Pipe(0.2), 200, "legendre"), 0),
        (pp.Chain(OVERDAMPED, lengths=[0.3, 1e-5, 0.69999], springs=[5e8] * 3), 0),
        (STIFF_SHORT, 0),
        (STIFF_SHORT.plus(modular.Custom(nodes=(1,), energy=lambda q: 0.0 * q[0])), 1),
    ],
    ids=["long", "Legendre", "unequal", "unequal scene", "with a part of one's own"],
)
def test_rounding_excuses_no_pair_that_misses_the_operators(model, missing):
    """Its allowance, eps |lambda|^2, exceeds 1 for the highest of these modes: some are refined."""
    found = pp.modes(model, 9.0)
    assert found.residuals[found.converged].max() <= 1e-3
    assert np.count_nonzero(~found.converged) == missing
    mass, velocity, stiffness = model.operators().at(9.0)
    sizes = [np.abs(matrix).sum(axis=1).max() for matrix in (mass, velocity, stiffness)]
    for value, shape, good in zip(found.eigenvalues, found.shapes, found.converged, strict=True):
        q = shape.coordinates
        missed = np.abs((value**2 * mass + value * velocity + stiffness) @ q).max()
        size = np.array([abs(value) ** 2, abs(value), 1.0]) @ sizes * np.abs(q).max()
        assert missed <= 1e-6 * size or not good


# ---------------------------------------------------------------------------- very unequal parts

SHORT_FIRST = np.array([1.954e-6, 0.192, 0.8028, 0.00521])
UNEQUAL = {
    "two": (pp.Chain(pp.Pipe(0.2), lengths=[1e-6, 1.0 - 1e-6]), 3.0),
    "close pairs inside": (pp.Chain(pp.Pipe(0.2), lengths=[0.5, 1e-6, 1e-6, 0.5 - 2e-6]), 9.0),
    "springs": (pp.Chain(pp.Pipe(0.2), lengths=[0.5, 0.2, 0.3], springs=[1e8, 1.0, 1e4]), 2.0),
    "overdamped": (
        pp.Chain(
            pp.Pipe(1e-12, -1e4, damping=1.0),
            lengths=SHORT_FIRST / SHORT_FIRST.sum(),
            springs=[4.0] * 4,
        ),
        1.0,
    ),
    "long radii": (
        pp.Chain(pp.Pipe(0.2), lengths=[0.4, 1e-6, 0.6 - 1e-6], gyration_radii=[0.1, 0.2, 0.1]),
        4.0,
    ),
    "with terms": (pp.Chain(pp.Pipe(0.2, terms=ALL), lengths=[0.5, 1e-6, 1e-6, 0.5 - 2e-6]), 3.0),
    "mass on a short one": (
        pp.Chain(
            pp.Pipe(0.2, 2.0, terms=(pp.PointMass(0.6, 0.3), pp.Spring(0.6, 50.0))),
            lengths=[0.6 - 5e-7, 1e-6, 0.4 - 5e-7],
        ),
        3.0,
    ),
    "stiff spring": (pp.Chain(pp.Pipe(0.2, terms=(pp.Spring(0.63, 1e9),)), 5), 3.0),
    "heavy mass": (
        pp.Chain(pp.Pipe(0.2, terms=(pp.PointMass(1.0, 1e3),)), lengths=[0.5, 1e-4, 0.5 - 1e-4]),
        3.0,
    ),
}


@pytest.mark.parametrize("name", UNEQUAL)
def test_every_root_of_very_unequal_parts_is_known_as_well_as_said(name):
    chain, u = UNEQUAL[name]
    # The elastic stiffness is small against a stiff spring's.
    claim = 1e-7 if name == "stiff spring" else 1e-10
    found = pp.modes(chain, u)
    assert found.converged.all()
    sizes = np.abs(found.eigenvalues)
    true = np.array([abs(chain_newton_step(chain, z, u, 300)) for z in found.eigenvalues])
    assert (true <= found.errors + 2e-15 * sizes).all()
    assert (found.errors <= claim * np.maximum(sizes, 1.0)).all()


@pytest.mark.parametrize("seed", [319, 371, 534])
def test_no_stiff_root_is_missed_where_lapack_gives_few_of_its_digits(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    lengths = 10.0 ** rng.uniform(-5.5, 0.0, n)
    springs = n * 10.0 ** rng.uniform(-2.0, 8.0, n) if rng.random() < 0.5 else np.full(n, 1.0 * n)
    beta, gamma, damping, hysteresis = (
        rng.uniform(0.0, 0.9),
        *map(rng.choice, ([0.0, 10.0, -5.0], [0.0, 1e-9, 1e-3, 1.0, 1e3], [0.0, 0.0, 0.1])),
    )
    pipe = pp.Pipe(beta, gamma, damping=damping, hysteresis=hysteresis)
    chain = pp.Chain(pipe, lengths=lengths / lengths.sum(), springs=springs)
    assert pp.modes(chain, rng.uniform(0.0, 6.0)).converged.all()


@pytest.mark.parametrize("short", [1e-3, 1e-5, 1e-7])
def test_a_spinning_first_segment_has_the_frequency_of_the_scaled_matrices(short):
    chain = pp.Chain(pp.Pipe(0.2), lengths=[short, 1.0 - short])
    mass, _, stiffness = chain.operators().at(0.0)
    scale = 1.0 / np.sqrt(np.diag(mass))
    squares = scipy.linalg.eigvalsh(*(scale[:, None] * part * scale for part in (stiffness, mass)))
    found = pp.eigenvalues(chain, 0.0)
    assert not found.real.any()
    np.testing.assert_allclose(found[2].imag, np.sqrt(squares[1]), rtol=4e-15)


def test_stiff_roots_of_unequal_segments_are_tracked_with_the_slow_ones():
    chain = pp.Chain(pp.Pipe(0.2), lengths=[0.6, 1e-6, 0.4 - 1e-6])
    loci = pp.root_loci(chain, [0.0, 3.0, 6.0], 3)
    assert loci.converged.all()
    for u, row in zip(loci.speeds, loci.eigenvalues, strict=True):
        true = np.array([abs(chain_newton_step(chain, z, float(u), 300)) for z in row])
        assert (true <= 1e-12 * np.abs(row)).all()
    critical = pp.critical_speed(chain)
    speed, _ = chain_crossing(chain, critical.speed, critical.frequency, 80)
    assert abs(critical.speed - float(speed)) <= critical.error <= 1e-10


@pytest.mark.parametrize("beta", [0.0, 0.2])
def test_a_root_at_infinity_is_given_as_none(beta):
    class Lighter(pp.Galerkin):
        """A user's own model, whose third coordinate has no inertia."""

        def elastic_operators(self):
            ops = super().elastic_operators()
            moves = np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])
            names = "mass", "gyroscopic", "end_flux"
            return replace(ops, **{name: moves * getattr(ops, name) for name in names})

    model = Lighter(pp.Pipe(beta), 3)
    found = pp.modes(model, 2.0)
    assert found.converged.tolist() == np.isfinite(found.eigenvalues).tolist() == [1, 1, 0, 0]
    assert np.isinf(found.errors[2:]).all()
    assert np.isfinite(found.errors[:2]).all()
    assert np.isinf(found.residuals[2:]).all()
    with pytest.raises(pp.NotConverged, match="not found"):
        found.shapes[-1]([1.0])
    with pytest.raises(pp.NotConverged, match="beyond double precision"):
        pp.critical_speed(model)
    loci = pp.root_loci(model, [0.0, 1.0], 2)  # the finite roots are followed
    assert loci.eigenvalues[-1] == pytest.approx(pp.eigenvalues(model, 1.0, 4)[[0, 2]])


def test_errors_of_long_chains_need_no_dense_matrices():
    """Those of 20,000 segments would take 3 GB each; errors grow as n, either way."""
    chains = {n: pp.Chain(pp.Pipe(0.2), n) for n in (500, 2001, 20_000)}  # dense ones up to 2000
    errors = {n: pp.modes(chain, 4.0, count=1).errors for n, chain in chains.items()}
    for n in (2001, 20_000):
        np.testing.assert_allclose(errors[n] / n, errors[500] / 500, rtol=0.5)
    assert (errors[20_000] < 1e-9).all()
