# SPDX-License-Identifier: MIT
"""Motion in time: tolerances that mean what they say, audits, one or many members."""

import re
from functools import cache

import numpy as np
import pytest

import pipedyn as pp
import pipedyn.motion.simulate
from pipedyn import modular as md

PIPE = pp.Pipe(0.2)
DAMPED = pp.Pipe(0.2, gamma=5.0, drag=0.5, damping=2e-3)
CHAIN = pp.Chain(PIPE, 6)
METHODS = "dop853", "radau", "scipy:DOP853", "scipy:Radau", "scipy:BDF", "scipy:LSODA"


def bow(s):
    return 0.6 * s * (2.0 - s)


# ------------------------------------------------------------------------- one motion


@pytest.mark.parametrize("method", METHODS)
def test_every_method_tends_to_one_motion_and_its_audit_to_nothing(method):
    exact = pp.simulate(CHAIN, 6.0, 0.5, bow, rtol=1e-12, samples=11)
    found = pp.simulate(CHAIN, 6.0, 0.5, bow, method=method, samples=11)
    assert found.method == method
    assert np.abs(found.q - exact.q).max() < 5e-4
    assert exact.audit < 1e-12
    assert found.audit < 1e-4
    assert found.evaluations > 50


@cache
def sharply_solved(pipe):
    chain = pp.Chain(pipe, 5)
    return chain, pp.simulate(chain, 6.0, 1.0, bow, rtol=1e-13, samples=21).q


@pytest.mark.parametrize(
    ("pipe", "method", "least"),
    [
        (PIPE, "dop853", 0.7),
        (PIPE, "radau", 0.7),
        (PIPE, "scipy:LSODA", 0.6),
        (PIPE, "scipy:Radau", 0.5),
        (DAMPED, "radau", 0.4),
        (DAMPED, "dop853", 0.4),  # |v| v is not smooth: steps across its kinks know less
        (DAMPED, "scipy:LSODA", 0.6),
    ],
    ids=str,
)
def test_a_sharper_tolerance_gives_a_proportionally_better_answer(pipe, method, least):
    chain, exact = sharply_solved(pipe)
    tolerances = np.logspace(-4, -9, 6)[: 3 if method == "scipy:Radau" else 6]  # the rest is slow
    errors = [
        np.abs(
            pp.simulate(chain, 6.0, 1.0, bow, rtol=rtol, samples=21, method=method).q - exact
        ).max()
        for rtol in tolerances
    ]
    order = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert least < order < 1.3
    assert (np.array(errors) < 1e3 * tolerances).all()


def test_the_samples_asked_for_do_not_change_the_motion():
    few = pp.simulate(CHAIN, 6.0, 2.0, bow, rtol=1e-10, samples=3)
    many = pp.simulate(CHAIN, 6.0, 2.0, bow, rtol=1e-10, samples=401)
    odd = pp.simulate(CHAIN, 6.0, 2.0, bow, rtol=1e-10, times=[0.31, 1.0, 1.9])
    assert few.t.tolist() == [0.0, 1.0, 2.0]
    assert np.abs(few.q - many.q[[0, 200, 400]]).max() < 1e-8
    assert np.abs(odd.q[1] - few.q[1]).max() < 1e-8
    assert odd.t.tolist() == [0.31, 1.0, 1.9]
    assert pp.simulate(CHAIN, 6.0, 2.0, bow).t.size == 501
    assert np.diff(pp.simulate(CHAIN, 6.0, 20.0, bow).t) == pytest.approx(1 / 40)
    at_once = pp.simulate(CHAIN, 6.0, 2.0, bow, times=[0.0])
    assert at_once.q.tolist() == [CHAIN.bent(bow).tolist()]


def integrated(monkeypatch):
    """A list to which each integration by `simulate` adds how many samples it was to keep."""
    kept, integrate = [], pipedyn.motion.simulate.integrate

    def counting(tasks, *others):
        kept.append(tasks[0].times.size)
        return integrate(tasks, *others)

    monkeypatch.setattr("pipedyn.motion.simulate.integrate", counting)
    return kept


def test_a_slow_motion_keeps_no_more_samples_than_it_shows(monkeypatch):
    kept = integrated(monkeypatch)
    for duration in (5.0, 20.0):
        motion = pp.simulate(CHAIN, 6.0, duration, bow)
        assert kept == [motion.t.size]
        kept.clear()


def test_a_motion_that_becomes_fast_late_is_sampled_finely_from_its_start(monkeypatch):
    kept = integrated(monkeypatch)

    def late(t):
        return 3.0 + 9.0 / (1.0 + np.exp(-40.0 * (t - 11.0)))

    found = pp.simulate(pp.Chain(PIPE, 3), late, 12.5, bow)
    assert kept[0] == 501
    assert len(kept) == 2
    assert kept[1] >= found.t.size > 501
    slow = pp.simulate(pp.Chain(PIPE, 3), 3.0, 12.5, bow)
    assert slow.t.size == 501
    early = found.t <= 10.0
    x = np.interp(found.t[early], slow.t, slow.tip[:, 0])
    assert np.abs(x - found.tip[early, 0]).max() < 0.01


@pytest.mark.parametrize(
    ("model", "u", "duration", "start"),
    [
        (pp.Chain(PIPE, 20), 0.0, 2.0, np.full(20, 0.1)),
        (pp.Chain(PIPE, 20), 6.0, 8.0, np.full(20, 0.01)),
        (pp.Chain(pp.Pipe(0.2, damping=1e-3), 12), 4.0, 14.0, np.full(12, 0.1)),
        (pp.Galerkin(PIPE, 8), 3.0, 0.5, lambda s: 0.1 + 0.0 * s),
        (md.chain(pp.Pipe(0.2), 6).plus(md.Guide(3)), 5.0, 4.0, lambda s: 0.01 * s**2),
    ],
)
def test_default_samples_are_those_that_are_left_of_the_finest(model, u, duration, start):
    """A motion with a callback is sampled finely at once, and then thinned out."""
    found = pp.simulate(model, u, duration, start)
    thinned = pp.simulate(model, u, duration, start, callback=lambda t, q, qdot: None)
    np.testing.assert_array_equal(found.t, thinned.t)
    np.testing.assert_array_equal(found.q, thinned.q)
    np.testing.assert_array_equal(found.tip, thinned.tip)


SPANS = pp.Pipe(0.3, 5.0, end="clamped", damping=0.01, supports=(0.4,))


@pytest.mark.parametrize(
    "model",
    [
        CHAIN,
        pp.Galerkin(DAMPED, 4, "legendre"),
        pp.Chain(SPANS, 6),
        pp.Galerkin(SPANS, 4),
        pp.Chain(pp.Pipe(0.2, jet_angle=0.4), 4),
        md.chain(DAMPED, 3).plus(md.Guide(3)),
    ],
    ids=["chain", "reduced", "chain on supports", "reduced on supports", "jet", "scene"],
)
def test_a_motion_without_a_start_begins_at_the_slight_bend_of_all_questions(model):
    """That of `limit_cycle`, `bifurcation_diagram` and `lyapunov_exponent`: theta = 0.05 s^2."""
    alone = pp.simulate(model, 1.0, 0.1, samples=11)
    bent = pp.simulate(model, 1.0, 0.1, lambda s: 0.05 * s**2, samples=11)
    assert alone == bent
    assert 1e-3 < np.abs(model.shape(alone.q[0], [0.2, 0.7, 1.0])[:, 0]).max() < 0.02
    [member] = pp.simulate_many(model, [1.0], 0.1, samples=11, method=alone.method).motions
    np.testing.assert_allclose(member.q, bent.q, rtol=0.0, atol=1e-8)
    pumped, shaken = pp.Pulsation(1.0, 0.2, 9.0), pp.Harmonic(0.01, 9.0)
    driven = pp.simulate(model, pumped, 0.1, samples=11, base=shaken)
    np.testing.assert_array_equal(driven.q[0], bent.q[0])


def test_a_motion_gives_tip_energy_and_states():
    motion = pp.simulate(CHAIN, 6.0, 1.0, bow, np.linspace(0.0, 1.0, 6), samples=5)
    assert motion.q.shape == motion.qdot.shape == (5, 6)
    assert motion.y.shape == (12, 5)
    assert motion.qdot[0] == pytest.approx(np.linspace(0.0, 1.0, 6))
    for i in range(5):
        assert motion.tip[i] == pytest.approx(CHAIN.tip(motion.q[i]), abs=1e-15)
        assert motion.energy[i] == pytest.approx(CHAIN.energy(motion.y[:, i]), rel=1e-13)


def test_the_audit_sees_energy_that_no_force_brings():
    """As of an energy that jumps, where no gradient tells of it."""
    scene = md.chain(CHAIN.pipe, 6)
    pushed = scene.plus(md.Custom(nodes=(6,), force=lambda q, v: 1e-3 * q))
    jumping = scene.plus(md.Custom(nodes=(6,), energy=lambda q: 0.0 * q[0] + 1e-4 * (q[0] > 0.05)))
    honest, dishonest = (pp.simulate(one, 6.0, 1.0, bow).audit for one in (pushed, jumping))
    assert honest < 1e-8 < 1e-6 < dishonest


@pytest.mark.parametrize("u", [5.0, 6.0])
def test_small_motion_grows_or_decays_with_the_eigenvalue(u):
    value = pp.eigenvalues(CHAIN, u)
    value = value[np.argmax(value.real)]
    motion = pp.simulate(CHAIN, u, 12.0, lambda s: 1e-9 * s, rtol=1e-9, atol=1e-18, samples=2401)
    late = motion.t > 8.0
    tip = motion.tip[late, 0]
    peaks = np.flatnonzero((tip[1:-1] > tip[:-2]) & (tip[1:-1] > tip[2:])) + 1
    times = motion.t[late][peaks]
    growth = np.polyfit(times, np.log(tip[peaks]), 1)[0]
    assert growth == pytest.approx(value.real, abs=3e-3)
    assert 2 * np.pi / np.diff(times).mean() == pytest.approx(abs(value.imag), rel=2e-3)


FEEDING = pp.Chain(pp.Pipe(0.5, flow="aspirating"), 2)  # far above onset, with nothing to bound it


def test_a_motion_that_cannot_go_on_carries_what_there_is():
    with pytest.raises(pp.MotionStopped, match="step size tends to 0") as caught:
        pp.simulate(FEEDING, 5.0, 100.0, bow, samples=1001)
    motion = caught.value.motion
    assert 0.5 < motion.t[-1] < 2.0
    assert motion.energy[-1] > 1e4
    assert motion.q[0] == pytest.approx(FEEDING.bent(bow))


def test_jacobians_do_not_stop_a_motion_that_goes_on():
    """Right-hand sides and Jacobians are one measure of what a motion took since it was asked."""
    motion = pp.simulate(CHAIN, 6.0, 20.0, bow, rtol=1e-2, method="scipy:LSODA")
    assert motion.evaluations > 10_000  # and 1,900 Jacobians
    assert motion.t[-1] == 20.0


def test_a_motion_of_jacobians_that_comes_nowhere_is_stopped():
    """Dry friction holds a joint that slides both ways: each Jacobian counts as 20 evaluations."""
    friction = md.Custom(joints=(1,), force=lambda q, v: 0.0 * q - 5.0 * np.sign(v.real))
    with pytest.raises(pp.MotionStopped, match="step size tends to 0") as caught:
        pp.simulate(md.chain(PIPE, 1).plus(friction), 1.0, 20.0, bow, method="scipy:BDF")
    assert caught.value.motion.evaluations < 10_000


def test_a_motion_that_stops_before_its_first_sample_says_so_and_spoils_no_others():
    late = {"times": [50.0, 100.0]}
    with pytest.raises(pp.MotionStopped, match="stopped before its first sample") as caught:
        pp.simulate(FEEDING, 5.0, 100.0, bow, **late)
    assert caught.value.motion.q.shape == (0, 2)
    assert caught.value.motion.tip.shape == (0, 2)
    calm = pp.Chain(pp.Pipe(0.5, damping=0.1), 2)
    both = pp.simulate_many([calm, FEEDING], [0.5, 5.0], 100.0, bow, **late)
    assert both.motions[0].t.size == 2
    assert [failure.index for failure in both.failures] == [1]


def test_a_motion_that_follows_its_fastest_mode_forever_is_refused_at_once():
    lengths = 10.0 ** -np.array([0.0, 2.4, 4.8, 1.2, 6.0, 3.6])
    unequal = pp.Chain(PIPE, lengths=lengths / lengths.sum())
    for method in ("dop853", "radau", "scipy:DOP853"):
        with pytest.raises(pp.MotionStopped, match=r"e\+1\d right-hand .* take 1e\+08 at most"):
            pp.simulate(unequal, 6.0, 1.0, bow, method=method)
    for method, soon in (("dop853", 1000), ("auto", 22_000)):
        with pytest.raises(pp.MotionStopped, match="right-hand sides") as caught:
            pp.simulate(unequal, 6.0, 1.0, bow, method=method)
        assert caught.value.motion.evaluations < soon
        assert caught.value.motion.t[-1] == 0.0
    both = pp.simulate_many([CHAIN, *[unequal] * 2], 6.0, 1.0, bow, samples=3)
    assert [failure.index for failure in both.failures] == [1, 2]
    assert both.motions[0].t[-1] == 1.0


@pytest.mark.parametrize(
    ("n", "damping"), [(5, 0.0), (5, 1e-4), (5, 1e-1), (20, 0.0), (20, 1e-4), (40, 1e-4)]
)
def test_no_motion_is_refused_that_keeps_to_its_bound(n, damping):
    """Not even near rest, where only stability holds the steps of an explicit method."""
    chain = pp.Chain(pp.Pipe(0.2, damping=damping), n)

    def small(**bounds):
        return pp.simulate(chain, 0.0, 0.5, lambda s: 1e-6 * s, method="dop853", rtol=0.1, **bounds)

    needed = small().evaluations
    assert small(most=needed).evaluations == needed
    with pytest.raises(pp.MotionStopped, match=r"at most|more than"):
        small(most=0.9 * needed)


@pytest.mark.parametrize("method", ["dop853", "radau", "scipy:LSODA", "scipy:Radau"])
def test_a_motion_ends_where_its_right_hand_sides_do_and_keeps_what_there_is(method):
    with pytest.raises(pp.MotionStopped, match="more than 390") as caught:
        pp.simulate(CHAIN, 6.0, 2.0, bow, method=method, most=390)
    assert 0.0 < caught.value.motion.t[-1] < 2.0
    # Steps of "dop853" are whole: 12 right-hand sides and 3 of dense output. "radau" takes eight.
    unused = {"dop853": 15, "radau": 7}.get(method, 0)
    assert 390 - unused <= caught.value.motion.evaluations <= 390
    whole = pp.simulate_many(CHAIN, [5.0, 6.0], 2.0, bow, method=method, most=390)
    assert [failure.index for failure in whole.failures] == [0, 1]
    assert min(motion.t.size for motion in whole.motions) > 1


@pytest.mark.parametrize("most", range(26, 34))
def test_what_a_step_left_unfinished_is_no_part_of_a_motion(most):
    """The interpolant of DOP853 takes right-hand sides of its own, which may be the last."""
    with pytest.raises(pp.MotionStopped) as caught:
        pp.simulate(CHAIN, 6.0, 1.0, bow, samples=2001, method="scipy:DOP853", most=most)
    assert np.isfinite(caught.value.motion.q).all()


@pytest.mark.parametrize("method", METHODS)
def test_a_motion_of_one_right_hand_side_stops_and_no_step_overflows(method):
    """Radau divides by a step that shrinks below the smallest number of full precision."""
    together = pp.simulate_many(CHAIN, [1.7, 0.3], 0.1, bow, method=method, most=1)
    assert [failure.index for failure in together.failures] == [0, 1]


@pytest.mark.parametrize(
    "method",
    ["dop853", "radau", "scipy:LSODA", pytest.param("scipy:Radau", marks=pytest.mark.slow)],
)
def test_what_goes_wrong_on_the_way_ends_a_motion_and_is_not_lost(method):
    """Errors of a module leave the beginning of the motion; an interruption is the caller's."""
    raised = []

    def force(q, v):
        if raised and q[0].real < -0.1:
            raise raised[0]
        return 0.0 * q

    scene = md.chain(CHAIN.pipe, 6).plus(md.Custom(nodes=(6,), force=force))
    raised.append(ValueError("math domain error"))
    with pytest.raises(pp.MotionStopped, match="no longer finite") as caught:
        pp.simulate(scene, 6.0, 1.0, bow, samples=101, method=method)
    assert caught.value.motion.t.size > 5
    assert -0.11 < caught.value.motion.tip[-1, 0] < 0.0
    assert np.isfinite(caught.value.motion.q).all()
    raised[0] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        pp.simulate(scene, 6.0, 1.0, bow, method=method)


def chosen(model, members=1):
    """The method of motions that are hardly begun."""
    if members == 1:
        return pp.simulate(model, 0.1, 1e-9, bow, samples=2).method
    found = pp.simulate_many(model, [0.1] * members, 1e-9, bow, samples=2)
    (method,) = {motion.method for motion in found.motions}
    return method


def test_the_method_follows_from_members_model_and_decay():
    chain, stiff = (pp.Chain(pp.Pipe(0.2, damping=damping), 20) for damping in (1e-4, 1e-2))
    for model in (chain, stiff, pp.Chain(PIPE, 20), pp.Galerkin(PIPE, 6), md.chain(PIPE, 5)):
        assert chosen(model) == "radau"
    assert chosen(pp.Galerkin(PIPE, 6), 64) == "radau"
    assert chosen(stiff, 64) == "radau"
    assert chosen(chain, 64) == chosen(pp.Chain(PIPE, 20), 8) == "dop853"
    short, guided = (md.chain(chain.pipe, n).plus(md.Guide(9)) for n in (20, 1001))
    assert chosen(short, 64) == "dop853"
    assert chosen(short) == chosen(guided) == "radau"
    magnet = md.Custom(nodes=(9,), energy=lambda q: q[0] ** 4)  # its Jacobian is a matrix
    assert chosen(guided.plus(magnet)) == "dop853"
    assert pp.simulate(stiff, 6.0, 0.1, bow, method="dop853").method == "dop853"


@pytest.mark.parametrize(("n", "damping"), [(5, 1e-1), (11, 1e-2), (16, 3e-3)])
def test_implicit_steps_take_fewer_right_hand_sides_where_fast_modes_decay(n, damping):
    """Counted, as times scatter; their stages go through the processor's vectors besides."""
    chain = pp.Chain(pp.Pipe(0.2, damping=damping), n)
    implicit, explicit = (
        pp.simulate(chain, 4.0, 1.0, bow, samples=21, rtol=1e-4, method=method)
        for method in ("radau", "dop853")
    )
    assert implicit.evaluations < 0.6 * explicit.evaluations
    sharp = pp.simulate(chain, 4.0, 1.0, bow, samples=21, rtol=1e-9)
    assert np.abs(implicit.tip - sharp.tip).max() < 1e-2 * np.abs(sharp.tip[:, 0]).max()


@pytest.mark.parametrize("n", [1, 2, 5, 40])
def test_the_fastest_frequency_is_that_of_the_matrices(n):
    chain = pp.Chain(pp.Pipe(0.2, gamma=5.0, drag=1.0), n)
    mass, _, stiffness = chain.operators().at(0.0)
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.max())
    with pytest.raises(pp.MotionStopped, match=r"fastest mode has \|lambda\| = ") as caught:
        pp.simulate(chain, 0.0, 1e6, bow, samples=2, method="dop853", most=1000)
    said = float(re.search(r"\|lambda\| = (\S+)", str(caught.value))[1])  # of two digits
    assert said == pytest.approx(float(f"{exact:.2g}"), rel=1e-9)


# ----------------------------------------------------------------------- many motions


def test_an_ensemble_is_the_motions_of_its_members():
    speeds = np.linspace(3.0, 7.0, 130)  # more than one batch
    together = pp.simulate_many(CHAIN, speeds, 1.0, bow, rtol=1e-9, samples=6)
    assert len(together) == 130
    assert together.failures == ()
    for i in (0, 63, 129):
        alone = pp.simulate(CHAIN, speeds[i], 1.0, bow, rtol=1e-9, samples=6)
        assert together.motions[i].u == speeds[i]
        assert np.abs(together.motions[i].q - alone.q).max() < 1e-7
        assert np.abs(together.motions[i].energy - alone.energy).max() < 1e-6
        assert together.motions[i].audit < 1e-8
    late = pp.simulate_many(CHAIN, speeds[:2], 1.0, bow, times=[0.5, 1.0], rtol=1e-9)
    assert max(motion.audit for motion in late.motions) < 1e-8


def test_a_hundred_members_take_far_fewer_calls_than_a_hundred_motions():
    speeds = np.linspace(5.0, 6.0, 96)
    together = pp.simulate_many(CHAIN, speeds, 1.0, bow, samples=6)
    alone = pp.simulate(CHAIN, 5.5, 1.0, bow, samples=6)
    calls = together.motions[0].evaluations + together.motions[-1].evaluations  # two batches
    assert calls < 10 * alone.evaluations


def test_a_failed_member_is_reported_and_the_others_kept():
    found = pp.simulate_many(FEEDING, [0.0, 0.1, 5.0, 0.2], 2.0, bow, samples=21)
    assert [failure.index for failure in found.failures] == [2]
    assert 0.5 < found.failures[0].error.motion.t[-1] < 2.0
    assert "member 2" in str(found.failures[0].error)
    assert len(found) == 4
    for i, u in ((0, 0.0), (1, 0.1), (3, 0.2)):
        alone = pp.simulate(FEEDING, u, 2.0, bow, samples=21)
        assert np.abs(found.motions[i].q - alone.q).max() < 1e-4


# -------------------------------------------------------------- chain and pipe's behaviour


SCENES = {
    "ejecting": (pp.Pipe(0.2, gamma=3.0), 6.0, "legendre"),
    "ejecting, drag": (pp.Pipe(0.3, drag=2.0), 6.0, "legendre"),
    "aspirating, damped": (pp.Pipe(0.2, 0.0, "aspirating", 0.7, damping=2e-3), 2.0, "legendre"),
    "aspirating": (pp.Pipe(0.2, flow="aspirating"), 1.5, "beam"),
}


def tips(model, u):
    return pp.simulate(model, u, 1.0, bow, samples=11, rtol=1e-8).tip


@pytest.mark.parametrize("scene", SCENES)
def test_chain_and_reduced_model_tend_to_one_motion(scene):
    pipe, u, basis = SCENES[scene]
    reference = tips(pp.Galerkin(pipe, 12, basis), u)
    assert np.ptp(reference[:, 0]) > 0.2  # large: the angle reaches 0.6 and more
    chains = np.array([np.abs(tips(pp.Chain(pipe, n), u) - reference).max() for n in (8, 16, 32)])
    orders = np.log2(chains[:-1] / chains[1:])
    assert orders == pytest.approx(2.0, abs=0.35)
    assert chains[-1] < 6e-3
    beams = np.array([np.abs(tips(pp.Galerkin(pipe, m), u) - reference).max() for m in (2, 4, 8)])
    assert beams[0] > 5.0 * beams[1] > 10.0 * beams[2]
    assert beams[2] < 6e-4
    if basis == "legendre":
        few = np.abs(tips(pp.Galerkin(pipe, 8, basis), u) - reference).max()
        assert few < 2e-4


def test_where_drag_acts_on_a_segment_matters_less_as_segments_become_more():
    # The paper: the choice of the drag points loses its meaning as n grows.
    pipe = pp.Pipe(0.2, drag=5.0)

    def tip(n, point):
        chain = pp.Chain(pipe, n, drag_points=np.full(n, point))
        return pp.simulate(chain, 6.0, 1.0, bow, rtol=1e-9, samples=11).tip

    spread = np.array([np.abs(tip(n, 1.0) - tip(n, 0.0)).max() for n in (4, 8, 16, 32)])
    orders = np.log2(spread[:-1] / spread[1:])
    assert (orders > 0.7).all()
    assert spread[-1] < 0.1


def test_drag_bounds_the_aspirating_pipe_that_any_flow_sets_in_motion():
    # Undamped, every mode grows from the smallest flow on; drag's power grows like the cube of the
    # amplitude, the flow's like its square.
    u, width = 0.3, {}
    plain = pp.Chain(pp.Pipe(0.2, flow="aspirating"), 5)
    assert pp.eigenvalues(plain, u).real.max() > 0.0
    free = pp.simulate(plain, u, 12.0, lambda s: 1e-3 * s, samples=601)
    assert np.ptp(free.tip[-100:, 0]) > 5.0 * np.ptp(free.tip[:100, 0])
    for drag in (3.0, 10.0):
        chain = pp.Chain(pp.Pipe(0.2, flow="aspirating", drag=drag), 5)
        motion = pp.simulate(chain, u, 100.0, lambda s: 2e-2 * s, samples=2001, rtol=1e-5)
        parts = [np.ptp(part[:, 0]) for part in np.array_split(motion.tip, 8)]
        assert parts[-1] == pytest.approx(parts[-2], rel=0.02)
        width[drag] = parts[-1]
    assert 0.01 < width[10.0] < width[3.0] < 0.1


# ----------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: pp.simulate(CHAIN, 6.0, 1.0, lambda s: s[:-1]), r"angle\(s\)"),
        (lambda: pp.simulate(CHAIN, 6.0, 1.0, bow, samples=10**9), "samples"),
        (lambda: pp.simulate(CHAIN, 6.0, 1.0, bow, times=[0.5, 0.5]), "times"),
        (lambda: pp.simulate(CHAIN, 6.0, 1.0, bow, times=[0.5, 1.5]), "times"),
        (lambda: pp.simulate(CHAIN, 6.0, 1.0, bow, rtol=1e-16), "rtol"),
        (lambda: pp.simulate(CHAIN, 6.0, 1e-300, bow), "duration"),
        (lambda: pp.simulate_many([CHAIN, 3], 6.0, 1.0, bow), r"models\[1\]"),
        (lambda: pp.simulate_many([CHAIN] * 2, [5.0, 6.0, 7.0], 1.0, bow), "models"),
        (lambda: pp.simulate_many(CHAIN, [5.0, 6.0], 1.0, [[0.0] * 6, [0.0] * 5]), "q0.*member 1"),
        (lambda: pp.simulate_many(CHAIN, [5.0, 6.0, 7.0], 1.0, np.zeros((2, 6))), "q0"),
    ],
)
def test_a_bad_argument_of_a_motion_is_refused_by_name(call, name):
    """What each argument alone must not be is in fuzz.py."""
    with pytest.raises((ValueError, TypeError), match=rf"\b{name}") as caught:
        call()
    assert type(caught.value) in (ValueError, TypeError)
