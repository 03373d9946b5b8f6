# SPDX-License-Identifier: MIT
"""Linear questions about bent pipes in three dimensions: motions in the plane of rest and across.

Most answers are compared with the Jacobian of the motion in space, about a rest that SciPy's
Newton's method finds; the package uses it for no linear question.
"""

import dataclasses
import math
import pickle
import warnings
from functools import partial

import numpy as np
import pytest
from scipy.optimize import root

import pipedyn as pp

LEVEL = math.pi / 2
HOSE = {"length": 0.45, "pipe_mass": 0.19, "fluid_mass": 0.032, "damping_time": 2e-3}

silent = pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")
random_pipes = pytest.mark.parametrize("seed", range(4))


def level(beta=0.2, gamma=10.0, **numbers):
    return pp.Pipe(beta, gamma, inclination=LEVEL, **numbers)


def in_space(pipe, m=8):
    return pp.Galerkin(pipe, m, "legendre", dimensions=3)


def loaded(seed):
    """A random loaded pipe as a chain or a reduced model in three dimensions."""
    random = np.random.default_rng(seed)
    pipe = pp.Pipe(
        *(random.uniform(0.1, 0.6), random.uniform(2.0, 25.0)),
        **{"inclination": random.uniform(0.3, 1.8), "damping": 0.01},
        terms=[
            pp.Load(random.uniform(0.3, 1.0), random.normal(size=2)),
            pp.PointMass(random.uniform(0.3, 1.0), random.uniform(0.0, 0.5), inertia=0.002),
            pp.Damper(random.uniform(0.3, 1.0), random.uniform(0.0, 0.3)),
            pp.Spring(random.uniform(0.3, 1.0), random.uniform(0.0, 5.0)),
            pp.Damper(0.8, 0.1),
        ],
    )
    return pp.Chain(pipe, 5, dimensions=3) if seed % 2 else in_space(pipe, 6)


def rest_of(model, u):
    """The rest in space to which loads and flow lead as both grow in twenty steps."""
    planar, rest = model.planar, np.zeros(model.planar.dof)
    pipe = planar.pipe

    def lightened(share):
        terms = [
            dataclasses.replace(one, force_x=share * one.force_x, force_y=share * one.force_y)
            if isinstance(one, pp.Load)
            else one
            for one in pipe.terms
        ]
        return planar.with_pipe(dataclasses.replace(pipe, gamma=share * pipe.gamma, terms=terms))

    for share in np.linspace(0.05, 1.0, 20):
        some = lightened(share)

        def turned(q, some=some, share=share):
            return some.rhs(0.0, np.append(q, 0.0 * q), share * u)[q.size :]

        rest = root(turned, rest, tol=1e-13).x
    return np.append(rest, 0.0 * rest)


def jacobian(model, u, rest):
    return model.jacobian(0.0, np.append(rest, 0.0 * rest), u)


def moved(model, rest, q, s):
    """Displacements along x and z of small displacements q, (2, p), by differences of shapes."""
    h = 1e-6
    there = [model.shape(rest + sign * h * q, s)[:, [0, 2]] for sign in (1.0, -1.0)]
    return (there[0] - there[1]).T / (2.0 * h)


@random_pipes
def test_modes_are_eigenvectors_in_the_plane_of_rest_or_across_it(seed):
    model, u, s = loaded(seed), 2.5, [0.2, 0.55, 1.0]
    rest = rest_of(model, u)
    found = pp.modes(model, u, 6)
    values, vectors = np.linalg.eig(jacobian(model, u, rest))
    half = model.dof // 2
    assert 0 < found.across.sum() < found.across.size
    for value, across, shape in zip(found.eigenvalues, found.across, found.shapes, strict=True):
        near = np.abs(values - value)
        assert near.min() < 1e-7 * (1.0 + abs(value))
        q = vectors[: model.dof, near.argmin()]
        in_plane, out_of_it = np.abs(q[:half]).max(), np.abs(q[half:]).max()
        assert (out_of_it > 1e6 * in_plane) == across
        assert (in_plane > 1e6 * out_of_it) != across
        there = shape(s)
        assert not there[int(not across)].any()
        expected = moved(model, rest, q.real, s) + 1j * moved(model, rest, q.imag, s)
        expected = expected[int(across)]
        assert there[int(across)] == pytest.approx(
            expected * (there[int(across)][-1] / expected[-1]), abs=1e-6
        )
        assert np.abs(shape(np.linspace(0.0, 1.0, 801))).max() == pytest.approx(1.0, abs=1e-4)


@random_pipes
def test_branches_in_the_plane_are_those_of_the_planar_model_and_others_are_across(seed):
    model, speeds = loaded(seed), [0.0, 1.5, 3.0]
    loci = pp.root_loci(model, speeds, 2)
    assert sorted(zip(loci.modes[loci.modes < 3], loci.across[loci.modes < 3], strict=True)) == [
        (1, False),
        (1, True),
        (2, False),
        (2, True),
    ]
    planar = pp.root_loci(model.planar, speeds, 2)
    in_plane = loci.eigenvalues[:, ~loci.across & (loci.modes < 3)]
    assert in_plane == pytest.approx(planar.eigenvalues[:, planar.modes < 3], rel=1e-9)
    half = model.dof // 2
    for u, row in zip(speeds, loci.eigenvalues[:, loci.across], strict=True):
        whole = jacobian(model, u, rest_of(model, u))
        own = np.r_[half : 2 * half, 3 * half : 4 * half]
        values = np.linalg.eigvals(whole[np.ix_(own, own)])
        for one in row:
            assert np.abs(values - one).min() < 1e-7 * (1.0 + abs(one))
    assert loci.converged.all()
    assert loci.columns()["across"].size == loci.eigenvalues.size


@random_pipes
def test_loads_across_the_plane_have_the_response_of_the_motion_in_space(seed):
    """Forces by a damper, whose slope of accelerations is that of a force times a velocity."""
    model, u, w, s = loaded(seed), 2.0, 7.0, 0.8
    rest, half = rest_of(model, u), model.dof // 2
    own = np.r_[half : 2 * half, 3 * half : 4 * half]
    whole = jacobian(model, u, rest)[np.ix_(own, own)]
    h = 1e-7
    to_z = np.array(
        [model.shape(rest + h * one, [s, 1.0])[:, 2] / h for one in np.eye(model.dof)[half:]]
    ).T
    *others, damper = model.pipe.terms
    stronger = (*others, dataclasses.replace(damper, coefficient=1.1))
    damped = model.with_pipe(dataclasses.replace(model.pipe, terms=stronger))
    slope = jacobian(damped, u, rest)[np.ix_(own, own)] - whole
    by_force = -slope[half:, half:] @ to_z[0] / (to_z[0] @ to_z[0])
    state = np.append(rest, 0.0 * rest)

    def by_base(row):
        base = np.zeros((3, 3))
        base[row, 2] = h
        rates = [model.rhs(0.0, state, u, base=sign * base) for sign in (1.0, -1.0)]
        return (rates[0] - rates[1])[own][half:] / (2.0 * h)

    shaken = sum((1j * w) ** k * by_base(k) for k in range(3))
    for asked, load in ((("force", s), by_force), ("base", shaken)):
        q = np.linalg.solve(1j * w * np.eye(2 * half) - whole, np.append(0.0 * load, load))
        found = pp.frequency_response(model, u, [w], input=asked, direction="z")
        assert found.response[0] == pytest.approx(to_z[1] @ q[:half], rel=2e-6)
        assert found.direction == "z"
        in_plane = pp.frequency_response(model, u, [w], input=asked)
        planar = pp.frequency_response(model.planar, u, [w], input=asked)
        assert in_plane.response == pytest.approx(planar.response, rel=1e-8)


def test_a_response_is_asked_across_the_plane_of_models_that_leave_it():
    pipe = pp.Pipe(0.2, damping=0.01)
    straight = in_space(pipe)
    found = [pp.frequency_response(straight, 3.0, [5.0], direction=of).response for of in "xz"]
    assert found[0] == found[1]
    with pytest.raises(
        ValueError, match="direction must be 'x' or 'y' for a model that moves in a plane"
    ):
        pp.frequency_response(straight.planar, 3.0, [5.0], direction="z")
    with pytest.raises(ValueError, match="direction"):
        pp.frequency_response(straight, 3.0, [5.0], input=("force", 0.5), direction="y")
    sagging = pp.frequency_response(in_space(level(damping=0.01)), 3.0, direction="z")
    own = sagging.poles[sagging.poles.imag > 0.0]
    modes = pp.modes(in_space(level(damping=0.01)), 3.0)
    for one in own:
        assert modes.across[np.abs(modes.eigenvalues - one).argmin()]
    assert len(sagging.resonances) > 0


@pytest.mark.parametrize(
    ("numbers", "across", "in_plane"),
    [
        ({"gamma": 10.0, "inclination": LEVEL}, (5.7797017, 13.982365), 5.9544239),
        ({"gamma": 20.0, "inclination": LEVEL}, (6.2343973, 14.653427), 6.6770006),
        ({"gamma": 10.0, "inclination": math.pi / 4}, (6.1903078, 14.736836), 6.2632989),
    ],
)
def test_the_continuous_sagging_pipe_flutters_across_where_a_boundary_value_problem_says(
    numbers, across, in_plane
):
    exact = pp.Continuum(pp.Pipe(0.2, **numbers), dimensions=3)
    found = pp.critical_speed(exact)
    assert (found.speed, found.frequency) == pytest.approx(across, abs=6e-7)
    assert (found.across, found.mode, found.kind) == (True, 2, "flutter")
    assert found.error < 1e-9
    assert np.abs(found.mode_shape([0.3, 1.0])[0]).max() == 0.0
    assert exact.planar.dimensions == 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pp.FluttersAcross)
        assert pp.critical_speed(exact.planar).speed == pytest.approx(in_plane, abs=6e-8)


def test_the_continuous_sagging_pipe_answers_across_as_large_reduced_models(tmp_path):
    exact, model = pp.Continuum(level(), dimensions=3), in_space(level(), 24)
    few = pp.eigenvalues(exact, 4.0, 8)
    assert few == pytest.approx(pp.eigenvalues(model, 4.0, 8), rel=1e-9)
    chains = [pp.eigenvalues(pp.Chain(level(), n, dimensions=3), 4.0, 8) for n in (20, 40)]
    errors = [np.abs(one - few).max() for one in chains]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    modes = pp.modes(exact, 4.0, 4)
    assert modes.across.tolist() == [False, True, False, True]
    assert modes.size == 2 * modes.shapes[0].model.planar.dof
    loci = [pp.root_loci(one, [1.0, 4.0], 2) for one in (exact, model)]
    assert loci[0].eigenvalues == pytest.approx(loci[1].eigenvalues, rel=1e-8)
    assert loci[0].complete
    each = [
        pp.frequency_response(one, 4.0, [4.0], input=("force", 0.5), direction="z")
        for one in (exact, model)
    ]
    assert each[0].response == pytest.approx(each[1].response, rel=1e-4)
    exact.save(tmp_path / "exact.npz")
    for copy in (pp.load(tmp_path / "exact.npz"), pickle.loads(pickle.dumps(exact))):
        assert (copy.dimensions, copy.pipe) == (3, exact.pipe)
    assert repr(exact).endswith(", dimensions=3)")
    straight = pp.Continuum(pp.Pipe(0.2), dimensions=3)
    assert pp.critical_speed(straight).speed == pp.critical_speed(straight.planar).speed


def test_sweeps_follow_a_pipe_from_straight_to_sagging():
    model = in_space(pp.Pipe(0.2, 0.0, inclination=LEVEL))
    gammas = [0.0, 10.0, 20.0]
    found = pp.critical_speeds(model, {"gamma": gammas})
    assert found.across.tolist() == [False, True, True]
    expected = [pp.critical_speed(in_space(level(gamma=one))).speed for one in gammas]
    assert found.speeds == pytest.approx(expected, rel=1e-9)
    curve = pp.stability_curve(lambda gamma: in_space(level(gamma=gamma)), gammas)
    assert curve.speeds == pytest.approx(expected, rel=1e-12)
    assert found.columns()["across"].tolist() == [False, True, True]
    # A planar model, too, bends with its weight.
    with pytest.warns(pp.FluttersAcross):
        planar = pp.critical_speeds(model.planar, {"gamma": gammas})
    assert planar.speeds[1:] == pytest.approx([5.9544239, 6.6770006], abs=1e-4)
    assert planar.across is None


@silent
@pytest.mark.parametrize("tilt", [1e-9, 1e-6, 1e-3])
def test_onsets_of_both_planes_are_found_where_they_nearly_coincide(tilt):
    """Both tend to the onset of the hanging pipe as the square of the inclination."""
    model = in_space(pp.Pipe(0.2, 10.0, inclination=tilt, damping=0.002))
    hanging = pp.critical_speed(pp.Galerkin(pp.Pipe(0.2, 10.0, damping=0.002), 8, "legendre"))
    found = pp.crossings(model, hanging.speed + 0.1)
    assert sorted(one.across for one in found) == [False, True]
    assert found[-1].unstable_after == 4
    assert found.speeds == pytest.approx(hanging.speed, abs=1e-9 + 2.0 * tilt**2)
    for one in found:
        assert one.mode == hanging.mode
        assert one.sensitivity.speed.gamma == pytest.approx(
            hanging.sensitivity.speed.gamma, abs=1e-6 + tilt
        )


@pytest.mark.parametrize(
    ("m", "expected"),  # where eigenvalues of the Jacobian of the motion pass the axis
    [(6, [(7.4739, 6), (7.5004, 4)]), (10, [(7.3832, 2), (7.4778, 4)])],
)
def test_one_mode_may_calm_down_next_to_where_another_starts_to_flutter(m, expected):
    load = pp.Load(0.25, (0.835, 2.67))
    terms = [pp.RotationalDamper(0.25, 0.54, 0.1375), pp.Weight(0.25, 3.54), load]
    pipe = pp.Pipe(0.447, jet_angle=-0.844, terms=terms)
    model = pp.Galerkin(pipe, m, "beam", dimensions=3)
    found = [one for one in pp.crossings(model, 8.0) if one.speed > 7.0]
    assert [(one.speed, one.unstable_after) for one in found] == [
        (pytest.approx(u, abs=1e-4), count) for u, count in expected
    ]
    rest = rest_of(model, 7.0)
    branch = pp.equilibrium_branch(model, rest, 7.0, (7.0, 8.0))
    assert [one.speed for one in branch.points] == pytest.approx(
        [one.speed for one in found], rel=1e-9
    )


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")
def test_an_aspirating_pipe_that_sags_flutters_from_the_smallest_flow_on(dimensions):
    pipe = pp.Pipe(0.481, 12.43, flow="aspirating", inflow_share=0.8, inclination=-0.3)
    model = pp.Galerkin(pipe, 5, "beam", dimensions=dimensions)
    found = pp.crossings(model, 1.0)
    assert [one.speed for one in found] == [0.0] * 5 * (dimensions - 1)
    assert found[-1].unstable_after == model.dof * 2
    slight, more = (
        pp.critical_speed(model.with_pipe(dataclasses.replace(pipe, damping=delta))).speed
        for delta in (1e-7, 1e-5)
    )
    assert more / slight == pytest.approx(100.0, rel=1e-5)  # of first order in the damping


def test_two_modes_of_a_sagging_pipe_without_fluid_mass_meet_in_each_plane():
    model = in_space(level(beta=0.0, gamma=5.0))
    for found in pp.crossings(model, 5.0):
        (before, after) = (pp.eigenvalues(model, found.speed + step) for step in (-1e-3, 1e-3))
        growing = after[(after.imag > 0.0) & (after.real > 1e-2)]
        assert np.abs(growing.imag - found.frequency).min() < 1e-2
        assert found.unstable_before == np.count_nonzero(before.real > 1e-2)
        assert found.unstable_after == np.count_nonzero(after.real > 1e-2)
        assert found.mode == 2  # the higher of the two
        assert found.error < 1e-5


def test_a_pipe_that_buckles_in_a_plane_diverges_across_it_where_its_loads_turn_to_the_other_side():
    """The flow changes the mode that buckles, and so which of two loads across is the greater.

    In the plane the pipe stays on its side, from which it would snap at u = 1.67 only.
    """
    loads = [pp.Load(1.0, (0.05, -3.5)), pp.Load(0.6, (-0.1, 0.0))]
    model = in_space(pp.Pipe(0.2, damping=0.01, terms=loads))
    found = pp.critical_speed(model)
    assert (found.kind, found.across, found.frequency) == ("divergence", True, 0.0)
    assert (found.unstable_before, found.unstable_after) == (0, 1)
    with pytest.warns(pp.FluttersAcross):
        assert pp.critical_speed(model.planar).speed == pytest.approx(1.6707, abs=1e-4)
    growth = []
    for u in (found.speed - 0.01, found.speed + 0.01):
        (rest,) = (q for q in pp.equilibria(model.planar, u).q if model.planar.tip(q)[0] > 0.3)
        values = np.linalg.eigvals(jacobian(model, u, np.append(rest, 0.0 * rest)))
        growth.append(values.real.max())
    assert growth[0] < 0.0 < growth[1]
    assert -growth[0] / growth[1] == pytest.approx(1.0, rel=0.05)
    step = 1e-4
    alpha = [
        pp.critical_speed(model.with_pipe(dataclasses.replace(model.pipe, alpha=1.0 + sign * step)))
        for sign in (1.0, -1.0)
    ]
    slope = (alpha[0].speed - alpha[1].speed) / (2.0 * step)
    assert found.sensitivity.speed.alpha == pytest.approx(slope, rel=1e-6)
    with pytest.raises(pp.NotConverged, match=r"it turns back at u = 1\.67") as turned:
        pp.crossings(model, 3.0)
    assert [one.across for one in turned.value.result] == [True, False]


def test_a_buckled_pipe_in_space_is_asked_about_the_configuration_chosen():
    """One root is 0: the pipe may turn about the axis."""
    model = in_space(pp.Pipe(0.2, -12.0, damping=0.01), 6)
    rest = next(q for q in pp.equilibria(model.planar, 1.0).q if np.abs(q).max() > 0.1)
    about = model.about(np.append(rest, 0.0 * rest))
    values = pp.eigenvalues(about, 1.0)
    expected = np.linalg.eigvals(jacobian(model, 1.0, np.append(rest, 0.0 * rest)))
    for one in expected:
        assert np.abs(values - one).min() < 1e-6 * (1.0 + abs(one))
    modes = pp.modes(about, 1.0, 3)
    assert abs(modes.eigenvalues[0]) < 1e-9
    assert modes.across.tolist() == [True, True, False]
    loci = pp.root_loci(about, [1.0], 2)
    assert loci.across.tolist() == [False, True, False, True]
    for one in loci.eigenvalues[0]:
        assert np.abs(values - one).min() < 1e-8 * (1.0 + abs(one))


def test_accuracy_and_relevance_are_asked_across_the_plane():
    pipe = level(damping=1e-3)
    found = pp.choose(pipe, "frequencies", 1e-3, u=2.0, count=1, among="legendre", dimensions=3)
    assert found.model.dimensions == 3
    trade = pp.trade(pipe, "root_loci", sizes=[6], repeats=1, families=["legendre", "consistent"],
                     speeds=[0.0, 3.0], count=2, dimensions=3)  # fmt: skip
    assert trade.failures == ()
    assert trade.of("legendre")[0].error < 1e-4 < trade.of("consistent")[0].error < 0.1
    weighed = pp.relevant(pipe, 2.0, "frequencies", count=2, dimensions=3)
    hanging = pp.eigenvalues(pp.Continuum(pp.Pipe(0.2, 10.0, damping=1e-3)), 2.0, 2)
    assert weighed["inclination"].answer.values == pytest.approx(
        np.repeat(hanging, 2)[[0, 2, 1, 3]]
    )
    roots = pp.eigenvalues(pp.Continuum(pipe, dimensions=3), 2.0, 4)
    assert weighed.growth == pytest.approx(roots.real.max(), rel=1e-6)
    assert found.answer == pytest.approx(roots[:2], rel=1e-3)
    assert "omega = 4." in weighed.full
    with pytest.raises(ValueError, match="dimensions must be from 2 to 3"):
        pp.trade(pipe, "frequencies", dimensions=4)


def test_questions_about_the_stability_of_a_sagging_pipe_in_a_plane_tell_of_the_other():
    pipe = level(damping=1e-3)
    chain = pp.Chain(pipe, 3)
    for ask in (
        lambda: pp.critical_speed(chain),
        lambda: pp.crossings(chain, 5.0),
        lambda: pp.critical_speeds(chain, {"beta": [0.2]}),
        lambda: pp.stability_curve(lambda _: chain, [1.0]),
        lambda: pp.stability_curve(lambda _: chain, [1.0], max_speed=1.0),
        lambda: pp.hopf(chain),
        lambda: pp.criticality_curve(lambda _: chain, [1.0]),
        lambda: pp.trade(pipe, "critical_speed", sizes=[3], families=["legendre"], repeats=1),
        lambda: pp.choose(pipe, "critical_speed", tolerance=0.1, among="legendre"),
        lambda: pp.relevant(pipe, 1.0, tolerance=0.5),
    ):
        with pytest.warns(
            pp.FluttersAcross, match="made with dimensions=3 answers for both"
        ) as seen:
            ask()
        assert [one.filename for one in seen] == [__file__]


@pytest.mark.parametrize("load", [pp.Load(1.0, (0.0, 1.0)), pp.DistributedLoad((0.0, 1.0))])
def test_only_the_part_of_a_load_across_the_pipe_bends_it_and_is_told(load):
    chain, name = pp.Chain(pp.Pipe(0.2, terms=[load]), 3), type(load).__name__
    along = pp.critical_speeds(chain, {f"{name}.force_y": [0.0, 2.0]})
    with pytest.warns(pp.FluttersAcross, match="rests bent") as seen:
        across = pp.critical_speeds(chain, {f"{name}.force_x": [0.0, 2.0]})
    assert [one.filename for one in seen] == [__file__]
    assert across.speeds[0] == pytest.approx(pp.critical_speed(chain).speed)
    in_both = pp.Chain(chain.pipe, 3, dimensions=3)
    true = pp.critical_speeds(in_both, {f"{name}.force_x": [0.0, 2.0]})
    assert true.across.tolist() == [False, True]
    assert true.speeds[1] < across.speeds[1]
    assert not along.failures


def test_a_level_hose_is_identified_by_its_motions_across_the_plane_of_sag():
    true, guess = (
        pp.Pipe.from_si(**HOSE, bending_stiffness=stiffness, inclination=LEVEL)
        for stiffness in (7.3e-3, 6e-3)
    )
    modes = pp.modes(pp.Continuum(true, dimensions=3), 0.0, 4)
    hertz = true.frequency_si(np.abs(modes.eigenvalues.imag)) / (2.0 * math.pi)
    measured = [
        pp.Measurement("frequency", hertz[modes.across][k], 0.01, mode=k + 1, across=True)
        for k in range(2)
    ]
    measured.append(pp.Measurement("frequency", hertz[~modes.across][0], 0.01))
    found = pp.identify(guess, measured, ["bending_stiffness"], dimensions=3)
    assert found.values == pytest.approx([7.3e-3], rel=1e-6)
    across = pp.critical_speed(pp.Continuum(true, dimensions=3))
    assert found.critical_speed == pytest.approx(across.in_si().speed, rel=1e-6)
    refused = r"measurements\[0\]\.across must be False unless dimensions=3 and a load bends"
    with pytest.raises(ValueError, match=refused):
        pp.identify(guess, measured, ["bending_stiffness"])
    hanging = dataclasses.replace(guess, inclination=0.0)
    with pytest.raises(ValueError, match=refused):
        pp.identify(hanging, measured, ["bending_stiffness"], dimensions=3)
    with pytest.raises(ValueError, match="across must be left out of a critical_speed"):
        pp.Measurement("critical_speed", 3.0, 0.1, across=True)


@pytest.mark.parametrize("make", [partial(pp.Chain, n=4), partial(pp.Galerkin, m=4)])
def test_what_cannot_be_asked_of_a_sagging_pipe_in_space_says_why(make):
    model = make(level(damping=0.01), dimensions=3)
    for ask in (
        lambda: pp.floquet(model, pp.Pulsation(4.0, 0.1, 20.0)),
        lambda: pp.parametric_regions(model, 4.0, 0.1, (15.0, 30.0)),
    ):
        with pytest.raises(ValueError, match="rests straight where the flow pulsates"):
            ask()
    with pytest.raises(ValueError, match="dimensions"):
        pp.Continuum(level(), dimensions=4)
