# SPDX-License-Identifier: MIT
"""Pipes with an inclined nozzle, which rest bent."""

import math
import pickle

import numpy as np
import pytest
from independent import dense_jacobian, derivative_along, pipe_rates, quadratic_eigenvalues
from scipy.special import ellipj, ellipk

import pipedyn as pp

pytestmark = pytest.mark.filterwarnings("ignore::pipedyn.FluttersAcross")  # models of a plane

NUMBERS = [
    ((2.0, 0.5, 1.0), (-0.69465682, -0.40688111, 0.88753556)),
    ((3.0, 1.2, 1.5), (-2.37663077, -0.57639231, 0.30112055)),
]
"""(u, psi, a): theta(1), x, y; digits as printed by a program in 30 digits."""


def pendulum(s, u, psi, alpha=1.0):
    """theta(s) of the weightless pipe at rest: psi + theta(1) - theta swings as a pendulum.

    phi'' = -a u^2 sin phi, phi(1) = psi, phi'(1) = 0, so that phi(s) = 2 asin(k sn(K + sqrt(a) u
    (1 - s), k)), k = sin(psi / 2).
    """
    k = math.sin(psi / 2.0)

    def phi(s):
        sn, *_ = ellipj(ellipk(k * k) + math.sqrt(alpha) * u * (1.0 - np.asarray(s)), k * k)
        return 2.0 * np.arcsin(k * sn)

    return phi(0.0) - phi(s)


def rest_of(model, u):
    """The only equilibrium."""
    (q,) = pp.equilibria(model, u).q
    return q


def legendre(psi, m=8, beta=0.2, **numbers):
    return pp.Galerkin(pp.Pipe(beta, jet_angle=psi, **numbers), m, "legendre")


@pytest.mark.parametrize(("case", "expected"), NUMBERS)
def test_the_pipe_rests_as_half_a_swing_of_a_pendulum(case, expected):
    u, psi, alpha = case
    model = legendre(psi, 20, alpha=alpha)
    q = rest_of(model, u)
    s = np.linspace(0.0, 1.0, 9)
    angles = model.functions(s, 1) @ q
    assert angles == pytest.approx(pendulum(s, u, psi, alpha), abs=2e-8)
    assert [angles[-1], *model.tip(q)] == pytest.approx(expected, abs=2e-8)


def test_a_small_angle_bends_the_pipe_as_the_textbook_says():
    """w = psi (s cos u - (sin u - sin(u (1 - s))) / u): book, eq. (5.112)."""
    u, psi, s = 2.5, 1e-4, np.linspace(0.0, 1.0, 6)
    model = legendre(psi)
    expected = psi * (s * math.cos(u) - (math.sin(u) - np.sin(u * (1.0 - s))) / u)
    assert model.shape(rest_of(model, u), s)[:, 0] == pytest.approx(expected, abs=1e-11)


def test_small_motions_about_the_bent_rest_are_those_of_its_equations():
    """By differences of virtual work, and by complex steps of the dense equations of chains."""
    u, pipe = 4.0, pp.Pipe(0.3, 2.0, damping=0.003, jet_angle=0.9)
    chain, model = pp.Chain(pipe, 6), pp.Galerkin(pipe, 5, "legendre")
    rest, bend = rest_of(chain, u), rest_of(model, u)
    exact = np.linalg.eigvals(dense_jacobian(chain, np.append(rest, np.zeros(6)), u))
    found = pp.eigenvalues(chain.about(rest), u)
    assert np.abs(found[:, None] - exact).min(axis=1).max() < 1e-9 * np.abs(exact).max()
    y = np.append(bend, np.zeros(5))
    columns = [
        derivative_along(lambda y: pipe_rates(model, y, u), y, way, 1e-3) for way in np.eye(10)
    ]
    exact = np.linalg.eigvals(np.transpose(columns))
    found = pp.eigenvalues(model.about(bend), u)
    assert np.abs(found[:, None] - exact).min(axis=1).max() < 1e-6 * np.abs(exact).max()
    scene = pp.modular.chain(pipe, 6)
    about = scene.about(scene.equilibrium(np.zeros(6), u))
    assert pp.eigenvalues(about, u) == pytest.approx(pp.eigenvalues(chain.about(rest), u), rel=1e-9)


def test_modes_of_a_bent_pipe_displace_the_line_that_is_drawn():
    u, s = 4.0, np.array([0.0, 0.3, 0.71, 1.0])
    pipe = pp.Pipe(0.3, jet_angle=0.9, terms=[pp.PointMass(0.6, 0.1)])
    for model in (pp.Chain(pipe, 9), pp.Galerkin(pipe, 8, "legendre")):
        rest = rest_of(model, u)
        about = model.about(rest)
        mode = pp.modes(about, u, 2).shapes[0]
        moved = [model.shape(rest + sign * 1e-5 * mode.coordinates.real, s) for sign in (1, -1)]
        expected = (moved[0] - moved[1])[:, 0] / 2e-5
        assert mode(s).real == pytest.approx(expected, abs=1e-8)
        assert np.abs(mode(np.linspace(0.0, 1.0, 201))).max() == pytest.approx(1.0, rel=1e-2)
        assert np.array_equal(pickle.loads(pickle.dumps(about)).resting(), rest)
        assert about.operators().at(u)[2] == pytest.approx(model.operators(rest).at(u)[2])
        assert "about" in repr(about)


def onset(model, highest=7.0):
    """Where the bent pipe begins to flutter."""
    branch = pp.equilibrium_branch(model, np.zeros(model.dof), 0.0, (0.0, highest))
    return next(point for point in branch.points if point.kind == "hopf")


def test_a_bent_pipe_flutters_where_a_pair_about_its_rest_passes_the_axis():
    pipe = pp.Pipe(0.2, damping=0.002, jet_angle=0.5)
    speeds = {}
    for model in (pp.Chain(pipe, 8), pp.Chain(pipe, 16), pp.Galerkin(pipe, 8, "legendre")):
        point = onset(model)
        speeds[model] = point.speed
        values = pp.eigenvalues(model.about(point.q), point.speed, 6)
        pair = values[np.argmin(np.abs(values.real))]
        assert abs(pair.real) < 1e-6
        assert pair.imag == pytest.approx(point.frequency, rel=1e-6)
    coarse, fine, exact = speeds.values()
    assert (coarse - exact) / (fine - exact) == pytest.approx(4.0, rel=0.25)


def test_the_jets_angle_moves_the_onset_by_its_square():
    straight = pp.critical_speed(legendre(0.0, damping=0.002)).speed
    small, large, mirrored = (
        onset(legendre(psi, damping=0.002)).speed - straight for psi in (0.02, 0.04, -0.04)
    )
    assert large / small == pytest.approx(4.0, rel=0.01)
    assert mirrored == pytest.approx(large, rel=1e-5)


@pytest.mark.parametrize(
    "make", [lambda p: pp.Galerkin(p, 8, "legendre"), lambda p: pp.Chain(p, 8)]
)
def test_cycles_of_a_bent_pipe_grow_by_the_law_of_its_normal_form(make):
    """With the quadratic terms that the jet's angle brings; cycles by collocation."""
    model = make(pp.Pipe(0.2, damping=0.002, jet_angle=0.5))
    law = pp.hopf(model, onset(model))
    slopes = []
    for above in (0.02, 0.01):
        cycle = pp.limit_cycle(model, law.speed + above, start=law)
        slopes.append(cycle.amplitude**2 / above)
    assert 2.0 * slopes[1] - slopes[0] == pytest.approx(law.amplitude_law, rel=1e-3)
    assert (law.criticality, law.other_unstable) == ("supercritical", 0)
    straight = pp.hopf(model.with_pipe(pp.Pipe(0.2, damping=0.002)))
    assert abs(law.amplitude_law / straight.amplitude_law - 1.0) > 0.3
    mirrored = model.with_pipe(pp.Pipe(0.2, damping=0.002, jet_angle=-0.5))
    assert pp.hopf(mirrored, onset(mirrored)).lyapunov == pytest.approx(law.lyapunov, rel=1e-4)


def test_a_standing_pipe_with_a_jet_rests_in_shapes_without_mirror_images():
    """A search from bends to one side alone finds four."""
    chain = pp.Chain(pp.Pipe(0.2, -60.0, jet_angle=0.7), 8)
    found = pp.equilibria(chain, 2.0)
    mirrored = pp.equilibria(pp.Chain(pp.Pipe(0.2, -60.0, jet_angle=-0.7), 8), 2.0)
    assert len(found) == len(mirrored) == 5
    apart = np.abs(found.q[:, None] + mirrored.q).max(axis=2)
    assert apart.min(axis=0).max() < 1e-7
    assert apart.min(axis=1).max() < 1e-7


@pytest.mark.filterwarnings("ignore::pipedyn.UnusualPipe")
def test_a_jet_turned_back_pulls_the_straight_pipe():
    """psi = pi: the thrust a u^2 with the other sign, and the straight pipe is at rest again."""
    back, plain = (pp.Pipe(0.3, damping=0.01, jet_angle=psi) for psi in (math.pi, 0.0))
    for make in (lambda p: pp.Chain(p, 6), lambda p: pp.Galerkin(p, 6)):
        mass, velocity, still = make(plain).operators().at(0.0)
        _, velocity, thrust = make(plain).operators().at(3.0)
        exact = quadratic_eigenvalues(mass, velocity, 2.0 * still - thrust)[:6]
        found = pp.eigenvalues(make(back), 3.0, 6)
        assert np.abs(found[:, None] - exact).min(axis=1).max() < 1e-8


def test_linear_questions_are_about_the_bent_rest_or_refused():
    pipe = pp.Pipe(0.2, jet_angle=0.3)
    for model in (pp.Chain(pipe, 4), pp.Galerkin(pipe, 4), pp.modular.chain(pipe, 4)):
        about = model.about(pp.equilibria(model, 2.0).q[0])
        expected = pp.eigenvalues(about, 2.0)
        assert pp.eigenvalues(model, 2.0) == pytest.approx(expected, rel=1e-8)
        assert pp.modes(model, 2.0).eigenvalues == pytest.approx(pp.modes(about, 2.0).eigenvalues)
        assert pp.root_loci(model, [1.0, 2.0]).eigenvalues[1].imag.max() > 0.0
        rule = r"must rest at u = .*; .* ask equilibrium_branch\(model, q, u, speeds\)"
        for ask in (lambda m: pp.eigenvalues(m, 3.0), pp.critical_speed, pp.hopf):
            with pytest.raises(ValueError, match=rule):
                ask(about)
    assert pp.eigenvalues(pp.Chain(pipe, 4), 0.0).size == 8  # without flow it is straight


@pytest.mark.parametrize(
    "make", [lambda p: pp.Galerkin(p, 8, "legendre"), lambda p: pp.Chain(p, 8)]
)
def test_the_critical_speed_is_the_first_hopf_point_on_the_branch_from_rest(make):
    model = make(pp.Pipe(0.2, damping=0.002, jet_angle=0.5))
    point, found = onset(model), pp.critical_speed(model)
    assert (found.kind, found.mode, found.stable_from) == ("flutter", 2, 0.0)
    assert (found.speed, found.frequency) == pytest.approx((point.speed, point.frequency), rel=1e-8)
    law, own = pp.hopf(model, point), pp.hopf(model)
    assert own.amplitude_law == pytest.approx(law.amplitude_law, rel=1e-5)


def test_jet_angle_is_checked_converted_shown_and_weighed():
    with pytest.raises(ValueError, match=r"^jet_angle must be 0 for an aspirating pipe, as no jet"):
        pp.Pipe(0.2, flow="aspirating", jet_angle=0.1)
    hose = {"length": 0.6, "bending_stiffness": 7.3e-3, "pipe_mass": 0.19, "fluid_mass": 0.12}
    pipe = pp.Pipe.from_si(**hose, jet_angle=0.25)
    assert pipe.jet_angle == 0.25
    assert "jet_angle=0.25" in repr(pipe)
    bent = pp.Pipe(0.2, damping=0.01, jet_angle=0.5)
    found = pp.relevant(bent, 2.0, "motion", duration=0.3, tolerance=1e-2)
    assert found["jet angle"].verdict == "relevant"
    assert found.growth < 0.0
    assert found["jet angle"].growth == pytest.approx(found.growth, rel=0.1)
    onset = pp.relevant(bent, 2.0, tolerance=1e-2)
    speeds = [
        pp.critical_speed(pp.Continuum(one)).speed for one in (bent, pp.Pipe(0.2, damping=0.01))
    ]
    assert onset["jet angle"].size == pytest.approx(abs(speeds[1] / speeds[0] - 1.0), rel=1e-2)


@pytest.mark.parametrize("end", ["pinned", "guided", "clamped"])
def test_a_jet_does_not_bend_a_pipe_whose_end_is_held(end):
    """Of its thrust only u^2 cos(psi), the part along the axis, buckles."""
    held, plain = (pp.Pipe(0.2, end=end, jet_angle=angle) for angle in (0.3, 0.0))
    if end == "guided":  # free to move across
        assert not held.rests_straight
        return
    found = [pp.critical_speed(pp.Continuum(pipe)) for pipe in (held, plain)]
    assert found[0].kind == "divergence"
    assert found[0].speed == pytest.approx(found[1].speed / math.sqrt(math.cos(0.3)), rel=1e-12)


def test_what_cannot_be_asked_of_a_bent_pipe_says_what_can():
    model = pp.Galerkin(pp.Pipe(0.2, damping=0.002, jet_angle=0.5), 8)
    rule = r"^model must be of a pipe that rests straight .* jet_angle=0.5\): a load across bends"
    with pytest.raises(ValueError, match=rule):
        pp.floquet(model, pp.Pulsation(4.0, 0.1, 20.0))
    lossy = pp.Galerkin(pp.Pipe(0.2, hysteresis=0.05, jet_angle=0.5), 8)
    with pytest.raises(
        ValueError, match=r"it does not act on what is at rest, so ask the pipe wit"
    ):
        pp.equilibria(lossy, 2.0)
    rest = pp.equilibria(pp.Galerkin(pp.Pipe(0.2, jet_angle=0.5), 8), 2.0).q[0]
    assert pp.eigenvalues(lossy.about(rest), 2.0, 2)[0].real < 0.0
