# SPDX-License-Identifier: MIT
"""Chain: operators, coordinates, spring rules, the line it draws."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from independent import lagrangian_operators
from scipy.linalg import eigvalsh
from test_properties import calm_pipes, chains

import pipedyn as pp

FIRST_BEAM_FREQUENCY = 1.8751040687119612**2
"""First root of cos(k) cosh(k) = -1, squared (textbooks: k = 1.8751040687)."""

UNEQUAL = {
    "lengths": [0.5, 0.3, 0.2],
    "centres": [0.4, 0.65, 0.55],
    "gyration_radii": [0.11, 0.2, 0.05],
    "springs": [3.0, 2.0, 5.0],
}


any_chain = given(chains(calm_pipes(), wild=False))


# ------------------------------------------------------------------------------- operators


@pytest.mark.parametrize(
    ("flow", "alpha", "share"),
    [
        ("ejecting", 1.0, 1.0),
        ("ejecting", 0.3, 1.0),
        ("aspirating", 0.7, 1.0),
        ("aspirating", 0, 0.0),
        ("aspirating", 0.7, 0.35),
    ],
)
def test_chain_linearises_the_papers_lagrangian(flow, alpha, share):
    """Three unequal segments against eqs. (1)-(6), by differences; the inflow has momentum."""
    pipe = pp.Pipe(0.3, gamma=2.5, flow=flow, alpha=alpha, damping=0.01, inflow_share=share)
    chain = pp.Chain(pipe, **UNEQUAL)
    numbers = *UNEQUAL.values(), 0.3, 2.5, 0.01, flow == "aspirating", alpha
    expected = lagrangian_operators(*numbers, u=1.75, inflow_share=share)
    for found, right in zip(chain.operators().at(1.75), expected, strict=True):
        np.testing.assert_allclose(found, right, rtol=1e-14, atol=1e-15 * np.abs(right).max())


def test_a_chain_of_one_segment_is_a_pendulum_with_a_jet():
    """One homogeneous bar: inertia 1/3, weight gamma/2, jet damping sqrt(beta) u."""
    chain = pp.Chain(pp.Pipe(0.25, gamma=4.0), n=1, springs=[3.0])
    mass, damping, stiffness = chain.operators().at(2.0)
    assert mass[0, 0] == pytest.approx(1 / 3, rel=1e-15)
    assert damping[0, 0] == pytest.approx(0.5 * 2.0, rel=1e-15)
    assert stiffness[0, 0] == pytest.approx(3.0 + 4.0 / 2, rel=1e-15)


@any_chain
def test_kinetic_energy_is_that_of_the_moving_segments(chain):
    """Mass matrix from the velocity of each centre of mass, for any chain."""
    expected = np.zeros((chain.dof, chain.dof))
    for j in range(chain.dof):
        centre = np.where(np.arange(chain.dof) < j, chain.lengths, 0.0)
        centre[j] = chain.centres[j] * chain.lengths[j]
        spin = np.eye(chain.dof)[j] * chain.gyration_radii[j]
        expected += chain.lengths[j] * (np.outer(centre, centre) + np.outer(spin, spin))
    np.testing.assert_allclose(chain.operators().mass, expected, rtol=1e-12, atol=1e-16)


@any_chain
def test_potential_energy_is_that_of_springs_and_lifted_centres(chain):
    """Springs by joint angles; each centre of mass rises by half its arm times theta squared."""
    joints = np.eye(chain.dof) - np.eye(chain.dof, k=-1)
    springs = joints.T @ np.diag(chain.springs) @ joints
    beyond = chain.lengths.sum() - np.cumsum(chain.lengths)
    weight = chain.lengths * (beyond + chain.centres * chain.lengths)
    ops = chain.operators()
    np.testing.assert_allclose(
        ops.stiffness, springs + chain.pipe.gamma * np.diag(weight), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(ops.damping, chain.pipe.damping * springs, rtol=1e-12, atol=1e-14)


def test_a_horizontal_chain_never_diverges():
    """gamma = 0: det K is the product of the springs at any speed."""
    chain = pp.Chain(pp.Pipe(0.2), **UNEQUAL)
    for u in (0.0, 1.0, 4.0, 9.0):
        assert np.linalg.det(chain.operators().at(u)[2]) == pytest.approx(3 * 2 * 5, rel=1e-11)


# ----------------------------------------------------------------- coordinates and O(n) route


@any_chain
def test_joint_angles_describe_the_same_pipe_as_angles(chain):
    transform = chain.from_elastic(np.eye(chain.dof))
    angles, elastic = chain.operators(), chain.elastic_operators()
    for name in ("mass", "gyroscopic", "end_flux", "damping", "stiffness", "flux"):
        expected = transform.T @ getattr(angles, name) @ transform
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(getattr(elastic, name), expected, atol=1e-12 * size)


@any_chain
def test_an_elastic_coordinate_holds_half_a_unit_of_energy(chain):
    rigid = pp.Chain(
        pp.Pipe(0.1), lengths=chain.lengths, base=chain.base, springs=chain.springs + 1.0
    )
    np.testing.assert_allclose(rigid.elastic_operators().stiffness, np.eye(chain.dof), atol=1e-12)


# ----------------------------------------------------------------------------- spring rules


def first_frequency(chain):
    """From the mass matrix in joint angles, whose largest eigenvalue keeps its digits at any n."""
    joints = np.tri(chain.dof)
    mass = joints.T @ chain.operators().mass @ joints
    return 1.0 / math.sqrt(eigvalsh(mass, np.diag(chain.springs))[-1])


@pytest.mark.parametrize(
    ("given", "springs"),
    [
        ({"lengths": [0.5, 0.3, 0.2]}, [2 / 0.5, 2 / 0.8, 2 / 0.5]),
        ({"n": 7}, [14.0] + 6 * [7.0]),
        ({"lengths": [0.4, 0.3, 0.2], "base": 0.1}, [1 / 0.3, 1 / 0.35, 1 / 0.25]),
        ({"n": 9, "springs": "uniform"}, 9 * [9.0]),
    ],
    ids=repr,
)
def test_springs_have_the_flexibility_of_the_pipe_about_them(given, springs):
    """1 / k_j = (l_{j-1} + l_j) / 2 with l_0 = 0: the clamp carries half a segment and the base.

    Uniform springs are all n.
    """
    np.testing.assert_allclose(pp.Chain(pp.Pipe(0.2), **given).springs, springs, rtol=1e-14)


def test_midpoint_cuts_cells_with_a_joint_in_the_middle_of_each():
    chain = pp.Chain(pp.Pipe(0.2), 4, springs="midpoint")
    assert chain.base == 1 / 8
    np.testing.assert_allclose(chain.lengths, [1 / 4, 1 / 4, 1 / 4, 1 / 8], rtol=1e-15)
    np.testing.assert_array_equal(chain.springs, 4.0)
    np.testing.assert_allclose(chain.gyration_radii, chain.lengths / math.sqrt(12), rtol=1e-15)


@pytest.mark.parametrize(
    "given", [*({"n": n} for n in (1, 2, 3, 10, 150)), {"lengths": [0.4, 0.1, 0.3, 0.2]}], ids=repr
)
def test_frequency_rule_gives_the_cantilevers_first_frequency(given):
    chain = pp.Chain(pp.Pipe(0.2), **given, springs="frequency")
    assert np.ptp(chain.springs) == 0.0
    assert first_frequency(chain) == pytest.approx(FIRST_BEAM_FREQUENCY, rel=1e-10)


@pytest.mark.parametrize("n", [2, 3, 8])
def test_rayleigh_rule_equates_two_energies_of_the_tip_load_shape(n):
    """The paper's rule written out: joints on x^2 (3 - x), potential = omega_1^2 kinetic energy."""
    joints = np.arange(n + 1) / n
    nodes = joints**2 * (3 - joints)
    angles = np.diff(nodes) * n
    kinetic = 0.0
    for j in range(n):
        centre = (nodes[j] + nodes[j + 1]) / 2
        kinetic += (centre**2 + angles[j] ** 2 / n**2 / 12) / n
    turns = np.diff(np.concatenate([[0.0], angles]))
    spring = FIRST_BEAM_FREQUENCY**2 * kinetic / np.sum(turns**2)
    chain = pp.Chain(pp.Pipe(0.2), n, springs="rayleigh")
    np.testing.assert_allclose(chain.springs, spring, rtol=1e-13)


def test_the_papers_rule_tends_to_a_beam_too_soft():
    """k / n tends to 0.971328.

    It is the first eigenvalue over the Rayleigh quotient of x^2 (3 - x), 140 / 11: potential energy
    int (6 - 6 x)^2 = 12, kinetic energy int x^4 (3 - x)^2 = 33 / 35.
    """
    quotient = FIRST_BEAM_FREQUENCY**2 / (12 / (33 / 35))
    assert quotient == pytest.approx(0.971328, abs=1e-6)
    coarse, fine = (
        pp.Chain(pp.Pipe(0.2), n, springs="rayleigh").springs[0] / n for n in (800, 1600)
    )
    assert fine == pytest.approx(quotient, abs=1e-3)
    assert 2 * fine - coarse == pytest.approx(quotient, abs=1e-6)


# ------------------------------------------------------------------- what a chain looks like


def test_a_bent_chain_keeps_its_length_and_ends_at_its_tip():
    chain = pp.Chain(pp.Pipe(0.2), 6, springs="midpoint")
    q = np.array([0.2, 0.5, -0.3, 0.9, 1.4, 2.0])
    halves = np.repeat(chain.lengths / 2, 2)
    places = chain.shape(q, chain.base + np.concatenate([[0.0], np.cumsum(halves)]))
    nodes = places[::2]
    np.testing.assert_allclose(np.hypot(*np.diff(places, axis=0).T), halves, rtol=1e-14)
    np.testing.assert_allclose(np.hypot(*np.diff(nodes, axis=0).T), chain.lengths, rtol=1e-14)
    np.testing.assert_allclose(nodes[0], [0.0, chain.base], atol=1e-16)
    np.testing.assert_allclose(chain.shape(q, [0.0]), [[0.0, 0.0]], atol=1e-16)
    expected = [np.sum(chain.lengths * np.sin(q)), chain.base + np.sum(chain.lengths * np.cos(q))]
    np.testing.assert_allclose(chain.tip(q), expected, rtol=1e-14)
    np.testing.assert_allclose(nodes[-1], chain.tip(q), rtol=1e-14)


def test_a_chain_shows_what_it_was_made_of_and_pickles():
    chain = pp.Chain(pp.Pipe(0.3, gamma=2.0), **UNEQUAL, drag_points=[0.1, 0.2, 0.3])
    same = pickle.loads(pickle.dumps(chain))
    for name, value in (UNEQUAL | {"drag_points": [0.1, 0.2, 0.3]}).items():
        np.testing.assert_array_equal(getattr(chain, name), value)
        np.testing.assert_array_equal(getattr(same, name), value)
        with pytest.raises(ValueError, match="read-only"):
            getattr(chain, name)[0] = 1.0


def test_a_chain_of_the_users_own_is_not_taken_for_the_continuous_pipe():
    assert pp.Chain(pp.Pipe(0.2), 5).rule == "consistent"
    assert pp.Chain(pp.Pipe(0.2), 5).approximates_pipe
    own = pp.Chain(pp.Pipe(0.2), springs=[5.0] * 5)
    assert own.rule is None
    assert not own.approximates_pipe


def test_another_pipe_may_take_the_same_chain():
    chain = pp.Chain(pp.Pipe(0.2), **UNEQUAL)
    other = chain.with_pipe(pp.Pipe(0.5, gamma=3.0))
    expected = pp.Chain(pp.Pipe(0.5, gamma=3.0), **UNEQUAL).operators()
    np.testing.assert_array_equal(other.springs, chain.springs)
    np.testing.assert_array_equal(other.operators().stiffness, expected.stiffness)
    np.testing.assert_array_equal(other.operators().gyroscopic, expected.gyroscopic)
    assert chain.pipe == pp.Pipe(0.2)


def test_chains_with_equal_segments_share_them_and_no_others():
    bare, damped = pp.Chain(pp.Pipe(0.2), 7), pp.Chain(pp.Pipe(0.4, damping=0.1), 7)
    assert damped.lengths is bare.lengths
    clamped = pp.Chain(pp.Pipe(0.2, end="clamped"), 7)
    np.testing.assert_allclose((clamped.end_spring, clamped.springs[0]), 14.0)
    buckles = 14.0 * math.sin(math.pi / 7.0)  # as a chain of seven segments between clamps
    assert pp.critical_speed(clamped).speed == pytest.approx(buckles)
    stiff = pp.Chain(pp.Pipe(0.2), 7, springs=2.0 * bare.springs)
    np.testing.assert_array_equal(pp.Chain(pp.Pipe(0.2), 7).springs, 0.5 * stiff.springs)
    assert pp.Chain(pp.Pipe(0.2), 7, base=0.1).lengths.sum() == pytest.approx(0.9)
    pinned = clamped.with_pipe(pp.Pipe(0.2, end="pinned"))
    assert pp.critical_speed(pinned).speed < pp.critical_speed(clamped).speed


def test_another_pipe_must_be_one_that_the_chain_takes():
    """Its fluid is a part of the segments' masses, and its supports hold them where they rest."""
    light = pp.Chain(pp.Pipe(0.2), masses=[0.2, 0.8])
    with pytest.raises(ValueError, match=r"masses must be at least beta = 0\.9 times the length"):
        light.with_pipe(pp.Pipe(0.9))
    standing = pp.Pipe(0.2, -30.0)
    for model in (pp.Chain(standing, 4), pp.Galerkin(standing, 4)):
        bent = model.about(pp.equilibria(model, 1.0).q[1])
        other = bent.with_pipe(pp.Pipe(0.3, -31.0))
        np.testing.assert_array_equal(other.resting(), bent.resting())
        with pytest.raises(ValueError, match="reference must"):
            bent.with_pipe(pp.Pipe(0.2, -30.0, supports=(0.5,)))
